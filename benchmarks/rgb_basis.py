"""Solves the basis spectra of linear sRGB, the table `rptcam_cl/spectra/tables/rgb_basis.csv`.

    python -m benchmarks.rgb_basis [--write]

I. Mallett and C. Yuksel, "Spectral Primary Decomposition for Rendering with sRGB Reflectance", EGSR 2019: of all
spectra that are not negative, sum to 1 and give red, green and blue under D65, those of the least squared slopes.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import WAVELENGTHS_NM, cie_1931, daylight_65, srgb_from_xyz
from rptcam_cl.core.files import replacing, spectra_dir

Array = NDArray[np.float64]
HEAD = """\
# Reflectance spectra of linear sRGB's red, green and blue under D65, solved by benchmarks/rgb_basis.py after Mallett
# and Yuksel, "Spectral Primary Decomposition for Rendering with sRGB Reflectance", EGSR 2019.
nm,red,green,blue
"""


def weights() -> Array:
    """Return the rows (3, n) that take a reflectance to linear sRGB under D65."""
    return np.asarray(srgb_from_xyz() @ (cie_1931() * daylight_65()[:, None]).T)


def problem() -> tuple[Array, Array, Array, Array, Array]:
    """Return H, A, b, G, h of: least x H x with A x = b and G x <= h; x is red and green, blue is what is left of 1."""
    count = len(WAVELENGTHS_NM)
    slopes = np.diff(np.eye(count), axis=0)
    stiffness, one, nothing = slopes.T @ slopes, np.eye(count), np.zeros((count, count))
    H = np.block([[2 * stiffness, stiffness], [stiffness, 2 * stiffness]])
    A = np.kron(np.eye(2), weights())
    G = np.block([[-one, nothing], [nothing, -one], [one, one]])
    h = np.concatenate([np.zeros(2 * count), np.ones(count)])
    return H, A, np.array([1.0, 0, 0, 0, 1, 0]), G, h


def solve() -> Array:
    """Return the basis (n, 3) by a primal-dual interior point method (Nocedal and Wright 2006, chapter 16.6)."""
    H, A, b, G, h = problem()
    x, y = np.full(H.shape[0], 1 / 3), np.zeros(len(b))
    s, z = h - G @ x, np.ones(len(h))
    for _ in range(100):
        dual, primal, inner = H @ x + A.T @ y + G.T @ z, A @ x - b, G @ x + s - h
        gap = s @ z / len(s)
        if gap < 1e-17 and np.abs(primal).max() < 1e-13:
            break
        affine = _step(H, A, G, s, z, dual, primal, inner, s * z)
        reach = _reach(s, z, affine[2], affine[3])
        centred = (s + reach * affine[2]) @ (z + reach * affine[3]) / len(s)
        target = s * z + affine[2] * affine[3] - gap * (centred / gap) ** 3
        dx, dy, ds, dz = _step(H, A, G, s, z, dual, primal, inner, target)
        reach = 0.99 * _reach(s, z, ds, dz)
        x, y, s, z = x + reach * dx, y + reach * dy, s + reach * ds, z + reach * dz
    red, green = _polished(x, H, A, b, G, h, active=s < z).reshape(2, -1)
    return np.stack([red, green, 1 - red - green], axis=1)


def _step(
    H: Array, A: Array, G: Array, s: Array, z: Array, dual: Array, primal: Array, inner: Array, target: Array
) -> tuple[Array, Array, Array, Array]:
    """Return the Newton step (dx, dy, ds, dz) towards s z = s z - target."""
    scale = z / s
    matrix = H + (G.T * scale) @ G
    right = -dual - G.T @ (scale * inner - target / s)
    size = len(A)
    whole = np.block([[matrix, A.T], [A, np.zeros((size, size))]])
    solved = np.linalg.solve(whole, np.concatenate([right, -primal]))
    dx, dy = solved[:-size], solved[-size:]
    ds = -inner - G @ dx
    return dx, dy, ds, -(target + z * ds) / s


def _reach(s: Array, z: Array, ds: Array, dz: Array) -> float:
    """Return the longest step up to 1 that keeps s and z positive."""
    both, change = np.concatenate([s, z]), np.concatenate([ds, dz])
    shrinks = change < 0
    return float(min(1.0, (-both[shrinks] / change[shrinks]).min(initial=1.0)))


def _polished(x: Array, H: Array, A: Array, b: Array, G: Array, h: Array, active: NDArray[np.bool_]) -> Array:
    """Return the solution with the bounds that hold it met exactly."""
    held = np.concatenate([A, G[active]])
    size = len(held)
    whole = np.block([[H, held.T], [held, np.zeros((size, size))]])
    right = np.concatenate([np.zeros(len(x)), b, h[active]])
    return np.linalg.lstsq(whole, right, rcond=None)[0][: len(x)]


def table_text(basis: Array) -> str:
    """Return the table of a basis; what is zero but for rounding is written as 0."""
    clean = np.where(np.abs(basis) < 1e-11, 0.0, basis)
    rows = [[wavelength, *row] for wavelength, row in zip(WAVELENGTHS_NM, clean, strict=True)]
    return HEAD + "".join(",".join(f"{value:.12g}" for value in row) + "\n" for row in rows)


def main() -> None:
    """Solve, say how good the solution is, and write the table if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="replace the table of the package")
    options = parser.parse_args()
    basis = solve()
    print(f"lowest value {basis.min():.2e}, highest {basis.max():.9f}")
    print(f"sum of squared slopes {np.square(np.diff(basis, axis=0)).sum():.8f}")
    print(f"largest error of the round trip {np.abs(weights() @ basis - np.eye(3)).max():.2e}")
    if options.write:
        with replacing(spectra_dir() / "rgb_basis.csv") as path:
            path.write_text(table_text(basis), "utf-8")


if __name__ == "__main__":
    main()
