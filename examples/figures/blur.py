"""The blur of a card before a camera, as the camera's own rays leave it on the film."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rptcam_cl.api.job import render

ACROSS = 800  # pixels
MIDDLE = [0.495, 0.505, 0.495, 0.505]


def card_blur(
    camera: Mapping[str, Any], distance: float, film: Mapping[str, Any] | None = None, metres_per_unit: float = 1.0
) -> float:
    """Return the blur [pixels of 800] in the middle of a card at right angles to the axis, some units from the eye."""
    card = {"shape": "disk", "center": [0, 0, -distance], "normal": [0, 0, 1], "radius": 0.2 * distance}
    scene = {
        "metres_per_unit": metres_per_unit,
        "film": {"resolution": [ACROSS, 3 * ACROSS // 4], "crop": MIDDLE, **(film or {})},
        "camera": {"eye": [0, 0, 0], "target": [0, 0, -1], **camera},
        "objects": [card | {"material": {"kind": "matte", "reflectance": 0.5}}],
        "environment": {"kind": "constant", "radiance": 1},
    }
    return float(np.mean(render(scene, spp=1, layers=["coc"])["coc"]))


def confusion(camera: Any, distance: Any) -> Any:
    """Return the circle of confusion of a thin lens [pixels of 800] at distances [m], by formula.

    In the plane of focus the blur is the aperture's diameter times the share of the way that is left to that plane.
    """
    focus = camera.focus_distance_m
    width = 2 * focus * math.tan(math.radians(camera.fov_degrees) / 2)
    return ACROSS / width * 2 * camera.aperture_radius_m * abs(distance - focus) / distance


def thin_lens_blurs(camera: Any, distance: float) -> tuple[float, float]:
    """Return the blur [pixels of 800] of a card through a thin lens of a scene, by formula and by our camera."""
    ours = card_blur(
        {
            "kind": "thin_lens",
            "fov_degrees": camera.fov_degrees,
            "aperture_radius_m": camera.aperture_radius_m,
            "focus_distance_m": camera.focus_distance_m,
        },
        distance,
    )
    return float(confusion(camera, distance)), ours
