"""Reads Blender's dependency graph: objects, lamps, camera, world and materials, into records for `scene.Builder`."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .camera import BlenderCamera, Frame, LensChoice
from .lights import BlenderLamp
from .materials import BlenderMaterial
from .meshes import BlenderMesh, Strands, widths_of_particles
from .nodes import Node, ValueReader
from .report import Report
from .scene import Builder, Export, Parts, Placed, Shutter
from .shading import NodeReader, codes_of, has_nodes, output_of, space_of
from .world import environment

WITH_FACES = ("MESH", "CURVE", "SURFACE", "FONT", "META")
WITHOUT_SURFACE = ("CAMERA", "EMPTY", "ARMATURE", "LATTICE", "SPEAKER", "LIGHT_PROBE")
BAKED = "rptcam_baked"  # of an object: names of its pictures by material, node and input, as JSON
RAYS = ("camera", "shadow", "diffuse", "glossy", "transmission")
DEFAULT_RADIUS = 0.005  # of curves without a radius, as Cycles has it
SetTime = Callable[[int, float], None]


@dataclass(frozen=True)
class Settings:
    """What the panels say, apart from Blender's own settings.

    Attributes
    ----------
    lens : LensChoice
    shutter_s : float or None
        In place of that of Blender's motion blur.
    rolling_s : float
        Readout of a rolling shutter; 0 for a global one.
    light_groups : tuple of str
        Names of the view layer's light groups, where each has a pass.
    more : dict
        Further sections of the scene: ``render``, ``exposure``.
    """

    lens: LensChoice = field(default_factory=LensChoice)
    shutter_s: float | None = None
    rolling_s: float = 0.0
    light_groups: tuple[str, ...] = ()
    more: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Reading:
    """What the last reading found, but for the camera: the builder with all objects, and the world."""

    builder: Builder
    world: dict[str, Any] | None
    settings: Settings
    scene: str


@dataclass(frozen=True)
class Eye:
    """A view in place of the scene's camera, as of the viewport."""

    camera: BlenderCamera
    frame: Frame


def matrix_of(value: Any) -> NDArray[np.float64]:
    """A matrix of Blender as an array."""
    return np.array(value, np.float64)


