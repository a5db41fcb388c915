"""How a configuration is asked for: what to set in a scene."""

from __future__ import annotations

import math

from rptcam_cl.tradeoff.ladder import AS_IT_IS
from rptcam_cl.tradeoff.measurement import Measurement
from rptcam_cl.tradeoff.report import TradeoffReport

MARGIN = 1.02  # of bounds that a camera model is asked for by, so that rounding does not exclude it


def setting(report: TradeoffReport, found: Measurement) -> str:
    """Return what ``rptcam render --set`` takes to render a scene so; empty where nothing or no one key does.

    All but the one thing stays as in the scene, which matters where that itself differs from the most accurate one.
    """
    if AS_IT_IS in (found.name, *found.same_as):
        return ""
    value = found.name.partition(": ")[2] or found.name.rpartition(" ")[2]
    match found.knob:
        case "pupil":
            return f"camera.pupil={value}"
        case "spectrum":
            return f"spectrum={value}"
        case "depth":
            return f"render.max_depth={value}"
        case "sampler":
            return "render.sampler=independent"
        case "combination":
            return "camera.accuracy=auto"
        case "camera":
            return _by_accuracy(report, found)
    return "spectrum.lens=on"


def _by_accuracy(report: TradeoffReport, found: Measurement) -> str:
    """Return the bounds that choose a camera model, where it is the cheapest one within them."""
    own = report.camera_of(found)
    if own is None or math.isinf(own.worst_px) or math.isinf(own.worst_illumination):
        return ""
    pixels, light = MARGIN * own.worst_px, MARGIN * own.worst_illumination
    within = [
        each.tier for each in report.cameras if each.worst_px <= pixels and each.worst_illumination <= light
    ]  # cheapest first
    if within[0] != found.tier:
        return ""
    return f"camera.accuracy={{max_error_px: {pixels:.4g}, max_illumination_error: {light:.4g}}}"
