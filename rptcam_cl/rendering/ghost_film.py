"""The light of ghosts on a film: rays of every pair of reflecting surfaces, shared out by the light that they bring.

Scouts tell how much light each pair brings, and where. The others are shared out so that the film errs least, and
added in whole numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.device import Session
from rptcam_cl.optics import Lens
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.ghost_rays import LATTICE, ONE_LIGHT, GhostRays, Way
from rptcam_cl.rendering.ghost_scouts import Scouted, scout
from rptcam_cl.scene import Scene

Array = NDArray[np.float64]

LEAST_SHARE = 1e-3  # of all ghosts in each colour, below which a way is left out
DARK = 0.2  # of the mean light: darker cells are no reason for more rays
PER_PIXEL, LEAST_RAYS, MOST_RAYS = 40.0, 1 << 20, 1 << 25  # of all ways
SHARING = 0.7  # power to which ways share rays: between alike and by what each needs, found by trial
WIDTH, FINER = 1.7, 1.6  # of the spread of a way's light [pixels], by trial; ratio of one width to the next
LEAST_SPREAD = 2  # steps from one pixel, below which the points of a sun would show
STEP = LATTICE / (1 << 32)
PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])  # steps of the plane's plastic sequence (Roberts 2018)


class GhostFilm:
    """The film of a scene under the light of ghosts."""

    def __init__(self, scene: Scene, plan: Plan, session: Session) -> None:
        self.rays = GhostRays(scene, plan, session)
        self.shape = (self.rays.rows, self.rays.columns, 3)
        self.value = float(plan.camera.metadata["values_per_irradiance"]) / self.rays.pixel_mm2  # of 1 W/m2 over 1 mm2

    def light(self) -> tuple[Array, dict[str, Any]]:
        """Return the film's values (rows, columns, 3) of all ghosts, and what metadata should say."""
        sources = self.rays.sources
        metadata: dict[str, Any] = {"sources": len(sources.places)}
        if sources.mirrored:
            metadata["mirrored"] = sources.mirrored
        if sources.left_out:
            metadata["left_out"] = list(sources.left_out)
        if not len(sources.places):
            return np.zeros(self.shape), metadata | {"ways": 0, "dropped_share": 0.0}
        scouted = {way: scout(self.rays, way) for way in _pairs(self.rays.lens)}
        fluxes = {way: found.flux.sum(axis=0) for way, found in scouted.items()}
        total = sum(fluxes.values())
        kept = {way: found for way, found in scouted.items() if np.any(fluxes[way] > LEAST_SHARE * total)}
        dropped = 1.0 - float(sum(fluxes[way].sum() for way in kept) / total.sum()) if kept else 0.0
        dropped = 1.0 - (1.0 - dropped) * (1.0 - sources.dropped_share)
        film = self._splatted(kept) if kept else np.zeros(self.shape)
        return film, metadata | {"ways": len(kept), "dropped_share": dropped}

    def _shared_out(self, kept: Mapping[Way, Scouted]) -> dict[Way, Array]:
        """Return how many rays each wavelength of each way gets.

        The mean square of what light on a pixel errs by, relative to all light there, is least when rays are shared
        out by flux / light (Cauchy and Schwarz), over the root of the share of the rays that arrive. Wide faint ways
        are spread more, and need less.
        """
        light = sum(np.einsum("ijk,kc->ijc", found.cells, found.flux) for found in kept.values())
        light = np.maximum(light, DARK * light.mean(axis=(0, 1)))
        weights = {}
        for way, found in kept.items():
            over = np.einsum("ijk,ijc->kc", found.cells, 1.0 / np.maximum(light, 1e-100) ** 2)
            needs = np.sqrt(np.sum(found.flux**2 * over, axis=1))
            weights[way] = needs * needs.sum() ** (SHARING - 1.0) / np.sqrt(found.arriving)
        total = float(np.clip(PER_PIXEL * self.shape[0] * self.shape[1], LEAST_RAYS, MOST_RAYS))
        scale = total / sum(float(weight.sum()) for weight in weights.values())
        return {way: scale * weight for way, weight in weights.items()}

    def _spread_steps(self, found: Scouted, rays: float) -> int:
        """Return over how many steps of `FINER` from one pixel the light of a way is spread, which has got some rays.

        What is spread over a width w errs at its edges, as the edges' length times w, and has noise, as 1 / rays / w^2:
        together least where w^3 goes as the root of the area over the rays that arrive on a pixel of it.
        """
        shares = found.cells.mean(axis=2)
        area = shares.sum() ** 2 / np.sum(shares**2) * self.shape[0] * self.shape[1] / shares.size
        width = WIDTH * np.cbrt(area**1.5 / (rays * found.arriving))
        return max(round(float(np.log(width) / np.log(FINER))), LEAST_SPREAD)

    def _splatted(self, kept: Mapping[Way, Scouted]) -> Array:
        """Return the light of ways on the film, each spread by its own width."""
        shared, largest = self._shared_out(kept), 0.0
        launches: dict[int, list[Any]] = {}
        for way, found in kept.items():
            alike = launches.setdefault(self._spread_steps(found, float(shared[way].sum())), [])
            for record, band in enumerate(self.rays.bands):
                lit = self.rays.lit(found.boxes, record)
                boxes = found.boxes[lit]
                if not len(boxes):
                    continue
                count = self.rays.whole_groups(shared[way][record] / len(boxes))
                weights = band.light[lit] * (boxes[:, 2] * boxes[:, 3] / count)[:, None]
                brightest = 4.0 * found.largest * float(np.abs(weights).max())  # a ray may bring more than scouts
                largest = max(largest, brightest)
                alike.append((way, record, self.rays.sources.places[lit], boxes, weights, count))
        film, session = np.zeros(self.shape), self.rays.session
        for steps, alike in sorted(launches.items()):
            words = session.allocate(8 * film.size, zeroed=True)
            for way, record, places, boxes, weights, count in alike:
                first = _shifts(len(boxes) * record + np.arange(len(boxes)), count)
                self.rays.add(words, way, record, places, boxes, weights / largest, first, count)
            units = session.read(words, "<i8", film.size).astype(np.float64)
            film += _spread(units.reshape(film.shape), FINER**steps)
        return film * (largest / ONE_LIGHT * self.value)


