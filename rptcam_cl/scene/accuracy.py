"""What a camera model may err by."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.quantities import NUMBER
from rptcam_cl.scene.refusal import refuse

AUTO = {"const": "auto", "description": "The bounds that they have by default."}


class Accuracy(SceneModel):
    """What a cheaper camera model may err by to be taken in place of the traced lens; `auto` for the bounds below."""

    max_error_px: Annotated[float, Field(ge=0, le=1e6), NUMBER] = 0.5
    """Distance by which light may fall beside its place anywhere on the picture [pixels]."""

    max_illumination_error: Annotated[float, Field(ge=0, le=1e6), NUMBER] = 0.01
    """Relative error that the brightness may have anywhere on the picture, 1 on the axis."""

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        if isinstance(value, dict | SceneModel):
            return value
        if value != "auto":
            raise refuse("is not what a camera may err by", allowed="auto, or a mapping of bounds")
        return {}
