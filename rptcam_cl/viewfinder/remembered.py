"""Results that depend on a scene's optics alone, kept for the last few of them: most dials leave the lens as it is."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from pathlib import Path
from typing import TypeVar

from rptcam_cl.scene import ImageAperture, LensCamera, Scene, at_opening

KEPT = 48  # lens states

T = TypeVar("T")


def by_optics(function: Callable[[Scene], T]) -> Callable[[Scene], T]:
    """Return a function of a scene that remembers what it returned for the same camera, film and files.

    Where the camera stands does not count, unless its focus is a point of the scene.
    """
    known: OrderedDict[Hashable, T] = OrderedDict()

    @wraps(function)
    def remembered(scene: Scene) -> T:
        key = optics_key(scene)
        if key not in known:
            known[key] = function(scene)
            if len(known) > KEPT:
                known.popitem(last=False)
        known.move_to_end(key)
        return known[key]

    return remembered


def optics_key(scene: Scene) -> Hashable:
    """Return what the optics of a scene depend on; a file counts by its place and the time of its last change."""
    camera = at_opening(scene).camera
    pose: set[str] = {"eye", "target", "up", "motion"}
    if isinstance(camera, LensCamera) and camera.focus.point is not None:
        pose = set()
    return (
        camera.model_dump_json(exclude=pose),
        scene.film.size_m(),
        scene.exposure.f_number,
        scene.metres_per_unit,
        _files(scene),
    )


def _files(scene: Scene) -> Hashable:
    source, aperture = scene.lens_source(), getattr(scene.camera, "aperture", None)
    found = [source] if isinstance(source, Path) else []
    if isinstance(aperture, ImageAperture) and isinstance(content := scene.content_of(aperture), Path):
        found.append(content)
    return tuple((str(path), path.stat().st_mtime_ns) for path in found)
