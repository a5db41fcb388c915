"""Images of points over the picture as kernels to fold pictures with: for each field, wavelength and distance.

By geometrical optics: rays from a point of the scene, evenly over the entrance of the lens, and the pixels they end in.
The middle pixel of a kernel is centred on the chief ray of the camera's wavelength, so that coma and lateral colour
show as centroids beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.calibration.view import View, check_distances, distance_along
from rptcam_cl.cameras import film_frame, stop_shape
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import (
    Beam,
    Lens,
    Rays,
    film_chief_rays,
    is_steep,
    passing_beam,
    passing_from,
    takes_steep_light,
)
from rptcam_cl.scene import RealisticCamera

Array = NDArray[np.float64]

ACROSS = 96  # rays that span a beam each way
MOST_PX = 129  # of a kernel's side
FAR_MM = 1e8


@dataclass(frozen=True)
class PointImages:
    """Kernels over a picture.

    Attributes
    ----------
    kernels : (rows, columns, wavelengths, distances, n, n) array
        Share of the light of a point that each pixel receives; each kernel sums to 1, or to 0 where no light passes.
    centroids : (rows, columns, wavelengths, distances, 2) array
        Centroid of the light, right and down from the chief ray [pixels].
    kept : (rows, columns, wavelengths, distances) array
        Share of the light that falls within the kernel; less than 1 where it is cut off.
    places : (rows, columns, 2) array
        Where the chief rays meet the picture [pixels from its corner].
    wavelengths_nm, distances_m : tuple of float
    """

    kernels: NDArray[np.float32]
    centroids: Array
    kept: Array
    places: Array
    wavelengths_nm: tuple[float, ...]
    distances_m: tuple[float, ...]

    def arrays(self) -> dict[str, NDArray[np.floating]]:
        """Return what a NumPy file holds of it."""
        return {
            "kernels": self.kernels,
            "centroids_px": self.centroids,
            "kept": self.kept,
            "places_px": self.places,
            "wavelengths_nm": np.array(self.wavelengths_nm),
            "distances_m": np.array(self.distances_m),
        }


def point_images(
    view: View,
    grid: tuple[int, int] = (5, 3),
    wavelengths_nm: Sequence[float] = (),
    distances_m: Sequence[float] = (),
    pixels: int | None = None,
    across: int = ACROSS,
) -> PointImages:
    """Return the images of points seen at the centres of cells (columns, rows) that part the picture.

    Parameters
    ----------
    wavelengths_nm
        That of the camera when empty.
    distances_m
        From the entrance pupil, along the axis or of a sphere as the view has it; that of the view when empty.
    pixels
        Side of a kernel, odd; as large as the light needs when absent, up to `MOST_PX`.
    across
        Rays that span a beam each way.

    Raises
    ------
    InputError
        Of a camera without a lens to trace; of a field more than 85 degrees from the axis through a first surface that
        is no sphere; of an even side; of a distance that is not above 0.
    """
    camera = view.scene.camera
    if not isinstance(camera, RealisticCamera) or view.setting is None:
        raise InputError("--psf-grid: needs a lens to trace (allowed: camera.kind: realistic)")
    if pixels is not None and (pixels < 1 or pixels % 2 == 0):
        raise InputError(f"--psf-pixels: must be odd, so that a pixel lies in the middle (got {pixels})")
    waves = tuple(wavelengths_nm) or (view.setting.camera.wavelength_nm,)
    distances = tuple(distances_m) or (view.distance_m,)
    check_distances(distances)
    x, y = ((np.arange(count) + 0.5) * side / count for count, side in zip(grid, view.size, strict=True))
    places = np.stack(np.meshgrid(x, y), axis=-1)
    shape = (grid[1], grid[0], len(waves), len(distances))
    landed: dict[tuple[int, ...], tuple[Array, Array]] = {}
    sources = _Sources(view, places.reshape(-1, 2))
    for index in np.ndindex(shape):
        cell = index[0] * grid[0] + index[1]
        landed[index] = sources.landed(cell, waves[index[2]], distances[index[3]], across)
    side = pixels or _side(landed)
    kernels = np.zeros((*shape, side, side), np.float32)
    centroids, kept = np.full((*shape, 2), np.nan), np.zeros(shape)
    for index, (off, weights) in landed.items():
        if len(off):
            centroids[index] = weights @ off
            kernels[index], kept[index] = _kernel(off, weights, side)
    return PointImages(kernels, centroids, kept, places, waves, distances)


def _side(landed: dict[tuple[int, ...], tuple[Array, Array]]) -> int:
    reach = max((float(np.abs(off).max()) for off, _ in landed.values() if len(off)), default=0.0)
    return min(2 * math.ceil(reach) + 1, MOST_PX)


def _kernel(off: Array, weights: Array, side: int) -> tuple[NDArray[np.float32], float]:
    """Return the light of each pixel about the chief ray, and the share that falls into any."""
    half = side / 2
    light, _, _ = np.histogram2d(off[:, 1], off[:, 0], bins=side, range=[[-half, half]] * 2, weights=weights)
    total = float(light.sum())
    return (light / total if total > 0 else light).astype(np.float32), total


class _Sources:
    """Points of the scene on the chief rays of places of a picture."""

    def __init__(self, view: View, places: Array) -> None:
        assert view.setting is not None and isinstance(view.scene.camera, RealisticCamera)
        self.view, self.frame = view, film_frame(view.scene.camera)
        shape = stop_shape(view.scene, view.scene.camera.aperture)
        self.lens: Lens = view.setting.lens if shape is None else view.setting.lens.with_stop_shape(shape)
        self.film_z = self.lens.film_z(view.setting.film_distance_mm)
        film = view.film_points(places)
        film[:, 2] = self.film_z + self.lens.sense * film[:, 2]
        self.film = film
        self.chief = film_chief_rays(self.lens, film, view.setting.camera.wavelength_nm)
        self.pupil = np.array([0.0, 0.0, self.film_z - view.pupil_ahead_mm])
        self.sphere = replace(view, distance_m=1.0).object_shape == "sphere"

    def landed(self, cell: int, wavelength_nm: float, distance_m: float, across: int) -> tuple[Array, Array]:
        """Return where rays land beside the chief ray, right and down [pixels], and their shares of the light."""
        nothing = np.zeros((0, 2)), np.zeros(0)
        if not self.chief.found[cell]:
            return nothing
        away, distance_mm, origin = self._point(cell, distance_m)
        point = origin + away * distance_mm if math.isfinite(distance_mm) else away
        steep = is_steep(math.degrees(math.atan2(math.hypot(*point[:2]), -point[2])))
        if steep and not takes_steep_light(self.lens):
            raise InputError(
                f"{self.lens.name}: point images more than 85 degrees from the axis need a first surface that is"
                " spherical, bulging to the scene"
            )
        try:
            if steep:
                cosines, rays = passing_from(self.lens, away, distance_mm, origin, wavelength_nm, across)
            else:
                far = -float(point[2]) if math.isfinite(distance_mm) else math.inf
                cosines, rays = self._through_plane(point, far, wavelength_nm, across)
        except InputError:  # nothing of the light comes through
            return nothing
        at = self._on_film(rays.origins, rays.directions)
        off = (at - self.frame.on_film(self.film[cell, None, :2])) * self._pixels_per_mm()
        weights = cosines**4
        return off, weights / weights.sum()

    def _point(self, cell: int, distance_m: float) -> tuple[Array, float, Array]:
        """Return where the point of a chief ray lies: the direction to it and its distance [mm] from an origin."""
        origin, away = self.chief.origins[cell], self.chief.directions[cell]
        if not distance_m * 1e3 < FAR_MM:
            return away, math.inf, origin
        from_pupil = (origin - self.pupil)[None]
        return away, float(distance_along(from_pupil, away[None], distance_m * 1e3, sphere=self.sphere)[0]), origin

    def _through_plane(self, point: Array, far: float, wavelength_nm: float, across: int) -> tuple[Array, Rays]:
        """Return the cosines of the light's angles from the axis, and the rays, spread over the first vertex plane."""
        tangent = float(np.hypot(*point[:2])) / -float(point[2])
        azimuth = math.degrees(math.atan2(-point[1], -point[0]))
        beam = Beam(math.degrees(math.atan(tangent)), far, azimuth)
        points, rays, _ = passing_beam(self.lens, beam, wavelength_nm, across)
        _, incoming = beam.rays(points)
        return incoming[:, 2] / np.linalg.norm(incoming, axis=1), rays

    def _on_film(self, origins: Array, directions: Array) -> Array:
        """Return where rays meet the film, on it (n, 2) [mm]."""
        sense, centre = self.lens.sense, np.array(self.frame.centre)
        slopes = np.array(self.frame.slopes)
        # z = film_z + sense * slopes . (x, y - centre) on the film
        above = origins[:, 2] - self.film_z - sense * (origins[:, :2] - centre) @ slopes
        step = -above / (directions[:, 2] - sense * directions[:, :2] @ slopes)
        return self.frame.on_film(origins[:, :2] + directions[:, :2] * step[:, None])

    def _pixels_per_mm(self) -> Array:
        """Return pixels to the right and down per millimetre right and up on the film, which a lens inverts."""
        sense = -1.0 if self.view.scene.camera.flip else 1.0
        sides_mm = np.array(self.view.scene.film.size_m()) * 1e3
        return np.asarray(sense * np.array([1.0, -1.0]) * self.view.scene.film.resolution / sides_mm)
