"""What becomes of colours that the display cannot show."""

import numpy as np
import pytest

from rptcam_cl.imaging.development import developed_values
from rptcam_cl.scene.film import PictureSettings

WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


@pytest.fixture
def colours() -> np.ndarray:
    return np.random.default_rng(3).uniform(-0.4, 1.6, (1, 4000, 3)).astype(np.float32)


def linear(colours: np.ndarray, gamut: str) -> np.ndarray:
    return developed_values(colours, PictureSettings(tone="linear", gamut=gamut))


def test_clipping_is_by_channel(colours: np.ndarray) -> None:
    assert np.array_equal(linear(colours, "clip"), np.clip(colours, 0, 1))


def test_desaturating_keeps_luminance_and_the_direction_from_grey(colours: np.ndarray) -> None:
    shown = linear(colours, "desaturate").astype(np.float64)
    before = colours @ WEIGHTS
    inside = (before > 0) & (before < 1)
    assert inside.mean() > 0.6
    np.testing.assert_allclose((shown @ WEIGHTS)[inside], before[inside], atol=1e-6)
    np.testing.assert_array_equal(shown[before <= 0], 0)
    np.testing.assert_allclose(shown[before >= 1], 1, atol=1e-6)
    given, kept = colours - before[..., None], shown - before[..., None]
    cosine = (given * kept).sum(-1) / (np.linalg.norm(given, axis=-1) * np.linalg.norm(kept, axis=-1) + 1e-12)
    coloured = inside & (np.linalg.norm(kept, axis=-1) > 1e-2)
    assert cosine[coloured].min() > 0.9999


def test_desaturating_goes_no_further_than_it_must(colours: np.ndarray) -> None:
    shown = linear(colours, "desaturate")
    outside = (colours < 0).any(-1) | (colours > 1).any(-1)
    assert np.array_equal(shown[~outside], colours[~outside])
    touches = (shown < 1e-6).any(-1) | (shown > 1 - 1e-6).any(-1)
    assert touches[outside].all()
