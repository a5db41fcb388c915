"""What a configuration is asked for by makes the scene that was measured."""

from pathlib import Path

import pytest

from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.tiers import choose_camera
from rptcam_cl.studies.tradeoff_errors import AS_IT_IS
from rptcam_cl.studies.tradeoff_runs import ladder, mark, most_accurate

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
SCENES = [
    pytest.param("sunny_sixteen.yaml", [], marks=pytest.mark.slow),
    ("still_life.yaml", ["render.sampler=independent", "render.clamp=10"]),
    ("paper/figure_4.yaml", ["camera.pupil=thick", "camera.accuracy=auto"]),
]


def picture(scene):
    """What two scenes of the same picture have in common."""
    scene = choose_camera(scene).scene
    return mark(make_plan(scene), scene.render), scene.render.clamp, scene.render.sampler


@pytest.mark.parametrize(("name", "overrides"), SCENES)
def test_scene_that_is_set_so_is_the_one_that_was_measured(name, overrides):
    found = ladder(load_scene(EXAMPLES / name, overrides))[0]
    measured = {each.name: picture(each.scene) for each in found}
    assert len(found) > 5 and len(set(measured.values())) > 2  # the comparison can tell
    for configuration in found:
        asked = load_scene(EXAMPLES / name, [*overrides, *configuration.settings])
        assert picture(asked) == measured[configuration.name], configuration.name
        if configuration.name == AS_IT_IS:
            assert configuration.settings == ()


def test_same_way_is_asked_for_by_what_is_shorter():
    scene = load_scene(EXAMPLES / "sunny_sixteen.yaml")
    by_name = {each.name: each for each in ladder(scene)[0]}
    both = by_name["spectrum: rgb"].with_name_of(by_name[AS_IT_IS])
    assert by_name["spectrum: rgb"].settings and both.settings == ()
    assert both.same_as == (AS_IT_IS,)
    assert by_name["thick lens"].settings == ("camera.kind=thick_lens", "spectrum.lens=on")


def test_full_traces_every_surface_whatever_the_scene_leaves_out():
    cheap = [
        "camera.rays=fitted",
        "camera.pupil=rear",
        "camera.accuracy=auto",
        "render.clamp=3",
        "render.sampler=independent",
    ]
    full = most_accurate(load_scene(EXAMPLES / "sunny_sixteen.yaml", cheap)).scene
    assert (full.camera.rays, full.camera.pupil, full.camera.accuracy) == ("traced", "auto", None)
    assert (full.render.clamp, full.render.sampler) == (None, "lattice")
