"""The worker that renders with this package.

Requests: ``load`` a reference scene, perhaps with other ``settings`` of its render; ``render`` samples of it, perhaps
``save`` the picture and ``forget`` the scene.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from benchmarks.scenes import reference_scene, wavefront_of
from benchmarks.stopwatch import timed_picture
from benchmarks.worker import serve
from rptcam_cl.core import __version__
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.tracer import Wavefront


def start() -> tuple[str, Callable[[dict[str, Any]], dict[str, Any]]]:
    """Return the description of the renderer and its answers."""
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

    return f"rptcam_cl {__version__} on {session.info.name} ({session.info.platform})", respond


def _render(wavefront: Wavefront, request: dict[str, Any]) -> dict[str, Any]:
    """Return times and mean colour of a render from the empty film to the picture in numpy."""

    def make() -> Any:
        wavefront.clear()
        return render_plan(wavefront, spp=request["spp"], seconds=None, has_lens=False).pixels

    return timed_picture(make, request)


if __name__ == "__main__":
    serve(start)
