"""Compressed glTF files: what the decoders give back, and what is said where one is missing or data are damaged."""

import sys

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.gltf import JsonNode, meshopt_bytes

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


def with_meshopt(content: bytes, indices: bytes | None = None) -> GltfWriter:
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
    writer.view(content, extensions={"EXT_meshopt_compression": packed})
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
        view = writer.view(indices, extensions={"EXT_meshopt_compression": packed})
        writer.json["accessors"].append({"bufferView": view, "componentType": 5123, "count": 6, "type": "SCALAR"})
        order = 1
    primitive = {"attributes": {"POSITION": 0}, "indices": order}
    writer.json |= {"meshes": [{"primitives": [primitive]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
    return writer


def test_meshoptimizer_gives_positions_and_indices_back(read: Read) -> None:
    library = pytest.importorskip("meshoptimizer")
    packed = library.encode_vertex_buffer(POSITIONS, 4, 12), library.encode_index_buffer(FACES.ravel(), 6, 4)
    (part,) = read("a.glb", with_meshopt(*packed).glb()).parts
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


@pytest.mark.parametrize("changes", [{"mode": "POINTS"}, {"filter": "BLUR"}, {"count": 2**30}])
def test_wrong_words_of_meshoptimizer_are_refused(read: Read, changes: dict[str, object]) -> None:
    pytest.importorskip("meshoptimizer")
    writer = with_meshopt(bytes(60))
    writer.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"] |= changes
    with pytest.raises(InputError, match="EXT_meshopt_compression"):
        read("a.glb", writer.glb())
