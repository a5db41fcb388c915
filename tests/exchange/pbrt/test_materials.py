"""Materials and textures: what each kind of pbrt becomes, and what is said of the rest."""

import math
import struct
from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np
import PIL.Image
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.pbrt.materials import alpha_of
from rptcam_cl.exchange.pbrt.textures import black_body_srgb, reflectance_srgb
from rptcam_cl.scene.assets.pictures import read_picture, write_exr

Convert = Callable[..., Any]
HEAD = 'Scale -1 1 1 LookAt 0 0 9  0 0 0  0 1 0 Camera "perspective" WorldBegin LightSource "infinite"\n'
BALL = '\nShape "sphere"\n'


def png(size: tuple[int, int] = (4, 2), colour: tuple[int, int, int] = (200, 100, 50)) -> bytes:
    stream = BytesIO()
    PIL.Image.new("RGB", size, colour).save(stream, format="PNG")
    return stream.getvalue()


GREY_PNG = png(colour=(100, 100, 100))


def near(value: Any) -> Any:
    """What a key is compared with: numbers approximately, all else exactly."""
    if isinstance(value, dict):
        return {key: near(item) for key, item in value.items()}
    if isinstance(value, list):
        return [near(item) for item in value]
    return pytest.approx(value, rel=1e-6) if isinstance(value, float) else value


