"""Renders on a cluster: parts or frames go out, and files come back into a folder."""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Any

from rptcam_cl.api.job import check_divisible, merge
from rptcam_cl.api.options import OF_A_CLUSTER, RenderOptions
from rptcam_cl.batch.cluster import (
    Credentials,
    Job,
    Parcel,
    RenderedPart,
    TasksOut,
    check_cluster,
    connect,
    hold_scene,
    open_render,
    pack_scene,
    render_part,
    render_scene,
)
from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass, with_keywords
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.files import make_folder, remove_strays, replacing, resolve_links, scratch_folder
from rptcam_cl.core.remember import OneMaker, made_by
from rptcam_cl.imaging.image import Image
from rptcam_cl.rendering.checkpoint import SUFFIX, read_part
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.progressive import Progress
from rptcam_cl.scene.load import SceneSource, plain_data, read_scene
from rptcam_cl.scene.scene import Scene

# The folder of a render on a cluster: its plan, and the parts that have come back; a later run goes on from it.

_PLAN = "plan.json"


_PartsPlan = dict[str, Any]
"""How a render is divided: ``version`` of the program, ``scene``, the hash with all that changes the picture, ``spp``,
``layers``, their names and their samples per pixel, ``count`` of the parts, ``found``, focus and exposure, the same for
all, and ``made_by``, what the first of them was made by."""

_PLAN_KEYS = {"version", "scene", "spp", "layers", "count", "found", "made_by"}


