"""One render shared by several devices: each has tiles of the picture, and a failed one's are rendered by the others.

Random numbers are keyed by pixel and sample, and every pixel belongs to one device: devices that compute alike give the
bits that each of them gives alone, however the tiles are dealt out. Where they do not, the bits follow from the shares.
"""

from __future__ import annotations

import functools
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import DeviceError, RptcamError
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.film import PLANES, TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.film_buffers import outcomes_of, share_removed
from rptcam_cl.rendering.shares import Part, begun, ended, measured_speed, owners, shares_of, split_text
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.rendering.worker import Job, Worker, by_tile
from rptcam_cl.scene import RenderSettings

ROUND_SECONDS = 0.5  # of work between two times that the devices wait for each other
MOST_OF_A_ROUND = 4096  # samples per pixel


class SharedWavefront:
    """What `Wavefront` is for one device, for several at once.

    Parameters
    ----------
    sessions
        The devices, at least one.
    shares
        Of the picture by device; by default they are measured.
    lenient
        Whether a device that cannot begin is left out with a warning. One that fails later always is.
    plan, layout, settings, wave_size
        Of every device's `Wavefront`.

    Raises
    ------
    DeviceError
        When a device cannot begin, or no device is left.
    """

    def __init__(
        self,
        sessions: Sequence[Session],
        plan: Plan,
        layout: FilmLayout,
        settings: RenderSettings,
        wave_size: int | None = None,
        *,
        shares: Sequence[float] | None = None,
        lenient: bool = False,
    ) -> None:
        self.layout, self.settings = layout, settings
        self._halt = threading.Event()
        self._workers: list[Worker] = []
        given = [0.0] * len(sessions) if shares is None else shares
        for session, share in zip(sessions, given, strict=True):
            try:
                self._workers.append(Worker(Wavefront(session, plan, layout, settings, wave_size), share))
            except RptcamError as error:
                self._left_out(session, error, lenient)
        for worker, failure in self._in_parallel(self._workers, lambda worker: worker.wavefront.warm_up()):
            self._left_out(worker.wavefront.session, failure, lenient)
            worker.dropped = str(failure)
        self._workers = self._live()
        self._need_one("")
        if shares is None:
            self._measure()
            self._need_one("")
        elif len(self._workers) < len(sessions):
            self._share_out([worker.share for worker in self._workers])
        self._deal()
        self.tiles = np.arange(layout.tiles, dtype=np.uint32)
        self._shortest = max(worker.wavefront.samples_per_wave for worker in self._workers)
        self._round = self._shortest
        self._ends = np.zeros(layout.tiles, np.int64)  # samples per pixel of each tile
        self._base: dict[str, NDArray[Any]] = {}  # what is safe on the host; empty: an empty film
        self._base_counts = np.zeros_like(self._workers[0].wavefront.counts())
        self._base_done: int | None = None  # samples per pixel of it; None: those that the next enqueued follow
        self._parts: list[dict[str, Any]] = []

    def _left_out(self, session: Session, error: RptcamError, lenient: bool) -> None:
        device = f"device {session.info.id} {session.info.name}"
        why = str(error) if device in str(error) else f"{device}: {error}"
        if not lenient:
            raise type(error)(f"{why} (leave {session.info.id} out of --device, or update its driver)") from error
        _tell(f"{why}; it is left out")

    def _measure(self) -> None:
        speeds: dict[str, float] = {}

        def measure(worker: Worker) -> None:
            speeds[worker.id] = measured_speed(worker.wavefront)

        for worker, error in self._in_parallel(self._workers, measure):
            _tell(f"{error}; it is dropped, and the other devices render without it")
            worker.dropped = str(error)
        self._share_out([speeds[worker.id] for worker in self._live()])

    def _share_out(self, speeds: Sequence[float]) -> None:
        """Give the devices that work shares in proportion to ``speeds``."""
        for worker, share in zip(self._live(), shares_of(speeds) if speeds else [], strict=True):
            worker.share = share

    def _deal(self) -> None:
        live = self._live()
        dealt = owners(self.layout.tiles, [worker.share for worker in live])
        for place, worker in enumerate(live):
            worker.owned = dealt == place

    def _live(self) -> list[Worker]:
        return [worker for worker in self._workers if worker.dropped is None]

    def _need_one(self, why: str) -> None:
        if not self._live():
            raise DeviceError(f"no device is left to render on{why}")

    @property
    def session(self) -> Session:
        """Of the first device that works."""
        return self._live()[0].wavefront.session

    @property
    def sessions(self) -> list[Session]:
        """Of all devices that have worked."""
        return [worker.wavefront.session for worker in self._workers]

    @property
    def capacity(self) -> int:
        """Slots of the path state, of all devices."""
        return sum(worker.wavefront.capacity for worker in self._workers)

    @property
    def wavefronts(self) -> list[Wavefront]:
        """Those of the devices that work."""
        return [worker.wavefront for worker in self._live()]

    @property
    def samples_per_wave(self) -> int:
        """Samples per pixel between two times that the devices wait for each other."""
        return self._round

    def choose_tiles(self, tiles: NDArray[np.uint32]) -> None:
        """Render these tiles of the film from now on."""
        self.tiles = tiles

    def waves(self, first_sample: int, samples: int) -> list[tuple[int, int, int, int]]:
        """Return ``(first pixel, pixels, first sample, samples)`` for `enqueue`: everything at once."""
        return [(0, len(self.tiles) * TILE_PIXELS, first_sample, samples)]

    def enqueue(self, first_pixel: int, pixels: int, first_sample: int, samples: int) -> None:
        """Render what `waves` returned, each device its tiles, and wait for it."""
        begun = time.perf_counter()
        if self._base_done is None:
            self._base_done = first_sample
        if not self._parts:
            self._begin_part(first_sample)
        self._ends[self.tiles] = first_sample + samples
        self._run({worker.id: Job([(self._own(worker), first_sample, samples)]) for worker in self._live()})
        seconds = time.perf_counter() - begun
        if seconds < 0.5 * ROUND_SECONDS and samples >= self._round:
            self._round = min(2 * self._round, MOST_OF_A_ROUND)
        elif seconds > 2 * ROUND_SECONDS:
            self._round = max(self._round // 2, self._shortest)

    def _own(self, worker: Worker) -> NDArray[np.uint32]:
        return self.tiles[worker.owned[self.tiles]]

    def _run(self, jobs: dict[str, Job]) -> None:
        """Let every device do its job; what is lost with a device is rendered again."""
        while True:
            work = functools.partial(_do, jobs=jobs, halt=self._halt)
            failed = self._in_parallel([worker for worker in self._live() if worker.id in jobs], work)
            if not failed:
                return
            jobs = self._without(failed)

    def _in_parallel(
        self, workers: Sequence[Worker], work: Callable[[Worker], None]
    ) -> list[tuple[Worker, DeviceError]]:
        """Run ``work`` for each device in a thread of its own; return those that failed and why."""
        failed = []
        with ThreadPoolExecutor(max(len(workers), 1)) as pool:
            tasks = [(worker, pool.submit(work, worker)) for worker in workers]
            for worker, task in tasks:
                try:
                    task.result()
                except DeviceError as error:
                    failed.append((worker, error))
                except BaseException:
                    self._halt.set()
                    raise
        return failed

    def _without(self, failed: Sequence[tuple[Worker, DeviceError]]) -> dict[str, Job]:
        """Drop devices, and return what the others have to do, so that nothing of theirs is missing."""
        lost = np.zeros(self.layout.tiles, np.bool_)
        for worker, error in failed:
            worker.dropped = str(error)
            lost |= worker.owned
        self._need_one(f": {failed[-1][1]}")
        live = self._live()
        self._share_out([worker.share for worker in live])
        for _, error in failed:
            _tell(f"{error}; it is dropped, and what it has made is made again by the other devices")
        self._begin_part(self._base_done or 0, {worker.id: str(error) for worker, error in failed})
        tiles = np.flatnonzero(lost)
        dealt = owners(len(tiles), [worker.share for worker in live])
        return {worker.id: self._taken_over(worker, tiles[dealt == place]) for place, worker in enumerate(live)}

    def _taken_over(self, worker: Worker, tiles: NDArray[np.intp]) -> Job:
        """Give a device the tiles of another; return the job that brings them to where they were."""
        worker.owned[tiles] = True
        first, ends = self._base_done or 0, self._ends[tiles]
        ranges = [
            (tiles[ends == end].astype(np.uint32), first, int(end - first)) for end in np.unique(ends) if end > first
        ]
        return Job(ranges, tiles, self._base)

    def finish(self) -> None:
        """Nothing to wait for: `enqueue` has waited."""

    def _gathered(self, read: Callable[[Wavefront], NDArray[np.float32]]) -> NDArray[np.float32]:
        """Return planes with the tiles of each device."""
        while True:
            failed, whole = [], None
            for worker in self._live():
                try:
                    planes = read(worker.wavefront)
                except DeviceError as error:
                    failed.append((worker, error))
                    continue
                if whole is None:
                    whole = np.zeros_like(planes)
                tiles = np.flatnonzero(worker.owned)
                by_tile(whole)[:, tiles] = by_tile(planes)[:, tiles]
            if not failed and whole is not None:
                return whole
            self._run(self._without(failed))

    def sums(self) -> NDArray[np.float32]:
        """Return the film's sums and their compensations, shape (6, pixels of the buffer)."""
        return self._gathered(Wavefront.planes)[:PLANES]

    def removed_share(self) -> float:
        """Return the share of the light that the limit of the samples has removed."""
        return share_removed(self._gathered(Wavefront.planes))

    def layers(self) -> dict[str, NDArray[Any]]:
        """Return the auxiliary layers by name, (height, width) or (height, width, channels)."""
        layers = self._live()[0].wavefront.layer_pass
        return {} if layers is None else layers.arrays(self._gathered(_layer_planes))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return what `restore` needs to go on; from here on, no more than what follows can be lost with a device."""
        arrays = {"film": self._gathered(Wavefront.planes)}
        if self._live()[0].wavefront.layer_pass is not None:
            arrays["layers"] = self._gathered(_layer_planes)
        self._base, self._base_counts, self._base_done = arrays, self.counts(), None
        for worker in self._live():
            worker.keep()
        return arrays | {"counts": self._base_counts}

    def restore(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from what `state` returned, of these devices or of others."""
        self._base = {name: arrays[name] for name in ("film", "layers") if name in arrays}
        self._base_counts, self._base_done = arrays["counts"].astype(np.uint64), None
        self._ends[:] = 0
        empty = self._base | {"counts": np.zeros_like(self._base_counts)}
        if failed := self._in_parallel(self._live(), lambda worker: worker.wavefront.restore(empty)):
            self._run(self._without(failed))

    def counts(self) -> NDArray[np.uint64]:
        """Return rays by status, samples that were not finite, and camera rays."""
        counts = [self._base_counts, *(worker.wavefront.counts() for worker in self._live())]
        return np.asarray(np.sum(counts, axis=0, dtype=np.uint64))

    @property
    def camera_rays(self) -> int:
        """Samples of the picture's pixels."""
        return int(self.counts()[-1])

    def outcomes(self) -> dict[str, int]:
        """Return how many camera rays passed the lens, and how many failed and why."""
        return outcomes_of(self.counts())

    def not_finite(self) -> int:
        """Return how many samples were dropped because they were not finite."""
        return int(self.counts()[-2])

    def _begin_part(self, first: int, dropped: dict[str, str] | None = None) -> None:
        split = split_text({worker.id: worker.share for worker in self._live()})
        self._parts = begun(self._parts, first, split, dropped)

    def parts(self, done: int) -> list[Part]:
        """Return which device took which samples, of ``done`` per pixel."""
        return ended(self._parts, done)

    def devices(self) -> list[dict[str, Any]]:
        """Return what each device has done."""
        return [worker.described() for worker in self._workers]


AnyWavefront = Wavefront | SharedWavefront


def _do(worker: Worker, jobs: dict[str, Job], halt: threading.Event) -> None:
    worker.run(jobs[worker.id], halt)


def _layer_planes(wavefront: Wavefront) -> NDArray[np.float32]:
    assert wavefront.layer_pass is not None
    return wavefront.layer_pass.planes()


def _tell(message: str) -> None:
    warnings.warn(message, UserWarning, stacklevel=2)
