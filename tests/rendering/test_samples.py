"""Samples that are not numbers, counts of samples, and how a render ends."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from tests.rendering.pictures import WHITE, lamp, looking, scene_of
from tests.rendering.test_world import still_life
from tests.support.cases import slow
from tests.support.mutants import changed_kernels

ADDED = "static PixelSum add_sample(PixelSum s, I lanes, F3 value, __global uint *counters)\n{"


@pytest.mark.slow
def test_samples_that_are_not_finite_are_dropped_and_counted():
    # dropped samples must not change the paths of the others, as they do by the look of a render with roulette
    scene = still_life() | {"render": still_life()["render"] | {"roulette_depth": 0}}
    plain = rptcam_cl.render(scene, size=(48, 32), spp=8, seed=1)
    assert plain.stats["not_finite"] == 0
    # every sample brighter than 3 in red: few, and known from pictures of one and of two samples
    one, two = (np.asarray(rptcam_cl.render(scene, size=(48, 32), spp=n, seed=1)) for n in (1, 2))
    red = np.stack([one[..., 0], 2 * two[..., 0] - one[..., 0]])
    hot = red > 3
    low, high = np.quantile(red[hot], [1 / 3, 2 / 3])
    assert 3 < low < high
    poison = f"value.x > {high:.3f}f ? (F)(NAN) : value.x > {low:.3f}f ? (F)(INFINITY) : (F)(-INFINITY)"
    with changed_kernels(ADDED, f"{ADDED}\n    value.x = value.x > 3.0f ? ({poison}) : value.x;"):
        image = rptcam_cl.render(scene, size=(48, 32), spp=2, seed=1)
    assert image.stats["not_finite"] == hot.sum() > 0
    assert np.isfinite(np.asarray(image)).all()
    spared = ~hot.any(axis=0)
    np.testing.assert_array_equal(np.asarray(image)[spared], two[spared])


def test_samples_are_counted():
    image = rptcam_cl.render(still_life(), size=(37, 21), spp=5)
    assert image.stats["samples"] == 37 * 21 * 5
    assert image.stats["spp"] == image.metadata["spp"] == 5
    assert image.stats["interrupted"] is False


def test_stopping_keeps_whole_samples():
    calls = []

    def stop():
        calls.append(1)
        return len(calls) == 2

    white = scene_of([], looking([0, 0, 0], [1, 0, 0]), environment=WHITE)
    image = rptcam_cl.render(white, size=(64, 64), spp=4000, wave_size=4096, should_stop=stop)
    assert image.stats["interrupted"] is True
    assert 0 < image.stats["spp"] < 4000
    np.testing.assert_array_equal(np.asarray(image), 1)


@pytest.mark.parametrize("seconds", [0, -1.0, float("nan")])
def test_time_that_cannot_be_is_refused(seconds):
    with pytest.raises(rptcam_cl.InputError, match=r"^seconds: is out of range \(got "):
        rptcam_cl.render(still_life(), seconds=seconds)


def test_time_ends_a_render():
    image = rptcam_cl.render(still_life(), size=(64, 48), seconds=0.5)
    # it ends at the nearest whole sample, and without a time never; a busy machine may take any longer
    assert image.stats["seconds"]["render"] > 0.2
    assert image.stats["spp"] >= 1


def test_progress_is_told_in_order():
    told = []
    rptcam_cl.render(still_life(), size=(64, 48), spp=64, on_progress=told.append)
    assert [progress.stage for progress in told][:1] == ["compile"]
    done = [progress.samples_done for progress in told]
    assert done == sorted(done)
    assert (done[-1], told[-1].spp_target, told[-1].blocked_share) == (64, 64, None)


SIZE = {"size": (48, 32)}


def wall(radiance):
    """A lamp that fills the picture: every sample is its radiance."""
    sheet = {"shape": "plane", "point": [0, 0, 0], "normal": [0, -1, 0], "material": lamp(radiance)}
    return scene_of([sheet], looking([0, -3, 0], [0, 0, 0]), depth=1)


def rendered(scene, limit, **options):
    return rptcam_cl.render(rptcam_cl.load_scene(scene, [f"render.clamp={limit}"] if limit else []), **options)


def test_bright_samples_keep_their_colour_and_what_went_is_told():
    image = rendered(wall([8.0, 4.0, 0.0]), 2.0, spp=5)
    np.testing.assert_allclose(np.asarray(image), np.broadcast_to([2.0, 1.0, 0.0], (32, 32, 3)), rtol=1e-6)
    assert image.stats["clamp"]["limit"] == 2
    assert image.stats["clamp"]["removed_share"] == pytest.approx(0.75, rel=1e-6)
    assert image.metadata["clamp"] == "biased: samples above 2 scaled down, 75.00% of the light removed"


@pytest.mark.parametrize("limit", [slow(8.0), 1e6])
def test_limit_that_nothing_exceeds_changes_no_bit(limit):
    plain, limited = (rendered(wall([8.0, 4.0, 0.0]), each, spp=5) for each in (None, limit))
    np.testing.assert_array_equal(np.asarray(plain), np.asarray(limited))
    assert limited.stats["clamp"]["removed_share"] == 0
    assert "clamp" not in plain.stats
    assert "clamp" not in plain.metadata


def test_what_is_missing_is_the_share_that_is_told():
    plain, limited = (np.asarray(rendered(still_life(), each, spp=64, **SIZE)) for each in (None, 2.0))
    share = rendered(still_life(), 2.0, spp=64, **SIZE).stats["clamp"]["removed_share"]
    assert share > 0.01
    assert 1 - limited.sum(dtype=float) / plain.sum(dtype=float) == pytest.approx(share, rel=1e-4)
    assert (limited <= plain * (1 + 1e-6)).all()


def test_wave_size_and_interruption_do_not_change_a_bit(tmp_path):
    state = tmp_path / "a.rpck"
    whole = rendered(still_life(), 2.0, spp=20, **SIZE)
    rendered(still_life(), 2.0, spp=7, checkpoint=state, resume=True, **SIZE)
    part = rendered(still_life(), 2.0, spp=20, checkpoint=state, resume=True, wave_size=4096, **SIZE)
    np.testing.assert_array_equal(np.asarray(whole), np.asarray(part))
    assert part.stats["clamp"] == whole.stats["clamp"]


def test_ranges_of_samples_add_up_what_the_limit_took(tmp_path):
    parts = [tmp_path / f"{first}.rpck" for first in (0, 1, 4)]
    for path, samples in zip(parts, ((0, 1), (1, 4), (4, 5)), strict=True):
        rendered(wall([8.0, 4.0, 0.0]), 2.0, samples=samples, checkpoint=path)
    assert rptcam_cl.merge(parts).stats["clamp"]["removed_share"] == pytest.approx(0.75, rel=1e-6)


@pytest.mark.parametrize("limit", [0, -1, ".inf", ".nan"])
def test_wrong_limit_is_refused(limit):
    with pytest.raises(InputError, match=r"render\.clamp"):
        rptcam_cl.load_scene(still_life(), [f"render.clamp={limit}"])
