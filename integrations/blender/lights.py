"""Blender's lamps as lights of a scene, in the units of Cycles: watts of radiant power, sun in W/m².

A point lamp of P watts has the radiant intensity P / 4π, its sphere of radius r the radiance P / (4 π² r²); an area
lamp of area A has P / (π A); a spot is a cone cut out of the point lamp.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .report import Report

SMALLEST_RADIUS = 1e-6  # of a lamp with a surface [units]
SMALLEST_ANGLE = math.radians(0.01)  # across a sun with a disk


@dataclass(frozen=True)
class BlenderLamp:
    """A lamp as Blender has it: the power with its colour, and the sizes of its kind.

    Attributes
    ----------
    name, kind
        Of the object; ``POINT``, ``SPOT``, ``SUN`` or ``AREA``.
    matrix : (4, 4) array
        World from lamp; it shines along −z.
    power : tuple of float
        Red, green and blue [W], of a sun [W/m²].
    radius : float
        Of point and spot [units].
    spot_size, spot_blend
        Full angle of the cone [radians], and the share of it that fades.
    angle : float
        Across the sun [radians].
    shape, size
        ``SQUARE``, ``RECTANGLE``, ``DISK`` or ``ELLIPSE``, and its sides or diameters [units].
    spread : float
        Of an area lamp [radians]; π shines everywhere.
    visible : dict
        `camera`, `shadow` and `reflection`, as scenes have it.
    normalized : bool
        Whether its light is as much whatever its size; else a larger one of the same power gives more (Blender 4.5).
    soft : bool
        Whether a point lamp fades where it touches things.
    group : str
        Blender's light group, or nothing.
    hidden_from : tuple of str
        Kinds of rays that do not meet it: ``diffuse``, ``glossy``, ``transmission``.
    """

    name: str
    kind: str
    matrix: NDArray[np.float64]
    power: tuple[float, float, float]
    radius: float = 0.0
    spot_size: float = math.pi / 4
    spot_blend: float = 0.15
    angle: float = 0.0
    shape: str = "SQUARE"
    size: tuple[float, float] = (1.0, 1.0)
    spread: float = math.pi
    visible: dict[str, bool] = field(default_factory=dict)
    normalized: bool = True
    soft: bool = False
    group: str = ""
    hidden_from: tuple[str, ...] = ()


def lamp_keys(lamp: BlenderLamp, report: Report, metres_per_unit: float = 1.0) -> tuple[str, dict[str, Any]] | None:
    """The section of the scene, ``lights`` or ``objects``, and what to add to it; None for a lamp without light.

    What a lamp without size lights is as bright as in Cycles, which takes a unit for a metre.
    """
    if not any(channel > 0 for channel in lamp.power):
        return None
    if any(channel < 0 for channel in lamp.power):
        report.add(f"Lamp {lamp.name}: negative light is left out.")
        return None
    if len(lamp.hidden_from) == 3:
        report.add(f"Lamp {lamp.name}: hidden from all that it would light, left out.")
        return None
    if "diffuse" in lamp.hidden_from:
        report.add(f"Lamp {lamp.name}: it lights matte surfaces, too, from which Blender hides it.")
    made = {"POINT": _point, "SPOT": _spot, "SUN": _sun, "AREA": _area}[lamp.kind](lamp, report)
    if made is not None and "intensity" in made[1]:
        made[1]["intensity"] = [channel * metres_per_unit**2 for channel in made[1]["intensity"]]
    return made


def _scaled(lamp: BlenderLamp, factor: float) -> list[float]:
    return [float(channel) * factor for channel in lamp.power]


def _place(lamp: BlenderLamp) -> list[float]:
    return [float(number) for number in lamp.matrix[:3, 3]]


def _forward(lamp: BlenderLamp) -> list[float]:
    direction = -np.asarray(lamp.matrix, np.float64)[:3, 2]
    return [float(number) for number in direction / np.linalg.norm(direction)]


def _of_a_surface(lamp: BlenderLamp, shape: dict[str, Any], radiance: list[float]) -> tuple[str, dict[str, Any]]:
    """An object that shines; Blender's lamps cast no shadows."""
    visible = {"shadow": False} | {key: False for key, seen in lamp.visible.items() if not seen}
    material = {"kind": "emissive", "radiance": radiance}
    return "objects", shape | {"material": material, "name": lamp.name[:200], "visible": visible}


def _sees_without_size(lamp: BlenderLamp, report: Report) -> None:
    if lamp.visible.get("camera", False):
        report.add(f"Lamp {lamp.name}: it has no size, so the camera does not see it.")


