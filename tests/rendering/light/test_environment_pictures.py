"""Light from a picture of the environment: seen, reflected, and as irradiance against quadrature in float64."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.load import load_scene
from tests.device.probes import open_session
from tests.rendering.light.pictures import irradiance, rough_sky, save_exr
from tests.rendering.pictures import MATTE, looking, scene_of, seed_of
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent, assert_same_tiles, sampled

SKY = {"kind": "image", "file": "sky.exr"}
SMALL = {"film": {"resolution": [64, 32]}, "environment": SKY}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_exr(tmp_path / "sky.exr", rough_sky())
    return tmp_path


def test_environment_camera_takes_the_picture_again(folder: Path) -> None:
    camera = {"kind": "environment", "eye": [3, 2, 1], "target": [3, 2, 0]}
    film = np.asarray(rptcam_cl.render(load_scene({**SMALL, "camera": camera}, base_dir=folder), spp=256))
    sky = rough_sky()
    # a pixel covers a texel, over which the mean of the bilinear mixture has 1/8, 3/4, 1/8 of three neighbours each way
    mixed = 0.75 * sky + 0.125 * (np.roll(sky, 1, axis=1) + np.roll(sky, -1, axis=1))
    above, below = np.vstack([mixed[:1], mixed[:-1]]), np.vstack([mixed[1:], mixed[-1:]])
    mixed = 0.75 * mixed + 0.125 * (above + below)
    # 256 samples per pixel of at most half the step between texels; halves resolve 5e-4
    around = np.stack([np.roll(sky, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    near = 5 * np.ptp(around, axis=0) / 2 / 16 + 1e-3 * mixed
    assert (np.abs(film - mixed) < near)[1:-1].all()
    assert not (np.abs(film - mixed[:, ::-1]) < near)[1:-1].all()
    np.testing.assert_allclose(film[0, :, 0].mean(), mixed[0, :, 0].mean(), rtol=5e-3)


def ground(normal, **rest):
    """A white square about the origin, seen in so narrow a view that all pixels are one point."""
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    u = np.cross(n, [0.31, -0.2, 0.87])
    v = np.cross(n, u)
    square = {"corner": list(-(u + v) / 2), "edge_u": list(u), "edge_v": list(v)}
    camera = looking(n + 0.1 * u, [0, 0, 0], fov=0.0002, up=tuple(v))
    square = {"shape": "rectangle", **square, "material": MATTE}
    return n, scene_of([square], camera, depth=2, resolution=(64, 64), environment={**SKY, "up": [0, 1, 0], **rest})


@pytest.mark.parametrize("normal", [(0.6, 0.8, 0), *map(slow, ((0, -1, 0.1), (0, 1, 0), (-1, 0.1, 0.3)))])
def test_irradiance_is_that_of_quadrature(folder: Path, normal) -> None:
    n, scene = ground(normal)
    expected = irradiance(rough_sky(), n)
    scene = load_scene(scene, base_dir=folder)
    film = np.pi * np.asarray(rptcam_cl.render(scene, spp=512, seed=seed_of(f"sky {normal}")), np.float64).reshape(
        -1, 3
    )
    # halves resolve 5e-4
    assert_equivalent(film.mean(axis=0), film.std(axis=0) / 64, expected, 0.01 * expected)


@pytest.mark.slow
def test_turned_environment_turns_its_light(folder: Path) -> None:
    n, scene = ground((0.6, 0.5, 0.2), rotation_degrees=70)
    angle = np.deg2rad(-70)  # what the surface sees if it turns the other way
    back = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    expected = irradiance(rough_sky(), back @ n)
    scene = load_scene(scene, base_dir=folder)
    film = np.pi * np.asarray(rptcam_cl.render(scene, spp=512, seed=seed_of("turned")), np.float64).reshape(-1, 3)
    assert_equivalent(film.mean(axis=0), film.std(axis=0) / 64, expected, 0.01 * expected)
    assert (np.abs(expected - irradiance(rough_sky(), n)) > 0.1 * expected).any()


def still_life(folder: Path):
    """A matte ground, a rough metal ball and a glass ball under the sky, without its small sun."""
    sky = rough_sky()
    sky[8, 16:18] = [3, 2, 1]
    save_exr(folder / "sky.exr", sky)
    balls = [
        {"shape": "sphere", "center": [-1, 1, 0], "radius": 1, "material": {"kind": "matte", "reflectance": 0.7}},
        {"shape": "sphere", "center": [1.2, 0.8, 0], "radius": 0.8, "material": "metal"},
        {"shape": "sphere", "center": [0.2, 0.4, 1.4], "radius": 0.4, "material": {"kind": "dielectric"}},
    ]
    floor = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 1, 0], "material": MATTE}
    camera = looking([0, 2, 6], [0, 0.6, 0], up=(0, 1, 0))
    metal = {"metal": {"kind": "conductor", "reflectance": 0.9, "alpha": 0.3}}
    rest = {"environment": SKY, "materials": metal}
    return load_scene(scene_of([*balls, floor], camera, depth=4, resolution=(48, 32), **rest), base_dir=folder)


def batches(scene, plan, name, count=6, spp=32):
    session, films = open_session(), []
    for batch in range(count):
        settings = scene.render.model_copy(update={"seed": seed_of(f"{name} {batch}")})
        wavefront = Wavefront(session, plan, FilmLayout.of(scene.film), settings)
        for first in range(0, spp, wavefront.samples_per_wave):
            for wave in wavefront.waves(first, min(wavefront.samples_per_wave, spp - first)):
                wavefront.enqueue(*wave)
        wavefront.finish()
        films.append(wavefront.picture(spp))
    return sampled(films)


@pytest.mark.slow
def test_picture_is_the_same_without_light_sampling(folder: Path) -> None:
    scene = still_life(folder)
    plan = make_plan(scene)
    alone = replace(plan, facts={**plan.facts, "HAS_EMITTERS": 0, "ONE_EMITTER": 0, "ENVIRONMENT_SAMPLED": 0})
    both, bsdf = batches(scene, plan, "both"), batches(scene, alone, "bsdf", spp=96)
    assert_same_tiles(both, bsdf)
    # the control: a picture of the sky a tenth brighter is told from it
    dimmer = replace(bsdf, mean=bsdf.mean * 0.97)
    with pytest.raises(AssertionError):
        assert_same_tiles(both, dimmer)


def test_light_sampling_lessens_the_noise(folder: Path) -> None:
    save_exr(folder / "sky.exr", rough_sky())
    _, scene = ground((0.0, 1.0, 0.0))
    scene = load_scene(scene, base_dir=folder)
    film = np.asarray(rptcam_cl.render(scene, spp=64), np.float64)[..., 0]
    expected = irradiance(rough_sky(), np.array([0.0, 1.0, 0.0]))[0] / np.pi
    # a cosine-sampled sun of radiance 300 alone has this spread; sampling by brightness varies less
    assert film.std() < 0.2 * np.sqrt(300 * expected / 64)
