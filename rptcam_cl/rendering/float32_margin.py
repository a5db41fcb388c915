"""What a device's arithmetic costs in a lens: the same rays by the float64 reference and by the code that renders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import LensSetting, film_frame, half_film_mm, lens_setting, stop_shape, thick_lens_of
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Session
from rptcam_cl.optics import UNMOVED, FilmFrame, FilmProbe, Lens, Rays
from rptcam_cl.scene import RealisticCamera, Scene

RAYS = 512
SEED = 20

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LensMargin:
    """The largest differences between float32, or float64, on a device and float64 on the host.

    Attributes
    ----------
    rays, passed : int
        Rays that were sent from the film, and those that pass in float64.
    other_fate : int
        Rays that pass in one and not in the other.
    position_mm, direction : float or None
        Of the rays that pass both: where they leave the lens [mm], and their unit direction; None when none does.
    pixels : float or None
        The same in the plane in focus, in pixels at the scale of the picture's centre; None also for a lens that has
        no focal length.
    """

    rays: int
    passed: int
    other_fate: int
    position_mm: float | None
    direction: float | None
    pixels: float | None


def lens_margin(scene: Scene, session: Session) -> LensMargin | None:
    """Return what its precision costs in the lens of a scene's camera; None for cameras that trace no lens."""
    camera = scene.camera
    if not isinstance(camera, RealisticCamera) or camera.rays == "fitted":
        return None
    from rptcam_cl.lenstools import trace_on_device  # few renders measure this, and the room takes long to import

    setting = lens_setting(scene)
    lens, wavelength_nm = setting.lens, camera.wavelength_nm
    shape = stop_shape(scene, camera.aperture)
    if shape is not None and lens.stop is not None:
        lens = lens.with_stop_shape(shape)
    frame = film_frame(camera)
    origins, directions = film_rays(lens, setting.film_distance_mm, half_film_mm(scene), wavelength_nm, frame=frame)
    exact = lens.trace(origins, directions, wavelength_nm)
    traced = trace_on_device(lens, session, origins, directions, wavelength_nm, "film", camera.precision)
    return _compared(exact, traced, _pixels_per_radian(scene, setting), setting.focus_distance_mm)


def film_rays(
    lens: Lens,
    film_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: float,
    count: int = RAYS,
    frame: FilmFrame = UNMOVED,
) -> tuple[Array, Array]:
    """Return origins on the film and directions (n, 3) [mm], half to all of the last surface, half to the exit pupil.

    A lens whose exit pupil is infinitely far gets all of them over its last surface.
    """
    rng = np.random.default_rng(SEED)
    points = frame.points(rng.uniform(-1, 1, (count, 2)) * half_film_mm)
    film, depth = points[:, :2], points[:, 2]
    boxes = FilmProbe(lens, film_mm, wavelength_nm, frame).windows(film)
    aims = boxes[:, ::2] + rng.random(film.shape) * (boxes[:, 1::2] - boxes[:, ::2])
    aims = np.column_stack([aims, np.full(count, lens.length)])
    pupil = lens.first_order(wavelength_nm).exit_pupil
    if np.isfinite(pupil.distance_mm) and np.isfinite(pupil.diameter_mm) and pupil.distance_mm < film_mm:
        half = count // 2
        radius, turn = pupil.diameter_mm / 2 * np.sqrt(rng.random(half)), 2 * np.pi * rng.random(half)
        there = np.full(half, lens.film_z(pupil.distance_mm))
        aims[:half] = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), there])
    origins = np.column_stack([film, lens.film_z(film_mm) + lens.sense * depth])
    return origins, aims - origins


def _pixels_per_radian(scene: Scene, setting: LensSetting) -> float | None:
    """Return the scale of the picture at its centre, None for a lens that has none."""
    try:
        thick = thick_lens_of(setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm)
    except InputError:
        return None
    return scene.film.resolution[0] / (scene.film.size_m()[0] * 1e3) / abs(float(thick.slope[0]))


def _compared(exact: Rays, traced: Rays, pixels_per_radian: float | None, focus_mm: float | None) -> LensMargin:
    both = exact.passed & traced.passed
    passed, other = int(exact.passed.sum()), int((exact.passed != traced.passed).sum())
    if not both.any():
        return LensMargin(len(both), passed, other, None, None, None)
    apart = np.linalg.norm((traced.origins - exact.origins)[both], axis=1)
    turned = np.linalg.norm((traced.directions - exact.directions)[both], axis=1)
    angles = turned + (0.0 if focus_mm is None else apart / abs(focus_mm))
    return LensMargin(
        rays=len(both),
        passed=passed,
        other_fate=other,
        position_mm=float(apart.max()),
        direction=float(turned.max()),
        pixels=None if pixels_per_radian is None else float(angles.max()) * pixels_per_radian,
    )
