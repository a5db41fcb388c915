"""Objects of the scene as primitives: canonical shapes with an affine placement, in metres about the eye."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.files import Folders
from rptcam_cl.core.records import HUGE_POWER, INSTANCE, MOTION_MARGIN, PRIMITIVE, SEGMENT, Kind, fill
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.model import CameraModel, turned
from rptcam_cl.rendering.plan.environment import Surroundings, pack_environment
from rptcam_cl.rendering.plan.materials import Materials, pack_materials
from rptcam_cl.rendering.plan.textures import KnownSpectra, Textures, TextureTable
from rptcam_cl.scene.assets.mesh import Mesh
from rptcam_cl.scene.base import file_references
from rptcam_cl.scene.camera import CameraKind
from rptcam_cl.scene.exposure import Exposure, Shutter
from rptcam_cl.scene.film import Film, SpectrumSettings
from rptcam_cl.scene.materials import Material
from rptcam_cl.scene.meshes import LoadedMesh, MeshObject
from rptcam_cl.scene.placement import PlacedObject, Trajectory, moments, quaternion_of
from rptcam_cl.scene.quantities import cross
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.shapes import Board, Box, Cone, Curves, Cylinder, Disk, Object, Plane, Rectangle, Sphere

# What the last plan was made of, for the next: the frames of a dataset and what a viewfinder shows change little.

Part = TypeVar("Part")
_BY_VALUE = (str, bytes, int, float, CameraKind, Film, Exposure, Shutter, SpectrumSettings)


@dataclass(frozen=True, eq=False)
class Appearance:
    """What surfaces and surroundings look like: records, textures and spectra."""

    table: TextureTable
    spectra: KnownSpectra
    shown: Materials
    surroundings: Surroundings

    def copy(self) -> Appearance:
        """Return these to be added to: lights have textures and spectra too, and write into the surroundings."""
        surroundings = replace(self.surroundings, record=self.surroundings.record.copy())
        return Appearance(self.table.copy(), self.spectra.copy(), self.shown, surroundings)


class PlanParts:
    """Keeps each part of a plan until it is made of something else.

    Attributes
    ----------
    rough : bool
        Whether plans are for glances: then meshes may stand about an earlier middle of the scene, which rounds them in
        another way, so that those that do not move are taken as they are. `drop_rough` ends it.
    held : dict or None
        Facts of kernels that plans are to be made for, as far as those do for them; see `serve` of `plan.py`.
    """

    def __init__(self) -> None:
        self.rough = False
        self.held: dict[str, int] | None = None
        self._known: dict[str, tuple[tuple[Any, ...], Any]] = {}
        self.placed: tuple[Any, dict[int, _PlacedMesh]] = None, {}  # unit and shutter; by the index of the object

    def part(self, name: str, of: tuple[Any, ...], make: Callable[[], Part]) -> Part:
        """Return the part of a name that is made of the same as before, else what ``make`` returns; not to be changed.

        Parameters
        ----------
        of
            Instances that do not change, or what compares by its content; tuples of them.
        """
        known = self._known.get(name)
        if known is None or not _are_same(known[0], of):
            known = self._known[name] = of, make()
        part: Part = known[1]
        return part

    def pools(self, in_world: Sequence[Primitive], shared: Collection[Mesh]) -> _Pools:
        """Return the pools of meshes; see `pack_meshes`."""
        before: _Pools | None = self._known["pools"][1] if "pools" in self._known else None
        of = tuple((item.mesh, item.placement) for item in in_world), tuple(shared)
        return self.part("pools", of, lambda: _Pools(in_world, shared, before, keep_centre=self.rough))

    def drop_rough(self) -> None:
        """Make what was made roughly anew from now on."""
        self.rough = False
        if "pools" in self._known and not self._known["pools"][1].is_exact:
            for name in ("pools", "meshes", "world", "held world"):
                self._known.pop(name, None)

    def appearance(self, scene: Scene, materials: Collection[Material], files: tuple[str, ...]) -> Appearance:
        """Pack the look of the materials of primitives and of the environment of a scene; it can be added to.

        Parameters
        ----------
        files
            Digests of the files that they name, and perhaps of others.
        """

        def make() -> Appearance:
            table, spectra = TextureTable(scene), KnownSpectra()
            shown = pack_materials(materials, table, spectra)
            return Appearance(table, spectra, shown, pack_environment(scene, table, spectra))

        of = (*materials, scene.environment, files, scene.metres_per_unit)
        return self.part("appearance", of, make).copy()

    def textures(self, appearance: Appearance) -> Textures:
        """Return the textures of appearance to which all has been added."""
        origin = appearance.table.unchanged_from
        return appearance.table.pack() if origin is None else self.part("textures", (origin,), appearance.table.pack)

    def camera(self, scene: Scene, *, coarse: bool) -> CameraModel:
        """Return the model of a scene's camera: the one before, turned, where it has only been moved about."""

        def make() -> CameraModel:
            return camera_model(scene, scene.spectrum.lens_colour, coarse=coarse)

        camera = scene.camera
        if not _is_portable(scene):
            return make()
        still = camera.model_copy(update={"eye": (0.0, 0.0, 0.0), "target": (0.0, 0.0, -1.0), "up": (0.0, 1.0, 0.0)})
        of = (still, scene.film, scene.exposure, scene.shutter, scene.metres_per_unit, scene.spectrum, coarse)
        return turned(self.part("camera", of, make), camera)


