"""Rays of chosen ways between the surfaces of a lens, followed together wherever they travel the same way.

All rays pass the surfaces to the film, leave where their way is first reflected, go back together, and so on: a lens
is passed three times for all its pairs of reflections.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.ghost_entry import Entry
from rptcam_cl.optics.ghost_path import Way
from rptcam_cl.optics.ghost_tree import Lit
from rptcam_cl.optics.polarised_beam import Arrival, Crossing, LensAtWavelength, PolarisedBeam, meet

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Numbers = NDArray[np.intp]

CHUNK = 8192  # rays whose components stay in the processor's cache
NOWHERE = -1  # where a way is not reflected any more


@dataclass(frozen=True)
class Start:
    """Where rays of a way shall enter.

    Attributes
    ----------
    points : (n, 2) array
        Of the front, known to lead to the film [mm].
    spacing : float
        Between them [mm].
    count : int
        Rays to be followed.
    """

    points: Array
    spacing: float
    count: int


@dataclass(frozen=True)
class Found:
    """Rays of one way on the film.

    Attributes
    ----------
    points : (n, 2) array
        Of the front that they came through [mm].
    film : (2, n) array
        Where they meet the film [mm].
    light : (n,) array
    inside : (n,) array
        Which are in the frame.
    spacing : float
        Between rays on the front [mm].
    is_even : bool
        Whether each ray stands for one on the other side as well.
    """

    points: Array
    film: Array
    light: Array
    inside: Mask
    spacing: float
    is_even: bool

    def again(self, count: int, *, in_frame: bool = False) -> Start:
        """Return where more such rays shall enter, perhaps only those to the frame."""
        return Start(self.points[self.inside] if in_frame else self.points, self.spacing, count)

    def in_frame(self) -> tuple[float, tuple[float, float], float]:
        """Return flux in the frame, its centroid and its rms radius [mm]."""
        weight, at = self.light[self.inside], self.film[:, self.inside]
        total = float(weight.sum())
        if not total > 0:
            return 0.0, (np.nan, np.nan), np.nan
        centre = at @ weight / total
        if self.is_even:
            centre[0] = 0.0
        square = float(np.sum((at - centre[:, None]) ** 2, axis=0) @ weight) / total
        return total, (float(centre[0]), float(centre[1])), float(np.sqrt(square))


def followed(lit: Lit, starts: Mapping[Way, Start]) -> dict[Way, Found]:
    """Return the rays of each way on the film, once through an even lattice about where they are known to enter."""
    entry, found = Entry(lit.lens, lit.source), dict[Way, Found]()
    for ways in _chunks(starts):
        fronts, areas = [], []
        for way in ways:
            start = starts[way]
            points, area = entry.within(entry.around(start.points, start.spacing), start.count)
            fronts.append(entry.rays(points, area))
            areas.append(area)
        found |= _landed(lit, entry, ways, fronts, areas)
    return found


def _chunks(starts: Mapping[Way, Start]) -> Iterator[list[Way]]:
    """Yield ways by as many as have rays enough together; those without a known ray are left out."""
    chunk: list[Way] = []
    for way, start in starts.items():
        if len(start.points):
            chunk.append(way)
        if sum(starts[other].count for other in chunk) >= CHUNK:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


def _landed(lit: Lit, entry: Entry, ways: list[Way], fronts: list[Arrival], areas: list[float]) -> dict[Way, Found]:
    """Return rays of several ways on the film."""
    counts = [len(front.cosines) for front in fronts]
    ends = np.cumsum(counts)
    front = _joined(fronts)
    entered = front.beam.points[:2].T
    turns = np.full((len(entered), max(map(len, ways), default=0) + 1), NOWHERE)
    for way, first, end in zip(ways, ends - counts, ends, strict=True):
        turns[first:end, : len(way)] = way
    beam = together(lit.at_wavelength, front, turns)
    light, inside, owner = beam.light, lit.in_frame(beam.points), np.searchsorted(ends, beam.rows, side="right")
    found = {}
    for number, (way, area) in enumerate(zip(ways, areas, strict=True)):
        own = owner == number
        found[way] = Found(
            entered[beam.rows[own]], beam.points[:2, own], light[own], inside[own], float(np.sqrt(area)), entry.is_even
        )
    return found


def _joined(fronts: list[Arrival]) -> Arrival:
    """Return rays on the first surface as one, numbered through."""
    beam = PolarisedBeam.joined([front.beam for front in fronts])
    beam = replace(beam, rows=np.arange(len(beam.rows)))
    normals, cosines = (np.concatenate([getattr(f, name) for f in fronts], axis=-1) for name in ("normals", "cosines"))
    return Arrival(beam, normals, cosines)


def together(lens: LensAtWavelength, front: Arrival, turns: Numbers) -> PolarisedBeam:
    """Return rays on the first surface as they meet the film, each by its own way; the film is the last surface.

    Parameters
    ----------
    lens : LensAtWavelength
    front : Arrival
        Rays numbered through.
    turns : (n, m) array
        Which surfaces reflect each ray, in order, `NOWHERE` behind the last.
    """
    film = len(lens.prescription.surfaces) - 1
    landed: list[PolarisedBeam] = []
    joining: dict[int, list[PolarisedBeam]] = {0: [front.beam]}
    for phase in range(turns.shape[1]):
        forward, turned = phase % 2 == 0, defaultdict(list)
        beam: PolarisedBeam | None = None
        for k in range(film + 1) if forward else range(film, -1, -1):
            beams = [*([beam] if beam is not None else []), *joining.get(k, [])]
            if not beams:
                continue
            at = front if phase == 0 and k == 0 else meet(lens, PolarisedBeam.joined(beams), k, forward)
            bounces = turns[at.beam.rows, phase] == k
            if bounces.any():
                crossing = Crossing(lens, at.some(bounces), k, forward)
                back = crossing.onward() if crossing.surface.is_mirror else crossing.reflected()
                turned[k - 1 if forward else k + 1].append(back)
            rest = at.some(~bounces)
            if k == film and forward:
                landed.append(rest.beam)
            goes_on = len(rest.cosines) > 0 and not (k == film and forward)
            beam = Crossing(lens, rest, k, forward).onward() if goes_on else None
        joining = turned
    return PolarisedBeam.joined(landed or [front.beam.kept(np.zeros(len(turns), dtype=bool))])
