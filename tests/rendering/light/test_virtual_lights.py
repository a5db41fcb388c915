"""Virtual lights: closed forms, the light that paths alone find, what they save, and the same bits in any pieces."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ttest_ind

import rptcam_cl
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.tracer import Wavefront, WavefrontPool
from rptcam_cl.rendering.virtual_lights import from_octahedral
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from tests.rendering.light.pictures import save_exr
from tests.rendering.pictures import batches, looking, pixels, room_lit_by_detours, scene_of, seed_of
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent

RADIUS, INTENSITY, REFLECTANCE = 2.0, np.array([3.0, 2.0, 1.0]), np.array([0.8, 0.5, 0.3])
GLASS = {"kind": "dielectric", "index": 1.5}


def choosing(scene, choice, **settings):
    return scene | {"render": scene["render"] | {"virtual_lights": choice, **settings}}


def assert_same_light(found, expected):
    """Compare means of tiles by Welch's test over pictures: pixels of one picture share the light of a pass."""
    one, other = (each.reshape(len(each), 3, 8, 3, 8, 3).mean(axis=(2, 4)) for each in (found, expected))
    chance = ttest_ind(one, other, equal_var=False).pvalue
    assert chance.min() > 1e-5, (chance.min(), one.mean(axis=0) / other.mean(axis=0))


def pictures(scene, name, spp):
    return np.array([pixels(scene, seed=seed_of(f"{name} {number}"), spp=spp) for number in range(8)])


def choice_of(scene):
    plan = make_plan(load_scene(scene))
    assert plan.facts["VIRTUAL_LIGHTS"] == int(plan.virtual_lights.active)
    return plan.virtual_lights.choice


@pytest.mark.parametrize("depth", [slow(3), 7])
@pytest.mark.parametrize("place", [[0, 0, 0], slow([0.5, 0.3, -0.9])], ids=str)
def test_light_within_a_matte_sphere_is_the_closed_form(depth, place):
    """Jacquez and Kuppenheim 1955: after the first, each bounce lights the whole sphere evenly."""
    inside = {"shape": "sphere", "center": [0, 0, 0], "radius": RADIUS,
              "material": {"kind": "matte", "reflectance": REFLECTANCE.tolist()}}  # fmt: skip
    lamp = {"kind": "point", "position": place, "intensity": INTENSITY.tolist()}
    eye, target = np.array([0.7, -0.4, 0.5]), np.array([RADIUS, 0, 0])
    scene = scene_of([inside], looking(eye, target, fov=0.2), depth=depth, lights=[lamp])
    found = pictures(choosing(scene, "on"), f"sphere {depth} {place}", 512).mean(axis=(1, 2))
    way = np.array(place) - target
    direct = REFLECTANCE * INTENSITY / np.pi * (-way[0]) / np.linalg.norm(way) ** 3
    later = sum(REFLECTANCE**bounces for bounces in range(2, depth))
    expected = direct + INTENSITY / (np.pi * RADIUS**2) * later
    assert_equivalent(found.mean(axis=0), found.std(axis=0, ddof=1) / np.sqrt(len(found)), expected, 0.01 * expected)


def _ball(material, center=(0.3, 0.5, -0.3), radius=0.3):
    return {"shape": "sphere", "center": list(center), "radius": radius, "material": material}


def _octahedron(normals, **more):
    corners = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1], [-1, 0, 0], [0, 0, -1], [0, -1, 0]]) * 0.4 + [0.2, 0.5, -0.2]
    faces = [[0, 2, 1], [0, 1, 4], [0, 4, 3], [0, 3, 2], [5, 1, 2], [5, 4, 1], [5, 3, 4], [5, 2, 3]]
    return {"shape": "mesh", "vertices": corners.tolist(), "faces": faces, "normals": normals,
            "material": {"kind": "matte", "reflectance": 0.5, **more}}  # fmt: skip


