"""What some rays say of the light of ghosts by a pair of surfaces: where it enters, how much arrives, and where."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.ghost_rays import LATTICE, SCOUTS, GhostRays, Opening, Way

Array = NDArray[np.float64]

MORE = 4  # times as many over the whole front, where the opening is small in it
SECOND_SCOUTS = 4096  # of all sources and wavelengths of a way, where the first have found light
CELLS = (24, 16)  # columns and rows of the coarse film by which rays are shared out


@dataclass(frozen=True)
class Scouted:
    """What some rays say of a way.

    Attributes
    ----------
    boxes : (n, 4) array
        Of each source on the plane of the first vertex: corner and sides [mm]; without sides where nothing arrives.
    flux : (waves, 3) array
        Of all sources on the film, of each wavelength in the film's colours [W/m2 mm2].
    cells : (rows, columns, waves) array
        Share of each wavelength's flux in the cells of a coarse film.
    arriving : float
        Share of rays through the boxes that reach the film.
    largest : float
        Largest share of a ray's light that arrives.
    """

    boxes: Array
    flux: Array
    cells: Array
    arriving: float
    largest: float


def scout(rays: GhostRays, way: Way) -> Scouted:
    """Return how much light a way brings at each wavelength, and where."""
    boxes, waves = _boxes(rays, way), len(rays.lenses)
    flux, cells = np.zeros((waves, 3)), np.zeros((CELLS[1], CELLS[0], waves))
    sent, arrived, largest = 0, 0, 0.0
    for record in range(waves):
        lit = rays.lit(boxes, record)
        own, light = boxes[lit], rays.bands[record].light[lit]
        if not len(own):
            continue
        sample = rays.whole_groups(SECOND_SCOUTS / (len(own) * waves))
        area = (own[:, 2] * own[:, 3] / sample)[:, None]
        x, y, share = rays.landed(way, rays.lenses[record], rays.sources.places[lit], own, sample)
        flux[record] = np.abs((share.sum(axis=1)[:, None] * area * light).sum(axis=0))
        hits = share > 0
        at = [(place[hits] * cell / size).astype(int)
              for place, cell, size in ((y, CELLS[1], rays.rows), (x, CELLS[0], rays.columns))]  # fmt: skip
        carried = (share * area * np.abs(light).sum(axis=1)[:, None])[hits]
        np.add.at(cells[..., record], tuple(at), carried / max(float(carried.sum()), 1e-300))
        sent, arrived = sent + sample * len(own), arrived + int(hits.sum())
        largest = max(largest, float(share.max()))
    return Scouted(boxes, flux, cells, max(arrived / max(sent, 1), 1e-3), largest)


def _boxes(rays: GhostRays, way: Way) -> Array:
    """Return where the light of a way enters (n, 4), by rays over the whole front at a middle wavelength.

    Where few of them would find a small opening, they look for the ways through wider ones first.
    """
    reach = rays.reach
    boxes = np.tile([-reach, -reach, 2 * reach, 2 * reach], (len(rays.sources.places), 1))
    for stage, opening in enumerate(rays.openings):
        first_of_several = stage == 0 and len(rays.openings) > 1
        boxes = _narrowed(rays, way, boxes, opening, MORE * SCOUTS if first_of_several else SCOUTS)
    return boxes


def _narrowed(rays: GhostRays, way: Way, boxes: Array, opening: Opening, scouts: int) -> Array:
    """Return the part of each box (n, 4) through which light gets to the film, some room about it."""
    lit = np.flatnonzero(boxes[:, 2] > 0)
    found, margin = np.zeros_like(boxes), 1.5 / np.sqrt(scouts)
    if not len(lit):
        return found
    inside = rays.landed(way, opening, rays.sources.places[lit], boxes[lit], scouts)[2] > 0
    numbers = np.arange(scouts, dtype=np.uint64)
    u = (numbers + 0.5) / scouts
    v = ((numbers * LATTICE % (1 << 32)) >> 8).astype(np.float64) / (1 << 24)
    for source, hit in zip(lit, inside, strict=True):
        if hit.any():
            low = np.clip([u[hit].min() - margin, v[hit].min() - margin], 0.0, 1.0)
            high = np.clip([u[hit].max() + margin, v[hit].max() + margin], 0.0, 1.0)
            corner, sides = boxes[source, :2], boxes[source, 2:]
            found[source] = [*(low * sides + corner), *((high - low) * sides)]
    return found
