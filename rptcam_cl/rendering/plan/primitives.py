"""Objects of the scene as primitives: canonical shapes with an affine placement, in metres about the eye."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from operator import is_
from typing import Any, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.files import Folders
from rptcam_cl.core.records import Kind
from rptcam_cl.rendering.cameras.kinds import camera_model, camera_of
from rptcam_cl.rendering.cameras.model import CameraModel, exposed, turned
from rptcam_cl.rendering.plan.environment import Surroundings, pack_environment
from rptcam_cl.rendering.plan.materials import Materials, pack_materials
from rptcam_cl.rendering.plan.textures import KnownSpectra, Textures, TextureTable
from rptcam_cl.scene.assets.mesh import Mesh, MeshPlacement
from rptcam_cl.scene.base import file_references
from rptcam_cl.scene.camera import CameraKind
from rptcam_cl.scene.exposure import Exposure, Shutter
from rptcam_cl.scene.film import Film, SpectrumSettings
from rptcam_cl.scene.materials import Material
from rptcam_cl.scene.meshes import MeshObject
from rptcam_cl.scene.placement import PlacedObject, Trajectory
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
        self.placed: PlacedMeshes | None = None
        self.rough_parts: tuple[str, ...] = ()  # names of those that were made roughly

    def part(self, name: str, of: tuple[Any, ...], make: Callable[[], Part]) -> Part:
        """Return the part of a name that is made of the same as before, else what ``make`` returns; not to be changed.

        Parameters
        ----------
        of
            Instances that do not change, or what compares by its content; tuples of them.
        """
        known = self._known.get(name)
        if known is None or not are_same(known[0], of):
            known = self._known[name] = of, make()
        part: Part = known[1]
        return part

    def last(self, name: str) -> Any:
        """Return the part of a name as it was made last, None where it has not been."""
        return self._known[name][1] if name in self._known else None

    def drop_rough(self) -> None:
        """Make what was made roughly anew from now on."""
        self.rough = False
        for name in self.rough_parts:
            self._known.pop(name, None)
        self.rough_parts = ()

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
        """Return the model of a scene's camera: the one before, turned, where it has been moved about or exposed."""
        camera, lens_colour = scene.camera, scene.spectrum.lens_colour
        if not _is_portable(scene):
            return camera_model(scene, lens_colour, coarse=coarse)
        still = camera.model_copy(update={"eye": (0.0, 0.0, 0.0), "target": (0.0, 0.0, -1.0), "up": (0.0, 1.0, 0.0)})
        of = (still, scene.film, scene.exposure.mode, scene.metres_per_unit, scene.spectrum, coarse)
        model = self.part("camera", of, lambda: camera_of(scene).model(lens_colour, coarse))
        return turned(exposed(model, scene), camera)


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


def are_same(one: Any, other: Any) -> bool:
    """Return whether two things are: the same instances, but for numbers, texts, arrays and how a camera is set."""
    if one is other:
        return True
    if isinstance(one, tuple) and type(one) is type(other):
        return len(one) == len(other) and (all(map(is_, one, other)) or all(map(are_same, one, other)))
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return isinstance(one, _BY_VALUE) and type(one) is type(other) and bool(one == other)


Matrix = NDArray[np.float64]


def mesh_parts(scene: Scene, item: MeshObject | Board) -> tuple[MeshPlacement, ...]:
    """Return the parts of one of a scene's mesh objects, in the order of the file, at each of its places.

    Placements lead to the world [scene units], when the shutter opens. A reflection carries the front side along: it
    stays where the corners run counter-clockwise in the mesh's own coordinates.

    Raises
    ------
    InputError
        When the mesh cannot be used; a scene from `load_scene` has been checked.
    """
    loaded = scene.load_mesh(item)
    return tuple(
        MeshPlacement(part.mesh, place @ part.placement, material, part.name or item.name)
        for place in item.places(scene.folders, scene.shutter.open_s)
        for part, material in zip(loaded.contents.parts, loaded.materials, strict=True)
    )


def corners_of_box(low: NDArray[np.float64], high: NDArray[np.float64], matrix: Matrix) -> NDArray[np.float64]:
    """Return the eight corners of a box (..., 8, 3) under matrices (..., 4, 4)."""
    choice = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    corners = np.where(choice, high, low)
    linear = np.swapaxes(matrix[..., :3, :3], -1, -2)
    return np.asarray(corners @ linear + matrix[..., None, :3, 3])


BLOCK = 1 << 14  # placements that are worked out at a time


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


