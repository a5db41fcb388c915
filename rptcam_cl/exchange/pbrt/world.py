"""From statements to a pbrt scene, directive by directive; and the context that its conversion works with."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import field, replace
from pathlib import Path

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, MissingFileError, OutsideFolderError
from rptcam_cl.core.files import Folders
from rptcam_cl.exchange.conversion import SMALLEST, FileStore, Matrix, Place, Report, is_invertible
from rptcam_cl.exchange.pbrt.source import NUMBERS, Parameter, Parameters, Statement, read_statements
from rptcam_cl.scene import load, placement

# Transforms of pbrt: 4x4 matrices that act on columns, in float64.
#
# pbrt says left-handed, but a matrix is a matrix: the numbers are what its directives make of them. Handedness
# matters once, when a picture is compared with another (see ``camera.frame_of``).

# Where nothing is: the transform of what stands under one that cannot be used.
_NOWHERE = np.full((4, 4), np.nan)

ODD = "its transform flattens space, or leads beyond what a scene can hold"


class _OddTransformError(ValueError):
    """A transform that places nothing, with what is odd about it."""


def _step_matrix(statement: Statement) -> Matrix:
    """Return the matrix that a transforming directive multiplies the current one with, from the right.

    Raises
    ------
    OddTransformError
        When it flattens space, or fixes no view or axis.
    """
    numbers = statement.numbers
    result = np.eye(4)
    match statement.directive:
        case "Translate":
            result[:3, 3] = numbers
        case "Scale":
            if not numbers.all():
                raise _OddTransformError("Scale by 0 flattens space")
            result[:3, :3] = np.diag(numbers)
        case "Rotate":
            result[:3, :3] = _rotation(statement)
        case "LookAt":
            result = _camera_from_world(statement)
        case _:
            result = _read_matrix(statement)
    return result


def _read_matrix(statement: Statement) -> Matrix:
    """Return the matrix of ``Transform`` or ``ConcatTransform``, which pbrt writes column by column.

    Raises
    ------
    OddTransformError
        When it is not affine, or cannot be inverted.
    """
    matrix = statement.numbers.reshape(4, 4).T.copy()
    if not np.allclose(matrix[3], (0, 0, 0, matrix[3, 3]), rtol=0, atol=1e-9) or abs(matrix[3, 3]) < SMALLEST:
        raise _OddTransformError(
            f"{statement.directive} is not affine: every fourth number must be 0, the last one 1 (written by columns)"
        )
    matrix /= matrix[3, 3]
    if not is_invertible(matrix):
        raise _OddTransformError(f"{statement.directive} cannot be inverted: it flattens space")
    return matrix


def _rotation(statement: Statement) -> Matrix:
    """Return the 3x3 turn about an axis."""
    degrees, *axis = statement.numbers
    length = math.hypot(*axis)
    if length < SMALLEST:
        raise _OddTransformError("Rotate needs an axis (got 0 0 0)")
    return placement.turn_about(np.array(axis) / length, float(degrees))


def _camera_from_world(statement: Statement) -> Matrix:
    """Return the matrix of ``LookAt``: +z of the camera looks at the target, +y is up, +x is up x forward."""
    eye, target, up = statement.numbers.reshape(3, 3)
    forward = target - eye
    right = np.cross(up, forward)
    if np.linalg.norm(right) <= SMALLEST * float(np.linalg.norm(up)) * float(np.linalg.norm(forward)):
        raise _OddTransformError("LookAt: eye, target and up fix no view (allowed: eye off the target, up not along)")
    forward = forward / np.linalg.norm(forward)
    right = right / np.linalg.norm(right)
    world_from_camera = np.eye(4)
    world_from_camera[:3] = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
    return np.asarray(np.linalg.inv(world_from_camera))


# What the statements of a pbrt scene set up: a graphics state, and the things made under it.

_TextureKey = tuple[str, str]


@dataclass(frozen=True, eq=False)
class Entity:
    """A light, material, texture, shape or camera, with the state in which it was declared.

    Attributes
    ----------
    kind : str
        Its type, such as ``perspective`` or ``matte``.
    world_from_object : (4, 4) array
        The current transform; that of a camera goes the other way, from the world to the camera.
    color_space : str
        Which red, green and blue its ``rgb`` parameters mean.
    textures : mapping
        The textures that its parameters name, by (float or spectrum, name).
    at_end : (4, 4) array or None
        The current transform at the end time; None where it is the same.
    """

    kind: str
    parameters: Parameters
    world_from_object: Matrix
    color_space: str = "srgb"
    textures: Mapping[_TextureKey, Entity] = field(default_factory=dict)
    at_end: Matrix | None = None

    @property
    def place(self) -> Place:
        """Where it was declared."""
        return self.parameters.place

    @property
    def what(self) -> str:
        """The directive, for messages."""
        return self.parameters.what

    def error(self, problem: str) -> InputError:
        """Return the error of what the entity says."""
        return self.place.error(f"{self.what}: {problem}")

    def unknown(self, form: str, allowed: Iterable[str]) -> InputError:
        """Return the error of an entity whose kind is not known among those of its form, such as a shape."""
        return self.place.error(f'unknown {form} "{self.kind}" (allowed: {", ".join(allowed)})')

    def file_name(self) -> tuple[str, Place]:
        """Return the file that an entity must name, and where it does."""
        if not (name := self.parameters.text("filename", "")):
            raise self.place.error(f'{self.what} needs a parameter "string filename"')
        return name, self.parameters.items["filename"].place


@dataclass(frozen=True, eq=False)
class MaterialName:
    """A material called by its name, which may be defined later.

    Attributes
    ----------
    place : Place
        Where it is called.
    before : Entity, MaterialName or None
        What was the material before; pbrt-v3 keeps to it where nothing has the name.
    """

    name: str
    place: Place
    before: Entity | MaterialName | None = None


@dataclass(frozen=True, eq=False)
class ShapeUse:
    """A shape with what it is made of, and the name of the medium inside."""

    shape: Entity
    material: Entity | MaterialName | None
    lamp: Entity | None
    reverse: bool
    inside: str = ""


@dataclass(frozen=True, eq=False)
class Instance:
    """A named object placed in the world."""

    name: str
    world_from_instance: Matrix
    place: Place
    at_end: Matrix | None = None


@dataclass
class PbrtScene:
    """Everything that a scene file declares.

    Attributes
    ----------
    options : dict
        Camera, Film, Sampler, Integrator, PixelFilter: the last one of each.
    objects : dict
        Shapes of named objects, for instances.
    version : int
        3 or 4: which release of pbrt the file was written for.
    """

    report: Report
    options: dict[str, Entity] = field(default_factory=dict)
    shapes: list[ShapeUse | Instance] = field(default_factory=list)
    objects: dict[str, list[ShapeUse]] = field(default_factory=dict)
    lights: list[Entity] = field(default_factory=list)
    materials: dict[str, Entity] = field(default_factory=dict)
    media: dict[str, Entity] = field(default_factory=dict)
    around_camera: str = ""  # name of a medium
    times: tuple[float, float] = (0.0, 1.0)  # of the two transforms of what moves [s]
    version: int = 4

    def material_of(self, use: Entity | MaterialName | None) -> Entity | None:
        """Return a material, looked up when it is called by its name; None for pbrt's default, a matte grey."""
        while isinstance(use, MaterialName):
            if use.name in self.materials:
                return self.materials[use.name]
            what = f'NamedMaterial "{use.name}": no material has the name; the one before, or grey 0.5'
            self.report.approximated(use.place, what)
            use = use.before
        return use

    def placed(self) -> Iterator[tuple[ShapeUse, Matrix, Instance | None]]:
        """Yield every shape with its placement in the world, once for each instance."""
        for item in self.shapes:
            if isinstance(item, ShapeUse):
                yield item, item.shape.world_from_object, None
                continue
            if item.name not in self.objects:
                self.report.ignored(item.place, f'ObjectInstance "{item.name}": no object has the name')
            for use in self.objects.get(item.name, ()):
                yield use, item.world_from_instance @ use.shape.world_from_object, item


