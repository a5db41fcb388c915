"""Numbers of the rptcam paper on what its glasses do to each wavelength, beside ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from examples.figures.numbers import Numbers, Ours, Row
from examples.figures.paper_lens_numbers import blur_on_film, paper_doublet
from rptcam_cl.api.job import render
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.glass import AbbeLinear
from rptcam_cl.optics.lens import object_distance
from rptcam_cl.rendering.traceable_lens import load_lens

WAVELENGTHS_NM = (400, 486.1, 589.3, 656.3, 700)
COLUMNS = tuple(f"{wavelength:g} nm" for wavelength in WAVELENGTHS_NM)
PIXEL = 1.6 / 800
OBJECT = 18.0  # from the film
PLACED = {15: 3.167281, 18: 2.997085}  # last vertex to film, by the distance in focus
DOUBLET_PLACED = 2.995
# Blur of the object [pixels of 800] at these wavelengths by Abbe number, with 15 in focus: figure 4.
BLURS = {
    200: ("2.2", "2.0", "1.9", "1.8", "1.8"),
    10: ("6.8", "4.6", "1.9", ".15", "1.0"),
    3: ("18", "11", "1.9", "3.9", "7.7"),
}
# Distance from the film that is in focus: figure 7.
IN_FOCUS = {
    "singlet": ("7.67", "9.80", "18.06", "74.4", "virtual"),
    "doublet": ("16.31", "16.95", "17.67", "18.01", "18.12"),
}
# Index at 589.3 nm and Abbe number: index.
GLASSES = {
    (1.8, 3): ("2.0966", "1.9617", "1.8", "1.6950", "1.6266"),
    (1.8, 10): ("1.8890", "1.8485", "1.8", "1.7685", "1.7480"),
    (1.8, 200): ("1.8044", "1.8024", "1.8", "1.7984", "1.7974"),
    (1.8, 1): ("2.6898", "2.2851", "1.8", "1.4851", "1.2797"),
    (1.3, 3): ("1.4112", "1.3606", "1.3", "1.2606", "1.2350"),
}
FOCAL_LENGTHS = ("1.825", "2.081", "2.501", "2.879", "3.194")  # of the single lens with V = 3
MEAN_WEIGHT = (0.9280, 0.7637, 0.6092)  # of the paper's renderer


def singlet(abbe: float, diameter: float) -> dict[str, Any]:
    """Return the single lens of the paper with an Abbe number, as a lens file's mapping."""
    glass = {"linear_abbe": {"n": 1.8, "v": abbe}}
    surfaces = [
        {"radius": 4, "thickness": 0.01, "glass": glass, "diameter": diameter, "stop": True},
        {"radius": -4, "diameter": diameter},
    ]
    return {"name": "Single lens of the rptcam paper", "surfaces": surfaces}


def blurs_by_wavelength() -> Numbers:
    """Compare the blur of each wavelength for three Abbe numbers (figure 4)."""
    rows = []
    for abbe, expected in BLURS.items():
        lens = load_lens(singlet(abbe, 0.07))
        ours = [blur_on_film(lens, PLACED[15], OBJECT, wavelength) / PIXEL for wavelength in WAVELENGTHS_NM]
        rows.append(Row((f"{abbe}",), expected, ours, more=0.035))
    return Numbers(
        ("V",),
        COLUMNS,
        rows,
        document="formula, blur [px of 800]",
        reason="The formula takes the lens as thin; by our lens the blur is up to 0.08 pixels less.",
    )


def focus_by_wavelength() -> Numbers:
    """Compare what is in focus at each wavelength through a single lens and an achromat (figure 7)."""
    rows = []
    lenses = {"singlet": (singlet(3, 0.2), PLACED[18]), "doublet": (paper_doublet(), DOUBLET_PLACED)}
    for name, (prescription, placed) in lenses.items():
        lens = load_lens(prescription)
        ours = [_in_focus(lens, placed, wavelength) for wavelength in WAVELENGTHS_NM]
        rows.append(Row((name,), IN_FOCUS[name], ours))
    return Numbers(("in focus, from the film",), COLUMNS, rows)


def _in_focus(lens: Any, placed: float, wavelength_nm: float) -> Ours:
    try:
        return object_distance(lens, placed, wavelength_nm)
    except InputError:
        return "virtual"


def glasses() -> Numbers:
    """Compare the indices of the paper's glasses, and the focal lengths that they make."""
    rows = []
    for (n, v), expected in GLASSES.items():
        glass = AbbeLinear(n, v)
        rows.append(
            Row((f"n at n = {n}, V = {v}",), expected, [float(glass.index(nm)) for nm in WAVELENGTHS_NM], ".4f")
        )
    single, thin = load_lens(singlet(3, 0.2)), load_lens(_thin_doublet())
    lengths = [single.first_order(wavelength).focal_length_mm for wavelength in WAVELENGTHS_NM]
    powers = [1 / thin.first_order(wavelength).focal_length_mm for wavelength in WAVELENGTHS_NM]
    rows.append(Row(("f of the single lens, V = 3",), FOCAL_LENGTHS, lengths, ".3f"))
    rows.append(Row(("power of the doublet, thin",), ("0.400000",) * len(powers), powers, ".6f"))
    return Numbers(("",), COLUMNS, rows, document="formula")


def _thin_doublet() -> dict[str, Any]:
    lens = paper_doublet(0.002)
    thin = [{**surface, "thickness": 0.0} for surface in lens["surfaces"][:2]]
    return lens | {"surfaces": [*thin, lens["surfaces"][2]]}


def white() -> Numbers:
    """Compare the colour of a white world through a dispersive lens."""
    scene = {
        "metres_per_unit": 0.001,
        "film": {"resolution": [16, 12], "size_mm": [0.16, 0.12]},
        "camera": {
            "kind": "realistic",
            "lens": singlet(3, 0.07),
            "focus": {"film_distance_mm": PLACED[15]},
            "eye": [0, 0, 0],
            "target": [0, 0, -1],
        },
        "spectrum": "dispersive",
        "environment": {"kind": "constant", "radiance": 1},
    }
    mean = np.asarray(render(scene, spp=1024), float).mean(axis=(0, 1))
    colour = ", ".join(f"{weight:.4f}" for weight in MEAN_WEIGHT)
    row = Row(
        (f"a white world (the paper's renderer: {colour})",),
        ("1.00", "1.00", "1.00"),
        [float(x) for x in mean],
        ".3f",
        0.01,
    )
    return Numbers(("",), ("red", "green", "blue"), [row], noise=0.01)
