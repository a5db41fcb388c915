"""The factor from the weights of a camera's rays to the values of the film, as the scene's exposure has it.

ISO 12232 (2019, saturation-based speed): a sensor of speed S saturates at a luminous exposure of H = 78 / S lx s, so
that ``physical`` values are E t S / 78 for an illuminance E [lx] of the film over a time t [s].
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.model import CameraModel
from rptcam_cl.colour import LUMENS_PER_WATT
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import StopMask, StopShape
from rptcam_cl.scene import FLOAT32_MAX, FLOAT32_MIN_NORMAL, Exposure, Scene

Array = NDArray[np.float64]


def opening_irradiance(shape: StopShape | StopMask | None, radius: float, distance: float) -> float:
    """Return the irradiance on the axis for radiance 1 through a flat opening: integral of cos^4 / distance^2.

    Parameters
    ----------
    shape
        Outline in units of the radius; None for a circle.
    radius, distance
        Of the opening, and from it to the film, in the same unit.
    """
    if shape is None:
        return math.pi * radius**2 / (radius**2 + distance**2)
    if isinstance(shape, StopMask):
        return _through_cells(shape.cells, radius / distance)
    return sum(_through_polygon(triangle * (radius / distance)) for triangle in shape.triangles)


def _through_cells(cells: NDArray[np.bool_], radius: float) -> float:
    """Return the irradiance at unit distance, each cell being small."""
    side = 2.0 * radius / len(cells)
    row, column = np.nonzero(cells)
    middle = (len(cells) - 1) / 2
    square = ((row - middle) ** 2 + (column - middle) ** 2) * side**2
    return float(np.sum(side**2 / (1.0 + square) ** 2))


def _through_polygon(corners: Array) -> float:
    """Return the irradiance at unit distance from a polygon (n, 2), by the angles of its edges (Lambert 1760)."""
    here = np.column_stack([corners, np.ones(len(corners))])
    there = np.roll(here, -1, axis=0)
    normal = np.cross(here, there)
    sine, cosine = np.linalg.norm(normal, axis=1), np.sum(here * there, axis=1)
    angle_over_sine = np.divide(np.arctan2(sine, cosine), sine, out=1.0 / cosine, where=sine > 0)
    return abs(float(np.sum(angle_over_sine * normal[:, 2]))) / 2


SATURATION_LX_S = 78.0  # of ISO 1


def values_per_irradiance(time_s: float, iso: float) -> float:
    """Return the film's value for 1 W/m² over an exposure time [s] at a sensitivity."""
    return LUMENS_PER_WATT * time_s * iso / SATURATION_LX_S


def ideal_irradiance(f_number: float) -> float:
    """Return the irradiance of the film's centre for radiance 1 behind an aplanatic lens focused at infinity."""
    return math.pi / (4.0 * f_number**2)


def working_f_number(on_axis_irradiance: float) -> float:
    """Return the f-number of the aplanatic lens that lights the film's centre as much: 1 / (2 sin u')."""
    return math.sqrt(math.pi / (4.0 * on_axis_irradiance))


def on_axis_irradiance(model: CameraModel, exposure: Exposure) -> float | None:
    """Return the irradiance of the film's centre for radiance 1; None where there is no film to speak of."""
    if model.on_axis_irradiance is not None:
        return model.on_axis_irradiance
    return None if exposure.f_number is None else ideal_irradiance(exposure.f_number)


def exposed(model: CameraModel, scene: Scene) -> CameraModel:
    """Return a camera whose record holds the factor of the exposure; ``auto`` counts as relative until it is metered.

    Raises
    ------
    InputError
        When the factor is beyond the range of float32.
    """
    exposure, on_axis = scene.exposure, on_axis_irradiance(model, scene.exposure)
    per_value = 1.0  # values of the film per value of mode relative
    metadata: dict[str, Any] = {}
    if exposure.mode in ("irradiance", "physical"):
        assert on_axis is not None
        scale = 1.0
        if exposure.mode == "physical":
            scale = values_per_irradiance(scene.shutter.time_s, exposure.iso)
            metadata = _photographic(scene, on_axis)
        per_value = on_axis * scale
    per_value *= exposure.factor
    if on_axis is not None:
        metadata |= {
            "working_f_number": working_f_number(on_axis / model.passed),
            "t_number": working_f_number(on_axis),
            "values_per_irradiance": per_value / on_axis,
        }
    record = model.record.copy()
    record["exposure"] = _in_float32(per_value / model.axial_weight)
    return replace(model, record=record, metadata=model.metadata | metadata)


def _photographic(scene: Scene, on_axis: float) -> dict[str, Any]:
    """Return what a photographer writes down; EV at ISO 100 by the f-number that the irradiance stands for."""
    exposure, time_s = scene.exposure, scene.shutter.time_s
    return {
        **({} if exposure.f_number is None else {"f_number": exposure.f_number}),
        "exposure_time_s": time_s,
        "iso": exposure.iso,
        "ev100": math.log2(working_f_number(on_axis) ** 2 / time_s * 100.0 / exposure.iso),
        "exposure_ev": exposure.ev,
        "neutral_density_stops": exposure.neutral_density_stops,
    }


def _in_float32(factor: float) -> float:
    if FLOAT32_MIN_NORMAL <= factor <= FLOAT32_MAX:
        return factor
    raise InputError(
        f"exposure: makes values that float32 cannot hold (got a factor of {factor:.3g};"
        f" allowed: {FLOAT32_MIN_NORMAL:.3g} to {FLOAT32_MAX:.3g})"
    )
