"""The layer `lights`: the light of each group of lamps apart, and films that are lit anew by factors."""

import numpy as np
import pytest

import rptcam_cl as rc
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.image import read_film, relit
from rptcam_cl.rendering import tracer
from rptcam_cl.rendering.plan.plan import make_plan

WHITE = {"kind": "matte", "reflectance": [0.7, 0.6, 0.5]}
KEY = {"kind": "emissive", "radiance": [30, 30, 40]}
SCENE = {
    "film": {"resolution": [32, 24], "size_mm": [36, 27]},
    "camera": {"kind": "pinhole", "fov_degrees": 50, "eye": [0, 1, 4], "target": [0, 0.8, 0]},
    "render": {"spp": 64, "max_depth": 4, "layers": ["lights"]},
    "medium": {"scattering_per_m": [0.05, 0.04, 0.03], "absorption_per_m": [0.01, 0.01, 0.02], "emission_per_m": 0.001},
    "lights": [
        {"kind": "point", "position": [1, 2, 1], "intensity": [9, 5, 5]},
        {"kind": "spot", "position": [-1, 3, 1], "direction": [0.3, -1, -0.3], "intensity": 20, "outer_degrees": 30},
    ],
    "materials": {"white": WHITE, "key": KEY, "fill": KEY | {"radiance": [0, 8, 0]}},
    "objects": [
        {"shape": "rectangle", "corner": [-4, 0, -4], "edge_u": [0, 0, 8], "edge_v": [8, 0, 0], "material": "white"},
        {"shape": "sphere", "center": [0, 0.5, 0], "radius": 0.5, "material": "white"},
        {"shape": "sphere", "center": [-1, 1.3, 0.3], "radius": 0.1, "material": "key", "name": "key lamp"},
        {"shape": "sphere", "center": [1, 0.3, 1], "radius": 0.1, "material": "fill", "group": "fill"},
        {"shape": "sphere", "center": [-1, 0.3, 1], "radius": 0.1, "material": "fill", "group": "fill"},
    ],
}
OUTDOORS = {name: part for name, part in SCENE.items() if name != "medium"} | {
    "environment": {"kind": "gradient", "bottom": [0.1, 0.1, 0.1], "top": [0.3, 0.4, 0.9], "group": "sky"},
    "lights": [{"kind": "sun", "direction": [-1, -2, -1], "irradiance": [2, 2, 1.6], "diameter_degrees": 3}],
}
GROUPS = {"media": SCENE, "outdoors": OUTDOORS}


def lit_by(scene, group):
    """The scene with the lamps of one group alone."""
    lights = [one for place, one in enumerate(scene["lights"]) if one.get("group", f"light_{place}") == group]
    objects = []
    for place, item in enumerate(scene["objects"]):
        own = item.get("group", item.get("name", f"object_{place}").replace(" ", "_"))
        objects.append(item if item["material"] == "white" or own == group else item | {"material": "dark"})
    materials = scene["materials"] | {"dark": KEY | {"radiance": 0}}
    alone = scene | {"lights": lights, "objects": objects, "materials": materials, "render": {"spp": 1024, "seed": 7}}
    if group != "sky":
        alone.pop("environment", None)
    if "medium" in alone and group != "media":
        alone["medium"] = {key: value for key, value in alone["medium"].items() if key != "emission_per_m"}
    alone["render"]["max_depth"] = 4
    return alone


@pytest.mark.slow
@pytest.mark.parametrize("kind", GROUPS)
def test_each_layer_is_the_picture_of_its_lamps_alone(kind):
    scene = GROUPS[kind] | {"render": GROUPS[kind]["render"] | {"spp": 1024}}
    image = rc.render(scene)
    for name, light in image.layers.items():
        alone = rc.render(lit_by(scene, name.removeprefix("lights."))).pixels
        tiles = [each.astype(float).reshape(6, 4, 8, 4, 3).mean(axis=(1, 3)) for each in (light, alone)]
        assert light.mean() == pytest.approx(alone.mean(), rel=0.02), name
        assert np.sqrt(((tiles[0] - tiles[1]) ** 2).mean()) < 0.06 * alone.mean(), name


@pytest.fixture(scope="module")
def picture():
    return rc.render(SCENE)


def test_layers_are_named_by_group_and_add_up_to_the_film(picture):
    assert [*picture.layers] == [f"lights.{name}" for name in ("key_lamp", "fill", "light_0", "light_1", "media")]
    assert all(light.mean() > 0 for light in picture.layers.values())
    whole = sum(light.astype(float) for light in picture.layers.values())
    assert np.abs(whole - picture.pixels).max() < 3e-6 * picture.pixels.max()


