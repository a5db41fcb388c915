"""Textures: colours, numbers, normals and heights that change over a surface."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from rptcam_cl.scene import quantities
from rptcam_cl.scene.base import GREY, FileReference, SceneModel, one_pixel, refuse

# Textures: colours and numbers that change over the surface coordinates (u, v).

CONSTANT = "constant colour"
_SPECTRUM_KEYS = quantities.LightSpectrum.model_fields.keys() - {"scale"}  # textures have a scale, too


class Mapping(SceneModel):
    """Coordinates that follow from where in the scene a point of a surface lies, in place of its own u and v."""

    kind: Literal["space", "spherical", "cylindrical", "round"] = "space"
    """What the coordinates are: x, y and z; angles about z, from +z and round it; round it and along it; or round it
    and the cosine of that from +z."""

    matrix: quantities.AffineRows = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    """Rows of the matrix that takes the scene to the frame of the texture, 3x4, or 4x4 with [0, 0, 0, 1]."""


class Pattern(SceneModel):
    """What every texture has: where on the pattern a surface point lies."""

    mapping: Mapping | None = None
    """Coordinates by the place in the scene; without it u and v of the shape."""

    scale: quantities.TexturePair = (1.0, 1.0)
    """Repeats of the pattern per unit of u and of v."""

    rotation_degrees: quantities.Turn = 0.0
    """Turn of the scaled coordinates about (0, 0), from u towards v [degrees]."""

    offset: quantities.TexturePair = (0.0, 0.0)
    """Shift of the scaled and turned coordinates [repeats]."""


class Blend(Pattern):
    """A pattern that is somewhere between two colours at every point."""

    ends: ClassVar[tuple[str, str]]
    """The keys of the two colours."""

    number: ClassVar[str] = ""
    """The key of the number of its own that the kernels read, if there is one."""

    @property
    def colours(self) -> tuple[quantities.Colour, quantities.Colour]:
        """The two colours."""
        first, second = (getattr(self, key) for key in self.ends)
        return first, second

    @property
    def share(self) -> float:
        """Share of the second colour in the mean over one repeat."""
        return 0.5

    @property
    def parameter(self) -> float:
        """The number of its own that the kernels read."""
        return float(getattr(self, self.number)) if self.number else 0.0


class Checker(Blend):
    """A chessboard: a cell is even or odd as the sum of its whole coordinates is."""

    ends = ("even", "odd")

    kind: Literal["checker"]
    """Kind of texture."""

    even: quantities.PatternColour
    """Colour of even cells; channels 0 to 1."""

    odd: quantities.PatternColour
    """Colour of odd cells; channels 0 to 1."""


class Grid(Blend):
    """Lines on a background: where the fraction of either coordinate is below `line_width`."""

    ends = ("background", "line")
    number = "line_width"

    kind: Literal["grid"]
    """Kind of texture."""

    background: quantities.PatternColour
    """Colour between the lines; channels 0 to 1."""

    line: quantities.PatternColour
    """Colour of the lines; channels 0 to 1."""

    line_width: quantities.Fraction
    """Width of a line as a fraction of the cell."""

    @property
    def share(self) -> float:
        """Share of the lines."""
        return 1 - (1 - self.line_width) ** 2


class Gradient(Blend):
    """A colour that changes evenly with the first coordinate, from 0 to 1, and stays beyond."""

    ends = ("start", "end")

    kind: Literal["gradient"]
    """Kind of texture."""

    start: quantities.PatternColour
    """Colour at 0; channels 0 to 1."""

    end: quantities.PatternColour
    """Colour at 1; channels 0 to 1."""


Octaves = Annotated[int, Field(ge=1, le=12), quantities.WHOLE_NUMBER]


class Noise(Blend):
    """Random mottling without a repeat: gradient noise summed over octaves, each twice as fine."""

    ends = ("low", "high")
    number = "gain"

    kind: Literal["noise"]
    """Kind of texture."""

    low: quantities.PatternColour
    """Colour where the noise is lowest; channels 0 to 1."""

    high: quantities.PatternColour
    """Colour where the noise is highest; channels 0 to 1."""

    octaves: Octaves = 4
    """Number of octaves; the first has features about one repeat across."""

    gain: quantities.Fraction = 0.5
    """Amplitude of an octave relative to the one before it."""

    contrast: Annotated[float, Field(gt=0, le=100), quantities.NUMBER] = 1.0
    """Stretch of the noise about its middle; what leaves `low` or `high` is cut."""

    seed: Annotated[int, Field(ge=0, le=2**31 - 1), quantities.WHOLE_NUMBER] = 0
    """Which of the patterns."""


class Perlin(Blend):
    """Perlin's noise of 2002 summed over octaves, as pbrt has it: in space, or over u and v."""

    ends = ("low", "high")
    number = "gain"

    kind: Literal["perlin"]
    """Kind of texture."""

    form: Literal["sum", "turbulence", "wind"] = "sum"
    """Sum of octaves (pbrt's fbm), sum of their sizes (wrinkled), or waves under gusts (windy)."""

    low: quantities.PatternColour = (0.0, 0.0, 0.0)
    """Colour where the sum is 0 or less; channels 0 to 1."""

    high: quantities.PatternColour = (1.0, 1.0, 1.0)
    """Colour where the sum is 1 or more; channels 0 to 1."""

    octaves: Octaves = 8
    """Number of octaves, each 1.99 times as fine as the one before it; wind has its own."""

    gain: quantities.Fraction = 0.5
    """Amplitude of an octave relative to the one before it."""

    @property
    def share(self) -> float:
        """Share of the second colour in the mean over space, from sums at 200,000 places, within 0.06."""
        amplitudes = sum(self.gain**octave for octave in range(self.octaves))
        turbulence = min(0.22 * amplitudes + 0.2 * self.gain**self.octaves, 1.0)
        return {"sum": 0.12, "turbulence": turbulence, "wind": 0.03}[self.form]


