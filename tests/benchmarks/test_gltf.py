"""A textured GLB file beside Mitsuba: colours, which way pictures lie and repeat, where nodes put meshes, rough metal.

What both models have alike is compared: `specularFactor` 0, which leaves a matte base, and metal with Schlick's Fresnel
of a painted colour and painted roughness. A dielectric's gloss over a base is not: glTF and Mitsuba's `principled` mix
the two differently. Nor is rougher metal: shadowing and masking are correlated in ours and separable in Mitsuba, which
shows from about alpha 0.1 on; here alpha ends at 0.16.
"""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from benchmarks.worker import Worker
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from tests.benchmarks.comparing import BATCHES, assert_same_mean, assert_same_tiles, theirs
from tests.rendering.light.pictures import save_exr
from tests.rendering.pictures import batches, lamp, looking
from tests.scene.assets.gltf_writer import GltfWriter
from tests.support.statistics import Sampled

Array = NDArray[np.float64]
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
FACES = [[0, 1, 2], [0, 2, 3]]
# v runs downwards in glTF, as it does in Mitsuba; the floor's picture repeats, and neither lies straight.
FLOOR_UV = np.array([[-0.2, 1.7], [2.3, 1.7], [2.3, 0.2], [-0.2, 0.2]])
CARD_UV = np.array([[0.1, 0.9], [0.9, 0.9], [0.9, 0.1], [0.1, 0.1]])
FACTOR = (0.9, 0.8, 0.7)
ROUGHNESS = 0.4  # factor on the picture
HALF = float(np.sqrt(0.5))
# The floor lies: +y of the square to -z. The card stands, turned by 30 degrees about +y.
FLOOR = np.array([[2.5, 0, 0, 0.3], [0, 0, 2.0, 0], [0, -2.0, 0, -0.2], [0, 0, 0, 1]])
FLOOR_NODE = {"translation": [0.3, 0, -0.2], "rotation": [-HALF, 0, 0, HALF], "scale": [2.5, 2.0, 2.0]}
COS, SIN = np.cos(np.pi / 6), np.sin(np.pi / 6)
CARD = np.array([[COS, 0, SIN, -0.4], [0, 0.8, 0, 1.0], [-SIN, 0, COS, -1.0], [0, 0, 0, 1]])


def picture(seed: int, width: int, height: int) -> NDArray[np.uint8]:
    """A picture of smooth random colours, none like its mirror image."""
    coarse = np.random.default_rng(seed).integers(20, 250, (4, 6, 3), dtype=np.uint8)
    return np.array(Image.fromarray(coarse).resize((width, height), Image.Resampling.BICUBIC))


def png(pixels: NDArray[np.uint8]) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


COLOUR, METAL, FACETS = picture(1, 48, 32), picture(2, 40, 24), picture(3, 20, 28)
FACETS[..., 2] = 255  # metal everywhere; green is the roughness


def glb(floor_uv: Array) -> bytes:
    """Both squares, their pictures within the file."""
    writer = GltfWriter()
    meshes = []
    for number, uv in enumerate((floor_uv, CARD_UV)):
        attributes = {"POSITION": writer.array(SQUARE), "TEXCOORD_0": writer.array(uv)}
        indices = writer.array(np.ravel(FACES), "u1")
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices, "material": number}]})
    images = [{"bufferView": writer.view(png(each)), "mimeType": "image/png"} for each in (COLOUR, METAL, FACETS)]
    matte = {"baseColorTexture": {"index": 0}, "baseColorFactor": [*FACTOR, 1], "metallicFactor": 0}
    metal = {
        "baseColorTexture": {"index": 1}, "metallicFactor": 1, "roughnessFactor": ROUGHNESS,
        "metallicRoughnessTexture": {"index": 2},
    }  # fmt: skip
    writer.json |= {
        "meshes": meshes,
        "nodes": [{"mesh": 0, **FLOOR_NODE}, {"mesh": 1, "matrix": CARD.T.ravel().tolist()}],
        "images": images,
        "textures": [{"source": number} for number in range(3)],
        "materials": [
            {"pbrMetallicRoughness": matte, "extensions": {"KHR_materials_specular": {"specularFactor": 0}}},
            {"pbrMetallicRoughness": metal},
        ],
    }
    return writer.glb()


