"""How long and how slanted things that move appear, against what follows from speed and time."""

import numpy as np
import pytest

from tests.rendering.motion.pictures import film, scene_with
from tests.rendering.pictures import lamp
from tests.support.cases import slow

BLACK = {"environment": {"kind": "constant", "radiance": 0.0}}
WIDTH, HEIGHT, DISTANCE = 96, 64, 5.0
PIXELS_PER_UNIT = WIDTH / (2 * DISTANCE * np.tan(np.radians(20)))  # in the plane z = 0, five units away


def moments_along(values):
    """Mean and variance of the places of light along an axis [pixels]."""
    places = np.arange(len(values)) + 0.5
    mean = (places * values).sum() / values.sum()
    return mean, ((places - mean) ** 2 * values).sum() / values.sum()


def lit(item, frames, shutter, session, spp=256, **camera):
    pose = {"eye": [0, 0, DISTANCE], "target": [0, 0, 0]}
    camera = {"kind": "pinhole", "fov_degrees": 40, **pose, **camera}
    objects = [item | {"material": lamp(1.0, two_sided=True), "motion": frames}]
    scene = scene_with(objects, camera, shutter, (WIDTH, HEIGHT), depth=1, **BLACK)
    return film(scene, session, spp=spp)[..., 0].astype(float)


@pytest.mark.parametrize(("speed", "time_s"), [(4.0, 0.25), slow(20.0, 0.1)])
def test_streak_is_as_long_as_speed_time_and_magnification_say(session, speed, time_s):
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 0.08}
    frames = [{"time_s": -1, "translate": [-speed, 0, 0]}, {"time_s": 1, "translate": [speed, 0, 0]}]
    shutter = {"open_s": -time_s / 2, "time_s": time_s}
    streak, still = lit(ball, frames, shutter, session), lit(ball, [], shutter, session)
    # A uniform streak has the variance L^2 / 12; that of the ball's image and of the pixels is added.
    spread = moments_along(streak.sum(axis=0))[1] - moments_along(still.sum(axis=0))[1]
    assert np.sqrt(12 * spread) == pytest.approx(speed * time_s * PIXELS_PER_UNIT, rel=0.01)
    assert moments_along(streak.sum(axis=1)) == pytest.approx(moments_along(still.sum(axis=1)), rel=0.01)
    assert streak.sum() == pytest.approx(still.sum(), rel=0.02)  # the ball's image is as large on its way


READOUT, SPEED = 0.2, 3.0


@pytest.mark.parametrize("direction", ["top_down", "bottom_up", "left_right", "right_left"])
def test_rolling_shutter_slants_a_bar_by_its_way_from_row_to_row(session, direction):
    """A thin bar across the rows that moves along them."""
    upright = direction in ("top_down", "bottom_up")
    size, across = ([0.1, 8, 0], [1, 0, 0]) if upright else ([8, 0.1, 0], [0, 1, 0])
    bar = {"shape": "rectangle", "corner": [-size[0] / 2, -size[1] / 2, 0]}
    bar |= {"edge_u": [size[0], 0, 0], "edge_v": [0, size[1], 0]}
    way = [{"time_s": t, "translate": [SPEED * (t - 0.1) * a for a in across]} for t in (0, 1)]
    shutter = {"time_s": 0.002, "kind": "rolling", "readout_s": READOUT, "direction": direction}
    picture = lit(bar, way, shutter, session, spp=64)
    rows = picture if upright else picture.T[:, ::-1]  # so that the bar moves to the right along each row
    rows = rows if direction in ("top_down", "left_right") else rows[::-1]
    found = np.array([moments_along(row)[0] for row in rows])
    times = 0.001 + READOUT * np.arange(len(rows)) / (len(rows) - 1)
    expected = rows.shape[1] / 2 + SPEED * (times - 0.1) * PIXELS_PER_UNIT
    inside = (expected > 3) & (expected < rows.shape[1] - 3)
    slope = np.polyfit(np.flatnonzero(inside), found[inside], 1)[0]
    assert slope == pytest.approx(SPEED * PIXELS_PER_UNIT * READOUT / (len(rows) - 1), rel=0.01)
    np.testing.assert_allclose(found[inside], expected[inside], atol=0.15)  # of a pixel


@pytest.mark.slow
def test_bar_that_spins_by_whole_turns_leaves_what_it_covers_of_each_circle(session):
    """In the mean a circle of radius r is covered by 2 asin(w / 2r) / pi, w the width of the bar."""
    bar = {"shape": "rectangle", "corner": [-1.5, -0.15, 0], "edge_u": [3, 0, 0], "edge_v": [0, 0.3, 0]}
    spin = [{"time_s": 0}, {"time_s": 1, "rotate": {"axis": [0, 0, 1], "degrees": 1080}}]
    picture = lit(bar, spin, {"time_s": 1}, session, spp=512)
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    r = np.hypot(x - WIDTH / 2, y - HEIGHT / 2) / PIXELS_PER_UNIT
    ring = (r > 0.3) & (r < 1.4)
    covered = 2 * np.arcsin(0.15 / r[ring]) / np.pi
    errors = picture[ring] / covered - 1
    assert abs(errors.mean()) < 0.005
    assert errors.std() < 0.12
    assert (picture[r > 1.55] == 0).all()


@pytest.mark.slow
def test_spin_under_a_rolling_shutter_bends_a_blade(session):
    """At half the height a bar stands at the angle of that row's time, above and below at those of theirs."""
    bar = {"shape": "rectangle", "corner": [-1.5, -0.05, 0], "edge_u": [3, 0, 0], "edge_v": [0, 0.1, 0]}
    spin = [{"time_s": 0, "rotate": {"axis": [0, 0, 1], "degrees": 60}}]
    spin.append({"time_s": 1, "rotate": {"axis": [0, 0, 1], "degrees": 120}})
    picture = lit(bar, spin, {"time_s": 0.001, "kind": "rolling", "readout_s": 0.999}, session, spp=64)
    for row in range(6, HEIGHT - 6, 4):
        height = (HEIGHT / 2 - row - 0.5) / PIXELS_PER_UNIT
        angle = np.radians(60 + 60 * 0.999 * row / (HEIGHT - 1))
        expected = WIDTH / 2 + height / np.tan(angle) * PIXELS_PER_UNIT
        assert moments_along(picture[row])[0] == pytest.approx(expected, abs=0.3), row
