"""Fields of view worth looking at, and fans of rays across a beam."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Beam

if TYPE_CHECKING:
    from rptcam_cl.lenstools.lens_state import Setting

Array = NDArray[np.float64]

SHARES = (0.0, 0.7, 1.0)
LEFT_OPEN = 0.5  # share of the axial fan that the widest field keeps
LARGEST_SPOT = 0.02  # rms of its fan on the film, in focal lengths, unless that on the axis is larger
STEEPEST = 85.0  # degrees
FAN = 401


def widest_field(setting: Setting, section: str = "y") -> float:
    """Return the largest field [degrees] at which the lens still draws a picture.

    Half of the meridional fan of the axis passes, and what passes stays together on the film.
    """
    low, high = 0.0, STEEPEST
    axis, blur = _passing(setting, 0.0, section)
    if axis == 0:
        raise InputError(f"{setting.lens.name}: the ray on the axis does not come through")
    focal_length = abs(setting.lens.first_order(setting.wavelength_nm, section).focal_length_mm)
    largest = max(LARGEST_SPOT * focal_length, 2 * blur)
    for _ in range(12):
        middle = (low + high) / 2
        width, spread = _passing(setting, middle, section)
        low, high = (middle, high) if width >= LEFT_OPEN * axis and spread <= largest else (low, middle)
    return low


def default_fields(setting: Setting, shares: Sequence[float] = SHARES, section: str = "y") -> list[float]:
    """Return the axis and parts of the widest field [degrees], rounded to be read."""
    widest = widest_field(setting, section)
    digits = 1 - math.floor(math.log10(widest)) if widest > 0 else 0
    return [round(share * widest, max(digits, 0)) for share in shares]


def fan_points(setting: Setting, field_degrees: float, section: str, count: int = FAN) -> Array:
    """Return points (count, 2) of the plane of the first vertex, in a line along the section, over the first surface.

    Their rays are all those of the beam that meet the first surface inside its rim, and a few more.
    """
    first = setting.lens.surfaces[0]
    if not np.isfinite(first.semi_diameter):
        raise InputError(f"{setting.lens.name}: the first surface needs a diameter")
    heights = np.linspace(-first.semi_diameter, first.semi_diameter, 65)
    zero = np.zeros_like(heights)
    sag = first.sag(zero, heights) if section == "y" else first.sag(heights, zero)
    source = -math.tan(math.radians(field_degrees)) * setting.object_distance_mm
    slope = (
        math.tan(math.radians(field_degrees))
        if math.isinf(setting.object_distance_mm)
        else (heights - source) / setting.object_distance_mm
    )
    at_vertex = heights - np.nan_to_num(sag) * slope
    line = np.linspace(at_vertex.min(), at_vertex.max(), count)
    return _along(line, section)


def section_rays(setting: Setting, field_degrees: float, points: Array, section: str) -> tuple[Array, Array]:
    """Return origins and directions (n, 3) of the rays of a beam through points of the plane of the first vertex.

    The beam is tilted in the section: light of a positive field travels towards +y, or +x.
    """
    beam = Beam(field_degrees, setting.object_distance_mm)
    origins, directions = beam.rays(points if section == "y" else points[:, ::-1])
    if section == "x":
        return origins[:, [1, 0, 2]], directions[:, [1, 0, 2]]
    return origins, directions


def _along(line: Array, section: str) -> Array:
    zero = np.zeros_like(line)
    return np.stack([zero, line] if section == "y" else [line, zero], axis=1)


def _passing(setting: Setting, field_degrees: float, section: str) -> tuple[float, float]:
    """Return the width across the beam of its meridional fan that passes, and the rms of that fan on the film [mm].

    The rms is 0 without a film, or when less than two rays pass.
    """
    points = fan_points(setting, field_degrees, section)
    origins, directions = section_rays(setting, field_degrees, points, section)
    rays = setting.lens.trace(origins, directions, setting.wavelength_nm, "scene")
    good = rays.passed
    width = float(good.sum()) * float(np.abs(points[1] - points[0]).sum()) * math.cos(math.radians(field_degrees))
    if setting.film_distance_mm is None or good.sum() < 2:
        return width, 0.0
    return width, float(
        np.std(at_plane(rays.origins[good], rays.directions[good], setting.film_z)[:, :2], axis=0).max()
    )


def at_plane(origins: Array, directions: Array, z: float) -> Array:
    """Return the points (n, 3) where rays cross a plane across the axis."""
    return origins + directions * ((z - origins[:, 2]) / directions[:, 2])[:, None]
