"""What Blender's cameras, lamps, nodes and meshes become, without Blender: closed forms."""

import json
import math
import os
import re
import shlex
import shutil
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageGrab

import rptcam_cl
from integrations.blender.build import build
from integrations.blender.camera import BlenderCamera, Frame, LensChoice, camera_keys, film_size_mm
from integrations.blender.fields import Field, Mapping, _looked_up, combine, constant, hue_saturation, mix_colours
from integrations.blender.lights import BlenderLamp, lamp_keys
from integrations.blender.live import LiveScene, differences, is_same
from integrations.blender.materials import BlenderMaterial, metal_of, translate
from integrations.blender.meshes import BlenderMesh, movement, part
from integrations.blender.nodes import Link, Node, linear
from integrations.blender.report import Report
from integrations.blender.scene import Builder, Parts, Placed, Shutter, safe
from integrations.blender.world import environment
from rptcam_cl.core.errors import DeviceError, InputError

EYE = np.eye(4)


def surface_of(node):
    report = Report()
    return translate(BlenderMaterial("m", node), report).keys, report.sentences


def principled(**inputs):
    defaults = {
        "Base Color": (0.8, 0.8, 0.8), "Metallic": 0.0, "Roughness": 0.5, "IOR": 1.5, "Alpha": 1.0,
        "Specular IOR Level": 0.5, "Specular Tint": (1.0, 1.0, 1.0),
    }  # fmt: skip
    return Node("BSDF_PRINCIPLED", "p", defaults | {key.replace("_", " "): value for key, value in inputs.items()})


def picture(codes, **values):
    return Node("TEX_IMAGE", "picture", {}, {"codes": codes, "color_space": "srgb", **values})


@pytest.mark.parametrize(
    ("fit", "size", "expected", "side"),
    [
        ("AUTO", (200, 100), (36, 18), 36),
        ("AUTO", (100, 200), (18, 36), 36),
        ("HORIZONTAL", (100, 200), (36, 72), 36),
        ("VERTICAL", (200, 100), (48, 24), 24),
    ],
)
def test_sensor_fit_spans_the_side_that_blender_names(fit, size, expected, side):
    film, span = film_size_mm(BlenderCamera(EYE, sensor_fit=fit), Frame(size))
    assert film == pytest.approx(expected) and span == side


def test_pixels_that_are_not_square_change_the_film():
    film, _ = film_size_mm(BlenderCamera(EYE), Frame((200, 200), (2.0, 1.0)))
    assert film == pytest.approx((36, 18))


def test_depth_of_field_is_a_thin_lens_of_the_same_opening():
    report = Report()
    camera = BlenderCamera(EYE, lens_mm=80, f_stop=2.0, focus_distance=3.0, shift=(0.1, -0.2))
    keys = camera_keys(camera, Frame((300, 200)), LensChoice(), 1.0, report)["camera"]
    assert keys["kind"] == "thin_lens" and keys["aperture_radius_m"] == pytest.approx(0.02)
    assert keys["movements"] == pytest.approx({"shift_mm": 3.6, "rise_mm": -7.2})
    assert not report


def test_lens_that_matches_the_field_has_a_larger_film():
    choice = LensChoice("dgauss-100mm", 4.0, True, 100.0)
    made = camera_keys(BlenderCamera(EYE, lens_mm=50), Frame((300, 200)), choice, 1.0, Report())
    assert made["film"]["size_mm"] == pytest.approx([72, 48])
    assert made["camera"]["stands_at"] == "entrance_pupil"
    assert rptcam_cl.load_scene(made | {"environment": {"kind": "constant", "radiance": 1}}).camera.kind == "realistic"


def test_border_is_rounded_to_pixels_and_counts_from_the_top():
    made = camera_keys(BlenderCamera(EYE), Frame((100, 50), border=(0.255, 0.5, 0.1, 0.9)), LensChoice(), 1.0, Report())
    assert made["film"]["crop"] == pytest.approx([0.25, 0.5, 0.1, 0.9])


def test_orthographic_camera_shows_as_much_as_in_blender_and_is_moved_by_the_shift():
    report = Report()
    own = BlenderCamera(EYE, kind="ORTHO", ortho_scale=4, shift=(0.25, -0.5), clip_start=0.1)
    made = camera_keys(own, Frame((200, 100)), LensChoice(), 0.5, report)
    keys = made["camera"]
    assert (keys["kind"], keys["width_m"], keys["near_m"]) == ("orthographic", 2.0, 0.05)
    assert keys["eye"] == pytest.approx(EYE[:3, 3] + [1, -2, 0]) and not report.sentences
    upright = camera_keys(own, Frame((100, 200)), LensChoice(), 1.0, report)
    assert upright["camera"]["width_m"] == 2.0  # the longer side shows the scale
    assert rptcam_cl.load_scene(made).camera.kind == "orthographic"


@pytest.mark.parametrize(("fit", "size", "expected"), [
    ("AUTO", (200, 100), 4.0), ("VERTICAL", (200, 100), 8.0),
    ("HORIZONTAL", (100, 200), 4.0), ("AUTO", (100, 200), 2.0),
])  # fmt: skip
def test_orthographic_scale_spans_the_side_of_the_sensor_fit(fit, size, expected):
    camera = BlenderCamera(EYE, kind="ORTHO", ortho_scale=4.0, sensor_fit=fit)
    made = camera_keys(camera, Frame(size), LensChoice(), 1.0, Report())["camera"]
    assert made["width_m"] == pytest.approx(expected)


