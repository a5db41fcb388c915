"""The film on the device, the waves of samples that fill it, and their Russian roulette."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import cached_property, lru_cache
from math import fsum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import LIMITS, WAVE, RayStatus, seed_words
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.photon_map import within_passes
from rptcam_cl.scene.film import LIGHT_LAYER, Film, RenderSettings

# The film on the device: compensated sums per pixel, in tiles of 8 x 8 pixels, each of four of 4 x 4.

Scalar = TypeVar("Scalar", bound=np.generic)

TILE = 8
QUARTER = 4  # neighbouring lanes share a square of so many pixels
TILE_PIXELS = TILE * TILE
_SPARE_TILES = 3  # behind those of the picture, so that any number of tiles can be filled up to a block
BAND = 4  # rows of tiles that are made a picture at a time: so many stay in a processor's cache
BLOCK = 256  # pixels are padded to this, so that any wave is a whole number of work groups on every device
PLANES = 6  # three sums and three compensations; a limit of the samples adds what it has removed


@dataclass(frozen=True)
class FilmLayout:
    """Which pixels are rendered and where they lie in the film's buffer.

    Attributes
    ----------
    full_width, full_height : int
        Resolution of the whole film [pixels].
    x, y, width, height : int
        The part that is rendered [pixels].
    tiles_skipped : int
        Tiles of the film that are left out behind each tile in a row, and behind each row.
    """

    full_width: int
    full_height: int
    x: int
    y: int
    width: int
    height: int
    tiles_skipped: int = 0

    @classmethod
    def of(cls, film: Film) -> FilmLayout:
        """Return the layout of a film; its crop is rounded to whole pixels, at least one."""
        width, height = film.resolution
        x0, x1, y0, y1 = film.crop or (0.0, 1.0, 0.0, 1.0)
        left, top = min(round(x0 * width), width - 1), min(round(y0 * height), height - 1)
        return cls(width, height, left, top, max(round(x1 * width) - left, 1), max(round(y1 * height) - top, 1))

    def holds(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which places (n, 2) of the film lie in the part that is rendered [pixels]."""
        own = places - (self.x, self.y)
        return np.asarray(((own >= 0) & (own < (self.width, self.height))).all(axis=1))

    @property
    def tiles_across(self) -> int:
        """Tiles per row."""
        return -(-self.width // TILE)

    @property
    def pixels(self) -> int:
        """Pixels of the buffer, with the padding of tiles and block and with the spare tiles."""
        return -(-(self.tiles + _SPARE_TILES) * TILE_PIXELS // BLOCK) * BLOCK

    @property
    def tiles(self) -> int:
        """Tiles of the picture."""
        return self.tiles_across * -(-self.height // TILE)

    @property
    def samples_per_spp(self) -> int:
        """Pixels of the picture."""
        return self.width * self.height

    @cached_property
    def pixels_of_tile(self) -> NDArray[np.int64]:
        """Pixels of the picture in each tile of the buffer."""
        across = np.clip(self.width - TILE * np.arange(self.tiles_across), 0, TILE)
        down = np.clip(self.height - TILE * np.arange(-(-self.height // TILE)), 0, TILE)
        spare = self.pixels // TILE_PIXELS - self.tiles
        return np.append(np.outer(down, across).ravel(), np.zeros(spare, np.int64))

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Whether a pixel of the buffer belongs to the picture."""
        inside = np.zeros(self.pixels, np.bool_)
        inside[self.in_rows(np.arange(self.pixels)[None]).ravel()] = True
        return inside

    def whole_list(self) -> NDArray[np.uint32]:
        """Return the list of all tiles, filled up to whole blocks."""
        return np.arange(self.pixels // TILE_PIXELS, dtype=np.uint32)

    def filled_list(self, tiles: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Return a list of tiles filled up to whole blocks with tiles that hold no pixel of the picture."""
        missing = -len(tiles) % (BLOCK // TILE_PIXELS)
        return np.append(tiles, self.tiles + np.arange(missing)).astype(np.uint32)

    def picture(self, sums: NDArray[np.float32], spp: NDArray[np.uint32]) -> NDArray[np.float32]:
        """Return the mean, shape (height, width, 3), from the buffer ``(6, pixels)`` and the samples per tile."""
        rows, across, halves = -(-self.height // TILE), self.tiles_across, TILE // QUARTER
        whole = np.empty((rows, halves, QUARTER, across, halves, QUARTER, 3), np.float32)
        for first in range(0, rows, BAND):
            tiles = slice(first * across, min(first + BAND, rows) * across)
            pixels = slice(tiles.start * TILE_PIXELS, tiles.stop * TILE_PIXELS)
            mean = np.subtract(sums[:3, pixels], sums[3:, pixels], dtype=np.float64)
            mean /= np.repeat(np.maximum(spp[tiles], 1), TILE_PIXELS)
            split = mean.reshape(3, -1, across, halves, halves, QUARTER, QUARTER)
            whole[first : first + BAND] = split.transpose(1, 3, 5, 2, 4, 6, 0)
        return np.ascontiguousarray(whole.reshape(rows * TILE, across * TILE, 3)[: self.height, : self.width])

    def in_tiles(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return planes (count, pixels) in tiles, from values (height, width) or (height, width, count) in rows."""
        planes = np.zeros((rows.shape[2] if rows.ndim > 2 else 1, self.pixels), rows.dtype)
        planes[:, self.in_rows(np.arange(self.pixels)[None]).ravel()] = rows.reshape(self.samples_per_spp, -1).T
        return planes

    def in_rows(self, planes: NDArray[Scalar]) -> NDArray[Scalar]:
        """Return planes (count, height, width) in rows of the picture, from planes (count, pixels) in tiles."""
        rows, across, halves = -(-self.height // TILE), self.tiles_across, TILE // QUARTER
        tiles = planes[:, : self.tiles * TILE_PIXELS]
        split = tiles.reshape(-1, rows, across, halves, halves, QUARTER, QUARTER).transpose(0, 1, 3, 5, 2, 4, 6)
        whole = split.reshape(-1, rows * TILE, across * TILE)
        return whole[:, : self.height, : self.width]


# How the samples of a film are cut into waves, and the record that says which samples a wave holds.

# Paths of a wave, at least. On two CPU cores 256k render meshes 1.3 times as fast as 64k, whose ends leave a core idle.
WAVE_SLOTS = {"cpu": 1 << 18, "gpu": 1 << 20}
# And of each CPU core: three spheres keep it for a millisecond, where 64 cores that share 256k paths would be done with
# them in the time that it takes to wake them.
_SLOTS_OF_CORE = 1 << 15
_STREAM_SAMPLES = 16  # samples per pixel of a wave: what a lane may run through before it idles
STEPS_OF_SAMPLE = 4096  # that all loops of a kernel take for one sample, at most: those of trees and lenses

Wave = tuple[int, int, int, int]
"""First pixel (in the list of tiles), pixels, first sample, samples per pixel."""


def wave_slots(kind: str, compute_units: int) -> int:
    """How many paths a wave of a device has, "cpu" or "gpu"; the film does not depend on it."""
    return max(WAVE_SLOTS[kind], _SLOTS_OF_CORE * compute_units if kind == "cpu" else 0)


class Waves:
    """Sizes of the waves of one film.

    Parameters
    ----------
    layout
        The film.
    slots
        Of a wave, at most; rounded to a multiple of 256.
    stream
        Whether a lane carries its pixel through all samples of the wave.
    loop_limit
        Steps that all loops of a work item may take together; None where they may take as many as they like.
    in_passes
        Whether the samples of a wave must see the same pass of photons or virtual lights.
    single
        Whether a wave has one sample of each pixel.

    Attributes
    ----------
    pixels, samples : int
        Pixels of a wave, and samples per pixel.
    """

    def __init__(
        self,
        layout: FilmLayout,
        slots: int,
        *,
        stream: bool,
        loop_limit: int | None,
        in_passes: bool = False,
        single: bool = False,
    ) -> None:
        self._layout = layout
        self._in_passes = in_passes
        at_least = _STREAM_SAMPLES if stream and not single else 1
        self.pixels = min(max(slots // at_least // BLOCK, 1) * BLOCK, layout.pixels)
        most = (loop_limit or slots * STEPS_OF_SAMPLE) // STEPS_OF_SAMPLE
        self.samples = 1 if single else min(max(slots // self.pixels, 1), most)

    @property
    def capacity(self) -> int:
        """Slots of a wave."""
        return self.pixels * self.samples

    def over(self, tiles: int, first_sample: int, samples: int) -> list[Wave]:
        """Return the waves that render a range of samples of so many tiles."""
        waves, pixels = [], tiles * TILE_PIXELS
        for start, count in self._pieces(first_sample, samples):
            for pixel in range(0, pixels, self.pixels):
                waves.append((pixel, min(self.pixels, pixels - pixel), start, count))
        return waves

    def _pieces(self, first_sample: int, samples: int) -> Iterator[tuple[int, int]]:
        """Yield first sample and number of what goes into a wave together."""
        if self._in_passes:
            yield from within_passes(first_sample, samples, self.samples)
            return
        for start in range(first_sample, first_sample + samples, self.samples):
            yield start, min(self.samples, first_sample + samples - start)

    def rays_of(self, wave: Wave, tiles: NDArray[np.uint32]) -> int:
        """How many samples of the picture's pixels a wave holds; ``tiles`` is the list that it goes through."""
        first_pixel, pixels, _, samples = wave
        taken = tiles[first_pixel // TILE_PIXELS : (first_pixel + pixels) // TILE_PIXELS]
        return samples * int(self._layout.pixels_of_tile[taken].sum())

    def record(self, wave: Wave, seed: int) -> bytes:
        """Return the record ``WAVE`` of a wave."""
        layout, (first_pixel, pixels, first_sample, samples) = self._layout, wave
        return WAVE.one(
            seed=seed_words(seed), first_pixel=first_pixel, pixels=pixels, first_sample=first_sample, samples=samples,
            tiles_across=layout.tiles_across, width=layout.width, height=layout.height, full_width=layout.full_width,
            crop_x=layout.x, crop_y=layout.y, tiles_skipped=layout.tiles_skipped,
        ).tobytes()  # fmt: skip


@lru_cache(maxsize=4)
def _shuffle(cycle: int, steps: int) -> NDArray[np.intp]:
    """Return the numbers below ``steps`` in an order that neighbouring cycles do not share."""
    return np.argsort([seed_words(cycle * steps + step)[0] for step in range(steps)], kind="stable")


def step_of(sample: int, steps: int) -> int:
    """The step of the exposure that a sample of every pixel is of: so many samples have each of them once."""
    cycle, place = divmod(sample, steps)
    return int(_shuffle(cycle, steps)[place])


# The film and the counters of its rays on the device, and their way to the host and back.


class FilmBuffers:
    """Sums per pixel and counters of rays.

    Parameters
    ----------
    session, layout
        The device, and the film.
    clamped
        Whether the samples have a limit: one plane more adds up what it removes.
    groups
        How many groups of lamps have their light kept apart, each in as many planes as the whole film.

    Attributes
    ----------
    sums, counters : buffers
        As the kernels take them.
    pixels : int
        Pixels of the buffer.
    counts : (statuses + 1,) array
        Rays by status, then samples that were not finite, up to the last `finish`.
    rays : int
        Camera rays of the picture, up to the last `finish`.
    """

    def __init__(self, session: Session, layout: FilmLayout, *, clamped: bool, groups: int = 0) -> None:
        self._session, self.pixels = session, layout.pixels
        self._planes = planes_of(clamped, groups)
        self.sums = session.allocate(self._bytes, zeroed=True)
        self.counts = np.zeros(len(RayStatus) + 1, np.uint64)
        self.counters = session.allocate(4 * len(self.counts), zeroed=True)
        self.rays, self._enqueued = 0, 0

    @property
    def _bytes(self) -> int:
        return 4 * self._planes * self.pixels

    def clear(self) -> None:
        """Empty the film and every counter."""
        self._session.fill_zero(self.sums, self._bytes)
        self._session.fill_zero(self.counters, 4 * len(self.counts))
        self.clear_counts()
        self._enqueued = 0

    def clear_counts(self) -> None:
        """Count from 0 on."""
        self.counts[:] = 0
        self.rays = 0

    def expect(self, rays: int) -> None:
        """Take note of camera rays that have been enqueued."""
        self._enqueued += rays

    def finish(self) -> None:
        """Take over the counters of everything enqueued, which has come to its end."""
        self.rays += self._enqueued
        self._enqueued = 0
        self.counts += self._session.read(self.counters, np.uint32, len(self.counts))  # 32 bits would wrap
        self._session.fill_zero(self.counters, 4 * len(self.counts))

    def planes(self) -> NDArray[np.float32]:
        """Return the sums and compensations, with a limit of the samples what it has removed, and those of groups."""
        read = self._session.read(self.sums, np.float32, self._planes * self.pixels)
        return read.reshape(self._planes, -1)

    def all_counts(self) -> NDArray[np.uint64]:
        """Return ``counts`` with the camera rays behind them."""
        return np.append(self.counts, np.uint64(self.rays))

    def restore(self, planes: NDArray[Any], counts: NDArray[Any]) -> None:
        """Put back what `planes` and `all_counts` returned."""
        self._session.write(self.sums, np.ascontiguousarray(planes, np.float32))
        self.counts[:], self.rays = counts[:-1], int(counts[-1])


class RenderedFilm:
    """A film with the counters of its rays, whatever devices hold it: what follows from both."""

    def planes(self) -> NDArray[np.float32]:
        """All of the film, (planes, pixels of the buffer)."""
        raise NotImplementedError

    def counts(self) -> NDArray[np.uint64]:
        """Rays by status, samples that were not finite, and camera rays, up to the last `finish`."""
        raise NotImplementedError

    def sums(self) -> NDArray[np.float32]:
        """The film's sums and their compensations, shape (6, pixels of the buffer)."""
        return self.planes()[:PLANES]

    def removed_share(self) -> float:
        """The share of the light that the limit of the samples has removed."""
        return removed_share_of(self.planes())

    @property
    def camera_rays(self) -> int:
        """Samples of the picture's pixels, up to the last `finish`."""
        return int(self.counts()[-1])

    def not_finite(self) -> int:
        """How many samples were dropped because they were not finite, up to the last `finish`."""
        return int(self.counts()[-2])

    def outcomes(self) -> dict[str, int]:
        """How many camera rays passed the lens, and how many failed and why, up to the last `finish`."""
        return outcomes_of(self.counts())


def planes_of(clamped: bool, groups: int = 0) -> int:
    """How many planes a film has, with a limit of the samples or without, and with light kept apart by groups."""
    return PLANES + int(clamped) + PLANES * groups


def group_pictures(
    layout: FilmLayout, planes: NDArray[np.float32], spp: NDArray[np.uint32], names: Sequence[str]
) -> dict[str, NDArray[np.float32]]:
    """Return the light of each group of lamps, (height, width, 3) by the name of its layer, from a film's planes."""
    first = len(planes) - PLANES * len(names)
    parts = (planes[first + PLANES * place : first + PLANES * (place + 1)] for place in range(len(names)))
    return {f"{LIGHT_LAYER}{name}": layout.picture(part, spp) for name, part in zip(names, parts, strict=True)}


def outcomes_of(counts: NDArray[np.uint64]) -> dict[str, int]:
    """How many camera rays passed the lens, and how many failed and why, of `FilmBuffers.all_counts`."""
    stopped = {status.name.lower(): int(counts[status]) for status in list(RayStatus)[1:]}
    return {"passed": int(counts[-1]) - sum(stopped.values()), **stopped}


def removed_share_of(planes: NDArray[np.float32]) -> float:
    """Return the share of the light of a whole film that the limit of the samples has removed."""
    exact = planes.astype(np.float64)
    removed, kept = exact[PLANES].sum(), np.abs(exact[:3] - exact[3:PLANES]).sum() / 3
    return float(removed / (removed + kept)) if removed else 0.0


#
# How likely paths survive Russian roulette, by cell of the film: before its first sample a render looks at a few tiles.
#
# A path goes on with the chance of its throughput times a factor that is great where the picture is dark: what a path
# brings counts by what its pixel shows. Light per throughput is about the same for all paths of a scene: measured on
# six, it is 1.0 to 2.5 times the square of the mean root of the picture. That mean resists lamps and single bright
# samples, and that of noisy places lies below their light, so that their paths live longer.

SURVIVAL_SCALE = 2.0  # where the picture is as bright as on the whole
MOST_SURVIVAL = 40.0  # times that, at most
MOST_TILES = 512  # that are looked at
SCOUTING_SEED = 0x726F756C65747465  # the same for all seeds, parts and continuations of a picture


@dataclass(frozen=True)
class Roulette:
    """How likely paths survive roulette in each cell of the film.

    Attributes
    ----------
    survival_scale : (down, across) array
        What throughputs are multiplied by, float32.
    cell_shift : int
        Binary logarithm of the pixels across a cell.
    """

    survival_scale: NDArray[np.float32]
    cell_shift: int

    def limits(self, settings: RenderSettings) -> bytes:
        """Return the record ``LIMITS`` of a render."""
        down, across = self.survival_scale.shape
        return LIMITS.one(
            max_depth=settings.max_depth, roulette_depth=settings.roulette_depth, cell_shift=self.cell_shift,
            cells_across=across, cells_down=down,
        ).tobytes()  # fmt: skip


ALIKE = Roulette(np.full((1, 1), SURVIVAL_SCALE, np.float32), 3)
"""The same everywhere."""


def plays(settings: RenderSettings) -> bool:
    """Return whether roulette ends any path."""
    return 0 < settings.roulette_depth < settings.max_depth


def scout_layout(layout: FilmLayout) -> FilmLayout:
    """Return the tiles that are looked at, spread over the whole film, whatever part of it is rendered."""
    step = 1
    while (layout.full_width // (TILE * step)) * (layout.full_height // (TILE * step)) > MOST_TILES:
        step *= 2
    width, height = (
        min(TILE * max(full // (TILE * step), 1), full) for full in (layout.full_width, layout.full_height)
    )
    first = TILE * ((step - 1) // 2)
    return FilmLayout(layout.full_width, layout.full_height, first, first, width, height, step - 1)


def roulette_of(picture: NDArray[np.floating], layout: FilmLayout) -> Roulette:
    """Scale the survival in roulette by a picture (height, width, 3) of the tiles of `scout_layout`.

    Sums are taken in an order that no processor changes.
    """
    height, width = picture.shape[:2]
    down, across = -(-height // TILE), -(-width // TILE)
    channels = picture.astype(np.float64)
    roots = np.sqrt(np.maximum(channels[..., 0] + channels[..., 1] + channels[..., 2], 0.0))
    split = roots.reshape(down, height // down, across, width // across)
    cells = np.zeros((down, across))
    for y in range(split.shape[1]):
        for x in range(split.shape[3]):
            cells += split[:, y, :, x]
    whole = fsum(cells.ravel()) / cells.size
    if whole <= 0.0:
        return ALIKE
    ratio = whole / np.maximum(cells, whole / MOST_SURVIVAL**0.5)
    shift = (TILE * (layout.tiles_skipped + 1)).bit_length() - 1
    return Roulette((SURVIVAL_SCALE * ratio * ratio).astype(np.float32), shift)


# What JSON holds, saved among the arrays of a film.


def array_of_text(data: dict[str, Any]) -> NDArray[np.uint32]:
    """Encode what JSON holds as an array, to be saved among others."""
    return np.frombuffer(json.dumps(data).encode("utf-32-le"), np.uint32)


def text_of_array(array: NDArray[Any]) -> dict[str, Any]:
    """Decode an array of `array_of_text`.

    Raises
    ------
    ValueError
        It is none.
    """
    data = json.loads(array.tobytes().decode("utf-32-le"))
    if not isinstance(data, dict):
        raise ValueError("text")
    return data
