"""Rays against the objects of a scene by the kernels that render, with the tree over primitives or without."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rptcam_cl.acceleration import primitive_tree
from rptcam_cl.device import Session
from rptcam_cl.plan import make_plan
from rptcam_cl.records import device_declarations
from rptcam_cl.scene import load_scene
from rptcam_cl.wavefront.buffers import SceneBuffers

KERNEL = str(Path(__file__).parent / "kernels" / "probe_primitives.cl")
GROUP = 16
NOTHING = -1


@dataclass(frozen=True)
class Met:
    """What rays met: distance and primitive of the nearest hit, and whether anything lay in the way."""

    t: NDArray[np.float32]
    primitive: NDArray[np.int32]
    blocked: NDArray[np.bool_]

    def unlike(self, other: Met) -> NDArray[np.bool_]:
        """Return which rays met something else, to the last bit."""
        return (
            (self.t.view(np.int32) != other.t.view(np.int32))
            | (self.primitive != other.primitive)
            | (self.blocked != other.blocked)
        )


def with_tree(monkeypatch: pytest.MonkeyPatch, wanted: bool) -> None:
    """Make scenes get a tree over their primitives however few they are, or never."""
    monkeypatch.setattr(primitive_tree, "BREAK_EVEN", 0 if wanted else 1 << 30)


class Objects:
    """Objects on a device, the eye where it is asked for; whether they have a tree is settled by `with_tree`."""

    def __init__(self, session: Session, objects: list[dict[str, Any]], eye: Any = (0, 0, 0), **keys: Any) -> None:
        target = [eye[0], eye[1], eye[2] - 1]
        camera = {"kind": "pinhole", "eye": list(eye), "target": target, "up": [0, 1, 0], "fov_degrees": 40}
        self.plan = make_plan(load_scene({"camera": camera, "objects": objects, **keys}))
        self.session = session
        self.buffers = SceneBuffers(session, self.plan)

    @property
    def has_tree(self) -> bool:
        return "HAS_PRIMITIVE_TREE" in self.buffers.tree_facts

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
        program = self.session.program([KERNEL], facts, device_declarations())
        held = self.session.allocate(rays.nbytes)  # aligned for packs, as the host's array need not be
        self.session.write(held, rays)
        arguments = (*self.buffers.scene, held, hits, dark, np.uint32(count))
        self.session.bind(program, "probe_primitives", *arguments).enqueue(count // lanes, GROUP)
        self.session.finish()
        t, primitive = self.session.read(hits, np.float32, 2 * count).reshape(2, count)[:, :n]
        return Met(t, primitive.view(np.int32), self.session.read(dark, np.int32, count)[:n] != 0)
