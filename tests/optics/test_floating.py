"""Lenses whose groups float: close-focus columns of an Optical Bench file set their gaps by the distance."""

import json
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.optics.files.export import lens_text
from rptcam_cl.optics.lens import film_distance, float_groups, in_configuration, object_distance, zoom_range_mm, zoom_to
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.cameras.setting import focused, lens_setting
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.focus.drives import focus_drive
from tests.support.cases import one_in, slow

# A lens of our own: for the close focus two gaps change by 2 and 1 mm, and the film is 6 mm farther.
BENCH = """\
[descriptive data]
title\tfloating
[constants]
[variable distances]
Focal Length\t50.0\tundefined
F-Number\t4\tundefined
Magnification\t0\t-0.15
d0\tInfinity\t350.0
d2\t8.0\t6.0
d5\t4.0\t5.0
Bf\t40.0\t46.0
[lens data]
1\t40\t4\t1.6\t20\t55
2\t-90\td2\t\t20
3\t-60\t2\t1.7\t18\t30
4\t200\t1\t\t18
5\tAS\td5\t\t12
6\t80\t3\t1.6\t18\t55
7\t-70\tBf\t\t18
[aspherical data]
"""
NEAR_MM = 350 + 4 + 6 + 2 + 1 + 5 + 3 + 46.0


def bench(tmp_path, text=BENCH):
    path = tmp_path / "floating.txt"
    path.write_text(text)
    return load_lens(path)


def test_close_focus_columns_are_focus_and_not_zoom(tmp_path):
    lens = bench(tmp_path)
    assert lens.configurations == ()
    (state,) = lens.floating
    assert state.distance_mm == pytest.approx(NEAR_MM)
    assert state.gaps == ((1, 6.0), (4, 5.0))
    assert [lens.surfaces[k].thickness for k in (1, 4)] == [8, 4]


def test_film_stands_behind_a_cover_glass_whatever_the_back_focus_without_it(tmp_path):
    covered = BENCH.replace("7\t-70\tBf\t\t18\n", "7\t-70\td7\t\t18\n8\tCG\t1.5\t1.5168\t18\t64.2\n9\tCG\t1.0\t\t18\n")
    covered = covered.replace(
        "Bf\t40.0\t46.0", "d7\t37.5\t43.5\t+6.0\nBf\t40.0\t46.0"
    )  # a third column has differences
    lens = bench(tmp_path, covered)
    assert lens.configurations == ()
    (state,) = lens.floating
    assert state.distance_mm == pytest.approx(NEAR_MM - 46.0 + 43.5 + 1.5 + 1.0)
    assert state.gaps == ((1, 6.0), (4, 5.0), (6, 43.5))


def test_gaps_go_by_the_inverse_of_the_distance(tmp_path):
    lens = bench(tmp_path)
    assert float_groups(lens, np.inf).surfaces == lens.surfaces
    near, half = float_groups(lens, NEAR_MM), float_groups(lens, 2 * NEAR_MM)
    assert [near.surfaces[k].thickness for k in (1, 4)] == pytest.approx([6, 5])
    assert [half.surfaces[k].thickness for k in (1, 4)] == pytest.approx([7, 4.5])
    with pytest.raises(InputError, match=r"focus down to 417 mm from the film \(requested 300 mm\)"):
        float_groups(lens, 300)
    plain = load_lens("dgauss-50mm")
    assert float_groups(plain, 300) is plain


@pytest.mark.parametrize("side", ["film", "front"])
def test_a_camera_focuses_with_them(tmp_path, side):
    lens = bench(tmp_path)
    state, film = focused(lens, 1000.0, side, "thick", 587.5618)
    whole = object_distance(state, film)
    assert whole == pytest.approx(1000 if side == "film" else 1000 + state.length + film, rel=1e-6)
    gaps, expected = ([s.thickness for s in one.surfaces] for one in (state, float_groups(lens, whole)))
    assert gaps == pytest.approx(expected, abs=1e-7)
    assert film != pytest.approx(film_distance(lens, 1000.0), abs=1e-3)  # as the unmoved groups would have it


