"""The device opened by a thread, while the rest of the program is imported and the scene is read.

A driver takes its time outside Python's lock: to start, to be tried, and to build what the same command had built the
last time, which is kept. For a command that is new, PoCL reads its library of built-in functions meanwhile, which takes
it 0.4 s in every process that compiles.

Nothing fails here: what goes wrong does so again where it is wanted, and is reported there.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.kept import keep_arrays, kept_arrays, name_of
from rptcam_cl.device.at_work import unfinished_work
from rptcam_cl.device.opencl import load_opencl
from rptcam_cl.device.session import open_session

KEPT = "commands"  # folder of the cache on disk
MOST_CHARACTERS = 4 << 20  # of all sources of a command


def open_early(spec: str | None, *command: object) -> Callable[[], None]:
    """Open the device that ``spec`` names in a thread; return what is to be called when the command has ended well.

    All that is imported for it is imported here: two threads that import the same packages can get in each other's way.

    Parameters
    ----------
    command
        What tells commands that build other programs apart.
    """
    name = name_of(spec, *command)
    kept = kept_arrays(KEPT, name)
    sources: list[str] = [] if kept is None else kept[1]["sources"]
    try:
        load_opencl()
        from pyopencl import characterize  # noqa: F401 -- wanted by the first build
    except (DeviceError, ImportError):
        return lambda: None
    threading.Thread(target=_open, args=(spec, name, sources), daemon=True).start()
    return lambda: _remember(spec, name, sources)


def _open(spec: str | None, name: str, sources: list[str]) -> None:
    with unfinished_work(), contextlib.suppress(Exception):  # whatever a driver may raise
        session = open_session(spec)
        if sources:
            session.foresee(sources)
        else:
            session.read_library(name)


def _remember(spec: str | None, name: str, before: list[str]) -> None:
    """Keep what was built, where that is not what was built before."""
    sources = open_session(spec).sources
    if sources != before and sum(map(len, sources)) <= MOST_CHARACTERS:
        keep_arrays(KEPT, name, {}, {"sources": sources})
