"""The configurations that are compared, and how their pictures differ, by pairs of seeds."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from itertools import combinations
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.film import TILE, TILE_PIXELS, FilmLayout
from rptcam_cl.scene.load import change_scene, with_camera
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.tier_models import TIERS, Tier, equivalent
from rptcam_cl.studies.tiers import Decision, choose_camera

#
# Which tiles of the film are rendered: all, or some spread evenly, at the resolution of the picture itself.
#
# A picture made smaller would hide what an inaccurate camera does to fine detail; tiles of the true one do not.


@dataclass(frozen=True)
class SpreadTiles:
    """One tile in each cell of a grid over the film.

    Attributes
    ----------
    tiles : (n,) array
        Numbers of the tiles, row by row of the grid.
    shape : (rows, columns)
        Of the grid.
    pixels : (p,) array
        Where their pixels lie in the film's buffer.
    cell : (p,) array
        Which tile of `tiles` a pixel is in.
    weights : (p,) array
        Share of the picture that a pixel stands for; 1 in all.
    all : int
        Tiles that the picture has.
    """

    tiles: NDArray[np.uint32]
    shape: tuple[int, int]
    pixels: NDArray[np.int64]
    cell: NDArray[np.int64]
    weights: NDArray[np.float64]
    all: int

    def some(self, chosen: NDArray[np.int64]) -> SpreadTiles:
        """Return a few of the tiles, by their places in `tiles`; each pixel stands for what it did."""
        of_cell = np.full(len(self.tiles), -1)
        of_cell[chosen] = np.arange(len(chosen))
        cell = of_cell[self.cell]
        kept = cell >= 0
        shape = (1, len(chosen))
        return SpreadTiles(self.tiles[chosen], shape, self.pixels[kept], cell[kept], self.weights[kept], self.all)


def spread_tiles(layout: FilmLayout, most: int, rng: np.random.Generator) -> SpreadTiles:
    """Return at most so many tiles, at a random place in cells of equal size; all where there are no more."""
    across, down = layout.tiles_across, -(-layout.height // TILE)
    columns, rows = across, down
    if across * down > most:
        columns = min(max(round((most * across / down) ** 0.5), 1), across, most)
        rows = min(max(most // columns, 1), down)
    x_edges, y_edges = (np.arange(n + 1) * of // n for n, of in ((columns, across), (rows, down)))
    x = rng.integers(x_edges[:-1], x_edges[1:], size=(rows, columns))
    y = rng.integers(y_edges[:-1, None], y_edges[1:, None], size=(rows, columns))
    tiles = (y * across + x).ravel().astype(np.uint32)
    cells = np.outer(np.diff(y_edges), np.diff(x_edges)).ravel()
    buffer = (tiles[:, None].astype(np.int64) * TILE_PIXELS + np.arange(TILE_PIXELS)).ravel()
    inside = layout.inside[buffer]
    cell = np.repeat(np.arange(len(tiles)), TILE_PIXELS)
    full = len(tiles) == across * down
    weights = np.ones(len(cell)) if full else cells[cell] / layout.pixels_of_tile[tiles][cell].clip(1)
    weights = weights[inside] / weights[inside].sum()
    return SpreadTiles(tiles, (rows, columns), buffer[inside], cell[inside], weights, layout.tiles)


# The configurations that are compared: the most accurate one of a scene, and others with one thing changed.

PARTS = ("film", "camera", "exposure", "shutter", "spectrum", "render")
NOT_SAID = ("spp", "layers")  # keys of `render` that do not change the configuration


def settings(scene: Scene, wanted: Scene) -> tuple[str, ...]:
    """Return the arguments of ``rptcam render --set`` that turn one scene into another; only such keys may differ."""
    return tuple(text for part in PARTS for text in _of_part(part, getattr(scene, part), getattr(wanted, part)))


def _of_part(part: str, own: Any, wanted: Any) -> list[str]:
    values = wanted.model_dump(mode="json", exclude_none=True)
    if type(own) is type(wanted):
        apart = [name for name in type(own).model_fields if getattr(own, name) != getattr(wanted, name)]
        return [_override_text(f"{part}.{name}", values.get(name)) for name in apart if name not in NOT_SAID]
    given = {name: values[name] for name in values if name in wanted.model_fields_set | {"kind"}}
    gone = [f"{part}.{name}=null" for name in own.model_fields_set if name not in given]
    apart = [name for name in given if getattr(own, name, None) != getattr(wanted, name)]
    by_key = [*gone, *(_override_text(f"{part}.{name}", given[name]) for name in apart)]
    return min(by_key, [_override_text(part, given)], key=lambda texts: len(" ".join(texts)))


def _override_text(path: str, value: Any) -> str:
    return f"{path}={value if isinstance(value, str) else json.dumps(value)}"


REFERENCE = "full"
AS_IT_IS = "as the scene says"
PUPILS = ("rear", "thick", "bounds")  # beside the outline of the pupil itself, which the reference has
SHORT_DEPTHS = (2, 4)  # edges: direct light alone, and two bounces more


@dataclass(frozen=True)
class Variant:
    """One configuration in which a scene is rendered.

    Attributes
    ----------
    name : str
    knob : str
        What differs from the most accurate one; empty for that one itself.
    scene : Scene
    tier : str
        Camera model, one of `tiers.TIERS`; empty for a camera without a lens of surfaces.
    unbiased : bool
        Whether the change affects only the noise, not the mean of the picture.
    settings : tuple of str
        Arguments of ``rptcam render --set`` that give this configuration.
    same_as : tuple of str
        Names of other configurations that give the same picture.
    """

    name: str
    knob: str
    scene: Scene
    tier: str = ""
    unbiased: bool = False
    settings: tuple[str, ...] = ()
    same_as: tuple[str, ...] = ()

    def with_name_of(self, other: Variant) -> Variant:
        """Return it with the name of an equal configuration added, and the shorter settings of the two."""
        shorter = min(self.settings, other.settings, key=lambda texts: len(" ".join(texts)))
        return replace(self, settings=shorter, same_as=(*self.same_as, other.name))


def ladder(scene: Scene) -> tuple[list[Variant], dict[str, str], Decision | None]:
    """Make the configurations of a scene; their plans may show that some are equal.

    Returns
    -------
    configurations : list of Variant
        The most accurate first.
    skipped : dict
        Why a configuration is missing, by its name.
    decision : Decision or None
        What `camera.accuracy: auto` would choose; None for a camera without a lens of surfaces.
    """
    reference = most_accurate(scene)
    full, camera = reference.scene, reference.scene.camera
    variants, skipped = [replace(reference, settings=settings(scene, full))], {}
    decision = None

    def add(name: str, knob: str, make: Callable[[], Scene], *, unbiased: bool = False, tier: str = "") -> None:
        """Add what a scene becomes as requested, before `camera.accuracy` chooses a camera model."""
        try:
            requested = make()
            made = choose_camera(requested).scene
        except InputError as problem:
            skipped[name] = str(problem)
        else:
            texts = settings(scene, requested)
            variants.append(Variant(name, knob, made, tier or reference.tier, unbiased, texts))

    add(AS_IT_IS, "scene", partial(_without_layers, scene))
    if camera.traced_camera is not None:
        decision = choose_camera(change_scene(full, camera={"accuracy": "auto"}))
        for tier in reversed(TIERS[:-1]):
            add(name_of(tier), "camera", partial(equivalent, full, tier), tier=tier)
        add("lens: float64", "precision", partial(change_scene, full, camera={"precision": "double"}))
        for pupil in PUPILS:
            add(f"pupil: {pupil}", "pupil", partial(change_scene, full, camera={"pupil": pupil}), unbiased=True)
    if camera.ideal_lens is not None and camera.field_of_view is not None:
        add("pinhole", "camera", partial(_without_lens, full))
    for mode in ("dispersive", "rgb"):
        add(f"spectrum: {mode}", "spectrum", partial(_with_mode, full, mode))
    for depth in SHORT_DEPTHS:
        if depth < full.render.max_depth:
            add(f"depth {depth}", "depth", partial(change_scene, full, render={"max_depth": depth}))
    independent = partial(change_scene, full, render={"sampler": "independent"})
    add("independent samples", "sampler", independent, unbiased=True)
    if decision is not None:
        cheap = change_scene(scene, camera={"accuracy": "auto"})
        add("accuracy: auto", "combination", partial(_without_layers, cheap), tier=decision.tier)
    return variants, skipped, decision


def name_of(tier: Tier) -> str:
    """The name of a camera model for readers."""
    return "fitted rays" if tier == "fitted" else tier.replace("_", " ")


def most_accurate(scene: Scene) -> Variant:
    """Return the most accurate configuration of a scene.

    Every ray goes through every surface and aims at the pupil's outline. The lens refracts each wavelength separately
    unless the spectrum is RGB. Nothing is clamped. The lens is traced in float32, because float64 has shown no
    difference in the mean.
    """
    plain = change_scene(scene, render={"clamp": None, "noise": None, "layers": (), "sampler": "lattice"})
    if scene.camera.traced_camera is None:
        return Variant(REFERENCE, "", plain)
    plain = change_scene(plain, camera={"accuracy": None, "pupil": "auto", "rays": "traced", "precision": "single"})
    if plain.spectrum.mode != "rgb":
        plain = change_scene(plain, spectrum={"lens": "on"})
    return Variant(REFERENCE, "", plain, "realistic")


def _without_layers(scene: Scene) -> Scene:
    return change_scene(scene, render={"noise": None, "layers": ()})


def _without_lens(scene: Scene) -> Scene:
    """Return a scene with a pinhole in place of its thin lens."""
    names = ("eye", "target", "up", "flip", "motion", "fov_degrees", "fov_axis")
    return with_camera(scene, {name: getattr(scene.camera, name) for name in names} | {"kind": "pinhole"})


def _with_mode(scene: Scene, mode: str) -> Scene:
    if mode == "dispersive" and scene.spectrum.mode != "spectral":
        return scene
    return change_scene(scene, spectrum={"mode": mode, "lens": "off" if mode == "rgb" else "on"})


#
# Intervals of what is measured by a few independent repetitions: bootstrap over the seeds.
#
# The error of a picture is a mean over pairs of different seeds (a U-statistic), which is free of the noise of
# either: two independent pictures are never wrong in the same way by chance. Seeds are drawn anew, with all that was
# measured under them together; pairs of a seed with itself never count. With few seeds the percentiles of the
# bootstrap lie too close together, and are widened as those of a normal distribution would have to be to match
# Student's (T. C. Hesterberg, «What teachers should know about the bootstrap», The American Statistician 69, 2015).

Array = NDArray[np.float64]

REPLICATES = 2000
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Interval:
    """An estimate and the ends of its interval of confidence; each may be infinite."""

    value: float
    low: float
    high: float


def draws(seeds: int, rng: np.random.Generator, replicates: int = REPLICATES) -> NDArray[np.int64]:
    """Return how often each seed is drawn, shape (replicates, seeds); at least two different ones each time."""
    counts: NDArray[np.int64] = rng.multinomial(seeds, np.full(seeds, 1 / seeds), size=replicates)
    several: NDArray[np.int64] = counts[(counts > 0).sum(axis=1) > 1]
    return several


def every_seed_once(seeds: int) -> NDArray[np.int64]:
    """Return the draw that holds every seed once, shape (1, seeds): what estimates follow from."""
    return np.ones((1, seeds), np.int64)


def over_pairs(matrix: Array, counts: NDArray[np.int64]) -> Array:
    """Return the mean of a symmetric matrix (seeds, seeds) over pairs of different seeds, for each draw."""
    different = matrix - np.diag(np.diag(matrix))
    sums = np.einsum("bs,st,bt->b", counts, different, counts)
    pairs = counts.sum(axis=1) ** 2 - (counts**2).sum(axis=1)
    return np.asarray(sums / pairs)


def error_over_pairs(matrix: Array) -> float:
    """Return the standard error of the mean over pairs of different seeds.

    Products of pairs that share no seed tell the square of what is estimated without the error of the estimate. Where
    that leaves less than if all pairs were independent, which they are where nothing but noise is measured, the latter
    counts. There the bootstrap alone would give intervals half as wide again as they need be.
    """
    first, second = np.triu_indices(len(matrix), 1)
    values = matrix[first, second]
    apart = (first[:, None] != first) & (first[:, None] != second) & (second[:, None] != first)
    apart &= second[:, None] != second
    mean = values.mean()
    spread = mean**2 - float(values @ apart @ values) / apart.sum()
    return math.sqrt(max(spread, float(np.mean((values - mean) ** 2)) / len(values)))


def spread_about(value: float, replicates: Array, error: float) -> Array:
    """Return replicates moved away from an estimate, or towards it, so that their standard deviation is its error."""
    spread = float(replicates.std())
    return np.asarray(value + (replicates - value) * (error / spread if spread > 0 else 0.0))


def over_seeds(values: Array, counts: NDArray[np.int64]) -> Array:
    """Return the mean of one value per seed, for each draw."""
    return np.asarray(counts @ values / counts.sum(axis=1))


def median_over_seeds(values: Array, counts: NDArray[np.int64]) -> Array:
    """Return the median of one value per seed, for each draw; the mean of the middle two where there are two."""
    order = np.argsort(values)
    below = np.cumsum(counts[:, order], axis=1)
    half = counts.sum(axis=1, keepdims=True) / 2
    lower, upper = (below >= half).argmax(axis=1), (below > half).argmax(axis=1)
    return np.asarray((values[order][lower] + values[order][upper]) / 2)


def interval(value: float, replicates: Array, seeds: int, confidence: float = CONFIDENCE) -> Interval:
    """Return an estimate with the percentiles of its replicates, widened for few seeds."""
    tail = NormalDist().cdf(-math.sqrt(seeds / (seeds - 1)) * student_quantile((1 + confidence) / 2, seeds - 1))
    low, high = np.quantile(replicates, [tail, 1 - tail], method="inverted_cdf")  # which may be infinite
    return Interval(float(value), float(low), float(high))


@cache
def student_quantile(probability: float, freedom: int) -> float:
    """Return a quantile above the median of Student's distribution, by summing its density."""
    x = np.linspace(0.0, 100.0, 200_001)
    log_scale = math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2) - 0.5 * math.log(freedom * math.pi)
    density = np.exp(log_scale - (freedom + 1) / 2 * np.log1p(x**2 / freedom))
    shares = 0.5 + np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(x))])
    return float(np.interp(probability, shares, x))


