"""What a lens does over its field: aberrations, distortion, vignetting, transmittance, ghosts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import charts, drawing
from rptcam_cl.optics.chief_rays import without_obstructions
from rptcam_cl.optics.design import image_circle, t_number
from rptcam_cl.optics.ghosts import Ghosts, ghost_image, steps, unfold, with_film
from rptcam_cl.optics.image_quality import (
    NOTHING,
    STAYS,
    Setting,
    at_plane,
    default_fields,
    fan_points,
    field_waves,
    result_of,
    section_rays,
)
from rptcam_cl.optics.irradiance import irradiance_with_error, pass_areas, veiling_glare
from rptcam_cl.optics.ray_trace import COATED, UNCOATED, LensTransmission, Rays, axial_transmittance, has_coatings
from rptcam_cl.optics.spot import Beam, chief_ray, passing_beam
from rptcam_cl.optics.waves import MOST_ACROSS, ExitRays, check_wavefront

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rptcam_cl.optics.lens import Lens
    from rptcam_cl.optics.surface import Surface


# Aberrations of a beam as curves: its ray fans, where its sections are sharp, and its spot through focus.

Array = NDArray[np.float64]
Row = dict[str, Any]

NEAR = 1e-5  # of the size of the first surface: how far from the chief ray the rays lie that say where it is sharp
ACROSS = 64  # rays across a beam whose width, or middle, is sought
BISECTIONS = 40  # for the edge of what passes
WITHIN = 1 - 1e-9  # of it, which holds both rims of a beam that is as wide on either side but for rounding
FEWEST = 32  # of a spot, at first
FINE = (0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0)  # shares of the widest field
FEW = (0.0, 0.7, 1.0)


def _through(setting: Setting, lens: Lens, degrees: float, wavelength_nm: float, points: Array) -> Rays:
    origins, directions = Beam(degrees, setting.object_distance_mm).rays(points)
    return lens.trace(origins, directions, wavelength_nm, "scene")


def ray_fan(
    setting: Setting, fields: Sequence[float] | None, wavelengths_nm: Sequence[float], rays: int
) -> charts.Measured:
    """Return where the rays of the tangential and the sagittal fan of each field land beside its chief ray [um].

    `pupil` goes from -1 to 1 over what passes in the plane of the first vertex, along y and along x; at 0 is the chief
    ray of the setting's wavelength, or, where none of the field reaches the middle of the stop, the ray through the
    middle of what passes. What does not pass has no row. `ahead_waves` is by how much the path is shorter than that of
    the wavelength's chief ray, up to the sphere about its point; None where no wavefront is known.
    """
    rows: list[Row] = []
    _ = setting.film
    for degrees in fields_of(setting, fields, FEW):
        beam, main = Beam(degrees, setting.object_distance_mm), setting.wavelength_nm
        points, _, _ = passing_beam(setting.lens, beam, main, ACROSS)
        try:
            height, chief = chief_ray(setting.lens, degrees, main, setting.object_distance_mm)
        except InputError:
            height = float(points[:, 1].mean())
            chief = _through(setting, without_obstructions(setting.lens), degrees, main, np.array([[0.0, height]]))
        middle = at_plane(chief.origins, chief.directions, setting.film_z)[0, :2]
        for axis in (1, 0):
            start = np.array([0.0, height])
            most = 1.2 * float(np.abs(points[:, axis] - start[axis]).max())
            reach = WITHIN * max(map(abs, _edges(setting, degrees, main, start, axis, most)))
            steps = np.linspace(-1.0, 1.0, rays)
            line = np.tile(start, (rays, 1))
            line[:, axis] += steps * reach
            for wavelength in wavelengths_nm:
                traced = _through(setting, setting.lens, degrees, wavelength, line)
                off = (at_plane(traced.origins, traced.directions, setting.film_z)[:, :2] - middle) * 1e3
                ahead = _waves_ahead(setting, beam, wavelength, line, traced)
                rows += [
                    {"field_degrees": degrees, "wavelength_nm": wavelength, "tangential": float(axis == 1),
                     "pupil": float(steps[k]), "off_um": float(off[k, axis]),
                     "ahead_waves": None if ahead is None else float(ahead[k])}
                    for k in np.flatnonzero(traced.passed)
                ]  # fmt: skip
    shown = [row for row in rows if row["tangential"] and row["wavelength_nm"] == wavelengths_nm[0]]
    return result_of(
        setting, "ray fans", rows,
        lambda: curves_over(
            f"{setting.lens.name}: tangential ray fans, {wavelengths_nm[0]:g} nm", shown,
            ("pupil", "place in the beam, from edge to edge"), [("off_um", "degrees")],
            "from the chief ray on the film [µm]", "field_degrees",
        ),
    )  # fmt: skip


def _waves_ahead(setting: Setting, beam: Beam, wavelength_nm: float, points: Array, traced: Rays) -> Array | None:
    try:
        check_wavefront(setting.lens, beam)
        exit_rays = ExitRays(setting.lens, beam, wavelength_nm, setting.film_z)
    except InputError:
        return None
    return exit_rays.waves(points, traced)[1]


def _edges(
    setting: Setting, degrees: float, wavelength_nm: float, start: Array, axis: int, most: float
) -> tuple[float, float]:
    """Return from where to where rays pass along x or y, from a point of the plane of the first vertex on [mm].

    Parameters
    ----------
    most
        How far that may be.
    """

    def passes(steps: Array) -> NDArray[np.bool_]:
        line = np.tile(start, (len(steps), 1))
        line[:, axis] += steps
        return _through(setting, setting.lens, degrees, wavelength_nm, line).passed

    steps = most * np.linspace(-1.0, 1.0, 4 * ACROSS + 1)
    lit = np.flatnonzero(passes(steps))
    if not len(lit):  # nothing of this line, as in a ring whose middle is elsewhere
        return -most, most
    inside, outside = steps[lit[[0, -1]]], steps[[max(lit[0] - 1, 0), min(lit[-1] + 1, len(steps) - 1)]]
    for _ in range(BISECTIONS):
        middle = (inside + outside) / 2
        still = passes(middle)
        inside, outside = np.where(still, middle, inside), np.where(still, outside, middle)
    return float(inside[0]), float(inside[1])


def zernike(
    setting: Setting, fields: Sequence[float] | None, wavelengths_nm: Sequence[float], *, order: int, rays: int | None
) -> charts.Measured:
    """Return the Zernike coefficients of wavefronts up to the sphere about the chief ray's point [waves].

    `fringe` counts polynomials that are 1 at the edge, `noll` those whose rms is 1; both the same terms, as far as an
    order. The angle counts from +x, and the circle goes round what passes along x and y through the chief ray, in
    direction cosines. `rest_waves` is the rms of what they leave.
    """
    rows: list[Row] = []
    for wave in field_waves(setting, fields, wavelengths_nm, rays):
        degrees, nm = wave.field_degrees, wave.wavelength_nm
        points, _, _ = passing_beam(setting.lens, Beam(degrees, setting.object_distance_mm), nm, ACROSS)
        height, _ = chief_ray(setting.lens, degrees, nm, setting.object_distance_mm)
        ends = np.tile([0.0, height], (2, 2, 1))
        for axis in (0, 1):
            most = 1.2 * float(np.abs(points[:, axis] - ends[0, 0, axis]).max())
            ends[axis, :, axis] += _edges(setting, degrees, nm, ends[axis, 0].copy(), axis, most)
        traced = _through(setting, setting.lens, degrees, nm, ends.reshape(4, 2)).directions[:, :2].reshape(2, 2, 2)
        sides = np.stack([traced[axis, :, axis] for axis in (0, 1)])
        middle, radius = sides.mean(axis=1), float(np.abs(np.diff(sides, axis=1)).max()) / 2
        lit = wave.coverage > 0
        x, y = np.meshgrid((wave.cosines_x - middle[0]) / radius, (wave.cosines_y - middle[1]) / radius)
        terms = [(n, m) for n in range(order + 1) for m in range(-n, n + 1, 2)]
        values = np.stack([zernike_term(n, m, x[lit], y[lit]) for n, m in terms], axis=1)
        weight, target = np.sqrt(wave.coverage[lit]), wave.waves_on_sphere[lit]
        factors = np.linalg.lstsq(values * weight[:, None], target * weight, rcond=None)[0]
        rest = float(np.sqrt(np.average((values @ factors - target) ** 2, weights=weight**2)))
        rows += [
            {"field_degrees": degrees, "wavelength_nm": nm, "n": n, "m": m, "fringe": fringe_number(n, m),
             "noll": noll_number(n, m), "fringe_waves": factor, "rest_waves": rest,
             "noll_waves": factor / math.sqrt((n + 1) * (1 if m == 0 else 2))}
            for (n, m), factor in zip(terms, factors.tolist(), strict=True)
        ]  # fmt: skip
    rows.sort(key=lambda row: (row["field_degrees"], row["wavelength_nm"], row["fringe"]))
    return result_of(
        setting, "Zernike coefficients", rows,
        lambda: curves_over(
            f"{setting.lens.name}: Zernike coefficients (fringe), {wavelengths_nm[0]:g} nm",
            [row for row in rows if row["wavelength_nm"] == wavelengths_nm[0] and row["fringe"] > 1],
            ("fringe", "number of the term"), [("fringe_waves", "degrees")], "waves", "field_degrees", ("o:",),
        ),
    )  # fmt: skip


def zernike_term(n: int, m: int, x: Array, y: Array) -> Array:
    """Return a Zernike polynomial that is 1 at the edge: R(n, |m|) cos(m angle), of negative m sin(|m| angle)."""
    radius, angle, k = np.hypot(x, y), np.arctan2(y, x), abs(m)
    radial = sum(
        (-1) ** s * math.comb(n - s, s) * math.comb(n - 2 * s, (n - k) // 2 - s) * radius ** (n - 2 * s)
        for s in range((n - k) // 2 + 1)
    )
    return np.asarray(radial * (np.sin(k * angle) if m < 0 else np.cos(k * angle)))


def fringe_number(n: int, m: int) -> int:
    """Return the number of a term in the order of fringes (University of Arizona)."""
    return (1 + (n + abs(m)) // 2) ** 2 - 2 * abs(m) + (m < 0)


def noll_number(n: int, m: int) -> int:
    """Return the number of a term as Noll (1976) counts: of each pair the even one is the cosine."""
    first = n * (n + 1) // 2 + abs(m)
    return first + int((m >= 0 and n % 4 in (2, 3)) or (m <= 0 and n % 4 in (0, 1)))


def field_curvature(
    setting: Setting, fields: Sequence[float] | None, wavelengths_nm: Sequence[float]
) -> charts.Measured:
    """Return where thin pencils are sharp, as `curvature_rows` has it."""
    _ = setting.film
    rows = curvature_rows(setting, fields_of(setting, fields, FINE), wavelengths_nm)
    return result_of(
        setting, "field curvature", rows,
        lambda: curves_over(
            f"{setting.lens.name}: field curvature", rows, ("field_degrees", "angle from the axis [degrees]"),
            [("tangential_mm", "nm tangential"), ("sagittal_mm", "nm sagittal")], "behind the film [mm]",
            "wavelength_nm",
        ),
    )  # fmt: skip


def curvature_rows(setting: Setting, fields: Sequence[float], wavelengths_nm: Sequence[float]) -> list[Row]:
    """Return where thin pencils about the chief ray are sharp, along the axis from the film [mm], as Coddington has it.

    By rays close beside the chief ray on both sides, through obstructions in the middle of the lens. Positive: behind
    the film. None where rims stop them, or no ray of the field reaches the middle of the stop.

    Raises
    ------
    InputError
        When no ray of any field reaches the stop.
    """
    refused: InputError | None = None
    step = NEAR * min(setting.lens.surfaces[0].semi_diameter, 1e3)
    rows: list[Row] = []
    for degrees in fields:
        for wavelength in wavelengths_nm:
            try:
                height, _ = chief_ray(setting.lens, degrees, wavelength, setting.object_distance_mm)
            except InputError as problem:  # what passes goes nowhere near the middle of the stop
                refused, height = problem, math.nan
            beside = np.array([0.0, height]) + step * np.array([[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]])
            traced = _through(setting, without_obstructions(setting.lens), degrees, wavelength, beside)
            at = at_plane(traced.origins, traced.directions, setting.film_z)
            slopes = setting.lens.sense * traced.directions[:, :2] / traced.directions[:, 2:]
            off = [
                float(-(at[a, k] - at[b, k]) / (slopes[a, k] - slopes[b, k])) if traced.passed[[a, b]].all() else None
                for a, b, k in ((0, 1, 1), (2, 3, 0))
            ]
            rows.append(
                {"field_degrees": degrees, "wavelength_nm": wavelength, "tangential_mm": off[0], "sagittal_mm": off[1],
                 "astigmatism_mm": None if None in off else off[0] - off[1]}  # type: ignore[operator]
            )  # fmt: skip
    if refused is not None and all(row["tangential_mm"] is row["sagittal_mm"] is None for row in rows):
        raise refused
    return rows


ZONES = (0.0, 0.7, 1.0)  # shares of the radius of the pupil


def focal_shift(setting: Setting, wavelengths_nm: Sequence[float]) -> charts.Measured:
    """Return where light of each wavelength and zone of the pupil meets the axis, behind the film [mm].

    Zone 0 is the paraxial focus; the others are heights of real rays, in radii of the entrance pupil. None where a rim
    stops the ray.
    """
    rows: list[Row] = []
    for nm in wavelengths_nm:
        marginal, _ = paraxial_rays(replace(setting, wavelength_nm=nm), 0.0)
        start = np.zeros((len(ZONES) - 1, 2))
        start[:, 1] = np.array(ZONES[1:]) * paraxial_rays(setting, 0.0)[0][0, 0]
        traced = _through(setting, without_obstructions(setting.lens), 0.0, nm, start)
        crossing = traced.origins[:, 2] - traced.origins[:, 1] * traced.directions[:, 2] / traced.directions[:, 1]
        behind = setting.lens.sense * (crossing - setting.lens.length)
        paraxial_focus = -setting.lens.sense * marginal[-1, 0] / marginal[-1, 1]
        found = [paraxial_focus, *np.where(traced.passed, behind, np.nan)]
        rows += [
            {"wavelength_nm": nm, "zone": zone,
             "shift_mm": float(place - setting.film) if math.isfinite(place) else None}
            for zone, place in zip(ZONES, found, strict=True)
        ]  # fmt: skip
    return result_of(
        setting, "focal shift", rows,
        lambda: curves_over(
            f"{setting.lens.name}: focus over the wavelength", rows, ("wavelength_nm", "wavelength [nm]"),
            [("shift_mm", "of the pupil's radius")], "behind the film [mm]", "zone",
        ),
    )  # fmt: skip


def through_focus(
    setting: Setting,
    range_mm: float | None,
    fields: Sequence[float] | None,
    wavelengths_nm: Sequence[float],
    *,
    steps: int,
    rays: int | None,
) -> charts.Measured:
    """Return the rms spot of each field, its wavelengths together, over shifts of the film away from the lens.

    By default as many rays as its least and its largest spot need.
    """
    _ = setting.film
    reach = range_mm or 0.1 * abs(setting.lens.first_order().f_number)
    shifts_mm = np.linspace(-reach, reach, steps)
    rows: list[Row] = []
    for degrees in fields_of(setting, fields, FEW):
        count = rays or FEWEST
        before, sides = None, _through_focus(setting, degrees, wavelengths_nm, shifts_mm, count)
        while (
            rays is None
            and count < MOST_ACROSS
            and (before is None or np.max(np.abs(before - sides) / (STAYS * np.hypot(*sides) + NOTHING)) > 1)
        ):
            count *= 2
            before, sides = sides, _through_focus(setting, degrees, wavelengths_nm, shifts_mm, count)
        rows += [
            {"field_degrees": degrees, "shift_mm": shift, "rms_um": math.hypot(x, y), "rms_x_um": x, "rms_y_um": y}
            for shift, x, y in zip(shifts_mm.tolist(), *(1e3 * sides).tolist(), strict=True)
        ]
    title = f"{setting.lens.name}: spots through focus"
    return result_of(
        setting, "spots through focus", rows,
        lambda: curves_over(
            title, rows, ("shift_mm", "film away from the lens [mm]"), [("rms_um", "degrees")], "rms spot [µm]",
            "field_degrees",
        ),
    )  # fmt: skip


def _through_focus(
    setting: Setting, degrees: float, wavelengths_nm: Sequence[float], shifts_mm: Array, across: int
) -> Array:
    """Return the rms of a spot in x and in y (2, shifts) over shifts of the film [mm]."""
    beam = Beam(degrees, setting.object_distance_mm)
    passed = [passing_beam(setting.lens, beam, wavelength, across)[1] for wavelength in wavelengths_nm]
    origins, directions = (
        np.concatenate([getattr(rays, name) for rays in passed]) for name in ("origins", "directions")
    )
    moved = (replace(setting, film_distance_mm=setting.film + shift).film_z for shift in shifts_mm.tolist())
    return np.stack([np.std(at_plane(origins, directions, z)[:, :2], axis=0) for z in moved], axis=1)


@charts.styled()
def curves_over(
    title: str,
    rows: Sequence[Row],
    across: tuple[str, str],
    up: Sequence[tuple[str, str]],
    unit: str,
    by: str,
    styles: tuple[str, ...] = ("-", "--"),
) -> Figure:
    """Return curves of columns (name, label) over another, in a colour for each value of a third."""
    values = [row[across[0]] for row in rows]
    figure, axes = charts.new_chart(title, (across[1], unit), (min(values), max(values)))
    axes.axhline(0.0, color=charts.INK, linewidth=0.8)
    for number, kind in enumerate(dict.fromkeys(row[by] for row in rows)):
        own = [row for row in rows if row[by] == kind]
        for line, (name, label) in zip(styles, up, strict=False):
            shown = [np.nan if row[name] is None else row[name] for row in own]
            said = f"{kind:g} {label}"
            axes.plot([row[across[0]] for row in own], shown, line, color=charts.series(number), label=said)
    charts.add_key(figure, axes.lines[1:])
    return figure


def fields_of(setting: Setting, fields: Sequence[float] | None, shares: Sequence[float]) -> list[float]:
    """Return the fields given, or shares of the widest [degrees]."""
    return default_fields(setting, shares) if fields is None else list(fields)


# Seidel sums: the five monochromatic aberrations of third order and the two of colour, surface by surface.

SEIDEL = ("spherical", "coma", "astigmatism", "petzval", "distortion", "axial_colour", "lateral_colour")
WAVES = np.array([1 / 8, 1 / 2, 1 / 2, 1 / 4, 1 / 2, 1 / 2, 1.0])  # W040, W131, W222, W220P, W311, W020, W111 of sums
ACROSS_FILM = np.array([1 / 2, 3 / 2, 1.0, 1 / 2, 1 / 2, 1.0, 1.0])  # of the marginal ray on the film, times n'u'
UNITS = ("sums", "waves", "transverse")


def seidel(
    setting: Setting, field_degrees: float | None, wavelengths_nm: Sequence[float], *, unit: str
) -> charts.Measured:
    """Return the Seidel sums of each surface and of the lens (Welford, Aberrations of Optical Systems, chapters 8-10).

    In millimetres; in waves (W040, W131, W222, W220P, W311, W020 and W111 of colour); or as the ray through the upper
    edge of the pupil falls on the film, less than it would [um], where astigmatism is that between both foci.
    """
    lens, nm = setting.lens, setting.wavelength_nm
    degrees = default_fields(setting)[-1] if field_degrees is None else field_degrees
    if not lens.is_rotational or lens.fold is not None:
        raise InputError(f"{lens.name}: Seidel sums are known of lenses that are alike from every azimuth")
    marginal, chief = paraxial_rays(setting, degrees)
    indices = lens.senses * lens.indices(nm)
    colour = lens.senses * (lens.indices(min(wavelengths_nm)) - lens.indices(max(wavelengths_nm))) / indices
    lagrange = indices[0] * (marginal[0, 1] * chief[0, 0] - chief[0, 1] * marginal[0, 0])
    sums = np.array([
        _seidel_of(surface, marginal[k : k + 2], chief[k : k + 2], indices[k : k + 2], colour[k : k + 2], lagrange)
        for k, surface in enumerate(lens.surfaces)
    ])  # fmt: skip
    converging = indices[-1] * marginal[-1, 1]
    if unit == "transverse" and abs(converging) < 1e-12:
        raise InputError(f"{lens.name}: brings light to no focus, so its aberrations have no size on a film")
    scale = {"sums": np.ones(7), "waves": WAVES * 1e6 / nm, "transverse": ACROSS_FILM * 1e3 / converging}[unit]
    rows: list[Row] = [
        {"surface": k if k < len(sums) else None, **dict(zip(SEIDEL, values, strict=True))}
        for k, values in enumerate((np.vstack([sums, sums.sum(axis=0)]) * scale).tolist())
    ]
    word = {"sums": "[mm]", "waves": "[waves]", "transverse": "[µm]"}[unit]
    title = f"{lens.name}: Seidel sums at {degrees:g}°"
    return result_of(
        setting, "Seidel sums", rows, lambda: _seidel_chart(title, word, rows), f"{lens.name}, at {degrees:g}°, {word}",
        field_degrees=degrees, unit=unit, lagrange_invariant_mm=float(lagrange),
    )  # fmt: skip


def paraxial(setting: Setting, field_degrees: float | None) -> charts.Measured:
    """Return the marginal and the chief ray to first order on each surface, and on the film."""
    degrees = default_fields(setting)[-1] if field_degrees is None else field_degrees
    marginal, chief = paraxial_rays(setting, degrees)
    names = ("marginal_mm", "marginal_slope", "chief_mm", "chief_slope")
    table = np.hstack([marginal, chief])
    rows: list[Row] = [
        {"surface": k, **dict(zip(names, row, strict=True))} for k, row in enumerate(table[:-1].tolist())
    ]
    height, slope, chief_height, chief_slope = table[-1].tolist()
    if setting.film_distance_mm is not None:
        film = setting.lens.sense * setting.film_distance_mm
        at_film = (height + film * slope, slope, chief_height + film * chief_slope, chief_slope)
        rows.append({"surface": None, **dict(zip(names, at_film, strict=True))})
    title = f"{setting.lens.name}: first-order rays at {degrees:g}°"

    @charts.styled()
    def chart() -> Figure:
        chief_mm, marginal_mm = ([row[name] for row in rows] for name in ("chief_mm", "marginal_mm"))
        words = "height of the chief ray [mm]", "height of the marginal ray [mm]"
        figure, axes = charts.new_chart(title, words, (min(chief_mm), max(chief_mm)))
        axes.plot(chief_mm, marginal_mm, "o-", color=charts.series(0))
        for row in rows:
            where = "film" if row["surface"] is None else str(row["surface"])
            axes.annotate(where, (row["chief_mm"], row["marginal_mm"]), (4, 4), textcoords="offset points")
        return figure

    return result_of(
        setting, "first-order rays", rows, chart, f"{setting.lens.name}, at {degrees:g}°", field_degrees=degrees
    )


def paraxial_rays(setting: Setting, field_degrees: float) -> tuple[Array, Array]:
    """Return the marginal and the chief ray to first order: (height, slope) on each surface, and behind the last one.

    Rows (surfaces + 1, 2): the height on the surface and the slope before it; last the height on the last surface and
    the slope behind it. The marginal ray goes through the upper edge of the entrance pupil.
    """
    lens, pupil = setting.lens, setting.lens.first_order(setting.wavelength_nm).entrance_pupil
    far, tangent = math.isinf(setting.object_distance_mm), math.tan(math.radians(field_degrees))
    away = setting.object_distance_mm + pupil.distance_mm
    slope = 0.0 if far else pupil.diameter_mm / 2 / away
    ray = np.array([[pupil.diameter_mm / 2 - slope * pupil.distance_mm, slope], [0.0, tangent]])
    if not far:  # from the object at -tangent times its distance, through the middle of the pupil
        ray[1, 1] = tangent * setting.object_distance_mm / away
    ray[1, 0] = -pupil.distance_mm * ray[1, 1]
    indices, rays = lens.senses * lens.indices(setting.wavelength_nm), [ray]
    for k, surface in enumerate(lens.surfaces):
        power = surface.paraxial_curvature() * (indices[k + 1] - indices[k])
        slopes = (indices[k] * ray[:, 1] - power * ray[:, 0]) / indices[k + 1]
        last = k + 1 == len(lens.surfaces)
        ray = np.stack([ray[:, 0] + (0.0 if last else surface.thickness) * slopes, slopes], axis=1)
        rays.append(ray)
    both = np.array(rays)
    return both[:, 0], both[:, 1]


def _seidel_of(
    surface: Surface, marginal: Array, chief: Array, indices: Array, colour: Array, lagrange: float
) -> list[float]:
    """Return the sums of one surface, of the rays (height, slope) before it and, of slope alone, behind it."""
    if any(power in (1, 3) for power, _ in surface.aspheric):
        raise InputError("Seidel sums are not known of aspheres with r and r^3")
    (y, u), (y_chief, u_chief), c = marginal[0], chief[0], surface.paraxial_curvature()
    a, a_chief = indices[0] * (u + y * c), indices[0] * (u_chief + y_chief * c)
    bend = marginal[1, 1] / indices[1] - u / indices[0]
    petzval = -(lagrange**2) * c * float(np.diff(1 / indices)[0])
    skew = a_chief * y - lagrange
    distortion = -a_chief * (
        a_chief**2 * y * float(np.diff(1 / indices**2)[0]) - skew * y_chief * c * float(np.diff(1 / indices)[0])
    )
    fourth = (1 + surface.conic) * surface.curvature**3 + 8 * sum(k for power, k in surface.aspheric if power == 4)
    aspheric = (fourth - c**3) * float(np.diff(indices)[0])
    return [
        -a * a * y * bend + aspheric * y**4,
        -a * a_chief * y * bend + aspheric * y**3 * y_chief,
        -a_chief * a_chief * y * bend + aspheric * y**2 * y_chief**2,
        petzval,
        distortion + aspheric * y * y_chief**3,
        a * y * float(np.diff(colour)[0]),
        a_chief * y * float(np.diff(colour)[0]),
    ]


@charts.styled()
def _seidel_chart(title: str, unit: str, rows: Sequence[Row]) -> Figure:
    """Return bars of each aberration over the surfaces, and of their sums."""
    figure, axes = charts.new_chart(title, ("surface", unit), (-0.5, len(rows) - 0.5))
    width, bars = 0.8 / len(SEIDEL), list[Any]()
    for number, name in enumerate(SEIDEL):
        places = np.arange(len(rows)) + (number - len(SEIDEL) // 2) * width
        bars.append(
            axes.bar(
                places, [row[name] for row in rows], width, color=charts.series(number), label=name.replace("_", " ")
            )
        )
    axes.axhline(0.0, color=charts.INK, linewidth=0.8)
    axes.set_xticks(range(len(rows)), [*map(str, range(len(rows) - 1)), "sum"])
    charts.add_key(figure, bars)
    return figure


# Where chief rays meet the film, against an ideal projection: distortion, and between wavelengths lateral colour.

DistortionRow = dict[str, float | None]

# Film height per focal length at an angle, and in words (Kingslake, A History of the Photographic Lens; ISO 17850).
PROJECTIONS: dict[str, tuple[Callable[[float], float], str]] = {
    "tan": (math.tan, "f tan(angle)"),
    "theta": (lambda angle: angle, "f angle"),
    "stereographic": (lambda angle: 2 * math.tan(angle / 2), "2 f tan(angle / 2)"),
    "equisolid": (lambda angle: 2 * math.sin(angle / 2), "2 f sin(angle / 2)"),
    "orthographic": (math.sin, "f sin(angle)"),
}
NARROW = 30.0  # degrees up to which all projections are alike, and f tan(angle) is what is meant
RECTILINEAR = 0.1  # largest distortion of a lens that counts as keeping lines straight, as a share of the height
DISTORTION_ACROSS = 48  # rays across a beam whose middle is sought
BARREL = 90.0  # degrees at which f tan(angle) has no height


def followed_projection(setting: Setting, fields: Sequence[float]) -> str:
    """Return the projection that a lens follows best over fields [degrees], by its chief rays.

    "tan" for narrow fields, and for lenses that keep lines straight within a tenth of the height: they are meant to.
    """
    widest = max(map(abs, fields))
    if widest <= NARROW:
        return "tan"
    heights = {degrees: film_height(setting, degrees, setting.wavelength_nm) for degrees in fields if degrees}
    seen = {degrees: height for degrees, height in heights.items() if height is not None}
    if not seen or max(map(abs, seen)) <= NARROW:
        return "tan"
    off = {}
    for name in PROJECTIONS:
        ideals = {degrees: ideal_height(setting, degrees, name) for degrees in seen}
        errors = [
            math.inf if (ideal := ideals[degrees]) is None else abs(height / ideal - 1)
            for degrees, height in seen.items()
        ]
        off[name] = max(errors)
    return "tan" if off["tan"] <= RECTILINEAR else min(off, key=lambda name: off[name])


def ideal_height(setting: Setting, field_degrees: float, projection: str) -> float | None:
    """Return the film height [mm] that a projection gives a field, by the lens's focal length and magnification.

    None where it gives none: f tan(angle) from 90 degrees on, f sin(angle) beyond.
    """
    if projection not in PROJECTIONS:
        raise InputError(f"projection must be one of {', '.join(PROJECTIONS)} (got {projection!r})")
    first = setting.lens.first_order(setting.wavelength_nm)
    angle = math.radians(field_degrees)
    if (projection == "tan" and abs(field_degrees) >= BARREL) or (
        projection == "orthographic" and abs(field_degrees) > BARREL
    ):
        return None
    spread = PROJECTIONS[projection][0](angle)
    if math.isinf(setting.object_distance_mm):
        return first.front_focal_length_mm * spread
    # Newton: magnification f / x, x from the object plane to the front focal point
    to_focal_point = setting.object_distance_mm + first.front_focal_distance_mm
    return first.front_focal_length_mm / to_focal_point * setting.object_distance_mm * spread


def film_height(setting: Setting, field_degrees: float, wavelength_nm: float) -> float | None:
    """Return the film height of the chief ray [mm]; None when something blocks it.

    Where no ray of the field reaches the centre of the stop, as at the edge of a fisheye's field, that of the middle of
    what passes.
    """
    try:
        _, rays = chief_ray(setting.lens, field_degrees, wavelength_nm, setting.object_distance_mm)
    except InputError:
        return _beam_height(setting, field_degrees, wavelength_nm)
    if not rays.passed[0]:
        return None
    return float(at_plane(rays.origins, rays.directions, setting.film_z)[0, 1])


def _beam_height(setting: Setting, field_degrees: float, wavelength_nm: float) -> float | None:
    try:
        _, rays, _ = passing_beam(
            setting.lens, Beam(field_degrees, setting.object_distance_mm), wavelength_nm, DISTORTION_ACROSS
        )
    except InputError:
        return None
    return float(at_plane(rays.origins, rays.directions, setting.film_z)[:, 1].mean())


def distortion_table(
    setting: Setting, fields: Sequence[float], wavelengths_nm: Sequence[float], projection: str
) -> list[DistortionRow]:
    """Return a row for each field and wavelength: height, ideal height, their difference, and lateral colour.

    Lateral colour is the height less that at the wavelength of the setting. A field that nothing reaches has None.

    Raises
    ------
    InputError
        When no ray of any field reaches the stop.
    """
    rows: list[DistortionRow] = []
    for degrees in fields:
        ideal = ideal_height(setting, degrees, projection)
        main = film_height(setting, degrees, setting.wavelength_nm)
        for wavelength in wavelengths_nm:
            height = film_height(setting, degrees, wavelength)
            off = None if height is None or ideal is None else height - ideal
            rows.append(
                {
                    "field_degrees": degrees,
                    "wavelength_nm": wavelength,
                    "height_mm": height,
                    "ideal_mm": ideal,
                    "distortion_mm": off,
                    "distortion_percent": None if off is None or not ideal else 100 * off / ideal,
                    "lateral_colour_um": None if height is None or main is None else 1e3 * (height - main),
                }
            )
    if fields and all(row["height_mm"] is None for row in rows):  # then say why
        chief_ray(setting.lens, fields[0], setting.wavelength_nm, setting.object_distance_mm)
    return rows


@charts.styled()
def distortion_chart(setting: Setting, rows: Sequence[DistortionRow], projection: str) -> Figure:
    """Return distortion over the field, a curve for each wavelength."""
    fields = [row["field_degrees"] or 0.0 for row in rows]
    title = f"{setting.lens.name}: distortion against {PROJECTIONS[projection][1]}"
    labels = ("angle from the axis [degrees]", "distortion [%]")
    figure, axes = charts.new_chart(title, labels, (min(*fields, 0.0), max(*fields, 1e-3)))
    axes.axhline(0.0, color=charts.INK, linewidth=0.8)
    waves = dict.fromkeys(row["wavelength_nm"] or 0.0 for row in rows)
    curves = []
    for wave in waves:
        own = [row for row in rows if row["wavelength_nm"] == wave]
        curves += axes.plot(
            [row["field_degrees"] or 0.0 for row in own],
            [np.nan if row["distortion_percent"] is None else row["distortion_percent"] for row in own],
            marker=".",
            color=charts.wavelength_colour(wave) if len(waves) > 1 else charts.series(0),
            label=f"{wave:g} nm",
        )
    charts.add_key(figure, curves)
    return figure


def distortion(
    setting: Setting, fields: Sequence[float] | None, wavelengths_nm: Sequence[float], projection: str | None
) -> charts.Measured:
    """Return film heights against a projection, by default the one that the lens follows best."""
    film, fields = setting.film, fields_of(setting, fields, FINE)
    name = projection or followed_projection(setting, fields)
    rows = distortion_table(setting, fields, wavelengths_nm, name)
    meant = PROJECTIONS[name][1] + ("" if projection else ", which it follows best")
    return result_of(
        setting, "distortion", rows, lambda: distortion_chart(setting, rows, name),
        f"{setting.lens.name}, film at {film:.6g} mm, against {meant}", projection=name,
    )  # fmt: skip


# How the film darkens from the centre outwards, and which part of that is the pupil's and which is cos^4's.

VignettingRow = dict[str, float | None]


def film_radii(setting: Setting, steps: int, film_radius_mm: float | None = None) -> Array:
    """Return radii from the centre to a film radius [mm], that of the image circle when absent."""
    if film_radius_mm is None:
        film_radius_mm = image_circle(setting.lens, setting.film, setting.wavelength_nm)
    return np.linspace(0.0, film_radius_mm, steps + 1)


def vignetting_table(setting: Setting, radii_mm: Array) -> list[VignettingRow]:
    """Return a row for each film radius.

    Each has the irradiance under a uniform world of unit radiance, the same over that of the centre with its sampling
    error (what half as many rays would change), in stops below it, the angle at which light from the centre of the exit
    pupil arrives, cos^4 of it, the area of the plane of the last vertex through which light passes, and that area over
    the one of the centre.
    """
    values, errors = irradiance_with_error(setting.lens, setting.film, radii_mm, setting.wavelength_nm)
    if not values[0] > 0:
        raise InputError(f"{setting.lens.name}: no light reaches the centre of the film")
    areas = pass_areas(setting.lens, setting.film, radii_mm, setting.wavelength_nm)
    pupil = setting.lens.first_order(setting.wavelength_nm).exit_pupil.distance_mm
    rows: list[VignettingRow] = []
    for radius, value, error, area in zip(*(each.tolist() for each in (radii_mm, values, errors, areas)), strict=True):
        angle = math.atan2(radius, abs(setting.film - pupil)) if math.isfinite(pupil) else 0.0
        relative = value / float(values[0])
        rows.append(
            {
                "film_radius_mm": radius,
                "irradiance": value,
                "relative": relative,
                "relative_error": (error + relative * float(errors[0])) / float(values[0]),
                "stops": math.log2(relative) if relative > 0 else None,
                "angle_degrees": math.degrees(angle),
                "cos4": math.cos(angle) ** 4,
                "pass_area_mm2": area,
                "pass_share": area / float(areas[0]),
            }
        )
    return rows


@charts.styled()
def vignetting_chart(setting: Setting, rows: Sequence[VignettingRow]) -> Figure:
    """Return the curves over the film radius."""
    radii = [row["film_radius_mm"] or 0.0 for row in rows]
    title = f"{setting.lens.name}: light falling off over the film"
    labels = ("distance from the axis on the film [mm]", "of the value at the centre [%]")
    figure, axes = charts.new_chart(title, labels, (0.0, radii[-1]))
    for label, name, colour, line in (
        ("relative irradiance", "relative", charts.series(0), "-"),
        ("area through which light passes", "pass_share", charts.series(1), "--"),
        ("cos^4 of the angle on the film", "cos4", charts.FAINT, ":"),
    ):
        axes.plot(radii, [100 * (row[name] or 0.0) for row in rows], line, color=colour, label=label)
    axes.set_ylim(bottom=0.0)
    charts.add_key(figure, axes.lines)
    return figure


def vignetting(setting: Setting, film_radius_mm: float | None, steps: int) -> charts.Measured:
    """Return how the film darkens from the axis to a radius, that of the image circle when absent."""
    rows = vignetting_table(setting, film_radii(setting, steps, film_radius_mm))
    return result_of(setting, "vignetting", rows, lambda: vignetting_chart(setting, rows))


# How much light of each wavelength a lens lets through along its axis.

GLASS_ALONE = LensTransmission(fresnel=False, coatings=False)
STEPS = 121  # of a curve

TransmittanceRow = dict[str, float | None]


def transmittance_table(setting: Setting, wavelengths_nm: Sequence[float]) -> list[TransmittanceRow]:
    """Return a row for each wavelength.

    Each has the share of light on the axis that is left by the glass alone, as far as its absorption is known, by glass
    and bare surfaces, and by glass and coated surfaces (None when the lens does not say how it is coated); then the
    T-numbers of the last two, of the film in the middle (None without one).
    """
    rows: list[TransmittanceRow] = []
    for wavelength in wavelengths_nm:
        glass, bare, coated = (
            float(axial_transmittance(setting.lens, wavelength, losses)) for losses in (GLASS_ALONE, UNCOATED, COATED)
        )
        known, film = has_coatings(setting.lens), setting.film_distance_mm
        t_bare, t_coated = (
            t_number(setting.lens, film, wavelength, losses) if film is not None and passed > 0 else None
            for passed, losses in ((bare, UNCOATED), (coated if known else 0.0, COATED))
        )
        rows.append(
            {
                "wavelength_nm": wavelength,
                "glass": glass,
                "bare": bare,
                "coated": coated if known else None,
                "t_number_bare": t_bare,
                "t_number_coated": t_coated,
            }
        )
    return rows


@charts.styled()
def transmittance_chart(setting: Setting, rows: Sequence[TransmittanceRow]) -> Figure:
    """Return curves from the shortest to the longest wavelength of the rows."""
    ends = [row["wavelength_nm"] or 0.0 for row in rows]
    low, high = min(ends), max(ends)
    if low == high:
        low, high = low - 1.0, high + 1.0
    waves = np.linspace(low, high, STEPS)
    title, labels = f"{setting.lens.name}: light let through on the axis", ("wavelength [nm]", "transmittance [%]")
    figure, axes = charts.new_chart(title, labels, (low, high), (0.0, 104.0))
    curves = [("glass alone", GLASS_ALONE, charts.FAINT, ":"), ("bare surfaces", UNCOATED, charts.series(1), "--")]
    if has_coatings(setting.lens):
        curves.append(("coated surfaces", COATED, charts.series(0), "-"))
    for label, losses, colour, line in curves:
        axes.plot(waves, 100 * axial_transmittance(setting.lens, waves, losses), line, color=colour, label=label)
    charts.add_key(figure, axes.lines)
    return figure


def transmittance(setting: Setting, wavelengths_nm: Sequence[float]) -> charts.Measured:
    """Return the light let through on the axis."""
    rows = transmittance_table(setting, wavelengths_nm)
    name = setting.lens.name
    return result_of(setting, "transmittance", rows, lambda: transmittance_chart(setting, rows), name)


def glare(
    setting: Setting, wavelengths_nm: Sequence[float], *, film_reflectance: float, barrel_reflectance: float
) -> charts.Measured:
    """Return the veiling glare at wavelengths, in parts of a white film's light."""
    rows = []
    for wavelength in wavelengths_nm:
        light = veiling_glare(
            setting.lens, setting.film, wavelength, film_reflectance=film_reflectance,
            barrel_reflectance=barrel_reflectance,
        )  # fmt: skip
        rows.append({"wavelength_nm": wavelength, **asdict(light)})
    return result_of(setting, "veiling glare", rows, None, f"{setting.lens.name}; parts of a white film's light")


