"""What a lens is: surfaces with their shape, clear region, place and coating, in a row from scene to film."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import SurfaceKind
from rptcam_cl.core.remember import Memory
from rptcam_cl.optics.glass import AIR, Coating, Medium, known_range
from rptcam_cl.optics.shapes import Form, Hits, Phase, Shape, shape_of_profile

# Shapes of an aperture stop: blades, stars, hearts and polygons inside the unit circle, which is the round stop.

Array = NDArray[np.float64]

_ARC_STEPS = 16  # straight pieces of a curved blade edge
_MOST_VERTICES = 1024
_SMALLEST_VIEW = 1e-6  # area that sees all of a shape, below which rounding might place its middle outside


@dataclass(frozen=True)
class StopShape:
    """A polygon that does not cross itself, inside the unit circle.

    Attributes
    ----------
    vertices : tuple of (x, y)
        In order, in units of the stop's radius; x to the right and y upwards as seen from the film.
    """

    vertices: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        points = np.array(self.vertices, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not 3 <= len(points) <= _MOST_VERTICES:
            raise InputError(f"a stop shape needs 3 to {_MOST_VERTICES} points [x, y]")
        if not np.all(np.isfinite(points)) or np.max(np.hypot(*points.T)) > 1 + 1e-9:
            raise InputError("the points of a stop shape must lie inside the unit circle")
        if not self.area > 0:
            raise InputError("a stop shape must enclose an area")

    @cached_property
    def triangles(self) -> Array:
        """Triangles (n, 3, 2) that make up the shape: a fan where one point sees all of it.

        Raises
        ------
        InputError
            When the outline crosses itself.
        """
        vertices = np.array(self.vertices, dtype=np.float64)
        if _crosses_itself(vertices):
            raise InputError("the outline of a stop shape crosses itself (allowed: a simple polygon)")
        counter_clockwise = vertices if _signed_area(vertices) > 0 else vertices[::-1]
        middle = _sees_all(counter_clockwise)
        if middle is None:
            return _cut_ears(counter_clockwise)
        apex = np.broadcast_to(middle, counter_clockwise.shape)
        return np.stack([apex, counter_clockwise, np.roll(counter_clockwise, -1, axis=0)], axis=1)

    @cached_property
    def triangle_areas(self) -> Array:
        """Their areas."""
        first, second = (self.triangles[:, k] - self.triangles[:, 0] for k in (1, 2))
        return np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2

    @property
    def area(self) -> float:
        """Area in units of the squared radius of the stop; a full circle has pi."""
        return float(self.triangle_areas.sum())

    def edges(self) -> Array:
        """Return (n, 4): y0, y1, x0 and dx/dy of every edge that is not level."""
        start = np.array(self.vertices, dtype=np.float64)
        end = np.roll(start, -1, axis=0)
        rises = start[:, 1] != end[:, 1]
        start, end = start[rises], end[rises]
        slope = (end[:, 0] - start[:, 0]) / (end[:, 1] - start[:, 1])
        return np.stack([start[:, 1], end[:, 1], start[:, 0], slope], axis=1)

    def holds(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Return which points, in units of the stop's radius, lie inside."""
        inside = np.zeros(np.shape(x), dtype=bool)
        for y0, y1, x0, slope in self.edges():
            inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * slope)
        return inside

    def sample(self, u: Array) -> Array:
        """Return points (n, 2) spread evenly over the shape for numbers (n, 3) in [0, 1); none is rejected."""
        ends = np.cumsum(self.triangle_areas) / self.area
        k = np.minimum(np.searchsorted(ends, u[:, 0], side="right"), len(ends) - 1)
        corner, first, second = (self.triangles[k, i] for i in range(3))
        root = np.sqrt(u[:, 1])
        a, b = (root * (1 - u[:, 2]))[:, None], (root * u[:, 2])[:, None]
        return np.asarray(corner + a * (first - corner) + b * (second - corner))


