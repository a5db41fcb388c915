"""``rptcam render --watch``: a picture is rendered again whenever a file that it comes from has changed."""

import sys
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from rptcam_cl.core.errors import RptcamError
from rptcam_cl.core.references import named_files

INTERVAL_S = 0.2  # between two times that files are compared

State = tuple[int, int, int] | None


class Files:
    """Files as they were, to be compared with what they are.

    Parameters
    ----------
    first
        A file that counts from the beginning.
    more
        Grows as others are named; each counts from the first comparison on.
    """

    def __init__(self, first: Path, more: Iterable[Path]) -> None:
        self._more = more
        self._known = {first: _state(first)}
        self._compared = time.monotonic()
        self._changed = False

    def changed(self) -> bool:
        """Return whether one has changed, by comparing them a few times a second at most."""
        if not self._changed and time.monotonic() - self._compared >= INTERVAL_S:
            self._compared = time.monotonic()
            for path in tuple(self._more):
                self._known.setdefault(path, _state(path))
            self._changed = any(_state(path) != state for path, state in self._known.items())
        return self._changed

    def wait_for_rest(self) -> None:
        """Wait until they stay the same: whoever writes them has come to the end."""
        last = None
        while last != (last := {path: _state(path) for path in self._known}):
            time.sleep(INTERVAL_S)


def render_again(scene: Path, stop: threading.Event, picture: Callable[[Callable[[], bool]], object]) -> None:
    """Make a picture, and again whenever files change, until ``stop`` is set; errors are printed, and waited out.

    Parameters
    ----------
    scene
        The scene file.
    picture
        Makes the picture; it asks the function that it is given whether to give up.
    """
    while not stop.is_set():
        with named_files() as named:
            files = Files(scene, named)
            try:
                picture(lambda files=files: stop.is_set() or files.changed())  # type: ignore[misc]
            except RptcamError as error:
                if not stop.is_set():  # else a compiler, whose files Ctrl-C takes away
                    print(f"error: {error}", file=sys.stderr)
            while not (stop.is_set() or files.changed()):
                stop.wait(INTERVAL_S)
        if not stop.is_set():
            files.wait_for_rest()


def _state(path: Path) -> State:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
