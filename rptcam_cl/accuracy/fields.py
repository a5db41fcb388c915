"""What a traced lens does at points of the film: the light that it brings there, found by rays in float64."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.accuracy.bundles import RINGS, Bundle
from rptcam_cl.accuracy.pupils import Pupils
from rptcam_cl.accuracy.stops import coverage
from rptcam_cl.cameras.lens_setting import LensSetting
from rptcam_cl.optics import Lens
from rptcam_cl.optics.stop_shape import StopMask, StopShape

Array = NDArray[np.float64]

NUDGE = 0.01  # of the half diagonal, between film points that tell the scale of the picture
SHAPED_RINGS = 16  # of rays through a stop that is not round
CORNERS = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])


@dataclass(frozen=True)
class Field:
    """What the traced lens does at a film point.

    Attributes
    ----------
    point : (2,) array
        On the film [mm].
    bundle : Bundle
        Its rays at the wavelength of the camera.
    beside : Bundle
        The same rays from a film point close by.
    apart_px : float
        How many pixels lie between the two.
    colours : tuple of Bundle
        The same rays at other wavelengths.
    light : (n,) array
        Irradiance in a world of radiance 1 as far from the axis as the point; with a stop that is not round, towards
        each corner of the film.
    """

    point: Array
    bundle: Bundle
    beside: Bundle
    apart_px: float
    colours: tuple[Bundle, ...]
    light: Array

    @property
    def along(self) -> Array:
        """Direction of the field (2,), of length 1."""
        length = float(np.hypot(*self.point))
        return self.point / length if length else np.array([1.0, 0.0])

    def pixels_per_mm(self, plane_mm: float) -> float:
        """Return the scale of the picture of a plane across the axis; infinite where it has none."""
        steps = self.beside.places(plane_mm) - self.bundle.places(plane_mm)
        good = np.isfinite(steps[:, 0])
        step = float(np.hypot(*steps[good].mean(axis=0))) if good.any() else 0.0
        return self.apart_px / step if step > 0 else np.inf

    def colour_mm(self, plane_mm: float) -> float:
        """Return by how much rays of other wavelengths meet a plane beside their place, at most."""
        here = self.bundle.places(plane_mm)
        apart = [np.hypot(*(other.places(plane_mm) - here).T) for other in self.colours]
        return float(max((np.max(each[np.isfinite(each)], initial=0.0) for each in apart), default=0.0))


def traced_fields(
    setting: LensSetting,
    shape: StopShape | StopMask | None,
    half_mm: Array,
    pixel_mm: float,
    shares: Sequence[float],
    colours_nm: Sequence[float] = (),
) -> list[Field | None]:
    """Return what a lens does at film points along the half diagonal; None where it lets no light through.

    Parameters
    ----------
    setting
        The lens in use.
    shape
        Of its stop; None is round.
    half_mm
        (2,) half the sides of the film.
    pixel_mm
        Side of a pixel.
    shares
        Of the half diagonal: where the film points lie.
    colours_nm
        Other wavelengths.
    """
    lens, back_mm, own_nm = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
    points = np.outer(shares, half_mm)
    pupils = Pupils.of(lens, back_mm, points, own_nm)
    rear, area = pupils.nodes(RINGS)
    nudges = np.where(np.any(points, axis=1)[:, None], -NUDGE, NUDGE) * half_mm
    moved = rear + (nudges * _follows(lens, back_mm, own_nm))[:, None]
    here = _bundles(setting, points, rear, area)
    beside = _bundles(setting, points + nudges, moved, area)
    others = [_bundles(setting, points, rear, area, nm) for nm in colours_nm]
    light = np.array([[bundle.light for bundle in here]]) if shape is None else _shaped_light(setting, shape, pupils)
    found: list[Field | None] = []
    for k, point in enumerate(points):
        if not here[k].light > 0:
            found.append(None)
            continue
        good = np.isfinite(here[k].origins[:, 0])
        colours = tuple(other[k].only(good) for other in others)
        apart_px = float(np.hypot(*nudges[k])) / pixel_mm
        found.append(Field(point, here[k].only(good), beside[k].only(good), apart_px, colours, light[:, k]))
    return found


def _bundles(
    setting: LensSetting, points: Array, rear: Array, area: Array, wavelength_nm: float | None = None
) -> list[Bundle]:
    """Return the rays from film points (m, 2) through points (m, n, 2) of the plane of the last vertex.

    Parameters
    ----------
    area
        (m, n) of that plane which each ray stands for [mm2].
    wavelength_nm
        That of the camera by default, which losses in the lens are known for.
    """
    lens, back_mm = setting.lens, setting.film_distance_mm
    origins, towards = _from_film(lens, back_mm, points, rear)
    rays = lens.trace(
        origins,
        towards,
        setting.camera.wavelength_nm if wavelength_nm is None else wavelength_nm,
        transmission=setting.transmission if wavelength_nm is None and setting.transmission else None,
    )
    good = rays.passed
    weights = np.where(good, area.ravel() * (back_mm / np.sum(towards**2, axis=1)) ** 2, 0.0)
    if rays.transmittance is not None:
        weights = weights * rays.transmittance
    starts = np.where(good[:, None], rays.origins * (1, 1, -1) + (0, 0, lens.film_z(back_mm)), np.nan)
    leaving = np.where(good[:, None], rays.directions / -rays.directions[:, 2:], np.nan)
    leaving[:, 2] *= -1.0
    shape = (len(points), -1)
    parts = (starts.reshape(*shape, 3), leaving.reshape(*shape, 3), weights.reshape(shape))
    return [Bundle(*part) for part in zip(*parts, strict=True)]


def _follows(lens: Lens, back_mm: float, wavelength_nm: float) -> float:
    """Return how far rays through a point of the exit pupil move at the last vertex per distance along the film."""
    from_film = back_mm - lens.first_order(wavelength_nm).exit_pupil.distance_mm
    return 1.0 - back_mm / from_film if np.isfinite(from_film) and from_film else 1.0


def _shaped_light(setting: LensSetting, shape: StopShape | StopMask, pupils: Pupils) -> Array:
    """Return the irradiance (corners, m) through a stop that is not round, whose mirror images the corners see."""
    rear, area = pupils.nodes(SHAPED_RINGS)
    light = np.array([bundle.weights for bundle in _bundles(setting, pupils.film, rear, area)])
    at_stop = _at_stop(setting, pupils.film, rear)
    return np.array([np.sum(light * coverage(shape, at_stop * side), axis=1) for side in CORNERS])


def _at_stop(setting: LensSetting, film: Array, rear: Array) -> Array:
    """Return where rays from film points (m, 2) cross the stop (m, n, 2), in units of its radius."""
    lens, back_mm = setting.lens, setting.film_distance_mm
    assert lens.stop is not None and lens.stop_index is not None
    behind = replace(lens, surfaces=lens.surfaces[lens.stop_index :], stop_index=0)
    origins, towards = _from_film(behind, back_mm, film, rear)
    rays = behind.trace(origins, towards, setting.camera.wavelength_nm)
    return rays.origins[:, :2].reshape(rear.shape) / lens.stop.semi_diameter


def _from_film(lens: Lens, back_mm: float, film: Array, rear: Array) -> tuple[Array, Array]:
    """Return origins and directions of rays from film points (m, 2) through points (m, n, 2) behind the last vertex."""
    origins, towards = np.empty((2, *rear.shape[:2], 3))
    origins[..., :2], origins[..., 2] = film[:, None], lens.film_z(back_mm)
    towards[..., :2], towards[..., 2] = rear - film[:, None], -lens.sense * back_mm
    return origins.reshape(-1, 3), towards.reshape(-1, 3)
