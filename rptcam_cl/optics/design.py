"""Lenses from a few numbers (Kumar et al. 2024, eqs. 3-12), and the numbers of `lens info` of any lens."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import plain
from rptcam_cl.optics.film_probe import FilmProbe, box_near, grid, narrow_boxes, narrowing_probes, pupil_boxes
from rptcam_cl.optics.irradiance import on_axis_irradiance
from rptcam_cl.optics.lens import Lens, brought_to_focus
from rptcam_cl.optics.ray_trace import IDEAL, LensTransmission, axial_transmittance

#
# Lenses from a few numbers: a single lens of a focal length, and an achromatic doublet (Kumar et al. 2024, eqs. 3-12).
#
# Radii are signed here, positive when the centre lies on the film side; the paper writes magnitudes for biconvex and
# biconcave lenses. Its eq. 12 lacks a minus sign: an achromat needs P1 / V1 + P2 / V2 = 0.

CONSTRAINTS = ("r1", "r1=r2", "flat r3", "r2=r3")


@dataclass(frozen=True)
class GlassChoice:
    """Index and Abbe number of a glass, and the text that names it in a lens file."""

    index: float
    abbe: float
    entry: Any = None

    def in_file(self) -> Any:
        """Return the `glass` entry of a lens file."""
        return self.entry if self.entry is not None else {"nd": self.index, "vd": self.abbe}


def image_distances(focal_length: float, object_to_film: float) -> tuple[float, float]:
    """Return the two image distances of a thin lens between an object and a film that distance apart (eqs. 4 and 5).

    The first is the shorter: the lens stands near the film, as in a camera.

    Raises
    ------
    InputError
        When the film is nearer than four focal lengths to the object.
    """
    square = object_to_film * object_to_film - 4.0 * focal_length * object_to_film
    if focal_length <= 0:
        raise InputError(f"a lens of focal length {focal_length:g} forms no real image")
    if square < 0:
        raise InputError(
            f"an object {object_to_film:g} from the film is too near; "
            f"the least distance is four focal lengths, {4 * focal_length:g}"
        )
    far = (object_to_film + math.sqrt(square)) / 2.0
    return focal_length * object_to_film / far, far


def singlet(focal_length_mm: float, glass: GlassChoice, diameter_mm: float, bending: float = 0.0) -> dict[str, Any]:
    """Return the lens file of a single lens as a mapping.

    Parameters
    ----------
    focal_length_mm : float
        Negative for a diverging lens.
    glass : GlassChoice
    diameter_mm : float
    bending : float
        Shape (R2 + R1) / (R2 - R1): 0 equal radii, 1 plane on the film side, -1 plane on the scene side.
    """
    _check_size(focal_length_mm, diameter_mm)
    share1, share2 = (bending + 1.0) / 2.0, (bending - 1.0) / 2.0
    thickness, power = 0.0, 1.0 / focal_length_mm
    for _ in range(100):
        # Curvatures c1 = c share1 and c2 = c share2 with the thick lensmaker's equation solved for c.
        a = (glass.index - 1.0) * thickness * share1 * share2 / glass.index
        wanted = power / (glass.index - 1.0)
        c = 2.0 * wanted / (1.0 + math.sqrt(max(1.0 + 4.0 * a * wanted, 0.0)))
        new = _thickness(c * share1, c * share2, diameter_mm)
        if abs(new - thickness) <= 1e-14 * diameter_mm:
            break
        thickness = new
    return {
        "name": f"Single lens of {focal_length_mm:g} mm",
        "source": "Lensmaker's equation",
        "published": {"focal_length_mm": focal_length_mm},
        "surfaces": [
            _row(c * share1, diameter_mm, thickness, glass.in_file(), stop=True),
            _row(c * share2, diameter_mm),
        ],
    }


def doublet_radii(
    focal_length: float, crown: GlassChoice, flint: GlassChoice, constraint: str = "r1=r2", r1: float = 0.0
) -> tuple[float, float, float]:
    """Return the signed radii of a cemented thin achromat (eqs. 6 to 12); an infinite radius is a plane.

    Parameters
    ----------
    focal_length : float
    crown, flint : GlassChoice
        Scene side first; their Abbe numbers must differ.
    constraint : str
        The third condition: "r1" (given), "r1=r2" (biconvex first lens), "flat r3", "r2=r3" (biconcave second lens).
    r1 : float
        First radius when the constraint is "r1".
    """
    if constraint not in CONSTRAINTS:
        raise InputError(f"unknown constraint {constraint!r}; allowed: {', '.join(CONSTRAINTS)}")
    if crown.abbe == flint.abbe:
        raise InputError(f"an achromat needs two Abbe numbers that differ (got {crown.abbe:g} twice)")
    p1 = crown.abbe / ((crown.abbe - flint.abbe) * focal_length)
    p2 = flint.abbe / ((flint.abbe - crown.abbe) * focal_length)
    bend1, bend2 = p1 / (crown.index - 1.0), p2 / (flint.index - 1.0)
    if constraint == "r1":
        if not r1:
            raise InputError("the first radius must be given and not 0")
        c1 = 1.0 / r1
    else:
        c1 = {"r1=r2": bend1 / 2.0, "flat r3": bend1 + bend2, "r2=r3": bend1 + bend2 / 2.0}[constraint]
    c2 = c1 - bend1
    c3 = 0.0 if constraint == "flat r3" else c2 - bend2
    return _radius(c1), _radius(c2), _radius(c3)


def doublet(
    focal_length_mm: float,
    crown: GlassChoice,
    flint: GlassChoice,
    diameter_mm: float,
    constraint: str = "r1=r2",
    r1: float = 0.0,
) -> dict[str, Any]:
    """Return the lens file of a cemented achromat as a mapping: thin-lens radii with real thicknesses."""
    _check_size(focal_length_mm, diameter_mm)
    c1, c2, c3 = (1.0 / radius for radius in doublet_radii(focal_length_mm, crown, flint, constraint, r1))
    return {
        "name": f"Achromatic doublet of {focal_length_mm:g} mm",
        "source": "Thin achromat, Kumar et al. 2024, eqs. 6-12 with the sign of eq. 12 corrected",
        "published": {"focal_length_mm": focal_length_mm},
        "surfaces": [
            _row(c1, diameter_mm, _thickness(c1, c2, diameter_mm), crown.in_file(), stop=True),
            _row(c2, diameter_mm, _thickness(c2, c3, diameter_mm), flint.in_file()),
            _row(c3, diameter_mm),
        ],
    }


def _check_size(focal_length_mm: float, diameter_mm: float) -> None:
    if not math.isfinite(focal_length_mm) or focal_length_mm == 0:
        raise InputError(f"the focal length must be finite and not 0 (got {focal_length_mm:g})")
    if not diameter_mm > 0:
        raise InputError(f"the diameter must be above 0 (got {diameter_mm:g})")


def _radius(curvature: float) -> float:
    return 1.0 / curvature if curvature else math.inf


def _thickness(front: float, rear: float, diameter: float) -> float:
    """Return the thickness that leaves an edge, or for a diverging lens a centre, of a twentieth of the diameter."""
    height = diameter / 2.0
    sags = []
    for curvature in (front, rear):
        inside = 1.0 - (curvature * height) ** 2
        if inside < 0:
            raise InputError(f"a radius of {1 / curvature:.4g} mm is too short for a diameter of {diameter:g} mm")
        sags.append(curvature * height * height / (1.0 + math.sqrt(inside)))
    return max(sags[0] - sags[1], 0.0) + diameter / 20.0


def _row(
    curvature: float, diameter: float, thickness: float | None = None, glass: Any = None, stop: bool = False
) -> dict[str, Any]:
    row: dict[str, Any] = {"diameter": diameter}
    if curvature:
        row["radius"] = 1.0 / curvature
    if thickness is not None:
        row["thickness"] = thickness
    if glass is not None:
        row["glass"] = glass
    if stop:
        row["stop"] = True
    return row


# What a lens does in one state: the numbers of `lens info`, image circle, field of view and T-number.

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
        result["half_light_circle_mm"] = 2 * _half_light_radius(lens, film, circle, wavelength_nm)
        if circle < farthest(lens, film, wavelength_nm):  # else nothing in the lens ends its picture
            result["image_circle_mm"] = 2 * circle
            result["field_of_view_degrees"] = field_of_view(lens, film, circle * INSIDE, wavelength_nm)
    return dict(plain(result, json=True))


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
        return any(narrow_boxes(probe, film, probe.windows(film), shape)[1][0] for shape in (FAN, SEARCH))

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


def _half_light_radius(
    lens: Lens, film_distance_mm: float, circle_mm: float, wavelength_nm: float = LINE_D_NM
) -> float:
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
        boxes, lit = narrow_boxes(probes[-1], film, near[None], HALF_RAYS)
        points = grid(boxes, *HALF_RAYS)[0]
        targets = np.column_stack([points, np.full(len(points), lens.length)])
        start = np.array([radius, 0.0, lens.film_z(film_distance_mm)])
        passed = lens.trace(np.broadcast_to(start, targets.shape), targets - start, wavelength_nm).passed
        square = np.sum((targets - start) ** 2, axis=1)
        sides = np.ptp(points, axis=0) / (np.array(HALF_RAYS) - 1)
        return float(lit[0] * np.prod(sides) * np.sum(passed / square**2))

    def share(radius: float) -> float:
        return light(radius) / on_axis

    on_axis = light(0.0)
    low, more = 0.0, 0.5  # light above the half
    for radius in circle_mm * np.geomspace(0.05, 1.0, HALF_STEPS):
        if (excess := share(float(radius)) - 0.5) < 0:
            high, less = float(radius), excess
            break
        low, more = float(radius), excess
    else:
        return circle_mm
    while high - low > 3e-3 * high:  # along the chord, but never beside an end for long
        part = float(np.clip(more / (more - less), 0.1, 0.9))
        middle = low + part * (high - low)
        if (excess := share(middle) - 0.5) >= 0:
            low, more = middle, excess
        else:
            high, less = middle, excess
    return low


def field_of_view(
    lens: Lens, film_distance_mm: float, film_radius_mm: float, wavelength_nm: float = LINE_D_NM
) -> float | None:
    """Return the full angle [degrees] that a film radius sees: twice the mean angle of its rays in the scene."""
    probe = FilmProbe(lens, film_distance_mm, wavelength_nm)
    film = np.array([[film_radius_mm, 0.0]])
    boxes, lit = narrow_boxes(probe, film, probe.windows(film), SEARCH)
    if not lit[0]:
        return None
    rays = probe.trace(film[0], grid(boxes, *QUICK)[0])
    if not rays.passed.any():
        return None
    mean = rays.directions[rays.passed].mean(axis=0)
    return float(2 * np.degrees(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2])))
