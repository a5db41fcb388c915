"""Materials of a scene: matte, plastic, mirror, principled, emissive, and mixtures of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from rptcam_cl.scene.base import Alternatives, SceneModel, listed, near_name, refuse
from rptcam_cl.scene.dielectric import ABSORPTION, LEAST_BEND, ROUGHNESS, AbsorbingMaterial, Dielectric, ThinGlass
from rptcam_cl.scene.material_parts import AnisotropyMap, BumpyMaterial, CoveringMaterial, NormalMap, RoughMaterial
from rptcam_cl.scene.metal import Conductor
from rptcam_cl.scene.quantities import NUMBER, Albedo, Fraction, Turn, list_of
from rptcam_cl.scene.texture import Emission, Reflectance, Share

MOST_INDEX = 1000.0  # reflects 0.996 of the light at normal incidence
MOST_BEND = 5.0  # index of what light passes


class Principled(AbsorbingMaterial, BumpyMaterial):
    """A mixture of a dielectric over a diffuse or transparent base, and a metal; with sheen, a coat and emission."""

    kind: Literal["principled"]
    """Kind of material."""

    base_color: Reflectance = (0.8, 0.8, 0.8)
    """Colour of the diffuse base, of transmission, and of the metal: channels 0 to 1, or a texture."""

    metallic: Share = 0.0
    """Share of metal: a number, or a texture."""

    roughness: Share = 0.5
    """Roughness of the surface, the root of GGX's alpha: a number, or a texture."""

    anisotropy: Fraction = 0.0
    """Stretch of highlights along u; 0 is none."""

    anisotropy_rotation_degrees: Turn = 0.0
    """Turn of that direction, from u towards v."""

    anisotropy_map: AnisotropyMap | None = None
    """Direction and strength of the stretch from a picture, in place of `anisotropy`; the shape needs texture
    coordinates."""

    specular: Share = 1.0
    """Factor on the reflectance of the dielectric: a number, or a texture."""

    specular_color: Reflectance = (1.0, 1.0, 1.0)
    """Colour of that reflectance at normal incidence, not of grazing light: channels 0 to 1, or a texture."""

    index: Annotated[float, Field(ge=1, le=MOST_INDEX), NUMBER] = 1.5
    """Refractive index of the dielectric; at most 5 beside transmission."""

    transmission: Share = 0.0
    """Share of the dielectric's base that is transparent, a solid that refracts: a number, or a texture."""

    clearcoat: Share = 0.0
    """Share of the surface under a clear coat of index 1.5: a number, or a texture."""

    clearcoat_roughness: Share = 0.03
    """Roughness of the clear coat, the root of GGX's alpha: a number, or a texture."""

    clearcoat_normal_map: NormalMap | None = None
    """Normals of the clear coat from a picture; the shape needs texture coordinates."""

    clearcoat_flat: bool = Field(default=False, strict=True)
    """Whether the clear coat lies flat over what is below, and does not follow its normals."""

    sheen: Reflectance = (0.0, 0.0, 0.0)
    """Colour of the light that fibres standing up from a cloth send back at grazing angles: channels 0 to 1, or a
    texture."""

    sheen_roughness: Fraction = 0.5
    """Roughness of the sheen: the smaller, the nearer it keeps to grazing angles."""

    emission: Emission = (0.0, 0.0, 0.0)
    """Radiance emitted from the side of the normal [W/(m² sr) per channel]: a colour, or a texture."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (ABSORPTION,)

    @model_validator(mode="after")
    def _check_maps(self) -> Self:
        if self.anisotropy_map is not None and self.anisotropy > 0:
            raise refuse(
                "does not count beside anisotropy_map", got=self.anisotropy, path=("anisotropy",),
                allowed="strength of the map",
            )  # fmt: skip
        if self.clearcoat_normal_map is not None and self.clearcoat_flat:
            raise refuse(
                "does not count beside clearcoat_normal_map", got=True, path=("clearcoat_flat",), allowed="false"
            )
        return self

    @model_validator(mode="after")
    def _check_bend(self) -> Self:
        if self.transmission == 0:
            return self
        if self.index < 1 + LEAST_BEND:
            raise refuse(
                "bends light too little for transmission", got=self.index, path=("index",),
                allowed=f"at least {1 + LEAST_BEND:g} beside transmission",
            )  # fmt: skip
        if self.index > MOST_BEND:
            raise refuse(
                "is out of range", got=self.index, path=("index",), allowed=f"at most {MOST_BEND:g} beside transmission"
            )
        return self

    @property
    def parameter(self) -> float:
        """The number of its own that the kernels read: the index."""
        return self.index


class Matte(BumpyMaterial):
    """A surface that scatters light evenly (Lambert)."""

    kind: Literal["matte"]
    """Kind of material."""

    reflectance: Reflectance
    """Share of light reflected: a colour of channels 0 to 1, or a texture."""


class Mirror(CoveringMaterial):
    """A perfectly smooth reflector."""

    kind: Literal["mirror"]
    """Kind of material."""

    reflectance: Albedo = (1.0, 1.0, 1.0)
    """Share of light reflected; a colour of channels 0 to 1."""


class Plastic(RoughMaterial, BumpyMaterial):
    """A matte base under a clear dielectric cover; the cover is smooth without `alpha` and `roughness`."""

    kind: Literal["plastic"]
    """Kind of material."""

    reflectance: Reflectance
    """Share of light that the base reflects: a colour of channels 0 to 1, or a texture."""

    index: Annotated[float, Field(ge=1, le=5), NUMBER] = 1.5
    """Refractive index of the cover."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (ROUGHNESS,)

    @property
    def parameter(self) -> float:
        """The number of its own that the kernels read: the index."""
        return self.index


