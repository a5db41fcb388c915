"""What each approximation of a picture costs and gains, measured: the configurations, and short renders by turns."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError, InputError
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.optics.ghosts import Lit, find_ghosts
from rptcam_cl.rendering import diffraction, passes, tracer
from rptcam_cl.rendering.account import resolve_exposure, truncation
from rptcam_cl.rendering.cameras.lens_records import ghost_setting
from rptcam_cl.rendering.film import TILE, TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.lamps import aimed_plan
from rptcam_cl.rendering.plan.plan import Plan, make_plan
from rptcam_cl.scene import film, load
from rptcam_cl.scene.camera import NO_MOVEMENTS
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies import tradeoff_errors
from rptcam_cl.studies.focus.controller import in_focus
from rptcam_cl.studies.tier_models import TIERS, Tier, equivalent, without_lens
from rptcam_cl.studies.tiers import Decision, choose_camera
from rptcam_cl.studies.tradeoff import TradeoffReport, advise_for_error, advise_for_time

Array = NDArray[np.float64]

#
# Which tiles of the film are rendered: all, or some spread evenly, at the resolution of the picture itself.
#
# A picture made smaller would hide what an inaccurate camera does to fine detail; tiles of the true one do not.


def spread_tiles(layout: FilmLayout, most: int, rng: np.random.Generator) -> tradeoff_errors.SpreadTiles:
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
    return tradeoff_errors.SpreadTiles(tiles, (rows, columns), buffer[inside], cell[inside], weights, layout.tiles)


# The configurations that are compared: the most accurate one of a scene, and others with one thing changed.

PARTS = ("film", "camera", "exposure", "shutter", "spectrum", "render")
_NOT_SAID = ("spp", "layers")  # keys of `render` that do not change the configuration


def settings(scene: Scene, wanted: Scene) -> tuple[str, ...]:
    """Return the arguments of ``rptcam render --set`` that turn one scene into another; only such keys may differ."""
    return tuple(text for part in PARTS for text in _of_part(part, getattr(scene, part), getattr(wanted, part)))


def _of_part(part: str, own: Any, wanted: Any) -> list[str]:
    values = wanted.model_dump(mode="json", exclude_none=True)
    if type(own) is type(wanted):
        apart = [name for name in type(own).model_fields if getattr(own, name) != getattr(wanted, name)]
        return [_override_text(f"{part}.{name}", values.get(name)) for name in apart if name not in _NOT_SAID]
    given = {name: values[name] for name in values if name in wanted.model_fields_set | {"kind"}}
    gone = [f"{part}.{name}=null" for name in own.model_fields_set if name not in given]
    apart = [name for name in given if getattr(own, name, None) != getattr(wanted, name)]
    by_key = [*gone, *(_override_text(f"{part}.{name}", given[name]) for name in apart)]
    return min(by_key, [_override_text(part, given)], key=lambda texts: len(" ".join(texts)))


def _override_text(path: str, value: Any) -> str:
    return f"{path}={value if isinstance(value, str) else json.dumps(value)}"


PUPILS = ("rear", "thick", "bounds")  # beside the outline of the pupil itself, which the reference has
_SHORT_DEPTHS = (2, 4)  # edges: direct light alone, and two bounces more


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
        What `camera.accuracy: auto` would choose; None for a camera without a lens of surfaces, and where the film is
        moved.
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

    add(tradeoff_errors.AS_IT_IS, "scene", partial(_without_layers, scene))
    if camera.traced_camera is not None:
        if camera.film_movements == NO_MOVEMENTS:  # what takes the place of a lens has a film across its axis
            decision = choose_camera(change_scene(full, camera={"accuracy": "auto"}))
            for tier in reversed(TIERS[:-1]):
                add(name_of(tier), "camera", partial(equivalent, full, tier), tier=tier)
        add("lens: float64", "precision", partial(change_scene, full, camera={"precision": "double"}))
        for pupil in PUPILS:
            add(f"pupil: {pupil}", "pupil", partial(change_scene, full, camera={"pupil": pupil}), unbiased=True)
    if camera.ideal_lens is not None:
        add("pinhole", "camera", partial(without_lens, full))
    for mode in ("dispersive", "rgb"):
        add(f"spectrum: {mode}", "spectrum", partial(_with_mode, full, mode))
    for depth in _SHORT_DEPTHS:
        if depth < full.render.max_depth:
            add(f"depth {depth}", "depth", partial(change_scene, full, render={"max_depth": depth}))
    if full.render.caustics != "off":
        add("caustics: off", "caustics", partial(change_scene, full, render={"caustics": "off"}))
    if full.render.virtual_lights != "off":
        alone = partial(change_scene, full, render={"virtual_lights": "off"})
        add("virtual lights: off", "virtual lights", alone, unbiased=True)
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
    plain = change_scene(_without_layers(scene), render={"clamp": None, "sampler": "lattice"})
    if scene.camera.traced_camera is None:
        return Variant(tradeoff_errors.REFERENCE, "", plain)
    plain = change_scene(plain, camera={"accuracy": None, "pupil": "auto", "rays": "traced", "precision": "single"})
    if plain.spectrum.mode != "rgb":
        plain = change_scene(plain, spectrum={"lens": "on"})
    return Variant(tradeoff_errors.REFERENCE, "", plain, "realistic")


def _without_layers(scene: Scene) -> Scene:
    """Return a scene as all its samples show it; the layer `lights` leaves caustics to paths, as in a render."""
    paths_alone = {"caustics": "off"} if "lights" in scene.render.layers and scene.render.caustics == "auto" else {}
    return change_scene(scene, render={"noise": None, "layers": (), **paths_alone})


def _with_mode(scene: Scene, mode: str) -> Scene:
    if mode == "dispersive" and scene.spectrum.mode != "spectral":
        return scene
    return change_scene(scene, spectrum={"mode": mode, "lens": "off" if mode == "rgb" else "on"})


# Short renders of every configuration by turns, with what each took of the clock and of the processor.


@dataclass(frozen=True)
class Ready:
    """A configuration that is compiled.

    Attributes
    ----------
    configuration : Variant
    wavefront : Wavefront
    plan : Plan
    start_s : float
        Time from the scene to the first ray [s]; programs shared with an earlier configuration are there already.
    """

    configuration: Variant
    wavefront: tracer.Wavefront
    plan: Plan
    start_s: float


def prepare(
    configurations: Sequence[Variant], session: Session, on_step: Callable[[str, int], Any]
) -> tuple[list[Ready], dict[str, str]]:
    """Return the configurations that differ, compiled, and why others of them cannot be rendered, by name.

    Raises
    ------
    InputError
        When the first, which all others are measured against, cannot be.
    """
    seen: dict[bytes, int] = {}
    ready: list[Ready] = []
    skipped: dict[str, str] = {}
    for done, configuration in enumerate(configurations):
        on_step(configuration.name, done)
        begun = time.perf_counter()
        try:
            plan = make_plan(configuration.scene)
            passes.check_precision(session, plan.camera)
        except (InputError, DeviceError) as problem:
            if not ready:
                raise
            skipped[configuration.name] = str(problem)
            continue
        known_as = mark(plan, configuration.scene.render)
        if known_as in seen:
            same = ready[seen[known_as]]
            known = same.configuration.with_name_of(configuration)
            ready[seen[known_as]] = replace(same, configuration=known)
            continue
        seen[known_as] = len(ready)
        layout, settings = FilmLayout.of(configuration.scene.film), configuration.scene.render
        plan, buffers = aimed_plan(plan, session, settings.layers)
        wavefront = tracer.Wavefront(session, plan, layout, settings, buffers=buffers)
        wavefront.warm_up()
        ready.append(Ready(configuration, wavefront, plan, time.perf_counter() - begun))
    return ready, skipped


def mark(plan: Plan, settings: film.RenderSettings) -> bytes:
    """Identify the picture that a configuration renders: two with the same mark render the same."""
    camera = plan.camera
    arrays = (camera.record, camera.tables, camera.surfaces, camera.stop, plan.spectrum.table)
    words = (camera.kernel, sorted(camera.facts.items()), sorted(plan.facts.items()), settings.max_depth)
    return repr((words, settings.roulette_depth)).encode() + b"".join(array.tobytes() for array in arrays)


def run(
    ready: Ready, tiles: tradeoff_errors.SpreadTiles, samples: int, seed: int
) -> tuple[NDArray[np.float32], float, float]:
    """Render the tiles once.

    Returns
    -------
    pixels : (p, 3) array
    wall_s, cpu_s : float
        Time of the clock, and of all threads of the process [s].
    """
    wavefront = ready.wavefront
    wavefront.choose_tiles(tiles.tiles)
    wavefront.clear()
    wavefront.seed = seed
    wavefront.session.finish()
    wall, cpu = time.perf_counter(), time.process_time()
    for wave in wavefront.waves(0, samples):
        wavefront.enqueue(*wave)
    wavefront.finish()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    sums = wavefront.sums()[:, tiles.pixels].astype(np.float64)
    mean = (sums[:3] - sums[3:]).T / samples
    return mean.astype(np.float32), wall, cpu


def _undisturbed_clock(device_type: str) -> Callable[[], float]:
    """Return a clock [s] that other work on the machine does not move: of a processor its time over all cores."""
    return (lambda: time.process_time() / cores()) if device_type == "cpu" else time.perf_counter


def cores() -> int:
    """Return how many processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


