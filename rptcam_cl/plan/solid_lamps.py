"""Lamps with a volume as emitters: boxes, ellipsoids, cylinders and cones under any affine map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.kinds import EmitterKind
from rptcam_cl.core.records import Kind

Array = NDArray[np.float64]

SOLIDS = {
    Kind.BOX: EmitterKind.BOX,
    Kind.ELLIPSOID: EmitterKind.ELLIPSOID,
    Kind.CYLINDER: EmitterKind.CYLINDER,
    Kind.CONE: EmitterKind.CONE,
}
STEPS = 64  # of a quadrature about an axis: smooth and periodic, it is exact to rounding but for very thin shapes


def fill_solid(record: np.void, kind: Kind, placement: Array) -> None:
    """Fill in what ``kernels/light/solids.h`` reads of the shape.

    Parameters
    ----------
    record
        Emitter record.
    kind
        One of `SOLIDS`.
    placement
        (4, 4), maps the canonical shape of the kind to the world [m].
    """
    linear, inverse = placement[:3, :3], np.linalg.inv(placement[:3, :3])
    record["kind"] = SOLIDS[kind]
    record["a"] = (*placement[:3, 3], np.cbrt(abs(np.linalg.det(linear))))
    for name, column in zip(("u", "v", "normal"), linear.T, strict=True):
        record[name][:3] = column
    for name, row in zip(("uv", "uv_x", "uv_y"), inverse, strict=True):
        record[name][:3] = row


def area_of_solid(kind: Kind, linear: Array) -> float:
    """Return the area [m²] of a canonical shape under a linear map (3, 3); of cylinder and cone without their ends."""
    if kind is Kind.BOX:
        return 8 * float(sum(np.linalg.norm(np.cross(linear[:, i - 1], linear[:, i])) for i in range(3)))
    angle = 2 * np.pi * np.arange(STEPS) / STEPS
    round_about = np.stack([np.cos(angle), np.sin(angle), np.zeros(STEPS)], axis=1)
    along = np.stack([-np.sin(angle), np.cos(angle), np.zeros(STEPS)], axis=1) @ linear.T
    if kind is Kind.ELLIPSOID:
        cosine, weight = np.polynomial.legendre.leggauss(STEPS)
        sine = np.sqrt(1 - cosine**2)
        normals = sine[:, None, None] * round_about + cosine[:, None, None] * np.array([0.0, 0.0, 1.0])
        stretched = normals @ (np.linalg.inv(linear) * np.linalg.det(linear))
        return float(2 * np.pi * (weight @ np.linalg.norm(stretched, axis=2).mean(axis=1)))
    side = np.array([0.0, 0.0, 1.0]) - (round_about if kind is Kind.CONE else 0.0)
    area = 2 * np.pi * float(np.linalg.norm(np.cross(along, side @ linear.T), axis=1).mean())
    return area / 2 if kind is Kind.CONE else area
