"""Textures of pbrt as textures of ours, or as the colour that comes nearest."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.colour import (
    LUMINANCE,
    RGB_FROM_XYZ,
    SRGB_WHITE,
    WAVELENGTHS_NM,
    blackbody,
    cie_1931,
    linear_from_srgb,
    planck_radiance,
    xyz_of,
)
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import content_name
from rptcam_cl.exchange.conversion import Array, Place, is_invertible, nested, read_limited, tidy
from rptcam_cl.exchange.pbrt.source import Parameter
from rptcam_cl.exchange.pbrt.world import Context, Entity
from rptcam_cl.scene.assets.pictures import LARGEST_PIXELS, SUFFIXES, read_picture, write_exr
from rptcam_cl.scene.textures import MOST_NESTED

# Pictures of pbrt scenes: those that ours reads by their name, TGA and PFM files in another format.

Pixels = NDArray[np.float32]

# Kinds of pictures that pbrt reads and ours does not, and all that are converted.
_OTHERS = (".tga", ".pfm")
READABLE = (*SUFFIXES, *_OTHERS)
NOT_READ = "a kind of picture that is not read"
_PFM = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+.\deE]{1,30})\s")
_LARGEST_FILE = 16 * LARGEST_PIXELS


def is_readable(path: Path) -> bool:
    """Return whether a picture can be shown, by its suffix."""
    return path.suffix.lower() in READABLE


def picture_name(context: Context, path: Path, place: Place) -> str:
    """Return the name under which the scene of ours reads a picture; one of another kind is written anew."""
    suffix = path.suffix.lower()
    if suffix not in _OTHERS:
        return context.files.reference(path, place, read_picture)
    if str(path) not in context.pictures:
        if suffix == ".tga":
            name = context.files.add("files", f"{path.stem}.png", partial(_write_png, _tga(path, place)))
        else:
            name = context.files.add("files", f"{path.stem}.exr", partial(write_exr, {"RGB": _pfm(path, place)}))
        context.report.noted(place, f"{path.name}: written anew, to {name}")
        context.pictures[str(path)] = name
    return context.pictures[str(path)]


def lamp_pixels(context: Context, path: Path, place: Place) -> Pixels:
    """Return the linear colours of a lamp's or the sky's picture, (height, width, 3), the top row first.

    pbrt-v2 and v3 take the bytes of such a picture for linear ones (their ``ReadImage``), pbrt-v4 for sRGB.
    """
    texels = _texels(path, place)
    if texels.dtype != np.uint8:
        return np.asarray(texels, np.float32)
    return _decode_srgb(texels) if context.scene.version == 4 else np.asarray(texels / np.float32(255))


def _mean_colour(path: Path, place: Place, channels: slice, *, linear: bool) -> NDArray[np.float64]:
    """Return the mean of a picture's linear colours, or of its alpha; bytes are sRGB unless they are linear."""
    texels = _texels(path, place, channels)
    if texels.dtype != np.uint8:
        return np.asarray(texels.mean(axis=(0, 1), dtype=np.float64))
    return np.asarray((texels / 255 if linear else _decode_srgb(texels)).mean(axis=(0, 1), dtype=np.float64))


def _texels(path: Path, place: Place, channels: slice = slice(3)) -> NDArray[Any]:
    """Return the colours of a picture, or other channels, as it stores them, (height, width, n)."""
    if path.suffix.lower() == ".pfm":
        return _pfm(path, place)[..., channels]
    if path.suffix.lower() == ".tga":
        return _tga(path, place)[..., channels]
    try:
        return read_picture(path).texels[..., channels]
    except InputError as problem:
        raise place.error(f"{path.name}: {problem}") from None


def _has_holes(path: Path, place: Place) -> bool:
    """Return whether a picture has an alpha that is not opaque all over.

    It is then the value of pbrt-v4's textures of numbers (``MIPMap::Bilerp``), and decoded as colours are.
    """
    alpha = _texels(path, place, slice(3, 4))
    return bool((alpha < (255 if alpha.dtype == np.uint8 else 1)).any())


def _decode_srgb(texels: NDArray[Any]) -> Pixels:
    """Return the linear values of sRGB bytes (IEC 61966-2-1)."""
    return np.asarray(linear_from_srgb(np.arange(256) / 255).astype(np.float32)[texels])


def _tga(path: Path, place: Place) -> NDArray[np.uint8]:
    import PIL.Image

    try:
        with PIL.Image.open(path, formats=("TGA",)) as image:
            if image.width * image.height > LARGEST_PIXELS:
                raise place.error(f"{path.name}: is too large (allowed: at most {LARGEST_PIXELS} pixels)")
            return np.asarray(image.convert("RGBA" if "A" in image.getbands() else "RGB"))
    except (OSError, ValueError, SyntaxError, PIL.Image.DecompressionBombError) as problem:
        raise place.error(f"{path.name}: is not a TGA picture ({str(problem).splitlines()[0]})") from None


