"""What glTF files hold: JSON read key by key, buffers, arrays of numbers, compressed or not, vertices and triangles."""

from __future__ import annotations

import base64
import binascii
import importlib
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import name_errors, read_whole
from rptcam_cl.scene.assets.mesh import Find

# The JSON of a glTF file, read key by key; what is not as it must be is refused with its place.


class JsonNode:
    """A mapping of the JSON and where it stands.

    Parameters
    ----------
    value : dict
        Plain data.
    place : str
        ``bunny.glb: materials[2]``, for errors.
    """

    def __init__(self, value: Any, place: str) -> None:
        if not isinstance(value, dict):
            raise InputError(f"{place}: must be a mapping (got {_quote(value)})")
        self._value = value
        self.place = place

    def wrong(self, key: str, problem: str, allowed: str) -> InputError:
        """Return the error for a key's value."""
        return InputError(f"{self.place}.{key}: {problem} (got {_quote(self._value.get(key))}; allowed: {allowed})")

    def has(self, key: str) -> bool:
        """Return whether a key is there."""
        return key in self._value

    def is_mapping(self, key: str) -> bool:
        """Return whether a key holds a mapping."""
        return isinstance(self._value.get(key), dict)

    def names(self) -> list[str]:
        """Return the keys."""
        return list(self._value)

    def part(self, key: str) -> JsonNode:
        """Return the mapping of a key, an empty one when there is none."""
        return JsonNode(self._value.get(key, {}), f"{self.place}.{key}")

    def parts(self, key: str) -> list[JsonNode]:
        """Return the mappings in the list of a key."""
        return [JsonNode(value, f"{self.place}.{key}[{index}]") for index, value in enumerate(self._list(key))]

    def _list(self, key: str) -> list[Any]:
        value = self._value.get(key, [])
        if not isinstance(value, list):
            raise self.wrong(key, "must be a list", "a list")
        return value

    def text(self, key: str, default: str = "") -> str:
        """Return the text of a key."""
        value = self._value.get(key, default)
        if not isinstance(value, str):
            raise self.wrong(key, "must be text", "text")
        return value

    def flag(self, key: str) -> bool:
        """Return whether a key is true."""
        return self._value.get(key, False) is True

    def number(self, key: str, default: float, low: float = -math.inf, high: float = math.inf) -> float:
        """Return the finite number of a key, inside its span; without the key the default, which may be infinite."""
        if key not in self._value:
            return default
        value = self._value[key]
        if not _is_number(value) or not low <= value <= high:
            raise self.wrong(key, "must be a number in its range", f"{low:g} to {high:g}")
        return float(value)

    def whole(self, key: str, default: int | None = None, below: int = 2**53) -> int:
        """Return the whole number of a key, 0 or more and below a limit; without a default it must be there."""
        value: Any = self._value.get(key, default)
        if not _is_number(value) or value != int(value) or not 0 <= value < below:
            raise self.wrong(key, "must be a whole number in its range", f"0 to {below - 1}" if below else "none")
        return int(value)

    def wholes(self, key: str, below: int) -> list[int]:
        """Return the whole numbers in the list of a key."""
        values = self._list(key)
        if not all(_is_number(value) and value == int(value) and 0 <= value < below for value in values):
            raise self.wrong(key, "must be a list of whole numbers in their range", f"0 to {below - 1}")
        return [int(value) for value in values]

    def numbers(self, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Return as many finite numbers as the default has."""
        values = self._value.get(key, default)
        if not isinstance(values, (list, tuple)) or len(values) != len(default) or not all(map(_is_number, values)):
            raise self.wrong(key, f"must be {len(default)} finite numbers", f"a list of {len(default)} numbers")
        return tuple(float(value) for value in values)

    def with_changes(self, key: str, changes: Mapping[int, Mapping[str, Any]]) -> JsonNode:
        """Return the mapping with further keys of those in the list of a key, by their places there."""
        rows = [{**row, **changes.get(index, {})} for index, row in enumerate(self._list(key))]
        return JsonNode({**self._value, key: rows}, self.place)

    def texts(self, key: str) -> list[str]:
        """Return the texts in the list of a key."""
        values = self._list(key)
        if not all(isinstance(value, str) for value in values):
            raise self.wrong(key, "must be a list of texts", "a list of texts")
        return values

    def extensions(self, *names: str) -> Iterator[JsonNode]:
        """Yield those of the extensions that are there."""
        extensions = self.part("extensions")
        for name in names:
            if extensions.has(name):
                yield extensions.part(name)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) < 1e300 if isinstance(value, int) else math.isfinite(value)


def _quote(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "…"


#
# Compressed data of glTF files, unpacked by libraries that are an extra: Draco and meshoptimizer.
#
# Sources: Khronos, KHR_draco_mesh_compression, EXT_meshopt_compression and KHR_meshopt_compression, the same data.

DRACO, MESHOPT = "KHR_draco_mesh_compression", ("EXT_meshopt_compression", "KHR_meshopt_compression")
_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
_FILTERS = {"OCTAHEDRAL": "decode_filter_oct", "QUATERNION": "decode_filter_quat", "EXPONENTIAL": "decode_filter_exp"}
MOST_BYTES = 2 << 30  # of one array, unpacked


def _library(name: str, place: str, packed_by: str, extra: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(
            f'{place}: is compressed by {packed_by}, whose decoder is missing; pip install "rptcam_cl[{extra}]"'
        ) from None


def _draco_arrays(packed: JsonNode, content: bytes) -> tuple[NDArray[np.int64], Mapping[str, NDArray[Any]]]:
    """Return the triangles (m, 3) of a primitive that Draco compressed, and its attributes (n, width) by their names.

    Raises
    ------
    InputError
        When the decoder is not installed, or the data are damaged.
    """
    draco = _library("DracoPy", packed.place, "Draco", "gltf")
    try:
        mesh = draco.decode(content)
        by_id = {row["unique_id"]: np.asarray(row["data"]) for row in mesh.attributes}
        faces = np.asarray(mesh.faces, np.int64).reshape(-1, 3)
    except Exception as problem:  # the library raises its own, and whatever its wrapper meets
        raise InputError(f"{packed.place}: is damaged ({str(problem) or type(problem).__name__})") from None
    names = packed.part("attributes")
    attributes: dict[str, NDArray[Any]] = {}
    for name in names.names():
        identifier = names.whole(name)
        if identifier not in by_id:
            raise names.wrong(name, "is not in the compressed data", ", ".join(map(str, by_id)))
        attributes[name] = by_id[identifier].reshape(len(by_id[identifier]), -1)
    return faces, attributes


def meshopt_bytes(packed: JsonNode, content: bytes) -> NDArray[np.uint8]:
    """Return the bytes of a view that meshoptimizer compressed.

    Raises
    ------
    InputError
        When the decoder is not installed, or the data are damaged.
    """
    library = _library("meshoptimizer", packed.place, "meshoptimizer", "meshopt")
    count, stride = packed.whole("count", below=2**31), packed.whole("byteStride", below=257)
    mode, way = packed.text("mode"), packed.text("filter", "NONE")
    if mode not in _MODES:
        raise packed.wrong("mode", "is not known", ", ".join(_MODES))
    if way != "NONE" and way not in _FILTERS:
        raise packed.wrong("filter", "is not known", ", ".join(("NONE", *_FILTERS)))
    if not 0 < count * stride <= MOST_BYTES or (mode != "ATTRIBUTES" and stride not in (2, 4)):
        raise packed.wrong("count", f"does not fit a stride of {stride}", f"at most {MOST_BYTES} bytes together")
    try:
        if mode == "ATTRIBUTES":
            rows = library.decode_vertex_buffer(count, stride, content)
            octets = np.frombuffer(np.ascontiguousarray(rows).tobytes(), np.uint8).copy()
            if way != "NONE":
                octets = _apply_filter(getattr(library, _FILTERS[way]), octets, count, stride)
            return octets
        decode = library.decode_index_buffer if mode == "TRIANGLES" else library.decode_index_sequence
        indices = np.asarray(decode(count, 4, content))
        return np.frombuffer(indices.astype("<u4" if stride == 4 else "<u2").tobytes(), np.uint8)
    except (RuntimeError, ValueError, TypeError, OverflowError) as problem:
        raise InputError(f"{packed.place}: is damaged ({problem})") from None


def _apply_filter(decode: Any, octets: NDArray[np.uint8], count: int, stride: int) -> NDArray[np.uint8]:
    """Return unfiltered bytes; the library works on what it is given, or returns it."""
    result = decode(octets, count, stride)
    return octets if result is None else np.frombuffer(np.ascontiguousarray(result).tobytes(), np.uint8)


# The binary data of a glTF file: buffers, views of them, and arrays of numbers (accessors).

_MAGIC = b"glTF"
_JSON_CHUNK = 0x4E4F534A
_BINARY_CHUNK = 0x004E4942
LARGEST_FILE = 2**32 - 1  # bytes, which is also the most that a .glb file can say of itself
MOST_JSON_BYTES = 256_000_000
_MOST_ZEROS = 10_000_000  # entries of an array that has no data, which no file size bounds

_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

_Octets = NDArray[np.uint8]


def read_container(path: Path) -> tuple[JsonNode, bytes | None]:
    """Return the JSON of a .gltf or .glb file, and the data that a .glb has behind it."""
    with name_errors(path):
        content = read_whole(path, LARGEST_FILE)
    binary: bytes | None = None
    if content[:4] == _MAGIC:
        content, binary = _chunks(content, path)
    if len(content) > MOST_JSON_BYTES:
        raise InputError(f"{path}: has more than {MOST_JSON_BYTES} bytes of JSON")
    try:
        document = json.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as problem:
        raise InputError(f"{path}: is not glTF: its JSON cannot be read ({problem})") from None
    return JsonNode(document, f"{path}: glTF"), binary


def _chunks(content: bytes, path: Path) -> tuple[bytes, bytes | None]:
    """Return the JSON and binary chunks of a .glb file (glTF 2.0, section 4.4)."""
    version, length = (int.from_bytes(content[place : place + 4], "little") for place in (4, 8))
    if version != 2:
        raise InputError(f"{path}: is binary glTF of version {version} (allowed: 2)")
    if length != len(content):
        raise InputError(f"{path}: is cut short: says it has {length} bytes (got {len(content)} bytes)")
    chunks: dict[int, bytes] = {}
    place = 12
    while place + 8 <= length:
        size, kind = (int.from_bytes(content[at : at + 4], "little") for at in (place, place + 4))
        if place + 8 + size > length:
            raise InputError(f"{path}: is cut short: a chunk of {size} bytes begins at byte {place} of {length}")
        chunks.setdefault(kind, content[place + 8 : place + 8 + size])
        place += 8 + size
    if _JSON_CHUNK not in chunks:
        raise InputError(f"{path}: has no JSON chunk")
    return chunks[_JSON_CHUNK], chunks.get(_BINARY_CHUNK)


class Data:
    """Arrays of a glTF file.

    Parameters
    ----------
    document : JsonNode
    binary : bytes or None
        The data of a .glb file.
    folder : Path
        Where the file is.
    find : callable
        Returns the checked path of a further file.

    Attributes
    ----------
    count, views : int
        How many arrays and views there are.
    """

    def __init__(self, document: JsonNode, binary: bytes | None, folder: Path, find: Find) -> None:
        self._folder = folder
        self._binary = binary
        self._find = find
        self._buffers = document.parts("buffers")
        self._views = document.parts("bufferViews")
        self._accessors = document.parts("accessors")
        self.count, self.views = len(self._accessors), len(self._views)
        self._loaded: dict[int, _Octets] = {}
        self._arrays: dict[int, NDArray[Any]] = {}
        self._unpacked: dict[int, _Octets] = {}

    def file_named_by(self, part: JsonNode) -> Path | bytes:
        """Return the path that a part's `uri` names, relative to the file and not checked, or the content it holds."""
        uri = part.text("uri")
        if uri.startswith("data:"):
            head, _, content = uri.partition(",")
            if not head.endswith(";base64"):
                return unquote_to_bytes(content)
            try:
                return base64.b64decode(content, validate=True)
            except binascii.Error as problem:
                raise InputError(f"{part.place}.uri: is not base64 ({problem})") from None
        if "://" in uri or not uri:
            raise part.wrong("uri", "is not a file", "the path of a file, or data")
        return self._folder / unquote(uri)

    def _buffer(self, index: int) -> _Octets:
        if index not in self._loaded:
            part = self._buffers[index]
            if part.has("uri"):
                content = self._content(part)
            elif index == 0 and self._binary is not None:
                content = self._binary
            else:
                raise InputError(f"{part.place}: has no uri, and the file no binary chunk")
            length = part.whole("byteLength")
            if length > len(content):
                raise InputError(f"{part.place}: is cut short: says it has {length} bytes (got {len(content)} bytes)")
            self._loaded[index] = np.frombuffer(content, np.uint8)[:length]
        return self._loaded[index]

    def _content(self, part: JsonNode) -> bytes:
        """Read the content that the `uri` of a buffer names."""
        source = self.file_named_by(part)
        if isinstance(source, bytes):
            return source
        with name_errors(f"{part.place}.uri"):
            path = self._find(source)
        with name_errors(path):
            return read_whole(path, LARGEST_FILE)

    def view(self, index: int) -> tuple[_Octets, int]:
        """Return the bytes of a view, and the distance of its entries (0: they lie side by side)."""
        part = self._views[index]
        for packed in part.extensions(*MESHOPT):
            if index not in self._unpacked:
                self._unpacked[index] = meshopt_bytes(packed, self._part_of_buffer(packed).tobytes())
            return self._unpacked[index], part.whole("byteStride", 0, below=257)
        return self._part_of_buffer(part), part.whole("byteStride", 0, below=253)

    def _part_of_buffer(self, part: JsonNode) -> _Octets:
        buffer = self._buffer(part.whole("buffer", below=len(self._buffers)))
        start, length = part.whole("byteOffset", 0), part.whole("byteLength")
        if start + length > len(buffer):
            got = f"bytes {start} to {start + length}"
            raise InputError(f"{part.place}: reaches beyond its buffer (got {got}; allowed: up to {len(buffer)})")
        return buffer[start : start + length]

    def array(self, index: int, types: tuple[str, ...]) -> NDArray[Any]:
        """Return the numbers (count, width) of an accessor of one of the given types; do not change them."""
        part = self._accessors[index]
        if part.text("type") not in types:
            raise part.wrong("type", "does not fit its use", ", ".join(types))
        if index not in self._arrays:
            self._arrays[index] = self._read(part)
        return self._arrays[index]

    def _read(self, part: JsonNode) -> NDArray[Any]:
        component = part.whole("componentType")
        if component not in _COMPONENTS:
            raise part.wrong("componentType", "is not known", ", ".join(map(str, _COMPONENTS)))
        dtype = np.dtype(_COMPONENTS[component])
        width, count = _WIDTHS[part.text("type")], part.whole("count", below=2**31)
        if part.has("bufferView"):
            rows = self._rows(part, dtype, width, count)
        elif count > _MOST_ZEROS:
            raise part.wrong("count", "is too large for an array without data", f"at most {_MOST_ZEROS}")
        else:
            rows = np.zeros((count, width), dtype)
        if part.has("sparse"):
            rows = self._replace_sparse(part.part("sparse"), rows, dtype)
        return _scale_rows(part, rows)

    def scaled(self, index: int, rows: NDArray[Any]) -> NDArray[Any]:
        """Return numbers that were compressed as the accessor of an attribute says that they count."""
        return _scale_rows(self._accessors[index], rows)

    def _rows(self, part: JsonNode, dtype: np.dtype[Any], width: int, count: int) -> NDArray[Any]:
        octets, stride = self.view(part.whole("bufferView", below=len(self._views)))
        start, size = part.whole("byteOffset", 0), dtype.itemsize * width
        stride = stride or size
        end = start + stride * (count - 1) + size if count else start
        if end > len(octets):
            raise InputError(
                f"{part.place}: reaches beyond its view ({count} entries end at byte {end}; allowed: {len(octets)})"
            )
        if stride < size:
            raise InputError(f"{part.place}: its entries overlap (got a stride of {stride}; allowed: at least {size})")
        if not count:
            return np.empty((0, width), dtype)
        if stride == size:
            return octets[start:end].view(dtype).reshape(count, width)
        strided = np.lib.stride_tricks.as_strided(octets[start:end], (count, size), (stride, 1))
        return np.ascontiguousarray(strided).view(dtype)

    def _replace_sparse(self, sparse: JsonNode, rows: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return rows with those that a sparse accessor names replaced."""
        count = sparse.whole("count", below=2**31)
        indices, values = sparse.part("indices"), sparse.part("values")
        component = indices.whole("componentType")
        if component not in (5121, 5123, 5125):
            raise indices.wrong("componentType", "is no index", "5121, 5123 or 5125")
        places = self._rows(indices, np.dtype(_COMPONENTS[component]), 1, count)[:, 0]
        if count and int(places.max()) >= len(rows):
            raise InputError(f"{indices.place}: names an entry that is not there (got {places.max()})")
        rows = rows.copy()
        rows[places] = self._rows(values, dtype, rows.shape[1], count)
        return rows


def _scale_rows(part: JsonNode, rows: NDArray[Any]) -> NDArray[Any]:
    """Return whole numbers as fractions of their largest, where an accessor says that they are (glTF 2.0, 3.6.2.2)."""
    if not part.flag("normalized") or rows.dtype.kind not in "iu":
        return rows
    return np.asarray(np.maximum(rows.astype(np.float32) / np.float32(np.iinfo(rows.dtype).max), np.float32(-1)))


# Vertices and triangles of a glTF primitive, from accessors or from data that Draco compressed.

TRIANGLES, STRIP, FAN = 4, 5, 6


class Vertices:
    """What a primitive says of its vertices.

    Raises
    ------
    InputError
        When it is compressed and cannot be read.
    """

    def __init__(self, primitive: JsonNode, data: Data) -> None:
        self._primitive, self._data = primitive, data
        self._attributes = primitive.part("attributes")
        self._faces: NDArray[np.int64] | None = None
        self._unpacked: Mapping[str, NDArray[Any]] = {}
        self._count: int | None = None
        for packed in primitive.extensions(DRACO):
            octets, _ = data.view(packed.whole("bufferView", below=data.views))
            self._faces, self._unpacked = _draco_arrays(packed, octets.tobytes())

    def rows(self, key: str, types: tuple[str, ...]) -> NDArray[Any] | None:
        """Return the numbers of an attribute in float32, None when it is not there; the first one says how many."""
        if not self._attributes.has(key):
            return None
        index = self._attributes.whole(key, below=self._data.count)
        if key in self._unpacked:
            rows = self._data.scaled(index, self._unpacked[key])
        else:
            rows = self._data.array(index, types)
        if self._count is None:
            self._count = len(rows)
        if len(rows) != self._count:
            raise self._attributes.wrong(key, f"has {len(rows)} entries", f"{self._count}, as POSITION has")
        return rows.astype(np.float32, copy=False)

    def corners(self, mode: int) -> NDArray[np.int64]:
        """Return the vertices of each triangle (m, 3)."""
        if self._faces is not None:
            return self._faces
        primitive, data = self._primitive, self._data
        if primitive.has("indices"):
            order = data.array(primitive.whole("indices", below=data.count), ("SCALAR",))[:, 0]
            if order.dtype.kind != "u":
                raise primitive.wrong("indices", "are not whole numbers", "an accessor of unsigned numbers")
        else:
            order = np.arange(self._count or 0)
        if mode == TRIANGLES:
            return order[: len(order) // 3 * 3].reshape(-1, 3)
        count = max(0, len(order) - 2)
        first = np.arange(count)
        if mode == FAN:
            return np.stack([order[first * 0], order[first + 1], order[first + 2]], axis=1)
        odd = first % 2
        return np.stack([order[first + odd], order[first + 1 - odd], order[first + 2]], axis=1)
