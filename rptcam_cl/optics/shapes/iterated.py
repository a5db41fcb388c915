"""Surfaces that rays meet by Newton's iteration: bounded, and with a reason where it ends without a hit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.optics.shapes.shape import Hits, Profile, Shape, on_vertex_plane

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ITERATIONS = 24
LAST_STEP = 1e-9  # of the distance scale; a Newton step leaves an error like its square, less than rounding does
WORTH_MOVING = 0.75  # share of rays still under way, below which they are moved together


class Iterated(Shape):
    """A surface met by Newton's iteration on its sag and slopes."""

    def meet(self, profile: Profile, points: Array, directions: Array) -> Hits:
        """Return the hits."""
        dx, dy, dz = directions
        x0, y0, to_plane = on_vertex_plane(points, directions)
        start = self.first_guess(profile, x0, y0, directions)
        step, converged, crossed = self._iterate(profile, x0, y0, directions, start)
        hit = np.stack([x0 + step * dx, y0 + step * dy, step * dz])
        normal = self.normal_at(profile, *hit)
        normal /= np.sqrt(np.sum(normal * normal, axis=0))
        cosine = np.sum(normal * directions, axis=0)
        reached = np.isfinite(step)
        met = reached & converged & (normal[2] > 0) & (cosine * dz > 0)
        return Hits(hit, to_plane + step, normal, cosine, met, reached & ~converged & crossed)

    def first_guess(self, profile: Profile, x: Array, y: Array, directions: Array) -> Array:
        """Return the step from the vertex plane at which the iteration starts: there."""
        return np.zeros_like(x)

    def newton_step(self, profile: Profile, x: Array, y: Array, z: Array, d: Array) -> tuple[Array, Array]:
        """Return Newton's step for rays at points, and on which side of the surface these lie, by its sign."""
        with np.errstate(invalid="ignore", divide="ignore"):
            sag, zx, zy = self.sag_and_slopes(profile, x, y)
        return (z - sag) / (d[2] - zx * d[0] - zy * d[1]), z - sag

    def normal_at(self, profile: Profile, x: Array, y: Array, z: Array) -> Array:
        """Return normals (3, n) of any length."""
        with np.errstate(invalid="ignore", divide="ignore"):
            _, zx, zy = self.sag_and_slopes(profile, x, y)
        return np.stack([-zx, -zy, np.ones_like(zx)])

    def _iterate(
        self, profile: Profile, x0: Array, y0: Array, directions: Array, start: Array
    ) -> tuple[Array, Mask, Mask]:
        """Return the step from the vertex plane to the surface, NaN where lost, which converged, and which crossed it.

        A ray that strays to three clear radii is lost: there the polynomial of an asphere means nothing. One that does
        not converge and was never seen on the other side of the surface does not cross it either.
        """
        step, converged, crossed = start.copy(), np.zeros(start.shape, dtype=bool), np.zeros(start.shape, dtype=bool)
        limit = 9.0 * profile.semi_diameter**2
        rows, t, d, first = np.arange(len(start)), start, directions, None
        last_step, done = LAST_STEP * (np.abs(x0) + np.abs(y0) + np.abs(start)) + 1e-300, converged.copy()
        for _ in range(ITERATIONS):
            x, y = x0 + t * d[0], y0 + t * d[1]
            change, side = self.newton_step(profile, x, y, t * d[2], d)
            first = side if first is None else first
            crossed[rows] |= side * first < 0
            good = done | (x * x + y * y <= limit)
            t = np.where(good, t - change, np.nan)
            done |= np.abs(change) <= last_step
            done &= good
            step[rows], converged[rows] = t, done
            active = good & ~done
            if not active.any():
                break
            if np.count_nonzero(active) < WORTH_MOVING * len(rows):
                kept = (rows, x0, y0, t, last_step, done, first)
                rows, x0, y0, t, last_step, done, first = (values[active] for values in kept)
                d = d[:, active]
        return step, converged, crossed
