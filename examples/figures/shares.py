"""Which share of the rays that are sent to the rear disk of a lens gets through it, in float64."""

from __future__ import annotations

import numpy as np

from rptcam_cl.rendering.traceable_lens import load_lens

ACROSS = 600  # rays over the diameter of the disk


def passing_share(name: str, film_mm: float, stop_mm: float | None = None, film_radius_mm: float = 0.0) -> float:
    """Return the share of rays from a film point, even over the disk in the rim of the last surface, that pass.

    Parameters
    ----------
    name : str
        Of the lens.
    film_mm : float
        Last vertex to film [mm].
    stop_mm : float, optional
        Diameter of the stop; open by default.
    film_radius_mm : float
        Distance of the film point from the axis.
    """
    bundled = load_lens(name)
    lens = bundled if stop_mm is None else bundled.with_stop_diameter(stop_mm)
    last = lens.surfaces[-1]
    side = (np.arange(ACROSS) + 0.5) / ACROSS * 2 - 1
    x, y = (axis.ravel() * last.semi_diameter for axis in np.meshgrid(side, side))
    inside = np.hypot(x, y) < last.semi_diameter
    rim = lens.length + float(last.sag(np.array([last.semi_diameter * (1 - 1e-12)]), np.zeros(1))[0])
    targets = np.column_stack([x, y, np.full(len(x), rim)])[inside]
    start = np.array([film_radius_mm, 0.0, lens.length + film_mm])
    return float(lens.trace(np.broadcast_to(start, targets.shape), targets - start).passed.mean())
