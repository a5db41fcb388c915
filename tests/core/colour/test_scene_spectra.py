"""Spectra as colours of a scene: what they mean, and what is refused."""

import copy
import pickle

import jsonschema
import numpy as np
import pytest
import yaml

from rptcam_cl.core.colour import (
    WAVELENGTHS_NM,
    blackbody,
    daylight,
    exact_luminance,
    illuminant,
    srgb_from_spectrum,
    xyz_from_spectrum,
)
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene, scene_json_schema
from rptcam_cl.scene.quantities import SpectralColour

from .conftest import SCENE


def test_table_becomes_a_colour_that_keeps_its_samples(matte):
    found = matte("{wavelengths_nm: [400, 500, 700], values: [0.2, 0.4, 0.8]}")
    assert isinstance(found, SpectralColour)
    np.testing.assert_allclose(found.samples, np.interp(WAVELENGTHS_NM, [400, 500, 700], [0.2, 0.4, 0.8]))
    red, green, blue = found
    assert 0.8 > red > green > blue > 0.2


def test_grey_spectrum_is_grey(matte):
    np.testing.assert_allclose(matte("{wavelengths_nm: [380, 780], values: [0.5, 0.5]}"), 0.5, atol=1e-12)


def test_reflectance_outside_srgb_is_cut(matte):
    found = matte("{wavelengths_nm: [500, 515, 520, 530, 545], values: [0, 1, 1, 1, 0]}")
    assert min(found) == 0 and max(found) <= 1


def test_file_is_a_table(matte):
    plain = matte("{wavelengths_nm: [400, 500, 700], values: [0.2, 0.4, 0.8]}")
    text = "# a leaf\nwavelength;percent\n400; 20\n500,40 # green\n\n700 80\n"
    assert matte("{file: leaf.csv, scale: 0.01}", leaf=text) == plain


def test_file_counts_in_the_hash(scene):
    def content(text):
        return scene("{kind: matte, reflectance: {file: leaf.csv}}", leaf=text).content_hash()

    first = content("400 0.2\n700 0.4\n")
    assert content("# other words\n400, 0.2\n700, 0.4\n") == first
    assert content("400 0.2\n700 0.41\n") != first


def test_spectrum_of_the_same_colour_is_another_scene(scene):
    found = scene(light="{lines_nm: {550: 1}}")
    rgb = scene(light=str([float(channel) for channel in found.lights[0].intensity]))
    assert found.lights[0].intensity != rgb.lights[0].intensity
    assert found.content_hash() != rgb.content_hash()
    assert scene(light="{lines_nm: {550: 1}}").content_hash() == found.content_hash()
    assert scene(light="{lines_nm: {550.01: 1}}").content_hash() != found.content_hash()


LIGHTS = {
    "{blackbody_k: 3200, scale: 1}": (blackbody(3200), "own"),
    "{blackbody_k: 3200, scale: 2.0e-3}": (blackbody(3200) * 2e-3, "own"),
    "{blackbody_k: 3200, luminance: 7}": (blackbody(3200), 7),
    "{daylight_k: 5000, luminance: 7}": (daylight(5000), 7),
    "{illuminant: F11, luminance: 7}": (illuminant("F11"), 7),
    "{wavelengths_nm: [380, 780], values: [0.5, 0.5]}": (np.full(401, 0.5), "own"),
    "{wavelengths_nm: [380, 780], values: [0.5, 0.5], scale: 4}": (np.full(401, 2.0), "own"),
    "{wavelengths_nm: [380, 780], values: [0.5, 0.5], luminance: 7}": (np.ones(401), 7),
}


@pytest.mark.parametrize("text", LIGHTS)
def test_light_has_its_spectrum_and_amount(light, text):
    spectrum, amount = LIGHTS[text]
    found = light(text)
    expected = spectrum if amount == "own" else spectrum * amount / xyz_from_spectrum(spectrum)[1]
    np.testing.assert_allclose(found.samples, expected, rtol=1e-12)
    assert float(exact_luminance(found)) == pytest.approx(xyz_from_spectrum(expected)[1])
    np.testing.assert_allclose(found, srgb_from_spectrum(expected), atol=1e-9 * max(found))


def test_daylight_of_luminance_one_is_white(light):
    np.testing.assert_allclose(light("{illuminant: D65, luminance: 1}"), 1, atol=1e-12)


def test_watts_are_the_sum_over_the_wavelengths(light):
    for text in (
        "{illuminant: A, watts: 30}",
        "{blackbody_k: 5000, watts: 30}",
        "{lines_nm: {500: 1, 600: 2}, watts: 30}",
    ):
        assert light(text).samples.sum() == pytest.approx(30)


def test_lines_keep_their_wavelengths(light):
    found = light("{lines_nm: {632.8: 0.5, 546.1: 2.0}, scale: 3}")
    assert found.lines == ((546.1, 6.0), (632.8, 1.5))
    assert found.samples.sum() == pytest.approx(7.5)
    # a line of 555 nm and 1 W is the candela's: luminance 1
    assert float(exact_luminance(light("{lines_nm: {555: 1}}"))) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("wavelength", [450, 490, 520, 589, 650])
