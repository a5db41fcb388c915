"""Ghosts: light of one source that surfaces reflect an even number of times, with its polarisation."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import GOLDEN
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.beams import Beam
from rptcam_cl.optics.glass import Amplitude, Interface, LayerStack, Polarised, attenuation, constant_reflectance
from rptcam_cl.optics.lens import Lens, system_matrix
from rptcam_cl.optics.ray_trace import COATED, LensTransmission, arrive, leave, reflect, refract
from rptcam_cl.optics.surface import IN_PLACE, Surface

#
# A beam on its way through a lens, forwards or backwards, with the light and the polarisation that its rays have
# left.
#
# Every ray carries the amplitudes that two orthogonal polarisations of its source have grown into (Chipman, Lam and
# Young, Polarized Light and Optical Systems, 2018, chapter 9), so that skew rays and layers count exactly. Of an
# unpolarised source the light is the mean of both.

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAST_SINE2 = 1e-24  # of incidence, below which no plane of incidence is known; any is as good


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


def meet(lit: Lit, beam: PolarisedBeam, k: int, forward: bool, *, counted: bool = False) -> Arrival:
    """Return a beam that has gone on to a surface, towards the film or away from it.

    Parameters
    ----------
    k : int
        Number of the surface.
    forward : bool
        Whether it travels to the film.
    counted : bool
        Whether the light that is lost on the way is noted.
    """
    whole, surface = lit.whole, lit.whole.surfaces[k]
    hits, _, met = arrive(whole, k, forward, beam.points, beam.directions)
    good = met & surface.clears(hits.points[0], hits.points[1])
    light, missed, blocked = np.zeros(len(good)), 0.0, 0.0
    if counted:
        light = beam.light
        missed, blocked = float(light[~met].sum()), float(light[met & ~good].sum())
    at, normals, cosines, lengths = hits.points, hits.normals, hits.cosines, hits.distances
    if not good.all():
        beam, light = beam.kept(good), light[good]
        at, normals, cosines, lengths = at[:, good], normals[:, good], cosines[good], lengths[good]
    at, normals = leave(whole, k, at, normals)
    beam = replace(beam, points=at)
    absorbed, per_mm = 0.0, lit.attenuations[k if forward else k + 1]
    if per_mm:
        left = np.exp(-0.5 * per_mm * np.abs(lengths))
        absorbed = float((light * (1.0 - left * left)).sum())
        beam = replace(beam, jones=beam.jones * left)
    return Arrival(beam, normals, cosines, missed, blocked, absorbed)


class Crossing:
    """A beam on a surface that parts it, as light that travels to the film or away from it.

    Attributes
    ----------
    parts : bool
        Whether light is both let through and reflected.
    """

    def __init__(self, lit: Lit, arrival: Arrival, k: int, forward: bool) -> None:
        self.lit, self.arrival, self.surface = lit, arrival, lit.whole.surfaces[k]
        self.parts = lit.reflects(k)
        n, m = lit.indices[k], lit.indices[k + 1]
        self.media = (n, m) if forward else (m, n)

    @cached_property
    def _refracted(self) -> tuple[Array, Mask]:
        n, m = self.media
        return refract(self.arrival.beam.directions, self.arrival.normals, self.arrival.cosines, np.asarray(n / m))

    @cached_property
    def _reflected_directions(self) -> Array:
        return reflect(self.arrival.beam.directions, self.arrival.normals, self.arrival.cosines)

    @cached_property
    def _amplitudes(self) -> Polarised:
        (n, m), incidence = self.media, np.abs(self.arrival.cosines)
        square = 1.0 - (n / m) ** 2 * (1.0 - incidence * incidence)
        behind = np.sqrt(square if self._refracted[1].all() else square + 0j)
        coating = self.lit.transmission.coating_of(self.surface)
        return coating.polarised(Interface(n, m, incidence, behind), self.lit.wavelength_nm)

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
        return float(self.lit.transmission.mirror_share(self.surface, self.lit.wavelength_nm))

    @property
    def absorbs(self) -> bool:
        """Whether layers on the surface do."""
        coating = self.lit.transmission.coating_of(self.surface)
        return isinstance(coating, LayerStack) and coating.absorbs

    def onward(self) -> PolarisedBeam:
        """Return the light that goes the way of the lens: what passes, or what a mirror reflects."""
        if self.surface.is_mirror:
            r = np.sqrt(np.asarray(self.mirror_share))
            return self._onward(self._reflected_directions, -r, r)
        if not self.parts:
            return self.arrival.beam
        directions, through = self._refracted
        return self._onward(directions, self._amplitudes.passed_s, self._amplitudes.passed_p).kept(through)

    def reflected(self) -> PolarisedBeam:
        """Return the light that a surface between two media reflects, all of it where it is totally reflected."""
        return self._onward(self._reflected_directions, self._amplitudes.reflected_s, self._amplitudes.reflected_p)


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


#
# Ways of light that is reflected between surfaces on its way to the film, and their first-order data.
#
# A way is named by the surfaces that reflect it, in order: (6, 3) passes surfaces 0 to 5, is reflected at 6, goes
# back through 5 and 4, is reflected at 3 and passes 4 to the last. Unfolded, such a way is a lens with mirrors.

Way = tuple[int, ...]

ORDERS = (2, 4)
_LEAST_SCALE = 1e-9  # of heights in an image of the source, over those before the lens


class Step(NamedTuple):
    """A surface on a way: its number, whether light comes to it on the way to the film, and whether it is reflected."""

    surface: int
    forward: bool
    reflects: bool


def check_lens(lens: Lens) -> None:
    """Raise an error when ghosts of a lens are not known."""
    if lens.is_split:
        raise InputError(f"{lens.name}: a half lens has rays beside its glass, so its ghosts are not known")
    if lens.fold is not None:
        raise InputError(f"{lens.name}: its axis is folded, so its ghosts are not known")
    lens.refuse_phases("ghosts are of lenses that refract and reflect alone")


def with_film(lens: Lens, film_distance_mm: float, reflectance: float = 0.0) -> Lens:
    """Return the lens with its film as a last surface, a mirror of some reflectance."""
    last = replace(lens.surfaces[-1], thickness=lens.sense * film_distance_mm)
    film = Surface(glass=last.glass, is_mirror=True, coating=constant_reflectance(reflectance))
    return lens.of_surfaces((*lens.surfaces[:-1], last, film), lens.stop_index)


def with_wider_stop(lens: Lens, factor: float) -> Lens:
    """Return the lens with its stop wider by a factor, so that rays spread over the front find the way of the light."""
    assert lens.stop_index is not None
    wider = lens.surfaces[lens.stop_index].semi_diameter * factor
    return lens.with_changes({lens.stop_index: {"semi_diameter": wider}})


_CLOSING = 4.0  # how far a wider stop is closed at a time


def with_wider_stops(lens: Lens, factor: float) -> list[Lens]:
    """Return the lens with its stop wider by a factor above 1, and closed from there, widest first."""
    return [with_wider_stop(lens, factor / _CLOSING**k) for k in range(int(np.log(factor) / np.log(_CLOSING)) + 1)]


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


def pairs_of(lens: Lens) -> list[Way]:
    """Return the pairs of surfaces that reflect: the first one, and one before it."""
    indices = lens.indices(550.0)
    partly = [k for k, s in enumerate(lens.surfaces) if not s.is_mirror and indices[k] != indices[k + 1]]
    return [(j, i) for j in partly for i in partly if i < j]


def ways_of_four(lens: Lens) -> NDArray[np.intp]:
    """Return all ways (n, 4) of light that four surfaces reflect."""
    pairs = pairs_of(lens)
    return np.array([(*one, *two) for one in pairs for two in pairs if two[0] > one[1]], np.intp).reshape(-1, 4)


ParaxialStep = tuple[int, NDArray[np.intp], Mask, Array]


def paraxial_steps(lens: Lens, turns: NDArray[np.intp], film_distance_mm: float) -> Iterator[ParaxialStep]:
    """Yield the surfaces that many ways (n, reflections) meet, all of them together, in the y-z section.

    With each, or the film behind the last: the numbers of the m ways that meet it, which of them it reflects (m,), and
    what the height there has of the height and the slope before the lens (2, m).

    Slopes are per length of the way and times the index, so that light on its way back needs no signs of its own.
    """
    index, film, senses = lens.indices(550.0), len(lens.surfaces), lens.senses
    bends = [senses[k] * s.paraxial_curvature("y") for k, s in enumerate(lens.surfaces)]
    gaps = [0.0, *(senses[k + 1] * s.thickness for k, s in enumerate(lens.surfaces[:-1])), film_distance_mm]
    height, slope = (np.tile(column, len(turns)) for column in ([[1.0], [0.0]], [[0.0], [index[0]]]))
    begins = np.zeros(len(turns), np.intp)
    for phase, ends in enumerate([*turns.T, np.full(len(turns), film)]):
        forward = phase % 2 == 0
        for k in range(film + 1) if forward else range(film - 1, -1, -1):
            ways = np.flatnonzero((begins <= k) & (k <= ends) if forward else (begins >= k) & (k >= ends))
            if not len(ways):
                continue
            medium, gap = (k, gaps[k]) if forward else (k + 1, gaps[k + 1])
            w = slope[:, ways]
            h = height[:, ways] + gap / index[medium] * w
            reflects = (ends[ways] == k) & (k < film)
            yield k, ways, reflects, h
            if k < film:
                mirror = 2.0 * index[medium] * (1.0 if forward or lens.surfaces[k].is_mirror else -1.0)
                passing = mirror if lens.surfaces[k].is_mirror else index[k] - index[k + 1]
                height[:, ways], slope[:, ways] = h, w + bends[k] * np.where(reflects, mirror, passing) * h
        begins = ends + (-1 if forward else 1)


def light_by_paraxial_rays(
    lens: Lens, turns: NDArray[np.intp], film_mm: tuple[float, float], passed: Array, distance_mm: float, slopes: Array
) -> Array:
    """Return about how much light (slopes, n) ways bring to the film: of a square that no rim stops in the y-z section.

    Parameters
    ----------
    turns : (n, reflections) array
    film_mm : (float, float)
        Its distance, and its largest height.
    passed : (surfaces, waves) array
        What each surface lets through, and does not reflect.
    distance_mm : float
        Of the source before the first vertex.
    slopes : (slopes,) array
        Of its light there.
    """
    rims, film = [*(surface.semi_diameter for surface in lens.surfaces), film_mm[1]], len(lens.surfaces)
    shape, light = (len(slopes), len(turns)), np.ones((len(turns), passed.shape[1]))
    low, high = np.full(shape, -np.inf), np.full(shape, np.inf)
    for surface, ways, reflects, heights in paraxial_steps(lens, turns, film_mm[0]):
        scale = heights[0] + heights[1] / distance_mm
        scale = np.where(np.abs(scale) < _LEAST_SCALE, _LEAST_SCALE, scale)
        middle, half = -np.outer(slopes, heights[1] / scale), rims[surface] / np.abs(scale)
        low[:, ways] = np.maximum(low[:, ways], middle - half)
        high[:, ways] = np.minimum(high[:, ways], middle + half)
        if surface < film and not lens.surfaces[surface].is_mirror:
            light[ways] *= np.where(reflects[:, None], 1.0 - passed[surface], passed[surface])
    return np.asarray(light.sum(axis=1) * np.maximum(high - low, 0.0) ** 2)


def unfold(lens: Lens, way: Way) -> Lens:
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
    return lens.of_surfaces(surfaces, stop)


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
    (a, b), (c, d) = system_matrix(unfold(lens, way), wavelength_nm).tolist()
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


# Light of one source on the front of a lens: rays spread evenly over the first surface, each with its flux.


class Entry:
    """The first surface of a lens in the light of a source.

    Parameters
    ----------
    lens : Lens
    source : Beam
        In the y-z plane: a parallel beam of irradiance 1 across it, or a lamp of intensity 1 at its distance.

    Attributes
    ----------
    is_even : bool
        Whether lens and light are the same left and right, so that rays of one side stand for both.

    Raises
    ------
    InputError
        When the first surface has no rim, and when the light comes from behind the lens.
    """

    def __init__(self, lens: Lens, source: Beam) -> None:
        self.source, self.first = source, lens.surfaces[0]
        if not np.isfinite(self.first.semi_diameter):
            raise InputError(f"{lens.name}: the first surface needs a diameter")
        if not abs(source.field_degrees) < 90:
            raise InputError(
                f"light at {source.field_degrees:g} degrees does not come from the scene (allowed: below 90)"
            )
        self.is_even = lens.is_rotational and all(surface.stop_shape is None for surface in lens.surfaces)

    def everywhere(self, count: int) -> tuple[Array, float]:
        """Return points (n, 2) spread over the surface, and the area that each stands for [mm2]."""
        numbers, reach = np.arange(count), self.first.semi_diameter
        radius, turn = reach * np.sqrt((numbers + 0.5) / count), np.mod(numbers * GOLDEN, 1.0)
        angle = np.pi * (turn - 0.5) if self.is_even else 2.0 * np.pi * turn
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), np.pi * reach**2 / count

    def within(self, box: Array, count: int) -> tuple[Array, float]:
        """Return points (n, 2) spread over a box, its lower and its upper corner, and the area that each stands for."""
        numbers, (low, high) = np.arange(count), box
        places = np.stack([(numbers + 0.5) / count, np.mod((numbers + 0.5) * GOLDEN, 1.0)], axis=1)
        area = float((high[0] - low[0]) * (high[1] - low[1]))
        return low + places * (high - low), area / count * (2.0 if self.is_even else 1.0)

    def around(self, points: Array, spacing: float) -> Array:
        """Return the box (2, 2) about points (n, 2) with room of a spacing [mm], on one side where light is even."""
        reach = self.first.semi_diameter
        low, high = np.maximum(points.min(axis=0) - spacing, -reach), np.minimum(points.max(axis=0) + spacing, reach)
        if self.is_even:
            low[0] = max(low[0], 0.0)
        return np.stack([low, high])

    def rays(self, points: Array, area: float) -> Arrival:
        """Return the rays that meet the surface above points (n, 2), inside its rim."""
        x, y = points.T
        z, zx, zy = self.first.sag_and_slopes(x, y)
        good = self.first.clears(x, y) & np.isfinite(z)
        pose = self.first.pose or IN_PLACE
        at = np.stack([x, y, z])[:, good]
        slopes = np.stack([-zx, -zy, np.ones_like(zx)])[:, good]
        at, slopes = pose.outward(at, slopes)
        directions, irradiance = self._light(at)
        flux = np.sum(directions * slopes, axis=0) * irradiance * area
        lit = flux > 0
        normals = slopes[:, lit] / np.sqrt(np.sum(slopes[:, lit] ** 2, axis=0))
        beam = PolarisedBeam.unpolarised(at[:, lit].T, directions[:, lit].T, flux[lit])
        return Arrival(beam, normals, np.sum(normals * beam.directions, axis=0))

    def _light(self, at: Array) -> tuple[Array, Array]:
        """Return unit directions (3, n) of the light at points, and its irradiance across them."""
        origins, directions = self.source.rays(np.zeros((1, 2)))
        if np.isinf(self.source.object_distance_mm):
            return np.broadcast_to(directions.T, at.shape), np.ones(at.shape[1])
        way = at - origins.T
        square = np.sum(way * way, axis=0)
        directions = way / np.sqrt(square)
        return directions, (directions[2] if self.source.is_diffuse else 1.0) / square


#
# Light of one source through a lens, parted at every surface, so that all of it is accounted for.
#
# What reaches the film after an even number of reflections is the image and its ghosts.

RAYS = {2: 1500, 4: 1000}  # over the front, by the order
FAINT = 1e-9  # share of the light below which rays with more than two reflections are not followed


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
    def whole(self) -> Lens:
        """The lens with its film as the last surface."""
        return with_film(self.lens, self.film_distance_mm, self.film_reflectance)

    @cached_property
    def indices(self) -> list[float]:
        """Index before the first surface and behind each one."""
        return [float(index) for index in self.whole.indices(self.wavelength_nm)]

    @cached_property
    def attenuations(self) -> list[float]:
        """Absorption before the first surface and behind each one [1/mm]; the spaces outside do not count."""
        media = self.whole.media[1:-1]
        inside = [float(attenuation(medium, self.wavelength_nm)) for medium in media]
        return [0.0, *(inside if self.transmission.absorption else [0.0] * len(inside)), 0.0]

    def reflects(self, k: int) -> bool:
        """Return whether part of the light is reflected at a surface that lets light through."""
        return not self.whole.surfaces[k].is_mirror and self.indices[k] != self.indices[k + 1]

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
    film : (2, n) array
        Where they meet the film [mm].
    light : (n,) array
    inside : (n,) array
        Which are in the frame.
    spacing : float
        Between rays on the front [mm].
    is_even : bool
        Whether each ray stands for one on the other side as well.
    """

    points: Array
    film: Array
    light: Array
    inside: Mask
    spacing: float
    is_even: bool

    def only_in_frame(self) -> Landed:
        """Return those that meet the frame."""
        of = self.inside
        return replace(self, points=self.points[of], film=self.film[:, of], light=self.light[of], inside=of[of])

    def in_frame(self) -> tuple[float, tuple[float, float], float]:
        """Return flux in the frame, its centroid and its rms radius [mm]."""
        weight, at = self.light[self.inside], self.film[:, self.inside]
        total = float(weight.sum())
        if not total > 0:
            return 0.0, (np.nan, np.nan), np.nan
        centre = at @ weight / total
        if self.is_even:
            centre[0] = 0.0
        square = float(np.sum((at - centre[:, None]) ** 2, axis=0) @ weight) / total
        return total, (float(centre[0]), float(centre[1])), float(np.sqrt(square))


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
        self.account = Account()
        self.landed: dict[Way, Landed] = {}
        self.blocked: dict[int, float] = {}
        self.entry, count = Entry(lit.lens, lit.source), rays or RAYS[order]
        self.spacing = self.entry.first.semi_diameter * float(np.sqrt(np.pi / count))
        front = self.entry.rays(*self.entry.everywhere(count))
        self.points = front.beam.points[:2].T
        self.account.entered = float(front.beam.flux.sum())
        if not self.account.entered > 0:
            raise InputError(f"{lit.lens.name}: no light of the source meets the first surface")
        self._follow(self._cross_surface(front, 0, True, ()), 1, True, ())

    def _follow(self, beam: PolarisedBeam, k: int, forward: bool, way: Way) -> None:
        """Follow light before a surface to the film or the front, and what is reflected on the way."""
        while len(beam.rows):
            if k < 0:
                self.account.out += float(beam.light.sum())
                return
            arrival = meet(self.lit, beam, k, forward, counted=True)
            self.account.missed += arrival.missed
            self.account.blocked += arrival.blocked
            if not way:
                self.blocked[k] = arrival.blocked
            self.account.absorbed += arrival.absorbed
            if k == self.film:
                self._land(arrival, way)
                return
            beam = self._cross_surface(arrival, k, forward, way)
            k += 1 if forward else -1

    def _cross_surface(self, arrival: Arrival, k: int, forward: bool, way: Way) -> PolarisedBeam:
        """Return light behind a surface, once what that reflects has been followed."""
        crossing = Crossing(self.lit, arrival, k, forward)
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
        film, front = arrival.beam.points[:2, lit], self.points[arrival.beam.rows[lit]]
        inside = self.lit.in_frame(film)
        self.landed[way] = Landed(front, film, light[lit], inside, self.spacing, self.entry.is_even)
        if share:
            self._reflect(Crossing(self.lit, arrival, self.film, True).onward(), self.film, True, way)


