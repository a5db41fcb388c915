"""How the film becomes the picture that a screen shows: white balance, exposure, tone curve."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from rptcam_cl.colour import blackbody, illuminant, srgb_from_spectrum, srgb_from_xyz, xyz_from_spectrum
from rptcam_cl.scene.base import AlsoAccepts, Alternatives, SceneModel, listed, near_name, number_at, refuse
from rptcam_cl.scene.quantities import NUMBER, list_of

Light = Literal[
    "auto", "A", "D50", "D55", "D65", "D75", "E", "F2", "F7", "F11", "LED-B1", "LED-B2", "LED-B3", "LED-B4", "LED-B5"
]
LIGHTS: tuple[str, ...] = get_args(Light)
COOLEST, HOTTEST = 1800.0, 40000.0  # [K]
TINTS_PER_UV = 3000.0  # as photographers' programs count tint; that of D65 is 10
LEAST_BLUE = 0.06  # least Z of a light with Y = 1; below, an adaptation to white has no sense

Factor = Annotated[float, Field(ge=0.001, le=1000), NUMBER]


def _grey(value: Any) -> tuple[float, ...]:
    """Return a point [x, y] or a rectangle [x0, x1, y0, y1] in fractions of the film."""
    forms = "[x, y] or [x0, x1, y0, y1] with x0 < x1 and y0 < y1, each from 0 to 1"
    if not isinstance(value, (list, tuple)) or len(value) not in (2, 4):
        raise refuse("must be a place of the film", allowed=forms)
    place = tuple(number_at(item, (index,)) for index, item in enumerate(value))
    if not all(0 <= item <= 1 for item in place):
        raise refuse("lies outside the film", allowed=forms)
    if len(place) == 4 and not (place[0] < place[1] and place[2] < place[3]):
        raise refuse("has no area", allowed=forms)
    return place


_SHARE = {"type": "number", "minimum": 0, "maximum": 1}
_GREY_SCHEMA = {"anyOf": [{"type": "array", "items": _SHARE, "minItems": n, "maxItems": n} for n in (2, 4)]}


class WhiteBalance(SceneModel):
    """What light is made grey. One of `light`, `temperature_k`, `grey` and `gains`; a word stands for `light`."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("light", "temperature_k", "grey", "gains"), required=True),
    )

    light: Light | None = None
    """A CIE illuminant; `auto` takes the mean of the picture as grey."""

    temperature_k: Annotated[float, Field(ge=COOLEST, le=HOTTEST), NUMBER] | None = None
    """Temperature of a black body of the light's colour [K]."""

    tint: Annotated[float, Field(ge=-150, le=150), NUMBER] | None = None
    """With `temperature_k`: how much greener than that the light is, 3000 times the distance in CIE 1960 uv."""

    grey: Annotated[tuple[float, ...], BeforeValidator(_grey), WithJsonSchema(_GREY_SCHEMA)] | None = None
    """What is grey in truth: [x, y] or [x0, x1, y0, y1] as fractions of the film from its left and top edges."""

    gains: Annotated[tuple[Factor, Factor, Factor], BeforeValidator(list_of(3, "[red, green, blue]"))] | None = None
    """Factors on linear red, green and blue."""

    adaptation: Literal["channels", "bradford"] | None = None
    """What is scaled: the channels, or the responses of the Bradford transform; by default what suits the film."""

    @model_validator(mode="after")
    def _check_tint(self) -> Self:
        if self.adaptation is not None and self.gains is not None:
            raise refuse("has no use beside gains", got=self.adaptation, allowed="one of both", path=("adaptation",))
        if self.tint is None:
            return self
        if self.temperature_k is None:
            raise refuse("needs temperature_k", got=self.tint, allowed="a temperature beside it", path=("tint",))
        if _xyz_of_temperature(self.temperature_k, self.tint)[2] < LEAST_BLUE:
            raise refuse("is greener than light can be at this temperature", got=self.tint, path=("tint",))
        return self

    def light_colour(self) -> NDArray[np.float64] | None:
        """Return the light in linear sRGB, where it is given by name or temperature."""
        if self.temperature_k is not None:
            return np.asarray(srgb_from_xyz() @ _xyz_of_temperature(self.temperature_k, self.tint or 0.0))
        if self.light is None or self.light == "auto":
            return None
        return srgb_from_spectrum(illuminant(self.light))


