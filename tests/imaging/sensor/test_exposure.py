"""From film to raw numbers: means, noise, saturation, converter, seeds."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.development import SensorModel, binned_exposure, expose, linear_picture
from tests.imaging.sensor.sensors import Transfer, flat, photon_transfer, sensor
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent

LEVELS = (0.02, 0.1, 0.25, 0.4, 0.6)
MONO = sensor(
    bayer="monochrome", electrons=np.diag([4000.0, 5000.0, 6000.0]), full_well_e=12000.0, read_noise_e=7.0,
    system_gain_dn_per_e=1.2, black_level_dn=512.0, bit_depth=14,
)  # fmt: skip


def transfer(chosen: SensorModel, size: int = 512) -> Transfer:
    def frame(level: float, seed: int) -> np.ndarray:
        return expose(flat(level, size), replace(chosen, seed=seed))

    return photon_transfer(frame, LEVELS, 1.5)


@pytest.mark.parametrize(
    "chosen", [slow(MONO), replace(MONO, prnu=0.03, dsnu_e=20.0)], ids=["uniform pixels", "pixels that differ"]
)
def test_photon_transfer_gives_back_gain_read_noise_and_full_well(chosen: SensorModel) -> None:
    found = transfer(chosen)
    for (value, error), put_in in (
        (found.gain, chosen.system_gain_dn_per_e),
        (found.read_noise_e, chosen.read_noise_e),
        (found.full_well_e, chosen.full_well_e),
    ):
        assert_equivalent(value, error, put_in, 0.02 * put_in)


def test_photon_transfer_would_notice_three_percent() -> None:
    found = transfer(replace(MONO, system_gain_dn_per_e=1.2 * 1.03, read_noise_e=7.0 * 1.03, full_well_e=12000 * 1.03))
    for (value, error), put_in in ((found.gain, 1.2), (found.read_noise_e, 7.0), (found.full_well_e, 12000.0)):
        with pytest.raises(AssertionError):
            assert_equivalent(value, error, put_in, 0.02 * put_in)


def test_noise_is_that_of_the_electrons() -> None:
    frame = expose(flat(0.5, 256), replace(MONO, system_gain_dn_per_e=1.0))
    counted = frame.astype(float)
    assert counted.mean() == pytest.approx(512 + 7500, abs=4 * np.sqrt(7500 / 65536))
    assert counted.var() == pytest.approx(7500 + 49 + 1 / 12, rel=4 * np.sqrt(2 / 65536))


def test_dark_current_adds_electrons_and_their_noise() -> None:
    dark = expose(flat(0.0, 256), replace(MONO, system_gain_dn_per_e=1.0, dark_e=400.0)).astype(float)
    assert dark.mean() == pytest.approx(512 + 400, abs=4 * np.sqrt(449 / 65536))
    assert dark.var() == pytest.approx(400 + 49 + 1 / 12, rel=4 * np.sqrt(2 / 65536))


@pytest.mark.parametrize("bayer", ["RGGB", "none", "monochrome"])
def test_same_seed_gives_the_same_bytes_and_another_seed_others(bayer: str) -> None:
    chosen = sensor(bayer=bayer, prnu=0.01, dsnu_e=5.0, seed=7)
    film = np.random.default_rng(3).random((40, 60, 3)) * 0.3
    first = expose(film, chosen)
    assert first.tobytes() == expose(film, replace(chosen)).tobytes()
    other = expose(film, replace(chosen, seed=8))
    assert np.mean(first != other) > 0.9


def test_fixed_pattern_stays_while_the_noise_changes() -> None:
    chosen = sensor(bayer="monochrome", prnu=0.05, dsnu_e=300.0, pattern_seed=4)
    residue = [expose(flat(0.3, 96), replace(chosen, seed=seed)).astype(float).ravel() for seed in (1, 2)]
    assert np.corrcoef(residue)[0, 1] > 0.9
    elsewhere = expose(flat(0.3, 96), replace(chosen, seed=1, pattern_seed=5)).astype(float).ravel()
    assert abs(np.corrcoef(residue[0], elsewhere)[0, 1]) < 0.05


def test_fixed_pattern_has_the_size_put_in() -> None:
    frames = [expose(flat(0.3, 256), replace(MONO, prnu=0.02, seed=seed)).astype(float) for seed in (1, 2)]
    together = np.mean((frames[0] - frames[0].mean()) * (frames[1] - frames[1].mean()))  # noise is not shared
    assert np.sqrt(together) == pytest.approx(0.02 * 4500 * 1.2, rel=0.02)


def test_part_of_the_film_has_the_pixels_of_the_whole() -> None:
    chosen = sensor(read_noise_e=0.0, prnu=0.05, dsnu_e=500.0, electrons=np.zeros((3, 3)), black_level_dn=4000.0)
    whole = expose(np.zeros((30, 40, 3)), chosen)
    part = expose(np.zeros((11, 13, 3)), replace(chosen, origin=(7, 5)))
    assert np.array_equal(part, whole[5:16, 7:20])
    assert replace(chosen, origin=(7, 5)).pattern == "BGGR"
    assert replace(chosen, origin=(1, 0)).pattern == "GRBG"
    assert replace(chosen, origin=(0, 1)).pattern == "GBRG"


@pytest.mark.parametrize("bits", [1, 8, 10, 12, 16])
def test_numbers_fill_the_range_of_the_converter_and_no_more(bits: int) -> None:
    top = 2**bits - 1
    chosen = sensor(bit_depth=bits, black_level_dn=top / 32, system_gain_dn_per_e=top / 30000, bayer="none")
    ramp = np.linspace(0, 3, 512)[None, :, None] * np.ones((4, 1, 3))
    numbers = expose(ramp, chosen)
    assert numbers.dtype == np.uint16
    assert numbers.max() == top and numbers.min() >= 0


def test_full_well_saturates_below_the_converter() -> None:
    chosen = sensor(bayer="none", read_noise_e=0.0, full_well_e=10000.0)
    numbers = expose(flat(2.0), chosen)
    assert set(numbers.ravel().tolist()) == {round(chosen.white_level_dn)}
    assert chosen.white_level_dn == pytest.approx(512 + 10000 * chosen.system_gain_dn_per_e)


def test_strange_light_gives_numbers_all_the_same() -> None:
    film = np.array([[[np.nan] * 3, [np.inf] * 3], [[-1.0] * 3, [-np.inf] * 3]])
    numbers = expose(film, sensor(bayer="none", read_noise_e=0.0))
    assert numbers[:, :, 1].tolist() == [[512, 16383], [512, 512]]


@pytest.mark.parametrize("shape", [(1, 5, 3), (5, 1, 3)])
def test_mosaic_needs_two_by_two_pixels(shape: tuple[int, int, int]) -> None:
    with pytest.raises(InputError, match=r"sensor.bayer: a mosaic needs more pixels"):
        expose(np.ones(shape), sensor())
    assert expose(np.ones(shape), sensor(bayer="none")).shape == shape


@pytest.mark.parametrize("level", [0.0, 0.02, 0.5])
def test_binned_pixels_have_mean_and_noise_of_the_raw_numbers_of_their_pixels(level: float) -> None:
    chosen = sensor(dark_e=20.0, read_noise_e=9.0, bit_depth=12, system_gain_dn_per_e=0.1, black_level_dn=256.0)
    raw = (expose(flat(level, 512), chosen) - chosen.dark_level_dn) / 0.1  # electrons
    binned = binned_exposure(flat(level, 128), chosen, 16.0, 5)
    for channel, places in ((0, [(0, 0)]), (1, [(0, 1), (1, 0)]), (2, [(1, 1)])):
        of_16 = np.mean([raw[y::2, x::2].reshape(128, 2, 128, 2).mean(axis=(1, 3)) for y, x in places], axis=0)
        seen = binned[..., channel] * chosen.white_electrons[channel]
        error = np.sqrt(of_16.var() / 128**2)
        assert seen.mean() == pytest.approx(of_16.mean(), abs=6 * error)
        assert seen.var() == pytest.approx(of_16.var(), rel=6 * np.sqrt(2 / 128**2))


def test_binned_pixels_are_white_where_one_is_full() -> None:
    full = linear_picture(expose(flat(3.0, 4), MONO), MONO).max()
    assert binned_exposure(flat(3.0, 8), replace(MONO, read_noise_e=0.0), 9.0, 1) == pytest.approx(full, rel=1e-3)
