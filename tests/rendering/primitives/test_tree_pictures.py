"""Pictures are the same, to the last bit, with the tree over primitives and without."""

from dataclasses import replace

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.rendering import culling, tree_build
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.load import load_scene
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


@pytest.mark.slow
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
    for count in (culling.BREAK_EVEN - 1, culling.BREAK_EVEN):
        rptcam_cl.render(cloud(count), spp=1)
    assert built == [culling.BREAK_EVEN]


ROOM = {
    "film": {"resolution": [48, 32]},
    "camera": {"kind": "pinhole", "eye": [0, -3.5, 0.2], "target": [0, 0, 0], "up": [0, 0, 1], "fov_degrees": 45},
    "materials": {
        "white": {"kind": "matte", "reflectance": [0.7, 0.6, 0.5]},
        "mirror": {"kind": "mirror", "reflectance": 0.9},
        "lamp": {"kind": "emissive", "radiance": [9, 8, 4]},
    },
    "objects": [
        {"shape": "rectangle", "corner": [-1, -1, -1], "edge_u": [2, 0, 0], "edge_v": [0, 2, 0.3], "material": "white"},
        {"shape": "rectangle", "corner": [-1, 1, -1], "edge_u": [2, 0.4, 0], "edge_v": [0, 0, 2], "material": "mirror"},
        {"shape": "disk", "center": [0.2, 0, 0.9], "normal": [0.1, 0, -1], "radius": 0.4, "material": "lamp"},
        {
            "shape": "box",
            "min": [-0.6, -0.3, -0.9],
            "max": [-0.1, 0.3, 0.1],
            "material": "white",
            "transform": [{"rotate": {"axis": [0.1, 0.2, 1], "degrees": 20}}],
        },
        {"shape": "sphere", "center": [0.5, 0, -0.4], "radius": 0.35, "material": {"kind": "dielectric", "index": 1.5}},
    ],
}


def film_of(session, plan, scene):
    wavefront = Wavefront(session, plan, FilmLayout.of(scene.film), scene.render)
    for wave in wavefront.waves(0, 8):
        wavefront.enqueue(*wave)
    wavefront.finish()
    return wavefront.planes()


def painted(objects):
    colours = {"kind": "checker", "even": 0.7, "odd": 0.2, "scale": [5, 3]}
    return [entry | {"material": {"kind": "matte", "reflectance": colours}} for entry in objects]


@pytest.mark.slow
@pytest.mark.parametrize(
    "objects",
    [slow(ROOM["objects"]), painted(ROOM["objects"][:1]) + ROOM["objects"][1:], slow(painted(ROOM["objects"]))],
    ids=["plain", "painted floor", "all painted"],
)
def test_tables_of_few_primitives_change_no_bit(session, objects):
    lamp = ROOM["objects"][2]
    scene = load_scene(ROOM | {"objects": [*objects, lamp]})
    plan = make_plan(scene)
    assert plan.facts["FEW_PRIMITIVES"] == 1
    one_by_one = replace(plan, facts={**plan.facts, "FEW_PRIMITIVES": 0})
    film = film_of(session, plan, scene)
    assert film[:3].max() > 0
    np.testing.assert_array_equal(film, film_of(session, one_by_one, scene))


def piece(x, width, material):
    edges = {"edge_u": [0, 2, 0], "edge_v": [width, 0, 0]}
    return {"shape": "rectangle", "corner": [x, -1, 1], **edges, "material": material}


def test_flats_that_share_a_plane_look_as_if_each_had_its_own(session):
    ceiling = [piece(-1, 0.7, "white"), piece(-0.3, 0.6, "lamp"), piece(0.3, 0.7, "white")]
    scene = load_scene(ROOM | {"objects": [ROOM["objects"][0], *ceiling, *ROOM["objects"][3:]]})
    plan = make_plan(scene)
    assert plan.primitives["instance"].tolist() == [0, 1, 3, 0, 0, 0]  # sphere, floor, ceiling, box
    alone = plan.primitives.copy()
    alone["instance"] = [0, 1, 1, 1, 1, 0]
    film = film_of(session, plan, scene)
    assert film[:3].max() > 0
    np.testing.assert_array_equal(film, film_of(session, replace(plan, primitives=alone), scene))


def test_of_two_at_the_same_place_the_first_is_met():
    disk, box, sphere = ROOM["objects"][2:]
    twins = [
        shape | {"material": {"kind": "matte", "reflectance": share}}
        for shape in (disk | {"normal": [0, -1, 0]}, box, sphere)
        for share in (0.2, 0.8)
    ]
    image = rptcam_cl.render(ROOM | {"objects": twins, "materials": {}}, spp=1, layers=["object_id"])
    assert set(np.unique(image["object_id"])) == {-1, 0, 2, 4}
