"""One render shared: parts of a film, and devices with tiles each; a failed one's go to the others."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import GOLDEN
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError, InputError, RptcamError
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.film import BLOCK, TILE_PIXELS, FilmLayout, RenderedFilm
from rptcam_cl.rendering.layers import SHARP
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.film import RenderSettings

# How devices share a picture: how large a share each is worth, its tiles, and the record of who took which samples.

MEASURED_SECONDS = 0.3  # that each device renders before its share is known
STEPS = 1000  # shares are whole numbers of these parts, so that their text repeats them exactly

Part = dict[str, Any]
"""``samples``: first and end; ``split``: shares by device, as ``--split`` takes them; ``dropped``: devices and why."""


def owners(tiles: int, shares: Sequence[float]) -> NDArray[np.intp]:
    """Deal out tiles: the place of the share among ``shares`` of the device that renders each.

    Tiles of one device are spread over the picture, so that each has its part of the costly ones. The choice follows
    from the number of a tile and the shares alone.
    """
    places = np.modf((np.arange(tiles) + 0.5) * GOLDEN)[0]
    ends = np.cumsum(np.asarray(shares, np.float64) / np.sum(shares))[:-1]
    return np.asarray(np.searchsorted(ends, places, side="right"), np.intp)


def measure_speed(wavefront: Wavefront) -> float:
    """How many samples per second a device renders of tiles all over the picture; its film is empty after."""
    layout = wavefront.layout
    at_once = max(wavefront.capacity // wavefront.samples_per_wave, BLOCK) // TILE_PIXELS
    step = -(-layout.tiles // at_once)
    wavefront.choose_tiles(np.arange(0, layout.tiles, step, dtype=np.uint32))
    samples, first, start = 0, 0, time.perf_counter()
    while time.perf_counter() - start < MEASURED_SECONDS or not samples:
        for wave in wavefront.waves(first, wavefront.samples_per_wave):
            wavefront.enqueue(*wave)
            samples += wave[1] * wave[3]
        first += wavefront.samples_per_wave
        wavefront.finish()
    seconds = time.perf_counter() - start
    wavefront.clear()
    return samples / seconds


def shares_of(speeds: Sequence[float]) -> list[float]:
    """Return shares in proportion to speeds, in thousandths that add up to 1, each at least one."""
    parts = [max(round(STEPS * speed / sum(speeds)), 1) for speed in speeds]
    parts[int(np.argmax(parts))] += STEPS - sum(parts)
    return [part / STEPS for part in parts]


def split_text(shares: Mapping[str, float]) -> str:
    """Return shares by device as ``--split`` takes them."""
    return ",".join(f"{identity}={share:.15g}" for identity, share in shares.items())


def split_of(text: str) -> dict[str, float]:
    """Return shares by device of what `split_text` returned."""
    return {identity: float(share) for identity, _, share in (part.rpartition("=") for part in text.split(","))}


def begin_part(parts: Sequence[Part], first: int, split: str, dropped: Mapping[str, str] | None = None) -> list[Part]:
    """Return the parts with one more, from sample ``first`` on; what was recorded of later samples gives way."""
    gone: dict[str, str] = {}
    for part in parts:
        if part["samples"][0] >= first:
            gone |= part.get("dropped", {})
    gone |= dropped or {}
    kept = [part for part in parts if part["samples"][0] < first]
    return [*kept, {"samples": [first, first], "split": split} | ({"dropped": gone} if gone else {})]


def end_parts(parts: Sequence[Part], done: int) -> list[Part]:
    """Return the parts, each ending where the next begins, the last after ``done`` samples."""
    ends = [*(part["samples"][0] for part in parts[1:]), done][: len(parts)]
    whole = [part | {"samples": [part["samples"][0], end]} for part, end in zip(parts, ends, strict=True)]
    return [part for part in whole if part["samples"][1] > part["samples"][0]]


def join_parts(earlier: Sequence[Part], later: Sequence[Part]) -> list[Part]:
    """Return the parts of a render before and after it was interrupted; those with the same shares as one."""
    if not earlier or not later or {"dropped"} & (earlier[-1].keys() | later[0].keys()):
        return [*earlier, *later]
    if earlier[-1]["split"] != later[0]["split"]:
        return [*earlier, *later]
    both = later[0] | {"samples": [earlier[-1]["samples"][0], later[0]["samples"][1]]}
    return [*earlier[:-1], both, *later[1:]]


def is_shared(parts: Sequence[Part]) -> bool:
    """Return whether more than one device took part."""
    return (
        any("dropped" in part for part in parts)
        or len({device for part in parts for device in split_of(part["split"])}) > 1
    )


# Which part of a film one of several runs renders, each anywhere: tiles of the picture, and samples of its pixels.

Arrays = dict[str, NDArray[Any]]
_IN_PIXELS = ("film", "layers", SHARP)  # begin the names of those whose last axis is the pixels of the film's buffer


@dataclass(frozen=True)
class FilmPart:
    """Tiles and samples of a film.

    Attributes
    ----------
    number, count : int
        Part ``number`` of ``count`` parts with as many tiles each, give or take one, from 1 on.
    first : int
        The first sample of its pixels.
    end : int or None
        The sample that it ends before; None: as the render says.
    """

    number: int = 1
    count: int = 1
    first: int = 0
    end: int | None = None

    def check(self, tiles: int) -> None:
        """Raise if there are more parts than tiles.

        Raises
        ------
        InputError
        """
        if self.count > tiles:
            raise InputError(
                f"part: the film has fewer tiles of 8 x 8 pixels than parts (got {self.number}/{self.count}; allowed:"
                f" at most {tiles} parts, or parts by samples)"
            )

    def tiles(self, tiles: int) -> NDArray[np.uint32]:
        """Its own of so many tiles; those of one part are spread over the picture."""
        places = np.argsort(np.modf((np.arange(tiles) + 0.5) * GOLDEN)[0], kind="stable")
        bounds = [tiles * each // self.count for each in (self.number - 1, self.number)]
        return np.sort(places[slice(*bounds)]).astype(np.uint32)

    def samples_of_tiles(self, ends: NDArray[np.uint32], tiles: int) -> NDArray[np.uint32]:
        """How many samples per pixel each tile of the buffer has, from the sample that it is rendered up to."""
        if self == WHOLE:
            return ends
        own, samples = self.tiles(tiles), np.zeros_like(ends)
        samples[own] = ends[own] - self.first
        return samples

    def pack(self, arrays: Arrays, tiles: int) -> Arrays:
        """Return the arrays of a saved render with its own tiles alone."""
        if self.count == 1:
            return arrays
        pixels = pixels_of(self.tiles(tiles))
        return arrays | {name: array[:, pixels] for name, array in arrays.items() if name.startswith(_IN_PIXELS)}

    def unpack(self, arrays: Arrays, tiles: int, pixels: int) -> Arrays:
        """Return the arrays that `pack` was given, of a buffer of so many pixels, other tiles empty.

        Arrays that do not fit are left as they are.
        """
        own = pixels_of(self.tiles(tiles))
        whole = dict(arrays)
        for name, packed in arrays.items():
            if self.count > 1 and name.startswith(_IN_PIXELS) and packed.ndim == 2 and packed.shape[1] == len(own):
                whole[name] = np.zeros((len(packed), pixels), packed.dtype)
                whole[name][:, own] = packed
        return whole

    def facts(self) -> list[int | None] | None:
        """Its description in a saved render: number, count, first sample and end; None for the whole."""
        return None if self == WHOLE else [self.number, self.count, self.first, self.end]

    @property
    def title(self) -> str:
        """Its name as people read it."""
        names = [f"part {self.number}/{self.count}"] if self.count > 1 else []
        if self.end is not None:
            names.append(f"samples {self.first}:{self.end}")
        return ", ".join(names) or "the whole film"


WHOLE = FilmPart()


def part_of_facts(facts: Any) -> FilmPart:
    """The part that `FilmPart.facts` describes.

    Raises
    ------
    ValueError
        They describe none.
    """
    if facts is None:
        return WHOLE
    number, count, first, end = facts
    if not all(type(value) is int and 0 <= value < 2**32 for value in (number, count, first)):
        raise ValueError("part")
    if not 1 <= number <= count or not (end is None or (type(end) is int and first < end < 2**32)):
        raise ValueError("part")
    return FilmPart(number, count, first, end)


def pixels_of(tiles: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Return the pixels of some tiles in the film's buffer."""
    return (tiles.astype(np.int64)[:, None] * TILE_PIXELS + np.arange(TILE_PIXELS)).ravel()


