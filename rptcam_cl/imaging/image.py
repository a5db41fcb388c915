"""A rendered film with its metadata and layers, and the pictures and videos that are developed from it."""

from __future__ import annotations

import io
import json
import math
import os
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rptcam_cl.core import files
from rptcam_cl.core.colour import PRIMARIES, luminance, srgb_from_primaries
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError, near_name
from rptcam_cl.imaging import formats, writers
from rptcam_cl.imaging.development import GUIDES, PLAIN, SensorModel, denoise, developed_values, expose, quantise
from rptcam_cl.scene.film import LIGHT_LAYER, PictureSettings
from rptcam_cl.scene.load import load_picture

# A rendered film with its metadata, statistics and layers, and the pictures that are developed from it.

SENSOR = "sensor"  # where metadata keep the sensor behind the film


@dataclass(frozen=True, eq=False)
class Image:
    """The linear film of a render. ``numpy.asarray(image)`` is `pixels`; a notebook shows it as a picture.

    ``image["depth"]`` is the layer of that name.

    Raises
    ------
    InputError
        The pixels are not float32 of shape (height, width, 3), or a layer is unknown or of another size.
    """

    pixels: NDArray[np.float32]
    """(height, width, 3), linear RGB, top row first."""
    metadata: dict[str, Any] = field(default_factory=dict)
    """Where the picture comes from (scene hash, seed, spp, lens, device, version, ...); kept in the files."""
    stats: dict[str, Any] = field(default_factory=dict)
    """What the render took and met (samples, seconds, rays that the lens blocked, ...)."""
    development: PictureSettings = PLAIN
    """How the film is developed where it is shown or saved as a picture."""
    layers: Mapping[str, writers.Layer] = field(default_factory=dict)
    """Auxiliary layers by name, (height, width) or (height, width, channels)."""

    def __post_init__(self) -> None:
        shape, kind = np.shape(self.pixels), getattr(self.pixels, "dtype", type(self.pixels).__name__)
        if len(shape) != 3 or shape[2] != 3 or 0 in shape:
            raise InputError(f"pixels: wrong shape (got {shape}; allowed (height, width, 3))")
        if kind != np.float32:
            raise InputError(f"pixels: wrong kind of numbers (got {kind}; allowed a numpy array of float32)")
        writers.check_layers(self.layers, self.height, self.width)

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.pixels.shape[1])

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.pixels.shape[0])

    @property
    def luminance(self) -> NDArray[np.float64]:
        """Luminance of the film, (height, width), linear."""
        return np.asarray(luminance(self.pixels))

    @cached_property
    def seen(self) -> NDArray[np.float32]:
        """What pictures show, (height, width, 3), linear: what the scene's sensor makes of the film, or the film."""
        return self.raw().linear() if self.has_sensor else self.pixels

    @property
    def has_sensor(self) -> bool:
        """Whether a sensor is behind the film."""
        return SENSOR in self.metadata

    def raw(self) -> formats.RawImage:
        """Return the numbers that the scene's sensor puts out for this film; the same ones each time.

        Raises
        ------
        InputError
            The scene has no sensor.
        """
        if not self.has_sensor:
            raise InputError("the image has no raw numbers (allowed: with a sensor in the scene, as `sensor: {}`)")
        return self._raw

    @cached_property
    def _raw(self) -> formats.RawImage:
        sensor = SensorModel.from_description(self.metadata[SENSOR])
        return formats.RawImage(expose(self.pixels, sensor), sensor, self.metadata)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save by suffix.

        ``.png``, ``.tif`` and ``.tiff``: developed, of 8 or 16 bits. ``.jpg`` and ``.jpeg``: developed, of 8 bits, with
        losses. ``.exr``: linear, with layers and metadata.
        ``.npy``: the linear array alone. ``.npz``: the linear array as ``rgb``, every layer by its name, and
        ``metadata`` as JSON text.

        The file is written whole or not at all.

        Raises
        ------
        InputError
            The suffix is not one of these.
        StateError
            The file cannot be written.
        """
        pixels = self.seen if writers.is_developed(path) else self.pixels
        writers.write(path, pixels, self.metadata, self.development, self.layers)

    def developed(self) -> NDArray[np.float32]:
        """Return the picture as a screen shows it, (height, width, 3) from 0 to 1; see docs/picture.md."""
        return developed_values(self.seen, self.development, writers.film_part(self.metadata, self.seen))

    def denoised(self) -> Image:
        """Return the image with its noise removed, guided by its layers ``albedo`` and ``normal``; see docs/layers.md.

        Raises
        ------
        InputError
            A layer is missing, or the denoiser is.
        """
        if missing := [name for name in GUIDES if name not in self.layers]:
            raise InputError(f"denoising needs the layers {' and '.join(GUIDES)} (missing: {', '.join(missing)})")
        pixels, how = denoise(self.pixels, self["albedo"], self["normal"])
        stated = {"denoised": how}
        return replace(self, pixels=pixels, metadata=self.metadata | stated, stats=self.stats | stated)

    def coco(self, file_name: str = "picture.png", *, image_id: int | None = None) -> dict[str, Any]:
        """Return COCO annotations by the layers ``sharp_object_id`` and ``sharp_class_id``; see docs/ground-truth.md.

        Parameters
        ----------
        file_name
            Of the picture.
        image_id
            Its number, 0 or more, among pictures whose annotations are to be joined; each has identifiers of its own.

        Raises
        ------
        InputError
            A layer is missing.
        """
        return writers.coco(self.layers, self.metadata, file_name, image_id)

    def save_truth(
        self,
        folder: str | os.PathLike[str],
        file_name: str = "picture.png",
        *,
        image_id: int | None = None,
        prefix: str = "",
    ) -> list[Path]:
        """Write COCO annotations, masks and the rays of pixels into a folder, and return the files.

        Parameters
        ----------
        folder
            Made if it is missing.
        file_name, image_id
            As for `coco`.
        prefix
            What the names of the files begin with.

        Raises
        ------
        InputError
            A layer is missing.
        StateError
            A file cannot be written.
        """
        return writers.save_truth(Path(folder), self.layers, self.metadata, file_name, image_id=image_id, prefix=prefix)

    def __getitem__(self, name: str) -> writers.Layer:
        try:
            return self.layers[name]
        except KeyError:
            held = ", ".join(self.layers) or 'none; name them when rendering, as layers=["depth"]'
            raise KeyError(f"no layer {name!r} (layers of this image: {held})") from None

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False and dtype is not None and np.dtype(dtype) != self.pixels.dtype:
            raise ValueError(f"the film is float32; {np.dtype(dtype)} needs a copy")
        return np.array(self.pixels, dtype=dtype) if copy else np.asarray(self.pixels, dtype=dtype)

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        writers.png_to(stream, self.seen, self.metadata, self.development, writers.PNG_BITS, self.layers)
        return stream.getvalue()

    def __repr__(self) -> str:
        mean, spp = self.metadata.get("spp_mean"), self.metadata.get("spp")
        spp = f"{mean:.0f}" if isinstance(mean, float) else spp
        return f"<Image {self.width} x {self.height}" + (f", {spp} spp>" if spp is not None else ">")


# Linear films that were saved: OpenEXR and NumPy files with their metadata, to be developed anew.

_NAME = re.compile(r"[A-Za-z]\w{0,60}", re.ASCII)  # of metadata, which become keys in all formats
LARGE = 1 << 26  # pixels of a film, from which on small files may be meant to keep a machine busy
NEEDED = 3  # times its own size, to read and to develop a film; measured at 48 million pixels
_CLOSE = 1e-3  # in chromaticity: programs round those of sRGB differently


def read_film(path: str | os.PathLike[str], *, most_pixels: int | None = None) -> Image:
    """Return the film of a file with its metadata; of layers lamps, with `GUIDES`, and the coverage of an alpha.

    Parameters
    ----------
    most_pixels
        Of a film that is read; by its head alone, larger ones are refused.

    Raises
    ------
    InputError
        The file is none of these formats, is damaged, or has primaries of none of the spaces that films are written in.
    StateError
        The file cannot be read.
    """
    suffix = files.known_suffix(path, files.FILM_SUFFIXES, "is no linear film")
    try:
        size, pixels_there = _size(path, suffix)
        if most_pixels is not None and pixels_there > most_pixels:
            has, most = pixels_there / 1e6, most_pixels / 1e6
            raise InputError(f"has {has:.4g} million pixels (allowed: {most:.4g}, or any with --large)")
        _check_memory(size)
        pixels, metadata, alpha, lights = _exr(path) if suffix == ".exr" else _numpy(path)
        known = metadata.items() if isinstance(metadata, dict) else ()
        layers = lights | ({} if alpha is None else {"coverage": np.asarray(alpha, np.float32)})
        named = {key: value for key, value in known if _NAME.fullmatch(key)}
        return Image(np.asarray(pixels, np.float32), named, layers=layers)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from None
    except OSError as problem:
        raise StateError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    except Exception as problem:  # numpy, zipfile, tokenize and OpenEXR raise nearly anything for a damaged file
        raise InputError(f"{path}: is damaged, or holds no film ({str(problem) or type(problem).__name__})") from None


def _size(path: str | os.PathLike[str], suffix: str) -> tuple[int, int]:
    """Return how many bytes the film of a file takes in memory, and its pixels, by its head, without unpacking it."""
    if suffix == ".exr":
        import OpenEXR

        with Path(path).open("rb"):
            pass  # the library's own words for a file that is not there name no reason
        with files.utf8_name(path) as name, OpenEXR.File(name, separate_channels=True, header_only=True) as file:
            header = dict(file.header())
        (left, top), (right, bottom) = header["dataWindow"]
        count = max(0, int(right) - int(left) + 1) * max(0, int(bottom) - int(top) + 1)
        return count * 4 * len(header["channels"]), count  # all channels of the file are read, at most 4 bytes each
    with Path(path).open("rb") as file:
        if not zipfile.is_zipfile(file):
            file.seek(0)
            return _bytes_of_array(file)
        with zipfile.ZipFile(file) as archive:
            wanted = [name for name in ("rgb.npy", "metadata.npy") if name in archive.namelist()]
            sizes = [(0, 0)]
            for name in wanted:
                with archive.open(name) as member:
                    sizes.append(_bytes_of_array(member))
            return sum(size for size, _ in sizes), max(count for _, count in sizes)


def _bytes_of_array(stream: IO[bytes]) -> tuple[int, int]:
    """Return the bytes of an array, and its pixels if it is a film, by the head of its file (``numpy.lib.format``)."""
    major, _ = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return math.prod(shape) * dtype.itemsize, math.prod(shape[:2])


def _check_memory(size: int) -> None:
    """Refuse a film whose development takes more memory than the machine has free."""
    free = files.free_host_bytes()
    if free is not None and size * NEEDED > free:
        raise InputError(
            f"takes {size * NEEDED / 1e9:.3g} GB to develop, and {free / 1e9:.3g} GB of memory are free"
            " (allowed: a smaller film, as of a part with crop)"
        )


Film = tuple[NDArray[Any], dict[str, Any], NDArray[Any] | None, dict[str, NDArray[Any]]]
"""Pixels, metadata, the coverage of a picture without a background, and the light of groups of lamps with `GUIDES`."""


def _numpy(path: str | os.PathLike[str]) -> Film:
    held = np.load(path, allow_pickle=False)
    if isinstance(held, np.ndarray):
        return held, {}, None, {}
    with held:
        metadata = json.loads(str(held["metadata"])) if "metadata" in held else {}
        lights = {name: held[name] for name in held.files if name.startswith(LIGHT_LAYER)}
        lights |= {name: held[name] for name in GUIDES if lights and name in held}
        alpha = held["coverage"] if _is_transparent(metadata) and "coverage" in held else None
        return held["rgb"], metadata, alpha, lights


def _is_transparent(metadata: object) -> bool:
    return isinstance(metadata, dict) and metadata.get("transparent") is True


def _exr(path: str | os.PathLike[str]) -> Film:
    import OpenEXR

    with files.utf8_name(path) as name, OpenEXR.File(name, separate_channels=True) as file:
        header = dict(file.header())  # the file empties its own when it closes
        channels = file.channels()
        planes = [channels[name].pixels for name in "RGB"]
        alpha = channels["A"].pixels if "A" in channels else None
        layers = {each.removesuffix(".R") for each in channels if each.startswith(LIGHT_LAYER) and each.endswith(".R")}
        planes_of = {layer: tuple(f"{layer}.{colour}" for colour in "RGB") for layer in sorted(layers)}
        planes_of |= {name: writers.CHANNELS[name] for name in GUIDES if layers}
        lights = {
            layer: np.stack([channels[each].pixels for each in names], axis=-1)
            for layer, names in planes_of.items()
            if channels.keys() >= set(names)
        }
    matrix = _matrix_of(header.get("chromaticities"))
    text = header.get(formats.ALL_METADATA)
    metadata = json.loads(text) if isinstance(text, str) else formats.from_exr_attributes(header)
    pixels = np.stack(planes, axis=-1)
    if matrix is not None:
        pixels = pixels @ matrix
        lights = {name: values if name == "normal" else values @ matrix for name, values in lights.items()}
    return pixels, metadata, alpha if _is_transparent(metadata) else None, lights


def _matrix_of(chromaticities: Any) -> NDArray[np.float64] | None:
    """Return the matrix that takes rows of colours of a film to sRGB's primaries; None where they have them.

    Raises
    ------
    InputError
        They are of none of the spaces in which films are written.
    """
    if chromaticities is None:
        return None
    for name, (primaries, white) in PRIMARIES.items():
        if np.allclose(np.ravel(chromaticities), np.ravel([*primaries, white]), atol=_CLOSE):
            return None if name == "rec709" else srgb_from_primaries(primaries, white).T
    got = ", ".join(f"{number:.4g}" for number in np.ravel(chromaticities))
    raise InputError(
        f"has primaries that films are not read with (got {got}; allowed those of {files.listed(PRIMARIES)})"
    )


#
# Anamorphic pictures made wide again: a film that a lens has squeezed sideways, on as many more columns.
#
# Every new column is the mean of the film over what it covers (box integration), so that light is kept: the mean of
# the picture stays, and a film that is even across stays so.

LEAST, MOST = 1.0, 4.0
_OF_PIXELS = ("window", "resolution", "intrinsics", SENSOR)  # metadata of the pixels as they were


def desqueezed(image: Image, factor: float) -> Image:
    """Return an image that is wider by a factor, with metadata ``desqueezed``; its layers stay behind.

    Parameters
    ----------
    image
        Rendered through a lens that squeezes.
    factor
        By which: the ratio of its focal lengths, up and down over across. The width is rounded to whole columns.

    Raises
    ------
    InputError
        For a factor out of range, or a film that was desqueezed before.
    """
    if not LEAST <= factor <= MOST:
        raise InputError(f"desqueeze: is out of range (got {factor:g}; allowed: {LEAST:g} to {MOST:g})")
    if "desqueezed" in image.metadata:
        raise InputError("desqueeze: the film was desqueezed before (allowed: once)")
    width = max(round(image.width * factor), 1)
    metadata = {key: value for key, value in image.metadata.items() if key not in _OF_PIXELS}
    pixels = _resample(image.seen, width)  # a sensor counts the pixels that are squeezed
    alpha = writers.alpha_of(image.metadata, image.layers)
    layers = {} if alpha is None else {"coverage": _resample(alpha[..., None], width)[..., 0]}
    return replace(image, pixels=pixels, metadata=metadata | {"desqueezed": width / image.width}, layers=layers)


def _resample(pixels: NDArray[np.float32], width: int) -> NDArray[np.float32]:
    """Return rows of as many columns or more, each the mean of the one or two that it covers."""
    columns = pixels.shape[1]
    # Whole numbers, in parts of 1 / width of a column: each new one has `columns` of them, from `starts` on.
    starts = np.arange(width, dtype=np.int64) * columns
    first = starts // width
    share = np.minimum((first + 1) * width - starts, columns)[:, None] / columns
    beside = pixels[:, np.minimum(first + 1, columns - 1)]
    beside = np.where(share < 1, beside, 0)  # what is not covered does not count, be it no number
    return np.asarray(share * pixels[:, first] + (1 - share) * beside, dtype=np.float32)


# Developing films as the picture settings of a scene say: when rendered, or later without rendering anew.

SETTINGS = "picture"  # where metadata keep what a scene says of the picture


def develop(
    film: Image | str | os.PathLike[str],
    overrides: Iterable[str] = (),
    *,
    folders: files.Folders | None = None,
    **settings: Any,
) -> Image:
    """Return an image of the same film that develops with other settings, or with its lamps brighter or darker.

    Parameters
    ----------
    film
        A rendered image, or a file of one (``.exr``, ``.npy``, ``.npz``).
    overrides
        Settings as text, ``picture.tone=agx``, and factors on the light of groups of lamps, ``lights.key=0.5``.
    folders
        Where the files that settings name may lie; by default the working folder, where their names start, and the
        film's. Those that the image was rendered with are known.
    **settings
        Keys of ``picture`` in scene files: ``tone="agx"``, ``white_balance={"temperature_k": 3200}``, ``ev=1``. Those
        not given stay as they are in the film's metadata.

    Raises
    ------
    InputError
        A setting is wrong, or the file holds no film.
    StateError
        The file cannot be read.
    """
    image = film if isinstance(film, Image) else read_film(film)
    overrides = list(overrides)
    factors = [text for text in overrides if text.startswith(LIGHT_LAYER)]
    if factors:
        image = relit(image, dict(_factor_of(text) for text in factors))
        overrides = [text for text in overrides if text not in factors]
    known = image.metadata.get(SETTINGS)
    if folders is None and not isinstance(film, Image):
        folders = folders_of_film(film)
    given = {**(known if isinstance(known, dict) else {}), **settings}
    picture = load_picture(given, overrides, folders=folders, before=image.development)
    return with_picture_settings(image, picture)


def folders_of_film(film: str | os.PathLike[str]) -> files.Folders:
    """Return where files may lie that the picture settings of a film name: in the working folder, or in the film's."""
    return files.Folders(allowed=(Path(film).absolute().parent,), owner="film")


