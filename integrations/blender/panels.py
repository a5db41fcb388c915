"""Properties and panels: lens, f-stop, shutter, exposure, focus, samples, and what the translation leaves out."""

# ruff: noqa: N801, RUF012 (names and sets as Blender wants them)
from __future__ import annotations

import importlib
import math
from typing import Any

import bpy
import bpy.utils.previews
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from mathutils import Matrix

from rptcam_cl.core.errors import RptcamError

from .camera import LensChoice
from .lens_facts import LensFacts, circle_mm, cross_section, lens_facts, menu
from .reader import Reader, Settings

ENGINE = "RPTCAM"
NONE, FILE = "NONE", "FILE"

# Panels of Blender that the engine shows: those of all engines, and those for lamps and surfaces that EEVEE has
NOT_OURS = {
    "RENDER_PT_simplify_greasepencil", "RENDER_PT_freestyle", "DATA_PT_camera_dof_aperture_", "VIEWLAYER_PT_filter",
    "VIEWLAYER_PT_layer_passes",
}  # fmt: skip
OF_EEVEE = {
    "EEVEE_MATERIAL_PT_surface", "EEVEE_WORLD_PT_surface", "DATA_PT_EEVEE_light", "DATA_PT_EEVEE_light_distance",
    "MATERIAL_PT_preview", "EEVEE_MATERIAL_PT_context_material", "VIEWLAYER_PT_eevee_layer_passes_data",
    "VIEWLAYER_PT_eevee_next_layer_passes_data", "VIEWLAYER_PT_layer_passes_cryptomatte", "RENDER_PT_eevee_motion_blur",
    "EEVEE_WORLD_PT_mist",
}  # fmt: skip

_items: list[tuple[str, str, str]] = []  # Blender keeps no reference to the texts of a menu
_previews: Any = None


def lens_items(self: Any, context: Any) -> list[tuple[str, str, str]]:
    """The menu of lenses."""
    if not _items:
        _items.append((NONE, "Blender's camera", "A pinhole, or a thin lens with depth of field"))
        _items.extend(menu())
        _items.append((FILE, "Lens file…", "A prescription in one of the formats that rptcam reads"))
    return _items


