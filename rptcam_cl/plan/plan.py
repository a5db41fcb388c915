"""The plan of a render: facts that specialise the kernels, and the records that they read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel, camera_model
from rptcam_cl.plan.emitters import Emitters, pack_emitters
from rptcam_cl.plan.environment import Surroundings, pack_environment
from rptcam_cl.plan.materials import material_kinds, pack_materials
from rptcam_cl.plan.primitives import pack_primitives, scene_primitives
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


def make_plan(scene: Scene) -> Plan:
    """Return the plan of a scene."""
    primitives = scene_primitives(scene)
    materials = [primitive.material for primitive in primitives]
    table = TextureTable(scene)
    material_records, material_index = pack_materials(materials, table)
    surroundings = pack_environment(scene, table)
    emitters = pack_emitters(scene, primitives, table, surroundings)
    textures = table.pack()
    records, kind_end = pack_primitives(primitives, material_index, emitters.of_primitive)
    kinds = {primitive.kind for primitive in primitives}
    shown = material_kinds(materials)
    facts = {f"HAS_{kind.name}": int(kind in kinds) for kind in Kind}
    facts |= {f"HAS_{kind.name}": int(kind in shown) for kind in MaterialKind}
    facts |= textures.facts | emitters.facts
    facts |= {
        "HAS_AFFINE": int(bool(kinds - {Kind.SPHERE})),
        "ENVIRONMENT": int(surroundings.kind),
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
    )
