"""Lamps out of focus: aimed rays make the same picture as others, with less noise, and the same bits in any part."""

from unittest.mock import patch

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.device.session import open_session
from rptcam_cl.rendering import lamps
from rptcam_cl.rendering.plan.plan import make_plan, may_aim
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import lamp, seed_of
from tests.support.cases import slow
from tests.support.statistics import assert_same_tiles, sampled

POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
LENS = POSE | {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 1.0}}
NEAR = {"focus": {"distance_m": 3.0}}
PETZVAL = {"lens": "biotar-58mm", "f_number": 2}
THIN = POSE | {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 1.4, "focus_distance_m": 1}
FILM = {"resolution": [48, 32], "size_mm": [4.5, 3]}
CORNER = {"resolution": [480, 320], "size_mm": [36, 24], "crop": [0.9, 1.0, 0.0, 0.1]}
FAR_LAMPS = ([0, 0, -3], [0.06, 0.04, -3.2], [-0.08, -0.05, -2.6], [0.025, 0.01, -3.1])
WALL = {
    "shape": "rectangle",
    "corner": [-0.5, -0.5, -1],
    "edge_u": [0.51, 0, 0],
    "edge_v": [0, 1, 0],
    "material": "grey",
}
PANE = {"shape": "sphere", "center": [0.01, 0, -1.2], "radius": 0.02, "material": "glass"}
MOVES = {"motion": [{"time_s": 0, "translate": [0, 0, 0]}, {"time_s": 0.02, "translate": [0.02, 0, 0]}]}


def ball(centre, radius=0.004, material="warm"):
    return {"shape": "sphere", "center": centre, "radius": radius, "material": material}


def scene_with(camera, objects, film=FILM, **keys):
    return {
        "camera": camera, "film": film, "objects": objects, "render": {"max_depth": 3},
        "environment": {"kind": "constant", "radiance": [0.1, 0.1, 0.12]},
        "materials": {
            "warm": lamp([200, 100, 50]), "cold": lamp([20, 60, 250], two_sided=True),
            "grey": {"kind": "matte", "reflectance": 0.5}, "glass": {"kind": "dielectric", "index": 1.5},
        },
        **keys,
    }  # fmt: skip


FAR = [ball(centre, material=name) for centre, name in zip(FAR_LAMPS, ("warm", "cold") * 2, strict=True)]
SHAPES = [
    {"shape": "rectangle", "corner": [-0.05, 0.04, -3], "edge_u": [0.02, 0, 0], "edge_v": [0, 0.01, 0.01],
     "material": "cold"},
    {"shape": "box", "min": [0.04, -0.05, -3], "max": [0.05, -0.04, -2.99], "material": "warm"},
    {"shape": "cylinder", "base": [-0.06, -0.05, -3], "top": [-0.04, -0.05, -3], "radius": 0.003, "material": "cold"},
    {"shape": "disk", "center": [0.05, 0.04, -2.5], "normal": [0, 0.3, 1], "radius": 0.005, "material": "warm"},
    {"shape": "cone", "base": [0, 0, -3], "apex": [0, 0.01, -3], "radius": 0.004, "material": "cold"},
    ball([0.02, -0.03, -3]) | {"transform": [{"scale": [1, 1.001, 1]}]},
]  # fmt: skip
CASES = {
    "far": scene_with(LENS, FAR),
    "near": scene_with(LENS | NEAR, [ball([0, 0, -0.8], 0.001), ball([-0.01, 0.007, -0.85], 0.001, "cold")]),
    "corner": scene_with(LENS, [ball([0.95, 0.62, -3], 0.002), ball([0.92, 0.6, -3], 0.002)], CORNER),
    "blades": scene_with(LENS | {"aperture": {"shape": "polygon", "blades": 5}}, FAR),
    "star": scene_with(LENS | {"aperture": {"shape": "star", "points": 5, "inner_radius": 0.5}}, FAR),
    "thin": scene_with(THIN, FAR),
    "thin blades": scene_with(THIN | {"aperture": {"shape": "polygon", "blades": 6}}, FAR),
    "thin heart": scene_with(THIN | {"aperture": {"shape": "heart"}}, FAR),
    "thick": scene_with(LENS | {"kind": "thick_lens"}, FAR),
    "fitted": scene_with(LENS | {"rays": "fitted"}, FAR),
    "rear": scene_with(LENS | {"pupil": "rear"}, FAR),
    "bounds": scene_with(LENS | {"pupil": "bounds"}, FAR),
    "partly hidden": scene_with(LENS, [*FAR, WALL]),
    "behind glass": scene_with(LENS, [*FAR, PANE]),
    "shapes": scene_with(LENS, SHAPES),
    "colours": scene_with(LENS | PETZVAL, FAR, spectrum={"mode": "dispersive", "lens": "on"}),
    "spectra": scene_with(LENS | PETZVAL, FAR, spectrum={"mode": "spectral", "lens": "on"}),
    "moving": scene_with(LENS, [*FAR[:3], FAR[3] | MOVES], shutter={"time_s": 0.02}),
}


