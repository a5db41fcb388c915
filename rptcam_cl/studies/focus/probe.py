"""Zones of a picture, what the picture of one measures, and what is reported of a search."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, astuple, field, replace
from enum import StrEnum
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.charts import INK, add_key, new_figure, series, styled
from rptcam_cl.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#
# Zones of the film, and what one shows in a focus state.
#
# `Drive` is what moves when a camera focuses; `ProbeRenderer` shows what the zones look like in a state.


@dataclass(frozen=True)
class Zone:
    """A rectangle of the picture, in fractions of its width and height from its left and top edges.

    Attributes
    ----------
    left, right, top, bottom : float
        0 <= left < right <= 1 and 0 <= top < bottom <= 1.
    """

    left: float
    right: float
    top: float
    bottom: float

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the zone, from the left and the top."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2


@dataclass(frozen=True)
class ZoneImage:
    """What a zone shows in one focus state.

    Attributes
    ----------
    parts : (count, height, width, 3) float32 array
        Linear film values, rendered `count` times with independent random numbers.
    samples : int
        Per pixel, of all parts together.
    whole : like parts, or None
        The same in all of the light, where the brightest samples of `parts` are limited.
    """

    parts: NDArray[np.float32]
    samples: int
    whole: NDArray[np.float32] | None = None

    def in_light(self, light: Literal["limited", "whole"]) -> ZoneImage:
        """Return the picture with the limit, or in all of the light, alone."""
        chosen = self.whole if light == "whole" and self.whole is not None else self.parts
        return ZoneImage(chosen, self.samples)

    @property
    def pixels(self) -> NDArray[np.float32]:
        """Mean film values (height, width, 3)."""
        return np.asarray(self.parts.mean(axis=0, dtype=np.float64), np.float32)

    @property
    def luminance(self) -> NDArray[np.float64]:
        """Luminance of each part (count, height, width)."""
        return np.asarray(luminance(self.parts))

    @property
    def variance(self) -> NDArray[np.float64]:
        """Variance of the mean luminance (height, width); each value is rough, their mean over the zone is not."""
        return np.asarray(self.luminance.var(axis=0, ddof=1) / len(self.parts))


_CIRCLES_PER_DIAGONAL = 1500  # circle of confusion: 0.029 mm on 36 x 24 mm, the convention of depth-of-field scales


def circle_of_confusion(scene: Scene) -> float:
    """Return the diameter of a blur that counts as sharp [mm]."""
    return scene.film.diagonal_m() * 1e3 / _CIRCLES_PER_DIAGONAL


class Policy(StrEnum):
    """Which zone the focus is set to, of those in which there is something to focus on."""

    CLOSEST = "closest"
    FARTHEST = "farthest"
    CENTRE = "centre"
    WEIGHTED = "weighted"

    @property
    def by_place(self) -> bool:
        """Whether it depends on where the zones have their focus."""
        return self in (Policy.CLOSEST, Policy.FARTHEST, Policy.WEIGHTED)


def choose_zone(policy: Policy, zones: Sequence[Zone], places: Mapping[int, float]) -> int:
    """Return the zone that decides.

    Parameters
    ----------
    zones
        All of them.
    places
        Where some of them have their focus, rising towards nearer objects.
    """
    match policy:
        case Policy.CLOSEST:
            return max(places, key=lambda zone: places[zone])
        case Policy.FARTHEST:
            return min(places, key=lambda zone: places[zone])
        case Policy.CENTRE:
            return min(places, key=lambda zone: _off_centre(zones[zone]))
        case Policy.WEIGHTED:
            return _weighted_median(zones, places)


def _off_centre(zone: Zone) -> float:
    x, y = zone.centre
    return (x - 0.5) ** 2 + (y - 0.5) ** 2


def _weighted_median(zones: Sequence[Zone], places: Mapping[int, float]) -> int:
    """Return the zone below and above whose focus lie equal weights: area, less towards the corners of the picture."""
    weight = {k: (zones[k].right - zones[k].left) * (zones[k].bottom - zones[k].top) / (1 + 8 * _off_centre(zones[k]))
              for k in places}  # fmt: skip
    half, passed = sum(weight.values()) / 2, 0.0
    ranked = sorted(places, key=lambda zone: places[zone])
    for zone in ranked:
        passed += weight[zone]
        if passed >= half:
            return zone
    return ranked[-1]


#
# Measures of contrast: a number that grows as a zone gets sharper, and where it is greatest.
#
# Most are quadratic: the mean square of what a few linear filters make of the picture. The noise of a Monte Carlo
# picture would add its own square to them. As a probe consists of independent parts, the products of *different*
# parts take the place of squares: noise then adds nothing on the average (`energy`), so that a noisy flat wall
# measures zero.
#
# The luminance is divided by its mean over the zone first and a quadratic surface is taken off, so that exposure,
# vignetting and light that falls off smoothly change nothing.

_TOP_BLOCKS = 3  # of the zone each way, by which tops of curves may differ

Array = NDArray[np.float64]
Filters = Callable[[Array], list[Array]]


@dataclass(frozen=True)
class Estimate:
    """A measure of a zone.

    Attributes
    ----------
    value, error : float
        The measure and its standard error.
    leave_one_out : (parts,) array
        The measure without each of the parts, for errors of what is computed from several measures (jackknife).
    blocks : (n,) array
        What each part of the zone adds to it; none where that is not known.
    """

    value: float
    error: float
    leave_one_out: Array
    blocks: Array = field(default_factory=lambda: np.zeros(0))


def _without_exposure(image: ZoneImage) -> Array | None:
    """Divide the luminance of the parts (count, height, width) by its mean, and take a quadratic off; None if dark."""
    luminance = image.luminance
    mean = float(luminance.mean())
    return without_trend(luminance / mean) if mean > 0 else None


TERMS = 6  # of a quadratic


def without_trend(pictures: Array) -> Array:
    """Take its quadratic trend off each picture (n, height, width): light that falls off would pass for texture."""
    count, height, width = pictures.shape
    surface, flat = _quadratics(height, width), pictures.reshape(count, -1)
    return np.asarray((flat - flat @ surface @ surface.T).reshape(pictures.shape))


@lru_cache(maxsize=16)
def _quadratics(height: int, width: int) -> Array:
    """Return orthonormal quadratics over the pixels of a picture (height * width, TERMS)."""
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    surface, _ = np.linalg.qr(np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).reshape(-1, TERMS))
    return np.asarray(surface)


def energy(filters: Filters) -> Callable[[ZoneImage], Estimate]:
    """Return the measure that is the mean square of the outputs of filters, free of the square of the noise.

    With r_k what a filter makes of part k, of n: the mean of r_j r_k over all pairs j != k, which is
    (|sum r|^2 - sum |r|^2) / (n (n - 1)).
    """

    def measure(image: ZoneImage) -> Estimate:
        parts = _without_exposure(image)
        count = len(image.parts)
        if parts is None:
            return Estimate(0.0, 0.0, np.zeros(count))
        products = np.zeros((_TOP_BLOCKS**2, count, count))
        for output in filters(parts):
            blocks = [
                each.reshape(count, -1)
                for rows in np.array_split(output, _TOP_BLOCKS, axis=1)
                for each in np.array_split(rows, _TOP_BLOCKS, axis=2)
            ]
            products += np.stack([flat @ flat.T for flat in blocks]) / output[0].size
        whole = products.sum(axis=0)
        found = jackknife(count, lambda kept: _mean_of_pairs(whole[np.ix_(kept, kept)]))
        return replace(found, blocks=np.array([_mean_of_pairs(block) for block in products]))

    return measure


def _mean_of_pairs(products: Array) -> float:
    count = len(products)
    return float((products.sum() - np.trace(products)) / (count * (count - 1)))


def jackknife(count: int, of: Callable[[NDArray[np.int64]], float]) -> Estimate:
    """Return a statistic of some parts with its standard error (Tukey 1958).

    Parameters
    ----------
    count
        How many parts there are.
    of
        The statistic of the parts of these indices.
    """
    every = np.arange(count)
    without = np.array([of(np.delete(every, k)) for k in range(count)])
    return Estimate(of(every), _spread(without), without)


def _wavelet(parts: Array) -> list[Array]:
    """Details of three levels of Haar's wavelet (after Yang and Nelson 2003), without decimation at each level."""
    outputs, smooth = [], parts
    for level in range(3):
        step = 1 << level
        if min(smooth.shape[1:]) <= step:
            break
        low_x, high_x = (smooth[:, :, step:] + sign * smooth[:, :, :-step] for sign in (1, -1))
        outputs += [
            (low_x[:, step:] - low_x[:, :-step]) / 4,
            (high_x[:, step:] + high_x[:, :-step]) / 4,
            (high_x[:, step:] - high_x[:, :-step]) / 4,
        ]
        smooth = (low_x[:, step:] + low_x[:, :-step]) / 4
    return outputs


