"""Wavefront OBJ files: polygons with texture coordinates and normals, and the materials they name."""

from __future__ import annotations

import codecs
import math
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import colour, files
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets import mesh
from rptcam_cl.scene.file_materials import FileMaterial, FileTexture, Wrap
from rptcam_cl.scene.quantities import Colour

# MTL files: the materials that OBJ files name.

MOST_BYTES = 16_000_000

# Values that follow an option of a texture line.
_OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-texres": 1, "-bm": 1, "-boost": 1, "-type": 1,
    "-mm": 2, "-o": 3, "-s": 3, "-t": 3, "-colorspace": 1,
}  # fmt: skip
_UP_TO = {"-o", "-s", "-t"}  # these take one to three numbers
_PHYSICAL = {"pr", "pm", "map_pr", "map_pm"}
GLASS = (4, 6, 7, 9)  # illumination models with transparency by refraction
# What has no counterpart; numbers of 0 among them do nothing, nor do options of their usual values.
_LEFT_OUT = ("map_ks", "map_ns", "refl", "map_refl", "pc", "map_pc", "pcr", "map_pcr", "ps", "map_ps", "aniso", "decal",
             "map_tf", "map_ni")  # fmt: skip
# Scalar textures are the luminance of their pictures (Alias|Wavefront, FILE FORMATS 4.2, 1995: -imfchan by default).
_SCALAR = ("map_d", "map_pr", "map_pm")
_USUAL = {"-mm": ("0 1",), "-imfchan": ("m", "l"), "-cc": ("off",), "-t": ("0 0 0",)}

Lines = dict[str, tuple[int, list[str]]]


def _read_mtl(path: Path) -> dict[str, FileMaterial]:
    """Return the materials of an MTL file by their names.

    Raises
    ------
    InputError
        When a value cannot be read.
    """
    with files.name_errors(path):
        content = files.read_whole(path, MOST_BYTES)
    materials: dict[str, Lines] = {}
    current: Lines | None = None
    text = _as_utf8(BytesIO(content)).read().decode("utf-8", "replace")
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if words[0] == "newmtl":
            current = materials.setdefault(" ".join(words[1:]), {})
        elif current is None:
            raise InputError(f"{path}:{number}: is not in a material (got {line.strip()[:60]!r}; allowed: newmtl NAME)")
        else:
            current[words[0].lower()] = (number, words[1:])
    for what in sorted({what for lines in materials.values() for what in _idle_words(lines)}):
        warnings.warn(f"{path}: {what} is left out", stacklevel=2)
    return {name: _Material(path, lines).material(name) for name, lines in materials.items()}


def _idle_words(lines: Lines) -> Iterator[str]:
    """Yield the keys and the options of textures of a material that count for nothing here and would elsewhere."""
    for key, (_, words) in lines.items():
        if key in _LEFT_OUT and words and not (_is_number(words[0]) and float(words[0]) == 0):
            yield key
        for place, word in enumerate(words):
            given = " ".join(words[place + 1 : place + 1 + _OPTIONS.get(word, 0)])
            if word in _USUAL and given not in _USUAL[word]:
                yield f"{word} of {key}"


