"""The measurements as tables, and the whole report as Markdown."""

from __future__ import annotations

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.tradeoff.comparison import Comparison
from rptcam_cl.tradeoff.headline import headline
from rptcam_cl.tradeoff.ladder import REFERENCE
from rptcam_cl.tradeoff.measurement import TARGETS, Measurement
from rptcam_cl.tradeoff.text import MEANT, caveats, longer, recommendation, unsure
from rptcam_cl.tradeoff.tiers.errors import FIELDS
from rptcam_cl.tradeoff.words import bias, crossing, ends, noise, per_cent, pixels, seconds

SHOWN_FIELDS = (0.0, 0.5, 0.7, 1.0)
ERROR_COLUMNS = ("configuration", "bias", "brightness", f"better than {REFERENCE} until")
COST_COLUMNS = (
    "configuration", "a sample", "noise after 1 s", *(f"to {per_cent(target)}" for target in TARGETS), "start"
)  # fmt: skip
CAMERA_COLUMNS = ("camera", *(f"at {field:g}" for field in SHOWN_FIELDS), "brightness at 1")


@dataclass(frozen=True)
class Table:
    """Rows of texts under the names of their columns, with a title."""

    title: str
    columns: tuple[str, ...]
    rows: list[list[str]]


def tables(report: Comparison) -> list[Table]:
    """Return the errors of the configurations, their costs, and the errors of cheaper cameras if there are any."""
    found = report.measurements
    wrong = f"Error against {REFERENCE}, without noise"
    taken = "Cost: time of one sample per pixel, noise, time to an error, time before the first ray"
    over = "How far cheaper cameras displace light, from the middle of the picture (0) to its corner (1)"
    made = [Table(wrong, ERROR_COLUMNS, [_errors(each) for each in found if each.knob])]
    made.append(Table(taken, COST_COLUMNS, [_costs(each) for each in found]))
    if cameras := _cameras(report):
        made.append(Table(over, CAMERA_COLUMNS, cameras))
    return made


def _errors(found: Measurement) -> list[str]:
    return [found.name, bias(found.bias), ends(found.energy, per_cent), crossing(found.better_until)]


def _costs(found: Measurement) -> list[str]:
    return [
        found.name,
        ends(found.sample_s),
        noise(max(found.rate.value, 0.0) ** 0.5),
        *(ends(found.seconds_to[target]) for target in TARGETS),
        seconds(found.start_s),
    ]


def _cameras(report: Comparison) -> list[list[str]]:
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


def summary(report: Comparison) -> list[str]:
    """Return the lines that the command prints without its details: the advice, its terms, and doubts."""
    doubts = [*unsure(report), *longer(report)]
    return [*headline(report), "", MEANT, *doubts, "All numbers and how they were found: --details."]


def plain_text(report: Comparison) -> str:
    """Return the report as text, its tables in plain columns."""
    parts = [f"{table.title}\n{_aligned(table)}" for table in tables(report)]
    return "\n\n".join(["\n".join(recommendation(report)), *parts, "\n".join(caveats(report))])


def _aligned(table: Table) -> str:
    lines = [table.columns, *table.rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.rjust, line, widths)).rstrip() for line in lines)


def markdown(report: Comparison, title: str) -> str:
    """Return the report as Markdown."""
    parts = [f"# {title}", "\n".join(f"- {line}" for line in recommendation(report))]
    parts += [f"{table.title}:\n\n{_written(table)}" for table in tables(report)]
    return "\n\n".join([*parts, "\n".join(f"- {line}" for line in caveats(report))]) + "\n"


def _written(table: Table) -> str:
    lines = [table.columns, ["---"] * len(table.columns), *table.rows]
    return "\n".join("| " + " | ".join(text.replace("|", "\\|") for text in line) + " |" for line in lines)
