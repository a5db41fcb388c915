"""Caustics by photons beside Mitsuba 3: random scenes of glass and mirrors, means and tiles compared.

    python -m benchmarks.mitsuba_photons [--scenes 4] [--spp 512] [--radius 0.33] [--mitsuba-python PATH]

On a floor before a wall stand three of: a ball and a box of glass, a pane, a ball, a disk and an open ring of mirror;
one to three lamps are balls, points or spots. Mitsuba's `ptracer` sends light from the lamps to the camera, so that it
has caustics without a bias, but none of what glass and mirrors show: pixels that are matte, and whose neighbours are,
count. Each renderer makes eight pictures of its own seeds. The table has the difference of their means in per cent with
its standard error, the least probability of a tile of 8 x 8 pixels (after Šidák, above 1e-4 unless they differ), and
the difference without photons. Photons blur: with `--radius 0.33` they start with a third of the radius, which tiles at
the edge of a caustic ask for. The exit code is 1 where means differ by 0.3 % and four errors, or tiles do.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from benchmarks.mitsuba_features import (
    ALPHA,
    BATCHES,
    MOST_APART,
    Keys,
    Studio,
    diffuse,
    matrix,
    rectangle,
    rgb,
)
from benchmarks.mitsuba_scene import NO_ROULETTE, describe
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.worker import Worker, WorkerError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.rendering import photon_map
from rptcam_cl.scene.load import load_scene
from tests.support.statistics import Sampled, sampled, tiles, welch

Pictures = list[NDArray[np.float64]]
COLUMNS = ("scene", "what stands there", "ours", "Mitsuba", "differs", "least tile", "without photons")
THINGS = ("glass ball", "glass box", "pane", "mirror ball", "mirror disk", "mirror ring")
EDGE = 1  # pixels beside those that are not matte do not count


class Table(Studio):
    """A floor and a wall, what stands before it, and lamps, in both programs' words."""

    def __init__(self, seed: int, folder: Path) -> None:
        super().__init__(seed, folder)
        self.camera |= {"eye": [0.5, -5.0, 4.5], "target": [0, 0.2, 0.3]}
        color, wall = self.color(), ([-2.5, 2.2, 0.0], [5.0, 0.3, 0.0], [0.0, 0.2, 2.0])
        self.objects = [self.objects[0], self.plate(*wall, {"kind": "matte", "reflectance": color})]
        self.theirs = {"floor": self.theirs["floor"], "wall": rectangle(*wall, bsdf=diffuse(color))}
        self.names = [str(name) for name in self.rng.choice(THINGS, 3, replace=False)]
        for place, name in zip(([-1.3, -0.4], [0.2, 0.6], [1.3, -0.2]), self.names, strict=True):
            self.put(name, *place)
        for number in range(self.rng.integers(1, 4)):
            self.hang(f"lamp_{number}")

    def put(self, name: str, x: float, y: float) -> None:
        """Put a thing of glass or mirror on the floor."""
        looks, shape = name.split()[0], name.split()[-1]
        index, color = float(self.rng.uniform(1.3, 1.7)), self.color()
        ours: Keys = {"kind": "mirror", "reflectance": color}
        metal = {"type": "conductor", "material": "none", "specular_reflectance": rgb(color)}
        theirs: Keys = {"type": "twosided", "inner": metal}
        if looks == "glass":
            ours, theirs = (
                {"kind": "dielectric", "index": index},
                {"type": "dielectric", "int_ior": index, "ext_ior": 1.0},
            )
        elif looks == "pane":
            ours, theirs = {"kind": "thin_glass", "index": index}, {"type": "thindielectric", "int_ior": index}
        size = float(self.rng.uniform(0.35, 0.55))
        if shape == "ball":
            mine: Keys = {"shape": "sphere", "center": [x, y, size + 0.1], "radius": size}
            other: Keys = {"type": "sphere", "center": [x, y, size + 0.1], "radius": size}
        elif shape == "box":
            low, high = [x - size, y - size / 2, 0.1], [x + size, y + size / 2, 0.1 + size]
            mine = {"shape": "box", "min": low, "max": high}
            half = np.subtract(high, low) / 2
            other = {"type": "cube", "to_world": matrix(*np.diag(half), np.add(low, half))}
        elif shape == "ring":
            low, high = [x, y, 0.02], [x, y, size]
            mine = {"shape": "cylinder", "base": low, "top": high, "radius": size, "capped": False}
            other = {"type": "cylinder", "p0": low, "p1": high, "radius": size}
        elif shape == "disk":
            normal = np.array([self.rng.uniform(-0.3, 0.3), -0.5, 0.8])
            z = normal / np.linalg.norm(normal)
            u = np.cross([1.0, 0, 0], z)
            u /= np.linalg.norm(u)
            mine = {"shape": "disk", "center": [x, y, 0.5], "normal": z.tolist(), "radius": size}
            other = {"type": "disk", "to_world": matrix(size * u, size * np.cross(z, u), z, [x, y, 0.5])}
        else:
            card = [x - size, y, 0.3], [2 * size, 0.3, 0.0], [0.0, 2 * size, 0.4]
            mine, other = self.plate(*card, ours), rectangle(*card)
        self.objects.append(mine | {"material": ours})
        self.theirs[name] = other | {"bsdf": theirs}

    def hang(self, name: str) -> None:
        """Hang a lamp over the table."""
        angle, glow = self.rng.uniform(0, 2 * np.pi), self.rng.uniform(10, 40, 3)
        place = np.array([2.2 * np.cos(angle), 2.2 * np.sin(angle) - 0.5, self.rng.uniform(2.2, 3.5)])
        kind = self.rng.choice(["ball", "point", "spot"])
        if kind == "ball":
            radius = float(self.rng.uniform(0.06, 0.15))
            shape = {"center": place.tolist(), "radius": radius}
            light = (glow / radius**2 / 4).tolist()
            self.objects.append({"shape": "sphere", **shape, "material": {"kind": "emissive", "radiance": light}})
            black = {"type": "diffuse", "reflectance": rgb([0, 0, 0])}
            self.theirs[name] = {
                "type": "sphere",
                **shape,
                "bsdf": black,
                "emitter": {"type": "area", "radiance": rgb(light)},
            }
        elif kind == "point":
            self.lights.append({"kind": "point", "position": place.tolist(), "intensity": glow.tolist()})
            self.theirs[name] = {"type": "point", "position": place.tolist(), "intensity": rgb(glow)}
        else:
            toward = -place + [0, 0.2, 0.3]
            self.lights.append({
                "kind": "spot", "position": place.tolist(), "direction": toward.tolist(), "intensity": glow.tolist(),
                "inner_degrees": 29.999, "outer_degrees": 30.0,
            })  # fmt: skip
            z = toward / np.linalg.norm(toward)
            x = np.cross([0, 1, 0], z) / np.linalg.norm(np.cross([0, 1, 0], z))
            self.theirs[name] = {
                "type": "spot", "to_world": matrix(x, np.cross(z, x), z, place), "intensity": rgb(glow),
                "cutoff_angle": 30.0, "beam_width": 29.999,
            }  # fmt: skip


