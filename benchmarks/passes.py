"""Share of the time per pass, from OpenCL's profiling events, what a sample costs in it, and by pupil of the lens.

    python -m benchmarks.passes [--seconds 0.4] [--json FILE]

Both organisations of the work are profiled, whichever the device prefers. On a processor the cost is its CPU time (all
threads together) in nanoseconds per sample, divided among the passes by their shares; on a GPU, the device's time.
"""

from __future__ import annotations

import itertools
from typing import Any

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import MEANING, reference_scene, render_samples, wavefront_of
from benchmarks.stopwatch import cores, timed
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import change_scene

SCENES = ("A", "A_lens", "B", "C")
PUPILS = ("rear", "thick", "bounds", "tight")
# Throw-away prototypes, measured before this program was written on two Zen 3 cores with PoCL 3.0: paths of depth 8
# among three spheres, as 8-lane streams and as waves of passes; rays through the eleven surfaces of the double Gauss.
PROTOTYPE = "prototype: three spheres as 8-lane streams 24, as waves of passes 44; rays through the lens alone 19"
PROTOTYPE_PATHS = {"stream": 24.0, "passes": 44.0}
PROTOTYPE_LENS = 19.0


def measure(wavefront: Wavefront, seconds: float) -> dict[str, Any]:
    """Return the time per sample [ns] and each pass's share of it; the least of three renders."""
    spp = wavefront.samples_per_wave
    rate = spp / timed(lambda: render_samples(wavefront, spp)).wall
    spp *= max(round(rate * seconds / spp), 1)
    return min((_measure_once(wavefront, spp) for _ in range(3)), key=lambda found: found["ns_per_sample"])


def _measure_once(wavefront: Wavefront, spp: int) -> dict[str, Any]:
    wavefront.clear()
    times = timed(lambda: render_samples(wavefront, spp))
    device_time = sum(wavefront.passes.values())
    samples = spp * wavefront.layout.samples_per_spp
    spent = times.cpu if wavefront.session.info.type == "cpu" else device_time
    return {
        "ns_per_sample": spent / samples * 1e9,
        "msamples_per_second": samples / times.wall / 1e6,
        "busy": device_time / times.wall,
        "shares": {name: time / device_time for name, time in wavefront.passes.items()},
    }


def prototype(scene: str, organisation: str, name: str) -> float | None:
    """Return what the prototype needed for a pass, or for the total [ns per sample]; None if it had no such thing."""
    if scene in ("B", "C"):
        return None
    lens = PROTOTYPE_LENS if scene == "A_lens" else 0.0
    if name == "total":
        return PROTOTYPE_PATHS[organisation] + lens
    if name == "stream":
        return PROTOTYPE_PATHS[organisation]
    return lens or None if name == "generate" else None


def rows(scene: str, organisation: str, found: dict[str, Any]) -> list[list[str]]:
    """Return the table rows of one measurement: its passes and their total."""
    total = found["ns_per_sample"]
    parts = [*((name, share) for name, share in found["shares"].items()), ("total", 1.0)]
    lines = []
    for name, share in parts:
        expected = prototype(scene, organisation, name)
        shown = "-" if expected is None else f"{expected:g}"
        lines.append([scene, organisation, name, f"{100 * share:.1f} %", f"{share * total:.1f}", shown])
    return lines


def pupils(session: Session, shrink: int, seconds: float) -> dict[str, dict[str, float]]:
    """Return, per way to sample the exit pupil, what a sample of A_lens costs [ns] and which share passes the lens."""
    found = {}
    for pupil in PUPILS:
        scene = change_scene(reference_scene("A_lens", shrink=shrink), camera={"pupil": pupil})
        wavefront = wavefront_of(scene, session)
        cost = measure(wavefront, seconds)["ns_per_sample"]
        outcomes = wavefront.outcomes()
        passed = outcomes["passed"] / sum(outcomes.values())
        found[pupil] = {"ns_per_sample": cost, "passed": passed, "ns_per_passing_sample": cost / passed}
    return found


def main() -> None:
    """Measure all scenes and pupils and print the tables."""
    parser = arguments("Share of the time per pass.")
    parser.add_argument("--seconds", type=float, default=0.4, help="length of a render (default 0.4)")
    options = parser.parse_args()
    session = Session(choose_device(options.device), profiling=True)
    facts = machine(session.info)
    results, lines = [], []
    shrink, seconds = (8, 0.02) if options.quick else (1, options.seconds)
    for scene, organisation in itertools.product(SCENES, ("stream", "passes")):
        wavefront = wavefront_of(reference_scene(scene, shrink=shrink), session, organisation=organisation)
        found = measure(wavefront, seconds)
        results.append({"scene": scene, "organisation": organisation, **found})
        lines += rows(scene, organisation, found)
    print_machine(facts)
    unit = f"CPU time of {cores()} cores" if session.info.type == "cpu" else "device time"
    columns = ("scene", "organisation", "pass", "share", "ns per sample", "prototype")
    print_table(f"Passes, {unit}, Russian roulette off", columns, lines)
    print(*(f"{name}: {MEANING[name]}" for name in SCENES), sep="\n")
    print(PROTOTYPE, end="\n\n")
    tiers = pupils(session, shrink, seconds)
    print_table(
        f"Ways to sample the pupil, scene A_lens, {unit}",
        ("pupil", "ns per sample", "rays that pass", "ns per passing sample"),
        [
            [name, f"{x['ns_per_sample']:.1f}", f"{100 * x['passed']:.1f} %", f"{x['ns_per_passing_sample']:.1f}"]
            for name, x in tiers.items()
        ],
    )
    write_json(options.json, facts, {"passes": results, "pupils": tiers})


if __name__ == "__main__":
    main()
