"""The losses that a scene's camera asks for, and the coating that it puts on its lens."""

from __future__ import annotations

from rptcam_cl.errors import InputError
from rptcam_cl.optics import Lens
from rptcam_cl.optics.coating import constant_reflectance
from rptcam_cl.optics.files.coatings import WORDS
from rptcam_cl.optics.transmission import Transmission, has_coatings, known_nm, with_coating
from rptcam_cl.scene.camera import LensCamera


def transmission_of(camera: LensCamera) -> Transmission:
    """Return the losses that count."""
    asked = camera.transmission
    return Transmission(
        fresnel=asked.fresnel, coatings=asked.fresnel and asked.coatings is not False, absorption=asked.absorption
    )


def as_coated(lens: Lens, camera: LensCamera) -> Lens:
    """Return the lens with the coating that the camera puts on it, if any.

    Raises
    ------
    InputError
        When coatings must count and the lens does not say how it is coated, or when losses that count are not known at
        the camera's wavelength.
    """
    lens = _coated(lens, camera)
    low, high = known_nm(lens, transmission_of(camera))
    if not low <= camera.wavelength_nm <= high:
        raise InputError(
            f"camera.transmission: what {lens.name} absorbs or reflects is known from {low:g} to {high:g} nm"
            f" (camera.wavelength_nm is {camera.wavelength_nm:g})"
        )
    return lens


def _coated(lens: Lens, camera: LensCamera) -> Lens:
    coating = camera.transmission.coating
    if coating is not None:
        return with_coating(lens, WORDS[coating] if isinstance(coating, str) else constant_reflectance(coating))
    if camera.transmission.coatings and not has_coatings(lens):
        raise InputError(
            f"camera.transmission: {lens.name} does not say how it is coated"
            " (allowed: ideal, bare, or a coating for it such as {coating: mgf2})"
        )
    return lens
