"""Aberrations: ray fans, Zernike coefficients, field curvature, focal shift, spots through focus, Seidel sums."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import charts
from rptcam_cl.optics.beams import Beam, chief_ray, passing_beam, without_obstructions
from rptcam_cl.optics.lens import exchange_axes
from rptcam_cl.optics.ray_trace import Rays, at_plane
from rptcam_cl.optics.spots import NOTHING, STAYS, Setting, default_fields, field_waves, result_of
from rptcam_cl.optics.surface import Surface
from rptcam_cl.optics.waves import MOST_ACROSS, THIRDS_OVER_ALL, ExitRays, PupilFunction, check_wavefront

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rptcam_cl.optics.lens import Lens


SECTIONS = ("y", "x")


def in_section(setting: Setting, section: str) -> Setting:
    """Return the setting, or for fields along x that of the lens with x and y exchanged and the film where it was.

    What is called tangential or y of a result then is along x. A lens that is alike from every azimuth stays itself.
    """
    if section not in SECTIONS:
        raise InputError(f'section: must be "x" or "y" (got {section!r})')
    return replace(setting, lens=exchange_axes(setting.lens)) if section == "x" else setting


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
    return result_of(setting, "ray fans", rows, lambda: _fan_chart(f"{setting.lens.name}: ray fans", rows))


_FAN_PANELS = (
    ("tangential off [µm]", "off_um", 1.0), ("sagittal off [µm]", "off_um", 0.0),
    ("tangential path [waves]", "ahead_waves", 1.0), ("sagittal path [waves]", "ahead_waves", 0.0),
)  # fmt: skip
PANEL, ABOVE = 2.2, 1.2  # heights of a row of charts, and of title and key [inches]


@charts.styled()
def _fan_chart(title: str, rows: Sequence[Row]) -> Figure:
    """Return the fans of each field in a row: off the chief ray on the film, and paths ahead of its own."""
    fields = list(dict.fromkeys(row["field_degrees"] for row in rows))
    figure = charts.new_figure(title, (1.35 * charts.SIZE[0], PANEL * len(fields) + ABOVE))
    panels = figure.subplots(len(fields), 4, squeeze=False, sharex=True)
    for line, degrees in zip(panels, fields, strict=True):
        for axes, (head, name, which) in zip(line, _FAN_PANELS, strict=True):
            axes.axhline(0.0, color=charts.INK, linewidth=0.8)
            own = [row for row in rows if row["field_degrees"] == degrees and row["tangential"] == which]
            for nm in dict.fromkeys(row["wavelength_nm"] for row in own):
                curve = [(row["pupil"], row[name]) for row in own if row["wavelength_nm"] == nm]
                places, values = zip(*curve, strict=True)
                heights = [np.nan if value is None else value for value in values]
                axes.plot(places, heights, color=charts.wavelength_colour(nm), label=f"{nm:g} nm")
            if degrees == fields[0]:
                axes.set_title(head)
        line[0].set_ylabel(f"{degrees:g}°")
    for axes in panels[-1]:
        axes.set_xlabel("place in the beam")
    charts.add_key(figure, panels[0, 0].lines[1:])
    return figure


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
    direction cosines. `rest_waves` is the rms of what they leave, and `error_waves` half of what a third of the cells
    changes any fringe coefficient of the wavefront.
    """
    rows: list[Row] = []
    for wave in field_waves(setting, fields, wavelengths_nm, rays):
        degrees, nm = wave.field_degrees, wave.wavelength_nm
        middle, radius = pupil_circle(setting, degrees, nm)
        terms = [(n, m) for n in range(order + 1) for m in range(-n, n + 1, 2)]
        factors, rest = fit_zernikes(wave, middle, radius, terms)
        moves = [np.abs(fit_zernikes(part, middle, radius, terms)[0] - factors).max() for part in wave.thirds()]
        error = float(max(moves)) / THIRDS_OVER_ALL  # of all terms: what one changes may be nothing by chance
        rows += [
            {"field_degrees": degrees, "wavelength_nm": nm, "n": n, "m": m, "fringe": fringe_number(n, m),
             "noll": noll_number(n, m), "fringe_waves": factor, "error_waves": error, "rest_waves": rest,
             "noll_waves": factor / math.sqrt((n + 1) * (1 if m == 0 else 2))}
            for (n, m), factor in zip(terms, factors.tolist(), strict=True)
        ]  # fmt: skip
    rows.sort(key=lambda row: (row["field_degrees"], row["wavelength_nm"], row["fringe"]))
    return result_of(
        setting, "Zernike coefficients", rows,
        lambda: _curves_over(
            f"{setting.lens.name}: Zernike coefficients (fringe), {wavelengths_nm[0]:g} nm",
            [row for row in rows if row["wavelength_nm"] == wavelengths_nm[0] and row["fringe"] > 1],
            ("fringe", "number of the term"), [("fringe_waves", "degrees")], "waves", "field_degrees", ("o:",),
        ),
    )  # fmt: skip


