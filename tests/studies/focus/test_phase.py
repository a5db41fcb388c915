"""Phase detection: half pictures tell the distance, the move finds the least spot, and blank targets are refused."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import rptcam_cl
from rptcam_cl.rendering.cameras.film_pupil import HalfView, places_round
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.studies.focus.phase import Halves, PhaseMatch, focus_by_phase, half_probe, half_view, measure_halves
from rptcam_cl.studies.focus.probe import NoContrast, Policy, Zone
from rptcam_cl.studies.focus.renderer import Task
from tests.rendering.pictures import seed_of
from tests.studies.focus.scenes import CENTRE, checker, lens_camera, noise, probe_of, scene_of, target
from tests.support.cases import slow

SIDE = Zone(0.7, 0.76, 0.46, 0.54)
THIN = {
    "kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "focus_distance_m": 3,
    "eye": [0, 0, 0], "target": [0, 0, -1],
}  # fmt: skip
DGAUSS = lens_camera("dgauss-50mm")
QUARTER = 0.25  # of the depth of focus


def phase(probe, zone, name):
    """The report of a phase detection from where the probe stands."""
    return focus_by_phase(Task(probe, (zone,), Policy.CLOSEST, seed_of(name)))


def miss(probe, state, distance, zone=CENTRE):
    """How far a state lies from the sharpest real-ray spot of a plane [depths of focus]."""
    best = probe.drive.coordinate(probe.drive.state_for(distance, zone))
    return abs(probe.drive.coordinate(state) - best) / probe.drive.depth_of_focus


@pytest.mark.parametrize("vergence", [0.0, 0.2, 0.6, 1.5])
def test_displacement_through_a_thin_lens_is_that_of_similar_triangles(vergence):
    scene = scene_of([], THIN)
    view = HalfView(camera_of(scene).pupil_rays(places_round((200.0, 90.0))), "x")
    radius, film_mm = 0.0125, 50 / (1 - 0.05 / 3)
    # The middles of the halves of a disk lie 8 / (3 pi) radii apart.
    on_film = 8 / (3 * math.pi) * radius * (1 / 3 - vergence) * film_mm
    assert view.displacement(vergence) == pytest.approx(on_film * 10, rel=5e-3)  # 10 pixels per mm
    assert view.displacement(1 / 3) == pytest.approx(0.0, abs=1e-9)
    assert view.sharpest() == pytest.approx(1 / 3)


WAVES = 2 * np.pi * np.stack(np.meshgrid(np.fft.fftfreq(96), np.fft.fftfreq(96), indexing="ij"), axis=-1)
WAVE = np.hypot(WAVES[..., 0], WAVES[..., 1])
PARTS = 4  # that a probe consists of


def halves_seen(view, vergence, spectrum):
    """What exact rays make of a target with a spectrum (96, 96) through the two halves of the pupil."""
    offsets = view.offsets(vergence)
    phases = np.exp(1j * (WAVES[..., 1, None] * offsets[:, 0] + WAVES[..., 0, None] * offsets[:, 1]))
    return np.stack([np.fft.ifft2(spectrum * (phases @ share)).real for share in view.shares])


def matches(view, seen, sigma, rng, count):
    """Matches of pictures with noise of a standard deviation, one number or one for each pixel of both halves."""
    for _ in range(count):
        parts = seen[:, None] + 2 * np.expand_dims(sigma, 1) * rng.normal(size=(2, PARTS, 96, 96))
        match = PhaseMatch(Halves(parts, (24, 24, 24, 24)), view).best(-2.0, 2.0)
        assert match is not None
        assert match.refusal is None
        yield match


@pytest.mark.parametrize("displacement", [-6.0, *(slow(d) for d in (0.3, 9.0))])
def test_match_finds_the_distance_of_noisy_half_pictures(displacement):
    # Pictures by exact rays of a random target, through a thin lens; noise is added to each half.
    view = HalfView(camera_of(scene_of([], THIN)).pupil_rays(places_round((200.0, 90.0))), "x")
    per_vergence = view.displacement(1.0) - view.displacement(0.0)
    vergence = 1 / 3 + displacement / per_vergence
    rng = np.random.default_rng(seed_of(f"match {displacement}"))
    seen = halves_seen(view, vergence, np.fft.fft2(rng.normal(size=(96, 96))) / (0.1 + WAVE) * np.exp(-WAVE))
    found = list(matches(view, 1 + seen / seen.std() / 4, np.full((2, 1, 1), 0.0125), rng, 5))
    displacements, errors = zip(*((match.displacement, match.displacement_error) for match in found), strict=True)
    assert np.mean(displacements) == pytest.approx(view.displacement(vergence), abs=0.05)
    assert np.std(displacements) < 1.5 * np.mean(errors)  # the error that is told is the scatter there is
    assert max(errors) < 0.2


@pytest.mark.slow
def test_error_of_a_single_lamp_is_the_scatter_there_is():
    # All of the light lies in one block of the zone, and its noise with it: scatter over the blocks tells a twentieth.
    view = HalfView(camera_of(scene_of([], THIN)).pupil_rays(places_round((200.0, 90.0))), "x")
    spot = np.exp(-(WAVE**2) / 2 - 1j * (WAVES.sum(axis=-1) * 44))
    seen = 0.01 + np.maximum(halves_seen(view, 1 / 3, spot), 0.0) * 96
    rng = np.random.default_rng(seed_of("lamp"))
    found = list(matches(view, seen, 0.3 * np.sqrt(seen), rng, 12))
    told = np.sqrt(np.mean([match.displacement_error**2 for match in found]))
    # Twelve draws know their scatter to a fifth, at three standard errors.
    assert np.std([match.displacement for match in found], ddof=1) == pytest.approx(told, rel=0.6)


def test_even_light_without_noise_is_flat():
    view = HalfView(camera_of(scene_of([], THIN)).pupil_rays(places_round((200.0, 90.0))), "x")
    with np.errstate(divide="raise", invalid="raise"):
        match = PhaseMatch(Halves(np.ones((2, PARTS, 96, 96)), (24, 24, 24, 24)), view).best(-2.0, 2.0)
    assert match is None or match.refusal == "flat"


@pytest.mark.slow
def test_halves_of_the_probe_show_the_target_side_by_side():
    probe = probe_of(scene_of([target(4.0, 3.0, noise(100))], DGAUSS))
    state = probe.drive.state_for(4.0, CENTRE) + 4 * probe.drive.depth_of_focus
    ((before, beyond),) = measure_halves(probe, state, [CENTRE], 256, seed_of("halves"))
    expected = half_view(probe, state, CENTRE, "x").displacement(0.25)
    assert abs(expected) > 1.5
    one, other = (image.luminance.mean(axis=0) for image in (before, beyond))
    one, other = one / one.mean() - 1, other / other.mean() - 1
    best = max(range(-8, 9), key=lambda right: float((one[:, 8:-8] * np.roll(other, -right, axis=1)[:, 8:-8]).sum()))
    assert best == pytest.approx(expected, abs=1.0)


@pytest.mark.parametrize(
    ("camera", "distance", "start", "zone"),
    [(DGAUSS, 4.0, -20.0, SIDE), slow(DGAUSS, 0.7126, 90.0, CENTRE), slow(THIN, 2.0, 15.0, SIDE)],
    ids=["double Gauss, off the axis", "near", "thin lens"],
)
def test_phase_finds_the_least_spot_in_three_probes(camera, distance, start, zone):
    probe = probe_of(scene_of([target(distance, distance / 2, noise(60))], camera))
    best = probe.drive.coordinate(probe.drive.state_for(distance, zone))
    probe.state = probe.drive.state_at(best + start * probe.drive.depth_of_focus)
    report = phase(probe, zone, "three looks")
    assert miss(probe, report.state, distance, zone) < QUARTER
    assert len(report.probes) <= 3
    assert report.confidence > 0.9
    assert report.focus_distance_m == pytest.approx(distance, rel=0.02)


@pytest.mark.slow
def test_stripes_along_one_axis_are_seen_by_the_other_split():
    rows = {"kind": "checker", "even": 0.9, "odd": 0.1, "scale": [0.01, 75]}
    probe = probe_of(scene_of([target(4.0, 2.0, {"kind": "matte", "reflectance": rows})], DGAUSS))
    report = phase(probe, CENTRE, "stripes")
    assert miss(probe, report.state, 4.0) < QUARTER


@pytest.mark.parametrize(
    ("material", "reason"),
    [
        slow({"kind": "matte", "reflectance": 0.5}, "details do not come to 5 standard errors of the noise"),
        ({"kind": "matte", "reflectance": 0.0}, "dark"),
    ],
    ids=["flat", "dark"],
)
def test_a_target_without_detail_is_refused(material, reason):
    probe = probe_of(scene_of([target(4.0, 4.0, material)], DGAUSS))
    with pytest.raises(NoContrast, match=rf"no contrast in the zone: .*{reason}"):
        phase(probe, CENTRE, reason)


@pytest.mark.slow
def test_a_pattern_that_repeats_within_the_reach_is_refused():
    # Seen out of focus, cells of 3 pixels leave one wave across, which any number of waves displaces alike.
    probe = probe_of(scene_of([target(4.0, 4.0, checker(800))], DGAUSS))
    probe.state = probe.drive.state_for(4.0, CENTRE) + 20 * probe.drive.depth_of_focus
    with pytest.raises(NoContrast, match="repeats itself"):
        phase(probe, CENTRE, "repeats")


@pytest.mark.slow
def test_probes_of_halves_differ_in_noise():
    # With the same random numbers the halves' noise would be correlated, which shifts the match (measured: a pixel).
    # Of light that is even nothing is noise.
    lamp = target(-1.0, 0.5, {"kind": "emissive", "radiance": 50})
    probe = probe_of(scene_of([target(4.0, 4.0, {"kind": "matte", "reflectance": 0.5}), lamp], DGAUSS))
    view = half_view(probe, probe.state, CENTRE, "x")
    through = half_probe(probe, view, probe.state, CENTRE, 16, seed_of("noise"))["limited"]
    one, other = (picture - picture.mean() for picture in through.halves.pictures)
    correlation = (one * other).mean() / np.sqrt((one**2).mean() * (other**2).mean())
    assert abs(correlation) < 3.89 / np.sqrt(one.size)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("method", ["phase", slow("contrast")])
def test_zone_of_a_pixel_is_refused_in_a_sentence(method):
    scene = scene_of([target(2.0, 2.0, noise(400))], lens_camera("dgauss-50mm"))
    with pytest.raises(NoContrast, match="standard errors of the noise"):
        rptcam_cl.autofocus(scene, method, zones=[(0.5, 0.5005, 0.5, 0.5005)])


def test_sharpest_planes_are_where_the_spread_is_least_across_down_and_of_both():
    generator = np.random.default_rng(4)
    weights = np.concatenate([generator.uniform(0.1, 1, 40), np.zeros(5)])
    at, along = generator.normal(size=(2, 40, 2))
    lit = weights[:40]

    def spread(vergence, axes):
        return float(lit @ np.sum((at + vergence * along)[:, axes] ** 2, axis=1))

    own = SimpleNamespace(_lines=(at, along, None, None), _weights=lit)
    found = [*HalfView.sharpest_along(own), HalfView.sharpest(own)]
    assert len({round(vergence, 6) for vergence in found}) == 3
    for vergence, axes in zip(found, ([0], [1], [0, 1]), strict=True):
        least = minimize_scalar(spread, args=(axes,), tol=1e-12).x
        assert vergence == pytest.approx(least, abs=1e-6)


def in_zone(whole, variance, axis=0):
    shares = np.array([0.25 * whole, 0.75 * whole])
    halves = SimpleNamespace(in_zone=shares, noise=np.array([0.4, 0.6]) * variance)
    return SimpleNamespace(halves=halves, view=SimpleNamespace(axis=axis))


def test_contrast_of_a_zone_is_its_deviation_over_its_mean_less_noise():
    wave = np.sin(2 * np.pi * 8 * (np.arange(64) + 0.5) / 64)
    stripes = np.tile(2.0 + 0.5 * wave, (64, 1))
    contrast, significance = PhaseMatch.contrast(in_zone(stripes, 0.025))
    assert contrast == pytest.approx(math.sqrt(0.5**2 / 2 - 0.025) / 2.0, rel=0.01)  # a trend takes a little
    assert significance == pytest.approx((0.5**2 / 2 / 0.025 - 1) * math.sqrt(64 * 64 / 2), rel=0.02)
    for whole, variance in ((np.zeros((8, 8)), 0.1), (-stripes, 0.1), (stripes, 0.0)):  # dark, or without an error
        assert PhaseMatch.contrast(in_zone(whole, variance)) == (0.0, 0.0)
    assert PhaseMatch.contrast(in_zone(stripes, 0.25))[1] > 5.0  # less than noise by pixels, more by means of some
    assert PhaseMatch.contrast(in_zone(stripes, 4.0))[0] == 0.0  # less than noise


def test_share_of_changes_along_the_split_is_that_of_stripes_across_it():
    stripes = np.tile(2.0 + np.sin(2 * np.pi * 8 * np.arange(64) / 64), (64, 1))
    assert [PhaseMatch.along(in_zone(stripes, 0.0, axis)) for axis in (0, 1)] == pytest.approx([1, 0])
    assert [PhaseMatch.along(in_zone(stripes.T, 0.0, axis)) for axis in (0, 1)] == pytest.approx([0, 1])
    assert PhaseMatch.along(in_zone(stripes + stripes.T, 0.0)) == pytest.approx(0.5)
    assert PhaseMatch.along(in_zone(np.full((64, 64), 2.0), 0.1)) == 0.5  # nothing but noise