def _pfm(path: Path, place: Place) -> Pixels:
    """Return the colours of a portable float map, whose rows run upwards; a negative scale means little-endian."""
    raw = read_limited(path, path.name, _LARGEST_FILE)
    header = _PFM.match(raw)
    if header is None:
        raise place.error(f"{path.name}: is not a PFM picture")
    channels = 3 if header[1] == b"PF" else 1
    width, height = int(header[2]), int(header[3])
    order = "<" if header[4].startswith(b"-") else ">"
    count = width * height * channels
    if not count or len(raw) - header.end() < 4 * count:
        raise place.error(f"{path.name}: holds fewer than its {width} x {height} pixels")
    values = np.frombuffer(raw, f"{order}f4", count, header.end()).astype(np.float32)
    if not np.isfinite(values).all():
        raise place.error(f"{path.name}: holds numbers that are not finite")
    return np.maximum(np.broadcast_to(values.reshape(height, width, channels)[::-1], (height, width, 3)), 0)


def _write_png(pixels: NDArray[np.uint8], path: Path) -> None:
    import PIL.Image

    PIL.Image.fromarray(pixels).save(path, format="PNG")


# Spectra and colours of other spaces as linear sRGB (ITU-R BT.709 primaries, white D65).

_ACES_WHITE = (0.32168, 0.33767)
# Primaries and white as CIE x, y: BT.2020, SMPTE RP 431-2 with D65 as pbrt has it, SMPTE ST 2065-1.
_PRIMARIES = {
    "rec2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), SRGB_WHITE),
    "dci-p3": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), SRGB_WHITE),
    "aces2065-1": ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077), _ACES_WHITE),
}


def _xyz_from_rgb(space: str) -> Array:
    *primaries, white = _PRIMARIES[space]
    columns = np.stack([xyz_of(xy) if xy[1] else np.array([1.0, 0.0, 0.0]) for xy in primaries], axis=1)
    return np.asarray(columns * np.linalg.solve(columns, xyz_of(white)))


def _srgb_from(space: str, rgb: ArrayLike) -> Array:
    """Return linear sRGB of the colour (…, 3) of a space; white stays white, as in the space's own light."""
    values = np.asarray(rgb, np.float64)
    if space == "srgb":
        return values
    matrix = RGB_FROM_XYZ @ _xyz_from_rgb(space)
    # scaled per channel so that (1, 1, 1) stays so, also where the whites differ
    return np.asarray(values @ (matrix / (matrix @ np.ones(3))[:, None]).T)


_WIEN = 2.897771955e6  # temperature times the wavelength where a black body is brightest [nm K], CODATA 2018
_LUMINOUS = float(cie_1931()[:, 1].sum())

# Chromaticities x, y of standard illuminants, 2 degrees (CIE 15:2004, table T.3 and T.5); ACES: SMPTE ST 2065-1.
_ILLUMINANTS = {
    "stdillum-A": (0.44758, 0.40745), "stdillum-D50": (0.34567, 0.35851), "stdillum-D65": SRGB_WHITE,
    "stdillum-F1": (0.3131, 0.3371), "stdillum-F2": (0.3721, 0.3751), "stdillum-F3": (0.4091, 0.3941),
    "stdillum-F4": (0.4402, 0.4031), "stdillum-F5": (0.3138, 0.3452), "stdillum-F6": (0.3779, 0.3882),
    "stdillum-F7": (0.3129, 0.3292), "stdillum-F8": (0.3458, 0.3586), "stdillum-F9": (0.3741, 0.3727),
    "stdillum-F10": (0.3458, 0.3588), "stdillum-F11": (0.3805, 0.3769), "stdillum-F12": (0.4370, 0.4042),
    "illum-acesD60": _ACES_WHITE,
}  # fmt: skip


def _xyz_of_samples(wavelengths_nm: ArrayLike, values: ArrayLike) -> Array:
    """Return X, Y, Z of a spectrum, linear between its samples; one that is 1 everywhere has Y = 1.

    Beyond its first and last sample a spectrum keeps their values.
    """
    order = np.argsort(np.asarray(wavelengths_nm, np.float64), kind="stable")
    samples = np.interp(WAVELENGTHS_NM, np.asarray(wavelengths_nm)[order], np.asarray(values)[order])
    return np.asarray(samples @ cie_1931() / _LUMINOUS)


def reflectance_srgb(wavelengths_nm: ArrayLike, values: ArrayLike) -> Array:
    """Return linear sRGB of a reflectance spectrum; one that reflects everything is (1, 1, 1)."""
    white = RGB_FROM_XYZ @ _xyz_of_samples([500.0], [1.0])
    return np.asarray(RGB_FROM_XYZ @ _xyz_of_samples(wavelengths_nm, values) / white)


def _light_srgb(wavelengths_nm: ArrayLike, values: ArrayLike, *, luminance: float | None = None) -> Array:
    """Return linear sRGB of a light's spectrum, scaled to a luminance if one is given."""
    xyz = _xyz_of_samples(wavelengths_nm, values)
    if luminance is not None:
        xyz = xyz * (luminance / xyz[1]) if xyz[1] > 0 else np.zeros(3)
    return np.asarray(RGB_FROM_XYZ @ xyz)


