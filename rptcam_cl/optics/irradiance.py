"""Light on the film: irradiance under a uniform world by quadrature over the exit pupil, glare, the image circle."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import plain
from rptcam_cl.core.remember import remember
from rptcam_cl.optics import film_probe
from rptcam_cl.optics.beams import Beam, chebyshev_nodes, geometry_but_stop
from rptcam_cl.optics.ghosts import Lit, Tree, check_lens
from rptcam_cl.optics.lens import Lens, brought_to_focus, exchange_axes, limiting_surface
from rptcam_cl.optics.ray_trace import COATED, IDEAL, LensTransmission, axial_transmittance, trace_crossings

#
# Irradiance of the film under a uniform world of unit radiance, by deterministic quadrature over the exit pupil.
#
# E = integral over the passing rays of cos(theta) dOmega = integral of D^2 / (D^2 + rho^2)^2 dA over the plane of the
# last vertex, D being its distance to the film and rho the sideways distance from the film point (Kolb 1995, sec.
# 3.3).

Array = NDArray[np.float64]

GRID = (40, 40)
_DENSE_GRID = (200, 200)  # finds the slivers of pupil that remain near the edge of the image circle
AZIMUTHS, MOST_AZIMUTHS = 256, 4096
STAYS = 0.005  # share of an integral by which half of its azimuths may differ from all
STEPS = 48
WIDENED = 6  # times that a box grows where it cut a pupil off
_MANY_STEPS = 1024  # along an azimuth, where the pupil has parts besides the main one
_STRAYS = 4096  # rays of a film point over the whole rear window, in search of such parts
LEAST_SHARE = 1e-7  # of the window's radius, from which a pupil on the axis is found
BISECTIONS = 24
_AXIAL_ROUNDS = 3  # each finds the rim of the pupil 128 times as exactly
_BUNDLE = 128  # rays, up to which tracing more takes no longer
NEAR = 0.04  # share of a pupil's radius within which that of another wavelength is sought
_LOSS_RAYS = 4096  # of a film point, that say how much of its light is lost
_GOLDEN_TURN = np.pi * (3 - np.sqrt(5))


def film_irradiance(
    lens: Lens,
    film_distance_mm: float,
    radii_mm: ArrayLike,
    wavelength_nm: float = LINE_D_NM,
    azimuth_degrees: float = 0.0,
    transmission: LensTransmission = IDEAL,
) -> Array:
    """Return the irradiance at film points for unit radiance [W/m2 per W/m2/sr], one for each radius.

    Parameters
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    radii_mm : float or array
        Distances of the film points from the axis.
    wavelength_nm : float
    azimuth_degrees : float
        Direction of the film points from the axis, from +x towards +y; matters for lenses without rotational symmetry.
    transmission : LensTransmission
        Losses in the lens; none by default.

    Notes
    -----
    Relative accuracy about 1e-4 for pupils without thin parts, and 6e-4 at 0.99 of the image circle: 256 azimuths about
    the centre of the pupil, more where half of them disagree with all by 5e-3; along each the ends of every passing
    stretch are found by bisection, and Gauss-Legendre quadrature integrates up to them. `irradiance_with_error` says
    how much half of the rays would change.
    """
    return irradiance_with_error(lens, film_distance_mm, radii_mm, wavelength_nm, azimuth_degrees, transmission)[0]


def irradiance_with_error(
    lens: Lens,
    film_distance_mm: float,
    radii_mm: ArrayLike,
    wavelength_nm: float = LINE_D_NM,
    azimuth_degrees: float = 0.0,
    transmission: LensTransmission = IDEAL,
) -> tuple[Array, Array]:
    """Return `film_irradiance`, and by how much each value would change with half as many rays."""
    probe = film_probe.FilmProbe(lens, film_distance_mm, wavelength_nm)
    radii = np.asarray(radii_mm, dtype=np.float64)
    angle = np.radians(azimuth_degrees)
    film = radii.reshape(-1, 1) * np.array([np.cos(angle), np.sin(angle)])
    boxes, lit, parted = _pupil_boxes(probe, film)
    values = np.zeros((len(film), 2))
    for k in np.flatnonzero(lit):
        values[k] = _integrate(probe, film[k], boxes[k], azimuths=AZIMUTHS, parted=bool(parted[k]))
        if transmission:
            share, error = _mean_transmittance(probe, film[k], boxes[k], transmission)
            values[k] = values[k, 0] * share, values[k, 1] * share + values[k, 0] * error
    # Radiance over the squared index is what a ray keeps, so a film in water or in an eye receives more.
    indices = lens.indices(wavelength_nm)
    irradiance, errors = values.T.reshape(2, *radii.shape) * float(indices[-1] / indices[0]) ** 2
    return irradiance, errors


def pass_areas(lens: Lens, film_distance_mm: float, radii_mm: Array, wavelength_nm: float = LINE_D_NM) -> Array:
    """Return the area of the plane of the last vertex through which light reaches film points (n,) [mm2].

    Found as `film_irradiance` finds its integral, at distances from the axis along x.
    """
    probe = film_probe.FilmProbe(lens, film_distance_mm, wavelength_nm)
    film = np.stack([radii_mm, np.zeros_like(radii_mm)], axis=1)
    pupils = zip(film, *_pupil_boxes(probe, film), strict=True)
    return np.array([
        _integrate(probe, point, box, azimuths=AZIMUTHS, parted=bool(parted), of_area=True)[0] if lit else 0.0
        for point, box, lit, parted in pupils
    ])  # fmt: skip


def on_axis_irradiance(
    lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM, transmission: LensTransmission = IDEAL
) -> float:
    """Return the irradiance of the centre of the film for unit radiance, perhaps with losses in the lens.

    Raises
    ------
    InputError
        When no ray from the centre of the film comes through the lens.
    """
    value = float(film_irradiance(lens, film_distance_mm, 0.0, wavelength_nm, transmission=transmission))
    if value == 0:
        raise InputError(f"{lens.name}: no light reaches the centre of a film {film_distance_mm:g} mm behind the lens")
    return value


def axial_irradiance(
    lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM, near: float | None = None
) -> float | None:
    """Return `on_axis_irradiance` without losses, within 2e-5 in a quarter of its time; None where it cannot.

    A round pupil without a hole, seen from the axis, is a disk: rays find its rim, and the integral over it is known.

    Parameters
    ----------
    near
        That of another wavelength: the rim is sought about where it is there, with a third of the rays, and the result
        is within 7e-4. None where it is not there.
    """
    probe, film, rounds = film_probe.FilmProbe(lens, film_distance_mm, wavelength_nm), np.zeros(2), _AXIAL_ROUNDS
    if not _is_alike(probe, film) or (near is not None and lens.is_obstructed):
        return None
    indices = lens.indices(wavelength_nm)
    low, high, bend = 0.0, float(probe.windows(film[None])[0, 1]), np.pi * float(indices[-1] / indices[0]) ** 2
    if near is not None:
        middle, rounds = film_distance_mm * np.sqrt(near / max(bend - near, 1e-300)), 1
        low, high = (1.0 - NEAR) * middle, min((1.0 + NEAR) * middle, high)
    for _ in range(rounds):
        radii = np.linspace(low, high, _BUNDLE + 1)
        hits = probe.passes(film, np.stack([radii, np.zeros(len(radii))], axis=1))
        last = int(np.count_nonzero(hits)) - 1
        if last < 1 or not hits[: last + 1].all() or (near is not None and last == _BUNDLE):
            return None
        low, high = radii[last], radii[min(last + 1, _BUNDLE)]
    square = ((low + high) / 2) ** 2
    return float(bend * square / (film_distance_mm**2 + square))


def _pupil_boxes(probe: film_probe.FilmProbe, film: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return a box round the passing rays of each film point, which film points have any, and which in several parts.

    A pupil that slips through the grids is sought from wider stops down, and round its first-order image; one on the
    axis of a round lens by rays at all distances from it. Rays spread over the whole window find what lies apart.
    """
    boxes, is_lit = film_probe.narrow_boxes(probe, film, probe.windows(film), GRID)
    dark = np.flatnonzero(~is_lit)
    for k in dark:
        boxes[k : k + 1], is_lit[k : k + 1] = film_probe.narrow_boxes(
            probe, film[k : k + 1], probe.windows(film[k : k + 1]), _DENSE_GRID
        )
    dark = np.flatnonzero(~is_lit)
    if len(dark):
        probes = film_probe.narrowing_probes(probe.lens, probe.distance, probe.wavelength_nm)
        boxes[dark], is_lit[dark] = film_probe.pupil_boxes(probes, film[dark])
    lit = np.flatnonzero(is_lit)
    if len(lit):
        boxes[lit], _ = film_probe.narrow_boxes(probe, film[lit], boxes[lit], GRID)
    for _ in range(WIDENED if len(lit) else 0):  # the tips of a sliver may lie between the rays of a coarse grid
        low, high = boxes[lit][:, ::2], boxes[lit][:, 1::2]
        around = np.stack([low - (high - low) / 2, high + (high - low) / 2], axis=2).reshape(-1, 4)
        beyond, still = film_probe.narrow_boxes(probe, film[lit], around, GRID)
        cell = 2 * (high - low) / GRID
        grown = still & np.any((beyond[:, ::2] < low - cell) | (beyond[:, 1::2] > high + cell), axis=1)
        boxes[lit[grown]] = beyond[grown]
        lit = lit[grown]
        if not len(lit):
            break
    parted = np.zeros(len(film), dtype=bool)
    for i, point in enumerate(film):
        wider = _axial_box(probe) if _is_alike(probe, point) else _with_strays(probe, point, boxes[i], bool(is_lit[i]))
        if wider is not None:
            boxes[i], is_lit[i], parted[i] = wider, True, True
    return boxes, is_lit, parted


