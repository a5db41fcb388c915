"""Chief rays of round lenses from one fan of rays out of the centre of the stop, to both sides.

The fan depends neither on where the film stands nor on how wide the stop is, so it is traced once and kept: polynomials
in the tangent at the stop. A film point of any state finds its chief ray there by Newton's method, without tracing.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.chief_rays import ChiefRays, film_chief_rays
from rptcam_cl.optics.film_crossings import crossed
from rptcam_cl.optics.first_order import limiting_surface, system_matrix

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]

NODES = (20, 40)  # of a fan, where the first are too few
EXACT = 1e-12  # share of a quantity that its last polynomials may have
ROUNDING = 3e-15  # share that is left out
STEPS_OF_TANGENT = 8  # widths of fans while the tangent at the stop doubles
WIDER = 12  # steps by which a fan may have to be wider than first-order optics says
PLACES = 65  # at which a search begins
ROUNDS = 2  # of Newton's method, from within 1e-5
TELLS_APART = 10  # decimals of millimetres by which distances of film points from the axis differ
REMEMBERED = 128  # lenses whose fans are kept

_FANS: dict[tuple[object, ...], tuple[tuple[float, float], dict[int, _Fan | None]]] = {}


def round_chief_rays(lens: Lens, film_points: Array, wavelength_nm: float = LINE_D_NM) -> ChiefRays:
    """Return what `film_chief_rays` does for a round lens and points (n, 3) of one plane across its axis."""
    if (by_fan := fan_chief_rays(lens, film_points, wavelength_nm)) is not None:
        return by_fan
    distances, turns = np.hypot(*film_points[:, :2].T), np.arctan2(film_points[:, 1], film_points[:, 0])
    _, first, which = np.unique(np.round(distances, TELLS_APART), return_index=True, return_inverse=True)
    on_x = np.column_stack([distances[first], np.zeros(len(first)), film_points[first, 2]])
    rays, cosine, sine = film_chief_rays(lens, on_x, wavelength_nm), np.cos(turns), np.sin(turns)

    def turned(vectors: Array) -> Array:
        x, y = vectors[which, 0], vectors[which, 1]
        return np.column_stack([cosine * x - sine * y, sine * x + cosine * y, vectors[which, 2:]])

    found, clear = rays.found[which], rays.clear[which]
    return ChiefRays(turned(rays.origins), turned(rays.directions), found, clear, turned(rays.aims))


def fan_chief_rays(lens: Lens, film_points: Array, wavelength_nm: float) -> ChiefRays | None:
    """Return the chief rays of film points (n, 3) of one plane; None where no fan reaches them that is smooth enough.

    They do not depend on how wide the stop is, to the last bit.
    """
    if lens.has_mirrors:
        return None
    stop, back_mm = limiting_surface(lens, wavelength_nm), float(film_points[0, 2]) - lens.length
    x, y = film_points[:, 0], film_points[:, 1]
    radii = np.sqrt(x * x + y * y)
    (height, slope), fans = _fans_of(lens, stop, wavelength_nm)
    tangent = float(radii.max()) / max(abs(height + back_mm * slope), 1e-300)
    if not tangent > 0:
        return None
    step = math.ceil(STEPS_OF_TANGENT * math.log2(tangent))
    for width in range(step, step + WIDER):
        if width not in fans:
            fans[width] = _traced(lens, stop, wavelength_nm, 2.0 ** (width / STEPS_OF_TANGENT))
        fan = fans[width]
        if fan is None:
            return None
        if (found := fan.chief_rays(lens, film_points, radii, back_mm)) is not None:
            return found
    return None


def _fans_of(lens: Lens, stop: int, wavelength_nm: float) -> tuple[tuple[float, float], dict[int, _Fan | None]]:
    """Return what all states of the film and of the stop share: height on the plane of the last vertex and slope
    behind it over the tangent at the stop, to first order, and the fans by their width."""
    key = geometry_but_stop(lens, stop, wavelength_nm)
    if key not in _FANS:
        if len(_FANS) >= REMEMBERED:
            _FANS.clear()
        indices = lens.indices(wavelength_nm)
        (_, height), (_, slope) = (system_matrix(lens, wavelength_nm, stop) * indices[stop]).tolist()
        _FANS[key] = (height, slope / float(indices[-1])), {}
    return _FANS[key]


def geometry_but_stop(lens: Lens, stop: int, wavelength_nm: float) -> tuple[object, ...]:
    """Return all that rays of a wavelength through a round lens follow from, but how wide its stop is."""
    at = lens.surfaces[stop]
    of_stop = at.curvature, at.conic, at.aspheric, at.thickness, at.glass
    return lens.surfaces[:stop], of_stop, lens.surfaces[stop + 1 :], lens.object_medium, wavelength_nm


def _traced(lens: Lens, stop: int, wavelength_nm: float, tangent: float) -> _Fan | None:
    """Return the fan up to a tangent; None where a ray is lost or it is not smooth enough."""
    found = (_with_nodes(lens, stop, wavelength_nm, tangent, count) for count in NODES)
    return next((fan for fan in found if fan is not None), None)


def _with_nodes(lens: Lens, stop: int, wavelength_nm: float, tangent: float, count: int) -> _Fan | None:
    """Return a fan by rays at some nodes; None where a ray is lost or so few nodes leave errors."""
    angles = (np.arange(count) + 0.5) * np.pi / count
    tangents = tangent * np.sqrt((1.0 + np.cos(angles)) / 2)
    indices = lens.indices(wavelength_nm)
    points = np.zeros((3, count))
    points[2] = lens.vertices[stop]
    to_film = np.stack([tangents, np.zeros(count), np.ones(count)]) / np.hypot(1.0, tangents)
    behind, p, d = crossed(lens, range(stop, len(lens.surfaces)), points, to_film, indices, towards_film=True)
    ahead, origins, away = crossed(lens, range(stop - 1, -1, -1), points, -to_film, indices)
    slope = d[:, 0] / d[:, 2]
    height = p[:, 0] - slope * (p[:, 2] - lens.length)
    odd = np.stack([height, slope, origins[:, 0], away[:, 0], *ahead[..., 0], *behind[..., 0]], axis=1)
    values = np.column_stack([odd / tangents[:, None], origins[:, 2], away[:, 2]])
    if not np.isfinite(values).all():
        return None
    polynomials = 2.0 / count * np.cos(np.outer(np.arange(count), angles)) @ values
    polynomials[0] /= 2
    shares = np.abs(polynomials) / np.maximum(np.abs(values).max(axis=0), 1e-300)
    if np.any(shares[-2:] > EXACT):
        return None
    last = int(np.flatnonzero((shares > ROUNDING).any(axis=1))[-1])
    return _Fan(tangent, polynomials[: max(last, 1) + 1])


@dataclass(frozen=True, eq=False)
class _Fan:
    """Rays through the centre of the stop.

    Attributes
    ----------
    tangent : float
        At the stop, up to which they go.
    polynomials : (nodes, quantities) array
        Chebyshev polynomials of the square of the tangent t. Over t: the height on the plane of the last vertex [mm],
        the slope behind it, x on the first surface, x of the unit direction there, and x on every surface. Then z of
        the point on the first surface, and of that direction.
    """

    tangent: float
    polynomials: Array

    @cached_property
    def _begin(self) -> tuple[Array, Array]:
        """Tangents, and height and slope over them."""
        tangents = np.linspace(0.0, self.tangent, PLACES)
        return tangents, self._terms(tangents) @ self.polynomials[:, :2]

    @cached_property
    def _changes(self) -> Array:
        """Polynomials of the derivatives of height and slope."""
        found = np.zeros((len(self.polynomials), 2))
        found[:-1] = np.polynomial.chebyshev.chebder(self.polynomials[:, :2]) * (2 / self.tangent**2)
        return found

    def _terms(self, tangents: Array) -> Array:
        """Return the Chebyshev polynomials (n, nodes) at some tangents."""
        places = np.clip(2 * (tangents / self.tangent) ** 2 - 1, -1.0, 1.0)
        found = np.empty((len(self.polynomials), len(places)))
        found[0], found[1] = 1.0, places
        for k in range(2, len(found)):
            np.multiply(found[k - 1], 2 * places, out=found[k])
            found[k] -= found[k - 2]
        return found.T

    def chief_rays(self, lens: Lens, film_points: Array, radii: Array, back_mm: float) -> ChiefRays | None:
        """Return the chief rays of film points (n, 3) so far from the axis; None where it goes not so far."""
        places, begin = self._begin
        per_tangent = begin @ (1.0, back_mm)
        sign = np.sign(per_tangent[0])
        reached = sign * places * per_tangent
        if not (reached[-1] >= radii.max() and np.all(np.diff(reached) > 0)):
            return None
        by = sign * np.column_stack([self.polynomials[:, :2] @ (1.0, back_mm), self._changes @ (1.0, back_mm)])
        tangents = np.interp(radii, reached, places)
        for _ in range(ROUNDS):
            scale, change = (self._terms(tangents) @ by).T
            tangents = tangents - (tangents * scale - radii) / (scale + 2 * tangents**2 * change)
        found = self._terms(tangents) @ self.polynomials
        found[:, :-2] *= sign * tangents[:, None]
        rims = np.array([surface.semi_diameter for surface in lens.surfaces])
        turns = film_points[:, :2] / np.maximum(radii, 1e-300)[:, None]
        return ChiefRays(
            np.column_stack([turns * found[:, 2:3], found[:, -2]]),
            np.column_stack([turns * found[:, 3:4], found[:, -1]]),
            np.ones(len(radii), dtype=bool),
            np.all(np.abs(found[:, 4:-2]) <= rims, axis=1),
            turns * found[:, :1],
        )
