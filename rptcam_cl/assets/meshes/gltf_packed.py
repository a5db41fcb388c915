"""Compressed data of glTF files, unpacked by libraries that are an extra: Draco and meshoptimizer.

Sources: Khronos, KHR_draco_mesh_compression and EXT_meshopt_compression.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.gltf_json import JsonNode
from rptcam_cl.core.errors import InputError

DRACO, MESHOPT = "KHR_draco_mesh_compression", "EXT_meshopt_compression"
MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
FILTERS = {"OCTAHEDRAL": "decode_filter_oct", "QUATERNION": "decode_filter_quat", "EXPONENTIAL": "decode_filter_exp"}
MOST_BYTES = 2 << 30  # of one array, unpacked


def _library(name: str, place: str, packed_by: str, extra: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(
            f'{place}: is compressed by {packed_by}, whose decoder is missing; pip install "rptcam_cl[{extra}]"'
        ) from None


def draco_arrays(packed: JsonNode, content: bytes) -> tuple[NDArray[np.int64], Mapping[str, NDArray[Any]]]:
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
    found: dict[str, NDArray[Any]] = {}
    for name in names.names():
        identifier = names.whole(name)
        if identifier not in by_id:
            raise names.wrong(name, "is not in the compressed data", ", ".join(map(str, by_id)))
        found[name] = by_id[identifier].reshape(len(by_id[identifier]), -1)
    return faces, found


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
    if mode not in MODES:
        raise packed.wrong("mode", "is not known", ", ".join(MODES))
    if way != "NONE" and way not in FILTERS:
        raise packed.wrong("filter", "is not known", ", ".join(("NONE", *FILTERS)))
    if not 0 < count * stride <= MOST_BYTES or (mode != "ATTRIBUTES" and stride not in (2, 4)):
        raise packed.wrong("count", f"does not fit a stride of {stride}", f"at most {MOST_BYTES} bytes together")
    try:
        if mode == "ATTRIBUTES":
            rows = library.decode_vertex_buffer(count, stride, content)
            octets = np.frombuffer(np.ascontiguousarray(rows).tobytes(), np.uint8).copy()
            if way != "NONE":
                octets = _filtered(getattr(library, FILTERS[way]), octets, count, stride)
            return octets
        decode = library.decode_index_buffer if mode == "TRIANGLES" else library.decode_index_sequence
        indices = np.asarray(decode(count, 4, content))
        return np.frombuffer(indices.astype("<u4" if stride == 4 else "<u2").tobytes(), np.uint8)
    except (RuntimeError, ValueError, TypeError, OverflowError) as problem:
        raise InputError(f"{packed.place}: is damaged ({problem})") from None


def _filtered(decode: Any, octets: NDArray[np.uint8], count: int, stride: int) -> NDArray[np.uint8]:
    """Return unfiltered bytes; the library works on what it is given, or returns it."""
    result = decode(octets, count, stride)
    return octets if result is None else np.frombuffer(np.ascontiguousarray(result).tobytes(), np.uint8)
