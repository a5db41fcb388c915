"""Pupil sampling of a few windows of the film, for looks through a lens in many states: boxes where needed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.pupil import CELLS, EDGE_SPREAD, PROBES, SPREAD, without_shape
from rptcam_cl.cameras.pupil_sampling import PupilGrid, PupilSampling
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import PupilKind
from rptcam_cl.optics import (
    IDEAL,
    UNMOVED,
    FilmFrame,
    Lens,
    LensTransmission,
    axial_transmittance,
    narrowing_probes,
    pupil_boxes,
)

Window = tuple[float, float, float, float]
"""Part of the film: x from, x to, y from, y to [mm], in the frame of the lens."""


def pupil_in_windows(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: float,
    windows: Sequence[Window],
    frame: FilmFrame = UNMOVED,
) -> PupilSampling:
    """Return boxes round the pupils seen from the cells of the film that windows touch; from elsewhere it is dark.

    Of a film that is moved, `half_film_mm` are half the sides of what it takes about the axis.
    """
    lens = without_shape(lens)
    cells = _touched(half_film_mm, windows)
    corners = np.unique(np.concatenate([cells + np.array([i, j]) for i in (0, 1) for j in (0, 1)]), axis=0)
    size = 2 * np.array(half_film_mm) / CELLS
    probes = narrowing_probes(lens, film_distance_mm, wavelength_nm, frame)
    boxes, found = pupil_boxes(probes, corners * size - half_film_mm, PROBES)
    if not found.any():
        raise InputError(f"{lens.name}: no light reaches the zones {film_distance_mm:g} mm behind the lens")
    place = {tuple(corner): k for k, corner in enumerate(corners.tolist())}
    table = np.zeros((CELLS, CELLS, 4), np.float32)
    for x, y in cells.tolist():
        around = [place[x + i, y + j] for i in (0, 1) for j in (0, 1)]
        table[y, x] = _around(boxes[around], found[around])
    parameters = PupilGrid(1 / size[0], 1 / size[1], CELLS, CELLS)
    return PupilSampling("windows", PupilKind.BOXES, parameters, table.ravel())


def _touched(half_film_mm: tuple[float, float], windows: Sequence[Window]) -> NDArray[np.int64]:
    """Return the cells (n, 2) of the film, across and down, that windows touch."""
    touched = np.zeros((CELLS, CELLS), np.bool_)
    for window in windows:
        low, high = np.array(window).reshape(2, 2).T
        first, last = (np.floor((edge / half_film_mm + 1) / 2 * CELLS).astype(int) for edge in (low, high))
        first, last = np.clip(first, 0, CELLS - 1), np.clip(last, 0, CELLS - 1)
        touched[first[0] : last[0] + 1, first[1] : last[1] + 1] = True
    return np.argwhere(touched)


def _around(boxes: NDArray[np.float64], found: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the corner and size of a box that holds the pupils of the corners of a cell, and a little more."""
    if not found.any():
        return np.zeros(4)
    low, high = boxes[found][:, ::2].min(axis=0), boxes[found][:, 1::2].max(axis=0)
    spread = (SPREAD if found.all() else EDGE_SPREAD) * (high - low)
    return np.concatenate([low - spread, high - low + 2 * spread])


def paraxial_irradiance(
    lens: Lens, film_distance_mm: float, wavelength_nm: float, transmission: LensTransmission = IDEAL
) -> float:
    """Return the irradiance of the centre of the film for unit radiance by first-order optics."""
    passed = float(axial_transmittance(lens, wavelength_nm, transmission))
    pupil = lens.first_order(wavelength_nm).exit_pupil
    if not np.isfinite(pupil.distance_mm):
        return passed * float(np.pi / (4 * lens.first_order(wavelength_nm).f_number ** 2))
    tangent = pupil.diameter_mm / 2 / (film_distance_mm - pupil.distance_mm)
    return passed * float(np.pi * tangent**2 / (1 + tangent**2))