class Prototype(NamedTuple):
    """What is the same of primitives that differ in their places and objects alone.

    Attributes
    ----------
    kind : Kind
    material : Material
    mesh : Mesh or None
    trajectory : Trajectory or None
        Their way while the shutter is open, None where they stand still; the places are those at the opening.
    hidden : int
        Rays that pass through them, a sum of `Hidden`.
    """

    kind: Kind
    material: Material
    mesh: Mesh | None = None
    trajectory: Trajectory | None = None
    hidden: int = 0

    @property
    def key(self) -> tuple[int, ...]:
        """What tells it from others, by identity."""
        return self.kind, id(self.material), id(self.mesh), id(self.trajectory), self.hidden


class Primitive(NamedTuple):
    """One primitive: the index of its object in the scene, its place, and what its `Prototype` says."""

    object: int
    placement: Matrix
    kind: Kind
    material: Material
    mesh: Mesh | None
    trajectory: Trajectory | None
    hidden: int


@dataclass(frozen=True, eq=False)
class Placements:
    """Where the primitives of runs stand: those of a run one behind the other.

    A matrix takes the canonical shape of a kind (see ``kernels/geometry/primitives.h``) to the world [m], the eye at
    the origin; the frame of a mesh to the scene [m].

    Attributes
    ----------
    rows : (n, 4, 4) array
        Of the runs that are written out.
    tables : dict
        Those of the other runs, by the number of the run.
    counts : (runs,) int array
        Primitives of each run.
    """

    rows: Matrix
    tables: dict[int, TablePlaces]
    counts: NDArray[np.int64]

    @classmethod
    def of(cls, places: Sequence[Matrix | TablePlaces]) -> Placements:
        """Return the places (n, 4, 4) of each run as one."""
        rows = [each for each in places if not isinstance(each, TablePlaces)]
        tables = {run: each for run, each in enumerate(places) if isinstance(each, TablePlaces)}
        counts = np.fromiter(map(len, places), np.int64, len(places))
        return cls(np.concatenate(rows) if rows else np.zeros((0, 4, 4)), tables, counts)

    @cached_property
    def ends(self) -> NDArray[np.int64]:
        """The number of primitives up to each run and with it."""
        return np.cumsum(self.counts)

    @cached_property
    def _starts(self) -> NDArray[np.int64]:
        """Where the rows of each run begin, and where the last end."""
        written = self.counts.copy()
        written[[*self.tables]] = 0
        return np.append(0, np.cumsum(written))

    def __len__(self) -> int:
        return int(self.ends[-1]) if len(self.counts) else 0

    @property
    def content(self) -> tuple[Any, ...]:
        """What the placements are made of, to be compared."""
        return self.rows, self.counts, tuple((run, table.origin) for run, table in self.tables.items())

    def of_run(self, run: int) -> Matrix | TablePlaces:
        """Return the places of a run."""
        return self.tables[run] if run in self.tables else self.rows[self._starts[run] : self._starts[run + 1]]

    def chosen(self, runs: NDArray[np.int64]) -> Placements:
        """Return those of some runs, in the order given."""
        if np.array_equal(runs, np.arange(len(self.counts))):
            return self
        starts, lengths = self._starts[runs], self._starts[runs + 1] - self._starts[runs]
        at = np.repeat(starts - np.cumsum(lengths) + lengths, lengths) + np.arange(lengths.sum())
        tables = {place: self.tables[run] for place, run in enumerate(runs.tolist()) if run in self.tables}
        return Placements(self.rows[at], tables if self.tables else {}, self.counts[runs])

    def changed(self, places: Mapping[int, Matrix | TablePlaces]) -> Placements | None:
        """Return these with those of some runs in other places; None where the numbers differ."""
        if any(len(each) != self.counts[run] or (run in self.tables) != isinstance(each, TablePlaces)
               for run, each in places.items()):  # fmt: skip
            return None
        rows, tables = self.rows.copy() if places else self.rows, dict(self.tables)
        for run, each in places.items():
            if isinstance(each, TablePlaces):
                tables[run] = each
            else:
                rows[self._starts[run] : self._starts[run + 1]] = each
        return Placements(rows, tables, self.counts)

    def joined(self, after: Placements) -> Placements:
        """Return these and others, whose runs come after."""
        tables = self.tables | {run + len(self.counts): table for run, table in after.tables.items()}
        return Placements(np.concatenate([self.rows, after.rows]), tables, np.concatenate([self.counts, after.counts]))

    def blocks(self, runs: slice = slice(None)) -> Iterator[tuple[slice, NDArray[np.int64], Matrix]]:
        """Yield some at a time: where they stand among the primitives of the runs, numbers of runs, matrices."""
        low, high, _ = runs.indices(len(self.counts))
        before = int(self.ends[low] - self.counts[low]) if low < high else 0
        first = held = 0
        stacks: list[Matrix] = []

        def together() -> tuple[slice, NDArray[np.int64], Matrix]:
            numbers = np.searchsorted(self.ends, np.arange(before + first, before + first + held), side="right")
            return slice(first, first + held), numbers, np.concatenate(stacks)

        for stack in self._stacks(low, high):
            if stacks and held + len(stack) > BLOCK:
                yield together()
                first, held, stacks = first + held, 0, []
            stacks.append(stack)
            held += len(stack)
        if stacks:
            yield together()

    def _stacks(self, low: int, high: int) -> Iterator[Matrix]:
        """Yield the matrices of runs, no more than a block at a time."""
        for run in (*(run for run in sorted(self.tables) if low <= run < high), high):
            stretches: list[Matrix | TablePlaces] = [self.rows[self._starts[low] : self._starts[run]]]
            stretches += [self.tables[run]] if run < high else []
            for places in stretches:
                yield from (places[first : first + BLOCK] for first in range(0, len(places), BLOCK))
            low = run + 1


