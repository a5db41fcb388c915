"""What a lens takes from the light that crosses it."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.numbers import read_number
from rptcam_cl.scene.refusal import refuse

COATINGS = ("bare", "mgf2")
WORDS: dict[str, dict[str, bool]] = {
    "ideal": {"fresnel": False, "absorption": False},
    "bare": {"coatings": False},
    "coated": {"coatings": True},
}

_ALLOWED = "bare, mgf2, or a reflectance from 0 to below 1"


def _read_coating(value: Any) -> str | float:
    """Return a word, or the share of light that is reflected."""
    if isinstance(value, str) and value in COATINGS:
        return value
    if isinstance(value, str):
        raise refuse("is no coating", allowed=_ALLOWED)
    share = read_number(value)
    if not 0 <= share < 1:
        raise refuse("is no share of light", got=share, allowed=_ALLOWED)
    return share


Coating = Annotated[
    str | float,
    BeforeValidator(_read_coating),
    WithJsonSchema({"anyOf": [{"enum": list(COATINGS)}, {"type": "number", "minimum": 0, "exclusiveMaximum": 1}]}),
]
Flag = Annotated[bool, Field(strict=True)]


class Transmission(SceneModel):
    """What a lens takes from light: a word, or what counts. `ideal` is nothing, `bare` glass and surfaces without their
    coatings, `coated` with them."""

    fresnel: Flag = True
    """Whether surfaces reflect."""

    coatings: Flag | None = None
    """Whether they do so through their coatings: true needs a lens that has some, false leaves every surface bare; by
    default they count where the lens has any."""

    absorption: Flag = True
    """Whether glass absorbs, where it is known how much."""

    coating: Coating | None = None
    """What lies on every surface between glass and air, in place of what the lens says: `bare`, `mgf2` (a quarter wave
    of index 1.38 at 550 nm), or a reflectance at normal incidence."""

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        if isinstance(value, dict | SceneModel):
            return value
        if not isinstance(value, str) or value not in WORDS:
            raise refuse("is not what a lens lets through", allowed=f"{', '.join(WORDS)}, or a mapping of what counts")
        return WORDS[value]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.fresnel and (self.coatings or self.coating is not None):
            key: Literal["coatings", "coating"] = "coatings" if self.coatings else "coating"
            raise refuse("says nothing where surfaces do not reflect", allowed="fresnel: true beside it", path=(key,))
        if self.coatings is False and self.coating is not None:
            raise refuse("says nothing where coatings do not count", allowed="no coatings: false", path=("coating",))
        return self


IDEAL = Transmission(fresnel=False, absorption=False)
EVERY_FORM = {"enum": list(WORDS), "description": "What counts, in a word."}