def ply(matrix: Array, uv: Array) -> str:
    """A square in the world as a PLY file."""
    points = SQUARE @ matrix[:3, :3].T + matrix[:3, 3]
    head = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(f"property float {name}\n" for name in "xyzuv")
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(map(str, row)) for row in np.hstack([points, uv])]
    return head + "\n".join([*rows, *(f"3 {a} {b} {c}" for a, b, c in FACES)]) + "\n"


def linear(codes: NDArray[np.uint8]) -> Array:
    """Linear values of sRGB codes (IEC 61966-2-1)."""
    value = codes / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def described(folder: Path) -> dict[str, Any]:
    """The squares in Mitsuba's words: matte and principled, seen from both sides."""
    (folder / "floor.ply").write_text(ply(FLOOR, FLOOR_UV))
    (folder / "card.ply").write_text(ply(CARD, CARD_UV))
    save_exr(folder / "colour.exr", linear(COLOUR) * FACTOR)
    (folder / "metal.png").write_bytes(png(METAL))
    save_exr(folder / "roughness.exr", np.repeat(FACETS[..., 1:2] / 255 * ROUGHNESS, 3, axis=2))

    def bitmap(name: str, raw: bool) -> dict[str, Any]:
        return {"type": "bitmap", "filename": str(folder / name), "raw": raw}

    def square(name: str, bsdf: dict[str, Any]) -> dict[str, Any]:
        path = str(folder / f"{name}.ply")
        return {"type": "ply", "filename": path, "face_normals": True, "bsdf": {"type": "twosided", "inner": bsdf}}

    metal = {"type": "principled", "base_color": bitmap("metal.png", False), "metallic": 1.0}
    return {
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.35, 0.4]}},
        "floor": square("floor", {"type": "diffuse", "reflectance": bitmap("colour.exr", True)}),
        "card": square("card", metal | {"roughness": bitmap("roughness.exr", True)}),
    }


def scene_of(folder: Path, floor_uv: Array) -> Scene:
    (folder / "squares.glb").write_bytes(glb(floor_uv))
    light = {"shape": "rectangle", "corner": [0.5, 3, 0.5], "edge_u": [1, 0, 0], "edge_v": [0, 0, 1]}
    return load_scene(
        {
            "film": {"resolution": [96, 64]},
            "camera": looking([1, 2.2, 5], [0, 0.6, 0], fov=55, up=(0, 1, 0)),
            "render": {"max_depth": 5, "roulette_depth": 0, "multiple_scattering": False},
            "environment": {"kind": "constant", "radiance": [0.3, 0.35, 0.4]},
            "objects": [{"shape": "mesh", "file": "squares.glb"}, light | {"material": lamp([12, 11, 9])}],
        },
        base_dir=folder,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("gltf")


@pytest.fixture(scope="module")
def other(mitsuba: Worker, folder: Path) -> Sampled:
    return theirs(mitsuba, scene_of(folder, FLOOR_UV), described(folder), 256, folder)


@pytest.fixture(scope="module")
def ours(mitsuba: Worker, folder: Path) -> Sampled:
    scene = scene_of(folder, FLOOR_UV)
    assert scene.warnings == ()
    return batches(scene, "gltf", BATCHES, spp=256)


def test_mean_is_within_half_a_per_cent_of_mitsuba(ours: Sampled, other: Sampled) -> None:
    assert_same_mean(ours, other)


def test_every_tile_agrees_with_mitsuba(ours: Sampled, other: Sampled) -> None:
    assert_same_tiles(ours, other)


@pytest.mark.parametrize(
    "wrong", [FLOOR_UV * (1, -1), FLOOR_UV + np.array([0.03, 0])], ids=["upside down", "one texel off"]
)
def test_tiles_would_show_a_picture_that_lies_wrong(folder: Path, other: Sampled, wrong: Array) -> None:
    spoilt = batches(scene_of(folder, wrong), "gltf spoilt", BATCHES, spp=256)
    with pytest.raises(AssertionError, match="tile"):
        assert_same_tiles(spoilt, other)
