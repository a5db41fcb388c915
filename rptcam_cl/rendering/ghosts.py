"""Ghosts in a picture: light of lamps and suns that surfaces of the lens reflect onto the film.

Light is sent from its sources through every pair of reflecting surfaces, and added to the film in whole numbers: the
result depends on the scene alone, not on samples, waves or devices that share them. docs/flare.md has its limits.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import ghost_setting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Session
from rptcam_cl.optics import veiling_glare
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.ghost_film import GhostFilm
from rptcam_cl.scene import RealisticCamera, Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ghosting:
    """The ghosts of a scene in focus.

    Attributes
    ----------
    scene : Scene
    plan : Plan
    session : Session
    """

    scene: Scene
    plan: Plan
    session: Session

    @cached_property
    def found(self) -> tuple[Array, dict[str, Any]]:
        """The light of all ghosts on the rendered part of the film, in its values, and what metadata should say."""
        pixels, metadata = GhostFilm(self.scene, self.plan, self.session).light()
        if share := _barrel_share(self.scene):
            metadata["barrel_share"] = share
        metadata["says"] = _says(metadata)
        layout = FilmLayout.of(self.scene.film)
        rows, columns = slice(layout.y, layout.y + layout.height), slice(layout.x, layout.x + layout.width)
        return pixels[rows, columns], metadata

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a saved part needs so that `merge` can add them without the scene."""
        light, said = self.found
        text = np.frombuffer(json.dumps(said).encode("utf-32-le"), np.uint32)
        return {"ghosts_light": light.astype(np.float32), "ghosts_said": text}


def saved_ghosts(arrays: Mapping[str, NDArray[Any]]) -> tuple[NDArray[np.float32], dict[str, Any]] | None:
    """Return what `Ghosting.arrays` is of; None where there are none.

    Raises
    ------
    ValueError, KeyError
        They do not fit together.
    """
    if "ghosts_light" not in arrays:
        return None
    light, said = arrays["ghosts_light"], json.loads(arrays["ghosts_said"].tobytes().decode("utf-32-le"))
    if light.ndim != 3 or light.shape[2] != 3 or not isinstance(said, dict):
        raise ValueError("ghosts")
    return light.astype(np.float32, copy=False), said


def has_ghosts(scene: Scene) -> bool:
    """Return whether the camera of a scene makes ghosts."""
    return isinstance(scene.camera, RealisticCamera) and scene.camera.ghosts == "on"


def ghosting_of(scene: Scene | None, plan: Plan, session: Session) -> Ghosting | None:
    """Return the ghosts of a scene in focus; None where there is none.

    Raises
    ------
    InputError
        When the camera has no surfaces, they are ideal, or the lens is half a lens.
    """
    if scene is None:
        return None
    setting = ghost_setting(scene)
    if any(surface.region is not None and not surface.region.blocks for surface in setting.lens.surfaces):
        raise InputError(
            f"camera.ghosts: {setting.lens.name}: a half lens has ghosts that are not known (allowed: off)"
        )
    return Ghosting(scene, plan, session)


def _barrel_share(scene: Scene) -> float:
    """Return the light that the barrel adds evenly, in parts of the film's mean; `veiling_glare` estimates it."""
    camera = scene.camera
    if not isinstance(camera, RealisticCamera) or not camera.barrel_reflectance:
        return 0.0
    setting = ghost_setting(scene)
    try:
        return veiling_glare(
            setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm, setting.transmission,
            barrel_reflectance=camera.barrel_reflectance,
        ).barrel  # fmt: skip
    except InputError as problem:
        raise InputError(f"camera.barrel_reflectance: {problem} (allowed: 0)") from None


def _says(found: dict[str, Any]) -> str:
    """Return a line on what was found."""
    text = f"{found['ways']} pairs of surfaces from {found['sources']} points of light"
    if "mirrored" in found:
        text += f", {found['mirrored']} of them mirrored"
    if found["dropped_share"] > 0:
        text += f"; fainter ones with {found['dropped_share']:.1g} of the light are left out"
    if "barrel_share" in found:
        text += f"; the barrel adds {found['barrel_share']:.2g} of the film's mean light"
    if "left_out" in found:
        text += f"; what makes none here: {', '.join(found['left_out'])}"
    return text
