"""The thick lens: what the cardinal points and the pupils of a lens say, and nothing of its aberrations and rims."""

from __future__ import annotations

import math

import numpy as np

from rptcam_cl.cameras.blur import Blur, film_depths, perfect_blur
from rptcam_cl.cameras.entrance_pupil import entrance_pupil
from rptcam_cl.cameras.geometry import intrinsics
from rptcam_cl.cameras.lamp_reach import thick_lens_reach
from rptcam_cl.cameras.model import CameraModel, camera_record, entrance_pupil_view
from rptcam_cl.cameras.movements import check_film, movements_metadata, place_film
from rptcam_cl.cameras.setting import LensSetting, lens_setting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens, axial_transmittance, limiting_surface, system_matrix
from rptcam_cl.scene import Scene, ThickLensCamera

AT_THE_PUPIL = 1e-9  # distance from film to exit pupil, as a share of the film distance, that counts as none


@dataclass(frozen=True)
class ThickLens:
    """The ray that leads from a film point through a point of the pupil, both sides of the lens to first order.

    Every number is a factor for the film point [mm] and one for the point of the unit disk that the pupil is, in x and
    y alike. To first order the exit pupil, the entrance pupil and the stop are images of each other, so a point of that
    disk is a point of each. In this form nothing is infinite when a pupil is (a telecentric lens).

    Attributes
    ----------
    film_slope : tuple of float
        Sideways per unit towards the film, between the exit pupil and the film.
    height : tuple of float
        Where the ray meets the plane of the first vertex [mm].
    slope : tuple of float
        Sideways per unit towards the scene, in the scene.
    """

    film_slope: tuple[float, float]
    height: tuple[float, float]
    slope: tuple[float, float]

    @property
    def pupil_solid_angle(self) -> float:
        """Area of the exit pupil over the square of its distance from the film."""
        return math.pi * self.film_slope[1] ** 2

    def film_per_tangent(self, width_m: float, height_m: float) -> tuple[float, float]:
        """Return how many widths and heights of a film the image moves per unit of the tangent in the scene."""
        per_mm = 1e-3 / abs(self.slope[0])
        return per_mm / width_m, per_mm / height_m

    @property
    def lever(self) -> float:
        """Slope of chief rays at the film over that in the scene: the pupil's size there over its size at the film."""
        return self.film_slope[0] / abs(self.slope[0])

    @property
    def axial_cone(self) -> float:
        """Projected solid angle of the pupil from the centre of the film: pi sin^2 of the half angle."""
        square = self.film_slope[1] ** 2
        return math.pi * square / (1.0 + square)


def thick_lens_of(lens: Lens, film_distance_mm: float, wavelength_nm: float) -> ThickLens:
    """Return the thick lens of a lens and a film at a distance from its last vertex [mm].

    With matrices on (height, index * slope), front from the first vertex to the stop and rear from the stop to the
    film, a film point h and a stop point s belong to h = A s + B v, v being the slope at the stop times the index.

    Raises
    ------
    InputError
        For a lens that has no cardinal points, or other ones in x than in y, or whose exit pupil lies on the film.
    """
    _check(lens, wavelength_nm)
    stop = limiting_surface(lens, wavelength_nm)
    radius = lens.surfaces[stop].semi_diameter
    indices = lens.indices(wavelength_nm)
    n_scene, n_film = float(indices[0]), float(indices[-1])
    to_film = np.array([[1.0, film_distance_mm / n_film], [0.0, 1.0]])
    (at, along), (_, turn) = (to_film @ system_matrix(lens, wavelength_nm, stop)).tolist()
    (a, b), (c, d) = system_matrix(lens, wavelength_nm, 0, stop, refract_last=False).tolist()
    if abs(along) <= AT_THE_PUPIL * film_distance_mm:
        raise InputError(f"{lens.name}: its exit pupil lies on the film, {film_distance_mm:g} mm behind the lens")
    return ThickLens(
        film_slope=(turn / along / n_film, -radius / along / n_film),
        height=(-b / along, radius * (d + b * at / along)),
        slope=(-a / along / n_scene, radius * (c + a * at / along) / n_scene),
    )