def black_body_srgb(kelvin: float, *, luminance: float | None) -> Array:
    """Return linear sRGB of a black body of a temperature [K]: of a luminance, or with its spectrum's peak at 1.

    That peak is where Wien's law has it, wherever that lies.
    """
    spectrum = np.asarray(blackbody(kelvin) / planck_radiance(_WIEN / kelvin, kelvin))
    return _light_srgb(WAVELENGTHS_NM, spectrum, luminance=luminance)


# Colours of parameters: reflectances, lights and indices, whichever way pbrt lets them be written.

COLOURS = ("rgb", "color", "xyz", "spectrum", "blackbody", "float")
_LARGEST_SPECTRUM = 10_000_000


def reflectance(context: Context, entity: Entity, name: str, default: float) -> Array:
    """Return a reflectance or another share, linear sRGB from 0 to 1."""
    item = entity.parameters.get(name, *COLOURS)
    if item is None:
        return np.full(3, default)
    is_spectrum = item.kind == "spectrum"
    colour = reflectance_srgb(*samples_of(context, item)) if is_spectrum else _plain(item, entity)
    if colour.min() < 0 or colour.max() > 1:
        context.approximated(entity, f'"{name}" is cut to 0 … 1', item.place)
    return np.clip(colour, 0, 1)


def light(context: Context, entity: Entity, name: str) -> Array:
    """Return the colour of a light, linear sRGB from 0 up; 1 when the parameter is absent.

    pbrt-v4 scales every light to luminance 1 whose colour is a spectrum; one given as ``rgb`` it takes as it is.
    """
    item = entity.parameters.get(name, *COLOURS)
    if item is None:
        return np.ones(3)
    luminance = 1.0 if context.scene.version == 4 else None
    values = item.values
    if item.kind == "blackbody" and isinstance(values, np.ndarray):
        if len(values) > 2 or not len(values) or not values[0] > 0:
            got = " ".join(f"{value:g}" for value in values) or "nothing"
            raise entity.parameters.error(name, f"needs a temperature above 0 [K] (got {got})")
        scale = float(values[1]) if len(values) == 2 else 1.0
        colour = scale * black_body_srgb(float(values[0]), luminance=luminance)
    elif item.kind == "spectrum" and len(values) == 1 and str(values[0]) in _ILLUMINANTS:
        colour = np.asarray(RGB_FROM_XYZ @ xyz_of(_ILLUMINANTS[str(values[0])]))
    elif item.kind == "spectrum":
        colour = _light_srgb(*samples_of(context, item), luminance=luminance)
    else:
        colour = _plain(item, entity)
    if colour.min() < 0:
        context.approximated(entity, f'"{name}" lies outside sRGB; cut at 0', item.place)
    return np.maximum(colour, 0)


def coefficients(context: Context, entity: Entity, name: str, default: ArrayLike = (1.0, 1.0, 1.0)) -> Array:
    """Return a coefficient in red, green and blue, from 0 up: a number, a colour or a spectrum."""
    item = entity.parameters.get(name, *COLOURS)
    if item is None:
        return np.asarray(default, np.float64)
    is_spectrum = item.kind == "spectrum"
    return np.maximum(reflectance_srgb(*samples_of(context, item)) if is_spectrum else _plain(item, entity), 0)


# Parameters that say how many samples a light gets.
SAMPLING = ("nsamples", "samples")


def lamp_radiance(context: Context, lamp: Entity, area: float) -> tuple[Array, bool]:
    """Return the radiance of a shape that shines, and whether its back does too.

    Parameters
    ----------
    area
        Of the part that pbrt takes for a lamp [square units]; 0 if unknown.
    """
    parameters = lamp.parameters
    parameters.skip(*SAMPLING)
    if lamp.kind not in ("diffuse", "area"):
        context.approximated(lamp, "shines as diffuse does, since there is no such lamp")
    two_sided = parameters.boolean("twosided", False)
    colour = light(context, lamp, "L") * coefficients(context, lamp, "scale")
    power = parameters.number("power", -1.0)
    if power > 0 and area > 0:
        colour = colour * power / (math.pi * area * (2 if two_sided else 1))
    elif power > 0:
        context.ignored(lamp, '"power" of a shape whose area is not known')
    if parameters.has("filename"):
        parameters.skip("filename")
        context.ignored(lamp, "the picture that it shines with")
    return colour, two_sided


def samples_of(context: Context, item: Parameter) -> tuple[Array, Array]:
    """Return wavelengths [nm] and values of a spectrum: of pairs, of a file of pairs, or a single number."""
    if isinstance(item.values, np.ndarray):
        return _pairs(np.asarray(item.values, np.float64), item)
    (name, *others) = (str(value) for value in item.values)
    if others:
        raise item.place.error(f'"{item.name}" needs one spectrum (got {1 + len(others)})')
    path = context.find_or_note(name, item.place, "a spectrum that is 1 everywhere")
    if path is None:
        return np.array([500.0]), np.ones(1)
    text = read_limited(path, name, _LARGEST_SPECTRUM).decode("latin-1")
    words = [word for line in text.splitlines() for word in line.split("#", 1)[0].replace(",", " ").split()]
    try:
        numbers = np.array(words, np.float64)
    except ValueError:
        raise item.place.error(f"{name}: must hold pairs of a wavelength [nm] and a value") from None
    return _pairs(numbers, item)


