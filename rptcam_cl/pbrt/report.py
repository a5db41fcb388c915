"""What a conversion ignored or approximated, with the lines of the source."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from rptcam_cl.pbrt.source import Place

# Lines named per message; a scene of ten thousand shapes may break one rule ten thousand times.
LINES_NAMED = 8


@dataclass
class Report:
    """Messages in the order of their first line, each with all the lines that it concerns."""

    _lines: dict[str, dict[str, None]] = field(default_factory=dict)

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
        self._lines.setdefault(message, {}).setdefault(place.line)

    def __iter__(self) -> Iterator[str]:
        for message, lines in self._lines.items():
            first, *others = lines
            more = ""
            if others:
                named = ", ".join(line.removeprefix(first.rpartition(":")[0] + ":") for line in others[:LINES_NAMED])
                rest = len(others) - LINES_NAMED
                more = f" (also on {named}{f' and {rest} more' if rest > 0 else ''})"
            yield f"{first}: {message}{more}"

    def __len__(self) -> int:
        return len(self._lines)