#
# Rays of chosen ways between the surfaces of a lens, followed together wherever they travel the same way.
#
# All rays pass the surfaces to the film, leave where their way is first reflected, go back together, and so on: a
# lens is passed three times for all its pairs of reflections.

Numbers = NDArray[np.intp]

CHUNK = 8192  # rays whose components stay in the processor's cache
NOWHERE = -1  # where a way is not reflected any more


def follow(lit: Lit, known: Mapping[Way, Landed], counts: Mapping[Way, int]) -> dict[Way, Landed]:
    """Return some rays of each way on the film, once through an even lattice about where they are known to enter."""
    entry, landed = Entry(lit.lens, lit.source), dict[Way, Landed]()
    for ways in _chunks([way for way, rays in known.items() if len(rays.points)], counts):
        fronts, areas = [], []
        for way in ways:
            points, area = entry.within(entry.around(known[way].points, known[way].spacing), counts[way])
            fronts.append(entry.rays(points, area))
            areas.append(area)
        landed |= _trace_to_film(lit, entry, ways, fronts, areas)
    return landed


def _chunks(ways: Sequence[Way], counts: Mapping[Way, int]) -> Iterator[list[Way]]:
    """Yield ways by as many as have rays enough together."""
    chunk: list[Way] = []
    for way in ways:
        chunk.append(way)
        if sum(counts[other] for other in chunk) >= CHUNK:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


