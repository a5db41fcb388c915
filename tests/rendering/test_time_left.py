"""What is left of a render with a noise target, against what it then takes."""

import numpy as np
import pytest

from rptcam_cl.rendering.film import TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.progressive import NoiseEstimate, TimeLeft, next_end

LAYOUT = FilmLayout(64, 64, 0, 0, 64, 64)
SAMPLES_PER_SECOND = 1e5


def course(spread: np.ndarray, target: float, most: int | None) -> list[tuple[float, float, object]]:
    """Seconds, samples and what is said to be left, at the end of each run of independent samples."""
    estimate, left = NoiseEstimate(LAYOUT, target), TimeLeft()
    rng = np.random.default_rng(1)
    spreads = np.zeros(LAYOUT.pixels)
    spreads[: spread.size * TILE_PIXELS] = np.repeat(spread, TILE_PIXELS)
    sums, done, made, rows = np.zeros((6, LAYOUT.pixels)), 0, 0, []
    while len(estimate.tiles) and (most is None or done < most):
        count = next_end(done) - done
        active = np.repeat(np.isin(np.arange(LAYOUT.pixels // TILE_PIXELS), estimate.tiles), TILE_PIXELS)
        values = count + np.sqrt(count) * spreads * rng.standard_normal(LAYOUT.pixels)
        sums[:3] += np.where(active, values, 0)
        made, done = made + count * int(active.sum()), done + count
        estimate.take(done, sums.astype(np.float32))
        left.note(made / SAMPLES_PER_SECOND, made)
        rows.append((made / SAMPLES_PER_SECOND, made, left.tiles_left(estimate, done, most)))
    return rows


@pytest.mark.parametrize("most", [None, 1024])
def test_time_left_holds_within_a_third(most: int | None) -> None:
    rows = course(np.geomspace(0.1, 2, LAYOUT.tiles), 0.05, most)
    end = rows[-1][0]
    said = [(left.seconds / (end - at), at / end) for at, _, left in rows if left is not None and at < 0.9 * end]
    assert len(said) > 5
    assert all(0.67 < ratio < 1.5 for ratio, share in said if share > 0.2), said


def test_nothing_is_said_before_the_noise_is_known_and_when_all_is_done() -> None:
    rows = course(np.full(LAYOUT.tiles, 0.5), 0.05, None)
    assert rows[0][2] is None
    assert rows[-1][2] is None


def test_the_last_tiles_are_named_with_their_noise() -> None:
    spread = np.full(LAYOUT.tiles, 0.1)
    spread[7] = 2
    *_, (_, _, left), _ = course(spread, 0.05, None)
    assert left.count == 1
    assert left.few
    assert 0.05 < left.worst < 0.08
