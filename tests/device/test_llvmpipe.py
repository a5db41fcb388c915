"""Work is cut up for a device whose loops end early, Mesa's llvmpipe, so that none does; tried on any device."""

import numpy as np
import pytest

from rptcam_cl.device import session
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import tree_build
from rptcam_cl.rendering.film import STEPS_OF_SAMPLE, FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.rendering.tree_build import build_bvh
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.selfcheck_suite import cavity, picture
from tests.device.probes import open_session
from tests.rendering.trees.meshes import boxes_of, soup
from tests.rendering.trees.trees import check


@pytest.fixture
def limited(monkeypatch):
    """The device of the tests, taken for llvmpipe."""
    monkeypatch.setattr(session, "is_llvmpipe", lambda _: True)
    return open_session()


def test_llvmpipe_is_known_by_its_name():
    class Handle:
        name = "llvmpipe (LLVM 15.0.6, 256 bits)"

    assert session.is_llvmpipe(Handle)
    assert not session.is_llvmpipe(open_session().info.handle)


def test_llvmpipe_gets_work_like_a_gpu(limited):
    assert (limited.kind, limited.lanes, limited.loop_limit) == ("gpu", 1, 65535)
    assert limited.info.type == "cpu"


@pytest.mark.slow
def test_waves_are_short_enough_for_the_loops_and_the_picture_has_the_same_bits(limited, monkeypatch):
    scene = load_scene(cavity(1.0, depth=3) | {"film": {"resolution": [16, 8]}, "render": {"spp": 40, "max_depth": 3}})
    plan = make_plan(scene)
    wavefront = Wavefront(limited, plan, FilmLayout.of(scene.film), scene.render)
    assert wavefront.organisation == "passes"
    assert 1 < wavefront.samples_per_wave * STEPS_OF_SAMPLE <= limited.loop_limit
    short = picture(limited, scene, plan)
    monkeypatch.setattr(Session, "loop_limit", None)
    np.testing.assert_array_equal(short, picture(limited, scene, plan))


def test_trees_are_right_when_built_in_short_loops(limited, monkeypatch):
    lower, upper = boxes_of(soup(3000))
    tree = build_bvh(lower, upper, width=4, leaf_size=4, session=limited)
    check(tree, lower, upper, 4, 4)
    monkeypatch.setattr(tree_build, "STEPS_OF_MOVE", 1)  # all moves in one launch
    at_once = build_bvh(lower, upper, width=4, leaf_size=4, session=limited)
    np.testing.assert_array_equal(tree.blocks, at_once.blocks)
    np.testing.assert_array_equal(tree.children, at_once.children)
