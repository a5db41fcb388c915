"""A lens drawn in cross-section with the rays of several fields, blocked rays marked where they were stopped."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.lenstools.bundles import APPROACH, Bundle, View, bundles, size_of
from rptcam_cl.lenstools.colours import FAINT, INK, glass_colour
from rptcam_cl.lenstools.cross_section import blades, glass, lines, medium_behind, obstruction, profile
from rptcam_cl.lenstools.lens_state import Setting, setting
from rptcam_cl.lenstools.picture import Drawing, Path, Point, Text, svg_text
from rptcam_cl.lenstools.ray_paths import Tracer, reference
from rptcam_cl.optics import Status

if TYPE_CHECKING:
    from rptcam_cl.optics import Lens

Array = NDArray[np.float64]

WIDTH, MARGIN, HEAD, FOOT = 960.0, 20.0, 40.0, 54.0
LEAST_HEIGHT, MOST_HEIGHT = 60.0, 700.0
BLOCKED = "#c00000"
MARK = 3.0  # half width of the mark on a blocked ray [pixels]


def draw_lens(setting: Setting, view: View | None = None, tracer: Tracer = reference) -> Drawing:
    """Return the cross-section of a lens in use, with rays traced by a tracer."""
    view = view or View()
    beams = list(bundles(setting, view, tracer))
    lines = [(beam, ray, _flat(beam.line(setting, ray), view)) for beam in beams for ray in beam.shown(view.blocked)]
    outline = [profile(setting.lens, k, view.section) for k in range(len(setting.lens.surfaces))]
    outline += blades(setting.lens, view.section)
    film = _film(setting, [line[-1] for beam, ray, line in lines if beam.paths.last.status[ray] == Status.ok])
    frame = Frame.around([*outline, *([film] if film is not None else []), *(line for _, _, line in lines)], setting)
    picture = Drawing(WIDTH, frame.height, _title(setting))
    draw_glass(picture, frame, setting, view)
    picture.add(Path(frame.axis(), FAINT, 0.8, dash=(10, 3, 2, 3)))
    for beam, ray, line in lines:
        _draw_ray(picture, frame, beam, ray, line)
    draw_surfaces(picture, frame, setting, view)
    _draw_numbers(picture, frame, lines)
    if film is not None:
        picture.add(Path(frame.places(film), INK, 2.0, note="film"))
    _draw_words(picture, setting, beams, view)
    return picture


def svg(
    lens: Lens,
    *,
    f_number: float | None = None,
    focus_distance_m: float | None = None,
    tracer: Tracer = reference,
    **view: Any,
) -> str:
    """Return the cross-section of a lens as SVG text, for notebooks and scripts.

    Parameters
    ----------
    lens : Lens
    f_number, focus_distance_m : float, optional
        As in `setting`.
    tracer : Tracer
        What traces the rays; the float64 reference by default.
    **view
        What is drawn, as in `View`: ``section``, ``fields``, ``rays``, ``wavelengths_nm``, ``blocked``.
    """
    return svg_text(draw_lens(setting(lens, f_number, focus_distance_m), View(**view), tracer))


@dataclass(frozen=True)
class Frame:
    """Millimetres to pixels, alike along both axes; the optical axis lies level."""

    scale: float
    left: float
    middle: float
    height: float

    @staticmethod
    def around(lines: Sequence[Array], setting: Setting) -> Frame:
        """Return the frame that holds lines of points (z, height)."""
        size = size_of(setting.lens)
        points = np.concatenate(lines)
        left, right = float(points[:, 0].min()), float(points[:, 0].max())
        left = max(left, -APPROACH * size - 0.5 * size)
        reach = float(np.abs(points[:, 1]).max())
        scale = min((WIDTH - 2 * MARGIN) / (right - left), MOST_HEIGHT / (2 * reach))
        tall = max(2 * reach * scale, LEAST_HEIGHT)
        spare = (WIDTH - 2 * MARGIN) / scale - (right - left)
        return Frame(scale, left - spare / 2, HEAD + tall / 2, HEAD + tall + FOOT)

    def places(self, points: Array) -> list[Point]:
        """Return pixels for points (z, height)."""
        return [(MARGIN + (z - self.left) * self.scale, self.middle - h * self.scale) for z, h in points.tolist()]

    def axis(self) -> list[Point]:
        """Return the ends of the optical axis in pixels."""
        return [(MARGIN / 2, self.middle), (WIDTH - MARGIN / 2, self.middle)]


def _flat(line: Array, view: View) -> Array:
    """Return (z, height) of points in space."""
    return line[:, [2, 1]] if view.section == "y" else line[:, [2, 0]]


def _film(setting: Setting, hits: Sequence[Array]) -> Array | None:
    """Return the ends of the film, as far as rays reach it and no less than a tenth of the lens."""
    if setting.film_distance_mm is None:
        return None
    reach = max([*(1.1 * abs(float(hit[1])) for hit in hits), 0.05 * size_of(setting.lens)])
    return np.array([[setting.film_z, -reach], [setting.film_z, reach]])


def _title(setting: Setting) -> str:
    first = setting.lens.first_order(setting.wavelength_nm)
    parts = [setting.lens.name]
    if math.isfinite(first.focal_length_mm):
        parts.append(f"f = {first.focal_length_mm:.4g} mm, f/{first.f_number:.3g}")
    if math.isfinite(setting.object_distance_mm):
        parts.append(f"object {(setting.object_distance_mm + setting.film_z) / 1000:.4g} m from the film")
    return "; ".join(parts)


def draw_glass(picture: Drawing, frame: Frame, setting: Setting, view: View) -> None:
    """Draw what lies between the surfaces."""
    media = glass(setting.lens, view.section, setting.wavelength_nm)
    if setting.film_distance_mm is not None:
        behind = medium_behind(setting.lens, view.section, setting.wavelength_nm, setting.film_z)
        media += [behind] if behind else []
    for index, outline in media:
        note = f"index {index:.4f} at {setting.wavelength_nm:g} nm"
        picture.add(Path(frame.places(outline), INK, 0.6, glass_colour(index), closed=True, note=note))


def draw_surfaces(picture: Drawing, frame: Frame, setting: Setting, view: View) -> None:
    """Draw surfaces, obstructions and the stop."""
    for k, surface in enumerate(setting.lens.surfaces):
        flat_stop = surface.is_stop and surface.is_sphere and not surface.curvature
        block = obstruction(setting.lens, k, view.section)
        if block is not None:
            picture.add(Path(frame.places(block), INK, 3.5, note=f"obstruction, surface {k}"))
        elif not flat_stop:
            width = 2.2 if surface.is_mirror else 1.1
            for line in lines(setting.lens, k, view.section):
                picture.add(Path(frame.places(line), INK, width, note=f"surface {k}"))
    for blade in blades(setting.lens, view.section):
        picture.add(Path(frame.places(blade), INK, 3.5, note=f"stop, surface {setting.lens.stop_index}"))


def _draw_ray(picture: Drawing, frame: Frame, beam: Bundle, ray: int, line: Array) -> None:
    places = frame.places(line)
    status = Status(int(beam.paths.last.status[ray]))
    if status == Status.ok:
        picture.add(Path(places, beam.colour, 0.9))
        return
    what = f"{status.name.replace('_', ' ')} at surface {beam.paths.last.surface[ray]}"
    picture.add(Path(places, beam.colour, 0.5, dash=(3, 3), note=what))
    x, y = places[-1]
    for tilt in (-MARK, MARK):
        picture.add(Path([(x - MARK, y - tilt), (x + MARK, y + tilt)], BLOCKED, 1.3, note=what))


def _draw_numbers(picture: Drawing, frame: Frame, lines: Sequence[tuple[Bundle, int, Array]]) -> None:
    """Write the number of each surface that blocks rays beside its outermost mark."""
    marks: dict[int, Point] = {}
    for beam, ray, line in lines:
        surface = int(beam.paths.last.surface[ray])
        (place,) = frame.places(line[-1:])
        if surface >= 0 and (surface not in marks or place[1] < marks[surface][1]):
            marks[surface] = place
    for surface, (x, y) in marks.items():
        picture.add(Text((x + MARK, y - MARK - 1), str(surface), 10, colour=BLOCKED))


def _draw_words(picture: Drawing, setting: Setting, beams: Sequence[Bundle], view: View) -> None:
    picture.add(Text((MARGIN, 24), picture.title, 15))
    place, below = MARGIN, picture.height - 32
    for colour, label in dict.fromkeys((beam.colour, _label(beam, view)) for beam in beams):
        picture.add(Path([(place, below - 4), (place + 22, below - 4)], colour, 2.5), Text((place + 28, below), label))
        place += 28 + 7 * len(label) + 22
    if view.blocked:
        picture.add(Text((MARGIN, picture.height - 12), _blocked_text(beams), 11, colour=BLOCKED))
    if setting.film_distance_mm is not None:
        text = f"last surface to film {setting.film_distance_mm:.4g} mm"
        picture.add(Text((WIDTH - MARGIN, below), text, 11, "end", FAINT))


def _label(beam: Bundle, view: View) -> str:
    return f"{beam.wavelength_nm:g} nm" if len(view.wavelengths_nm) > 1 else f"{beam.field_degrees:g}°"


def _blocked_text(beams: Sequence[Bundle]) -> str:
    """Return how many rays were stopped for each reason, and at which surfaces."""
    counts: Counter[tuple[int, int]] = Counter()
    for beam in beams:
        last = beam.paths.last
        counts.update((int(s), int(k)) for s, k in zip(last.status, last.surface, strict=True) if s != Status.ok)
    parts = []
    for status in Status:
        places = [f"{count} at {k}" for (s, k), count in sorted(counts.items()) if s == status]
        if places:
            parts.append(f"{status.name.replace('_', ' ')}: {', '.join(places)}")
    return f"x  blocked rays, by surface; {'; '.join(parts)}" if parts else ""
