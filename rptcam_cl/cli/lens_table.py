"""Tables: ruled on a terminal, plain columns elsewhere."""

import math
import sys
from collections.abc import Sequence
from typing import Any

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
