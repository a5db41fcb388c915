"""Zoom positions, interpolated gaps, focusing groups and their reach."""

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import lens as variable
from rptcam_cl.optics.irradiance import lens_info
from rptcam_cl.optics.lens import (
    film_distance,
    focused_by_group,
    in_configuration,
    move_group,
    object_distance,
    zoom_to,
)
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.spots import setting

ZOOMS = {"zoom-80-200mm": [80, 200], "zoom-70-200mm": [72.1, 135, 194], "zoom-35-51mm": [35, 51]}


@pytest.mark.parametrize("name", ZOOMS)
def test_published_focal_length_of_every_configuration(name):
    lens = load_lens(name)
    assert len(lens.configurations) == len(ZOOMS[name])
    for configuration, expected in zip(lens.configurations, ZOOMS[name], strict=True):
        data = in_configuration(lens, configuration.name).first_order()
        assert data.focal_length_mm == pytest.approx(expected, rel=2e-3)
    assert in_configuration(lens, lens.configurations[0].name).surfaces == lens.surfaces


def test_the_image_of_a_compensated_zoom_stays():
    lens = load_lens("zoom-70-200mm")
    planes = [
        state.length + state.first_order().back_focal_distance_mm
        for state in (in_configuration(lens, configuration.name) for configuration in lens.configurations)
    ]
    assert max(planes) - min(planes) < 0.05


@pytest.mark.parametrize("name", ZOOMS)
def test_zooming_to_a_focal_length_between(name):
    lens = load_lens(name)
    for share in (0.0, 0.3, 0.8, 1.0):
        first, last = (
            in_configuration(lens, lens.configurations[i].name).first_order().focal_length_mm for i in (0, -1)
        )
        wanted = first + share * (last - first)
        assert zoom_to(lens, wanted).first_order().focal_length_mm == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("name", ZOOMS)
def test_a_zoom_lens_is_examined_once_for_all_focal_lengths(name, monkeypatch):
    lens = load_lens(name)
    low, high = variable.zoom_range_mm(lens)
    assert zoom_to(lens, low).first_order().focal_length_mm == pytest.approx(low, rel=1e-9)
    counted = []
    whole = variable.focal_length_mm
    monkeypatch.setattr(variable, "focal_length_mm", lambda *args: counted.append(args) or whole(*args))
    zoom_to(load_lens(name), low + 0.4321 * (high - low))
    assert 40 < len(counted) < 56  # those of the search alone, which halves a 64th as often as numbers tell it apart


def test_outside_the_range_is_refused_with_the_range():
    with pytest.raises(InputError, match=r"zooms from 72\.1\d* to 193\.\d+ mm \(requested 300 mm\)"):
        zoom_to(load_lens("zoom-70-200mm"), 300)
    with pytest.raises(InputError, match="is not a zoom lens"):
        zoom_to(load_lens("dgauss-50mm"), 60)
    with pytest.raises(InputError, match=r"no configuration 'tele'; it has 72 mm, 135 mm, 194 mm"):
        in_configuration(load_lens("zoom-70-200mm"), "tele")


def telephoto_with_group(travel=(-8.0, 10.0)):
    # The rear group of the 250 mm telephoto, behind its stop, moves.
    from pathlib import Path

    from rptcam_cl.core.files import lenses_dir

    text = Path(lenses_dir() / "telephoto-250mm.yaml").read_text()
    return text + f"focusing: {{surfaces: [4, 6], travel: [{travel[0]}, {travel[1]}]}}\n"


def loaded(tmp_path, text):
    path = tmp_path / "lens.yaml"
    path.write_text(text)
    return load_lens(path)


def test_a_group_focuses_while_the_film_stays(tmp_path):
    lens = loaded(tmp_path, telephoto_with_group())
    film = film_distance(lens, float("inf"))
    for distance in (4000.0, 8000.0, 50000.0):
        state, back = focused_by_group(lens, distance, film)
        assert film_distance(state, distance) == pytest.approx(back, abs=1e-6)
        assert state.length + back == pytest.approx(lens.length + film)
    assert move_group(lens, 0.0).surfaces == lens.surfaces


def test_lens_tools_move_the_group(tmp_path):
    lens = loaded(tmp_path, telephoto_with_group())
    use = setting(lens, focus_distance_m=8.0)
    assert use.lens.length + use.film == pytest.approx(lens.length + film_distance(lens, float("inf")))
    assert object_distance(use.lens, use.film) == pytest.approx(8000)
    assert lens_info(lens, object_distance_mm=8000.0)["film_distance_mm"] == pytest.approx(use.film)


def test_the_reach_of_a_group_is_known(tmp_path):
    lens = loaded(tmp_path, telephoto_with_group((0.0, 1.0)))
    film = film_distance(lens, float("inf"))
    with pytest.raises(
        InputError, match=r"its group focuses from \d+\.?\d* to inf mm from the film \(requested 1000 mm\)"
    ):
        focused_by_group(lens, 1000.0, film)
    with pytest.raises(InputError, match="has no focusing group"):
        focused_by_group(load_lens("dgauss-50mm"), 1000.0, 36.0)


BAD = [
    ("focusing: {surfaces: [4, 6]}\n", r"focusing\.travel: expected a list of numbers"),
    ("focusing: {surfaces: [0, 6], travel: [0, 1]}\n", r"focusing\.surfaces: the group is the whole lens"),
    (
        "focusing: {surfaces: [4, 9], travel: [0, 1]}\n",
        r"focusing\.surfaces: expected \[first, last\], two numbers from 0 to 6",
    ),
    ("focusing: {surfaces: [4, 6], travel: [1, 1]}\n", r"focusing\.travel: expected \[least, greatest\]"),
    (
        "configurations: [{name: a, gaps: {9: 1}}]\n",
        r"configurations\[0\]\.gaps\[9\]: a gap lies behind a surface from 0 to 5",
    ),
    ("configurations: [{name: a, gaps: {2: -1}}]\n", r"configurations\[0\]\.gaps\[2\]: must not be negative"),
    ("configurations: [{name: a}]\n", r"configurations\[0\]: needs gaps"),
    ("configurations: [{name: a, gaps: {2: 1}}, {name: a, gaps: {2: 1}}]\n", "two configurations have the same name"),
    (
        "configurations: [{name: a, gaps: {2: 1}}, {name: b, gaps: {1: 1}}]\n",
        "every configuration must give the same gaps",
    ),
]


@pytest.mark.parametrize(("extra", "message"), BAD, ids=[message[:40] for _, message in BAD])
def test_bad_variable_parts_are_refused(tmp_path, extra, message):
    text = telephoto_with_group().split("focusing:")[0] + extra
    with pytest.raises(InputError, match=message):
        loaded(tmp_path, text)


def test_the_macro_lens_is_half_life_size_at_a_quarter_of_a_metre():
    lens = in_configuration(load_lens("macro-55mm"), "1:2")
    data = lens.first_order()
    film = data.back_focal_distance_mm + data.focal_length_mm / 2
    assert object_distance(lens, film) == pytest.approx(250.0, abs=0.05)
