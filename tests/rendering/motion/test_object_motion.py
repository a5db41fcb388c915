"""Objects that move during the exposure."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import tracer
from tests.device.probes import open_session
from tests.rendering.motion.pictures import BALL, FLOOR, GREY, PAIRS, PINHOLE, exposures, film, scene_with, still_mean
from tests.rendering.pictures import lamp
from tests.rendering.primitives.trees import with_tree
from tests.support.cases import slow
from tests.support.statistics import assert_same_tiles

CHECKS = {"kind": "matte", "reflectance": {"kind": "checker", "even": 0.9, "odd": 0.1, "scale": [4, 4]}}
GLASS = {"kind": "dielectric", "index": 1.5}
CUBE = {
    "shape": "mesh",
    "vertices": [[x, y, z] for x in (-0.5, 0.5) for y in (0.2, 1.2) for z in (-0.5, 0.5)],
    "faces": [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]],
    "material": GREY,
}
SHAPES = {
    "sphere": BALL | {"material": CHECKS},
    "ellipsoid": BALL | {"transform": [{"scale": [1, 0.5, 0.7]}], "material": CHECKS},
    "box": {"shape": "box", "min": [-1, 0.2, -0.5], "max": [0.5, 1.5, 0.7], "material": CHECKS},
    "cylinder": {"shape": "cylinder", "base": [0, 0.3, 0], "top": [1, 1, 0], "radius": 0.5, "material": CHECKS},
    "cone": {"shape": "cone", "base": [0, 0.3, 0], "apex": [0, 2, 0.3], "radius": 0.8, "material": CHECKS},
    "disk": {"shape": "disk", "center": [0, 1, 0], "normal": [0.3, 0.2, 1], "radius": 1, "material": CHECKS},
    "rectangle": {
        "shape": "rectangle", "corner": [-1, 0, 0], "edge_u": [2, 0, 0], "edge_v": [0, 2, 0.5],
        "material": {"kind": "matte", "reflectance": 0.7, "opacity": 0.6},
    },
    "mesh": CUBE,
}  # fmt: skip
# A keyframe in the middle; the turns there are about one axis first, then from one rotation to another.
WAY = [
    {"time_s": 0, "rotate": {"axis": [0, 2, 2], "degrees": 10}},
    {"time_s": 1, "rotate": {"axis": [0, 1, 1], "degrees": 190}, "translate": [0.6, 0.4, 0]},
    {"time_s": 2, "rotate": {"axis": [1, 0, 0], "degrees": 30}, "translate": [0.6, 0, 1]},
]
STRAIGHT = [{"time_s": 0}, {"time_s": 2, "translate": [1, 0.5, -0.5]}]


def rotated(axis, degrees):
    return {"rotate": {"axis": list(axis), "degrees": degrees}}


def place_at(t):
    """Steps of the transform that WAY has at a moment; the turn between two rotations by its matrices."""
    if t <= 1:
        return [rotated((0, 1, 1), 10 + 180 * t), {"translate": [0.6 * t, 0.4 * t, 0]}]
    first, second = np.eye(3), np.eye(3)
    for matrix, (axis, degrees) in ((first, ((0, 1, 1), 190)), (second, ((1, 0, 0), 30))):
        unit = np.divide(axis, np.linalg.norm(axis))
        cross = np.cross(np.eye(3), unit)
        angle = np.radians(degrees)
        matrix[:] = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    between = second @ first.T
    angle = np.arccos((np.trace(between) - 1) / 2)
    axis = np.array([between[2, 1] - between[1, 2], between[0, 2] - between[2, 0], between[1, 0] - between[0, 1]])
    turn = rotated(axis, float(np.degrees((t - 1) * angle)))
    return [rotated((0, 1, 1), 190), turn, {"translate": [0.6, 0.8 * (1 - t / 2), t - 1]}]


def moved(item, steps):
    return item | {"transform": [*item.get("transform", []), *steps]}


FLAT = slow(("box", "disk", "rectangle", "mesh"))  # test_moments.py has each of them


@pytest.mark.slow
@pytest.mark.parametrize("names", [("sphere", "ellipsoid", "cylinder", "cone"), FLAT], ids=["round", "flat"])
def test_exposure_is_the_mean_of_still_pictures(session, names):
    """Four shapes side by side, each on the same way."""
    objects = [
        moved(SHAPES[name], [{"scale": 0.5}, {"translate": [k % 2 - 0.6, k // 2 * 0.7, 0]}])
        for k, name in enumerate(names)
    ]
    blurred = scene_with([FLOOR, *(item | {"motion": WAY} for item in objects)], shutter={"time_s": 2})
    blurred = exposures(blurred, session, names[0], spp=64)

    def still(t):
        return scene_with([FLOOR, *(moved(item, place_at(t)) for item in objects)])

    assert_same_tiles(blurred, still_mean(still, (0, 2), session, f"still {names}", count=2, strata=24, spp=8))
    with pytest.raises(AssertionError):
        assert_same_tiles(blurred, exposures(still(1), session, "middle", spp=64))


@pytest.mark.slow
def test_many_objects_on_ways_of_their_own(session):
    """Planes, shadows, mirrors, glass and lamps that move, some things that stand, in one scene."""
    mirror = {"kind": "mirror", "reflectance": 0.9}
    items = [
        (FLOOR | {"material": CHECKS}, {"translate": [0.3, 0.2, 0]}),
        (BALL | {"radius": 0.5, "material": mirror}, {"translate": [1, 0, 0.5]}),
        (BALL | {"radius": 0.4, "center": [-1, 0.5, 1], "material": GLASS}, {"translate": [0, 0.5, 0]}),
        (BALL | {"radius": 0.2, "center": [0.5, 1.8, 1], "material": lamp(8.0)}, {"translate": [-1, 0, 0]}),
        (CUBE | {"transform": [{"scale": 0.5}]}, {"translate": [-1.2, 0, 0.5]}),
        (CUBE | {"transform": [{"scale": 0.4}, {"translate": [1, 0, 1]}]}, None),
    ]
    frames = [([] if step is None else [{"time_s": 0}, {"time_s": 1, **step}]) for _, step in items]
    objects = [item | {"motion": way} for (item, _), way in zip(items, frames, strict=True)]
    blurred = exposures(scene_with(objects, shutter={"time_s": 1}), session, "many", spp=256)

    def still(t):
        steps = [[] if s is None else [{"translate": (t * np.array(s["translate"])).tolist()}] for _, s in items]
        return scene_with([moved(item, step) for (item, _), step in zip(items, steps, strict=True)])

    assert_same_tiles(blurred, still_mean(still, (0, 1), session, "still many", count=2, strata=16, spp=32))


@pytest.mark.parametrize("frames", [WAY, STRAIGHT])
def test_object_that_holds_while_the_shutter_is_open_changes_no_bit(session, frames):
    for open_s, steps in ((-3, rotated((0, 1, 1), 10)), (5, frames[-1])):
        step = [{key: step} for key, step in steps.items() if key in ("rotate", "translate")]
        if frames is STRAIGHT and open_s < 0:
            step = []
        held = scene_with([FLOOR, SHAPES["box"] | {"motion": frames}], shutter={"open_s": open_s, "time_s": 1})
        still = scene_with([FLOOR, moved(SHAPES["box"], step)])
        assert film(held, session).tobytes() == film(still, session).tobytes()


@pytest.mark.slow
def test_camera_that_moves_is_the_world_that_moves_back(session):
    """Each path has the same time, so that pictures agree pixel by pixel."""
    beside = moved(CUBE, [{"translate": [1.2, 0.1, 0.3]}])  # where two faces lie in one plane, rounding decides
    objects = [FLOOR | {"material": CHECKS}, SHAPES["box"], beside]
    there = {"eye": [0.4, 1.2, 4.5], "target": [0.4, 1.2, -0.5]}
    camera = PINHOLE | {"motion": [{"time_s": 0}, {"time_s": 1, **there}]}
    back = [{"time_s": 0}, {"time_s": 1, "translate": [-0.4, -0.2, 0.5]}]
    by_camera = film(scene_with(objects, camera, {"time_s": 1}), session)
    by_objects = film(scene_with([item | {"motion": back} for item in objects], shutter={"time_s": 1}), session)
    assert np.isclose(by_camera, by_objects, rtol=1e-4, atol=1e-5).mean() > 0.99
    begin = film(scene_with(objects, camera, {"time_s": 1e-6}), session)
    assert not np.isclose(by_camera, begin, rtol=1e-2).mean() > 0.8


@pytest.mark.slow
def test_mesh_and_primitive_on_the_same_way_agree(session):
    box = {"shape": "box", "min": [-0.5, 0.2, -0.5], "max": [0.5, 1.2, 0.5], "material": GREY}
    pictures = [
        film(scene_with([FLOOR, item | {"motion": WAY}], shutter={"time_s": 2}), session) for item in (box, CUBE)
    ]
    assert np.isclose(*pictures, rtol=1e-3, atol=1e-4).mean() > 0.95


@pytest.mark.slow
def test_far_from_the_origin_of_the_scene(session):
    there = np.array([3e5, -1e5, 2e5])

    def at(point):
        return (there + point).tolist()

    objects = [FLOOR, SHAPES["box"] | {"motion": STRAIGHT}, CUBE | {"motion": STRAIGHT}]
    near = film(scene_with(objects, shutter={"time_s": 2}), session)
    camera = PINHOLE | {"eye": at([0, 1, 5]), "target": at([0, 1, 0])}
    away = [item | {"transform": [{"translate": there.tolist()}]} for item in objects]
    far = film(scene_with(away, camera, {"time_s": 2}), session)
    assert np.isclose(near, far, rtol=1e-3, atol=1e-4).mean() > 0.95
    # a turn is about the origin of the object; its motion takes it there. What does not turn is as exact beside it
    spin = [{"time_s": 0}, {"time_s": 2, "rotate": {"axis": [0, 1, 0], "degrees": 400}}]
    near = film(scene_with([*objects, CUBE | {"motion": spin}], shutter={"time_s": 2}), session)
    spin = [frame | {"translate": there.tolist()} for frame in spin]
    far = film(scene_with([*away, CUBE | {"motion": spin}], camera, {"time_s": 2}), session)
    assert np.isclose(near, far, rtol=1e-3, atol=1e-4).mean() > 0.95


@pytest.mark.parametrize("item", [CUBE | {"material": GLASS}, *map(slow, (BALL | {"material": GLASS}, SHAPES["cone"]))])
def test_no_light_is_lost_in_a_white_world(session, item):
    """A surface that a path leaves is not met again by rounding, whatever its way."""
    whole = item["material"] if item["material"] is GLASS else {"kind": "mirror", "reflectance": 1.0}
    white = {"environment": {"kind": "constant", "radiance": 1.0}, "render": {"roulette_depth": 0}}
    spin = [{"time_s": 0}, {"time_s": 1, "rotate": {"axis": [1, 2, 3], "degrees": 1000}, "translate": [0.5, 0, 0.5]}]
    scene = scene_with([item | {"material": whole, "motion": spin}], shutter={"time_s": 1}, depth=4000, **white)
    picture = film(scene, session, spp=64)
    np.testing.assert_allclose(picture, 1, rtol=2e-5)


def test_tree_over_primitives_changes_no_bit(session, monkeypatch):
    rng = np.random.default_rng(7)
    kinds = [name for name in SHAPES if name != "mesh"]
    objects = []
    for k in range(63):
        turn = {"axis": rng.normal(size=3).tolist(), "degrees": float(rng.uniform(-900, 900))}
        start, end = rng.uniform([-2, 0, -2], [2, 2, 2], (2, 3)).tolist()
        frames = [{"time_s": 0, "translate": start}, {"time_s": 1, "translate": end, "rotate": turn}]
        item = SHAPES[kinds[k % len(kinds)]]
        steps = [*item.get("transform", []), {"scale": 0.15}]
        objects.append(item | {"transform": steps} | ({"motion": frames} if k % 4 else {}))
    films = []
    for wanted in (True, False):
        with_tree(monkeypatch, wanted)
        films.append(film(scene_with(objects, shutter={"time_s": 1}), session, spp=8))
    assert films[0].tobytes() == films[1].tobytes()
    assert films[0].std() > 0.01


@pytest.mark.slow
def test_meshes_that_share_triangles_go_their_own_ways(session):
    """Two that move, one that stands: at one moment they are where they should be."""
    side = 4
    rows, columns = np.mgrid[: side + 1, : side + 1].reshape(2, -1)
    vertices = np.stack([columns / side - 0.5, rows / side, 0.1 * np.sin(9 * columns / side)], axis=1).tolist()
    first = [r * (side + 1) + c for r in range(side) for c in range(side)]
    faces = [[k, k + 1, k + side + 2, k + side + 1] for k in first]
    named = {"sheet": {"vertices": vertices, "faces": faces}}
    sheet = {"shape": "mesh", "mesh": "sheet", "material": GREY}
    ways = [[{"time_s": 0}, {"time_s": 1, "translate": [0.5, 0, 0.5]}], [], [{"time_s": 0}, WAY[1]]]

    def placed(k):
        return [{"translate": [k - 1.0, 0.3, 0]}]

    objects = [FLOOR, *(sheet | {"transform": placed(k), "motion": way} for k, way in enumerate(ways))]
    t = 0.37
    steps = [
        [{"translate": [0.5 * t, 0, 0.5 * t]}],
        [],
        [rotated((0, 1, 1), 190 * t), {"translate": [0.6 * t, 0.4 * t, 0]}],
    ]
    still = [FLOOR, *(sheet | {"transform": placed(k) + step} for k, step in enumerate(steps))]
    still = exposures(scene_with(still, meshes=named), session, "still sheets", spp=64)
    moment = scene_with(objects, shutter={"open_s": t, "time_s": 1e-6}, meshes=named)
    assert_same_tiles(exposures(moment, session, "sheets", spp=64), still)
    earlier = moment | {"shutter": {"open_s": t - 0.1, "time_s": 1e-6}}
    with pytest.raises(AssertionError):
        assert_same_tiles(exposures(earlier, session, "earlier", spp=64), still)


@pytest.mark.slow  # single lanes in passes are in `device/test_gpu_way.py`
@pytest.mark.parametrize(("lanes", "organisation"), PAIRS)
def test_passes_and_stream_and_every_width_agree(session, lanes, organisation, monkeypatch):
    objects = [FLOOR, SHAPES["rectangle"] | {"motion": WAY}, CUBE | {"motion": WAY}, BALL | {"motion": STRAIGHT}]
    scene = scene_with(
        objects, shutter={"time_s": 2}, lights=[{"kind": "point", "position": [2, 4, 2], "intensity": 9}]
    )
    plain = film(scene, session)
    monkeypatch.setattr(Session, "lanes", lanes)
    monkeypatch.setattr(tracer, "ORGANISATION", {"cpu": organisation, "gpu": organisation})
    assert np.isclose(film(scene, open_session()), plain, rtol=1e-4, atol=1e-5).mean() > 0.95


@pytest.mark.slow
def test_interruption_changes_no_bit(session, tmp_path):
    scene = scene_with([FLOOR, CUBE | {"motion": WAY}], shutter={"time_s": 1, "kind": "rolling", "readout_s": 1})
    whole = film(scene, session, spp=9)
    film(scene, session, spp=4, checkpoint=tmp_path / "a.rpck", resume=True)
    assert film(scene, session, spp=9, checkpoint=tmp_path / "a.rpck", resume=True).tobytes() == whole.tobytes()
    assert film(scene, session, spp=9, wave_size=512).tobytes() == whole.tobytes()


def test_lamp_that_moves_is_found_by_paths_and_said_to_be_noisy(session):
    shining = BALL | {"material": lamp(1.0), "name": "lamp"}
    moving = rptcam_cl.load_scene(scene_with([FLOOR, shining | {"motion": STRAIGHT}], shutter={"time_s": 2}))
    assert any("objects[1] shines and moves: light sampling leaves it out" in text for text in moving.warnings)
    still = rptcam_cl.load_scene(scene_with([FLOOR, shining | {"motion": STRAIGHT}], shutter={"open_s": 9}))
    assert not any("moves" in text for text in still.warnings)


@pytest.mark.slow
def test_layers_hold_means_over_the_exposure(session):
    """A wall that comes nearer by 1 m and turns by 90 degrees from one side to the other."""
    wall = {"shape": "rectangle", "corner": [-30, -30, 0], "edge_u": [60, 0, 0], "edge_v": [0, 60, 0], "material": GREY}
    near = wall | {"motion": [{"time_s": 0}, {"time_s": 1, "translate": [0, 0, 1]}]}
    turning = [{"time_s": t, "rotate": {"axis": [0, 1, 0], "degrees": d}} for t, d in ((0, -45), (1, 45))]
    layers = ["depth", "normal", "uv"]
    image = rptcam_cl.render(scene_with([near], shutter={"time_s": 1}), spp=64, layers=layers, device=session)
    np.testing.assert_allclose(image["depth"], 4.5, atol=1 / 64)
    scene = scene_with([wall | {"motion": turning}], shutter={"time_s": 1})
    image = rptcam_cl.render(scene, spp=64, layers=layers, device=session)
    middle = image["normal"][8:16, 12:20].mean(axis=(0, 1))
    np.testing.assert_allclose(middle / np.linalg.norm(middle), [0, 0, 1], atol=0.02)
    assert np.isfinite(image["uv"]).all()
