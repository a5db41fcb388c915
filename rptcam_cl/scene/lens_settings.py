"""What a scene says about its lens: which one, its opening, losses and tolerances; where it is focused, by whom."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator

from rptcam_cl.core.records import MOST_LAYERS
from rptcam_cl.optics.as_built import BARRELS, Heat
from rptcam_cl.optics.glass import STANDARD_C, STANDARD_HPA
from rptcam_cl.scene import base, quantities

# Autofocus settings of a scene: the method, where in the picture, and which of several zones is used.

Method = Literal["contrast", "laplacian", "variance", "depth", "phase", "hybrid"]
METHODS: tuple[Method, ...] = get_args(Method)
_BY_DISTANCE = ("depth", "phase")  # methods that measure a distance, of which a criterion then makes the focus
_CRITERION = re.compile(r"spot|pixel|mtf@(\d+(?:\.\d+)?)")
_MOST_PER_MM = 2000.0


def _criterion(text: Any) -> Any:
    """Check a criterion of sharpness: `spot`, `pixel` or `mtf@` and line pairs per millimetre."""
    match = _CRITERION.fullmatch(text) if isinstance(text, str) else None
    if match is None or (match[1] and not 0 < float(match[1]) <= _MOST_PER_MM):
        allowed = f"spot, pixel, or mtf@30 with line pairs per mm of the film, up to {_MOST_PER_MM:g}"
        raise base.refuse("is no criterion of sharpness", got=text, allowed=allowed)
    return text


Policy = Literal["closest", "farthest", "centre", "weighted"]
POLICIES: tuple[Policy, ...] = get_args(Policy)
_ObjectName = Annotated[str, Field(max_length=200)]
_ZONE = "[x0, x1, y0, y1]"


def _list_of_zones(value: Any) -> Any:
    if not isinstance(value, (list, tuple)) or not value:
        raise base.refuse("must be a list of zones", allowed=f"as [{_ZONE}, …], in fractions of the picture")
    for index, zone in enumerate(value):
        if not isinstance(zone, (list, tuple)):
            raise base.refuse(f"must be {_ZONE}", got=zone, allowed="four fractions of the picture", path=(index,))
        quantities.list_of(4, _ZONE)(zone)
    return value


class ZonesFile(base.FileReference):
    """Zones in a text file: a line each of left, right, top and bottom in fractions of the picture."""


class FocusMask(base.FileReference):
    """A picture of any size that covers the whole picture: focus is on what is brighter than half there."""


class AutoFocus(base.SceneModel):
    """Autofocus. At most one of `zones`, `zones_from`, `mask`, `point`, `object` and `at`, but that `at` may stand
    beside `object`; by default a zone in the middle."""

    alternatives: ClassVar[tuple[base.Alternatives, ...]] = (
        base.Alternatives(("zones", "zones_from", "mask", "point", "object"), required=False),
        base.Alternatives(("zones", "zones_from", "mask", "point", "at"), required=False),
    )

    method: Method = "contrast"
    """How the focus is found."""

    zones: Annotated[tuple[quantities.Rectangle, ...], BeforeValidator(_list_of_zones)] | None = None
    """Rectangles of the picture to focus on, [x0, x1, y0, y1] each as fractions from its left and top edges."""

    zones_from: ZonesFile | None = None
    """The same from a file."""

    mask: FocusMask | None = None
    """A picture that is bright where to focus: a zone in each of its bright parts."""

    point: quantities.FilmPoint | None = None
    """A point of the picture to focus on, as fractions from its left and top edges."""

    object: _ObjectName | None = None
    """Name of the object to focus on, wherever it is seen."""

    at: quantities.Position | None = None
    """A point of the scene to focus on [scene units]; with `object` in the coordinates of that object's own keys or
    file, with which it moves: an eye of a face."""

    policy: Policy = "closest"
    """Which of several zones decides."""

    criterion: Annotated[str, BeforeValidator(_criterion)] | None = None
    """With `depth` and `phase`: what is called sharpest. `spot`, by default: the least rms spot. `mtf@30`: where 30
    line pairs per mm of the film keep most contrast. `pixel`: where details of four pixels of the picture do."""

    adjustment: Annotated[float, Field(ge=-1000, le=1000), quantities.NUMBER] = 0.0
    """AF micro-adjustment, or a fault that the camera has: how far the focus is set beside what is found [depths of
    focus]; above 0 farther away."""

    sensor: Annotated[bool, Field(strict=True)] = False
    """Whether probes have the noise and the white of the scene's `sensor`, in the exposure of the picture; not with
    `depth`, whose rays need no light."""

    draw_zones: Annotated[bool, Field(strict=True)] = False
    """Whether the zones are drawn into PNG files as white rectangles."""

    @model_validator(mode="after")
    def _check_criterion(self) -> Self:
        if self.criterion is not None and self.method not in _BY_DISTANCE:
            raise base.refuse(
                f"says what is sharpest at a distance, but {self.method} goes where its measure is greatest",
                got=self.criterion,
                allowed="method: depth or phase beside it",
                path=("criterion",),
            )
        return self

    @model_validator(mode="after")
    def _check_sensor(self) -> Self:
        if self.sensor and self.method == "depth":
            raise base.refuse(
                "gives probes noise, and depth takes none: its rays need no light",
                allowed="another method beside it",
                path=("sensor",),
            )
        return self


_AutoFocusOrMethod = Annotated[
    AutoFocus,
    base.word_for("method", METHODS, problem="is no method", otherwise=" or a mapping"),
    base.AlsoAccepts({"enum": list(METHODS), "description": "A method alone."}),
]


class FoundFocus(base.SceneModel):
    """Focus of a thin lens that is found: by autofocus, or on an object. Exactly one of these."""

    alternatives: ClassVar[tuple[base.Alternatives, ...]] = (base.Alternatives(("auto", "object"), required=True),)

    auto: _AutoFocusOrMethod | None = None
    """Autofocus."""

    object: _ObjectName | None = None
    """Name of an object that the focus follows, as with other lenses."""


# Where a real lens is focused.


class Focus(base.SceneModel):
    """Focus of a real lens: where the object plane, the film or the group is. Exactly one of these, or `auto`.

    Where the eye is the centre of the film, `distance_m`, `point` and `object` fix a plane of the scene, at right
    angles to the axis. `front_distance_m` fixes it relative to the lens: the plane lies farther from the eye by the
    length of the lens and the film distance, which follow from it.
    """

    alternatives: ClassVar[tuple[base.Alternatives, ...]] = (
        base.Alternatives(
            ("distance_m", "front_distance_m", "point", "object", "film_distance_mm", "group_shift_mm", "auto"),
            required=True,
        ),
    )

    distance_m: quantities.Metres | None = None
    """Distance from the object plane in focus to the film [m]."""

    front_distance_m: quantities.Metres | None = None
    """Distance from the object plane in focus to the first vertex of the lens [m]."""

    point: quantities.Position | None = None
    """A point of the object plane in focus [scene units]."""

    object: _ObjectName | None = None
    """Name of an object that the focus follows: the object plane goes through the middle of the box round it, where
    camera and object are when the shutter opens."""

    film_distance_mm: quantities.Millimetres | None = None
    """Distance from the last vertex of the lens to the film [mm]."""

    group_shift_mm: Annotated[float, Field(ge=-1e6, le=1e6), quantities.NUMBER] | None = None
    """How far the focusing group of the lens stands towards the film from its place in the lens file [mm]; of
    floating groups the change of the gap that changes most."""

    auto: _AutoFocusOrMethod | None = None
    """Autofocus."""

    method: Literal["thick", "spot"] = "thick"
    """How the film distance of an object plane is found: first-order optics, or the least spot of traced rays."""

    field: quantities.FilmPoint | None = None
    """With method `spot`: where in the picture the spot is least, as fractions from its left and top edges; on the
    axis by default."""

    @model_validator(mode="after")
    def _check_method(self) -> Self:
        given = [key for key in ("film_distance_mm", "group_shift_mm", "auto") if getattr(self, key) is not None]
        if self.method != "thick" and given:
            raise base.refuse(
                f"seeks the film distance, which {given[0]} gives already",
                got=self.method,
                allowed="distance_m, front_distance_m, point or object beside it",
                path=("method",),
            )
        if self.field is not None and self.method != "spot":
            raise base.refuse(
                "says where the spot is least",
                got=list(self.field),
                allowed="method: spot beside it",
                path=("field",),
            )
        return self


# What a scene says about its lens: which one, its opening, its losses, and the largest error of a cheaper model.

_MAX_TEXT = 1000
_MAX_DEPTH = 16
_MAX_VALUES = 50_000

FORMS = "a name, a file in the scene's folder, or a prescription as a mapping"


def _lens(value: Any) -> str | dict[str, Any]:
    """Return a reference to a lens: short text, or a mapping of plain finite data."""
    if isinstance(value, str):
        if not value.strip() or len(value) > _MAX_TEXT or not value.isprintable():
            raise base.refuse("is not a name or file", allowed=FORMS)
        return value
    if not isinstance(value, dict):
        raise base.refuse("must be a lens", allowed=FORMS)
    pending: list[tuple[Any, tuple[str | int, ...]]] = [(value, ())]
    for count, (item, path) in enumerate(pending):
        if count > _MAX_VALUES or len(path) > _MAX_DEPTH:
            raise base.refuse(f"has more than {_MAX_VALUES} values or {_MAX_DEPTH} levels", allowed=FORMS)
        pending.extend(_children(item, path))
    return value


def _children(item: Any, path: tuple[str | int, ...]) -> list[tuple[Any, tuple[str | int, ...]]]:
    """Return the values inside a mapping or list, each with its path; refuse what YAML has no form for."""
    if isinstance(item, dict):
        if not all(isinstance(key, (str, int)) for key in item):
            raise base.refuse("has a key that is neither a word nor a number", path=path)
        return [(child, (*path, key)) for key, child in item.items()]
    if isinstance(item, (list, tuple)):
        return [(child, (*path, index)) for index, child in enumerate(item)]
    if isinstance(item, float) and not math.isfinite(item):
        raise base.refuse("must be finite", got=item, allowed="a finite number", path=path)
    if item is not None and not isinstance(item, (str, int, float)):
        raise base.refuse(f"is of a kind that lens files do not have ({type(item).__name__})", got=str(item), path=path)
    return []


_LensReference = Annotated[str | dict[str, Any], BeforeValidator(_lens)]

_PAIR = "a pair [x, y]"


class CircularAperture(base.SceneModel):
    """A round aperture."""

    shape: Literal["circle"] = "circle"
    """Outline of the aperture."""


ROUND = CircularAperture()


class PolygonAperture(base.SceneModel):
    """An aperture made of blades: corners on the circle of the aperture radius, edges straight or bulging."""

    shape: Literal["polygon"]
    """Outline of the aperture."""

    blades: Annotated[int, Field(ge=3, le=64), quantities.WHOLE_NUMBER]
    """Number of corners."""

    curvature: Annotated[float, Field(ge=0, le=1), quantities.NUMBER] = 0.0
    """How far each edge bulges: 0 straight, 1 the circle."""

    rotation_degrees: quantities.Turn = 0.0
    """Turn of the first corner from the camera's +x towards +y [degrees]."""


