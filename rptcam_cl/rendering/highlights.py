"""Lamps that the front of a lens sees mirrored in polished surfaces, as pencils of light."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from enum import IntEnum
from functools import partial
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.records import EmitterKind, Hidden, Kind
from rptcam_cl.device.session import Session
from rptcam_cl.optics.lens import Lens
from rptcam_cl.rendering.lamps import (
    FLAT,
    MOST_SOURCES,
    POINTS,
    Front,
    Patches,
    Points,
    Sources,
    comes_from_ahead,
    front_of,
    lattice,
    occluded,
    points_alone,
    points_of,
)  # fmt: skip
from rptcam_cl.rendering.plan.geometry import PackedMeshes
from rptcam_cl.rendering.plan.materials import SPREADING_ALPHA, Lobe, lobes_of
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.changes import at_opening
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Polished surfaces of a scene in pieces: points and normals of each by two coordinates, in float64.

ROUND = (Kind.SPHERE, Kind.ELLIPSOID, Kind.CYLINDER, Kind.CONE)
PART = 1 << 14  # triangles of a mesh at a time
AROUND, _UPWARDS, ALONG = 24, 12, 8  # pieces of round shapes
WORTH = 8000  # triangles of meshes that take as long as a round shape


class Outline(IntEnum):
    """Which coordinates a piece has."""

    TRIANGLE = 0
    SQUARE = 1
    DISK = 2
    ENDLESS = 3


class Bend(IntEnum):
    """How the plane of a piece is bent: not at all, or onto a canonical shape."""

    FLAT = 0
    SPHERE = 1
    CYLINDER = 2
    CONE = 3


@dataclass(frozen=True, eq=False)
class MirrorFaces(Rows):
    """Pieces of surfaces.

    Attributes
    ----------
    corner, first, second : (n, 3) arrays
        A point of the piece is at the corner + a first + b second, in the world about the eye [m]; of round pieces in
        the frame of the canonical shape, onto which it is then moved.
    normals : (n, 3, 3) array
        At the corner, and what they gain along the two edges; of round pieces they are not used.
    placement, outwards : (n, 3, 4) and (n, 3, 3) arrays
        Of round pieces, to the world; and of their normals.
    outline, bend : (n,) arrays
        See `Outline` and `Bend`.
    material, primitive : (n,) arrays
        Indices in the plan.
    """

    corner: Array
    first: Array
    second: Array
    normals: Array
    placement: Array
    outwards: Array
    outline: Indices
    bend: Indices
    material: Indices
    primitive: Indices

    @property
    def plain(self) -> NDArray[np.bool_]:
        """Which are flat, with one normal."""
        return np.asarray((self.bend == Bend.FLAT) & ~self.normals[:, 1:].any(axis=(1, 2)))

    def at(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Return points and unit normals (n, 3) at coordinates (n,)."""
        points = self.corner + a[:, None] * self.first + b[:, None] * self.second
        normals = self.normals[:, 0] + a[:, None] * self.normals[:, 1] + b[:, None] * self.normals[:, 2]
        for bend in (Bend.SPHERE, Bend.CYLINDER, Bend.CONE):
            own = self.bend == bend
            if own.any():
                on, out = _on_shape(bend, points[own])
                points[own] = np.einsum("nij,nj->ni", self.placement[own, :, :3], on) + self.placement[own, :, 3]
                normals[own] = np.einsum("nij,nj->ni", self.outwards[own], out)
        return points, normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]

    def holds(self, a: Array, b: Array) -> NDArray[np.bool_]:
        """Return whether coordinates are within the pieces."""
        ranged = (a >= 0) & (b >= 0) & (a < 1) & (b < 1)
        inside = [ranged & (a + b < 1), ranged, (2 * a - 1) ** 2 + (2 * b - 1) ** 2 < 1, np.isfinite(a + b)]
        return np.asarray(np.choose(self.outline, inside))


def polished_faces(plan: Plan) -> Iterator[MirrorFaces]:
    """Yield the pieces of what reflects like a mirror, or nearly, as it stands when the shutter opens."""
    flats = []
    instances = np.zeros(0) if plan.meshes is None else plan.meshes.instances()
    for index, kind in _polished_primitives(plan):
        record = plan.primitives[index]
        if kind is Kind.MESH and plan.meshes is not None:
            yield from _of_mesh(plan.meshes, instances[record["instance"]], record, index)
            continue
        corners, bend, outline, placement = _of_shape(record, kind)
        faces = _faces(corners, None, bend, outline, placement, int(record["material"]), index)
        if bend is Bend.FLAT:
            flats.append(faces)
        else:
            yield faces
    if flats:
        yield MirrorFaces.joined(flats)


def _polished_count(plan: Plan) -> int:
    """How many triangles take as long to search as all that `polished_faces` yields, about."""
    count = 0
    for index, kind in _polished_primitives(plan):
        if kind is Kind.MESH and plan.meshes is not None:
            count += len(_triangles(plan.meshes, plan.primitives[index], index))
        else:
            count += WORTH if kind in ROUND else 1
    return count


def _polished_primitives(plan: Plan) -> Iterator[tuple[int, Kind]]:
    """Yield the primitives that reflect like a mirror, or nearly, and that the camera sees, and their kinds."""
    polished = np.array([any(True for _ in lobes_of(plan.materials, index)) for index in range(len(plan.materials))])
    if not polished.any():
        return
    seen = plan.hidden[: plan.primitive_count] & Hidden.FROM_CAMERA == 0
    own = np.flatnonzero(polished[plan.primitives["material"][: plan.primitive_count]] & seen)
    kinds = np.searchsorted(plan.kind_end, own, side="right")
    found = ((int(index), Kind(int(kind))) for index, kind in zip(own, kinds, strict=True))
    yield from ((index, kind) for index, kind in found if kind is not Kind.CURVE)  # too fine for a mirror image


