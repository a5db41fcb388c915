"""The lens for Cycles: the shader that traces it, and where its camera stands."""

from __future__ import annotations

from typing import Any

from rptcam_cl.exchange.camera_files import osl_text
from rptcam_cl.exchange.camera_models import view
from rptcam_cl.scene.load import load_scene


def shader(keys: dict[str, Any]) -> tuple[str, float]:
    """The text of the shader for the camera of an export, and how far behind the pupil its film stands [units].

    Raises
    ------
    InputError
        Where the lens cannot be said in a shader.
    """
    alone = {name: keys[name] for name in ("metres_per_unit", "film", "camera", "shutter") if name in keys}
    seen = view(load_scene(alone))
    return osl_text(seen), seen.pupil_ahead_mm / 1000 / float(keys["metres_per_unit"])
