"""The same view through a simpler camera: what a traced lens does beyond first-order optics is the difference."""

from __future__ import annotations

import math
from typing import Any, Literal, get_args

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import (
    Exposure,
    LensCamera,
    PinholeCamera,
    Pose,
    Scene,
    ThickLensCamera,
    ThinLensCamera,
    at_opening,
    with_camera,
)
from rptcam_cl.tradeoff import equivalent
from rptcam_cl.viewfinder.light import irradiance_per_radiance
from rptcam_cl.viewfinder.panel import focal_length_mm, has_opening

Kind = Literal["thick_lens", "thin_lens", "pinhole"]
KINDS: tuple[Kind, ...] = get_args(Kind)
ORDER = ("realistic", *KINDS)  # each stands for those before it


def as_model(scene: Scene, resolved: Scene, kind: str) -> dict[str, Any]:
    """Return the changes that put a simpler camera in the place of a scene's, with the same view and brightness.

    Thin lens and pinhole stand in the entrance pupil; see `tradeoff`.

    Parameters
    ----------
    scene, resolved
        As requested, and in focus and exposed.
    kind
        ``thick_lens``, ``thin_lens`` or ``pinhole``; the kind that it is changes nothing.

    Raises
    ------
    InputError
        The kind is none of these, or nothing simple stands for the camera; the message says why.
    """
    if kind not in KINDS:
        raise InputError(f"model: is no simpler camera (got {kind[:40]!r}; allowed: {', '.join(KINDS)})")
    view = resolved if type(resolved.camera) is type(scene.camera) else scene
    camera = view.camera
    if camera.kind == kind:
        return {}
    if camera.kind not in ORDER or ORDER.index(camera.kind) > ORDER.index(kind):
        raise InputError(f"model: no {kind} stands for a camera of kind {camera.kind}")
    plain = view.model_copy(update={"exposure": Exposure()})
    if isinstance(camera, ThinLensCamera):
        simple = with_camera(plain, _pinhole(plain))
    else:
        if isinstance(camera, ThickLensCamera):
            plain = with_camera(plain, _keys(camera) | {"kind": "realistic"})
        simple = equivalent(plain, next(known for known in KINDS if known == kind))
    changes: dict[str, Any] = {"camera": _said(simple.camera)}
    if kind == "pinhole" and has_opening(view) and scene.exposure.mode != "relative":
        light = irradiance_per_radiance(view)
        assert light is not None
        changes["exposure.f_number"] = math.sqrt(math.pi / (4.0 * light))
    return changes


def _keys(camera: LensCamera) -> dict[str, Any]:
    return {name: getattr(camera, name) for name in camera.model_fields_set}


def _pinhole(scene: Scene) -> dict[str, Any]:
    """Return the keys of a pinhole in the place of a thin lens."""
    camera = scene.camera
    assert isinstance(camera, ThinLensCamera)
    pose = {name: getattr(camera, name) for name in ("eye", "target", "up", "flip", "motion")}
    if camera.fov_degrees is not None:
        return pose | {"kind": "pinhole", "fov_degrees": camera.fov_degrees, "fov_axis": camera.fov_axis}
    focal_mm = focal_length_mm(scene)
    assert focal_mm is not None
    focused = at_opening(scene).camera
    assert isinstance(focused, ThinLensCamera)
    image_mm = 1 / (1 / focal_mm - 1 / (focused.plane_m * 1e3))
    width_mm = scene.film.size_m()[0] * 1e3
    return pose | {"kind": "pinhole", "fov_degrees": math.degrees(2 * math.atan(width_mm / 2 / image_mm))}


def _said(camera: Pose) -> dict[str, Any]:
    """Return a camera as a scene file says it."""
    plain = camera.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    assert isinstance(camera, (ThinLensCamera, PinholeCamera, ThickLensCamera))
    return plain | {"kind": camera.kind}
