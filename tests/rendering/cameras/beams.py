"""Bundles of rays for tests, and lenses at the edge of what they let through."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session
from rptcam_cl.optics.film_probe import FilmProbe
from rptcam_cl.optics.glass import ConstantIndex
from rptcam_cl.optics.lens import Lens, film_distance
from rptcam_cl.optics.ray_trace import Rays
from rptcam_cl.rendering.traceable_lens import Precision, trace_on_device

Array = NDArray[np.float64]
PRECISIONS: tuple[Precision, ...] = ("single", "double")
# of the four lenses of the assignment: last vertex to film and half the diagonal of the film [mm]
ASSIGNMENT = {
    "dgauss-50mm": (36.77, 21.633),
    "wide-22mm": (14.54, 21.633),
    "fisheye-10mm": (23.192, 35.0),
    "telephoto-250mm": (123.7439, 35.0),
}


def generator(*names: Any) -> np.random.Generator:
    """Return random numbers that follow from the test."""
    return np.random.default_rng(crc32(" ".join(map(str, names)).encode()))


def on_device(
    session: Session,
    lens: Lens,
    origins: Any,
    directions: Any,
    precision: Precision = "single",
    start: str = "film",
    wavelength_nm: float = LINE_D_NM,
) -> Rays:
    """Return rays traced by the device."""
    return trace_on_device(lens, session, origins, directions, wavelength_nm, start, precision)


def back_distance(lens: Lens) -> float:
    """Return the distance [mm] to a film on which a far object is sharp, or to any film if there is none."""
    try:
        return film_distance(lens, 1e7)
    except InputError:
        return abs(lens.first_order().focal_length_mm)


@cache
def film_beam(
    lens: Lens, count: int, half_film_mm: float | None = None, film_distance_mm: float | None = None
) -> tuple[Array, Array]:
    """Return origins on a film and directions: half to all of the last surface, half of what comes from the scene."""
    rng = generator("film beam", lens.name)
    back = back_distance(lens) if film_distance_mm is None else film_distance_mm
    half = 0.3 * abs(lens.first_order().focal_length_mm) if half_film_mm is None else half_film_mm
    film = rng.uniform(-half, half, (count // 2, 2))
    boxes = FilmProbe(lens, back, LINE_D_NM).windows(film)
    aims = boxes[:, ::2] + rng.random(film.shape) * (boxes[:, 1::2] - boxes[:, ::2])
    origins = np.column_stack([film, np.full(len(film), lens.length + back)])
    directions = np.column_stack([aims - film, np.full(len(film), -back)])
    there, along = scene_beam(lens, rng, 4 * count)
    arriving = lens.trace(there, along, start="scene")
    found = np.flatnonzero(arriving.passed)[: count // 2]
    heading = arriving.directions[found]
    at_film = arriving.origins[found] + (lens.length + back - arriving.origins[found, 2:]) / heading[:, 2:] * heading
    beam = np.concatenate([origins, at_film]), np.concatenate([directions, -heading])
    for each in beam:  # every test of this lens has the same
        each.setflags(write=False)
    return beam


def scene_beam(lens: Lens, rng: np.random.Generator, count: int, slope: float = 0.3) -> tuple[Array, Array]:
    """Return origins on the vertex plane of the first surface, over its clear disk, and directions into the lens."""
    turn, radius = 2 * np.pi * rng.random(count), lens.surfaces[0].semi_diameter * np.sqrt(rng.random(count))
    origins = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(count)])
    return origins, np.column_stack([rng.uniform(-slope, slope, (count, 2)), np.ones(count)])


def scaled(lens: Lens, factor: float) -> Lens:
    """Return a lens of spheres and planes made larger."""
    surfaces = tuple(
        replace(
            surface,
            curvature=surface.curvature / factor,
            thickness=surface.thickness * factor,
            semi_diameter=surface.semi_diameter * factor,
        )
        for surface in lens.surfaces
    )
    return replace(lens, surfaces=surfaces)


def neighbours(lens: Lens, wavelength_nm: float = LINE_D_NM) -> Iterator[Lens]:
    """Yield the lens with rims 1e-5 wider and narrower, and with every glass 1e-5 denser and thinner.

    Where they disagree about a ray, it passes so near to a rim or the critical angle that float32 may err.
    """
    for share in (1 - 1e-5, 1 + 1e-5):
        rims = tuple(replace(s, semi_diameter=s.semi_diameter * share) for s in lens.surfaces)
        yield replace(lens, surfaces=rims)
        media = [float(index) for index in lens.indices(wavelength_nm)[1:]]
        denser = (ConstantIndex(n * share if n != 1 else n) for n in media)
        yield replace(lens, surfaces=tuple(replace(s, glass=g) for s, g in zip(lens.surfaces, denser, strict=True)))


def doubtful(lens: Lens, origins: Array, directions: Array, start: str = "film") -> NDArray[np.bool_]:
    """Return which rays pass within 1e-5 of a rim or of the critical angle."""
    rays = lens.trace(origins, directions, start=start)
    near = np.zeros(len(rays.status), dtype=bool)
    for other in neighbours(lens):
        traced = other.trace(origins, directions, start=start)
        near |= (traced.status != rays.status) | (traced.surface != rays.surface)
    return near
