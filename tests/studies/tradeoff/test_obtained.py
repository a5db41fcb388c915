"""The check of advice: errors are found in spite of the references' noise, and wrong advice is told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.advice import CASES, Case, check, faults
from benchmarks.obtained import EDGE, Obtained, Reference
from rptcam_cl.device.session import open_session
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.tradeoff import Advice
from rptcam_cl.studies.tradeoff_runs import measure_tradeoff

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
