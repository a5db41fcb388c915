"""The film, the sensor behind it, the picture made of both, and how it is computed."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from rptcam_cl.core import MAX_SEED, MAX_SPP
from rptcam_cl.core.colour import Primaries, blackbody, illuminant, srgb_from_spectrum, srgb_from_xyz, xyz_from_spectrum
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import Folders
from rptcam_cl.scene import base
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER, IlluminantName, Rectangle, list_of

if TYPE_CHECKING:
    from rptcam_cl.scene.assets.grading import ColourTable, DisplayView

# How the picture is computed: samples, layers, and how colour is carried along paths.

LayerName = Literal[
    "depth",
    "distance",
    "position",
    "normal",
    "geometric_normal",
    "albedo",
    "coverage",
    "coc",
    "transmittance",
    "object_id",
    "material_id",
    "uv",
    "pupil",
    "samples",
    "variance",
    "direct",
    "ghosts",
    "lights",
    "crypto_object",
    "crypto_material",
    "sharp_depth",
    "pupil_depth",
    "sharp_position",
    "sharp_normal",
    "sharp_object_id",
    "sharp_material_id",
    "sharp_class_id",
    "occlusion",
    "flow_forward",
    "flow_backward",
    "motion",
    "ray_origin",
    "ray_direction",
]
LAYER_NAMES: tuple[LayerName, ...] = get_args(LayerName)
# Those that are one array each; `lights` is one for each group of lamps, a film each, and is no part of `all`.
SINGLE_LAYERS: tuple[LayerName, ...] = tuple(name for name in LAYER_NAMES if name != "lights")
LIGHT_LAYER = "lights."  # begins the names of what the layer lights becomes: one for each group of lamps
# Of the picture itself, not of what its rays meet.
FILM_LAYERS: tuple[LayerName, ...] = ("samples", "variance", "direct", "ghosts", "lights")
# Of the chief rays alone, without the samples of the picture.
SHARP_LAYERS: tuple[LayerName, ...] = LAYER_NAMES[LAYER_NAMES.index("sharp_depth") :]


def _as_list(names: object) -> object:
    if not isinstance(names, (list, tuple)):
        raise base.refuse("must be a list of layers", allowed="as [depth, normal]")
    return names


def _each_once(names: tuple[LayerName, ...]) -> tuple[LayerName, ...]:
    for index, name in enumerate(names):
        if name in names[:index]:
            raise base.refuse("is listed twice", got=name, allowed="each layer once", path=(index,))
    return names


Layers = Annotated[tuple[LayerName, ...], BeforeValidator(_as_list), AfterValidator(_each_once)]

_MAX_DEPTH = 1_000_000
ADAPTIVE_SPP = 16384  # where a noise target is out of reach


class RenderSettings(base.SceneModel):
    """How the light paths are sampled."""

    spp: Annotated[int, Field(ge=1, le=MAX_SPP), WHOLE_NUMBER] = 64
    """Samples per pixel."""

    max_depth: Annotated[int, Field(ge=1, le=_MAX_DEPTH), WHOLE_NUMBER] = 8
    """Longest path [edges], the camera's included: 1 sees lamps only, 2 adds direct light."""

    seed: Annotated[int, Field(ge=0, le=MAX_SEED), WHOLE_NUMBER] = 0
    """Seed of the random numbers; another seed gives other noise."""

    roulette_depth: Annotated[int, Field(ge=0, le=_MAX_DEPTH), WHOLE_NUMBER] = 4
    """Edge from which on Russian roulette may end a path; 0 means never."""

    sampler: Literal["lattice", "independent"] = "lattice"
    """How the samples of a pixel are spread: on a lattice, which lowers the noise, or each by itself."""

    noise: Annotated[float, Field(gt=0, lt=1), NUMBER] | None = None
    """Relative standard error at which a tile of 8 x 8 pixels is done; `spp` is then the most that a pixel gets."""

    clamp: Annotated[float, Field(ge=1e-6, le=1e30), NUMBER] | None = None
    """Most that a sample may bring to a channel of the film; brighter ones are scaled down, which is biased."""

    caustics: Annotated[Literal["off", "auto", "on"], BeforeValidator(base.read_switch)] = "auto"
    """Whether photons bring the light that smooth glass and mirrors throw onto surfaces that scatter it; `auto`: where
    the scene has such light from lamps that paths hardly find, and no `clamp`."""

    virtual_lights: Annotated[Literal["off", "auto", "on"], BeforeValidator(base.read_switch)] = "auto"
    """Whether paths connect to virtual lights, places of matte surfaces that paths from the lamps have met; `auto`: in
    rooms that are lit by detours. No light is changed, noise is."""

    multiple_scattering: bool = Field(default=True, strict=True)
    """Whether rough metal, rough glass and clear coats give back what their facets scatter more than once; else it is
    lost, as in many programs."""

    layers: Layers = ()
    """Auxiliary layers to record beside the picture, as depth and normal."""

    layers_spp: Annotated[int, Field(ge=1, le=MAX_SPP), WHOLE_NUMBER] = 64
    """Samples per pixel that the layers are made of at most, the first ones of the picture."""

    @property
    def most_spp(self) -> int:
        """Samples of a pixel at most: `spp`, which unless it is given leaves a noise target room."""
        return self.spp if self.noise is None or "spp" in self.model_fields_set else ADAPTIVE_SPP


