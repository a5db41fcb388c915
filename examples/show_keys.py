"""Render a small picture of each shape, material, texture, light, environment, camera and opening of scene files.

The page of all keys shows them (docs/site/key_reference.py). Run in the folder above:
python examples/show_keys.py [MODEL …]
"""

import shutil
import struct
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

import rptcam_cl
from rptcam_cl.scene.assets.measured import directions

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "images" / "keys"
SIZE = (240, 160)
SAMPLES = 64
APART = 12.0  # [m] between the things of a stage, so that no picture shows two
Keys = dict[str, Any]

GREY: Keys = {"kind": "matte", "reflectance": 0.35}
ORANGE = [0.75, 0.3, 0.08]
ROOM: Keys = {"kind": "image", "file": "room.hdr", "rotation_degrees": 60}
SUN: Keys = {"kind": "sun", "direction": [1, -1.2, -0.6], "irradiance": 1.5, "diameter_degrees": 8}
EYE, TARGET = [0.7, 1.15, 3.2], [0, 0.45, 0]
HORIZON = 1.0  # [m], the height of the target that shows where a plane ends

SHAPES: dict[str, Keys] = {
    "Sphere": {"shape": "sphere", "center": [0, 0.5, 0], "radius": 0.5},
    "Box": {"shape": "box", "min": [-0.45, 0, -0.4], "max": [0.45, 0.75, 0.4]},
    "Disk": {"shape": "disk", "center": [0, 0.5, 0], "normal": [0.3, 0.5, 1], "radius": 0.5},
    "Rectangle": {"shape": "rectangle", "corner": [-0.6, 0.1, 0.1], "edge_u": [1.2, 0, 0], "edge_v": [0, 0.8, -0.4]},
    "Cylinder": {"shape": "cylinder", "base": [0, 0, 0], "top": [0, 0.85, 0], "radius": 0.4},
    "Cone": {"shape": "cone", "base": [0, 0, 0], "apex": [0, 1, 0], "radius": 0.5},
    "MeshObject": {"shape": "mesh", "file": "knot.ply", "normals": "smooth", "transform": [
        {"scale": 0.000135}, {"rotate": {"axis": [1, 0, 0], "degrees": 68}}, {"translate": [0, 0.5, 0]}]},
    "Board": {"shape": "board", "kind": "charuco", "columns": 7, "rows": 5, "pitch": 0.15,
              "transform": {"translate": [0, 0.5, 0]}},
}  # fmt: skip

MATERIALS: dict[str, Keys] = {
    "Matte": {"kind": "matte", "reflectance": ORANGE},
    "Translucent": {"kind": "translucent", "reflectance": [0.2, 0.3, 0.1], "transmittance": [0.4, 0.55, 0.1]},
    "Plastic": {"kind": "plastic", "reflectance": ORANGE, "roughness": 0.25},
    "Conductor": {"kind": "conductor", "metal": "copper", "roughness": 0.35},
    "Mirror": {"kind": "mirror", "reflectance": 0.9},
    "Dielectric": {"kind": "dielectric", "index": 1.5},
    "ThinGlass": {"kind": "thin_glass", "transmittance": [0.75, 0.9, 0.8]},
    "Principled": {"kind": "principled", "base_color": [0.05, 0.2, 0.5], "roughness": 0.6, "clearcoat": 1},
    "Mix": {"kind": "mix", "factor": {"kind": "checker", "even": 0, "odd": 1, "scale": [12, 6]}, "materials": [
        {"kind": "matte", "reflectance": [0.1, 0.25, 0.12]}, {"kind": "conductor", "metal": "gold", "roughness": 0.3}]},
    "Emissive": {"kind": "emissive", "radiance": [6, 4, 2]},
}  # fmt: skip

