"""Lenses made better: the merit of a problem with exact derivatives, damped least squares, hops, other glasses."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM, __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import read_whole, replacing
from rptcam_cl.core.strict_yaml import MAX_BYTES
from rptcam_cl.optics import ray_derivatives
from rptcam_cl.optics.design import NO_DETAIL, THIN, GlassChange, Problem, Solve, Term, Variable, read_problem
from rptcam_cl.optics.files.glasses import find_glass, glasses_of
from rptcam_cl.optics.glass import AIR, Medium, abbe_number, known_range
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import Status, trace

# The merit of a problem: residuals whose squares add up to the merit squared, with exact derivatives.

Array = NDArray[np.float64]

LOST = 0.02  # of the focal length: the spot that a lost ray counts as
_HOLD = 1e-3  # of the focal length: by how much a bound may be overstepped for ten times the merit
_KEEP_MM = 1e-4  # by how far inside bounds the search aims, so that it ends within them
_HOLD_SHARE = 1e-5  # of the focal length: how exactly it is held


@dataclass(frozen=True)
class _FieldBeam:
    """Rays of one field: where they are among all, by wavelength, with weights whose sum over all fields is 1."""

    rows: slice
    weights: Array  # (wavelengths, rays of the pupil + chief), that of the chief ray 0
    field: float


@dataclass(frozen=True)
class State:
    """A lens for some values of the variables.

    Attributes
    ----------
    lens : Lens
    film_mm : float
    seeds : Seeds
        Derivatives of its numbers.
    paraxial : Paraxial
    beam : RaysWithDerivatives
    """

    lens: Lens
    film_mm: float
    seeds: ray_derivatives.Seeds
    paraxial: ray_derivatives.Paraxial
    beam: ray_derivatives.RaysWithDerivatives


_Rows = tuple[str, Array, Array]  # a name, values (n,) and derivatives (n, variables)


Judge = Callable[[Lens, float], Any]  # of a lens and its film distance: the value of a term, or that and residuals
Judges = Mapping[str, Judge]  # by the name of the term
STEPS = {"as_built": 1e-4, "picture": 4e-3}  # of a variable, by which what judges say is differentiated


class MeritFunction:
    """The merit of a problem with some glasses.

    `opening` is the share of pupil and field that rays fill, and `judges` say how good copies and pictures are; a term
    without one counts for nothing.
    """

    def __init__(
        self, given: Problem, glasses: Mapping[int, Medium], opening: float = 1.0, judges: Judges | None = None
    ) -> None:
        self.given, self.opening, self.judges = given, opening, judges or {}
        self.start = given.lens.with_changes({k: {"glass": glass} for k, glass in glasses.items()})
        self.indices = self.start.indices(np.array(given.wavelengths_nm))
        self.pupil = given.focal_length_mm / given.f_number / 2
        self.scales = np.array([self._scale(variable) for variable in given.variables])
        self._set_rays()
        self.x0 = self._values(self.start) / self.scales
        self.shifts: Array | None = None
        self.weight = 0.0
        self.defaults = self._default_bounds()
        self._last: tuple[bytes, bool, Array, Array] | None = None
        self.by_spots: MeritFunction | None = None  # where pictures begin: they are noisy, and flat far from focus
        if "picture" in self.judges:
            self.by_spots = MeritFunction(replace(given, terms=(Term("spot", 1.0),)), glasses, opening)
            self.x0 = self.by_spots.x0
        else:
            self._focus()

    def _focus(self) -> None:
        """Start with the film where the merit is least: spots are linear in its distance."""
        for j, variable in enumerate(self.given.variables):
            if variable.kind == "film":
                values, by = self.evaluate(self.x0, True)
                square = float(by[:, j] @ by[:, j])
                moved = self.x0.copy()
                moved[j] -= float(values @ by[:, j]) / square if square else 0.0
                better, _ = self.evaluate(moved, False)
                self.x0 = moved if better @ better < values @ values else self.x0

    def _scale(self, variable: Variable) -> float:
        length, height = abs(self.given.focal_length_mm), self.start.surfaces[variable.surface].semi_diameter
        height = min(height, length)
        match variable.kind:
            case "curvature":
                return 1.0 / length
            case "thickness" | "film":
                return 0.1 * length
            case "aspheric":
                return float(0.01 * height ** (1 - variable.power))
        return 1.0  # of a conic constant

    def _values(self, lens: Lens) -> Array:
        nm = self.given.wavelengths_nm[self.given.reference]
        film = lens.first_order(nm).back_focal_distance_mm
        if self.is_near:
            paraxial = ray_derivatives.trace_paraxial(
                lens, self.indices, ray_derivatives.Seeds.none(len(lens.surfaces), 0), 0
            )
            film = float(self._images(paraxial)[0][self.given.reference])
        values = []
        for variable in self.given.variables:
            surface = lens.surfaces[variable.surface]
            match variable.kind:
                case "film":
                    values.append(film)
                case "aspheric":
                    values.append(dict(surface.aspheric).get(variable.power, 0.0))
                case _:
                    values.append(getattr(surface, variable.kind))
        return np.array(values)

    def _set_rays(self) -> None:
        """Lay rays into the pupil of each field: Gaussian rings and arms over what the rims of the start pass."""
        given, points, fields, waves, low = self.given, [], [], [], 0
        self.fields: list[_FieldBeam] = []
        nodes, node_weights = np.polynomial.legendre.leggauss(given.rings)
        radii, count = np.sqrt((nodes + 1) / 2), len(given.wavelengths_nm)
        shares = np.array(given.wavelength_weights) / sum(given.wavelength_weights)
        for degrees, weight in zip(given.fields_degrees, given.field_weights, strict=True):
            arms = given.arms
            # the half of the pupil at x > 0: the other one is its mirror image
            angles = (np.arange(arms) + 0.5) * np.pi / arms
            middle, half_y, half_x = self._opening(degrees) if given.vignetting else (0.0, 1.0, 1.0)
            u = half_x * (radii[:, None] * np.sin(angles)).ravel()
            v = middle + half_y * (radii[:, None] * np.cos(angles)).ravel()
            of_pupil = np.append(np.repeat(node_weights / 2, arms) / arms, 0.0)
            u, v = np.append(u, 0.0), np.append(v, 0.0)
            points.append(np.tile([u, v], count))
            n = len(u) * count
            share = weight / sum(given.field_weights)
            self.fields.append(_FieldBeam(slice(low, low + n), share * shares[:, None] * of_pupil, degrees))
            fields += [np.full(n, math.radians(degrees))]
            waves += [np.repeat(np.arange(count), len(u))]
            low += n
        self.points = np.concatenate(points, axis=1) * self.pupil * self.opening
        self.waves, angle = np.concatenate(waves), np.concatenate(fields) * self.opening
        self.directions = np.array([np.zeros_like(angle), np.sin(angle), np.cos(angle)])
        away = self.given.object_distance_mm
        if self.is_near:
            self.origins = -away * np.array([np.zeros_like(angle), np.tan(angle), np.ones_like(angle)])
        self.of_rays = self.indices[:, self.waves]
        weights = np.concatenate([rays.weights.ravel() for rays in self.fields])
        self.lost_weights = np.maximum(weights, weights[weights > 0].min())

    def _opening(self, degrees: float) -> tuple[float, float, float]:
        """Return middle and half sizes, of the unit pupil, of what the rims of the start pass of a field."""
        lens = self.start
        pupil = lens.first_order(self.given.wavelengths_nm[self.given.reference]).entrance_pupil.distance_mm
        assert lens.stop_index is not None
        lens = lens.with_changes({lens.stop_index: {"semi_diameter": np.inf, "stop_shape": None}})
        line = np.linspace(-1, 1, 41)
        u, v = (a.ravel() for a in np.meshgrid(line, line))
        inside = np.hypot(u, v) <= 1
        u, v = u[inside], v[inside]
        origins = np.stack([u * self.pupil, v * self.pupil, np.full(len(u), pupil)], axis=1)
        angle = math.radians(degrees)
        directions = np.tile([0.0, math.sin(angle), math.cos(angle)], (len(u), 1))
        if self.is_near:
            away = self.given.object_distance_mm
            directions = origins + np.array([0.0, away * math.tan(angle), away])
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        nm = self.given.wavelengths_nm[self.given.reference]
        passed = trace(lens, origins, directions, nm, "scene").passed
        if np.count_nonzero(passed) < 20:
            return 0.0, 1.0, 1.0  # the start is no lens for this field yet
        low, high = float(v[passed].min()), float(v[passed].max())
        middle = (low + high) / 2
        return middle, (high - low) / 2, float(np.abs(u[passed]).max())

    # A lens from variables

    def state(self, x: Array, derivatives: bool) -> State:
        """Return the lens of some values, with rays through it."""
        lens, film, seeds = self._lens(x * self.scales, derivatives)
        ref = self.given.reference
        assert lens.stop_index is not None
        paraxial = ray_derivatives.trace_paraxial(lens, self.indices, seeds, lens.stop_index)
        if self.given.film == "paraxial":
            lengths, by, *_ = self._images(paraxial)
            film = float(lengths[ref])
            seeds.thicknesses[-1] = by[:, ref]
        place, by_place, _ = paraxial.entrance_pupil(ref, float(self.indices[0, ref]))
        points = np.vstack([self.points, np.full(self.points.shape[1], place)])
        index, d = self.of_rays[0], self.directions
        if self.is_near:
            return State(lens, film, seeds, paraxial, self._near_beam(lens, film, seeds, points, by_place))
        paths = index * np.sum(points * d, axis=0)
        beam = ray_derivatives.trace_with_derivatives(
            lens, points, d, paths, self.of_rays, film, seeds, by_place, by_place[:, None] * (index * d[2])
        )
        return State(lens, film, seeds, paraxial, beam)

    @property
    def is_near(self) -> bool:
        """Whether the object is not far away."""
        return math.isfinite(self.given.object_distance_mm)

    def _near_beam(
        self, lens: Lens, film: float, seeds: ray_derivatives.Seeds, pupil: Array, by_place: Array
    ) -> ray_derivatives.RaysWithDerivatives:
        """Return rays from points of a near object to points of the entrance pupil, which moves with the variables."""
        away = pupil - self.origins
        length = np.sqrt(np.sum(away * away, axis=0))
        d = away / length
        turn = -d * d[2] / length  # of a direction, per millimetre that the pupil moves
        turn[2] += 1.0 / length
        still = np.zeros((len(by_place), len(length)))
        return ray_derivatives.trace_with_derivatives(
            lens, self.origins, d, np.zeros(len(length)), self.of_rays, film, seeds, np.zeros(len(by_place)), still,
            [by_place[:, None] * row for row in turn],
        )  # fmt: skip

    def _images(self, paraxial: ray_derivatives.Paraxial) -> tuple[Array, Array, Array, Array]:
        """Return last vertex to image by wavelength and magnification (of far objects 1), each with its derivatives."""
        if self.is_near:
            return paraxial.images(self.given.object_distance_mm, self.indices[0])
        lengths, by = paraxial.back_focal_distances()
        return lengths, by, np.ones_like(lengths), np.zeros_like(by)

    def _lens(self, values: Array, derivatives: bool) -> tuple[Lens, float, ray_derivatives.Seeds]:
        given, count = self.given, len(values) if derivatives else 0
        seeds = ray_derivatives.Seeds.none(len(self.start.surfaces), count)
        changes: dict[int, dict[str, Any]] = {}
        film = given.film if isinstance(given.film, float) else 0.0
        terms = {k: dict(surface.aspheric) for k, surface in enumerate(self.start.surfaces)}
        tables = {"curvature": seeds.curvatures, "thickness": seeds.thicknesses, "conic": seeds.conics}
        for j, (variable, value) in enumerate(zip(given.variables, values.tolist(), strict=True)):
            k, unit = variable.surface, np.eye(1, count, j)[0] * self.scales[j] if count else np.zeros(0)
            if variable.kind == "film":
                film = value
                seeds.thicknesses[-1] = unit
            elif variable.kind == "aspheric":
                terms[k][variable.power] = value
                changes.setdefault(k, {})["aspheric"] = tuple(sorted(terms[k].items()))
                seeds.aspheric[k, variable.power] = unit
            else:
                changes.setdefault(k, {})[variable.kind] = value
                tables[variable.kind][k] = unit
        lens = self.start.with_changes(changes) if changes else self.start
        for one in given.followers:
            leader = getattr(lens.surfaces[one.leader], one.kind)
            lens = lens.with_changes({one.surface: {one.kind: one.factor * leader + one.offset}})
            tables[one.kind][one.surface] = one.factor * tables[one.kind][one.leader]
        for solve in given.solves:
            lens = self._solved_curvature(lens, seeds, solve) if solve.kind == "curvature" else self._solved_edge(
                lens, seeds, solve)  # fmt: skip
        return lens, film, seeds

    def _solved_curvature(self, lens: Lens, seeds: ray_derivatives.Seeds, solve: Solve) -> Lens:
        """Return the lens whose curvature makes the focal length; the power of the whole is linear in it."""
        k, ref = solve.surface, self.given.reference
        indices = self.indices[:, [ref]]
        own = ray_derivatives.Seeds.none(len(lens.surfaces), 1)
        own.curvatures[k] = 1.0
        now = ray_derivatives.trace_paraxial(lens, indices, own, 0)
        slope = float(now.behind_by[0, 1, 0, 0])
        wanted = -float(now.index[0]) / solve.value
        change = (wanted - float(now.behind[1, 0, 0])) / slope if slope else math.nan
        lens = lens.with_changes({k: {"curvature": lens.surfaces[k].curvature + change}})
        if seeds.curvatures.shape[1]:
            by = ray_derivatives.trace_paraxial(lens, indices, seeds, 0).behind_by[:, 1, 0, 0]
            seeds.curvatures[k] = seeds.curvatures[k] - by / slope
        return lens

    def _solved_edge(self, lens: Lens, seeds: ray_derivatives.Seeds, solve: Solve) -> Lens:
        """Return the lens whose gap has its edge thickness."""
        k = solve.surface
        edge, by = self._edge(lens, seeds, k)
        seeds.thicknesses[k] = seeds.thicknesses[k] - by
        return lens.with_changes({k: {"thickness": lens.surfaces[k].thickness + solve.value - edge}})

    def _edge(self, lens: Lens, seeds: ray_derivatives.Seeds, k: int) -> tuple[float, Array]:
        """Return the edge thickness of a gap [mm], at the larger of both clear heights, and its derivatives."""
        height = max(self.start.surfaces[j].semi_diameter for j in (k, k + 1))
        front, by_front = ray_derivatives.sag_with_derivatives(lens.surfaces[k], height, seeds, k)
        rear, by_rear = ray_derivatives.sag_with_derivatives(lens.surfaces[k + 1], height, seeds, k + 1)
        return lens.surfaces[k].thickness + rear - front, seeds.thicknesses[k] + by_rear - by_front

    # Bounds, as residuals that are 0 inside

    def measures(self, state: State) -> Iterator[tuple[str, str, float, Array]]:
        """Yield label, key, value and derivatives of all that bounds may be of."""
        lens, seeds = state.lens, state.seeds
        for k, surface in enumerate(lens.surfaces[:-1]):
            kind = "air" if surface.glass == AIR else "glass"
            yield f"{kind} behind surface {k}", f"{kind}_centre_mm", surface.thickness, seeds.thicknesses[k]
            with np.errstate(invalid="ignore", divide="ignore"):
                edge, by = self._edge(lens, seeds, k)
            yield f"edge behind surface {k}", f"{kind}_edge_mm", edge, by
        yield "length", "length_mm", lens.length + state.film_mm, seeds.thicknesses.sum(axis=0)
        yield "last vertex to film", "back_focal_mm", state.film_mm, seeds.thicknesses[-1]

    def _default_bounds(self) -> dict[str, float]:
        """Return the least value of each gap without bounds of its own: that of the start, or a customary one."""
        thin = THIN * abs(self.given.focal_length_mm)
        customary = {"glass_centre_mm": thin, "glass_edge_mm": thin / 2, "air_centre_mm": 0.0, "air_edge_mm": 0.0}
        result = {}
        for label, key, value, _ in self.measures(self.state(self.x0, False)):
            if key in customary and key not in self.given.bounds:
                result[label] = min(customary[key], value - 2 * _KEEP_MM) if math.isfinite(value) else -math.inf
        return result

    def overstepped(self, state: State) -> list[tuple[str, float, Array, float]]:
        """Return label, by how much too much (below 0: room is left), derivatives and allowance of each bound [mm]."""
        result = []
        for label, key, value, by in self.measures(state):
            low, high = self.given.bounds.get(key, (self.defaults.get(label, -math.inf), math.inf))
            for over, sign, bound in ((low - value, -1.0, low), (value - high, 1.0, high)):
                if math.isfinite(bound):
                    words = f"{key}: {label} must be {'at least' if sign < 0 else 'at most'} {bound:g} mm"
                    result.append((words, over + _KEEP_MM, sign * by, _KEEP_MM))
        if self.given.holds_focal_length:
            length, by_length = state.paraxial.focal_lengths()
            ref, wanted = self.given.reference, self.given.focal_length_mm
            words = f"focal_length_mm: must be {wanted:g} mm"
            for sign in (1.0, -1.0):
                over = sign * (float(length[ref]) - wanted)
                result.append((words, over, sign * by_length[:, ref], _HOLD_SHARE * abs(wanted)))
        return result

    def finished(self, state: State) -> tuple[Lens, float]:
        """Return the lens of a state with stop and rims set, and its film distance [mm]."""
        ref = self.given.reference
        height = state.paraxial.entrance_pupil(ref, float(self.indices[0, ref]))[2] * self.pupil
        heights = state.beam.heights.max(axis=1)
        changes: dict[int, dict[str, Any]] = {}
        for k, surface in enumerate(state.lens.surfaces):
            radius = height if k == state.lens.stop_index else max(surface.semi_diameter, float(heights[k]))
            changes[k] = {"semi_diameter": float(f"{radius:.9g}")}
        length = float(state.paraxial.focal_lengths()[0][ref])
        published = {"focal_length_mm": float(f"{length:.6g}"), "f_number": float(f"{length / (2 * self.pupil):.6g}")}
        return state.lens.with_changes(changes, published=published, warnings=()), state.film_mm

    # Residuals

    def evaluate(self, x: Array, derivatives: bool) -> tuple[Array, Array]:
        """Return residuals and their derivatives (residuals, variables); always finite."""
        key = x.tobytes()
        if self._last and self._last[0] == key and self._last[1] >= derivatives:
            return self._last[2], self._last[3]
        with np.errstate(all="ignore"):
            state = self.state(x, derivatives)
            rows = [
                (term.weight * r, term.weight * j) for term in self.given.terms for _, r, j in self._term(state, term)
            ]
            rows += self._judgements(x, state, derivatives)
            rows += [self._lost(state), self._bounds(state)]
        values, by = np.concatenate([r for r, _ in rows]), np.concatenate([j for _, j in rows])
        bad = ~np.isfinite(values)
        values[bad] = LOST * 1e3 * abs(self.given.focal_length_mm)
        by[~np.isfinite(by)] = 0.0
        self._last = (key, derivatives, values, by)
        return values, by

    def _judge(self, name: str, state: State) -> tuple[float, Array]:
        """Return the value that the judge of a term finds for a state, and its residuals."""
        if name not in self.judges:
            return 0.0, np.zeros(1)
        found = self.judges[name](self.finished(state)[0], state.film_mm)
        return (found[0], found[1]) if isinstance(found, tuple) else (found, np.array([found]))

    def _judgements(self, x: Array, state: State, derivatives: bool) -> Iterator[tuple[Array, Array]]:
        """Yield what judges say; it is differentiated by differences, as errors and samples are always the same."""
        for term in self.given.terms:
            if term.name in self.judges:
                values, step = self._judge(term.name, state)[1], STEPS[term.name]
                by = np.zeros((len(values), len(x) if derivatives else 0))
                for j in range(by.shape[1]):
                    moved = self.state(x + np.eye(1, len(x), j)[0] * step, False)
                    by[:, j] = (self._judge(term.name, moved)[1] - values) / step
                yield term.weight * values, term.weight * by

    def _lost(self, state: State) -> tuple[Array, Array]:
        """Count rays that miss a surface or are totally reflected as spots of `LOST`, larger the farther they fail."""
        weight = max(term.weight for term in self.given.terms)
        scale = LOST * 1e3 * abs(self.given.focal_length_mm) * weight * np.sqrt(self.lost_weights)
        return scale * state.beam.excess, (scale * state.beam.excess_by).T

    def _bounds(self, state: State) -> tuple[Array, Array]:
        rows = self.overstepped(state)
        over = np.array([row[1] for row in rows])
        by = np.array([row[2] for row in rows]).reshape(len(rows), state.seeds.thicknesses.shape[1])
        shifted = over + (self.shifts if self.shifts is not None else 0.0)
        inside = shifted <= 0
        return np.where(inside, 0.0, self.weight * shifted), np.where(inside[:, None], 0.0, self.weight * by)

    def set_hold(self, merit: float) -> None:
        """Set how much bounds weigh by the merit at hand, and forget how far they were overstepped."""
        self.weight, self.shifts = 10 * max(merit, 1e-3) / (_HOLD * abs(self.given.focal_length_mm)), None
        self._last = None

    def tighten(self, x: Array) -> float:
        """Move bounds by what they are overstepped (method of multipliers); return the worst, 1 being allowed."""
        rows = self.overstepped(self.state(x, False))
        over = np.array([row[1] for row in rows])
        shifts = self.shifts if self.shifts is not None else np.zeros(len(rows))
        self.shifts, self._last = np.maximum(shifts + over, 0.0), None
        return max((o / row[3] for o, row in zip(over, rows, strict=True)), default=0.0)

    def worst_bound(self, x: Array) -> tuple[str, float]:
        """Return the bound that is overstepped most, and by how much [mm]."""
        rows = self.overstepped(self.state(x, False))
        words, over, _, allowed = max(rows, key=lambda row: row[1] / row[3], default=("", -1.0, None, 1.0))
        return words, over - allowed

    def values_of(self, x: Array) -> dict[str, float]:
        """Return each term of the merit in its unit, and `merit` itself, without penalties."""
        with np.errstate(all="ignore"):
            state = self.state(x, False)
            parts = {term.name: [r for _, r, _ in self._term(state, term)] for term in self.given.terms}
        values = {name: float(np.sqrt(sum(np.sum(r * r) for r in rows))) for name, rows in parts.items()}
        values |= {name: self._judge(name, state)[0] for name in values if name in STEPS}
        values["merit"] = math.sqrt(sum((term.weight * values[term.name]) ** 2 for term in self.given.terms))
        return values

    def check_zones(self, x: Array) -> None:
        """Refuse zones that show nothing through the lens of some values: no search makes them sharper."""
        state = self.state(x, False)
        zones = self.judges["picture"](self.finished(state)[0], state.film_mm).zones
        unseen = [str(number) for number, (value, _) in enumerate(zones) if value >= NO_DETAIL]
        if unseen or not zones:
            words = "zone " + ", ".join(unseen) if unseen else "any zone"
            raise InputError(
                f"{self.given.label}: zones: nothing is seen in {words} through the best lens by spots (no light, or a "
                "plain field); choose others, or fields that the lens covers"
            )

    def lost_rays(self, x: Array) -> list[str]:
        """Return why rays are lost, in words; nothing where all come through."""
        beam, words = self.state(x, False).beam, []
        for status in (Status.missed, Status.total_internal_reflection):
            where = np.unique(beam.surface[beam.status == status])
            count = np.count_nonzero(beam.status == status)
            what = "miss" if status == Status.missed else "are totally reflected at"
            if count:
                words.append(f"{count} of {len(beam.status)} rays {what} surface {', '.join(map(str, where))}")
        return words

    def _term(self, state: State, term: Term) -> Iterator[_Rows]:
        """Yield the residuals of a term in its unit."""
        ref, given = self.given.reference, self.given
        match term.name:
            case "spot" | "wavefront" | "mtf":
                for rays in self.fields:
                    yield from getattr(self, f"_{term.name}")(state, rays, term)
            case "distortion" | "lateral_colour" | "telecentricity":
                for rays in self.fields:
                    if rays.field or term.name == "telecentricity":
                        yield getattr(self, f"_{term.name}")(state, rays)
            case "as_built" | "picture":
                return  # see `_judgements`
            case "axial_colour":
                lengths, by, *_ = self._images(state.paraxial)
                low, high = int(np.argmin(given.wavelengths_nm)), int(np.argmax(given.wavelengths_nm))
                yield term.name, lengths[[low]] - lengths[[high]], (by[:, low] - by[:, high])[None]
            case "focal_length" | "f_number":
                length, by = state.paraxial.focal_lengths()
                unit = 1.0 if term.name == "focal_length" else 2 * self.pupil
                yield term.name, length[[ref]] / unit - term.target, by[None, :, ref] / unit

    def _of_field(self, state: State, rays: _FieldBeam) -> tuple[Array, list[Array], list[Array]]:
        """Return weights of rays that come through, x and y on the film, and their derivatives (variables, n)."""
        beam, rows = state.beam, rays.rows
        weights = np.where(beam.status[rows] == Status.ok, rays.weights.ravel(), 0.0)
        return weights, [beam.points[i, rows] for i in (0, 1)], [beam.points_by[i][:, rows] for i in (0, 1)]

    def _spot(self, state: State, rays: _FieldBeam, term: Term) -> Iterator[_Rows]:
        """Distances from the centroid of all wavelengths [µm]; that of the two halves of the pupil lies at x = 0."""
        weights, (x, y), (dx, dy) = self._of_field(state, rays)
        root, total = 1e3 * np.sqrt(weights), weights.sum() or 1.0
        yield "spot", root * (y - weights @ y / total), (root * (dy - (dy @ weights / total)[:, None])).T
        yield "spot", root * x, (root * dx).T

    def _wavefront(self, state: State, rays: _FieldBeam, term: Term) -> Iterator[_Rows]:
        """Paths to the plane wave limit of the reference sphere about the centroid, less their mean [waves]."""
        weights, (x, y), (dx, dy) = self._of_field(state, rays)
        total = weights.sum() or 1.0
        index, beam, rows = self.of_rays[-1, rays.rows], state.beam, rays.rows
        d, dd = beam.directions[:, rows], [a[:, rows] for a in beam.directions_by]
        off, doff = weights @ y / total - y, (dy @ weights / total)[:, None] - dy
        w = beam.paths[rows] + index * (d[0] * -x + d[1] * off)
        dw = beam.paths_by[:, rows] + index * (dd[0] * -x - d[0] * dx + dd[1] * off + d[1] * doff)
        waves = np.array(self.given.wavelengths_nm)[self.waves[rows]] * 1e-6
        shape = rays.weights.shape
        each = weights.reshape(shape).sum(axis=1, keepdims=True)
        share = np.where(each > 0, weights.reshape(shape) / np.where(each > 0, each, 1.0), 0.0)
        mean = np.repeat(np.sum(share * w.reshape(shape), axis=1), shape[1])
        dmean = np.repeat(np.sum(share * dw.reshape(-1, *shape), axis=2), shape[1], axis=1)
        root = np.sqrt(weights) / waves
        yield "wavefront", root * (w - mean), (root * (dw - dmean)).T

    def _mtf(self, state: State, rays: _FieldBeam, term: Term) -> Iterator[_Rows]:
        """What the geometrical modulation lacks to 1, in both directions: smooth, and without diffraction."""
        weights, (x, y), (dx, dy) = self._of_field(state, rays)
        total, turn = weights.sum(), 2 * np.pi * term.target
        share = weights / (total or 1.0)
        root = np.sqrt(rays.weights.sum() / 2)
        middle, dmiddle = share @ y, dy @ share
        for h, dh, even in ((x, dx, True), (y - middle, dy - dmiddle[:, None], False)):
            phase, size = turn * h, turn * dh
            real, imaginary = share @ np.cos(phase), 0.0 if even else share @ np.sin(phase)
            dreal = -size @ (share * np.sin(phase))
            dimaginary = 0.0 if even else size @ (share * np.cos(phase))
            modulus = np.hypot(real, imaginary)
            by = (real * dreal + imaginary * dimaginary) / max(modulus, 1e-9)
            yield "mtf", np.array([root * (1 - modulus)]), -root * by[None]

    def _chief(self, state: State, rays: _FieldBeam) -> tuple[NDArray[np.intp], Array, Array]:
        """Return the rows of the chief rays by wavelength, and y and derivatives; 0 of those that are lost."""
        each = rays.weights.shape[1]
        rows = rays.rows.start + each * (np.arange(rays.weights.shape[0]) + 1) - 1
        good = state.beam.status[rows] == Status.ok
        return (
            rows,
            np.where(good, state.beam.points[1, rows], 0.0),
            np.where(good, state.beam.points_by[1][:, rows], 0.0),
        )

    def _distortion(self, state: State, rays: _FieldBeam) -> _Rows:
        _, y, dy = self._chief(state, rays)
        ref, wanted = self.given.reference, self.given.focal_length_mm * math.tan(math.radians(rays.field))
        by = np.zeros_like(dy[:, ref])
        if self.is_near:
            _, _, scales, scales_by = self._images(state.paraxial)
            wanted = -self.given.object_distance_mm * math.tan(math.radians(rays.field)) * float(scales[ref])
            by = y[ref] / scales[ref] * scales_by[:, ref]
        root = 100 * math.sqrt(rays.weights.sum()) / wanted
        return "distortion", root * (y[[ref]] - wanted), root * (dy[:, ref] - by)[None]

    def _lateral_colour(self, state: State, rays: _FieldBeam) -> _Rows:
        _, y, dy = self._chief(state, rays)
        low, high = int(np.argmin(self.given.wavelengths_nm)), int(np.argmax(self.given.wavelengths_nm))
        root = 1e3 * math.sqrt(rays.weights.sum())
        return "lateral_colour", root * (y[[low]] - y[[high]]), root * (dy[:, low] - dy[:, high])[None]

    def _telecentricity(self, state: State, rays: _FieldBeam) -> _Rows:
        rows, _, _ = self._chief(state, rays)
        k, d, dd = rows[self.given.reference], state.beam.directions, state.beam.directions_by
        root = math.degrees(1.0) * math.sqrt(rays.weights.sum())
        slope = d[1, k] / d[2, k]
        return "telecentricity", root * np.array([slope]), root * ((dd[1][:, k] - slope * dd[2][:, k]) / d[2, k])[None]


# The search: descents in stages that a file remembers, hops between minima, other glasses.

_STAGE = 30  # evaluations between two states on disk
ROUNDS = 400
MORE = 8  # stages after the evaluations are used up, in which bounds come to hold
_FTOL = 1e-6
OPENINGS = (0.2, 0.4, 0.6, 0.8)  # of pupil and field, for starts that lose rays
_OPENING_EVALUATIONS = 60

Progress = Callable[[str], object]


@dataclass(frozen=True)
class Optimised:
    """What a search found.

    Attributes
    ----------
    lens : Lens
        With the stop of the f-number, and rims that are at least as wide as the rays of the merit.
    film_mm : float
        From its last vertex.
    before, after : mapping
        Each term of the merit in its unit, and `merit`.
    evaluations : int
        Of the merit, those taken from a file of states included.
    lost : list of str
        Why rays are lost at the end.
    start : Lens
        The lens that it was, set likewise.
    start_film_mm : float
        Its best film distance by the same merit.
    no_better : str
        Why the lens is no better than its start by the merit; empty where it is.
    """

    lens: Lens
    film_mm: float
    before: dict[str, float]
    after: dict[str, float]
    evaluations: int
    lost: list[str]
    start: Lens
    start_film_mm: float
    problem: Problem = field(repr=False)
    no_better: str = ""


class _Journal:
    """Stages of the search in their order; a run that begins anew takes those that a file has."""

    def __init__(self, given: Problem, path: Path | None) -> None:
        self.path, self.digest, self.stages, self.next = path, given.digest, [], 0
        if path is not None and path.exists():
            try:
                data = json.loads(read_whole(path, 16 * MAX_BYTES))
                known, self.stages = data["problem"], list(data["stages"])
            except (ValueError, KeyError, TypeError):
                raise StateError(f"{path}: is no state of a lens search; delete it or name another") from None
            if known != self.digest:
                raise StateError(f"{path}: is the state of another problem, lens or version; delete it or name another")

    def stage(self, key: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Take the result of a stage from the file, or compute and write it."""
        number, self.next = self.next, self.next + 1
        if number < len(self.stages) and self.stages[number]["key"] == key:
            return dict(self.stages[number])
        del self.stages[number:]
        self.stages.append({"key": key, **compute()})
        if self.path is not None:
            with replacing(self.path) as temporary:
                temporary.write_text(json.dumps({"problem": self.digest, "stages": self.stages}))
        return dict(self.stages[-1])


