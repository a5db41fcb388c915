"""First-order numbers of the lenses of CS348b's camera assignments, beside ours."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from examples.figures.numbers import Numbers, Ours, Row
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.irradiance import image_circle
from rptcam_cl.optics.lens import Lens, film_distance, object_distance
from rptcam_cl.rendering.traceable_lens import load_lens

PIXEL_MM = 70 / math.hypot(300, 300)  # of the assignment of 2015: 300 x 300 pixels, 70 mm across

# Focal length, f-number, length, back focal distance; F, F', P, P'; entrance and exit pupil: place and diameter. In mm,
# places from the first vertex towards the scene.
LENSES = {
    "dgauss-50mm": (
        ("50.3582", "2.030", "32.04", "36.1059"),
        ("27.1224", "-68.1459", "-23.2357", "-17.7877"),
        ("-19.9465", "24.8051", "-14.2686", "26.5385"),
    ),
    "wide-22mm": (
        ("22.0235", "2.684", "33.37108", "14.3183"),
        ("6.7299", "-47.6894", "-15.2936", "-25.6659"),
        ("-12.0887", "8.2060", "-21.9152", "9.6035"),
    ),
    "telephoto-250mm": (
        ("249.5666", "5.423", "102.78", "105.0704"),
        ("332.7025", "-207.8504", "83.1359", "41.7162"),
        ("-15.2865", "46.0163", "-28.8692", "33.0014"),
    ),
    "fisheye-10mm": (
        ("9.9914", "3.947", "33.4461", "23.1605"),
        ("-7.9649", "-56.6066", "-17.9563", "-46.6152"),
        ("-11.5424", "2.5316", "-28.7022", "7.0704"),
    ),
    "dgauss-100mm": (
        ("100.7163", "2.030", "64.08", "72.2118"),
        ("54.2449", "-136.2918", "-46.4714", "-35.5755"),
        ("-39.893", "49.6102", "-28.5373", "53.0770"),
    ),
}
# Lens, film distance: paraxial focus from the first vertex [mm], radius of the image circle [mm and pixels].
LENSES_2015 = {
    "dgauss-50mm": (36.77, "3846", "28.30", "171.5"),
    "wide-22mm": (14.54, "2194", "25.38", "153.8"),
    "fisheye-10mm": (23.192, "3165", "13.45", "81.5"),
    "telephoto-250mm": (123.7439, "3668", "beyond 40", "beyond 242"),
}
# f-number, film distance, and what the circle across must be: the film's side, or more than its diagonal [mm].
FITTED_2003 = {
    "telephoto-250mm": (5.6, 123.7439, "beyond 70"),
    "wide-22mm": (4.0, 14.54, "50.8"),
    "fisheye-10mm": (4.0, 23.192, "26.9"),
}
# Stop diameters [mm] by f-number.
STOPS_2003 = {
    ("dgauss-100mm", 2.0): "34.2675",
    ("dgauss-100mm", 1.4): "47.2, unobtainable",
    ("dgauss-100mm", 2.8): "24.681",
    ("dgauss-100mm", 4.0): "17.325",
    ("dgauss-100mm", 5.6): "12.388",
    ("dgauss-100mm", 8.0): "8.675",
    ("dgauss-50mm", 2.8): "12.340",
    ("dgauss-50mm", 8.0): "4.338",
    ("telephoto-250mm", 5.6): "40.444",
    ("fisheye-10mm", 4.0): "6.070",
    ("wide-22mm", 4.0): "5.972",
}
# Lens, share of the rear clear radius: distance in focus, and where a ray of the film's centre crosses the axis [mm].
CROSSINGS_2003: dict[tuple[str, float], dict[int, str]] = {
    ("dgauss-100mm", 0.1): {500: "499.71", 1000: "998.91", 2000: "1996.0", 5000: "4977"},
    ("dgauss-100mm", 0.5): {500: "494.9", 1000: "981", 2000: "1936", 5000: "4666"},
    ("telephoto-250mm", 0.1): {1000: "999.1", 2000: "1995.8", 5000: "4971"},
    ("wide-22mm", 0.1): {1000: "903"},
    ("fisheye-10mm", 0.1): {1000: "918"},
}


def first_order() -> Numbers:
    """Compare focal lengths, cardinal points and pupils."""
    rows = []
    for name, expected in LENSES.items():
        lens = load_lens(name)
        data = lens.first_order()
        rear = lens.length
        ours = (
            *(data.focal_length_mm, data.f_number, rear, data.back_focal_distance_mm),
            *(-data.front_focal_distance_mm, -rear - data.back_focal_distance_mm),
            *(-data.principal_planes_mm.front, -rear - data.principal_planes_mm.rear),
            *(-data.entrance_pupil.distance_mm, data.entrance_pupil.diameter_mm),
            *(-rear - data.exit_pupil.distance_mm, data.exit_pupil.diameter_mm),
        )
        rows.append(
            Row(
                (f"`{name}`",),
                [text for part in expected for text in part],
                ours,
                ".4f",
                more=7e-5 * (name == "wide-22mm"),
            )
        )
    columns = (
        "f",
        "f / d",
        "length",
        "back focus",
        "F",
        "F'",
        "P",
        "P'",
        "entrance pupil",
        "its d",
        "exit pupil",
        "its d",
    )
    reason = "The thicknesses of the wide angle's table add up to 33.37114."
    return Numbers(("[mm]",), columns, rows, reason=reason)


def focus_and_circle() -> Numbers:
    """Compare what the four lenses of 2015 focus on and how far they light the film."""
    rows = []
    for name, (film, *expected) in LENSES_2015.items():
        lens = load_lens(name)
        ours: list[Ours] = [object_distance(lens, film) - lens.length - film]
        radius = image_circle(lens, film)
        lit = (radius, radius / PIXEL_MM)
        ours += [f"{value:.2f}" for value in lit] if expected[1].startswith("beyond") else lit
        rows.append(Row((f"`{name}`", f"{film:g}"), expected, ours, more=0.03))
    columns = ("in focus from the first vertex [mm]", "image circle, radius [mm]", "[px]")
    reason = "Near its edge the pupil is a sliver; ours is followed to 28.31 mm, a twentieth of a pixel farther."
    return Numbers(("lens", "film distance [mm]"), columns, rows, reason=reason)


def stop_diameter_by_sine(lens: Lens, f_number: float) -> float:
    """Return the stop diameter [mm] at which the real axial ray of an object at infinity has sin theta' = 1 / (2 N).

    The ray leaves the rear focal point at that angle and is traced through the rear group to the stop (CS348b 2003).

    Raises
    ------
    InputError
        When the lens has no stop or does not open that far.
    """
    if lens.stop_index is None or lens.stop is None:
        raise InputError(f"{lens.name}: has no stop to set; only its rims limit the light (mark one with stop: true)")
    if not f_number > 0.5:
        raise InputError(f"{lens.name}: no lens in air is faster than f/0.5 (got f/{f_number:g})")
    back = lens.first_order().back_focal_distance_mm
    rear = tuple(
        replace(s, semi_diameter=np.inf, inner_semi_diameter=0.0, region=None) for s in lens.surfaces[lens.stop_index :]
    )
    group = replace(lens, surfaces=rear, stop_index=None, first_sense=float(lens.senses[lens.stop_index]))
    sine = 1.0 / (2.0 * f_number)
    away = -group.sense * np.sqrt(1 - sine * sine)
    ray = group.trace([[0, 0, group.film_z(back)]], [[0, sine, away]])
    diameter = 2 * abs(float(ray.origins[0, 1]))
    has = 2 * lens.stop.semi_diameter
    if not ray.passed[0] or diameter > has * (1 + 5e-3):
        raise InputError(f"{lens.name}: the stop opens to {has:.5g} mm (f/{f_number:g} would need {diameter:.5g} mm)")
    return min(diameter, has)


def fitted_films() -> Numbers:
    """Compare the sides of the films of the reference pictures with the image circles of the lenses at their stops."""
    rows = []
    for name, (f_number, film, side) in FITTED_2003.items():
        lens = load_lens(name)
        circle = 2 * image_circle(lens.with_stop_diameter(stop_diameter_by_sine(lens, f_number)), film)
        ours = f"{circle:.1f}" if side.startswith("beyond") else circle
        rows.append(Row((f"`{name}`, f/{f_number:g}",), (side,), (ours,), ".1f"))
    return Numbers(("film fitted to",), ("image circle across [mm]",), rows, below=False, document="film")


def stops() -> Numbers:
    """Compare the stop diameters of the assignment of 2003: a ray from the rear focal point with sin θ = 1 / (2 N)."""
    rows = []
    for (name, f_number), expected in STOPS_2003.items():
        lens, ours = load_lens(name), ""
        try:
            diameter = stop_diameter_by_sine(lens, f_number)
        except InputError as error:
            ours = "refused: " + str(error).split(": ", 1)[1]
        wider = 0.068 if (name, f_number) == ("dgauss-100mm", 2.0) else 0.0
        rows.append(Row((f"`{name}`", f"f/{f_number:g}"), (expected,), (ours or diameter,), ".4f", more=wider))
    reason = "The first is 0.07 mm more than the stop of the table has, and is given what there is: f/2.004."
    return Numbers(("lens", "stop"), ("diameter [mm]",), rows, below=False, reason=reason)


def focused_crossing(name: str, share: float, distance_mm: float) -> float:
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


def focus_rays() -> Numbers:
    """Compare the focus test of the assignment of 2003, a ray close to the axis first."""
    rows = []
    for name in ("dgauss-100mm", "telephoto-250mm", "wide-22mm", "fisheye-10mm"):
        off = focused_crossing(name, 1e-4, 1000) / 1000 - 1
        rows.append(Row((f"`{name}`", "0.01%", "1000"), ("1000",), (1000 * (1 + off),), ".3f", error=1e-5))
    for (name, share), expected in CROSSINGS_2003.items():
        for distance, crosses in expected.items():
            ours = focused_crossing(name, share, distance)
            label = (f"`{name}`", f"{share:.0%}", f"{distance}")
            rows.append(Row(label, (crosses,), (ours,)))
    return Numbers(("lens", "height at the rear", "in focus [mm]"), ("crosses the axis [mm]",), rows, below=False)


def kolb() -> Numbers:
    """Compare the double Gauss of 100 mm with what is printed of it elsewhere."""
    data = load_lens("dgauss-100mm").first_order()
    rows = [
        Row(("focal length [mm]",), ("100",), (data.focal_length_mm,), ".4f", error=0.01),
        Row(
            ("last vertex to film, focused at infinity [mm]",),
            ("72.228",),
            (data.back_focal_distance_mm,),
            ".4f",
            0.0003,
        ),
    ]
    return Numbers(("`dgauss-100mm`",), ("",), rows, below=False, document="Kolb et al.")
