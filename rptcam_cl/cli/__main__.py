"""The command line as ``python -m rptcam_cl.cli``."""

import sys

from rptcam_cl.__main__ import run

if __name__ == "__main__":
    sys.exit(run())