GREY = {"kind": "matte", "reflectance": 0.5}
OVER_LAMP = {"shape": "rectangle", "corner": [-0.3, 1.7, -1.0], "edge_u": [0.6, 0, 0], "edge_v": [0, 0, 0.5]}
OBJECTS = {
    "metal": _ball({"kind": "conductor", "reflectance": [0.9, 0.7, 0.4], "alpha": 0.3}),
    "rough matte": _ball(GREY | {"sigma_degrees": 40}),
    "mirror": _ball({"kind": "mirror", "reflectance": 0.9}),
    "glass": _ball(GLASS),
    "rough glass": _ball(GLASS | {"roughness": 0.6}),
    "tinted glass": _ball(GLASS | {"absorption_per_m": [1, 3, 8]}),
    "plastic": _ball({"kind": "plastic", "reflectance": [0.2, 0.4, 0.6]}),
    "principled glass": _ball({"kind": "principled", "base_color": [0.9, 0.7, 0.6], "roughness": 0.5,
                               "transmission": 0.8}),
    "brushed metal": _ball({"kind": "conductor", "reflectance": 0.9, "alpha": [0.7, 0.15]}),
    "leaf": _ball({"kind": "translucent", "reflectance": 0.3, "transmittance": [0.2, 0.5, 0.1]}),
    "mix": _ball({"kind": "mix", "materials": [GREY, {"kind": "conductor", "reflectance": 0.9, "alpha": 0.2}],
                  "factor": 0.5}),
    "stretched": _ball(GREY, (0, 0, 0), 1.0) | {"transform": [
        {"scale": [0.4, 0.2, 0.3]}, {"rotate": {"axis": [1, 2, 0.5], "degrees": 40}}, {"translate": [0.2, 0.6, -0.2]}]},
    "mesh": _octahedron("flat"),
    "smooth mesh": _octahedron("smooth"),
    "lamp": _ball({"kind": "emissive", "radiance": 2.0}, radius=0.05),
    "lamp of two sides": {"shape": "rectangle", "corner": [-0.5, 0.4, 0], "edge_u": [0.4, 0, 0],
                          "edge_v": [0, 0.3, 0.2],
                          "material": {"kind": "emissive", "radiance": 1, "two_sided": True}},
    "holes": OVER_LAMP | {"material": {"kind": "translucent", "reflectance": 0.1, "transmittance": 0.8, "opacity": {
        "kind": "checker", "even": 0.1, "odd": 0.7, "scale": [4, 4]}}},
    "mesh with holes": _octahedron("flat", opacity=0.4),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", OBJECTS)
def test_light_is_that_of_paths_alone(name):
    scene = room_lit_by_detours(objects=[OBJECTS[name]], resolution=(24, 24), depth=6)
    found, expected = (
        pictures(choosing(scene, choice), f"{name} {choice}", spp) for choice, spp in (("on", 256), ("off", 1024))
    )
    assert_same_light(found, expected)


def _plane(point=(0, 0, 0), normal=(0, 1, 0)):
    return {"shape": "plane", "point": list(point), "normal": list(normal), "material": GREY}


LANTERN = [
    _ball({"kind": "emissive", "radiance": [30, 25, 20]}, (0, 1.2, 0), 0.1),
    {"shape": "box", "min": [-0.3, 1.0, -0.3], "max": [0.3, 1.05, 0.3], "material": GREY},
    {"shape": "box", "min": [-1, 1.6, -1], "max": [1, 1.7, 1], "material": GREY},
]
ON_PLANES = {
    "under a roof": ([_plane(), *LANTERN], {}),
    "tilted": ([_plane(normal=(0.2, 1, 0.1)), _plane((0, 0, -2), (0.1, 0.2, 1)), *LANTERN], {}),
    "a lamp alone": ([_plane(), _plane((0, 0, -2), (0, 0, 1)), LANTERN[0]], {}),
    "a sky": ([_plane(), *LANTERN[1:]], {"environment": {"kind": "constant", "radiance": 0.5}}),
    "a sun": ([_plane(), *LANTERN[1:]], {"lights": [{"kind": "directional", "direction": [-0.6, -1, -0.3],
                                                     "irradiance": 3.0}]}),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", ON_PLANES)
def test_light_on_planes_without_end_is_that_of_paths_alone(name):
    # Light that a plane sends on from far away counts, too: without it the sky's picture is 1.2 % darker.
    objects, light = ON_PLANES[name]
    camera = looking([2.5, 1.2, 3], [0, 0.6, 0], fov=60.0, up=(0, 1, 0))
    scene = scene_of(objects, camera, resolution=(96, 96), depth=6, **light)
    found, expected = (
        pictures(choosing(scene, choice), f"plane {name} {choice}", spp).reshape(8, 24, 4, 24, 4, 3).mean(axis=(2, 4))
        for choice, spp in (("on", 256), ("off", 512))
    )
    assert_same_light(found, expected)
    whole = [each.mean(axis=(1, 2, 3)) for each in (found, expected)]
    margin = 0.003 * whole[1].mean()
    assert abs(whole[0].mean() - whole[1].mean()) < margin + 3 * np.hypot(*(each.std() / 8**0.5 for each in whole))


def test_room_on_a_plane_has_virtual_lights_and_their_bits_in_pieces():
    scene = choosing(room_lit_by_detours(resolution=(32, 24)), "auto")
    scene["objects"][0] = _plane()
    assert choice_of(scene) == "on: paths connect to virtual lights"
    below = scene | {"objects": [*scene["objects"], _plane((0, -0.3, 0))]}
    assert choice_of(below) == "on: paths connect to virtual lights"
    sky = {"environment": {"kind": "constant", "radiance": 1.0}}
    bare = scene_of([_plane()], looking([0, 1, 2], [0, 0.5, 0], up=(0, 1, 0)), **sky)
    assert choice_of(choosing(bare, "auto")) == "off: nothing but planes"
    whole = np.asarray(rptcam_cl.render(scene, spp=21))
    assert bits(scene, wave_size=1024) == hashlib.sha256(whole.tobytes()).hexdigest()


BULB = _ball({"kind": "emissive", "radiance": [120, 110, 90]}, (0, 1.7, -0.2), 0.05)
PANE = {"shape": "box", "min": [-0.99, 1.9, 0], "max": [0.99, 1.93, 0.99],
        "material": GLASS | {"absorption_per_m": [1, 5, 15]}}  # fmt: skip
SPOT = {"kind": "spot", "position": [-0.7, 1.9, 0.2], "direction": [0.9, -1.4, -0.5], "intensity": 9.0,
        "inner_degrees": 20, "outer_degrees": 30}  # fmt: skip
SUN = {"kind": "sun", "direction": [0.3, -1, -0.2], "irradiance": [9, 8, 7], "diameter_degrees": 3.0}
BEHIND_GLASS = {"globe", "tinted globe", "pane", "photons of a pane"}
BY_GLASS = {
    "globe": [BULB, _ball(GLASS, (0, 1.7, -0.2), 0.2)],
    "tinted globe": [BULB, _ball(GLASS | {"absorption_per_m": [1, 3, 8]}, (0, 1.7, -0.2), 0.2)],
    "frosted globe": [BULB, _ball(GLASS | {"roughness": 0.6}, (0, 1.7, -0.2), 0.2)],
    "principled globe": [BULB, _ball(OBJECTS["principled glass"]["material"], (0, 1.7, -0.2), 0.2)],
    "pane": [PANE],
    "photons": [_ball(GLASS)],
    "photons of a pane": [PANE, _ball(GLASS)],
    "photons by a mirror": [_ball({"kind": "mirror", "reflectance": 0.9})],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_GLASS)
def test_light_through_glass_is_that_of_paths_and_photons(name):
    lights = [SUN] if PANE in BY_GLASS[name] else [SPOT] if "photons" in name else []
    scene = room_lit_by_detours(dark=True, objects=BY_GLASS[name], lights=lights, resolution=(24, 24), depth=7)
    if PANE in BY_GLASS[name]:  # half the ceiling away
        scene["objects"][1] |= {"edge_v": [0, 0, 1]}
    scene["render"]["caustics"] = "on" if "photons" in name else "off"
    facts = make_plan(load_scene(choosing(scene, "on"))).facts
    assert (facts["CAUSTICS"], facts["LAMPS_BEHIND_GLASS"]) == ("photons" in name, name in BEHIND_GLASS)
    found, expected = (
        pictures(choosing(scene, choice), f"{name} {choice}", spp) for choice, spp in (("on", 256), ("off", 1024))
    )
    assert_same_light(found, expected)


@pytest.mark.slow
@pytest.mark.parametrize("light", ["sky", "picture", "directional", "sun", "spot"])
def test_light_from_afar_is_that_of_paths_alone(light, tmp_path):
    rng = np.random.default_rng(5)
    save_exr(tmp_path / "sky.exr", rng.uniform(0, 3, (8, 16, 3)))
    afar = {
        "sky": {"environment": {"kind": "constant", "radiance": [2, 3, 4]}},
        "picture": {"environment": {"kind": "image", "file": "sky.exr"}},
        "directional": {"lights": [{"kind": "directional", "direction": [0.3, -1, -0.2], "irradiance": [9, 8, 7]}]},
        "sun": {"lights": [{"kind": "sun", "direction": [0.3, -1, -0.2], "irradiance": [9, 8, 7]}]},
        "spot": {
            "lights": [
                {
                    "kind": "spot",
                    "position": [0, 1.5, 0.2],
                    "direction": [0, 1, 0],
                    "intensity": 3.0,
                    "inner_degrees": 20,
                    "outer_degrees": 30,
                }
            ]
        },
    }[light]
    scene = room_lit_by_detours(dark=True, resolution=(24, 24), depth=5, **afar)
    if light != "spot":  # takes half the ceiling away
        scene["objects"][1] |= {"edge_v": [0, 0, 1]}
    found, expected = (
        pictures(load_scene(choosing(scene, choice), base_dir=tmp_path), f"{light} {choice}", spp)
        for choice, spp in (("on", 512), ("off", 1024))
    )
    assert_same_light(found, expected)


def test_mirrored_light_of_a_lamp_without_size_stays_out_as_on_paths():
    mirror = {"shape": "rectangle", "corner": [1, 0, -1], "edge_u": [0, 1, 0], "edge_v": [0, 0, 2],
              "material": {"kind": "mirror", "reflectance": 1.0}}  # fmt: skip
    floor = {"shape": "rectangle", "corner": [-1, 0, -1], "edge_u": [0, 0, 2], "edge_v": [1.5, 0, 0], "material": GREY}
    card = {"shape": "rectangle", "corner": [-1, 0.5, -1], "edge_u": [0, 0, 2], "edge_v": [1.4, 0, 0],
            "material": {"kind": "matte", "reflectance": 0.0}}  # fmt: skip
    lamp = {"kind": "point", "position": [-0.5, 1, 0], "intensity": 1.0}
    wall = {"shape": "rectangle", "corner": [-0.9, 0, -0.9], "edge_u": [0.8, 0, 0], "edge_v": [0, 0.3, 0],
            "material": GREY}  # fmt: skip
    camera = looking([0.2, 0.25, 0.3], [-0.4, 0.15, -0.9], up=(0, 1, 0))
    scene = scene_of([mirror, floor, card, wall], camera, lights=[lamp])
    assert not pixels(choosing(scene, "off"), spp=16).any()
    assert not pixels(choosing(scene, "on"), spp=16).any()


def test_room_that_is_lit_by_detours_has_less_noise():
    scene = room_lit_by_detours(resolution=(32, 32), depth=8)
    assert choice_of(choosing(scene, "auto")) == "on: paths connect to virtual lights"
    variance = {}
    for choice in ("off", "auto"):
        found = batches(choosing(scene, choice), "gain", 4, spp=32)
        variance[choice] = float((luminance(found.variance) / luminance(found.mean) ** 2).mean())
    assert variance["auto"] < variance["off"] / 5


OPEN = {"shape": "rectangle", "corner": [-3, 0, -3], "edge_u": [0, 0, 6], "edge_v": [6, 0, 0], "material": GREY}
LAMP = {"shape": "rectangle", "corner": [-0.2, 1.9, 0], "edge_u": [0.4, 0, 0], "edge_v": [0, 0, 0.4],
        "material": {"kind": "emissive", "radiance": 20.0}}  # fmt: skip
SPARK = {"shape": "sphere", "radius": 0.04, "material": {"kind": "emissive", "radiance": 20.0}}
UNEVEN = SPARK | {"center": [-0.6, 1.2, -0.6]}
UNDER_LAMP = {"shape": "box", "min": [-0.9, 1.8, -0.9], "max": [0.9, 1.85, 0.9], "material": GLASS}


def of_plastic(scene):
    """All walls but two, which have no places for virtual lights."""
    plastic = {"kind": "plastic", "reflectance": 0.5}
    objects = [item | {"material": plastic} if k in (0, 2, 3, 4) else item for k, item in enumerate(scene["objects"])]
    return scene | {"objects": objects}


def seen_from_outside(visible):
    scene = room_lit_by_detours()
    scene["objects"][3] |= {"visible": {"camera": visible}}
    scene["camera"]["eye"] = [0.3, 1, 3]
    return scene


@pytest.mark.parametrize(
    ("scene", "choice"),
    [
        (scene_of([OPEN, LAMP], looking([0, 1, 2], [0, 0.5, 0], up=(0, 1, 0))), "off: light leaves the scene: "),
        (room_lit_by_detours(dark=True, objects=[LAMP]), "off: lamps light "),
        (room_lit_by_detours(), "on: paths connect to virtual lights"),
        (room_lit_by_detours(dark=True), "off: no light"),
        (of_plastic(room_lit_by_detours()), "off: 36% of what is around "),
        (room_lit_by_detours(depth=2), "off: paths of fewer than 3 edges"),
        (room_lit_by_detours(dark=True, objects=[UNEVEN]), "off: lamps light "),
        (room_lit_by_detours(dark=True, objects=[UNEVEN, _octahedron("flat")]), "on: paths connect to virtual lights"),
        (room_lit_by_detours(dark=True, objects=[LAMP, UNDER_LAMP]), "off: lamps light "),
        (seen_from_outside(visible=False), "on: paths connect to virtual lights"),
        (seen_from_outside(visible=True), "off: light leaves the scene: "),
    ],
    ids=[
        "open",
        "lit",
        "by detours",
        "dark",
        "of plastic",
        "short",
        "uneven",
        "among meshes",
        "through glass",
        "wall unseen",
        "wall seen",
    ],
)
def test_auto_looks_where_light_comes_from(scene, choice):
    found = choice_of(choosing(scene, "auto"))
    assert found is not None
    assert found.startswith(choice)


def of_meshes(scene, *, joined):
    """Return a scene whose rectangles that do not shine are meshes, or all of one material a single one."""
    meshes, others = {}, []
    for number, item in enumerate(scene["objects"]):
        if item["shape"] != "rectangle" or item["material"]["kind"] == "emissive":
            others.append(item)
            continue
        corner, u, v = (np.array(item[key], float) for key in ("corner", "edge_u", "edge_v"))
        key = repr(item["material"]) if joined else number
        mesh = meshes.setdefault(key, {"shape": "mesh", "vertices": [], "faces": [], "material": item["material"]})
        first = len(mesh["vertices"])
        mesh["vertices"] += [each.tolist() for each in (corner, corner + u, corner + u + v, corner + v)]
        mesh["faces"].append([first, first + 1, first + 2, first + 3])
    return scene | {"objects": [*others, *meshes.values()]}


BAR = {"shape": "box", "min": [-0.02, 1.87, -0.2], "max": [0.02, 1.88, 0.6], "material": GREY}  # below its middle
ROOMS = {
    "by detours": ({}, True),
    "a bulb in the middle": ({"dark": True, "objects": [SPARK | {"center": [0, 1, 0]}]}, False),
    "a bulb near the ceiling": ({"dark": True, "objects": [SPARK | {"center": [0.4, 1.93, -0.4]}]}, True),
    "a lamp close to the ceiling": ({"dark": True, "objects": [LAMP | {"corner": [-0.2, 1.97, 0]}]}, False),
    "a lamp with a bar": ({"dark": True, "objects": [LAMP, BAR]}, False),
}


@pytest.mark.parametrize("name", ROOMS)
def test_auto_decides_alike_for_a_room_of_meshes(name):
    more, gains = ROOMS[name]
    scene = choosing(room_lit_by_detours(**more), "auto")
    choices = [choice_of(scene)] + [choice_of(of_meshes(scene, joined=joined)) for joined in (False, True)]
    assert [choice.startswith("on") for choice in choices] == 3 * [gains], choices


def test_auto_decides_alike_in_light_of_any_unit():
    choices = set()
    for unit in (1e-9, 1.0, 1e9):
        lamp = LAMP | {"material": {"kind": "emissive", "radiance": 20.0 * unit}}
        scene = room_lit_by_detours(dark=True, objects=[lamp], environment={"kind": "constant", "radiance": unit})
        del scene["objects"][5]  # the wall on the left
        choices.add(choice_of(choosing(scene, "auto")))
    assert len(choices) == 1
    assert choices.pop().startswith("off: lamps light ")


def test_auto_leaves_out_no_wall_for_a_sun():
    # All walls are one mesh, the last primitive: suns from all sides, which are none, do not shine through it.
    ways = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    suns = [{"kind": "directional", "direction": way, "irradiance": 3.0} for way in ways]
    closed = of_meshes(room_lit_by_detours(dark=True, lights=suns), joined=True)
    assert choice_of(choosing(closed, "auto")) == "on: paths connect to virtual lights"


def test_auto_looks_into_a_room_from_far_away():
    scene = room_lit_by_detours()
    scene["camera"] = looking([0, 1, 40], [0, 1, 0], fov=4.0, up=(0, 1, 0))
    del scene["objects"][3]  # the wall in front
    assert choice_of(choosing(scene, "auto")) == "on: paths connect to virtual lights"


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"medium": {"visibility_m": 50}}, "media such as fog"),
        ({"objects": [_ball({"kind": "dielectric", "glass": "N-BK7"})]}, "glass that disperses"),
        ({"objects": [_ball(GREY) | {"visible": {"shadow": False}}]}, "hidden from reflection or shadow"),
    ],
)
def test_what_they_do_not_know_of_is_refused_where_they_are_asked_for(more, reason):
    scene = room_lit_by_detours(**more)
    with pytest.raises(InputError, match=f"render.virtual_lights: there are none with .*{reason}"):
        make_plan(load_scene(choosing(scene, "on")))
    assert choice_of(choosing(scene, "auto")) is None