def _is_portable(scene: Scene) -> bool:
    """Return whether a camera's lens is the same wherever it stands, and made of no file that one may write anew."""
    camera = scene.camera.lens_camera
    if camera is None:
        return False
    focus = camera.focus
    if camera.motion or scene.shutter.keys or not (focus.point is None and focus.object is None and focus.auto is None):
        return False
    if not (isinstance(scene.lens_source(), str) and isinstance(scene.tolerances_source(), str | None)):
        return False
    return not any(file_references(camera))


def _are_same(one: Any, other: Any) -> bool:
    """Return whether two things are: the same instances, but for numbers, texts, arrays and how a camera is set."""
    if one is other:
        return True
    if isinstance(one, tuple) and type(one) is type(other):
        return len(one) == len(other) and all(map(_are_same, one, other))
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return isinstance(one, _BY_VALUE) and type(one) is type(other) and bool(one == other)


# Triangles of a scene as the device holds them: pools of vertices and triangles, and who uses them.

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
    order : tuple of int
        The runs of placed meshes in the order in which their primitives must stand.
    first_copied : tuple of int
        First triangle of each mesh that stands in the world.
    shared : Primitives
        Meshes that are instances.
    group_of_run : (runs,) int array
        Of those.
    first_primitive : int
        Of all meshes.
    eye : (3,) float64 array
        About which rays meet them [m].
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    groups: tuple[TriangleGroup, ...]
    boxes: NDArray[np.float32]
    order: tuple[int, ...]
    first_copied: tuple[int, ...]
    shared: Primitives
    group_of_run: NDArray[np.int64]
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
        of_runs = [self.groups[group].first_triangle for group in self.group_of_run]
        return np.append(self.first_copied, np.repeat(of_runs, self.shared.counts)).astype(np.int32)

    def has_places_of(self, other: PackedMeshes) -> bool:
        """Return whether what stands in the scene stands where other meshes do."""
        one, two = ((bool(each.first_copied), *(run.origin for run in each.shared.runs)) for each in (self, other))
        return _are_same(one, two)

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
        origins = np.array([_mesh_of(run).origin for run in self.shared.runs])
        for part, runs, placements in self.shared.blocks():
            turned = (placements[:, :3, :3] @ origins[runs][:, :, None])[:, :, 0]
            yield slice(part.start + copied, part.stop + copied), self.group_of_run[runs], placements, turned

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
    """Return the parts of one of a scene's mesh objects, in the order of the file, at each of its places.

    Raises
    ------
    InputError
        When the mesh cannot be used; a scene from `load_scene` has been checked.
    """
    loaded = scene.load_mesh(item)
    return tuple(
        MeshPart(part.mesh, place @ part.placement, material, part.name or item.name)
        for place in item.places(scene.folders, scene.shutter.open_s)
        for part, material in zip(loaded.contents.parts, loaded.materials, strict=True)
    )


BLOCK = 1 << 14  # instances that are inverted at a time
MOST_COPIED = 1 << 14  # triangles that copies of one mesh may add to the common tree

Matrix = NDArray[np.float64]


