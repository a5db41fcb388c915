"""What the traced lens of a scene does, as cheaper camera models are measured by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.accuracy.fields import Field, traced_fields
from rptcam_cl.accuracy.stops import RoundStop, round_stop
from rptcam_cl.accuracy.tiers import FirstOrderCamera, Tier, equivalent
from rptcam_cl.accuracy.view import View
from rptcam_cl.cameras import camera_model
from rptcam_cl.cameras.aperture import stop_shape
from rptcam_cl.cameras.dispersion import EXTREMES_NM, disperses, usable_nm
from rptcam_cl.cameras.realistic import lens_tint, shows_losses
from rptcam_cl.optics import Lens
from rptcam_cl.optics.irradiance import on_axis_irradiance
from rptcam_cl.scene import Scene
from rptcam_cl.scene.camera import RealisticCamera

Array = NDArray[np.float64]

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
        Whether the scene asks for the lens's own colours and it has any.
    """

    scene: Scene
    first: FirstOrderCamera
    shaped: Lens
    half_mm: Array
    fields: tuple[Field | None, ...]
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
        asked = scene.spectrum.lens_colour != "off"
        coloured = asked and disperses(setting.lens)
        colours_nm = [min(max(end, low), high) for end in EXTREMES_NM] if coloured else []
        pixel_mm = float(2 * half_mm[0] / scene.film.resolution[0])
        fields = traced_fields(setting, shape, half_mm, pixel_mm, FIELDS, colours_nm)
        tint = lens_tint(scene, setting) if asked else 0.0
        return cls(scene, first, shaped, half_mm, tuple(fields), round_stop(shape), tint, coloured)

    @property
    def view(self) -> View:
        """What the camera may see, ahead of the film: at least as much as to first order."""
        setting = self.first.setting
        start = setting.lens.film_z(setting.film_distance_mm)
        half, slopes = np.zeros(2), self.half_mm / self.first.film_mm_per_tangent
        for field in self.fields:
            if field is not None:
                half = np.maximum(half, np.abs(field.bundle.places(start)).max(axis=0))
                slopes = np.maximum(slopes, np.abs(field.bundle.directions[:, :2]).max(axis=0))
        return View(start, half, slopes)

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