def _shifts(numbers: NDArray[np.intp], rays: int) -> Array:
    """Return where lattices begin (n, 2) so that all of them together, and some in a row, are even as well.

    The first coordinate is in points of the lattice. They are points of the plane's plastic sequence (Roberts 2018) in
    the shortest basis of the lattice (n / rays, n g mod 1), which Gauss's reduction finds.
    """
    a, b = np.array([1.0 / rays, STEP]), np.array([0.0, 1.0])
    while True:
        a, b = (a, b) if a @ a <= b @ b else (b, a)
        steps = np.rint(a @ b / (a @ a))
        if steps == 0:
            break
        b = b - steps * a
    u, v = (np.mod(numbers[:, None] * PLASTIC + 0.5, 1.0) @ np.array([a, b])).T
    whole = np.floor(u * rays)
    return np.column_stack([u * rays - whole, np.mod(v - whole * STEP, 1.0)])


def _pairs(lens: Lens) -> Iterator[Way]:
    """Yield the pairs of surfaces that reflect: the first one, and one before it."""
    indices = lens.indices(550.0)
    partly = [k for k, s in enumerate(lens.surfaces) if not s.is_mirror and indices[k] != indices[k + 1]]
    for j in partly:
        yield from ((j, i) for i in partly if i < j)


def _spread(film: Array, width: float) -> Array:
    """Return a film whose light is spread by a tent of a half width [pixels], and mirrored at its border."""
    reach = int(np.ceil(width))
    tent = np.maximum(width - np.abs(np.arange(-reach, reach + 1)), 0.0)
    tent /= tent.sum()
    if len(tent) <= 3 and tent[1] == 1.0:
        return film
    for axis in (0, 1):
        widths = [(0, 0)] * 3
        widths[axis] = (reach, reach)
        padded = np.pad(film, widths, mode="symmetric")
        size = film.shape[axis]
        film = np.zeros_like(film)
        for i, weight in enumerate(tent):
            film += weight * (padded[i : i + size] if axis == 0 else padded[:, i : i + size])
    return film