LensColour = Annotated[Literal["off", "auto", "on"], BeforeValidator(base.read_switch)]


class SpectrumSettings(base.SceneModel):
    """How the colour of light is carried along paths; a word alone is the mode."""

    mode: Literal["auto", "rgb", "dispersive", "spectral"] = "auto"
    """Red, green and blue through a lens of one wavelength; the same with a wavelength per path, which lens and glass
    disperse; spectra at three wavelengths per path. By default what the scene needs."""

    lens: LensColour | None = None
    """Whether the lens refracts each wavelength separately; `auto`: where that moves light by more than half a pixel,
    or than `camera.accuracy` allows."""

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        return {"mode": value} if isinstance(value, str) else value

    @property
    def lens_colour(self) -> LensColour:
        """Whether the lens refracts each wavelength separately."""
        if self.mode == "rgb":
            return "off"
        return self.lens or ("on" if self.mode == "dispersive" else "auto")


#
# The film: what records the picture, its resolution, its size or format, and its filter.
#
# Film frames: ISO 1007 (135), ISO 732 (120), SMPTE ST 59 (35 mm cine), SMPTE ST 201 (super 16), 15/70 camera aperture
# (imax); sheets at their nominal size. Four Thirds: the system's standard. No standard fixes the size of other
# sensors, which are named after tubes or film; theirs are those that makers publish, of the camera named where these
# differ.

_DEFAULT_RADIUS_PX = {"box": 0.5, "tent": 1.0, "gaussian": 1.5, "blackman_harris": 1.5, "mitchell": 2.0}


class FilmFilter(base.SceneModel):
    """The film's reconstruction filter: how much light beside a pixel's centre counts, along x times along y."""

    kind: Literal["box", "tent", "gaussian", "blackman_harris", "mitchell"] = "box"
    """Its shape; `mitchell` sharpens, with negative lobes."""

    radius_px: Annotated[float, Field(ge=0.01, le=16), NUMBER] | None = None
    """Distance from the pixel's centre at which it ends [pixels]; by default what suits its kind."""

    @property
    def radius(self) -> float:
        """Distance from the pixel's centre at which it ends [pixels]."""
        return _DEFAULT_RADIUS_PX[self.kind] if self.radius_px is None else self.radius_px