class Reader:
    """Reads scenes, and holds meshes and pictures between two readings."""

    def __init__(self) -> None:
        self.parts = Parts()
        self._layer: Any = None  # the view layer that is read
        self._pictures: dict[tuple[str, str, bool], NDArray[Any] | None] = {}  # by name, file of a frame, alpha
        self._strands: dict[str, Strands | None] = {}  # by the object that has them
        self._last: _Reading | None = None
        self._moved: set[str] = set()  # objects that have moved since, and done nothing else
        self._instanced: set[str] = set()  # objects that others place as well
        self._shaded: set[str] = set()  # objects of which a material, or how they are seen, is another since
        self._renewed: set[str] = set()  # materials that are others since
        self._looks: dict[str, Any] = {}  # of each object, as it was read
        self._shown_by: dict[str, str] = {}  # the mesh by which a material was read

    def read(
        self, depsgraph: Any, settings: Settings, *, eye: Eye | None = None, set_time: SetTime | None = None
    ) -> Export:
        """Read the scene of a dependency graph; ``set_time`` moves it in time for motion blur.

        Without it, what `forget` has not been told of is taken to be as it was.
        """
        scene, report = depsgraph.scene_eval, Report()
        frame = eye.frame if eye else frame_of(scene)
        if set_time is None and (last := self._still_valid(depsgraph, settings)) is not None:
            camera = eye.camera if eye else camera_of(scene, report)
            group = getattr(scene.world, "lightgroup", "")
            return last.builder.export(camera, frame, settings.lens, last.world, settings.more, group)
        fps = scene.render.fps / scene.render.fps_base
        blurred = bool(scene.render.use_motion_blur and set_time is not None)
        shutter_s = settings.shutter_s or scene.render.motion_blur_shutter / fps
        shutter = Shutter(shutter_s, blurred, settings.rolling_s)
        units = scene.unit_settings
        scale = float(units.scale_length) if units.system != "NONE" else 1.0
        builder = Builder(self.parts, scale, report, shutter, settings.light_groups)
        ends: dict[Any, NDArray[np.float64]] = {}
        shapes: dict[str, BlenderMesh] = {}
        restore: tuple[int, float] | None = None
        if blurred and set_time is not None:
            restore, (first, last) = (scene.frame_current, scene.frame_subframe), shutter_times(scene, shutter_s * fps)
            set_time(math.floor(last), last - math.floor(last))
            ends, shapes = self._matrices(depsgraph), _shapes(depsgraph)
            set_time(math.floor(first), first - math.floor(first))
            scene = depsgraph.scene_eval
        camera = eye.camera if eye else camera_of(scene, report)
        if scene.camera is not None and not eye and (end := ends.get("camera")) is not None:
            moves = not np.array_equal(end, camera.matrix)
            camera = replace(camera, matrix_end=end if moves else None)
        self._read_instances(depsgraph, builder, report, ends, shapes)
        world = self._read_world(scene, depsgraph.view_layer, report)
        group = getattr(scene.world, "lightgroup", "")
        self._last = None if set_time is not None else _Reading(builder, world, settings, scene.name_full)
        for since in (self._moved, self._shaded, self._renewed):
            since.clear()
        export = builder.export(camera, frame, settings.lens, world, settings.more, group)
        if restore is not None and set_time is not None:
            set_time(*restore)
        return export

    def forget(self, updates: Iterable[Any]) -> None:
        """Forget what an update of the dependency graph has changed."""
        for update in updates:
            name = update.id.name_full
            what = getattr(update.id, "type", "") if isinstance(update.id, bpy.types.Object) else ""
            if what == "CAMERA" or isinstance(update.id, bpy.types.Camera):
                continue
            if what and update.is_updated_transform and not (update.is_updated_geometry or update.is_updated_shading):
                self._moved.add(name)
                continue
            is_shading = update.is_updated_shading and not (update.is_updated_geometry or update.is_updated_transform)
            if isinstance(update.id, bpy.types.Material):
                self._renewed.add(name)
                continue
            if what and is_shading:
                self._shaded.add(name)
                continue
            if (isinstance(update.id, bpy.types.Mesh) and is_shading) or getattr(update.id, "is_embedded_data", False):
                continue  # its object, material, world or lamp is in the list as well
            self._last = None
            if isinstance(update.id, bpy.types.Image):
                self._pictures = {key: codes for key, codes in self._pictures.items() if key[0] != name}
            elif getattr(update, "is_updated_geometry", False):
                for key in self.parts.held():
                    if key.startswith("instanced ") or key in (f"object {name}", f"data {name}"):
                        self.parts.drop(key)
                self._strands = {key: held for key, held in self._strands.items() if not key.startswith("of data")}
                self._strands.pop(name, None)
                data = getattr(update.id, "data", None)
                if data is not None:
                    self.parts.drop(f"data {data.name_full}")

    def _still_valid(self, depsgraph: Any, settings: Settings) -> _Reading | None:
        """The last reading with what has only moved since then at its place; None where more is to be read."""
        last, scene = self._last, depsgraph.scene_eval
        if last is None or last.settings != settings or last.scene != scene.name_full:
            return None
        moved, self._moved = self._moved, set()
        shaded, self._shaded, renewed, self._renewed = self._shaded, set(), self._renewed, set()
        known = {item.name_full: item for item in bpy.data.objects} if shaded or moved else {}  # get() looks at each
        for name in shaded:
            item = known.get(name)
            if item is None or _looks_of(item) != self._looks.get(name):
                return None
        for name in renewed:
            material, report = bpy.data.materials.get(name), Report()
            if material is None:
                return None
            key = self._shown_by.get(name, "")
            mesh = self.parts.mesh(key) if key in self.parts else None
            made = self.material_of(material, mesh, report)
            if report or not last.builder.renew_material(made, material.pass_index):
                return None
        for name in moved:
            item = known.get(name)
            if name in self._instanced or item is None or item.type not in WITH_FACES or not _is_alone(item):
                return None
            if not last.builder.move(name, matrix_of(item.evaluated_get(depsgraph).matrix_world)):
                return None
        return last

    # Objects

    def _matrices(self, depsgraph: Any) -> dict[Any, NDArray[np.float64]]:
        """Where everything is at the time of the dependency graph."""
        found = {_identity(each): matrix_of(each.matrix_world) for each in depsgraph.object_instances}
        camera = depsgraph.scene_eval.camera
        if camera is not None:
            found["camera"] = matrix_of(camera.evaluated_get(depsgraph).matrix_world)
        return found

    def _read_instances(
        self,
        depsgraph: Any,
        builder: Builder,
        report: Report,
        ends: dict[Any, NDArray[np.float64]],
        shapes: dict[str, BlenderMesh],
    ) -> None:
        is_final, layer = depsgraph.mode == "RENDER", depsgraph.view_layer
        self._layer = layer
        self._instanced.clear()
        self._looks.clear()
        self._shown_by.clear()
        for each in depsgraph.object_instances:
            item = each.object
            if item.name_full not in self._looks:
                self._looks[item.name_full] = _looks_of(item)
                _say_linking(item, report)
            if each.is_instance:
                self._instanced.add(item.name_full)
            if each.show_particles and len(item.particle_systems) and layer.use_strand:
                self._read_particles(each, ends.get(_identity(each)), builder, report, is_final=is_final)
            if not each.show_self:
                continue
            matrix = matrix_of(each.matrix_world)
            end = ends.get(_identity(each))
            if end is not None and np.allclose(end, matrix, rtol=0, atol=1e-9):
                end = None
            if item.type == "LIGHT":
                if end is not None:
                    report.add(f"Lamp {item.name}: it stands still while the shutter is open.")
                if not _is_portal(item.data):  # which shows where light comes from, and sends none
                    builder.add_lamp(lamp_of(item, matrix, self, report))
            elif item.type == "CURVES":
                if not layer.use_strand:
                    continue
                strands = self._strands.setdefault(item.name_full, None) or strands_of(item.data)
                self._strands[item.name_full] = strands
                builder.place_strands(self._placed(each, "", matrix, end, builder, report), strands)
            elif item.type in WITH_FACES:
                if layer.use_solid:
                    self._read_object(each, matrix, end, shapes, builder, report)
            elif item.type not in WITHOUT_SURFACE:
                report.add(f"Object {item.name}: {item.type.replace('_', ' ').lower()} is left out.")

    def _read_object(
        self,
        each: Any,
        matrix: NDArray[np.float64],
        end: NDArray[np.float64] | None,
        shapes: dict[str, BlenderMesh],
        builder: Builder,
        report: Report,
    ) -> None:
        item = each.object
        key = mesh_key(each)
        if key not in self.parts:
            mesh = mesh_of(item)
            if mesh is None:
                return
            self.parts.put(key, mesh)
        if item.is_shadow_catcher:
            report.add(f"Object {item.name}: a shadow catcher is seen like any other object.")
        shape = shapes.get(key)
        if shape is not None and np.array_equal(shape.points, self.parts.mesh(key).points):
            shape = None
        builder.place(replace(self._placed(each, key, matrix, end, builder, report), mesh_end=shape))

    def _placed(
        self,
        each: Any,
        key: str,
        matrix: NDArray[np.float64],
        end: NDArray[np.float64] | None,
        builder: Builder,
        report: Report,
    ) -> Placed:
        """An object with its materials, which are added."""
        item, names = each.object, []
        mesh = self.parts.mesh(key) if key in self.parts else None
        pictures = {tuple(json.loads(key)): name for key, name in json.loads(item.get(BAKED, "{}")).items()}
        for slot in item.material_slots:
            material = slot.material
            if not material:
                names.append("")
                continue
            baked = {(node, into): name for (of, node, into), name in pictures.items() if of == material.name_full}
            name = f"{material.name_full} of {item.name_full}" if baked else material.name_full
            names.append(name)
            if baked:
                report.add(f"Object {item.name}: {len(baked)} inputs of {material.name} are pictures that were baked.")
            if not builder.has_material(name):
                self._shown_by[name] = key
                made = replace(self.material_of(material, mesh, report, baked), name=name)
                builder.add_material(made, material.pass_index, material.name)
        group = getattr(item, "lightgroup", "")
        visible, own_name = self._visible(each, report), item.name if item.name != item.name_full else ""
        return Placed(
            item.name_full, key, matrix, tuple(names), visible, item.pass_index, group, end, own_name=own_name
        )

    def _visible(self, each: Any, report: Report) -> dict[str, bool]:
        """Which rays meet an instance: those that meet the object and what places it."""
        owners = [each.object] + ([each.parent] if each.parent is not None else [])
        seen = [visibility(item, report) for item in owners]
        found = {name: all(one[name] for one in seen) for name in seen[0]}
        if any(item.original.indirect_only_get(view_layer=self._layer) for item in owners):
            found["camera"] = False
        if any(item.original.holdout_get(view_layer=self._layer) for item in owners):
            report.add(f"Object {each.object.name}: a holdout is seen like any other object.")
        return found

    def _read_particles(
        self, each: Any, end: NDArray[np.float64] | None, builder: Builder, report: Report, *, is_final: bool
    ) -> None:
        """The hair of an object's particle systems."""
        item, matrix = each.object, matrix_of(each.matrix_world)
        shown = {modifier.particle_system.name: modifier for modifier in item.modifiers
                 if modifier.type == "PARTICLE_SYSTEM"}  # fmt: skip
        for system in item.particle_systems:
            modifier, settings = shown.get(system.name), system.settings
            if settings.type != "HAIR" or settings.render_type != "PATH" or modifier is None:
                continue
            if not (modifier.show_render if is_final else modifier.show_viewport):
                continue
            key = f"of data {item.name_full} {system.name}"
            strands = self._strands.get(key) or particles_of(item, system, matrix, is_final=is_final)
            self._strands[key] = strands
            placed = self._placed(each, "", matrix, end, builder, report)
            slot = min(max(settings.material - 1, 0), max(len(placed.materials) - 1, 0))
            builder.place_strands(replace(placed, materials=placed.materials[slot : slot + 1]), strands)

    # Materials

    def material_of(
        self, material: Any, mesh: BlenderMesh | None, report: Report, baked: dict[tuple[str, str], str] | None = None
    ) -> BlenderMaterial:
        """A material's record.

        The mesh says how large its texture coordinates are, and `baked` which inputs of which nodes are pictures.
        """
        nodes = NodeReader(self, 1.0 if mesh is None else mesh.uv_size, report, baked)
        output = output_of(material.node_tree) if has_nodes(material) else None
        surface = nodes.linked(output, "Surface") if output is not None else None
        if output is not None and surface is None:
            surface = Node("BSDF_DIFFUSE", "nothing", {"Color": (0.0, 0.0, 0.0)})
        return BlenderMaterial(
            material.name_full,
            surface,
            tuple(material.diffuse_color),
            material.metallic,
            material.roughness,
            output is not None and output.inputs["Displacement"].is_linked,
            output is not None and output.inputs["Volume"].is_linked,
        )

    def _read_world(self, scene: Any, view_layer: Any, report: Report) -> dict[str, Any] | None:
        world = scene.world
        if world is None or not view_layer.use_sky:
            return None
        nodes = NodeReader(self, 1.0, report)
        made: dict[str, Any] | None = None
        if not has_nodes(world):
            made = environment(None, tuple(world.color), report)
        elif (output := output_of(world.node_tree)) is not None:
            if output.inputs["Volume"].is_linked:
                report.add("World: its volume is left out.")
            surface = nodes.linked(output, "Surface")
            made = None if surface is None else environment(surface, tuple(world.color), report)
        rays = getattr(world, "cycles_visibility", None)
        if not all(getattr(rays, name, True) for name in ("diffuse", "glossy", "transmission")):
            report.add("World: hidden from some kinds of rays in Blender, from the camera alone here.")
        return made if made is None or getattr(rays, "camera", True) else made | {"visible": {"camera": False}}

    def picture(
        self, image: Any, report: Report, user: Any = None, *, keeps_alpha: bool = True
    ) -> tuple[NDArray[Any] | None, str]:
        """The codes of a picture at the frame of its user, top row first, and its colour space.

        Where nothing takes the alpha of the node, colours are multiplied by it, as in Cycles.
        """
        file = ""
        if image.source == "SEQUENCE" and user is not None:
            file = image.filepath_from_user(image_user=user)
        elif image.source in ("TILED", "SEQUENCE", "MOVIE"):
            report.add(f"Picture {image.name}: of a {image.source.lower()} picture what Blender holds now is shown.")
        key = (image.name_full, file, keeps_alpha)
        if key not in self._pictures:
            self._pictures[key] = codes_of(image, file, keeps_alpha=keeps_alpha)
        codes = self._pictures[key]
        space = space_of(image, codes)
        if space not in ("linear", "srgb"):
            report.add(f"Picture {image.name}: its colour space {space} is read as sRGB.")
        return codes, "linear" if space == "linear" else "srgb"


