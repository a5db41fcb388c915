"""Files of meshes with pictures, seen by a camera: the right way up, in the right place and colour."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import looking, pixels
from tests.scene.assets.gltf_writer import GltfWriter
from tests.support.cases import slow

# Upper left, upper right; lower left, lower right.
COLOURS = np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]], np.float64)
FACTOR = (0.5, 2.0, 4.0)


@pytest.fixture
def picture(tmp_path: Path) -> bytes:
    """A picture of four colours, also in the test's folder."""
    file = io.BytesIO()
    texels = (255 * COLOURS).astype(np.uint8).repeat(32, axis=0).repeat(32, axis=1)
    Image.fromarray(texels).save(file, "PNG")
    (tmp_path / "four.png").write_bytes(file.getvalue())
    return file.getvalue()


def glb(picture: bytes) -> bytes:
    """A square that lies in the plane z = 0 of its mesh, and that its node sets upright (+y to +z)."""
    writer = GltfWriter()
    attributes = {
        "POSITION": writer.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]),
        "TEXCOORD_0": writer.array([[0, 1], [1, 1], [1, 0], [0, 0]]),
    }
    primitive = {"attributes": attributes, "indices": writer.array([0, 1, 2, 0, 2, 3], "u1"), "material": 0}
    half = float(np.sqrt(0.5))
    writer.json |= {
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0, "rotation": [half, 0, 0, half]}],
        "images": [{"bufferView": writer.view(picture), "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [{
            "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}, "emissiveTexture": {"index": 0},
            "emissiveFactor": [0.125, 0.5, 1],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}},
        }],
    }  # fmt: skip
    return writer.glb()


OBJ = """mtllib four.mtl
v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
usemtl four
f 1/1 2/2 3/3 4/4
"""
MTL = "newmtl four\nKd 0 0 0\nKs 0 0 0\nKe 0.5 2 4\nmap_Ke four.png\n"


@pytest.mark.parametrize("name", ["four.glb", slow("four.obj")])
def test_picture_is_the_right_way_up(tmp_path: Path, picture: bytes, name: str) -> None:
    (tmp_path / "four.glb").write_bytes(glb(picture))
    (tmp_path / "four.obj").write_text(OBJ)
    (tmp_path / "four.mtl").write_text(MTL)
    scene = load_scene(
        {
            "film": {"resolution": [4, 4]},
            "camera": looking([0, -10, 0], [0, 0, 0], fov=5),
            "render": {"spp": 4, "max_depth": 1},
            "objects": [{"shape": "mesh", "file": name}],
        },
        base_dir=tmp_path,
    )
    assert scene.warnings == ()
    film = pixels(scene)
    assert np.allclose(film[::3, ::3], COLOURS * FACTOR, rtol=1e-4)