def _check(lens: Lens, wavelength_nm: float) -> None:
    if not lens.is_rotational:
        raise InputError(
            f"{lens.name}: is not the same from every side, so no single thick lens stands for it;"
            " take camera.kind: realistic"
        )
    if not math.isfinite(lens.first_order(wavelength_nm).focal_length_mm):
        raise InputError(f"{lens.name}: is afocal, so it has no cardinal points; take camera.kind: realistic")
    if lens.is_obstructed:
        raise InputError(
            f"{lens.name}: its pupil is a ring, for which no thick lens stands; take camera.kind: realistic"
        )
    if lens.stop is not None and lens.stop.stop_shape is not None:
        raise InputError(f"{lens.name}: its stop is not round; take camera.kind: realistic")


def build(scene: Scene) -> CameraModel:
    """Return the camera for the device.

    Raises
    ------
    InputError
        When the lens cannot be set as requested, or is not one that a thick lens stands for.
    """
    return model_of(scene, lens_setting(scene))


def model_of(scene: Scene, setting: LensSetting) -> CameraModel:
    """Return the camera of a scene with its lens set in some other way than the scene says."""
    camera = scene.camera
    assert isinstance(camera, ThickLensCamera)
    thick = thick_lens_of(setting.lens, setting.film_distance_mm, camera.wavelength_nm)
    passed = float(axial_transmittance(setting.lens, camera.wavelength_nm, setting.transmission))
    on_axis = setting.gain * passed * thick.axial_cone
    scale = setting.gain * passed * thick.pupil_solid_angle
    width_m, height_m = scene.film.size_m()
    first_vertex_m = -setting.lens.film_z(setting.film_distance_mm) * 1e-3
    record = camera_record(
        camera, scene.film, "thick_lens",
        film_half_width=width_m / 2 * 1e3, film_half_height=height_m / 2 * 1e3, weight=scale,
        metres_per_mm=1e-3, first_vertex_z=first_vertex_m,
        film_slope_per_film=thick.film_slope[0], film_slope_per_pupil=thick.film_slope[1],
        height_per_film=thick.height[0], height_per_pupil=thick.height[1],
        slope_per_film=thick.slope[0], slope_per_pupil=thick.slope[1],
    )  # fmt: skip
    check_film(setting.lens, setting.film_distance_mm, scene)
    moved = place_film(record, scene)
    projection = intrinsics(scene, thick.film_per_tangent(width_m, height_m), lever=thick.lever)
    metadata = {"camera": "thick_lens", **setting.metadata, "on_axis_irradiance": on_axis, "intrinsics": projection}
    metadata |= movements_metadata(camera) | {"entrance_pupil": entrance_pupil(scene, setting).described()}
    metadata |= {"transmittance": passed} if setting.transmission else {}
    view = entrance_pupil_view(
        setting.lens.first_order(camera.wavelength_nm), first_vertex_m, lambda: _blur(thick, scene, first_vertex_m)
    )
    return CameraModel(
        "camera/thick_lens.h",
        record,
        facts=moved,
        metadata=metadata,
        view=view,
        on_axis_irradiance=on_axis,
        passed=passed,
        axial_weight=on_axis,
        reach=thick_lens_reach(thick.height, thick.slope, first_vertex_m, (width_m / 2 * 1e3, height_m / 2 * 1e3)),
    )


def _blur(thick: ThickLens, scene: Scene, first_vertex_m: float) -> Blur:
    """Return the circle of confusion: where a point is seen, its rays spread over the film as the pupil's points do.

    A point x at a distance D from the first vertex belongs to film points h with x = (height + D slope) (h, p). A film
    point farther back sees a point p of the pupil through h' = (h - depth film_slope p) / (1 + depth film_slope h).
    """
    film = scene.film
    width_m, height_m = film.size_m()
    pixels_per_mm = math.sqrt(film.resolution[0] / width_m * film.resolution[1] / height_m) * 1e-3
    (at, across), (turn, spread) = thick.height, thick.slope
    depths = film_depths(scene)
    nearer = 1.0 + depths * thick.film_slope[0]
    moved = depths * thick.film_slope[1] / nearer
    across_there, spread_there = across - moved * at, spread - moved * turn
    gains = 2 * pixels_per_mm * np.abs(across_there / turn * nearer) * 1e-3
    focuses = -spread_there / across_there * 1e3
    return perfect_blur(gains, focuses, shift=at / turn * 1e-3, origin_z=first_vertex_m)
