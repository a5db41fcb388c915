"""Scenes of Blender for tests, rendered by Cycles and by us."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from integrations.blender.reader import Reader, Settings
from integrations.blender.scene import Export
from rptcam_cl.imaging.image import read_film

SIZE = (96, 64)


def empty_scene(size: tuple[int, int] = SIZE) -> Any:
    """Nothing but a camera 6 units in front of the origin, looking along +y, in the dark."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = size
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    camera.location, camera.rotation_euler = (0, -6, 1.5), (np.radians(80), 0, 0)
    scene.camera = camera
    return scene


def material(name: str = "grey", **inputs: Any) -> Any:
    """A principled material with some inputs set; without any, a white diffuse one of 0.5."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    if not inputs:
        return shader("ShaderNodeBsdfDiffuse", name, Color=(0.5, 0.5, 0.5, 1))
    for key, value in inputs.items():
        made.node_tree.nodes["Principled BSDF"].inputs[key.replace("_", " ")].default_value = value
    return made


def shader(kind: str, name: str = "shader", **inputs: Any) -> Any:
    """A material of one shader node."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    node, output = tree.nodes.new(kind), tree.nodes.new("ShaderNodeOutputMaterial")
    for key, value in inputs.items():
        node.inputs[key].default_value = value
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return made


def add(kind: str, surface: Any, **options: Any) -> Any:
    """An object of a mesh primitive."""
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")(**options)
    item = bpy.context.object
    item.data.materials.append(surface)
    return item


def add_lamp(kind: str, location: tuple[float, float, float], energy: float, **values: Any) -> Any:
    """A lamp that shines down, or is turned by `rotation`."""
    data = bpy.data.lights.new(kind.title(), kind)
    data.energy = energy
    turn = values.pop("rotation", (0, 0, 0))
    scale = values.pop("scale", (1, 1, 1))
    for name, value in values.items():
        setattr(data, name, value)
    item = bpy.data.objects.new(kind.title(), data)
    item.location, item.rotation_euler, item.scale = location, turn, scale
    bpy.context.scene.collection.objects.link(item)
    return item


def world(color: tuple[float, float, float] = (1, 1, 1), strength: float = 1.0) -> Any:
    """An even world."""
    made = bpy.data.worlds.new("World")
    made.use_nodes = True
    background = made.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*color, 1)
    background.inputs["Strength"].default_value = strength
    bpy.context.scene.world = made
    return made


def exported(**more: Any) -> Export:
    """The scene as it is now."""
    bpy.context.view_layer.update()
    return Reader().read(bpy.context.evaluated_depsgraph_get(), Settings(more=more))


def ours(spp: int = 512, depth: int = 8, **more: Any) -> NDArray[np.float32]:
    """Our film of the scene."""
    render = {"spp": spp, "max_depth": depth, "caustics": "off"} | more
    return np.asarray(rptcam_cl.render(exported(render=render).keys))


def of_cycles(folder: Path, spp: int = 512, depth: int = 8) -> NDArray[np.float32]:
    """The film of Cycles."""
    import addon_utils

    addon_utils.enable("cycles")
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    for name, value in {
        "samples": spp, "use_denoising": False, "use_adaptive_sampling": False, "pixel_filter_type": "BOX",
        "max_bounces": depth - 2, "diffuse_bounces": depth, "glossy_bounces": depth, "transmission_bounces": depth,
        "sample_clamp_indirect": 0, "sample_clamp_direct": 0, "blur_glossy": 0, "caustics_reflective": True,
        "caustics_refractive": True, "device": "CPU", "use_light_tree": False,
    }.items():  # fmt: skip
        setattr(scene.cycles, name, value)
    if hasattr(scene.render.image_settings, "media_type"):  # from Blender 5.0 on
        scene.render.image_settings.media_type = "IMAGE"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(folder / "cycles.exr")
    bpy.ops.render.render(write_still=True)
    return np.asarray(read_film(folder / "cycles.exr").pixels)
