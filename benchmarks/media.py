"""Random scenes with fog, smoke and milk beside Mitsuba 3 (its volpath): pictures must be the same but for noise.

    python -m benchmarks.media [--seeds 1-12 101-110 201-208 301-306 401-406] [--batches 200] [--spp 256]
        [--noise 0.0025] [--mitsuba-python PATH] [--json FILE]

Each scene has media around all, in a box without a surface or in a ball of glass, of random coefficients, albedo and
asymmetry; a lamp, perhaps a point of light, a floor and a ball. From seed 101 on the medium in the box has its density
on a grid, from 201 on that round all lies in a layer, which Mitsuba takes as a fine grid in a black room, from 301 on
there is a ball of skin, a dense medium under smooth or rough glass, and from 401 on a tuft of hair. Both sides render
it in batches by different seeds, at least 16, until the noise of the whole picture's mean is small enough to show a
difference of 0.3 %; that noise and the noise of the mean of each of 16 fields follow from the batches. A scene agrees
where no field's difference is more noise than the largest of so many that chance allows once in a hundred times
(Sidak). Of few batches, rare bright samples make that noise too small now and then, and z too large: with 8 of 256
samples scene 7 once had 6.4, with 200 of 128 it has 2.8. Mitsuba's rough glass loses what its facets scatter twice, so
that ours has `render.multiple_scattering: false` here: with it a ball of alpha 0.3 is 2.9 % brighter.
"""

from __future__ import annotations

import sys
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.worker import Worker
from rptcam_cl.device.devices import choose_device

SIDE, FIELDS = 24, 4
FEWEST = 16  # batches from which noise is known
CHANCE = 0.01  # that equal pictures are called different, of all scenes together
ROUNDING = 1e-5  # relative, of means in float32: fields of sky alone have no noise
RESOLVED = 0.003  # relative difference of the means that noise must not hide
MAX_DEPTH = 32
Array = NDArray[np.float64]
GRIDS, LAYERS, SKIN, HAIR = 101, 201, 301, 401  # first seeds
SMOKE = np.array([[-1.3, -1.0, -1.4], [1.2, 0.9, 0.6]])
ROOM = np.array([[-6.0, -1.45, -6.0], [6.0, 6.0, 6.0]])
Pair = tuple[dict[str, Any], dict[str, Any]]  # a part of a scene in our words and in Mitsuba's


def _rgb(values: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(value) for value in values]}


def medium(random: np.random.Generator, density: float, *, even: bool = False) -> Pair:
    """Return a medium of about a density [1/m], the same in every channel where it is even."""
    extinction = density * random.uniform(0.5, 1.5, 3)
    extinction[:] = extinction[0] if even else extinction
    return coefficients(extinction, random.uniform(0.3, 1.0, 3), float(random.uniform(-0.6, 0.85)))


def coefficients(extinction: Array, albedo: Array, g: float) -> Pair:
    """Return the medium of these [1/m], of Henyey and Greenstein's phase function."""
    ours = {
        "scattering_per_m": (extinction * albedo).tolist(),
        "absorption_per_m": (extinction * (1 - albedo)).tolist(),
    }
    phase = {"type": "hg", "g": g}
    most = float(extinction.max())  # their colours end at 1
    theirs = {
        "type": "homogeneous",
        "sigma_t": _rgb(extinction / most),
        "scale": most,
        "albedo": _rgb(albedo),
        "phase": phase,
    }
    return ours | {"asymmetry": g}, theirs


def grid(random: np.random.Generator, own: dict[str, Any], other: dict[str, Any], corners: Array) -> Pair:
    """Return a medium whose density is random numbers on a grid within corners, a third of them nothing."""
    shape = random.integers(2, 12, 3)
    numbers = random.uniform(0.0, 2.0, shape) * (random.random(shape) < 2 / 3)
    return own | {"density": _place(numbers, corners)}, _heterogeneous(other, numbers, corners)


def layer(random: np.random.Generator, own: dict[str, Any], other: dict[str, Any]) -> Pair:
    """Return a medium round all that thins out upwards, in Mitsuba's words a grid that fills the room."""
    scale, base = float(random.uniform(0.3, 1.0)), float(random.uniform(-1.2, 0.2))
    heights = ROOM[0, 1] + (np.arange(1600) + 0.5) / 1600 * np.ptp(ROOM[:, 1])
    numbers = np.exp(-np.maximum(heights - base, 0) / scale)[None, :, None]
    ours = own | {"layer": {"scale_height_m": scale, "base": base, "up": [0, 1, 0]}}
    return ours, _heterogeneous(other, numbers, ROOM)


