"""The scene on the device: every array of the plan, in the order in which kernels take them."""

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
    scene : tuple
        Values of ``SCENE_PARAMETERS`` (``kernels/common/scene.h``), in its order.
    tree_facts : dict
        Facts of the trees for the compilation; none where there are none.
    colours : buffer
        Wavelengths of paths; a single 0 where they have none.
    camera : tuple
        The first arguments of the pass ``generate``: record, tables, surfaces and stop of the camera.
    trajectory : tuple
        Its last: when the shutter is open and where the camera is, if anything moves.
    """

    def __init__(self, session: Session, plan: Plan) -> None:
        upload = session.upload
        self.scene: tuple[Any, ...] = (
            upload(plan.primitives),
            upload(plan.kind_end),
            upload(plan.materials),
            upload(plan.textures.records),
            upload(plan.textures.texels),
            upload(plan.emitters.records),
            upload(plan.surroundings.record),
            upload(np.concatenate([plan.emitters.curve, plan.surroundings.distribution])),
            np.int32(plan.emitters.count),
        )
        self.colours = upload(plan.spectrum.table)
        if plan.facts["SPECTRUM"]:
            self.scene += (self.colours,)
        self.tree_facts: dict[str, int] = {}
        if plan.facts["HAS_MOTION"]:
            self.scene += (upload(plan.movements.segments), upload(plan.movements.of_primitive))
        tree = primitive_tree(plan.primitives, plan.kind_end, session, plan.movements)
        if tree is not None:
            self.tree_facts |= tree.facts
            self.scene += (upload(tree.nodes), upload(tree.leaves))
        if plan.meshes is not None:
            trees = scene_trees(plan.meshes, session, plan.movements)
            self.tree_facts |= trees.facts
            arrays = (trees.nodes, trees.blocks, plan.meshes.triangles, trees.vertices, trees.instances)
            low, high = (bound.tobytes() for bound in trees.bounds)
            self.scene += (*(upload(array, in_place=True) for array in arrays), np.int32(trees.root), low, high)
        self.trajectory = (upload(plan.trajectory),) if plan.facts["MOVES"] else ()
        self.filter = upload(plan.camera_filter.table)
        self.camera = camera_buffers(session, plan.camera)


def camera_buffers(session: Session, camera: CameraModel) -> tuple[Any, ...]:
    """Return the first arguments of the pass ``generate``: record, tables, surfaces and stop of a camera, uploaded."""
    return tuple(session.upload(array) for array in (camera.record, camera.tables, camera.surfaces, camera.stop))
