"""Reconstruction filters: the picture of a step edge is the filter's integral, and flat fields stay flat."""

import numpy as np
import pytest
from scipy.integrate import quad

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.cameras.model import CELLS, filter_table
from rptcam_cl.scene.film import FilmFilter
from tests.rendering.pictures import WHITE, lamp, pixels, scene_of, seed_of
from tests.support.statistics import InconclusiveError, assert_equivalent

SIZE = 32
EDGE = 16.3  # columns from the left


def gaussian(x):
    return np.exp(-(x**2) / (2 * 0.5**2)) - np.exp(-(1.5**2) / (2 * 0.5**2))


def blackman_harris(x):
    t = 2 * np.pi * (x + 1.5) / 3
    return 0.35875 - 0.48829 * np.cos(t) + 0.14128 * np.cos(2 * t) - 0.01168 * np.cos(3 * t)


def mitchell(x):
    x = abs(x)
    if x < 1:
        return 7 * x**3 - 12 * x**2 + 16 / 3
    return -7 / 3 * x**3 + 12 * x**2 - 20 * x + 32 / 3


FILTERS = {
    "box": ({}, lambda x: 1.0, 0.5),
    "wide box": ({"kind": "box", "radius_px": 1.25}, lambda x: 1.0, 1.25),
    "tent": ({"kind": "tent"}, lambda x: 1 - abs(x), 1.0),
    "gaussian": ({"kind": "gaussian"}, gaussian, 1.5),
    "blackman_harris": ({"kind": "blackman_harris"}, blackman_harris, 1.5),
    "mitchell": ({"kind": "mitchell"}, mitchell, 2.0),
}


def edge_profile(name):
    """What each column should show: the part of the filter that lies beyond the edge."""
    _, shape, radius = FILTERS[name]
    whole = quad(shape, -radius, 0)[0] + quad(shape, 0, radius)[0]
    starts = np.clip(EDGE - (np.arange(SIZE) + 0.5), -radius, radius)
    return np.array([quad(shape, start, radius, points=[0.0])[0] for start in starts]) / whole


def edge_scene(name):
    """A lamp that fills the film from a column on, seen by a pinhole; the film is 2 wide at distance 1."""
    left = 2 * EDGE / SIZE - 1
    sheet = {"shape": "rectangle", "corner": [left, -9, -1], "edge_u": [9, 0, 0], "edge_v": [0, 18, 0]}
    camera = {"kind": "pinhole", "fov_degrees": 90, "eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]}
    return scene_of(
        [{**sheet, "material": lamp(1.0)}], camera, depth=1, resolution=(SIZE, SIZE), film={"filter": FILTERS[name][0]}
    )


def measured(name, seed="edge"):
    columns = pixels(edge_scene(name), seed=seed_of(f"{seed} {name}"), spp=1024)[..., 0]
    return columns.mean(axis=0), columns.std(axis=0, ddof=1) / np.sqrt(SIZE)


@pytest.mark.parametrize("name", FILTERS)
def test_step_edge_shows_the_integral_of_the_filter(name):
    mean, error = measured(name)
    assert_equivalent(mean, error, edge_profile(name), 0.004)


def test_another_filter_would_be_noticed():
    mean, error = measured("tent")
    for other in ("box", "gaussian", "blackman_harris"):
        with pytest.raises(AssertionError) as caught:
            assert_equivalent(mean, error, edge_profile(other), 0.004)
        assert caught.type is not InconclusiveError


def test_only_negative_lobes_overshoot():
    assert edge_profile("mitchell").max() > 1.015
    assert measured("mitchell")[0].max() > 1.015
    assert measured("gaussian")[0].max() < 1 + 1e-6


@pytest.mark.parametrize("name", FILTERS)
def test_uniform_world_stays_uniform(name):
    camera = {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]}
    film = {"filter": FILTERS[name][0]}
    picture = pixels(scene_of([], camera, environment=WHITE, film=film), spp=256)
    if name != "mitchell":  # whose samples weigh +1.1 or -1.1
        np.testing.assert_allclose(picture, 1, rtol=1e-6)
        return
    error = picture[..., 0].std(ddof=1) / SIZE
    assert_equivalent(picture.mean(), error, 1, 0.004)


def test_places_are_symmetric_and_within_the_radius():
    for options, _, radius in FILTERS.values():
        found = filter_table(FilmFilter(**options))
        if len(found) > 1:
            places = found[2:]
            assert len(places) == CELLS + 1
            np.testing.assert_array_equal(places, -places[::-1])
            assert (np.diff(places) > 0).all()
            assert places[-1] == pytest.approx(radius, rel=1e-5)  # the end of the last step
    assert len(filter_table(FilmFilter())) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "sinc"}, "film.filter.kind"),
        ({"kind": "tent", "radius_px": 0}, "film.filter.radius_px"),
        ({"kind": "tent", "radius_px": 99}, "film.filter.radius_px"),
        ({"shape": "tent"}, "film.filter.shape: unknown key"),
    ],
)
def test_wrong_filter_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        rptcam_cl.load_scene(edge_scene("box") | {"film": {"resolution": [8, 8], "filter": options}})