def _is_alike(probe: film_probe.FilmProbe, film: Array) -> bool:
    """Return whether all azimuths are alike: on the axis of a rotationally symmetric lens."""
    stop = probe.lens.stop
    return not film.any() and probe.lens.is_rotational and (stop is None or stop.stop_shape is None)


def _axial_radii(reach: float) -> Array:
    """Return distances from the axis, evenly and by their logarithms, at which parts of a pupil are sought."""
    even = np.linspace(0.0, reach, _MANY_STEPS).tolist()
    logarithmic = np.geomspace(LEAST_SHARE * reach, reach, _MANY_STEPS).tolist()
    return np.array(sorted({*even, *logarithmic}))


def _axial_box(probe: film_probe.FilmProbe) -> Array | None:
    """Return a box round all rays that pass from the centre of the film; None when a single part holds them all."""
    film = np.zeros(2)
    radii = _axial_radii(float(probe.windows(film[None])[0, 1]))
    hits = probe.passes(film, np.stack([radii, np.zeros(len(radii))], axis=1))
    if not hits.any():
        return None
    last = int(np.flatnonzero(hits)[-1])
    if hits[: last + 1].all() and radii[last] > radii[-1] / _DENSE_GRID[0]:
        return None
    outermost = radii[min(last + 1, len(radii) - 1)]
    return np.asarray(outermost * np.array([-1.0, 1.0, -1.0, 1.0]), dtype=np.float64)