_SPACINGS = (1, 2, 4)  # pixels between the points of a second difference: Nayar and Nakagawa's variable step
BLOCKS = 6  # of the zone each way, whose noise is nearly independent


def sum_modified_laplacian(image: ZoneImage) -> Estimate:
    """Return the mean over the zone of the sum-modified Laplacian (Nayar and Nakagawa 1994), without noise.

    ML = |2 I - I_left - I_right| + |2 I - I_up - I_down|, of neighbours a step apart. The step is 1, 2 and 4 pixels, as
    theirs varies with the size of what is to be seen; pixels are averaged over squares of that side, and the three
    are added. Their sum over a window round each pixel is lost in the mean over the zone. Their threshold keeps out
    what noise makes; here the sign of a difference is that of the *other* parts, so that noise adds nothing on the
    average and no threshold is needed. The error is never below that of a zone with nothing but this noise in it.
    """
    parts = _without_exposure(image)
    count = len(image.parts)
    if parts is None or min(parts.shape[1:]) < 3:
        return Estimate(0.0, 0.0, np.zeros(count))
    differences = _second_differences(parts)
    measure = jackknife(count, lambda kept: sum(float(_sizes(each[kept]).mean()) for each in differences))
    blocks = sum(block_sums(_sizes(each), _TOP_BLOCKS) / each[0].size for each in differences)
    return replace(measure, error=max(measure.error, _error_of_noise(differences)), blocks=np.asarray(blocks))


