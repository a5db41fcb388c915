"""Boxes round the ways of things that move hold them at every moment, and are not much larger."""

import numpy as np
import pytest

from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene
from tests.rendering.motion.pictures import PINHOLE, scene_with
from tests.support.cases import fast


def movements_of(frames, eye=(0, 0, 0)):
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": {"kind": "mirror"}, "motion": frames}
    camera = PINHOLE | {"eye": list(eye), "target": [eye[0], eye[1], eye[2] - 1]}
    scene = load_scene(scene_with([ball], camera, {"time_s": 1}))
    return make_plan(scene).movements, scene.objects[0].trajectory


def way(turns, travel=(0, 0, 0), middle=()):
    frames = [{"time_s": 0}, *middle, {"time_s": 1, "translate": list(travel)}]
    frames[-1]["rotate"] = {"axis": [1, 2, -1], "degrees": 360 * turns}
    return frames


def box_of_points(places, points):
    """What `Places.box` makes of points as a body (n, 3)."""
    there = np.einsum("pij,nj->pni", places.matrices[:, :3, :3], points) + places.matrices[:, None, :3, 3]
    return places.box(there.min(axis=1), there.max(axis=1), (points.min(axis=0), points.max(axis=0)))


WAYS = {
    "straight": way(0, (3, -1, 2)),
    "part of a turn": way(0.3),
    "a screw": way(2.7, (3, -1, 2)),
    "many turns": way(500, (1, 0, 0)),
    "keyframes": way(
        -1.2, (0, 1, 0), [{"time_s": 0.4, "translate": [1, 1, 1], "rotate": {"axis": [0, 0, 1], "degrees": 99}}]
    ),
}


@pytest.mark.parametrize("name", fast(["a screw"], WAYS))
def test_box_holds_the_body_at_every_moment(name):
    movements, trajectory = movements_of(WAYS[name])
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 1, (20, 3)) + rng.uniform(-2, 2, 3)
    low, high = box_of_points(movements.places(0), points)
    seen = np.concatenate(
        [points @ trajectory.at(t)[:3, :3].T + trajectory.at(t)[:3, 3] for t in [*rng.uniform(0, 1, 3000), 0, 1]]
    )
    assert (seen >= low).all()
    assert (seen <= high).all()
    size = np.ptp(seen, axis=0)
    assert ((high - low) <= 1.02 * size + 1e-3).all() or name == "many turns"


def test_device_has_the_way_of_the_scene_at_every_moment():
    """The segments, evaluated as the kernels do it, against the keyframes; far from the origin of the scene as well."""
    for name, eye in (("a screw", (0, 0, 0)), ("keyframes", (5, -3, 2)), ("straight", (1e6, 0, 0))):
        movements, trajectory = movements_of(WAYS[name], eye)
        first, count = movements.of_primitive[0]
        point = np.array([0.3, -0.2, 0.5])
        rest = trajectory.at(0)
        for t in np.linspace(0, 1, 41)[:-1]:
            segment = [segment for segment in movements.segments[first : first + count] if segment["pivot"][3] <= t][-1]
            share = (t - segment["pivot"][3]) * segment["shift"][3]
            turn = _turn(segment["axis"][:3], 2 * np.pi * share * segment["travel"][3]) @ _matrix(segment["turn"])
            at_rest = rest[:3, :3] @ point + rest[:3, 3] - eye
            pivot = segment["pivot"][:3]
            found = pivot + segment["shift"][:3] + share * segment["travel"][:3] + turn @ (at_rest - pivot)
            expected = trajectory.at(t)[:3, :3] @ point + trajectory.at(t)[:3, 3] - eye
            np.testing.assert_allclose(found, expected, atol=2e-6, rtol=2e-7)


def _turn(axis, angle):
    cross = np.cross(np.eye(3), axis.astype(float))
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _matrix(quaternion):
    x, y, z, w = quaternion.astype(float)
    return _turn(
        np.array([x, y, z]) / max(np.linalg.norm([x, y, z]), 1e-30), 2 * np.arctan2(np.linalg.norm([x, y, z]), w)
    )
