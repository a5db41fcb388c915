"""The worker that renders with Blender's Cycles on the processor; its Python needs bpy and nothing else.

Requests: ``load`` a description made by `benchmarks.cycles_scene`, ``render`` samples of it and perhaps save them, with
a ``noise`` as threshold of its adaptive samples; with ``denoise`` Cycles cleans the picture as it does by default. A
checker has cells of one metre in the world, as that of the reference scenes.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.stopwatch import cores, timed_picture
from benchmarks.worker import WorkerError, serve

WITHOUT_BIAS = {"sample_clamp_indirect": 0.0, "blur_glossy": 0.0}
FIXED = {"device": "CPU", "denoiser": "OPENIMAGEDENOISE"}
SHADERS = {
    "matte": "ShaderNodeBsdfDiffuse",
    "metal": "ShaderNodeBsdfAnisotropic",
    "glass": "ShaderNodeBsdfGlass",
}
BOX = {"pixel_filter_type": "BOX", "filter_width": 1.0}


class _NoParameters:
    """In place of Blender's reader of compiled shaders, which bpy lacks: all parameters have their defaults."""

    parameters = ()

    def __init__(self, path: str) -> None:
        self.path = path


def start() -> tuple[str, Callable[[dict[str, Any]], dict[str, Any]]]:
    """Return the description of the renderer and its answers."""
    sys.modules["oslquery"] = types.SimpleNamespace(OSLQuery=_NoParameters)  # type: ignore[assignment]
    try:
        bpy = importlib.import_module("bpy")
    except ImportError as error:
        raise WorkerError(f"Cycles cannot be imported ({error}); pip install bpy, by itself") from error
    folder = tempfile.TemporaryDirectory()

    def respond(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "load":
            _load(bpy, request["description"], Path(folder.name))
            return {}
        return _render(bpy, request)

    return f"Cycles of Blender {bpy.app.version_string}", respond


def _load(bpy: Any, description: dict[str, Any], folder: Path) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    importlib.import_module("addon_utils").enable("cycles")
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    bounces = {f"{kind}_bounces": description["bounces"] for kind in ("max", "diffuse", "glossy", "transmission")}
    roulette = {"min_light_bounces": description["unshortened"]}
    for name, value in (FIXED | BOX | WITHOUT_BIAS | bounces | roulette).items():
        setattr(scene.cycles, name, value)
    render, files = scene.render, scene.render.image_settings
    render.use_persistent_data = True
    render.threads_mode, render.threads, render.resolution_percentage = "FIXED", cores(), 100
    render.resolution_x, render.resolution_y = description["size"]
    render.filepath = str(folder / "picture.exr")
    files.file_format, files.color_depth, files.exr_codec = "OPEN_EXR", "32", "NONE"
    _add_camera(bpy, scene, description["camera"])
    for mesh in description["meshes"]:
        _add_mesh(bpy, scene, mesh)
    for lamp in description["lamps"]:
        _add_lamp(bpy, scene, lamp)
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    _add_environment(bpy, world.node_tree, description["environment"])
    scene.world = world


def _add(bpy: Any, scene: Any, data: Any, world: Any = None) -> Any:
    placed = bpy.data.objects.new(data.name, data)
    if world is not None:
        placed.matrix_world = importlib.import_module("mathutils").Matrix(world)
    scene.collection.objects.link(placed)
    return placed


def _add_camera(bpy: Any, scene: Any, camera: dict[str, Any]) -> None:
    import math

    data = bpy.data.cameras.new("camera")
    data.clip_start = 1e-6
    scene.camera = _add(bpy, scene, data, camera["world"])
    if "shader" not in camera:
        data.sensor_fit, data.angle = "HORIZONTAL", math.radians(camera["fov_degrees"])
        if "aperture_radius" in camera:
            data.dof.use_dof, data.dof.focus_distance = True, camera["focus_distance"]
            data.dof.aperture_fstop = data.lens / 1000 / (2 * camera["aperture_radius"])
        return
    data.type, data.custom_mode, data.custom_filepath = "CUSTOM", "EXTERNAL", camera["shader"]
    said: list[Any] = []
    if not importlib.import_module("cycles.osl").update_custom_camera_shader(data, lambda *words: said.append(words)):
        raise WorkerError(f"Cycles does not compile the shader of the lens: {said}")


def _add_environment(bpy: Any, tree: Any, environment: dict[str, Any]) -> None:
    """Fill in what shines from all round; the middle of Cycles' picture lies along +x, and +y is on its left."""
    nodes, links = tree.nodes, tree.links
    background = nodes["Background"]
    if "color" in environment:
        background.inputs["Color"].default_value = (*environment["color"], 1.0)
        return
    way, local, picture = (nodes.new(f"ShaderNode{name}") for name in ("TexCoord", "CombineXYZ", "TexEnvironment"))
    right, up, forward = environment["axes"]
    for name, axis in (("X", forward), ("Y", [-value for value in right]), ("Z", up)):
        along = nodes.new("ShaderNodeVectorMath")
        along.operation = "DOT_PRODUCT"
        links.new(way.outputs["Generated"], along.inputs[0])
        along.inputs[1].default_value = axis
        links.new(along.outputs["Value"], local.inputs[name])
    links.new(local.outputs["Vector"], picture.inputs["Vector"])
    picture.image = bpy.data.images.load(environment["file"])
    picture.image.colorspace_settings.name = "Non-Color"  # linear, as it is
    links.new(picture.outputs["Color"], background.inputs["Color"])
    background.inputs["Strength"].default_value = environment["gain"]


def _add_mesh(bpy: Any, scene: Any, mesh: dict[str, Any]) -> None:
    import numpy as np

    arrays = np.load(mesh["file"])
    data = bpy.data.meshes.new("mesh")
    data.from_pydata(arrays["points"].tolist(), [], arrays["faces"].tolist())
    data.polygons.foreach_set("use_smooth", [mesh["smooth"]] * len(data.polygons))
    data.materials.append(_material(bpy, mesh["look"]))
    _add(bpy, scene, data)


def _add_lamp(bpy: Any, scene: Any, lamp: dict[str, Any]) -> None:
    """Add a ball or a rectangle of light, or else a sun without size."""
    import math

    data = bpy.data.lights.new("lamp", "POINT" if "radius" in lamp else "AREA" if "size" in lamp else "SUN")
    data.color, data.energy = [value / max(lamp["color"]) for value in lamp["color"]], max(lamp["color"])
    if "radius" in lamp:
        data.shadow_soft_size, data.use_soft_falloff = lamp["radius"], False
        data.energy *= (2 * math.pi * lamp["radius"]) ** 2
    elif "size" in lamp:
        data.shape = "RECTANGLE"
        data.size, data.size_y = lamp["size"]
        data.energy *= math.pi * data.size * data.size_y
    else:
        data.angle = 0.0
    _add(bpy, scene, data, lamp["world"]).visible_camera = True


def _material(bpy: Any, look: dict[str, Any]) -> Any:
    material = bpy.data.materials.new(look["kind"])
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    shown = nodes.new(SHADERS[look["kind"]])
    links.new(shown.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    shown.inputs["Color"].default_value = (*look.get("color", (1.0, 1.0, 1.0)), 1.0)
    if look["kind"] in ("metal", "glass"):
        shown.distribution = "GGX"
        shown.inputs["Roughness"].default_value = look["roughness"]
    if look["kind"] == "glass":
        shown.inputs["IOR"].default_value = look["index"]
    if "even" in look:
        links.new(_checker(nodes, links, look).outputs["Color"], shown.inputs["Color"])
    return material


def _checker(nodes: Any, links: Any, look: dict[str, Any]) -> Any:
    place, moved, checker = (nodes.new(f"ShaderNode{name}") for name in ("NewGeometry", "VectorMath", "TexChecker"))
    moved.inputs[1].default_value = (0.0, 0.0, 0.5)  # the floor lies at 0, where cells meet
    links.new(place.outputs["Position"], moved.inputs[0])
    links.new(moved.outputs[0], checker.inputs["Vector"])
    checker.inputs["Scale"].default_value = 1.0
    checker.inputs["Color1"].default_value = (*look["odd"], 1.0)
    checker.inputs["Color2"].default_value = (*look["even"], 1.0)
    return checker


def _render(bpy: Any, request: dict[str, Any]) -> dict[str, Any]:
    """Return times and mean colour of a render from the loaded scene to the picture in numpy, which may be saved."""
    import numpy as np

    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed = request["spp"], request["seed"]
    scene.cycles.use_denoising = request.get("denoise", False)
    scene.cycles.use_adaptive_sampling = "noise" in request
    scene.cycles.adaptive_threshold = request.get("noise", 0.0)

    def make() -> Any:
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        values = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(values)
        bpy.data.images.remove(image)
        return values.reshape(height, width, 4)[::-1, :, :3]

    return timed_picture(make, request)


if __name__ == "__main__":
    serve(start)