def pack_meshes(placed: Sequence[Primitive], first_primitive: int, parts: PlanParts) -> PackedMeshes:
    """Return some primitives that are meshes, as rays from the origin of the scene meet them.

    Parameters
    ----------
    placed
        Runs of them, at least one.
    first_primitive
        Index of the first primitive that is a mesh.
    parts
        Keeps the pools until others of these stand in the world, or other meshes are shared.
    """
    uses: Counter[int] = Counter()
    for run in placed:
        uses[id(run.mesh)] += len(run.places) if run.trajectory is None else 0
    is_shared = [
        run.trajectory is not None or (uses[id(run.mesh)] - 1) * len(_mesh_of(run).faces) > MOST_COPIED
        for run in placed
    ]
    copied = [i for i, share in enumerate(is_shared) if not share]
    shared = [i for i, share in enumerate(is_shared) if share]
    in_world = [*Primitives([placed[i] for i in copied])]
    meshes = {id(placed[i].mesh): _mesh_of(placed[i]) for i in shared}
    pools = parts.pools(in_world, meshes.values())
    group_of = {key: bool(copied) + place for place, key in enumerate(meshes)}
    return PackedMeshes(
        vertices=pools.vertices,
        triangles=pools.triangles,
        groups=tuple(pools.groups),
        boxes=pools.boxes() if shared else np.zeros((0, 2, 3), np.float32),
        order=(*copied, *shared),
        first_copied=tuple(pools.first_triangles),
        shared=Primitives([placed[i] for i in shared]),
        group_of_run=np.array([group_of[id(placed[i].mesh)] for i in shared], np.int64),
        first_primitive=first_primitive,
        eye=np.zeros(3),
    )


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


def corners_of_box(low: NDArray[np.float64], high: NDArray[np.float64], matrix: Matrix) -> NDArray[np.float64]:
    """Return the eight corners of a box (..., 8, 3) under matrices (..., 4, 4)."""
    choice = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    corners = np.where(choice, high, low)
    linear = np.swapaxes(matrix[..., :3, :3], -1, -2)
    return np.asarray(corners @ linear + matrix[..., None, :3, 3])


MOST = float(np.finfo(np.float32).max)
SPAN_BITS = 15  # of kernels/geometry/cubic_curve.h


@dataclass(frozen=True, eq=False)
class TablePlaces:
    """Placements by a table of instances, which are worked out each time: a million of them take 128 MB.

    Attributes
    ----------
    item : PlacedObject
        Has the table.
    folders : Folders
        Where it is read.
    time_s : float
        The moment of the places [s].
    before, after : (4, 4) array
        What a place is multiplied by from the left and from the right.
    count : int
        Of the table.
    """

    item: PlacedObject
    folders: Folders
    time_s: float
    before: Matrix
    after: Matrix
    count: int

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, some: slice) -> Matrix:
        return np.asarray(self.before @ self.item.places(self.folders, self.time_s, some) @ self.after)

    @cached_property
    def origin(self) -> tuple[Any, ...]:
        """What the placements are made of, to be compared."""
        assert self.item.instances is not None
        trajectory = self.item.trajectory
        moved = None if trajectory is None else trajectory.at(self.time_s)
        content = self.item.instances.content(self.folders)
        return content, self.item.world_from_object, moved, self.before, self.after


@dataclass(frozen=True, eq=False)
class Primitive:
    """A primitive, or some that differ in their places alone.

    Attributes
    ----------
    kind : Kind
    places : (n, 4, 4) array or TablePlaces
        Map the canonical shape of the kind (see ``kernels/geometry/primitives.h``) to the world [m], the eye at the
        origin.
        Those of a mesh: the scene [m], from the mesh's frame.
    material : Material
    object : int
        Index of the object of the scene that it belongs to.
    mesh : Mesh or None
    trajectory : Trajectory or None
        Its way while the shutter is open, None where it stands still; the places are those at the opening.
    hidden : int
        Rays that pass through it, a sum of `Hidden`.
    """

    kind: Kind
    places: Matrix | TablePlaces
    material: Material
    object: int
    mesh: Mesh | None = None
    trajectory: Trajectory | None = None
    hidden: int = 0

    @property
    def placement(self) -> Matrix:
        """The place of a single one (4, 4)."""
        return np.asarray(self.places[:1][0])

    @property
    def origin(self) -> Any:
        """What the places are made of, to be compared."""
        return self.places.origin if isinstance(self.places, TablePlaces) else self.places


