"""How the camera stands, as the page shows it."""

from __future__ import annotations

from typing import Any

from rptcam_cl._version import __version__
from rptcam_cl.scene import METHODS, LensCamera
from rptcam_cl.viewfinder.dial_list import dial_list
from rptcam_cl.viewfinder.dials import meter_needle, wheel
from rptcam_cl.viewfinder.lens_choice import MOST_FILES, files_left_out, lens_entries
from rptcam_cl.viewfinder.messages import MOST_BYTES, VERSION
from rptcam_cl.viewfinder.outbox import MOST_UNACKNOWLEDGED
from rptcam_cl.viewfinder.overlays import false_colour_legend
from rptcam_cl.viewfinder.pictures import FILE_MEDIA
from rptcam_cl.viewfinder.slot import Slot
from rptcam_cl.viewfinder.studio import Studio

MOST_CLIENTS = 4
_FOCUS = ("distance_m", "near_m", "far_m", "hyperfocal_m")


def hello_message(studio: Studio, slot: Slot, client: int) -> dict[str, Any]:
    """Return what a client learns at first."""
    return {
        "type": "hello",
        "version": VERSION,
        "program": f"rptcam {__version__}",
        "client": client,
        "scene": studio.origin.name,
        "size": list(slot.session.resolution),
        "device": slot.session.device.info.name,
        "lenses": [entry.as_dict() for entry in lens_entries(slot.scene)],
        "methods": [{"value": name, "label": name} for name in METHODS],
        "false_colour": false_colour_legend(),
        "limits": {"clients": MOST_CLIENTS, "message_bytes": MOST_BYTES, "unacknowledged": MOST_UNACKNOWLEDGED},
        "dials": dial_list(slot.dials, slot.scene, slot.resolved),
    }


def _left_out(slot: Slot) -> list[str]:
    """Return what a saved picture has and the one on the screen has not, and which lenses are not offered."""
    found = []
    if count := files_left_out(slot.scene):
        found.append(f"Of the files in the scene's folder {count} are not looked at for lenses (at most {MOST_FILES})")
    shown_by_image = slot.scene.sensor is not None or slot.session.metadata.get("diffraction", {}).get("on", False)
    if "ghosts" in slot.session.metadata and not shown_by_image:
        found.append("Ghosts of the lens are in saved pictures alone")
    return found


def state_message(studio: Studio, slot: Slot, *, detailed: bool) -> dict[str, Any]:
    """Return how camera, dials and comparison stand.

    Parameters
    ----------
    detailed
        Whether what has to be traced is there too: depth of field and image circle.
    """
    camera = slot.scene.camera
    message: dict[str, Any] = {
        "type": "state",
        "generation": slot.session.generation,
        "dials": dial_list(slot.dials, slot.scene, slot.resolved),
        "camera": {
            "kind": camera.kind,
            "lens": camera.design if isinstance(camera, LensCamera) and isinstance(camera.design, str) else None,
            "eye": list(camera.eye),
            "target": list(camera.target),
            "up": list(camera.up),
        },
        "wheel": wheel(slot.scene),
        "compare": studio.compare,
        "changed": list(slot.changes.as_dict()),
        "paused": studio.paused,
        "files": [name for name in FILE_MEDIA if name != "dng" or slot.scene.sensor is not None],
        "needle": meter_needle(slot.dials, slot.scene, slot.resolved, slot.reading_cd_m2),
        "messages": [*slot.messages, *_left_out(slot), *(studio.b.messages if studio.b is not None else ())],
    }
    if studio.b is not None:
        message["dials_b"] = dial_list(studio.b.dials, studio.b.scene, studio.b.resolved)
    if detailed and studio.panel is not None:
        message["messages"] = [*slot.scene.warnings, *message["messages"]]
        numbers = studio.panel.numbers(slot.resolved)
        message["focus"] = {name: numbers[name] for name in _FOCUS} if numbers.get("distance_m") else None
        message["guides"] = studio.panel.guides(slot.resolved)
    return message
