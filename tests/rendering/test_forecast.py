"""What a plan promises, against the render itself; its time is measured, so no test can hold it to that."""

import numpy as np
import pytest

from rptcam_cl.api.job import RenderJob, RenderOptions
from rptcam_cl.rendering.account import forecast
from rptcam_cl.rendering.checkpoint import read_checkpoint
from rptcam_cl.rendering.several import FilmPart
from tests.rendering.test_world import still_life

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
