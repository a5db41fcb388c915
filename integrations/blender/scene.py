"""A scene put together from what was read of Blender: meshes by content, materials by name, objects placed, moved."""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera import BlenderCamera, Frame, LensChoice, camera_keys, keyframes
from .fields import Field, Mapping
from .lights import BlenderLamp, lamp_keys
from .materials import BlenderMaterial, Translated, for_strands, translate, without_hair
from .meshes import BlenderMesh, Strands, can_be_inverted, deformed, movement, painted, part
from .report import Report

DEFAULT = "no_material"
MOST_STEPS, LEAST_STEPS = 32, 4  # of an exposure in which something is deformed
MOST_STEPPED = 8_000_000  # triangles of all steps, some 200 bytes each
Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Shutter:
    """When light falls on the film [s]; `moves` says whether things move meanwhile."""

    time_s: float = 1 / 48
    moves: bool = False
    rolling_s: float = 0.0


@dataclass(frozen=True)
class Placed:
    """One appearance of a mesh.

    Attributes
    ----------
    name, mesh
        Of the object, and the key of its mesh.
    matrix, matrix_end
        World from object when the shutter opens, and when it closes if it moves.
    materials : tuple of str
        Names of the materials of its slots.
    visible : dict
        As scenes have it.
    index : int
        Blender's pass index.
    group : str
        Blender's light group, or nothing.
    mesh_end : BlenderMesh or None
        Its shape when the shutter closes, if that is another.
    own_name : str
        Its name without its library, if that is another.
    """

    name: str
    mesh: str
    matrix: Matrix
    materials: tuple[str, ...]
    visible: dict[str, bool] = field(default_factory=dict)
    index: int = 0
    group: str = ""
    matrix_end: Matrix | None = None
    mesh_end: BlenderMesh | None = None
    own_name: str = ""


@dataclass(frozen=True)
class Export:
    """A scene as `rptcam_cl.load_scene` takes it, what it leaves out, Blender's indices and names of what is in it."""

    keys: dict[str, Any]
    report: Report
    object_indices: NDArray[np.int32]
    material_indices: NDArray[np.int32]
    own_names: dict[str, str] = field(default_factory=dict)


def group_name(groups: Sequence[str], group: str) -> str:
    """The name of one of Blender's light groups in scenes, which have no spaces; of lamps in none of them."""
    return f"group_{groups.index(group)}" if group in groups else "ungrouped"


def safe(name: str) -> str:
    """The name as part of a key path, where dots part the keys and numbers count; others have others."""
    plain = re.sub(r"[.\[\]]", "_", name)[:180]
    return f"m {plain}" if plain == name else f"m {plain} {zlib.crc32(name.encode()):08x}"


class Parts:
    """Meshes split by material, kept between exports: a mesh that stays is the same array again."""

    def __init__(self) -> None:
        self._meshes: dict[str, BlenderMesh] = {}
        self._parts: dict[tuple[str, int, str], dict[str, Any] | None] = {}
        self._texels: dict[tuple[str, int, str], NDArray[np.float32] | None] = {}

    def __contains__(self, key: str) -> bool:
        return key in self._meshes

    def put(self, key: str, mesh: BlenderMesh) -> None:
        """Take a mesh that was read."""
        self.drop(key)
        self._meshes[key] = mesh

    def mesh(self, key: str) -> BlenderMesh:
        """The mesh as it was read."""
        return self._meshes[key]

    def drop(self, key: str) -> None:
        """Forget a mesh that has changed."""
        self._meshes.pop(key, None)
        self._parts = {of: value for of, value in self._parts.items() if of[0] != key}
        self._texels = {of: value for of, value in self._texels.items() if of[0] != key}

    def held(self) -> list[str]:
        """The meshes that are held."""
        return list(self._meshes)

    def slots(self, key: str) -> list[int]:
        """Material slots that have triangles."""
        return [int(slot) for slot in np.unique(self._meshes[key].slot)]

    def of(self, key: str, slot: int, coordinates: str) -> dict[str, Any] | None:
        """The keys of a part."""
        place = (key, slot, coordinates)
        if place not in self._parts:
            self._parts[place] = part(self._meshes[key], slot, coordinates)
        return self._parts[place]

    def texels(self, key: str, slot: int, name: str) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
        """Colours of vertices of a part: as a picture, None where they are too many, and at its corners."""
        mesh = self._meshes[key]
        colors = mesh.colors.get(name or next(iter(mesh.colors), ""))
        if colors is None:
            return None, None
        place = (key, slot, f"color:{name}")
        if place not in self._texels:
            found = painted(mesh, slot, name)
            self._parts[place], self._texels[place] = found or (part(mesh, slot, "uv"), None)
        return self._texels[place], colors[mesh.triangles[mesh.slot == slot].ravel()]