_BOTH = ("ctm", "end")  # transforms at the start time and at the end time


@dataclass(frozen=True, eq=False)
class GraphicsState:
    """What ``AttributeBegin`` keeps and ``AttributeEnd`` brings back; of transforms those at both times, of which some
    are active.
    """

    ctm: Matrix = field(default_factory=lambda: np.eye(4))
    end: Matrix = field(default_factory=lambda: np.eye(4))
    active: tuple[str, ...] = _BOTH
    reverse: bool = False
    material: Entity | MaterialName | None = None
    lamp: Entity | None = None
    inside: str = ""
    outside: str = ""
    color_space: str = "srgb"
    defaults: Mapping[str, tuple[Parameter, ...]] = field(default_factory=dict)

    @property
    def moved(self) -> Matrix | None:
        """The transform at the end time, None where it is the same."""
        return None if np.array_equal(self.ctm, self.end) else self.end


_COLOR_SPACES = ("srgb", "rec2020", "dci-p3", "aces2065-1")
_OPTIONS = ("Camera", "Film", "Sampler", "Integrator", "SurfaceIntegrator", "PixelFilter")
_IGNORED = {
    "Accelerator": "how rays find surfaces is decided by the renderer",
    "Option": "it steers pbrt itself",
    "Renderer": "it steers pbrt-v2 itself",
    "Volume": "there are no media of pbrt-v2",
    "VolumeIntegrator": "there are no media of pbrt-v2",
}
# Targets of ``Attribute`` by the directive that takes the defaults.
TARGETS = {"Shape": "shape", "LightSource": "light", "AreaLightSource": "light", "Material": "material",
           "MakeNamedMaterial": "material", "Texture": "texture", "MakeNamedMedium": "medium"}  # fmt: skip