def _trace_to_film(
    lit: Lit, entry: Entry, ways: list[Way], fronts: list[Arrival], areas: list[float]
) -> dict[Way, Landed]:
    """Return rays of several ways on the film."""
    counts = [len(front.cosines) for front in fronts]
    ends = np.cumsum(counts)
    beam = PolarisedBeam.joined([front.beam for front in fronts])
    beam = replace(beam, rows=np.arange(len(beam.rows)))  # numbered through
    normals, cosines = (np.concatenate([getattr(f, name) for f in fronts], axis=-1) for name in ("normals", "cosines"))
    front = Arrival(beam, normals, cosines)
    entered = front.beam.points[:2].T
    turns = np.full((len(entered), max(map(len, ways), default=0) + 1), NOWHERE)
    for way, first, end in zip(ways, ends - counts, ends, strict=True):
        turns[first:end, : len(way)] = way
    beam = together(lit, front, turns)
    light, inside, owner = beam.light, lit.in_frame(beam.points), np.searchsorted(ends, beam.rows, side="right")
    landed = {}
    for number, (way, area) in enumerate(zip(ways, areas, strict=True)):
        own = owner == number
        landed[way] = Landed(
            entered[beam.rows[own]], beam.points[:2, own], light[own], inside[own], float(np.sqrt(area)), entry.is_even
        )
    return landed


