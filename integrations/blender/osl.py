"""The lens for Cycles: the shader that traces it, where Blender's camera stands."""

from __future__ import annotations

from typing import Any

from rptcam_cl.exchange.camera_files import osl_text
from rptcam_cl.exchange.camera_view import view
from rptcam_cl.scene.load import load_scene


def shader(keys: dict[str, Any]) -> str:
    """The text of the shader for the camera of an export; raises `InputError` where the lens cannot be said."""
    return osl_text(view(load_scene(only_camera(keys))))


def only_camera(keys: dict[str, Any]) -> dict[str, Any]:
    """The export without what is in front of its camera."""
    return {name: keys[name] for name in ("metres_per_unit", "film", "camera", "shutter") if name in keys}
