"""The way of everything that moves while the shutter is open, in metres about the eye."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.geometry.movement import Movements
from rptcam_cl.plan.primitives import Primitive
from rptcam_cl.records import LEG
from rptcam_cl.scene.motion import Course, moments, quaternion_of
from rptcam_cl.scene.scene import Scene


def pack_movements(scene: Scene, primitives: Sequence[Primitive]) -> Movements:
    """Return the legs of the primitives that move; those of one object share them."""
    of_primitive = np.zeros((max(len(primitives), 1), 2), np.int32)
    legs: list[NDArray[np.void]] = []
    place_of: dict[int, tuple[int, int]] = {}
    count = 0
    for index, primitive in enumerate(primitives):
        if primitive.course is None:
            continue
        if primitive.object not in place_of:
            legs.append(_legs(primitive.course, scene))
            place_of[primitive.object] = count, len(legs[-1])
            count += len(legs[-1])
        of_primitive[index] = place_of[primitive.object]
    return Movements(np.concatenate(legs) if legs else LEG.zeros(1), of_primitive)


def _legs(course: Course, scene: Scene) -> NDArray[np.void]:
    begin, end = scene.shutter.span_s
    times = moments(course.frames, begin, end)
    places = [course.at(time) for time in times]
    unit, rest = scene.metres_per_unit, places[0]
    legs = LEG.zeros(len(times) - 1)
    for leg, (t0, t1), (first, second) in zip(legs, pairwise(times), pairwise(places), strict=True):
        axis, turns = course.turn(t0, t1)
        leg["pivot"] = *(unit * (rest[:3, 3] - scene.camera.eye)), t0 - begin
        leg["shift"] = *(unit * (first[:3, 3] - rest[:3, 3])), 1.0 / (t1 - t0)
        leg["travel"] = *(unit * (second[:3, 3] - first[:3, 3])), turns
        leg["axis"][:3] = axis
        leg["turn"] = quaternion_of(first[:3, :3] @ rest[:3, :3].T)
    return legs
