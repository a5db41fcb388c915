"""Intel's OpenCL for processors, as pip installs it, shown to the loader of OpenCL drivers.

Its ``.icd`` file, which should name the driver's library, names a path of the machine that built the wheel; and no
loader looks into an environment of Python. The libraries lie in the environment's ``lib``, where they find each other.
On Windows the wheels are found without help.

ocl-icd, the loader in pyopencl's wheels, takes one folder of ``.icd`` files, besides what pyopencl brings itself. So
the drivers of the system are named anew in a temporary folder, together with Intel's.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import shutil
import tempfile
from importlib import metadata
from pathlib import Path

PACKAGE = "intel-opencl-rt"
LIBRARY = "libintelocl.so"
VARIABLES = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH", "OCL_ICD_FILENAMES")  # a user who sets one knows better
SYSTEM = Path("/etc/OpenCL/vendors")


def show_intel_runtime() -> None:
    """Name a folder of drivers to the loader if pip has installed Intel's runtime and the user names no drivers."""
    if any(os.environ.get(name) for name in VARIABLES):
        return
    library = intel_library()
    if library is None:
        return
    with contextlib.suppress(OSError):
        folder = Path(tempfile.mkdtemp(prefix="rptcam_cl-drivers-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
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
