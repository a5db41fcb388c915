"""An oracle of its own for the light on the axis: meridional rays of the film's centre, in the centre form, float64.

A ray through the height h in the plane of the last vertex stands for a ring, so the irradiance for radiance 1 is the
integral of 2 pi h Z^2 / (h^2 + Z^2)^2 dh over the heights that pass. The prescriptions are rows (radius, thickness,
index on the film's side, clear diameter) [mm], radius 0 being the stop.
"""

import numpy as np

HEIGHTS = 40000

LENSES = {
    "dgauss-50mm": (
        (29.475, 3.76, 1.67, 25.2), (84.83, 0.12, 1, 25.2), (19.275, 4.025, 1.67, 23), (40.77, 3.275, 1.699, 23),
        (12.75, 5.705, 1, 18), (0, 4.5, 1, 17.1), (-14.495, 1.18, 1.603, 17), (40.77, 6.065, 1.658, 20),
        (-20.385, 0.19, 1, 20), (437.065, 3.22, 1.717, 20), (-39.73, 0, 1, 20),
    ),
    "wide-22mm": (
        (35.98738, 1.21638, 1.54, 23.716), (11.69718, 9.9957, 1, 17.996), (13.08714, 5.12622, 1.772, 12.364),
        (-22.63294, 1.76924, 1.617, 9.812), (71.05802, 0.8184, 1, 9.152), (0, 2.27766, 1, 8.756),
        (-9.58584, 2.43254, 1.617, 8.184), (-11.28864, 0.11506, 1, 9.152), (-166.7765, 3.09606, 1.713, 10.648),
        (-7.5911, 1.32682, 1.805, 11.44), (-16.7662, 3.98068, 1, 12.276), (-7.70286, 1.21638, 1.617, 13.42),
        (-11.97328, 0, 1, 17.996),
    ),
    "fisheye-10mm": (
        (30.2249, 0.8335, 1.62, 30.34), (11.3931, 7.4136, 1, 20.68), (75.2019, 1.0654, 1.639, 17.8),
        (8.3349, 11.1549, 1, 13.42), (9.5882, 2.0054, 1.654, 9.02), (43.8677, 5.3895, 1, 8.14), (0, 1.4163, 1, 6.08),
        (29.4541, 2.1934, 1.517, 5.96), (-5.2265, 0.9714, 1.805, 5.84), (-14.2884, 0.0627, 1, 5.96),
        (-22.3726, 0.94, 1.673, 5.96), (-15.0404, 0, 1, 6.52),
    ),
    "telephoto-250mm": (
        (54.6275, 12.52, 1.529, 47.5), (-86.365, 3.755, 1.599, 44.5), (271.7625, 2.8175, 1, 41.5),
        (0, 67.4125, 1, 40.5), (-32.13, 3.755, 1.613, 31.5), (49.5325, 12.52, 1.603, 33.5), (-50.945, 0, 1, 37),
    ),
}  # fmt: skip


def axial_irradiance(name, film_distance_mm, stop_mm):
    """Return the irradiance of the film's centre for radiance 1."""
    edge = LENSES[name][-1][3] / 2
    heights = (np.arange(HEIGHTS) + 0.5) * edge / HEIGHTS
    rings = 2 * np.pi * heights * film_distance_mm**2 / (heights**2 + film_distance_mm**2) ** 2 * edge / HEIGHTS
    with np.errstate(invalid="ignore"):
        return float(rings[_passes(LENSES[name], heights, film_distance_mm, stop_mm)].sum())


def _passes(rows, height, film_distance_mm, stop_mm):
    """Trace rays; z is 0 at the last vertex and grows towards the scene. Roots of what misses are not a number."""
    length = np.hypot(height, film_distance_mm)
    y, z, dy, dz = height, np.zeros_like(height), height / length, film_distance_mm / length
    passing, vertex = np.ones(len(height), bool), 0.0
    for number in reversed(range(len(rows))):
        radius, thickness, behind, diameter = rows[number]
        vertex += thickness
        ahead = rows[number - 1][2] if number else 1.0
        if radius == 0:
            y, z = y + (vertex - z) / dz * dy, np.full_like(y, vertex)
            passing &= abs(y) <= stop_mm / 2
            continue
        centre = vertex - radius  # a positive radius has its centre on the film's side
        along = y * dy + (z - centre) * dz
        root = np.sqrt(along**2 - (y**2 + (z - centre) ** 2 - radius**2))
        t = -along + np.copysign(root, radius)
        y, z = y + t * dy, z + t * dz
        passing &= abs(y) <= diameter / 2
        ny, nz = y / radius, (z - centre) / radius  # towards the scene at the vertex
        ratio, cosine = behind / ahead, ny * dy + nz * dz
        turn = np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine
        dy, dz = ratio * dy + turn * ny, ratio * dz + turn * nz
        passing &= np.isfinite(dz)
    return passing
