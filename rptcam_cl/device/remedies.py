"""What to install where no OpenCL device can be used: it depends on the system."""

from __future__ import annotations

import platform
import sys


def to_install() -> str:
    """Return what brings an OpenCL device to this system."""
    on_x86 = platform.machine().lower() in ("x86_64", "amd64")
    if sys.platform.startswith("linux") and on_x86:
        return "install PoCL with \"pip install 'rptcam_cl[pocl]'\" or the OpenCL driver of your GPU"
    if sys.platform == "win32" and on_x86:
        return 'install Intel\'s OpenCL with "pip install rptcam_cl[pocl]" or the OpenCL driver of your GPU'
    if sys.platform == "darwin":
        return "macOS brings an OpenCL of its own; does it run in a sandbox or a virtual machine?"
    return "install PoCL from your distribution (Debian, Ubuntu: apt install pocl-opencl-icd) or the driver of your GPU"


def instead() -> str:
    """Return what to install in the place of drivers that are there and cannot compile."""
    if platform.machine().lower() not in ("x86_64", "amd64") or sys.platform == "darwin":
        return "install another OpenCL, as of your distribution or of your GPU"
    ways = ["Intel's OpenCL for any x86-64 processor with \"pip install 'rptcam_cl[intel]'\""]
    if sys.platform.startswith("linux"):
        ways.append("your distribution's PoCL (Debian, Ubuntu: apt install pocl-opencl-icd)")
    return f"install {', '.join(ways)} or the OpenCL driver of your GPU"
