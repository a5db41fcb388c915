"""The facts of a lens at one aperture, focus and wavelength that ``rptcam lens info`` prints."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rptcam_cl.optics import FirstOrder, Lens

_FAN = 2048  # rays across the last surface; the circle is found to about this fraction of the pupil
_WIDEST = 100.0  # film radii beyond so many film distances count as without bound (89.4 degrees off the axis)


def lens_facts(
    lens: "Lens", f_number: float | None, focus_distance_m: float | None, wavelength_nm: float
) -> dict[str, Any]:
    """First-order data, film distance, working f-number and image circle of a lens.

    Parameters
    ----------
    lens
        With its stop as wide as its file says.
    f_number
        To stop down to; as in the file when absent.
    focus_distance_m
        Object plane to film [m]; infinity when absent.
    wavelength_nm
        Wavelength [nm].

    Returns
    -------
    dict
        Distances in millimetres. A lens that forms no real image has no film distance, nor what follows from it.
    """
    from rptcam_cl.optics.focus import film_distance

    if f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number, wavelength_nm))
    first = lens.first_order(wavelength_nm)
    film = None
    if focus_distance_m is not None:
        film = film_distance(lens, 1000 * focus_distance_m, wavelength_nm=wavelength_nm)
    elif first.focal_length_mm > 0 and math.isfinite(first.focal_length_mm) and first.back_focal_distance_mm > 0:
        film = first.back_focal_distance_mm
    return {
        "name": lens.name,
        "source": lens.source,
        **first.as_dict(),
        "working_f_number": None if film is None else working_f_number(first, film),
        "film_distance_mm": film,
        "image_circle_mm": None if film is None else image_circle(lens, film, wavelength_nm),
    }


def working_f_number(first: "FirstOrder", film_distance_mm: float) -> float:
    """Distance from the exit pupil to the film over the pupil's diameter: the f-number that sets the exposure.

    To first order it is N (1 + |m| / P), with the magnification m and the ratio P of exit to entrance pupil.
    """
    pupil = first.exit_pupil
    if not math.isfinite(pupil.distance_mm):
        return first.f_number  # telecentric: the cone is the same wherever the film stands
    return abs((film_distance_mm - pupil.distance_mm) / pupil.diameter_mm)


def image_circle(lens: "Lens", film_distance_mm: float, wavelength_nm: float) -> float | None:
    """Diameter of the lit circle on the film [mm]; none when it has no bound.

    The last ray to arrive lies in the plane of the film point and the axis, as the lens is symmetric about the axis.
    """
    from rptcam_cl.optics.probe import FilmProbe

    probe = FilmProbe(lens, film_distance_mm, wavelength_nm)

    def lit(radius: float) -> bool:
        film = np.array([[radius, 0.0]])
        left, right = probe.windows(film)[0, :2]
        rear = np.stack([np.linspace(left, right, _FAN), np.zeros(_FAN)], axis=1)
        return bool(probe.passes(film, rear).any())

    inside, outside = 0.0, film_distance_mm
    while lit(outside):
        inside, outside = outside, 2 * outside
        if outside > _WIDEST * film_distance_mm:
            return None
    while outside - inside > 1e-4 * outside:
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if lit(middle) else (inside, middle)
    return inside + outside
