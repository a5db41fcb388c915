"""One copy of a lens, chosen by how good it is among all: the lens behind which a picture is taken."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics import Copies, Deviation, Lens
from rptcam_cl.scene import Tolerances
from rptcam_cl.tolerances.limits import limits
from rptcam_cl.tolerances.run import ToleranceRun, tolerance
from rptcam_cl.tolerances.specification import Specification

REMEMBERED = 8  # runs


@dataclass(frozen=True)
class ChosenCopy:
    """A copy at a percentile.

    Attributes
    ----------
    percent : float
        Of the copies are as good or better.
    number : int
        Which one it is.
    deviations : sequence of Deviation
    values : (1, deviations, 2) array
        What is off, as `Copies` has it.
    shift_mm : float
        How far refocusing moves its film along the light.
    spot_um, mtf : float
        Its merit.
    """

    percent: float
    number: int
    deviations: Sequence[Deviation]
    values: NDArray[np.float64]
    shift_mm: float
    spot_um: float
    mtf: float

    def lens(self, state: Lens) -> Lens:
        """Return the copy in the state that its design has: zoomed, stopped down, focused."""
        return Copies(state, self.deviations, self.values).copy(0)


def chosen_copy(lens: Lens, spec: Specification, percent: float) -> ChosenCopy:
    """Return the copy of a lens at a percentile; the run is remembered.

    Parameters
    ----------
    lens : Lens
        The design as its file has it: the copy stays the same however the lens is set.
    percent : float
        Above 0, at most 100.

    Raises
    ------
    InputError
        As `tolerance`.
    """
    limits(lens, spec)  # whose errors name the place in the specification
    run = _remembered(_Design(lens), spec.tolerances)
    number = run.copy_at(percent)
    return ChosenCopy(
        percent,
        number,
        run.copies.deviations,
        run.copies.values[number : number + 1],
        float(run.scores.shifts_mm[number]),
        float(run.scores.spot_um[number]),
        float(run.scores.modulation[number]),
    )


@dataclass(frozen=True, eq=False)
class _Design:
    """A lens that equals every other one with the same content."""

    lens: Lens

    def _content(self) -> tuple[object, ...]:
        lens = self.lens
        return lens.name, lens.surfaces, lens.stop_index, lens.object_medium, lens.configurations, lens.floating

    def __hash__(self) -> int:
        return hash(self._content())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Design) and self._content() == other._content()


@lru_cache(maxsize=REMEMBERED)
def _remembered(design: _Design, tolerances: Tolerances) -> ToleranceRun:
    return tolerance(design.lens, tolerances, with_sensitivities=False)
