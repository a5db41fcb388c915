"""Noise targets: honest estimates, no bias from stopping, the same picture whatever the wave size."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.device.session import open_session
from rptcam_cl.rendering.film import TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.progressive import MOST_RUNS, NoiseEstimate, next_end, render_plan, run_length
from rptcam_cl.rendering.tracer import Wavefront
from tests.rendering.pictures import pixels, seed_of
from tests.rendering.test_world import still_life
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent

SIDE = 96  # tiles of the synthetic film
MOST = 4096


def test_runs_are_powers_of_two_and_never_more_than_eight():
    done, runs = 0, 0
    while done < 1 << 20:
        end = next_end(done)
        assert run_length(done) == run_length(end - 1) == end - done
        runs += 1
        assert runs <= MOST_RUNS
        if runs == MOST_RUNS:
            runs //= 2
        done = end
        assert runs * run_length(done) == done


def spikes(rng, count, pixels):
    """Sums of ``count`` independent samples that are 64 once in 64 times, else 0."""
    return 64.0 * rng.binomial(count, 1 / 64, pixels)


def stopped(target, seed):
    """Means, samples and estimated errors of the tiles of a film of rare spikes, rendered to a noise target."""
    layout = FilmLayout(8 * SIDE, 8 * SIDE, 0, 0, 8 * SIDE, 8 * SIDE)
    estimate, rng = NoiseEstimate(layout, target), np.random.default_rng(seed_of(seed))
    sums, done = np.zeros((6, layout.pixels)), 0
    while len(estimate.tiles) and done < MOST:
        end = next_end(done)
        active = np.repeat(np.isin(np.arange(layout.pixels // TILE_PIXELS), estimate.tiles), TILE_PIXELS)
        sums[:3] += np.where(active, spikes(rng, end - done, layout.pixels), 0)
        done = end
        estimate.take(done, sums)
    samples = estimate.samples_of_tiles(done)[: layout.tiles]
    means = sums[0].reshape(-1, TILE_PIXELS)[: layout.tiles].mean(axis=1) / samples
    return means, samples, estimate.error


@pytest.mark.parametrize(("target", "bias"), [(0.5, 0.01), slow(0.2, 0.0025)])
def test_rare_spikes_keep_their_mean_where_tiles_decide(target, bias):
    # of these spikes a pixel needs 256 and 1600 samples
    means, samples, _ = stopped(target, f"spikes {target}")
    assert samples.min() >= 64
    assert samples.std() > 0
    assert_equivalent(means.mean(), means.std(ddof=1) / SIDE, 1, bias)


@pytest.mark.slow
def test_rare_spikes_would_lose_it_if_pixels_decided():
    # the control: eight samples at least, then whenever four more leave the error of the mean below the target
    rng = np.random.default_rng(seed_of("pixels"))
    samples = 64.0 * (rng.random((4096, MOST)) < 1 / 64)
    counts = np.arange(8, MOST + 1, 4)
    sums, squares = (np.cumsum(values, axis=1)[:, counts - 1] for values in (samples, samples**2))
    means = sums / counts
    error = np.sqrt(np.maximum(squares / counts - means**2, 0) / (counts - 1))
    first = np.argmax(error <= 0.3 * np.maximum(means, 0.05), axis=1)
    assert means[np.arange(len(means)), first].mean() < 0.8


def test_interval_of_a_tile_covers_its_mean_as_often_as_it_says():
    means, _, error = stopped(0.3, "coverage")
    # the error is of a pixel; 64 of them make the tile's mean eight times better
    inside = np.abs(means - 1) <= 1.96 * error * means / 8
    assert 0.91 < inside.mean() < 0.97  # of 9216 tiles


def errors_of(scene, **options):
    """Actual over estimated root mean square error, pooled over the tiles of several pictures, and these."""
    images = [rptcam_cl.render(scene, seed=seed, layers=["samples", "variance"], **options) for seed in range(12)]
    luminance = np.array([np.asarray(image).astype(float) @ LUMINANCE for image in images])
    estimated = np.mean([image["variance"] for image in images])
    return np.sqrt(luminance.var(axis=0, ddof=1).mean() / estimated), images


MATTE = {"shape": "sphere", "center": [0, 0, 0.4], "radius": 0.4, "material": {"kind": "matte", "reflectance": 0.6}}


def quiet():
    """A scene without caustics, whose few bright samples no estimate could know."""
    return still_life() | {"objects": [*still_life()["objects"][:1], MATTE]}


@pytest.mark.parametrize(("sampler", "low", "high"), [slow("independent", 0.95, 1.05), ("lattice", 0.72, 1.03)])
def test_estimated_variance_is_that_of_the_picture_or_more(sampler, low, high):
    scene = rptcam_cl.load_scene(quiet(), [f"render.sampler={sampler}"])
    ratio, images = errors_of(scene, size=(64, 48), spp=128)
    assert low < ratio < high
    assert (images[0]["samples"] == 128).all()


def test_target_is_met_and_samples_go_where_they_are_needed():
    ratio, images = errors_of(quiet(), size=(64, 48), noise=0.03)
    assert 0.6 < ratio < 1.05
    for image in images:
        found = image.stats["noise"]
        assert (found["target"], found["met"]) == (0.03, 1)
        assert found["worst"] <= 0.03
        assert found["spp_min"] >= 64
        assert found["spp_min"] < found["spp_mean"] < image.stats["spp"]
        assert image.stats["samples"] == image["samples"].sum()
        assert image.stats["samples"] / image["samples"].size == found["spp_mean"]
        assert {key: image.metadata[key] for key in ("spp_min", "spp_mean")} == {
            "spp_min": image["samples"].min(), "spp_mean": image["samples"].mean(),
        }  # fmt: skip
        assert image.metadata["spp"] == image["samples"].max()
        tiles = image["samples"].reshape(6, 8, 8, 8)
        assert (tiles == tiles[:, :1, :, :1]).all()
    actual = np.array([np.asarray(image).astype(float) @ LUMINANCE for image in images])
    errors = np.sqrt(actual.var(axis=0, ddof=1).reshape(6, 8, 8, 8).mean(axis=(1, 3)))
    means = actual.mean(axis=0).reshape(6, 8, 8, 8).mean(axis=(1, 3))
    assert np.mean(errors <= 1.15 * 0.03 * np.maximum(means, 0.05 * means.mean())) > 0.95


@pytest.mark.slow
def test_adaptive_picture_has_the_mean_of_the_whole_one():
    options = {"size": (48, 32)}
    adaptive = [pixels(still_life(), seed=seed, noise=0.2, spp=2048, **options).mean() for seed in range(12)]
    plain = [pixels(still_life(), seed=seed, spp=1024, **options).mean() for seed in range(12)]
    error = np.sqrt((np.var(adaptive, ddof=1) + np.var(plain, ddof=1)) / 12)
    assert_equivalent(np.mean(adaptive), error, np.mean(plain), 0.01 * np.mean(plain))


@pytest.mark.parametrize("wave_size", [1, 4097, 1 << 18])
def test_wave_size_does_not_change_what_is_stopped(wave_size):
    options = {"size": (50, 37), "noise": 0.1, "spp": 640, "layers": ["samples", "variance"]}
    one, other = (rptcam_cl.render(quiet(), wave_size=size, **options) for size in (None, wave_size))
    np.testing.assert_array_equal(np.asarray(one), np.asarray(other))
    for name in ("samples", "variance"):
        np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.slow
def test_organisation_does_not_change_a_bit():
    overrides = ["film.filter={kind: mitchell}", "film.resolution=[50, 37]", "render.clamp=3"]
    scene = rptcam_cl.load_scene(still_life(), overrides)
    found = []
    for organisation in ("stream", "passes"):
        layout = FilmLayout.of(scene.film)
        wavefront = Wavefront(open_session(None), make_plan(scene), layout, scene.render, None, organisation)
        wavefront.warm_up()
        found.append(render_plan(wavefront, spp=200, seconds=None, has_lens=False, noise=0.12))
    np.testing.assert_array_equal(found[0].pixels, found[1].pixels)
    np.testing.assert_array_equal(found[0].samples, found[1].samples)
    assert found[0].samples.std() > 0


def test_most_samples_are_those_given():
    image = rptcam_cl.render(quiet(), size=(16, 16), noise=1e-6, spp=100)
    assert image.stats["spp"] == 100
    assert image.stats["noise"]["met"] == 0
    few = rptcam_cl.render(quiet(), size=(16, 16), noise=0.5, spp=20)
    assert (few.stats["spp"], few.stats.get("noise")) == (20, None)
    scene = rptcam_cl.load_scene(quiet() | {"render": {"noise": 1e-6, "spp": 80}})
    assert rptcam_cl.render(scene, size=(16, 16)).stats["spp"] == 80


@pytest.mark.parametrize("digits", [-95, -70, 70, 90])
@pytest.mark.parametrize("noise", [None, 0.05])
def test_light_of_another_unit_has_the_same_noise(digits, noise):
    """Powers of two scale float32 without rounding, and squares of these would leave its range."""
    wall = {"shape": "rectangle", "corner": [-2, 0, -2], "edge_u": [0, 0, 4], "edge_v": [4, 0, 0],
            "material": {"kind": "matte", "reflectance": [0.5, 0.5, 0.5]}}  # fmt: skip
    ball = {"shape": "sphere", "center": [0.4, 0.5, 0], "radius": 0.4, "material": wall["material"]}

    def picture(unit):
        lamp = {"shape": "sphere", "center": [0, 2, 0], "radius": 0.3}
        lamp["material"] = {"kind": "emissive", "radiance": [9 * unit] * 3}
        camera = {"kind": "pinhole", "eye": [0, 1, 3], "target": [0, 0.5, 0], "fov_degrees": 45}
        scene = {"camera": camera, "objects": [wall, ball, lamp]}
        return rptcam_cl.render(scene, size=(24, 16), spp=256, noise=noise, wave_size=24 * 16 * 16)

    one, other = picture(1.0), picture(2.0**digits)
    np.testing.assert_array_equal(np.asarray(one), np.asarray(other) / np.float32(2.0**digits))
    assert one.stats["numerics"]["noise"] == other.stats["numerics"]["noise"] and one.stats["numerics"]["noise"]
    assert one.stats["spp"] == other.stats["spp"] > 64


def test_black_picture_is_done_at_once():
    dark = still_life() | {"lights": [], "environment": None, "objects": []}
    image = rptcam_cl.render(dark, size=(16, 16), noise=0.01)
    assert (image.stats["spp"], image.stats["noise"]["met"]) == (64, 1)


@pytest.mark.parametrize("noise", [0, -0.1, 1, 2, float("nan"), "little"])
def test_wrong_target_is_refused(noise):
    with pytest.raises(InputError, match=r"render\.noise"):
        rptcam_cl.load_scene(still_life() | {"render": {"noise": noise}})


@pytest.mark.parametrize(("first", "then"), [(0.02, 0.015), (0.05, 0.02), (0.02, 0.03)])
def test_a_saved_render_goes_on_to_a_lower_noise_or_says_why_not(tmp_path, first, then):
    """It has the bits of one run while every tile that was left alone meets the new target, too."""

    def rendered(noise, spp, **options):
        return rptcam_cl.render(still_life(), noise=noise, spp=spp, size=(48, 32), seed=3, **options)

    state = {"checkpoint": tmp_path / "a.rpck", "resume": True}
    tiles = rendered(first, 64, **state).stats["noise"]["met"]
    assert 0 < tiles < 1
    if then == 0.015:
        assert np.asarray(rendered(then, 192, **state)).tobytes() == np.asarray(rendered(then, 192)).tobytes()
        return
    why = "4 of 24 tiles met its noise target 0.05 .* do not meet 0.02; --noise 0.05 goes on"
    with pytest.raises(StateError, match=why if then < first else "its noise is 0.02, and this render's 0.03"):
        rendered(then, 192, **state)
    assert rendered(first, 72, **state).stats["noise"]["target"] == first
