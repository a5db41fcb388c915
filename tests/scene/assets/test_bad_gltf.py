"""glTF files that are refused: each with the key and the reason."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.errors import InputError

from .conftest import Read
from .gltf_writer import GltfWriter, triangle


def changed(path: str, value: Any) -> Callable[[GltfWriter], bytes]:
    """Return what writes the triangle with one key of its JSON changed, or taken out."""

    def write(writer: GltfWriter) -> bytes:
        *steps, last = (int(step) if step.isdigit() else step for step in path.split("."))
        part: Any = writer.json
        for step in steps:
            part = part[step]
        if value is None:
            del part[last]
        else:
            part[last] = value
        return writer.glb()

    return write


def with_bytes(place: int, content: bytes) -> Callable[[GltfWriter], bytes]:
    def write(writer: GltfWriter) -> bytes:
        whole = writer.glb()
        return whole[:place] + content + whole[place + len(content) :]

    return write


def cut(writer: GltfWriter) -> bytes:
    return writer.glb()[:-1]


def sparse(component: int, offset: int) -> dict[str, Any]:
    """A sparse accessor whose index is read from the positions: 1.0 is the bytes 0 0 128 63, from byte 12 on."""
    indices = {"bufferView": 0, "byteOffset": offset, "componentType": component}
    return {"count": 1, "indices": indices, "values": {"bufferView": 0}}


def ragged(writer: GltfWriter) -> bytes:
    writer.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = writer.array([[0, 0, 1], [0, 0, 1]])
    return writer.glb()


def signed(writer: GltfWriter) -> bytes:
    writer.json["meshes"][0]["primitives"][0]["indices"] = writer.array([0, 1, 2], "i2")
    return writer.glb()


BEYOND = [{"children": [1], "scale": [1e200] * 3}, {"mesh": 0, "scale": [1e200] * 3}]
CYCLE = [{"mesh": 0, "children": [1]}, {"children": [0]}]
TEXTURED = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}

# (what writes the file, what the message must have)
GLTF: list[tuple[Callable[[GltfWriter], bytes], str]] = [
    (cut, ": is cut short: says it has"),
    (with_bytes(4, b"\1"), ": is binary glTF of version 1"),
    (with_bytes(12, b"\xff\xff\xff\x0f"), ": is cut short: a chunk of"),
    (with_bytes(16, b"JUNK"), ": has no JSON chunk"),
    (with_bytes(20, b"\xff"), ": its JSON cannot be read"),
    (lambda writer: b"[1, 2]", "glTF: must be a mapping"),
    (lambda writer: b"[" * 100_000, ": its JSON cannot be read"),
    (lambda writer: b"{}", "is not glTF 2.0 (got version none"),
    (changed("asset.version", "1.0"), "is not glTF 2.0 (got version 1.0"),
    (lambda writer: b'{"meshes": {"leaf": {}}}', "is not glTF 2.0 (got version 1.0, by its form"),
    (lambda writer: b'{"asset": {"version": 1}, "meshes": {}}', "is not glTF 2.0 (got version 1.0, by its form"),
    (
        changed("extensionsRequired", ["KHR_texture_basisu"]),
        "needs extensions that are not read (got KHR_texture_basisu",
    ),
    (changed("asset.version", 2), "asset.version: must be text (got 2; allowed: text)"),
    (changed("extensionsRequired", [3]), "extensionsRequired: must be a list of texts (got [3]"),
    (changed("extensionsRequired", "x" * 70), f"must be a list (got '{'x' * 56}…; allowed: a list)"),
    (changed("accessors.0.sparse", sparse(5126, 0)), "sparse.indices.componentType: is no index (got 5126"),
    (changed("accessors.0.sparse", sparse(5121, 14)), "sparse.indices: names an entry that is not there (got 128)"),
    (ragged, "attributes.NORMAL: has 2 entries (got 1; allowed: 3, as POSITION has)"),
    (signed, "primitives[0].indices: are not whole numbers (got 1; allowed: an accessor of unsigned"),
    (changed("nodes", []), "nodes: must be a list of whole numbers in their range (got [0]"),
    (changed("scenes", [{"nodes": []}]), "its scene shows no triangles"),
    (changed("scene", 4), "scene: must be a whole number in its range (got 4"),
    (changed("nodes", CYCLE), "nodes[0]: is reached twice"),
    (changed("nodes.0.mesh", 7), "nodes[0].mesh: must be a whole number in its range (got 7; allowed: 0 to 0)"),
    (changed("nodes.0.scale", [1, 1]), "nodes[0].scale: must be 3 finite numbers"),
    (changed("nodes.0.scale", [1, 1, 0]), "nodes[0]: its transform flattens space"),
    (changed("nodes", BEYOND), "nodes[1]: its transform is beyond floating point"),
    (changed("nodes.0.rotation", [0, 0, 0, 0]), "nodes[0].rotation: is the zero quaternion"),
    (changed("nodes.0.matrix", list(range(16))), "nodes[0].matrix: is not affine"),
    (changed("meshes.0.primitives", 3), "meshes[0].primitives: must be a list"),
    (
        changed("meshes.0.primitives.0.attributes.POSITION", 9),
        "attributes.POSITION: must be a whole number in its range",
    ),
    (changed("meshes.0.primitives.0.attributes.POSITION", True), "attributes.POSITION: must be a whole number"),
    (
        changed("meshes.0.primitives.0.indices", 0),
        "accessors[0].type: does not fit its use (got 'VEC3'; allowed: SCALAR)",
    ),
    (changed("meshes.0.primitives.0.material", 0), "primitives[0].material: must be a whole number in its range"),
    (changed("accessors.0.type", "MAT9"), "accessors[0].type: does not fit its use"),
    (changed("accessors.0.componentType", 1), "accessors[0].componentType: is not known"),
    (changed("accessors.0.count", 4), "accessors[0]: reaches beyond its view"),
    (changed("accessors.0.count", 10**12), "accessors[0].count: must be a whole number in its range"),
    (
        changed("accessors.0", {"componentType": 5126, "count": 2**30, "type": "VEC3"}),
        "is too large for an array without",
    ),
    (changed("accessors.0.byteOffset", 40), "accessors[0]: reaches beyond its view"),
    (changed("bufferViews.0.byteLength", 10**9), "bufferViews[0]: reaches beyond its buffer"),
    (changed("bufferViews.0.byteStride", 4), "accessors[0]: its entries overlap"),
    (changed("bufferViews.0.buffer", 1), "bufferViews[0].buffer: must be a whole number"),
    (changed("materials", [{"alphaMode": "GLOW"}]), "materials[0].alphaMode: is not known"),
    (
        changed("materials", [{"pbrMetallicRoughness": {"roughnessFactor": 2}}]),
        "roughnessFactor: must be a number in its range",
    ),
    (changed("materials", [{"emissiveFactor": [float("nan"), 0, 0]}]), "emissiveFactor: must be 3 finite numbers"),
    (
        changed("materials", [TEXTURED]),
        "baseColorTexture.index: must be a whole number in its range (got 0; allowed: none)",
    ),
]


@pytest.mark.parametrize(("write", "message"), GLTF, ids=[row[1] for row in GLTF])
def test_unusable_gltf_is_refused(
    read: Read, tmp_path: Path, write: Callable[[GltfWriter], bytes], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        read("a.glb", write(triangle()))
    assert str(caught.value).startswith(str(tmp_path / "a.glb"))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("data:;base64,****", "buffers[0].uri: is not base64"),
        ("data:,abc", "buffers[0]: is cut short: says it has 36 bytes (got 3 bytes)"),
        ("https://example.org/a.bin", "buffers[0].uri: is not a file"),
    ],
)
def test_buffer_that_is_not_there_is_refused(read: Read, uri: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        read("a.gltf", triangle().gltf(uri))


def test_json_of_a_glb_without_data_is_refused(read: Read) -> None:
    whole = json.loads(triangle().gltf("x.bin"))
    del whole["buffers"][0]["uri"]
    with pytest.raises(InputError, match=r"buffers\[0\]: has no uri, and the file no binary chunk"):
        read("a.gltf", json.dumps(whole))


def test_more_json_than_allowed_is_refused(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    text = triangle().gltf()
    monkeypatch.setattr("rptcam_cl.scene.assets.gltf_data.MOST_JSON_BYTES", len(text))
    assert read("a.gltf", text).parts
    with pytest.raises(InputError, match=f"a.gltf: has more than {len(text)} bytes of JSON"):
        read("a.gltf", text + " ")
