"""Ghosts of a lens as a table, and the way of one of them in cross-section."""

from __future__ import annotations

from dataclasses import asdict
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.bundles import APPROACH, View, size_of
from rptcam_cl.lenstools.colours import FAINT, INK, SERIES
from rptcam_cl.lenstools.cross_section import blades, profile
from rptcam_cl.lenstools.drawing import MARGIN, WIDTH, Frame, draw_glass, draw_surfaces
from rptcam_cl.lenstools.fields import fan_points, section_rays
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.lenstools.picture import Drawing, Path, Text
from rptcam_cl.lenstools.ray_paths import ray_paths, reference
from rptcam_cl.optics import Ghosts, ghost_image, steps, unfolded, with_film

Array = NDArray[np.float64]

RAYS = 9  # of the way that is drawn
PHASES = ("to the first reflection", "back", "on to the film")


def way_text(way: tuple[int, ...]) -> str:
    """Return a way by the surfaces that reflect it, as ``6, 3``."""
    return ", ".join(map(str, way))


def ghost_table(found: Ghosts) -> list[dict[str, Any]]:
    """Return a row for each ghost, brightest in the frame first.

    Shares are of the image's light. `focus_mm` is how far behind the film its paraxial image lies; `blur_mm` the
    diameter on the film of a full beam from the axis.
    """
    lit = found.lit
    with_its_film = with_film(lit.lens, lit.film_distance_mm)
    pupil = lit.lens.first_order(lit.wavelength_nm).entrance_pupil.diameter_mm
    rows = []
    for ghost in found.ghosts:
        image = ghost_image(with_its_film, ghost.way, 0.0, lit.wavelength_nm, lit.source.object_distance_mm)
        rows.append({
            "surfaces": list(ghost.way),
            "share_in_frame": ghost.flux_in_frame / found.reference,
            "share": ghost.flux / found.reference,
            "x_mm": ghost.centroid_mm[0],
            "y_mm": ghost.centroid_mm[1],
            "rms_mm": ghost.rms_mm,
            "focus_mm": image.image_distance_mm,
            "blur_mm": abs(image.film_per_height) * pupil,
        })  # fmt: skip
    return rows


def ghost_summary(found: Ghosts) -> dict[str, Any]:
    """Return the sums, the worst ghost and where the light goes, as shares of what enters."""
    account, reference_flux = asdict(found.account), found.reference
    entered = account.pop("entered")
    worst = max(found.ghosts, key=lambda ghost: ghost.flux_in_frame, default=None)
    densest = max(found.ghosts, key=_density, default=None)
    return {
        "image_share": found.image.flux / entered,
        "ghosts_in_frame": sum(ghost.flux_in_frame for ghost in found.ghosts) / reference_flux,
        "ghosts": sum(ghost.flux for ghost in found.ghosts) / reference_flux,
        "shares_are_of": "image" if found.image.flux else "light that enters",
        "worst": None if worst is None else list(worst.way),
        "densest": None if densest is None else list(densest.way),
        "account": {name: value / entered for name, value in account.items()},
    }


def _density(ghost: Any) -> float:
    """Return light over the area of a disk of the same rms radius."""
    return float(ghost.flux_in_frame / max(ghost.rms_mm, 1e-3) ** 2) if ghost.flux_in_frame else 0.0


def draw_ghost(setting: Setting, found: Ghosts, way: tuple[int, ...]) -> Drawing:
    """Return the lens in cross-section with rays of one way: coming, going back and going on in their colours.

    Raises
    ------
    InputError
        When no ray of the cross-section takes that way.
    """
    lit = found.lit
    folded = with_film(lit.lens, lit.film_distance_mm)
    rays = _rays(setting, found, way)
    if not rays:
        raise InputError(f"{setting.lens.name}: no ray of the cross-section is reflected at {way_text(way)}")
    view = View()
    film = np.array([[setting.film_z, -lit.film_mm[1] / 2], [setting.film_z, lit.film_mm[1] / 2]])
    outline = [profile(lit.lens, k, "y") for k in range(len(folded.surfaces) - 1)] + blades(lit.lens, "y")
    frame = Frame.around([*outline, film, *rays], setting)
    picture = Drawing(WIDTH, frame.height, _title(found, way))
    draw_glass(picture, frame, setting, view)
    picture.add(Path(frame.axis(), FAINT, 0.8, dash=(10, 3, 2, 3)))
    met = list(steps(way, len(folded.surfaces)))
    ends = [0, *(1 + i for i, step in enumerate(met) if step.reflects), len(met)]
    for ray in rays:
        for number, (start, end) in enumerate(pairwise(ends)):
            picture.add(Path(frame.places(ray[start : end + 1]), SERIES[number % len(SERIES)], 0.9))
    draw_surfaces(picture, frame, setting, view)
    picture.add(Path(frame.places(film), INK, 2.0, note="film"))
    _draw_words(picture, len(way))
    return picture


def _rays(setting: Setting, found: Ghosts, way: tuple[int, ...]) -> list[Array]:
    """Return corners (m, 2), z and height, of rays of the cross-section that take a way to the film."""
    lit = found.lit
    lens = unfolded(with_film(lit.lens, lit.film_distance_mm), way)
    at = Setting(lit.lens, setting.film_distance_mm, lit.source.object_distance_mm, lit.wavelength_nm)
    points = fan_points(at, lit.source.field_degrees, "y")
    origins, directions = section_rays(at, lit.source.field_degrees, points, "y")
    passed = np.flatnonzero(lens.trace(origins, directions, lit.wavelength_nm, "scene").passed)
    if not len(passed):
        return []
    chosen = passed[np.unique(np.linspace(0, len(passed) - 1, RAYS).round().astype(int))]
    paths = ray_paths(lens, origins[chosen], directions[chosen], lit.wavelength_nm, reference)
    corners = np.moveaxis(paths.points, 0, 1).copy()
    along = directions[chosen] / np.linalg.norm(directions[chosen], axis=1)[:, None]
    reach = min(APPROACH * size_of(lit.lens), lit.source.object_distance_mm)
    corners[:, 0] = corners[:, 1] - along * reach
    return [line[:, [2, 1]] for line in corners]


def _title(found: Ghosts, way: tuple[int, ...]) -> str:
    ghost = next(ghost for ghost in found.ghosts if ghost.way == way)
    share = ghost.flux_in_frame / found.reference
    return f"{found.lit.lens.name}; reflected at surfaces {way_text(way)}: {share:.2g} of the image's light"


def _draw_words(picture: Drawing, reflections: int) -> None:
    picture.add(Text((MARGIN, 24), picture.title, 15))
    place, below = MARGIN, picture.height - 32
    words = PHASES if reflections == 2 else [f"after {number} reflections" for number in range(reflections + 1)]
    for number, word in enumerate(words):
        line = [(place, below - 4), (place + 22, below - 4)]
        picture.add(Path(line, SERIES[number % len(SERIES)], 2.5), Text((place + 28, below), word))
        place += 28 + 7 * len(word) + 22
