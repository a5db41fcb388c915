"""Forbes's polynomials, Qcon and Qbfs, by which telephone lenses give their aspheres, as even powers of r.

With u = r / radius they add u^4 (a_0 Q_0(u^2) + a_1 Q_1(u^2) + ...) to the conic. Q_m(x) is the Jacobi polynomial
P_m^(0,4)(2 x - 1), so that each a_m says by how much the surface leaves the conic (G. Forbes, Shape specification for
axially symmetric optical surfaces, Opt. Express 15, 5218 (2007), sec. 3).
"""

from __future__ import annotations

from math import comb, fsum

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

Array = NDArray[np.float64]

FIRST_POWER = 4
BFS_POWERS = 11  # r^2 to r^22, as many as a device takes
BFS_NODES = 64
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


def bfs_powers(
    coefficients: tuple[float, ...], radius: float, rim: float, curvature: float, conic: float
) -> tuple[dict[int, float], float]:
    """Return even powers of r that add up to Qbfs polynomials within a rim, and their largest error there [unit].

    With u = r / radius they add u^2 (1 - u^2) sqrt(1 - k c^2 r^2) / sqrt(1 - (1 + k) c^2 r^2) (a_0 Q_0(u^2) + ...),
    along the normal of the conic (G. Forbes, Opt. Express 15, 5218 (2007), sec. 4, has the factor of a sphere, k = 0).
    """

    def added(square: Array) -> Array:  # at squares of r, over r^2
        x, bent = square / radius**2, curvature**2 * square
        steep = np.sqrt((1 - conic * bent) / (1 - (1 + conic) * bent))
        return np.asarray((1 - x) * steep * _bfs_sum(coefficients, x) / radius**2)

    domain = (0.0, rim * rim)
    curve = Chebyshev.interpolate(added, BFS_POWERS - 1, domain=domain)
    values = curve.convert(kind=Polynomial).coef
    nodes = np.linspace(*domain, BFS_NODES)
    error = float(np.max(nodes * np.abs(Polynomial(values)(nodes) - added(nodes))))
    return {2 * k + 2: float(value) for k, value in enumerate(values) if value}, error


def _bfs_sum(coefficients: tuple[float, ...], x: Array) -> Array:
    """Return the sum of a_m Q_m(x) by the recurrence of G. Forbes, Opt. Express 18, 19700 (2010), eq. A.13 to A.15."""
    f, g, h = [2.0, np.sqrt(19.0) / 2], [-0.5], []
    p, q = [np.full_like(x, 2.0), 6 - 8 * x], [np.ones_like(x), (13 - 16 * x) / np.sqrt(19.0)]
    for m in range(2, len(coefficients)):
        h.append(-m * (m - 1) / (2 * f[m - 2]))
        g.append(-(1 + g[m - 2] * h[m - 2]) / f[m - 1])
        f.append(float(np.sqrt(m * (m + 1) + 3 - g[m - 1] ** 2 - h[m - 2] ** 2)))
        p.append((2 - 4 * x) * p[m - 1] - p[m - 2])
        q.append((p[m] - g[m - 1] * q[m - 1] - h[m - 2] * q[m - 2]) / f[m])
    return np.asarray(sum(a * part for a, part in zip(coefficients, q, strict=False)))