def test_panoramas_that_are_not_rendered_are_refused():
    with pytest.raises(InputError, match="Fisheye Equidistant is not rendered"):
        camera_keys(
            BlenderCamera(EYE, kind="PANO", panorama="FISHEYE_EQUIDISTANT"),
            Frame((64, 64)),
            LensChoice(),
            1.0,
            Report(),
        )
    report = Report()
    made = camera_keys(BlenderCamera(EYE, kind="PANO"), Frame((64, 64)), LensChoice("fisheye"), 1.0, report)
    assert made["camera"]["kind"] == "realistic" and "a panorama in Blender" in report.sentences[0]


def test_names_that_differ_by_a_dot_stay_two():
    assert len({safe(name) for name in ("Wood.001", "Wood_001", "Wood[001", "x" * 200 + "a", "x" * 200 + "b")}) == 5
    assert safe("Wood") == "m Wood"


def test_lamps_have_the_power_that_blender_gives_them():
    power = (100.0, 50.0, 25.0)
    section, point = lamp_keys(BlenderLamp("p", "POINT", EYE, power), Report())
    assert section == "lights" and np.multiply(point["intensity"], 4 * math.pi) == pytest.approx(power)
    _, ball = lamp_keys(BlenderLamp("b", "POINT", EYE, power, radius=0.5), Report())
    emitted = np.multiply(ball["material"]["radiance"], math.pi * 4 * math.pi * 0.25)
    assert emitted == pytest.approx(power) and ball["visible"]["shadow"] is False
    _, area = lamp_keys(BlenderLamp("a", "AREA", EYE, power, shape="RECTANGLE", size=(2.0, 3.0)), Report())
    assert np.multiply(area["material"]["radiance"], math.pi * 6) == pytest.approx(power)
    normal = np.cross(area["edge_u"], area["edge_v"])
    assert normal == pytest.approx([0, 0, -6])  # shines along −z
    _, disk = lamp_keys(BlenderLamp("d", "AREA", EYE, power, shape="ELLIPSE", size=(2.0, 3.0)), Report())
    assert np.multiply(disk["material"]["radiance"], math.pi * math.pi * 1.5) == pytest.approx(power)


@pytest.mark.parametrize(
    ("kind", "sizes", "factor"),
    [
        ("POINT", {"radius": 0.5}, math.pi), ("POINT", {}, 4), ("SPOT", {}, 4), ("SPOT", {"radius": 0.5}, math.pi),
        ("SUN", {"angle": 0.2}, math.pi * math.tan(0.1) ** 2), ("SUN", {}, 1), ("AREA", {"size": (2.0, 3.0)}, 4),
        ("AREA", {"size": (2.0, 3.0), "shape": "RECTANGLE"}, 6),
    ],
)  # fmt: skip
def test_lamps_that_go_by_their_size_give_as_much_more(kind, sizes, factor):
    """A ball has its surface, a sun its area at distance 1, an area lamp its own; without a size it is 4 (Cycles)."""
    lamp = BlenderLamp("l", kind, EYE, (100.0, 50.0, 25.0), **sizes)
    (_, one), (_, other) = (lamp_keys(each, Report()) for each in (lamp, replace(lamp, normalized=False)))
    key = "irradiance" if kind == "SUN" else "intensity"
    lights = [each["material"]["radiance"] if "material" in each else each[key] for each in (one, other)]
    assert np.divide(*lights[::-1]) == pytest.approx(factor)


def test_lamps_are_as_bright_in_any_unit_and_shine_down_when_mirrored():
    """A lamp without size a hundredth as far away has a ten thousandth of the intensity."""
    _, point = lamp_keys(BlenderLamp("p", "POINT", EYE, (40.0,) * 3), Report(), 0.01)
    assert point["intensity"] == pytest.approx([1e-4 * 10 / math.pi] * 3)
    mirrored = np.diag([-1.0, 2.0, 1.0, 1.0])
    _, square = lamp_keys(BlenderLamp("a", "AREA", mirrored, (1.0,) * 3), Report())
    assert np.cross(square["edge_u"], square["edge_v"]) == pytest.approx([0, 0, -2])
    _, disk = lamp_keys(BlenderLamp("d", "AREA", mirrored, (1.0,) * 3, shape="DISK"), Report())
    matrix = np.array(disk["transform"]["matrix"])
    assert np.linalg.det(matrix[:, :3]) > 0 and matrix[:, 2] == pytest.approx([0, 0, 1])


def test_spot_fades_over_its_blend_of_the_cosine():
    report = Report()
    lamp = BlenderLamp("s", "SPOT", EYE, (1.0, 1.0, 1.0), spot_size=math.radians(60), spot_blend=0.5, radius=0.2)
    _, spot = lamp_keys(lamp, report)
    outer, inner = (math.cos(math.radians(spot[f"{end}_degrees"])) for end in ("outer", "inner"))
    assert inner == pytest.approx(outer + (1 - outer) / 2) and "radius" in report.sentences[0]


def test_what_a_lamp_has_not_is_reported():
    report = Report()
    lamp_keys(BlenderLamp("a", "AREA", EYE, (1, 1, 1), spread=1.0), report)
    assert lamp_keys(BlenderLamp("n", "POINT", EYE, (-1, 0, 1)), report) is None
    assert len(report.sentences) == 2


