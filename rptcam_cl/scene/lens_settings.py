"""What a scene says about its lens: which one, its opening, its losses, and the largest error of a cheaper model."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator

from rptcam_cl.core.camera_records import MOST_LAYERS
from rptcam_cl.scene.base import SceneModel, read_number, refuse
from rptcam_cl.scene.file_reference import FileName, FileReference
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER, list_of

MAX_TEXT = 1000
MAX_DEPTH = 16
MAX_VALUES = 50_000

FORMS = "a name, a file in the scene's folder, or a prescription as a mapping"


def _lens(value: Any) -> str | dict[str, Any]:
    """Return a reference to a lens: short text, or a mapping of plain finite data."""
    if isinstance(value, str):
        if not value.strip() or len(value) > MAX_TEXT or not value.isprintable():
            raise refuse("is not a name or file", allowed=FORMS)
        return value
    if not isinstance(value, dict):
        raise refuse("must be a lens", allowed=FORMS)
    pending: list[tuple[Any, tuple[str | int, ...]]] = [(value, ())]
    for count, (item, path) in enumerate(pending):
        if count > MAX_VALUES or len(path) > MAX_DEPTH:
            raise refuse(f"has more than {MAX_VALUES} values or {MAX_DEPTH} levels", allowed=FORMS)
        pending.extend(_children(item, path))
    return value


def _children(item: Any, path: tuple[str | int, ...]) -> list[tuple[Any, tuple[str | int, ...]]]:
    """Return the values inside a mapping or list, each with its path; refuse what YAML has no form for."""
    if isinstance(item, dict):
        if not all(isinstance(key, (str, int)) for key in item):
            raise refuse("has a key that is neither a word nor a number", path=path)
        return [(child, (*path, key)) for key, child in item.items()]
    if isinstance(item, (list, tuple)):
        return [(child, (*path, index)) for index, child in enumerate(item)]
    if isinstance(item, float) and not math.isfinite(item):
        raise refuse("must be finite", got=item, allowed="a finite number", path=path)
    if item is not None and not isinstance(item, (str, int, float)):
        raise refuse(f"is of a kind that lens files do not have ({type(item).__name__})", got=str(item), path=path)
    return []


LensReference = Annotated[str | dict[str, Any], BeforeValidator(_lens)]

Turn = Annotated[float, Field(ge=-360, le=360), NUMBER]
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6), NUMBER]
PAIR = "a pair [x, y]"


class CircularAperture(SceneModel):
    """A round aperture."""

    shape: Literal["circle"] = "circle"
    """Outline of the aperture."""


class PolygonAperture(SceneModel):
    """An aperture made of blades: corners on the circle of the aperture radius, edges straight or bulging."""

    shape: Literal["polygon"]
    """Outline of the aperture."""

    blades: Annotated[int, Field(ge=3, le=64), WHOLE_NUMBER]
    """Number of corners."""

    curvature: Annotated[float, Field(ge=0, le=1), NUMBER] = 0.0
    """How far each edge bulges: 0 straight, 1 the circle."""

    rotation_degrees: Turn = 0.0
    """Turn of the first corner from the camera's +x towards +y [degrees]."""


class StarAperture(SceneModel):
    """A star with its tips on the circle of the aperture radius."""

    shape: Literal["star"]
    """Outline of the aperture."""

    points: Annotated[int, Field(ge=3, le=64), WHOLE_NUMBER] = 5
    """Number of tips."""

    inner_radius: Annotated[float, Field(gt=0, lt=1), NUMBER] = 0.4
    """Radius of the inner corners as a share of the aperture radius."""

    rotation_degrees: Turn = 90.0
    """Turn of the first tip from the camera's +x towards +y [degrees]; 90 points it up."""


class HeartAperture(SceneModel):
    """A heart within the circle of the aperture radius."""

    shape: Literal["heart"]
    """Outline of the aperture."""

    rotation_degrees: Turn = 0.0
    """Turn from upright, from the camera's +x towards +y [degrees]."""


