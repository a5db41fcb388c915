"""Noise at equal time beside Mitsuba 3: relative mean squared error of scenes A, A_lens, B, C, D after the same time.

    python -m benchmarks.equal_time [--seconds 20] [--seeds 3] [--mitsuba-python PATH] [--cycles-python PATH]

Every renderer with every sampler renders each scene with several seeds, with the samples per pixel that take it about
``--seconds`` of all cores: by CPU time on a processor, which other work on the machine disturbs less. The error is
that against the other renderer's pictures, which are independent and in two halves, so that their own noise drops out:
mean((x - r1) (x - r2) / (b^2 + (0.01 mean b)^2)). How bright a pixel is, b, all pictures of both renderers say
together: by those of the other one alone, short runs would weigh pixels most whose own noise makes them too dark. It
counts noise and bias, and is scaled to the exact time as 1/t: Mitsuba's stratified samplers round the number of
samples up, so that they get numbers only that they take as they are. Its lens of A_lens and D is that of
`benchmarks.mitsuba_lens`. Beside it stands the noise alone, from the differences between seeds, and the time of all
cores after which that is 5 %, root mean square of the pixels, with as many samples everywhere.

Where light arrives so seldom that short runs miss most of it, all are held to two pictures of ours instead, of
``--reference`` samples a pixel and seeds of their own: else ours would be told wrong by what the other one misses.

With ``--cycles-python`` Blender's Cycles renders, too, with its default sampler; A_lens and D through the shader that
``rptcam camera --osl`` writes. Its error is that against our pictures, and ours goes by Mitsuba's as before. Its time
holds what a call takes at least, 0.1 s: it hands its picture over as a file.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import cycles_scene, mitsuba_scene
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import reference_scene
from benchmarks.stopwatch import cores
from benchmarks.worker import Worker, WorkerError
from rptcam_cl.device.devices import choose_device

GOALS = {"A": 10, "A_lens": 10, "B": 10, "C": 4, "D": 4}  # times less error than Mitsuba with any sampler
OURS = ("lattice", "independent")  # the first is the default
MITSUBAS = ("independent", "multijitter", "ldsampler")
CYCLES = ("default",)
PASS = 16  # samples per pixel that Mitsuba takes at once: more would fill the memory
TARGET = 0.05  # relative noise of a pixel, root mean square
EDGE = 0.01  # of the mean: what keeps dark pixels from counting beyond measure
COLUMNS = (
    "scene", "renderer", "sampler", "spp", "Msamples/s", "relMSE", "noise alone", "variance per sample",
    "times ours", "of that by speed", "by variance", "s to 5 %",
)  # fmt: skip
Pictures = NDArray[np.float64]


@dataclass
class Runs:
    """One renderer with one sampler at one scene."""

    renderer: str
    sampler: str
    spp: int
    seconds: list[float] = field(default_factory=list)
    pictures: list[Pictures] = field(default_factory=list)

    def add(self, answer: dict[str, Any], path: Path, by_cpu: bool) -> None:
        """Take over a render."""
        self.seconds.append(answer["cpu"] / cores() if by_cpu else answer["wall"])
        self.pictures.append(np.load(path).astype(np.float64))


def exact_count(wanted: float, unit: int, taken: Callable[[int], int]) -> int:
    """Return the multiple of ``unit`` nearest to ``wanted`` that a sampler takes as it is.

    Parameters
    ----------
    taken
        The number of samples that the sampler makes of a number.
    """
    nearest = max(round(wanted / unit), 1)
    counts = [unit * k for k in range(1, 4 * nearest + 1)]
    for count in sorted(counts, key=lambda count: abs(count - wanted)):
        if taken(count) == count:
            return count
    raise WorkerError(f"the sampler takes no multiple of {unit} samples up to {4 * nearest * unit}")


class Bench:
    """All workers at one scene."""

    def __init__(self, options: argparse.Namespace, workers: dict[str, Worker], scene: str, folder: Path) -> None:
        self.workers, self.scene, self._folder = workers, scene, folder
        self._by_cpu = choose_device(options.device).type == "cpu"
        self._shrink = 8 if options.quick else 1
        self._seconds = 0.05 if options.quick else options.seconds
        self._roulette = options.roulette
        plain = reference_scene(scene, shrink=self._shrink)
        self.pixels = plain.film.resolution[0] * plain.film.resolution[1]
        self._description = mitsuba_scene.describe(plain, roulette=self._roulette, folder=folder)
        self._description["integrator"]["samples_per_pass"] = PASS
        if "Cycles" in workers:
            description = cycles_scene.describe(plain, roulette=self._roulette, folder=folder)
            workers["Cycles"].ask(do="load", description=description)

    def _render(self, renderer: str, sampler: str, spp: int, seed: int) -> tuple[dict[str, Any], Path]:
        name, path = f"{self.scene} {sampler} {seed}", self._folder / "picture.npy"
        if renderer == "ours":
            how = {"shrink": self._shrink, "roulette": self._roulette, "settings": {"sampler": sampler, "seed": seed}}
            self.workers["ours"].ask(do="load", scene=self.scene, **how, **{"as": name})
            return self.workers["ours"].ask(do="render", spp=spp, save=str(path), forget=True, **{"as": name}), path
        name = f"{self.scene} {sampler}"
        return self.workers[renderer].ask(do="render", spp=spp, seed=seed, save=str(path), **{"as": name}), path

    def _samples(self, renderer: str, sampler: str, wanted: float) -> int:
        if renderer != "Mitsuba":
            return max(round(wanted), 1)

        def taken(count: int) -> int:
            return int(self.workers["Mitsuba"].ask(do="count", sampler=sampler, spp=count)["spp"])

        return exact_count(wanted, PASS, taken)

    def calibrated(self, renderer: str, sampler: str) -> Runs:
        """Return no runs yet, with the samples per pixel that take the time."""
        if renderer == "Mitsuba":
            sensor = self._description["sensor"] | {"sampler": {"type": sampler}}
            description = self._description | {"sensor": sensor}
            self.workers["Mitsuba"].ask(do="load", description=description, **{"as": f"{self.scene} {sampler}"})
        spp = PASS if renderer == "Mitsuba" else 1
        for _ in range(3):
            self._render(renderer, sampler, spp, 0)  # compiles what a number of samples needs
            answer, _ = self._render(renderer, sampler, spp, 0)
            rate = spp / (answer["cpu"] / cores() if self._by_cpu else answer["wall"])
            if spp > rate * self._seconds / 8:
                break
            spp = self._samples(renderer, sampler, rate * min(1.0, self._seconds / 4))
        spp = self._samples(renderer, sampler, rate * self._seconds)
        return Runs(renderer, sampler, spp)

    def reference(self, spp: int) -> Runs:
        """Return two renders of ours that all are held to."""
        runs = Runs("ours", OURS[0], spp)
        for seed in (1001, 1002):
            self.play(runs, seed)
        return runs

    def play(self, runs: Runs, seed: int) -> None:
        """Render once for the record."""
        runs.add(*self._render(runs.renderer, runs.sampler, runs.spp, seed), self._by_cpu)


def brightness(every: list[Runs]) -> Pictures:
    """Return how bright each pixel is, by all pictures and as many samples as each has."""
    samples = [runs.spp * len(runs.pictures) for runs in every]
    return np.average([np.mean(runs.pictures, axis=0) for runs in every], axis=0, weights=samples)


def errors(own: Runs, other: list[Runs], bright: Pictures, seconds: float) -> dict[str, Any]:
    """Return what the errors of some runs are, against the pictures of other ones."""
    every = [picture for runs in other for picture in runs.pictures]
    first, second = (np.mean(every[half::2], axis=0) for half in (0, 1))
    scale = bright**2 + (EDGE * float(bright.mean())) ** 2
    stack = np.array(own.pictures)
    middle = statistics.median(own.seconds)
    per_seed = [float(((x - first) * (x - second) / scale).mean()) for x in stack]
    noise = float((stack.var(axis=0, ddof=1) / scale).mean())
    return {
        "relmse": statistics.median(per_seed) * middle / seconds,
        "relmse_per_seed": per_seed,
        "noise": noise * middle / seconds,
        "seconds_to_target": noise * middle / TARGET**2,
        "variance_per_sample": noise * own.spp,
        "mean_difference": float(np.abs(stack.mean(axis=(0, 1, 2)) / np.mean(every, axis=(0, 1, 2)) - 1).max()),
        "seconds": middle,
        "spp": own.spp,
    }


def measure(bench: Bench, seeds: int, seconds: float, reference: int = 0) -> list[dict[str, Any]]:
    """Return the results of a scene, ours with the default sampler first."""
    sides = [("ours", sampler) for sampler in OURS] + [("Mitsuba", sampler) for sampler in MITSUBAS]
    sides += [("Cycles", sampler) for sampler in CYCLES if "Cycles" in bench.workers]
    every = [bench.calibrated(*side) for side in sides]
    for seed in range(1, seeds + 1):
        for runs in every:
            bench.play(runs, seed)
    found: list[dict[str, Any]] = []
    held_to = [bench.reference(reference)] if reference else []
    bright = brightness(held_to or every)
    for runs in every:
        judge = "Mitsuba" if runs.renderer == "ours" else "ours"
        other = held_to or [each for each in every if each.renderer == judge]
        result: dict[str, Any] = {"scene": bench.scene, "renderer": runs.renderer, "sampler": runs.sampler}
        result |= errors(runs, other, bright, seconds)
        result["msamples_per_second"] = bench.pixels * runs.spp / result["seconds"] / 1e6
        found.append(result)
    for result in found:
        result["times_ours"] = result["relmse"] / found[0]["relmse"]
        result["by_speed"] = found[0]["msamples_per_second"] / result["msamples_per_second"]
        result["by_variance"] = result["variance_per_sample"] / found[0]["variance_per_sample"]
    return found


def row(found: dict[str, Any]) -> list[str]:
    """Return the table row of a result."""
    numbers = (found["relmse"], found["noise"], found["variance_per_sample"])
    ratios = (found["times_ours"], found["by_speed"], found["by_variance"])
    return [
        *(found[key] for key in ("scene", "renderer", "sampler")),
        str(found["spp"]),
        f"{found['msamples_per_second']:.2f}",
        *(f"{number:.3g}" for number in numbers),
        *(f"{ratio:.2f}" for ratio in ratios),
        f"{found['seconds_to_target']:.3g}",
    ]


def main(goals: dict[str, int] = GOALS, title: str = "Noise at equal time beside Mitsuba 3.") -> int:
    """Run the comparison of some scenes; the exit code is 2 when a renderer is missing."""
    parser = arguments(title)
    parser.add_argument("--seconds", type=float, default=20.0, help="time of a render (default 20)")
    parser.add_argument("--seeds", type=int, default=3, help="renders per renderer, sampler and scene (default 3)")
    parser.add_argument("--scenes", nargs="+", choices=list(goals), default=list(goals), metavar="SCENE")
    parser.add_argument("--reference", type=int, default=0, metavar="SPP", help="hold all to pictures of ours")
    parser.add_argument("--roulette", action="store_true", help="with the Russian roulette of both defaults")
    parser.add_argument("--mitsuba-python", default=sys.executable, help="interpreter that can import mitsuba")
    parser.add_argument("--cycles-python", help="interpreter that can import bpy; without it Cycles is left out")
    options = parser.parse_args()
    device = choose_device(options.device)
    workers = {}
    try:
        workers["Mitsuba"] = Worker(options.mitsuba_python, "benchmarks.mitsuba_worker")
        workers["ours"] = Worker(sys.executable, "benchmarks.our_worker", device.id)
        if options.cycles_python:
            workers["Cycles"] = Worker(options.cycles_python, "benchmarks.cycles_worker")
        facts = machine(device) | {name.lower(): worker.description for name, worker in workers.items()}
        results = []
        for scene in options.scenes:
            with tempfile.TemporaryDirectory() as folder:
                bench = Bench(options, workers, scene, Path(folder))
                results += measure(bench, max(options.seeds, 2), options.seconds, options.reference)
            print(f"{scene}: done", file=sys.stderr)
    except WorkerError as error:
        print(f"equal_time: {error}", file=sys.stderr)
        return 2
    for worker in workers.values():
        worker.close()
    print_machine(facts | {"load_average_after": machine(device)["load_average"]})
    title = f"Relative mean squared error after {options.seconds:g} s of {cores()} cores"
    print_table(title, COLUMNS, [row(found) for found in results])
    for scene in options.scenes:
        least = min(x["times_ours"] for x in results if x["scene"] == scene and x["renderer"] == "Mitsuba")
        print(f"{scene}: Mitsuba's best error is {least:.2f} times ours; the goal is {goals[scene]}.")
    write_json(options.json, facts, results)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
