"""What stands in where nothing is given: three balls for a model, a floor and a soft box for a picture of light."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.importers.starting.subject import Subject

Array = NDArray[np.float64]
BALLS = (
    ((-0.24, 0.1, 0.0), {"kind": "plastic", "reflectance": [0.5, 0.06, 0.04], "roughness": 0.3}),
    ((0.0, 0.1, 0.08), {"kind": "dielectric", "index": 1.5}),
    ((0.24, 0.1, 0.0), {"kind": "conductor", "metal": "gold", "roughness": 0.2}),
)
RADIUS = 0.1


def balls() -> Subject:
    """Return three balls on y = 0: glossy, glass and gold."""
    turns = np.linspace(0, 2 * np.pi, 33)[:-1]
    rings = np.concatenate(
        [
            RADIUS
            * np.column_stack([np.sin(a) * np.cos(turns), np.cos(a) * np.ones_like(turns), np.sin(a) * np.sin(turns)])
            for a in np.linspace(0, np.pi, 17)
        ]
    )
    points = np.concatenate([rings + center for center, _ in BALLS])
    objects = tuple({"shape": "sphere", "center": list(at), "radius": RADIUS, "material": made} for at, made in BALLS)
    return Subject(points, np.empty((0, 3, 3)), [], [], objects=objects)


def studio(bounds: tuple[Array, Array], eye: Array, up: Array) -> dict[str, Any]:
    """Return surroundings of even light, a floor below the subject and a soft box beside the camera."""
    low, high = bounds
    size, middle = float(np.linalg.norm(high - low)) or 1.0, (low + high) / 2
    flat = (eye - middle) * (1 - up)
    if not flat.any():  # straight above the subject or below it no side is in front
        flat = np.roll(up, 1)
    front = flat / np.linalg.norm(flat)
    left = np.cross(front, up)
    floor = middle * (1 - up) + low * up - 1e-3 * size * up
    lamp = middle + size * (1.1 * front + 1.3 * left + 1.4 * up)
    return {
        "environment": {"kind": "gradient", "bottom": 0.25, "top": 0.6, "up": up.tolist()},
        "materials": {
            "floor": {"kind": "matte", "reflectance": 0.45},
            "soft box": {"kind": "emissive", "radiance": [9, 8.4, 7.6]},
        },
        "objects": [
            {"name": "floor", "shape": "plane", "point": _short(floor), "normal": up.tolist(), "material": "floor"},
            {
                "name": "soft box", "shape": "disk", "center": _short(lamp), "normal": _short((middle - lamp) / size),
                "radius": float(f"{0.45 * size:.4g}"), "material": "soft box",
            },
        ],
    }  # fmt: skip


def _short(vector: Array) -> list[float]:
    return [float(f"{value:.4g}") for value in vector.tolist()]
