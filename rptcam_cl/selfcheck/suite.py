"""The suite of checks: what `rptcam doctor --numerics` runs on a device, and the tests on theirs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.device import Session
from rptcam_cl.selfcheck.check import Check
from rptcam_cl.selfcheck.geometry_checks import (
    departure_check,
    far_sphere_checks,
    leak_check,
    mesh_tree_check,
    object_tree_check,
)
from rptcam_cl.selfcheck.lens_checks import library_checks, radius_checks, reflection_check, stigmatic_checks
from rptcam_cl.selfcheck.number_checks import arithmetic_checks, film_checks, loop_check, random_check
from rptcam_cl.selfcheck.picture_checks import energy_check, lens_checks, organisation_checks


@dataclass(frozen=True)
class CheckGroup:
    """Some checks that are made together.

    Attributes
    ----------
    name : str
    make : callable
        Makes them on a device.
    """

    name: str
    make: Callable[[Session], Check | Sequence[Check]]


SUITE = (
    CheckGroup("random numbers", random_check),
    CheckGroup("arithmetic", arithmetic_checks),
    CheckGroup("loops", loop_check),
    CheckGroup("film", film_checks),
    CheckGroup("lens surfaces", radius_checks),
    CheckGroup("total reflection", reflection_check),
    CheckGroup("stigmatic lenses", stigmatic_checks),
    CheckGroup("real lenses", library_checks),
    CheckGroup("leaks", leak_check),
    CheckGroup("tree of a mesh", mesh_tree_check),
    CheckGroup("tree of shapes", object_tree_check),
    CheckGroup("self-hits", departure_check),
    CheckGroup("far spheres", far_sphere_checks),
    CheckGroup("light in closed rooms", energy_check),
    CheckGroup("organisation", organisation_checks),
    CheckGroup("ways through a lens", lens_checks),
)


@dataclass(frozen=True)
class Outcome:
    """The checks of a part, and how long they took [s]."""

    checks: tuple[Check, ...]
    seconds: float


def outcomes(session: Session, suite: Sequence[CheckGroup] = SUITE) -> Iterator[Outcome]:
    """Yield the result of each part of a suite; a device that fails in one is still tried in the next."""
    for part in suite:
        begun = time.perf_counter()
        try:
            made = part.make(session)
        except Exception as error:  # whatever a driver throws belongs in the report
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            made = Check(part.name, np.nan, 0, "could not be checked", reason)
        checks = (made,) if isinstance(made, Check) else tuple(made)
        yield Outcome(checks, time.perf_counter() - begun)