# How many tiles and samples fit the time, and the order of the renders: by turns, so that other work on the machine
# disturbs all configurations alike.

SEEDS, _FEWEST_SEEDS = 8, 4
GROWTH = 4  # times the samples of the first picture that the second has
_LONG_GROWTH, _LONG_SEEDS, _LONG_SHARE = 64, 2, 4  # times the samples of the first; pictures; one of so many tiles
_FEWEST_LONG = 16  # tiles
_PILOT_TILES, _PILOT_SAMPLES = 32, 4
_FEWEST_TILES, MOST_TILES = 64, {"cpu": 512, "gpu": 4096}
_WANTED_SAMPLES = 2  # of the first picture, before more tiles are taken
_TILES_SEED = 5
_SHORT, _LONG = SEEDS * (1 + GROWTH), _LONG_SEEDS * _LONG_GROWTH / _LONG_SHARE
_LONG_TIME = _LONG / (_SHORT + _LONG)  # of all that is rendered


def render_by_turns(
    ready: Sequence[Ready], seconds: float, seed: int, on_progress: Callable[[str, float], Any], seeds: int = SEEDS
) -> tradeoff_errors.Pictures:
    """Return pictures of every configuration, as large and with as many samples as fit the time.

    Where turns take longer than the first small renders said, there are fewer seeds and fewer long renders.
    """
    info, layout = ready[0].wavefront.session.info, ready[0].wavefront.layout
    now = _undisturbed_clock(info.type)
    begun = now()
    on_progress("timing", 0.0)
    tiles, first = _extent(ready, seconds, seeds)
    samples = (first, GROWTH * first)
    pixels = [[np.empty((seeds, len(tiles.pixels), 3), np.float32) for _ in samples] for _ in ready]
    taken = np.zeros((len(ready), 2, seeds))
    turns = seeds * len(samples)
    turning = now()
    for turn in range(turns):
        row, k = divmod(turn, len(samples))
        a_row = (now() - turning) / max(row, 1)
        left = seconds - (now() - begun) - a_row
        if k == 0 and row >= _FEWEST_SEEDS and left < a_row * _LONG / (1 + GROWTH):
            turns = turn
            break
        for place, index in enumerate(_order(len(ready), turn)):
            on_progress("rendering by turns", (1 - _LONG_TIME) * (turn + place / len(ready)) / turns)
            pixels[index][k][row], wall_s, cpu_s = run(ready[index], tiles, samples[k], seed + 1 + turn)
            taken[index, :, row] += cpu_s, wall_s
    seeds = turns // len(samples)
    pixels = [[part[:seeds] for part in each] for each in pixels]
    taken = taken[:, :, :seeds]
    left = seconds - (now() - begun)
    a_tile = (now() - turning) / (seeds * (1 + GROWTH) * len(tiles.tiles)) * _LONG_SEEDS * _LONG_GROWTH
    most = len(tiles.tiles) if math.isinf(seconds) else int(left / a_tile)
    long = _long(ready, tiles, most, _LONG_GROWTH * first, seed + 1 + turns, on_progress)
    taken *= layout.samples_per_spp / len(tiles.pixels) / sum(samples)
    by_cpu = info.type == "cpu"
    timings = [(cpu / cores() if by_cpu else wall, wall) for cpu, wall in taken]
    return tradeoff_errors.Pictures(tiles, samples, seeds, pixels, long, timings, by_cpu)