def ours_of(keys: Keys, spp: int, seed: int, photons: bool, radius: float = 1.0) -> Pictures:
    """Return our pictures."""
    scene = load_scene(
        keys | {"render": keys["render"] | {"caustics": "on" if photons else "off", "roulette_depth": 0}}
    )
    usual = photon_map.FIRST_PHOTONS
    photon_map.FIRST_PHOTONS = usual * radius**2
    try:
        return [
            np.asarray(rptcam_cl.render(scene, spp=spp, seed=100 * seed + batch), float) for batch in range(BATCHES)
        ]
    finally:
        photon_map.FIRST_PHOTONS = usual


def theirs_of(worker: Worker, keys: Keys, theirs: Keys, folder: Path, spp: int, seed: int) -> Pictures:
    """Return Mitsuba's pictures, by light from the lamps."""
    frame = load_scene({**keys, "objects": [], "lights": []})
    description = describe(frame, roulette=False, folder=folder, others=theirs)
    description["integrator"] = {"type": "ptracer", "max_depth": frame.render.max_depth, "rr_depth": NO_ROULETTE}
    worker.ask(do="load", description=description, **{"as": str(folder)})
    path, pictures = folder / "picture.npy", []
    for batch in range(BATCHES):
        worker.ask(do="render", spp=spp, seed=100 * seed + batch, save=str(path), **{"as": str(folder)})
        pictures.append(np.load(path).astype(float))
    return pictures


def matte_pixels(keys: Keys) -> NDArray[np.bool_]:
    """Return which pixels show floor and wall alone, as their neighbours do: all samples of them, of one number."""
    layers = {"caustics": "off", "layers": ["object_id", "coverage"], "layers_spp": 64}
    found = rptcam_cl.render(load_scene(keys | {"render": keys["render"] | layers}), spp=64).layers["object_id"]
    seen = np.pad(np.isin(found, (0, 1)), EDGE, mode="edge")
    rows, columns = found.shape
    shifts = range(2 * EDGE + 1)
    return np.all([seen[i : i + rows, j : j + columns] for i in shifts for j in shifts], axis=0)


