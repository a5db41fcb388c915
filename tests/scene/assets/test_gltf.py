"""glTF files: arrays, nodes and primitives."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.pictures import read_picture
from rptcam_cl.scene.placement import SMALLEST_STRETCH_RATIO

from .conftest import Read
from .gltf_writer import GltfWriter, triangle

TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_same_file_in_its_three_forms(read: Read, tmp_path: Path) -> None:
    writer = triangle()
    (tmp_path / "data file.bin").write_bytes(writer.binary)
    forms = [read("a.glb", writer.glb()), read("a.gltf", writer.gltf()), read("b.gltf", writer.gltf("data%20file.bin"))]
    assert len({contents.parts[0].mesh.content_hash for contents in forms}) == 1
    (part,) = forms[0].parts
    assert part.mesh.positions[part.mesh.faces].tolist() == [TRIANGLE]
    assert part.name == "leaf"


def test_one_mesh_in_two_nodes_is_one_mesh_at_two_places(read: Read) -> None:
    writer = triangle()
    writer.json["nodes"] = [
        {"translation": [1, 2, 3], "children": [1, 2], "name": "root"},
        {"mesh": 0, "scale": [2, 2, 2], "name": "big"},
        {"mesh": 0, "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)], "scale": [1, 3, 1]},
    ]
    big, turned = read("a.glb", writer.glb()).parts
    assert big.mesh is turned.mesh
    assert (big.name, turned.name) == ("big", "leaf")
    assert np.allclose(big.placement, [[2, 0, 0, 1], [0, 2, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]])
    # Scaled first, then turned by 90 degrees about z: +x to +y, and +y (three times as long) to -x.
    assert np.allclose(turned.placement, [[0, -3, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


def test_matrix_of_a_node_is_by_columns(read: Read) -> None:
    writer = triangle()
    writer.json["nodes"] = [{"mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]}]
    (part,) = read("a.glb", writer.glb()).parts
    assert part.placement.tolist() == [[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]


def test_only_the_default_scene_is_shown(read: Read) -> None:
    writer = triangle()
    writer.json["nodes"] = [{"mesh": 0, "name": "a"}, {"mesh": 0, "name": "b"}]
    writer.json["scenes"] = [{"nodes": [0]}, {"nodes": [1]}]
    assert [part.name for part in read("a.glb", writer.glb()).parts] == ["a"]
    writer.json["scene"] = 1
    assert [part.name for part in read("a.glb", writer.glb()).parts] == ["b"]
    del writer.json["scenes"], writer.json["scene"]
    assert [part.name for part in read("a.glb", writer.glb()).parts] == ["a", "b"]


def test_primitives_of_a_mesh_are_parts_with_their_materials(read: Read) -> None:
    writer = triangle(material=1)
    other = writer.array([[0, 0, 5], [1, 0, 5], [0, 1, 5]])
    writer.json["meshes"][0]["primitives"].append({"attributes": {"POSITION": other}, "material": 0})
    writer.json["materials"] = [{"name": "one"}, {"name": "two"}]
    names = [part.material.name for part in read("a.glb", writer.glb()).parts if part.material is not None]
    assert names == ["two", "one"]


def test_texture_coordinates_are_turned_upwards_and_normals_taken(read: Read) -> None:
    writer = triangle()
    attributes = writer.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_0"] = writer.array([[0, 0], [1, 0], [0, 1]])
    attributes["NORMAL"] = writer.array([[0, 0, 1], [0, 1, 0], [1, 0, 0]])
    mesh = read("a.glb", writer.glb()).parts[0].mesh
    assert mesh.uvs is not None and mesh.normals is not None
    assert mesh.uvs.tolist() == [[0, 1], [1, 1], [0, 0]]
    assert mesh.normals.tolist() == [[0, 0, 1], [0, 1, 0], [1, 0, 0]]


@pytest.mark.parametrize(
    ("mode", "faces"),
    [
        (4, [[0, 1, 2], [1, 3, 2]]),
        (5, [[0, 1, 2], [2, 1, 3], [2, 3, 4]]),
        (6, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]),
    ],
)
def test_lists_strips_and_fans(read: Read, mode: int, faces: list[list[int]]) -> None:
    writer = GltfWriter()
    points = np.array([[0, 0, 0], [0, -1, 0], [1, 0, 0], [1, 1, 0.5], [2, 0, 1]], np.float32)
    position = writer.array(points)
    primitive: dict[str, Any] = {"attributes": {"POSITION": position}, "mode": mode}
    if mode == 4:
        primitive["indices"] = writer.array([0, 1, 2, 1, 3, 2], "u2")
    writer.json |= {"meshes": [{"primitives": [primitive]}], "nodes": [{"mesh": 0}]}
    mesh = read("a.glb", writer.glb()).parts[0].mesh
    assert np.array_equal(mesh.positions[mesh.faces], points[faces])


def test_points_and_lines_are_left_out(read: Read) -> None:
    writer = triangle()
    writer.json["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 1})
    assert len(read("a.glb", writer.glb()).parts) == 1


def test_interleaved_normalized_and_sparse_arrays(read: Read) -> None:
    writer = GltfWriter()
    rows = np.zeros(3, [("p", "<i2", 3), ("pad", "<i2"), ("t", "<f4", 2)])
    rows["p"] = [[0, 0, 0], [32767, 0, 0], [0, 32767, 0]]
    rows["t"] = [[0, 1], [1, 1], [0, 0]]
    view = writer.view(rows.tobytes(), byteStride=rows.itemsize)
    places, values = writer.view(np.array([2], "<u2").tobytes()), writer.view(np.array([0, -16384, 0], "<i2").tobytes())
    indices = {"bufferView": places, "componentType": 5123}
    sparse = {"count": 1, "indices": indices, "values": {"bufferView": values}}
    writer.json["accessors"] = [
        {"bufferView": view, "componentType": 5122, "normalized": True, "count": 3, "type": "VEC3", "sparse": sparse},
        {"bufferView": view, "byteOffset": 8, "componentType": 5126, "count": 3, "type": "VEC2"},
    ]  # fmt: skip
    writer.json |= {
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}}]}],
        "nodes": [{"mesh": 0}],
    }
    mesh = read("a.glb", writer.glb()).parts[0].mesh
    assert mesh.uvs is not None
    assert np.allclose(mesh.positions, [[0, 0, 0], [1, 0, 0], [0, -0.5, 0]], atol=1e-4)
    assert mesh.uvs.tolist() == [[0, 0], [1, 0], [0, 1]]


def test_node_without_size_shows_nothing(read: Read) -> None:
    writer = triangle()
    writer.json["nodes"] = [{"mesh": 0, "scale": [0, 0, 0]}, {"mesh": 0}]
    writer.json["scenes"] = [{"nodes": [0, 1]}]
    assert len(read("a.glb", writer.glb()).parts) == 1


def test_what_changes_the_looks_and_is_left_out_is_noted(read: Read) -> None:
    writer = triangle(targets=[{"COLOR_0": 0}])
    writer.json |= {"animations": [{}], "cameras": [{}], "extensionsUsed": ["KHR_materials_variants"]}
    writer.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    notes = [note.partition("glTF: ")[2] for note in read("a.glb", writer.glb()).notes]
    assert notes == [
        "animations are left out, and the pose is at rest; `time_s` gives a moment of them",
        "lamps are left out of an object; `rptcam new` makes a scene with them",
        "morph targets of colours and texture coordinates are left out",
        "variants of materials are left out; the default materials show",
    ]


def test_alpha_of_colours_counts_for_nothing_and_is_noted_where_it_would(read: Read) -> None:
    writer = triangle(material=0)
    attributes = writer.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["COLOR_0"] = writer.array([[1, 1, 1, 0.5]] * 3)
    for mode, noted in (("OPAQUE", False), ("BLEND", True), ("MASK", True)):
        writer.json["materials"] = [{"alphaMode": mode}]
        notes = read("a.glb", writer.glb()).notes
        assert any("primitives[0]: the alpha of its colours is left out" in note for note in notes) is noted


def test_points_and_lines_are_noted(read: Read) -> None:
    writer = triangle()
    position = writer.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    writer.json["meshes"][0]["primitives"].append({"attributes": {"POSITION": position}, "mode": 1})
    contents = read("a.glb", writer.glb())
    assert len(contents.parts) == 1
    assert any("points and lines are left out" in note for note in contents.notes)


def test_nodes_that_are_not_visible_show_nothing_nor_do_those_below_them(read: Read) -> None:
    writer = triangle()
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}, "children": [1]}
    shown = {"mesh": 0, "name": "shown", "extensions": {"KHR_node_visibility": {"visible": True}}}
    writer.json["nodes"] = [hidden, {"mesh": 0, "name": "below"}, shown]
    writer.json |= {"scenes": [{"nodes": [0, 2]}], "extensionsRequired": ["KHR_node_visibility"]}
    assert [part.name for part in read("a.glb", writer.glb()).parts] == ["shown"]


def test_instances_of_a_node_are_placed_below_it(read: Read) -> None:
    writer = triangle()
    attributes = {
        "TRANSLATION": writer.array([[1, 0, 0], [0, 2, 0]]),
        "ROTATION": writer.array([[0, 0, 0, 127], [0, 0, 90, 90]], "i1", normalized=True),
        "SCALE": writer.array([[1, 1, 1], [3, 3, 3]]),
    }
    extensions = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    writer.json["nodes"] = [{"mesh": 0, "scale": [2, 2, 2], "extensions": extensions}]
    writer.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    first, second = read("a.glb", writer.glb()).parts
    assert first.mesh is second.mesh
    assert np.allclose(first.placement, [[2, 0, 0, 2], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]])
    assert np.allclose(second.placement, [[0, -6, 0, 0], [6, 0, 0, 4], [0, 0, 6, 0], [0, 0, 0, 1]], atol=1e-6)


def test_instances_of_different_lengths_are_refused(read: Read) -> None:
    writer = triangle()
    attributes = {"TRANSLATION": writer.array([[1, 0, 0], [0, 2, 0]]), "SCALE": writer.array([[1, 1, 1]])}
    writer.json["nodes"] = [{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}]
    with pytest.raises(InputError, match="TRANSLATION, ROTATION and SCALE are not of one length"):
        read("a.glb", writer.glb())


@pytest.mark.parametrize("dtype", ["f4", "u1", "u2"])
def test_colours_of_vertices_are_linear_over_each_triangle(read: Read, dtype: str) -> None:
    rng = np.random.default_rng(3)
    positions, colours = rng.random((7, 3)), (1 + rng.random((7, 3))) / 3  # so that no fourth texel is cut at 0 or 1
    top = 1 if dtype == "f4" else np.iinfo(dtype).max
    writer = GltfWriter()
    stored = colours if dtype == "f4" else np.round(colours * top)
    attributes = {"POSITION": writer.array(positions), "COLOR_0": writer.array(stored, dtype, normalized=dtype != "f4")}
    indices = writer.array([0, 1, 2, 2, 3, 4, 4, 5, 6, 6, 0, 3, 1, 5, 3], "u2")
    writer.json["meshes"] = [{"primitives": [{"attributes": attributes, "indices": indices}]}]
    writer.json |= {"nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}]}
    (part,) = read("a.glb", writer.glb()).parts
    assert part.material is not None
    assert part.material.base_texture is not None
    assert isinstance(part.material.base_texture.source, bytes)
    texels = read_picture(part.material.base_texture.source).texels[..., :3] / 255.0
    assert texels.shape == (4, 6, 3)  # two by two for each of five triangles, in three columns
    linear = np.where(texels <= 0.04045, texels / 12.92, ((texels + 0.055) / 1.055) ** 2.4)
    mesh = part.mesh
    assert mesh.uvs is not None
    for face in mesh.faces:
        nearest = [np.abs(positions - mesh.origin - corner).sum(axis=1).argmin() for corner in mesh.positions[face]]
        for weights in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.3, 0.1], [0, 0.5, 0.5]):
            u, v = weights @ mesh.uvs[face]
            shown = bilinear(linear, u * linear.shape[1] - 0.5, (1 - v) * linear.shape[0] - 0.5)
            assert shown == pytest.approx(weights @ colours[nearest], abs=0.006)  # 8 bits of sRGB


def bilinear(texels: np.ndarray, x: float, y: float) -> np.ndarray:
    height, width, _ = texels.shape
    left, top = int(np.floor(x + 1e-4)), int(np.floor(y + 1e-4))
    a, b = x - left, y - top
    columns, rows = np.clip([left, left + 1], 0, width - 1), np.clip([top, top + 1], 0, height - 1)
    corners = texels[np.ix_(rows, columns)]
    return (1 - b) * ((1 - a) * corners[0, 0] + a * corners[0, 1]) + b * ((1 - a) * corners[1, 0] + a * corners[1, 1])


def test_colours_of_vertices_beside_a_texture_are_noted(read: Read) -> None:
    writer = triangle(material=0)
    attributes = writer.json["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"COLOR_0": writer.array(TRIANGLE), "TEXCOORD_0": writer.array([[0, 0], [1, 0], [0, 1]])}
    writer.json |= {
        "images": [{"uri": "a.png"}],
        "textures": [{"source": 0}],
        "materials": [{"normalTexture": {"index": 0}}],
    }
    assert "colours of vertices are left out beside a texture" in read("a.glb", writer.glb()).notes[0]


def test_colours_of_too_many_triangles_are_noted(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = triangle(indices=1)
    writer.json["meshes"][0]["primitives"][0]["indices"] = writer.array([0, 1, 2, 0, 2, 1], "u1")
    writer.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = writer.array(TRIANGLE)
    monkeypatch.setattr("rptcam_cl.scene.assets.mesh.MOST_TRIANGLES", 8)
    assert not read("a.glb", writer.glb()).notes
    monkeypatch.setattr("rptcam_cl.scene.assets.mesh.MOST_TRIANGLES", 4)
    contents = read("a.glb", writer.glb())
    assert contents.notes[0].endswith("colours of more than 1 triangles are left out")
    assert len(contents.parts[0].mesh.faces) == 2


def test_array_without_data_is_zero_but_for_its_sparse_entries(read: Read) -> None:
    writer = GltfWriter()
    indices = {"bufferView": writer.view(b"\1\2"), "componentType": 5121}
    values = {"bufferView": writer.view(np.array([[1, 0, 0], [0, 1, 0]], "<f4").tobytes())}
    sparse = {"count": 2, "indices": indices, "values": values}
    writer.json["accessors"] = [{"componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse}]
    writer.json |= {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}]}
    mesh = read("a.glb", writer.glb()).parts[0].mesh
    assert mesh.positions[mesh.faces].tolist() == [TRIANGLE]


@pytest.mark.parametrize(("stride", "width"), [(None, 3), (12, 3), (16, 3), (252, 3), (None, 4), (16, 4), (20, 4)])
def test_entries_lie_as_far_apart_as_the_view_says(read: Read, stride: int | None, width: int) -> None:
    apart = stride or 4 * width
    rows = np.zeros((3, apart), np.uint8)
    rows[:, : 4 * width] = np.pad(np.array(TRIANGLE, "<f4"), ((0, 0), (0, width - 3))).view(np.uint8)
    writer = triangle()
    content = bytes(8) + rows.tobytes()[: 2 * apart + 4 * width]  # no more than to the end of the last entry
    view = writer.view(content, **({"byteStride": stride} if stride else {}))
    accessor = {"bufferView": view, "byteOffset": 8, "componentType": 5126, "count": 3, "type": f"VEC{width}"}
    writer.json["accessors"].append(accessor)
    attributes = writer.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["POSITION" if width == 3 else "COLOR_0"] = 1
    (part,) = read("a.glb", writer.glb()).parts
    assert part.mesh.positions[part.mesh.faces].tolist() == [TRIANGLE]
    assert (part.material.base_texture is not None) == (width == 4)


@pytest.mark.parametrize("primitive", [{"attributes": {}}, {"attributes": {"POSITION": 1}}, {"mode": 0}])
def test_primitives_without_triangles_show_nothing(read: Read, primitive: dict[str, Any]) -> None:
    writer = triangle()
    writer.json["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 0, "type": "VEC3"})
    writer.json["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}} | primitive)
    assert len(read("a.glb", writer.glb()).parts) == 1


def test_flattest_transform_that_is_allowed_is_shown(read: Read) -> None:
    writer = triangle()
    writer.json["nodes"] = [{"mesh": 0, "scale": [1, 1, SMALLEST_STRETCH_RATIO]}]
    assert read("a.glb", writer.glb()).parts
    writer.json["nodes"] = [{"mesh": 0, "scale": [1, 1, 0.99 * SMALLEST_STRETCH_RATIO]}]
    with pytest.raises(InputError, match="flattens space"):
        read("b.glb", writer.glb())
