"""Fog that thins out upwards: quadrature in float64 of what it absorbs, emits and scatters, furnaces, and extremes."""

from itertools import pairwise

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering import tracer
from tests.rendering.pictures import WHITE, bits, looking, pixels, scene_of, seed_of
from tests.rendering.test_media import (
    ABSORPTION,
    ASYMMETRY,
    FOG,
    LAMPS,
    SCATTERING,
    WALL,
    directions,
    henyey_greenstein,
)
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent

NODES, WEIGHTS = np.polynomial.legendre.leggauss(60)


def layer(scale_height, base):
    return {"layer": {"scale_height_m": scale_height, "base": base, "up": [0, 0, 2]}}


def column(start, slope, length, height):
    """Integral of the density along ways of those lengths, by quadrature between the places where it bends."""
    start, slope, length = np.broadcast_arrays(*map(np.asarray, (start, slope, length)))
    bend = np.clip(np.divide(-start, slope, out=np.zeros(start.shape), where=slope != 0), 0, length)
    # a few scale heights from the base on, in case they are a small part of the way
    near = np.clip(20 * height / np.maximum(np.abs(slope), 1e-9), 0, np.where(slope > 0, length - bend, bend))
    ends = [0 * bend, np.where(slope > 0, bend, bend - near), np.where(slope > 0, bend + near, bend), length]
    total = np.zeros(start.shape)
    for low, high in pairwise(ends):
        t = low[..., None] + (high - low)[..., None] * (NODES + 1) / 2
        heights = np.maximum(start[..., None] + slope[..., None] * t, 0)
        total += (np.exp(-heights / height) * WEIGHTS).sum(axis=-1) * (high - low) / 2
    return total


def scattered_once(lamps, height, base, sun=None):
    """Mean radiance that fog before the wall scatters once from points of light or a sun, camera at the origin."""
    d = directions(20, 24)
    length = 5 / d[:, 1]
    bend = np.clip(base / np.where(d[:, 2] == 0, 1e-9, d[:, 2]), 0, length)
    total = np.zeros(3)
    for low, high in ((0 * bend, bend), (bend, length)):
        t = low[:, None] + (high - low)[:, None] * (NODES + 1) / 2
        p = t[..., None] * d[:, None]
        density = np.exp(-np.maximum(p[..., 2] - base, 0) / height)
        seen = column(np.full(t.shape, -base), np.broadcast_to(d[:, None, 2], t.shape), t, height)
        for lamp in lamps if sun is None else [sun]:
            to = np.array(lamp) - (p if sun is None else 0 * p)
            r = np.linalg.norm(to, axis=-1)
            way, fall = (r, r**2) if sun is None else (np.full(r.shape, 1e4), 1)
            arrives = column(p[..., 2] - base, to[..., 2] / r, way, height)
            phase = henyey_greenstein(ASYMMETRY, np.einsum("ijk,ik->ij", to, d) / r)
            left = np.exp(-(ABSORPTION + SCATTERING) * (seen + arrives)[..., None])
            each = SCATTERING * left * (density * phase / fall * WEIGHTS * (high - low)[:, None] / 2)[..., None]
            total += each.sum(axis=1).mean(axis=0)
    return total


def fog_of(lights, height, base, **rest):
    fog = FOG | layer(height, base)
    eye = looking([0, 0, 0], [0, 1, 0], fov=20)
    return scene_of([WALL], eye, depth=2, medium=fog, lights=lights, resolution=(24, 24), **rest)


def points(lamps):
    return [{"kind": "point", "position": at, "intensity": 1.0} for at in lamps]


# the camera in the even part, in the thinning one, and far above a layer; tolerances are five standard errors
@pytest.mark.parametrize(("height", "base", "noise"), [slow(0.5, 0.2, 2e-3), (0.5, -0.6, 2e-3), slow(0.01, -0.1, 5e-3)])
def test_layer_scatters_light_of_points_once_as_quadrature_does(height, base, noise):
    mean = pixels(fog_of(points(LAMPS), height, base), seed=seed_of(f"layer {height} {base}"), spp=512)
    np.testing.assert_allclose(mean.mean(axis=(0, 1)), scattered_once(LAMPS, height, base), rtol=noise)


