"""The render engine: F12 with passes, progress and cancel, and the viewport, both through a render session."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.imaging.development import GUIDES, check_denoiser
from rptcam_cl.imaging.writers import identifier, name_hash

from .live import LiveScene
from .panels import ENGINE, settings_of
from .reader import Reader
from .scene import Export, group_name
from .viewport import view_of

SECONDS_BETWEEN_PICTURES = 1.0
VIEW_SECONDS = 0.08  # that a redraw of the viewport may render
PREVIEW_SAMPLES = 32
SECONDS_TO_LEAVE = 0.2  # in which Blender's thread still looks at the engine's class after a render
FARTHEST = 1e10  # depth where there is nothing, as Cycles has it

Array = NDArray[Any]


@dataclass(frozen=True)
class Pass:
    """A render pass of Blender's, made of a layer of ours.

    Attributes
    ----------
    name, channels, kind
        As `RenderEngine.register_pass` takes them.
    flag : str
        Of the view layer, that asks for it.
    layer : str
        Of `render.layers`.
    made : callable
        Takes the layer and the export, returns an array (height, width, channels).
    """

    name: str
    channels: str
    kind: str
    flag: str
    layer: str
    made: Callable[[Array, Export], Array]


def _units(export: Export) -> float:
    return float(export.keys["metres_per_unit"])


def _depth(layer: Array, export: Export) -> Array:
    return np.where(np.isfinite(layer), layer / _units(export), FARTHEST)[..., None]


def _index(layer: Array, table: Array) -> Array:
    numbers = np.concatenate([table, [0]])  # -1 is nothing
    return numbers[np.clip(layer, -1, len(table) - 1)][..., None]


def _crypto(rank: int) -> Callable[[Array, Export], Array]:
    return lambda layer, export: renamed(layer[..., 4 * rank : 4 * rank + 4], export.own_names)


def renamed(ranks: Array, names: dict[str, str]) -> Array:
    """Identifiers and coverages in turn, those of some names in place of others."""
    pairs = sorted((name_hash(name), identifier(own)) for name, own in names.items())
    if not pairs:
        return ranks
    known, own = np.array([one for one, _ in pairs], np.uint32), np.array([other for _, other in pairs], np.float32)
    made = ranks.copy()
    bits = np.ascontiguousarray(ranks[..., ::2]).view(np.uint32)
    place = np.minimum(np.searchsorted(known, bits), len(known) - 1)
    made[..., ::2] = np.where(known[place] == bits, own[place], ranks[..., ::2])
    return made


IS_5 = bpy.app.version >= (5, 0, 0)  # which has other names for passes
PASSES = (
    Pass("Depth", "Z", "VALUE", "use_pass_z", "depth", _depth),
    Pass("Normal", "XYZ", "VECTOR", "use_pass_normal", "normal", lambda layer, export: layer),
    Pass(
        "Position", "XYZ", "VECTOR", "use_pass_position", "position",
        lambda layer, export: np.nan_to_num(layer / _units(export)),
    ),
    Pass(
        "UV", "UVA", "VECTOR", "use_pass_uv", "uv",
        lambda layer, export: np.nan_to_num(np.concatenate([layer, np.isfinite(layer[..., :1])], axis=-1)),
    ),
    Pass(
        "Object Index" if IS_5 else "IndexOB", "X", "VALUE", "use_pass_object_index", "object_id",
        lambda layer, export: _index(layer, export.object_indices),
    ),
    Pass(
        "Material Index" if IS_5 else "IndexMA", "X", "VALUE", "use_pass_material_index", "material_id",
        lambda layer, export: _index(layer, export.material_indices),
    ),
    Pass(
        "Diffuse Color" if IS_5 else "DiffCol", "RGB", "COLOR", "use_pass_diffuse_color", "albedo",
        lambda layer, export: layer,
    ),
    *(
        Pass(f"Crypto{what.title()}{rank:02}", "RGBA", "COLOR", f"use_pass_cryptomatte_{what}", f"crypto_{what}",
             _crypto(rank))
        for what in ("object", "material") for rank in range(3)
    ),
)  # fmt: skip
WITHOUT = {
    "use_pass_shadow": "Shadow", "use_pass_emit": "Emission",
    "use_pass_environment": "Environment", "use_pass_ambient_occlusion": "Ambient Occlusion",
    "use_pass_diffuse_direct": "Diffuse Light", "use_pass_glossy_direct": "Glossy Light",
    "use_pass_transmission_direct": "Transmission Light", "use_pass_cryptomatte_asset": "Cryptomatte Asset",
}  # fmt: skip
VECTOR = "Vector"  # is made of two layers, and of the frames beside
GHOSTS = Pass("Ghosts", "RGB", "COLOR", "", "ghosts", lambda layer, export: layer)
FALLOFF = {"LINEAR": 1.0, "QUADRATIC": 2.0, "INVERSE_QUADRATIC": 0.5}


def mist(world: Any) -> Pass:
    """The pass Mist of a world: from 0 where it starts to 1 at its depth, by the mean distance of a pixel."""
    given = world.mist_settings
    start, depth, power = float(given.start), max(float(given.depth), 1e-6), FALLOFF[given.falloff]

    def made(layer: Array, export: Export) -> Array:
        return np.clip((layer / _units(export) - start) / depth, 0.0, 1.0)[..., None] ** power

    return Pass("Mist", "Z", "VALUE", "use_pass_mist", "distance", made)


def passes_of(view_layer: Any, scene: Any) -> list[Pass]:
    """The passes that a view layer asks for."""
    found = [each for each in PASSES if getattr(view_layer, each.flag, False)]
    if view_layer.use_pass_mist and scene.world is not None:
        found.append(mist(scene.world))
    camera = scene.camera
    if camera is not None and getattr(camera.data, "rptcam", None) and camera.data.rptcam.shows_ghosts:
        found.append(GHOSTS)
    groups = light_groups_of(view_layer)
    return found + [
        Pass(f"Combined_{name}", "RGB", "COLOR", "", f"lights.{group_name(groups, name)}", lambda layer, export: layer)
        for name in groups
    ]


def light_groups_of(view_layer: Any) -> tuple[str, ...]:
    """The names of the light groups of a view layer."""
    return tuple(group.name for group in getattr(view_layer, "lightgroups", ()))


class Renders:
    """The renders that Blender's threads are in, which have to end before the engine may go."""

    def __init__(self) -> None:
        self._count, self._changed = 0, threading.Condition()
        self.are_ending = False

    @property
    def are_idle(self) -> bool:
        """Whether there is none."""
        return self._count == 0

    @contextlib.contextmanager
    def counted(self) -> Iterator[None]:
        """Count a render while it runs."""
        with self._changed:
            self._count += 1
        try:
            yield
        finally:
            with self._changed:
                self._count -= 1
                self._changed.notify_all()

    def end(self) -> None:
        """Have all of them give up, and wait until they have."""
        with self._changed:
            had_any, self.are_ending = self._count > 0, True
            self._changed.wait_for(lambda: not self._count)
        if had_any:
            time.sleep(SECONDS_TO_LEAVE)


