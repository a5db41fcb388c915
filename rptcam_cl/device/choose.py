"""Which OpenCL devices there are, and the one that a user means. Never asks."""

from __future__ import annotations

import difflib
import os
import re
from dataclasses import dataclass
from typing import Any

from rptcam_cl.device.listing import first_listed
from rptcam_cl.errors import DeviceError

REMEDY = "install PoCL with \"pip install 'rptcam_cl[pocl]'\" or the OpenCL driver of your GPU"


@dataclass(frozen=True)
class DeviceInfo:
    """One OpenCL device; ``id`` is ``platform:device`` as used by ``--device``."""

    id: str
    name: str
    platform: str
    type: str
    compute_units: int
    memory_bytes: int
    fp64: bool
    handle: Any


def _opencl() -> Any:
    try:
        import pyopencl
    except ImportError as error:
        raise DeviceError(f"pyopencl cannot be imported ({error}); {REMEDY}") from error
    return pyopencl


def list_devices() -> list[DeviceInfo]:
    """Return every OpenCL device of every platform, in the order of their ids.

    Raises
    ------
    DeviceError
        When there is no OpenCL platform at all.
    """
    cl = _opencl()
    try:
        platforms = cl.get_platforms()
    except cl.Error as error:
        raise DeviceError(f"no OpenCL platform was found ({error}); {REMEDY}") from error
    found = []
    for p, platform in enumerate(platforms):
        try:
            devices = platform.get_devices()
        except cl.Error:  # a platform without devices reports DEVICE_NOT_FOUND
            continue
        for d, device in enumerate(devices):
            found.append(_describe(cl, f"{p}:{d}", platform, device))
    if not found:
        raise DeviceError(f"no OpenCL device was found; {REMEDY}")
    return found


def _describe(cl: Any, identity: str, platform: Any, device: Any) -> DeviceInfo:
    return DeviceInfo(
        id=identity,
        name=device.name.strip(),
        platform=platform.name.strip(),
        type="gpu" if device.type & cl.device_type.GPU else "cpu",
        compute_units=int(device.max_compute_units),
        memory_bytes=int(device.global_mem_size),
        fp64="cl_khr_fp64" in device.extensions.split(),
        handle=device,
    )


def default_device(devices: list[DeviceInfo]) -> DeviceInfo:
    """Return the device that ``auto`` means: the GPU with most compute units, else the first CPU."""
    gpus = [device for device in devices if device.type == "gpu"]
    return max(gpus, key=lambda device: device.compute_units) if gpus else devices[0]


def choose_device(spec: str | None = None) -> DeviceInfo:
    """Return the device that ``spec`` names, else ``RPTCAM_DEVICE``, else ``PYOPENCL_CTX``, else ``auto``.

    Parameters
    ----------
    spec
        An index such as ``0:0``, a part of a device or platform name in any case, ``cpu``, ``gpu`` or ``auto``.

    Raises
    ------
    DeviceError
        When there is no device, or none that fits; the message lists those there are.
    """
    devices = list_devices()
    for source, value in (
        ("--device", spec),
        ("RPTCAM_DEVICE", first_listed(os.environ.get("RPTCAM_DEVICE"))),
        ("PYOPENCL_CTX", os.environ.get("PYOPENCL_CTX")),
    ):
        if value is not None and value.strip():
            return _match(devices, value.strip(), source)
    return default_device(devices)


def _match(devices: list[DeviceInfo], spec: str, source: str) -> DeviceInfo:
    wanted = spec.lower()
    if wanted == "auto":
        return default_device(devices)
    if wanted in ("cpu", "gpu"):
        fitting = [device for device in devices if device.type == wanted]
    elif re.fullmatch(r"\d+(:\d+)?", wanted):
        identity = wanted if ":" in wanted else f"{wanted}:0"
        fitting = [device for device in devices if device.id == identity]
    else:
        fitting = [device for device in devices if wanted in device.name.lower() or wanted in device.platform.lower()]
    if fitting:
        return default_device(fitting)
    names = [device.name for device in devices]
    near = difflib.get_close_matches(spec, [*names, "cpu", "gpu", "auto"], 1)
    hint = f" (did you mean {near[0]!r}?)" if near else ""
    listing = "; ".join(f"{device.id} {device.name} [{device.type}]" for device in devices)
    raise DeviceError(f"{source} {spec!r} fits no OpenCL device{hint}; there are: {listing}")