#
# How noise falls with the samples of a pixel: on a lattice faster than 1 / n, and not evenly.
#
# 2^k samples of an extensible lattice are a lattice themselves, and even. Any other number is made of such blocks, as
# 212 of 128, 64, 16 and 4. If their errors had nothing to do with each other, its noise would be the sum of theirs,
# each weighted by the square of its share of the samples; they balance each other in part, and halfway (in
# logarithms) to the line through the powers of two is where noise was found. Independent samples are no exception:
# both are the same.

INDEPENDENT = -1.0  # exponent for independent samples
SMOOTH = -1.5  # of lattices where nothing is rare
STEEPEST, FLATTEST = -2.5, -0.5  # exponents beyond which what was seen is chance
UNEVENNESS = 0.3  # of the noise, for an exponent that is by 1 steeper than of independent samples
LEAST = 2.0**-20  # of a sample: what is left of a number that is taken apart
BLOCKS = 4  # that a number of samples is taken apart into, beside the rest
HALVINGS = 8  # of a step, to find the fewest samples
STEPS = np.linspace(1.0, 2.0, 9)  # between powers of two, numbers of samples that are looked at


@dataclass(frozen=True)
class NoiseLaw:
    """relMSE of the noise over samples per pixel: where these are powers of two, exponentials that meet at two numbers.

    Attributes
    ----------
    samples : (float, float)
        Powers of two.
    noise : (value, value)
        At these; numbers, or arrays with a value for each replicate.
    before, beyond : value
        Exponents of the samples below the first number and above the second.
    """

    samples: tuple[float, float]
    noise: tuple[Any, Any]
    before: Any
    beyond: Any

    @property
    def between(self) -> Any:
        """Exponent of the samples between the two numbers."""
        first, last = self.noise
        with np.errstate(divide="ignore", invalid="ignore"):
            exponent = np.log(np.divide(last, first)) / np.log(self.samples[1] / self.samples[0])
        return np.clip(np.where(np.isfinite(exponent), exponent, INDEPENDENT), STEEPEST, FLATTEST)

    def after(self, samples: Any) -> Any:
        """Return the noise after any number of samples per pixel."""
        return np.sqrt(self.even(samples) * self.blocks(samples))

    def least(self, samples: Any) -> Any:
        """The least noise there may be, if blocks balance each other."""
        return np.minimum(self.even(samples), self.blocks(samples)) / self._unevenness

    def most(self, samples: Any) -> Any:
        """The most noise there may be, if they do not."""
        return np.maximum(self.even(samples), self.blocks(samples)) * self._unevenness

    @property
    def _unevenness(self) -> Any:
        """How much lattices of several sizes differ from the line through two of them, as a factor."""
        return 1 + UNEVENNESS * np.maximum(INDEPENDENT - self.between, 0.0)

    @property
    def doubt(self) -> Any:
        """By what factor the noise may be off after a number of samples that was not rendered.

        Lattices of other sizes lie off the line through two of them, and numbers between powers of two halfway from it
        to what independent blocks would give, or on it. In 200 measurements of one scene intervals of the time to an
        error held the truth in 76 % without this.
        """
        steep = 2.0 + self.between
        between_powers = (2 / 3) ** steep + (1 / 3) ** steep  # of a number that is a block and its half
        return self._unevenness * np.sqrt(np.maximum(between_powers, 1.0))

    def blocks(self, samples: Any) -> Any:
        """Return the noise after any number of samples per pixel, if its blocks err independently."""
        rest = np.asarray(samples, np.float64)
        sum_of_blocks: Any = 0.0
        for _ in range(BLOCKS):
            block = np.exp2(np.floor(np.log2(np.maximum(rest, LEAST))))
            sum_of_blocks = sum_of_blocks + np.where(rest > LEAST, block**2 * self.even(block), 0.0)
            rest = np.maximum(rest - block, 0.0)
        sum_of_blocks = sum_of_blocks + np.where(rest > LEAST, rest**2 * self.even(np.maximum(rest, LEAST)), 0.0)
        return sum_of_blocks / np.square(samples)

    def even(self, samples: Any) -> Any:
        """Return the noise after a power of two of samples per pixel, or what lies on the line between them."""
        at, last = self.samples
        middle = self.noise[0] * (samples / at) ** np.where(samples < at, self.before, self.between)
        return np.where(samples > last, self.noise[1] * (samples / last) ** self.beyond, middle)

    def until(self, noise: Any) -> Any:
        """Return the samples per pixel after which the noise is what is given, above 0; 0 where there is none."""
        at, last = self.samples
        with np.errstate(divide="ignore", invalid="ignore"):
            middle = at * np.divide(noise, self.noise[0]) ** (
                1 / np.where(noise > self.noise[0], self.before, self.between)
            )
            even = np.where(noise < self.noise[1], last * np.divide(noise, self.noise[1]) ** (1 / self.beyond), middle)
            below = np.exp2(np.floor(np.log2(np.maximum(even, LEAST))))
        enough_samples = 2 * below
        for step in STEPS[-2::-1]:
            enough_samples = np.where(self.after(step * below) <= noise, step * below, enough_samples)
        short = enough_samples - (STEPS[1] - STEPS[0]) * below
        for _ in range(HALVINGS):
            middle = (short + enough_samples) / 2
            enough = self.after(middle) <= noise
            short, enough_samples = np.where(enough, short, middle), np.where(enough, middle, enough_samples)
        return np.where((even > 0) & np.isfinite(even), enough_samples, even)


