"""The Python interface: load a scene, choose a device, focus, render, develop.

A render has three stages, each of which can be called alone: `prepare`, `run` and `report`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.interface import devices, load_lens, render
from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.api.stages import Prepared, check_divisible, picture_so_far, prepare, report, run
from rptcam_cl.device import choose_device
from rptcam_cl.imaging import Image, develop
from rptcam_cl.rendering import Progress
from rptcam_cl.scene import Scene, load_scene

if TYPE_CHECKING:
    from rptcam_cl.api.frames import Change, Frame
    from rptcam_cl.api.merging import merge
    from rptcam_cl.api.part_renderer import Found, PartRenderer
    from rptcam_cl.api.resolving import Settlement, settle
    from rptcam_cl.api.series import SeriesRenderer
    from rptcam_cl.api.session import RenderSession
    from rptcam_cl.api.sweeping import SweepEntry, sweep
    from rptcam_cl.api.tracking import FrameTracker, needs_tracking
    from rptcam_cl.focusing import FocusReport, autofocus, focused_scene
    from rptcam_cl.tolerances import tolerance
    from rptcam_cl.tradeoff import measure_tradeoff

__all__ = [
    "Change",
    "FocusReport",
    "Found",
    "Frame",
    "FrameTracker",
    "Image",
    "PartRenderer",
    "Prepared",
    "Progress",
    "RenderSession",
    "RenderSettings",
    "Scene",
    "SeriesRenderer",
    "Settlement",
    "SweepEntry",
    "autofocus",
    "check_divisible",
    "choose_device",
    "develop",
    "devices",
    "focused_scene",
    "load_lens",
    "load_scene",
    "measure_tradeoff",
    "merge",
    "needs_tracking",
    "picture_so_far",
    "prepare",
    "render",
    "report",
    "run",
    "settle",
    "sweep",
    "tolerance",
]

# What a render of one picture does not need: imported at its first use, so that every command starts sooner.
_LATER = {
    "Change": "api.frames",
    "FocusReport": "focusing",
    "Found": "api.part_renderer",
    "Frame": "api.frames",
    "PartRenderer": "api.part_renderer",
    "RenderSession": "api.session",
    "SeriesRenderer": "api.series",
    "Settlement": "api.resolving",
    "SweepEntry": "api.sweeping",
    "autofocus": "focusing",
    "FrameTracker": "api.tracking",
    "needs_tracking": "api.tracking",
    "focused_scene": "focusing",
    "measure_tradeoff": "tradeoff",
    "merge": "api.merging",
    "settle": "api.resolving",
    "sweep": "api.sweeping",
    "tolerance": "tolerances",
}


def __getattr__(name: str) -> Any:
    """Import what few commands use at its first use."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found = getattr(import_module(f"rptcam_cl.{_LATER[name]}"), name)
    return found
