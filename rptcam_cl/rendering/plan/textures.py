"""Textures of the scene as records, with their pictures, and the spectra that colours are known by."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable
from dataclasses import field, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.core import records as layout
from rptcam_cl.core.colour import Spectrum, linear_from_srgb, metal_optics, srgb_from_reflectance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import TEXTURE, Mapped, TexelFormat, TextureKind, Wrap, fill
from rptcam_cl.core.remember import Memory
from rptcam_cl.optics.glass import held_index, known_range
from rptcam_cl.rendering.cameras.lens_records import fewest_terms, fit_nodes
from rptcam_cl.scene.assets.measured import MeasuredTable, read_measured
from rptcam_cl.scene.assets.pictures import Picture, read_picture
from rptcam_cl.scene.base import FileReference
from rptcam_cl.scene.materials import Dielectric, Measured, MetalSpectrum
from rptcam_cl.scene.quantities import SpectralColour
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.textures import Dots, ImageTexture, Marble, Mixture, Noise, Pattern, Perlin, SinglePattern, Texture

#
# Spectra that the scene's colours are known by, constants of its metals, indices of its solids.
#
# The colour at normal incidence is the reflectance of the spectrum under daylight D65 as the CIE 1931 observer sees
# it, in linear sRGB; n and k of a channel are those that have this reflectance there and come nearest to the
# spectrum's at slant.


@dataclass
class KnownSpectra:
    """Spectra in the order of their numbers, from 1.

    Attributes
    ----------
    samples : list of arrays (401,)
        At `rptcam_cl.core.colour.WAVELENGTHS_NM`.
    lights : list of arrays (401,)
        Those of them that shine.
    colours : int
        How many times a colour of the scene was given as a spectrum.
    """

    samples: list[NDArray[np.float64]] = field(default_factory=list)
    lights: list[NDArray[np.float64]] = field(default_factory=list)
    colours: int = 0
    _numbers: dict[bytes, int] = field(default_factory=dict)

    def copy(self) -> KnownSpectra:
        """Return these to be added to."""
        return KnownSpectra(self.samples.copy(), self.lights.copy(), self.colours, self._numbers.copy())

    def number(self, value: Any, *, light: bool = False, gain: float = 1.0) -> int:
        """Return the number of a colour's spectrum, times a gain; 0 for a colour that has none."""
        if not isinstance(value, SpectralColour):
            return 0
        self.colours += 1
        samples = gain * value.samples
        if light:
            self.lights.append(samples)
        return self.add(samples)

    def add(self, samples: NDArray[np.float64]) -> int:
        """Return the number of samples."""
        key = samples.tobytes()
        if key not in self._numbers:
            self.samples.append(samples)
            self._numbers[key] = len(self.samples)
        return self._numbers[key]


_LARGEST_N = 20.0  # far above any metal's
_SLANTS = np.arange(1, 10) / 10  # cosines at which channels are compared with the spectrum


def reflectance(index: NDArray[np.complex128], cosine: ArrayLike = 1.0) -> NDArray[np.float64]:
    """Return the unpolarised Fresnel reflectance of a metal."""
    c = np.asarray(cosine, np.float64)
    inside = np.sqrt(1 - (1 - c * c) / index**2)
    s, p = (c - index * inside) / (c + index * inside), (index * c - inside) / (index * c + inside)
    return np.asarray((np.abs(s) ** 2 + np.abs(p) ** 2) / 2)


def metal_spectra(metal: str | MetalSpectrum) -> tuple[Spectrum, Spectrum]:
    """Return n and k of a metal (401,), which is a name or a table."""
    return (metal.n, metal.k) if isinstance(metal, MetalSpectrum) else metal_optics(metal)


def metal_colour(metal: str | MetalSpectrum, cosine: float = 1.0) -> NDArray[np.float64]:
    """Return the reflectance of a metal in linear sRGB, cut to 0 … 1."""
    n, k = metal_spectra(metal)
    return np.clip(srgb_from_reflectance(reflectance(n + 1j * k, cosine)), 0.0, 1.0)