def _looks_of(item: Any) -> Any:
    """What an object's update of shading may mean, but for its materials themselves."""
    names = tuple(slot.material.name_full if slot.material else "" for slot in item.material_slots)
    seen = tuple(getattr(item, f"visible_{name}", True) for name in RAYS)
    return names, seen, item.pass_index, getattr(item, "lightgroup", ""), item.hide_render, item.get(BAKED)


def _is_alone(item: Any) -> bool:
    """Whether nothing else is placed by an object, and its place is all that follows from its matrix."""
    places_others = item.is_instancer or item.instance_type != "NONE" or len(item.particle_systems) > 0
    return not places_others and not item.modifiers


def _identity(each: Any) -> Any:
    parent = each.parent.name_full if each.parent else ""
    return each.object.name_full, parent, tuple(each.persistent_id)


def mesh_key(each: Any) -> str:
    """Names the mesh of an instance: objects without modifiers share that of their data."""
    item = each.object
    original = item.original
    if each.is_instance and original.data is not None and item.data is not None and item.type == "MESH":
        same = item.data.name_full == original.data.name_full
        if not same or (original.original.type != "MESH"):
            return f"instanced {item.name_full} {item.data.as_pointer()}"
    deforms = len(original.modifiers) > 0 or getattr(original.data, "shape_keys", None) is not None
    if item.type != "MESH" or deforms:
        return f"object {item.name_full}"
    return f"data {item.data.name_full}"


