"""Writers of small files: PLY with 16-bit coordinates, binary glTF, Radiance HDR."""

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapes import Shape


def write_ply(path: Path, shape: Shape, *, uvs: bool = True, steps: int = 1000) -> None:
    """Write quads with coordinates as 16-bit integers, so many steps to the unit; the scene scales them back."""
    fields: list[tuple[str, Any]] = [("at", "<i2", 3)]
    lines = ["property short x", "property short y", "property short z"]
    if uvs:
        fields.append(("uv", "<f4", 2))
        lines += ["property float u", "property float v"]
    vertices = np.zeros(len(shape.positions), fields)
    scaled = np.rint(shape.positions * steps)
    if np.abs(scaled).max() > 32767 or len(vertices) > 65536:
        raise ValueError(f"{path.name}: beyond 16 bits")
    vertices["at"] = scaled
    if uvs:
        vertices["uv"] = shape.uvs
    lists = [polygons for polygons in shape.polygons() if len(polygons)]
    faces = bytearray()
    for some in lists:
        rows = np.zeros(len(some), [("corners", "u1"), ("at", "<u2", some.shape[1])])
        rows["corners"], rows["at"] = some.shape[1], some
        faces += rows.tobytes()
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}", *lines]
    head += [f"element face {sum(map(len, lists))}", "property list uchar ushort vertex_indices", "end_header\n"]
    path.write_bytes("\n".join(head).encode() + vertices.tobytes() + bytes(faces))


@dataclass
class Gltf:
    """A binary glTF file in the making."""

    materials: list[dict[str, Any]]
    images: list[tuple[bytes, str]]  # content, MIME type; the texture of an image has its number
    meshes: list[dict[str, Any]] = field(default_factory=list)
    nodes: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    views: list[dict[str, Any]] = field(default_factory=list)
    content: bytearray = field(default_factory=bytearray)

    def _view(self, data: bytes) -> int:
        self.views.append({"buffer": 0, "byteOffset": len(self.content), "byteLength": len(data)})
        self.content += data + bytes(-len(data) % 4)
        return len(self.views) - 1

    def _accessor(self, values: NDArray[Any], component: int, kind: str, **more: Any) -> int:
        view = self._view(values.tobytes())
        accessor = {"bufferView": view, "componentType": component, "count": len(values), "type": kind, **more}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def mesh(self, name: str, parts: list[tuple[Shape, int]]) -> int:
        """Add a mesh of shapes, each with the number of its material; return its number."""
        primitives = []
        for shape, material in parts:
            at = shape.positions.astype("<f4")
            low, high = ([float(value) for value in bound] for bound in (at.min(axis=0), at.max(axis=0)))
            uvs = (shape.uvs * [1, -1] + [0, 1]).astype("<f4")  # glTF counts v downwards
            corners = shape.triangles().ravel().astype("<u2")
            attributes = {"POSITION": self._accessor(at, 5126, "VEC3", min=low, max=high)}
            attributes["TEXCOORD_0"] = self._accessor(uvs, 5126, "VEC2")
            indices = self._accessor(corners, 5123, "SCALAR")
            primitives.append({"attributes": attributes, "indices": indices, "material": material})
        self.meshes.append({"name": name, "primitives": primitives})
        return len(self.meshes) - 1

    def write(self, path: Path) -> None:
        """Write the file."""
        document: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0}
        document["scenes"] = [{"nodes": [*range(len(self.nodes))]}]
        document |= {"nodes": self.nodes, "meshes": self.meshes, "materials": self.materials}
        if self.images:
            document["images"] = [{"bufferView": self._view(data), "mimeType": mime} for data, mime in self.images]
            document["textures"] = [{"source": number} for number in range(len(self.images))]
        document |= {"accessors": self.accessors, "bufferViews": self.views}
        document["buffers"] = [{"byteLength": len(self.content)}]
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(self.content))
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.content), b"BIN\0")
        path.write_bytes(head + chunks + bytes(self.content))


def _packed(row: NDArray[np.uint8]) -> bytes:
    """Return one component of a row in the run lengths of Radiance."""
    ends = np.append(np.flatnonzero(np.diff(row)) + 1, len(row))
    starts, out, loose = np.concatenate([[0], ends[:-1]]), bytearray(), bytearray()

    def spill() -> None:
        for first in range(0, len(loose), 128):
            some = loose[first : first + 128]
            out.extend([len(some), *some])
        loose.clear()

    for start, end in zip(starts, ends, strict=True):
        if end - start < 4:
            loose.extend(row[start:end].tolist())
            continue
        spill()
        for first in range(start, end, 127):
            out.extend([128 + min(127, end - first), int(row[start])])
    spill()
    return bytes(out)


def write_hdr(path: Path, pixels: NDArray[np.float64]) -> None:
    """Write a picture, (height, width, 3), as Radiance RGBE with run lengths."""
    height, width = pixels.shape[:2]
    mantissa, exponent = np.frexp(pixels.max(axis=-1))
    scale = np.where(mantissa > 0, np.ldexp(256.0, -exponent), 0)
    codes = np.concatenate([np.minimum(pixels * scale[..., None], 255), (exponent + 128)[..., None]], axis=-1)
    out = bytearray(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode())
    for row in codes.astype(np.uint8):
        out += struct.pack(">BBH", 2, 2, width) + b"".join(_packed(row[:, part]) for part in range(4))
    path.write_bytes(bytes(out))
