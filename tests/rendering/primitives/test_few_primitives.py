"""Few flat primitives and boxes are looked up in registers where a processor permutes them; no bit differs."""

from dataclasses import replace

import numpy as np

from rptcam_cl.plan import make_plan
from rptcam_cl.rendering import Wavefront
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.scene import load_scene

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


def test_tables_of_flat_primitives_and_boxes_change_no_bit(session):
    scene = load_scene(ROOM)
    plan = make_plan(scene)
    assert plan.facts["FEW_PRIMITIVES"] == 1
    one_by_one = replace(plan, facts={**plan.facts, "FEW_PRIMITIVES": 0})
    film = film_of(session, plan, scene)
    assert film[:3].max() > 0
    np.testing.assert_array_equal(film, film_of(session, one_by_one, scene))
