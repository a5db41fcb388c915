"""The worker that renders with this package. Requests: ``load`` a reference scene, ``render`` samples of it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from benchmarks.scenes import reference_scene, wavefront_of
from benchmarks.stopwatch import timed
from benchmarks.worker import serve
from rptcam_cl._version import __version__
from rptcam_cl.device import Session, choose_device
from rptcam_cl.wavefront import Wavefront, render_plan


def start() -> tuple[str, Callable[[dict[str, Any]], dict[str, Any]]]:
    """Return the description of the renderer and its answers."""
    session = Session(choose_device(sys.argv[1] if len(sys.argv) > 1 else None))
    loaded: dict[str, Wavefront] = {}

    def respond(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "load":
            scene = reference_scene(request["scene"], shrink=request["shrink"], roulette=request["roulette"])
            loaded[request["as"]] = wavefront_of(scene, session)
            return {}
        return _render(loaded[request["as"]], request["spp"])

    return f"rptcam_cl {__version__} on {session.info.name} ({session.info.platform})", respond


def _render(wavefront: Wavefront, spp: int) -> dict[str, Any]:
    """Return times and mean colour of a render from the empty film to the picture in numpy."""
    pictures = []

    def work() -> None:
        wavefront.clear()
        pictures.append(render_plan(wavefront, spp=spp, seconds=None, has_lens=False).pixels)

    times = timed(work)
    return {"wall": times.wall, "cpu": times.cpu, "mean": pictures[0].mean(axis=(0, 1), dtype=float).tolist()}


if __name__ == "__main__":
    serve(start)
