"""Files that the scene of ours names: referenced where a scene may read them, copied beside it otherwise."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.colour import linear_from_srgb
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, MissingFileError, OutsideFolderError
from rptcam_cl.core.files import Folders
from rptcam_cl.exchange.pbrt.source import Place, Report, read_limited
from rptcam_cl.exchange.pbrt.world import Entity, PbrtScene
from rptcam_cl.scene.assets.pictures import LARGEST_PIXELS, SUFFIXES, read_picture, write_exr
from rptcam_cl.scene.load import Missing

LARGEST_COPY = 4 << 30


@dataclass
class FileStore:
    """Names of the files beside a scene, and what is to be written there once all is converted.

    Attributes
    ----------
    folder : Path
        Of the scene file of ours; a scene may read files below it only.
    stem : str
        Of its name: new files go to ``STEM_files/`` and ``STEM_meshes/``.
    """

    folder: Path
    stem: str
    report: Report
    _pending: dict[str, Callable[[Path], None]] = field(default_factory=dict)
    _copied: dict[Path, str] = field(default_factory=dict)
    _referenced: set[str] = field(default_factory=set)

    def reference(self, path: Path, place: Place, check: Callable[[Path], object] | None = None) -> str:
        """Return the name under which the scene of ours reads a file.

        Parameters
        ----------
        check
            Reads a file that is to be copied, and raises an InputError when it is not of the kind that is meant.

        Raises
        ------
        InputError
            When there is no such file, or not one of its kind.
        """
        real = self._real(path, place)
        home = self.folder.resolve()
        packed = real.suffix.lower() == ".gz"
        if real.is_relative_to(home) and not packed:
            name = real.relative_to(home).as_posix()
            if name in self._pending:
                raise place.error(
                    f"lies where a new file goes (got {name}; allowed: another name or folder for the scene)"
                )
            self._referenced.add(name)
            return name
        if real not in self._copied:
            if check is not None:
                _check_file(check, real, place)
            name = self.new_name("files", real.name.removesuffix(".gz") if packed else real.name)
            self._copied[real] = name
            self._pending[name] = lambda target: _copy(real, target)
            reason = "unpacked" if packed else "copied, as it lies outside the folder of the scene"
            self.report.noted(place, f"{path.name}: {reason}, to {name}")
        return self._copied[real]

    def new_name(self, kind: str, name: str) -> str:
        """Return a name below ``STEM_KIND/`` that nothing of this conversion has."""
        stem, dot, suffix = re.sub(r"[^\w.-]+", "-", name).rpartition(".")
        wanted = f"{self.stem}_{kind}/{stem or suffix}{dot}{suffix if stem else ''}".rstrip(".")
        count = 1
        taken = {name.lower() for name in (*self._pending, *self._referenced)}
        while wanted.lower() in taken:
            count += 1
            wanted = f"{self.stem}_{kind}/{stem}-{count}{dot}{suffix}"
        return wanted

    def add(self, kind: str, name: str, write: Callable[[Path], None]) -> str:
        """Return the name of a new file below ``STEM_KIND/``, to be written by a function of its path."""
        chosen = self.new_name(kind, name)
        self._pending[chosen] = write
        return chosen

    def stage(self, folder: Path) -> None:
        """Write the files below a folder, from which they are moved to their places once the whole is good.

        Parameters
        ----------
        folder
            An empty one beside the scene file.
        """
        for name, write in self._pending.items():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            write(target)

    def place(self, staged: Path) -> None:
        """Move the files that were staged to their places, each at once."""
        for name in self._pending:
            target = self.folder / name
            target.parent.mkdir(exist_ok=True)
            (staged / name).replace(target)

    def named_in(self, staged: Path, value: Any) -> Any:
        """Return a part of the scene in which new files have their names below the staging folder."""
        if isinstance(value, dict):
            return {key: self.named_in(staged, item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.named_in(staged, item) for item in value]
        if not isinstance(value, str) or value not in self._pending:
            return value
        return (staged / value).relative_to(self.folder).as_posix()

    def _real(self, path: Path, place: Place) -> Path:
        try:
            real = path.resolve()
            if not real.is_file():
                raise place.error(f"no such file (got {path})")
        except (OSError, ValueError, RuntimeError) as problem:
            raise place.error(f"is not a usable path ({problem})") from None
        return real


def _check_file(check: Callable[[Path], object], path: Path, place: Place) -> None:
    try:
        check(path)
    except InputError as problem:
        raise place.error(f"{path.name}: is not copied: {problem}") from None


def _copy(source: Path, target: Path) -> None:
    try:
        target.write_bytes(read_limited(source, str(source), LARGEST_COPY))
    except MemoryError:
        raise InputError(f"{source}: is too large to be copied") from None


# What every part of a conversion works with.


@dataclass
class Context:
    """The scene that is converted, and where things go.

    Attributes
    ----------
    folders : Folders
        Where files of the pbrt scene may lie; their names start at the folder of its file.
    files : FileStore
        Files of the scene of ours.
    missing : "error" or "grey"
        What becomes of pictures and meshes that are not there, or lie where the scene may not read.
    absent : list of str
        What there is to say of them.
    known : dict
        Textures by ``id`` that were converted before: one may be a part of many, and they of many more.
    pictures : dict
        Names of pictures that are written anew, by their path.
    world : (4, 4) array
        From the world of pbrt to that of the scene.
    """

    scene: PbrtScene
    report: Report
    folders: Folders
    files: FileStore = field(repr=False)
    missing: Missing = "error"
    absent: list[str] = field(default_factory=list)
    known: dict[int, object] = field(default_factory=dict, repr=False)
    pictures: dict[str, str] = field(default_factory=dict, repr=False)
    world: NDArray[np.float64] = field(default_factory=lambda: np.eye(4), repr=False)

    def approximated(self, entity: Entity, what: str, place: Place | None = None) -> None:
        """Report what of an entity the scene of ours has in another way; at a place of its own where one is given."""
        self.report.approximated(place or entity.place, f"{entity.what}: {what}")

    def ignored(self, entity: Entity, what: str, place: Place | None = None) -> None:
        """Report what of an entity the scene of ours does not have; at a place of its own where one is given."""
        self.report.ignored(place or entity.place, f"{entity.what}: {what}")

    def find(self, name: str, place: Place) -> Path:
        """Return the path of a file that the pbrt scene names.

        Raises
        ------
        InputError
            When there is no such file, it is no regular one, or lies outside the folder of the pbrt scene.
        """
        try:
            return self.folders.find(name)
        except InputError as problem:
            raise type(problem)(str(place.error(f"{name[:80]}: {problem}"))) from None

    def find_or_note(self, name: str, place: Place, otherwise: str) -> Path | None:
        """Return the path of a picture or mesh; None for one that cannot be had, after noting what stands in."""
        try:
            return self.find(name, place)
        except (MissingFileError, OutsideFolderError) as problem:
            if str(problem) not in self.absent:
                self.absent.append(str(problem))
            why = "no such file" if isinstance(problem, MissingFileError) else "lies outside the folder of the scene"
            self.report.approximated(place, f"{name[:80]}: {why}; {otherwise}")
            return None

    def refuse_missing(self) -> None:
        """Raise an error that names all files that are not there or lie elsewhere, if any are."""
        if self.absent and self.missing == "error":
            raise MissingFileError("\n".join(self.absent))


#
# The equal-area map between the sphere and a square, in which pbrt-v4 stores pictures of the sky.
#
# P. Clarberg, "Fast equal-area mapping of the (hemi)sphere using SIMD", Journal of Graphics Tools 13 (3), 2008: the
# upper half sphere fills the diamond in the middle of the square, the lower one its corners.

Array = NDArray[np.float64]

# Samples across and down each pixel of a picture in longitude and latitude.
SAMPLES = 4
TALLEST = 4096  # rows; twice as many columns are half of the pixels that a picture may have


def square_of_angles(z: ArrayLike, longitude: ArrayLike) -> tuple[Array, Array]:
    """Return the coordinates, 0 to 1 from the left and from the top, of directions.

    Parameters
    ----------
    z
        Cosine of the angle from the pole +z, which is the middle of the square.
    longitude
        Angle from +x over +y [rad].
    """
    height = np.asarray(z, np.float64)
    x, y = np.cos(longitude), np.sin(longitude)
    radius = np.sqrt(np.clip(1 - np.abs(height), 0, 1))
    v = radius * (np.arctan2(np.abs(y), np.abs(x)) * (2 / np.pi))
    u = radius - v
    below = height < 0
    u, v = np.where(below, 1 - v, u), np.where(below, 1 - u, v)
    return (np.copysign(u, x) + 1) / 2, (np.copysign(v, y) + 1) / 2


def heights(size: int) -> Array:
    """Return z of the directions of the pixels' centres of a square picture, (size, size)."""
    a = np.abs(2 * (np.arange(size) + 0.5) / size - 1)
    above = 1 - (a[:, None] + a[None, :])
    return np.asarray(np.copysign(1 - (1 - np.abs(above)) ** 2, above))


