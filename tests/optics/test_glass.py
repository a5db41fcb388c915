"""Glass catalogues, materials of refractiveindex.info and the bundled table."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.glasses import find_glass, glasses_of_agf, read_refractive_index
from rptcam_cl.optics.glass import GLASSES, TabulatedIndex, abbe_number, known_range, stated_range
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
