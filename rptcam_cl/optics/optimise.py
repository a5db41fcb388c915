"""Lenses made better: damped least squares in stages that a file remembers, hops between minima, other glasses."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.constants import LINE_D_NM, __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import read_whole, replacing
from rptcam_cl.core.strict_yaml import MAX_BYTES
from rptcam_cl.optics.files.glass_catalogues import find_glass, glasses_of
from rptcam_cl.optics.glass import Medium, abbe_number, known_range
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.optimise_merit import Judge, Merit
from rptcam_cl.optics.optimise_problem import GlassChange, Problem, read_problem

Array = NDArray[np.float64]

STAGE = 30  # evaluations between two states on disk
ROUNDS = 400
MORE = 8  # stages after the evaluations are used up, in which bounds come to hold
FTOL = 1e-6
OPENINGS = (0.2, 0.4, 0.6, 0.8)  # of pupil and field, for starts that lose rays
OPENING_EVALUATIONS = 60

Glasses = dict[int, Medium]
Progress = Callable[[str], object]


@dataclass(frozen=True)
class Optimised:
    """What a search found.

    Attributes
    ----------
    lens : Lens
        With the stop of the f-number, and rims that are at least as wide as the rays of the merit.
    film_mm : float
        From its last vertex.
    before, after : mapping
        Each term of the merit in its unit, and `merit`.
    evaluations : int
        Of the merit, those taken from a file of states included.
    lost : list of str
        Why rays are lost at the end.
    start : Lens
        The lens that it was, set likewise.
    start_film_mm : float
        Its best film distance by the same merit.
    """

    lens: Lens
    film_mm: float
    before: dict[str, float]
    after: dict[str, float]
    evaluations: int
    lost: list[str]
    start: Lens
    start_film_mm: float
    problem: Problem = field(repr=False)


class _Journal:
    """Stages of the search in their order; a run that begins anew takes those that a file has."""

    def __init__(self, given: Problem, path: Path | None) -> None:
        self.path, self.digest, self.stages, self.next = path, given.digest, [], 0
        if path is not None and path.exists():
            try:
                data = json.loads(read_whole(path, 16 * MAX_BYTES))
                known, self.stages = data["problem"], list(data["stages"])
            except (ValueError, KeyError, TypeError):
                raise StateError(f"{path}: is no state of a lens search; delete it or name another") from None
            if known != self.digest:
                raise StateError(f"{path}: is the state of another problem, lens or version; delete it or name another")

    def stage(self, key: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Take the result of a stage from the file, or compute and write it."""
        number, self.next = self.next, self.next + 1
        if number < len(self.stages) and self.stages[number]["key"] == key:
            return dict(self.stages[number])
        del self.stages[number:]
        self.stages.append({"key": key, **compute()})
        if self.path is not None:
            with replacing(self.path) as temporary:
                temporary.write_text(json.dumps({"problem": self.digest, "stages": self.stages}))
        return dict(self.stages[-1])


def _scipy() -> Any:
    try:
        import scipy.optimize
    except ImportError:
        raise StateError(
            'lenses are optimised with scipy, which is not installed: pip install "rptcam_cl[optimise]"'
        ) from None
    return scipy.optimize


