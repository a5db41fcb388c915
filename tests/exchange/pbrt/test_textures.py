"""Colours of textures: tints, means and coordinates."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import PIL.Image
import pytest

from rptcam_cl.scene.assets.pictures import read_picture
from tests.exchange.pbrt.test_materials import BALL, HEAD, near, png

Convert = Callable[..., Any]

TINTED = (
    'Texture "p" "color" "imagemap" "string filename" "a.png" {} '
    'Texture "t" "color" "scale" "texture tex1" "p" "{} tex2" [.5 .4 .4] Material "matte" "texture Kd" "t"'
)


@pytest.mark.parametrize("kind", ["rgb", "color"])
def test_tints_of_pictures_keep_their_colour(convert: Convert, kind: str) -> None:
    done = convert(TINTED.format("", kind) + BALL, HEAD, **{"a.png": png()})
    assert done.material()["reflectance"] == {"kind": "image", "file": "a.png", "gain": [0.5, 0.4, 0.4]}
    assert done.report == []
    scaled = convert(TINTED.format('"float scale" 2', kind) + BALL, HEAD, **{"a.png": png()})
    assert scaled.material()["reflectance"]["gain"] == near([1.0, 0.8, 0.8])
    assert done.scene.materials["matte"].reflectance.gain == (0.5, 0.4, 0.4)


def test_a_picture_stands_for_its_own_mean_where_no_texture_can_be(convert: Convert) -> None:
    picture = 'Texture "p" "spectrum" "imagemap" "string filename" "a.png" Material "mirror" "texture Kr" "p"'
    done = convert(picture + BALL, HEAD, **{"a.png": png()})
    encoded = np.array([200, 100, 50]) / 255
    np.testing.assert_allclose(done.material()["reflectance"], ((encoded + 0.055) / 1.055) ** 2.4, rtol=1e-5)
    assert done.says('Material "mirror": "Kr" is its mean, not a texture')


def test_texture_coordinates_as_colours(convert: Convert, tmp_path: Any) -> None:
    text = 'Texture "t" "spectrum" "uv" "float uscale" 2 Material "diffuse" "texture reflectance" "t"'
    done = convert(text + BALL, HEAD)
    assert done.material()["reflectance"] == {"kind": "image", "file": "out_files/uv.exr", "scale": [2, 1]}
    texels = read_picture(tmp_path / "out_files" / "uv.exr").texels
    height, width = texels.shape[:2]
    u, v = 3.5 / width, 1 - 10.5 / height  # the centre of the texel in column 3 and row 10 from the top
    np.testing.assert_allclose(texels[10, 3, :3], [u, v, 0], atol=1e-7)


def test_a_number_by_a_picture_with_alpha_is_the_alpha_in_pbrt_v4(convert: Convert) -> None:
    leaf = io.BytesIO()
    PIL.Image.new("RGBA", (2, 2), (0, 90, 0, 128)).save(leaf, format="PNG")
    texture = 'Texture "p" "float" "imagemap" "string filename" "a.png" '
    shape = 'Shape "sphere" "texture alpha" "p"'
    done = convert(texture + shape, HEAD, **{"a.png": leaf.getvalue()})
    assert done.material()["opacity"] == {"kind": "image", "file": "a.png", "channel": "a", "color_space": "srgb"}
    rough = 'Material "dielectric" "texture roughness" "p" "bool remaproughness" false '
    done = convert(texture + rough + BALL, HEAD, **{"a.png": leaf.getvalue()})
    assert done.material()["alpha"] == near(((128 / 255 + 0.055) / 1.055) ** 2.4)
    for text, picture in ((texture + shape + " WorldEnd", leaf.getvalue()), (texture + shape, png())):
        done = convert(text, HEAD, **{"a.png": picture})  # pbrt-v3, and a picture without alpha
        assert "channel" not in done.material()["opacity"]


@pytest.mark.parametrize(("end", "expected"), [("", "mean"), (" WorldEnd", "luminance")])
def test_a_number_by_a_coloured_picture_is_its_mean_in_pbrt_v4_and_its_luminance_before(
    convert: Convert, tmp_path: Any, end: str, expected: str
) -> None:
    text = 'Texture "p" "float" "imagemap" "string filename" "a.png" Shape "sphere" "texture alpha" "p"'
    done = convert(text + end, HEAD, **{"a.png": png()})
    assert done.material()["opacity"] == {"kind": "image", "file": "out_files/a-grey.exr", "color_space": "linear"}
    stored = np.array([200, 100, 50]) / 255
    if expected == "luminance":
        stored = np.atleast_1d(stored @ (0.2126, 0.7152, 0.0722))
    linear = (((stored + 0.055) / 1.055) ** 2.4).mean()
    np.testing.assert_allclose(read_picture(tmp_path / "out_files" / "a-grey.exr").texels[..., 0], linear, rtol=1e-3)
    assert done.says("a.png: written anew as numbers")


SHARES = {
    'Texture "t" "spectrum" "constant" "rgb value" [1 .5 0]': 0.5,
    'Texture "t" "spectrum" "checkerboard" "rgb tex1" [1 .5 0] "rgb tex2" [0 0 .3]': {
        "kind": "checker", "even": [0.5] * 3, "odd": [0.1] * 3},
    'Texture "p" "spectrum" "checkerboard" "rgb tex1" [1 .5 0] "rgb tex2" [0 0 .3] Texture "t" "spectrum" "scale" '
    '"texture tex1" "p" "rgb tex2" [0 1 0]': {"kind": "checker", "even": [1 / 6] * 3, "odd": [0.0] * 3},
    'Texture "p" "spectrum" "checkerboard" "rgb tex1" [1 .5 0] Texture "q" "spectrum" "dots" "rgb inside" [0 0 .6] '
    'Texture "t" "spectrum" "mix" "texture tex1" "p" "texture tex2" "q" "float amount" .5': {
        "kind": "mixture", "amount": [0.5] * 3,
        "first": {"kind": "checker", "even": [0.5] * 3, "odd": [0.0] * 3},
        "second": {"kind": "dots", "outside": [0.2] * 3, "inside": [0.0] * 3}},
}  # fmt: skip


@pytest.mark.parametrize("text", SHARES)
def test_a_share_by_a_texture_of_colours_is_the_mean_of_its_channels_and_says_so(convert: Convert, text: str) -> None:
    use = ' Material "uber" "rgb Ks" [0 0 0] "texture opacity" "t" Shape "sphere" WorldEnd'
    done = convert(text + use, HEAD)
    assert near(done.material()["opacity"]) == SHARES[text]
    assert done.says('"opacity"', "mean over the channels")


def test_a_share_by_a_coloured_picture_is_the_mean_of_its_channels(convert: Convert, tmp_path: Any) -> None:
    text = 'Texture "p" "spectrum" "imagemap" "string filename" "a.png" Texture "t" "spectrum" "scale" '
    text += '"texture tex1" "p" "rgb tex2" [0 .5 2] '
    text += 'MakeNamedMaterial "a" "string type" "mirror" MakeNamedMaterial "b" "string type" "matte" Material "mix" '
    text += '"string namedmaterial1" "a" "string namedmaterial2" "b" "texture amount" "t" Shape "sphere" WorldEnd'
    done = convert(text, HEAD, **{"a.png": png()})
    factor = done.material()["factor"]
    assert factor == {"kind": "image", "file": "out_files/a-grey.exr", "color_space": "linear"}
    linear = ((np.array([200, 100, 50]) / 255 + 0.055) / 1.055) ** 2.4 @ (0, 0.5, 2) / 3
    np.testing.assert_allclose(read_picture(tmp_path / "out_files" / "a-grey.exr").texels[..., 0], linear, rtol=1e-3)
    assert done.says('Material "mix"', "mean over the channels")


def test_a_share_by_four_colours_is_the_mean_of_their_channels(convert: Convert, tmp_path: Any) -> None:
    text = 'Texture "t" "spectrum" "bilerp" "rgb v00" [1 .5 0] "rgb v01" [0 0 .3] "rgb v10" [0 0 0] "rgb v11" [1 1 1] '
    convert(text + 'Material "uber" "texture opacity" "t" Shape "sphere" WorldEnd', HEAD)
    texels = read_picture(tmp_path / "out_files" / "corners-grey.exr").texels[..., 0]
    np.testing.assert_allclose(texels, [[0.1, 1], [0.5, 0]], rtol=1e-3)


def test_mattes_mixed_by_a_texture_of_colours_are_mixed_in_each_channel(convert: Convert) -> None:
    text = 'Texture "t" "spectrum" "checkerboard" "rgb tex1" [1 .5 0] "rgb tex2" [0 0 .3] MakeNamedMaterial "a" '
    text += '"string type" "matte" "rgb Kd" [0 0 0] MakeNamedMaterial "b" "string type" "matte" Material "mix" '
    text += '"string namedmaterial1" "a" "string namedmaterial2" "b" "texture amount" "t" Shape "sphere" WorldEnd'
    done = convert(text, HEAD)
    assert done.material()["reflectance"] == {
        "kind": "mixture", "first": [0.5] * 3, "second": [0.0] * 3,
        "amount": {"kind": "checker", "even": [1.0, 0.5, 0.0], "odd": [0.0, 0.0, 0.3]},
    }  # fmt: skip
    assert done.report == []


@pytest.mark.parametrize(("text", "even", "odd"), [
    ('"mix" "texture tex1" "f" "float tex2" 1 "float amount" .5', 0.6, 0.9),
    ('"scale" "texture tex" "f" "float scale" .5', 0.1, 0.4),
    ('"scale" "texture tex1" "f" "float tex2" .5', 0.1, 0.4),
])  # fmt: skip
def test_textures_of_numbers_are_made_of_textures_of_numbers(
    convert: Convert, text: str, even: float, odd: float
) -> None:
    made = 'Texture "f" "float" "checkerboard" "float tex1" .2 "float tex2" .8 '
    made += 'Texture "f" "spectrum" "constant" "rgb value" [1 0 0] '  # another one, whose name is the same
    done = convert(made + f'Texture "m" "float" {text} Shape "sphere" "texture alpha" "m"', HEAD)
    assert near(done.material()["opacity"]) == {"kind": "checker", "even": [even] * 3, "odd": [odd] * 3}
    assert done.report == []


def test_a_share_by_marble_is_its_mean_however_deep_it_lies(convert: Convert) -> None:
    text = 'Texture "m0" "spectrum" "marble" Texture "d" "spectrum" "checkerboard" '
    for depth in range(3):
        text += f'Texture "m{depth + 1}" "spectrum" "scale" "texture tex" "m{depth}" "texture scale" "d" '
    done = convert(text + 'Material "uber" "texture opacity" "m3" Shape "sphere"', HEAD)
    deepest = done.material()["opacity"]["second"]["second"]["second"]
    assert near(deepest) == {"kind": "checker", "even": [0.816] * 3, "odd": [0.816] * 3}
    assert done.says('"opacity"', "mean over the channels")
