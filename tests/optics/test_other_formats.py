"""Lens files of other programs: ISET JSON, Zemax, CODE V, Optical Bench."""

import json

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.lens import in_configuration
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.shapes import Toroid


def load_text(tmp_path, text, name):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_lens(path)


def test_iset_json(tmp_path):
    lens = load_lens("dgauss-50mm")
    rows = [
        {
            "radius": 0 if surface.is_stop else surface.radius,
            "thickness": surface.thickness,
            "ior": 0 if surface.is_stop else float(surface.glass.index(550.0)),
            "semi_aperture": surface.semi_diameter,
        }
        for surface in lens.surfaces
    ]
    data = {"name": "dgauss", "description": "x", "type": "multi element lens", "surfaces": rows}
    got = load_text(tmp_path, json.dumps(data), "lens.json")
    assert got.stop_index == 5
    assert got.first_order() == lens.first_order()
    rows[2]["radius"] = "big"
    with pytest.raises(InputError, match=r"surfaces\[2\]\.radius: expected a number \(got 'big'\)"):
        load_text(tmp_path, json.dumps(data), "bad.json")


CODEV = """\
RDM N;LEN      "VERSION: 10.7"
TITLE 'Double Gauss F/2 -  Available Glasses'
EPD   50.0
DIM   M
WL    656.3 587.6 486.1
YAN   0.0 10.0 14.0
SO    0.0 993938392063.0
S     0.01779284094091543 8.75 NSSK2_SCHOTT
  CCY 0
S     0.006566600536925569 0.5
S     0.02653743294670983 12.5 NSK2_SCHOTT
S     0.0 3.8 F5_SCHOTT
S     0.04126892878570084 16.36944492653564
  CCY 0; THC 0
S     0.0 13.74795696388906
  STO
S     -0.03523942654429074 3.8 F5_SCHOTT
S     0.0 11.0 NSK16_SCHOTT
S     -0.02636750828657709 0.5
S     0.005636604951748545 7.0 &
  NSK16_SCHOTT     ! the last element
S     -0.0125926458590576 61.4875364179821
  PIM; XYZ 3
SI    0.0 -0.4
GO
"""


def test_codev_sequence(tmp_path):
    lens = load_text(tmp_path, CODEV, "gauss.seq")
    data = lens.first_order()
    assert lens.name == "Double Gauss F/2 - Available Glasses"
    assert (len(lens.surfaces), lens.stop_index) == (11, 5)
    assert data.focal_length_mm == pytest.approx(100.0, abs=0.1)  # f/2 with a pupil of 50 mm, as the title says
    assert data.entrance_pupil.diameter_mm == pytest.approx(50.0, rel=1e-9)
    assert any("XYZ is ignored" in note and ":23:" in note for note in lens.warnings)
    assert any("diameters that the file does not give" in note for note in lens.warnings)


def test_codev_asphere_and_six_digit_glass(tmp_path):
    text = (
        "RDM Y;LEN\nTIT 'x'\nDIM C\nSO 0 1E10\nS 2.0 0.5 517.642\n CIR EDG 0.55\n STO\n"
        " ASP\n K -0.5\n A -0.1\n B 0.2\nS 0 2\n CIR 0.5\nSI 0 0\n"
    )
    lens = load_text(tmp_path, text, "a.seq")
    first = lens.surfaces[0]
    assert (first.radius, first.thickness, first.semi_diameter, first.conic) == pytest.approx((20, 5, 5.5, -0.5))
    assert first.aspheric == ((4, pytest.approx(-1e-4)), (6, pytest.approx(2e-6)))
    assert float(first.glass.index(587.5618)) == pytest.approx(1.517)


