"""Few primitives in registers, and flat ones that share a plane: faster ways of which no bit differs."""

from dataclasses import replace

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.load import load_scene

ROOM = {
    "film": {"resolution": [48, 32]},
    "camera": {"kind": "pinhole", "eye": [0, -3.5, 0.2], "target": [0, 0, 0], "up": [0, 0, 1], "fov_degrees": 45},
    "materials": {
        "white": {"kind": "matte", "reflectance": [0.7, 0.6, 0.5]},
        "mirror": {"kind": "mirror", "reflectance": 0.9},
        "lamp": {"kind": "emissive", "radiance": [9, 8, 4]},
    },
    "objects": [
        {"shape": "rectangle", "corner": [-1, -1, -1], "edge_u": [2, 0, 0], "edge_v": [0, 2, 0.3], "material": "white"},
        {"shape": "rectangle", "corner": [-1, 1, -1], "edge_u": [2, 0.4, 0], "edge_v": [0, 0, 2], "material": "mirror"},
        {"shape": "disk", "center": [0.2, 0, 0.9], "normal": [0.1, 0, -1], "radius": 0.4, "material": "lamp"},
        {
            "shape": "box",
            "min": [-0.6, -0.3, -0.9],
            "max": [-0.1, 0.3, 0.1],
            "material": "white",
            "transform": [{"rotate": {"axis": [0.1, 0.2, 1], "degrees": 20}}],
        },
        {"shape": "sphere", "center": [0.5, 0, -0.4], "radius": 0.35, "material": {"kind": "dielectric", "index": 1.5}},
    ],
}


def film_of(session, plan, scene):
    wavefront = Wavefront(session, plan, FilmLayout.of(scene.film), scene.render)
    for wave in wavefront.waves(0, 8):
        wavefront.enqueue(*wave)
    wavefront.finish()
    return wavefront.planes()


def painted(objects):
    colours = {"kind": "checker", "even": 0.7, "odd": 0.2, "scale": [5, 3]}
    return [entry | {"material": {"kind": "matte", "reflectance": colours}} for entry in objects]


@pytest.mark.parametrize(
    "objects",
    [
        pytest.param(ROOM["objects"], marks=pytest.mark.slow),
        painted(ROOM["objects"][:1]) + ROOM["objects"][1:],
        pytest.param(painted(ROOM["objects"]), marks=pytest.mark.slow),
    ],
    ids=["plain", "painted floor", "all painted"],
)
def test_tables_of_few_primitives_change_no_bit(session, objects):
    lamp = ROOM["objects"][2]
    scene = load_scene(ROOM | {"objects": [*objects, lamp]})
    plan = make_plan(scene)
    assert plan.facts["FEW_PRIMITIVES"] == 1
    one_by_one = replace(plan, facts={**plan.facts, "FEW_PRIMITIVES": 0})
    film = film_of(session, plan, scene)
    assert film[:3].max() > 0
    np.testing.assert_array_equal(film, film_of(session, one_by_one, scene))


def piece(x, width, material):
    edges = {"edge_u": [0, 2, 0], "edge_v": [width, 0, 0]}
    return {"shape": "rectangle", "corner": [x, -1, 1], **edges, "material": material}


def test_flats_that_share_a_plane_look_as_if_each_had_its_own(session):
    ceiling = [piece(-1, 0.7, "white"), piece(-0.3, 0.6, "lamp"), piece(0.3, 0.7, "white")]
    scene = load_scene(ROOM | {"objects": [ROOM["objects"][0], *ceiling, *ROOM["objects"][3:]]})
    plan = make_plan(scene)
    assert plan.primitives["instance"].tolist() == [0, 1, 3, 0, 0, 0]  # sphere, floor, ceiling, box
    alone = plan.primitives.copy()
    alone["instance"] = [0, 1, 1, 1, 1, 0]
    film = film_of(session, plan, scene)
    assert film[:3].max() > 0
    np.testing.assert_array_equal(film, film_of(session, replace(plan, primitives=alone), scene))


def test_of_two_at_the_same_place_the_first_is_met():
    disk, box, sphere = ROOM["objects"][2:]
    twins = [
        shape | {"material": {"kind": "matte", "reflectance": share}}
        for shape in (disk | {"normal": [0, -1, 0]}, box, sphere)
        for share in (0.2, 0.8)
    ]
    image = rptcam_cl.render(ROOM | {"objects": twins, "materials": {}}, spp=1, layers=["object_id"])
    assert set(np.unique(image["object_id"])) == {-1, 0, 2, 4}