def test_a_lamp_that_lights_nothing_is_left_out_and_one_that_lights_a_part_is_named():
    """Cycles lights no surface of a kind whose rays do not meet the lamp."""
    report, lamp = Report(), BlenderLamp("l", "AREA", EYE, (1, 1, 1))
    assert lamp_keys(replace(lamp, hidden_from=("diffuse", "glossy", "transmission")), report) is None
    assert lamp_keys(replace(lamp, hidden_from=("diffuse",)), report) is not None
    assert lamp_keys(replace(lamp, hidden_from=("glossy",)), report) is not None
    assert report.sentences == [
        "Lamp l: hidden from all that it would light, left out.",
        "Lamp l: it lights matte surfaces, too, from which Blender hides it.",
    ]


def test_a_sheared_lamp_is_named():
    sheared = np.eye(4)
    sheared[0, 2] = 0.3
    report = Report()
    lamp_keys(BlenderLamp("l", "AREA", sheared, (1, 1, 1)), report)
    assert report.sentences == ["Lamp l: sheared by its parent; it shines at right angles to its surface here."]


def test_a_stretched_spot_fades_where_its_stretched_cone_does():
    lamp = BlenderLamp("s", "SPOT", EYE, (1.0, 1.0, 1.0), spot_size=math.radians(60), spot_blend=0.5)
    _, plain = lamp_keys(lamp, Report())
    _, wide = lamp_keys(replace(lamp, matrix=np.diag([2.0, 2.0, 1.0, 1.0])), Report())
    for end in ("outer_degrees", "inner_degrees"):
        plain_tangent, wide_tangent = (math.tan(math.radians(spot[end])) for spot in (plain, wide))
        assert wide_tangent == pytest.approx(2 * plain_tangent, rel=1e-5), end


def test_an_object_that_shines_unseen_by_others_is_named():
    report, parts = Report(), Parts()
    parts.put("a", quad())
    builder = Builder(parts, 1.0, report, Shutter(0.02))
    builder.add_material(BlenderMaterial("m", Node("EMISSION", "e", {"Color": (1.0, 1.0, 1.0), "Strength": 2.0})))
    builder.place(Placed("sign", "a", EYE, ("m",), {"reflection": False}))
    assert "Object sign: its light falls on all others, where Blender hides it from them." in report.sentences


def test_principled_material_is_a_principled_one():
    keys, said = surface_of(principled(Base_Color=(0.5, 0.25, 0.125), Metallic=1.0, Roughness=0.25))
    assert keys["kind"] == "principled" and keys["base_color"] == pytest.approx([0.5, 0.25, 0.125])
    assert (keys["metallic"], keys["roughness"], keys["index"]) == (1.0, 0.25, 1.5) and not said


def test_a_principled_surface_beside_a_light_keeps_its_share_and_its_own_light():
    """Of light and of what is reflected each surface gives its share, and its holes are closed by that of the light."""
    own = principled(Emission_Color=(1.0, 0.5, 0.25), Emission_Strength=2.0, Coat_Weight=0.8, Alpha=0.5)
    lamp = Node("EMISSION", "e", {"Color": (1.0, 1.0, 1.0), "Strength": 4.0})
    mix = Node("MIX_SHADER", "m", {"Fac": 0.25, "Shader": Link(own, "BSDF"), "Shader_001": Link(lamp, "Emission")})
    keys, _ = surface_of(mix)
    opacity = 0.75 * 0.5 + 0.25
    left = 0.75 * 0.5 / opacity
    assert keys["opacity"] == pytest.approx(opacity)
    assert keys["base_color"] == pytest.approx([0.8 * left] * 3)
    assert (keys["specular"], keys["clearcoat"]) == (pytest.approx(left), pytest.approx(0.8 * left))
    assert np.multiply(keys["emission"], opacity) == pytest.approx(
        [0.25 * 4 + 0.75 * 0.5 * 2 * channel for channel in (1.0, 0.5, 0.25)]
    )
    both = Node("ADD_SHADER", "a", {"Shader": Link(own, "BSDF"), "Shader_001": Link(lamp, "Emission")})
    assert surface_of(both)[0]["emission"] == pytest.approx([6.0, 5.0, 4.5])
    paint = Node("BSDF_DIFFUSE", "d", {"Color": (0.5, 0.5, 0.5), "Roughness": 0.0})
    ends = {"Shader": Link(paint, "BSDF"), "Shader_001": Link(lamp, "Emission")}
    beside, over = Node("MIX_SHADER", "m", {"Fac": 0.25, **ends}), Node("ADD_SHADER", "a", ends)
    for node in (own, mix, both, beside, over):  # as in Cycles
        made, said = surface_of(node)
        assert made["two_sided"] is True and not any("front" in sentence for sentence in said), node.kind


def test_glass_beside_a_light_is_left_out_with_a_word():
    glass = principled(Transmission_Weight=1.0, Roughness=0.0)
    lamp = Node("EMISSION", "e", {"Color": (1.0, 1.0, 1.0), "Strength": 4.0})
    mix = Node("MIX_SHADER", "m", {"Fac": 0.25, "Shader": Link(glass, "BSDF"), "Shader_001": Link(lamp, "Emission")})
    keys, said = surface_of(mix)
    assert keys["kind"] == "emissive" and any("is mixed with is left out" in sentence for sentence in said)


def test_specular_level_changes_the_index_by_its_reflectance():
    keys, _ = surface_of(principled(Specular_IOR_Level=1.0))
    assert ((keys["index"] - 1) / (keys["index"] + 1)) ** 2 == pytest.approx(0.08)


