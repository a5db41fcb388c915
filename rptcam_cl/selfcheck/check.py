"""A check of a device: what was measured and what it may be; and the kernels that show what a device computes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device import Session


@dataclass(frozen=True)
class Check:
    """One line of the report.

    Attributes
    ----------
    name : str
        What was checked.
    measured, allowed : float
        The check is passed when the first is at most the second; what is not a number fails.
    unit : str
        Of both.
    note : str
        Anything else worth saying; for a check that could not be made, why.
    skipped : bool
        Whether it needs what the device does not offer; it then neither passes nor fails.
    """

    name: str
    measured: float
    allowed: float
    unit: str
    note: str = ""
    skipped: bool = False

    @property
    def passed(self) -> bool:
        """Whether the device computes what it should."""
        return bool(self.measured <= self.allowed)

    @property
    def failed(self) -> bool:
        """Whether the check was made, and the device computes something else."""
        return not self.passed and not self.skipped


def needs_float64(name: str, unit: str) -> Check:
    """Return a check that was not made because the device has no float64."""
    return Check(name, math.nan, math.nan, unit, "the device has no float64", skipped=True)


GROUP = 16  # most work items per group


def run_probe(session: Session, probe: str, facts: Mapping[str, int | str], items: int, /, **arguments: Any) -> None:
    """Run a kernel of ``kernels/probe`` over ``items`` work items; its arguments are given by name."""
    program = session.program([f"probe/{probe}.cl"], facts, device_declarations())
    session.bind(program, probe, **arguments).enqueue(items, 1 if session.group == 1 else min(GROUP, items))
    session.finish()


def random_numbers(
    session: Session,
    pixel: ArrayLike,
    sample: ArrayLike,
    dimension: ArrayLike,
    seed: tuple[int, int],
    *,
    lanes: int,
    lattice: bool = False,
) -> NDArray[np.float32]:
    """Return the four random numbers (n, 4) of each counter; ``n`` must be a multiple of ``lanes`` times 16."""
    counters = [np.ascontiguousarray(part.ravel(), np.uint32) for part in np.broadcast_arrays(pixel, sample, dimension)]
    pixels, samples, dimensions = map(session.upload, counters)
    count = counters[0].size
    out = session.allocate(16 * count)
    facts = {"VW": lanes, "SAMPLER_LATTICE": int(lattice)}
    words = np.array(seed, np.uint32).tobytes()
    run_probe(
        session, "probe_random", facts, count // lanes, pixels=pixels, samples=samples, dimensions=dimensions, out=out,
        capacity=np.uint32(count), seed=words,
    )  # fmt: skip
    return session.read(out, np.float32, 4 * count).reshape(4, count).T
