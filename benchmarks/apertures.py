"""Noise of a smooth wall out of focus through every shape of aperture, by sampler, and what its camera rays cost.

    python -m benchmarks.apertures [--seeds 8] [--json FILE]

Noise is the standard deviation of a pixel over pictures with independent seeds, relative to the mean. The cost is that
of the pass that makes the camera rays: CPU nanoseconds per sample, or device time of a GPU.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from benchmarks import passes
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.samplers import SAMPLERS
from benchmarks.samplers import measure as measure_noise
from benchmarks.scenes import wavefront_of
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

MASK = "mask.png"
SHAPES: dict[str, dict[str, Any]] = {
    "circle": {"shape": "circle"},
    "9 blades": {"shape": "polygon", "blades": 9},
    "9 curved blades": {"shape": "polygon", "blades": 9, "curvature": 0.5},
    "star": {"shape": "star"},
    "heart": {"shape": "heart"},
    "letter L": {"shape": "outline", "points": [[0, 0], [2, 0], [2, 1], [1, 1], [1, 3], [0, 3]]},
    "letter S": {
        "shape": "outline",
        "points": [[0, 0], [3, 0], [3, 3], [1, 3], [1, 4], [3, 4], [3, 5], [0, 5], [0, 2], [2, 2], [2, 1], [0, 1]],
    },
    "mask": {"shape": "image", "file": MASK},
}
CLOUDS = {"kind": "noise", "scale": [6, 6], "octaves": 2, "low": [0.2] * 3, "high": [1.0, 0.8, 0.6]}
WALL = {"shape": "rectangle", "corner": [-25, -25, -20], "edge_u": [50, 0, 0], "edge_v": [0, 50, 0]}
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 40}
SMOOTH = {
    "camera": {**POSE, "kind": "thin_lens", "aperture_radius_m": 0.2, "focus_distance_m": 2.0},
    "objects": [{**WALL, "material": {"kind": "emissive", "radiance": CLOUDS}}],
    "render": {"max_depth": 1},
}


def draw_mask(path: Path) -> None:
    """Write a mask of 256 x 256 pixels: a disc with a hole beside its middle."""
    mask = Image.new("L", (256, 256), 0)
    draw = ImageDraw.Draw(mask)
    draw.ellipse((1, 1, 254, 254), fill=255)
    draw.rectangle((80, 40, 120, 160), fill=0)
    mask.save(path)


def scene(shape: str, size: tuple[int, int], folder: Path) -> Scene:
    """Return the wall through a shape of aperture."""
    return change_scene(
        load_scene(SMOOTH | {"film": {"resolution": list(size)}}, base_dir=folder), camera={"aperture": SHAPES[shape]}
    )


def main() -> None:
    """Measure every shape with every sampler and print the table."""
    parser = arguments("Noise behind shapes of the aperture.")
    parser.add_argument("--seeds", type=int, default=8, help="pictures per measurement (default 8)")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    profiled = Session(choose_device(options.device), profiling=True)
    counts = [4, 16] if options.quick else [16, 64, 256]
    rows, results = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        draw_mask(folder / MASK)
        for shape in SHAPES:
            cells: list[str] = []
            for sampler in SAMPLERS:
                given = change_scene(scene(shape, (48, 32), folder), render={"sampler": sampler})
                found = measure_noise(given, session, counts, options.seeds)
                noise = {spp: float(np.sqrt(variance / spp)) for spp, (variance, _) in found.items()}
                results.append({"shape": shape, "sampler": sampler, "noise": noise})
                cells += [f"{value:.5f}" for value in noise.values()]
            large = scene(shape, (64, 32) if options.quick else (640, 360), folder)
            cost = passes.measure(wavefront_of(large, profiled, organisation="passes"), 0.02 if options.quick else 0.2)
            nanoseconds = cost["shares"]["generate"] * cost["ns_per_sample"]
            results.append({"shape": shape, "camera_ns_per_sample": nanoseconds})
            rows.append([shape, *cells, f"{nanoseconds:.1f}"])
    print_machine(machine(session.info))
    columns = ["shape", *(f"{sampler} {spp}" for sampler in SAMPLERS for spp in counts), "camera ns per sample"]
    print_table("Relative noise by sampler and samples per pixel", columns, rows)
    write_json(options.json, machine(session.info), results)


if __name__ == "__main__":
    main()
