"""Pupils of a round lens at every width of its stop, from rays traced once.

From where the chief ray of a film point crosses the plane of the last vertex, rays are traced outwards: how far they
pass with the stop wide open, and at which height each crosses the stop. Along each direction a narrower stop lets rays
through up to the height of its rim, or as far as other rims let them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.chief_fan import round_chief_rays
from rptcam_cl.optics.chief_rays import ChiefRays
from rptcam_cl.optics.film_crossings import crossed
from rptcam_cl.optics.first_order import limiting_surface
from rptcam_cl.optics.probe import FilmProbe
from rptcam_cl.optics.pupil_shape import FARTHEST, FINE_OUTLINES, PupilShapes, between, envelope, film_line, reach_of

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]

FINENESS = replace(FINE_OUTLINES, scan=10, bisections=8, margin=0.005)
LEVELS = 8  # of rays between the middle and the farthest that passes
WIDEST = 0.95  # first-order radii of the pupil, of which rays are sought up to `FARTHEST` times as far


@dataclass(frozen=True, eq=False)
class StoppedPupils:
    """Rays of some states of a lens that are near each other: of its film, its focus or the wavelength.

    Attributes
    ----------
    radius_mm : float
        Of the film of the first state, up to which it goes. A film point of another stands at the place of the first's
        that lies in its direction from the last vertex.
    centres : (states, points) array
        Where chief rays of points on a film radius cross the plane of the last vertex [mm].
    reach : (states, points, directions) array
        How far from there rays pass with the stop wide open [mm], over half a turn.
    heights : (states, levels, points, directions) array
        Where rays at 1, 2, … of so many parts of this reach cross the stop: distance from its middle [mm].
    """

    radius_mm: float
    centres: Array
    reach: Array
    heights: Array

    def shapes(self, semi_diameter_mm: float) -> PupilShapes | None:
        """Return outlines that hold the pupils of all states with a stop of some radius; None where they are not
        star-shaped."""
        angles = np.linspace(0.0, np.pi, self.reach.shape[-1])
        reach = self._reach(semi_diameter_mm)
        u, v = self.centres[..., None] + reach * np.cos(angles), reach * np.sin(angles)
        low, high = u.min(axis=(0, 2))[::2], u.max(axis=(0, 2))[::2]
        axes = np.stack([(high - low) / 2, v.max(axis=(0, 2))[::2]], axis=1)
        centres = np.stack([(low + high) / 2, np.zeros(len(low))], axis=1)
        middle, half = between(centres)[:, :1], between(axes)
        u, v = (u - middle) / half[:, :1], v / half[:, 1:]
        turns, radii = np.arctan2(v, u), np.hypot(u, v)
        turns[..., 0], turns[..., -1] = 0.0, np.pi
        if not (np.all(np.diff(turns) > 0) and np.all(u[..., 0] > 0) and np.all(u[..., -1] < 0)):
            return None
        pairs = zip(turns.reshape(-1, len(angles)), radii.reshape(-1, len(angles)), strict=True)
        even = np.array([np.interp(angles, turn, radius) for turn, radius in pairs]).reshape(reach.shape).max(axis=0)
        outline = np.concatenate([even, even[:, -2:0:-1]], axis=1)
        wider = envelope(outline[None], FINENESS.directions) * (1.0 + FINENESS.margin)
        return PupilShapes(np.array([self.radius_mm]), centres[None], axes[None], wider)

    def _reach(self, height: float) -> Array:
        """Return how far rays pass a stop that is open up to a height."""
        levels = np.arange(1, LEVELS + 1)[:, None, None] / LEVELS
        scales = levels * self.reach[:, None] / self.heights
        above = np.clip(np.sum(self.heights <= height, axis=1, keepdims=True), 1, LEVELS - 1)
        low, high = above - 1, above
        h0, h1 = (np.take_along_axis(self.heights, at, axis=1)[:, 0] for at in (low, high))
        s0, s1 = (np.take_along_axis(scales, at, axis=1)[:, 0] for at in (low, high))
        return np.minimum(height * (s0 + (s1 - s0) * (height - h0) / (h1 - h0)), self.reach)


def stopped_pupils(
    states: Sequence[tuple[Lens, float]], radius_mm: float, wavelengths_nm: Sequence[float]
) -> StoppedPupils | None:
    """Return what rays of a round lens with its stop wide open, and last vertex to film [mm], say of narrower stops.

    It goes as far as the film, or as chief rays come through. None where something stands in the middle of a pupil or
    where rays bend too much to say.
    """
    back_mm, line = states[0][1], film_line(radius_mm, FINENESS.radial_nodes)
    clear = np.logical_and.reduce([
        _chief(lens, back, line * (back / back_mm), nm).clear for lens, back in states for nm in wavelengths_nm
    ])  # fmt: skip
    if not clear.all():
        radius_mm = float(line[max(int(np.argmin(clear)) - 1, 0), 0])
    if not radius_mm > 0:
        return None
    film = film_line(radius_mm, FINENESS.radial_nodes)
    found = []
    for lens, back in states:
        for wavelength_nm in wavelengths_nm:
            of_state = _traced(lens, back, film * (back / back_mm), wavelength_nm)
            if of_state is None:
                return None
            found.append(of_state)
    centres, reach, heights = (np.array(values) for values in zip(*found, strict=True))
    return StoppedPupils(radius_mm, centres, reach, heights)


def _chief(lens: Lens, back_mm: float, film: Array, wavelength_nm: float) -> ChiefRays:
    return round_chief_rays(lens, np.column_stack([film, np.full(len(film), lens.film_z(back_mm))]), wavelength_nm)


def _traced(lens: Lens, back_mm: float, film: Array, wavelength_nm: float) -> tuple[Array, Array, Array] | None:
    """Return centres, reach and heights of one state."""
    stop, pupil = limiting_surface(lens, wavelength_nm), lens.first_order(wavelength_nm).exit_pupil
    size = abs(WIDEST * pupil.diameter_mm / 2 * back_mm / (back_mm - pupil.distance_mm))
    chief = _chief(lens, back_mm, film, wavelength_nm)
    if not (np.isfinite(size) and chief.clear.all()) or lens.is_obstructed:
        return None
    centres, axes = chief.aims, np.full(film.shape, size)
    half = reach_of(FilmProbe(lens, back_mm, wavelength_nm), film, centres, axes, FINENESS, mirrored=True)
    reach = half[:, : half.shape[1] // 2 + 1] * size
    if not (reach.all() and reach.max() < (1.0 - 1.0 / FINENESS.scan) * FARTHEST * size):
        return None
    angles = np.linspace(0.0, np.pi, reach.shape[1])
    away = np.arange(1, LEVELS + 1)[:, None, None] / LEVELS * reach
    u, v = centres[:, :1] + away * np.cos(angles), away * np.sin(angles)
    points = np.zeros((3, u.size))
    points[0], points[2] = np.broadcast_to(film[:, :1], u.shape).ravel(), lens.film_z(back_mm)
    across = np.stack([u.ravel() - points[0], v.ravel(), np.full(u.size, -back_mm)])
    order = range(len(lens.surfaces) - 1, stop - 1, -1)
    at, _, _ = crossed(lens, order, points, across / np.sqrt(np.sum(across**2, axis=0)), lens.indices(wavelength_nm))
    heights = np.hypot(at[0, :, 0], at[0, :, 1]).reshape(u.shape)
    if not (np.isfinite(heights).all() and heights[0].min() > 0 and np.all(np.diff(heights, axis=0) > 0)):
        return None
    return centres[:, 0], reach, heights
