"""The binary data of a glTF file: buffers, views of them, and arrays of numbers (accessors)."""

from __future__ import annotations

import base64
import binascii
import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.contents import Find
from rptcam_cl.assets.meshes.gltf_json import JsonNode
from rptcam_cl.assets.meshes.gltf_packed import MESHOPT, meshopt_bytes
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.references import read_whole

MAGIC = b"glTF"
JSON_CHUNK = 0x4E4F534A
BINARY_CHUNK = 0x004E4942
LARGEST_FILE = 2**32 - 1  # bytes, which is also the most that a .glb file can say of itself
MOST_JSON_BYTES = 256_000_000
MOST_ZEROS = 10_000_000  # entries of an array that has no data, which no file size bounds

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

Octets = NDArray[np.uint8]


def whole(path: Path) -> bytes:
    """Return the content of a file."""
    try:
        return read_whole(path, LARGEST_FILE)
    except (InputError, StateError) as problem:
        raise type(problem)(f"{path}: {problem}") from None


def read_container(path: Path) -> tuple[JsonNode, bytes | None]:
    """Return the JSON of a .gltf or .glb file, and the data that a .glb has behind it."""
    content = whole(path)
    binary: bytes | None = None
    if content[:4] == MAGIC:
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
    found: dict[int, bytes] = {}
    place = 12
    while place + 8 <= length:
        size, kind = (int.from_bytes(content[at : at + 4], "little") for at in (place, place + 4))
        if place + 8 + size > length:
            raise InputError(f"{path}: is cut short: a chunk of {size} bytes begins at byte {place} of {length}")
        found.setdefault(kind, content[place + 8 : place + 8 + size])
        place += 8 + size
    if JSON_CHUNK not in found:
        raise InputError(f"{path}: has no JSON chunk")
    return found[JSON_CHUNK], found.get(BINARY_CHUNK)


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
        self._loaded: dict[int, Octets] = {}
        self._arrays: dict[int, NDArray[Any]] = {}
        self._unpacked: dict[int, Octets] = {}

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

    def _buffer(self, index: int) -> Octets:
        if index not in self._loaded:
            part = self._buffers[index]
            if part.has("uri"):
                source = self.file_named_by(part)
                content = source if isinstance(source, bytes) else whole(self._checked(source, part))
            elif index == 0 and self._binary is not None:
                content = self._binary
            else:
                raise InputError(f"{part.place}: has no uri, and the file no binary chunk")
            length = part.whole("byteLength")
            if length > len(content):
                raise InputError(f"{part.place}: is cut short: says it has {length} bytes (got {len(content)} bytes)")
            self._loaded[index] = np.frombuffer(content, np.uint8)[:length]
        return self._loaded[index]

    def _checked(self, path: Path, part: JsonNode) -> Path:
        try:
            return self._find(path)
        except InputError as problem:
            raise type(problem)(f"{part.place}.uri: {problem}") from None

    def view(self, index: int) -> tuple[Octets, int]:
        """Return the bytes of a view, and the distance of its entries (0: they lie side by side)."""
        part = self._views[index]
        for packed in part.extensions(MESHOPT):
            if index not in self._unpacked:
                self._unpacked[index] = meshopt_bytes(packed, self._part_of_buffer(packed).tobytes())
            return self._unpacked[index], part.whole("byteStride", 0, below=257)
        return self._part_of_buffer(part), part.whole("byteStride", 0, below=253)

    def _part_of_buffer(self, part: JsonNode) -> Octets:
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
        if component not in COMPONENTS:
            raise part.wrong("componentType", "is not known", ", ".join(map(str, COMPONENTS)))
        dtype = np.dtype(COMPONENTS[component])
        width, count = WIDTHS[part.text("type")], part.whole("count", below=2**31)
        if part.has("bufferView"):
            rows = self._rows(part, dtype, width, count)
        elif count > MOST_ZEROS:
            raise part.wrong("count", "is too large for an array without data", f"at most {MOST_ZEROS}")
        else:
            rows = np.zeros((count, width), dtype)
        if part.has("sparse"):
            rows = self._replaced(part.part("sparse"), rows, dtype)
        return _scaled(part, rows)

    def scaled(self, index: int, rows: NDArray[Any]) -> NDArray[Any]:
        """Return numbers that were compressed as the accessor of an attribute says that they count."""
        return _scaled(self._accessors[index], rows)

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

    def _replaced(self, sparse: JsonNode, rows: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return rows with those that a sparse accessor names replaced."""
        count = sparse.whole("count", below=2**31)
        indices, values = sparse.part("indices"), sparse.part("values")
        component = indices.whole("componentType")
        if component not in (5121, 5123, 5125):
            raise indices.wrong("componentType", "is no index", "5121, 5123 or 5125")
        places = self._rows(indices, np.dtype(COMPONENTS[component]), 1, count)[:, 0]
        if count and int(places.max()) >= len(rows):
            raise InputError(f"{indices.place}: names an entry that is not there (got {places.max()})")
        rows = rows.copy()
        rows[places] = self._rows(values, dtype, rows.shape[1], count)
        return rows


def _scaled(part: JsonNode, rows: NDArray[Any]) -> NDArray[Any]:
    """Return whole numbers as fractions of their largest, where an accessor says that they are (glTF 2.0, 3.6.2.2)."""
    if not part.flag("normalized") or rows.dtype.kind not in "iu":
        return rows
    return np.asarray(np.maximum(rows.astype(np.float32) / np.float32(np.iinfo(rows.dtype).max), np.float32(-1)))