def test_white_glass_is_a_dielectric_and_tinted_takes_the_root_at_each_passage():
    clear, _ = surface_of(principled(Base_Color=(1.0, 1.0, 1.0), Transmission_Weight=1.0, Roughness=0.0))
    assert clear == {"kind": "dielectric", "index": 1.5}
    tinted, said = surface_of(principled(Base_Color=(0.25, 0.81, 1.0), Transmission_Weight=1.0, Roughness=0.2))
    assert tinted["base_color"] == pytest.approx([0.5, 0.9, 1.0]) and not said
    smooth, said = surface_of(principled(Base_Color=(0.25, 0.81, 1.0), Transmission_Weight=1.0, Roughness=0.0))
    assert smooth["kind"] == "dielectric" and smooth["transmittance"] == pytest.approx([0.5, 0.9, 1.0]) and not said
    coated, said = surface_of(
        principled(Base_Color=(1.0, 1.0, 1.0), Transmission_Weight=1.0, Roughness=0.0, Coat_Weight=1.0, Coat_IOR=1.5)
    )
    assert coated["kind"] == "principled" and coated["clearcoat"] == 1.0 and "more than glass" in said[0]


def test_tinted_slab_has_the_light_of_the_series_of_its_passages():
    """Glass BSDF: each meeting with a face takes the whole colour, what is reflected too; in an even world of 1."""
    colour, f = np.array([0.8, 0.5, 0.2]), 0.04
    keys, said = surface_of(Node("BSDF_GLASS", "g", {"Color": tuple(colour), "Roughness": 0.0, "IOR": 1.5}))
    slab = {"shape": "box", "min": [-20, -20, 0], "max": [20, 20, 1], "material": keys}
    camera = {"kind": "pinhole", "eye": [0, 0, 9], "target": [0, 0, 0], "fov_degrees": 2}
    scene = {"camera": camera, "film": {"resolution": [8, 8]}, "objects": [slab]}
    scene |= {"environment": {"kind": "constant", "radiance": 1}, "render": {"spp": 256, "max_depth": 16}}
    shown = np.asarray(rptcam_cl.render(scene)).mean((0, 1))
    assert shown == pytest.approx(f * colour + (1 - f) ** 2 * colour**2 / (1 - f * colour), rel=0.005) and not said


def test_layers_without_an_equal_are_reported():
    node = principled(Subsurface_Weight=1.0, Coat_Tint=(1.0, 0.5, 0.5), Coat_Weight=1.0, Coat_IOR=1.8, Later=0.5)
    _, said = surface_of(node)
    assert [each.removeprefix("Material m: ") for each in said] == [
        "Later is left out.", "its coat has the index 1.5.", "its coat is clear, without a tint.",
        "subsurface scattering is left out: its base scatters at the surface.",
    ]  # fmt: skip


def test_thin_film_lies_on_what_reflects_by_numbers():
    film = {"Thin_Film_Thickness": 300.0, "Thin_Film_IOR": 1.4}
    keys, said = surface_of(principled(**film))
    assert keys["thin_film"] == pytest.approx({"thickness_nm": 300.0, "index": 1.4}) and not said
    keys, said = surface_of(principled(**film, Transmission_Weight=0.5))
    assert "thin_film" not in keys and "thin film is left out" in said[-1]


@pytest.mark.parametrize("edge", [1.0, 0.8, 0.6])
@pytest.mark.parametrize("facing", [0.5, 0.9])
def test_metal_has_the_colour_and_the_rim_that_its_node_says(facing, edge):
    """By Fresnel's equations, straight on and where the cosine is 1/7; a rim darker than a metal's is its darkest."""
    n, k = (each[0] for each in metal_of(np.full(3, facing), np.full(3, edge)))
    bend = n + 1j * k
    straight = abs((1 - bend) / (1 + bend)) ** 2
    inside = np.sqrt(1 - (1 - 1 / 49) / bend**2)
    across, along = (1 / 7 - bend * inside) / (1 / 7 + bend * inside), (bend / 7 - inside) / (bend / 7 + inside)
    rim = (abs(across) ** 2 + abs(along) ** 2) / 2
    schlick = facing + (1 - facing) * (6 / 7) ** 5
    assert straight == pytest.approx(facing, rel=1e-9)
    assert rim == pytest.approx(max(edge * schlick, {0.5: 0.6237595 * schlick, 0.9: 0.7711884 * schlick}[facing]))


def test_transparent_shader_makes_holes():
    clear = Node("BSDF_TRANSPARENT", "t", {"Color": (1.0, 1.0, 1.0)})
    red = Node("BSDF_DIFFUSE", "d", {"Color": (0.8, 0.1, 0.1)})
    links = {"Shader": Link(clear, "BSDF"), "Shader_001": Link(red, "BSDF")}
    keys, said = surface_of(Node("MIX_SHADER", "m", {"Fac": 0.25, **links}))
    assert keys["kind"] == "matte" and keys["opacity"] == pytest.approx(0.25) and not said


@pytest.mark.parametrize("kind", ["BSDF_PRINCIPLED", "BSDF_DIFFUSE", "BSDF_GLASS", "BSDF_GLOSSY"])
def test_colours_above_1_are_cut_and_reported(kind):
    codes = np.full((2, 2, 3), 0.5, np.float32)
    codes[0] = (0.5, 3.5, 1.0)
    for colour, reported in ((Link(picture(codes), "Color"), True), ((1.0, 2.0, 0.5), True), ((1.0, 1.0, 1.0), False)):
        node = principled(Base_Color=colour)
        if kind != "BSDF_PRINCIPLED":
            node = Node(kind, "s", {"Color": colour, "Roughness": 0.0, "IOR": 1.5})
        _, sentences = surface_of(node)
        assert any("colours of up to " in sentence and "are cut to 1" in sentence for sentence in sentences) == reported


