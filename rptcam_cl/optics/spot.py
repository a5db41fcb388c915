"""Spots, chief rays and distortion of beams from points in the scene, traced exactly, also from the side or behind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.chief_rays import without_obstructions
from rptcam_cl.optics.lens import limiting_surface
from rptcam_cl.optics.ray_trace import Rays, Status, at_plane, refract

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens


#
# Beams from the side or from behind: fields beyond those that a plane across the axis can tell.
#
# Rays are spread over a plane across the beam and met with the first surface, a sphere that bulges to the scene as
# those of fisheyes do; behind it they travel towards the film, and the lens behind the first surface takes them on.

Array = NDArray[np.float64]

STEEP = 85.0  # degrees, from which rays are spread across the beam
FIRST = 256  # rays across the first surface, each way
COARSE = 64  # across a beam about the ray through the middle of the stop


def is_steep(field_degrees: float) -> bool:
    """Return whether a field lies so far from the axis that its rays are spread across the beam."""
    return abs(field_degrees) > STEEP


def enter(lens: Lens, field_degrees: float, points: Array, wavelength_nm: float) -> Rays:
    """Return rays of a parallel beam traced through a lens, through points (n, 2) across the beam.

    Parameters
    ----------
    field_degrees : float
        From the axis; light of a positive angle travels towards +y.
    points : array
        x, and the other coordinate across the beam, from the line of the beam through the centre of the first surface.

    Raises
    ------
    InputError
        When the first surface is none that light from the side can meet here.
    """
    angle, middle = np.radians(field_degrees), np.array([0.0, 0.0, _radius(lens)])
    along, across = np.array([0.0, np.sin(angle), np.cos(angle)]), np.array([0.0, np.cos(angle), -np.sin(angle)])
    origins = middle + points[:, :1] * [1.0, 0.0, 0.0] + points[:, 1:] * across
    return enter_rays(lens, origins, np.broadcast_to(along, origins.shape), wavelength_nm)


def enter_rays(lens: Lens, origins: Array, directions: Array, wavelength_nm: float) -> Rays:
    """Return rays (n, 3) traced through a lens, whose first surface they meet from outside, whatever their direction.

    Origins may be any points of the rays; directions are unit vectors of the light.

    Raises
    ------
    InputError
        When the first surface is none that light from the side can meet here.
    """
    if not takes_steep_light(lens):
        steepest = np.degrees(np.arccos(np.clip(directions[:, 2].min(), -1.0, 1.0)))
        raise InputError(
            f"{lens.name}: light at {steepest:.4g} degrees needs a first surface that is spherical,"
            " bulging to the scene"
        )
    first, radius = lens.surfaces[0], _radius(lens)
    middle = np.array([0.0, 0.0, radius])
    off = origins - middle
    along = np.sum(off * directions, axis=1)
    square = along**2 - np.sum(off**2, axis=1) + radius**2
    off = off - (along + np.sqrt(np.maximum(square, 0.0)))[:, None] * directions
    met = off + middle
    good = (square > 0) & (met[:, 2] < radius) & first.clears(met[:, 0], met[:, 1])
    ratio = np.divide(*lens.indices(wavelength_nm)[:2])
    normals = -off / radius  # along the light
    bent, through = refract(directions.T, normals.T, np.sum(normals * directions, axis=1), np.asarray(ratio))
    stop = None if lens.stop_index is None else lens.stop_index - 1
    rest = lens.of_surfaces(lens.surfaces[1:], stop, object_medium=first.glass)
    shift = np.array([0.0, 0.0, first.thickness])
    rays = rest.trace(met - shift, bent.T, wavelength_nm, start="scene")
    status = np.where(good & through & (bent[2] > 0), rays.status, np.int32(Status.missed))
    return Rays(
        rays.origins + shift,
        rays.directions,
        status,
        np.where(rays.surface < 0, -1, rays.surface + 1),
        rays.optical_path,
    )


def takes_steep_light(lens: Lens) -> bool:
    """Return whether the first surface is one that light from the side can meet here: a sphere about the axis."""
    first = lens.surfaces[0]
    plain = first.is_rotational and first.pose is None and first.region is None and first.is_sphere
    return lens.fold is None and len(lens.surfaces) > 1 and plain and first.curvature > 0 and lens.stop_index != 0


def _radius(lens: Lens) -> float:
    """Return the radius of the first surface [mm], 1 of one that takes no steep light."""
    return 1.0 / lens.surfaces[0].curvature if lens.surfaces[0].curvature > 0 else 1.0


def passing_steep_beam(
    lens: Lens, field_degrees: float, wavelength_nm: float, across: int
) -> tuple[Array, Rays, float]:
    """Return points across the beam whose rays pass, those rays, and the area of a grid cell [mm2]."""

    def through(points: Array) -> Rays:
        return enter(lens, field_degrees, points, wavelength_nm)

    box = np.array([[-1.0, -1.0], [1.0, 1.0]]) * _radius(lens)
    return _find_passing(lens, through, box, (FIRST, COARSE, across), f"a beam at {field_degrees:g} degrees")


def passing_from(
    lens: Lens, away: Array, distance_mm: float, origin: Array, wavelength_nm: float, across: int
) -> tuple[Array, Rays]:
    """Return the light of a point of the scene that passes: how far each ray leans from the middle one, and the rays.

    The rays are spread over a plane across the direction of the point, through the centre of the first surface.

    Parameters
    ----------
    away : (3,) array
        Unit vector to the point.
    distance_mm : float
        How far it is from the origin; infinite for a parallel beam.
    origin : (3,) array
        Where the ray through the middle of the stop meets the first surface, in the frame of the lens [mm].

    Returns
    -------
    cosines : (n,) array
        Of the angles between rays and ``away``.
    rays : Rays
        Those that pass.

    Raises
    ------
    InputError
        When the first surface is no sphere that bulges to the scene, the point lies within it, or nothing passes.
    """
    radius = _radius(lens)
    middle = np.array([0.0, 0.0, radius])
    right = np.cross(away, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right)
    up = np.cross(right, away)
    source = origin + away * distance_mm if np.isfinite(distance_mm) else None
    depth = np.inf if source is None else float((source - middle) @ away)
    if not depth > radius:
        raise InputError(f"{lens.name}: a point {distance_mm:g} mm away lies within the first surface")

    def beam(points: Array) -> tuple[Array, Array]:
        targets = middle + points[:, :1] * right + points[:, 1:] * up
        if source is None:
            return targets, np.broadcast_to(-away, targets.shape)
        light = targets - source
        return targets, light / np.linalg.norm(light, axis=1, keepdims=True)

    def through(points: Array) -> Rays:
        return enter_rays(lens, *beam(points), wavelength_nm)

    centre = np.array([(origin - middle) @ right, (origin - middle) @ up])
    half = 2.0 * lens.first_order(wavelength_nm).entrance_pupil.diameter_mm
    box = np.stack([centre - half, centre + half])
    while _cut_off(box, through) and half < radius:
        half *= 2.0
        box = np.stack([centre - half, centre + half])
    what = f"a point {np.degrees(np.arccos(-away[2])):.4g} degrees from the axis"
    points, rays, _ = _find_passing(lens, through, box, (COARSE, across), what)
    return -(beam(points)[1] @ away), rays


def _cut_off(box: Array, through: Callable[[Array], Rays]) -> bool:
    """Return whether light passes by the edges of a box, or none within."""
    points, size = grid_points(box, COARSE)
    lit = points[through(points).passed]
    return not len(lit) or bool(np.any(lit < box[0] + size) or np.any(lit > box[1] - size))


def _find_passing(
    lens: Lens,
    through: Callable[[Array], Rays],
    box: Array,
    counts: tuple[int, ...],
    what: str,
    finest: tuple[int, ...] = (1, 4),
) -> tuple[Array, Rays, float]:
    """Return points of a box whose rays pass, those rays, and a cell's area [mm2], on grids that narrow it down."""
    for count in counts:
        for finer in finest:  # a small pupil behind a large first surface slips through the first grid
            points, size = grid_points(box, finer * count)
            rays = through(points)
            good = rays.passed
            if good.any() or count != counts[0]:
                break
        if not good.any():
            raise InputError(f"{lens.name}: nothing of {what} comes through")
        box = np.stack([points[good].min(axis=0) - size, points[good].max(axis=0) + size])
    return points[good], rays.some(good), float(size.prod())