@lru_cache(maxsize=64)
def metal_constants(metal: str | MetalSpectrum) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return n and k of a metal per channel."""
    colour = np.minimum(metal_colour(metal), 0.999)
    # n solves ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2) = colour, in two ways, for every k up to a largest.
    middle = (1 + colour) / (1 - colour)
    k = np.linspace(0.0, 1.0, 801)[:, None] * np.sqrt(middle**2 - 1)
    spread = np.sqrt(np.maximum(middle**2 - 1 - k**2, 0.0))
    index = np.concatenate([middle - spread + 1j * k, middle + spread + 1j * k])
    errors = [np.square(reflectance(index, cosine) - metal_colour(metal, cosine)) for cosine in _SLANTS]
    best = np.where(index.real < _LARGEST_N, np.sum(errors, axis=0), np.inf).argmin(axis=0)
    chosen = index[best, np.arange(3)]
    return tuple(map(float, chosen.real)), tuple(map(float, chosen.imag))


Index = Callable[[ArrayLike], NDArray[np.float64]]


def is_dispersive(material: object) -> bool:
    """Return whether a material bends wavelengths by different angles."""
    if not isinstance(material, Dielectric) or material.glass is None:
        return False
    first, *others = dielectric_index(material)([LINE_F_NM, LINE_D_NM, LINE_C_NM])
    return any(other != first for other in others)


def dielectric_index(material: Dielectric) -> Index:
    """The refractive index as a function of wavelengths [nm]; beyond those of a glass's law, that of its end."""
    if material.glass is None:
        return lambda wavelength_nm: np.full(np.shape(wavelength_nm), material.index)
    glass = material.glass
    return lambda wavelength_nm: held_index(glass, wavelength_nm)


def fill_index(record: np.void, material: Dielectric) -> None:
    """Write the index of a material, and the polynomial over the inverse wavelength where it has a dispersion."""
    record["parameter"] = material.n_d
    if material.glass is None or not is_dispersive(material):
        return
    low, high = known_range(material.glass) or layout.DISPERSION_NM
    low, high = max(low, layout.DISPERSION_NM[0]), min(high, layout.DISPERSION_NM[1])
    wavelengths = fit_nodes(low, high)
    (coefficients,) = fewest_terms(material.glass.index(wavelengths)[None], wavelengths)
    record["dispersion_terms"] = len(coefficients)
    record["dispersion"][: len(coefficients)] = coefficients
    record["dispersion_low"], record["dispersion_high"] = (
        layout.DISPERSION_SCALE / nm - layout.DISPERSION_SHIFT for nm in (high, low)
    )


# Pictures as the words that ``kernels/material/image.h`` reads.

Texels = NDArray[np.uint8] | NDArray[np.float32]
_LARGEST_EXPONENT = 15  # halves reach 2^16


def _colour_texels(picture: Picture, channel: str, *, encoded: bool) -> tuple[Texels, TexelFormat]:
    """Return red, green and blue of a picture, shape (height, width, 3), and how to store them.

    A single channel becomes grey. Floats come out linear, bytes as they are.
    """
    texels = picture.texels[..., :3] if channel == "rgb" else picture.texels[..., ["rgba".index(channel)] * 3]
    if texels.dtype == np.uint8:
        return texels, TexelFormat.SRGB if encoded else TexelFormat.LINEAR
    floats = texels.astype(np.float32, copy=False)
    return linear_from_srgb(floats) if encoded else floats, TexelFormat.HALF


def _pack_texels(texels: Texels, form: TexelFormat) -> tuple[NDArray[np.uint32], float]:
    """Return the words of texels (height, width, 3) whose first row is on top, and what a stored 1 stands for.

    Rows start at the bottom; each ends with its first texel once more.
    """
    rows = np.concatenate([texels[::-1], texels[::-1, :1]], axis=1)
    if form is not TexelFormat.HALF:
        red, green, blue = (rows[..., index].astype(np.uint32) for index in range(3))
        return np.asarray(red | green << 8 | blue << 16, np.uint32).ravel(), 1.0
    exponent = int(np.frexp(rows.max())[1]) - _LARGEST_EXPONENT
    halves = np.zeros((*rows.shape[:2], 4), np.float16)
    halves[..., :3] = np.ldexp(rows, -exponent)
    return halves.view(np.uint32).ravel(), 2.0**exponent


_COARSE = 256  # rows and columns of a picture by which its parts are known


def unpack_texels(
    words: NDArray[np.uint32], size: tuple[int, int], form: TexelFormat
) -> NDArray[np.uint8] | NDArray[np.float16]:
    """The texels (height, width, 3), the top row first, of words of `_pack_texels`: bytes, or scaled halves."""
    height, width = size
    numbers = words.view(np.float16 if form is TexelFormat.HALF else np.uint8)  # little-endian, as devices are
    return np.asarray(numbers.reshape(height, width + 1, 4)[::-1, :-1, :3])


