"""Glasses of the makers by name: which one a name means, and its numbers."""

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
    makers_of,
    named_glass,
    near_glass_words,
    near_names,
)
from rptcam_cl.optics.glass import GLASSES, abbe_number, attenuation, stated_range
from rptcam_cl.optics.library import load_lens

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