class Primitives(Sequence[Primitive]):
    """The primitives of a scene, of which `runs` differ in their places alone and stand one behind the other."""

    def __init__(self, runs: Sequence[Primitive]) -> None:
        self.runs = runs
        self.counts = [len(run.places) for run in runs]
        self.ends = np.cumsum(self.counts, dtype=np.int64)

    def __len__(self) -> int:
        return int(self.ends[-1]) if self.counts else 0

    @overload
    def __getitem__(self, index: int) -> Primitive: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Primitive]: ...
    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[each] for each in range(*index.indices(len(self)))]
        if not 0 <= index < len(self):
            raise IndexError(index)
        number = int(np.searchsorted(self.ends, index, side="right"))
        place = index - int(self.ends[number]) + self.counts[number]
        return replace(self.runs[number], places=self.runs[number].places[place : place + 1])

    def __iter__(self) -> Iterator[Primitive]:
        for run, count in zip(self.runs, self.counts, strict=True):
            if count == 1:
                yield run
                continue
            for first in range(0, count, BLOCK):
                yield from (replace(run, places=one[None]) for one in run.places[first : first + BLOCK])

    def among(self, chosen: Callable[[Primitive], bool]) -> Iterator[tuple[int, Primitive]]:
        """Yield index and primitive of those in the runs that a function chooses."""
        for run, end, count in zip(self.runs, self.ends.tolist(), self.counts, strict=True):
            if chosen(run):
                yield from enumerate(Primitives([run]), start=end - count)

    def of_each(self, of_runs: Iterable[int]) -> NDArray[np.int32]:
        """Return numbers of runs for each primitive; at least one, as OpenCL has no empty buffers."""
        values = np.fromiter(of_runs, np.int32, len(self.runs))
        if not values.any():
            return np.broadcast_to(np.int32(0), max(len(self), 1))  # takes no memory
        return np.repeat(values, self.counts)

    def blocks(self, runs: slice = slice(None)) -> Iterator[tuple[slice, NDArray[np.int64], Matrix]]:
        """Yield some primitives at a time: where they stand among those of the runs, numbers of runs, placements."""
        first = held = 0
        numbers: list[int] = []
        stacks: list[Matrix] = []

        def joined() -> tuple[slice, NDArray[np.int64], Matrix]:
            each = np.repeat(np.array(numbers, np.int64), np.fromiter(map(len, stacks), np.int64))
            return slice(first, first + held), each, np.concatenate(stacks)

        for number, (run, count) in enumerate(zip(self.runs[runs], self.counts[runs], strict=True)):
            for start in range(0, count, BLOCK):
                stack = run.places[start : start + BLOCK]
                if held + len(stack) > BLOCK:
                    yield joined()
                    first, held, numbers, stacks = first + held, 0, [], []
                numbers.append(number)
                stacks.append(stack)
                held += len(stack)
        if stacks:
            yield joined()

    def by_kind(self) -> dict[Kind, tuple[slice, slice]]:
        """Return the runs and the primitives of each kind but meshes; they are sorted by kind."""
        kinds = np.array([run.kind for run in self.runs], np.int32)
        ends = np.append(self.ends, 0)  # the last for no run before
        found: dict[Kind, tuple[slice, slice]] = {}
        for kind in Kind:
            low, high = np.searchsorted(kinds, [kind, kind + 1]).tolist()
            if kind is not Kind.MESH and low < high:
                found[kind] = slice(low, high), slice(int(ends[low - 1]), int(ends[high - 1]))
        return found


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


def _canonical(item: Object) -> Iterator[tuple[Kind, Matrix]]:
    """Yield kind and placement (before the object's transform, in scene units) of each primitive of an object."""
    match item:
        case Sphere():
            yield Kind.SPHERE, affine(item.radius * np.eye(3), item.center)
        case Disk():
            yield _disk(item.center, item.normal, item.radius)
        case Rectangle():
            u, v = np.array(item.edge_u), np.array(item.edge_v)
            normal = cross(u, v)
            yield Kind.RECTANGLE, affine(np.stack([u, v, normal / np.linalg.norm(normal)], axis=1), item.corner)
        case Box():
            low, high = np.array(item.min), np.array(item.max)
            yield Kind.BOX, affine(np.diag((high - low) / 2), (high + low) / 2)
        case Cylinder():
            yield _round(Kind.CYLINDER, item.base, item.top, item.radius)
            if item.capped:
                yield _disk(item.base, np.subtract(item.base, item.top), item.radius)
                yield _disk(item.top, np.subtract(item.top, item.base), item.radius)
        case Cone():
            yield _round(Kind.CONE, item.base, item.apex, item.radius)
            if item.capped:
                yield _disk(item.base, np.subtract(item.base, item.apex), item.radius)
        case Plane():
            yield Kind.PLANE, affine(turn_to(item.normal), item.point)


