"""Pictures of meshes: the same as of the shapes they stand for, whatever the organisation and the way they are held."""

import hashlib
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rptcam_cl.rendering.plan.geometry as meshes
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import scene_buffers
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.selfcheck import globe
from tests.rendering.pictures import MATTE, batches, looking, pixels, scene_of
from tests.scene.assets.gltf_writer import GltfWriter
from tests.support.cases import slow
from tests.support.statistics import assert_same_tiles

GOLD = {"kind": "conductor", "reflectance": [0.9, 0.7, 0.3], "alpha": 0.2}
GLASS = {"kind": "dielectric", "index": 1.5}
LAMP = {"kind": "emissive", "radiance": [9, 8, 7]}
FLOOR = {"shape": "rectangle", "corner": [-6, -6, 0], "edge_u": [12, 0, 0], "edge_v": [0, 12, 0], "material": MATTE}
LAMP_CORNER, LAMP_U, LAMP_V = np.array([-1, -1, 4.0]), np.array([0, 2.0, 0]), np.array([2.0, 0, 0])
CAMERA = looking([0, -7, 3], [0, 0, 0.8], fov=45)
POINTS, FACES = globe(24, 32)


def lamp(kind):
    if kind == "rectangle":
        edges = {"corner": LAMP_CORNER.tolist(), "edge_u": LAMP_U.tolist(), "edge_v": LAMP_V.tolist()}
        return {"shape": "rectangle", **edges, "material": LAMP}
    corners = [LAMP_CORNER, LAMP_CORNER + LAMP_U, LAMP_CORNER + LAMP_U + LAMP_V, LAMP_CORNER + LAMP_V]
    return {"shape": "mesh", "vertices": np.array(corners).tolist(), "faces": [[0, 1, 2, 3]], "material": LAMP}


def box(kind):
    low, high = np.array([0.4, -0.6, 0.0]), np.array([1.8, 0.8, 1.4])
    if kind == "shape":
        return {"shape": "box", "min": low.tolist(), "max": high.tolist(), "material": GOLD}
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return {"shape": "mesh", "vertices": (low + corners * (high - low)).tolist(), "faces": faces, "material": GOLD}


def balls():
    named = {"globe": {"vertices": POINTS.tolist(), "faces": FACES.tolist()}}
    use = {"shape": "mesh", "mesh": "globe", "normals": "smooth"}
    objects = [
        use | {"material": GLASS, "transform": [{"translate": [-1.6, 0, 1]}]},
        use | {"material": GOLD, "transform": [{"scale": [1, 0.6, 0.5]}, {"translate": [1.4, 0.5, 0.5]}]},
        use | {"material": LAMP, "transform": [{"scale": 0.2}, {"translate": [0.2, -1.2, 1.8]}]},
    ]
    return scene_of([FLOOR, lamp("mesh"), *objects], CAMERA, depth=5, resolution=(64, 48)) | {"meshes": named}


def film(mapping, organisation, session=None):
    session = session or Session(choose_device())
    scene = load_scene(mapping, ["render.seed=5"])
    plan = make_plan(scene)
    layout = FilmLayout.of(scene.film)
    wavefront = Wavefront(session, plan, layout, scene.render, organisation=organisation)
    wavefront.warm_up()
    return render_plan(wavefront, spp=4, seconds=None, has_lens=False).pixels


@pytest.mark.slow
@pytest.mark.parametrize("copied", [0, 1 << 30], ids=["instances", "copies"])
def test_stream_and_passes_make_the_same_bits_of_meshes(monkeypatch, copied):
    monkeypatch.setattr(meshes, "MOST_COPIED", copied)
    films = [film(balls(), organisation) for organisation in ("stream", "passes")]
    assert films[0].max() > 1
    assert hashlib.sha256(films[0]).digest() == hashlib.sha256(films[1]).digest()


@pytest.mark.slow
def test_trees_and_lanes_of_a_gpu_make_the_same_picture(monkeypatch):
    """Trees of four and one lane a work item, on a CPU: the same hits but for ties, so nearly all pixels to the bit."""
    wide = film(balls(), "passes")
    monkeypatch.setattr(scene_buffers, "WIDTH", {"cpu": 4, "gpu": 4})
    monkeypatch.setattr(Session, "lanes", property(lambda _: 1))
    narrow = film(balls(), "passes")
    assert (wide == narrow).all(axis=-1).mean() > 0.97
    assert np.abs(wide.mean() / narrow.mean() - 1) < 0.01


def compare(name, first, second, spp):
    assert_same_tiles(batches(first, f"{name} a", 4, spp=spp), batches(second, f"{name} b", 4, spp=spp))


@pytest.mark.slow
def test_instances_and_copies_make_the_same_picture(monkeypatch):
    films = []
    for copied in (0, 1 << 30):
        monkeypatch.setattr(meshes, "MOST_COPIED", copied)
        films.append(batches(balls(), f"held {copied}", 4, spp=64))
    assert_same_tiles(*films)


def test_lamp_and_box_of_triangles_look_as_the_shapes(monkeypatch):
    scenes = [
        scene_of([FLOOR, lamp(a), box(b)], CAMERA, depth=4, resolution=(64, 48))
        for a, b in (("rectangle", "shape"), ("mesh", "mesh"))
    ]
    compare("shapes and triangles", *scenes, spp=100)


@pytest.mark.slow
def test_facets_of_a_fine_globe_are_lost_in_a_sphere():
    points, faces = globe(96, 128)
    raised = (points + np.array([0, 0, 1])).tolist()
    fine = {"shape": "mesh", "vertices": raised, "faces": faces.tolist(), "normals": "smooth"}
    sphere = {"shape": "sphere", "center": [0, 0, 1], "radius": 1}
    scenes = [
        scene_of([FLOOR, lamp("rectangle"), body | {"material": MATTE}], CAMERA, depth=3, resolution=(64, 48))
        for body in (sphere, fine)
    ]
    compare("globe", *scenes, spp=64)


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
