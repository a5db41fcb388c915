"""Measures of contrast: a number that grows as a zone gets sharper, and where it is greatest.

Most are quadratic: the mean square of what a few linear filters make of the picture. The noise of a Monte Carlo picture
would add its own square to them. As a probe consists of independent parts, the products of *different* parts take the
place of squares: noise then adds nothing on the average (`energy`), so that a noisy flat wall measures zero.

The luminance is divided by its mean over the zone first and a quadratic surface is taken off, so that exposure,
vignetting and light that falls off smoothly change nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.focusing.probe import ZoneImage

Array = NDArray[np.float64]
Filters = Callable[[Array], list[Array]]


@dataclass(frozen=True)
class Measured:
    """A measure of a zone.

    Attributes
    ----------
    value, error : float
        The measure and its standard error.
    leave_one_out : (parts,) array
        The measure without each of the parts, for errors of what is computed from several measures (jackknife).
    """

    value: float
    error: float
    leave_one_out: Array


def evenly_exposed(image: ZoneImage) -> Array | None:
    """Return the luminance of the parts (count, height, width) over its mean, less a quadratic; None where dark."""
    luminance = image.luminance
    mean = float(luminance.mean())
    if not mean > 0:
        return None
    count, height, width = luminance.shape
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    surface, _ = np.linalg.qr(np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).reshape(-1, 6))
    flat = luminance.reshape(count, -1) / mean
    return np.asarray((flat - flat @ surface @ surface.T).reshape(luminance.shape))


def energy(filters: Filters) -> Callable[[ZoneImage], Measured]:
    """Return the measure that is the mean square of the outputs of filters, free of the square of the noise.

    With r_k what a filter makes of part k, of n: the mean of r_j r_k over all pairs j != k, which is
    (|sum r|^2 - sum |r|^2) / (n (n - 1)).
    """

    def measure(image: ZoneImage) -> Measured:
        parts = evenly_exposed(image)
        count = len(image.parts)
        if parts is None:
            return Measured(0.0, 0.0, np.zeros(count))
        products = np.zeros((count, count))
        for output in filters(parts):
            flat = output.reshape(count, -1)
            products += flat @ flat.T / flat.shape[1]
        return jackknife(count, lambda kept: _mean_of_pairs(products[np.ix_(kept, kept)]))

    return measure


def _mean_of_pairs(products: Array) -> float:
    count = len(products)
    return float((products.sum() - np.trace(products)) / (count * (count - 1)))


def jackknife(count: int, of: Callable[[NDArray[np.int64]], float]) -> Measured:
    """Return a statistic of some parts with its standard error (Tukey 1958).

    Parameters
    ----------
    count
        How many parts there are.
    of
        The statistic of the parts of these indices.
    """
    every = np.arange(count)
    without = np.array([of(np.delete(every, k)) for k in range(count)])
    spread = (count - 1) / count * np.square(without - without.mean()).sum()
    return Measured(of(every), float(np.sqrt(spread)), without)


def _variance(parts: Array) -> list[Array]:
    return [parts - parts.mean(axis=(1, 2), keepdims=True)]


def _tenengrad(parts: Array) -> list[Array]:
    """Sobel's gradient (Tenenbaum 1970, Krotkov 1987)."""
    across = parts[:, :, 2:] - parts[:, :, :-2]
    down = parts[:, 2:] - parts[:, :-2]
    return [
        across[:, :-2] + 2 * across[:, 1:-1] + across[:, 2:],
        down[:, :, :-2] + 2 * down[:, :, 1:-1] + down[:, :, 2:],
    ]


def _brenner(parts: Array) -> list[Array]:
    """Differences two pixels apart (Brenner 1976), here both ways."""
    return [parts[:, :, 2:] - parts[:, :, :-2], parts[:, 2:] - parts[:, :-2]]


def _laplacian(parts: Array) -> list[Array]:
    """Energy of Laplacian (Subbarao 1993), by the nine-point operator."""
    inner = parts[:, 1:-1]
    sides = inner[:, :, :-2] + inner[:, :, 2:] + parts[:, :-2, 1:-1] + parts[:, 2:, 1:-1]
    corners = parts[:, :-2, :-2] + parts[:, :-2, 2:] + parts[:, 2:, :-2] + parts[:, 2:, 2:]
    return [(4 * sides + corners - 20 * inner[:, :, 1:-1]) / 6]


def _wavelet(parts: Array) -> list[Array]:
    """Details of three levels of Haar's wavelet (after Yang and Nelson 2003), without decimation at each level."""
    outputs, smooth = [], parts
    for level in range(3):
        step = 1 << level
        if min(smooth.shape[1:]) <= step:
            break
        low_x, high_x = (smooth[:, :, step:] + sign * smooth[:, :, :-step] for sign in (1, -1))
        outputs += [
            (low_x[:, step:] - low_x[:, :-step]) / 4,
            (high_x[:, step:] + high_x[:, :-step]) / 4,
            (high_x[:, step:] - high_x[:, :-step]) / 4,
        ]
        smooth = (low_x[:, step:] + low_x[:, :-step]) / 4
    return outputs