SIDES_MM: dict[str, tuple[float, float]] = {
    "8x10_inch": (254.0, 203.2),
    "4x5_inch": (127.0, 101.6),
    "6x9": (84.0, 56.0),
    "6x7": (70.0, 56.0),
    "6x6": (56.0, 56.0),
    "645": (56.0, 41.5),
    "54x40": (53.4, 40.0),  # Phase One IQ4
    "44x33": (43.8, 32.9),  # Fujifilm GFX
    "imax": (70.41, 52.63),
    "full_frame": (36.0, 24.0),
    "aps_h": (27.9, 18.6),  # Canon EOS-1D Mark IV
    "super35": (24.89, 18.66),
    "half_frame": (24.0, 18.0),
    "aps_c": (23.5, 15.6),  # Sony, Nikon
    "aps_c_canon": (22.3, 14.9),  # Canon
    "micro_four_thirds": (17.3, 13.0),
    "super16": (12.52, 7.41),
    "one_inch": (13.2, 8.8),
    "2/3_inch": (8.8, 6.6),
    "1/1.7_inch": (7.44, 5.58),
    "1/1.8_inch": (7.18, 5.32),
    "1/2_inch": (6.4, 4.8),
    "1/2.3_inch": (6.17, 4.55),
    "1/3_inch": (4.8, 3.6),
    "1/4_inch": (3.6, 2.7),
}

_Name = Literal[
    "8x10_inch", "4x5_inch", "6x9", "6x7", "6x6", "645", "54x40", "44x33", "imax", "full_frame", "aps_h", "super35",
    "half_frame", "aps_c", "aps_c_canon", "micro_four_thirds", "super16", "one_inch", "2/3_inch", "1/1.7_inch",
    "1/1.8_inch", "1/2_inch", "1/2.3_inch", "1/3_inch", "1/4_inch",
]  # fmt: skip


def _as_text(value: Any) -> Any:
    """Return the name that YAML reads as a number."""
    return str(value) if value == 645 and not isinstance(value, str) else value


_FormatName = Annotated[_Name, BeforeValidator(_as_text), base.AlsoAccepts({"const": 645})]


def _size_in_format(name: str, resolution: tuple[int, int]) -> tuple[float, float]:
    """Return width and height [mm] of the largest picture of square pixels in a format, upright where it is.

    Parameters
    ----------
    name : str
        One of `SIDES_MM`.
    resolution : pair of int
        Width and height [pixels].
    """
    longer, shorter = SIDES_MM[name]
    width, height = resolution
    across, down = (longer, shorter) if width >= height else (shorter, longer)
    pixel = min(across / width, down / height)
    return (width * pixel, height * pixel) if not math.isclose(across * height, down * width) else (across, down)


_DEFAULT_WIDTH_MM = 36.0
_MAX_PIXELS = 2**31 - 1
_PAIR = "a pair [width, height]"
_CROP = "[x0, x1, y0, y1]"

Pixels = Annotated[int, Field(ge=1, le=_MAX_PIXELS), WHOLE_NUMBER]
Millimetres = Annotated[float, Field(ge=1e-6, le=1e9), NUMBER]


