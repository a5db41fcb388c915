"""What the commands print: JSON that every reader accepts, numbers for people, and tables."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Sequence
from typing import Any


def _plain(value: Any) -> Any:
    """The value with what JSON cannot say (infinity, not-a-number) as null and NumPy scalars as Python's."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def as_json(value: Any) -> str:
    """The value as indented JSON text."""
    return json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False)


def as_bytes(count: float) -> str:
    """A number of bytes for people, as ``15.6 GiB``."""
    for unit in ("B", "KiB", "MiB"):
        if count < 1024:
            return f"{count:.4g} {unit}"
        count /= 1024
    return f"{count:.4g} GiB"


def print_warnings(warnings: Iterable[str]) -> None:
    """Print a line for each warning to standard error, which leaves standard output to data."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


_NOTHING = 1e-12  # what rounding leaves of a zero


def _text(value: Any) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, float):
        return f"{0.0 if abs(value) < _NOTHING else value:.5g}"
    return str(value)


def print_table(columns: Sequence[str], rows: Sequence[Sequence[Any]], title: str = "") -> None:
    """Print rows under the names of their columns; numbers to five digits, what does not exist as a dash."""
    cells = [[_text(value) for value in row] for row in rows]
    if sys.stdout.isatty():
        _print_ruled(columns, cells, title)
        return
    if title:
        print(title)
    widths = [max(map(len, column)) for column in zip(columns, *cells, strict=True)]
    for line in (columns, *cells):
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def _print_ruled(columns: Sequence[str], cells: Sequence[Sequence[str]], title: str) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title) or None)
    for column in columns:
        table.add_column(escape(column), justify="right")
    for row in cells:
        table.add_row(*map(escape, row))
    Console().print(table)
