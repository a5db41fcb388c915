"""Pictures that say how a surface is brushed, and which normals its clear coat has."""

import math

import numpy as np
import pytest
from PIL import Image

from tests.rendering.pictures import batches
from tests.rendering.test_materials import CROWD, TABLES_APART, ball, normal_picture, same
from tests.support.cases import slow
from tests.support.statistics import assert_same_tiles


def mapped_ball(material, file, depth=2):
    """A ball of a material; specks that have every map let one program render what has one, and what has none."""
    every = {"anisotropy_map": {"file": file}, "normal_map": {"file": file}, "clearcoat": 1, "clearcoat_flat": True}
    return ball(material, depth, [*CROWD, {"kind": "principled", **every}])


def brushed_picture(path, *texels):
    """Write a picture of directions and strengths, one column each; return each angle [degrees] and strength."""
    codes = [np.round((direction[0] * 127.5 + 127.5, direction[1] * 127.5 + 127.5, strength * 255))
             for *direction, strength in texels]  # fmt: skip
    Image.fromarray(np.array([codes] * 2).astype(np.uint8)).save(path)
    return [(math.degrees(math.atan2(g - 127.5, r - 127.5)), b / 255) for r, g, b in codes]


def spun(turn, strength, roughness=0.4):
    """Numbers that stretch highlights by a strength as glTF has it."""
    across = roughness**2
    along = across + (1 - across) * strength**2
    stretch = {"roughness": (along * across) ** 0.25, "anisotropy": (1 - across / along) / 0.9}
    return {"kind": "principled", "metallic": 1.0, "anisotropy_rotation_degrees": turn} | stretch


@pytest.mark.slow
@pytest.mark.parametrize("roughness", [0.4, slow({"kind": "gradient", "start": 0.4, "end": 0.4})])
def test_constant_anisotropy_map_is_as_numbers(tmp_path, monkeypatch, roughness):
    monkeypatch.chdir(tmp_path)
    ((angle, strength),) = brushed_picture("brushed.png", (0.5, 0.8, 0.6))
    stretch = {"anisotropy_map": {"file": "brushed.png", "strength": 0.9}, "anisotropy_rotation_degrees": 10}
    mapped = {"kind": "principled", "metallic": 1.0, "roughness": roughness, **stretch}
    same(ball(mapped, 2), ball(spun(angle + 10, 0.9 * strength), 2), rtol=TABLES_APART)
    with pytest.raises(AssertionError):
        same(ball(mapped, 2), ball(spun(angle - 10, 0.9 * strength), 2), rtol=TABLES_APART)


def test_anisotropy_map_brushes_each_place_by_its_texel(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    halves = brushed_picture("halves.png", (0.9, 0.3, 0.3), (-0.2, 0.7, 0.7))
    picture = {"file": "halves.png", "filter": "nearest", "scale": [3, 1]}
    mapped = {"kind": "principled", "metallic": 1.0, "roughness": 0.4, "anisotropy_map": picture}
    stripes = {"kind": "checker", "even": 0.0, "odd": 1.0, "scale": [6, 1e-6], "offset": [0, 0.5]}
    a = batches(mapped_ball(mapped, "halves.png"), "brushed by a map", 4, spp=16)
    mixed = {"kind": "mix", "materials": [spun(*half) for half in halves], "factor": stripes}
    assert_same_tiles(a, batches(mapped_ball(mixed, "halves.png"), "brushed by a mix", 4, spp=16))
    with pytest.raises(AssertionError):
        assert_same_tiles(a, batches(mapped_ball(spun(*halves[0]), "halves.png"), "brushed as one half", 4, spp=16))


VARNISH = {"kind": "principled", "base_color": 0, "specular": 0, "clearcoat": 1, "clearcoat_roughness": 0.3}


def wild_picture(path):
    Image.fromarray(np.random.default_rng(3).integers(0, 256, (32, 32, 3), np.uint8)).save(path)
    return {"file": path.name, "scale": [8, 8]}


def test_flat_coat_shines_over_a_wild_base_as_over_a_smooth_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bumps = {"normal_map": wild_picture(tmp_path / "wild.png")}
    smooth = batches(mapped_ball(VARNISH, "wild.png"), "varnish", 4, spp=64)
    flat = mapped_ball(VARNISH | bumps | {"clearcoat_flat": True}, "wild.png")
    assert_same_tiles(smooth, batches(flat, "flat varnish", 4, spp=64))
    with pytest.raises(AssertionError):
        assert_same_tiles(smooth, batches(mapped_ball(VARNISH | bumps, "wild.png"), "bumpy varnish", 4, spp=64))


@pytest.mark.slow
def test_normals_of_the_coat_are_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    normal_picture(tmp_path / "lean.png", [0.3, 0.2, math.sqrt(1 - 0.13)])
    lean = {"file": "lean.png"}
    both = batches(ball(VARNISH | {"normal_map": lean}, 2), "coat on a leaning base", 4, spp=64)
    own = VARNISH | {"clearcoat_normal_map": lean}
    assert_same_tiles(both, batches(ball(own, 2), "leaning coat", 4, spp=64))
    with pytest.raises(AssertionError):
        assert_same_tiles(both, batches(ball(VARNISH, 2), "no lean", 4, spp=64))


def test_coat_and_base_of_the_same_normals_are_as_one_that_follows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bumps = wild_picture(tmp_path / "wild.png")
    paint = {"kind": "principled", "base_color": [0.6, 0.2, 0.1], "clearcoat": 0.7, "normal_map": bumps}
    mapped = paint | {"clearcoat_normal_map": bumps}
    same(mapped_ball(paint, "wild.png", 5), mapped_ball(mapped, "wild.png", 5), share=0.97)
