"""The objects of a scene of ours: shapes with their materials, each material and shared mesh once."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import field
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.frame import Frame
from rptcam_cl.importers.pbrt.lights import lamp_radiance
from rptcam_cl.importers.pbrt.materials import convert_material
from rptcam_cl.importers.pbrt.materials_v3 import opacity_keys
from rptcam_cl.importers.pbrt.mesh import MeshData
from rptcam_cl.importers.pbrt.shapes import MOST_INLINE, Piece, Placed, ShapeMaterial, convert_shape
from rptcam_cl.importers.pbrt.state import Entity, Instance, ShapeUse
from rptcam_cl.importers.pbrt.textures import number_shade
from rptcam_cl.importers.pbrt.transforms import ODD, Matrix, is_bearable, is_transform_of_ours

# Of the 50 000 values that a scene file may hold (see strict_yaml), with room for what is not objects.
MOST_VALUES = 45_000


def count_values(value: Any) -> int:
    """Return the number of values that a part of a scene takes in a file: lists, mappings, keys and scalars."""
    if isinstance(value, Mapping):
        return 1 + sum(1 + count_values(item) for item in value.values())
    if isinstance(value, list | tuple):
        return 1 + sum(map(count_values, value))
    return count_values(value.tolist()) if isinstance(value, np.ndarray) else 1


def form_of(mesh: MeshData) -> tuple[bool, bool]:
    """Return what meshes must have in common to be put together: normals and texture coordinates."""
    return mesh.normals is not None, mesh.uvs is not None


def joined(meshes: Iterable[MeshData]) -> MeshData:
    """Return meshes of one form as one."""
    parts = list(meshes)
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    normals, uvs = [part.normals for part in parts], [part.uvs for part in parts]
    return MeshData(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([rows for rows in normals if rows is not None]) if normals[0] is not None else None,
        np.concatenate([rows for rows in uvs if rows is not None]) if uvs[0] is not None else None,
    )


Keys = dict[str, Any]
ONE_SIDED = ("emissive", "dielectric", "principled")


@dataclass
class Objects:
    """Takes the shapes of a pbrt scene one by one."""

    context: Context
    frame: Frame
    items: list[Keys] = field(default_factory=list)
    materials: dict[str, Keys] = field(default_factory=dict)
    meshes: dict[str, Keys] = field(default_factory=dict)
    _names: dict[str, str] = field(default_factory=dict)
    _converted: dict[int, tuple[Entity | None, Keys | None]] = field(default_factory=dict)
    _shared: dict[int, tuple[ShapeUse, str]] = field(default_factory=dict)
    _counts: Counter[str] = field(default_factory=Counter)
    _loose: dict[int, tuple[ShapeUse, MeshData]] = field(default_factory=dict)

    def keys(self) -> Keys:
        """Return the sections of the scene."""
        sizes = {index: count_values(mesh.keys()) if len(mesh.faces) <= MOST_INLINE else 2
                 for index, (_, mesh) in self._loose.items()}  # fmt: skip
        if count_values(self.items) + sum(sizes.values()) > MOST_VALUES:
            self._merge()
        for index, (use, mesh) in self._loose.items():
            self.items[index] = {"shape": "mesh", **self._mesh_keys(use, mesh), **self.items[index]}
        self.items = [item for item in self.items if item]
        sections = {"materials": self.materials, "meshes": self.meshes, "objects": self.items}
        return {name: section for name, section in sections.items() if section}

    def add_all(self) -> None:
        """Add every shape at every place."""
        placed = list(self.context.scene.placed())
        uses = Counter(id(use) for use, _, _ in placed)
        for use, world, instance in placed:
            self._add(use, np.asarray(self.frame.world @ world), instance, shared=uses[id(use)] > 1)
        self._note_unplaced({id(use) for use, _, _ in placed})

    def _note_unplaced(self, placed: set[int]) -> None:
        for name, shapes in self.context.scene.objects.items():
            if shapes and not any(id(use) in placed for use in shapes):
                self.context.report.noted(shapes[0].shape.place, f'object "{name}" is never placed')

    def _add(self, use: ShapeUse, world: Matrix, instance: Instance | None, *, shared: bool) -> None:
        if not is_bearable(world):
            self._leave_out(use, instance)
            return
        lamp = use.lamp if instance is None else None
        if use.lamp is not None and instance is not None:
            self.context.report.ignored(use.lamp.place, f"{use.lamp.what}: lamps in objects do not shine, as in pbrt")
        material = self._material(use)
        opacity = self._opacity(use)
        if material is None and lamp is None:
            self.context.report.ignored(
                use.shape.place, f"{use.shape.what}: the boundary of a medium, without a surface"
            )
            use.shape.parameters.used.update(use.shape.parameters.items)
            return
        if opacity.get("opacity") == 0 and lamp is None:
            self.context.report.ignored(use.shape.place, f"{use.shape.what}: wholly transparent")
            use.shape.parameters.used.update(use.shape.parameters.items)
            return
        shape_material = _material_of_lamp(lamp) if lamp is not None else _material_of({**(material or {}), **opacity})
        piece = convert_shape(self.context, Placed(use, world, shape_material, shared))
        if piece is None:
            return
        if "transform" in piece.keys and not is_transform_of_ours(world):
            self._leave_out(use, instance)
            return
        if lamp is not None:
            material = self._lamp(lamp, piece, use, opacity)
        else:
            material = {**(material or {}), **opacity}
        name = self._name(material, self._wanted_name(use, lamp))
        if piece.mesh is not None and not shared:
            self._loose[len(self.items)] = use, piece.mesh
        self.items.append({**self._shape_keys(use, piece, shared), "material": name})

    def _leave_out(self, use: ShapeUse, instance: Instance | None) -> None:
        """Report a shape whose transform flattens space, or leads out of it."""
        what = use.shape.what if instance is None else f'{use.shape.what} of "{instance.name}"'
        self.context.report.ignored((instance or use.shape).place, f"{what}: {ODD}")
        use.shape.parameters.used.update(use.shape.parameters.items)

    def _material(self, use: ShapeUse) -> Keys | None:
        entity = self.context.scene.material_of(use.material)
        if id(entity) not in self._converted:
            self._converted[id(entity)] = entity, convert_material(self.context, entity)
        return self._converted[id(entity)][1]

    def _opacity(self, use: ShapeUse) -> Keys:
        """Return the holes of a shape, which pbrt gives as ``alpha``."""
        parameters = use.shape.parameters
        parameters.skip("shadowalpha")
        if not parameters.has("alpha"):
            return {}
        return opacity_keys(self.context, use.shape, "alpha", number_shade(self.context, use.shape, "alpha", 1.0))

    def _lamp(self, lamp: Entity, piece: Piece, use: ShapeUse, opacity: Keys) -> Keys:
        radiance, two_sided = lamp_radiance(self.context, lamp, piece.area)
        if opacity:
            self.context.report.ignored(use.shape.place, f"{use.shape.what}: alpha of a lamp, which stays visible")
        reflecting = self._material(use)
        if reflecting is not None and reflecting.get("reflectance") != [0.0, 0.0, 0.0]:
            self.context.report.approximated(lamp.place, f"{lamp.what}: the lamp reflects nothing")
        keys: Keys = {"kind": "emissive", "radiance": radiance.tolist()}
        return keys | ({"two_sided": True} if two_sided else {})

    def _shape_keys(self, use: ShapeUse, piece: Piece, shared: bool) -> Keys:
        if piece.mesh is None:
            return piece.keys
        if not shared:
            return piece.keys
        if id(use) not in self._shared:
            name = self._unique("mesh")
            self._shared[id(use)] = use, name
            self.meshes[name] = self._mesh_keys(use, piece.mesh)
        return {"shape": "mesh", "mesh": self._shared[id(use)][1], **piece.keys}

    def _merge(self) -> None:
        """Put the meshes of each material together that stand in one place only."""
        groups: dict[tuple[object, ...], list[int]] = {}
        for index, (_, mesh) in self._loose.items():
            if "transform" not in self.items[index]:
                groups.setdefault((self.items[index]["material"], *form_of(mesh)), []).append(index)
        for (material, *_), (first, *others) in groups.items():
            if not others:
                continue
            use, _ = self._loose[first]
            self._loose[first] = use, joined(self._loose[index][1] for index in (first, *others))
            for index in others:
                del self._loose[index]
                self.items[index] = {}
            self.context.report.noted(
                use.shape.place,
                f"{1 + len(others)} meshes of {material} became one: a scene file holds no more objects",
            )

    def _mesh_keys(self, use: ShapeUse, mesh: MeshData) -> Keys:
        """Return a small mesh written out, a large one as a file beside the scene."""
        if len(mesh.faces) <= MOST_INLINE:
            return mesh.keys()
        name = f"{use.shape.kind}-{use.shape.place.line_number}.ply"
        return {"file": self.context.files.add("meshes", name, mesh.write_ply)}

    def _wanted_name(self, use: ShapeUse, lamp: Entity | None) -> str:
        if lamp is not None:
            return "lamp"
        entity = self.context.scene.material_of(use.material)
        if entity is None:
            return "default"
        named = entity.what.startswith("MakeNamedMaterial")
        return (entity.what.split(" ", 1)[1].strip('"') if named else entity.kind)[:100] or entity.kind

    def _name(self, material: Keys, wanted: str) -> str:
        """Return the name of a material; equal ones have one."""
        content = json.dumps(material, sort_keys=True)
        if content not in self._names:
            name = self._unique(wanted)
            self._names[content] = name
            self.materials[name] = material
        return self._names[content]

    def _unique(self, wanted: str) -> str:
        taken = self.materials.keys() | self.meshes.keys()
        while True:
            self._counts[wanted] += 1
            count = self._counts[wanted]
            name = wanted if count == 1 and wanted != "mesh" else f"{wanted}-{count}"
            if name not in taken:
                return name


def _material_of_lamp(lamp: Entity) -> ShapeMaterial:
    return ShapeMaterial(textured=False, oriented=not lamp.parameters.boolean("twosided", False))


def _material_of(material: Keys) -> ShapeMaterial:
    return ShapeMaterial(_is_textured(material), _has_front(material))


def _has_front(material: Keys) -> bool:
    """Return whether the front of a material is not as its back: of bumps the back has dents."""
    parts = material.get("materials", ())
    return material["kind"] in ONE_SIDED or "normal_map" in material or any(map(_has_front, parts))


def _is_textured(value: Any) -> bool:
    """Return whether some part of a material is a texture."""
    if isinstance(value, dict):
        is_texture = value.get("kind") in ("image", "checker") or "file" in value
        return is_texture or any(_is_textured(item) for item in value.values())
    return isinstance(value, list) and any(_is_textured(item) for item in value)