def _second_differences(parts: Array) -> list[Array]:
    """Return the second differences across and down, at each step that the zone has room for."""
    outputs, smooth, side = [], parts, 1
    for step in _SPACINGS:
        while side < step:
            smooth = smooth[:, :, side:] + smooth[:, :, :-side]
            smooth = (smooth[:, side:] + smooth[:, :-side]) / 4
            side *= 2
        if min(smooth.shape[1:]) <= 2 * step:
            break
        outputs += [
            2 * smooth[:, :, step:-step] - smooth[:, :, : -2 * step] - smooth[:, :, 2 * step :],
            2 * smooth[:, step:-step] - smooth[:, : -2 * step] - smooth[:, 2 * step :],
        ]
    return outputs


def _sizes(parts: Array) -> Array:
    """Return the sizes of what parts show (height, width): each times the sign of the sum of the others."""
    return np.asarray((parts * np.sign(parts.sum(axis=0) - parts)).mean(axis=0))


def _error_of_noise(differences: list[Array]) -> float:
    """Return the standard error of the measure where there is nothing but the noise of some parts.

    Combinations of parts in which what they have in common cancels are parts of noise alone. The sizes that they show
    scatter about 0, and so do the sums over blocks of the zone.
    """
    count = len(differences[0])
    apart = np.eye(count) - 1 / count
    apart = np.linalg.qr(apart)[0][:, : count - 1].T  # orthonormal, and 0 for what is common
    squares = []
    for flipped in range(count - 1):
        signs = np.where(np.arange(count - 1) == flipped, -1.0, 1.0)[:, None]
        sizes = [_sizes(np.tensordot(signs * apart, each, axes=1)) for each in differences]
        blocks = sum(block_sums(each) / each.size for each in sizes)
        squares.append(float(np.square(blocks).sum()))
    return float(np.sqrt(np.mean(squares)))