def _on_shape(bend: Bend, points: Array) -> tuple[Array, Array]:
    """Return points moved onto a canonical shape, and what is normal to it there."""
    if bend is Bend.SPHERE:
        on = points / np.maximum(np.linalg.norm(points, axis=1), 1e-300)[:, None]
        return on, on
    along = points[:, 2:]
    lean = 1.0 if bend is Bend.CONE else 0.0
    out = points[:, :2] / np.maximum(np.linalg.norm(points[:, :2], axis=1), 1e-300)[:, None]
    width = 1.0 - lean * along
    return np.concatenate([width * out, along], axis=1), np.concatenate([out, np.full_like(along, lean)], axis=1)


def _faces(
    corners: Array, normals: Array | None, bend: Bend, outline: Outline, placement: Array, material: int, primitive: int
) -> MirrorFaces:
    """Return pieces by their corners (n, 3, 3), and normals there; flat ones lie in the world."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    if normals is None:
        normals = np.repeat(np.cross(first, second)[:, None], 3, axis=1)
    gains = np.stack([normals[:, 0], normals[:, 1] - normals[:, 0], normals[:, 2] - normals[:, 0]], axis=1)
    count = len(corners)
    numbers = (np.full(count, number, np.intp) for number in (outline, bend, material, primitive))
    outwards = np.broadcast_to(np.linalg.inv(placement[:, :3]).T, (count, 3, 3))
    placements = np.broadcast_to(placement, (count, 3, 4))
    return MirrorFaces(corners[:, 0], first, second, gains, placements, outwards, *numbers)


def _of_shape(record: np.void, kind: Kind) -> tuple[Array, Bend, Outline, Array]:
    """Return the corners of the pieces of a primitive, their bend and outline, and the placement of round ones."""
    rows = np.array([record[name] for name in ("row_x", "row_y", "row_z")], np.float64)
    if kind is Kind.SPHERE:
        placement = np.column_stack([rows[0, 3] * np.eye(3), rows[0, :3]])
    else:
        placement = np.linalg.inv(np.vstack([rows, [0.0, 0.0, 0.0, 1.0]]))[:3]
    if kind in (Kind.SPHERE, Kind.ELLIPSOID):
        return _globe(), Bend.SPHERE, Outline.TRIANGLE, placement
    if kind in (Kind.CYLINDER, Kind.CONE):
        bend = Bend.CONE if kind is Kind.CONE else Bend.CYLINDER
        return _drum(kind is Kind.CONE), bend, Outline.TRIANGLE, placement
    canonical = _BOX if kind is Kind.BOX else _SQUARE * 2.0 - [1.0, 1.0, 0.0] if kind is Kind.DISK else _SQUARE
    outline = {Kind.DISK: Outline.DISK, Kind.PLANE: Outline.ENDLESS}.get(kind, Outline.SQUARE)
    return canonical @ placement[:, :3].T + placement[:, 3], Bend.FLAT, outline, placement


def _globe() -> Array:
    """Return triangles (n, 3, 3) about the origin, with corners on the unit sphere."""
    angle, height = np.linspace(0, 2 * np.pi, AROUND + 1), np.linspace(0, np.pi, _UPWARDS + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    upwards = np.broadcast_to(np.cos(height)[:, None, None], (_UPWARDS + 1, AROUND + 1, 1))
    triangles = _grid(np.concatenate([np.sin(height)[:, None, None] * ring, upwards], axis=2))
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.asarray(triangles[np.linalg.norm(sides, axis=1) > 1e-9])


def _drum(pointed: bool) -> Array:
    """Return triangles (n, 3, 3) with corners on the unit cylinder, or on the cone but for its tip."""
    angle, height = np.linspace(0, 2 * np.pi, AROUND + 1), np.linspace(0, 0.999 if pointed else 1.0, ALONG + 1)
    width = 1.0 - height if pointed else np.ones_like(height)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    upwards = np.broadcast_to(height[:, None, None], (ALONG + 1, AROUND + 1, 1))
    return _grid(np.concatenate([width[:, None, None] * ring, upwards], axis=2))


def _grid(points: Array) -> Array:
    """Return the triangles between points (rows, columns, 3)."""
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    triangles = np.concatenate([np.stack([a, b, c], axis=2), np.stack([d, c, b], axis=2)], axis=1)
    return triangles.reshape(-1, 3, 3)


_SQUARE = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])


def _box() -> Array:
    triangles = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corners = np.full((3, 3), -1.0)
            corners[:, axis] = side
            corners[1, (axis + 1) % 3] = corners[2, (axis + 2) % 3] = 1.0
            triangles.append(corners)
    return np.array(triangles)


_BOX = _box()


def _triangles(meshes: PackedMeshes, record: np.void, index: int) -> NDArray[np.int32]:
    """Return the corners (n, 3) of the triangles of a primitive that is a mesh, in the pool of vertices."""
    group = meshes.group_of(int(record["instance"]))
    slot = 0 if group.centre is None else index - meshes.first_primitive
    own = meshes.triangles[int(record["first_triangle"]) : group.first_triangle + group.triangles]
    return own[: int(np.searchsorted(own[:, 3], slot, side="right")), :3]


def _of_mesh(meshes: PackedMeshes, placed: np.void, record: np.void, index: int) -> Iterator[MirrorFaces]:
    """Yield the triangles of a primitive that is a mesh, some at a time."""
    shift = meshes.group_of(int(record["instance"])).shift
    world = np.array([placed[f"world_{axis}"] for axis in "xyz"], np.float64)
    triangles = _triangles(meshes, record, index)
    for low in range(0, len(triangles), PART):
        vertices = meshes.vertices[triangles[low : low + PART]].astype(np.float64)
        corners = (vertices[..., :3] + shift) @ world[:, :3].T + world[:, 3]
        edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        size = np.linalg.norm(edges, axis=1)
        normals = vertices[..., 3:6] @ np.linalg.inv(world[:, :3])
        length = np.linalg.norm(normals, axis=2, keepdims=True)
        of_plane = (edges / np.maximum(size, 1e-300)[:, None])[:, None]
        normals = np.where(length > 0, normals / np.maximum(length, 1e-300), of_plane)
        faces = _faces(corners, normals, Bend.FLAT, Outline.TRIANGLE, np.eye(3, 4), int(record["material"]), index)
        yield faces[size > 0]


#
# Where polished surfaces show lamps to points of the front of a lens, and the light that comes by them.
#
# A point shows a lamp where its normal halves the angle between the ways to the eye and to the lamp (Hanika, Droske
# and Fascione 2015), which Newton's iteration finds. How that point moves with the eye gives the curvature of the
# wave that arrives, and how it moves with the lamp the solid angle under which the lamp appears, thus its light.

ITERATIONS = 12
CONVERGED, EXACT = 1e-7, 1e-10  # what a solution is off by at most, and where steps end
STEP = 1e-5  # of differences: coordinates of a piece, or in parts of the way
MARGIN = 0.5  # of a piece's range, by which what is nearly linear over it may leave it


@dataclass(frozen=True, eq=False)
class MirrorSights(Rows):
    """Ways from eyes by polished pieces to lamps, one each.

    Attributes
    ----------
    faces : MirrorFaces
    eyes : (n, 3) array
        In the world about the eye of the camera [m].
    lamps : (n, 4) array
        Place of a lamp and 1, or unit direction towards it and 0.
    slopes : (n, 2) array
        Of the facet that reflects, against the surface.
    """

    faces: MirrorFaces
    eyes: Array
    lamps: Array
    slopes: Array


@dataclass(frozen=True, eq=False)
class Reflections:
    """What was found of n sights.

    Attributes
    ----------
    which : (n,) array
        Sights that were found.
    points : (n, 3) array
        Where the light is reflected [m].
    to_eye, to_lamp : (n, 3) arrays
        Unit vectors from there.
    cosine : (n,) array
        Of the angle between them and the facet.
    weight : (n,) array
        Of a facet's light: what those that the eye sees have over those that are there.
    behind : (n,) array
        Whether the back of the surface reflects.
    bend : (n, 3, 3) array
        By which the unit direction of light at the eye changes as the eye moves across it [1/m].
    growth : (n,) array
        Solid angle of the lamp's image over the lamp's area across the light [1/m2]; over its solid angle where it is
        at infinity.
    """

    which: NDArray[np.intp]
    points: Array
    to_eye: Array
    to_lamp: Array
    cosine: Array
    weight: Array
    behind: NDArray[np.bool_]
    bend: Array
    growth: Array


def may_reflect(sights: MirrorSights, slack: Array) -> NDArray[np.bool_]:
    """Find the pieces that may show their lamps: what differs from a reflection changes its sign over them, or nearly.

    Parameters
    ----------
    slack : (n,) array
        By which the half vector may be off.
    """
    may = np.zeros(len(sights.faces), np.bool_)
    rest = np.flatnonzero(_near_enough(sights, slack))
    may[rest] = _changes_sign(sights[rest], slack[rest])
    return may


def _near_enough(sights: MirrorSights, slack: Array) -> NDArray[np.bool_]:
    """Find the flat pieces that are not too far from reflecting, by their middles; all others are kept."""
    faces = sights.faces
    middle = _middle(faces)
    first, second = _perpendiculars(_unit(faces.normals[:, 0]))
    half, normal, _ = _half_vector(sights, *middle, first, second)
    points = faces.at(*middle)[0]
    size = np.linalg.norm(faces.first, axis=1) + np.linalg.norm(faces.second, axis=1)
    near = np.linalg.norm(sights.eyes - points, axis=1)
    away = 1.0 / near + sights.lamps[:, 3] / np.linalg.norm(sights.lamps[:, :3] - sights.lamps[:, 3:] * points, axis=1)
    to_eye, to_lamp = _ways(sights, points)
    spread = size * away / np.maximum(np.linalg.norm(to_eye + to_lamp, axis=1), 0.1)
    spread += np.linalg.norm(faces.normals[:, 1], axis=1) + np.linalg.norm(faces.normals[:, 2], axis=1)
    close = np.linalg.norm(half - normal, axis=1) <= 2.0 * spread + slack
    return np.asarray(close | (faces.bend != Bend.FLAT) | (size > 0.2 * near))


def _changes_sign(sights: MirrorSights, slack: Array) -> NDArray[np.bool_]:
    """Find the pieces that may show their lamps, as `may_reflect` says, one by one."""
    plain = sights.faces.plain
    first, second = _perpendiculars(sights.faces.at(*_middle(sights.faces))[1])
    count, differences = len(sights.faces), []
    for x, y in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        half, normal, same = _half_vector(sights, np.full(count, x), np.full(count, y), first, second)
        off = half - normal
        differences.append([_dot(off, first), _dot(off, second), same])
    corners = np.moveaxis(np.array(differences), 1, 2)
    low, high = corners[..., :2].min(axis=0), corners[..., :2].max(axis=0)
    room = MARGIN * (high - low) + slack[:, None]
    curved = np.all((low - room <= 0) & (high + room >= 0), axis=1) & (corners[..., 2].max(axis=0) > 0)
    a, b = _seed_on_plane(sights)
    size = np.linalg.norm(sights.faces.first, axis=1), np.linalg.norm(sights.faces.second, axis=1)
    distance = np.linalg.norm(sights.faces.corner - sights.eyes, axis=1)
    reach = [np.minimum(4.0 * slack * (distance + each) / each, 1e3) for each in size]
    within = (a > -reach[0]) & (b > -reach[1]) & (a < 1 + reach[0]) & (b < 1 + reach[1])
    within |= sights.faces.outline == Outline.ENDLESS
    return np.asarray(np.where(plain, within & np.isfinite(a + b), curved))


def seeds(sights: MirrorSights) -> tuple[Array, Array]:
    """Return coordinates near those of the reflection, within the pieces but for endless ones."""
    a, b = _seed_on_plane(sights)
    curved = ~sights.faces.plain
    if curved.any():
        own = sights[curved]
        first, second = _perpendiculars(own.faces.at(*_middle(own.faces))[1])
        zero, one = np.zeros(len(own.faces)), np.ones(len(own.faces))
        corners = [_off(own, x, y, first, second) for x, y in ((zero, zero), (one, zero), (zero, one))]
        matrix = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=2)
        a[curved], b[curved] = _solve(matrix, -corners[0]).T
    endless = sights.faces.outline == Outline.ENDLESS
    a, b = np.where(np.isfinite(a), a, 0.5), np.where(np.isfinite(b), b, 0.5)
    within = np.clip(a, 0.0, 1.0), np.clip(b, 0.0, 1.0)
    over = np.where(sights.faces.outline == Outline.TRIANGLE, np.maximum(within[0] + within[1], 1.0), 1.0)
    return np.where(endless, a, within[0] / over), np.where(endless, b, within[1] / over)


def reflections(sights: MirrorSights, sharpest: float) -> Reflections:
    """Return where the pieces show their lamps.

    Parameters
    ----------
    sharpest : float
        Largest curvature of a wave [1/m]: one that is about to meet its focus is taken as one that has that curvature.
    """
    a, b, first, second = _solution(sights)
    off = _off(sights, a, b, first, second)
    points, normals = sights.faces.at(a, b)
    to_eye, to_lamp = _ways(sights, points)
    side = np.sign(_dot(normals, to_eye))
    facing = (side * _dot(normals, to_lamp) > 0) & (side * _dot(sights.faces.at(a, b)[1], to_eye) > 0)
    good = facing & np.all(np.abs(off) < CONVERGED, axis=1) & sights.faces.holds(a, b)
    which = np.flatnonzero(good)
    own, a, b, first, second = sights[which], a[which], b[which], first[which], second[which]
    to_eye, to_lamp, normals = to_eye[which], to_lamp[which], (side[:, None] * normals)[which]
    bend, growth = _waves(own, a, b, first, second, to_eye, to_lamp, sharpest)
    half = _unit(to_eye + to_lamp)
    cosine = _dot(half, to_eye)
    return Reflections(
        which, points[which], to_eye, to_lamp, cosine, _facet_weight(own, normals, half, to_eye),
        side[which] < 0, bend, growth,
    )  # fmt: skip


def _solution(sights: MirrorSights) -> tuple[Array, Array, Array, Array]:
    """Return coordinates where nothing is off, if there are such, and the directions that it is measured along."""
    a, b = seeds(sights)
    first, second = _perpendiculars(sights.faces.at(a, b)[1])
    bound = np.where(sights.faces.outline == Outline.ENDLESS, np.inf, 1.0)
    rest = np.arange(len(a))
    for _ in range(ITERATIONS):
        own, ways = sights[rest], (first[rest], second[rest])
        off = _off(own, a[rest], b[rest], *ways)
        step = _solve(_slope(own, a[rest], b[rest], *ways), -off)
        step = np.clip(np.nan_to_num(step), -bound[rest, None], bound[rest, None])
        a[rest], b[rest] = a[rest] + step[:, 0], b[rest] + step[:, 1]
        rest = rest[np.any(np.abs(off) > EXACT, axis=1)]
    return a, b, first, second


def _waves(
    sights: MirrorSights,
    a: Array,
    b: Array,
    first: Array,
    second: Array,
    to_eye: Array,
    to_lamp: Array,
    sharpest: float,
) -> tuple[Array, Array]:
    """How the light's direction changes with the eye, and the image's solid angle over the lamp's area."""
    slope = _slope(sights, a, b, first, second)
    points = sights.faces.at(a, b)[0]
    along = np.stack(
        [(sights.faces.at(a + STEP, b)[0] - points) / STEP, (sights.faces.at(a, b + STEP)[0] - points) / STEP], axis=2
    )
    moves = -along @ _inverse(slope)  # of the point, by what is off
    distance = np.linalg.norm(points - sights.eyes, axis=1)
    across = np.stack(_perpendiculars(to_eye), axis=2)
    of_eye = np.empty((len(a), 2, 2))
    of_lamp = np.empty((len(a), 2, 2))
    beside = np.stack(_perpendiculars(to_lamp), axis=2)
    far = sights.lamps[:, 3] == 0
    reach = np.where(far, 1.0, np.linalg.norm(sights.lamps[:, :3] - points, axis=1))
    for axis in (0, 1):
        for change, eye, lamp in ((of_eye, distance, 0.0 * reach), (of_lamp, 0.0 * distance, reach)):
            shift = STEP * eye[:, None] * across[:, :, axis], STEP * lamp[:, None] * beside[:, :, axis]
            ahead, back = (
                _off(_move(sights, sign * shift[0], sign * shift[1]), a, b, first, second) for sign in (1.0, -1.0)
            )
            change[:, :, axis] = (ahead - back) / (2.0 * STEP * (eye + lamp))[:, None]
    moved_by_eye, moved_by_lamp = moves @ of_eye, moves @ of_lamp
    turned = np.swapaxes(across, 1, 2)
    curvature = turned @ (across - moved_by_eye) / distance[:, None, None]
    curvature = 0.5 * (curvature + np.swapaxes(curvature, 1, 2))
    curvature, less = _bound(curvature, sharpest)
    bend = across @ curvature @ turned
    mean = 0.5 * np.trace(curvature, axis1=1, axis2=2)
    bend += mean[:, None, None] * to_eye[:, :, None] * to_eye[:, None, :]
    return bend, less * np.abs(np.linalg.det(turned @ moved_by_lamp / distance[:, None, None]))


