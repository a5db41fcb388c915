"""What a key is in each frame: distributions, drawn by seed, key and frame alone.

A frame is therefore the same however many are made and in whatever order, and a key that is added leaves what the
others draw as it was. Random bits are those of Philox (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3",
SC 2011), keyed by all three.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from numbers import Real
from statistics import NormalDist
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass

KINDS = {
    "uniform": "[least, most], numbers or lists of equally many numbers",
    "log_uniform": "[least, most], above 0",
    "integer": "[least, most], whole numbers, both included",
    "normal": "{mean, sd} and perhaps {min, max}, numbers or lists of equally many",
    "choice": "a list of values, and perhaps weights beside it",
    "grid": "a list of values, all combinations of which come in turn",
}

Numbers = tuple[float, ...]


class DistributionError(ValueError):
    """A distribution that cannot be drawn from: what is wrong, what would be right, and the keys that lead there."""

    def __init__(self, text: str, allowed: str, *path: str | int) -> None:
        super().__init__(f"{text} (allowed: {allowed})")
        self.path = path


@dataclass(frozen=True)
class Distribution:
    """A distribution of values of one key.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    values : tuple
        Of a choice or a grid; else the two ends, each a tuple of numbers.
    weights : tuple of float
        Of the values of a choice: shares that rise to 1.
    mean, sd : tuple of float
        Of a normal distribution.
    is_list : bool
        Whether what is drawn is a list of numbers.
    """

    kind: str
    values: tuple[Any, ...]
    weights: Numbers = ()
    mean: Numbers = ()
    sd: Numbers = ()
    is_list: bool = False

    @property
    def ends(self) -> Iterator[Any]:
        """The values that a scene has to take, for all others to be likely to be taken too."""
        if self.kind in ("choice", "grid"):
            yield from self.values
        elif self.kind == "normal":
            middle = [min(max(m, a), b) for m, a, b in zip(self.mean, *self.values, strict=True)]
            yield self._shown(middle)
            finite = [end for end in self.values if all(map(math.isfinite, end))]
            yield from (self._shown(end) for end in finite)
        else:
            yield from (self._shown(end) for end in self.values)

    def drawn(self, chances: np.random.Generator) -> Any:
        """Return a value; a grid's is chosen by `grid_values`."""
        if self.kind == "choice":
            share = float(chances.random())
            return self.values[next((n for n, sum_ in enumerate(self.weights) if share < sum_), len(self.values) - 1)]
        low, high = self.values
        shares = [float(chances.random()) for _ in low]
        return self._shown([self._between(*each) for each in zip(range(len(low)), shares, low, high, strict=True)])

    def _between(self, number: int, share: float, low: float, high: float) -> float:
        match self.kind:
            case "uniform":
                return low + share * (high - low)
            case "log_uniform":
                return low * math.exp(share * math.log(high / low))
            case "integer":
                return float(low + min(math.floor(share * (high - low + 1)), high - low))
        normal = NormalDist(self.mean[number], self.sd[number])
        below, above = (0.0 if math.isinf(low) else normal.cdf(low)), (1.0 if math.isinf(high) else normal.cdf(high))
        chance = min(max(below + share * (above - below), 1e-15), 1 - 1e-15)
        return min(max(normal.inv_cdf(chance), low), high)

    def _shown(self, numbers: Sequence[float]) -> Any:
        found: list[float] = [int(number) if self.kind == "integer" else float(number) for number in numbers]
        return found if self.is_list else found[0]


def distribution(data: Any) -> Distribution:
    """Return the distribution that a mapping such as ``{uniform: [1, 2]}`` describes.

    Raises
    ------
    DistributionError
        When it is none, or an empty one.
    """
    if not isinstance(data, Mapping):
        raise DistributionError(f"is no distribution (got {data!r})", "as {uniform: [1, 2]} or {choice: [a, b]}")
    kinds = [key for key in data if key in KINDS]
    if len(kinds) != 1:
        raise DistributionError("needs exactly one kind of distribution", ", ".join(KINDS))
    [kind] = kinds
    known = {kind, "weights"} if kind == "choice" else {kind}
    for key in data:
        if key not in known:
            raise DistributionError(f"unknown key {key}", ", ".join(sorted(known)), str(key))
    given = data[kind]
    if kind in ("choice", "grid"):
        return _listed(kind, given, data.get("weights"))
    if kind == "normal":
        return _normal(given)
    if not (isinstance(given, list | tuple) and len(given) == 2):
        raise DistributionError(f"has no two ends (got {given!r})", KINDS[kind], kind)
    low, high = (_numbers(end, KINDS[kind], kind, place) for place, end in enumerate(given))
    is_list, ends_in_list = (isinstance(end, list | tuple) for end in given)
    if len(low) != len(high) or is_list != ends_in_list:
        raise DistributionError(f"has ends of different lengths (got {given!r})", KINDS[kind], kind)
    if any(a > b for a, b in zip(low, high, strict=True)):
        raise DistributionError(f"has its ends the wrong way round (got {given!r})", "the least before the most", kind)
    if kind == "log_uniform" and min(low) <= 0:
        raise DistributionError(f"reaches 0 (got {given!r})", KINDS[kind], kind)
    if kind == "integer" and any(number != int(number) for number in low + high):
        raise DistributionError(f"has an end that is no whole number (got {given!r})", KINDS[kind], kind)
    return Distribution(kind, (low, high), is_list=is_list)