class Film(base.SceneModel):
    """The film. Its size is said in at most one way; without any, it is 36 mm wide."""

    alternatives: ClassVar[tuple[base.Alternatives, ...]] = (
        base.Alternatives(("format", "size_mm", "width_mm", "diagonal_mm", "pixel_pitch_um"), required=False),
    )

    resolution: Annotated[tuple[Pixels, Pixels], BeforeValidator(list_of(2, _PAIR))] = (640, 360)
    """Width and height of the whole film [pixels]; fewer than 2^31 pixels together."""

    format: _FormatName | None = None
    """Film or sensor format by name; the largest picture in it, of square pixels, upright where the resolution is."""

    size_mm: Annotated[tuple[Millimetres, Millimetres], BeforeValidator(list_of(2, _PAIR))] | None = None
    """Width and height [mm]."""

    width_mm: Millimetres | None = None
    """Width [mm]; pixels are square."""

    diagonal_mm: Millimetres | None = None
    """Diagonal [mm]; pixels are square."""

    pixel_pitch_um: Annotated[float, Field(ge=1e-3, le=1e9), NUMBER] | None = None
    """Distance between the centres of neighbouring pixels [µm], which are square."""

    crop: Annotated[Rectangle, BeforeValidator(list_of(4, _CROP))] | None = None
    """Part to render, [x0, x1, y0, y1] as fractions of the film from its left and top edges; the whole by default."""

    filter: FilmFilter = FilmFilter()
    """How much light beside a pixel's centre counts."""

    transparent: bool = Field(default=False, strict=True)
    """Whether the picture has no background: the camera sees no surroundings, and files have the coverage as alpha."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        width, height = self.resolution
        if width * height > _MAX_PIXELS:
            raise base.refuse(
                f"{width} x {height} pixels would need a film of {width * height * 16 / 1e9:.3g} GB",
                got=[width, height],
                allowed="fewer than 2^31 pixels",
                path=("resolution",),
            )
        return self

    def size_m(self) -> tuple[float, float]:
        """Return width and height of the whole film [m]."""
        width, height = self.resolution
        if self.size_mm is not None:
            return (self.size_mm[0] * 1e-3, self.size_mm[1] * 1e-3)
        if self.format is not None:
            across_mm, down_mm = _size_in_format(self.format, self.resolution)
            return (across_mm * 1e-3, down_mm * 1e-3)
        if self.pixel_pitch_um is not None:
            return (width * self.pixel_pitch_um * 1e-6, height * self.pixel_pitch_um * 1e-6)
        if self.diagonal_mm is not None:
            pixel = self.diagonal_mm * 1e-3 / math.hypot(width, height)
            return (width * pixel, height * pixel)
        across = (self.width_mm or _DEFAULT_WIDTH_MM) * 1e-3
        return (across, across * height / width)

    def whole_in(self, resolution: tuple[int, int]) -> dict[str, Any]:
        """Return the keys that make it a film of the same size in other pixels, without a crop, for `change_scene`."""
        unset = dict.fromkeys((*self.alternatives[0].keys, "crop"))
        across, down = self.size_m()
        return unset | {"resolution": resolution, "size_mm": (across * 1e3, down * 1e3)}

    def diagonal_m(self) -> float:
        """Return the diagonal of the whole film [m]."""
        return math.hypot(*self.size_m())


#
# The sensor: what turns light on the film into numbers. Names and symbols as in EMVA standard 1288.
#
# kac-12040 ON Semiconductor KAC-12040/D, rev. 5 (March 2016), table 1: rolling shutter, efficiencies at 620, 540 and
# 470 nm. imx477 Sony IMX477 of the Raspberry Pi High Quality Camera at its base gain, measured by J. Hogan (Pi HQ Cam
# Sensor Performance, strollswithmydog.com). The quantum efficiency is not among the figures. kaf-3200me Kodak
# KAF-3200ME in a QSI 532 camera, measured by C. Buil (Parameters of CCD and CMOS cameras,
# astrosurf.com/buil/cameras): efficiency at 656.3 nm, dark signal at 0 degrees Celsius, 1.413 electrons per DN.

PRESETS: dict[str, dict[str, Any]] = {
    "kac-12040": {
        "pixel_pitch_um": 4.7,
        "quantum_efficiency": [0.45, 0.47, 0.40],
        "full_well_e": 16000,
        "read_noise_e": 3.7,
        "bit_depth": 10,
    },
    "imx477": {
        "pixel_pitch_um": 1.55,
        "full_well_e": 8180,
        "read_noise_e": 3.0,
        "system_gain_dn_per_e": 0.47,
        "black_level_dn": 256,
        "bit_depth": 12,
    },
    "kaf-3200me": {
        "pixel_pitch_um": 6.8,
        "bayer": "monochrome",
        "quantum_efficiency": 0.79,
        "full_well_e": 70000,
        "read_noise_e": 12.6,
        "dark_current_e_per_s": 0.080,
        "dark_current_celsius": 0,
        "system_gain_dn_per_e": 1 / 1.413,
        "bit_depth": 16,
    },
}

_MOST_BITS = 16
_ABSOLUTE_ZERO = -273.15
_MOST_DOUBLINGS = 100.0  # any well is full long before

PresetName = Literal["kac-12040", "imx477", "kaf-3200me"]
ResponseName = Literal["nikon_d5100", "canon_eos_5d_mark_ii", "sigma_sd_merrill"]
Bayer = Literal["RGGB", "BGGR", "GRBG", "GBRG", "none", "monochrome"]

_EFFICIENCY = {"type": "number", "exclusiveMinimum": 0, "maximum": 1}


def _read_efficiency(value: Any) -> tuple[float, float, float]:
    """Return the quantum efficiencies of red, green and blue from one number or three."""
    items = list(value) if isinstance(value, (list, tuple)) else [value] * 3
    if len(items) != 3:
        raise base.refuse(f"has {len(items)} numbers instead of 1 or 3", allowed="a number, or [red, green, blue]")
    several = isinstance(value, (list, tuple))
    red, green, blue = (base.number_at(x, (i,)) if several else base.read_number(x) for i, x in enumerate(items))
    for index, number in enumerate((red, green, blue)):
        if not 0 < number <= 1:
            raise base.refuse(
                "is out of range", got=number, allowed="above 0, at most 1", path=(index,) if several else ()
            )
    return (red, green, blue)


Efficiency = Annotated[
    tuple[float, float, float],
    BeforeValidator(_read_efficiency),
    WithJsonSchema({"anyOf": [_EFFICIENCY, {"type": "array", "items": _EFFICIENCY, "minItems": 3, "maxItems": 3}]}),
]
Electrons = Annotated[float, Field(ge=0, le=1e9), NUMBER]
Celsius = Annotated[float, Field(ge=_ABSOLUTE_ZERO, le=1000), NUMBER]
Seed = Annotated[int, Field(ge=0, le=MAX_SEED), WHOLE_NUMBER]


class Sensor(base.SceneModel):
    """The sensor. `preset` gives the keys that it knows other defaults."""

    preset: PresetName | None = None
    """A sensor by name, whose published figures take the place of the defaults."""

    quantum_efficiency: Efficiency = (0.5, 0.5, 0.5)
    """Electrons per photon: a number, or one for red, green and blue; with `response`, where its curves are highest."""

    response: ResponseName | None = None
    """Response curves of a camera by name; without them each channel sees its own colour alone."""

    pixel_pitch_um: Annotated[float, Field(ge=1e-3, le=1e6), NUMBER] | None = None
    """Side of the square on which a pixel gathers light [µm]; by default as far as the film's pixels reach."""

    full_well_e: Annotated[float, Field(ge=1, le=1e12), NUMBER] | None = None
    """Saturation capacity [electrons]; by default 2000 per µm² of a pixel."""

    read_noise_e: Electrons = 3.0
    """Temporal dark noise without dark current, as a standard deviation [electrons]."""

    dark_current_e_per_s: Electrons = 0.0
    """Dark current of a pixel [electrons/s]."""

    dark_current_celsius: Celsius = 25.0
    """Temperature for which the dark current is given [degrees Celsius]."""

    dark_doubling_kelvin: Annotated[float, Field(ge=0.1, le=1000), NUMBER] = 8.9
    """Rise in temperature that doubles the dark current [K]."""

    temperature_celsius: Celsius | None = None
    """Temperature of the sensor [degrees Celsius]; by default that for which the dark current is given."""

    system_gain_dn_per_e: Annotated[float, Field(ge=1e-9, le=1e9), NUMBER] | None = None
    """Overall system gain K [DN/electron]; by default from the ISO speed, or such that a full well gives the top DN."""

    bit_depth: Annotated[int, Field(ge=1, le=_MOST_BITS), WHOLE_NUMBER] = 14
    """Bits of the converter; numbers go from 0 to 2^bits - 1."""

    black_level_dn: Annotated[float, Field(ge=0, le=2**_MOST_BITS - 1), NUMBER] | None = None
    """Number that no light gives [DN]; by default a 32nd of the range."""

    prnu: Annotated[float, Field(ge=0, le=1), NUMBER] = 0.0
    """Photo response non-uniformity: standard deviation of the sensitivity from pixel to pixel, as a share."""

    dsnu_e: Electrons = 0.0
    """Dark signal non-uniformity: standard deviation of the dark signal from pixel to pixel [electrons]."""

    bayer: Bayer = "RGGB"
    """Colours of the upper left 2 x 2 pixels by rows; `none`: three values a pixel, `monochrome`: one of all light."""

    demosaic: Literal["malvar", "bilinear"] = "malvar"
    """How the missing colours of a Bayer mosaic are found for pictures."""

    seed: Seed | None = None
    """Seed of the noise, together with `shutter.open_s`; by default that of the render."""

    pattern_seed: Seed = 0
    """Seed of the fixed pattern, `prnu` and `dsnu_e`: which specimen of the sensor it is."""

    @model_validator(mode="before")
    @classmethod
    def _start_from_preset(cls, data: Any) -> Any:
        preset = PRESETS.get(str(data.get("preset"))) if isinstance(data, dict) else None
        return data if preset is None else preset | data

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.bayer == "monochrome" and self.response is not None:
            raise base.refuse(
                "has colour filters, which a monochrome sensor has not",
                got=self.response,
                allowed="no response beside bayer: monochrome",
                path=("response",),
            )
        if self.black_dn >= 2**self.bit_depth - 1:
            raise base.refuse(
                "leaves no numbers for light",
                got=self.black_dn,
                allowed=f"less than {2**self.bit_depth - 1}, the top of {self.bit_depth} bits",
                path=("black_level_dn",),
            )
        return self

    @property
    def black_dn(self) -> float:
        """Number that no light gives [DN]."""
        return 2**self.bit_depth / 32 if self.black_level_dn is None else self.black_level_dn

    def dark_current(self) -> float:
        """Return the dark current of a pixel at the temperature of the sensor [electrons/s]; EMVA 1288."""
        if self.temperature_celsius is None:
            return self.dark_current_e_per_s
        doublings = (self.temperature_celsius - self.dark_current_celsius) / self.dark_doubling_kelvin
        return float(self.dark_current_e_per_s * 2.0 ** min(doublings, _MOST_DOUBLINGS))


