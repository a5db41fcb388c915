"""``rptcam render --preview``: the picture so far is written to the outputs while the render goes on."""

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.core.errors import RptcamError

if TYPE_CHECKING:
    from rptcam_cl.api import Progress

Show = Callable[["Progress"], None]


def previewing(
    interval: float, outputs: Sequence[Path], show: Show | None, clock: Callable[[], float] = time.monotonic
) -> Show:
    """Return what takes reports of a render and writes the picture so far, each file whole or not at all.

    That one cannot be written ends no render.

    Parameters
    ----------
    interval
        Time between two pictures [s].
    outputs
        Where the finished picture goes too.
    show
        Gets every report as well.
    clock
        Returns the time [s].
    """
    last = clock()

    def write(progress: "Progress") -> None:
        nonlocal last
        if show is not None:
            show(progress)
        if progress.image is None or clock() - last < interval:
            return
        image = progress.image()
        for output in outputs:
            try:
                image.save(output)
            except RptcamError as error:
                print(f"warning: the picture so far: {error}", file=sys.stderr)
        last = clock()

    return write