# One of several devices that share a render: the tiles that are its own, and what it has done.

QUEUE_SECONDS = 0.2  # of work that a device is given before it is waited for


Ranges = list[tuple[NDArray[np.uint32], int, int]]
"""Tiles, their first sample and how many, one after the other."""


@dataclass
class Worker:
    """A device at work.

    Attributes
    ----------
    share : float
        Of the picture.
    owned : (tiles,) array of bool
        The tiles that are its own.
    kept : int
        Camera rays that are safe on the host.
    made, seconds : int, float
        Camera rays made in all, and the time that took.
    dropped : str or None
        Why it no longer works.
    """

    wavefront: Wavefront
    share: float = 0.0
    owned: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    kept: int = 0
    made: int = 0
    seconds: float = 0.0
    dropped: str | None = None

    @property
    def id(self) -> str:
        """Of the device."""
        return self.wavefront.session.info.id

    def run(self, ranges: Ranges, halt: threading.Event) -> None:
        """Render ranges of samples and wait for them; leave early once ``halt`` is set."""
        start, before = time.perf_counter(), self.wavefront.camera_rays
        for tiles, first, samples in ranges:
            self._render(tiles, first, samples, halt)
        self.made += self.wavefront.camera_rays - before
        self.seconds += time.perf_counter() - start

    def _render(self, tiles: NDArray[np.uint32], first: int, samples: int, halt: threading.Event) -> None:
        wavefront, pending = self.wavefront, 0
        wavefront.choose_tiles(tiles)
        for wave in wavefront.waves(first, samples):
            wavefront.enqueue(*wave)
            pending += wave[1] * wave[3]
            if pending > self.made / max(self.seconds, 1e-9) * QUEUE_SECONDS:
                wavefront.finish()
                pending = 0
                if halt.is_set():
                    return
        wavefront.finish()

    def take_over(self, tiles: NDArray[np.intp], base: Mapping[str, NDArray[Any]]) -> None:
        """Put what the tiles of another device held in place, which was nothing where ``base`` has none."""
        arrays = self.wavefront.state()
        for name in arrays.keys() & {"film", "layers"}:
            by_tile(arrays[name])[:, tiles] = by_tile(base[name])[:, tiles] if base else 0.0
        self.wavefront.restore(arrays)

    def keep(self) -> None:
        """Take all that the device has made for safe."""
        self.kept += self.wavefront.camera_rays
        self.wavefront.clear_counts()

    def describe(self) -> dict[str, Any]:
        """Describe what it has done."""
        working = self.dropped is None
        return {
            "id": self.id,
            "name": self.wavefront.session.info.name,
            "share": self.share if working else 0.0,
            "samples": self.kept + (self.wavefront.camera_rays if working else 0),
            "seconds": self.seconds,
            "msamples_per_second": self.made / max(self.seconds, 1e-9) / 1e6,
            **({} if working else {"dropped": self.dropped}),
        }


