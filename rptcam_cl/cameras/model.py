"""What every camera model hands to the device."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.blur import Blur
from rptcam_cl.cameras.entrance_pupil import EntrancePupil
from rptcam_cl.cameras.lamp_reach import LampReach
from rptcam_cl.cameras.setting import LensSetting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import CAMERA, DISPERSION_NM, SURFACE, VIEW, PupilKind
from rptcam_cl.optics import FirstOrder
from rptcam_cl.scene import Film, LensCamera, Pose

SURFACE_BY_SURFACE = "camera/realistic.h"


@dataclass(frozen=True)
class CameraView:
    """What the auxiliary layers need to know of a camera; without arguments, of a point.

    Attributes
    ----------
    pupil_z_m : float
        Where the entrance pupil lies on the axis of the camera's frame [m].
    pupil_radius_m : float
        Its radius [m]; 0 for a point.
    blur : callable
        Returns the circle of confusion; a function, because to trace it takes a while.
    starts_ahead : bool
        Whether rays start ahead of the eye, that distances along them count from.
    """

    pupil_z_m: float = 0.0
    pupil_radius_m: float = 0.0
    blur: Callable[[], Blur] = Blur
    starts_ahead: bool = False

    def packed(self, *, with_blur: bool) -> tuple[NDArray[np.void], NDArray[np.float32]]:
        """Return the record for the device and the table of the circle of confusion, empty where it is not wanted."""
        blur = self.blur() if with_blur else Blur()
        record = VIEW.zeros(1)
        record["blur_focus"], record["blur_scale"], record["blur_shift"] = blur.focus, blur.scale, blur.shift
        record["blur_origin_z"], record["pupil_z"] = blur.origin_z, self.pupil_z_m
        record["per_pupil_radius"] = 1.0 / self.pupil_radius_m if self.pupil_radius_m else 0.0
        record["rows"], record["columns"] = blur.table.shape[:2]
        record["by_depth"], record["from_eye"] = blur.by_depth, self.starts_ahead
        return record, blur.table


@dataclass(frozen=True)
class CameraModel:
    """A camera ready for the device.

    Attributes
    ----------
    kernel : str
        The helper under ``kernels/`` that defines ``camera_ray``.
    record : array of one ``Camera`` record
    tables : float32 array
        What the helper looks up; empty for most.
    surfaces : array of ``Surface`` records
        Of a lens, film side first; in float64 where it is traced so.
    stop : array
        Shape of its stop, in the same precision.
    facts : dict
        Facts for the compilation of the camera's kernel.
    has_lens : bool
        Whether rays can be blocked.
    metadata : dict
        What the picture's metadata should say about the camera.
    view : CameraView
    usable_nm : (low, high)
        Wavelengths that its lens is known for [nm].
    axial_colour : (wavelengths, irradiances) or None
        What its lens lets pass of light of each wavelength [nm] on the axis, relative to `on_axis_irradiance`; None
        where paths have no wavelength.
    on_axis_irradiance : float or None
        Irradiance of the film's centre in a uniform world of radiance 1; None for a camera without a lens opening.
    passed : float
        Share of that light which the lens leaves of what enters it: 1 unless its losses count.
    axial_weight : float
        Mean weight there: the same number, or 1 where the weights leave radiance as it is.
    reach : LampReach or None
        How it sees points of the scene; None for a camera without a lens opening.
    setting : LensSetting or None
        The lens in use, where rays are traced through it.
    pupil : EntrancePupil or None
        Its entrance pupil, with its drift, where that was found.
    """

    kernel: str
    record: NDArray[np.void]
    facts: dict[str, int]
    tables: NDArray[np.float32] = field(default_factory=lambda: np.zeros(1, np.float32))
    surfaces: NDArray[np.void] = field(default_factory=lambda: SURFACE.zeros(1))
    stop: NDArray[np.floating] = field(default_factory=lambda: np.zeros(1, np.float32))
    has_lens: bool = False
    metadata: dict[str, Any] = field(default_factory=dict)
    view: CameraView = CameraView()
    usable_nm: tuple[float, float] = DISPERSION_NM
    axial_colour: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    on_axis_irradiance: float | None = None
    passed: float = 1.0
    axial_weight: float = 1.0
    reach: LampReach | None = None
    setting: LensSetting | None = None
    pupil: EntrancePupil | None = None

    @property
    def bends_colours(self) -> bool:
        """Whether light of each wavelength goes its own way through the lens."""
        return self.facts.get("LENS_DISPERSION", 0) > 0 or self.facts.get("MAP_COLOURS", 0) > 0

    @property
    def crosses_surfaces(self) -> bool:
        """Whether the kernel takes rays through surface after surface."""
        return self.kernel == SURFACE_BY_SURFACE

    @property
    def blocks_many(self) -> bool:
        """Whether many of its rays bring nothing: they aim at more than what passes, or half of the pupil counts."""
        return self.facts.get("PUPIL_KIND") != PupilKind.OUTLINES or bool(self.facts.get("HALF_PUPIL"))


def camera_record(pose: Pose, film: Film, kind: str, **own: float) -> NDArray[np.void]:
    """Return a camera record with pose and resolution in place, and what a camera of a kind has of its own."""
    record = _posed(CAMERA.zeros(1), pose)
    width, height = film.resolution
    sign = 1.0 if pose.flip else -1.0
    record["width"], record["height"] = width, height
    record["per_width"], record["per_height"] = sign / width, sign / height
    record["exposure"] = 1.0
    for name, value in own.items():
        record["own"][kind][name] = value
    return record


def turned(camera: CameraModel, pose: Pose) -> CameraModel:
    """Return the same camera in another pose, which it does not focus by."""
    setting = camera.setting
    if setting is not None and isinstance(pose, LensCamera):
        setting = replace(setting, camera=pose)
    return replace(camera, record=_posed(camera.record.copy(), pose), setting=setting)


def _posed(record: NDArray[np.void], pose: Pose) -> NDArray[np.void]:
    matrix = pose.world_from_camera()
    for index, name in enumerate(("right", "up", "back")):
        record[name][0, :3] = matrix[:3, index]
    return record


def entrance_pupil_view(first: FirstOrder, first_vertex_z_m: float, blur: Callable[[], Blur]) -> CameraView:
    """Return the view of a lens from its first-order data; a pupil at infinity has no coordinates.

    Parameters
    ----------
    first_vertex_z_m
        Where the first vertex lies on the axis of the camera's frame [m].
    """
    pupil = first.entrance_pupil
    return CameraView(first_vertex_z_m + pupil.distance_mm * 1e-3, pupil.diameter_mm / 2 * 1e-3, blur)


def half_tangents(
    fov_degrees: float, axis: Literal["horizontal", "vertical", "diagonal"], film: Film
) -> tuple[float, float]:
    """Return the tangents of half the field of view across and down the film."""
    width, height = film.size_m()
    side = {"horizontal": width, "vertical": height, "diagonal": math.hypot(width, height)}[axis]
    tangent = math.tan(math.radians(fov_degrees) / 2)
    return tangent * width / side, tangent * height / side
