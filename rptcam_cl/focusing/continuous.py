"""Continuous autofocus (AF-C): how the focus goes from frame to frame after what is measured in each.

It stands still while what is measured lies within a band, waits before it goes to something else, goes at a limited
speed, and follows what moves until that has come to rest. So it neither pumps with the noise of the measurement nor
jumps to what crosses the picture.
"""

from __future__ import annotations

from dataclasses import replace

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.scene import ContinuousFocus

REST = 0.5  # of the band: as little does what has come to rest move


@dataclass(frozen=True)
class Following:
    """Where the focus of a frame stands.

    Attributes
    ----------
    place : float
        Coordinate of the focus state.
    moving : bool
        Whether it follows what is measured.
    waited_s : float
        Since when that is outside the band, or since when it rests while the focus moves [s].
    rest : float
        Where what is measured has rested since.
    """

    place: float
    moving: bool = False
    waited_s: float = 0.0
    rest: float = 0.0


def after(
    before: Following, measured: float | None, depth_of_focus: float, manner: ContinuousFocus, frame_s: float
) -> Following:
    """Return where the focus of the next frame stands.

    Parameters
    ----------
    measured
        Coordinate at which autofocus finds the frame sharp; None where it finds nothing, and the focus stays.
    depth_of_focus
        In units of the coordinate.
    frame_s
        From the frame before to this one [s].
    """
    if measured is None:
        return replace(before, moving=False, waited_s=0.0)
    band = manner.hold * depth_of_focus
    if not before.moving:
        if abs(measured - before.place) <= band:
            return replace(before, waited_s=0.0)
        if before.waited_s + frame_s <= manner.lock_s:
            return replace(before, waited_s=before.waited_s + frame_s)
        before = Following(before.place, moving=True, rest=measured)
    step = manner.speed * depth_of_focus * frame_s
    place = min(max(measured, before.place - step), before.place + step)
    if abs(measured - before.rest) > REST * band:
        return Following(place, moving=True, rest=measured)
    waited = before.waited_s + frame_s
    arrived = place == measured and waited > manner.lock_s
    return Following(place, not arrived, 0.0 if arrived else waited, before.rest)
