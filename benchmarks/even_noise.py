"""Seconds until the noise is at most 5 % everywhere: ours with ``--noise`` and without, Mitsuba's and Cycles'.

    python -m benchmarks.even_noise [--scenes A C] [--mitsuba-python PATH] [--cycles-python PATH] [--denoise]

The error is that of ``--noise``: of a tile of 8 x 8 pixels the root mean square error of their luminance over the mean
of the tile; tiles darker than a twentieth of the picture's mean count relative to that. "Everywhere" is in 95 of 100
tiles; beside it stand 99 of 100. Errors are those against two halves of a reference of ours, so that its own noise
drops out. Every way makes pictures of more and more samples until both are met or the next one would take more than
``--seconds``; the time lies on a straight line between two pictures in logarithms. Beyond the last one it is marked ~:
the error then falls with the root of the time. Times are processor seconds of all threads, without compiling.

Mitsuba has its multijitter and ldsampler; its own denoiser runs on NVIDIA's cards alone. ``--denoise`` cleans the
pictures of all by Open Image Denoise, from their colours alone, and counts its time; Cycles cleans some itself besides,
by the same from colours, albedo and normals. Cycles has its adaptive samples with three thresholds, and renders what
`benchmarks.cycles_scene` knows.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import cycles_scene, mitsuba_scene
from benchmarks.hard_light import SCENES as HARD
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import FULL_SIZE, reference_scene
from benchmarks.stopwatch import timed
from benchmarks.worker import Worker, WorkerError
from rptcam_cl.core.colour import luminance
from rptcam_cl.device.devices import choose_device
from rptcam_cl.scene.scene import Scene

MARK = 0.05
SHARES = (0.95, 0.99)  # of the tiles
SCENES = (
    "A", "A_lens", "B", "C", "D", "frosted_shade", "door_ajar", "hidden_uplighter", "metal_floor", "picture_of_light",
    "sun_through_a_window", "sky_through_a_window",
)  # fmt: skip
TILE, DARKEST = 8, 0.05  # as `rptcam_cl.rendering.progressive`
CYCLES = (0.02, 0.01, 0.005)  # thresholds of its noise, of which the second is its default; 0.05 leaves 8 % in A
MITSUBAS = ("multijitter", "ldsampler")
PASS = 64  # samples per pixel that Mitsuba takes at once: a million of them
COLUMNS = (
    "renderer",
    "way",
    "s to 5 %, 95 of 100 tiles",
    "99 of 100",
    "last picture, s",
    "error, 95 of 100",
    "99 of 100",
)
AT_REST = 1.05  # growth of the time with twice the samples, below which Cycles takes no more of them
MOST = 1 << 22  # samples per pixel
Picture = NDArray[np.float64]


@dataclass
class Way:
    """How a picture is made, and what came of it.

    Attributes
    ----------
    cleans : bool
        Whether the renderer itself denoises.
    ended : bool
        Whether the last picture met its own mark of noise before all samples were made.
    made : list of (seconds, (errors of `SHARES`))
        Of pictures with more and more samples.
    """

    renderer: str
    name: str
    noise: float | None = None
    denoised: bool = False
    cleans: bool = False
    ended: bool = False
    made: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)

    def reached(self, share: int) -> tuple[float, bool]:
        """Return the seconds to `MARK`, perhaps without end, and whether pictures lie on both sides of it."""
        known = sorted((seconds, errors[share]) for seconds, errors in self.made)
        for (before, above), (after, below) in pairwise(known):
            if above > MARK >= below:
                part = math.log(above / MARK) / math.log(above / below)
                return before * (after / before) ** part, True
        seconds, error = known[0] if known[0][1] <= MARK else known[-1]
        if self.ended and error > MARK:
            return math.inf, False
        return seconds * (error / MARK) ** 2, False


def tile_errors(picture: Picture, halves: tuple[Picture, Picture]) -> Picture:
    """Return the errors of all whole tiles."""
    rows, columns = (size // TILE for size in picture.shape[:2])

    def means(values: Picture) -> Picture:
        inside = values[: rows * TILE, : columns * TILE]
        return inside.reshape(rows, TILE, columns, TILE).mean(axis=(1, 3))

    seen, first, second = (luminance(each) for each in (picture, *halves))
    bright = means((first + second) / 2)
    square = means((seen - first) * (seen - second))
    return np.sqrt(np.maximum(square, 0)) / np.maximum(bright, DARKEST * bright.mean())


class Bench:
    """All workers at one scene."""

    def __init__(self, options: argparse.Namespace, workers: dict[str, Worker], scene: str, folder: Path) -> None:
        self._workers, self._scene, self._folder = workers, scene, folder
        self._shrink = 8 if options.quick else 4 if scene in FULL_SIZE else 2
        self._limit = 0.05 if options.quick else options.seconds
        self._seeds = 1 if options.quick else options.seeds
        self._denoises = options.denoise
        plain = reference_scene(scene, shrink=self._shrink, roulette=True)
        description = mitsuba_scene.describe(plain, roulette=True, folder=folder)
        for sampler in MITSUBAS if "Mitsuba" in workers else ():
            description["integrator"]["samples_per_pass"] = PASS
            described = description | {"sensor": description["sensor"] | {"sampler": {"type": sampler}}}
            workers["Mitsuba"].ask(do="load", description=described, **{"as": f"{scene} {sampler}"})
        self.has_cycles = "Cycles" in workers and _is_for_cycles(plain)
        if self.has_cycles:
            workers["Cycles"].ask(do="load", description=cycles_scene.describe(plain, roulette=True, folder=folder))
        self._halves = self._reference(options)

    def _render(self, way: Way, spp: int, seed: int) -> tuple[dict[str, Any], Picture]:
        path, worker = self._folder / "picture.npy", self._workers[way.renderer]
        label = self._scene if way.renderer == "ours" else f"{self._scene} {way.name}"
        more: dict[str, Any] = {"denoise": True} if way.cleans else {}
        more |= {} if way.noise is None else {"noise": way.noise}
        answer = worker.ask(do="render", spp=spp, seed=seed, save=str(path), **more, **{"as": label})
        return answer, np.load(path).astype(np.float64)

    def _reference(self, options: argparse.Namespace) -> tuple[Picture, Picture]:
        self._workers["ours"].ask(
            do="load", scene=self._scene, shrink=self._shrink, roulette=True, **{"as": self._scene}
        )
        way, seconds = Way("ours", "reference"), 0.1 if options.quick else options.reference
        self._render(way, 8, 1)
        answer, _ = self._render(way, 64, 1)
        spp = max(round(64 * seconds / answer["cpu"]), 64)
        return self._render(way, spp, 1001)[1], self._render(way, spp, 1002)[1]

    def _steps(self, way: Way) -> Iterator[int]:
        """Yield the samples per pixel of the next picture until the last one has met the mark or took too long."""
        spp, times = {"ours": 2, "Mitsuba": 16, "Cycles": 2}[way.renderer], 4
        if way.noise is not None:
            spp, times = 64, 2
        while spp <= MOST:
            if spp <= 4 * PASS and (way.renderer != "Cycles" or not way.made):
                self._render(way, spp, 0)  # compiles what a number of samples needs
            yield spp
            seconds, errors = way.made[-1]
            if max(errors) <= MARK or times * seconds > self._limit or way.ended:
                return
            spp *= times

    def measure(self, way: Way) -> list[Way]:
        """Fill in a way; return it, and the same denoised."""
        ways = [way] + [Way(way.renderer, way.name, way.noise, True)] * (self._denoises and not way.cleans)
        for spp in self._steps(way):
            found = [self._errors(way, spp, seed) for seed in range(1, self._seeds + 1)]
            for each, made in zip(ways, zip(*found, strict=True), strict=True):
                seconds = float(np.mean([one for one, _ in made]))
                each.made.append((seconds, tuple(np.mean([errors for _, errors in made], axis=0).tolist())))
                each.ended = way.ended
        return ways

    def _errors(self, way: Way, spp: int, seed: int) -> list[tuple[float, tuple[float, ...]]]:
        """Return seconds and errors of a picture, and of the same denoised."""
        answer, picture = self._render(way, spp, seed)
        seconds = answer["cpu"]
        grown = seconds / way.made[-1][0] if way.noise is not None and way.made else math.inf
        way.ended = answer["spp"] < spp if "spp" in answer else grown < AT_REST
        pictures = [(seconds, picture)]
        if self._denoises and not way.cleans:
            cleaned: list[Picture] = []
            times = timed(lambda: cleaned.append(denoised(picture)))
            pictures.append((seconds + times.cpu, cleaned[0]))
        return [(taken, tuple(np.quantile(tile_errors(each, self._halves), SHARES))) for taken, each in pictures]


def _is_for_cycles(scene: Scene) -> bool:
    """Return whether `cycles_scene` knows all of a scene."""
    materials = [item.material for item in scene.objects]
    has_media = scene.medium is not None or any(getattr(each, "interior", None) is not None for each in materials)
    lights = {light.kind for light in scene.lights}
    return not has_media and lights <= {"directional"} and all(each.kind != "plastic" for each in materials)


def denoised(picture: Picture) -> Picture:
    """Return a picture as Open Image Denoise cleans it, by its colours alone."""
    import pyoidn

    clean: Picture = pyoidn.denoise(picture.astype(np.float32), hdr=True, quality="high").astype(np.float64)
    return clean


def shown(seconds: float, is_between: bool) -> str:
    """Return a time as the table has it."""
    if math.isinf(seconds):
        return "never"
    return ("" if is_between else "~") + f"{seconds:.3g}"


def row(way: Way) -> list[str]:
    """Return the table row of a way: seconds to both marks, and the last picture."""
    seconds, errors = way.made[-1]
    name = way.name + ", denoised" * way.denoised
    last = [f"{seconds:.3g}", *(f"{100 * error:.1f} %" for error in errors)]
    return [way.renderer, name, *(shown(*way.reached(share)) for share in range(len(SHARES))), *last]


def ways_of(workers: dict[str, Worker], has_cycles: bool, denoises: bool) -> Iterator[Way]:
    """Yield what is compared."""
    yield Way("ours", "even samples")
    yield Way("ours", "--noise 0.05", MARK)
    if "Mitsuba" in workers:
        for sampler in MITSUBAS:
            yield Way("Mitsuba", sampler)
    if has_cycles:
        yield Way("Cycles", "even samples")
        for threshold in CYCLES:
            yield Way("Cycles", f"adaptive {threshold:g}", threshold)
    if has_cycles and denoises:
        yield Way("Cycles", "even samples, its denoiser", cleans=True)


def main() -> int:
    """Run the comparison; the exit code is 2 when a renderer is missing."""
    parser = arguments("Seconds to 5 % everywhere.")
    parser.add_argument("--seconds", type=float, default=20.0, help="most of a picture [CPU s] (default 20)")
    parser.add_argument("--reference", type=float, default=20.0, help="of each half of the reference (default 20)")
    parser.add_argument("--seeds", type=int, default=2, help="pictures of each number of samples (default 2)")
    parser.add_argument("--scenes", nargs="+", choices=[*FULL_SIZE, *HARD], default=list(SCENES), metavar="SCENE")
    parser.add_argument("--denoise", action="store_true", help="the pictures of all by Open Image Denoise, too")
    parser.add_argument("--mitsuba-python", default=sys.executable, help="interpreter that can import mitsuba")
    parser.add_argument("--cycles-python", help="interpreter that can import bpy; without it Cycles is left out")
    options = parser.parse_args()
    device = choose_device(options.device)
    workers, results = {}, []
    try:
        workers["ours"] = Worker(sys.executable, "benchmarks.our_worker", device.id)
        workers["Mitsuba"] = Worker(options.mitsuba_python, "benchmarks.mitsuba_worker")
        if options.cycles_python:
            workers["Cycles"] = Worker(options.cycles_python, "benchmarks.cycles_worker")
        facts = machine(device) | {name.lower(): worker.description for name, worker in workers.items()}
        print_machine(facts)
        for scene in options.scenes:
            with tempfile.TemporaryDirectory() as folder:
                bench = Bench(options, workers, scene, Path(folder))
                wanted = ways_of(workers, bench.has_cycles, options.denoise)
                ways = [each for way in wanted for each in bench.measure(way)]
            print_table(scene, COLUMNS, [row(way) for way in ways])
            results += [{"scene": scene, **vars(way)} for way in ways]
    except WorkerError as error:
        print(f"even_noise: {error}", file=sys.stderr)
        return 2
    for worker in workers.values():
        worker.close()
    write_json(options.json, facts | {"load_average_after": machine(device)["load_average"]}, results)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
