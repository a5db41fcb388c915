"""Scenes set up as artists set them up, F12 of our engine beside that of Cycles; needs bpy (pip install bpy)."""

import importlib.util
import math
import threading
import time

import numpy as np
import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        importlib.util.find_spec("bpy") is None,
        reason='Blender is not installed in this Python (pip install "bpy==4.2.*", Python 3.11)',
    ),
]


@pytest.fixture
def room():
    """Floor, red cube to the left, green ball to the right, lamp and sky, with the engine enabled: module and scene."""
    import bpy  # noqa: F401  (add-ons are found once it is there)
    import addon_utils  # isort: skip

    import integrations.blender
    from tests.integrations import cycles

    addon_utils.enable("cycles")
    integrations.blender.register()
    scene = cycles.empty_scene()
    cycles.add("plane", matte("floor", 0.5, 0.5, 0.5), size=40)
    cycles.add("cube", matte("red", 0.8, 0.1, 0.1), size=1, location=(-1.2, 0, 0.5))
    cycles.add("uv_sphere", matte("green", 0.1, 0.7, 0.1), radius=0.5, location=(1.1, 0.3, 0.5))
    cycles.add_lamp("AREA", (1, -2, 4), 200, size=1.0, rotation=(0.3, 0.2, 0))
    cycles.world((0.3, 0.4, 0.6), 0.5)
    yield cycles, scene
    integrations.blender.unregister()


def matte(name, *color):
    from tests.integrations import cycles

    return cycles.shader("ShaderNodeBsdfDiffuse", name, Color=(*color, 1))


def films(folder, spp=64):
    """Our picture by F12 and that of Cycles."""
    import bpy

    from rptcam_cl.imaging.image import read_film
    from tests.integrations import cycles

    scene = bpy.context.scene
    other = cycles.of_cycles(folder, spp)
    scene.render.engine, scene.rptcam.samples, scene.rptcam.max_depth = "RPTCAM", spp, 8
    scene.render.filepath = str(folder / "ours.exr")
    bpy.ops.render.render(write_still=True)
    return np.asarray(read_film(folder / "ours.exr").pixels), other


