"""Glass catalogues, materials of refractiveindex.info and the bundled table."""

import subprocess
import sys

import numpy as np
import pytest

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.glasses import (
    MAKERS,
    chosen_makers,
    find_glass,
    glasses_of,
    glasses_of_agf,
    makers_of,
    named_glass,
    near_glass_words,
    near_names,
    read_refractive_index,
)
from rptcam_cl.optics.glass import GLASSES, TabulatedIndex, abbe_number, attenuation, known_range, stated_range
from rptcam_cl.optics.library import load_lens

# Index and Abbe number as the SCHOTT catalogue prints them.
PRINTED = {
    "N-BK7": (1.51680, 64.17),
    "F2": (1.62004, 36.37),
    "N-SK16": (1.62041, 60.32),
    "SF11": (1.78472, 25.76),
    "N-LAK12": (1.67790, 55.20),
    "LF5": (1.58144, 40.85),
    "K10": (1.50137, 56.41),
    "N-SSK2": (1.62229, 53.27),
    "fused silica": (1.45846, 67.82),
    "CaF2": (1.43385, 95.0),
    "water": (1.3334, 55.8),
}


@pytest.mark.parametrize("name", PRINTED)
def test_bundled_glass_has_the_printed_numbers(name):
    nd, vd = PRINTED[name]
    assert float(GLASSES[name].index(587.5618)) == pytest.approx(nd, abs=1e-5 if name != "water" else 1e-4)
    assert abbe_number(GLASSES[name]) == pytest.approx(vd, abs=0.01 if name not in ("water", "CaF2") else 0.1)


AGF = """\
CC a catalogue
NM N-BK7 2 517642.251 1.5168 64.17 0 1 0
ED 7.1 8.3 2.51 -0.0009 0
CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653 0 0 0 0
LD 0.3 2.5
NM BK7OLD 1 517642 1.5168 64.17 0 1 0
CD 2.2718929 -1.0108077e-2 1.0592509e-2 2.0816965e-4 -7.6472538e-6 4.9240991e-7
LD 0.3 2.3
NM ODD 3 1 1.5 60 0 1 0
CD 1 2 3
"""

RII = """\
REFERENCES: "a"
DATA:
  - type: formula 2
    wavelength_range: 0.3 2.5
    coefficients: 0 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653
  - type: tabulated k
    data: |
        0.3 2.8E-06
        0.4 1.0E-06
"""


def test_zemax_catalogue(tmp_path):
    path = tmp_path / "x.agf"
    path.write_bytes(AGF.encode("utf-16"))
    glasses = glasses_of_agf(path.read_bytes(), path)
    assert list(glasses) == ["N-BK7", "BK7OLD"]
    for glass in glasses.values():
        assert float(glass.index(587.5618)) == pytest.approx(1.5168, abs=3e-6)
    with pytest.raises(InputError, match=r"glass N-BK7 is known from 300 to 2500 nm"):
        glasses["N-BK7"].index(200.0)


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        ("formula 1\n    coefficients: 0 0.6961663 0.0684043 0.4079426 0.1162414 0.8974794 9.896161", 1.45846),
        ("formula 3\n    coefficients: 2.2718929 -1.0108077e-2 2 1.0592509e-2 -2 2.0816965e-4 -4", 1.51685),
        ("formula 5\n    coefficients: 1.5 0.004 -2", 1.5 + 0.004 / 0.5875618**2),
        ("tabulated nk\n    data: |\n        0.5 1.6 0.1\n        0.6 1.5 0.1\n", 1.5124382),
    ],
)
def test_materials_of_refractiveindex_info(tmp_path, block, expected):
    path = tmp_path / "x.yml"
    path.write_text(f"DATA:\n  - type: {block}\n    wavelength_range: 0.3 2.5\n")
    assert float(read_refractive_index(path).index(587.5618)) == pytest.approx(expected, abs=1e-5)