# Nested deeper than any scene that was written on purpose.
DEEPEST = 10_000


@dataclass
class World:
    """Takes statements in their order."""

    report: Report
    scene: PbrtScene
    state: GraphicsState = field(default_factory=GraphicsState)
    states: list[GraphicsState] = field(default_factory=list)  # for the ends of blocks of attributes and objects
    blocks: list[tuple[str, GraphicsState, Place]] = field(default_factory=list)  # of all; their transforms count
    spaces: dict[str, tuple[Matrix, Matrix]] = field(default_factory=dict)
    textures: dict[_TextureKey, Entity] = field(default_factory=dict)
    in_world: bool = False
    ended: bool = False
    current_object: str | None = None

    def take(self, statement: Statement) -> None:
        """Carry out one statement."""
        name = statement.directive
        if problem := self._misplaced(name):
            self.report.ignored(statement.place, f"{name}: {problem}, as in pbrt")
            return
        if statement.parameters is not None:
            for item in statement.parameters.repeated:
                what = f'{statement.described()}: "{item.name}" is given twice; the last one counts'
                self.report.noted(item.place, what)
        if name in _IGNORED:
            self.report.ignored(statement.place, f"{statement.described()}: {_IGNORED[name]}")
            return
        if name in NUMBERS and name not in _ACTIONS:
            self._transform(statement)
            return
        if name in _OPTIONS:
            self._option(statement)
            return
        _ACTIONS[name](self, statement)

    def _misplaced(self, name: str) -> str:
        """Say why pbrt skips a directive with a warning where it stands, nothing where it does not."""
        if self.ended:
            return "stands after WorldEnd, behind the picture that is rendered"
        if self.in_world and (name in _OPTIONS or name == "WorldBegin"):
            return "stands inside the world"
        if not self.in_world and name in ("Shape", "LightSource", "ObjectInstance", "WorldEnd"):
            return "stands before WorldBegin"
        if self.current_object is not None and name == "ObjectInstance":
            return "stands inside an object"
        return ""

    def finish(self) -> PbrtScene:
        """Return the scene; a block that is never closed ends with it."""
        for kind, _, place in self.blocks:
            self.report.noted(place, f"{kind}Begin is never closed by {kind}End")
        return self.scene

    def entity(self, statement: Statement, kind: str) -> Entity:
        """The entity that a statement declares, with the defaults of ``Attribute`` and the textures that it names."""
        given = statement.with_parameters()
        for item in self.state.defaults.get(TARGETS.get(statement.directive, ""), ()):
            given.items.setdefault(item.name, item)
        bound: dict[_TextureKey, Entity] = {}
        for item in given.items.values():
            if item.kind == "texture":
                keys = [(kind, str(text)) for text in item.values for kind in ("float", "spectrum")]
                bound |= {key: self.textures[key] for key in keys if key in self.textures}
        return Entity(kind, given, self.state.ctm, self.state.color_space, bound, self.state.moved)

    def _transform(self, statement: Statement) -> None:
        for name in self.state.active:
            before = getattr(self.state, name)
            try:
                is_whole = statement.directive == "Transform"
                with np.errstate(over="ignore", invalid="ignore"):
                    matrix = _read_matrix(statement) if is_whole else before @ _step_matrix(statement)
                if not np.isfinite(matrix).all() and np.isfinite(before).all():
                    raise _OddTransformError(f"{statement.directive} leads beyond the range of numbers")
            except _OddTransformError as problem:
                self.report.noted(statement.place, f"{problem}; what stands under it is left out")
                matrix = _NOWHERE
            self.state = replace(self.state, ctm=matrix) if name == "ctm" else replace(self.state, end=matrix)

    def set_transform(self, start: Matrix, end: Matrix) -> None:
        """Make matrices the current transforms of those times that are active."""
        if "ctm" in self.state.active:
            self.state = replace(self.state, ctm=start)
        if "end" in self.state.active:
            self.state = replace(self.state, end=end)

    def _option(self, statement: Statement) -> None:
        name = "Integrator" if statement.directive == "SurfaceIntegrator" else statement.directive
        if name in self.scene.options:
            self.report.ignored(self.scene.options[name].place, f"{name}: a later one takes its place")
        self.scene.options[name] = self.entity(statement, statement.texts[0])
        if name == "Camera":
            self.scene.around_camera = self.state.outside
            both = self.state.ctm, self.state.end
            first, last = (np.linalg.inv(one) if is_invertible(one) else _NOWHERE for one in both)
            self.spaces["camera"] = np.asarray(first, np.float64), np.asarray(last, np.float64)
        if statement.directive == "SurfaceIntegrator" or (name == "Film" and statement.texts[0] == "image"):
            self.scene.version = 3

    def push(self, kind: str, place: Place) -> None:
        """Keep the state for the end of a block."""
        if len(self.blocks) >= DEEPEST:
            raise place.error(f"{kind}Begin: blocks are nested more than {DEEPEST} deep")
        self.blocks.append((kind, self.state, place))
        if kind != "Transform":
            self.states.append(self.state)

    def pop(self, kind: str, place: Place) -> None:
        """Go back to the state of the beginning of a block.

        Blocks may overlap: pbrt-v2 and v3 have one stack of transforms, for all blocks, and one of all else, for those
        of attributes and objects.
        """
        if not self.blocks or (kind != "Transform" and not self.states):
            self.report.noted(place, f"{kind}End without {kind}Begin; it changes nothing")
            return
        begun, before, beginning = self.blocks.pop()
        if begun != kind:
            self.report.noted(place, f"{kind}End closes the {begun}Begin of {beginning.line}, as in pbrt-v3")
        rest = self.state if kind == "Transform" else self.states.pop()
        self.state = replace(rest, ctm=before.ctm, end=before.end, active=before.active)


