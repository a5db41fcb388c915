"""Make the leaf of leaf.yaml from formulas: leaf.ply, a folded and curled card, and leaf.png, its colour and outline.

Run in the folder above: python examples/make_leaf.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).with_name("studio")))
import files
import pictures
import shapes

WIDTH, HEIGHT = 450, 800
PAIRS = 11  # of side veins
CELLS = (56, 100)  # of the net between them
Array = pictures.Array


def cracks(u: Array, v: Array) -> Array:
    """Return how far places are from the borders of cells round scattered points, in cells (Worley 1996)."""
    points = np.random.default_rng(7).random((*CELLS, 2))
    x, y = u * CELLS[0], v * CELLS[1]
    column, row = x.astype(int), y.astype(int)
    distances = []
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            at = points[(column + i) % CELLS[0], (row + j) % CELLS[1]]
            distances.append(np.hypot(column + i + at[..., 0] - x, row + j + at[..., 1] - y))
    nearest = np.sort(distances, axis=0)
    return np.asarray(nearest[1] - nearest[0])


def picture() -> Array:
    """Return what a leaf lets through, as sRGB bytes, and its outline as alpha; its foot is at the bottom."""
    u, v = pictures.across(WIDTH, HEIGHT)
    aside = np.abs(2 * u - 1)
    blade = np.clip((v - 0.07) / 0.91, 0, 1)
    width = 0.94 * np.sin(np.pi * blade**0.72) ** 0.8
    along = (v - 0.07 - 0.26 * aside**1.35) * PAIRS / 0.8
    teeth = 0.03 * np.abs((along * 2.5) % 1 - 0.5)
    stalk = (aside < 0.022) & (v < 0.2)
    alpha = 255.0 * ((aside < width - teeth * (width > 0.1)) & (blade > 0) | stalk)
    from_side = np.abs((along + 0.5) % 1 - 0.5) / PAIRS
    thin = np.clip(1 - blade, 0.25, 1)
    side = np.exp(-((from_side / (0.0035 * thin + 0.001 + 0.003 * (1 - aside))) ** 2)) * (along > 0.5)
    middle = np.exp(-((aside / (0.03 * thin)) ** 2))
    net = np.exp(-((cracks(u, v) / 0.09) ** 2))
    lamina = pictures.blend(0.65 * pictures.mottled(u, v, (9, 16), 3) + 0.35 * pictures.mottled(u, v, (40, 70), 5),
                            (118, 160, 24), (176, 204, 52))  # fmt: skip
    edge = np.clip((aside / np.maximum(width, 1e-3) - 0.75) / 0.25, 0, 1)[..., None]
    colour = lamina * (1 - 0.25 * edge) + edge * np.array([46.0, 16, 0])
    for share, paint in ((0.45 * net, (206, 226, 110)), (0.85 * side, (216, 226, 128)), (middle, (120, 128, 50))):
        colour = colour + share[..., None] * (np.array(paint, float) - colour)
    return np.concatenate([colour, alpha[..., None]], axis=-1)


def card() -> shapes.Shape:
    """Return the card [m]: 9 cm long, folded along its middle, its tip curled."""
    v, u = np.meshgrid(np.linspace(0, 1, 61), np.linspace(0, 1, 33), indexing="ij")
    x = (2 * u - 1) * 0.0253
    wave = 0.0012 * np.sin(9 * v + 3 * np.sign(x)) * np.abs(x) / 0.0253
    z = 0.35 * np.abs(x) ** 1.3 / 0.0253**0.3 - 0.012 * v**2 + wave
    return shapes.grid(np.stack([x, 0.09 * v, z], axis=-1))


if __name__ == "__main__":
    here = Path(__file__).parent
    (here / "leaf.png").write_bytes(pictures.encoded(picture(), "PNG"))
    files.write_ply(here / "leaf.ply", card(), steps=200000)