def noise_law(samples: tuple[int, int, int], noise: Array, fall: Array, before: Array) -> NoiseLaw:
    """Return the law of noise for each replicate, the first of which is the estimate.

    Beyond the most samples that were rendered noise may go on as it fell last, or as that of independent samples: the
    estimate is halfway. It may also begin to fall as on smooth pictures, where a lattice becomes fine enough to find
    what few samples met: the replicates lie all over. Those of different configurations have the same tiles and
    share, so that they can be compared.

    Parameters
    ----------
    samples
        Numbers of samples that were rendered, rising.
    noise
        After the middle one.
    fall : (2, tiles) array
        What it is in some tiles after the middle and after the last one.
    before
        Exponent between the first two.
    """
    rng = np.random.default_rng(len(noise))
    share = rng.random(len(noise))
    steepness = np.log(samples[2] / samples[1])
    left = np.clip(_remaining_noise(fall, len(noise), rng), np.exp(STEEPEST * steepness), np.exp(FLATTEST * steepness))
    law = NoiseLaw(samples[1:], (noise, noise * left), np.clip(before, STEEPEST, FLATTEST), INDEPENDENT)
    beyond = INDEPENDENT + share * (np.minimum(law.between, SMOOTH) - INDEPENDENT)
    beyond[0] = (INDEPENDENT + law.between[0]) / 2
    return NoiseLaw(law.samples, law.noise, law.before, beyond)


