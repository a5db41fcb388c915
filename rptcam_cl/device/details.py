"""What a report on a device should say: driver, limits, and what is done for its compiler."""

from __future__ import annotations

from typing import Any

from rptcam_cl.device.choose import DeviceInfo
from rptcam_cl.device.trial import try_device


def device_details(info: DeviceInfo) -> dict[str, Any]:
    """Return everything about a device that its drivers tell and that matters here.

    ``problem`` is why no kernel can be built, if so. ``renamed`` holds the processor's name by PoCL and the one that it
    got in its place (see `rptcam_cl.device.pocl_processor`). ``kernel_target`` is the processor that PoCL's kernels are
    compiled for, so that its built-ins can be inlined (see `rptcam_cl.device.program`); None where the compiler needs
    no such help.
    """
    handle = info.handle
    trial = try_device(handle)
    return {
        "id": info.id,
        "name": info.name,
        "type": info.type,
        "platform": info.platform,
        "platform_version": handle.platform.version.strip(),
        "driver_version": handle.driver_version.strip(),
        "opencl_c": handle.opencl_c_version.strip(),
        "compute_units": info.compute_units,
        "clock_mhz": int(handle.max_clock_frequency),
        "memory_bytes": info.memory_bytes,
        "largest_buffer_bytes": int(handle.max_mem_alloc_size),
        "fp64": info.fp64,
        "problem": trial.problem,
        "kernel_target": trial.library_arch,
        "renamed": trial.renamed,
    }


def opencl_version() -> str | None:
    """Return the version of the binding to OpenCL; None where it is not installed."""
    try:
        import pyopencl
    except ImportError:
        return None
    return str(pyopencl.VERSION_TEXT)
