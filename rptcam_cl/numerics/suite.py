"""The suite of checks: what `rptcam doctor --numerics` runs on a device, and the tests on theirs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rptcam_cl.device import Session
from rptcam_cl.numerics.check import Check
from rptcam_cl.numerics.geometry_checks import (
    departure_check,
    far_sphere_checks,
    leak_check,
    mesh_tree_check,
    object_tree_check,
)
from rptcam_cl.numerics.lens_checks import library_checks, radius_checks, reflection_check, stigmatic_checks
from rptcam_cl.numerics.number_checks import arithmetic_checks, film_checks, loop_check, random_check
from rptcam_cl.numerics.picture_checks import energy_check, lens_checks, organisation_checks


@dataclass(frozen=True)
class Part:
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
    Part("random numbers", random_check),
    Part("arithmetic", arithmetic_checks),
    Part("loops", loop_check),
    Part("film", film_checks),
    Part("lens surfaces", radius_checks),
    Part("total reflection", reflection_check),
    Part("stigmatic lenses", stigmatic_checks),
    Part("real lenses", library_checks),
    Part("leaks", leak_check),
    Part("tree of a mesh", mesh_tree_check),
    Part("tree of shapes", object_tree_check),
    Part("self-hits", departure_check),
    Part("far spheres", far_sphere_checks),
    Part("light in closed rooms", energy_check),
    Part("organisation", organisation_checks),
    Part("ways through a lens", lens_checks),
)


@dataclass(frozen=True)
class Outcome:
    """The checks of a part, and how long they took [s]."""

    checks: tuple[Check, ...]
    seconds: float


def outcomes(session: Session, suite: Sequence[Part] = SUITE) -> Iterator[Outcome]:
    """Yield what becomes of each part of a suite; a device that fails in one is still tried in the next."""
    for part in suite:
        begun = time.perf_counter()
        try:
            made = part.make(session)
        except Exception as error:  # whatever a driver throws belongs in the report
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            made = Check(part.name, np.nan, 0, "could not be checked", reason)
        checks = (made,) if isinstance(made, Check) else tuple(made)
        yield Outcome(checks, time.perf_counter() - begun)
