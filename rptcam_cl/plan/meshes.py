"""Meshes of the scene as pools of vertices and triangles, in metres, each with its material.

A mesh that stands in the scene once is taken to the world, where all such meshes share one tree. One that several
objects use is held once, in its own frame, with a tree that its instances share; small ones are copied all the same, as
each instance on its way costs a ray more than a few triangles do. What moves is an instance always.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes import Mesh
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import INSTANCE
from rptcam_cl.plan.packed_meshes import VERTEX_FLOATS, PackedMeshes, TriangleGroup
from rptcam_cl.scene import Board, Material, MeshObject, Scene

__all__ = ["Mesh", "MeshPart", "mesh_parts"]


@dataclass(frozen=True, eq=False)
class MeshPart:
    """A mesh where an object has it.

    Attributes
    ----------
    mesh : Mesh
        The same object wherever the same triangles are used.
    placement : (4, 4) float64
        From the mesh's own coordinates (its origin added to its positions) to the world [scene units], when the shutter
        opens. A reflection
        carries the front side along: it stays where the corners run counter-clockwise in the mesh's own coordinates.
    material : Material
    name : str or None
        Of the object, or of the part in its file.
    """

    mesh: Mesh
    placement: NDArray[np.float64]
    material: Material
    name: str | None


def mesh_parts(scene: Scene, item: MeshObject | Board) -> tuple[MeshPart, ...]:
    """Return the parts of one of a scene's mesh objects, in the order of the file.

    Raises
    ------
    InputError
        When the mesh cannot be used; a scene from `load_scene` has been checked.
    """
    loaded = scene.load_mesh(item)
    return tuple(
        MeshPart(part.mesh, item.placed_at(scene.shutter.open_s) @ part.placement, material, part.name or item.name)
        for part, material in zip(loaded.contents.parts, loaded.materials, strict=True)
    )


MOST_COPIED = 1 << 14  # triangles that copies of one mesh may add to the common tree

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlacedMesh:
    """A mesh and its placement: the scene in metres, from the mesh's frame."""

    mesh: Mesh
    placement: Matrix
    moves: bool = False


@dataclass(frozen=True, eq=False)
class MeshPlan:
    """The packed meshes, and where each placed mesh is found in them.

    Attributes
    ----------
    packed : PackedMeshes
    order : tuple of int
        The placed meshes in the order in which their primitives must stand.
    instances, first_triangles : tuple of int
        Per placed mesh, in that order: its instance and its first triangle in the pool.
    """

    packed: PackedMeshes
    order: tuple[int, ...]
    instances: tuple[int, ...]
    first_triangles: tuple[int, ...]


def pack_meshes(placed: Sequence[PlacedMesh], eye: NDArray[np.float64], first_primitive: int) -> MeshPlan:
    """Return the pools of some placed meshes.

    Parameters
    ----------
    placed
        At least one.
    eye
        Position of the eye [m], which becomes the origin. Trees do not depend on it.
    first_primitive
        Index of the first primitive that is a mesh.
    """
    uses = Counter(id(item.mesh) for item in placed if not item.moves)
    is_shared = [item.moves or (uses[id(item.mesh)] - 1) * len(item.mesh.faces) > MOST_COPIED for item in placed]
    copied = [i for i, share in enumerate(is_shared) if not share]
    shared = [i for i, share in enumerate(is_shared) if share]
    pools = _Pools()
    first = pools.add_world([placed[i] for i in copied], eye) if copied else []
    group_of: dict[int, int] = {}
    for mesh in (placed[i].mesh for i in shared):
        if id(mesh) not in group_of:
            group_of[id(mesh)] = pools.add_shared(mesh)
    groups = [group_of[id(placed[i].mesh)] for i in shared]
    packed = PackedMeshes(
        vertices=np.concatenate(pools.vertices),
        triangles=np.concatenate(pools.triangles),
        groups=tuple(pools.groups),
        instances=_instances([placed[i] for i in shared], eye, first_primitive, len(copied)),
        group_of_instance=np.array([0] * bool(copied) + groups),
        instanced=bool(shared),
    )
    own = [bool(copied) + place for place in range(len(shared))]
    return MeshPlan(
        packed=packed,
        order=(*copied, *shared),
        instances=(*[0] * len(copied), *own),
        first_triangles=(*first, *(pools.groups[group].first_triangle for group in groups)),
    )


