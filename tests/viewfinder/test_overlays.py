"""Zebra, false colour, peaking, overlay and magnifier, against what the test computes by itself."""

from dataclasses import asdict

import numpy as np
import pytest
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.viewfinder import instruments


@pytest.fixture(scope="module")
def film() -> NDArray[np.float32]:
    """A film of values from far below black to beyond white."""
    stops = np.random.default_rng(3).uniform(-9, 4, (37, 53, 3))
    return (0.18 * 2.0**stops).astype(np.float32)


@pytest.mark.parametrize("level", [0.0, 0.02, 0.7, 0.95, 1.0])
def test_zebra_marks_what_reaches_the_display_level(film: NDArray[np.float32], level: float) -> None:
    signal = np.where(film <= 0.0031308, 12.92 * film, 1.055 * np.maximum(film, 1e-9) ** (1 / 2.4) - 0.055)
    expected = [[bool(max(pixel) >= level - 1e-7) for pixel in row] for row in signal]
    assert np.array_equal(instruments.zebra(film, level), expected)


@pytest.mark.parametrize("level", [-0.1, 1.5, float("nan")])
def test_zebra_refuses_what_is_no_signal(film: NDArray[np.float32], level: float) -> None:
    with pytest.raises(InputError, match="0 to 1"):
        instruments.zebra(film, level)


def test_false_colour_is_the_zone_of_the_luminance(film: NDArray[np.float32]) -> None:
    stops = np.log2((film.astype(np.float64) @ [0.2126, 0.7152, 0.0722]) / 0.18)
    zones = np.clip(np.floor(stops + 0.5) + 5, 0, 7)
    zones[stops >= np.log2(1 / 0.18)] = 8
    assert np.array_equal(instruments.false_colour(film), zones)


def test_false_colour_has_a_scale_without_gaps() -> None:
    legend = [asdict(band) for band in instruments.FALSE_COLOUR]
    assert [band["name"] for band in legend] == ["0", "I", "II", "III", "IV", "V", "VI", "VII", "clipped"]
    assert [band["high_ev"] for band in legend[:-1]] == [band["low_ev"] for band in legend[1:]]
    shown = instruments.false_colour_rgba(np.array([[5, 8]], np.uint8))
    assert shown.tolist() == [[[*legend[5]["colour"], 255], [*legend[8]["colour"], 255]]]