def compare(worker: Worker, seed: int, options: argparse.Namespace, folder: Path) -> Keys:
    """Return by how much both pictures of a scene differ where they are matte."""
    folder.mkdir()
    table = Table(seed, folder)
    keys, theirs = table.feature()
    del keys["environment"]
    counts = matte_pixels(keys)[..., None]
    share = float(counts.mean())
    ours = [each * counts for each in ours_of(keys, options.spp, seed, True, options.radius)]
    others = [each * counts for each in theirs_of(worker, keys, theirs, folder, options.spp // 2, seed)]
    paths = [each * counts for each in ours_of(keys, options.spp // 8, seed, False)]
    a, b, without = (sampled([each.mean(axis=(0, 1)) for each in every]) for every in (ours, others, paths))
    p = welch(*(sampled([tile_means(each) for each in every]) for every in (ours, others)))
    return {
        "scene": seed, "stands": table.names, "lamps": sorted(set(theirs) - set(table.names) - {"floor", "wall"}),
        "matte": share, "ours": (a.mean / share).tolist(), "mitsuba": (b.mean / share).tolist(),
        "differs": float((a.mean / b.mean - 1).mean()), "error": error_of(a, b),
        "tile": float(-np.expm1(p.size * np.log1p(-min(p.min(), 1 - 1e-16)))),
        "without": float((without.mean / b.mean - 1).mean()), "error without": error_of(without, b),
    }  # fmt: skip


def tile_means(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means of tiles: of whole pictures, as photons are the same for neighbours."""
    means: NDArray[np.float64] = tiles(Sampled(picture, 0 * picture, 1)).mean
    return means


def error_of(one: Sampled, other: Sampled) -> float:
    """Return the standard error of the ratio of two means, of all channels together."""
    return float(np.sqrt((one.variance + other.variance) / other.mean**2).mean())


def row(found: Keys) -> list[str]:
    """Return the table row of a scene."""
    means = (" ".join(f"{mean:.4f}" for mean in found[side]) for side in ("ours", "mitsuba"))
    differs = (
        f"{100 * found[a]:+.3f} ± {100 * found[b]:.3f} %"
        for a, b in (("differs", "error"), ("without", "error without"))
    )
    first, last = differs
    return [str(found["scene"]), ", ".join(found["stands"]), *means, first, f"{found['tile']:.2g}", last]


def main() -> int:
    """Run the comparison; the exit code is 1 when pictures differ and 2 when a renderer is missing."""
    parser = arguments("Caustics by photons beside Mitsuba 3.")
    parser.add_argument("--spp", type=int, default=512, help="samples per pixel of a picture of ours (default 512)")
    parser.add_argument("--scenes", type=int, default=4, help="random scenes (default 4)")
    parser.add_argument("--first", type=int, default=1, help="seed of the first one (default 1)")
    parser.add_argument("--radius", type=float, default=1.0, help="of photons, over the usual one (default 1)")
    parser.add_argument("--mitsuba-python", default=sys.executable, help="interpreter that can import mitsuba")
    options = parser.parse_args()
    if options.quick:
        options.scenes, options.spp = 1, 16
    device = choose_device(options.device)
    try:
        worker = Worker(options.mitsuba_python, "benchmarks.mitsuba_worker")
    except WorkerError as error:
        print(f"mitsuba_photons: {error}", file=sys.stderr)
        return 2
    facts = machine(device) | {"ours": f"rptcam_cl {rptcam_cl.__version__}", "mitsuba": worker.description}
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(options.first, options.first + options.scenes):
            results.append(compare(worker, seed, options, Path(folder) / str(seed)))
            print(" | ".join(row(results[-1])), file=sys.stderr)
    worker.close()
    print_machine(facts)
    print_table("Mean colours of matte pixels, and where they differ", COLUMNS, [row(found) for found in results])
    write_json(options.json, facts, results)
    apart = [f"{f['scene']}" for f in results if f["tile"] < ALPHA or abs(f["differs"]) > MOST_APART + 4 * f["error"]]
    if apart and not options.quick:
        print(f"mitsuba_photons: the pictures of {', '.join(apart)} differ", file=sys.stderr)
    return 1 if apart and not options.quick else 0


if __name__ == "__main__":
    raise SystemExit(main())