def _with_strays(probe: film_probe.FilmProbe, film: Array, box: Array, lit: bool) -> Array | None:
    """Return a box that holds the rays outside of a box as well; None when there are none."""
    window = probe.windows(film[None])
    points, hits = film_probe.spread_points(window, _STRAYS)[0], np.zeros(_STRAYS, dtype=bool)
    apart = np.any((points < box[::2]) | (points > box[1::2]), axis=1) if lit else np.ones(_STRAYS, dtype=bool)
    hits[apart] = probe.passes(film, points[apart])
    if not hits.any():
        return None
    margin = (window[0, 1::2] - window[0, ::2]) / np.sqrt(_STRAYS)
    low, high = points[hits].min(axis=0) - margin, points[hits].max(axis=0) + margin
    if lit:
        low, high = np.minimum(low, box[::2]), np.maximum(high, box[1::2])
    return np.array([low[0], high[0], low[1], high[1]])


def _integrate(
    probe: film_probe.FilmProbe,
    film: Array,
    box: Array,
    *,
    azimuths: int,
    parted: bool = False,
    of_area: bool = False,
) -> tuple[float, float]:
    """Return the integral for the irradiance of a film point over what passes, or the area of that [mm2].

    With it comes by how much it would change with half as many azimuths, 0 where all azimuths are alike.
    """
    centre = np.array([box[0] + box[1], box[2] + box[3]]) / 2
    reach = np.hypot(box[1] - box[0], box[3] - box[2]) / 2
    steps = np.linspace(0.0, reach, _MANY_STEPS if parted else STEPS)
    if _is_alike(probe, film):
        centre, azimuths = film, 1
        if parted:
            steps = _axial_radii(reach)
    angles = (np.arange(azimuths) + 0.5) * 2 * np.pi / azimuths
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    hits = probe.passes(film, centre + rays[:, None] * steps[:, None])
    hits[:, -1] = False
    change = np.diff(hits.astype(np.int8), axis=1)
    if not parted and np.any(np.count_nonzero(change, axis=1) > 1):  # a thin part may lie between the steps elsewhere
        return _integrate(probe, film, box, parted=True, of_area=of_area, azimuths=azimuths)
    ray, step = np.nonzero(change)
    ends = _bisect(probe, film, centre, rays[ray], steps[step], steps[step + 1], hits[ray, step])
    sign = np.where(change[ray, step] > 0, -1.0, 1.0)
    # Each end adds or takes away the integral from the centre to it, so stretches need no pairing.
    nodes, weights = np.polynomial.legendre.leggauss(10)
    s = ends[:, None] * (nodes + 1) / 2
    at = centre + rays[ray][:, None] * s[..., None]
    square = np.sum((at - film) ** 2, axis=-1)
    density = np.ones_like(s) if of_area else (probe.distance / (probe.distance**2 + square)) ** 2
    inner = sign * np.sum(weights * s * density, axis=1) * ends / 2
    total = float(np.sum(inner))
    # Of every four azimuths the two outer ones, and not every other one: half of the rays that is a mirror image of the
    # other half, as it is for a round lens, would always agree with it.
    half = float(np.sum(inner[(ray + 1) % 4 < 2]))
    error = abs(total - 2 * half) if azimuths > 1 else 0.0
    if azimuths < MOST_AZIMUTHS and error > STAYS * abs(total):
        return _integrate(probe, film, box, parted=parted, of_area=of_area, azimuths=2 * azimuths)
    return total * 2 * np.pi / azimuths, error * 2 * np.pi / azimuths