def _are_similarities(linear: Matrix) -> NDArray[np.bool_]:
    gram = np.swapaxes(linear, 1, 2) @ linear
    size = gram[:, :1, :1]
    return np.asarray(np.abs(gram - size * np.eye(3)).max(axis=(1, 2)) <= 1e-9 * size[:, 0, 0])


def world_from_scene(scene: Scene) -> Matrix:
    """Return the 4x4 matrix from scene units to the world: metres, with the eye at the origin."""
    scale = scene.metres_per_unit
    return affine(scale * np.eye(3), -scale * np.array(scene.camera.eye))


def scene_primitives(scene: Scene, parts: PlanParts | None = None) -> Primitives:
    """Return every primitive of the scene, sorted by kind and otherwise in the order of the scene.

    Those of meshes that are in ``parts`` are taken from there.
    """
    world, parts = world_from_scene(scene), parts or PlanParts()
    by = scene.metres_per_unit, scene.shutter.open_s, scene.shutter.span_s
    before = parts.placed[1] if parts.placed[0] == by else {}
    of_meshes: dict[int, _PlacedMesh] = {}
    parts.placed = by, of_meshes
    runs: list[Primitive] = []
    for index, (item, solid) in enumerate(zip(scene.objects, scene.solids(), strict=True)):
        if isinstance(item, MeshObject | Board):
            placed = before.get(index)
            if placed is None or placed.item is not item:
                loaded = solid if isinstance(solid, LoadedMesh) else scene.load_mesh(item)
                placed = _place_mesh(scene, item, index, loaded, placed)
            of_meshes[index] = placed
            runs += placed.runs
            continue
        shapes: Iterable[tuple[Kind, Matrix | TablePlaces]]
        if isinstance(item, Curves):
            shapes = [(Kind.CURVE, _place_curves(item, world @ item.places(scene.folders, scene.shutter.open_s)))]
        else:
            shapes = (each for shape in _canonical(item) for each in _placed_shapes(scene, item, *shape))
        way, hidden = _trajectory(scene, item), item.visible.hidden
        runs += [Primitive(*shape, item.material, index, trajectory=way, hidden=hidden) for shape in shapes]
    return Primitives(sorted(runs, key=lambda run: run.kind))


def _placed_shapes(
    scene: Scene, item: Object, kind: Kind, canonical: Matrix
) -> Iterator[tuple[Kind, Matrix | TablePlaces]]:
    """Yield the places of a shape by the kinds that it has there: a stretched sphere is an ellipsoid."""
    world, time_s = world_from_scene(scene), scene.shutter.open_s
    table = None if item.instances is None else item.instances.matrices(scene.folders)
    places: Matrix | TablePlaces
    if table is None or len(table) == 1:
        # a product of stacks rounds in another way than one of single matrices
        places = (world @ item.places(scene.folders, time_s)[0] @ canonical)[None]
    else:
        places = TablePlaces(item, scene.folders, time_s, world, canonical, len(table))
    if kind is not Kind.SPHERE:
        yield kind, places
        return
    blocks = range(0, len(places), BLOCK)
    even = np.concatenate([_are_similarities(places[first : first + BLOCK][:, :3, :3]) for first in blocks])
    if even.all():
        yield Kind.SPHERE, places
        return
    for each, chosen in ((Kind.SPHERE, even), (Kind.ELLIPSOID, ~even)):
        if chosen.any():
            yield each, places[:][chosen]


def _place_curves(item: Curves, places: Matrix) -> Matrix:
    """Return the pieces of curves at places (n, 4, 4) as rows of Bézier points in the world, (m, 4, 4).

    The last row of each holds the half widths at its ends, that of a flat one with a sign at the first, and from where
    to where along its strand it goes.
    """
    points, widths, spans = item.pieces
    placed = np.ones((len(places), len(points), 4, 4))
    placed[:, :, :3] = places[:, None, :3, :3] @ points.transpose(0, 2, 1) + places[:, None, :3, 3, None]
    scales = np.cbrt(np.abs(np.linalg.det(places[:, :3, :3])))
    placed[:, :, 3, :2] = scales[:, None, None] * widths / 2
    placed[:, :, 3, 2:] = spans
    if item.form == "flat":
        placed[:, :, 3, 0] *= -1.0
    return placed.reshape(-1, 4, 4)


