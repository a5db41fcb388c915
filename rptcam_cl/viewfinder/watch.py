"""Watches files by looking at them several times a second."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from pathlib import Path

INTERVAL_S = 0.2  # an edit is seen after two looks: when it is there, and when it has come to rest

_State = tuple[int, int, int] | None


class Watch:
    """Calls back when files have changed and then stayed the same for one look.

    Parameters
    ----------
    files : callable
        Returns the files to watch; asked at each look. A missing file counts as one that may come.
    on_change : callable
        Called from a thread of the watch's own.
    """

    def __init__(
        self, files: Callable[[], Iterable[Path]], on_change: Callable[[], object], interval_s: float = INTERVAL_S
    ) -> None:
        self._files, self._on_change, self._interval_s = files, on_change, interval_s
        self._known: dict[Path, _State] = {}
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rptcam-watch", daemon=True)

    def start(self) -> None:
        """Begin; what the files are now is what they are compared with."""
        self._known = self._states()
        self._thread.start()

    def stop(self) -> None:
        """End; no call comes after this unless one is under way."""
        self._end.set()

    def _states(self) -> dict[Path, _State]:
        return {path: _state(path) for path in self._files()}

    def _run(self) -> None:
        changed = False
        while not self._end.wait(self._interval_s):
            found = self._states()
            moving = any(path in self._known and self._known[path] != state for path, state in found.items())
            self._known = found
            if moving:
                changed = True
            elif changed:
                changed = False
                self._on_change()


def _state(path: Path) -> _State:
    try:
        state = path.stat()
    except OSError:
        return None
    return (state.st_mtime_ns, state.st_size, state.st_ino)
