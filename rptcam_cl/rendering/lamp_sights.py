"""The plan whose camera rays aim at lamps out of focus; the device tries through which pixels a lamp shows."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import Sights
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan, aimed
from rptcam_cl.rendering.buffers import SceneBuffers

GROUP = 4  # work items


def aimed_plan(
    plan: Plan, session: Session, layers: Iterable[str] = (), buffers: SceneBuffers | None = None
) -> tuple[Plan, SceneBuffers | None]:
    """Return the plan with camera rays that aim at lamps out of focus, and the scene on the device where it was needed.

    Without such a lamp it is the plan that was given.

    Parameters
    ----------
    layers
        That the picture is to have.
    buffers
        The scene on the device, where it is there already.
    """
    held = [buffers]

    def shows(sights: Sights) -> NDArray[np.bool_]:
        scene = held[0] = held[0] or SceneBuffers(session, plan)
        return _open(sights, session, plan, scene)

    new = aimed(plan, shows, layers)
    scene = held[0]
    return new, scene if new is plan or scene is None else SceneBuffers(session, new, scene)


def _open(sights: Sights, session: Session, plan: Plan, buffers: SceneBuffers) -> NDArray[np.bool_]:
    count, group = len(sights.origins), GROUP * session.lanes
    capacity = -(-count // group) * group
    away = sights.targets - sights.origins
    distance = np.linalg.norm(away, axis=1)
    lines = np.zeros((7, capacity), np.float32)
    lines[5] = 1.0
    lines[:3, :count], lines[3:6, :count] = sights.origins.T, (away / distance[:, None]).T
    lines[6, :count] = np.maximum(distance - sights.short, 0.0)
    facts = plan.facts | buffers.tree_facts | {"VW": session.lanes}
    program = session.program(["pass/lamp_sights.cl"], facts, device_declarations())
    out = session.allocate(4 * capacity)
    launch = session.bind(
        program, "lamp_sights", **buffers.scene, lines=session.upload(lines), shows=out, capacity=np.uint32(capacity)
    )
    launch.enqueue(capacity // session.lanes, GROUP)
    session.finish()
    return session.read(out, np.float32, capacity)[:count] > 0.5