def _mean_transmittance(
    probe: film_probe.FilmProbe, film: Array, box: Array, transmission: LensTransmission
) -> tuple[float, float]:
    """Return the share of the light that the lens leaves to a film point, by a spiral of rays through its pupil.

    Within 1e-4: each ray stands for an equal area, and their ends lie at all distances from the centre (Vogel 1979).
    With it comes by how much it would change with every other ray.
    """
    centre, reach = box.reshape(2, 2).mean(axis=1), np.hypot(box[1] - box[0], box[3] - box[2]) / 2
    number = np.arange(_LOSS_RAYS)
    radii = reach * np.sqrt((number + 0.5) / _LOSS_RAYS)
    points = centre + radii[:, None] * np.stack([np.cos(number * _GOLDEN_TURN), np.sin(number * _GOLDEN_TURN)], axis=1)
    origin = np.array([*film, probe.lens.film_z(probe.distance)])
    across = points - film
    directions = np.column_stack([across, np.full(len(points), -probe.lens.sense * probe.distance)])
    rays = probe.lens.trace(origin[None], directions, probe.wavelength_nm, transmission=transmission)
    assert rays.transmittance is not None
    weights = rays.passed / (probe.distance**2 + np.sum(across**2, axis=1)) ** 2
    if not weights.any():  # a sliver between the rays
        return float(axial_transmittance(probe.lens, probe.wavelength_nm, transmission)), 0.0
    share, half = (
        float(weights[::step] @ rays.transmittance[::step] / (weights[::step].sum() or 1.0)) for step in (1, 2)
    )
    return share, abs(share - half)


def _bisect(
    probe: film_probe.FilmProbe,
    film: Array,
    centre: Array,
    rays: Array,
    low: Array,
    high: Array,
    low_passes: NDArray[np.bool_],
) -> Array:
    """Return where, between two distances from the centre, rays begin or cease to pass."""
    left = BISECTIONS
    while left:
        # All middles that the next few bisections may come to are traced together where the bundle is small.
        depth = min(left, max(int(np.log2(_BUNDLE / max(len(low), 1))), 1))
        places = np.stack([low, high], axis=1)
        for _ in range(depth):
            finer = np.empty((len(places), 2 * places.shape[1] - 1))
            finer[:, ::2], finer[:, 1::2] = places, (places[:, :-1] + places[:, 1:]) / 2
            places = finer
        same = probe.passes(film, centre + rays[:, None] * places[..., None]) == low_passes[:, None]
        each, first = np.arange(len(places)), np.zeros(len(places), np.int64)
        for level in range(depth - 1, -1, -1):
            first += np.where(same[each, first + 2**level], 2**level, 0)
        low, high = places[each, first], places[each, first + 1]
        left -= depth
    return (low + high) / 2


#
# Irradiance of the middle of the film through a round pupil, without tracing anew in each state of film and stop.
#
# Where rays from the axis of the film cross each surface is kept as polynomials in the distance of the film and in
# the height of the ray. They say which rim stops rays first, and at which height: the pupil is a disk of that radius.

FILM_NODES = 6  # in a cell of film distances
_HEIGHT_NODES = (16, 32)  # of a beam, where the first are too few
EXACT = 1e-12  # share of a quantity that its last polynomials may have
_CELLS_OF_DISTANCE = 16  # while it doubles
_STEPS_OF_HEIGHT = 8  # widths of beams while they double
WIDER = 8  # steps by which a beam may have to be wider than first-order optics says
PLACES = 65  # at which a search begins
ROUNDS = 4  # of Newton's method
REMEMBERED = 128  # lenses whose beams are kept