def in_longitude_and_latitude(square: NDArray[np.float32], *, clockwise: bool) -> NDArray[np.float32]:
    """Return a square picture of the sphere as one in longitude and latitude, twice as wide as high.

    Each pixel is the mean of `SAMPLES` x `SAMPLES` pixels that lie under it, spread evenly in longitude and latitude.

    Parameters
    ----------
    square : (n, n, 3) array
    clockwise
        Whether longitude falls from the left edge to the right one; it is 180 degrees in the middle either way.
    """
    size = len(square)
    rows = min(size, TALLEST)
    longitude = (np.arange(2 * rows * SAMPLES) + 0.5) / (2 * rows * SAMPLES) * (2 * np.pi)
    if clockwise:
        longitude = longitude[::-1]
    converted = np.empty((rows, 2 * rows, 3), np.float32)
    for row in range(rows):
        latitude = np.pi * (row + (np.arange(SAMPLES) + 0.5) / SAMPLES) / rows
        u, v = square_of_angles(np.cos(latitude)[:, None], longitude[None, :])
        column = np.minimum((u * size).astype(np.intp), size - 1)
        line = np.minimum((v * size).astype(np.intp), size - 1)
        samples = square[line, column].reshape(SAMPLES, 2 * rows, SAMPLES, 3)
        converted[row] = samples.mean(axis=(0, 2), dtype=np.float64)
    return converted