def together(lit: Lit, front: Arrival, turns: Numbers) -> PolarisedBeam:
    """Return rays on the first surface as they meet the film, each by its own way; the film is the last surface.

    Parameters
    ----------
    front : Arrival
        Rays numbered through.
    turns : (n, m) array
        Which surfaces reflect each ray, in order, `NOWHERE` behind the last.
    """
    film = len(lit.lens.surfaces)
    landed: list[PolarisedBeam] = []
    joining: dict[int, list[PolarisedBeam]] = {0: [front.beam]}
    for phase in range(turns.shape[1]):
        forward, turned = phase % 2 == 0, defaultdict(list)
        beam: PolarisedBeam | None = None
        for k in range(film + 1) if forward else range(film, -1, -1):
            beams = [*([beam] if beam is not None else []), *joining.get(k, [])]
            if not beams:
                continue
            at = front if phase == 0 and k == 0 else meet(lit, PolarisedBeam.joined(beams), k, forward)
            bounces = turns[at.beam.rows, phase] == k
            if bounces.any():
                crossing = Crossing(lit, at.some(bounces), k, forward)
                back = crossing.onward() if crossing.surface.is_mirror else crossing.reflected()
                turned[k - 1 if forward else k + 1].append(back)
            rest = at.some(~bounces)
            if k == film and forward:
                landed.append(rest.beam)
            goes_on = len(rest.cosines) > 0 and not (k == film and forward)
            beam = Crossing(lit, rest, k, forward).onward() if goes_on else None
        joining = turned
    return PolarisedBeam.joined(landed or [front.beam.kept(np.zeros(len(turns), dtype=bool))])


