"""Which photons belong to which samples, how they lie in memory, and when a scene has any."""

import numpy as np
import pytest

from rptcam_cl.plan import make_plan
from rptcam_cl.rendering.photon_passes import MOST_PHOTONS, pass_of, within_passes
from rptcam_cl.rendering.photons import first_radius, sorted_by_cell
from rptcam_cl.scene import load_scene
from tests.rendering.caustics.test_photons import ball, glasses, lamp, scene


def test_every_sample_sees_one_pass_and_passes_follow_each_other():
    seen = [pass_of(sample) for sample in range(100)]
    assert all(found.first <= sample < found.first + found.samples for sample, found in enumerate(seen))
    assert [found.number for found in seen] == sorted(found.number for found in seen)
    assert len({found.number for found in seen}) == 5 + 6  # 1, 1, 2, 4, 8 samples, then 16 each


@pytest.mark.parametrize(("first", "samples", "most"), [(0, 100, 16), (3, 50, 5), (17, 1, 16), (15, 2, 64)])
def test_pieces_of_a_range_cover_it_and_see_one_pass_each(first, samples, most):
    pieces = list(within_passes(first, samples, most))
    assert [sample for start, count in pieces for sample in range(start, start + count)] == [
        *range(first, first + samples)
    ]
    assert all(count <= most and pass_of(start) == pass_of(start + count - 1) for start, count in pieces)


def test_photons_of_a_pass_are_a_power_of_two_and_fit():
    counts = [pass_of(sample).photons(pixels) for sample in (0, 5, 99) for pixels in (1, 10_000, 10**8)]
    assert all(count & (count - 1) == 0 and count <= MOST_PHOTONS for count in counts)


def test_radius_shrinks_with_the_sixth_root_of_the_samples():
    assert pass_of(640).shrinkage / pass_of(10 * 640).shrinkage == pytest.approx(10 ** (1 / 6), rel=0.01)


def photons_at(places):
    found = np.zeros((len(places), 8), np.float32)
    found[:, :3] = places
    return found


def test_cells_hold_their_photons_in_order():
    photons = photons_at(np.random.default_rng(1).uniform(-3, 5, (500, 3)))
    grid, order, starts = sorted_by_cell(photons, 0.1)
    masks = np.array([grid[0][f"mask_{axis}"] for axis in "xyz"])
    assert sorted(order) == list(range(500)) and starts[-1] == 500 and np.all(masks >= 1)
    cells = np.floor(photons[:, :3] * grid[0]["low"][3]).astype(np.int64) & masks
    numbers = (cells[:, 2] * (masks[1] + 1) + cells[:, 1]) * (masks[0] + 1) + cells[:, 0]
    for number in np.unique(numbers):
        assert list(order[starts[number] : starts[number + 1]]) == list(np.flatnonzero(numbers == number))


def test_no_photons_have_no_place():
    grid, order, _ = sorted_by_cell(photons_at(np.zeros((0, 3))), 0.1)
    assert len(order) == 0 and np.all(grid[0]["low"][:3] > grid[0]["high"][:3])


def test_radius_follows_the_density_of_most_photons():
    plane = np.random.default_rng(2).uniform(0, 1, (2048, 3)) * [1, 1, 0]
    near, far = first_radius(photons_at(plane), 10**5), first_radius(photons_at(10 * plane), 10**5)
    assert far == pytest.approx(10 * near, rel=1e-3)
    astray = np.concatenate([plane, np.full((20, 3), 1e4) * np.arange(1, 21)[:, None]])
    assert first_radius(photons_at(astray), 10**5) == pytest.approx(near, rel=0.05)


GREY_BALL = {"kind": "matte", "reflectance": 0.5}


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (scene(lamp(0.02), ball(), caustics="auto"), "on: photons"),
        (scene(lamp(0.3), ball(), caustics="auto"), "off: paths find"),
        (scene(lamp(), ball() | {"material": GREY_BALL}), "off: no smooth glass"),
        (scene(ball(), environment={"kind": "constant", "radiance": 1.0}), "off: no lamp"),
        (scene(lamp(), ball(alpha=0.2)), "off: no smooth glass"),
    ],
)
def test_choice_says_what_the_scene_has(made, says):
    caustics = make_plan(load_scene(made)).caustics
    assert caustics.choice.startswith(says)
    assert caustics.facts == {"CAUSTICS": int(says.startswith("on"))}


def test_scene_without_the_key_is_left_alone():
    assert make_plan(load_scene(glasses(caustics="off"))).caustics.choice is None
