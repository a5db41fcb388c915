"""How long the first picture takes: the demo scene at one sample per pixel in fresh processes, cold and warm.

    python -m benchmarks.startup [--times 3] [--json FILE]

Cold means that all caches (PoCL's of compiled kernels, and the program's own) are empty folders; warm means that the
same scene was rendered before. ``total`` is the whole process, from its start to its end; ``compile`` is the program's
own figure.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.device.devices import choose_device

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "examples" / "first_light.yaml"
GOAL = {"cold": 1.2, "warm": 0.5}
COLUMNS = ("start", "total, s", "CPU, s", "compile, s", "render, s", "goal, s", "met")


def first_picture(cache: Path, device: str, size: str | None) -> dict[str, float]:
    """Render the scene in a fresh process that keeps compiled kernels in ``cache``; return its times [s]."""
    stats = cache / "stats.json"
    command = [sys.executable, "-m", "rptcam_cl", "render", str(SCENE), "--spp", "1", "--device", device, "--quiet"]
    command += ["-o", str(cache / "picture.png"), "--stats", str(stats), *(["--size", size] if size else [])]
    folders = {"POCL_CACHE_DIR": str(cache / "pocl"), "RPTCAM_CACHE_DIR": str(cache / "own")}
    folders |= {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(ROOT / "build" / "startup")}  # as installed
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, cwd=ROOT, env=os.environ | folders, check=True, stdout=subprocess.DEVNULL)
    total, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = json.loads(stats.read_text(encoding="utf-8"))["seconds"]
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"total": total, "cpu": cpu, "compile": seconds["compile"], "render": seconds["render"]}


def row(name: str, runs: list[dict[str, float]]) -> list[str]:
    """Return the table row of some runs: the median of each time."""
    middle = {key: statistics.median(run[key] for run in runs) for key in runs[0]}
    met = "yes" if middle["total"] < GOAL[name] else "no"
    return [name, *(f"{value:.2f}" for value in middle.values()), f"{GOAL[name]:g}", met]


def main() -> None:
    """Run cold and warm starts in turns and print the table."""
    parser = arguments("Cold and warm start of the demo scene.")
    parser.add_argument("--times", type=int, default=3, help="cold and warm starts each (default 3)")
    options = parser.parse_args()
    device = choose_device(options.device)
    facts: dict[str, Any] = machine(device)
    print_machine(facts)
    found: dict[str, list[dict[str, float]]] = {"cold": [], "warm": []}
    size = "64x36" if options.quick else None
    for _ in range(1 if options.quick else options.times):
        with tempfile.TemporaryDirectory() as cache:
            for runs in found.values():
                runs.append(first_picture(Path(cache), device.id, size))
    title = f"First picture of {SCENE.name}, median of {len(found['cold'])}"
    print_table(title, COLUMNS, [row(name, runs) for name, runs in found.items()])
    write_json(options.json, facts, found)


if __name__ == "__main__":
    main()
