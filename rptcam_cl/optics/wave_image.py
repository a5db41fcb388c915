"""The wave-optical image of a point, of its pupil function: Strehl ratio, spread, transfer and encircled energy.

The field on the film is U(x, y) = integral of a exp(2 pi i (l x + m y) / wavelength) dl dm, (x, y) from the chief
ray's point; it is summed for the very points wanted, by two matrices, so no point lies between two of a transform.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.pupil_function import PupilFunction

Array = NDArray[np.float64]
Waves = NDArray[np.complex128]

AIRY = 1.2196698912665045  # radius of the first dark ring of a round pupil, in wavelength times f-number
PADDED = 2  # the transform's room in widths of the pupil: none of its correlation wraps round
BESSEL_STEPS = 2048
FAR = 25.0  # argument from which Hankel's expansion of J1 is exact enough
WINDOW = 21  # points across the search of the peak


@dataclass(frozen=True)
class Strehl:
    """Strehl ratios: light at a point over that of the same pupil with a perfect wavefront."""

    at_chief_ray: float
    at_peak: float
    peak: tuple[float, float]  # x, y from the chief ray's point [mm]


def rms_waves(pupil: PupilFunction, waves: Array, without_tilt: bool = False) -> float:
    """Return the rms of a wavefront over the flux about its mean, or about its best plane in l and m [waves]."""
    weight = pupil.flux.ravel()
    weight = weight / weight.sum()
    axes = np.meshgrid(pupil.cosines_x, pupil.cosines_y)
    off = waves.ravel() - weight @ waves.ravel()
    if without_tilt:
        tilt = np.stack([(axis - np.mean(axis)).ravel() for axis in axes] + [np.ones(len(off))], axis=1)
        root = np.sqrt(weight)[:, None]
        off = off - tilt @ np.linalg.lstsq(tilt * root, off * root[:, 0], rcond=None)[0]
    return float(np.sqrt(weight @ off**2))


def peak_to_valley(pupil: PupilFunction, waves: Array) -> float:
    """Return the largest less the smallest path difference inside the pupil [waves]."""
    return float(np.ptp(waves[pupil.coverage >= 0.5]))


def spread(pupil: PupilFunction, x: ArrayLike, y: ArrayLike) -> Array:
    """Return the share of all light per mm2 at the points of a grid: x of the columns, y of the rows [mm] from C."""
    field = _field(pupil, np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    area = pupil.step**2
    return np.asarray(np.abs(field) ** 2 * area**2 / (pupil.flux.sum() * area * pupil.length_mm**2))


def _field(pupil: PupilFunction, x: Array, y: Array) -> Waves:
    turn = 2j * np.pi / pupil.length_mm
    rows, columns = np.exp(turn * np.outer(y, pupil.cosines_y)), np.exp(turn * np.outer(pupil.cosines_x, x))
    return np.asarray(rows @ pupil.field @ columns)


def centroid(pupil: PupilFunction) -> tuple[float, float]:
    """Return the middle of the light on the film, x, y from C [mm]: the mean gradient of the wavefront."""
    both = [_slopes(pupil, axis) for axis in (1, 0)]
    return both[0], both[1]


def _slopes(pupil: PupilFunction, axis: int) -> float:
    slope = np.gradient(pupil.waves, pupil.step, axis=axis)
    inner = np.minimum(np.roll(pupil.coverage, 1, axis), np.roll(pupil.coverage, -1, axis)) > 0
    weight = np.where(inner, pupil.flux, 0.0)
    return float(np.sum(weight * slope) / weight.sum()) * pupil.length_mm


def strehl(pupil: PupilFunction) -> Strehl:
    """Return the Strehl ratios at the chief ray's point and at the brightest point of the film."""
    perfect = float((np.sqrt(pupil.density) * pupil.coverage).sum()) ** 2
    size = 1 << int(np.ceil(np.log2(PADDED * len(pupil.coverage))))
    light = np.abs(np.fft.fft2(pupil.field, (size, size))) ** 2
    row, column = np.unravel_index(int(np.argmax(light)), light.shape)
    width = pupil.length_mm / (size * pupil.step)
    x, y = (-np.fft.fftfreq(size)[k] * size * width for k in (column, row))
    half = width
    for _ in range(4):
        xs, ys = x + np.linspace(-half, half, WINDOW), y + np.linspace(-half, half, WINDOW)
        near = np.abs(_field(pupil, xs, ys)) ** 2
        row, column = np.unravel_index(int(np.argmax(near)), near.shape)
        x, y, half = float(xs[column]), float(ys[row]), half / 8
    at_chief_ray = float(np.abs(pupil.field.sum()) ** 2)
    at_peak = max(float(near.max()), at_chief_ray)  # which may be the same point, summed in another order
    return Strehl(at_chief_ray / perfect, at_peak / perfect, (x, y))


def transfer(
    pupil: PupilFunction, frequencies_per_mm: ArrayLike, about: tuple[float, float] = (0.0, 0.0)
) -> tuple[Waves, Waves]:
    """Return the transfer (tangential, sagittal): the integral of a(l + wavelength f) a*(l) over that at f = 0.

    Its length is the modulation that the film receives; its phase counts from a point, x, y from C [mm]. Tangential
    frequencies run along y, sagittal ones along x.
    """
    frequencies = np.asarray(frequencies_per_mm, dtype=np.float64)
    shifts = frequencies * pupil.length_mm / pupil.step
    turns = (np.exp(2j * np.pi * frequencies * about[axis]) for axis in (1, 0))
    tangential, sagittal = (_correlated(pupil, shifts, axis) * turn for axis, turn in zip((0, 1), turns, strict=True))
    return tangential, sagittal


