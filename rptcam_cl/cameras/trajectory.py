"""When light falls on each pixel, and where the camera is then: what ``kernels/camera/trajectory.h`` reads."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.scene import Scene, Shutter, moments

Array = NDArray[np.float32]


def camera_trajectory(scene: Scene) -> tuple[Array, int]:
    """Return rows of 4 numbers, and how many segments the way of the camera has; none where it stands still.

    A segment is the way between two moments during which eye, view and up change uniformly.

    Parameters
    ----------
    scene
        As it is when the shutter opens (`at_opening`): the eye there is the origin.
    """
    segments = _segments(scene)
    header = np.zeros((2, 4))
    header[0] = exposure_timing(scene.shutter, scene.film.resolution)
    header[1, 0] = len(segments)
    return np.concatenate([header, *segments]).astype(np.float32), len(segments)


def exposure_timing(shutter: Shutter, resolution: tuple[int, int]) -> tuple[float, float, float, float]:
    """Return time open, start of pixel (0, 0), and how much later each column and row start [s]."""
    if shutter.readout_s is None:
        return shutter.time_s, 0.0, 0.0, 0.0
    along_columns = shutter.direction in ("left_right", "right_left")
    rows = resolution[0 if along_columns else 1]
    step = shutter.readout_s / max(rows - 1, 1)
    backwards = shutter.direction in ("bottom_up", "right_left")
    start, step = (step * (rows - 1), -step) if backwards else (0.0, step)
    return (shutter.time_s, start, step, 0.0) if along_columns else (shutter.time_s, start, 0.0, step)


def _segments(scene: Scene) -> list[NDArray[np.float64]]:
    camera, (begin, end) = scene.camera, scene.shutter.span_s
    times = moments(camera.motion, begin, end)
    poses = [camera.pose_at(time) for time in times]
    if all(np.array_equal(pose, poses[0]) for pose in poses):
        return []
    eye, unit = poses[0][0], scene.metres_per_unit
    rows = [np.stack([unit * (pose[0] - eye), pose[1] - pose[0], pose[2]]) for pose in poses]
    for part in (1, 2):  # only the directions of view and up count
        largest = max(np.abs(row[part]).max() for row in rows)
        for row in rows:
            row[part] /= largest
    segments = []
    for (t0, t1), (first, second) in zip(pairwise(times), pairwise(rows), strict=True):
        segment = np.zeros((6, 4))
        segment[::2, :3], segment[1::2, :3] = first, second - first
        segment[0, 3], segment[1, 3] = t0 - begin, 1.0 / (t1 - t0)
        segments.append(segment)
    return segments
