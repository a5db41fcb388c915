"""Media whose density lies on a grid: quadrature in float64 of what they scatter and leave, furnaces, files."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Launch, Session
from rptcam_cl.rendering import passes, tracer
from rptcam_cl.rendering.plan.media import load_density
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import WHITE, bits, looking, pixels, scene_of, seed_of
from tests.rendering.test_media import (
    ABSORPTION,
    ASYMMETRY,
    EYE,
    FOG,
    LAMPS,
    SCATTERING,
    WALL,
    directions,
    henyey_greenstein,
)
from tests.support.statistics import assert_equivalent

BOX = np.array([[-1.0, 1.0, -0.5], [0.8, 3.5, 0.9]])
GRID = np.random.default_rng(4).uniform(0, 4, (5, 20, 9)) * (np.random.default_rng(5).random((5, 20, 9)) < 0.6)
DATA = Path(__file__).parents[1] / "data"


def smoke_of(grid, box=BOX, **medium):
    low, high = np.asarray(box).tolist()
    return medium | {"density": {"file": np.asarray(grid, np.float32), "min": low, "max": high}}


def density_at(grid, box, p):
    """Densities at points (..., 3), trilinear between the middles of voxels."""
    grid, inside = np.asarray(grid, np.float64), np.all((p >= box[0]) & (p <= box[1]), axis=-1)
    q = (p - box[0]) / (box[1] - box[0]) * grid.shape - 0.5
    q = np.clip(q, 0, np.array(grid.shape) - 1)
    i = np.minimum(q.astype(int), np.maximum(np.array(grid.shape) - 2, 0))
    f = q - i
    total = np.zeros(p.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        at = np.minimum(i + corner, np.array(grid.shape) - 1)
        total += np.prod(np.where(corner, f, 1 - f), axis=-1) * grid[tuple(np.moveaxis(at, -1, 0))]
    return total * inside


def columns(grid, box, start, end, count=30):
    """Integrals of the density from points to points, by the midpoint rule."""
    share = (np.arange(count) + 0.5) / count
    way = end - start
    p = start[..., None, :] + share[:, None] * way[..., None, :]
    return density_at(grid, box, p).mean(axis=-1) * np.linalg.norm(way, axis=-1)


def scattered_once(grid, box, lamps):
    d = directions(20, 12)
    t = (np.arange(160) + 0.5) / 160 * (5 / d[:, 1])[:, None]
    p = t[..., None] * d[:, None]
    density = density_at(grid, box, p)
    step = (t[:, 1] - t[:, 0])[:, None]
    seen = np.cumsum(density, axis=1) * step - density * step / 2
    total = np.zeros(3)
    for lamp in lamps:
        to = np.array(lamp) - p
        r = np.linalg.norm(to, axis=-1)
        phase = henyey_greenstein(ASYMMETRY, np.einsum("ijk,ik->ij", to, d) / r)
        column = seen + columns(grid, box, p, np.broadcast_to(np.array(lamp), p.shape))
        left = np.exp(-(ABSORPTION + SCATTERING) * column[..., None])
        total += (SCATTERING * left * (density * phase / r**2 * step)[..., None]).sum(axis=1).mean(axis=0)
    return total


def points(lamps):
    return [{"kind": "point", "position": at, "intensity": 1.0} for at in lamps]


def test_grid_scatters_light_of_points_once_as_quadrature_does():
    """Around all, of other resolution and extent along each axis, a third of its voxels empty; a lamp lies inside."""
    scene = scene_of([WALL], EYE, depth=2, medium=smoke_of(GRID, **FOG), lights=points(LAMPS), resolution=(24, 24))
    means = np.array([pixels(scene, seed=seed_of(f"grid {k}"), spp=64).mean(axis=(0, 1)) for k in range(6)])
    error = means.std(axis=0, ddof=1) / np.sqrt(len(means))
    expected = scattered_once(GRID, BOX, LAMPS)
    assert_equivalent(means.mean(axis=0), error, expected, 0.02 * expected)


@pytest.mark.slow
def test_one_value_is_a_medium_of_even_density():
    """In a box without a surface, also where light is scattered many times and at other wavelengths otherwise."""
    box = {"shape": "box", "min": BOX[0].tolist(), "max": BOX[1].tolist()}
    dense = {"scattering_per_m": [1.0, 2.0, 6.0], "absorption_per_m": [0.5, 0.2, 0.1], "asymmetry": 0.5}
    found = []
    twice = {"scattering_per_m": [2.0, 4.0, 12.0], "absorption_per_m": [1.0, 0.4, 0.2], "asymmetry": 0.5}
    for interior in (dense, smoke_of(np.full((2, 9, 17), 0.5), **twice)):
        objects = [box | {"material": {"kind": "boundary", "interior": interior}}]
        sky = {"kind": "gradient", "bottom": 0.0, "top": 1.0}
        scene = scene_of(objects, EYE, depth=12, environment=sky, resolution=(24, 24))
        means = [pixels(scene, seed=seed_of(f"even {k}"), spp=256).mean(axis=(0, 1)) for k in range(8)]
        found.append((np.mean(means, axis=0), np.std(means, axis=0, ddof=1) / np.sqrt(8)))
    (one, one_error), (other, other_error) = found
    assert_equivalent(other, np.hypot(one_error, other_error), one, 0.03 * one)


def test_grey_grid_that_only_scatters_is_not_there_in_a_white_world():
    medium = smoke_of(2 * GRID, scattering_per_m=2.0, asymmetry=0.3)
    scene = scene_of([], EYE, depth=800, medium=medium, environment=WHITE, resolution=(16, 16))
    np.testing.assert_allclose(pixels(scene, spp=16, seed=seed_of("grey")), 1, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("spectrum", ["rgb", "spectral"])
def test_grid_that_only_scatters_vanishes_in_a_white_world(spectrum):
    medium = smoke_of(2 * GRID, scattering_per_m=[1.0, 2.0, 4.0], asymmetry=0.3)
    scene = scene_of([], EYE, depth=400, medium=medium, environment=WHITE, resolution=(8, 8), spectrum=spectrum)
    means = np.array([pixels(scene, seed=seed_of(f"white {k}"), spp=512).mean(axis=(0, 1)) for k in range(8)])
    assert_equivalent(means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(8), 1.0, 0.03)


@pytest.mark.slow
def test_grid_emits_and_leaves_as_quadrature_does():
    """Of light of a glowing wall behind, with emission of its own that it absorbs; without any it glows alone."""
    absorption, emission = np.array([0.2, 1.0, 3.0]), np.array([1.0, 0.5, 2.0])
    wall = WALL | {"material": {"kind": "emissive", "radiance": 1.0}}
    d = directions(20, 24)
    t = (np.arange(2000) + 0.5) / 2000 * (5 / d[:, 1])[:, None]
    density = density_at(GRID, BOX, t[..., None] * d[:, None])
    step = (t[:, 1] - t[:, 0])[:, None]
    seen = np.cumsum(density, axis=1) * step
    left = np.exp(-absorption * (seen - density * step / 2)[..., None])
    expected = (np.exp(-absorption * seen[:, -1:]) + emission * (left * (density * step)[..., None]).sum(axis=1)).mean(
        axis=0
    )
    medium = {"absorption_per_m": absorption.tolist(), "emission_per_m": emission.tolist()}
    scene = scene_of([wall], EYE, depth=1, medium=smoke_of(GRID, **medium), resolution=(24, 24))
    mean = pixels(scene, seed=seed_of("glow"), spp=4096).mean(axis=(0, 1))
    np.testing.assert_allclose(mean, expected, rtol=3e-3)
    alone = scene_of([], EYE, depth=1, medium=smoke_of(GRID, emission_per_m=1.0), resolution=(24, 24))
    mean = pixels(alone, seed=seed_of("alone"), spp=4096).mean()
    np.testing.assert_allclose(mean, seen[:, -1].mean(), rtol=3e-3)


@pytest.mark.slow
def test_grid_far_denser_than_light_gets_through_stops_it():
    """One voxel of 1e6 in emptiness: its shadow is black, and beside it nothing is missing."""
    grid = np.zeros((17, 3, 17))
    grid[8, 1, 8] = 1e6
    medium = smoke_of(grid, [[-1, 2, -1], [1, 2.4, 1]], absorption_per_m=1.0)
    film = pixels(scene_of([], EYE, medium=medium, environment=WHITE, resolution=(32, 32)), spp=16)[..., 0]
    assert (film[14:18, 14:18] == 0).all()
    assert (film[:8] == 1).all()


@pytest.mark.slow
def test_both_organisations_render_the_same_grid_in_any_number_of_launches(monkeypatch):
    ball = {"shape": "sphere", "center": [0, 2, -1], "radius": 0.6, "material": {"kind": "matte", "reflectance": 0.7}}
    own = {key: FOG[key] for key in ("scattering_per_m", "absorption_per_m")}
    medium = smoke_of(GRID, **own, droplets_um=12, emission_per_m=0.01)
    scene = scene_of([WALL, ball], EYE, depth=4, medium=medium, lights=points(LAMPS))
    films, launches = [bits(rptcam_cl.render(scene, spp=4, seed=1))], []
    enqueue = Launch.enqueue

    def noted(self, items, group, first=0):
        launches.append((self.name, items))
        return enqueue(self, items, group, first)

    monkeypatch.setattr(Launch, "enqueue", noted)
    monkeypatch.setattr(tracer, "ORGANISATION", dict.fromkeys(tracer.ORGANISATION, "passes"))
    for kind, most in (("cpu", 0), ("gpu", passes.STEPS_OF_LAUNCH), ("gpu", 1 << 15)):
        monkeypatch.setattr(Session, "kind", kind)
        monkeypatch.setattr(passes, "STEPS_OF_LAUNCH", most)
        films.append(bits(rptcam_cl.render(scene, spp=4, seed=1)))
    assert len(set(films)) == 1
    pieces = [items for name, items in launches if name == "travel"]
    assert pieces[-1] < max(pieces)


def test_steps_through_an_even_grid_have_a_closed_form():
    def steps(extinction, **more):
        grid = np.full((32, 8, 8), 2.0)
        smoke = smoke_of(grid, [[0, 0, 0], [4, 1, 1]], scattering_per_m=[extinction, 0, 0], **more)
        absorbed = {"absorption_per_m": [0, extinction / 2, extinction / 2]}
        return make_plan(load_scene(scene_of([WALL], EYE, medium=smoke | absorbed))).media.steps

    k = np.arange(4)  # blocks along x, of 1 m and a column of 2 each; one wavelength loses half of what another does
    for extinction in (1e-3, 1.0, 1e3):
        assert steps(extinction) == pytest.approx((1 + 2 * extinction * np.exp(-extinction * k)).sum(), rel=1e-5)
    # where it shines, all of the way counts: eight events at least
    assert steps(1e-3, emission_per_m=1.0) == pytest.approx(4 + 8, rel=1e-2)


@pytest.mark.parametrize(
    ("density", "message"),
    [
        ({"file": np.zeros((3, 3))}, "no grid of numbers along x, y and z"),
        ({"file": np.full((3, 3, 3), -1.0)}, "holds what is no density .got -1"),
        ({"file": np.full((3, 3, 3), np.nan)}, "holds what is no density .got nan"),
        ({"file": np.ones((3, 3, 3)), "grid": "density"}, "holds one grid"),
        ({"file": "missing.npy"}, "missing.npy"),
    ],
)
def test_what_is_no_grid_of_densities_is_refused(density, message):
    corners = {"min": [0, 0, 0], "max": [1, 1, 1]}
    scene = scene_of([WALL], EYE, medium={"scattering_per_m": 1, "density": corners | density})
    with pytest.raises(InputError, match=message):
        rptcam_cl.render(scene, spp=1)


def test_corners_of_a_grid_are_in_order_and_together():
    grid = {"file": np.ones((2, 2, 2)), "min": [0, 0, 0]}
    for extra, message in (({}, "density.max.*needed"), ({"max": [1, 0, 1]}, "density.max.*above min")):
        scene = scene_of([WALL], EYE, medium={"scattering_per_m": 1, "density": grid | extra})
        with pytest.raises(InputError, match=message):
            rptcam_cl.load_scene(scene)


def test_openvdb_lies_where_openvdb_puts_it(tmp_path):
    """A file that OpenVDB 10.0.1 wrote: numbers (x, y, z) from (-3, 2, 5) on, 0.25 apart, moved by (1, 2, -3)."""
    pytest.importorskip("tinyvdb")
    numbers = np.load(DATA / "smoke.npy")
    shutil.copy(DATA / "smoke.vdb", tmp_path)
    medium = {"scattering_per_m": 1, "density": {"file": "smoke.vdb"}}
    scene = rptcam_cl.load_scene(scene_of([], EYE, medium=medium), base_dir=tmp_path)
    volume = load_density(scene.medium.density, scene)
    assert volume.voxels.sum(dtype=float) == numbers.sum(dtype=float)
    for place in np.argwhere(numbers > 0):
        world = (place + np.array([-3, 2, 5])) * 0.25 + (1, 2, -3)
        x, y, z = np.floor((world - volume.box[0]) / 0.25).astype(int)
        assert volume.voxels[z, y, x] == numbers[tuple(place)]
    for name, message in (("velocity", "is of the type Tree_vec3s"), ("densty", "did you mean density")):
        wrong = scene_of([], EYE, medium=medium | {"density": {"file": "smoke.vdb", "grid": name}})
        with pytest.raises(InputError, match=message):
            rptcam_cl.render(rptcam_cl.load_scene(wrong, base_dir=tmp_path), spp=1)


def test_openvdb_without_its_library_is_refused(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "tinyvdb", None)
    (tmp_path / "cloud.vdb").write_bytes(b"")
    scene = scene_of([WALL], EYE, medium={"scattering_per_m": 1, "density": {"file": "cloud.vdb"}})
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    with pytest.raises(InputError, match=r"tinyvdb .pip install .rptcam_cl\[vdb\]"):
        rptcam_cl.render(tmp_path / "scene.json", spp=1)


@pytest.mark.slow
def test_transmittance_is_what_media_leave_on_the_way_to_what_is_seen():
    """Through fog to a wall, or on to the sky past a ball of water in it, whose boundary the layer looks through."""
    water = {"kind": "boundary", "interior": {"absorption_per_m": [0.0, 0.5, 4.0]}}
    ball = {"shape": "sphere", "center": [0, 2, 0], "radius": 0.5, "material": water}
    fog = {"absorption_per_m": [0.1, 0.2, 0.3]}
    scene = scene_of([WALL, ball], looking([0, 0, 0], [0, 1, 0], fov=0.2), medium=fog, resolution=(4, 4))
    image = rptcam_cl.render(scene, spp=4, layers=["transmittance", "depth"])
    expected = np.exp(-4 * np.array([0.1, 0.2, 0.3]) - np.array([0.0, 0.5, 4.0]))
    np.testing.assert_allclose(image["transmittance"], np.broadcast_to(expected, (4, 4, 3)), rtol=1e-3)
    np.testing.assert_allclose(image["depth"], 5, rtol=1e-5)


@pytest.mark.slow
def test_transmittance_of_a_grid_and_of_nothing():
    d = directions(20, 4)
    column = columns(GRID, BOX, 0 * d, 5 / d[:, 1:2] * d, 4000)
    scene = scene_of([WALL], EYE, medium=smoke_of(GRID, absorption_per_m=0.5), resolution=(32, 32))
    image = rptcam_cl.render(scene, spp=1024, layers=["transmittance"])
    seen = image["transmittance"][..., 1].reshape(4, 8, 4, 8).mean(axis=(1, 3))
    assert abs(seen.mean() - np.exp(-0.5 * column).mean()) < 0.02
    clear = rptcam_cl.render(scene | {"medium": None}, spp=1, layers=["transmittance"])
    assert (clear["transmittance"] == 1).all()
