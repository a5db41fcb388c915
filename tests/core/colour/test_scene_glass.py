"""Glass of lens files as a material of the scene."""

import jsonschema
import numpy as np
import pytest
import yaml

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.plan.textures import dielectric_index, is_dispersive
from rptcam_cl.scene.load import scene_json_schema

from .conftest import SCENE

# Index at 587.56 nm and at F 486.13 nm: SCHOTT's data sheets; water at 20 degrees: Daimon and Masumura 2007.
GLASSES = {
    "N-BK7": (1.51680, 1.52238),
    "SF11": (1.78472, 1.80645),
    "n-bk7": (1.51680, 1.52238),
    "water": (1.3334, 1.3375),
    "{nd: 1.5168, vd: 64.17}": (1.51680, 1.5224),
    "{index: 1.5}": (1.5, 1.5),
    "{sellmeier: {b: [1.03961212, 0.231792344, 1.01046945], c: [0.00600069867, 0.0200179144, 103.560653]}}": (
        1.51680,
        1.52238,
    ),
    "{cauchy: [1.5046, 0.0042]}": (1.5046 + 0.0042 / 0.5875618**2, 1.5046 + 0.0042 / 0.4861327**2),
}


@pytest.mark.parametrize("text", GLASSES)
def test_glass_has_its_index(scene, text):
    material = scene(f"{{kind: dielectric, glass: {text}}}").objects[0].material
    at_d, at_f = GLASSES[text]
    index = dielectric_index(material)
    np.testing.assert_allclose(index([LINE_D_NM, 486.1327]), [at_d, at_f], atol=5e-5)
    assert material.n_d == pytest.approx(at_d, abs=5e-5)
    assert is_dispersive(material) == (text != "{index: 1.5}")


def test_plain_index_is_the_same_everywhere(scene):
    material = scene("{kind: dielectric, index: 1.4}").objects[0].material
    assert dielectric_index(material)([400.0, 700.0]).tolist() == [1.4, 1.4]
    assert not is_dispersive(material)


@pytest.mark.parametrize("rough", ["", ", roughness: 0.3"])
def test_records_have_the_index_at_the_d_line(scene, rough):
    records = make_plan(scene(f"{{kind: dielectric, glass: SF11{rough}}}")).materials
    assert records["parameter"][0] == pytest.approx(1.78472, abs=1e-5)


def test_index_is_held_beyond_the_law(scene):
    index = dielectric_index(scene("{kind: dielectric, glass: SF11}").objects[0].material)
    assert index(380.0) == index(390.0) > index(391.0)


def test_catalogue_lies_in_the_folder_of_the_scene(scene, tmp_path):
    (tmp_path / "mine.agf").write_text("NM A1 2 0 1.5 60 0\nCD 1.25 0.01 0 0 0 0\nLD 0.3 2.5\n")
    material = scene("{kind: dielectric, glass: {catalogue: mine.agf, name: A1}}").objects[0].material
    wavelength = 0.5875618
    assert material.n_d == pytest.approx(np.sqrt(1 + 1.25 * wavelength**2 / (wavelength**2 - 0.01)))


def test_law_counts_in_the_hash(scene, tmp_path):
    def content(text):
        return scene(f"{{kind: dielectric, glass: {text}}}").content_hash()

    assert content("N-BK7") == content("n-bk7") != content("SF11")
    assert content("{nd: 1.5, vd: 60}") != content("{nd: 1.5, vd: 61}")
    catalogue = tmp_path / "mine.agf"
    catalogue.write_text("NM A1 2 0 1.5 60 0\nCD 1.25 0.01 0 0 0 0\nLD 0.3 2.5\n")
    first = content("{catalogue: mine.agf, name: A1}")
    catalogue.write_text("NM A1 2 0 1.5 60 0\nCD 1.26 0.01 0 0 0 0\nLD 0.3 2.5\n")
    assert content("{catalogue: mine.agf, name: A1}") != first


REFUSED = [
    ("index: 1.5, glass: N-BK7", "glass: cannot be given together with index"),
    ("glass: N-BK77", "glass: unknown glass; did you mean N-BK7"),
    ("glass: 1.5", "glass: must be a glass (got 1.5; allowed: a name such as N-BK7"),
    ("glass: {nd: 1.5}", "glass: vd is missing"),
    ("glass: {nd: 1.5, vd: -3}", "glass.vd: must be above 0 (got -3"),
    ("glass: {nd: 1.5, vd: 60, index: 1.5}", "glass: needs exactly one of index, nd"),
    ("glass: {sellmeier: {b: [1], c: [0.1, 2]}}", "glass.sellmeier.c: b and c need as many numbers"),
    ("glass: {sellmeier: {b: [x], c: [0.1]}}", "glass.sellmeier.b[0]: expected a number"),
    ("glass: {selmeier: {b: [1], c: [0.1]}}", "glass.selmeier: unknown key (did you mean sellmeier?)"),
    ("glass: {sellmeier: {b: [1], c: [0.25]}}", "no real index at a requested wavelength"),
    ("glass: {cauchy: [7]}", "has a refractive index from 7 to 7"),
    ("glass: {cauchy: [1.5], range_nm: [1000, 2000]}", "is known from 1000 to 2000 nm only"),
    ("glass: {catalogue: absent.agf, name: A1}", "glass.catalogue: no such file"),
    ("glass: {catalogue: ../a.agf, name: A1}", "glass.catalogue: lies outside the scene's folder"),
    ("glass: {nd: 1.5, vd: 60, transmittance: {thickness_mm: 5, wavelengths_nm: [400, 700], values: [1, 1]}}",
     "glass.transmittance: is not read here"),
    ("glass: {index: 1.001}, alpha: 0.2", "glass: bends light too little for a rough surface"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), REFUSED)
def test_glass_is_refused(scene, text, message):
    with pytest.raises(InputError) as problem:
        scene(f"{{kind: dielectric, {text}}}")
    assert "scene.yaml:3:" in str(problem.value)
    assert "materials.tested.glass" in str(problem.value)
    assert message in str(problem.value)


def test_schema_knows_glass():
    check = jsonschema.Draft202012Validator(scene_json_schema())

    def valid(keys):
        return check.is_valid(yaml.safe_load(SCENE.format(material=f"{{kind: dielectric, {keys}}}", light="1")))

    assert all(valid(f"glass: {text}") for text in GLASSES)
    assert not any(valid(REFUSED[number][0]) for number in (0, 2, 3, 5, 8, 14))
