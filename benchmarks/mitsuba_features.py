"""Features of materials, textures, lamps and cameras beside Mitsuba 3: the same random scenes, mean and tiles compared.

    python -m benchmarks.mitsuba_features [--spp 256] [--seeds 2] [--features NAME …] [--mitsuba-python PATH]

A feature is a scene in our words and in Mitsuba's, both of the same random numbers. Each renderer makes eight pictures
of its own seeds; the table has the difference of the means in per cent with its standard error, and the least
probability of a tile of 8 x 8 pixels (after Šidák, above 1e-4 unless the pictures differ).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from benchmarks.mitsuba_scene import describe
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.worker import Worker, WorkerError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.scene.assets.pictures import write_exr
from rptcam_cl.scene.load import load_scene
from tests.rendering.test_measured import glossy, tensor_fields, tensors
from tests.support.statistics import Sampled, overall, sampled, tiles, welch

Keys = dict[str, Any]
Array = NDArray[np.float64]
Feature = tuple[Keys, Keys]  # of the scene in our words; shapes, lights and perhaps sensor in Mitsuba's
RESOLUTION = (96, 64)
BATCHES = 8
ALPHA = 1e-4
MOST_APART = 0.003  # of the mean
COLUMNS = ("feature", "seed", "ours", "Mitsuba", "differs", "least tile")


def rgb(color: Any) -> Keys:
    """Return a colour in Mitsuba's words."""
    return {"type": "rgb", "value": [float(channel) for channel in color]}


def matrix(x: Any, y: Any, z: Any, origin: Any) -> Keys:
    """Return the transform that takes the axes and the origin to those of the world."""
    rows = np.eye(4)
    rows[:3] = np.stack([x, y, z, origin], axis=1)
    return {"matrix": rows.tolist()}


def rectangle(corner: Any, u: Any, v: Any, **looks: Any) -> Keys:
    """Return a rectangle in Mitsuba's words."""
    corner, u, v = (np.array(each, float) for each in (corner, u, v))
    normal = np.cross(u, v)
    place = matrix(u / 2, v / 2, normal / np.linalg.norm(normal), corner + u / 2 + v / 2)
    return {"type": "rectangle", "to_world": place, **looks}


def diffuse(color: Any) -> Keys:
    """Return a matte material in Mitsuba's words."""
    return {"type": "twosided", "inner": {"type": "diffuse", "reflectance": rgb(color)}}


