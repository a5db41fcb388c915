"""The devices that a user chooses by a word, a list as ``0:0,1:0`` or the environment. There is no prompt."""

from __future__ import annotations

import difflib
import os
import re

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.devices import DeviceInfo, list_devices, problem_of, speed_of
from rptcam_cl.device.opencl import instead

KINDS = ("cpu", "gpu")
ALL = "all"
_REMEDY = {
    "gpu": "install the OpenCL driver of your GPU, or leave the option out to render on what there is",
    "cpu": 'pip install "rptcam_cl[pocl]" brings one for the processor',
}
_INDEX = re.compile(r"\d+(:\d+)?")


def default_device(devices: list[DeviceInfo]) -> DeviceInfo:
    """Return the device that ``auto`` means, of those that build a trivial kernel.

    That is the GPU that its trial found to be the fastest, else PoCL's processor, which is the fastest way to run on
    one, else the first one. Units do not tell how fast GPUs are: those of one maker do ten times the work of another's.
    No more devices are tried than it takes.

    Raises
    ------
    DeviceError
        When none builds; the message has the reason of each.
    """
    several = sum(device.type == "gpu" for device in devices) > 1
    ordered = sorted(devices, key=lambda device: _rank(device, several))
    chosen = next((device for device in ordered if problem_of(device) is None), None)
    if chosen is None:
        reasons = "; ".join(f"{device.id} {device.name}: {problem_of(device)}" for device in devices)
        raise DeviceError(f"no OpenCL device can be used ({reasons}); {instead()}")
    return chosen


def _rank(device: DeviceInfo, several: bool) -> tuple[int, float]:
    if device.type == "gpu":
        return 0, -speed_of(device) if several else 0.0
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
    elif _INDEX.fullmatch(wanted):
        identity = wanted if ":" in wanted else f"{wanted}:0"
        fitting = [device for device in devices if device.id == identity]
    else:
        fitting = [device for device in devices if wanted in device.name.lower() or wanted in device.platform.lower()]
    if fitting:
        return fitting
    if wanted in KINDS:
        raise DeviceError(
            f"{source} {spec!r}: this machine has no {wanted.upper()} that OpenCL finds; "
            f"there are: {_listing(devices)}; {_REMEDY[wanted]}"
        )
    near = difflib.get_close_matches(spec, [*(device.name for device in devices), *KINDS, "auto"], 1)
    hint = f" (did you mean {near[0]!r}?)" if near and near[0] != wanted else ""
    raise DeviceError(f"{source} {spec!r} fits no OpenCL device{hint}; there are: {_listing(devices)}")


def _listing(devices: list[DeviceInfo]) -> str:
    return "; ".join(f"{device.id} {device.name} [{device.type}]" for device in devices)


def listed(spec: str) -> list[str]:
    """Return the devices that ``spec`` lists: indices with commas between them, else the one that it is."""
    words = [word.strip() for word in spec.split(",")]
    return words if all(_INDEX.fullmatch(word) for word in words) else [spec.strip()]


def several_of_environment() -> list[str] | None:
    """Return the devices that ``RPTCAM_DEVICE`` lists, where they are several or "all"; else None."""
    words = listed(os.environ.get("RPTCAM_DEVICE", ""))
    return words if len(words) > 1 or words == [ALL] else None


def first_listed(spec: str | None) -> str | None:
    """Return the device that a command takes that takes one: the first of a list, the best of all."""
    if spec is None:
        return None
    first = listed(spec)[0]
    return "auto" if first.lower() == ALL else first
