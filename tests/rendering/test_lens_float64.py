"""The same paths with the lens in float32 and in float64: the same first hits and the same picture."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core.records import seed_words
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from tests.device.probes import camera_rays
from tests.rendering.pictures import lamp, scene_of, seed_of
from tests.support.statistics import Z

pytestmark = pytest.mark.slow

POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
LENSES = {
    "dgauss-50mm": {"size_mm": [36, 24]},
    "fisheye-10mm": {"size_mm": [24, 16]},
    "phone-5.6mm": {"size_mm": [5, 4]},
}
SPREAD = {"dgauss-50mm": 0.45, "fisheye-10mm": 1.3, "phone-5.6mm": 0.5}  # half angle of the field [rad]
SPHERES = 60
BAND = 2e-6  # about silhouettes [rad]: four times what float32 turns a ray by
OTHER_HITS, OTHER_LIGHT = 1e-5, 1e-5


def spheres(name):
    """Centres and radii of spheres that do not touch, about 2 m away, in the field of a lens."""
    rng = np.random.default_rng(seed_of(name))
    found = np.zeros((0, 4))
    while len(found) < SPHERES:
        angle, turn = SPREAD[name] * np.sqrt(rng.random()), 2 * np.pi * rng.random()
        away = rng.uniform(1.2, 4.0)
        direction = np.array([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), -np.cos(angle)])
        new = np.array([*(away * direction), rng.uniform(0.03, 0.12) * min(SPREAD[name] * 2, 1.5)])
        if (np.linalg.norm(found[:, :3] - new[:3], axis=1) > 1.05 * (found[:, 3] + new[3])).all():
            found = np.vstack([found, new])
    return found


def scene_through(name, resolution, **render):
    objects = [
        {"shape": "sphere", "center": row[:3].tolist(), "radius": row[3],
         "material": {"kind": "matte", "reflectance": [0.3 + 0.5 * (k % 3 == c) for c in range(3)]}}
        for k, row in enumerate(spheres(name))
    ]  # fmt: skip
    objects.append({"shape": "rectangle", "corner": [-4, 3, 2], "edge_u": [8, 0, 0], "edge_v": [0, 0, -6],
                    "material": lamp(3.0, two_sided=True)})  # fmt: skip
    camera = {"kind": "realistic", "lens": name, "focus": {"distance_m": 2.0}, **POSE}
    sky = {"kind": "constant", "radiance": 0.2}
    scene = load_scene(scene_of(objects, camera, depth=3, resolution=resolution, film=LENSES[name], environment=sky))
    return change_scene(scene, render=render)


def exact(camera):
    return camera


def of_half_precision(camera):
    """A deliberate fault: ratios of indices, and the polynomials for them, with eleven binary digits."""
    surfaces = camera.surfaces.copy()
    for name in ("eta", "dispersion"):
        surfaces[name] = surfaces[name].astype(np.float16)
    return replace(camera, surfaces=surfaces)


def wavefront_of(session, scene, precision, fault=exact):
    scene = change_scene(scene, camera={"precision": precision})
    plan = make_plan(scene)
    plan = replace(plan, camera=fault(plan.camera))
    return Wavefront(session, plan, FilmLayout.of(scene.film), scene.render)


def rendered(wavefront, seed, samples):
    """Render anew: the picture."""
    wavefront.clear()
    wavefront.seed = seed
    for wave in wavefront.waves(0, samples):
        wavefront.enqueue(*wave)
    wavefront.finish()
    return wavefront.picture(samples).astype(np.float64)


def far_from_silhouettes(session, scene, name, seed):
    """Where (rows, columns) the first ray of a pixel passes every sphere's rim by more than the band."""
    rays = camera_rays(session, scene, 1, lanes=16, seed=seed_words(seed), lattice=True)
    far = np.ones(scene.film.resolution[::-1], bool)
    for row in spheres(name):
        to = row[:3] - rays.origin
        ahead = (to * rays.direction).sum(axis=1)
        beside = np.linalg.norm(to - ahead[:, None] * rays.direction, axis=1)
        near = np.abs(beside - row[3]) < BAND * np.linalg.norm(to, axis=1)
        far[rays.pixel[near, 1], rays.pixel[near, 0]] = False
    return far


def hits(session, name, fault=exact, seeds=2):
    """How many of how many first hits differ, away from silhouettes, and how many rays are."""
    scene = scene_through(name, (1200, 800), layers=("object_id",))
    single, double = wavefront_of(session, scene, "single"), wavefront_of(session, scene, "double", fault)
    other = rays = near = 0
    for k in range(seeds):
        seed = seed_of(f"hits {name} {k}")
        ids = []
        for wavefront in (single, double):
            rendered(wavefront, seed, 1)
            ids.append(wavefront.layers()["object_id"])
        assert len(np.unique(ids[0])) > SPHERES / 2
        far = far_from_silhouettes(session, scene, name, seed)
        other, rays, near = other + int((ids[0] != ids[1])[far].sum()), rays + int(far.sum()), near + int((~far).sum())
    return other, rays, near


def light(session, name, fault=exact, seeds=8):
    """By how much of itself the light of the whole picture differs, and the standard error of that."""
    scene = scene_through(name, (150, 100))
    pair = wavefront_of(session, scene, "single"), wavefront_of(session, scene, "double", fault)
    apart = []
    for k in range(seeds):
        one, other = (rendered(wavefront, seed_of(f"light {name} {k}"), 64).mean() for wavefront in pair)
        apart.append(other / one - 1)
    return float(np.mean(apart)), float(np.std(apart, ddof=1) / np.sqrt(seeds))


@pytest.mark.parametrize("name", LENSES)
def test_first_hits_are_the_same_but_at_silhouettes(session, name):
    other, rays, near = hits(session, name)
    assert rays > 1e6
    assert near < 1e-3 * rays
    assert other <= OTHER_HITS * rays


@pytest.mark.parametrize("name", LENSES)
def test_light_of_the_picture_is_the_same(session, name):
    apart, error = light(session, name)
    assert Z * error < OTHER_LIGHT / 2
    assert abs(apart) + Z * error <= OTHER_LIGHT


@pytest.mark.parametrize("name", LENSES)
def test_indices_in_half_precision_are_found(session, name):
    """The control."""
    other, rays, _ = hits(session, name, of_half_precision, seeds=1)
    assert other > OTHER_HITS * rays
    apart, error = light(session, name, of_half_precision, seeds=4)
    assert abs(apart) - Z * error > OTHER_LIGHT