class Studio:
    """A floor under an even sky and a lamp, and what stands on it, in both programs' words."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.rng = np.random.default_rng(seed)
        self.folder = folder
        angle = self.rng.uniform(0, 2 * np.pi)
        self.camera: Keys = {
            "kind": "pinhole", "eye": [5 * np.cos(angle), 5 * np.sin(angle), 3.0], "target": [0, 0, 0.8],
            "up": [0, 0, 1], "fov_degrees": 42.0,
        }  # fmt: skip
        floor, glow = self.color(), self.rng.uniform(4, 9, 3)
        lamp = [-1, -1, 4], [0, 2, 0], [2, 0, 0]  # its front is below
        self.objects: list[Keys] = [
            self.plate([-4, -4, 0], [8, 0, 0], [0, 8, 0], {"kind": "matte", "reflectance": floor}),
            self.plate(*lamp, {"kind": "emissive", "radiance": glow.tolist()}),
        ]
        self.lights: list[Keys] = []
        self.theirs: Keys = {
            "floor": rectangle([-4, -4, 0], [8, 0, 0], [0, 8, 0], bsdf=diffuse(floor)),
            "lamp": rectangle(*lamp, emitter={"type": "area", "radiance": rgb(glow)}),
            "environment": {"type": "constant", "radiance": rgb([0.3, 0.4, 0.5])},
        }

    def color(self) -> list[float]:
        """Return a random reflectance."""
        return self.rng.uniform(0.2, 0.8, 3).tolist()

    @staticmethod
    def plate(corner: Any, u: Any, v: Any, material: Keys) -> Keys:
        """Return a rectangle in our words."""
        return {"shape": "rectangle", "corner": corner, "edge_u": u, "edge_v": v, "material": material}

    def stand(self, material: Keys, bsdf: Keys, shapes: str = "sphere card") -> None:
        """Put a ball and a card of a material on the floor."""
        if "sphere" in shapes:
            self.objects.append({"shape": "sphere", "center": [-0.9, 0, 1], "radius": 0.9, "material": material})
            self.theirs["ball"] = {"type": "sphere", "center": [-0.9, 0, 1], "radius": 0.9, "bsdf": bsdf}
        if "card" in shapes:
            corner, u, v = np.array([0.4, -0.9, 0.1]), np.array([0.5, 1.6, 0.2]), np.array([-0.3, -0.11875, 1.7])
            if np.cross(u, v) @ (self.camera["eye"] - corner) < 0:  # Mitsuba's bumps stand out on either side
                corner, u = corner + u, -u
            card = corner.tolist(), u.tolist(), v.tolist()
            self.objects.append(self.plate(*card, material))
            self.theirs["card"] = rectangle(*card, bsdf=bsdf)

    def picture(self, name: str, pixels: Array) -> tuple[str, str]:
        """Write a picture for both; in Mitsuba the top row has v = 0."""
        write_exr({"RGB": pixels.astype(np.float32)}, self.folder / f"{name}.exr")
        write_exr({"RGB": pixels[::-1].astype(np.float32)}, self.folder / f"{name}_turned.exr")
        return f"{name}.exr", str(self.folder / f"{name}_turned.exr")

    def feature(self) -> Feature:
        """Return both descriptions."""
        ours = {
            "camera": self.camera, "objects": self.objects, "lights": self.lights,
            "render": {"max_depth": 8, "caustics": "off", "multiple_scattering": False},
            "environment": {"kind": "constant", "radiance": [0.3, 0.4, 0.5]},
            "film": {"resolution": list(RESOLUTION)},
        }  # fmt: skip
        return ours, self.theirs


def waves(rng: np.random.Generator, size: tuple[int, int] = (256, 256)) -> Array:
    """Return a picture (height, width, 3) of smooth random heights from 0 to 1 that repeats."""
    rows, columns = (np.arange(count)[:, None] / count * 2 * np.pi for count in size)
    heights = np.zeros(size)
    for _ in range(12):
        i, j = rng.integers(-4, 5, 2)
        heights += rng.uniform() * np.cos(i * rows + j * columns.T + rng.uniform(0, 6))
    heights = (heights - heights.min()) / np.ptp(heights)
    return np.repeat(heights[..., None], 3, axis=2)


def bumps(studio: Studio, shapes: str) -> None:
    """Heights of a picture on a matte card or ball."""
    color, height = studio.color(), studio.rng.uniform(0.01, 0.02)
    pixels = waves(studio.rng)
    name, turned = studio.picture("heights", pixels)
    upright = str(studio.folder / name)  # v of Mitsuba's balls runs down from the pole, as rows do
    texture = {"kind": "image", "file": name, "color_space": "linear"}
    material = {"kind": "matte", "reflectance": color, "bump": {"texture": texture, "height": height}}
    bitmap = {"type": "bitmap", "filename": turned if shapes == "card" else upright, "raw": True}
    bsdf = {
        "type": "bumpmap",
        "heights": bitmap,
        "scale": height,
        "inner": {"type": "diffuse", "reflectance": rgb(color)},
    }
    studio.stand(material, {"type": "twosided", "inner": bsdf}, shapes)


def tinted_glass(studio: Studio, alpha: float) -> None:
    """A ball of glass whose reflected and refracted light is tinted."""
    reflected, passed, index = studio.color(), studio.color(), studio.rng.uniform(1.3, 1.8)
    material = {"kind": "dielectric", "index": index, "reflectance": reflected, "transmittance": passed}
    bsdf = {"type": "dielectric", "int_ior": index, "ext_ior": 1.0}
    bsdf |= {"specular_reflectance": rgb(reflected), "specular_transmittance": rgb(passed)}
    if alpha:
        material["alpha"] = alpha
        bsdf |= {"type": "roughdielectric", "distribution": "ggx", "alpha": alpha}
    studio.stand(material, bsdf, "sphere")


def parallel_view(studio: Studio) -> None:
    """An orthographic camera before a matte ball and card."""
    color = studio.color()
    studio.stand({"kind": "matte", "reflectance": color}, diffuse(color))
    studio.camera = {key: studio.camera[key] for key in ("eye", "target", "up")} | {
        "kind": "orthographic",
        "width_m": 4.0,
    }
    eye, target = np.array(studio.camera["eye"]), np.array(studio.camera["target"])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    width, height = RESOLUTION
    # its film is square, from -1 to 1 across the width
    place = matrix(-2.0 * right, 2.0 * up, forward, eye)
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}, "pixel_format": "rgb",
            "component_format": "float32"}  # fmt: skip
    sampler = {"type": "independent"}
    studio.theirs["sensor"] = {"type": "orthographic", "to_world": place, "film": film, "sampler": sampler}


def hard_spot(studio: Studio) -> None:
    """A spot with a sharp edge on a matte ball and card."""
    color, intensity = studio.color(), studio.rng.uniform(20, 60, 3)
    position, target = studio.rng.uniform([-2, -2, 3], [2, 2, 4]), np.array([0, 0, 0.5])
    studio.stand({"kind": "matte", "reflectance": color}, diffuse(color))
    toward = target - position
    studio.lights.append({
        "kind": "spot", "position": position.tolist(), "direction": toward.tolist(), "intensity": intensity.tolist(),
        "inner_degrees": 23.999, "outer_degrees": 24.0,
    })  # fmt: skip
    z = toward / np.linalg.norm(toward)
    x = np.cross([0, 1, 0], z) / np.linalg.norm(np.cross([0, 1, 0], z))
    studio.theirs["spot"] = {
        "type": "spot", "to_world": matrix(x, np.cross(z, x), z, position), "intensity": rgb(intensity),
        "cutoff_angle": 24.0, "beam_width": 23.999,
    }  # fmt: skip


def two_sides(studio: Studio) -> None:
    """A matte card seen and lit from both sides, and one that shines from one side alone."""
    color, glow = studio.color(), studio.rng.uniform(1, 3, 3)
    studio.stand({"kind": "matte", "reflectance": color}, diffuse(color))
    card = [-0.2, 1.2, 0.2], [1.0, 0.3, 0.1], [0.1, -0.2, 1.1]
    studio.objects.append(studio.plate(*card, {"kind": "emissive", "radiance": glow.tolist()}))
    black = {"type": "diffuse", "reflectance": rgb([0, 0, 0])}
    studio.theirs["panel"] = rectangle(*card, bsdf=black, emitter={"type": "area", "radiance": rgb(glow)})


def holes(studio: Studio) -> None:
    """A card with a painted opacity."""
    color, pixels = studio.color(), waves(studio.rng)
    name, turned = studio.picture("opacity", pixels)
    opacity = {"kind": "image", "file": name, "color_space": "linear", "channel": "r"}
    bitmap = {"type": "bitmap", "filename": turned, "raw": True}
    studio.stand({"kind": "matte", "reflectance": color, "opacity": opacity},
                 {"type": "mask", "opacity": bitmap, "inner": diffuse(color)}, "card")  # fmt: skip


def mixed(studio: Studio) -> None:
    """A card and ball of two materials, one of them brushed metal."""
    color, metal, factor = studio.color(), studio.color(), studio.rng.uniform(0.3, 0.7)
    parts = [{"kind": "matte", "reflectance": color}, {"kind": "conductor", "reflectance": metal, "alpha": 0.1}]
    rough = {"type": "roughconductor", "material": "none", "specular_reflectance": rgb(metal)}
    rough |= {"distribution": "ggx", "alpha": 0.1}
    blend = {"type": "blendbsdf", "weight": factor, "a": {"type": "diffuse", "reflectance": rgb(color)}, "b": rough}
    studio.stand({"kind": "mix", "materials": parts, "factor": factor}, {"type": "twosided", "inner": blend})


def round_lamps(studio: Studio) -> None:
    """A disk, a ball and a tube that shine."""
    color, glow = studio.color(), studio.rng.uniform(2, 5, 3)
    studio.stand({"kind": "matte", "reflectance": color}, diffuse(color))
    emissive = {"kind": "emissive", "radiance": glow.tolist()}
    studio.objects += [
        {"shape": "disk", "center": [1.2, 1, 2], "normal": [0, 0, -1], "radius": 0.5, "material": emissive},
        {"shape": "sphere", "center": [-1.5, 1.2, 0.5], "radius": 0.3, "material": emissive},
        {"shape": "cylinder", "base": [1.5, -1, 0.5], "top": [1.5, 0.5, 0.8], "radius": 0.1, "capped": False,
         "material": emissive},
    ]  # fmt: skip
    area = {"type": "area", "radiance": rgb(glow)}
    studio.theirs |= {
        "disk": {
            "type": "disk",
            "to_world": matrix([0.5, 0, 0], [0, -0.5, 0], [0, 0, -1], [1.2, 1, 2]),
            "emitter": area,
        },
        "bulb": {"type": "sphere", "center": [-1.5, 1.2, 0.5], "radius": 0.3, "emitter": area},
        "tube": {"type": "cylinder", "p0": [1.5, -1, 0.5], "p1": [1.5, 0.5, 0.8], "radius": 0.1, "emitter": area},
    }


def measured(studio: Studio) -> None:
    """A ball and a card of a tensor file as RGL has them, of a glossy formula."""
    fields = tensor_fields(glossy)
    path = studio.folder / "glossy.bsdf"
    description = np.frombuffer(b"of a formula", np.uint8)
    path.write_bytes(tensors(**fields, luminance=fields["rgb"].mean(axis=2), description=description))
    studio.stand({"kind": "measured", "file": path.name},
                 {"type": "twosided", "inner": {"type": "measured", "filename": str(path)}})  # fmt: skip


FEATURES: dict[str, Callable[[Studio], None]] = {
    "bumps on a card": lambda studio: bumps(studio, "card"),
    "bumps on a ball": lambda studio: bumps(studio, "sphere"),
    "tinted glass": lambda studio: tinted_glass(studio, 0.0),
    "tinted rough glass": lambda studio: tinted_glass(studio, 0.3),
    "orthographic camera": parallel_view,
    "spot with a sharp edge": hard_spot,
    "both sides": two_sides,
    "painted opacity": holes,
    "mix": mixed,
    "round lamps": round_lamps,
    "measured": measured,
}


def render_ours(ours: Keys, folder: Path, spp: int, seed: int) -> Sampled:
    """Return the mean of our pictures."""
    scene = load_scene(ours, base_dir=folder)
    pictures = [np.asarray(rptcam_cl.render(scene, spp=spp, seed=100 * seed + batch)) for batch in range(BATCHES)]
    return sampled([picture[..., :3] for picture in pictures])


def render_theirs(worker: Worker, ours: Keys, theirs: Keys, folder: Path, spp: int, seed: int) -> Sampled:
    """Return the mean of Mitsuba's pictures."""
    camera = ours["camera"] if ours["camera"]["kind"] == "pinhole" else FRAME
    frame = load_scene({**ours, "objects": [], "lights": [], "camera": camera}, base_dir=folder)
    description = describe(frame, roulette=False, folder=folder, others=theirs)
    worker.ask(do="load", description=description, **{"as": str(folder)})
    pictures = []
    for batch in range(BATCHES):
        path = folder / f"{batch}.npy"
        worker.ask(do="render", spp=spp, seed=100 * seed + batch, save=str(path), **{"as": str(folder)})
        pictures.append(np.load(path))
    return sampled(pictures)


