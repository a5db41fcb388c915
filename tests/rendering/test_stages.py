"""The stages of a render, each called alone, and the settings that they share."""

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.api.job import RenderJob
from rptcam_cl.api.options import RenderOptions
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.account import forecast
from rptcam_cl.rendering.checkpoint import read_checkpoint
from rptcam_cl.rendering.film import TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.progressive import NoiseEstimate, TimeLeft, next_end
from rptcam_cl.rendering.several import FilmPart
from tests.rendering.test_world import still_life

SCENE: dict[str, Any] = {
    "film": {"resolution": [8, 6]},
    "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40},
    "objects": [
        {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": {"kind": "matte", "reflectance": 0.5}}
    ],
    "environment": {"kind": "constant", "radiance": 1},
    "exposure": {"mode": "auto"},
}


def test_stages_one_by_one_make_the_picture_of_render() -> None:
    stages: list[str] = []
    settings = RenderOptions(spp=3, seed=5, layers=["depth"], on_progress=lambda state: stages.append(state.stage))
    job = RenderJob.prepare(SCENE, settings)
    assert stages == ["compile"]
    assert job.resolved.scene.exposure.mode != "auto"
    assert job.resolved.metadata["metered_cd_m2"] > 0
    rendering = job.run()
    assert rendering.spp == 3
    image = job.report(rendering)
    whole = rptcam_cl.render(SCENE, spp=3, seed=5, layers=["depth"])
    assert np.array_equal(image.pixels, whole.pixels)
    assert np.array_equal(image["depth"], whole["depth"])
    assert image.metadata == whole.metadata
    assert image.stats.keys() == whole.stats.keys()
    assert image.stats["seconds"].keys() == {"start", "compile", "render", "total"}


def test_settings_do_not_change() -> None:
    with pytest.raises(FrozenInstanceError):
        RenderOptions().spp = 4  # type: ignore[misc]


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("inf"), float("nan")])
def test_time_that_is_none_is_refused(seconds: float) -> None:
    with pytest.raises(InputError, match=r"seconds: is out of range .*allowed: a finite number above 0"):
        RenderOptions(seconds=seconds)


@pytest.mark.parametrize(
    ("given", "most"),
    [({}, 7), ({"seconds": 1.0}, None), ({"noise": 0.1}, 16384), ({"noise": 0.1, "seconds": 1.0}, 16384),
     ({"spp": 5, "seconds": 1.0}, 5), ({"spp": 5, "noise": 0.1}, 5)],
)  # fmt: skip
def test_samples_are_limited_by_what_is_given(given: dict[str, Any], most: int | None) -> None:
    scene = rptcam_cl.load_scene(SCENE | {"render": {"spp": 7}})
    assert RenderOptions(**given).most_spp(scene) == most


SHORT = 0.02  # [s]


@pytest.mark.parametrize(("part", "wave_size"), [(None, 4096), ("2/3", 4096), (None, None)])
def test_samples_launches_and_bytes_are_those_of_the_render(part, wave_size, tmp_path):
    options = {"spp": 64, "size": (50, 37), "part": part, "wave_size": wave_size}
    settings = RenderOptions(**options, checkpoint=tmp_path / "a.rpck", resume=True)
    prepared = RenderJob.prepare(still_life(), settings)
    before = prepared.wavefront.launches
    rendering = prepared.run()
    launches = prepared.wavefront.launches - before
    prepared.saver.end(rendering.state, keep=True)
    saved = sum(array.nbytes for array in read_checkpoint(tmp_path / "a.rpck").arrays.values())

    planned = RenderJob.prepare(still_life(), RenderOptions(**options))
    found = forecast(planned.wavefront, 0, 64, planned.options.film_part, SHORT)
    assert found.samples == rendering.new_samples == int(rendering.samples.sum(dtype=np.uint64))
    assert found.launches == pytest.approx(launches, rel=0.15)  # the last waves of a render are shorter
    assert found.saved_bytes == saved
    assert found.seconds > 0
    assert not found.at_most


def test_time_and_launches_grow_with_the_samples_and_shrink_with_the_part():
    settings = RenderOptions(size=(50, 37), wave_size=4096)
    plans = [
        forecast(RenderJob.prepare(still_life(), settings).wavefront, first, end, part, SHORT)
        for first, end, part in ((0, 64, FilmPart()), (0, 640, FilmPart()), (600, 640, FilmPart(1, 5)))
    ]
    assert plans[1].launches == pytest.approx(10 * plans[0].launches, rel=0.1)
    assert plans[2].launches < plans[0].launches
    assert plans[1].samples == 10 * plans[0].samples == 640 * 50 * 37


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
