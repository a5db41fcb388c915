"""The realistic camera: every ray is traced through every surface of a lens."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import PupilKind
from rptcam_cl.core.remember import checkpoint, remember
from rptcam_cl.optics.film_probe import FilmFrame, FilmProbe, Wavelengths, narrowing_probes, pupil_boxes
from rptcam_cl.optics.irradiance import axial_irradiance, disk_irradiance, on_axis_irradiance
from rptcam_cl.optics.lens import Lens, thick_lens_of, zoom_range_mm
from rptcam_cl.optics.pupils import PupilShapes, StoppedPupils, shared_shapes, stopped_pupils
from rptcam_cl.optics.ray_trace import IDEAL, LensTransmission, axial_transmittance, is_tinted
from rptcam_cl.rendering.cameras import lens_records, model, ray_map
from rptcam_cl.rendering.cameras import pupil as pupil_grid
from rptcam_cl.rendering.cameras import setting as settings
from rptcam_cl.rendering.cameras.pupil import PupilGrid, PupilSampling, by_content, on_disk, pupil_sampling
from rptcam_cl.rendering.cameras.setting import (
    CameraMetadata,
    LensSetting,
    Method,
    focused,
    half_film_mm,
    movements_metadata,
)
from rptcam_cl.scene.camera import LensCamera
from rptcam_cl.scene.film import LensColour
from rptcam_cl.scene.scene import Scene

# Tables of pupils that states of a lens near each other share: for pictures that each have another focus, f-number,
# focal length or place of the film across the axis.
#
# States lie in cells of stops, of focus and of zoom. The table of a cell is that of its widest stop, and holds the
# pupils of its nearest, middle and farthest focus, of a zoom lens at its shortest and longest focal length; so it
# holds those in between. The cell follows from the state alone, whatever came before it. Rays that the true pupil
# blocks change noise and nothing else.
#
# Cells that differ by the stop alone have their tables from one bundle of rays, traced with the stop wide open, where
# its chief rays come through. In other cells each table is traced.

# Pupil sampling of a few windows of the film, for looks through a lens in many states: boxes where needed.

Window = tuple[float, float, float, float]
"""Part of the film: x from, x to, y from, y to [mm], in the frame of the lens."""


REMEMBERED = 256  # cells whose tables are kept, of 30 to 150 kB each; states of a lens whose numbers are
_NEAR_FILM, _NEAR_HALF = 0.01, 0.02  # cells of film distances and of sizes of films, in natural logarithms
_NEAR_SPREAD = 0.01  # share of its size that a box is widened by, for the other films of its cell


def _pupil_near_windows(
    lens: Lens, film_distance_mm: float, half_film_mm: tuple[float, float], wavelength_nm: float,
    windows: Sequence[Window], frame: FilmFrame,
) -> PupilSampling:  # fmt: skip
    """Return boxes round the pupils seen from some windows at least, which films near each other have in common."""
    film = math.exp(_NEAR_FILM * round(math.log(film_distance_mm) / _NEAR_FILM))
    across, down = (math.exp(_NEAR_HALF * math.ceil(math.log(side) / _NEAR_HALF)) for side in half_film_mm)
    cell = np.repeat(2 * np.array([across, down]) / FINE, 2)
    ends = np.array(windows) / cell
    whole = np.where([True, False] * 2, np.floor(ends), np.ceil(ends)) * cell
    return _pupil_in_windows(lens, film, (across, down), wavelength_nm, tuple(map(tuple, whole.tolist())), frame)


@remember(most=REMEMBERED, by=by_content)
def _pupil_in_windows(
    lens: Lens, film_distance_mm: float, half_film_mm: tuple[float, float], wavelength_nm: float,
    windows: tuple[Window, ...], frame: FilmFrame,
) -> PupilSampling:  # fmt: skip
    """Return boxes round the pupils seen from the cells of the film that windows touch; from elsewhere it is dark.

    Of a film that is moved, `half_film_mm` are half the sides of what it takes about the axis.
    """
    lens = pupil_grid.without_shape(lens)
    half, size = np.array(half_film_mm), 2 * np.array(half_film_mm) / pupil_grid.CELLS
    tiles = np.concatenate([_tiles(np.clip(np.array(window).reshape(2, 2).T, -half, half), size) for window in windows])
    corners, at = np.unique(_corners_of(tiles), axis=0, return_inverse=True)
    probes = narrowing_probes(lens, film_distance_mm, wavelength_nm, frame)
    boxes, lit = pupil_boxes(probes, corners, pupil_grid.PROBES)
    if not lit.any():
        raise InputError(f"{lens.name}: no light reaches the zones {film_distance_mm:g} mm behind the lens")
    low, high = np.full((FINE, FINE, 2), np.inf), np.full((FINE, FINE, 2), -np.inf)
    size = 2 * half / FINE
    for tile, around in zip(tiles, at.reshape(-1, 4), strict=True):
        if lit[around].any():
            (x0, y0), (x1, y1) = np.clip(np.floor((tile + half) / size).astype(int), 0, FINE - 1)
            held = slice(y0, y1 + 1), slice(x0, x1 + 1)
            corner, sides = np.split(_between(tile, boxes[around], lit[around], held, size, half), 2, axis=-1)
            low[held], high[held] = np.minimum(low[held], corner), np.maximum(high[held], corner + sides)
    more = _NEAR_SPREAD * (high - low)
    table = np.where(low[..., :1] < np.inf, np.concatenate([low - more, high - low + 2 * more], axis=2), 0.0)
    parameters = PupilGrid(1 / size[0], 1 / size[1], FINE, FINE)
    return PupilSampling("windows", PupilKind.BOXES, parameters, table.astype(np.float32).ravel())


FINE = (
    64  # cells of the film across and down: close behind a lens a small pupil moves by more than itself in larger ones
)
BENT = 0.02  # of a tile's pupils: by how much they may lie beside those between its corners


def _between(
    tile: NDArray[np.float64],
    boxes: NDArray[np.float64],
    lit: NDArray[np.bool_],
    held: tuple[slice, slice],
    size: NDArray[np.float64],
    half: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the corner and size (rows, columns, 4) of boxes that hold the pupils of cells, from those at the corners
    of a tile."""
    whole = _around(boxes, lit)
    rows, columns = (np.arange(part.start, part.stop + 1) for part in held)
    if not lit.all():
        return np.broadcast_to(whole, (len(rows) - 1, len(columns) - 1, 4))
    extent = np.maximum(tile[1] - tile[0], 1e-300)
    u, v = (np.clip((ends * size[k] - half[k] - tile[0, k]) / extent[k], 0, 1)
            for k, ends in ((0, columns), (1, rows)))  # fmt: skip
    across = [boxes[k] + u[:, None] * (boxes[k + 1] - boxes[k]) for k in (0, 2)]
    at = across[0] + v[:, None, None] * (across[1] - across[0])
    at = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]])
    low, high = at[..., ::2].min(axis=0), at[..., 1::2].max(axis=0)
    spread = pupil_grid.SPREAD * (high - low) + BENT * (boxes[:, ::2].max(axis=0) - boxes[:, ::2].min(axis=0))
    return np.concatenate([low - spread, high - low + 2 * spread], axis=-1)


