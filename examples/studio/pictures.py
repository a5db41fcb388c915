"""Pictures of the studio: wood, tiles and their normals, linen, a cup's band, a leaf, and the light of the room."""

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Array = NDArray[np.float64]


def across(width: int, height: int) -> tuple[Array, Array]:
    """Return u and v of the centres of texels, each (height, width), v = 0 in the bottom row."""
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, 1 - (np.arange(height) + 0.5) / height)
    return u, v


def mottled(u: Array, v: Array, cells: tuple[int, int], seed: int) -> Array:
    """Return smooth random values from 0 to 1 that repeat after 1 in u and v, of so many cells across."""
    values = np.random.default_rng(seed).random(cells)
    column, row = u * cells[0], v * cells[1]
    left, low = np.floor(column).astype(int), np.floor(row).astype(int)
    a, b = ((t - i) ** 2 * (3 - 2 * (t - i)) for t, i in ((column, left), (row, low)))
    corner = [[values[(left + i) % cells[0], (low + j) % cells[1]] for j in (0, 1)] for i in (0, 1)]
    left_side, right_side = (low_one * (1 - b) + high_one * b for low_one, high_one in corner)
    return np.asarray(left_side * (1 - a) + right_side * a)


def blend(share: Array, low: tuple[int, ...], high: tuple[int, ...]) -> Array:
    """Return colours of 0 to 255 between two, by a share from 0 to 1."""
    return np.asarray(np.array(low, float) + np.clip(share, 0, 1)[..., None] * (np.array(high, float) - low))


def encoded(pixels: Array, kind: str) -> bytes:
    """Return a picture of values from 0 to 255 as PNG or JPEG."""
    file = io.BytesIO()
    options = {"quality": 88} if kind == "JPEG" else {"optimize": True}
    Image.fromarray(np.clip(pixels + 0.5, 0, 255).astype(np.uint8)).save(file, kind, **options)
    return file.getvalue()


def wood(size: int = 512) -> Array:
    """Return four boards of walnut; the grain runs along u."""
    u, v = across(size, size)
    board = np.floor(4 * v)
    shift = np.random.default_rng(2).random(5)[board.astype(int)]
    at = (u + shift) % 1
    rings = v * 14 + 2.6 * mottled(at, v, (3, 8), 3) + 0.6 * mottled(at, v, (9, 40), 4) + 7 * shift
    grain = 0.5 + 0.5 * np.sin(2 * np.pi * rings)
    fibres = mottled(at, v, (16, 256), 5)
    colour = blend(0.55 * grain + 0.3 * fibres + 0.25 * shift, (62, 36, 22), (148, 98, 60))
    gap = np.minimum(4 * v - board, board + 1 - 4 * v)
    return np.asarray(colour * np.clip(gap / 0.02, 0.25, 1)[..., None])


def tile_heights(size: int) -> Array:
    """Return the heights of two by two tiles with pillowed edges."""
    u, v = across(size, size)
    edge = np.minimum.reduce([(2 * t) % 1 for t in (u, v)] + [1 - (2 * t) % 1 for t in (u, v)])
    rise = np.clip((edge - 0.03) / 0.09, 0, 1)
    return np.asarray(rise * (2 - rise) + 0.12 * mottled(u, v, (10, 10), 7))


def tiles(size: int = 256) -> Array:
    """Return glazed tiles of two blues and their joints."""
    u, v = across(size, size)
    odd = (np.floor(2 * u) + np.floor(2 * v)) % 2
    glaze = blend(0.7 * odd + 0.3 * mottled(u, v, (14, 14), 6), (20, 54, 78), (52, 112, 128))
    joint = blend(mottled(u, v, (64, 64), 8), (150, 145, 134), (176, 170, 160))
    return np.asarray(np.where(tile_heights(size)[..., None] < 0.12, joint, glaze))


