"""What a lens does in one state: the numbers of `lens info`, image circle, field of view and T-number."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.irradiance import on_axis_irradiance
from rptcam_cl.optics.probe import FilmProbe, grid, narrowed
from rptcam_cl.optics.pupil_boxes import box_near, narrowing_probes, pupil_boxes
from rptcam_cl.optics.transmission import IDEAL, LensTransmission, axial_transmittance
from rptcam_cl.optics.variable import brought_to_focus

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

LARGEST_FIELD = 8.0  # image circles are searched up to this many focal lengths from the axis
HALF_STEPS, HALF_NODES, HALF_RAYS = 7, 33, (72, 72)
INSIDE = 0.997  # of the image circle, where more than a sliver of the pupil is left
QUICK = (40, 40)
FAN = (4096, 1)
SEARCH = (160, 160)


def lens_info(
    lens: Lens,
    f_number: float | None = None,
    object_distance_mm: float = np.inf,
    wavelength_nm: float = LINE_D_NM,
    transmission: LensTransmission = IDEAL,
) -> dict[str, Any]:
    """Return first-order data and working state as plain values, for JSON; None where there is no such number.

    Parameters
    ----------
    lens : Lens
    f_number : float, optional
        Closes the stop; by default it is as in the file.
    object_distance_mm : float
        From the film to the object plane.
    wavelength_nm : float
    transmission : LensTransmission
        Losses that the T-number counts.
    """
    if f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number, wavelength_nm))
    film: float | None
    try:
        lens, film = brought_to_focus(lens, object_distance_mm, wavelength_nm)
    except InputError:
        if np.isfinite(object_distance_mm):
            raise
        film = None
    result = lens.first_order(wavelength_nm).as_dict()
    result |= {"name": lens.name, "source": lens.source, "warnings": list(lens.warnings)}
    result["stop_diameter_mm"] = None if lens.stop is None else 2 * lens.stop.semi_diameter
    result["film_distance_mm"] = film
    result["axial_transmittance"] = float(axial_transmittance(lens, wavelength_nm, transmission))
    for key in ("working_f_number", "t_number", "half_light_circle_mm", "image_circle_mm", "field_of_view_degrees"):
        result[key] = None
    if film is not None:
        result["working_f_number"] = working_f_number(lens, film, wavelength_nm)
        result["t_number"] = t_number(lens, film, wavelength_nm, transmission)
        circle = image_circle(lens, film, wavelength_nm)
        result["half_light_circle_mm"] = 2 * half_light_radius(lens, film, circle, wavelength_nm)
        if circle < farthest(lens, film, wavelength_nm):  # else nothing in the lens ends its picture
            result["image_circle_mm"] = 2 * circle
            result["field_of_view_degrees"] = field_of_view(lens, film, circle * INSIDE, wavelength_nm)
    return {key: _plain(value) for key, value in result.items()}


def working_f_number(lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return 1 / (2 n' sin theta') of the axial beam at the film, by first order for the size of the exit pupil."""
    data = lens.first_order(wavelength_nm)
    away = film_distance_mm - data.exit_pupil.distance_mm
    index = float(lens.indices(wavelength_nm)[-1])
    if not np.isfinite(away):
        return data.f_number / index
    return float(abs(away) / (index * data.exit_pupil.diameter_mm))


def t_number(
    lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM, transmission: LensTransmission = IDEAL
) -> float:
    """Return the f-number of an ideal lens that would give the centre of the film the same light: E = pi / (4 T^2)."""
    return float(np.sqrt(np.pi / (4.0 * on_axis_irradiance(lens, film_distance_mm, wavelength_nm, transmission))))


def image_circle(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: float = LINE_D_NM,
    *,
    between_mm: tuple[float, float] | None = None,
) -> float:
    """Return the film radius [mm] beyond which no ray arrives along +x, within 0.05 %.

    It is searched up to eight focal lengths from the axis; a lens that lights more has that radius.

    Parameters
    ----------
    between_mm
        A radius that is known to have light, and one beyond which the circle does not matter: if that has light, the
        result is just beyond it.
    """
    probe = FilmProbe(lens, film_distance_mm, wavelength_nm)
    limit = farthest(lens, film_distance_mm, wavelength_nm)

    def lit(radius: float) -> bool:
        # What is left near the edge is a sliver across the plane of film point and axis, too thin for a grid.
        film = np.array([[radius, 0.0]])
        return any(narrowed(probe, film, probe.windows(film), shape)[1][0] for shape in (FAN, SEARCH))

    radii = np.concatenate([[0.0], limit * np.geomspace(0.02, 1.0, 24)])
    low, high = 0.0, 0.0
    if between_mm is not None:
        low, enough = between_mm
        if lit(enough):
            return float(np.nextafter(enough, np.inf))
        radii = np.append(radii[(radii > low) & (radii < enough)], enough)
    for radius in radii:
        if not lit(float(radius)):
            high = float(radius)
            break
        low = float(radius)
    else:
        return low
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if lit(middle) else (low, middle)
    return low


