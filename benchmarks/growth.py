"""How samples per second grow or shrink with wave size, resolution, path depth and number of primitives.

    python -m benchmarks.growth [--seconds 0.25] [--json FILE]

One table each. A value is the best of three renders that take about ``--seconds``: by wall time, and by CPU time (all
threads together), which other work on the machine disturbs less. Russian roulette is off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import reference_scene, render_samples, wavefront_of
from benchmarks.stopwatch import cores, fastest, timed
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

Points = Iterator[tuple[str, Wavefront]]
SMALL = 4  # divides width and height where a sample is dear


@dataclass(frozen=True)
class Growth:
    """One table: what grows, in which scene, and its points."""

    title: str
    quantity: str
    points: Callable[[Session, int], Points]


def by_wave_size(session: Session, shrink: int) -> Points:
    """Scene A with waves of 1k to 1M slots."""
    scene = reference_scene("A", shrink=shrink)
    for slots in (1 << power for power in range(10, 21, 2)):
        yield f"{slots}", wavefront_of(scene, session, slots)


def by_resolution(session: Session, shrink: int) -> Points:
    """Scene A from a thumbnail to full high definition."""
    for width, height in ((64, 36), (160, 90), (320, 180), (640, 360), (1280, 720), (1920, 1080)):
        scene = change_scene(reference_scene("A"), film={"resolution": (width // shrink, height // shrink)})
        yield f"{width // shrink} x {height // shrink}", wavefront_of(scene, session)


def by_depth(session: Session, shrink: int) -> Points:
    """The closed Cornell box, where hardly a path ends by itself, with paths of 1 to 32 edges."""
    for depth in (1, 2, 4, 8, 16, 32):
        yield f"{depth}", wavefront_of(reference_scene("B", shrink=SMALL * shrink, max_depth=depth), session)


def by_primitives(session: Session, shrink: int) -> Points:
    """Spheres on a floor that together always fill the same part of the picture."""
    for count in (10, 32, 100, 320, 1000, 3200, 10_000, 100_000):
        yield f"{count}", wavefront_of(spheres(count, SMALL * shrink), session)


def spheres(count: int, shrink: int) -> Scene:
    """Return a scene of ``count`` matte spheres side by side on a floor of 6 x 6 under an even sky."""
    side = math.isqrt(count - 1) + 1
    spacing = 6.0 / side
    radius = 0.45 * spacing
    matte = {"kind": "matte", "reflectance": 0.6}
    floor: dict[str, Any] = {"shape": "rectangle", "corner": [-20, -20, 0], "edge_u": [40, 0, 0], "edge_v": [0, 40, 0]}
    balls: list[dict[str, Any]] = [
        {
            "shape": "sphere",
            "center": [(k % side + 0.5) * spacing - 3, (k // side + 0.5) * spacing - 3, radius],
            "radius": radius,
        }
        for k in range(count)
    ]
    camera = {"kind": "pinhole", "eye": [0, -9.5, 5], "target": [0, 0, 0], "up": [0, 0, 1], "fov_degrees": 40}
    return load_scene(
        {
            "film": {"resolution": [640 // shrink, 360 // shrink]},
            "camera": camera,
            "render": {"max_depth": 8, "roulette_depth": 0},
            "objects": [item | {"material": matte} for item in (floor, *balls)],
            "environment": {"kind": "constant", "radiance": 1.0},
        }
    )


TABLES = (
    Growth("Wave size (scene A)", "slots", by_wave_size),
    Growth("Resolution (scene A)", "pixels", by_resolution),
    Growth("Path depth (scene B, the closed Cornell box, 128 x 128)", "edges", by_depth),
    Growth("Primitives (spheres on a floor, 160 x 90)", "spheres", by_primitives),
)

COLUMNS = {"wall": "Msamples/s by wall", "cpu": "by CPU", "ns_per_sample": "CPU ns per sample"}


def measure(wavefront: Wavefront, seconds: float) -> dict[str, float]:
    """Return millions of samples per second by wall and CPU time, and the CPU time per sample [ns]."""
    least = wavefront.samples_per_wave
    rate = least / timed(lambda: render_samples(wavefront, least)).wall
    spp = least * max(round(rate * seconds / least), 1)
    times = fastest(lambda: render_samples(wavefront, spp), 3)
    samples = spp * wavefront.layout.samples_per_spp
    return {
        "wall": samples / times.wall / 1e6,
        "cpu": cores() * samples / times.cpu / 1e6,
        "ns_per_sample": times.cpu / samples * 1e9,
    }


def main() -> None:
    """Measure every table and print it."""
    parser = arguments("Samples per second against wave size, resolution, depth and primitives.")
    parser.add_argument("--seconds", type=float, default=0.25, help="length of a render (default 0.25)")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    print_machine(facts)
    results: dict[str, Any] = {}
    for growth in TABLES:
        points = islice(growth.points(session, 4), 2) if options.quick else growth.points(session, 1)
        found = {name: measure(wavefront, 0.0 if options.quick else options.seconds) for name, wavefront in points}
        results[growth.quantity] = found
        columns = (growth.quantity, *COLUMNS.values())
        lines = [[name, *(f"{values[key]:.2f}" for key in COLUMNS)] for name, values in found.items()]
        print_table(growth.title, columns, lines)
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