def test_emission_shines_from_both_sides():
    keys, _ = surface_of(Node("EMISSION", "e", {"Color": (1.0, 0.5, 0.25), "Strength": 4.0}))
    assert keys == {"kind": "emissive", "radiance": [4.0, 2.0, 1.0], "two_sided": True}


def test_shader_without_an_equal_is_reported_and_grey():
    keys, said = surface_of(Node("BSDF_HAIR", "hair"))
    assert keys["kind"] == "matte" and "hair" in said[0]


def test_picture_is_handed_on_as_it_is_stored():
    codes = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    keys, _ = surface_of(principled(Base_Color=Link(picture(codes), "Color")))
    assert np.array_equal(keys["base_color"]["file"], codes) and keys["base_color"]["color_space"] == "srgb"


def test_picture_behind_nodes_is_calculated_texel_by_texel():
    codes = np.full((2, 2, 3), 188, np.uint8)
    codes[0, 0] = 0
    invert = Node("INVERT", "i", {"Fac": 1.0, "Color": Link(picture(codes), "Color")})
    keys, said = surface_of(principled(Base_Color=Link(invert, "Color")))
    expected = 1 - linear(codes, "srgb")
    assert np.allclose(keys["base_color"]["file"], expected, atol=1e-6) and not said


def test_mapping_scales_turns_and_shifts_coordinates():
    codes = np.zeros((2, 2, 3), np.uint8)
    mapping = Node("MAPPING", "m", {
        "Vector": Link(Node("TEX_COORD", "c"), "UV"), "Scale": (2.0, 3.0, 1.0), "Rotation": (0.0, 0.0, math.pi / 2),
        "Location": (0.25, 0.0, 0.0),
    }, {"vector_type": "POINT"})  # fmt: skip
    node = picture(codes)
    node.inputs["Vector"] = Link(mapping, "Vector")
    keys, said = surface_of(principled(Base_Color=Link(node, "Color")))
    texture = keys["base_color"]
    assert texture["scale"] == [2.0, 3.0] and texture["rotation_degrees"] == pytest.approx(90) and not said
    u, v = Mapping((2.0, 3.0), math.pi / 2, (0.25, 0.0)).at(np.float32(0.1), np.float32(0.2))
    assert (u, v) == pytest.approx((0.25 - 0.6, 0.2), abs=1e-6)


def test_unknown_nodes_are_reported():
    _, said = surface_of(principled(Base_Color=Link(Node("TEX_VORONOI", "cells"), "Color")))
    assert "cells" in said[0]


def test_every_translated_material_is_a_valid_one():
    codes = np.full((4, 4, 4), 128, np.uint8)
    bump = Node("BUMP", "b", {"Height": Link(picture(codes), "Color"), "Strength": 1.0, "Distance": 0.1})
    nodes = [
        principled(Normal=Link(bump, "Normal"), Alpha=Link(picture(codes), "Alpha"), Coat_Weight=0.5, Sheen_Weight=0.2),
        Node("BSDF_GLOSSY", "g", {"Color": (0.9, 0.9, 0.9), "Roughness": 0.3}, {"distribution": "GGX"}),
        Node("BSDF_GLOSSY", "g", {"Color": (0.9, 0.9, 0.9), "Roughness": 0.0}),
        Node("BSDF_GLASS", "g", {"Color": (0.9, 0.5, 0.9), "Roughness": 0.0, "IOR": 1.45}),
        Node("BSDF_TRANSPARENT", "t", {"Color": (0.5, 0.5, 0.5)}),
        Node("BSDF_SHEEN", "s", {"Color": (0.5, 0.5, 0.5), "Roughness": 0.5}),
        Node("ADD_SHADER", "a", {
            "Shader": Link(Node("EMISSION", "e", {"Color": (1.0, 1.0, 1.0), "Strength": 2.0}), "Emission"),
            "Shader_001": Link(principled(), "BSDF"),
        }),
    ]  # fmt: skip
    materials = {f"m{i}": surface_of(node)[0] for i, node in enumerate(nodes)}
    mesh = {"vertices": np.eye(3), "faces": np.array([[0, 1, 2]]), "uvs": np.zeros((3, 2))}
    scene = {
        "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40},
        "materials": materials, "meshes": {"t": mesh},
        "objects": [{"shape": "mesh", "mesh": "t", "material": name} for name in materials],
    }  # fmt: skip
    assert len(rptcam_cl.load_scene(scene).objects) == len(nodes)


def test_fields_of_other_sizes_meet_over_the_unit_square():
    ramp = np.repeat(np.linspace(0, 1, 64, dtype=np.float32)[None, :, None], 4, axis=0)
    first, second = Field(ramp, Mapping((1.0, 1.0))), Field(np.ones((2, 2, 1), np.float32), Mapping((2.0, 2.0)))
    made = combine(lambda a, b: a * b, first, second)
    assert made.values.shape == (1024, 1024, 1) and made.values.mean() == pytest.approx(0.5, abs=2e-3)
    assert combine(lambda a: 2 * a, constant(0.25)).number == pytest.approx(0.5)


def test_colour_nodes_calculate_as_blender_documents():
    red = np.array([1.0, 0.0, 0.0], np.float32)
    assert hue_saturation(red, 1 / 3, 1.0, 1.0) == pytest.approx([0, 1, 0], abs=1e-6)
    half = np.array([0.5], np.float32)
    mixed = mix_colours("MULTIPLY", half, np.array([0.8, 0.8, 0.8], np.float32), red)
    assert mixed == pytest.approx([0.8, 0.4, 0.4])