def _world_begin(world: World, statement: Statement) -> None:
    world.in_world = True
    world.state = replace(world.state, ctm=np.eye(4), end=np.eye(4), active=_BOTH)
    world.spaces["world"] = np.eye(4), np.eye(4)


def _world_end(world: World, statement: Statement) -> None:
    world.scene.version = 3
    world.ended = True


def _block_begin(world: World, statement: Statement) -> None:
    world.push(statement.directive.removesuffix("Begin"), statement.place)


def _block_end(world: World, statement: Statement) -> None:
    world.pop(statement.directive.removesuffix("End"), statement.place)


def _object_begin(world: World, statement: Statement) -> None:
    (name,) = statement.texts
    if world.current_object is not None:
        what = f'ObjectBegin "{name}" inside "{world.current_object}", which ends here, as in pbrt-v3'
        world.report.noted(statement.place, what)
    if name in world.scene.objects:
        world.report.noted(statement.place, f'object "{name}" is defined again; instances use the last one')
    world.push("Object", statement.place)
    world.current_object = name
    world.scene.objects[name] = []


def _object_end(world: World, statement: Statement) -> None:
    _block_end(world, statement)
    world.current_object = None


def _object_instance(world: World, statement: Statement) -> None:
    world.scene.shapes.append(Instance(statement.texts[0], world.state.ctm, statement.place, world.state.moved))