class StarAperture(base.SceneModel):
    """A star with its tips on the circle of the aperture radius."""

    shape: Literal["star"]
    """Outline of the aperture."""

    points: Annotated[int, Field(ge=3, le=64), quantities.WHOLE_NUMBER] = 5
    """Number of tips."""

    inner_radius: Annotated[float, Field(gt=0, lt=1), quantities.NUMBER] = 0.4
    """Radius of the inner corners as a share of the aperture radius."""

    rotation_degrees: quantities.Turn = 90.0
    """Turn of the first tip from the camera's +x towards +y [degrees]; 90 points it up."""


class HeartAperture(base.SceneModel):
    """A heart within the circle of the aperture radius."""

    shape: Literal["heart"]
    """Outline of the aperture."""

    rotation_degrees: quantities.Turn = 0.0
    """Turn from upright, from the camera's +x towards +y [degrees]."""


class OutlineAperture(base.SceneModel):
    """Any polygon that does not cross itself, moved and scaled to touch the circle of the aperture radius."""

    shape: Literal["outline"]
    """Outline of the aperture."""

    points: Annotated[
        tuple[
            Annotated[
                tuple[quantities.TextureNumber, quantities.TextureNumber], BeforeValidator(quantities.list_of(2, _PAIR))
            ],
            ...,
        ],
        Field(min_length=3, max_length=256),
    ]
    """Corners in order, as pairs [x, y] of any unit."""

    rotation_degrees: quantities.Turn = 0.0
    """Turn from the camera's +x towards +y [degrees]."""


