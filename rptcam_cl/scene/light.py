"""Lights that have no surface. Lamps with a surface are objects of an emissive material."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.quantities import Direction, Position, Radiance


class PointLight(SceneModel):
    """A lamp without size that shines evenly in all directions."""

    kind: Literal["point"]
    """Kind of light."""

    position: Position
    """Where it is [scene units]."""

    intensity: Radiance
    """Radiant intensity [W/sr per channel]; a colour."""


class DirectionalLight(SceneModel):
    """A lamp infinitely far away, such as the sun without its disk."""

    kind: Literal["directional"]
    """Kind of light."""

    direction: Direction
    """Direction in which the light travels; any length."""

    irradiance: Radiance
    """Irradiance on a surface that faces the light [W/m² per channel]; a colour."""


Light = Annotated[PointLight | DirectionalLight, Field(discriminator="kind")]