def _linear_mean(texels: Texels, form: TexelFormat) -> NDArray[np.float64]:
    """Return the mean linear colour of texels."""
    if form is TexelFormat.HALF:
        return np.asarray(texels.reshape(-1, 3).mean(axis=0, dtype=np.float64))
    linear = linear_codes(form).astype(np.float64)
    counts = [np.bincount(texels[..., index].ravel(), minlength=256) for index in range(3)]
    return np.array([count @ linear / count.sum() for count in counts])


def linear_codes(form: TexelFormat) -> NDArray[np.float32]:
    """Return the linear values of the 256 codes of a byte."""
    codes = np.arange(256, dtype=np.float32) / np.float32(255)
    return linear_from_srgb(codes) if form is TexelFormat.SRGB else codes


# The pictures of a scene's textures: each file read once, each way of storing it packed once and remembered.

MOST_BYTES = 512 << 20  # of all that is kept; what alone is larger is not


PICTURES: Memory[Any] = Memory(most_bytes=MOST_BYTES)  # by the content of their files
_TRAITS: Memory[tuple[bool, bool]] = Memory(most=4096)  # what decides how a picture is stored


_MOST_WORDS = 1 << 32  # what a uint can index: 16 GiB


@dataclass(frozen=True, eq=False)
class Colours:
    """Red, green and blue of a picture as they are stored on the device.

    Attributes
    ----------
    words : array of uint32
        Texels as `_pack_texels` returns them.
    scale : float
        What a stored 1 stands for.
    size : (height, width)
    mean : (3,) array
        Mean linear colour.
    form : TexelFormat
    name : str
        Identifies it among all others.
    """

    words: NDArray[np.uint32]
    scale: float
    size: tuple[int, int]
    mean: NDArray[np.float64]
    form: TexelFormat
    name: str

    @classmethod
    def of(cls, texels: Texels, form: TexelFormat, name: str) -> Colours:
        """Return the colours of texels (height, width, 3), the top row first: bytes, or linear floats to be halves."""
        words, scale = _pack_texels(texels, form)
        words.flags.writeable = False
        return cls(words, scale, (texels.shape[0], texels.shape[1]), _linear_mean(texels, form), form, name)

    @property
    def nbytes(self) -> int:
        """Size in memory."""
        return self.words.nbytes


# Textures of the scene as records.

# Ken Perlin, «Improving noise», SIGGRAPH 2002: the permutation of its reference implementation.
PERMUTATION = bytes.fromhex(
    "97a0895b5a0f830dc95f6035c2e907e18c24671e458e086325f0150a17be0694f778ea4b001ac53e5efcdbcb75230b2039b12158"
    "ed953857ae147d88aba844af4aa547868b301ba64d929ee7536fe57a3cd385e6dc695c29372ef528f4668f3641193fa101d85049"
    "d14c84bbd05912a9c8c4878274bc9f56a4646dc6adba034034d9e2fa7c7b05ca2693767eff5255d4cfce3be32f103a11b6bd1c2a"
    "dfb7aad577f898022c9aa346dd99659ba72bac09811627fd13626c6e4f71e0e8b2b97068daf661e4fb22f2c1eed2900cbfb3a2f1"
    "513391ebf90eef6b31c0d61fb5c76a9db854ccb07379322d7f0496fe8aeccd5dde72431d1848f38d80c34e42d73d9cb4"
)
# The colours of marble: control points of six cubic pieces in a row, 1.5 times those that Pharr, Jakob and Humphreys
# 2016, section 10.6.5, have, as they do.
_STONE, _DULL, _WARM, _VEIN = (0.87, 0.87, 0.9), (0.75, 0.75, 0.75), (0.9, 0.885, 0.87), (0.3, 0.3, 0.495)
MARBLE = np.array([_STONE, _STONE, _STONE, _DULL, _WARM, _STONE, _STONE, _VEIN, _STONE], np.float32)

Colour = tuple[float, float, float]
BLACK: Colour = (0.0, 0.0, 0.0)
UNLIMITED = float(np.finfo(np.float32).max)
_WRAPS = {"repeat": Wrap.REPEAT, "clamp": Wrap.CLAMP, "mirror": Wrap.MIRROR}