FRAME = {"kind": "pinhole", "eye": [0, 0, 1], "target": [0, 0, 0], "up": [0, 1, 0], "fov_degrees": 40.0}


def compare(worker: Worker, name: str, seed: int, spp: int, folder: Path) -> Keys:
    """Return by how much both pictures of a feature differ."""
    folder.mkdir()
    studio = Studio(seed, folder)
    FEATURES[name](studio)
    ours, theirs = studio.feature()
    a = render_ours(ours, folder, spp, seed)
    b = render_theirs(worker, ours, theirs, folder, spp, seed)
    left, right = overall(a), overall(b)
    differs = float((left.mean / right.mean - 1).mean())
    error = float(np.sqrt((left.variance + right.variance) / right.mean**2).mean())
    p = welch(tiles(a), tiles(b))
    return {
        "feature": name, "seed": seed, "ours": left.mean.tolist(), "mitsuba": right.mean.tolist(), "differs": differs,
        "error": error, "tile": float(-np.expm1(p.size * np.log1p(-min(p.min(), 1 - 1e-16)))),
    }  # fmt: skip


def parse() -> argparse.Namespace:
    """Return the options of the command line."""
    parser = arguments("Features beside Mitsuba 3.")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel and batch (default 256)")
    parser.add_argument("--seeds", type=int, default=2, help="random scenes of each feature (default 2)")
    parser.add_argument("--features", nargs="+", choices=list(FEATURES), default=list(FEATURES), metavar="NAME")
    parser.add_argument("--mitsuba-python", default=sys.executable, help="interpreter that can import mitsuba")
    return parser.parse_args()