class Emissive(SceneModel):
    """A lamp: it emits from the side of the normal and reflects nothing."""

    kind: Literal["emissive"]
    """Kind of material."""

    radiance: Emission
    """Radiance emitted [W/(m² sr) per channel]: a colour or a texture."""

    two_sided: bool = Field(default=False, strict=True)
    """Whether the back emits too."""

    @property
    def parameter(self) -> float:
        """The number of its own that the kernels read: 1 where the back emits."""
        return float(self.two_sided)


Leaf = Annotated[
    Matte | Mirror | Conductor | Dielectric | Plastic | ThinGlass | Principled, Field(discriminator="kind")
]


class Mix(CoveringMaterial):
    """Two materials beside each other, finer than can be seen: each vertex of a path is of one of them."""

    kind: Literal["mix"]
    """Kind of material."""

    materials: Annotated[tuple[Leaf, Leaf], BeforeValidator(list_of(2, "two materials"))]
    """The two: names of `materials`, or materials written out; not emissive, not mixed themselves."""

    factor: Share = 0.5
    """Share of the second: a number, or a texture."""

    @model_validator(mode="after")
    def _check_holes(self) -> Self:
        for index, part in enumerate(self.materials):
            if part.opacity != 1.0:
                raise refuse(
                    "does not count inside a mix", got=part.opacity, allowed="the opacity of the mix itself",
                    path=("materials", index, "opacity"),
                )  # fmt: skip
        return self


Material = Annotated[
    Matte | Mirror | Conductor | Dielectric | Plastic | ThinGlass | Principled | Mix | Emissive,
    Field(discriminator="kind"),
]

_GREY = Matte(kind="matte", reflectance=(0.5, 0.5, 0.5))


def _named(name: str, materials: Mapping[str, Any], path: tuple[str | int, ...]) -> Any:
    if name not in materials:
        names = list(materials)
        raise refuse(
            f"names no material{near_name(name, names)}",
            got=name,
            allowed=listed(names) if names else "a material mapping, or a name once `materials` defines one",
            path=path,
        )
    return materials[name]


def with_parts(material: Any, materials: Mapping[str, Any] | None, path: tuple[str | int, ...]) -> Any:
    """Return a material's mapping with the names in a mix replaced by what they name.

    Parameters
    ----------
    material
        What stands for a material, unchecked.
    materials
        The scene's materials; None where they have errors of their own, which are reported.
    path
        Keys that lead to the material, for errors.
    """
    if not isinstance(material, dict) or material.get("kind") != "mix":
        return material
    parts = material.get("materials")
    if not isinstance(parts, (list, tuple)):
        return material
    found = [
        part if not isinstance(part, str) else _GREY if materials is None
        else _named(part, materials, (*path, "materials", index))
        for index, part in enumerate(parts)
    ]  # fmt: skip
    return material | {"materials": found}


def with_material(item: Any, index: int, materials: Mapping[str, Any] | None) -> Any:
    """Return an object's mapping with the name of its material, or those in it, replaced by the materials."""
    if not isinstance(item, dict) or "material" not in item:
        return item
    path = (index, "material")
    name = item["material"]
    if not isinstance(name, str):
        return item | {"material": with_parts(name, materials, path)}
    # Where the materials have errors, the object's other keys still count.
    return item | {"material": _GREY if materials is None else _named(name, materials, path)}
