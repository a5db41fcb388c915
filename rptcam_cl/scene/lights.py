"""Lights that have no surface, measured luminaires (ANSI/IESNA LM-63), and the environment."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import read_whole
from rptcam_cl.scene import quantities
from rptcam_cl.scene.base import GREY, FileReference, SceneModel, refuse
from rptcam_cl.scene.placement import CameraVisibility

#
# Measured luminaires: IES files (ANSI/IESNA LM-63, 1986 to 2019) of photometric type C.
#
# Intensities in candela become W/sr by the definition of the candela: 683 lm of light are taken as 1 W in every
# channel.

_LARGEST_FILE = 4_000_000  # bytes
_MOST_ANGLES = 4096
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Luminaire:
    """Intensities of a luminaire.

    Attributes
    ----------
    vertical : (m,) array
        Angles from straight down [degrees], rising.
    horizontal : (n,) array
        Angles about the vertical axis [degrees], rising from 0; the last is 0, 90, 180 or 360.
    watts : (n, m) array
        Intensity [W/sr].
    """

    vertical: Array
    horizontal: Array
    watts: Array

    def intensity(self, vertical: Array, horizontal: Array) -> Array:
        """Return intensities [W/sr] for all pairs of angles [degrees], shape (vertical, horizontal).

        Straight lines between the angles of the file; nothing beyond its vertical angles; planes that the file leaves
        out follow from its symmetry.
        """
        beyond = {"left": 0.0, "right": 0.0}
        planes = np.array([np.interp(vertical, self.vertical, row, **beyond) for row in self.watts])
        last = self.horizontal[-1]
        turned = np.mod(horizontal, 360.0)
        if last <= 180:
            turned = np.minimum(turned, 360 - turned)
        if last <= 90:
            turned = np.minimum(turned, 180 - turned)
        return np.array([np.interp(turned, self.horizontal, column) for column in planes.T])


def read_luminaire(source: Path | bytes) -> Luminaire:
    """Return the luminaire of an IES file, or of the content of one.

    Raises
    ------
    InputError
        When it is no IES file of type C that can be used; the message says why, not which file.
    StateError
        When it cannot be read.
    """
    return _luminaire(_numbers(read_whole(source, _LARGEST_FILE).decode("latin-1")))


def _numbers(text: str) -> list[float]:
    """Return the numbers behind the line TILT."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    tilt = next((index for index, line in enumerate(lines) if line.strip().upper().startswith("TILT")), None)
    if tilt is None:
        raise InputError("is not an IES file: it has no line TILT= (allowed: IESNA LM-63)")
    words = " ".join(lines[tilt + 1 :]).replace(",", " ").split()
    try:
        numbers = [float(word) for word in words]
    except ValueError as problem:
        raise InputError(f"has text among its numbers ({problem})") from None
    if not all(math.isfinite(number) for number in numbers):
        raise InputError("holds a number that is not finite")
    if (
        lines[tilt].strip().upper() == "TILT=INCLUDE"
    ):  # how output depends on the lamp's tilt: orientation, angles, factors
        pairs = int(numbers[1]) if len(numbers) > 1 and 0 <= numbers[1] <= _MOST_ANGLES else 0
        numbers = numbers[2 + 2 * pairs :]
    return numbers


