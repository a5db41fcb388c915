"""From statements to a pbrt scene: the directives one by one, under a stack of graphics states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace
from pathlib import Path

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.parameters import Parameters
from rptcam_cl.importers.pbrt.report import Report
from rptcam_cl.importers.pbrt.source import Place
from rptcam_cl.importers.pbrt.state import (
    Entity,
    GraphicsState,
    Instance,
    MaterialName,
    PbrtScene,
    ShapeUse,
    TextureKey,
)
from rptcam_cl.importers.pbrt.statements import NUMBERS, Statement, read_statements
from rptcam_cl.importers.pbrt.transforms import NOWHERE, Matrix, OddTransformError, checked, is_invertible, step_matrix

COLOR_SPACES = ("srgb", "rec2020", "dci-p3", "aces2065-1")
OPTIONS = ("Camera", "Film", "Sampler", "Integrator", "SurfaceIntegrator", "PixelFilter")
IGNORED = {
    "Accelerator": "how rays find surfaces is decided by the renderer",
    "MakeNamedMedium": "there are no media such as fog",
    "MediumInterface": "there are no media such as fog",
    "TransformTimes": "nothing moves while the shutter is open",
    "Option": "it steers pbrt itself",
    "Renderer": "it steers pbrt-v2 itself",
    "Volume": "there are no media such as fog",
    "VolumeIntegrator": "there are no media such as fog",
}
# Targets of ``Attribute`` by the directive that takes the defaults.
TARGETS = {"Shape": "shape", "LightSource": "light", "AreaLightSource": "light", "Material": "material",
           "MakeNamedMaterial": "material", "Texture": "texture"}  # fmt: skip
# Nested deeper than any scene that was written on purpose.
DEEPEST = 10_000


@dataclass
class _Saved:
    kind: str
    state: GraphicsState
    place: Place


@dataclass
class World:
    """Takes statements in their order."""

    report: Report
    scene: PbrtScene = field(default_factory=PbrtScene)
    state: GraphicsState = field(default_factory=GraphicsState)
    saved: list[_Saved] = field(default_factory=list)
    spaces: dict[str, Matrix] = field(default_factory=dict)
    textures: dict[TextureKey, Entity] = field(default_factory=dict)
    in_world: bool = False
    current_object: str | None = None

    def take(self, statement: Statement) -> None:
        """Carry out one statement."""
        name = statement.directive
        if statement.parameters is not None:
            for item in statement.parameters.repeated:
                what = f'{statement.described()}: "{item.name}" is given twice; the last one counts'
                self.report.noted(item.place, what)
        if name in IGNORED:
            self.report.ignored(statement.place, f"{statement.described()}: {IGNORED[name]}")
            return
        if name in NUMBERS:
            self._transform(statement)
            return
        if name in OPTIONS:
            self._option(statement)
            return
        _ACTIONS[name](self, statement)

    def finish(self) -> PbrtScene:
        """Return the scene, once all blocks are closed."""
        if self.saved:
            last = self.saved[-1]
            raise last.place.error(f"{last.kind}Begin is never closed by {last.kind}End")
        return self.scene

    def entity(self, statement: Statement, kind: str, parameters: Parameters | None = None) -> Entity:
        """Return what a statement declares, with the defaults of ``Attribute`` and the textures that it names."""
        given = parameters or statement.with_parameters()
        for item in self.state.defaults.get(TARGETS.get(statement.directive, ""), ()):
            given.items.setdefault(item.name, item)
        bound: dict[TextureKey, Entity] = {}
        for item in given.items.values():
            if item.kind == "texture":
                for text in item.values:
                    bound |= {key: self.textures[key] for key in _keys(str(text)) if key in self.textures}
        return Entity(kind, given, self.state.ctm, self.state.color_space, bound)

    def _transform(self, statement: Statement) -> None:
        if not self.state.moving:
            self.report.ignored(statement.place, f"{statement.directive} at the end time: nothing moves")
            return
        try:
            is_whole = statement.directive == "Transform"
            with np.errstate(over="ignore", invalid="ignore"):
                found = checked(statement) if is_whole else self.state.ctm @ step_matrix(statement)
            if not np.isfinite(found).all() and np.isfinite(self.state.ctm).all():
                raise OddTransformError(f"{statement.directive} leads beyond the range of numbers")
            self.set_transform(found)
        except OddTransformError as problem:
            self.report.noted(statement.place, f"{problem}; what stands under it is left out")
            self.set_transform(NOWHERE)

    def set_transform(self, matrix: Matrix) -> None:
        """Make a matrix the current transform."""
        self.state = replace(self.state, ctm=matrix)

    def _option(self, statement: Statement) -> None:
        name = "Integrator" if statement.directive == "SurfaceIntegrator" else statement.directive
        if self.in_world:
            raise statement.place.error(f"{statement.directive} belongs before WorldBegin")
        if name in self.scene.options:
            self.report.ignored(self.scene.options[name].place, f"{name}: a later one takes its place")
        self.scene.options[name] = self.entity(statement, statement.texts[0])
        if name == "Camera":
            found = np.linalg.inv(self.state.ctm) if is_invertible(self.state.ctm) else NOWHERE
            self.spaces["camera"] = np.asarray(found, np.float64)
        if statement.directive == "SurfaceIntegrator" or (name == "Film" and statement.texts[0] == "image"):
            self.scene.version = 3

    def push(self, kind: str, place: Place) -> None:
        """Keep the state for the end of a block."""
        if len(self.saved) >= DEEPEST:
            raise place.error(f"{kind}Begin: blocks are nested more than {DEEPEST} deep")
        self.saved.append(_Saved(kind, self.state, place))

    def pop(self, kind: str, place: Place) -> GraphicsState:
        """Return the state from the beginning of a block."""
        if not self.saved:
            raise place.error(f"{kind}End without {kind}Begin")
        last = self.saved.pop()
        if last.kind != kind:
            raise place.error(f"{kind}End closes the {last.kind}Begin of {last.place.line}")
        return last.state


def _keys(name: str) -> tuple[TextureKey, TextureKey]:
    return ("float", name), ("spectrum", name)


def _world_begin(world: World, statement: Statement) -> None:
    if world.in_world:
        raise statement.place.error("a second WorldBegin")
    world.in_world = True
    world.state = replace(world.state, ctm=np.eye(4), moving=True)
    world.spaces["world"] = np.eye(4)


def _world_end(world: World, statement: Statement) -> None:
    world.scene.version = 3
    if not world.in_world:
        raise statement.place.error("WorldEnd without WorldBegin")


def _attribute_begin(world: World, statement: Statement) -> None:
    world.push("Attribute", statement.place)


def _attribute_end(world: World, statement: Statement) -> None:
    world.state = world.pop("Attribute", statement.place)


def _transform_begin(world: World, statement: Statement) -> None:
    world.push("Transform", statement.place)


def _transform_end(world: World, statement: Statement) -> None:
    kept = world.pop("Transform", statement.place)
    world.state = replace(world.state, ctm=kept.ctm, moving=kept.moving)


def _object_begin(world: World, statement: Statement) -> None:
    if world.current_object is not None:
        raise statement.place.error("ObjectBegin inside another object")
    (name,) = statement.texts
    if name in world.scene.objects:
        world.report.noted(statement.place, f'object "{name}" is defined again; instances use the last one')
    world.push("Object", statement.place)
    world.current_object = name
    world.scene.objects[name] = []


def _object_end(world: World, statement: Statement) -> None:
    world.state = world.pop("Object", statement.place)
    world.current_object = None


def _object_instance(world: World, statement: Statement) -> None:
    if world.current_object is not None:
        raise statement.place.error("ObjectInstance inside an object")
    world.scene.shapes.append(Instance(statement.texts[0], world.state.ctm, statement.place))


def _coordinate_system(world: World, statement: Statement) -> None:
    world.spaces[statement.texts[0]] = world.state.ctm


def _coordinate_system_transform(world: World, statement: Statement) -> None:
    (name,) = statement.texts
    if name not in world.spaces:
        known = ", ".join(world.spaces) or "none yet"
        raise statement.place.error(f'no coordinate system is named "{name}" (named are: {known})')
    world.set_transform(world.spaces[name])


def _identity(world: World, statement: Statement) -> None:
    if world.state.moving:
        world.set_transform(np.eye(4))


def _active_transform(world: World, statement: Statement) -> None:
    world.state = replace(world.state, moving=statement.texts[0] != "EndTime")


def _reverse(world: World, statement: Statement) -> None:
    world.state = replace(world.state, reverse=not world.state.reverse)


def _color_space(world: World, statement: Statement) -> None:
    (name,) = statement.texts
    if name not in COLOR_SPACES:
        raise statement.place.error(f'unknown ColorSpace "{name}" (allowed: {", ".join(COLOR_SPACES)})')
    world.state = replace(world.state, color_space=name)


def _attribute(world: World, statement: Statement) -> None:
    (target,) = statement.texts
    allowed = (*dict.fromkeys(TARGETS.values()), "medium")
    if target not in allowed:
        raise statement.place.error(f'unknown target "{target}" of Attribute (allowed: {", ".join(allowed)})')
    if target == "medium":
        world.report.ignored(statement.place, f"{statement.described()}: {IGNORED['MakeNamedMedium']}")
    items = (*statement.with_parameters().items.values(), *world.state.defaults.get(target, ()))
    world.state = replace(world.state, defaults={**world.state.defaults, target: items})


def _material(world: World, statement: Statement) -> None:
    world.state = replace(world.state, material=world.entity(statement, statement.texts[0]))


def _named_material(world: World, statement: Statement) -> None:
    (name,) = statement.texts
    found = world.scene.materials.get(name)
    world.state = replace(world.state, material=found or MaterialName(name, statement.place))


def _make_named_material(world: World, statement: Statement) -> None:
    (name,) = statement.texts
    parameters = statement.with_parameters()
    if not parameters.has("type"):
        raise statement.place.error(f'{statement.described()} needs a parameter "string type"')
    if name in world.scene.materials:
        world.report.noted(statement.place, f'material "{name}" is defined again')
    world.scene.materials[name] = world.entity(statement, parameters.text("type", ""))


def _texture(world: World, statement: Statement) -> None:
    name, kind, form = statement.texts
    kinds = {"float": "float", "spectrum": "spectrum", "color": "spectrum"}
    if kind not in kinds:
        raise statement.place.error(f'{statement.described()}: unknown type "{kind}" (allowed: float, spectrum)')
    world.textures[kinds[kind], name] = world.entity(statement, form)


def _check_world(world: World, statement: Statement) -> None:
    if not world.in_world:
        raise statement.place.error(f"{statement.directive} belongs after WorldBegin")


def _light(world: World, statement: Statement) -> None:
    _check_world(world, statement)
    world.scene.lights.append(world.entity(statement, statement.texts[0]))


def _area_light(world: World, statement: Statement) -> None:
    world.state = replace(world.state, lamp=world.entity(statement, statement.texts[0]))


def _shape(world: World, statement: Statement) -> None:
    _check_world(world, statement)
    state = world.state
    use = ShapeUse(world.entity(statement, statement.texts[0]), state.material, state.lamp, state.reverse)
    if world.current_object is None:
        world.scene.shapes.append(use)
    else:
        world.scene.objects[world.current_object].append(use)


_ACTIONS: dict[str, Callable[[World, Statement], None]] = {
    "WorldBegin": _world_begin, "WorldEnd": _world_end, "AttributeBegin": _attribute_begin,
    "AttributeEnd": _attribute_end, "TransformBegin": _transform_begin, "TransformEnd": _transform_end,
    "ObjectBegin": _object_begin, "ObjectEnd": _object_end, "ObjectInstance": _object_instance,
    "CoordinateSystem": _coordinate_system, "CoordSysTransform": _coordinate_system_transform, "Identity": _identity,
    "ActiveTransform": _active_transform, "ReverseOrientation": _reverse, "ColorSpace": _color_space,
    "Attribute": _attribute, "Material": _material, "NamedMaterial": _named_material,
    "MakeNamedMaterial": _make_named_material, "Texture": _texture, "LightSource": _light,
    "AreaLightSource": _area_light, "Shape": _shape,
}  # fmt: skip


def read_world(path: Path, report: Report) -> PbrtScene:
    """Return what a scene file and the files that it includes declare."""
    world = World(report)
    for statement in read_statements(path):
        world.take(statement)
    return world.finish()