def _pairs(numbers: Array, item: Parameter) -> tuple[Array, Array]:
    if len(numbers) == 1:
        return np.array([500.0]), numbers
    if len(numbers) % 2 or not len(numbers) or not np.isfinite(numbers).all():
        raise item.place.error(
            f'"{item.name}" needs pairs of a wavelength [nm] and a value (got {len(numbers)} numbers)'
        )
    return numbers[::2], numbers[1::2]


def _plain(item: Parameter, entity: Entity) -> Array:
    """Return the colour of rgb, xyz or a single number."""
    if item.kind == "blackbody" or not isinstance(item.values, np.ndarray):
        raise entity.parameters.error(item.name, f"cannot be a {item.kind}")
    values = item.values
    if item.kind == "float" and len(values) == 1:
        return np.full(3, float(values[0]))
    if len(values) != 3:
        raise entity.parameters.error(item.name, f"needs 3 numbers (got {len(values)})")
    if item.kind == "xyz":
        return np.asarray(RGB_FROM_XYZ @ values)
    return _srgb_from(entity.color_space, values)


Keys = dict[str, Any]

# Parameters of filtering, which is ours to choose.
_FILTERING = ("maxanisotropy", "trilinear")
GREY = 0.5
# Along each side of the picture of u and v.
_UV_TEXELS = 256
# The colours of textures of ours that lie between two.
_ENDS = {"checker": ("even", "odd"), "perlin": ("low", "high"), "dots": ("outside", "inside")}
# The mean colours of marble, by its form.
_MARBLE = {"": np.array([0.805, 0.803, 0.84]), "pbrt-v3": np.full(3, 0.94)}
# Nested deeper than textures are on purpose; a name that refers to itself never gets here.
DEEPEST = 32
_MOST_OCTAVES = 12


@dataclass(frozen=True, eq=False)
class Shade:
    """What a parameter of a material is: one colour, or a texture of ours with its mean.

    Attributes
    ----------
    mean : (3,) array, or a function that returns it
        The colour, or the mean of the texture, for where ours takes no texture.
    texture : dict or None
        Keys of a texture.
    """

    mean: Array | Callable[[], Array]
    texture: Keys | None = None

    @cached_property
    def colour(self) -> Array:
        """The mean; that of a picture is computed on demand, as the whole picture must be read."""
        return self.mean() if callable(self.mean) else self.mean

    def keys(self) -> Any:
        """The value of a key of ours that takes colours and textures."""
        return self.colour.tolist() if self.texture is None else self.texture

    def scaled(self, factor: Array) -> Shade:
        """Return the shade times a colour, as near as a texture of ours can."""
        texture = None if self.texture is None else _scale_texture(self.texture, factor)
        return Shade(lambda: np.clip(self.colour * factor, 0, 1), texture)


def _scale_texture(texture: Keys, factor: Array) -> Keys:
    """Return a texture of ours times a colour."""
    texture = dict(texture)
    if texture["kind"] == "mixture":
        for name, default in (("first", 0.0), ("second", 1.0)):
            part = texture.get(name, [default] * 3)
            texture[name] = (
                _scale_texture(part, factor) if isinstance(part, dict) else np.clip(part * factor, 0, 1).tolist()
            )
    for name in (*_ENDS.get(texture["kind"], ()), "tint"):
        if name in texture:
            texture[name] = np.clip(np.array(texture[name]) * factor, 0, 1).tolist()
    if texture["kind"] == "image":
        gain = np.maximum(np.multiply(texture.get("gain", 1.0), factor), 0)
        texture["gain"] = float(gain[0]) if np.ptp(gain) == 0 else gain.tolist()
    return texture


def _mixture(context: Context, texture: Entity, first: Shade, second: Shade, amount: Shade) -> Shade:
    """Return textures mixed by a third; their mean where mixtures stand too deep in each other."""
    mean = _mixed(first.colour, second.colour, amount.colour)
    parts = {"first": first, "second": second, "amount": amount}
    keys: Keys = {"kind": "mixture", **{name: part.keys() for name, part in parts.items()}}
    if nested(keys) > MOST_NESTED:
        context.approximated(texture, "its textures as one colour each")
        return Shade(mean)
    return Shade(mean, keys)


def shade(context: Context, entity: Entity, name: str, default: float, depth: int = 0) -> Shade:
    """Return a colour parameter of a material or texture; of a texture of numbers one of those."""
    item = entity.parameters.get(name, "texture", *COLOURS)
    if item is None or item.kind != "texture":
        return Shade(reflectance(context, entity, name, default))
    kind = "float" if entity.what.endswith(f'"float" "{entity.kind}"') else "spectrum"
    return _convert_named(context, entity, item, kind, default, depth)


def value(context: Context, entity: Entity, name: str, default: float) -> float:
    """Return a number parameter; a texture or colour is replaced by its mean."""
    number = number_shade(context, entity, name, default)
    if number.texture is not None:
        place = entity.parameters.items[name].place
        context.approximated(entity, f'"{name}" is its mean, not a texture', place)
    return single(context, entity, name, number)


