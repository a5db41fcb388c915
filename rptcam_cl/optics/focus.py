"""Where the film must stand for an object, and the other way round, by the lens's cardinal points (a thick lens).

With x the distance from the object to the front focal point and x' that from the rear focal point to the film, both
positive for a real image, Newton's equation x x' = f f' holds exactly to first order: a ray traced close to the axis
crosses it at the distance returned here.
"""

from __future__ import annotations

import numpy as np

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.first_order import FirstOrder
from rptcam_cl.optics.lens import Lens

MEASURED_FROM = ("film", "front")


def film_distance(
    lens: Lens, object_distance_mm: float, measured_from: str = "film", wavelength_nm: float = LINE_D_NM
) -> float:
    """Return the distance from the last vertex to the film that images an object plane sharply [mm].

    Parameters
    ----------
    lens : Lens
    object_distance_mm : float
        Distance of the object plane, infinite allowed.
    measured_from : "film" or "front"
        Whether that distance ends at the film (as engraved on lenses) or at the first vertex.
        From the film there are two solutions; the one with the object farther from the lens is returned.
    wavelength_nm : float

    Raises
    ------
    InputError
        Without a real image, or when the object is nearer than the lens can focus.
    """
    if measured_from not in MEASURED_FROM:
        raise InputError(f'measured_from must be "film" or "front" (got {measured_from!r})')
    if not object_distance_mm > 0:
        raise InputError(f"{lens.name}: the object distance must be above 0 mm (got {object_distance_mm:g})")
    data = _imaging(lens, wavelength_nm)
    if np.isinf(object_distance_mm):
        return _behind_lens(lens, data.back_focal_distance_mm)
    to_focal_point = _newton_distance(lens, data, object_distance_mm, measured_from)
    extension = data.focal_length_mm * data.front_focal_length_mm / to_focal_point
    return _behind_lens(lens, data.back_focal_distance_mm + extension)


def object_distance(lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the distance from the film to the object plane that it images sharply [mm]; infinite at the focal point.

    Raises
    ------
    InputError
        When the film stands where only a virtual object could be sharp.
    """
    data = _imaging(lens, wavelength_nm)
    extension = film_distance_mm - data.back_focal_distance_mm
    if abs(extension) <= 1e-12 * abs(data.focal_length_mm):
        return np.inf
    to_focal_point = data.focal_length_mm * data.front_focal_length_mm / extension
    from_front = to_focal_point - data.front_focal_distance_mm
    if extension < 0 or from_front < 0:
        raise InputError(
            f"{lens.name}: nothing in front of the lens is sharp with the film {film_distance_mm:.6g} mm behind the "
            f"last vertex (infinity is sharp at {data.back_focal_distance_mm:.6g} mm, nearer objects farther back)"
        )
    return float(from_front + data.length_mm + lens.sense * film_distance_mm)


def nearest_object_distance(lens: Lens, measured_from: str = "film", wavelength_nm: float = LINE_D_NM) -> float:
    """Return the least object distance that has a real image behind the lens [mm]."""
    data = _imaging(lens, wavelength_nm)
    product = data.focal_length_mm * data.front_focal_length_mm
    if measured_from == "front":
        return float(max(0.0, -data.front_focal_distance_mm))
    if lens.sense < 0:  # the film stands before the last mirror, so that object and film may meet
        return 0.0
    to_focal_point = max(np.sqrt(product), data.front_focal_distance_mm)
    span = data.length_mm + data.back_focal_distance_mm - data.front_focal_distance_mm
    return float(span + to_focal_point + product / to_focal_point)


def _newton_distance(lens: Lens, data: FirstOrder, object_distance_mm: float, measured_from: str) -> float:
    """Return the distance from the object to the front focal point [mm]."""
    nearest = nearest_object_distance(lens, measured_from, data.wavelength_nm)
    place = "from the film" if measured_from == "film" else "in front of the lens"
    if object_distance_mm < nearest or (measured_from == "front" and object_distance_mm == nearest):
        raise InputError(
            f"{lens.name}: cannot focus at {object_distance_mm:.6g} mm {place}; "
            f"the nearest possible is {nearest:.6g} mm"
        )
    if measured_from == "front":
        return object_distance_mm + data.front_focal_distance_mm
    span = object_distance_mm - data.length_mm - lens.sense * data.back_focal_distance_mm + data.front_focal_distance_mm
    product = lens.sense * data.focal_length_mm * data.front_focal_length_mm
    return float((span + np.sqrt(max(span * span - 4 * product, 0.0))) / 2)


def _imaging(lens: Lens, wavelength_nm: float) -> FirstOrder:
    data = lens.first_order(wavelength_nm)
    if not lens.has_power:
        raise InputError(f"{lens.name}: has no power, so it focuses nothing; set film_distance_mm instead")
    if not np.isfinite(data.focal_length_mm):
        raise InputError(f"{lens.name}: is afocal, so it forms no image; set film_distance_mm instead")
    if data.focal_length_mm < 0:
        raise InputError(
            f"{lens.name}: forms no real image (focal length {data.focal_length_mm:.6g} mm); "
            "set film_distance_mm instead"
        )
    return data


def _behind_lens(lens: Lens, distance_mm: float) -> float:
    if not distance_mm > 0:
        raise InputError(f"{lens.name}: the image lies inside the lens, {-distance_mm:.6g} mm before its last vertex")
    return float(distance_mm)
