"""Numbers of the rptcam paper that its lenses have by themselves, beside ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from examples.figures.numbers import Numbers, Row
from rptcam_cl.core import LINE_D_NM
from rptcam_cl.optics.charts import Drawing
from rptcam_cl.optics.design import GlassChoice, doublet_radii, image_distances
from rptcam_cl.optics.drawing import View, draw_lens
from rptcam_cl.optics.lens import film_distance, object_distance
from rptcam_cl.optics.spots import setting
from rptcam_cl.rendering.traceable_lens import TraceableLens, load_lens

NEAR_AXIS = 0.01  # share of the clear radius
THICKNESS = 0.01
# Object to film: image distance, the other root, thickness of the last row and magnification of the closed form.
PLACEMENTS = {
    11: ("3.846303", "7.153697", "3.841303", "0.53767"),
    15: ("3.172281", "11.827719", "3.167281", "0.26821"),
    18: ("3.002085", "14.997915", "2.997085", "0.20017"),
    20: ("2.930898", "17.069102", "2.925898", "0.17171"),
    25: ("2.819336", "22.180664", "2.814336", "0.12711"),
    30: ("2.754253", "27.245747", "2.749253", "0.10109"),
    50: ("2.640874", "47.359126", "2.635874", "0.05576"),
}
NEAREST = ("5.002779", "5.002779", "4.997779", "1.0000")  # at four focal lengths, 10.00556
# Index, lens to film: focal length and the height z in the scene of the plane in focus (the film is at z = 7).
INDICES = {
    1.8: ("3.22418", "2.50139", "-7.38"),
    2.3: ("3.56858", "1.53955", "0.72"),
    3.5: ("3.78865", "0.80071", "2.20"),
}
FILM_AT = 7.0


def paper_singlet(index: float = 1.8, diameter: float = 0.4) -> TraceableLens:
    """Return the single lens of the rptcam paper, one of its units being a millimetre."""
    surfaces = [
        {"radius": 4, "thickness": THICKNESS, "glass": {"index": index}, "diameter": diameter, "stop": True},
        {"radius": -4, "diameter": diameter},
    ]
    return load_lens({"name": "single lens", "surfaces": surfaces})


def paper_doublet(diameter: float = 0.2) -> dict[str, Any]:
    """Return the paper's default doublet as a lens file's mapping."""
    crown, flint = ({"linear_abbe": {"n": n, "v": v}} for n, v in ((1.3, 3), (1.8, 1)))
    return {
        "name": "Doublet of the rptcam paper",
        "surfaces": [
            {"radius": 4, "thickness": 0.005, "glass": crown, "diameter": diameter, "stop": True},
            {"radius": -0.571428571, "thickness": 0.005, "glass": flint, "diameter": diameter},
            {"radius": -0.666666667, "diameter": diameter},
        ],
    }


def table_prescription(diameter: float) -> dict[str, Any]:
    """Return the lens of the paper's Table 1 with another opening, as a lens file's mapping."""
    return {
        "name": "Lens of Table 1 of the rptcam paper",
        "surfaces": [
            {"radius": 4, "thickness": THICKNESS, "glass": {"index": 1.6}, "diameter": diameter, "stop": True},
            {"radius": -4, "diameter": diameter},
        ],
    }


def doublet_drawing() -> Drawing:
    """Return an achromat of BK7 and F2 by the paper's equations in cross-section, with light of three colours."""
    glasses = GlassChoice(1.5168, 64.17), GlassChoice(1.62004, 36.43)
    _, r2, r3 = doublet_radii(100.0, *glasses, "r1", 60.0)
    crown, flint = ({"nd": glass.index, "vd": glass.abbe} for glass in glasses)
    lens = load_lens(
        {
            "name": "Doublet of BK7 and F2 by the rptcam paper's equations",
            "surfaces": [
                {"radius": 60, "thickness": 9, "glass": crown, "diameter": 30, "stop": True},
                {"radius": r2, "thickness": 3, "glass": flint, "diameter": 30},
                {"radius": r3, "diameter": 30},
            ],
        }
    )
    return draw_lens(setting(lens, None, 10.0), View(fields=(0.0,), rays=5, wavelengths_nm=(486.13, 546.07, 656.27)))