def _place(numbers: Array, corners: Array) -> dict[str, Any]:
    return {"file": numbers.astype(np.float32), "min": corners[0].tolist(), "max": corners[1].tolist()}


def _heterogeneous(medium: dict[str, Any], numbers: Array, corners: Array) -> dict[str, Any]:
    """Return a medium of Mitsuba's of one extinction, our first channel's: its grids have no colours."""
    rows = np.diag([*np.ptp(corners, axis=0), 1.0])
    rows[:3, 3] = corners[0]
    voxels = {"voxels": numbers.transpose(2, 1, 0)[..., None].tolist()}
    volume = {"type": "gridvolume", "grid": voxels, "raw": True, "to_world": {"matrix": rows.tolist()}}
    return {name: medium[name] for name in ("albedo", "phase")} | {
        "type": "heterogeneous", "sigma_t": volume, "scale": medium["scale"],
    }  # fmt: skip


def tuft(random: np.random.Generator, count: int = 400, points: int = 8) -> tuple[Pair, dict[str, Any], dict[str, Any]]:
    """Return strands of hair that stand on the floor and bend, thin beside their bends and gaps, and their material.

    Ours turn to whoever sees them and Mitsuba's are round: they agree as they get thin.
    """
    steps = np.linspace(0, 1, points)[:, None]
    roots = random.uniform([-1, -1.5, -1], [1, -1.5, 1], (count, 1, 3))
    lean = random.normal(0, 0.4, (count, 1, 3)) * [1, 0, 1] + [0, 2.2, 0]
    lines = roots + steps * lean + steps**2 * random.normal(0, 0.3, (count, 1, 3))
    width = np.broadcast_to(0.01 * np.clip(1.4 - 1.6 * steps, 0.02, 1), (count, points, 1))  # no ends to be seen
    rows = np.concatenate([lines, width], axis=-1)
    along, across = (float(random.uniform(0.15, 0.7)) for _ in "ab")
    absorption, tilt = random.uniform(0.02, 1.5, 3), float(random.uniform(0, 4))
    ours = {"kind": "hair", "absorption": absorption.tolist(), "tilt_degrees": tilt}
    ours |= {"roughness": along, "roughness_across": across}
    theirs = {"type": "hair", "sigma_a": _rgb(absorption), "scale_tilt": tilt, "int_ior": 1.55, "ext_ior": 1.0}
    theirs |= {"longitudinal_roughness": along, "azimuthal_roughness": across}
    shape = {"shape": "curves", "basis": "bspline", "points": rows.reshape(-1, 4).tolist(), "counts": [points] * count}
    return (shape, {"type": "bsplinecurve", "strands": (rows * [1, 1, 1, 0.5]).tolist()}), ours, {"bsdf": theirs}


