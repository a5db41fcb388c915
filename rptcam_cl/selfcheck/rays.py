"""Rays against the meshes and the objects of a scene, by the kernels that render."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.device import Session
from rptcam_cl.plan import make_plan
from rptcam_cl.rendering import SceneBuffers, scene_trees
from rptcam_cl.scene import load_scene
from rptcam_cl.selfcheck.check import GROUP, run_probe

MATTE = {"kind": "matte", "reflectance": 0.5}


@dataclass(frozen=True)
class MeshHits:
    """What rays met: NaN-free arrays of one entry per ray."""

    t: NDArray[np.float32]
    primitive: NDArray[np.int32]
    part: NDArray[np.int32]
    weights: NDArray[np.float32]
    point: NDArray[np.float32]
    normal: NDArray[np.float32]
    offset: NDArray[np.float32]
    blocked: NDArray[np.bool_]


def mesh_object(points: Any, faces: Any, **keys: Any) -> dict[str, Any]:
    """Return the mapping of a mesh that is written out."""
    return {
        "shape": "mesh",
        "vertices": np.asarray(points, np.float64).tolist(),
        "faces": np.asarray(faces).tolist(),
        "material": MATTE,
    } | keys


class MeshScene:
    """Objects with meshes on a device, the eye at the origin."""

    def __init__(self, session: Session, objects: list[dict[str, Any]], **keys: Any) -> None:
        camera = {"kind": "pinhole", "eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0], "fov_degrees": 40}
        self.plan = make_plan(load_scene({"camera": camera, "objects": objects, **keys}))
        self.session = session
        self.buffers = SceneBuffers(session, self.plan)
        assert self.plan.meshes is not None
        self.trees = scene_trees(self.plan.meshes, session)

    def _run(self, probe: str, items: int, lanes: int, **arguments: Any) -> None:
        facts = self.plan.facts | self.buffers.tree_facts | {"VW": lanes}
        run_probe(self.session, probe, facts, items, **self.buffers.scene, **arguments)

    def trace(self, o: Any, d: Any, reach: Any = 3e38, self_part: Any = None, lanes: int = 8) -> MeshHits:
        """Return what the rays (n, 3) meet."""
        n = len(o)
        count = -(-n // (GROUP * 8)) * GROUP * 8
        rays = np.zeros((9, count), np.float32)
        rays[:3, :n], rays[3:6, :n] = np.asarray(o).T, np.asarray(d).T
        rays[3, n:] = 1
        rays[6:8] = np.int32(-1).view(np.float32)
        if self_part is not None:
            rays[6:8, :n] = np.asarray(self_part, np.int32).view(np.float32)
        rays[8, :n] = reach
        out, dark = self.session.allocate(48 * count), self.session.allocate(4 * count)
        held = self.session.upload(rays)
        self._run("probe_hits", count // lanes, lanes, rays=held, hits=out, blocked=dark, count=np.uint32(count))
        rows = self.session.read(out, np.float32, 12 * count).reshape(12, count)[:, :n]
        blocked = self.session.read(dark, np.int32, count)[:n] != 0
        return MeshHits(
            rows[0], rows[1].view(np.int32), rows[2].view(np.int32), rows[3:5].T, rows[5:8].T, rows[8:11].T, rows[11],
            blocked,
        )  # fmt: skip

    def brute(self, o: Any, d: Any) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return distance and triangle of the nearest hits, without the tree."""
        count = len(o)
        rays = np.zeros((9, count), np.float32)
        rays[:3], rays[3:6] = np.asarray(o).T, np.asarray(d).T
        out, blocks = self.session.allocate(8 * count), np.uint32(len(self.trees.blocks))
        held = self.session.upload(rays)
        self._run("probe_brute", count, 1, rays=held, hits=out, block_count=blocks, count=np.uint32(count))
        rows = self.session.read(out, np.float32, 2 * count).reshape(2, count)
        return rows[0], rows[1].view(np.int32)

    def departures(self, o: Any, d: Any, onward: Any, lanes: int = 8) -> NDArray[np.int32]:
        """Return 1 where a ray that leaves the point met goes on to meet something, 0 where not, -1 without a point."""
        count = len(o)
        rays = np.concatenate([np.asarray(rows, np.float32).T for rows in (o, d, onward)])
        out = self.session.allocate(4 * count)
        held = self.session.upload(np.ascontiguousarray(rays))
        self._run("probe_departure", count // lanes, lanes, rays=held, again=out, count=np.uint32(count))
        return self.session.read(out, np.int32, count)


NOTHING = -1
TREE_ARGUMENTS = ("primitive_nodes", "primitive_leaves")


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


class ObjectRays:
    """Objects on a device, the eye where requested; with a tree over them where they are many."""

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

    def without_tree(self) -> ObjectRays:
        """Return the same objects, all of which every ray is tested against; they must hold no mesh."""
        assert self.has_tree
        assert self.plan.meshes is None
        other = copy.copy(self)
        other.buffers = copy.copy(self.buffers)
        other.buffers.scene = {name: value for name, value in self.buffers.scene.items() if name not in TREE_ARGUMENTS}
        other.buffers.tree_facts = {}
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
        run_probe(
            self.session, "probe_primitives", facts, count // lanes, **self.buffers.scene, rays=held, hits=hits,
            blocked=dark, count=np.uint32(count),
        )  # fmt: skip
        t, primitive = self.session.read(hits, np.float32, 2 * count).reshape(2, count)[:, :n]
        return Met(t, primitive.view(np.int32), self.session.read(dark, np.int32, count)[:n] != 0)