def _coordinate_system(world: World, statement: Statement) -> None:
    world.spaces[statement.texts[0]] = world.state.ctm, world.state.end


def _coordinate_system_transform(world: World, statement: Statement) -> None:
    (name,) = statement.texts
    if name not in world.spaces:
        world.report.ignored(statement.place, f"{statement.described()}: no coordinate system has the name, as in pbrt")
        return
    world.set_transform(*world.spaces[name])


def _identity(world: World, statement: Statement) -> None:
    world.set_transform(np.eye(4), np.eye(4))


def _active_transform(world: World, statement: Statement) -> None:
    active = {"StartTime": ("ctm",), "EndTime": ("end",)}.get(statement.texts[0], _BOTH)
    world.state = replace(world.state, active=active)


def _transform_times(world: World, statement: Statement) -> None:
    start, end = statement.numbers
    if not end > start:
        world.report.ignored(statement.place, f"{statement.described()}: the end time is not after the start")
        return
    world.scene.times = float(start), float(end)


def _reverse(world: World, statement: Statement) -> None:
    world.state = replace(world.state, reverse=not world.state.reverse)


def _color_space(world: World, statement: Statement) -> None:
    (name,) = statement.texts
    if name not in _COLOR_SPACES:
        raise statement.place.error(f'unknown ColorSpace "{name}" (allowed: {", ".join(_COLOR_SPACES)})')
    world.state = replace(world.state, color_space=name)


def _attribute(world: World, statement: Statement) -> None:
    (target,) = statement.texts
    allowed = tuple(dict.fromkeys(TARGETS.values()))
    if target not in allowed:
        raise statement.place.error(f'unknown target "{target}" of Attribute (allowed: {", ".join(allowed)})')
    items = (*statement.with_parameters().items.values(), *world.state.defaults.get(target, ()))
    world.state = replace(world.state, defaults={**world.state.defaults, target: items})


def _material(world: World, statement: Statement) -> None:
    world.state = replace(world.state, material=world.entity(statement, statement.texts[0]))


def _named_material(world: World, statement: Statement) -> None:
    (name,) = statement.texts
    before = world.state.material
    material = world.scene.materials.get(name) or MaterialName(name, statement.place, before)
    world.state = replace(world.state, material=material)


def _make_named_material(world: World, statement: Statement) -> None:
    (name,) = statement.texts
    parameters = statement.with_parameters()
    if not parameters.has("type"):
        world.report.approximated(statement.place, f'{statement.described()}: matte, as it has no "string type"')
    if name in world.scene.materials:
        world.report.noted(statement.place, f'material "{name}" is defined again')
    world.scene.materials[name] = world.entity(statement, parameters.text("type", "matte"))


def _make_named_medium(world: World, statement: Statement) -> None:
    kind = statement.with_parameters().text("type", "homogeneous")
    world.scene.media[statement.texts[0]] = world.entity(statement, kind)


def _medium_interface(world: World, statement: Statement) -> None:
    inside, *outside = statement.texts
    world.state = replace(world.state, inside=inside, outside=outside[0] if outside else inside)


def _texture(world: World, statement: Statement) -> None:
    name, kind, form = statement.texts
    kinds = {"float": "float", "spectrum": "spectrum", "color": "spectrum"}
    if kind not in kinds:
        world.report.ignored(statement.place, f'{statement.described()}: no texture has the type "{kind}"')
        return
    world.textures[kinds[kind], name] = world.entity(statement, form)


def _light(world: World, statement: Statement) -> None:
    world.scene.lights.append(world.entity(statement, statement.texts[0]))


def _area_light(world: World, statement: Statement) -> None:
    world.state = replace(world.state, lamp=world.entity(statement, statement.texts[0]))


def _shape(world: World, statement: Statement) -> None:
    state = world.state
    shape = world.entity(statement, statement.texts[0])
    use = ShapeUse(shape, state.material, state.lamp, state.reverse, state.inside)
    if world.current_object is None:
        world.scene.shapes.append(use)
    else:
        world.scene.objects[world.current_object].append(use)