SPACINGS = (1, 2, 4)  # pixels between the points of a second difference: Nayar and Nakagawa's variable step
BLOCKS = 6  # of the zone each way, whose noise is nearly independent


def sum_modified_laplacian(image: ZoneImage) -> Measured:
    """Return the mean over the zone of the sum-modified Laplacian (Nayar and Nakagawa 1994), without noise.

    ML = |2 I - I_left - I_right| + |2 I - I_up - I_down|, of neighbours a step apart. The step is 1, 2 and 4 pixels, as
    theirs varies with the size of what is to be seen; pixels are averaged over squares of that side, and the three
    are added. Their sum over a window round each pixel is lost in the mean over the zone. Their threshold keeps out
    what noise makes; here the sign of a difference is that of the *other* parts, so that noise adds nothing on the
    average and no threshold is needed. The error is never below that of a zone with nothing but this noise in it.
    """
    parts = evenly_exposed(image)
    count = len(image.parts)
    if parts is None or min(parts.shape[1:]) < 3:
        return Measured(0.0, 0.0, np.zeros(count))
    differences = _second_differences(parts)
    found = jackknife(count, lambda kept: sum(float(_sizes(each[kept]).mean()) for each in differences))
    return replace(found, error=max(found.error, _error_of_noise(differences)))


def _second_differences(parts: Array) -> list[Array]:
    """Return the second differences across and down, at each step that the zone has room for."""
    outputs, smooth, side = [], parts, 1
    for step in SPACINGS:
        while side < step:
            smooth = smooth[:, :, side:] + smooth[:, :, :-side]
            smooth = (smooth[:, side:] + smooth[:, :-side]) / 4
            side *= 2
        if min(smooth.shape[1:]) <= 2 * step:
            break
        outputs += [
            2 * smooth[:, :, step:-step] - smooth[:, :, : -2 * step] - smooth[:, :, 2 * step :],
            2 * smooth[:, step:-step] - smooth[:, : -2 * step] - smooth[:, 2 * step :],
        ]
    return outputs


def _sizes(parts: Array) -> Array:
    """Return the sizes of what parts show (height, width): each times the sign of the sum of the others."""
    return np.asarray((parts * np.sign(parts.sum(axis=0) - parts)).mean(axis=0))


def _error_of_noise(differences: list[Array]) -> float:
    """Return the standard error of the measure where there is nothing but the noise of some parts.

    Combinations of parts in which what they have in common cancels are parts of noise alone. The sizes that they show
    scatter about 0, and so do the sums over blocks of the zone.
    """
    count = len(differences[0])
    apart = np.eye(count) - 1 / count
    apart = np.linalg.qr(apart)[0][:, : count - 1].T  # orthonormal, and 0 for what is common
    squares = []
    for flipped in range(count - 1):
        signs = np.where(np.arange(count - 1) == flipped, -1.0, 1.0)[:, None]
        blocks = sum(_block_means(_sizes(np.tensordot(signs * apart, each, axes=1))) for each in differences)
        squares.append(float(np.square(blocks).sum()))
    return float(np.sqrt(np.mean(squares)))


def _block_means(picture: Array) -> Array:
    """Return the sums over blocks of a picture, over the number of its pixels."""
    rows = np.array_split(picture, BLOCKS)
    return np.array([block.sum() for row in rows for block in np.array_split(row, BLOCKS, axis=1)]) / picture.size


def plain_variance(image: ZoneImage) -> Measured:
    """Return the variance of the luminance as it is, noise and exposure included: what the rptcam paper maximises."""
    luminance = image.luminance
    return jackknife(len(luminance), lambda kept: float(luminance[kept].mean(axis=0).var()))


@dataclass(frozen=True)
class Measure:
    """A measure of contrast.

    Attributes
    ----------
    of : callable
        The measure of a picture of a zone.
    least : float
        Value at which there is too little to focus on.
    """

    of: Callable[[ZoneImage], Measured]
    least: float


ROUNDED = 1e-5  # size of details that the rounding of float32 pictures makes, many times over
LEAST_DETAIL = 5e-5  # mean square of the details relative to the mean: 0.7 %
MEASURES: dict[str, Measure] = {
    "variance": Measure(plain_variance, 0.0),
    "normalised_variance": Measure(energy(_variance), LEAST_DETAIL),
    "tenengrad": Measure(energy(_tenengrad), 8 * LEAST_DETAIL),
    "brenner": Measure(energy(_brenner), LEAST_DETAIL),
    "energy_of_laplacian": Measure(energy(_laplacian), LEAST_DETAIL),
    "sum_modified_laplacian": Measure(sum_modified_laplacian, ROUNDED),
    "wavelet": Measure(energy(_wavelet), LEAST_DETAIL),
}
BEST = "wavelet"  # by benchmarks/focus_measures.py


