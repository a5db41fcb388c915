"""The opening of a camera as points of its film see it: which directions light comes from.

Directions are cosines (l, m) in x and y of the lens's frame, true ones also off the axis: in them the field that an
opening diffracts onto the film is a Fourier integral.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.aperture import stop_shape
from rptcam_cl.cameras.setting import LensSetting, lens_setting
from rptcam_cl.cameras.thick_lens import thick_lens_of
from rptcam_cl.cameras.thin_lens import optics_of, radius_of
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens, StopMask, StopShape, passing, with_wider_stop
from rptcam_cl.scene import (
    EnvironmentCamera,
    PinholeCamera,
    RealisticCamera,
    Scene,
    ThickLensCamera,
    ThinLensCamera,
    at_opening,
    unknown_camera,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACROSS = 144  # cells across the opening
FIRST_ACROSS = 48  # of the search for it
WIDER = (64.0, 16.0, 4.0)  # times the stop, through which an opening is found that no direction of the search meets
FINER = 4  # points across a cell that the edge runs through
CORNERS = 1024  # of an outline
HALVINGS = 24  # that find each
SAME_AREA = 0.02  # within which an outline and the cells inside it are one opening
OpenTo = Callable[[Array], Mask]  # which directions (n, 2), as cosines, are open


@dataclass(frozen=True)
class FilmPupil:
    """The opening as one point of the film sees it, on a square grid.

    Attributes
    ----------
    coverage : (n, n) array
        Share of each cell that is open; rows by m, columns by l.
    cosines_x, cosines_y : (n,) arrays
        l of the columns and m of the rows.
    index : float
        Of the medium in front of the film.
    """

    coverage: Array
    cosines_x: Array
    cosines_y: Array
    index: float

    @property
    def step(self) -> float:
        """Side of a cell in direction cosines."""
        return float(self.cosines_x[1] - self.cosines_x[0])

    @property
    def aperture(self) -> float:
        """Numerical aperture of the round opening of the same area, in the medium."""
        return float(np.sqrt(self.coverage.sum() / np.pi)) * self.step


@dataclass(frozen=True)
class FilmPupils:
    """What gives the opening that a point of the film (x, y) sees [mm], in the frame of the lens.

    Attributes
    ----------
    directions : callable
        Gives which directions are open to a point, and the middle and half width of a square of cosines about them.
    index : float
        Of the medium in front of the film.
    radius_mm : float
        Of the stop: of the circle that its shape touches.
    """

    directions: Callable[[Array], tuple[OpenTo, Array]]
    index: float
    radius_mm: float

    def __call__(self, point: Array) -> FilmPupil:
        """Return the opening as a grid.

        Raises
        ------
        InputError
            Where no light reaches the film.
        """
        return _pupil(*self.directions(point), self.index)

    def outline(self, point: Array) -> Array | None:
        """Return corners (n, 2) of the outline in direction cosines, anticlockwise about its middle, within 1e-6.

        None where a line from the middle crosses the outline twice, as in a mask of several holes.
        """
        opens, box = self.directions(point)
        grid = _pupil(opens, box, self.index)
        share = grid.coverage / grid.coverage.sum()
        middle = np.array([share.sum(axis=0) @ grid.cosines_x, share.sum(axis=1) @ grid.cosines_y])
        angles = 2 * np.pi * (np.arange(CORNERS) + 0.5) / CORNERS
        towards = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        near, far = np.zeros(CORNERS), np.full(CORNERS, grid.step * ACROSS * np.sqrt(2))
        for _ in range(HALVINGS):
            half = (near + far) / 2
            inside = opens(middle + half[:, None] * towards)
            near, far = np.where(inside, half, near), np.where(inside, far, half)
        area = 0.5 * np.sin(2 * np.pi / CORNERS) * float(near @ np.roll(near, -1))
        if abs(area / (grid.coverage.sum() * grid.step**2) - 1) > SAME_AREA:
            return None
        return np.asarray(middle + near[:, None] * towards)


def film_pupils(scene: Scene) -> FilmPupils:
    """Return what gives the opening that points of the film see.

    Raises
    ------
    InputError
        For a camera without an opening.
    """
    scene = at_opening(scene)
    camera = scene.camera
    if isinstance(camera, RealisticCamera):
        return _traced(_shaped(scene, camera, lens_setting(scene)))
    if isinstance(camera, ThickLensCamera):
        setting = lens_setting(scene)
        thick = thick_lens_of(setting.lens, setting.film_distance_mm, camera.wavelength_nm)
        index = float(setting.lens.indices(camera.wavelength_nm)[-1])
        return FilmPupils(_flat(thick.film_slope, None, -1.0), index, _stop_radius(setting.lens))
    if isinstance(camera, ThinLensCamera):
        across, _, focal_length = optics_of(camera, scene.film)
        radius, distance = radius_of(camera, focal_length), scene.film.size_m()[0] / 2 / across
        if radius > 0:
            slopes = (-1e-3 / distance, radius / distance)
            return FilmPupils(_flat(slopes, stop_shape(scene, camera.aperture), 1.0), 1.0, 1e3 * radius)
    elif not isinstance(camera, PinholeCamera | EnvironmentCamera):
        raise unknown_camera(scene.camera.kind, "what says its opening (rptcam_cl/cameras/film_pupil.py)")
    raise InputError(
        "camera.diffraction: the camera has no opening that diffracts"
        " (allowed: off, or a camera with an f-number: thin_lens, thick_lens, realistic)"
    )


def _shaped(scene: Scene, camera: RealisticCamera, setting: LensSetting) -> LensSetting:
    shape = stop_shape(scene, camera.aperture)
    return setting if shape is None else replace(setting, lens=setting.lens.with_stop_shape(shape))


def _stop_radius(lens: Lens) -> float:
    stop = lens.stop or lens.surfaces[0]
    return float(stop.semi_diameter)


def _traced(setting: LensSetting) -> FilmPupils:
    """Return the openings by rays traced from the film."""
    lens, wavelength = setting.lens, setting.camera.wavelength_nm
    if not any(np.isfinite(lens.first_order(wavelength, section).focal_length_mm) for section in "xy"):
        raise InputError(f"camera.diffraction: {lens.name}: is afocal, so it forms no image (allowed: off)")
    film_z = lens.film_z(setting.film_distance_mm)
    rear = lens.surfaces[-1].semi_diameter

    def seen(point: Array) -> tuple[OpenTo, Array]:
        origin = np.array([point[0], point[1], film_z])

        def opens_through(stopped: Lens) -> OpenTo:
            def opens(cosines: Array) -> Mask:
                square = np.sum(cosines * cosines, axis=1)
                inside = square < 1
                along = -lens.sense * np.sqrt(np.where(inside, 1 - square, 1.0))
                directions = np.column_stack([-cosines, along])
                origins = np.broadcast_to(origin, directions.shape)
                passed = passing(stopped, np.ascontiguousarray(origins), directions, wavelength)
                return np.asarray(inside & passed)

            return opens

        opens, box = opens_through(lens), _rear_box(lens, origin, rear)
        for factor in WIDER if lens.stop_index is not None and not len(_found(opens, box)) else ():
            found = _found(opens_through(with_wider_stop(lens, factor)), box)
            if not len(found):
                break
            box = _about(found, box)
        return opens, box

    return FilmPupils(seen, float(lens.indices(wavelength)[-1]), _stop_radius(lens))


def _rear_box(lens: Lens, origin: Array, rear: float) -> Array:
    """Return the middle and half width of a square of cosines that holds every ray through the rear surface."""
    turns = np.linspace(0.0, 2 * np.pi, 65)
    edge = rear * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    depths = lens.length + np.linspace(0.0, lens.surfaces[-1].rim_sag(rear * (1 - 1e-9)), 3)
    to_film = np.concatenate([np.column_stack([origin[:2] - edge, np.full(len(edge), origin[2] - z)]) for z in depths])
    cosines = to_film[:, :2] / np.linalg.norm(to_film, axis=1)[:, None]
    low, high = cosines.min(axis=0), cosines.max(axis=0)
    return np.stack([(low + high) / 2, np.full(2, float((high - low).max()) / 2 * 1.02)])


def _flat(
    slopes: tuple[float, float], shape: StopShape | StopMask | None, sense: float
) -> Callable[[Array], tuple[OpenTo, Array]]:
    """Return the openings of an ideal lens: its pupil is a disk across the axis.

    Parameters
    ----------
    slopes
        Sideways per unit of the axis, for a film point [mm] and for the edge of the pupil.
    sense
        1 where the slopes are those towards the pupil, and light has the opposite ones.
    """

    def seen(point: Array) -> tuple[OpenTo, Array]:
        middle = slopes[0] * np.asarray(point, dtype=np.float64)

        def opens(cosines: Array) -> Mask:
            square = np.sum(cosines * cosines, axis=1)
            towards = -sense * cosines / np.sqrt(np.where(square < 1, 1 - square, 1.0))[:, None]
            x, y = ((towards - middle) / slopes[1]).T
            inside = (square < 1) & (x * x + y * y <= 1)
            return np.asarray(inside if shape is None else inside & shape.holds(x, y))

        turns = np.linspace(0.0, 2 * np.pi, 65)
        edge = middle + abs(slopes[1]) * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        cosines = -sense * edge / np.sqrt(1 + np.sum(edge * edge, axis=1))[:, None]
        low, high = cosines.min(axis=0), cosines.max(axis=0)
        return opens, np.stack([(low + high) / 2, np.full(2, float((high - low).max()) / 2 * 1.02)])

    return seen


def _pupil(opens: OpenTo, box: Array, index: float) -> FilmPupil:
    """Return the opening that lies within a box (middle, half width) of cosines."""
    for _ in range(4):  # a small opening behind a large rear surface is found step by step
        found, before = _found(opens, box), box
        if not len(found):
            raise InputError("camera.diffraction: no light reaches the film there (allowed: off, or a smaller film)")
        box = _about(found, before)
        if not box[1, 0] < 0.7 * before[1, 0]:
            break
    x, y = _axes(box, ACROSS)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    within = ((np.arange(FINER) + 0.5) / FINER - 0.5) * (x[1] - x[0])
    moves = np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2)
    centre = opens(grid.reshape(-1, 2)).reshape(ACROSS, ACROSS)
    edge = _by_an_edge(centre)
    coverage = centre.astype(np.float64)
    coverage[edge] = np.mean([opens(grid[edge] + move) for move in moves], axis=0)
    return FilmPupil(coverage, x, y, index)


def _found(opens: OpenTo, box: Array) -> Array:
    """Return those of some directions (n, 2) over a box that are open."""
    points = np.stack(np.meshgrid(*_axes(box, FIRST_ACROSS)), axis=-1).reshape(-1, 2)
    return np.asarray(points[opens(points)])


def _about(found: Array, box: Array) -> Array:
    """Return the box about directions that `_found` has found, with room of a step."""
    x, _ = _axes(box, FIRST_ACROSS)
    step = x[1] - x[0]
    low, high = found.min(axis=0) - step, found.max(axis=0) + step
    return np.stack([(low + high) / 2, np.full(2, float((high - low).max()) / 2)])


def _axes(box: Array, count: int) -> tuple[Array, Array]:
    offsets = ((np.arange(count) + 0.5) / count * 2 - 1) * box[1, 0]
    return box[0, 0] + offsets, box[0, 1] + offsets


def _by_an_edge(inside: Mask) -> Mask:
    """Return which cells touch one that differs; outside of the grid nothing is open."""
    wide = np.pad(inside, 1)
    count = len(inside)
    near = [wide[i : i + count, j : j + count] for i in range(3) for j in range(3)]
    return np.asarray(np.logical_or.reduce(near) & ~np.logical_and.reduce(near))