# Ghosts of a lens as a table, and the way of one of them in cross-section.

RAYS = 9  # of the way that is drawn
PHASES = ("to the first reflection", "back", "on to the film")


def way_text(way: tuple[int, ...]) -> str:
    """Return a way by the surfaces that reflect it, as ``6, 3``."""
    return ", ".join(map(str, way))


def ghost_table(ghosts: Ghosts) -> list[dict[str, Any]]:
    """Return a row for each ghost, brightest in the frame first.

    Shares are of the image's light. `focus_mm` is how far behind the film its paraxial image lies; `blur_mm` the
    diameter on the film of a full beam from the axis.
    """
    lit = ghosts.lit
    with_its_film = with_film(lit.lens, lit.film_distance_mm)
    pupil = lit.lens.first_order(lit.wavelength_nm).entrance_pupil.diameter_mm
    rows = []
    for ghost in ghosts.ghosts:
        image = ghost_image(with_its_film, ghost.way, 0.0, lit.wavelength_nm, lit.source.object_distance_mm)
        rows.append({
            "surfaces": list(ghost.way),
            "share_in_frame": ghost.flux_in_frame / ghosts.reference,
            "share": ghost.flux / ghosts.reference,
            "x_mm": ghost.centroid_mm[0],
            "y_mm": ghost.centroid_mm[1],
            "rms_mm": ghost.rms_mm,
            "focus_mm": image.image_distance_mm,
            "blur_mm": abs(image.film_per_height) * pupil,
        })  # fmt: skip
    return rows


