"""What lens files of other programs say in their own ways: glasses, apertures, fields, decentres, lone numbers."""

import json

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.lens import in_configuration
from rptcam_cl.optics.library import load_lens


def load_text(tmp_path, text, name, **how):
    path = tmp_path / name
    path.write_text(text)
    return load_lens(path, **how)


def index_d(surface):
    return float(surface.glass.index(587.5618))


GLASSES = [
    ("517.642", 1.517, "1.517 / 64.2"), ("517642", 1.517, "1.517 / 64.2"), ("517000.642000", 1.517, "1.517 / 64.2"),
    ("1.5168:64.17", 1.5168, "1.5168 / 64.17"), ("003.283", 2.003, "2.003 / 28.3"), ("SLAL8_OHARA", 1.712995, "S-LAL8"),
    ("nbk7_Schott", 1.5168, "N-BK7"), ("LAKN22", 1.65113, "N-LAK22"), ("'OWN'", 1.6, "OWN"),
]  # fmt: skip


@pytest.mark.parametrize(("word", "nd", "name"), GLASSES)
def test_codev_glasses(tmp_path, word, nd, name):
    private = "PRV\n PWL 656.3 587.5618 486.1\n 'OWN' 1.59 1.6 1.61\nEND\n"
    text = f"RDM\nLEN\nEPD 5\n{private}SO 0 1E11\nS 50 3 {word}\n STO\nS -50 40\nSI 0 0\n"
    glass = load_text(tmp_path, text, "a.seq").surfaces[0].glass
    assert float(glass.index(587.5618)) == pytest.approx(nd, abs=1e-5)
    assert glass.name == name


def test_a_law_of_a_private_glass(tmp_path):
    text = "RDM\nPRV\n PWL 550\n 'X' LAU 2.36390625 0.0 0.025493134\nEND\nEPD 5\nSO 0 0\nS 50 3 'X'\nS -50 9\nSI 0 0\n"
    lens = load_text(tmp_path, text, "a.seq")
    assert float(lens.surfaces[0].glass.index(550.0)) == pytest.approx(np.sqrt(2.36390625 + 0.025493134 / 0.55**2))
    with pytest.raises(InputError, match=r"a\.seq:4: the law GMX of the private glass X is unknown"):
        load_text(tmp_path, text.replace("LAU", "GMX"), "a.seq")