def _scipy() -> Any:
    try:
        import scipy.optimize
    except ImportError:
        raise StateError(
            'lenses are optimised with scipy, which is not installed: pip install "rptcam_cl[optimise]"'
        ) from None
    return scipy.optimize


class _Search:
    """One run of the search."""

    def __init__(self, given: Problem, journal: _Journal, progress: Progress) -> None:
        self.given, self.journal, self.progress = given, journal, progress
        self.library, self.evaluations = _scipy(), 0

    def local(self, merit: MeritFunction, x: Array, label: str, most: int | None = None) -> tuple[Array, float]:
        """Return the minimum by damped least squares near x with all bounds held, and its merit."""
        merit.set_hold(merit.values_of(x)["merit"])
        spent, last, more = 0, math.inf, MORE
        for _ in range(ROUNDS):
            shifts = b"" if merit.shifts is None else merit.shifts.tobytes()
            key = hashlib.sha256(x.tobytes() + shifts + repr(merit.weight).encode() + label.encode()).hexdigest()
            stage = self.journal.stage(key, lambda start=x: self._stage(merit, start))  # type: ignore[misc]
            x, count = np.array(stage["x"]), int(stage["evaluations"])
            spent, self.evaluations = spent + count, self.evaluations + count
            value = merit.values_of(x)["merit"]
            self.progress(f"{label}: merit {value:.6g} after {self.evaluations} evaluations")
            ends = spent >= (most or self.given.evaluations)
            more -= ends
            if stage["converged"] or ends:
                if (merit.tighten(x) <= 1 and (ends or abs(last - value) <= 1e-3 * value)) or not more:
                    break
                last = value
        return x, value

    def descent(self, merit: MeritFunction, x: Array) -> Array:
        """Return the minimum near x; where rays are lost in it, the one that opening pupil and field in steps finds."""
        if merit.by_spots is not None:
            found, _ = self.local(merit.by_spots, x, "by spots")
            merit.check_zones(found)
            merit.set_hold(merit.values_of(found)["merit"])
            x = min(found, x, key=lambda v: self.score(merit, v))
        found, _ = self.local(merit, x, "descent")
        if not merit.lost_rays(found):
            return found
        for opening in OPENINGS:
            part = MeritFunction(self.given, {}, opening)
            x, _ = self.local(part, x, f"pupil and field opened to {opening:g}", _OPENING_EVALUATIONS)
        x, _ = self.local(merit, x, "fully open")
        return min(x, found, key=lambda v: self._comparable_merit(merit, v))

    def _stage(self, merit: MeritFunction, x: Array) -> dict[str, Any]:
        found = self.library.least_squares(
            lambda v: merit.evaluate(v, False)[0], x, jac=lambda v: merit.evaluate(v, True)[1], x_scale="jac",
            ftol=_FTOL, xtol=1e-12, gtol=1e-15, max_nfev=_STAGE,
        )  # fmt: skip
        return {"x": found.x.tolist(), "evaluations": int(found.nfev), "converged": bool(found.status != 0)}

    def score(self, merit: MeritFunction, x: Array) -> float:
        """Return the merit with its penalties, by which minima are compared."""
        values, _ = merit.evaluate(x, False)
        return float(np.sqrt(values @ values))

    def hops(self, merit: MeritFunction, x: Array) -> Array:
        """Return the best minimum of basin hopping."""
        hunt = self.given.hunt
        number = iter(range(hunt.count + 1))
        random = np.random.default_rng(hunt.seed)

        def step(v: Array) -> Array:
            return np.asarray(v + hunt.step * random.uniform(-1, 1, len(v)))

        def minimise(_fun: Any, start: Array, args: Any = (), **_options: Any) -> Any:
            found, _ = self.local(merit, np.asarray(start), f"hop {next(number)}")
            return self.library.OptimizeResult(x=found, fun=self._comparable_merit(merit, found), success=True, nfev=1)

        temperature = 0.1 * self._comparable_merit(merit, x)
        result = self.library.basinhopping(
            lambda v: self._comparable_merit(merit, v), x, niter=hunt.count, take_step=step, T=temperature,
            minimizer_kwargs={"method": minimise}, seed=np.random.default_rng(hunt.seed + 1),
        )  # fmt: skip
        return np.asarray(result.x)

    def _comparable_merit(self, merit: MeritFunction, x: Array) -> float:
        """Return a merit that does not depend on what came before: bounds weigh as at the start."""
        merit.set_hold(merit.values_of(merit.x0)["merit"])
        return self.score(merit, x)

    def evolution(self, merit: MeritFunction, x: Array) -> Array:
        """Return the best of differential evolution about x, `step` to each side."""
        hunt = self.given.hunt
        result = self.library.differential_evolution(
            lambda v: self._comparable_merit(merit, v), [(v - hunt.step, v + hunt.step) for v in x], maxiter=hunt.count,
            seed=np.random.default_rng(hunt.seed), polish=False, x0=x, popsize=5, tol=0,
        )  # fmt: skip
        self.evaluations += int(result.nfev)
        return self.local(merit, np.asarray(result.x), "after evolution")[0]

    def other_glasses(self, merit: MeritFunction, x: Array) -> tuple[MeritFunction, Array]:
        """Return the best after each glass was exchanged for its neighbours in n_d and V_d, until none is better."""
        glasses = {change.surface: merit.start.surfaces[change.surface].glass for change in self.given.glasses}
        improved = bool(glasses)
        while improved:
            improved = False
            for change in self.given.glasses:
                for medium in neighbours(glasses[change.surface], change, self.given.wavelengths_nm):
                    tried = MeritFunction(self.given, {**glasses, change.surface: medium}, judges=merit.judges)
                    found, _ = self.local(tried, x, f"{medium.name} behind surface {change.surface}")
                    if tried.values_of(found)["merit"] < 0.999 * merit.values_of(x)["merit"] and _holds(tried, found):
                        merit, x, improved = tried, found, True
                        glasses[change.surface] = medium
        return merit, x


