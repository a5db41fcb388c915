"""Fifty random decisions, each checked by dense rays through every surface between the probed points and depths.

Cases are random in lens, film, aperture, its shape, focus, depths and bounds. The bounds are within a third
of the errors that one of the models was found to have, so that decisions are close ones.
"""

from functools import cache

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.cameras.ray_map import LARGEST_ERROR_PX, LARGEST_LIGHT_ERROR
from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.studies.tier_models import equivalent
from rptcam_cl.studies.tiers import EFFECTS, choose_camera
from tests.studies.tradeoff.tiers import full_trace
from tests.studies.tradeoff.tiers.cases import BALL, LENSES, scene_of, stop_mm

pytestmark = pytest.mark.slow

CASES = 50
LONG = ("telephoto-250mm", "telephoto-250mm", "heliar-105mm", "tessar-100mm")  # more of those that blur
WIDTHS_MM = {"fisheye-10mm": (6, 14), "phone-5.6mm": (2, 4), "retrofocus-28mm": (8, 30)}
SHAPES = (
    {"shape": "circle"},
    {"shape": "polygon", "blades": 6},
    {"shape": "star", "points": 5},
    {"shape": "heart"},
)
LIGHT_GRAIN = 3e-3  # of jittered rays, and of those that a decision goes by
SLACK = 1.02  # what may be worse between the probed points


@cache
def random_case(seed):
    """A lens in use, its view, and a tolerance that one of the models just keeps or misses."""
    rng = np.random.default_rng(seed)
    lens = str(rng.choice([*LENSES, *LONG, *WIDTHS_MM]))
    width = float(np.exp(rng.uniform(*np.log(WIDTHS_MM.get(lens, (3, 24))))))
    columns = int(rng.integers(64, 800))
    film = {"resolution": [columns, int(columns * rng.uniform(0.5, 1.2))], "width_mm": width}
    focus = float(rng.uniform(2.5, 30))
    depths = focus * np.sort(10 ** rng.uniform(-0.2, 0.4, 2))
    balls = [BALL | {"center": [0, 0, -float(depth)], "radius": 0.05} for depth in depths]
    stop = {"stop_diameter_mm": stop_mm(lens) * float(10 ** rng.uniform(-0.6, 0))}
    keys = stop | {"aperture": SHAPES[rng.integers(0, len(SHAPES))]}
    spectrum = str(rng.choice(["auto", "rgb"]))
    scene = scene_of(lens, accuracy="auto", film=film, focus=focus, objects=balls, spectrum=spectrum, **keys)
    errors = [error for error in choose_camera(scene).errors if np.isfinite(error.worst_px + error.worst_illumination)]
    if not errors:
        return scene
    kept = errors[rng.integers(0, len(errors))]
    bounds = np.array([kept.worst_px, kept.worst_illumination]) * rng.uniform(0.75, 1.33, 2)
    accuracy = dict(zip(("max_error_px", "max_illumination_error"), map(float, bounds), strict=True))
    return change_scene(scene, camera={"accuracy": accuracy})


@cache
def decision(seed):
    return choose_camera(random_case(seed))


def places_of(scene, rng):
    """Corners and random places of the picture [pixels]."""
    return np.concatenate([[(0, 0), (1, 0)], rng.uniform(0, 1, (6, 2))]) * scene.film.resolution


def planes_of(scene, rng):
    """Distances ahead of the film of what is there, of random ones between, and of the focus [m]."""
    near, far = choose_camera(scene).metadata["accuracy"]["depths_m"]
    between = 1 / rng.uniform(1 / far, 1 / near, 2)
    focus_mm = lens_setting(scene).focus_distance_mm
    return [near, far, *between, *([] if focus_mm is None else [focus_mm * 1e-3])]


def measured(scene, chosen, seed=0):
    """The largest of each effect [pixels], of the error of brightness, and of the grain of the rays [pixels]."""
    rng = np.random.default_rng(1000 + seed)
    traced, tier = change_scene(scene, camera={"accuracy": None}), chosen.camera.kind
    places, planes = places_of(scene, rng), planes_of(scene, rng)
    worst = dict.fromkeys((*EFFECTS, "light", "grain"), 0.0)
    if tier != "realistic":
        like = tier == "thin_lens"  # has the shape of the stop
        full = traced if like else full_trace.rounded(traced)
        other = chosen if like or tier == "pinhole" else equivalent(full, tier)
        ahead = full_trace.eye_ahead_m(traced, other)
        pairs = list(zip(full_trace.clouds(full, places), full_trace.clouds(other, places, ahead), strict=True))
        scales = full_trace.Scales(full, places)
        for plane in planes:
            scale = scales.on(plane)
            found = [full_trace.apart(*pair, plane, per_m) for pair, per_m in zip(pairs, scale, strict=True)]
            for name, value in zip(("distortion", "blur", "outline", "grain"), np.max(found, axis=0), strict=True):
                worst[name] = max(worst[name], value)
        if tier == "thick_lens" and scene.camera.aperture.shape != "circle":
            worst["shape"] = shape_px(traced, chosen, places, planes)
        worst["light"] = full_trace.light(traced, chosen, places).max()
    if scene.spectrum.mode != "rgb" and chosen.spectrum.lens != "on":
        worst["colour"] = full_trace.colour_px(traced, places, planes)
    return worst


