"""What a worker does: survey itself, open a render, render one part of it; one render at a time is kept open."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import field, replace
from typing import Any

from rptcam_cl._version import __version__
from rptcam_cl.api import Found, PartRenderer, RenderSettings
from rptcam_cl.cluster.parcel import Parcel, has_scene, keep_scene, scene_of
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import RptcamError, StateError
from rptcam_cl.device import choose_device
from rptcam_cl.rendering import FilmPart
from rptcam_cl.scene import load_scene


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


def at_worker(function: Callable[..., Any], digest: str, parcel: Parcel | None, *words: Any) -> tuple[str, Any]:
    """Return the address of this worker, and what a function returns for a scene; None where it is not here.

    A worker keeps the scenes of the last parcels, so that no task waits for another worker to send one.
    """
    from distributed import get_worker

    if parcel is not None:
        keep_scene(parcel)
    return get_worker().address, function(digest, *words) if has_scene(digest) else None


def hold_scene(digest: str) -> str:
    """Do nothing: what is to be done is that the scene is there."""
    return digest


def open_render(digest: str, job: Job) -> Opened:
    """Prepare a render: find focus and exposure, compile, measure the speed."""
    with _ONE:
        renderer = _renderer(digest, job)
        return Opened(renderer.found, renderer.seconds())


def render_part(digest: str, job: Job, number: int) -> RenderedPart:
    """Render one part."""
    with _ONE:
        renderer = _renderer(digest, job)
        content, seconds = renderer.render(FilmPart(number, job.count))
        return RenderedPart(number, content, renderer.device, seconds)


def render_scene(digest: str, job: Job, number: int, data: dict[str, Any], content_hash: str) -> RenderedPart:
    """Render a whole picture of a scene whose files are in the parcel, and that has this content hash."""
    with _ONE:
        _check_version(job)
        scene = load_scene(data, base_dir=scene_of(digest).base_dir)
        if scene.content_hash() != content_hash:
            raise StateError("the scene is not the one that was sent: a file has changed, or a link leads elsewhere")
        renderer = PartRenderer(scene, RenderSettings(**job.settings), job.device)
        content, seconds = renderer.render(FilmPart())
        return RenderedPart(number, content, renderer.device, seconds)


def _check_version(job: Job) -> None:
    if job.version != __version__:
        raise StateError(f"a worker runs version {__version__}, and the client {job.version} (allowed: the same)")


def _renderer(digest: str, job: Job) -> PartRenderer:
    """Return what renders the parts of a job: prepared once, unless another worker has found other focus or light."""
    _check_version(job)
    key = (digest, repr(replace(job, found=None, count=1)))
    renderer = _OPEN.get(key)
    if renderer is None or (job.found is not None and not job.found.is_same(renderer.found)):
        _OPEN.clear()
        _OPEN[key] = renderer = PartRenderer(scene_of(digest), RenderSettings(**job.settings), job.device, job.found)
    return renderer
