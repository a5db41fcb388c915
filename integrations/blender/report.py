"""What a translation leaves out, as sentences for the panel and the console."""

from __future__ import annotations


class Report:
    """Sentences, each once, in the order in which they came up."""

    def __init__(self) -> None:
        self._sentences: dict[str, None] = {}

    def add(self, sentence: str) -> None:
        """Say what is not as in Blender."""
        self._sentences.setdefault(sentence)

    def extend(self, other: Report) -> None:
        """Say all that another report says."""
        for sentence in other.sentences:
            self.add(sentence)

    @property
    def sentences(self) -> list[str]:
        """All sentences."""
        return list(self._sentences)

    def __bool__(self) -> bool:
        return bool(self._sentences)