class _Search:
    """One run of the search."""

    def __init__(self, given: Problem, journal: _Journal, progress: Progress) -> None:
        self.given, self.journal, self.progress = given, journal, progress
        self.library, self.evaluations = _scipy(), 0

    def local(self, merit: Merit, x: Array, label: str, most: int | None = None) -> tuple[Array, float]:
        """Return the minimum by damped least squares near x with all bounds held, and its merit."""
        merit.set_hold(merit.values_of(x)["merit"])
        spent, last, more = 0, math.inf, MORE
        for _ in range(ROUNDS):
            shifts = b"" if merit.shifts is None else merit.shifts.tobytes()
            key = hashlib.sha256(x.tobytes() + shifts + repr(merit.weight).encode() + label.encode()).hexdigest()
            stage = self.journal.stage(key, lambda start=x: self._stage(merit, start))  # type: ignore[misc]
            x, count = np.array(stage["x"]), int(stage["evaluations"])
            spent, self.evaluations = spent + count, self.evaluations + count
            value = merit.values_of(x)["merit"]
            self.progress(f"{label}: merit {value:.6g} after {self.evaluations} evaluations")
            ends = spent >= (most or self.given.evaluations)
            more -= ends
            if stage["converged"] or ends:
                if (merit.tighten(x) <= 1 and (ends or abs(last - value) <= 1e-3 * value)) or not more:
                    break
                last = value
        return x, value

    def descent(self, merit: Merit, x: Array) -> Array:
        """Return the minimum near x; where rays are lost in it, the one that opening pupil and field in steps finds."""
        found, _ = self.local(merit, x, "descent")
        if not merit.lost_rays(found):
            return found
        for opening in OPENINGS:
            part = Merit(self.given, {}, opening)
            x, _ = self.local(part, x, f"pupil and field opened to {opening:g}", OPENING_EVALUATIONS)
        x, _ = self.local(merit, x, "fully open")
        return min(x, found, key=lambda v: self._compared(merit, v))

    def _stage(self, merit: Merit, x: Array) -> dict[str, Any]:
        found = self.library.least_squares(
            lambda v: merit.evaluate(v, False)[0], x, jac=lambda v: merit.evaluate(v, True)[1], x_scale="jac",
            ftol=FTOL, xtol=1e-12, gtol=1e-15, max_nfev=STAGE,
        )  # fmt: skip
        return {"x": found.x.tolist(), "evaluations": int(found.nfev), "converged": bool(found.status != 0)}

    def score(self, merit: Merit, x: Array) -> float:
        """Return the merit with its penalties, by which minima are compared."""
        values, _ = merit.evaluate(x, False)
        return float(np.sqrt(values @ values))

    def hops(self, merit: Merit, x: Array) -> Array:
        """Return the best minimum of basin hopping."""
        hunt = self.given.hunt
        number = iter(range(hunt.count + 1))
        random = np.random.default_rng(hunt.seed)

        def step(v: Array) -> Array:
            return np.asarray(v + hunt.step * random.uniform(-1, 1, len(v)))

        def minimise(_fun: Any, start: Array, args: Any = (), **_options: Any) -> Any:
            found, _ = self.local(merit, np.asarray(start), f"hop {next(number)}")
            return self.library.OptimizeResult(x=found, fun=self._compared(merit, found), success=True, nfev=1)

        result = self.library.basinhopping(
            lambda v: self._compared(merit, v), x, niter=hunt.count, take_step=step, T=0.1 * self._compared(merit, x),
            minimizer_kwargs={"method": minimise}, seed=np.random.default_rng(hunt.seed + 1),
        )  # fmt: skip
        return np.asarray(result.x)

    def _compared(self, merit: Merit, x: Array) -> float:
        """Return a merit that does not depend on what came before: bounds weigh as at the start."""
        merit.set_hold(merit.values_of(merit.x0)["merit"])
        return self.score(merit, x)

    def evolution(self, merit: Merit, x: Array) -> Array:
        """Return the best of differential evolution about x, `step` to each side."""
        hunt = self.given.hunt
        result = self.library.differential_evolution(
            lambda v: self._compared(merit, v), [(v - hunt.step, v + hunt.step) for v in x], maxiter=hunt.count,
            seed=np.random.default_rng(hunt.seed), polish=False, x0=x, popsize=5, tol=0,
        )  # fmt: skip
        self.evaluations += int(result.nfev)
        return self.local(merit, np.asarray(result.x), "after evolution")[0]

    def other_glasses(self, merit: Merit, x: Array) -> tuple[Merit, Array]:
        """Return the best after each glass was exchanged for its neighbours in n_d and V_d, until none is better."""
        glasses = {change.surface: merit.start.surfaces[change.surface].glass for change in self.given.glasses}
        improved = bool(glasses)
        while improved:
            improved = False
            for change in self.given.glasses:
                for medium in neighbours(glasses[change.surface], change, self.given.wavelengths_nm):
                    tried = Merit(self.given, {**glasses, change.surface: medium}, judge=merit.judge)
                    found, _ = self.local(tried, x, f"{medium.name} behind surface {change.surface}")
                    if tried.values_of(found)["merit"] < 0.999 * merit.values_of(x)["merit"] and _holds(tried, found):
                        merit, x, improved = tried, found, True
                        glasses[change.surface] = medium
        return merit, x


