"""Noise of direct light from lamps of every shape, from many lamps, and from a sky with a small sun.

    python -m benchmarks.lamps [--seeds 8] [--spp 64] [--sampler NAME] [--scenes NAME ...] [--json FILE]

Relative variance per sample as in `benchmarks.samplers`, the time per sample, and the product of both: the noise after
the same time. Run it on two checkouts to compare them.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.samplers import SAMPLERS, measure
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from tests.rendering.light.pictures import save_exr

GREY = {"kind": "matte", "reflectance": 0.7}
FLOOR = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": GREY}
BALL = {"shape": "sphere", "center": [0, 0, 0.5], "radius": 0.5, "material": GREY}
CAMERA = {"kind": "pinhole", "fov_degrees": 40, "eye": [0, -4, 2.5], "target": [0, 0, 0.3], "up": [0, 0, 1]}
TURN = [{"rotate": {"axis": [1, 2, 0], "degrees": 50}}, {"translate": [-0.6, -0.3, 1.8]}]
SOFTBOXES: dict[str, dict[str, Any]] = {
    "box": {"shape": "box", "min": [-0.4, -0.3, -0.05], "max": [0.4, 0.3, 0.05]},
    "cone": {"shape": "cone", "base": [0, 0, 0], "apex": [0, 0, 0.5], "radius": 0.3},
    "ellipsoid": {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "scale": [0.5, 0.2, 0.1]},
    "tube": {"shape": "cylinder", "base": [-0.6, 0, 0], "top": [0.6, 0, 0], "radius": 0.03},
}


def softbox(shape: str) -> list[dict[str, Any]]:
    """Return a lamp of a shape over a floor with a ball."""
    keys = dict(SOFTBOXES[shape])
    transform = [{"scale": keys.pop("scale")}, *TURN] if "scale" in keys else TURN
    return [FLOOR, BALL, {**keys, "material": {"kind": "emissive", "radiance": 10.0}, "transform": transform}]


def room() -> list[dict[str, Any]]:
    """Return a room of 4 m with a window of 1.5 m on the left."""

    def wall(*numbers: float) -> dict[str, Any]:
        corner, u, v = (list(numbers[k : k + 3]) for k in (0, 3, 6))
        return {"shape": "rectangle", "corner": corner, "edge_u": u, "edge_v": v, "material": GREY}

    around = [wall(-2, 2, 0, 4, 0, 0, 0, 0, 3), wall(2, -2, 0, 0, 4, 0, 0, 0, 3), wall(-2, -2, 3, 4, 0, 0, 0, 4, 0)]
    beside = [wall(-2, -2, 0, 0, 1, 0, 0, 0, 3), wall(-2, 0.5, 0, 0, 1.5, 0, 0, 0, 3)]
    above = [wall(-2, -1, 0, 0, 1.5, 0, 0, 0, 0.8), wall(-2, -1, 2.3, 0, 1.5, 0, 0, 0, 0.7)]
    return [FLOOR, BALL, *around, *beside, *above, wall(-2, -2, 0, 4, 0, 0, 0, 0, 3)]


def ceiling(across: int) -> list[dict[str, Any]]:
    """Return across x across lamps of uneven power over a hall of 12 m with a row of balls."""
    shine = np.random.default_rng(7).lognormal(0.0, 0.7, across**2)
    pitch, lamps = 12 / across, []
    for index, radiance in enumerate(shine):
        x, y = pitch * (index % across + 0.5) - 6, pitch * (index // across + 0.5) - 6
        side = 0.1 * pitch
        edges = {"corner": [x, y, 2.5], "edge_u": [0, side, 0], "edge_v": [side, 0, 0]}
        material = {"kind": "emissive", "radiance": 40 * float(radiance)}
        lamps.append({"shape": "rectangle", **edges, "material": material})
    balls = [BALL | {"center": [x, y, 0.5]} for x in (-4, 0, 4) for y in (-4, 0, 4)]
    return [FLOOR, *balls, *lamps]


def sky(kind: str) -> NDArray[np.float64]:
    """Return a sky of 512 x 256 texels: with a sun of 4 x 4, of bright and dark blocks, or smooth."""
    height = np.linspace(1.5, 0.2, 256)[:, None, None]
    pixels = np.full((256, 512, 3), 0.3) * height
    if kind == "sunny sky":
        pixels[60:64, 100:104] = 20000.0
    elif kind == "blocky sky":
        blocks = np.random.default_rng(3).lognormal(0.0, 1.5, (16, 32, 1))
        pixels = pixels * blocks.repeat(16, axis=0).repeat(16, axis=1)
    return pixels


def scenes(shrink: int, folder: Path) -> dict[str, dict[str, Any]]:
    """Return the scenes by name; pictures are written into a folder."""
    film = {"film": {"resolution": [640 // shrink, 360 // shrink]}, "render": {"max_depth": 3}}
    hall = CAMERA | {"eye": [0, -9, 2.2], "target": [0, 0, 0.3]}
    found: dict[str, dict[str, Any]] = {}
    for shape in SOFTBOXES:
        found[shape] = film | {"camera": CAMERA, "objects": softbox(shape)}
    for across in (6, 16, 20):
        found[f"{across**2} lamps"] = film | {"camera": hall, "objects": ceiling(across)}
    for kind in ("sunny sky", "blocky sky", "smooth sky"):
        save_exr(folder / f"{kind}.exr", sky(kind))
        environment = {"kind": "image", "file": f"{kind}.exr", "up": [0, 0, 1]}
        inside = CAMERA | {"eye": [1.5, -1.8, 1.6], "target": [-0.5, 1, 0.8], "fov_degrees": 75}
        found[f"room, {kind}"] = film | {"camera": inside, "objects": room(), "environment": environment}
        found[kind] = film | {"camera": CAMERA, "objects": [FLOOR, BALL], "environment": environment}
    return found


def main() -> None:
    """Measure every scene and print the table."""
    parser = arguments("Noise of direct light.")
    parser.add_argument("--seeds", type=int, default=8, help="pictures per measurement (default 8)")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel (default 64)")
    parser.add_argument("--sampler", choices=SAMPLERS, default=SAMPLERS[-1], help="(default %(default)s)")
    parser.add_argument("--scenes", nargs="*", help="some of the scenes (default all)")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    rows, results = [], []
    with tempfile.TemporaryDirectory() as folder:
        described = scenes(40 if options.quick else 5, Path(folder))
        for name in options.scenes or described:
            scene: Scene = change_scene(
                load_scene(described[name], base_dir=folder), render={"sampler": options.sampler}
            )
            ((variance, nanoseconds),) = measure(scene, session, [options.spp], options.seeds).values()
            results.append({"scene": name, "variance": variance, "ns": nanoseconds})
            rows.append([name, f"{variance:.3f}", f"{nanoseconds:.1f}", f"{variance * nanoseconds:.1f}"])
    print_machine(facts)
    print_table("Direct light", ["scene", "variance per sample", "ns per sample", "product"], rows)
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
