"""How the film becomes the picture that a screen shows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.base import AlsoAccepts, SceneModel
from rptcam_cl.scene.overrides import apply_overrides
from rptcam_cl.scene.problems import input_error
from rptcam_cl.scene.quantities import NUMBER
from rptcam_cl.scene.values import listed, near_name, refuse
from rptcam_cl.scene.white_balance import LIGHTS, WhiteBalance

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


def load_picture(settings: Mapping[str, Any], overrides: Iterable[str] = ()) -> PictureSettings:
    """Return picture settings of a mapping, changed by overrides such as ``picture.tone=agx``.

    Raises
    ------
    InputError
        A key or a value is wrong, or an override is not of `picture`.
    """
    data: dict[Any, Any] = {"picture": dict(settings)}
    labels = apply_overrides(data, overrides)
    for path, text in labels.items():
        if path[0] != "picture" or len(path) < 2:
            raise InputError(f"--set {text}: the film is there already (allowed: keys of picture, as picture.tone=agx)")

    def where(path: tuple[str | int, ...], at_key: bool) -> str:
        told = [text for key, text in labels.items() if key[1 : 1 + len(path)] == path[: len(key) - 1]]
        return f"--set {told[-1]}: picture." if told else "picture."

    try:
        return PictureSettings.model_validate(data["picture"])
    except ValidationError as problem:
        raise input_error(problem, data["picture"], where) from None