@dataclass(frozen=True, eq=False)
class StopMask:
    """A square grid of open and closed cells; its inscribed circle is the stop's.

    Attributes
    ----------
    cells : (n, n) boolean array
        Row 0 on top (+y), open where true.
    """

    cells: NDArray[np.bool_]

    @property
    def area(self) -> float:
        """Of the open cells, in units of the square of the stop's radius."""
        return float(self.cells.mean()) * 4.0

    def holds(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Return which points, in units of the stop's radius, lie in an open cell."""
        count = len(self.cells)
        places = (np.floor((1 - y) * count / 2), np.floor((1 + x) * count / 2))
        inside = np.logical_and.reduce([(place >= 0) & (place < count) for place in places])
        row, column = (np.where(inside, place, 0).astype(np.intp) for place in places)
        return np.asarray(inside & self.cells[row, column])


def fit_to_stop(points: ArrayLike) -> Array:
    """Return points (n, 2) moved and scaled so that the circle about the middle of their box holds them and touches."""
    moved = np.array(points, dtype=np.float64)
    moved -= (moved.min(axis=0) + moved.max(axis=0)) / 2
    return np.asarray(moved / np.hypot(*moved.T).max())


def _cut_ears(vertices: Array) -> Array:
    """Return triangles (n, 3, 2) that make up a counter-clockwise polygon, cutting off one corner after the other."""
    rest = list(vertices)
    triangles = []
    while len(rest) > 3:
        # Corners in one line are no ears; where rounding leaves nothing else, any corner may go.
        ear = next((i for i in range(len(rest)) if _is_ear(rest, i)), 0)
        triangles.append([rest[ear - 1], rest[ear], rest[(ear + 1) % len(rest)]])
        del rest[ear]
    return np.array([*triangles, rest])


def _signed_area(vertices: Array) -> float:
    """Return the area of a polygon, positive counter-clockwise."""
    x, y = vertices.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


def cut_polygon(polygon: Array, side: Array) -> Array:
    """Return the part of a polygon (n, any) on one side of a plane; ``side`` (n,) grows with the distance from it.

    Sutherland and Hodgman 1974.
    """
    following, after = np.roll(polygon, -1, axis=0), np.roll(side, -1)
    crossing = (side < 0) != (after < 0)
    share = np.where(crossing, side / np.where(crossing, side - after, 1.0), 0.0)[:, None]
    both = np.stack([polygon, polygon + share * (following - polygon)], axis=1)
    return np.asarray(both[np.stack([side >= 0, crossing], axis=1)])


def _sees_all(vertices: Array) -> Array | None:
    """Return a point (2,) from which all of a counter-clockwise polygon is seen; None where there is next to none."""
    seen = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])  # what lies left of every edge
    for start, end in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        along = end - start
        seen = cut_polygon(seen, along[0] * (seen[:, 1] - start[1]) - along[1] * (seen[:, 0] - start[0]))
        if len(seen) < 3:
            return None
    return np.asarray(seen.mean(axis=0)) if _signed_area(seen) > _SMALLEST_VIEW else None


def _crosses_itself(vertices: Array) -> bool:
    """Return whether two edges of a polygon cross."""
    start, along = vertices, np.roll(vertices, -1, axis=0) - vertices

    def sides(of: Array) -> Array:
        """On which side of edge i (rows) each point of `of` lies."""
        away = of[None, :, :] - start[:, None, :]
        return np.asarray(np.sign(along[:, None, 0] * away[..., 1] - along[:, None, 1] * away[..., 0]))

    parted = sides(start) * sides(np.roll(start, -1, axis=0)) < 0
    return bool(np.any(parted & parted.T))


def _is_ear(polygon: list[Array], i: int) -> bool:
    a, b, c = polygon[i - 1], polygon[i], polygon[(i + 1) % len(polygon)]
    if _turn(a, b, c) <= 0:
        return False
    others = (p for p in polygon if p is not a and p is not b and p is not c)
    return not any(_turn(a, b, p) >= 0 and _turn(b, c, p) >= 0 and _turn(c, a, p) >= 0 for p in others)