def disk_irradiance(lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM) -> float | None:
    """Return `on_axis_irradiance` without losses for a lens of whose pupil nothing lies apart.

    None where the lens is not round, has mirrors, a hole or a shaped stop, or its rays are too bent for polynomials.
    """
    shaped = lens.stop is not None and lens.stop.stop_shape is not None
    if shaped or lens.has_mirrors or lens.is_obstructed or not lens.is_rotational:
        return None
    stop, pupil = limiting_surface(lens, wavelength_nm), lens.first_order(wavelength_nm).exit_pupil
    away = film_distance_mm - pupil.distance_mm
    if not (math.isfinite(away) and away != 0):
        return None
    height = abs(pupil.diameter_mm / 2 * film_distance_mm / away)
    cell = math.floor(_CELLS_OF_DISTANCE * math.log2(film_distance_mm))
    step = math.ceil(_STEPS_OF_HEIGHT * math.log2(height))
    beams = _beams_of(lens, stop, wavelength_nm)
    for width in range(step, step + WIDER):
        if (cell, width) not in beams:
            beams[cell, width] = _trace_beam(lens, wavelength_nm, cell, 2.0 ** (width / _STEPS_OF_HEIGHT))
        beam = beams[cell, width]
        if beam is None:
            return None
        if (square := beam.square_of_pupil(lens, film_distance_mm)) is not None:
            indices = lens.indices(wavelength_nm)
            return float(math.pi * square / (film_distance_mm**2 + square) * (indices[-1] / indices[0]) ** 2)
    return None


@remember(most=REMEMBERED, by=geometry_but_stop)
def _beams_of(lens: Lens, stop: int, wavelength_nm: float) -> dict[tuple[int, int], _AxialRays | None]:
    """Return where beams are kept, by their cells and widths: all states of the film and of the stop share them."""
    return {}


def _trace_beam(lens: Lens, wavelength_nm: float, cell: int, height: float) -> _AxialRays | None:
    """Return the beam of a cell; None where a ray is lost or polynomials of so low a degree leave errors."""
    ends = 2.0 ** (cell / _CELLS_OF_DISTANCE), 2.0 ** ((cell + 1) / _CELLS_OF_DISTANCE)
    order = range(len(lens.surfaces) - 1, -1, -1)
    at_film, to_film = chebyshev_nodes(FILM_NODES)
    distances = np.mean(ends) + np.ptp(ends) / 2 * at_film
    for count in _HEIGHT_NODES:
        at_height, to_height = chebyshev_nodes(count)
        heights = height * np.sqrt((1.0 + at_height) / 2)
        far, across = (values.ravel() for values in np.meshgrid(distances, heights, indexing="ij"))
        p, d = np.zeros((3, len(far))), np.stack([across, np.zeros(len(far)), -far])
        p[2] = lens.length + far
        crossings, _, _ = trace_crossings(lens, order, p, d / np.hypot(across, far), wavelength_nm)
        values = (crossings[..., 0] / across).T.reshape(FILM_NODES, count, -1)
        if not np.isfinite(values).all():
            return None
        polynomials = to_height @ np.tensordot(to_film, values, 1)
        if np.all(np.abs(polynomials[:, -2:]) <= EXACT * np.abs(values).max(axis=(0, 1))):
            return _AxialRays(height, (float(ends[0]), float(ends[1])), polynomials)
    return None


@dataclass(frozen=True, eq=False)
class _AxialRays:
    """Rays from the axis of the film.

    Attributes
    ----------
    height : float
        On the plane of the last vertex, up to which they go [mm].
    distances : (float, float)
        Of the film, between which they begin [mm].
    polynomials : (distances, heights, surfaces) array
        Of the distance of the film and the square of the height: where rays cross each surface, over the height.
    """

    height: float
    distances: tuple[float, float]
    polynomials: Array

    @cached_property
    def _begin(self) -> tuple[Array, Array]:
        """Heights, and their Chebyshev polynomials."""
        heights = np.linspace(0.0, self.height, PLACES)
        angles = np.arccos(np.clip(2 * (heights / self.height) ** 2 - 1, -1.0, 1.0))
        return heights, np.cos(np.outer(angles, np.arange(self.polynomials.shape[1])))

    def _terms(self, height: float) -> tuple[Array, Array]:
        """Return the Chebyshev polynomials at a height, and those that their derivatives go by."""
        degrees = np.arange(self.polynomials.shape[1])
        x = 2 * (height / self.height) ** 2 - 1
        angle = math.acos(min(max(x, -1.0), 1.0))
        slopes = degrees * np.sin(degrees * angle) / max(math.sin(angle), 1e-12)
        return np.cos(degrees * angle), slopes * (4 * height / self.height**2)

    def square_of_pupil(self, lens: Lens, film_distance_mm: float) -> float | None:
        """Return the square of the radius of the pupil [mm2]; None where no rim stops rays within the beam."""
        low, high = self.distances
        x = (2 * film_distance_mm - low - high) / (high - low)
        here = np.tensordot(np.cos(np.arange(FILM_NODES) * math.acos(min(max(x, -1.0), 1.0))), self.polynomials, 1)
        heights, terms = self._begin
        rims = np.array([surface.semi_diameter for surface in lens.surfaces])
        beyond = np.abs(heights[:, None] * (terms @ here)) > rims
        rows = beyond.any(axis=1)
        first = int(np.argmax(rows))
        if first == 0:
            return None
        radii = [
            self._meeting(here[:, k], float(rims[k]), float(heights[first])) for k in np.flatnonzero(beyond[first])
        ]
        return min(radii) ** 2

    def _meeting(self, polynomial: Array, rim: float, height: float) -> float:
        """Return the height of the ray that meets a rim, sought from one near it."""
        for _ in range(ROUNDS):
            terms, slopes = self._terms(height)
            scale = float(terms @ polynomial)
            off = height * scale - math.copysign(rim, scale)
            height -= off / (scale + height * float(slopes @ polynomial))
        return height