class CameraProperties(bpy.types.PropertyGroup):
    """The lens of a camera."""

    lens: EnumProperty(name="Lens", description="The lens in front of the film", items=lens_items)
    file: StringProperty(name="File", description="Lens file", subtype="FILE_PATH")
    f_number: FloatProperty(
        name="F-Stop", description="The lens limits how far it opens", default=2.8, min=0.5, max=128, precision=1
    )
    match_field: BoolProperty(
        name="Match Blender's Field",
        description="Film as large as it takes for the lens to show what Blender's camera shows",
        default=False,
    )
    autofocus: EnumProperty(
        name="Focus",
        items=[
            ("DISTANCE", "Blender's", "Focus object or distance of Blender's depth of field"),
            ("contrast", "Contrast", "Autofocus by contrast in the middle of the picture"),
            ("phase", "Phase", "Autofocus by phase detection in the middle of the picture"),
            ("depth", "Depth", "At what the middle of the picture shows"),
        ],
    )
    diffraction: EnumProperty(
        name="Diffraction",
        items=[
            ("off", "Off", "Light goes straight"),
            ("auto", "Auto", "Where it shows"),
            ("on", "On", "Always"),
        ],
    )
    transmission: EnumProperty(
        name="Glass",
        items=[
            ("ideal", "Ideal", "The lens takes no light"),
            ("bare", "Bare", "Surfaces reflect, glass absorbs"),
            ("mgf2", "Coated", "A quarter wave of magnesium fluoride on every surface"),
        ],
    )
    ghosts: BoolProperty(name="Ghosts", description="Lamps and suns make ghosts (with glass that reflects)")
    made: EnumProperty(
        name="Made",
        description="The lens as it is designed, or one of many copies that are made within tolerances",
        items=[
            (NONE, "As Designed", "No faults"),
            ("commercial", "Commercial", "A copy within tolerances as they are common"),
            ("precision", "Precision", "A copy within closer ones"),
            ("high_precision", "High Precision", "A copy within the closest ones"),
        ],
    )
    percentile: FloatProperty(
        name="Copy",
        description="So many of a hundred copies are as sharp or sharper: 90 is one of the worse",
        subtype="PERCENTAGE", default=50.0, min=1.0, max=99.0, precision=0,
    )  # fmt: skip

    @property
    def reference(self) -> str:
        """The chosen lens by name or file; empty for Blender's camera."""
        if self.lens == FILE:
            return str(bpy.path.abspath(self.file))
        return "" if self.lens == NONE else str(self.lens)

    @property
    def shows_ghosts(self) -> bool:
        """Whether ghosts are rendered."""
        return bool(self.reference and self.ghosts and self.transmission != "ideal")

    def facts(self) -> LensFacts | None:
        """The numbers of the lens; None without one that can be read."""
        try:
            return lens_facts(self.reference) if self.reference else None
        except (RptcamError, OSError):
            return None

    def choice(self) -> LensChoice:
        """What the translation takes."""
        if not self.reference:
            return LensChoice()
        facts = lens_facts(self.reference)
        keys: dict[str, Any] = {}
        if self.diffraction != "off":
            keys["diffraction"] = self.diffraction
        if self.transmission != "ideal":
            keys["transmission"] = "bare" if self.transmission == "bare" else {"coating": "mgf2"}
        if self.shows_ghosts:
            keys["ghosts"] = "on"
        lens: Any = self.reference
        if self.made != NONE:
            lens = {"design": lens, "as_built": {"percentile": f"{self.percentile:g}%", "spec": self.made}}
        autofocus = "" if self.autofocus == "DISTANCE" else self.autofocus
        stop = max(self.f_number, facts.f_number)
        return LensChoice(lens, stop, self.match_field, facts.focal_length_mm, autofocus, keys)


class SceneProperties(bpy.types.PropertyGroup):
    """How a scene is rendered."""

    samples: IntProperty(name="Samples", description="Of each pixel", default=128, min=1, max=1 << 20)
    viewport_samples: IntProperty(name="Viewport", description="Samples of each pixel in viewports", default=64, min=1)
    noise: FloatProperty(
        name="Noise Target",
        description="Relative error at which a tile is done; 0 takes all samples everywhere",
        default=0.0, min=0.0, max=0.9, precision=3,
    )  # fmt: skip
    max_depth: IntProperty(name="Bounces", description="Longest path, the camera's ray included", default=12, min=1)
    clamp: FloatProperty(name="Clamp", description="Most light of a sample (biased); 0 for none", default=0.0, min=0.0)
    seed: IntProperty(name="Seed", min=0)
    caustics: EnumProperty(
        name="Caustics",
        items=[("auto", "Auto", "Photons where paths hardly find them"), ("on", "On", ""), ("off", "Off", "")],
    )
    virtual_lights: EnumProperty(
        name="Virtual Lights",
        description="Less noise in rooms that are lit by detours; no light is changed",
        items=[("auto", "Auto", "Where light comes by detours"), ("on", "On", ""), ("off", "Off", "")],
    )
    denoise: BoolProperty(name="Denoise", description="Remove the noise that F12 leaves (biased); needs pyoidn")
    bake_size: IntProperty(
        name="Baked Pictures", description="Pixels across of each", default=1024, min=16, max=8192
    )  # fmt: skip
    device: StringProperty(name="Device", description="Empty for the fastest; cpu, gpu, 0:0 or a part of its name")
    own_process: BoolProperty(
        name="Own Process",
        description="Render in a process of its own: if a driver ends that, Blender and its file stay",
    )
    exposure: EnumProperty(
        name="Exposure",
        items=[
            ("relative", "As Blender", "Radiance 1 is 1, whatever the f-stop"),
            ("physical", "Camera", "By f-stop, shutter and ISO"),
            ("auto", "Metered", "The shutter that metering finds"),
        ],
    )
    iso: FloatProperty(name="ISO", default=100, min=1, max=1e6, precision=0)
    use_shutter: BoolProperty(name="Own Shutter", description="In place of that of Blender's motion blur")
    shutter_s: FloatProperty(name="1 /", description="Exposure time as a fraction of a second", default=60, min=0.001)
    rolling_ms: FloatProperty(name="Rolling [ms]", description="Readout of the sensor; 0 is global", min=0.0, max=1e4)


