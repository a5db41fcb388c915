"""The plan of a render: facts that specialise the kernels, and the records that they read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel, camera_model
from rptcam_cl.geometry.packed import PackedMeshes
from rptcam_cl.plan.emitters import Emitters, pack_emitters
from rptcam_cl.plan.environment import Surroundings, pack_environment
from rptcam_cl.plan.materials import material_kinds, pack_materials
from rptcam_cl.plan.owners import Owners, owners_of
from rptcam_cl.plan.primitives import pack_primitives, scene_primitives, with_meshes
from rptcam_cl.plan.textures import Textures, TextureTable
from rptcam_cl.records import Kind, MaterialKind
from rptcam_cl.scene.scene import Scene


@dataclass(frozen=True)
class Plan:
    """Everything that the kernels of one render read, and the facts that they are compiled for."""

    facts: dict[str, int]
    camera: CameraModel
    primitives: NDArray[np.void]
    kind_end: NDArray[np.int32]
    materials: NDArray[np.void]
    textures: Textures
    emitters: Emitters
    surroundings: Surroundings
    primitive_count: int
    meshes: PackedMeshes | None
    owners: Owners
    eye_m: NDArray[np.float64]


def make_plan(scene: Scene) -> Plan:
    """Return the plan of a scene."""
    primitives, meshes = with_meshes(scene_primitives(scene), scene)
    materials = [primitive.material for primitive in primitives]
    table = TextureTable(scene)
    material_records, material_index = pack_materials(materials, table)
    surroundings = pack_environment(scene, table)
    emitters = pack_emitters(scene, primitives, meshes.first_triangles if meshes else (), table, surroundings)
    textures = table.pack()
    records, kind_end = pack_primitives(primitives, material_index, emitters.of_primitive, meshes)
    kinds = {primitive.kind for primitive in primitives}
    shown = material_kinds(materials)
    facts = {f"HAS_{kind.name}": int(kind in kinds) for kind in Kind}
    facts |= {f"HAS_{kind.name}": int(kind in shown) for kind in MaterialKind}
    facts |= textures.facts | emitters.facts
    facts |= {
        "HAS_AFFINE": int(bool(kinds - {Kind.SPHERE, Kind.MESH})),
        "HAS_INSTANCES": int(meshes is not None and meshes.packed.instanced),
        "HAS_TANGENT": 0,
        "ENVIRONMENT": int(surroundings.kind),
        "SAMPLER_LATTICE": int(scene.render.sampler == "lattice"),
    }
    return Plan(
        facts=facts,
        camera=camera_model(scene),
        primitives=records,
        kind_end=kind_end,
        materials=material_records,
        textures=textures,
        emitters=emitters,
        surroundings=surroundings,
        primitive_count=len(primitives),
        meshes=meshes.packed if meshes else None,
        owners=owners_of(scene, primitives),
        eye_m=np.array(scene.camera.eye) * scene.metres_per_unit,
    )
