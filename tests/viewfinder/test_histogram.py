"""Histograms and clipping counts against counts made one pixel at a time."""

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from rptcam_cl.imaging.development import SensorModel
from rptcam_cl.imaging.formats import RawImage
from rptcam_cl.viewfinder.instruments import clipping, histogram, raw_histogram, stop_histogram, thinned


@pytest.fixture(scope="module")
def film() -> NDArray[np.float32]:
    values = 0.18 * 2.0 ** np.random.default_rng(8).uniform(-14, 8, (31, 45, 3))
    values[0, :5] = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 1], [-0.1, 0.2, 0.2], [1e-5, 1e-5, 0.5]])
    return values.astype(np.float32)


def test_histogram_counts_display_codes() -> None:
    picture = np.random.default_rng(2).integers(0, 256, (40, 30, 3), dtype=np.uint8)
    found = histogram(picture)
    for k, name in enumerate(("red", "green", "blue")):
        expected = Counter(int(pixel[k]) for row in picture for pixel in row)
        assert found[name] == [expected[code] for code in range(256)]
    luma = Counter(int(0.2126 * r + 0.7152 * g + 0.0722 * b + 0.5) for row in picture.tolist() for r, g, b in row)
    assert found["luminance"] == [luma[code] for code in range(256)]
    assert (found["samples"], found["scale"]) == (1200, "display code")


def test_large_picture_is_counted_by_pixels_of_its_own() -> None:
    picture = np.zeros((400, 600, 3), np.uint8)
    picture[::2] = 255  # a mean of neighbours would be grey
    found = histogram(picture, most=1000)
    assert sum(found["luminance"][1:255]) == 0
    assert 500 < found["samples"] <= 1100
    assert np.isin(thinned(np.arange(10_000).reshape(100, 100, 1), 50), np.arange(10_000)).all()


def test_stop_histogram_counts_thirds_of_stops(film: NDArray[np.float32]) -> None:
    found = stop_histogram(film)
    assert (found["edges"], found["bins"]) == ([-10, 6], 48)
    for name, weights in {"luminance": (0.2126, 0.7152, 0.0722), "green": (0, 1, 0)}.items():
        values = film.astype(np.float64) @ weights
        with np.errstate(all="ignore"):
            stops = np.where(values > 0, np.log2(values / 0.18), -99)
        expected, _ = np.histogram(np.clip(stops, -9.99, 5.99), np.linspace(-10, 6, 49))
        assert found[name] == expected.tolist()


def test_clipping_counts_white_and_black(film: NDArray[np.float32]) -> None:
    found = clipping(film)
    pixels = film.reshape(-1, 3).tolist()
    black = 0.5 / 255 / 12.92
    assert found["pixels"] == 31 * 45
    assert found["high"]["any"] == sum(max(pixel) >= 1 for pixel in pixels)
    assert found["high"]["red"] == sum(pixel[0] >= 1 for pixel in pixels)
    assert found["low"]["any"] == sum(all(channel < black for channel in pixel) for pixel in pixels)
    assert found["low"]["blue"] == sum(pixel[2] < black for pixel in pixels)
    assert min(found["high"]["any"], found["low"]["any"]) > 5


def test_histogram_says_its_numbers_as_plain_values(film: NDArray[np.float32]) -> None:
    plain = histogram(np.zeros((31, 45, 3), np.uint8), film)
    assert plain["luminance"][0] == plain["samples"] == 31 * 45
    assert plain["clipped"]["high"]["any"] == clipping(film)["high"]["any"]
    assert plain["edges"] == [-0.5, 255.5]


@pytest.mark.parametrize("bayer", ["GRBG", "monochrome", "none"])
def test_raw_histogram_counts_the_numbers_of_each_colour(bayer: str) -> None:
    sensor = SensorModel(np.eye(3) * 1000, 1000.0, 1.0, 1.0, 64.0, 10, bayer)
    shape = (8, 12, 3) if bayer == "none" else (8, 12)
    numbers = np.random.default_rng(4).integers(0, 1024, shape, dtype=np.uint16)
    found = raw_histogram(RawImage(numbers, sensor))
    if bayer == "GRBG":
        seen = {"red": [(0, 1)], "green": [(0, 0), (1, 1)], "blue": [(1, 0)]}  # row and column of each colour's pixels
        for colour, starts in seen.items():
            own = np.concatenate([numbers[row::2, column::2].ravel() for row, column in starts])
            assert found[colour] == np.histogram(own, np.arange(0, 1025, 4))[0].tolist()
    elif bayer == "none":
        expected = np.histogram(numbers[..., 2], np.arange(0, 1025, 4))[0]
        assert found["blue"] == expected.tolist()
    else:
        assert set(found) & {"luminance", "red", "green", "blue"} == {"luminance"}
    assert found["saturated"] == int((numbers >= 1023).sum())