class _Material:
    """The lines of one material."""

    def __init__(self, path: Path, lines: Lines) -> None:
        self._path = path
        self._lines = lines

    def material(self, name: str) -> FileMaterial:
        """Read the material."""
        model = int(self._number("illum", 2))
        gloss = self._colour("ks", (0.0, 0.0, 0.0))
        exponent = max(0.0, self._number("ns", 0.0))
        heights = next((key for key in ("map_bump", "bump", "disp", "map_disp") if key in self._lines), "")
        if heights in ("disp", "map_disp"):
            warnings.warn(f"{self._path}: {heights} of {name} is shown as bumps; nothing is moved", stacklevel=2)
        plain = FileMaterial(
            name=name,
            base_color=self._colour("kd", (0.8, 0.8, 0.8)),
            base_texture=self._texture("map_kd"),
            matte=(model < 2 or max(gloss) == 0) and not _PHYSICAL & self._lines.keys(),
            metallic=self._share("pm", float("map_pm" in self._lines)),
            metallic_texture=self._texture("map_pm"),
            roughness=self._share("pr", 1.0 if "map_pr" in self._lines else (2 / (exponent + 2)) ** 0.25),
            roughness_texture=self._texture("map_pr"),
            opacity=self._share("d", 1.0) if "d" in self._lines else min(1.0, max(0.0, 1 - self._number("tr", 0.0))),
            opacity_texture=self._texture("map_d"),
            normals=self._texture("norm") or self._texture("map_norm"),
            bumps=self._texture(heights),
            bumps_height=self._factor(heights, "-bm"),
            emission=self._colour("ke", (1.0,) * 3 if "map_ke" in self._lines else (0.0,) * 3, most=math.inf),
            emission_texture=self._texture("map_ke"),
            both_sides=True,
            index=self._number("ni", 1.5),
        )
        return self._with_model(plain, model, gloss)

    def _with_model(self, plain: FileMaterial, model: int, gloss: Colour) -> FileMaterial:
        """Return the material with what the illumination model says: glass, or a mirror where nothing is diffuse."""
        if model in GLASS:
            tf = self._colour("tf", (1.0, 1.0, 1.0))
            return replace(plain, matte=False, base_color=tf, base_texture=None, transmission=1, solid=True, opacity=1)
        if model in (3, 5) and max(gloss) > 0 and max(plain.base_color) == 0:
            return replace(plain, metallic=1.0, base_color=gloss)
        return plain

    def _numbers(self, key: str, default: Sequence[float]) -> Sequence[float]:
        if key not in self._lines:
            return default
        number, words = self._lines[key]
        words = [word for word in words if word != "-halo"]
        if not words or not all(map(_is_number, words)):
            got = " ".join([key, *words])[:60]
            raise InputError(f"{self._path}:{number}: is not a value (got {got!r}; allowed: finite numbers)")
        return [float(word) for word in words]

    def _number(self, key: str, default: float) -> float:
        return self._numbers(key, (default,))[0]

    def _share(self, key: str, default: float) -> float:
        return min(1.0, max(0.0, self._number(key, default)))

    def _colour(self, key: str, default: Colour, most: float = 1.0) -> Colour:
        values = self._numbers(key, default)
        red, green, blue = (min(most, max(0.0, value)) for value in ([*values] * 3 if len(values) < 3 else values)[:3])
        return (red, green, blue)

    def _factor(self, key: str, option: str) -> float:
        return _options(self._lines[key][1])[0].get(option, (1.0, 0.0))[0] if key in self._lines else 1.0

    def _texture(self, key: str) -> FileTexture | None:
        if key not in self._lines:
            return None
        options, name = _options(self._lines[key][1])
        if not name:
            return None
        source = self._path.parent / name.replace("\\", "/")
        beside = self._path.parent / source.name  # where the path is that of the machine which made the file
        if not os.path.isfile(source) and os.path.isfile(beside):  # noqa: PTH113 -- these never raise
            warnings.warn(f"{self._path}: {name}: no such file; {beside.name} beside it is taken", stacklevel=2)
            source = beside
        scale, offset = options.get("-s", (1.0, 1.0)), options.get("-o", (0.0, 0.0))
        wrap: Wrap = "clamp" if "-clamp" in options else "repeat"
        return FileTexture(
            source, name, scale, offset, wrap=wrap, luminance=key in _SCALAR and not self._is_packed(key)
        )

    def _is_packed(self, key: str) -> bool:
        """Return whether one picture says roughness and metal: in green and blue, as glTF packs them."""
        rough, metal = (_options(self._lines.get(each, (0, [""]))[1])[1] for each in ("map_pr", "map_pm"))
        return key != "map_d" and rough == metal


def _options(words: list[str]) -> tuple[dict[str, tuple[float, float]], str]:
    """Return the options of a texture line that are followed, and the name of the picture, which may have spaces."""
    options: dict[str, tuple[float, float]] = {}
    place = 0
    while place < len(words) and words[place] in _OPTIONS:
        option = words[place]
        values = words[place + 1 : place + 1 + _OPTIONS[option]]
        if option in _UP_TO:
            values = values[: next((n for n, word in enumerate(values) if not _is_number(word)), len(values))]
        if option in ("-s", "-o", "-bm") and values and _is_number(values[0]):
            default = 1.0 if option == "-s" else 0.0
            options[option] = (float(values[0]), float(values[1]) if len(values) > 1 else default)
        elif option == "-clamp" and values == ["on"]:
            options[option] = (1.0, 1.0)
        place += 1 + len(values)
    return options, " ".join(words[place:])


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