def test_a_catalogue_decides_between_makers(tmp_path, capsys):
    text = "RDM\nEPD 5\nSO 0 0\nS 50 3 F2\nS -50 9\nSI 0 0\n"
    lens = load_text(tmp_path, text, "a.seq")
    assert lens.surfaces[0].glass.name == "F2"
    assert any("a.seq:4: glass F2 is taken from SCHOTT; HIKARI and CDGM have" in note for note in lens.warnings)
    chosen = load_text(tmp_path, text, "a.seq", catalogues=["CDGM"])
    assert (chosen.surfaces[0].glass.name, index_d(chosen.surfaces[0])) == ("F2_CDGM", pytest.approx(1.61293, abs=1e-5))
    assert main(["lens", "info", str(tmp_path / "a.seq"), "--catalogue", "CDGM", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["focal_length_mm"] == pytest.approx(chosen.first_order().focal_length_mm)
    assert main(["lens", "info", str(tmp_path / "a.seq"), "--catalogue", "NOBODY"]) == 2


def test_codev_data_behind_the_image_count(tmp_path):
    text = "TIT 'a; b ! c'\nDIM M\nRDM N\nSO 0 1E11\nS 0.02 3 517.642\nS 0 50\nSI 0 0\n CIR 9\nEPD 8; YAN 0 5\nSTO S1\n"
    lens = load_text(tmp_path, text, "a.seq")
    assert lens.name == "a; b ! c"
    assert lens.stop_index == 0
    assert lens.first_order().entrance_pupil.diameter_mm == pytest.approx(8)
    qualified = text.replace("STO S1\n", "STO S2\nTHI S1 5\nCIR S1 6\nGLA S1 N-BK7\nCUY S2 -0.01\n")
    first, second = load_text(tmp_path, qualified, "a.seq").surfaces
    assert (first.thickness, first.semi_diameter, first.glass.name) == (5, 6, "N-BK7")
    assert second.is_stop and second.curvature == pytest.approx(-0.01)


def test_numbers_without_rdm_are_curvatures_unless_no_beam_could_cross_them(tmp_path):
    curvatures = "EPD 4\nSO 0 1E11\nS 0.02 3 517.642\nS -0.02 50\nSI 0 0\n"
    assert load_text(tmp_path, curvatures, "a.seq").surfaces[0].radius == pytest.approx(50)
    radii = load_text(tmp_path, curvatures.replace("0.02", "50"), "a.seq")
    assert radii.surfaces[0].radius == pytest.approx(50)
    assert any("no RDM: the numbers are radii" in note for note in radii.warnings)


def test_solves_and_labelled_apertures(tmp_path):
    text = "SO 0 100\nS 0.1 1 nbk7_schott\n CIR L'A' 4\nS -.05 15\n THI HMY 0.0\nSI 0 0\nEPD 8\n"
    first, second = load_text(tmp_path, text, "a.seq").surfaces
    assert (first.radius, first.semi_diameter) == (pytest.approx(10), 4)
    assert second.radius == pytest.approx(-20)


def test_decentre_and_return_and_reverse(tmp_path):
    text = "RDM\nEPD 2\nSO 0 0\nS 50 3 517.642\n ADE 10; YDE 1\n DAR\nS -50 5\nS 0 2\n ADE 20\n REV\nS 0 1\nSI 0 0\n"
    first, second, turning, last = load_text(tmp_path, text, "a.seq").surfaces
    assert first.pose.offset == pytest.approx((0, 1, 0))
    assert second.pose is None and turning.pose is None  # REV turns what follows
    assert last.pose.matrix()[:, 2] == pytest.approx([0, -np.sin(np.radians(20)), np.cos(np.radians(20))])


@pytest.mark.parametrize(
    ("said", "half_pupil"), [("FNO 5", 5.0), ("NA 0.1", 5.0), ("EPD 10", 5.0)], ids=["FNO", "NA", "EPD"]
)
def test_diameters_are_derived_and_said(tmp_path, said, half_pupil):
    text = f"RDM\n{said}\nYAN 0 10\nSO 0 1E11\nS 25.85 0.001 517.000\n STO\nS 0 50\nSI 0 0\n".replace(
        ".000\n", "000.642000\n"
    )
    lens = load_text(tmp_path, text, "a.seq")  # f = 25.85 / 0.517 = 50 mm
    assert lens.surfaces[0].semi_diameter == pytest.approx(half_pupil, rel=1e-3)
    assert any("were chosen for its pupil and field" in note for note in lens.warnings)


def test_fields_and_apertures_at_the_object(tmp_path):
    text = "RDM\nNAO 0.1\nYOB 0 5\nSO 0 100\nS 50 1 517.642\n STO\nS -50 100\nSI 0 0\n"
    first, second = load_text(tmp_path, text, "a.seq").surfaces
    assert first.semi_diameter == pytest.approx(100 * np.tan(np.arcsin(0.1)))
    assert second.semi_diameter > first.semi_diameter * 0.9


FOLDED = "RDM\nEPD 20\nYAN 0 2\nSO 0 1E13\nS 100 5 517.642\n STO\nS -100 40\nS 0 -55 REFL\n ADE 45\n BEN\nSI 0 0\n"


def test_chosen_diameters_hold_the_beam_on_tilted_surfaces_and_in_every_position(tmp_path):
    folded = load_text(tmp_path, FOLDED, "a.seq")
    edge = np.array([[0.0, y, -5.0] for y in (-9.9, 9.9)])
    for degrees in (0.0, 2.0):
        along = [0.0, np.sin(np.radians(degrees)), np.cos(np.radians(degrees))]
        start = edge - [0.0, 5 * np.tan(np.radians(degrees)), 0.0]
        assert folded.trace(start, [along, along], start="scene").passed.all()
    zoom = "RDM\nEPD 6\nYAN 0 1\nSO 0 1E13\nS 0 1\n STO\nS 60 4 517.642\nS -60 30\nS -40 2 517.642\nS 40 50\nSI 0 0\n"
    wide = load_text(tmp_path, zoom + "ZOO 2\nZOO TIT 'wide end' 'tele'\nZOO EPD 6 20\nZOO THI S3 30 20\n", "b.seq")
    assert [each.name for each in wide.configurations] == ["wide end", "tele"]
    tele = in_configuration(wide, "tele")
    assert tele.trace([[0, 9.99, -5], [0, -9.99, -5]], [[0, 0, 1]] * 2, start="scene").passed.all()


def test_no_diameter_and_no_pupil_is_refused(tmp_path):
    with pytest.raises(InputError, match="gives no diameters, and no pupil or f-number"):
        load_text(tmp_path, "RDM\nSO 0 0\nS 50 3 517.642\nS -50 9\nSI 0 0\n", "a.seq")


def test_surfaces_that_codev_alone_knows_are_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"a\.seq:5: a grating \(GRT\) cannot be read"):
        load_text(tmp_path, "RDM\nEPD 2\nSO 0 0\nS 50 3 517.642\n GRT\nS -50 9\nSI 0 0\n", "a.seq")


FLOAT = """\
MODE SEQ
UNIT MM
FLOA
GCAT CDGM MISC
FTYP 1 0 1 1
YFLN 0 10
SURF 0
  CURV 0
  DISZ 200
SURF 1
  CURV 0.02
  DISZ 5
  GLAS F2 0 0 1.5 40
SURF 2
  CURV -0.02
  DISZ 10
  SQAP 4 3
SURF 3
  STOP
  CURV 0
  DISZ 3
  DIAM 4 1 0 0 1 ""
SURF 4
  CURV 0.01
  DISZ 40
  GLAS ACRYLIC 0 0 1.5 40
  TTHI 2 3
SURF 5
  CURV 0
  DISZ 0
EFFL 0 2 0 0
MNUM 3
"""


def test_zemax_by_the_stop_with_its_own_catalogues(tmp_path):
    lens = load_text(tmp_path, FLOAT, "a.zmx")
    assert [surface.glass.name for surface in lens.surfaces] == ["F2_CDGM", "air", "air", "PMMA-Sultanova"]
    assert lens.stop.semi_diameter == pytest.approx(4)
    assert lens.surfaces[1].region.half_width == pytest.approx(4)
    assert all(surface.semi_diameter > 4 for surface in lens.surfaces[:2])
    assert {note.split(": ", 1)[1] for note in lens.warnings if ".zmx:" in note} == {
        "glass ACRYLIC is taken as PMMA-Sultanova (PLASTIC)",
        "its 3 positions move no surfaces: it is read as saved",
        "diameters that the file does not give were chosen for its pupil and field",
    }


def test_a_glass_that_no_catalogue_has_is_taken_by_its_index(tmp_path):
    lens = load_text(tmp_path, FLOAT.replace("F2 0 0 1.5 40", "MYSTERY7 0 0 1.517 64.2"), "a.zmx")
    assert any(
        "glass MYSTERY7 is replaced by the index 1.517 and Abbe number 64.2 beside it; the nearest known is" in note
        for note in lens.warnings
    )


def test_a_lone_number_before_a_table_is_the_focal_length(tmp_path):
    lens = load_text(tmp_path, "# focal length\n6.0\n8 2 1.6 4\n0 0.5 0 3\n-8 0 1 4\n", "a.dat")
    assert lens.published == {"focal_length_mm": 6.0}
    assert (len(lens.surfaces), lens.stop_index) == (3, 1)


def test_iset_with_spectral_indices_and_names(tmp_path):
    ior = [[400, 550, 700], [1.7, 1.68, 1.67]]
    rows = [
        {"radius": 50, "thickness": 3, "ior": ior, "semi_aperture": 5},
        {"radius": -50, "thickness": 3, "ior": "N-SF5", "semi_aperture": 5},
        {"radius": 80, "thickness": 0, "ior": 1, "semi_aperture": 5},
    ]
    lens = load_text(tmp_path, json.dumps({"name": "x", "surfaces": rows}), "a.json")
    assert lens.surfaces[0].glass.index([400, 475, 550]).tolist() == pytest.approx([1.7, 1.69, 1.68])
    assert lens.surfaces[1].glass.name == "N-SF5"
    rows[0]["ior"] = [[400, 500], [1.6]]
    with pytest.raises(InputError, match=r"surfaces\[0\]\.ior: expected a list of wavelengths and one of as many"):
        load_text(tmp_path, json.dumps({"name": "x", "surfaces": rows}), "a.json")


DEEPLENS = {
    "info": "A lens",
    "foclen": 50.0,
    "surfaces": [
        {"type": "Aperture", "r": 4.0, "d_next": 1.0},
        {"type": "Aspheric", "r": 5.0, "c": 0.02, "roc": 50.0, "k": -0.5, "ai": [1e-4, 2e-6], "mat2": "1.62/57.0",
         "d_next": 3.0},
        {"type": "Aspheric", "r": 5.0, "c": -0.02, "ai": [3e-6], "use_ai2": False, "mat2": "coc", "d_next": 2.0},
        {"type": "Spheric", "r": 5.0, "roc": 1e14, "mat2": "n-sk16", "d_next": 2.0},
        {"type": "Plane", "r": 5.0, "mat2": "air", "d_next": 9.0},
    ],
}  # fmt: skip


def test_deeplens(tmp_path):
    lens = load_text(tmp_path, json.dumps(DEEPLENS), "a.json")
    stop, first, second, third, last = lens.surfaces
    assert (lens.name, lens.stop_index, stop.thickness) == ("A lens", 0, 1)
    assert (first.radius, first.conic, first.semi_diameter) == (50, -0.5, 5)
    assert first.aspheric == ((2, 1e-4), (4, 2e-6)) and second.aspheric == ((4, 3e-6),)
    assert [index_d(surface) for surface in (first, second, third)] == pytest.approx([1.62, 1.5337, 1.62041], abs=1e-5)
    assert third.curvature == 0 and last.curvature == 0
    for change, message in [
        ({"type": "ThinLens"}, r"surfaces\[0\]\.type: a surface ThinLens cannot be read; known: Aperture"),
        ({"r": "wide"}, r"surfaces\[0\]\.r: expected a number \(got 'wide'\)"),
    ]:
        bad = DEEPLENS | {"surfaces": [DEEPLENS["surfaces"][0] | change, *DEEPLENS["surfaces"][1:]]}
        with pytest.raises(InputError, match=message):
            load_text(tmp_path, json.dumps(bad), "a.json")
    with pytest.raises(InputError, match="DOE: a diffractive element cannot be read"):
        load_text(tmp_path, json.dumps(DEEPLENS | {"DOE": {}}), "a.json")


def test_formats_that_are_not_ours_are_named(tmp_path):
    with pytest.raises(InputError, match="is an ISET ray transfer"):
        load_text(tmp_path, '{"name": "x", "polynomials": []}', "a.json")
    with pytest.raises(InputError, match=r"a\.zar: is a Zemax archive, which cannot be read; known: \.yaml"):
        load_text(tmp_path, "x", "a.zar")