def number_shade(context: Context, entity: Entity, name: str, default: float) -> Shade:
    """Return a number parameter that may vary over the surface; one given as a colour stays a colour."""
    item = entity.parameters.get(name, "texture", *COLOURS)
    if item is None or item.kind == "float":
        return Shade(np.full(3, default if item is None else entity.parameters.number(name, default)))
    if item.kind == "texture":
        return _convert_named(context, entity, item, "float", default)
    return Shade(reflectance(context, entity, name, default))


def single(context: Context, entity: Entity, name: str, texture: Shade) -> float:
    """Return the mean over the channels of a parameter where ours takes one number; a colour is reported."""
    if np.ptp(texture.colour) > 1e-6:
        place = entity.parameters.items[name].place
        context.approximated(entity, f'the colour "{name}" as its mean over the channels', place)
    return float(texture.colour.mean())


def numbers(context: Context, entity: Entity, name: str, share: Shade) -> Shade:
    """Return a texture of colours as the mean of its channels, where pbrt-v3 takes a share each and ours one number."""
    texture = None if share.texture is None else _number_texture(context, share.texture)
    if texture == share.texture:
        return share
    place = entity.parameters.items[name].place
    context.approximated(entity, f'the colours of the texture "{name}" as their mean over the channels', place)
    return Shade(share.mean, texture)


def _number_texture(context: Context, texture: Keys) -> Keys:
    """Return a texture whose channels are all the mean of another's; in a product that of each factor."""
    if texture["kind"] == "image" and "channel" not in texture:
        write = context.greys.get((texture["file"], texture.get("color_space") == "linear"))
        file = "" if write is None else write(np.broadcast_to(texture.get("gain", 1.0), 3))
        kept = {key: part for key, part in texture.items() if key != "gain"}
        return kept | {"file": file, "color_space": "linear"} if file else texture
    if texture["kind"] == "marble":
        grey = [float(_MARBLE[texture.get("form", "")].mean())] * 3
        return {"kind": "checker", "even": grey, "odd": grey}
    made = dict(texture)
    for name in ("first", "second", "amount", *_ENDS.get(texture["kind"], ())):
        if isinstance(part := texture.get(name), dict):
            made[name] = _number_texture(context, part)
        elif part is not None and np.ptp(part) > 0:
            made[name] = [float(np.mean(part))] * 3
    return made


def _convert_named(
    context: Context, entity: Entity, item: Parameter, kind: str, default: float, depth: int = 0
) -> Shade:
    """Return the texture that a parameter names; the value that it has without one where none has the name."""
    name = " ".join(str(text) for text in item.values)
    texture = entity.textures.get((kind, name))
    if texture is None or texture.kind not in _KINDS:
        other = entity.textures.get(("float" if kind == "spectrum" else "spectrum", name))
        hint = f"; one of the other type has, on {other.place.line}" if other is not None else ""
        why = f"no {kind} texture has the name{hint}" if texture is None else f'there is no texture "{texture.kind}"'
        context.approximated(entity, f'"{item.name}" is {default:g} in place of "{name}": {why}', item.place)
        return Shade(np.full(3, default))
    if depth > DEEPEST:
        raise item.place.error(f"textures refer to each other more than {DEEPEST} deep")
    known = context.known.get(id(texture))
    if not isinstance(known, Shade):
        known = context.known[id(texture)] = _KINDS[texture.kind](context, texture, depth + 1)
    return known


def heights(context: Context, entity: Entity, name: str, depth: int = 0) -> tuple[Keys | None, float]:
    """Return the texture of a parameter that gives heights, and the factor on it; no texture where all are the same."""
    item = entity.parameters.get(name, "texture", "float")
    if item is None or item.kind == "float":
        return None, entity.parameters.number(name, 1.0)
    texture = entity.textures.get(("float", " ".join(str(text) for text in item.values)))
    if texture is None or texture.kind != "scale" or depth > DEEPEST:
        known = _convert_named(context, entity, item, "float", 0.0, depth)
        return known.texture, 1.0 if known.texture is not None else float(known.colour.mean())
    (first, one), (second, two) = (heights(context, texture, key, depth + 1) for key in _factor_names(texture))
    if first is not None and second is not None:
        product: Keys = {"kind": "mixture", "second": first, "amount": second}
        if nested(product) <= MOST_NESTED:
            return product, one * two
        context.approximated(texture, "the second texture as 0.5")
        two *= 0.5
    return first if first is not None else second, one * two


def _grey(context: Context, texture: Entity, depth: int) -> Shade:
    texture.parameters.skip_all()
    context.approximated(texture, f"grey {GREY:g}")
    return Shade(np.full(3, GREY))


def _constant(context: Context, texture: Entity, depth: int) -> Shade:
    item = texture.parameters.get("value", *COLOURS)
    if item is not None and item.kind == "float":
        return Shade(np.full(3, texture.parameters.number("value", 1.0)))
    return Shade(reflectance(context, texture, "value", 1.0))