def _holds(merit: MeritFunction, x: Array) -> bool:
    return merit.worst_bound(x)[1] <= 0 and not merit.lost_rays(x)


def neighbours(glass: Medium, change: GlassChange, wavelengths_nm: Sequence[float]) -> list[Medium]:
    """Return the catalogue glasses nearest to one in n_d (0.02 counts as much as 2 of V_d), itself not among them."""
    nd, vd = float(glass.index(LINE_D_NM)), abbe_number(glass)
    rows = []
    for maker in change.makers:
        for one in glasses_of(maker).values():
            if one.nd is not None and one.vd is not None:
                away = (
                    ((one.nd - nd) / 0.02) ** 2 + ((one.vd - vd) / 2.0) ** 2 if math.isfinite(vd) else abs(one.nd - nd)
                )
                rows.append((away, f"{one.name}_{maker.upper()}"))
    found: list[Medium] = []
    for _, name in sorted(rows):
        medium = find_glass(name)
        limits = None if medium is None else known_range(medium)
        covers = limits is None or (limits[0] <= min(wavelengths_nm) and max(wavelengths_nm) <= limits[1])
        if medium is not None and covers and medium != glass and medium not in found:
            found.append(medium)
        if len(found) == change.tries:
            break
    return found


def optimise(
    source: str | Path | Mapping[str, Any] | Problem,
    *,
    state: str | Path | None = None,
    on_progress: Progress | None = None,
    judge: Judge | Judges | None = None,
) -> Optimised:
    """Search for the best lens of a problem.

    Parameters
    ----------
    source
        A YAML file, a mapping with its keys, or what `read_problem` made of one.
    state
        A file of states: written as the search goes on, and taken up where it is there, with the same result.
    on_progress
        Gets a line after each stage.
    judge
        Returns the spot of copies of a lens, where the merit has `as_built`: `spot_of_copies` of
        `rptcam_cl.rendering.tolerance_run`. Of several terms a mapping: ``picture`` is judged by `blur_of_zones` of
        `rptcam_cl.rendering.account`.

    Raises
    ------
    InputError
        For a problem that cannot be read, and bounds that no values of the variables hold.
    """
    given = source if isinstance(source, Problem) else read_problem(source)
    judges = {} if judge is None else judge if isinstance(judge, Mapping) else {"as_built": judge}
    for term in given.terms:
        if term.name in STEPS and term.name not in judges:
            raise InputError(f"{given.label}: merit.{term.name} needs a judge (see optimise)")
    search = _Search(given, _Journal(given, None if state is None else Path(state)), on_progress or (lambda _: None))
    merit = MeritFunction(given, {}, judges=judges)
    start, x = merit, merit.x0
    _check_bounds(merit)
    if len(x):
        x = search.descent(merit, x)
    if given.hunt.kind == "hops":
        x = search.hops(merit, x)
    elif given.hunt.kind == "evolution":
        x = search.evolution(merit, x)
    merit, x = search.other_glasses(merit, x)
    if merit is start and _holds(start, start.x0):
        x = min(x, start.x0, key=lambda v: merit.values_of(v)["merit"] if _holds(merit, v) else math.inf)
    words, over = merit.worst_bound(x)
    if over > 0:
        raise InputError(f"{given.label}: bounds.{words}, and no values of the variables do it: {over:.4g} mm are left"
                         .replace("bounds.focal_length_mm", "focal_length_mm"))  # fmt: skip
    before, after = start.values_of(start.x0), merit.values_of(x)
    lens, film = merit.finished(merit.state(x, False))
    lens = replace(lens, name=f"{given.lens.name}, optimised", source=_provenance(given, before, after))
    first, first_film = start.finished(start.state(start.x0, False))
    no_better = ""
    if after["merit"] >= before["merit"]:
        words, over = start.worst_bound(start.x0)
        no_better = f"the start does not hold {words} ({over:.4g} mm)" if over > 0 else "the search found none"
    lost = merit.lost_rays(x)
    return Optimised(lens, film, before, after, search.evaluations, lost, first, first_film, given, no_better)


def _check_bounds(merit: MeritFunction) -> None:
    """Refuse a bound that is overstepped where nothing may change it."""
    for words, over, by, allowed in merit.overstepped(merit.state(merit.x0, True)):
        if over > allowed and not np.any(by):
            prefix = "" if words.startswith("focal_length_mm") else "bounds."
            raise InputError(
                f"{merit.given.label}: {prefix}{words}, and no variable changes it ({over:.4g} mm are left)"
            )


def _provenance(given: Problem, before: Mapping[str, float], after: Mapping[str, float]) -> str:
    merits = f"merit {before['merit']:.4g} to {after['merit']:.4g}"
    words = f"optimised by rptcam {__version__} ({Path(given.label).name}: {merits})"
    return f"{given.lens.source}; {words}" if given.lens.source else words