def _luminaire(numbers: list[float]) -> Luminaire:
    if len(numbers) < 13:
        raise InputError("is cut off before its angles")
    multiplier, kind, factors = numbers[2], numbers[5], numbers[10] * numbers[11]
    counts = (numbers[3], numbers[4])
    if not all(count == int(count) and 1 <= count <= _MOST_ANGLES for count in counts):
        raise InputError(
            f"has unusable numbers of angles (got {counts[0]:g} and {counts[1]:g}; allowed: 1 to {_MOST_ANGLES})"
        )
    if kind != 1:
        raise InputError(f"is of photometric type {({2: 'B', 3: 'A'}).get(int(kind), kind)} (allowed: type C)")
    m, n = int(counts[0]), int(counts[1])
    values = np.array(numbers[13 : 13 + m + n + m * n])
    if len(values) != m + n + m * n:
        raise InputError(f"is cut off (got {len(values)} of {m + n + m * n} angles and intensities)")
    vertical, horizontal, candela = values[:m], values[m : m + n], values[m + n :].reshape(n, m)
    _check_angles(vertical, horizontal)
    if multiplier * factors <= 0 or (candela < 0).any():
        raise InputError("holds a negative intensity, or a factor that is not above 0")
    return Luminaire(vertical, horizontal, candela * (multiplier * factors / LUMENS_PER_WATT))


def _check_angles(vertical: Array, horizontal: Array) -> None:
    if (np.diff(vertical) <= 0).any() or vertical[0] < 0 or vertical[-1] > 180:
        raise InputError("has vertical angles that do not rise from 0 or more to at most 180 degrees")
    if (np.diff(horizontal) <= 0).any() or horizontal[0] != 0 or horizontal[-1] not in (0, 90, 180, 360):
        raise InputError("has horizontal angles that do not rise from 0 to 0, 90, 180 or 360 degrees")


# Lights that have no surface, and the environment. Lamps with a surface are objects of an emissive material.


class GroupedLight(SceneModel):
    """What every light has."""

    group: quantities.GroupName | None = None
    """Name of the layer that has its light, where `render.layers` has `lights`; by default its own."""


class PointLight(GroupedLight):
    """A lamp without size that shines evenly in all directions."""

    kind: Literal["point"]
    """Kind of light."""

    position: quantities.Position
    """Where it is [scene units]."""

    intensity: quantities.Radiance
    """Radiant intensity [W/sr per channel]; a colour."""


class SpotLight(GroupedLight):
    """A lamp without size that shines into a cone: full up to `inner_degrees`, fading to nothing at `outer_degrees`."""

    kind: Literal["spot"]
    """Kind of light."""

    position: quantities.Position
    """Where it is [scene units]."""

    direction: quantities.Direction
    """Direction of the axis of the cone; any length."""

    intensity: quantities.Radiance
    """Radiant intensity along the axis [W/sr per channel]; a colour."""

    outer_degrees: Annotated[float, Field(gt=0, le=180), quantities.NUMBER]
    """Angle from the axis beyond which it is dark [degrees]."""

    inner_degrees: Annotated[float, Field(ge=0, le=180), quantities.NUMBER] | None = None
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


class ProfileLight(GroupedLight, FileReference):
    """A lamp without size that shines as a luminaire was measured: an IES file (IESNA LM-63) of type C."""

    kind: Literal["ies"]
    """Kind of light."""

    position: quantities.Position
    """Where it is [scene units]."""

    direction: quantities.Direction = (0.0, -1.0, 0.0)
    """Direction of the file's vertical angle 0; any length. In a scene the default is against the camera's `up`."""

    rotation_degrees: quantities.Turn = 0.0
    """Turn about `direction`, counter-clockwise seen along it [degrees]."""

    gain: quantities.Gain = Field(default=1.0)
    """Factor on the intensities of the file."""

    color: quantities.LightColour = (1.0, 1.0, 1.0)
    """Colour of the light; made to have luminance 1."""


class DirectionalLight(GroupedLight):
    """A lamp infinitely far away, such as the sun without its disk."""

    kind: Literal["directional"]
    """Kind of light."""

    direction: quantities.Direction
    """Direction in which the light travels; any length."""

    irradiance: quantities.Radiance
    """Irradiance on a surface that faces the light [W/m² per channel]; a colour."""


