"""Samples that are not numbers, counts of samples, and how a render ends."""

import numpy as np
import pytest

import rptcam_cl
from tests.rendering.pictures import WHITE, looking, scene_of
from tests.rendering.test_world import still_life
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
