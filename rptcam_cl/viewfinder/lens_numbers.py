"""The numbers of a camera in its state: focal length, f-numbers, pupils, depth of field, breathing, angles."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from rptcam_cl.cameras import lens_setting
from rptcam_cl.optics import FilmProbe, narrowed
from rptcam_cl.scene import EnvironmentCamera, LensCamera, Scene
from rptcam_cl.viewfinder.depth_of_field import depth_of_field, perspective
from rptcam_cl.viewfinder.lens_state import LensState
from rptcam_cl.viewfinder.panel import DIAGONAL_35_MM, f_number_of_camera, focal_length_mm

RADII = 24  # at which the edge of the image circle is sought at a time
FAN = (384, 1)  # rays from each, along the line where the last ones pass
LARGEST = 2.5  # image circle that is sought, over the film's own


def camera_numbers(scene: Scene) -> dict[str, Any]:
    """Return what is known of any camera in focus; None where there is no such number."""
    depth, focal_mm = depth_of_field(scene), focal_length_mm(scene)
    keys = ("distance_m", "near_m", "far_m", "hyperfocal_m", "circle_mm", "magnification", "breathing")
    found: dict[str, Any] = dict.fromkeys(keys) if depth is None else asdict(depth)
    found |= {
        "focal_length_mm": focal_mm,
        "equivalent_mm": None if focal_mm is None else focal_mm * DIAGONAL_35_MM / (scene.film.diagonal_m() * 1e3),
        "f_number": f_number_of_camera(scene),
        "working_f_number": _working_f_number(scene),
    }
    return found | _angles(scene, focal_mm)


def _working_f_number(scene: Scene) -> float | None:
    """Return the f-number of the light on the axis, from the film distance, to first order."""
    here = perspective(scene)
    if here is None:
        return None
    if not isinstance(scene.camera, LensCamera):
        return here.per_tangent_mm / here.diameter_mm
    setting = lens_setting(scene)
    pupil = setting.lens.first_order(scene.camera.wavelength_nm).exit_pupil
    index = float(setting.lens.indices(scene.camera.wavelength_nm)[-1])
    return abs(setting.film_distance_mm - pupil.distance_mm) / (index * pupil.diameter_mm)


def _angles(scene: Scene, focal_mm: float | None) -> dict[str, Any]:
    """Return the angles of view by the first-order projection [degrees]."""
    if isinstance(scene.camera, EnvironmentCamera) or focal_mm is None:
        return {"field_degrees": None, "fields_degrees": None}
    found = perspective(scene)
    per_tangent = focal_mm if found is None else found.per_tangent_mm
    sides = {"horizontal": scene.film.size_m()[0], "vertical": scene.film.size_m()[1]}
    sides["diagonal"] = scene.film.diagonal_m()
    angles = {name: math.degrees(2 * math.atan(side * 500 / per_tangent)) for name, side in sides.items()}
    return {"field_degrees": angles["diagonal"], "fields_degrees": angles}


def lens_numbers(state: LensState) -> dict[str, Any]:
    """Return the pupils and distances of a lens, besides what is known of any camera."""
    lens, setting = state.lens, state.setting
    first = lens.first_order(setting.camera.wavelength_nm)
    exit_z = lens.length + lens.sense * first.exit_pupil.distance_mm
    return camera_numbers(state.scene) | {
        "lens": lens.name,
        "entrance_pupil": _pupil(first.entrance_pupil.distance_mm, first.entrance_pupil.diameter_mm),
        "exit_pupil": _pupil(exit_z, first.exit_pupil.diameter_mm),
        "stop_diameter_mm": None if lens.stop is None else 2 * lens.stop.semi_diameter,
        "film_distance_mm": setting.film_distance_mm,
        "length_mm": lens.length,
        "surfaces": len(lens.surfaces),
    }


def _pupil(z_mm: float, diameter_mm: float) -> dict[str, float] | None:
    if not (math.isfinite(z_mm) and math.isfinite(diameter_mm)):
        return None
    return {"z_mm": z_mm, "radius_mm": diameter_mm / 2}


def image_circle_mm(state: LensState) -> float | None:
    """Return the radius on the film beyond which no ray arrives [mm], within 0.5 %; None beyond 2.5 times the film.

    Rays are traced in float64 along the line where the last of them pass, at some radii at a time.
    """
    half_mm = state.scene.film.diagonal_m() * 500
    probe = FilmProbe(state.lens, state.setting.film_distance_mm, state.setting.camera.wavelength_nm)
    low, high = 0.0, LARGEST * half_mm
    for _ in range(2):
        radii = np.linspace(low, high, RADII)
        film = np.column_stack([radii, np.zeros(RADII)])
        lit = np.asarray(narrowed(probe, film, probe.windows(film), FAN)[1], bool)
        if lit.all():
            return None if high == LARGEST * half_mm else float(high)
        dark = int(np.argmin(lit))
        if dark == 0:
            return float(low) or None
        low, high = float(radii[dark - 1]), float(radii[dark])
    return (low + high) / 2