def test_metadata_say_what_was_decided():
    scene = room_lit_by_detours(resolution=(8, 8))
    picture = rptcam_cl.render(scene, spp=1)
    assert picture.metadata["virtual_lights"] == picture.stats["virtual_lights"]["choice"] == choice_of(scene)
    off = choosing(scene, "off")
    assert "virtual_lights" not in rptcam_cl.render(off, spp=1).metadata


def bits(scene, **options):
    return hashlib.sha256(np.asarray(rptcam_cl.render(scene, spp=21, **options)).tobytes()).hexdigest()


def test_waves_and_crops_do_not_change_a_bit():
    scene = room_lit_by_detours(resolution=(32, 24))
    whole = np.asarray(rptcam_cl.render(scene, spp=21))
    assert bits(scene, wave_size=1024) == hashlib.sha256(whole.tobytes()).hexdigest()
    part = np.asarray(
        rptcam_cl.render(scene | {"film": {"resolution": [32, 24], "crop": [0.25, 0.75, 0.25, 0.75]}}, spp=21)
    )
    np.testing.assert_array_equal(part, whole[6:18, 8:24])


def test_plan_of_the_same_world_takes_what_the_last_one_was_made_of():
    scene, parts = load_scene(room_lit_by_detours()), PlanParts()
    first = make_plan(scene, parts=parts)
    turned = make_plan(change_scene(scene, camera={"target": [-0.9, 0.5, -0.5]}), parts=parts)
    assert turned.virtual_lights is first.virtual_lights


