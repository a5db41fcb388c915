"""How long the first picture takes: the demo scene at one sample per pixel in fresh processes, cold and warm.

    python -m benchmarks.startup [--times 3] [--json FILE]

Cold means that all caches (PoCL's of compiled kernels, and the program's own) are empty folders; warm means that the
same scene was rendered before; resident means that a process stays, which runs the command (``RPTCAM_RESIDENT``, on
Linux). Times are of the whole command, from its start to its end. What the resident process forks is no child of the
command, so that its row has no CPU time.
"""

from __future__ import annotations

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
from rptcam_cl.core.resident import VARIABLE
from rptcam_cl.device.devices import choose_device

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "examples" / "first_light.yaml"
GOAL = {"cold": 1.2, "warm": 0.5, "resident": 0.5}
COLUMNS = ("start", "total, s", "CPU, s", "goal, s", "met")


def first_picture(cache: Path, device: str, size: str | None, minutes: str = "") -> dict[str, float]:
    """Render the scene in a fresh process that keeps compiled kernels in ``cache``; return its times [s].

    With ``minutes`` a process stays for so long, which runs the command where it is there already.
    """
    command = [sys.executable, "-m", "rptcam_cl", "render", str(SCENE), "--spp", "1", "--device", device, "--quiet"]
    command += ["-o", str(cache / "picture.png"), *(["--size", size] if size else [])]
    folders = {"POCL_CACHE_DIR": str(cache / "pocl"), "RPTCAM_CACHE_DIR": str(cache / "own")}
    folders |= {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(ROOT / "build" / "startup")}  # as installed
    stays = {VARIABLE: minutes, "XDG_RUNTIME_DIR": str(cache)}
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, cwd=ROOT, env=os.environ | folders | stays, check=True, stdout=subprocess.DEVNULL)
    total, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    if minutes:
        return {"total": total}
    return {"total": total, "cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime}


def by_resident(cache: Path, device: str, size: str | None) -> dict[str, float]:
    """Render the scene by a process that an earlier command has left, and end that; return the times [s]."""
    first_picture(cache, device, size, "1")
    end = time.monotonic() + 60.0
    while not any("." not in socket.name for socket in cache.glob("rptcam-*/*")):  # it imports first
        assert time.monotonic() < end, "no process stays"
        time.sleep(0.05)
    try:
        return first_picture(cache, device, size, "1")
    finally:
        command = [sys.executable, "-m", "rptcam_cl", "resident", "--stop"]
        environment = os.environ | {"XDG_RUNTIME_DIR": str(cache)}
        subprocess.run(command, cwd=ROOT, env=environment, check=True, stdout=subprocess.DEVNULL)


def row(name: str, runs: list[dict[str, float]]) -> list[str]:
    """Return the table row of some runs: the median of each time."""
    middle = {key: statistics.median(run[key] for run in runs) for key in runs[0]}
    met = "yes" if middle["total"] < GOAL[name] else "no"
    times = (f"{middle[key]:.2f}" if key in middle else "" for key in ("total", "cpu"))
    return [name, *times, f"{GOAL[name]:g}", met]


def main() -> None:
    """Run starts of each kind in turns and print the table."""
    parser = arguments("Cold, warm and resident start of the demo scene.")
    parser.add_argument("--times", type=int, default=3, help="starts of each kind (default 3)")
    options = parser.parse_args()
    device = choose_device(options.device)
    facts: dict[str, Any] = machine(device)
    print_machine(facts)
    ways = {"cold": first_picture, "warm": first_picture}
    if sys.platform == "linux":
        ways["resident"] = by_resident
    found: dict[str, list[dict[str, float]]] = {name: [] for name in ways}
    size = "64x36" if options.quick else None
    for _ in range(1 if options.quick else options.times):
        with tempfile.TemporaryDirectory() as cache:
            for name, way in ways.items():
                found[name].append(way(Path(cache), device.id, size))
    title = f"First picture of {SCENE.name}, median of {len(found['cold'])}"
    print_table(title, COLUMNS, [row(name, runs) for name, runs in found.items()])
    write_json(options.json, facts, found)


if __name__ == "__main__":
    main()