def quad():
    points = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], np.float32)
    uvs = points[:, :2] / 4
    loops = np.arange(4, dtype=np.int32)
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    normals = np.tile(np.array([0, 0, 1], np.float32), (4, 1))
    return BlenderMesh(points, loops, triangles, np.array([0, 1], np.int32), normals, {"UVMap": uvs})


def test_mesh_is_parted_by_material_and_keeps_its_corners():
    one, other = part(quad(), 0, "uv"), part(quad(), 1, "uv")
    assert one is not None and other is not None and part(quad(), 2, "uv") is None
    assert one["faces"].tolist() == [[0, 1, 2]] and len(other["vertices"]) == 3
    assert np.array_equal(one["vertices"][one["faces"][0]], quad().points[[0, 1, 2]])
    assert np.array_equal(other["uvs"][other["faces"][0]], quad().uvs["UVMap"][[0, 2, 3]])
    assert quad().uv_size == pytest.approx(4)


def test_motion_is_a_turn_about_the_origin_after_the_placing():
    start, end = np.eye(4), np.eye(4)
    start[:3, 3] = [1, 2, 3]
    angle = 0.3
    end[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    end[:3, 3] = [2, 2, 3]
    frames, whole = movement(start, end, (0.0, 0.5))
    turn = np.vstack([frames[1]["matrix"], [0, 0, 0, 1]])
    assert whole and np.allclose(turn @ start, end) and frames[1]["time_s"] == 0.5
    grown = np.diag([2.0, 2.0, 2.0, 1.0])
    assert movement(np.eye(4), grown, (0.0, 1.0))[1] is False


def test_differences_of_exports_are_the_least_changes():
    one = {"camera": {"eye": [0, 0, 1]}, "objects": [{"a": 1}, {"b": np.zeros(3)}], "materials": {"m": {"k": 1}}}
    other = {"camera": {"eye": [0, 0, 2]}, "objects": [{"a": 1}, {"b": np.ones(3)}], "materials": {"m": {"k": 1}}}
    assert list(differences(one, other)) == ["camera", "objects.1"]
    assert differences(one, one | {"lights": []}) == {"lights": []}
    assert differences(
        one, {"camera": one["camera"], "objects": one["objects"][:1], "materials": one["materials"]}
    ) == {"objects": one["objects"][:1]}
    assert is_same({"x": [np.zeros(2)]}, {"x": [np.zeros(2)]}) and not is_same([1], [1, 2])


def test_world_of_a_picture_is_turned_and_mixed_worlds_are_reported():
    report = Report()
    codes = np.ones((4, 8, 3), np.float32)
    node = Node("TEX_ENVIRONMENT", "sky", {}, {"codes": codes, "color_space": "linear"})
    made = environment(Node("BACKGROUND", "b", {"Color": Link(node, "Color"), "Strength": 2.0}), (0, 0, 0), report)
    assert made is not None and made["rotation_degrees"] == -90 and made["gain"] == 2 and not report
    backgrounds = [Node("BACKGROUND", "b", {"Color": (c, c, c), "Strength": 1.0}) for c in (0.25, 0.5)]
    links = {name: Link(each, "") for name, each in zip(("Shader", "Shader_001"), backgrounds, strict=True)}
    mixed = environment(Node("MIX_SHADER", "m", {"Fac": 0.5, **links}), (0, 0, 0), report)
    assert mixed == {"kind": "constant", "radiance": [0.25] * 3} and len(report.sentences) == 1
    assert environment(None, (0, 0, 0), report) is None


def test_builder_makes_one_object_for_each_material():
    parts, report = Parts(), Report()
    parts.put("data quad", quad())
    builder = Builder(parts, 0.01, report, Shutter(0.02))
    for name in ("one.001", "two"):
        builder.add_material(BlenderMaterial(name, None), 3)
    builder.place(Placed("Quad", "data quad", EYE, ("one.001", "two"), {"camera": False}, 7))
    builder.place(Placed("Flat", "data quad", np.diag([1.0, 1.0, 0.0, 1.0]), ("two",)))
    export = builder.export(BlenderCamera(EYE), Frame((30, 20)), LensChoice(), None, {})
    scene = rptcam_cl.load_scene(export.keys)
    assert len(scene.objects) == 2 and export.object_indices.tolist() == [7, 7]
    assert export.material_indices.tolist() == [3, 3] and scene.objects[0].visible.camera is False
    assert report.sentences == ["Object Flat: flat by its scale, left out."]


def test_colours_of_vertices_are_a_picture_of_each_mesh():
    """Pure red, green and blue at the corners: the texels are the linear mix over the triangle, in exact numbers."""
    pure = np.eye(3, dtype=np.float32)[[0, 1, 2, 0]]
    parts, report = Parts(), Report()
    parts.put("data quad", replace(quad(), slot=np.zeros(2, np.int32), colors={"Col": pure}))
    parts.put("data bare", quad())
    builder = Builder(parts, 1.0, report, Shutter(0.02))
    color = Node("VERTEX_COLOR", "c", {}, {"layer_name": "Col"})
    builder.add_material(BlenderMaterial("m", Node("BSDF_DIFFUSE", "d", {"Color": Link(color, "Color")})), 3)
    for mesh in ("data quad", "data bare"):
        builder.place(Placed(mesh, mesh, EYE, ("m",)))
    keys = builder.export(BlenderCamera(EYE), Frame((30, 20)), LensChoice(), None, {}).keys
    rptcam_cl.load_scene(keys)
    assert len(keys["materials"]) == 3 and len(report.sentences) == 1  # of the mesh without colours
    item = keys["objects"][0]
    mesh, texture = keys["meshes"][item["mesh"]], keys["materials"][item["material"]]["reflectance"]
    field = Field(texture["file"], wrap="clamp")
    faces = mesh["faces"]
    for share in (np.array([1, 1, 1]) / 3, np.array([0.5, 0.25, 0.25]), np.array([0.01, 0.01, 0.98])):
        points, uvs = (np.einsum("c,fcx->fx", share, mesh[key][faces]) for key in ("vertices", "uvs"))
        shown = _looked_up(field.values, uvs[:, 0], uvs[:, 1], "clamp")
        for point, got in zip(points, shown, strict=True):
            x, y = point[0] / 2, point[1] / 2  # corners (0, 0), (1, 0), (1, 1), (0, 1): red, green, blue, red
            expected = [1 - x, x - y, y] if y <= x else [1 - x, 0, x]
            assert got == pytest.approx(expected, abs=2e-6)


def test_colours_of_vertices_beside_a_texture_are_their_mean():
    parts, report = Parts(), Report()
    colors = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0]], np.float32)
    parts.put("data quad", replace(quad(), slot=np.zeros(2, np.int32), colors={"Col": colors}))
    builder = Builder(parts, 1.0, report, Shutter(0.02))
    color = Node("ATTRIBUTE", "c", {}, {"attribute_name": "Col"})
    image = picture(np.full((2, 2, 3), 255, np.uint8))
    inputs = {"Base Color": Link(color, "Color"), "Roughness": Link(image, "Color")}
    builder.add_material(BlenderMaterial("m", principled(**inputs)))
    builder.place(Placed("q", "data quad", EYE, ("m",)))
    made = next(
        iter(builder.export(BlenderCamera(EYE), Frame((30, 20)), LensChoice(), None, {}).keys["materials"].values())
    )
    assert made["base_color"] == pytest.approx([(0 + 1 + 1 + 0 + 1 + 1) / 6, 0, 0])
    assert any("mean" in each for each in report.sentences) and any(
        "cut at 0 and 1" in each for each in report.sentences
    )


