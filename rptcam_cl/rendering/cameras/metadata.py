"""What a picture's metadata say of its camera."""

from __future__ import annotations

from typing import Any, Literal, TypedDict


class Intrinsics(TypedDict, total=False):
    """What projects points of a camera's frame on the picture, as `intrinsics` says."""

    fx: float
    fy: float
    cx: float
    cy: float
    matrix: list[list[float]]
    distortion: Literal["none", "traced lens"]


class PupilMetadata(TypedDict, total=False):
    """What metadata say of an entrance pupil; None of what is infinite."""

    world_m: list[float] | None  # added where a picture is described
    ahead_of_eye_mm: float | None
    diameter_mm: float | None
    drift_mm: dict[str, float]  # by the field


class CameraMetadata(TypedDict, total=False):
    """What a picture's metadata say of its camera; what a kind has not is left out."""

    camera: str  # its kind
    lens: str
    zoom: str | None
    focal_length_mm: float | None  # None of a lens without power
    f_number: float | None
    film_distance_mm: float
    focus_distance_m: float | None  # None where nothing is sharp
    focus_method: str | None
    focus_field: list[float] | None
    focused_by: str | None
    wavelength_nm: float
    as_built: dict[str, Any]
    temperature_c: float
    pressure_hpa: float
    movements: dict[str, Any]
    intrinsics: Intrinsics
    entrance_pupil: PupilMetadata
    on_axis_irradiance: float | None  # for radiance 1
    transmittance: float  # on the axis
    pupil: str  # how rays aim at it
    pupil_instead_of: str
    pupil_widened: float
    lens_precision: str
    lens_rays: str
    lens_degree: int
    lens_rims: int
    lens_error_px: float
    lens_light_error: float
    lens_colour_px: float
    lens_tint: float
    lamps_aimed_at: int
    working_f_number: float
    t_number: float
    values_per_irradiance: float
    exposure_time_s: float
    iso: float
    ev100: float
    exposure_ev: float
    neutral_density_stops: float