def _point(lamp: BlenderLamp, report: Report) -> tuple[str, dict[str, Any]]:
    if lamp.radius <= SMALLEST_RADIUS:
        _sees_without_size(lamp, report)
        intensity = _scaled(lamp, 0.25 / math.pi * _by_size(lamp))
        return "lights", {"kind": "point", "position": _place(lamp), "intensity": intensity}
    if lamp.soft:
        report.add(f"Lamp {lamp.name}: a ball of light, which does not fade where it touches things (Soft Falloff).")
    radiance = _scaled(lamp, 0.25 / (math.pi * lamp.radius) ** 2 * _by_size(lamp))
    return _of_a_surface(lamp, {"shape": "sphere", "center": _place(lamp), "radius": lamp.radius}, radiance)


def _by_size(lamp: BlenderLamp) -> float:
    """How much more a ball of light gives that is not normalised: its surface, and 4 without one, as Cycles has it."""
    if lamp.normalized:
        return 1.0
    return 4 * math.pi * lamp.radius**2 if lamp.radius > SMALLEST_RADIUS else 4.0


def _spot(lamp: BlenderLamp, report: Report) -> tuple[str, dict[str, Any]]:
    if lamp.radius > SMALLEST_RADIUS:
        report.add(f"Lamp {lamp.name}: a spot has no size here; its radius of {lamp.radius:g} softens no shadow.")
    _sees_without_size(lamp, report)
    scales = np.linalg.norm(np.asarray(lamp.matrix)[:3, :3], axis=0)
    half = lamp.spot_size / 2
    outer = math.cos(half)
    inner = math.acos(min(outer + (1 - outer) * lamp.spot_blend, 1.0))
    if not np.allclose(scales[:2] / scales[2], 1, atol=1e-3):
        # Cycles stretches the cone, with where it fades, by the scale across over that along
        stretch = float(scales[:2].mean() / scales[2])
        half, inner = (math.atan(math.tan(min(angle, 1.5)) * stretch) for angle in (half, inner))
        if not np.isclose(scales[0], scales[1], rtol=1e-3):
            report.add(f"Lamp {lamp.name}: the oval cone of a spot with unequal scale is round here.")
    keys: dict[str, Any] = {
        "kind": "spot",
        "position": _place(lamp),
        "direction": _forward(lamp),
        "intensity": _scaled(lamp, 0.25 / math.pi * _by_size(lamp)),
        "outer_degrees": math.degrees(half),
        "inner_degrees": math.degrees(min(inner, half * (1 - 1e-6))),
    }
    return "lights", keys


def _sun(lamp: BlenderLamp, report: Report) -> tuple[str, dict[str, Any]]:
    keys = {"direction": _forward(lamp), "irradiance": _scaled(lamp, 1.0)}
    if lamp.angle < SMALLEST_ANGLE:
        return "lights", {"kind": "directional", **keys}
    if not lamp.normalized:
        keys["irradiance"] = _scaled(lamp, math.pi * math.tan(lamp.angle / 2) ** 2)
    visible = {} if lamp.visible.get("camera", False) else {"visible": {"camera": False}}
    return "lights", {"kind": "sun", **keys, "diameter_degrees": math.degrees(lamp.angle), **visible}


def _area(lamp: BlenderLamp, report: Report) -> tuple[str, dict[str, Any]] | None:
    matrix = np.asarray(lamp.matrix, np.float64)
    is_round = lamp.shape in ("DISK", "ELLIPSE")
    sides = lamp.size if lamp.shape in ("RECTANGLE", "ELLIPSE") else (lamp.size[0],) * 2
    u, v = matrix[:3, 0] * sides[0], matrix[:3, 1] * sides[1]
    if np.linalg.det(matrix[:3, :3]) < 0:  # mirrored: it shines along −z all the same
        u, v = v, u
    area = float(np.linalg.norm(np.cross(u, v))) * (math.pi / 4 if is_round else 1)
    if area < SMALLEST_RADIUS**2:
        report.add(f"Lamp {lamp.name}: an area lamp without area is left out.")
        return None
    normal = np.cross(u, v) / max(np.linalg.norm(np.cross(u, v)), 1e-30)
    if abs(float(normal @ _forward(lamp))) < 0.999:
        report.add(f"Lamp {lamp.name}: sheared by its parent; it shines at right angles to its surface here.")
    if lamp.spread < math.pi - 1e-3:
        report.add(
            f"Lamp {lamp.name}: it shines to all sides here; a spread of {math.degrees(lamp.spread):.0f} degrees is "
            "left out, and its power kept."
        )
    radiance = _scaled(lamp, 1 / (math.pi * (area if lamp.normalized else 1)))
    center = matrix[:3, 3]
    if not is_round:
        corner = center - (u + v) / 2  # −z is where it shines: v x u
        shape = {"shape": "rectangle", "corner": corner.tolist(), "edge_u": v.tolist(), "edge_v": u.tolist()}
        return _of_a_surface(lamp, shape, radiance)
    rows = np.column_stack([u / 2, v / 2, np.cross(u, v) / np.linalg.norm(np.cross(u, v)), center])
    shape = {"shape": "disk", "center": [0, 0, 0], "normal": [0, 0, -1], "radius": 1}
    return _of_a_surface(lamp, shape | {"transform": {"matrix": rows.tolist()}}, radiance)
