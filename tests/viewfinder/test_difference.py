"""The difference of two settings against its formula."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.viewfinder.instruments import LEGEND, difference, difference_rgb


def test_relmse_is_that_of_the_tradeoff_tables() -> None:
    rng = np.random.default_rng(6)
    a, b = (rng.gamma(2.0, 0.2, (19, 29, 3)).astype(np.float32) for _ in range(2))
    total, floor = 0.0, (0.01**2) * float(np.sum(a.astype(np.float64).mean(axis=(0, 1)) ** 2))
    for i in range(19):
        for j in range(29):
            tile = a[i // 8 * 8 : i // 8 * 8 + 8, j // 8 * 8 : j // 8 * 8 + 8].astype(np.float64)
            square = float(np.mean(np.sum(tile**2, axis=2)))
            total += float(np.sum((b[i, j].astype(np.float64) - a[i, j]) ** 2)) / (square + floor)
    assert difference(a, b)[1]["relmse"] == pytest.approx(total / (19 * 29), rel=1e-12)


def test_a_stop_is_a_stop_and_its_sense_is_that_of_the_second() -> None:
    a = np.full((9, 9, 3), 0.2, np.float32)
    stops, numbers = difference(a, 2 * a)
    assert np.allclose(stops, 1.0)
    assert numbers == pytest.approx(
        {"relmse": 1 / 1.0001, "mean_stops": 1.0, "bias_stops": 1.0, "worst_stops": 1.0}, rel=1e-6
    )
    assert np.array_equal(difference(2 * a, a)[0], -stops)


def test_equal_pictures_have_no_difference_even_when_black() -> None:
    black = np.zeros((4, 4, 3), np.float32)
    assert difference(black, black)[1] == {"relmse": 0, "mean_stops": 0, "bias_stops": 0, "worst_stops": 0}


def test_map_is_blue_where_darker_and_red_where_brighter() -> None:
    a = np.full((1, 3, 3), 0.2, np.float32)
    b = a * np.array([0.125, 1, 8], np.float32)[None, :, None]
    colours = [entry["colour"] for entry in LEGEND]
    assert [tuple(pixel) for pixel in difference_rgb(difference(a, b)[0])[0].tolist()] == colours


def test_films_of_other_sizes_are_refused() -> None:
    with pytest.raises(InputError, match="sizes"):
        difference(np.zeros((2, 2, 3), np.float32), np.zeros((2, 3, 3), np.float32))