def exceeds(high: NDArray[np.float64], least: float, most: float) -> NDArray[np.bool_]:
    """Whether a contrast is three times the noise of the noisiest of the tiles around."""
    rows, columns = high.shape
    sigma = {}
    for i in range(0, rows, 16):
        for j in range(0, columns, 16):
            # the picture is mirrored at its edges
            down = [min(k, 2 * rows - 1 - k) for k in range(i, i + 16)]
            right = [min(k, 2 * columns - 1 - k) for k in range(j, j + 16)]
            sigma[i // 16, j // 16] = sorted(high[k, m] for k in down for m in right)[205] / 1.2816
    strong = np.zeros(high.shape, bool)
    for i in range(rows):
        for j in range(columns):
            around = [sigma.get((i // 16 + di, j // 16 + dj), 0.0) for di in (-1, 0, 1) for dj in (-1, 0, 1)]
            strong[i, j] = high[i, j] > max(least, 3 * min(max(around), most))
    return strong


def peaks(film: NDArray[np.float32], level: float, noise: float = np.inf) -> NDArray[np.bool_]:
    """Peaking pixel by pixel in float64."""
    y = np.clip(film.astype(np.float64) @ [0.2126, 0.7152, 0.0722], 0, 1)
    v = np.where(y <= 0.0031308, 12.92 * y, 1.055 * np.maximum(y, 1e-9) ** (1 / 2.4) - 0.055)
    rows, columns = v.shape
    high = np.zeros_like(v)
    for i in range(rows):
        for j in range(columns):
            mean = 0.0
            for di, a in ((-1, 1), (0, 2), (1, 1)):
                for dj, b in ((-1, 1), (0, 2), (1, 1)):
                    mean += a * b * v[min(max(i + di, 0), rows - 1), min(max(j + dj, 0), columns - 1)] / 16
            high[i, j] = v[i, j] - mean
    strong, result = np.zeros(v.shape, bool), np.zeros(v.shape, bool)
    for di, dj in ((0, 0), (0, 1), (1, 0), (1, 1), (1, -1)):
        row = np.zeros_like(v)
        for k in range(-2, 3):
            down = np.clip(np.arange(rows) + k * di, 0, rows - 1)
            row += high[np.ix_(down, np.clip(np.arange(columns) + k * dj, 0, columns - 1))] / 5
        strong |= exceeds(np.abs(row), 0.1 * (1 - level) + 0.005, 0.2 * noise / (np.sqrt(5) if di or dj else 1))
    for i in range(rows):
        for j in range(columns):
            near = strong[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].sum() - strong[i, j]
            result[i, j] = strong[i, j] and near >= 2
    return result


@pytest.fixture(scope="module")
def edges() -> NDArray[np.float32]:
    """A sharp edge on the left, a soft one on the right, a little noise everywhere and one bright speck."""
    x = np.arange(60)
    row = np.where(x < 15, 0.1, 0.5) - 0.4 * np.clip((x - 35) / 12, 0, 1)
    noise = np.random.default_rng(5).normal(1.0, 0.005, (40, 60))
    film = np.repeat((row * noise)[..., None], 3, axis=2)
    film[30, 25] = 1.0
    return film.astype(np.float32)


@pytest.mark.parametrize("level", [0.2, 0.5, 0.9])
def test_peaking_is_the_contrast_of_neighbouring_pixels(edges: NDArray[np.float32], level: float) -> None:
    assert np.array_equal(instruments.peaking(edges, level), peaks(edges, level))
    assert np.array_equal(instruments.peaking(edges, level, 0.05), peaks(edges, level, 0.05))


def test_peaking_marks_the_sharp_edge_and_neither_the_soft_one_nor_a_speck(edges: NDArray[np.float32]) -> None:
    columns = np.flatnonzero(instruments.peaking(edges).any(axis=0))
    assert columns.tolist() == [14, 15]


SPARKLE = 0.005  # of the pixels; with the noise of the whole picture in one number it was a tenth of first_light
LIT = np.clip(np.add.outer(np.linspace(0, 1, 135), np.linspace(-0.5, 1, 240)), 0, 1)


def few_samples(spp: int) -> NDArray[np.float32]:
    """Light that few paths find, over a picture that is dark, lit and half lit in parts; nothing in it is sharp."""
    rng = np.random.default_rng(spp)
    lit = LIT
    found = rng.binomial(spp, 0.2, lit.shape) / (0.2 * spp) * rng.gamma(spp, 1 / spp, lit.shape)
    return np.repeat((0.3 * lit * found)[..., None], 3, axis=2).astype(np.float32)


@pytest.mark.parametrize("spp", [1, 4, 16, 64])
@pytest.mark.parametrize("level", [0.5, 1.0])
def test_peaking_does_not_sparkle_where_samples_are_few(spp: int, level: float) -> None:
    assert instruments.peaking(few_samples(spp), level).mean() < SPARKLE
    noise = np.sqrt(np.mean(LIT**2) * (1 / 0.2 - 1 + 1 / 0.2 / spp) / spp) / np.mean(LIT)  # of binomial and gamma
    assert instruments.peaking(few_samples(spp), level, float(noise)).mean() < SPARKLE


def test_peaking_finds_fine_texture_once_the_noise_is_known_to_be_little() -> None:
    board = 0.2 + 0.4 * (np.add.outer(np.arange(64) // 2, np.arange(96) // 2) % 2)
    film = np.repeat(board[..., None], 3, axis=2).astype(np.float32)
    film[:, 48:] = film[:, 48:].mean()
    assert not instruments.peaking(film)[:, :47].any()  # noise may look like this
    sharp = instruments.peaking(film, noise=0.02)
    assert sharp[:, 1:47].mean() > 0.9
    assert not sharp[:, 50:].any()


def test_zebra_and_peaking_pictures_are_clear_where_nothing_is_marked() -> None:
    mask = np.eye(16, dtype=bool)
    for picture in (instruments.zebra_rgba(mask), instruments.peaking_rgba(mask)):
        assert np.array_equal(picture[..., 3] > 0, mask)
    stripes = instruments.zebra_rgba(np.ones((8, 16), bool))[0, :, 0]
    assert np.array_equal(stripes == 255, np.arange(16) % 8 < 4)


@pytest.mark.parametrize(
    ("x", "y", "first"), [(0.5, 0.5, (15, 15)), (0.0, 0.0, (0, 0)), (1.0, 1.0, (30, 30)), (0.25, 0.9, (5, 30))]
)
def test_magnifier_is_a_crop_of_the_pixels(x: float, y: float, first: tuple[int, int]) -> None:
    picture = np.arange(40 * 40).reshape(40, 40, 1)
    crop, place = instruments.magnifier(picture, x, y, 10, 10)
    assert place == first
    assert np.array_equal(crop, picture[first[1] : first[1] + 10, first[0] : first[0] + 10])


def test_magnifier_of_a_small_picture_is_the_whole() -> None:
    crop, place = instruments.magnifier(np.zeros((8, 12, 3)), 0.9, 0.9)
    assert (crop.shape, place) == ((8, 12, 3), (0, 0))