_ACTIONS: dict[str, Callable[[World, Statement], None]] = {
    "WorldBegin": _world_begin, "WorldEnd": _world_end, "AttributeBegin": _block_begin,
    "AttributeEnd": _block_end, "TransformBegin": _block_begin, "TransformEnd": _block_end,
    "ObjectBegin": _object_begin, "ObjectEnd": _object_end, "ObjectInstance": _object_instance,
    "CoordinateSystem": _coordinate_system, "CoordSysTransform": _coordinate_system_transform, "Identity": _identity,
    "ActiveTransform": _active_transform, "TransformTimes": _transform_times, "ReverseOrientation": _reverse,
    "ColorSpace": _color_space, "Attribute": _attribute, "Material": _material, "NamedMaterial": _named_material,
    "MakeNamedMaterial": _make_named_material, "MakeNamedMedium": _make_named_medium,
    "MediumInterface": _medium_interface, "Texture": _texture, "LightSource": _light,
    "AreaLightSource": _area_light, "Shape": _shape,
}  # fmt: skip


def read_world(path: Path, report: Report, folders: Folders | None = None) -> PbrtScene:
    """Read a scene file and the files that it includes, which may lie in `folders`."""
    world = World(report, PbrtScene(report))
    for statement in read_statements(path, folders):
        world.take(statement)
    return world.finish()


# What every part of a conversion works with.


@dataclass
class Context:
    """The scene that is converted, and where things go.

    Attributes
    ----------
    folders : Folders
        Where files of the pbrt scene may lie; their names start at the folder of its file.
    files : FileStore
        Files of the scene of ours.
    missing : "error" or "grey"
        What becomes of pictures and meshes that are not there, or lie where the scene may not read.
    absent : list of str
        What there is to say of them.
    known : dict
        Textures by ``id`` that were converted before: one may be a part of many, and they of many more.
    pictures : dict
        Names of pictures that are written anew, by their path.
    greys : dict
        What writes a coloured picture anew as numbers and returns its name, by that of the picture and whether it
        is linear.
    world : (4, 4) array
        From the world of pbrt to that of the scene.
    metres_per_unit : float
        Of the scene.
    deep : bool
        Whether light is to be scattered many times, below surfaces.
    moves : bool
        Whether something moves while the shutter is open.
    """

    scene: PbrtScene
    report: Report
    folders: Folders
    files: FileStore = field(repr=False)
    missing: load.Missing = "error"
    absent: list[str] = field(default_factory=list)
    known: dict[int, object] = field(default_factory=dict, repr=False)
    pictures: dict[str, str] = field(default_factory=dict, repr=False)
    greys: dict[tuple[str, bool], Callable[[Matrix], str]] = field(default_factory=dict, repr=False)
    world: Matrix = field(default_factory=lambda: np.eye(4), repr=False)
    metres_per_unit: float = 1.0
    deep: bool = False
    moves: bool = False

    def approximated(self, entity: Entity, what: str, place: Place | None = None) -> None:
        """Report what of an entity the scene of ours has in another way; at a place of its own where one is given."""
        self.report.approximated(place or entity.place, f"{entity.what}: {what}")

    def ignored(self, entity: Entity, what: str, place: Place | None = None) -> None:
        """Report what of an entity the scene of ours does not have; at a place of its own where one is given."""
        self.report.ignored(place or entity.place, f"{entity.what}: {what}")

    def find(self, name: str, place: Place) -> Path:
        """Return the path of a file that the pbrt scene names.

        Raises
        ------
        InputError
            When there is no such file, it is no regular one, or lies outside the folder of the pbrt scene.
        """
        try:
            return self.folders.find(name)
        except InputError as problem:
            raise type(problem)(str(place.error(f"{name[:80]}: {problem}"))) from None

    def find_or_note(self, name: str, place: Place, otherwise: str) -> Path | None:
        """Return the path of a picture or mesh; None for one that cannot be had, after noting what stands in."""
        try:
            return self.find(name, place)
        except (MissingFileError, OutsideFolderError) as problem:
            if str(problem) not in self.absent:
                self.absent.append(str(problem))
            why = "no such file" if isinstance(problem, MissingFileError) else "lies outside the folder of the scene"
            self.report.approximated(place, f"{name[:80]}: {why}; {otherwise}")
            return None

    def refuse_missing(self) -> None:
        """Raise an error that names all files that are not there or lie elsewhere, if any are."""
        if self.absent and self.missing == "error":
            raise MissingFileError("\n".join(self.absent))
