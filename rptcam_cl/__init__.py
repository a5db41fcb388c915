"""rptcam_cl: a path tracer whose cameras are real cameras, in Python and OpenCL."""

from __future__ import annotations

from rptcam_cl.core import __version__
from rptcam_cl.core.errors import DeviceError, InputError, NumericError, RptcamError, StateError

TYPE_CHECKING = False  # as of `typing`, which takes longer to import than an interrupt may go unheeded
if TYPE_CHECKING:
    from typing import Any

    from rptcam_cl.api.combined import sweep
    from rptcam_cl.api.job import merge, render, settle
    from rptcam_cl.api.session import Change, Frame, RenderSession
    from rptcam_cl.batch.cluster_run import render_on_cluster
    from rptcam_cl.batch.dataset import dataset
    from rptcam_cl.device.devices import choose_device, devices
    from rptcam_cl.imaging.image import Image, develop
    from rptcam_cl.rendering.progressive import Progress
    from rptcam_cl.rendering.tolerance_run import tolerance
    from rptcam_cl.rendering.traceable_lens import load_lens
    from rptcam_cl.scene.load import load_scene
    from rptcam_cl.scene.scene import Scene
    from rptcam_cl.studies.focus.controller import autofocus, focused_scene
    from rptcam_cl.studies.focus.probe import FocusReport
    from rptcam_cl.studies.tradeoff_runs import measure_tradeoff

# Where the interface is, imported at the first use of a name, so that ``rptcam_cl.optics`` alone needs no OpenCL.
_MODULES = {
    "api.job": "merge render settle",
    "api.session": "Change Frame RenderSession",
    "api.combined": "sweep",
    "batch.cluster_run": "render_on_cluster",
    "batch.dataset": "dataset",
    "device.devices": "choose_device devices",
    "imaging.image": "Image develop",
    "rendering.progressive": "Progress",
    "rendering.tolerance_run": "tolerance",
    "rendering.traceable_lens": "load_lens",
    "scene.load": "load_scene",
    "scene.scene": "Scene",
    "studies.focus.controller": "autofocus focused_scene",
    "studies.focus.probe": "FocusReport",
    "studies.tradeoff_runs": "measure_tradeoff",
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "Change",
    "DeviceError",
    "FocusReport",
    "Frame",
    "Image",
    "InputError",
    "NumericError",
    "Progress",
    "RenderSession",
    "RptcamError",
    "Scene",
    "StateError",
    "__version__",
    "autofocus",
    "choose_device",
    "dataset",
    "develop",
    "devices",
    "focused_scene",
    "load_lens",
    "load_scene",
    "measure_tradeoff",
    "merge",
    "render",
    "render_on_cluster",
    "settle",
    "sweep",
    "tolerance",
]


def __getattr__(name: str) -> Any:
    """Import a name of the interface at its first use."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    globals()[name] = value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    return value