def farthest(lens: Lens, film_distance_mm: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the film radius [mm] up to which image circles are searched."""
    length = abs(lens.first_order(wavelength_nm).focal_length_mm)
    return LARGEST_FIELD * (length if np.isfinite(length) else film_distance_mm)


def half_light_radius(lens: Lens, film_distance_mm: float, circle_mm: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the least film radius [mm] along +x with half the irradiance of the axis, within 1 %.

    Parameters
    ----------
    circle_mm : float
        Radius of the image circle, which is the result where there is more light to its edge.
    """

    probes = narrowing_probes(lens, film_distance_mm, wavelength_nm)
    nodes = np.linspace(0.0, circle_mm, HALF_NODES)
    node_boxes, _ = pupil_boxes(probes, np.column_stack([nodes, np.zeros(HALF_NODES)]), in_order=True)

    def light(radius: float) -> float:  # D^2 / (D^2 + rho^2)^2 over what passes of a plane through the last vertex
        film = np.array([[radius, 0.0]])
        near, _ = box_near(probes[-1], film, node_boxes[np.abs(nodes - radius).argmin()], radial=False)
        boxes, found = narrowed(probes[-1], film, near[None], HALF_RAYS)
        points = grid(boxes, *HALF_RAYS)[0]
        targets = np.column_stack([points, np.full(len(points), lens.length)])
        start = np.array([radius, 0.0, lens.film_z(film_distance_mm)])
        passed = lens.trace(np.broadcast_to(start, targets.shape), targets - start, wavelength_nm).passed
        square = np.sum((targets - start) ** 2, axis=1)
        sides = np.ptp(points, axis=0) / (np.array(HALF_RAYS) - 1)
        return float(found[0] * np.prod(sides) * np.sum(passed / square**2))

    def share(radius: float) -> float:
        return light(radius) / on_axis

    on_axis = light(0.0)
    low, more = 0.0, 0.5  # light above the half
    for radius in circle_mm * np.geomspace(0.05, 1.0, HALF_STEPS):
        if (found := share(float(radius)) - 0.5) < 0:
            high, less = float(radius), found
            break
        low, more = float(radius), found
    else:
        return circle_mm
    while high - low > 3e-3 * high:  # along the chord, but never beside an end for long
        part = float(np.clip(more / (more - less), 0.1, 0.9))
        middle = low + part * (high - low)
        if (found := share(middle) - 0.5) >= 0:
            low, more = middle, found
        else:
            high, less = middle, found
    return low


def field_of_view(
    lens: Lens, film_distance_mm: float, film_radius_mm: float, wavelength_nm: float = LINE_D_NM
) -> float | None:
    """Return the full angle [degrees] that a film radius sees: twice the mean angle of its rays in the scene."""
    probe = FilmProbe(lens, film_distance_mm, wavelength_nm)
    film = np.array([[film_radius_mm, 0.0]])
    boxes, found = narrowed(probe, film, probe.windows(film), SEARCH)
    if not found[0]:
        return None
    points = grid(boxes, *QUICK)[0]
    targets = np.column_stack([points, np.full(len(points), lens.length)])
    start = np.array([film_radius_mm, 0.0, lens.film_z(film_distance_mm)])
    rays = lens.trace(np.broadcast_to(start, targets.shape), targets - start, wavelength_nm)
    if not rays.passed.any():
        return None
    mean = rays.directions[rays.passed].mean(axis=0)
    return float(2 * np.degrees(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2])))


def stop_diameter_by_sine(lens: Lens, f_number: float, wavelength_nm: float = LINE_D_NM) -> float:
    """Return the stop diameter [mm] at which the real axial ray of an object at infinity has sin theta' = 1 / (2 N).

    The ray leaves the rear focal point at that angle and is traced through the rear group to the stop (CS348b 2003).

    Raises
    ------
    InputError
        When the lens has no stop or does not open that far.
    """
    if lens.stop_index is None or lens.stop is None:
        raise InputError(f"{lens.name}: has no stop to set; only its rims limit the light (mark one with stop: true)")
    if not f_number > 0.5:
        raise InputError(f"{lens.name}: no lens in air is faster than f/0.5 (got f/{f_number:g})")
    back = lens.first_order(wavelength_nm).back_focal_distance_mm
    rear = tuple(
        replace(s, semi_diameter=np.inf, inner_semi_diameter=0.0, region=None) for s in lens.surfaces[lens.stop_index :]
    )
    group = replace(lens, surfaces=rear, stop_index=None, first_sense=float(lens.senses[lens.stop_index]))
    sine = 1.0 / (2.0 * f_number)
    away = -group.sense * np.sqrt(1 - sine * sine)
    ray = group.trace([[0, 0, group.film_z(back)]], [[0, sine, away]], wavelength_nm)
    diameter = 2 * abs(float(ray.origins[0, 1]))
    has = 2 * lens.stop.semi_diameter
    if not ray.passed[0] or diameter > has * (1 + 5e-3):
        raise InputError(f"{lens.name}: the stop opens to {has:.5g} mm (f/{f_number:g} would need {diameter:.5g} mm)")
    return min(diameter, has)


def _plain(value: Any) -> Any:
    """Return nested values with numbers that are not finite as None."""
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