_RELIT = "relit"  # where metadata keep the factors on the light of groups of lamps
_MOST_FACTOR = 1e6


def relit(image: Image, factors: Mapping[str, float | Sequence[float]]) -> Image:
    """Return an image with the light of groups of lamps brighter, darker or of another colour, as if rendered so.

    A film whose noise was removed is denoised anew, by its layers ``albedo`` and ``normal``.

    Parameters
    ----------
    image
        Rendered with the layer ``lights``.
    factors
        On the light as rendered, by the name of the group: a number of at least 0, or three of red, green and blue.
        Groups that are not named stay as they are.

    Raises
    ------
    InputError
        There is no such group, or a factor is out of range; or what denoises the film is missing.
    """
    before = image.metadata.get(_RELIT, {})
    known = [name.removeprefix(LIGHT_LAYER) for name in image.layers if name.startswith(LIGHT_LAYER)]
    if not known:
        raise InputError("lights: the film does not keep the light of its lamps apart (render it with --layers lights)")
    for name, factor in factors.items():
        if name not in known:
            raise InputError(f"lights.{name}: no such group{near_name(name, known)} (allowed: {', '.join(known)})")
        wanted = np.broadcast_to(np.asarray(factor, np.float64), 3) if np.size(factor) in (1, 3) else np.full(3, np.nan)
        if not ((wanted >= 0) & (wanted <= _MOST_FACTOR)).all():
            raise InputError(
                f"lights.{name}: is no factor (got {factor}; allowed: 0 to {_MOST_FACTOR:g}, or three such)"
            )
    pixels = mixed(image.pixels, image.layers, factors, before)
    kept = before | {name: np.asarray(factor, np.float64).tolist() for name, factor in factors.items()}
    if "denoised" in image.metadata:  # of layers that are not
        pixels = mixed(np.zeros_like(pixels), image.layers, dict.fromkeys(known, 1.0) | kept, dict.fromkeys(known, 0.0))
    lit = replace(image, pixels=pixels, metadata=image.metadata | {_RELIT: kept})
    return lit.denoised() if "denoised" in image.metadata else lit