def _order(count: int, turn: int) -> NDArray[np.int64]:
    return np.roll(np.arange(count), turn)[:: 1 if turn % 4 < 2 else -1]


def _long(
    ready: Sequence[Ready],
    tiles: tradeoff_errors.SpreadTiles,
    most: int,
    samples: int,
    seed: int,
    on_progress: Callable[[str, float], Any],
) -> tradeoff_errors.LongPictures:
    """Return pictures of a few of the tiles with many samples, of as many as the time allows."""
    count = min(max(min(len(tiles.tiles) // _LONG_SHARE, most), _FEWEST_LONG), len(tiles.tiles))
    chosen = np.sort(np.random.default_rng(_TILES_SEED).choice(len(tiles.tiles), count, replace=False))
    few = tiles.some(chosen)
    pixels = [np.empty((_LONG_SEEDS, len(few.pixels), 3), np.float32) for _ in ready]
    for turn in range(_LONG_SEEDS):
        for place, index in enumerate(_order(len(ready), turn)):
            share = (turn + place / len(ready)) / _LONG_SEEDS
            on_progress("rendering some tiles longer", 1 - _LONG_TIME * (1 - share))
            pixels[index][turn], *_ = run(ready[index], few, samples, seed + turn)
    return tradeoff_errors.LongPictures(samples, chosen, pixels)


def _extent(ready: Sequence[Ready], seconds: float, seeds: int) -> tuple[tradeoff_errors.SpreadTiles, int]:
    """Return the tiles and the samples per pixel of the first pictures, by the speed of small ones."""
    layout, kind = ready[0].wavefront.layout, ready[0].wavefront.session.info.type
    now = _undisturbed_clock(kind)
    rng = np.random.default_rng(_TILES_SEED)
    pilot = spread_tiles(layout, _PILOT_TILES, rng)
    for each in ready:
        run(each, pilot, 1, 0)
    begun = now()
    for each in ready:
        run(each, pilot, _PILOT_SAMPLES, 0)
    per_sample = (now() - begun) / (_PILOT_SAMPLES * len(pilot.pixels))
    # Of one tile with one sample per pixel in the first picture of each seed.
    fits = seconds * (1 - _LONG_TIME) / (seeds * (1 + GROWTH) * per_sample * TILE_PIXELS)
    most = int(np.clip(fits / _WANTED_SAMPLES, _FEWEST_TILES, MOST_TILES.get(kind, MOST_TILES["gpu"])))
    tiles = spread_tiles(layout, most, rng)
    return tiles, 2 ** math.floor(math.log2(max(fits / len(tiles.tiles), 1)))  # lattices are even at powers of two


# The Python interface of the comparison.

_BUDGET_S = 60.0
_WISHED_S, _WISHED_ERROR = 60.0, 0.02
_DRAWS_SEED = 7  # of the bootstrap

Tell = Callable[[str, float], Any]
"""Takes what is being done and the share of the work that is done."""


def measure_tradeoff(
    scene: Scene | str | Path | Mapping[str, Any],
    *,
    budget: float = _BUDGET_S,
    seconds: float = _WISHED_S,
    error: float = _WISHED_ERROR,
    size: tuple[int, int] | None = None,
    device: str | Session | None = None,
    on_progress: Tell | None = None,
) -> TradeoffReport:
    """Measure what each approximation of a scene's picture costs and gains, and which to take; see docs/tradeoff.md.

    Parameters
    ----------
    scene
        A scene, or anything that `load_scene` takes.
    budget
        The most that the comparison takes on an idle machine [s], to a tenth, where preparing takes less than two
        thirds of it and the fewest renders fit the rest; else the report says what took longer.
    seconds, error
        What to advise for: a time to render [s], and a relative error (root of relMSE).
    size
        Replaces the scene's resolution [pixels].
    device
        As for `render`.
    on_progress
        Called with what is being done and the share of the work that is done.

    Raises
    ------
    InputError
        Something in the scene or the arguments is wrong, or the picture is black.
    DeviceError
        No device fits, or a kernel failed.
    """
    _check_goals(budget=budget, seconds=seconds, error=error)
    begun = time.perf_counter()
    tell = on_progress or (lambda words, share: None)
    scene = scene if isinstance(scene, Scene) else load.load_scene(scene)
    session = device if isinstance(device, Session) else open_session(device)
    tell("focus and exposure", 0.0)
    fixed = _with_focus_and_exposure(scene if size is None else change_scene(scene, film={"resolution": size}), session)
    configurations, skipped, decision = ladder(fixed)
    count = len(configurations)
    ready, impossible = prepare(
        configurations, session, lambda name, done: tell(f"preparing: {name}", 0.3 * done / count)
    )
    left = max(budget - (time.perf_counter() - begun), budget / 3)
    pictures = render_by_turns(ready, left, fixed.render.seed, lambda words, share: tell(words, 0.3 + 0.7 * share))
    _check_light(pictures, fixed)
    tell("errors", 1.0)
    measured = _measure(ready, pictures)
    return TradeoffReport(
        **_conditions(fixed, session, ready, pictures, decision),
        seconds=time.perf_counter() - begun,
        measurements=tuple(measured),
        advice=(advise_for_time(measured, seconds), advise_for_error(measured, error)),
        skipped=skipped | impossible,
        budget=budget,
    )


def _check_goals(**goals: float) -> None:
    for name, value in goals.items():
        most, allowed = (1.0, "between 0 and 1") if name == "error" else (math.inf, "above 0, in seconds")
        if not (isinstance(value, int | float) and 0 < value < most):
            raise InputError(f"{name}: is out of range (got {value!r}; allowed: a number {allowed})")


def _with_focus_and_exposure(scene: Scene, session: Session) -> Scene:
    """Return the scene in focus, with the exposure that its most accurate picture is metered to."""
    sharp, _ = in_focus(scene, session, None)
    shot = resolve_exposure(most_accurate(sharp).scene, session)[0]
    return change_scene(sharp, exposure=load.given_keys(shot.exposure), shutter=load.given_keys(shot.shutter))


def _diffraction(scene: Scene) -> dict[str, Any] | None:
    """The decision of `camera.diffraction: auto`; None for a camera that has no opening."""
    decision = diffraction.diffraction_of(change_scene(scene, camera={"diffraction": "auto"}))
    return None if decision is None or decision.airy_radius_px is None else decision.metadata


def _ghosts(scene: Scene) -> float | None:
    """Return the share of a lamp's light on the axis that ghosts bring to the frame; None where there are none."""
    try:
        setting = ghost_setting(scene)
        width, height = scene.film.size_m()
        frame = (1e3 * width, 1e3 * height)
        lit = Lit(
            setting.lens, setting.film_distance_mm, wavelength_nm=setting.camera.wavelength_nm, film_mm=frame,
            transmission=setting.transmission,
        )  # fmt: skip
        account = find_ghosts(lit)
    except InputError:
        return None
    return sum(ghost.flux_in_frame for ghost in account.ghosts) / account.reference


def _check_light(pictures: tradeoff_errors.Pictures, scene: Scene) -> None:
    if not any(picture.any() for picture in pictures.pixels[0]):
        raise InputError(
            "the picture is black, so that there is nothing to compare (allowed: a scene whose light reaches the"
            f" camera within render.max_depth, which is {scene.render.max_depth})"
        )


def _conditions(
    scene: Scene, session: Session, ready: list[Ready], pictures: tradeoff_errors.Pictures, decision: Decision | None
) -> dict[str, Any]:
    """The conditions of a comparison: the members of a report that no measurement is in."""
    reference = ready[0].plan
    described = reference.camera.metadata | reference.spectrum.metadata
    return {
        "scene": scene.content_hash(),
        "device": session.info.name,
        "resolution": scene.film.resolution,
        "tiles": (len(pictures.tiles.tiles), ready[0].wavefront.layout.tiles),
        "grid": pictures.tiles.shape,
        "samples": (*pictures.samples, pictures.long.samples),
        "long_tiles": len(pictures.long.chosen),
        "seeds": pictures.seeds,
        "by_cpu": pictures.by_cpu,
        "lens_colour_px": described.get("lens_colour_px"),
        "truncation": truncation(reference.albedo, ready[0].configuration.scene.render.max_depth),
        "cameras": () if decision is None else decision.errors,
        "allowed": "" if decision is None else decision.tier,
        "diffraction": _diffraction(scene),
        "ghosts": _ghosts(scene),
    }


def _measure(ready: list[Ready], pictures: tradeoff_errors.Pictures) -> list[tradeoff_errors.MeasuredVariant]:
    errors = tradeoff_errors.pair_errors(pictures.pixels, pictures.samples, pictures.tiles, pictures.long)
    names = ("name", "knob", "same_as", "settings", "tier", "unbiased")
    named = [{name: getattr(each.configuration, name) for name in names} | {"start_s": each.start_s} for each in ready]
    counts = tradeoff_errors.draws(pictures.seeds, np.random.default_rng(_DRAWS_SEED))
    samples = (*pictures.samples, pictures.long.samples)
    return tradeoff_errors.measurements(named, errors, pictures.timings, samples, counts)