def grid_points(box: Array, count: int) -> tuple[Array, Array]:
    """Return the centres (count^2, 2) of the cells of a box and the size of a cell."""
    size = (box[1] - box[0]) / count
    x, y = (box[0, i] + size[i] * (np.arange(count) + 0.5) for i in (0, 1))
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2), size


def steep_chief_ray(lens: Lens, field_degrees: float, stop: int, wavelength_nm: float) -> tuple[float, Rays]:
    """Return the place across the beam of the ray through the centre of the stop, a surface, and its trace."""
    opened = tuple(replace(surface, semi_diameter=np.inf, region=None) for surface in lens.surfaces[1 : stop + 1])
    front = replace(lens, surfaces=(lens.surfaces[0], *opened), stop_index=None)

    def at(places: Array) -> Array:
        return np.column_stack([np.zeros_like(places), places])

    def trace(places: Array) -> Rays:
        return enter(front, field_degrees, at(places), wavelength_nm)

    ends = -_radius(lens), _radius(lens)
    place = _to_centre_of_stop(trace, ends, (801, *[65] * 5), f"{lens.name}: no ray at {field_degrees:g} degrees")
    return place, enter(lens, field_degrees, at(np.array([place])), wavelength_nm)


def _to_centre_of_stop(
    trace: Callable[[Array], Rays], ends: tuple[float, float], counts: Sequence[int], none: str
) -> float:
    """Return the place between two of the ray that meets the axis in the stop, sought by so many rays at a time."""
    low, high = ends
    for count in counts:
        places = np.linspace(low, high, count)
        rays = trace(places)
        values = np.where(rays.passed, rays.origins[:, 1], np.nan)
        with np.errstate(invalid="ignore"):
            cross = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) <= 0)
        if not len(cross):
            raise InputError(f"{none} reaches the centre of the stop")
        k = cross[np.argmin(np.abs(values[cross]) + np.abs(values[cross + 1]))]
        low, high = places[k], places[k + 1]
    return float((low + high) / 2)


