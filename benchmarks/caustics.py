"""Caustics by photons and by paths: errors at equal processor time, the bias, and the pictures of docs/caustics.md.

    python -m benchmarks.caustics [--seeds 4] [--spp 64] [--scenes NAME ...] [--pictures FOLDER] [--json FILE]

A name that ends in .yaml is a scene file, at its own shape and no wider than 160 pixels.

The error is that of pictures against a reference by photons of a third of the radius, with 32 times the samples and
seeds of its own: squared, divided per pixel by the square of the reference (plus that of a tenth of its mean). Its mean
over the picture times the processor time is what equal time compares. The bias is the error of the mean over the seeds
less their noise; `light` is how much more light of the picture photons bring than paths, over the error of that.

The second table has the same of the median pixel, of classes of pixels by how much of their light photons bring: an
error is the mean over seeds, that of a class the median of its pixels.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Bitmap

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import render_samples, wavefront_of
from benchmarks.stopwatch import timed
from rptcam_cl.api.job import resolve
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import photon_map
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

GLASS = {"kind": "dielectric", "index": 1.5}
WOOD = {"kind": "matte", "reflectance": [0.55, 0.42, 0.3]}
WALL = {"kind": "matte", "reflectance": 0.7}
TABLE = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": WOOD}
UPRIGHT = {"kind": "pinhole", "up": [0, 0, 1]}
SIZE = (240, 160)
Film = NDArray[np.float64]


def revolved(profile: list[tuple[float, float]], around: int = 360) -> dict[str, Any]:
    """Return vertices and faces of a closed profile (radius, height), from the axis to the axis, turned about z."""
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)
    rings = [[(r * np.cos(t), r * np.sin(t), z) for t in turn] for r, z in profile[1:-1]]
    vertices = [(0.0, 0.0, profile[0][1]), *(place for ring in rings for place in ring), (0.0, 0.0, profile[-1][1])]
    faces, after = [], [(k + 1) % around for k in range(around)]
    for k in range(around):
        faces.append([0, 1 + after[k], 1 + k])
        last = 1 + (len(rings) - 1) * around
        faces.append([len(vertices) - 1, last + k, last + after[k]])
        for ring in range(len(rings) - 1):
            low, high = 1 + ring * around, 1 + (ring + 1) * around
            faces += [[low + k, low + after[k], high + k], [low + after[k], high + after[k], high + k]]
    return {"shape": "mesh", "vertices": [list(map(float, place)) for place in vertices], "faces": faces}


def sheet(*numbers: float, material: dict[str, Any]) -> dict[str, Any]:
    """Return a parallelogram by its corner and both edges, three numbers each."""
    corner, u, v = (list(numbers[k : k + 3]) for k in (0, 3, 6))
    return {"shape": "rectangle", "corner": corner, "edge_u": u, "edge_v": v, "material": material}


def lamp(place: list[float], radius: float, radiance: float) -> dict[str, Any]:
    """Return a ball that shines."""
    material = {"kind": "emissive", "radiance": [radiance, 0.9 * radiance, 0.75 * radiance]}
    return {"shape": "sphere", "center": place, "radius": radius, "material": material}


def rings() -> dict[str, Any]:
    """Return a tumbler, a ball of glass and a ring of brass on a table, by a lamp of 3 cm, through a double Gauss."""
    tumbler = [(0, 0.0), (0.03, 0.0), (0.032, 0.002), (0.037, 0.09), (0.0345, 0.09), (0.030, 0.012), (0, 0.012)]
    brass = {"kind": "mirror", "reflectance": [0.9, 0.7, 0.35]}
    camera = {"kind": "realistic", "lens": "dgauss-50mm", "eye": [0.05, -0.75, 0.5], "target": [0, -0.01, 0.01]}
    return {
        "camera": {**camera, "up": [0, 0, 1], "focus": {"point": [0, -0.03, 0.0]}},
        "film": {"width_mm": 24},
        "objects": [
            TABLE,
            {**revolved(tumbler), "material": GLASS, "transform": [{"translate": [-0.08, 0.03, 0.0005]}]},
            {"shape": "sphere", "center": [0.09, -0.02, 0.031], "radius": 0.03, "material": GLASS},
            {"shape": "cylinder", "base": [0.01, -0.09, 0.001], "top": [0.01, -0.09, 0.015], "radius": 0.03,
             "capped": False, "material": brass},
            lamp([0.35, 0.45, 0.6], 0.015, 1500.0),
        ],
        "environment": {"kind": "constant", "radiance": 0.05},
    }  # fmt: skip


def pane() -> dict[str, Any]:
    """Return a room behind a solid pane of 6 mm in a wall; the only lamp, of 8 cm, hangs outside."""
    wall = {"kind": "matte", "reflectance": [0.7, 0.68, 0.62]}

    board = partial(sheet, material=wall)

    around = [
        board(-2, 2, 0, 4, 0, 0, 0, 0, 2.5),
        board(2, -2, 0, 0, 4, 0, 0, 0, 2.5),
        board(-2, -2, 2.5, 4, 0, 0, 0, 4, 0),
    ]
    holed = [board(-2, -2, 0, 0, 1.4, 0, 0, 0, 2.5), board(-2, 0.6, 0, 0, 1.4, 0, 0, 0, 2.5),
             board(-2, -0.6, 0, 0, 1.2, 0, 0, 0, 0.8), board(-2, -0.6, 2.0, 0, 1.2, 0, 0, 0, 0.5)]  # fmt: skip
    return {
        "camera": {**UPRIGHT, "fov_degrees": 60, "eye": [0.6, -1.9, 1.4], "target": [-0.2, 1, 0.9]},
        "objects": [
            TABLE, board(-2, -2, 0, 4, 0, 0, 0, 0, 2.5), *around, *holed,
            {"shape": "box", "min": [-2.003, -0.6, 0.8], "max": [-1.997, 0.6, 2.0], "material": GLASS},
            {"shape": "sphere", "center": [0.2, 0.6, 0.4], "radius": 0.4, "material": WALL},
            lamp([-4.5, -0.8, 3.2], 0.08, 1500.0),
        ],
    }  # fmt: skip


def mirror() -> dict[str, Any]:
    """Return a corner with a round mirror that throws the light of a lamp of 8 cm onto the walls."""
    wall = {"shape": "rectangle", "corner": [-2, 1, 0], "edge_u": [4, 0, 0], "edge_v": [0, 0, 3], "material": WALL}
    glass = {"kind": "mirror", "reflectance": 0.9}
    return {
        "camera": {**UPRIGHT, "fov_degrees": 45, "eye": [0, -3, 1.4], "target": [0, 0.5, 0.7]},
        "objects": [
            TABLE, wall,
            {"shape": "disk", "center": [-0.6, 0.3, 0.5], "normal": [0.5, -0.3, 0.6], "radius": 0.3, "material": glass},
            {"shape": "cylinder", "base": [0.5, 0.2, 0.0], "top": [0.5, 0.2, 0.4], "radius": 0.2, "material": glass},
            lamp([-0.8, -1.0, 2.4], 0.04, 600.0),
        ],
    }  # fmt: skip


def glass_of_water() -> dict[str, Any]:
    """Return a glass of water on a table in a closed room, by a lamp of 6 cm below its ceiling."""
    white = {"kind": "matte", "reflectance": [0.75, 0.75, 0.72]}
    glass = [(0, 0.75), (0.035, 0.75), (0.04, 0.87), (0.038, 0.87), (0.033, 0.755), (0, 0.755)]
    water = [(0, 0.7549), (0.03301, 0.7549), (0.0367, 0.84), (0, 0.84)]
    camera = {**UPRIGHT, "fov_degrees": 32, "eye": [0.35, -0.75, 1.2], "target": [0.02, 0.05, 0.77]}

    board = partial(sheet, material=white)

    return {
        "camera": camera,
        "objects": [
            board(-2, -2, 0, 4, 0, 0, 0, 4, 0), board(-2, -2, 2.5, 0, 4, 0, 4, 0, 0),
            board(-2, 2, 0, 4, 0, 0, 0, 0, 2.5), board(-2, -2, 0, 0, 0, 2.5, 4, 0, 0),
            board(-2, -2, 0, 0, 4, 0, 0, 0, 2.5), board(2, -2, 0, 0, 0, 2.5, 0, 4, 0),
            {"shape": "box", "min": [-0.7, -0.45, 0.71], "max": [0.7, 0.45, 0.7495], "material": WOOD},
            {**revolved(glass), "material": GLASS},
            {**revolved(water), "material": {"kind": "dielectric", "index": 1.33}},
            lamp([-0.9, 0.9, 2.2], 0.03, 1500.0),
        ],
    }  # fmt: skip


def window() -> dict[str, Any]:
    """Return a tumbler and a ball of glass on a table, by a window of 3 x 1.6 m through which the sun shines."""
    white = {"kind": "matte", "reflectance": [0.75, 0.75, 0.72]}
    tumbler = [(0, 0.75), (0.03, 0.75), (0.032, 0.752), (0.037, 0.84), (0.0345, 0.84), (0.030, 0.762), (0, 0.762)]

    board = partial(sheet, material=white)

    return {
        "camera": {**UPRIGHT, "fov_degrees": 32, "eye": [0.9, 0.0, 1.2], "target": [-0.1, 0.05, 0.77]},
        "objects": [
            board(-2, -2, 0, 4, 0, 0, 0, 4, 0), board(-2, -2, 2.5, 0, 4, 0, 4, 0, 0),
            board(-2, 2, 0, 4, 0, 0, 0, 0, 2.5), board(-2, -2, 0, 0, 0, 2.5, 4, 0, 0),
            board(2, -2, 0, 0, 0, 2.5, 0, 4, 0), board(-2, -2, 0, 0, 4, 0, 0, 0, 0.6),
            board(-2, -2, 2.2, 0, 4, 0, 0, 0, 0.3),
            board(-2, -2, 0.6, 0, 0.5, 0, 0, 0, 1.6), board(-2, 1.5, 0.6, 0, 0.5, 0, 0, 0, 1.6),
            board(-2, -1.5, 0.6, 0, 3, 0, 0, 0, 1.6, material={"kind": "thin_glass"}),
            {"shape": "box", "min": [-0.5, -0.45, 0.71], "max": [0.5, 0.45, 0.7495], "material": WOOD},
            {**revolved(tumbler), "material": GLASS},
            {"shape": "sphere", "center": [0.1, 0.2, 0.781], "radius": 0.03, "material": GLASS},
        ],
        "lights": [{"kind": "sun", "direction": [2, 0, -1], "irradiance": 30.0, "diameter_degrees": 0.53}],
        "environment": {"kind": "constant", "radiance": [0.4, 0.5, 0.7]},
    }  # fmt: skip


SCENES = {"rings": rings, "pane": pane, "mirror": mirror, "glass_of_water": glass_of_water, "window": window}
# Classes of pixels, by the least share of their light that photons bring.
CLASSES = {"none": 0.0, "to 1 %": 1e-6, "to 10 %": 0.01, "more": 0.1}


def scene_of(name: str, size: tuple[int, int], caustics: str, session: Session) -> Scene:
    """Return a scene with caustics by photons ("on") or by paths ("off")."""
    if name not in SCENES:
        scene = load_scene(name)
        width, height = scene.film.resolution
        across = min(160, width)
        small = change_scene(scene, film={"resolution": (across, round(across * height / width))})
        return change_scene(resolve(small, session).scene, render={"caustics": caustics, "noise": None})
    made = SCENES[name]()
    film = {"resolution": list(size)} | made.pop("film", {})
    return load_scene(made | {"film": film, "render": {"max_depth": 8, "caustics": caustics}})


def render(wavefront: Wavefront, seed: int, spp: int) -> tuple[Film, float]:
    """Return a picture and the processor time that it took [s]."""
    wavefront.seed = seed
    wavefront.clear()
    seconds = timed(lambda: render_samples(wavefront, spp)).cpu
    return wavefront.picture(spp).astype(np.float64), seconds


def reference_of(scene: Scene, session: Session, spp: int) -> Film:
    """Return a picture by photons of a third of the radius."""
    usual = photon_map.FIRST_PHOTONS
    photon_map.FIRST_PHOTONS = usual / 9
    try:
        return render(wavefront_of(scene, session), 1000, spp)[0]
    finally:
        photon_map.FIRST_PHOTONS = usual


def error_of(picture: Film, reference: Film) -> float:
    """Return the mean relative squared error of a picture."""
    floor = (0.1 * reference.mean()) ** 2
    return float(((picture - reference) ** 2 / (reference**2 + floor)).mean())


def shares_of_photons(scene: Scene, session: Session, spp: int) -> NDArray[np.float64]:
    """Return the share of each pixel's light that photons bring, by pictures with and without, of the same paths."""
    trace = photon_map.PhotonMap._trace
    whole = render(wavefront_of(scene, session), 1, spp)[0].sum(axis=-1)
    photon_map.PhotonMap._trace = lambda *given, **named: [part[:0] for part in trace(*given, **named)]
    try:
        paths = render(wavefront_of(scene, session), 1, spp)[0].sum(axis=-1)
    finally:
        photon_map.PhotonMap._trace = trace
    return (whole - paths) / np.maximum(whole, 1e-12)


