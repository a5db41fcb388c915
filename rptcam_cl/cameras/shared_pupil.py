"""Tables of pupils that states of a lens near each other share: for pictures that each have another focus or f-number.

States lie in cells of stops and of focus. The table of a cell is traced at its widest stop, for its nearest, middle and
farthest focus, and holds the pupils of all three; so it holds those in between. The cell follows from the state alone,
whatever came before it. Rays that the true pupil blocks change noise and nothing else.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rptcam_cl.cameras.as_made import DESIGN
from rptcam_cl.cameras.movements import film_frame, half_film_mm
from rptcam_cl.cameras.pupil import KEPT, ByContent, tight_sampling, without_shape
from rptcam_cl.cameras.pupil_check import loses_light
from rptcam_cl.cameras.pupil_sampling import PupilGrid, PupilSampling
from rptcam_cl.cameras.setting import LensSetting, Method, design_to_focus, focused
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.kept import keep_arrays, kept_arrays
from rptcam_cl.optics import FilmProbe, Lens, Wavelengths, shared_shapes
from rptcam_cl.scene import Scene

CELLS_OF_A_STOP = 8
FOCUS_CELL = 0.012  # by how much of the focal length the image of an object moves in a cell
FILM_CELLS = 4  # while the film doubles in size
BEYOND_FILM = 1.02  # for states whose film is farther away
FAR_MM = 1e12  # stands for infinity
REMEMBERED = 256  # cells whose tables are kept, of 30 to 150 kB each


@dataclass(frozen=True)
class _Shared:
    """A table, and last vertex to film [mm] in the state that its film points are of."""

    sampling: PupilSampling
    back_mm: float


def shared_sampling(scene: Scene, setting: LensSetting, wavelength_nm: Wavelengths) -> PupilSampling | None:
    """Return the sampling that a lens shares with its states nearby; None where it needs one of its own.

    So do lenses that are not round, have mirrors or are not as designed, a film that is moved, and a focus that is no
    distance.
    """
    camera, distance_mm = setting.camera, setting.focus_distance_mm
    own = distance_mm is None or camera.focus.field is not None or setting.real != DESIGN
    if own or not setting.lens.is_rotational or setting.lens.has_mirrors or film_frame(camera).is_moved:
        return None
    assert distance_mm is not None
    wide_open = design_to_focus(scene, camera.model_copy(update={"f_number": None, "stop_diameter_mm": None}))
    lens = _stopped(without_shape(wide_open), setting.lens)
    length_mm = abs(lens.first_order(camera.wavelength_nm).focal_length_mm)
    if not (math.isfinite(length_mm) and distance_mm > 0):
        return None
    # The film of a lens much shorter than its focal length moves by more of its distance.
    width = FOCUS_CELL / 2 ** max(math.ceil(math.log2(length_mm / (2 * setting.film_distance_mm))), 0)
    cell = math.floor(length_mm / distance_mm / width)
    ends = tuple(min(length_mm / max(at * width, 1e-300), FAR_MM) for at in (cell + 0.5, cell, cell + 1))
    radius_mm = _rounded_up(BEYOND_FILM * float(np.hypot(*half_film_mm(scene))), FILM_CELLS)
    found = _remembered(ByContent(lens), ends, radius_mm, camera.focus.method, camera.wavelength_nm, wavelength_nm)
    return None if found is None else _moved(found, setting.film_distance_mm)


def _rounded_up(value: float, cells: int) -> float:
    """Return the next of the numbers of which so many lie between one and its double."""
    return float(2.0 ** (math.ceil(cells * math.log2(value) - 1e-9) / cells))


def _stopped(wide_open: Lens, state: Lens) -> Lens:
    """Return a lens with its stop as wide as it is anywhere in the cell of a state."""
    if wide_open.stop is None or state.stop is None:
        return wide_open
    widest_mm = _rounded_up(2 * state.stop.semi_diameter, 2 * CELLS_OF_A_STOP)
    return wide_open.with_stop_diameter(min(widest_mm, 2 * wide_open.stop.semi_diameter))


def _moved(shared: _Shared, back_mm: float) -> PupilSampling:
    """Return the table for a film at another distance: film points in one direction have the same outlines."""
    parameters = shared.sampling.parameters
    assert isinstance(parameters, PupilGrid)
    scaled = parameters._replace(per_mm_across=parameters.per_mm_across * shared.back_mm / back_mm)
    return replace(shared.sampling, parameters=scaled)


@lru_cache(maxsize=REMEMBERED)
def _remembered(
    content: ByContent,
    distances_mm: tuple[float, ...],
    radius_mm: float,
    method: Method,
    focused_nm: float,
    wavelength_nm: Wavelengths,
) -> _Shared | None:
    """Return the table of a cell, also from earlier runs; None where it would lose light or cannot be focused."""
    name = content.name_of("shared", distances_mm, radius_mm, method, focused_nm, wavelength_nm)
    kept = kept_arrays(KEPT, name)
    if kept is not None:
        facts = dict(kept[1])
        back_mm = facts.pop("back_mm")
        found = None if back_mm is None else _Shared(PupilSampling.of_facts(facts, kept[0]["table"]), back_mm)
    elif (found := _made(content.lens, distances_mm, radius_mm, method, focused_nm, wavelength_nm)) is None:
        keep_arrays(KEPT, name, {}, {"back_mm": None})
    else:
        facts = found.sampling.facts_but_table() | {"back_mm": found.back_mm}
        keep_arrays(KEPT, name, {"table": found.sampling.table}, facts)
    if found is not None:
        found.sampling.table.flags.writeable = False
    return found


def _made(
    lens: Lens,
    distances_mm: tuple[float, ...],
    radius_mm: float,
    method: Method,
    focused_nm: float,
    wavelength_nm: Wavelengths,
) -> _Shared | None:
    try:
        states = [focused(lens, distance, "film", method, focused_nm) for distance in distances_mm]
        shapes = shared_shapes(states, radius_mm, wavelength_nm)
    except InputError:  # an end of the cell is out of reach, or dark
        return None
    found = _Shared(replace(tight_sampling(shapes), tier="shared"), states[0][1])
    side_mm = radius_mm / BEYOND_FILM / math.sqrt(2.0)
    for state, back_mm in states:
        probe = FilmProbe(state, back_mm, wavelength_nm)
        if loses_light(_moved(found, back_mm), probe, (side_mm, side_mm)):
            return None
    return found


def forget_shared() -> None:
    """Make the next table of every cell be read or traced anew."""
    _remembered.cache_clear()
