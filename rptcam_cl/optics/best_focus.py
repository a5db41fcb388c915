"""The film distance of the least real-ray spot at the working aperture, and how wide a lens blurs other points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import film_probe
from rptcam_cl.optics.beams import COARSE, Beam, shift_to_least_spot, spot
from rptcam_cl.optics.lens import MEASURED_FROM, Lens, film_distance

# The film distance of the least real-ray spot at the working aperture, on the axis or at a field point.

Array = NDArray[np.float64]

ZONES = 48
ACROSS = 128  # rays that span an oblique beam each way
AIMS = (48, 48)  # rays that seek where a film point looks
ROUNDS = 60
_RING_STEPS = 512  # rays that seek the edges of an obstructed beam
_RING_ROUNDS = 4
AIMED = 4  # rounds after which the direction of the object point stays
CONVERGED = 1e-11  # of the film distance, between two rounds
CONVERGED_AT_A_POINT = 1e-6  # the same where the rays that pass are counted, not integrated
_MOST_ROUNDS, _FEW_ROUNDS = 8, 3  # in each of which the marginal ray is found 128 times as well
FEW_ACROSS, FEW_COARSE, FEW_AIMS = 48, 32, 24  # rays for a place that need not be exact: off by 0.004 of 2 N c, at most
_FEW_AIMED = 2  # by 0.035 (27 points of 9 lenses, the most where aberrations are many times that)
_AIMED_WITHIN = 10.0  # times as near as is enough: a direction aimed at from farther off is not the place's own


def best_film_distance(
    lens: Lens,
    object_distance_mm: float,
    measured_from: str = "film",
    wavelengths_nm: Sequence[float] = (LINE_D_NM,),
    field_degrees: float = 0.0,
    within_mm: float = 0.0,
    start_mm: float | None = None,
) -> float:
    """Return the distance from the last vertex to the film with the least rms spot [mm].

    Parameters
    ----------
    lens : Lens
        At its working aperture: see `Lens.with_stop_diameter`.
    object_distance_mm, measured_from
        As in `focus.film_distance`.
    wavelengths_nm : sequence of float
        Several are pooled with equal weights.
    field_degrees : float
        Off the axis the spot is that of the whole oblique beam, at the first wavelength.
    within_mm, start_mm
        As in `best_film_distance_at`.
    """
    if measured_from not in MEASURED_FROM:
        raise InputError(f'measured_from must be "film" or "front" (got {measured_from!r})')
    paraxial = film_distance(lens, object_distance_mm, measured_from, wavelengths_nm[0])
    if measured_from == "front" or np.isinf(object_distance_mm):
        return _best(lens, object_distance_mm, wavelengths_nm, field_degrees, paraxial)
    film_distance_mm, rounds = start_mm or paraxial, _FEW_ROUNDS if within_mm > 0 else _MOST_ROUNDS
    for _ in range(ROUNDS):
        front = _front_mm(lens, object_distance_mm, measured_from, film_distance_mm)
        new = _best(lens, front, wavelengths_nm, field_degrees, film_distance_mm, rounds)
        if abs(new - film_distance_mm) <= max(CONVERGED * abs(film_distance_mm), within_mm):
            return new
        film_distance_mm = new
    return film_distance_mm


def best_film_distance_at(
    lens: Lens,
    film_point_mm: tuple[float, float],
    object_distance_mm: float,
    measured_from: str = "film",
    wavelength_nm: float = LINE_D_NM,
    within_mm: float = 0.0,
    start_mm: float | None = None,
) -> float:
    """Return the distance from the last vertex to the film with the least rms spot at a point of the film [mm].

    Parameters
    ----------
    lens : Lens
        At its working aperture.
    film_point_mm : (x, y)
        In the frame of the lens, about which the image of an object point lies.
    object_distance_mm, measured_from
        As in `focus.film_distance`.
    wavelength_nm : float
    within_mm : float
        As near as this is enough, so that fewer rays are; 0 for as near as can be.
    start_mm : float or None
        Where to begin; by default at the place by first-order optics.

    Raises
    ------
    InputError
        When no light arrives there, or the search does not end.
    """
    film_distance_mm = start_mm or film_distance(lens, object_distance_mm, measured_from, wavelength_nm)
    beam, few, shift = Beam(), within_mm > 0, 0.0
    across, coarse, aimed = (FEW_ACROSS, FEW_COARSE, _FEW_AIMED) if few else (ACROSS, COARSE, AIMED)
    for number in range(ROUNDS):
        front = _front_mm(lens, object_distance_mm, measured_from, film_distance_mm)
        beam = replace(beam, object_distance_mm=front)
        if number < aimed or (few and abs(shift) > _AIMED_WITHIN * within_mm):
            beam = _beam_to(lens, film_point_mm, film_distance_mm, front, wavelength_nm, few=few)
        shift = shift_to_least_spot(lens, film_distance_mm, beam, wavelength_nm, across, coarse)
        film_distance_mm += shift
        if abs(shift) <= max(CONVERGED_AT_A_POINT * abs(film_distance_mm), within_mm):
            return film_distance_mm
    x, y = film_point_mm
    raise InputError(f"{lens.name}: finds no least spot at the film point ({x:g}, {y:g}) mm")


def _front_mm(lens: Lens, object_distance_mm: float, measured_from: str, film_distance_mm: float) -> float:
    """Return the distance of an object before the first vertex [mm]."""
    if measured_from == "front":
        return object_distance_mm
    return object_distance_mm - lens.length - lens.sense * film_distance_mm


def _beam_to(
    lens: Lens,
    film_point_mm: tuple[float, float],
    film_distance_mm: float,
    front_mm: float,
    wavelength_nm: float,
    *,
    few: bool,
) -> Beam:
    """Return the light of the object point that the mean ray from a film point meets."""
    probe, film = (
        film_probe.FilmProbe(lens, film_distance_mm, wavelength_nm),
        np.array([film_point_mm], dtype=np.float64),
    )
    boxes, lit = np.empty((1, 4)), np.array([False])
    if not few:
        boxes, lit = film_probe.narrow_boxes(probe, film, probe.windows(film), AIMS)
    if not lit[0]:  # a small pupil, which is found step by step
        boxes, lit = film_probe.pupil_boxes(film_probe.narrowing_probes(lens, film_distance_mm, wavelength_nm), film)
    aims = (FEW_AIMS, FEW_AIMS) if few else AIMS
    if not lit[0]:
        x, y = film_point_mm
        raise InputError(f"{lens.name}: no light reaches the film point ({x:g}, {y:g}) mm")
    rays = probe.trace(film[0], film_probe.grid(boxes, *aims)[0])
    origins, directions = rays.origins[rays.passed], rays.directions[rays.passed]
    if np.isinf(front_mm):
        slope = np.mean(directions[:, :2] / directions[:, 2:], axis=0)
    else:
        step = (-front_mm - origins[:, 2:]) / directions[:, 2:]
        slope = -np.mean(origins[:, :2] + step * directions[:, :2], axis=0) / front_mm
    angle, azimuth = np.degrees([np.arctan(np.hypot(*slope)), np.arctan2(slope[1], slope[0])])
    return Beam(float(angle), front_mm, float(azimuth))


def _best(
    lens: Lens,
    front_mm: float,
    wavelengths_nm: Sequence[float],
    field_degrees: float,
    start: float,
    rounds: int = _MOST_ROUNDS,
) -> float:
    if field_degrees or not lens.is_rotational:
        return start + shift_to_least_spot(lens, start, Beam(field_degrees, front_mm), wavelengths_nm[0])
    top, bottom = 0.0, 0.0
    for wavelength in wavelengths_nm:
        heights, slopes, weights = _zones(lens, front_mm, wavelength, rounds)
        top += float(np.sum(weights * heights * slopes))
        bottom += float(np.sum(weights * slopes * slopes))
    return -top / bottom


def axial_blur(lens: Lens, film_distance_mm: float, front_mm: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the root mean square distance from the axis of the light of a point on it, on the film [mm].

    Of a lens that is not alike all round, from the middle of that light.

    Parameters
    ----------
    front_mm
        From the point to the first vertex; infinite for a distant one.
    """
    if not lens.is_rotational:
        return spot(lens, film_distance_mm, Beam(0.0, front_mm), wavelength_nm, ACROSS).rms
    heights, slopes, weights = _zones(lens, front_mm, wavelength_nm)
    return float(np.sqrt(np.sum(weights * (heights + film_distance_mm * slopes) ** 2)))