def _correlated(pupil: PupilFunction, shifts: Array, axis: int) -> Waves:
    """Return the correlation of the pupil with itself moved along an axis by parts of cells, over its flux.

    By the spread of a line on the film, which is its transform; each point counts on that side of the middle of the
    light where it lies nearer.
    """
    count = PADDED * len(pupil.coverage)
    line = (np.abs(np.fft.fft(pupil.field, count, axis=axis)) ** 2).sum(axis=1 - axis)
    line /= count * pupil.flux.sum()
    places = np.fft.fftfreq(count) * count
    middle = float(np.angle(line @ np.exp(2j * np.pi * places / count))) * count / (2 * np.pi)
    places = (places - middle + count / 2) % count - count / 2 + middle
    found = np.exp(2j * np.pi / count * np.outer(shifts, places)) @ line
    found += (1.0 - line.sum()) * np.maximum(1.0 - shifts, 0.0)  # unmoved, cells on the edge count by their flux
    return np.where(shifts < len(pupil.coverage), found, 0.0)


def encircled(pupil: PupilFunction, radii_mm: ArrayLike, about: tuple[float, float]) -> Array:
    """Return the share of the light inside circles of given radii about a point, x, y from C [mm]."""
    return encircling(pupil, about)(np.atleast_1d(np.asarray(radii_mm, dtype=np.float64)))


def encircling(pupil: PupilFunction, about: tuple[float, float]) -> Callable[[Array], Array]:
    """Return the function that gives the share of the light inside circles of radii [mm] about a point.

    The integral over a circle of the transform of the light: 2 pi r J1(2 pi f r) / (2 pi f), over all frequencies f;
    those of one length, in whole cells, count together.
    """
    size = 1 << int(np.ceil(np.log2(PADDED * len(pupil.coverage))))
    correlation = np.fft.ifft2(np.abs(np.fft.fft2(pupil.field, (size, size))) ** 2)
    cells = np.rint(np.fft.fftfreq(size) * size).astype(np.int64)
    unit = pupil.step / pupil.length_mm
    across, along = (np.exp(-2j * np.pi * unit * cells * part) for part in about)
    real = np.real(np.conj(correlation) * along[:, None] * across[None, :])
    squares = cells[None, :] ** 2 + cells[:, None] ** 2
    sums = np.bincount(squares.ravel(), weights=real.ravel())
    found = np.flatnonzero(sums)
    f = unit * np.sqrt(found[found > 0])
    middle, others = sums[0], sums[found[found > 0]] / f
    scale = unit**2 / pupil.flux.sum()

    def shares(radii: Array) -> Array:
        return np.array([scale * (middle * np.pi * r * r + r * (others @ _bessel_1(2 * np.pi * r * f))) for r in radii])

    return shares


def _bessel_1(x: Array) -> Array:
    """Return J1: from its integral by the trapezoidal rule, and far out by Hankel's expansion (Watson, 7.21)."""
    steps = int(FAR) + 64
    t = (np.arange(steps) + 0.5) * np.pi / steps
    known = np.linspace(0.0, FAR, BESSEL_STEPS)
    values = np.cos(t - known[:, None] * np.sin(t)).mean(axis=1)
    far = np.maximum(x, FAR)
    turn = far - 0.75 * np.pi
    even = 1 + 15 / (128 * far**2) - 4725 / (32768 * far**4)
    odd = 3 / (8 * far) - 105 / (1024 * far**3)
    hankel = np.sqrt(2 / (np.pi * far)) * (even * np.cos(turn) - odd * np.sin(turn))
    return np.asarray(np.where(x < FAR, np.interp(x, known, values), hankel))


def radius_of_share(shares_within: Callable[[Array], Array], share: float, most_mm: float) -> float:
    """Return the radius [mm] of the circle that holds a share of the light.

    Parameters
    ----------
    shares_within : callable
        Gives the shares of the light inside circles of given radii [mm].
    share : float
    most_mm : float
        Radius of the largest circle that is looked at.
    """
    low, high = 0.0, most_mm
    for _ in range(3):
        radii = np.linspace(low, high, 18)[1:]
        shares = shares_within(radii)
        k = int(np.argmax(shares >= share)) if (shares >= share).any() else len(radii) - 1
        low, high = (radii[k - 1] if k else low), float(radii[k])
    return (float(low) + high) / 2


def diffraction_mtf(frequencies_per_mm: ArrayLike, aperture: float, wavelength_nm: float) -> Array:
    """Return the modulation of a perfect lens with a round pupil; 0 from 2 aperture / wavelength on.

    Parameters
    ----------
    aperture : float
        Numerical aperture on the film, along the direction of the modulation: 1 / (2 f-number).
    """
    if not aperture > 0:
        return np.where(np.asarray(frequencies_per_mm, dtype=np.float64) == 0, 1.0, 0.0)
    share = np.asarray(frequencies_per_mm, dtype=np.float64) * wavelength_nm * 1e-6 / (2.0 * aperture)
    inside = np.minimum(np.abs(share), 1.0)
    return np.asarray(2 / np.pi * (np.arccos(inside) - inside * np.sqrt(1 - inside * inside)))
