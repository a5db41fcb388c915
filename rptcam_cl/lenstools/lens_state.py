"""A lens as it stands on a camera: stopped down, zoomed, focused, with its film."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import brought_to_focus

if TYPE_CHECKING:
    from rptcam_cl.optics import Lens


@dataclass(frozen=True)
class Setting:
    """A lens in use.

    Attributes
    ----------
    lens : Lens
        At its working aperture and focal length.
    film_distance_mm : float or None
        Last vertex to film; None when the lens forms no real image.
    object_distance_mm : float
        Object plane to first vertex; infinite for a distant object.
    wavelength_nm : float
        For which it is focused.
    """

    lens: Lens
    film_distance_mm: float | None
    object_distance_mm: float = math.inf
    wavelength_nm: float = LINE_D_NM

    @property
    def film(self) -> float:
        """Last vertex to film [mm]; an error without a real image."""
        if self.film_distance_mm is None:
            raise InputError(f"{self.lens.name}: forms no real image of a distant object, so there is no film")
        return self.film_distance_mm

    @property
    def film_z(self) -> float:
        """Film plane in the frame of the lens [mm]."""
        return self.lens.film_z(self.film)


def setting(
    lens: Lens,
    f_number: float | None = None,
    focus_distance_m: float | None = None,
    wavelength_nm: float = LINE_D_NM,
) -> Setting:
    """Return a lens in use.

    Parameters
    ----------
    lens : Lens
        Zoomed already.
    f_number : float, optional
        To stop down to; as wide as the file has it when absent.
    focus_distance_m : float, optional
        Object plane to film [m]; infinity when absent.
    wavelength_nm : float
    """
    if f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number, wavelength_nm))
    if focus_distance_m is not None:
        lens, film = brought_to_focus(lens, 1000 * focus_distance_m, wavelength_nm)
        return Setting(lens, film, 1000 * focus_distance_m - lens.sense * film - lens.length, wavelength_nm)
    first = lens.first_order(wavelength_nm)
    real = 0 < first.focal_length_mm < math.inf and first.back_focal_distance_mm > 0
    return Setting(lens, first.back_focal_distance_mm if real else None, math.inf, wavelength_nm)
