"""Which OpenCL devices there are, and the one that a user means. Never asks."""

from __future__ import annotations

import difflib
import os
import re
from dataclasses import dataclass
from typing import Any

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.listing import first_listed
from rptcam_cl.device.opencl import load_opencl
from rptcam_cl.device.remedies import instead, to_install
from rptcam_cl.device.trial import first_error, try_device

KINDS = ("cpu", "gpu")


@dataclass(frozen=True)
class DeviceInfo:
    """One OpenCL device; ``id`` is ``platform:device`` as used by ``--device``.

    ``failure`` is what its driver failed with when it was asked about the device; what is known then is little, and
    ``handle`` is None where there is nothing but a driver.
    """

    id: str
    name: str
    platform: str
    type: str
    compute_units: int
    memory_bytes: int
    fp64: bool
    handle: Any
    failure: str | None = None


def problem_of(device: DeviceInfo) -> str | None:
    """Return in a line why a device cannot be used, None where it builds a trivial kernel. Tried once per process."""
    if device.failure is not None:
        return device.failure
    problem = try_device(device.handle).problem
    return None if problem is None else f"it builds no kernel: {first_error(problem)}"


def list_devices() -> list[DeviceInfo]:
    """Return every OpenCL device of every platform, in the order of their ids; drivers that fail are among them.

    Raises
    ------
    DeviceError
        When there is no OpenCL platform at all.
    """
    cl = load_opencl()
    try:
        platforms = cl.get_platforms()
    except Exception as error:
        raise DeviceError(f"no OpenCL platform was found ({error}); {to_install()}") from error
    found = []
    for p, platform in enumerate(platforms):
        found += _devices_of(cl, p, platform)
    if not found:
        raise DeviceError(f"no OpenCL device was found; {to_install()}")
    return found


def _devices_of(cl: Any, index: int, platform: Any) -> list[DeviceInfo]:
    """Return the devices of a platform, or one without a handle that says how its driver failed."""
    try:
        devices = platform.get_devices()
    except Exception as error:  # whatever a driver does, the others can be used
        if "DEVICE_NOT_FOUND" in str(error):  # how a platform without devices says so
            return []
        return [_unknown(f"{index}:0", platform, None, f"its driver lists no devices: {error}")]
    return [_described(cl, f"{index}:{d}", platform, device) for d, device in enumerate(devices)]


def _described(cl: Any, identity: str, platform: Any, device: Any) -> DeviceInfo:
    try:
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
    except Exception as error:
        return _unknown(identity, platform, device, f"its driver does not describe it: {error}")


def _unknown(identity: str, platform: Any, handle: Any, failure: str) -> DeviceInfo:
    try:
        name = str(platform.name).strip()
    except Exception:
        name = "unknown platform"
    return DeviceInfo(identity, "unknown device", name, "cpu", 0, 0, False, handle, " ".join(failure.split()))


def default_device(devices: list[DeviceInfo]) -> DeviceInfo:
    """Return the device that ``auto`` means, of those that build a trivial kernel.

    That is the GPU with most compute units, else PoCL's processor, which is the fastest way to run on one, else the
    first one. No more devices are tried than it takes.

    Raises
    ------
    DeviceError
        When none builds; the message has the reason of each.
    """
    ordered = sorted(devices, key=_rank)
    chosen = next((device for device in ordered if problem_of(device) is None), None)
    if chosen is None:
        reasons = "; ".join(f"{device.id} {device.name}: {problem_of(device)}" for device in devices)
        raise DeviceError(f"no OpenCL device can be used ({reasons}); {instead()}")
    return chosen


def _rank(device: DeviceInfo) -> tuple[int, int]:
    if device.type == "gpu":
        return 0, -device.compute_units
    return (1 if "portable computing language" in device.platform.lower() else 2), 0


def choose_device(spec: str | None = None) -> DeviceInfo:
    """Return the device that ``spec`` names, else ``RPTCAM_DEVICE``, else ``PYOPENCL_CTX``, else ``auto``.

    Parameters
    ----------
    spec
        An index such as ``0:0``, a part of a device or platform name in any case, ``cpu``, ``gpu`` or ``auto``. Where
        it fits several devices, `default_device` of those is meant.

    Raises
    ------
    DeviceError
        When there is no device, or none that fits, or none of those that fit can be used; the message lists those
        there are, or the reasons.
    """
    devices = list_devices()
    fitting, source = fitting_devices(devices, spec)
    if source is None:
        return default_device(fitting)
    try:
        return default_device(fitting)
    except DeviceError as error:
        others = [device for device in devices if device not in fitting and problem_of(device) is None]
        hint = f"; these can: {_listing(others)}" if others else ""
        raise DeviceError(f"{source}: {error}{hint}") from None


def fitting_devices(devices: list[DeviceInfo], spec: str | None = None) -> tuple[list[DeviceInfo], str | None]:
    """Return which of ``devices`` a ``spec`` of `choose_device` fits, usable or not, and in words where it was given.

    Raises
    ------
    DeviceError
        When it fits none; the message lists ``devices``.
    """
    for source, value in (
        ("--device", spec),
        ("RPTCAM_DEVICE", first_listed(os.environ.get("RPTCAM_DEVICE"))),
        ("PYOPENCL_CTX", os.environ.get("PYOPENCL_CTX")),
    ):
        if value is not None and value.strip():
            return _match(devices, value.strip(), source), f"{source} {value.strip()!r}"
    return devices, None


def _match(devices: list[DeviceInfo], spec: str, source: str) -> list[DeviceInfo]:
    wanted = spec.lower()
    if wanted == "auto":
        return devices
    if wanted in KINDS:
        fitting = [device for device in devices if device.type == wanted]
    elif re.fullmatch(r"\d+(:\d+)?", wanted):
        identity = wanted if ":" in wanted else f"{wanted}:0"
        fitting = [device for device in devices if device.id == identity]
    else:
        fitting = [device for device in devices if wanted in device.name.lower() or wanted in device.platform.lower()]
    if fitting:
        return fitting
    near = difflib.get_close_matches(spec, [*(device.name for device in devices), *KINDS, "auto"], 1)
    hint = f" (did you mean {near[0]!r}?)" if near and near[0] != wanted else ""
    raise DeviceError(f"{source} {spec!r} fits no OpenCL device{hint}; there are: {_listing(devices)}")


def _listing(devices: list[DeviceInfo]) -> str:
    return "; ".join(f"{device.id} {device.name} [{device.type}]" for device in devices)