def _remaining_noise(fall: Array, replicates: int, rng: np.random.Generator) -> Array:
    """The share of the noise that is left: bootstrap over tiles, which counts both their noise and the choice of them.

    It is widened for few tiles, as `statistics` does for few seeds.
    """
    tiles = fall.shape[1]
    if tiles < 2 or not fall.sum(axis=1).all():
        return np.ones(replicates)
    counts = rng.multinomial(tiles, np.full(tiles, 1 / tiles), size=replicates)
    counts[0] = 1
    before, after = counts @ fall[0], counts @ fall[1]
    least = LEAST * before[0], LEAST * after[0]  # where the tiles that were drawn have no noise
    left = np.maximum(after, least[1]) / np.maximum(before, least[0])
    wider = student_quantile(0.975, tiles - 1) / NormalDist().inv_cdf(0.975) * math.sqrt(tiles / (tiles - 1))
    return np.asarray(left[0] * (left / left[0]) ** wider)


#
# How pictures of one way to render differ from each other and from those of another, by pairs of seeds.
#
# The measure is relMSE, the mean over the picture of |x - r|^2 / (|r|^2 + (0.01 mean r)^2), with vectors of the three
# channels and |r|^2 averaged over the tile of 8 x 8 pixels: a pixel's own, known from few samples, would add as much
# noise as all that is measured. It comes from pictures of the reference under other seeds than the pair's.

