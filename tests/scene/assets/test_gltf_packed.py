"""Compressed glTF files: what the decoders give back, and what is said where one is missing or data are damaged."""

import re
import sys

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.gltf_data import JsonNode, meshopt_bytes

from .conftest import Read
from .gltf_writer import GltfWriter

POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]], np.float32)
FACES = np.array([[0, 1, 2], [2, 1, 3]], np.uint32)
UVS = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32)


def with_draco(content: bytes | None = None) -> GltfWriter:
    """Two triangles that Draco compressed; accessors say how many and of which type, but hold no data."""
    draco = pytest.importorskip("DracoPy")
    writer = GltfWriter()
    packed = draco.encode(
        POSITIONS, faces=FACES, tex_coord=UVS.astype(np.float64), quantization_bits=16, preserve_order=True
    )
    kinds = {row["attribute_type"]: row["unique_id"] for row in draco.decode(packed).attributes}
    ids = {"POSITION": int(kinds[0]), "TEXCOORD_0": int(kinds[3])}
    writer.json["accessors"] = [{"componentType": 5126, "count": 4, "type": kind} for kind in ("VEC3", "VEC2")] + [
        {"componentType": 5123, "count": 6, "type": "SCALAR"}
    ]
    view = writer.view(packed if content is None else content)
    extensions = {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": ids}}
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "extensions": extensions}
    writer.json |= {"meshes": [{"primitives": [primitive]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
    writer.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    return writer


def test_draco_gives_the_triangles_and_their_texture_coordinates_back(read: Read) -> None:
    (part,) = read("a.glb", with_draco().glb()).parts
    mesh = part.mesh
    corners = {tuple(np.round(row, 3)) for row in (mesh.positions[mesh.faces] + mesh.origin).reshape(-1, 3).tolist()}
    assert corners == {tuple(row) for row in POSITIONS.tolist()}
    assert mesh.uvs is not None
    where = mesh.positions + mesh.origin
    np.testing.assert_allclose(mesh.uvs, np.column_stack([where[:, 0], 1 - where[:, 1]]), atol=1e-3)


def test_damaged_draco_is_refused(read: Read) -> None:
    with pytest.raises(InputError, match=r"KHR_draco_mesh_compression: is damaged"):
        read("a.glb", with_draco(bytes(40)).glb())


def test_missing_decoders_are_named_with_their_extra(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    draco, meshopt = with_draco().glb(), with_meshopt(bytes(20)).glb()
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    with pytest.raises(InputError, match=r'compressed by Draco, .* pip install "rptcam_cl\[gltf\]"'):
        read("a.glb", draco)
    with pytest.raises(InputError, match=r'compressed by meshoptimizer, .* pip install "rptcam_cl\[meshopt\]"'):
        read("b.glb", meshopt)


def with_meshopt(content: bytes, indices: bytes | None = None, name: str = "EXT_meshopt_compression") -> GltfWriter:
    """Two triangles whose positions, and indices if given, meshoptimizer compressed."""
    writer = GltfWriter()
    packed = {
        "buffer": 0,
        "byteOffset": 0,
        "byteLength": len(content),
        "byteStride": 12,
        "count": 4,
        "mode": "ATTRIBUTES",
    }
    writer.view(content, extensions={name: packed})
    writer.json["accessors"] = [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}]
    if indices is None:
        order = writer.array(FACES.ravel(), "u4")
    else:
        start = len(writer.binary) + -len(writer.binary) % 4
        packed = {
            "buffer": 0,
            "byteOffset": start,
            "byteLength": len(indices),
            "byteStride": 2,
            "count": 6,
            "mode": "TRIANGLES",
        }
        view = writer.view(indices, extensions={name: packed})
        writer.json["accessors"].append({"bufferView": view, "componentType": 5123, "count": 6, "type": "SCALAR"})
        order = 1
    primitive = {"attributes": {"POSITION": 0}, "indices": order}
    writer.json |= {"meshes": [{"primitives": [primitive]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
    return writer


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshoptimizer_gives_positions_and_indices_back(read: Read, name: str) -> None:
    library = pytest.importorskip("meshoptimizer")
    packed = library.encode_vertex_buffer(POSITIONS, 4, 12), library.encode_index_buffer(FACES.ravel(), 6, 4)
    (part,) = read("a.glb", with_meshopt(*packed, name).glb()).parts
    corners = part.mesh.positions[part.mesh.faces] + part.mesh.origin
    turns = [{tuple(map(tuple, np.roll(face, k, axis=0))) for k in range(3)} for face in POSITIONS[FACES]]
    assert len(corners) == 2
    assert all(any(tuple(map(tuple, face)) in turn for turn in turns) for face in corners)


def test_filters_of_meshoptimizer_are_undone(read: Read) -> None:
    # by the words of EXT_meshopt_compression: x, y and one of octahedral normals; mantissa and exponent of numbers
    library = pytest.importorskip("meshoptimizer")
    octahedral = np.array([[0, 0, 127, 5], [127, 0, 127, 6], [40, -40, 127, 7]], np.int8)
    third = 40 / np.sqrt(2 * 40**2 + 47**2) * 127  # z is what x and y leave of one
    normals = [[0, 0, 127, 5], [127, 0, 0, 6], [round(third), -round(third), round(47 / 40 * third), 7]]
    exponents = np.array([[3 | 255 << 24], [5 | 2 << 24], [(1 << 24) - 7]], np.uint32)
    for rows, way, expected, kind in (
        (octahedral, "OCTAHEDRAL", normals, np.int8),
        (exponents, "EXPONENTIAL", [[1.5], [20.0], [-7.0]], np.float32),
    ):
        packed = library.encode_vertex_buffer(rows.view(np.uint8), 3, 4)
        words = JsonNode({"count": 3, "byteStride": 4, "mode": "ATTRIBUTES", "filter": way}, "view")
        assert meshopt_bytes(words, packed).view(kind).reshape(3, -1).tolist() == expected


class Codec:
    """Stands in for the library where it is not installed: its codes are the bytes themselves, or sums of numbers."""

    def decode_vertex_buffer(self, count: int, size: int, content: bytes) -> np.ndarray:
        if len(content) != count * size:
            raise RuntimeError("of another length")
        return np.frombuffer(content, np.uint8).reshape(count, size)

    def decode_index_buffer(self, count: int, size: int, content: bytes) -> np.ndarray:
        assert size == 4
        return np.frombuffer(content, np.uint32, count)

    def decode_index_sequence(self, count: int, size: int, content: bytes) -> np.ndarray:
        return np.cumsum(self.decode_index_buffer(count, size, content))

    def decode_filter_oct(self, octets: np.ndarray, count: int, stride: int) -> None:
        octets.reshape(count, stride)[:, 0] += 100  # works on what it is given

    def decode_filter_exp(self, octets: np.ndarray, count: int, stride: int) -> np.ndarray:
        return octets.reshape(count, stride)[::-1]  # returns something new


@pytest.fixture
def codec(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "meshoptimizer", Codec())


WORDS = {"mode": "ATTRIBUTES", "count": 2, "byteStride": 4}
EIGHT = bytes(range(8))


@pytest.mark.parametrize(
    ("changes", "content", "expected"),
    [
        ({}, EIGHT, [0, 1, 2, 3, 4, 5, 6, 7]),
        ({"filter": "NONE"}, EIGHT, [0, 1, 2, 3, 4, 5, 6, 7]),
        ({"filter": "OCTAHEDRAL"}, EIGHT, [100, 1, 2, 3, 104, 5, 6, 7]),
        ({"filter": "EXPONENTIAL"}, EIGHT, [4, 5, 6, 7, 0, 1, 2, 3]),
        ({"mode": "TRIANGLES"}, b"\5\0\0\0\2\1\0\0", [5, 0, 0, 0, 2, 1, 0, 0]),
        ({"mode": "TRIANGLES", "byteStride": 2}, b"\5\0\0\0\2\1\0\0", [5, 0, 2, 1]),
        ({"mode": "INDICES", "byteStride": 2}, b"\5\0\0\0\2\1\0\0", [5, 0, 7, 1]),
    ],
)
def test_modes_and_filters_choose_the_decoder(codec: None, changes: dict, content: bytes, expected: list[int]) -> None:
    found = meshopt_bytes(JsonNode(WORDS | changes, "view"), content)
    assert (found.dtype, found.tolist()) == (np.uint8, expected)


def test_packed_views_are_unpacked_once_and_count_as_others(read: Read, codec: None) -> None:
    writer = with_meshopt(POSITIONS.tobytes(), FACES.astype("<u4").tobytes())
    writer.json["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"})
    writer.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 2
    mesh = read("a.glb", writer.glb()).parts[0].mesh
    assert np.array_equal(mesh.positions[mesh.faces], POSITIONS[FACES])
    assert mesh.normals is not None


WRONG_WORDS: list[tuple[dict[str, object], str]] = [
    ({"mode": "POINTS"}, "view.mode: is not known (got 'POINTS'; allowed: ATTRIBUTES, TRIANGLES, INDICES)"),
    ({"filter": "BLUR"}, "view.filter: is not known (got 'BLUR'; allowed: NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL)"),
    ({"count": 2**30}, "view.count: does not fit a stride of 4"),
    ({"count": 0}, "view.count: does not fit a stride of 4"),
    ({"count": 2**31}, "view.count: must be a whole number in its range"),
    ({"byteStride": 257}, "view.byteStride: must be a whole number in its range"),
    ({"mode": "TRIANGLES", "byteStride": 8}, "view.count: does not fit a stride of 8"),
    ({"mode": "INDICES", "byteStride": 1}, "view.count: does not fit a stride of 1"),
    ({"count": 3}, "view: is damaged (of another length)"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG_WORDS)
def test_wrong_words_of_meshoptimizer_are_refused(codec: None, changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match="^" + re.escape(message)):
        meshopt_bytes(JsonNode(WORDS | changes, "view"), EIGHT)


def test_attribute_that_draco_has_not_is_refused(read: Read) -> None:
    writer = with_draco()
    writer.json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["attributes"]["POSITION"] = 99
    with pytest.raises(InputError, match=r"attributes\.POSITION: is not in the compressed data \(got 99; all"):
        read("a.glb", writer.glb())
