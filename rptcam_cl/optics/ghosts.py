"""Ghosts: light of one source that surfaces of a lens reflect an even number of times before it reaches the film.

First some rays are parted at every surface. Then each way that reaches the film gets rays of its own, over the part of
the front whose light takes it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.ghost_path import Way, check_lens, check_order, with_wider_stop
from rptcam_cl.optics.ghost_rays import Start, followed
from rptcam_cl.optics.ghost_tree import RAYS, Account, Landed, Lit, Tree

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OWN_RAYS, LEAST, MOST = 60_000, 256, 12_000  # of all ways, and of each one
IMAGE_RAYS = 20_000  # of the image itself
PART = 0.3  # of a way's rays; where fewer meet the frame, those get rays of their own
WIDE = 0.1  # what light beside the frame counts where rays are shared out
SURE = 100  # rays that form the image; where fewer do, a wider stop says where light enters
CLOSING = 4.0  # how far the stop is then closed at a time


@dataclass(frozen=True)
class FilmLight:
    """Light of one way on the film.

    Attributes
    ----------
    way : tuple of int
        Surfaces that reflect it, in order; none of the image itself.
    flux, flux_in_frame : float
        On the whole plane of the film, and in the frame.
    centroid_mm : (x, y)
        Of the light in the frame; NaN where there is none.
    rms_mm : float
        Root mean square distance from it.
    """

    way: Way
    flux: float
    flux_in_frame: float
    centroid_mm: tuple[float, float]
    rms_mm: float


@dataclass(frozen=True)
class Ghosts:
    """What a source makes of the film.

    Attributes
    ----------
    lit : Lit
    image : FilmLight
    ghosts : tuple of FilmLight
        Of every way that brings light to the film, brightest in the frame first.
    account : Account
        Of the rays that are parted at every surface.
    """

    lit: Lit
    image: FilmLight
    ghosts: tuple[FilmLight, ...]
    account: Account

    @property
    def reference(self) -> float:
        """Flux that shares are of: the image's in the film plane, or what entered where there is none."""
        return self.image.flux or self.account.entered


def find_ghosts(lit: Lit, order: int = 2) -> Ghosts:
    """Return the ghosts of a source.

    Parameters
    ----------
    lit : Lit
    order : int
        Most reflections: 2 or 4.

    Raises
    ------
    InputError
        When the order is another, the lens is a half lens or has no first rim, no ray of the source meets it, or the
        film reflects more than all light.
    """
    check_order(order)
    check_lens(lit.lens)
    if not 0 <= lit.film_reflectance < 1:
        raise InputError(f"the film reflects a share from 0 to below 1 (got {lit.film_reflectance:g})")
    tree = Tree(lit, order)
    landed, stops = tree.landed, [lit]
    formed = len(landed[()].light) if () in landed else 0
    if formed < SURE and lit.lens.stop is not None:
        opening = float(np.sqrt(SURE / max(formed, 0.25)))
        factors = [opening / CLOSING**k for k in range(int(np.log(opening) / np.log(CLOSING)) + 1)]
        stops = [replace(lit, lens=with_wider_stop(lit.lens, factor)) for factor in factors] + [lit]
        landed = Tree(stops[0], order).landed
    own = _own_light(landed, stops, lit.lens.surfaces[0].semi_diameter * float(np.sqrt(np.pi / RAYS[order])))
    image = own.pop((), FilmLight((), 0.0, 0.0, (np.nan, np.nan), np.nan))
    ghosts = sorted((light for light in own.values() if light.flux > 0), key=lambda light: -light.flux_in_frame)
    return Ghosts(lit, image, tuple(ghosts), tree.account)


def _own_light(landed: dict[Way, Landed], stops: list[Lit], spacing: float) -> dict[Way, FilmLight]:
    """Return what rays of its own say of each way, about those that were found, perhaps through wider stops.

    Parameters
    ----------
    landed : dict
    stops : list of Lit
        Ever narrower; the last is the one that is meant.
    spacing : float
        Between the rays that were found, on the front [mm].
    """
    counts, lit = _rays_of_ways(landed), stops[-1]
    starts = {way: Start(found.points, spacing, counts[way]) for way, found in landed.items()}
    for stage in stops:
        whole = followed(stage, starts)
        starts = {way: found.again(counts[way]) for way, found in whole.items()}
    parts = {way: found for way, found in whole.items() if found.inside.any() and found.inside.mean() < PART}
    framed = whole | followed(lit, {way: found.again(counts[way], in_frame=True) for way, found in parts.items()})
    return {way: FilmLight(way, float(found.light.sum()), *framed[way].in_frame()) for way, found in whole.items()}


def _rays_of_ways(landed: dict[Way, Landed]) -> dict[Way, int]:
    """Return how many rays each way gets: by the root of its light, as so falls what they err by."""
    weights = {way: float(np.sqrt(found.light @ (found.inside + WIDE))) for way, found in landed.items()}
    total = sum(weight for way, weight in weights.items() if way) or 1.0
    counts = {way: int(np.clip(OWN_RAYS * weight / total, LEAST, MOST)) for way, weight in weights.items()}
    return counts | {(): IMAGE_RAYS}