def object_frame(item: Object, time_s: float) -> Matrix:
    """Return the 4x4 matrix that takes the canonical shape of an object to the scene [scene units] at a moment.

    The points of a surface keep their coordinates in it while the object moves, and while the keys of its shape change.
    """
    placed = item.placed_at(time_s)
    return placed if isinstance(item, MeshObject | Board | Curves) else np.asarray(placed @ next(_canonical(item))[1])


class _PlacedMesh(NamedTuple):
    """A mesh object and the primitives of its parts."""

    item: MeshObject | Board
    runs: list[Primitive]


def _place_mesh(
    scene: Scene, item: MeshObject | Board, index: int, loaded: LoadedMesh, before: _PlacedMesh | None
) -> _PlacedMesh:
    """Place a mesh object; where it only shows another material than before, its primitives keep their places."""
    parts = tuple(zip(loaded.contents.parts, loaded.materials, strict=True))
    if (
        before is not None
        and item.transform is before.item.transform
        and item.motion is before.item.motion
        and item.instances is before.item.instances is None
        and [id(part.mesh) for part, _ in parts] == [id(each.mesh) for each in before.runs]
    ):
        pairs = zip(before.runs, loaded.materials, strict=True)
        hidden = item.visible.hidden
        return _PlacedMesh(item, [replace(run, material=each, object=index, hidden=hidden) for run, each in pairs])
    scale = affine(scene.metres_per_unit * np.eye(3), np.zeros(3))
    time_s = scene.shutter.open_s
    places: list[Matrix | TablePlaces]
    if item.instances is None:
        places = [(scale @ part.placement)[None] for part in mesh_parts(scene, item)]
    else:
        count = len(item.instances.matrices(scene.folders))
        places = [TablePlaces(item, scene.folders, time_s, scale, part.placement, count) for part, _ in parts]
    return _PlacedMesh(
        item,
        [
            Primitive(Kind.MESH, each, material, index, part.mesh, _trajectory(scene, item), item.visible.hidden)
            for each, (part, material) in zip(places, parts, strict=True)
        ],
    )


def _trajectory(scene: Scene, item: PlacedObject) -> Trajectory | None:
    """Return the way of an object, None where it stands still while the shutter is open."""
    return item.trajectory if item.trajectory is not None and item.trajectory.moves(*scene.shutter.span_s) else None


def sphere_of(placement: Matrix) -> tuple[NDArray[np.float64], float]:
    """Return centre and radius of a unit sphere under a similarity."""
    return placement[:3, 3], float(np.cbrt(abs(np.linalg.det(placement[:3, :3]))))


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
    spheres = (_spheres_of(placements) for _, _, placements in primitives.blocks(runs))
    return any(bool(np.any(np.abs(powers) < HUGE_POWER * radii**2)) for _, radii, powers in spheres)


