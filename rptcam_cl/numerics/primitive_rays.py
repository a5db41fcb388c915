"""Rays against the objects of a scene by the kernels that render, with the tree over primitives or without."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.device import Session
from rptcam_cl.numerics.probe import GROUP, run_probe
from rptcam_cl.plan import make_plan
from rptcam_cl.scene import load_scene
from rptcam_cl.wavefront.buffers import SceneBuffers

NOTHING = -1


@dataclass(frozen=True)
class Met:
    """What rays met: distance and primitive of the nearest hit, and whether anything lay in the way."""

    t: NDArray[np.float32]
    primitive: NDArray[np.int32]
    blocked: NDArray[np.bool_]

    def unlike(self, other: Met) -> NDArray[np.bool_]:
        """Return which rays met something else, to the last bit."""
        return np.asarray(
            (self.t.view(np.int32) != other.t.view(np.int32))
            | (self.primitive != other.primitive)
            | (self.blocked != other.blocked)
        )


class Objects:
    """Objects on a device, the eye where it is asked for; with a tree over them where they are many."""

    def __init__(self, session: Session, objects: list[dict[str, Any]], eye: Any = (0, 0, 0), **keys: Any) -> None:
        target = [eye[0], eye[1], eye[2] - 1]
        camera = {"kind": "pinhole", "eye": list(eye), "target": target, "up": [0, 1, 0], "fov_degrees": 40}
        self.plan = make_plan(load_scene({"camera": camera, "objects": objects, **keys}))
        self.session = session
        self.buffers = SceneBuffers(session, self.plan)

    @property
    def has_tree(self) -> bool:
        """Whether rays walk a tree over the primitives."""
        return "HAS_PRIMITIVE_TREE" in self.buffers.tree_facts

    def without_tree(self) -> Objects:
        """Return the same objects, all of which every ray is tested against; they must hold no mesh."""
        assert self.has_tree
        assert self.plan.meshes is None
        other = copy.copy(self)
        other.buffers = copy.copy(self.buffers)
        other.buffers.scene, other.buffers.tree_facts = self.buffers.scene[:-2], {}
        return other

    def trace(
        self, o: Any, d: Any, self_hit: Any = NOTHING, reach: Any = 3e38, target: Any = NOTHING, lanes: int = 8
    ) -> Met:
        """Return what rays (n, 3) meet that start at ``o`` on the primitives ``self_hit``, in the world of the eye."""
        n = len(o)
        count = -(-n // (GROUP * 8)) * GROUP * 8
        rays = np.zeros((9, count), np.float32)
        rays[:3, :n], rays[3:6, :n], rays[7, :n] = np.asarray(o).T, np.asarray(d).T, reach
        rays[6] = np.int32(-2).view(np.float32)
        rays[6, :n] = np.broadcast_to(np.int32(self_hit), n).view(np.float32)
        rays[8, :n] = np.broadcast_to(np.int32(target), n).view(np.float32)
        hits, dark = self.session.allocate(8 * count), self.session.allocate(4 * count)
        facts = self.plan.facts | self.buffers.tree_facts | {"VW": lanes}
        held = self.session.allocate(rays.nbytes)  # aligned for packs, as the host's array need not be
        self.session.write(held, rays)
        arguments = (*self.buffers.scene, held, hits, dark, np.uint32(count))
        run_probe(self.session, "probe_primitives", facts, count // lanes, *arguments)
        t, primitive = self.session.read(hits, np.float32, 2 * count).reshape(2, count)[:, :n]
        return Met(t, primitive.view(np.int32), self.session.read(dark, np.int32, count)[:n] != 0)
