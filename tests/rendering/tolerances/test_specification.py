"""Specifications of tolerances: what they say, and errors with file, line and key."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.tolerance_run import draw_values
from rptcam_cl.rendering.tolerances import Limit, components, limits, specification
from rptcam_cl.scene.lens_settings import GRADES, Merit, Tolerance, Tolerances

TRIPLET = load_lens("cooke-triplet-50mm")


def limits_of(*tolerances: dict[str, Any], lens: Any = TRIPLET, **others: Any) -> list[Limit]:
    return limits(lens, specification({"tolerances": list(tolerances), **others}))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("radius: 0.2", r"tol.yaml:2:5: tolerances\[0\].radius: unknown key; did you mean radius_mm"),
        ("radius_percent: -1", r"tol.yaml:2:21: tolerances\[0\].radius_percent: is out of range \(got -1; allowed"),
        ("radius_percent: 0.1 %", r"tol.yaml:2:21: tolerances\[0\].radius_percent: is text, not a number"),
        ("surfaces: [1]", r"tol.yaml:2:5: tolerances\[0\]: needs one of radius_percent \| radius_mm"),
        ("index: 0.001\n    radius_mm: 1", r"tolerances\[0\].index: cannot be given together with radius_mm"),
        ("index: 0.001\n    surfaces: [1]", r"tol.yaml:3:15: tolerances\[0\].surfaces: does not go with index"),
        ("index: 0.001\n    elements: [0, 3]", r"tol.yaml:3:19: .*has no element 3 \(got 3; allowed: 0 to 2\)"),
        ("radius_mm: 1\n    surfaces: [6]", r"tol.yaml:3:16: tolerances\[0\].surfaces\[0\]: the lens has no surface 6"),
        ("spacing_mm: 1\n    surfaces: [0]", r"tolerances\[0\].surfaces\[0\]: no air space is behind it \(got 0\)"),
        ("decentre_mm: 1\n    group: [3, 9]", r"tol.yaml:3:12: tolerances\[0\].group: the lens has no surface 9"),
        ("decentre_mm: 1\n    group: [3, 1]", r"tolerances\[0\].group: begins behind its end"),
        ("index: 0.001\n    of: surface", r"tolerances\[0\].of: says what is decentred or tilted"),
        ("index: 0.001\n    distribution: gaussian", r"tolerances\[0\].distribution: is not a known choice"),
        ("index: 0.001\ncopies: 3", r"tol.yaml:3:9: copies: is out of range \(got 3; allowed: at least 10\)"),
        ("index: 0.001\nmerit: {fields_degrees: [70]}", r"merit.fields_degrees\[0\]: is out of range"),
    ],
)  # fmt: skip
def test_errors_name_file_line_and_key(tmp_path: Path, line: str, message: str) -> None:
    file = tmp_path / "tol.yaml"
    file.write_text(f"tolerances:\n  - {line}\n")
    with pytest.raises(InputError, match=message) as problem:
        limits(TRIPLET, specification(file))
    assert str(problem.value).startswith(str(file))


@pytest.mark.parametrize(("text", "message"), [("[1]", "must be a mapping"), ("{}", "tolerances: is required")])
def test_specification_of_another_form_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "tol.yaml").write_text(text)
    with pytest.raises(InputError, match=message):
        specification(tmp_path / "tol.yaml")


def test_unknown_grade_names_the_grades() -> None:
    with pytest.raises(
        InputError, match=r"no such file and no grade of tolerances .*commercial, precision, high_precision"
    ):
        specification("perfect")


def test_quantities_in_their_units() -> None:
    found = limits_of(
        {"radius_percent": 0.2, "surfaces": [0]},
        {"radius_mm": 0.1, "surfaces": [0]},
        {"radius_fringes": 3, "surfaces": [0]},
        {"thickness_percent": 1, "elements": [0]},
        {"abbe_percent": 0.5, "elements": [1]},
        {"wedge_um": 20, "elements": [1]},
        {"tilt_um": 20, "elements": [1]},
        {"tilt_arcmin": 2, "elements": [1]},
    )
    sizes = {limit.label.partition(" of ")[0]: limit.size for limit in found}
    front, second, third = TRIPLET.surfaces[0], TRIPLET.surfaces[2], TRIPLET.surfaces[3]
    fringe = 632.8e-6 / 2
    bow = front.semi_diameter**2 / 2 * sizes["power ±3 fringes"]  # change of sag of a weak surface
    assert sizes["radius ±0.2 %"] == pytest.approx(0.002)
    assert sizes["radius ±0.1 mm"] == pytest.approx(0.1 / front.radius)
    assert bow == pytest.approx(3 * fringe)
    assert sizes["thickness ±1 %"] == pytest.approx(0.01 * front.thickness)
    assert sizes["Abbe number ±0.5 %"] == pytest.approx(0.005)
    assert sizes["wedge 20 µm"] == pytest.approx(0.02 / (2 * third.semi_diameter))
    assert sizes["tilt 20 µm"] == pytest.approx(0.02 / (2 * second.semi_diameter))
    assert sizes["tilt 2′"] == pytest.approx(np.radians(2 / 60))


def test_nothing_is_off_by_more_than_itself() -> None:
    wide = limits_of({"thickness_mm": 50}, {"spacing_mm": 50}, {"radius_mm": 1e4}, {"radius_percent": 50})
    for limit in wide:
        surface = TRIPLET.surfaces[limit.deviation.first]
        assert limit.size <= (surface.thickness if limit.deviation.kind == "thickness" else 0.5)


def test_default_is_everything_that_has_the_quantity() -> None:
    gauss = load_lens("dgauss-50mm")
    assert components(gauss) == [(0, 1), (2, 3, 4), (6, 7, 8), (9, 10)]
    count = {
        key: len(limits_of({key: 0.01, **more}, lens=gauss))
        for key, more in (("radius_percent", {}), ("spacing_mm", {}), ("thickness_mm", {}), ("decentre_mm", {}))
    }
    assert count == {"radius_percent": 10, "spacing_mm": 4, "thickness_mm": 6, "decentre_mm": 4}
    assert len(limits_of({"decentre_mm": 0.01, "of": "surface"}, lens=gauss)) == 10  # the bare stop bends no light
    assert (
        len(limits_of({"abbe_percent": 1}, {"index": 0.001}, lens=gauss)) == 6
    )  # glass of one index does not disperse


@pytest.mark.parametrize("name", GRADES)
def test_every_grade_suits_a_lens(name: str) -> None:
    assert len(limits(TRIPLET, specification(name))) >= 20


def values(tolerance: dict[str, Any], copies: int = 4000) -> Any:
    return draw_values(limits_of(tolerance), copies, 5)[:, 0]


def test_numbers_have_their_distributions() -> None:
    even = values({"index": 0.001, "elements": [0]})[:, 0] / 0.001
    assert np.abs(even).max() <= 1
    assert np.var(even) == pytest.approx(1 / 3, abs=0.02)  # three standard errors
    ends = values({"index": 0.001, "elements": [0], "distribution": "end_point"})[:, 0] / 0.001
    assert set(ends) == {-1.0, 1.0}
    assert abs(ends.mean()) < 0.05
    bell = values({"index": 0.001, "elements": [0], "distribution": "normal"})[:, 0] / 0.001
    assert np.abs(bell).max() <= 1
    assert np.std(bell) == pytest.approx(0.5 * 0.8796, abs=0.02)  # of a normal distribution cut off at two sigmas
    narrow = values({"index": 0.001, "elements": [0], "distribution": "normal", "sigmas": 4})[:, 0] / 0.001
    assert np.std(narrow) == pytest.approx(0.25, abs=0.01)


def test_pairs_have_their_distributions() -> None:
    even = np.hypot(*values({"decentre_mm": 0.1, "elements": [0]}).T) / 0.1
    assert even.max() <= 1
    assert np.mean(even**2) == pytest.approx(0.5, abs=0.02)  # over the area of a disc
    ends = np.hypot(*values({"decentre_mm": 0.1, "elements": [0], "distribution": "end_point"}).T)
    np.testing.assert_allclose(ends, 0.1)
    bell = values({"decentre_mm": 0.1, "elements": [0], "distribution": "normal"}) / 0.1
    assert np.hypot(*bell.T).max() <= 1
    inside = 1 - np.exp(-2.0)  # Rayleigh's distribution, cut off at two sigmas
    expected = 2 * (1 - 3 * np.exp(-2.0)) / inside / 4  # its mean square in units of the size
    assert np.mean(np.sum(bell**2, axis=1)) == pytest.approx(expected, abs=0.02)
    assert np.abs(bell.mean(axis=0)).max() < 0.03


def test_copies_are_the_same_however_many_and_whatever_follows() -> None:
    few = draw_values(limits_of({"index": 0.001}), 10, 3)
    many = draw_values(limits_of({"index": 0.001}, {"thickness_mm": 0.1}), 50, 3)
    assert np.array_equal(few, many[:10, :3])
    assert not np.array_equal(few, draw_values(limits_of({"index": 0.001}), 10, 4))


def test_example_suits_the_lens_that_it_names(checkout: Path) -> None:
    found = limits(TRIPLET, specification(checkout / "examples" / "tolerances" / "triplet.yml"))
    assert {limit.distribution for limit in found} == {"normal", "end_point"}
    assert found[-1].label == "tilt 2′ of surfaces 4 to 5"


def test_page_has_every_key(checkout: Path) -> None:
    page = (checkout / "docs" / "tolerances.md").read_text("utf-8")
    keys = [*Tolerance.model_fields, *Tolerances.model_fields, *Merit.model_fields, *GRADES]
    assert [key for key in keys if f"`{key}`" not in page and f"`{key}:" not in page] == []