def mixed(
    pixels: NDArray[np.float32],
    layers: Mapping[str, NDArray[Any]],
    factors: Mapping[str, Any],
    before: Mapping[str, Any] = MappingProxyType({}),
) -> NDArray[np.float32]:
    """Return a film (height, width, 3) with the light of groups of lamps, which layers hold, times factors.

    ``before`` are factors that the film has already.
    """
    exact = pixels.astype(np.float64)
    for name, factor in factors.items():
        exact += (np.asarray(factor, np.float64) - before.get(name, 1.0)) * layers[f"{LIGHT_LAYER}{name}"]
    return exact.astype(np.float32)


def _factor_of(text: str) -> tuple[str, Any]:
    name, equals, value = text.removeprefix(LIGHT_LAYER).partition("=")
    try:
        factor = json.loads(value)
    except ValueError:
        factor = None
    numbers = factor if isinstance(factor, list) else [factor]
    if not equals or isinstance(factor, bool) or not all(isinstance(each, int | float) for each in numbers):
        raise InputError(
            f"{text}: is no factor on a group of lamps (allowed: as lights.key=0.5 or lights.key=[1,0.8,0.6])"
        )
    return name, factor


def with_picture_settings(image: Image, picture: PictureSettings) -> Image:
    """Return an image that develops by the picture settings of a scene, which its metadata keep."""
    kept = picture.model_dump(mode="json", exclude_defaults=True)
    others = {key: value for key, value in image.metadata.items() if key != SETTINGS}
    metadata = others | ({SETTINGS: kept} if kept else {})
    return replace(image, metadata=metadata, development=development_of(picture, metadata))