def blur_on_film(
    lens: TraceableLens, film_mm: float, object_to_film_mm: float, wavelength_nm: float = LINE_D_NM
) -> float:
    """Return the diameter [mm] of the blur of a point on the axis, to first order: by a traced ray near the axis."""
    front = object_to_film_mm - lens.length - film_mm
    aim = [[0, NEAR_AXIS * lens.surfaces[0].semi_diameter, front]]
    rays = lens.trace([[0, 0, -front]], aim, wavelength_nm, start="scene")
    (origin,), (direction,) = rays.origins, rays.directions
    height = origin[1] + direction[1] / direction[2] * (lens.length + film_mm - origin[2])
    return 2 * abs(float(height)) / NEAR_AXIS


def placements() -> Numbers:
    """Compare where the paper's single lens stands for an object (table of its closed form)."""
    length = paper_singlet().first_order().focal_length_mm
    rows = [_placement(distance, expected, length) for distance, expected in PLACEMENTS.items()]
    columns = ("lens to film", "other root", "last row", "magnification")
    nearest = _placement(4 * length, NEAREST, length)
    return Numbers(("object to film",), columns, [nearest, *rows], document="formula")


def _placement(distance: float, expected: tuple[str, ...], length: float) -> Row:
    near, far = image_distances(length, distance)
    ours = (near, far, near - THICKNESS / 2, near / far)
    return Row((f"{distance:.7g}",), expected, ours, ".6f")


def thick_placements() -> Numbers:
    """Compare the closed form with where the paper's single lens must stand, its principal planes considered."""
    lens = paper_singlet()
    exact = [film_distance(lens, distance) + lens.length / 2 for distance in PLACEMENTS]
    row = Row(("lens to film",), [placed for placed, *_ in PLACEMENTS.values()], exact, ".6f", more=0.0041)
    return Numbers(
        ("object to film",),
        [f"{distance}" for distance in PLACEMENTS],
        [row],
        document="formula",
        reason="The closed form takes the lens as thin. Its principal planes lie 0.0044 apart, so that it"
        " must stand a thousandth farther from the film: the paper's focus at 25 is at 25.14.",
    )


def indices() -> Numbers:
    """Compare focal length and plane of focus for three indices of refraction (figure 3)."""
    rows = []
    for index, (placed, focal, focus) in INDICES.items():
        lens = paper_singlet(index, 0.07)
        away = FILM_AT - object_distance(lens, float(placed) - lens.length / 2)
        ours = (lens.first_order().focal_length_mm, away)
        rows.append(Row((f"{index}", placed), (focal, focus), ours, ".5f", more=0.03))
    return Numbers(
        ("n", "lens to film"),
        ("focal length", "z in focus"),
        rows,
        document="paper's formula",
        reason="The paper's plane in focus is that of a thin lens: ours is up to 0.03 farther, 0.2 % of its"
        " distance from the film.",
    )


def doublet_of_the_paper() -> Numbers:
    """Compare the paper's achromats, the default one and one of real glasses."""
    return Numbers(
        ("doublet", "f", "n, V", "n, V"),
        ("power 1", "power 2", "r2", "r3"),
        [
            _doublet("default, r1 4", 2.5, (1.3, 3.0), (1.8, 1.0), 4.0, ("0.6", "-0.2", "-0.5714286", "-0.6666667")),
            _doublet(
                "BK7, F2, r1 60",
                100.0,
                (1.5168, 64.17),
                (1.62004, 36.43),
                60.0,
                (".0231327", "-.0131327", "-35.5939", "-144.627"),
            ),
        ],
        document="formula",
    )


def _doublet(
    name: str,
    focal: float,
    first: tuple[float, float],
    second: tuple[float, float],
    r1: float,
    expected: tuple[str, ...],
) -> Row:
    _, r2, r3 = doublet_radii(focal, GlassChoice(*first), GlassChoice(*second), "r1", r1)
    powers = (first[0] - 1) * (1 / r1 - 1 / r2), (second[0] - 1) * (1 / r2 - 1 / r3)
    glasses = (f"{n:g}, {v:g}" for n, v in (first, second))
    return Row((name, f"{focal:g}", *glasses), expected, (*powers, r2, r3), ".7g")


