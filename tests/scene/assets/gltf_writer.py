"""Writes small glTF files: arrays become accessors, and a mapping says the rest."""

import base64
import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class GltfWriter:
    """Collects binary data and the JSON that describes it."""

    def __init__(self) -> None:
        self.binary = b""
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []}

    def view(self, content: bytes, **keys: Any) -> int:
        """Add bytes, return the index of their view."""
        self.binary += bytes(-len(self.binary) % 4)
        self.json["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content), **keys}
        )
        self.binary += content
        return len(self.json["bufferViews"]) - 1

    def array(self, rows: Any, dtype: str = "f4", **keys: Any) -> int:
        """Add an array, return the index of its accessor."""
        table: NDArray[Any] = np.asarray(rows, "<" + dtype)
        width = 1 if table.ndim == 1 else table.shape[1]
        self.json["accessors"].append({
            "bufferView": self.view(table.tobytes()), "componentType": COMPONENTS[dtype], "count": len(table),
            "type": TYPES[width], **keys,
        })  # fmt: skip
        return len(self.json["accessors"]) - 1

    def glb(self) -> bytes:
        """Return the file in one piece."""
        self.json["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        binary = self.binary + bytes(-len(self.binary) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def gltf(self, uri: str | None = None) -> str:
        """Return the file as text, its data written out or in the file of a name."""
        uri = uri or "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
        self.json["buffers"] = [{"byteLength": len(self.binary), "uri": uri}]
        return json.dumps(self.json)


def triangle(**primitive: Any) -> GltfWriter:
    """Return a file of one triangle in the corner of the axes, whose primitive has further keys."""
    writer = GltfWriter()
    position = writer.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    writer.json["meshes"] = [{"name": "leaf", "primitives": [{"attributes": {"POSITION": position}, **primitive}]}]
    writer.json["nodes"] = [{"mesh": 0}]
    writer.json["scenes"] = [{"nodes": [0]}]
    return writer