def main() -> int:
    """Run the comparison; the exit code is 1 when pictures differ and 2 when a renderer is missing."""
    options = parse()
    device = choose_device(options.device)
    try:
        worker = Worker(options.mitsuba_python, "benchmarks.mitsuba_worker")
    except WorkerError as error:
        print(f"mitsuba_features: {error}", file=sys.stderr)
        return 2
    spp, seeds = (4, 1) if options.quick else (options.spp, options.seeds)
    facts = machine(device) | {"ours": f"rptcam_cl {rptcam_cl.__version__}", "mitsuba": worker.description}
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for name in options.features:
            for seed in range(1, seeds + 1):
                results.append(compare(worker, name, seed, spp, Path(folder) / f"{name} {seed}"))
                print(f"{name}: done", file=sys.stderr)
    worker.close()
    print_machine(facts)
    rows = [[found["feature"], str(found["seed"]), *(" ".join(f"{mean:.4f}" for mean in found[side]) for side in
             ("ours", "mitsuba")), f"{100 * found['differs']:+.3f} ± {100 * found['error']:.3f} %",
             f"{found['tile']:.2g}"] for found in results]  # fmt: skip
    print_table("Mean colours, and where they differ", COLUMNS, rows)
    write_json(options.json, facts, results)
    apart = [f["feature"] for f in results if f["tile"] < ALPHA or abs(f["differs"]) > MOST_APART + 4 * f["error"]]
    if apart and not options.quick:
        print(f"mitsuba_features: the pictures of {', '.join(apart)} differ", file=sys.stderr)
    return 1 if apart and not options.quick else 0


if __name__ == "__main__":
    raise SystemExit(main())