class ImageAperture(base.FileReference):
    """A square picture: open where it is brighter than half; its inscribed circle is the aperture's."""

    shape: Literal["image"]
    """Outline of the aperture."""

    file: base.FileName
    """Picture file in the scene's folder (PNG, JPEG or TIFF, at most 512 x 512 pixels)."""


Aperture = Annotated[
    CircularAperture | PolygonAperture | StarAperture | HeartAperture | OutlineAperture | ImageAperture,
    Field(discriminator="shape"),
]

Density = Annotated[float, Field(ge=0, le=100), quantities.NUMBER]


class Dirt(base.SceneModel):
    """Dust and scratches in the plane of the stop. A wider stop shows the same ones and more of them."""

    dust_per_mm2: Density = 2.0
    """Specks of dust in each square millimetre."""

    dust_um: Annotated[float, Field(ge=1, le=1000), quantities.NUMBER] = 40.0
    """Median diameter of a speck [micrometres]."""

    scratches_per_mm2: Density = 0.1
    """Scratches in each square millimetre."""

    scratch_um: Annotated[float, Field(ge=0.1, le=1000), quantities.NUMBER] = 6.0
    """Width of a scratch [micrometres]."""

    scratch_mm: Annotated[float, Field(gt=0, le=1000), quantities.NUMBER] = 2.0
    """Median length of a scratch [mm]."""

    seed: Annotated[int, Field(ge=0, le=2**32 - 1), quantities.WHOLE_NUMBER] = 0
    """Chooses the places; equal seeds give equal dirt."""