def settings_of(
    scene: Any, layers: list[str], *, through_lens: bool = True, light_groups: tuple[str, ...] = ()
) -> Settings:
    """The panels' settings as the reader takes them."""
    given = scene.rptcam
    render: dict[str, Any] = {
        "spp": given.samples, "max_depth": given.max_depth, "seed": given.seed, "caustics": given.caustics,
        "virtual_lights": given.virtual_lights, "layers": layers,
    }  # fmt: skip
    if given.noise > 0:
        render["noise"] = given.noise
    if given.clamp > 0:
        render["clamp"] = given.clamp
    choice = LensChoice()
    if through_lens and scene.camera is not None and scene.camera.type == "CAMERA":
        choice = scene.camera.data.rptcam.choice()
    exposure: dict[str, Any] = {"mode": given.exposure, "iso": given.iso}
    if given.exposure != "relative" and not choice.lens:
        dof = scene.camera.data.dof if scene.camera is not None and scene.camera.type == "CAMERA" else None
        if dof is None or not dof.use_dof or not through_lens:  # of a pinhole; a thin lens has its own
            exposure["f_number"] = 8.0 if dof is None else dof.aperture_fstop
    more = {"render": render} | ({"exposure": exposure} if given.exposure != "relative" else {})
    shutter = 1 / given.shutter_s if given.use_shutter else None
    return Settings(choice, shutter, given.rolling_ms / 1000, light_groups, more)


