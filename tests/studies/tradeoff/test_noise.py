"""How noise falls: sums of even blocks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.advice import CASES, Case, check, faults
from benchmarks.obtained import EDGE, Obtained, Reference
from rptcam_cl.device.session import open_session
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.tiers import choose_camera
from rptcam_cl.studies.tradeoff import Advice
from rptcam_cl.studies.tradeoff_errors import AS_IT_IS, NoiseLaw, noise_law
from rptcam_cl.studies.tradeoff_runs import ladder, mark, measure_tradeoff, most_accurate
from tests.support.cases import slow


def law(exponent):
    return NoiseLaw((8.0, 128.0), (1.0, 16.0**exponent), exponent, exponent)


@pytest.mark.parametrize("samples", [1, 8, 77, 128, 1000, 4096, 0.25])
def test_independent_samples_have_no_blocks(samples):
    assert law(-1.0).after(samples) == pytest.approx(8 / samples)


def test_other_numbers_than_powers_of_two_are_noisier():
    even = law(-1.5)
    assert even.after(256) == pytest.approx(32**-1.5)
    expected = sum(block**2 * (block / 8) ** -1.5 for block in (128, 64, 16, 4)) / 212**2
    assert even.blocks(212) == pytest.approx(expected)
    assert expected > 1.3 * even.even(212)
    assert even.after(212) == pytest.approx((expected * even.even(212)) ** 0.5)
    assert even.least(212) < even.even(212) < even.after(212) < expected < even.most(212)


@pytest.mark.parametrize("exponent", [-1.0, -1.3, -1.7])
@pytest.mark.parametrize("noise", [30.0, 0.5, 0.01, 1e-5])
def test_samples_to_a_noise_are_enough_and_not_too_many(exponent, noise):
    falls = law(exponent)
    samples = float(falls.until(noise))
    assert falls.after(samples) <= noise * 1.0001
    assert falls.after(0.999 * samples) > noise


def test_laws_of_replicates_are_those_of_each():
    noise = np.array([1.0, 2.0, 0.5])
    many = noise_law((2, 8, 128), noise, np.array([[1.0, 2.0], [0.03, 0.03]]), np.array([-1.2, -1.3, -1.1]))
    targets = np.array([1e-3, 3.0, 0.05])
    for k in range(3):
        one = NoiseLaw(many.samples, (many.noise[0][k], many.noise[1][k]), many.before[k], many.beyond[k])
        assert many.until(targets)[k] == pytest.approx(float(one.until(targets[k])))
        assert many.after(212.0)[k] == pytest.approx(float(one.after(212.0)))
    assert many.noise[1][0] == pytest.approx(0.02)
    assert many.beyond[0] == pytest.approx((np.log(0.02) / np.log(16) - 1) / 2)


def test_no_noise_takes_no_samples():
    none = NoiseLaw((8.0, 128.0), (0.0, 0.0), -1.0, -1.0)
    assert none.after(5.0) == 0 and none.until(1e-4) == 0


EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
SCENES = [
    slow("sunny_sixteen.yaml", []),
    ("still_life.yaml", ["render.sampler=independent", "render.clamp=10"]),
    slow("paper/figure_4.yaml", ["camera.pupil=thick", "camera.accuracy=auto"]),
]


def picture(scene):
    """What two scenes of the same picture have in common."""
    scene = choose_camera(scene).scene
    return mark(make_plan(scene), scene.render), scene.render.clamp, scene.render.sampler


@pytest.mark.parametrize(("name", "overrides"), SCENES)
def test_scene_that_is_set_so_is_the_one_that_was_measured(name, overrides):
    found = ladder(load_scene(EXAMPLES / name, overrides))[0]
    measured = {each.name: picture(each.scene) for each in found}
    assert len(found) > 5 and len(set(measured.values())) > 2  # the comparison can tell
    for configuration in found:
        asked = load_scene(EXAMPLES / name, [*overrides, *configuration.settings])
        assert picture(asked) == measured[configuration.name], configuration.name
        if configuration.name == AS_IT_IS:
            assert configuration.settings == ()


@pytest.mark.parametrize(("render", "photons"), [({"layers": ["lights"]}, 0), ({}, 1), ({"caustics": "off"}, 0)])
def test_photons_are_measured_where_the_scene_has_them(render, photons):
    """The layer `lights` leaves caustics to paths; pictures are compared without layers, and had them by photons."""
    glass = {"shape": "sphere", "center": [0, 0.5, 0], "radius": 0.4, "material": {"kind": "dielectric", "index": 1.5}}
    floor = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 1, 0]}
    floor["material"] = {"kind": "matte", "reflectance": 0.5}
    lamp = {"kind": "point", "position": [1, 2, 1], "intensity": 9}
    camera = {"kind": "pinhole", "eye": [0, 1, 4], "target": [0, 0, 0], "fov_degrees": 40}
    scene = load_scene({"camera": camera, "objects": [glass, floor], "lights": [lamp], "render": render})
    by_name = {each.name: make_plan(each.scene).facts["CAUSTICS"] for each in ladder(scene)[0]}
    assert by_name.pop("caustics: off", 0) == 0
    assert set(by_name.values()) == {make_plan(scene).facts["CAUSTICS"]} == {photons}
    assert ("caustics: off" in {each.name for each in ladder(scene)[0]}) == bool(photons)


def test_same_way_is_asked_for_by_what_is_shorter():
    scene = load_scene(EXAMPLES / "sunny_sixteen.yaml")
    by_name = {each.name: each for each in ladder(scene)[0]}
    both = by_name["spectrum: rgb"].with_name_of(by_name[AS_IT_IS])
    assert by_name["spectrum: rgb"].settings and both.settings == ()
    assert both.same_as == (AS_IT_IS,)
    assert by_name["thick lens"].settings == ("camera.kind=thick_lens", "spectrum.lens=on")


@pytest.mark.parametrize(("camera", "names"), [
    ({"kind": "thin_lens", "fov_degrees": 40, "f_number": 4, "focus_distance_m": 3}, {"pinhole"}),
    ({"kind": "realistic", "lens": "achromat-100mm", "focus": {"distance_m": 3}}, {"lens: float64", "pupil: rear"}),
])  # fmt: skip
def test_configurations_of_a_view_camera_keep_the_film_where_it_is(camera, names):
    moved = camera | {"eye": [0, 0, 3], "target": [0, 0, 0], "movements": {"rise_mm": 5}}
    found, _, decision = ladder(load_scene({"camera": moved, "environment": {"kind": "constant", "radiance": 1}}))
    assert names < {each.name for each in found} and decision is None
    assert {each.scene.camera.film_movements.rise_mm for each in found} == {5.0}


def test_full_traces_every_surface_whatever_the_scene_leaves_out():
    cheap = [
        "camera.rays=fitted",
        "camera.pupil=rear",
        "camera.accuracy=auto",
        "render.clamp=3",
        "render.sampler=independent",
    ]
    full = most_accurate(load_scene(EXAMPLES / "sunny_sixteen.yaml", cheap)).scene
    assert (full.camera.rays, full.camera.pupil, full.camera.accuracy) == ("traced", "auto", None)
    assert (full.render.clamp, full.render.sampler) == (None, "lattice")


SHAPE = (30, 44, 3)  # tiles at two edges are not whole
BIAS, NOISE = 0.05, 0.1  # of the picture, and its standard deviation
PROMISE = Advice("time", 2.0, "quick", 2.0, 0.03, 100, 0.027, 0.032, 2.0, 0.05, None)


def pictures(rng, count, bias, noise):
    return [1 + bias + noise * rng.standard_normal(SHAPE) for _ in range(count)]


def test_error_is_found_through_references_as_noisy_as_the_picture():
    rng = np.random.default_rng(0)
    truth = (BIAS**2 + NOISE**2) / (1 + EDGE**2)
    trials = [Reference(pictures(rng, 4, 0, NOISE)).of(pictures(rng, 4, BIAS, NOISE), 1.0) for _ in range(200)]
    values = np.array([trial.relmse for trial in trials])
    assert values.mean() == pytest.approx(truth, abs=4 * values.std() / 200**0.5)
    told = np.mean([trial.uncertainty for trial in trials])
    assert told == pytest.approx(values.std(), rel=0.3)
    first = pictures(rng, 1, 0, NOISE)
    once = Reference([first[0], first[0]]).relmse(pictures(rng, 1, BIAS, NOISE)[0])  # a control: with itself
    assert once.mean() > 1.5 * truth


def came(error, seconds=2.0, uncertainty=1e-5):
    return Obtained(seconds, error**2, uncertainty)


@pytest.mark.parametrize(
    ("obtained", "full", "said"),
    [
        (came(0.03), came(0.05), ()),
        (came(0.03), None, ()),
        (came(0.036), came(0.05), ("errs by more",)),
        (came(0.02), came(0.05), ("errs by less",)),
        (came(0.033, uncertainty=5e-5), came(0.05), ()),
        (came(0.03, uncertainty=3e-4), came(0.05), ("unsure",)),
        (came(0.03, seconds=2.6), came(0.05), ("time is off",)),
        (came(0.03, seconds=1.4), came(0.05), ("time is off",)),
        (came(0.03), came(0.027), ("full is better",)),
        (came(0.03), came(0.0297), ()),
    ],
)
def test_what_is_wrong_with_an_advice_is_told(obtained, full, said):
    assert faults(PROMISE, 2.0, obtained, full) == said


def test_every_case_can_be_loaded():
    names = [case.name for case in CASES]
    assert len(set(names)) == 5
    for case in CASES:
        assert load_scene(case.path, case.overrides).objects


@pytest.mark.slow
def test_advice_holds_and_a_spoiled_one_is_found_wrong():
    case = Case(
        "landscape", Path(__file__).resolve().parents[3] / "examples" / "sunny_sixteen.yaml", (96, 54), 1.0, 0.05
    )
    session = open_session(None)
    scene = load_scene(case.path)
    report = measure_tradeoff(scene, budget=20, seconds=case.seconds, error=case.error, size=case.size, device=session)
    wrong = {fault for verdict in check(case, report, session, 6.0) for fault in verdict.faults}
    assert not wrong - {"time is off"}, wrong  # other work on the machine may disturb even CPU times

    quick = report.advice[0]
    spoiled = (
        replace(quick, least_error=quick.least_error / 3, most_error=quick.most_error / 3),
        replace(quick, samples=quick.samples // 9),
        replace(quick, chosen="thin lens"),
    )
    for verdict in check(case, replace(report, advice=spoiled), session, 6.0):
        assert "errs by more" in verdict.faults, verdict