# Material of pbrt, keys of ours, and words of the report ("" for none).
KINDS: dict[str, tuple[dict[str, Any], str]] = {
    '"diffuse"': ({"kind": "matte", "reflectance": [0.5] * 3}, ""),
    '"diffuse" "rgb reflectance" [.1 .2 .3]': ({"kind": "matte", "reflectance": [0.1, 0.2, 0.3]}, ""),
    '"matte" "color Kd" [.1 .2 .3]': ({"kind": "matte", "reflectance": [0.1, 0.2, 0.3]}, ""),
    '"matte" "float sigma" 20': ({"kind": "matte", "reflectance": [0.5] * 3, "sigma_degrees": 20.0}, ""),
    '"coateddiffuse" "float roughness" .25': (
        {"kind": "plastic", "reflectance": [0.5] * 3, "index": 1.5, "alpha": 0.5}, ""),
    '"coateddiffuse" "float eta" 1.7': ({"kind": "plastic", "reflectance": [0.5] * 3, "index": 1.7}, ""),
    '"coateddiffuse" "rgb albedo" [.1 .1 .1]': (
        {"kind": "plastic", "reflectance": [0.5] * 3, "index": 1.5}, "scattering between cover and base"),
    '"dielectric"': ({"kind": "dielectric", "index": 1.5}, ""),
    '"dielectric" "float eta" 1.33 "float roughness" .01': ({"kind": "dielectric", "index": 1.33, "alpha": 0.1}, ""),
    '"dielectric" "float roughness" .3 "bool remaproughness" false': (
        {"kind": "dielectric", "index": 1.5, "alpha": 0.3}, ""),
    '"dielectric" "float uroughness" .01 "float vroughness" .04': (
        {"kind": "dielectric", "index": 1.5, "alpha": [0.1, 0.2]}, ""),
    '"dielectric" "spectrum eta" "glass-BK7"': ({"kind": "dielectric", "index": 1.5168}, "without dispersion"),
    # between 1.6 at 400 nm and 1.5 at 700 nm, at the sodium line
    '"dielectric" "spectrum eta" [700 1.5 400 1.6]': ({"kind": "dielectric", "index": 1.537}, "1.537 at all"),
    '"dielectric" "float eta" 1.001 "float roughness" .3': ({"kind": "dielectric", "index": 1.001}, ""),
    '"coateddiffuse" "float eta" 1': ({"kind": "matte", "reflectance": [0.5] * 3}, ""),
    '"conductor" "spectrum eta" "metal-CuZn-eta" "spectrum k" "metal-CuZn-k"': (
        {"kind": "conductor", "reflectance": [0.91, 0.778, 0.423], "alpha": 0.001}, "CuZn by constants"),
    '"conductor" "rgb eta" [.2 .9 1.1]': (
        {"kind": "conductor", "metal": {"n": [0.2, 0.9, 1.1], "k": [3.9] * 3}, "alpha": 0.001}, ""),
    '"conductor" "float k" 200': (
        {"kind": "conductor", "metal": {"n": [0.2] * 3, "k": [100.0] * 3}, "alpha": 0.001}, ""),
    # a straight line from 2 at 400 nm to 1 at 700 nm, at 610, 550 and 465 nm
    '"conductor" "spectrum eta" [700 1 400 2] "float k" 3': (
        {"kind": "conductor", "metal": {"n": [1.3, 1.5, 2 - 65 / 300], "k": [3.0] * 3}, "alpha": 0.001}, ""),
    '"conductor" "float roughness" 4': ({"kind": "conductor", "metal": "copper", "alpha": 1.0}, ""),
    '"conductor" "float roughness" -1': ({"kind": "conductor", "metal": "copper", "alpha": 0.001}, ""),
    '"metal"': ({"kind": "conductor", "metal": "copper", "alpha": alpha_of(0.01, version=3)}, ""),
    '"diffusetransmission" "rgb transmittance" [0 0 0]': ({"kind": "matte", "reflectance": [0.25] * 3}, ""),
    '"glass" "rgb Kt" [0 0 0]': (
        {"kind": "dielectric", "index": 1.5, "transmittance": [0.0] * 3}, ""),
    # Ks = 0.25 of the 4 % of index 1.5 is 1 %: (1 + 0.1) / (1 - 0.1)
    '"plastic"': (
        {"kind": "plastic", "reflectance": [0.25] * 3, "index": 1.1 / 0.9, "alpha": alpha_of(0.1, version=3)},
        "its gloss as that of a clear cover"),
    '"uber" "rgb Kr" [.1 .1 .1]': (
        {"kind": "plastic", "reflectance": [0.25] * 3, "index": 1.1 / 0.9, "alpha": alpha_of(0.1, version=3)},
        "the stronger gloss of Ks and Kr"),
    '"uber" "rgb Kr" [1 1 1] "rgb Ks" [.1 .1 .1] "float roughness" .4': (
        {"kind": "plastic", "reflectance": [0.25] * 3, "index": 1.5}, "the stronger gloss of Ks and Kr"),
    '"uber" "rgb Ks" [0 0 0] "float index" 1': ({"kind": "matte", "reflectance": [0.25] * 3}, ""),
    '"uber" "rgb Ks" [0 0 0] "float opacity" 1.5': ({"kind": "matte", "reflectance": [0.25] * 3}, ""),
    '"substrate" "rgb Ks" [0 0 0]': ({"kind": "matte", "reflectance": [0.5] * 3}, "reflects 0 head-on"),
    '"substrate"': (
        {"kind": "plastic", "reflectance": [0.5] * 3, "index": (1 + 0.4**0.5) / (1 - 0.4**0.5),
         "alpha": alpha_of(0.1, version=3)}, "reflects 0.4 head-on"),
    '"translucent" "rgb reflect" [1 1 1] "rgb Ks" [1 1 1]': (
        {"kind": "translucent", "reflectance": [0.25] * 3, "transmittance": [0.125] * 3}, "without its gloss"),
    '"translucent" "rgb transmit" [0 0 0] "rgb reflect" [1 1 1] "rgb Ks" [1 1 1]': (
        {"kind": "plastic", "reflectance": [0.25] * 3, "index": 1.5, "alpha": alpha_of(0.1, version=3)}, ""),
    '"diffusetransmission" "rgb reflectance" [.8 .8 .8] "rgb transmittance" [.8 .4 0]': (
        {"kind": "translucent", "reflectance": [0.5] * 3, "transmittance": [0.5, 0.25, 0.0]}, "divided by 1.6"),
    '"disney" "float spectrans" .5 "float eta" 1 "float anisotropic" 1 "float clearcoat" 2 "float clearcoatgloss" 0': (
        {"kind": "principled", "base_color": [0.5] * 3, "metallic": 0.0, "roughness": 0.5, "anisotropy": 1.0,
         "index": 1.02, "transmission": 0.5, "clearcoat": 1.0, "clearcoat_roughness": math.sqrt(0.1)}, ""),
    '"disney" "float eta" .5': (
        {"kind": "principled", "base_color": [0.5] * 3, "metallic": 0.0, "roughness": 0.5, "anisotropy": 0.0,
         "index": 1.0, "transmission": 0.0, "clearcoat": 0.0, "clearcoat_roughness": math.sqrt(0.001)}, ""),
    '"subsurface" "rgb Kd" [.2 .3 .4] "float eta" 1.4 "float roughness" .04': (
        {"kind": "dielectric", "index": 1.4, "alpha": 0.2,
         "interior": {"color": [0.2, 0.3, 0.4], "free_path_mm": [1000.0] * 3}}, "walks at random"),
    '"subsurface" "string name" "Skin1"': (
        {"kind": "dielectric", "index": 1.33,
         "interior": {"absorption_per_m": [0.032, 0.17, 0.48], "scattering_per_m": [0.74, 0.88, 1.01]}}, "at random"),
    '"shinymetal" "color Ks" [.1 .1 .1] "color Kr" [.5 .4 .3]': (
        {"kind": "conductor", "reflectance": [0.5, 0.4, 0.3], "alpha": 0.001}, "the stronger"),
    '"thindielectric" "float eta" 1.4': ({"kind": "thin_glass", "index": 1.4}, ""),
    '"conductor"': ({"kind": "conductor", "metal": "copper", "alpha": 0.001}, ""),
    '"conductor" "spectrum eta" "metal-Au-eta" "spectrum k" "metal-Au-k" "float roughness" .04': (
        {"kind": "conductor", "metal": "gold", "alpha": 0.2}, ""),
    '"conductor" "rgb reflectance" [.9 .8 .7] "float roughness" 1': (
        {"kind": "conductor", "metal": {"n": [1.0] * 3, "k": [6.0, 4.0, 2 * math.sqrt(0.7 / 0.3)]}, "alpha": 1.0}, ""),
    '"conductor" "rgb eta" [.2 .9 1.1] "rgb k" [3.9 2.4 2.2] "float roughness" 1': (
        {"kind": "conductor", "metal": {"n": [0.2, 0.9, 1.1], "k": [3.9, 2.4, 2.2]}, "alpha": 1.0}, ""),
    '"metal" "float roughness" .25 "bool remaproughness" "false"': (
        {"kind": "conductor", "metal": "copper", "alpha": 0.25}, ""),
    '"diffusetransmission" "rgb reflectance" [.5 .5 .5] "float scale" .5': (
        {"kind": "translucent", "reflectance": [0.25] * 3, "transmittance": [0.125] * 3}, ""),
    '"mirror"': ({"kind": "mirror", "reflectance": [0.9] * 3}, ""),
    '"glass" "float index" 1.6': ({"kind": "dielectric", "index": 1.6}, ""),
    '"glass" "rgb Kt" [.5 1 1]': ({"kind": "dielectric", "index": 1.5, "transmittance": [0.5, 1, 1]}, ""),
    '"glass" "float uroughness" .1 "float vroughness" .1': (
        {"kind": "dielectric", "index": 1.5, "alpha": alpha_of(0.1, version=3)}, ""),
    '"plastic" "rgb Kd" [.1 .2 .3] "rgb Ks" [1 1 1] "float roughness" .1': (
        {"kind": "plastic", "reflectance": [0.1, 0.2, 0.3], "index": 1.5, "alpha": alpha_of(0.1, version=3)}, ""),
    '"plastic" "rgb Ks" [0 0 0]': ({"kind": "matte", "reflectance": [0.25] * 3}, ""),
    '"substrate" "rgb Ks" [.04 .04 .04] "float uroughness" .1 "float vroughness" .1': (
        {"kind": "plastic", "reflectance": [0.5] * 3, "index": 1.5, "alpha": alpha_of(0.1, version=3)}, "head-on"),
    '"uber" "rgb Kd" [0 0 0] "rgb Ks" [0 0 0] "rgb Kt" [1 1 1]': ({"kind": "dielectric", "index": 1.5}, ""),
    '"uber" "rgb Ks" [0 0 0] "float opacity" .5': (
        {"kind": "matte", "reflectance": [0.25] * 3, "opacity": 0.5}, ""),
    '"uber" "rgb Ks" [0 0 0] "rgb Kr" [1 1 1] "float eta" 1.8': (
        {"kind": "plastic", "reflectance": [0.25] * 3, "index": 1.8}, ""),
    '"uber" "rgb Ks" [0 0 0] "rgb Kt" [.5 .5 .5] "float opacity" .9': (
        {"kind": "mix", "factor": 0.5, "opacity": 0.9,
         "materials": [{"kind": "matte", "reflectance": [0.5] * 3}, {"kind": "dielectric", "index": 1.5}]},
        "0.5 of it clear glass"),
    '"translucent" "rgb Ks" [0 0 0]': (
        {"kind": "translucent", "reflectance": [0.125] * 3, "transmittance": [0.125] * 3}, ""),
    '"disney" "rgb color" [.2 .3 .4] "float metallic" 1 "float roughness" .3 "float sheen" .2': (
        {"kind": "principled", "base_color": [0.2, 0.3, 0.4], "metallic": 1.0, "roughness": 0.3, "anisotropy": 0.0,
         "index": 1.5, "transmission": 0.0, "clearcoat": 0.0, "clearcoat_roughness": math.sqrt(0.001)}, "sheen"),
    '"subsurface" "rgb reflectance" [.2 .3 .4]': (
        {"kind": "dielectric", "index": 1.33,
         "interior": {"color": [0.2, 0.3, 0.4], "free_path_mm": [1000.0] * 3}}, "walks at random"),
    '"shinymetal" "color Ks" [.5 .4 .3] "color Kr" [.1 .1 .1] "float roughness" .25': (
        {"kind": "conductor", "reflectance": [0.5, 0.4, 0.3], "alpha": math.sqrt(2 / 6)}, "the stronger"),
    '"fourier" "string bsdffile" "a.bsdf"': ({"kind": "matte", "reflectance": [0.5] * 3}, "matte grey 0.5"),
}  # fmt: skip