class Stop(base.SceneModel):
    """What lies in the plane of the stop beside its blades."""

    dirt: Dirt | None = None
    """Dust and scratches; they scatter light where `diffraction` counts. None by default."""


CLEAN = Stop()

COATINGS = ("bare", "mgf2", "multi")
_WORDS: dict[str, dict[str, Any]] = {
    "ideal": {"fresnel": False, "absorption": False},
    "bare": {"coatings": False},
    "coated": {"coatings": True},
    "mgf2": {"coating": "mgf2"},
    "multi": {"coating": "multi"},
}

IN_WORDS, LAYERED = "a coating", "a coating of layers"  # forms; not keys
_ALLOWED = "bare, mgf2, multi, a reflectance from 0 to below 1, or {layers: [{index: …, thickness_nm: …}, …]}"


class CoatingLayer(base.SceneModel):
    """One layer of a coating."""

    index: Annotated[float, Field(gt=0, le=5), quantities.NUMBER]
    """At every wavelength; at least 1 of a layer that is clear."""

    extinction: Annotated[float, Field(ge=0, le=20), quantities.NUMBER] = 0.0
    """k of its index n + i k, above 0 where it absorbs."""

    thickness_nm: Annotated[float, Field(gt=0), quantities.NUMBER]
    """Of the layer [nm]."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.index < 1 and not self.extinction:
            raise base.refuse("is no index of a clear layer", got=self.index, allowed="1 to 5", path=("index",))
        return self


class CoatingLayers(base.SceneModel):
    """Several layers."""

    layers: Annotated[tuple[CoatingLayer, ...], Field(min_length=1, max_length=MOST_LAYERS)]
    """From the air to the glass."""


def _read_coating(value: Any) -> str | float:
    """Return a word, or the share of light that is reflected."""
    if isinstance(value, str) and value in COATINGS:
        return value
    if isinstance(value, str):
        raise base.refuse("is no coating", allowed=_ALLOWED)
    share = base.read_number(value)
    if not 0 <= share < 1:
        raise base.refuse("is no share of light", got=share, allowed=_ALLOWED)
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
_Flag = Annotated[bool, Field(strict=True)]


class Transmission(base.SceneModel):
    """What a lens takes from light: a word, or what counts. `ideal` is nothing, `bare` glass and surfaces without their
    coatings, `coated` with them, `mgf2` and `multi` with such a `coating`."""

    fresnel: _Flag = True
    """Whether surfaces reflect."""

    coatings: _Flag | None = None
    """Whether they do so through their coatings: true needs a lens that has some, false leaves every surface bare; by
    default they count where the lens has any."""

    absorption: _Flag = True
    """Whether glass absorbs, where it is known how much."""

    coating: Coating | None = None
    """What lies on every surface between glass and air, in place of what the lens says: `bare`, `mgf2` (a quarter wave
    of index 1.38 at 550 nm), `multi` (three layers), a reflectance at normal incidence, or several layers."""

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        if isinstance(value, dict | base.SceneModel):
            return value
        if not isinstance(value, str) or value not in _WORDS:
            raise base.refuse(
                "is not what a lens lets through", allowed=f"{', '.join(_WORDS)}, or a mapping of what counts"
            )
        return _WORDS[value]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.fresnel and (self.coatings or self.coating is not None):
            key: Literal["coatings", "coating"] = "coatings" if self.coatings else "coating"
            raise base.refuse(
                "says nothing where surfaces do not reflect", allowed="fresnel: true beside it", path=(key,)
            )
        if self.coatings is False and self.coating is not None:
            raise base.refuse(
                "says nothing where coatings do not count", allowed="no coatings: false", path=("coating",)
            )
        return self


IDEAL = Transmission(fresnel=False, absorption=False)
EVERY_FORM = {"enum": list(_WORDS), "description": "What counts, in a word."}

AUTO = {"const": "auto", "description": "The bounds that they have by default."}


class Accuracy(base.SceneModel):
    """Largest error of a cheaper camera model that may replace the traced lens; `auto` for the bounds below."""

    max_error_px: Annotated[float, Field(ge=0, le=1e6), quantities.NUMBER] = 0.5
    """Distance by which light may fall beside its place anywhere on the picture [pixels]."""

    max_illumination_error: Annotated[float, Field(ge=0, le=1e6), quantities.NUMBER] = 0.01
    """Relative error that the brightness may have anywhere on the picture, 1 on the axis."""

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        if isinstance(value, dict | base.SceneModel):
            return value
        if value != "auto":
            raise base.refuse("is not what a camera may err by", allowed="auto, or a mapping of bounds")
        return {}


# A lens that is not quite its design: a copy made within tolerances.

GRADES = ("commercial", "precision", "high_precision")
DESIGN, REAL = "a design", "a real lens"  # forms of a lens; not keys
_PERCENT = re.compile(r"([0-9]{1,3}(?:\.[0-9]{1,6})?) *%")
_PATTERN = r"^[0-9]{1,3}(\.[0-9]{1,6})? *%$"


def _check_percent(value: Any) -> str:
    """Return a percentage that is written with its sign."""
    match = _PERCENT.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None or not 0 < float(match[1]) <= 100:
        raise base.refuse("is no percentage of copies", allowed="above 0 % to 100 %, with its sign: 90%")
    return str(value)


_LEAST_EXPANSION, _MOST_EXPANSION = -1e-5, 1e-3  # of barrels [1/K]
_PERCENTAGE = {"type": "string", "pattern": _PATTERN}
_Percent = Annotated[str, BeforeValidator(_check_percent), WithJsonSchema(_PERCENTAGE)]


class AsBuilt(base.SceneModel):
    """One of many copies of the lens that are made within tolerances."""

    percentile: _Percent
    """Which copy: so many of all are as good or better, `90%` one of the worse."""

    spec: Annotated[str, Field(min_length=1, max_length=_MAX_TEXT)] = "commercial"
    """The tolerances: a grade (`commercial`, `precision`, `high_precision`), or a file in the scene's folder."""

    @property
    def percent(self) -> float:
        """The number of the percentile."""
        return float(self.percentile.strip().removesuffix("%"))


