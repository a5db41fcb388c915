"""What most materials have besides how they scatter: holes, and normals from a picture."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.quantities import NUMBER, Fraction
from rptcam_cl.scene.texture import ImageTexture, Share


class NormalMap(ImageTexture):
    """A picture of normals in the tangent frame, as glTF has them: red along u, green along v, blue outwards."""

    kind: Literal["image"] = "image"
    """Kind of texture."""

    color_space: Literal["auto", "srgb", "linear"] = "linear"
    """How the components are stored."""

    strength: Annotated[float, Field(ge=0, le=10), NUMBER] = 1.0
    """Factor on the components along u and v."""


class CoveringMaterial(SceneModel):
    """A material that may have holes."""

    opacity: Share = 1.0
    """Share of the surface that is there: a number, or a texture (an image with `channel: a` for its alpha)."""

    opacity_mode: Literal["blend", "mask"] = "blend"
    """Whether rays pass with the probability that opacity leaves, or wherever opacity is below the cutoff."""

    opacity_cutoff: Fraction = 0.5
    """Opacity from which on a mask is there."""


def has_holes(material: SceneModel) -> bool:
    """Return whether rays may pass a surface of this material as if it were not there."""
    return isinstance(material, CoveringMaterial) and material.opacity != 1.0


class BumpyMaterial(CoveringMaterial):
    """A material whose normals may come from a picture."""

    normal_map: NormalMap | None = None
    """Normals from a picture; the shape needs texture coordinates."""