@pytest.mark.parametrize("text", KINDS)
def test_materials(convert: Convert, text: str) -> None:
    keys, words = KINDS[text]
    done = convert(f"Material {text}{BALL}", HEAD)
    assert done.material() == near(keys)
    told = [line for line in done.report if "Material" in line]
    assert bool(told) == bool(words), told
    assert not words or done.says("in.pbrt:2: ", words)


def test_named_materials_keep_their_names(convert: Convert) -> None:
    text = 'MakeNamedMaterial "my red" "string type" "diffuse" "rgb reflectance" [1 0 0] NamedMaterial "my red"' + BALL
    done = convert(text + 'Material "diffuse" "rgb reflectance" [1 0 0]' + BALL + 'Material "diffuse"' + BALL, HEAD)
    assert [item["material"] for item in done.objects] == ["my red", "my red", "diffuse"]  # equal ones are one


def test_a_material_may_be_named_before_it_is_made(convert: Convert) -> None:
    text = f'NamedMaterial "a" {BALL} MakeNamedMaterial "a" "string type" "mirror"'
    assert convert(text, HEAD).material()["kind"] == "mirror"


def test_materials_belong_to_their_block(convert: Convert) -> None:
    text = f'AttributeBegin Material "mirror" {BALL} AttributeEnd {BALL}'
    done = convert(text, HEAD)
    assert [done.material(index)["kind"] for index in (0, 1)] == ["mirror", "matte"]


def test_boundaries_of_media_have_no_surface(convert: Convert) -> None:
    for kind in ("interface", "none", ""):
        done = convert(f'Material "{kind}"{BALL} Material "diffuse" Shape "disk"', HEAD)
        assert [item["shape"] for item in done.objects] == ["disk"]
        assert done.says('in.pbrt:3: ignored: Shape "sphere": the boundary of a medium')


MIXED = 'MakeNamedMaterial "a" "string type" "mirror" MakeNamedMaterial "b" "string type" "diffuse"'


@pytest.mark.parametrize(
    ("text", "kinds"),
    [
        ('"string materials" ["a" "b"] "float amount" .25', ["mirror", "matte"]),  # pbrt-v4: share of the second
        ('"string namedmaterial1" "a" "string namedmaterial2" "b" "float amount" .25', ["matte", "mirror"]),
    ],
)
def test_mixtures_weigh_the_material_that_pbrt_does(convert: Convert, text: str, kinds: list[str]) -> None:
    material = convert(f'{MIXED} Material "mix" {text}{BALL}', HEAD).material()
    assert material["factor"] == 0.25
    assert [part["kind"] for part in material["materials"]] == kinds


def test_alpha_makes_holes(convert: Convert) -> None:
    done = convert('Shape "sphere" "float alpha" .25\nShape "sphere" "float alpha" 0', HEAD)
    assert done.material()["opacity"] == 0.25
    assert len(done.objects) == 1
    assert done.says('in.pbrt:3: ignored: Shape "sphere": wholly transparent')


def test_roughness_polynomial_and_root() -> None:
    # values of the polynomial by hand: at 1 the logarithm is 0
    assert alpha_of(1, version=3) == 1.62142
    x = math.log(0.2)
    assert alpha_of(0.2, version=3) == pytest.approx(
        1.62142 + x * (0.819955 + x * (0.1734 + x * (0.0171201 + x * 0.000640711)))
    )
    assert alpha_of(0.2, version=4) == pytest.approx(math.sqrt(0.2))


