"""What an interface lets through: closed forms of Fresnel's equations and of a quarter-wave layer, limits, symmetry."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.glass import (
    BARE,
    MAGNESIUM_FLUORIDE,
    Interface,
    Layer,
    LayerStack,
    MeasuredReflectance,
    QuarterWave,
    amplitudes,
)

BK7 = 1.5168
MEASURED = MeasuredReflectance((400.0, 700.0), (0.004, 0.010))
THREE = LayerStack((Layer(1.38, 100.0), Layer(2.1, 131.0), Layer(1.7, 81.0)))
COATINGS = [BARE, MAGNESIUM_FLUORIDE, QuarterWave(1.9, 480.0), MEASURED, THREE]


def met_at(degrees, before, after):
    """The interface met at angles in the medium before it."""
    sine = np.sin(np.radians(degrees))
    return Interface(before, after, np.sqrt(1 - sine**2), np.sqrt(1 - (sine * before / after) ** 2))


def by_matrices(interface, coating, wavelength_nm):
    """Unpolarised reflectance of one layer by characteristic matrices (Macleod, Thin-Film Optical Filters, ch. 2)."""
    n, m, c, d = interface
    inside = np.sqrt(1 - (n / coating.index) ** 2 * (1 - c * c))
    phase = np.pi / 2 * coating.wavelength_nm / wavelength_nm * inside
    total = 0.0
    for admittance in (lambda n, c: n * c, lambda n, c: n / c):  # s, p
        layer, behind, front = admittance(coating.index, inside), admittance(m, d), admittance(n, c)
        b = np.cos(phase) + 1j * np.sin(phase) / layer * behind
        c_ = 1j * layer * np.sin(phase) + np.cos(phase) * behind
        total += abs((front * b - c_) / (front * b + c_)) ** 2 / 2
    return total


def test_bare_glass_reflects_what_the_catalogues_say():
    assert 1 - BARE.transmittance(Interface(1.0, BK7), 587.6) == pytest.approx(0.04216, abs=1e-5)
    assert 1 - BARE.transmittance(Interface(1.0, 1.5), 587.6) == pytest.approx(0.04, rel=1e-12)


def test_p_polarised_light_is_not_reflected_at_brewsters_angle():
    s, p = amplitudes(met_at(np.degrees(np.arctan(BK7)), 1.0, BK7))
    assert p == pytest.approx(0, abs=1e-12)
    assert s == pytest.approx(-(BK7**2 - 1) / (BK7**2 + 1), rel=1e-12)


def test_quarter_wave_has_its_closed_form_at_its_wavelength():
    expected = ((1.38**2 - BK7) / (1.38**2 + BK7)) ** 2
    assert 1 - MAGNESIUM_FLUORIDE.transmittance(Interface(1.0, BK7), 550.0) == pytest.approx(expected, rel=1e-12)
    assert 0.0126 < expected < 0.0130  # the 1.3 % of the catalogues
    perfect = QuarterWave(np.sqrt(1.9), 500.0)
    assert perfect.transmittance(Interface(1.0, 1.9), 500.0) == pytest.approx(1, abs=1e-14)


def test_half_wave_layer_changes_nothing():
    half = QuarterWave(1.38, 1100.0)
    bare = BARE.transmittance(Interface(1.0, BK7), 550.0)
    assert half.transmittance(Interface(1.0, BK7), 550.0) == pytest.approx(bare, rel=1e-12)


@pytest.mark.parametrize("coating", [MAGNESIUM_FLUORIDE, QuarterWave(1.9, 480.0), QuarterWave(1.38, 1300.0)])
@pytest.mark.parametrize("media", [(1.0, BK7), (BK7, 1.0), (1.333, 1.8)])
def test_layer_agrees_with_characteristic_matrices(coating, media):
    limit = 89.9 if media[0] < media[1] else np.degrees(np.arcsin(media[1] / media[0])) * 0.999
    for degrees in np.linspace(0, limit, 12):
        interface = met_at(degrees, *media)
        for wavelength in (380.0, 550.0, 780.0):
            expected = 1 - by_matrices(interface, coating, wavelength)
            assert coating.transmittance(interface, wavelength) == pytest.approx(expected, abs=1e-12)


def quarters(*indices):
    """Layers of a quarter of 550 nm each."""
    return LayerStack(tuple(Layer(index, 550.0 / 4 / index) for index in indices))


@pytest.mark.parametrize("pairs", [1, 2, 4])
def test_quarter_wave_pairs_have_their_closed_form(pairs):
    # R = ((n - Y) / (n + Y))^2, Y = m (H / L)^(2 pairs): Macleod, Thin-Film Optical Filters, 5.1
    stack = quarters(*(2.3, 1.38) * pairs)
    y = BK7 * (2.3 / 1.38) ** (2 * pairs)
    expected = ((1 - y) / (1 + y)) ** 2
    assert 1 - stack.transmittance(Interface(1.0, BK7), 550.0) == pytest.approx(expected, rel=1e-12)
    wave = stack.polarised(Interface(BK7, 1.0), 550.0)  # from the glass
    assert np.abs(wave.reflected_s) ** 2 == pytest.approx(expected, rel=1e-12)


def test_a_stack_of_one_layer_is_that_layer_and_half_waves_are_nothing():
    one, layer = quarters(1.38), MAGNESIUM_FLUORIDE
    for media in ((1.0, 1.7), (1.7, 1.0)):
        interface = met_at(30.0, *media)
        for ours, airy in zip(one.polarised(interface, 610.0), layer.polarised(interface, 610.0), strict=True):
            assert ours == pytest.approx(airy, abs=1e-14)
    halves = LayerStack((Layer(1.6, 550 / 2 / 1.6), Layer(2.2, 550 / 2 / 2.2)))
    bare = BARE.transmittance(Interface(1.0, BK7), 550.0)
    assert halves.transmittance(Interface(1.0, BK7), 550.0) == pytest.approx(bare, rel=1e-12)
    mixed = LayerStack((Layer(1.38, 40.0), Layer(1.38, 59.0)))  # two layers of one substance are one
    whole = LayerStack((Layer(1.38, 99.0),))
    assert mixed.transmittance(met_at(50.0, 1.0, 1.7), 500.0) == pytest.approx(
        whole.transmittance(met_at(50.0, 1.0, 1.7), 500.0), rel=1e-12
    )


@pytest.mark.parametrize("coating", COATINGS)
def test_light_passes_either_way_alike_and_never_more_than_whole(coating):
    degrees = np.linspace(0, 89.999, 500)
    there = met_at(degrees, 1.0, BK7)
    back = Interface(there.after, there.before, there.cosine_after, there.cosine_before)
    passed = coating.transmittance(there, 520.0)
    np.testing.assert_allclose(coating.transmittance(back, 520.0), passed, rtol=1e-12)
    assert np.all((passed > 0) & (passed <= 1))
    assert passed[-1] < 1e-3


def test_measured_coating_has_its_reflectance_and_the_angles_of_bare_glass():
    straight = MEASURED.transmittance(Interface(1.0, BK7), np.array([400.0, 550.0, 700.0]))
    np.testing.assert_allclose(straight, [0.996, 0.993, 0.990], rtol=1e-12)
    slanted = met_at(60.0, 1.0, BK7)
    same = MeasuredReflectance((0.0,), (1 - float(BARE.transmittance(slanted.head_on, 500.0)),))
    assert same.transmittance(slanted, 500.0) == pytest.approx(float(BARE.transmittance(slanted, 500.0)), rel=1e-12)


def test_measured_coating_does_not_guess_beyond_what_was_measured():
    with pytest.raises(InputError, match=r"reflectance of a coating is known from 400 to 700 nm \(requested 720 nm\)"):
        MEASURED.transmittance(Interface(1.0, BK7), 720.0)


def through_film(f, thickness_nm, interface, wavelength_nm):
    """Reflected and passed shares of s and p through one film of complex index: Airy's sum over complex amplitudes."""
    n, m, c, d = interface
    inside = np.sqrt(1 - (n / f) ** 2 * (1 - c * c))
    turn = np.exp(2j * np.pi * f * thickness_nm / wavelength_nm * inside)
    shares = []
    for front, film, behind in ((n * c, f * inside, m * d), (c / n, inside / f, d / m)):
        r, t = (front - film) / (front + film), (film - behind) / (film + behind)
        through = 4 * front * film / (front + film) / (film + behind) * turn / (1 + r * t * turn**2)
        back = (r + t * turn**2) / (1 + r * t * turn**2)
        shares.append((abs(back) ** 2, abs(through) ** 2 * behind / front))
    return shares


