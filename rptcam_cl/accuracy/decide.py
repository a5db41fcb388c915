"""The cheapest camera model whose error a picture bears."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rptcam_cl.accuracy.depths import FAR_MM, depth_range_mm
from rptcam_cl.accuracy.errors import TierError, tier_errors
from rptcam_cl.accuracy.tiers import TIERS, FirstOrderCamera, Tier, equivalent, first_order_camera
from rptcam_cl.errors import InputError
from rptcam_cl.scene import Scene
from rptcam_cl.scene.camera import RealisticCamera


@dataclass(frozen=True)
class Decision:
    """What was decided, and by which numbers.

    Attributes
    ----------
    scene : Scene
        With the camera that was chosen.
    tier : str
    errors : tuple of TierError
        Of every tier that there is for the lens.
    metadata : dict
        What the picture's metadata should say.
    """

    scene: Scene
    tier: Tier
    errors: tuple[TierError, ...] = ()
    metadata: dict[str, Any] = field(default_factory=dict)


def decided(scene: Scene) -> Decision:
    """Return a scene with the cheapest camera whose errors its `camera.accuracy` allows; as it was without that key."""
    camera = scene.camera
    if not isinstance(camera, RealisticCamera) or camera.accuracy is None:
        return Decision(scene, "realistic")
    allowed = camera.accuracy
    errors, why = _errors(scene)
    within = (
        found.tier
        for found in errors
        if found.worst_px <= allowed.max_error_px and found.worst_illumination <= allowed.max_illumination_error
    )
    tier: Tier = next(within, "realistic")
    told = {
        "camera_model": tier,
        "max_error_px": allowed.max_error_px,
        "max_illumination_error": allowed.max_illumination_error,
        "errors": [
            {"camera_model": e.tier, "pixels": list(e.pixels), "illumination": list(e.illumination)} for e in errors
        ],
        **({"reason": why} if why else {}),
    }
    return Decision(equivalent(scene, tier), tier, errors, {"accuracy": told})


def _errors(scene: Scene) -> tuple[tuple[TierError, ...], str]:
    """Return the errors of the tiers that the camera of a scene has, cheapest first, or why it has none."""
    try:
        first = first_order_camera(scene)
    except InputError as problem:
        return (), str(problem)
    tiers = []
    for tier in TIERS[:-1]:
        try:
            equivalent(scene, tier)
        except InputError:
            continue
        tiers.append(tier)
    return tuple(tier_errors(first, scene.film, _depths(scene, first), tiers)), ""


def _depths(scene: Scene, first: FirstOrderCamera) -> list[float]:
    """Return the distances ahead of the film at which errors are measured [mm]: both ends of what is seen, and the
    plane in focus."""
    width, height = (side * 1e3 for side in scene.film.size_m())
    per_tangent = 2 * first.film_mm_per_tangent
    ends = depth_range_mm(scene, (width / per_tangent, height / per_tangent))
    nearest = first.setting.film_distance_mm + first.setting.lens.length
    focus = first.setting.focus_distance_mm
    inside = [] if focus is None else [min(focus, FAR_MM)]
    return sorted({max(depth, nearest * 1.01) for depth in (*ends, *inside)})
