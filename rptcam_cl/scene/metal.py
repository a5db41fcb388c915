"""Metals: rough conductors, by a colour or by the optical constants of what they are made of."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from rptcam_cl.scene.base import Alternatives, SceneModel
from rptcam_cl.scene.coverage import BumpyMaterial
from rptcam_cl.scene.quantities import NUMBER, list_of
from rptcam_cl.scene.refusal import refuse
from rptcam_cl.scene.roughness import RoughMaterial
from rptcam_cl.scene.texture import Reflectance

Metal = Literal["aluminium", "chromium", "copper", "gold", "iron", "nickel", "platinum", "silver", "tungsten"]

WRITTEN_OUT = "written out"  # form of a metal that is no name; not a key

Constant = Annotated[float, Field(ge=1e-3, le=100), NUMBER]
_PER_CHANNEL = BeforeValidator(list_of(3, "one number each for red, green and blue"))


class OpticalConstants(SceneModel):
    """The refractive index n + i k of a metal in three channels."""

    n: Annotated[tuple[Constant, Constant, Constant], _PER_CHANNEL]
    """Real part [red, green, blue]."""

    k: Annotated[tuple[Constant, Constant, Constant], _PER_CHANNEL]
    """Imaginary part [red, green, blue]."""


def _form(value: Any) -> str:
    return WRITTEN_OUT if isinstance(value, (dict, OpticalConstants)) else "name"


class Conductor(RoughMaterial, BumpyMaterial):
    """A rough metal: GGX microfacets that reflect `reflectance` at every angle, or as the `metal` does."""

    kind: Literal["conductor"]
    """Kind of material."""

    reflectance: Reflectance | None = None
    """Share of light that a microfacet reflects: a colour of channels 0 to 1, or a texture."""

    metal: (
        Annotated[Annotated[Metal, Tag("name")] | Annotated[OpticalConstants, Tag(WRITTEN_OUT)], Discriminator(_form)]
        | None
    ) = None
    """What it is made of: a name, or its optical constants {n, k}."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("reflectance", "metal"), required=True),
        Alternatives(("alpha", "roughness"), required=True),
    )

    @model_validator(mode="after")
    def _check_rough(self) -> Self:
        if self.alphas is None:
            raise refuse(
                "must be more than 0", allowed="above 0 to 1; for a smooth surface take a mirror", path=("roughness",)
            )
        return self