def _bilinear(context: Context, texture: Entity, depth: int) -> Shade:
    """Return a colour that is linear in u and in v: a picture of four texels, whose centres are the corners."""
    corners = {"v01": 1.0, "v11": 1.0, "v00": 0.0, "v10": 0.0}  # the top row first
    colours = np.array([shade(context, texture, name, default, depth).colour for name, default in corners.items()])
    lying = _mapping(context, texture)
    if np.ptp(colours, axis=0).max() == 0:
        return Shade(colours[0])
    colours = colours.reshape(2, 2, 3)
    write = partial(write_exr, {"RGB": colours.astype(np.float32)})
    name = context.files.add("files", "corners.exr", write)
    context.report.noted(
        texture.place, f"{texture.what}: written as a picture, to {name}; beyond 0 to 1 its edges go on"
    )
    context.greys[name, False] = partial(_write_numbers, context, "corners", texture.what, texture.place, colours)
    scale, offset = (np.array(lying.get(key, default)) for key, default in (("scale", [1, 1]), ("offset", [0, 0])))
    lying |= {"scale": (scale / 2).tolist(), "offset": (offset / 2 + 0.25).tolist()}
    return Shade(colours.mean(axis=(0, 1)), {"kind": "image", "file": name, "wrap": "clamp"} | lying)


def _texture_from_scene(context: Context, texture: Entity, *, placed: bool = True) -> Array | None:
    """Return the matrix from the scene of ours to the frame of a texture; None, with a note, where there is none.

    Parameters
    ----------
    placed
        Whether the current transform where the texture was declared counts.
    """
    world = context.world @ texture.world_from_object if placed else context.world
    if not is_invertible(world):
        context.approximated(texture, "u and v in place of its own space, whose transform cannot be inverted")
        return None
    return np.asarray(np.linalg.inv(world))


def _in_space(context: Context, texture: Entity, scale: float = 1.0) -> Keys:
    """Return the mapping of a texture that lies in space, scaled by a factor."""
    matrix = _texture_from_scene(context, texture)
    return {} if matrix is None else {"mapping": {"matrix": tidy((np.diag([scale] * 3 + [1.0]) @ matrix)[:3])}}


def _mapping(context: Context, texture: Entity) -> Keys:
    parameters = texture.parameters
    mapping = parameters.text("mapping", "uv")
    if mapping in ("spherical", "cylindrical", "planar"):
        parameters.skip("uscale", "vscale")
        along = [[*parameters.vector(key, axis), parameters.number(shift, 0.0)] for key, axis, shift in (
            ("v1", (1, 0, 0), "udelta"), ("v2", (0, 1, 0), "vdelta"))]  # fmt: skip
        planar = mapping == "planar"
        matrix = _texture_from_scene(context, texture, placed=not planar or context.scene.version == 4)
        if matrix is None:
            return {}
        if mapping == "cylindrical" and context.scene.version != 4:
            mapping = "round"
        if planar:
            return {"mapping": {"matrix": tidy([*(along @ matrix), np.zeros(4)])}}
        return {"mapping": {"kind": mapping, "matrix": tidy(matrix[:3])}}
    if mapping != "uv":
        parameters.skip("v1", "v2")
        context.approximated(texture, f'the mapping "{mapping}" as that of u and v')
    scale = [parameters.number("uscale", 1.0), parameters.number("vscale", 1.0)]
    offset = [parameters.number("udelta", 0.0), parameters.number("vdelta", 0.0)]
    return ({"scale": scale} if scale != [1, 1] else {}) | ({"offset": offset} if offset != [0, 0] else {})


def _image(context: Context, texture: Entity, depth: int) -> Shade:
    parameters = texture.parameters
    parameters.skip(*_FILTERING)
    name, place = texture.file_name()
    path = context.find_or_note(name, place, f"grey {GREY:g}")
    if path is None:
        texture.parameters.skip_all()
        return Shade(np.full(3, GREY))
    wrap = parameters.text("wrap", "repeat")
    if parameters.boolean("invert", False):
        context.ignored(texture, "invert", place)
    if not is_readable(path):
        context.report.approximated(place, f"{name}: {NOT_READ} (grey {GREY:g}; allowed: {' '.join(READABLE)})")
        parameters.skip(
            "wrap", "filter", "scale", "encoding", "gamma", "uscale", "vscale", "udelta", "vdelta", "mapping"
        )
        return Shade(np.full(3, GREY))
    keys: Keys = {"kind": "image", "file": picture_name(context, path, place)}
    if wrap not in ("repeat", "clamp", "octahedralsphere"):
        context.approximated(texture, f'wrap "{wrap}" as clamp', place)
    if wrap != "repeat":
        keys["wrap"] = "clamp"
    if context.scene.version == 4 and parameters.text("filter", "bilinear") == "point":
        keys["filter"] = "nearest"
    keys |= _encoding(context, texture)
    if (gain := max(parameters.number("scale", 1.0), 0.0)) != 1:
        keys["gain"] = gain
    linear = keys.get("color_space") == "linear"
    keys |= _mapping(context, texture)
    channels = slice(3)
    if texture.what.endswith('"float" "imagemap"'):
        if context.scene.version == 4 and _has_holes(path, place):
            keys |= {"channel": "a", "color_space": keys.get("color_space", "srgb")}
            channels = slice(3, 4)
        elif grey := _grey_picture(context, path, place, linear=linear):
            keys |= {"file": grey, "color_space": "linear"}
    else:
        context.greys[keys["file"], linear] = partial(_grey_picture, context, path, place, linear=linear)
    return Shade(lambda: np.clip(gain * _mean_colour(path, place, channels, linear=linear), 0, 1), keys)