def test_lens_files_name_catalogues_beside_them(tmp_path):
    (tmp_path / "x.agf").write_text(AGF)
    (tmp_path / "bk7.yml").write_text(RII)
    text = "name: x\nsurfaces:\n  - {{radius: 50, thickness: 3, diameter: 20, glass: {}}}\n  - {{diameter: 20}}\n"
    for glass in ("{catalogue: x.agf, name: n-bk7}", "{refractiveindex: bk7.yml}"):
        path = tmp_path / "lens.yaml"
        path.write_text(text.format(glass))
        assert float(load_lens(path).surfaces[0].glass.index(587.5618)) == pytest.approx(1.5168, abs=1e-7)
    path.write_text(text.format("{catalogue: x.agf, name: N-BK8}"))
    with pytest.raises(InputError, match=r"surfaces\[0\]\.glass\.name: no such glass in x\.agf; did you mean N-BK7"):
        load_lens(path)
    path.write_text(text.format("{catalogue: absent.agf, name: N-BK8}"))
    with pytest.raises(InputError, match=r"surfaces\[0\]\.glass\.catalogue: no such file"):
        load_lens(path)


@pytest.mark.parametrize("name", ["B270", "EagleXG", "E48R", "H-ZF12", "PMMA-Bodurov", "GLS", "LaF3-o"])
def test_laws_that_end_in_visible_light_are_continued_with_a_word(name):
    glass = find_glass(name)
    (low, high), (first, last) = stated_range(glass), known_range(glass)
    assert (first, last) == (max(400, low - 50) if low > 400 else low, min(700, high + 50) if high < 700 else high)
    nm = np.linspace(max(first, 380), min(last, 800), 400)
    index = glass.index(nm)
    assert np.all(np.diff(index) < 0) and np.abs(np.diff(index)).max() < 2e-3  # neither jumps nor turns
    with pytest.raises(InputError, match=f"is known from {first:g} to"):
        glass.index(first - 1)
    lens = load_lens({"surfaces": [{"radius": 50, "thickness": 3, "glass": name, "diameter": 9}, {"diameter": 9}]})
    (warning,) = lens.warnings
    assert warning.startswith(f"glass {glass.name} is known from {low:g} to {high:g} nm; its law is continued to")


def test_a_table_is_continued_as_cauchy_has_it():
    nm = np.array([450, 480, 520, 550, 590, 620, 650.0])

    def law(nm):
        return 1.5 + 0.004 / (nm / 1e3) ** 2 + 1e-4 / (nm / 1e3) ** 4

    glass = TabulatedIndex(tuple(nm), tuple(law(nm)))
    for end in (400.0, 425.0, 675.0, 700.0):
        assert float(glass.index(end)) == pytest.approx(law(end), abs=1e-9)
    assert float(TabulatedIndex((587.0,), (1.5,)).index(600.0)) == 1.5
    for far in (399.0, 701.0):
        with pytest.raises(InputError, match="known from 400 to 700 nm"):
            glass.index(far)


def test_bad_catalogues_are_refused(tmp_path):
    path = tmp_path / "bad.agf"
    path.write_text("NM X\n")
    with pytest.raises(InputError, match=r"bad\.agf:1: cannot read this NM line"):
        glasses_of_agf(path.read_bytes(), path)
    path.write_text("nothing\n")
    with pytest.raises(InputError, match="no glass with a known formula"):
        glasses_of_agf(path.read_bytes(), path)
    path.write_text("DATA:\n  - type: formula 9\n")
    with pytest.raises(InputError, match=r"no dispersion formula that is known \(has 'formula 9'"):
        read_refractive_index(path)
    path.write_text("DATA:\n  - type: formula 2\n    coefficients: a b\n    wavelength_range: 0.3 2.5\n")
    with pytest.raises(InputError, match="cannot read the block of type 'formula 2'"):
        read_refractive_index(path)