def test_what_is_learned_stays_while_the_eye_does(session):
    scene, parts, pool = load_scene(room_lit_by_detours()), PlanParts(), WavefrontPool(session)
    others = {"target": [-0.9, 0.5, -0.5]}, {"eye": [0.1, 0.2, 0.3]}
    plans = [make_plan(change_scene(scene, camera=other), parts=parts) for other in ({}, *others)]
    first, turned, moved = (pool.upload(plan).virtual_lights for plan in plans)
    assert turned is first
    assert moved is not first


def test_glance_learns_with_fewer_paths_and_leaves_the_film_its_bits(session):
    scene, parts = change_scene(load_scene(room_lit_by_detours()), film={"resolution": [16, 16]}), PlanParts()
    plan = make_plan(scene, parts=parts)
    buffers, films, layout = SceneBuffers(session, plan), [], FilmLayout.of(scene.film)
    for is_rough in (True, False):
        wavefront = Wavefront(session, replace(plan, is_rough=is_rough), layout, scene.render, buffers=buffers)
        for wave in wavefront.waves(0, 1):
            wavefront.enqueue(*wave)
        wavefront.finish()
        films.append(wavefront.picture(1))
    rough, full = sorted(paths for _, paths in buffers.virtual_lights.learned)
    assert 8 * rough <= full
    assert not np.array_equal(*films)
    np.testing.assert_array_equal(films[1], np.asarray(rptcam_cl.render(scene, spp=1)))


