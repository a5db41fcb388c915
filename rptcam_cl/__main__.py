"""The command line, as ``rptcam`` and as ``python -m rptcam_cl``."""

import gc
import signal
import sys

LITTER = 50_000  # objects more than before at which cycles are looked for: while all is imported, there are none


def run() -> int:
    """Run the command of the process's words and return its exit code.

    Until all is imported, an interrupt ends the process at once and in silence: nothing is begun that could be lost.
    """
    gc.set_threshold(LITTER, 20, 20)
    python_interrupt = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from rptcam_cl.cli import main

    signal.signal(signal.SIGINT, python_interrupt)
    return main()


if __name__ == "__main__":
    sys.exit(run())