def pupil_circle(setting: Setting, degrees: float, nm: float) -> tuple[Array, float]:
    """Return middle and radius, in direction cosines, of the circle round what passes along x and y."""
    points, _, _ = passing_beam(setting.lens, Beam(degrees, setting.object_distance_mm), nm, ACROSS)
    height, _ = chief_ray(setting.lens, degrees, nm, setting.object_distance_mm)
    ends = np.tile([0.0, height], (2, 2, 1))
    for axis in (0, 1):
        most = 1.2 * float(np.abs(points[:, axis] - ends[0, 0, axis]).max())
        ends[axis, :, axis] += _edges(setting, degrees, nm, ends[axis, 0].copy(), axis, most)
    traced = _through(setting, setting.lens, degrees, nm, ends.reshape(4, 2)).directions[:, :2].reshape(2, 2, 2)
    sides = np.stack([traced[axis, :, axis] for axis in (0, 1)])
    return np.asarray(sides.mean(axis=1), np.float64), float(np.abs(np.diff(sides, axis=1)).max()) / 2


def fit_zernikes(
    wave: PupilFunction, middle: Array, radius: float, terms: Sequence[tuple[int, int]]
) -> tuple[Array, float]:
    """Return the factors of terms that are 1 at the edge of a circle of direction cosines, and the rms of the rest."""
    lit = wave.coverage > 0
    x, y = np.meshgrid((wave.cosines_x - middle[0]) / radius, (wave.cosines_y - middle[1]) / radius)
    values = np.stack([zernike_term(n, m, x[lit], y[lit]) for n, m in terms], axis=1)
    weight, target = np.sqrt(wave.coverage[lit]), wave.waves_on_sphere[lit]
    factors = np.asarray(np.linalg.lstsq(values * weight[:, None], target * weight, rcond=None)[0], np.float64)
    return factors, float(np.sqrt(np.average((values @ factors - target) ** 2, weights=weight**2)))


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
        lambda: _curves_over(
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
        lambda: _curves_over(
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
        moved = 0.0 if before is None else float(np.max(np.abs(before - sides)))
        rows += [
            {
                "field_degrees": degrees,
                "shift_mm": shift,
                "rms_um": math.hypot(x, y),
                "rms_x_um": x,
                "rms_y_um": y,
                "rms_error_um": None if before is None else 1e3 * moved,
            }
            for shift, x, y in zip(shifts_mm.tolist(), *(1e3 * sides).tolist(), strict=True)
        ]
    title = f"{setting.lens.name}: spots through focus"
    return result_of(
        setting, "spots through focus", rows,
        lambda: _curves_over(
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
def _curves_over(
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
_ACROSS_FILM = np.array([1 / 2, 3 / 2, 1.0, 1 / 2, 1 / 2, 1.0, 1.0])  # of the marginal ray on the film, times n'u'

# Of a lens that is not alike from every azimuth rays of one section know S_III and S_IV as 3 S_III + S_IV alone.
_IN_SECTION = (
    ("spherical", "coma", "tangential", "distortion", "axial_colour", "lateral_colour"),
    (np.array([1 / 8, 1 / 2, 1 / 4, 1 / 2, 1 / 2, 1.0]), np.array([1 / 2, 3 / 2, 1 / 2, 1 / 2, 1.0, 1.0])),
    np.array([[1, 0, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0, 0], [0, 0, 3, 1, 0, 0, 0], [0, 0, 0, 0, 1, 0, 0],
              [0, 0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 0, 1.0]]),
)  # fmt: skip


def seidel(
    setting: Setting, field_degrees: float | None, wavelengths_nm: Sequence[float], *, unit: str
) -> charts.Measured:
    """Return the Seidel sums of each surface and of the lens (Welford, Aberrations of Optical Systems, chapters 8-10).

    In millimetres; in waves (W040, W131, W222, W220P, W311, W020 and W111 of colour); or as the ray through the upper
    edge of the pupil falls beside its place in the first-order image [um], where astigmatism is that between both foci.
    A lens of two sections has the sums that rays of one of them obey; there `tangential` is 3 S_III + S_IV.
    """
    lens, nm = setting.lens, setting.wavelength_nm
    degrees = default_fields(setting)[-1] if field_degrees is None else field_degrees
    if lens.fold is not None or lens.is_split or any(surface.pose for surface in lens.surfaces):
        raise InputError(f"{lens.name}: has no Seidel sums, as surfaces stand beside the axis or tilted (see ray-fan)")
    lens.refuse_phases("Seidel sums are of lenses that refract and reflect alone (see ray-fan)")
    names, unit_factors, mixed = (SEIDEL, (WAVES, _ACROSS_FILM), np.eye(7)) if lens.is_rotational else _IN_SECTION
    marginal, chief = paraxial_rays(setting, degrees)
    indices = lens.senses * lens.indices(nm)
    colour = lens.senses * (lens.indices(min(wavelengths_nm)) - lens.indices(max(wavelengths_nm))) / indices
    lagrange = indices[0] * (marginal[0, 1] * chief[0, 0] - chief[0, 1] * marginal[0, 0])
    for k, surface in enumerate(lens.surfaces):
        if any(power in (1, 3) for power, _ in surface.aspheric):
            raise InputError(f"{lens.name}: surface {k} has r or r^3, of which there are no Seidel sums (see ray-fan)")
    sums = np.array([
        _seidel_of(surface, marginal[k : k + 2], chief[k : k + 2], indices[k : k + 2], colour[k : k + 2], lagrange)
        for k, surface in enumerate(lens.surfaces)
    ]) @ mixed.T  # fmt: skip
    converging = indices[-1] * marginal[-1, 1]
    if unit == "transverse" and abs(converging) < 1e-12:
        raise InputError(f"{lens.name}: brings light to no focus, so its aberrations have no size on a film")
    scale = {"sums": 1.0, "waves": unit_factors[0] * 1e6 / nm, "transverse": unit_factors[1] * 1e3 / converging}[unit]
    rows: list[Row] = [
        {"surface": k if k < len(sums) else None, **dict(zip(names, values, strict=True))}
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
    ray[:, 0] += lens.axial_shifts[0] * ray[:, 1]
    indices, rays = lens.senses * lens.indices(setting.wavelength_nm), [ray]
    for k, surface in enumerate(lens.surfaces):
        power = surface.paraxial_curvature() * (indices[k + 1] - indices[k])
        power += surface.phase.power(setting.wavelength_nm) if surface.phase else 0.0
        slopes = (indices[k] * ray[:, 1] - power * ray[:, 0]) / indices[k + 1]
        following = lens.axial_shifts[k + 1 : k + 2]  # none behind the last
        gap = sum(surface.thickness + shift - lens.axial_shifts[k] for shift in following)
        ray = np.stack([ray[:, 0] + gap * slopes, slopes], axis=1)
        rays.append(ray)
    both = np.array(rays)
    return both[:, 0], both[:, 1]


def _seidel_of(
    surface: Surface, marginal: Array, chief: Array, indices: Array, colour: Array, lagrange: float
) -> list[float]:
    """Return the sums of one surface, of the rays (height, slope) before it and, of slope alone, behind it."""
    (y, u), (y_chief, u_chief), c = marginal[0], chief[0], surface.paraxial_curvature()
    a, a_chief = indices[0] * (u + y * c), indices[0] * (u_chief + y_chief * c)
    bend = marginal[1, 1] / indices[1] - u / indices[0]
    petzval = -(lagrange**2) * c * float(np.diff(1 / indices)[0])
    skew = a_chief * y - lagrange
    distortion = -a_chief * (
        a_chief**2 * y * float(np.diff(1 / indices**2)[0]) - skew * y_chief * c * float(np.diff(1 / indices)[0])
    )
    aspheric = (surface.shape.fourth_order(surface) - c**3) * float(np.diff(indices)[0])
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
    """Return bars of each aberration over the surfaces, and beside them, to a scale of their own, of the sums."""
    figure, names = charts.new_figure(title), [name for name in rows[0] if name != "surface"]
    each, whole = figure.subplots(1, 2, width_ratios=(max(len(rows) - 1, 3), 3))
    width = 0.8 / len(names)
    for axes, shown in ((each, rows[:-1]), (whole, rows[-1:])):
        for number, name in enumerate(names):
            places = np.arange(len(shown)) + (number - (len(names) - 1) / 2) * width
            label = name.replace("_", " ").replace("petzval", "Petzval")
            axes.bar(places, [row[name] for row in shown], width, color=charts.series(number), label=label)
        axes.axhline(0.0, color=charts.INK, linewidth=0.8)
        axes.set_xticks(range(len(shown)), ["sum" if row["surface"] is None else str(row["surface"]) for row in shown])
    each.set(xlabel="surface", ylabel=unit)
    charts.add_key(figure, each.containers)
    return figure
