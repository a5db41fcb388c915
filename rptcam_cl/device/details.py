"""What a report on a device should say: driver, limits, and what is done for its compiler."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.choose import DeviceInfo, problem_of
from rptcam_cl.device.opencl import load_opencl
from rptcam_cl.device.trial import Trial, try_device


def device_details(info: DeviceInfo) -> dict[str, Any]:
    """Return everything about a device that its drivers tell and that matters here.

    ``problem`` is why it cannot be used, if so. ``renamed`` holds the processor's name by PoCL and the one that it
    got in its place (see `rptcam_cl.device.pocl_processor`). ``kernel_target`` is the processor that PoCL's kernels
    are compiled for, so that its built-ins can be inlined (see `rptcam_cl.device.program`); None where the compiler
    needs no such help. What a driver does not tell is None.
    """
    trial = Trial() if info.failure else try_device(info.handle)
    return {
        "id": info.id,
        "name": info.name,
        "type": info.type,
        "platform": info.platform,
        "platform_version": _reported(lambda: info.handle.platform.version.strip()),
        "driver_version": _reported(lambda: info.handle.driver_version.strip()),
        "opencl_c": _reported(lambda: info.handle.opencl_c_version.strip()),
        "compute_units": info.compute_units,
        "clock_mhz": _reported(lambda: int(info.handle.max_clock_frequency)),
        "memory_bytes": info.memory_bytes,
        "largest_buffer_bytes": _reported(lambda: int(info.handle.max_mem_alloc_size)),
        "fp64": info.fp64,
        "problem": problem_of(info),
        "kernel_target": trial.library_arch,
        "renamed": trial.renamed,
    }


def _reported(read: Callable[[], Any]) -> Any:
    try:
        return read()
    except Exception:  # a driver may raise anything; what is wrong with it is said in ``problem``
        return None


def opencl_version() -> str | None:
    """Return the version of the binding to OpenCL; None where it is not installed."""
    try:
        return str(load_opencl().VERSION_TEXT)
    except DeviceError:
        return None