def _grey_picture(context: Context, path: Path, place: Place, gain: Array | None = None, *, linear: bool) -> str:
    """Return the name of a coloured picture that is written anew as numbers; "" for a grey one.

    pbrt-v4 takes the mean of the channels, pbrt-v3 and v2 the luminance of what is stored; a scene of ours has red.
    Of a texture of colours, which has a gain for each of them, it is the mean of all.
    """
    texels = _texels(path, place)
    coded = texels.dtype == np.uint8
    if not (coded or path.suffix.lower() in (".exr", ".hdr", ".pfm")):
        return ""
    if not np.ptp(texels, axis=-1).any() and (gain is None or np.ptp(gain) == 0):
        return ""
    stored = texels / np.float32(255) if coded else texels
    if context.scene.version == 3 and gain is None:
        stored = (stored @ np.asarray(LUMINANCE, np.float32))[..., None]
    colours = linear_from_srgb(stored) if coded and not linear else stored
    return _write_numbers(context, path.stem, path.name, place, colours, gain)


def _write_numbers(
    context: Context, stem: str, name: str, place: Place, colours: Array, gain: Array | None = None
) -> str:
    """Return the name of a picture of the means of the channels of colours (height, width, n), times a gain each."""
    numbers = (colours if gain is None else colours * gain).mean(axis=-1, keepdims=True).astype(np.float32)
    key = content_name("numbers", numbers)
    if key not in context.pictures:
        write = partial(write_exr, {"RGB": np.repeat(numbers, 3, axis=-1)})
        context.pictures[key] = context.files.add("files", f"{stem}-grey.exr", write)
        context.report.noted(place, f"{name}: written anew as numbers, to {context.pictures[key]}")
    return context.pictures[key]


def _encoding(context: Context, texture: Entity) -> Keys:
    """Return how the picture's numbers are meant: ``encoding`` in pbrt-v4, ``gamma`` in pbrt-v3."""
    parameters = texture.parameters
    if not parameters.has("encoding") and not parameters.has("gamma"):
        return {}
    encoding = parameters.text("encoding", "") if parameters.has("encoding") else (
        "sRGB" if parameters.boolean("gamma", True) else "linear")  # fmt: skip
    if encoding.startswith("gamma"):
        context.approximated(texture, f'encoding "{encoding}" as sRGB')
        encoding = "sRGB"
    return {"color_space": "srgb" if encoding == "sRGB" else "linear"}


def _checkerboard(context: Context, texture: Entity, depth: int) -> Shade:
    in_space = texture.parameters.integer("dimension", 2) == 3
    texture.parameters.skip("aamode")
    even, odd = (shade(context, texture, name, default, depth) for name, default in (("tex1", 1.0), ("tex2", 0.0)))
    lying = _in_space(context, texture) if in_space else _mapping(context, texture)
    if even.texture is not None or odd.texture is not None:
        cells = Shade(np.full(3, 0.5), {"kind": "checker", "even": 0.0, "odd": 1.0} | lying)
        return _mixture(context, texture, even, odd, cells)
    keys = {"kind": "checker", "even": even.colour.tolist(), "odd": odd.colour.tolist()}
    return Shade((even.colour + odd.colour) / 2, keys | lying)


def _scale(context: Context, texture: Entity, depth: int) -> Shade:
    """Return the product of two textures: ``tex`` and ``scale`` in pbrt-v4, ``tex1`` and ``tex2`` in pbrt-v3."""
    first, second = (_factor(context, texture, name, depth) for name in _factor_names(texture))
    if first.texture is not None and second.texture is not None:
        return _mixture(context, texture, Shade(np.zeros(3)), first, second)
    if first.texture is None:
        first, second = second, first
    return first.scaled(second.colour)


def _factor_names(texture: Entity) -> tuple[str, str]:
    named = texture.parameters.has("tex") or texture.parameters.has("scale")
    return ("tex", "scale") if named else ("tex1", "tex2")


def _factor(context: Context, texture: Entity, name: str, depth: int) -> Shade:
    item = texture.parameters.get(name, "texture", *COLOURS)
    if item is not None and item.kind in ("float", "rgb", "color") and len(item.values) in (1, 3):
        return Shade(np.broadcast_to(np.asarray(item.values, np.float64), (3,)).copy())  # may exceed 1
    return shade(context, texture, name, 1.0, depth)


def _mix(context: Context, texture: Entity, depth: int) -> Shade:
    """Return a mixture; an amount that is a colour mixes each channel by its own share."""
    first, second = (shade(context, texture, name, default, depth) for name, default in (("tex1", 0.0), ("tex2", 1.0)))
    amount = number_shade(context, texture, "amount", 0.5)
    for part, other in ((first, 1 - amount.colour), (second, amount.colour)):
        if amount.texture is None and np.all(other == 1):
            return part
    parts = (first, second, amount)
    patterns = [part.texture for part in parts if part.texture is not None]
    if len(patterns) == 1 and (ends := _ENDS.get(patterns[0]["kind"])):
        return Shade(_mixed(*(part.colour for part in parts)), patterns[0] | _mixed_ends(parts, ends))
    if patterns:
        return _mixture(context, texture, first, second, amount)
    return Shade(_mixed(first.colour, second.colour, amount.colour))


