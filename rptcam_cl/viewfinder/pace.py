"""How much to render at once: the scale of a glance and the samples of a take, from the speed measured."""

from __future__ import annotations

SCALES = (1.0, 0.5, 0.25, 0.125)
GLANCE_S = 0.07  # a glance may take: with the way to the page, more than ten of them a second
TAKE_S = 0.15  # samples of a resting picture may take, so that what the user does next is not kept waiting
_HEADROOM = 0.6  # of the time that a larger scale may be foreseen to take before it is tried
_NEWS = 0.5  # weight of the last measurement
_MOST_SAMPLES = 4096  # of one take


class Pace:
    """Chooses the scale of glances and the samples of takes so that each keeps its time.

    A glance takes a fixed time and one in proportion to its pixels; both are unknown, so that the smaller scales are
    foreseen by the share of their pixels alone, which is never too little for a larger and never too much for a smaller
    scale.
    """

    def __init__(self, glance_s: float = GLANCE_S, take_s: float = TAKE_S) -> None:
        self._glance_s, self._take_s = glance_s, take_s
        self._index = 1
        self._measured = False
        self._sample_s: float | None = None

    @property
    def scale(self) -> float:
        """Scale of the next glance."""
        return SCALES[self._index]

    @property
    def samples(self) -> int:
        """Samples per pixel of the next take."""
        if self._sample_s is None:
            return 1
        return max(1, min(_MOST_SAMPLES, int(self._take_s / max(self._sample_s, 1e-6))))

    def glanced(self, scale: float, seconds: float) -> None:
        """Note what a glance took; the scale goes down at once where it was too slow, and up where there is room."""
        if scale != self.scale:
            return
        if seconds > self._glance_s and self._index < len(SCALES) - 1:
            steps = 1 if seconds <= 4 * self._glance_s else 2
            self._index = min(self._index + steps, len(SCALES) - 1)
        elif self._index > 0 and seconds * 4 < _HEADROOM * self._glance_s:
            self._index -= 1

    def took(self, samples: int, seconds: float) -> None:
        """Note what a take took."""
        if samples > 0:
            each = seconds / samples
            self._sample_s = each if self._sample_s is None else _NEWS * each + (1 - _NEWS) * self._sample_s
