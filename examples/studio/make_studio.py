"""Make the meshes, the pictures and the light of the scenes in this folder, from nothing but formulas.

Run in the repository: python examples/studio/make_studio.py [FOLDER]
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pictures
import shapes
from files import Gltf, write_hdr, write_ply

VASE = [(0, 0), (3, 0), (3.7, 0.3), (5, 3.5), (5.9, 7), (5.2, 11), (2.6, 13.6), (2.0, 15), (2.1, 16.4), (3.0, 17.8)]
VASE += [(2.8, 18), (1.9, 16.6), (1.7, 15), (2.2, 13.6), (4.8, 11), (5.4, 7), (4.5, 3.5), (0, 0.8)]
CUP = [(0, 0.3), (1.8, 0.3), (2.0, 0), (2.5, 0), (2.7, 0.5), (3.9, 1.7), (4.5, 4), (4.7, 6), (4.55, 6.1), (4.4, 5.9)]
CUP += [(4.2, 4), (3.6, 1.9), (2.4, 0.9), (0, 0.8)]
SAUCER = [(0, 0.2), (2.4, 0.2), (2.6, 0), (3.2, 0), (5.0, 0.7), (7.2, 1.3), (7.3, 1.45), (7.1, 1.5), (4.8, 0.95)]
SAUCER += [(3.2, 0.5), (0, 0.45)]
FLASK = [(0, 0), (2.2, 0), (2.6, 0.2), (2.7, 1.0), (2.5, 3.4), (1.3, 4.5), (0.9, 5.0), (0.9, 6.1), (1.15, 6.3)]
FLASK += [(1.1, 6.5), (0.7, 6.4), (0.65, 5.0), (1.0, 4.4), (2.2, 3.3), (2.4, 1.0), (2.2, 0.5), (0, 0.45)]

GOBLET = [(0, 0), (3.3, 0), (3.5, 0.12), (3.2, 0.3), (1.1, 0.6), (0.5, 1.2), (0.36, 3), (0.36, 7), (0.7, 8.2)]
GOBLET += [(2.6, 9.5), (3.95, 11.6), (4.1, 14), (3.7, 17), (3.15, 19.4), (3.02, 19.5)]
GOBLET += [(2.9, 19.4), (3.45, 17), (3.86, 14)]
WINE = [(0, 8.75), (0.7, 8.85), (2.45, 9.8), (3.7, 11.7), (3.86, 14)]  # the inside of the bowl, as far as it is full
TEA_GLASS = [(0, 0), (2.2, 0), (2.5, 0.15), (2.95, 1.7), (2.85, 3.2), (2.2, 5.2), (2.1, 6.3), (2.45, 8.3), (3.0, 10.1)]
TEA_GLASS += [(2.93, 10.2), (2.84, 10.1), (2.4, 8.6), (2.3, 8.25), (2.15, 8.2), (0, 8.2)]  # one body with its tea
TEA = [(0, 0.8), (1.9, 0.8), (2.6, 1.5), (2.6, 3.2), (1.95, 5.2), (1.88, 6.3), (2.2, 8.1), (2.1, 8.18), (0, 8.18)]
CANDLESTICK = [(0, 0), (4.0, 0), (4.3, 0.3), (3.7, 0.8), (1.3, 1.3), (0.7, 2.2), (1.15, 3.0), (0.6, 3.9), (0.55, 6.3)]
CANDLESTICK += [(0.9, 7.0), (1.6, 7.4), (1.65, 8.3), (1.3, 8.4), (1.25, 8.2), (0, 8.2)]
CANDLE = [(0, 0), (1.1, 0), (1.1, 6.4), (1.06, 6.7), (0.85, 6.75), (0.6, 6.5), (0, 6.42)]


def plain(base: tuple[float, ...], roughness: float, **more: Any) -> dict[str, Any]:
    """Return a material of glTF without metal."""
    look = {"baseColorFactor": [*base, 1], "roughnessFactor": roughness, "metallicFactor": 0}
    return {"pbrMetallicRoughness": look, "doubleSided": True, **more}


def textured(number: int, roughness: float, **more: Any) -> dict[str, Any]:
    """Return a material of glTF whose colour is a picture."""
    look = {"baseColorTexture": {"index": number}, "roughnessFactor": roughness, "metallicFactor": 0}
    return {"pbrMetallicRoughness": look, "doubleSided": True, **more}


def turned(y_degrees: float) -> list[float]:
    """Return the quaternion of a turn about +y."""
    half = np.radians(y_degrees) / 2
    return [0, round(float(np.sin(half)), 6), 0, round(float(np.cos(half)), 6)]


def tea_set() -> Gltf:
    """Return two cups on saucers: four nodes, two meshes."""
    gltf = Gltf(
        [textured(0, 0.22), plain((0.9, 0.88, 0.84), 0.2), plain((0.16, 0.05, 0.012), 0.05)],
        [(pictures.encoded(pictures.band(), "JPEG"), "image/jpeg")],
    )
    turn = np.linspace(-1.75, 1.45, 20)
    ring = np.stack([4.1 + 2.3 * np.cos(turn), 3.6 + 1.9 * np.sin(turn), 0 * turn], axis=-1)
    handle = shapes.tube(ring, 0.34, 12)
    tea = shapes.lathe([(0, 4.9), (4.32, 4.9)], 48, rounds=0)
    tea = shapes.Shape(tea.positions, tea.quads[:, ::-1], tea.uvs)
    cup = gltf.mesh("cup", [(shapes.lathe(CUP, 48, rounds=2), 0), (handle, 1), (tea, 2)])
    saucer = gltf.mesh("saucer", [(shapes.lathe(SAUCER, 48, rounds=2), 1)])
    for place, degrees in (([0, 0, 0], 35), ([12.5, 0, -14], 150)):
        gltf.nodes.append({"name": "saucer", "mesh": saucer, "translation": place})
        on_it = [place[0], 0.5, place[2]]
        gltf.nodes.append({"mesh": cup, "name": "cup", "translation": on_it, "rotation": turned(degrees)})
    return gltf


def bouquet() -> Gltf:
    """Return seven branches, whose leaves are cards cut out by the picture's alpha."""
    mask = textured(0, 0.45, alphaMode="MASK", alphaCutoff=0.5)
    picture = pictures.encoded(pictures.leaf(), "PNG")
    gltf = Gltf([plain((0.1, 0.13, 0.04), 0.6), mask], [(picture, "image/png")])
    random, stems, leaves = np.random.default_rng(5), [], []
    for number in range(8):
        turn = 2 * np.pi * (number + 0.6 * random.random()) / 8
        reach, height = random.uniform(6, 11.5), random.uniform(7.5, 13)
        foot = np.array([0.8 * np.cos(turn), -4.0, 0.8 * np.sin(turn)])
        tip = np.array([reach * np.cos(turn), height, reach * np.sin(turn)])
        stem, cards = shapes.branch(foot, tip, random.uniform(1, 3), 7, random.uniform(5.2, 6.6))
        stems.append(stem)
        leaves += cards
    mesh = gltf.mesh("bouquet", [(shapes.joined(stems), 0), (shapes.joined(leaves), 1)])
    gltf.nodes.append({"name": "bouquet", "mesh": mesh})
    return gltf


