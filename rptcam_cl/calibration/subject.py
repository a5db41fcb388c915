"""What a camera is taken of: a scene file, or a lens alone with a film that its image circle holds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.optics import Lens, film_distance, image_circle, list_lenses, load_lens, names_a_file
from rptcam_cl.scene import Scene, change_scene, load_scene

SIZE = (768, 512)  # of the picture of a lens alone [pixels]
FORMAT_MM = (36.0, 24.0)  # of its film, where the image circle holds that
FILL = 0.98  # of the image circle's radius that half the diagonal of a smaller film takes


def is_scene(source: str | Path | Mapping[str, Any]) -> bool:
    """Return whether a name, a file or a mapping is a scene, and no lens."""
    if isinstance(source, Mapping):
        return "camera" in source
    if str(source) in list_lenses():
        return False
    path = Path(source)
    if path.suffix.lower() not in (".yaml", ".yml", ".json"):
        return False
    if not path.is_file():
        raise InputError(
            f"{source}: there is no such file (allowed: a scene or lens file, or a lens of rptcam lens list;"
            " rptcam examples copies scenes)"
        )
    content = read_yaml(path).data
    return isinstance(content, Mapping) and "camera" in content


def subject(
    source: str | Path | Mapping[str, Any] | Scene,
    overrides: Sequence[str] = (),
    *,
    size: tuple[int, int] | None = None,
    film_mm: tuple[float, float] | None = None,
) -> Scene:
    """Return the scene of a source: itself, or one that has nothing but a camera with the lens, focused at infinity.

    Parameters
    ----------
    source
        A scene, its file or content; or a lens by name or file.
    overrides
        Changes such as ``camera.f_number=8`` of a scene file, or of the scene of a lens.
    size
        Resolution [pixels]: in place of the scene's, or that of a lens's picture.
    film_mm
        Width and height of the film [mm], likewise.

    Raises
    ------
    InputError
        For a lens without a real image of a distant object, and whatever is wrong in a file.
    """
    if isinstance(source, Scene):
        scene = source
    elif is_scene(source):
        scene = load_scene(source, overrides)
    else:
        name = str(source)
        scene = load_scene(_of_lens(name, size or SIZE, film_mm), overrides, base_dir=Path(name).resolve().parent)
    film: dict[str, Any] = {} if size is None else {"resolution": list(size)}
    if film_mm is not None:
        film |= dict.fromkeys(("format", "width_mm", "diagonal_mm", "pixel_pitch_um")) | {"size_mm": list(film_mm)}
    return change_scene(scene, film=film) if film else scene


def _of_lens(name: str, size: tuple[int, int], film_mm: tuple[float, float] | None) -> dict[str, Any]:
    lens = load_lens(name)
    first = lens.first_order()
    if not (0 < first.focal_length_mm < math.inf and first.back_focal_distance_mm > 0):
        raise InputError(f"{lens.name}: forms no real image of a distant object, so there is no picture of it")
    back = film_distance(lens, math.inf)
    sides = film_mm or _fitting(lens, back, size)
    named = str(Path(name).resolve()) if names_a_file(name) else name
    return {
        "film": {"resolution": list(size), "size_mm": list(sides)},
        "camera": {
            "kind": "realistic", "lens": named, "eye": [0, 0, 0], "target": [0, 0, -1],
            "focus": {"film_distance_mm": back},
        },
    }  # fmt: skip


def _fitting(lens: Lens, back: float, size: tuple[int, int]) -> tuple[float, float]:
    """Return the sides of a film of square pixels [mm]: of the small format, or what the image circle holds of it."""
    radius = image_circle(lens, back, LINE_D_NM)
    half = min(math.hypot(*FORMAT_MM) / 2, FILL * radius)
    width, height = size
    scale = 2 * half / math.hypot(width, height)
    return width * scale, height * scale