#
# Ghosts: light of one source that surfaces of a lens reflect an even number of times before it reaches the film.
#
# First some rays are parted at every surface. Then each way that reaches the film gets rays of its own, over the part
# of the front whose light takes it.

# Four times as many move the light of all ghosts by at most 0.44 % (fisheye-10mm, of seven lenses).
OWN_RAYS, LEAST, MOST = 60_000, 256, 12_000  # of all ways, and of each one
_IMAGE_RAYS = 20_000  # of the image itself
PART = 0.3  # of a way's rays; where fewer meet the frame, those get rays of their own
WIDE = 0.1  # what light beside the frame counts where rays are shared out
SURE = 100  # rays that form the image; where fewer do, a wider stop says where light enters
RARE = 40  # rays of a pair, below which more look for its light over the whole front
SCOUTS, FEWEST_SCOUTS, MOST_SCOUTS = 300_000, 1024, 4096  # of all such pairs, and of each


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


def find_ghosts(lit: Lit, order: int = 2, share: float = 1.0) -> Ghosts:
    """Return the ghosts of a source.

    Parameters
    ----------
    lit : Lit
    order : int
        Most reflections: 2 or 4.
    share : float
        Of the usual rays.

    Raises
    ------
    InputError
        When the order is another, the lens is a half lens or has no first rim, no ray of the source meets it, or the
        film reflects more than all light.
    """
    if order not in ORDERS:
        raise InputError(
            f"order: light reaches the film after an even number of reflections (got {order}; allowed: 2 or 4)"
        )
    check_lens(lit.lens)
    if not 0 <= lit.film_reflectance < 1:
        raise InputError(f"the film reflects a share from 0 to below 1 (got {lit.film_reflectance:g})")
    tree = Tree(lit, order, int(RAYS[order] * share))
    landed, stops = tree.landed, [lit]
    formed = len(landed[()].light) if () in landed else 0
    if formed < SURE and lit.lens.stop is not None:
        wider = with_wider_stops(lit.lens, float(np.sqrt(SURE / max(formed, 0.25))))
        stops = [*(replace(lit, lens=lens) for lens in wider), lit]
        landed = Tree(stops[0], order, int(RAYS[order] * share)).landed
    own = _own_light(landed | _scout_rare(stops[0], landed), stops, share)
    image = own.pop((), FilmLight((), 0.0, 0.0, (np.nan, np.nan), np.nan))
    ghosts = sorted((light for light in own.values() if light.flux > 0), key=lambda light: -light.flux_in_frame)
    return Ghosts(lit, image, tuple(ghosts), tree.account)