kept, previews, renders = LiveScene(), LiveScene(), Renders()
one_preview = threading.Lock()


class RptcamEngine(bpy.types.RenderEngine):
    """Renders scenes through real lenses."""

    bl_idname = ENGINE
    bl_label = "rptcam"
    bl_use_preview = True  # of materials, in their panel and as icons
    bl_use_eevee_viewport = True  # for the viewport's shading "Material Preview"
    bl_use_shading_nodes_custom = False
    bl_use_postprocess = True

    # F12

    def update_render_passes(self, scene: Any = None, renderlayer: Any = None) -> None:
        """Say which passes there are."""
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        for each in passes_of(renderlayer, scene):
            self.register_pass(scene, renderlayer, each.name, len(each.channels), each.channels, each.kind)
        if renderlayer.use_pass_vector:
            self.register_pass(scene, renderlayer, VECTOR, 4, "XYZW", "VECTOR")

    def is_given_up(self) -> bool:
        """Whether the user has stopped the render."""
        return renders.are_ending or bool(self.test_break())

    def render(self, depsgraph: Any) -> None:
        """Render a frame."""
        with renders.counted():
            if renders.are_ending:
                return
            try:
                if self.is_preview:
                    self._preview(depsgraph)
                else:
                    self._render(depsgraph)
            except RptcamError as problem:
                self.report({"ERROR"}, str(problem))
                self.error_set(str(problem))

    def _preview(self, depsgraph: Any) -> None:
        """Render the ball, or what else a material is shown on."""
        settings = settings_of(depsgraph.scene, [], through_lens=False)
        settings.more["render"]["spp"] = PREVIEW_SAMPLES
        export = Reader().read(depsgraph, settings)
        users = [scene.rptcam for scene in bpy.data.scenes if scene.render.engine == ENGINE]
        with one_preview:  # Blender may ask for several at once
            if self.is_given_up():
                return
            previews.use(users[0].device if users else "", apart=any(given.own_process for given in users))
            session = previews.show(export.keys)
            session.add(PREVIEW_SAMPLES, self.is_given_up)
            if session.spp:
                result = self.begin_result(0, 0, *session.resolution)
                write(result.layers[0].passes["Combined"], with_alpha(session.pixels()))
                self.end_result(result)

    def _render(self, depsgraph: Any) -> None:
        scene, view_layer = depsgraph.scene, depsgraph.view_layer
        wanted = passes_of(view_layer, scene)
        layers = list(dict.fromkeys(each.layer.partition(".")[0] for each in wanted))
        if scene.render.film_transparent and "coverage" not in layers:
            layers.append("coverage")
        cleans = scene.rptcam.denoise and denoiser_trouble() is None
        layers += [name for name in GUIDES if cleans and name not in layers]
        self.update_stats("", "Reading the scene")
        settings = settings_of(scene, layers, light_groups=light_groups_of(view_layer))
        export = Reader().read(depsgraph, settings, set_time=self.frame_set)
        beside = None
        if view_layer.use_pass_vector:

            def read() -> Export:  # each frame has meshes of its own
                return Reader().read(depsgraph, settings, set_time=self.frame_set)

            beside = read_beside(read, scene, self.frame_set)
            say_beside(export, beside)
        if scene.rptcam.denoise and not cleans:
            export.report.add(f"The picture is not denoised: {denoiser_trouble()}.")
        if view_layer.material_override is not None:
            export.report.add(f"View layer {view_layer.name}: objects keep their own materials, without its override.")
        for flag, name in WITHOUT.items():
            if getattr(view_layer, flag, False):
                export.report.add(f"View layer {view_layer.name}: the pass {name} is not made.")
        say(scene, export)
        if self.is_given_up():
            return
        self.update_stats("", "Preparing the lens and compiling")
        live = kept if scene.render.use_persistent_data else LiveScene()
        live.use(scene.rptcam.device, apart=scene.rptcam.own_process)
        try:
            live.show(export.keys | {"picture": {}})
            self._take(live, export, view_layer.name, wanted, cleans, beside)
        finally:
            if live is not kept:
                live.close()

    def _take(
        self, live: LiveScene, export: Export, layer: str, wanted: list[Pass], cleans: bool, beside: Beside | None
    ) -> None:
        """Add samples until there are enough, and show the picture now and then."""
        session = live.session
        assert session is not None
        width, height = session.resolution
        for each in wanted:
            self.add_pass(each.name, len(each.channels), each.channels, layer=layer)
        if beside is not None:
            self.add_pass(VECTOR, 4, "XYZW", layer=layer)
        result = self.begin_result(0, 0, width, height, layer=layer)  # within the border
        target, shown = int(export.keys["render"]["spp"]), time.monotonic()
        step = 1
        while session.spp < target and not self.is_given_up():
            before, begun = session.spp, time.monotonic()
            session.add(min(step, target - before), self.is_given_up)
            if session.spp == before and session.is_whole:
                break  # the noise target is met
            step = max(session.samples_per_wave, step * 2 if time.monotonic() - begun < 0.5 else step)
            self.update_progress(session.spp / target)
            self.update_stats("", f"Sample {session.spp}/{target}")
            if time.monotonic() - shown > SECONDS_BETWEEN_PICTURES and session.spp:
                write(result.layers[0].passes["Combined"], with_alpha(session.pixels()))
                self.update_result(result)
                shown = time.monotonic()
        if session.spp:
            image = session.image()
            if cleans:
                image = image.denoised()
                self.get_result().stamp_data_add_field("rptcam_denoised", image.metadata["denoised"])
            write(result.layers[0].passes["Combined"], with_alpha(image.pixels, image.layers.get("coverage")))
            if beside is not None:
                write(result.layers[0].passes[VECTOR], vectors(export, beside, live))
            for each in wanted:
                layer = image.layers.get(each.layer)  # a light group may have no lamp
                values = np.zeros_like(image.pixels) if layer is None else each.made(layer, export)
                write(result.layers[0].passes[each.name], values)
        given_up = session.spp < target and self.is_given_up()
        if given_up:
            mark = f"given up after {session.spp} of {target} samples"
            self.report({"WARNING"}, mark.capitalize())
            self.get_result().stamp_data_add_field("rptcam", mark)
        self.end_result(result, cancel=given_up, do_merge_results=True)  # what there is stays

    # The viewport

    _reader: Reader | None = None
    _live: LiveScene | None = None
    _view: Any = None
    _problem = ""

    def view_update(self, context: Any, depsgraph: Any) -> None:
        """Follow the scene."""
        if self._reader is None:
            self._reader, self._live = Reader(), LiveScene()
        self._reader.forget(depsgraph.updates)
        self._view = None  # read anew when it is drawn

    def view_draw(self, context: Any, depsgraph: Any) -> None:
        """Draw the picture so far, and render some more of it."""
        from .viewport import draw

        if self._reader is None:
            self.view_update(context, depsgraph)
        assert self._reader is not None and self._live is not None
        view = view_of(context)
        try:
            if view != self._view:
                settings = settings_of(depsgraph.scene, [], through_lens=view.through_camera)
                export = self._reader.read(depsgraph, settings, eye=view.eye)
                self._live.use(depsgraph.scene.rptcam.device, apart=depsgraph.scene.rptcam.own_process)
                self._live.show(export.keys)
                self._view = view
            session = self._live.session
            assert session is not None
            begun = time.monotonic()
            target = depsgraph.scene.rptcam.viewport_samples
            while session.spp < target and time.monotonic() - begun < VIEW_SECONDS:
                session.add(1)
            pixels = session.pixels()
        except RptcamError as problem:
            self.update_stats("rptcam", str(problem))
            return
        self.update_stats("rptcam", f"Sample {session.spp}/{target}")
        draw(self, depsgraph.scene, with_alpha(pixels), view.rectangle)
        if session.spp < target:
            self.tag_redraw()


