"""Objects, lamps and surroundings that some rays pass through: each kind of ray against the scene without them."""

import copy

import numpy as np
import PIL.Image
import png
import pytest
import tifffile

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.image import desqueezed
from rptcam_cl.rendering import tracer
from tests.support.cases import fast, slow

FLOOR = {
    "shape": "plane",
    "point": [0, 0, 0],
    "normal": [0, 1, 0],
    "material": {"kind": "matte", "reflectance": [0.5, 0.5, 0.5]},
}
MIRROR = {
    "shape": "rectangle",
    "corner": [-2, 0, -1.5],
    "edge_u": [4, 0, 0],
    "edge_v": [0, 2.5, 0],
    "material": {"kind": "mirror"},
}
LAMP = {
    "shape": "rectangle",
    "corner": [-0.5, 2.2, -0.5],
    "edge_u": [1, 0, 0],
    "edge_v": [0, 0, 1],
    "material": {"kind": "emissive", "radiance": [5, 5, 5], "two_sided": True},
}
RED = {"kind": "matte", "reflectance": [0.8, 0.2, 0.2]}
MESH = {"shape": "mesh", "vertices": [[-0.5, 0.2, 0], [0.5, 0.2, 0], [0, 1.2, 0.2]], "faces": [[0, 1, 2]]}
THINGS = {
    "sphere": [{"shape": "sphere", "center": [0, 0.6, 0], "radius": 0.6}],
    "box": [{"shape": "box", "min": [-0.5, 0.1, -0.4], "max": [0.5, 1.1, 0.4]}],
    "rectangle": [{"shape": "rectangle", "corner": [-0.5, 0.1, 0], "edge_u": [1, 0, 0], "edge_v": [0, 1, 0]}],
    "mesh": [MESH],
    "instances": [MESH, MESH | {"transform": {"translate": [0.7, 0, 0.2]}}],
}


def scene(*objects, visible=None, **keys):
    """A floor before a mirror under a lamp, and objects between them."""
    placed = [{"material": RED, **each, **({} if visible is None else {"visible": visible})} for each in objects]
    return {
        "camera": {"kind": "pinhole", "eye": [2, 1.2, 3.5], "target": [0, 0.6, 0], "fov_degrees": 75},
        "objects": [FLOOR, MIRROR, LAMP, *placed],
    } | keys


def film(made, spp=8, **options):
    return np.asarray(rptcam_cl.render(made, size=(32, 24), spp=spp, **options))


@pytest.fixture(params=["stream", slow("passes")])
def organisation(request, monkeypatch):
    monkeypatch.setattr(tracer, "ORGANISATION", dict.fromkeys(tracer.ORGANISATION, request.param))


@pytest.mark.slow
@pytest.mark.parametrize("name", fast(["mesh"], THINGS))
def test_what_nothing_meets_changes_nothing(name):
    nowhere = {"camera": False, "shadow": False, "reflection": False}
    without, with_it = film(scene()), film(scene(*THINGS[name]))
    hidden = film(scene(*THINGS[name], visible=nowhere))
    np.testing.assert_allclose(hidden, without, rtol=1e-5, atol=1e-6)
    assert np.abs(with_it - without).max() > 0.01


@pytest.mark.usefixtures("organisation")
@pytest.mark.parametrize("name", ["sphere", slow("mesh")])
def test_each_kind_of_ray_passes_by_itself(name):
    """Of one pixel that sees the object, one that sees its shadow, and one that sees it in the mirror."""
    black = {"kind": "matte", "reflectance": [0, 0, 0]}  # what it sends on would reach other pixels
    things = [each | {"material": black} for each in THINGS[name]]
    away = THINGS["rectangle"][0] | {"transform": [{"translate": [0, 0, 99]}], "visible": {"camera": False}}
    lights = [{"kind": "point", "position": [-0.5, 2, 1.5], "intensity": [9, 9, 9]}]
    # What is hidden behind the camera has the same kernels see all pictures.
    made = scene(away, *things, render={"max_depth": 3, "caustics": "off"}, lights=lights)
    made["objects"].remove(LAMP)
    image = rptcam_cl.render(made, size=(64, 48), spp=1, layers=["object_id"])
    index = len(made["objects"]) - 1
    bare = copy.deepcopy(made)
    bare["objects"][index]["transform"] = [{"translate": [0, 0, 99]}]
    seen = image["object_id"] == index
    without, whole = (np.asarray(each) for each in (rptcam_cl.render(bare, size=(64, 48), spp=1), image))
    in_mirror = (image["object_id"] == 1) & (np.abs(whole - without).max(axis=2) > 1e-4)
    on_floor = (image["object_id"] == 0) & (np.abs(whole - without).max(axis=2) > 1e-2)
    assert min(seen.sum(), in_mirror.sum(), on_floor.sum()) > 4

    def differs(key, **layers):
        made["objects"][index]["visible"] = {key: False}
        other = rptcam_cl.render(made, size=(64, 48), spp=1, **layers)
        assert not layers or (other["object_id"] != index).all()
        return np.abs(np.asarray(other) - whole).max(axis=2) > 1e-3

    camera, shadow, reflection = differs("camera", layers=["object_id"]), differs("shadow"), differs("reflection")
    assert not (whole[seen].any() or (shadow | reflection)[seen].any())
    assert camera[seen].mean() > 0.6
    assert not camera[in_mirror].any()
    assert shadow[on_floor].mean() > 0.6
    assert reflection[in_mirror].mean() > 0.3  # the mirror shows its shadow, too
    assert (reflection | shadow)[in_mirror].mean() > 0.6
    assert not reflection[on_floor & ~shadow].any()


