"""The scene's geometry as the device holds it: records of primitives and their owners, movements, and triangles."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.records import HUGE_POWER, INSTANCE, MOTION_MARGIN, PRIMITIVE, SEGMENT, Kind, fill
from rptcam_cl.rendering.plan import primitives as solids
from rptcam_cl.rendering.plan.primitives import Matrix, Placements, PlanParts, Primitive, Primitives
from rptcam_cl.scene.assets.mesh import Mesh
from rptcam_cl.scene.placement import Trajectory, moments, quaternion_of
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]

MOST = float(np.finfo(np.float32).max)
SPAN_BITS = 15  # of kernels/geometry/cubic_curve.h


def _spheres_of(placements: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Return centres (n, 3) and radii (n,) of unit spheres under similarities, and the power of the eye for each [m²].

    That is its squared distance from the centre, less the square of the radius.
    """
    centers, radii = placements[:, :3, 3], np.cbrt(np.abs(np.linalg.det(placements[:, :3, :3])))
    distances = np.sqrt((centers[:, None, :] @ centers[:, :, None])[:, 0, 0])
    return centers, radii, (distances - radii) * (distances + radii)


def has_huge_sphere(primitives: Primitives) -> bool:
    """Return whether a sphere is so large beside its distance from the eye that kernels take the eye's power.

    In float32 centre and radius place its surface within 6e-8 of the radius: a globe of Earth's size within 0.4 m.
    """
    runs, _ = primitives.by_kind().get(Kind.SPHERE, (slice(0), slice(0)))
    spheres = (_spheres_of(placements) for _, _, placements in primitives.places.blocks(runs))
    return any(bool(np.any(np.abs(powers) < HUGE_POWER * radii**2)) for _, radii, powers in spheres)