def assert_alike(folder, *, tile=0.1, mean=0.006, spp=64):
    """Means within 0.6 %, and those of 4 x 4 pixels within a tenth of the mean: 64 samples leave 0.04 at corners."""
    one, other = films(folder, spp)
    assert one.shape == other.shape
    assert one.mean((0, 1)) == pytest.approx(other.mean((0, 1)), rel=mean)
    height, width = one.shape[0] // 4 * 4, one.shape[1] // 4 * 4
    gaps = (one - other)[:height, :width].reshape(height // 4, 4, width // 4, 4, 3).mean((1, 3))
    assert np.abs(gaps).max() < tile * other.mean()


def said():
    """What the last render reports."""
    import bpy

    from integrations.blender import engine

    return engine.REPORTS[bpy.context.scene.name]


def test_lamps_without_size_are_as_bright_whatever_a_unit_is(room, tmp_path):
    cycles, scene = room
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 0.01
    cycles.add_lamp("POINT", (-2, -1, 2), 60, shadow_soft_size=0.0)
    cycles.add_lamp("SPOT", (0, -1, 3), 200, shadow_soft_size=0.0)
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, 0.1, 4
    assert_alike(tmp_path, tile=0.25)  # the blurred edge of the cone is noisy


def test_names_that_differ_by_a_dot_are_two_materials_and_meshes(room, tmp_path):
    cycles, _ = room
    one, other = matte("Wood.001", 0.9, 0.1, 0.9), matte("Wood_001", 0.1, 0.9, 0.9)
    cycles.add("cube", one, size=0.6, location=(-0.3, -1, 0.3)).data.name = "Shape.001"
    cycles.add("uv_sphere", other, radius=0.3, location=(0.5, -1, 0.3)).data.name = "Shape_001"
    assert_alike(tmp_path)


def test_linked_library_is_shown_beside_materials_of_the_same_name(room, tmp_path):
    import bpy

    cycles, scene = room
    box = cycles.add("cube", matte("Wood", 0.9, 0.6, 0.1), size=0.8)
    box.name = "Box"
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {box})
    bpy.data.materials.remove(box.active_material)
    bpy.data.objects.remove(box)
    cycles.add("cube", matte("Wood", 0.1, 0.1, 0.9), size=0.6, location=(-0.2, -1, 0.3))
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, linked):
        linked.objects = ["Box"]
    within = bpy.data.collections.new("of the library")
    within.objects.link(linked.objects[0])
    empty = bpy.data.objects.new("place", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", within
    empty.location, empty.rotation_euler, empty.scale = (0.4, 0.2, 1.2), (0, 0, 0.5), (1, -1, 1)
    scene.collection.objects.link(empty)
    assert_alike(tmp_path)
    empty.visible_camera = False  # what it places is not seen either
    assert_alike(tmp_path)


def test_collections_and_layers_hide_what_they_hide_in_cycles(room, tmp_path):
    import bpy

    cycles, scene = room
    layer = scene.view_layers[0]
    for number, how in enumerate(("exclude", "hide_render", "eye", "indirect_only", "holdout")):
        item = cycles.add("cube", matte(how, 0.9, 0.9, 0.1), size=0.4, location=(0.5 * number - 1, -1, 0.2))
        owner = bpy.data.collections.new(how)
        scene.collection.children.link(owner)
        scene.collection.objects.unlink(item)
        owner.objects.link(item)
        in_layer = layer.layer_collection.children[how]
        if how == "hide_render":
            owner.hide_render = True
        elif how == "eye":
            in_layer.hide_viewport = True  # in viewports alone
        elif how != "holdout":
            setattr(in_layer, how, True)
    assert_alike(tmp_path)
    assert not said()
    layer.use_sky = False
    assert_alike(tmp_path, spp=256)  # of a darker picture 64 leave up to 0.06 in each
    in_layer.holdout = True
    films(tmp_path, 1)
    assert said() == [f"Object {item.name}: a holdout is seen like any other object."]


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
@pytest.mark.parametrize("fit", ["HORIZONTAL", "VERTICAL"])
def test_sensor_fit_shift_pixels_and_percentage_frame_as_cycles(fit, kind, room, tmp_path):
    """29 % of 300 pixels are 87, and 86.99… in floats; pixels are wider than high."""
    _, scene = room
    render, camera = scene.render, scene.camera.data
    render.resolution_x, render.resolution_y, render.resolution_percentage = 200, 300, 29
    render.pixel_aspect_x = 1.5
    camera.type, camera.ortho_scale, camera.sensor_fit = kind, 4, fit
    camera.shift_x, camera.shift_y = 0.1, -0.05
    assert_alike(tmp_path)


def test_panorama_is_that_of_cycles_or_refused(room, tmp_path):
    import bpy

    _, scene = room
    scene.render.resolution_x, scene.render.resolution_y = 128, 64
    scene.camera.location, scene.camera.data.type = (0, -2, 1), "PANO"
    scene.camera.data.panorama_type = "EQUIRECTANGULAR"
    assert_alike(tmp_path)
    scene.camera.data.panorama_type = "FISHEYE_EQUISOLID"
    with pytest.raises(RuntimeError, match="Fisheye Equisolid is not rendered"):
        bpy.ops.render.render()
    scene.camera.data.panorama_type, scene.render.resolution_x = "EQUIRECTANGULAR", 64
    with pytest.raises(RuntimeError, match="twice as wide"):
        bpy.ops.render.render()


def test_focus_is_on_a_bone_and_a_mirrored_camera_is_reported(room, tmp_path):
    import bpy

    _, scene = room
    bones = bpy.data.armatures.new("bones")
    owner = bpy.data.objects.new("bones", bones)
    scene.collection.objects.link(owner)
    bpy.context.view_layer.objects.active = owner
    bpy.ops.object.mode_set(mode="EDIT")
    bone = bones.edit_bones.new("tip")
    bone.head, bone.tail = (0, -3, 0), (0, -3, 1)
    bpy.ops.object.mode_set(mode="OBJECT")
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_object, dof.focus_subtarget = True, 0.3, owner, "tip"
    assert_alike(tmp_path)
    assert not said()
    scene.camera.scale = (-1, 1, 1)
    scene.camera.data.clip_start, scene.camera.data.clip_end = 3.0, 8.0
    films(tmp_path, 1)
    assert [sentence.partition(": ")[2][:16] for sentence in said()] == [
        "mirrored by its ", "things beyond it", "its clip start o",
    ]  # fmt: skip


def test_the_exposure_of_cycles_is_named(room, tmp_path):
    _, scene = room
    scene.cycles.film_exposure = 2.0
    films(tmp_path, 1)
    assert "Film: Cycles multiplies its light by 2 (Exposure, in its render properties)." in said()


def test_lamps_mirrored_portals_and_linked_light(room, tmp_path):
    import bpy

    cycles, _ = room
    cycles.add_lamp("AREA", (0, -1, 3), 100, size=1.0, scale=(-1, 0.5, 1))
    cycles.add_lamp("AREA", (-1, -1, 3), 100, shape="DISK", size=1.0, scale=(1, -1, 1))
    cycles.add_lamp("AREA", (0, 0, 3), 500, size=2.0).data.cycles.is_portal = True
    assert_alike(tmp_path)
    lamp = cycles.add_lamp("POINT", (0, -2, 2), 200)
    lamp.light_linking.receiver_collection = bpy.data.collections.new("receivers")
    films(tmp_path, 1)
    assert any(sentence.startswith(f"Object {lamp.name}: its light reaches all objects") for sentence in said())


def test_smooth_surfaces_show_lamps_with_little_noise(room, tmp_path):
    """A coat of roughness 0.03: of 64 samples light sampling alone leaves most pixels of a highlight dark."""
    import bpy

    cycles, _ = room
    coated = cycles.material("coated", Base_Color=(0, 0, 0, 1), Roughness=0.03)
    cycles.add("uv_sphere", coated, radius=0.9, location=(0, -1, 1), segments=96, ring_count=48)
    bpy.ops.object.shade_smooth()
    cycles.add_lamp("AREA", (2, -3, 3), 60, size=1.0, rotation=(0.7, 0.4, 0))
    one, other = films(tmp_path, 64)
    ball = (slice(10, 34), slice(36, 60))  # within its outline
    shown = other[ball].mean(-1) > 0.5 * other[ball].max()
    noise = np.sqrt(np.mean((one - other)[ball][shown] ** 2)) / other[ball][shown].mean()
    assert shown.sum() > 10 and noise < 0.3


def test_slots_geometry_nodes_and_negative_scale(room, tmp_path):
    """Materials of slots, of objects, of none and of nodes; glass and a lamp turned inside out."""
    import bpy

    cycles, scene = room
    cube = cycles.add("cube", matte("A", 0.9, 0.1, 0.9), size=0.8, location=(0, -1, 0.4))
    for surface in (matte("B", 0.1, 0.9, 0.9), None):
        cube.data.materials.append(surface)
    for number, face in enumerate(cube.data.polygons):
        face.material_index = number % 2
    cube.material_slots[1].link, cube.material_slots[1].material = "OBJECT", matte("C", 0.9, 0.5, 0.1)
    ball = cycles.add("uv_sphere", matte("D", 0.9, 0.1, 0.9), radius=0.4, location=(0, 0, 1.6))
    group = bpy.data.node_groups.new("group", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    names = ("NodeGroupInput", "GeometryNodeSetMaterial", "NodeGroupOutput")
    into, change, out = (group.nodes.new(name) for name in names)
    change.inputs["Material"].default_value = matte("E", 0.1, 0.2, 0.9)
    group.links.new(into.outputs[0], change.inputs["Geometry"])
    group.links.new(change.outputs[0], out.inputs[0])
    ball.modifiers.new("nodes", "NODES").node_group = group
    empty = bpy.data.objects.new("parent", None)
    scene.collection.objects.link(empty)
    empty.scale, empty.rotation_euler = (-1, 1.3, 0.8), (0, 0, 0.4)
    glow = cycles.material("glow", Base_Color=(0.2, 0.2, 0.2, 1), Emission_Color=(1, 0.5, 0.2, 1), Emission_Strength=1)
    lamp = cycles.add("uv_sphere", glow, radius=0.3, location=(0.9, -0.9, 0.3))
    lamp.parent, lamp.scale = empty, (1, -1, 1)
    assert_alike(tmp_path, mean=0.01, tile=0.3)  # Cycles takes few samples of such a lamp


QUARTERS = ((0.7, 0.4, 0.35), (0.35, 0.65, 0.4), (0.35, 0.4, 0.7), (0.65, 0.65, 0.4))  # within sRGB in any space


def four_colours(*, alpha=(1.0, 1.0, 1.0, 1.0)):
    """Codes (64, 64, 4), each quarter of one colour."""
    rows = np.ones((64, 64, 4), np.float32)
    for number, color in enumerate(QUARTERS):
        y, x = divmod(number, 2)
        rows[32 * y : 32 * y + 32, 32 * x : 32 * x + 32] = (*color, alpha[number])
    return (rows * 255).astype(np.uint8)


def textured(image, *, alpha=False, uv=""):
    """A rough base of a picture, its alpha making holes, by the texture coordinates of a name."""
    from tests.integrations import cycles

    made = cycles.material(image.name, Roughness=1.0, Specular_IOR_Level=0.0)
    tree, node = made.node_tree, made.node_tree.nodes.new("ShaderNodeTexImage")
    base, node.image = tree.nodes["Principled BSDF"], image
    if uv:
        named = tree.nodes.new("ShaderNodeUVMap")
        named.uv_map = uv
        tree.links.new(named.outputs[0], node.inputs["Vector"])
    tree.links.new(node.outputs["Color"], base.inputs["Base Color"])
    if alpha:
        tree.links.new(node.outputs["Alpha"], base.inputs["Alpha"])
    return made, node


def test_alpha_of_pictures_counts_as_in_cycles(room, tmp_path):
    """Colours are times alpha where nothing takes it; packed, of every mode of alpha."""
    import bpy
    from PIL import Image

    cycles, _ = room
    codes = four_colours(alpha=(1, 0, 0.5, 1))
    Image.fromarray(codes).save(tmp_path / "STRAIGHT.png")
    codes[..., :3] = codes[..., :3] * (codes[..., 3:] / 255)
    Image.fromarray(codes).save(tmp_path / "PREMUL.png")
    for number, mode in enumerate(("STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE")):
        file = tmp_path / ("PREMUL.png" if mode == "PREMUL" else "STRAIGHT.png")
        image = bpy.data.images.load(str(file), check_existing=False)
        image.alpha_mode, image.name = mode, mode
        image.pack()
        surface, _ = textured(image)
        cycles.add("cube", surface, size=0.6, location=(0.7 * number - 1, -1, 0.3))
    surface, _ = textured(bpy.data.images["STRAIGHT"], alpha=True)
    cycles.add("plane", surface, size=0.8, location=(0, -0.5, 1.3), rotation=(math.pi / 2, 0, 0))
    assert_alike(tmp_path, mean=0.01)


def test_colour_spaces_and_texture_coordinates_are_those_of_cycles(room, tmp_path):
    import bpy
    import OpenEXR
    from PIL import Image

    cycles, _ = room
    Image.fromarray(four_colours()).save(tmp_path / "codes.png")
    floats = np.ascontiguousarray(four_colours()[..., :3].astype(np.float32) / 255)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": floats}).write(str(tmp_path / "codes.exr"))
    kinds = [("codes.png", "sRGB"), ("codes.png", "Non-Color"), ("codes.png", "ACEScg"), ("codes.exr", "ACEScg")]
    for number, (name, space) in enumerate(kinds):
        image = bpy.data.images.load(str(tmp_path / name), check_existing=False)
        image.colorspace_settings.name = space
        surface, _ = textured(image, uv="second" if number else "")
        cube = cycles.add("cube", surface, size=0.6, location=(0.7 * number - 1, -1, 0.3))
        second = cube.data.uv_layers.new(name="second")
        for corner in second.data:
            corner.uv = (0.5 * corner.uv[0], 0.5 * corner.uv[1])
        if number % 2:
            second.active_render = True
    assert_alike(tmp_path)
    assert not said()
    image.colorspace_settings.name, name = "sRGB", "AgX Log"
    bpy.data.images["codes.png"].colorspace_settings.name = name
    films(tmp_path, 1)
    assert said() == [f"Picture codes.png: its colour space {name} is read as sRGB."]


@pytest.mark.parametrize("frame", [2, 4])
def test_picture_of_a_sequence_is_that_of_the_frame(frame, room, tmp_path):
    import bpy
    from PIL import Image

    cycles, scene = room
    for number in range(1, 6):
        Image.new("RGB", (8, 8), (50 * number, 250 - 50 * number, 120)).save(tmp_path / f"frame_{number:04}.png")
    image = bpy.data.images.load(str(tmp_path / "frame_0001.png"))
    image.source = "SEQUENCE"
    surface, node = textured(image)
    node.image_user.frame_duration, node.image_user.use_auto_refresh = 5, True
    cycles.add("cube", surface, size=1, location=(0, -1, 0.5))
    scene.frame_set(frame)
    assert_alike(tmp_path)
    assert not said()


def test_cryptomatte_has_the_identifiers_of_cycles(room, tmp_path):
    """Of names with a dot too, and of what a library brings."""
    import bpy

    from tests.integrations.test_blender import rendered_layers

    cycles, scene = room
    box = cycles.add("cube", matte("Wood.001", 0.9, 0.6, 0.1), size=1.5)
    box.name = "Box.001"
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {box})
    bpy.data.materials.remove(box.active_material)
    bpy.data.objects.remove(box)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, linked):
        linked.objects = ["Box.001"]
    scene.collection.objects.link(linked.objects[0])
    layer = scene.view_layers[0]
    layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_material = True
    scene.render.engine, scene.rptcam.samples = "RPTCAM", 16
    seen = []
    for _ in range(2):
        channels, _ = rendered_layers(tmp_path)
        for name in ("CryptoObject00", "CryptoMaterial00"):
            found = next(
                pixels for key, pixels in channels.items() if key.startswith(name) and key[-2:] in ("00", ".r")
            )
            first = np.ascontiguousarray(found if found.ndim == 2 else found[..., 0])
            seen.append(set(first.view(np.uint32).ravel().tolist()))
        cycles.of_cycles(tmp_path, 16)
    assert seen[:2] == seen[2:] and all(len(each) == 5 for each in seen)


