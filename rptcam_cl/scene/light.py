"""Lights that have no surface, and the environment. Lamps with a surface are objects of an emissive material."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from rptcam_cl.scene.base import SceneModel, refuse
from rptcam_cl.scene.file_reference import GREY, FileReference
from rptcam_cl.scene.quantities import NUMBER, Direction, Gain, LightColour, PatternAlbedo, Position, Radiance, Turn


class PointLight(SceneModel):
    """A lamp without size that shines evenly in all directions."""

    kind: Literal["point"]
    """Kind of light."""

    position: Position
    """Where it is [scene units]."""

    intensity: Radiance
    """Radiant intensity [W/sr per channel]; a colour."""


class SpotLight(SceneModel):
    """A lamp without size that shines into a cone: full up to `inner_degrees`, fading to nothing at `outer_degrees`."""

    kind: Literal["spot"]
    """Kind of light."""

    position: Position
    """Where it is [scene units]."""

    direction: Direction
    """Direction of the axis of the cone; any length."""

    intensity: Radiance
    """Radiant intensity along the axis [W/sr per channel]; a colour."""

    outer_degrees: Annotated[float, Field(gt=0, le=180), NUMBER]
    """Angle from the axis beyond which it is dark [degrees]."""

    inner_degrees: Annotated[float, Field(ge=0, le=180), NUMBER] | None = None
    """Angle from the axis within which it is full [degrees]; less than `outer_degrees`, by default 0.8 of it."""

    @model_validator(mode="after")
    def _check_angles(self) -> Self:
        if self.inner_degrees is not None and self.inner_degrees >= self.outer_degrees:
            raise refuse(
                "is not less than outer_degrees",
                got=self.inner_degrees,
                allowed=f"less than {self.outer_degrees:g}",
                path=("inner_degrees",),
            )
        return self

    @property
    def inner(self) -> float:
        """Angle from the axis within which it is full [degrees]."""
        return 0.8 * self.outer_degrees if self.inner_degrees is None else self.inner_degrees


class ProfileLight(FileReference):
    """A lamp without size that shines as a luminaire was measured: an IES file (IESNA LM-63) of type C."""

    kind: Literal["ies"]
    """Kind of light."""

    position: Position
    """Where it is [scene units]."""

    direction: Direction = (0.0, -1.0, 0.0)
    """Direction of the file's vertical angle 0; any length. In a scene the default is against the camera's `up`."""

    rotation_degrees: Turn = 0.0
    """Turn about `direction`, counter-clockwise seen along it [degrees]."""

    gain: Gain = Field(default=1.0)
    """Factor on the intensities of the file."""

    color: LightColour = (1.0, 1.0, 1.0)
    """Colour of the light; made to have luminance 1."""


class DirectionalLight(SceneModel):
    """A lamp infinitely far away, such as the sun without its disk."""

    kind: Literal["directional"]
    """Kind of light."""

    direction: Direction
    """Direction in which the light travels; any length."""

    irradiance: Radiance
    """Irradiance on a surface that faces the light [W/m² per channel]; a colour."""


class SunLight(SceneModel):
    """A round lamp infinitely far away; the camera sees its disk."""

    kind: Literal["sun"]
    """Kind of light."""

    direction: Direction
    """Direction in which the light of its middle travels; any length."""

    irradiance: Radiance
    """Irradiance on a surface that faces its middle [W/m² per channel]; a colour."""

    diameter_degrees: Annotated[float, Field(ge=0.01, le=180), NUMBER] = 0.53
    """Angle across the disk [degrees]; its radiance is the same all over."""


Light = Annotated[PointLight | DirectionalLight | SpotLight | ProfileLight | SunLight, Field(discriminator="kind")]

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

    stand_in: ClassVar[bytes | None] = GREY

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