def with_meshes(primitives: Primitives, scene: Scene, parts: PlanParts) -> tuple[Primitives, PackedMeshes | None]:
    """Return the primitives with the meshes, which stand last, in the order that their pools need; and the pools."""
    solid = [run for run in primitives.runs if run.mesh is None]
    meshes = [run for run in primitives.runs if run.mesh is not None]
    if not meshes:
        return primitives, None
    first = sum(len(run.places) for run in solid)
    where = tuple((run.mesh, run.origin, run.trajectory is not None) for run in meshes)
    pools = parts.part("meshes", (where, first), lambda: pack_meshes(meshes, first, parts))
    eye = scene.metres_per_unit * np.array(scene.camera.eye)
    seen = parts.part("seen", (pools, eye), lambda: pools.seen_from(eye))
    return Primitives(solid + [meshes[index] for index in pools.order]), seen


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
        Where those of the primitives that are meshes have their triangles.
    """
    records = PRIMITIVE.zeros(len(primitives))
    for kind, (runs, members) in primitives.by_kind().items():
        for part, _, placements in primitives.blocks(runs):
            rows = _rows(kind, placements)
            for place, axis in enumerate("xyz"):
                records[f"row_{axis}"][members][part] = rows[:, place]
    if len(primitives):
        records["material"] = primitives.of_each(materials[id(run.material)] for run in primitives.runs)
        records["emitter"] = -1
        records["emitter"][[*emitters]] = [*emitters.values()]
        _fill_curves(primitives, records)
    _count_shared_planes(primitives, records)
    if meshes is not None:
        first_triangles = meshes.first_triangles
        records["instance"][-len(first_triangles) :] = meshes.instance_of
        records["first_triangle"][-len(first_triangles) :] = first_triangles
    kinds, ends = [run.kind for run in primitives.runs], np.append(primitives.ends, 0)
    return records, ends[np.searchsorted(kinds, list(Kind), side="right") - 1].astype(np.int32)


def _rows(kind: Kind, placements: Matrix) -> NDArray[np.float32]:
    """Return the rows (n, 3, 4) of the records of primitives of a kind."""
    if kind is Kind.CURVE:
        return placements[:, :3].astype(np.float32)
    if kind is not Kind.SPHERE:
        return np.asarray(np.linalg.inv(placements)[:, :3].astype(np.float32) + 0.0)  # no -0: kernels test bits
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
    for part, _, placements in primitives.blocks(runs):
        ends, some = placements[:, 3], records[members][part]
        some["instance"], some["first_triangle"] = ends[:, :2].astype(np.float32).T.copy().view(np.int32)
        begin, end = np.rint(most * ends[:, 2:]).astype(np.int32).T
        some["emitter"] = -1 - (begin | end << SPAN_BITS)


@dataclass(frozen=True)
class Owners:
    """Identifiers by primitive, and names by identifier.

    Attributes
    ----------
    of_run : (runs, 2) array
        Identifier of the object, its index in the scene's list, and of the material.
    counts : tuple
        Primitives of each run.
    objects : tuple of str
        Name of each object; its place in the scene where it has none.
    materials : tuple of str
        Name of each material: first the scene's named ones in their order, then those written out in an object, by
        their place.
    """

    of_run: NDArray[np.int32]
    counts: tuple[int, ...]
    objects: tuple[str, ...]
    materials: tuple[str, ...]

    @property
    def of_primitive(self) -> NDArray[np.int32]:
        """Identifiers of object and material (n, 2) of each primitive."""
        return np.repeat(self.of_run, self.counts, axis=0)


def owners_of(scene: Scene, primitives: Primitives) -> Owners:
    """Return the owners of the primitives of a scene."""
    objects = tuple(item.name or f"objects.{index}" for index, item in enumerate(scene.objects))
    names = list(scene.materials)
    identifiers = {id(material): index for index, material in enumerate(scene.materials.values())}
    for run in sorted(primitives.runs, key=lambda run: run.object):
        if id(run.material) not in identifiers:
            identifiers[id(run.material)] = len(names)
            names.append(f"objects.{run.object}.material")
    rows = [(run.object, identifiers[id(run.material)]) for run in primitives.runs]
    counts = primitives.counts if rows else (1,)  # as OpenCL has no empty buffers
    return Owners(np.array(rows or [(0, 0)], np.int32), tuple(counts), objects, tuple(names))


def _count_shared_planes(primitives: Primitives, records: NDArray[np.void]) -> None:
    """Write, into the first of rectangles or disks that follow one another in a plane and stay there, their number."""
    for kind, (runs, members) in primitives.by_kind().items():
        if kind not in (Kind.RECTANGLE, Kind.DISK):
            continue
        own = records[members]
        still = np.repeat([run.trajectory is None for run in primitives.runs[runs]], primitives.counts[runs])
        alike = (own["row_z"][1:] == own["row_z"][:-1]).all(axis=1) & still[1:] & still[:-1]
        first = np.append(True, ~alike)
        own["instance"][first] = np.diff(np.append(np.flatnonzero(first), len(own)))


# Everything that moves while the shutter is open, in metres about the eye, as the device holds it.

Array = NDArray[np.float64]

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
    for run in primitives.runs:
        if run.trajectory is not None and run.object not in place_of:
            segments.append(_segments(run.trajectory, scene))
            place_of[run.object] = count, len(segments[-1])
            count += len(segments[-1])
    if not segments:
        return ObjectMovements(SEGMENT.zeros(1), np.broadcast_to(np.int32(0), (max(len(primitives), 1), 2)))
    of_runs = [(0, 0) if run.trajectory is None else place_of[run.object] for run in primitives.runs]
    return ObjectMovements(np.concatenate(segments), np.repeat(np.array(of_runs, np.int32), primitives.counts, axis=0))


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
