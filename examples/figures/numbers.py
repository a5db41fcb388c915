"""Numbers of a document beside ours: how closely they must agree, and the Markdown table that shows them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

Ours = float | str
Lines = list[list[str]]


@dataclass(frozen=True)
class Row:
    """Some numbers of a document and ours.

    Attributes
    ----------
    label : sequence of str
        What they are of.
    expected : sequence of str
        As the document prints them: their last digit says how well it knows them. Words where it has none.
    ours : sequence of float or str
        Words where there is no such number.
    form : str
        How ours are printed.
    error : float
        Of the document's numbers, relative, where they are measured or estimated.
    more : float
        Difference beyond that; the table then tells its reason.
    name : str
        Of our line.
    """

    label: Sequence[str]
    expected: Sequence[str]
    ours: Sequence[Ours]
    form: str = ".2f"
    error: float = 0.0
    more: float = 0.0
    name: str = "ours"

    def cells(self) -> list[str]:
        """Return our numbers as they are printed."""
        return [value if isinstance(value, str) else format(value, self.form) for value in self.ours]

    def misses(self, more: float | None = None) -> Iterator[str]:
        """Yield what differs by more than is allowed, the explained difference being `more` if given."""
        for text, value in zip(self.expected, self.ours, strict=True):
            number = as_number(text)
            if number is None or isinstance(value, str):
                if (number is None) != isinstance(value, str):
                    yield f"{' '.join(self.label)}: {text} expected, ours {value}"
                continue
            allowed = half_digit(text) + self.error * abs(number) + (self.more if more is None else more)
            if not abs(value - number) <= allowed:
                yield f"{' '.join(self.label)}: {text} expected within {allowed:.2g}, ours {value:.9g}"


@dataclass(frozen=True)
class Numbers:
    """A table of rows.

    Attributes
    ----------
    labels, columns : sequence of str
        Heads of the rows' labels and of their numbers.
    rows : sequence of Row
        Rows in succession that compare with the same numbers of the document print them once.
    below : bool
        Whether ours stand below those of the document, or else beside them.
    document : str
        What the numbers of the document are called.
    reason : str
        Why some rows differ by more than the document's own uncertainty.
    noise : float
        Of ours, relative, where they are rendered: between devices.
    """

    labels: Sequence[str]
    columns: Sequence[str]
    rows: Sequence[Row]
    below: bool = True
    document: str = "expected"
    reason: str = ""
    noise: float = 0.0

    def misses(self) -> list[str]:
        """Return what differs by more than is allowed."""
        return [miss for row in self.rows for miss in row.misses()]

    def lines(self) -> Lines:
        """Return the cells of the table, its head first."""
        if self.below:
            return [[*self.labels, "", *self.columns], *self._lines_below()]
        head = [*self.labels]
        for column in self.columns:
            head += [f"{column}, {self.document}" if column else self.document, "ours"]
        pairs = [[cell for pair in zip(row.expected, row.cells(), strict=True) for cell in pair] for row in self.rows]
        return [head, *([*row.label, *cells] for row, cells in zip(self.rows, pairs, strict=True))]

    def _lines_below(self) -> Iterator[list[str]]:
        last: tuple[Sequence[str], Sequence[str]] | None = None
        for row in self.rows:
            if last != (row.label, row.expected):
                yield [*row.label, self.document, *row.expected]
            yield [*("" for _ in row.label), row.name, *row.cells()]
            last = (row.label, row.expected)

    def markdown(self) -> str:
        """Return the table, and the reason of what differs below it."""
        head, *lines = self.lines()
        table = "\n".join("| " + " | ".join(line) + " |" for line in [head, ["---"] * len(head), *lines])
        return f"{table}\n\n{remark(self.reason)}"

    def differences(self, page: str) -> list[str]:
        """Return where the table on a page holds other numbers than these."""
        printed = _table_of(page, self.lines()[0])
        if printed is None or len(printed) != len(self.lines()):
            return [f"no such table: {' | '.join(self.lines()[0])}"]
        return [
            f"{' | '.join(line)}: the page has {there}, now {here}"
            for line, there_line in zip(self.lines(), printed, strict=True)
            for here, there in zip(line, there_line, strict=True)
            if not self._same(here, there)
        ]

    def _same(self, here: str, there: str) -> bool:
        now, then = as_number(here), as_number(there)
        if now is None or then is None:
            return here == there
        return abs(now - then) <= 2.1 * half_digit(there) + self.noise * abs(then)


def remark(reason: str) -> str:
    """Return the verdict that stands below a table: whether its numbers are met, with the reason if some are not."""
    return f"Verdict: met, but for this. {reason}" if reason else "Verdict: met."


def as_number(text: str) -> float | None:
    """Return the number that a text is, or None."""
    try:
        return float(text.removesuffix("%"))
    except ValueError:
        return None


def half_digit(text: str) -> float:
    """Return half a unit of the last digit of a number, and a little for numbers that lie between two digits."""
    digits = len(text.removesuffix("%").partition(".")[2])
    return 0.505 * 10.0**-digits


def _table_of(page: str, head: list[str]) -> Lines | None:
    """Return the cells of the table with a head."""
    pattern = re.escape("| " + " | ".join(head) + " |") + r"\n\|[-| ]+\|\n((?:\|.*\|\n)+)"
    found = re.search(pattern, page)
    if found is None:
        return None
    return [head, *([cell.strip() for cell in line[1:-1].split(" | ")] for line in found[1].splitlines())]
