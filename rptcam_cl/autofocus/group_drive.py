"""Focus states of a lens with a group that focuses: the shift of the group."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from rptcam_cl.autofocus.lens_drive import LensDrive
from rptcam_cl.autofocus.probe import Zone
from rptcam_cl.cameras.lens_setting import lens_setting
from rptcam_cl.errors import InputError
from rptcam_cl.optics import Lens
from rptcam_cl.optics.focus import film_distance
from rptcam_cl.optics.variable import film_behind, focused_by_group, moved, shift_of

ROUNDS = 12  # of the secant search, which needs three
SETTLED = 1e-4  # of the depth of focus


class GroupDrive(LensDrive):
    """A lens with a group that focuses: the state is its shift towards the film [mm]."""

    @cached_property
    def _film_mm(self) -> float:
        return film_distance(self.lens, np.inf, wavelength_nm=self.own_camera.wavelength_nm)

    def lens_at(self, state: float) -> tuple[Lens, float]:
        """Return the lens with its group shifted, and the distance from its last vertex to the film [mm]."""
        return moved(self.lens, state), film_behind(self.lens, state, self._film_mm)

    def state_for(self, distance_m: float, zone: Zone) -> float:
        """Return the shift that makes a plane sharpest in a zone [mm]: a secant search from that of first-order optics.

        Raises
        ------
        InputError
            When the plane is out of the group's reach.
        """
        distance_mm, wavelength = distance_m * 1e3, self.own_camera.wavelength_nm
        start = shift_of(self.lens, focused_by_group(self.lens, distance_mm, self._film_mm, wavelength)[0])

        def miss(shift: float) -> float:
            lens, back_mm = self.lens_at(shift)
            return self.sharpest_film(lens, distance_mm, zone) - back_mm

        before, shift = start, start + self.depth_of_focus
        missed_before, missed = miss(before), miss(shift)
        for _ in range(ROUNDS):
            if missed == missed_before or abs(missed) < SETTLED * self.sharp_mm:
                break
            before, shift = shift, shift - missed * (shift - before) / (missed - missed_before)
            missed_before, missed = missed, miss(shift)
        within = float(np.clip(shift, *self.limits))
        if abs(shift - within) > self.depth_of_focus:
            end = self.object_distance(within, zone)
            words = "" if end is None else f"; the end of its travel is sharp at {end * 1e3:.6g} mm"
            raise InputError(f"{self.lens.name}: its group cannot focus at {distance_mm:.6g} mm from the film{words}")
        return within

    @cached_property
    def limits(self) -> tuple[float, float]:  # type: ignore[override]
        """The travel of the group."""
        assert self.lens.focusing is not None
        return self.lens.focusing.travel_mm

    @cached_property
    def depth_of_focus(self) -> float:  # type: ignore[override]
        """2 N c over how far the image of infinity moves, per shift, against the film [mm]."""
        low, high = self.limits
        ends = [self._image_behind_film(state) for state in (low, high)]
        return self.sharp_mm * (high - low) / abs(ends[1] - ends[0])

    @cached_property
    def nearer(self) -> int:  # type: ignore[override]
        """The sense in which the image of infinity moves towards the lens."""
        low, high = (self._image_behind_film(state) for state in self.limits)
        return 1 if high < low else -1

    def _image_behind_film(self, state: float) -> float:
        lens, back = self.lens_at(state)
        return lens.first_order(self.own_camera.wavelength_nm).back_focal_distance_mm - back

    @cached_property
    def start(self) -> float:  # type: ignore[override]
        """Where the scene has it, or as in the lens file where autofocus is to find it."""
        if self.own_camera.focus.auto is not None:
            return 0.0
        return shift_of(self.lens, lens_setting(self.scene).lens)

    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""
        return {"focus": {"group_shift_mm": state}}