EDGE = 0.01  # of the mean: what keeps dark pixels from counting beyond measure


@dataclass(frozen=True)
class PairErrors:
    """The results of every pair of seeds for one configuration; matrices (seeds, seeds) with nothing on the diagonal.

    Attributes
    ----------
    bias : array
        Products of differences from the reference: their mean is the square of the bias, as relMSE.
    noise : tuple of array
        Half the squared difference of two pictures, for each number of samples: its mean is the noise of one.
    brightness : (seeds,) array
        Mean of the picture.
    by_tile : (tiles,) array
        The mean of `bias` in each tile.
    noise_of_tiles : (tiles,) array
        Standard error of `by_tile`, as it is where nothing but noise is measured.
    evenness : float
        Square of the picture's mean over the mean of what squares are relative to: what relMSE a picture has at least
        that is too bright by one on the whole (Cauchy and Schwarz).
    weight_variances : dict
        Variances that the means of `bias` and of the last of `noise` have besides, because the reference that they are
        relative to is known from few seeds itself.
    fall : (2, m) array
        Noise in some of the tiles: with the most samples that all were rendered with, and with many.
    tile_errors : dict
        Standard errors of the means of `bias`, of the last of `noise`, and of `brightness` relative to the reference's,
        that come from rendering some of the tiles only. Cells of a grid are taken for a random sample, which makes them
        too large rather than too small.
    """

    bias: Array
    noise: tuple[Array, ...]
    brightness: Array
    by_tile: Array
    noise_of_tiles: Array
    evenness: float
    weight_variances: dict[str, float]
    tile_errors: dict[str, float]
    fall: Array