@dataclass(frozen=True)
class Textures:
    """What the kernels read of textures.

    Attributes
    ----------
    records : array of Texture
    texels : array of uint32
        Texels of all pictures, see ``kernels/material/image.h``.
    facts : dict
        Which kinds of texture there are.
    metres_per_unit : float
        Of the scene.
    """

    records: NDArray[np.void]
    texels: NDArray[np.uint32]
    facts: dict[str, int]
    metres_per_unit: float

    def seen_from(self, eye: Colour) -> Textures:
        """Return these with what lies in the scene about the camera's eye, where the kernels' world has its origin."""
        if not self.facts["HAS_MAPPING"]:
            return self
        records = self.records.copy()
        unit = self.metres_per_unit
        for name in ("row_x", "row_y", "row_z"):
            records[name][:, 3] += np.float32(records[name][:, :3].astype(np.float64) @ (np.array(eye) * unit))
        return replace(self, records=records)

    def image_at(self, index: int, u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the colours (n, 3) of a picture at surface coordinates (n,); None of what is no picture over them.

        Of one with more than `_COARSE` rows or columns means of several.
        """
        record = self.records[index]
        if record["kind"] != TextureKind.IMAGE or record["mapping"] != Mapped.UV:
            return None
        size, form = (int(record["height"]), int(record["width"])), TexelFormat(int(record["format"]))
        first = int(record["first"])
        words = size[0] * (size[1] + 1) << int(form is TexelFormat.HALF)
        texels = unpack_texels(self.texels[first : first + words], size, form)[::-1]
        light = texels.astype(np.float64) if form is TexelFormat.HALF else linear_codes(form)[texels].astype(np.float64)
        for axis, count in enumerate(size):
            starts = np.arange(0, count, -(-count // _COARSE))
            means = np.diff(starts, append=count).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
            light = np.add.reduceat(light, starts, axis=axis) / means
        between = []
        for row, wrap, count in (("row_v", "wrap_v", len(light)), ("row_u", "wrap_u", light.shape[1])):
            x = record[row][0] * u + record[row][1] * v + record[row][2]
            if record[wrap] == Wrap.REPEAT:
                x = x - np.floor(x)
            elif record[wrap] == Wrap.MIRROR:
                x = 1 - np.abs(1 - np.mod(x, 2))
            place = np.clip(x, 0, 1) * count - 0.5
            low = np.rint(place) if record["nearest"] else np.floor(place)
            ends = np.stack([low, low + 1])
            ends = np.mod(ends, count) if record[wrap] == Wrap.REPEAT else np.clip(ends, 0, count - 1)
            between.append((ends.astype(int), (0.0 if record["nearest"] else place - low) + np.zeros_like(place)))
        (rows, above), (columns, right) = between
        weights = (1 - above, above), (1 - right, right)
        colours = sum(
            (weights[0][i] * weights[1][j])[:, None] * light[rows[i], columns[j]] for i in (0, 1) for j in (0, 1)
        )
        return np.asarray(np.minimum(colours * record["a"][:3].astype(np.float64), record["limit"]))


def _held(records: NDArray[np.void]) -> int:
    """Return how many colours the last of some textures, a mixture, holds at a time (kernels/material/texture.h)."""
    is_mixture = records["kind"][int(records[-1]["first"]) :] == TextureKind.MIXTURE
    return int(np.where(is_mixture, -2, 1).cumsum().max())


class TextureTable:
    """Collects the textures of a scene as records, and the words of their pictures by the content of the files."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.metres_per_unit = scene.metres_per_unit
        self._pictures: dict[str, Picture] = {}
        self._places: dict[str, int] = {}  # the word where the texels of a picture start
        self._words: list[NDArray[np.uint32]] = []
        self._word_count = 0
        self._records: list[np.void] = []
        self._index: dict[tuple[int, float], int] = {}
        self._means: list[NDArray[np.float64]] = []
        self._origin: TextureTable | None = None

    def copy(self) -> TextureTable:
        """Return this table to be added to; its records are not to be changed."""
        other = copy.copy(self)
        other._origin = self
        for name in ("_records", "_index", "_means", "_pictures", "_places", "_words"):
            setattr(other, name, getattr(self, name).copy())
        return other

    @property
    def unchanged_from(self) -> TextureTable | None:
        """The table that it is a copy of, where nothing was added since."""
        origin = self._origin
        return origin if origin is not None and len(self._records) == len(origin._records) else None

    def slot(self, value: Texture | Colour, *, limit: float) -> tuple[Colour, int]:
        """The members of a material's record for a colour: the colour and -1, or black and the index of a texture.

        Parameters
        ----------
        value
            A colour or a texture of the scene.
        limit
            Largest value that an image may give: 1 for reflectances, `UNLIMITED` for radiances.
        """
        if isinstance(value, tuple):
            return value, -1
        key = (id(value), limit)
        if key not in self._index:
            self._index[key] = self._add(value, limit)
        return BLACK, self._index[key]

    def _add(self, value: Texture | Colour, limit: float) -> int:
        """Add the record of a texture and return its index; before that of a mixture stand those of its parts."""
        if isinstance(value, Mixture):
            parts = zip(value.parts, (UNLIMITED, UNLIMITED, 1.0), strict=True)  # cut where they are mixed
            record = TEXTURE.one(kind=TextureKind.MIXTURE, first=len(self._records), limit=limit)[0]
            first, second, amount = (self._means[self._add(*part)] for part in parts)
            self._means.append((1 - amount) * first + amount * second)
        elif isinstance(value, tuple):
            record = TEXTURE.one(kind=TextureKind.PLAIN, a=value, b=value)[0]
            self._means.append(np.array(value))
        else:
            record = self._record(value, limit)
        self._records.append(record)
        return len(self._records) - 1

    def mean(self, index: int) -> NDArray[np.float64]:
        """Return the mean colour over one repeat of the texture of an index."""
        return self._means[index]

    def add_sphere(self, colours: Colours, gain: float = 1.0) -> int:
        """Return the index of a picture of the whole sphere: it repeats in longitude and ends at the poles."""
        records = TEXTURE.one(**self._image(colours, gain), wrap_u=Wrap.REPEAT, wrap_v=Wrap.CLAMP, limit=UNLIMITED)
        self._records.append(records[0])
        return len(self._records) - 1

    def pack(self) -> Textures:
        """Return the records and texels of the textures so far."""
        records = TEXTURE.zeros(len(self._records))
        for index, record in enumerate(self._records):
            records[index] = record
        mixtures = [index for index in self._index.values() if self._records[index]["kind"] == TextureKind.MIXTURE]
        parts = (index for last in mixtures for index in range(int(self._records[last]["first"]), last))
        kinds = {int(self._records[index]["kind"]) for index in (*self._index.values(), *parts)}  # what materials show
        facts = {f"HAS_{kind.name}": int(kind in kinds) for kind in TextureKind} | {"HAS_TEXTURE": int(bool(kinds))}
        facts["HAS_MIXTURE"] = max((_held(records[: last + 1]) // 2 for last in mixtures), default=0)
        facts["HAS_MAPPING"] = int(np.any(records["mapping"] != Mapped.UV))
        words = np.concatenate([*self._words, np.zeros(4, np.uint32)])  # kernels load four at a time
        return Textures(records, words, facts, self.metres_per_unit)

    def colours(self, reference: FileReference, channel: str, space: Literal["auto", "srgb", "linear"]) -> Colours:
        """Return the colours of the picture that a part of the scene names, or one of its channels as a grey.

        Raises
        ------
        InputError
            When the picture cannot be used, with the place in the scene.
        """
        content = self._scene.digest_of(reference)
        has_alpha, is_encoded = _TRAITS.find_or_make(content, lambda: self._traits(reference, content))
        if channel == "a" and not has_alpha:
            raise InputError(f"{reference.place}has no alpha channel (allowed: channel rgb, r, g or b)")
        encoded = space == "srgb" or (space == "auto" and is_encoded and channel == "rgb")
        name = f"{content} {channel} {encoded}"

        def store() -> Colours:
            texels, form = _colour_texels(self._picture(reference, content), channel, encoded=encoded)
            return Colours.of(texels, form, name)

        colours: Colours = PICTURES.find_or_make(f"colours {name}", store)
        return colours

    def _traits(self, reference: FileReference, content: str) -> tuple[bool, bool]:
        """Whether a picture has an alpha channel, and whether its numbers are encoded."""
        picture = self._picture(reference, content)
        return picture.has_alpha, picture.encoded

    def _picture(self, reference: FileReference, content: str) -> Picture:
        if content not in self._pictures:
            try:
                self._pictures[content] = picture = read_picture(self._scene.content_of(reference))
            except InputError as problem:
                raise InputError(f"{reference.place}{problem}") from None
            if picture.negative[0]:
                warnings.warn(
                    f"{reference.place}{picture.negative[0]} of {picture.width * picture.height} texels are negative"
                    f" and count as black (least value {picture.negative[1]:.4g})",
                    UserWarning,
                    stacklevel=2,
                )
        return self._pictures[content]

    def _record(self, texture: SinglePattern, limit: float) -> np.void:
        row_u, row_v = _map_uv(texture)
        record: np.void = TEXTURE.one(row_u=row_u, row_v=row_v)[0]
        if texture.mapping is not None:
            rows = np.array(texture.mapping.matrix[:3]) / np.array([*[self.metres_per_unit] * 3, 1.0])
            fill(record, mapping=Mapped[texture.mapping.kind.upper()], row_x=rows[0], row_y=rows[1], row_z=rows[2])
        if isinstance(texture, ImageTexture):
            colours = self.colours(texture, texture.channel, texture.color_space)
            wrap = _WRAPS[texture.wrap]
            fill(record, **self._image(colours, texture.gain), wrap_u=wrap, wrap_v=wrap, limit=limit)
            fill(record, nearest=texture.filter == "nearest")
            return record
        first, second = texture.colours
        fill(record, kind=TextureKind[texture.kind.upper()], parameter=texture.parameter, a=first, b=second)
        if isinstance(texture, Noise):
            fill(record, contrast=texture.contrast, octaves=texture.octaves, seed=texture.seed)
        if isinstance(texture, Perlin | Marble | Dots):
            record["first"] = self._table()
        if isinstance(texture, Perlin):
            fill(record, octaves=texture.octaves, form=layout.PerlinForm[texture.form.upper()])
        if isinstance(texture, Marble):
            last = 5 if texture.form == "pbrt-v4" else 1
            fill(record, octaves=texture.octaves, variation=texture.variation, a=texture.tint, form=last, limit=limit)
        self._means.append((1 - texture.share) * np.array(first) + texture.share * np.array(second))
        return record

    def _table(self) -> int:
        """Return the word where the permutation of Perlin's noise and the colours of marble start."""
        permutation = np.frombuffer(2 * PERMUTATION, np.uint8).astype(np.uint32)
        return self.add_table("Perlin", np.concatenate([permutation, MARBLE.view(np.uint32).ravel()]))

    def add_table(self, name: str, words: NDArray[np.uint32]) -> int:
        """Return the word where a table, or a picture's texels, start.

        Raises
        ------
        InputError
            When there are too many to count their words.
        """
        if name not in self._places:
            self._places[name] = self._word_count
            self._words.append(words)
            self._word_count += len(words)
            if self._word_count >= _MOST_WORDS:
                raise InputError("the pictures of the scene are too large together (allowed: 16 GiB)")
        return self._places[name]

    def measured(self, material: Measured) -> tuple[MeasuredTable, int]:
        """Return the table of a measured material, and the word where it starts.

        Raises
        ------
        InputError
            When its file is none, with the place in the scene.
        """
        name = f"measured {self._scene.digest_of(material)}"
        try:
            table = PICTURES.find_or_make(name, lambda: read_measured(self._scene.content_of(material)))
        except InputError as problem:
            raise InputError(f"{material.place}{problem}") from None
        return table, self.add_table(name, table.words)

    def _image(self, colours: Colours, gain: float | tuple[float, float, float]) -> dict[str, Any]:
        """The members of an image's record that say its picture, whose mean is noted."""
        self._means.append(np.multiply(gain, colours.mean))
        height, width = colours.size
        return {
            "kind": TextureKind.IMAGE, "format": colours.form, "first": self.add_table(colours.name, colours.words),
            "height": height, "width": width, "a": np.multiply(gain, np.full(3, colours.scale)),
        }  # fmt: skip


def _map_uv(texture: Pattern) -> NDArray[np.float64]:
    """Return the two rows that take (u, v, 1) to the pattern: scaled, turned, shifted."""
    quarters, rest = divmod(texture.rotation_degrees, 90)
    angle = np.deg2rad(rest)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn = turn @ np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), int(quarters) % 4)  # exact for right angles
    rows = np.zeros((2, 4))
    rows[:, :2] = turn * texture.scale
    rows[:, 2] = texture.offset
    return rows
