"""Forbes's polynomials Qcon, by which telephone lenses give their aspheres, as even powers of r.

With u = r / radius they add u^4 (a_0 Q_0(u^2) + a_1 Q_1(u^2) + ...) to the conic. Q_m(x) is the Jacobi polynomial
P_m^(0,4)(2 x - 1), so that each a_m says by how much the surface leaves the conic (G. Forbes, Shape specification for
axially symmetric optical surfaces, Opt. Express 15, 5218 (2007), sec. 3).
"""

from __future__ import annotations

from math import comb, fsum

FIRST_POWER = 4
SHIFT = 4  # the second index of the Jacobi polynomials


def qcon_coefficients(order: int) -> list[int]:
    """Return the whole numbers c_k of Q_order(x) = sum of c_k x^k."""
    return [(-1) ** (order - k) * comb(order, k) * comb(order + k + SHIFT, order) for k in range(order + 1)]


def even_powers(coefficients: tuple[float, ...], radius: float) -> dict[int, float]:
    """Return the powers of r and their coefficients, for a_0, a_1, ... and the radius at which u is 1.

    The c_k alternate and grow: with ten terms a sum loses seven digits of sixteen, of what a_9 adds.
    """
    table = [qcon_coefficients(order) for order in range(len(coefficients))]
    result = {}
    for k in range(len(coefficients)):
        value = fsum(a * table[order][k] for order, a in enumerate(coefficients) if order >= k)
        result[FIRST_POWER + 2 * k] = value / radius ** (FIRST_POWER + 2 * k)
    return result
