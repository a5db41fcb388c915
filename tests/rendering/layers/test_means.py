"""Means over the very rays of the picture, identifiers of the first of them, and what the layers do not depend on."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.film import SINGLE_LAYERS
from rptcam_cl.scene.load import load_scene
from tests.rendering.layers.scenes import CAMERAS, GREY, RED, world
from tests.support.cases import slow

FACING = {"shape": "rectangle", "edge_u": [2, 0, 0], "edge_v": [0, 2, 0]}
NEAR, FAR = FACING | {"corner": [0.04, -0.9, -3]}, FACING | {"corner": [-1.2, -1, -5]}  # edges within pixels
BLUE = {"kind": "constant", "radiance": [0, 0, 1]}  # so that what sees nothing is told from what sees no light
LAYERS = ["depth", "coverage", "albedo", "uv", "material_id", "object_id"]  # the same, so that a program does for many
FORWARD = {"eye": [0, 0, 0], "target": [0, 0, -1]}


def glow(color) -> dict:
    return {"kind": "emissive", "radiance": color, "two_sided": True}


CHECKER = {"kind": "checker", "even": [0.9, 0.1, 0.2], "odd": [0.1, 0.3, 0.8], "scale": [4, 4]}
GLOWS = {"kind": "principled", "base_color": 0, "emission": [1, 0, 0]}
MIX = {"kind": "mix", "factor": 0.25, "materials": [{"kind": "matte", "reflectance": [0, 1, 0]}, GLOWS]}
PANE = GLOWS | {"opacity": 0.5}
CHECKED = {"kind": "matte", "reflectance": CHECKER}
# Behind the camera, and too small for lamps that count: with them one program does for all panels.
SPECK = {"shape": "rectangle", "corner": [0, 0, 9], "edge_u": [1e-3, 0, 0], "edge_v": [0, 1e-3, 0]}
SPECKS = [SPECK | {"material": each} for each in (glow([1, 1, 1]), glow([1, 1, 1]), CHECKED, MIX, PANE)]


def two_panels(camera: str, near: dict, far: dict) -> dict:
    """Two panels that face the camera, 3 m and 5 m away, the near one over an edge of the far one."""
    return {
        "film": {"resolution": [32, 16]},
        "camera": CAMERAS[camera] | FORWARD,
        "objects": [NEAR | {"material": near}, FAR | {"material": far}, *SPECKS],
        "environment": BLUE,
        "render": {"max_depth": 1},
    }


@pytest.mark.parametrize("camera", ["double_gauss", *map(slow, ("thin_lens", "pinhole", "thick_lens"))])
def test_means_mix_what_the_pixel_sees_as_the_light_does(camera):
    image = rptcam_cl.render(two_panels(camera, glow([1, 0, 0]), glow([0, 1, 0])), spp=32, layers=LAYERS)
    red, green, blue = np.moveaxis(np.asarray(image).astype(np.float64), -1, 0)
    np.testing.assert_allclose(image["coverage"], (red + green) / (red + green + blue), atol=3e-6)
    seen = image["coverage"] > 0
    depth = (3 * red + 5 * green)[seen] / (red + green)[seen]
    np.testing.assert_allclose(image["depth"][seen], depth, rtol=3e-6)
    assert ((depth > 3.1) & (depth < 4.9)).sum() >= 10  # some pixels see both
    assert ((image["coverage"] > 0.02) & (image["coverage"] < 0.98)).sum() >= 5  # and some see past them
    assert (image["albedo"] == 0).all()  # lamps reflect nothing


@pytest.mark.parametrize("camera", ["thin_lens", *map(slow, ("pinhole", "double_gauss"))])
def test_identifiers_are_those_of_the_first_ray_exactly(camera):
    scene = two_panels(camera, glow([1, 0, 0]), glow([0, 1, 0]))
    one = np.asarray(rptcam_cl.render(scene, spp=1, seed=5, layers=LAYERS))
    image = rptcam_cl.render(scene, spp=16, seed=5, layers=LAYERS)
    expected = np.where(one[..., 0] > 0, 0, np.where(one[..., 1] > 0, 1, -1))
    assert {-1, 0, 1} <= set(expected.ravel())
    lit = one.any(axis=-1)  # a pixel whose first ray the lens blocks goes by its next
    assert lit.mean() > 0.5 if camera == "double_gauss" else lit.all()
    np.testing.assert_array_equal(image["object_id"][lit], expected[lit])
    np.testing.assert_array_equal(image["material_id"], image["object_id"])


def test_identifiers_and_layers_have_names():
    image = rptcam_cl.render(world("thin_lens"), spp=1, layers=SINGLE_LAYERS)
    with pytest.raises(KeyError, match="layers of this image: depth, "):
        image["lights"]
    assert image.metadata["object_names"] == ("ball", "floor")
    assert image.metadata["material_names"] == ("unused", "red", "objects.1.material")
    pairs = set(zip(image["object_id"].ravel().tolist(), image["material_id"].ravel().tolist(), strict=True))
    assert pairs == {(-1, -1), (0, 1), (1, 2)}


def test_albedo_is_the_colour_where_the_ray_met_the_surface():
    image = rptcam_cl.render(two_panels("thin_lens", CHECKED, RED), spp=1, layers=LAYERS)
    near, far = (image["object_id"] == index for index in (0, 1))
    even = np.floor(4 * image["uv"][near]).sum(axis=1) % 2 == 0
    assert 0.3 < even.mean() < 0.7
    np.testing.assert_allclose(
        image["albedo"][near], np.where(even[:, None], CHECKER["even"], CHECKER["odd"]), rtol=1e-6
    )
    np.testing.assert_allclose(image["albedo"][far], np.broadcast_to(RED["reflectance"], (far.sum(), 3)), rtol=1e-6)
    assert (image["albedo"][~near & ~far] == 0).all()


def test_albedo_of_a_mix_is_that_of_the_material_that_the_path_took():
    image = rptcam_cl.render(two_panels("thin_lens", MIX, MIX), spp=8, layers=LAYERS)
    shining = np.asarray(image)[..., 0].astype(np.float64)
    seen = image["coverage"] > 0
    assert 0.2 < (shining[seen] / image["coverage"][seen]).mean() < 0.3
    np.testing.assert_allclose(
        (image["albedo"][..., 1] * image["coverage"])[seen], (image["coverage"] - shining)[seen], atol=1e-6
    )


def test_rays_that_pass_a_hole_show_what_is_behind_it():
    image = rptcam_cl.render(two_panels("thin_lens", PANE, glow([0, 1, 0])), spp=16, layers=LAYERS)
    red, green = np.moveaxis(np.asarray(image).astype(np.float64)[..., :2], -1, 0)
    seen = image["coverage"] > 0
    np.testing.assert_allclose(image["coverage"], red + green, atol=3e-6)
    np.testing.assert_allclose(image["depth"][seen], ((3 * red + 5 * green)[seen] / (red + green)[seen]), rtol=3e-6)
    assert ((red > 0.2) & (green > 0.2)).sum() > 20


@pytest.mark.parametrize("camera", ["thin_lens", slow("double_gauss")])
def test_picture_is_the_same_with_layers_and_without(camera):
    plain, layered = (rptcam_cl.render(world(camera), spp=4, layers=names) for names in ([], SINGLE_LAYERS))
    np.testing.assert_array_equal(np.asarray(plain), np.asarray(layered))
    assert dict(plain.layers) == {}
    assert tuple(layered.layers) == SINGLE_LAYERS


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["thin_lens", "double_gauss"])
def test_layers_depend_neither_on_the_wave_nor_on_the_organisation(camera):
    scene = load_scene(
        world(camera) | {"film": {"resolution": [40, 20]}, "render": {"layers": SINGLE_LAYERS, "layers_spp": 11}}
    )
    found = []
    for wave_size, organisation in ((256, "stream"), (65536, "stream"), (512, "passes"), (65536, "passes")):
        plan = make_plan(scene)
        wavefront = Wavefront(open_session(), plan, FilmLayout.of(scene.film), scene.render, wave_size, organisation)
        found.append(render_plan(wavefront, spp=19, seconds=None, has_lens=plan.camera.has_lens).layers)
    for other in found[1:]:
        for name in found[0]:
            np.testing.assert_array_equal(found[0][name], other[name], err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["thin_lens", "double_gauss"])
def test_one_lane_per_work_item_gives_the_same_layers(camera, monkeypatch):
    eight = rptcam_cl.render(world(camera), spp=3, layers=SINGLE_LAYERS)
    monkeypatch.setattr(Session, "lanes", 1)
    one = rptcam_cl.render(world(camera), spp=3, layers=SINGLE_LAYERS, device=Session(choose_device(None)))
    for name in SINGLE_LAYERS:
        alike = np.isclose(one[name], eight[name], rtol=1e-5, atol=1e-5, equal_nan=True)
        assert alike.mean() > 0.995, name  # rounding decides at the rims of lens and objects


def test_layers_are_made_of_the_first_samples_alone():
    scene = world("thin_lens") | {"render": {"layers": SINGLE_LAYERS, "layers_spp": 3}}
    many, few = (rptcam_cl.render(scene, spp=spp) for spp in (40, 3))
    for name in ("depth", "coverage"):
        np.testing.assert_array_equal(many[name], few[name])
    whole = rptcam_cl.render(scene | {"render": {"layers": SINGLE_LAYERS, "layers_spp": 40}}, spp=40)
    assert (whole["depth"] != few["depth"]).mean() > 0.2


def test_layers_of_a_render_that_was_continued_are_those_of_one_in_a_go(tmp_path):
    options = {"layers": SINGLE_LAYERS, "checkpoint": tmp_path / "half.rpck", "resume": True}
    rptcam_cl.render(world("thin_lens"), spp=2, **options)
    with pytest.raises(StateError, match=r"its layers is \['depth', .*\], and this render's \['normal'\]"):
        rptcam_cl.render(world("thin_lens"), spp=5, **options | {"layers": ["normal"]})
    whole = rptcam_cl.render(world("thin_lens"), spp=5, layers=options["layers"])
    continued = rptcam_cl.render(world("thin_lens"), spp=5, **options)
    for name in options["layers"]:
        np.testing.assert_array_equal(continued[name], whole[name])


@pytest.mark.parametrize("camera", ["thin_lens", slow("double_gauss")])
def test_crop_shows_a_part_of_the_whole_layers(camera):
    scene = world(camera)
    whole = rptcam_cl.render(scene, spp=2, layers=SINGLE_LAYERS)
    part = rptcam_cl.render(scene, spp=2, layers=SINGLE_LAYERS, crop=(0.25, 0.75, 0.5, 1.0))
    assert part.metadata["window"] == [12, 12, 24, 12]
    for name in SINGLE_LAYERS:
        np.testing.assert_array_equal(part[name], whole[name][12:, 12:36], err_msg=name)


@pytest.mark.slow
def test_nothing_anywhere_is_background_everywhere():
    scene = {"camera": CAMERAS["pinhole"] | FORWARD, "film": {"resolution": [9, 7]}}
    image = rptcam_cl.render(scene, spp=2, layers=SINGLE_LAYERS)
    assert np.isposinf(image["depth"]).all()
    assert np.isposinf(image["distance"]).all()
    assert np.isnan(image["position"]).all()
    assert (image["object_id"] == -1).all()
    assert (image["material_id"] == -1).all()
    assert (image["coverage"] == 0).all()
    assert (image["coc"] == 0).all()


@pytest.mark.slow
def test_dark_corners_of_a_lens_have_no_rays_to_tell_of():
    camera = CAMERAS["fisheye"] | FORWARD
    image = rptcam_cl.render({"camera": camera, "film": {"resolution": [36, 24]}}, spp=4, layers=["coc", "pupil"])
    dark = np.isnan(image["coc"])
    assert dark[0, 0]
    assert not dark[12, 18]
    np.testing.assert_array_equal(np.isnan(image["pupil"]).all(axis=-1), dark)


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        (["dept"], r"render\.layers\[0\]: is not a known choice; did you mean depth\?"),
        (["depth", "depth"], r"render\.layers\[1\]: is listed twice"),
        ("depth", r"render\.layers: must be a list of layers"),
    ],
)
def test_wrong_layers_are_refused(layers, message):
    with pytest.raises(InputError, match=message):
        rptcam_cl.render(world("pinhole"), layers=layers)


@pytest.mark.slow
def test_floor_far_from_the_origin_keeps_its_place():
    away = np.array([5e5, 4e6, -2e5])
    objects = [item | {"material": GREY} for item in (NEAR, FAR)]
    moved = [item | {"corner": (away + item["corner"]).tolist()} for item in objects]
    pose = {"eye": away.tolist(), "target": (away - np.array([0, 0, 1])).tolist()}
    film = {"resolution": [16, 16]}
    here = rptcam_cl.render(
        {"camera": CAMERAS["pinhole"] | FORWARD, "film": film, "objects": objects}, spp=2, layers=["position"]
    )
    there = rptcam_cl.render(
        {"camera": CAMERAS["pinhole"] | pose, "film": film, "objects": moved}, spp=2, layers=["position"]
    )
    np.testing.assert_allclose(there["position"] - away, here["position"], atol=1e-5)


@pytest.mark.slow
def test_albedo_of_a_named_metal_is_what_it_reflects_head_on():
    scene = {
        "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 5},
        "objects": [
            {
                "shape": "sphere",
                "center": [0, 0, 0],
                "radius": 1,
                "material": {"kind": "conductor", "metal": {"n": [0.3, 0.9, 1.1], "k": [3.2, 2.6, 2.3]}, "alpha": 0.2},
            }
        ],
        "environment": {"kind": "constant", "radiance": 1},
    }
    image = rptcam_cl.render(scene, spp=1, size=(8, 8), layers=["albedo"])
    n, k = np.array([0.3, 0.9, 1.1]), np.array([3.2, 2.6, 2.3])
    head_on = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)  # Born and Wolf, section 14.2
    np.testing.assert_allclose(image["albedo"], np.broadcast_to(head_on, (8, 8, 3)), rtol=1e-5)
