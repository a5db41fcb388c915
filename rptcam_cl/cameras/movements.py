"""The film of a view camera: how a scene's movements place it, on the host and for ``kernels/camera/film_point.h``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import UNMOVED, FilmFrame, FilmProbe, Lens
from rptcam_cl.scene import NO_MOVEMENTS, Movements, Pose, Scene

Array = NDArray[np.float64]


def movements_of(camera: Pose) -> Movements:
    """Return the movements of a camera; none of one that has no film."""
    found = getattr(camera, "movements", NO_MOVEMENTS)
    assert isinstance(found, Movements)
    return found


def film_frame(camera: Pose) -> FilmFrame:
    """Return how the film of a camera stands behind its lens [mm]."""
    movements = movements_of(camera)
    if movements == NO_MOVEMENTS:
        return UNMOVED
    return FilmFrame((-movements.shift_mm, -movements.rise_mm), *movements.sides())


def half_film_mm(scene: Scene) -> tuple[float, float]:
    """Return half the sides of a scene's film [mm]."""
    width, height = scene.film.size_m()
    return width * 500.0, height * 500.0


def place_film(record: NDArray[np.void], scene: Scene, distance_mm: float | None = None) -> dict[str, int]:
    """Write where the film stands into a camera record, and return the facts that say whether it does so.

    Parameters
    ----------
    distance_mm
        Of the film of an ideal camera, whose lengths are then in its units; by default they are millimetres.

    Raises
    ------
    InputError
        When the film of an ideal camera reaches its lens.
    """
    frame = film_frame(scene.camera)
    if not frame.is_moved:
        return {}
    unit = 1.0 if distance_mm is None else distance_mm
    if distance_mm is not None and np.any(distance_mm + frame.corners(half_film_mm(scene))[:, 2] <= 0):
        raise reaches_lens(distance_mm)
    for name, vector, length in (
        ("film_centre", (*frame.centre, 0.0), 1.0),
        ("film_across", frame.across, half_film_mm(scene)[0]),
        ("film_up", frame.up, half_film_mm(scene)[1]),
        ("film_normal", frame.normal, unit),
    ):
        record[name][0, :3] = np.array(vector) * length / unit
    record["film_centre"][0, 3] = 1e3 / unit
    return {"FILM_MOVED": 1}


def check_film(lens: Lens, film_distance_mm: float, scene: Scene) -> None:
    """Refuse a film that reaches the lens.

    Raises
    ------
    InputError
        When a corner of the film stands in the last surface, or before it.
    """
    frame = film_frame(scene.camera)
    if not frame.is_flat:
        probe = FilmProbe(lens, film_distance_mm, scene.camera.wavelength_nm, frame)  # type: ignore[union-attr]
        if probe.reaches_lens(half_film_mm(scene)):
            raise reaches_lens(film_distance_mm)


def reaches_lens(distance_mm: float) -> InputError:
    """Return the error of a film that is turned into its lens."""
    return InputError(
        f"camera.movements: a corner of the film would stand in the lens ({distance_mm:.6g} mm before its centre;"
        " allowed: less tilt and swing, or a smaller film)"
    )


def movements_metadata(camera: Pose) -> dict[str, Any]:
    """Return what the picture's metadata should say: the movements, and which way the film faces."""
    movements = movements_of(camera)
    if movements == NO_MOVEMENTS:
        return {}
    frame = film_frame(camera)
    return {
        "movements": movements.model_dump()
        | {"film_centre_mm": [*frame.centre, 0.0], "film_normal": list(frame.normal)}
    }
