"""Lamps of USD as lights, objects and surroundings of ours: shapes and areas, suns, domes, and what is not taken."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import field
from functools import partial
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.exchange import conversion
from rptcam_cl.exchange.conversion import Array
from rptcam_cl.exchange.usd_materials import Keys, PrimReport, Shading, number_of, pxr
from rptcam_cl.rendering.plan.environment import axes

_WHOLE_SKIES = ("automatic", "latlong")
_AROUND = 256  # normals of a lamp about its axis

Number = Callable[[str, float], float]  # an input of a lamp by its name, and what it is if nothing is said


@dataclass(eq=False)
class Lamps:
    """Takes the lamps of a stage at one moment.

    Attributes
    ----------
    lights : list of dict
        Those without a surface.
    environment : dict or None
        Of the first dome.
    """

    stage: Any
    time: Any
    report: PrimReport
    shading: Shading
    lights: list[Keys] = field(default_factory=list)
    environment: Keys | None = None

    def __post_init__(self) -> None:
        self.lux = pxr("UsdLux")

    def add(self, prim: Any, placement: Array, *, is_instance: bool, moves: bool) -> Keys | None:
        """Add a lamp without a surface; return the object that one with a surface is.

        Parameters
        ----------
        placement : (4, 4) array
            From the prim to the world, or to the prim whose instances it belongs to.
        is_instance, moves : bool
            Whether it belongs to instances, and whether it moves while the shutter is open.
        """

        def number(name: str, default: float) -> float:
            return number_of(prim, f"inputs:{name}", default, self.time)

        kind = str(prim.GetTypeName())
        radiance = self._radiance(prim, kind, number)
        normalize = bool(self.lux.LightAPI(prim).GetNormalizeAttr().Get(self.time))
        self._say_of_beam(prim, number)
        if kind in ("DistantLight", "DomeLight", "DomeLight_1"):
            if moves:
                self.report.say("approximated", "a sun or sky that turns while the shutter is open stays", prim)
            if is_instance:
                self.report.say("ignored", "a sun or sky as an instance", prim)
            elif kind == "DistantLight":
                self._add_distant(placement, radiance, number("angle", 0.53), normalize)
            else:
                self._add_dome(prim, placement, radiance)
            return None
        if kind == "SphereLight" and number("radius", 0.5) == 0:
            if is_instance or not normalize:
                self.report.say("ignored", "a lamp without a size, as an instance or not normalized", prim)
            else:
                self._add_point(prim, placement, radiance, moves)
            return None
        return self._surface(prim, placement, radiance, _lamp_shape(kind, number), normalize)

    def _radiance(self, prim: Any, kind: str, number: Number) -> Array:
        """Return the radiance of a lamp in red, green and blue; of a normalized one still to be divided by its area."""
        api = self.lux.LightAPI(prim)
        colour = np.array(api.GetColorAttr().Get(self.time) or (1, 1, 1), np.float64)
        if api.GetEnableColorTemperatureAttr().Get(self.time):
            colour = colour * np.array(self.lux.BlackbodyTemperatureAsRgb(number("colorTemperature", 6500.0)))
        strength = number("intensity", 50000.0 if kind == "DistantLight" else 1.0) * 2 ** number("exposure", 0.0)
        return np.maximum(colour * strength, 0)

    def _say_of_beam(self, prim: Any, number: Number) -> None:
        """Report what a lamp says of its beam, and of what it lights, which has no counterpart."""
        excluded = prim.GetRelationship("collection:lightLink:excludes")
        root = prim.GetAttribute("collection:lightLink:includeRoot").Get()
        for what, there in (
            ("the cone that a lamp is shaped to", number("shaping:cone:angle", 90.0) < 90),
            ("the focus of a lamp", number("shaping:focus", 0.0) != 0),
            ("the IES profile of a lamp", bool(prim.GetAttribute("inputs:shaping:ies:file").Get(self.time))),
            ("a lamp's factors on gloss and on the rest", (number("diffuse", 1.0), number("specular", 1.0)) != (1, 1)),
            ("links of a lamp to what it lights", root is False or (excluded and excluded.HasAuthoredTargets())),
        ):
            if there:
                self.report.say("ignored", what, prim)

    def _surface(
        self, prim: Any, placement: Array, radiance: Array, shape: tuple[Keys, Any] | None, normalize: bool
    ) -> Keys | None:
        """Return the keys of an object that shines; None, with a report, for a lamp of another kind."""
        if shape is None or not conversion.is_usable(placement):
            self.report.say("ignored", f"a lamp of the kind {prim.GetTypeName()}", prim)
            return None
        keys, area = shape
        if normalize:
            radiance = radiance / area(placement[:3, :3])
        if prim.GetAttribute("inputs:texture:file").Get(self.time):
            self.report.say("ignored", "the picture that a lamp shines with", prim)
        return {**keys, "transform": {"matrix": conversion.tidy(placement[:3])}, "name": str(prim.GetPath()),
                "material": {"kind": "emissive", "radiance": radiance.tolist()}}  # fmt: skip

    def _add_point(self, prim: Any, placement: Array, radiance: Array, moves: bool) -> None:
        if moves:
            self.report.say("approximated", "a lamp without a size stays while the shutter is open", prim)
        # the light of a ball goes by its cross section, a quarter of its surface; ours by distances in metres
        intensity = radiance / 4 * self.shading.metres_per_unit**2
        position = conversion.tidy(placement[:3, 3])
        self.lights.append({"kind": "point", "position": position, "intensity": intensity.tolist()})

    def _add_distant(self, placement: Array, radiance: Array, degrees: float, normalize: bool) -> None:
        sine = math.sin(math.radians(degrees) / 2)
        irradiance = radiance if normalize or degrees == 0 else radiance * math.pi * sine * sine
        keys: Keys = {"direction": conversion.tidy(-placement[:3, 2]), "irradiance": irradiance.tolist()}
        round_ = {"kind": "sun", "diameter_degrees": degrees, "visible": {"camera": False}}
        self.lights.append(keys | (round_ if 0.01 <= degrees <= 180 else {"kind": "directional"}))

    def _add_dome(self, prim: Any, placement: Array, radiance: Array) -> None:
        if self.environment is not None:
            self.report.say("ignored", "a second dome", prim)
            return
        asset = prim.GetAttribute("inputs:texture:file").Get(self.time)
        file = self.shading.picture(asset) if asset else None
        if asset and file is None:
            self.report.say("approximated", f"an even sky, as its picture cannot be read: {asset.path}", prim)
        if file is None:
            self.environment = {"kind": "constant", "radiance": radiance.tolist()}
            return
        if np.ptp(radiance) > 0:
            self.report.say("approximated", "the colour of a dome with a picture as its mean", prim)
        if (form := str(prim.GetAttribute("inputs:texture:format").Get() or "automatic")) not in _WHOLE_SKIES:
            self.report.say("approximated", f"a picture of a sky ({form}) as one in longitude and latitude", prim)
        # OpenEXR: +y is up, the middle of the picture looks along +z, its left half towards +x
        pole = str(prim.GetAttribute("poleAxis").Get() or "Y")
        pole = str(pxr("UsdGeom").GetStageUpAxis(self.stage)) if pole == "scene" else pole
        up, forward = (placement[:3, 2], -placement[:3, 1]) if pole == "Z" else (placement[:3, 1], placement[:3, 2])
        up, forward = (axis / np.linalg.norm(axis) for axis in (up, forward))
        right_at_0, _, forward_at_0 = axes(up.tolist(), 0.0)
        turn = math.degrees(math.atan2(-(forward @ right_at_0), forward @ forward_at_0))
        self.environment = {"kind": "image", "file": file, "up": conversion.tidy(up),
                            "rotation_degrees": round(turn, 9) + 0.0, "gain": float(radiance.mean())}  # fmt: skip


def _lamp_shape(kind: str, number: Number) -> tuple[Keys, Any] | None:
    """Return the shape of a lamp, and the function of its transform that gives its area; None for another kind."""
    if kind == "RectLight":
        width, height = number("width", 1.0), number("height", 1.0)
        corner = [width / 2, -height / 2, 0]
        keys: Keys = {"shape": "rectangle", "corner": corner, "edge_u": [-width, 0, 0], "edge_v": [0, height, 0]}
        return keys, partial(_area, width * height, np.eye(3)[None, 2:])
    radius = number("radius", 0.5)
    if kind == "DiskLight":
        keys = {"shape": "disk", "center": [0, 0, 0], "normal": [0, 0, -1], "radius": radius}
        return keys, partial(_area, math.pi * radius**2, np.eye(3)[None, 2:])
    angles = (np.arange(_AROUND) + 0.5) * 2 * math.pi / _AROUND
    ring = np.stack([0 * angles, np.cos(angles), np.sin(angles)], axis=-1)
    if kind == "SphereLight":
        x, weights = np.polynomial.legendre.leggauss(_AROUND // 2)
        normals = np.sqrt(1 - x**2)[:, None, None] * ring + x[:, None, None] * np.eye(3)[0]
        keys = {"shape": "sphere", "center": [0, 0, 0], "radius": radius}
        return keys, partial(_area, 4 * math.pi * radius**2, normals, weights=weights)
    if kind == "CylinderLight":
        length = number("length", 1.0)
        keys = {"shape": "cylinder", "base": [-length / 2, 0, 0], "top": [length / 2, 0, 0], "radius": radius,
                "capped": False}  # fmt: skip
        return keys, partial(_area, 2 * math.pi * radius * length, ring[None])
    return None


def _area(area: float, normals: Array, linear: Array, weights: Array | None = None) -> float:
    """Return the area of a surface under a transform (3, 3), whose cofactors stretch its normals (rings, n, 3)."""
    columns = linear.T
    cofactors = np.cross(columns[[1, 2, 0]], columns[[2, 0, 1]])
    return area * float(np.average(np.linalg.norm(normals @ cofactors, axis=-1).mean(axis=1), weights=weights))
