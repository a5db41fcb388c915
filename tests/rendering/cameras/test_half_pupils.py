"""Half pupils: two halves make the whole, share its light evenly, and lie apart as the float64 rays say."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.rendering.cameras.film_pupil import halved, pupil_line
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.load import load_scene
from tests.device.probes import camera_rays
from tests.rendering.pictures import MATTE, WHITE, scene_of
from tests.support.cases import fast, slow
from tests.support.statistics import Z

POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
DGAUSS = {"lens": "dgauss-50mm", "focus": {"distance_m": 2.0}, **POSE}
THIN = {"kind": "thin_lens", "fov_degrees": 40, "f_number": 2.0, "focus_distance_m": 2.0, **POSE}
CAMERAS = {
    "tight": {"kind": "realistic", "pupil": "tight", **DGAUSS},
    "bounds": {"kind": "realistic", "pupil": "bounds", **DGAUSS},
    "thick lens": {"kind": "thick_lens", **DGAUSS},
    "heart": {**THIN, "aperture": {"shape": "heart"}},
}
MORE_CAMERAS = {
    "thick pupil": {"kind": "realistic", "pupil": "thick", **DGAUSS},
    "rear": {"kind": "realistic", "pupil": "rear", **DGAUSS},
    "not flipped": {"kind": "realistic", "flip": False, **DGAUSS},
    "blades": {"kind": "realistic", "aperture": {"shape": "polygon", "blades": 5}, "f_number": 2.8, **DGAUSS},
    "cylinders": {"kind": "realistic", "lens": "cylinder-pair", "focus": {"film_distance_mm": 100.0}, **POSE},
    "thin lens": THIN,
}
EVERY_CAMERA = [*CAMERAS, *(slow(name) for name in MORE_CAMERAS)]
PLACE = np.array([2000.0, 900.0])  # pixels: 8 mm off the axis, where the double Gauss vignettes
SAMPLES = 64  # of each of the 64 pixels round the place


def scene_through(name):
    """A film of 24 x 16 mm, of which 8 x 8 pixels are seen."""
    crop = [1996 / 2400, 2004 / 2400, 896 / 1600, 904 / 1600]
    camera = (CAMERAS | MORE_CAMERAS)[name]
    return load_scene(scene_of([], camera, resolution=(2400, 1600), film={"size_mm": [24, 16], "crop": crop}))


def rays_round(scene):
    """The float64 rays of the place and of four round it."""
    steps = np.array([[0, 0], [200, 0], [-200, 0], [0, 200], [0, -200]])
    return camera_of(scene).pupil_rays(PLACE + steps)


@pytest.mark.parametrize("split", ["x", slow("y")])
@pytest.mark.parametrize("name", fast(["tight", "heart"], [*CAMERAS, *MORE_CAMERAS]))
def test_every_ray_belongs_to_exactly_one_half(session, name, split):
    scene = scene_through(name)
    line = pupil_line(rays_round(scene), split)
    whole = camera_rays(session, scene, SAMPLES)
    one, other = (
        camera_rays(session, scene, SAMPLES, change=lambda camera, beyond=beyond: halved(camera, line, beyond=beyond))
        for beyond in (False, True)
    )
    np.testing.assert_array_equal(one.weight + other.weight, whole.weight)
    assert not (one.weight * other.weight).any()
    assert np.count_nonzero(one.weight) > 0.2 * np.count_nonzero(whole.weight)
    assert np.count_nonzero(other.weight) > 0.2 * np.count_nonzero(whole.weight)


@pytest.mark.parametrize("split", ["x", "y"])
@pytest.mark.parametrize("name", EVERY_CAMERA)
def test_halves_lie_apart_as_float64_rays_say(session, name, split):
    scene = scene_through(name)
    rays = rays_round(scene)
    line = pupil_line(rays, split)
    vergence = 0.2
    seen, share, weights = rays.seen(vergence)[0], line.beyond(rays)[0], rays.weights[0]
    # Two percent of the pupil's size for the pixels' own, and for the edges of a grid of 40 x 40 rays.
    allowed = 0.02 * np.sqrt(weights @ (seen - weights @ seen) ** 2)
    for beyond, part in ((False, 1 - share), (True, share)):
        expected = (weights * part) @ seen / (weights @ part)
        half = camera_rays(
            session, scene, SAMPLES, change=lambda camera, beyond=beyond: halved(camera, line, beyond=beyond)
        )
        passed = half.weight > 0
        weight, direction, origin = half.weight[passed, None], half.direction[passed], half.origin[passed]
        places = vergence * origin[:, :2] + (1 + vergence * origin[:, 2:]) * direction[:, :2] / -direction[:, 2:]
        mean = (weight * places).sum(axis=0) / weight.sum()
        error = np.sqrt(np.sum((weight * (places - mean)) ** 2, axis=0)) / weight.sum()
        assert (np.abs(mean - expected) < Z * error + allowed).all()
        axis = ("x", "y").index(split)
        assert np.abs(mean - weights @ seen)[axis] > 5 * (Z * error + allowed)[axis]  # nor is it that of the whole


def test_line_shares_the_light_of_a_vignetted_pupil_evenly(session):
    scene = scene_through("tight")
    line = pupil_line(rays_round(scene), "x")

    def share(line):
        rays = camera_rays(session, scene, SAMPLES, change=lambda camera: halved(camera, line, beyond=True))
        return rays.weight.sum() / camera_rays(session, scene, SAMPLES).weight.sum()

    assert share(line) == pytest.approx(0.5, abs=0.03)  # of 4096 rays: 0.008, and of the grid of the line
    assert abs(share(replace(line, share=0.0, offset=0.0)) - 0.5) > 0.1


@pytest.mark.slow
def test_pictures_of_the_halves_add_up_to_that_of_the_whole(session):
    ball = {"shape": "sphere", "center": [0.3, 0, -1.2], "radius": 0.2, "material": MATTE}
    film = {"size_mm": [24, 16]}
    scene = load_scene(scene_of([ball], CAMERAS["thick lens"], resolution=(24, 16), film=film, environment=WHITE))
    plan, line = make_plan(scene), pupil_line(camera_of(scene).pupil_rays(np.array([[20.0, 9], [22, 9], [18, 9]])), "x")

    def film_of(camera):
        wavefront = Wavefront(session, replace(plan, camera=camera), FilmLayout.of(scene.film), scene.render)
        return render_plan(wavefront, spp=32, seconds=None, has_lens=True).pixels

    whole = film_of(plan.camera)
    one, other = (film_of(halved(plan.camera, line, beyond=beyond)) for beyond in (False, True))
    np.testing.assert_allclose(one + other, whole, rtol=2e-6, atol=1e-7)
    assert np.abs(2 * one - whole).max() > 0.05 * whole.max()