IMAGE = 'Texture "t" "spectrum" "imagemap" "string filename" "a.png" {} Material "diffuse" "texture reflectance" "t"'


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("", {}),
        ('"float uscale" 2 "float vscale" 3 "float udelta" .5', {"scale": [2, 3], "offset": [0.5, 0]}),
        ('"string wrap" "clamp"', {"wrap": "clamp"}),
        ('"string encoding" "linear"', {"color_space": "linear"}),
        ('"bool gamma" "true"', {"color_space": "srgb"}),
        ('"float scale" .5', {"gain": 0.5}),
    ],
)
def test_pictures(convert: Convert, text: str, keys: dict[str, Any]) -> None:
    done = convert(IMAGE.format(text) + BALL, HEAD, **{"a.png": png()})
    assert done.material()["reflectance"] == {"kind": "image", "file": "a.png", **keys}
    assert done.report == []


@pytest.mark.parametrize(
    ("text", "keys", "words"),
    [
        ('"bool invert" true', {}, "ignored: Texture"),
        ('"string wrap" "black"', {"wrap": "clamp"}, 'wrap "black" as clamp'),
        ('"string encoding" "gamma 2.2"', {"color_space": "srgb"}, 'encoding "gamma 2.2" as sRGB'),
        ('"bool gamma" "false"', {"color_space": "linear"}, ""),
        ('"string encoding" "sRGB" "bool gamma" "false"', {"color_space": "srgb"}, ""),
        ('"string wrap" "octahedralsphere"', {"wrap": "clamp"}, ""),
        ('"float scale" -1 "float udelta" 0', {"gain": 0}, ""),
        ('"float maxanisotropy" 4 "string filter" "ewa"', {}, ""),
        ('"string filter" "point"', {"filter": "nearest"}, ""),
    ],
)
def test_pictures_as_near_as_ours_come(convert: Convert, text: str, keys: dict[str, Any], words: str) -> None:
    done = convert(IMAGE.format(text) + BALL, HEAD, **{"a.png": png()})
    assert done.material()["reflectance"] == {"kind": "image", "file": "a.png", **keys}
    told = [line for line in done.report if "bool gamma" not in line]
    assert bool(told) == bool(words), told
    assert not words or done.says("in.pbrt:2: ", words)


def test_a_metal_of_a_texture_reflects_it_at_every_angle_and_says_so(convert: Convert) -> None:
    text = IMAGE.format("").replace('"diffuse"', '"conductor" "float roughness" .3')
    done = convert(text + BALL, HEAD, **{"a.png": png()})
    assert done.material()["reflectance"] == {"kind": "image", "file": "a.png"}
    assert done.says("at every angle alike")


def test_kinds_of_pictures_that_are_not_read_are_grey(convert: Convert) -> None:
    done = convert(IMAGE.format("").replace("a.png", "a.gif") + BALL, HEAD, **{"a.gif": b"x"})
    assert done.material()["reflectance"] == [0.5] * 3
    assert done.says("a.gif: a kind of picture that is not read")


def test_tga_pictures_are_written_anew(convert: Convert, tmp_path: Any) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (3, 5, 4), np.uint8)
    stream = BytesIO()
    PIL.Image.fromarray(pixels).save(stream, format="TGA")
    done = convert((IMAGE.format("") + BALL).replace("a.png", "a.tga") * 2, HEAD, **{"a.tga": stream.getvalue()})
    assert done.material()["reflectance"] == {"kind": "image", "file": "out_files/a.png"}
    with PIL.Image.open(tmp_path / "out_files" / "a.png") as image:
        np.testing.assert_array_equal(np.asarray(image), pixels)
    assert done.says("a.tga: written anew, to out_files/a.png")
    assert [path.name for path in (tmp_path / "out_files").iterdir()] == ["a.png"]


@pytest.mark.parametrize(("order", "scale"), [("<", "-1.0"), (">", "1.0")])
@pytest.mark.parametrize("channels", [1, 3])
def test_float_maps_are_written_anew(convert: Convert, tmp_path: Any, order: str, scale: str, channels: int) -> None:
    pixels = np.random.default_rng(2).random((3, 5, channels)).astype(np.float32)
    head = f"{'PF' if channels == 3 else 'Pf'}\n5 3\n{scale}\n".encode()
    content = head + pixels[::-1].astype(f"{order}f4").tobytes()
    done = convert(IMAGE.format("").replace("a.png", "a.pfm") + BALL, HEAD, **{"a.pfm": content})
    assert done.material()["reflectance"]["file"] == "out_files/a.exr"
    found = read_picture(tmp_path / "out_files" / "a.exr").texels[..., :3]
    np.testing.assert_array_equal(found, np.broadcast_to(pixels, (3, 5, 3)))