DARK, PALE = [0.08, 0.16, 0.3], [0.8, 0.75, 0.6]
FINE: Keys = {"mapping": {"matrix": [[5, 0, 0, 0], [0, 5, 0, 0], [0, 0, 5, 0]]}}
TEXTURES: dict[str, Keys] = {
    "Checker": {"kind": "checker", "even": DARK, "odd": PALE, "scale": [16, 8]},
    "Grid": {"kind": "grid", "background": PALE, "line": DARK, "line_width": 0.15, "scale": [16, 8]},
    "Gradient": {"kind": "gradient", "start": DARK, "end": PALE, "scale": [4, 1]},
    "Noise": {"kind": "noise", "low": DARK, "high": PALE, "scale": [9, 5], "contrast": 1.6},
    "Perlin": {"kind": "perlin", "form": "turbulence", "low": DARK, "high": PALE, **FINE},
    "Marble": {"kind": "marble", "variation": 3.0, **FINE},
    "Dots": {"kind": "dots", "inside": ORANGE, "outside": PALE, "scale": [14, 7]},
    "Mixture": {
        "kind": "mixture",
        "first": {"kind": "marble", "variation": 3.0, **FINE},
        "second": ORANGE,
        "amount": {"kind": "dots", "inside": 1, "outside": 0, "scale": [14, 7]},
    },
    "ImageTexture": {"kind": "image", "file": "wood.jpg", "scale": [2, 1]},
}
WEAVE: Keys = {"file": "weave.png", "filter": "nearest", "scale": [8, 4]}
BUMPS: Keys = {"file": "tiles_normals.png", "scale": [8, 4]}

LIGHTS: dict[str, Keys] = {
    "PointLight": {"kind": "point", "position": [-0.8, 1.2, 0.8], "intensity": 3},
    "SpotLight": {"kind": "spot", "position": [-0.6, 2, 1], "direction": [0.3, -0.8, -0.5], "intensity": 14,
                  "outer_degrees": 22},
    "DirectionalLight": {"kind": "directional", "direction": [1, -1.2, -0.6], "irradiance": 2.5},
    "SunLight": {"kind": "sun", "direction": [1, -1.2, -0.6], "irradiance": 2.5, "diameter_degrees": 8},
    "ProfileLight": {"kind": "ies", "file": "luminaire.ies", "position": [-0.5, 2.3, 1], "gain": 12},
}  # fmt: skip

ENVIRONMENTS: dict[str, Keys] = {
    "ConstantEnvironment": {"kind": "constant", "radiance": 0.7},
    "GradientEnvironment": {"kind": "gradient", "bottom": [0.5, 0.3, 0.2], "top": [0.2, 0.4, 0.9]},
    "ImageEnvironment": ROOM,
    "SkyEnvironment": {"kind": "sky", "sun_elevation_degrees": 25, "sun_azimuth_degrees": 100},
}

SEEN: Keys = {"eye": [0.1, 0.5, 2.2], "target": [0, 0.3, 0]}
THIN: Keys = {"kind": "thin_lens", "fov_degrees": 40}
CAMERAS: dict[str, Keys] = {
    "PinholeCamera": {"kind": "pinhole", "fov_degrees": 40, **SEEN},
    "OrthographicCamera": {"kind": "orthographic", "width_m": 2.4, **SEEN},
    "ThinLensCamera": {**THIN, "aperture_radius_m": 0.06, "focus_distance_m": 2.2, **SEEN},
    "ThickLensCamera": {"kind": "thick_lens", "lens": "dgauss-50mm", "focus": {"distance_m": 2.2}, **SEEN},
    "RealisticCamera": {"kind": "realistic", "lens": "fisheye-10mm", "focus": {"distance_m": 1}, **SEEN,
                        "eye": [0.1, 0.5, 1.2]},
    "EnvironmentCamera": {"kind": "environment", "eye": [0, 0.6, 1], "target": [0, 0.6, 0]},
}  # fmt: skip

CROSS = [[-1, -0.3], [-0.3, -0.3], [-0.3, -1], [0.3, -1], [0.3, -0.3], [1, -0.3], [1, 0.3], [0.3, 0.3], [0.3, 1],
         [-0.3, 1], [-0.3, 0.3], [-1, 0.3]]  # fmt: skip
OPENINGS: dict[str, Keys] = {
    "CircularAperture": {"shape": "circle"},
    "PolygonAperture": {"shape": "polygon", "blades": 6},
    "StarAperture": {"shape": "star"},
    "HeartAperture": {"shape": "heart"},
    "OutlineAperture": {"shape": "outline", "points": CROSS},
    "ImageAperture": {"shape": "image", "file": "opening.png"},
}


def models() -> set[str]:
    """Return the models that have a picture."""
    return {*stage(), "Plane", *(name for name, _ in scenes())}


