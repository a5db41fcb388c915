"""The limit of samples: off by default, exact where it is known what it takes, and owned up to."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from tests.rendering.pictures import lamp, looking, scene_of
from tests.rendering.test_world import still_life
from tests.support.cases import slow

SIZE = {"size": (48, 32)}


def wall(radiance):
    """A lamp that fills the picture: every sample is its radiance."""
    sheet = {"shape": "plane", "point": [0, 0, 0], "normal": [0, -1, 0], "material": lamp(radiance)}
    return scene_of([sheet], looking([0, -3, 0], [0, 0, 0]), depth=1)


def rendered(scene, limit, **options):
    return rptcam_cl.render(rptcam_cl.load_scene(scene, [f"render.clamp={limit}"] if limit else []), **options)


def test_bright_samples_keep_their_colour_and_what_went_is_told():
    image = rendered(wall([8.0, 4.0, 0.0]), 2.0, spp=5)
    np.testing.assert_allclose(np.asarray(image), np.broadcast_to([2.0, 1.0, 0.0], (32, 32, 3)), rtol=1e-6)
    assert image.stats["clamp"]["limit"] == 2
    assert image.stats["clamp"]["removed_share"] == pytest.approx(0.75, rel=1e-6)
    assert image.metadata["clamp"] == "biased: samples above 2 scaled down, 75.00% of the light removed"


@pytest.mark.parametrize("limit", [slow(8.0), 1e6])
def test_limit_that_nothing_exceeds_changes_no_bit(limit):
    plain, limited = (rendered(wall([8.0, 4.0, 0.0]), each, spp=5) for each in (None, limit))
    np.testing.assert_array_equal(np.asarray(plain), np.asarray(limited))
    assert limited.stats["clamp"]["removed_share"] == 0
    assert "clamp" not in plain.stats
    assert "clamp" not in plain.metadata


def test_what_is_missing_is_the_share_that_is_told():
    plain, limited = (np.asarray(rendered(still_life(), each, spp=64, **SIZE)) for each in (None, 2.0))
    share = rendered(still_life(), 2.0, spp=64, **SIZE).stats["clamp"]["removed_share"]
    assert share > 0.01
    assert 1 - limited.sum(dtype=float) / plain.sum(dtype=float) == pytest.approx(share, rel=1e-4)
    assert (limited <= plain * (1 + 1e-6)).all()


def test_wave_size_and_interruption_do_not_change_a_bit(tmp_path):
    state = tmp_path / "a.rpck"
    whole = rendered(still_life(), 2.0, spp=20, **SIZE)
    rendered(still_life(), 2.0, spp=7, checkpoint=state, resume=True, **SIZE)
    part = rendered(still_life(), 2.0, spp=20, checkpoint=state, resume=True, wave_size=4096, **SIZE)
    np.testing.assert_array_equal(np.asarray(whole), np.asarray(part))
    assert part.stats["clamp"] == whole.stats["clamp"]


def test_ranges_of_samples_add_up_what_the_limit_took(tmp_path):
    parts = [tmp_path / f"{first}.rpck" for first in (0, 1, 4)]
    for path, samples in zip(parts, ((0, 1), (1, 4), (4, 5)), strict=True):
        rendered(wall([8.0, 4.0, 0.0]), 2.0, samples=samples, checkpoint=path)
    assert rptcam_cl.merge(parts).stats["clamp"]["removed_share"] == pytest.approx(0.75, rel=1e-6)


@pytest.mark.parametrize("limit", [0, -1, ".inf", ".nan"])
def test_wrong_limit_is_refused(limit):
    with pytest.raises(InputError, match=r"render\.clamp"):
        rptcam_cl.load_scene(still_life(), [f"render.clamp={limit}"])