def classes_of(films: dict[str, Film], reference: Film, shares: NDArray[np.float64], slower: float) -> dict[str, float]:
    """Return the gain at equal time of the median pixel: of all, and of each class of a hundredth or more."""
    floor = (0.1 * reference.mean()) ** 2
    errors = {way: ((film - reference) ** 2 / (reference**2 + floor)).mean(axis=(0, 3)) for way, film in films.items()}
    number = np.digitize(shares, list(CLASSES.values())[1:])
    groups = {"all": number >= 0} | {name: number == k for k, name in enumerate(CLASSES)}
    return {
        f"gain {name}": float(np.median(errors["off"][group]) / (slower * np.median(errors["on"][group])))
        for name, group in groups.items() if group.mean() > 0.01
    }  # fmt: skip


def measured(name: str, session: Session, size: tuple[int, int], spp: int, seeds: int) -> dict[str, float]:
    """Return errors and times of both ways, their products, and the bias of photons."""
    lit = scene_of(name, size, "on", session)
    reference = reference_of(lit, session, 32 * spp)
    found, films = {}, {}
    for way in ("off", "on"):
        wavefront = wavefront_of(scene_of(name, size, way, session), session)
        results = [render(wavefront, seed, spp) for seed in range(seeds)]
        films[way] = np.array([film for film, _ in results])
        found[f"error {way}"] = float(np.mean([error_of(film, reference) for film in films[way]]))
        found[f"seconds {way}"] = float(np.mean([seconds for _, seconds in results]))
    mean, noise = films["on"].mean(axis=0), films["on"].var(axis=0, ddof=1) / seeds
    floor = (0.1 * reference.mean()) ** 2
    found["bias2"] = error_of(mean, reference) - float((noise / (reference**2 + floor)).mean())
    light = {way: film.mean(axis=(1, 2, 3)) for way, film in films.items()}
    spread = np.sqrt(sum(part.var(ddof=1) / seeds for part in light.values()))
    found["light"] = float((light["on"].mean() - light["off"].mean()) / spread)
    slower = found["seconds on"] / found["seconds off"]
    found["gain"] = found["error off"] / (found["error on"] * slower)
    return found | classes_of(films, reference, shares_of_photons(lit, session, spp), slower)