def deforms_in_time(item: Any) -> bool:
    """Whether modifiers or shape keys may change an object's shape while the shutter is open."""
    bends = {"ARMATURE", "MESH_DEFORM", "LATTICE", "HOOK", "WAVE", "CLOTH", "SOFT_BODY", "NODES", "MESH_CACHE"}
    keys = getattr(item.original.data, "shape_keys", None)
    return any(each.type in bends for each in item.original.modifiers) or bool(keys and keys.animation_data)


def _shapes(depsgraph: Any) -> dict[str, BlenderMesh]:
    """The meshes of what may be deformed, as they are at the time of the dependency graph."""
    found: dict[str, BlenderMesh] = {}
    for each in depsgraph.object_instances:
        if each.object.type in WITH_FACES and each.show_self and deforms_in_time(each.object):
            key = mesh_key(each)
            mesh = mesh_of(each.object) if key.startswith("object ") and key not in found else None
            if mesh is not None:
                found[key] = mesh
    return found


def mesh_of(item: Any) -> BlenderMesh | None:
    """The evaluated mesh of an object; None where it has no faces."""
    mesh = item.data if item.type == "MESH" else item.to_mesh()
    if mesh is None or not len(mesh.polygons):
        if item.type != "MESH":
            item.to_mesh_clear()
        return None
    mesh.calc_loop_triangles()
    points = _array(mesh.vertices, "co", 3, np.float32)
    made = BlenderMesh(
        points,
        _array(mesh.loops, "vertex_index", 1, np.int32).ravel(),
        _array(mesh.loop_triangles, "loops", 3, np.int32),
        _array(mesh.loop_triangles, "material_index", 1, np.int32).ravel(),
        _array(mesh.corner_normals, "vector", 3, np.float32),
        _uvs(mesh),
        mesh.normals_domain == "FACE",
        _colors(mesh),
    )
    if item.type != "MESH":
        item.to_mesh_clear()
    return made