def pack_primitives(
    primitives: Primitives, materials: dict[int, int], emitters: dict[int, int], meshes: PackedMeshes | None
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
        Those of the last primitives, where some are meshes.
    """
    records = PRIMITIVE.zeros(len(primitives))
    for kind, (runs, members) in primitives.by_kind().items():
        for part, _, placements in primitives.places.blocks(runs):
            rows = _rows(kind, placements)
            for place, axis in enumerate("xyz"):
                records[f"row_{axis}"][members][part] = rows[:, place]
    if len(primitives):
        records["material"] = primitives.of_each(lambda each: materials[id(each.material)])
        records["emitter"] = -1
        records["emitter"][[*emitters]] = [*emitters.values()]
        _fill_curves(primitives, records)
    _count_shared_planes(primitives, records)
    if meshes is not None:
        own = records[-len(meshes.first_triangles) :]
        own["instance"], own["first_triangle"] = meshes.instance_of, meshes.first_triangles
    ends = np.append(primitives.places.ends, 0)
    return records, ends[np.searchsorted(primitives.kinds, list(Kind), side="right") - 1].astype(np.int32)


def _rows(kind: Kind, placements: Matrix) -> NDArray[np.float32]:
    """Return the rows (n, 3, 4) of the records of primitives of a kind."""
    if kind is Kind.CURVE:
        return placements[:, :3].astype(np.float32)
    if kind is not Kind.SPHERE:
        rows = np.linalg.inv(placements)[:, :3]
        if kind in (Kind.RECTANGLE, Kind.DISK, Kind.PLANE):  # their normal, so that kernels need not divide
            rows[:, 2] /= np.linalg.norm(rows[:, 2, :3], axis=1, keepdims=True)
        return np.asarray(rows.astype(np.float32) + 0.0)  # no -0: kernels test bits
    centers, radii, powers = _spheres_of(placements)
    axes = placements[:, :3, :3] / radii[:, None, None]
    columns = (
        (centers, radii),
        (axes[:, :, 0], np.sign(np.linalg.det(axes))),
        (axes[:, :, 2], np.clip(powers, -MOST, MOST)),
    )
    return np.stack([np.column_stack(pair) for pair in columns], axis=1).astype(np.float32)


def _fill_curves(primitives: Primitives, records: NDArray[np.void]) -> None:
    """Write widths of curves and their places along strands where `kernels/geometry/cubic_curve.h` looks for them."""
    runs, members = primitives.by_kind().get(Kind.CURVE, (slice(0), slice(0)))
    most = (1 << SPAN_BITS) - 1
    for part, _, placements in primitives.places.blocks(runs):
        ends, some = placements[:, 3], records[members][part]
        set_half_widths(some, ends[:, :2])
        begin, end = np.rint(most * ends[:, 2:]).astype(np.int32).T
        some["emitter"] = -1 - (begin | end << SPAN_BITS)


# What records of flat primitives and of curves hold in the place of a mesh's instance and first triangle; kernels read
# it by functions of like names (kernels/geometry/primitives.h, cubic_curve.h).


def set_half_widths(curves: NDArray[np.void], ends: Matrix) -> None:
    """Write half the widths of curves (n, 2) at both ends [m]; less than zero of ribbons."""
    curves["instance"], curves["first_triangle"] = ends.astype(np.float32).T.copy().view(np.int32)


def half_widths(curves: NDArray[np.void]) -> NDArray[np.float32]:
    """Return half the widths of curves (n, 2) at both ends [m]; less than zero of ribbons."""
    return np.stack([curves["instance"], curves["first_triangle"]], axis=1).view(np.float32)


def set_flats_in_plane(flats: NDArray[np.void], counts: int | NDArray[np.intp]) -> None:
    """Write into the first of flat primitives that lie in a plane in turn and stay how many they are; 0 into others."""
    flats["instance"] = counts


def begins_plane(flats: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return which flat primitives are the first of their plane."""
    return np.asarray(flats["instance"] != 0)


def mark_outer_planes(flats: NDArray[np.void], which: NDArray[np.intp]) -> None:
    """Mark some flat primitives, first of their planes, as such that nothing lies behind."""
    flats["instance"][which] *= -1


def _count_shared_planes(primitives: Primitives, records: NDArray[np.void]) -> None:
    """Count the rectangles or disks that follow one another in a plane and stay there."""
    for kind, (runs, members) in primitives.by_kind().items():
        if kind is Kind.PLANE:
            set_flats_in_plane(records[members], 1)
        if kind not in (Kind.RECTANGLE, Kind.DISK):
            continue
        own = records[members]
        stands = primitives.of_runs(np.array([each.trajectory is None for each in primitives.prototypes]))
        still = np.repeat(stands[runs], primitives.places.counts[runs])
        alike = (own["row_z"][1:] == own["row_z"][:-1]).all(axis=1) & still[1:] & still[:-1]
        first = np.append(True, ~alike)
        counts = np.zeros(len(own), np.intp)
        counts[first] = np.diff(np.append(np.flatnonzero(first), len(own)))
        set_flats_in_plane(own, counts)


@dataclass(frozen=True)
class Owners:
    """Identifiers by primitive, and names by identifier.

    Attributes
    ----------
    of_run : (runs, 2) array
        Identifier of the object, its index in the scene's list, and of the material.
    counts : (runs,) array
        Primitives of each run.
    objects : tuple of str
        Name of each object; its place in the scene where it has none.
    materials : tuple of str
        Name of each material: first the scene's named ones in their order, then those written out in an object, by
        their place.
    """

    of_run: NDArray[np.int32]
    counts: NDArray[np.int64]
    objects: tuple[str, ...]
    materials: tuple[str, ...]

    @property
    def of_primitive(self) -> NDArray[np.int32]:
        """Identifiers of object and material (n, 2) of each primitive."""
        return np.repeat(self.of_run, self.counts, axis=0)


def owners_of(scene: Scene, primitives: Primitives, parts: PlanParts) -> Owners:
    """Return the owners of the primitives of a scene."""

    def names_of_objects() -> tuple[str, ...]:
        return tuple(item.name or f"objects.{index}" for index, item in enumerate(scene.objects))

    objects = parts.part("names of objects", (scene.objects,), names_of_objects)
    names = list(scene.materials)
    identifiers = {id(material): index for index, material in enumerate(scene.materials.values())}
    unnamed = primitives.runs_of(lambda each: id(each.material) not in identifiers)
    for run in unnamed[np.argsort(primitives.objects[unnamed], kind="stable")].tolist():
        material = primitives.prototypes[primitives.prototype_of[run]].material
        if id(material) not in identifiers:
            identifiers[id(material)] = len(names)
            names.append(f"objects.{primitives.objects[run]}.material")
    if not len(primitives):  # as OpenCL has no empty buffers
        return Owners(np.zeros((1, 2), np.int32), np.ones(1, np.int64), objects, tuple(names))
    shown = primitives.of_runs(np.array([identifiers[id(each.material)] for each in primitives.prototypes]))
    of_run = np.stack([primitives.objects, shown], axis=1).astype(np.int32)
    return Owners(of_run, primitives.places.counts, objects, tuple(names))


# Everything that moves while the shutter is open, in metres about the eye, as the device holds it.

_STEPS_PER_TURN = 64
MOST_STEPS = 1024  # of a segment


@dataclass(frozen=True, eq=False)
class Places(Rows):
    """Places that a body takes one after another.

    Attributes
    ----------
    matrices : (n, 4, 4) array
        To there from where the body is at rest.
    pivots : (n, 3) array
        About which it turns [m].
    bends : (n,) array
        How far at most a point gets off the straight line to the next place, per distance from the pivot.
    """

    matrices: Array
    pivots: Array
    bends: Array

    def box(self, low: Array, high: Array, rest: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return the corners (3,) of a box round the whole way.

        Parameters
        ----------
        low, high
            Corners of boxes round the body at each place (n, 3).
        rest
            Corners (3,) of a box round the body at rest.
        """
        corners = np.stack(rest)
        reach = np.linalg.norm(np.maximum(*np.abs(corners[:, None] - self.pivots)), axis=1)
        margin = self.bends * reach + MOTION_MARGIN * (reach + np.linalg.norm(self.pivots, axis=1))
        return (low - margin[:, None]).min(axis=0), (high + margin[:, None]).max(axis=0)


@dataclass(frozen=True, eq=False)
class ObjectMovements:
    """The segments of everything that moves.

    Attributes
    ----------
    segments : array of ``Segment`` records
        See ``kernels/geometry/movement.h``.
    of_primitive : (n, 2) int32 array
        First segment and number of segments of each primitive; none for what stands still.
    """

    segments: NDArray[np.void]
    of_primitive: NDArray[np.int32]

    @property
    def facts(self) -> dict[str, int]:
        """Facts for the compilation of the kernels."""
        most = int(self.of_primitive[:, 1].max(initial=0))
        turning = bool((self.segments["travel"][:, 3] != 0).any())
        return {"HAS_MOTION": int(most > 0), "MOTION_SEGMENTS": min(most, 2), "MOTION_TURNS": int(turning)}

    def places(self, primitive: int) -> Places:
        """Return places that a moving primitive takes, close enough to each other to bound the way between them."""
        first, count = self.of_primitive[primitive]
        return Places.joined([_places(segment) for segment in self.segments[first : first + count]])


def _places(segment: np.void) -> Places:
    pivot, shift, travel = (segment[name].astype(np.float64)[:3] for name in ("pivot", "shift", "travel"))
    turns = float(segment["travel"][3])
    steps = int(np.clip(np.ceil(abs(turns) * _STEPS_PER_TURN), 1, MOST_STEPS))
    shares = np.linspace(0, 1, steps + 1)
    half = np.pi * turns * shares[:, None]
    axis = segment["axis"].astype(np.float64)[:3]
    matrices = np.tile(np.eye(4), (len(shares), 1, 1))
    matrices[:, :3, :3] = _rotations(np.hstack([np.sin(half) * axis, np.cos(half)])) @ _rotations(segment["turn"][None])
    matrices[:, :3, 3] = pivot + shift + shares[:, None] * travel - matrices[:, :3, :3] @ pivot
    bend = min((2 * np.pi * turns / steps) ** 2 / 8, 2.0)
    return Places(matrices, np.tile(pivot, (len(shares), 1)), np.full(len(shares), bend))


def _rotations(quaternions: NDArray[np.floating]) -> Array:
    """Return the matrices (n, 3, 3) of quaternions x, y, z, w."""
    x, y, z, w = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).astype(np.float64).T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    return np.asarray(np.eye(3) + 2 * w[:, None, None] * cross + 2 * cross @ cross)


def pack_movements(scene: Scene, primitives: Primitives) -> ObjectMovements:
    """Return the segments of the primitives that move; those of one object share them."""
    segments: list[NDArray[np.void]] = []
    place_of: dict[int, tuple[int, int]] = {}
    count = 0
    moving = primitives.runs_of(lambda each: each.trajectory is not None)
    of_runs = np.zeros((len(primitives.objects), 2), np.int32)
    for run in moving.tolist():
        index, trajectory = int(primitives.objects[run]), primitives.prototypes[primitives.prototype_of[run]].trajectory
        if trajectory is not None and index not in place_of:
            segments.append(_segments(trajectory, scene))
            place_of[index] = count, len(segments[-1])
            count += len(segments[-1])
        of_runs[run] = place_of[index]
    if not segments:
        return ObjectMovements(SEGMENT.zeros(1), np.broadcast_to(np.int32(0), (max(len(primitives), 1), 2)))
    return ObjectMovements(np.concatenate(segments), np.repeat(of_runs, primitives.places.counts, axis=0))


def _segments(trajectory: Trajectory, scene: Scene) -> NDArray[np.void]:
    begin, end = scene.shutter.span_s
    times = moments(trajectory.frames, begin, end)
    places = [trajectory.at(time) for time in times]
    unit, rest = scene.metres_per_unit, places[0]
    segments = SEGMENT.zeros(len(times) - 1)
    for segment, (t0, t1), (first, second) in zip(segments, pairwise(times), pairwise(places), strict=True):
        axis, turns = trajectory.turn(t0, t1)
        fill(
            segment,
            pivot=(*(unit * (rest[:3, 3] - scene.camera.eye)), t0 - begin),
            shift=(*(unit * (first[:3, 3] - rest[:3, 3])), 1.0 / (t1 - t0)),
            travel=(*(unit * (second[:3, 3] - first[:3, 3])), turns),
            axis=axis,
            turn=quaternion_of(first[:3, :3] @ rest[:3, :3].T),
        )
    if not (segments["travel"][:, 3].any() or segments["turn"][:, :3].any()):
        segments["pivot"][:, :3] = 0.0  # of what does not turn any point will do, and a far one rounds
    return segments


# Triangles: pools of vertices and triangles, and who uses them.

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
        return solids.are_same(one, two)

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
            self._add([(mesh, solids.affine(np.eye(3), -mesh.origin))], f"shared {mesh.content_hash}", None)
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
    corners = np.concatenate([solids.corners_of_box(*_mesh_of(item).bounds(), item.placement) for item in placed])
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
