"""Where the entrance pupil of a camera lies: the centre of its perspective, and how it drifts over the field.

Programs that measure in pictures take the camera for a point. That point is the entrance pupil, which lies ahead of
the eye with most lenses: the eye is the middle of the film. Away from the axis a real lens has its entrance pupil
elsewhere, which near objects show.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.movements import film_frame, half_film_mm
from rptcam_cl.cameras.pupil import KEPT, ByContent, without_shape
from rptcam_cl.cameras.setting import LensSetting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.kept import kept_or_found
from rptcam_cl.optics import ChiefRays, Lens, film_chief_rays, round_chief_rays
from rptcam_cl.scene import RealisticCamera, Scene, pose_matrix

Array = NDArray[np.float64]

FIELDS = (0.5, 1.0)  # of the way from the middle of the film to its corners, where the drift is found
REMEMBERED = 64  # lens states whose drift is kept


@dataclass(frozen=True)
class EntrancePupil:
    """The entrance pupil of a camera.

    Attributes
    ----------
    ahead_mm : float
        How far it lies ahead of the eye on the axis [mm]; infinite where it has no place.
    diameter_mm : float
        0 for a point.
    drift_mm : tuple of (field, drift)
        For places of the film, of how far they are from its middle (1: its corners), the mean distance from `ahead_mm`
        to where chief rays come nearest to the axis [mm], towards the scene; places without chief rays are left out.
    """

    ahead_mm: float = 0.0
    diameter_mm: float = 0.0
    drift_mm: tuple[tuple[float, float], ...] = ()

    def described(self) -> dict[str, Any]:
        """Return what the metadata of a picture say of it, but for its place in the world."""
        return {
            "ahead_of_eye_mm": self.ahead_mm if math.isfinite(self.ahead_mm) else None,
            "diameter_mm": self.diameter_mm if math.isfinite(self.diameter_mm) else None,
            **({"drift_mm": {f"{field:g}": drift for field, drift in self.drift_mm}} if self.drift_mm else {}),
        }


def pupil_in_world(scene: Scene, described: Mapping[str, Any]) -> dict[str, Any]:
    """Return a described entrance pupil with its place in the world [m], in the axes of the scene; None without one."""
    ahead_mm = described["ahead_of_eye_mm"]
    if ahead_mm is None:
        return {"world_m": None, **described}
    matrix = pose_matrix(scene.camera.pose_at(scene.shutter.span_s[0]))
    place = matrix[:3, 3] * scene.metres_per_unit - matrix[:3, 2] * ahead_mm * 1e-3
    return {"world_m": place.tolist(), **described}


def entrance_pupil(scene: Scene, setting: LensSetting, *, drifts: bool = True) -> EntrancePupil:
    """Return the entrance pupil of the lens of a scene, with its drift where that is wanted and the lens is traced."""
    lens, back, wavelength = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
    pupil = lens.first_order(wavelength).entrance_pupil
    if not math.isfinite(pupil.distance_mm):
        return EntrancePupil(math.inf, math.inf)
    ahead = lens.film_z(back) - pupil.distance_mm
    drift = _drift(scene, setting, pupil.distance_mm) if drifts and isinstance(scene.camera, RealisticCamera) else ()
    return EntrancePupil(ahead, pupil.diameter_mm, drift)


def _drift(scene: Scene, setting: LensSetting, pupil_z: float) -> tuple[tuple[float, float], ...]:
    lens, frame = setting.lens, film_frame(scene.camera)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(half_film_mm(scene))
    film = frame.points(np.concatenate([corners * field for field in FIELDS]))
    film[:, 2] = lens.film_z(setting.film_distance_mm) + lens.sense * film[:, 2]
    points = tuple(map(tuple, film.tolist()))
    return _remembered(ByContent(without_shape(lens)), points, setting.camera.wavelength_nm, pupil_z)


@lru_cache(maxsize=REMEMBERED)
def _remembered(
    content: ByContent, film: tuple[tuple[float, ...], ...], wavelength_nm: float, pupil_z: float
) -> tuple[tuple[float, float], ...]:
    """Return the drift, ready for the next picture with the lens in the same state; in another process too where it is
    not found as fast."""
    if content.lens.is_rotational and len({z for _, _, z in film}) == 1:
        return tuple(_found(round_chief_rays, content.lens, film, wavelength_nm, pupil_z))
    name = content.name_of("drift", film, wavelength_nm, pupil_z)
    found = kept_or_found(KEPT, name, lambda: _found(film_chief_rays, content.lens, film, wavelength_nm, pupil_z))
    return tuple((field, drift) for field, drift in found)


def _found(
    chief_rays: Callable[[Lens, Array, float], ChiefRays],
    lens: Lens,
    film: tuple[tuple[float, ...], ...],
    wavelength_nm: float,
    pupil_z: float,
) -> list[tuple[float, float]]:
    try:
        rays = chief_rays(lens, np.array(film), wavelength_nm)
    except InputError:  # no surface of the lens limits the light
        return []
    places = np.where(rays.clear, pupil_z - rays.axis_points(), np.nan).reshape(len(FIELDS), -1)
    return [
        (field, float(np.mean(row[np.isfinite(row)])))
        for field, row in zip(FIELDS, places, strict=True)
        if np.isfinite(row).any()
    ]
