"""The measurements as a table, and the whole report as Markdown."""

from __future__ import annotations

from rptcam_cl.accuracy.errors import FIELDS
from rptcam_cl.tradeoff.measurement import TARGETS, Measurement
from rptcam_cl.tradeoff.report import TradeoffReport
from rptcam_cl.tradeoff.text import caveats, recommendation
from rptcam_cl.tradeoff.words import bias, ends, per_cent, pixels, seconds, until

SHOWN_FIELDS = (0.0, 0.5, 0.7, 1.0)
COLUMNS = (
    "configuration", "a sample", "by the clock", "noise after 1 s", "bias", "energy",
    *(f"to {target:.0%}" for target in TARGETS), "better until", "start",
)  # fmt: skip
CAMERA_COLUMNS = ("camera", *(f"at {field:g}" for field in SHOWN_FIELDS), "brightness at 1")


def rows(report: TradeoffReport) -> list[list[str]]:
    """Return a row of texts for each configuration, in the order of `COLUMNS`."""
    return [_row(found) for found in report.measurements]


def _row(found: Measurement) -> list[str]:
    is_full = not found.knob
    return [
        found.name,
        ends(found.sample_s),
        seconds(found.wall_sample_s.value),
        per_cent(max(found.rate.value, 0.0) ** 0.5),
        "-" if is_full else bias(found.bias),
        "-" if is_full else ends(found.energy, per_cent),
        *(ends(found.seconds_to[target]) for target in TARGETS),
        "-" if is_full else ends(found.better_until, until),
        seconds(found.start_s),
    ]


def camera_rows(report: TradeoffReport) -> list[list[str]]:
    """Return a row of texts for each cheaper camera model, in the order of `CAMERA_COLUMNS`."""
    at = [FIELDS.index(field) for field in SHOWN_FIELDS]
    return [
        [
            camera.tier.replace("_", " "),
            *(pixels(camera.pixels[place]) for place in at),
            "dark" if camera.illumination[-1] == float("inf") else per_cent(camera.illumination[-1]),
        ]
        for camera in report.cameras
        if camera.tier != "realistic"
    ]


def markdown(report: TradeoffReport, title: str) -> str:
    """Return the report as Markdown."""
    parts = [f"# {title}", "\n".join(f"- {line}" for line in recommendation(report)), _table(COLUMNS, rows(report))]
    if report.cameras:
        parts += [
            "Error of cheaper camera models in pixels, over the half diagonal, by rays in float64:",
            _table(CAMERA_COLUMNS, camera_rows(report)),
        ]
    return "\n\n".join([*parts, "\n".join(f"- {line}" for line in caveats(report))]) + "\n"


def _table(columns: tuple[str, ...], cells: list[list[str]]) -> str:
    lines = [columns, ["---"] * len(columns), *cells]
    return "\n".join("| " + " | ".join(text.replace("|", "\\|") for text in line) + " |" for line in lines)