def _from_percentile(value: Any) -> Any:
    return value if isinstance(value, (dict, base.SceneModel)) else {"percentile": value}


def _check_barrel(value: Any) -> str | float:
    """Return a material, or an expansion."""
    expansion = f", or a linear expansion from {_LEAST_EXPANSION:g} to {_MOST_EXPANSION:g} per kelvin"
    if isinstance(value, str):
        if value not in BARRELS:
            raise base.unknown_name("is no material of a barrel", value, BARRELS, otherwise=expansion)
        return value
    number = base.read_number(value)
    if not _LEAST_EXPANSION <= number <= _MOST_EXPANSION:
        raise base.refuse("is no linear expansion", allowed=base.listed(list(BARRELS)) + expansion)
    return number


_BARREL_FORMS = {
    "anyOf": [
        {"enum": list(BARRELS)},
        {"type": "number", "minimum": _LEAST_EXPANSION, "maximum": _MOST_EXPANSION},
    ]
}


Temperature = Annotated[float, Field(ge=-100, le=140), quantities.NUMBER]
_Pressure = Annotated[float, Field(ge=0, le=2000), quantities.NUMBER]
_Barrel = Annotated[str | float, BeforeValidator(_check_barrel), WithJsonSchema(_BARREL_FORMS)]


def _heat(temperature_c: float, pressure_hpa: float, barrel: str | float) -> Heat | None:
    """Return the heat of a lens; None at 20 degrees and standard pressure."""
    heat = Heat(temperature_c, pressure_hpa, barrel if isinstance(barrel, float) else BARRELS[barrel])
    return None if (heat.celsius, heat.pressure_hpa) == (STANDARD_C, STANDARD_HPA) else heat


