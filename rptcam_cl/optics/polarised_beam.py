"""A beam on its way through a lens, forwards or backwards, with the light and the polarisation that its rays have left.

Every ray carries the amplitudes that two orthogonal polarisations of its source have grown into (Chipman, Lam and
Young, Polarized Light and Optical Systems, 2018, chapter 9), so that skew rays and layers count exactly. Of an
unpolarised source the light is the mean of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.coating import Amplitude, Interface, Polarised
from rptcam_cl.optics.glass import attenuation
from rptcam_cl.optics.layer_stack import LayerStack
from rptcam_cl.optics.placement import IN_PLACE
from rptcam_cl.optics.prescription import Prescription
from rptcam_cl.optics.ray_trace import reflect, refract
from rptcam_cl.optics.transmission import COATED, LensTransmission

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_SINE2 = 1e-24  # of incidence, below which no plane of incidence is known; any is as good


@dataclass(frozen=True)
class LensAtWavelength:
    """What light of one wavelength meets in a lens.

    Attributes
    ----------
    prescription : Prescription
    wavelength_nm : float
    transmission : LensTransmission
        Whether coatings and absorption count. Surfaces always reflect.
    """

    prescription: Prescription
    wavelength_nm: float
    transmission: LensTransmission = COATED

    @cached_property
    def indices(self) -> list[float]:
        """Index before the first surface and behind each one."""
        return [float(index) for index in self.prescription.indices(self.wavelength_nm)]

    @cached_property
    def attenuations(self) -> list[float]:
        """Absorption before the first surface and behind each one [1/mm]; the spaces outside do not count."""
        media = self.prescription.media[1:-1]
        inside = [float(attenuation(medium, self.wavelength_nm)) for medium in media]
        return [0.0, *(inside if self.transmission.absorption else [0.0] * len(inside)), 0.0]

    def reflects(self, k: int) -> bool:
        """Return whether part of the light is reflected at a surface that lets light through."""
        return not self.prescription.surfaces[k].is_mirror and self.indices[k] != self.indices[k + 1]


@dataclass(frozen=True)
class PolarisedBeam:
    """Rays at one place of their way, in the frame of the lens [mm].

    Attributes
    ----------
    rows : (n,) array
        Numbers of the rays.
    points, directions : (3, n) arrays
    across : (3, n) array
        Unit vectors across the rays: those of the first component; the second is along directions x across.
    jones : (2, 2, n) array
        Amplitudes of both components (first axis), for both polarisations of the source.
    flux : (n,) array
        Of each ray at the source.
    """

    rows: NDArray[np.intp]
    points: Array
    directions: Array
    across: Array
    jones: Amplitude
    flux: Array

    @staticmethod
    def unpolarised(points: ArrayLike, directions: ArrayLike, flux: ArrayLike) -> PolarisedBeam:
        """Return rays (n, 3) of unit direction with their flux (n,), before the lens."""
        p, d = (np.ascontiguousarray(np.asarray(part, dtype=np.float64).T) for part in (points, directions))
        across = np.stack([d[2], np.zeros_like(d[0]), -d[0]])
        across /= np.sqrt(np.sum(across * across, axis=0))
        jones = np.zeros((2, 2, p.shape[1]))
        jones[0, 0] = jones[1, 1] = 1.0
        return PolarisedBeam(np.arange(p.shape[1]), p, d, across, jones, np.asarray(flux, dtype=np.float64))

    @property
    def light(self) -> Array:
        """Flux that each ray still carries (n,)."""
        return self.flux * _power(self.jones)

    def kept(self, good: Mask) -> PolarisedBeam:
        """Return some of the rays."""
        if good.all():
            return self
        return PolarisedBeam(
            self.rows[good], self.points[:, good], self.directions[:, good], self.across[:, good],
            self.jones[:, :, good], self.flux[good],
        )  # fmt: skip

    @staticmethod
    def joined(beams: Sequence[PolarisedBeam]) -> PolarisedBeam:
        """Return several beams that are at the same surface as one."""
        if len(beams) == 1:
            return beams[0]
        return PolarisedBeam(*(
            np.concatenate([getattr(beam, field.name) for beam in beams], axis=-1) for field in fields(PolarisedBeam)
        ))  # fmt: skip


@dataclass(frozen=True)
class Arrival:
    """Rays that have met a surface inside its rim, and the light that was lost before.

    Attributes
    ----------
    beam : PolarisedBeam
        On the surface, its directions those before it.
    normals, cosines : (3, n) and (n,) arrays
        Of the surface in the frame of the lens, along the rays.
    missed, blocked, absorbed : float
        Flux of rays that do not meet the surface, that its rim stops, and that the glass before it takes.
    """

    beam: PolarisedBeam
    normals: Array
    cosines: Array
    missed: float = 0.0
    blocked: float = 0.0
    absorbed: float = 0.0

    def some(self, chosen: Mask) -> Arrival:
        """Return some of the rays."""
        if chosen.all():
            return self
        return Arrival(self.beam.kept(chosen), self.normals[:, chosen], self.cosines[chosen])


def meet(lens: LensAtWavelength, beam: PolarisedBeam, k: int, forward: bool, *, counted: bool = False) -> Arrival:
    """Return a beam that has gone on to a surface, towards the film or away from it.

    Parameters
    ----------
    lens : LensAtWavelength
    beam : PolarisedBeam
    k : int
        Number of the surface.
    forward : bool
        Whether it travels to the film.
    counted : bool
        Whether the light that is lost on the way is noted.
    """
    surface = lens.prescription.surfaces[k]
    sense = lens.prescription.senses[k] if forward else -lens.prescription.senses[k + 1]
    pose, shift = surface.pose or IN_PLACE, np.array([[0.0], [0.0], [float(lens.prescription.vertices[k])]])
    points = beam.points - shift
    points, directions = pose.inward(points, beam.directions) if surface.pose else (points, beam.directions)
    hits = surface.meet(points, directions)
    met = hits.met & np.isfinite(hits.distances) & (directions[2] * sense > 0)
    good = met & surface.clears(hits.points[0], hits.points[1])
    light, missed, blocked = np.zeros(len(good)), 0.0, 0.0
    if counted:
        light = beam.light
        missed, blocked = float(light[~met].sum()), float(light[met & ~good].sum())
    at, normals, cosines, lengths = hits.points, hits.normals, hits.cosines, hits.distances
    if not good.all():
        beam, light = beam.kept(good), light[good]
        at, normals, cosines, lengths = at[:, good], normals[:, good], cosines[good], lengths[good]
    beam = replace(beam, points=(pose.outward(at, at)[0] if surface.pose else at) + shift)
    absorbed, per_mm = 0.0, lens.attenuations[k if forward else k + 1]
    if per_mm:
        left = np.exp(-0.5 * per_mm * np.abs(lengths))
        absorbed = float((light * (1.0 - left * left)).sum())
        beam = replace(beam, jones=beam.jones * left)
    normals = pose.matrix() @ normals if surface.pose else normals
    return Arrival(beam, normals, cosines, missed, blocked, absorbed)


class Crossing:
    """A beam on a surface that parts it, as light that travels to the film or away from it.

    Attributes
    ----------
    parts : bool
        Whether light is both let through and reflected.
    """

    def __init__(self, lens: LensAtWavelength, arrival: Arrival, k: int, forward: bool) -> None:
        self.lens, self.arrival, self.surface = lens, arrival, lens.prescription.surfaces[k]
        self.parts = lens.reflects(k)
        n, m = lens.indices[k], lens.indices[k + 1]
        self.media = (n, m) if forward else (m, n)

    @cached_property
    def _bent(self) -> tuple[Array, Mask]:
        n, m = self.media
        return refract(self.arrival.beam.directions, self.arrival.normals, self.arrival.cosines, np.asarray(n / m))

    @cached_property
    def _turned(self) -> Array:
        return reflect(self.arrival.beam.directions, self.arrival.normals, self.arrival.cosines)

    @cached_property
    def _amplitudes(self) -> Polarised:
        (n, m), incidence = self.media, np.abs(self.arrival.cosines)
        square = 1.0 - (n / m) ** 2 * (1.0 - incidence * incidence)
        behind = np.sqrt(square if self._bent[1].all() else square + 0j)
        coating = self.lens.transmission.coating_of(self.surface)
        return coating.polarised(Interface(n, m, incidence, behind), self.lens.wavelength_nm)

    @cached_property
    def _components(self) -> tuple[Array, Amplitude]:
        return _in_plane_of_incidence(self.arrival.beam, self.arrival.normals)

    def _onward(self, directions: Array, s: Amplitude, p: Amplitude) -> PolarisedBeam:
        across, jones = self._components
        jones = jones * np.array([s, p])[:, None]
        return replace(self.arrival.beam, directions=directions, across=across, jones=jones)

    @property
    def mirror_share(self) -> float:
        """Share of the light that a mirror reflects."""
        return float(self.lens.transmission.mirror_share(self.surface, self.lens.wavelength_nm))

    @property
    def absorbs(self) -> bool:
        """Whether layers on the surface do."""
        coating = self.lens.transmission.coating_of(self.surface)
        return isinstance(coating, LayerStack) and coating.absorbs

    def onward(self) -> PolarisedBeam:
        """Return the light that goes the way of the lens: what passes, or what a mirror reflects."""
        if self.surface.is_mirror:
            r = np.sqrt(np.asarray(self.mirror_share))
            return self._onward(self._turned, -r, r)
        if not self.parts:
            return self.arrival.beam
        directions, through = self._bent
        return self._onward(directions, self._amplitudes.passed_s, self._amplitudes.passed_p).kept(through)

    def reflected(self) -> PolarisedBeam:
        """Return the light that a surface between two media reflects, all of it where it is totally reflected."""
        return self._onward(self._turned, self._amplitudes.reflected_s, self._amplitudes.reflected_p)


def _in_plane_of_incidence(beam: PolarisedBeam, normals: Array) -> tuple[Array, Amplitude]:
    """Return vectors across the plane of incidence, and the amplitudes along them and along direction x vector."""
    d, old = beam.directions, beam.across
    across = _cross(d, normals)
    sine2 = _dot(across, across)
    head_on = sine2 < LEAST_SINE2
    across /= np.sqrt(np.where(head_on, 1.0, sine2))
    if head_on.any():
        across = np.where(head_on, old, across)
    c, s = _dot(old, across), _dot(_cross(d, old), across)
    first, second = beam.jones
    return across, np.stack([first * c + second * s, second * c - first * s])


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _cross(a: Array, b: Array) -> Array:
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.subtract(a[i] * b[j], a[j] * b[i], out=product[k])
    return product


def _power(jones: Amplitude) -> Array:
    """Return the share of unpolarised light (n,) that amplitudes stand for."""
    if np.iscomplexobj(jones):
        return np.asarray(np.sum(jones.real**2 + jones.imag**2, axis=(0, 1)) / 2)
    return np.asarray(np.sum(jones * jones, axis=(0, 1)) / 2)