def block_sums(picture: Array, count: int = BLOCKS) -> Array:
    """Sum a picture over so many blocks each way."""
    rows = np.array_split(picture, count)
    return np.array([block.sum() for row in rows for block in np.array_split(row, count, axis=1)])


_SEEN_BY = 2  # pixels each way that are taken together, as details of an edge are wider and noise is not
BLOCK, _MOST_BLOCKS, _LEAST_BLOCKS = 8, 8, 3  # pixels; of a zone along its shorter side; of its part, each way
_MOST_OF_IT, WORTH = 0.5, 1.5  # least share of a zone's detail, and times as much of it a pixel, that its part has
SURE = 3.0  # standard errors of the noise, of the zone's detail and of its part's


def rich_part(parts: Array, margin: int = 0, axes: Sequence[int] = (0, 1)) -> tuple[int, int, int, int] | None:
    """Find the rectangle of a zone that shows most detail for the pixels to render; None where that is all of it.

    Where a zone has one edge, nearly all its samples show nothing but noise.

    Parameters
    ----------
    parts : (count, height, width) array
        The luminance of the zone, taken `count` times with independent noise.
    margin
        Pixels that have to be rendered round it.
    axes
        Along which details count: 0 across, 1 down.

    Returns
    -------
    tuple or None
        First column, that behind the last, first row, that behind the last.
    """
    height, width = parts.shape[1:]
    side = max(BLOCK, _SEEN_BY * -(-min(height, width) // (_MOST_BLOCKS * _SEEN_BY)))
    rows, columns = height // side, width // side
    if min(rows, columns) < _LEAST_BLOCKS or rows * columns == _LEAST_BLOCKS**2:
        return None
    sums, noises = (np.pad(each.cumsum(0).cumsum(1), ((1, 0), (1, 0))) for each in _detail(parts, axes, side))
    whole, best, found = sums[-1, -1], None, 0.0
    if whole <= SURE * math.sqrt(noises[-1, -1]):
        return None
    most = WORTH * whole / ((height + 2 * margin) * (width + 2 * margin))
    for top, bottom in combinations(range(rows + 1), 2):
        for left, right in combinations(range(columns + 1), 2):
            if min(bottom - top, right - left) < _LEAST_BLOCKS:
                continue
            part, noise = (
                each[bottom, right] - each[top, right] - each[bottom, left] + each[top, left] for each in (sums, noises)
            )
            worth = part / (((bottom - top) * side + 2 * margin) * ((right - left) * side + 2 * margin))
            if part >= _MOST_OF_IT * whole and part > SURE * math.sqrt(noise) and worth > most:
                most, best, found = worth, (left * side, right * side, top * side, bottom * side), part
    if best is None:
        return None
    left, right, top, bottom = best
    own, _ = _detail(parts[:, top:bottom, left:right], axes, side)  # what is as wide as the part is a trend in it
    return best if own.sum() >= _MOST_OF_IT * found else None


def _detail(parts: Array, axes: Sequence[int], side: int) -> tuple[Array, Array]:
    """Return the detail that blocks of a side show, as `energy` without that of the noise, and the noise's variance."""
    count, height, width = parts.shape
    rows, columns, fine = height // side, width // side, side // _SEEN_BY
    shown = without_trend(parts)[:, : rows * side, : columns * side]
    seen = shown.reshape(count, rows * fine, _SEEN_BY, columns * fine, _SEEN_BY).mean(axis=(2, 4))
    found = np.zeros((2, rows, columns))
    for axis in axes:
        step = np.zeros_like(seen)  # between neighbours but one; 0 at the ends
        if axis == 0:
            step[:, :, 1:-1] = seen[:, :, 2:] - seen[:, :, :-2]
        else:
            step[:, 1:-1] = seen[:, 2:] - seen[:, :-2]
        pairs = (step.sum(axis=0) ** 2 - np.square(step).sum(axis=0)) / (count * (count - 1))
        # twice the squared variance, and half as much again for neighbours, which share a picture
        noise = 3.0 * count / (count - 1) * np.square(step.var(axis=0, ddof=1) / count)
        both = np.stack([pairs, noise])
        found += both.reshape(2, rows, fine, columns, fine).sum(axis=(2, 4))
    return found[0], found[1]


def _plain_variance(image: ZoneImage) -> Estimate:
    """Return the variance of the luminance as it is, noise and exposure included: what the rptcam paper maximises."""
    luminance = image.luminance
    return jackknife(len(luminance), lambda kept: float(luminance[kept].mean(axis=0).var()))


@dataclass(frozen=True)
class Measure:
    """A measure of contrast.

    Attributes
    ----------
    of : callable
        The measure of a picture of a zone.
    least : float
        Value at which there is too little to focus on.
    """

    of: Callable[[ZoneImage], Estimate]
    least: float


ROUNDED = 1e-5  # size of details that the rounding of float32 pictures makes, many times over
LEAST_DETAIL = 5e-5  # mean square of the details relative to the mean: 0.7 %
MEASURES: dict[str, Measure] = {
    "variance": Measure(_plain_variance, 0.0),
    "sum_modified_laplacian": Measure(sum_modified_laplacian, ROUNDED),
    "wavelet": Measure(energy(_wavelet), LEAST_DETAIL),
}
BEST = "wavelet"  # by benchmarks/focus_measures.py


@dataclass(frozen=True)
class Probe:
    """What the zones show in one focus state, as measures.

    Attributes
    ----------
    place : float
        Coordinate [mm], see `Drive`; rising towards nearer objects.
    stop : float
        Share of the opening's diameter.
    measures : list of Estimate
        Of each zone.
    reference : float or None
        Coordinate for which the zones are given; None where the film was not scaled with the image.
    scale : float
        Of the image against that place, or else against the lowest one.
    samples : int
        Of all pixels of all zones.
    seconds : float
    images : list of ZoneImage
        What was measured of each zone.
    round : int
        Counts up with each other opening and part of the zones: measures of one round lie on one curve.
    """

    place: float
    stop: float
    reference: float | None
    scale: float
    measures: list[Estimate]
    samples: int
    seconds: float
    images: Sequence[ZoneImage] = ()
    round: int = 0


_DETAIL = 1.5  # power of the image scale by which the contrast between pixels falls: 1 to 2 for natural textures
FLOOR = 0.02  # of the greatest measure: smaller ones say no more than that they are small


@dataclass(frozen=True)
class Peak:
    """The top of a curve.

    Attributes
    ----------
    place : float
        Where it is [mm].
    error : float
        Its standard error, from noise.
    spread : float
        Its standard error by how parts of the zone differ, which know what noise does not: that what they show changes
        with the place, as the borders of the zone cross it.
    width : float
        Distance from it at which the measure is half of its greatest; infinite for a flat curve.
    rise : float
        By how many of its standard errors the greatest measure exceeds the least.
    inside : bool
        Whether the greatest measure has lesser ones on both sides.
    """

    place: float
    error: float
    width: float
    rise: float
    inside: bool
    spread: float = 0.0

    @property
    def uncertainty(self) -> float:
        """Its standard error: the greater of the two, as each is blind to a part of what the other sees [mm]."""
        return max(self.error, self.spread)


def peak_of(probes: Sequence[Probe], zone: int) -> Peak:
    """Return the top of the curve through some probes at one stop, for one zone.

    A blur of diameter b takes the share 1 / (1 + (b / b0)^2) or so of the contrast of a texture of many scales, and b
    grows evenly with the distance from the focus. So a parabola is laid through the *reciprocal* of the measure, at the
    greatest and its neighbours. The error is that of the jackknife over the parts, which the probes have in common.

    Where the film is scaled with the image, the blur grows evenly on that film with d / scale, d being the distance
    from the place of reference; as the scale is 1 + k d, the parabola is laid over d / (1 + k d). Where it is not, the
    details that pixels see shrink as the image grows.
    """
    probes = sorted(probes, key=lambda probe: probe.place)
    scale = np.array([probe.scale for probe in probes])
    is_scaled = probes[0].reference is not None
    origin = probes[0].reference or 0.0
    away = np.array([probe.place for probe in probes]) - origin
    growth = _growth(away, scale) if is_scaled else 0.0
    places = away / (1 + growth * away)
    gain = np.ones_like(scale) if is_scaled else scale**_DETAIL
    values = gain * [probe.measures[zone].value for probe in probes]
    without = gain[:, None] * [probe.measures[zone].leave_one_out for probe in probes]
    top = int(values.argmax())
    inside = 0 < top < len(probes) - 1
    three = np.arange(max(min(top - 1, len(probes) - 3), 0), min(max(top + 2, 3), len(probes)))
    place, width = _vertex(places[three], values[three])
    others = np.array([_vertex(places[three], values)[0] for values in without[three].T])
    error = _spread(others)
    spread = 0.0
    if all(len(probes[k].measures[zone].blocks) for k in three):
        blocks = gain[three, None] * [probes[k].measures[zone].blocks for k in three]
        rest = blocks.sum(axis=1, keepdims=True) - blocks
        spread = _spread(np.array([_vertex(places[three], each)[0] for each in rest.T]))
    bottom = int(values.argmin())
    difference = _spread(without[top] - without[bottom])
    rise = float((values[top] - values[bottom]) / difference) if difference > 0 else np.inf
    unscaled = 1 - growth * place
    return Peak(
        place=origin + place / unscaled, error=error / unscaled**2, width=width, inside=inside,
        rise=rise if values[top] > values[bottom] else 0.0, spread=spread / unscaled**2,
    )  # fmt: skip


def _growth(away: Array, scale: Array) -> float:
    """Return by how much the scale grows with the distance from the place of reference [1/mm]."""
    farthest = int(np.abs(away).argmax())
    return float((scale[farthest] - 1) / away[farthest]) if away[farthest] else 0.0


def _spread(without: Array) -> float:
    """Return the standard error of a statistic from its values without each of the parts."""
    count = len(without)
    return float(np.sqrt((count - 1) / count * np.square(without - without.mean()).sum()))


def _vertex(places: Array, values: Array) -> tuple[float, float]:
    """Return where the reciprocal of three values is least, not beyond the places, and the half width there."""
    top = int(values.argmax())
    if len(places) < 3 or not values[top] > 0:
        return float(places[top]), np.inf
    middle, reach = places[top], float(np.ptp(places))
    reciprocal = values[top] / np.maximum(values, FLOOR * values[top])
    a, b, c = np.linalg.solve(np.vander((places - middle) / reach, 3), reciprocal)
    if not a > 0:
        return float(middle), np.inf
    at = float(np.clip(middle - reach * b / (2 * a), places.min(), places.max()))
    least = max(c - b * b / (4 * a), 1e-6)
    return at, reach * float(np.sqrt(least / a))


# What an autofocus found and what it took: as data, and drawn over the film distance.


class NoContrast(InputError):  # noqa: N818  (a refusal, as photographers call it)
    """Focus and blur cannot be distinguished in the zone; the camera stays as it was.

    Attributes
    ----------
    is_flat : bool
        Whether no detail was seen at all, rather than none that tells sharp from blurred.
    """

    def __init__(self, message: str, *, is_flat: bool = False) -> None:
        super().__init__(message)
        self.is_flat = is_flat


class OutOfReach(InputError):  # noqa: N818  (the same)
    """What the zone shows is nearer than the camera can focus, or farther.

    Attributes
    ----------
    state : float
        The end of the focus that comes nearest to it.
    zone : Zone
        What shows it.
    """

    def __init__(self, message: str, state: float, zone: Zone) -> None:
        super().__init__(message)
        self.state, self.zone = state, zone


@dataclass(frozen=True)
class ProbeRecord:
    """One probe through the lens.

    Attributes
    ----------
    state : float
        Focus state, see `Drive`.
    film_distance_mm : float
        Distance to the film in that state.
    value, error : float
        Measure and its standard error, of the chosen zone.
    stop : float
        Share of the opening's diameter.
    samples : int
        Of all pixels of all zones.
    seconds : float
        Wall clock.
    quantity : str
        What the value is: a contrast, the displacement of the pupil's halves [pixels], or a distance [m].
    round : int
        Of a contrast, see `Probe`.
    """

    state: float
    film_distance_mm: float
    value: float
    error: float
    stop: float
    samples: int
    seconds: float
    quantity: Literal["contrast", "displacement", "distance"] = "contrast"
    round: int = 0


@dataclass(frozen=True)
class FocusReport:
    """The focus that was found.

    Attributes
    ----------
    method : str
    state : float
        Focus state, see `Drive`.
    film_distance_mm : float
        Last vertex (thin lens: lens) to film.
    focus_distance_m : float or None
        Plane in focus to film by first-order optics (thin lens: to the lens); None where none is.
    confidence : float
        Probability, from 0 to 1, that the state lies within a quarter of the depth of focus of where the measure is
        greatest, as far as noise is concerned.
    error : float
        Standard error of the state's coordinate [mm], from noise.
    depth_of_focus_mm : float
        2 N c along the coordinate.
    zone : Zone
        The chosen zone.
    zones : tuple of Zone
        All of them.
    probes : list of ProbeRecord
        In the order in which they were made.
    notes : dict
        What else the method has to say.
    failure : str or None
        Why the zone cannot be relied on to be in focus; None where it can.
    remarks : tuple of str
        What a photographer should know of the zone all the same.
    """

    method: str
    state: float
    film_distance_mm: float
    focus_distance_m: float | None
    confidence: float
    error: float
    depth_of_focus_mm: float
    zone: Zone
    zones: tuple[Zone, ...] = ()
    probes: list[ProbeRecord] = field(default_factory=list)
    notes: dict[str, Any] = field(default_factory=dict)
    failure: str | None = None
    remarks: tuple[str, ...] = ()

    @property
    def warnings(self) -> list[str]:
        """The failure and the remarks."""
        return [*(() if self.failure is None else (self.failure,)), *self.remarks]

    @property
    def samples(self) -> int:
        """Samples that all probes took together."""
        return sum(probe.samples for probe in self.probes)

    @property
    def seconds(self) -> float:
        """Time that all probes took together [s]."""
        return sum(probe.seconds for probe in self.probes)

    def summary(self) -> dict[str, Any]:
        """Summarise the focus for the metadata of a picture."""
        return {
            "method": self.method,
            "film_distance_mm": self.film_distance_mm,
            "focus_distance_m": self.focus_distance_m,
            "confidence": self.confidence,
            "failure": self.failure,
            "warnings": self.warnings,
            "zone": list(astuple(self.zone)),
            "probes": len(self.probes),
            "samples": self.samples,
        }

    def keep_for_next_frame(self, why: InputError) -> FocusReport:
        """Return the same focus, kept because no better one was found."""
        failure = f"{why}; the focus of the frame before is kept"
        return replace(self, confidence=0.0, probes=[], notes={"kept": True}, failure=failure, remarks=())

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values, with ``probes`` as pairs of film distance and measure."""
        plain = asdict(self)
        plain["probes"] = [[probe.film_distance_mm, probe.value] for probe in self.probes]
        plain["details"] = [asdict(probe) for probe in self.probes]
        plain["samples"], plain["seconds"] = self.samples, self.seconds
        return plain


SIZE = (8.0, 4.6)  # [inches]
FEWEST = 3  # probes that make a curve
_FEWEST_SHIFTS = 1  # probes that show which way the halves part


@styled()
def focus_plot(report: FocusReport, title: str) -> Figure:
    """Plot the probes of an autofocus over the film distance.

    Contrast: on the left every probe and on the right the last ones, each as a share of the greatest of its round.
    Phase: how far apart the halves of the pupil show the zone, zero where it is sharp; of the hybrid on the left, with
    its contrast on the right. Bars are standard errors.

    Raises
    ------
    InputError
        When a method has not probed often enough for a curve.
    """
    from matplotlib.lines import Line2D

    contrast = [probe for probe in report.probes if probe.quantity == "contrast"]
    shifts = [probe for probe in report.probes if probe.quantity == "displacement"]
    if len(contrast) < FEWEST and len(shifts) < _FEWEST_SHIFTS:
        raise InputError(f"--plot: method {report.method} has no curve to draw (it looks {len(report.probes)} times)")
    stops = sorted({probe.stop for probe in report.probes})
    colours = {stop: series(number) for number, stop in enumerate(stops)}
    figure = new_figure(title, SIZE)
    panels = figure.subplots(1, 1 + (len(contrast) >= FEWEST), squeeze=False)[0]
    if shifts:
        _draw_shifts(panels[0], shifts, colours)
    else:
        _draw_contrast(panels[0], contrast, colours)
    if len(contrast) >= FEWEST:
        last = max(probe.round for probe in contrast)
        _draw_contrast(panels[1], [probe for probe in contrast if probe.round == last], colours)
        panels[1].set_title("all probes of contrast" if shifts else "the last probes")
        panels[0].set_title("displacement, in the order of the probes" if shifts else "all probes")
    for axes in panels:
        axes.axvline(report.film_distance_mm, color=INK, linestyle="--", linewidth=1.2)
        axes.set_xlabel("film distance [mm]")
    labels = {stop: "full aperture" if stop == 1 else f"{stop:.2g} of the aperture" for stop in stops}
    keys = [Line2D([], [], color=colours[stop], marker="o", label=label) for stop, label in labels.items()]
    add_key(figure, [*keys, Line2D([], [], color=INK, linestyle="--", label="found")])
    return figure


def _draw_shifts(axes: Axes, probes: Sequence[ProbeRecord], colours: dict[float, str]) -> None:
    """Draw displacements of the halves, numbered in the order of the probes."""
    axes.set_ylabel("displacement of the halves [pixels]")
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.margins(0.12)
    for number, probe in enumerate(probes, 1):
        place, colour = (probe.film_distance_mm, probe.value), colours[probe.stop]
        axes.errorbar(*place, yerr=probe.error, fmt="o", color=colour)
        axes.annotate(str(number), place, xytext=(7, 5), textcoords="offset points")


def _draw_contrast(axes: Axes, probes: Sequence[ProbeRecord], colours: dict[float, str]) -> None:
    """Draw a curve for each round, in shares of its greatest value."""
    axes.set_ylabel("measure, of the greatest [%]")
    for number in sorted({probe.round for probe in probes}):
        own = sorted((probe for probe in probes if probe.round == number), key=lambda probe: probe.film_distance_mm)
        scale, colour = 100 / (max(probe.value for probe in own) or 1.0), colours[own[0].stop]
        places = [probe.film_distance_mm for probe in own]
        values, errors = ([scale * amount for amount in amounts]
                          for amounts in ([probe.value for probe in own], [probe.error for probe in own]))  # fmt: skip
        axes.errorbar(places, values, yerr=errors, fmt="o-", markersize=4, color=colour)
    axes.set_ylim(0.0, 112.0)
