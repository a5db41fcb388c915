"""How the rays of a realistic camera come through its lens: surface by surface, or by polynomials fitted to that."""

from __future__ import annotations

from dataclasses import field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.model import SURFACE_BY_SURFACE
from rptcam_cl.cameras.pupil import ByContent, has_shape, without_shape
from rptcam_cl.cameras.ray_map import LARGEST_ERROR_PX, RayMap, ray_map
from rptcam_cl.cameras.records import LensRecords, lens_records
from rptcam_cl.cameras.setting import LensSetting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens, LensTransmission
from rptcam_cl.scene import Film, RealisticCamera

REMEMBERED = 64  # lens states whose polynomials are kept
FAR_MM = 1e9  # stands for what is farther


@dataclass(frozen=True)
class LensRays:
    """What a camera's kernel reads of its lens.

    Attributes
    ----------
    kernel : str
        Helper that defines ``camera_ray``.
    surfaces, stop : arrays
        `Surface` records, film side first, and the shape of the stop with the tables of losses.
    facts : dict
        For the compilation.
    table : float32 array
        What stands behind the pupil's table.
    metadata : dict
        What the picture's metadata should say.
    """

    kernel: str
    surfaces: NDArray[np.void]
    stop: NDArray[np.floating]
    facts: dict[str, int]
    table: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    metadata: dict[str, Any] = field(default_factory=dict)


def traced_rays(
    lens: Lens, camera: RealisticCamera, film_distance_mm: float, dispersive: bool, losses: LensTransmission
) -> LensRays:
    """Return the surfaces of a lens."""
    double = camera.precision == "double"
    if has_shape(lens):
        records = _records(lens, camera.wavelength_nm, film_distance_mm, double, dispersive, losses)
    else:
        content = ByContent(lens)
        records = _remembered_records(content, camera.wavelength_nm, double, dispersive, losses)
        surfaces = records.surfaces.copy()
        surfaces[0]["gap"] = film_distance_mm
        records = replace(records, surfaces=surfaces)
    facts = records.facts | ({"LENS_FLOAT64": 1} if double else {})
    return LensRays(
        SURFACE_BY_SURFACE, records.surfaces, records.stop, facts, metadata={"lens_precision": camera.precision}
    )


def _records(
    lens: Lens, wavelength_nm: float, film_distance_mm: float, double: bool, dispersive: bool, losses: LensTransmission
) -> LensRecords:
    return lens_records(
        lens, wavelength_nm, "film", film_distance_mm, double=double, dispersive=dispersive, transmission=losses
    )


@lru_cache(maxsize=REMEMBERED)
def _remembered_records(
    content: ByContent,
    wavelength_nm: float,
    double: bool,
    dispersive: bool,
    losses: LensTransmission,
) -> LensRecords:
    """Return the records of a lens whose film is yet to be placed."""
    records = _records(content.lens, wavelength_nm, 0.0, double, dispersive, losses)
    records.surfaces.flags.writeable = records.stop.flags.writeable = False
    return records


def allowed_px(camera: RealisticCamera) -> float:
    """Return the largest allowed error of a fitted ray of a camera [pixels]."""
    return LARGEST_ERROR_PX if camera.accuracy is None else min(camera.accuracy.max_error_px, LARGEST_ERROR_PX)


def fitted_map(
    lens: Lens, setting: LensSetting, film: Film, range_nm: tuple[float, float] | None, max_error_px: float
) -> RayMap:
    """Return the polynomials that stand for a lens as it is set.

    Parameters
    ----------
    lens
        That of the setting; a shape of its stop is not looked at.
    range_nm
        Both ends of the wavelengths of rays, or None where all have the camera's.
    max_error_px
        Largest allowed error of a ray in the plane in focus and far away.

    Raises
    ------
    InputError
        When polynomials cannot stand for the lens, or not well enough.
    """
    camera, film_mm = setting.camera, setting.film_distance_mm
    if setting.transmission:
        raise InputError("camera.rays: fitted rays know no losses (leave out camera.transmission, or use traced)")
    if isinstance(camera, RealisticCamera) and camera.precision != "single":
        raise InputError("camera.rays: fitted rays are float32 (leave out camera.precision, or use traced)")
    if isinstance(camera, RealisticCamera) and camera.pupil not in ("auto", "tight"):
        raise InputError(
            "camera.rays: fitted rays hold for the true pupil alone"
            f" (camera.pupil is {camera.pupil}; allowed: auto, tight)"
        )
    width_mm, height_mm = (side * 1e3 for side in film.size_m())
    focus_mm = setting.focus_distance_mm
    near = FAR_MM if focus_mm is None else min(focus_mm - lens.length - lens.sense * film_mm, FAR_MM)
    try:
        return _remembered(
            ByContent(without_shape(lens)),
            film_mm,
            (width_mm / 2, height_mm / 2),
            camera.wavelength_nm if range_nm is None else range_nm,
            film.resolution[0] / width_mm,
            (near, FAR_MM) if 0 < near < FAR_MM else (FAR_MM,),
            max_error_px,
        )
    except InputError as problem:
        raise InputError(f"camera.rays: {problem}; use traced") from None


def fitted_rays(
    lens: Lens, setting: LensSetting, film: Film, range_nm: tuple[float, float] | None, max_error_px: float
) -> LensRays:
    """Return the polynomials of a lens, as `fitted_map` does."""
    found = fitted_map(lens, setting, film, range_nm, max_error_px)
    records = lens_records(lens, setting.camera.wavelength_nm, "film", setting.film_distance_mm)
    rows = [len(lens.surfaces) - 1 - k for k in found.surfaces]
    facts = {
        **{name: value for name, value in records.facts.items() if name in ("LENS_OUTLINE", "LENS_MASK")},
        "MAP_ORDER": found.rays.order,
        "MAP_RIM_ORDER": found.rims.order,
        "MAP_RIMS": len(found.surfaces),
        "MAP_COLOURS": int(found.rays.colours),
    }
    metadata = {
        "lens_rays": "fitted",
        "lens_degree": 2 * found.rays.order + 1,
        "lens_rims": len(found.surfaces),
        "lens_error_px": round(found.error_px, 4),
        "lens_light_error": round(found.light_error, 4),
    }
    return LensRays("camera/fitted.h", records.surfaces[rows], records.stop, facts, _table(found), metadata)


def _table(found: RayMap) -> NDArray[np.float32]:
    """Return the table of `kernels/lens/ray_map.h`."""
    scales, rays = found.variables, np.concatenate([found.rays.vectors, found.rays.numbers], axis=1)
    head = [1 / scales.film_mm, scales.shift, 1 / scales.pupil_mm, 0.0]
    return np.concatenate([head, rays.ravel(), found.rims.vectors.ravel()]).astype(np.float32)


@lru_cache(maxsize=REMEMBERED)
def _remembered(
    content: ByContent,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelengths_nm: float | tuple[float, float],
    pixels_per_mm: float,
    distances_mm: tuple[float, ...],
    max_error_px: float,
) -> RayMap:
    return ray_map(
        content.lens, film_distance_mm, half_film_mm, wavelengths_nm, pixels_per_mm, distances_mm, max_error_px
    )


def forget_maps() -> None:
    """Make the next polynomials of every lens be computed anew."""
    _remembered.cache_clear()
