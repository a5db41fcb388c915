"""Ways of light that is reflected between surfaces on its way to the film, and their first-order data.

A way is named by the surfaces that reflect it, in order: (6, 3) passes surfaces 0 to 5, is reflected at 6, goes back
through 5 and 4, is reflected at 3 and passes 4 to the last. Unfolded, such a way is a lens with mirrors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.coating import constant_reflectance
from rptcam_cl.optics.first_order import system_matrix
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.surface import Surface

Way = tuple[int, ...]

ORDERS = (2, 4)


class Step(NamedTuple):
    """A surface on a way: its number, whether light comes to it on the way to the film, and whether it is reflected."""

    surface: int
    forward: bool
    reflects: bool


def check_order(order: int) -> None:
    """Raise an error when light that is reflected so often never reaches the film, or is not followed."""
    if order not in ORDERS:
        raise InputError(
            f"order: light reaches the film after an even number of reflections (got {order}; allowed: 2 or 4)"
        )


def check_lens(lens: Lens) -> None:
    """Raise an error when ghosts of a lens are not known."""
    if any(surface.region is not None and not surface.region.blocks for surface in lens.surfaces):
        raise InputError(f"{lens.name}: a half lens has rays beside its glass, so its ghosts are not known")


def with_film(lens: Lens, film_distance_mm: float, reflectance: float = 0.0) -> Lens:
    """Return the lens with its film as a last surface, a mirror of some reflectance."""
    last = replace(lens.surfaces[-1], thickness=lens.sense * film_distance_mm)
    film = Surface(glass=last.glass, is_mirror=True, coating=constant_reflectance(reflectance))
    return replace(lens, surfaces=(*lens.surfaces[:-1], last, film), configurations=(), focusing=None, floating=())


def with_wider_stop(lens: Lens, factor: float) -> Lens:
    """Return the lens with its stop wider by a factor, so that rays spread over the front find the way of the light."""
    k = lens.stop_index
    assert k is not None
    wider = replace(lens.surfaces[k], semi_diameter=lens.surfaces[k].semi_diameter * factor)
    return replace(lens, surfaces=(*lens.surfaces[:k], wider, *lens.surfaces[k + 1 :]))


def steps(way: Way, surfaces: int) -> Iterator[Step]:
    """Yield the surfaces that light meets on a way through so many of them."""
    k, forward = 0, True
    for turn in way:
        while k != turn:
            yield Step(k, forward, False)
            k += 1 if forward else -1
        yield Step(k, forward, True)
        forward = not forward
        k += 1 if forward else -1
    for rest in range(k, surfaces):
        yield Step(rest, True, False)


def unfolded(lens: Lens, way: Way) -> Lens:
    """Return a way as a lens of its own, whose mirrors are the surfaces that reflect."""
    met = list(steps(way, len(lens.surfaces)))
    media, vertices = lens.media, lens.vertices
    surfaces = []
    for here, following in zip(met, [*met[1:], None], strict=True):
        k = here.surface
        thickness = 0.0 if following is None else float(vertices[following.surface] - vertices[k])
        onward = here.forward != here.reflects
        surfaces.append(replace(
            lens.surfaces[k], thickness=thickness, glass=media[k + 1] if onward else media[k],
            is_mirror=here.reflects or lens.surfaces[k].is_mirror,
        ))  # fmt: skip
    stop = next((i for i, step in enumerate(met) if step.surface == lens.stop_index), None)
    return replace(lens, surfaces=tuple(surfaces), stop_index=stop, configurations=(), focusing=None, floating=())


@dataclass(frozen=True)
class GhostImage:
    """Where the image lies that paraxial light of a way forms [mm].

    Attributes
    ----------
    focal_length_mm : float
        Infinite where the way as a whole bends no light.
    image_distance_mm : float
        From the last vertex, of an object at infinity; positive towards the film.
    film_per_height, film_per_slope : float
        How far the ray on the film moves with its height and its slope in the plane of the first vertex.
    """

    focal_length_mm: float
    image_distance_mm: float
    film_per_height: float
    film_per_slope: float


def ghost_image(
    lens: Lens, way: Way, film_distance_mm: float, wavelength_nm: float, object_distance_mm: float = np.inf
) -> GhostImage:
    """Return the paraxial image of a way in the y-z section; a near object stands so far before the first vertex."""
    (a, b), (c, d) = system_matrix(unfolded(lens, way), wavelength_nm).tolist()
    n, m = (float(index) for index in lens.indices(wavelength_nm)[[0, -1]])
    with np.errstate(divide="ignore", invalid="ignore"):
        if np.isinf(object_distance_mm):
            image = -m * np.float64(a) / c
        else:
            reduced = object_distance_mm / n
            image = -m * np.float64(b + a * reduced) / (d + c * reduced)
        focal = -m / np.float64(c)
    reach = film_distance_mm / m
    return GhostImage(float(focal), float(image), a + reach * c, n * (b + reach * d))


def ghost_magnification(lens: Lens, way: Way, wavelength_nm: float, object_distance_mm: float) -> float:
    """Return the transverse magnification of an object so far before the first vertex [mm]."""
    _, (c, d) = system_matrix(unfolded(lens, way), wavelength_nm).tolist()
    n = float(lens.indices(wavelength_nm)[0])
    with np.errstate(divide="ignore"):
        return float(1.0 / np.float64(d + c * object_distance_mm / n))
