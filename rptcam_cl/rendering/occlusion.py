"""Ways through the scene that the device finds blocked or open."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.records import device_declarations
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers

NOTHING = -1  # a target, or a triangle of one, that no primitive is
GROUP = 4  # work items


def occluded(
    session: Session,
    plan: Plan,
    buffers: SceneBuffers,
    origins: NDArray[Any],
    directions: NDArray[Any],
    reach: NDArray[Any],
    targets: NDArray[Any] | None = None,
) -> NDArray[np.bool_]:
    """Return whether something of the scene stands on each of n ways; glass does, too.

    Parameters
    ----------
    buffers
        The scene on the device.
    origins, directions : (n, 3) arrays
        In the plan's frame of the scene [m]; directions are unit vectors.
    reach : (n,) array
        Lengths of the ways [m].
    targets : (n, 2) array, optional
        Primitive, and triangle of it, that do not count.
    """
    if not len(origins):
        return np.zeros(0, np.bool_)
    rays, group = len(origins), GROUP * session.lanes
    count = -(-rays // group) * group
    packed = np.zeros((9, count), np.float32)
    packed[5], packed[7:] = 1.0, NOTHING
    packed[:3, :rays], packed[3:6, :rays], packed[6, :rays] = origins.T, directions.T, reach
    if targets is not None:
        packed[7:, :rays] = targets.T
    facts = plan.facts | buffers.tree_facts | {"VW": session.lanes}
    program = session.program(["pass/occluded.cl"], facts, device_declarations())
    blocked = session.allocate(4 * count)
    launch = session.bind(
        program, "occluded", **buffers.scene, rays=session.upload(packed), blocked=blocked, count=np.uint32(count)
    )
    launch.enqueue(count // session.lanes, GROUP)
    return session.read(blocked, np.int32, count)[:rays] > 0