class _Panel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Whether the engine is chosen."""
        return bool(context.engine == ENGINE)


class RPTCAM_PT_sampling(_Panel, bpy.types.Panel):
    """Samples and paths."""

    bl_label = "Sampling"
    bl_context = "render"

    def draw(self, context: Any) -> None:
        """Lay out."""
        given = context.scene.rptcam
        column = _column(self.layout)
        for name in (
            "samples",
            "viewport_samples",
            "noise",
            "max_depth",
            "caustics",
            "virtual_lights",
            "clamp",
            "seed",
            "denoise",
            "device",
            "own_process",
        ):
            column.prop(given, name)


class RPTCAM_PT_exposure(_Panel, bpy.types.Panel):
    """Exposure and shutter."""

    bl_label = "Shutter and Exposure"
    bl_context = "render"

    def draw(self, context: Any) -> None:
        """Lay out."""
        given, column = context.scene.rptcam, _column(self.layout)
        column.prop(given, "exposure")
        if given.exposure != "relative":
            column.prop(given, "iso")
        column.prop(given, "use_shutter")
        if given.use_shutter:
            column.prop(given, "shutter_s")
        column.prop(context.scene.render, "use_motion_blur")
        if context.scene.render.use_motion_blur:
            if not given.use_shutter:
                column.prop(context.scene.render, "motion_blur_shutter")
            column.prop(given, "rolling_ms")


class RPTCAM_PT_report(_Panel, bpy.types.Panel):
    """What the last render left out."""

    bl_label = "Not as in Blender"
    bl_context = "render"

    def draw(self, context: Any) -> None:
        """Lay out."""
        from .engine import REPORTS

        sentences = REPORTS.get(context.scene.name)
        column = self.layout.column(align=True)
        column.operator("rptcam.check")
        row = column.row(align=True)
        row.operator("rptcam.bake")
        row.prop(context.scene.rptcam, "bake_size", text="")
        row.operator("rptcam.forget_baked", text="", icon="X")
        if sentences is None:
            column.label(text="Nothing has been rendered yet")
        elif not sentences:
            column.label(text="Everything is translated", icon="CHECKMARK")
        for sentence in sentences or ():
            _wrapped(column, sentence, max(int(context.region.width / 7), 30))


class RPTCAM_PT_lens(_Panel, bpy.types.Panel):
    """The lens."""

    bl_label = "Real Lens"
    bl_context = "data"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Whether a camera is shown with this engine."""
        return bool(context.engine == ENGINE and context.camera)

    def draw(self, context: Any) -> None:
        """Lay out."""
        camera = context.camera
        given, column = camera.rptcam, _column(self.layout)
        column.prop(given, "lens")
        if given.lens == FILE:
            column.prop(given, "file")
        if not given.reference:
            column.label(text="Focal length and depth of field are Blender's, below")
            return
        facts = given.facts()
        if facts is None:
            column.label(text="This lens cannot be read", icon="ERROR")
            return
        icon = _section_icon(given.reference)
        if icon:
            column.template_icon(icon_value=icon, scale=7)
        column.label(text=f"{facts.focal_length_mm:.1f} mm  f/{facts.f_number:.1f}  {facts.elements} elements")
        width = math.hypot(camera.sensor_width, camera.sensor_width * _aspect(context.scene))
        circle = circle_mm(given.reference)
        covers = "covers the sensor" if circle >= width else f"the sensor needs {width:.0f} mm"
        column.label(text=f"Image circle {circle:.0f} mm: {covers}")
        column.prop(given, "f_number")
        if given.f_number < facts.f_number:
            column.label(text=f"It opens to f/{facts.f_number:.1f}", icon="INFO")
        column.prop(given, "match_field")
        column.operator("rptcam.match_camera")
        column.prop(given, "autofocus")
        if given.autofocus == "DISTANCE":
            column.prop(camera.dof, "focus_object")
            if camera.dof.focus_object is None:
                column.prop(camera.dof, "focus_distance")
        row = column.row(align=True)
        row.operator("rptcam.autofocus")
        row.operator("rptcam.focus_at_click", text="", icon="EYEDROPPER")
        column.prop(given, "made")
        if given.made != NONE:
            column.prop(given, "percentile", slider=True)
        column.prop(given, "diffraction")
        column.prop(given, "transmission")
        if given.transmission != "ideal":
            column.prop(given, "ghosts")
        column.operator("rptcam.osl")


def _column(layout: Any) -> Any:
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout.column()


def _aspect(scene: Any) -> float:
    return float(scene.render.resolution_y / scene.render.resolution_x)


def _wrapped(column: Any, text: str, width: int) -> None:
    words, line = text.split(), ""
    first = True
    for word in [*words, ""]:
        if not word or len(line) + len(word) > width:
            column.label(text=line, icon="DOT" if first else "BLANK1")
            line, first = "", False
        line = f"{line} {word}".strip()


def _section_icon(lens: str) -> int:
    """The icon of a lens's cross-section; 0 where it cannot be drawn."""
    if _previews is None:
        return 0
    if lens not in _previews:
        try:
            picture = cross_section(lens)
        except (RptcamError, ValueError):
            return 0
        made = _previews.new(lens)
        made.image_size = picture.shape[1::-1]
        made.image_pixels_float.foreach_set(picture.ravel())
    return int(_previews[lens].icon_id)