# n_d and V_d as the makers' data sheets print them
DATA_SHEETS = {
    "N-LAK9": (1.69100, 54.71), "S-LAL8": (1.71300, 53.87), "S-TIH53": (1.84666, 23.78), "FCD1": (1.49700, 81.61),
    "TAF3": (1.80420, 46.50), "J-LAK02": (1.67000, 57.35), "H-K9L": (1.51680, 64.21),
    "N-BK7": (1.51680, 64.17), "F2_CDGM": (1.61293, 37.00),
}  # fmt: skip


@pytest.mark.parametrize("name", DATA_SHEETS)
def test_glasses_have_the_index_of_their_data_sheet(name):
    nd, vd = DATA_SHEETS[name]
    glass = find_glass(name)
    assert float(glass.index(LINE_D_NM)) == pytest.approx(nd, abs=1e-5)
    assert abbe_number(glass) == pytest.approx(vd, abs=0.02)


def test_every_glass_has_the_index_that_its_maker_prints():
    checked = 0
    for maker in MAKERS:
        for glass in glasses_of(maker).values():
            law = find_glass(f"{glass.name}_{maker}")
            low, high = stated_range(law) or (0, 0)
            if glass.nd and low <= LINE_D_NM <= high:
                tolerance = 6e-4 if glass.name in ("BOROFLOAT33", "CaF2") else 5e-5  # three decimals; Malitson
                assert float(law.index(LINE_D_NM)) == pytest.approx(glass.nd, abs=tolerance), glass
                checked += 1
    assert checked > 1600


def test_bundled_glasses_keep_their_numbers():
    for name, medium in GLASSES.items():
        assert find_glass(name) is medium
        assert find_glass(name.lower().replace("-", "")) is medium


MEANINGS = [
    ("NBK7_SCHOTT", (), "N-BK7"), ("nbk7_Schott", (), "N-BK7"), ("'S-LAL8'", (), "S-LAL8"),
    ("SLAL8_OHARA", (), "S-LAL8"),
    ("F2", (), "F2"), ("F2", ("cdgm",), "F2_CDGM"), ("F2_HIKARI", (), "F2_HIKARI"), ("F2", ("schott", "cdgm"), "F2"),
    ("SILICA", (), "fused silica"), ("F_SILICA", ("plastic",), "fused silica"), ("C79-80", (), "fused silica"),
    ("ACRYLIC", (), "PMMA-Sultanova"), ("POLYCARB", (), "PC-Sultanova"), ("E48", (), "E48R"), ("hk51", (), "H-K51"),
    ("BK7", (), "N-BK7"), ("LAKN22", (), "N-LAK22"), ("LAK9", (), "N-LAK9"), ("LAK9", ("hikari",), "LAK9"),
    ("L-TIM28_MOLD", (), "L-TIM28"), ("BAF2", ("crystran",), "BaF2_CRYSTRAN"), ("N-BK7", ("hikari",), "N-BK7"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "makers", "written"), MEANINGS)
def test_names_and_aliases_mean_their_glass(name, makers, written):
    found = named_glass(name, makers, successors=True)
    assert found.written == written
    assert find_glass(written).name == written
    assert named_glass(written).written == written


def test_a_choice_between_makers_is_told():
    assert named_glass("F2").remark("F2") == (
        "glass F2 is taken from SCHOTT; HIKARI and CDGM have one each of that name too (--catalogue decides)"
    )
    assert named_glass("F2", ("schott",)).remark("F2") == ""
    assert named_glass("N-SF5").remark("N-SF5") == ""
    assert named_glass("BK7", successors=True).remark("BK7") == "glass BK7 is taken as N-BK7 (SCHOTT)"


def test_catalogues_are_known_by_their_names():
    assert makers_of("SUMITA_AUG2011") == ("sumita",)
    assert makers_of("NOBODY") == ()
    assert chosen_makers(["Schott", "HOYA"]) == ("schott", "hoya")
    with pytest.raises(InputError, match=r"no glass catalogue 'NOBODY'.*allowed: SCHOTT, OHARA"):
        chosen_makers(["NOBODY"])