def _bound(curvature: Array, sharpest: float) -> tuple[Array, Array]:
    """Return symmetric matrices (n, 2, 2) whose eigenvalues are no larger, and the share of light that this leaves."""
    values, vectors = np.linalg.eigh(curvature)
    within = np.clip(values, -sharpest, sharpest)
    less = np.prod(sharpest / np.maximum(np.abs(values), sharpest), axis=1)
    return np.einsum("nik,nk,njk->nij", vectors, within, vectors), less


def _move(sights: MirrorSights, eye: Array, lamp: Array) -> MirrorSights:
    """Return sights with eyes and lamps elsewhere; directions stay unit vectors."""
    lamps = sights.lamps.copy()
    lamps[:, :3] += lamp
    far = lamps[:, 3] == 0
    lamps[far, :3] = _unit(lamps[far, :3])
    return MirrorSights(sights.faces, sights.eyes + eye, lamps, sights.slopes)


def _facet_weight(sights: MirrorSights, normals: Array, half: Array, to_eye: Array) -> Array:
    """The area of the facets that the eye sees over that of those that are there; 1 of a smooth surface."""
    weight = _dot(half, to_eye) / np.maximum(_dot(normals, to_eye) * _dot(normals, half), 1e-6)
    return np.asarray(np.where(sights.slopes.any(axis=1), weight, 1.0))