def ghost_summary(ghosts: Ghosts) -> dict[str, Any]:
    """Return the sums, the worst ghost and where the light goes, as shares of what enters."""
    account, reference_flux = asdict(ghosts.account), ghosts.reference
    entered = account.pop("entered")
    worst = max(ghosts.ghosts, key=lambda ghost: ghost.flux_in_frame, default=None)
    densest = max(ghosts.ghosts, key=_density, default=None)
    return {
        "image_share": ghosts.image.flux / entered,
        "ghosts_in_frame": sum(ghost.flux_in_frame for ghost in ghosts.ghosts) / reference_flux,
        "ghosts": sum(ghost.flux for ghost in ghosts.ghosts) / reference_flux,
        "shares_are_of": "image" if ghosts.image.flux else "light that enters",
        "worst": None if worst is None else list(worst.way),
        "densest": None if densest is None else list(densest.way),
        "account": {name: value / entered for name, value in account.items()},
    }


def _density(ghost: Any) -> float:
    """Return light over the area of a disk of the same rms radius."""
    return float(ghost.flux_in_frame / max(ghost.rms_mm, 1e-3) ** 2) if ghost.flux_in_frame else 0.0


def draw_ghost(setting: Setting, ghosts: Ghosts, way: tuple[int, ...]) -> charts.Drawing:
    """Return the lens in cross-section with rays of one way: coming, going back and going on in their colours.

    Raises
    ------
    InputError
        When no ray of the cross-section takes that way.
    """
    lit = ghosts.lit
    folded = with_film(lit.lens, lit.film_distance_mm)
    rays = _rays(setting, ghosts, way)
    if not rays:
        raise InputError(f"{setting.lens.name}: no ray of the cross-section is reflected at {way_text(way)}")
    view = drawing.View()
    film = np.array([[setting.film_z, -lit.film_mm[1] / 2], [setting.film_z, lit.film_mm[1] / 2]])
    outline = [drawing.profile(lit.lens, k, "y") for k in range(len(folded.surfaces) - 1)] + drawing.blades(
        lit.lens, "y"
    )
    frame = drawing.Frame.around([*outline, film, *rays], setting)
    picture = charts.Drawing(drawing.WIDTH, frame.height, _title(ghosts, way))
    drawing.draw_glass(picture, frame, setting, view)
    picture.add(charts.Path(frame.axis(), charts.FAINT, 0.8, dash=(10, 3, 2, 3)))
    met = list(steps(way, len(folded.surfaces)))
    ends = [0, *(1 + i for i, step in enumerate(met) if step.reflects), len(met)]
    for ray in rays:
        for number, (start, end) in enumerate(pairwise(ends)):
            picture.add(
                charts.Path(frame.places(ray[start : end + 1]), charts.SERIES[number % len(charts.SERIES)], 0.9)
            )
    drawing.draw_surfaces(picture, frame, setting, view)
    picture.add(charts.Path(frame.places(film), charts.INK, 2.0, note="film"))
    _draw_words(picture, len(way))
    return picture