class RPTCAM_OT_match_camera(bpy.types.Operator):
    """Give Blender's camera the focal length of the lens, so that viewport and render frame alike."""

    bl_idname = "rptcam.match_camera"
    bl_label = "Match Blender's Camera"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Do it."""
        camera = context.camera if getattr(context, "camera", None) else context.scene.camera.data
        facts = camera.rptcam.facts()
        if facts is None:
            self.report({"ERROR"}, "Choose a lens first")
            return {"CANCELLED"}
        camera.lens = facts.focal_length_mm
        camera.rptcam.match_field = False
        return {"FINISHED"}


class RPTCAM_OT_autofocus(bpy.types.Operator):
    """Focus on what the middle of the picture shows, by depth or as chosen under Focus, and keep the distance."""

    bl_idname = "rptcam.autofocus"
    bl_label = "Focus Now"
    bl_options = {"REGISTER", "UNDO"}

    point: FloatVectorProperty(
        name="Point", description="Of the picture, in fractions from its left and top edges",
        size=2, default=(0.5, 0.5), min=0.0, max=1.0, options={"SKIP_SAVE"},
    )  # fmt: skip

    def execute(self, context: Any) -> set[str]:
        """Do it."""
        from .live import focused

        scene = context.scene
        data = scene.camera.data
        if not data.rptcam.reference:
            self.report({"ERROR"}, "Choose a lens first: Blender's own camera has no autofocus here")
            return {"CANCELLED"}
        before = data.rptcam.autofocus
        data.rptcam.autofocus = method = "depth" if before == "DISTANCE" else before
        export = Reader().read(context.evaluated_depsgraph_get(), settings_of(scene, []))
        data.rptcam.autofocus = before
        keys, point = export.keys, None
        if self.properties.is_property_set("point"):
            film = {name: value for name, value in keys["film"].items() if name != "crop"}
            keys, point = keys | {"film": film}, tuple(self.point)
        try:
            found = focused(keys, method, point, apart=scene.rptcam.own_process)
        except RptcamError as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        # the film stood where Blender's camera stands, from which its distance counts
        distance = found.focus_distance_m / float(export.keys["metres_per_unit"])
        data.dof.focus_object = None
        data.dof.focus_distance = distance
        data.rptcam.autofocus = "DISTANCE"
        self.report({"INFO"}, f"Focused at {distance:.3f} units; confidence {found.confidence:.0%}")
        return {"FINISHED"}


class RPTCAM_OT_focus_at_click(bpy.types.Operator):
    """Focus on what a click shows in a viewport that looks through the camera, as Focus Now does."""

    bl_idname = "rptcam.focus_at_click"
    bl_label = "Focus at a Click"

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Wait for the click."""
        context.window.cursor_modal_set("EYEDROPPER")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Focus once there is a click; another key or button gives it up."""
        from .viewport import point_at

        if event.type not in {"LEFTMOUSE", "RIGHTMOUSE", "ESC"} or event.value != "PRESS":
            return {"RUNNING_MODAL"}
        context.window.cursor_modal_restore()
        if event.type != "LEFTMOUSE":
            return {"CANCELLED"}
        point = point_at(context.screen, context.scene, event.mouse_x, event.mouse_y)
        if point is None:
            self.report({"ERROR"}, "Click within the frame of a viewport that looks through the camera")
            return {"CANCELLED"}
        bpy.ops.rptcam.autofocus(point=point)
        return {"FINISHED"}


class RPTCAM_OT_osl(bpy.types.Operator):
    """Write a shader that traces this lens in Cycles, and a camera of it where Blender has custom cameras."""

    bl_idname = "rptcam.osl"
    bl_label = "Lens for Cycles (OSL)"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Do it."""
        from .osl import shader

        item = context.scene.camera
        export = Reader().read(context.evaluated_depsgraph_get(), settings_of(context.scene, []))
        try:
            text, behind = shader(export.keys)
        except RptcamError as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        name = f"{item.name} through {item.data.rptcam.lens}"
        block = bpy.data.texts.get(f"{name}.osl") or bpy.data.texts.new(f"{name}.osl")
        block.from_string(text)
        if not hasattr(item.data, "custom_mode"):
            self.report({"WARNING"}, f"Text {block.name}: cameras by a shader come with Blender 5.0")
            return {"FINISHED"}
        made = bpy.data.objects.new(name, item.data.copy())
        made.matrix_world = item.matrix_world @ Matrix.Translation((0, 0, behind))  # its film
        context.scene.collection.objects.link(made)
        made.data.type, made.data.custom_mode, made.data.custom_shader = "CUSTOM", "INTERNAL", block
        try:
            importlib.import_module("cycles.osl").update_custom_camera_shader(made.data, self.report)
        except ImportError as problem:
            self.report({"ERROR"}, f"Text {block.name} has the shader, but this Blender cannot use it: {problem}")
            return {"FINISHED"}
        self.report({"INFO"}, f"{name} is a camera of Cycles; its shading system has to be Open Shading Language")
        return {"FINISHED"}


