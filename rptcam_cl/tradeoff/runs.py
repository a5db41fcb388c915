"""Short renders of every configuration by turns, with what each took of the clock and of the processor."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError, InputError
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan, make_plan
from rptcam_cl.rendering import FilmLayout, Wavefront, aimed_plan, check_precision, truncation
from rptcam_cl.scene import RenderSettings
from rptcam_cl.tradeoff.ladder import Variant
from rptcam_cl.tradeoff.tiles import SpreadTiles

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ready:
    """A configuration that is compiled.

    Attributes
    ----------
    configuration : Variant
    wavefront : Wavefront
    start_s : float
        Time from the scene to the first ray [s]; programs shared with an earlier configuration are there already.
    facts : dict
        What a picture's metadata would say of camera and spectrum.
    truncation : dict
        Bound on the light of longer paths, from `rendering.truncation`.
    """

    configuration: Variant
    wavefront: Wavefront
    start_s: float
    facts: dict[str, Any]
    truncation: dict[str, Any]


@dataclass(frozen=True)
class Run:
    """One short render: pixels (p, 3) of the tiles, and times [s] of the clock and of all threads of the process."""

    pixels: NDArray[np.float32]
    wall_s: float
    cpu_s: float


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
    found: list[Ready] = []
    skipped: dict[str, str] = {}
    for done, configuration in enumerate(configurations):
        on_step(configuration.name, done)
        begun = time.perf_counter()
        try:
            plan = make_plan(configuration.scene)
            check_precision(session, plan.camera)
        except (InputError, DeviceError) as problem:
            if not found:
                raise
            skipped[configuration.name] = str(problem)
            continue
        known_as = mark(plan, configuration.scene.render)
        if known_as in seen:
            same = found[seen[known_as]]
            known = same.configuration.also(configuration)
            found[seen[known_as]] = replace(same, configuration=known)
            continue
        seen[known_as] = len(found)
        layout, settings = FilmLayout.of(configuration.scene.film), configuration.scene.render
        plan, buffers = aimed_plan(plan, session, settings.layers)
        wavefront = Wavefront(session, plan, layout, settings, buffers=buffers)
        wavefront.warm_up()
        facts = plan.camera.metadata | plan.spectrum.metadata
        rest = truncation(plan.albedo, configuration.scene.render.max_depth)
        found.append(Ready(configuration, wavefront, time.perf_counter() - begun, facts, rest))
    return found, skipped


def mark(plan: Plan, settings: RenderSettings) -> bytes:
    """Return what two configurations that render the same picture have in common."""
    camera = plan.camera
    arrays = (camera.record, camera.tables, camera.surfaces, camera.stop, plan.spectrum.table)
    words = (camera.kernel, sorted(camera.facts.items()), sorted(plan.facts.items()), settings.max_depth)
    return repr((words, settings.roulette_depth)).encode() + b"".join(array.tobytes() for array in arrays)


def run(ready: Ready, tiles: SpreadTiles, samples: int, seed: int) -> Run:
    """Render the tiles once."""
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
    return Run(mean.astype(np.float32), wall, cpu)


def undisturbed_clock(device_type: str) -> Callable[[], float]:
    """Return a clock [s] that other work on the machine does not move: of a processor its time over all cores."""
    return (lambda: time.process_time() / cores()) if device_type == "cpu" else time.perf_counter


def cores() -> int:
    """Return how many processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
