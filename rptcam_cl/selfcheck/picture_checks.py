"""Checks of whole pictures: light that is neither lost nor made, and the same bits however the work is cut up."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.device import Session
from rptcam_cl.plan import Plan, make_plan
from rptcam_cl.rendering import FilmLayout, Wavefront, render_plan
from rptcam_cl.scene import Scene, change_scene, load_scene
from rptcam_cl.selfcheck.check import Check, needs_float64

Picture = NDArray[np.float32]

DEPTH = 6
REFLECTANCE = 0.8
UNLIKE = 0.02  # share of the values that rounding may change by more than 1e-5, by sending paths elsewhere
# By how much a picture may change, over its mean: by roundings that send paths elsewhere, by parts of a pixel.
ROUNDED = 0.02
FITTED = 0.2
OF_MEAN = "of the mean, root mean square"
RADII = (1e-3, 1.0, 1e4)  # of cavities [m]

MATTE = {"kind": "matte", "reflectance": REFLECTANCE}
STUDIO: dict[str, Any] = {
    "film": {"resolution": [48, 32]},
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 5.0}, "eye": [0.5, -5, 2],
        "target": [0, 0, 0.5], "up": [0, 0, 1],
    },
    "render": {"spp": 16, "max_depth": 5},
    "environment": {"kind": "constant", "radiance": 0.2},
    "objects": [
        {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE},
        {"shape": "sphere", "center": [-0.7, 0, 0.6], "radius": 0.6, "material": {"kind": "dielectric", "index": 1.5}},
        {"shape": "box", "min": [0.3, 0, 0], "max": [1.1, 0.8, 0.9], "material": MATTE},
        {
            "shape": "rectangle", "corner": [-1, -1, 3], "edge_u": [0, 1, 0], "edge_v": [1, 0, 0],
            "material": {"kind": "emissive", "radiance": 8},
        },
    ],
}  # fmt: skip


def cavity(radius: float, reflectance: float = REFLECTANCE, depth: int = DEPTH) -> dict[str, Any]:
    """Return a scene inside a matte sphere with a point light in its middle: every sample is the same."""
    wall = {"shape": "sphere", "center": [0, 0, 0], "radius": radius, "material": MATTE | {"reflectance": reflectance}}
    eye = [0.3 * radius, -0.4 * radius, 0.1 * radius]
    return {
        "film": {"resolution": [16, 16]},
        "camera": {
            "kind": "pinhole", "fov_degrees": 100, "eye": eye, "target": [radius, radius, 0], "up": [0, 0, 1],
        },
        "render": {"spp": 4, "max_depth": depth, "roulette_depth": 0},
        "objects": [wall],
        "lights": [{"kind": "point", "position": [0, 0, 0], "intensity": radius**2 * math.pi}],
    }  # fmt: skip


def picture(
    session: Session,
    scene: Scene,
    plan: Plan,
    *,
    wave_size: int | None = None,
    organisation: str | None = None,
) -> Picture:
    """Return the film of a scene."""
    wavefront = Wavefront(session, plan, FilmLayout.of(scene.film), scene.render, wave_size, organisation)
    wavefront.warm_up()
    return render_plan(wavefront, spp=scene.render.most_spp, seconds=None, has_lens=plan.camera.has_lens).pixels


def cavity_error(session: Session, mapping: Mapping[str, Any], reflectance: float, depth: int) -> float:
    """Return the largest relative error of the pixels of a cavity: vertex k adds reflectance^k."""
    scene = load_scene(mapping)
    series = sum(reflectance**k for k in range(1, depth))
    return float(np.abs(picture(session, scene, make_plan(scene)).astype(np.float64) / series - 1).max())


def energy_check(session: Session) -> Check:
    """Light in closed rooms from a millimetre to ten kilometres against the truncated series."""
    worst = max(cavity_error(session, cavity(radius), REFLECTANCE, DEPTH) for radius in RADII)
    return Check("pictures: light in closed rooms of 1e-3 to 1e4 m", worst, 2e-6 + 1e-6 * DEPTH, "relative")


def organisation_checks(session: Session) -> list[Check]:
    """One picture through a lens with waves of two sizes, and by both ways to organise the work."""
    scene = load_scene(STUDIO)
    plan = make_plan(scene)
    whole = picture(session, scene, plan)
    small = picture(session, scene, plan, wave_size=1024)
    stream, passes = (picture(session, scene, plan, organisation=name) for name in ("stream", "passes"))
    unlike = 1 - float(np.isclose(stream, passes, rtol=1e-5, atol=1e-6).mean())
    bits = int((whole.view(np.uint32) != small.view(np.uint32)).sum())
    return [
        Check("pictures: small waves and large", bits, 0, f"of {whole.size} values differ in a bit"),
        Check("pictures: stream and passes", unlike, UNLIKE, "of the values differ by 1e-5"),
        Check("pictures: values that are not finite", int((~np.isfinite(whole)).sum()), 0, f"of {whole.size}"),
    ]


def lens_checks(session: Session) -> list[Check]:
    """One picture through a lens traced in float32, in float64 where the device has it, and by fitted rays."""
    scene = load_scene(STUDIO)
    single = picture(session, scene, make_plan(scene)).astype(np.float64)

    def beside(name: str, camera: dict[str, str], allowed: float) -> Check:
        other = change_scene(scene, camera=camera)
        apart = picture(session, other, make_plan(other)) - single
        return Check(name, float(np.sqrt(np.mean(apart**2)) / single.mean()), allowed, OF_MEAN)

    name = "pictures: lens in float32 and float64"
    precise = beside(name, {"precision": "double"}, ROUNDED) if session.info.fp64 else needs_float64(name, OF_MEAN)
    return [precise, beside("pictures: rays traced and fitted", {"rays": "fitted"}, FITTED)]