@pytest.mark.slow
def test_lamp_that_is_not_reflected_lights_as_before():
    """The floor gets the same light; a mirror shows no lamp."""
    floor = {"camera": {"kind": "pinhole", "eye": [0, 1.5, 2], "target": [0, 0, 0.2], "fov_degrees": 30}}
    floor |= {"render": {"max_depth": 2}}
    made = scene(**floor)
    made["objects"].remove(MIRROR)
    before = film(made, spp=64)
    made["objects"][1] = LAMP | {"visible": {"reflection": False}}
    after = film(made, spp=64)
    np.testing.assert_allclose(after.mean(), before.mean(), rtol=3e-3)
    shown = scene(
        render={"max_depth": 2},
        camera={"kind": "pinhole", "eye": [0, 1.6, -0.6], "target": [0, 1.75, -1.5], "fov_degrees": 75},
    )
    bright = film(shown).max()
    shown["objects"][2] = LAMP | {"visible": {"reflection": False}}
    assert film(shown).max() < 1 < bright


@pytest.mark.slow
def test_glow_that_only_the_camera_sees_lights_as_before():
    """A principled lamp is sampled as others are; paths that cannot meet it take nothing of its light away."""
    glow = {"kind": "principled", "base_color": 0, "emission": 5, "specular": 0}
    large = {"corner": [-3, 2.2, -3], "edge_u": [6, 0, 0], "edge_v": [0, 0, 6]}  # so that paths find much of its light
    lamp = LAMP | large | {"material": glow}
    made = {"camera": scene()["camera"], "objects": [FLOOR, lamp], "render": {"max_depth": 2}}
    before = film(made, spp=64)
    made["objects"][1] = lamp | {"visible": {"shadow": False, "reflection": False}}
    np.testing.assert_allclose(film(made, spp=64).mean(), before.mean(), rtol=5e-3)
    assert before.mean() > 0.01
    moves = {"motion": [{"time_s": 0}, {"time_s": 1, "translate": [0, 1, 0]}]}
    with pytest.raises(InputError, match=r"objects\.1\.visible\.reflection: .* would light nothing"):
        film(made | {"objects": [FLOOR, made["objects"][1] | moves], "shutter": {"open_s": 0, "time_s": 1}})


@pytest.mark.usefixtures("organisation")
@pytest.mark.slow
@pytest.mark.parametrize("roughness", [0.3, 0.6])
def test_light_that_passes_lamps_has_the_mean_of_light_sampling_alone(roughness):
    """A ball of light before a larger lamp, on a rough metal; beside a far triangle without a shadow samples alone."""
    metal = {"kind": "conductor", "metal": "silver", "roughness": roughness}
    made = scene(render={"max_depth": 2})
    ball = {"shape": "sphere", "center": [0, 1.4, 0], "radius": 0.4, "visible": {"shadow": False}}
    made["objects"] = [
        FLOOR | {"material": metal},
        LAMP,
        ball | {"material": {"kind": "emissive", "radiance": [1, 2, 4]}},
    ]
    one_by_one = film(made, spp=512)
    made["objects"].append(
        MESH | {"transform": {"translate": [0, 0, 900]}, "material": RED, "visible": {"shadow": False}}
    )
    alone = film(made, spp=512)
    lit = slice(14, None)
    np.testing.assert_allclose(one_by_one[lit].mean((0, 1)), alone[lit].mean((0, 1)), rtol=0.01)
    assert np.abs(alone - one_by_one).max() > 0


@pytest.mark.parametrize(
    "environment",
    [
        slow({"kind": "constant", "radiance": [1, 1, 1]}),
        {"kind": "gradient", "bottom": [0.2, 0.2, 0.2], "top": [1, 1, 2]},
        slow({"kind": "sky", "gain": 1e-4}),
    ],
    ids=lambda each: each["kind"],
)
def test_surroundings_that_the_camera_does_not_see_light_the_scene(environment):
    made = scene(*THINGS["sphere"], environment=environment)
    image = rptcam_cl.render(made, size=(32, 24), spp=8, layers=["object_id"])
    made["environment"] = environment | {"visible": {"camera": False}}
    dark = film(made)
    sky = image["object_id"] < 0
    assert (np.asarray(image)[sky] > 0).all()
    assert (dark[8:][image["object_id"][8:] >= 0] == np.asarray(image)[8:][image["object_id"][8:] >= 0]).mean() > 0.9
    assert (dark[:4][sky[:4]] == 0).mean() > 0.8  # rays of a pixel on an edge meet the mirror


