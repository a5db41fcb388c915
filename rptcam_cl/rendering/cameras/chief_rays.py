"""Chief rays of a camera in float64: one for each place of the picture, that of each point; breathing; focus scales."""

from __future__ import annotations

import copy
import csv
import io
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.remember import remember
from rptcam_cl.optics.beams import ChiefRays, aimed_rays, film_chief_rays, round_chief_rays
from rptcam_cl.optics.charts import add_key, new_chart, series, styled
from rptcam_cl.optics.irradiance import t_number
from rptcam_cl.optics.lens import Lens, film_distance, focus_reach_mm, nearest_object_distance, shift_of, thick_lens_of
from rptcam_cl.optics.ray_trace import IDEAL, LensTransmission
from rptcam_cl.rendering.cameras.pupil import FilmGrid, by_content
from rptcam_cl.rendering.cameras.setting import LensSetting, film_frame, focused, half_film_mm
from rptcam_cl.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#
# Chief rays: one ray for each place of the picture, through the middle of the opening, in float64.
#
# They are the rays that a picture taken through the smallest opening is made of, so what they meet lies where the
# picture shows it. Those of a real lens run from the film through the centre of its stop and on through every
# surface.

Array = NDArray[np.float64]

NODES = 65  # across the film and down, at which chief rays are aimed
REACH = 1.25  # of these nodes, in half films, so that places beside the picture are known too


class CameraRays(ABC):
    """The chief rays of a camera, in its frame: x to the right, y up, looking along -z, the eye at the origin.

    Attributes
    ----------
    resolution : (width, height)
        Of the whole film [pixels]; places are columns and rows in it, and pixel (0, 0) covers 0 to 1.
    """

    def __init__(self, scene: Scene) -> None:
        self.resolution = scene.film.resolution
        self._sign = 1.0 if scene.camera.flip else -1.0

    @abstractmethod
    def rays(self, places: Array) -> tuple[Array, Array]:
        """Return origins [m] and unit directions (n, 3) of the chief rays of places (n, 2); nan where none passes."""

    def rays_of_few(self, places: Array) -> tuple[Array, Array]:
        """Return the same sooner, where there are hundreds of places and not thousands."""
        return self.rays(places)

    def unlimited(self, places: Array) -> tuple[Array, Array]:
        """Return the same as if the lens had no rims."""
        return self.rays(places)

    def smooth(self, places: Array) -> tuple[Array, Array]:
        """Return about the same as `unlimited` in a part of its time, for searches."""
        return self.rays(places)

    def wider(self, reach: float) -> CameraRays:
        """Return the same as far beside the film [half films]."""
        return self

    @property
    def wraps(self) -> bool:
        """Whether the left edge of the picture follows its right edge."""
        return False

    def upright(self, places: Array) -> Array:
        """Return places (n, 2) right and up in the upright picture, to 1 at its edges."""
        film = 2.0 * np.asarray(places, np.float64) / self.resolution - 1.0
        return np.asarray(film * (self._sign, -self._sign))

    def on_picture(self, upright: Array) -> Array:
        """Return the places (n, 2) of what `upright` returns."""
        return np.asarray((upright * (self._sign, -self._sign) + 1.0) / 2.0 * self.resolution)


class SphereRays(CameraRays):
    """The chief rays of a camera that sees the whole sphere, in longitude and latitude."""

    def rays(self, places: Array) -> tuple[Array, Array]:
        """Return origins [m] and unit directions (n, 3), all from the eye."""
        longitude, latitude = (self.upright(places) * (np.pi, np.pi / 2)).T
        flat = np.cos(latitude)
        directions = np.stack([flat * np.sin(longitude), np.sin(latitude), -flat * np.cos(longitude)], axis=1)
        return np.zeros_like(directions), directions

    @property
    def wraps(self) -> bool:
        """Whether the left edge of the picture follows its right edge: it does."""
        return True


