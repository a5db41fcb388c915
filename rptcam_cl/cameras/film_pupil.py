"""The opening of a camera as points of its film see it: which directions light comes from.

Directions are cosines (l, m) in x and y of the lens's frame, true ones also off the axis: in them the field that an
opening diffracts onto the film is a Fourier integral.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.aperture import stop_shape
from rptcam_cl.cameras.setting import LensSetting, lens_setting
from rptcam_cl.cameras.thick_lens import thick_lens_of
from rptcam_cl.cameras.thin_lens import optics_of, radius_of
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens, StopMask, StopShape, passing
from rptcam_cl.scene import RealisticCamera, Scene, ThickLensCamera, ThinLensCamera, at_opening

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACROSS = 144  # cells across the opening
FIRST_ACROSS = 48  # of the search for it
FINER = 4  # points across a cell that the edge runs through
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


def film_pupils(scene: Scene) -> Callable[[Array], FilmPupil]:
    """Return what gives the opening that a point of the film (x, y) sees [mm], in the frame of the lens.

    Raises
    ------
    InputError
        For a camera without an opening. What is returned raises it where no light reaches the film.
    """
    scene = at_opening(scene)
    camera = scene.camera
    if isinstance(camera, RealisticCamera):
        return _traced(_shaped(scene, camera, lens_setting(scene)))
    if isinstance(camera, ThickLensCamera):
        setting = lens_setting(scene)
        thick = thick_lens_of(setting.lens, setting.film_distance_mm, camera.wavelength_nm)
        index = float(setting.lens.indices(camera.wavelength_nm)[-1])
        return _flat(thick.film_slope, None, index, -1.0)
    if isinstance(camera, ThinLensCamera):
        across, _, focal_length = optics_of(camera, scene.film)
        radius, distance = radius_of(camera, focal_length), scene.film.size_m()[0] / 2 / across
        if radius > 0:
            slopes = (-1e-3 / distance, radius / distance)
            return _flat(slopes, stop_shape(scene, camera.aperture), 1.0, 1.0)
    raise InputError(
        "camera.diffraction: the camera has no opening that diffracts"
        " (allowed: off, or a camera with an f-number: thin_lens, thick_lens, realistic)"
    )


def _shaped(scene: Scene, camera: RealisticCamera, setting: LensSetting) -> LensSetting:
    shape = stop_shape(scene, camera.aperture)
    return setting if shape is None else replace(setting, lens=setting.lens.with_stop_shape(shape))


def _traced(setting: LensSetting) -> Callable[[Array], FilmPupil]:
    """Return the openings by rays traced from the film."""
    lens, wavelength = setting.lens, setting.camera.wavelength_nm
    film_z = lens.film_z(setting.film_distance_mm)
    rear = lens.surfaces[-1].semi_diameter
    index = float(lens.indices(wavelength)[-1])

    def seen(point: Array) -> FilmPupil:
        origin = np.array([point[0], point[1], film_z])

        def opens(cosines: Array) -> Mask:
            square = np.sum(cosines * cosines, axis=1)
            inside = square < 1
            along = -lens.sense * np.sqrt(np.where(inside, 1 - square, 1.0))
            directions = np.column_stack([-cosines, along])
            origins = np.broadcast_to(origin, directions.shape)
            passed = passing(lens, np.ascontiguousarray(origins), directions, wavelength)
            return np.asarray(inside & passed)

        return _pupil(opens, _rear_box(lens, origin, rear), index)

    return seen


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
    slopes: tuple[float, float], shape: StopShape | StopMask | None, index: float, sense: float
) -> Callable[[Array], FilmPupil]:
    """Return the openings of an ideal lens: its pupil is a disk across the axis.

    Parameters
    ----------
    slopes
        Sideways per unit of the axis, for a film point [mm] and for the edge of the pupil.
    sense
        1 where the slopes are those towards the pupil, and light has the opposite ones.
    """

    def seen(point: Array) -> FilmPupil:
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
        return _pupil(opens, np.stack([(low + high) / 2, np.full(2, float((high - low).max()) / 2 * 1.02)]), index)

    return seen


def _pupil(opens: OpenTo, box: Array, index: float) -> FilmPupil:
    """Return the opening that lies within a box (middle, half width) of cosines."""
    for _ in range(4):  # a small opening behind a large rear surface is found step by step
        x, y = _axes(box, FIRST_ACROSS)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        found = points[opens(points)]
        if not len(found):
            raise InputError("camera.diffraction: no light reaches the film there (allowed: off, or a smaller film)")
        step = x[1] - x[0]
        low, high = found.min(axis=0) - step, found.max(axis=0) + step
        half = float((high - low).max()) / 2
        narrow = half < 0.7 * box[1, 0]
        box = np.stack([(low + high) / 2, np.full(2, half)])
        if not narrow:
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


def _axes(box: Array, count: int) -> tuple[Array, Array]:
    offsets = ((np.arange(count) + 0.5) / count * 2 - 1) * box[1, 0]
    return box[0, 0] + offsets, box[0, 1] + offsets


def _by_an_edge(inside: Mask) -> Mask:
    """Return which cells touch one that differs; outside of the grid nothing is open."""
    wide = np.pad(inside, 1)
    count = len(inside)
    near = [wide[i : i + count, j : j + count] for i in range(3) for j in range(3)]
    return np.asarray(np.logical_or.reduce(near) & ~np.logical_and.reduce(near))