def test_laser_outside_srgb_keeps_its_luminance(light, wavelength):
    found = light(f"{{lines_nm: {{{wavelength}: 1}}}}")
    assert min(srgb_from_spectrum(found.samples)) < 0
    assert min(found) == 0
    assert float(exact_luminance(found)) == pytest.approx(xyz_from_spectrum(found.samples)[1])


def test_lines_of_a_json_scene_have_text_as_keys():
    data = yaml.safe_load(SCENE.format(material="{kind: matte, reflectance: 0.5}", light="1"))
    data["lights"][0]["intensity"] = {"lines_nm": {"546.1": 1}}
    assert load_scene(data).lights[0].intensity.lines == ((546.1, 1.0),)


PLACES = [
    "{kind: mirror, reflectance: TABLE}",
    "{kind: conductor, reflectance: TABLE, alpha: 0.1}",
    "{kind: plastic, reflectance: TABLE}",
    "{kind: thin_glass, transmittance: TABLE}",
    "{kind: dielectric, absorption_per_m: TABLE}",
    "{kind: dielectric, attenuation: {color: TABLE, distance_m: 0.1}}",
    "{kind: principled, base_color: TABLE}",
    "{kind: principled, emission: {illuminant: A, luminance: 1}}",
    "{kind: emissive, radiance: {blackbody_k: 2000, scale: 1}}",
    "{kind: mix, materials: [{kind: matte, reflectance: TABLE}, {kind: mirror}]}",
]


@pytest.mark.parametrize("text", PLACES)
def test_spectra_stand_where_colours_do(scene, text):
    found = scene(text.replace("TABLE", "{wavelengths_nm: [400, 700], values: [0.2, 0.6]}"))
    plain = found.objects[0].material.model_dump(mode="json")
    assert "'samples': [" in str(plain)


def test_absorption_follows_the_spectrum(scene):
    table = "{wavelengths_nm: [380, 780], values: [0.25, 0.25]}"
    found = scene(f"{{kind: dielectric, attenuation: {{color: {table}, distance_m: 0.5}}}}").objects[0].material
    np.testing.assert_allclose(found.absorption, -np.log(0.25) / 0.5)
    np.testing.assert_allclose(found.absorption.samples, -np.log(0.25) / 0.5)
    pane = scene(f"{{kind: thin_glass, transmittance: {table}}}").objects[0].material
    np.testing.assert_allclose(pane.depth.samples, -np.log(0.25))
    coefficient = scene("{kind: dielectric, absorption_per_m: {wavelengths_nm: [380, 780], values: [9, 9]}}")
    np.testing.assert_allclose(coefficient.objects[0].material.absorption, 9)


def test_colour_of_a_luminaire_needs_no_amount(tmp_path):
    head, _, _ = SCENE.format(material="{kind: mirror}", light="1").partition("lights")
    profile = "IESNA:LM-63-1995\nTILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n1 1 1\n0 90\n0\n100 100\n"
    (tmp_path / "a.ies").write_text(profile)
    path = tmp_path / "scene.yaml"
    path.write_text(head + "lights: [{kind: ies, file: a.ies, position: [0, 1, 0], color: {illuminant: F2}}]\n")
    colour = load_scene(path).lights[0].color
    assert isinstance(colour, SpectralColour)
    assert float(exact_luminance(colour)) == pytest.approx(1)