def _holds(merit: Merit, x: Array) -> bool:
    return merit.worst_bound(x)[1] <= 0 and not merit.lost_rays(x)


def neighbours(glass: Medium, change: GlassChange, wavelengths_nm: Sequence[float]) -> list[Medium]:
    """Return the catalogue glasses nearest to one in n_d (0.02 counts as much as 2 of V_d), itself not among them."""
    nd, vd = float(glass.index(LINE_D_NM)), abbe_number(glass)
    rows = []
    for maker in change.makers:
        for one in glasses_of(maker).values():
            if one.nd is not None and one.vd is not None:
                away = (
                    ((one.nd - nd) / 0.02) ** 2 + ((one.vd - vd) / 2.0) ** 2 if math.isfinite(vd) else abs(one.nd - nd)
                )
                rows.append((away, f"{one.name}_{maker.upper()}"))
    found: list[Medium] = []
    for _, name in sorted(rows):
        medium = find_glass(name)
        limits = None if medium is None else known_range(medium)
        covers = limits is None or (limits[0] <= min(wavelengths_nm) and max(wavelengths_nm) <= limits[1])
        if medium is not None and covers and medium != glass and medium not in found:
            found.append(medium)
        if len(found) == change.tries:
            break
    return found


def optimise(
    source: str | Path | Mapping[str, Any] | Problem,
    *,
    state: str | Path | None = None,
    on_progress: Progress | None = None,
    judge: Judge | None = None,
) -> Optimised:
    """Search for the best lens of a problem.

    Parameters
    ----------
    source
        A YAML file, a mapping with its keys, or what `read_problem` made of one.
    state
        A file of states: written as the search goes on, and taken up where it is there, with the same result.
    on_progress
        Gets a line after each stage.
    judge
        Returns the spot of copies of a lens, where the merit has `as_built`: `spot_of_copies` of
        `rptcam_cl.rendering.tolerance_run`.

    Raises
    ------
    InputError
        For a problem that cannot be read, and bounds that no values of the variables hold.
    """
    given = source if isinstance(source, Problem) else read_problem(source)
    if judge is None and any(term.name == "as_built" for term in given.terms):
        raise InputError(f"{given.label}: merit.as_built needs a judge of copies (see optimise)")
    search = _Search(given, _Journal(given, None if state is None else Path(state)), on_progress or (lambda _: None))
    merit = Merit(given, {}, judge=judge)
    start, x = merit, merit.x0
    _check_bounds(merit)
    if len(x):
        x = search.descent(merit, x)
    if given.hunt.kind == "hops":
        x = search.hops(merit, x)
    elif given.hunt.kind == "evolution":
        x = search.evolution(merit, x)
    merit, x = search.other_glasses(merit, x)
    if merit is start and _holds(start, start.x0):
        x = min(x, start.x0, key=lambda v: merit.values_of(v)["merit"] if _holds(merit, v) else math.inf)
    words, over = merit.worst_bound(x)
    if over > 0:
        raise InputError(f"{given.label}: bounds.{words}, and no values of the variables do it: {over:.4g} mm are left"
                         .replace("bounds.focal_length_mm", "focal_length_mm"))  # fmt: skip
    before, after = start.values_of(start.x0), merit.values_of(x)
    lens, film = merit.finished(merit.state(x, False))
    lens = replace(lens, name=f"{given.lens.name}, optimised", source=_provenance(given, before, after))
    first, first_film = start.finished(start.state(start.x0, False))
    return Optimised(lens, film, before, after, search.evaluations, merit.lost_rays(x), first, first_film, given)


def _check_bounds(merit: Merit) -> None:
    """Refuse a bound that is overstepped where nothing may change it."""
    for words, over, by, allowed in merit.overstepped(merit.state(merit.x0, True)):
        if over > allowed and not np.any(by):
            prefix = "" if words.startswith("focal_length_mm") else "bounds."
            raise InputError(
                f"{merit.given.label}: {prefix}{words}, and no variable changes it ({over:.4g} mm are left)"
            )


def _provenance(given: Problem, before: Mapping[str, float], after: Mapping[str, float]) -> str:
    merits = f"merit {before['merit']:.4g} to {after['merit']:.4g}"
    words = f"optimised by rptcam {__version__} ({Path(given.label).name}: {merits})"
    return f"{given.lens.source}; {words}" if given.lens.source else words