class Builder:
    """Collects what one export consists of."""

    def __init__(
        self,
        parts: Parts,
        metres_per_unit: float,
        report: Report,
        shutter: Shutter,
        light_groups: Sequence[str] = (),
    ) -> None:
        self._parts, self._units, self._report, self._shutter = parts, metres_per_unit, report, shutter
        self._light_groups = light_groups
        self._materials: dict[str, Translated] = {}
        self._marks: dict[str, tuple[int, str]] = {}  # of materials: pass index, and name in Blender without a library
        self._own_names: dict[str, str] = {}  # of objects that have another in Blender
        self._said: dict[str, list[str]] = {}  # in translating each
        self._of_colors: dict[str, BlenderMaterial] = {}
        self._meshes: dict[str, Any] = {}
        self._objects: list[dict[str, Any]] = []
        self._indices: list[int] = []
        self._deformed: dict[str, list[dict[str, Any]]] = {}  # keys of objects that move while the shutter is open
        self._places: dict[str, list[int]] = {}  # of the objects of each name
        self._stepped: dict[str, None] = {}  # names of the objects that these are of
        self._lights: list[dict[str, Any]] = []
        self._bounds: list[Matrix] = []  # corners of boxes round all that is placed

    @property
    def blurs(self) -> bool:
        """Whether things move while the shutter is open."""
        return self._shutter.moves

    def has_material(self, name: str) -> bool:
        """Whether a material was added already."""
        return name in self._materials

    def add_material(self, material: BlenderMaterial, index: int = 0, own_name: str = "") -> None:
        """Translate a material, which Blender marks by a name and an index.

        One that takes the colours of vertices waits for the meshes that show it.
        """
        report = Report()
        self._materials[material.name] = made = translate(material, report)
        self._marks[material.name] = index, own_name or material.name
        self._said[material.name] = report.sentences
        if made.takes_colors:
            self._of_colors[material.name] = material
        else:
            self._report.extend(report)

    def renew_material(self, material: BlenderMaterial, index: int) -> bool:
        """Translate a material anew; return whether that is all that is to be done."""
        name, report = material.name, Report()
        if any(other.startswith((f"{name} on ", f"{name} of ")) for other in self._materials):
            return False
        before, made = self._materials.get(name), translate(material, report)
        if before is None:
            return True  # nothing shows it
        same = made.coordinates == before.coordinates and report.sentences == self._said[name]
        if not same or made.takes_colors or before.takes_colors or "hair" in (made.keys["kind"], before.keys["kind"]):
            return False
        self._materials[name], self._marks[name] = made, (index, self._marks[name][1])
        return True

    def _painted(self, material: str, mesh: str, slot: int) -> str:
        """The name of a material as the colours of a mesh make it."""
        base = self._materials[material]
        name = f"{material} on {mesh} {slot}"
        if name in self._materials:
            return name

        def paint(attribute: str) -> Field | None:
            texels, colors = self._parts.texels(mesh, slot, attribute)
            if colors is None:
                return None
            if colors.min() < 0 or colors.max() > 1:
                self._report.add(f"Material {material}: colours of vertices are cut at 0 and 1.")
            if texels is not None and base.coordinates == f"color:{attribute}":
                return Field(texels, Mapping(source=base.coordinates), "clamp")
            if texels is None:
                self._report.add(f"Material {material}: colours of so many vertices are their mean.")
            return Field(np.clip(colors, 0, 1).mean(axis=0))

        self._materials[name] = translate(self._of_colors[material], self._report, paint)
        self._marks[name] = self._marks[material]
        return name

    def place(self, item: Placed) -> None:
        """Show a mesh, one object for each material."""
        if not can_be_inverted(item.matrix):
            self._report.add(f"Object {item.name}: flat by its scale, left out.")
            return
        motion: list[dict[str, Any]] = []
        grows = False
        if item.matrix_end is not None:
            motion, whole = movement(item.matrix, item.matrix_end, (0.0, self._shutter.time_s))
            grows = not whole
        self._bounds.append(self._parts.mesh(item.mesh).corners @ item.matrix[:3, :3].T + item.matrix[:3, 3])
        for slot in self._parts.slots(item.mesh):
            name = item.materials[min(slot, len(item.materials) - 1)] if item.materials else DEFAULT
            if name not in self._materials:
                self.add_material(BlenderMaterial(DEFAULT, None))
                name = DEFAULT
            self._show(item, slot, name, motion, grows)

    def place_strands(self, item: Placed, strands: Strands) -> None:
        """Show hair, of the first of the item's materials."""
        shape = strands.keys()
        if shape is None or not can_be_inverted(item.matrix):
            return
        name = item.materials[0] if item.materials else DEFAULT
        if name not in self._materials:
            self.add_material(BlenderMaterial(DEFAULT, None))
            name = DEFAULT
        own = f"{name} on strands"
        if own not in self._materials:
            keys = for_strands(self._materials[name].keys, name, self._report)
            self._materials[own], self._marks[own] = Translated(keys), self._marks[name]
        motion: list[dict[str, Any]] = []
        if item.matrix_end is not None:
            motion, _ = movement(item.matrix, item.matrix_end, (0.0, self._shutter.time_s))
        self._add(item, shape, own, motion)

    def _add(self, item: Placed, shape: dict[str, Any], material: str, motion: list[dict[str, Any]]) -> None:
        """Add an object of a shape."""
        keys: dict[str, Any] = shape | {
            "material": safe(material),
            "name": item.name[:200],
            "transform": {"matrix": np.asarray(item.matrix, np.float64)[:3].tolist()},
            **self._grouped(item.group),
        }
        hidden = {key: False for key, seen in item.visible.items() if not seen}
        made = self._materials[material].keys
        if "reflection" in hidden and (made["kind"] == "emissive" or "emission" in made):
            self._report.add(f"Object {item.name}: its light falls on all others, where Blender hides it from them.")
        keys |= ({"visible": hidden} if hidden else {}) | ({"motion": motion} if motion else {})
        self._places.setdefault(item.name, []).append(len(self._objects))
        self._objects.append(keys)
        self._indices.append(item.index)
        if item.own_name:
            self._own_names[keys["name"]] = item.own_name

    def move(self, name: str, matrix: Matrix) -> bool:
        """Place the objects of a name elsewhere; return whether that is all that is to be done."""
        places = self._places.get(name, [])
        if not places or not can_be_inverted(matrix):
            return False
        objects = list(self._objects)  # an earlier export has the other
        for place in places:
            objects[place] = objects[place] | {"transform": {"matrix": matrix[:3].tolist()}}
        self._objects = objects
        return True

    def _show(self, item: Placed, slot: int, material: str, motion: list[dict[str, Any]], grows: bool) -> None:
        if material in self._of_colors:
            material = self._painted(material, item.mesh, slot)
        coordinates = self._materials[material].coordinates
        mesh = self._parts.of(item.mesh, slot, coordinates)
        if mesh is None:
            return
        name = safe(f"{item.mesh} {slot} {coordinates}")
        self._meshes[name] = mesh
        if self._materials[material].keys["kind"] == "hair":
            own = f"{material} on faces"
            self._report.add(f"Material {material}: of hair, and shown by faces: matte there.")
            self._materials[own] = Translated(without_hair(self._materials[material].keys))
            self._marks[own] = self._marks[material]
            material = own
        ends: dict[str, tuple[Any, Any]] = {}
        if item.mesh_end is not None:
            end = deformed(self._parts.mesh(item.mesh), item.mesh_end, slot, coordinates)
            if end is None or coordinates.startswith("color:"):
                why = "it is another mesh" if end is None else "it has colours of vertices"
                self._report.add(f"Object {item.name}: {why}, and is not deformed while the shutter is open.")
            else:
                ends = {name: (mesh[name], rows) for name, rows in end.items()}
        if grows and item.matrix_end is not None:
            ends["transform.matrix"] = item.matrix[:3].tolist(), item.matrix_end[:3].tolist()
        self._move_keys(item.name, ends)
        self._add(item, {"shape": "mesh", "mesh": name}, material, motion)

    def _move_keys(self, name: str, ends: dict[str, tuple[Any, Any]]) -> None:
        """Have keys of the object that is added next go from one value to the other while the shutter is open."""
        if ends:
            self._stepped.setdefault(name)
        for key, values in ends.items():
            frames = zip((0.0, self._shutter.time_s), values, strict=True)
            self._deformed[f"objects.{len(self._objects)}.{key}"] = [{"time_s": t, "value": v} for t, v in frames]

    def _steps(self, keys: dict[str, Any], report: Report) -> None:
        """Cut the exposure into steps for what is deformed, where that goes with the rest."""
        camera, render = keys["camera"], keys.get("render", {})
        why = [
            name for name, wrong in (
                ("a rolling shutter", self._shutter.rolling_s > 0),
                ("diffraction", camera.get("diffraction", "off") != "off"),
                ("ghosts", camera.get("ghosts", "off") != "off"),
                ("the pass Position", "position" in render.get("layers", ())),
            ) if wrong
        ]  # fmt: skip
        whole = sum(len(keys["meshes"][item["mesh"]]["faces"]) for item in self._objects if "mesh" in item)
        most = min(MOST_STEPS, MOST_STEPPED // max(whole, 1), int(render.get("spp", MOST_STEPS)))
        if most < LEAST_STEPS:
            why.append(f"{whole} triangles" if whole * LEAST_STEPS > MOST_STEPPED else "so few samples")
        if why:
            for name in self._stepped:
                report.add(
                    f"Object {name}: it is not deformed or grown beside {why[0]}; its motion as a whole blurs it."
                )
            return
        for name in {name for name in self._deformed if not name.endswith("matrix")}:  # shapes of their own
            item = self._objects[int(name.split(".")[1])]
            if "mesh" in item:
                item |= keys["meshes"][item.pop("mesh")]
        for name in self._deformed:
            if name.endswith("matrix"):
                self._objects[int(name.split(".")[1])].pop("motion", None)
        spp = int(render.get("spp", most))
        even = [steps for steps in range(LEAST_STEPS, most + 1) if spp % steps == 0]  # all steps have as many samples
        keys["shutter"] |= {"keys": self._deformed, "steps": even[-1] if even else most}

    def add_lamp(self, lamp: BlenderLamp) -> None:
        """Add a lamp, with or without a surface."""
        made = lamp_keys(lamp, self._report, self._units)
        if made is None:
            return
        section, keys = made[0], made[1] | self._grouped(lamp.group)
        if section == "lights":
            self._lights.append(keys)
        else:
            self._objects.append(keys)
            self._indices.append(0)

    def _say_clip(self, camera: BlenderCamera, report: Report) -> None:
        """Report that what lies beyond the camera's clip end is seen."""
        if self._bounds and np.isfinite(camera.clip_end):
            if len(self._bounds) > 1:  # of several the box round all
                rows = np.concatenate(self._bounds)
                self._bounds = [np.stack([rows.min(axis=0), rows.max(axis=0)])]
            low, high = self._bounds[0].min(axis=0), self._bounds[0].max(axis=0)
            ahead = -camera.matrix[:3, 2] / np.linalg.norm(camera.matrix[:3, 2])
            farthest = np.where(ahead > 0, high, low)
            if (farthest - camera.matrix[:3, 3]) @ ahead > camera.clip_end:
                report.add(f"Camera: things beyond its clip end of {camera.clip_end:g} are seen.")

    def _grouped(self, group: str) -> dict[str, str]:
        """The group of a lamp, where the light of groups is kept apart."""
        return {"group": group_name(self._light_groups, group)} if self._light_groups else {}

    def export(
        self,
        camera: BlenderCamera,
        frame: Frame,
        choice: LensChoice,
        environment: dict[str, Any] | None,
        more: dict[str, Any],
        world_group: str = "",
    ) -> Export:
        """The scene of all that was added."""
        keys: dict[str, Any] = {"metres_per_unit": self._units, "shutter": {"time_s": self._shutter.time_s}}
        if self._shutter.rolling_s > 0:
            keys["shutter"] |= {"kind": "rolling", "readout_s": self._shutter.rolling_s}
        report = Report()
        report.extend(self._report)
        self._say_clip(camera, report)
        keys |= camera_keys(camera, frame, choice, self._units, report)
        motion = keyframes(camera, 0.0, self._shutter.time_s)
        if motion:
            keys["camera"]["motion"] = motion
        used = {name for item in self._objects if isinstance(name := item.get("material"), str)}
        shown = [name for name in self._materials if name not in self._of_colors]
        # Hair is of curves alone, and its other translations are of those that show them.
        shown = [name for name in shown if self._materials[name].keys["kind"] != "hair" or safe(name) in used]
        keys["materials"] = {safe(name): self._materials[name].keys for name in shown}
        keys |= {"meshes": self._meshes, "objects": self._objects, "lights": self._lights}
        if environment is not None:
            keys["environment"] = environment | self._grouped(world_group)
        indices = [self._marks[name][0] for name in shown]
        own_names = self._own_names | {safe(name): self._marks[name][1] for name in shown}
        keys |= more
        if self._deformed:
            self._steps(keys, report)
        if keys["camera"].get("ghosts", "off") != "off":
            lamps = [*self._lights, *(each for each in self._objects if isinstance(each.get("material"), dict))]
            if hidden := sum(not each.get("visible", {}).get("camera", True) for each in lamps):
                report.add(f"Ghosts are of lamps that the camera sees (Ray Visibility): {hidden} are hidden from it.")
        return Export(keys, report, np.array(self._indices, np.int32), np.array(indices, np.int32), own_names)
