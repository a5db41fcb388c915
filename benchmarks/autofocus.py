"""Autofocus in random cases: how often each method ends in focus, how far from it, and what it costs.

    python -m benchmarks.autofocus [--cases 200] [--methods contrast,laplacian] [--quick] [--json FILE]

A case is a lens, an aperture, a target at a distance with a texture of some contrast, a zone and a state to start from.
A method succeeds when the target is sharp in the end: the state lies within half of the depth of focus, 2 N c, of the
least spot of exact rays in float64. Every tenth target is blank, and is to be refused. The brute force is that of the
CS348b assignment of 2015: 256 samples per pixel of the zone at every depth of focus over the reach of the lens.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.controller import search
from rptcam_cl.studies.focus.probe import NoContrast, Policy, Zone
from rptcam_cl.studies.focus.renderer import ProbeRenderer, Task

SEEKING = ("contrast", "laplacian", "phase", "hybrid", "depth")
BRUTE_SPP = 256
SHARP = 0.5  # depths of focus
LENSES: dict[str, tuple[float, tuple[float | None, ...]]] = {  # focal length [mm] and apertures
    "dgauss-50mm": (50, (2.2, 2.8, 4, 8)),
    "wide-22mm": (22, (2.8, 4)),
    "telephoto-250mm": (250, (5.6, 8)),
    "achromat-100mm": (100, (None,)),
    "plano-convex-100mm": (100, (None,)),
    "tessar-100mm": (100, (4.5, 8)),
    "double-gauss-50mm-f1.8": (50, (2, 4)),
    "thin lens": (50, (1.4, 2.8, 5.6)),
}
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
FILM = {"resolution": [640, 427], "size_mm": [36, 24]}
BLANK_EVERY = 10


@dataclass(frozen=True)
class Case:
    """A scene to focus on, its zone, the distance of its target [m] and where to start, from 0 (far) to 1 (near)."""

    scene: Scene
    zone: Zone
    distance_m: float
    start: float
    blank: bool
    words: str


def random_case(number: int) -> Case:
    """Return a case; the same for the same number."""
    rng = np.random.default_rng(number)
    lens = str(rng.choice(list(LENSES)))
    focal_length, apertures = LENSES[lens]
    f_number = apertures[rng.integers(len(apertures))]
    distance = float(focal_length * 1e-3 * np.exp(rng.uniform(np.log(15), np.log(300))))
    blank = number % BLANK_EVERY == BLANK_EVERY - 1
    contrast = 0.0 if blank else float(rng.choice([0.9, 0.5, 0.25]))
    x, y = rng.uniform(0.2, 0.74), rng.uniform(0.2, 0.72)
    camera: dict[str, Any] = {"kind": "realistic", "lens": lens, "focus": {"distance_m": 3 * distance}, **POSE}
    if lens == "thin lens":
        camera = {"kind": "thin_lens", "focal_length_mm": focal_length, "focus_distance_m": 3 * distance, **POSE}
    if f_number is not None:
        camera["f_number"] = f_number
    scene = load_scene(
        {
            "film": FILM,
            "camera": camera,
            "render": {"max_depth": 3},
            "environment": {"kind": "constant", "radiance": 1.0},
            "objects": [_target(rng, distance, focal_length, contrast)],
        }
    )
    words = f"{lens}, f/{f_number or 'open'}, {distance:.3g} m, contrast {contrast:g}"
    return Case(scene, Zone(x, x + 0.06, y, y + 0.08), distance, float(rng.uniform(0, 1)) ** 3, blank, words)


def _target(rng: np.random.Generator, distance: float, focal_length: float, contrast: float) -> dict[str, Any]:
    """Return a square across the picture with spots or a chess board of 0.2 to 1 mm on the film."""
    half = distance * 30 / focal_length
    cells = 60 / float(np.exp(rng.uniform(np.log(0.2), np.log(1.0))))
    low, high = 0.5 * (1 - contrast), 0.5 * (1 + contrast)
    reflectance: Any = {"kind": "noise", "low": low, "high": high, "scale": [cells, cells], "octaves": 2}
    if rng.random() < 0.3:
        reflectance = {"kind": "checker", "even": low, "odd": high, "scale": [cells, 0.83 * cells]}
    return {
        "shape": "rectangle",
        "corner": [-half, -half, -distance],
        "edge_u": [2 * half, 0, 0],
        "edge_v": [0, 2 * half, 0],
        "material": {"kind": "matte", "reflectance": 0.5 if contrast == 0 else reflectance},
    }


def outcome(case: Case, method: str, session: Session) -> dict[str, Any]:
    """Return how a method ends in a case."""
    probe = ProbeRenderer(case.scene, session)
    low, high = (probe.drive.coordinate(limit) for limit in probe.drive.limits)
    far, near = (low, high) if probe.drive.nearer > 0 else (high, low)
    probe.state = probe.drive.state_at(far + case.start * (near - far))
    begun, used = time.perf_counter(), time.process_time()
    found: dict[str, Any] = {"case": case.words, "method": method, "blank": case.blank, "reason": "", "miss": math.nan}
    try:
        report = search(Task(probe, (case.zone,), Policy.CLOSEST, 1), method)
        best = probe.drive.coordinate(probe.drive.state_for(case.distance_m, case.zone))
        found["miss"] = abs(probe.drive.coordinate(report.state) - best) / probe.drive.depth_of_focus
        found["probes"] = len(report.probes)
    except (NoContrast, InputError) as problem:
        found["reason"] = str(problem)
    seconds, cpu = time.perf_counter() - begun, time.process_time() - used
    good = (method == "depth" or bool(found["reason"])) if case.blank else found["miss"] <= SHARP
    return found | {"seconds": seconds, "cpu_seconds": cpu, "samples": probe.samples, "good": good}


def brute_force(case: Case, session: Session) -> dict[str, float]:
    """Return the probes and samples of a full sweep, and how long it takes by that of one probe [s]."""
    probe = ProbeRenderer(case.scene, session)
    low, high = (probe.drive.coordinate(limit) for limit in probe.drive.limits)
    probes = math.ceil(abs(high - low) / probe.drive.depth_of_focus)
    probe.measure(probe.state, [case.zone], BRUTE_SPP, 1)
    samples, begun = probe.samples, time.perf_counter()
    probe.measure(probe.state, [case.zone], BRUTE_SPP, 2)
    seconds = time.perf_counter() - begun
    return {"probes": probes, "samples": probes * float(probe.samples - samples), "seconds": probes * seconds}


def wilson(good: int, count: int, z: float = 1.96) -> tuple[float, float]:
    """Return the interval of a success rate that 95 % of such experiments hold (Wilson 1927)."""
    if count == 0:
        return 0.0, 1.0
    share, more = good / count, z * z / count
    middle, half = share + more / 2, z * math.sqrt(share * (1 - share) / count + more / (4 * count))
    return (middle - half) / (1 + more), (middle + half) / (1 + more)


def summary(found: list[dict[str, Any]], method: str, *, blank: bool) -> list[str]:
    """Return a row of the table of success."""
    rows = [row for row in found if row["method"] == method and row["blank"] == blank]
    good = sum(row["good"] for row in rows)
    low, high = wilson(good, len(rows))
    misses: NDArray[np.float64] = np.array([row["miss"] for row in rows if row["good"] and not blank])
    middle = f"{np.median(misses):.3f}" if len(misses) else ""
    share = f"{good / max(len(rows), 1):.1%}"
    kind = "refused" if blank else "in focus"
    return [method, kind, str(len(rows)), share, f"{low:.1%} to {high:.1%}", middle]


def cost(found: list[dict[str, Any]], method: str) -> list[str]:
    """Return a row of the table of costs."""
    rows = [row for row in found if row["method"] == method and not row["blank"] and row["good"]]
    if not rows:
        return [method, "", "", "", ""]
    probes, samples, seconds, cpu = (
        np.array([row[key] for row in rows]) for key in ("probes", "samples", "seconds", "cpu_seconds")
    )
    return [
        method, f"{np.median(probes):.0f} (at most {probes.max()})", f"{np.median(samples) / 1e6:.2f}",
        f"{np.median(seconds):.2f} (at most {seconds.max():.2f})", f"{np.median(cpu):.2f}",
    ]  # fmt: skip


def main() -> None:
    """Run the cases and print the tables."""
    parser = arguments("Autofocus in random cases.")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--methods", default=",".join(SEEKING), help="several with commas between them")
    given = parser.parse_args()
    methods = given.methods.split(",")
    session = Session(choose_device(given.device))
    begun_on = machine(session.info)
    cases = [random_case(number) for number in range(12 if given.quick else given.cases)]
    found = [outcome(case, method, session) for case in cases for method in methods]
    swept = [brute_force(case, session) for case in cases[:4]]
    print_machine(begun_on)
    rows = [summary(found, method, blank=False) for method in methods]
    rows += [summary(found, method, blank=True) for method in methods if method != "depth"]  # which needs no texture
    print_table("Success", ["method", "wanted", "cases", "share", "95 % interval", "median miss / 2 N c"], rows)
    costs = [cost(found, method) for method in methods]
    keys = ("probes", "samples", "seconds")
    probes, samples, seconds = (float(np.median([one[key] for one in swept])) for key in keys)
    costs.append(["brute force", f"{probes:.0f}", f"{samples / 1e6:.0f}", f"{seconds:.0f}", ""])
    print_table("Cost", ["method", "probes", "Msamples", "seconds", "CPU seconds"], costs)
    for row in found:
        if not row["good"] and row["method"] != "depth":
            print(f"{row['method']}: {row['case']}: {row['reason'] or format(row['miss'], '.2f') + ' depths of focus'}")
    write_json(given.json, begun_on, {"outcomes": found, "brute_force": swept})


if __name__ == "__main__":
    main()