def _seed_on_plane(sights: MirrorSights) -> tuple[Array, Array]:
    """Return the coordinates where the plane of a piece shows the lamp; nan where it does not."""
    faces = sights.faces
    normal = _unit(np.cross(faces.first, faces.second))
    height = _dot(sights.eyes - faces.corner, normal)
    lamp = sights.lamps[:, :3] - np.where(sights.lamps[:, 3:] > 0, faces.corner, 0.0)
    image = sights.lamps[:, :3] - 2.0 * _dot(lamp, normal)[:, None] * normal
    way = np.where(sights.lamps[:, 3:] > 0, image - sights.eyes, image)
    fall = -_dot(way, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(height * _dot(lamp, normal) > 0, height / fall, np.nan)
        place = sights.eyes + share[:, None] * way - faces.corner
        square = np.stack([_dot(faces.first, faces.first), _dot(faces.second, faces.second)])
        cross = _dot(faces.first, faces.second)
        u, v = _dot(place, faces.first), _dot(place, faces.second)
        area = square[0] * square[1] - cross**2
        return (u * square[1] - v * cross) / area, (v * square[0] - u * cross) / area


def _slope(sights: MirrorSights, a: Array, b: Array, first: Array, second: Array) -> Array:
    """How what is off changes with the coordinates (n, 2, 2)."""
    columns = [
        (_off(sights, a + x, b + y, first, second) - _off(sights, a - x, b - y, first, second)) / (2.0 * STEP)
        for x, y in ((STEP, 0.0), (0.0, STEP))
    ]
    return np.stack(columns, axis=2)


def _off(sights: MirrorSights, a: Array, b: Array, first: Array, second: Array) -> Array:
    """Return by how much the half vector is off the normal of the facet, along two directions (n, 2)."""
    half, normal, _ = _half_vector(sights, a, b, first, second)
    return np.stack([_dot(half - normal, first), _dot(half - normal, second)], axis=1)


def _half_vector(sights: MirrorSights, a: Array, b: Array, first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Return half vectors, the normals of facets, and whether eye and lamp are on the same side."""
    points, normals = sights.faces.at(a, b)
    to_eye, to_lamp = _ways(sights, points)
    front = _dot(normals, to_eye)
    normals = np.where(front < 0, -1.0, 1.0)[:, None] * normals
    tilted = normals + sights.slopes[:, :1] * first + sights.slopes[:, 1:] * second
    return _unit(to_eye + to_lamp), _unit(tilted), (_dot(normals, to_lamp) > 0).astype(np.float64)


def _ways(sights: MirrorSights, points: Array) -> tuple[Array, Array]:
    """Return unit vectors from points to eyes and to lamps."""
    lamps = sights.lamps[:, :3]
    return _unit(sights.eyes - points), np.where(sights.lamps[:, 3:] > 0, _unit(lamps - points), lamps)


def _middle(faces: MirrorFaces) -> tuple[Array, Array]:
    middle = np.where(faces.outline == Outline.TRIANGLE, 1.0 / 3.0, 0.5)
    return middle, middle


def _perpendiculars(directions: Array) -> tuple[Array, Array]:
    """Return two unit vectors across each unit direction."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = _unit(np.cross(directions, least))
    return first, np.cross(directions, first)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ni,ni->n", a, b))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None])


def _inverse(matrices: Array) -> Array:
    """Return the inverses of 2x2 matrices; nothing finite where there is none."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.moveaxis(np.array([[d, -b], [-c, a]]) / (a * d - b * c), -1, 0)


def _solve(matrices: Array, right: Array) -> Array:
    """Return the solutions of two equations each."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.einsum("nij,nj->ni", _inverse(matrices), right))


#
# Mirrored highlights: lamps and suns that the front of a lens sees in polished surfaces, as pencils of light.
#
# First, points of the front look for reflections of lamps in the pieces of all polished surfaces. What they find, and
# nothing hides, is gathered by direction into pencils, which go through the lens as the light of lamps does.

LAMPS = 64  # the brightest, that are looked for
MOST_PAIRS = 1 << 23  # of lamps and pieces
_SIGHTS, _TOGETHER = 1 << 16, 256  # sights followed at a time; pieces whose sights are made at a time
NEIGHBOURS = 0.02  # of the way to a lamp, within which pieces see the same points of it
MANY = 64  # pieces, from which each point of a lamp is looked for from one point of the front
SHORT = 1e-3  # of a way at its ends, which do not hide it
CELLS = 600.0  # per radian, within which reflections of a lamp in a primitive make one pencil
SPREAD = 12.0  # widest slope of a facet that is followed, over alpha


FAINT = 1e-3  # of all light, below which the faintest sources beside highlights are left out
_PENCIL = 2.0  # in place of 0 and 1, of a source whose light has the curvature of its own

Pencils = tuple[Array, Array, Array]
"""Light that arrives at the front.

Its unit direction at the first vertex (n, 3); by how much that changes as one moves across it (n, 3, 3) [1/m]; and its
irradiance across the light at the vertex, on the mean over the front (n, 3) [W/m2].
"""
Lamp = tuple[Callable[[Array], Points], float]
"""A lamp: what gives its points as they show to a place of the world about the eye; luminance of the irradiance that it
may give the front.
"""


@dataclass(frozen=True, eq=False)
class _Trial(Rows):
    """Sights with the light of each lamp's point and where it comes from."""

    sights: MirrorSights
    light: Array
    targets: Array
    lobe: NDArray[np.intp]
    lamp: NDArray[np.intp]


def lamps_among(records: NDArray[np.void], parts: Sequence[Points], front: Array) -> list[Lamp]:
    """Return the brightest lamps of emitter records and of parts of the surroundings; an emissive mesh is one lamp."""
    lamps: list[Lamp] = [(partial(_as_they_are, part), float(luminance(part[1]).sum())) for part in parts]
    for (kind, _), group in groupby(records, key=_owner):
        own = np.array(list(group), records.dtype)
        if kind is EmitterKind.TRIANGLE:
            lamps.append(_some_of_mesh(own, front))
        else:
            known = [record for record in own if points_of(record, front) is not None]
            lamps += [(partial(_together, [record], 1.0), _strength(record, front)) for record in known]
    return sorted(lamps, key=lambda lamp: -lamp[1])[:LAMPS]


def highlights(
    plan: Plan, session: Session, buffers: SceneBuffers, lamps: Sequence[Lamp], front: Front
) -> Pencils | None:
    """Return the light of lamps that polished surfaces reflect to the front; None where there is none."""
    if not lamps:
        return None
    lobes = {index: list(lobes_of(plan.materials, index)) for index in range(len(plan.materials))}
    numbered = [lobe for own in lobes.values() for lobe in own]
    if not numbered:
        return None
    parts, lamps = [], lamps[: max(MOST_PAIRS // max(_polished_count(plan), 1), 1)]
    for faces in polished_faces(plan):
        for trial in _trials(faces, lobes, numbered, lamps, front):
            parts += _reflect(trial, numbered, front, plan, session, buffers)
    return _gather(parts) if parts else None


def with_highlights(
    direct: Sources,
    far: Sequence[Points],
    scene: Scene,
    plan: Plan,
    buffers: SceneBuffers,
    session: Session,
    lens: Lens,
    film_z: float,
) -> Sources:
    """Return the sources of `sources_of`, which has the same parameters, with the highlights of a scene."""
    turn = at_opening(scene).camera.world_from_camera()[:3, :3]
    front, records = front_of(lens, film_z, turn), plan.emitters.shining
    lamps = lamps_among(records[records["hidden"] & Hidden.FROM_REFLECTION == 0], far, front.vertex)
    pencils = highlights(plan, session, buffers, lamps, front)
    return direct if pencils is None else _with_pencils(direct, pencils, turn)


def _with_pencils(direct: Sources, pencils: Pencils, turn: Array) -> Sources:
    """Return sources with mirrored highlights; the faintest of all are left out."""
    ways, bends, irradiance = pencils
    ways, bends = ways @ turn, turn.T @ bends @ turn * 1e-3
    ahead = comes_from_ahead(ways) & np.all(np.isfinite(bends), axis=(1, 2))
    places, first = np.zeros((len(direct.places) + int(ahead.sum()), 12)), len(direct.places)
    places[:first, :4] = direct.places
    places[first:, :3], places[first:, 3] = ways[ahead], _PENCIL
    places[first:, 4:7], places[first:, 8:11] = bends[ahead, :, 0], bends[ahead, :, 1]
    light = np.concatenate([direct.irradiance, irradiance[ahead]])
    bright = luminance(light)
    order = np.argsort(-bright, kind="stable")
    share = np.cumsum(bright[order]) / max(float(bright.sum()), 1e-300)
    order = np.sort(order[: min(int(np.searchsorted(share, 1.0 - FAINT)) + 1, MOST_SOURCES)])
    mirrored = int((order >= first).sum())
    if not mirrored:
        return direct
    every = float(bright[:first].sum()) / (1.0 - direct.dropped_share) + float(bright[first:].sum())
    dropped = 1.0 - float(bright[order].sum()) / every
    known = np.concatenate([direct.known, np.zeros((int(ahead.sum()), 3))])
    known[first:, 2] = -1.0 - np.arange(int(ahead.sum()))
    patches = Patches.joined([direct.patches, points_alone(places[first:])])
    return Sources(places[order], light[order], direct.left_out, dropped, known[order], patches[order], mirrored)


def _owner(record: np.void) -> tuple[EmitterKind, int]:
    return EmitterKind(int(record["kind"])), int(record["primitive"])


def _strength(record: np.void, front: Array) -> float:
    """Return the luminance of the irradiance that a lamp gives a surface that faces it, where the front is."""
    kind, bright, a = EmitterKind(int(record["kind"])), float(luminance(record["radiance"][:3])), record["a"]
    if kind is EmitterKind.DIRECTIONAL:
        return bright
    if kind is EmitterKind.SUN:
        return float(bright * np.pi * a[3])
    area = a[3] if kind in FLAT else np.pi * a[3] ** 2 if kind is EmitterKind.SPHERE else 1.0
    away = front - a[:3]
    return float(bright * area / max(float(away @ away), 1e-12))


def _some_of_mesh(records: NDArray[np.void], front: Array) -> Lamp:
    """Return an emissive mesh as some of its triangles, with the power of all."""
    power = np.asarray(luminance(records["radiance"][:, :3]) * records["a"][:, 3])
    chosen = np.arange(len(records))
    if len(records) > POINTS:
        steps = (np.arange(POINTS) + 0.5) / POINTS * power.sum()
        chosen = np.unique(np.minimum(np.searchsorted(np.cumsum(power), steps), len(records) - 1))
    scale = float(power.sum() / max(float(power[chosen].sum()), 1e-300))
    own = list(records[chosen])
    return partial(_together, own, scale), scale * sum(_strength(record, front) for record in own)


def _as_they_are(part: Points, _: Array) -> Points:
    """Return points at infinity."""
    return part


def _together(records: Sequence[np.void], scale: float, place: Array) -> Points:
    """Return the points of some emitters, with more light than theirs."""
    parts = [part for record in records if (part := points_of(record, place)) is not None]
    at, light, target = (np.concatenate(column) for column in zip(*parts, strict=True))
    return at, scale * light, target


def _trials(
    faces: MirrorFaces, lobes: dict[int, list[Lobe]], numbered: list[Lobe], lamps: Sequence[Lamp], front: Front
) -> Iterator[_Trial]:
    """Yield what may reflect lamps in pieces, some at a time."""
    widest = np.array([max((SPREAD * lobe.alpha for lobe in own), default=0.0) for own in lobes.values()])
    first = np.cumsum([0, *map(len, lobes.values())])
    parts: list[_Trial] = []
    for number, (points, _) in enumerate(lamps):
        for some, places in _candidates(faces, widest[faces.material], points, front):
            for material in np.unique(faces.material[some]):
                own = some[faces.material[some] == material]
                for lobe in range(int(first[material]), int(first[material + 1])):
                    parts += _pair(faces[own], numbered[lobe].alpha, lobe, places, number, front)
            if sum(len(part.light) for part in parts) > _SIGHTS:
                yield _Trial.joined(parts)
                parts = []
    if parts:
        yield _Trial.joined(parts)


def _candidates(
    faces: MirrorFaces, widest: Array, points: Callable[[Array], Points], front: Front
) -> Iterator[tuple[NDArray[np.intp], tuple[Points, bool]]]:
    """Yield pieces that may show a lamp to the front, with the lamp as it shows to them, and whether they are many."""
    count = len(faces)
    places = points(front.vertex)[0]
    centre = np.append(places[:, :3].mean(axis=0), places[0, 3])
    size = 1.25 * float(np.linalg.norm(places[:, :3] - centre[:3], axis=1).max())
    sights = MirrorSights(faces, np.tile(front.vertex, (count, 1)), np.tile(centre, (count, 1)), np.zeros((count, 2)))
    corners = faces.at(np.zeros(count), np.zeros(count))[0]
    to_eye, to_lamp = front.vertex - corners, centre[:3] - centre[3] * corners
    near, far = np.linalg.norm(to_eye, axis=1), np.linalg.norm(to_lamp, axis=1)
    sum_of_units = np.linalg.norm(to_eye / near[:, None] + to_lamp / far[:, None], axis=1)
    slack = (front.radius / near + size / far) / np.maximum(sum_of_units, 0.1) + widest
    able = np.flatnonzero(may_reflect(sights, slack))
    if not len(able):
        return
    seen_from = sights[able].faces.at(*seeds(sights[able]))[0]
    way = np.linalg.norm(centre[:3] - seen_from, axis=1).min() if centre[3] else np.inf
    cells = np.floor(seen_from / max(NEIGHBOURS * float(way), 1e-9)) if centre[3] else np.zeros((len(able), 1))
    _, place = np.unique(cells, axis=0, return_inverse=True)
    for cell in range(int(place.max()) + 1):
        own = np.flatnonzero(place.reshape(-1) == cell)
        middle = seen_from[own].mean(axis=0)
        at, light, target = points(middle)
        square = np.where(at[:, 3:] > 0, np.sum((at[:, :3] - middle) ** 2, axis=1)[:, None], 1.0)
        for low in range(0, len(own), _TOGETHER):
            yield able[own[low : low + _TOGETHER]], ((at, light * square, target), len(able) > MANY)


def _pair(
    faces: MirrorFaces, alpha: float, lobe: int, lamp: tuple[Points, bool], number: int, front: Front
) -> list[_Trial]:
    """Return the sights of pieces: each point of a lamp, with a slope of the facets, from each point of the front."""
    (places, light, targets), many = lamp
    slopes = np.zeros((1, 2))
    if alpha >= SPREADING_ALPHA:
        u, v = lattice(POINTS)
        steep, angle = alpha * np.sqrt(u / (1.0 - u)), 2.0 * np.pi * v
        slopes = np.stack([steep * np.cos(angle), steep * np.sin(angle)], axis=1)
    # Each point with each slope, or with one where there are as many; of many pieces from one point of the front.
    point, slope = (grid.ravel() for grid in np.indices((len(places), len(slopes))))
    if len(places) == len(slopes) > 1:
        point, slope = np.arange(POINTS), 7 * np.arange(POINTS) % POINTS
    spot = np.tile(np.arange(len(front.spots)), len(point))
    point, slope = np.repeat(point, len(front.spots)), np.repeat(slope, len(front.spots))
    if many and len(places) * len(slopes) > 1:
        chosen = spot == (point + slope) % len(front.spots)
        point, slope, spot = point[chosen], slope[chosen], spot[chosen]
    share = len(places) / len(point)
    lit = luminance(light)[point] > 0
    point, slope, spot = point[lit], slope[lit], spot[lit]
    face, pair = (grid.ravel() for grid in np.indices((len(faces), len(point))))
    sights = MirrorSights(faces[face], front.spots[spot[pair]], places[point[pair]], slopes[slope[pair]])
    may = may_reflect(sights, np.zeros(len(face)))
    if not may.any():
        return []
    count, point = int(may.sum()), point[pair][may]
    lobes, lamps = np.full(count, lobe), np.full(count, number)
    return [_Trial(sights[may], share * light[point], targets[point], lobes, lamps)]


Found = tuple[Array, Array, Array, NDArray[np.intp]]


def _reflect(
    trial: _Trial, lobes: list[Lobe], front: Front, plan: Plan, session: Session, buffers: SceneBuffers
) -> list[Found]:
    """Return ways and bends at the vertex, irradiance, and lamp and primitive, of reflections that nothing hides."""
    mirrored = reflections(trial.sights, 1.0 / front.radius)
    if not len(mirrored.which):
        return []
    trial = trial[mirrored.which]
    own = trial.sights
    light = trial.light * (mirrored.weight * mirrored.growth)[:, None]
    for number in np.unique(trial.lobe):
        mine = trial.lobe == number
        light[mine] *= lobes[number].reflectance(mirrored.cosine[mine], mirrored.behind[mine])
    # Look whether anything stands on the way to the front, or to the lamp.
    near = np.linalg.norm(own.eyes - mirrored.points, axis=1)
    far = np.where(own.lamps[:, 3] > 0, np.linalg.norm(own.lamps[:, :3] - mirrored.points, axis=1), np.inf)
    start = SHORT * np.minimum(near, far)
    dark = occluded(session, plan, buffers, own.eyes, -mirrored.to_eye, (1.0 - SHORT) * near)
    reach = np.minimum((1.0 - SHORT) * far - start, float(np.finfo(np.float32).max) / 4)
    origins = mirrored.points + start[:, None] * mirrored.to_lamp
    dark |= occluded(session, plan, buffers, origins, mirrored.to_lamp, reach, trial.targets)
    # Take the wave from the point of the front to the first vertex.
    ways = mirrored.to_eye + np.einsum("nij,nj->ni", mirrored.bend, front.vertex - own.eyes)
    length = np.linalg.norm(ways, axis=1)
    owner = np.stack([trial.lamp, own.faces.primitive], axis=1)
    every = ways / length[:, None], mirrored.bend / length[:, None, None], light / length[:, None] ** 2, owner
    return [(every[0][~dark], every[1][~dark], every[2][~dark], every[3][~dark])]


def _gather(parts: list[Found]) -> Pencils | None:
    """Return pencils: reflections of a lamp in a primitive by cells of direction, in the order of the cells."""
    ways, bends, light, owner = (np.concatenate(column) for column in zip(*parts, strict=True))
    weight = luminance(light)
    lit = weight > 0
    if not lit.any():
        return None
    ways, bends, light, owner, weight = ways[lit], bends[lit], light[lit], owner[lit], weight[lit]
    cells = np.concatenate([owner, np.floor(ways * CELLS).astype(np.intp)], axis=1)
    _, place = np.unique(cells, axis=0, return_inverse=True)
    place = place.reshape(-1)
    irradiance: Array = np.stack([np.bincount(place, part) for part in light.T], axis=1)
    total = np.bincount(place, weight)
    ways = np.stack([np.bincount(place, weight * part) for part in ways.T], axis=1)
    bends = np.stack([np.bincount(place, weight * part) for part in bends.reshape(-1, 9).T], axis=1)
    length = np.linalg.norm(ways, axis=1)
    return ways / length[:, None], (bends / total[:, None]).reshape(-1, 3, 3), irradiance