def shape_px(traced, chosen, places, planes):
    """How far the round stop brings light: what the clouds are apart, less what they are with round stops in both."""
    pairs = []
    for full, other in ((traced, chosen), (full_trace.rounded(traced), None)):
        other = other or equivalent(full, "thick_lens")
        pairs.append(list(zip(full_trace.clouds(full, places), full_trace.clouds(other, places), strict=True)))
    scales, found = full_trace.Scales(traced, places), 0.0
    for plane in planes:
        shaped, plain = (
            [full_trace.hausdorff_px(*pair, plane, per_m) for pair, per_m in zip(each, scales.on(plane), strict=True)]
            for each in pairs
        )
        found = max(found, float(np.subtract(shaped, plain).max()))
    return found


def excess(scene, worst):
    """The effects that are beyond the bounds of a scene."""
    allowed = scene.camera.accuracy
    beyond = [name for name in EFFECTS if worst[name] > SLACK * allowed.max_error_px + worst["grain"]]
    return beyond + ["light"] * int(worst["light"] > SLACK * allowed.max_illumination_error + LIGHT_GRAIN)


@pytest.mark.parametrize("seed", range(CASES))
def test_choice_never_errs_by_more_than_it_may(seed):
    scene = random_case(seed)
    worst = measured(scene, decision(seed).scene, seed)
    assert excess(scene, worst) == [], worst


def test_cases_are_of_every_kind():
    found = [decision(seed) for seed in range(CASES)]
    tiers = [each.tier for each in found]
    assert all(tiers.count(tier) >= 5 for tier in ("pinhole", "thin_lens", "thick_lens", "realistic")), tiers
    colours = [each.metadata["accuracy"].get("lens_colour_px") for each in found]
    assert sum(colour is not None for colour in colours) >= 10


def test_fitted_rays_never_err_by_more_than_they_may():
    refused = 0
    for seed in range(CASES):
        scene = random_case(seed)
        try:
            fitted = equivalent(scene, "fitted")
        except InputError:
            refused += 1
            continue
        worst = measured_rays(change_scene(scene, camera={"accuracy": None}), fitted, seed)
        assert worst["pixels"] <= SLACK * min(scene.camera.accuracy.max_error_px, LARGEST_ERROR_PX), (seed, worst)
        assert worst["light"] <= LARGEST_LIGHT_ERROR + LIGHT_GRAIN, (seed, worst)
    assert refused <= CASES / 3, refused


def measured_rays(traced, fitted, seed):
    """By how much the middles of bundles differ [pixels], and the numbers of rays that pass."""
    rng = np.random.default_rng(1000 + seed)
    places = places_of(traced, rng)
    pairs = list(zip(full_trace.clouds(traced, places), full_trace.clouds(fitted, places), strict=True))
    scales, pixels = full_trace.Scales(traced, places), 0.0
    for plane in planes_of(change_scene(traced, camera={"accuracy": "auto"}), rng):
        found = [full_trace.apart(*pair, plane, per_m)[0] for pair, per_m in zip(pairs, scales.on(plane), strict=True)]
        pixels = max(pixels, float(np.max(found)))
    passed = [np.count_nonzero(full_trace.dense_rays(scene, places).weights, axis=1) for scene in (traced, fitted)]
    return {"pixels": pixels, "light": float(np.abs(passed[1] / passed[0] - 1).max())}


STARRY = {"aperture": {"shape": "star", "points": 5}, "f_number": 16, "focus": {"film_distance_mm": 90}}
NEAR = BALL | {"center": [0, 0, -4]}
CONTROLS = {
    "distortion": ("wide-22mm", 24, {"f_number": 16, "spectrum": "rgb"}, (0.5, 10)),
    "outline": ("telephoto-250mm", 6, {"f_number": 16, "objects": [NEAR, BALL], "spectrum": "rgb"}, (2.5, 0.05)),
    "shape": ("telephoto-250mm", 4, STARRY, (None, 0.05)),
    "colour": ("tessar-100mm", 3, {"f_number": 16}, (0.3, 0.1)),
    "light": ("tessar-100mm", 30, {"f_number": 16, "spectrum": "rgb"}, (1.0, 0.01)),
}


@pytest.mark.parametrize("effect", CONTROLS)
def test_choice_that_ignores_an_effect_is_caught(effect):
    """Each is the only one that keeps a cheaper model from being taken."""
    lens, width_mm, keys, (pixels, light) = CONTROLS[effect]
    film = {"resolution": [400, 400], "width_mm": width_mm}
    zero = {"max_error_px": 0, "max_illumination_error": light}
    if pixels is None:
        pixels = (
            0.8 * choose_camera(scene_of(lens, accuracy=zero, film=film, **keys)).metadata["accuracy"]["stop_shape_px"]
        )
    scene = scene_of(lens, accuracy=zero | {"max_error_px": pixels}, film=film, **keys)
    whole = choose_camera(scene)
    assert excess(scene, measured(scene, whole.scene)) == []
    ignored = {"blur", "outline"} if effect == "outline" else {effect}
    careless = chosen_without(scene, whole, ignored)
    assert careless.camera.kind != whole.tier
    assert effect in excess(scene, measured(scene, careless))


def chosen_without(scene, whole, ignored):
    """The cheapest camera of a decision that does not look at some effects."""
    bounds = dict.fromkeys(EFFECTS, scene.camera.accuracy.max_error_px)
    bounds["light"] = scene.camera.accuracy.max_illumination_error
    for error in whole.errors:
        worst = {name: max(values) for name, values in error.effects.items()} | {"light": error.worst_illumination}
        if all(worst[name] <= bound for name, bound in bounds.items() if name not in ignored):
            return equivalent(scene, error.tier)
    return scene
