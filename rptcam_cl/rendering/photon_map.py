"""The photon map of caustics: which photons belong to which samples, and how they are learned, traced and sorted.

`rendering/plan/caustics.py` says where they start and end; `kernels/pass/photons.cl` traces them, and
`kernels/caustics/gather.h` looks for those around a vertex.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import records as layout
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import PHOTON_GRID, PHOTON_PASS
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.plan.caustics import Caustics

Array = NDArray[np.float64]

# The passes: which photons belong to which samples, how many there are, and their radius.
#
# Every sample of the film sees the photons of one pass, which is a function of the sample's number alone: so are its
# radius and its photons. The picture then depends on neither waves nor tiles, and parts of its samples can be merged.
# The mean over the passes converges to the truth as their radius shrinks (Hachisuka et al. 2008; independent passes:
# Knaus and Zwicker 2011).

_SHORT_PASSES = (0, 1, 2, 4, 8)  # first samples, so that few samples have a picture as well
_PASS_SAMPLES = 16  # samples of every later pass
_MOST_SHARES = 8  # of a pass: a vertex that looks through fewer photons costs less, and the pixel sees all of them
_PHOTONS_PER_SAMPLE = 0.0625  # and pixel of the whole film
_LEAST_PHOTONS, MOST_PHOTONS = 1 << 12, 1 << 18  # of a pass; a lattice is good for so many
# Numbers of cells repeat after 4 for a photon, and those of the bytes that say which cells hold any after 32, so that
# few places look into cells of elsewhere. Digits to base 2.
_CELL_DIGITS_MORE, _BYTE_DIGITS_MORE = 2, 5
_LEAST_DIGITS, _MOST_BYTE_DIGITS = 5, 21
_CELL_STEP = 1650377689  # its vectors are longest, of 400 random ones with the worst of 2^9 to 2^21 numbers
MOST_CELLS = MOST_PHOTONS << _CELL_DIGITS_MORE
MOST_CELL_WORDS = (
    MOST_CELLS + 1 + (1 << _MOST_BYTE_DIGITS) // 4
)  # where they begin, and bytes that say where photons are
PHOTON_BYTES = 2 * 4 * 8 * MOST_PHOTONS + 4 * MOST_CELL_WORDS  # as traced and as sorted, and the cells
# The radius shrinks with samples to this power: with the bias of a disk, radius², and the variance,
# 1 / (samples radius²), their mean square falls fastest so, with samples^(-2/3).
_SHRINKING = -1 / 6


@dataclass(frozen=True)
class PhotonPass:
    """One pass.

    Attributes
    ----------
    number : int
    first, samples : int
        The film's samples that see it.
    """

    number: int
    first: int
    samples: int

    def photons(self, pixels: int) -> int:
        """How many photons it has for a film of so many pixels, a power of two."""
        wanted = self.samples * pixels * _PHOTONS_PER_SAMPLE
        return min(max(1 << max(round(wanted), 1).bit_length() - 1, _LEAST_PHOTONS), MOST_PHOTONS)

    @property
    def shares(self) -> int:
        """In how many shares its photons are, of which each sample sees one."""
        return min(self.samples, _MOST_SHARES)

    @property
    def shrinkage(self) -> float:
        """What its radius is of that of the first pass."""
        return float((self.first + 0.5 * (self.samples + 1)) ** _SHRINKING)


def pass_of(sample: int) -> PhotonPass:
    """Return the pass that a sample sees."""
    if sample >= _PASS_SAMPLES:
        number, first = divmod(sample, _PASS_SAMPLES)[0], sample - sample % _PASS_SAMPLES
        return PhotonPass(number + len(_SHORT_PASSES) - 1, first, _PASS_SAMPLES)
    ends = (*_SHORT_PASSES[1:], _PASS_SAMPLES)
    number = sum(sample >= end for end in ends)
    return PhotonPass(number, _SHORT_PASSES[number], ends[number] - _SHORT_PASSES[number])


def within_passes(first: int, samples: int, most: int) -> Iterator[tuple[int, int]]:
    """Yield first sample and number of the pieces of a range of samples that see one pass each, at most so long."""
    end = first + samples
    while first < end:
        seen = pass_of(first)
        count = min(most, end - first, seen.first + seen.samples - first)
        yield first, count
        first += count


# The photon map of a device: photons of a pass are traced there, sorted on the host, and put among the scene.

_PHOTON_FLOATS = 8
_POWER, _MARK = slice(3, 6), 7  # columns of a photon
_MOST_EDGES = 127
_SEED = 0x9E3779B97F4A7C15  # parts the random numbers of photons from those of camera paths
_LEARNING, _PILOT, PILOT_PHOTONS = 2**32 - 2, 2**32 - 1, 1 << 14  # passes that starts and the first radius follow from
_LEARNING_SEED = 0  # whatever the seed of a render
_LEARNED = 0.8  # of starts, the share that follows what was learned
NEIGHBOURS = 8
_KEPT = 2048  # photons of the pilot that are compared with each other
_ROW = 64  # of those, whose neighbours are looked for together
FIRST_PHOTONS = 10.0  # within the radius of a pass of one sample, where the light is

Photons = NDArray[np.float32]


class PhotonBuffers:
    """What the kernels read of photons, as arguments by name; `current` says whose photons there are.

    `learned` is where photons start and the first pass's radius, by the edges of a photon and the pixels of a film.
    """

    def __init__(self, session: Session, caustics: Caustics) -> None:
        self.photons = session.allocate(4 * _PHOTON_FLOATS * MOST_PHOTONS)
        self.cells = session.allocate(4 * MOST_CELL_WORDS)
        self.grid = session.upload(PHOTON_GRID.zeros(1))
        self.current: tuple[Any, ...] | None = None
        self.learned: dict[tuple[int, int], tuple[NDArray[np.float32], float]] = {}
        self.arguments = {
            "caustic_roles": session.upload(caustics.roles),
            "photons": self.photons,
            "photon_cells": self.cells,
            "photon_grid": self.grid,
        }


class PhotonMap:
    """Traces the photons of a pass when a sample needs them.

    Parameters
    ----------
    session
        The device.
    caustics
        Where photons start.
    facts
        Of the scene and its trees.
    scene : dict
        Arguments for ``SCENE_PARAMETERS``.
    buffers
        Where the photons go.
    max_depth
        Longest path [edges].
    pixels
        Of the whole film, of which a crop or some tiles may be rendered.

    Attributes
    ----------
    radius : float
        Of the pass that was used last [m].
    """

    def __init__(
        self,
        session: Session,
        caustics: Caustics,
        facts: Mapping[str, int],
        scene: dict[str, Any],
        buffers: PhotonBuffers,
        max_depth: int,
        pixels: int,
    ) -> None:
        self._session, self._buffers, self._pixels = session, buffers, pixels
        self._max_edges = min(max_depth - 1, _MOST_EDGES)
        self._caustics = caustics
        program = session.program(["pass/photons.cl"], {**facts, "VW": session.lanes}, layout.device_declarations())
        self._found = session.allocate(4 * _PHOTON_FLOATS * MOST_PHOTONS)
        self._everywhere = _everywhere(caustics)
        self._curve = session.upload(_curve_of(self._everywhere))
        self._launch = session.bind(
            program, "photons", **scene, surfaces=session.upload(caustics.surfaces),
            surface_curve=self._curve, found=self._found,
            **{"pass": bytes(PHOTON_PASS.dtype.itemsize)},
        )  # fmt: skip
        self._token = object()  # an id would be given again
        self.radius = 0.0
        self._first_radius: float | None = None  # of a pass of one sample [m], once it is learned

    def use(self, sample: int, seed: int) -> None:
        """Have the photons in place that a sample sees."""
        seen = pass_of(sample)
        key = (self._token, seed, seen.number)
        if self._buffers.current == key:
            return
        self._buffers.current = key
        if self._first_radius is None:
            learning = self._max_edges, self._pixels
            if learning not in self._buffers.learned:
                self._buffers.learned[learning] = self._learn()
            curve, self._first_radius = self._buffers.learned[learning]
            self._session.write(self._curve, curve)
        count = seen.photons(self._pixels)
        photons = self._trace(seen.number, count, seed, seen.shares)
        self.radius = self._first_radius * seen.shrinkage
        self._put(photons, self.radius)

    def _learn(self) -> tuple[NDArray[np.float32], float]:
        """Learn from photons that start everywhere where others should, and from these the first pass's radius [m].

        Regions get a share by what there is, and one by the light that comes from there to receivers.
        """
        areas, regions = self._caustics.areas, self._caustics.regions
        (found,) = self._trace(_LEARNING, PILOT_PHOTONS, _LEARNING_SEED, learns=True)
        start = found[:, _MARK].view(np.int32)
        light = np.bincount(regions[start], luminance(found[:, _POWER].astype(np.float64)), regions.max() + 1)
        shares = self._everywhere
        if light.sum() > 0:
            per_area = light / np.maximum(np.bincount(regions, areas), 1e-300)
            shares = _LEARNED * per_area[regions] * areas / light.sum() + (1 - _LEARNED) * shares
        curve = _curve_of(shares)
        self._session.write(self._curve, curve)
        (pilot,) = self._trace(_PILOT, PILOT_PHOTONS, _LEARNING_SEED)
        return curve, first_radius(pilot, self._pixels)

    def _trace(self, number: int, count: int, seed: int, shares: int = 1, *, learns: bool = False) -> list[Photons]:
        """Return the photons of a pass that met a receiver, in equal shares of those that started."""
        record = PHOTON_PASS.one(
            seed=layout.seed_words(seed ^ _SEED), number=number, max_edges=self._max_edges,
            surfaces=len(self._caustics.areas), per_photon=shares / count, learns=learns,
            unused_digits=33 - count.bit_length(),
        )  # fmt: skip
        self._launch.set(**{"pass": record.tobytes()})
        self._launch.enqueue(count // self._session.lanes, self._session.group)
        photons = self._session.read(self._found, np.float32, count * _PHOTON_FLOATS)
        parts = photons.reshape(count // shares, shares, _PHOTON_FLOATS).swapaxes(0, 1)
        return [part[part[:, _MARK].copy().view(np.int32) >= 0] for part in parts]

    def _put(self, parts: list[Photons], radius: float) -> None:
        photons = np.concatenate(parts)
        share = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        grid, order, cells = sorted_by_cell(photons, radius, share, len(parts))
        self._session.write(self._buffers.grid, grid)
        self._session.write(self._buffers.cells, cells)
        if len(photons):
            self._session.write(self._buffers.photons, photons[order])


def _everywhere(caustics: Caustics) -> Array:
    """Return shares of surfaces: half by area, half alike for each object, as a glass is small beside windows."""
    areas = caustics.areas
    _, objects = np.unique(caustics.surfaces["primitive"], return_inverse=True)
    of_object = np.maximum(np.bincount(objects, areas), 1e-300)
    return np.asarray(areas / areas.sum() + areas / of_object[objects] / len(of_object)) / 2


def _curve_of(shares: Array) -> NDArray[np.float32]:
    return layout.curves(shares[None])[0].ravel()


def sorted_by_cell(
    photons: Photons, radius: float, share: NDArray[np.int64] | None = None, shares: int = 1
) -> tuple[NDArray[np.void], NDArray[np.int64], NDArray[np.int32]]:
    """How photons lie in memory for a radius [m]: the record ``PhotonGrid``, their order, the starts of cells.

    Photons of a cell keep their order, so that sums over them do not depend on how they are sorted. Those of each
    of ``shares``, a power of two, have cells of their own.
    """
    if not len(photons):
        grid = PHOTON_GRID.one(low=1.0, high=(-1.0, -1.0, -1.0, 1.0))
        return grid, np.zeros(0, np.int64), np.zeros(10, np.int32)
    places = photons[:, :3]
    low, high = places.min(axis=0), places.max(axis=0)
    per_cell = np.float32(0.5 / radius)
    digits = (len(photons) - 1).bit_length()
    bits = max(digits + _CELL_DIGITS_MORE + 1 - shares.bit_length(), _LEAST_DIGITS)
    byte_bits = min(max(digits + _BYTE_DIGITS_MORE, _LEAST_DIGITS), _MOST_BYTE_DIGITS)
    grid = PHOTON_GRID.one(
        low=(*(low - radius), per_cell), high=(*(high + radius), radius), step=_CELL_STEP,
        mask_cell=(1 << bits) - 1, mask_byte=(1 << byte_bits) - 1, mask_sample=shares - 1,
    )  # fmt: skip
    steps = np.array([1, _CELL_STEP, _CELL_STEP**2 % (1 << 32)])
    number = np.floor(places * per_cell).astype(np.int64) @ steps
    bucket = number & ((1 << bits) - 1) | (0 if share is None else share) << bits
    key = np.sort((bucket << 32) | np.arange(len(photons)))
    starts = np.zeros((shares << bits) + 1, np.int32)
    np.cumsum(np.bincount(bucket, minlength=len(starts) - 1), out=starts[1:])
    return grid, key & 0xFFFFFFFF, np.concatenate([starts, _about(number, steps, byte_bits)])


def _about(numbers: NDArray[np.int64], steps: NDArray[np.int64], bits: int) -> NDArray[np.int32]:
    """Return a byte for each eight cells that follow one another along the axes: a bit for each that has photons."""
    found = np.zeros(1 << bits, np.uint8)
    holds = np.zeros(1 << bits, bool)
    holds[numbers & (1 << bits) - 1] = True
    held = np.flatnonzero(holds)
    for i in range(8):
        found[held - np.dot((i & 1, i >> 1 & 1, i >> 2), steps) & (1 << bits) - 1] |= np.uint8(1 << i)
    return found.view("<i4").astype(np.int32)


def neighbours2(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the squares of the distances from places (3, n) to their neighbour number `NEIGHBOURS` [m²], in any order.

    Along the longest side of their box: those in a row of it say how far away a neighbour can be.
    """
    along = int(np.ptp(places, axis=1).argmax())
    places = places[:, places[along].argsort(kind="stable")]
    found, here = [], places[along]

    def among(own: slice, low: int, high: int) -> NDArray[np.float64]:
        distance2 = np.zeros((len(here[own]), high - low))
        for axis in places:
            apart = axis[own, None] - axis[low:high]
            distance2 += apart * apart
        distance2.partition(NEIGHBOURS, axis=1)
        return distance2[:, NEIGHBOURS]

    for first in range(0, len(here), _ROW):
        last = min(first + _ROW, len(here))
        own, near = slice(first, last), (max(first - _ROW, 0), min(last + _ROW, len(here)))
        reach = np.sqrt(among(own, *near).max()) * (1 + 1e-9)
        low, high = np.searchsorted(here, here[first] - reach), np.searchsorted(here, here[last - 1] + reach, "right")
        found.append(among(own, min(low, near[0]), max(high, near[1])))
    return np.concatenate(found)


def first_radius(pilot: Photons, pixels: int) -> float:
    """Return the radius of a pass of one sample [m], for so many photons within it where most of them are.

    It follows from the median of their distances to neighbours; 1 without any. Their power does not count: where a lamp
    is rarely picked, one photon has that of many.
    """
    some = pilot[:: max(len(pilot) // _KEPT, 1)]
    if len(some) <= NEIGHBOURS:
        return 1.0
    median = np.median(neighbours2(some[:, :3].T.astype(np.float64)))
    # photons per area in a pass of one sample, over that of these
    more = PhotonPass(0, 0, 1).photons(pixels) / PILOT_PHOTONS * len(pilot) / len(some)
    return max(float(np.sqrt(median * FIRST_PHOTONS / NEIGHBOURS / more)), 1e-9)