class PerspectiveRays(CameraRays):
    """The chief rays of an ideal camera: a film point h is joined to the scene by ``height h + z slope h``.

    Parameters
    ----------
    scene : Scene
    height, slope : float
        Factors of a film point [mm]: where its ray meets the plane at ``origin_z`` [m], and its tangent in the scene.
    film_slope : float
        The tangent behind the lens, likewise, by which a film that is tilted sees another point.
    origin_z : float
        Of that plane in the frame of the camera [m].
    """

    def __init__(self, scene: Scene, height: float, slope: float, film_slope: float, origin_z: float) -> None:
        super().__init__(scene)
        self._frame, self._half = film_frame(scene.camera), np.array(half_film_mm(scene))
        self._height, self._slope, self._film_slope, self._z = height, slope, film_slope, origin_z

    def rays(self, places: Array) -> tuple[Array, Array]:
        """Return origins [m] and unit directions (n, 3)."""
        film = self._frame.points(-self.upright(places) * self._half)
        there = film[:, :2] / (1.0 + film[:, 2:] * self._film_slope)
        one = np.ones((len(there), 1))
        directions = np.hstack([self._slope * there, -one])
        origins = np.hstack([self._height * there, self._z * one])
        return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


class TracedRays(CameraRays):
    """The chief rays of a lens, traced surface by surface; where rims stop the chief ray there is none."""

    def __init__(self, scene: Scene, setting: LensSetting) -> None:
        super().__init__(scene)
        self._frame, self._half = film_frame(scene.camera), np.array(half_film_mm(scene))
        self._lens, self._back, self._nm = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
        self._reach = REACH

    def wider(self, reach: float) -> CameraRays:
        """Return the same as far beside the film [half films]."""
        other = copy.copy(self)
        vars(other).pop("_grid", None)
        other._reach = reach
        return other

    @cached_property
    def _grid(self) -> FilmGrid:
        """Aims and rays at the nodes."""
        sides = np.linspace(-self._reach, self._reach, NODES)
        nodes = np.stack(np.meshgrid(sides, sides), axis=-1).reshape(-1, 2)
        rays = _grid_rays(self._lens, self._film(nodes), self._nm)
        values = np.where(rays.found[:, None], np.hstack([rays.aims, *self._in_camera(rays)]), np.nan)
        return FilmGrid(values.reshape(NODES, NODES, -1), self._reach)

    def rays(self, places: Array) -> tuple[Array, Array]:
        """Return origins [m] and unit directions (n, 3); nan where rims stop the ray."""
        upright = self.upright(places)
        rays = self._aim(upright)
        return _keep_rays(self._in_camera(rays), rays.clear)

    def rays_of_few(self, places: Array) -> tuple[Array, Array]:
        """Return the same, each ray aimed for itself."""
        is_plain = self._lens.is_rotational and self._frame.is_flat
        rays = (round_chief_rays if is_plain else film_chief_rays)(
            self._lens, self._film(self.upright(places)), self._nm
        )
        return _keep_rays(self._in_camera(rays), rays.clear)

    def unlimited(self, places: Array) -> tuple[Array, Array]:
        """Return the same as if the lens had no rims."""
        rays = self._aim(self.upright(places))
        return _keep_rays(self._in_camera(rays), rays.found)

    def smooth(self, places: Array) -> tuple[Array, Array]:
        """Return about the same, by cubics between nodes."""
        values = self._grid.at(self.upright(places))
        directions = values[:, 5:]
        return values[:, 2:5], directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def _film(self, upright: Array) -> Array:
        """Return places right and up in the picture on the film (n, 3), in the frame of the lens [mm]: it inverts."""
        points = self._frame.points(-upright * self._half)
        points[:, 2] = self._lens.film_z(self._back) + self._lens.sense * points[:, 2]
        return points

    def _aim(self, upright: Array) -> ChiefRays:
        return aimed_rays(self._lens, self._film(upright), self._grid.at(upright)[:, :2], self._nm)

    def _in_camera(self, rays: ChiefRays) -> tuple[Array, Array]:
        """Return origins [m] and directions in the frame of the camera."""
        return (rays.origins - [0.0, 0.0, self._lens.film_z(self._back)]) * 1e-3, rays.directions


_grid_rays = remember(most=8, by=lambda lens, points, nm: by_content(lens, points.tobytes(), nm))(film_chief_rays)


def _keep_rays(rays: tuple[Array, Array], keep: NDArray[np.bool_]) -> tuple[Array, Array]:
    origins, directions = (np.where(keep[:, None], each, np.nan) for each in rays)
    return origins, directions


# Where the picture shows a point: the place whose chief ray meets it, found in float64.

Rays = Callable[[Array], tuple[Array, Array]]

