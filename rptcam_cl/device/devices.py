"""The OpenCL devices there are, and what their drivers say of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.opencl import instead, load_opencl, to_install
from rptcam_cl.device.trial import Trial, first_error, keep_refusal, refusal, try_device


@dataclass(frozen=True)
class DeviceInfo:
    """One OpenCL device; ``id`` is ``platform:device`` as used by ``--device``.

    ``failure`` is the error of its driver when it was queried. Most other members are then unknown, and ``handle`` is
    None where there is only a driver. ``driver`` is what tells versions of it apart.
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
    driver: str = ""


def problem_of(device: DeviceInfo) -> str | None:
    """Return in a line why a device cannot be used, None where it builds a trivial kernel. Tried once per process.

    One that `refuse` has refused for its pictures cannot be used before its driver is another one.
    """
    if device.failure is not None:
        return device.failure
    problem = try_device(device.handle).problem
    return refusal(device.handle) if problem is None else f"it builds no kernel: {first_error(problem)}"


def speed_of(device: DeviceInfo) -> float:
    """Return how fast a GPU is, see `Trial`; nothing of one that cannot be used."""
    return 0.0 if problem_of(device) is not None else try_device(device.handle).speed or 0.0


def refuse(device: DeviceInfo, why: str) -> str:
    """Have a device not be used from now on, in other processes too; return what an error says of it."""
    keep_refusal(device.handle, why)
    return f"device {device.id} {device.name} cannot be used: {why}; {instead()}"


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
            driver=" ".join(f"{platform.version} {device.driver_version}".split()),
        )
    except Exception as error:
        return _unknown(identity, platform, device, f"its driver does not describe it: {error}")


def _unknown(identity: str, platform: Any, handle: Any, failure: str) -> DeviceInfo:
    try:
        name = str(platform.name).strip()
    except Exception:
        name = "unknown platform"
    return DeviceInfo(identity, "unknown device", name, "cpu", 0, 0, False, handle, " ".join(failure.split()))


def device_details(info: DeviceInfo) -> dict[str, Any]:
    """Return everything about a device that its drivers report and that matters here.

    ``problem`` is why it cannot be used, if so. ``renamed`` holds the processor's name by PoCL and the one that it
    got in its place (see `rptcam_cl.device.pocl_processor`). ``kernel_target`` is the processor that PoCL's kernels
    are compiled for, so that its built-ins can be inlined (see `rptcam_cl.device.program`); None where the compiler
    needs no such help. What a driver does not report is None.
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
