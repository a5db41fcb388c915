"""What a render runs on: versions, devices with their drivers, caches, and settings from the environment."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

from rptcam_cl._version import __version__
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device import (
    default_device,
    device_details,
    fitting_devices,
    list_devices,
    opencl_version,
    pocl_cache_folder,
)
from rptcam_cl.rendering import cache_folder

PACKAGES = (
    "numpy",
    "pyopencl",
    "pocl-binary-distribution",
    "pydantic",
    "OpenEXR",
    "pillow",
    "tifffile",
    "pyoidn",
    "matplotlib",
)
PREFIXES = ("RPTCAM_", "PYOPENCL_CTX", "POCL_", "OCL_ICD_", "CUDA_VISIBLE")


def environment(device: str | None = None) -> dict[str, Any]:
    """Return what there is, as plain data; ``no_device`` says why no device can be used, if so.

    Parameters
    ----------
    device
        The devices to report, as ``--device`` on the command line; all of them when absent.
    """
    found: dict[str, Any] = {
        "version": __version__,
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": _processor(),
        "processors": os.cpu_count(),
        "packages": {name: _version(name) for name in PACKAGES},
        "pyopencl": opencl_version(),
        "variables": {name: value for name, value in sorted(os.environ.items()) if name.startswith(PREFIXES)},
        "caches": {"trees": _folder(cache_folder()), "kernels": _folder(pocl_cache_folder())},
        "devices": [],
    }
    try:
        devices = list_devices()
    except DeviceError as problem:
        return found | {"no_device": str(problem)}
    shown = devices if device is None else fitting_devices(devices, device)[0]
    try:
        default = default_device(devices).id
    except DeviceError as problem:
        default = None
        found["no_device"] = str(problem)
    found["devices"] = [device_details(each) | {"default": each.id == default} for each in shown]
    return found


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _processor() -> str:
    """Return the name of the processor, as far as the system tells."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _folder(path: Path) -> dict[str, Any]:
    """Return where a cache is, how large it is, and whether anything can be kept there."""
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) if path.is_dir() else 0
    place = next((folder for folder in (path, *path.parents) if folder.is_dir()), path)
    home = os.path.expanduser("~")  # noqa: PTH111 -- Path.home() raises where there is none
    shown = str(path).replace(home, "~", 1) if home != "~" else str(path)
    return {"folder": shown, "bytes": size, "writable": os.access(place, os.W_OK)}


def as_lines(found: dict[str, Any]) -> list[str]:
    """Return the lines of a report on what `environment` found."""
    packages = ", ".join(f"{name} {version}" for name, version in found["packages"].items() if version)
    lines = [
        f"rptcam_cl {found['version']}, Python {found['python']} on {found['system']}",
        f"{found['processor']}, {found['processors']} logical processors",
        packages,
    ]
    lines += [f"{name}={value}" for name, value in found["variables"].items()]
    for name, cache in found["caches"].items():
        barred = "" if cache["writable"] else ", NOT WRITABLE"
        lines.append(f"cache of {name}: {cache['folder']} ({cache['bytes'] / 2**20:.1f} MiB{barred})")
    for device in found["devices"]:
        lines += _device_lines(device)
    return lines + ([f"no device: {found['no_device']}"] if "no_device" in found else [])


def _device_lines(device: dict[str, Any]) -> list[str]:
    head = f"{'*' if device['default'] else ' '} {device['id']} {device['type']}  {device['name']}"
    barred = [f"    CANNOT BE USED: {device['problem']}"] if device["problem"] else []
    if device["largest_buffer_bytes"] is None:
        return [head, f"    {device['platform']}", *barred]
    target = device["kernel_target"]
    precision = "fp64" if device["fp64"] else "fp32 only"
    memory, largest = (device[name] / 2**30 for name in ("memory_bytes", "largest_buffer_bytes"))
    return [
        head,
        f"    {device['platform']}: {device['platform_version']}; driver {device['driver_version']}",
        f"    {device['compute_units']} compute units at {device['clock_mhz']} MHz, {memory:.2f} GiB,"
        f" buffers to {largest:.2f} GiB, {precision}" + (f"; kernels compiled for {target}" if target else ""),
        *([_renaming(*device["renamed"])] if device["renamed"] else []),
        *barred,
    ]


def _renaming(old: str, new: str) -> str:
    return f"    PoCL takes the processor for {old!r}, for which it cannot compile; it compiles for {new!r}"
