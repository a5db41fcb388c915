"""Pictures by the chosen model and by the traced lens: lamps stand in the same places, as wide and as bright."""

import numpy as np
import pytest

from rptcam_cl.api.job import render
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.studies.tier_models import equivalent
from rptcam_cl.studies.tiers import choose_camera
from tests.studies.tradeoff.tiers.cases import scene_of

pytestmark = pytest.mark.slow

COLUMNS, ROWS = 144, 96
SEEDS = 4
SPP = 64
PLACES = [(x, y) for y in (-0.75, 0.0, 0.75) for x in (-0.8, 0.0, 0.8)]  # in half sides of the picture
NOISE = 4  # standard errors

CASES = {
    "a telephoto lens at f/8 is a thin lens": {
        "lens": "telephoto-250mm", "width_mm": 12, "f_number": 8, "depth": 3.5, "tier": "thin_lens", "light": 0.02,
    },
    "a heliar at f/16 is a pinhole": {
        "lens": "heliar-105mm", "width_mm": 10, "f_number": 16, "depth": 4.5, "tier": "pinhole", "light": 0.02,
    },
    "a tessar at f/5.6 over a wide film is a thick lens": {
        "lens": "tessar-100mm", "width_mm": 36, "f_number": 5.6, "depth": 3.5, "tier": "thick_lens", "light": 0.03,
    },
    "a star that does not show is a round stop": {
        "lens": "tessar-100mm", "width_mm": 36, "f_number": 5.6, "depth": 3.2, "tier": "thick_lens", "light": 0.03,
        "aperture": {"shape": "star", "points": 5},
    },
}  # fmt: skip


def lamps(lens, *, width_mm, depth, bound_px, light, tier, **camera):
    """Nine lamps at a depth [m], a scene unit being a metre, seen by a lens that is focused on 5 m."""
    half = width_mm / 2 / float(lens.split("-")[1].removesuffix("mm")) * depth
    lamp = {"kind": "emissive", "radiance": 1.0}
    places = [[x * half, y * half * ROWS / COLUMNS, -depth] for x, y in PLACES]
    balls = [{"shape": "sphere", "center": at, "radius": half / 24, "material": lamp} for at in places]
    accuracy = {"max_error_px": bound_px, "max_illumination_error": light}
    film = {"resolution": [COLUMNS, ROWS], "width_mm": width_mm}
    return scene_of(lens, accuracy=accuracy, film=film, objects=balls, **camera)


def seen(scene):
    """Middle, spread and light of each lamp (lamps, 4) per seed [pixels]."""
    rows, columns = np.mgrid[:ROWS, :COLUMNS] + 0.5
    found = []
    for seed in range(SEEDS):
        picture = np.asarray(render(scene, spp=SPP, seed=seed), np.float64)[..., 1]
        lamp = []
        for x, y in PLACES:
            near = picture * (np.abs(columns - (1 + x) * COLUMNS / 2) < 14) * (np.abs(rows - (1 - y) * ROWS / 2) < 12)
            light = near.sum()
            middle = np.array([(near * columns).sum(), (near * rows).sum()]) / light
            square = (near * ((columns - middle[0]) ** 2 + (rows - middle[1]) ** 2)).sum() / light
            lamp.append([*middle, np.sqrt(square), light])
        found.append(lamp)
    return np.array(found)


def differences(scene, other):
    """Shift [pixels], change of spread [pixels] and of light of each lamp between two cameras, and their noise."""
    full, own = seen(scene), seen(other)
    error = np.sqrt((full.var(axis=0, ddof=1) + own.var(axis=0, ddof=1)) / SEEDS)
    full, own = full.mean(axis=0), own.mean(axis=0)
    return np.abs(own[:, :3] - full[:, :3]), error[:, :3], np.abs(own[:, 3] / full[:, 3] - 1), error[:, 3] / full[:, 3]


@pytest.mark.parametrize("name", CASES)
def test_lamps_are_where_they_are_through_the_traced_lens(name):
    case = CASES[name]
    scene = lamps(bound_px=1.0, **case)
    found = choose_camera(scene)
    assert found.tier == case["tier"], found.metadata["accuracy"]["says"]
    traced = change_scene(scene, camera={"accuracy": None}, spectrum={"mode": "rgb"})
    apart, noise, light, light_noise = differences(traced, found.scene)
    chosen = next(error for error in found.errors if error.tier == found.tier)
    # a lamp is whole where it is: what moves its light moves its middle and its spread by no more
    assert np.all(apart <= chosen.worst_px + NOISE * noise), (apart.max(axis=0), chosen.worst_px)
    scaled = 4 * chosen.worst_px / COLUMNS  # the area of a lamp changes with the scale
    assert np.all(light <= chosen.worst_illumination + scaled + NOISE * light_noise), light
    assert light_noise.max() < 0.02


def test_lamps_through_a_model_that_was_not_chosen_stand_elsewhere():
    """A pinhole in place of a lens that distorts by more than the bound, which the pictures show."""
    scene = lamps(lens="wide-22mm", width_mm=24, depth=5.0, bound_px=0.5, light=1.0, tier="", f_number=16)
    found = choose_camera(scene)
    assert found.tier == "realistic"
    traced = change_scene(scene, camera={"accuracy": None}, spectrum={"mode": "rgb"})
    apart, noise, *_ = differences(traced, equivalent(scene, "pinhole"))
    assert np.any(apart > 0.5 + NOISE * noise)


def test_blur_of_a_thin_lens_has_the_shape_that_the_traced_stop_gives_it():
    """A lamp before the focus shows the stop, a heart, the same way up."""
    lamp = {"kind": "emissive", "radiance": 1.0}
    ball = {"shape": "sphere", "center": [0.002, 0.002, -3], "radius": 0.001, "material": lamp}
    film = {"resolution": [64, 64], "width_mm": 5}
    keys = {"f_number": 6, "aperture": {"shape": "heart"}, "objects": [ball], "film": film}
    scene = scene_of("telephoto-250mm", accuracy={"max_error_px": 6, "max_illumination_error": 0.05}, **keys)
    found = choose_camera(scene)
    assert found.tier == "thin_lens"
    turned = {"shape": "heart", "rotation_degrees": 180}
    cameras = (
        change_scene(scene, camera={"accuracy": None}),
        found.scene,
        change_scene(found.scene, camera={"aperture": turned}),
    )
    traced, own, wrong = (np.asarray(render(each, spp=2048), np.float64)[..., 1] for each in cameras)
    assert own.sum() / traced.sum() == pytest.approx(1, abs=0.05)
    assert np.abs(own - traced).sum() < 0.6 * np.abs(wrong - traced).sum()
