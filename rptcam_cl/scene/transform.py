"""Transforms: steps that place an object in the world."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from rptcam_cl.scene.base import AlsoAccepts, AlsoAcceptsItem, Alternatives, SceneModel, refuse
from rptcam_cl.scene.quantities import LARGEST_COORDINATE, NUMBER, Coordinate, Direction, Position, list_of

# Ratio of the smallest to the largest stretch that float32 inverts with some accuracy left.
SMALLEST_STRETCH_RATIO = 1e-6

Matrix = NDArray[np.float64]
Row = Annotated[
    tuple[Coordinate, Coordinate, Coordinate, Coordinate], BeforeValidator(list_of(4, "a row of 4 numbers"))
]

MATRIX_SCHEMA = WithJsonSchema(
    {
        "type": "array",
        "minItems": 3,
        "maxItems": 4,
        "items": {"type": "array", "minItems": 4, "maxItems": 4, "items": {"type": "number"}},
    }
)


def _three_factors(value: Any) -> Any:
    """Return one factor as three equal ones."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return value
    return [value, value, value]


def _four_rows(value: Any) -> Any:
    """Return the rows of a 3x4 matrix with the last row of a 4x4 one."""
    rows = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(rows, (list, tuple)) or len(rows) not in (3, 4):
        raise refuse("must be 3 or 4 rows", allowed="a list of 3 or 4 rows of 4 numbers")
    return rows if len(rows) == 4 else [*rows, (0, 0, 0, 1)]


class Rotation(SceneModel):
    """A turn about an axis through the origin."""

    axis: Direction
    """Direction of the axis; any length."""

    degrees: Annotated[float, Field(ge=-1e6, le=1e6), NUMBER]
    """Angle [degrees], counter-clockwise when the axis points at the viewer."""

    def matrix(self) -> Matrix:
        """Return the 3x3 matrix."""
        return turn_about(np.divide(self.axis, np.linalg.norm(self.axis)), self.degrees)


def turn_about(axis: NDArray[np.float64], degrees: float) -> Matrix:
    """Return the 3x3 matrix of a turn about a unit axis (Rodrigues)."""
    angle = math.radians(degrees)
    cross = np.cross(np.eye(3), axis)
    aligned = np.outer(axis, axis)
    return np.asarray(aligned + math.cos(angle) * (np.eye(3) - aligned) + math.sin(angle) * cross)


class TransformStep(SceneModel):
    """One step of a transform: exactly one of the four keys."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("scale", "rotate", "translate", "matrix"), required=True),
    )

    scale: Annotated[Position, BeforeValidator(_three_factors), AlsoAccepts({"type": "number"})] | None = None
    """Factor along all axes, or [x, y, z] factors; negative ones reflect, none is zero."""

    rotate: Rotation | None = None
    """Turn about an axis through the origin."""

    translate: Position | None = None
    """Shift [scene units]."""

    matrix: Annotated[tuple[Row, Row, Row, Row], BeforeValidator(_four_rows), MATRIX_SCHEMA] | None = None
    """Rows of an affine matrix, 3x4, or 4x4 with the last row [0, 0, 0, 1]."""

    @model_validator(mode="after")
    def _check_invertible(self) -> Self:
        if self.matrix is not None and self.matrix[3] != (0, 0, 0, 1):
            last = list(self.matrix[3])
            raise refuse("is not affine", got=last, allowed="[0, 0, 0, 1]", path=("matrix", 3))
        key = "matrix" if self.matrix is not None else "scale"
        check_invertible(self.as_matrix(), path=(key,))
        return self

    def as_matrix(self) -> Matrix:
        """Return the step as a 4x4 matrix."""
        result = np.eye(4)
        if self.scale is not None:
            result[:3, :3] = np.diag(self.scale)
        elif self.rotate is not None:
            result[:3, :3] = self.rotate.matrix()
        elif self.translate is not None:
            result[:3, 3] = self.translate
        elif self.matrix is not None:
            result[:] = self.matrix
        return result


def check_invertible(matrix: Matrix, path: tuple[str | int, ...] = ()) -> None:
    """Refuse a 4x4 matrix that flattens space, or overflows when its coordinates are squared in float32."""
    stretches = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    if not stretches[-1] > SMALLEST_STRETCH_RATIO * stretches[0]:
        raise refuse(
            "cannot be inverted: it flattens space",
            allowed=f"stretches whose ratio is at least {SMALLEST_STRETCH_RATIO:g}",
            path=path,
        )
    if np.abs(matrix).max() > LARGEST_COORDINATE or stretches[-1] < 1 / LARGEST_COORDINATE:
        raise refuse(
            "stretches or shifts too far for float32",
            allowed=f"factors of {1 / LARGEST_COORDINATE:g} to {LARGEST_COORDINATE:g}",
            path=path,
        )


def _as_steps(value: Any) -> Any:
    """Return a single step as a list of one."""
    return [value] if isinstance(value, (dict, TransformStep)) else value


def _check_product(steps: tuple[TransformStep, ...]) -> tuple[TransformStep, ...]:
    check_invertible(product(steps))
    return steps


def product(steps: tuple[TransformStep, ...]) -> Matrix:
    """Return the 4x4 matrix that applies the steps in their order."""
    result = np.eye(4)
    for step in steps:
        result = step.as_matrix() @ result
    return result


Transform = Annotated[
    tuple[TransformStep, ...],
    Field(max_length=100),
    BeforeValidator(_as_steps),
    AfterValidator(_check_product),
    AlsoAcceptsItem(),
]