class Marble(Blend):
    """Veins of marble in the colours of pbrt: a sine along y, shifted by Perlin's noise."""

    number = "gain"

    kind: Literal["marble"]
    """Kind of texture."""

    octaves: Octaves = 8
    """Number of octaves of the noise."""

    gain: quantities.Fraction = 0.5
    """Amplitude of an octave relative to the one before it."""

    variation: Annotated[float, Field(ge=-1e6, le=1e6), quantities.NUMBER] = 0.2
    """How far the noise shifts the sine [radians]."""

    tint: quantities.PatternColour = (1.0, 1.0, 1.0)
    """Factor on the colours; channels 0 to 1."""

    form: Literal["pbrt-v4", "pbrt-v3"] = "pbrt-v4"
    """Which pbrt's colours: those of v3 go on beyond the second of their six pieces, up to 40; a reflectance is cut to
    1, in a mixture once it is mixed."""

    @property
    def colours(self) -> tuple[quantities.Colour, quantities.Colour]:
        """The darkest and the lightest of its veins."""
        red, green, blue = self.tint
        light = (0.9 * red, 0.885 * green, 0.9 * blue) if self.form == "pbrt-v4" else self.tint
        return (0.3 * red, 0.3 * green, 0.495 * blue), light

    @property
    def share(self) -> float:
        """Share of the light colour in the mean."""
        return {"pbrt-v4": 0.843, "pbrt-v3": 0.914}[self.form]


class Dots(Blend):
    """Spots of radius 0.35 in some of the cells, at random places, as pbrt has them."""

    ends = ("outside", "inside")

    kind: Literal["dots"]
    """Kind of texture."""

    inside: quantities.PatternColour
    """Colour of the spots; channels 0 to 1."""

    outside: quantities.PatternColour
    """Colour between them; channels 0 to 1."""

    @property
    def share(self) -> float:
        """Share of the spots, which half of the cells have."""
        return 0.5 * math.pi * 0.35**2


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

    gain: quantities.GainColour = (1.0, 1.0, 1.0)
    """Factor on the linear values: a number, or [red, green, blue]."""


def _texture_form(value: Any) -> str | None:
    """Return which form a textured parameter has: a constant (also as a spectrum), or the kind of texture."""
    if isinstance(value, dict):
        if "kind" not in value and not _SPECTRUM_KEYS.isdisjoint(value):
            return CONSTANT
        kind = value.get("kind")
        return kind if isinstance(kind, str) else None
    return str(getattr(value, "kind", CONSTANT))


