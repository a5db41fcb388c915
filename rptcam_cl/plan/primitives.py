"""Objects of the scene as primitives: canonical shapes with an affine placement, in metres about the eye."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import PRIMITIVE, Kind
from rptcam_cl.core.vectors import cross
from rptcam_cl.plan.meshes import Mesh, MeshPlan, PlacedMesh, mesh_parts, pack_meshes
from rptcam_cl.plan.parts import PlanParts
from rptcam_cl.scene import Board, Material, MeshObject, PlacedObject, Scene, Trajectory
from rptcam_cl.scene import shape as shapes

Matrix = NDArray[np.float64]

HUGE_POWER = 2e-3  # of the squared radius, as in kernels/geometry/primitives.h
MOST = float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class Primitive:
    """One primitive.

    Attributes
    ----------
    kind : Kind
    placement : (4, 4) array
        Maps the canonical shape of the kind (see ``kernels/geometry/primitives.h``) to the world [m], the eye at the
        origin.
        A mesh's placement: the scene [m], from the mesh's frame.
    material : Material
    object : int
        Index of the object of the scene that it belongs to.
    mesh : Mesh or None
    trajectory : Trajectory or None
        Its way while the shutter is open, None where it stands still; the placement is that at the opening.
    """

    kind: Kind
    placement: Matrix
    material: Material
    object: int
    mesh: Mesh | None = None
    trajectory: Trajectory | None = None


def affine(columns: ArrayLike, origin: ArrayLike) -> Matrix:
    """Return the 4x4 matrix with the given 3x3 linear part and origin."""
    matrix = np.eye(4)
    matrix[:3, :3] = columns
    matrix[:3, 3] = origin
    return matrix


def turn_to(direction: ArrayLike) -> Matrix:
    """Return the 3x3 rotation that takes +z to a direction the short way (about x when it is -z)."""
    z = np.asarray(direction, dtype=np.float64)
    z = z / np.linalg.norm(z)
    if z[2] < -1 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0.0, 0.0, z[0]], [0.0, 0.0, z[1]], [-z[0], -z[1], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + z[2]))


def _disk(center: ArrayLike, normal: ArrayLike, radius: float) -> tuple[Kind, Matrix]:
    return Kind.DISK, affine(turn_to(normal) * (radius, radius, 1.0), center)


def _round(kind: Kind, base: ArrayLike, end: ArrayLike, radius: float) -> tuple[Kind, Matrix]:
    axis = np.subtract(end, base)
    return kind, affine(turn_to(axis) * np.array([radius, radius, np.linalg.norm(axis)]), base)


def _canonical(item: shapes.Object) -> Iterator[tuple[Kind, Matrix]]:
    """Yield kind and placement (before the object's transform, in scene units) of each primitive of an object."""
    match item:
        case shapes.Sphere():
            yield Kind.SPHERE, affine(item.radius * np.eye(3), item.center)
        case shapes.Disk():
            yield _disk(item.center, item.normal, item.radius)
        case shapes.Rectangle():
            u, v = np.array(item.edge_u), np.array(item.edge_v)
            normal = cross(u, v)
            yield Kind.RECTANGLE, affine(np.stack([u, v, normal / np.linalg.norm(normal)], axis=1), item.corner)
        case shapes.Box():
            low, high = np.array(item.min), np.array(item.max)
            yield Kind.BOX, affine(np.diag((high - low) / 2), (high + low) / 2)
        case shapes.Cylinder():
            yield _round(Kind.CYLINDER, item.base, item.top, item.radius)
            if item.capped:
                yield _disk(item.base, np.subtract(item.base, item.top), item.radius)
                yield _disk(item.top, np.subtract(item.top, item.base), item.radius)
        case shapes.Cone():
            yield _round(Kind.CONE, item.base, item.apex, item.radius)
            if item.capped:
                yield _disk(item.base, np.subtract(item.base, item.apex), item.radius)
        case shapes.Plane():
            yield Kind.PLANE, affine(turn_to(item.normal), item.point)


def _is_similarity(linear: Matrix) -> bool:
    gram = linear.T @ linear
    return bool(np.abs(gram - gram[0, 0] * np.eye(3)).max() <= 1e-9 * gram[0, 0])


def world_from_scene(scene: Scene) -> Matrix:
    """Return the 4x4 matrix from scene units to the world: metres, with the eye at the origin."""
    scale = scene.metres_per_unit
    return affine(scale * np.eye(3), -scale * np.array(scene.camera.eye))


def scene_primitives(scene: Scene) -> list[Primitive]:
    """Return every primitive of the scene, sorted by kind and otherwise in the order of the scene."""
    world = world_from_scene(scene)
    found = []
    for index, item in enumerate(scene.objects):
        if isinstance(item, MeshObject | Board):
            found += _mesh_primitives(scene, item, index)
            continue
        for kind, canonical in _canonical(item):
            placement = world @ item.placed_at(scene.shutter.open_s) @ canonical
            if kind is Kind.SPHERE and not _is_similarity(placement[:3, :3]):
                kind = Kind.ELLIPSOID
            found.append(Primitive(kind, placement, item.material, index, trajectory=_trajectory(scene, item)))
    return sorted(found, key=lambda primitive: primitive.kind)


def object_frame(item: shapes.Object, time_s: float) -> Matrix:
    """Return the 4x4 matrix that takes the canonical shape of an object to the scene [scene units] at a moment.

    The points of a surface keep their coordinates in it while the object moves, and while the keys of its shape change.
    """
    placed = item.placed_at(time_s)
    return placed if isinstance(item, MeshObject | Board) else np.asarray(placed @ next(_canonical(item))[1])


def _mesh_primitives(scene: Scene, item: MeshObject | Board, index: int) -> list[Primitive]:
    scale = affine(scene.metres_per_unit * np.eye(3), np.zeros(3))
    parts = mesh_parts(scene, item)
    trajectory = _trajectory(scene, item)
    return [Primitive(Kind.MESH, scale @ part.placement, part.material, index, part.mesh, trajectory) for part in parts]


def _trajectory(scene: Scene, item: PlacedObject) -> Trajectory | None:
    """Return the way of an object, None where it stands still while the shutter is open."""
    return item.trajectory if item.trajectory is not None and item.trajectory.moves(*scene.shutter.span_s) else None


def sphere_of(placement: Matrix) -> tuple[NDArray[np.float64], float]:
    """Return centre and radius of a unit sphere under a similarity."""
    return placement[:3, 3], float(np.cbrt(abs(np.linalg.det(placement[:3, :3]))))


def eye_power(placement: Matrix) -> float:
    """Return the power of the eye with respect to a sphere: its squared distance from the centre, less r² [m²]."""
    center, radius = sphere_of(placement)
    distance = float(np.linalg.norm(center))
    return (distance - radius) * (distance + radius)


def has_huge_sphere(primitives: list[Primitive]) -> bool:
    """Return whether a sphere is so large beside its distance from the eye that kernels take the eye's power.

    In float32 centre and radius place its surface within 6e-8 of the radius: a globe of Earth's size within 0.4 m.
    """
    spheres = (primitive.placement for primitive in primitives if primitive.kind is Kind.SPHERE)
    return any(abs(eye_power(placement)) < HUGE_POWER * sphere_of(placement)[1] ** 2 for placement in spheres)


def with_meshes(primitives: list[Primitive], scene: Scene, parts: PlanParts) -> tuple[list[Primitive], MeshPlan | None]:
    """Return the primitives with the meshes, which stand last, in the order that their pools need; and the pools."""
    solid = [primitive for primitive in primitives if primitive.mesh is None]
    meshes = [primitive for primitive in primitives if primitive.mesh is not None]
    if not meshes:
        return solid, None
    placed = [
        PlacedMesh(primitive.mesh, primitive.placement, moves=primitive.trajectory is not None)
        for primitive in meshes
        if primitive.mesh is not None
    ]
    eye = scene.metres_per_unit * np.array(scene.camera.eye)
    where = tuple((item.mesh, item.placement.tobytes(), item.moves) for item in placed)
    of = where, eye.tobytes(), len(solid)
    plan = parts.part("meshes", of, lambda: pack_meshes(placed, eye, len(solid)))
    return solid + [meshes[index] for index in plan.order], plan


def pack_primitives(
    primitives: list[Primitive], materials: dict[int, int], emitters: dict[int, int], meshes: MeshPlan | None
) -> tuple[NDArray[np.void], NDArray[np.int32]]:
    """Return the records and, per kind, the index after its last one.

    Parameters
    ----------
    primitives
        Sorted by kind.
    materials
        Record index of each material, by ``id``.
    emitters
        Index of the sampled emitter, by index of the primitive.
    meshes
        Where those of the primitives that are meshes have their triangles.
    """
    records = PRIMITIVE.zeros(len(primitives))
    for index, primitive in enumerate(primitives):
        if primitive.kind is Kind.SPHERE:
            center, radius = sphere_of(primitive.placement)
            axes = primitive.placement[:3, :3] / radius
            records[index]["row_x"] = (*center, radius)
            records[index]["row_y"] = (*axes[:, 0], np.sign(np.linalg.det(axes)))
            records[index]["row_z"] = (*axes[:, 2], np.clip(eye_power(primitive.placement), -MOST, MOST))
        elif primitive.kind is not Kind.MESH:
            inverse = np.linalg.inv(primitive.placement)
            for name, row in zip(("row_x", "row_y", "row_z"), inverse[:3], strict=True):
                records[index][name] = row.astype(np.float32) + 0.0  # no -0: kernels test bits of coordinates
        records[index]["material"] = materials[id(primitive.material)]
        records[index]["emitter"] = emitters.get(index, -1)
    _count_shared_planes(primitives, records)
    if meshes is not None:
        records["instance"][-len(meshes.order) :] = meshes.instances
        records["first_triangle"][-len(meshes.order) :] = meshes.first_triangles
    ends = [sum(primitive.kind <= kind for primitive in primitives) for kind in Kind]
    return records, np.array(ends, np.int32)


@dataclass(frozen=True)
class Owners:
    """Identifiers by primitive, and names by identifier.

    Attributes
    ----------
    of_primitive : (n, 2) array
        Identifier of the object, its index in the scene's list, and of the material.
    objects : tuple of str
        Name of each object; its place in the scene where it has none.
    materials : tuple of str
        Name of each material: first the scene's named ones in their order, then those written out in an object, by
        their place.
    """

    of_primitive: NDArray[np.int32]
    objects: tuple[str, ...]
    materials: tuple[str, ...]


def owners_of(scene: Scene, primitives: Sequence[Primitive]) -> Owners:
    """Return the owners of the primitives of a scene."""
    objects = tuple(item.name or f"objects.{index}" for index, item in enumerate(scene.objects))
    names = list(scene.materials)
    identifiers = {id(material): index for index, material in enumerate(scene.materials.values())}
    rows = np.zeros((max(len(primitives), 1), 2), np.int32)  # as OpenCL has no empty buffers
    for primitive in sorted(primitives, key=lambda primitive: primitive.object):
        if id(primitive.material) not in identifiers:
            identifiers[id(primitive.material)] = len(names)
            names.append(f"objects.{primitive.object}.material")
    for row, primitive in zip(rows, primitives, strict=False):
        row[:] = primitive.object, identifiers[id(primitive.material)]
    return Owners(rows, objects, tuple(names))


def _count_shared_planes(primitives: list[Primitive], records: NDArray[np.void]) -> None:
    """Write, into the first of rectangles or disks that follow one another in a plane and stay there, their number."""
    first = 0
    for index, primitive in enumerate(primitives):
        if primitive.kind not in (Kind.RECTANGLE, Kind.DISK):
            continue
        before = primitives[index - 1]
        still = primitive.trajectory is None and before.trajectory is None
        same = (records["row_z"][index] == records["row_z"][index - 1]).all()
        if index == 0 or primitive.kind is not before.kind or not (still and same):
            first = index
        records["instance"][first] += 1