def _rays(setting: Setting, ghosts: Ghosts, way: tuple[int, ...]) -> list[Array]:
    """Return corners (m, 2), z and height, of rays of the cross-section that take a way to the film."""
    lit = ghosts.lit
    lens = unfold(with_film(lit.lens, lit.film_distance_mm), way)
    at = Setting(lit.lens, setting.film_distance_mm, lit.source.object_distance_mm, lit.wavelength_nm)
    points = fan_points(at, lit.source.field_degrees, "y")
    origins, directions = section_rays(at, lit.source.field_degrees, points, "y")
    passed = np.flatnonzero(lens.trace(origins, directions, lit.wavelength_nm, "scene").passed)
    if not len(passed):
        return []
    chosen = passed[np.unique(np.linspace(0, len(passed) - 1, RAYS).round().astype(int))]
    paths = drawing.ray_paths(lens, origins[chosen], directions[chosen], lit.wavelength_nm, drawing.reference)
    corners = np.moveaxis(paths.points, 0, 1).copy()
    along = lit.lens.from_scene_axes(origins[chosen].T, directions[chosen].T)[1].T
    along = along / np.linalg.norm(along, axis=1)[:, None]
    reach = min(drawing.APPROACH * drawing.size_of(lit.lens), lit.source.object_distance_mm)
    corners[:, 0] = corners[:, 1] - along * reach
    return [line[:, [2, 1]] for line in corners]


def _title(ghosts: Ghosts, way: tuple[int, ...]) -> str:
    ghost = next(ghost for ghost in ghosts.ghosts if ghost.way == way)
    share = ghost.flux_in_frame / ghosts.reference
    return f"{ghosts.lit.lens.name}; reflected at surfaces {way_text(way)}: {share:.2g} of the image's light"


def _draw_words(picture: charts.Drawing, reflections: int) -> None:
    picture.add(charts.Text((drawing.MARGIN, 24), picture.title, 15))
    words = PHASES if reflections == 2 else [f"after {number} reflections" for number in range(reflections + 1)]
    drawing.draw_key(picture, [(charts.SERIES[number % len(charts.SERIES)], word) for number, word in enumerate(words)])
