"""The binding to OpenCL, loaded with what it needs to find its drivers and not to stumble over its caches."""

from __future__ import annotations

import os
import sys
from functools import lru_cache
from typing import Any

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.intel_runtime import show_intel_runtime
from rptcam_cl.device.pocl_cache import make_pocl_cache_usable
from rptcam_cl.device.remedies import to_install


@lru_cache(maxsize=1)
def load_opencl() -> Any:
    """Return the module ``pyopencl``.

    Before it loads, and so before the drivers do, the environment of this process is put right:

    - pyopencl's own caches are off. One is a database that stops everything when it cannot be written or is damaged,
      and saves nothing that can be measured; the other is replaced by `rptcam_cl.device.built_programs`.
    - PoCL's cache lies where it can be written, and holds no damaged files.
    - Intel's runtime is found where pip has put it.

    Raises
    ------
    DeviceError
        When it cannot be imported.
    """
    os.environ.setdefault("PYOPENCL_NO_CACHE", "1")
    if sys.platform.startswith("linux"):
        make_pocl_cache_usable()
        show_intel_runtime()
    try:
        import pyopencl
    except Exception as error:  # a missing library, or a cache of its own that a user has asked for
        raise DeviceError(f"pyopencl cannot be imported ({error}); {to_install()}") from error
    return pyopencl
