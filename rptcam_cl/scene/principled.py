"""The principled material: one set of keys from chalk over plastic and glass to metal, as glTF and Blender have it."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from rptcam_cl.scene.base import Alternatives
from rptcam_cl.scene.dielectric import ABSORPTION, LEAST_BEND, AbsorbingMaterial
from rptcam_cl.scene.material_parts import BumpyMaterial
from rptcam_cl.scene.quantities import NUMBER, Fraction
from rptcam_cl.scene.texture import Emission, Reflectance, Share
from rptcam_cl.scene.values import refuse


class Principled(AbsorbingMaterial, BumpyMaterial):
    """A mixture of a dielectric over a diffuse or transparent base, and a metal; with a clear coat and emission."""

    kind: Literal["principled"]
    """Kind of material."""

    base_color: Reflectance = (0.8, 0.8, 0.8)
    """Colour of the diffuse base, of transmission, and of the metal: channels 0 to 1, or a texture."""

    metallic: Share = 0.0
    """Share of metal: a number, or a texture."""

    roughness: Share = 0.5
    """Roughness of the surface, the root of GGX's alpha: a number, or a texture."""

    anisotropy: Fraction = 0.0
    """Stretch of highlights across u; 0 is none."""

    specular: Fraction = 1.0
    """Factor on the reflectance of the dielectric."""

    index: Annotated[float, Field(ge=1, le=5), NUMBER] = 1.5
    """Refractive index of the dielectric."""

    transmission: Fraction = 0.0
    """Share of the dielectric's base that is transparent: a solid that refracts."""

    clearcoat: Fraction = 0.0
    """Share of the surface under a clear coat of index 1.5."""

    clearcoat_roughness: Fraction = 0.03
    """Roughness of the clear coat, the root of GGX's alpha."""

    emission: Emission = (0.0, 0.0, 0.0)
    """Radiance emitted from the side of the normal [W/(m² sr) per channel]: a colour, or a texture."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (ABSORPTION,)

    @model_validator(mode="after")
    def _check_bend(self) -> Self:
        if self.transmission > 0 and self.index < 1 + LEAST_BEND:
            raise refuse(
                "bends light too little for transmission", got=self.index, path=("index",),
                allowed=f"at least {1 + LEAST_BEND:g} beside transmission",
            )  # fmt: skip
        return self
