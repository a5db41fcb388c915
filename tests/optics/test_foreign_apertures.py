"""What files of Zemax, CODE V and ISET say around their surfaces: openings, media, dummies, qualifiers of surfaces."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.export import lens_text
from rptcam_cl.optics.library import load_lens

FRONT = ["STOP", "CURV 0.02", "DISZ 5", "GLAS N-BK7 0 0 1.5 40", "DIAM 10"]
BACK = ["CURV -0.02", "DISZ 45", "DIAM 10"]


def zemax(tmp_path, surfaces, before=(), head="ENPD 10"):
    """Return the lens of a Zemax file of the surfaces, `before` being the further lines of the object."""
    blocks = [["CURV 0", "DISZ INFINITY", *before], *surfaces, ["CURV 0", "DISZ 0"]]
    lines = ["MODE SEQ", "UNIT MM", head, "GCAT SCHOTT", "FTYP 0 0 1 1"]
    for k, block in enumerate(blocks):
        lines += [f"SURF {k}", *(f"  {line}" for line in block)]
    path = tmp_path / "a.zmx"
    path.write_text("\n".join(lines))
    return load_lens(path)


def codev(tmp_path, first="", second="", behind="", before="", head="EPD 10"):
    """Return the lens of a sequence of two surfaces and what stands behind each, behind the image and in `SO`."""
    text = (
        f"RDM\n{head}\nSO 0 1E11 {before}\nS 50 5 N-BK7\n STO\n CIR 10\n{first}\nS -50 45\n{second}\nSI 0 0\n{behind}\n"
    )
    path = tmp_path / "a.seq"
    path.write_text(text)
    return load_lens(path)


@pytest.mark.parametrize(
    ("surface", "line", "semi_diameters"),
    [
        (0, "CLAP 0 4 0", (4, 10)),
        (0, "CLAP 0 12 0", (5, 10)),
        (1, "CLAP 0 12 0", (5, 12)),
        (1, "CLAP 1 8 0", (5, 8)),
    ],
    ids=["stop closed", "stop in a wide mount", "wide opening", "ring"],
)
def test_the_opening_of_a_zemax_surface_is_its_clear_diameter(tmp_path, surface, line, semi_diameters):
    surfaces = [list(FRONT), list(BACK)]
    surfaces[surface].append(line)
    lens = zemax(tmp_path, surfaces)
    assert tuple(s.semi_diameter for s in lens.surfaces) == semi_diameters
    assert lens.first_order().f_number == pytest.approx(lens.first_order().focal_length_mm / 2 / semi_diameters[0])


def water_to_air(length, n=1.333, glass=1.6):
    """Return the focal length of a thick lens of radii 50 and -50 mm behind water."""
    first, second = (glass - n) / 50, (glass - 1) / 50
    return 1 / (first + second - length / glass * first * second)


def test_the_medium_of_the_object_is_read(tmp_path):
    front = [line.replace("N-BK7 0 0 1.5 40", "___BLANK 1 0 1.6 0") for line in FRONT]
    lens = zemax(tmp_path, [front, BACK], ["GLAS ___BLANK 1 0 1.333 0"])
    assert lens.first_order().focal_length_mm == pytest.approx(water_to_air(5))
    assert codev(tmp_path, before="WATER").object_medium.name == "water"
    assert codev(tmp_path, before="AIR").first_order().focal_length_mm == pytest.approx(49.2130, abs=1e-3)


def test_chosen_diameters_hold_the_beam_in_water(tmp_path):
    front = [line for line in FRONT if not line.startswith("DIAM")]
    lens = zemax(
        tmp_path, [["DISZ 100"], front, ["CURV -0.02", "DISZ 45"]], ["GLAS WATER 0 0 1.5 40"], "ENPD 10\nYFLN 0 20"
    )
    plane, stop, _ = lens.surfaces  # from water to air, 100 mm before the stop
    slope = float(lens.object_medium.index(587.5618)) * np.tan(np.radians(20))
    assert stop.semi_diameter == pytest.approx(5)
    assert plane.semi_diameter == pytest.approx(1.05 * (5 + 100 * slope), rel=1e-6)


def test_a_mangin_mirror_with_a_plane_front_keeps_it(tmp_path):
    front = ["STOP", "CURV 0", "DISZ 5", "GLAS N-BK7 0 0 1.5 40", "DIAM 10"]
    mirror = ["CURV -0.005", "DISZ -5", "GLAS MIRROR 0 0 1.5 40", "DIAM 10"]
    lens = zemax(tmp_path, [front, mirror, ["CURV 0", "DISZ -60", "DIAM 10"]])
    assert len(lens.surfaces) == 3
    assert lens.first_order().focal_length_mm == pytest.approx(100 / 1.5168, rel=1e-5)  # R / 2n


def test_dummies_go_unless_they_stop_light(tmp_path):
    dummy = ["CURV 0", "DISZ 20", "DIAM 20"]
    assert len(zemax(tmp_path, [dummy, FRONT, BACK, dummy]).surfaces) == 2
    for line in ("SQAP 4 2", "CLAP 0 3 0", "OBSC 0 2 0"):
        lens = zemax(tmp_path, [[*dummy, line], FRONT, BACK, [*dummy, line]])
        assert len(lens.surfaces) == 4, line
    assert lens.surfaces[0].inner_semi_diameter == 2


@pytest.mark.parametrize(
    ("lines", "warning"),
    [
        (["SQOB 2 1"], r"a\.zmx:\d+: SQOB is ignored"),
        (["SCBD 0 0 0 0 0 2 0 0"], r"a\.zmx:\d+: SCBD, a decentre and tilt"),
        (["XDAT 1 1 0 0", "XDAT 3 0.1 0 0"], r"the extra data \(XDAT\) of this STANDARD surface are ignored"),
    ],
)
def test_zemax_lines_that_change_rays_and_are_not_read_are_said(tmp_path, lines, warning):
    lens = zemax(tmp_path, [FRONT, [*BACK, *lines]])
    assert any(re.search(warning, note) for note in lens.warnings)


def test_zemax_heads_that_change_the_lens_are_said(tmp_path):
    def notes(head):
        return zemax(tmp_path, [FRONT, BACK], head=head).warnings

    assert notes("ENVD 20 1 0\nMNUM 1 1\nSCBD 0 0 0 0 0 0 0 0") == ()
    assert "glass is taken at 20 degrees and 1 atmosphere, not at 35 and 1" in notes("ENVD 35 1 1")[0]
    assert "its 3 positions move no surfaces: it is read as saved" in notes("MNUM 3 2")[0]


@pytest.mark.parametrize(
    ("behind", "radii", "gap"),
    [
        ("CIR S1..2 4", (4, 4), 5),
        ("CIR SA 4", (4, 4), 5),
        ("CIR SI-1 4", (10, 4), 5),
        ("CIR SS 4\nCIR S2 6", (4, 6), 5),
        ("CIR S2 6\nTHI S0..1 7\nTHI SI 1", (10, 6), 7),
        ("CIR S2 6\nTHI S1 Z1 7\nTHI S1 Z2 9", (10, 6), 7),
    ],
)
def test_codev_data_name_their_surfaces_in_every_way(tmp_path, behind, radii, gap):
    first, second = codev(tmp_path, behind=behind, head="TIT rims").surfaces
    assert (first.semi_diameter, second.semi_diameter) == pytest.approx(radii)
    assert first.thickness == gap


def test_codev_surfaces_by_label_are_said(tmp_path):
    lens = codev(tmp_path, second=" CIR 9", behind="CIR S'front' 4", head="TIT rims")
    assert [s.semi_diameter for s in lens.surfaces] == [10, 9]
    assert any("CIR of the surface labelled 'front' is ignored" in note for note in lens.warnings)


# A thin lens of 50 mm at the first surface, with the stop 20 mm behind it. There the beam is 0.6 as wide for a distant
# object, and for one 100 mm before it, imaged 100 mm behind, 0.8.
THIN = [["CURV 0.04", "DISZ 1e-9", "GLAS ___BLANK 1 0 1.5 0", "DIAM 20"], ["CURV 0", "DISZ 20", "DIAM 20"]]
STOP = ["STOP", "CURV 0", "DISZ 30", "DIAM 7"]


@pytest.mark.parametrize(
    ("head", "object_mm", "diameter"),
    [
        ("ENPD 10", "INFINITY", 6),
        ("FNUM 5 0", "INFINITY", 6),
        ("FNUM 5 1", "INFINITY", 6),
        ("FLOA", "INFINITY", 14),
        ("ENPD 10", "100", 6),
        ("FNUM 5 0", "100", 6),
        ("FNUM 5 1", "100", 0.8 * 2 * 100 / 10),  # a slope of 1 / 2N at the image is one of as much at the object
        ("OBNA 0.1 0", "100", 0.8 * 2 * 100 * np.tan(np.arcsin(0.1))),
        ("OBNA 6 1", "100", 0.8 * 2 * 100 * np.tan(np.radians(6))),
    ],
)
def test_the_aperture_of_a_zemax_file_decides_its_stop(tmp_path, head, object_mm, diameter):
    front = [line for line in THIN[0] if not line.startswith("DIAM")]
    for surfaces in ([*THIN, STOP], [front, *THIN[1:], STOP]):
        lens = zemax(tmp_path, surfaces, [f"DISZ {object_mm}"], head)
        assert 2 * lens.stop.semi_diameter == pytest.approx(diameter, rel=1e-6)


@pytest.mark.parametrize(
    ("head", "object_mm", "f_number"),
    [("EPD 10", 1e11, 5), ("FNO 4", 1e11, 4), ("NA 0.125", 1e11, 4), ("FNO 4", 100, 2), ("NAO 0.1", 100, 2.4875)],
)
def test_the_aperture_of_a_codev_sequence_decides_its_stop_which_is_the_first_surface_unless_said(
    tmp_path, head, object_mm, f_number
):
    path = tmp_path / "a.seq"
    surfaces = "S 25 1E-9 500000.5\n CIR 9\nS 0 50\n CIR 20\n".replace("500000.5", "500.999999")
    path.write_text(f"RDM\n{head}\nSO 0 {object_mm}\n{surfaces}SI 0 0\n")
    lens = load_lens(path)
    assert lens.stop_index == 0
    length = lens.first_order().focal_length_mm
    assert length == pytest.approx(50, rel=1e-3)
    assert lens.first_order().f_number == pytest.approx(f_number, rel=2e-3)
    assert any("more than its rim of 18" in note for note in lens.warnings) == (50 / f_number > 18)


def test_the_codev_object_may_be_called_s0(tmp_path):
    path = tmp_path / "a.seq"
    path.write_text("RDM\nEPD 10\nS0 0 1E11\nS1 50 5 N-BK7\n STO\nS2 -50 45\nSI 0 0\n")
    assert len(load_lens(path).surfaces) == 2


def test_codev_rectangles_are_clear_edges_or_obscurations(tmp_path):
    edge = codev(tmp_path, second=" REX EDG 3\n REY EDG 4").surfaces[1].region
    assert (edge.half_width, edge.half_height) == (3, 4)
    clear = codev(tmp_path, second=" REX CLR 1\n REY 2\n REX EDG 3\n REY EDG 4").surfaces[1].region
    assert (clear.half_width, clear.half_height) == (1, 2)
    blocked = codev(tmp_path, second=" REX OBS 3\n REY OBS 4")
    assert blocked.surfaces[1].region is None
    assert any("REX OBS 3 is ignored" in note for note in blocked.warnings)


@pytest.mark.parametrize("line", ["RET S1", "GLB S1", "ARO 2"])
def test_codev_lines_that_change_rays_and_are_not_read_are_said(tmp_path, line):
    lens = codev(tmp_path, second=f" CIR 9\n {line}")
    assert any(f"{line.split()[0]} is ignored" in note for note in lens.warnings)


@pytest.mark.parametrize("word", ["inf", "INFINITY", "0"])
def test_the_codev_object_may_be_at_infinity_in_a_word(tmp_path, word):
    path = tmp_path / "a.seq"
    path.write_text(f"RDM\nEPD 10\nSO {word} {word}\nS 50 5 N-BK7\n STO\nS {word} 45\nSI inf 0\n")
    lens = load_lens(path)
    assert lens.surfaces[1].curvature == 0 and lens.first_order().entrance_pupil.diameter_mm == pytest.approx(10)


OFF_AXIS = [
    (["DIAM 2", "CLAP 0 6 0", "OBDC 3 -4"], lambda x, y: np.hypot(x - 3, y + 4) < 6),
    (["DIAM 2", "CLAP 2 6 0", "OBDC 3 -4"], lambda x, y: (np.hypot(x - 3, y + 4) < 6) & (np.hypot(x - 3, y + 4) > 2)),
    (["DIAM 9", "OBSC 0 2 0", "OBDC 3 -4"], lambda x, y: (np.hypot(x, y) < 9) & (np.hypot(x - 3, y + 4) > 2)),
    (["DIAM 2", "SQAP 4 2 0", "OBDC -1 2"], lambda x, y: (np.abs(x + 1) < 4) & (np.abs(y - 2) < 2)),
    (" CIR 6\n ADX 3\n ADY -4", lambda x, y: np.hypot(x - 3, y + 4) < 6),
    (" REX 4\n REY 2\n ADX -1\n ADY 2", lambda x, y: (np.abs(x + 1) < 4) & (np.abs(y - 2) < 2)),
    (" CIR 9\n CIR OBS 2\n ADX 3\n ADY -4", lambda x, y: (np.hypot(x - 3, y + 4) > 2) & (np.hypot(x - 3, y + 4) < 9)),
]


@pytest.mark.parametrize(("lines", "holds"), OFF_AXIS)
def test_openings_beside_the_axis_clip_as_they_are(tmp_path, lines, holds):
    """Against a count of points of a plane surface; written and read again they are the same."""
    if isinstance(lines, str):
        behind = "S 0 5 N-BK7\n CIR 40\nS 0 5\n CIR 40\nSI 0 0\n"
        text = f"RDM\nEPD 10\nSO 0 1E11\nS 0 5\n CIR 40\n STO\nS 0 20\n{lines}\n{behind}"
        (tmp_path / "a.seq").write_text(text)
        lens = load_lens(tmp_path / "a.seq")
    else:
        glass = [["CURV 0", "DISZ 5", "GLAS N-BK7 0 0", "DIAM 40"], ["CURV 0", "DISZ 5", "DIAM 40"]]
        lens = zemax(tmp_path, [["STOP", "CURV 0", "DISZ 5", "DIAM 40"], ["CURV 0", "DISZ 20", *lines], *glass])
    lens = replace(lens, surfaces=tuple(s.open() if s.is_stop else s for s in lens.surfaces))
    x, y = np.random.default_rng(5).uniform(-12, 12, (2, 20000))
    origins, along = np.column_stack([x, y, np.full_like(x, -10)]), np.broadcast_to([0, 0, 1.0], (len(x), 3))
    expected = holds(x, y)
    assert 0.02 < expected.mean() < 0.9
    np.testing.assert_array_equal(lens.trace(origins, along, start="scene").passed, expected)
    closed = lens.with_changes({k: {"semi_diameter": 40.0} for k, s in enumerate(lens.surfaces) if s.is_stop})
    (tmp_path / "b.yaml").write_text(lens_text(closed))
    again = load_lens(tmp_path / "b.yaml")
    np.testing.assert_array_equal(again.trace(origins, along, start="scene").passed, expected)
    assert not any("beside the axis" in note for note in lens.warnings)


def test_an_ideal_lens_that_makes_the_object_distant_is_left_out(tmp_path):
    ideal = ["TYPE PARAXIAL", "PARM 1 100", "DISZ 10", "DIAM 9"]
    near, far = ["DISZ 100"], zemax(tmp_path, [FRONT, BACK], ["DISZ INFINITY"])
    lens = zemax(tmp_path, [ideal, FRONT, BACK], near)
    assert lens.surfaces == far.surfaces
    assert any("an ideal lens with the object in its focus is left out" in note for note in lens.warnings)
    for surfaces, before, place in (([ideal, FRONT, BACK], ["DISZ 90"], 0), ([FRONT, BACK, ideal], near, 2)):
        phase = zemax(tmp_path, surfaces, before).surfaces[place].phase
        assert phase is not None and phase.written() == {"focal_length": 100}
    with pytest.raises(InputError, match=r"a\.zmx:\d+: an ideal lens needs a focal length \(PARM 1\)"):
        zemax(tmp_path, [FRONT, BACK, ["TYPE PARAXIAL", "DISZ 10", "DIAM 9"]], near)


# Q_0 to Q_3 of Qbfs as Forbes prints them (Opt. Express 15, 5218 (2007), eq. 4.6), and of Qcon (eq. 3.3)
BFS = [
    lambda x: 1 + 0 * x,
    lambda x: (13 - 16 * x) / np.sqrt(19),
    lambda x: np.sqrt(2 / 95) * (29 - 4 * x * (25 - 19 * x)),
    lambda x: np.sqrt(2 / 2545) * (207 - 4 * x * (315 - x * (577 - 320 * x))),
]
CON = [lambda x: 1 + 0 * x, lambda x: -(5 - 6 * x), lambda x: 15 - 14 * x * (3 - 2 * x)]


@pytest.mark.parametrize(("kind", "terms"), [(0, [-0.3, 0.05, -0.02, 0.004]), (1, [-0.3, 0.05, -0.02])])
@pytest.mark.parametrize("conic", [0.0, -0.6])
def test_q_type_aspheres_of_zemax(tmp_path, kind, terms, conic):
    c, norm = 0.02, 14.0
    extra = [f"XDAT {k} {value} 0 0" for k, value in enumerate([kind, len(terms), norm, *terms], start=1)]
    front = [*FRONT[:1], "TYPE QED_TYPE", *FRONT[1:], f"CONI {conic}", *extra]
    lens = zemax(tmp_path, [front, BACK])
    r = np.linspace(0, 10, 50)
    x, root = (r / norm) ** 2, np.sqrt(1 - (1 + conic) * (c * r) ** 2)
    steep = np.sqrt(1 - conic * (c * r) ** 2) / root
    if kind == 0:
        added = x * (1 - x) * steep * sum(a * q(x) for a, q in zip(terms, BFS, strict=True))
    else:
        added = x * x * sum(a * q(x) for a, q in zip(terms, CON, strict=True))
    np.testing.assert_allclose(lens.surfaces[0].sag(0 * r, r), c * r * r / (1 + root) + added, atol=1e-9)
    for wrong in ("XDAT 1 2 0 0", "XDAT 3 0 0 0", "XDAT 2 99 0 0"):
        with pytest.raises(InputError, match="a Q-type asphere needs the type 0 or 1"):
            zemax(tmp_path, [[*front, wrong], BACK])


def test_codev_titles_that_look_like_a_surface_are_titles(tmp_path):
    assert codev(tmp_path, behind="TIT S1").name == "S1"


def test_aspheric_coefficients_of_iset_are_refused_as_their_powers_are_not_known(tmp_path):
    row = {"radius": 50, "thickness": 5, "ior": 1.5, "semi_aperture": 9, "aspheric_coefficients": [0.0, 0.0]}
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"name": "a", "surfaces": [row, {**row, "ior": 1, "radius": -50}]}))
    assert len(load_lens(path).surfaces) == 2
    path.write_text(path.read_text().replace("[0.0, 0.0]", "[0.0, 1e-5]"))
    with pytest.raises(InputError, match=r"surfaces\[0\]\.aspheric_coefficients: the powers they belong to"):
        load_lens(path)


@pytest.mark.parametrize("gap", [-1.0, 0.0])
def test_diameters_are_chosen_where_surfaces_cross_on_the_axis(tmp_path, gap):
    path = tmp_path / "a.seq"
    path.write_text(f"RDM\nEPD 5\nSO 0 1E11\nS 50 5 N-BK7\n STO\nS 50 {gap}\nS -60 3 N-BK7\nS -60 40\nSI 0 0\n")
    lens = load_lens(path)
    assert all(surface.semi_diameter > 2 for surface in lens.surfaces)
    assert any("stands in front" in note or "cross" in note for note in lens.warnings)


def test_pupils_beyond_all_bounds_are_refused_in_one_line(tmp_path):
    path = tmp_path / "a.seq"
    path.write_text("RDM\nEPD 1E200\nSO 0 1E11\nS 50 5 N-BK7\n STO\nS 0 2\n K 1\nS 0 3 N-BK7\n K 1\nS 0 40\nSI 0 0\n")
    with pytest.raises(InputError, match="diameter"):
        load_lens(path)
