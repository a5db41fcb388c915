"""Runs the small kernels under ``kernels/probe`` that show what device code computes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.device import Session
from rptcam_cl.records import device_declarations

GROUP = 16


def run_probe(session: Session, name: str, facts: Mapping[str, int | str], items: int, *arguments: Any) -> None:
    """Run the kernel ``name`` of ``kernels/probe`` over ``items`` work items."""
    program = session.program([f"probe/{name}.cl"], facts, device_declarations())
    session.bind(program, name, *arguments).enqueue(items, min(GROUP, items))
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
    count = counters[0].size
    out = session.allocate(16 * count)
    facts = {"VW": lanes, "SAMPLER_LATTICE": int(lattice)}
    words = np.array(seed, np.uint32).tobytes()
    run_probe(
        session, "probe_random", facts, count // lanes, *map(session.upload, counters), out, np.uint32(count), words
    )
    return session.read(out, np.float32, 4 * count).reshape(4, count).T
