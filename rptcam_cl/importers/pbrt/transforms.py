"""Transforms of pbrt: 4x4 matrices that act on columns, in float64.

pbrt says left-handed, but a matrix is a matrix: the numbers are what its directives make of them. Handedness matters
once, when a picture is compared with another (see ``cameras.frame_of``).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.importers.pbrt.statements import Statement

Matrix = NDArray[np.float64]
SMALLEST = 1e-12
# Beyond what coordinates of ours may be (see scene.quantities).
LARGEST = 1e12
# Ratio of stretches from which on ours takes a transform (see scene.transform); vertices may be flattened further.
LEAST_RATIO = 1e-6

# Where nothing is: the transform of what stands under one that cannot be used.
NOWHERE = np.full((4, 4), np.nan)

ODD = "its transform flattens space, or leads beyond what a scene can hold"

# Decimal digits that coordinates keep: far more than float32 has, fewer than float64 leaves after an inverse.
DIGITS = 13


class OddTransformError(ValueError):
    """A transform that places nothing, with what is odd about it."""


def step_matrix(statement: Statement) -> Matrix:
    """Return the matrix that a transforming directive multiplies the current one with, from the right.

    Raises
    ------
    OddTransformError
        When it flattens space, or fixes no view or axis.
    """
    numbers = statement.numbers
    result = np.eye(4)
    match statement.directive:
        case "Translate":
            result[:3, 3] = numbers
        case "Scale":
            if not numbers.all():
                raise OddTransformError("Scale by 0 flattens space")
            result[:3, :3] = np.diag(numbers)
        case "Rotate":
            result[:3, :3] = _rotation(statement)
        case "LookAt":
            result = _camera_from_world(statement)
        case _:
            result = checked(statement)
    return result


def checked(statement: Statement) -> Matrix:
    """Return the matrix of ``Transform`` or ``ConcatTransform``, which pbrt writes column by column.

    Raises
    ------
    OddTransformError
        When it is not affine, or cannot be inverted.
    """
    matrix = statement.numbers.reshape(4, 4).T.copy()
    if not np.allclose(matrix[3], (0, 0, 0, matrix[3, 3]), rtol=0, atol=1e-9) or abs(matrix[3, 3]) < SMALLEST:
        raise OddTransformError(
            f"{statement.directive} is not affine: every fourth number must be 0, the last one 1 (written by columns)"
        )
    matrix /= matrix[3, 3]
    if not is_invertible(matrix):
        raise OddTransformError(f"{statement.directive} cannot be inverted: it flattens space")
    return matrix


def is_invertible(matrix: Matrix) -> bool:
    """Return whether a transform is finite, and its linear part keeps three dimensions apart."""
    if not np.isfinite(matrix).all():
        return False
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(stretches[-1] > SMALLEST * stretches[0])


def is_bearable(matrix: Matrix) -> bool:
    """Return whether a transform places things where a scene of ours can hold them."""
    if not is_invertible(matrix):
        return False
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(stretches[-1] > SMALLEST and stretches[0] < LARGEST and np.abs(matrix[:3, 3]).max() < LARGEST)


def is_transform_of_ours(matrix: Matrix) -> bool:
    """Return whether a scene of ours takes a matrix as the transform of an object."""
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return bool(stretches[-1] > LEAST_RATIO * (1 + LEAST_RATIO) * stretches[0])


def _rotation(statement: Statement) -> Matrix:
    """Return the 3x3 turn about an axis (Rodrigues)."""
    degrees, *axis = statement.numbers
    length = math.hypot(*axis)
    if length < SMALLEST:
        raise OddTransformError("Rotate needs an axis (got 0 0 0)")
    unit = np.array(axis) / length
    angle = math.radians(degrees)
    aligned = np.outer(unit, unit)
    return np.asarray(aligned + math.cos(angle) * (np.eye(3) - aligned) + math.sin(angle) * np.cross(np.eye(3), unit))


def _camera_from_world(statement: Statement) -> Matrix:
    """Return the matrix of ``LookAt``: +z of the camera looks at the target, +y is up, +x is up x forward."""
    eye, target, up = statement.numbers.reshape(3, 3)
    forward = target - eye
    right = np.cross(up, forward)
    if np.linalg.norm(right) <= SMALLEST * float(np.linalg.norm(up)) * float(np.linalg.norm(forward)):
        raise OddTransformError("LookAt: eye, target and up fix no view (allowed: eye off the target, up not along)")
    forward = forward / np.linalg.norm(forward)
    right = right / np.linalg.norm(right)
    world_from_camera = np.eye(4)
    world_from_camera[:3] = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
    return np.asarray(np.linalg.inv(world_from_camera))


def apply(matrix: Matrix, points: Matrix) -> Matrix:
    """Return points (n, 3) transformed."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def apply_to_normals(matrix: Matrix, normals: Matrix) -> Matrix:
    """Return unit normals (n, 3) transformed: by the inverse transpose."""
    turned = normals @ np.linalg.inv(matrix[:3, :3])
    lengths = np.linalg.norm(turned, axis=1, keepdims=True)
    return np.asarray(turned / np.where(lengths > 0, lengths, 1))


def reflects(matrix: Matrix) -> bool:
    """Return whether a transform makes a left hand of a right one."""
    return bool(np.linalg.det(matrix[:3, :3]) < 0)


def is_similarity(matrix: Matrix) -> bool:
    """Return whether the linear part turns, reflects and scales evenly, and nothing else."""
    gram = matrix[:3, :3].T @ matrix[:3, :3]
    return bool(np.allclose(gram, gram[0, 0] * np.eye(3), rtol=0, atol=1e-5 * gram[0, 0]))


def tidy(values: ArrayLike) -> list[Any]:
    """Return an array as nested lists, rounded to `DIGITS` of its largest number: what inverses leave vanishes."""
    array = np.asarray(values, np.float64)
    largest = float(np.abs(array).max(initial=0))
    if not 0 < largest < math.inf:
        return list(array.tolist())
    decimals = DIGITS - 1 - math.floor(math.log10(largest))
    return list((np.round(array, decimals) + 0.0).tolist())  # + 0.0 makes no zero negative


def mean_scale(matrix: Matrix) -> float:
    """Return the factor of lengths of a similarity; of another transform the mean over its axes."""
    return float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
