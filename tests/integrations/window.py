"""Run in Blender's window: a scene, a lens, the viewport through the camera, F12; then Blender quits.

    blender --python tests/integrations/window.py -- FOLDER

Writes `shown.json` (where the frame of the camera is, in pixels of the window) when the viewport has its samples, waits
until that is gone, and writes `f12.png`.
"""

import json
import math
import sys
import time
from pathlib import Path

import bpy

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
LOOK_SECONDS, SAMPLES, SIZE = 20.0, 32, (480, 320)
steps = {"next": "show", "since": time.monotonic()}


def surface(**inputs):
    """A principled material."""
    made = bpy.data.materials.new("surface")
    made.use_nodes = True
    for name, value in inputs.items():
        made.node_tree.nodes["Principled BSDF"].inputs[name.replace("_", " ")].default_value = value
    return made


def scene_with_a_lens():
    """A cylinder of brass and a white ball on a floor under an area lamp, through a double Gauss at f/2."""
    scene = bpy.context.scene
    for item in [each for each in bpy.data.objects if each.type != "CAMERA"]:
        bpy.data.objects.remove(item)
    brass = surface(Base_Color=(0.9, 0.7, 0.35, 1), Metallic=1.0, Roughness=0.25)
    for kind, made, options in (
        ("plane", surface(Base_Color=(0.5, 0.5, 0.52, 1)), {"size": 40}),
        ("cylinder", brass, {"radius": 0.35, "depth": 1.2, "location": (-0.6, 0, 0.6)}),
        ("uv_sphere", surface(Roughness=0.2), {"radius": 0.4, "location": (0.4, 0.3, 0.4)}),
    ):
        getattr(bpy.ops.mesh, f"primitive_{kind}_add")(**options)
        bpy.context.object.data.materials.append(made)
    lamp = bpy.data.lights.new("lamp", "AREA")
    lamp.energy, lamp.size = 200, 1.5
    item = bpy.data.objects.new("lamp", lamp)
    item.location, item.rotation_euler = (-2, -2, 4), (0.5, -0.4, 0)
    scene.collection.objects.link(item)
    camera = scene.camera
    camera.location, camera.rotation_euler = (0, -5, 1.1), (math.radians(84), 0, 0)
    camera.data.dof.focus_distance = 4.8
    scene.render.engine, scene.render.filepath = "RPTCAM", str(FOLDER / "f12.png")
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.rptcam.samples = scene.rptcam.viewport_samples = SAMPLES
    lens = camera.data.rptcam
    lens.lens, lens.f_number, lens.match_field = "dgauss-50mm", 2.0, True
    bpy.context.view_layer.objects.active = camera


def area(kind):
    """The window, and its area of a kind."""
    window = bpy.context.window_manager.windows[0]
    return window, next(each for each in window.screen.areas if each.type == kind)


def tick():
    """Go on, and say after how many seconds to come again; called by a timer."""
    window, view = area("VIEW_3D")
    space = view.spaces.active
    waited = time.monotonic() - steps["since"]
    if steps["next"] == "show":
        space.region_3d.view_perspective, space.shading.type = "CAMERA", "RENDERED"
        area("PROPERTIES")[1].spaces.active.context = "DATA"
        steps.update(next="look", since=time.monotonic())
    elif steps["next"] == "look" and waited > LOOK_SECONDS:
        from bl_ext.user_default.rptcam.viewport import frame_in

        region = next(each for each in view.regions if each.type == "WINDOW")
        left, bottom, width, height = frame_in(region, space.region_3d, bpy.context.scene)
        shown = [region.x + left, window.height - region.y - bottom - height, width, height]
        (FOLDER / "shown.json.part").write_text(json.dumps(shown))
        (FOLDER / "shown.json.part").rename(FOLDER / "shown.json")
        steps["next"] = "press"
    elif steps["next"] == "press" and not (FOLDER / "shown.json").exists():
        space.shading.type = "SOLID"
        with bpy.context.temp_override(window=window):
            bpy.ops.render.render("INVOKE_DEFAULT", write_still=True)
        steps["next"] = "wait"
    elif steps["next"] == "wait" and not bpy.app.is_job_running("RENDER") and (FOLDER / "f12.png").exists():
        bpy.ops.wm.quit_blender()
    view.tag_redraw()
    return 0.5


bpy.context.preferences.view.show_splash = False
scene_with_a_lens()
bpy.app.timers.register(tick, first_interval=2.0, persistent=True)
