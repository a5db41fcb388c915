"""OpenCL where Blender itself is linked with a loader of OpenCL, as Debian's is.

Calls of pyopencl then end in that loader, which knows the drivers of the system and not PoCL's wheel beside pyopencl.
So that driver is named to it, together with those of the system.
"""

from __future__ import annotations

import atexit
import ctypes
import importlib.util
import os
import shutil
import sys
import tempfile
from pathlib import Path

VARIABLES = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH", "OCL_ICD_FILENAMES")  # a user who sets one knows better
SYSTEM = Path("/etc/OpenCL/vendors")


def has_loader() -> bool:
    """Whether a loader of OpenCL is linked with this program."""
    return sys.platform.startswith("linux") and hasattr(ctypes.CDLL(None), "clGetPlatformIDs")


def name_drivers(system: Path = SYSTEM) -> Path | None:
    """Name PoCL's wheel to the program's own loader; the folder of drivers, None where there is nothing to do."""
    found = importlib.util.find_spec("pyopencl")
    if found is None or found.origin is None or any(os.environ.get(name) for name in VARIABLES) or not has_loader():
        return None
    libraries = sorted((Path(found.origin).parent / ".libs").glob("libpocl*.so*"))
    if not libraries:
        return None
    folder = Path(tempfile.mkdtemp(prefix="rptcam-drivers-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    for driver in system.glob("*.icd"):
        shutil.copyfile(driver, folder / driver.name)
    (folder / "pocl-of-the-extension.icd").write_text(f"{libraries[0]}\n", encoding="utf-8")
    os.environ["OCL_ICD_VENDORS"] = str(folder)
    return folder