def test_lens_info_takes_the_distance(tmp_path, capsys):
    bench(tmp_path)
    assert main(["lens", "info", str(tmp_path / "floating.txt"), "--focus-distance-m", "0.6", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    lens = float_groups(load_lens(tmp_path / "floating.txt"), 600)
    assert shown["film_distance_mm"] == pytest.approx(film_distance(lens, 600))
    assert main(["lens", "info", str(tmp_path / "floating.txt"), "--focus-distance-m", "0.3"]) == 2


def test_they_are_written_and_read_back(tmp_path):
    lens = bench(tmp_path)
    path = tmp_path / "floating.yaml"
    path.write_text(lens_text(lens))
    again = load_lens(path)
    assert again.floating == lens.floating and again.surfaces == lens.surfaces


def test_close_focus_of_a_zoom_is_told(tmp_path):
    rows = {
        "Focal Length": "70",
        "F-Number": "4",
        "Magnification": "0",
        "d0": "Infinity",
        "d2": "3",
        "d5": "6",
        "Bf": "50",
    }
    lines = [
        f"{line}\t{rows[line.split(chr(9))[0]]}" if line.split("\t")[0] in rows else line for line in BENCH.split("\n")
    ]
    lens = bench(tmp_path, "\n".join(lines))
    assert [state.name for state in lens.configurations] == ["50 mm", "70 mm"]
    assert lens.floating == ()
    assert any("close focus of a zoom lens is not read" in note for note in lens.warnings)


BAD = [
    ({"floating": 3}, "floating: expected a list"),
    ({"floating": [{"distance": 0, "gaps": {0: 1}}]}, r"floating\[0\]\.distance: must be above 0"),
    ({"floating": [{"distance": 300}]}, "needs gaps, such as"),
    ({"floating": [{"distance": 300, "gaps": {0: 1}}] * 2}, "two states have the same distance"),
    (
        {"floating": [{"distance": 300, "gaps": {0: 1}}], "configurations": [{"gaps": {0: 1}}]},
        "has neither focusing nor configurations",
    ),
]


@pytest.mark.parametrize(("keys", "message"), BAD)
def test_bad_states_are_refused(keys, message):
    rows = [{"radius": 50, "thickness": 3, "diameter": 9, "glass": {"index": 1.5}}, {"diameter": 9}]
    with pytest.raises(InputError, match=message):
        load_lens({"surfaces": rows, **keys})


# Thin lenses in air, of closed forms: focal lengths, a plate of 1e-6 mm each, and where they and the film stand.
THIN_MM = 1e-6


def thin_image(lengths, places, object_to_film, film):
    """Return how far behind the film thin lenses image an object, by 1 / b = 1 / f - 1 / a one after another [mm]."""
    at, ahead = places[0], object_to_film - film + places[0]  # of the first lens at places[0], before which it stands
    for k, (length, place) in enumerate(zip(lengths, places, strict=True)):
        if k:
            ahead = place - at - behind  # noqa: F821
        at = place
        behind = 1 / (1 / length - (1 / ahead if ahead else np.inf))
    return at + behind - film


def solved(wrong, low, high):
    """Return where a function that changes its sign is 0."""
    sign = np.sign(wrong(low))
    assert sign != np.sign(wrong(high))
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if np.sign(wrong(middle)) == sign else (low, middle)
    return middle


LENGTHS = (60.0, -40.0, 40.0)  # the negative lens moves between the outer two


def inner_film(start):
    """Return where the film stands at infinity with the negative lens at a place."""
    return solved(lambda film: thin_image(LENGTHS, (0.0, start, 30.0), 1e15, film), 40.0, 400.0)


def inner_place(start, distance):
    """Return where the negative lens stands for an object at a distance from that film."""
    film = inner_film(start)
    return solved(lambda place: thin_image(LENGTHS, (0.0, place, 30.0), distance, film), start, 26.0)


def thin_bench(columns, lengths=LENGTHS, total=False):
    """Return an Optical Bench text of thin lenses; columns are (focal length, object to film or inf, places, film)."""
    rows = {"Focal Length": [], "F-Number": [], "Magnification": [], "d0": [], "Bf": []}
    gaps = {f"d{2 * k + 2}": [] for k in range(len(lengths) - 1)}
    for focal, distance, places, film in columns:
        rows["Focal Length"].append(focal)
        rows["F-Number"].append("4")
        rows["Magnification"].append(0 if np.isinf(distance) else -0.1)
        rows["d0"].append("Infinity" if np.isinf(distance) else distance - film + places[0])
        for k, key in enumerate(gaps):
            gaps[key].append(places[k + 1] - places[k])
        rows["Bf"].append(film - places[-1])
    table = [[name, *values] for name, values in (rows | gaps).items()]
    surfaces = []
    for k, length in enumerate(lengths):
        surfaces.append([2 * k + 1, length * 0.5, THIN_MM, 1.5, 10])
        surfaces.append([2 * k + 2, "Infinity", f"d{2 * k + 2}" if k < len(lengths) - 1 else "Bf", "", 10])
    text = ["[descriptive data]", "title\tthin", "[variable distances]"]
    text += ["\t".join(map(str, row)) for row in table]
    return "\n".join([*text, "[lens data]", *("\t".join(map(str, row)) for row in surfaces), ""])


@pytest.fixture
def inner(tmp_path):
    film = inner_film(8.0)
    near = (0.0, inner_place(8.0, 500.0), 30.0)
    text = thin_bench([("50", np.inf, (0.0, 8.0, 30.0), film), ("undefined", 500.0, near, film)])
    return bench(tmp_path, text)


@pytest.mark.parametrize(("distance", "method"), one_in(5, product((500.0, 600.0, 1000.0, 5000.0), ("thick", "spot"))))
def test_internal_focus_leaves_the_film_and_solves_the_gap(inner, distance, method):
    assert inner.focuses_by_group and inner.floating[0].film_shift_mm == pytest.approx(0, abs=1e-9)
    far = film_distance(inner, np.inf)
    stopped = replace(inner, surfaces=tuple(replace(s, semi_diameter=0.05) for s in inner.surfaces))
    state, film = focused(stopped, distance, "film", method, 587.5618)
    assert film == pytest.approx(far, abs=1e-4 if method == "spot" else 1e-9)
    assert state.length == pytest.approx(inner.length, abs=1e-9)
    assert state.surfaces[1].thickness == pytest.approx(inner_place(8.0, distance), abs=2e-4)
    by_front, other = focused(stopped, distance - state.length - film, "front", method, 587.5618)
    assert other == pytest.approx(film, abs=1e-4)
    assert by_front.surfaces[1].thickness == pytest.approx(state.surfaces[1].thickness, abs=1e-4)


def test_a_near_object_beyond_the_published_one_is_refused_but_for_its_rounding(inner):
    assert focused(inner, 498.5, "film", "thick", 587.5618)[1] == pytest.approx(film_distance(inner, np.inf))
    with pytest.raises(InputError, match=r"focus down to 500 mm from the film \(requested 490 mm\)"):
        focused(inner, 490.0, "film", "thick", 587.5618)


def test_a_back_focus_that_is_calculated_does_not_move_the_film(tmp_path):
    film = inner_film(8.0)
    near = (0.0, inner_place(8.0, 500.0), 30.0)
    text = thin_bench([("50", np.inf, (0.0, 8.0, 30.0), film), ("undefined", 500.0, near, film - 0.1)])
    assert bench(tmp_path, text).floating[0].film_shift_mm == 0


def test_floating_pairs_go_along_their_line_to_where_the_object_is_sharp(tmp_path):
    lengths = (60.0, 90.0)
    far = (0.0, 12.0)
    film = solved(lambda film: thin_image(lengths, far, 1e15, film), 20.0, 200.0)

    def at(share):  # the first lens goes 6 mm forward and the second 4.4: the gap opens by 1.6
        return -6 * share, 12 - 4.4 * share

    nearest = solved(lambda whole: thin_image(lengths, at(1.0), whole, film), 200.0, 5000.0)
    lens = bench(tmp_path, thin_bench([("45", np.inf, far, film), ("-", nearest, at(1.0), film)], lengths))
    assert lens.floating[0].film_shift_mm == pytest.approx(4.4)
    for whole in (nearest, 1.5 * nearest, 4 * nearest):
        share = solved(lambda part, whole=whole: thin_image(lengths, at(part), whole, film), 0.0, 1.05)
        state, back = focused(lens, whole, "film", "thick", 587.5618)
        first, second = at(share)
        assert state.surfaces[1].thickness == pytest.approx(second - first, abs=1e-5)
        assert back == pytest.approx(film - second, abs=1e-5)


@pytest.mark.parametrize("order", [slow((0, 1, 2, 3)), (0, 2, 1, 3)], ids=["far ones first", "each with its near one"])
def test_a_zoom_focuses_by_its_group_in_every_position(tmp_path, order):
    films = {start: inner_film(start) for start in (6.0, 10.0)}
    columns = [(name, np.inf, (0.0, start, 30.0), films[start]) for name, start in (("44", 6.0), ("57", 10.0))]
    columns += [("-", 700.0, (0.0, inner_place(start, 700.0), 30.0), films[start]) for start in films]
    lens = bench(tmp_path, thin_bench([columns[k] for k in order]))
    assert [len(each.floating) for each in lens.configurations] == [1, 1]
    assert not any("is not read" in note for note in lens.warnings)
    path = tmp_path / "zoom.yaml"
    path.write_text(lens_text(lens))
    for each, start in zip(load_lens(path).configurations, films, strict=True):
        state, film = focused(in_configuration(lens, each.name), 1000.0, "film", "thick", 587.5618)
        assert film == pytest.approx(films[start] - 30, abs=1e-4)
        assert state.surfaces[1].thickness == pytest.approx(inner_place(start, 1000.0), abs=1e-4)
    low, high = zoom_range_mm(lens)
    between = zoom_to(lens, (low + high) / 2)
    state, film = focused(between, 1000.0, "film", "thick", 587.5618)
    assert film == pytest.approx(film_distance(between, np.inf)) and state.length == pytest.approx(between.length)


def test_autofocus_and_the_lens_tools_move_the_group(inner, tmp_path, capsys):
    path = tmp_path / "floating.txt"
    camera = {"kind": "realistic", "lens": read_yaml(lens_text(inner)).data, "eye": [0, 0, 1], "target": [0, 0, 0]}
    scene = {
        "film": {"resolution": [8, 6], "width_mm": 24},
        "camera": camera,
        "environment": {"kind": "constant", "radiance": 1},
    }
    camera["focus"] = {"distance_m": 1.0}
    setting = lens_setting(load_scene(scene))
    assert setting.metadata["focused_by"] == "group"
    drive = focus_drive(load_scene(scene))
    shift = inner_place(8.0, 1000.0) - 8.0
    assert drive.start == pytest.approx(shift, abs=1e-3)
    camera["focus"] = {"group_shift_mm": shift}
    other = lens_setting(load_scene(scene))
    assert other.focus_distance_mm == pytest.approx(1000, rel=1e-4)
    assert other.film_distance_mm == pytest.approx(film_distance(inner, np.inf))
    assert main(["lens", "info", str(path), "--focus-distance-m", "1", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["film_distance_mm"] == pytest.approx(film_distance(inner, np.inf))
