"""The photon map of a device: photons of a pass are traced there, sorted on the host, and put among the scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.records import PHOTON_GRID, PHOTON_PASS, device_declarations
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.photon_passes import CELL_BITS_MORE, MOST_CELLS, MOST_PHOTONS, PhotonPass, pass_of
from rptcam_cl.rendering.waves import seed_words

PHOTON_FLOATS = 8
MARK = 7  # column of a photon
MOST_EDGES = 127
SEED = 0x9E3779B97F4A7C15  # parts the random numbers of photons from those of camera paths
PILOT, PILOT_PHOTONS = 2**32 - 1, 1 << 14  # the pass that the first radius follows from
NEIGHBOURS = 8
KEPT = 2048  # photons of the pilot that are compared with each other
FIRST_PHOTONS = 10.0  # within the radius of a pass of one sample, where the light is

Photons = NDArray[np.float32]


class PhotonBuffers:
    """What the kernels read of photons, as arguments by name; `current` says whose photons there are."""

    def __init__(self, session: Session, plan: Plan) -> None:
        self.photons = session.allocate(4 * PHOTON_FLOATS * MOST_PHOTONS)
        self.cells = session.allocate(4 * (MOST_CELLS + 1))
        self.grid = session.upload(PHOTON_GRID.zeros(1))
        self.current: tuple[Any, ...] | None = None
        self.arguments = {
            "caustic_roles": session.upload(plan.caustics.roles),
            "photons": self.photons,
            "photon_cells": self.cells,
            "photon_grid": self.grid,
        }


class PhotonMap:
    """Traces the photons of a pass when a sample needs them.

    Parameters
    ----------
    session, plan
        The device, and the scene.
    scene, tree_facts : dict
        Arguments for ``SCENE_PARAMETERS``, and the facts of the scene's trees.
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
        plan: Plan,
        scene: dict[str, Any],
        tree_facts: dict[str, int],
        buffers: PhotonBuffers,
        max_depth: int,
        pixels: int,
    ) -> None:
        self._session, self._buffers, self._pixels = session, buffers, pixels
        self._max_edges = min(max_depth - 1, MOST_EDGES)
        self._surfaces = len(plan.caustics.curve) // 2 - 1
        facts = plan.facts | tree_facts | {"VW": session.lanes}
        program = session.program(["pass/photons.cl"], facts, device_declarations())
        self._found = session.allocate(4 * PHOTON_FLOATS * MOST_PHOTONS)
        self._launch = session.bind(
            program, "photons", **scene, surfaces=session.upload(plan.caustics.surfaces),
            surface_curve=session.upload(plan.caustics.curve), found=self._found,
            **{"pass": bytes(PHOTON_PASS.dtype.itemsize)},
        )  # fmt: skip
        self._token = object()  # an id would be given again
        self.radius = 0.0
        self._radii: dict[int, float] = {}  # of a pass of one sample, by seed [m]

    def use(self, sample: int, seed: int) -> None:
        """Have the photons in place that a sample sees."""
        seen = pass_of(sample)
        key = (self._token, seed, seen.number)
        if self._buffers.current == key:
            return
        self._buffers.current = key
        if seed not in self._radii:
            pilot = self._trace(PILOT, PILOT_PHOTONS, seed)
            self._radii[seed] = first_radius(pilot, self._pixels)
        photons = self._trace(seen.number, seen.photons(self._pixels), seed)
        self.radius = self._radii[seed] * seen.shrinkage
        self._put(photons, self.radius)

    def _trace(self, number: int, count: int, seed: int) -> Photons:
        """Return the photons of a pass that met a receiver."""
        record = PHOTON_PASS.zeros(1)
        record["seed"][0] = seed_words(seed ^ SEED)
        record["number"], record["max_edges"], record["surfaces"] = number, self._max_edges, self._surfaces
        record["per_photon"] = 1 / count
        self._launch.set(**{"pass": record.tobytes()})
        self._launch.enqueue(count // self._session.lanes, self._session.group)
        found = self._session.read(self._found, np.float32, count * PHOTON_FLOATS).reshape(count, PHOTON_FLOATS)
        return np.asarray(found[found[:, MARK].view(np.int32) >= 0])

    def _put(self, photons: Photons, radius: float) -> None:
        grid, order, cells = sorted_by_cell(photons, radius)
        self._session.write(self._buffers.grid, grid)
        self._session.write(self._buffers.cells, cells)
        if len(photons):
            self._session.write(self._buffers.photons, photons[order])


def sorted_by_cell(photons: Photons, radius: float) -> tuple[NDArray[np.void], NDArray[np.int64], NDArray[np.int32]]:
    """Return how photons lie in memory for a radius [m]: the record ``PhotonGrid``, their order, the starts of cells.

    Photons of a cell keep their order, so that sums over them do not depend on how they are sorted.
    """
    grid = PHOTON_GRID.zeros(1)
    if not len(photons):
        grid["low"], grid["high"] = 1.0, (-1.0, -1.0, -1.0, 1.0)
        return grid, np.zeros(0, np.int64), np.zeros(9, np.int32)
    places = photons[:, :3]
    low, high = places.min(axis=0), places.max(axis=0)
    per_cell = np.float32(0.5 / radius)
    most = min(len(photons).bit_length() + CELL_BITS_MORE, MOST_CELLS.bit_length() - 1)
    bits = _periods((high - low) * per_cell, most)
    grid["low"][0], grid["high"][0] = (*(low - radius), per_cell), (*(high + radius), radius)
    masks = (1 << bits) - 1
    grid["mask_x"], grid["mask_y"], grid["mask_z"] = masks
    cell = np.floor(places * per_cell).astype(np.int64) & masks
    bucket = (cell[:, 2] << (bits[0] + bits[1])) | (cell[:, 1] << bits[0]) | cell[:, 0]
    key = np.sort((bucket << 32) | np.arange(len(photons)))
    starts = np.zeros((1 << int(bits.sum())) + 1, np.int32)
    np.cumsum(np.bincount(bucket, minlength=len(starts) - 1), out=starts[1:])
    return grid, key & 0xFFFFFFFF, starts


def _periods(cells: NDArray[np.float32], most: int) -> NDArray[np.int64]:
    """Return the logarithms to base 2 of the periods along three axes, one at least, ``most`` together."""
    bits = np.maximum(np.ceil(np.log2(np.maximum(cells.astype(np.float64), 1) + 1)), 1).astype(np.int64)
    while bits.sum() > most:
        bits[bits.argmax()] -= 1
    return np.asarray(bits)


def first_radius(pilot: Photons, pixels: int) -> float:
    """Return the radius of a pass of one sample [m], for so many photons within it where most of them are.

    It follows from the median of their distances to neighbours; 1 without any. Their power does not count: where a lamp
    is rarely picked, one photon has that of many.
    """
    some = pilot[:: max(len(pilot) // KEPT, 1)]
    if len(some) <= NEIGHBOURS:
        return 1.0
    places = some[:, :3].astype(np.float64)
    square = (places**2).sum(axis=1)
    distance2 = square[:, None] + square - 2 * places @ places.T
    near2 = np.partition(np.maximum(distance2, 0), NEIGHBOURS, axis=1)[:, NEIGHBOURS]
    median = np.median(near2)
    # photons per area in a pass of one sample, over that of these
    more = PhotonPass(0, 0, 1).photons(pixels) / PILOT_PHOTONS * len(pilot) / len(some)
    return max(float(np.sqrt(median * FIRST_PHOTONS / NEIGHBOURS / more)), 1e-9)
