"""The plan whose camera rays aim at lamps out of focus; the device tries through which pixels a lamp shows."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import Sights
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan, aimed
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.occlusion import occluded


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
    away = sights.targets - sights.origins
    distance = np.linalg.norm(away, axis=1)
    reach = np.maximum(distance - sights.short, 0.0)
    return ~occluded(session, plan, buffers, sights.origins, away / distance[:, None], reach)
