"""The worker that renders with Mitsuba 3, variant ``llvm_ad_rgb``; its Python needs nothing else.

Requests: ``load`` a description made by `benchmarks.mitsuba_scene`, ``render`` samples of it and perhaps save them;
``count`` the samples that a sampler makes of a number of them. With ``avx2`` it compiles as for no AVX-512.
"""

from __future__ import annotations

import ctypes
import os
import re
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from benchmarks.mitsuba_lens import register
from benchmarks.stopwatch import timed_picture
from benchmarks.worker import WorkerError, serve

VARIANT = "llvm_ad_rgb"
REMEDY = "Debian and Ubuntu: apt install libllvm19; elsewhere name the library in DRJIT_LIBLLVM_PATH"


def find_llvm() -> str | None:
    """Return the newest LLVM library in the system's folders, if any."""
    names = [*Path("/usr/lib").glob("*/libLLVM*.so*"), *Path("/usr/lib").glob("llvm-*/lib/libLLVM*.so*")]
    versions = {int(found[1]): str(name) for name in names if (found := re.search(r"(?:so\.|LLVM-)(\d+)", name.name))}
    return versions[max(versions)] if versions else None


def ready_mitsuba() -> Any:
    """Return the module mitsuba, its variant chosen and tried."""
    if "DRJIT_LIBLLVM_PATH" not in os.environ and (library := find_llvm()):
        os.environ["DRJIT_LIBLLVM_PATH"] = library
    try:
        import mitsuba
    except ImportError as error:
        raise WorkerError(f"Mitsuba cannot be imported ({error}); pip install 'rptcam_cl[bench]'") from error
    try:
        mitsuba.set_variant(VARIANT)
        if sys.argv[1:] == ["avx2"]:
            (core,) = Path(str(find_spec("drjit").origin)).parent.glob("libdrjit-core.*")  # type: ignore[union-attr]
            set_target = ctypes.CDLL(str(core))._Z19jit_llvm_set_targetPKcS0_j  # Dr.Jit's Python has no name for it
            set_target(b"haswell", b"+avx,+avx2,+fma,+f16c,+bmi,+bmi2", 8)
        mitsuba.Float([1.0]) + 1.0
    except Exception as error:
        raise WorkerError(f"Mitsuba's variant {VARIANT} does not run ({error}); it needs LLVM. {REMEDY}") from error
    register(mitsuba)
    return mitsuba


def start() -> tuple[str, Callable[[dict[str, Any]], dict[str, Any]]]:
    """Return the description of the renderer and its answers."""
    mitsuba = ready_mitsuba()
    loaded: dict[str, Any] = {}

    def respond(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "load":
            loaded[request["as"]] = mitsuba.load_dict(_with_transforms(mitsuba, request["description"]))
            return {}
        if request["do"] == "count":
            sampler = mitsuba.load_dict({"type": request["sampler"], "sample_count": request["spp"]})
            return {"spp": sampler.sample_count()}
        return _render(mitsuba, loaded[request["as"]], request)

    library = Path(os.environ.get("DRJIT_LIBLLVM_PATH", "LLVM")).name
    return f"Mitsuba {mitsuba.__version__} {VARIANT} ({library})", respond


def _with_transforms(mitsuba: Any, description: dict[str, Any]) -> dict[str, Any]:
    """Return a description with its ``{"matrix": rows}``, ``{"voxels": …}`` and ``"strands"`` as Mitsuba has them."""
    import tempfile

    import numpy as np

    found = {}
    for key, value in description.items():
        if isinstance(value, dict) and "voxels" in value:
            found[key] = mitsuba.VolumeGrid(np.array(value["voxels"], np.float32))
        elif isinstance(value, dict):
            matrix = value.get("matrix")
            found[key] = _with_transforms(mitsuba, value) if matrix is None else mitsuba.ScalarTransform4f(matrix)
        elif key == "strands":
            with tempfile.NamedTemporaryFile("w", suffix=".txt", delete=False) as file:
                file.writelines("".join("{} {} {} {}\n".format(*row) for row in strand) + "\n" for strand in value)
            found["filename"] = file.name
        else:
            found[key] = value
    return found


def _render(mitsuba: Any, scene: Any, request: dict[str, Any]) -> dict[str, Any]:
    """Return times and mean colour of a render from nothing to the picture in numpy, which may be saved."""
    import numpy as np

    return timed_picture(lambda: np.array(mitsuba.render(scene, spp=request["spp"], seed=request["seed"])), request)


if __name__ == "__main__":
    serve(start)
