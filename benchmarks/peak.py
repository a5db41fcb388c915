"""The device's peak of float32 multiply-adds, measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.stopwatch import fastest
from rptcam_cl.device.programs import Program
from rptcam_cl.device.session import Session

KERNEL = Path(__file__).with_name("multiply_add.cl")
CHAINS = 10  # per lane; with the two factors they fill, but do not exceed, sixteen vector registers
GROUP = 64


def peak_flops(session: Session, seconds: float) -> float:
    """Return float32 operations per second, a multiply-add counted as two.

    Parameters
    ----------
    seconds
        How long each of three runs takes, roughly [s].
    """
    lanes = session.lanes
    items = session.info.compute_units * GROUP * (4 if session.info.type == "cpu" else 64)
    head = f"typedef float{lanes if lanes > 1 else ''} F;\n#define CHAINS {CHAINS}\n"
    program = Program(session.context, session.info.handle, head + KERNEL.read_text(encoding="ascii"))
    out = session.allocate(4 * items * lanes)
    launch = session.bind(
        program, "multiply_add", out=out, factor=np.float32(0.999), summand=np.float32(1e-3), rounds=np.int32(1)
    )

    def run(rounds: int) -> float:
        launch.set(rounds=np.int32(rounds))

        def work() -> None:
            launch.enqueue(items, GROUP)
            session.finish()

        return fastest(work, 3).undisturbed(session.info.type)

    run(1)
    rounds = 1000
    while (took := run(rounds)) < 0.2 * seconds:
        rounds *= 4
    return 2.0 * items * lanes * CHAINS * rounds / took