def _mixed(first: Array, second: Array, amount: Array) -> Array:
    return np.asarray((1 - amount) * first + amount * second)


def _mixed_ends(parts: tuple[Shade, ...], ends: tuple[str, str]) -> Keys:
    """Return the two colours of a mixture of which one part lies between two."""
    defaults = {"low": np.zeros(3), "high": np.ones(3)}
    return {end: _mixed(*(part.colour if part.texture is None else np.array(part.texture.get(end, defaults.get(end)))
                          for part in parts)).tolist() for end in ends}  # fmt: skip


def _dots(context: Context, texture: Entity, depth: int) -> Shade:
    """Return spots on a ground; half of the cells of u and v have one, of radius 0.35.

    pbrt, in every version, passes "inside" for the ground and "outside" for the spots.
    """
    outside, inside = (
        shade(context, texture, name, default, depth) for name, default in (("inside", 1.0), ("outside", 0.0))
    )
    spots, lying = 0.5 * math.pi * 0.35**2, _mapping(context, texture)
    if inside.texture is not None or outside.texture is not None:
        cells = Shade(np.full(3, spots), {"kind": "dots", "inside": 1.0, "outside": 0.0} | lying)
        return _mixture(context, texture, outside, inside, cells)
    keys = {"kind": "dots", "inside": inside.colour.tolist(), "outside": outside.colour.tolist()}
    return Shade(spots * inside.colour + (1 - spots) * outside.colour, keys | lying)


def _noise(context: Context, texture: Entity, depth: int, form: str) -> Shade:
    """Return noise in space; pbrt leaves out octaves that are finer than a pixel, ours has them all."""
    lying, octaves, gain = _noise_keys(context, texture)
    keys: Keys = {"kind": "perlin", **({} if form == "sum" else {"form": form}), **lying}
    mean = 0.12 if form == "sum" else 0.03
    if form != "wind":
        keys |= {"octaves": octaves, "gain": gain}
    if form == "turbulence":
        mean = min(0.22 * sum(gain**octave for octave in range(octaves)) + 0.2 * gain**octaves, 1.0)
    return Shade(np.full(3, mean), keys)


def _noise_keys(context: Context, texture: Entity, scale: float = 1.0) -> tuple[Keys, int, float]:
    parameters = texture.parameters
    octaves = parameters.integer("octaves", 8)
    gain = parameters.number("roughness", 0.5)
    if not 1 <= octaves <= _MOST_OCTAVES or not 0 <= gain <= 1:
        context.approximated(texture, f"octaves cut to 1 … {_MOST_OCTAVES}, roughness to 0 … 1")
    return _in_space(context, texture, scale), min(max(octaves, 1), _MOST_OCTAVES), min(max(gain, 0.0), 1.0)


def _marble(context: Context, texture: Entity, depth: int) -> Shade:
    """Return marble, whose colours go on beyond their second piece in pbrt-v3."""
    lying, octaves, gain = _noise_keys(context, texture, texture.parameters.number("scale", 1.0))
    variation = texture.parameters.number("variation", 0.2)
    keys: Keys = {"kind": "marble", "octaves": octaves, "gain": gain, "variation": variation, **lying}
    if context.scene.version == 4:
        return Shade(_MARBLE[""], keys)
    context.approximated(texture, "its colours, which go beyond 1 in pbrt-v3, cut to 1 once they are mixed")
    return Shade(_MARBLE["pbrt-v3"], keys | {"form": "pbrt-v3"})


def _coordinates(context: Context, texture: Entity, depth: int) -> Shade:
    """Return u as red and v as green: a picture, whose texels hold what their centres have."""
    if "uv" not in context.pictures:
        steps = (np.arange(_UV_TEXELS) + 0.5) / _UV_TEXELS
        red, green = np.meshgrid(steps, steps[::-1])  # the top row is that of the largest v
        pixels = np.stack([red, green, np.zeros_like(red)], axis=-1)
        context.pictures["uv"] = name = context.files.add(
            "files", "uv.exr", partial(write_exr, {"RGB": pixels.astype(np.float32)})
        )
        context.greys[name, False] = partial(_write_numbers, context, "uv", texture.what, texture.place, pixels)
        context.report.noted(texture.place, f"{texture.what}: written as a picture, to {context.pictures['uv']}")
    keys = {"kind": "image", "file": context.pictures["uv"]}
    return Shade(np.array([0.5, 0.5, 0.0]), keys | _mapping(context, texture))


_KINDS: dict[str, Callable[[Context, Entity, int], Shade]] = {
    "constant": _constant, "imagemap": _image, "checkerboard": _checkerboard, "scale": _scale, "mix": _mix,
    "bilerp": _bilinear, "dots": _dots, "uv": _coordinates,
    "fbm": partial(_noise, form="sum"), "wrinkled": partial(_noise, form="turbulence"),
    "windy": partial(_noise, form="wind"), "marble": _marble, "ptex": _grey, "directionmix": _grey,
}  # fmt: skip
