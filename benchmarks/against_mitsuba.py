"""Samples per second beside Mitsuba 3, rendering the same scenes on the same processor in turns.

    python -m benchmarks.against_mitsuba [--rounds 7] [--seconds 1] [--mitsuba-python PATH] [--avx2] [--json FILE]

Each renderer lives in a process of its own; start, scene building and compilation do not count. A round asks ours, then
Mitsuba's, for as many samples as take it about ``--seconds``. Ratios are taken per round and their median is reported,
by wall time and by CPU time (of all threads together), which other work on the machine disturbs less. For A_lens,
Mitsuba, which has no such lens, renders A through its pinhole. The mean colours of both pictures must agree, so that
the same work is done; that of A_lens must agree with the reference picture of the tests.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.mitsuba_scene import describe
from benchmarks.report import arguments, machine, print_machine, print_table, spread, write_json
from benchmarks.scenes import FULL_SIZE, REFERENCE, reference_scene
from benchmarks.stopwatch import cores
from benchmarks.worker import Worker, WorkerError
from rptcam_cl.device.devices import choose_device

GOAL = {"A": 5.0, "A_thin": 5.0, "A_lens": 5.0, "B": 7.5, "C": 1.5, "D": 1.5}
THEIRS = {"A": "A", "A_thin": "A_thin", "A_lens": "A", "B": "B", "C": "C", "D": "D"}
MOST_DIFFERENCE = 0.005  # of mean colours, beyond which the work is not the same
COLUMNS = ("scene", "roulette", "clock", "ours", "Mitsuba", "ratio (min-max)", "goal", "met", "mean differs")


@dataclass
class Side:
    """One renderer, one scene: what it was asked and what it answered."""

    worker: Worker
    name: str
    pixels: int
    by_cpu: bool
    spp: int = 1

    def __post_init__(self) -> None:
        self.answers: list[dict[str, Any]] = []

    def calibrate(self, seconds: float) -> None:
        """Warm up, then choose the samples per pixel that take about the given time where nothing else runs."""
        for _ in range(3):
            self._render(self.spp, 0)  # compiles what a number of samples needs
            answer = self._render(self.spp, 0)
            rate = self.spp / (answer["cpu"] / cores() if self.by_cpu else answer["wall"])
            self.spp = max(round(rate * seconds), 1)
        self._render(self.spp, 0)

    def play(self, seed: int) -> None:
        """Render once more, for the record."""
        self.answers.append(self._render(self.spp, seed))

    def _render(self, spp: int, seed: int) -> dict[str, Any]:
        return self.worker.ask(do="render", spp=spp, seed=seed, **{"as": self.name})

    def rates(self, clock: str) -> list[float]:
        """Return millions of samples per second of every round, by ``wall`` or ``cpu`` time of all cores."""
        share = cores() if clock == "cpu" else 1
        return [share * self.pixels * self.spp / answer[clock] / 1e6 for answer in self.answers]

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean colour over all rounds."""
        return np.asarray(np.mean([answer["mean"] for answer in self.answers], axis=0))


