"""What most materials have besides how they scatter: holes, normals from a picture, roughness of facets."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from rptcam_cl.scene.base import Alternatives, SceneModel, read_number, refuse
from rptcam_cl.scene.file_reference import one_pixel
from rptcam_cl.scene.quantities import NUMBER, Fraction, Turn
from rptcam_cl.scene.texture import ImageTexture, Share


class NormalMap(ImageTexture):
    """A picture of normals in the tangent frame, as glTF has them: red along u, green along v, blue outwards."""

    stand_in: ClassVar[bytes | None] = one_pixel(128, 128, 255)  # the surface's own normal

    kind: Literal["image"] = "image"
    """Kind of texture."""

    color_space: Literal["auto", "srgb", "linear"] = "linear"
    """How the components are stored."""

    strength: Annotated[float, Field(ge=0, le=10), NUMBER] = 1.0
    """Factor on the components along u and v."""


class AnisotropyMap(ImageTexture):
    """A picture of how a surface is brushed, as glTF has it: red along u, green along v, blue the strength."""

    stand_in: ClassVar[bytes | None] = one_pixel(255, 128, 0)  # not brushed

    kind: Literal["image"] = "image"
    """Kind of texture."""

    color_space: Literal["auto", "srgb", "linear"] = "linear"
    """How the components are stored."""

    strength: Fraction = 1.0
    """Factor on the strength."""


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


SMALLEST_ALPHA = 1e-3  # what float32 still resolves about a highlight

_ALPHA = {"type": "number", "minimum": SMALLEST_ALPHA, "maximum": 1}


def _alphas(value: Any) -> tuple[float, float]:
    """Return the pair that a number or a pair stands for."""

    def alpha(item: Any, path: tuple[int, ...]) -> float:
        number = read_number(item)
        if not SMALLEST_ALPHA <= number <= 1:
            bound = f"at least {SMALLEST_ALPHA:g}" if number < 1 else "at most 1"
            raise refuse("is out of range", got=number, allowed=bound, path=path)
        return number

    if not isinstance(value, (list, tuple)):
        return alpha(value, ()), alpha(value, ())
    if len(value) != 2:
        raise refuse(f"has {len(value)} numbers instead of 2", allowed="a number, or a pair [along u, across]")
    return alpha(value[0], (0,)), alpha(value[1], (1,))


AlphaPair = Annotated[
    tuple[float, float],
    BeforeValidator(_alphas),
    WithJsonSchema({"anyOf": [_ALPHA, {"type": "array", "items": _ALPHA, "minItems": 2, "maxItems": 2}]}),
]


def alpha_pair(roughness: float, anisotropy: float) -> tuple[float, float]:
    """Return GGX's alpha along u and across (Burley 2012, section 5.4): their ratio is sqrt(1 - 0.9 anisotropy)."""
    alpha = max(roughness**2, SMALLEST_ALPHA)
    aspect = math.sqrt(1 - 0.9 * anisotropy)
    return max(alpha / aspect, SMALLEST_ALPHA), max(alpha * aspect, SMALLEST_ALPHA)


class RoughMaterial(SceneModel):
    """What says how rough a material is."""

    alpha: AlphaPair | None = None
    """GGX roughness: a number, or [along u, across]."""

    roughness: Fraction | None = None
    """Roughness as most programs show it: the root of alpha."""

    anisotropy: Fraction = 0.0
    """With `roughness`: stretch of highlights along u; 0 is none."""

    anisotropy_rotation_degrees: Turn = 0.0
    """Turn of the directions along u and across, from u towards v."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("alpha", "roughness"), required=False),)

    @property
    def alphas(self) -> tuple[float, float] | None:
        """GGX's alpha along u and across; None where the material is smooth."""
        if self.alpha is not None:
            return self.alpha
        return None if not self.roughness else alpha_pair(self.roughness, self.anisotropy)
