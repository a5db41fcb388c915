"""Materials: how surfaces reflect, transmit or emit light."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.quantities import NUMBER, Albedo, Radiance
from rptcam_cl.scene.texture import Reflectance


class Matte(SceneModel):
    """A surface that scatters light evenly (Lambert)."""

    kind: Literal["matte"]
    """Kind of material."""

    reflectance: Reflectance
    """Share of light reflected: a colour of channels 0 to 1, or a texture."""


class Mirror(SceneModel):
    """A perfectly smooth reflector."""

    kind: Literal["mirror"]
    """Kind of material."""

    reflectance: Albedo = (1.0, 1.0, 1.0)
    """Share of light reflected; a colour of channels 0 to 1."""


class Conductor(SceneModel):
    """A rough metal: GGX microfacets whose Fresnel reflectance is `reflectance` at every angle."""

    kind: Literal["conductor"]
    """Kind of material."""

    reflectance: Reflectance
    """Share of light that a microfacet reflects: a colour of channels 0 to 1, or a texture."""

    alpha: Annotated[float, Field(ge=1e-3, le=1), NUMBER]
    """GGX roughness; for a smoother surface take a mirror."""


class Dielectric(SceneModel):
    """A smooth transparent solid such as glass; the normal points out of it."""

    kind: Literal["dielectric"]
    """Kind of material."""

    index: Annotated[float, Field(ge=0.2, le=5), NUMBER] = 1.5
    """Refractive index inside, relative to the outside."""


class Emissive(SceneModel):
    """A lamp: it emits from the side of the normal and reflects nothing."""

    kind: Literal["emissive"]
    """Kind of material."""

    radiance: Radiance
    """Radiance emitted [W/(m² sr) per channel]; a colour."""

    two_sided: bool = Field(default=False, strict=True)
    """Whether the back emits too."""


Material = Annotated[Matte | Mirror | Conductor | Dielectric | Emissive, Field(discriminator="kind")]
