"""Numbers of the documents that a lens has by itself, beside ours: each function returns a Markdown table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rptcam_cl import load_lens
from rptcam_cl.errors import InputError
from rptcam_cl.lens_tracing import TraceableLens
from rptcam_cl.optics.design import GlassChoice, doublet_radii, image_distances
from rptcam_cl.optics.focus import film_distance, object_distance
from rptcam_cl.optics.glass import WAVELENGTH_D
from rptcam_cl.optics.summary import image_circle, stop_diameter_by_sine

NEAR_AXIS = 0.01  # share of the clear radius
PIXEL_MM = 70 / math.hypot(300, 300)  # of the assignment of 2015: 300 x 300 pixels, 70 mm across

# Object to film, image distance and magnification of the paper's closed form (R = 4, t = 0.01, n = 1.8).
PLACEMENTS = {
    11: (3.846303, 0.53767),
    15: (3.172281, 0.26821),
    18: (3.002085, 0.20017),
    20: (2.930898, 0.17171),
    25: (2.819336, 0.12711),
    30: (2.754253, 0.10109),
    50: (2.640874, 0.05576),
}
# Index, lens to film: focal length and the height z in the scene of the plane in focus (the film is at z = 7).
INDICES = {1.8: (3.22418, 2.50139, -7.38), 2.3: (3.56858, 1.53955, 0.72), 3.5: (3.78865, 0.80071, 2.20)}
# Lens, film distance: paraxial focus from the first vertex [mm], radius of the image circle [mm].
LENSES_2015: dict[str, tuple[float, float, float | None]] = {
    "dgauss-50mm": (36.77, 3846, 28.30),
    "wide-22mm": (14.54, 2194, 25.38),
    "fisheye-10mm": (23.192, 3165, 13.45),
    "telephoto-250mm": (123.7439, 3668, None),
}
# Stop diameters [mm] by f-number.
STOPS_2003 = {
    ("dgauss-100mm", 2.0): "34.2675",
    ("dgauss-100mm", 1.4): "47.2, unobtainable",
    ("dgauss-100mm", 2.8): "24.681",
    ("dgauss-100mm", 4.0): "17.325",
    ("dgauss-100mm", 5.6): "12.388",
    ("dgauss-100mm", 8.0): "8.675",
    ("telephoto-250mm", 5.6): "40.444",
    ("fisheye-10mm", 4.0): "6.070",
    ("wide-22mm", 4.0): "5.972",
}
# Lens, share of the rear clear radius: distance in focus, and where a ray of the film's centre crosses the axis [mm].
CROSSINGS_2003: dict[tuple[str, float], dict[int, float]] = {
    ("dgauss-100mm", 0.1): {500: 499.71, 1000: 998.91, 2000: 1996.0, 5000: 4977},
    ("dgauss-100mm", 0.5): {500: 494.9, 1000: 981, 2000: 1936, 5000: 4666},
    ("telephoto-250mm", 0.1): {1000: 999.1, 2000: 1995.8, 5000: 4971},
    ("wide-22mm", 0.1): {1000: 903},
    ("fisheye-10mm", 0.1): {1000: 918},
}


def table(head: Sequence[Any], rows: Sequence[Sequence[Any]]) -> str:
    """Return a Markdown table."""
    lines: list[Sequence[Any]] = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def paper_singlet(index: float = 1.8, diameter: float = 0.4) -> TraceableLens:
    """Return the single lens of the rptcam paper, one of its units being a millimetre."""
    surfaces = [
        {"radius": 4, "thickness": 0.01, "glass": {"index": index}, "diameter": diameter, "stop": True},
        {"radius": -4, "diameter": diameter},
    ]
    return load_lens({"name": "single lens", "surfaces": surfaces})


def blur_on_film(
    lens: TraceableLens, film_mm: float, object_to_film_mm: float, wavelength_nm: float = WAVELENGTH_D
) -> float:
    """Return the diameter [mm] of the blur of a point on the axis, to first order: by a traced ray near the axis."""
    front = object_to_film_mm - lens.length - film_mm
    aim = [[0, NEAR_AXIS * lens.surfaces[0].semi_diameter, front]]
    rays = lens.trace([[0, 0, -front]], aim, wavelength_nm, start="scene")
    (origin,), (direction,) = rays.origins, rays.directions
    height = origin[1] + direction[1] / direction[2] * (lens.length + film_mm - origin[2])
    return 2 * abs(float(height)) / NEAR_AXIS


def placements() -> str:
    """Return where the paper's single lens stands for an object (table of its closed form)."""
    lens = paper_singlet()
    length = lens.first_order().focal_length_mm
    rows = []
    for distance, (placed, magnification) in PLACEMENTS.items():
        ours = image_distances(length, distance)[0]
        thick = film_distance(lens, distance) + lens.length / 2
        rows.append([distance, placed, f"{ours:.6f}", f"{thick:.6f}", magnification, f"{ours / (distance - ours):.5f}"])
    head = [
        "object to film",
        "lens to film, paper",
        "ours, same formula",
        "ours, exact",
        "magnification, paper",
        "ours",
    ]
    return table(head, rows)


