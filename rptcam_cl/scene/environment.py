"""The environment: light that arrives from infinitely far away in every direction."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.quantities import Direction, Radiance


class ConstantEnvironment(SceneModel):
    """The same radiance from everywhere."""

    kind: Literal["constant"]
    """Kind of environment."""

    radiance: Radiance
    """Radiance [W/(m² sr) per channel]; a colour."""


class GradientEnvironment(SceneModel):
    """Radiance that changes linearly with the cosine to `up`, from `bottom` straight below to `top` straight above."""

    kind: Literal["gradient"]
    """Kind of environment."""

    bottom: Radiance
    """Radiance from straight below [W/(m² sr) per channel]; a colour."""

    top: Radiance
    """Radiance from straight above [W/(m² sr) per channel]; a colour."""

    up: Direction = (0.0, 1.0, 0.0)
    """Direction that counts as above; any length. In a scene the default is the `up` of the camera."""


Environment = Annotated[ConstantEnvironment | GradientEnvironment, Field(discriminator="kind")]
