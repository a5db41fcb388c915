"""Holes: what a ray finds behind a surface with opacity, seen, lit and shaded, on flat shapes and on meshes alike."""

import numpy as np
import pytest

import rptcam_cl
from tests.rendering.pictures import flat_mean, looking, pixels, scene_of, seed_of
from tests.support.cases import fast

CHECKS = {"kind": "checker", "even": 0.0, "odd": 1.0, "scale": [8, 8]}
SHEET = {"shape": "rectangle", "corner": [-2, -2, 1], "edge_u": [4, 0, 0], "edge_v": [0, 4, 0]}
MESH_SHEET = {
    "shape": "mesh",
    "vertices": [[-2, -2, 1], [2, -2, 1], [2, 2, 1], [-2, 2, 1]],
    "faces": [[0, 1, 2, 3]],
    "uvs": [[0, 0], [1, 0], [1, 1], [0, 1]],
}
FLOOR = {"shape": "rectangle", "corner": [-9, -9, 0], "edge_u": [18, 0, 0], "edge_v": [0, 18, 0]}
GREY = {"kind": "matte", "reflectance": 0.5}
BLACK = {"kind": "matte", "reflectance": 0.0}
SHAPES = pytest.mark.parametrize("sheet", [SHEET, MESH_SHEET], ids=["rectangle", "mesh"])
DOWN = looking([0, 0, 3], [0, 0, 0], fov=40, up=(0, 1, 0))


SOLIDS = {
    "sphere": {"shape": "sphere", "center": [0, 0, 0], "radius": 1},
    "ellipsoid": {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "transform": [{"scale": [1.2, 1, 0.8]}]},
    "box": {"shape": "box", "min": [-1, -1, -1], "max": [1, 1, 1]},
    "cylinder": {"shape": "cylinder", "base": [-1, 0, 0], "top": [1, 0, 0], "radius": 1},
    "cone": {"shape": "cone", "base": [0, 0, -1], "apex": [0, 0, 1], "radius": 1},
}
AWAY = [{"scale": 1e-4}, {"translate": [0, 0, 90]}]  # behind the camera, and too small to be met
# With these one program renders all shapes, with and without a texture.
SPECKS = [item | {"transform": [*item.get("transform", []), *AWAY]} for item in (SHEET, MESH_SHEET, *SOLIDS.values())]


def below(objects):
    """Objects in an even world, seen from above."""
    specks = [item | {"material": BLACK | {"opacity": CHECKS}} for item in SPECKS]
    return scene_of([*objects, *specks], DOWN, depth=2, environment={"kind": "constant", "radiance": 1})


def sheet_of(sheet, opacity, mode="blend"):
    return sheet | {"material": BLACK | {"opacity": opacity, "opacity_mode": mode}}


@SHAPES
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_share_of_rays_that_pass_is_what_opacity_leaves(sheet, share):
    scene = below([sheet_of(sheet, share)])
    mean, error = flat_mean(scene, f"share {share} {sheet['shape']}", spp=64)
    if share in (0.0, 1.0):
        assert (mean == 1 - share).all()
    else:
        assert (np.abs(mean - (1 - share)) < 4 * error).all()
        assert (error < 0.01).all()


@SHAPES
def test_mask_cuts_where_its_texture_is_below_the_cutoff(sheet):
    scene = below([sheet_of(sheet, CHECKS, "mask")]) | {"film": {"resolution": [64, 64]}}
    seen = pixels(scene, spp=4)[..., 0]
    assert set(np.unique(seen[8::16, 8::16])) <= {0.0, 1.0}  # within cells
    assert np.isclose(seen.mean(), 0.5, atol=0.03)


@pytest.mark.parametrize(
    ("sheet", "light"),
    [
        pytest.param(SHEET, "point", id="rectangle-point", marks=pytest.mark.slow),
        pytest.param(MESH_SHEET, "lamp", id="mesh-lamp"),
        pytest.param(SHEET, "lamp", id="rectangle-lamp", marks=pytest.mark.slow),
        pytest.param(MESH_SHEET, "point", id="mesh-point", marks=pytest.mark.slow),
    ],
)
def test_light_falls_through_holes(sheet, light):
    """Half of a lamp's light passes a sheet of opacity one half, straight on."""
    lamp = {"shape": "disk", "center": [0, 0, 4], "normal": [0, 0, -1], "radius": 0.5,
            "material": {"kind": "emissive", "radiance": 10}}  # fmt: skip
    camera = looking([0, 0.9, 0.5], [0, 0, 0], fov=10, up=(0, 1, 0))
    keys = {"lights": [{"kind": "point", "position": [0, 0, 4], "intensity": 10}]} if light == "point" else {}
    objects = [FLOOR | {"material": GREY}] + ([lamp] if light == "lamp" else [])
    name = f"through {light} {sheet['shape']}"
    holes = sheet_of(sheet, 0.5)
    away = scene_of([*objects, holes | {"transform": AWAY}], camera, depth=2, **keys)
    bare, bare_error = flat_mean(away, f"{name} bare", spp=64)
    half, half_error = flat_mean(scene_of([*objects, holes], camera, depth=2, **keys), f"{name} half", spp=256)
    assert (np.abs(half / bare - 0.5) < 4 * np.hypot(half_error / bare, bare_error / bare) + 2e-3).all()
    assert (half_error / bare < 0.01).all()


def test_lamp_with_holes_shines_from_what_is_left():
    lamp = SHEET | {"material": {"kind": "principled", "base_color": 0, "emission": 2, "opacity": 0.25}}
    camera = looking([0, 0, 3], [0, 0, 0], fov=40, up=(0, 1, 0))
    mean, error = flat_mean(scene_of([lamp], camera, depth=2), "lamp with holes", spp=64)
    assert (np.abs(mean - 0.5) < 4 * error).all()


def test_choice_does_not_depend_on_the_wave(monkeypatch):
    scene = scene_of([sheet_of(MESH_SHEET, 0.5), FLOOR | {"material": GREY}], DOWN, depth=3,
                     environment={"kind": "constant", "radiance": 1})  # fmt: skip
    films = [pixels(scene, seed=seed_of("holes"), spp=8, wave_size=size) for size in (256, 65536)]
    assert (films[0] == films[1]).all()


@pytest.mark.parametrize("solid", SOLIDS)
def test_both_sides_of_a_solid_have_their_own_holes(solid):
    body = SOLIDS[solid] | {"material": BLACK | {"opacity": 0.5}}
    camera = looking([0.02, -0.03, 9], [0, 0, 0], fov=2, up=(0, 1, 0))
    mean, error = flat_mean(below([body]) | {"camera": camera}, f"solid {solid}", spp=256)
    assert (np.abs(mean - 0.25) < 4 * error).all()
    assert (error < 0.005).all()


@pytest.mark.parametrize("solid", fast(["sphere", "box"], SOLIDS))
def test_rays_through_a_hole_of_a_solid_meet_its_far_side(solid):
    body = SOLIDS[solid] | {"material": BLACK | {"opacity": 0.5}}
    camera = looking([0.02, -0.03, 9], [0, 0, 0], fov=2, up=(0, 1, 0))
    image = rptcam_cl.render(below([body]) | {"camera": camera}, spp=1, seed=seed_of("far side"), layers=["depth"])
    depth = image["depth"][np.isfinite(image["depth"])]
    near = depth < 9
    error = np.sqrt(2 / 9 / len(depth))
    assert abs(near.mean() - 2 / 3) < 4 * error < 0.1  # a half of all rays, and of the others a half
