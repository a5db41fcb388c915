"""Reconstruction filters of the film as tables of places to sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.scene import FilmFilter

CELLS = 1024  # of the table: places between its entries are off by less than 1e-3 of the filter's integral
STEPS = 1 << 16  # of the quadrature over the radius


@dataclass(frozen=True)
class FilterTable:
    """A filter for ``kernels/camera/filter.h``.

    Attributes
    ----------
    cells : int
        Cells of the table; 0 for a box of one pixel, which needs none.
    table : float32 array
        Where the filter changes its sign [pixels], the ratio of the integrals of |f| and f, and ``cells + 1`` places.
    """

    cells: int
    table: NDArray[np.float32]


def filter_value(kind: str, x: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return a filter at a distance ``x`` from the centre [pixels], 0 beyond its radius; its scale is arbitrary."""
    t = np.abs(x) / radius
    value: NDArray[np.float64]
    if kind == "box":
        value = np.ones_like(t)
    elif kind == "tent":
        value = 1 - t
    elif kind == "gaussian":  # falls to e^-4.5 at its radius, three standard deviations out, and by that much to zero
        value = np.exp(-4.5 * t * t) - np.exp(-4.5)
    elif kind == "blackman_harris":  # four terms, minimum side lobes (Harris 1978, table 1)
        turn = np.pi * (1 + t)
        value = 0.35875 - 0.48829 * np.cos(turn) + 0.14128 * np.cos(2 * turn) - 0.01168 * np.cos(3 * turn)
    else:
        value = _mitchell(2 * t)
    return np.where(t <= 1, value, 0.0)


def _mitchell(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mitchell and Netravali 1988 with B = C = 1/3, radius 2."""
    near = (7 * x**3 - 12 * x**2 + 16 / 3) / 6
    far = (-7 / 3 * x**3 + 12 * x**2 - 20 * x + 32 / 3) / 6
    return np.where(x < 1, near, far)


def filter_table(film_filter: FilmFilter) -> FilterTable:
    """Return the table of a filter: the inverse of the integral of its magnitude."""
    kind, radius = film_filter.kind, film_filter.radius
    if kind == "box" and radius == 0.5:
        return FilterTable(0, np.zeros(1, np.float32))
    edges = np.linspace(0, radius, STEPS + 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    value = filter_value(kind, middles, radius)
    half = np.concatenate([[0.0], np.cumsum(np.abs(value))]) / np.abs(value).sum()
    places = np.interp(np.linspace(0, 1, CELLS // 2 + 1), half, edges)
    changes = middles[value < 0]
    head = [changes[0] if len(changes) else 2 * radius, np.abs(value).sum() / value.sum()]
    table = np.concatenate([head, -places[:0:-1], places])
    return FilterTable(CELLS, table.astype(np.float32))