def _turn(a: Array, b: Array, c: Array) -> float:
    """Return twice the signed area of a triangle, positive counter-clockwise."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def blades(count: int, rotation_degrees: float = 0.0, curvature: float = 0.0) -> StopShape:
    """Return an iris of blades: corners on the circle, edges straight (curvature 0) to circular (1)."""
    if not 3 <= count <= 64:
        raise InputError(f"an iris has 3 to 64 blades (got {count})")
    if not 0 <= curvature <= 1:
        raise InputError(f"the curvature of blades lies between 0 and 1 (got {curvature:g})")
    steps = 1 if curvature == 0 else _ARC_STEPS
    angles = np.arange(count * steps) * 2 * np.pi / (count * steps)
    within = np.mod(angles, 2 * np.pi / count) - np.pi / count
    straight = np.cos(np.pi / count) / np.cos(within)
    return _shape(angles, (1 - curvature) * straight + curvature, rotation_degrees)


def star(points: int, inner: float = 0.4, rotation_degrees: float = 90.0) -> StopShape:
    """Return a star whose inner corners lie at a share of the radius."""
    if not 3 <= points <= 64:
        raise InputError(f"a star has 3 to 64 points (got {points})")
    if not 0 < inner < 1:
        raise InputError(f"the inner radius of a star lies between 0 and 1 (got {inner:g})")
    angles = np.arange(2 * points) * np.pi / points
    return _shape(angles, np.where(np.arange(2 * points) % 2 == 0, 1.0, inner), rotation_degrees)


def heart(rotation_degrees: float = 0.0) -> StopShape:
    """Return a heart, upright as seen from the film: x = 16 sin^3 t, y = 13 cos t - 5 cos 2t - 2 cos 3t - cos 4t."""
    t = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    x = -16 * np.sin(t) ** 3
    y = 13 * np.cos(t) - 5 * np.cos(2 * t) - 2 * np.cos(3 * t) - np.cos(4 * t)
    radius, angles = np.hypot(x, y), np.arctan2(y, x)
    return _shape(angles, radius / radius.max(), rotation_degrees)


def polygon(points: ArrayLike, rotation_degrees: float = 0.0) -> StopShape:
    """Return a polygon of points in units of the stop's radius, turned from +x towards +y."""
    flat = np.array(points, dtype=np.float64)
    if flat.ndim != 2 or flat.shape[1] != 2:
        raise InputError("a stop shape is a list of points [x, y]")
    if rotation_degrees:
        c, s = math.cos(math.radians(rotation_degrees)), math.sin(math.radians(rotation_degrees))
        flat = flat @ np.array([[c, s], [-s, c]])
    return StopShape(tuple((float(x), float(y)) for x, y in flat))


def _shape(angles: Array, radii: Array, rotation_degrees: float) -> StopShape:
    turn = angles + math.radians(rotation_degrees)
    points = np.stack([radii * np.cos(turn), radii * np.sin(turn)], axis=1)
    return StopShape(tuple((float(x), float(y)) for x, y in points))


# Decentre and tilt of a surface against its nominal place in the lens.

_RIGHT_ANGLE = 1e-8  # cosine of a turn below which it is one


