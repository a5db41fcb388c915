"""A lens drawn in cross-section with the rays of several fields, blocked rays marked where they were stopped."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import charts
from rptcam_cl.optics.beams import without_rims
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import Rays, Status, at_plane, trace
from rptcam_cl.optics.spots import Setting, default_fields, fan_points, section_rays, setting

#
# Rays surface by surface, by whichever tracer: the lens cut off behind each of its surfaces gives the points there.
#
# So every corner of a drawn ray comes from the tracer itself, a device's kernel or the float64 reference, and no
# second tracer could hide a fault of the first.

Array = NDArray[np.float64]

Tracer = Callable[[Lens, Array, Array, float], Rays]
"""Traces rays from the scene, given lens, origins, directions and wavelength [nm]."""


def reference(lens: Lens, origins: Array, directions: Array, wavelength_nm: float) -> Rays:
    """Return rays traced in float64 on the host."""
    return trace(lens, origins, directions, wavelength_nm, "scene")


@dataclass(frozen=True)
class RayPaths:
    """Rays from the scene through a lens.

    Attributes
    ----------
    points : (surfaces + 1, n, 3) array
        Start of each ray, then its point on each surface; from the surface that stopped a ray on, where it was stopped.
    last : Rays
        What became of them.
    """

    points: Array
    last: Rays

    def corners(self, ray: int) -> Array:
        """Return the points (m, 3) of one ray up to where it left the lens or was stopped."""
        stopped = int(self.last.surface[ray])
        return self.points[: len(self.points) if stopped < 0 else stopped + 2, ray]


def ray_paths(lens: Lens, origins: Array, directions: Array, wavelength_nm: float, tracer: Tracer) -> RayPaths:
    """Return the points of rays from the scene (n, 3) on every surface.

    Rays that miss a surface end where they would cross the plane of its vertex.
    """
    points = [lens.from_scene_axes(np.array(origins, dtype=np.float64).T, np.array(directions).T)[0].T]
    rays = None
    for count in range(1, len(lens.surfaces) + 1):
        rays = tracer(_cut_behind(lens, count), origins, directions, wavelength_nm)
        points.append(rays.origins)
    assert rays is not None
    paths = RayPaths(np.stack(points), rays)
    _extend_misses(lens, paths)
    return paths


def _cut_behind(lens: Lens, count: int) -> Lens:
    """Return the lens of the first surfaces alone."""
    if count == len(lens.surfaces):
        return lens
    stop = lens.stop_index if lens.stop_index is not None and lens.stop_index < count else None
    return lens.of_surfaces(lens.surfaces[:count], stop)


def _extend_misses(lens: Lens, paths: RayPaths) -> None:
    for ray in np.flatnonzero(paths.last.status == Status.missed):
        k = int(paths.last.surface[ray])
        direction, start = paths.last.directions[ray], paths.points[k, ray]
        if direction[2] > 0:
            step = (lens.vertices[k] - start[2]) / direction[2]
            paths.points[k + 1 :, ray] = start + max(step, 0.0) * direction


# The rays of a drawing: of each field and wavelength even steps over what passes, and what is blocked beside.

APPROACH = 0.25  # length of the rays drawn before the lens, in sizes of the lens
BEYOND = 0.8  # how far rays are drawn behind a lens without film, in sizes of the lens


@dataclass(frozen=True)
class View:
    """What is drawn of a lens.

    Attributes
    ----------
    section : str
        "y" for the y-z plane, "x" for the x-z plane.
    fields : sequence of float, optional
        Angles from the axis [degrees]; chosen from the lens when absent.
    rays : int
        Rays of each field and wavelength that pass.
    wavelengths_nm : sequence of float
        That of the setting when empty.
    blocked : bool
        Whether rays that are stopped are drawn, too.
    """

    section: str = "y"
    fields: Sequence[float] | None = None
    rays: int = 7
    wavelengths_nm: Sequence[float] = ()
    blocked: bool = True

    def __post_init__(self) -> None:
        if self.section not in ("x", "y"):
            raise InputError(f'section must be "x" or "y" (got {self.section!r})')
        if self.rays < 1:
            raise InputError(f"at least one ray must be drawn (got {self.rays})")


@dataclass(frozen=True)
class Bundle:
    """The rays of one field and wavelength.

    Attributes
    ----------
    field_degrees, wavelength_nm : float
    colour : str
    incoming : (n, 3) array
        Directions before the lens, in its frame.
    paths : RayPaths
    """

    field_degrees: float
    wavelength_nm: float
    colour: str
    incoming: Array
    paths: RayPaths

    def shown(self, blocked: bool) -> list[int]:
        """Return the rays to draw: those that pass, and on demand the others."""
        status = self.paths.last.status
        return [ray for ray in range(len(status)) if blocked or status[ray] == Status.ok]

    def line(self, setting: Setting, ray: int) -> Array:
        """Return the corners (m, 3) of a ray as drawn: from before the lens to the film, or to where it was stopped."""
        size = size_of(setting.lens)
        corners = self.paths.corners(ray).copy()
        along = self.incoming[ray] / np.linalg.norm(self.incoming[ray])
        corners[0] = corners[1] - along * min(APPROACH * size, setting.object_distance_mm)
        if self.paths.last.status[ray] != Status.ok:
            return corners
        direction = self.paths.last.directions[ray]
        if setting.film_distance_mm is None:
            return np.concatenate([corners, [corners[-1] + direction * BEYOND * size]])
        return np.concatenate([corners, at_plane(corners[-1:], direction[None], setting.film_z)])


def size_of(lens: Lens) -> float:
    """Return the larger of the length and the diameter of the glass [mm]."""
    finite = [surface.semi_diameter for surface in lens.surfaces if np.isfinite(surface.semi_diameter)]
    return float(max(lens.length, 2 * max(finite, default=0.0)))


def bundles(setting: Setting, view: View, tracer: Tracer) -> Iterator[Bundle]:
    """Yield the rays of every field and wavelength of a view, traced surface by surface."""
    wavelengths = view.wavelengths_nm or (setting.wavelength_nm,)
    fields = default_fields(setting, section=view.section) if view.fields is None else view.fields
    for number, degrees in enumerate(fields):
        points = _chosen_points(setting, degrees, view)
        origins, directions = section_rays(setting, degrees, points, view.section)
        for wavelength in wavelengths:
            colour = (
                charts.wavelength_colour(wavelength)
                if len(wavelengths) > 1
                else charts.SERIES[number % len(charts.SERIES)]
            )
            paths = ray_paths(setting.lens, origins, directions, wavelength, tracer)
            yield Bundle(degrees, wavelength, colour, setting.lens.from_scene_axes(origins.T, directions.T)[1].T, paths)


def _chosen_points(setting: Setting, degrees: float, view: View) -> Array:
    """Return points (n, 2) of the plane of the first vertex.

    They step evenly over what passes, and go on beyond it as long as there is glass, unless the middle is obstructed;
    when nothing passes they step over the whole first surface.
    """
    points = fan_points(setting, degrees, view.section)
    origins, directions = section_rays(setting, degrees, points, view.section)
    passed = np.flatnonzero(setting.lens.trace(origins, directions, setting.wavelength_nm, "scene").passed)
    axis = 1 if view.section == "y" else 0
    line = points[:, axis]
    low, high = (line[passed[0]], line[passed[-1]]) if len(passed) > 1 else (line[0], line[-1])
    step = (high - low) / max(view.rays - 1, 1)
    below = above = 0
    if view.blocked and view.rays > 1 and step > 0:
        below, above = (int(min(view.rays, room // step)) for room in (low - line[0], line[-1] - high))
    if setting.lens.is_obstructed and len(passed) > 1:  # even steps would mostly end at the obstruction
        result = np.zeros((view.rays, 2))
        result[:, axis] = line[passed[np.linspace(0, len(passed) - 1, view.rays).astype(int)]]
        return result
    start = (low + high) / 2 if view.rays == 1 else low
    result = np.zeros((below + view.rays + above, 2))
    result[:, axis] = start + step * np.arange(-below, view.rays + above)
    return result


#
# The outline of a lens in its y-z or x-z section: surfaces by their sag, glass between them, the stop as two blades.
#
# Points are (z, height) in millimetres of the frame of the lens.

SAMPLES = 97
_BLADE = 0.35  # length of a stop's blade over its semi-diameter, where no neighbour's rim says more


def profile(lens: Lens, k: int, section: str) -> Array:
    """Return points (m, 2) of a surface from its lower to its upper rim."""
    surface = lens.surfaces[k]
    widest = max((s.semi_diameter for s in lens.surfaces if np.isfinite(s.semi_diameter)), default=1.0)
    reach = min(surface.semi_diameter, 1.2 * widest) * (1 - 1e-12)
    heights = np.linspace(-reach, reach, SAMPLES)
    zero = np.zeros_like(heights)
    x, y = (zero, heights) if section == "y" else (heights, zero)
    sag = surface.sag(x, y)
    good = np.isfinite(sag) & surface.clears(x, y) & (surface.region is None or surface.region.holds(x, y))
    points = np.stack([x, y, sag])[:, good]
    if surface.pose:
        points, _ = surface.pose.outward(points, points)
    return np.stack([points[2] + lens.vertices[k], points[1 if section == "y" else 0]], axis=1)


def lines(lens: Lens, k: int, section: str) -> list[Array]:
    """Return the pieces (m, 2) of a surface as drawn: both halves of a ring."""
    points = profile(lens, k, section)
    if not lens.surfaces[k].inner_semi_diameter:
        return [points]
    return [points[: len(points) // 2], points[len(points) // 2 :]]


def obstruction(lens: Lens, k: int, section: str) -> Array | None:
    """Return the ends (2, 2) of what stands in the middle of a ring in air, None where it is but a hole."""
    surface, before = lens.surfaces[k], lens.media[k]
    if not surface.inner_semi_diameter or surface.is_mirror or surface.glass != before:
        return None
    halves = lines(lens, k, section)
    return np.array([halves[0][-1], halves[1][0]])


def glass(lens: Lens, section: str, wavelength_nm: float) -> list[tuple[float, Array]]:
    """Return the index and the outline (m, 2) of the medium behind each surface where it is not air."""
    indices = lens.indices(wavelength_nm)
    outlines = []
    for k in range(len(lens.surfaces) - 1):
        if abs(indices[k + 1] - 1.0) > 1e-6:
            front, rear = profile(lens, k, section), profile(lens, k + 1, section)
            if len(front) > 1 and len(rear) > 1:
                outlines.append((float(indices[k + 1]), _join_rims(front, rear)))
    return outlines


def _medium_behind(lens: Lens, section: str, wavelength_nm: float, film_z: float) -> tuple[float, Array] | None:
    """Return index and outline of what fills the space up to the film, None for air."""
    index = float(lens.indices(wavelength_nm)[-1])
    if abs(index - 1.0) <= 1e-6:
        return None
    rear = profile(lens, len(lens.surfaces) - 1, section)
    return index, np.concatenate([rear, [[film_z, rear[-1, 1]], [film_z, rear[0, 1]]]])


def blades(lens: Lens, section: str) -> list[Array]:
    """Return the two blades (2, 2) of the stop, from its edge outwards."""
    if lens.stop_index is None:
        return []
    k = lens.stop_index
    edge = profile(lens, k, section)
    semi = lens.surfaces[k].semi_diameter
    near = [lens.surfaces[i] for i in (k - 1, k + 1) if 0 <= i < len(lens.surfaces)]
    wide = [surface.semi_diameter for surface in near if np.isfinite(surface.semi_diameter) and surface.region is None]
    length = max(_BLADE * semi, 1.1 * max(wide, default=0.0) - semi)
    along = edge[-1] - edge[0]
    outwards = along / np.hypot(*along) * length if np.any(along) else np.array([0.0, length])
    return [np.array([edge[0], edge[0] - outwards]), np.array([edge[-1], edge[-1] + outwards])]


def _join_rims(front: Array, rear: Array) -> Array:
    """Return the outline of the glass between two surfaces: rims join by an edge at the height of the wider one."""
    upper = _edge(front[-1], rear[-1])
    lower = _edge(rear[0], front[0])
    return np.concatenate([front, upper, rear[::-1], lower])


def _edge(start: Array, end: Array) -> Array:
    """Return the corners between two rims; a straight line when a ledge would cut through the other surface."""
    height = start[1] if abs(start[1]) > abs(end[1]) else end[1]
    ledge = np.array([[start[0], height], [end[0], height]])
    return np.empty((0, 2)) if (start[0] - end[0]) * np.sign(height) > 0 else ledge


WIDTH, MARGIN, HEAD, FOOT = 960.0, 20.0, 40.0, 54.0
_FOOT_LINE = 32.0  # of the key, above the lower edge
_LEAST_HEIGHT, _MOST_HEIGHT = 60.0, 700.0
_BLOCKED = "#c00000"
_MARK = 3.0  # half width of the mark on a blocked ray [pixels]


def draw_lens(setting: Setting, view: View | None = None, tracer: Tracer = reference) -> charts.Drawing:
    """Return the cross-section of a lens in use, with rays traced by a tracer."""
    view = view or View()
    beams = list(bundles(setting, view, tracer))
    lines = [(beam, ray, _flat(beam.line(setting, ray), view)) for beam in beams for ray in beam.shown(view.blocked)]
    outline = [profile(setting.lens, k, view.section) for k in range(len(setting.lens.surfaces))]
    outline += blades(setting.lens, view.section)
    film = _film(setting, [line[-1] for beam, ray, line in lines if beam.paths.last.status[ray] == Status.ok])
    frame = PixelFrame.around(
        [*outline, *([film] if film is not None else []), *(line for _, _, line in lines)], setting
    )
    picture = charts.Drawing(WIDTH, frame.height, _title(setting))
    draw_glass(picture, frame, setting, view)
    picture.add(charts.Path(_axis(frame, setting, view), charts.FAINT, 0.8, dash=(10, 3, 2, 3)))
    for beam, ray, line in lines:
        _draw_ray(picture, frame, beam, ray, line)
    draw_surfaces(picture, frame, setting, view)
    _draw_numbers(picture, frame, lines)
    if film is not None:
        picture.add(charts.Path(frame.places(film), charts.INK, 2.0, note="film"))
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
    return charts.svg_text(draw_lens(setting(lens, f_number, focus_distance_m), View(**view), tracer))


@dataclass(frozen=True)
class PixelFrame:
    """Millimetres to pixels, alike along both axes; the optical axis lies level."""

    scale: float
    left: float
    middle: float
    height: float

    @staticmethod
    def around(lines: Sequence[Array], setting: Setting) -> PixelFrame:
        """Return the frame that holds lines of points (z, height)."""
        size = size_of(setting.lens)
        points = np.concatenate(lines)
        left, right = float(points[:, 0].min()), float(points[:, 0].max())
        above = below = float(np.abs(points[:, 1]).max())
        if setting.lens.fold is None:
            left = max(left, -APPROACH * size - 0.5 * size)
        else:
            below, above = -float(points[:, 1].min()), float(points[:, 1].max())
        scale = min((WIDTH - 2 * MARGIN) / (right - left), _MOST_HEIGHT / (above + below))
        tall = max((above + below) * scale, _LEAST_HEIGHT)
        spare = (WIDTH - 2 * MARGIN) / scale - (right - left)
        middle = HEAD + tall / 2 + (above - below) / 2 * scale
        return PixelFrame(scale, left - spare / 2, middle, HEAD + tall + FOOT)

    def places(self, points: Array) -> list[charts.Point]:
        """Return pixels for points (z, height)."""
        return [(MARGIN + (z - self.left) * self.scale, self.middle - h * self.scale) for z, h in points.tolist()]

    def axis(self) -> list[charts.Point]:
        """Return the ends of the optical axis in pixels."""
        return [(MARGIN / 2, self.middle), (WIDTH - MARGIN / 2, self.middle)]


def _axis(frame: PixelFrame, setting: Setting, view: View) -> list[charts.Point]:
    """Return the optical axis in pixels, from mirror to mirror where they fold it."""
    lens = without_rims(setting.lens)
    if lens.fold is None:
        return frame.axis()
    origins, directions = section_rays(setting, 0.0, np.zeros((1, 2)), view.section)
    paths = ray_paths(lens, origins, directions, setting.wavelength_nm, reference)
    if not paths.last.passed[0]:
        return frame.axis()
    incoming = lens.from_scene_axes(origins.T, directions.T)[1].T
    return frame.places(_flat(Bundle(0.0, setting.wavelength_nm, "", incoming, paths).line(setting, 0), view))


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


def draw_glass(picture: charts.Drawing, frame: PixelFrame, setting: Setting, view: View) -> None:
    """Draw what lies between the surfaces."""
    media = glass(setting.lens, view.section, setting.wavelength_nm)
    if setting.film_distance_mm is not None:
        behind = _medium_behind(setting.lens, view.section, setting.wavelength_nm, setting.film_z)
        media += [behind] if behind else []
    for index, outline in media:
        note = f"index {index:.4f} at {setting.wavelength_nm:g} nm"
        picture.add(
            charts.Path(frame.places(outline), charts.INK, 0.6, charts.glass_colour(index), closed=True, note=note)
        )


def draw_surfaces(picture: charts.Drawing, frame: PixelFrame, setting: Setting, view: View) -> None:
    """Draw surfaces, obstructions and the stop."""
    for k, surface in enumerate(setting.lens.surfaces):
        flat_stop = surface.is_stop and surface.is_sphere and not (surface.curvature or surface.phase)
        block = obstruction(setting.lens, k, view.section)
        if block is not None:
            picture.add(charts.Path(frame.places(block), charts.INK, 3.5, note=f"obstruction, surface {k}"))
        elif not flat_stop:
            width = 2.2 if surface.is_mirror else 1.1
            for line in lines(setting.lens, k, view.section):
                picture.add(charts.Path(frame.places(line), charts.INK, width, note=f"surface {k}"))
    for blade in blades(setting.lens, view.section):
        picture.add(charts.Path(frame.places(blade), charts.INK, 3.5, note=f"stop, surface {setting.lens.stop_index}"))


def _draw_ray(picture: charts.Drawing, frame: PixelFrame, beam: Bundle, ray: int, line: Array) -> None:
    places = frame.places(line)
    status = Status(int(beam.paths.last.status[ray]))
    if status == Status.ok:
        picture.add(charts.Path(places, beam.colour, 0.9))
        return
    what = f"{status.name.replace('_', ' ')} at surface {beam.paths.last.surface[ray]}"
    picture.add(charts.Path(places, beam.colour, 0.5, dash=(3, 3), note=what))
    x, y = places[-1]
    for tilt in (-_MARK, _MARK):
        picture.add(charts.Path([(x - _MARK, y - tilt), (x + _MARK, y + tilt)], _BLOCKED, 1.3, note=what))


def _draw_numbers(picture: charts.Drawing, frame: PixelFrame, lines: Sequence[tuple[Bundle, int, Array]]) -> None:
    """Write the number of each surface that blocks rays beside its outermost mark."""
    marks: dict[int, charts.Point] = {}
    for beam, ray, line in lines:
        surface = int(beam.paths.last.surface[ray])
        (place,) = frame.places(line[-1:])
        if surface >= 0 and (surface not in marks or place[1] < marks[surface][1]):
            marks[surface] = place
    for surface, (x, y) in marks.items():
        picture.add(charts.Text((x + _MARK, y - _MARK - 1), str(surface), 10, colour=_BLOCKED))


def _draw_words(picture: charts.Drawing, setting: Setting, beams: Sequence[Bundle], view: View) -> None:
    picture.add(charts.Text((MARGIN, 24), picture.title, 15))
    draw_key(picture, dict.fromkeys((beam.colour, _label(beam, view)) for beam in beams))
    if view.blocked:
        picture.add(charts.Text((MARGIN, picture.height - 12), _blocked_text(beams), 11, colour=_BLOCKED))
    if setting.film_distance_mm is not None:
        text = f"last surface to film {setting.film_distance_mm:.4g} mm"
        picture.add(charts.Text((WIDTH - MARGIN, picture.height - _FOOT_LINE), text, 11, "end", charts.FAINT))


def draw_key(picture: charts.Drawing, entries: Iterable[tuple[str, str]]) -> None:
    """Draw what colours mean: a line of each, with its label."""
    place, below = MARGIN, picture.height - _FOOT_LINE
    for colour, label in entries:
        picture.add(
            charts.Path([(place, below - 4), (place + 22, below - 4)], colour, 2.5),
            charts.Text((place + 28, below), label),
        )
        place += 28 + 7 * len(label) + 22


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
