"""Errors that a picture reports of itself are those it has: hundreds of renders of small pictures under other seeds."""

import numpy as np
import pytest

from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.rendering.film import TILE, FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from tests.device.probes import open_session
from tests.rendering.pictures import seed_of
from tests.rendering.test_determinism import LENS
from tests.rendering.test_noise import quiet

pytestmark = pytest.mark.slow

SIDE, SPP = 32, 64
WITHIN = 1.959964  # standard errors: 95 %
SCENES = {"pinhole": {}, "lens": {"camera": LENS}}


class Pictures:
    """Independent renders of a scene, and what each reports: arrays over renders first."""

    def __init__(self, name, sampler, count, *, target=None, spp=SPP, by_runs=False):
        scene = change_scene(
            load_scene(quiet() | SCENES[name]),
            film={"resolution": [SIDE, SIDE]},
            render={"sampler": sampler, "layers": ("variance",) if by_runs else ()},
        )
        plan, layout = make_plan(scene), FilmLayout.of(scene.film)
        wavefront = Wavefront(open_session(), plan, layout, scene.render, layout.pixels * 16)  # waves of 16 samples
        wavefront.warm_up()
        done = []
        for k in range(count):
            wavefront.choose_tiles(np.arange(layout.tiles, dtype=np.uint32))
            wavefront.clear()
            wavefront.seed = seed_of(f"{name} {sampler} {k}")
            done.append(render_plan(wavefront, spp=spp, seconds=None, has_lens=plan.camera.has_lens, noise=target))
        self.light = np.array([each.pixels.astype(float) @ LUMINANCE for each in done])
        self.reported = np.array([each.achieved["picture"] for each in done])
        self.variance = np.array([each.variance for each in done], float)
        self.samples = np.array([each.samples for each in done])
        self.worst = np.array([each.noise["worst"] for each in done if each.noise is not None])
        self.sources = {each.achieved["source"] for each in done}

    @property
    def error(self):
        """Root mean square error of a pixel, relative to the mean."""
        return np.sqrt(self.light.var(axis=0, ddof=1).mean()) / self.light.mean()

    def ratio(self):
        """Errors that pictures have over those that they report."""
        return self.error / np.sqrt(np.mean(self.reported**2))

    def coverage_of_means(self, scale=1.0):
        """Share of the pictures whose mean has the truth within 95 % of its interval; pixels are independent."""
        means = self.light.mean(axis=(1, 2))
        width = WITHIN * scale * self.reported * means.mean() / SIDE
        return np.mean(np.abs(means - means.mean()) <= width * np.sqrt(1 - 1 / len(means)))

    def coverage_of_tiles(self, scale=1.0):
        """The same of the means of 8 x 8 pixels."""
        means = by_tile(self.light)
        width = WITHIN * scale * np.sqrt(by_tile(self.variance)) / TILE
        return np.mean(np.abs(means - means.mean(axis=0)) <= width * np.sqrt(1 - 1 / len(means)))

    def errors_of_tiles(self):
        """Relative errors of pixels in each tile: those that there are, and those reported."""
        means = by_tile(self.light)
        own = np.sqrt(by_tile(self.light.var(axis=0, ddof=1))) / means.mean(axis=0)
        return own, np.sqrt(np.mean(by_tile(self.variance) / means**2, axis=0))


def by_tile(values):
    """Return means over tiles of the last two axes."""
    return values.reshape(*values.shape[:-2], SIDE // TILE, TILE, SIDE // TILE, TILE).mean(axis=(-3, -1))


@pytest.mark.parametrize("name", SCENES)
def test_error_from_two_parts_of_independent_samples_is_that_of_the_picture(name):
    pictures = Pictures(name, "independent", 1000)
    assert pictures.sources == {"two parts of the samples"}
    assert 0.95 < pictures.ratio() < 1.05
    assert 0.93 < pictures.coverage_of_means() < 0.97


@pytest.mark.parametrize("name", SCENES)
def test_error_from_runs_of_independent_samples_is_that_of_pictures_and_tiles(name):
    pictures = Pictures(name, "independent", 200, by_runs=True)
    assert pictures.sources == {"runs of samples"}
    assert 0.95 < pictures.ratio() < 1.05
    assert 0.93 < pictures.coverage_of_tiles() < 0.97  # of 3200


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(("by_runs", "least"), [(False, 1 / 1.33), (True, 1 / 1.46)])
def test_error_of_a_lattice_is_reported_too_large_by_what_the_docs_say(name, by_runs, least):
    pictures = Pictures(name, "lattice", 200, by_runs=by_runs)
    assert least < pictures.ratio() < 1
    assert pictures.coverage_of_means() > 0.95


@pytest.mark.parametrize(
    ("sampler", "target", "low", "high"), [("independent", 0.05, 0.95, 1.05), ("lattice", 0.03, 0.65, 1.0)]
)
def test_target_that_is_met_is_met(sampler, target, low, high):
    pictures = Pictures("lens", sampler, 100, target=target, spp=1024)
    own, reported = pictures.errors_of_tiles()
    assert low < np.sqrt(np.mean(own**2) / np.mean(reported**2)) < high
    assert low < pictures.ratio() < high
    assert (own < target * 1.05).all()
    assert (pictures.worst <= target).all()
    assert pictures.samples.std() > 0


def test_errors_reported_too_small_by_a_tenth_are_found():
    """The control."""
    pictures = Pictures("lens", "independent", 200, by_runs=True)
    assert pictures.ratio() / 0.9 > 1.05
    assert pictures.coverage_of_tiles(0.9) < 0.93
