"""rptcam_cl: a path tracer whose cameras are real cameras, in Python and OpenCL."""

from __future__ import annotations

from rptcam_cl._version import __version__
from rptcam_cl.core.errors import DeviceError, InputError, NumericError, RptcamError, StateError

TYPE_CHECKING = False  # as of `typing`, which takes longer to import than an interrupt may go unheeded
if TYPE_CHECKING:
    from typing import Any

    from rptcam_cl.api import (
        Change,
        FocusReport,
        Frame,
        Image,
        Progress,
        RenderSession,
        Scene,
        autofocus,
        choose_device,
        develop,
        devices,
        focused_scene,
        load_lens,
        load_scene,
        measure_tradeoff,
        merge,
        render,
        settle,
        sweep,
        tolerance,
    )
    from rptcam_cl.cluster import render_on_cluster
    from rptcam_cl.datasets import dataset

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
    """Import the interface at first use, so that ``rptcam_cl.optics`` alone needs no OpenCL."""
    if name == "render_on_cluster":
        from rptcam_cl import cluster

        return cluster.render_on_cluster
    if name == "dataset":
        from rptcam_cl import datasets

        return datasets.dataset
    if name in __all__:
        from rptcam_cl import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
