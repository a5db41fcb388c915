"""The Python interface of the comparison."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rptcam_cl.cameras import ghost_setting
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Session, open_session
from rptcam_cl.focusing import in_focus
from rptcam_cl.lenstools import chart_svg
from rptcam_cl.optics import Lit, find_ghosts
from rptcam_cl.rendering import diffraction_of, resolve_exposure
from rptcam_cl.scene import Scene, change_scene, load_scene
from rptcam_cl.tradeoff.advice import for_error, for_time
from rptcam_cl.tradeoff.comparison import Comparison
from rptcam_cl.tradeoff.errors import pair_errors
from rptcam_cl.tradeoff.ladder import Ladder, ladder, most_accurate
from rptcam_cl.tradeoff.measurement import Measurement, measurements
from rptcam_cl.tradeoff.plot import tradeoff_plot
from rptcam_cl.tradeoff.runs import Ready, prepare
from rptcam_cl.tradeoff.schedule import Pictures, render_by_turns
from rptcam_cl.tradeoff.statistics import draws
from rptcam_cl.tradeoff.table import markdown, plain_text

BUDGET_S = 60.0
WISHED_S, WISHED_ERROR = 60.0, 0.02
DRAWS_SEED = 7  # of the bootstrap
TITLE = "Accuracy and time"

Tell = Callable[[str, float], Any]
"""Takes what is being done and the share of the work that is done."""


class TradeoffReport(Comparison):
    """A comparison that writes itself as text, as Markdown and as a plot."""

    def __str__(self) -> str:
        """Return advice, tables and how they were found, as ``rptcam tradeoff --details`` prints them."""
        return plain_text(self)

    def markdown(self, title: str = TITLE) -> str:
        """Return the same as Markdown."""
        return markdown(self, title)

    def svg(self, title: str = TITLE) -> str:
        """Return the three pictures as the text of an SVG file: errors over time and over the field, and where."""
        return chart_svg(tradeoff_plot(self, title))

    def _repr_markdown_(self) -> str:
        return self.markdown()


def measure_tradeoff(
    scene: Scene | str | Path | Mapping[str, Any],
    *,
    budget: float = BUDGET_S,
    seconds: float = WISHED_S,
    error: float = WISHED_ERROR,
    size: tuple[int, int] | None = None,
    device: str | Session | None = None,
    on_progress: Tell | None = None,
) -> TradeoffReport:
    """Return what each approximation of a scene's picture costs and gains, and which to take; see docs/tradeoff.md.

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
    _check_wishes(budget=budget, seconds=seconds, error=error)
    begun = time.perf_counter()
    tell = on_progress or (lambda words, share: None)
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    if size is not None:
        scene = change_scene(scene, film={"resolution": size})
    session = device if isinstance(device, Session) else open_session(device)
    tell("focus and exposure", 0.0)
    fixed = _with_focus_and_exposure(scene, session)
    steps = ladder(fixed)
    ready, impossible = _prepared(steps, session, tell)
    left = max(budget - (time.perf_counter() - begun), budget / 3)
    pictures = render_by_turns(ready, left, scene.render.seed, lambda words, share: tell(words, 0.3 + 0.7 * share))
    _check_light(pictures, fixed)
    tell("errors", 1.0)
    found = _measured(ready, pictures)
    return TradeoffReport(
        **_conditions(fixed, session, ready, pictures),
        seconds=time.perf_counter() - begun,
        measurements=tuple(found),
        advice=(for_time(found, seconds), for_error(found, error)),
        cameras=() if steps.decision is None else steps.decision.errors,
        allowed="" if steps.decision is None else steps.decision.tier,
        skipped=steps.skipped | impossible,
        diffraction=_diffraction(fixed),
        ghosts=_ghosts(fixed),
        budget=budget,
    )


def _check_wishes(**wishes: float) -> None:
    for name, value in wishes.items():
        most, allowed = (1.0, "between 0 and 1") if name == "error" else (math.inf, "above 0, in seconds")
        if not (isinstance(value, int | float) and 0 < value < most):
            raise InputError(f"{name}: is out of range (got {value!r}; allowed: a number {allowed})")


def _with_focus_and_exposure(scene: Scene, session: Session) -> Scene:
    """Return the scene in focus, with the exposure that its most accurate picture is metered to."""
    sharp, _ = in_focus(scene, session, None)
    shot = resolve_exposure(most_accurate(sharp).scene, session)
    return change_scene(sharp, exposure=_given(shot.scene.exposure), shutter=_given(shot.scene.shutter))


def _diffraction(scene: Scene) -> dict[str, Any] | None:
    """Return what `camera.diffraction: auto` decides; None for a camera that has no opening."""
    found = diffraction_of(change_scene(scene, camera={"diffraction": "auto"}))
    return None if found is None or found.airy_radius_px is None else found.metadata


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
        found = find_ghosts(lit)
    except InputError:
        return None
    return sum(ghost.flux_in_frame for ghost in found.ghosts) / found.reference


def _prepared(steps: Ladder, session: Session, tell: Tell) -> tuple[list[Ready], dict[str, str]]:
    """Return the configurations compiled, and why others cannot be."""
    count = len(steps.configurations)
    return prepare(steps.configurations, session, lambda name, done: tell(f"preparing: {name}", 0.3 * done / count))


def _check_light(pictures: Pictures, scene: Scene) -> None:
    if not any(picture.any() for picture in pictures.pixels[0]):
        raise InputError(
            "the picture is black, so that there is nothing to compare (allowed: a scene whose light reaches the"
            f" camera within render.max_depth, which is {scene.render.max_depth})"
        )


def _conditions(scene: Scene, session: Session, ready: list[Ready], pictures: Pictures) -> dict[str, Any]:
    """Return what was compared and how: the members of a report that no measurement is in."""
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
        "lens_colour_px": ready[0].facts.get("lens_colour_px"),
        "truncation": ready[0].truncation,
    }


def _given(part: Any) -> dict[str, Any]:
    return {name: getattr(part, name) for name in part.model_fields_set}


def _measured(ready: list[Ready], pictures: Pictures) -> list[Measurement]:
    errors = pair_errors(pictures.pixels, pictures.samples, pictures.tiles, pictures.long)
    named = [
        {
            "name": each.configuration.name,
            "knob": each.configuration.knob,
            "same_as": each.configuration.same_as,
            "settings": each.configuration.settings,
            "tier": each.configuration.tier,
            "unbiased": each.configuration.unbiased,
            "start_s": each.start_s,
        }
        for each in ready
    ]
    counts = draws(pictures.seeds, np.random.default_rng(DRAWS_SEED))
    samples = (*pictures.samples, pictures.long.samples)
    return measurements(named, errors, pictures.timings, samples, counts)