def stage() -> dict[str, Keys]:
    """Return what stands on the stage, each by its model and at its own origin."""
    things = {name: {"material": {"kind": "matte", "reflectance": ORANGE}, **keys} for name, keys in SHAPES.items()}
    del things["Board"]["material"]
    for name, material in MATERIALS.items():
        things[name] = {**SHAPES["Sphere"], "material": material}
    for name, texture in TEXTURES.items():
        things[name] = {**SHAPES["Sphere"], "material": {"kind": "matte", "reflectance": texture}}
    coated = {"kind": "plastic", "reflectance": [0.3, 0.32, 0.35], "roughness": 0.3, "normal_map": BUMPS}
    things["NormalMap"] = {**SHAPES["Sphere"], "material": coated}
    woven = {"kind": "principled", "base_color": 0.5, "metallic": 1, "roughness": 0.35, "anisotropy_map": WEAVE}
    things["AnisotropyMap"] = {**SHAPES["Sphere"], "material": woven}
    return things


def placed(thing: Keys, x: float) -> Keys:
    """Return a thing moved along x [m]."""
    steps = thing.get("transform", [])
    steps = steps if isinstance(steps, list) else [steps]
    return {**thing, "transform": [*steps, {"translate": [x, 0, 0]}]}


def scene_of(objects: list[Keys], **more: Any) -> Keys:
    """Return a scene on a grey floor."""
    floor = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 1, 0], "material": GREY}
    return {
        "film": {"resolution": list(SIZE)},
        "camera": {"kind": "pinhole", "fov_degrees": 32, "eye": EYE, "target": TARGET},
        "render": {"max_depth": 8, "layers": ["albedo", "normal"]},
        "objects": [floor, *objects],
        **more,
    }


def ball(x: float, z: float, radius: float, material: Keys) -> Keys:
    """Return a ball on the floor."""
    return {"shape": "sphere", "center": [x, radius, z], "radius": radius, "material": material}


def balls() -> list[Keys]:
    """Return three balls, the middle one in focus."""
    colours = ([0.6, 0.05, 0.03], ORANGE, [0.04, 0.14, 0.4])
    red, orange, blue = ({"kind": "plastic", "reflectance": colour} for colour in colours)
    return [ball(-0.45, 0.7, 0.2, red), ball(0, 0, 0.3, orange), ball(0.9, -1.6, 0.4, blue)]


def lamps() -> list[Keys]:
    """Return lamps far behind what is in focus."""
    return [
        {"shape": "sphere", "center": [0.9 * column, 0.55 + 0.75 * row, -4], "radius": 0.03,
         "material": {"kind": "emissive", "radiance": colour}}
        for row in (0, 1)
        for column, colour in zip((-1, 0, 1), ([60, 25, 6], [50, 45, 40], [10, 30, 70]), strict=True)
    ]  # fmt: skip


def tuft(count: int, width: float, spread: float) -> Keys:
    """Return strands that stand on a spot of the floor and fall apart."""
    rng = np.random.default_rng(5)
    roots, lean = 0.3 * rng.normal(size=(count, 2)).clip(-1.5, 1.5), spread * rng.normal(size=(count, 2))
    heights, rows = rng.uniform(0.5, 0.9, count), np.zeros((count, 4, 4))
    for k, share in enumerate((0, 0.4, 0.75, 1)):
        rows[:, k, [0, 2]] = roots * (1 + share) + lean * share**2 * 2
        rows[:, k, 1] = heights * share * (1.35 - 0.5 * share)
        rows[:, k, 3] = width * (1 - 0.9 * share)
    return {"shape": "curves", "points": rows.reshape(-1, 4).tolist(), "counts": [4] * count}


