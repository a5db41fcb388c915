"""What a worker does: survey itself, open a render, render one part of it; one render at a time is kept open."""

from __future__ import annotations

import tempfile
import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rptcam_cl._version import __version__
from rptcam_cl.api import Found, PartRenderer, RenderSettings
from rptcam_cl.cluster.parcel import Parcel, scene_of
from rptcam_cl.core.errors import RptcamError, StateError
from rptcam_cl.device import choose_device
from rptcam_cl.rendering import SUFFIX, FilmPart


@dataclass(frozen=True)
class Job:
    """A render, as every worker gets it beside the parcel.

    Attributes
    ----------
    settings : dict
        Keyword arguments of `rptcam_cl.render` that replace keys of the scene.
    device : str or None
        The device of each worker.
    found : Found or None
        Focus and exposure, once they are known.
    count : int
        Parts of the film.
    version : str
        Of the client's program.
    """

    settings: dict[str, Any]
    device: str | None = None
    found: Found | None = None
    count: int = 1
    version: str = field(default=__version__)


@dataclass(frozen=True)
class Opened:
    """What the first worker finds: focus and exposure for all, and how long the whole film would take it [s]."""

    found: Found
    seconds: float


@dataclass(frozen=True)
class RenderedPart:
    """A part: its number, the content of its file, the device, and how long it took there [s]."""

    number: int
    content: bytes
    device: str
    seconds: float


_ONE = threading.Lock()  # a worker with several threads has one device all the same
_OPEN: dict[tuple[Any, ...], PartRenderer] = {}


def survey(device: str | None = None) -> dict[str, str]:
    """Return the version of a worker's program and its device, or under ``problem`` why it has none."""
    try:
        return {"version": __version__, "device": choose_device(device).name}
    except RptcamError as problem:
        return {"version": __version__, "problem": str(problem)}


def open_render(parcel: Parcel, job: Job) -> Opened:
    """Prepare a render: find focus and exposure, compile, measure the speed."""
    with _ONE:
        renderer = _renderer(parcel, job)
        return Opened(renderer.found, renderer.seconds())


def render_part(parcel: Parcel, job: Job, number: int) -> RenderedPart:
    """Render one part."""
    with _ONE, tempfile.TemporaryDirectory(prefix="rptcam-part-") as folder:
        renderer = _renderer(parcel, job)
        path = Path(folder) / f"{number}{SUFFIX}"
        seconds = renderer.render(FilmPart(number, job.count), path)
        return RenderedPart(number, path.read_bytes(), renderer.device, seconds)


def _renderer(parcel: Parcel, job: Job) -> PartRenderer:
    if job.version != __version__:
        raise StateError(f"a worker runs version {__version__}, and the client {job.version} (allowed: the same)")
    key = (parcel.digest, repr(replace(job, found=None, count=1)))
    renderer = _OPEN.get(key)
    if renderer is None or (job.found is not None and renderer.found != job.found):
        _OPEN.clear()
        _OPEN[key] = renderer = PartRenderer(scene_of(parcel), RenderSettings(**job.settings), job.device, job.found)
    return renderer