def strands_of(curves: Any) -> Strands:
    """The strands of a curves object."""
    points = _array(curves.attributes["position"].data, "vector", 3, np.float32)
    radius = curves.attributes.get("radius")
    radii = np.full(len(points), DEFAULT_RADIUS, np.float32)
    if radius is not None:
        radii = _array(radius.data, "value", 1, np.float32).ravel()
    counts = _array(curves.curves, "points_length", 1, np.int32).ravel()
    return Strands(points, 2 * radii, counts)


def particles_of(item: Any, system: Any, matrix: NDArray[np.float64], *, is_final: bool) -> Strands:
    """The hair of a particle system, its children in place of their parents where it has any."""
    settings, parents, children = system.settings, len(system.particles), len(system.child_particles)
    steps = 2 ** (settings.render_step if is_final else settings.display_step) + 1
    first = parents if settings.child_type != "NONE" and children else 0
    rows = [
        system.co_hair(object=item, particle_no=number, step=step)
        for number in range(first, parents + children) for step in range(steps)
    ]  # fmt: skip
    world = np.array(rows, np.float64).reshape(-1, 3)
    inverse = np.linalg.inv(matrix)
    points = world @ inverse[:3, :3].T + inverse[:3, 3]
    scale = settings.radius_scale
    widths = widths_of_particles(
        steps, scale * settings.root_radius, scale * settings.tip_radius, settings.shape,
        is_closed=settings.use_close_tip,
    )  # fmt: skip
    count = parents + children - first
    return Strands(points.astype(np.float32), np.tile(widths, count), np.full(count, steps, np.int32))


