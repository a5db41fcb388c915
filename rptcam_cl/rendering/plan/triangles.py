"""Triangles of a scene as the device holds them: pools of vertices and triangles, and who uses them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import INSTANCE
from rptcam_cl.rendering.plan.primitives import (
    Matrix,
    Placements,
    PlanParts,
    Primitive,
    Primitives,
    affine,
    are_same,
    corners_of_box,
)
from rptcam_cl.scene.assets.mesh import Mesh
from rptcam_cl.scene.scene import Scene

VERTEX_FLOATS = 8  # position, normal (zero: none), texture coordinates


@dataclass(frozen=True, eq=False)
class TriangleGroup:
    """Triangles that share a tree.

    Attributes
    ----------
    key : str
        Hash of its corners in the frame of the group.
    first_triangle, triangles : int
        Where it lies in the pool of triangles.
    first_vertex, vertices : int
        Where it lies in the pool of vertices.
    centre : (3,) float64 array or None
        Where its frame stands in the scene [m]; None for a mesh that instances share.
    shift : (3,) float64 array
        What takes the group's frame to that in which rays meet it [m]: zero for a mesh that instances share.
    """

    key: str
    first_triangle: int
    triangles: int
    first_vertex: int
    vertices: int
    centre: NDArray[np.float64] | None
    shift: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PackedMeshes:
    """All meshes of a scene.

    Attributes
    ----------
    vertices : (n, 8) float32 array
        Position, normal, texture coordinates; positions in the frame of their group, not shifted.
    triangles : (m, 4) int32 array
        Corners in the pool of vertices, and the place of the triangle's primitive among those of its instance.
    groups : tuple of TriangleGroup
    boxes : (groups, 2, 3) float32 array
        Lowest and highest corner of the vertices of each group; empty where no instances are needed.
    order : (runs,) int array
        The runs of placed meshes in the order in which their primitives must stand.
    first_copied : tuple of int
        First triangle of each mesh that stands in the world.
    shared : Placements
        Of the meshes that are instances.
    group_of_run : (runs,) int array
        Of those.
    origins : (groups, 3) array
        Of the mesh that each group is; zeros for the group of those that stand in the world.
    first_primitive : int
        Of all meshes.
    eye : (3,) float64 array
        About which rays meet them [m].
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    groups: tuple[TriangleGroup, ...]
    boxes: NDArray[np.float32]
    order: NDArray[np.int64]
    first_copied: tuple[int, ...]
    shared: Placements
    group_of_run: NDArray[np.int64]
    origins: NDArray[np.float64]
    first_primitive: int
    eye: NDArray[np.float64]

    @property
    def instanced(self) -> bool:
        """Whether rays must be taken to the frames of instances: false where all triangles stand in the world."""
        return len(self.shared) > 0

    @property
    def group_of_instance(self) -> NDArray[np.int64]:
        """The group of each instance; the first stands for all copied meshes, if any."""
        groups = np.repeat(self.group_of_run, self.shared.counts)
        return np.append(np.zeros(int(bool(self.first_copied)), np.int64), groups)

    def group_of(self, instance: int) -> TriangleGroup:
        """Return the group of an instance."""
        place = instance - bool(self.first_copied)
        run = int(np.searchsorted(self.shared.ends, place, side="right"))
        return self.groups[0 if place < 0 else int(self.group_of_run[run])]

    @property
    def instance_of(self) -> NDArray[np.int32]:
        """The instance of each placed mesh."""
        copied = len(self.first_copied)
        return np.append(np.zeros(copied), bool(copied) + np.arange(len(self.shared))).astype(np.int32)

    @property
    def first_triangles(self) -> NDArray[np.int32]:
        """The first triangle of each placed mesh."""
        of_runs = np.array([group.first_triangle for group in self.groups])[self.group_of_run]
        return np.append(self.first_copied, np.repeat(of_runs, self.shared.counts)).astype(np.int32)

    def has_places_of(self, other: PackedMeshes) -> bool:
        """Return whether what stands in the scene stands where other meshes do."""
        one, two = ((bool(each.first_copied), each.shared.content) for each in (self, other))
        return are_same(one, two)

    def seen_from(self, eye: NDArray[np.float64]) -> PackedMeshes:
        """Return these as rays meet them about an eye, in the scene [m]; trees do not depend on it."""
        groups = tuple(
            group if group.centre is None else replace(group, shift=group.centre - eye) for group in self.groups
        )
        return replace(self, groups=groups, eye=eye)

    def placed(self) -> Iterator[tuple[slice, NDArray[np.int64], Matrix, Matrix]]:
        """Yield shared meshes some at a time: where they stand among the instances, their groups, what takes them to
        the scene [m], and where the origin of their frame comes to lie by its turn.
        """
        copied = int(bool(self.first_copied))
        for part, runs, placements in self.shared.blocks():
            groups = self.group_of_run[runs]
            turned = (placements[:, :3, :3] @ self.origins[groups][:, :, None])[:, :, 0]
            yield slice(part.start + copied, part.stop + copied), groups, placements, turned

    def instances(self) -> NDArray[np.void]:
        """Work out the ``Instance`` records but for their roots: of the copied meshes, then of the others."""
        copied = len(self.first_copied)
        records = INSTANCE.zeros(len(self.shared) + bool(copied))
        records["primitives"] = 1
        records["first_primitive"][bool(copied) :] = self.first_primitive + copied + np.arange(len(self.shared))
        if copied:
            records["first_primitive"][0], records["primitives"][0] = self.first_primitive, copied
            _write_places(records[:1], np.eye(4)[None])  # their triangles stand in the world
        for part, _, placements, origins in self.placed():
            world = placements.copy()
            world[:, :3, 3] += origins - self.eye
            _write_places(records[part], world)
        return records