_Pattern = (
    Annotated[Checker, Tag("checker")]
    | Annotated[Grid, Tag("grid")]
    | Annotated[Gradient, Tag("gradient")]
    | Annotated[Noise, Tag("noise")]
    | Annotated[Perlin, Tag("perlin")]
    | Annotated[Marble, Tag("marble")]
    | Annotated[Dots, Tag("dots")]
    | Annotated[ImageTexture, Tag("image")]
)
_Part = Annotated[
    Annotated[quantities.Albedo, Tag(CONSTANT)] | _Pattern | Annotated["Mixture", Tag("mixture")],
    Discriminator(_texture_form),
]
MOST_NESTED = 3  # mixtures in mixtures


class Mixture(SceneModel):
    """Two textures or colours, mixed by a third: channel by channel `first` (1 - `amount`) + `second` `amount`.

    With a black `first` it is a product.
    """

    kind: Literal["mixture"]
    """Kind of texture."""

    first: _Part = (0.0, 0.0, 0.0)
    """What is seen where `amount` is 0."""

    second: _Part = (1.0, 1.0, 1.0)
    """What is seen where `amount` is 1."""

    amount: _Part = (0.5, 0.5, 0.5)
    """Share of `second`, in each channel."""

    @model_validator(mode="after")
    def _check_depth(self) -> Self:
        if self.depth > MOST_NESTED:
            raise refuse("are too many mixtures in mixtures", got=self.depth, allowed=f"at most {MOST_NESTED}")
        return self

    @property
    def parts(self) -> tuple[Any, Any, Any]:
        """What is mixed, and by what."""
        return self.first, self.second, self.amount

    @property
    def mapping(self) -> Mapping | None:
        """The first of its parts' coordinates by the place in the scene, if any has such."""
        found = (part.mapping for part in self.parts if not isinstance(part, tuple))
        return next((each for each in found if each is not None), None)

    @property
    def depth(self) -> int:
        """How many mixtures stand in each other."""
        return 1 + max(part.depth if isinstance(part, Mixture) else 0 for part in self.parts)


Textured = _Pattern | Annotated[Mixture, Tag("mixture")]
Reflectance = Annotated[Annotated[quantities.Albedo, Tag(CONSTANT)] | Textured, Discriminator(_texture_form)]
Share = Annotated[Annotated[quantities.Fraction, Tag(CONSTANT)] | Textured, Discriminator(_texture_form)]
Emission = Annotated[Annotated[quantities.Radiance, Tag(CONSTANT)] | Textured, Discriminator(_texture_form)]


SinglePattern = Checker | Grid | Gradient | Noise | Perlin | Marble | Dots | ImageTexture
Texture = SinglePattern | Mixture


# Pictures of normals and of brushing, and heights.


class NormalMap(ImageTexture):
    """A picture of normals in the tangent frame, as glTF has them: red along u, green along v, blue outwards."""

    stand_in: ClassVar[bytes | None] = one_pixel(128, 128, 255)  # the surface's own normal

    kind: Literal["image"] = "image"
    """Kind of texture."""

    color_space: Literal["auto", "srgb", "linear"] = "linear"
    """How the components are stored."""

    strength: Annotated[float, Field(ge=0, le=10), quantities.NUMBER] = 1.0
    """Factor on the components along u and v."""


class AnisotropyMap(ImageTexture):
    """A picture of how a surface is brushed, as glTF has it: red along u, green along v, blue the strength."""

    stand_in: ClassVar[bytes | None] = one_pixel(255, 128, 0)  # not brushed

    kind: Literal["image"] = "image"
    """Kind of texture."""

    color_space: Literal["auto", "srgb", "linear"] = "linear"
    """How the components are stored."""

    strength: quantities.Fraction = 1.0
    """Factor on the strength."""


class Bump(SceneModel):
    """Heights by which a surface is shaded as if it were uneven; its outline stays as it is (Blinn 1978)."""

    texture: Annotated[Textured, Discriminator(_texture_form)]
    """Heights: the first channel of a texture, linear."""

    height: Annotated[
        float, Field(ge=-quantities.LARGEST_COORDINATE, le=quantities.LARGEST_COORDINATE), quantities.NUMBER
    ] = 1.0
    """How far outwards a texture of 1 lies before one of 0 [scene units]; below 0 inwards."""

    lengths: Literal["surface", "unit", "u"] = "surface"
    """What a step of 1 in u and v is on the surface: its true length, one unit of the scene, or for both that of u."""
