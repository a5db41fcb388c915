"""The lens of a camera in one state, as the panel shows it: focused, stopped down, shaped, with its tracers ready."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import LensSetting, disperses, lens_setting, stop_shape, usable_nm
from rptcam_cl.colour import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.device import Session
from rptcam_cl.lenstools import LensTracer
from rptcam_cl.optics import IDEAL, Lens, Rays
from rptcam_cl.scene import LensCamera, Scene

Array = NDArray[np.float64]

LINES_NM = (LINE_F_NM, LINE_D_NM, LINE_C_NM)  # blue, yellow, red


class KeptTracer:
    """Traces small bundles of rays through a lens on a device; the lens stays there between them.

    Parameters
    ----------
    lens, device
        What is traced, and where.
    start
        ``film`` or ``scene``.
    """

    def __init__(self, lens: Lens, device: Session, start: str) -> None:
        low, high = usable_nm(lens)
        self._lens, self._device, self._start = lens, device, start
        self._coloured = disperses(lens) and low <= min(LINES_NM) and max(LINES_NM) <= high
        self._tracers: dict[float, LensTracer] = {}

    def _tracer(self, wavelength_nm: float) -> LensTracer:
        """Return the tracer of a wavelength; of all where rays bring their own."""
        key = 0.0 if self._coloured else wavelength_nm
        if key not in self._tracers:
            self._tracers[key] = LensTracer(
                self._lens, self._device, wavelength_nm, self._start, "single", IDEAL, dispersive=self._coloured
            )
        return self._tracers[key]

    def trace(self, points: Array, vectors: Array, wavelengths_nm: Array) -> Rays:
        """Return rays (n, 3) with a wavelength each, behind the last surface."""
        return self.paths(points, vectors, wavelengths_nm, every=False)[1]

    def paths(self, points: Array, vectors: Array, wavelengths_nm: Array, *, every: bool = True) -> tuple[Array, Rays]:
        """Return where rays (n, 3) start and meet each surface (surfaces + 1, n, 3), and what becomes of them.

        Parameters
        ----------
        every
            False for their ends alone: the points are those of the start then.
        """
        count = len(points)
        found = Rays(
            np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.int32), np.empty(count, np.int32),
            np.empty(0),
        )  # fmt: skip
        corners = np.empty((len(self._lens.surfaces) + 1 if every else 1, count, 3))
        corners[0] = points
        for wavelength in [LINE_D_NM] if self._coloured else np.unique(wavelengths_nm).tolist():
            rows = np.arange(count) if self._coloured else np.flatnonzero(wavelengths_nm == wavelength)
            own = wavelengths_nm[rows] if self._coloured else None
            tracer = self._tracer(wavelength)
            if every:
                corners[:, rows], rays = tracer.paths(points[rows], vectors[rows], own)
                for name in ("origins", "directions", "status", "surface"):
                    getattr(found, name)[rows] = getattr(rays, name)
            else:
                _trace_rows(tracer, points, vectors, found, rows, own)
        return corners, found


def _trace_rows(
    tracer: LensTracer, points: Array, vectors: Array, found: Rays, rows: NDArray[np.intp], own: Array | None
) -> None:
    tracer.trace(points, vectors, found, slice(0, len(points)) if own is not None else rows, own)


@dataclass(frozen=True)
class LensState:
    """A lens in one state.

    Attributes
    ----------
    scene : Scene
    setting : LensSetting
    lens : Lens
        That of the setting, its stop in the shape of the camera's aperture.
    device : Session
    """

    scene: Scene
    setting: LensSetting
    lens: Lens
    device: Session

    @property
    def film_z(self) -> float:
        """Film plane in the frame of the lens [mm]."""
        return self.lens.film_z(self.setting.film_distance_mm)

    @property
    def object_mm(self) -> float:
        """Plane in focus to the first vertex [mm]; infinite where there is none or it is very far."""
        focus = self.setting.focus_distance_mm
        return np.inf if focus is None or focus > 1e9 or focus <= self.film_z else focus - self.film_z

    @property
    def size_mm(self) -> float:
        """The larger of the length and the diameter of the glass."""
        finite = [surface.semi_diameter for surface in self.lens.surfaces if np.isfinite(surface.semi_diameter)]
        return float(max(abs(self.lens.length), 2 * max(finite, default=0.0)))

    @cached_property
    def wavelengths_nm(self) -> tuple[float, ...]:
        """Wavelengths whose rays differ: one where the glass bends all of them alike."""
        return LINES_NM if disperses(self.lens) else (self.setting.camera.wavelength_nm,)

    @cached_property
    def from_film(self) -> KeptTracer:
        """What traces rays from the film."""
        return KeptTracer(self.lens, self.device, "film")

    @cached_property
    def from_scene(self) -> KeptTracer:
        """What traces rays from the scene."""
        return KeptTracer(self.lens, self.device, "scene")


def lens_state(scene: Scene, device: Session) -> LensState:
    """Return the lens of a scene in focus, whose camera has one."""
    setting, camera = lens_setting(scene), scene.camera
    assert isinstance(camera, LensCamera)
    shape = stop_shape(scene, camera.aperture) if hasattr(camera, "aperture") else None
    lens = setting.lens if shape is None or setting.lens.stop is None else setting.lens.with_stop_shape(shape)
    return LensState(scene, setting, lens, device)
