"""Light of one source through a lens, parted at every surface, so that all of it is accounted for.

What reaches the film after an even number of reflections is the image and its ghosts.
"""

from __future__ import annotations

from dataclasses import field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.ghost_entry import Entry
from rptcam_cl.optics.ghost_path import Way, with_film
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.polarised_beam import Arrival, Crossing, LensAtWavelength, PolarisedBeam, meet
from rptcam_cl.optics.spot import Beam
from rptcam_cl.optics.transmission import COATED, LensTransmission

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RAYS = {2: 1500, 4: 1000}  # over the front, by the order
FAINT = 1e-8  # share of the light below which rays with more than two reflections are not followed


@dataclass(frozen=True)
class Lit:
    """A lens, its film and the light of a source.

    Attributes
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    source : Beam
        A parallel beam of irradiance 1, or a lamp of intensity 1.
    wavelength_nm : float
    film_mm : (width, height)
        Of the frame.
    transmission : LensTransmission
        Whether coatings and absorption count.
    film_reflectance : float
        Share of the light that the film reflects like a mirror.
    """

    lens: Lens
    film_distance_mm: float
    source: Beam = field(default_factory=Beam)
    wavelength_nm: float = 550.0
    film_mm: tuple[float, float] = (36.0, 24.0)
    transmission: LensTransmission = COATED
    film_reflectance: float = 0.0

    @cached_property
    def at_wavelength(self) -> LensAtWavelength:
        """The lens with its film as the last surface, at the wavelength."""
        lens = with_film(self.lens, self.film_distance_mm, self.film_reflectance)
        return LensAtWavelength(lens, self.wavelength_nm, self.transmission)

    def in_frame(self, points: Array) -> Mask:
        """Return which points (2, n) of the film lie in the frame."""
        width, height = self.film_mm
        return np.asarray((np.abs(points[0]) <= width / 2) & (np.abs(points[1]) <= height / 2))


@dataclass
class Account:
    """Where the light goes that meets the front: everything but `entered` adds up to it.

    Attributes
    ----------
    entered, image, ghosts, absorbed : float
        What the film keeps of the image and of ghosts, and what glass and mirrors keep.
    blocked, missed : float
        Stopped by rims and the stop, and past a surface.
    out : float
        Leaves through the front.
    reflected_on : float
        Reflected more often than is followed, or too faint to be followed.
    """

    entered: float = 0.0
    image: float = 0.0
    ghosts: float = 0.0
    absorbed: float = 0.0
    blocked: float = 0.0
    missed: float = 0.0
    out: float = 0.0
    reflected_on: float = 0.0


@dataclass(frozen=True)
class Landed:
    """Rays of one way on the film.

    Attributes
    ----------
    points : (n, 2) array
        Of the front that they come through [mm].
    light : (n,) array
    inside : (n,) array
        Which are in the frame.
    """

    points: Array
    light: Array
    inside: Mask


class Tree:
    """Rays parted at every surface, and what they say of each way.

    Attributes
    ----------
    account : Account
    landed : dict
        The rays of each way.
    blocked : dict
        Light of the image that each rim stops.
    """

    def __init__(self, lit: Lit, order: int, rays: int | None = None) -> None:
        self.lit, self.order, self.film = lit, order, len(lit.lens.surfaces)
        self.lens = lit.at_wavelength
        self.account = Account()
        self.landed: dict[Way, Landed] = {}
        self.blocked: dict[int, float] = {}
        entry = Entry(lit.lens, lit.source)
        front = entry.rays(*entry.everywhere(rays or RAYS[order]))
        self.points = front.beam.points[:2].T
        self.account.entered = float(front.beam.flux.sum())
        if not self.account.entered > 0:
            raise InputError(f"{lit.lens.name}: no light of the source meets the first surface")
        self._follow(self._crossed(front, 0, True, ()), 1, True, ())

    def _follow(self, beam: PolarisedBeam, k: int, forward: bool, way: Way) -> None:
        """Follow light before a surface to the film or the front, and what is reflected on the way."""
        while len(beam.rows):
            if k < 0:
                self.account.out += float(beam.light.sum())
                return
            arrival = meet(self.lens, beam, k, forward, counted=True)
            self.account.missed += arrival.missed
            self.account.blocked += arrival.blocked
            if not way:
                self.blocked[k] = arrival.blocked
            self.account.absorbed += arrival.absorbed
            if k == self.film:
                self._land(arrival, way)
                return
            beam = self._crossed(arrival, k, forward, way)
            k += 1 if forward else -1

    def _crossed(self, arrival: Arrival, k: int, forward: bool, way: Way) -> PolarisedBeam:
        """Return light behind a surface, once what that reflects has been followed."""
        crossing = Crossing(self.lens, arrival, k, forward)
        if crossing.parts:
            reflected = crossing.reflected()
            if crossing.absorbs:
                left = float(reflected.light.sum()) + float(crossing.onward().light.sum())
                self.account.absorbed += float(arrival.beam.light.sum()) - left
            self._reflect(reflected, k, forward, way)
        if crossing.surface.is_mirror:
            self.account.absorbed += float(arrival.beam.light.sum()) * (1.0 - crossing.mirror_share)
        return crossing.onward()

    def _reflect(self, beam: PolarisedBeam, k: int, forward: bool, way: Way) -> None:
        """Follow what a surface has reflected, if it may still reach the film and is worth it."""
        light = float(beam.light.sum())
        faint = len(way) > 1 and light < FAINT * self.account.entered
        if len(way) == self.order or faint:
            self.account.reflected_on += light
        else:
            self._follow(beam, k - 1 if forward else k + 1, not forward, (*way, k))

    def _land(self, arrival: Arrival, way: Way) -> None:
        """Note light on the film, and follow what that reflects."""
        light, share = arrival.beam.light, self.lit.film_reflectance
        kept = float(light.sum()) * (1.0 - share)
        if way:
            self.account.ghosts += kept
        else:
            self.account.image += kept
        lit = light > 0
        inside = self.lit.in_frame(arrival.beam.points)[lit]
        self.landed[way] = Landed(self.points[arrival.beam.rows[lit]], light[lit], inside)
        if share:
            self._reflect(Crossing(self.lens, arrival, self.film, True).onward(), self.film, True, way)