def test_film_of_a_session_has_the_bits_of_a_render_after_each_change():
    scene = room_lit_by_detours(resolution=(16, 16))
    lamp = next(number for number, each in enumerate(scene["objects"]) if each["material"]["kind"] == "emissive")
    changes = (
        {"camera.target": [-0.9, 0.5, -0.5]}, {f"objects.{lamp}.material.radiance": [5, 40, 60]},
        {"camera.eye": [0.2, 1.1, 0.8]}, {"film.resolution": [16, 8], "render.seed": 7},
    )  # fmt: skip
    with rptcam_cl.RenderSession(load_scene(scene)) as session:
        session.take(2)
        for number, change in enumerate(changes):
            session.change(change)
            if number % 2:
                session.glance(0.5)
            session.take(2)
            render = rptcam_cl.render(session.scene, spp=session.spp)
            np.testing.assert_array_equal(session.pixels(), np.asarray(render), str(change))


def test_directions_come_back_from_their_two_numbers():
    vectors = np.random.default_rng(3).normal(size=(1000, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    x, y, z = (vectors / np.abs(vectors).sum(axis=1, keepdims=True)).T
    folded = np.copysign(1 - np.abs(y), x), np.copysign(1 - np.abs(x), y)
    x, y = np.where(z < 0, folded[0], x), np.where(z < 0, folded[1], y)
    words = (x * 32767 + 32768).astype(np.int32) | (y * 32767 + 32768).astype(np.int32) << 16
    np.testing.assert_allclose(from_octahedral(words), vectors, atol=1e-4)