@dataclass(frozen=True)
class Probe:
    """What the zones show in one focus state, as measures.

    Attributes
    ----------
    place : float
        Coordinate [mm], see `Drive`; rising towards nearer objects.
    stop : float
        Share of the opening's diameter.
    found : list of Measured
        Of each zone.
    reference : float or None
        Coordinate for which the zones are given; None where the film was not scaled with the image.
    scale : float
        Of the image against that place, or else against the lowest one.
    samples : int
        Of all pixels of all zones.
    seconds : float
    """

    place: float
    stop: float
    reference: float | None
    scale: float
    found: list[Measured]
    samples: int
    seconds: float


DETAIL = 1.5  # power of the image scale by which the contrast between pixels falls: 1 to 2 for natural textures
FLOOR = 0.02  # of the greatest measure: smaller ones say no more than that they are small


@dataclass(frozen=True)
class Peak:
    """The top of a curve.

    Attributes
    ----------
    place : float
        Where it is [mm].
    error : float
        Its standard error, from noise.
    width : float
        Distance from it at which the measure is half of its greatest; infinite for a flat curve.
    rise : float
        By how many of its standard errors the greatest measure exceeds the least.
    inside : bool
        Whether the greatest measure has lesser ones on both sides.
    """

    place: float
    error: float
    width: float
    rise: float
    inside: bool


def peak_of(probes: Sequence[Probe], zone: int) -> Peak:
    """Return the top of the curve through some probes at one stop, for one zone.

    A blur of diameter b takes the share 1 / (1 + (b / b0)^2) or so of the contrast of a texture of many scales, and b
    grows evenly with the distance from the focus. So a parabola is laid through the *reciprocal* of the measure, at the
    greatest and its neighbours. The error is that of the jackknife over the parts, which the probes have in common.

    Where the film is scaled with the image, the blur grows evenly on that film with d / scale, d being the distance
    from the place of reference; as the scale is 1 + k d, the parabola is laid over d / (1 + k d). Where it is not, the
    details that pixels see shrink as the image grows.
    """
    probes = sorted(probes, key=lambda probe: probe.place)
    scale = np.array([probe.scale for probe in probes])
    is_scaled = probes[0].reference is not None
    origin = probes[0].reference or 0.0
    away = np.array([probe.place for probe in probes]) - origin
    growth = _growth(away, scale) if is_scaled else 0.0
    places = away / (1 + growth * away)
    gain = np.ones_like(scale) if is_scaled else scale**DETAIL
    values = gain * [probe.found[zone].value for probe in probes]
    without = gain[:, None] * [probe.found[zone].leave_one_out for probe in probes]
    top = int(values.argmax())
    inside = 0 < top < len(probes) - 1
    three = np.arange(max(min(top - 1, len(probes) - 3), 0), min(max(top + 2, 3), len(probes)))
    place, width = _vertex(places[three], values[three])
    others = np.array([_vertex(places[three], values)[0] for values in without[three].T])
    error = _spread(others)
    bottom = int(values.argmin())
    difference = _spread(without[top] - without[bottom])
    rise = float((values[top] - values[bottom]) / difference) if difference > 0 else np.inf
    unscaled = 1 - growth * place
    return Peak(
        origin + place / unscaled, error / unscaled**2, width, rise if values[top] > values[bottom] else 0.0, inside
    )


def _growth(away: Array, scale: Array) -> float:
    """Return by how much the scale grows with the distance from the place of reference [1/mm]."""
    farthest = int(np.abs(away).argmax())
    return float((scale[farthest] - 1) / away[farthest]) if away[farthest] else 0.0


def _spread(without: Array) -> float:
    """Return the standard error of a statistic from its values without each of the parts."""
    count = len(without)
    return float(np.sqrt((count - 1) / count * np.square(without - without.mean()).sum()))


def _vertex(places: Array, values: Array) -> tuple[float, float]:
    """Return where the reciprocal of three values is least, not beyond the places, and the half width there."""
    top = int(values.argmax())
    if len(places) < 3 or not values[top] > 0:
        return float(places[top]), np.inf
    middle, reach = places[top], float(np.ptp(places))
    reciprocal = values[top] / np.maximum(values, FLOOR * values[top])
    a, b, c = np.linalg.solve(np.vander((places - middle) / reach, 3), reciprocal)
    if not a > 0:
        return float(middle), np.inf
    at = float(np.clip(middle - reach * b / (2 * a), places.min(), places.max()))
    least = max(c - b * b / (4 * a), 1e-6)
    return at, reach * float(np.sqrt(least / a))
