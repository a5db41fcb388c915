"""The command line as ``python -m rptcam_cl``."""

import sys

from rptcam_cl.cli import main

sys.exit(main())