def _xyz_of_temperature(kelvin: float, tint: float) -> NDArray[np.float64]:
    """Return X, Y, Z of luminance 1 beside a black body, at right angles to their row in CIE 1960 u, v."""
    here, hotter = _uv(kelvin), _uv(kelvin * 1.001)
    along = (hotter - here) / np.linalg.norm(hotter - here)
    u, v = here + tint / TINTS_PER_UV * np.array([along[1], -along[0]])
    return np.array([1.5 * u / v, 1.0, (2.0 - 0.5 * u) / v - 5.0])


def _uv(kelvin: float) -> NDArray[np.float64]:
    x, y, z = xyz_from_spectrum(blackbody(kelvin))
    return np.asarray(np.array([4 * x, 6 * y]) / (x + 15 * y + 3 * z))


Tone = Literal["srgb", "linear", "reinhard", "aces", "agx"]
TONES: tuple[str, ...] = get_args(Tone)
NO_BALANCE = "none"
DEFAULT_TONE_WHITE = 4.0


def _from_word(key: str, words: tuple[str, ...]) -> BeforeValidator:
    """Return a validator that takes a word as a mapping of one key."""

    def read(value: Any) -> Any:
        if isinstance(value, str):
            if value not in words:
                raise refuse(
                    f"is not a known choice{near_name(value, words)}", allowed=f"{listed(words)}, or a mapping"
                )
            return None if value == NO_BALANCE else {key: value}
        return value

    return BeforeValidator(read)


class ToneCurve(SceneModel):
    """How light without an upper limit fits into what a screen can show; a word stands for `kind`."""

    kind: Tone = "srgb"
    """The curve; `linear` is the only one whose values are not encoded as sRGB."""

    white: Annotated[float, Field(ge=0.01, le=1e6), NUMBER] | None = None
    """With `reinhard`: luminance that becomes white, 4 by default."""

    @model_validator(mode="after")
    def _check_white(self) -> Self:
        if self.white is not None and self.kind != "reinhard":
            raise refuse(
                f"is fixed for {self.kind}", got=self.white, allowed="only with kind: reinhard", path=("white",)
            )
        return self

    @property
    def shown_white(self) -> float:
        """Luminance that `reinhard` shows as white."""
        return DEFAULT_TONE_WHITE if self.white is None else self.white


class PictureSettings(SceneModel):
    """How the film becomes the picture: white balance, exposure, tone curve, gamut and encoding, in this order."""

    ev: Annotated[float, Field(ge=-60, le=60), NUMBER] = 0.0
    """Exposure compensation [stops]; +1 doubles the brightness."""

    white_balance: Annotated[
        WhiteBalance | None, _from_word("light", (NO_BALANCE, *LIGHTS)), AlsoAccepts({"enum": [NO_BALANCE, *LIGHTS]})
    ] = None
    """What light is made grey; `none` leaves colours as they are, white being D65."""

    tone: Annotated[ToneCurve, _from_word("kind", TONES), AlsoAccepts({"enum": list(TONES)})] = ToneCurve()
    """How light without an upper limit fits into what a screen can show."""

    gamut: Literal["clip", "desaturate"] = "clip"
    """What becomes of colours that sRGB cannot show: each channel is clipped, or all move towards their grey."""

    bits: Literal[8, 16] | None = None
    """Bits per channel of PNG and TIFF files; by default 8 in PNG and 16 in TIFF."""

    jpeg_quality: Annotated[int, Field(ge=1, le=100, strict=True)] = 95
    """Quality of JPEG files; colour is in half the resolution below 90."""

    def check_crop(self, crop: tuple[float, float, float, float] | None) -> None:
        """Refuse a grey place that is not wholly in the part of the film that is rendered."""
        place = None if self.white_balance is None else self.white_balance.grey
        if place is None or crop is None:
            return
        across, down = place[: len(place) // 2], place[len(place) // 2 :]
        if not (crop[0] <= min(across) <= max(across) <= crop[1] and crop[2] <= min(down) <= max(down) <= crop[3]):
            raise refuse(
                "lies outside the part of the film that is rendered",
                got=list(place),
                allowed=f"a place in film.crop, {list(crop)}",
                path=("picture", "white_balance", "grey"),
            )
