"""Mosaics of every order, and the colours that demosaicing finds again, on charts."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rptcam_cl.imaging.development import expose, interpolate_colours, linear_picture, mosaic
from tests.imaging.sensor.sensors import flat, sensor

ORDERS = ("RGGB", "BGGR", "GRBG", "GBRG")
METHODS = ("bilinear", "malvar")
Array = NDArray[np.float64]

# Linear sRGB of a chart: greys, primaries, and skin, foliage, sky and orange like colours.
CHART = np.array(
    [
        [[0.03] * 3, [0.09] * 3, [0.19] * 3, [0.36] * 3, [0.59] * 3, [0.9] * 3],
        [[0.7, 0.05, 0.05], [0.05, 0.6, 0.1], [0.05, 0.08, 0.7], [0.7, 0.6, 0.02], [0.6, 0.05, 0.4], [0.02, 0.3, 0.5]],
        [[0.5, 0.3, 0.22], [0.1, 0.15, 0.05], [0.12, 0.2, 0.33], [0.7, 0.2, 0.03], [0.15, 0.5, 0.4], [0.4, 0.5, 0.05]],
    ]
)


def psnr(found: Array, true: Array) -> float:
    return float(-10 * np.log10(np.mean((found - true)[4:-4, 4:-4] ** 2)))


def zone_plate(cycles_per_px: float, size: int = 256) -> Array:
    """Return grey rings whose frequency rises to a number of cycles per pixel at the middle of the edges."""
    axis = np.arange(size) - size / 2
    grey = 0.5 + 0.5 * np.cos(2 * np.pi * cycles_per_px * (axis[:, None] ** 2 + axis[None, :] ** 2) / size)
    return np.repeat(grey[..., None], 3, axis=2)


@pytest.mark.parametrize("order", ORDERS)
def test_mosaic_keeps_the_colour_of_each_place(order: str) -> None:
    seen = mosaic(flat([1.0, 2.0, 3.0], 6), order)
    expected = np.array(["RGB".index(letter) + 1 for letter in order], float).reshape(2, 2)
    assert np.array_equal(seen, np.tile(expected, (3, 3)))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("shape", [(2, 2), (2, 7), (9, 12)])
def test_even_colour_comes_back_exactly(order: str, method: str, shape: tuple[int, int]) -> None:
    colour = np.broadcast_to([0.25, 0.5, 0.125] if method == "bilinear" else [0.25] * 3, (*shape, 3))
    assert np.array_equal(interpolate_colours(mosaic(colour, order), order, method), colour)


@pytest.mark.parametrize("order", ORDERS)
def test_even_colours_come_back_by_malvar_where_no_edge_is_near(order: str) -> None:
    colour = np.broadcast_to([0.3, 0.7, 0.1], (12, 12, 3))
    assert interpolate_colours(mosaic(colour, order), order, "malvar") == pytest.approx(colour, abs=1e-15)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("order", ORDERS)
def test_ramp_comes_back_exactly_inside(order: str, method: str) -> None:
    y, x = np.mgrid[0:20, 0:24]
    ramp = np.stack([x + 2.0 * y, 3.0 * x - y + 40, 0.5 * x + y], axis=2) if method == "bilinear" else None
    if ramp is None:
        ramp = np.repeat((x + 2.0 * y)[..., None], 3, axis=2)
    found = interpolate_colours(mosaic(ramp, order), order, method)
    assert found[2:-2, 2:-2] == pytest.approx(ramp[2:-2, 2:-2], abs=1e-12)


def test_each_pixel_keeps_what_it_saw() -> None:
    values = np.random.default_rng(5).random((16, 18))
    for method in METHODS:
        for order in ORDERS:
            assert np.array_equal(mosaic(interpolate_colours(values, order, method), order), values)


# Measured with this plate: bilinear 27.4 and 16.9 dB, Malvar 33.5 and 27.5 dB, in every order.
@pytest.mark.parametrize(("frequency", "bilinear", "malvar"), [(0.125, 27.2, 33.2), (0.25, 16.7, 27.2)])
def test_zone_plate_comes_back_the_better_by_malvar(frequency: float, bilinear: float, malvar: float) -> None:
    plate = zone_plate(frequency)
    for order in ORDERS:
        assert psnr(interpolate_colours(mosaic(plate, order), order, "bilinear"), plate) > bilinear
        assert psnr(interpolate_colours(mosaic(plate, order), order, "malvar"), plate) > malvar


def test_zone_plate_would_show_a_wrong_order() -> None:
    plate = zone_plate(0.125) * [1.0, 0.5, 0.5]
    assert psnr(interpolate_colours(mosaic(plate, "RGGB"), "BGGR", "malvar"), plate) < 20


@pytest.mark.parametrize("order", [*ORDERS, "none"])
@pytest.mark.parametrize("response", [None, "nikon_d5100", "canon_eos_5d_mark_ii", "sigma_sd_merrill"])
def test_chart_keeps_its_colours_through_the_sensor(order: str, response: str | None) -> None:
    film = CHART.repeat(48, axis=0).repeat(48, axis=1)
    many = replace(sensor(response, bayer=order, bit_depth=16, full_well_e=3e8), black_level_dn=2048.0)
    silent = replace(many, electrons=many.electrons * 1e4, system_gain_dn_per_e=(65535 - 2048) / 3e8)
    found = linear_picture(expose(film, silent), silent)
    patches = found.reshape(3, 48, 6, 48, 3)[:, 12:-12, :, 12:-12].mean(axis=(1, 3))
    assert patches == pytest.approx(CHART, abs=2e-4)  # a dozen steps of the converter, of which pixels average many


def test_chart_would_show_a_wrong_order() -> None:
    film = CHART.repeat(48, axis=0).repeat(48, axis=1)
    found = linear_picture(expose(film, sensor(bayer="RGGB")), sensor(bayer="BGGR"))
    assert np.abs(found.reshape(3, 48, 6, 48, 3).mean(axis=(1, 3)) - CHART).max() > 0.1


def test_highlights_stay_neutral() -> None:
    for order in ("RGGB", "none"):
        chosen = sensor("nikon_d5100", bayer=order)
        found = linear_picture(expose(flat(5.0), chosen), chosen)
        assert found == pytest.approx(np.ones_like(found), abs=0.02)


def test_monochrome_sees_all_light() -> None:
    chosen = sensor(bayer="monochrome", full_well_e=1e6)
    found = linear_picture(expose(flat([0.3, 0.5, 0.1]), chosen), chosen)
    weights = sensor().electrons.sum(axis=1) / sensor().electrons.sum()
    assert found[..., 0].mean() == pytest.approx(float(weights @ [0.3, 0.5, 0.1]), rel=0.01)
    assert np.array_equal(found[..., 0], found[..., 2])