#
# Spots, chief rays and distortion of beams from points in the scene, traced exactly.
#
# Beams lie in the y-z plane unless they say otherwise. The rays of a beam are spread evenly over the plane of the
# first vertex.


@dataclass(frozen=True)
class Beam:
    """Light from one point of the scene.

    Attributes
    ----------
    field_degrees : float
        Angle from the axis, seen from the first vertex; the light travels towards +y for a positive angle.
    object_distance_mm : float
        From the object plane to the first vertex; infinite for a parallel beam.
    azimuth_degrees : float
        Direction from the axis towards which the light of a positive angle travels, from +x towards +y.
    is_diffuse : bool
        Whether a lamp shines as a diffuse plane across the axis does: by the cosine.
    """

    field_degrees: float = 0.0
    object_distance_mm: float = np.inf
    azimuth_degrees: float = 90.0
    is_diffuse: bool = False

    def rays(self, points: Array) -> tuple[Array, Array]:
        """Return origins and directions (n, 3) of the rays through points (n, 2) of the plane of the first vertex."""
        origins = np.column_stack([points, np.zeros(len(points))])
        slope, turn = np.tan(np.radians(self.field_degrees)), np.radians(90.0 - self.azimuth_degrees)
        along = np.array([slope * np.sin(turn), slope * np.cos(turn), 1.0])
        if np.isinf(self.object_distance_mm):
            return origins, np.broadcast_to(along / np.linalg.norm(along), origins.shape)
        source = -along * self.object_distance_mm
        return np.broadcast_to(source, origins.shape), origins - source


@dataclass(frozen=True)
class Spot:
    """Where the rays of a beam meet the film. Lengths in millimetres.

    Attributes
    ----------
    area : float
        Cross-section of the beam that passes, in the plane of the first vertex [mm2].
    centroid : tuple of float
    rms, rms_x, rms_y : float
        Root mean square distance from the centroid.
    best_shift, best_rms : float
        Film shift (along the light) that makes the rms least, and that rms.
    rays : int
        How many rays passed.
    """

    area: float
    centroid: tuple[float, float]
    rms: float
    rms_x: float
    rms_y: float
    best_shift: float
    best_rms: float
    rays: int


def spot(
    lens: Lens,
    film_distance_mm: float,
    beam: Beam | None = None,
    wavelength_nm: float = LINE_D_NM,
    across: int = 256,
    coarse: int = COARSE,
) -> Spot:
    """Return the spot of a beam on the film; `across` rays span the beam each way, and so many seek it.

    Raises
    ------
    InputError
        When nothing of the beam passes.
    """
    beam = beam or Beam()
    points, rays, cell = passing_beam(lens, beam, wavelength_nm, across, coarse)
    film = at_plane(rays.origins, rays.directions, lens.film_z(film_distance_mm))[:, :2]
    slopes = lens.sense * rays.directions[:, :2] / rays.directions[:, 2:]
    centroid, drift = film.mean(axis=0), slopes.mean(axis=0)
    off, turn = film - centroid, slopes - drift
    variance = np.mean(off * off, axis=0)
    spread = float(np.mean(np.sum(turn * turn, axis=1)))
    shift = -float(np.mean(np.sum(off * turn, axis=1))) / spread if spread > 0 else 0.0
    best = off + shift * turn
    return Spot(
        area=len(points) * cell,
        centroid=(float(centroid[0]), float(centroid[1])),
        rms=float(np.sqrt(variance.sum())),
        rms_x=float(np.sqrt(variance[0])),
        rms_y=float(np.sqrt(variance[1])),
        best_shift=shift,
        best_rms=float(np.sqrt(np.mean(np.sum(best * best, axis=1)))),
        rays=len(points),
    )


