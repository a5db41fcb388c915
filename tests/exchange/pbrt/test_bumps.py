"""Bumps, and textures in space, of pbrt scenes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rptcam_cl.scene.assets.pictures import read_picture
from tests.exchange.pbrt.conftest import HEAD
from tests.exchange.pbrt.test_materials import BALL, GREY_PNG

Convert = Callable[..., Any]
V3 = 'LookAt 0 0 5  0 0 0  0 1 0\nCamera "perspective" "float fov" 40\nFilm "image"\nWorldBegin\n'
HEIGHTS = (
    'Texture "p" "float" "imagemap" "string filename" "a.png" '
    'Texture "h" "float" "scale" "texture tex1" "p" "float tex2" .2 '
)
MESH = 'Shape "trianglemesh" "integer indices" [0 1 2] "point3 P" [0 0 0 1 0 0 0 1 0] "point2 uv" [0 0 1 0 0 1] {}'
NORMALS = '"normal N" [0 0 1 0 0 1 0 0 1]'


def test_bumps_are_heights_of_a_texture_times_its_factors(convert: Convert) -> None:
    done = convert(HEIGHTS + 'Material "diffuse" "texture displacement" "h"' + BALL, HEAD, **{"a.png": GREY_PNG})
    assert done.material()["bump"] == {"texture": {"kind": "image", "file": "a.png"}, "height": 0.2}
    assert done.report == []


def test_even_heights_are_no_bumps(convert: Convert) -> None:
    done = convert('Material "diffuse" "float displacement" 1' + BALL, HEAD)
    assert "bump" not in done.material()
    assert done.report == []


@pytest.mark.parametrize(
    ("head", "normals", "bump"),
    [
        (V3, "", {"height": 0.2}),
        (V3, NORMALS, {"height": -0.2, "lengths": "unit"}),
        (HEAD, NORMALS.replace("normal N", "normal3 N"), {"height": 0.2, "lengths": "u"}),
    ],
)
def test_lengths_of_meshes_with_normals_are_those_of_the_release(
    convert: Convert, head: str, normals: str, bump: dict[str, Any]
) -> None:
    kind, name = ("matte", "bumpmap") if head == V3 else ("diffuse", "displacement")
    text = HEIGHTS + f'Material "{kind}" "texture {name}" "h"' + MESH.format(normals)
    assert convert(text, head, **{"a.png": GREY_PNG}).material()["bump"] == {
        "texture": {"kind": "image", "file": "a.png"}, **bump
    }  # fmt: skip


def test_a_mirror_with_bumps_is_a_conductor_and_says_so(convert: Convert) -> None:
    done = convert(HEIGHTS + 'Material "mirror" "texture bumpmap" "h"' + BALL, V3, **{"a.png": GREY_PNG})
    assert done.material()["kind"] == "conductor"
    assert done.material()["bump"]["height"] == 0.2
    assert done.says('Material "mirror"', "conductor")


def test_textures_in_space_lie_where_the_transform_before_them_puts_them(convert: Convert) -> None:
    place = "Translate 1 2 3 Scale 2 2 2 "
    noise = 'Texture "n" "spectrum" "marble" "float scale" 4 "float variation" .5 "integer octaves" 3 Identity '
    done = convert(place + noise + 'Material "diffuse" "texture reflectance" "n"' + BALL, HEAD)
    found = done.material()["reflectance"]
    assert {key: found[key] for key in ("kind", "octaves", "variation")} == {
        "kind": "marble",
        "octaves": 3,
        "variation": 0.5,
    }
    # x is reversed on the way to our world
    matrix = np.array(found["mapping"]["matrix"])
    np.testing.assert_allclose(matrix @ [-(1 + 2 * 0.25), 2 + 2 * 0.5, 3 - 2 * 0.75, 1], [1, 2, -3], atol=1e-6)


def test_heights_of_two_textures_are_their_product(convert: Convert) -> None:
    text = HEIGHTS + 'Texture "n" "float" "fbm" Texture "p" "float" "scale" "texture tex1" "h" "texture tex2" "n" '
    bump = convert(text + 'Material "matte" "texture bumpmap" "p"' + BALL, V3, **{"a.png": GREY_PNG}).material()["bump"]
    assert [bump["texture"][part]["kind"] for part in ("second", "amount")] == ["image", "perlin"]
    assert (bump["texture"]["kind"], "first" in bump["texture"], bump["height"]) == ("mixture", False, 0.2)


def test_matte_textures_mixed_as_materials_are_mixed_before_they_are_cut(convert: Convert) -> None:
    text = (
        'Texture "t" "color" "marble" MakeNamedMaterial "m" "string type" "matte" "texture Kd" "t" '
        'MakeNamedMaterial "c" "string type" "matte" "rgb Kd" [.01 .04 .17] Material "mix" "rgb amount" [.1 .1 .1] '
        '"string namedmaterial1" "m" "string namedmaterial2" "c"'
    )
    found = convert(text + BALL, V3).material()
    assert found["kind"] == "matte"
    assert found["reflectance"]["first"] == [0.01, 0.04, 0.17]
    assert found["reflectance"]["amount"] == [0.1, 0.1, 0.1]
    assert found["reflectance"]["second"]["form"] == "pbrt-v3"


@pytest.mark.parametrize(("kind", "form"), [("fbm", None), ("wrinkled", "turbulence"), ("windy", "wind")])
def test_noise_of_pbrt_is_perlins(convert: Convert, kind: str, form: str | None) -> None:
    text = f'Texture "n" "float" "{kind}" Material "diffuse" "texture displacement" "n"'
    bump = convert(text + BALL, HEAD).material()["bump"]
    assert (bump["texture"]["kind"], bump["texture"].get("form")) == ("perlin", form)
    assert "mapping" in bump["texture"]


def test_mixtures_by_a_pattern_have_both_colours(convert: Convert) -> None:
    text = (
        'Texture "c" "float" "checkerboard" "float tex1" 1 "float tex2" .25 "integer dimension" 3 '
        'Texture "m" "spectrum" "mix" "rgb tex1" [.8 .4 0] "rgb tex2" [0 .4 .8] "texture amount" "c" '
        'Material "diffuse" "texture reflectance" "m"'
    )
    done = convert(text + BALL, HEAD)
    found = done.material()["reflectance"]
    np.testing.assert_allclose(found["even"], [0, 0.4, 0.8])
    np.testing.assert_allclose(found["odd"], [0.6, 0.4, 0.2])
    assert found["mapping"]["matrix"][2] == [0, 0, 1, 0]
    assert done.report == []


def test_corners_of_bilerp_are_those_of_u_and_v(convert: Convert, tmp_path: Any) -> None:
    corners = "".join(f'"rgb v{i}{j}" [{i} {j} .5] ' for i in (0, 1) for j in (0, 1))
    text = f'Texture "b" "spectrum" "bilerp" {corners} Material "diffuse" "texture reflectance" "b"'
    found = convert(text + BALL, HEAD).material()["reflectance"]
    assert (found["scale"], found["offset"], found["wrap"]) == ([0.5, 0.5], [0.25, 0.25], "clamp")

    texels = read_picture(tmp_path / found["file"]).texels
    np.testing.assert_allclose(texels[0, 1, :3], [1, 1, 0.5])
    np.testing.assert_allclose(texels[1, 1, :3], [1, 0, 0.5])


def test_mappings_keep_what_they_turn_about(convert: Convert) -> None:
    text = (
        'Rotate 90 1 0 0 Texture "c" "spectrum" "checkerboard" "string mapping" "{}" Identity '
        'Material "diffuse" "texture reflectance" "c"'
    )
    for kind, ours in (("spherical", "spherical"), ("cylindrical", "cylindrical")):
        mapping = convert(text.format(kind) + BALL, HEAD).material()["reflectance"]["mapping"]
        assert mapping["kind"] == ours
        np.testing.assert_allclose(np.array(mapping["matrix"])[2, :3], [0, -1, 0], atol=1e-6)  # z after the turn
    planar = text.format('planar" "vector3 v1" [0 0 2] "float udelta" .5 "string filter" "x')
    done = convert(planar.replace(' "string filter" "x"', "") + BALL, HEAD)
    matrix = np.array(done.material()["reflectance"]["mapping"]["matrix"])
    np.testing.assert_allclose(matrix[0] @ [0, 3, 0, 1], -2 * 3 + 0.5, atol=1e-6)
