"""Many pictures on a cluster, each a task of its own: the frames of a sequence."""

from __future__ import annotations

import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rptcam_cl.api import Image, RenderSettings, check_divisible, merge
from rptcam_cl.cluster.client import TLS, check_cluster, connected
from rptcam_cl.cluster.parcel import packed, plain_data
from rptcam_cl.cluster.tasks import Job, RenderedPart, render_scene
from rptcam_cl.cluster.tasks_out import TasksOut
from rptcam_cl.core.errors import StateError
from rptcam_cl.rendering import SUFFIX
from rptcam_cl.scene import Scene

AHEAD = 2  # pictures with each worker: the one that it renders, and the next


def render_scenes_on_cluster(
    scenes: Mapping[int, Scene],
    cluster: str | None = None,
    *,
    workers: int | None = None,
    tls: TLS | None = None,
    device: str | None = None,
    settings: Mapping[str, Any] | None = None,
    allow_mixed: bool = False,
    should_stop: Callable[[], bool] | None = None,
) -> Iterator[tuple[int, Image]]:
    """Return an iterator over the pictures of scenes by number, as they come from the workers of a cluster.

    Each worker renders whole pictures. On equal devices they have the bits of `rptcam_cl.render`.

    Parameters
    ----------
    scenes
        By number, in one folder; their files go to each worker once.
    cluster, workers, tls, device
        As for `render_on_cluster`.
    settings
        ``spp``, ``seed``, ``size``, ``crop`` and ``layers``, as for `rptcam_cl.render`.
    allow_mixed
        Whether workers of other code, another numpy or another driver are taken too.
    should_stop
        Called several times a second; True ends it.

    Raises
    ------
    InputError, DeviceError, StateError
        As `render_on_cluster` does.
    InterruptedError
        ``should_stop`` ended it.
    """
    check_cluster(cluster, workers, tls)
    words = dict(settings or {})
    for scene in scenes.values():
        check_divisible(RenderSettings(**words).applied_to(scene))
    if not scenes:
        return
    parcel = packed(*scenes.values())
    with (
        tempfile.TemporaryDirectory(prefix="rptcam-frames-") as scratch,
        connected(cluster, workers, tls, device, allow_mixed=allow_mixed) as to,
    ):
        sent, todo, left = TasksOut(to, parcel), deque(scenes), len(scenes)
        while left:
            _check(sent, should_stop)
            while todo and sent.under_way < AHEAD * sent.workers:
                number = todo.popleft()
                scene = scenes[number]
                job = Job(words, device, allow_mixed=allow_mixed)
                sent.submit(render_scene, job, number, plain_data(scene), scene.content_hash())
            came = sent.next()
            if came is not None:
                left -= 1
                yield came[1].number, _image(came[1], came[0], Path(scratch))


def _image(part: RenderedPart, worker: str, scratch: Path) -> Image:
    path = scratch / f"{part.number}{SUFFIX}"
    path.write_bytes(part.content)
    image = merge([path])
    path.unlink()
    row = {"device": part.device, "parts": 1, "seconds": round(part.seconds, 3)}
    image.stats["cluster"] = {"parts": 1, "workers": {worker: row}}
    return image


def _check(sent: TasksOut, should_stop: Callable[[], bool] | None) -> None:
    if should_stop is not None and should_stop():
        sent.cancel()
        raise InterruptedError("the pictures that are done are written")
    if sent.silent:
        raise StateError("cluster: the scheduler is gone; the pictures that are done are written (--resume goes on)")