class RPTCAM_OT_check(bpy.types.Operator):
    """Read the scene as a render does, and say what is not as in Blender."""

    bl_idname = "rptcam.check"
    bl_label = "Check the Scene"

    def execute(self, context: Any) -> set[str]:
        """Do it."""
        from .engine import say

        try:
            settings = settings_of(context.scene, [])
            say(context.scene, Reader().read(context.evaluated_depsgraph_get(), settings))
        except RptcamError as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        return {"FINISHED"}


class RPTCAM_OT_bake(bpy.types.Operator):
    """Bake values of nodes that are not translated to pictures of each object that shows them, by Cycles."""

    bl_idname = "rptcam.bake"
    bl_label = "Bake What Is Left Out"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Do it."""
        from .bake import bake

        if not hasattr(context.scene, "cycles"):
            self.report({"ERROR"}, "Baking is done by Cycles: enable its add-on in the preferences")
            return {"CANCELLED"}
        items = [item for item in context.view_layer.objects if item.type == "MESH" and item.visible_get()]
        count = bake(context.scene, items, context.scene.rptcam.bake_size)
        self.report({"INFO"}, f"{count} pictures were baked, and are in the file; bake again when nodes change")
        return {"FINISHED"}


class RPTCAM_OT_forget_baked(bpy.types.Operator):
    """Forget the baked pictures of all objects: their nodes count again."""

    bl_idname = "rptcam.forget_baked"
    bl_label = "Forget Baked Pictures"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Do it."""
        from .bake import forget

        forget(list(context.view_layer.objects))
        return {"FINISHED"}


CLASSES = (
    CameraProperties, SceneProperties, RPTCAM_PT_sampling, RPTCAM_PT_exposure, RPTCAM_PT_report, RPTCAM_PT_lens,
    RPTCAM_OT_match_camera, RPTCAM_OT_autofocus, RPTCAM_OT_focus_at_click, RPTCAM_OT_osl, RPTCAM_OT_check,
    RPTCAM_OT_bake, RPTCAM_OT_forget_baked,
)  # fmt: skip


def shared_panels() -> list[Any]:
    """Blender's own panels that the engine shows."""
    found = []
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", None)
        if engines is None or panel.__name__ in NOT_OURS:
            continue
        if "BLENDER_RENDER" in engines or panel.__name__ in OF_EEVEE:
            found.append(panel)
    return found


def register() -> None:
    """Add properties and panels."""
    global _previews
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Camera.rptcam = PointerProperty(type=CameraProperties)
    bpy.types.Scene.rptcam = PointerProperty(type=SceneProperties)
    for panel in shared_panels():
        panel.COMPAT_ENGINES.add(ENGINE)
    _previews = None if bpy.app.background else bpy.utils.previews.new()


def unregister() -> None:
    """Remove them."""
    global _previews
    if _previews is not None:
        bpy.utils.previews.remove(_previews)
        _previews = None
    for panel in bpy.types.Panel.__subclasses__():
        getattr(panel, "COMPAT_ENGINES", set()).discard(ENGINE)
    del bpy.types.Camera.rptcam, bpy.types.Scene.rptcam
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