def _zones(lens: Lens, front_mm: float, wavelength_nm: float, rounds: int = _MOST_ROUNDS) -> tuple[Array, Array, Array]:
    """Return height at the last vertex, slope along the light and weight of meridional rays.

    They are spread evenly over the entrance pupil, from the edge of what obstructs its middle.
    """
    plane, limit = _pupil_plane(lens, front_mm, wavelength_nm)
    if lens.is_obstructed:
        inner, outer = _ring(lens, front_mm, plane, limit, wavelength_nm)
    else:
        inner, outer = 0.0, _marginal_height(lens, front_mm, plane, limit, wavelength_nm, rounds)
    nodes, weights = np.polynomial.legendre.leggauss(ZONES)
    share = inner / outer
    radii = outer * np.sqrt(share * share + (1.0 - share * share) * ((nodes + 1) / 2))
    rays = lens.trace(*_meridional(front_mm, plane, radii), wavelength_nm, start="scene")
    slopes = rays.directions[:, 1] / rays.directions[:, 2]
    heights = rays.origins[:, 1] + (lens.length - rays.origins[:, 2]) * slopes
    return heights, lens.sense * slopes, weights / 2


def _pupil_plane(lens: Lens, front_mm: float, wavelength_nm: float) -> tuple[float, float]:
    """Return z of a plane over which an axial beam is spread as over the entrance pupil, and twice its radius there.

    It is that of the entrance pupil; where this is at infinity or before the object, as of lenses that see objects
    telecentrically, it is that of the first vertex: what is even over one plane is even over all.
    """
    pupil = lens.first_order(wavelength_nm).entrance_pupil
    if np.isfinite(pupil.distance_mm) and pupil.distance_mm > -front_mm:
        return pupil.distance_mm, 2.0 * pupil.diameter_mm
    if not np.isfinite(lens.surfaces[0].semi_diameter):
        raise InputError(f"{lens.name}: the first surface needs a diameter")
    return 0.0, 2.0 * lens.surfaces[0].semi_diameter


