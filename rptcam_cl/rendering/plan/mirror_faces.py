"""Polished surfaces of a scene in pieces: points and normals of each by two coordinates, in float64."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.records import Hidden, Kind
from rptcam_cl.rendering.plan.materials import lobes_of
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.plan.primitives import PackedMeshes, TriangleGroup

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

ROUND = (Kind.SPHERE, Kind.ELLIPSOID, Kind.CYLINDER, Kind.CONE)
PART = 1 << 14  # triangles of a mesh at a time
AROUND, UPWARDS, ALONG = 24, 12, 8  # pieces of round shapes
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
class Faces(Rows):
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


def polished_faces(plan: Plan) -> Iterator[Faces]:
    """Yield the pieces of what reflects like a mirror, or nearly, as it stands when the shutter opens."""
    flats = []
    for index, kind in _polished_primitives(plan):
        record = plan.primitives[index]
        if kind is Kind.MESH and plan.meshes is not None:
            yield from _of_mesh(plan.meshes, record, index)
            continue
        corners, bend, outline, placement = _of_shape(record, kind)
        faces = _faces(corners, None, bend, outline, placement, int(record["material"]), index)
        if bend is Bend.FLAT:
            flats.append(faces)
        else:
            yield faces
    if flats:
        yield Faces.joined(flats)


def polished_count(plan: Plan) -> int:
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
) -> Faces:
    """Return pieces by their corners (n, 3, 3), and normals there; flat ones lie in the world."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    if normals is None:
        normals = np.repeat(np.cross(first, second)[:, None], 3, axis=1)
    gains = np.stack([normals[:, 0], normals[:, 1] - normals[:, 0], normals[:, 2] - normals[:, 0]], axis=1)
    count = len(corners)
    numbers = (np.full(count, number, np.intp) for number in (outline, bend, material, primitive))
    outwards = np.broadcast_to(np.linalg.inv(placement[:, :3]).T, (count, 3, 3))
    return Faces(corners[:, 0], first, second, gains, np.broadcast_to(placement, (count, 3, 4)), outwards, *numbers)


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
        return _drum(kind is Kind.CONE), Bend.CONE if kind is Kind.CONE else Bend.CYLINDER, Outline.TRIANGLE, placement
    canonical = _BOX if kind is Kind.BOX else _SQUARE * 2.0 - [1.0, 1.0, 0.0] if kind is Kind.DISK else _SQUARE
    outline = {Kind.DISK: Outline.DISK, Kind.PLANE: Outline.ENDLESS}.get(kind, Outline.SQUARE)
    return canonical @ placement[:, :3].T + placement[:, 3], Bend.FLAT, outline, placement


def _globe() -> Array:
    """Return triangles (n, 3, 3) about the origin, with corners on the unit sphere."""
    angle, height = np.linspace(0, 2 * np.pi, AROUND + 1), np.linspace(0, np.pi, UPWARDS + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    upwards = np.broadcast_to(np.cos(height)[:, None, None], (UPWARDS + 1, AROUND + 1, 1))
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
    instance = int(record["instance"])
    group: TriangleGroup = meshes.groups[int(meshes.group_of_instance[instance])]
    slot = index - int(meshes.instances[instance]["first_primitive"])
    own = meshes.triangles[int(record["first_triangle"]) : group.first_triangle + group.triangles]
    return own[: int(np.searchsorted(own[:, 3], slot, side="right")), :3]


def _of_mesh(meshes: PackedMeshes, record: np.void, index: int) -> Iterator[Faces]:
    """Yield the triangles of a primitive that is a mesh, some at a time."""
    placed = meshes.instances[int(record["instance"])]
    shift = meshes.groups[int(meshes.group_of_instance[int(record["instance"])])].shift
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