def _uvs(mesh: Any) -> dict[str, NDArray[np.float32]]:
    """Texture coordinates by name, those that are rendered first."""
    layers = sorted(mesh.uv_layers, key=lambda layer: not layer.active_render)
    return {layer.name: _array(layer.uv, "vector", 2, np.float32) for layer in layers}


def _colors(mesh: Any) -> dict[str, NDArray[np.float32]]:
    """Color attributes by name, at corners, linear; the one that is rendered first."""
    attributes, loops = mesh.color_attributes, _array(mesh.loops, "vertex_index", 1, np.int32).ravel()
    found = {}
    for _, attribute in sorted(enumerate(attributes), key=lambda each: each[0] != attributes.render_color_index):
        rows = _array(attribute.data, "color", 4, np.float32)[:, :3]
        found[attribute.name] = rows if attribute.domain == "CORNER" else rows[loops]
    return found


def _array(collection: Any, name: str, width: int, dtype: type) -> NDArray[Any]:
    values = np.empty(len(collection) * width, dtype)
    collection.foreach_get(name, values)
    return values.reshape(-1, width)


def visibility(item: Any, report: Report) -> dict[str, bool]:
    """Which rays meet an object."""
    rays = {name: getattr(item, f"visible_{name}", True) for name in RAYS[2:]}
    if len(set(rays.values())) > 1:
        hidden = " and ".join(name for name, seen in rays.items() if not seen)
        report.add(f"Object {item.name}: hidden from {hidden} rays alone in Blender, from all reflections here.")
    return {"camera": item.visible_camera, "shadow": item.visible_shadow, "reflection": all(rays.values())}


def _is_portal(lamp: Any) -> bool:
    return lamp.type == "AREA" and bool(getattr(getattr(lamp, "cycles", None), "is_portal", False))


def _say_linking(item: Any, report: Report) -> None:
    """Report that the light of an object reaches all others."""
    linking = getattr(item, "light_linking", None)
    if linking is not None and (linking.receiver_collection or linking.blocker_collection):
        report.add(f"Object {item.name}: its light reaches all objects, and all shadow it, without its light linking.")


def lamp_of(item: Any, matrix: NDArray[np.float64], reader: Reader, report: Report) -> BlenderLamp:
    """A lamp's record."""
    lamp = item.data
    power = np.array(lamp.color, np.float64) * lamp.energy
    if getattr(lamp, "use_temperature", False):
        power = power * np.array(lamp.temperature_color[:3])
    power *= 2.0 ** getattr(lamp, "exposure", 0.0)
    if has_nodes(lamp):
        power = power * _lamp_nodes(lamp, reader, report)
    visible = visibility(item, report)
    del visible["shadow"]
    if not getattr(getattr(lamp, "cycles", None), "cast_shadow", True) or not getattr(lamp, "use_shadow", True):
        report.add(f"Lamp {item.name}: things in its light cast shadows here.")
    size = (getattr(lamp, "size", 1.0), getattr(lamp, "size_y", 1.0))
    return BlenderLamp(
        item.name_full,
        lamp.type,
        matrix,
        (float(power[0]), float(power[1]), float(power[2])),
        radius=getattr(lamp, "shadow_soft_size", 0.0),
        spot_size=getattr(lamp, "spot_size", 0.0),
        spot_blend=getattr(lamp, "spot_blend", 0.0),
        angle=getattr(lamp, "angle", 0.0),
        shape=getattr(lamp, "shape", "SQUARE"),
        size=size,
        spread=getattr(lamp, "spread", math.pi),
        visible=visible,
        normalized=getattr(lamp, "normalize", True),
        soft=getattr(lamp, "use_soft_falloff", False),
        group=getattr(item, "lightgroup", ""),
        hidden_from=tuple(name for name in RAYS[2:] if not getattr(item, f"visible_{name}", True)),
    )