REFUSED_LIGHTS = [
    ("{illuminant: D66, luminance: 1}", "intensity.illuminant: is not a known choice; did you mean D65?"),
    ("{illuminant: D65}", "intensity: illuminant needs an amount beside it"),
    ("{daylight_k: 5000}", "intensity: daylight_k needs an amount beside it"),
    ("{daylight_k: 3000, luminance: 1}", "intensity.daylight_k: is out of range (got 3000; allowed: at least 4000)"),
    ("{illuminant: D65, scale: 2}", "intensity.scale: means nothing for illuminant"),
    ("{blackbody_k: 3000}", "intensity: blackbody_k needs an amount beside it"),
    ("{blackbody_k: -3, scale: 1}", "intensity.blackbody_k: is out of range"),
    ("{blackbody_k: hot, scale: 1}", "intensity.blackbody_k: is text, not a number"),
    ("{blackbody_k: 3000, scale: 1, luminance: 1}", "intensity.luminance: cannot be given together with scale"),
    ("{blackbody_k: 3000, illuminant: A, luminance: 1}", "intensity.illuminant: cannot be given together with"),
    ("{luminance: 1}", "intensity: needs one of wavelengths_nm | file | blackbody_k"),
    ("{blackbody: 3000}", "intensity.blackbody: unknown key; did you mean blackbody_k?"),
    ("{lines_nm: {}}", "intensity.lines_nm: must be a mapping from wavelength to amount"),
    ("{lines_nm: [546]}", "intensity.lines_nm: must be a mapping from wavelength to amount"),
    ("{lines_nm: {green: 1}}", "intensity.lines_nm.green: is no wavelength"),
    ("{lines_nm: {900: 1}}", "has a wavelength out of range (got 900; allowed: 380 to 780 nm)"),
    ("{lines_nm: {546.1: -1}}", "is no amount of light (got -1; allowed: above 0"),
    ("{lines_nm: {546.1: 1e31}}", "is no amount of light"),
    ("{lines_nm: {546.1: bright}}", "is no amount of light (got 'bright'"),
    ("{wavelengths_nm: [300, 350, 790], values: [1, 1, 0], luminance: 1e30}", "is too bright"),
    ("{wavelengths_nm: [790, 800], values: [1, 1]}", "without a wavelength from 380 to 780 nm"),
    ("{wavelengths_nm: [0.4, 0.7], values: [1, 1]}", "these look like micrometres"),
    ("{wavelengths_nm: [400, 500], values: [0, 0], luminance: 1}", "intensity: is dark, and cannot be made bright"),
]  # fmt: skip
REFUSED_TABLES = [
    ("{wavelengths_nm: [400, 500], values: [0.1]}", "reflectance.values: has 1 numbers"),
    ("{wavelengths_nm: [400, 500], values: [0.1, 0.2, 0.3]}", "reflectance.values: does not fit wavelengths_nm"),
    ("{wavelengths_nm: [400, 500]}", "reflectance.values: does not fit wavelengths_nm"),
    ("{values: [400, 500]}", "reflectance: needs one of wavelengths_nm | file"),
    ("{wavelengths_nm: [400, 400], values: [0.1, 0.2]}", "reflectance.wavelengths_nm[1]: has a wavelength that is not"),
    ("{wavelengths_nm: [400, 500], values: [0.1, -0.2]}", "reflectance.values[1]: must not be negative (got -0.2"),
    ("{wavelengths_nm: [400, 500], values: [0.1, 1.2]}", "values[1]: would reflect more light than arrives"),
    ("{wavelengths_nm: [400, 500], values: [20, 40]}", "of per cent with `scale: 0.01`"),
    ("{wavelengths_nm: [400, x], values: [0.1, 0.2]}", "reflectance.wavelengths_nm[1]: is text, not a number"),
    ("{wavelengths_nm: 400, values: 0.1}", "reflectance.wavelengths_nm: must be a list of numbers"),
    ("{illuminant: D65, luminance: 1}", "reflectance.illuminant: unknown key"),
    ("{file: wood.png}", "reflectance.file: is not a table of a spectrum"),
    ("{file: absent.csv}", "reflectance.file: no such file"),
    ("{file: ../a.csv}", "reflectance.file: lies outside the scene's folder"),
    ("{file: words.csv}", "reflectance.file: line 3 does not hold a wavelength and a value (got 'b c')"),
    ("{file: short.csv}", "reflectance.file: holds 1 rows"),
    ("{file: falls.csv}", "reflectance.file: line 4 has a wavelength that is not longer"),
    ("{file: bright.csv}", "reflectance.file: holds at 500 nm a value that would reflect more light than arrives"),
    ("{kind: checker, even: {wavelengths_nm: [400, 500], values: [0, 1]}, odd: 0}", "even: must be a colour"),
]  # fmt: skip
FILES = {
    "words": "# x\n400 0.1\nb c\n", "short": "nm,value\n400,0.1\n", "falls": "nm value\n400 0.1\n500 0.2\n450 0.3\n",
    "bright": "400 0.5\n500 1.5\n",
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), REFUSED_LIGHTS)
def test_light_is_refused(light, text, message):
    with pytest.raises(InputError) as problem:
        light(text)
    assert "scene.yaml:5:" in str(problem.value)
    assert message in str(problem.value)


@pytest.mark.parametrize(("text", "message"), REFUSED_TABLES)
def test_table_is_refused(matte, text, message):
    with pytest.raises(InputError) as problem:
        matte(text, **FILES)
    assert "scene.yaml:3:" in str(problem.value)
    assert "materials.tested.reflectance" in str(problem.value)
    assert message in str(problem.value)


def test_copies_keep_the_spectrum(light, scene):
    colour = light("{lines_nm: {546.1: 1}}")
    assert copy.deepcopy(colour) == colour == pickle.loads(pickle.dumps(colour))
    assert colour != tuple(colour)
    with pytest.raises(ValueError, match="read-only"):
        colour.samples[0] = 1
    changed = change_scene(scene(light="{lines_nm: {546.1: 1}}"), render={"spp": 2})
    assert changed.lights[0].intensity == colour


@pytest.mark.slow
def test_schema_takes_the_forms_and_refuses_their_faults():
    schema = scene_json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    check = jsonschema.Draft202012Validator(schema)
    for text in (*LIGHTS, "{lines_nm: {'546.1': 1}}"):
        assert check.is_valid(yaml.safe_load(SCENE.format(material=PLACES[8], light=text))), text
    for text, _ in (REFUSED_LIGHTS[0], REFUSED_LIGHTS[8], REFUSED_LIGHTS[9], REFUSED_LIGHTS[11]):
        assert not check.is_valid(yaml.safe_load(SCENE.format(material=PLACES[8], light=text))), text
    assert not check.is_valid(
        yaml.safe_load(SCENE.format(material="{kind: mirror, reflectance: {values: [1, 1]}}", light="1"))
    )
