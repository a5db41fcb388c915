"""The film: what records the picture, its resolution, its size or format, and its filter.

Film frames: ISO 1007 (135), ISO 732 (120), SMPTE ST 59 (35 mm cine), SMPTE ST 201 (super 16), 15/70 camera aperture
(imax); sheets at their nominal size. Four Thirds: the system's standard. No standard fixes the size of other sensors,
which are named after tubes or film; theirs are those that makers publish, of the camera named where these differ.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from rptcam_cl.scene.base import AlsoAccepts, Alternatives, SceneModel, refuse
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER, Fraction, list_of

DEFAULT_RADIUS_PX = {"box": 0.5, "tent": 1.0, "gaussian": 1.5, "blackman_harris": 1.5, "mitchell": 2.0}


class FilmFilter(SceneModel):
    """The film's reconstruction filter: how much light beside a pixel's centre counts, along x times along y."""

    kind: Literal["box", "tent", "gaussian", "blackman_harris", "mitchell"] = "box"
    """Its shape; `mitchell` sharpens, with negative lobes."""

    radius_px: Annotated[float, Field(ge=0.01, le=16), NUMBER] | None = None
    """Distance from the pixel's centre at which it ends [pixels]; by default what suits its kind."""

    @property
    def radius(self) -> float:
        """Distance from the pixel's centre at which it ends [pixels]."""
        return DEFAULT_RADIUS_PX[self.kind] if self.radius_px is None else self.radius_px


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


FormatName = Annotated[_Name, BeforeValidator(_as_text), AlsoAccepts({"const": 645})]


def size_in_format(name: str, resolution: tuple[int, int]) -> tuple[float, float]:
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


DEFAULT_WIDTH_MM = 36.0
MAX_PIXELS = 2**31 - 1
PAIR = "a pair [width, height]"
CROP = "[x0, x1, y0, y1]"

Pixels = Annotated[int, Field(ge=1, le=MAX_PIXELS), WHOLE_NUMBER]
Millimetres = Annotated[float, Field(ge=1e-6, le=1e9), NUMBER]


class Film(SceneModel):
    """The film. Its size is said in at most one way; without any, it is 36 mm wide."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("format", "size_mm", "width_mm", "diagonal_mm", "pixel_pitch_um"), required=False),
    )

    resolution: Annotated[tuple[Pixels, Pixels], BeforeValidator(list_of(2, PAIR))] = (640, 360)
    """Width and height of the whole film [pixels]; fewer than 2^31 pixels together."""

    format: FormatName | None = None
    """Film or sensor format by name; the largest picture in it, of square pixels, upright where the resolution is."""

    size_mm: Annotated[tuple[Millimetres, Millimetres], BeforeValidator(list_of(2, PAIR))] | None = None
    """Width and height [mm]."""

    width_mm: Millimetres | None = None
    """Width [mm]; pixels are square."""

    diagonal_mm: Millimetres | None = None
    """Diagonal [mm]; pixels are square."""

    pixel_pitch_um: Annotated[float, Field(ge=1e-3, le=1e9), NUMBER] | None = None
    """Distance between the centres of neighbouring pixels [µm], which are square."""

    crop: Annotated[tuple[Fraction, Fraction, Fraction, Fraction], BeforeValidator(list_of(4, CROP))] | None = None
    """Part to render, [x0, x1, y0, y1] as fractions of the film from its left and top edges; the whole by default."""

    filter: FilmFilter = FilmFilter()
    """How much light beside a pixel's centre counts."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        width, height = self.resolution
        if width * height > MAX_PIXELS:
            raise refuse(
                f"{width} x {height} pixels would need a film of {width * height * 16 / 1e9:.3g} GB",
                got=[width, height],
                allowed="fewer than 2^31 pixels",
                path=("resolution",),
            )
        if self.crop is not None and not (self.crop[0] < self.crop[1] and self.crop[2] < self.crop[3]):
            raise refuse(
                "has no area", got=list(self.crop), allowed="0 <= x0 < x1 <= 1 and 0 <= y0 < y1 <= 1", path=("crop",)
            )
        return self

    def size_m(self) -> tuple[float, float]:
        """Return width and height of the whole film [m]."""
        width, height = self.resolution
        if self.size_mm is not None:
            return (self.size_mm[0] * 1e-3, self.size_mm[1] * 1e-3)
        if self.format is not None:
            across_mm, down_mm = size_in_format(self.format, self.resolution)
            return (across_mm * 1e-3, down_mm * 1e-3)
        if self.pixel_pitch_um is not None:
            return (width * self.pixel_pitch_um * 1e-6, height * self.pixel_pitch_um * 1e-6)
        if self.diagonal_mm is not None:
            pixel = self.diagonal_mm * 1e-3 / math.hypot(width, height)
            return (width * pixel, height * pixel)
        across = (self.width_mm or DEFAULT_WIDTH_MM) * 1e-3
        return (across, across * height / width)

    def whole_in(self, resolution: tuple[int, int]) -> dict[str, Any]:
        """Return the keys that make it a film of the same size in other pixels, without a crop, for `change_scene`."""
        unset = dict.fromkeys((*self.alternatives[0].keys, "crop"))
        across, down = self.size_m()
        return unset | {"resolution": resolution, "size_mm": (across * 1e3, down * 1e3)}

    def diagonal_m(self) -> float:
        """Return the diagonal of the whole film [m]."""
        return math.hypot(*self.size_m())
