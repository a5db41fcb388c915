"""The advice in plain words, and how reliable its numbers are."""

from __future__ import annotations

import math

import numpy as np

from rptcam_cl.tradeoff.comparison import Comparison
from rptcam_cl.tradeoff.headline import FULL, called, headline
from rptcam_cl.tradeoff.ladder import REFERENCE
from rptcam_cl.tradeoff.measurement import Measurement
from rptcam_cl.tradeoff.tiers.errors import FIELDS, TierError
from rptcam_cl.tradeoff.words import bias, per_cent, pixels, seconds

MEANT = "Errors are relative to each pixel's brightness (root mean square over the picture), noise included."
LATE = 1.1  # times the budget, from which the report says what took longer
SHOWS_LOAD = 1.3  # ratio of wall time to CPU time from which the report mentions it
PLACES = (("top", "middle", "bottom"), ("left", "centre", "right"))


def recommendation(report: Comparison) -> list[str]:
    """Return sentences: the advice, the meaning of its terms, then what else was found."""
    chosen = list(dict.fromkeys(advice.chosen for advice in report.advice if advice.chosen is not None))
    said = [*headline(report), *_meant(report)]
    said += [_differs(report, report.named(name)) for name in chosen if name != REFERENCE]
    said += _camera(report)
    said += _depth(report)
    return said


def caveats(report: Comparison) -> list[str]:
    """Return sentences on how the numbers were found."""
    rendered, every = report.tiles
    made = "every tile" if rendered == every else f"{rendered} of {every} tiles"
    first, second, most = report.samples
    said = [
        f"Measured in {seconds(report.seconds)} on {report.device}: {made} of a picture of"
        f" {report.resolution[0]} x {report.resolution[1]} pixels, {report.seeds} seeds with {first} and {second}"
        f" samples per pixel, {report.long_tiles} tiles with {most}. Brackets are intervals of 95 %."
    ]
    said += [*unsure(report), *longer(report)]
    clock = report.measurements[0].wall_sample_s.value / report.measurements[0].sample_s.value
    if report.by_cpu:
        said.append("Times are CPU times divided by the number of cores: those of a render on an idle machine.")
    if clock > SHOWS_LOAD:
        said.append(f"Wall times were {clock:.1f} times as long, as other work shared the machine or cores were idle.")
    said += [f"The same picture: {' = '.join((f.name, *f.same_as))}." for f in report.measurements if f.same_as]
    reasons: dict[str, list[str]] = {}
    for name, why in report.skipped.items():
        reasons.setdefault(why, []).append(name)
    said += [f"Not compared: {', '.join(names)} ({why})." for why, names in reasons.items()]
    return said


def unsure(report: Comparison) -> list[str]:
    """Return a warning where the noise of an advised configuration or the reference comes from rare bright paths."""
    names = dict.fromkeys([REFERENCE, *(advice.chosen for advice in report.advice)])
    rare = [called(report, name) for name in names if name is not None and report.named(name).has_rare_paths]
    if not rare:
        return []
    return [
        f"The noise of {' and of '.join(rare)} comes from rare bright paths: errors and times may be off by more than"
        " the intervals show; a longer measurement (--budget) meets more of them."
    ]


def longer(report: Comparison) -> list[str]:
    """Return why measuring took longer than it was to."""
    if not report.budget or report.seconds <= LATE * report.budget:
        return []
    preparing = sum(found.start_s for found in report.measurements)
    first = report.measurements[0]
    busy = first.wall_sample_s.value / first.sample_s.value
    shared = f"; renders took {busy:.1f} times as long as on an idle machine" if busy > SHOWS_LOAD else ""
    return [
        f"Measuring took {seconds(report.seconds)} in place of {seconds(report.budget)}: preparing"
        f" {len(report.measurements)} ways to render took {seconds(preparing)}, renders and all else"
        f" {seconds(report.seconds - preparing)}{shared}."
    ]


def _meant(report: Comparison) -> list[str]:
    """Return what an error and full accuracy mean."""
    how = ": every ray through every surface of the lens" if report.allowed else ", with its own camera"
    return [
        MEANT,
        f"{FULL[0].upper()}{FULL[1:]} ({REFERENCE} in the tables) is the most accurate way to render the scene{how}.",
    ]


def _differs(report: Comparison, found: Measurement) -> str:
    name = called(report, found.name)
    if found.unbiased:
        return f"The only change by {name} is in the noise."
    sure = found.sure_bias_of_tiles
    where = f", most at the {place(sure, report.grid)}" if sure.any() and found.bias.low > 0 else ""
    camera = report.camera_of(found)
    at = f", {_over_field(camera)}" if camera is not None else ""
    apart = bias(found.bias)
    if apart == "none":
        return f"No difference between {name} and {FULL} was measured, except in time."
    more = "; a longer measurement would be more precise" if found.bias.low <= 0 else ""
    apart = apart.replace("below", "less than")
    return f"Without noise, {name} differs from {FULL} by {apart}{where}{at}{more}."


def place(values: np.ndarray, grid: tuple[int, int]) -> str:
    """Return in words which ninth of the picture has the largest mean."""
    rows, columns = grid
    cells = values.reshape(rows, columns)
    means = [
        (float(part.mean()), y, x)
        for y, band in enumerate(np.array_split(cells, 3, axis=0))
        for x, part in enumerate(np.array_split(band, 3, axis=1))
        if part.size
    ]
    _, y, x = max(means)
    return " ".join(dict.fromkeys((PLACES[0][y], PLACES[1][x]))) if (y, x) != (1, 1) else "centre"


def _over_field(camera: TierError) -> str:
    worst = int(np.argmax(camera.pixels))
    if math.isinf(camera.pixels[worst]):
        return (
            f"{pixels(camera.pixels[0])} on the axis; at {FIELDS[worst]:g} of the half diagonal the lens sees nothing"
        )
    return (
        f"{pixels(camera.pixels[0])} on the axis and at most {pixels(camera.worst_px)}"
        f" (at {FIELDS[worst]:g} of the half diagonal), brightness by up to {per_cent(camera.worst_illumination)}"
    )


def _camera(report: Comparison) -> list[str]:
    said = []
    if report.allowed == "realistic":
        said.append("camera.accuracy: auto traces every ray, as no cheaper camera is within half a pixel and 1 %.")
    elif report.allowed:
        camera = next(each for each in report.cameras if each.tier == report.allowed)
        said.append(f"camera.accuracy: auto uses the {report.allowed.replace('_', ' ')}: {_over_field(camera)}.")
    if report.lens_colour_px is not None:
        said.append(f"The lens moves light of other wavelengths by up to {pixels(report.lens_colour_px)}.")
    if report.diffraction is not None:
        said.append(f"camera.diffraction: auto is {report.diffraction['says']}. None of the pictures here has it.")
    if report.ghosts is not None:
        said.append(
            f"camera.ghosts: on adds {per_cent(report.ghosts)} of the light of a lamp in the middle of the frame, out"
            " of focus. None of the pictures here has it."
        )
    return said


def _depth(report: Comparison) -> list[str]:
    depth, bound = report.truncation["max_depth"], report.truncation["bound"]
    paths = f"Light paths end after {depth} edges (render.max_depth), also with {FULL}"
    if bound is None:
        return [f"{paths}; there is no bound on what longer ones add ({report.truncation['no_bound_because']})."]
    largest = report.truncation["largest_albedo"]
    return [
        f"{paths}; longer ones add at most {per_cent(bound)} of the radiance of the brightest lamp"
        f" (reflectances up to {largest:.2g})."
    ]