# How the film becomes the picture that a screen shows: white balance, exposure, tone curve.

Light = Literal["auto", IlluminantName]
_Adaptation = Literal["channels", "bradford"]
Tone = Literal["srgb", "linear", "reinhard", "aces", "agx"]
Gamut = Literal["clip", "desaturate"]
LIGHTS: tuple[str, ...] = get_args(Light)
COOLEST, HOTTEST = 1800.0, 40000.0  # [K]
_TINTS_PER_UV = 3000.0  # as photographers' programs count tint; that of D65 is 10
_LEAST_BLUE = 0.06  # least Z of a light with Y = 1; below, an adaptation to white has no sense

Factor = Annotated[float, Field(ge=0.001, le=1000), NUMBER]
Name = Annotated[str, Field(min_length=1, max_length=200)]


def _grey(value: Any) -> tuple[float, ...]:
    """Return a point [x, y] or a rectangle [x0, x1, y0, y1] in fractions of the film."""
    forms = "[x, y] or [x0, x1, y0, y1] with x0 < x1 and y0 < y1, each from 0 to 1"
    if not isinstance(value, (list, tuple)) or len(value) not in (2, 4):
        raise base.refuse("must be a place of the film", allowed=forms)
    place = tuple(base.number_at(item, (index,)) for index, item in enumerate(value))
    if not all(0 <= item <= 1 for item in place):
        raise base.refuse("lies outside the film", allowed=forms)
    if len(place) == 4 and not (place[0] < place[1] and place[2] < place[3]):
        raise base.refuse("has no area", allowed=forms)
    return place