def focal_lengths() -> Numbers:
    """Compare focal lengths of the closed forms, and where a doublet and the lens of the paper's first table focus."""
    singlet, table = paper_singlet(), paper_singlet(1.6)
    table_focal = table.first_order().focal_length_mm
    placed = [image_distances(2.5, distance)[0] for distance in (18, 11, 10)]
    rows = [
        Row(("single lens, n = 1.8: focal length",), ("2.5013897",), (singlet.first_order().focal_length_mm,), ".7f"),
        Row(("lens of the paper's Table 1, n = 1.6: focal length",), ("3.334897",), (table_focal,), ".6f"),
        Row(
            ("the lens of Table 1, 4.0 from the film: in focus, from the lens",),
            ("20.056",),
            (1 / (1 / table_focal - 1 / 4.0),),
            ".3f",
        ),
        *(
            Row((f"doublet, object {distance} from the film: to the lens",), (text,), (value,), ".6f")
            for distance, text, value in zip((18, 11, 10), ("3.0", "3.841688", "5"), placed, strict=True)
        ),
    ]
    return Numbers(("closed form",), ("",), rows, below=False, document="formula")


def snell() -> Numbers:
    """Compare where rays far from the axis focus by Snell's law, and tell where by the paper's."""
    single, double = paper_singlet(diameter=1.0), load_lens(paper_doublet(1.0))
    rows = [
        Row(("single lens at 25, ray at 0.2", "25.65"), ("24.00",), (crossing(single, 2.814336, 0.2, 589.3),)),
        Row(("doublet at 18, ray at 0.2", "19.28"), ("15.34",), (crossing(double, 2.995, 0.2, 589.3),)),
    ]
    places = (("single lens at 25, 8.1° off the axis", 2.814336, 0.4), ("figure 2, 51° off the axis", 3.21918, 4.0))
    theirs = (("27.6", "25.1"), ("diverging", "diverging"))
    expected = (("19.7", "22.4"), ("3.8", "5.3"))
    for (label, film, height), law, values in zip(places, theirs, expected, strict=True):
        for name, there, text, ours in zip(
            ("tangential", "sagittal"), law, values, _off_axis(single, film, height), strict=True
        ):
            rows.append(Row((f"{label}, {name}", there), (text,), (ours,)))
    return Numbers(("in focus, from the film", "by the paper's law"), ("by Snell's law",), rows, below=False)


def crossing(lens: TraceableLens, film_mm: float, height_mm: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return where a ray of the film's centre crosses the axis in the scene [mm from the film].

    It is sent through the middle of the lens at a height.
    """
    aim = [[0, height_mm, -film_mm - lens.length / 2]]
    rays = lens.trace([[0, 0, lens.length + film_mm]], aim, wavelength_nm)
    (origin,), (direction,) = rays.origins, rays.directions
    return float(lens.length + film_mm - origin[2] + origin[1] * direction[2] / direction[1])


def _off_axis(lens: TraceableLens, film_mm: float, height_mm: float) -> tuple[float, float]:
    """Return the tangential and the sagittal focus [mm from the film] of rays through the middle of the rear vertex."""
    step = 1e-4
    targets = np.array(
        [[step, 0, lens.length], [-step, 0, lens.length], [0, step, lens.length], [0, -step, lens.length]]
    )
    start = np.array([height_mm, 0, lens.length + film_mm])
    rays = lens.trace(np.broadcast_to(start, targets.shape), targets - start, 589.3)
    slopes = rays.directions[:, :2] / rays.directions[:, 2:]
    places = rays.origins[:, :2] - rays.origins[:, 2:] * slopes
    tangential = -(places[0, 0] - places[1, 0]) / (slopes[0, 0] - slopes[1, 0])
    sagittal = -(places[2, 1] - places[3, 1]) / (slopes[2, 1] - slopes[3, 1])
    return float(start[2] - tangential), float(start[2] - sagittal)