def passing_beam(
    lens: Lens, beam: Beam, wavelength_nm: float, across: int, coarse: int = COARSE
) -> tuple[Array, Rays, float]:
    """Return the points of the first vertex plane whose rays pass, those rays, and the area of a grid cell [mm2].

    Of a steep field, points and area are those of a plane across the beam.

    Raises
    ------
    InputError
        When nothing of the beam passes.
    """
    if is_steep(beam.field_degrees):
        _check_steep(lens, beam)
        return passing_steep_beam(lens, beam.field_degrees, wavelength_nm, across)

    def through(points: Array) -> Rays:
        return lens.trace(*beam.rays(points), wavelength_nm, start="scene")

    what = f"a beam at {beam.field_degrees:g} degrees"
    return _find_passing(lens, through, _first_box(lens, beam), (coarse, coarse, across), what, (1, 4, 16))


def chief_ray(
    lens: Lens, field_degrees: float, wavelength_nm: float = LINE_D_NM, object_distance_mm: float = np.inf
) -> tuple[float, Rays]:
    """Return the ray through the centre of the stop: its height y in the plane of the first vertex [mm], and its trace.

    Of a steep field the height is that across the beam. Obstructions in the middle of the lens do not count.

    Raises
    ------
    InputError
        When no ray of that field reaches the centre of the stop.
    """
    lens = without_obstructions(lens)
    stop = limiting_surface(lens, wavelength_nm)
    if is_steep(field_degrees):
        _check_steep(lens, Beam(field_degrees, object_distance_mm))
        return steep_chief_ray(lens, field_degrees, stop, wavelength_nm)
    opened = tuple(replace(surface, semi_diameter=np.inf, region=None) for surface in lens.surfaces[: stop + 1])
    front = replace(lens, surfaces=opened)
    beam = Beam(field_degrees, object_distance_mm)

    def trace(heights: Array) -> Rays:
        points = np.column_stack([np.zeros_like(heights), heights])
        rays = front.trace(*beam.rays(points), wavelength_nm, start="scene")
        if (pose := opened[-1].pose) is None:
            return rays
        at_stop = pose.inward((rays.origins - [0.0, 0.0, lens.vertices[stop]]).T, rays.directions.T)
        return replace(rays, origins=at_stop[0].T, directions=at_stop[1].T)

    low, high = _first_box(lens, beam)[:, 1].tolist()
    none = f"{lens.name}: no ray at {field_degrees:g} degrees"
    height = _to_centre_of_stop(trace, (low, high), (401, *[65] * 6), none)
    return height, lens.trace(*beam.rays(np.array([[0.0, height]])), wavelength_nm, start="scene")


def _check_steep(lens: Lens, beam: Beam) -> None:
    if np.isfinite(beam.object_distance_mm) or beam.azimuth_degrees != 90.0:
        raise InputError(
            f"{lens.name}: nothing of a beam at {beam.field_degrees:g} degrees comes through:"
            " an object plane across the axis does not reach there"
        )


def distortion(lens: Lens, film_distance_mm: float, field_degrees: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the chief ray's film height over that of the ideal f tan(angle), less 1, for an object at infinity."""
    _, ray = chief_ray(lens, field_degrees, wavelength_nm)
    ideal = lens.first_order(wavelength_nm).front_focal_length_mm * np.tan(np.radians(field_degrees))
    return float(at_plane(ray.origins, ray.directions, lens.film_z(film_distance_mm))[0, 1] / ideal - 1.0)


def _first_box(lens: Lens, beam: Beam) -> Array:
    """Return the corners (2, 2) of a box in the plane of the first vertex that holds every ray to the first surface."""
    first = lens.surfaces[0]
    if not np.isfinite(first.semi_diameter):
        raise InputError(f"{lens.name}: the first surface needs a diameter")
    inside = first.semi_diameter * (1 - 1e-12)  # the rim of a whole hemisphere may lie a rounding beyond its reach
    heights = np.linspace(0.0, inside, 33)
    sags = np.abs([first.rim_sag(height) for height in heights])
    slope = abs(np.tan(np.radians(beam.field_degrees))) + first.semi_diameter / beam.object_distance_mm
    reach = float(np.max(heights + sags * slope)) * 1.001
    return np.array([[-reach, -reach], [reach, reach]])