def test_codev_decentre_and_tilt_come_back_to_the_axis(tmp_path):
    text = (
        "len; dim m; rdm y\nso 0 1e11\ns 50 5 517.642\n cir 10\n sto\ns -50 5\n cir 10\n"
        "s 0 3\n cir 10\n yde 2; ade 30\ns 0 1\n cir 10\n ade -30; yde 0\nsi 0 0\nepd 10\n"
    )
    lens = load_text(tmp_path, text, "tilt.seq")
    assert lens.surfaces[1].pose is None
    tilted = lens.surfaces[2].pose
    assert tilted is not None
    assert tilted.offset == pytest.approx((0, 2, 0))
    # Left handed about x: the surface's axis leans towards +y.
    assert tilted.matrix()[:, 2] == pytest.approx([0, 0.5, np.sqrt(0.75)])
    assert lens.surfaces[3].pose.matrix() == pytest.approx(np.eye(3))


ZEMAX = """\
VERS 140730 73 26155
MODE SEQ
NAME A test lens
UNIT MM X W X CM MR CPMM
FNUM 2.1 0
YFLN 0 8.0 13.6 0
GCAT SCHOTT
ODDKEY 1
SURF 0
  TYPE STANDARD
  CURV 0.0 0 0 0 0 ""
  DISZ INFINITY
SURF 1
  TYPE STANDARD
  CURV 0.02 0 0 0 0 ""
  DISZ 5
  GLAS N-BK7 0 0 1.5 40 0 0 0 0 0 0
  DIAM 10 1 0 0 1 ""
SURF 2
  STOP
  TYPE EVENASPH
  CURV -0.01 0 0 0 0 ""
  PARM 1 0
  PARM 2 1.1E-5
  PARM 3 -2E-8
  DISZ 4.25
  CONI -0.5
  DIAM 9 1 0 0 1 ""
SURF 3
  TYPE TOROIDAL
  CURV 0.03 0 0 0 0 ""
  PARM 1 40
  DISZ 3
  GLAS ___BLANK 1 0 1.62 36.3 0 0 0 0 0 0
  DIAM 9 1 0 0 1 ""
SURF 4
  TYPE STANDARD
  CURV 0 0 0 0 0 ""
  DISZ 2
  GLAS STRANGE1 0 0 1.7 30.1 0 0 0 0 0 0
  DIAM 9 1 0 0 1 ""
SURF 5
  TYPE STANDARD
  CURV -0.02 0 0 0 0 ""
  DISZ 20
  DIAM 9 1 0 0 1 ""
SURF 6
  TYPE STANDARD
  CURV 0.0 0 0 0 0 ""
  DISZ 0
  DIAM 5 0 0 0 1 ""
"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_zemax_sequence(tmp_path, encoding):
    lens = load_text(tmp_path, ZEMAX.encode(encoding), "lens.zmx")
    assert lens.name == "A test lens"
    assert (len(lens.surfaces), lens.stop_index) == (5, 1)
    assert lens.surfaces[0].glass.name == "N-BK7"
    assert lens.surfaces[1].aspheric == ((4, 1.1e-5), (6, -2e-8))
    assert lens.surfaces[1].conic == -0.5
    assert lens.surfaces[2].form == Toroid(pytest.approx(1 / 40))
    assert [float(lens.surfaces[k].glass.index(587.5618)) for k in (2, 3)] == pytest.approx([1.62, 1.7])
    assert [surface.semi_diameter for surface in lens.surfaces] == [10, lens.stop.semi_diameter, 9, 9, 9]
    assert lens.first_order().f_number == pytest.approx(2.1)
    assert not any("ODDKEY" in note for note in lens.warnings)  # what decides no ray is passed over
    assert any("glass STRANGE1 is replaced" in note for note in lens.warnings)


def test_zemax_coordinate_breaks(tmp_path):
    broken = ZEMAX.replace(
        "SURF 3\n", "SURF 9\n  TYPE COORDBRK\n  PARM 1 0.5\n  PARM 3 10\n  DISZ 0\nSURF 3\n", 1
    ).replace("SURF 5\n", "SURF 9\n  TYPE COORDBRK\n  PARM 3 -10\n  DISZ 0\nSURF 5\n", 1)
    lens = load_text(tmp_path, broken, "lens.zmx")
    poses = [surface.pose for surface in lens.surfaces]
    assert poses[0] is None and poses[1] is None
    assert poses[2].offset == pytest.approx((0.5, 0, 0))
    assert poses[2].matrix()[:, 2] == pytest.approx([0, -np.sin(np.radians(10)), np.cos(np.radians(10))])
    # The third surface stands 3 mm along the tilted axis, and the last one 2 mm farther, no longer tilted.
    assert poses[3].offset == pytest.approx((0.5, -3 * np.sin(np.radians(10)), 3 * np.cos(np.radians(10)) - 3))
    assert poses[4].matrix() == pytest.approx(np.eye(3))


def zemax_prism(parameters):
    lines = "".join(f"  PARM {number} {value}\n" for number, value in parameters.items())
    return (
        "VERS 1\nMODE SEQ\nUNIT MM\nSURF 0\n  DISZ INFINITY\n"
        "SURF 1\n  STOP\n  TYPE STANDARD\n  CURV 0\n  DISZ 4\n  GLAS ___BLANK 1 0 1.5 1e9 0 0 0 0 0 0\n  DIAM 9\n"
        f"SURF 2\n  TYPE COORDBRK\n{lines}  DISZ 0\n"
        "SURF 3\n  TYPE STANDARD\n  CURV 0\n  DISZ 5\n  DIAM 9\nSURF 4\n  DISZ 0\n  DIAM 5\n"
    )


def codev_prism(tilt):
    return f"LEN\nDIM M\nSO 0 1e10\nS 0 4 500640\n  STO\n  CIR 9\nS 0 5 AIR\n  {tilt}\n  CIR 9\nSI 0 0\n"


def deviation(lens):
    """Degrees by which a ray on the axis is turned towards +x and +y."""
    out = lens.trace([[0, 0, -1]], [[0, 0, 1]], start="scene").directions[0]
    return np.degrees(np.arcsin(out[:2]))


# By Snell's law a face tilted by 10 degrees turns a ray in glass of index 1.5 by asin(1.5 sin 10) - 10 = 5.098 degrees
# towards the thick end. A right-handed turn about x tips +z towards -y and moves the upper end of the face away: the
# prism is thickest above. One about y tips +z towards +x: the prism is thickest at -x.
BENT = float(np.degrees(np.arcsin(1.5 * np.sin(np.radians(10)))) - 10)


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [({3: 10}, (0, BENT)), ({3: -10}, (0, -BENT)), ({4: 10}, (-BENT, 0)), ({5: 90, 3: 10}, (0, BENT)),
     ({6: 1, 5: 90, 3: 10}, (-BENT, 0))],
)  # fmt: skip
def test_zemax_tilts_turn_right_handed(tmp_path, parameters, expected):
    lens = load_text(tmp_path, zemax_prism(parameters), "prism.zmx")
    assert deviation(lens) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("tilt", "expected"), [("ADE 10", (0, -BENT)), ("BDE 10", (BENT, 0)), ("ADE 10; CDE 90", (0, -BENT))]
)
def test_codev_tilts_about_x_and_y_turn_left_handed(tmp_path, tilt, expected):
    lens = load_text(tmp_path, codev_prism(tilt), "prism.seq")
    assert deviation(lens) == pytest.approx(expected, abs=1e-4)


def test_what_zemax_files_cannot_give_is_named(tmp_path):
    for text, message in [
        (ZEMAX.replace("MODE SEQ", "MODE NSC"), r"lens\.zmx:2: only sequential files"),
        (
            ZEMAX.replace("GLAS N-BK7 ", "GLAS XK99 "),
            r"lens\.zmx:17: glass XK99 is in no catalogue and the file has no index; did",
        ),
        (ZEMAX.replace("UNIT MM", "UNIT FT"), r"lens\.zmx:4: unit 'FT' is unknown"),
        (ZEMAX.replace("CURV 0.02", "CURV x"), r"lens\.zmx:15: expected numbers"),
        ("MODE SEQ\n", r"lens\.zmx: a lens needs surfaces between object and image"),
    ]:
        with pytest.raises(InputError, match=message):
            load_text(tmp_path, text, "lens.zmx")


BENCH = """\
[descriptive data]
title\tUS 3,552,829 Example 1
[constants]
Scaled\t50\t1
[variable distances]
Focal Length\t50
Angle of View\t46.7
F-Number\t1.4
Image Height\t43.2
d0\tInfinity
Bf\t36.5
[lens data]
1\t56.6550\t5.2400\t1.81500\t38.50\t45.2
2\t600.0000\t0.5650\t\t38.50\t
3\t25.6800\t6.5600\t1.69400\t33.50\t54.6
4\t51.8750\t0.8000\t\t28.716
5\t84.6000\t2.2550\t1.63003\t34.00\t35.4
6\t17.2950\t5.865\t\t24.50\t
6AS\tAS\t5.565\t\t24.100\t
7\t-19.4750\t2.8550\t1.79180\t24.00\t25.9
8\t246.0200\t6.1850\t1.80040\t31.00\t42.7
9\t-35.9650\t0.0950\t\t31.00\t
10\t-125.8950\t4.0500\t1.80040\t31.50\t42.7
11\t-37.6250\t0.0950\t\t31.50\t
12\t198.1300\t4.0500\t1.71615\t31.50\t53.7
13\t-63.0250\tBf\t\t31.50\t
[figure]
"""


def test_optical_bench(tmp_path):
    lens = load_text(tmp_path, BENCH, "bench.txt")
    assert lens.name == "US 3,552,829 Example 1"
    assert lens.published == {"focal_length_mm": 50, "f_number": 1.4}
    assert lens.stop_index == 6
    ours = load_lens("double-gauss-50mm-f1.4").first_order()
    assert lens.first_order().focal_length_mm == pytest.approx(ours.focal_length_mm, rel=1e-9)


def test_optical_bench_with_aspheres_and_states(tmp_path):
    text = BENCH.replace("2\t600.0000\t0.5650", "2\t600.0000\td2").replace(
        "F-Number\t1.4", "F-Number\t1.4\t1.6\nd2\t0.565\t2.5"
    )
    text = (
        text.replace("Focal Length\t50", "Focal Length\t50\t52")
        + "[aspherical data]\n13\t-63.025\t-0.4\t1e-6\t2e-9\n99\t1\t0\t1\n"
    )
    lens = load_text(tmp_path, text, "bench.txt")
    assert lens.surfaces[13].conic == -0.4
    assert lens.surfaces[13].aspheric == ((4, 1e-6), (6, 2e-9))
    assert [state.name for state in lens.configurations] == ["50 mm", "52 mm"]
    assert in_configuration(lens, "52 mm").surfaces[1].thickness == 2.5
    assert any("aspheric data for a surface '99'" in note for note in lens.warnings)
    odd = load_text(tmp_path, text.replace("Scaled\t50\t1", "AsphericalOddCount\t1"), "odd.txt")
    assert odd.surfaces[13].aspheric == ((3, 1e-6), (4, 2e-9))


def test_a_pbrt_table_named_txt_is_still_a_table(tmp_path):
    lens = load_text(tmp_path, "20 40 1.5 24\n-20 0 1 24\n", "ball.txt")
    assert lens.first_order().focal_length_mm == pytest.approx(30)


def test_a_bad_optical_bench_row_is_named(tmp_path):
    with pytest.raises(InputError, match=r"bench\.txt:14: thickness behind surface 2: expected a number \(got 'd9'\)"):
        load_text(tmp_path, BENCH.replace("600.0000\t0.5650", "600.0000\td9"), "bench.txt")
