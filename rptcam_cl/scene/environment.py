"""The environment: light that arrives from infinitely far away in every direction."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.file_reference import FileReference
from rptcam_cl.scene.quantities import NUMBER, Direction, Gain, PatternAlbedo, Radiance, Turn

WITH_UP = ("gradient", "image", "sky")  # kinds whose `up` is the camera's by default


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


class ImageEnvironment(FileReference):
    """A picture of the whole sphere in longitude and latitude, 360 degrees across and 180 degrees down."""

    kind: Literal["image"]
    """Kind of environment."""

    color_space: Literal["auto", "srgb", "linear"] = "auto"
    """How colours are stored; auto: sRGB for pictures of 8 and 16 bits, linear for OpenEXR and Radiance HDR."""

    gain: Gain = 1.0
    """Radiance of the picture's 1 [W/(m² sr) per channel]."""

    up: Direction = (0.0, 1.0, 0.0)
    """Direction of the top row; any length. In a scene the default is the `up` of the camera."""

    rotation_degrees: Turn = 0.0
    """Turn of the surroundings about `up`, counter-clockwise seen from above [degrees]."""


class SkyEnvironment(SceneModel):
    """A clear sky with its sun over an even ground, in absolute units (Preetham 1999)."""

    kind: Literal["sky"]
    """Kind of environment."""

    sun_elevation_degrees: Annotated[float, Field(ge=0, le=90), NUMBER] = 45.0
    """Angle of the sun above the horizon [degrees]."""

    sun_azimuth_degrees: Turn = 0.0
    """Angle of the sun from straight ahead about `up`, counter-clockwise seen from above [degrees]."""

    turbidity: Annotated[float, Field(ge=2, le=10), NUMBER] = 3.0
    """Haziness of the air: 2 is very clear, 3 clear, 10 hazy."""

    ground_albedo: PatternAlbedo = (0.3, 0.3, 0.3)
    """Share of light that the ground reflects; a colour of channels 0 to 1."""

    sun: bool = Field(default=True, strict=True)
    """Whether the disk of the sun shines."""

    gain: Gain = 1.0
    """Factor on all radiances."""

    up: Direction = (0.0, 1.0, 0.0)
    """Direction of the zenith; any length. In a scene the default is the `up` of the camera."""


Environment = Annotated[
    ConstantEnvironment | GradientEnvironment | ImageEnvironment | SkyEnvironment,
    Field(discriminator="kind"),
]
"""What surrounds a scene."""
