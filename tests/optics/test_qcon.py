"""Forbes's Qcon polynomials, and Zemax's extended aspheres, as even powers."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.native import even_powers, qcon_coefficients
from rptcam_cl.optics.library import load_lens

# Forbes 2007, table of the first polynomials, multiplied out.
PRINTED = {
    0: [1],
    1: [-5, 6],
    2: [15, -42, 28],
    3: [-35, 168, -252, 120],
}


@pytest.mark.parametrize("order", PRINTED)
def test_the_first_polynomials_are_those_printed(order):
    assert qcon_coefficients(order) == PRINTED[order]


@pytest.mark.parametrize("order", range(11))
def test_polynomials_reach_one_at_the_edge_and_are_orthogonal(order):
    assert sum(qcon_coefficients(order)) == 1
    mine = Polynomial(qcon_coefficients(order))
    for other in range(order):
        product = (mine * Polynomial(qcon_coefficients(other)) * Polynomial([0, 0, 0, 0, 1])).integ()
        assert product(1.0) == pytest.approx(0.0, abs=1e-9 * max(map(abs, qcon_coefficients(order))))


def direct(coefficients, u):
    """The sum by the recurrence of Jacobi polynomials P_m^(0,4)(2 x - 1), as good as float64 gets."""
    x = 2 * u * u - 1
    before, now, total = np.zeros_like(x), np.ones_like(x), np.zeros_like(x)
    for m, a in enumerate(coefficients):
        total += a * now
        n, s = m + 1, 2 * (m + 1) + 4
        ahead = (s - 1) * (s * (s - 2) * x - 16) * now - 2 * (n - 1) * (n + 3) * s * before
        before, now = now, ahead / (2 * n * (n + 4) * (s - 2))
    return u**4 * total


def telephone(coefficients, **more):
    row = {"radius": 1.9, "conic": -0.7, "thickness": 0.8, "glass": {"nd": 1.5445, "vd": 56.0}, "diameter": 2.4}
    row |= {"qcon": {"radius": 1.25, "coefficients": coefficients}} | more
    return load_lens({"name": "telephone", "surfaces": [row, {"diameter": 2.4}]})


def test_sag_is_that_of_the_recurrence():
    coefficients = [0.21, -0.034, 0.008, -2.1e-3, 6e-4, -1.7e-4, 5e-5, -1e-5]
    surface = telephone(coefficients).surfaces[0]
    r = np.linspace(0, 1.2, 50)
    conic = (r * r / 1.9) / (1 + np.sqrt(1 - 0.3 * (r / 1.9) ** 2))
    np.testing.assert_allclose(surface.sag(r, 0 * r), conic + direct(coefficients, r / 1.25), atol=2e-14)


def test_powers_beside_add_to_it():
    powers = dict(telephone([0.1], aspheric={4: 0.01, 6: 0.002}).surfaces[0].aspheric)
    assert powers == pytest.approx({4: 0.01 + even_powers((0.1,), 1.25)[4], 6: 0.002})


def test_units_scale_radius_and_coefficients():
    inches = {"name": "t", "unit": "in", "surfaces": [
        {"radius": 1, "diameter": 0.5, "qcon": {"radius": 0.3, "coefficients": [0.01, -0.002]}}]}  # fmt: skip
    surface = load_lens(inches).surfaces[0]
    u = 5.0 / (0.3 * 25.4)
    sag = 25.4 - np.sqrt(25.4**2 - 25) + 25.4 * float(direct([0.01, -0.002], np.array([u]))[0])
    assert surface.rim_sag(5.0) == pytest.approx(sag, abs=1e-12)


@pytest.mark.parametrize(
    ("qcon", "text"),
    [
        ({"coefficients": [1]}, "radius is missing"),
        ({"radius": 0, "coefficients": [1]}, "qcon.radius: must be above 0"),
        ({"radius": 1, "coefficients": []}, "qcon.coefficients: expected a list of numbers"),
        ({"radius": 1, "coefficients": [0.0] * 20}, "qcon.coefficients: at most 19"),
        ({"radius": 1, "coefficient": [1]}, "did you mean coefficients?"),
    ],
)
def test_what_is_no_qcon_is_refused(qcon, text):
    with pytest.raises(InputError) as error:
        load_lens({"name": "t", "surfaces": [{"radius": 9, "diameter": 1, "qcon": qcon}]})
    assert text in str(error.value)


XASPHERE = """\
MODE SEQ
UNIT MM
SURF 0
  TYPE STANDARD
  DISZ INFINITY
SURF 1
  STOP
  TYPE XASPHERE
  CURV 0.5
  XDAT 1 3 0 0 1 0 0 ""
  XDAT 2 2 0 0 1 0 0 ""
  XDAT 3 0.01 0 0 1 0 0 ""
  XDAT 4 -0.02 0 0 1 0 0 ""
  XDAT 5 0.003 0 0 1 0 0 ""
  XDAT 6 99 0 0 1 0 0 ""
  DISZ 0.5
  GLAS ___BLANK 1 0 1.5445 56 0 0 0 0 0 0
  CONI -0.4
  DIAM 0.9
SURF 2
  TYPE STANDARD
  CURV 0
  DISZ 2
  DIAM 0.9
SURF 3
  TYPE STANDARD
  CURV 0
"""


def test_extended_aspheres_of_zemax_are_powers_of_r_over_their_norm(tmp_path):
    path = tmp_path / "phone.zmx"
    path.write_text(XASPHERE)
    surface = load_lens(path).surfaces[0]
    assert surface.conic == -0.4
    assert dict(surface.aspheric) == pytest.approx({2: 0.01 / 4, 4: -0.02 / 16, 6: 0.003 / 64})
