"""The rays of a drawing: of each field and wavelength even steps over what passes, and what is blocked beside."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.colours import SERIES, wavelength_colour
from rptcam_cl.lenstools.fields import at_plane, default_fields, fan_points, section_rays
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.lenstools.ray_paths import RayPaths, Tracer, ray_paths
from rptcam_cl.optics import Status

if TYPE_CHECKING:
    from rptcam_cl.optics import Lens

Array = NDArray[np.float64]

APPROACH = 0.25  # length of the rays drawn before the lens, in sizes of the lens
BEYOND = 0.8  # how far rays are drawn behind a lens without film, in sizes of the lens


@dataclass(frozen=True)
class View:
    """What is drawn of a lens.

    Attributes
    ----------
    section : str
        "y" for the y-z plane, "x" for the x-z plane.
    fields : sequence of float, optional
        Angles from the axis [degrees]; chosen from the lens when absent.
    rays : int
        Rays of each field and wavelength that pass.
    wavelengths_nm : sequence of float
        That of the setting when empty.
    blocked : bool
        Whether rays that are stopped are drawn, too.
    """

    section: str = "y"
    fields: Sequence[float] | None = None
    rays: int = 7
    wavelengths_nm: Sequence[float] = ()
    blocked: bool = True

    def __post_init__(self) -> None:
        if self.section not in ("x", "y"):
            raise InputError(f'section must be "x" or "y" (got {self.section!r})')
        if self.rays < 1:
            raise InputError(f"at least one ray must be drawn (got {self.rays})")


@dataclass(frozen=True)
class Bundle:
    """The rays of one field and wavelength.

    Attributes
    ----------
    field_degrees, wavelength_nm : float
    colour : str
    incoming : (n, 3) array
        Directions before the lens.
    paths : RayPaths
    """

    field_degrees: float
    wavelength_nm: float
    colour: str
    incoming: Array
    paths: RayPaths

    def shown(self, blocked: bool) -> list[int]:
        """Return the rays to draw: those that pass, and on demand the others."""
        status = self.paths.last.status
        return [ray for ray in range(len(status)) if blocked or status[ray] == Status.ok]

    def line(self, setting: Setting, ray: int) -> Array:
        """Return the corners (m, 3) of a ray as drawn: from before the lens to the film, or to where it was stopped."""
        size = size_of(setting.lens)
        corners = self.paths.corners(ray).copy()
        along = self.incoming[ray] / np.linalg.norm(self.incoming[ray])
        corners[0] = corners[1] - along * min(APPROACH * size, setting.object_distance_mm)
        if self.paths.last.status[ray] != Status.ok:
            return corners
        direction = self.paths.last.directions[ray]
        if setting.film_distance_mm is None:
            return np.concatenate([corners, [corners[-1] + direction * BEYOND * size]])
        return np.concatenate([corners, at_plane(corners[-1:], direction[None], setting.film_z)])


def size_of(lens: Lens) -> float:
    """Return the larger of the length and the diameter of the glass [mm]."""
    finite = [surface.semi_diameter for surface in lens.surfaces if np.isfinite(surface.semi_diameter)]
    return float(max(lens.length, 2 * max(finite, default=0.0)))


def bundles(setting: Setting, view: View, tracer: Tracer) -> Iterator[Bundle]:
    """Yield the rays of every field and wavelength of a view, traced surface by surface."""
    wavelengths = view.wavelengths_nm or (setting.wavelength_nm,)
    fields = default_fields(setting, section=view.section) if view.fields is None else view.fields
    for number, degrees in enumerate(fields):
        points = _chosen_points(setting, degrees, view)
        origins, directions = section_rays(setting, degrees, points, view.section)
        for wavelength in wavelengths:
            colour = wavelength_colour(wavelength) if len(wavelengths) > 1 else SERIES[number % len(SERIES)]
            paths = ray_paths(setting.lens, origins, directions, wavelength, tracer)
            yield Bundle(degrees, wavelength, colour, directions, paths)


def _chosen_points(setting: Setting, degrees: float, view: View) -> Array:
    """Return points (n, 2) of the plane of the first vertex.

    They step evenly over what passes, and go on beyond it as long as there is glass, unless the middle is obstructed;
    when nothing passes they step over the whole first surface.
    """
    points = fan_points(setting, degrees, view.section)
    origins, directions = section_rays(setting, degrees, points, view.section)
    passed = np.flatnonzero(setting.lens.trace(origins, directions, setting.wavelength_nm, "scene").passed)
    axis = 1 if view.section == "y" else 0
    line = points[:, axis]
    low, high = (line[passed[0]], line[passed[-1]]) if len(passed) > 1 else (line[0], line[-1])
    step = (high - low) / max(view.rays - 1, 1)
    below = above = 0
    if view.blocked and view.rays > 1 and step > 0:
        below, above = (int(min(view.rays, room // step)) for room in (low - line[0], line[-1] - high))
    if setting.lens.is_obstructed and len(passed) > 1:  # even steps would mostly end at the obstruction
        result = np.zeros((view.rays, 2))
        result[:, axis] = line[passed[np.linspace(0, len(passed) - 1, view.rays).astype(int)]]
        return result
    start = (low + high) / 2 if view.rays == 1 else low
    result = np.zeros((below + view.rays + above, 2))
    result[:, axis] = start + step * np.arange(-below, view.rays + above)
    return result
