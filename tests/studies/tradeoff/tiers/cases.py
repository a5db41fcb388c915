"""Scenes with lenses in use, for tests of how camera models differ."""

import numpy as np

from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.tier_models import TIERS, first_order_camera
from rptcam_cl.studies.tiers import Truth, tier_error

LENSES = ("dgauss-50mm", "telephoto-250mm", "wide-22mm", "tessar-100mm", "cooke-triplet-50mm", "heliar-105mm")
BALL = {"shape": "sphere", "center": [0, 0, -5], "radius": 0.5, "material": {"kind": "matte", "reflectance": 0.5}}


def scene_of(
    lens, *, accuracy=None, focus=5.0, film=None, objects=(BALL,), spectrum="auto", exposure="relative", **camera
):
    keys = {
        "kind": "realistic",
        "lens": lens,
        "eye": [0, 0, 0],
        "target": [0, 0, -1],
        "focus": focus if isinstance(focus, dict) else {"distance_m": focus},
    }
    keys |= camera | ({} if accuracy is None else {"accuracy": accuracy})
    world = {"objects": list(objects), "spectrum": spectrum, "exposure": exposure}
    return load_scene({"film": film or {"resolution": [640, 360]}, "camera": keys} | world)


def truth_of(scene):
    return Truth.of(scene, first_order_camera(scene))


def errors_of(scene, depths=(4000.0, 6000.0)):
    truth = truth_of(scene)
    return {tier: tier_error(truth, depths, tier) for tier in TIERS}


def stop_mm(lens):
    """The diameter of its stop, wide open."""
    return 2 * first_order_camera(scene_of(lens)).setting.lens.stop.semi_diameter


def half_film_mm(scene):
    return np.array(scene.film.size_m()) / 2 * 1e3