def film(scene, name, count, spp, *, aims):
    """Pictures with rays that aim at lamps or without."""
    if aims:
        images = [rptcam_cl.render(scene, seed=seed_of(f"{name} {i}"), spp=spp) for i in range(count)]
        assert all(image.metadata["lamps_aimed_at"] >= 1 for image in images)
    else:
        with patch("rptcam_cl.api.job.aimed_plan", lambda plan, *others: (plan, None)):
            images = [rptcam_cl.render(scene, seed=seed_of(f"{name} {i}, plain"), spp=spp) for i in range(count)]
    return sampled([np.asarray(image).astype(np.float64) for image in images])


@pytest.mark.parametrize("name", ["far", *(slow(name) for name in CASES if name != "far")])
def test_aimed_rays_make_the_same_picture(name):
    many = name not in ("far", "thin heart")
    aimed = film(CASES[name], name, 12, 512 if many else 64, aims=True)
    plain = film(CASES[name], name, 12, 4096 if many else 512, aims=False)
    assert_same_tiles(aimed, plain)


def test_aimed_rays_find_lamps_that_others_find_by_chance():
    aimed = film(CASES["far"], "noise", 8, 16, aims=True)
    plain = film(CASES["far"], "noise", 8, 16, aims=False)
    assert aimed.variance.mean() < plain.variance.mean() / 4  # 7 to 12 times less


@pytest.mark.slow
def test_aimed_rays_find_the_corners_of_a_polygon():
    """Left to other rays, pixels at corners of a hexagon are as much as ten times as bright as the lamp, or dark."""
    far = ball([0.13, -0.03, -30], 0.0018)
    blades = {"f_number": 4, "aperture": {"shape": "polygon", "blades": 6, "rotation_degrees": 15}}
    crop = {"resolution": [480, 320], "width_mm": 1.2, "crop": [0.6, 0.8, 0.4, 0.7]}
    scene = scene_with(LENS | NEAR | blades, [far], crop) | {"environment": None}
    images = film(scene, "corners", 16, 8, aims=True)
    mean = images.mean[..., 1]
    assert np.sqrt(images.variance[..., 1].max()) < np.median(mean[mean > mean.max() / 2])


def test_parts_of_a_picture_have_its_bits():
    scene = CASES["far"]
    whole = rptcam_cl.render(scene, spp=4, seed=1)
    waves = rptcam_cl.render(scene, spp=4, seed=1, wave_size=512)
    assert np.array_equal(np.asarray(whole), np.asarray(waves))
    crop = scene | {"film": FILM | {"crop": [5 / 48, 37 / 48, 3 / 32, 27 / 32]}}
    part = rptcam_cl.render(crop, spp=4, seed=1)
    assert np.array_equal(np.asarray(part), np.asarray(whole)[3:27, 5:37])


@pytest.mark.slow
def test_a_session_takes_the_samples_of_a_render():
    with rptcam_cl.RenderSession(CASES["far"], seed=1) as session:
        session.take(3)
        image = session.image()
    whole = rptcam_cl.render(CASES["far"], spp=3, seed=1)
    assert np.array_equal(np.asarray(image), np.asarray(whole))
    assert image.metadata["lamps_aimed_at"] == whole.metadata["lamps_aimed_at"] == 4


@pytest.mark.parametrize("layer", ["object_id", "pupil"])
def test_layers_of_the_first_ray_may_not_aim(layer):
    plan = make_plan(load_scene(CASES["thin"]))
    assert may_aim(plan, ["depth"]) and not may_aim(plan, ["depth", layer])


@pytest.mark.slow
@pytest.mark.parametrize("layer", ["object_id", "pupil"])
def test_layers_of_the_first_ray_have_rays_that_aim_at_nothing(layer):
    scene = CASES["thin"] | {"render": {"max_depth": 3, "layers": [layer]}}
    assert "lamps_aimed_at" not in rptcam_cl.render(scene, spp=1).metadata


@pytest.mark.slow
def test_a_scene_that_was_rendered_before_needs_no_lines_of_sight(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    scene = CASES["partly hidden"]
    before = rptcam_cl.render(scene, spp=1)
    with patch("rptcam_cl.rendering.lamps._open", side_effect=AssertionError):
        again = rptcam_cl.render(scene, spp=1)
        assert np.array_equal(np.asarray(before), np.asarray(again))
        moved = scene | {"objects": [*FAR, WALL | {"corner": [-0.5, -0.5, -1.001]}]}
        with pytest.raises(AssertionError):
            rptcam_cl.render(moved, spp=1)


def test_nothing_is_kept_of_sights_through_holes_of_textures():
    session = open_session("cpu")
    names = [
        lamps._name_of_sights(make_plan(load_scene(scene_with(LENS, FAR + more))), session)
        for more in ([], [WALL], [WALL | {"material": {"kind": "principled", "base_color": 0.5, "opacity": 0.5}}])
    ]
    assert names[0] != names[1]
    assert names[2] is None
