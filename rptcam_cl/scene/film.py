"""The film: what records the picture, its resolution and its size."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Self

from pydantic import BeforeValidator, Field, model_validator

from rptcam_cl.scene.base import Alternatives, SceneModel
from rptcam_cl.scene.film_filter import FilmFilter
from rptcam_cl.scene.film_format import FormatName, size_in_format
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER, Fraction, list_of
from rptcam_cl.scene.refusal import refuse

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
