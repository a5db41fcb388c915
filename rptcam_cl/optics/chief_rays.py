"""Chief rays of film points: the one ray of each that goes through the centre of the stop, singly or from one fan."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.remember import remember
from rptcam_cl.optics.lens import limiting_surface, system_matrix
from rptcam_cl.optics.ray_trace import L, passing, trace, trace_crossings

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens
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
    heights, *out = trace_crossings(lens, range(len(lens.surfaces) - 1, -1, -1), p, d, lens.indices(wavelength_nm))
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
RETRIES = 4  # from neighbours, where the first guess led nowhere


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

    def axis_points(self) -> Array:
        """Return z (n,) where the rays, drawn on into the lens, come nearest to the axis [mm]; not-a-number along it.

        This is where the entrance pupil lies that a point in their direction sees.
        """
        across = np.sum(self.directions[:, :2] ** 2, axis=1)
        with np.errstate(all="ignore"):
            step = -np.sum(self.origins[:, :2] * self.directions[:, :2], axis=1) / across
            return np.where(across > 1e-14, self.origins[:, 2] + step * self.directions[:, 2], np.nan)


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
    for _ in range(RETRIES):
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
STEPS_OF_TANGENT = 8  # widths of fans while the tangent at the stop doubles
WIDER = 12  # steps by which a fan may have to be wider than first-order optics says
PLACES = 65  # at which a search begins
FAN_ROUNDS = 2  # of Newton's method, from within 1e-5
TELLS_APART = 10  # decimals of millimetres by which distances of film points from the axis differ
REMEMBERED = 128  # lenses whose fans are kept


def round_chief_rays(lens: Lens, film_points: Array, wavelength_nm: float = LINE_D_NM) -> ChiefRays:
    """Return the rays of `film_chief_rays` for a round lens and points (n, 3) of one plane across its axis."""
    if (by_fan := fan_chief_rays(lens, film_points, wavelength_nm)) is not None:
        return by_fan
    distances, turns = np.hypot(*film_points[:, :2].T), np.arctan2(film_points[:, 1], film_points[:, 0])
    _, first, which = np.unique(np.round(distances, TELLS_APART), return_index=True, return_inverse=True)
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
    step = math.ceil(STEPS_OF_TANGENT * math.log2(tangent))
    for width in range(step, step + WIDER):
        if width not in fans:
            fans[width] = _trace_fan(lens, stop, wavelength_nm, 2.0 ** (width / STEPS_OF_TANGENT))
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


def _trace_fan(lens: Lens, stop: int, wavelength_nm: float, tangent: float) -> _Fan | None:
    """Return the fan up to a tangent; None where a ray is lost or it is not smooth enough."""
    fans = (_with_nodes(lens, stop, wavelength_nm, tangent, count) for count in NODES)
    return next((fan for fan in fans if fan is not None), None)


def _with_nodes(lens: Lens, stop: int, wavelength_nm: float, tangent: float, count: int) -> _Fan | None:
    """Return a fan by rays at some nodes; None where a ray is lost or so few nodes leave errors."""
    nodes, to_polynomials = chebyshev_nodes(count)
    tangents = tangent * np.sqrt((1.0 + nodes) / 2)
    indices = lens.indices(wavelength_nm)
    points = np.zeros((3, count))
    points[2] = lens.vertices[stop]
    to_film = np.stack([tangents, np.zeros(count), np.ones(count)]) / np.hypot(1.0, tangents)
    behind, p, d = trace_crossings(lens, range(stop, len(lens.surfaces)), points, to_film, indices, towards_film=True)
    ahead, origins, away = trace_crossings(lens, range(stop - 1, -1, -1), points, -to_film, indices)
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
        for _ in range(FAN_ROUNDS):
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
