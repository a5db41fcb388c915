"""The sensor: what turns light on the film into numbers. Names and symbols as in EMVA standard 1288.

kac-12040
    ON Semiconductor KAC-12040/D, rev. 5 (March 2016), table 1: rolling shutter, efficiencies at 620, 540 and 470 nm.
imx477
    Sony IMX477 of the Raspberry Pi High Quality Camera at its base gain, measured by J. Hogan (Pi HQ Cam Sensor
    Performance, strollswithmydog.com). The quantum efficiency is not among the figures.
kaf-3200me
    Kodak KAF-3200ME in a QSI 532 camera, measured by C. Buil (Parameters of CCD and CMOS cameras,
    astrosurf.com/buil/cameras): efficiency at 656.3 nm, dark signal at 0 degrees Celsius, 1.413 electrons per DN.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from rptcam_cl.scene.base import SceneModel, number_at, read_number, refuse
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER
from rptcam_cl.scene.render_settings import MAX_SEED

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

MOST_BITS = 16
ABSOLUTE_ZERO = -273.15
MOST_DOUBLINGS = 100.0  # any well is full long before

PresetName = Literal["kac-12040", "imx477", "kaf-3200me"]
ResponseName = Literal["nikon_d5100", "canon_eos_5d_mark_ii", "sigma_sd_merrill"]
Bayer = Literal["RGGB", "BGGR", "GRBG", "GBRG", "none", "monochrome"]

_EFFICIENCY = {"type": "number", "exclusiveMinimum": 0, "maximum": 1}


def _read_efficiency(value: Any) -> tuple[float, float, float]:
    """Return the quantum efficiencies of red, green and blue from one number or three."""
    items = list(value) if isinstance(value, (list, tuple)) else [value] * 3
    if len(items) != 3:
        raise refuse(f"has {len(items)} numbers instead of 1 or 3", allowed="a number, or [red, green, blue]")
    several = isinstance(value, (list, tuple))
    red, green, blue = (number_at(x, (i,)) if several else read_number(x) for i, x in enumerate(items))
    for index, number in enumerate((red, green, blue)):
        if not 0 < number <= 1:
            raise refuse("is out of range", got=number, allowed="above 0, at most 1", path=(index,) if several else ())
    return (red, green, blue)


Efficiency = Annotated[
    tuple[float, float, float],
    BeforeValidator(_read_efficiency),
    WithJsonSchema({"anyOf": [_EFFICIENCY, {"type": "array", "items": _EFFICIENCY, "minItems": 3, "maxItems": 3}]}),
]
Electrons = Annotated[float, Field(ge=0, le=1e9), NUMBER]
Celsius = Annotated[float, Field(ge=ABSOLUTE_ZERO, le=1000), NUMBER]
Seed = Annotated[int, Field(ge=0, le=MAX_SEED), WHOLE_NUMBER]


class Sensor(SceneModel):
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

    bit_depth: Annotated[int, Field(ge=1, le=MOST_BITS), WHOLE_NUMBER] = 14
    """Bits of the converter; numbers go from 0 to 2^bits - 1."""

    black_level_dn: Annotated[float, Field(ge=0, le=2**MOST_BITS - 1), NUMBER] | None = None
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
            raise refuse(
                "has colour filters, which a monochrome sensor has not",
                got=self.response,
                allowed="no response beside bayer: monochrome",
                path=("response",),
            )
        if self.black_dn >= 2**self.bit_depth - 1:
            raise refuse(
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
        return float(self.dark_current_e_per_s * 2.0 ** min(doublings, MOST_DOUBLINGS))
