"""Textures: colours and numbers that change over the surface coordinates (u, v)."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, Tag

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.file_reference import GREY, FileReference
from rptcam_cl.scene.quantities import (
    NUMBER,
    WHOLE_NUMBER,
    Albedo,
    Colour,
    Fraction,
    GainColour,
    PatternAlbedo,
    Radiance,
    TexturePair,
    Turn,
)
from rptcam_cl.scene.spectrum_forms import LightSpectrum

CONSTANT = "constant colour"
SPECTRUM_KEYS = LightSpectrum.model_fields.keys() - {"scale"}  # textures have a scale, too


class Pattern(SceneModel):
    """What every texture has: where on the pattern a surface point lies."""

    scale: TexturePair = (1.0, 1.0)
    """Repeats of the pattern per unit of u and of v."""

    rotation_degrees: Turn = 0.0
    """Turn of the scaled coordinates about (0, 0), from u towards v [degrees]."""

    offset: TexturePair = (0.0, 0.0)
    """Shift of the scaled and turned coordinates [repeats]."""


class Blend(Pattern):
    """A pattern that is somewhere between two colours at every point."""

    @property
    def colours(self) -> tuple[Colour, Colour]:
        """The two colours."""
        raise NotImplementedError

    @property
    def share(self) -> float:
        """Share of the second colour in the mean over one repeat."""
        return 0.5

    @property
    def parameter(self) -> float:
        """The number of its own that the kernels read."""
        return 0.0


class Checker(Blend):
    """A chessboard: a cell is even or odd as the sum of its whole coordinates is."""

    kind: Literal["checker"]
    """Kind of texture."""

    even: PatternAlbedo
    """Colour of even cells; channels 0 to 1."""

    odd: PatternAlbedo
    """Colour of odd cells; channels 0 to 1."""

    @property
    def colours(self) -> tuple[Colour, Colour]:
        """Those of even and of odd cells."""
        return self.even, self.odd


class Grid(Blend):
    """Lines on a background: where the fraction of either coordinate is below `line_width`."""

    kind: Literal["grid"]
    """Kind of texture."""

    background: PatternAlbedo
    """Colour between the lines; channels 0 to 1."""

    line: PatternAlbedo
    """Colour of the lines; channels 0 to 1."""

    line_width: Fraction
    """Width of a line as a fraction of the cell."""

    @property
    def colours(self) -> tuple[Colour, Colour]:
        """Those of background and line."""
        return self.background, self.line

    @property
    def share(self) -> float:
        """Share of the lines."""
        return 1 - (1 - self.line_width) ** 2

    @property
    def parameter(self) -> float:
        """Width of a line."""
        return self.line_width


class Gradient(Blend):
    """A colour that changes evenly with the first coordinate, from 0 to 1, and stays beyond."""

    kind: Literal["gradient"]
    """Kind of texture."""

    start: PatternAlbedo
    """Colour at 0; channels 0 to 1."""

    end: PatternAlbedo
    """Colour at 1; channels 0 to 1."""

    @property
    def colours(self) -> tuple[Colour, Colour]:
        """Those at 0 and at 1."""
        return self.start, self.end


class Noise(Blend):
    """Random mottling without a repeat: gradient noise summed over octaves, each twice as fine."""

    kind: Literal["noise"]
    """Kind of texture."""

    low: PatternAlbedo
    """Colour where the noise is lowest; channels 0 to 1."""

    high: PatternAlbedo
    """Colour where the noise is highest; channels 0 to 1."""

    octaves: Annotated[int, Field(ge=1, le=12), WHOLE_NUMBER] = 4
    """Number of octaves; the first has features about one repeat across."""

    gain: Fraction = 0.5
    """Amplitude of an octave relative to the one before it."""

    contrast: Annotated[float, Field(gt=0, le=100), NUMBER] = 1.0
    """Stretch of the noise about its middle; what leaves `low` or `high` is cut."""

    seed: Annotated[int, Field(ge=0, le=2**31 - 1), WHOLE_NUMBER] = 0
    """Which of the patterns."""

    @property
    def colours(self) -> tuple[Colour, Colour]:
        """Those where the noise is lowest and highest."""
        return self.low, self.high

    @property
    def parameter(self) -> float:
        """Gain of an octave."""
        return self.gain


class ImageTexture(FileReference, Pattern):
    """A picture; its lower left corner is (0, 0) and its upper right corner (1, 1)."""

    stand_in: ClassVar[bytes | None] = GREY

    kind: Literal["image"]
    """Kind of texture."""

    color_space: Literal["auto", "srgb", "linear"] = "auto"
    """How colours are stored; auto: sRGB for pictures of 8 and 16 bits read as rgb, linear for all else."""

    filter: Literal["bilinear", "nearest"] = "bilinear"
    """What is seen between the centres of texels."""

    wrap: Literal["repeat", "clamp", "mirror"] = "repeat"
    """What continues the picture beyond its edges."""

    channel: Literal["rgb", "r", "g", "b", "a"] = "rgb"
    """Which channels are read; a single one gives a grey, a is the alpha channel."""

    gain: GainColour = (1.0, 1.0, 1.0)
    """Factor on the linear values: a number, or [red, green, blue]."""


Texture = Checker | Grid | Gradient | Noise | ImageTexture


def _form(value: Any) -> str | None:
    """Return which form a textured parameter has: a constant (also as a spectrum), or the kind of texture."""
    if isinstance(value, dict):
        if "kind" not in value and not SPECTRUM_KEYS.isdisjoint(value):
            return CONSTANT
        kind = value.get("kind")
        return kind if isinstance(kind, str) else None
    return str(getattr(value, "kind", CONSTANT))


_Textured = (
    Annotated[Checker, Tag("checker")]
    | Annotated[Grid, Tag("grid")]
    | Annotated[Gradient, Tag("gradient")]
    | Annotated[Noise, Tag("noise")]
    | Annotated[ImageTexture, Tag("image")]
)
Reflectance = Annotated[Annotated[Albedo, Tag(CONSTANT)] | _Textured, Discriminator(_form)]
Share = Annotated[Annotated[Fraction, Tag(CONSTANT)] | _Textured, Discriminator(_form)]
Emission = Annotated[Annotated[Radiance, Tag(CONSTANT)] | _Textured, Discriminator(_form)]