def scenes() -> Iterator[tuple[str, Keys]]:
    """Yield the scene of each model that is not on the stage."""
    dim = {"kind": "constant", "radiance": 0.02}
    for name, light in LIGHTS.items():
        yield name, scene_of([ball(0, 0, 0.5, MATERIALS["Matte"])], lights=[light], environment=dim)
    smoke = {"kind": "boundary", "interior": {"scattering_per_m": 5, "absorption_per_m": [0.3, 1.5, 3]}}
    yield "Boundary", scene_of([ball(0, 0, 0.5, smoke)], environment={**ROOM, "gain": 0.5}, lights=[SUN])
    satin = {"kind": "measured", "file": "satin.binary"}
    yield "Measured", scene_of([ball(0, 0, 0.5, satin)], environment={**ROOM, "gain": 0.5}, lights=[SUN])
    grass = {"kind": "translucent", "reflectance": [0.08, 0.2, 0.03], "transmittance": [0.06, 0.15, 0.02]}
    blades = tuft(250, 0.025, 0.25) | {"form": "flat", "material": grass}
    yield "Curves", scene_of([blades], environment=ROOM, lights=[SUN])
    brown = {"kind": "hair", "eumelanin": 0.7, "pheomelanin": 0.2}
    yield "Hair", scene_of([tuft(1500, 0.006, 0.1) | {"material": brown}], environment=ROOM, lights=[SUN])
    pair = [ball(0.35, 0, 0.5, MATERIALS["Mirror"]), ball(-0.8, 0.1, 0.4, GREY)]
    for name, environment in ENVIRONMENTS.items():
        yield name, scene_of(pair, environment=environment, exposure="auto")
    for name, camera in CAMERAS.items():
        height = SIZE[0] // 2 if camera["kind"] == "environment" else SIZE[1]
        film = {"resolution": [SIZE[0], height]}
        yield name, scene_of(balls(), environment=ROOM, camera=camera, film=film)
    for name, opening in OPENINGS.items():
        camera = {**THIN, "aperture_radius_m": 0.09, "focus_distance_m": 1.5, "aperture": opening}
        camera |= {"eye": [0, 0.8, 2], "target": [0, 0.8, 0]}
        yield name, scene_of(lamps(), environment=dim, camera=camera)


def satin() -> bytes:
    """Return a table as MERL has them: a red base that shines bluish where light grazes it."""
    sizes, scale = (90, 90, 180), np.array([1, 1.15, 1.66]) / 1500
    one, other = directions(sizes)
    half = (one + other) / np.linalg.norm(one + other, axis=-1, keepdims=True)
    gloss = np.exp(-np.square(np.arccos(half[..., 2]) / 0.35))
    grazing = (1 - np.sum(one * half, axis=-1)) ** 3
    values = np.array([0.12, 0.01, 0.02]) + (gloss * (0.1 + grazing))[..., None] * np.array([0.6, 0.7, 1.0])
    return struct.pack("<3i", *sizes) + np.moveaxis(values / scale, -1, 0).tobytes()


def files(folder: Path) -> None:
    """Put the files that the scenes name beside them."""
    for name in ("room.hdr", "knot.ply", "wood.jpg", "tiles_normals.png"):
        shutil.copy(ROOT / "examples" / "studio" / name, folder)
    shutil.copy(ROOT / "tests" / "data" / "luminaire.ies", folder)
    (folder / "satin.binary").write_bytes(satin())
    opening = Image.new("L", (64, 64))
    draw = ImageDraw.Draw(opening)
    draw.ellipse((2, 2, 61, 61), fill=255)
    draw.ellipse((18, 18, 45, 45), fill=0)
    opening.save(folder / "opening.png")
    weave = Image.new("RGB", (2, 2), (255, 128, 200))  # threads along u, and along v
    for place in ((0, 0), (1, 1)):
        weave.putpixel(place, (128, 255, 200))
    weave.save(folder / "weave.png")


def save(name: str, image: rptcam_cl.Image) -> None:
    """Write a picture, denoised."""
    image.denoised().save(FOLDER / f"{name}.jpg")
    print(name, flush=True)


def show_stage(folder: Path, wanted: list[str]) -> None:
    """Render what stands on the stage, by one session, whose camera goes from thing to thing."""
    things = stage()
    row = [placed(thing, APART * index) for index, thing in enumerate(things.values())]
    scene = rptcam_cl.load_scene(scene_of(row, environment={**ROOM, "gain": 0.5}, lights=[SUN]), base_dir=folder)
    with rptcam_cl.RenderSession(scene) as session:
        for index, name in enumerate([*things, "Plane"]):  # beside the last is the floor alone, a plane
            if not wanted or name in wanted:
                x, aim = APART * index, HORIZON if name == "Plane" else TARGET[1]
                session.change({"camera.eye": [EYE[0] + x, *EYE[1:]], "camera.target": [TARGET[0] + x, aim, TARGET[2]]})
                session.add(SAMPLES)
                save(name, session.image())


def main(wanted: list[str]) -> None:
    """Render the pictures of some models, or of all."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as kept:
        folder = Path(kept)
        files(folder)
        if not wanted or {*wanted} & {*stage(), "Plane"}:
            show_stage(folder, wanted)
        for name, keys in scenes():
            if not wanted or name in wanted:
                save(name, rptcam_cl.render(rptcam_cl.load_scene(keys, base_dir=folder), spp=SAMPLES))


if __name__ == "__main__":
    main(sys.argv[1:])