def save_pictures(name: str, session: Session, size: tuple[int, int], spp: int, folder: Path) -> tuple[int, int]:
    """Save both ways beside each other at equal processor time; return the samples of each."""
    ways = {way: wavefront_of(scene_of(name, size, way, session), session) for way in ("off", "on")}
    picture, seconds = render(ways["on"], 1, spp)
    _, once = render(ways["off"], 1, spp)
    paths = max(round(spp * seconds / once), 1)
    films = [render(ways["off"], 1, paths)[0], picture]
    white = float(np.quantile(picture.max(axis=-1), 0.98))
    shown = [np.clip(film / white, 0, 1) ** (1 / 2.2) for film in films]
    gap = np.ones((len(picture), 6, 3))
    Bitmap.fromarray((np.hstack([shown[0], gap, shown[1]]) * 255 + 0.5).astype(np.uint8)).save(
        folder / f"caustics_{Path(name).stem}.png"
    )
    return paths, spp


def main() -> None:
    """Measure the scenes and print the table."""
    parser = arguments("Caustics by photons and by paths.")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), metavar="NAME")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    if unknown := [name for name in options.scenes if name not in SCENES and not name.endswith(".yaml")]:
        parser.error(f"--scenes: {unknown[0]} is neither a .yaml file nor one of {', '.join(SCENES)}")
    device = choose_device(options.device)
    session, facts = Session(device), machine(device)
    size, spp, seeds = ((24, 16), 4, 2) if options.quick else (SIZE, options.spp, options.seeds)
    print_machine(facts)
    results = {name: measured(name, session, size, spp, seeds) for name in options.scenes}
    rows = [
        [name, f"{r['error off']:.3g}", f"{r['seconds off']:.2f}", f"{r['error on']:.3g}", f"{r['seconds on']:.2f}",
         f"{r['gain']:.3g}", f"{r['bias2']:.2g}", f"{r['light']:+.1f}"]
        for name, r in results.items()
    ]  # fmt: skip
    heads = ["scene", "error, paths", "s", "error, photons", "s", "gain at equal time", "bias²", "light"]
    print_table(f"Caustics, {spp} samples a pixel", heads, rows)
    groups = ["all", *CLASSES]
    rows = [[name, *(f"{r.get(f'gain {each}', np.nan):.3g}" for each in groups)] for name, r in results.items()]
    print_table(
        "Gain of the median pixel at equal time, by the share of its light that photons bring", ["scene", *groups], rows
    )
    if options.pictures is not None:
        for name in options.scenes:
            print(name, save_pictures(name, session, (4 * size[0], 4 * size[1]), spp, options.pictures))
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
