"""What every benchmark prints: the machine, tables in Markdown, and the same numbers as JSON."""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.stopwatch import cores
from rptcam_cl.device.devices import DeviceInfo


def arguments(description: str) -> argparse.ArgumentParser:
    """Return a parser with the options that all benchmarks share."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--quick", action="store_true", help="tiny runs that only show that the benchmark works")
    parser.add_argument("--device", help="OpenCL device, as for the command rptcam")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to a file, too")
    return parser


def machine(device: DeviceInfo) -> dict[str, Any]:
    """Return what the numbers depend on: date, processor, device and the load average at the time."""
    return {
        "date": datetime.date.today().isoformat(),
        "processor": _processor(),
        "cores": cores(),
        "device": f"{device.name} ({device.platform})",
        "device_version": device.handle.version,
        "python": platform.python_version(),
        "load_average": round(os.getloadavg()[0], 2),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown")


def print_machine(facts: dict[str, Any]) -> None:
    """Print the facts of `machine` in one line."""
    print("; ".join(f"{name.replace('_', ' ')} {value}" for name, value in facts.items()), end="\n\n")


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a Markdown table; the first column stands left, the others right."""
    print(table(title, columns, rows), flush=True)


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; the first column stands left, the others right."""
    widths = [max(map(len, column)) for column in zip(columns, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        first, *others = zip(cells, widths, strict=True)
        return "| " + " | ".join([first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]) + " |"

    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    heading = [f"**{title}**\n"] if title else []
    return "\n".join([*heading, line(columns), line(rule), *map(line, rows), ""])


def write_json(path: Path | None, facts: dict[str, Any], results: Any) -> None:
    """Write facts and results to a file, if there is one to write to."""
    if path is not None:
        path.write_text(json.dumps({"machine": facts, "results": results}, indent=1) + "\n", encoding="utf-8")


def spread(values: Sequence[float]) -> str:
    """Return median, minimum and maximum as text."""
    return f"{statistics.median(values):.2f} ({min(values):.2f}-{max(values):.2f})"
