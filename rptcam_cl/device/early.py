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
from rptcam_cl.core.kept import identity_of_code, keep_arrays, kept_arrays, name_of
from rptcam_cl.device.at_work import unfinished_work
from rptcam_cl.device.program import Parameters
from rptcam_cl.device.session import open_session
from rptcam_cl.device.trial import end_trials, prepare_trial

Built = list[tuple[str, Parameters]]  # sources, and the names of their kernels' parameters

KEPT = "commands"  # folder of the cache on disk
MOST_CHARACTERS = 4 << 20  # of all sources of a command


def open_early(spec: str | None, *command: object) -> Callable[[], None]:
    """Open the device that ``spec`` names in a thread; return what is to be called when the command has ended well.

    All that is imported for it is imported here: two threads that import the same packages can get in each other's way.

    Parameters
    ----------
    command
        What tells commands that build other programs apart; without it, the device is opened and nothing built.
    """
    name = name_of(identity_of_code(("device",)), spec, *command) if command else ""
    kept = kept_arrays(KEPT, name) if command else None
    built: Built = [] if kept is None else [tuple(each) for each in kept[1]["built"]]
    try:
        prepare_trial()
        from pyopencl import characterize  # noqa: F401 -- wanted by the first build
    except (DeviceError, ImportError):
        return lambda: None
    threading.Thread(target=_open, args=(spec, name, built), daemon=True).start()
    return lambda: _remember(spec, name, built)


def _open(spec: str | None, name: str, built: Built) -> None:
    with unfinished_work(), contextlib.suppress(Exception):  # whatever a driver may raise
        session = open_session(spec)
        if built:
            session.foresee(built)
        elif name:
            session.read_library(name)


def _remember(spec: str | None, name: str, before: Built) -> None:
    """Keep what was built, where that is not what was built before."""
    end_trials()
    programs = open_session(spec).programs
    if [program.source for program in programs] == [source for source, _ in before]:
        return
    if sum(len(program.source) for program in programs) <= MOST_CHARACTERS:
        keep_arrays(KEPT, name, {}, {"built": [(program.source, program.parameters) for program in programs]})