# Pictures of pbrt scenes: those that ours reads by their name, TGA and PFM files in another format.

Pixels = NDArray[np.float32]

# Kinds of pictures that pbrt reads and ours does not, and all that are converted.
OTHERS = (".tga", ".pfm")
READABLE = (*SUFFIXES, *OTHERS)
NOT_READ = "a kind of picture that is not read"
_PFM = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+.\deE]{1,30})\s")
_LARGEST_FILE = 16 * LARGEST_PIXELS


def is_readable(path: Path) -> bool:
    """Return whether a picture can be shown, by its suffix."""
    return path.suffix.lower() in READABLE


def picture_name(context: Context, path: Path, place: Place) -> str:
    """Return the name under which the scene of ours reads a picture; one of another kind is written anew."""
    suffix = path.suffix.lower()
    if suffix not in OTHERS:
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


def mean_colour(path: Path, place: Place, *, linear: bool) -> NDArray[np.float64]:
    """Return the mean of a picture's linear colours; bytes are sRGB unless they are linear."""
    texels = _texels(path, place)
    if texels.dtype != np.uint8:
        return np.asarray(texels.mean(axis=(0, 1), dtype=np.float64))
    return np.asarray((texels / 255 if linear else _decode_srgb(texels)).mean(axis=(0, 1), dtype=np.float64))


def _texels(path: Path, place: Place) -> NDArray[Any]:
    """Return the colours of a picture as it stores them, (height, width, 3)."""
    if path.suffix.lower() == ".pfm":
        return _pfm(path, place)
    if path.suffix.lower() == ".tga":
        return _tga(path, place)[..., :3]
    try:
        return read_picture(path).texels[..., :3]
    except InputError as problem:
        raise place.error(f"{path.name}: {problem}") from None


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
