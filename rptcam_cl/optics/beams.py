"""Beams and chief rays: of points of the film and of the scene, spots and distortion, traced exactly."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import remember
from rptcam_cl.optics.lens import Lens, limiting_surface, system_matrix
from rptcam_cl.optics.ray_trace import L, Rays, Status, at_plane, passing, refract, trace, trace_crossings
from rptcam_cl.optics.surface import Prescription

# Where rays from the film cross every surface of a lens whose rims let all of them pass: float64.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Crossings:
    """Rays from the film through a lens without rims, in its frame [mm].

    Attributes
    ----------
    heights : (surfaces, n, 2) array
        x and y on each surface, scene side first; not a number from where a ray misses one or is totally reflected.
    origins, directions : (n, 3) arrays
        Point on the first surface and unit direction before it, towards the scene.
    """

    heights: Array
    origins: Array
    directions: Array

    def within(self, lens: Lens, share: float = 1.0) -> NDArray[np.bool_]:
        """Return which rays stay within ``share`` of every rim, and come out; of a stop, its circle counts."""
        rims = np.array([surface.semi_diameter for surface in lens.surfaces])
        with np.errstate(invalid="ignore"):
            inside = np.hypot(self.heights[..., 0], self.heights[..., 1]) <= share * rims[:, None]
        return np.asarray(inside.all(axis=0) & np.isfinite(self.directions[:, 2]))


def crossings(lens: Lens, origins: Array, directions: Array, wavelength_nm: float) -> Crossings:
    """Return where rays from the film cross a rotationally symmetric lens.

    Parameters
    ----------
    origins, directions : (n, 3) arrays
        In the frame of the lens [mm], z = 0 at its first vertex and +z to the film; directions of any length, to -z.
    """
    p, d = origins.T.astype(np.float64), directions.T / np.linalg.norm(directions, axis=1)
    heights, *out = trace_crossings(lens, range(len(lens.surfaces) - 1, -1, -1), p, d, wavelength_nm)
    return Crossings(heights, *out)


#
# Chief rays of film points: the one ray of each that goes through the centre of the stop.
#
# From a film point the rays behind the stop are aimed by Newton's method at the plane of the last vertex until they
# meet the centre of the stop; the rest of the lens then says where in the scene they come from. So fields beyond 90
# degrees need no case of their own, and neither do lenses that are not round or films that are moved.

Mask = NDArray[np.bool_]

ROUNDS = 12  # of Newton's method, which needs three to five
STEP = 1e-6  # of the derivatives, over the aperture's size
HIT = 1e-10  # distance from the centre of the stop that counts as none, over the same
_RETRIES = 4  # from neighbours, where the first guess led nowhere


@dataclass(frozen=True)
class ChiefRays:
    """Chief rays on the scene's side, in the frame of the lens.

    Attributes
    ----------
    origins, directions : (n, 3) arrays
        Point on the first surface [mm], and unit vector away from the lens.
    found : (n,) array
        Which exist, were no rim in their way; the others are of no use.
    clear : (n,) array
        Which of them come through every rim. Beside those, light may still pass away from the middle of the stop.
    aims : (n, 2) array
        Where they meet the plane of the last vertex [mm].
    """

    origins: Array
    directions: Array
    found: Mask
    clear: Mask
    aims: Array


def film_chief_rays(lens: Lens, film_points: Array, wavelength_nm: float = LINE_D_NM) -> ChiefRays:
    """Return the chief rays of film points (n, 3), in the frame of the lens [mm].

    Obstructions in the middle of a lens do not count. Exact to 1e-10 of the stop's radius.

    Raises
    ------
    InputError
        When the lens has no surface that limits the light.
    """
    points = np.atleast_2d(np.asarray(film_points, dtype=np.float64))
    stop = limiting_surface(lens, wavelength_nm)
    rear = _rear(lens, stop)
    size = float(lens.surfaces[stop].semi_diameter)
    pupil = lens.first_order(wavelength_nm).exit_pupil.distance_mm
    depth = lens.sense * (points[:, 2] - lens.length)
    share = -pupil / (depth - pupil) if np.isfinite(pupil) else np.ones(len(points))
    aims, reached = _aim(rear, lens, points, points[:, :2] * share[:, None], wavelength_nm, size)
    for _ in range(_RETRIES):
        lost = np.flatnonzero(~reached)
        if not reached.any() or not len(lost):
            break
        known = np.flatnonzero(reached)
        away = np.sum((points[lost, None, :2] - points[None, known, :2]) ** 2, axis=2)
        near = known[np.argmin(away, axis=1)]
        start = aims[near] + (points[lost, :2] - points[near, :2]) * share[lost, None]
        aims[lost], reached[lost] = _aim(rear, lens, points[lost], start, wavelength_nm, size)
    rays = aimed_rays(lens, points, aims, wavelength_nm)
    return replace(rays, found=reached & rays.found, clear=reached & rays.clear)


def aimed_rays(lens: Lens, film_points: Array, aims: Array, wavelength_nm: float = LINE_D_NM) -> ChiefRays:
    """Return the rays of film points (n, 3) through points (n, 2) of the plane of the last vertex, known before.

    A ray whose aim is not-a-number is not found.
    """
    known = np.asarray(np.isfinite(aims).all(axis=1))
    away = _towards(lens, film_points, np.where(known[:, None], aims, 0.0))
    rays = trace(without_rims(lens), film_points, away, wavelength_nm)
    reached = known & rays.passed
    filled = replace(lens, surfaces=tuple(surface.filled() for surface in lens.surfaces))
    clear = reached & passing(filled, film_points, away, wavelength_nm)
    return ChiefRays(rays.origins, rays.directions, reached, clear, aims)


def without_obstructions(lens: Lens) -> Lens:
    """Return the lens without holes, obstructions in its middle and the shape of its stop: its chief rays need none."""
    return replace(lens, surfaces=tuple(each.filled() for each in lens.surfaces)) if lens.is_obstructed else lens


def without_rims(lens: L) -> L:
    """Return the lens that stops no ray; whether rays pass is another question than where they go."""
    return replace(lens, surfaces=tuple(surface.open() for surface in lens.surfaces))


def _rear(lens: Lens, stop: int) -> Prescription:
    """Return the lens from its stop on, without rims; z = 0 at the stop."""
    before = lens.surfaces[stop - 1].glass if stop else lens.object_medium
    surfaces = (surface.open() for surface in lens.surfaces[stop:])
    return lens.of_surfaces(surfaces, None, object_medium=before, first_sense=float(lens.senses[stop]), fold=None)


def _towards(lens: Lens, points: Array, aims: Array) -> Array:
    """Return directions (n, 3) from film points to points (n, 2) of the plane of the last vertex."""
    return np.column_stack([aims - points[:, :2], lens.length - points[:, 2]])


def _aim(
    rear: Prescription, lens: Lens, points: Array, start: Array, wavelength_nm: float, size: float
) -> tuple[Array, Mask]:
    """Return points of the plane of the last vertex (n, 2) whose rays meet the centre of the stop, and which do."""
    shift = np.array([0.0, 0.0, lens.length - rear.length])
    pose = rear.surfaces[0].pose
    h = STEP * size

    def miss(rows: NDArray[np.intp], aims: Array) -> Array:
        rays = trace(rear, points[rows] - shift, _towards(lens, points[rows], aims), wavelength_nm)
        at = rays.origins if pose is None else pose.inward(rays.origins.T, rays.directions.T)[0].T
        return np.where(rays.passed[:, None], at[:, :2], np.nan)

    aims, reached = start.copy(), np.zeros(len(points), dtype=bool)
    rows = np.arange(len(points))
    for _ in range(ROUNDS):
        at = miss(rows, aims[rows])
        hit = np.abs(at).max(axis=1) <= HIT * size
        reached[rows[hit]] = True
        rows, at = rows[~hit], at[~hit]
        if not len(rows):
            break
        beside = np.concatenate([aims[rows] + [h, 0.0], aims[rows] + [0.0, h]])
        right, up = ((there - at) / h for there in np.split(miss(np.tile(rows, 2), beside), 2))
        with np.errstate(all="ignore"):
            scale = right[:, 0] * up[:, 1] - right[:, 1] * up[:, 0]
            step = np.column_stack(
                [at[:, 0] * up[:, 1] - at[:, 1] * up[:, 0], right[:, 0] * at[:, 1] - right[:, 1] * at[:, 0]]
            )
            new = aims[rows] - step / scale[:, None]
        usable = np.isfinite(new).all(axis=1)
        rows = rows[usable]
        aims[rows] = new[usable]
        if not len(rows):
            break
    return aims, reached


#
# Chief rays of round lenses from one fan of rays out of the centre of the stop, to both sides.
#
# The fan depends neither on where the film stands nor on how wide the stop is, so it is traced once and kept:
# polynomials in the tangent at the stop. A film point of any state finds its chief ray there by Newton's method,
# without tracing.

NODES = (20, 40)  # of a fan, where the first are too few
EXACT = 1e-12  # share of a quantity that its last polynomials may have
ROUNDING = 3e-15  # share that is left out
_STEPS_OF_TANGENT = 8  # widths of fans while the tangent at the stop doubles
WIDER = 12  # steps by which a fan may have to be wider than first-order optics says
PLACES = 65  # at which a search begins
_FAN_ROUNDS = 2  # of Newton's method, from within 1e-5
_TELLS_APART = 10  # decimals of millimetres by which distances of film points from the axis differ
REMEMBERED = 128  # lenses whose fans are kept


def round_chief_rays(lens: Lens, film_points: Array, wavelength_nm: float = LINE_D_NM) -> ChiefRays:
    """Return the rays of `film_chief_rays` for a round lens and points (n, 3) of one plane across its axis."""
    if (by_fan := fan_chief_rays(lens, film_points, wavelength_nm)) is not None:
        return by_fan
    distances, turns = np.hypot(*film_points[:, :2].T), np.arctan2(film_points[:, 1], film_points[:, 0])
    _, first, which = np.unique(np.round(distances, _TELLS_APART), return_index=True, return_inverse=True)
    on_x = np.column_stack([distances[first], np.zeros(len(first)), film_points[first, 2]])
    rays, cosine, sine = film_chief_rays(lens, on_x, wavelength_nm), np.cos(turns), np.sin(turns)

    def turned(vectors: Array) -> Array:
        x, y = vectors[which, 0], vectors[which, 1]
        return np.column_stack([cosine * x - sine * y, sine * x + cosine * y, vectors[which, 2:]])

    exist, clear = rays.found[which], rays.clear[which]
    return ChiefRays(turned(rays.origins), turned(rays.directions), exist, clear, turned(rays.aims))


def fan_chief_rays(lens: Lens, film_points: Array, wavelength_nm: float) -> ChiefRays | None:
    """Return the chief rays of film points (n, 3) of one plane; None where no fan reaches them that is smooth enough.

    They do not depend on how wide the stop is, to the last bit.
    """
    if lens.has_mirrors:
        return None
    stop, film_distance_mm = limiting_surface(lens, wavelength_nm), float(film_points[0, 2]) - lens.length
    x, y = film_points[:, 0], film_points[:, 1]
    radii = np.sqrt(x * x + y * y)
    (height, slope), fans = _fans_of(lens, stop, wavelength_nm)
    tangent = float(radii.max()) / max(abs(height + film_distance_mm * slope), 1e-300)
    if not tangent > 0:
        return None
    step = math.ceil(_STEPS_OF_TANGENT * math.log2(tangent))
    for width in range(step, step + WIDER):
        if width not in fans:
            tangent = 2.0 ** (width / _STEPS_OF_TANGENT)
            tried = (_with_nodes(lens, stop, wavelength_nm, tangent, count) for count in NODES)
            fans[width] = next((fan for fan in tried if fan is not None), None)
        fan = fans[width]
        if fan is None:
            return None
        if (rays := fan.chief_rays(lens, film_points, radii, film_distance_mm)) is not None:
            return rays
    return None


def geometry_but_stop(lens: Lens, stop: int, wavelength_nm: float) -> tuple[object, ...]:
    """Return all that rays of a wavelength through a round lens follow from, but how wide its stop is."""
    at = lens.surfaces[stop]
    of_stop = at.curvature, at.conic, at.aspheric, at.thickness, at.glass
    return lens.surfaces[:stop], of_stop, lens.surfaces[stop + 1 :], lens.object_medium, wavelength_nm


@remember(most=REMEMBERED, by=geometry_but_stop)
def _fans_of(lens: Lens, stop: int, wavelength_nm: float) -> tuple[tuple[float, float], dict[int, _Fan | None]]:
    """Return height on the plane of the last vertex and slope behind it over the tangent at the stop, to first order,
    and the fans by their width: all states of the film and of the stop share them."""
    indices = lens.indices(wavelength_nm)
    (_, height), (_, slope) = (system_matrix(lens, wavelength_nm, stop) * indices[stop]).tolist()
    return (height, slope / float(indices[-1])), {}


def chebyshev_nodes(count: int) -> tuple[Array, Array]:
    """Return nodes from -1 to 1, and the matrix from values there to Chebyshev polynomials."""
    angles = (np.arange(count) + 0.5) * np.pi / count
    matrix = 2.0 / count * np.cos(np.outer(np.arange(count), angles))
    matrix[0] /= 2
    return np.cos(angles), matrix


def _with_nodes(lens: Lens, stop: int, wavelength_nm: float, tangent: float, count: int) -> _Fan | None:
    """Return a fan by rays at some nodes; None where a ray is lost or so few nodes leave errors."""
    nodes, to_polynomials = chebyshev_nodes(count)
    tangents = tangent * np.sqrt((1.0 + nodes) / 2)
    points = np.zeros((3, count))
    points[2] = lens.vertices[stop]
    to_film = np.stack([tangents, np.zeros(count), np.ones(count)]) / np.hypot(1.0, tangents)
    behind, p, d = trace_crossings(
        lens, range(stop, len(lens.surfaces)), points, to_film, wavelength_nm, towards_film=True
    )
    ahead, origins, away = trace_crossings(lens, range(stop - 1, -1, -1), points, -to_film, wavelength_nm)
    slope = d[:, 0] / d[:, 2]
    height = p[:, 0] - slope * (p[:, 2] - lens.length)
    odd = np.stack([height, slope, origins[:, 0], away[:, 0], *ahead[..., 0], *behind[..., 0]], axis=1)
    values = np.column_stack([odd / tangents[:, None], origins[:, 2], away[:, 2]])
    if not np.isfinite(values).all():
        return None
    polynomials = to_polynomials @ values
    shares = np.abs(polynomials) / np.maximum(np.abs(values).max(axis=0), 1e-300)
    if np.any(shares[-2:] > EXACT):
        return None
    last = int(np.flatnonzero((shares > ROUNDING).any(axis=1))[-1])
    return _Fan(tangent, polynomials[: max(last, 1) + 1])


@dataclass(frozen=True, eq=False)
class _Fan:
    """Rays through the centre of the stop.

    Attributes
    ----------
    tangent : float
        At the stop, up to which they go.
    polynomials : (nodes, quantities) array
        Chebyshev polynomials of the square of the tangent t. Over t: the height on the plane of the last vertex [mm],
        the slope behind it, x on the first surface, x of the unit direction there, and x on every surface. Then z of
        the point on the first surface, and of that direction.
    """

    tangent: float
    polynomials: Array

    @cached_property
    def _begin(self) -> tuple[Array, Array]:
        """Tangents, and height and slope over them."""
        tangents = np.linspace(0.0, self.tangent, PLACES)
        return tangents, self._terms(tangents) @ self.polynomials[:, :2]

    @cached_property
    def _changes(self) -> Array:
        """Polynomials of the derivatives of height and slope."""
        derivatives = np.zeros((len(self.polynomials), 2))
        derivatives[:-1] = np.polynomial.chebyshev.chebder(self.polynomials[:, :2]) * (2 / self.tangent**2)
        return derivatives

    def _terms(self, tangents: Array) -> Array:
        """Return the Chebyshev polynomials (n, nodes) at some tangents."""
        places = np.clip(2 * (tangents / self.tangent) ** 2 - 1, -1.0, 1.0)
        terms = np.empty((len(self.polynomials), len(places)))
        terms[0], terms[1] = 1.0, places
        for k in range(2, len(terms)):
            np.multiply(terms[k - 1], 2 * places, out=terms[k])
            terms[k] -= terms[k - 2]
        return terms.T

    def chief_rays(self, lens: Lens, film_points: Array, radii: Array, film_distance_mm: float) -> ChiefRays | None:
        """Return the chief rays of film points (n, 3) so far from the axis; None where it goes not so far."""
        places, begin = self._begin
        per_tangent = begin @ (1.0, film_distance_mm)
        sign = np.sign(per_tangent[0])
        reached = sign * places * per_tangent
        if not (reached[-1] >= radii.max() and np.all(np.diff(reached) > 0)):
            return None
        by = sign * np.column_stack(
            [self.polynomials[:, :2] @ (1.0, film_distance_mm), self._changes @ (1.0, film_distance_mm)]
        )
        tangents = np.interp(radii, reached, places)
        for _ in range(_FAN_ROUNDS):
            scale, change = (self._terms(tangents) @ by).T
            tangents = tangents - (tangents * scale - radii) / (scale + 2 * tangents**2 * change)
        values = self._terms(tangents) @ self.polynomials
        values[:, :-2] *= sign * tangents[:, None]
        rims = np.array([surface.semi_diameter for surface in lens.surfaces])
        turns = film_points[:, :2] / np.maximum(radii, 1e-300)[:, None]
        return ChiefRays(
            np.column_stack([turns * values[:, 2:3], values[:, -2]]),
            np.column_stack([turns * values[:, 3:4], values[:, -1]]),
            np.ones(len(radii), dtype=bool),
            np.all(np.abs(values[:, 4:-2]) <= rims, axis=1),
            turns * values[:, :1],
        )


#
# Beams from the side or from behind: fields beyond those that a plane across the axis can tell.
#
# Rays are spread over a plane across the beam and met with the first surface, a sphere that bulges to the scene as
# those of fisheyes do; behind it they travel towards the film, and the lens behind the first surface takes them on.


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
    return _enter_rays(lens, origins, np.broadcast_to(along, origins.shape), wavelength_nm)


def _enter_rays(lens: Lens, origins: Array, directions: Array, wavelength_nm: float) -> Rays:
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
    surface = np.where(rays.surface < 0, -1, rays.surface + 1)
    return Rays(rays.origins + shift, rays.directions, status, surface, rays.optical_path)


def takes_steep_light(lens: Lens) -> bool:
    """Return whether the first surface is one that light from the side can meet here: a sphere about the axis."""
    first = lens.surfaces[0]
    plain = first.is_rotational and first.pose is None and first.region is None and first.is_sphere
    plain = plain and first.phase is None
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
        return _enter_rays(lens, *beam(points), wavelength_nm)

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
    points, size = _grid_points(box, COARSE)
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
            points, size = _grid_points(box, finer * count)
            rays = through(points)
            good = rays.passed
            if good.any() or count != counts[0]:
                break
        if not good.any():
            raise InputError(f"{lens.name}: nothing of {what} comes through")
        box = np.stack([points[good].min(axis=0) - size, points[good].max(axis=0) + size])
    return points[good], rays.some(good), float(size.prod())


def _grid_points(box: Array, count: int) -> tuple[Array, Array]:
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
    """How points of the film lie about their centroid. Lengths in millimetres.

    Attributes
    ----------
    rays : int
        How many points there are.
    centroid : tuple of float
    rms, rms_x, rms_y : float
        Root mean square distance from the centroid.
    largest : float
        Distance of the farthest point from it.
    """

    rays: int
    centroid: tuple[float, float]
    rms: float
    rms_x: float
    rms_y: float
    largest: float


def spot_of(points: Array) -> Spot:
    """Return the spot of points (n, 2)."""
    centroid = points.mean(axis=0)
    off = points - centroid
    variance = np.mean(off * off, axis=0)
    return Spot(
        rays=len(points),
        centroid=(float(centroid[0]), float(centroid[1])),
        rms=float(np.sqrt(variance.sum())),
        rms_x=float(np.sqrt(variance[0])),
        rms_y=float(np.sqrt(variance[1])),
        largest=float(np.hypot(off[:, 0], off[:, 1]).max()),
    )


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
    return spot_of(_on_film(lens, film_distance_mm, beam or Beam(), wavelength_nm, across, coarse)[0])


def shift_to_least_spot(
    lens: Lens,
    film_distance_mm: float,
    beam: Beam,
    wavelength_nm: float = LINE_D_NM,
    across: int = 256,
    coarse: int = COARSE,
) -> float:
    """Return how far along the light the film must move to where the spot of a beam is least [mm]; raises as `spot`."""
    film, slopes = _on_film(lens, film_distance_mm, beam, wavelength_nm, across, coarse)
    off, turn = film - film.mean(axis=0), slopes - slopes.mean(axis=0)
    spread = float(np.mean(np.sum(turn * turn, axis=1)))
    return -float(np.mean(np.sum(off * turn, axis=1))) / spread if spread > 0 else 0.0


def _on_film(
    lens: Lens, film_distance_mm: float, beam: Beam, wavelength_nm: float, across: int, coarse: int
) -> tuple[Array, Array]:
    """Return where the rays of a beam meet the film (n, 2), and by how much farther for each mm along the light."""
    _, rays, _ = passing_beam(lens, beam, wavelength_nm, across, coarse)
    film = at_plane(rays.origins, rays.directions, lens.film_z(film_distance_mm))[:, :2]
    return film, lens.sense * rays.directions[:, :2] / rays.directions[:, 2:]


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