CHECKS = 'Texture "t" "spectrum" "checkerboard" "rgb tex1" [.1 .2 .3] "rgb tex2" [.4 .5 .6] "float uscale" 4\n'
CELLS = {"kind": "checker", "even": [0.1, 0.2, 0.3], "odd": [0.4, 0.5, 0.6], "scale": [4, 1]}
TEXTURES: dict[str, tuple[Any, str]] = {
    CHECKS: ({"kind": "checker", "even": [0.1, 0.2, 0.3], "odd": [0.4, 0.5, 0.6], "scale": [4, 1]}, ""),
    'Texture "t" "spectrum" "constant" "rgb value" [.1 .2 .3]': ([0.1, 0.2, 0.3], ""),
    CHECKS.replace('"t"', '"c"') + 'Texture "t" "spectrum" "scale" "texture tex" "c" "float scale" .5': (
        {"kind": "checker", "even": [0.05, 0.1, 0.15], "odd": [0.2, 0.25, 0.3], "scale": [4, 1]}, ""),
    'Texture "t" "spectrum" "scale" "rgb tex1" [.4 .4 .4] "rgb tex2" [.5 .25 1]': ([0.2, 0.1, 0.4], ""),
    'Texture "t" "spectrum" "mix" "rgb tex1" [0 0 0] "rgb tex2" [1 .5 .25] "float amount" .25': (
        [0.25, 0.125, 0.0625], ""),
    'Texture "t" "spectrum" "mix" "rgb tex1" [0 0 0] "rgb tex2" [1 1 1] "rgb amount" [.25 .5 .75]': (
        [0.25, 0.5, 0.75], ""),
    'Texture "t" "color" "mix" "color tex1" [.2 .2 .2] "color tex2" [1 1 1] "color amount" [1 0 .5]': (
        [1, 0.2, 0.6], ""),
    CHECKS.replace('"t"', '"c"') + 'Texture "t" "spectrum" "mix" "texture tex1" "c" "float amount" 0': (
        {"kind": "checker", "even": [0.1, 0.2, 0.3], "odd": [0.4, 0.5, 0.6], "scale": [4, 1]}, ""),
    'Texture "t" "spectrum" "dots" "rgb inside" [1 0 0] "rgb outside" [0 0 1]': (
        # pbrt hands the two to its constructor in the wrong order, and pictures made with it show that
        {"kind": "dots", "inside": [0.0, 0.0, 1.0], "outside": [1.0, 0.0, 0.0]}, ""),
    CHECKS.replace('"float uscale" 4', '"string mapping" "planar" "vector3 v1" [1 0 0]'): (
        {"kind": "checker", "even": [0.1, 0.2, 0.3], "odd": [0.4, 0.5, 0.6],
         "mapping": {"matrix": [[1.0, 0, 0, 0], [0, 1, 0, 0], [0] * 4]}}, ""),
    CHECKS.replace('"float uscale" 4', '"integer dimension" 3 "string aamode" "none"'): (
        {"kind": "checker", "even": [0.1, 0.2, 0.3], "odd": [0.4, 0.5, 0.6],
         "mapping": {"matrix": np.eye(4)[:3].tolist()}}, ""),
    CHECKS.replace('"float uscale" 4', '"float vdelta" .5'): (
        {"kind": "checker", "even": [0.1, 0.2, 0.3], "odd": [0.4, 0.5, 0.6], "offset": [0, 0.5]}, ""),
    'Texture "t" "spectrum" "checkerboard"': ({"kind": "checker", "even": [1.0] * 3, "odd": [0.0] * 3}, ""),
    CHECKS.replace('"t"', '"c"') + 'Texture "t" "spectrum" "checkerboard" "texture tex2" "c"': (
        {"kind": "mixture", "first": [1.0] * 3, "second": CELLS,
         "amount": {"kind": "checker", "even": 0.0, "odd": 1.0}}, ""),
    CHECKS.replace('"t"', '"c"') + 'Texture "t" "spectrum" "scale" "texture tex" "c" "texture scale" "c"': (
        {"kind": "mixture", "first": [0.0] * 3, "second": CELLS, "amount": CELLS}, ""),
    CHECKS.replace('"t"', '"c"') + 'Texture "t" "spectrum" "mix" "texture tex1" "c" "texture tex2" "c"': (
        {"kind": "mixture", "first": CELLS, "second": CELLS, "amount": [0.5] * 3}, ""),
    CHECKS.replace('"t"', '"c"') + 'Texture "t" "spectrum" "dots" "texture inside" "c" "rgb outside" [1 0 0]': (
        {"kind": "mixture", "first": CELLS, "second": [1.0, 0.0, 0.0],
         "amount": {"kind": "dots", "inside": 1.0, "outside": 0.0}}, ""),
    CHECKS.replace('"t"', '"c"') + 'Texture "t" "spectrum" "scale" "rgb scale" [.5 .5 .5] "texture tex" "c"': (
        {"kind": "checker", "even": [0.05, 0.1, 0.15], "odd": [0.2, 0.25, 0.3], "scale": [4, 1]}, ""),
    CHECKS.replace('"t"', '"c"') + 'Texture "t" "spectrum" "mix" "texture tex1" "c" "rgb tex2" [1 1 1]': (
        {"kind": "checker", "even": [0.55, 0.6, 0.65], "odd": [0.7, 0.75, 0.8], "scale": [4, 1]}, ""),
    'Texture "t" "spectrum" "mix"': ([0.5] * 3, ""),
    'Texture "t" "spectrum" "scale" "rgb tex1" [.4 .4 .4]': ([0.4] * 3, ""),
    'Texture "t" "spectrum" "constant"': ([1.0] * 3, ""),
    'Texture "t" "spectrum" "dots"': ({"kind": "dots", "inside": [0.0] * 3, "outside": [1.0] * 3}, ""),
    'Texture "t" "spectrum" "fbm" "float roughness" .25': (
        {"kind": "perlin", "octaves": 8, "gain": 0.25, "mapping": {"matrix": np.eye(4)[:3].tolist()}}, ""),
    'Texture "t" "spectrum" "ptex"': ([0.5] * 3, "grey 0.5"),
}  # fmt: skip


@pytest.mark.parametrize("text", TEXTURES)
def test_textures(convert: Convert, text: str) -> None:
    keys, words = TEXTURES[text]
    done = convert(text + ' Material "diffuse" "texture reflectance" "t"' + BALL, HEAD)
    assert done.material()["reflectance"] == near(keys)
    assert bool(done.report) == bool(words)
    assert not words or done.says(words)


def test_colours_where_numbers_are_expected(convert: Convert) -> None:
    """Equal channels are a number; others are told to be their mean."""
    done = convert('Material "plastic" "rgb roughness" [.1 .1 .1] "rgb Ks" [1 1 1]' + BALL, HEAD)
    assert done.material()["alpha"] == near(alpha_of(0.1, version=3))
    assert not done.says("mean")
    done = convert('Material "glass" "color index" [1.4 1.5 1.6]' + BALL, HEAD)
    assert done.material() == near({"kind": "dielectric", "index": 1.5})
    assert done.says('"index" as the number 1.5')
    done = convert('Material "disney" "rgb metallic" [.1 .2 .3] "color roughness" [.4 .4 .4]' + BALL, HEAD)
    assert [done.material()[key] for key in ("metallic", "roughness")] == near([0.2, 0.4])
    assert done.says('the colour "metallic" as its mean')
    done = convert('Material "uber" "rgb Ks" [0 0 0] "rgb opacity" [.1 .2 .3]' + BALL, HEAD)
    assert done.material()["opacity"] == near(0.2)
    assert done.says('the colour "opacity" as its mean')


