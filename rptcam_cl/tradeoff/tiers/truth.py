"""What the traced lens of a scene does, found by rays in float64: cheaper camera models are measured by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import (
    EXTREMES_NM,
    LensSetting,
    camera_model,
    disperses,
    lens_tint,
    shows_losses,
    stop_shape,
    usable_nm,
)
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics import Lens, StopMask, StopShape, on_axis_irradiance
from rptcam_cl.scene import RealisticCamera, Scene
from rptcam_cl.tradeoff.tiers.bundles import RINGS, RayBundle
from rptcam_cl.tradeoff.tiers.depths import VisibleWorld
from rptcam_cl.tradeoff.tiers.pupils import Pupils
from rptcam_cl.tradeoff.tiers.stops import RoundStop, coverage, round_stop
from rptcam_cl.tradeoff.tiers.tiers import FirstOrderCamera, Tier, equivalent

Array = NDArray[np.float64]

NUDGE = 0.01  # of the half diagonal, between film points that tell the scale of the picture
SHAPED_RINGS = 16  # of rays through a stop that is not round
CORNERS = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])


@dataclass(frozen=True)
class FieldPoint:
    """What the traced lens does at a film point.

    Attributes
    ----------
    point : (2,) array
        On the film [mm].
    bundle : RayBundle
        Its rays at the wavelength of the camera.
    beside : RayBundle
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
    bundle: RayBundle
    beside: RayBundle
    apart_px: float
    colours: tuple[RayBundle, ...]
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
) -> list[FieldPoint | None]:
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
    found: list[FieldPoint | None] = []
    for k, point in enumerate(points):
        if not here[k].light > 0:
            found.append(None)
            continue
        good = np.isfinite(here[k].origins[:, 0])
        colours = tuple(other[k].only(good) for other in others)
        apart_px = float(np.hypot(*nudges[k])) / pixel_mm
        found.append(FieldPoint(point, here[k].only(good), beside[k].only(good), apart_px, colours, light[:, k]))
    return found


def _bundles(
    setting: LensSetting, points: Array, rear: Array, area: Array, wavelength_nm: float | None = None
) -> list[RayBundle]:
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
    return [RayBundle(*part) for part in zip(*parts, strict=True)]


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


FIELDS = (0.0, 0.25, 0.5, 0.7, 0.85, 1.0)  # film points along its half diagonal


@dataclass(frozen=True)
class Truth:
    """The traced lens of a scene.

    Attributes
    ----------
    scene : Scene
    first : FirstOrderCamera
        What the lens is to first order.
    shaped : Lens
        It, with its stop in the shape that it has.
    half_mm : (2,) array
        Half the sides of the film.
    fields : tuple of Field or None
        What the lens does at each of `FIELDS`; None where it sees nothing.
    round_stop : RoundStop
        That may stand in for its stop.
    tint : float
        How much more of one colour than of another the lens takes, where the picture shows it.
    coloured : bool
        Whether the scene uses the lens's own colours and it has any.
    """

    scene: Scene
    first: FirstOrderCamera
    shaped: Lens
    half_mm: Array
    fields: tuple[FieldPoint | None, ...]
    round_stop: RoundStop
    tint: float
    coloured: bool

    @classmethod
    def of(cls, scene: Scene, first: FirstOrderCamera) -> Truth:
        """Return what the lens of a scene does."""
        camera, setting = scene.camera, first.setting
        assert isinstance(camera, RealisticCamera)
        half_mm = np.array(scene.film.size_m()) / 2 * 1e3
        shape = stop_shape(scene, camera.aperture)
        shaped = setting.lens if shape is None else setting.lens.with_stop_shape(shape)
        low, high = usable_nm(setting.lens)
        requested = scene.spectrum.lens_colour != "off"
        coloured = requested and disperses(setting.lens)
        colours_nm = [min(max(end, low), high) for end in EXTREMES_NM] if coloured else []
        pixel_mm = float(2 * half_mm[0] / scene.film.resolution[0])
        fields = traced_fields(setting, shape, half_mm, pixel_mm, FIELDS, colours_nm)
        tint = lens_tint(scene, setting) if requested else 0.0
        return cls(scene, first, shaped, half_mm, tuple(fields), round_stop(shape), tint, coloured)

    @property
    def view(self) -> VisibleWorld:
        """What the camera may see, ahead of the film: at least as much as to first order."""
        setting = self.first.setting
        start = setting.lens.film_z(setting.film_distance_mm)
        half, slopes = np.zeros(2), self.half_mm / self.first.film_mm_per_tangent
        for field in self.fields:
            if field is not None:
                half = np.maximum(half, np.abs(field.bundle.places(start)).max(axis=0))
                slopes = np.maximum(slopes, np.abs(field.bundle.directions[:, :2]).max(axis=0))
        return VisibleWorld(start, half, slopes)

    def blur_px(self, depths_mm: Sequence[float]) -> tuple[float, ...]:
        """Return how far light of a point falls from its middle at each of `FIELDS`, at most [pixels]."""
        return tuple(
            np.inf
            if field is None
            else max(
                float(field.bundle.spot(depth, field.along).outline.max()) * field.pixels_per_mm(depth)
                for depth in depths_mm
            )
            for field in self.fields
        )

    def colour_px(self, depths_mm: Sequence[float]) -> tuple[float, ...]:
        """Return how far light of other wavelengths falls from its place at each of `FIELDS`, at most [pixels]."""
        return tuple(
            0.0 if field is None else max(field.colour_mm(depth) * field.pixels_per_mm(depth) for depth in depths_mm)
            for field in self.fields
        )

    def axial(self, tier: Tier) -> float:
        """Return the brightness of the film's centre in the picture of a tier, over that of the traced lens."""
        if not shows_losses(self.scene):
            return 1.0
        setting = self.first.setting
        own = camera_model(equivalent(self.scene, tier)).on_axis_irradiance
        assert own is not None
        true = on_axis_irradiance(
            self.shaped, setting.film_distance_mm, setting.camera.wavelength_nm, setting.transmission
        )
        return own / true