#
# Veiling glare: light that an even, bright surrounding sends to a black spot in the middle of the film.
#
# Light may be followed either way. A diffuse point of the film shines backwards through the lens: what leaves towards
# the scene straight is what would form the image there, what leaves after two reflections is the veil; what comes
# back to the film, and what rims behind the stop catch, is light that a film or a barrel that is not black would add.

GLARE_RAYS = 12_000  # over the rear surface
_SKY_MM = 1e5  # from the front to a plane that all light towards the scene meets


@dataclass(frozen=True)
class Glare:
    """Veiling glare in the middle of the film, in parts of the irradiance of a white film.

    Attributes
    ----------
    surfaces : float
        By two reflections between surfaces of the lens.
    film, barrel : float
        By light that the film scatters to the lens and back, and that rims behind the stop scatter.
    index : float
        Veiling glare index of ISO 9358: irradiance of the black spot over that of the white around it.
    """

    surfaces: float
    film: float
    barrel: float
    index: float


def veiling_glare(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: float = 550.0,
    transmission: LensTransmission = COATED,
    *,
    film_reflectance: float = 0.0,
    barrel_reflectance: float = 0.0,
    rays: int = GLARE_RAYS,
) -> Glare:
    """Return the veiling glare of a lens under a hemisphere of even light.

    Parameters
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    wavelength_nm : float
    transmission : LensTransmission
    film_reflectance : float
        Share of the light that the film scatters evenly. The whole plane of the film counts as lit.
    barrel_reflectance : float
        Share that rims behind the stop scatter evenly. They count as lit like the film.
    rays : int
        Over the rear surface.

    Raises
    ------
    InputError
        For a lens that has mirrors, is not round, or whose last surface has no rim; and for shares outside of 0 to 1.
    """
    for name, share in (("film", film_reflectance), ("barrel", barrel_reflectance)):
        if not 0 <= share < 1:
            raise InputError(f"the {name} reflects a share from 0 to below 1 (got {share:g})")
    check_lens(lens)
    point = Beam(0.0, film_distance_mm, is_diffuse=True)
    tree = Tree(Lit(_reversed_lens(lens), _SKY_MM, point, wavelength_nm, (np.inf, np.inf), transmission), 2, rays)
    account, image = tree.account, tree.account.image
    if not image > 0:
        raise InputError(f"{lens.name}: no light reaches the middle of the film")
    stop = lens.stop_index if lens.stop_index is not None else 0
    behind = len(lens.surfaces) - 1 - stop
    caught = sum(light for k, light in tree.blocked.items() if k < behind)
    parts = account.ghosts / image, film_reflectance * account.out / np.pi, barrel_reflectance * caught / np.pi
    veil = sum(parts)
    return Glare(*parts, veil / (1.0 + veil))


def _reversed_lens(lens: Lens) -> Lens:
    """Return a lens that light passes from its film side.

    Raises
    ------
    InputError
        When a surface is a mirror, not round, or of a kind that is not known turned round.
    """
    if lens.phases or any(s.is_mirror or s.form is not None or not s.is_rotational for s in lens.surfaces):
        raise InputError(f"{lens.name}: glare is known of lenses with round surfaces of powers of r, without mirrors")
    media = lens.media
    surfaces = [
        replace(
            surface, curvature=-surface.curvature, aspheric=tuple((power, -value) for power, value in surface.aspheric),
            glass=media[k], thickness=lens.surfaces[k - 1].thickness if k else 0.0,
        )
        for k, surface in reversed(list(enumerate(lens.surfaces)))
    ]  # fmt: skip
    stop = None if lens.stop_index is None else len(surfaces) - 1 - lens.stop_index
    return lens.of_surfaces(surfaces, stop, object_medium=media[-1])


# What a lens does in one state: the numbers of `lens info`, image circle, field of view and T-number.

