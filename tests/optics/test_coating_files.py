"""Coatings and absorption in lens files: what is read, written back, and refused."""

import copy

import numpy as np
import pytest
import yaml

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders, References
from rptcam_cl.optics.files.export import lens_text
from rptcam_cl.optics.files.glasses import glasses_of_agf, read_refractive_index
from rptcam_cl.optics.glass import (
    BARE,
    MAGNESIUM_FLUORIDE,
    Layer,
    LayerStack,
    MeasuredReflectance,
    QuarterWave,
    attenuation,
)
from rptcam_cl.optics.library import load_lens

LAYERS = {"layers": [{"index": 1.38, "thickness_nm": 99.6}, {"index": 2.1, "thickness_nm": 131}]}
SPECTRUM = {"wavelengths_nm": [400, 550, 700], "values": [0.01, 0.002, 0.02]}
INSIDE = {"thickness_mm": 10, "wavelengths_nm": [400, 700], "values": [0.9, 0.99]}


def doublet(**keys):
    rows = [
        {"radius": 50, "thickness": 5, "glass": {"nd": 1.6, "vd": 60}, "diameter": 20},
        {"radius": -50, "thickness": 3, "glass": {"nd": 1.7, "vd": 30}, "diameter": 20},
        {"thickness": 3, "diameter": 20},
        {"stop": True, "diameter": 10},
    ]
    return copy.deepcopy({"name": "doublet", "surfaces": rows} | keys)


def coatings(document):
    return [surface.coating for surface in load_lens(document).surfaces]


def test_coating_of_the_lens_and_of_single_surfaces():
    document = doublet(coating="mgf2")
    assert coatings(document) == [MAGNESIUM_FLUORIDE, None, MAGNESIUM_FLUORIDE, None]
    document["surfaces"][2]["coating"] = {"reflectance": 0.005}
    assert coatings(document)[2] == MeasuredReflectance((0.0,), (0.005,))
    document["surfaces"][2]["coating"] = "bare"
    assert coatings(document)[2] == BARE
    document["surfaces"][1]["coating"] = {"quarter_wave": {"index": 1.65, "wavelength_nm": 500}}
    assert coatings(document)[1] == QuarterWave(1.65, 500)
    document["surfaces"][1]["coating"] = {"layers": [{"index": 1.65, "thickness_nm": 100}]}  # today's single layer
    assert coatings(document)[1] == QuarterWave(1.65, 660.0)
    document["surfaces"][0]["coating"] = LAYERS
    assert coatings(document)[0] == LayerStack((Layer(1.38, 99.6), Layer(2.1, 131.0)))
    assert coatings(doublet()) == [None] * 4


@pytest.mark.parametrize("head", ["", "wavelength_nm,reflectance\n", "# measured\nnm;R\n"])
def test_reflectance_from_a_file_beside_the_lens(tmp_path, head):
    (tmp_path / "coat.csv").write_text(head + "400, 0.01\n550, 0.002  # best\n\n700, 0.02\n")
    path = tmp_path / "lens.yaml"
    path.write_text(
        "coating: {reflectance: coat.csv}\nsurfaces:\n"
        "  - {thickness: 5, glass: {index: 1.5}, diameter: 9}\n  - {diameter: 9}\n"
    )
    expected = MeasuredReflectance((400.0, 550.0, 700.0), (0.01, 0.002, 0.02))
    assert [surface.coating for surface in load_lens(path).surfaces] == [expected] * 2


@pytest.mark.parametrize("text", ["400,0.01\n300,0.02\n", "400,1.5\n500,1\n", "400,0.01,3\n", "400,0.1\nx,y\n", "a\n"])
def test_file_that_is_no_spectrum_is_refused_by_its_name(tmp_path, text):
    (tmp_path / "coat.csv").write_text(text)
    with pytest.raises(InputError, match=r"coat\.csv:") as refused:
        load_lens(doublet(coating={"reflectance": "coat.csv"}), References(Folders(tmp_path)))
    assert "no such file" not in str(refused.value)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"coating\.reflectance: no such file \(got .*missing\.csv\)"):
        load_lens(doublet(coating={"reflectance": "missing.csv"}), References(Folders(tmp_path)))