TILE = 1.8  # cells that a part of a window spans at most, whose corners tell of all of it


def _tiles(window: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cut a window, its lower and its upper corner, into parts (n, 2, 2) of that kind."""
    counts = np.maximum(np.ceil((window[1] - window[0]) / (TILE * size)).astype(int), 1)
    x, y = (np.linspace(low, high, count + 1) for (low, high), count in zip(window.T.tolist(), counts, strict=True))
    return np.array([[[x[i], y[j]], [x[i + 1], y[j + 1]]] for i in range(counts[0]) for j in range(counts[1])])


def _corners_of(tiles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (4 n, 2) of tiles."""
    x, y = tiles[..., 0], tiles[..., 1]
    return np.stack([x[:, [0, 1, 0, 1]], y[:, [0, 0, 1, 1]]], axis=-1).reshape(-1, 2)


def _around(boxes: NDArray[np.float64], lit: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the corner and size of a box that holds the pupils of the corners of a cell, and a little more."""
    if not lit.any():
        return np.zeros(4)
    low, high = boxes[lit][:, ::2].min(axis=0), boxes[lit][:, 1::2].max(axis=0)
    spread = (pupil_grid.SPREAD if lit.all() else pupil_grid.EDGE_SPREAD) * (high - low)
    return np.concatenate([low - spread, high - low + 2 * spread])


def _paraxial_irradiance(
    lens: Lens, film_distance_mm: float, wavelength_nm: float, transmission: LensTransmission = IDEAL
) -> float:
    """Return the irradiance of the centre of the film for unit radiance by first-order optics."""
    passed = float(axial_transmittance(lens, wavelength_nm, transmission))
    pupil = lens.first_order(wavelength_nm).exit_pupil
    if not np.isfinite(pupil.distance_mm):
        return passed * float(np.pi / (4 * lens.first_order(wavelength_nm).f_number ** 2))
    tangent = pupil.diameter_mm / 2 / (film_distance_mm - pupil.distance_mm)
    return passed * float(np.pi * tangent**2 / (1 + tangent**2))


_CELLS_OF_A_STOP = 8
_FOCUS_CELL = 0.012  # by how much of the focal length the image of an object moves in a cell
_ZOOM_CELLS = 16  # while the focal length doubles
_FILM_CELLS = 4  # while the film doubles in size
_BEYOND_FILM = 1.02  # for states whose film is farther away
FAR_MM = 1e12  # stands for infinity
_FEW_REMEMBERED = 32  # cells of focus whose rays are kept, of 1 MB each


@dataclass(frozen=True)
class _Shared:
    """A table, last vertex to film [mm] in the state that its film points are of, and how far from the axis they go."""

    sampling: PupilSampling
    film_distance_mm: float
    radius_mm: float = math.inf

    def holds(self, radius_mm: float, film_distance_mm: float) -> bool:
        """Return whether it goes as far as a film at another distance."""
        return radius_mm * self.film_distance_mm / film_distance_mm <= self.radius_mm


def shared_sampling(scene: Scene, setting: LensSetting, wavelength_nm: Wavelengths) -> PupilSampling | None:
    """Return the sampling that a lens shares with its states nearby; None where it needs one of its own.

    So do lenses that are not round, have mirrors or are not as designed, a film that is turned, and a focus that is no
    distance.
    """
    camera, distance_mm, film_distance_mm = setting.camera, setting.focus_distance_mm, setting.film_distance_mm
    frame = settings.film_frame(camera)
    own = distance_mm is None or camera.focus.field is not None or setting.real != settings.DESIGN
    if own or not setting.lens.is_rotational or setting.lens.has_mirrors or not frame.is_flat:
        return None
    assert distance_mm is not None
    opened = [{"f_number": None, "stop_diameter_mm": None} | at for at in _zooms(scene, camera)]
    wide_open = [
        pupil_grid.without_shape(settings.design_to_focus(scene, camera.model_copy(update=keys))) for keys in opened
    ]
    lenses = _stop_down(wide_open, setting.lens)
    length_mm = abs(wide_open[0].first_order(camera.wavelength_nm).focal_length_mm)
    if not (math.isfinite(length_mm) and distance_mm > 0):
        return None
    # The film of a lens much shorter than its focal length moves by more of its distance.
    width = _FOCUS_CELL / 2 ** max(math.ceil(math.log2(length_mm / (2 * film_distance_mm))), 0)
    cell = math.floor(length_mm / distance_mm / width)
    middle, *ends = (min(length_mm / max(at * width, 1e-300), FAR_MM) for at in (cell + 0.5, cell, cell + 1))
    corner_mm = float(np.hypot(*frame.corners(half_film_mm(scene))[:, :2].T).max())
    radius_mm, method = _rounded_up(_BEYOND_FILM * corner_mm, _FILM_CELLS), camera.focus.method

    def cell_of(of: Sequence[Lens]) -> _Cell:
        states = (of[0], middle), *((lens, end) for lens in of[1:] or of for end in ends)
        return _Cell(states, method, radius_mm, camera.wavelength_nm, wavelength_nm)

    shared = None
    if method == "thick" and setting.lens.stop is not None:
        shared = _with_stop(cell_of(wide_open), max(lens.stop.semi_diameter for lens in lenses if lens.stop))
    if shared is None or not shared.holds(corner_mm, film_distance_mm):
        shared = _of_traced(cell_of(lenses))
    if shared is None:
        return None
    shared.sampling.table.flags.writeable = False
    return _move_pupil(shared, film_distance_mm)


def _zooms(scene: Scene, camera: LensCamera) -> list[dict[str, float]]:
    """Return the keys of the middle of a cell of zoom, and of its ends where the lens has any focal length."""
    if camera.focal_length_mm is None:
        return [{}]
    low, high = zoom_range_mm(scene.load_lens(), camera.wavelength_nm)
    cell = math.floor(_ZOOM_CELLS * math.log2(camera.focal_length_mm))
    lengths = (min(max(2.0 ** (at / _ZOOM_CELLS), low), high) for at in (cell + 0.5, cell, cell + 1))
    return [{"focal_length_mm": length} for length in lengths]


def _rounded_up(value: float, cells: int) -> float:
    """Return the next of the numbers of which so many lie between one and its double."""
    return float(2.0 ** (math.ceil(cells * math.log2(value) - 1e-9) / cells))


def _stop_down(wide_open: Sequence[Lens], state: Lens) -> list[Lens]:
    """Return lenses with their stop as wide as it is anywhere in the cell of a state."""
    if state.stop is None:
        return list(wide_open)
    widest_mm = _rounded_up(2 * state.stop.semi_diameter, 2 * _CELLS_OF_A_STOP)
    return [
        lens if lens.stop is None else lens.with_stop_diameter(min(widest_mm, 2 * lens.stop.semi_diameter))
        for lens in wide_open
    ]


def _move_pupil(shared: _Shared, film_distance_mm: float) -> PupilSampling:
    """Return the table for a film at another distance: film points in one direction have the same outlines."""
    parameters = shared.sampling.parameters
    assert isinstance(parameters, PupilGrid)
    scaled = parameters._replace(per_mm_across=parameters.per_mm_across * shared.film_distance_mm / film_distance_mm)
    return replace(shared.sampling, parameters=scaled)


@dataclass(frozen=True)
class _Cell:
    """A lens in its states in the middle and at the ends of a cell, each with its focus distance [mm], and the film.

    With its stop wide open it is what the cells of all stops have in common.
    """

    states: tuple[tuple[Lens, float], ...]
    method: Method
    radius_mm: float
    focused_nm: float
    wavelength_nm: Wavelengths

    def key(self) -> Hashable:
        """Return all that follows from it."""
        states = tuple((pupil_grid.content_of(lens), distance) for lens, distance in self.states)
        return states, self.method, self.radius_mm, self.focused_nm, self.wavelength_nm

    def focused(self) -> list[tuple[Lens, float]]:
        """Return the lens focused in each state, and last vertex to film [mm].

        Raises
        ------
        InputError
            Where an end of the cell is out of reach.
        """
        return [focused(lens, at, "film", self.method, self.focused_nm) for lens, at in self.states]


@remember(most=REMEMBERED, by=lambda cell, semi_diameter_mm: (cell.key(), semi_diameter_mm))
def _with_stop(cell: _Cell, semi_diameter_mm: float) -> _Shared | None:
    """Return the table of a cell for a stop; None where it has to be traced."""
    arrays, facts = _rays(cell)
    if not arrays:
        return None
    rays = (arrays[key].astype(np.float64) for key in ("centres", "reach", "heights"))
    return _of_pupils(StoppedPupils(facts["radius_mm"], *rays), facts["film_distance_mm"], semi_diameter_mm)


def _of_pupils(pupils: StoppedPupils, film_distance_mm: float, semi_diameter_mm: float) -> _Shared | None:
    shapes = pupils.shapes(semi_diameter_mm)
    return None if shapes is None else _Shared(_of_shapes(shapes), film_distance_mm, pupils.radius_mm)


def _of_shapes(shapes: PupilShapes) -> PupilSampling:
    return replace(pupil_grid.tight_sampling(shapes), tier="shared")


@remember(most=_FEW_REMEMBERED, by=lambda cell: cell.key(), disk=on_disk(pack=tuple, unpack=lambda *packed: packed))
def _rays(cell: _Cell) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the rays that tables of all stops follow from, and last vertex to film [mm], as they are kept.

    There are none where they do not say what narrower stops let through.
    """
    nm, widest_mm = cell.wavelength_nm, max(lens.stop.semi_diameter for lens, _ in cell.states if lens.stop)
    try:
        states = cell.focused()
        pupils = stopped_pupils(states, cell.radius_mm, nm if isinstance(nm, tuple) else (nm,))
    except InputError:  # an end of the cell is out of reach, or dark
        return {}, {}
    film_distance_mm = states[0][1]
    widest = None if pupils is None else _of_pupils(pupils, film_distance_mm, widest_mm)
    if pupils is None or widest is None or _loses_light(widest, states, pupils.radius_mm / _BEYOND_FILM, nm):
        return {}, {}
    arrays = {"centres": pupils.centres, "reach": pupils.reach, "heights": pupils.heights}
    facts = {"radius_mm": pupils.radius_mm, "film_distance_mm": film_distance_mm}
    return {key: values.astype(np.float32) for key, values in arrays.items()}, facts


def _pack(shared: _Shared | None) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    if shared is None:
        return {}, {}
    facts = {"sampling": shared.sampling.facts_but_table(), "film_distance_mm": shared.film_distance_mm}
    return {"table": shared.sampling.table}, facts


def _unpack(arrays: dict[str, NDArray[Any]], facts: dict[str, Any]) -> _Shared | None:
    if not arrays:
        return None
    return _Shared(PupilSampling.of_facts(facts["sampling"], arrays["table"]), facts["film_distance_mm"])


@remember(most=REMEMBERED, by=lambda cell: cell.key(), disk=on_disk(pack=_pack, unpack=_unpack))
def _of_traced(cell: _Cell) -> _Shared | None:
    """Return the table of a cell; None where it would lose light or cannot be focused."""
    try:
        states = cell.focused()
        shapes = shared_shapes(states, cell.radius_mm, cell.wavelength_nm)
    except InputError:  # an end of the cell is out of reach, or dark
        return None
    shared = _Shared(_of_shapes(shapes), states[0][1])
    return None if _loses_light(shared, states, cell.radius_mm / _BEYOND_FILM, cell.wavelength_nm) else shared


def _loses_light(
    shared: _Shared, states: Sequence[tuple[Lens, float]], radius_mm: float, wavelength_nm: Wavelengths
) -> bool:
    """Return whether rays of some state pass that lie well outside of the table."""
    half_film_mm = radius_mm / math.sqrt(2.0), radius_mm / math.sqrt(2.0)
    pupils = ((_move_pupil(shared, film), FilmProbe(state, film, wavelength_nm)) for state, film in states)
    return any(pupil_grid.loses_light(pupil, probe, half_film_mm) for pupil, probe in pupils)


_SHOWS_PX = 0.5  # colour error that a picture shows, of all but a tenth of the light [pixels]
_SHOWS_TINT = 0.01  # share of the light by which colours differ that it shows
_TINTS_NM = (450.0, 545.0, 610.0)  # about what blue, green and red see
_AXIAL_SAMPLES = 9  # wavelengths at which the irradiance on the axis is found
_FEW_SAMPLES, _FEWEST_SAMPLES = 5, 3  # with windows, and of a glance
_LOSS_SAMPLES = 101  # and those at which losses are


def realistic_model(
    scene: Scene,
    setting: LensSetting,
    windows: Sequence[Window] = (),
    *,
    lens_colour: LensColour = "off",
    coarse: bool = False,
) -> model.CameraModel:
    """Return the camera of a scene with its lens set in some other way than the scene says.

    Parameters
    ----------
    windows
        Parts of the film that will be rendered, where not the whole is: then only the pupils seen from there are found,
        in a tenth of the time, and `exposure: relative` goes by first-order optics.
    """
    camera, losses = scene.camera.traced_camera, setting.transmission
    assert camera is not None
    settings.check_film(setting.lens, setting.film_distance_mm, scene)
    lens, film_distance_mm = lens_records.shaped(scene, setting).lens, setting.film_distance_mm
    dispersive, colour = _colour(scene, setting, lens_colour, coarse)
    low, high = lens_records.usable_nm(lens, losses if dispersive else IDEAL)
    sampled_nm = (camera.wavelength_nm, low, high) if dispersive else (camera.wavelength_nm,)
    shares = camera.pupil == "shared" and not (windows or coarse)
    shared = shared_sampling(scene, setting, sampled_nm) if shares else None
    of_own = _irradiance_of_own(bool(windows), coarse, shared is not None)
    clear, on_axis = _irradiance(lens, film_distance_mm, camera.wavelength_nm, losses, of_own)
    # Coarse outlines are so wide that they hold the pupil of every wavelength.
    pupil = shared or _pupil(scene, setting, lens, sampled_nm[:1] if coarse else sampled_nm, windows, coarse)
    axial_colour = None
    if dispersive:
        of_colours = None if windows else _paraxial_irradiance if coarse else _irradiance_of_colours(pupil)
        axial_colour = _axial_colour(scene, setting, lens, (clear, on_axis), of_colours, (low, high))
    checkpoint()
    through = _rays_through(scene, setting, lens, (low, high) if dispersive else None)
    record = _record(scene, setting, lens, pupil, len(through.surfaces))
    entrance = None if windows else settings.entrance_pupil(scene, setting, drifts=not coarse)
    metadata: CameraMetadata = {
        "camera": "realistic", **through.metadata, **setting.metadata, "on_axis_irradiance": on_axis,
        **({"transmittance": on_axis / clear} if losses else {}), **pupil.metadata, **movements_metadata(camera),
        **colour, **_perspective(scene, setting),
    }  # fmt: skip
    if entrance is not None:
        metadata["entrance_pupil"] = entrance.described()
    return model.CameraModel(
        through.kernel, record,
        facts=through.facts | pupil.facts | settings.place_film(record, scene) | settings.place_fold(record, lens),
        tables=np.concatenate([pupil.table, through.table]), surfaces=through.surfaces, stop=through.stop,
        has_lens=True, metadata=metadata, view=_view(scene, setting), on_axis_irradiance=on_axis,
        passed=on_axis / clear, axial_weight=on_axis, usable_nm=(low, high),
        reach=model.lens_reach(lens, film_distance_mm, camera.wavelength_nm, half_film_mm(scene)),
        axial_colour=axial_colour, setting=setting, pupil=None if coarse else entrance,
    )  # fmt: skip


def _irradiance_of_own(windows: bool, coarse: bool, shared: bool) -> Callable[..., float]:
    """Return the function for the irradiance on the axis, of the camera's own wavelength."""
    if windows:
        return _paraxial_irradiance
    return partial(axis_irradiance, soon=_axial if coarse else disk_irradiance if shared else None)


def _irradiance_of_colours(pupil: PupilSampling) -> Callable[..., float]:
    """Return that of other wavelengths: sooner where a table is proven to hold the pupils of all."""
    return partial(axis_irradiance, soon=None if pupil.tier == "rear" or pupil.ring else disk_irradiance)


def _rays_through(
    scene: Scene, setting: LensSetting, lens: Lens, range_nm: tuple[float, float] | None
) -> ray_map.LensRays:
    """Choose how camera rays cross the lens, fitted or traced; of one colour where there is no range of wavelengths."""
    camera = scene.camera.traced_camera
    assert camera is not None
    if camera.rays == "fitted":
        return ray_map.fitted_rays(lens, setting, scene.film, range_nm, ray_map.allowed_px(camera.accuracy))
    return ray_map.traced_rays(lens, setting, camera.precision, dispersive=range_nm is not None)


def _perspective(scene: Scene, setting: LensSetting) -> CameraMetadata:
    """Find the intrinsics for the metadata; none where no thick lens stands for the lens."""
    try:
        thick = thick_lens_of(setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm)
    except InputError:
        return {}
    return {"intrinsics": model.thick_lens_intrinsics(scene, thick, "traced lens")}


def _irradiance(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: float,
    losses: LensTransmission,
    irradiance: Callable[..., float],
) -> tuple[float, float]:
    """Return the irradiance in the centre of the film under unit radiance, without losses in the lens and with them."""
    clear = irradiance(lens, film_distance_mm, wavelength_nm)
    on_axis = irradiance(lens, film_distance_mm, wavelength_nm, losses) if losses else clear
    if not on_axis > 0:
        raise InputError(
            f"camera.lens: {lens.name}: no ray from the centre of the film passes the lens"
            f" (film distance {film_distance_mm:g} mm)"
        )
    return clear, on_axis


def _pupil(
    scene: Scene,
    setting: LensSetting,
    lens: Lens,
    sampled_nm: tuple[float, ...],
    windows: Sequence[Window],
    coarse: bool,
) -> PupilSampling:
    """Return how rays aim at the pupil that all wavelengths see, from the whole film or from windows of it."""
    camera, half, film_distance_mm = scene.camera.traced_camera, half_film_mm(scene), setting.film_distance_mm
    assert camera is not None
    frame = settings.film_frame(camera)
    if windows:
        return _pupil_near_windows(lens, film_distance_mm, frame.bounds(half), camera.wavelength_nm, windows, frame)
    tier = "auto" if camera.pupil == "shared" else camera.pupil
    return pupil_sampling(lens, film_distance_mm, half, sampled_nm, tier, frame, coarse=coarse)


_axial = remember(most=REMEMBERED, by=by_content)(axial_irradiance)
_with_losses = remember(most=REMEMBERED, by=by_content)(on_axis_irradiance)
_without_losses = remember(most=REMEMBERED, by=by_content, disk=on_disk())(on_axis_irradiance)
_colour_error = remember(most=REMEMBERED, by=by_content)(lens_records.colour_error_px)


def axis_irradiance(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: float,
    losses: LensTransmission = IDEAL,
    soon: Callable[[Lens, float, float], float | None] | None = None,
) -> float:
    """Return the irradiance on the axis, which is remembered.

    Parameters
    ----------
    soon
        Gives it sooner where there are no losses, or None: `disk_irradiance` where nothing lies apart from the pupil,
        as the table shows that states share, and `_axial` for a glance, within 2e-5.
    """
    if soon and not losses and (irradiance := soon(lens, film_distance_mm, wavelength_nm)) is not None:
        return irradiance
    if losses:
        return _with_losses(lens, film_distance_mm, wavelength_nm, losses)
    return _without_losses(lens, film_distance_mm, wavelength_nm)


def _glanced_axis(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: float,
    losses: LensTransmission = IDEAL,
    near: Callable[[], float] | None = None,
) -> float:
    """Return the irradiance on the axis for colours in windows: of a round stop, with the losses of an axial ray.

    Over that of another wavelength, which ``near`` gives without losses, it is right within a thousandth.
    """
    soon = _axial if near is None else partial(axial_irradiance, near=near())
    clear = axis_irradiance(pupil_grid.without_shape(lens), film_distance_mm, wavelength_nm, soon=soon)
    return clear * float(axial_transmittance(lens, np.array([wavelength_nm]), losses)[0]) if losses else clear


def _record(scene: Scene, setting: LensSetting, lens: Lens, pupil: PupilSampling, surfaces: int) -> NDArray[np.void]:
    half_width, half_height = half_film_mm(scene)
    record = model.camera_record(
        scene.camera, scene.film, "realistic",
        film_half_width=half_width, film_half_height=half_height,
        film_distance=setting.film_distance_mm, gain=setting.gain,
        metres_per_mm=1e-3, first_vertex_z=-lens.film_z(setting.film_distance_mm) * 1e-3,
        surfaces=surfaces, first_polynomial=len(pupil.table),
    )  # fmt: skip
    aim = record["own"]["realistic"]["pupil"][pupil.member]
    for name, value in pupil.parameters._asdict().items():
        aim[name] = value
    record["wavelength"] = setting.camera.wavelength_nm
    return record


def _colour(scene: Scene, setting: LensSetting, wanted: LensColour, coarse: bool) -> tuple[bool, CameraMetadata]:
    """Return whether the lens refracts each wavelength separately, and what metadata say of that."""
    if wanted == "off" or not (lens_records.disperses(setting.lens) or is_tinted(setting.lens, setting.transmission)):
        return False, {}
    if wanted == "on" and coarse:
        return True, {}
    error_px, sampling_px = _colour_error(
        setting.lens, setting.film_distance_mm, setting.focus_distance_mm, scene.film, setting.camera.wavelength_nm,
        settings.film_frame(scene.camera), _SHOWS_PX,
    )  # fmt: skip
    tint = lens_tint(scene, setting)
    shows = error_px > _SHOWS_PX or tint > _SHOWS_TINT
    metadata: CameraMetadata = {
        "lens_colour_px": round(error_px, 4),
        "lens_colour_sampling_px": round(sampling_px, 4),
    }
    if tint:
        metadata["lens_tint"] = round(tint, 4)
    return wanted == "on" or shows, metadata


def shows_losses(scene: Scene) -> bool:
    """Return whether the exposure shows what a lens takes from the light; the others make up for it."""
    return scene.exposure.mode in ("irradiance", "physical")


def lens_tint(scene: Scene, setting: LensSetting) -> float:
    """Return how much more of one colour than of another the lens takes, where a picture shows it."""
    low, high = lens_records.usable_nm(setting.lens, setting.transmission)
    passed = axial_transmittance(setting.lens, np.clip(_TINTS_NM, low, high), setting.transmission)
    return float(np.ptp(passed) / passed.max()) if shows_losses(scene) else 0.0


def _axial_colour(
    scene: Scene,
    setting: LensSetting,
    lens: Lens,
    on_axis: tuple[float, float],
    irradiance: Callable[..., float] | None,
    range_nm: tuple[float, float],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return wavelengths and the irradiance of each on the axis, over that of the camera's wavelength.

    Losses vary faster with the wavelength than pupils do, but almost as they do on the axis itself. From fewer samples
    a polynomial leads to the rest.

    Parameters
    ----------
    on_axis
        The irradiance of the camera's wavelength, without losses and with them.
    irradiance
        Returns it at a wavelength; for windows None. First-order optics do for a glance: wide open, the lenses of the
        library differ by up to 2.3 % at 430 or 680 nm, most by a tenth of a percent.
    """
    camera, film_distance_mm = scene.camera.traced_camera, setting.film_distance_mm
    assert camera is not None
    losses, whole = (IDEAL, on_axis[0]) if shows_losses(scene) else (setting.transmission, on_axis[1])
    samples = _AXIAL_SAMPLES
    if irradiance is _paraxial_irradiance:
        samples, whole = _FEWEST_SAMPLES, irradiance(lens, film_distance_mm, camera.wavelength_nm, losses)
    if irradiance is None:
        own = partial(_glanced_axis, lens, film_distance_mm, camera.wavelength_nm)
        irradiance, samples, whole = partial(_glanced_axis, near=own), _FEW_SAMPLES, own(losses)
    few, wavelengths = np.linspace(*range_nm, _AXIAL_SAMPLES), np.linspace(*range_nm, _LOSS_SAMPLES)
    traced = np.linspace(*range_nm, samples)
    seen = np.array([irradiance(lens, film_distance_mm, nm, losses) for nm in traced.tolist()]) / whole
    if samples < _AXIAL_SAMPLES:
        seen = np.polynomial.Polynomial.fit(traced, seen, samples - 1)(few)
    if not losses:
        return few, seen
    slow = np.interp(wavelengths, few, seen / axial_transmittance(lens, few, losses))
    return wavelengths, slow * axial_transmittance(lens, wavelengths, losses)


def _view(scene: Scene, setting: LensSetting) -> model.CameraView:
    """The view of a lens for layers; a stop that is not round counts as its circle."""
    lens, wavelength_nm = setting.lens, setting.camera.wavelength_nm
    size_mm = [side * 1e3 for side in scene.film.size_m()]
    columns, rows = scene.film.resolution
    return model.entrance_pupil_view(
        lens.first_order(wavelength_nm),
        -lens.film_z(setting.film_distance_mm) * 1e-3,
        lambda: model.traced_blur(
            lens,
            setting.film_distance_mm,
            setting.focus_distance_mm,
            half_film_mm(scene),
            (columns / size_mm[0], rows / size_mm[1]),
            wavelength_nm,
            settings.film_frame(scene.camera),
        ),
    )
