"""The lens panel: cross-section, numbers, rays from the pixel under the pointer; what a lens state needs is kept."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Session
from rptcam_cl.scene import EnvironmentCamera, LensCamera, RealisticCamera, Scene
from rptcam_cl.viewfinder.lens_numbers import camera_numbers, image_circle_mm, lens_numbers
from rptcam_cl.viewfinder.lens_rays import ideal_rays, pointer_rays, thick_rays
from rptcam_cl.viewfinder.lens_section import ideal_section, lens_section
from rptcam_cl.viewfinder.lens_state import LensState, lens_state
from rptcam_cl.viewfinder.remembered import optics_key

KEPT = 8  # lens states


class LensPanel:
    """What the viewfinder shows of the lens.

    Parameters
    ----------
    device
        What traces the rays; used by one thread at a time.
    """

    def __init__(self, device: Session) -> None:
        self._device = device
        self._states: OrderedDict[Hashable, LensState] = OrderedDict()
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()

    def section(self, resolved: Scene) -> dict[str, Any]:
        """Return the lines of the cross-section [mm]: surfaces, glass, stop, film, pupils; fewer for ideal cameras."""
        if not isinstance(resolved.camera, LensCamera):
            return ideal_section(resolved)
        found: dict[str, Any] = self._once("section", resolved, lambda: lens_section(self._state(resolved)))
        return found

    def numbers(self, resolved: Scene) -> dict[str, Any]:
        """Return the numbers of the camera in its state; None where there is no such number."""
        found: dict[str, Any] = self._once("numbers", resolved, lambda: self._numbers(resolved))
        return found

    def _numbers(self, resolved: Scene) -> dict[str, Any]:
        if isinstance(resolved.camera, LensCamera):
            return lens_numbers(self._state(resolved))
        pupils = dict.fromkeys(("entrance_pupil", "exit_pupil"))
        return camera_numbers(resolved) | pupils

    def pointer(self, resolved: Scene, x: float, y: float) -> dict[str, Any]:
        """Return rays, spot and transfer of a point of the picture, in fractions from its left and top.

        Raises
        ------
        InputError
            The point lies outside the picture.
        """
        if not (0 <= x <= 1 and 0 <= y <= 1):
            raise InputError(f"pointer: lies outside the picture (got {x:g}, {y:g}; allowed: 0 to 1)")
        if isinstance(resolved.camera, RealisticCamera):
            return pointer_rays(self._state(resolved), x, y)
        if isinstance(resolved.camera, LensCamera):
            return thick_rays(self._state(resolved), x, y)
        return ideal_rays(resolved, x, y)

    def guides(self, resolved: Scene) -> dict[str, Any]:
        """Return the image circle as an ellipse in fractions of the picture; None where it does not limit the film."""
        radius = None
        if isinstance(resolved.camera, RealisticCamera):
            radius = self._once("circle", resolved, lambda: image_circle_mm(self._state(resolved)))
        if radius is None or isinstance(resolved.camera, EnvironmentCamera):
            return {"image_circle": None}
        width_mm, height_mm = (side * 1e3 for side in resolved.film.size_m())
        return {"image_circle": {"x": 0.5, "y": 0.5, "rx": radius / width_mm, "ry": radius / height_mm}}

    def _state(self, resolved: Scene) -> LensState:
        key = optics_key(resolved)
        if key not in self._states:
            self._states[key] = lens_state(resolved, self._device)
            if len(self._states) > KEPT:
                self._states.popitem(last=False)
        self._states.move_to_end(key)
        return self._states[key]

    def _once(self, what: str, resolved: Scene, find: Any) -> Any:
        """Return what was found for this lens state, or find it."""
        key = (what, optics_key(resolved))
        if key not in self._kept:
            self._kept[key] = find()
            if len(self._kept) > 4 * KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]
