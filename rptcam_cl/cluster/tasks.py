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
from rptcam_cl.core.kept import Maker, OneMaker, made_by
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
    version, code
        Of the client's program.
    allow_mixed : bool
        Whether a worker may have other code.
    """

    settings: dict[str, Any]
    device: str | None = None
    found: Found | None = None
    count: int = 1
    version: str = field(default=__version__)
    code: Maker = field(default_factory=lambda: made_by(()))
    allow_mixed: bool = False


@dataclass(frozen=True)
class Opened:
    """What the first worker finds: focus and exposure for all, how long the film would take it [s], and what it is."""

    found: Found
    seconds: float
    made_by: Maker


@dataclass(frozen=True)
class RenderedPart:
    """A part: its number, the content of its file, the device, how long it took there [s], and what made it."""

    number: int
    content: bytes
    device: str
    seconds: float
    made_by: Maker


_ONE = threading.Lock()  # a worker with several threads has one device all the same
_OPEN: dict[tuple[Any, ...], PartRenderer] = {}


def survey(device: str | None = None) -> dict[str, Any]:
    """Return the version of a worker's program, what it is, and its device, or under ``problem`` why it has none."""
    try:
        info = choose_device(device)
        return {"version": __version__, "device": info.name, "made_by": made_by([info.driver])}
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
        return Opened(renderer.found, renderer.seconds(), renderer.made_by)


def render_part(digest: str, job: Job, number: int) -> RenderedPart:
    """Render one part."""
    with _ONE:
        renderer = _renderer(digest, job)
        content, seconds = renderer.render(FilmPart(number, job.count))
        return RenderedPart(number, content, renderer.device, seconds, renderer.made_by)


def render_scene(digest: str, job: Job, number: int, data: dict[str, Any], content_hash: str) -> RenderedPart:
    """Render a whole picture of a scene whose files are in the parcel, and that has this content hash."""
    with _ONE:
        _check_version(job)
        scene = load_scene(data, base_dir=scene_of(digest).base_dir)
        if scene.content_hash() != content_hash:
            raise StateError("the scene is not the one that was sent: a file has changed, or a link leads elsewhere")
        renderer = PartRenderer(scene, RenderSettings(**job.settings), job.device)
        content, seconds = renderer.render(FilmPart())
        return RenderedPart(number, content, renderer.device, seconds, renderer.made_by)


def _check_version(job: Job) -> None:
    if job.version != __version__:
        raise StateError(f"a worker runs version {__version__}, and the client {job.version} (allowed: the same)")
    if job.code != made_by(()) and not job.allow_mixed:
        same = OneMaker()
        same.add("the client", job.code)
        same.add("cluster: a worker", made_by(()))


def _renderer(digest: str, job: Job) -> PartRenderer:
    """Return what renders the parts of a job: prepared once, unless another worker has found other focus or light."""
    _check_version(job)
    key = (digest, repr(replace(job, found=None, count=1)))
    renderer = _OPEN.get(key)
    if renderer is None or (job.found is not None and not job.found.is_same(renderer.found)):
        _OPEN.clear()
        _OPEN[key] = renderer = PartRenderer(scene_of(digest), RenderSettings(**job.settings), job.device, job.found)
    return renderer
