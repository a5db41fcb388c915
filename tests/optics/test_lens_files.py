"""Our own lens form: what it says, and what is refused with file, place and key."""

import json
import re

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.optics.files.export import lens_text
from rptcam_cl.optics.files.native import LONGEST_PLAUSIBLE_MM, crossed_surfaces
from rptcam_cl.optics.glass import abbe_number
from rptcam_cl.optics.library import list_lenses, load_lens

SINGLET = """\
name: Singlet
source: test
surfaces:
  - {radius: 51.5, thickness: 3.6, glass: {index: 1.5168}, diameter: 25.4}
  - {diameter: 25.4}
"""


def from_text(tmp_path, text, name="lens.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return load_lens(path)


def test_every_form_gives_the_same_lens(tmp_path):
    as_yaml = from_text(tmp_path, SINGLET)
    data = {
        "name": "Singlet",
        "source": "test",
        "surfaces": [
            {"radius": 51.5, "thickness": 3.6, "glass": {"index": 1.5168}, "diameter": 25.4},
            {"diameter": 25.4},
        ],
    }
    assert from_text(tmp_path, json.dumps(data), "lens.json") == as_yaml
    assert load_lens(data) == as_yaml
    tuples = {**data, "surfaces": tuple({**row, "diameter": np.float64(25.4)} for row in data["surfaces"])}
    assert load_lens(tuples) == as_yaml


def test_units_scale_every_length(tmp_path):
    metres = SINGLET.replace("source: test", "unit: m").replace("51.5", "0.0515").replace("3.6", "0.0036")
    lens = from_text(tmp_path, metres.replace("25.4", "0.0254"))
    assert lens.first_order().focal_length_mm == pytest.approx(
        from_text(tmp_path, SINGLET).first_order().focal_length_mm
    )
    assert lens.warnings == ()


def test_lengths_a_thousand_times_too_long_are_doubted(tmp_path):
    lens = from_text(tmp_path, SINGLET.replace("source: test", "unit: m"))
    assert lens.first_order().focal_length_mm > LONGEST_PLAUSIBLE_MM
    assert lens.warnings == ("focal length 99651.7 mm: are the lengths in metres or micrometres?",)


def test_rims_of_an_element_that_cross_are_doubted(tmp_path):
    wide = SINGLET.replace("{diameter: 25.4}", "{radius: -51.5, diameter: 40}").replace("3.6", "4")
    sags = (51.5 - np.sqrt(51.5**2 - 12.7**2)) + (51.5 - np.sqrt(51.5**2 - 20**2))
    assert from_text(tmp_path, wide).warnings == (
        f"the rims of the glass between surfaces 0 and 1 cross by {sags - 4:.4g} mm",
    )


def test_surfaces_that_cross_are_doubted_and_traced_in_their_order(tmp_path):
    thin = "surfaces:\n  - {radius: 51.5, thickness: 0.5, glass: {index: 1.5}, diameter: 25.4}\n  - {diameter: 25.4}\n"
    lens = from_text(tmp_path, thin)
    (warning,) = lens.warnings
    assert warning.startswith("surfaces 0 and 1 cross: they overlap by 1.09") and "12.7 mm from the axis" in warning
    rays = lens.trace([[0, 12, -50]], [[0, 0, 1]], start="scene")  # meets the plane first, the sphere 0.92 mm behind it
    sag = 51.5 - np.sqrt(51.5**2 - 144)
    slope = np.tan(np.arcsin(12 / 51.5) - np.arcsin(12 / 51.5 / 1.5))  # Snell's law at the sphere
    assert rays.origins[0] == pytest.approx([0, 12 + (sag - 0.5) * slope, 0.5])
    assert rays.directions[0, 1] == pytest.approx(-1.5 * np.sin(np.arctan(slope)))


def test_a_negative_thickness_is_doubted_and_traced(tmp_path):
    back = "surfaces:\n  - {thickness: -2, diameter: 9}\n  - {radius: 50, thickness: 4, glass: {index: 1.5}, "
    lens = from_text(tmp_path, back + "diameter: 9}\n  - {diameter: 9}\n")
    assert "the thickness behind surface 0 is negative (-2 mm)" in lens.warnings[0]
    assert lens.trace([[0, 1, -9]], [[0, 0, 1]], start="scene").origins[0, 2] == pytest.approx(2)


def test_a_lens_faster_than_any_can_be_is_doubted(tmp_path):
    tiny = "surfaces:\n  - {stop: true, thickness: 1, diameter: 10}\n  - {radius: 0.05, "
    lens = from_text(tmp_path, tiny + "diameter: 0.09, glass: {index: 1.5}}\n")
    assert any("are the radii curvatures?" in text for text in lens.warnings)


@pytest.mark.parametrize("name", list_lenses())
def test_no_rims_cross_in_the_library(name):
    assert not crossed_surfaces(load_lens(name))


def glass_index(tmp_path, glass, wavelength):
    return float(from_text(tmp_path, SINGLET.replace("{index: 1.5168}", glass)).surfaces[0].glass.index(wavelength))


@pytest.mark.parametrize("name", ["N-BK7", "n-bk7"])
def test_named_glass(tmp_path, name):
    values = [glass_index(tmp_path, name, wavelength) for wavelength in (587.5618, 486.1327, 656.2725)]
    assert values == pytest.approx([1.5168000, 1.5223763, 1.5143223], abs=5e-8)


def test_abbe_number_of_bk7(tmp_path):
    glass = from_text(tmp_path, SINGLET.replace("{index: 1.5168}", "N-BK7")).surfaces[0].glass
    assert abbe_number(glass) == pytest.approx(64.167, abs=5e-4)


def test_nd_and_vd_are_met_by_the_two_term_law(tmp_path):
    glass = from_text(tmp_path, SINGLET.replace("{index: 1.5168}", "{nd: 1.601, vd: 50.277746}")).surfaces[0].glass
    assert glass.index([587.5618, 486.1327, 656.2725]) == pytest.approx(
        [1.601, 1.6093555913342656, 1.5974019926188419], abs=1e-12
    )
    assert abbe_number(glass) == pytest.approx(50.277746)


def test_linear_law_of_the_paper(tmp_path):
    for v, expected in {
        3: [2.0966, 1.9617, 1.8, 1.6950, 1.6266],
        10: [1.8890, 1.8485, 1.8, 1.7685, 1.7480],
        1: [2.6898, 2.2851, 1.8, 1.4851, 1.2797],
    }.items():
        lens = from_text(tmp_path, SINGLET.replace("{index: 1.5168}", f"{{linear_abbe: {{n: 1.8, v: {v}}}}}"))
        assert lens.surfaces[0].glass.index([400, 486.1, 589.3, 656.3, 700]) == pytest.approx(expected, abs=6e-5)


def test_other_dispersion_laws(tmp_path):
    sellmeier = "{sellmeier: {b: [1.03961212, 0.231792344, 1.01046945], c: [0.00600069867, 0.0200179144, 103.560653]}}"
    assert glass_index(tmp_path, sellmeier, 587.5618) == pytest.approx(1.5168, abs=1e-7)
    assert glass_index(tmp_path, "{cauchy: [1.5, 0.004, 1e-5]}", 500.0) == pytest.approx(
        1.5 + 0.016 + 1.6e-4, abs=1e-12
    )
    # Schott's old catalogue: BK7.
    schott = "{schott: [2.2718929, -1.0108077e-2, 1.0592509e-2, 2.0816965e-4, -7.6472538e-6, 4.9240991e-7]}"
    assert glass_index(tmp_path, schott, 587.5618) == pytest.approx(1.5168, abs=2e-6)


def test_a_wavelength_outside_the_range_of_a_glass_is_refused():
    with pytest.raises(InputError, match=r"glass N-BK7 is known from 300 to 2500 nm \(requested 5000 nm\)"):
        load_lens(
            {"surfaces": [{"radius": 50, "thickness": 3, "glass": "N-BK7", "diameter": 20}, {"diameter": 20}]}
        ).first_order(5000.0)


ROW = "  - {radius: 51.5, thickness: 3.6, glass: {index: 1.5168}, diameter: 25.4}\n"
LAST = "  - {diameter: 25.4}\n"


def rows(*lines):
    return "name: x\nsurfaces:\n" + "".join(lines)


BAD = [
    ("[1, 2]", r"lens\.yaml:1:1: expected a mapping with name and surfaces"),
    ("name: x\n", r"lens\.yaml:1:1: a lens needs a list of surfaces"),
    ("surfaces: []\n", r"lens\.yaml:1:11: surfaces: a lens needs a list of surfaces"),
    (
        rows("  - {stop: true, thickness: 1, diameter: 5}\n", ROW, "  - {stop: true, diameter: 5}\n"),
        r"lens\.yaml:5:12: surfaces\[2\]\.stop: a second stop; surface 0 is the stop already",
    ),
    (
        rows(ROW, "  - {diamter: 25.4}\n"),
        r"lens\.yaml:4:6: surfaces\[1\]\.diamter: unknown key \(did you mean diameter\?\)",
    ),
    (rows(ROW, "  - 25.4\n"), r"lens\.yaml:4:5: surfaces\[1\]: expected a mapping of keys to values \(got 25\.4\)"),
    (rows(ROW, "  - {radius: 0, diameter: 25.4}\n"), r"surfaces\[1\]\.radius: must not be 0: leave it out for a plane"),
    (
        rows(ROW, "  - {radius: big, diameter: 25.4}\n"),
        r"lens\.yaml:4:14: surfaces\[1\]\.radius: expected a number \(got 'big'\)",
    ),
    (rows(ROW, "  - {radius: true, diameter: 2}\n"), r"surfaces\[1\]\.radius: expected a number \(got True\)"),
    (rows(ROW, "  - {radius: 1:30, diameter: 2}\n"), r"surfaces\[1\]\.radius: expected a number \(got '1:30'\)"),
    (rows(ROW, "  - {radius: .nan, diameter: 2}\n"), r"surfaces\[1\]\.radius: must be finite \(got nan\)"),
    (rows(ROW, "  - {radius: 1.0e-300, diameter: 2}\n"), r"surfaces\[1\]\.radius: must be at least 1e-09 mm"),
    (rows(ROW, "  - {diameter: 1.0e+300}\n"), r"surfaces\[1\]\.diameter: must be at most 1e\+15 mm"),
    (rows(ROW.replace("3.6", "1e200"), LAST), r"surfaces\[0\]\.thickness: must be at most 1e\+15 mm"),
    (rows(ROW, "  - {radius: -30}\n"), r"lens\.yaml:4:5: surfaces\[1\]: diameter is missing"),
    (rows(ROW, "  - {diameter: 0}\n"), r"surfaces\[1\]\.diameter: must be above 0 \(got 0\)"),
    (rows(ROW, "  - {diameter: -2}\n"), r"surfaces\[1\]\.diameter: must be above 0 \(got -2\)"),
    (rows("  - {radius: 50, diameter: 20}\n", LAST), r"surfaces\[0\]: thickness is missing"),
    (
        rows(ROW, "  - {radius: 10, diameter: 25.4}\n"),
        r"surfaces\[1\]\.diameter: the diameter 25\.4 mm is more than twice",
    ),
    (
        rows(ROW.replace("1.5168", "0.3"), LAST),
        r"surfaces\[0\]\.glass\.index: a refractive index lies between 0\.5 and 5 \(got 0\.3\)",
    ),
    (
        rows(ROW.replace("1.5168", "15"), LAST),
        r"surfaces\[0\]\.glass\.index: a refractive index lies between .* \(got 15\)",
    ),
    (rows(ROW.replace("1.5168", ".nan"), LAST), r"surfaces\[0\]\.glass\.index: must be finite"),
    (
        rows(ROW.replace("{index: 1.5168}", "N-BK77"), LAST),
        r"surfaces\[0\]\.glass: unknown glass; did you mean N-BK7.*\(got 'N-BK77'\)",
    ),
    (
        rows(ROW.replace("{index: 1.5168}", "1.5"), LAST),
        r"surfaces\[0\]\.glass: expected a name or a mapping such as \{index: 1\.5\}",
    ),
    (
        rows(ROW.replace("{index: 1.5168}", "{nd: 1.5, index: 1.5}"), LAST),
        r"surfaces\[0\]\.glass: needs exactly one of .* \(has index, nd\)",
    ),
    (rows(ROW.replace("{index: 1.5168}", "{nd: 1.5}"), LAST), r"surfaces\[0\]\.glass: vd is missing"),
    (
        rows(ROW.replace("{index: 1.5168}", "{nd: 1.5, vd: 0}"), LAST),
        r"surfaces\[0\]\.glass\.vd: must be above 0 \(got 0\)",
    ),
    (
        rows(ROW.replace("{index: 1.5168}", "{schott: [1, 2]}"), LAST),
        r"surfaces\[0\]\.glass\.schott: expected six coefficients",
    ),
    ("unit: parsec\n" + rows(ROW, LAST), r"lens\.yaml:1:7: unit: allowed: mm, m, cm, um, in, km \(got 'parsec'\)"),
    ("unit: 3\n" + rows(ROW, LAST), r"unit: expected text \(got 3\)"),
    ("published: 50\n" + rows(ROW, LAST), r"published: expected a mapping"),
    ("stop: 2\n" + rows(ROW, LAST), r"lens\.yaml:1:1: stop: unknown key"),
]


@pytest.mark.parametrize(("text", "message"), BAD, ids=[message[:60] for _, message in BAD])
def test_a_bad_lens_is_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as caught:
        from_text(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_a_mapping_is_named_by_its_lens():
    with pytest.raises(InputError, match=r"^Mine: surfaces\[0\]\.diameter: must be above 0"):
        load_lens({"name": "Mine", "surfaces": [{"radius": 5, "thickness": 1, "diameter": 0}, {"diameter": 1}]})


def test_an_unknown_name_is_answered_with_near_ones(tmp_path):
    with pytest.raises(InputError, match=r"canon-50mm: no such .*; did you mean cooke-triplet-50mm, dgauss-50mm"):
        load_lens("canon-50mm")
    with pytest.raises(InputError, match=r"petzval: no such .*; did you mean petzval-50mm, petzval-51mm\?"):
        load_lens("petzval")
    with pytest.raises(InputError, match=r"dgaus-50mm: no such lens file or name; did you mean dgauss-50mm"):
        load_lens("dgaus-50mm")
    for odd in ("a\0b", "x" * 5000, "/", "."):
        with pytest.raises(InputError):
            load_lens(odd)
    path = tmp_path / "lens.xyz"
    path.write_text("x")
    with pytest.raises(InputError, match="unknown kind of lens file"):
        load_lens(path)


def test_stop_settings_are_refused_beyond_what_the_lens_has():
    lens = load_lens("dgauss-50mm")
    with pytest.raises(InputError, match=r"the stop opens to 17\.1 mm, f/2\.03 \(requested 20 mm\)"):
        lens.with_stop_diameter(20)
    with pytest.raises(InputError, match=r"opens to f/2\.03, a stop of 17\.1 mm \(f/1\.4 would need 24\.797 mm\)"):
        lens.stop_diameter_for(1.4)
    for bad in (0, -1, float("nan"), float("inf")):
        with pytest.raises(InputError, match="must be above 0"):
            lens.with_stop_diameter(bad)
        with pytest.raises(InputError, match="must be above 0"):
            lens.stop_diameter_for(bad)
    with pytest.raises(InputError, match="has no stop to set"):
        load_lens("ball").with_stop_diameter(5)


@pytest.mark.parametrize("name", [name for name in list_lenses() if load_lens(name).stop is not None])
def test_a_lens_takes_the_f_numbers_that_it_is_marked_and_printed_with(name):
    lens = load_lens(name)
    widest, full = lens.first_order().f_number, 2 * lens.stop.semi_diameter
    marks = [*re.findall(r"f/(\d+(?:\.\d+)?)", lens.name), lens.published.get("f_number", widest)]
    for said in [*marks, *(f"{widest:.{digits}g}" for digits in (3, 4, 5))]:
        assert lens.stop_diameter_for(float(said)) == pytest.approx(full * min(1, widest / float(said)), rel=1e-12)
        assert bool(lens.speed_note(float(said))) == (float(said) < 0.995 * widest)
    for digits in (4, 5):
        assert lens.with_stop_diameter(float(f"{full:.{digits}g}")).stop.semi_diameter <= full / 2
    with pytest.raises(InputError, match=r"opens to f/"):
        lens.stop_diameter_for(0.98 * min(widest, lens.marked_f_number or widest))


@pytest.mark.parametrize(
    ("keys", "marked"),
    [
        ({"name": "Prime f/2"}, 2),
        ({"name": "PRIME 50mm F1.2 L"}, 1.2),
        ({"name": "JP2019 Example 1 (14-30mm f/4 S)"}, 4),
        ({"name": "zoom f/3.5-5.6"}, 3.5),
        ({"name": "f 50 mm"}, None),
        ({"name": "f/100mm"}, None),
        ({"name": "half 2 of/3"}, None),
        ({"name": "f/2", "published": {"f_number": 1.9}}, 1.9),
        ({"name": "f/2", "published": {"f_number": "fast"}}, 2),
        ({"name": "f/2", "published": {"f_number": 1.9}, "marked_f_number": 2.2}, 2.2),
    ],
)
def test_the_marked_f_number_is_that_of_the_file_or_its_title(keys, marked):
    lens = load_lens({"surfaces": [{"radius": 50, "diameter": 9, "stop": True, "glass": {"index": 1.5}}], **keys})
    assert lens.marked_f_number == marked
    assert load_lens(read_yaml(lens_text(lens)).data).marked_f_number == marked


def test_every_bundled_lens_is_listed_and_loads():
    names = list_lenses()
    assert names == sorted(names)
    assert {"dgauss-50mm", "wide-22mm", "fisheye-10mm", "telephoto-250mm", "dgauss-100mm", "ball"} <= set(names)
    for name in names:
        lens = load_lens(name)
        assert lens.surfaces and lens.name and lens.name != name