def _listed(kind: str, given: Any, weights: Any) -> Distribution:
    if not isinstance(given, list | tuple) or not given:
        raise DistributionError(f"has no list of values (got {given!r})", KINDS[kind], kind)
    if weights is None:
        weights = [1.0] * len(given)
    shares = _numbers(weights, "a number for each value", "weights")
    if len(shares) != len(given) or min(shares) < 0 or sum(shares) <= 0:
        raise DistributionError(f"do not weigh its {len(given)} values", "as many numbers, 0 or more", "weights")
    return Distribution(kind, tuple(given), tuple(np.cumsum(np.array(shares) / sum(shares)).tolist()))


def _normal(given: Any) -> Distribution:
    right = KINDS["normal"]
    if not isinstance(given, Mapping) or not {"mean", "sd"} <= set(given) <= {"mean", "sd", "min", "max"}:
        raise DistributionError(f"is no normal distribution (got {given!r})", right, "normal")
    mean = _numbers(given["mean"], right, "normal", "mean")
    sd, low, high = (
        _as_many(given.get(key, default), len(mean), right, key)
        for key, default in (("sd", 0.0), ("min", -math.inf), ("max", math.inf))
    )
    if min(sd) <= 0:
        raise DistributionError("must be above 0", "a number above 0", "normal", "sd")
    for number, (a, b) in enumerate(zip(low, high, strict=True)):
        normal = NormalDist(mean[number], sd[number])
        if not a < b or normal.cdf(b) - normal.cdf(a) < 1e-9:
            raise DistributionError("leaves nothing between min and max", "a range that the values reach", "normal")
    return Distribution("normal", (low, high), mean=mean, sd=sd, is_list=isinstance(given["mean"], list | tuple))


def _as_many(given: Any, count: int, right: str, key: str) -> Numbers:
    if isinstance(given, float) and math.isinf(given):
        return (given,) * count
    numbers = _numbers(given, right, "normal", key)
    if len(numbers) == 1:
        return numbers * count
    if len(numbers) != count:
        raise DistributionError(f"has {len(numbers)} numbers, its mean {count}", right, "normal", key)
    return numbers


def _numbers(given: Any, right: str, *path: str | int) -> Numbers:
    listed = list(given) if isinstance(given, list | tuple) else [given]
    for number in listed:
        if isinstance(number, bool) or not isinstance(number, Real) or not math.isfinite(number):
            raise DistributionError(f"is no finite number (got {number!r})", right, *path)
    if not listed:
        raise DistributionError("is empty", right, *path)
    return tuple(float(number) for number in listed)


def values_of_frame(vary: Mapping[str, Distribution], seed: int, frame: int) -> dict[str, Any]:
    """Return the value of each key in a frame, which counts from 0."""
    return {
        key: grid_values(vary, frame)[key] if law.kind == "grid" else law.drawn(_chances(seed, frame, key))
        for key, law in vary.items()
    }


def grid_values(vary: Mapping[str, Distribution], frame: int) -> dict[str, Any]:
    """Return the values of the keys with grids: all combinations in turn, the last key's changing first."""
    grids = {key: law.values for key, law in vary.items() if law.kind == "grid"}
    place = frame % math.prod(map(len, grids.values()))
    return dict(zip(grids, next(itertools.islice(itertools.product(*grids.values()), place, None)), strict=True))


def seed_of_frame(seed: int, frame: int) -> int:
    """Return the seed of the random numbers of a frame's picture."""
    return int(_chances(seed, frame, "render.seed").integers(0, 2**53))


def _chances(seed: int, frame: int, key: str) -> np.random.Generator:
    words = np.frombuffer(hashlib.sha256(key.encode()).digest()[:8], "<u4").tolist()
    return np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, frame, *words])))