def load(
    workers: tuple[Worker, Worker], scene: str, roulette: bool, shrink: int, folder: Path, by_cpu: bool
) -> tuple[Side, Side]:
    """Return both sides of a scene, loaded."""
    ours, theirs = workers
    name = f"{scene}{' with roulette' if roulette else ''}"
    width, height = (side // shrink for side in FULL_SIZE[scene])
    folder.mkdir()
    other = reference_scene(THEIRS[scene], shrink=shrink)
    ours.ask(do="load", scene=scene, shrink=shrink, roulette=roulette, **{"as": name})
    theirs.ask(do="load", description=describe(other, roulette=roulette, folder=folder), **{"as": name})
    return Side(ours, name, width * height, by_cpu), Side(theirs, name, width * height, by_cpu)


def difference(scene: str, ours: Side, theirs: Side) -> float:
    """Return by which fraction the mean colours differ; of A_lens, from the reference picture of the tests."""
    expected = np.load(REFERENCE / "A_lens.npz")["mean"] if scene == "A_lens" else theirs.mean
    return float(np.abs(ours.mean / expected - 1).max())


def result(scene: str, roulette: bool, ours: Side, theirs: Side) -> dict[str, Any]:
    """Return everything that was measured of a scene."""
    found: dict[str, Any] = {
        "scene": scene,
        "roulette": roulette,
        "goal": GOAL[scene],
        "mean_difference": difference(scene, ours, theirs),
        "spp": {"ours": ours.spp, "mitsuba": theirs.spp},
    }
    for clock in ("wall", "cpu"):
        rates = {"ours": ours.rates(clock), "mitsuba": theirs.rates(clock)}
        found[clock] = rates | {"ratio": [a / b for a, b in zip(*rates.values(), strict=True)]}
    return found


def table_rows(found: dict[str, Any], clocks: Sequence[str]) -> list[list[str]]:
    """Return the rows of the table for a scene, one per clock."""
    rows = []
    for clock in clocks:
        seen = found[clock]
        ratio = statistics.median(seen["ratio"])
        rows.append(
            [
                found["scene"],
                "both defaults" if found["roulette"] else "off",
                clock,
                *(f"{statistics.median(seen[side]):.2f}" for side in ("ours", "mitsuba")),
                spread(seen["ratio"]),
                f"{found['goal']:g}",
                "yes" if ratio >= found["goal"] else "no",
                f"{100 * found['mean_difference']:.2f} %",
            ]
        )
    return rows


def compare(options: argparse.Namespace, workers: tuple[Worker, Worker], by_cpu: bool) -> list[dict[str, Any]]:
    """Return the results of all scenes, with roulette off and with both defaults."""
    shrink, rounds, seconds = (8, 2, 0.05) if options.quick else (1, options.rounds, options.seconds)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (scene, roulette) in enumerate(itertools.product(options.scenes, (False, True))):
            sides = load(workers, scene, roulette, shrink, Path(folder) / str(number), by_cpu)
            for side in sides:
                side.calibrate(seconds)
            for seed, side in itertools.product(range(1, rounds + 1), sides):
                side.play(seed)
            results.append(result(scene, roulette, *sides))
            print(f"{sides[0].name}: done", file=sys.stderr)
    return results


def parse() -> argparse.Namespace:
    """Return the options of the command line."""
    parser = arguments("Samples per second beside Mitsuba 3.")
    parser.add_argument("--rounds", type=int, default=7, help="pairs of renders per scene (default 7)")
    parser.add_argument("--seconds", type=float, default=1.0, help="length of a render (default 1)")
    parser.add_argument("--scenes", nargs="+", choices=list(GOAL), default=list(GOAL), metavar="SCENE")
    parser.add_argument("--avx2", action="store_true", help="hold both to AVX2, where there is AVX-512")
    parser.add_argument("--mitsuba-python", default=sys.executable, help="interpreter that can import mitsuba")
    return parser.parse_args()


def main() -> int:
    """Run the comparison; the exit code is 1 when pictures disagree and 2 when a renderer is missing."""
    options = parse()
    device = choose_device(options.device)
    try:
        held = ["avx2"] if options.avx2 else []
        theirs = Worker(options.mitsuba_python, "benchmarks.mitsuba_worker", *held)
        ours = Worker(sys.executable, "benchmarks.our_worker", device.id, *held)
        facts = machine(device) | {"ours": ours.description, "mitsuba": theirs.description}
        results = compare(options, (ours, theirs), device.type == "cpu")
    except WorkerError as error:
        print(f"against_mitsuba: {error}", file=sys.stderr)
        return 2
    facts["load_average_after"] = machine(device)["load_average"]
    ours.close()
    theirs.close()
    print_machine(facts)
    clocks = ("wall", "cpu") if device.type == "cpu" else ("wall",)  # a GPU's work is no CPU time
    rows = [row for found in results for row in table_rows(found, clocks)]
    title = f"Millions of samples per second, {cores()} cores; by cpu: {cores()} x samples / CPU seconds"
    print_table(title, COLUMNS, rows)
    write_json(options.json, facts, results)
    allowed = 0.1 if options.quick else MOST_DIFFERENCE  # a quick picture is mostly noise
    apart = [found["scene"] for found in results if found["mean_difference"] > allowed]
    if apart:
        print(f"against_mitsuba: the pictures of {', '.join(apart)} differ: not the same work", file=sys.stderr)
    return 1 if apart else 0


if __name__ == "__main__":
    raise SystemExit(main())
