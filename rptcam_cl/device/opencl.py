"""OpenCL on this system: the binding, the drivers that it must be shown, and what to install where none can be used.

Intel's OpenCL for processors, as pip installs it, has to be shown to the loader of OpenCL drivers. Its ``.icd`` file,
which should name the driver's library, names a path of the machine that built the wheel; and no loader looks into an
environment of Python. The libraries lie in the environment's ``lib``, where they find each other. On Windows the wheels
are found without help.

ocl-icd, the loader in pyopencl's wheels, takes one folder of ``.icd`` files, besides what pyopencl brings itself. So
the drivers of the system are named anew in a temporary folder, together with Intel's.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import platform
import shutil
import sys
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

from rptcam_cl.core.atomic import scratch_folder
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.pocl_cache import make_pocl_cache_usable

PACKAGE = "intel-opencl-rt"
LIBRARY = "libintelocl.so"
VARIABLES = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH", "OCL_ICD_FILENAMES")  # a user who sets one knows better
SYSTEM = Path("/etc/OpenCL/vendors")
# PoCL 7 cuts a kernel at its loops into regions, as if there were barriers, and reads memory anew in a later region
# where it needs a value of an earlier one: also where that memory has been written in between, so that camera rays were
# garbage. PoCL mends the second by "WorkitemLoops: do not rematerialize mutable loads" (July 2026, not in 7.2-RC1).
# Without the first, kernels without barriers are one region, and compile in three quarters of the time.
AS_BEFORE_POCL_7 = ("POCL_FORCE_PARALLEL_OUTER_LOOP", "POCL_PREGION_VALUE_REMAT")


@lru_cache(maxsize=1)
def load_opencl() -> Any:
    """Return the module ``pyopencl``.

    Before it loads, and so before the drivers do, the environment of this process is put right:

    - pyopencl's own caches are off. One is a database that stops everything when it cannot be written or is damaged,
      and saves nothing that can be measured; the other is replaced by `rptcam_cl.device.program`.
    - PoCL's cache lies where it can be written, and holds no damaged files.
    - PoCL 7 compiles kernels without barriers as its earlier versions do, see `AS_BEFORE_POCL_7`.
    - Intel's runtime is found where pip has put it.

    Raises
    ------
    DeviceError
        When it cannot be imported.
    """
    os.environ.setdefault("PYOPENCL_NO_CACHE", "1")
    for name in AS_BEFORE_POCL_7:
        os.environ.setdefault(name, "0")
    if sys.platform.startswith("linux"):
        make_pocl_cache_usable()
        show_intel_runtime()
    try:
        import pyopencl
    except Exception as error:  # a missing library, or a cache folder that a user has set
        raise DeviceError(f"pyopencl cannot be imported ({error}); {to_install()}") from error
    return pyopencl


def show_intel_runtime() -> None:
    """Name a folder of drivers to the loader if pip has installed Intel's runtime and the user names no drivers."""
    if any(os.environ.get(name) for name in VARIABLES):
        return
    library = intel_library()
    if library is None:
        return
    with contextlib.suppress(OSError):
        place = scratch_folder()
        atexit.register(place.cleanup)
        folder = Path(place.name)
        for driver in sorted(SYSTEM.glob("*.icd")):
            if LIBRARY not in driver.read_text(errors="replace"):  # the same driver, installed twice
                shutil.copyfile(driver, folder / driver.name)
        (folder / "intel-from-pip.icd").write_text(f"{library}\n")
        os.environ["OCL_ICD_VENDORS"] = str(folder)


def intel_library() -> Path | None:
    """Return the library of Intel's runtime in this environment of Python; None where it is not installed."""
    try:
        files = metadata.files(PACKAGE) or []
    except metadata.PackageNotFoundError:
        return None
    paths = (Path(str(file.locate())) for file in files if file.name == LIBRARY)
    return next((path.resolve() for path in paths if path.is_file()), None)


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
