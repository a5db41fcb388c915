"""Two passes in front of `generate` that take the rays of a wave through the lens in float64.

The first chooses film point and aim in float32, as `generate` does; the second, compiled for double, traces.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rptcam_cl.cameras import CameraModel
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.records import WAVE, device_declarations
from rptcam_cl.device import Launch, Session

DOUBLE_LANES = 8  # per work item of a CPU
PACKETS = 2  # of lanes that a work item traces side by side
BYTES_PER_SLOT = 32  # see kernels/lens/float64.h


def traces_in_float64(camera: CameraModel) -> bool:
    """Return whether a camera's rays go through its lens in float64."""
    return camera.facts.get("LENS_FLOAT64", 0) > 0


def check_precision(session: Session, camera: CameraModel) -> None:
    """Refuse a camera that a device cannot trace.

    Raises
    ------
    DeviceError
        When its lens is to be traced in float64 and the device has none.
    """
    if traces_in_float64(camera) and not session.info.fp64:
        raise DeviceError(
            f"camera.precision: double needs float64, which device {session.info.id} {session.info.name} lacks"
            " (use single, or another device)"
        )


class PreciseLens:
    """The passes ``aim_rays`` and ``trace_lens`` with the rays between them.

    Parameters
    ----------
    session
        The device.
    camera
        Whose lens it is; its kernel and its facts are those of every later camera.
    facts
        Of the pass ``generate``, whose random numbers, film points and aims are used.
    capacity
        Slots of a wave.
    buffers
        Of the camera, as `rptcam_cl.rendering.buffers.camera_buffers` returns them.
    tiles, filter_table, colours : buffers
        As ``generate`` takes them.

    Raises
    ------
    DeviceError
        When the device has no float64.
    """

    def __init__(
        self,
        session: Session,
        camera: CameraModel,
        facts: dict[str, int | str],
        capacity: int,
        buffers: Mapping[str, Any],
        tiles: Any,
        filter_table: Any,
        colours: Any,
    ) -> None:
        check_precision(session, camera)
        self.rays = session.allocate(BYTES_PER_SLOT * capacity)
        self._aim_lanes = int(facts["VW"])
        lanes = DOUBLE_LANES if session.lanes > 1 else 1
        self._trace_lanes = PACKETS * lanes
        aiming = session.program(["pass/aim_rays.cl"], facts, device_declarations())
        tracing = session.program(
            ["pass/trace_lens.cl"], camera.facts | {"VW": lanes, "DOUBLE": 1}, device_declarations()
        )
        slots, empty = np.uint32(capacity), bytes(WAVE.dtype.itemsize)
        self._aim = session.bind(
            aiming, "aim_rays", **_of(buffers, "camera", "tables"), wave=empty, tiles=tiles, filter=filter_table,
            colours=colours, rays=self.rays, capacity=slots,
        )  # fmt: skip
        self._trace = session.bind(
            tracing, "trace_lens", **_of(buffers, "surfaces", "stop"), count=np.int32(len(camera.surfaces)),
            rays=self.rays, capacity=slots,
        )  # fmt: skip

    def use_camera(self, buffers: Mapping[str, Any]) -> None:
        """Trace for another camera: its record, tables, surfaces and stop on the device."""
        self._aim.set(**_of(buffers, "camera", "tables"))
        self._trace.set(**_of(buffers, "surfaces", "stop"))

    def enqueue(self, wave: bytes, slots: int, run: Callable[[Launch, int], None]) -> None:
        """Enqueue both passes over a wave; ``run`` takes a launch and the number of its work items."""
        self._aim.set(wave=wave)
        run(self._aim, slots // self._aim_lanes)
        run(self._trace, slots // self._trace_lanes)


def _of(buffers: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: buffers[name] for name in names}
