"""Camera models of computer vision: how each projects a direction on the picture.

All but the last see (a, b) = (x / z, y / z) and distort it (Brown 1966; the rational and thin-prism terms as OpenCV has
them). Kannala and Brandt (IEEE PAMI 28, 2006) go by the angle from the axis instead, so that a fisheye fits.
Parameters are fx, fy, cx, cy [pixels, from the picture's corner] and then the coefficients in the order of OpenCV.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

INTRINSICS = ("fx", "fy", "cx", "cy")
BROWN = ("k1", "k2", "p1", "p2", "k3")
COEFFICIENTS: dict[str, tuple[str, ...]] = {
    "pinhole": (),
    "brown_conrady": BROWN,
    "rational": (*BROWN, "k4", "k5", "k6"),
    "thin_prism": (*BROWN, "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
}
BY_ANGLE = "kannala_brandt"
LEAST_AHEAD = 0.02  # z of a unit direction below which a plane in front of the camera has no place for it


def in_reach(model: str, directions: Array) -> NDArray[np.bool_]:
    """Return which directions (n, 3) a model has a place for."""
    return np.asarray(np.ones(len(directions), bool) if model == BY_ANGLE else directions[:, 2] > LEAST_AHEAD)


def normal_points(model: str, directions: Array) -> Array:
    """Return what a model distorts (n, 2): tangents, or for the model by angles the angle itself along its azimuth."""
    across = directions[:, :2]
    with np.errstate(all="ignore"):
        if model != BY_ANGLE:
            return np.asarray(across / directions[:, 2:])
        length = np.linalg.norm(across, axis=1)
        angle = np.arctan2(length, directions[:, 2])
        return np.asarray(across * np.where(length > 1e-12, angle / length, 1.0)[:, None])


def sees(model: str, parameters: Array, directions: Array) -> NDArray[np.bool_]:
    """Return which directions (n, 3) a model of these parameters sees.

    Those ahead of the camera, z > 0; of the model by angles those up to where its radius no longer grows with the
    angle, beyond 90 degrees too, but for what lies straight behind, which has no azimuth.
    """
    if model != BY_ANGLE:
        return np.asarray(directions[:, 2] > 0)
    across = np.linalg.norm(directions[:, :2], axis=1)
    angle = np.arctan2(across, directions[:, 2])
    return np.asarray((angle < _widest(parameters[4:])) & ((across > 0) | (directions[:, 2] > 0)))


def _widest(coefficients: Array) -> float:
    """Return the angle at which the radius of the model by angles turns back, above 180 degrees if nowhere [rad]."""
    slope = np.append(coefficients[::-1] * [9.0, 7.0, 5.0, 3.0], 1.0)  # of the radius, by powers of the squared angle
    roots = np.roots(slope)
    turns = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
    return float(np.sqrt(turns.min(initial=16.0)))


def project(model: str, parameters: Array, directions: Array) -> Array:
    """Return the places (n, 2) of directions (n, 3) in the picture [pixels from its corner].

    Not-a-number for directions that the model does not see: behind the camera (z <= 0), or for the model by angles,
    which sees beyond 90 degrees, past the angle at which its radius turns back.

    Parameters
    ----------
    model : str
        One of `COEFFICIENTS`.
    parameters : array
        fx, fy, cx, cy, and the coefficients.
    """
    with np.errstate(all="ignore"):
        places = placed(model, parameters, normal_points(model, directions))
    places[~sees(model, parameters, directions)] = np.nan
    return places


def placed(model: str, parameters: Array, points: Array) -> Array:
    """Return the places (n, 2) in the picture of points of `normal_points` (n, 2) [pixels from its corner]."""
    return np.asarray(distorted(model, parameters[4:], points) * parameters[:2] + parameters[2:4])


def distorted(model: str, coefficients: Array, points: Array) -> Array:
    """Return points of `normal_points` (n, 2) as the coefficients bend them."""
    if model == "pinhole":
        return points
    square = np.sum(points * points, axis=1)
    if model == BY_ANGLE:
        k1, k2, k3, k4 = coefficients
        return np.asarray(points * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))[:, None])
    k1, k2, p1, p2, k3 = coefficients[:5]
    x, y = points.T
    scale = 1 + square * (k1 + square * (k2 + square * k3))
    if len(coefficients) > 5:
        scale = scale / denominator(coefficients, square)
    bent = [
        x * scale + 2 * p1 * x * y + p2 * (square + 2 * x * x),
        y * scale + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
    ]
    if len(coefficients) > 8:
        s1, s2, s3, s4 = coefficients[8:12]
        bent[0] = bent[0] + square * (s1 + square * s2)
        bent[1] = bent[1] + square * (s3 + square * s4)
    return np.stack(bent, axis=1)


def slopes(model: str, parameters: Array, points: Array) -> Array:
    """Return the derivatives (n, 2, parameters) of places in the picture, of points of `normal_points` (n, 2)."""
    focal, coefficients = parameters[:2], parameters[4:]
    square = np.sum(points * points, axis=1)
    found = np.zeros((len(points), 2, len(parameters)))
    found[:, 0, 0], found[:, 1, 1] = distorted(model, coefficients, points).T
    found[:, 0, 2] = found[:, 1, 3] = 1.0
    by = found[:, :, 4:]
    powers = np.multiply.accumulate(np.repeat(square[:, None], 4, axis=1), axis=1)
    if model == BY_ANGLE:
        by[:] = points[:, :, None] * powers[:, None]
    elif model != "pinhole":
        k1, k2, _, _, k3 = coefficients[:5]
        x, y = points.T
        along = points
        if len(coefficients) > 5:
            below = denominator(coefficients, square)
            along = points / below[:, None]
            ratio = (1 + square * (k1 + square * (k2 + square * k3))) / below
            by[:, :, 5:8] = -(along * ratio[:, None])[:, :, None] * powers[:, None, :3]
        by[:, :, :2], by[:, :, 4] = along[:, :, None] * powers[:, None, :2], along * powers[:, 2:3]
        by[:, 0, 2], by[:, 1, 2] = 2 * x * y, square + 2 * y * y
        by[:, 0, 3], by[:, 1, 3] = square + 2 * x * x, 2 * x * y
        if len(coefficients) > 8:
            by[:, 0, 8:10] = by[:, 1, 10:12] = powers[:, :2]
    by *= focal[:, None]
    return found


def denominator(coefficients: Array, square: Array) -> Array:
    """Return what the rational model divides by, at squared distances from the axis."""
    k4, k5, k6 = coefficients[5:8]
    return np.asarray(1 + square * (k4 + square * (k5 + square * k6)))
