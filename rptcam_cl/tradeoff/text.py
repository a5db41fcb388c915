"""The advice in plain words, and how far the numbers behind it can be trusted."""

from __future__ import annotations

import math

import numpy as np

from rptcam_cl.tradeoff.comparison import Advice, Comparison
from rptcam_cl.tradeoff.ladder import AS_IT_IS, REFERENCE
from rptcam_cl.tradeoff.measurement import Measurement
from rptcam_cl.tradeoff.tiers.errors import FIELDS, TierError
from rptcam_cl.tradeoff.words import between, bias, per_cent, pixels, seconds

FULL = "full accuracy"
SHOWS_LOAD = 1.3  # times the undisturbed time that the clock showed, from which on it is said
PLACES = (("top", "middle", "bottom"), ("left", "centre", "right"))


def recommendation(report: Comparison) -> list[str]:
    """Return sentences: what to take, how to ask for it, and what is meant; then what else was found."""
    said = [_advice(report, advice) for advice in report.advice]
    chosen = list(dict.fromkeys(advice.chosen for advice in report.advice if advice.chosen is not None))
    said += [sentence for name in chosen if (sentence := _sentence_of(report, report.named(name)))]
    said += _meant(report)
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
    said += _unsure(report)
    clock = report.measurements[0].wall_sample_s.value / report.measurements[0].sample_s.value
    if report.by_cpu:
        said.append("Times are CPU times divided by the cores: what a render takes with the machine to itself.")
    if clock > SHOWS_LOAD:
        said.append(
            f"By the clock all took {clock:.1f} times as long, as other work shared the machine or cores were idle."
        )
    said += [
        f"The same picture in every way: {' = '.join((f.name, *f.same_as))}." for f in report.measurements if f.same_as
    ]
    reasons: dict[str, list[str]] = {}
    for name, why in report.skipped.items():
        reasons.setdefault(why, []).append(name)
    said += [f"Not compared: {', '.join(names)} ({why})." for why, names in reasons.items()]
    return said


def _unsure(report: Comparison) -> list[str]:
    """Say of what is advised, and of what it is measured against, where noise hangs on paths that are rarely met."""
    names = dict.fromkeys([REFERENCE, *(advice.chosen for advice in report.advice)])
    rare = [_called(report, name) for name in names if name is not None and report.named(name).hangs_on_rare]
    if not rare:
        return []
    return [
        f"The noise of {' and of '.join(rare)} comes from rare bright paths: errors and times may be off by more than"
        " is told; a longer measurement (--budget) meets more of them."
    ]


def _advice(report: Comparison, advice: Advice) -> str:
    said = _for_time(report, advice) if advice.wish == "time" else _for_error(report, advice)
    if advice.perhaps is None:
        return f"{said}."
    perhaps = _called(report, advice.perhaps)
    return f"{said}. {perhaps[0].upper()}{perhaps[1:]} may do better; a longer measurement (--budget) would tell."


def _for_time(report: Comparison, advice: Advice) -> str:
    head = f"In {seconds(advice.amount)}"
    if advice.chosen is None:
        fastest = min(found.sample_s.value for found in report.measurements)
        return f"{head}: no picture; a sample in every pixel takes {seconds(fastest)} at least"
    errs = f"{between(advice.least_error, advice.most_error)} after {advice.samples} samples per pixel"
    take = f"{head}: take {_called(report, advice.chosen)}; its picture then errs by {errs}"
    if advice.chosen == REFERENCE:
        return f"{take}. No approximation is surely better"
    if math.isinf(advice.full_error):
        return f"{take}; {FULL} gives none so soon"
    return f"{take}, with {FULL} by {per_cent(advice.full_error)}"


def _for_error(report: Comparison, advice: Advice) -> str:
    head, takes = f"To an error of {per_cent(advice.amount)}", seconds(advice.seconds)
    if advice.chosen is None:
        return f"{head}: nothing gets there"
    take = f"{head}: take {_called(report, advice.chosen)}; that takes {takes} ({advice.samples} samples per pixel)"
    if advice.chosen == REFERENCE:
        return f"{take}. No approximation is surely faster"
    full, times = seconds(advice.full_seconds), advice.full_seconds / advice.seconds
    return f"{take}, {FULL} {full}, {times:.1f} times as long"


def _called(report: Comparison, name: str) -> str:
    """Return what to call a configuration in a sentence."""
    found = report.named(name)
    if AS_IT_IS in (name, *found.same_as):
        return f"the scene as it is{f' ({FULL})' if name == REFERENCE else ''}"
    if name == REFERENCE:
        return FULL
    return f"the {name}" if found.knob == "camera" else f"«{name}»"


def _sentence_of(report: Comparison, found: Measurement) -> str:
    sets = " ".join(f"--set '{text}'" for text in found.settings)
    return f"Ask for {_called(report, found.name)} by {sets}." if sets else ""


def _meant(report: Comparison) -> list[str]:
    """Say what an error is, and what full accuracy."""
    how = ": every ray through every surface of the lens" if report.allowed else ", with its own camera"
    return [
        "Errors are relative to each pixel's brightness (root mean square over the picture), noise included.",
        f"{FULL[0].upper()}{FULL[1:]} ({REFERENCE} in the tables) is the most accurate way to render the scene{how}.",
    ]


def _differs(report: Comparison, found: Measurement) -> str:
    called = _called(report, found.name)
    if found.unbiased:
        return f"What {called} changes is noise alone."
    sure = found.sure_bias_of_tiles
    where = f", most at the {place(sure, report.grid)}" if sure.any() and found.bias.low > 0 else ""
    camera = report.camera_of(found)
    at = f", {_over_field(camera)}" if camera is not None else ""
    apart = bias(found.bias)
    if apart == "none":
        return f"Nothing was seen that {called} does otherwise than {FULL}, except for time."
    more = "; a longer measurement would tell more" if found.bias.low <= 0 else ""
    apart = apart.replace("below", "less than")
    return f"With all noise gone, {called} would differ from {FULL} by {apart}{where}{at}{more}."


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
        said.append("camera.accuracy: auto would trace every ray: no cheaper camera keeps to half a pixel and 1 %.")
    elif report.allowed:
        camera = next(each for each in report.cameras if each.tier == report.allowed)
        said.append(f"camera.accuracy: auto would take the {report.allowed.replace('_', ' ')}: {_over_field(camera)}.")
    if report.lens_colour_px is not None:
        said.append(f"The lens moves light of other wavelengths by up to {pixels(report.lens_colour_px)}.")
    return said


def _depth(report: Comparison) -> list[str]:
    depth, bound = report.truncation["max_depth"], report.truncation["bound"]
    paths = f"Paths of light end after {depth} edges (render.max_depth), also with {FULL}"
    if bound is None:
        return [f"{paths}; what longer ones would add has no bound ({report.truncation['no_bound_because']})."]
    largest = report.truncation["largest_albedo"]
    return [
        f"{paths}; longer ones would add at most {per_cent(bound)} of the radiance of the brightest lamp"
        f" (reflectances up to {largest:.2g})."
    ]