ROUNDS = 12  # of Newton's iteration, which needs three to six
DIFFERENCE = 0.25  # pixels over which slopes are taken
CLOSE = 1e-7  # pixels, where the search ends
AHEAD = 0.999  # cosine above which a ray found counts as one to the point and not away from it
TRIALS = 33  # places each way from which a search without a guess begins


def seen_places(chief: CameraRays, points: Array, guess: Array | None = None) -> Array:
    """Return the places (n, 2) [pixels] at which points are seen; nan where no chief ray leads to them.

    Places beside the picture count as well: all of an ideal camera, those near the film of a lens.

    Parameters
    ----------
    points : (n, 4) array
        Homogeneous, in the frame of the camera [m]: x, y, z and 1, or a direction and 0 for what is at infinity.
    guess : (n, 2) array, optional
        Places near by.
    """
    if len(points) == 0:
        return np.zeros((0, 2))
    if chief.wraps:
        return _on_whole_sphere(chief, points)
    places = _nearest_trials(chief, points) if guess is None else np.array(guess, np.float64)
    solved = np.full_like(places, np.nan)
    active = np.flatnonzero(np.isfinite(places).all(axis=1) & np.isfinite(points).all(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(ROUNDS):
            step = _step(chief, chief.smooth, places[active], points[active])
            places[active] -= step
            done = np.abs(step).max(axis=1) < CLOSE
            lost = ~np.isfinite(places[active]).all(axis=1)
            solved[active[done]] = places[active[done]]
            active = active[~(done | lost)]
            if not len(active):
                break
        solved -= _step(chief, chief.unlimited, solved, points)
    return _ahead(chief, points, solved)


def _step(chief: CameraRays, rays: Rays, places: Array, points: Array) -> Array:
    """Return by how much places (n, 2) are beside those that see the points, to first order [pixels]."""
    smooth, axes = _miss(chief.smooth, places, points)
    (a, c), (b, d) = (
        (_miss(chief.smooth, places + move, points, axes)[0] - smooth).T / DIFFERENCE for move in np.eye(2) * DIFFERENCE
    )
    x, y = (smooth if rays == chief.smooth else _miss(rays, places, points, axes)[0]).T
    return np.asarray(np.stack([d * x - b * y, a * y - c * x], axis=1) / (a * d - b * c)[:, None])


def _ahead(chief: CameraRays, points: Array, places: Array) -> Array:
    """Return the places without those whose ray leads away from the point."""
    with np.errstate(invalid="ignore", divide="ignore"):
        origins, directions = chief.smooth(places)
        away = _towards(points, origins)
        good = np.sum(away * directions, axis=1) > AHEAD
    return np.where(good[:, None], places, np.nan)


def _towards(points: Array, origins: Array) -> Array:
    away = points[:, :3] - points[:, 3:] * origins
    return np.asarray(away / np.linalg.norm(away, axis=1, keepdims=True))


def _miss(
    rays: Rays, places: Array, points: Array, axes: tuple[Array, Array] | None = None
) -> tuple[Array, tuple[Array, Array]]:
    """Return by how much the rays of places point beside the points, along two axes across the line of sight."""
    origins, directions = rays(places)
    away = _towards(points, origins)
    if axes is None:
        helper = np.where(np.abs(away[:, :1]) < 0.7, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
        first = np.cross(away, helper)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        axes = first, np.cross(away, first)
    beside = directions - np.sum(directions * away, axis=1, keepdims=True) * away
    return np.stack([np.sum(beside * axis, axis=1) for axis in axes], axis=1), axes


def _nearest_trials(chief: CameraRays, points: Array) -> Array:
    """Return the places of a grid over the film whose rays come nearest to the points."""
    width, height = chief.resolution
    grid = np.stack(np.meshgrid(np.linspace(0, width, TRIALS), np.linspace(0, height, TRIALS)), axis=-1).reshape(-1, 2)
    origins, directions = chief.smooth(grid)
    at, scale = points[:, :3], points[:, 3:]
    along = at @ directions.T - scale * np.sum(origins * directions, axis=1)
    square = np.sum(at**2, axis=1, keepdims=True) - 2 * scale * (at @ origins.T) + scale**2 * np.sum(origins**2, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosines = along / np.sqrt(square)
    return np.asarray(grid[np.argmax(np.nan_to_num(cosines, nan=-1.0), axis=1)])


def _on_whole_sphere(chief: CameraRays, points: Array) -> Array:
    x, y, z = _towards(points, np.zeros((len(points), 3))).T
    upright = np.stack([np.arctan2(x, -z) / np.pi, np.arcsin(np.clip(y, -1, 1)) / (np.pi / 2)], axis=1)
    return chief.on_picture(upright)


# Breathing: how the field of view and the speed of a lens change as it focuses nearer, and as it zooms.

Row = dict[str, float | str | None]


def breathing_table(
    lenses: Sequence[tuple[str, Lens]],
    distances_m: Sequence[float],
    film_width_mm: float,
    wavelength_nm: float,
    transmission: LensTransmission = IDEAL,
) -> list[Row]:
    """Return a row for each position of a zoom lens and each distance from the object to the film.

    Each has the focal length and the film distance [mm], the field of view across the film [degrees] by chief rays of
    first-order optics, by how much more the film sees than at the first distance [% of the tangent], the magnification,
    and the f-number and T-number that light the film's centre as much: E = pi / (4 T^2), without losses and with them.

    Raises
    ------
    InputError
        When the lens does not reach a distance, or has no one focal length.
    """

    rows: list[Row] = []
    for name, lens in lenses:
        first: float | None = None
        for distance in distances_m:
            state, film_distance_mm = focused(lens, 1000 * distance, "film", "thick", wavelength_nm)
            thick = thick_lens_of(state, film_distance_mm, wavelength_nm)
            tangent = film_width_mm / 2 * abs(thick.slope[0])
            first = tangent if first is None else first
            ahead = 1000 * distance - state.film_z(film_distance_mm)  # of the first vertex
            speeds = (t_number(state, film_distance_mm, wavelength_nm, losses) for losses in (IDEAL, transmission))
            row: Row = {
                "zoom": name,
                "focus_distance_m": distance if math.isfinite(distance) else None,
                "focal_length_mm": state.first_order(wavelength_nm).focal_length_mm,
                "film_distance_mm": film_distance_mm,
                "field_of_view_degrees": 2 * math.degrees(math.atan(tangent)),
                "breathing_percent": 100 * (tangent / first - 1),
                "magnification": 1 / abs(thick.height[0] + ahead * thick.slope[0]) if math.isfinite(ahead) else 0.0,
            }
            rows.append(row | dict(zip(("working_f_number", "t_number"), speeds, strict=True)))
    return rows


def breathing_csv(rows: Sequence[Row]) -> str:
    """Return the rows as comma-separated values with a head; infinity is an empty cell."""
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


@styled()
def breathing_chart(title: str, rows: Sequence[Row]) -> Figure:
    """Return the breathing of each zoom position over the magnification."""
    largest = max(_number(row["magnification"]) for row in rows)
    labels = ("magnification", "wider field of view than at the first distance [%]")
    figure, axes = new_chart(f"{title}: breathing", labels, (0.0, largest * 1.02 or 1.0))
    for k, name in enumerate(dict.fromkeys(row["zoom"] for row in rows)):
        own = [row for row in rows if row["zoom"] == name]
        x, y = ([_number(row[key]) for row in own] for key in ("magnification", "breathing_percent"))
        axes.plot(x, y, "o-", color=series(k), label=str(name))
    add_key(figure, axes.lines)
    return figure


def _number(value: float | str | None) -> float:
    assert isinstance(value, int | float)
    return float(value)


# The scale on the ring that focuses a lens: how far it turns, and what moves, for each distance that is engraved.

_ENGRAVED = (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 7.0)  # times powers of ten [m]
NEAREST = 10.0  # focal lengths: the end of the scale of a lens of which nothing says how near it focuses
APART = 0.02  # of the throw, between two marks
_FEET = 0.3048


def _nearest_focus_mm(lens: Lens, wavelength_nm: float) -> float:
    """Return the nearest distance from the object to the film that a scale has [mm].

    It is that of the lens file: of its floating groups, or what its focusing group reaches. A lens that focuses as a
    whole has none; there it is 10 focal lengths.
    """
    if lens.floating:
        return min(state.distance_mm for state in lens.floating)
    if lens.focusing is not None:
        film = film_distance(lens, np.inf, wavelength_nm=wavelength_nm)
        return focus_reach_mm(lens, film, wavelength_nm)[0] * (1 + 1e-9)  # the last shift itself rounds
    length = lens.first_order(wavelength_nm).focal_length_mm
    return max(NEAREST * length, nearest_object_distance(lens, wavelength_nm=wavelength_nm))


def _engraved_distances(nearest_m: float) -> list[float]:
    """Return distances from the object to the film that a scale may have, from infinity to the nearest [m]."""
    low = math.floor(math.log10(nearest_m))
    steps = [round(step * 10.0**power, 12) for power in range(low + 3, low - 1, -1) for step in reversed(_ENGRAVED)]
    return [math.inf, *(step for step in steps if step > 1.02 * nearest_m), nearest_m]


def focus_scale(
    lenses: Sequence[tuple[str, Lens]],
    wavelength_nm: float,
    throw_degrees: float,
    distances_m: Sequence[float] | None = None,
    nearest_m: float | None = None,
) -> list[Row]:
    """Return a row for each mark on the focus ring of a lens in each position of its zoom, which all have one scale.

    Each has the distance from the object to the film [m and feet], how far the ring has turned from infinity [degrees]
    where it turns in proportion to what moves, how far that is [mm] (the lens before its film, or the group in the
    lens), the distance from the last vertex to the film [mm], and the magnification. Without `distances_m` marks
    that would touch are left out.

    Raises
    ------
    InputError
        When the lens does not reach a distance.
    """

    rows: list[Row] = []
    near = nearest_m or max(_nearest_focus_mm(lens, wavelength_nm) for _, lens in lenses) / 1000
    marks = list(distances_m or _engraved_distances(near))
    for name, lens in lenses:
        states = [focused(lens, 1000 * distance, "film", "thick", wavelength_nm) for distance in (*marks, math.inf)]
        moved = [_focus_move_mm(lens, state, film, states[-1][1]) for state, film in states]
        whole = max(map(abs, moved))
        last = math.inf
        for distance, (state, film), shift in zip(marks, states, moved, strict=False):
            turn = throw_degrees * abs(shift) / whole if whole else 0.0
            touches = abs(turn - last) < APART * throw_degrees or throw_degrees - turn < APART * throw_degrees
            if distances_m is None and touches and distance not in (marks[0], marks[-1]):
                continue
            last = turn
            thick = thick_lens_of(state, film, wavelength_nm)
            ahead = 1000 * distance - state.film_z(film)  # of the first vertex
            rows.append({
                "zoom": name,
                "focus_distance_m": distance if math.isfinite(distance) else None,
                "focus_distance_ft": distance / _FEET if math.isfinite(distance) else None,
                "turn_degrees": turn,
                "travel_mm": shift,
                "film_distance_mm": film,
                "magnification": 1 / abs(thick.height[0] + ahead * thick.slope[0]) if math.isfinite(ahead) else 0.0,
            })  # fmt: skip
    return rows


def _focus_move_mm(lens: Lens, state: Lens, film_distance_mm: float, at_infinity_mm: float) -> float:
    """Return how far what focuses a lens has moved from infinity [mm]."""
    if lens.floating or lens.focusing is not None:
        return shift_of(lens, state)
    return film_distance_mm + state.length - at_infinity_mm - lens.length


@styled()
def focus_scale_chart(title: str, rows: Sequence[Row]) -> Figure:
    """Return the scale as it stands on the ring: metres above, feet below, a line for each position of the zoom."""
    names = list(dict.fromkeys(str(row["zoom"]) for row in rows))
    figure, axes = new_chart(f"{title}: focus scale", ("turn of the focus ring [°]", ""), (-4.0, 0.0))
    widest = max(_number(row["turn_degrees"]) for row in rows)
    axes.set(xlim=(-0.06 * widest - 1, 1.06 * widest + 1), ylim=(len(names) - 0.4, -0.6))
    axes.set_yticks(range(len(names)), names)
    for row in rows:
        at, level = _number(row["turn_degrees"]), names.index(str(row["zoom"]))
        axes.plot([at, at], [level - 0.08, level + 0.08], color=series(0))
        for key, beside, unit in (("focus_distance_m", -0.14, "m"), ("focus_distance_ft", 0.14, "ft")):
            value = row[key]
            text = "∞" if value is None else f"{_number(value):.3g}"
            text += f" {unit}" if row is rows[-1] else ""
            where = "bottom" if beside < 0 else "top"
            axes.text(at, level + beside, text, rotation=90, verticalalignment=where, horizontalalignment="center")
    return figure