_LARGEST_FIELD = 8.0  # image circles are searched up to this many focal lengths from the axis
_HALF_STEPS, _HALF_NODES, _HALF_RAYS = 7, 33, (72, 72)
INSIDE = 0.997  # of the image circle, where more than a sliver of the pupil is left
QUICK = (40, 40)
FAN = (4096, 1)
_BESIDE_AXIS = np.geomspace(5e-4, 1.0, 64)  # of that, where light is sought if none reaches the axis
SEARCH = (160, 160)
_CRESCENTS, _CRESCENT_STEP = (640, 320), 0.02


def lens_info(
    lens: Lens,
    f_number: float | None = None,
    object_distance_mm: float = np.inf,
    wavelength_nm: float = LINE_D_NM,
    transmission: LensTransmission = IDEAL,
) -> dict[str, Any]:
    """Return first-order data and working state as plain values, for JSON; None where there is no such number.

    Of a lens that is not alike from every azimuth they are those of its y-z section, the image circle among them.

    Parameters
    ----------
    lens : Lens
    f_number : float, optional
        Closes the stop; by default it is as in the file.
    object_distance_mm : float
        From the film to the object plane.
    wavelength_nm : float
    transmission : LensTransmission
        Losses that the T-number counts.
    """
    if f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number, wavelength_nm))
    film: float | None
    try:
        lens, film = brought_to_focus(lens, object_distance_mm, wavelength_nm)
    except InputError:
        if np.isfinite(object_distance_mm):
            raise
        film = None
    result = lens.first_order(wavelength_nm).as_dict()
    result |= {"name": lens.name, "source": lens.source, "warnings": list(lens.warnings)}
    result["stop_diameter_mm"] = None if lens.stop is None else 2 * lens.stop.semi_diameter
    result["film_distance_mm"] = film
    result["axial_transmittance"] = float(axial_transmittance(lens, wavelength_nm, transmission))
    for key in ("working_f_number", "t_number", "half_light_circle_mm", "image_circle_mm", "field_of_view_degrees"):
        result[key] = None
    if film is not None:
        result["working_f_number"] = working_f_number(lens, film, wavelength_nm)
        result["t_number"] = t_number(lens, film, wavelength_nm, transmission)
        along_y = exchange_axes(lens)  # as first-order data are
        circle = image_circle(along_y, film, wavelength_nm)
        result["half_light_circle_mm"] = 2 * _half_light_radius(along_y, film, circle, wavelength_nm)
        if circle < farthest(lens, film, wavelength_nm):  # else nothing in the lens ends its picture
            result["image_circle_mm"] = 2 * circle
            result["field_of_view_degrees"] = field_of_view(along_y, film, circle * INSIDE, wavelength_nm)
    return dict(plain(result, json=True))


