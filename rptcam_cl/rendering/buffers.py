"""The scene on the device: every array of the plan, under the name that kernels have for it."""

from __future__ import annotations

from typing import Any

import numpy as np

from rptcam_cl.cameras import CameraModel
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.trees.primitive_tree import primitive_tree
from rptcam_cl.rendering.trees.scene_trees import scene_trees


class SceneBuffers:
    """Uploaded arrays of a plan.

    Attributes
    ----------
    scene : dict
        Arguments for ``SCENE_PARAMETERS`` (``kernels/common/scene.h``), by name.
    tree_facts : dict
        Facts of the trees for the compilation; none where there are none.
    colours : buffer
        Wavelengths of paths; a single 0 where they have none.
    camera : dict
        Arguments of the pass ``generate``: record, tables, surfaces and stop of the camera.
    trajectory : dict
        And one more if anything moves: when the shutter is open and where the camera is.
    """

    def __init__(self, session: Session, plan: Plan) -> None:
        upload = session.upload
        self.scene: dict[str, Any] = {
            "primitives": upload(plan.primitives),
            "kind_end": upload(plan.kind_end),
            "materials": upload(plan.materials),
            "textures": upload(plan.textures.records),
            "texels": upload(plan.textures.texels),
            "emitters": upload(plan.emitters.records),
            "environment": upload(plan.surroundings.record),
            "distribution": upload(np.concatenate([plan.emitters.curve, plan.surroundings.distribution])),
            "emitter_count": np.int32(plan.emitters.count),
        }
        self.colours = upload(plan.spectrum.table)
        if plan.facts["SPECTRUM"]:
            self.scene |= {"colours": self.colours}
        if plan.facts["HAS_MOTION"]:
            self.scene |= {
                "segments": upload(plan.movements.segments),
                "movement_of": upload(plan.movements.of_primitive),
            }
        self.tree_facts: dict[str, int] = {}
        self._add_primitive_tree(session, plan)
        self._add_meshes(session, plan)
        self.trajectory = {"trajectory": upload(plan.trajectory)} if plan.facts["MOVES"] else {}
        self.filter = upload(plan.camera_filter.table)
        self.camera = camera_buffers(session, plan.camera)

    def _add_primitive_tree(self, session: Session, plan: Plan) -> None:
        tree = primitive_tree(plan.primitives, plan.kind_end, session, plan.movements)
        if tree is not None:
            self.tree_facts |= tree.facts
            self.scene |= {
                "primitive_nodes": session.upload(tree.nodes),
                "primitive_leaves": session.upload(tree.leaves),
            }

    def _add_meshes(self, session: Session, plan: Plan) -> None:
        if plan.meshes is None:
            return
        trees = scene_trees(plan.meshes, session, plan.movements)
        self.tree_facts |= trees.facts
        low, high = trees.bounds
        arrays = {
            "nodes": trees.nodes,
            "blocks": trees.blocks,
            "triangles": plan.meshes.triangles,
            "vertices": trees.vertices,
            "instances": trees.instances,
        }
        self.scene |= {name: session.upload(array, in_place=True) for name, array in arrays.items()}
        self.scene |= {"mesh_root": np.int32(trees.root), "mesh_low": low.tobytes(), "mesh_high": high.tobytes()}


def camera_buffers(session: Session, camera: CameraModel) -> dict[str, Any]:
    """Return arguments of the pass ``generate``: record, tables, surfaces and stop of a camera, uploaded."""
    arrays = {"camera": camera.record, "tables": camera.tables, "surfaces": camera.surfaces, "stop": camera.stop}
    return {name: session.upload(array) for name, array in arrays.items()}