# OBJ files in blocks of many lines, sorted by keyword, and their numbers, without a Python step a line.

Line = tuple[int, bytes]


def parse_numbers(text: bytes) -> NDArray[np.float64] | None:
    """Return the numbers in a text, None when something else is in it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return np.fromstring(text, np.float64, sep=" ")
    except (ValueError, DeprecationWarning):
        return None


def numbers_of_lines(lines: Sequence[Line], each: int, what: str, path: Path) -> NDArray[np.float64]:
    """Return the first numbers (n, each) of lines that may have more of them.

    Parameters
    ----------
    lines : sequence of (number, text)
        Lines without their keyword, with their place in the file.
    each : int
        How many numbers a line must have at least.
    what : str
        What an error calls a line.
    path : Path
        The file, for errors.
    """
    if not lines:
        return np.empty((0, each))
    numbers = parse_numbers(b" ".join(text for _, text in lines))
    width = len(lines[0][1].split())
    if numbers is not None and width >= each and all(len(text.split()) == width for _, text in lines):
        return numbers.reshape(-1, width)[:, :each]
    rows = np.empty((len(lines), each))
    for place, (number, text) in enumerate(lines):
        row = parse_numbers(text) if text.strip() else None
        if row is None or len(row) < each:
            got = text.decode("latin-1").strip()[:60]
            raise InputError(f"{path}:{number}: is not {what} (got {got!r}; allowed: {each} numbers)")
        rows[place] = row[:each]
    return rows


BLOCK_BYTES = 1 << 23
_KEYWORDS = (b"v", b"vt", b"vn", b"f")
_BLANK = 32  # this and all below separate words

_INDENT = re.compile(rb"(?m)^[ \t]+")
_CONTINUED = re.compile(rb"\\\r?\n([^\n]*)(?:\n|$)")


class _KeywordLines(NamedTuple):
    """Lines of one block that begin with the same keyword.

    Attributes
    ----------
    numbers : (n,) array
        Their places in the file, from 1.
    words : (n,) array
        Words in each, the keyword left out.
    text : bytes
        The lines without their keyword.
    """

    numbers: NDArray[np.int64]
    words: NDArray[np.int64]
    text: bytes

    def part(self, start: int, end: int) -> _KeywordLines:
        """Return some of the lines."""
        if (start, end) == (0, len(self.numbers)):
            return self
        places = np.flatnonzero(np.frombuffer(self.text, np.uint8) == ord("\n")) + 1
        bounds = np.concatenate([[0], places])
        text = self.text[int(bounds[start]) : int(bounds[end])]
        return _KeywordLines(self.numbers[start:end], self.words[start:end], text)

    def singly(self) -> list[Line]:
        """Return each line with its place, without a comment at its end."""
        lines = self.text.split(b"\n")
        return [(int(number), line.partition(b"#")[0]) for number, line in zip(self.numbers, lines, strict=False)]


class _Block:
    """Whole lines of a file.

    Parameters
    ----------
    content : bytes
        Ends with the end of a line.
    first : int
        Place of the first line in the file.
    """

    def __init__(self, content: bytes, first: int) -> None:
        # a line that goes on: the next one moves up, an empty one follows
        while b"\\\n" in content or b"\\\r\n" in content:
            content = _CONTINUED.sub(rb" \1\n\n", content)
        if content[:1] in (b" ", b"\t") or b"\n " in content or b"\n\t" in content:
            content = _INDENT.sub(b"", content)
        self._octets = np.frombuffer(content, np.uint8)
        ends = np.flatnonzero(self._octets == ord("\n"))
        self._starts = np.concatenate([[0], ends[:-1] + 1])
        self._lengths = ends + 1 - self._starts
        self._first = first
        self._keywords = self._keyword_of_each()
        self.lines = len(ends)

    def _keyword_of_each(self) -> NDArray[np.int8]:
        """Return the place of each line's keyword in `_KEYWORDS`, -1 for others."""
        padded = np.concatenate([self._octets, np.full(3, _BLANK, np.uint8)])
        one, two, three = (padded[self._starts + place] for place in range(3))
        keywords = np.full(len(self._starts), -1, np.int8)
        keywords[(one == ord("v")) & (two <= _BLANK)] = 0
        keywords[(one == ord("v")) & (two == ord("t")) & (three <= _BLANK)] = 1
        keywords[(one == ord("v")) & (two == ord("n")) & (three <= _BLANK)] = 2
        keywords[(one == ord("f")) & (two <= _BLANK)] = 3
        return keywords

    def of(self, keyword: bytes) -> _KeywordLines:
        """Return the lines of one of the `_KEYWORDS`."""
        chosen = np.flatnonzero(self._keywords == _KEYWORDS.index(keyword))
        if not len(chosen):
            return _KeywordLines(chosen, chosen, b"")
        if len(chosen) == len(self._starts):
            octets = self._octets.copy()
            starts = self._starts
        else:
            inside = np.repeat(self._keywords == _KEYWORDS.index(keyword), self._lengths)
            octets = self._octets[inside]
            starts = np.cumsum(self._lengths[chosen]) - self._lengths[chosen]
        for place in range(len(keyword)):
            octets[starts + place] = _BLANK
        begins = np.flatnonzero(_begins_word(octets))
        words = np.diff(np.searchsorted(begins, starts), append=len(begins))
        return _KeywordLines(self._first + chosen, words, octets.tobytes())

    def before(self, keyword: bytes, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return how many lines of a keyword the block has before those of given places in the file."""
        total = np.cumsum(self._keywords == _KEYWORDS.index(keyword))
        return np.asarray(total[numbers - self._first])

    def others(self) -> Iterator[tuple[int, bytes]]:
        """Yield all other lines that are not empty, with their places."""
        for index in np.flatnonzero((self._keywords < 0) & (self._lengths > 1)).tolist():
            start = int(self._starts[index])
            yield self._first + index, self._octets[start : start + int(self._lengths[index])].tobytes()


def _begins_word(octets: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return for each byte whether a word begins there."""
    inside = octets > _BLANK
    result = inside.copy()
    result[1:] &= ~inside[:-1]
    return result


def _blocks(file: BinaryIO) -> Iterator[_Block]:
    """Yield the whole of a file."""
    rest, first = b"", 1
    while True:
        piece = file.read(BLOCK_BYTES)
        content = rest + piece
        if piece:
            end = _last_end(content)
            content, rest = content[:end], content[end:]
        elif content and not content.endswith(b"\n"):
            content += b"\n"
        if content:
            block = _Block(content, first)
            first += block.lines
            yield block
        if not piece:
            return


def _last_end(content: bytes) -> int:
    """Return the place after the last line that does not go on in the next one, 0 without one."""
    end = content.rfind(b"\n")
    while end >= 0 and content[max(0, end - 2) : end].rstrip(b"\r").endswith(b"\\"):
        end = content.rfind(b"\n", 0, end)
    return end + 1


Counts = tuple[int, int, int]

# Which indices a corner has, by its number of slashes and whether two of them follow each other.
FORMS = {(0, False): [0], (1, False): [0, 1], (2, True): [0, 2], (2, False): [0, 1, 2]}
_KINDS = ("vertex", "texture coordinate", "normal")
_MISSING = -1


class _FaceLines:
    """The faces of one material.

    Corners are rows (n, 3) of indices that count from 0, `_MISSING` where a corner has no texture coordinate or normal;
    sizes are the numbers of corners of the faces, and lines where it stands.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.corners: list[NDArray[np.int32]] = []
        self.sizes: list[NDArray[np.int32]] = []
        self.lines: list[NDArray[np.int32]] = []

    def add(self, lines: _KeywordLines, before: NDArray[np.int64]) -> None:
        """Add lines.

        Parameters
        ----------
        lines : KeywordLines
        before : (n, 3) array
            How many positions, texture coordinates and normals the file has before each line.
        """
        sizes = lines.words
        corners = _alike(lines)
        if corners is None:
            single = [(number, line.split()) for number, line in lines.singly()]
            sizes = np.array([len(words) for _, words in single], np.int64)
            corners = np.array([self._corner(word, number) for number, words in single for word in words], np.int64)
        if (sizes < 3).any():
            bad = int(np.argmax(sizes < 3))
            raise InputError(
                f"{self.path}:{lines.numbers[bad]}: is a face of {sizes[bad]} corners (allowed: at least 3)"
            )
        self.corners.append(self._count_from_0(corners, np.repeat(before, sizes, axis=0), lines.numbers, sizes))
        self.sizes.append(sizes.astype(np.int32))
        self.lines.append(lines.numbers.astype(np.int32))

    def _corner(self, word: bytes, number: int) -> list[int]:
        """Return the three indices of a corner as written, 0 for those that are left out."""
        parts = word.split(b"/")
        try:
            if not 1 <= len(parts) <= 3 or (len(parts) > 1 and not parts[-1]):
                raise ValueError
            indices = [int(part) if part else 0 for part in parts]
            zeros = (part and not index for part, index in zip(parts, indices, strict=True))
            if not parts[0] or any(zeros) or max(map(abs, indices)) > 2**31:
                raise ValueError
        except ValueError:
            got = word.decode("latin-1")[:40]
            allowed = "v, v/vt, v//vn or v/vt/vn, of whole numbers that count from 1, or from -1 backwards"
            place = f"{self.path}:{number}"
            raise InputError(f"{place}: is not a corner of a face (got {got!r}; allowed: {allowed})") from None
        return indices + [0] * (3 - len(indices))

    def _count_from_0(
        self,
        corners: NDArray[np.int64],
        before: NDArray[np.int64],
        numbers: NDArray[np.int64],
        sizes: NDArray[np.int64],
    ) -> NDArray[np.int32]:
        """Return indices that count from 0; negative ones count back from the last row before the face."""
        negative = corners < 0
        result = corners - 1
        if negative.any():
            result[negative] = (corners + before)[negative]
            wrong = negative & (result < 0)
            if wrong.any():
                row, kind = (int(place) for place in np.argwhere(wrong)[0])
                number = int(np.repeat(numbers, sizes)[row])
                raise self._not_there(number, kind, corners[row, kind], int(before[row, kind]))
        return np.minimum(result, np.iinfo(np.int32).max).astype(np.int32)

    def _not_there(self, number: int, kind: int, index: int, count: int) -> InputError:
        allowed = f"1 to {count}, or -1 to -{count}" if count else "none, there are no such lines"
        problem = f"names a {_KINDS[kind]} that is not there (got {index}; allowed: {allowed})"
        return InputError(f"{self.path}:{number}: {problem}")

    def checked(self, counts: Counts) -> NDArray[np.int32]:
        """Return all corners (n, 3), after checking that they name rows of the whole file."""
        corners = np.concatenate(self.corners)
        self.corners = [corners]
        for kind, count in enumerate(counts):
            wrong = corners[:, kind] >= count
            if wrong.any():
                row = int(np.argmax(wrong))
                numbers = np.repeat(np.concatenate(self.lines), np.concatenate(self.sizes))
                raise self._not_there(numbers[row], kind, corners[row, kind] + 1, count)
        return corners


def _alike(lines: _KeywordLines) -> NDArray[np.int64] | None:
    """Return the indices as written when all corners of some lines have the same form, None otherwise."""
    octets = np.frombuffer(lines.text, np.uint8)
    begins = np.flatnonzero(_begins_word(octets))
    count = len(begins)
    slashes = np.bincount(np.searchsorted(begins, np.flatnonzero(octets == ord("/")), "right"), minlength=count + 1)[1:]
    doubles = lines.text.count(b"//")
    if not count or (slashes != slashes[0]).any() or doubles not in (0, count):
        return None
    columns = FORMS.get((int(slashes[0]), doubles > 0))
    if columns is None:
        return None
    numbers = parse_numbers(lines.text.replace(b"/", b" "))
    if numbers is None or len(numbers) != count * len(columns):
        return None
    if not (np.abs(numbers) <= 2**31).all() or (numbers != np.floor(numbers)).any() or (numbers == 0).any():
        return None
    corners = np.zeros((count, 3), np.int64)
    corners[:, columns] = numbers.reshape(-1, len(columns))
    return corners


def _surface_of(
    faces: _FaceLines,
    table: NDArray[np.float64],
    uvs: NDArray[np.float64],
    normals: NDArray[np.float64],
    material: int | None,
    name: str | None,
) -> mesh.MeshSurface:
    """Return the surface of some faces, with a vertex for each different corner, of a table of places and colours."""
    positions, colours = table[:, :3], table[:, 3:]
    corners = faces.checked((len(positions), len(uvs), len(normals)))
    has_uvs, has_normals = (bool((corners[:, kind] != _MISSING).any()) for kind in (1, 2))
    own, vertices = _different(corners, (len(positions), len(uvs), len(normals)))
    polygons = _polygons(vertices, np.concatenate(faces.sizes), np.concatenate(faces.lines))
    places = positions[own[:, 0]]
    return mesh.MeshSurface(
        places,
        mesh.as_triangles(places, polygons, f"{faces.path}: the face of line"),
        _rows(normals, own[:, 2]) if has_normals else None,
        _rows(uvs, own[:, 1]) if has_uvs else None,
        material,
        name,
        np.asarray(colour.linear_from_srgb(np.clip(colours[own[:, 0]], 0, 1)), np.float32) if colours.size else None,
    )


def _different(corners: NDArray[np.int32], counts: Counts) -> tuple[NDArray[np.int32], NDArray[Any]]:
    """Return the corners (n, 3) that differ, and for each corner its place among them."""
    first = corners[:, 0]
    aligned = [bool((column == first).all()) for column in corners[:, 1:].T]
    missing = [bool((column == _MISSING).all()) for column in corners[:, 1:].T]
    if len(corners) < counts[0] or not all(same or none for same, none in zip(aligned, missing, strict=True)):
        kept, vertices = mesh.different_rows([corners[:, kind] for kind in range(3)])
        return corners[kept], vertices
    # Nothing to tell apart: the usual file of a single piece, which names everything by the same number.
    own = np.full((counts[0], 3), _MISSING, np.int32)
    own[:, 0] = np.arange(counts[0])
    for kind in (1, 2):
        if aligned[kind - 1]:
            both = min(counts[0], counts[kind])
            own[:both, kind] = own[:both, 0]
    return own, first


def _rows(table: NDArray[np.float64], indices: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return rows of a table, zeros where a corner has none."""
    rows = table[np.maximum(indices, 0)]
    rows[indices == _MISSING] = 0
    return rows


def _polygons(vertices: NDArray[Any], sizes: NDArray[np.int32], lines: NDArray[np.int32]) -> list[mesh.Polygons]:
    if (sizes == sizes[0]).all():
        return [mesh.Polygons(lines, vertices.reshape(len(sizes), -1))]
    groups = mesh.group_lists(sizes, np.cumsum(sizes, dtype=np.int64) - sizes, vertices)
    return [mesh.Polygons(lines[numbers], corners) for numbers, corners in groups]


COLUMNS = {b"v": (3, "a vertex"), b"vt": (1, "a texture coordinate"), b"vn": (3, "a normal")}


class _ObjReader:
    """Collects what the lines of an OBJ file say."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[bytes, list[NDArray[np.float64]]] = {key: [] for key in COLUMNS}
        self.counts = dict.fromkeys(COLUMNS, 0)
        self.libraries: list[tuple[int, str]] = []
        self.faces: dict[str | None, _FaceLines] = {}
        self.material: str | None = None

    def read(self, file: BinaryIO) -> None:
        """Read all lines."""
        for block in _blocks(file):
            self._faces(block)
            for word in COLUMNS:
                self._numbers(word, block.of(word))

    def _faces(self, block: _Block) -> None:
        """Add the faces of a block, those between two changes of material together."""
        faces = block.of(b"f")
        before = [self.counts[word] + block.before(word, faces.numbers) for word in COLUMNS]
        done = 0
        for number, name in self._changes(block):
            end = int(np.searchsorted(faces.numbers, number))
            self._add(faces.part(done, end), np.stack(before, axis=1)[done:end])
            self.material, done = name, end
        self._add(faces.part(done, len(faces.numbers)), np.stack(before, axis=1)[done:])

    def _add(self, lines: _KeywordLines, before: NDArray[np.int64]) -> None:
        if len(lines.numbers):
            self.faces.setdefault(self.material, _FaceLines(self.path)).add(lines, before)

    def _changes(self, block: _Block) -> Iterator[tuple[int, str | None]]:
        """Yield the places where the material changes, and its names; note libraries on the way."""
        for number, line in block.others():
            word, rest = (*line.split(None, 1), b"", b"")[:2]
            if word == b"usemtl":
                yield number, _text(rest) or None
            elif word == b"mtllib":
                self.libraries.append((number, _text(rest)))

    def _numbers(self, word: bytes, lines: _KeywordLines) -> None:
        if not len(lines.numbers):
            return
        each, what = COLUMNS[word]
        if word == b"vt":
            each = max(1, min(2, int(lines.words.min())))
        width = int(lines.words[0])
        each = 6 if word == b"v" and (lines.words == 6).all() else each  # with colours, as scanners write them
        numbers = parse_numbers(lines.text) if (lines.words == width).all() and width >= each else None
        if numbers is not None and len(numbers) == width * len(lines.numbers):
            numbers = numbers.reshape(-1, width)[:, :each]
        else:
            numbers = numbers_of_lines(lines.singly(), each, what, self.path)
        if each == 1:
            numbers = np.column_stack([numbers, np.zeros(len(numbers))])
        self.rows[word].append(np.ascontiguousarray(numbers))  # which does not keep a wider table alive
        self.counts[word] += len(numbers)

    def table(self, word: bytes) -> NDArray[np.float64]:
        """Return all rows of a keyword."""
        width = min((rows.shape[1] for rows in self.rows[word]), default=2 if word == b"vt" else 3)
        return np.concatenate([rows[:, :width] for rows in self.rows[word]] or [np.empty((0, width))])


def read_obj(path: Path, find: mesh.Find) -> mesh.Draft:
    """Return the surfaces of an OBJ file, one for each material, and the materials of its libraries.

    Raises
    ------
    InputError
        When a line cannot be read, a face names what is not there, or there are no faces.
    """
    reader = _ObjReader(path)
    with mesh.open_mesh(path) as file:
        reader.read(_as_utf8(file))
    if not reader.faces:
        raise InputError(f"{path}: has no faces (allowed: lines such as 'f 1 2 3')")
    materials: dict[str, FileMaterial] = {}
    notes: list[str] = []
    grey = False  # stands for materials of a library that is missing
    for number, name in reader.libraries:
        try:
            library = find(Path(name))
        except InputError as problem:
            grey = True
            notes.append(f"{path}:{number}: mtllib {name} is left out: {problem}; grey stands for its materials")
        else:
            materials |= _read_mtl(library)
    vertices, uvs, normals = (reader.table(word) for word in (b"v", b"vt", b"vn"))
    surfaces: list[mesh.MeshSurface] = []
    used: list[FileMaterial] = []
    for name_, faces in reader.faces.items():
        place = None
        if materials or notes:
            place = len(used)
            used.append(materials.get(name_ or "", FileMaterial(matte=True)))
            if name_ and name_ not in materials and not grey:
                notes.append(f"{path}: usemtl {name_}: names no material; grey stands for it")
        surfaces.append(_surface_of(faces, vertices, uvs, normals, place, name_))
    return mesh.Draft(surfaces, used, notes=notes)


def _as_utf8(file: BinaryIO) -> BinaryIO:
    """Return a text file behind the mark of UTF-8, or a copy of what is UTF-16 by its mark."""
    mark = file.read(3)
    if mark[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return BytesIO((mark + file.read()).decode("utf-16", "replace").encode())
    file.seek(3 if mark == codecs.BOM_UTF8 else 0)
    return file


def _text(line: bytes) -> str:
    return line.decode("utf-8", "replace").strip()
