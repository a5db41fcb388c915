"""What the statements of a pbrt scene set up: a graphics state, and the things made under it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.parameters import Parameter, Parameters
from rptcam_cl.importers.pbrt.source import Place
from rptcam_cl.importers.pbrt.transforms import Matrix

TextureKey = tuple[str, str]


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
    """

    kind: str
    parameters: Parameters
    world_from_object: Matrix
    color_space: str = "srgb"
    textures: Mapping[TextureKey, Entity] = field(default_factory=dict)

    @property
    def place(self) -> Place:
        """Where it was declared."""
        return self.parameters.place

    @property
    def what(self) -> str:
        """The directive, for messages."""
        return self.parameters.what


@dataclass(frozen=True, eq=False)
class MaterialName:
    """A material called by its name, which may be defined later."""

    name: str
    place: Place


@dataclass(frozen=True, eq=False)
class ShapeUse:
    """A shape with what it is made of."""

    shape: Entity
    material: Entity | MaterialName | None
    lamp: Entity | None
    reverse: bool


@dataclass(frozen=True, eq=False)
class Instance:
    """A named object placed in the world."""

    name: str
    world_from_instance: Matrix
    place: Place


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

    options: dict[str, Entity] = field(default_factory=dict)
    shapes: list[ShapeUse | Instance] = field(default_factory=list)
    objects: dict[str, list[ShapeUse]] = field(default_factory=dict)
    lights: list[Entity] = field(default_factory=list)
    materials: dict[str, Entity] = field(default_factory=dict)
    version: int = 4

    def material_of(self, use: Entity | MaterialName | None) -> Entity | None:
        """Return a material, looked up when it is called by its name; None for pbrt's default."""
        if not isinstance(use, MaterialName):
            return use
        if use.name not in self.materials:
            known = ", ".join(list(self.materials)[:10]) or "none"
            raise use.place.error(f'no material is named "{use.name}" (named are: {known})')
        return self.materials[use.name]

    def placed(self) -> Iterator[tuple[ShapeUse, Matrix, Instance | None]]:
        """Yield every shape with its placement in the world, once for each instance."""
        for item in self.shapes:
            if isinstance(item, ShapeUse):
                yield item, item.shape.world_from_object, None
                continue
            if item.name not in self.objects:
                raise item.place.error(f'no object is named "{item.name}"')
            for use in self.objects[item.name]:
                yield use, item.world_from_instance @ use.shape.world_from_object, item


@dataclass(frozen=True, eq=False)
class GraphicsState:
    """What ``AttributeBegin`` keeps and ``AttributeEnd`` brings back."""

    ctm: Matrix = field(default_factory=lambda: np.eye(4))
    moving: bool = True
    reverse: bool = False
    material: Entity | MaterialName | None = None
    lamp: Entity | None = None
    color_space: str = "srgb"
    defaults: Mapping[str, tuple[Parameter, ...]] = field(default_factory=dict)
