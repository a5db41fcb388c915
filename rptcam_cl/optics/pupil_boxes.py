"""Boxes round the pupils that film points see: found even where they are much smaller than the rear element."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.optics.film_frame import UNMOVED, FilmFrame
from rptcam_cl.optics.probe import FilmProbe, Wavelengths, narrowed

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

COARSE = (16, 16)
FINE = (32, 16)  # half of a pupil, at one film point
NEAR = 1.0  # sizes of a pupil, round it, in which that of the next film point is sought


def narrowing_probes(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: Wavelengths,
    frame: FilmFrame = UNMOVED,
    azimuth: tuple[float, float] = (1.0, 0.0),
) -> list[FilmProbe]:
    """Return probes of the lens with its stop ever smaller: first as wide as any rim, then half that, last its own.

    A small pupil slips through a grid over the rear element; the next wider one tells where to look for it.
    """
    stops = [lens]
    if lens.stop is not None and lens.stop_index is not None:
        widest = max(surface.semi_diameter for surface in lens.surfaces if np.isfinite(surface.semi_diameter))
        while (radius := _stop_radius(stops[0])) < widest:
            surfaces = list(lens.surfaces)
            surfaces[lens.stop_index] = replace(lens.stop, semi_diameter=2 * radius)
            stops.insert(0, replace(lens, surfaces=tuple(surfaces)))
    return [FilmProbe(stopped, film_distance_mm, wavelength_nm, frame, azimuth) for stopped in stops]


def _stop_radius(lens: Lens) -> float:
    assert lens.stop is not None
    return lens.stop.semi_diameter


def pupil_boxes(
    probes: list[FilmProbe],
    film: Array,
    shape: tuple[int, int] = COARSE,
    *,
    radial: bool = False,
    in_order: bool = False,
) -> tuple[Array, Mask]:
    """Return boxes (m, 4) round the pupil as seen from film points (m, 2), a cell wider, and where it is open.

    Film points along +x of a rotationally symmetric lens (`radial`) see pupils that are the same above as below, so
    that half of each is enough. Of film points `in_order` each is near the one before.
    """
    if radial:
        shape = (shape[0], shape[1] // 2)
    boxes = _upper(probes[-1].windows(film), radial)
    found = np.ones(len(film), dtype=bool)
    for probe in (*probes, probes[-1]):
        boxes, hit = narrowed(probe, film, boxes, shape)
        boxes = _upper(boxes, radial)
        found &= hit
    if not found.all():
        near = _upper(_paraxial_boxes(probes[-1], film[~found]), radial)
        for _ in range(2):
            near, again = narrowed(probes[-1], film[~found], near, shape)
            near = _upper(near, radial)
        boxes[~found] = near
        found[~found] = again
    if radial or in_order:
        _follow(probes[-1], film, boxes, found, radial)
    if radial:
        boxes[:, 2] = -boxes[:, 3]
    return boxes, found


def _follow(probe: FilmProbe, film: Array, boxes: Array, found: Mask, radial: bool) -> None:
    """Find pupils that slipped through, near those of the film points before: they shrink and move step by step."""
    for k in range(1, len(film)):
        if found[k - 1] and not found[k]:
            boxes[k], found[k] = box_near(probe, film[k : k + 1], boxes[k - 1], radial=radial)


def box_near(probe: FilmProbe, film: Array, box: Array, *, radial: bool) -> tuple[Array, bool]:
    """Return the box round the pupil seen from one film point (1, 2), sought near another one's, and if it is open."""
    width, height = NEAR * (box[1] - box[0]), box[3] if radial else NEAR * (box[3] - box[2])
    low, high = (0.0, (1.0 + NEAR) * height) if radial else (box[2] - height, box[3] + height)
    around = np.array([[box[0] - width, box[1] + width, low, high]])
    around, hit = narrowed(probe, film, around, FINE)
    return around[0], bool(hit[0])


def _upper(boxes: Array, radial: bool) -> Array:
    """Return boxes without their lower halves."""
    if radial:
        boxes[:, 2] = 0.0
    return boxes


def _paraxial_boxes(probe: FilmProbe, film: Array) -> Array:
    """Return boxes (m, 4) thrice as large as the paraxial exit pupil, on the plane of the last vertex."""
    pupil = probe.lens.first_order(probe.wavelength_nm).exit_pupil
    distances = probe.distances(film)[:, None]
    from_film = distances - pupil.distance_mm
    if not np.all(np.isfinite(from_film) & (from_film != 0.0)):
        return probe.windows(film)
    shrink = distances / from_film
    centres, reach = film * (1.0 - shrink), 1.5 * abs(shrink) * pupil.diameter_mm
    low, high = centres - reach, centres + reach
    return np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)
