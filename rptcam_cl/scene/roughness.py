"""How rough facets are: GGX's alpha, or the roughness that most programs show."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field

from rptcam_cl.scene.base import AlsoAccepts, Alternatives, SceneModel
from rptcam_cl.scene.quantities import NUMBER, Fraction, list_of

SMALLEST_ALPHA = 1e-3  # what float32 still resolves about a highlight

Alpha = Annotated[float, Field(ge=SMALLEST_ALPHA, le=1), NUMBER]
_PAIR = list_of(2, "a number, or a pair [along u, across]")


def _pair(value: Any) -> Any:
    return _PAIR(value) if isinstance(value, (list, tuple)) else (value, value)


AlphaPair = Annotated[
    tuple[Alpha, Alpha],
    BeforeValidator(_pair),
    AlsoAccepts({"type": "number", "minimum": SMALLEST_ALPHA, "maximum": 1}),
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
    """With `roughness`: stretch of highlights across u; 0 is none."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("alpha", "roughness"), required=False),)

    @property
    def alphas(self) -> tuple[float, float] | None:
        """GGX's alpha along u and across; None where the material is smooth."""
        if self.alpha is not None:
            return self.alpha
        return None if not self.roughness else alpha_pair(self.roughness, self.anisotropy)