class RealLens(base.SceneModel):
    """A lens as it is made, or as heat has it."""

    design: _LensReference
    """The lens by name, file or prescription, as `lens` alone would be."""

    as_built: Annotated[AsBuilt, BeforeValidator(_from_percentile), base.AlsoAccepts(_PERCENTAGE)] | None = None
    """Which copy of it; the design itself by default."""

    temperature_c: Temperature = 20.0
    """Temperature of the lens and the air around it [degrees Celsius]."""

    pressure_hpa: _Pressure = 1013.25
    """Pressure of that air [hPa]."""

    barrel: _Barrel = "aluminium"
    """What holds elements and film: a material, or its linear expansion [1/K]."""

    @property
    def heat(self) -> Heat | None:
        """What it is exposed to; None at 20 degrees and standard pressure."""
        return _heat(self.temperature_c, self.pressure_hpa, self.barrel)

    @property
    def air(self) -> dict[str, float]:
        """The keys of the air around it, which another lens in its place has too."""
        return self.model_dump(include={"temperature_c", "pressure_hpa"}, exclude_defaults=True)


def _form(value: Any) -> str:
    return REAL if isinstance(value, RealLens) or (isinstance(value, dict) and "design" in value) else DESIGN


LensOrDesign = Annotated[
    Annotated[_LensReference, Tag(DESIGN)] | Annotated[RealLens, Tag(REAL)],
    Discriminator(_form),
]


def with_design(value: Any, key: str) -> Any:
    """Return the data of a lens that has keys of a `RealLens`, one of which is to be set."""
    has_keys = not isinstance(value, (str, dict)) or (isinstance(value, dict) and "design" in value)
    return value if value is None or has_keys or key not in RealLens.model_fields else {"design": value}


# Tolerances of a lens: how far manufacture may be off, and by what copies of the lens are judged.

_MOST_COPIES = 100_000
_MOST_FIELDS = 32

Distribution = Literal["uniform", "normal", "end_point"]
Number = Annotated[int, Field(ge=0, le=10_000), quantities.WHOLE_NUMBER]
Numbers = Annotated[tuple[Number, ...], Field(min_length=1, max_length=1000)]
Size = Annotated[float, Field(ge=0, le=1e6), quantities.NUMBER]
Share = Annotated[float, Field(ge=0, le=50), quantities.NUMBER]
_Minutes = Annotated[float, Field(ge=0, le=600), quantities.NUMBER]
Wavelength = Annotated[float, Field(ge=200, le=20_000), quantities.NUMBER]
_FieldAngle = Annotated[float, Field(ge=0, le=60), quantities.NUMBER]
Text = Annotated[str, Field(max_length=_MAX_TEXT)]

_OF_SURFACES = ("radius_percent", "radius_mm", "radius_fringes", "spacing_mm")
_OF_ELEMENTS = ("thickness_mm", "thickness_percent", "index", "abbe_percent", "wedge_arcmin", "wedge_um")
OF_EITHER = ("decentre_mm", "tilt_arcmin", "tilt_um")
_ADJUSTABLE = ("spacing_mm", *OF_EITHER)  # in a copy that is made