class OutlineAperture(SceneModel):
    """Any polygon that does not cross itself, moved and scaled to touch the circle of the aperture radius."""

    shape: Literal["outline"]
    """Outline of the aperture."""

    points: Annotated[
        tuple[Annotated[tuple[Coordinate, Coordinate], BeforeValidator(list_of(2, PAIR))], ...],
        Field(min_length=3, max_length=256),
    ]
    """Corners in order, as pairs [x, y] of any unit."""

    rotation_degrees: Turn = 0.0
    """Turn from the camera's +x towards +y [degrees]."""


class ImageAperture(FileReference):
    """A square picture: open where it is brighter than half; its inscribed circle is the aperture's."""

    shape: Literal["image"]
    """Outline of the aperture."""

    file: FileName
    """Picture file in the scene's folder (PNG, JPEG or TIFF, at most 512 x 512 pixels)."""


Aperture = Annotated[
    CircularAperture | PolygonAperture | StarAperture | HeartAperture | OutlineAperture | ImageAperture,
    Field(discriminator="shape"),
]

Density = Annotated[float, Field(ge=0, le=100), NUMBER]


class Dirt(SceneModel):
    """Dust and scratches in the plane of the stop. A wider stop shows the same ones and more of them."""

    dust_per_mm2: Density = 2.0
    """Specks of dust in each square millimetre."""

    dust_um: Annotated[float, Field(ge=1, le=1000), NUMBER] = 40.0
    """Median diameter of a speck [micrometres]."""

    scratches_per_mm2: Density = 0.1
    """Scratches in each square millimetre."""

    scratch_um: Annotated[float, Field(ge=0.1, le=1000), NUMBER] = 6.0
    """Width of a scratch [micrometres]."""

    scratch_mm: Annotated[float, Field(gt=0, le=1000), NUMBER] = 2.0
    """Median length of a scratch [mm]."""

    seed: Annotated[int, Field(ge=0, le=2**32 - 1), WHOLE_NUMBER] = 0
    """Chooses the places; equal seeds give equal dirt."""


class Stop(SceneModel):
    """What lies in the plane of the stop beside its blades."""

    dirt: Dirt | None = None
    """Dust and scratches; they scatter light where `diffraction` counts. None by default."""


CLEAN = Stop()

COATINGS = ("bare", "mgf2", "multi")
WORDS: dict[str, dict[str, bool]] = {
    "ideal": {"fresnel": False, "absorption": False},
    "bare": {"coatings": False},
    "coated": {"coatings": True},
}

IN_WORDS, LAYERED = "a coating", "a coating of layers"  # forms; not keys
_ALLOWED = "bare, mgf2, multi, a reflectance from 0 to below 1, or {layers: [{index: …, thickness_nm: …}, …]}"


class CoatingLayer(SceneModel):
    """One layer of a coating."""

    index: Annotated[float, Field(gt=0, le=5), NUMBER]
    """At every wavelength; at least 1 of a layer that is clear."""

    extinction: Annotated[float, Field(ge=0, le=20), NUMBER] = 0.0
    """k of its index n + i k, above 0 where it absorbs."""

    thickness_nm: Annotated[float, Field(gt=0), NUMBER]
    """Of the layer [nm]."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.index < 1 and not self.extinction:
            raise refuse("is no index of a clear layer", got=self.index, allowed="1 to 5", path=("index",))
        return self


class CoatingLayers(SceneModel):
    """Several layers."""

    layers: Annotated[tuple[CoatingLayer, ...], Field(min_length=1, max_length=MOST_LAYERS)]
    """From the air to the glass."""


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


_PlainCoating = Annotated[
    str | float,
    BeforeValidator(_read_coating),
    WithJsonSchema({"anyOf": [{"enum": list(COATINGS)}, {"type": "number", "minimum": 0, "exclusiveMaximum": 1}]}),
]
Coating = Annotated[
    Annotated[_PlainCoating, Tag(IN_WORDS)] | Annotated[CoatingLayers, Tag(LAYERED)],
    Discriminator(lambda value: LAYERED if isinstance(value, dict | CoatingLayers) else IN_WORDS),
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
    of index 1.38 at 550 nm), `multi` (three layers), a reflectance at normal incidence, or several layers."""

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

AUTO = {"const": "auto", "description": "The bounds that they have by default."}


class Accuracy(SceneModel):
    """Largest error of a cheaper camera model that may replace the traced lens; `auto` for the bounds below."""

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