@dataclass(frozen=True)
class LongPictures:
    """Pictures of a few of the tiles with many samples, which tell how noise falls.

    Attributes
    ----------
    samples : int
        Samples per pixel.
    chosen : (m,) array
        Which of the tiles.
    pixels : list
        For each configuration, pixels (seeds, p, 3).
    """

    samples: int
    chosen: NDArray[np.int64]
    pixels: list[NDArray[np.float32]]


class _Scales:
    """What squared differences in each tile are divided by, from the pictures of the reference under some seeds."""

    def __init__(self, reference: Array, tiles: SpreadTiles) -> None:
        self.seeds, self._tiles = len(reference), tiles
        self.shares = _sums(np.ones(len(tiles.pixels)), tiles)
        self._pictures, self._total = reference, reference.sum(axis=0)
        self._squares = np.mean(reference**2, axis=2)
        self._all_squares = self._squares.sum(axis=0)
        self._edge = EDGE * float(tiles.weights @ self._total.mean(axis=1)) / self.seeds

    def without(self, *left_out: int) -> Array:
        """Return |r|^2 + (0.01 mean r)^2 of each tile from the other seeds: over pairs, without the noise of either."""
        total, squares, count = self._total, self._all_squares, self.seeds - len(left_out)
        for seed in left_out:
            total, squares = total - self._pictures[seed], squares - self._squares[seed]
        squares_of_mean = (np.mean(total**2, axis=1) - squares) / (count * (count - 1))
        return np.asarray(np.maximum(_sums(squares_of_mean, self._tiles) / self.shares, 0.0) + self._edge**2)


