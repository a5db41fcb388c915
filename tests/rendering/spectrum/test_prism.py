"""A prism of real glass before lines of light: each is seen where Snell's law, in two dimensions, puts it.

The prism stands with its edge upright, light within it runs along z at the least deviation. Angles count from -z to +x,
which is where the edge is.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from rptcam_cl.optics.library import load_lens
from tests.rendering.pictures import pixels, scene_of, seed_of
from tests.support.cases import slow

HALF_APEX = np.radians(20)
LINES_NM = {"mercury": (435.83, 546.07, 578.0), "lasers": (457.9, 514.5, 632.8)}
CHANNELS = (2, 1, 0)  # in which each of the lines is seen best
WIDTH = 900
FIELD = np.radians(6)
SLIT = np.radians(0.02)
FAR = 1e6


def index(glass, wavelength_nm):
    """Index of a glass by the law that lens files give it."""
    surfaces = [{"radius": 50, "thickness": 1, "glass": glass, "diameter": 5}, {"diameter": 5}]
    return float(load_lens({"name": "one", "surfaces": surfaces}).indices(wavelength_nm)[1])


def least_deviation(n):
    return 2 * (np.arcsin(n * np.sin(HALF_APEX)) - HALF_APEX)


def angle_behind(angle, n):
    """Angle of a ray behind the prism that meets it under ``angle``."""
    inside = np.arcsin(np.sin(angle + HALF_APEX) / n)
    return HALF_APEX - np.arcsin(n * np.sin(2 * HALF_APEX - inside))


def column_of(wavelength_nm, glass, straight):
    """Column where a line is seen by a camera that looks under half of the deviation of the middle line."""
    n = index(glass, wavelength_nm)
    seen = brentq(lambda angle: angle_behind(angle, n) + straight, straight - FIELD, straight + FIELD)
    return WIDTH / 2 * (1 + np.tan(seen - straight) / np.tan(FIELD / 2))


def spectroscope(glass, lines, straight, spectrum):
    """A prism before a far slit that shines in lines, all as bright."""
    base = 4 * np.tan(HALF_APEX)
    corners = [(-1.0, base / 2), (-1.0, -base / 2), (1.0, 0.0)]
    vertices = [[x, y, z] for y in (-1.0, 1.0) for x, z in corners]
    faces = [[0, 1, 2], [5, 4, 3], [0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]]
    wedge = {"shape": "mesh", "vertices": vertices, "faces": faces, "material": {"kind": "dielectric", "glass": glass}}
    away = np.array([np.sin(-straight), 0, -np.cos(straight)])
    across = np.array([np.cos(straight), 0, np.sin(-straight)])
    half = FAR * SLIT / 2
    corner = FAR * away - half * across - np.array([0, FAR, 0])
    light = {"lines_nm": {float(line): 1.0 for line in lines}}
    slit = {"shape": "rectangle", "corner": corner.tolist(), "edge_u": (2 * half * across).tolist(),
            "edge_v": [0, 2 * FAR, 0],
            "material": {"kind": "emissive", "radiance": light, "two_sided": True}}  # fmt: skip
    entry = np.array([0.0, 0.0, base / 4])
    eye = entry - 2 * np.array([np.sin(straight), 0, -np.cos(straight)])
    camera = {"kind": "pinhole", "eye": eye.tolist(), "target": entry.tolist(), "up": [0, 1, 0],
              "fov_degrees": np.degrees(FIELD)}  # fmt: skip
    return scene_of([wedge, slit], camera, depth=3, resolution=(WIDTH, 8), spectrum=spectrum)


@pytest.mark.parametrize(("glass", "lamp"), [("SF11", "mercury"), slow("N-BK7", "lasers")])
def test_lines_stand_at_their_angles(glass, lamp):
    lines = LINES_NM[lamp]
    straight = least_deviation(index(glass, lines[1])) / 2
    columns = [column_of(line, glass, straight) for line in lines]
    assert columns[1] == pytest.approx(WIDTH / 2)  # at the least deviation, straight ahead
    assert min(np.diff(columns)) * max(np.diff(columns)) > 0
    assert np.abs(np.diff(columns)).min() > 20
    film = pixels(spectroscope(glass, lines, straight, "spectral"), seed=seed_of(lamp), spp=512).mean(axis=0)
    x = np.arange(WIDTH) + 0.5
    for column, channel in zip(columns, CHANNELS, strict=True):
        near = np.abs(x - column) < 9
        values = film[near, channel]
        assert values.max() > 20 * np.median(np.abs(film[:, channel]))
        assert x[near] @ values / values.sum() == pytest.approx(column, abs=0.1)
    dark = np.min([np.abs(x - column) for column in columns], axis=0) > 9
    assert np.abs(film[dark]).max() < 1e-3 * np.abs(film).max()


@pytest.mark.slow
def test_prism_of_one_index_shows_one_line():
    straight = least_deviation(index("SF11", 587.5618)) / 2
    film = pixels(spectroscope("SF11", (435.83, 546.07, 578.0), straight, "rgb"), spp=64).mean(axis=0)
    lit = np.flatnonzero(film.max(axis=1) > 0.01 * film.max())
    assert abs(lit.mean() + 0.5 - WIDTH / 2) < 1
    assert np.ptp(lit) < 8


@pytest.mark.slow
def test_sodium_leaves_no_colour_but_its_own():
    colours = ([0.8, 0.2, 0.1], [0.2, 0.7, 0.2], [0.1, 0.2, 0.9], [0.9, 0.9, 0.9])
    patches = [
        {"shape": "rectangle", "corner": [x, -8, 0], "edge_u": [8, 0, 0], "edge_v": [0, 16, 0],
         "material": {"kind": "matte", "reflectance": colour}}
        for x, colour in zip((-16, -8, 0, 8), colours, strict=True)
    ]  # fmt: skip
    camera = {"kind": "pinhole", "eye": [0, 0, 100], "target": [0, 0, 0], "up": [0, 1, 0]}
    camera["fov_degrees"] = 2 * np.degrees(np.arctan(0.16))
    sky = {"kind": "constant", "radiance": {"lines_nm": {589.0: 2, 589.6: 1}, "luminance": 1}}
    scene = scene_of(patches, camera, environment=sky, depth=2, resolution=(32, 16))

    def chart(spectrum):
        film = pixels({**scene, "spectrum": spectrum}, seed=seed_of("sodium"), spp=512).reshape(16, 4, 8, 3)
        means = film.mean(axis=(0, 2))
        return means / means.sum(axis=1, keepdims=True)

    shades = chart("spectral")
    np.testing.assert_allclose(shades, np.broadcast_to(shades[3], shades.shape), atol=0.01)
    assert np.abs(chart("rgb") - shades[3]).max() > 0.2