class Tolerance(base.SceneModel):
    """How far something may be off, either way. Exactly one quantity."""

    alternatives: ClassVar[tuple[base.Alternatives, ...]] = (
        base.Alternatives((*_OF_SURFACES, *_OF_ELEMENTS, *OF_EITHER), required=True),
        base.Alternatives(("surfaces", "elements", "group"), required=False),
    )

    radius_percent: Share | None = None
    """Radius of curvature, as a share of it [%]."""

    radius_mm: Size | None = None
    """Radius of curvature [mm]."""

    radius_fringes: Size | None = None
    """The same as fringes of power against a test glass over the clear diameter, at 632.8 nm."""

    spacing_mm: Size | None = None
    """Air space behind a surface, on the axis [mm]."""

    thickness_mm: Size | None = None
    """Thickness of an element on the axis [mm]."""

    thickness_percent: Share | None = None
    """The same as a share of it [%]."""

    index: Annotated[float, Field(ge=0, le=0.1), quantities.NUMBER] | None = None
    """Refractive index of a glass, at every wavelength."""

    abbe_percent: Share | None = None
    """Abbe number of a glass, as a share of it [%]."""

    wedge_arcmin: _Minutes | None = None
    """Angle between the two surfaces of an element: its second surface tilts [minutes of arc]."""

    wedge_um: Size | None = None
    """The same as the difference of edge thickness over the clear diameter [micrometres]."""

    decentre_mm: Size | None = None
    """How far something stands beside the axis, in any direction [mm]."""

    tilt_arcmin: _Minutes | None = None
    """How far something is tilted about its first vertex, in any direction [minutes of arc]."""

    tilt_um: Size | None = None
    """The same as run-out over the clear diameter of its first surface [micrometres]."""

    of: Literal["element", "surface"] = "element"
    """What is decentred or tilted: elements, cemented ones together, or each surface alone."""

    surfaces: Numbers | None = None
    """The surfaces meant, counted from 0; all by default."""

    elements: Numbers | None = None
    """The elements meant, counted from 0; all by default. Cemented ones are decentred and tilted as one."""

    group: Annotated[tuple[Number, Number], BeforeValidator(quantities.list_of(2, "[first, last]"))] | None = None
    """First and last of the surfaces that are decentred or tilted together."""

    distribution: Distribution | None = None
    """How copies differ within it; as the whole specification says by default."""

    sigmas: Annotated[float, Field(gt=0, le=10), quantities.NUMBER] | None = None
    """Of a normal distribution: how many standard deviations the tolerance is."""

    @property
    def quantity(self) -> str:
        """The key of the quantity."""
        return next(key for key in (*_OF_SURFACES, *_OF_ELEMENTS, *OF_EITHER) if getattr(self, key) is not None)

    @model_validator(mode="after")
    def _check_whose(self) -> Self:
        quantity = self.quantity
        either = quantity in OF_EITHER
        by_surface = quantity in _OF_SURFACES or (either and self.of == "surface")
        wrong: dict[str, str] = {
            "surfaces": "" if by_surface else "elements",
            "elements": "" if not by_surface else "surfaces",
            "group": "" if either else "surfaces" if by_surface else "elements",
        }
        for key, right in wrong.items():
            if getattr(self, key) is not None and right:
                raise base.refuse(f"does not go with {quantity}", allowed=right, path=(key,))
        if "of" in self.model_fields_set and (not either or self.group is not None):
            allowed = "decentre_mm, tilt_arcmin or tilt_um beside it, and no group"
            raise base.refuse("says what is decentred or tilted", allowed=allowed, path=("of",))
        if self.group is not None and self.group[0] > self.group[1]:
            raise base.refuse("begins behind its end", got=list(self.group), allowed="[first, last]", path=("group",))
        return self


class Merit(base.SceneModel):
    """By what copies are judged."""

    rank_by: Literal["spot", "mtf"] = "spot"
    """What makes one copy better than another: a smaller spot, or a higher modulation."""

    fields_degrees: Annotated[tuple[_FieldAngle, ...], Field(min_length=1, max_length=_MOST_FIELDS)] | None = None
    """Angles from the axis [degrees]; each beside 0 is seen in four directions. By default the axis, 0.7 of the widest
    field and that."""

    wavelengths_nm: Annotated[tuple[Wavelength, ...], Field(min_length=1, max_length=16)] = (486.13, 587.56, 656.27)
    """Wavelengths, which count equally [nm]."""

    mtf_per_mm: Annotated[float, Field(gt=0, le=1e4), quantities.NUMBER] = 30.0
    """Frequency on the film at which modulation is taken [cycles/mm]."""

    rings: Annotated[int, Field(ge=2, le=64), quantities.WHOLE_NUMBER] | None = None
    """Rings of rays in a beam; by default, in each field as many as leave spots and modulation where they are."""

    arms: Annotated[int, Field(ge=4, le=256), quantities.WHOLE_NUMBER] | None = None
    """About how many rays in a ring; twice as many as rings by default."""