def test_the_nearest_glass_is_suggested():
    assert near_names("N-BK8")[:2] == ["BK8 (LZOS)", "N-BK7 (SCHOTT)"]
    assert near_glass_words(1.5168, 64.17) == "N-BK7 (SCHOTT) 1.5168 / 64.17"
    with pytest.raises(InputError, match=r"unknown glass; did you mean S-LAL8 \(OHARA\)"):
        load_lens({"surfaces": [{"radius": 50, "thickness": 3, "diameter": 9, "glass": "S-LAL88"}, {"diameter": 9}]})


def test_glasses_absorb_as_their_maker_says():
    n_sf5 = find_glass("N-SF5")  # SCHOTT's data sheet: internal transmittance over 10 mm at 400, 420 and 546 nm
    assert np.exp(-10 * attenuation(n_sf5, [400.0, 420.0, 546.0])) == pytest.approx([0.905, 0.963, 0.995], abs=6e-4)


def test_no_catalogue_is_read_for_bundled_lenses():
    code = (
        "from rptcam_cl.optics.library import load_lens\n"
        "from rptcam_cl.optics.files import glasses as makers\n"
        "load_lens('cooke-triplet-50mm')\nassert makers._makers_text.cache_info().currsize == 0"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


BAD_TABLES = [
    ({"wavelengths_nm": [400, 700], "values": [1.5]}, "needs one index for each wavelength"),
    ({"wavelengths_nm": [700, 400], "values": [1.5, 1.6]}, "must be above 0 and rise"),
    ({"wavelengths_nm": [400, 700], "values": [1.5, 15]}, "a refractive index lies between"),
]


@pytest.mark.parametrize(("table", "message"), BAD_TABLES)
def test_bad_tables_of_indices_are_refused(table, message):
    rows = [{"radius": 50, "thickness": 3, "diameter": 9, "glass": {"table": table}}, {"diameter": 9}]
    with pytest.raises(InputError, match=message):
        load_lens({"surfaces": rows})


@pytest.mark.parametrize(
    ("name", "nd", "words"),
    [
        ("CAF2_DAIMON-20", 1.43385, "glass CAF2_DAIMON-20 is taken as CaF2"),
        ("SIO2_MALITSON", 1.45846, "taken as fused silica"),
        ("PMMA_SZCZUROWSKI", 1.4906, "taken as PMMA-Szczurowski"),
        ("SK19_Schott", 1.613, "taken as 1.613 / 57.4, the code 613574 of SCHOTT's old catalogues"),
        ("sk19", 1.613, "the code 613574"),
        ("SK1", 1.610, "1.61 / 56.7, the code 610567 of SCHOTT's old catalogues; P-SK60 (SCHOTT) 1.61035 / 57.9"),
    ],
)
def test_names_with_their_authors_and_of_old_glasses_are_taken_with_a_word(tmp_path, name, nd, words):
    path = tmp_path / "a.seq"
    path.write_text(f"RDM\nEPD 5\nSO 0 1E11\nS 50 5 {name}\n STO\nS -50 45\nSI 0 0\n")
    lens = load_lens(path)
    assert float(lens.surfaces[0].glass.index(587.5618)) == pytest.approx(nd, abs=2e-4)
    assert any(words in note for note in lens.warnings)
    for unknown in ("SK19_HOYA", "XYZ_DAIMON-20"):
        path.write_text(f"RDM\nEPD 5\nSO 0 1E11\nS 50 5 {unknown}\n STO\nS -50 45\nSI 0 0\n")
        with pytest.raises(InputError, match=f"glass {unknown} is in no catalogue"):
            load_lens(path)


@pytest.mark.parametrize("name", ["SCHOTT_N-BK7", "Schott N-BK7", "schott:nbk7"])
def test_the_maker_may_stand_in_front(name):
    from rptcam_cl.optics.files.glasses import named_glass

    assert named_glass(name) == named_glass("N-BK7_SCHOTT")
    assert named_glass("OHARA_S-LAH60").maker == "ohara"
    assert named_glass("SCHOTT_NO-SUCH") is None