def pair_errors(
    pictures: list[list[NDArray[np.float32]]], samples: tuple[int, ...], tiles: SpreadTiles, long: LongPictures
) -> list[PairErrors]:
    """Return the errors of every configuration; the first is the reference.

    Parameters
    ----------
    pictures
        For each configuration and number of samples, pixels (seeds, p, 3).
    samples
        The numbers of samples per pixel.
    tiles
        Where the pixels are.
    long
        Pictures of more samples.
    """
    part = np.array(samples) / sum(samples)
    means = [
        np.asarray(np.sum([share * stack for share, stack in zip(part, own, strict=True)], axis=0, dtype=np.float64))
        for own in pictures
    ]
    scales = _Scales(means[0], tiles)
    light = [_sums(mean.mean(axis=(0, 2)), tiles) for mean in means]
    few = tiles.some(long.chosen)
    errors_of_all = []
    for own, more, mean, lit in zip(pictures, long.pixels, means, light, strict=True):
        away = _by_pair(mean - means[0], tiles, _product)
        noises = [_by_pair(stack, tiles, _half_square) for stack in own]
        bias, last = _over_tiles(away, scales), _over_tiles(noises[-1], scales)
        by_tile = {"bias": _mean_of_pairs(away, scales), "noise": _mean_of_pairs(noises[-1], scales)}
        errors = {name: _sampling_error(sums, scales.shares, tiles.all) for name, sums in by_tile.items()}
        errors_of_all.append(
            PairErrors(
                bias=bias,
                noise=(*(_over_tiles(noise, scales) for noise in noises[:-1]), last),
                brightness=mean.mean(axis=2) @ tiles.weights,
                by_tile=by_tile["bias"] / scales.shares,
                noise_of_tiles=_noise_of_tiles(away, scales) / scales.shares,
                evenness=float(lit.sum()) ** 2 / float(scales.shares @ scales.without()),
                weight_variances={
                    "bias": _weight_variance(away, bias, scales),
                    "noise": _weight_variance(noises[-1], last, scales),
                },
                tile_errors=errors | {"energy": _ratio_error(lit, light[0], scales.shares, tiles.all)},
                fall=_fall(by_tile["noise"][long.chosen], _by_pair(more, few, _half_square), scales, long.chosen),
            )
        )
    return errors_of_all


