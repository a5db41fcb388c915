"""Scenes for tests of wavelengths: rooms of every kind of material, walls of light, lenses of the rptcam paper."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.rendering.pictures import WHITE, looking, scene_of

PAPER_NM = (400.0, 486.1, 589.3, 656.3, 700.0)  # lines at which the paper's lenses were worked out
PAPER_FILM_MM = (1.6, 1.2)
PAPER_PIXEL_MM = PAPER_FILM_MM[0] / 800
SINGLET_BACK_MM = {15: 3.167281, 18: 2.997085}  # last vertex to film, by the distance in focus
DOUBLET_BACK_MM = 2.995


def singlet(v: float, radius_mm: float = 0.035) -> dict[str, Any]:
    """Return the single lens of the paper's figures 4 and 7 (n 1.8, R 4, t 0.01) with a number V."""
    glass = {"linear_abbe": {"n": 1.8, "v": v}}
    first = {"radius": 4, "thickness": 0.01, "glass": glass, "diameter": 2 * radius_mm, "stop": True}
    return {"name": f"singlet v {v:g}", "surfaces": [first, {"radius": -4, "diameter": 2 * radius_mm}]}


def doublet(radius_mm: float = 0.1) -> dict[str, Any]:
    """Return the cemented doublet of the paper's figure 7: its first radius 4, the others by equations 6 to 12."""
    crown, flint = ({"linear_abbe": glass} for glass in ({"n": 1.3, "v": 3}, {"n": 1.8, "v": 1}))
    return {
        "name": "doublet",
        "surfaces": [
            {"radius": 4, "thickness": 0.005, "glass": crown, "diameter": 2 * radius_mm, "stop": True},
            {"radius": -4 / 7, "thickness": 0.005, "glass": flint, "diameter": 2 * radius_mm},
            {"radius": -2 / 3, "diameter": 2 * radius_mm},
        ],
    }


def paper_camera(lens: dict[str, Any], film_distance_mm: float, **rest: Any) -> dict[str, Any]:
    """Return a camera whose film stands at the eye, 1 unit being 1 mm."""
    focus = {"film_distance_mm": film_distance_mm}
    pose = {"eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]}
    return {"kind": "realistic", "lens": lens, "focus": focus, **pose, **rest}


def white_wall(lens: dict[str, Any], film_distance_mm: float, **rest: Any) -> dict[str, Any]:
    """Return a world of radiance 1 through a lens, in millimetres: the middle of the paper's film."""
    film = {"size_mm": [0.05, 0.05]}
    camera = paper_camera(lens, film_distance_mm)
    return scene_of([], camera, film=film, environment=WHITE, metres_per_unit=1e-3, **rest)


def room(glass: dict[str, Any] | None = None, **rest: Any) -> dict[str, Any]:
    """Return a scene of matte, plastic, metal, mirror and glass under lamps of four kinds, all in RGB."""
    checker = {"kind": "checker", "even": [0.7, 0.2, 0.1], "odd": [0.1, 0.3, 0.6], "scale": [3, 3]}
    lamp = {"shape": "rectangle", "corner": [-0.6, -0.4, 2.4], "edge_u": [0, 1, 0], "edge_v": [1, 0, 0]}
    balls = (
        {"kind": "matte", "reflectance": [0.1, 0.6, 0.3]},
        {"kind": "plastic", "reflectance": [0.6, 0.1, 0.1], "roughness": 0.4},
        {"kind": "conductor", "reflectance": [0.9, 0.7, 0.3], "roughness": 0.4},
        glass or {"kind": "dielectric", "index": 1.5, "roughness": 0.3},
        {"kind": "mirror", "reflectance": [0.8, 0.8, 0.9]},
    )
    objects = [
        {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1],
         "material": {"kind": "matte", "reflectance": checker}},
        {**lamp, "material": {"kind": "emissive", "radiance": [8, 6, 4]}},
        *({"shape": "sphere", "center": [place - 2.0, 0.3 * place, 0.4], "radius": 0.4, "material": material}
          for place, material in enumerate(balls)),
    ]  # fmt: skip
    lights = [{"kind": "point", "position": [1, -2, 2], "intensity": [1, 2, 3]}]
    camera = rest.pop("camera", looking([0, -5, 1.5], [0, 0.5, 0.5], fov=42))
    surroundings = {"kind": "gradient", "bottom": [0.1, 0.1, 0.1], "top": [0.3, 0.4, 0.6]}
    return scene_of(objects, camera, lights=lights, environment=surroundings, **{"depth": 4, **rest})


def opening(lens: Any) -> NDArray[np.float64]:
    """Return (count, 2) places spread evenly over the rim of the first surface and within [mm]."""
    turn, share = (np.arange(4096) * 0.6180339887498949) % 1, (np.arange(4096) + 0.5) / 4096
    radius = lens.surfaces[0].semi_diameter * np.sqrt(share)
    return np.column_stack([radius * np.cos(2 * np.pi * turn), radius * np.sin(2 * np.pi * turn)])
