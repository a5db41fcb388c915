"""What light sampling makes of points and numbers, and its density for given directions."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.device.session import Session
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from tests.device.probes import run

Array = NDArray[np.float64]
ROWS_IN, ROWS_OUT, PADDING = 9, 10, 256


@dataclass(frozen=True)
class Lit:
    """Samples: direction, distance, density (incl. the pick), radiance over density, lamp. What given directions meet:
    lamp, distance, density."""

    direction: Array
    reach: Array
    pdf: Array
    weight: Array
    primitive: Array
    met: Array
    distance: Array
    density: Array


def lit(session: Session, plan: Plan, points, numbers=(0.5, 0.5, 0.5), directions=(0.0, 0.0, 1.0), lanes=8) -> Lit:
    """Return what light sampling does at ``points`` [m from the eye] with ``numbers``, and for ``directions``."""
    parts = [np.atleast_2d(np.asarray(part, np.float64)) for part in (points, numbers, directions)]
    count = max(map(len, parts))
    padded = -(-count // PADDING) * PADDING
    table = np.zeros((ROWS_IN, padded), np.float32)
    table[8] = 1
    for first, part in zip((0, 3, 6), parts, strict=True):
        table[first : first + 3, :count] = part.T
    out = session.allocate(4 * ROWS_OUT * padded)
    run(
        session, "probe_emitter", plan.facts | {"VW": lanes}, padded // lanes, **SceneBuffers(session, plan).scene,
        out=out, count=np.uint32(padded), **{"in": session.upload(table)},
    )  # fmt: skip
    rows = session.read(out, np.float32, ROWS_OUT * padded).reshape(ROWS_OUT, padded)[:, :count].astype(np.float64)
    return Lit(rows[:3].T, *rows[3:])


def unit_numbers(count: int, seed: int) -> Array:
    """Return random numbers of 24 bits, shape (count, 3), as kernels have them."""
    return np.random.default_rng(seed).integers(0, 1 << 24, (count, 3)) / (1 << 24)


def picks(plan: Plan, index: int) -> tuple[float, float]:
    """Return a number that picks an emitter by its power, and the probability of it."""
    chance = plan.emitters.records["pick"].astype(np.float64)
    return float(chance[:index].sum() + chance[index] / 2), float(chance[index])