def with_alpha(pixels: Array, coverage: Array | None = None) -> Array:
    """A film with its coverage as alpha."""
    alpha = np.ones((*pixels.shape[:2], 1), np.float32) if coverage is None else coverage.reshape(*pixels.shape[:2], 1)
    return np.concatenate([pixels, alpha], axis=-1)


def denoiser_trouble() -> str | None:
    """Why pictures cannot be denoised; None where they can."""
    try:
        check_denoiser()
    except InputError as problem:
        return str(problem)
    return None


Beside = tuple[Export | None, Export | None]


def read_beside(read: Callable[[], Export], scene: Any, set_time: Callable[[int, float], None]) -> Beside:
    """The frames before and after, None for one with other objects: those of flow are known by their order."""
    now, part = scene.frame_current, scene.frame_subframe
    exports = []
    for frame in (now - 1, now + 1, now):
        set_time(frame, part)
        exports.append(read() if frame != now else None)
    return exports[0], exports[1]


def say_beside(export: Export, beside: Beside) -> None:
    """Report a frame beside whose objects are others, and objects that are deformed until then."""
    for which, other in zip(("before", "after"), beside, strict=True):
        if other is None or not has_same_objects(export, other):
            export.report.add(f"Vector: the frame {which} has other objects; its vectors are 0.")
            continue
        for one, two in zip(export.keys["objects"], other.keys["objects"], strict=True):
            shapes = [each.keys["meshes"].get(item.get("mesh"), item) for each, item in ((export, one), (other, two))]
            if all("vertices" in shape for shape in shapes) and not np.array_equal(
                shapes[0]["vertices"], shapes[1]["vertices"]
            ):
                export.report.add(f"Vector: {one['name']} is deformed; its vectors are of its motion as a whole.")