def test_sun_whose_disk_the_camera_does_not_see():
    camera = {"kind": "pinhole", "eye": [0, 1, 0], "target": [0, 1.5, -1], "fov_degrees": 60}
    sun = {"kind": "sun", "direction": [0, -0.5, 1], "irradiance": [1, 1, 1], "diameter_degrees": 10}
    made = {"camera": camera, "objects": [FLOOR], "lights": [sun]}
    before = film(made)
    made["lights"] = [sun | {"visible": {"camera": False}}]
    after = film(made)
    assert before.max() > 10 > 0.5 > after.max()
    assert (before != after).sum() == (before > 1).sum() > 20


def test_lamp_that_would_light_nothing_is_refused():
    moving = LAMP | {"motion": [{"time_s": 0}, {"time_s": 1, "translate": [0, 1, 0]}], "visible": {"reflection": False}}
    made = scene() | {"objects": [FLOOR, moving], "shutter": {"open_s": 0, "time_s": 1}}
    with pytest.raises(InputError, match=r"objects\.1\.visible\.reflection: .* would light nothing"):
        film(made)


@pytest.mark.slow
def test_session_follows_what_is_hidden():
    with rptcam_cl.RenderSession(scene(*THINGS["sphere"]), size=(32, 24)) as session:
        session.take(1)
        session.change({"objects.3.visible.shadow": False})
        after = session.take(4).pixels
    assert (after == film(scene(*THINGS["sphere"], visible={"shadow": False}), spp=4)).all()


TRANSPARENT = scene(
    *THINGS["sphere"], environment={"kind": "constant", "radiance": [0.4, 0.5, 0.6]}, film={"transparent": True}
)


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".exr", ".npz"])
def test_film_without_a_background_over_another_is_the_scene_before_it(suffix, tmp_path):
    """Files of it, developed linearly and laid over the surroundings, against the scene with them in sight."""
    linear = {"picture": {"tone": "linear", "bits": 16}, "render": {"roulette_depth": 0}}  # which goes by brightness
    image = rptcam_cl.render(TRANSPARENT | linear, size=(32, 24), spp=100)
    before = np.asarray(rptcam_cl.render(TRANSPARENT | linear | {"film": {}}, size=(32, 24), spp=100))
    assert 0.2 < image["coverage"].mean() < 0.95
    assert (image.pixels[image["coverage"] == 0] == 0).all()
    path = tmp_path / f"picture{suffix}"
    image.save(path)
    if suffix in (".exr", ".npz"):  # as a compositor has it: colours times alpha
        film = rptcam_cl.develop(path)
        colour, alpha = film.pixels, film["coverage"]
        film.save(tmp_path / "again.png")
        assert PIL.Image.open(tmp_path / "again.png").mode == "RGBA"
        wide = desqueezed(film, 2)["coverage"]
        np.testing.assert_allclose(wide, np.repeat(alpha, 2, axis=1), atol=1e-6)
    else:
        codes = tifffile.imread(path) if suffix == ".tiff" else read_png(path)
        alpha = codes[..., 3] / 65535
        colour = codes[..., :3] / 65535 * alpha[..., None]
    over = colour + (1 - alpha[..., None]) * [0.4, 0.5, 0.6]
    kept = image.pixels.max(axis=2) <= image["coverage"]  # a screen clips what is brighter
    assert kept.mean() > 0.9
    np.testing.assert_allclose(over[kept], before[kept], atol=2e-5)


@pytest.mark.parametrize("bits", [8, 16])
def test_png_with_alpha_is_read_as_it_was_written(bits, tmp_path):
    image = rptcam_cl.render(TRANSPARENT | {"picture": {"bits": bits}}, size=(33, 24), spp=4)
    image.save(tmp_path / "a.png")
    codes = read_png(tmp_path / "a.png")
    top = 2**bits - 1
    assert codes.dtype == (np.uint8 if bits == 8 else np.uint16)
    np.testing.assert_allclose(codes[..., 3] / top, image["coverage"], atol=0.51 / top)
    full = image["coverage"] == 1
    np.testing.assert_allclose(codes[..., :3][full] / top, image.developed()[full], atol=0.51 / top)


@pytest.mark.slow
def test_film_without_a_background_goes_through_lens_and_session(tmp_path):
    made = TRANSPARENT | {"camera": {"kind": "thin_lens", "eye": [2, 1.2, 3.5], "target": [0, 0.6, 0]}}
    made["camera"] |= {"focal_length_mm": 20, "f_number": 1.4, "focus_distance_m": 1}
    image = rptcam_cl.render(made, size=(32, 24), spp=16)
    blurred = (image["coverage"] > 0) & (image["coverage"] < 1)
    assert blurred.mean() > 0.04
    with rptcam_cl.RenderSession(made | {"film": {}}, size=(32, 24)) as session:
        session.take(1)
        session.change({"film.transparent": True})
        np.testing.assert_array_equal(session.take(16).pixels, image.pixels)


def read_png(path):
    """Return the codes of a PNG with alpha, read by another program than wrote it."""
    width, height, rows, info = png.Reader(str(path)).read()
    assert info["planes"] == 4
    return np.vstack([np.asarray(row) for row in rows]).reshape(height, width, 4)
