"""The page of figures: its pictures, scenes and commands, and the numbers beside those of the documents."""

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rptcam_cl
from examples.assignment.make_text import text
from examples.figures.assignment_film_numbers import (
    ESTIMATE,
    IRRADIANCES,
    LIT_FLOORS,
    RADII,
    irradiance_by_radius,
    lit_floor,
)
from examples.figures.figure import ROOT, Figure, shared
from examples.figures.numbers import Numbers, Row, remark
from examples.figures.paper_film_numbers import climb
from examples.figures.render import SECTIONS, drawings, figures, main
from rptcam_cl.cli import build_parser
from tests.support.statistics import assert_equivalent

OWN = [figure for figure in figures() if figure.folder == "figures"]
COMPARISONS = [compare for section in SECTIONS for group in section.groups for compare in group.numbers]
MOST_BYTES = 5_500_000


@pytest.fixture(scope="module")
def page() -> str:
    return (ROOT / "docs" / "gallery.md").read_text("utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("figure", OWN, ids=lambda figure: figure.name)
def test_figure_shows_something(figure: Figure) -> None:
    width, height = figure.size
    pixels = np.asarray(rptcam_cl.render(figure.load(), spp=4, size=(width // 10, height // 10)))
    assert np.isfinite(pixels).all() and pixels.mean() > 0.005 and pixels.std() > 0.01


def test_page_shows_every_figure_and_the_pictures_are_there(page: str) -> None:
    shown = set(re.findall(r"!\[[^]]+\]\(([^)]+)\)", page))
    assert shown == {figure.picture for figure in [*figures(), *drawings()]} and len(shown) > 55
    for drawing in drawings():
        assert (ROOT / "docs" / drawing.picture).read_text("utf-8").count("<path") > 10
    assert sum((ROOT / "docs" / figure.picture).stat().st_size for figure in OWN) < MOST_BYTES
    for figure in OWN:
        with Image.open(ROOT / "docs" / figure.picture) as picture:
            crop = figure.load().film.crop or (0, 1, 0, 1)
            assert abs(picture.width - figure.size[0] * (crop[1] - crop[0])) <= 1
            assert abs(picture.height - figure.size[1] * (crop[3] - crop[2])) <= 1


def test_commands_of_the_page_are_those_of_its_figures(page: str) -> None:
    blocks = re.findall(r"^```sh\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    commands = {line for block in blocks for line in block.replace("\\\n", "").splitlines()}
    made = [*figures(), *(drawing for drawing in drawings() if drawing.words)]
    assert commands == {figure.command().replace("\\\n", "") for figure in made}
    parser = build_parser()
    for line in commands:
        parsed, unknown = parser.parse_known_args(shlex.split(line)[1:])
        assert unknown == [] and ("scene" not in parsed or (ROOT / parsed.scene).is_file())


def test_names_of_the_code_in_the_theory_are_there() -> None:
    text = (ROOT / "docs" / "theory.md").read_text("utf-8")
    for path in re.findall(r"`((?:kernels|rptcam_cl)/[^`]+)`", text):
        assert (ROOT / path).is_file()
    kernels = "".join(path.read_text("utf-8") for path in (ROOT / "kernels").rglob("*.h"))
    for name in ("camera_ray", "film_x", "film_y", "aim", "inverse_density", "cross_surface"):
        assert f"`{name}`" in text and re.search(rf"\b{name}\b", kernels)


@pytest.mark.slow
def test_script_renders_a_wanted_picture_and_the_page(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("examples.figures.render.page", lambda: "# page\n")
    assert main(["--quality", "draft", "--only", "paper_5_15", "--output", str(tmp_path)]) == 0
    made = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert made == {"gallery.md", "images/figures/paper_5_15.jpg"}


@pytest.mark.slow
@pytest.mark.parametrize("compare", COMPARISONS, ids=lambda compare: compare.__name__)
def test_numbers_are_those_of_the_documents_and_of_the_page(compare: Callable[[], Numbers], page: str) -> None:
    numbers = compare()
    assert numbers.misses() == []
    assert numbers.differences(page) == []
    unexplained = [miss for row in numbers.rows for miss in row.misses(more=0.0)]
    assert bool(unexplained) == bool(numbers.reason), unexplained
    below = page.partition("| " + " | ".join(numbers.lines()[0]) + " |\n")[2].partition("\n\n")[2]
    assert below.startswith(remark(numbers.reason) + "\n\n")


def test_every_document_has_its_numbers() -> None:
    assert len(COMPARISONS) >= 30 and len({compare.__name__ for compare in COMPARISONS}) == len(COMPARISONS)


@pytest.mark.parametrize(
    ("expected", "ours", "misses"),
    [
        ("1.20", 1.2049, False),
        ("1.20", 1.2061, True),
        ("100", 100.4, False),
        ("100", 101.0, True),
        ("1.20", float("nan"), True),
        ("virtual", "virtual", False),
        ("virtual", 3.0, True),
        ("1.20", "virtual", True),
    ],
)
def test_a_number_is_met_to_half_a_unit_of_its_last_digit(expected: str, ours: float | str, misses: bool) -> None:
    assert bool(list(Row(("x",), (expected,), (ours,)).misses())) == misses


def test_errors_of_a_row_add_to_its_digits() -> None:
    row = Row(("x",), ("100", "100"), (102.4, 102.6), error=0.01, more=1.0)
    assert [text.split()[-1] for text in row.misses()] == ["102.6"]
    assert len(list(row.misses(more=0.0))) == 2


def test_a_page_with_another_number_differs() -> None:
    numbers = Numbers(("lens",), ("f", "d"), [Row(("a",), ("1.0", "2.0"), (1.01, 2.02))])
    page = f"text\n\n{numbers.markdown()}\n\nmore\n"
    assert numbers.differences(page) == []
    assert len(numbers.differences(page.replace("2.02", "2.05"))) == 1
    assert len(numbers.differences(page.replace("| f |", "| g |"))) == 1


def test_script_refuses_a_part_of_no_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--only", "paper_6"]) == 2
    assert "no picture has a name with 'paper_6' in it" in capsys.readouterr().err


@pytest.mark.slow
def test_an_interrupted_run_keeps_its_pictures_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("examples.figures.render.page", lambda: "# page\n")
    given = ["--quality", "draft", "--only", "paper_2_d002", "paper_2_d005", "--output", str(tmp_path)]
    pictures = tmp_path / "images" / "figures"
    render, done = rptcam_cl.render, list[int]()

    def interrupted(*arguments: Any, **options: Any) -> Any:
        if done:
            raise KeyboardInterrupt
        done.append(1)
        return render(*arguments, **options)

    monkeypatch.setattr(rptcam_cl, "render", interrupted)
    assert main(given) == 130 and "--resume" in capsys.readouterr().err
    assert [path.name for path in pictures.iterdir()] == ["paper_2_d002.jpg"]
    monkeypatch.setattr(rptcam_cl, "render", render)
    assert main([*given, "--resume"]) == 0
    assert "[1/2] paper_2_d002: is there" in capsys.readouterr().out
    assert {path.name for path in pictures.iterdir()} == {"paper_2_d002.jpg", "paper_2_d005.jpg"}
    assert main([*given[:3], "paper_2_d002", *given[5:], "--quality", "draft", "--resume"]) == 0
    assert "is there" in capsys.readouterr().out


@pytest.mark.slow
def test_half_the_telephotos_stop_costs_two_stops_less_the_front_rim() -> None:
    cases = [("telephoto-250mm", 123.7439, 40.5), ("telephoto-250mm", 123.7439, 20.25)]
    (full, full_error), (half, half_error) = (irradiance_by_radius(*case, spp=4096) for case in cases)
    # Four times the error of the expected values, of which the second are an estimate from few rays.
    for ours, error, case in ((full, full_error, cases[0]), (half, half_error, cases[1])):
        assert_equivalent(ours, error, np.array(IRRADIANCES[case], float), 4 * ESTIMATE * ours)
    ratio = full / half
    assert (ratio[: RADII.index(25)] < 3.9).all() and ratio[0] > 3.7


@pytest.mark.slow
def test_middle_of_the_picture_is_as_bright_as_the_reference() -> None:
    lamp, predicted, reference = LIT_FLOORS["cones_dgauss"]
    found = lit_floor("cones_dgauss", lamp, 256)
    assert found == pytest.approx(float(reference), rel=0.015) and found < float(predicted)
    assert lit_floor("cones_dgauss", lamp, 64, changes=()) < 0.8 * float(reference)  # walls keep light off


def test_a_climb_ends_at_the_first_top() -> None:
    values = np.array([1.0, 3, 2, 4, 5, 4])
    assert climb(values, 0) == [0, 1] and climb(values, 1) == [1]
    assert climb(values, 5) == [5, 4] and climb(values, 2) == [2, 3, 4]


def test_text_of_the_cones_is_what_its_script_draws() -> None:
    with Image.open(ROOT / "examples" / "assignment" / "text.png") as picture:
        kept = np.asarray(picture.convert("L"), float)
    assert np.abs(kept - np.asarray(text().convert("L"), float)).mean() < 2  # fonts are drawn a little differently


@pytest.mark.slow
def test_text_is_readable_through_the_telephoto_alone() -> None:
    """Contrast of the letters: share of the black and white of the text that is left in the picture of it."""
    assert contrast_of_text("cones_telephoto", (0.66, 0.86, 0.36, 0.5)) > 0.75
    assert contrast_of_text("cones_dgauss", (0.52, 0.6, 0.44, 0.5)) < 0.5


def contrast_of_text(name: str, crop: tuple[float, ...]) -> float:
    """Return how far the darkest twentieth and the median of a part of a picture lie apart, relative to their sum."""
    figure = shared(name, "")
    there = replace(figure, changes=[*figure.changes, f"film.crop={list(crop)}"])
    pixels = np.asarray(rptcam_cl.render(there.load(), spp=64), float)[..., 1]
    dark, light = np.percentile(pixels, (3, 60))
    return float((light - dark) / (light + dark))
