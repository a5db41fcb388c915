"""Materials of scene files: what is understood, what is refused, names in mixes."""

from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.load import load_scene

HEAD = """
camera: {kind: pinhole, eye: [0, 1, 5], target: [0, 1, 0], fov_degrees: 40}
environment: {kind: constant, radiance: 1}
"""


def material(text, **kinds):
    """Return the material that a text describes, and write it where a scene names it."""
    names = "".join(f"  {name}: {value}\n" for name, value in kinds.items())
    scene = f"{HEAD}materials:\n{names}  tested: {text}\n"
    objects = "objects: [{shape: sphere, center: [0, 0, 0], radius: 1, material: tested}]\n"
    return load_scene_text(scene + objects).objects[0].material


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def load_scene_text(text):
    Path("scene.yaml").write_text(text, "utf-8")
    return load_scene("scene.yaml")


REFUSED = [
    (
        "{kind: matte, reflectance: 1, normal_map: {file: a.png}, bump: {texture: {kind: marble}}}",
        "bump: does not count beside normal_map",
    ),
    (
        "{kind: matte, reflectance: 1, opacity: {kind: perlin, mapping: {}}}",
        "opacity.mapping: does not count for opacity",
    ),
    ("{kind: matte, reflectance: 1, bump: {texture: 0.5}}", "allowed: checker, grid, gradient, noise, perlin"),
    ("{kind: matte, reflectance: {kind: perlin, form: sums}}", "did you mean sum"),
    ("{kind: matte, reflectance: {kind: dots, inside: 1, outside: 0, mapping: {matrix: [[1, 0, 0]]}}}", "3 or 4 rows"),
    ("{kind: conductor, alpha: 0.1}", "needs one of reflectance | metal"),
    ("{kind: conductor, metal: gold, reflectance: 1, alpha: 0.1}", "cannot be given together with"),
    ("{kind: conductor, metal: gold}", "needs one of alpha | roughness"),
    ("{kind: conductor, metal: golt, alpha: 0.1}", "did you mean gold"),
    ("{kind: conductor, metal: gold, roughness: 0}", "must be more than 0"),
    ("{kind: conductor, metal: {n: [1, 2], k: [1, 2, 3]}, alpha: 0.1}", "has 2 numbers instead of 3"),
    ("{kind: conductor, metal: {n: [1, 2, 3]}, alpha: 0.1}", "metal.k: is required but missing"),
    ("{kind: conductor, metal: gold, alpha: [0.1]}", "has 1 numbers instead of 2"),
    ("{kind: conductor, metal: gold, alpha: [0.1, 2]}", "alpha[1]: is out of range (got 2; allowed: at most 1)"),
    ("{kind: dielectric, alpha: 0.1, roughness: 0.1}", "cannot be given together with alpha"),
    ("{kind: dielectric, alpha: 0.1, index: 1.001}", "index: bends light too little for a rough surface"),
    ("{kind: dielectric, absorption_per_m: 1, attenuation: {color: 1, distance_m: 1}}", "cannot be given together"),
    ("{kind: dielectric, attenuation: {color: 1, distance_m: 0}}", "distance_m: is out of range"),
    ("{kind: plastic, reflectance: 0.5, index: 0.9}", "index: is out of range"),
    ("{kind: principled, metalic: 1}", "did you mean metallic"),
    ("{kind: principled, roughness: 1.5}", "roughness: is out of range"),
    (
        "{kind: principled, transmission: 1, index: 6}",
        "index: is out of range (got 6; allowed: at most 5 beside transm",
    ),
    ("{kind: principled, clearcoat_flat: true, clearcoat_normal_map: {file: a}}", "clearcoat_flat: does not count"),
    ("{kind: principled, anisotropy: 0.5, anisotropy_map: {file: a.png}}", "anisotropy: does not count beside"),
    (
        "{kind: principled, transmission: {kind: gradient, start: 0, end: 1}, index: 1.0}",
        "index: bends light too little for transmission",
    ),
    ("{kind: principled, transmission: 1, index: 1.0}", "index: bends light too little for transmission"),
    ("{kind: principled, roughness: {kind: wood}}", "is not a known choice"),
    ("{kind: principled, normal_map: {file: ../n.png}}", "n.png"),
    ("{kind: principled, normal_map: {strength: 1}}", "file: is required but missing"),
    ("{kind: matte, reflectance: 1, opacity: 2}", "opacity: is out of range"),
    ("{kind: mix, materials: [{kind: mirror}]}", "two materials"),
    ("{kind: mix, materials: [{kind: mirror}, {kind: emissive, radiance: 1}]}", "is not a known choice"),
    ("{kind: mix, materials: [{kind: mirror}, nothing]}", "names no material"),
    ("{kind: mix, materials: [{kind: mirror}, {kind: mirror, opacity: 0.5}]}", "does not count inside a mix"),
    ("{kind: mix, materials: [{kind: mirror}, {kind: mirror}], factor: -1}", "factor: is out of range"),
]


@pytest.mark.parametrize(("text", "message"), REFUSED, ids=[text for text, _ in REFUSED])
def test_material_is_refused_with_its_place(text, message):
    with pytest.raises(InputError) as caught:
        material(text)
    said = str(caught.value)
    assert said.startswith("scene.yaml:")
    assert "\n" not in said
    assert message in said


def test_roughness_and_anisotropy_are_alphas():
    plain = material("{kind: dielectric, roughness: 0.5}")
    stretched = material("{kind: dielectric, roughness: 0.5, anisotropy: 1}")
    assert plain.alphas == pytest.approx((0.25, 0.25))
    assert stretched.alphas == pytest.approx((0.25 / 0.1**0.5, 0.25 * 0.1**0.5))
    assert material("{kind: dielectric, roughness: 0}").alphas is None
    assert material("{kind: dielectric, alpha: 0.3}").alphas == (0.3, 0.3)


def test_mix_takes_names_and_mappings():
    mix = material("{kind: mix, materials: [red, {kind: mirror}]}", red="{kind: matte, reflectance: [1, 0, 0]}")
    assert [part.kind for part in mix.materials] == ["matte", "mirror"]
    inline = load_scene_text(
        HEAD + "materials: {red: {kind: matte, reflectance: 1}}\nobjects:\n  - {shape: sphere, center: [0, 0, 0], "
        "radius: 1, material: {kind: mix, materials: [red, red], factor: 0.2}}\n"
    )
    assert inline.objects[0].material.factor == 0.2


def test_attenuation_is_absorption():
    glass = material("{kind: dielectric, attenuation: {color: [1, 0.5, 0], distance_m: 2}}")
    assert glass.absorption == pytest.approx((0, 0.34657359, 6.9077553))


def test_media_by_colour_or_name_have_coefficients():
    wax = material("{kind: boundary, interior: {color: [0.0, 0.5, 1.0], free_path_mm: 2, asymmetry: 0.5}}").interior
    # nothing is scattered of black, nothing absorbed of white; scattering that is not even is twice as dense here
    assert np.array(wax.absorption) == pytest.approx([500, 500 * 0.2971**2, 0], rel=1e-3, abs=0.01)
    assert np.array(wax.scattering) == pytest.approx([0, 1000 * (1 - 0.2971**2), 1000], rel=1e-3, abs=0.01)
    milk = material("{kind: dielectric, interior: {substance: whole_milk}}").interior
    assert (milk.scattering, milk.absorption) == ((2550.0, 3210.0, 3770.0), (1.1, 2.4, 14.0))
    with pytest.raises(InputError) as problem:
        material("{kind: boundary, interior: {color: 0.5, free_path_mm: 0}}")
    assert str(problem.value).count("out of range") == 1