class Tolerances(base.SceneModel):
    """What may be off in a lens."""

    name: Text = ""
    """What the specification is called."""

    source: Text = ""
    """Where its numbers come from."""

    tolerances: Annotated[tuple[Tolerance, ...], Field(max_length=1000)]
    """The tolerances."""

    compensators: Annotated[tuple[Tolerance, ...], Field(max_length=20)] = ()
    """What is adjusted in each copy until its spots are least, and how far either way: spacing_mm, decentre_mm,
    tilt_arcmin or tilt_um of one thing each."""

    distribution: Distribution = "uniform"
    """How copies differ within a tolerance: evenly, normally with the tolerance as the limit, or at its ends."""

    sigmas: Annotated[float, Field(gt=0, le=10), quantities.NUMBER] = 2.0
    """How many standard deviations a tolerance is, where the distribution is normal."""

    copies: Annotated[int, Field(ge=10, le=_MOST_COPIES), quantities.WHOLE_NUMBER] = 1000
    """How many lenses are made."""

    seed: Annotated[int, Field(ge=0, le=2**63 - 1), quantities.WHOLE_NUMBER] = 0
    """Which lenses they are."""

    refocus: Annotated[bool, Field(strict=True)] = True
    """Whether the film of each copy is moved to the least spots of all fields together."""

    f_number: Annotated[float, Field(ge=1e-2, le=1e6), quantities.NUMBER] | None = None
    """F-number at which copies are judged; wide open by default."""

    focus_distance_m: Annotated[float, Field(ge=1e-9, le=1e12), quantities.NUMBER] | None = None
    """Distance from the object to the film [m]; infinity by default."""

    zoom: Annotated[str, Field(max_length=200)] | None = None
    """Position of a zoom lens, by its name; the first by default."""

    temperature_c: Temperature = 20.0
    """Temperature of the copies and the air around them [degrees Celsius]."""

    pressure_hpa: _Pressure = 1013.25
    """Pressure of that air [hPa]."""

    barrel: _Barrel = "aluminium"
    """What holds elements and film: a material, or its linear expansion [1/K]."""

    merit: Merit = Merit()
    """By what copies are judged."""

    @property
    def heat(self) -> Heat | None:
        """What copies are exposed to; None at 20 degrees and standard pressure."""
        return _heat(self.temperature_c, self.pressure_hpa, self.barrel)

    @model_validator(mode="after")
    def _check_compensators(self) -> Self:
        for number, one in enumerate(self.compensators):
            path: tuple[str, int] = ("compensators", number)
            if one.quantity not in _ADJUSTABLE:
                raise base.refuse("cannot be adjusted", allowed=", ".join(_ADJUSTABLE), path=(*path, one.quantity))
            if one.distribution is not None or one.sigmas is not None:
                key = "sigmas" if one.distribution is None else "distribution"
                raise base.refuse("is of tolerances; a compensator is adjusted", path=(*path, key))
            named = one.group[:1] if one.group else one.surfaces or one.elements or ()
            if len(named) != 1:
                raise base.refuse("needs one surface, element or group", path=path)
        return self


_OPTIMAX = "Optimax Systems, Manufacturing Tolerance Chart, {}; spacing as its sag, mounts as its diameter and wedge"


def _grade(name: str, column: str, radius: float, thickness: float, sag: float, play: float, wedge: float,
           melt: tuple[float, float] | None) -> Tolerances:  # fmt: skip
    """Return tolerances by one column of the chart: percent, then millimetres, index and percent of the Abbe number.

    An element may lie beside the axis by half of what its diameter may be too small, and its seat may run out as far as
    its edge.
    """
    of_glass = (Tolerance(index=melt[0]), Tolerance(abbe_percent=melt[1])) if melt else ()
    return Tolerances(
        name=name,
        source=_OPTIMAX.format(column),
        tolerances=(
            Tolerance(radius_percent=radius),
            Tolerance(thickness_mm=thickness),
            Tolerance(spacing_mm=sag),
            *of_glass,
            Tolerance(wedge_um=1e3 * wedge),
            Tolerance(decentre_mm=play / 2),
            Tolerance(tilt_um=1e3 * wedge),
        ),
    )


def grade(name: str) -> Tolerances:
    """Return the tolerances of a grade by its name, of `real_lens.GRADES`; the highest knows its glass by melt data."""
    return {
        "commercial": lambda: _grade(name, "commercial", 0.2, 0.15, 0.05, 0.1, 0.05, (0.001, 0.8)),
        "precision": lambda: _grade(name, "precision", 0.1, 0.05, 0.025, 0.025, 0.01, (0.0005, 0.5)),
        "high_precision": lambda: _grade(name, "high precision", 0.05, 0.025, 0.015, 0.015, 0.005, None),
    }[name]()
