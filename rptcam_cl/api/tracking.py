"""Focus and exposure that follow from all frames before: each frame is measured alone, and a policy goes over them.

What is measured in a frame does not depend on other frames, so that it is kept on disk: a frame that is rendered alone,
anywhere, has the focus and exposure that it has in its sequence, and finds what another run has measured already.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from rptcam_cl._version import __version__
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.kept import identity_of_code, keep_bytes, kept_bytes, name_of
from rptcam_cl.core.resources import kernels_dir
from rptcam_cl.device import Session
from rptcam_cl.rendering import resolve_exposure
from rptcam_cl.scene import Scene, at_rest, change_scene, set_keys

KIND = "frames"
ROOMS = ("core", "colour", "device", "assets", "scene", "optics", "cameras", "plan", "rendering", "focusing", "api")


def needs_tracking(scene: Scene) -> bool:
    """Return whether focus or exposure of a frame follow from the frames before."""
    return scene.sequence is not None and (
        scene.sequence.continuous_focus is not None or scene.sequence.exposure_time_constant_s is not None
    )


class FrameTracker:
    """The frames of a sequence with their focus and exposure, from the first one on.

    Parameters
    ----------
    scene
        With a sequence that `needs_tracking`.
    open_session
        Returns the device; called where something is to be measured, or was by its driver and is kept.

    Attributes
    ----------
    measured : int
        Frames that were measured here.
    """

    def __init__(self, scene: Scene, open_session: Callable[[], Session]) -> None:
        assert scene.sequence is not None, "of a scene with frames"
        self._scene, self._sequence, self._open = scene, scene.sequence, open_session
        self._session: Session | None = None
        self._number = 0
        self._frame: tuple[Scene, dict[str, Any]] | None = None
        self._following: Any = None
        self._lens: Any = None
        self._reading: float | None = None
        self.measured = 0

    def frame(self, number: int) -> tuple[Scene, dict[str, Any]]:
        """Return the scene of a frame in focus and exposed, and metadata of how it came about.

        Raises
        ------
        InputError
            When the first frame has nothing to focus on, or a frame no light to meter.
        """
        if number < self._number:
            self._number, self._following, self._reading = 0, None, None
        while self._number < number or self._frame is None:
            self._number += 1
            self._frame = self._next(self._number)
        return self._frame

    def _next(self, number: int) -> tuple[Scene, dict[str, Any]]:
        still = set_keys(self._scene, self._sequence.changes(self._scene.shutter.open_s, number))
        metadata: dict[str, Any] = {}
        try:
            if self._sequence.continuous_focus is not None and at_rest(still).requested_autofocus is not None:
                still, metadata = self._focused(still)
            if self._sequence.exposure_time_constant_s is not None and _is_metered(still):
                still = self._exposed(still, self._sequence.exposure_time_constant_s)
        except InputError as problem:
            raise type(problem)(f"frame {number}: {problem}") from None
        return still, metadata

    def _focused(self, still: Scene) -> tuple[Scene, dict[str, Any]]:
        from rptcam_cl.focusing import Following, after, focus_drive  # few scenes have it

        manner, frame_s = self._sequence.continuous_focus, 1 / self._sequence.frames_per_second
        assert manner is not None
        scene = at_rest(still)
        state = self._kept("focus", scene, lambda session: _state_of(scene, session))
        drive = focus_drive(scene)
        measured = None if state is None else drive.coordinate(state)
        lens = _lens_of(scene)
        if self._following is None or (lens != self._lens and measured is not None):
            if measured is None:
                raise InputError("camera.focus.auto: nothing to focus on in the first frame")
            self._following = Following(measured)
        else:
            self._following = after(self._following, measured, drive.depth_of_focus, manner, frame_s)
        self._lens = lens
        found = state if measured is not None and self._following.place == measured else None
        where = drive.state_at(self._following.place) if found is None else found
        metadata = {"state": where, "measured": state, "moving": self._following.moving}
        return change_scene(still, camera=drive.camera_keys(where)), {"continuous_focus": metadata}

    def _exposed(self, still: Scene, time_constant_s: float) -> Scene:
        read = self._kept("meter", still, lambda session: _reading_of(still, session))
        assert read is not None, "auto exposure is metered"
        if self._reading is None:
            self._reading = read
        else:
            share = -math.expm1(-1 / (self._sequence.frames_per_second * time_constant_s))
            self._reading *= (read / self._reading) ** share
        return set_keys(still, {"exposure.lock_cd_m2": self._reading})

    def _kept(self, what: str, scene: Scene, measure: Callable[[Session], float | None]) -> float | None:
        """Return what was measured in a frame, here or by an earlier run."""
        if self._session is None:
            self._session = self._open()
        name = name_of(__version__, _code(), self._session.info.driver, what, scene.content_hash())
        if (known := kept_bytes(KIND, name)) is not None:
            try:
                value = json.loads(known)
                return None if value is None else float(value)
            except (ValueError, TypeError):
                pass
        found = measure(self._session)
        self.measured += 1
        keep_bytes(KIND, name, json.dumps(found).encode())
        return found


@lru_cache(maxsize=1)
def _code() -> str:
    """Return what changes with the code that measures."""
    return identity_of_code(ROOMS, tuple(sorted(path.name for path in kernels_dir().iterdir())))


def _is_metered(scene: Scene) -> bool:
    return scene.exposure.mode == "auto" and scene.exposure.lock_cd_m2 is None


def _reading_of(scene: Scene, session: Session) -> float | None:
    """Return what the meter reads; a scene that focuses for itself is metered in focus."""
    if at_rest(scene).requested_autofocus is not None:
        from rptcam_cl.focusing import in_focus

        scene = in_focus(at_rest(scene), session)[0]
    return resolve_exposure(scene, session).metered_cd_m2


def _state_of(scene: Scene, session: Session) -> float | None:
    """Return the focus state that autofocus finds; None where it finds none."""
    from rptcam_cl.focusing import NoContrast, OutOfReach, find_focus

    settings = scene.requested_autofocus
    assert settings is not None, "of a scene with autofocus"
    try:
        return find_focus(scene, session, settings).state
    except (NoContrast, OutOfReach):
        return None


def _lens_of(scene: Scene) -> tuple[Any, ...]:
    """Return what says which coordinate a focus has: another lens or another zoom has others."""
    camera = scene.camera
    return tuple(getattr(camera, name, None) for name in ("kind", "lens", "zoom", "focal_length_mm", "fov_degrees"))