def test_the_film_keeps_its_bits(picture):
    plain = rc.render(SCENE | {"render": SCENE["render"] | {"layers": []}})
    assert np.array_equal(plain.pixels, picture.pixels)


@pytest.mark.slow
def test_passes_have_the_bits_of_the_stream(picture, monkeypatch):
    monkeypatch.setattr(tracer, "ORGANISATION", dict.fromkeys(tracer.ORGANISATION, "passes"))
    passes = rc.render(SCENE)
    assert all(np.array_equal(passes[name], picture[name]) for name in picture.layers)


@pytest.mark.slow
def test_a_denoised_film_keeps_the_layers(picture):
    pytest.importorskip("pyoidn")
    smooth = rc.render(SCENE, denoise=True, layers=["depth", "lights"])
    assert [*smooth.layers] == ["depth", "albedo", "normal", *picture.layers]
    assert np.array_equal(smooth["lights.fill"], picture["lights.fill"])


def test_parts_of_the_samples_merge_to_the_layers(picture, tmp_path):
    parts = [tmp_path / f"{first}.rpck" for first in (0, 32)]
    for first, path in zip((0, 32), parts, strict=True):
        rc.render(SCENE, samples=(first, first + 32), checkpoint=path)
    merged = rc.merge(parts)
    for name, light in picture.layers.items():
        assert np.abs(merged[name] - light).max() <= 1e-6 * picture.pixels.max(), name


@pytest.mark.parametrize("suffix", [".exr", ".npz"])
def test_film_read_back_is_lit_anew(picture, tmp_path, suffix):
    path = tmp_path / f"film{suffix}"
    picture.save(path)
    film = rc.develop(path, ["lights.fill=0", "lights.media=[2,1,0.5]"])
    lights = {name: light.astype(float) for name, light in picture.layers.items()}
    lights["lights.fill"] *= 0
    lights["lights.media"] *= [2, 1, 0.5]
    assert np.abs(film.pixels - sum(lights.values())).max() < 5e-6 * picture.pixels.max()
    back = relit(film, {"fill": 1, "media": 1})
    assert np.abs(back.pixels - read_film(path).pixels).max() < 5e-6 * picture.pixels.max()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("lights.fil=1", "no such group; did you mean fill?"),
        ("lights.fill=-1", "is no factor (got -1"),
        ("lights.fill=[1,2]", "is no factor (got [1, 2]"),
        ("lights.fill=bright", "is no factor on a group of lamps"),
        ("lights.fill", "is no factor on a group of lamps"),
    ],
)
def test_wrong_factors_are_refused(picture, text, said):
    with pytest.raises(InputError) as problem:
        rc.develop(picture, [text])
    assert said in str(problem.value)


def test_film_without_the_layer_says_so():
    with pytest.raises(InputError, match="does not keep the light of its lamps apart"):
        relit(rc.Image(np.zeros((2, 2, 3), np.float32), {}), {"key": 0.5})


def test_a_mix_of_which_a_part_shines_is_a_lamp():
    """Else its light was in the first layer: that of another lamp."""
    shining = {"kind": "principled", "base_color": 0.5, "emission": [0, 3, 0]}
    pane = {"kind": "mix", "materials": [shining, {"kind": "thin_glass"}], "factor": 0.5}
    objects = [*SCENE["objects"][:4], SCENE["objects"][4] | {"material": pane, "group": "pane"}]
    assert "pane" in make_plan(rc.load_scene(SCENE | {"objects": objects})).light_groups.names


def test_too_many_lamps_are_told_to_share_groups():
    many = [SCENE["objects"][3] | {"group": f"lamp{k}"} for k in range(17)]
    with pytest.raises(InputError, match=r"of which there are 20 .*at most 16 groups"):
        rc.render(SCENE | {"objects": SCENE["objects"][:2] + many})


def test_ghosts_and_diffraction_are_refused():
    camera = {"kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 1, 4], "target": [0, 0.8, 0]}
    camera |= {"focus": {"distance_m": 4}}
    with pytest.raises(InputError, match=r"allowed: camera\.diffraction: off"):
        rc.render(OUTDOORS | {"camera": camera | {"diffraction": "on"}})


def test_groups_change_no_hash_without_the_layer():
    plain = SCENE | {"render": {"spp": 4}}
    ungrouped = [{key: value for key, value in item.items() if key != "group"} for item in SCENE["objects"]]
    one, other = (rc.load_scene(each) for each in (plain, plain | {"objects": ungrouped}))
    assert one.content_hash() == other.content_hash()