def tile_normals(size: int = 256) -> Array:
    """Return the normals of the tiles, as a normal map of glTF."""
    height = tile_heights(size) * 7
    slope_u = (np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)) / 2
    slope_v = (np.roll(height, 1, axis=0) - np.roll(height, -1, axis=0)) / 2
    normals = np.stack([-slope_u, -slope_v, np.ones_like(height)], axis=-1)
    return np.asarray(127.5 + 127.5 * normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def linen(size: int = 256) -> Array:
    """Return woven cloth with a double stripe."""
    u, v = across(size, size)
    weave = 0.5 + 0.25 * np.sin(2 * np.pi * 64 * u) * np.sin(2 * np.pi * 64 * v) + 0.4 * mottled(u, v, (96, 24), 9)
    plain = blend(weave, (196, 186, 166), (232, 226, 210))
    stripe = (np.abs(v - 0.5) < 0.07) | (np.abs(np.abs(v - 0.5) - 0.13) < 0.015)
    return np.asarray(np.where(stripe[..., None], blend(weave, (48, 74, 108), (74, 104, 140)), plain))


def band(width: int = 512, height: int = 256) -> Array:
    """Return the painting of a cup: a meander of leaves between two lines, low on white."""
    u, v = across(width, height)
    paint = blend(mottled(u, v, (12, 12), 10), (236, 232, 222), (246, 243, 236))
    wave = 0.33 + 0.03 * np.sin(2 * np.pi * 8 * u)
    petals = np.abs(v - wave) < 0.026 * np.abs(np.sin(2 * np.pi * 12 * u)) ** 0.7
    lines = (np.abs(v - 0.26) < 0.006) | (np.abs(v - 0.4) < 0.006)
    paint[lines] = (172, 128, 60)
    paint[petals] = (32, 82, 120)
    return paint


def leaf(width: int = 96, height: int = 192) -> Array:
    """Return a leaf with its veins, and what is there of it as alpha; its foot is at the bottom."""
    u, v = across(width, height)
    aside = np.abs(2 * u - 1)
    outline = 0.95 * np.sin(np.pi * v**0.8) ** 0.75 * (1 - 0.07 * np.abs(np.sin(22 * np.pi * v)))
    veins = np.abs(((v - 0.35 * aside) * 11) % 1 - 0.5) < 0.07
    share = 0.5 * mottled(u, v, (8, 16), 11) + 0.35 * veins + 0.5 * (aside < 0.05) + 0.15 * v
    alpha = 255.0 * (aside < outline)
    return np.concatenate([blend(share, (44, 92, 34), (150, 196, 92)), alpha[..., None]], axis=-1)


def room(*, lamps: bool, width: int = 1024, height: int = 512) -> Array:
    """Return the radiance all round the table: a dim room, soft boxes, a window at dusk, perhaps lamps.

    The middle of the picture is what lies behind the table, longitude grows to the right.
    """
    u, v = across(width, height)
    turn, rise = 360 * u - 180, 180 * v - 90
    wall = blend((rise[:, :1] + 25) / 80, (46, 34, 27), (12, 14, 19)) / 255
    pixels = np.repeat(wall, width, axis=1)
    pixels[rise[:, 0] < -12] = (0.055, 0.042, 0.034)

    def soft_box(centre: float, low: float, half: float, size: float, radiance: tuple[float, ...]) -> None:
        away = np.maximum(np.abs((turn - centre + 180) % 360 - 180) / half, np.abs(rise - low) / size)
        pixels[away < 1] = radiance

    soft_box(-78, 38, 26, 22, (11.0, 9.8, 8.2))
    soft_box(102, 30, 9, 34, (2.2, 3.1, 4.6))
    soft_box(180, 62, 40, 10, (3.0, 2.9, 2.7))
    for column in (38, 53):
        for row in (12, 26):
            soft_box(column, row, 6.5, 6, (0.34, 0.55, 0.95))
    colours = [(14, 7, 2), (15, 9.5, 4), (13, 4.5, 1), (14.5, 8, 2.8), (4, 9, 10.5)]
    for number, place in enumerate(np.linspace(-42, 28, 28) if lamps else ()):
        height_of = -3.0 - 2.5 * np.cos(np.radians(place * 7.5)) + 3.4 * (number % 3)
        away = np.hypot((turn - place) * np.cos(np.radians(rise)), rise - height_of)
        pixels[away < 0.6] = colours[number % 5]
    return pixels
