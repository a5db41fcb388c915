"""Numbers of the documents that show on the film, beside those of our renders, as Markdown tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from examples.figures.figure import ROOT, shared
from examples.figures.lens_numbers import blur_on_film, paper_singlet, table
from rptcam_cl import autofocus, render
from rptcam_cl.optics.focus import film_distance

# Figure 2: stop diameter against the blur [pixels of 800] of what is at z = -4, 1, 2 and 3; the film is at z = 7.
HEIGHTS = (-4, 1, 2, 3)
STOPS = {0.02: (0.25, 1.7, 3.1, 7.7), 0.05: (0.63, 4.4, 7.6, 19.3), 0.07: (0.88, 6.1, 10.7, 27)}
STOPS_FILM = 3.21918
# Figure 5: distance in focus against the blur of the spheres [pixels of 800] at these distances from the film.
SPHERES = (15, 20, 25, 30)
FOCUSED = {15: (0, 31.9, 49.2, 60.0), 20: (28.5, 0, 15.6, 25.4), 25: (41.7, 14.8, 0, 9.4), 30: (49.5, 23.5, 9.1, 0)}
# Film distance and stop [mm] against the irradiance of the film at these radii [mm] for a world of radiance 1.
RADII = (0, 5, 10, 15, 20, 25, 30, 35)
IRRADIANCES: dict[tuple[str, float, float], tuple[float, ...]] = {
    ("dgauss-50mm", 36.77, 17.1): (0.18893, 0.16371, 0.12362, 0.08187, 0.04346, 0.01196, 0, 0),
    ("dgauss-50mm", 36.77, 8.55): (0.04665, 0.04608, 0.04411, 0.04104, 0.03200, 0.01162, 0, 0),
    ("wide-22mm", 14.54, 8.756): (0.0990, 0.0853, 0.0619, 0.0381, 0.0173, 0.00037, 0, 0),
    ("fisheye-10mm", 23.192, 6.08): (0.04914, 0.03860, 0.01969, 0, 0, 0, 0, 0),
    ("telephoto-250mm", 123.7439, 40.5): (0.02062, 0.02050, 0.02046, 0.02029, 0.02005, 0.01907, 0.01728, 0.01516),
    ("telephoto-250mm", 123.7439, 20.25): (0.00546, 0.00542, 0.00537, 0.00531, 0.00524, 0.00519, 0.00514, 0.00502),
}
# Picture: radiance of its lamp, value that the vignetting table gives on the axis, value in the reference pictures.
LIT_FLOORS = {
    "cones_dgauss": (40, 1.335, 1.303),
    "cones_wide": (75, 1.311, 1.275),
    "cones_fisheye": (150, 1.302, 1.212),
    "cones_telephoto": (320, 1.165, 1.176),
}
# The reference pictures are of this scene without its walls, which keep a quarter of the light off the floor.
WITHOUT_WALLS = ("materials.wall_x.opacity=0", "materials.wall_z.opacity=0", "objects.3.center=[0, 10, 0]")
MIDDLE = [125 / 300, 175 / 300, 125 / 300, 175 / 300]

Values = NDArray[np.float64]


def blurs_of_stops() -> str:
    """Return the blur on the axis for three stops (figure 2)."""
    rows: list[list[Any]] = []
    for diameter, expected in STOPS.items():
        lens = paper_singlet(diameter=diameter)
        ours = [100 * blur_on_film(lens, STOPS_FILM, 7 - z) for z in HEIGHTS]
        rows.append([diameter, "formula", *expected])
        rows.append(["", "our lens", *(f"{blur:.2f}" for blur in ours)])
    return table(["stop diameter", "blur [px of 800]", *(f"z = {z}" for z in HEIGHTS)], rows)


def blurs_of_distances() -> str:
    """Return the blur on the axis for four distances in focus (figure 5), to first order and as rendered."""
    rows: list[list[Any]] = []
    lens = paper_singlet()
    for focus, expected in FOCUSED.items():
        film = film_distance(lens, focus)
        rows.append([focus, "formula", *expected])
        rows.append(["", "our lens", *(f"{1000 * blur_on_film(lens, film, distance):.1f}" for distance in SPHERES)])
        rows.append(["", "our film", *(f"{blur_in_picture(focus, distance):.1f}" for distance in SPHERES)])
    return table(["in focus", "blur [px of 800]", *(f"object at {distance}" for distance in SPHERES)], rows)


def found_by_autofocus() -> str:
    """Return where autofocus finds the sphere at 25 units of figure 8, whose front is at 24.5."""
    rows = [["sphere", "24.5 (front) to 25 (rim)"], ["maximum of the variance, paper's renderer", "27.5 ± 2"]]
    for method in ("contrast", "depth"):
        report = autofocus(ROOT / "examples" / "paper" / "autofocus.yaml", method)
        assert report.focus_distance_m is not None
        rows.append([f"ours, `{method}`", f"{1000 * report.focus_distance_m:.2f}"])
    return table(["", "in focus, from the film"], rows)


def blur_in_picture(focus: float, distance: float) -> float:
    """Return the blur [pixels of 800] of a card at a distance from the film: of the beams that the camera traces."""
    surfaces = [
        {"radius": 4, "thickness": 0.01, "glass": {"index": 1.8}, "diameter": 0.4, "stop": True},
        {"radius": -4, "diameter": 0.4},
    ]
    camera = {"kind": "realistic", "eye": [0, 0, 0], "target": [0, 0, -1], "focus": {"distance_m": focus / 1000}}
    card = {"shape": "disk", "center": [0, 0, -distance], "normal": [0, 0, 1], "radius": 0.2 * distance}
    scene = {
        "metres_per_unit": 0.001,
        "film": {"resolution": [800, 600], "width_mm": 0.8, "crop": [0.495, 0.505, 0.495, 0.505]},
        "camera": camera | {"lens": {"name": "single lens", "surfaces": surfaces}},
        "objects": [card | {"material": {"kind": "matte", "reflectance": 0.5}}],
        "environment": {"kind": "constant", "radiance": 1},
    }
    return float(np.mean(render(scene, spp=1, layers=["coc"])["coc"]))


def irradiance_by_radius(lens: str, film_mm: float, stop_mm: float, spp: int = 4096) -> tuple[Values, Values]:
    """Return the rendered irradiance of the film at `RADII` in an even world of radiance 1, and its standard error.

    The film is a strip of pixels of 0.2 mm from the axis to one side.
    """
    scene = {
        "film": {"resolution": [353, 1], "size_mm": [70.6, 0.2], "crop": [176 / 353, 1, 0, 1]},
        "camera": {
            "kind": "realistic",
            "lens": lens,
            "stop_diameter_mm": stop_mm,
            "focus": {"film_distance_mm": film_mm},
            "eye": [0, 0, 0],
            "target": [0, 0, -1],
        },
        "exposure": "irradiance",
        "environment": {"kind": "constant", "radiance": 1},
    }
    image = render(scene, spp=spp, layers=["variance"])
    places = [round(radius / 0.2) for radius in RADII]
    values = np.asarray(image, float)[0, places, 0]
    return values, np.sqrt(np.asarray(image["variance"], float)[0, places])


def irradiances() -> str:
    """Return the irradiance over the radius of the film for the lenses of 2015, and what half a stop does."""
    rows: list[list[Any]] = []
    centres = {}
    for (lens, film, stop), expected in IRRADIANCES.items():
        ours, _ = irradiance_by_radius(lens, film, stop)
        centres[lens, stop] = ours[0]
        rows.append([f"`{lens}`, stop {stop:g}", "expected", *expected])
        rows.append(["", "our film", *(f"{value:.5f}" for value in ours)])
    ratio = centres["telephoto-250mm", 40.5] / centres["telephoto-250mm", 20.25]
    told = (
        f"Full over half the telephoto's stop in the centre: expected 3.78, ours {ratio:.3f} (4 without the front rim)."
    )
    return table(["irradiance at [mm]", "", *RADII], rows) + "\n\n" + told


def lit_floor(name: str, lamp: float, spp: int = 512, changes: Sequence[str] = WITHOUT_WALLS) -> float:
    """Return the 99th percentile of what lies within 25 pixels of the middle of a picture, under a lamp's radiance."""
    picture = shared(name, "")
    more = [*changes, "exposure=irradiance", f"materials.lamp.radiance={lamp}", f"film.crop={MIDDLE}"]
    pixels = np.asarray(render(replace(picture, changes=[*picture.changes, *more]).load(), spp=spp))[..., 1]
    y, x = np.mgrid[-24.5:25, -24.5:25]
    return float(np.percentile(pixels[np.hypot(x, y) < 25], 99))


def lit_floors() -> str:
    """Return how bright the middle of the four pictures, without walls, is under the lamps of the assignment."""
    rows: list[list[Any]] = [
        [name.removeprefix("cones_"), lamp, predicted, reference, f"{lit_floor(name, lamp):.3f}"]
        for name, (lamp, predicted, reference) in LIT_FLOORS.items()
    ]
    return table(["lens", "lamp", "axis, predicted", "99th percentile, reference picture", "ours"], rows)
