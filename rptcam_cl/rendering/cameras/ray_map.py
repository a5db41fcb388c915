"""A polynomial in place of a lens: from a film point, an aim and a wavelength to the ray that comes out of it.

A lens that looks the same from every azimuth maps two vectors across its axis, the film point x and the place y in the
pupil, to vectors A x + B y, where A and B depend on nothing but x.x, x.y, y.y and the wavelength (Hamilton; Welford,
Aberrations of Optical Systems, 1986, chapter 7). Heights on surfaces and sideways parts of directions are such vectors;
places and directions along the axis are functions of the invariants alone. Each function is fitted by a polynomial of a
total degree, here called the order: vectors then are right to the power 2 order + 1 of film point and pupil; order 1
is the third order of Seidel. (Polynomials in the four coordinates themselves: Hanika and Dachsbacher 2014.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import DISPERSION_SCALE, DISPERSION_SHIFT
from rptcam_cl.core.remember import remember
from rptcam_cl.optics.beams import Crossings, crossings
from rptcam_cl.optics.film_probe import narrowing_probes, pupil_boxes
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import LensTransmission
from rptcam_cl.rendering.cameras.lens_records import FAR_MM, LensRecords, lens_records
from rptcam_cl.rendering.cameras.model import SURFACE_BY_SURFACE
from rptcam_cl.rendering.cameras.pupil import by_content, without_shape
from rptcam_cl.rendering.cameras.setting import CameraMetadata, LensSetting
from rptcam_cl.scene.film import Film
from rptcam_cl.scene.lens_settings import Accuracy

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Exponents = tuple[tuple[int, int, int, int], ...]

LARGEST_ORDER = 4
LARGEST_ERROR_PX = 0.25  # of a ray
_GOOD_ERROR_PX = 0.1  # below which no higher order is tried
_CHEAP_ORDER = 3  # up to which orders hardly cost anything; beyond, any allowed error will do
LARGEST_LIGHT_ERROR = 2e-3  # of a ring of the film
_FILM_POINTS = 48  # along a film radius
AIMS = 224  # of each, in a box round its pupil
BEYOND = 0.04  # of that box, by which it is widened
REACH = 1.06  # of every rim: rays that are fitted
_NEGLIGIBLE = 1e-3  # share of the light of a ring that may be blocked by rims that are left out
COLOURS = 7  # wavelengths that are traced
PARTS = 6  # rings of the film in which the light is compared
NUDGE = 1e-3  # of the film radius, between film points that tell the scale of the picture


@dataclass(frozen=True)
class Variables:
    """How film points, aims and wavelengths become the variables of the polynomials.

    Attributes
    ----------
    film_mm, pupil_mm : float
        What film points and distances of aims from the centre of the pupil are divided by.
    shift : float
        How far that centre moves on the plane of the last vertex, per millimetre of the film point.
    """

    film_mm: float
    pupil_mm: float
    shift: float

    def of(self, film: Array, aims: Array) -> tuple[Array, Array]:
        """Return x and y (n, 2) of film points and aims [mm]."""
        return film / self.film_mm, (aims - self.shift * film) / self.pupil_mm


@dataclass(frozen=True)
class Polynomials:
    """Functions of film point, aim and colour, of one order.

    Attributes
    ----------
    order : int
    colours : bool
        Whether rays have a wavelength.
    vectors : (terms, 2 k) array
        A and B of each of k vectors, side by side.
    numbers : (terms, m) array
        Functions of the invariants.
    """

    order: int
    colours: bool
    vectors: Array
    numbers: Array

    @cached_property
    def exponents(self) -> Exponents:
        """The powers of every term."""
        return exponents(self.order, self.colours)

    def at(self, x: Array, y: Array, colour: Array) -> tuple[Array, Array]:
        """Return the vectors (k, n, 2) and the numbers (m, n)."""
        values = terms(x, y, colour, self.exponents)
        factors = (values @ self.vectors).T[..., None]
        return factors[0::2] * x + factors[1::2] * y, (values @ self.numbers).T


@dataclass(frozen=True)
class RayMap:
    """The polynomials of a lens in use.

    Attributes
    ----------
    variables : Variables
    rays : Polynomials
        Point on the first surface and direction, across the axis as vectors and along it as numbers; z runs towards the
        scene, from the first vertex.
    rims : Polynomials
        Heights on the surfaces that block light.
    surfaces : tuple of int
        Which these are, from the film on.
    error_px : float
        Largest error of a ray that was not fitted [pixels].
    light_error : float
        Largest error of the light that the rims let pass to a ring of the film.
    """

    variables: Variables
    rays: Polynomials
    rims: Polynomials
    surfaces: tuple[int, ...]
    error_px: float = 0.0
    light_error: float = 0.0

    @property
    def multiply_adds(self) -> int:
        """How many a ray takes, about."""
        return sum(each.vectors.size + each.numbers.size for each in (self.rays, self.rims))

    def trace(self, film: Array, aims: Array, colour: Array) -> tuple[Array, Array]:
        """Return points on the first surface and unit directions (n, 3) of rays from film points through aims [mm].

        Parameters
        ----------
        colour
            Inverse wavelengths as `records.DISPERSION_SCALE` has them.
        """
        (point, direction), along = self.rays.at(*self.variables.of(film, aims), colour)
        directions = np.column_stack([direction, along[1]])
        return np.column_stack([point, along[0]]), directions / np.linalg.norm(directions, axis=1, keepdims=True)

    def passes(self, lens: Lens, film: Array, aims: Array, colour: Array) -> Mask:
        """Return which rays the rims of the lens let pass, and its stop in its shape."""
        heights, _ = self.rims.at(*self.variables.of(film, aims), colour)
        cleared = [lens.surfaces[k].clears(*height.T) for k, height in zip(self.surfaces, heights, strict=True)]
        return np.asarray(np.all(cleared, axis=0))


def exponents(order: int, colours: bool) -> Exponents:
    """Return the powers of x.x, x.y, y.y and the colour of every term, as `kernels/lens/ray_map.h` has them."""
    return tuple(
        (i, j, degree - i - j, power)
        for power in range(order + 1 if colours else 1)
        for degree in range(order - power + 1)
        for i in range(degree, -1, -1)
        for j in range(degree - i, -1, -1)
    )


def terms(x: Array, y: Array, colour: Array, powers: Exponents) -> Array:
    """Return the value (n, terms) of every term for film points and places in the pupil (n, 2)."""
    xx, xy, yy = (np.sum(a * b, axis=1) for a, b in ((x, x), (x, y), (y, y)))
    return np.stack([xx**i * xy**j * yy**k * colour**p for i, j, k, p in powers], axis=1)


def ray_map(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelengths_nm: float | tuple[float, float],
    pixels_per_mm: float,
    distances_mm: Sequence[float],
    max_error_px: float = LARGEST_ERROR_PX,
) -> RayMap:
    """Return polynomials that are as right as they are allowed to be, of a low order.

    Orders below `_CHEAP_ORDER` are taken where they are right to `_GOOD_ERROR_PX`.

    Parameters
    ----------
    lens
        Rotationally symmetric; a shape of its stop is not looked at.
    wavelengths_nm
        One, or both ends of a range.
    pixels_per_mm
        On the film.
    distances_mm
        From the first surface, at which rays are compared.
    max_error_px
                Largest allowed error of a ray.

    Raises
    ------
    InputError
        When the lens has no such map, or none that is good enough.
    """
    if not lens.is_rotational:
        raise InputError(f"{lens.name} is not the same from every azimuth")
    if lens.has_mirrors or lens.is_obstructed:
        raise InputError(f"{lens.name} has mirrors or a ring for a pupil")
    radius, nodes = float(np.hypot(*half_film_mm)), _nodes(wavelengths_nm)
    fitted, others = (_Sample.of(lens, film_distance_mm, radius, nodes, seed) for seed in (1, 2))
    passes = others.traced.within(lens)
    if not passes.any():
        raise InputError(f"{lens.name} lets no light through")
    film, aims = others.film[passes], others.aims[passes]
    shift = float(np.sum(aims * film) / np.sum(film**2))
    variables = Variables(radius, float(np.hypot(*(aims - shift * film).T).max()), shift)
    fit = _Fit(fitted, fitted.traced.within(lens, REACH), variables, len(nodes) > 1)
    surfaces = _blocking(lens, others)
    start = RayMap(variables, fit.rays(1), fit.rims(1, surfaces), surfaces)
    with_rims = _with_rims(start, lens, fit, others, passes)

    def error_px(mapped: RayMap) -> float:
        worst = max(_error(mapped, others, passes, distance) for distance in distances_mm)
        return NUDGE * radius * pixels_per_mm * worst

    return _with_rays(with_rims, lens.name, fit, error_px, max_error_px)


def _with_rims(fitted: RayMap, lens: Lens, fit: _Fit, others: _Sample, passes: Mask) -> RayMap:
    """Return a map with rims of the lowest order that gets the light of other rays right."""
    for order in range(1, LARGEST_ORDER + 1):
        fitted = replace(fitted, rims=fit.rims(order, fitted.surfaces))
        fitted = replace(fitted, light_error=_light_error(lens, fitted, others, passes))
        if fitted.light_error <= LARGEST_LIGHT_ERROR:
            return fitted
    error = f"{100 * fitted.light_error:.2g} %"
    raise InputError(f"{lens.name}: polynomials let {error} too much or too little light through")


def _with_rays(
    fitted: RayMap, name: str, fit: _Fit, error_px: Callable[[RayMap], float], max_error_px: float
) -> RayMap:
    """Return a map with rays that are as right as they are allowed to be, of a low order."""
    best = np.inf
    for order in range(1, LARGEST_ORDER + 1):
        mapped = replace(fitted, rays=fit.rays(order))
        error = error_px(mapped)
        if error < best:
            best, fitted = error, replace(mapped, error_px=error)
        if best <= (min(_GOOD_ERROR_PX, max_error_px) if order < _CHEAP_ORDER else max_error_px):
            return fitted
    if best <= max_error_px:
        return fitted
    raise InputError(
        f"{name}: polynomials of degree {2 * LARGEST_ORDER + 1} err by up to {best:.2g} pixels"
        f" (allowed: {max_error_px:.2g})"
    )


def _nodes(wavelengths_nm: float | tuple[float, float]) -> Array:
    """Return the wavelengths [nm] that are traced: of a range, the nodes of Chebyshev in 1 / wavelength."""
    if not isinstance(wavelengths_nm, tuple):
        return np.array([wavelengths_nm])
    ends = 1.0 / np.array(wavelengths_nm)
    inverse = np.cos((np.arange(COLOURS) + 0.5) * np.pi / COLOURS)
    return np.asarray(1.0 / (ends.mean() + inverse * np.ptp(ends) / 2))


@dataclass(frozen=True)
class _Sample:
    """Rays that were traced, of film points along +x."""

    film: Array
    aims: Array
    colour: Array
    traced: Crossings

    @classmethod
    def of(cls, lens: Lens, film_distance_mm: float, radius_mm: float, nodes: Array, seed: int) -> _Sample:
        """Trace rays from film points, even along the radius, through boxes a little wider than their pupils."""
        rng = np.random.default_rng(seed)
        film = np.zeros((_FILM_POINTS, 2))
        film[:, 0] = radius_mm * (np.arange(_FILM_POINTS) + rng.random(_FILM_POINTS)) / _FILM_POINTS
        film[-1, 0] = radius_mm
        boxes, lit = pupil_boxes(narrowing_probes(lens, film_distance_mm, float(nodes.mean())), film, radial=True)
        low, size = boxes[lit, ::2], boxes[lit, 1::2] - boxes[lit, ::2]
        share = rng.random((len(low), AIMS, 2)) * (1 + 2 * BEYOND) - BEYOND
        aims = (low[:, None] + share * size[:, None]).reshape(-1, 2)
        film = np.repeat(film[lit], AIMS, axis=0)
        start = np.column_stack([film, np.full(len(film), lens.film_z(film_distance_mm))])
        away = np.column_stack([aims - film, np.full(len(film), -film_distance_mm)])
        groups = [np.arange(first, len(film), len(nodes)) for first in range(len(nodes))]
        parts = [crossings(lens, start[rows], away[rows], nm) for rows, nm in zip(groups, nodes.tolist(), strict=True)]
        order = np.argsort(np.concatenate(groups))
        traced = Crossings(
            np.concatenate([part.heights for part in parts], axis=1)[:, order],
            np.concatenate([part.origins for part in parts])[order],
            np.concatenate([part.directions for part in parts])[order],
        )
        return cls(film, aims, DISPERSION_SCALE / nodes[np.arange(len(film)) % len(nodes)] - DISPERSION_SHIFT, traced)

    def in_rings(self, which: Mask) -> NDArray[np.int64]:
        """Return how many of some rays each of `PARTS` rings of the film has."""
        radii = self.film[:, 0]
        ring = np.minimum((radii / radii.max() * PARTS).astype(int), PARTS - 1)
        return np.bincount(ring[which], minlength=PARTS)


def _blocking(lens: Lens, sample: _Sample) -> tuple[int, ...]:
    """Return the stop and the fewest surfaces, found one by one, whose rims block all else; from the film on."""
    radii = np.array([surface.semi_diameter for surface in lens.surfaces])[:, None]
    heights = sample.traced.heights
    with np.errstate(invalid="ignore"):
        blocks = ~(np.hypot(heights[..., 0], heights[..., 1]) <= radii)
    passed = sample.in_rings(np.asarray(~blocks.any(axis=0)))
    chosen = [] if lens.stop_index is None else [lens.stop_index]
    left: Mask = np.asarray(blocks.any(axis=0) & ~blocks[chosen].any(axis=0))
    while np.any(sample.in_rings(left) > _NEGLIGIBLE * passed):
        chosen.append(int(np.argmax(np.count_nonzero(blocks[:, left], axis=1))))
        left = left & ~blocks[chosen[-1]]
    return tuple(sorted(chosen, reverse=True))


@dataclass(frozen=True)
class _Fit:
    """Least squares over some of the rays of a sample, those to ``keep``."""

    sample: _Sample
    keep: Mask
    variables: Variables
    colours: bool

    def rays(self, order: int) -> Polynomials:
        """Return the polynomials of points on the first surface and directions."""
        origins, directions = self.sample.traced.origins, self.sample.traced.directions
        vectors = np.stack([origins[:, :2], directions[:, :2]])
        return self._of(order, vectors, -np.stack([origins[:, 2], directions[:, 2]]))

    def rims(self, order: int, surfaces: tuple[int, ...]) -> Polynomials:
        """Return the polynomials of heights on some surfaces."""
        heights = self.sample.traced.heights
        return self._of(order, heights[list(surfaces)], np.empty((0, heights.shape[1])))

    def _of(self, order: int, vectors: Array, numbers: Array) -> Polynomials:
        """Return the polynomials of vectors (k, n, 2) and numbers (m, n)."""
        keep = self.keep
        x, y = self.variables.of(self.sample.film[keep], self.sample.aims[keep])
        powers = exponents(order, self.colours)
        values = terms(x, y, self.sample.colour[keep], powers)
        rows = [np.concatenate([values * x[:, axis, None], values * y[:, axis, None]], axis=1) for axis in (0, 1)]
        targets = np.concatenate([vectors[:, keep, 0], vectors[:, keep, 1]], axis=1).T
        both = np.linalg.lstsq(np.concatenate(rows), targets, rcond=None)[0].reshape(2, len(powers), -1)
        along = np.asarray(np.linalg.lstsq(values, numbers[:, keep].T, rcond=None)[0])
        return Polynomials(order, self.colours, both.transpose(1, 2, 0).reshape(len(powers), -1), along)


def _error(fitted: RayMap, sample: _Sample, passes: Mask, distance_mm: float) -> float:
    """Return the largest distance of a ray from its place, over that of the ray of a film point `NUDGE` farther out."""
    film, aims, colour = sample.film[passes], sample.aims[passes], sample.colour[passes]

    def there(moved_mm: float) -> Array:
        points, directions = fitted.trace(film + np.array([moved_mm, 0.0]), aims, colour)
        return np.asarray(points + distance_mm * directions)

    truth = (sample.traced.origins[passes] + distance_mm * sample.traced.directions[passes]) * (1.0, 1.0, -1.0)
    own = there(0.0)
    step = np.linalg.norm(there(NUDGE * fitted.variables.film_mm) - own, axis=1)
    return float(np.max(np.linalg.norm(own - truth, axis=1) / step))


def _light_error(lens: Lens, fitted: RayMap, sample: _Sample, passes: Mask) -> float:
    """Return the largest share by which the number of rays that pass differs in a ring of the film."""
    own = sample.in_rings(fitted.passes(lens, sample.film, sample.aims, sample.colour))
    true = sample.in_rings(passes)
    lit = true > 0
    return float(np.max(np.abs(own[lit] / true[lit] - 1)))


# How the rays of a realistic camera come through its lens: surface by surface, or by polynomials fitted to that.

REMEMBERED = 64  # lens states whose polynomials are kept


@dataclass(frozen=True)
class LensRays:
    """What a camera's kernel reads of its lens.

    Attributes
    ----------
    kernel : str
        Helper that defines ``camera_ray``.
    surfaces, stop : arrays
        `Surface` records, film side first, and the shape of the stop with the tables of losses.
    facts : dict
        For the compilation.
    table : float32 array
        What stands behind the pupil's table.
    metadata : dict
        What the picture's metadata should say.
    """

    kernel: str
    surfaces: NDArray[np.void]
    stop: NDArray[np.floating]
    facts: dict[str, int]
    table: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    metadata: CameraMetadata = field(default_factory=lambda: CameraMetadata())


def traced_rays(lens: Lens, setting: LensSetting, precision: str, dispersive: bool) -> LensRays:
    """Return the surfaces of a lens, which is that of a setting with its stop in shape."""
    double, losses, wavelength_nm = precision == "double", setting.transmission, setting.camera.wavelength_nm
    records = _records_of(lens, wavelength_nm, double, dispersive, losses)
    surfaces = records.surfaces.copy()
    surfaces[0]["gap"] = setting.film_distance_mm
    records = replace(records, surfaces=surfaces)
    facts = records.facts | ({"LENS_FLOAT64": 1} if double else {})
    return LensRays(SURFACE_BY_SURFACE, records.surfaces, records.stop, facts, metadata={"lens_precision": precision})


@remember(most=REMEMBERED, by=by_content)
def _records_of(
    lens: Lens, wavelength_nm: float, double: bool, dispersive: bool, losses: LensTransmission
) -> LensRecords:
    """Return the records of a lens whose film is yet to be placed."""
    records = lens_records(lens, wavelength_nm, "film", 0.0, double=double, dispersive=dispersive, transmission=losses)
    records.surfaces.flags.writeable = records.stop.flags.writeable = False
    return records


def allowed_px(accuracy: Accuracy | None) -> float:
    """Return the largest allowed error of a fitted ray [pixels], where a camera bears one."""
    return LARGEST_ERROR_PX if accuracy is None else min(accuracy.max_error_px, LARGEST_ERROR_PX)


def fitted_map(
    lens: Lens, setting: LensSetting, film: Film, range_nm: tuple[float, float] | None, max_error_px: float
) -> RayMap:
    """Return the polynomials that stand for a lens as it is set.

    Parameters
    ----------
    lens
        That of the setting; a shape of its stop is not looked at.
    range_nm
        Both ends of the wavelengths of rays, or None where all have the camera's.
    max_error_px
        Largest allowed error of a ray in the plane in focus and far away.

    Raises
    ------
    InputError
        When polynomials cannot stand for the lens, or not well enough.
    """
    camera, traced, film_distance_mm = setting.camera, setting.camera.traced_camera, setting.film_distance_mm
    if setting.transmission:
        raise InputError("camera.rays: fitted rays know no losses (leave out camera.transmission, or use traced)")
    if traced is not None and traced.precision != "single":
        raise InputError("camera.rays: fitted rays are float32 (leave out camera.precision, or use traced)")
    if traced is not None and traced.pupil not in ("auto", "tight"):
        raise InputError(
            "camera.rays: fitted rays hold for the true pupil alone"
            f" (camera.pupil is {traced.pupil}; allowed: auto, tight)"
        )
    width_mm, height_mm = (side * 1e3 for side in film.size_m())
    focus_mm = setting.focus_distance_mm
    near = FAR_MM if focus_mm is None else min(focus_mm - lens.length - lens.sense * film_distance_mm, FAR_MM)
    try:
        return _map(
            without_shape(lens),
            film_distance_mm,
            (width_mm / 2, height_mm / 2),
            camera.wavelength_nm if range_nm is None else range_nm,
            film.resolution[0] / width_mm,
            (near, FAR_MM) if 0 < near < FAR_MM else (FAR_MM,),
            max_error_px,
        )
    except InputError as problem:
        raise InputError(f"camera.rays: {problem}; use traced") from None


def fitted_rays(
    lens: Lens, setting: LensSetting, film: Film, range_nm: tuple[float, float] | None, max_error_px: float
) -> LensRays:
    """Return the polynomials of a lens, as `fitted_map` does."""
    if lens.fold is not None:
        raise InputError(
            f"camera.rays: {lens.name}: its axis is folded, which no polynomials are fitted to (allowed: traced)"
        )
    fitted = fitted_map(lens, setting, film, range_nm, max_error_px)
    records = lens_records(lens, setting.camera.wavelength_nm, "film", setting.film_distance_mm)
    rows = [len(lens.surfaces) - 1 - k for k in fitted.surfaces]
    facts = {
        **{name: value for name, value in records.facts.items() if name in ("LENS_OUTLINE", "LENS_MASK")},
        "MAP_ORDER": fitted.rays.order,
        "MAP_RIM_ORDER": fitted.rims.order,
        "MAP_RIMS": len(fitted.surfaces),
        "MAP_COLOURS": int(fitted.rays.colours),
    }
    metadata: CameraMetadata = {
        "lens_rays": "fitted",
        "lens_degree": 2 * fitted.rays.order + 1,
        "lens_rims": len(fitted.surfaces),
        "lens_error_px": round(fitted.error_px, 4),
        "lens_light_error": round(fitted.light_error, 4),
    }
    return LensRays("camera/fitted.h", records.surfaces[rows], records.stop, facts, _table(fitted), metadata)


def _table(fitted: RayMap) -> NDArray[np.float32]:
    """Return the table of `kernels/lens/ray_map.h`."""
    scales, rays = fitted.variables, np.concatenate([fitted.rays.vectors, fitted.rays.numbers], axis=1)
    head = [1 / scales.film_mm, scales.shift, 1 / scales.pupil_mm, 0.0]
    return np.concatenate([head, rays.ravel(), fitted.rims.vectors.ravel()]).astype(np.float32)


_map = remember(most=REMEMBERED, by=by_content)(ray_map)
