"""How the samples of a pixel are spread round it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.quantities import NUMBER

DEFAULT_RADIUS_PX = {"box": 0.5, "tent": 1.0, "gaussian": 1.5, "blackman_harris": 1.5, "mitchell": 2.0}


class FilmFilter(SceneModel):
    """The film's reconstruction filter: how much light beside a pixel's centre counts, along x times along y."""

    kind: Literal["box", "tent", "gaussian", "blackman_harris", "mitchell"] = "box"
    """Its shape; `mitchell` sharpens, with negative lobes."""

    radius_px: Annotated[float, Field(ge=0.01, le=16), NUMBER] | None = None
    """Distance from the pixel's centre at which it ends [pixels]; by default what suits its kind."""

    @property
    def radius(self) -> float:
        """Distance from the pixel's centre at which it ends [pixels]."""
        return DEFAULT_RADIUS_PX[self.kind] if self.radius_px is None else self.radius_px