class SunLight(GroupedLight):
    """A round lamp infinitely far away; the camera sees its disk."""

    kind: Literal["sun"]
    """Kind of light."""

    direction: quantities.Direction
    """Direction in which the light of its middle travels; any length."""

    irradiance: quantities.Radiance
    """Irradiance on a surface that faces its middle [W/m² per channel]; a colour."""

    diameter_degrees: Annotated[float, Field(ge=0.01, le=180), quantities.NUMBER] = 0.53
    """Angle across the disk [degrees]; its radiance is the same all over."""

    visible: CameraVisibility = CameraVisibility()
    """Whether the camera sees its disk."""


Light = Annotated[PointLight | DirectionalLight | SpotLight | ProfileLight | SunLight, Field(discriminator="kind")]

WITH_UP = ("gradient", "image", "sky")  # kinds whose `up` is the camera's by default


class Surrounding(GroupedLight):
    """What every environment has."""

    visible: CameraVisibility = CameraVisibility()
    """Whether the camera sees it directly; where not, it sees black there."""


class ConstantEnvironment(Surrounding):
    """The same radiance from everywhere."""

    kind: Literal["constant"]
    """Kind of environment."""

    radiance: quantities.Radiance
    """Radiance [W/(m² sr) per channel]; a colour."""


class GradientEnvironment(Surrounding):
    """Radiance that changes linearly with the cosine to `up`, from `bottom` straight below to `top` straight above."""

    kind: Literal["gradient"]
    """Kind of environment."""

    bottom: quantities.Radiance
    """Radiance from straight below [W/(m² sr) per channel]; a colour."""

    top: quantities.Radiance
    """Radiance from straight above [W/(m² sr) per channel]; a colour."""

    up: quantities.Direction = (0.0, 1.0, 0.0)
    """Direction that counts as above; any length. In a scene the default is the `up` of the camera."""


class ImageEnvironment(Surrounding, FileReference):
    """A picture of the whole sphere in longitude and latitude, 360 degrees across and 180 degrees down."""

    stand_in: ClassVar[bytes | None] = GREY

    kind: Literal["image"]
    """Kind of environment."""

    color_space: Literal["auto", "srgb", "linear"] = "auto"
    """How colours are stored; auto: sRGB for pictures of 8 and 16 bits, linear for OpenEXR and Radiance HDR."""

    gain: quantities.Gain = 1.0
    """Radiance of the picture's 1 [W/(m² sr) per channel]."""

    up: quantities.Direction = (0.0, 1.0, 0.0)
    """Direction of the top row; any length. In a scene the default is the `up` of the camera."""

    rotation_degrees: quantities.Turn = 0.0
    """Turn of the surroundings about `up`, counter-clockwise seen from above [degrees]."""


class SkyEnvironment(Surrounding):
    """A clear sky with its sun over an even ground, in absolute units (Preetham 1999)."""

    kind: Literal["sky"]
    """Kind of environment."""

    sun_elevation_degrees: Annotated[float, Field(ge=0, le=90), quantities.NUMBER] = 45.0
    """Angle of the sun above the horizon [degrees]."""

    sun_azimuth_degrees: quantities.Turn = 0.0
    """Angle of the sun from straight ahead about `up`, counter-clockwise seen from above [degrees]."""

    turbidity: Annotated[float, Field(ge=2, le=10), quantities.NUMBER] = 3.0
    """Haziness of the air: 2 is very clear, 3 clear, 10 hazy."""

    ground_albedo: quantities.PatternAlbedo = (0.3, 0.3, 0.3)
    """Share of light that the ground reflects; a colour of channels 0 to 1."""

    sun: bool = Field(default=True, strict=True)
    """Whether the disk of the sun shines."""

    gain: quantities.Gain = 1.0
    """Factor on all radiances."""

    up: quantities.Direction = (0.0, 1.0, 0.0)
    """Direction of the zenith; any length. In a scene the default is the `up` of the camera."""


Environment = Annotated[
    ConstantEnvironment | GradientEnvironment | ImageEnvironment | SkyEnvironment,
    Field(discriminator="kind"),
]
"""What surrounds a scene."""
