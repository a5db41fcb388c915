"""What a conversion ignored or approximated, with the lines of the source."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.source import Place, one_line

# Lines named per message; a scene of ten thousand shapes may break one rule ten thousand times.
LINES_NAMED = 8


@dataclass
class Report:
    """Messages in the order of files and lines, each with all the lines that it concerns."""

    _lines: dict[str, set[tuple[str, int]]] = field(default_factory=dict)

    def ignored(self, place: Place, what: str) -> None:
        """Note something that the scene of ours does not have."""
        self._note(place, f"ignored: {what}")

    def approximated(self, place: Place, what: str) -> None:
        """Note something that the scene of ours has in another way."""
        self._note(place, f"approximated: {what}")

    def noted(self, place: Place, what: str) -> None:
        """Note something that a user may want to know, such as a file that was copied."""
        self._note(place, f"note: {what}")

    def _note(self, place: Place, message: str) -> None:
        self._lines.setdefault(one_line(message), set()).add((place.source.name, place.line_number))

    def __iter__(self) -> Iterator[str]:
        placed = sorted((sorted(places), message) for message, places in self._lines.items())
        for ((file, line), *others), message in placed:
            named = ", ".join(str(other) if name == file else f"{name}:{other}" for name, other in others[:LINES_NAMED])
            rest = len(others) - LINES_NAMED
            more = f" (also on {named}{f' and {rest} more' if rest > 0 else ''})" if others else ""
            yield f"{file}:{line}: {message}{more}"

    def __len__(self) -> int:
        return len(self._lines)
