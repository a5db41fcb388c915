"""Many pictures on a cluster, each a task of its own: the frames of a sequence."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rptcam_cl.api import Image, RenderSettings, check_divisible, merge
from rptcam_cl.cluster.client import Credentials, check_cluster, connected
from rptcam_cl.cluster.parcel import packed, plain_data
from rptcam_cl.cluster.tasks import Job, RenderedPart, hold_scene, render_scene
from rptcam_cl.cluster.tasks_out import TasksOut
from rptcam_cl.core.atomic import scratch_folder
from rptcam_cl.rendering import SUFFIX
from rptcam_cl.scene import Scene


def render_scenes_on_cluster(
    scenes: Mapping[int, Scene],
    cluster: str | None = None,
    *,
    workers: int | None = None,
    tls: Credentials = None,
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
    todo = (
        (Job(words, device, allow_mixed=allow_mixed), number, plain_data(scene), scene.content_hash())
        for number, scene in scenes.items()
    )
    to_cluster = connected(cluster, workers, tls, device, allow_mixed=allow_mixed)
    with scratch_folder() as scratch, to_cluster as (client, there):
        sent = TasksOut(client, parcel, there, "; the pictures that are done are written (--resume goes on)")

        def check() -> None:
            if should_stop is not None and should_stop():
                sent.cancel()
                raise InterruptedError("the pictures that are done are written")

        sent.first(hold_scene, (), check)
        for worker, part in sent.results(render_scene, todo, check):
            yield part.number, _image(part, worker, Path(scratch))


def _image(part: RenderedPart, worker: str, scratch: Path) -> Image:
    path = scratch / f"{part.number}{SUFFIX}"
    path.write_bytes(part.content)
    image = merge([path])
    path.unlink()
    row = {"device": part.device, "parts": 1, "seconds": round(part.seconds, 3)}
    image.stats["cluster"] = {"parts": 1, "workers": {worker: row}}
    return image