def has_same_objects(one: Export, other: Export) -> bool:
    """Whether two frames show the same objects in the same order."""
    names = [[(item.get("name"), item.get("material")) for item in each.keys["objects"]] for each in (one, other)]
    return names[0] == names[1]


def vectors(export: Export, beside: Beside, live: LiveScene) -> Array:
    """Blender's pass: from here to the place in the frame before, then from that in the next frame to here; up is +."""
    frames = tuple(still(each) if each and has_same_objects(export, each) else None for each in beside)
    names = ["flow_backward", "flow_forward"]
    image = live.render(still(export), spp=1, layers=names, neighbours=frames)
    back, forward = (np.nan_to_num(image.layers[name]) for name in names)
    return np.concatenate([back * [1, -1], forward * [-1, 1]], axis=-1)


def still(export: Export) -> dict[str, Any]:
    """The scene with the shapes that it has when the shutter opens."""
    shutter = export.keys["shutter"]
    return export.keys | {"shutter": {key: value for key, value in shutter.items() if key not in ("keys", "steps")}}


def write(into: Any, pixels: Array) -> None:
    """Fill a pass, whose bottom row comes first."""
    rows = np.ascontiguousarray(pixels[::-1], np.float32).ravel()
    into.rect.foreach_set(rows)


def say(scene: Any, export: Export) -> None:
    """Print the report and keep it for the panel."""
    for sentence in export.report.sentences:
        print(f"rptcam: {sentence}")
    REPORTS[scene.name] = export.report.sentences


REPORTS: dict[str, list[str]] = {}
"""What the last export of each scene left out."""


def register() -> None:
    """Add the engine."""
    renders.are_ending = False
    bpy.utils.register_class(RptcamEngine)


def unregister() -> None:
    """Remove it, once the renders have ended that it is in."""
    renders.end()
    kept.close()
    previews.close()
    bpy.utils.unregister_class(RptcamEngine)
