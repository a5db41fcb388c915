"""What a plan says of a scene but for its camera: primitives, materials, lamps and surroundings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import SeenLamp
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import Kind
from rptcam_cl.plan.albedo import LargestAlbedo, largest_albedo
from rptcam_cl.plan.caustics import Caustics, pack_caustics
from rptcam_cl.plan.emitters import Emitters, pack_emitters
from rptcam_cl.plan.environment import Surroundings
from rptcam_cl.plan.lamps_out_of_focus import visible_lamps
from rptcam_cl.plan.materials import Materials
from rptcam_cl.plan.meshes import MeshPlan
from rptcam_cl.plan.motion import Movements, pack_movements
from rptcam_cl.plan.optical_constants import KnownSpectra
from rptcam_cl.plan.packed_meshes import PackedMeshes
from rptcam_cl.plan.parts import PlanParts
from rptcam_cl.plan.primitives import (
    Owners,
    Primitive,
    has_huge_sphere,
    owners_of,
    pack_primitives,
    scene_primitives,
    with_meshes,
)
from rptcam_cl.plan.textures import Textures
from rptcam_cl.scene import Scene, file_references

FRAMED = (
    "HAS_ANISOTROPY_TURN",
    "HAS_ANISOTROPY_MAP",
    "HAS_NORMAL_MAP",
    "HAS_COAT_NORMAL",
)  # what wants the frame of u and v
FEW = 16  # primitives, as many as lanes that a processor permutes at once


@dataclass(frozen=True, eq=False)
class World:
    """What the kernels read of a scene beside the camera, about the eye, and the facts that they are compiled for."""

    facts: dict[str, int]
    primitives: NDArray[np.void]
    primitive_count: int
    kind_end: NDArray[np.int32]
    movements: Movements
    materials: Materials
    spectra: KnownSpectra
    textures: Textures
    emitters: Emitters
    surroundings: Surroundings
    caustics: Caustics
    meshes: PackedMeshes | None
    owners: Owners
    eye_m: NDArray[np.float64]
    albedo: LargestAlbedo
    lamps: tuple[SeenLamp, ...]  # that the eye sees


def world_of(scene: Scene, parts: PlanParts) -> World:
    """Return the world of a scene; that before, where nothing of which it is made is another."""
    solids, far = scene.solids(), (scene.lights, scene.environment)
    named = tuple(scene.materials), tuple(scene.materials.values())
    shown = tuple(solid.shown_materials() for solid in solids)
    files = tuple(scene.digest_of(reference) for _, reference in file_references((shown, far)))
    caustics = scene.render.caustics, "caustics" in scene.render.model_fields_set, scene.render.clamp is None
    about = scene.camera.eye, scene.metres_per_unit, scene.shutter, caustics
    of = scene.objects, solids, named, far, files, about
    return parts.part("world", of, lambda: _made(scene, parts, files))


def _made(scene: Scene, parts: PlanParts, files: tuple[str, ...]) -> World:
    primitives, meshes = with_meshes(scene_primitives(scene), scene, parts)
    materials = [primitive.material for primitive in primitives]
    seen = parts.appearance(scene, materials, files)
    table, spectra, shown, surroundings = seen.table, seen.spectra, seen.shown, seen.surroundings
    first_triangles = meshes.first_triangles if meshes else ()
    emitters = pack_emitters(scene, primitives, first_triangles, table, spectra, surroundings)
    eye_m = np.array(scene.camera.eye) * scene.metres_per_unit
    textures = parts.textures(seen)
    records, kind_end = pack_primitives(primitives, shown.index, emitters.of_primitive, meshes)
    movements = pack_movements(scene, primitives)
    caustics = pack_caustics(scene, primitives, first_triangles, emitters)
    facts = caustics.facts | shown.facts | textures.facts | emitters.facts | movements.facts
    facts |= _facts_of_shapes(primitives, meshes, shown.facts) | {
        "ENVIRONMENT": int(surroundings.kind),
        "FEW_PRIMITIVES": int(len(primitives) <= FEW),
        "HUGE_SPHERES": int(has_huge_sphere(primitives)),
    }
    return World(
        facts=facts,
        primitives=records,
        primitive_count=len(primitives),
        kind_end=kind_end,
        movements=movements,
        materials=shown,
        spectra=spectra,
        textures=textures,
        emitters=emitters,
        surroundings=surroundings,
        caustics=caustics,
        meshes=meshes.packed if meshes else None,
        owners=owners_of(scene, primitives),
        eye_m=eye_m,
        albedo=largest_albedo(materials),
        lamps=visible_lamps(primitives, eye_m, table),
    )


def _is_smooth(primitive: Primitive) -> bool:
    return primitive.mesh is not None and primitive.mesh.normals is not None


def _facts_of_shapes(
    primitives: list[Primitive], meshes: MeshPlan | None, materials: Mapping[str, int]
) -> dict[str, int]:
    """Return which kinds of primitives there are, and what their surfaces require beside positions and normals."""
    kinds = {primitive.kind for primitive in primitives}
    bumpy = materials["HAS_NORMAL_MAP"] or materials["HAS_COAT_NORMAL"]
    return {f"HAS_{kind.name}": int(kind in kinds) for kind in Kind} | {
        "HAS_TANGENT": int(materials["HAS_ANISOTROPY"] or any(materials[name] for name in FRAMED)),
        "HAS_BITANGENT": int(any(materials[name] for name in FRAMED)),
        "HAS_SHADING_NORMAL": int(bumpy or any(map(_is_smooth, primitives))),
        "HAS_AFFINE": int(bool(kinds - {Kind.SPHERE, Kind.MESH})),
        "HAS_INSTANCES": int(meshes is not None and meshes.packed.instanced),
    }