@dataclass(frozen=True)
class SurfacePose:
    """Where a surface is: vertex moved by `offset` [mm], axes turned by `rotation` (rows of a matrix).

    A point p of the nominal vertex frame has the coordinates rotation^T (p - offset) in the frame of the surface.
    """

    offset: tuple[float, float, float]
    rotation: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

    @staticmethod
    def of(decentre: tuple[float, float, float], tilt_degrees: tuple[float, float, float]) -> SurfacePose:
        """Return the pose of a decentre [mm] and of tilts about the x, then y, then z axis [degrees]."""
        return SurfacePose._from(np.asarray(decentre, dtype=np.float64), rotation_matrix(tilt_degrees))

    @staticmethod
    def _from(offset: Array, rotation: Array) -> SurfacePose:
        rows = [tuple(float(value) for value in row) for row in rotation]
        return SurfacePose(tuple(float(value) for value in offset), tuple(rows))  # type: ignore[arg-type]

    def matrix(self) -> Array:
        """Return the rotation as an array (3, 3)."""
        return np.array(self.rotation)

    def carried_by(self, group: SurfacePose, from_pivot: float) -> SurfacePose:
        """Return this pose after a group turned and moved it, whose pivot lies `from_pivot` [mm] before this vertex."""
        turn = group.matrix()
        place = np.array([0.0, 0.0, from_pivot])
        offset = turn @ (place + np.array(self.offset)) - place + np.array(group.offset)
        return SurfacePose._from(offset, turn @ self.matrix())

    def inward(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Return points and directions (3, n) of the nominal frame in the frame of the surface."""
        back = self.matrix().T
        return back @ (points - np.array(self.offset)[:, None]), back @ directions

    def outward(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Return points and directions (3, n) of the frame of the surface in the nominal frame."""
        turn = self.matrix()
        return turn @ points + np.array(self.offset)[:, None], turn @ directions


IN_PLACE = SurfacePose((0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


def rotation_matrix(tilt_degrees: tuple[float, float, float]) -> Array:
    """Return the matrix of turns about the x, then y, then z axis [degrees], right handed."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(tilt_degrees)), np.sin(np.radians(tilt_degrees))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x, dtype=np.float64)


def tilt_of(rotation: Array) -> tuple[float, float, float]:
    """Return the turns about the x, then y, then z axis [degrees] that make up a rotation.

    Turned by a right angle about y, x and z are one axis, and all of the rest is a turn about x.
    """
    r = rotation
    across = float(np.hypot(r[0, 0], r[1, 0]))
    y = np.arctan2(-r[2, 0], across)
    x, z = (
        (np.arctan2(-r[1, 2], r[1, 1]), 0.0)
        if across < _RIGHT_ANGLE
        else (np.arctan2(r[2, 1], r[2, 2]), np.arctan2(r[1, 0], r[0, 0]))
    )
    return float(np.degrees(x)), float(np.degrees(y)), float(np.degrees(z))


# Clear regions beyond the circular rim: a rectangle, a half plane, circles beside the axis, and what lies outside.

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Region:
    """Part of a surface's vertex plane, within its rim.

    Attributes
    ----------
    half_width, half_height : float
        The rectangle |x| <= half_width, |y| <= half_height [mm].
    normal_degrees : float or None
        Of a half plane: direction from the axis into it, from +x towards +y.
    edge : float
        Of a half plane: distance of its edge from the axis along that direction [mm].
    blocks : bool
        True: rays outside are clipped. False: there is nothing outside, and rays go straight on; so half a lens before
        another one makes a split dioptre. Every surface of such a half lens carries the same region, and the medium
        on its two sides is the same.
    inverted : bool
        Whether the clear area is what lies outside of all of these.
    centre : (x, y)
        Of the rectangle and the circles [mm].
    radius, inner_radius : float
        Of a circle that holds the clear area, and of one that is not clear [mm].
    """

    half_width: float = np.inf
    half_height: float = np.inf
    normal_degrees: float | None = None
    edge: float = 0.0
    blocks: bool = True
    inverted: bool = False
    centre: tuple[float, float] = (0.0, 0.0)
    radius: float = np.inf
    inner_radius: float = 0.0

    @property
    def is_round(self) -> bool:
        """Whether it has a circle, or lies beside the axis."""
        return self.centre != (0.0, 0.0) or np.isfinite(self.radius) or self.inner_radius > 0

    def holds(self, x: Array, y: Array) -> Mask:
        """Return which points lie inside."""
        across, up = x - self.centre[0], y - self.centre[1]
        inside = (np.abs(across) <= self.half_width) & (np.abs(up) <= self.half_height)
        if self.is_round:
            square = across * across + up * up
            inside &= (square <= self.radius * self.radius) & (square >= self.inner_radius * self.inner_radius)
        if self.normal_degrees is not None:
            angle = np.radians(self.normal_degrees)
            inside &= x * np.cos(angle) + y * np.sin(angle) >= self.edge
        return np.asarray(inside != self.inverted)


def sides(region: Region | None, previous: Region | None, x: Array, y: Array, beside: Mask) -> tuple[Mask, Mask]:
    """Return which rays pass beside the glass of a half lens, and which do not run into its cut face.

    Parameters
    ----------
    region, previous
        Of the surface at hand and of the one before it in the order of travel; equal ones are one half lens.
    x, y
        Where rays meet the surface.
    beside
        Which rays passed beside the surface before.
    """
    if region is None or region.blocks:
        return np.zeros_like(beside), np.ones_like(beside)
    out = ~region.holds(x, y)
    return (beside, out == beside) if region == previous else (out, np.ones_like(beside))


# A refracting or reflecting surface, or a stop: its shape about the vertex, its clear region, the medium behind it.


@dataclass(frozen=True)
class Surface:
    """An interface between two media or a mirror, in the frame of its vertex (+z towards the film).

    The plain surface is a sphere or plane: curvature alone. With s = x^2 + y^2 (or x^2, or y^2, for a cylinder),

        z = c s / (1 + sqrt(1 - (1 + k) c^2 s)) + sum of a_p s^(p/2).

    Attributes
    ----------
    curvature : float
        c = 1 / radius [1/mm], positive when the centre lies on the film side; 0 is a plane.
    thickness : float
        Distance to the vertex of the next surface along +z [mm], negative where a mirror has sent the light back; 0 on
        the last one, whose distance to the film is the focus.
    glass : Medium
        Medium that the light enters behind the surface; of a mirror the one that it comes from.
    semi_diameter : float
        Clear radius [mm]: rays that meet the surface farther from the axis are clipped.
    inner_semi_diameter : float
        Radius of a hole or an obstruction [mm]: rays that meet the surface nearer to the axis are clipped.
    is_stop : bool
        Whether this is the aperture stop.
    is_mirror : bool
        Whether it reflects the light.
    body_per_k : float or None
        Linear expansion of the body behind a mirror in air [1/K], where it is known.
    conic : float
        k: 0 sphere, -1 paraboloid, below -1 hyperboloid.
    aspheric : tuple of (power, coefficient)
        The a_p with their powers p of r, in millimetres.
    cylinder : "x", "y" or None
        The only axis along which the surface curves.
    form : Form or None
        What makes it more than this profile, such as a `Biconic` or a `Toroid`.
    pose : SurfacePose or None
        Decentre and tilt against the nominal vertex frame.
    region : Region or None
        A further limit of the clear area, and what happens outside.
    stop_shape : StopShape, StopMask or None
        Shape of the opening of a stop inside its semi-diameter; None for a round one.
    coating : Coating or None
        What lies on the surface; None where nothing is said.
    phase : Phase or None
        What bends rays beyond the media beside it: a grating, a diffractive surface or an ideal lens.
    """

    curvature: float = 0.0
    thickness: float = 0.0
    glass: Medium = AIR
    semi_diameter: float = np.inf
    inner_semi_diameter: float = 0.0
    is_stop: bool = False
    is_mirror: bool = False
    conic: float = 0.0
    aspheric: tuple[tuple[int, float], ...] = ()
    cylinder: str | None = None
    form: Form | None = None
    pose: SurfacePose | None = None
    region: Region | None = None
    stop_shape: StopShape | StopMask | None = None
    coating: Coating | None = None
    phase: Phase | None = None
    body_per_k: float | None = None

    @property
    def radius(self) -> float:
        """Radius of curvature [mm], infinite for a plane."""
        return 1.0 / self.curvature if self.curvature else np.inf

    @property
    def shape(self) -> Shape:
        """The kind of surface that it is."""
        return self.form or shape_of_profile(self)

    @property
    def is_sphere(self) -> bool:
        """Whether it is a sphere or a plane."""
        return self.shape.kind == SurfaceKind.SPHERE

    @property
    def is_rotational(self) -> bool:
        """Whether the surface and its clear region, but for the shape of a stop, look the same from every azimuth."""
        turns_alike = self.phase is None or self.phase.is_rotational
        return turns_alike and not (self.cylinder or self.form or self.pose or self.region)

    @property
    def is_even(self) -> bool:
        """Whether the surface and its clear region look the same in a mirror along x, and in one along y."""
        return not (self.pose or self.region) and (self.phase is None or self.phase.is_rotational)

    def filled(self) -> Surface:
        """Return the surface without a hole or an obstruction in its middle, a stop being round."""
        return replace(self, inner_semi_diameter=0.0, stop_shape=None)

    def open(self) -> Surface:
        """Return the surface as one that stops no ray."""
        return replace(self, semi_diameter=np.inf, inner_semi_diameter=0.0, stop_shape=None, region=None)

    def clears(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Return which points of the vertex plane light is not blocked at."""
        square = x * x + y * y
        inside = square <= self.semi_diameter * self.semi_diameter
        if self.inner_semi_diameter:
            inside = inside & (square >= self.inner_semi_diameter * self.inner_semi_diameter)
        if self.region and self.region.blocks:
            inside = inside & self.region.holds(x, y)
        if self.stop_shape:
            inside = inside & self.stop_shape.holds(x / self.semi_diameter, y / self.semi_diameter)
        return inside

    def axes(self) -> tuple[float, float]:
        """Return the weights of x^2 and y^2 in s: 1 where the surface curves."""
        return (0.0 if self.cylinder == "y" else 1.0, 0.0 if self.cylinder == "x" else 1.0)

    def paraxial_curvature(self, section: str = "y") -> float:
        """Return the curvature at the vertex in the y-z or x-z section [1/mm], the r^2 term of an asphere included."""
        return self.shape.paraxial_curvature(self, section)

    def meet(self, points: Array, directions: Array) -> Hits:
        """Return where rays, points and directions (3, n), meet the part of the surface about its vertex."""
        return self.shape.meet(self, points, directions)

    def sag_and_slopes(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy above points of the vertex plane; NaN where the surface does not reach."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.shape.sag_and_slopes(self, x, y)

    def sag(self, x: Array, y: Array) -> Array:
        """Return z of the surface above points of its vertex plane [mm]; NaN where it does not reach."""
        return self.sag_and_slopes(x, y)[0]

    def rim_sag(self, height: float | None = None) -> float:
        """Return the sag [mm] at a height from the axis, by default at the rim, along the axis where it curves."""
        y = np.array(self.semi_diameter if height is None else height, dtype=np.float64)
        zero = np.zeros(())
        return float(self.sag(y, zero) if self.cylinder == "x" else self.sag(zero, y))


# What a lens is: surfaces in a row from scene to film and its settings. Lengths in millimetres, float64.

FEW = 16  # wavelengths of which indices are remembered
REMEMBERED = 256  # rows of media at some wavelengths, whose indices are remembered
# f/2, F2.8 and F/1.4 in a name; not f = 50 mm, nor F50
_SPEED = re.compile(r"(?<![A-Za-z])[fF](?:\s?/\s?|(?=\d{1,2}\.\d))(\d{1,2}(?:\.\d+)?)(?![\d.]*\s?mm)")
_INDICES: Memory[tuple[tuple[Medium, ...], Array]] = Memory(REMEMBERED)


@dataclass(frozen=True)
class Configuration:
    """One published state of a zoom lens.

    Attributes
    ----------
    name : str
    gaps : tuple of (surface, thickness)
        Thickness behind each surface whose gap varies [mm].
    stop_diameter_mm : float or None
        Stop diameter of this state when it differs.
    floating : tuple of FocusState
        Gaps at nearer object planes in this state.
    """

    name: str
    gaps: tuple[tuple[int, float], ...]
    stop_diameter_mm: float | None = None
    floating: tuple[FocusState, ...] = ()


@dataclass(frozen=True)
class FocusingGroup:
    """Neighbouring surfaces that move together to focus.

    Attributes
    ----------
    first, last : int
        Surfaces of the group.
    travel_mm : tuple of float
        Least and greatest shift towards the film; 0 is the place in the table.
    """

    first: int
    last: int
    travel_mm: tuple[float, float]


@dataclass(frozen=True)
class FocusMotor:
    """What drives the focus.

    Attributes
    ----------
    speed_mm_s, acceleration_mm_s2 : float
        At most, of what moves: the lens, its group, or where groups float the gap that changes most.
    source : str
        Where the figures come from.
    """

    speed_mm_s: float
    acceleration_mm_s2: float
    source: str = ""


@dataclass(frozen=True)
class FocusState:
    """The gaps of a lens whose groups float, focused at one distance.

    Attributes
    ----------
    distance_mm : float
        From the object plane to the film.
    gaps : tuple of (surface, thickness)
        Thickness behind each surface whose gap varies [mm].
    film_shift_mm : float or None
        How much farther the film is from the last vertex than at infinity: 0 where neither moves, None where it is not
        said, and the film follows the image.
    """

    distance_mm: float
    gaps: tuple[tuple[int, float], ...]
    film_shift_mm: float | None = None


@dataclass(frozen=True)
class Prescription:
    """Surfaces from scene to film. The first vertex is the origin; +z points to the film.

    Attributes
    ----------
    name, source : str
        What it is called and where its numbers come from.
    published : mapping
        First-order data that the source claims, such as ``focal_length_mm`` and ``f_number``.
    surfaces : tuple of Surface
        In the order in which light from the scene meets them.
    stop_index : int or None
        Which surface is the aperture stop; None when only the rims limit the light.
    object_medium : Medium
        What lies in front of the first surface.
    configurations : tuple of Configuration
        States of a zoom lens, by rising or falling focal length; the lens itself is in the first one.
    focusing : FocusingGroup or None
        Surfaces that move to focus; None when the whole lens does.
    floating : tuple of FocusState
        Gaps at nearer object planes, of a lens whose groups move each its own way to focus; the lens itself is focused
        at infinity.
    motor : FocusMotor or None
        What drives the focus; None where its file says nothing of it.
    warnings : tuple of str
        Doubts about the prescription that do not make it unusable.
    first_sense : float
        Which way light comes to the first surface: 1 to +z; -1 for a part of a lens that begins behind a mirror.
    fold : SurfacePose or None
        How the axes of the scene stand in the frame of the lens, whose z is the axis of the film; None where mirrors do
        not fold the axis. Rays before the first surface are then counted in the axes of the scene.
    """

    name: str
    surfaces: tuple[Surface, ...]
    stop_index: int | None = None
    source: str = ""
    published: Mapping[str, Any] = field(default_factory=dict)
    object_medium: Medium = AIR
    configurations: tuple[Configuration, ...] = ()
    focusing: FocusingGroup | None = None
    floating: tuple[FocusState, ...] = ()
    warnings: tuple[str, ...] = ()
    first_sense: float = 1.0
    fold: SurfacePose | None = None
    motor: FocusMotor | None = None

    def with_changes(self, changes: Mapping[int, Mapping[str, Any]], **of_lens: Any) -> Self:
        """Return the lens with attributes of some surfaces changed, by their numbers, and perhaps some of its own."""
        surfaces = list(self.surfaces)
        for k, attributes in changes.items():
            surfaces[k] = replace(surfaces[k], **attributes)
        return replace(self, surfaces=tuple(surfaces), **of_lens)

    def of_surfaces(self, surfaces: Iterable[Surface], stop_index: int | None, **of_lens: Any) -> Self:
        """Return a lens of other surfaces, which neither zooms nor moves to focus."""
        fixed: dict[str, Any] = {"configurations": (), "focusing": None, "floating": ()}
        return replace(self, surfaces=tuple(surfaces), stop_index=stop_index, **fixed, **of_lens)

    @property
    def marked_f_number(self) -> float | None:
        """F-number that it is sold with: `marked_f_number` of its file, else the least of source and name."""
        said = self.published.get("marked_f_number")
        if said is not None:
            return float(said)
        title = _SPEED.search(self.name)
        claims = [self.published.get("f_number"), float(title[1]) if title else None]
        numbers = [float(n) for n in claims if isinstance(n, int | float) and not isinstance(n, bool) and n > 0]
        return min(numbers, default=None)

    @property
    def focuses_by_group(self) -> bool:
        """Whether groups move in it to focus while it is known where the film stands."""
        shifts = [state.film_shift_mm for state in self.floating]
        return self.focusing is not None or (bool(shifts) and None not in shifts)

    @cached_property
    def vertices(self) -> Array:
        """Position z of each vertex [mm]."""
        gaps = [surface.thickness for surface in self.surfaces[:-1]]
        return np.concatenate([[0.0], np.cumsum(gaps)])

    @cached_property
    def shifts(self) -> Array:
        """The vertices as points (surfaces, 3, 1)."""
        points = np.zeros((len(self.surfaces), 3, 1))
        points[:, 2, 0] = self.vertices
        return points

    @cached_property
    def axial_shifts(self) -> list[float]:
        """How far each vertex stands behind its place along the axis [mm]; where mirrors fold that, 0: it bends on."""
        return [surface.pose.offset[2] if surface.pose and not self.fold else 0.0 for surface in self.surfaces]

    @property
    def length(self) -> float:
        """Position z of the last vertex [mm]: how far it lies from the first one."""
        return float(self.vertices[-1])

    @cached_property
    def senses(self) -> Array:
        """Which way light from the scene travels before the first surface and behind each one: 1 to +z, -1 to -z."""
        turns = [-1.0 if surface.is_mirror else 1.0 for surface in self.surfaces]
        return self.first_sense * np.concatenate([[1.0], np.cumprod(turns)])

    @property
    def sense(self) -> float:
        """Which way light travels to the film: 1 to +z, -1 to -z behind an odd number of mirrors."""
        return float(self.senses[-1])

    def from_scene_axes(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Return points and directions (3, n) of the axes of the scene in the frame of the lens."""
        return self.fold.outward(points, directions) if self.fold else (points, directions)

    def in_scene_axes(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Return points and directions (3, n) of the frame of the lens in the axes of the scene."""
        return self.fold.inward(points, directions) if self.fold else (points, directions)

    @property
    def has_mirrors(self) -> bool:
        """Whether any surface reflects."""
        return any(surface.is_mirror for surface in self.surfaces)

    @property
    def phases(self) -> list[Phase]:
        """The gratings, diffractive surfaces and ideal lenses in it."""
        return [surface.phase for surface in self.surfaces if surface.phase is not None]

    def refuse_phases(self, what: str) -> None:
        """Raise an error where a surface does more than refract or reflect; `what` takes no such lens."""
        for k, surface in enumerate(self.surfaces):
            if surface.phase is not None:
                raise InputError(f"{self.name}: surface {k} is {surface.phase.description}; {what}")

    @property
    def is_obstructed(self) -> bool:
        """Whether any surface has a hole or an obstruction in its middle."""
        return any(surface.inner_semi_diameter > 0 for surface in self.surfaces)

    @property
    def is_split(self) -> bool:
        """Whether light passes beside some of its surfaces, as beside a half lens before another one."""
        return any(surface.region is not None and not surface.region.blocks for surface in self.surfaces)

    def film_z(self, distance_mm: float) -> float:
        """Return z of a plane at a distance behind the last vertex, along the light [mm]."""
        return self.length + self.sense * distance_mm

    @property
    def stop(self) -> Surface | None:
        """The surface that is the stop, if there is one."""
        return None if self.stop_index is None else self.surfaces[self.stop_index]

    @property
    def media(self) -> tuple[Medium, ...]:
        """The medium before the first surface and after each one."""
        return (self.object_medium, *(surface.glass for surface in self.surfaces))

    def indices(self, wavelength_nm: ArrayLike = LINE_D_NM) -> Array:
        """Return the index before the first surface and after each one, shape (n + 1, *wavelengths); not to be changed.

        Those of few wavelengths are remembered, as all states of a lens have the same media.
        """
        media, nm = self.media, np.asarray(wavelength_nm, np.float64)
        if nm.size > FEW:
            return np.stack([medium.index(wavelength_nm) for medium in media])

        def media_and_indices() -> tuple[tuple[Medium, ...], Array]:
            values = np.stack([medium.index(wavelength_nm) for medium in media])
            values.flags.writeable = False
            return media, values  # and the media are kept, so that no others get their ids

        return _INDICES.find_or_make((nm.tobytes(), nm.shape, *map(id, media)), media_and_indices)[1]

    @property
    def known_nm(self) -> tuple[float, float]:
        """Wavelengths that every medium is known for [nm]; without limits, 0 and infinity."""
        media = [self.object_medium, *(surface.glass for surface in self.surfaces)]
        limits = [limit for medium in media if (limit := known_range(medium)) is not None]
        return max((low for low, _ in limits), default=0.0), min((high for _, high in limits), default=float("inf"))

    @property
    def has_power(self) -> bool:
        """Whether any surface bends light: a stop alone, or plane glass, does not."""
        curved = any(surface.paraxial_curvature(section) for surface in self.surfaces for section in ("x", "y"))
        return curved or any(phase.power(LINE_D_NM) for phase in self.phases)

    @property
    def is_rotational(self) -> bool:
        """Whether the lens looks the same from every azimuth."""
        return all(surface.is_rotational for surface in self.surfaces)
