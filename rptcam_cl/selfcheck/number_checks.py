"""Checks of the ground that all else stands on: random numbers, roots and quotients, sums of the film."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.kinds import RayStatus
from rptcam_cl.device import Session
from rptcam_cl.selfcheck.check import Check, random_numbers, run_probe

MASK = (1 << 32) - 1
MULTIPLIER, INCREMENT = 1664525, 1013904223
CORNERS = (0, 1, 2, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF)
SEED = (12345, 67890)
ADDITIONS = 1 << 22  # to a pixel of the film
PER_LAUNCH = 1 << 15  # steps of a loop that no kernel of a render exceeds
LOOPS = 1000  # steps of the inner one
FILM_PIXELS = 16
WORST_ULPS = 3.0  # what OpenCL 1.2 allows a root, and more than it allows a quotient


def pcg4d(x: int, y: int, z: int, w: int) -> tuple[int, int, int, int]:
    """Return the permutation of four words as published (Jarzynski and Olano 2020), in Python's integers."""
    x, y, z, w = ((v * MULTIPLIER + INCREMENT) & MASK for v in (x, y, z, w))
    for mix in (False, True):
        if mix:
            x, y, z, w = (v ^ (v >> 16) for v in (x, y, z, w))
        x = (x + y * w) & MASK
        y = (y + z * x) & MASK
        z = (z + x * y) & MASK
        w = (w + y * z) & MASK
    return x, y, z, w


def known_counters() -> NDArray[np.int64]:
    """Return 512 counters (512, 3): every corner of their range, and some between."""
    rng = np.random.default_rng(2)
    grid = np.array([(a, b, c) for a in CORNERS for b in CORNERS for c in CORNERS])
    return np.concatenate([rng.integers(0, 1 << 32, (512 - len(grid), 3)), grid])


def wrong_random_numbers(session: Session, lanes: int) -> int:
    """Return how many of the 2048 random numbers of the known counters differ from those of the published hash."""
    counters = known_counters()
    pixel, sample, dimension = counters.T
    got = random_numbers(session, pixel, sample, dimension, SEED, lanes=lanes)
    words = [pcg4d(int(a), int(b), int(c) ^ SEED[1], SEED[0]) for a, b, c in counters]
    expected = (np.array(words, np.uint64) >> np.uint64(8)).astype(np.float32) * np.float32(2**-24)
    return int((got != expected).sum())


def random_check(session: Session) -> Check:
    """Known answers of the random numbers."""
    return Check("random numbers: known answers", wrong_random_numbers(session, session.lanes), 0, "of 2048 differ")


def arithmetic_checks(session: Session) -> list[Check]:
    """Roots and quotients, and the test for what is not finite."""
    rng = np.random.default_rng(3)
    count = 4096
    a, b = (np.ldexp(rng.uniform(0.5, 1, count), rng.integers(-60, 60, count)).astype(np.float32) for _ in range(2))
    strange = np.array([np.nan, -np.nan, np.inf, -np.inf, 3.4e38, -3.4e38, 0.0, 1e-45], np.float32)
    a[: len(strange)] = strange
    out = session.allocate(12 * count)
    run_probe(
        session, "probe_arithmetic", {"VW": session.lanes}, count // session.lanes,
        a=session.upload(a), b=session.upload(b), out=out, count=np.uint32(count),
    )  # fmt: skip
    root, quotient, flags = session.read(out, np.float32, 3 * count).reshape(3, count)
    wrong = int(((flags != 0) != ~np.isfinite(a)).sum())
    tame = slice(len(strange), None)
    exact = (np.sqrt(a[tame].astype(np.float64)), a[tame].astype(np.float64) / b[tame])
    worst = max(
        float((np.abs(got - true) / np.spacing(true.astype(np.float32))).max())
        for got, true in zip((root[tame], quotient[tame]), exact, strict=True)
    )
    return [
        Check("roots and quotients", worst, WORST_ULPS, "units in the last place"),
        Check("what is not finite is recognised", wrong, 0, f"of {count} wrong"),
    ]


def film_errors(session: Session, additions: int = ADDITIONS) -> tuple[float, int]:
    """Return the largest relative error of sums on the film, and how many not-finite samples were not counted.

    Every pixel gets numbers that are even over [0, 1), numbers of which one in 4096 is 1000, and tenths; the last
    sample of each is not a number.
    """
    lanes = session.lanes
    sums, counters = session.allocate(24 * FILM_PIXELS, zeroed=True), session.allocate(64, zeroed=True)
    for first in range(0, additions, PER_LAUNCH):
        last = np.uint32(additions - 1)
        count = np.uint32(min(PER_LAUNCH, additions - first))
        run_probe(
            session, "probe_film", {"VW": lanes, "CLAMP": 0}, FILM_PIXELS // lanes,
            sums=sums, counters=counters, pixels=np.uint32(FILM_PIXELS), first=np.uint32(first),
            samples=count, last=last,
        )  # fmt: skip
    planes = session.read(sums, np.float32, 6 * FILM_PIXELS).reshape(6, FILM_PIXELS).astype(np.float64)
    counted = session.read(counters, np.uint32, 16)[len(RayStatus)]
    expected = np.array([_film_sums(pixel, additions - 1) for pixel in range(FILM_PIXELS)]).T
    return float(np.abs((planes[:3] - planes[3:]) / expected - 1).max()), abs(int(counted) - FILM_PIXELS)


def film_values(pixel: int, count: int) -> NDArray[np.float32]:
    """Return the first samples (3, count) that `film_errors` adds to a pixel."""
    index = np.arange(count, dtype=np.uint32) * np.uint32(FILM_PIXELS) + np.uint32(pixel)
    word = index * np.uint32(2654435761)
    even = (word >> np.uint32(8)).astype(np.float32) * np.float32(2**-24)
    rare = np.where(word >> np.uint32(20), even, np.float32(1000))
    return np.stack([even, rare, np.full(count, 0.1, np.float32)])


def _film_sums(pixel: int, count: int) -> NDArray[np.float64]:
    sums: NDArray[np.float64] = film_values(pixel, count).sum(axis=1, dtype=np.float64)
    return sums


def loop_check(session: Session) -> Check:
    """Loops run to their end, as far as the device is known to let them: more than a kernel of a render takes."""
    steps = 1 << 20 if session.loop_limit is None else session.loop_limit - 1
    outer = steps // (LOOPS + 1)  # a step of the outer loop counts, too
    out = session.allocate(4)
    run_probe(session, "probe_loops", {"VW": 1}, 1, out=out, outer=np.uint32(outer), inner=np.uint32(LOOPS))
    done = int(session.read(out, np.uint32, 1)[0])
    return Check(f"loops: {outer * LOOPS} steps", abs(outer * LOOPS - done), 0, "not taken")


def film_checks(session: Session) -> list[Check]:
    """Sums of many samples, and samples that are not numbers."""
    error, uncounted = film_errors(session)
    return [
        Check(f"film: {ADDITIONS} samples in a pixel", error, 1e-7, "relative"),
        Check("film: samples that are not numbers", uncounted, 0, f"of {FILM_PIXELS} not dropped and counted"),
    ]