def matte(random: np.random.Generator) -> Pair:
    """Return a matte material."""
    reflectance = random.uniform(0.1, 0.9, 3)
    ours = {"kind": "matte", "reflectance": reflectance.tolist()}
    return ours, {"bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _rgb(reflectance)}}}


def ball(centre: Any, radius: float) -> Pair:
    """Return a ball without a material."""
    place = {"center": [float(x) for x in centre], "radius": radius}
    return {"shape": "sphere"} | place, {"type": "sphere"} | place


def cube(low: Any, high: Any) -> Pair:
    """Return a box without a material."""
    low, high = np.array(low, float), np.array(high, float)
    rows = np.diag([*(high - low) / 2, 1.0])
    rows[:3, 3] = (low + high) / 2
    ours = {"shape": "box", "min": low.tolist(), "max": high.tolist()}
    return ours, {"type": "cube", "to_world": {"matrix": rows.tolist()}}


class Draw:
    """A random scene in both programs' words."""

    def __init__(self, seed: int) -> None:
        self.random = random = np.random.default_rng(seed)
        self.has_grid, self.has_layer = GRIDS <= seed < LAYERS, LAYERS <= seed < SKIN
        film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
        self.sensor: dict[str, Any] = {
            "type": "perspective", "fov": 50.0, "film": film | {"component_format": "float32"},
            "to_world": {"matrix": [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 4], [0, 0, 0, 1]]},
            "sampler": {"type": "independent"},
        }  # fmt: skip
        self.theirs: dict[str, Any] = {"type": "scene", "sensor": self.sensor}
        self.theirs["integrator"] = {"type": "volpath", "max_depth": MAX_DEPTH, "rr_depth": 1 << 20}
        self.objects: list[dict[str, Any]] = []
        self.ours: dict[str, Any] = {
            "film": {"resolution": [SIDE, SIDE]},
            "camera": {"kind": "pinhole", "eye": [0, 0, 4], "target": [0, 0, 0], "up": [0, 1, 0], "fov_degrees": 50},
            "render": {"max_depth": MAX_DEPTH, "roulette_depth": 0, "caustics": "off", "multiple_scattering": False},
            "objects": self.objects, "lights": [],
        }  # fmt: skip
        self.outside: dict[str, Any] = {}
        if (random.random() < 0.5 and seed < SKIN) or self.has_layer:
            own, other = medium(random, float(random.uniform(0.05, 0.3)), even=self.has_layer)
            if self.has_layer:
                own, other = layer(random, own, other)
                black = {"type": "diffuse", "reflectance": _rgb((0.0, 0.0, 0.0))}
                black = {"bsdf": {"type": "twosided", "bsdf": black}}
                self.add(cube(*ROOM), {"kind": "matte", "reflectance": 0.0}, black)
            self.ours["medium"], self.outside = own, {"exterior": other}
            self.sensor["medium"] = other
        if seed < SKIN:
            self._fill()
        else:
            self._model(seed >= HAIR)
        self._shine()

    def add(self, shape: Pair, own: dict[str, Any], other: dict[str, Any]) -> None:
        """Add an object of a material."""
        self.objects.append(shape[0] | {"material": own})
        self.theirs[f"object_{len(self.objects)}"] = shape[1] | other

    def _fill(self) -> None:
        random = self.random
        self.add(cube([-6, -1.4, -6], [6, -1.2, 3]), *matte(random))
        self.add(ball(random.uniform([-1, -1, -1], [1, 0, 0]), 0.3), *matte(random))
        if random.random() < 0.6 or not self.outside or self.has_grid:
            own, other = medium(random, float(random.uniform(0.3, 1.5)), even=self.has_grid)
            if self.has_grid:
                own, other = grid(random, own, other, SMOKE)
            self.add(cube(*SMOKE), {"kind": "boundary", "interior": own},
                     {"bsdf": {"type": "null"}, "interior": other} | self.outside)  # fmt: skip
        if random.random() < 0.6:
            own, other = medium(random, float(random.uniform(1.0, 4.0)))
            self.add(ball([*random.uniform(-0.8, 0.8, 2), 1.4], 0.45), {"kind": "dielectric", "interior": own},
                     {"bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}, "interior": other}
                     | self.outside)  # fmt: skip

    def _model(self, has_hair: bool) -> None:
        random = self.random
        self.add(cube([-6, -1.4, -6], [6, -1.2, 3]), *matte(random))
        if has_hair:
            self.add(*tuft(random))
            return
        depth, albedo = float(random.uniform(12.0, 30.0)), random.uniform(0.7, 0.98, 3)  # mean free paths, radius 1
        own, other = coefficients(depth * random.uniform(0.5, 1.0, 3), albedo, float(random.uniform(-0.3, 0.8)))
        index, alpha = float(random.uniform(1.2, 1.5)), float(random.choice([0.0, 0.25, 0.4]))
        glass = {"type": "dielectric", "int_ior": index, "ext_ior": 1.0}
        if alpha:
            glass |= {"type": "roughdielectric", "distribution": "ggx", "alpha": alpha}
        skin = {"kind": "dielectric", "index": index, "interior": own} | ({"alpha": alpha} if alpha else {})
        self.add(
            ball(random.uniform([-0.4, -0.2, -0.5], [0.4, 0.4, 0.5]), 1.0), skin, {"bsdf": glass, "interior": other}
        )

    def _shine(self) -> None:
        random = self.random
        glow = random.uniform(2.0, 10.0, 3)
        lamp = {"kind": "emissive", "radiance": glow.tolist()}
        black = {"type": "diffuse", "reflectance": _rgb((0.0, 0.0, 0.0))}
        where = [float(random.uniform(-1.5, 1.5)), 2.4, float(random.uniform(-1.0, 1.0))]
        self.add(ball(where, 0.5), lamp, {"bsdf": black, "emitter": {"type": "area", "radiance": _rgb(glow)}})
        if not self.outside and random.random() < 0.6:  # fog about a point has noise without bounds
            intensity = random.uniform(3.0, 9.0, 3)
            at = [float(random.choice([-3.0, 3.0])), 0.6, 1.0]
            self.ours["lights"].append({"kind": "point", "position": at, "intensity": intensity.tolist()})
            self.theirs["point"] = {"type": "point", "position": at, "intensity": _rgb(intensity)}
        if not self.outside:
            sky = random.uniform(0.1, 1.0, 3)
            self.ours["environment"] = {"kind": "constant", "radiance": sky.tolist()}
            self.theirs["sky"] = {"type": "constant", "radiance": _rgb(sky)}


def fields(picture: Array) -> Array:
    """Return the mean of each field of a picture, and of the whole: (fields + 1, 3)."""
    step = SIDE // FIELDS
    parts = picture.reshape(FIELDS, step, FIELDS, step, 3).mean(axis=(1, 3)).reshape(-1, 3)
    return np.concatenate([parts, parts.mean(axis=0, keepdims=True)])


def compare(ours: Array, theirs: Array) -> dict[str, float]:
    """Return how two stacks of batches (batches, fields + 1, 3) differ, in noise and in parts of the mean."""
    means = [side.mean(axis=0) for side in (ours, theirs)]
    noise = np.sqrt(sum(side.var(axis=0, ddof=1) / len(side) for side in (ours, theirs)) + (ROUNDING * means[1]) ** 2)
    difference = means[0] - means[1]
    return {
        "z": float(np.abs(difference / noise).max()),
        "difference": float(np.abs(difference[-1] / means[1][-1]).max()),
        "noise": float((noise[-1] / means[1][-1]).max()),
    }


def largest_z(comparisons: int, batches: int) -> float:
    """Return the largest number of standard errors that chance allows among so many, for noise from so few batches."""
    tail = 1 - (1 - CHANCE) ** (1 / comparisons)
    z = NormalDist().inv_cdf(1 - tail / 2)
    freedom = 2 * (batches - 1)  # Cornish and Fisher's expansion of Student's t
    return z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)


