"""Files that are not there: all named in one error, or stood in for."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError, MissingFileError
from rptcam_cl.scene.load import load_scene
from tests.exchange.pbrt.test_files import TRIANGLE

SCENE: dict[str, Any] = {
    "film": {"resolution": [8, 8]},
    "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40},
    "materials": {
        "wood": {
            "kind": "matte",
            "reflectance": {"kind": "image", "file": "wood.png"},
            "normal_map": {"file": "bumps.png"},
        }
    },
    "objects": [
        {"shape": "rectangle", "corner": [-9, -9, 0], "edge_u": [18, 0, 0], "edge_v": [0, 18, 0], "material": "wood"},
        {"shape": "mesh", "file": "no.ply", "material": "wood"},
        {"shape": "mesh", "file": "there.ply", "material": "wood"},
        {"shape": "mesh", "file": "painted.gltf"},
    ],
    "environment": {"kind": "image", "file": "sky.exr"},
}
MISSING = ("wood.png", "bumps.png", "no.ply", "sky.exr", "paint.png")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "there.ply").write_bytes(TRIANGLE)
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes().hex()
    uri = "data:application/octet-stream," + "".join(f"%{positions[k : k + 2]}" for k in range(0, len(positions), 2))
    (tmp_path / "painted.gltf").write_text(json.dumps({
        "asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "images": [{"uri": "paint.png"}],
        "textures": [{"source": 0}],
        "materials": [{"name": "paint", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    }))  # fmt: skip
    return tmp_path


def test_all_that_is_missing_is_named_at_once(folder: Path) -> None:
    with pytest.raises(MissingFileError) as problem:
        load_scene(SCENE, base_dir=folder)
    lines = str(problem.value).splitlines()
    for name in MISSING:
        assert sum(f"no such file (got {folder / name})" in line for line in lines) == 1, (name, lines)
    assert len(lines) == len(MISSING)


def test_grey_stands_for_pictures_and_meshes_are_left_out(folder: Path) -> None:
    scene = load_scene(SCENE, base_dir=folder, missing="grey")
    assert len(scene.objects) == 3
    for name in MISSING:
        ending = "the object is left out" if name == "no.ply" else "grey stands for it"
        assert [text for text in scene.warnings if name in text and text.endswith(ending)], name
    image = rptcam_cl.render(scene, spp=256, seed=1)
    assert len(image.metadata["missing"]) == len(MISSING)
    # an even wall of grey 0.503 under an even sky of 0.503: the flat normal map changes nothing
    np.testing.assert_allclose(np.asarray(image)[0].mean(axis=0), 0.503**2, rtol=0.02)


def test_a_scene_with_all_its_files_has_nothing_in_their_place(folder: Path) -> None:
    scene = load_scene({**SCENE, "objects": SCENE["objects"][2:3], "materials": {"wood": {
        "kind": "matte", "reflectance": 0.5}}, "environment": None}, base_dir=folder, missing="grey")  # fmt: skip
    assert scene.stand_ins == ()


def test_files_outside_the_folder_are_refused_all_the_same(folder: Path) -> None:
    scene = {**SCENE, "environment": {"kind": "image", "file": "/etc/passwd"}}
    with pytest.raises(InputError, match="lies outside the scene's folder"):
        load_scene(scene, base_dir=folder, missing="grey")


def test_what_grey_cannot_stand_for_stays_an_error(folder: Path) -> None:
    lamp = {"kind": "ies", "file": "lamp.ies", "position": [0, 1, 0]}
    with pytest.raises(MissingFileError, match=r"lamp\.ies"):
        load_scene({**SCENE, "lights": [lamp]}, base_dir=folder, missing="grey")