class Primitives(Sequence[Primitive]):
    """The primitives of a scene in runs: those of a run have one prototype and one object.

    Attributes
    ----------
    prototypes : tuple of Prototype
        In the order of their first runs.
    prototype_of, objects : (runs,) int array
        Of each run: which of them it has, and the index of its object in the scene.
    places : Placements
    """

    def __init__(
        self,
        prototypes: Sequence[Prototype],
        prototype_of: NDArray[np.int64],
        objects: NDArray[np.int64],
        places: Placements,
    ) -> None:
        first = np.full(len(prototypes), len(objects))
        first[prototype_of[::-1]] = np.arange(len(objects))[::-1]
        order = np.argsort(first, kind="stable")[: np.count_nonzero(first < len(objects))]
        number = np.zeros(len(prototypes), np.int64)
        number[order] = np.arange(len(order))
        self.prototypes = tuple(prototypes[each] for each in order.tolist())
        self.prototype_of, self.objects, self.places = number[prototype_of], objects, places

    @classmethod
    def of(cls, runs: Sequence[tuple[Prototype, int, Matrix | TablePlaces]]) -> Primitives:
        """Return primitives of prototype, object and places of each run."""
        number: dict[tuple[int, ...], int] = {}
        of_runs = [number.setdefault(prototype.key, len(number)) for prototype, *_ in runs]
        prototypes = {prototype.key: prototype for prototype, *_ in runs}
        objects = np.array([index for _, index, _ in runs], np.int64)
        places = Placements.of([places for *_, places in runs])
        return cls(tuple(prototypes.values()), np.array(of_runs, np.int64), objects, places)

    def joined(self, after: Primitives) -> Primitives:
        """Return these and others, which have none of their prototypes, and come after."""
        return Primitives(
            self.prototypes + after.prototypes,
            np.concatenate([self.prototype_of, len(self.prototypes) + after.prototype_of]),
            np.concatenate([self.objects, after.objects]),
            self.places.joined(after.places),
        )

    def chosen(self, runs: NDArray[np.int64]) -> Primitives:
        """Return those of some runs, in the order given."""
        return Primitives(self.prototypes, self.prototype_of[runs], self.objects[runs], self.places.chosen(runs))

    def __len__(self) -> int:
        return len(self.places)

    @overload
    def __getitem__(self, index: int) -> Primitive: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Primitive]: ...
    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[each] for each in range(*index.indices(len(self)))]
        if not 0 <= index < len(self):
            raise IndexError(index)
        run = int(np.searchsorted(self.places.ends, index, side="right"))
        place = index - int(self.places.ends[run] - self.places.counts[run])
        return self._primitive(run, self.places.of_run(run)[place : place + 1][0])

    def __iter__(self) -> Iterator[Primitive]:
        return (primitive for run in range(len(self.objects)) for primitive in self._of_run(run))

    def _of_run(self, run: int) -> Iterator[Primitive]:
        places = self.places.of_run(run)
        for first in range(0, len(places), BLOCK):
            yield from (self._primitive(run, place) for place in places[first : first + BLOCK])

    def _primitive(self, run: int, place: Matrix) -> Primitive:
        return Primitive(int(self.objects[run]), place, *self.prototypes[self.prototype_of[run]])

    def runs_of(self, chosen: Callable[[Prototype], bool]) -> NDArray[np.int64]:
        """Return the runs of the prototypes that a function chooses."""
        return np.flatnonzero(self.of_runs(np.array([chosen(each) for each in self.prototypes], np.bool_)))

    def among(self, chosen: Callable[[Prototype], bool]) -> Iterator[tuple[int, Primitive]]:
        """Yield index and primitive of those whose prototype a function chooses."""
        for run in self.runs_of(chosen).tolist():
            yield from enumerate(self._of_run(run), start=int(self.places.ends[run] - self.places.counts[run]))

    def of_runs(self, of_prototypes: NDArray[Any]) -> NDArray[Any]:
        """Return numbers of prototypes for each run."""
        return of_prototypes[self.prototype_of] if len(self.objects) else of_prototypes[:0]

    def of_each(self, number: Callable[[Prototype], int]) -> NDArray[np.int32]:
        """Return a number of the prototype of each primitive; at least one, as OpenCL has no empty buffers."""
        return self.spread(self.of_runs(np.array([number(each) for each in self.prototypes], np.int32)))

    def spread(self, of_runs: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return numbers of runs for each primitive; at least one, as OpenCL has no empty buffers."""
        if not of_runs.any():
            return np.broadcast_to(np.int32(0), max(len(self), 1))  # takes no memory
        return np.repeat(of_runs, self.places.counts)

    @cached_property
    def kinds(self) -> NDArray[np.int32]:
        """The kind of each run; they are sorted by it."""
        return self.of_runs(np.array([each.kind for each in self.prototypes], np.int32))

    def by_kind(self) -> dict[Kind, tuple[slice, slice]]:
        """Return the runs and the primitives of each kind but meshes."""
        ends = np.append(self.places.ends, 0)  # the last for no run before
        found: dict[Kind, tuple[slice, slice]] = {}
        for kind in Kind:
            low, high = np.searchsorted(self.kinds, [kind, kind + 1]).tolist()
            if kind is not Kind.MESH and low < high:
                found[kind] = slice(low, high), slice(int(ends[low - 1]), int(ends[high - 1]))
        return found

    def of_meshes(self) -> Primitives:
        """Return those that are meshes."""
        return self.chosen(np.flatnonzero(self.kinds == Kind.MESH))

    def meshes(self) -> tuple[tuple[Mesh, ...], NDArray[np.int64]]:
        """Return the meshes in the order of their first runs, and which of them each run has; none has none."""
        meshes = {id(each.mesh): each.mesh for each in self.prototypes if each.mesh is not None}
        number = {key: place for place, key in enumerate(meshes)}
        of_prototypes = np.array([number[id(each.mesh)] for each in self.prototypes], np.int64)
        return (*meshes.values(),), self.of_runs(of_prototypes)


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


Run = tuple[Prototype, int, Matrix | TablePlaces]
"""A prototype, the index of the object, and the places."""


def scene_primitives(scene: Scene, parts: PlanParts | None = None) -> Primitives:
    """Return every primitive of the scene, sorted by kind and otherwise in the order of the scene.

    Those of meshes that are in ``parts`` are taken from there.
    """
    shapes = [each for each in enumerate(scene.objects) if not isinstance(each[1], (MeshObject, Board))]
    runs = [run for index, item in shapes for run in _shape_runs(scene, index, item)]
    solid = Primitives.of(sorted(runs, key=lambda run: run[0].kind))
    return solid.joined(_place_meshes(scene, parts or PlanParts()))


def _shape_runs(scene: Scene, index: int, item: Any) -> Iterator[Run]:
    """Yield the primitives of an object that is no mesh."""
    shapes: Iterable[tuple[Kind, Matrix | TablePlaces]]
    if isinstance(item, Curves):
        places = world_from_scene(scene) @ item.places(scene.folders, scene.shutter.open_s)
        shapes = [(Kind.CURVE, _place_curves(item, places))]
    else:
        shapes = (each for shape in _canonical(item) for each in _placed_shapes(scene, item, *shape))
    way = _trajectory(scene, item)
    for kind, where in shapes:
        yield Prototype(kind, item.material, None, way, item.visible.hidden), index, where


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


class PlacedMeshes(NamedTuple):
    """The meshes of a scene as primitives.

    Attributes
    ----------
    of : tuple
        Unit and shutter of the scene.
    objects : tuple
        All of the scene.
    first : list of int
        The first run of each object, and the number of all runs.
    primitives : Primitives
    """

    of: tuple[Any, ...]
    objects: tuple[Object, ...]
    first: list[int]
    primitives: Primitives


def _place_meshes(scene: Scene, parts: PlanParts) -> Primitives:
    """Return the meshes of a scene, of which those that stay are taken from the last plan."""
    of = scene.metres_per_unit, scene.shutter.open_s, scene.shutter.span_s
    before, made = parts.placed, None
    if before is not None and before.of == of and len(before.objects) == len(scene.objects):
        made = _place_changed(scene, before)
    if made is None:
        runs, first = list[Run](), [0]
        for index, item in enumerate(scene.objects):
            if isinstance(item, (MeshObject, Board)):
                pairs = zip(_mesh_prototypes(scene, item), _mesh_places(scene, item), strict=True)
                runs += [(prototype, index, places) for prototype, places in pairs]
            first.append(len(runs))
        made = PlacedMeshes(of, scene.objects, first, Primitives.of(runs))
    parts.placed = made
    return made.primitives


def _place_changed(scene: Scene, before: PlacedMeshes) -> PlacedMeshes | None:
    """Return the meshes of a scene with as many objects; None where one of them has more or fewer runs."""
    known, objects = before.primitives, scene.objects
    if objects is before.objects:
        return before
    if (replaced := scene.new_materials(before.objects)) is not None:
        shown = [each._replace(material=replaced.get(id(each.material), each.material)) for each in known.prototypes]
        primitives = Primitives(shown, known.prototype_of, known.objects, known.places)
        return before._replace(objects=objects, primitives=primitives)
    prototypes, prototype_of = [*known.prototypes], known.prototype_of.copy()
    number = {prototype.key: place for place, prototype in enumerate(prototypes)}
    places: dict[int, Matrix | TablePlaces] = {}
    for index in [index for index, stays in enumerate(map(is_, objects, before.objects)) if not stays]:
        item, runs = objects[index], range(*before.first[index : index + 2])
        is_mesh = isinstance(item, (MeshObject, Board))
        made = _mesh_prototypes(scene, item) if is_mesh else []
        if len(made) != len(runs):
            return None
        other = before.objects[index]
        same = item.transform is other.transform and item.motion is other.motion
        same = same and item.instances is other.instances is None
        for run, prototype in zip(runs, made, strict=True):
            same = same and known.prototypes[known.prototype_of[run]].mesh is prototype.mesh
            prototype_of[run] = number.setdefault(prototype.key, len(number))
            prototypes += [prototype] if len(number) > len(prototypes) else []
        if is_mesh and not same:
            places |= zip(runs, _mesh_places(scene, item), strict=True)
    placed = known.places.changed(places)
    if placed is None:
        return None
    return before._replace(objects=objects, primitives=Primitives(prototypes, prototype_of, known.objects, placed))


def _mesh_prototypes(scene: Scene, item: Any) -> list[Prototype]:
    """Return the prototype of each part of an object's mesh."""
    loaded, way = scene.load_mesh(item), _trajectory(scene, item)
    pairs = zip(loaded.contents.parts, loaded.materials, strict=True)
    return [Prototype(Kind.MESH, material, part.mesh, way, item.visible.hidden) for part, material in pairs]


def _mesh_places(scene: Scene, item: Any) -> list[Matrix | TablePlaces]:
    """Return the places of each part of an object's mesh."""
    scale, time_s = affine(scene.metres_per_unit * np.eye(3), np.zeros(3)), scene.shutter.open_s
    if item.instances is None:
        return [(scale @ part.placement)[None] for part in mesh_parts(scene, item)]
    count = len(item.instances.matrices(scene.folders))
    parts = scene.load_mesh(item).contents.parts
    return [TablePlaces(item, scene.folders, time_s, scale, part.placement, count) for part in parts]


def _trajectory(scene: Scene, item: PlacedObject) -> Trajectory | None:
    """Return the way of an object, None where it stands still while the shutter is open."""
    return item.trajectory if item.trajectory is not None and item.trajectory.moves(*scene.shutter.span_s) else None


def sphere_of(placement: Matrix) -> tuple[NDArray[np.float64], float]:
    """Return centre and radius of a unit sphere under a similarity."""
    return placement[:3, 3], float(np.cbrt(abs(np.linalg.det(placement[:3, :3]))))