PICTURE = 'Texture "p" "{}" "imagemap" "string filename" "a.png" '


METALS = {
    "": None,
    '"rgb conductor.eta" [.2 .9 1.1] "rgb conductor.k" [3.9 2.4 2.2]': ([0.2, 0.9, 1.1], [3.9, 2.4, 2.2]),
    '"rgb conductor.reflectance" [.9 .5 .1]': ([1.0] * 3, [6.0, 2.0, 2 / 3]),  # pbrt: n = 1, 2 sqrt(r) / sqrt(1 - r)
}


@pytest.mark.parametrize("text", METALS)
def test_coated_metals_reflect_head_on_what_two_smooth_faces_do(convert: Convert, text: str) -> None:
    """The series R + T² r (1 + R r + …) of a cover that reflects R over a metal that reflects r below it."""
    rough = ' "float conductor.roughness" .04 "float interface.roughness" .01'
    found = convert(f'Material "coatedconductor" {text}{rough}' + BALL, HEAD).material()
    assert (found["kind"], found["metallic"], found["clearcoat"]) == ("principled", 1, 1)
    assert [found["roughness"], found["clearcoat_roughness"]] == near([0.2**0.5, 0.1**0.5])
    base = np.array(found["base_color"])
    assert base[0] > base[1] > base[2] > 0.1
    if (known := METALS[text]) is not None:
        n, k = (np.array(each) / 1.5 for each in known)
        below = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
        layers = sum(0.96**2 * below * (0.04 * below) ** bounce for bounce in range(20))
        np.testing.assert_allclose(0.96**2 * base, np.minimum(layers, 0.96**2), rtol=1e-6)


@pytest.mark.parametrize("kind", ["float", "spectrum"])
def test_pictures_where_ours_takes_a_number_or_a_texture(convert: Convert, kind: str) -> None:
    shown = {"kind": "image", "file": "a.png"}
    text = PICTURE.format(kind) + 'Material "uber" "rgb Ks" [0 0 0] "texture opacity" "p"' + BALL
    done = convert(text, HEAD, **{"a.png": GREY_PNG})
    assert done.material() == {"kind": "matte", "reflectance": [0.25] * 3, "opacity": shown}
    assert done.report == []
    text = MIXED + PICTURE.format(kind) + 'Material "mix" {} "texture amount" "p"' + BALL
    older = '"string namedmaterial1" "a" "string namedmaterial2" "b"'
    for names, kinds in (('"string materials" ["a" "b"]', ["mirror", "matte"]), (older, ["matte", "mirror"])):
        done = convert(text.format(names), HEAD, **{"a.png": GREY_PNG})
        assert done.material()["factor"] == shown
        assert [part["kind"] for part in done.material()["materials"]] == kinds
        assert done.report == []


def test_numbers_by_textures_are_their_means(convert: Convert) -> None:
    text = 'Texture "p" "float" "constant" "float value" .25 Material "dielectric" "texture roughness" "p"' + BALL
    done = convert(text, HEAD)
    assert (done.material()["alpha"], done.report) == (0.5, [])
    done = convert(
        PICTURE.format("float") + 'Material "disney" "texture anisotropic" "p"' + BALL, HEAD, **{"a.png": png()}
    )
    encoded = np.array([200, 100, 50]) / 255
    assert done.material()["anisotropy"] == pytest.approx((((encoded + 0.055) / 1.055) ** 2.4).mean(), rel=1e-5)
    assert done.says('"anisotropic" is its mean, not a texture')


@pytest.mark.parametrize("kind", ["pfm", "tga", "exr"])
def test_means_of_pictures_of_every_kind(convert: Convert, tmp_path: Any, kind: str) -> None:
    pixels = np.random.default_rng(2).random((3, 5, 3)).astype(np.float32)
    linear = pixels.mean(axis=(0, 1))
    if kind == "exr":
        write_exr({"RGB": pixels}, tmp_path / "a.exr")
        content = (tmp_path / "a.exr").read_bytes()
    elif kind == "pfm":
        content = b"PF\n5 3\n-1.0\n" + pixels[::-1].astype("<f4").tobytes()
    else:
        stream, octets = BytesIO(), (pixels * 255).astype(np.uint8)
        PIL.Image.fromarray(octets).save(stream, format="TGA")
        content, encoded = stream.getvalue(), octets / 255
        linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).mean(axis=(0, 1))
    picture = f'Texture "p" "spectrum" "imagemap" "string filename" "a.{kind}" Material "mirror" "texture Kr" "p"'
    done = convert(picture + BALL, HEAD, **{f"a.{kind}": content})
    np.testing.assert_allclose(done.material()["reflectance"], linear, rtol=1e-5)


def test_linear_bytes_have_a_linear_mean(convert: Convert) -> None:
    text = (
        IMAGE.format('"string encoding" "linear" "float scale" .5')
        .replace("diffuse", "mirror")
        .replace("reflectance", "Kr")
    )
    done = convert(text + BALL, HEAD, **{"a.png": png()})
    np.testing.assert_allclose(done.material()["reflectance"], np.array([200, 100, 50]) / 510, rtol=1e-5)


def test_mixtures_of_what_ours_cannot_mix(convert: Convert) -> None:
    made = MIXED + 'MakeNamedMaterial "n" "string type" "interface" MakeNamedMaterial "m" "string type" "mix" '
    made += '"string materials" ["a" "b"] '
    for names, kind in (("n b", "matte"), ("a n", "mirror"), ("m b", "matte"), ("m m", "mix")):
        first, second = names.split()
        done = convert(f'{made} Material "mix" "string materials" ["{first}" "{second}"]{BALL}', HEAD)
        assert done.material()["kind"] == kind
        assert done.says("the one of its materials that is a plain surface")
    done = convert(f'{made} Material "mix" "string materials" ["n" "n"]{BALL} Material "diffuse" Shape "disk"', HEAD)
    assert [item["shape"] for item in done.objects] == ["disk"]