def _lamp_nodes(lamp: Any, reader: Reader, report: Report) -> NDArray[np.float64]:
    """The colour by which a lamp's nodes multiply its power."""
    output = output_of(lamp.node_tree)
    surface = NodeReader(reader, 1.0, report).linked(output, "Surface") if output is not None else None
    if surface is None or surface.kind != "EMISSION":
        report.add(f"Lamp {lamp.name}: its nodes are left out.")
        return np.ones(3)
    values = ValueReader(f"Lamp {lamp.name}", report)
    strength = values.field(surface, "Strength", 1.0).number
    return np.asarray(values.field(surface, "Color", (1.0, 1.0, 1.0)).colour, np.float64) * strength


# Camera and time


def frame_of(scene: Any) -> Frame:
    """The picture of a scene."""
    render = scene.render
    share = render.resolution_percentage  # whole numbers, as Blender rounds
    size = (max(render.resolution_x * share // 100, 1), max(render.resolution_y * share // 100, 1))
    border = None
    if render.use_border:
        border = (render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y)
    return Frame(size, (render.pixel_aspect_x, render.pixel_aspect_y), border, render.film_transparent)


def camera_of(scene: Any, report: Report) -> BlenderCamera:
    """The record of the scene's camera."""
    brightened = getattr(getattr(scene, "cycles", None), "film_exposure", 1.0)
    if brightened != 1:
        report.add(f"Film: Cycles multiplies its light by {brightened:g} (Exposure, in its render properties).")
    if scene.camera is None:
        report.add("The scene has no camera; it is seen from where Blender puts a new one.")
        return BlenderCamera(matrix_of(((1, 0, 0, 0), (0, 0, -1, -10), (0, 1, 0, 0), (0, 0, 0, 1))))
    if np.linalg.det(matrix_of(scene.camera.matrix_world)[:3, :3]) < 0:
        report.add("Camera: mirrored by its scale, which the picture is not.")
    space = getattr(getattr(bpy.data, "colorspace", None), "working_space", "Linear Rec.709")  # from Blender 5.0 on
    if space != "Linear Rec.709":
        report.add(f"Colours: the file's working space {space} is taken for Linear Rec.709.")
    if scene.render.use_multiview:
        report.add("Stereoscopy: each view shows what the camera itself sees.")
    return record_of(scene.camera)


def record_of(item: Any) -> BlenderCamera:
    """The record of a camera object."""
    data = item.data
    matrix = matrix_of(item.matrix_world)
    dof = data.dof
    distance = dof.focus_distance
    if dof.focus_object is not None:
        back = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        to = _place_of(dof.focus_object, dof.focus_subtarget) - matrix[:3, 3]
        distance = abs(float(to @ back))
    return BlenderCamera(
        matrix,
        data.lens,
        (data.sensor_width, data.sensor_height),
        data.sensor_fit,
        (data.shift_x, data.shift_y),
        data.type,
        data.ortho_scale,
        dof.aperture_fstop if dof.use_dof else None,
        max(distance, 1e-6),
        dof.aperture_blades,
        dof.aperture_rotation,
        dof.aperture_ratio,
        data.clip_start,
        panorama=getattr(data, "panorama_type", "EQUIRECTANGULAR"),
        clip_end=data.clip_end,
    )


def _place_of(item: Any, bone: str) -> NDArray[np.float64]:
    """Where an object stands, or one of its bones."""
    matrix = matrix_of(item.matrix_world)
    if bone and item.pose is not None and bone in item.pose.bones:
        matrix = matrix @ matrix_of(item.pose.bones[bone].matrix)
    return matrix[:3, 3]


def shutter_times(scene: Any, frames: float) -> tuple[float, float]:
    """When the shutter opens and closes [frames]."""
    now = scene.frame_current + scene.frame_subframe
    begin = {"START": 0.0, "CENTER": -0.5, "END": -1.0}[getattr(scene.render, "motion_blur_position", "CENTER")]
    return now + begin * frames, now + (begin + 1) * frames
