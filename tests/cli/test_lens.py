import json
from collections.abc import Callable
from typing import Any

import pytest

from tests.support.cases import slow

Command = Callable[..., Any]

KEYS = {
    "focal_length_mm", "back_focal_distance_mm", "front_focal_distance_mm", "principal_planes_mm", "entrance_pupil",
    "exit_pupil", "f_number", "working_f_number", "film_distance_mm", "image_circle_mm", "surfaces",
}  # fmt: skip


KNOWN: dict[tuple[str, ...], dict[str, Any]] = {}  # what the command has said to words


def info(rptcam: Command, *words: str) -> dict[str, Any]:
    if words not in KNOWN:
        run = rptcam("lens", "info", "dgauss-50mm", "--json", *words)
        assert run.code == 0, run.err
        KNOWN[words] = json.loads(run.out)
    return KNOWN[words]


def test_facts_of_the_double_gauss_are_those_of_two_other_programs(rptcam: Command) -> None:
    facts = info(rptcam)
    assert facts.keys() >= KEYS
    # ray-optics 0.9.8 and optiland 0.6.3 agree on these to ten digits
    assert facts["focal_length_mm"] == pytest.approx(50.35816695831366, rel=1e-9)
    assert facts["back_focal_distance_mm"] == pytest.approx(36.10590523854216, rel=1e-9)
    assert facts["front_focal_distance_mm"] == pytest.approx(-27.122445621138628, rel=1e-9)
    assert facts["principal_planes_mm"]["front"] == pytest.approx(23.235721337175033, rel=1e-9)
    assert facts["principal_planes_mm"]["rear"] == pytest.approx(17.787738280228496 - 32.04, rel=1e-9)
    assert facts["entrance_pupil"]["distance_mm"] == pytest.approx(19.946482648785047, rel=1e-9)
    assert facts["entrance_pupil"]["diameter_mm"] == pytest.approx(24.805104353981605, rel=1e-9)
    assert facts["exit_pupil"]["distance_mm"] == pytest.approx(14.268643260987767 - 32.04, rel=1e-9)
    assert facts["exit_pupil"]["diameter_mm"] == pytest.approx(26.538517709874856, rel=1e-9)
    assert facts["f_number"] == pytest.approx(2.03015340067418, rel=1e-9)
    assert facts["surfaces"] == 11


def test_at_infinity_the_film_is_at_the_focal_point(rptcam: Command) -> None:
    facts = info(rptcam)
    assert facts["film_distance_mm"] == pytest.approx(facts["back_focal_distance_mm"], rel=1e-12)
    assert facts["working_f_number"] == pytest.approx(facts["f_number"], rel=1e-9)


def test_stopping_down_changes_the_pupils_and_not_the_focal_length(rptcam: Command) -> None:
    wide, closed = info(rptcam), info(rptcam, "--f-number", "8")
    assert closed["f_number"] == pytest.approx(8, rel=1e-9)
    assert closed["focal_length_mm"] == wide["focal_length_mm"]
    assert closed["entrance_pupil"]["diameter_mm"] == pytest.approx(wide["focal_length_mm"] / 8, rel=1e-9)


def test_focusing_near_moves_the_film_away_and_darkens(rptcam: Command) -> None:
    facts = info(rptcam, "--focus-distance-m", "0.5")
    f, n = facts["focal_length_mm"], facts["f_number"]
    extension = facts["film_distance_mm"] - facts["back_focal_distance_mm"]
    # N_w = N (1 + |m| / P): m = extension / f, P = exit pupil / entrance pupil
    pupils = facts["exit_pupil"]["diameter_mm"] / facts["entrance_pupil"]["diameter_mm"]
    assert extension > 0
    assert facts["working_f_number"] == pytest.approx(n * (1 + extension / f / pupils), rel=1e-9)


def test_wavelength_is_part_of_the_facts(rptcam: Command) -> None:
    assert info(rptcam, "--wavelength-nm", "486.1")["wavelength_nm"] == 486.1


@pytest.mark.parametrize(
    ("words", "focal_length"), [slow(["--zoom", "194 mm"], 194), slow(["--focal-length-mm", "100"], 100)]
)
def test_zoom_is_part_of_the_facts(rptcam: Command, words: list[str], focal_length: float) -> None:
    run = rptcam("lens", "info", "zoom-70-200mm", "--json", *words)
    assert json.loads(run.out)["focal_length_mm"] == pytest.approx(focal_length, rel=2e-3)


def test_facts_for_people_carry_their_units(rptcam: Command) -> None:
    run = rptcam("lens", "info", "dgauss-50mm")
    assert run.code == 0
    lines = run.out.splitlines()
    assert lines[0] == "name                            Double Gauss 50 mm f/2"
    for line in (
        "wavelength [nm]                 587.562",
        "focal length [mm]               50.3582",
        "principal planes [mm]",
        "  rear                          -14.2523",
        "entrance pupil",
        "  distance [mm]                 19.9465",
        "f number                        2.03015",
        "surfaces                        11",
        "axial transmittance             1",
        "field of view [degrees]         59.6346",
    ):
        assert line in lines
    assert "_" not in "".join(line[:32] for line in lines) and "warnings" not in run.out


def test_facts_that_a_lens_does_not_have_are_a_dash(rptcam: Command) -> None:
    lines = rptcam("lens", "info", "biconcave").out.splitlines()
    assert "film distance [mm]              -" in lines
    assert "image circle [mm]               -" in lines


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["no_such_lens"], "no_such_lens"),
        (["dgaus-50mm"], "did you mean"),
        (["dgauss-50mm", "--f-number", "0.5"], "opens to f/2.03"),
        (["dgauss-50mm", "--focus-distance-m", "0.05"], "nearest"),
    ],
)
def test_what_the_lens_cannot_do_is_said(rptcam: Command, words: list[str], message: str) -> None:
    run = rptcam("lens", "info", *words)
    assert run.code == 2
    assert run.out == ""
    assert message in run.err