@pytest.mark.parametrize("how", ["none", "dark", "unseen"])
def test_world_that_does_not_shine_or_is_not_seen(how, room, tmp_path):
    _, scene = room
    if how == "none":
        scene.world = None
    elif how == "dark":
        scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    else:
        scene.world.cycles_visibility.camera = False
    assert_alike(tmp_path)


def test_ball_of_a_material_is_rendered_by_the_engine(room):
    """In its colour; the engine counts no render afterwards."""
    import bpy

    from integrations.blender import engine

    _, scene = room
    scene.render.engine = "RPTCAM"
    bpy.ops.wm.previews_ensure()
    for name, strongest in (("red", 0), ("green", 1)):
        preview = bpy.data.materials[name].preview
        width, height = preview.image_size
        middle = np.array(preview.image_pixels_float).reshape(int(height), int(width), 4)[56:72, 56:72, :3].mean((0, 1))
        assert middle.argmax() == strongest and middle.max() > 1.3 * np.median(middle)
    assert engine.renders.are_idle


def test_extension_that_is_switched_off_ends_a_preview_first(room, monkeypatch):
    """The ball would take minutes; what switches the extension off has it give up and waits until it has."""
    import bpy

    from integrations.blender import engine

    cycles, scene = room
    scene.render.engine = "RPTCAM"
    bpy.ops.wm.previews_ensure()  # kernels are there then
    monkeypatch.setattr(engine, "PREVIEW_SAMPLES", 1 << 20)
    waited = []

    def switch_off():
        while engine.renders.are_idle:
            time.sleep(0.01)
        time.sleep(0.5)
        begun = time.monotonic()
        engine.renders.end()
        waited.append(time.monotonic() - begun)

    thread = threading.Thread(target=switch_off)
    cycles.add("cube", matte("new", 0.2, 0.2, 0.9))
    thread.start()
    bpy.ops.wm.previews_ensure()
    thread.join(60)
    assert waited and waited[0] < 5 and engine.renders.are_idle