def main() -> None:
    """Print a row for each scene; exit with 1 where one differs."""
    parser = arguments(str(__doc__).partition("\n")[0])
    parser.add_argument("--seeds", nargs="+", default=["1-12", "101-110", "201-208", "301-306", "401-406"])
    parser.add_argument("--batches", type=int, default=200, help="at most")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--noise", type=float, default=0.0025, help="of the difference of the means, at which to stop")
    parser.add_argument("--mitsuba-python", default=sys.executable, metavar="PATH")
    options = parser.parse_args()
    if options.quick:
        options.seeds, options.batches, options.spp = ["1"], 4, 16
    worker = Worker(options.mitsuba_python, "benchmarks.mitsuba_worker")
    facts = machine(choose_device(options.device)) | {"mitsuba": worker.description}
    print_machine(facts)
    ends = [[int(end) for end in span.split("-")] for span in options.seeds]
    seeds = [seed for span in ends for seed in range(span[0], span[-1] + 1)]
    rows, found = [], []
    for seed in seeds:
        draw = Draw(seed)
        worker.ask(do="load", description=draw.theirs, **{"as": "scene"})
        ours, theirs = [], []
        for batch in range(options.batches):
            picture = rptcam_cl.render(draw.ours, spp=options.spp, seed=1000 * seed + batch, device=options.device)
            ours.append(fields(np.asarray(picture, np.float64)))
            theirs.append(fields(_theirs(worker, options.spp, 1000 * seed + batch)))
            if batch + 1 >= FEWEST and compare(np.array(ours), np.array(theirs))["noise"] < options.noise:
                break
        result = compare(np.array(ours), np.array(theirs))
        limit = largest_z(len(seeds) * (FIELDS**2 + 1) * 3, len(ours))
        agrees = result["z"] < limit and (result["noise"] < RESOLVED or options.quick)
        found.append(result | {"seed": seed, "batches": len(ours), "largest": limit, "agrees": agrees})
        said = [f"{100 * result[name]:.2f} %" for name in ("difference", "noise")]
        rows.append([str(seed), str(len(ours)), *said, f"{result['z']:.1f} of {limit:.1f}", "yes" if agrees else "no"])
        print("  ".join(rows[-1]), flush=True)
    worker.close()
    columns = ("scene", "batches", "mean differs", "noise of that", "largest z", "agrees")
    print_table("Media beside Mitsuba", columns, rows)
    write_json(options.json, facts, found)
    if not all(each["agrees"] for each in found):
        sys.exit(1)


def _theirs(worker: Worker, spp: int, seed: int) -> Array:
    import tempfile

    with tempfile.NamedTemporaryFile(suffix=".npy") as file:
        worker.ask(do="render", spp=spp, seed=seed, save=file.name, **{"as": "scene"})
        return np.asarray(np.load(file.name), np.float64)


if __name__ == "__main__":
    main()