def field_of_stones() -> Gltf:
    """Return 1 170 standing stones in thirteen rows over the moor [m]; they share four meshes."""
    gltf = Gltf([plain((0.2, 0.18, 0.15), 0.9), plain((0.14, 0.135, 0.13), 0.85)], [])
    kinds = [gltf.mesh(f"stone {seed}", [(shapes.stone(seed, 22, 30), seed % 2)]) for seed in range(20, 24)]
    random = np.random.default_rng(8)
    for row in range(13):
        for number in range(90):
            depth = -30.0 - 5.6 * number - 2.4 * random.random()
            x = 6.6 * (row - 6) * (1 + 0.0007 * depth) + 7 * np.sin(depth / 90) + random.normal(0, 0.35)
            tall = random.uniform(0.9, 1.5) * (1.25 if random.random() < 0.1 else 1.0)
            place = [x, float(shapes.hill(np.array(x), np.array(depth))) + 0.55 * tall, depth]
            size = [tall * random.uniform(0.5, 0.72), tall, tall * random.uniform(0.36, 0.55)]
            gltf.nodes.append(
                {
                    "mesh": kinds[int(random.integers(4))],
                    "translation": [round(float(value), 3) for value in place],
                    "rotation": turned(float(random.uniform(0, 360))),
                    "scale": [round(float(value), 3) for value in size],
                }
            )
    return gltf


def main(folder: str = "") -> None:
    """Write all files."""
    out = Path(folder or Path(__file__).parent)
    out.mkdir(parents=True, exist_ok=True)
    write_hdr(out / "room.hdr", pictures.room(lamps=True))
    write_hdr(out / "room_without_lamps.hdr", pictures.room(lamps=False))
    for name, pixels in (("wood", pictures.wood()), ("tiles", pictures.tiles()), ("linen", pictures.linen())):
        (out / f"{name}.jpg").write_bytes(pictures.encoded(pixels, "JPEG"))
    (out / "tiles_normals.png").write_bytes(pictures.encoded(pictures.tile_normals(), "PNG"))
    write_ply(out / "vase.ply", shapes.lathe(VASE, 80, rounds=2))
    write_ply(out / "flask.ply", shapes.lathe(FLASK, 72, rounds=2), uvs=False)
    write_ply(out / "knot.ply", shapes.knot(), uvs=False)
    write_ply(out / "gear.ply", shapes.gear())
    write_ply(out / "stone.ply", shapes.stone(31, 64, 96), uvs=False)
    write_ply(out / "cloth.ply", shapes.cloth())
    write_ply(out / "cushion.ply", shapes.cushion(), uvs=False)
    write_ply(out / "cushion_fine.ply", shapes.cushion(96), uvs=False)  # no triangle of it shows where light grazes
    write_ply(out / "goblet.ply", shapes.lathe(GOBLET, 96, rounds=2), uvs=False)
    write_ply(out / "wine.ply", shapes.lathe(WINE, 96, rounds=2), uvs=False)
    write_ply(out / "tea_glass.ply", shapes.lathe(TEA_GLASS, 96, rounds=3), uvs=False)
    write_ply(out / "tea.ply", shapes.lathe(TEA, 96, rounds=3), uvs=False)
    write_ply(out / "milk.ply", shapes.plume(), uvs=False)
    write_ply(out / "saucer.ply", shapes.lathe(SAUCER, 96, rounds=3), uvs=False)
    write_ply(out / "candlestick.ply", shapes.lathe(CANDLESTICK, 72, rounds=2), uvs=False)
    write_ply(out / "candle.ply", shapes.lathe(CANDLE, 48, rounds=2), uvs=False)
    write_ply(out / "moor.ply", shapes.moor(), steps=40)
    tea_set().write(out / "tea_set.glb")
    bouquet().write(out / "bouquet.glb")
    field_of_stones().write(out / "standing_stones.glb")


if __name__ == "__main__":
    main(*sys.argv[1:])
