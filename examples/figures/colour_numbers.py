"""Numbers of the paper's figures 4 and 7, what its lenses do to each wavelength, as Markdown tables."""

from __future__ import annotations

from typing import Any

from examples.figures.lens_numbers import blur_on_film, table
from rptcam_cl import load_lens
from rptcam_cl.errors import InputError
from rptcam_cl.optics.focus import object_distance

WAVELENGTHS_NM = (400, 486.1, 589.3, 656.3, 700)
PIXEL = 1.6 / 800
OBJECT = 18.0  # from the film
PLACED = {15: 3.167281, 18: 2.997085}  # last vertex to film, by the distance in focus
# Blur of the object [pixels of 800] at these wavelengths by Abbe number, with 15 in focus: figure 4.
BLURS = {200: (2.2, 2.0, 1.9, 1.8, 1.8), 10: (6.8, 4.6, 1.9, 0.15, 1.0), 3: (18, 11, 1.9, 3.9, 7.7)}
# Distance from the film that is in focus: figure 7.
IN_FOCUS = {"singlet": (7.67, 9.80, 18.06, 74.4, None), "doublet": (16.31, 16.95, 17.67, 18.01, 18.12)}
DOUBLET = {
    "name": "Doublet of the rptcam paper",
    "surfaces": [
        {"radius": 4, "thickness": 0.005, "glass": {"linear_abbe": {"n": 1.3, "v": 3}}, "diameter": 0.2, "stop": True},
        {"radius": -0.571428571, "thickness": 0.005, "glass": {"linear_abbe": {"n": 1.8, "v": 1}}, "diameter": 0.2},
        {"radius": -0.666666667, "diameter": 0.2},
    ],
}
DOUBLET_PLACED = 2.995


def singlet(abbe: float, diameter: float) -> dict[str, Any]:
    """Return the single lens of the paper with an Abbe number, as a lens file's mapping."""
    glass = {"linear_abbe": {"n": 1.8, "v": abbe}}
    surfaces = [
        {"radius": 4, "thickness": 0.01, "glass": glass, "diameter": diameter, "stop": True},
        {"radius": -4, "diameter": diameter},
    ]
    return {"name": "Single lens of the rptcam paper", "surfaces": surfaces}


def blurs_by_wavelength() -> str:
    """Return the blur of each wavelength for three Abbe numbers (figure 4)."""
    rows: list[list[Any]] = []
    for abbe, expected in BLURS.items():
        lens = load_lens(singlet(abbe, 0.07))
        ours = [blur_on_film(lens, PLACED[15], OBJECT, wavelength) / PIXEL for wavelength in WAVELENGTHS_NM]
        rows.append([abbe, "formula", *expected])
        rows.append(["", "our lens", *(f"{blur:.2f}" for blur in ours)])
    return table(["V", "blur [px of 800]", *(f"{wavelength:g} nm" for wavelength in WAVELENGTHS_NM)], rows)


def focus_by_wavelength() -> str:
    """Return what is in focus at each wavelength through a single lens and an achromat (figure 7)."""
    rows: list[list[Any]] = []
    lenses = {"singlet": (singlet(3, 0.2), PLACED[18]), "doublet": (DOUBLET, DOUBLET_PLACED)}
    for name, (prescription, placed) in lenses.items():
        rows.append([name, "expected", *("nothing real" if value is None else value for value in IN_FOCUS[name])])
        rows.append(["", "our lens", *(_in_focus(load_lens(prescription), placed, nm) for nm in WAVELENGTHS_NM)])
    return table(["lens", "in focus, from the film", *(f"{wavelength:g} nm" for wavelength in WAVELENGTHS_NM)], rows)


def _in_focus(lens: Any, placed: float, wavelength_nm: float) -> str:
    try:
        return f"{object_distance(lens, placed, wavelength_nm):.2f}"
    except InputError:
        return "nothing real"