_SHARE = {"type": "number", "minimum": 0, "maximum": 1}
_GREY_SCHEMA = {"anyOf": [{"type": "array", "items": _SHARE, "minItems": n, "maxItems": n} for n in (2, 4)]}


class WhiteBalance(base.SceneModel):
    """What light is made grey. One of `light`, `temperature_k`, `grey` and `gains`; a word stands for `light`."""

    alternatives: ClassVar[tuple[base.Alternatives, ...]] = (
        base.Alternatives(("light", "temperature_k", "grey", "gains"), required=True),
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

    adaptation: _Adaptation | None = None
    """What is scaled: the channels, or the responses of the Bradford transform; by default what suits the film."""

    @model_validator(mode="after")
    def _check_tint(self) -> Self:
        if self.adaptation is not None and self.gains is not None:
            raise base.refuse(
                "has no use beside gains", got=self.adaptation, allowed="one of both", path=("adaptation",)
            )
        if self.tint is None:
            return self
        if self.temperature_k is None:
            raise base.refuse("needs temperature_k", got=self.tint, allowed="a temperature beside it", path=("tint",))
        if _xyz_of_temperature(self.temperature_k, self.tint)[2] < _LEAST_BLUE:
            raise base.refuse("is greener than light can be at this temperature", got=self.tint, path=("tint",))
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
    u, v = here + tint / _TINTS_PER_UV * np.array([along[1], -along[0]])
    return np.array([1.5 * u / v, 1.0, (2.0 - 0.5 * u) / v - 5.0])


def _uv(kelvin: float) -> NDArray[np.float64]:
    x, y, z = xyz_from_spectrum(blackbody(kelvin))
    return np.asarray(np.array([4 * x, 6 * y]) / (x + 15 * y + 3 * z))


TONES: tuple[str, ...] = get_args(Tone)
NO_BALANCE = "none"
_DEFAULT_TONE_WHITE = 4.0


class ToneCurve(base.SceneModel):
    """How light without an upper limit fits into what a screen can show; a word stands for `kind`."""

    kind: Tone = "srgb"
    """The curve; `linear` is the only one whose values are not encoded as sRGB."""

    white: Annotated[float, Field(ge=0.01, le=1e6), NUMBER] | None = None
    """With `reinhard`: luminance that becomes white, 4 by default."""

    @model_validator(mode="after")
    def _check_white(self) -> Self:
        if self.white is not None and self.kind != "reinhard":
            raise base.refuse(
                f"is fixed for {self.kind}", got=self.white, allowed="only with kind: reinhard", path=("white",)
            )
        return self

    @property
    def shown_white(self) -> float:
        """Luminance that `reinhard` shows as white."""
        return _DEFAULT_TONE_WHITE if self.white is None else self.white


def _refusal(problem: Exception, got: object, key: str) -> PydanticCustomError:
    """Return the error of a key whose file, or what it names, is not as it should be."""
    *head, text = re.split(r"^(display|view|look): ", str(problem), maxsplit=1)
    return base.refuse(text, got=got, path=(head[1] if head else key,))


class ColourView(base.SceneModel):
    """A view of an OpenColorIO config, which takes the place of tone curve, gamut and encoding."""

    config: base.FileName = "ocio://default"
    """A built-in config of OpenColorIO, or a file `.ocio` in the scene's folder, with its own files below it."""

    display: Name | None = None
    """Display of the config; by default its first."""

    view: Name | None = None
    """View of the display; by default its first."""

    look: Name | None = None
    """Looks of the config, in place of those that the view has, as `+warm, -contrast`."""

    _loaded: DisplayView | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _load(self, info: ValidationInfo) -> Self:
        context = info.context or {}
        before = context.get("before")
        if before is not None and before.ocio is not None and dict(before.ocio) == dict(self):
            self._loaded = before.ocio._loaded
            return self
        from rptcam_cl.scene.assets.grading import load_view

        folders = context.get("folders") or Folders()
        try:
            self._loaded = load_view(self.config, self.display, self.view, self.look, folders)
        except (InputError, StateError) as problem:
            raise _refusal(problem, self.config, "config") from None
        return self

    @property
    def loaded(self) -> DisplayView:
        """The view as it was found with the scene."""
        assert self._loaded is not None, "as `_load` leaves it"
        return self._loaded


class PictureSettings(base.SceneModel):
    """How the film becomes the picture: white balance, exposure, tone curve, gamut and encoding, in this order.

    A view of OpenColorIO takes the place of tone curve, gamut and encoding. A table of colours comes last.
    """

    alternatives: ClassVar[tuple[base.Alternatives, ...]] = (
        base.Alternatives(("tone", "ocio"), required=False),
        base.Alternatives(("gamut", "ocio"), required=False),
    )

    ev: Annotated[float, Field(ge=-60, le=60), NUMBER] = 0.0
    """Exposure compensation [stops]; +1 doubles the brightness."""

    white_balance: Annotated[
        WhiteBalance | None,
        base.word_for("light", (NO_BALANCE, *LIGHTS), nothing=NO_BALANCE),
        base.AlsoAccepts({"enum": [NO_BALANCE, *LIGHTS]}),
    ] = None
    """What light is made grey; `none` leaves colours as they are, white being D65."""

    tone: Annotated[ToneCurve, base.word_for("kind", TONES), base.AlsoAccepts({"enum": list(TONES)})] = ToneCurve()
    """How light without an upper limit fits into what a screen can show."""

    gamut: Gamut = "clip"
    """What becomes of colours that sRGB cannot show: each channel is clipped, or all move towards their grey."""

    ocio: Annotated[
        ColourView | None,
        BeforeValidator(lambda value: {"config": value} if isinstance(value, str) else value),
        base.AlsoAccepts({"type": "string"}),
    ] = None
    """A view of OpenColorIO in place of `tone` and `gamut`; a word stands for `config`."""

    lut: base.FileName | None = None
    """Table of colours in the scene's folder, `.cube`, applied last, to display values."""

    bits: Literal[8, 16] | None = None
    """Bits per channel of PNG and TIFF files; by default 8 in PNG and 16 in TIFF."""

    primaries: Primaries = "rec709"
    """Primaries of the linear colours in EXR files; those of NumPy files are always of Rec. 709."""

    jpeg_quality: Annotated[int, Field(ge=1, le=100, strict=True)] = 95
    """Quality of JPEG files; colour is in half the resolution below 90."""

    _table: ColourTable | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _load(self, info: ValidationInfo) -> Self:
        if self.lut is None:
            return self
        if self.tone.kind == "linear":
            raise base.refuse(
                "is for display values, which tone: linear has not", got=self.lut, allowed="another tone", path=("lut",)
            )
        context = info.context or {}
        before = context.get("before")
        if before is not None and before.lut == self.lut:
            self._table = before.table
            return self
        from rptcam_cl.scene.assets.grading import load_table

        try:
            self._table = load_table(self.lut, context.get("folders") or Folders())
        except (InputError, StateError) as problem:
            raise _refusal(problem, self.lut, "lut") from None
        return self

    @property
    def table(self) -> ColourTable | None:
        """The table of colours of `lut`, as it was when the settings were read."""
        return self._table

    @property
    def is_encoded(self) -> bool | None:
        """Whether the picture is encoded as sRGB, or linear; None for another display of OpenColorIO."""
        if self.ocio is not None:
            return self.ocio.loaded.is_srgb or None
        return self.tone.kind != "linear"

    def content_digests(self) -> list[str]:
        """Return the SHA-256 of what `ocio` and `lut` were read from; nothing without them."""
        read = [] if self.ocio is None else [self.ocio.loaded.digest]
        return read if self.table is None else [*read, self.table.digest]

    def check_crop(self, crop: tuple[float, float, float, float] | None) -> None:
        """Refuse a grey place that is not wholly in the part of the film that is rendered."""
        place = None if self.white_balance is None else self.white_balance.grey
        if place is None or crop is None:
            return
        across, down = place[: len(place) // 2], place[len(place) // 2 :]
        if not (crop[0] <= min(across) <= max(across) <= crop[1] and crop[2] <= min(down) <= max(down) <= crop[3]):
            raise base.refuse(
                "lies outside the part of the film that is rendered",
                got=list(place),
                allowed=f"a place in film.crop, {list(crop)}",
                path=("picture", "white_balance", "grey"),
            )
