"""Everything that compares this renderer with others, and what explains it: one benchmark after the other.

    python -m benchmarks.beside_others [--mitsuba-python PATH] [--quick]

Runs against_mitsuba, equal_time, mesh_rays, mesh_memory, bvh_build and passes. What they print, in Markdown, is what
the README shows.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WITH_MITSUBA = ("against_mitsuba", "equal_time", "mesh_rays")
ALONE = ("mesh_memory", "bvh_build", "passes")


def main() -> int:
    """Run them all; return the greatest exit code."""
    parser = argparse.ArgumentParser(description="Every comparison with other renderers.")
    parser.add_argument("--quick", action="store_true", help="tiny runs that only show that the benchmarks work")
    parser.add_argument("--device", help="OpenCL device, as for the command rptcam")
    parser.add_argument("--mitsuba-python", default=sys.executable, help="interpreter that can import mitsuba")
    options = parser.parse_args()
    shared = [*(["--quick"] if options.quick else []), *(["--device", options.device] if options.device else [])]
    codes = []
    for name in (*WITH_MITSUBA, *ALONE):
        print(f"### {name}\n", flush=True)
        more = ["--mitsuba-python", options.mitsuba_python] if name in WITH_MITSUBA else []
        codes.append(subprocess.run([sys.executable, "-m", f"benchmarks.{name}", *shared, *more], cwd=ROOT).returncode)
    return max(codes)


if __name__ == "__main__":
    raise SystemExit(main())