def _write_places(records: NDArray[np.void], world: Matrix) -> None:
    for name, rows in (("row", np.linalg.inv(world)), ("world", world)):
        for place, axis in enumerate("xyz"):
            records[f"{name}_{axis}"] = rows[:, place]


def shift_points(points: NDArray[np.float32], shift: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return points or box corners (..., 3) moved by ``shift``, rounded once.

    Rounding keeps order, so a box that held points before holds them afterwards.
    """
    return (points + shift).astype(np.float32)


#
# Meshes of the scene as pools of vertices and triangles, in metres, each with its material.
#
# A mesh that stands in the scene once is taken to the world, where all such meshes share one tree. One that several
# objects use is held once, in its own frame, with a tree that its instances share; small ones are copied all the
# same, as each instance on its way costs a ray more than a few triangles do. What moves is an instance always.


MOST_COPIED = 1 << 14  # triangles that copies of one mesh may add to the common tree


def pack_meshes(placed: Primitives, first_primitive: int, parts: PlanParts) -> PackedMeshes:
    """Return some primitives that are meshes, as rays from the origin of the scene meet them.

    Parameters
    ----------
    placed
        Those, at least one.
    first_primitive
        Index of the first primitive that is a mesh.
    parts
        Keeps the pools until others of these stand in the world, or other meshes are shared.
    """
    meshes, mesh_of = placed.meshes()
    moves = placed.of_runs(np.array([each.trajectory is not None for each in placed.prototypes]))
    uses = np.bincount(mesh_of, np.where(moves, 0, placed.places.counts), len(meshes))
    is_many = (uses - 1) * [len(mesh.faces) for mesh in meshes] > MOST_COPIED
    is_shared = moves | is_many[mesh_of]
    copied, shared = placed.chosen(np.flatnonzero(~is_shared)), placed.chosen(np.flatnonzero(is_shared))
    meshes, mesh_of = shared.meshes()
    pools = _pools([*copied], meshes, parts)
    in_world = int(len(copied) > 0)
    return PackedMeshes(
        vertices=pools.vertices,
        triangles=pools.triangles,
        groups=tuple(pools.groups),
        boxes=pools.boxes() if meshes else np.zeros((0, 2, 3), np.float32),
        order=np.argsort(is_shared, kind="stable"),
        first_copied=tuple(pools.first_triangles),
        shared=shared.places,
        group_of_run=in_world + mesh_of,
        origins=np.array([*np.zeros((in_world, 3)), *(mesh.origin for mesh in meshes)]),
        first_primitive=first_primitive,
        eye=np.zeros(3),
    )


def _pools(in_world: Sequence[Primitive], shared: Sequence[Mesh], parts: PlanParts) -> _Pools:
    """Return the pools of meshes, those before where these are the same."""
    before: _Pools | None = parts.last("pools")
    of = tuple((item.mesh, item.placement) for item in in_world), tuple(shared)
    pools = parts.part("pools", of, lambda: _Pools(in_world, shared, before, keep_centre=parts.rough))
    parts.rough_parts = () if pools.is_exact else ("pools", "meshes", "world", "held world")
    return pools


class _Pools:
    """Vertices and triangles of meshes: those in the world as one group, each that instances share as one of its own.

    Parameters
    ----------
    in_world, shared
        The meshes.
    before
        Pools of perhaps the same meshes, from which what has not moved is taken.
    keep_centre
        Whether the world's group may stand about the centre before.

    Attributes
    ----------
    vertices, triangles
        As of `PackedMeshes`; ``triangles`` are the same array as before where they are the same.
    groups : list of TriangleGroup
    first_triangles : list of int
        Of each mesh in the world.
    is_exact : bool
        Whether the world's group stands about its own centre.
    """

    def __init__(
        self, in_world: Sequence[Primitive], shared: Iterable[Mesh], before: _Pools | None, *, keep_centre: bool
    ) -> None:
        self.groups: list[TriangleGroup] = []
        self.is_exact = True
        self._placed: list[tuple[Mesh, Matrix]] = []
        self._slots: list[int] = []  # of each mesh, among the primitives of its instance
        self._ends = np.zeros((1, 2), np.int64)  # of the triangles and vertices of the meshes so far
        if in_world:
            self._add_world(in_world, before.groups[0].centre if keep_centre and before is not None else None)
        for mesh in shared:
            self._add([(mesh, affine(np.eye(3), -mesh.origin))], f"shared {mesh.content_hash}", None)
        self.first_triangles: list[int] = self._ends[: len(in_world), 0].tolist()
        self._reflects = [bool(np.linalg.det(matrix[:3, :3]) <= 0) for _, matrix in self._placed]
        if before is not None and not self._has_meshes_of(before):
            before = None
        self.triangles: NDArray[np.int32] = (
            np.concatenate(list(self._corners())) if before is None else before.triangles
        )
        self.vertices: NDArray[np.float32] = np.concatenate(list(self._points(before)))

    def boxes(self) -> NDArray[np.float32]:
        """Return lowest and highest corner of each group (groups, 2, 3)."""
        spans = [slice(group.first_vertex, group.first_vertex + group.vertices) for group in self.groups]
        points = [self.vertices[span, :3] for span in spans]
        return np.array([(each.min(axis=0), each.max(axis=0)) for each in points])

    def _add_world(self, placed: Sequence[Primitive], given: NDArray[np.float64] | None) -> None:
        """Add meshes taken to the world as one group, about a given centre or its own."""
        own = _centre(placed)
        centre = own if given is None else given
        self.is_exact = np.array_equal(own, centre)
        key, meshes = hashlib.sha256(), []
        for item in placed:
            local = item.placement.copy()
            local[:3, 3] -= centre
            key.update(_mesh_of(item).content_hash.encode() + local.tobytes())
            meshes.append((_mesh_of(item), local))
        self._add(meshes, key.hexdigest(), centre)

    def _add(self, placed: list[tuple[Mesh, Matrix]], key: str, centre: NDArray[np.float64] | None) -> None:
        """Add a group of meshes, each with the matrix that takes it to the frame of the group."""
        self._placed += placed
        self._slots += range(len(placed))
        sizes = np.array([(len(mesh.faces), len(mesh.positions)) for mesh, _ in placed])
        first_triangle, first_vertex = self._ends[-1].tolist()
        self._ends = np.vstack([self._ends, self._ends[-1] + np.cumsum(sizes, axis=0)])
        triangles, vertices = sizes.sum(axis=0).tolist()
        shift = np.zeros(3) if centre is None else centre
        self.groups.append(TriangleGroup(key, first_triangle, triangles, first_vertex, vertices, centre, shift))

    def _has_meshes_of(self, other: _Pools) -> bool:
        """Return whether the meshes are the same in all but their places."""
        one, two = (
            [(id(mesh), *rest) for (mesh, _), *rest in zip(each._placed, each._slots, each._reflects, strict=True)]
            for each in (self, other)
        )
        return one == two

    def _corners(self) -> Iterator[NDArray[np.int32]]:
        """Yield the triangles of each mesh."""
        for (mesh, _), slot, (_, first), reflects in zip(
            self._placed, self._slots, self._ends, self._reflects, strict=False
        ):
            corners = np.empty((len(mesh.faces), 4), np.int32)
            # A reflection turns the front of a triangle round; exchanging two corners turns it back.
            order = [0, 2, 1] if reflects else [0, 1, 2]
            np.add(mesh.faces[:, order], first, out=corners[:, :3], casting="unsafe")
            corners[:, 3] = slot
            yield corners

    def _points(self, before: _Pools | None) -> Iterator[NDArray[np.float32]]:
        """Yield the vertices of each mesh."""
        for place, (mesh, matrix) in enumerate(self._placed):
            if before is not None and np.array_equal(before._placed[place][1], matrix):
                yield before.vertices[slice(*self._ends[place : place + 2, 1])]
            else:
                yield _vertices(mesh, matrix)


def _vertices(mesh: Mesh, matrix: Matrix) -> NDArray[np.float32]:
    out = np.zeros((len(mesh.positions), VERTEX_FLOATS), np.float32)
    linear, offset = matrix[:3, :3], matrix[:3, :3] @ mesh.origin + matrix[:3, 3]
    turn = np.linalg.inv(linear).T
    step = 1 << 14  # float64 for a part at a time
    for start in range(0, len(out), step):
        part = slice(start, start + step)
        for k, column in enumerate(_products(linear, mesh.positions[part])):
            out[part, k] = column + offset[k]
        if mesh.normals is not None:
            normals = _products(np.asarray(turn, np.float64), mesh.normals[part])
            length = np.sqrt(normals[0] ** 2 + normals[1] ** 2 + normals[2] ** 2)
            for k, column in enumerate(normals, 3):
                out[part, k] = column / length
    if mesh.uvs is not None:
        out[:, 6:] = mesh.uvs
    return out


def _products(matrix: Matrix, rows: NDArray[np.floating[Any]]) -> list[NDArray[np.float64]]:
    """Return the columns of vectors (n, 3) under a matrix; BLAS takes ten times as long for so narrow ones."""
    x, y, z = rows.T.astype(np.float64)
    return [a * x + b * y + c * z for a, b, c in matrix.tolist()]


def _mesh_of(primitive: Primitive) -> Mesh:
    assert primitive.mesh is not None
    return primitive.mesh


def _centre(placed: Sequence[Primitive]) -> NDArray[np.float64]:
    corners = np.concatenate([corners_of_box(*_mesh_of(item).bounds(), item.placement) for item in placed])
    return np.asarray((corners.min(axis=0) + corners.max(axis=0)) / 2)


def with_meshes(primitives: Primitives, scene: Scene, parts: PlanParts) -> tuple[Primitives, PackedMeshes | None]:
    """Return the primitives with the meshes, which stand last, in the order that their pools need; and the pools."""
    meshes = primitives.of_meshes()
    if not len(meshes):
        return primitives, None
    solid = len(primitives.objects) - len(meshes.objects)
    first = len(primitives) - len(meshes)
    moves = meshes.of_runs(np.array([each.trajectory is not None for each in meshes.prototypes]))
    where = *meshes.meshes(), meshes.places.content, moves
    pools = parts.part("meshes", (where, first), lambda: pack_meshes(meshes, first, parts))
    eye = scene.metres_per_unit * np.array(scene.camera.eye)
    seen = parts.part("seen", (pools, eye), lambda: pools.seen_from(eye))
    return primitives.chosen(np.append(np.arange(solid), solid + pools.order)), seen
