"""Lenses whose gaps vary: zoom positions as named configurations, and a group that moves to focus."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.first_order import focal_length_mm
from rptcam_cl.optics.focus import film_distance, object_distance
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.prescription import Configuration, FocusingGroup, FocusState

Array = NDArray[np.float64]

STEPS = 64
BEYOND = (-0.05, 1.1)  # of the way to the nearest published state that floating groups may go
NEARLY = 5e-3  # by which a film that is known allows nearer objects than published, where a file rounds
FEW = 8  # zoom lenses whose focal lengths are remembered
REMEMBERED = 64  # and states


def floated(lens: Lens, distance_mm: float, wavelength_nm: float = LINE_D_NM) -> Lens:
    """Return the lens with its floating groups set for an object plane, at a distance from the film [mm].

    The gaps go from their values in the table, for infinity, along straight lines through those of the published
    distances: so far that the object is sharp where the film stands. Where nobody says where that is, they go in
    proportion to 1 / distance, as far as a lens moves for an object. A lens without such groups stays.

    Raises
    ------
    InputError
        For an object nearer than the nearest published distance, which is named.
    """
    if not lens.floating:
        return lens
    _check_near(lens, distance_mm)
    if not np.isfinite(distance_mm):
        return replace(lens, floating=())
    if lens.focuses_by_group:
        film = film_distance(lens, np.inf, wavelength_nm=wavelength_nm)
        return replace(focused_by_group(lens, distance_mm, film, wavelength_nm)[0], floating=())
    nearest = min(state.distance_mm for state in lens.floating)
    return replace(_at_share(lens, nearest / distance_mm), floating=())


def _check_near(lens: Lens, distance_mm: float) -> None:
    """Refuse an object that is nearer than the nearest published distance."""
    nearest = min(state.distance_mm for state in lens.floating)
    if distance_mm < nearest * (1 - (NEARLY if lens.focuses_by_group else 1e-9)):
        raise InputError(
            f"{lens.name}: its floating groups focus down to {nearest:.6g} mm from the film "
            f"(requested {distance_mm:.6g} mm)"
        )


def brought_to_focus(lens: Lens, distance_mm: float, wavelength_nm: float = LINE_D_NM) -> tuple[Lens, float]:
    """Return the lens focused by first-order optics on an object plane, at a distance from the film, and the distance
    from its last vertex to the film [mm]: by its groups where the lens file has some, else as a whole."""
    if np.isfinite(distance_mm) and lens.focuses_by_group:
        film = film_distance(lens, np.inf, wavelength_nm=wavelength_nm)
        return focused_by_group(lens, distance_mm, film, wavelength_nm)
    lens = floated(lens, distance_mm, wavelength_nm)
    return lens, film_distance(lens, distance_mm, wavelength_nm=wavelength_nm)


@dataclass(frozen=True)
class _Rail:
    """How floating groups move: `values` (states, gaps and film shift) over `shares` of 1 / distance, 1 the nearest."""

    places: tuple[int, ...]
    shares: Array
    values: Array

    @property
    def leading(self) -> int:
        """The gap that changes most."""
        return int(np.argmax(np.abs(self.values[-1, :-1] - self.values[0, :-1])))

    @property
    def reach(self) -> float:
        """How much it changes [mm]; 1 where none does."""
        return float(self.values[-1, self.leading] - self.values[0, self.leading]) or 1.0

    def at(self, share: float) -> Array:
        """Return gaps and film shift [mm]; beyond the ends the straight lines go on."""
        k = int(np.clip(np.searchsorted(self.shares, share) - 1, 0, len(self.shares) - 2))
        part = (share - self.shares[k]) / (self.shares[k + 1] - self.shares[k])
        return np.asarray(self.values[k] + part * (self.values[k + 1] - self.values[k]))


def _rail(lens: Lens) -> _Rail:
    states = sorted(lens.floating, key=lambda state: -state.distance_mm)
    places = tuple(k for k, _ in states[0].gaps)
    rows = [[lens.surfaces[k].thickness for k in places] + [0.0]]
    rows += [[gap for _, gap in state.gaps] + [state.film_shift_mm or 0.0] for state in states]
    away = np.array([0.0, *(1 / state.distance_mm for state in states)])
    return _Rail(places, away / away[-1], np.array(rows))


def _at_share(lens: Lens, share: float) -> Lens:
    rail, surfaces = _rail(lens), list(lens.surfaces)
    for k, gap in zip(rail.places, rail.at(share), strict=False):  # the last value is the film's
        surfaces[k] = replace(surfaces[k], thickness=float(gap))
    return replace(lens, surfaces=tuple(surfaces))


def configured(lens: Lens, name: str) -> Lens:
    """Return a zoom lens in one of its named configurations."""
    for configuration in lens.configurations:
        if configuration.name == name:
            return _set(lens, configuration)
    names = ", ".join(configuration.name for configuration in lens.configurations)
    raise InputError(f"{lens.name}: no configuration {name!r}; it has {names or 'none'}")


def at_position(lens: Lens, zoom: str | None, focal_length_mm: float | None, wavelength_nm: float = LINE_D_NM) -> Lens:
    """Return a lens in a named configuration or at a focal length; as it is where neither is said."""
    if zoom is not None:
        lens = configured(lens, zoom)
    return lens if focal_length_mm is None else zoomed(lens, focal_length_mm, wavelength_nm)


def zoomed(lens: Lens, focal_length_mm: float, wavelength_nm: float = LINE_D_NM) -> Lens:
    """Return a zoom lens at a focal length, its gaps interpolated between neighbouring configurations.

    Raises
    ------
    InputError
        For a lens without configurations, or a focal length outside their range, which is named.
    """
    if len(lens.configurations) < 2:
        raise InputError(f"{lens.name}: is not a zoom lens (it has no configurations)")
    return _zoomed(_Zoom(lens), float(focal_length_mm), float(wavelength_nm))


def zoom_range_mm(lens: Lens, wavelength_nm: float = LINE_D_NM) -> tuple[float, float]:
    """Return the least and the greatest focal length of a zoom lens."""
    lengths = _zoom_table(_Zoom(lens), float(wavelength_nm))[1]
    return float(lengths.min()), float(lengths.max())


@dataclass(frozen=True)
class _Zoom:
    """A zoom lens that equals every other one of the same surfaces, settings and name."""

    lens: Lens

    def __hash__(self) -> int:
        return hash((self.lens.name, self.lens.surfaces, self.lens.configurations))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Zoom) and self.lens == other.lens


@lru_cache(maxsize=FEW)
def _zoom_table(zoom: _Zoom, wavelength_nm: float) -> tuple[Array, Array]:
    """Return states between the configurations, and the focal length of each [mm]."""
    steps = len(zoom.lens.configurations) - 1
    states = np.linspace(0.0, float(steps), 1 + STEPS * steps)
    return states, np.array([focal_length_mm(_between(zoom.lens, state), wavelength_nm) for state in states])


@lru_cache(maxsize=REMEMBERED)
def _zoomed(zoom: _Zoom, wanted_mm: float, wavelength_nm: float) -> Lens:
    lens, (states, lengths) = zoom.lens, _zoom_table(zoom, wavelength_nm)
    above = lengths >= wanted_mm
    change = np.flatnonzero(above[1:] != above[:-1])
    if not len(change):
        near = states[np.argmin(np.abs(lengths - wanted_mm))]
        if abs(lengths - wanted_mm).min() <= 1e-9 * wanted_mm:
            return _between(lens, float(near))
        raise InputError(
            f"{lens.name}: zooms from {lengths.min():.5g} to {lengths.max():.5g} mm (requested {wanted_mm:g} mm)"
        )
    low, high = float(states[change[0]]), float(states[change[0] + 1])
    while low < (middle := (low + high) / 2) < high:  # until no number lies between
        longer = focal_length_mm(_between(lens, middle), wavelength_nm) >= wanted_mm
        low, high = (middle, high) if longer == above[change[0]] else (low, middle)
    return _between(lens, middle)


def travel_mm(lens: Lens) -> tuple[float, float]:
    """Return the least and the greatest shift of what moves to focus [mm]: of the group towards the film; of floating
    groups the change of the gap that changes most, from a little beyond infinity to a little nearer than published."""
    if lens.floating:
        ends = [_rail(lens).reach * share for share in BEYOND]
        return min(ends), max(ends)
    return _group(lens).travel_mm


def moved(lens: Lens, shift_mm: float) -> Lens:
    """Return the lens with what moves to focus shifted, as `travel_mm` counts [mm]."""
    if lens.floating:
        return _at_share(lens, shift_mm / _rail(lens).reach)
    group = _group(lens)
    surfaces = list(lens.surfaces)
    if group.first > 0:
        before = surfaces[group.first - 1]
        surfaces[group.first - 1] = replace(before, thickness=before.thickness + shift_mm)
    if group.last < len(surfaces) - 1:
        after = surfaces[group.last]
        surfaces[group.last] = replace(after, thickness=after.thickness - shift_mm)
    return replace(lens, surfaces=tuple(surfaces))


def film_behind(lens: Lens, shift_mm: float, film_distance_mm: float) -> float:
    """Return the distance from the last vertex to the film when what moves to focus has shifted [mm]."""
    if lens.floating:
        rail = _rail(lens)
        return film_distance_mm + float(rail.at(shift_mm / rail.reach)[-1])
    return film_distance_mm - shift_mm if _group(lens).last == len(lens.surfaces) - 1 else film_distance_mm


def shift_of(lens: Lens, state: Lens) -> float:
    """Return how far what moves to focus in a lens has shifted in one of its states [mm]."""
    if lens.floating:
        rail = _rail(lens)
        lead, gaps = state.surfaces[rail.places[rail.leading]].thickness, rail.values[:, rail.leading]
        inside = [k for k in range(len(gaps) - 1) if min(gaps[k : k + 2]) <= lead <= max(gaps[k : k + 2])]
        k = inside[0] if inside else 0 if abs(lead - gaps[0]) < abs(lead - gaps[-1]) else len(gaps) - 2
        step = float(gaps[k + 1] - gaps[k]) or 1.0
        share = rail.shares[k] + (lead - gaps[k]) / step * (rail.shares[k + 1] - rail.shares[k])
        return float(share * rail.reach)
    group = _group(lens)
    if group.first > 0:
        return state.surfaces[group.first - 1].thickness - lens.surfaces[group.first - 1].thickness
    return lens.surfaces[group.last].thickness - state.surfaces[group.last].thickness


def focused_by_group(
    lens: Lens, object_distance_mm: float, film_distance_mm: float, wavelength_nm: float = LINE_D_NM
) -> tuple[Lens, float]:
    """Return the lens with its groups moved so that an object is sharp on the film, and the film distance.

    The film stays where it is, or moves with floating groups as their file says.

    Parameters
    ----------
    lens : Lens
    object_distance_mm : float
        From the film to the object plane.
    film_distance_mm : float
        From the last vertex to the film before the groups move. The distance after it differs only if the last surface
        moves.

    Raises
    ------
    InputError
        When the distance lies outside the reach of the group, which is named.
    """
    if lens.floating:
        _check_near(lens, object_distance_mm)
    low, high = travel_mm(lens)
    shifts = np.linspace(low, high, 2 * STEPS + 1)
    errors = np.array([_defocus(lens, float(s), object_distance_mm, film_distance_mm, wavelength_nm) for s in shifts])
    with np.errstate(invalid="ignore"):
        change = np.flatnonzero(np.sign(errors[:-1]) * np.sign(errors[1:]) <= 0)
    if not len(change):
        near, far = _reach(lens, film_distance_mm, wavelength_nm)
        raise InputError(
            f"{lens.name}: its group focuses from {near:.6g} to {far:.6g} mm from the film "
            f"(requested {object_distance_mm:.6g} mm)"
        )
    low, high = float(shifts[change[0]]), float(shifts[change[0] + 1])
    sign = np.sign(errors[change[0]])
    for _ in range(80):
        middle = (low + high) / 2
        same = np.sign(_defocus(lens, middle, object_distance_mm, film_distance_mm, wavelength_nm)) == sign
        low, high = (middle, high) if same else (low, middle)
    shift = (low + high) / 2
    return moved(lens, shift), film_behind(lens, shift, film_distance_mm)


def _defocus(lens: Lens, shift: float, distance: float, film: float, wavelength: float) -> float:
    """Return how far behind the film the image of an object plane lies [mm]; NaN when there is none."""
    state, back = moved(lens, shift), film_behind(lens, shift, film)
    front = distance - state.length - state.sense * back
    if not front > 0:
        return float("nan")
    try:
        return film_distance(state, front, "front", wavelength) - back
    except InputError:
        return float("nan")


def _reach(lens: Lens, film: float, wavelength: float) -> tuple[float, float]:
    """Return the nearest and farthest object plane that some shift makes sharp [mm from the film]."""
    found = []
    for shift in np.linspace(*travel_mm(lens), 2 * STEPS + 1):
        try:
            found.append(object_distance(moved(lens, float(shift)), film_behind(lens, float(shift), film), wavelength))
        except InputError:
            continue
    if not found:
        raise InputError(f"{lens.name}: no shift of its group makes anything sharp {film:g} mm behind the lens")
    return min(found), max(found)


def _group(lens: Lens) -> FocusingGroup:
    if lens.focusing is None:
        raise InputError(f"{lens.name}: has no focusing group; move the whole lens instead")
    return lens.focusing


def _between(lens: Lens, state: float) -> Lens:
    """Return the lens between two configurations, the whole numbers being the configurations themselves."""
    first = int(min(np.floor(state), len(lens.configurations) - 2))
    share = state - first
    one, two = lens.configurations[first], lens.configurations[first + 1]
    later = dict(two.gaps)
    gaps = tuple((k, (1 - share) * gap + share * later.get(k, gap)) for k, gap in one.gaps)
    stop = one.stop_diameter_mm
    if stop is not None and two.stop_diameter_mm is not None:
        stop = (1 - share) * stop + share * two.stop_diameter_mm
    near: tuple[FocusState, ...] = ()
    if len(one.floating) == len(two.floating):
        pairs = zip(one.floating, two.floating, strict=True)
        near = tuple(_between_states(first, second, share) for first, second in pairs)
    return _set(lens, Configuration(f"{one.name} to {two.name}", gaps, stop, near))


def _between_states(one: FocusState, two: FocusState, share: float) -> FocusState:
    """Return a state of focus between those of two zoom positions."""
    away = (1 - share) / one.distance_mm + share / two.distance_mm
    gaps = tuple(
        (k, (1 - share) * gap + share * other) for (k, gap), (_, other) in zip(one.gaps, two.gaps, strict=True)
    )
    if one.film_shift_mm is None or two.film_shift_mm is None:
        return FocusState(1 / away, gaps)
    return FocusState(1 / away, gaps, (1 - share) * one.film_shift_mm + share * two.film_shift_mm)


def _set(lens: Lens, configuration: Configuration) -> Lens:
    surfaces = list(lens.surfaces)
    for k, gap in configuration.gaps:
        surfaces[k] = replace(surfaces[k], thickness=gap)
    if configuration.stop_diameter_mm is not None and lens.stop_index is not None:
        stop = surfaces[lens.stop_index]
        surfaces[lens.stop_index] = replace(stop, semi_diameter=configuration.stop_diameter_mm / 2)
    return replace(lens, surfaces=tuple(surfaces), floating=configuration.floating)
