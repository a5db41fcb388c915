"""``rptcam render --preview``: the picture so far is written to the outputs while the render goes on."""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.core.errors import RptcamError

if TYPE_CHECKING:
    from rptcam_cl.api import Prepared, Progress


class Previews:
    """Writes the picture so far, each file whole or not at all.

    Parameters
    ----------
    interval
        Time between two pictures [s]; without one, none is written.
    outputs
        Where the finished picture goes too.

    Attributes
    ----------
    prepared
        The render, once it is prepared.
    """

    def __init__(self, interval: float | None, outputs: Sequence[Path]) -> None:
        self._interval, self._outputs = interval, outputs
        self._last = time.monotonic()
        self.prepared: Prepared | None = None

    def write_if_due(self, progress: "Progress") -> None:
        """Write the picture of a progress, if the last is so long ago. That one cannot be written ends no render."""
        if self._interval is None or progress.film is None or time.monotonic() - self._last < self._interval:
            return
        from rptcam_cl.api import picture_so_far

        assert self.prepared is not None
        image = picture_so_far(self.prepared, progress)
        for output in self._outputs:
            try:
                image.save(output)
            except RptcamError as error:
                print(f"warning: the picture so far: {error}", file=sys.stderr)
        self._last = time.monotonic()