def _fall(noise: Array, sums: Array, scales: _Scales, chosen: NDArray[np.int64]) -> Array:
    """Return the noise of some tiles beside that in pictures of more samples."""
    seeds = len(sums)
    return np.stack([noise, sums.sum(axis=(0, 1)) / (seeds * (seeds - 1)) / scales.without()[chosen]])


def _product(first: Array, second: Array) -> Array:
    return np.asarray(np.mean(first * second, axis=1))


def _half_square(first: Array, second: Array) -> Array:
    return np.asarray(np.mean(np.square(first.astype(np.float64) - second), axis=1) / 2)


def _by_pair(values: Any, tiles: SpreadTiles, together: Callable[[Array, Array], Array]) -> Array:
    """Return sums over each tile, shape (seeds, seeds, tiles), of what two pictures of different seeds give."""
    seeds = len(values)
    sums = np.zeros((seeds, seeds, len(tiles.tiles)))
    for s, t in combinations(range(seeds), 2):
        sums[s, t] = sums[t, s] = _sums(together(values[s], values[t]), tiles)
    return sums


def _over_tiles(sums: Array, scales: _Scales) -> Array:
    """Return the matrix (seeds, seeds) of sums over tiles, relative to the reference under other seeds."""
    matrix = np.zeros((scales.seeds, scales.seeds))
    for s, t in combinations(range(scales.seeds), 2):
        matrix[s, t] = matrix[t, s] = float(np.sum(sums[s, t] / scales.without(s, t)))
    return matrix


def _mean_of_pairs(sums: Array, scales: _Scales) -> Array:
    """Return the mean over pairs in each tile, relative to the reference under all seeds."""
    return np.asarray(sums.sum(axis=(0, 1)) / (scales.seeds * (scales.seeds - 1)) / scales.without())


def _noise_of_tiles(sums: Array, scales: _Scales) -> Array:
    """Return the standard error of `_mean_of_pairs`, all pairs being independent, as of pure noise they are."""
    first, second = np.triu_indices(scales.seeds, 1)
    return np.asarray(sums[first, second].std(axis=0) / math.sqrt(len(first)) / scales.without())


def _weight_variance(sums: Array, matrix: Array, scales: _Scales) -> float:
    """Return by how much the variance (jackknife over seeds) grows when what tiles are divided by is found anew."""
    seeds = scales.seeds
    pairs = (seeds - 1) * (seeds - 2)
    all_sums, all_pairs = sums.sum(axis=(0, 1)), matrix.sum()
    anew = [float(np.sum((all_sums - 2 * sums[s].sum(axis=0)) / scales.without(s))) / pairs for s in range(seeds)]
    kept = [(all_pairs - 2 * matrix[s].sum()) / pairs for s in range(seeds)]
    return float(max(np.var(anew) - np.var(kept), 0.0) * (seeds - 1))


def _sums(values: Array, tiles: SpreadTiles) -> Array:
    """Return the weighted sums of pixels (p,) in each tile."""
    return np.asarray(np.bincount(tiles.cell, tiles.weights * values, len(tiles.tiles)), np.float64)


def _sampling_error(sums: Array, shares: Array, all_tiles: int) -> float:
    """Return the standard error of the sum over tiles that are some of all, each of a share of the picture."""
    n = len(sums)
    if n < 2:
        return 0.0
    apart = sums - shares * sums.sum()
    return float(np.sqrt((1 - n / all_tiles) * n / (n - 1) * (apart @ apart)))


def _ratio_error(sums: Array, reference: Array, shares: Array, all_tiles: int) -> float:
    """Return the standard error of the ratio of two sums over tiles."""
    whole = float(reference.sum())
    ratio = float(sums.sum()) / whole
    return _sampling_error(sums - ratio * reference, shares, all_tiles) / abs(whole)