def indices() -> str:
    """Return focal length and plane of focus for three indices of refraction (figure 3)."""
    rows = []
    for index, (placed, focal, focus) in INDICES.items():
        lens = paper_singlet(index, 0.07)
        ours = 7 - object_distance(lens, placed - lens.length / 2)
        rows.append([index, placed, focal, f"{lens.first_order().focal_length_mm:.5f}", focus, f"{ours:.2f}"])
    return table(["n", "lens to film", "f, paper", "f, ours", "plane in focus z, paper's formula", "ours"], rows)


def doublet_of_the_paper() -> str:
    """Return the radii of the paper's default doublet."""
    radii = doublet_radii(2.5, GlassChoice(1.3, 3.0), GlassChoice(1.8, 1.0), "r1", 4.0)
    return table(["doublet", "r1", "r2", "r3"], [
        ["paper", 4, -0.5714286, -0.6666667],
        ["ours", *(f"{radius:.7f}" for radius in radii)],
    ])  # fmt: skip


def focus_and_circle() -> str:
    """Return what the four lenses of 2015 focus on and how far they light the film."""
    rows = []
    for name, (film, focus, circle) in LENSES_2015.items():
        lens = load_lens(name)
        ours = object_distance(lens, film) - lens.length - film
        radius = image_circle(lens, film)
        expected, found = (
            "beyond the film" if value is None else f"{value:.2f} = {value / PIXEL_MM:.1f} px"
            for value in (circle, radius)
        )
        rows.append([f"`{name}`", f"{film:g}", focus, f"{ours:.0f}", expected, found])
    head = ["lens", "film distance [mm]", "in focus from first vertex [mm], expected", "ours"]
    return table([*head, "image circle radius [mm], expected", "ours"], rows)


def ball() -> str:
    """Return the focal length of the ball lens."""
    ours = load_lens("ball").first_order().focal_length_mm
    return table(
        ["ball of radius 20 mm, n = 1.5", "focal length [mm]"], [["n R / (2 (n - 1))", 30], ["ours", f"{ours:.6f}"]]
    )


def stops() -> str:
    """Return the stop diameters of the assignment of 2003: a ray from the rear focal point with sin θ = 1 / (2 N)."""
    rows = []
    for (name, f_number), expected in STOPS_2003.items():
        try:
            ours = f"{stop_diameter_by_sine(load_lens(name), f_number):.4f}"
        except InputError as error:
            ours = "refused: " + str(error).split(": ", 1)[1]
        rows.append([f"`{name}`", f"f/{f_number:g}", expected, ours])
    return table(["lens", "stop", "diameter [mm], expected", "ours"], rows)


def crossing(name: str, share: float, distance_mm: float) -> float:
    """Return where a ray from the centre of the film crosses the axis in front of the first vertex [mm].

    The film stands where the thick lens puts it for that distance; the ray leaves the lens's rear vertex plane at a
    share of the rear clear radius.
    """
    lens = load_lens(name)
    film = film_distance(lens, distance_mm, "front")
    height = share * lens.surfaces[-1].semi_diameter
    rays = lens.trace([[0, 0, lens.length + film]], [[0, height, -film]])
    (origin,), (direction,) = rays.origins, rays.directions
    return float(-(origin[2] - origin[1] * direction[2] / direction[1]))


def focus_rays() -> str:
    """Return the focus test of the assignment of 2003."""
    rows = []
    for (name, share), expected in CROSSINGS_2003.items():
        for distance, crosses in expected.items():
            ours = crossing(name, share, distance)
            rows.append([f"`{name}`", f"{share:.0%}", distance, crosses, f"{ours:.2f}", f"{ours / distance - 1:+.2%}"])
    return table(["lens", "height at the rear", "in focus [mm]", "crosses the axis, expected", "ours", "off by"], rows)
