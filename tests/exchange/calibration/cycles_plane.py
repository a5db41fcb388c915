"""Blender without a window: a plane seen through a shader, as an EXR file. Run as a program, with `bpy` installed.

Arguments: the shader, the EXR file, how far the plane lies ahead [mm], width, height, samples, and what the plane
shows: `position` (x and y [m] + 0.125) or `white`.
"""

import importlib
import sys
import types

shader, output, ahead_mm, width, height, samples, shown = sys.argv[1:]


class Parameters:
    """In place of Blender's reader of compiled shaders, which bpy from PyPI lacks: all have their defaults."""

    parameters = ()

    def __init__(self, path):
        self.path = path


sys.modules["oslquery"] = types.SimpleNamespace(OSLQuery=Parameters)
bpy = importlib.import_module("bpy")
bpy.ops.wm.read_factory_settings(use_empty=True)
importlib.import_module("addon_utils").enable("cycles")
scene = bpy.context.scene
scene.render.engine = "CYCLES"
for name, value in {
    "device": "CPU", "shading_system": True, "samples": int(samples), "use_denoising": False,
    "use_adaptive_sampling": False, "pixel_filter_type": "BOX", "filter_width": 1.0,
}.items():  # fmt: skip
    setattr(scene.cycles, name, value)
render, files = scene.render, scene.render.image_settings
render.threads_mode, render.threads, render.resolution_percentage = "FIXED", 2, 100
render.resolution_x, render.resolution_y, render.filepath = int(width), int(height), output
files.file_format, files.color_depth, files.exr_codec = "OPEN_EXR", "32", "NONE"

camera = bpy.data.cameras.new("camera")
camera.type, camera.custom_mode, camera.custom_filepath, camera.clip_start = "CUSTOM", "EXTERNAL", shader, 1e-6
scene.camera = bpy.data.objects.new("camera", camera)
scene.collection.objects.link(scene.camera)
compiled = importlib.import_module("cycles.osl").update_custom_camera_shader(camera, lambda *said: print(*said))

material = bpy.data.materials.new("plane")
material.use_nodes = True
nodes, links = material.node_tree.nodes, material.node_tree.links
nodes.clear()
surface, emission = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeEmission")
links.new(emission.outputs[0], surface.inputs["Surface"])
if shown == "position":
    place, more = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeVectorMath")
    more.inputs[1].default_value = (0.125, 0.125, 0.125)
    links.new(place.outputs["Position"], more.inputs[0])
    links.new(more.outputs[0], emission.inputs["Color"])
plane = bpy.data.meshes.new("plane")
half, z = 0.15, -1e-3 * float(ahead_mm)
plane.from_pydata([(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)], [], [(0, 1, 2, 3)])
plane.materials.append(material)
scene.collection.objects.link(bpy.data.objects.new("plane", plane))
bpy.ops.render.render(write_still=True)
sys.exit(0 if compiled else 1)
