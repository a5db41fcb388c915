"""How kind Russian roulette is where: by a few tiles of the film, which no part, seed or crop changes."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.records import LIMITS
from rptcam_cl.rendering.film import (
    ALIKE,
    MOST_SURVIVAL,
    MOST_TILES,
    SURVIVAL_SCALE,
    FilmLayout,
    Roulette,
    plays,
    roulette_of,
    scout_layout,
)
from rptcam_cl.scene.film import RenderSettings
from tests.rendering.pictures import MATTE, looking, scene_of


def layout(width, height):
    return FilmLayout(width, height, 0, 0, width, height)


def test_a_picture_as_bright_everywhere_is_treated_alike():
    found = roulette_of(np.full((24, 40, 3), 0.3), scout_layout(layout(40, 24)))
    np.testing.assert_allclose(found.survival_scale, np.full((3, 5), SURVIVAL_SCALE), rtol=1e-6)
    assert found.cell_shift == 3


def test_a_quarter_of_the_light_is_four_times_the_survival_scale():
    picture = np.full((8, 16, 3), 0.4)
    picture[:, 8:] = 0.1
    bright, dark = roulette_of(picture, scout_layout(layout(16, 8))).survival_scale[0]
    assert dark == pytest.approx(4 * bright)
    assert bright == pytest.approx(SURVIVAL_SCALE * 0.75**2)  # the mean root is 3/4 of that of the bright half


def test_a_lamp_in_a_tile_hardly_matters():
    picture = np.full((8, 16, 3), 0.1)
    plain = roulette_of(picture, scout_layout(layout(16, 8))).survival_scale
    picture[3, 3] = 10.0
    lit = roulette_of(picture, scout_layout(layout(16, 8))).survival_scale
    assert lit[0, 0] > 0.8 * plain[0, 0]


def test_survival_scale_has_an_end():
    picture = np.zeros((8, 16, 3))
    picture[:, :8] = 1.0
    assert roulette_of(picture, scout_layout(layout(16, 8))).survival_scale[0, 1] == pytest.approx(
        SURVIVAL_SCALE * MOST_SURVIVAL
    )


def test_a_black_picture_is_treated_alike():
    assert roulette_of(np.zeros((8, 16, 3)), scout_layout(layout(16, 8))) is ALIKE


@pytest.mark.parametrize("size", [(1, 1), (5, 300), (8, 8), (150, 90), (640, 360), (7680, 4320)])
def test_scouted_tiles_lie_on_the_film(size):
    found = scout_layout(layout(*size))
    step = 8 * (found.tiles_skipped + 1)
    assert found.tiles <= MOST_TILES
    for first, side, full in ((found.x, found.width, size[0]), (found.y, found.height, size[1])):
        last = first + step * ((side - 1) // 8) + (side - 1) % 8
        assert 0 <= first <= last < full


def test_a_crop_scouts_the_whole_film():
    assert scout_layout(FilmLayout(640, 360, 100, 50, 30, 20)) == scout_layout(layout(640, 360))


def test_limits_say_where_cells_lie():
    record = np.frombuffer(Roulette(np.ones((3, 5), np.float32), 4).limits(RenderSettings()), LIMITS.dtype)[0]
    assert (record["cell_shift"], record["cells_across"], record["cells_down"]) == (4, 5, 3)


@pytest.mark.parametrize(("depth", "roulette", "expected"), [(8, 4, True), (8, 0, False), (4, 4, False), (5, 4, True)])
def test_roulette_is_played_below_the_greatest_depth(depth, roulette, expected):
    assert plays(RenderSettings(max_depth=depth, roulette_depth=roulette)) is expected


def lit_floor(**film):
    """A floor under a lamp, half of it in a shadow, with roulette from the second edge on."""
    lamp = {"shape": "sphere", "center": [1, 1, 3], "radius": 0.3, "material": {"kind": "emissive", "radiance": 20}}
    floor = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": {**MATTE, "reflectance": 0.6}}
    block = {"shape": "box", "min": [-1, -1, 0], "max": [0, 1, 1.5], "material": {**MATTE, "reflectance": 0.7}}
    camera = looking([0, -6, 4], [0, 0, 0.5])
    return scene_of([floor, block, lamp], camera, depth=6, roulette=2, resolution=(96, 64), film=film)


def test_a_crop_has_the_bits_of_the_whole():
    whole = np.asarray(rptcam_cl.render(lit_floor(), spp=4))
    part = np.asarray(rptcam_cl.render(lit_floor(crop=[0.25, 0.75, 0.5, 1.0]), spp=4))
    np.testing.assert_array_equal(part, whole[32:, 24:72])


def test_mean_stays_where_roulette_is_kind_or_not():
    scene = lit_floor()
    played = [np.asarray(rptcam_cl.render(scene, spp=64, seed=seed)).mean() for seed in range(6)]
    scene["render"] = {**scene["render"], "roulette_depth": 0}
    never = [np.asarray(rptcam_cl.render(scene, spp=64, seed=10 + seed)).mean() for seed in range(6)]
    error = np.hypot(np.std(played, ddof=1), np.std(never, ddof=1)) / np.sqrt(6)
    assert abs(np.mean(played) - np.mean(never)) < 4 * error
    assert error < 2e-3 * np.mean(never)


def test_roulette_begins_at_the_depth_that_is_asked_for():
    scene, shots = lit_floor(), {}
    for depth in (0, 2):
        scene["render"] = {**scene["render"], "max_depth": 3, "roulette_depth": depth}
        shots[depth] = np.asarray(rptcam_cl.render(scene, spp=4))
    assert (shots[0] != shots[2]).any()  # the third vertex is the first that plays, and the last that goes on
