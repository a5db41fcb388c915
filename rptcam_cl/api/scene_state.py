"""A scene as a session renders it, and what changes of it come to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.frames import Kind
from rptcam_cl.api.image_layers import truth_of
from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.api.stages import Prepared, Resolved, report
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.imaging import Image
from rptcam_cl.plan import Plan, PlanParts, make_plan, with_film, with_lens, with_pose
from rptcam_cl.rendering import FilmRun, SceneBuffers, ghosting_of, reading_cd_m2, rendering_of
from rptcam_cl.scene import LEAST_CD_M2, MOST_CD_M2, Film, Scene, set_keys

ANOTHER_LENS = ("kind", "lens", "zoom", "focal_length_mm")  # keys of the camera after which a focus found is void
OF_DEVELOPMENT = {"picture"}  # parts of a scene that change no film
OF_THE_LENS = {"camera", "exposure", "picture"}  # parts of a scene that objects and lights do not go by


@dataclass(frozen=True, eq=False)
class SceneState:
    """A scene with all that rendering it takes.

    Attributes
    ----------
    scene : Scene
        As requested.
    found : Resolved
    plan : Plan
    buffers : SceneBuffers
        The plan on the device.
    is_final : bool
        Whether exposure and pupil are those of a render, and not found in a quicker way for glances.
    """

    scene: Scene
    found: Resolved
    plan: Plan
    buffers: SceneBuffers
    is_final: bool


def focuses_anew(changes: Mapping[str, Any], scene: Scene) -> bool:
    """Return whether a change asks for autofocus in the scene that it leads to, or takes another lens."""
    keys = [key.split(".") for key in changes]
    if any(key[0] == "camera" and (len(key) == 1 or key[1] in ANOTHER_LENS) for key in keys):
        return True
    return scene.requested_autofocus is not None and any(key[:2] == ["camera", "focus"] for key in keys)


def focused_as(state: SceneState, scene: Scene) -> Scene:
    """Return a scene with the focus that was found for another state of it, where it asks for autofocus."""
    known = state.found.focus
    if known is None or scene.requested_autofocus is None:
        return scene
    return set_keys(scene, {f"camera.{key}": value for key, value in known["camera"].items()})


def changed_parts(before: Scene, after: Scene) -> tuple[str, ...]:
    """Return the keys at the top of a scene that say something else."""
    one, other = before.made_of, after.made_of
    return tuple(name for name in Scene.model_fields if not _is_same(one.get(name), other.get(name)))


def _is_same(one: Any, other: Any) -> bool:
    if one is other:
        return True
    try:
        return bool(one == other)
    except ValueError:  # of arrays in them
        return False


def kind_of(before: Plan, after: Plan, compiled: bool, keys: tuple[str, ...]) -> Kind:
    """Return the dearest that another plan takes."""
    if not compiled:
        return "program"
    return "camera" if before.facts == after.facts and set(keys) <= {"camera", "exposure", "shutter"} else "scene"


def plan_beside(before: SceneState, scene: Scene, resolved: Scene, parts: PlanParts) -> Plan:
    """Return the plan of a scene for glances, made of the plan before where nothing but the lens is another."""
    same_time = before.found.scene.shutter == resolved.shutter  # where things that move are
    if same_time and set(changed_parts(before.scene, scene)) <= OF_THE_LENS:
        if _moves_alone(before, scene, resolved):
            return with_pose(before.plan, resolved, parts)
        return with_lens(before.plan, resolved, coarse=True)
    return make_plan(resolved, coarse=True, parts=parts)


def _moves_alone(before: SceneState, scene: Scene, resolved: Scene) -> bool:
    """Return whether nothing but the place of a camera is another, which focuses by no point of the scene."""
    earlier, camera = before.found.scene, resolved.camera
    focus = getattr(scene.camera, "focus", None)
    if getattr(focus, "point", None) or getattr(focus, "object", None):
        return False
    if camera.motion or scene.shutter.keys or before.plan.facts["MOVES"]:
        return False
    place = {"eye": camera.eye, "target": camera.target, "up": camera.up}
    alike = earlier.film == resolved.film and earlier.exposure == resolved.exposure
    return alike and earlier.camera.model_copy(update=place) == camera


def scaled(state: SceneState, scale: float, reading: float | None) -> tuple[Plan, Film]:
    """Return the plan of a state with a film of fewer pixels, exposed by a reading of the meter; and that film."""
    film = state.found.scene.film
    columns, rows = (max(round(side * scale), 1) for side in film.resolution)
    if state.scene.camera.kind == "environment":
        columns = 2 * rows
    smaller = film.model_copy(update={"resolution": (columns, rows)})
    plan, metered = with_film(state.plan, state.found.scene, smaller), state.found.metered_cd_m2
    if metered is not None and reading is not None:
        plan.camera.record["exposure"] *= metered / reading
    return plan, smaller


def image_of(
    state: SceneState, plan: Plan, run: FilmRun, settings: RenderSettings, *, seconds: float, begun: float
) -> Image:
    """Return a film as `render` returns it.

    Parameters
    ----------
    state, plan, run, settings
        What was rendered, with the plan of its film, its whole film, and the settings of `render` that stand for it.
    seconds, begun
        What the samples took [s], and when all of it began, by `time.perf_counter` [s].
    """
    rendering = rendering_of(run, start=0, seconds=seconds, new_samples=run.wavefront.camera_rays, interrupted=False)
    layers = state.scene.render.layers
    truth = truth_of(state.found.scene, state.plan, run.wavefront, layers, settings)
    prepared = Prepared(
        settings, state.scene, layers, state.found.scene, state.found.metadata, plan,
        run.wavefront, None, None, begun, {"start": 0.0, "compile": 0.0}, state.found.diffraction,
        ghosting_of(state.found.ghosts, state.plan, run.wavefront.session), truth,
    )  # fmt: skip
    return report(prepared, rendering)


def reading_of(pixels: NDArray[np.float32], plan: Plan, state: SceneState, film: Film) -> float | None:
    """Return what the exposure meter reads of a glance; None where it has seen a part of the film, or hardly light."""
    if film.crop is not None or state.scene.exposure.lock_cd_m2:
        return None
    per_radiance = float(plan.camera.record["exposure"][0]) * plan.camera.axial_weight
    reading = reading_cd_m2(pixels, state.scene.exposure, film) / per_radiance
    return reading if LEAST_CD_M2 <= reading <= MOST_CD_M2 else None
