"""Points of an aperture, from the rays of a thin lens: even over its shape, and as well spread as the numbers."""

import numpy as np
import pytest
from PIL import Image, ImageDraw

from rptcam_cl.rendering.cameras.lens_records import stop_shape
from rptcam_cl.scene.load import load_scene
from tests.device.probes import camera_rays
from tests.support.cases import fast, slow
from tests.support.statistics import chi_squared

RADIUS = 0.25
CELLS, FINE = 12, 48  # cells across for chi-squared; points across a cell that tell how much of it is open
S = [[0, 0], [3, 0], [3, 3], [1, 3], [1, 4], [3, 4], [3, 5], [0, 5], [0, 2], [2, 2], [2, 1], [0, 1]]
SHAPES = {
    "blades": {"shape": "polygon", "blades": 9, "curvature": 0.4, "rotation_degrees": 7},
    "star": {"shape": "star", "points": 7, "inner_radius": 0.3},
    "heart": {"shape": "heart"},
    "clockwise L": {
        "shape": "outline",
        "points": [[0, 3], [1, 3], [1, 1], [2, 1], [2, 0], [0, 0]],
        "rotation_degrees": 10,
    },
    "S, which no point sees all of": {"shape": "outline", "points": S, "rotation_degrees": 20},
    "picture": {"shape": "image", "file": "mask.png"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("aperture")
    mask = Image.new("L", (50, 50), 0)
    ImageDraw.Draw(mask).ellipse((4, 4, 48, 40), fill=255)
    ImageDraw.Draw(mask).rectangle((20, 10, 30, 30), fill=0)
    mask.save(path / "mask.png")
    return path


def scene(name, folder):
    camera = {"kind": "thin_lens", "eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 40, "focus_distance_m": 2.0}
    camera |= {"aperture_radius_m": RADIUS, "aperture": SHAPES[name]}
    mapping = {"camera": camera, "film": {"resolution": [16, 16]}}
    return load_scene(mapping, base_dir=folder)


def counts(x, y):
    edges = np.linspace(-1, 1, CELLS + 1)
    return np.histogram2d(x, y, bins=(edges, edges))[0]


@pytest.mark.parametrize("lanes", [slow(1), 8])
@pytest.mark.parametrize("name", fast(["blades", "heart", "picture"], SHAPES))
def test_points_are_even_over_the_shape(name, lanes, session, folder):
    given = scene(name, folder)
    x, y = camera_rays(session, given, 512, lanes).origin.T[:2] / RADIUS
    shape = stop_shape(given, given.camera.aperture)
    nudged = [shape.holds(x + dx, y + dy) for dx in (-1e-6, 1e-6) for dy in (-1e-6, 1e-6)]
    assert np.any(nudged, axis=0).all()
    middles = (np.arange(CELLS * FINE) + 0.5) * (2 / (CELLS * FINE)) - 1
    fine = np.meshgrid(middles, middles, indexing="ij")
    share = counts(*(axis[shape.holds(*fine)] for axis in fine))
    share[share > 0] += 1e-9
    expected = share * (len(x) / share.sum())
    inside = expected > 0  # a sliver of a cell may fall between the fine points
    assert counts(x, y)[~inside].sum() < 1e-4 * len(x)
    assert chi_squared(counts(x, y)[inside], expected[inside]) > 1e-4
    assert chi_squared(counts(0.98 * x, 0.98 * y)[inside], expected[inside]) < 1e-9


@pytest.mark.parametrize("name", fast(["blades", "picture"], SHAPES))
def test_points_are_as_evenly_spread_as_the_numbers(name, session, folder):
    unevenness = {}
    for sampler in ("independent", "lattice"):
        rays = camera_rays(session, scene(name, folder), 64, lattice=sampler == "lattice")
        x, y = rays.origin.T[:2] / RADIUS
        _, pixel = np.unique(rays.pixel, axis=0, return_inverse=True)
        ratios = []
        for angle in np.arange(8) * (np.pi / 4) + 0.2:  # how many of a pixel's points lie on one side of a line
            side = x * np.cos(angle) + y * np.sin(angle) > 0.1
            ratios.append(np.bincount(pixel.ravel(), side).var() / (64 * side.mean() * (1 - side.mean())))
        unevenness[sampler] = float(np.mean(ratios))
    assert 0.85 < unevenness["independent"] < 1.15
    assert unevenness["lattice"] < 0.1  # parts picked by an alias table: 0.13 to 0.39