def test_mixtures_have_no_holes_and_no_amount_beyond_one(convert: Convert) -> None:
    holes = 'MakeNamedMaterial "h" "string type" "uber" "rgb Ks" [0 0 0] "float opacity" .5 '
    done = convert(MIXED + holes + f'Material "mix" "string materials" ["a" "h"] "float amount" 3{BALL}', HEAD)
    assert done.material()["factor"] == 1
    assert done.material()["materials"][1] == {"kind": "matte", "reflectance": [0.25] * 3}
    assert done.says("the opacity of its materials")


GREYS = 'MakeNamedMaterial "a" "string type" "matte" "rgb Kd" [1 0 .5] MakeNamedMaterial "b" "string type" "{}" '


def test_materials_mixed_by_a_colour(convert: Convert) -> None:
    mix = 'Material "mix" "string namedmaterial1" "a" "string namedmaterial2" "b" "rgb amount" [.25 .5 .75]'
    done = convert(GREYS.format("matte") + mix + BALL, HEAD)
    share = np.array([0.25, 0.5, 0.75])  # of the first
    assert done.material() == near({"kind": "matte", "reflectance": (share * [1, 0, 0.5] + (1 - share) / 2).tolist()})
    assert done.report == []
    done = convert(GREYS.format("mirror") + mix + BALL, HEAD)
    assert done.material()["factor"] == near(0.5)
    assert done.says('Material "mix": the colour "amount" as its mean')


def test_a_parameter_that_is_given_twice_counts_as_its_last(convert: Convert) -> None:
    done = convert('Material "matte" "rgb Kd" [1 0 0]\n  "color Kd" [0 1 0]' + BALL, HEAD)
    assert done.material()["reflectance"] == [0, 1, 0]
    assert len(done.report) == 1
    assert done.says('in.pbrt:2: note: Material "matte": "Kd" is given twice; the last one counts')
    ball = 'Shape "sphere" "float radius" 3 "float radius" 2 "float radius" 4'
    done = convert(ball, HEAD)
    assert done.objects[0]["radius"] == 4
    assert len(done.report) == 1


def test_a_texture_is_the_one_that_had_the_name_then(convert: Convert) -> None:
    text = "".join(
        f'Texture "t" "spectrum" "constant" "rgb value" [{grey} {grey} {grey}] '
        f'Material "diffuse" "texture reflectance" "t"{BALL}'
        for grey in (0.25, 0.75)
    )
    done = convert(text, HEAD)
    assert [done.material(index)["reflectance"][0] for index in (0, 1)] == [0.25, 0.75]


def test_textures_of_textures_are_looked_at_once(convert: Convert) -> None:
    """Each is the product of the one before with itself: 2^30 products, unless each is kept."""
    text = 'Texture "t0" "spectrum" "constant" "rgb value" [1 1 1]\n'
    for index in range(30):
        factors = f'"texture tex1" "t{index}" "texture tex2" "t{index}"'
        text += f'Texture "t{index + 1}" "spectrum" "scale" {factors}\n'
    done = convert(text + f'Material "diffuse" "texture reflectance" "t30"{BALL}', HEAD)
    assert done.material()["reflectance"] == [1, 1, 1]


def test_textures_are_followed_so_far_only(convert: Convert) -> None:
    text = 'Texture "t0" "spectrum" "constant"\n'
    text += "".join(f'Texture "t{index + 1}" "spectrum" "scale" "texture tex1" "t{index}"\n' for index in range(40))
    with pytest.raises(InputError, match="refer to each other more than 32 deep"):
        convert(text + f'Material "diffuse" "texture reflectance" "t40"{BALL}', HEAD)


COLOURS = {
    '"rgb reflectance" [.1 .2 .3]': [0.1, 0.2, 0.3],
    '"xyz reflectance" [.475228 .5 .544529]': [0.5, 0.5, 0.5],  # half of the white D65
    '"spectrum reflectance" [400 .25 700 .25]': [0.25] * 3,
    '"spectrum reflectance" "a.spd"': [0.75] * 3,
    '"spectrum reflectance" [ 0.3 ]': [0.3] * 3,
}


@pytest.mark.parametrize("text", COLOURS)
def test_reflectances_of_every_type(convert: Convert, text: str) -> None:
    done = convert(f'Material "diffuse" {text}{BALL}', HEAD, **{"a.spd": "# nm\n400 .75\n500 .75 700,.75\n"})
    np.testing.assert_allclose(done.material()["reflectance"], COLOURS[text], atol=2e-5)


def test_spectra_keep_their_hue() -> None:
    red = reflectance_srgb([600, 601], [0, 1])
    green = reflectance_srgb([500, 501, 570, 571], [0, 1, 1, 0])
    assert red[0] > 5 * abs(red[1:]).max()
    assert green[1] > 2 * max(green[0], green[2])
    # A black body of 6504 K is nearly D65; one of 2856 K is the standard illuminant A, x 0.4476 y 0.4074
    np.testing.assert_allclose(black_body_srgb(6504, luminance=1), [1, 1, 1], atol=0.06)
    np.testing.assert_allclose(black_body_srgb(2856, luminance=1), [1.845, 0.826, 0.233], atol=0.03)


def test_wide_colour_spaces_are_turned_into_ours(convert: Convert) -> None:
    for space in ("rec2020", "dci-p3", "aces2065-1"):
        text = f'ColorSpace "{space}" Material "diffuse" "rgb reflectance" {{}}{BALL}'
        np.testing.assert_allclose(convert(text.format("[.5 .5 .5]"), HEAD).material()["reflectance"], 0.5)
        done = convert(text.format("[1 0 0]"), HEAD)
        assert done.material()["reflectance"] == [1, 0, 0]
        assert done.says("is cut to 0 … 1")