def working_f_number(lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return 1 / (2 n' sin theta') of the axial beam at the film, by first order for the size of the exit pupil."""
    data = lens.first_order(wavelength_nm)
    away = film_distance_mm - data.exit_pupil.distance_mm
    index = float(lens.indices(wavelength_nm)[-1])
    if not np.isfinite(away):
        return data.f_number / index
    return float(abs(away) / (index * data.exit_pupil.diameter_mm))


def t_number(
    lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM, transmission: LensTransmission = IDEAL
) -> float:
    """Return the f-number of an ideal lens that would give the centre of the film the same light: E = pi / (4 T^2)."""
    return float(np.sqrt(np.pi / (4.0 * on_axis_irradiance(lens, film_distance_mm, wavelength_nm, transmission))))


@remember(most=16)
def image_circle(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: float = LINE_D_NM,
    *,
    between_mm: tuple[float, float] | None = None,
) -> float:
    """Return the film radius [mm] beyond which no ray arrives along +x, within 0.05 %; 0 where none arrives at all.

    It is searched up to eight focal lengths from the axis; a lens that lights more has that radius.

    Parameters
    ----------
    between_mm
        A radius that is known to have light, and one beyond which the circle does not matter: if that has light, the
        result is just beyond it.
    """
    probe = film_probe.FilmProbe(lens, film_distance_mm, wavelength_nm)
    limit = farthest(lens, film_distance_mm, wavelength_nm)

    def lit(radius: float) -> bool:
        # What is left near the edge is a sliver across the plane of film point and axis, too thin for a grid.
        film = np.array([[radius, 0.0]])
        return any(film_probe.narrow_boxes(probe, film, probe.windows(film), shape)[1][0] for shape in (FAN, SEARCH))

    radii, low, high = limit * np.geomspace(0.02, 1.0, 24), 0.0, 0.0
    if between_mm is None:
        beside = limit * _BESIDE_AXIS if not lit(0.0) else ()  # of a ring that the middle of a mirror lens leaves dark
        low = next((float(radius) for radius in beside if lit(float(radius))), 0.0)
        radii = radii[radii > low] if low > 0 or not len(beside) else radii[:0]
    else:
        low, enough = between_mm
        if lit(enough):
            return float(np.nextafter(enough, np.inf))
        radii = np.append(radii[(radii > low) & (radii < enough)], enough)
    for radius in radii:
        if not lit(float(radius)):
            high = float(radius)
            break
        low = float(radius)
    else:
        return low
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if lit(middle) else (low, middle)
    return _end_of_crescents(probe, low) if lens.is_obstructed and low > 0 else low


def _end_of_crescents(probe: film_probe.FilmProbe, radius: float) -> float:
    """Return how far [mm] from a radius with light the ends of a cut ring reach, which slip through a wide grid."""
    film, step = np.array([[radius, 0.0]]), np.array([_CRESCENT_STEP * radius, 0.0])
    box = film_probe.narrow_boxes(
        probe, film, film_probe.upper(probe.windows(film), probe.lens.is_rotational), _CRESCENTS
    )[0][0]
    while step[0] > 2e-5 * radius:
        there, hit = film_probe.box_near(probe, film + step, box, radial=False, shape=SEARCH)
        if hit:
            film, box, step = film + step, there, 2 * step
        else:
            step /= 2
    return float(film[0, 0])


def farthest(lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the film radius [mm] up to which image circles are searched."""
    length = abs(lens.first_order(wavelength_nm).focal_length_mm)
    return _LARGEST_FIELD * (length if np.isfinite(length) else film_distance_mm)


def _half_light_radius(
    lens: Lens, film_distance_mm: float, circle_mm: float, wavelength_nm: float = LINE_D_NM
) -> float:
    """Return the least film radius [mm] along +x with half the irradiance of the axis, within 1 %.

    Parameters
    ----------
    circle_mm : float
        Radius of the image circle, which is the result where there is more light to its edge.
    """

    probes = film_probe.narrowing_probes(lens, film_distance_mm, wavelength_nm)
    nodes = np.linspace(0.0, circle_mm, _HALF_NODES)
    node_boxes, _ = film_probe.pupil_boxes(probes, np.column_stack([nodes, np.zeros(_HALF_NODES)]), in_order=True)

    def light(radius: float) -> float:  # D^2 / (D^2 + rho^2)^2 over what passes of a plane through the last vertex
        film = np.array([[radius, 0.0]])
        near, _ = film_probe.box_near(probes[-1], film, node_boxes[np.abs(nodes - radius).argmin()], radial=False)
        boxes, lit = film_probe.narrow_boxes(probes[-1], film, near[None], _HALF_RAYS)
        points = film_probe.grid(boxes, *_HALF_RAYS)[0]
        targets = np.column_stack([points, np.full(len(points), lens.length)])
        start = np.array([radius, 0.0, lens.film_z(film_distance_mm)])
        passed = lens.trace(np.broadcast_to(start, targets.shape), targets - start, wavelength_nm).passed
        square = np.sum((targets - start) ** 2, axis=1)
        sides = np.ptp(points, axis=0) / (np.array(_HALF_RAYS) - 1)
        return float(lit[0] * np.prod(sides) * np.sum(passed / square**2))

    def share(radius: float) -> float:
        return light(radius) / on_axis

    on_axis = light(0.0)
    low, more = 0.0, 0.5  # light above the half
    for radius in circle_mm * np.geomspace(0.05, 1.0, _HALF_STEPS):
        if (excess := share(float(radius)) - 0.5) < 0:
            high, less = float(radius), excess
            break
        low, more = float(radius), excess
    else:
        return circle_mm
    while high - low > 3e-3 * high:  # along the chord, but never beside an end for long
        part = float(np.clip(more / (more - less), 0.1, 0.9))
        middle = low + part * (high - low)
        if (excess := share(middle) - 0.5) >= 0:
            low, more = middle, excess
        else:
            high, less = middle, excess
    return low


def field_of_view(
    lens: Lens, film_distance_mm: float, film_radius_mm: float, wavelength_nm: float = LINE_D_NM
) -> float | None:
    """Return the full angle [degrees] that a film radius sees: twice the mean angle of its rays in the scene."""
    probe = film_probe.FilmProbe(lens, film_distance_mm, wavelength_nm)
    film = np.array([[film_radius_mm, 0.0]])
    boxes, lit = film_probe.narrow_boxes(probe, film, probe.windows(film), SEARCH)
    if not lit[0]:
        return None
    rays = probe.trace(film[0], film_probe.grid(boxes, *QUICK)[0])
    if not rays.passed.any():
        return None
    mean = rays.directions[rays.passed].mean(axis=0)
    return float(2 * np.degrees(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2])))