class _Pools:
    """Vertices and triangles under collection."""

    def __init__(self) -> None:
        self.vertices: list[NDArray[np.float32]] = []
        self.triangles: list[NDArray[np.int32]] = []
        self.groups: list[TriangleGroup] = []
        self._vertex_count = 0
        self._triangle_count = 0

    def add_world(self, placed: Sequence[PlacedMesh], eye: NDArray[np.float64]) -> list[int]:
        """Add meshes taken to the world as one group; return the first triangle of each."""
        centre = _centre(placed)
        key = hashlib.sha256()
        first_triangle, first_vertex = self._triangle_count, self._vertex_count
        starts = []
        for slot, item in enumerate(placed):
            local = item.placement.copy()
            local[:3, 3] -= centre
            key.update(item.mesh.content_hash.encode() + local.tobytes())
            starts.append(self._append(item.mesh, local, slot))
        self._close(key.hexdigest(), first_triangle, first_vertex, centre - eye)
        return starts

    def add_shared(self, mesh: Mesh) -> int:
        """Add a mesh in its own frame as a group of its own; return the group's index."""
        first_triangle, first_vertex = self._triangle_count, self._vertex_count
        self._append(mesh, _about_origin(mesh), 0)
        self._close(f"shared {mesh.content_hash}", first_triangle, first_vertex, np.zeros(3))
        return len(self.groups) - 1

    def _append(self, mesh: Mesh, matrix: Matrix, slot: int) -> int:
        start = self._triangle_count
        corners = np.empty((len(mesh.faces), 4), np.int32)
        # A reflection turns the front of a triangle round; exchanging two corners turns it back.
        order = [0, 1, 2] if np.linalg.det(matrix[:3, :3]) > 0 else [0, 2, 1]
        np.add(mesh.faces[:, order], self._vertex_count, out=corners[:, :3], casting="unsafe")
        corners[:, 3] = slot
        self.vertices.append(_vertices(mesh, matrix))
        self.triangles.append(corners)
        self._vertex_count += len(mesh.positions)
        self._triangle_count += len(corners)
        return start

    def _close(self, key: str, first_triangle: int, first_vertex: int, shift: NDArray[np.float64]) -> None:
        triangles, vertices = self._triangle_count - first_triangle, self._vertex_count - first_vertex
        self.groups.append(TriangleGroup(key, first_triangle, triangles, first_vertex, vertices, shift))


def _vertices(mesh: Mesh, matrix: Matrix) -> NDArray[np.float32]:
    out = np.zeros((len(mesh.positions), VERTEX_FLOATS), np.float32)
    linear, offset = matrix[:3, :3], matrix[:3, :3] @ mesh.origin + matrix[:3, 3]
    step = 1 << 18  # float64 for a part at a time
    for start in range(0, len(out), step):
        part = slice(start, start + step)
        out[part, :3] = mesh.positions[part] @ linear.T + offset
        if mesh.normals is not None:
            out[part, 3:6] = _unit(mesh.normals[part] @ np.linalg.inv(linear))
    if mesh.uvs is not None:
        out[:, 6:] = mesh.uvs
    return out


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _about_origin(mesh: Mesh) -> Matrix:
    """Return the matrix that takes the mesh's origin to zero."""
    matrix = np.eye(4)
    matrix[:3, 3] = -mesh.origin
    return matrix


def _centre(placed: Sequence[PlacedMesh]) -> NDArray[np.float64]:
    boxes = [corners_of_box(*item.mesh.bounds(), item.placement) for item in placed]
    corners = np.concatenate(boxes)
    return np.asarray((corners.min(axis=0) + corners.max(axis=0)) / 2)


def corners_of_box(low: NDArray[np.float64], high: NDArray[np.float64], matrix: Matrix) -> NDArray[np.float64]:
    """Return the eight corners of a box (8, 3) under a matrix."""
    choice = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    corners = np.where(choice, high, low)
    return np.asarray(corners @ matrix[:3, :3].T + matrix[:3, 3])


def _instances(
    shared: Sequence[PlacedMesh], eye: NDArray[np.float64], first_primitive: int, copied: int
) -> NDArray[np.void]:
    """Return instance records: one for the copied meshes, if any, then one for each shared."""
    records = INSTANCE.zeros(len(shared) + bool(copied))
    if copied:
        _set_transform(records[0], np.eye(4))
        records[0]["first_primitive"], records[0]["primitives"] = first_primitive, copied
    for record, item, place in zip(records[bool(copied) :], shared, range(len(shared)), strict=True):
        world = item.placement.copy()
        world[:3, 3] += item.placement[:3, :3] @ item.mesh.origin - eye
        _set_transform(record, world)
        record["first_primitive"], record["primitives"] = first_primitive + copied + place, 1
    return records


def _set_transform(record: np.void, world_from_mesh: Matrix) -> None:
    inverse = np.linalg.inv(world_from_mesh)
    for axis, name in enumerate("xyz"):
        record[f"row_{name}"] = inverse[axis]
        record[f"world_{name}"] = world_from_mesh[axis]
