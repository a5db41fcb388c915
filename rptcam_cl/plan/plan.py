"""The plan of a render: facts that specialise the kernels, and the records that they read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel, camera_model
from rptcam_cl.geometry.packed import PackedMeshes
from rptcam_cl.plan.emitters import Emitters, pack_emitters
from rptcam_cl.plan.materials import material_kinds, pack_materials
from rptcam_cl.plan.owners import Owners, owners_of
from rptcam_cl.plan.primitives import pack_primitives, scene_primitives, with_meshes
from rptcam_cl.plan.textures import Textures, TextureTable
from rptcam_cl.records import ENVIRONMENT, EmitterKind, EnvironmentKind, Kind, MaterialKind
from rptcam_cl.scene.environment import GradientEnvironment
from rptcam_cl.scene.scene import Scene

FLAT_EMITTERS = {EmitterKind.RECTANGLE, EmitterKind.DISK, EmitterKind.TRIANGLE}


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
    environment: NDArray[np.void]
    primitive_count: int
    meshes: PackedMeshes | None
    owners: Owners
    eye_m: NDArray[np.float64]


def _pack_environment(scene: Scene) -> tuple[EnvironmentKind, NDArray[np.void]]:
    record = ENVIRONMENT.zeros(1)
    if scene.environment is None:
        return EnvironmentKind.NONE, record
    if isinstance(scene.environment, GradientEnvironment):
        record["bottom"][0, :3] = scene.environment.bottom
        record["top"][0, :3] = scene.environment.top
        record["up"][0, :3] = np.asarray(scene.environment.up) / np.linalg.norm(scene.environment.up)
        return EnvironmentKind.GRADIENT, record
    record["bottom"][0, :3] = scene.environment.radiance
    return EnvironmentKind.CONSTANT, record


def make_plan(scene: Scene) -> Plan:
    """Return the plan of a scene."""
    primitives, meshes = with_meshes(scene_primitives(scene), scene)
    materials = [primitive.material for primitive in primitives]
    table = TextureTable(scene)
    material_records, material_index = pack_materials(materials, table)
    textures = table.pack()
    emitters = pack_emitters(scene, primitives, meshes.first_triangles if meshes else ())
    records, kind_end = pack_primitives(primitives, material_index, emitters.of_primitive, meshes)
    environment_kind, environment = _pack_environment(scene)
    kinds = {primitive.kind for primitive in primitives}
    shown = material_kinds(materials)
    facts = {f"HAS_{kind.name}": int(kind in kinds) for kind in Kind}
    facts |= {f"HAS_{kind.name}": int(kind in shown) for kind in MaterialKind}
    facts |= textures.facts
    facts |= {
        "HAS_AFFINE": int(bool(kinds - {Kind.SPHERE, Kind.MESH})),
        "HAS_EMITTERS": int(emitters.count > 0),
        "ONE_EMITTER": int(emitters.count == 1),
        "EMITTER_FLATS": int(bool(emitters.kinds & FLAT_EMITTERS)),
        "EMITTER_TRIANGLES": int(EmitterKind.TRIANGLE in emitters.kinds),
        "HAS_INSTANCES": int(meshes is not None and meshes.packed.instanced),
        "HAS_TANGENT": 0,
        "EMITTER_DISKS": int(EmitterKind.DISK in emitters.kinds),
        "EMITTER_SPHERES": int(EmitterKind.SPHERE in emitters.kinds),
        "EMITTER_POINTS": int(EmitterKind.POINT in emitters.kinds),
        "EMITTER_DIRECTIONS": int(EmitterKind.DIRECTIONAL in emitters.kinds),
        "ENVIRONMENT": int(environment_kind),
    }
    return Plan(
        facts=facts,
        camera=camera_model(scene),
        primitives=records,
        kind_end=kind_end,
        materials=material_records,
        textures=textures,
        emitters=emitters,
        environment=environment,
        primitive_count=len(primitives),
        meshes=meshes.packed if meshes else None,
        owners=owners_of(scene, primitives),
        eye_m=np.array(scene.camera.eye) * scene.metres_per_unit,
    )
