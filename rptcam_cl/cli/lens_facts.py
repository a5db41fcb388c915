"""The facts of a lens at one aperture, focus and wavelength that ``rptcam lens info`` prints."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rptcam_cl.optics import Lens


def lens_facts(
    lens: "Lens",
    f_number: float | None,
    focus_distance_m: float | None,
    wavelength_nm: float,
    focal_length_mm: float | None = None,
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
    focal_length_mm
        To which a zoom lens is set; its first position when absent.

    Returns
    -------
    dict
        Distances in millimetres. A lens that forms no real image has no film distance, nor what follows from it.
    """
    from rptcam_cl.lensview.setting import image_circle, setting, working_f_number

    state = setting(lens, f_number, focus_distance_m, focal_length_mm, wavelength_nm)
    lens, film = state.lens, state.film_distance_mm
    first = lens.first_order(wavelength_nm)
    return {
        "name": lens.name,
        "source": lens.source,
        **first.as_dict(),
        "working_f_number": None if film is None else working_f_number(first, film),
        "film_distance_mm": film,
        "image_circle_mm": None if film is None else image_circle(lens, film, wavelength_nm),
    }
