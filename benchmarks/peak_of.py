"""Runs the command rptcam and prints the greatest memory of the process [bytes], its wall time and its CPU time [s]."""

import re
import resource
import sys
import time
from pathlib import Path

STATUS = Path("/proc/self/status")


def greatest_memory() -> int:
    """Return the most memory that this process held at once [bytes]."""
    if STATUS.exists():  # Linux hands ru_maxrss down from the process that started this one
        found = re.search(r"VmHWM:\s*(\d+) kB", STATUS.read_text("ascii"))
        assert found is not None
        return 1024 * int(found[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    from rptcam_cl.cli import main

    begun = time.perf_counter()
    code = main(sys.argv[1:])
    used = resource.getrusage(resource.RUSAGE_SELF)
    print(greatest_memory(), time.perf_counter() - begun, used.ru_utime + used.ru_stime)
    raise SystemExit(code)