@pytest.mark.parametrize(
    ("coating", "message"),
    [
        ("shiny", r"coating: unknown coating; allowed: bare, mgf2, multi, \{quarter_wave: …\}"),
        (3, r"coating: allowed: bare"),
        ({}, r"coating: needs exactly one of quarter_wave, layers, reflectance"),
        ({"quarter_wave": {"index": 1.38}}, r"coating\.quarter_wave: wavelength_nm is missing"),
        ({"quarter_wave": {"index": 0.9, "wavelength_nm": 550}}, r"index of a layer lies between 1 and 5"),
        ({"layers": []}, r"layers: has 1 to 12 layers, not 0"),
        ({"layers": [{"index": 0.2, "thickness_nm": 5}]}, r"layers\[0\]\.index: the index of a layer lies between"),
        ({"layers": [{"index": 1.4, "thickness_nm": 5, "extinction": -1}]}, r"extinction: lies between 0 and 20"),
        ({"layers": [{"index": 9, "thickness_nm": 5, "extinction": 1}]}, r"layers\[0\]\.index: the index of a layer"),
        ({"layers": [{"index": 1.4}]}, r"coating\.layers\[0\]: thickness_nm is missing"),
        ({"layers": [{"index": 1.4, "thickness_nm": 0}]}, r"thickness_nm: must be above 0"),
        ({"reflectance": 5}, r"coating\.reflectance: lies between 0 and 1, not in percent"),
        ({"reflectance": SPECTRUM | {"values": [1, 2, 3]}}, r"reflectance\.values: a reflectance lies between 0 and 1"),
        ({"reflectance": SPECTRUM | {"values": [0.1]}}, r"values: needs as many numbers as wavelengths_nm"),
        ({"reflectance": SPECTRUM | {"wavelengths_nm": [5, 4, 6]}}, r"wavelengths_nm: must rise, above 0"),
    ],
)
def test_coating_that_is_none_is_refused(coating, message):
    with pytest.raises(InputError, match=message):
        load_lens(doublet(coating=coating))


def test_layer_must_suit_its_surface():
    document = doublet()
    document["surfaces"][1]["coating"] = "mgf2"
    with pytest.raises(InputError, match=r"surfaces\[1\]\.coating: a layer of index 1\.38 is less dense than both"):
        load_lens(document)
    document = doublet()
    document["surfaces"][3]["coating"] = "mgf2"
    with pytest.raises(InputError, match=r"surfaces\[3\]\.coating: has air on both sides"):
        load_lens(document)


def test_absorption_of_a_glass():
    document = doublet()
    document["surfaces"][0]["glass"]["transmittance"] = INSIDE
    glass = load_lens(document).surfaces[0].glass
    np.testing.assert_allclose(np.exp(-10 * attenuation(glass, [400.0, 700.0])), [0.9, 0.99], rtol=1e-12)
    document["surfaces"][0]["glass"]["transmittance"] = INSIDE | {"thickness_mm": 0}
    with pytest.raises(InputError, match=r"transmittance\.thickness_mm: must be above 0"):
        load_lens(document)
    document["surfaces"][0]["glass"]["transmittance"] = INSIDE | {"values": [90, 99]}
    with pytest.raises(InputError, match=r"a transmittance lies between 0 and 1"):
        load_lens(document)


def test_lens_with_losses_is_written_as_it_was_read():
    document = doublet(coating={"reflectance": SPECTRUM})
    document["surfaces"][0]["coating"] = LAYERS
    document["surfaces"][2]["coating"] = "mgf2"
    document["surfaces"][0]["glass"]["transmittance"] = INSIDE
    lens = load_lens(document)
    again = load_lens(yaml.safe_load(lens_text(lens)))
    assert [s.coating for s in again.surfaces] == [s.coating for s in lens.surfaces]
    written, read = again.surfaces[0].glass.absorption, lens.surfaces[0].glass.absorption
    np.testing.assert_allclose(written.per_mm, read.per_mm, rtol=1e-12)
    assert written.wavelengths_nm == read.wavelengths_nm


def test_catalogue_says_what_a_glass_absorbs(tmp_path):
    path = tmp_path / "x.agf"
    path.write_text(
        "NM GLASS 1 517642 1.5168 64.17 0 1 0\n"
        "CD 2.2718929 -1.0108077e-2 1.0592509e-2 2.0816965e-4 -7.6472538e-6 4.9240991e-7\n"
        "IT 0.70 0.99 25.0\nIT 0.40 0.95 10.0\nIT 0.30 0.0 25.0\n"
        "NM CLEAR 1 517642 1.5168 64.17 0 1 0\nCD 2.27 -0.01 0.01 0 0 0\n"
    )
    glasses = glasses_of_agf(path.read_bytes(), path)
    assert glasses["CLEAR"].absorption is None
    alpha = attenuation(glasses["GLASS"], [300.0, 400.0, 700.0])
    np.testing.assert_allclose(np.exp(-alpha * [25, 10, 25]), [1e-6, 0.95, 0.99], rtol=1e-9)


@pytest.mark.parametrize(
    "block",
    [
        "formula 5\n    wavelength_range: 0.3 2\n    coefficients: 1.5\n  - type: tabulated k\n    data: |\n"
        "        0.4 1e-8\n        0.7 2e-8\n",
        "tabulated nk\n    data: |\n        0.4 1.5 1e-8\n        0.7 1.5 2e-8\n",
    ],
)
def test_extinction_of_refractiveindex_info(tmp_path, block):
    path = tmp_path / "glass.yml"
    path.write_text(f"DATA:\n  - type: {block}")
    expected = 4 * np.pi * np.array([1e-8 / 400e-6, 2e-8 / 700e-6])  # 4 pi k / wavelength [1/mm]
    np.testing.assert_allclose(attenuation(read_refractive_index(path), [400.0, 700.0]), expected, rtol=1e-12)