@pytest.mark.parametrize("thickness", [3.0, 25.0, 400.0])
@pytest.mark.parametrize("degrees", [0.0, 40.0, 75.0])
def test_a_metal_film_has_its_closed_form_from_both_sides(thickness, degrees):
    film, there = LayerStack((Layer(0.13, thickness, 3.2),)), met_at(degrees, 1.0, BK7)
    for interface in (there, Interface(there.after, there.before, there.cosine_after, there.cosine_before)):
        wave, closed = film.polarised(interface, 550.0), through_film(0.13 + 3.2j, thickness, interface, 550.0)
        for (back, through), r, t in zip(closed, wave[:2], wave[2:], strict=True):
            assert np.abs(r) ** 2 == pytest.approx(back, abs=1e-12)
            assert np.abs(t) ** 2 == pytest.approx(through, abs=1e-12)
        assert film.transmittance(interface, 550.0) == pytest.approx(np.mean([t for _, t in closed]), abs=1e-12)
    assert film.transmittance(there, 550.0) == pytest.approx(film.transmittance(interface, 550.0), abs=1e-14)


def test_what_layers_neither_reflect_nor_pass_they_absorb_and_the_same_either_way_passes():
    stack = LayerStack((Layer(1.46, 60.0), Layer(2.8, 8.0, 3.1), Layer(1.46, 90.0)))
    wave = stack.polarised(Interface(1.0, BK7), 550.0)
    r, t = np.abs(wave.reflected_s) ** 2, np.abs(wave.passed_s) ** 2
    fields = [1.0 + 0j, BK7 + 0j]  # tangential fields from behind, whose flux falls by what each layer takes
    flux, taken = BK7, 0.0
    for layer in reversed(stack.layers):
        f = complex(layer.index, layer.extinction)
        phase = 2 * np.pi * f * layer.thickness_nm / 550.0
        fields = [np.cos(phase) * fields[0] - 1j * np.sin(phase) / f * fields[1],
                  -1j * f * np.sin(phase) * fields[0] + np.cos(phase) * fields[1]]  # fmt: skip
        before = float(np.real(fields[0] * np.conj(fields[1])))
        taken, flux = taken + before - flux, before
    entering = abs((fields[0] + fields[1]) / 2) ** 2
    assert taken / entering > 0.1
    assert r + t + taken / entering == pytest.approx(1, abs=1e-12)
    thick = LayerStack((Layer(0.2, 1e7, 4.0),)).polarised(Interface(1.0, BK7), 550.0)  # 10 mm: no overflow
    assert np.abs(thick.passed_s) == 0
    bulk = abs((1 - (0.2 + 4j)) / (1 + 0.2 + 4j)) ** 2
    assert np.abs(thick.reflected_s) ** 2 == pytest.approx(bulk, abs=1e-12)
