"""Metals by tables of n and k."""

import numpy as np
import pytest

from rptcam_cl.core.colour import WAVELENGTHS_NM, metal_optics
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.plan.textures import metal_colour, metal_constants, metal_spectra


@pytest.fixture
def metal(scene):
    """Return the metal that a text describes."""
    return lambda text, **files: (
        scene(f"{{kind: conductor, roughness: 0.2, metal: {text}}}", **files).objects[0].material.metal
    )


def table(name, step):
    n, k = metal_optics(name)
    return [
        f"{wavelength:g} {n[index]:.9g} {k[index]:.9g}"
        for index, wavelength in enumerate(WAVELENGTHS_NM)
        if index % step == 0
    ]


def test_table_of_a_known_metal_is_that_metal(metal):
    found = metal("{file: gold.csv}", gold="nm n k\n" + "\n".join(table("gold", 1)))
    np.testing.assert_allclose(metal_spectra(found), metal_optics("gold"), rtol=1e-8)
    np.testing.assert_allclose(metal_colour(found, 0.5), metal_colour("gold", 0.5), rtol=1e-7)
    np.testing.assert_allclose(metal_constants(found), metal_constants("gold"), rtol=1e-6)


def test_table_in_the_scene_is_joined_by_lines_and_held(metal):
    n, k = metal_spectra(metal("{wavelengths_nm: [400, 600], n: [1, 2], k: [3, 7]}"))
    assert [n[0], n[20], n[120], n[220], n[400]] == [1, 1, 1.5, 2, 2]
    assert [k[0], k[120], k[400]] == [3, 5, 7]


def test_records_have_constants_of_the_table(scene):
    records = make_plan(
        scene("{kind: conductor, roughness: 0.2, metal: {wavelengths_nm: [380, 780], n: [1, 1], k: [6, 6]}}")
    ).materials
    # a reflectance of 0.9 in every channel
    n, k = (records[f"metal_{name}"][0][:3] for name in "nk")
    np.testing.assert_allclose(((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), 0.9, atol=1e-6)


def test_content_counts_in_the_hash(scene):
    def content(text):
        return scene("{kind: conductor, roughness: 0.2, metal: {file: m.csv}}", m=text).content_hash()

    first = content("400 1 2\n700 1 2\n")
    assert content("# another comment\n400,1,2\n700,1,2\n") == first
    assert content("400 1 2\n700 1 2.01\n") != first


REFUSED = [
    ("{wavelengths_nm: [400, 600], n: [1, 2]}", "metal.k: does not fit wavelengths_nm"),
    ("{wavelengths_nm: [400, 600], n: [1, 2, 3], k: [1, 2]}", "metal.n: does not fit wavelengths_nm"),
    ("{wavelengths_nm: [600, 400], n: [1, 2], k: [1, 2]}", "metal.wavelengths_nm[1]: has a wavelength that is not"),
    ("{wavelengths_nm: [400, 600], n: [0, 2], k: [1, 2]}", "metal.n: n is out of range"),
    ("{wavelengths_nm: [400, 600], file: a.csv}", "metal.file: cannot be given together with wavelengths_nm"),
    ("{n: [1, 2], file: a.csv}", "metal.n: cannot be given together with file"),
    ("{file: a.csv, k: [1, 2]}", "metal.k: cannot be given together with file"),
    ("{file: a.csv}", "metal.file: line 1 does not hold a wavelength and n and k (got '400 1')"),
    ("{file: absent.csv}", "metal.file: no such file"),
    ("{n: [1, 2], k: [1, 2, 3]}", "metal.n: has 2 numbers instead of 3"),
    ("{wavelength: [400, 500]}", "metal.wavelength: unknown key"),
]


@pytest.mark.parametrize(("text", "message"), REFUSED)
def test_metal_is_refused(metal, text, message):
    with pytest.raises(InputError) as problem:
        metal(text, a="400 1\n500 2\n")
    assert "scene.yaml:3:" in str(problem.value)
    assert f"materials.tested.{message}" in str(problem.value)