def development_of(picture: PictureSettings, metadata: Mapping[str, Any]) -> PictureSettings:
    """Picture settings with the adaptation of the white balance that suits a film with such metadata."""
    balance = picture.white_balance
    # Light of RGB has multiplied reflectances channel by channel, and dividing so undoes it exactly; light of spectra
    # has not.
    if balance is None or balance.adaptation is not None or metadata.get("spectrum") != "spectral":
        return picture
    return picture.model_copy(update={"white_balance": balance.model_copy(update={"adaptation": "bradford"})})


# Videos of developed pictures, by PyAV (the extra ``video``).

# By suffix: container, codec, its pixels, and its options. ProRes 422 HQ of 10 bits; FFV1 without loss.
FORMATS: dict[str, tuple[str, str, str, dict[str, str]]] = {
    ".mov": ("mov", "prores_ks", "yuv422p10le", {"profile": "3"}),
    ".mkv": ("matroska", "ffv1", "gbrp16le", {"level": "3"}),
    ".mp4": ("mp4", "libx264", "yuv420p", {"crf": "16", "preset": "slow"}),
    ".webm": ("webm", "libsvtav1", "yuv420p10le", {"crf": "24"}),
}
_EXACT = {"fflags": "+bitexact"}  # else Matroska draws numbers at random for each file
_CLOCK = 1_000_000  # denominators of frame rates, at most

