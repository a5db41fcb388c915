"""Pictures are the same, to the last bit, with the tree over primitives and without."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.rendering import scene_buffers, tree_build
from rptcam_cl.studies.selfcheck import LAMP, MATTE, NET
from tests.rendering.pictures import looking, scene_of
from tests.rendering.primitives.trees import with_tree
from tests.support.cases import slow

GLASS = {"kind": "dielectric", "index": 1.5}
MIRROR = {"kind": "mirror", "reflectance": 0.9}


def cloud(count, **rest):
    """Balls, panes with holes and lamps over a floor."""
    rng = np.random.default_rng(5)
    items = []
    for index, center in enumerate(rng.uniform([-2, -2, 0.1], [2, 2, 3], (count, 3)).tolist()):
        ball = {"shape": "sphere", "center": center, "radius": 0.15, "material": (MATTE, GLASS, MIRROR)[index % 3]}
        pane = {"shape": "disk", "center": center, "normal": [1, 2, 3], "radius": 0.2, "material": NET}
        lamp = {"shape": "sphere", "center": center, "radius": 0.1, "material": LAMP}
        items.append(lamp if index % 20 == 0 else pane if index % 4 == 0 else ball)
    floor = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE}
    environment = {"kind": "constant", "radiance": 0.3}
    camera = looking((0, -8, 3), (0, 0, 1.2))
    return scene_of([floor, *items], camera, depth=6, resolution=(64, 48), environment=environment, **rest)


@pytest.mark.parametrize("roulette", [slow(0), 4])
def test_picture_does_not_depend_on_the_tree(monkeypatch, roulette):
    scene = cloud(90, roulette=roulette)
    films = []
    for wanted in (True, False):
        with_tree(monkeypatch, wanted)
        films.append(np.asarray(rptcam_cl.render(scene, spp=16, seed=3)))
    assert films[0].tobytes() == films[1].tobytes()
    assert films[0].std() > 0.05


@pytest.mark.slow
def test_scene_gets_a_tree_from_the_break_even_on(monkeypatch, tmp_path):
    monkeypatch.setenv("RPTCAM_CACHE_DIR", str(tmp_path))  # where no tree is kept yet
    built = []
    build = tree_build.tree_of_few
    monkeypatch.setattr(tree_build, "tree_of_few", lambda *a: built.append(len(a[0])) or build(*a))
    for count in (scene_buffers.BREAK_EVEN - 1, scene_buffers.BREAK_EVEN):
        rptcam_cl.render(cloud(count), spp=1)
    assert built == [scene_buffers.BREAK_EVEN]