class PartsFolder:
    """Parts of one render on disk.

    Parameters
    ----------
    path
        The folder; made when the plan is written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def clear(self) -> None:
        """Remove what an earlier render left, and the folder if nothing else is in it.

        Raises
        ------
        StateError
            It is no folder.
        """
        if not self.path.is_dir():
            if self.path.exists():
                raise StateError(f"{self.path}: is no folder, and parts are kept there (move it, or rename the output)")
            return
        remove_strays(self.path)
        for file in [*self.path.glob(f"*{SUFFIX}"), self.path / _PLAN]:
            file.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.path.rmdir()

    def plan(self) -> _PartsPlan | None:
        """Return the plan of an earlier run; None where there is none.

        Raises
        ------
        StateError
            It cannot be read.
        """
        path = self.path / _PLAN
        try:
            plan: _PartsPlan = json.loads(path.read_text("utf-8"))
            if plan.keys() != _PLAN_KEYS or plan["found"].keys() != {"focus", "metered_cd_m2"}:
                raise ValueError("it is damaged")
            return plan
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError, AttributeError) as problem:
            raise StateError(f"{path}: cannot be read ({problem}; remove it, or render without --resume)") from None

    def begin(self, plan: _PartsPlan) -> None:
        """Write the plan of a new render.

        Raises
        ------
        StateError
            The folder cannot be written.
        """
        make_folder(self.path)
        with replacing(resolve_links(self.path / _PLAN)) as temporary:
            temporary.write_text(json.dumps(plan, indent=1), "utf-8")

    def file(self, number: int) -> Path:
        """Return where a part is kept."""
        return self.path / f"{number}{SUFFIX}"

    def keep(self, number: int, content: bytes) -> None:
        """Write a part, whole or not at all."""
        with replacing(resolve_links(self.file(number))) as temporary:
            temporary.write_bytes(content)

    def missing(self, plan: _PartsPlan) -> list[int]:
        """Return the numbers of the parts that are not there; damaged ones are removed first."""
        lacking = []
        for number in range(1, plan["count"] + 1):
            try:
                read_part(self.file(number))
            except StateError:
                self.file(number).unlink(missing_ok=True)
                lacking.append(number)
        return lacking


# A render on a cluster: parts go out, files come back, and their whole is the picture.

_PART_S = 0.03  # that a part costs beside its rendering [s]
LONGEST_S = 10.0  # of a part, where the client keeps up: so much is lost with a worker [s]
_CLIENT_S = 0.04  # that a part costs the client at most, so that it keeps up with many workers [s]
PARTS_A_WORKER = 4  # at least, so that all end at about the same time


@with_keywords(RenderOptions, *OF_A_CLUSTER)
def render_on_cluster(
    scene: SceneSource,
    cluster: str | None = None,
    *,
    workers: int | None = None,
    tls: Credentials = None,
    device: str | None = None,
    folder: str | Path | None = None,
    resume: bool = False,
    allow_mixed: bool = False,
    on_progress: Callable[[Progress], Any] | None = None,
    should_stop: Callable[[], bool] | None = None,
    **options: Any,
) -> Image:
    """Return the picture that the camera of a scene takes, rendered by the workers of a cluster.

    On equal devices it has the bits of `rptcam_cl.render`. Otherwise the metadata list each device with its parts.

    Parameters
    ----------
    scene
        A scene, or anything that `load_scene` takes; it goes to each worker once, with its files.
    cluster
        Address of a scheduler of dask.distributed: ``tls://host:8786``, or ``tcp://127.0.0.1:8786``.
    workers
        In place of an address: processes of this machine, which end with the render.
    tls
        Certificates, for an address that begins with ``tls://``; False for ``tcp://`` on a machine where all users
        are trusted, since any of them can run programs by it.
    folder
        Where parts are kept until the picture is whole; by default one that goes with the call.
    resume
        Whether to go on from the parts in the folder.
    allow_mixed
        Whether workers and parts of other code, another numpy or another driver are taken too; the metadata name all
        under ``mixed``.
    on_progress, should_stop
        Called with a `Progress` after each part; asked several times a second, where True ends the render.
    spp, seed, size, crop, layers, device
        As for `rptcam_cl.render`; the device is that of each worker.

    Raises
    ------
    InputError
        Something in the scene or the arguments is wrong, or dask.distributed is missing.
    DeviceError
        There is no scheduler or worker, or a worker cannot render.
    StateError
        Workers have another version or other code, the parts are of another render, the scheduler was lost, or a file
        cannot be written.
    InterruptedError
        ``should_stop`` ended it; the parts are kept in the folder.
    """
    check_cluster(cluster, workers, tls)
    given = read_scene(scene)
    applied, spp = _divisible(given, options)
    parcel, job = pack_scene(given), Job(options, device, allow_mixed=allow_mixed)
    to_cluster = partial(connect, cluster, workers, tls, device, allow_mixed=allow_mixed)
    with _parts_folder(folder, resume=resume) as (parts, kept_text):
        return _Run(parts, parcel, job, applied, spp, on_progress, should_stop, kept_text).image(to_cluster)


@contextlib.contextmanager
def _parts_folder(folder: str | Path | None, *, resume: bool) -> Iterator[tuple[PartsFolder, str]]:
    """The folder of parts, emptied unless a render goes on, and what errors say of it; by default it goes at last."""
    with scratch_folder() as scratch:
        parts = PartsFolder(Path(scratch) / "parts" if folder is None else Path(folder))
        if not resume:
            parts.clear()
        yield parts, "" if folder is None else f"; {parts.path} holds the parts that came back (--resume goes on)"


def _divisible(scene: Scene, options: Mapping[str, Any]) -> tuple[Scene, int]:
    """The scene with options that it has to take in parts, and the samples of each pixel."""
    settings = RenderOptions(**options)
    applied = settings.apply_to(scene)
    check_divisible(applied)
    spp = settings.most_spp(applied)
    assert spp is not None, "without a time it ends by samples"
    return applied, spp


def parts_of(seconds: float, workers: int) -> int:
    """Return how many parts a render of so many seconds of one worker has: as many for each, for equal ones.

    At the end workers wait half a part on average, and each part costs `_PART_S`: both together are least for parts of
    the square root of twice that times what each worker renders.
    """
    best = min(math.sqrt(2 * _PART_S * seconds / workers), LONGEST_S)
    least = max(int(seconds / max(best, _CLIENT_S * workers)) + 1, PARTS_A_WORKER * workers)
    return -(-least // workers) * workers


@dataclass
class _Run:
    """One render on a cluster."""

    folder: PartsFolder
    parcel: Parcel
    job: Job
    scene: Scene
    spp: int
    on_progress: Callable[[Progress], Any] | None
    should_stop: Callable[[], bool] | None
    kept_text: str
    account: dict[str, dict[str, Any]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.same = OneMaker(self.job.allow_mixed)

    def image(self, connect: Callable[[], AbstractContextManager[Any]]) -> Image:
        """Render the parts that the folder lacks, by a client if there are any; return the whole of all."""
        plan = self.earlier_plan()
        if plan is None or self.folder.missing(plan):
            begun = time.perf_counter()
            with connect() as (client, workers):
                self.note_time("connect", begun)
                plan = self.complete(client, workers, plan)
        begun = time.perf_counter()
        files = [self.folder.file(number) for number in range(1, plan["count"] + 1)]
        image = merge(files, allow_mixed=self.job.allow_mixed)
        self.note_time("merge", begun)
        image.stats["cluster"] = {"parts": plan["count"], "workers": self.account, "seconds": self.seconds}
        return image

    def note_time(self, what: str, begun: float) -> None:
        """Note how long something took that began at a time of `time.perf_counter`."""
        self.seconds[what] = round(time.perf_counter() - begun, 3)

    def earlier_plan(self) -> _PartsPlan | None:
        """Return the plan that the folder holds, if it is of this render."""
        plan = self.folder.plan()
        if plan is None:
            return None
        for name, value in self.facts().items():
            if plan[name] != value:
                raise StateError(
                    f"{self.folder.path}: holds parts of another render: its {name} is {plan[name]}, not {value}"
                    " (remove it, or render without --resume)"
                )
        self.same.add(str(self.folder.path), plan["made_by"])
        self.same.add("this program", made_by([str(plan["made_by"].get("driver"))]))  # the devices are the workers'
        return plan

    def facts(self) -> dict[str, Any]:
        """The facts by which a plan is known to be of this render."""
        layers = [*self.scene.render.layers, self.scene.render.layers_spp] if self.scene.render.layers else []
        return {"version": __version__, "scene": self.scene.picture_hash(), "spp": self.spp, "layers": layers}

    def complete(self, client: Any, workers: Sequence[str], plan: _PartsPlan | None) -> _PartsPlan:
        """Render all parts that are missing, and return the plan."""
        stopped, begun = f"the parts that are done are in {self.folder.path}", time.perf_counter()
        sent = TasksOut(client, self.parcel, workers, self.kept_text, self.should_stop, stopped)
        if plan is None:
            findings, seconds, maker = sent.first(open_render, (self.job,))
            count = min(parts_of(seconds, len(workers)), FilmLayout.of(self.scene.film).tiles)
            plan = self.facts() | {"count": count, "found": findings, "made_by": maker}
            self.folder.begin(plan)
        self.job = replace(self.job, findings=plan["found"], count=plan["count"])
        self.note_time("open", begun)
        todo, begun = self.folder.missing(plan), time.perf_counter()
        parts = sent.results(render_part, ((self.job, number) for number in todo))
        for left, (worker, part) in zip(reversed(range(len(todo))), parts, strict=True):
            self._keep_part(worker, part)
            self._report_progress(1 - left / plan["count"], time.perf_counter() - begun)
        self.note_time("render", begun)
        return plan

    def _keep_part(self, worker: str, part: RenderedPart) -> None:
        self.same.add(f"cluster: the worker {worker}", part.made_by)
        self.folder.keep(part.number, part.content)
        row = self.account.setdefault(worker, {"device": part.device, "parts": 0, "seconds": 0.0})
        row["parts"] += 1
        row["seconds"] = round(row["seconds"] + part.seconds, 3)

    def _report_progress(self, share: float, seconds: float) -> None:
        if self.on_progress is not None:
            rate = share * math.prod(self.scene.film.resolution) * self.spp / max(seconds, 1e-9) / 1e6
            done = round(share * self.spp)
            self.on_progress(Progress("render", done, self.spp, seconds, rate, None, tiles_done=share))


# Many pictures on a cluster, each a task of its own: the frames of a sequence.


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
        _divisible(scene, words)
    if not scenes:
        return
    parcel = pack_scene(*scenes.values())
    todo = (
        (Job(words, device, allow_mixed=allow_mixed), number, plain_data(scene), scene.content_hash())
        for number, scene in scenes.items()
    )
    to_cluster = connect(cluster, workers, tls, device, allow_mixed=allow_mixed)
    with scratch_folder() as scratch, to_cluster as (client, there):
        done = "the pictures that are done are written"
        sent = TasksOut(client, parcel, there, f"; {done} (--resume goes on)", should_stop, done)
        sent.first(hold_scene)
        for worker, part in sent.results(render_scene, todo):
            yield part.number, _image(part, worker, Path(scratch))


def _image(part: RenderedPart, worker: str, scratch: Path) -> Image:
    path = scratch / f"{part.number}{SUFFIX}"
    path.write_bytes(part.content)
    image = merge([path])
    path.unlink()
    row = {"device": part.device, "parts": 1, "seconds": round(part.seconds, 3)}
    image.stats["cluster"] = {"parts": 1, "workers": {worker: row}}
    return image