def test_refraction_and_gloss_mixed_by_fresnel_are_glass():
    """With one index and one roughness; any other mix of them is one of two materials."""

    def mixed(index=1.45, roughness=0.2):
        clear = Node("BSDF_REFRACTION", "r", {"Color": (0.9, 1.0, 0.9), "IOR": 1.45, "Roughness": 0.2})
        glossy = Node("BSDF_GLOSSY", "g", {"Color": (1.0, 0.5, 0.5), "Roughness": roughness})
        ends = {"Shader": Link(clear, "BSDF"), "Shader_001": Link(glossy, "BSDF")}
        return surface_of(Node("MIX_SHADER", "m", ends | {"Fac": Link(Node("FRESNEL", "f", {"IOR": index}), "Fac")}))

    keys, said = mixed()
    assert keys == {
        "kind": "dielectric", "index": pytest.approx(1.45), "roughness": pytest.approx(0.2),
        "transmittance": pytest.approx([0.9, 1, 0.9]), "reflectance": pytest.approx([1, 0.5, 0.5]),
    } and not said  # fmt: skip
    for other, said in (mixed(index=1.3), mixed(roughness=0.4)):
        assert other["kind"] == "mix" and any("Fresnel" in each or "f:" in each for each in said)


def test_mix_within_a_mix_has_the_shares_of_all():
    def matte(*color):
        return Node("BSDF_DIFFUSE", "d", {"Color": color})

    def mixed(first, second, factor):
        ends = {"Shader": Link(first, "BSDF"), "Shader_001": Link(second, "BSDF")}
        return Node("MIX_SHADER", "m", ends | {"Fac": factor})

    gloss, red, green, blue = Node("BSDF_GLOSSY", "g", {}), matte(1, 0, 0), matte(0, 1, 0), matte(0, 0, 1)
    keys, said = surface_of(mixed(mixed(red, green, 0.25), gloss, 0.2))  # 0.6 red, 0.2 green, 0.2 gloss
    assert keys["factor"] == pytest.approx(0.2) and not said
    assert keys["materials"][0] == {"kind": "matte", "reflectance": pytest.approx([0.75, 0.25, 0])}
    assert keys["materials"][1]["kind"] == "mirror"
    keys, said = surface_of(mixed(mixed(red, gloss, 0.5), mixed(green, blue, 0.75), 0.4))  # 0.3, 0.3, 0.1, 0.3
    assert keys["factor"] == pytest.approx(0.3) and not said
    assert keys["materials"][0] == {"kind": "matte", "reflectance": pytest.approx([3 / 7, 1 / 7, 3 / 7])}
    clear = Node("BSDF_TRANSLUCENT", "t", {"Color": (1, 1, 1)})
    keys, said = surface_of(mixed(mixed(gloss, clear, 0.1), red, 0.5))  # 0.45, 0.05, 0.5
    assert [each["kind"] for each in keys["materials"]] == ["mirror", "matte"]
    assert keys["factor"] == pytest.approx(0.5 / 0.95) and any("smallest share" in each for each in said)
    by = picture(np.array([[[0] * 3, [255] * 3]], np.uint8))
    keys, said = surface_of(mixed(mixed(red, gloss, 0.5), green, Link(by, "Color")))  # green, or half red half gloss
    amount = keys["materials"][0]["reflectance"]["amount"]["file"][..., 0]
    assert amount == pytest.approx(np.array([[0, 1]])) and not said
    assert keys["factor"]["file"][..., 0] == pytest.approx(np.array([[0.5, 0]]))


