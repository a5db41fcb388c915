"""The worker that renders with this package.

Requests: ``load`` a reference scene, perhaps with other ``settings`` of its render; ``render`` samples of it, perhaps
of another ``seed`` and up to a ``noise``, ``save`` the picture and ``forget`` the scene. After the device ``avx2`` may
stand: PoCL from pip then works as where a processor has no AVX-512.
"""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.scenes import reference_scene, wavefront_of
from benchmarks.stopwatch import timed_picture
from benchmarks.worker import WorkerError, serve
from rptcam_cl.core import __version__
from rptcam_cl.device import devices
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.tracer import Wavefront

_POCL = ("pyopencl", "pocl_binary_distribution")


def start() -> tuple[str, Callable[[dict[str, Any]], dict[str, Any]]]:
    """Return the description of the renderer and its answers."""
    if sys.argv[2:] == ["avx2"]:
        hold_to_avx2()
    session = Session(choose_device(sys.argv[1] if len(sys.argv) > 1 else None))
    loaded: dict[str, Wavefront] = {}

    def respond(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "load":
            how = {"shrink": request["shrink"], "roulette": request["roulette"], **request.get("settings", {})}
            loaded[request["as"]] = wavefront_of(reference_scene(request["scene"], **how), session)
            return {}
        answer = _render(loaded[request["as"]], request)
        if request.get("forget"):
            del loaded[request["as"]]
        return answer

    lanes = f"{session.lanes} lanes"
    return f"rptcam_cl {__version__} on {session.info.name} ({session.info.platform}, {lanes})", respond


def hold_to_avx2() -> None:
    """Have this process load a copy of PoCL whose built-ins for AVX-512 are those for AVX2, with a cache of its own."""
    packages = [Path(str(spec.origin)).parent for name in _POCL if (spec := find_spec(name))]
    if len(packages) != len(_POCL):
        raise WorkerError("only the PoCL that pip installs can be held to AVX2 (pip install pocl-binary-distribution)")
    folder = Path(tempfile.mkdtemp())
    for package in packages:
        shutil.copytree(package / ".libs", folder / package.name / ".libs")
    built_ins = folder / _POCL[1] / ".libs/share/pocl/kernel-x86_64-unknown-linux-gnu-avx512.bc"
    shutil.copy(built_ins.with_name(built_ins.name.replace("avx512", "avx2")), built_ins)
    icd = folder / _POCL[0] / ".libs/pocl.icd"
    icd.write_text(str(icd.with_name(icd.read_text().strip())))
    os.environ |= {"OCL_ICD_VENDORS": str(icd.parent), "POCL_CACHE_DIR": str(folder / "cache")}
    os.environ["RPTCAM_CACHE_DIR"] = str(folder / "own")
    devices.try_device = lambda handle: devices.Trial(library_arch="haswell")  # type: ignore[assignment]
    devices.builds_apart = lambda handle: False
    atexit.register(shutil.rmtree, folder, ignore_errors=True)


def _render(wavefront: Wavefront, request: dict[str, Any]) -> dict[str, Any]:
    """Return times and mean colour of a render from the empty film to the picture in numpy."""

    how = {"spp": request["spp"], "noise": request.get("noise")}
    made: list[int] = []

    wavefront.seed = request.get("seed", wavefront.seed)
    wavefront.choose_tiles(np.arange(wavefront.layout.tiles, dtype=np.uint32))  # those that had met a noise, too

    def make() -> Any:
        wavefront.clear()
        rendering = render_plan(wavefront, seconds=None, has_lens=False, **how)
        made.append(rendering.spp)
        return rendering.pixels

    return timed_picture(make, request) | {"spp": made[0]}


if __name__ == "__main__":
    serve(start)
