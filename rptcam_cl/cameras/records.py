"""The surfaces of a lens as device records, in the order in which rays from one side meet them, and their facts."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.dispersion import fill_dispersion, usable_nm
from rptcam_cl.cameras.lens_losses import LossFiller, LossTables
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import EVEN_TERMS, ODD_TERMS, SURFACE, RegionKind, StopKind, SurfaceKind
from rptcam_cl.optics import IDEAL, Lens, LensTransmission, Region, StopMask, StopShape, Surface, SurfacePose

MIRRORED = np.diag([1.0, 1.0, -1.0])


@dataclass(frozen=True)
class LensRecords:
    """Surface records in order of travel, the shape of the stop, and the facts that say which code they need.

    Behind the shape of the stop stand tables of what the lens lets through, where that takes any.
    """

    surfaces: NDArray[np.void]
    stop: NDArray[np.floating]
    facts: dict[str, int]


def lens_records(
    lens: Lens,
    wavelength_nm: float,
    start: Literal["film", "scene"],
    first_gap_mm: float,
    *,
    double: bool = False,
    dispersive: bool = False,
    transmission: LensTransmission = IDEAL,
) -> LensRecords:
    """Return the records of a lens for rays that start on one side.

    Parameters
    ----------
    start
        Side where rays begin. The device's z runs along the direction of travel, so shapes are mirrored where rays
        travel to -z: on their way from the film, or between mirrors.
    first_gap_mm
        Distance along the travel from the plane z = 0 of the rays to the first vertex they meet.
    double
        Whether the records are for the float64 tracer.
    dispersive
        Whether every ray has its own wavelength, in place of ``wavelength_nm``.
    transmission
        Losses that rays suffer.
    """
    indices = lens.indices(wavelength_nm)
    count = len(lens.surfaces)
    backwards = start == "film"
    order = range(count - 1, -1, -1) if backwards else range(count)
    real = "<f8" if double else "<f4"
    records = SURFACE.zeros(count, real)
    stop = np.zeros(1)
    previous = None
    for record, k in zip(records, order, strict=True):
        surface = lens.surfaces[k]
        before, after = (indices[k + 1], indices[k]) if backwards else (indices[k], indices[k + 1])
        record["eta"], record["refracts"] = before / after, -1.0 if surface.is_mirror else before != after
        sense = -lens.senses[k + 1] if backwards else lens.senses[k]
        record["gap"] = first_gap_mm if previous is None else sense * (lens.vertices[k] - lens.vertices[previous])
        record["inner_semi_diameter2"] = np.square(surface.inner_semi_diameter)
        record["semi_diameter2"] = min(np.square(surface.semi_diameter), float(np.finfo(np.float32).max))
        _fill_shape(record, surface, sense, f"{lens.name}: surfaces[{k}]")
        if surface.pose is not None:
            _fill_pose(record, surface.pose, sense)
        if surface.stop_shape is not None:
            stop = _fill_stop(record, surface.stop_shape, surface.semi_diameter)
        if surface.region is not None:
            joins = previous is not None and _same_half_lens(lens.surfaces[previous], surface)
            _fill_region(record, surface.region, joins)
        previous = k
    terms = fill_dispersion(records, lens, backwards) if dispersive else 0
    tables = LossTables(len(stop), usable_nm(lens, transmission)) if dispersive else None
    losses = LossFiller(transmission, wavelength_nm, tables).fill(records, lens, backwards)
    if tables is not None:
        stop = np.concatenate([stop, *tables.rows])
    return LensRecords(records, stop.astype(real), _facts(lens, records) | losses | {"LENS_DISPERSION": terms})


def _fill_shape(record: np.void, surface: Surface, sense: float, where: str) -> None:
    """Fill curvature, conic and polynomial; ``sense`` is -1 for a mirrored z."""
    record["curvature"], record["conic"] = sense * surface.curvature, surface.conic
    record["weight_x"], record["weight_y"] = surface.axes()
    surface.shape.fill(record, sense)
    for power, coefficient in surface.aspheric:
        name, place = ("odd", power // 2) if power % 2 else ("even", power // 2 - 1)
        if place >= (ODD_TERMS if power % 2 else EVEN_TERMS):
            raise InputError(
                f"{where}: aspheric: power {power} is too high for a device (allowed up to {2 * EVEN_TERMS - 1})"
            )
        record[name][place] += sense * coefficient
        record[f"{name}_terms"] = max(int(record[f"{name}_terms"]), place + 1)


def _fill_pose(record: np.void, pose: SurfacePose, sense: float) -> None:
    mirror = MIRRORED if sense < 0 else np.eye(3)
    record["posed"] = 1
    record["offset"][:3] = mirror @ np.array(pose.offset)
    record["rotation"][:9] = (mirror @ pose.matrix() @ mirror).ravel()


def _fill_region(record: np.void, region: Region, joins: bool) -> None:
    record["region"] = RegionKind.BLOCKS if region.blocks else RegionKind.GOES_ON if joins else RegionKind.OPENS
    record["inverted"] = region.inverted
    largest = float(np.finfo(np.float32).max)
    record["half_width"], record["half_height"] = min(region.half_width, largest), min(region.half_height, largest)
    record["edge"] = -largest
    if region.normal_degrees is not None:
        angle = np.radians(region.normal_degrees)
        record["edge"], record["edge_x"], record["edge_y"] = region.edge, np.cos(angle), np.sin(angle)


def _fill_stop(record: np.void, shape: StopShape | StopMask, semi_diameter_mm: float) -> NDArray[np.float64]:
    """Fill the shape of the stop and return its table [mm]."""
    if isinstance(shape, StopShape):
        edges = shape.edges() * (semi_diameter_mm, semi_diameter_mm, semi_diameter_mm, 1.0)
        record["stop_shape"], record["stop_count"] = StopKind.OUTLINE, len(edges)
        return np.asarray(edges.ravel())
    record["stop_shape"], record["stop_count"] = StopKind.MASK, len(shape.cells)
    record["stop_radius"] = semi_diameter_mm
    return shape.cells.astype(np.float64).ravel()


def _same_half_lens(previous: Surface, surface: Surface) -> bool:
    return previous.region is not None and not previous.region.blocks and previous.region == surface.region


def _facts(lens: Lens, records: NDArray[np.void]) -> dict[str, int]:
    kinds = records["kind"]
    general = bool(np.any(kinds >= SurfaceKind.ASPHERE))
    of_forms = {fact: 1 for surface in lens.surfaces if surface.form for fact in surface.form.facts}
    return of_forms | {
        "LENS_CONIC": int(bool(np.any(kinds == SurfaceKind.CONIC_KIND))),
        "LENS_GENERAL": int(general),
        "LENS_CYLINDER": int(any(surface.cylinder is not None for surface in lens.surfaces)),
        "LENS_ODD": int(bool(np.any(records["odd_terms"] > 0))),
        "LENS_POSE": int(any(surface.pose is not None for surface in lens.surfaces)),
        "LENS_OUTLINE": int(bool(np.any(records["stop_shape"] == StopKind.OUTLINE))),
        "LENS_MASK": int(bool(np.any(records["stop_shape"] == StopKind.MASK))),
        "LENS_MIRROR": int(lens.has_mirrors),
        "LENS_RING": int(lens.is_obstructed),
        "LENS_REGION": int(any(surface.region is not None for surface in lens.surfaces)),
    }