@pytest.mark.slow
def test_layer_without_end_is_homogeneous():
    endless = fog_of(points(LAMPS), 1e9, -1.0)
    homogeneous = endless | {"medium": FOG}
    one, other = (pixels(scene, seed=3, spp=4) for scene in (endless, homogeneous))
    np.testing.assert_allclose(one.mean(axis=(0, 1)), other.mean(axis=(0, 1)), rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("base", [0.2, -0.6])
def test_layer_scatters_the_sun_once_as_quadrature_does(base):
    sun = [0.4, -0.3, 0.6]
    lights = [{"kind": "directional", "direction": [-x for x in sun], "irradiance": 1.0}]
    seeds = [seed_of(f"sun {base} {batch}") for batch in range(8)]
    means = np.array([pixels(fog_of(lights, 0.5, base), seed=seed, spp=1024).mean(axis=(0, 1)) for seed in seeds])
    expected = scattered_once([], 0.5, base, sun=sun)
    error = means.std(axis=0, ddof=1) / np.sqrt(len(means))
    assert_equivalent(means.mean(axis=0), error, expected, 4e-3 * expected)


WAYS = [
    (1.0, -0.5, 0.3), (1.0, 0.5, 0.3), (1.0, -0.5, -0.3), (1e-3, -0.5, -0.3), (1e6, -0.5, -0.3), (1.0, -0.5, 1e-7),
    (0.05, -3.0, -0.6), (0.05, 4.0, 0.6), (1.0, -0.5, -1e-4),
]  # fmt: skip


@pytest.mark.slow
def test_layer_absorbs_and_emits_as_its_column_does():
    absorption = np.array([0.05, 0.1, 0.2])
    for shining in (0.0, 1.0):
        ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 10}
        wall = ball | {"material": {"kind": "emissive", "radiance": 1.0, "two_sided": True}}
        for height, base, rise in WAYS:
            fog = {"absorption_per_m": absorption.tolist(), "emission_per_m": shining} | layer(height, base)
            eye = looking([0, 0, 0], [0, 1, rise], fov=1e-5)
            film = pixels(scene_of([wall], eye, depth=1, resolution=(8, 8), medium=fog), spp=1)
            left = np.exp(-absorption * column(-base, rise / np.hypot(1, rise), 10.0, height))
            # a height of 1 mm is known to float32 to 2e-4 of itself
            np.testing.assert_allclose(film.mean(axis=(0, 1)), left + shining * (1 - left) / absorption, rtol=3e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("height", "base"), [(0.3, -0.2), (1e-3, -0.5), (5.0, -0.5), (0.3, -100.0)])
def test_layer_that_only_scatters_vanishes_in_a_white_world(height, base):
    """Sky all round, and ground that reflects all, as the even fog below the layer has no end."""
    eye = looking([0, 0, 0], [0, 1, -0.2], fov=40)
    fog = {"scattering_per_m": 3.0, "asymmetry": 0.3} | layer(height, base)
    ground = {"shape": "plane", "point": [0, 0, -0.7], "normal": [0, 0, 1]}
    ground |= {"material": {"kind": "matte", "reflectance": 1.0}}
    scene = scene_of([ground], eye, depth=3000, environment=WHITE, medium=fog)
    film = pixels(scene, spp=16, seed=seed_of(f"furnace {height} {base}"))
    np.testing.assert_allclose(film, 1, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("spectrum", ["rgb", "spectral", "dispersive"])
def test_both_organisations_render_the_same_layer(monkeypatch, spectrum):
    scene = fog_of(points(LAMPS[:2]), 0.5, -0.2, spectrum=spectrum)
    scene |= {"environment": WHITE}
    films = []
    for organisation in ("stream", "passes"):
        monkeypatch.setattr(tracer, "ORGANISATION", dict.fromkeys(tracer.ORGANISATION, organisation))
        films.append(bits(rptcam_cl.render(scene, spp=4, seed=1)))
    assert films[0] == films[1]


@pytest.mark.slow
def test_layer_lies_where_it_is_said_for_any_eye_and_unit():
    """The same scene in millimetres, moved, has the same picture; `up` is the camera's where none is given."""
    scene = fog_of(points(LAMPS), 0.5, 0.2)
    mm = 1e3
    moved = np.array([7.0, -3.0, 11.0])
    lights = points((mm * (np.array(LAMPS) + moved)).tolist())
    eye = looking(mm * moved, mm * np.add(moved, [0, 1, 0]), fov=20)
    wall = WALL | {"point": (mm * np.add(moved, [0, 5, 0])).tolist()}
    fog = FOG | {"layer": {"scale_height_m": 0.5, "base": mm * (0.2 + 11)}}
    other = scene | {"metres_per_unit": 1e-3, "lights": lights, "camera": eye, "objects": [wall], "medium": fog}
    one, two = (pixels(each, seed=1, spp=16) for each in (scene, other))
    np.testing.assert_allclose(one.mean(axis=(0, 1)), two.mean(axis=(0, 1)), rtol=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layer": {"base": 1}}, "scale_height_m"),
        ({"layer": {"scale_height_m": 0}}, "medium.layer.scale_height_m"),
        ({"layer": {"scale_height_m": 1, "up": [0, 0, 0]}}, "medium.layer.up"),
    ],
)
def test_layers_that_cannot_be_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        rptcam_cl.load_scene(fog_of(points(LAMPS), 1, 0) | {"medium": FOG | change})


def test_only_fog_round_everything_lies_in_layers():
    smoke = {"kind": "boundary", "interior": FOG | layer(1, 0)}
    ball = {"shape": "sphere", "center": [0, 2, 0], "radius": 1, "material": smoke}
    with pytest.raises(InputError, match=r"interior.*unknown key"):
        rptcam_cl.load_scene(scene_of([ball], looking([0, 0, 0], [0, 1, 0])))
