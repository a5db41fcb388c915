"""How noise falls: sums of even blocks."""

import numpy as np
import pytest

from rptcam_cl.studies.tradeoff_errors import NoiseLaw, noise_law


def law(exponent):
    return NoiseLaw((8.0, 128.0), (1.0, 16.0**exponent), exponent, exponent)


@pytest.mark.parametrize("samples", [1, 8, 77, 128, 1000, 4096, 0.25])
def test_independent_samples_have_no_blocks(samples):
    assert law(-1.0).after(samples) == pytest.approx(8 / samples)


def test_other_numbers_than_powers_of_two_are_noisier():
    even = law(-1.5)
    assert even.after(256) == pytest.approx(32**-1.5)
    expected = sum(block**2 * (block / 8) ** -1.5 for block in (128, 64, 16, 4)) / 212**2
    assert even.blocks(212) == pytest.approx(expected)
    assert expected > 1.3 * even.even(212)
    assert even.after(212) == pytest.approx((expected * even.even(212)) ** 0.5)
    assert even.least(212) < even.even(212) < even.after(212) < expected < even.most(212)


@pytest.mark.parametrize("exponent", [-1.0, -1.3, -1.7])
@pytest.mark.parametrize("noise", [30.0, 0.5, 0.01, 1e-5])
def test_samples_to_a_noise_are_enough_and_not_too_many(exponent, noise):
    falls = law(exponent)
    samples = float(falls.until(noise))
    assert falls.after(samples) <= noise * 1.0001
    assert falls.after(0.999 * samples) > noise


def test_laws_of_replicates_are_those_of_each():
    noise = np.array([1.0, 2.0, 0.5])
    many = noise_law((2, 8, 128), noise, np.array([[1.0, 2.0], [0.03, 0.03]]), np.array([-1.2, -1.3, -1.1]))
    targets = np.array([1e-3, 3.0, 0.05])
    for k in range(3):
        one = NoiseLaw(many.samples, (many.noise[0][k], many.noise[1][k]), many.before[k], many.beyond[k])
        assert many.until(targets)[k] == pytest.approx(float(one.until(targets[k])))
        assert many.after(212.0)[k] == pytest.approx(float(one.after(212.0)))
    assert many.noise[1][0] == pytest.approx(0.02)
    assert many.beyond[0] == pytest.approx((np.log(0.02) / np.log(16) - 1) / 2)


def test_no_noise_takes_no_samples():
    none = NoiseLaw((8.0, 128.0), (0.0, 0.0), -1.0, -1.0)
    assert none.after(5.0) == 0 and none.until(1e-4) == 0