# Numbers of ITU-T H.273. Players take what is not said for either of two matrices, by the height of the picture.
_REC_709, _SRGB_CURVE, _NO_CURVE, _UNSAID, _RGB = 1, 13, 8, 2, 0
_LIMITED, _FULL = 1, 2  # ranges, as FFmpeg numbers them


def check_video(path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise an error, before anything is rendered, when a video could not be written.

    Raises
    ------
    InputError
        The suffix is unknown, or PyAV or its codec is not there.
    StateError
        The file cannot be written.
    """
    suffix = files.known_suffix(path, FORMATS, "is no video")
    try:
        import av
    except ImportError:
        raise InputError(f'{path}: videos need PyAV (pip install "rptcam_cl[video]")') from None
    if FORMATS[suffix][1] not in av.codecs_available:
        raise InputError(f"{path}: this PyAV has no codec {FORMATS[suffix][1]} (allowed: another suffix)")
    files.check_writable(path, inputs)


def write_video(path: str | os.PathLike[str], images: Iterable[Image], frames_per_second: float) -> int:
    """Write the developed pictures as a video, whole or not at all; return how many.

    A column or a row is left out where the codec needs an even number of them.

    Raises
    ------
    InputError
        As `check_video`, or a picture is of another size than the first.
    StateError
        The file cannot be written.
    """
    check_video(path)
    import av

    container, codec, kind, options = FORMATS[Path(path).suffix.lower()]
    count = 0
    with files.replacing(path) as temporary:
        try:
            with av.open(str(temporary), "w", format=container, options=_EXACT) as file:
                stream: Any = None
                for image in images:
                    codes = quantise(image.developed(), 16).astype(np.uint16)
                    codes = np.ascontiguousarray(codes[: len(codes) // 2 * 2, : codes.shape[1] // 2 * 2])
                    if codes.size == 0:
                        got = f"got {image.width} x {image.height}; allowed: at least 2 x 2"
                        raise InputError(f"{path}: pictures of a video need more pixels ({got})")
                    if stream is None:
                        rate = Fraction(frames_per_second).limit_denominator(_CLOCK)
                        stream = file.add_stream(codec, rate=rate, options=options)
                        stream.width, stream.height, stream.pix_fmt = codes.shape[1], codes.shape[0], kind
                        curve = {True: _SRGB_CURVE, False: _NO_CURVE, None: _UNSAID}[image.development.is_encoded]
                        _say_colours(stream.codec_context, curve, is_rgb=kind.startswith("gbr"))
                    if codes.shape[:2] != (stream.height, stream.width):
                        raise InputError(f"{path}: pictures of a video have one size")
                    file.mux(stream.encode(_frame(codes, kind)))
                    count += 1
                if stream is None:
                    raise InputError(f"{path}: a video needs at least one picture")
                file.mux(stream.encode())
        except av.FFmpegError as problem:
            raise StateError(f"{path}: cannot be written: {problem}") from problem
    return count


def _say_colours(codec: Any, curve: int, *, is_rgb: bool) -> None:
    """Write into a video how its numbers are to be understood."""
    codec.color_primaries, codec.color_trc = _REC_709, curve
    codec.colorspace, codec.color_range = (_RGB, _FULL) if is_rgb else (_REC_709, _LIMITED)


def _frame(codes: NDArray[np.uint16], kind: str) -> Any:
    """Return codes (height, width, 3) as a frame of the codec's pixels, by the matrix that `_say_colours` names.

    By one thread: where FFmpeg's filters share a picture among several, one in some hundred has a few other bits.
    """
    import av

    frame = av.VideoFrame.from_ndarray(codes, format="rgb48le")
    if kind.startswith("gbr"):
        return frame.reformat(format=kind, threads=1)
    return frame.reformat(format=kind, dst_colorspace=_REC_709, dst_color_range=_LIMITED, threads=1)
