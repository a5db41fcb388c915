"""Lenses whose groups float: close-focus columns of an Optical Bench file set their gaps by the distance."""

import json

import numpy as np
import pytest

from rptcam_cl.cameras.setting import focused
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.prescription import lens_text
from rptcam_cl.optics import load_lens
from rptcam_cl.optics.focus import film_distance, object_distance
from rptcam_cl.optics.variable import floated

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


def test_gaps_go_by_the_inverse_of_the_distance(tmp_path):
    lens = bench(tmp_path)
    assert floated(lens, np.inf).surfaces == lens.surfaces
    near, half = floated(lens, NEAR_MM), floated(lens, 2 * NEAR_MM)
    assert [near.surfaces[k].thickness for k in (1, 4)] == pytest.approx([6, 5])
    assert [half.surfaces[k].thickness for k in (1, 4)] == pytest.approx([7, 4.5])
    with pytest.raises(InputError, match=r"focus down to 417 mm from the film \(requested 300 mm\)"):
        floated(lens, 300)
    plain = load_lens("dgauss-50mm")
    assert floated(plain, 300) is plain


@pytest.mark.parametrize("side", ["film", "front"])
def test_a_camera_focuses_with_them(tmp_path, side):
    lens = bench(tmp_path)
    state, film = focused(lens, 1000.0, side, "thick", 587.5618)
    whole = object_distance(state, film)
    assert whole == pytest.approx(1000 if side == "film" else 1000 + state.length + film, rel=1e-6)
    gaps, expected = ([s.thickness for s in one.surfaces] for one in (state, floated(lens, whole)))
    assert gaps == pytest.approx(expected, abs=1e-7)
    assert film != pytest.approx(film_distance(lens, 1000.0), abs=1e-3)  # as the unmoved groups would have it


def test_lens_info_takes_the_distance(tmp_path, capsys):
    bench(tmp_path)
    assert main(["lens", "info", str(tmp_path / "floating.txt"), "--focus-distance-m", "0.6", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    lens = floated(load_lens(tmp_path / "floating.txt"), 600)
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