def _ring(lens: Lens, front_mm: float, plane: float, limit: float, wavelength_nm: float) -> tuple[float, float]:
    """Return the least and the largest height in a plane at which rays from the axial object point pass [mm]."""
    heights = np.linspace(0.0, limit, _RING_STEPS)
    for _ in range(_RING_ROUNDS):
        passed = lens.trace(*_meridional(front_mm, plane, heights), wavelength_nm, start="scene").passed
        if not passed.any():
            raise InputError(f"{lens.name}: no ray from a point on the axis comes through")
        first, last = int(np.argmax(passed)), len(passed) - 1 - int(np.argmax(passed[::-1]))
        inner = np.linspace(heights[max(first - 1, 0)], heights[first], _RING_STEPS // 2)
        outer = np.linspace(heights[last], heights[min(last + 1, len(heights) - 1)], _RING_STEPS // 2)
        heights = np.concatenate([inner, outer])
    return float(inner[-1]), float(outer[0])


def _marginal_height(
    lens: Lens, front_mm: float, plane: float, limit: float, wavelength_nm: float, rounds: int
) -> float:
    """Return the largest height in a plane below which every ray from the axial object point passes [mm]."""
    low, high = 0.0, limit
    for _ in range(rounds):
        trial = np.linspace(low, high, 129)
        passed = lens.trace(*_meridional(front_mm, plane, trial), wavelength_nm, start="scene").passed
        if passed.all():
            return high
        first = int(np.argmin(passed))
        if first == 0:
            raise InputError(f"{lens.name}: the ray on the axis does not come through")
        low, high = trial[first - 1], trial[first]
    return low


def _meridional(front_mm: float, plane: float, heights: Array) -> tuple[Array, Array]:
    """Return rays from the axial object point through heights in a plane z [mm]."""
    zero = np.zeros_like(heights)
    through = np.stack([zero, heights, zero + plane], axis=1)
    if np.isinf(front_mm):
        return through, np.stack([zero, zero, zero + 1.0], axis=1)
    source = np.array([0.0, 0.0, -front_mm])
    return np.broadcast_to(source, through.shape), through - source


#
# How wide a lens blurs points of the scene on the film, by exact rays.
#
# A point is named by the film point that sees it, through the middle of the pupil, and by its vergence: one over its
# distance along that ray [1/mm], counted from where the ray passes nearest to the first vertex; 0 is infinitely far.

Mask = NDArray[np.bool_]

_BLUR_ACROSS = 24  # rays across a beam
_NARROWING = (16, 16)  # rays that find it
SMALLEST = 1e-300  # keeps sums over no rays from dividing by zero
WIDENED = 1.6  # the beam from a point near the lens meets the front elsewhere than that from the film point


@dataclass(frozen=True)
class _SceneBeams:
    """Beams in the scene that a film sees through a lens, one per film point (n).

    Attributes
    ----------
    frame : FilmFrame
        How the film stands.
    nearest, along : (n, 3) arrays
        The middle ray's nearest point to the first vertex, and its direction away from the lens.
    middle : (n, 3) array
        Where the middle ray leaves the lens.
    across : (n, 2, 3) array
        Unit vectors across the beam.
    reach : (n, 2) array
        How far around the middle to look for its rays along those [mm].
    lit : (n,) array
        Which have any light.
    """

    lens: Lens
    film_distance_mm: float
    wavelength_nm: float
    frame: film_probe.FilmFrame
    nearest: Array
    along: Array
    middle: Array
    across: Array
    reach: Array
    lit: Mask

    def variances(self, vergence: float) -> Array:
        """Return the variances (n, 2) in x and y of where light of a point meets the film [mm2]; nan without light."""
        boxes = film_probe.boxes_of(-self.reach, self.reach)
        steps = film_probe.grid(boxes, *_NARROWING)
        _, passed = self._on_film(steps, vergence)
        boxes, _ = film_probe.boxes_round(steps, passed, film_probe.cells(boxes, *_NARROWING), boxes)
        film, passed = self._on_film(film_probe.grid(boxes, _BLUR_ACROSS, _BLUR_ACROSS), vergence)
        count = np.sum(passed, axis=1)[:, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.sum(np.where(passed[..., None], film, 0.0), axis=1) / count
            return np.asarray(np.sum(np.where(passed[..., None], film - mean[:, None], 0.0) ** 2, axis=1) / count)

    def _on_film(self, steps: Array, vergence: float) -> tuple[Array, Mask]:
        """Return where rays from a point of each beam through steps (n, rays, 2) across it meet the film, and which."""
        lens, frame = self.lens, self.frame
        front = self.middle[:, None] + np.einsum("nrk,nki->nri", steps, self.across)
        if vergence == 0.0:
            origins, directions = front, np.broadcast_to(-self.along[:, None], front.shape)
        else:
            sources = (self.nearest + self.along / vergence)[:, None]
            origins, directions = np.broadcast_to(sources, front.shape), front - sources
        rays = lens.trace(origins.reshape(-1, 3), directions.reshape(-1, 3), self.wavelength_nm, start="scene")
        across, up = lens.sense * np.array(frame.slopes)  # of the film's plane, in z of the lens
        x, y = (rays.origins[:, :2] - np.array(frame.centre)).T
        ahead = lens.film_z(self.film_distance_mm) + x * across + y * up - rays.origins[:, 2]
        dx, dy, dz = rays.directions.T
        film = rays.origins[:, :2] + (ahead / (dz - dx * across - dy * up))[:, None] * rays.directions[:, :2]
        film = film if frame.is_flat else frame.on_film(film)
        return film.reshape(steps.shape), rays.passed.reshape(steps.shape[:2])


def blur_variances(
    lens: Lens,
    film_distance_mm: float,
    film: Array,
    vergences: Array,
    wavelength_nm: float,
    frame: film_probe.FilmFrame = film_probe.UNMOVED,
) -> tuple[Array, Mask]:
    """Return the variances (n, vergences, 2) of the blur in x and y [mm2], and which film points (n,) are lit.

    Parameters
    ----------
    film
        (n, 2) on the film [mm].
    vergences
        (count,) of the points of the scene [1/mm].
    frame
        How the film stands; x and y of the blur run along its sides.
    """
    boxes, lit = film_probe.pupil_boxes(film_probe.narrowing_probes(lens, film_distance_mm, wavelength_nm, frame), film)
    beams = _scene_beams(lens, film_distance_mm, film, boxes, wavelength_nm, frame)
    variances = np.stack([beams.variances(float(vergence)) for vergence in vergences], axis=1)
    lit = lit & beams.lit & np.isfinite(variances).all(axis=(1, 2))
    return np.where(lit[:, None, None], variances, 0.0), lit


def _scene_beams(
    lens: Lens, film_distance_mm: float, film: Array, boxes: Array, wavelength_nm: float, frame: film_probe.FilmFrame
) -> _SceneBeams:
    """Return the beams that film points see through boxes of the rear plane."""
    rear = film_probe.grid(boxes, *_NARROWING)
    count, rays_each = rear.shape[:2]
    distances = np.broadcast_to((film_distance_mm + frame.depth(film))[:, None, None], (count, rays_each, 1))
    away = np.concatenate([rear - film[:, None], -lens.sense * distances], axis=-1)
    origins = np.empty_like(away)
    origins[..., :2], origins[..., 2] = film[:, None], lens.length + lens.sense * distances[..., 0]
    rays = lens.trace(origins.reshape(-1, 3), away.reshape(-1, 3), wavelength_nm)
    passed = np.asarray(rays.passed).reshape(count, rays_each)
    cos4 = (distances[..., 0] ** 2 / np.sum(away * away, axis=-1)) ** 2 * passed
    weight = (cos4 / np.maximum(np.sum(cos4, axis=1), SMALLEST)[:, None])[..., None]
    starts = np.where(passed[..., None], rays.origins.reshape(away.shape), 0.0)
    middle = np.sum(weight * starts, axis=1)
    along = _unit(np.sum(weight * rays.directions.reshape(away.shape), axis=1))
    first = _unit(np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)]))
    across = np.stack([first, np.cross(along, first)], axis=1)
    offsets = np.einsum("nri,nki->nrk", starts - middle[:, None], across)
    reach = WIDENED * np.max(np.abs(offsets) * passed[..., None], axis=1)
    nearest = middle - np.sum(middle * along, axis=1)[:, None] * along
    lit = np.asarray(passed.any(axis=1))
    return _SceneBeams(lens, film_distance_mm, wavelength_nm, frame, nearest, along, middle, across, reach, lit)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), SMALLEST)[:, None])