def by_tile(planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a view of planes (planes, tiles, pixels of a tile)."""
    return planes.reshape(len(planes), -1, TILE_PIXELS)


#
# One render shared by several devices: each has tiles of the picture, and a failed one's are rendered by the others.
#
# Random numbers are keyed by pixel and sample, and every pixel belongs to one device: devices that compute alike give
# the bits that each of them gives alone, however the tiles are dealt out. Where they do not, the bits follow from the
# shares.

_ROUND_SECONDS = 0.5  # of work between two times that the devices wait for each other
_MOST_OF_A_ROUND = 4096  # samples per pixel


class SharedWavefront(RenderedFilm):
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
        self.layout, self.settings, self.light_groups = layout, settings, plan.light_groups.names
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
            speeds[worker.id] = measure_speed(worker.wavefront)

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
        start = time.perf_counter()
        if self._base_done is None:
            self._base_done = first_sample
        if not self._parts:
            self._begin_part(first_sample)
        self._ends[self.tiles] = first_sample + samples
        own = {worker.id: self.tiles[worker.owned[self.tiles]] for worker in self._live()}
        self._run({name: [(tiles, first_sample, samples)] for name, tiles in own.items()}, {})
        seconds = time.perf_counter() - start
        if seconds < 0.5 * _ROUND_SECONDS and samples >= self._round:
            self._round = min(2 * self._round, _MOST_OF_A_ROUND)
        elif seconds > 2 * _ROUND_SECONDS:
            self._round = max(self._round // 2, self._shortest)

    def _run(self, jobs: dict[str, Ranges], taken_over: Mapping[str, NDArray[np.intp]]) -> None:
        """Let every device do its job, after it has taken over tiles; what is lost with a device is rendered again."""
        while True:
            failed = self._in_parallel(
                [worker for worker in self._live() if worker.id in jobs],
                partial(_do, jobs=jobs, taken_over=taken_over, base=self._base, halt=self._halt),
            )
            if not failed:
                return
            jobs, taken_over = self._without(failed)

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

    def _without(
        self, failed: Sequence[tuple[Worker, DeviceError]]
    ) -> tuple[dict[str, Ranges], dict[str, NDArray[np.intp]]]:
        """Drop devices, and return what the others render so that nothing is missing, and the tiles they take over."""
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
        taken_over = {worker.id: tiles[dealt == place] for place, worker in enumerate(live)}
        for worker in live:
            worker.owned[taken_over[worker.id]] = True
        return {name: self._ranges_lost(own) for name, own in taken_over.items()}, taken_over

    def _ranges_lost(self, tiles: NDArray[np.intp]) -> Ranges:
        """The samples that bring tiles from what is safe to where they were."""
        first, ends = self._base_done or 0, self._ends[tiles]
        return [
            (tiles[ends == end].astype(np.uint32), first, int(end - first)) for end in np.unique(ends) if end > first
        ]

    def finish(self) -> None:
        """Nothing to wait for: `enqueue` has waited."""

    def _gather(self, read: Callable[[Wavefront], NDArray[np.float32]]) -> NDArray[np.float32]:
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
            self._run(*self._without(failed))

    def planes(self) -> NDArray[np.float32]:
        """All of the film, (planes, pixels of the buffer)."""
        return self._gather(Wavefront.planes)

    def layers(self) -> dict[str, NDArray[Any]]:
        """Return the auxiliary layers by name, (height, width) or (height, width, channels)."""
        layers = self._live()[0].wavefront.layer_pass
        return {} if layers is None else layers.arrays(self._gather(_layer_planes))

    def state(self) -> dict[str, NDArray[Any]]:
        """Read the arrays that `restore` takes; from here on, no more than what follows can be lost with a device."""
        arrays = {"film": self.planes()}
        if self._live()[0].wavefront.layer_pass is not None:
            arrays["layers"] = self._gather(_layer_planes)
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
            self._run(*self._without(failed))

    def counts(self) -> NDArray[np.uint64]:
        """Return rays by status, samples that were not finite, and camera rays."""
        counts = [self._base_counts, *(worker.wavefront.counts() for worker in self._live())]
        return np.asarray(np.sum(counts, axis=0, dtype=np.uint64))

    def _begin_part(self, first: int, dropped: dict[str, str] | None = None) -> None:
        split = split_text({worker.id: worker.share for worker in self._live()})
        self._parts = begin_part(self._parts, first, split, dropped)

    def parts(self, done: int) -> list[Part]:
        """Say which device took which samples, of ``done`` per pixel."""
        return end_parts(self._parts, done)

    def devices(self) -> list[dict[str, Any]]:
        """Describe what each device has done."""
        return [worker.describe() for worker in self._workers]


AnyWavefront = Wavefront | SharedWavefront


def _do(
    worker: Worker,
    jobs: Mapping[str, Ranges],
    taken_over: Mapping[str, NDArray[np.intp]],
    base: Mapping[str, NDArray[Any]],
    halt: threading.Event,
) -> None:
    tiles = taken_over.get(worker.id, ())
    if len(tiles):
        worker.take_over(np.asarray(tiles), base)
    worker.run(jobs[worker.id], halt)


def _layer_planes(wavefront: Wavefront) -> NDArray[np.float32]:
    assert wavefront.layer_pass is not None
    return wavefront.layer_pass.planes()


def _tell(message: str) -> None:
    warnings.warn(message, UserWarning, stacklevel=2)
