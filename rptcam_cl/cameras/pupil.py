"""Pupil sampling of a lens camera: tables of where rays aim, as tiers that change the noise and nothing else."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.pupil_check import loses_light
from rptcam_cl.cameras.pupil_sampling import PupilCircle, PupilGrid, PupilLines, PupilSampling
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.kept import forget, identity_of_code, keep_arrays, kept_arrays, name_of
from rptcam_cl.core.records import PupilKind
from rptcam_cl.optics import (
    BULGE,
    COARSE_OUTLINES,
    PATCH_RADII,
    UNMOVED,
    FilmFrame,
    FilmProbe,
    Lens,
    PupilShapes,
    Wavelengths,
    cells,
    grid,
    narrowing_probes,
    pupil_boxes,
    pupil_shapes,
)

Array = NDArray[np.float64]
Tier = Literal["auto", "rear", "thick", "bounds", "tight"]
KEPT = "pupils"  # folder of the cache on disk
REMEMBERED = 64  # lens states whose tables are kept, of 30 to 150 kB each
NOWHERE = (np.inf, -np.inf)  # low and high corner of a box that holds nothing
CELLS = 16  # of the film across and down, for the boxes
SPREAD = 0.05  # share of its size that a box is widened by, for what lies between the corners of its cell
EDGE_SPREAD = 0.2  # the same where the pupil closes within the cell
PROBES = (18, 18)  # rays per box and film point
MOVED_GRID = 9  # points along each side of a film that is moved, seen from which the rear rim is held


def pupil_sampling(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: Wavelengths,
    tier: Tier,
    frame: FilmFrame = UNMOVED,
) -> PupilSampling:
    """Return the sampling of a tier.

    Parameters
    ----------
    half_film_mm
        Half the sides of the film.
    wavelength_nm
        With several, the sampling holds the rays of each.
    tier
        ``rear``: the whole rear element (CS348b 2015). ``thick``: the paraxial image of the stop (CS348b 2003), widened
        where it would lose light. ``bounds``: a box per film cell (pbrt). ``tight``: the outline of the true pupil.
        A table that proves to lose light, as with a pupil of several parts, gives way to ``rear``.
        ``auto``: tight, which needs the fewest samples on the four lenses it was measured on.
    frame
        How the film stands.
    """
    return _remembered(ByContent(without_shape(lens)), film_distance_mm, half_film_mm, wavelength_nm, tier, frame)


def coarse_pupil(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: Wavelengths,
    tier: Tier,
    frame: FilmFrame = UNMOVED,
) -> PupilSampling:
    """Return a sampling that is made in a fifth of the time of the tier ``tight``, and not checked; others as they are.

    It may leave out slivers of the pupil, less than a thousandth of the light of the lenses that it was tried on.
    """
    if tier not in ("auto", "tight"):
        return pupil_sampling(lens, film_distance_mm, half_film_mm, wavelength_nm, tier, frame)
    return _remembered_coarse(ByContent(without_shape(lens)), film_distance_mm, half_film_mm, wavelength_nm, frame)


def without_shape(lens: Lens) -> Lens:
    """Return the lens with a round stop: what holds it holds every shape in it."""
    return lens.with_stop_shape(None) if has_shape(lens) else lens


def has_shape(lens: Lens) -> bool:
    """Return whether the stop of a lens is not round."""
    return lens.stop is not None and lens.stop.stop_shape is not None


def content_of(lens: Lens) -> tuple[object, ...]:
    """Return all that rays through a lens follow from, and its name."""
    return lens.name, lens.surfaces, lens.stop_index, lens.object_medium


@dataclass(frozen=True)
class ByContent:
    """A lens that equals every other one of the same name and surfaces."""

    lens: Lens

    def name_of(self, *state: object) -> str:
        """Return the name of what follows from the lens in some state, by this code."""
        code = identity_of_code(("core", "colour", "optics", "cameras"))
        return name_of(code, pickle.dumps(content_of(self.lens)), *state)

    def __hash__(self) -> int:
        return hash(content_of(self.lens))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByContent) and content_of(self.lens) == content_of(other.lens)


@lru_cache(maxsize=REMEMBERED)
def _remembered(
    content: ByContent,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: Wavelengths,
    tier: Tier,
    frame: FilmFrame,
) -> PupilSampling:
    """Return the sampling, ready for the next picture with the lens in the same state, in this process or another."""
    state = (film_distance_mm, half_film_mm, wavelength_nm, tier, *((frame,) if frame.is_moved else ()))
    name = content.name_of(state)
    kept = kept_arrays(KEPT, name)
    if kept is None:
        sampling = _checked(content.lens, film_distance_mm, half_film_mm, wavelength_nm, tier, frame)
        keep_arrays(KEPT, name, {"table": sampling.table}, sampling.facts_but_table())
    else:
        sampling = PupilSampling.of_facts(kept[1], kept[0]["table"])
    sampling.table.flags.writeable = False
    return sampling


def _checked(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: Wavelengths,
    tier: Tier,
    frame: FilmFrame,
) -> PupilSampling:
    """Return the sampling of a tier, or of another one where its tables would lose light."""
    sampling = _made(lens, film_distance_mm, half_film_mm, wavelength_nm, tier, frame)
    probe = FilmProbe(lens, film_distance_mm, wavelength_nm, frame)
    if tier != "rear" and loses_light(sampling, probe, half_film_mm):
        rear = _rear(lens, film_distance_mm, half_film_mm, wavelength_nm, frame)
        sampling = replace(rear, instead_of=sampling.tier)
    return sampling


@lru_cache(maxsize=REMEMBERED)
def _remembered_coarse(
    content: ByContent,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: Wavelengths,
    frame: FilmFrame,
) -> PupilSampling:
    shapes = pupil_shapes(content.lens, film_distance_mm, half_film_mm, wavelength_nm, COARSE_OUTLINES, frame)
    sampling = tight_sampling(shapes)
    sampling.table.flags.writeable = False
    return sampling


def forget_tables() -> None:
    """Make the next sampling of every lens be computed anew."""
    forget(KEPT)
    _remembered.cache_clear()
    _remembered_coarse.cache_clear()


def _made(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: Wavelengths,
    tier: Tier,
    frame: FilmFrame,
) -> PupilSampling:
    if tier == "rear":
        return _rear(lens, film_distance_mm, half_film_mm, wavelength_nm, frame)
    if tier == "thick":
        return _thick(lens, film_distance_mm, half_film_mm, wavelength_nm, frame)
    if tier == "bounds":
        return _bounds(narrowing_probes(lens, film_distance_mm, wavelength_nm, frame), frame.bounds(half_film_mm))
    return tight_sampling(pupil_shapes(lens, film_distance_mm, half_film_mm, wavelength_nm, frame=frame))


def _rear(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: Wavelengths,
    frame: FilmFrame,
) -> PupilSampling:
    """The rear rim, projected from the film point on the plane of the last vertex.

    A rim at depth t behind that plane shows as a circle, scaled by Z / (Z + t) and shifted towards the film point.
    Where the surface bulges out of the cone to its rim, as a ball's does, the circle is widened to hold it.
    """
    probe = FilmProbe(lens, film_distance_mm, wavelength_nm)
    scale = film_distance_mm / (film_distance_mm - probe.patch[:, 2])
    shift = 1.0 - scale[-1]  # of the rim, the last ring of the patch
    film = np.linspace(0.0, float(np.hypot(*half_film_mm)), 9)[:, None]
    if frame.is_moved:
        return PupilSampling("rear", PupilKind.CIRCLE, _round_windows(probe, half_film_mm, frame, float(shift)))
    u = film * (1.0 - scale) + probe.patch[:, 0] * scale - shift * film
    reach = np.hypot(u, probe.patch[:, 1] * scale)
    radius = float(reach.max())
    if radius > reach[:, -(len(scale) // PATCH_RADII) :].max():
        radius *= 1.0 + BULGE
    return PupilSampling("rear", PupilKind.CIRCLE, PupilCircle(float(shift), radius))


def _round_windows(probe: FilmProbe, half_film_mm: tuple[float, float], frame: FilmFrame, shift: float) -> PupilCircle:
    """Return the circle that holds the rear rim as points all over a film that is moved see it."""
    moved = FilmProbe(probe.lens, probe.distance, probe.wavelength_nm, frame)
    film = frame.grid(half_film_mm, MOVED_GRID).reshape(-1, 2)
    boxes = moved.windows(film)
    middles, halves = (boxes[:, 1::2] + boxes[:, ::2]) / 2, (boxes[:, 1::2] - boxes[:, ::2]) / 2
    reach = np.hypot(*(np.abs(middles - shift * film) + halves).T)
    return PupilCircle(shift, float(reach.max()))


def _thick(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: Wavelengths,
    frame: FilmFrame,
) -> PupilSampling:
    """The paraxial exit pupil, seen on the plane of the last vertex; widened where it would lose light."""
    pupil = lens.first_order(wavelength_nm[0] if isinstance(wavelength_nm, tuple) else wavelength_nm).exit_pupil
    from_film = film_distance_mm - pupil.distance_mm
    if not (np.isfinite(from_film) and from_film > 0):
        raise InputError(
            f"camera.pupil: {lens.name}: its exit pupil lies behind the film, so it bounds no rays"
            " (allowed: rear, bounds, tight)"
        )
    shrink = film_distance_mm / from_film
    shift, radius = 1.0 - shrink, pupil.diameter_mm / 2 * shrink
    needed = _needed_radius(narrowing_probes(lens, film_distance_mm, wavelength_nm, frame), half_film_mm, shift)
    widened = max(1.0, needed / radius)
    return PupilSampling("thick", PupilKind.CIRCLE, PupilCircle(shift, radius * widened), widened=widened)


def _film_points(half_film_mm: tuple[float, float], count: int) -> NDArray[np.float64]:
    x, y = (np.linspace(-half, half, count) for half in half_film_mm)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _needed_radius(probes: list[FilmProbe], half_film_mm: tuple[float, float], shift: float) -> float:
    """Return the radius [mm] of a circle, shifted with the film point, that holds every probed ray that passes."""
    radial = probes[-1].lens.is_rotational and not probes[-1].frame.is_moved
    if radial:
        film = np.stack([np.linspace(0.0, float(np.hypot(*half_film_mm)), 17), np.zeros(17)], axis=1)
    else:
        film = probes[-1].frame.grid(half_film_mm, 11).reshape(-1, 2)
    windows, found = pupil_boxes(probes, film, PROBES, radial=radial)
    film, windows = film[found], windows[found]
    points = grid(windows, 2 * PROBES[0], 2 * PROBES[1])
    passes = probes[-1].passes(film[:, None], points)
    away = points - shift * film[:, None]
    cell = np.hypot(*cells(windows, 2 * PROBES[0], 2 * PROBES[1]).T)[:, None]
    return float(np.max((np.hypot(away[..., 0], away[..., 1]) + cell) * passes, initial=0.0))


def _bounds(probes: list[FilmProbe], half_film_mm: tuple[float, float]) -> PupilSampling:
    """A box per film cell that holds the pupils of its corners, and a little more."""
    low, high, found = _corner_boxes(probes, half_film_mm)
    corners = [(slice(i, i + CELLS), slice(j, j + CELLS)) for i in (0, 1) for j in (0, 1)]
    low = np.min([low[corner] for corner in corners], axis=0)
    high = np.max([high[corner] for corner in corners], axis=0)
    lit = np.isfinite(low[..., 0])
    closed = ~np.all([found[corner] for corner in corners], axis=0)
    spread = np.where(closed, EDGE_SPREAD, SPREAD)[..., None] * np.where(lit[..., None], high - low, 0.0)
    low, high = low - spread, high + spread
    if not lit.any():
        where = f"the film {probes[-1].distance:g} mm behind the lens"
        raise InputError(f"{probes[-1].lens.name}: no light reaches {where}")
    size = np.where(lit[..., None], high - low, 0.0)
    table = np.concatenate([np.where(lit[..., None], low, 0.0), size], axis=-1).astype(np.float32).ravel()
    per_mm = (CELLS / (2 * half_film_mm[0]), CELLS / (2 * half_film_mm[1]))
    return PupilSampling("bounds", PupilKind.BOXES, PupilGrid(*per_mm, CELLS, CELLS), table)


def _corner_boxes(probes: list[FilmProbe], half_film_mm: tuple[float, float]) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the low and high corners (n, n, 2) of boxes round the pupils at the corners of the film's cells, and where
    it is open. Of a rotationally symmetric lens a quarter of the film is traced."""
    count = CELLS + 1
    film = _film_points(half_film_mm, count).reshape(count, count, 2)
    symmetric = probes[-1].lens.is_rotational and probes[-1].frame.is_flat
    part = film[CELLS // 2 :, CELLS // 2 :] if symmetric else film
    boxes, found = pupil_boxes(probes, part.reshape(-1, 2), PROBES)
    lit = found.reshape(part.shape[:2])
    low, high = (np.where(lit[..., None], boxes[:, k::2].reshape(part.shape), none) for k, none in enumerate(NOWHERE))
    if symmetric:
        for axis in (0, 1):
            low, high = _unfolded(low, high, axis)
    return low, high, np.isfinite(low[..., 0])


def _unfolded(low: Array, high: Array, axis: int) -> tuple[Array, Array]:
    """Return boxes over half a film, of rows along y (axis 0) or columns along x, with their mirror images before."""
    other_low, other_high = (np.flip(np.delete(values, 0, axis), axis).copy() for values in (low, high))
    component = 1 - axis
    other_low[..., component], other_high[..., component] = -other_high[..., component], -other_low[..., component]
    return np.concatenate([other_low, low], axis=axis), np.concatenate([other_high, high], axis=axis)


def tight_sampling(shapes: PupilShapes) -> PupilSampling:
    """Return the sampling of outlines."""
    frames = np.concatenate([shapes.centres, shapes.axes], axis=-1)
    rows = np.stack([shapes.radii, np.roll(shapes.radii, -1, axis=-1)], axis=-1)
    ahead = np.concatenate([rows[:, 1:], rows[:, -1:]], axis=1)
    radii, last = np.concatenate([rows, ahead], axis=-1), np.zeros(4)
    lines, nodes = frames.shape[:2]
    if shapes.radial:
        parameters: PupilGrid | PupilLines = PupilGrid(1 / (shapes.reach[0] / (nodes - 1)), 0.0, nodes, 1)
        table = [frames.ravel(), last, radii.ravel(), last]
    else:  # the first line follows on the last
        parameters = PupilLines(lines / 4, nodes, lines)
        frames, radii = (np.concatenate([values, values[:1]]) for values in (frames, radii))
        table = [frames.ravel(), last, radii.ravel(), last, shapes.reach, shapes.reach[:1]]
    return PupilSampling("tight", PupilKind.OUTLINES, parameters, np.concatenate(table).astype(np.float32))
