"""Cheaper cameras in place of a traced lens: polynomials, or what agrees with it to first order."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from rptcam_cl.cameras import (
    LensSetting,
    RayMap,
    ThickLens,
    allowed_px,
    disperses,
    fitted_map,
    lens_setting,
    lens_to_focus,
    stop_shape,
    thick_lens_of,
    usable_nm,
)
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import RealisticCamera, Scene, change_scene, with_camera
from rptcam_cl.tradeoff.tiers.stops import round_stop


def fitted_to(scene: Scene, *, colours: bool) -> RayMap:
    """Return the polynomials of the lens of a scene.

    Parameters
    ----------
    colours
        Whether the lens refracts each wavelength separately.

    Raises
    ------
    InputError
        When there are none that are good enough.
    """
    camera, setting = scene.camera, lens_setting(scene)
    assert isinstance(camera, RealisticCamera)
    range_nm = usable_nm(setting.lens) if colours and disperses(setting.lens) else None
    return fitted_map(setting.lens, setting, scene.film, range_nm, allowed_px(camera))


Tier = Literal["pinhole", "thin_lens", "thick_lens", "fitted", "realistic"]
TIERS: tuple[Tier, ...] = ("pinhole", "thin_lens", "thick_lens", "fitted", "realistic")  # by rising cost


@dataclass(frozen=True)
class Traits:
    """What a tier can show.

    Attributes
    ----------
    shapes : bool
        Stops that are not round.
    colours : bool
        Light of every wavelength in its own place, and what the lens takes of each.
    """

    shapes: bool = False
    colours: bool = False


TRAITS: dict[Tier, Traits] = {
    "pinhole": Traits(),
    "thin_lens": Traits(shapes=True),
    "thick_lens": Traits(),
    "fitted": Traits(shapes=True, colours=True),
    "realistic": Traits(shapes=True, colours=True),
}

# Keys of a traced camera that a thick lens has too; pinhole and thin lens share the pose alone.
_POSE = ("target", "up", "flip")
_TRACED_ONLY = ("pupil", "rays", "precision", "aperture", "accuracy", "ghosts", "barrel_reflectance")


@dataclass(frozen=True)
class FirstOrderCamera:
    """What a lens in use is to first order.

    Attributes
    ----------
    setting : LensSetting
    thick : ThickLens
    pupil_mm : float
        Distance of the entrance pupil ahead of the film along the axis.
    radius_mm : float
        Radius of the entrance pupil.
    film_mm_per_tangent : float
        How far an image point moves over the film per unit of the tangent of its direction from the entrance pupil.
    plane_mm : float or None
        Distance of the plane in focus ahead of the entrance pupil; None where no object is sharp.
    """

    setting: LensSetting
    thick: ThickLens
    pupil_mm: float
    radius_mm: float
    film_mm_per_tangent: float
    plane_mm: float | None


def first_order_camera(scene: Scene) -> FirstOrderCamera:
    """Return what the lens of a scene's camera is to first order.

    Raises
    ------
    InputError
        For a lens that has no cardinal points, or whose entrance pupil is infinitely far away.
    """
    setting = lens_setting(scene)
    wavelength_nm = setting.camera.wavelength_nm
    thick = thick_lens_of(setting.lens, setting.film_distance_mm, wavelength_nm)
    pupil = setting.lens.first_order(wavelength_nm).entrance_pupil
    if not (np.isfinite(pupil.distance_mm) and np.isfinite(pupil.diameter_mm)):
        raise InputError(f"{setting.lens.name}: its entrance pupil is infinitely far away")
    ahead_mm = setting.lens.film_z(setting.film_distance_mm) - pupil.distance_mm
    focus_mm = setting.focus_distance_mm
    plane_mm = None if focus_mm is None else focus_mm - ahead_mm
    return FirstOrderCamera(setting, thick, ahead_mm, pupil.diameter_mm / 2, 1 / abs(thick.slope[0]), plane_mm)


def equivalent(scene: Scene, tier: Tier) -> Scene:
    """Return a scene with the camera of a tier in place of the traced lens.

    Polynomials change nothing but how rays come through the lens. The thick lens keeps every setting, but a stop that
    is not round becomes one of the same area. Pinhole and thin lens stand in the entrance pupil, whose centre is the
    centre of the perspective, and see as much as the film does; the thin lens is as large as the entrance pupil and
    focused on the same plane.

    Raises
    ------
    InputError
        When the lens has no such equivalent; the message says why.
    """
    camera = scene.camera
    if tier == "realistic":
        return scene
    assert isinstance(camera, RealisticCamera)
    if tier == "fitted":
        fitted_to(scene, colours=scene.spectrum.lens_colour == "on")
        return change_scene(scene, camera={"rays": "fitted"})
    if camera.motion:
        raise InputError("camera.motion: a moving camera keeps its traced lens")
    if tier == "thick_lens":
        return with_camera(scene, _thick_lens(scene, camera))
    if tier == "pinhole" and camera.ghosts == "on":
        raise InputError("camera.ghosts: add the light that comes through an opening, and a pinhole has none")
    first = first_order_camera(scene)
    back = camera.world_from_camera()[:3, 2]
    eye = np.array(camera.eye) - back * first.pupil_mm * 1e-3 / scene.metres_per_unit
    half_mm = scene.film.size_m()[0] / 2 * 1e3
    keys = {name: getattr(camera, name) for name in _POSE} | {
        "kind": tier,
        "eye": eye.tolist(),
        "target": (eye - back).tolist(),
        "fov_degrees": float(np.rad2deg(2 * np.arctan(half_mm / first.film_mm_per_tangent))),
        "fov_axis": "horizontal",
    }
    if tier == "thin_lens":
        if first.plane_mm is None or first.plane_mm <= 0:
            raise InputError(f"{first.setting.lens.name}: no plane of the scene is in focus")
        keys |= {
            "aperture_radius_m": first.radius_mm * 1e-3,
            "focus_distance_m": min(first.plane_mm * 1e-3, 1e12),
            "aperture": camera.aperture,
        }
    return with_camera(scene, keys)


def _thick_lens(scene: Scene, camera: RealisticCamera) -> dict[str, Any]:
    """Return the keys of the thick lens in place of a traced one."""
    keys = {name: getattr(camera, name) for name in camera.model_fields_set if name not in _TRACED_ONLY}
    shape = stop_shape(scene, camera.aperture)
    if shape is not None:
        stop = lens_to_focus(scene, camera).stop
        if stop is None:
            raise InputError("camera.aperture: the lens has no stop to shape")
        keys.pop("f_number", None)
        keys["stop_diameter_mm"] = 2 * stop.semi_diameter * round_stop(shape).radius
    return keys | {"kind": "thick_lens"}
