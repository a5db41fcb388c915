"""Lenses as they are, not as designed: at another temperature, with a front that scatters, copies with errors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.beams import round_chief_rays
from rptcam_cl.optics.files.glasses import bundled_thermal
from rptcam_cl.optics.glass import AIR, STANDARD_C, STANDARD_HPA, Heated, Medium, Melt, Thermal
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import bend
from rptcam_cl.optics.shapes import ITERATIONS, LAST_STEP, Biconic, Hits, Iterated, Toroid, on_vertex_plane
from rptcam_cl.optics.surface import IN_PLACE, Configuration, FocusState, Surface, SurfacePose

# A lens at another temperature: its glass has another index, and glass and barrel are longer.

# Linear expansion near room temperature [1/K] as handbooks have it (ASM Metals Handbook, vols. 1 and 2) for the usual
# alloys: 6061, C36000, 304, 416, Ti-6Al-4V, Invar 36; polycarbonate as its makers print it (ISO 11359-2).
BARRELS = {
    "aluminium": 23.6e-6, "brass": 20.5e-6, "stainless_steel": 17.3e-6, "steel_416": 9.9e-6, "titanium": 8.6e-6,
    "invar": 1.3e-6, "polycarbonate": 65e-6,
}  # fmt: skip


@dataclass(frozen=True)
class Heat:
    """What a lens is exposed to.

    Attributes
    ----------
    celsius : float
        Temperature of lens, barrel and air.
    pressure_hpa : float
        Of the air.
    barrel_per_k : float
        Linear expansion of what holds the elements and the film [1/K].
    """

    celsius: float = STANDARD_C
    pressure_hpa: float = STANDARD_HPA
    barrel_per_k: float = BARRELS["aluminium"]

    @property
    def barrel_scale(self) -> float:
        """By how much spaces in the barrel are longer than at 20 degrees."""
        return 1.0 + self.barrel_per_k * (self.celsius - STANDARD_C)

    def lens(self, lens: Lens) -> Lens:
        """Return a lens, made and measured at 20 degrees, under this heat; itself where nothing differs.

        Glass keeps its shape and grows, and mirrors behind it with it, those in air with their bodies; air spaces
        grow as the barrel does; a cemented surface as the glass behind it.

        Raises
        ------
        InputError
            When a catalogue or a lens file does not say how a glass or the body of a mirror changes.
        """
        if self.celsius == STANDARD_C and self.pressure_hpa == STANDARD_HPA:
            return lens
        for k, surface in enumerate(lens.surfaces):
            if surface.is_mirror and surface.glass == AIR and surface.body_per_k is None:
                raise InputError(
                    f"{lens.name}: surfaces[{k}]: is a mirror in front of its body, and nothing says how that expands"
                    " (write body_expansion_per_k beside mirror: true)"
                )
        if lens.fold is not None:
            raise InputError(f"{lens.name}: its axis is folded, and no file says how its parts are held apart")
        lens.refuse_phases("nothing says how it takes heat")
        media = [self._medium(lens, f"surfaces[{k}]", lens.surfaces[k].glass) for k in range(len(lens.surfaces))]
        growth = [self._growth(lens, k) for k in range(len(lens.surfaces))]
        bodies = [growth[k] if s.glass != AIR or k == 0 else growth[k - 1] for k, s in enumerate(lens.surfaces)]
        for k, surface in enumerate(lens.surfaces):
            if surface.body_per_k is not None:
                bodies[k] = 1.0 + surface.body_per_k * (self.celsius - STANDARD_C)
        surfaces = [
            replace(_scale_surface(surface, body), thickness=surface.thickness * gap, glass=medium)
            for surface, body, gap, medium in zip(lens.surfaces, bodies, growth, media, strict=True)
        ]

        def gaps(given: tuple[tuple[int, float], ...]) -> tuple[tuple[int, float], ...]:
            return tuple((k, gap * growth[k]) for k, gap in given)

        def position(given: Configuration) -> Configuration:
            stop = given.stop_diameter_mm
            if stop is not None and lens.stop_index is not None:
                stop *= bodies[lens.stop_index]
            return Configuration(given.name, gaps(given.gaps), stop, tuple(map(focus, given.floating)))

        def focus(given: FocusState) -> FocusState:
            shift = given.film_shift_mm
            return FocusState(given.distance_mm, gaps(given.gaps), None if shift is None else shift * self.barrel_scale)

        group = lens.focusing
        if group is not None:
            least, most = group.travel_mm
            group = replace(group, travel_mm=(least * self.barrel_scale, most * self.barrel_scale))
        return replace(
            lens,
            surfaces=tuple(surfaces),
            focusing=group,
            object_medium=self._medium(lens, "object_medium", lens.object_medium),
            configurations=tuple(position(given) for given in lens.configurations),
            floating=tuple(map(focus, lens.floating)),
        )

    def film(self, film_distance_mm: float) -> float:
        """Return where a film stands, behind the last vertex, that the barrel held at a distance at 20 degrees [mm]."""
        return film_distance_mm * self.barrel_scale

    def _medium(self, lens: Lens, where: str, glass: Medium) -> Medium:
        """Return a medium of a lens, hot."""
        if glass == AIR:
            return glass
        thermal = thermal_of(glass)
        if thermal is None or thermal.dispersion is None:
            key = "thermal: {d: [D0, D1, D2], e: [E0, E1], …}"
            raise _missing_value_error(lens, where, glass, "its index changes with temperature", key)
        return Heated.of(glass, thermal, self.celsius, self.pressure_hpa)

    def _growth(self, lens: Lens, k: int) -> float:
        """Return by how much the space behind a surface is longer."""
        glass = lens.surfaces[k].glass
        if glass == AIR:
            return self.barrel_scale
        thermal = thermal_of(glass)
        if thermal is None or thermal.expansion_per_k is None:
            raise _missing_value_error(lens, f"surfaces[{k}]", glass, "it expands", "expansion_per_k")
        return 1.0 + thermal.expansion_per_k * (self.celsius - STANDARD_C)


def thermal_of(glass: Medium) -> Thermal | None:
    """Return the thermal data of a glass, its own or by its name."""
    if isinstance(glass, Melt):
        return thermal_of(glass.glass)
    return glass.thermal if glass.thermal is not None else bundled_thermal(glass)


def _missing_value_error(lens: Lens, where: str, glass: Medium, what: str, key: str) -> InputError:
    name = glass.name or "(unnamed)"
    return InputError(
        f"{lens.name}: {where}: nothing says how glass {name} takes heat: how {what}"
        f" (give {key} beside its law, or the name of a glass of SCHOTT, OHARA, HOYA, HIKARI, CDGM or SUMITA)"
    )


def _scale_surface(surface: Surface, scale: float) -> Surface:
    """Return a surface that is larger by a factor, and of the same shape."""
    form, pose, region = surface.form, surface.pose, surface.region
    if isinstance(form, Biconic | Toroid):
        form = replace(form, curvature_x=form.curvature_x / scale)
    if pose is not None:
        x, y, z = pose.offset
        pose = replace(pose, offset=(x * scale, y * scale, z * scale))
    if region is not None:
        width, height = region.half_width * scale, region.half_height * scale
        x, y = region.centre
        region = replace(
            region, half_width=width, half_height=height, edge=region.edge * scale, centre=(x * scale, y * scale),
            radius=region.radius * scale, inner_radius=region.inner_radius * scale,
        )  # fmt: skip
    return replace(
        surface,
        curvature=surface.curvature / scale,
        semi_diameter=surface.semi_diameter * scale,
        inner_semi_diameter=surface.inner_semi_diameter * scale,
        aspheric=tuple((power, a * scale ** (1 - power)) for power, a in surface.aspheric),
        form=form,
        pose=pose,
        region=region,
    )


#
# Copies of a lens, each with its own errors of manufacture: one of them as a lens, or all of them as arrays.
#
# A `Deviation` is one number, or one pair of numbers, that may be off. Its values over the copies make the `Copies`.
# A copy whose values are all 0 has the numbers of the lens to the last bit.

Array = NDArray[np.float64]

DeviationKind = Literal["radius", "curvature", "thickness", "index", "abbe", "decentre", "tilt"]
PAIRS = ("decentre", "tilt")  # deviations across the axis, which have an x and a y


@dataclass(frozen=True)
class Deviation:
    """One thing that manufacture may get wrong.

    Attributes
    ----------
    kind : str
        ``radius`` as a share of the radius, ``curvature`` [1/mm], ``thickness`` [mm], ``index``, ``abbe`` as a share of
        the Abbe number, ``decentre`` along x and y [mm], or ``tilt`` about x and y [radians].
    first, last : int
        Surfaces that move together about the vertex of the first; of the other kinds the one surface, which has the
        radius or is followed by the gap or the glass. Where light meets one of them again, it is off there too.
    others : tuple of int
        Surfaces that move with them, cemented to one that light has met before.
    """

    kind: DeviationKind
    first: int
    last: int
    others: tuple[int, ...] = ()

    @property
    def is_pair(self) -> bool:
        """Whether it has an x and a y."""
        return self.kind in PAIRS


_ONE_PLACE_MM = 1e-6  # how near each other the vertices of one surface lie that a lens has twice
_NEARLY = 1e-3  # of the length of the lens, within which two alike are neither one surface nor clearly two


def first_met(lens: Lens) -> tuple[int, ...]:
    """Return the number of each surface, or that of the one which light has met there before: between mirrors.

    Raises
    ------
    InputError
        When two surfaces are alike and lie nearly in one place.
    """
    numbers = list(range(len(lens.surfaces)))
    for k, surface in enumerate(lens.surfaces if lens.has_mirrors else ()):
        for j in range(k):
            apart, other = abs(float(lens.vertices[k] - lens.vertices[j])), lens.surfaces[j]
            alike = (surface.curvature, surface.conic, surface.aspheric, surface.cylinder, surface.form, surface.pose)
            of_other = (other.curvature, other.conic, other.aspheric, other.cylinder, other.form, other.pose)
            if numbers[j] != j or alike != of_other or apart > _NEARLY * float(np.ptp(lens.vertices)):
                continue
            if apart > _ONE_PLACE_MM:
                raise InputError(
                    f"{lens.name}: surfaces {j} and {k} have one shape and lie {apart:.3g} mm apart: are they one"
                    " surface, whose errors are the same both times? (give thicknesses by which it lies in one place)"
                )
            numbers[k] = j
            break
    return tuple(numbers)


def is_free_gap(lens: Lens, k: int) -> bool:
    """Return whether the space behind a surface places the next one: light has not met that before."""
    return k < len(lens.surfaces) - 1 and first_met(lens)[k + 1] == k + 1


@dataclass(frozen=True)
class Copies:
    """Copies of a lens.

    Attributes
    ----------
    lens : Lens
        The design.
    deviations : sequence of Deviation
        Those of surfaces before those of what carries them: tilts and decentres act in this order.
    values : (copies, deviations, 2) array
        In the units of `Deviation`; a deviation that is no pair has its value in the first place.
    """

    lens: Lens
    deviations: Sequence[Deviation]
    values: Array

    @property
    def count(self) -> int:
        """How many copies there are."""
        return len(self.values)

    def part(self, low: int, high: int) -> Copies:
        """Return the copies of a range."""
        return Copies(self.lens, self.deviations, self.values[low:high])

    @cached_property
    def first_met(self) -> tuple[int, ...]:
        """As the function of this name has it of the design."""
        return first_met(self.lens)

    @cached_property
    def curvatures(self) -> Array:
        """Curvature of each surface (copies, surfaces) [1/mm]."""
        of_design = self._rows([surface.curvature for surface in self.lens.surfaces])
        radius, more = (self._sums(kind)[:, self.first_met] for kind in ("radius", "curvature"))
        return of_design / (1.0 + radius) + more

    @cached_property
    def thicknesses(self) -> Array:
        """Thickness behind each surface (copies, surfaces) [mm]."""
        of_design = self._rows([surface.thickness for surface in self.lens.surfaces])
        if not self.lens.has_mirrors:
            return of_design + self._sums("thickness")
        return np.concatenate([np.diff(self.vertices, axis=1), of_design[:, -1:]], axis=1)

    @cached_property
    def vertices(self) -> Array:
        """Position z of each vertex (copies, surfaces) [mm].

        Each surface stands where the one before it, along the light, places it; met again, it stays there.
        """
        if not self.lens.has_mirrors:
            places = np.zeros_like(self.thicknesses)
            np.cumsum(self.thicknesses[:, :-1], axis=1, out=places[:, 1:])
            return places
        off, places = self._sums("thickness"), self._rows(self.lens.vertices)
        for k, first in enumerate(self.first_met[1:], start=1):
            gap = self.lens.vertices[k] - self.lens.vertices[k - 1]
            new = places[:, k - 1] + gap + self.lens.senses[k] * off[:, k - 1]
            places[:, k] = new if first == k else places[:, first]
        return places

    def indices(self, wavelength_nm: float) -> Array:
        """Return the index before the first surface and after each one (copies, surfaces + 1)."""
        values = self._rows(self.lens.indices(wavelength_nm))
        shift, share = self._melts()
        values[:, 1:] += shift
        for k in np.flatnonzero(np.any(share != 0, axis=0)).tolist():
            glass = self.lens.surfaces[k].glass
            off_d = float(glass.index(wavelength_nm) - glass.index(LINE_D_NM))
            values[:, k + 1] += off_d * (1.0 / (1.0 + share[:, k]) - 1.0)
        return values

    @cached_property
    def poses(self) -> dict[int, tuple[Array, Array]]:
        """Rotation (copies, 3, 3) and offset (copies, 3) [mm] of each surface that has any."""
        poses: dict[int, tuple[Array, Array]] = {}
        for k, surface in enumerate(self.lens.surfaces):
            if surface.pose is not None:
                poses[k] = (self._rows(surface.pose.matrix()), self._rows(surface.pose.offset))
        for number, deviation in enumerate(self.deviations):
            if not deviation.is_pair:
                continue
            value = self.values[:, number]
            moved = {self.first_met[k] for k in (*range(deviation.first, deviation.last + 1), *deviation.others)}
            for k in np.flatnonzero([first in moved for first in self.first_met]).tolist():
                start = (self._rows(np.eye(3)), np.zeros((self.count, 3)))
                arm = float(self.lens.vertices[self.first_met[k]] - self.lens.vertices[deviation.first])
                poses[k] = _move_pose(*poses.get(k, start), deviation, value, arm)
        return poses

    def copy(self, number: int) -> Lens:
        """Return one of the copies as a lens."""
        one = self.part(number, number + 1)
        surfaces = list(self.lens.surfaces)
        shift, share = (values[0] for values in one._melts())
        for k, surface in enumerate(surfaces):
            if shift[k] or share[k]:
                surface = replace(surface, glass=Melt.of(surface.glass, float(shift[k]), float(share[k])))
            curvature, thickness = float(one.curvatures[0, k]), float(one.thicknesses[0, k])
            surfaces[k] = replace(surface, curvature=curvature, thickness=thickness, pose=one._pose(k))
        return replace(self.lens, surfaces=tuple(surfaces))

    def _pose(self, k: int) -> SurfacePose | None:
        """Return the pose of a surface of the first copy; None where it stands as the design has it, without one."""
        if k not in self.poses:
            return None
        rotation, offset = self.poses[k][0][0], self.poses[k][1][0]
        pose = SurfacePose(tuple(offset.tolist()), tuple(tuple(row) for row in rotation.tolist()))  # type: ignore[arg-type]
        return None if pose == IN_PLACE and self.lens.surfaces[k].pose is None else pose

    def _melts(self) -> tuple[Array, Array]:
        """By how much the index behind each surface is off, and the Abbe number as a share (copies, surfaces)."""
        spaces = [frozenset(pair) for pair in itertools.pairwise((*self.first_met, len(self.first_met)))]
        first = [spaces.index(space) for space in spaces]  # light crosses one glass again behind a mirror
        return self._sums("index")[:, first], self._sums("abbe")[:, first]

    def _rows(self, of_lens: ArrayLike) -> Array:
        """Return numbers of the design for each copy."""
        values = np.asarray(of_lens, dtype=np.float64)
        return np.repeat(values[None], self.count, axis=0)

    def _sums(self, kind: DeviationKind) -> Array:
        """Return the deviations of a kind, added up over what concerns each surface (copies, surfaces)."""
        total = np.zeros((self.count, len(self.lens.surfaces)))
        for number, deviation in enumerate(self.deviations):
            if deviation.kind == kind:
                total[:, deviation.first] += self.values[:, number, 0]
        return total


def _move_pose(rotation: Array, offset: Array, deviation: Deviation, value: Array, arm: float) -> tuple[Array, Array]:
    """Return poses after a further tilt or decentre about a vertex that lies `arm` [mm] before theirs.

    As `SurfacePose.carried_by`, for many copies.
    """
    if deviation.kind == "decentre":
        return rotation, offset + np.pad(value, ((0, 0), (0, 1)))
    turn, place = turns(value[:, 0], value[:, 1]), np.array([0.0, 0.0, arm])
    return turn @ rotation, np.einsum("mij,mj->mi", turn, offset + place) - place


def turns(about_x: Array, about_y: Array) -> Array:
    """Return matrices (n, 3, 3) of turns about x, then y [radians], right handed."""
    (cx, sx), (cy, sy) = ((np.cos(angle), np.sin(angle)) for angle in (about_x, about_y))
    zero = np.zeros_like(cx)
    rows = [[cy, sy * sx, sy * cx], [zero, cx, -sx], [-sy, cy * sx, cy * cx]]
    return np.moveaxis(np.array(rows), -1, 0)


#
# Rays through many copies of a lens at once, in float64: those of `ray_trace.trace`, but that rims stop none.
#
# A tolerance run compares copies by the same rays, which pass the design. What the rim of a decentred surface takes
# from the edge of a beam is left out: it would make the number of rays jump, and with it every sensitivity.

RAYS_TOGETHER = 8192  # whose components stay in the processor's cache


def check_copies(lens: Lens) -> None:
    """Refuse a lens whose copies cannot be traced.

    Raises
    ------
    InputError
        For folded axes, parts of lenses that light passes beside, and surfaces that may be one or two.
    """
    first_met(lens)
    if lens.fold is not None:
        raise InputError(
            f"{lens.name}: its axis is folded; tolerances are for lenses whose film stands across one axis"
        )
    if lens.is_split:
        raise InputError(f"{lens.name}: light passes beside some of its surfaces; tolerances are for whole lenses")


def film_points(
    copies: Copies, origins: Array, directions: Array, wavelength_nm: float, film_distance_mm: float
) -> tuple[Array, Array]:
    """Return where rays from the scene meet the films of all copies, and their slopes there.

    Parameters
    ----------
    copies : Copies
    origins, directions : (rays, 3) arrays
        The same for all copies [mm]; directions of unit length.
    wavelength_nm : float
    film_distance_mm : float
        From the last vertex of each copy to its film.

    Returns
    -------
    points, slopes : (copies, rays, 2) arrays
        x and y [mm], and how far they change along 1 mm of the axis, with the light; NaN for rays that miss a surface
        or are totally reflected.
    """
    rays = len(origins)
    points, slopes = np.empty((2, copies.count, rays, 2))
    step = max(1, RAYS_TOGETHER // rays)
    with np.errstate(all="ignore"):
        for low in range(0, copies.count, step):
            some = copies.part(low, low + step)
            p, d = _through(some, origins, directions, wavelength_nm)
            sense = copies.lens.sense
            slope = sense * d[:2] / d[2]
            film = sense * np.repeat(some.vertices[:, -1], rays) + film_distance_mm
            at = p[:2] + slope * (film - sense * p[2])
            shape = (2, some.count, rays)
            points[low : low + step] = np.moveaxis(at.reshape(shape), 0, -1)
            slopes[low : low + step] = np.moveaxis(slope.reshape(shape), 0, -1)
    return points, slopes


def _through(copies: Copies, origins: Array, directions: Array, wavelength_nm: float) -> tuple[Array, Array]:
    """Return points and directions (3, copies * rays) behind the last surface."""
    rays, indices = len(origins), copies.indices(wavelength_nm)
    p, d = np.tile(origins.T, copies.count), np.tile(directions.T, copies.count)
    for k, surface in enumerate(copies.lens.surfaces):
        shift = np.zeros((3, 1)) + np.repeat(copies.vertices[:, k], rays) * [[0.0], [0.0], [1.0]]
        pose = copies.poses.get(k)
        q, v = (p - shift, d) if pose is None else _inward(pose, p - shift, d, rays)
        hits = _meet(surface, np.repeat(copies.curvatures[:, k], rays), q, v)
        good = hits.met & np.isfinite(hits.distances) & (v[2] * copies.lens.senses[k] > 0)
        n, m = (np.repeat(indices[:, side], rays) for side in (k, k + 1))
        v, through = bend(surface, hits, v, n, m, wavelength_nm)
        good &= through
        q = np.where(good, hits.points, np.nan)
        q, v = (q, v) if pose is None else _outward(pose, q, v, rays)
        p, d = q + shift, v
    return p, d


def _inward(pose: tuple[Array, Array], p: Array, d: Array, rays: int) -> tuple[Array, Array]:
    rotation, offset = pose
    return _turn(np.swapaxes(rotation, 1, 2), p - np.repeat(offset.T, rays, axis=1), d, rays)


def _outward(pose: tuple[Array, Array], p: Array, d: Array, rays: int) -> tuple[Array, Array]:
    rotation, offset = pose
    p, d = _turn(rotation, p, d, rays)
    return p + np.repeat(offset.T, rays, axis=1), d


def _turn(rotation: Array, p: Array, d: Array, rays: int) -> tuple[Array, Array]:
    """Return points and directions (3, copies * rays), those of each copy turned by its matrix."""
    m = [[np.repeat(rotation[:, i, j], rays) for j in range(3)] for i in range(3)]
    turned = (np.stack([row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in m]) for v in (p, d))
    return next(turned), next(turned)


def _meet(surface: Surface, curvatures: Array, p: Array, d: Array) -> Hits:
    """Return where rays meet surfaces that differ in their curvature alone (rays,)."""
    profile = replace(surface, curvature=curvatures)  # type: ignore[arg-type]
    shape = surface.shape
    if not isinstance(shape, Iterated):
        return shape.meet(profile, p, d)
    x, y, to_plane = on_vertex_plane(p, d)
    step = shape.first_guess(profile, x, y, d)
    least = LAST_STEP * (np.abs(x) + np.abs(y) + np.abs(step)) + 1e-300
    for _ in range(ITERATIONS):
        change, _side = shape.newton_step(profile, x + step * d[0], y + step * d[1], step * d[2], d)
        step = step - change
        if np.all((np.abs(change) <= least) | ~np.isfinite(change)):
            break
    return shape.hits_after(profile, x, y, to_plane, d, step)


# Light that the front of a lens scatters: a veil and a glow about whatever is bright.
#
# Roughness and dust scatter a little of the light that passes: radiance over irradiance is A / (B + |b - b0|^g) of the
# sines b of its directions before and behind (the ABg form of J. E. Harvey's finding that it depends on their
# difference alone, «Light-scattering characteristics of optical surfaces», 1976). In sines the film is therefore
# convolved with one kernel. What scatters before the stop fills it as other light does.

_CORE, _FINER = 8, 8  # cells about the middle of the kernel whose mean is taken of so many points a side
_LOG_STEPS = -30.0 * (1 - (np.arange(4000) + 0.5) / 4000)  # of sines, in parts of the largest


def scatter_share(abg: tuple[float, float, float]) -> float:
    """Return the total integrated scatter of an ABg surface at normal incidence: 2 pi of the integral of f b db."""
    sines = np.exp(_LOG_STEPS)
    return float(2 * np.pi * np.sum(abg[0] * sines**2 / (abg[1] + sines ** abg[2])) * (_LOG_STEPS[1] - _LOG_STEPS[0]))


def sines_of_film(lens: Lens, film_distance_mm: float, radius_mm: float) -> list[float]:
    """Return factors of 1, r^2, r^4 … by which a place on the film at a radius r [mm] gives the sines of its chief ray.

    Raises
    ------
    InputError
        When the lens is not round, or has no chief rays so far from its axis.
    """
    if not lens.is_rotational:
        raise InputError(f"{lens.name}: what scatters is known of round lenses alone")
    radii = radius_mm * np.linspace(0.02, 1.0, 40)
    points = np.column_stack([radii, 0 * radii, np.full(40, lens.film_z(film_distance_mm))])
    rays = round_chief_rays(lens, points)
    sines = np.hypot(*rays.directions[:, :2].T)
    if not rays.found.all() or np.any(np.diff(sines) <= 0):
        raise InputError(f"{lens.name}: no chief rays reach the corners of the film")
    factors = np.polynomial.polynomial.polyfit((radii / radius_mm) ** 2, sines / radii, 6)
    return [float(factor / radius_mm ** (2 * power)) for power, factor in enumerate(factors)]


def _film_sines(
    shape: Sequence[int], sines: Sequence[float], pixels_mm: Sequence[float], lit: Sequence[Sequence[float]]
) -> tuple[Array, Array, Array, Array]:
    """Return sines along x and y of a film's pixels, their area in sines, and the share of the middle's light there."""
    x0, dx, y0, dy = pixels_mm
    x, y = x0 + dx * (np.arange(shape[1]) + 0.5), (y0 + dy * (np.arange(shape[0]) + 0.5))[:, None]
    polynomial = np.polynomial.Polynomial(sines)
    square = x * x + y * y
    factor = polynomial(square)
    area = factor * (factor + 2 * square * polynomial.deriv()(square)) * abs(dx * dy)
    return factor * x, factor * y, area, np.interp(np.sqrt(square), lit[0], lit[1])


def scattered(
    film: NDArray[Any],
    abg: Sequence[float],
    sines: Sequence[float],
    pixels_mm: Sequence[float],
    lit: Sequence[Sequence[float]],
) -> Array:
    """Return the light that the front of a lens scatters from a film's light onto it.

    Parameters
    ----------
    film : (rows, columns, channels) array
        Without scatter.
    abg : three floats
        A, B and g.
    sines : floats
        See `sines_of_film`.
    pixels_mm : four floats
        Where the film begins and the steps of its pixels, along its columns and rows [mm from the axis].
    lit : two sequences
        Distances from the axis [mm], and what even light gives there, over that in the middle.
    """
    rows, columns, channels = film.shape
    *places, area, passed = _film_sines(film.shape, sines, pixels_mm, lit)
    dx, dy = pixels_mm[1::2]
    cells = abs(dx) * sines[0], abs(dy) * sines[0]
    places = [(each - each.min()) / cell for each, cell in zip(places, cells, strict=True)]
    (u, right), (v, below) = ((np.floor(each).astype(int), each - np.floor(each)) for each in places)
    wide, high = int(u.max()) + 2, int(v.max()) + 2
    corners = [((v + j) * wide + u + i, (right if i else 1 - right) * (below if j else 1 - below))
               for i in (0, 1) for j in (0, 1)]  # fmt: skip
    size = _even_length(2 * high), _even_length(2 * wide)
    kernel = np.fft.rfft2(_scatter_kernel(abg, cells, high, wide, size))
    out = np.empty((rows, columns, channels))
    for channel in range(channels):
        light, grid = film[..., channel] * area / passed, np.zeros(high * wide)
        for place, weight in corners:
            grid += np.bincount(place.ravel(), (light * weight).ravel(), high * wide)
        spread = np.fft.irfft2(np.fft.rfft2(grid.reshape(high, wide), size) * kernel, size)[:high, :wide].ravel()
        out[..., channel] = passed * sum(weight * spread[place] for place, weight in corners)
    return np.maximum(out, 0.0)


def scattered_from_beside(
    shape: Sequence[int],
    abg: Sequence[float],
    sines: Sequence[float],
    pixels_mm: Sequence[float],
    lit: Sequence[Sequence[float]],
    sources: tuple[Array, Array],
) -> Array:
    """Return the light (rows, columns, 3) that the front scatters from sources onto a film.

    In radiance before the lens that would give it in the film's middle. The others as of `scattered`; sources are the
    sines (n, 2) of their light, positive where it goes on to the film's ends, and its irradiance of the front (n, 3).
    """
    out, (x, y, _, passed) = np.zeros((*shape[:2], 3)), _film_sines(shape, sines, pixels_mm, lit)
    for (at_x, at_y), light in zip(*sources, strict=True):
        for k in range(shape[0]):
            square = (x[k] - at_x) ** 2 + (y[k] - at_y) ** 2
            away = square if abg[2] == 2 else square ** (abg[2] / 2)
            out[k] += (abg[0] * passed[k] / (abg[1] + away))[:, None] * light
    return out


def _even_length(least: int) -> int:
    """Return an even length from there on that transforms are fast for."""
    return min(odd << max(math.ceil(math.log2(least / odd)), 1) for odd in (1, 3, 5, 9, 15))


def _scatter_kernel(
    abg: Sequence[float], cells: tuple[float, float], high: int, wide: int, size: tuple[int, int]
) -> Array:
    """Return the mean of the scatter function over cells of sines, about the corner of a torus."""

    def function(x: NDArray[Any], y: NDArray[Any]) -> Array:
        return np.asarray(abg[0] / (abg[1] + np.hypot(x, y) ** abg[2]))

    j, i = (np.fft.fftfreq(count, 1 / count) for count in size)
    kernel = function(i * cells[0], (j * cells[1])[:, None])
    within = (np.arange(_FINER) + 0.5) / _FINER - 0.5
    core = np.arange(-_CORE, _CORE + 1)
    fine_x, fine_y = ((core[:, None] + within).ravel() * cell for cell in cells)
    means = function(fine_x, fine_y[:, None]).reshape(2 * _CORE + 1, _FINER, 2 * _CORE + 1, _FINER).mean(axis=(1, 3))
    disk = np.sqrt(cells[0] * cells[1] / np.pi)  # as large as the middle cell
    sines = disk * np.exp(_LOG_STEPS)
    means[_CORE, _CORE] = 2 * np.sum(function(sines, 0 * sines) * (sines / disk) ** 2) * (_LOG_STEPS[1] - _LOG_STEPS[0])
    kernel[np.ix_(core, core)] = means
    return kernel