FORGIVEN = {
    'Material "velvet"': "matte, as in pbrt-v3, since there is no such material",
    'NamedMaterial "x"': 'NamedMaterial "x": no material has the name; the one before, or grey 0.5',
    'Material "diffuse" "texture reflectance" "x"': '"reflectance" is 0.5 in place of "x": no spectrum texture has the',
    'Texture "t" "float" "constant" Material "diffuse" "texture reflectance" "t"': "one of the other type has, on",
    'Texture "t" "spectrum" "constant" Material "diffuse" "texture reflectance" ["t" "t"]': "no spectrum texture",
    'Texture "t" "spectrum" "cloth" Material "diffuse" "texture reflectance" "t"': 'there is no texture "cloth"',
    'Material "diffuse" "string reflectance" "red"': 'ignored: Material "diffuse": "string reflectance"',
    'MakeNamedMaterial "m" "string type" "mix" "string materials" ["a" "b"] NamedMaterial "m"': "no material has the",
}


@pytest.mark.parametrize("text", FORGIVEN)
def test_unknown_names_and_types_become_grey(convert: Convert, text: str) -> None:
    done = convert(text + BALL, HEAD)
    assert done.says(FORGIVEN[text])
    assert done.material() == {"kind": "matte", "reflectance": [0.5, 0.5, 0.5]} or "materials" in done.material()


def test_an_unknown_name_leaves_the_material_before_it(convert: Convert) -> None:
    done = convert(f'Material "mirror" NamedMaterial "x" NamedMaterial "y"{BALL}', HEAD)
    assert done.material()["kind"] == "mirror"


BAD = {
    'Material "dielectric" "float eta" 9': '"eta" must lie between 0.2 and 5 (got 9)',
    'Material "diffuse" "spectrum reflectance" "no.spd"': "no such file",
    'Material "diffuse" "spectrum reflectance" [400 .1 500]': "needs pairs of a wavelength",
    'Material "diffuse" "spectrum reflectance" ["a" "b"]': '"reflectance" needs one spectrum (got 2)',
    'Material "diffuse" "spectrum reflectance" "words.spd"': "words.spd: must hold pairs of a wavelength",
    'Material "diffuse" "blackbody reflectance" 3000': '"reflectance" cannot be a blackbody',
    'Material "diffuse" "rgb reflectance" [1 0 0 1 0 0]': '"reflectance" needs 3 numbers (got 6)',
    'Material "diffuse" "float reflectance" [1 0]': '"reflectance" needs 3 numbers (got 2)',
    'Material "plastic" "string remaproughness" "maybe"': '"remaproughness" must be true or false (got "maybe")',
    'Material "dielectric" "float eta" .1': '"eta" must lie between 0.2 and 5 (got 0.1)',
    IMAGE.format("").replace("a.png", "nan.pfm"): "nan.pfm: holds numbers that are not finite",
    IMAGE.format("").replace("a.png", "none.pfm"): "none.pfm: holds fewer than its 0 x 9 pixels",
    'Material "mix" "string materials" ["a"]': "needs the names of two materials (got 1)",
    'MakeNamedMaterial "m" "string type" "mix" "string materials" ["m" "m"] NamedMaterial "m"': "mix each other more",
    IMAGE.format("").replace("a.png", "bad.tga"): "bad.tga: is not a TGA picture",
    IMAGE.format("").replace("a.png", "bad.pfm"): "bad.pfm: is not a PFM picture",
    IMAGE.format("").replace("a.png", "cut.pfm"): "holds fewer than its 9 x 9 pixels",
    'Texture "t" "spectrum" "imagemap" Material "diffuse" "texture reflectance" "t"': 'a parameter "string filename"',
}


@pytest.mark.parametrize("text", BAD)
def test_bad_materials_are_told(convert: Convert, text: str) -> None:
    with pytest.raises(InputError, match=r"in\.pbrt:2:") as problem:
        convert(
            text + BALL,
            HEAD,
            **{
                "bad.tga": b"x",
                "bad.pfm": b"PF",
                "cut.pfm": b"PF\n9 9\n-1.0\n1234",
                "nan.pfm": b"Pf\n1 1\n-1.0\n\xff\xff\xff\xff",
                "none.pfm": b"Pf\n0 9\n-1.0\n",
                "words.spd": "400 one",
            },
        )
    assert BAD[text] in str(problem.value)


FOG = 'MakeNamedMedium "fog" "rgb sigma_a" [.1 .2 .3] "rgb sigma_s" [4 5 6] "float g" .5 "float scale" 2 '


def test_media_fill_glass_clouds_and_the_space_around_the_camera(convert: Convert) -> None:
    inside = 'MediumInterface "fog" "" Material "interface" Shape "sphere" Material "dielectric" Shape "sphere"'
    done = convert(inside, f'{FOG} MediumInterface "" "fog" {HEAD}')
    fog = {"absorption_per_m": [0.2, 0.4, 0.6], "scattering_per_m": [8.0, 10.0, 12.0], "asymmetry": 0.5}
    assert done.keys["medium"] == near(fog)
    assert done.material(0) == near({"kind": "boundary", "interior": fog})
    assert done.material(1) == near({"kind": "dielectric", "index": 1.5, "interior": fog})


def test_measured_materials_keep_their_file_and_others_are_grey(convert: Convert) -> None:
    merl = struct.pack("<3i", 90, 90, 180) + np.full(3 * 90 * 90 * 180, 75.0).tobytes()
    text = 'Material "measured" "string filename" "m.binary"' + BALL
    assert convert(text, **{"m.binary": merl}).material() == {"kind": "measured", "file": "m.binary"}
    done = convert(text, **{"m.binary": b"1 2 3"})
    assert done.material() == {"kind": "matte", "reflectance": [0.5, 0.5, 0.5]}
    assert done.says("matte grey 0.5, as m.binary is no measured reflection")