def _scout_rare(lit: Lit, landed: Mapping[Way, Landed]) -> dict[Way, Landed]:
    """Return more rays of the pairs of which few or none have landed: their light enters by a small part of the front.

    Without them the table of `fisheye-10mm` in the light of a sun at 20 degrees lacks 5 % of its light.
    """
    rare = [way for way in pairs_of(lit.lens) if way not in landed or len(landed[way].points) < RARE]
    entry = Entry(lit.lens, lit.source)
    count = int(np.clip(SCOUTS // max(len(rare), 1), FEWEST_SCOUTS, MOST_SCOUTS))
    points, area = entry.everywhere(count)
    front = entry.rays(points, area)
    found: dict[Way, Landed] = {}
    for ways in _chunks(rare, dict.fromkeys(rare, count)):
        found |= _trace_to_film(lit, entry, ways, [front] * len(ways), [area] * len(ways))
    return {way: rays for way, rays in found.items() if len(rays.points)}


def _own_light(landed: dict[Way, Landed], stops: list[Lit], share: float) -> dict[Way, FilmLight]:
    """Return the light of each way by rays of its own, about those that have landed, perhaps through wider stops.

    Parameters
    ----------
    landed : dict
    stops : list of Lit
        Ever narrower; the last is the one that is meant.
    share : float
        Of the usual rays.
    """
    # As many rays for each way as the root of its light, by which falls what they err by.
    weights = {way: float(np.sqrt(rays.light @ (rays.inside + WIDE))) for way, rays in landed.items()}
    total = sum(weight for way, weight in weights.items() if way) or 1.0
    counts = {way: int(share * np.clip(OWN_RAYS * weight / total, LEAST, MOST)) for way, weight in weights.items()}
    counts[()], whole = int(share * _IMAGE_RAYS), landed
    for stage in stops:
        whole = follow(stage, whole, counts)
    parts = {way: rays for way, rays in whole.items() if rays.inside.any() and rays.inside.mean() < PART}
    framed = whole | follow(stops[-1], {way: rays.only_in_frame() for way, rays in parts.items()}, counts)
    return {way: FilmLight(way, float(rays.light.sum()), *framed[way].in_frame()) for way, rays in whole.items()}
