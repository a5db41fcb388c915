"""The plan whose camera rays aim at lamps out of focus; the device tries through which pixels a lamp shows."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import Sights
from rptcam_cl.core.kept import identity_of_code, name_of
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan, aimed, may_aim
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.occlusion import occluded


def aimed_plan(
    plan: Plan, session: Session, layers: Iterable[str] = (), buffers: SceneBuffers | None = None
) -> tuple[Plan, SceneBuffers | None]:
    """Return the plan with camera rays that aim at lamps out of focus, and the scene on the device where it was needed.

    Without such a lamp it is the plan that was given. Tables of a scene that is not on the device yet are kept on disk:
    it is rendered once, and perhaps again by another process. A scene that is there has other tables the next moment,
    or the same lamps in other colours.

    Parameters
    ----------
    layers
        That the picture is to have.
    buffers
        The scene on the device, where it is there already.
    """
    if not may_aim(plan, layers):
        return plan, None
    held = [buffers]

    def shows(sights: Sights) -> NDArray[np.bool_]:
        scene = held[0] = held[0] or SceneBuffers(session, plan)
        return _open(sights, session, plan, scene)

    new = aimed(plan, shows, _name_of_sights(plan, session), on_disk=buffers is None)
    scene = held[0]
    return new, scene if new is plan or scene is None else SceneBuffers(session, new, scene)


def _name_of_sights(plan: Plan, session: Session) -> str | None:
    """Return a name for all that lines of sight through a scene depend on; None where textures cut holes."""
    if plan.facts["HAS_OPACITY"]:
        return None
    info = session.info
    driver = info.name, info.driver, session.kind, session.lanes
    code = identity_of_code(("plan", "rendering"), ("common", "geometry", "pass"))
    shapes = [plan.primitives, plan.kind_end, plan.movements.segments, plan.movements.of_primitive]
    meshes: list[object] = []
    if plan.meshes is not None:
        shapes += [plan.meshes.instances, plan.meshes.group_of_instance]
        meshes = [(group.key, group.shift.tolist()) for group in plan.meshes.groups]
    return name_of(code, driver, sorted(plan.facts.items()), [each.tobytes() for each in shapes], meshes)


def _open(sights: Sights, session: Session, plan: Plan, buffers: SceneBuffers) -> NDArray[np.bool_]:
    away = sights.targets - sights.origins
    distance = np.linalg.norm(away, axis=1)
    reach = np.maximum(distance - sights.short, 0.0)
    return ~occluded(session, plan, buffers, sights.origins, away / distance[:, None], reach)