SMALL = {
    "camera": {"kind": "pinhole", "fov_degrees": 40, "eye": [0, -3, 0], "target": [0, 0, 0], "up": [0, 0, 1]},
    "film": {"resolution": [24, 16]},
    "meshes": {"m": {"vertices": np.array([[-1, 0, -1], [1, 0, -1], [0, 0, 1.0]]), "faces": np.array([[0, 1, 2]])}},
    "objects": [{"shape": "mesh", "mesh": "m", "material": {"kind": "matte", "reflectance": 0.5}}],
    "environment": {"kind": "constant", "radiance": 1.0},
    "render": {"spp": 2},
}


@pytest.mark.slow
def test_process_of_its_own_gives_the_same_bits_and_may_be_killed():
    """Killed while it renders and at rest, and given up: an error, the next render works, nothing is left behind."""
    here, apart = LiveScene(), LiveScene()
    apart.use("", apart=True)
    bright = SMALL | {"environment": {"kind": "constant", "radiance": 2.0}}
    try:
        for keys in (SMALL, bright):
            one, other = here.show(keys), apart.show(keys)
            for each in (one, other):
                each.add(2)
            assert np.array_equal(one.image().pixels, other.image().pixels) and other.spp == 2
            assert other.resolution == (24, 16) and other.is_whole
        assert np.array_equal(apart.render(SMALL, spp=1).pixels, rptcam_cl.render(SMALL, spp=1).pixels)
        with pytest.raises(InputError, match="radiance"):
            apart.show(SMALL | {"environment": {"kind": "constant", "radiance": "much"}})
        begun = time.monotonic()

        def killed():
            if time.monotonic() - begun > 0.4:
                os.kill(other.pid, signal.SIGKILL)
            return False

        with pytest.raises(DeviceError, match="signal 9"):
            other.add(1 << 20, killed)
        assert other._process.returncode == -signal.SIGKILL and not other._to.parent.exists()
        with pytest.raises(DeviceError, match="signal 9"):
            other.pixels()
        other = apart.show(SMALL)
        other.add(1 << 20, lambda: True)
        given_up = other.spp
        other.add(2)  # "stop" is for what ran then; what had begun is done with the rest
        assert given_up < 1 << 20 and given_up < other.spp <= given_up + 2 + other.samples_per_wave
        os.kill(other.pid, signal.SIGKILL)
        time.sleep(0.2)
        of_python = signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # as in Blender, which Python does not set up
        with pytest.raises(DeviceError, match="signal 9"):
            other.pixels()
        other.close()
        signal.signal(signal.SIGPIPE, of_python)
    finally:
        here.close()
        apart.close()


BLENDER = shlex.split(os.environ.get("RPTCAM_BLENDER", "")) or [each for each in [shutil.which("blender")] if each]


def until(condition, process, seconds):
    """Wait for something that a process does."""
    ends = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < ends and process.poll() is None, f"not in {seconds} s, or ended: {process.poll()}"
        time.sleep(0.2)


@pytest.mark.slow
@pytest.mark.skipif(not BLENDER or shutil.which("Xvfb") is None, reason="takes Blender (RPTCAM_BLENDER) and Xvfb")
def test_stranger_installs_the_zip_picks_a_lens_looks_and_presses_f12(tmp_path):
    """In Blender's own window: the viewport shows in the camera's frame what F12 renders, through the same lens."""
    own = {"BLENDER_USER_RESOURCES": str(tmp_path / "user"), "HOME": str(tmp_path), "LIBGL_ALWAYS_SOFTWARE": "1"}
    surroundings = os.environ | own
    said = subprocess.run(
        [*BLENDER, "--background", "--python-expr", "import sys; print('Python', *sys.version_info[:2])"],
        env=surroundings, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    archive = build("linux-x64", ".".join(re.search(r"Python (\d+) (\d+)", said).groups()), tmp_path)
    for words in (["validate"], ["install-file", "-r", "user_default", "-e"]):
        subprocess.run([*BLENDER, "--command", "extension", *words, str(archive)], env=surroundings, check=True)
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, pass_fds=[writing], stderr=subprocess.DEVNULL) as screen:
        try:
            display = f":{os.read(reading, 20).decode().strip()}"
            command = [*BLENDER, "--factory-startup", "--addons", "bl_ext.user_default.rptcam", "-p", "0", "0"]
            command += ["1280", "800", "--python", str(Path(__file__).with_name("window.py")), "--", str(tmp_path)]
            with subprocess.Popen(command, env=surroundings | {"DISPLAY": display}) as window:
                try:
                    shown = tmp_path / "shown.json"
                    until(shown.exists, window, 300)
                    time.sleep(1)
                    screenshot = ImageGrab.grab(xdisplay=display).convert("RGB")
                    screenshot.save(os.environ.get("RPTCAM_SCREENSHOT", tmp_path / "screenshot.png"))
                    left, top, width, height = json.loads(shown.read_text())
                    shown.unlink()
                    assert window.wait(300) == 0
                finally:
                    window.kill()
        finally:
            screen.kill()
    rendered = Image.open(tmp_path / "f12.png").convert("RGB")
    seen = screenshot.crop(tuple(round(each) for each in (left, top, left + width, top + height)))
    films = [np.asarray(each.resize((60, 40), Image.Resampling.BOX), float)[3:-3, 3:-3] for each in (seen, rendered)]
    assert films[1].std() > 20
    assert np.corrcoef(films[0].ravel(), films[1].ravel())[0, 1] > 0.98
    assert films[0].mean() == pytest.approx(films[1].mean(), rel=0.05)
