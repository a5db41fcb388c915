"""Does the advice of ``rptcam tradeoff`` hold? Scenes rendered as advised, beside the predicted errors and times.

    python -m benchmarks.advice [NAME …] [--budget 40] [--json FILE] [--markdown FILE]

Each scene is measured, and then rendered with the settings and samples that the advice names, for a time and for an
error, with seeds that the measurement did not have. The error is that against four independent, longer pictures of
``full``; products of differences from two of them are free of their noise. Beside each stands ``full`` after the same
time, which the advice must not be behind. Times are CPU times divided by the cores, which other work on the machine
disturbs little.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from benchmarks.obtained import Obtained, Reference, rendered
from benchmarks.report import arguments, machine, print_machine, table, write_json
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.tradeoff import Advice, TradeoffReport, caveats, per_cent, recommendation, seconds
from rptcam_cl.studies.tradeoff_errors import REFERENCE
from rptcam_cl.studies.tradeoff_runs import measure_tradeoff

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
RENDERS, REFERENCES = 3, 4
RENDER_SEED, REFERENCE_SEED, FULL_SEED = 910_000, 920_000, 930_000  # far from those of the measurement
TIME_OFF = 0.25
BEHIND = 1.05  # times the error of `full` after the same time that the advice may have
UNSURE = 0.2  # relative uncertainty of the squared error from which on nothing is said of it
COLUMNS = (
    "scene", "request", "advice", "spp", "predicted error", "measured", "predicted time", "measured", "full then",
    "verdict",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A scene file and what to advise for: a time to render [s] and an error."""

    name: str
    path: Path
    size: tuple[int, int]
    seconds: float
    error: float
    overrides: tuple[str, ...] = ()


CASES = (
    Case("landscape", EXAMPLES / "sunny_sixteen.yaml", (160, 90), 1.0, 0.03),
    Case("portrait", EXAMPLES / "portrait.yaml", (112, 140), 1.0, 0.2),
    Case("macro", EXAMPLES / "studio" / "movement.yaml", (144, 96), 1.0, 0.1),
    Case("fisheye interior", EXAMPLES / "reading_room.yaml", (112, 112), 1.0, 0.1),
    Case("chromatic test", EXAMPLES / "paper" / "figure_4.yaml", (144, 108), 1.0, 0.02),
)


@dataclass(frozen=True)
class Verdict:
    """An advice beside what came of it; `full` is the most accurate configuration after the same time."""

    scene: str
    advice: Advice
    settings: tuple[str, ...]
    promised_seconds: float
    obtained: Obtained
    full: Obtained | None
    faults: tuple[str, ...] = field(default=())

    @property
    def words(self) -> str:
        """What is wrong, or that it holds."""
        return "; ".join(self.faults) or "holds"


def faults(advice: Advice, promised_seconds: float, obtained: Obtained, full: Obtained | None) -> tuple[str, ...]:
    """Return what is wrong with an advice, given what came of it."""
    found = []
    low, high = obtained.ends()
    if obtained.uncertainty > UNSURE * max(obtained.relmse, advice.least_error**2):
        found.append("unsure")
    if low > advice.most_error:
        found.append("errs by more")
    if high < advice.least_error:
        found.append("errs by less")
    if abs(obtained.seconds / promised_seconds - 1) > TIME_OFF:
        found.append("time is off")
    if full is not None and full.ends()[1] * BEHIND < low:
        found.append("full is better")
    return tuple(found)


def check(case: Case, report: TradeoffReport, session: Session, reference_s: float) -> list[Verdict]:
    """Return what comes of each advice of a report.

    Parameters
    ----------
    case, report
        A scene, and what was measured of it.
    reference_s
        Time for all reference pictures [s].
    """
    full = report.measurements[0]
    count = max(int(reference_s / REFERENCES / full.sample_s.value), 2)
    pictures, _ = _render(case, full.settings, session, count, REFERENCE_SEED, REFERENCES)
    reference = Reference(pictures)
    done: dict[tuple[tuple[str, ...], int], Obtained] = {}

    def obtained(settings: tuple[str, ...], samples: int, seed: int) -> Obtained:
        if (settings, samples) not in done:
            done[settings, samples] = reference.of(*_render(case, settings, session, samples, seed, RENDERS))
        return done[settings, samples]

    verdicts = []
    for place, advice in enumerate(report.advice):
        if advice.chosen is None:
            continue
        chosen = report.named(advice.chosen)
        promised = advice.samples * chosen.sample_s.value
        came = obtained(chosen.settings, advice.samples, RENDER_SEED + 100 * place)
        beside = None
        if advice.chosen != REFERENCE:
            samples = max(round(promised / full.sample_s.value), 2)
            beside = obtained(full.settings, samples, FULL_SEED + 100 * place)
        wrong = faults(advice, promised, came, beside)
        verdicts.append(Verdict(case.name, advice, chosen.settings, promised, came, beside, wrong))
    return verdicts


def _render(
    case: Case, settings: Sequence[str], session: Session, samples: int, seed: int, count: int
) -> tuple[list[Any], float]:
    scene = load_scene(case.path, [*case.overrides, *settings, f"film.resolution={list(case.size)}"])
    return rendered(scene, session, samples, [seed + i for i in range(count)])


def measured(case: Case, session: Session, budget: float) -> TradeoffReport:
    """Return the comparison of a scene's configurations."""
    scene = load_scene(case.path, case.overrides)
    return measure_tradeoff(
        scene, budget=budget, seconds=case.seconds, error=case.error, size=case.size, device=session
    )


def row(verdict: Verdict) -> list[str]:
    """Return the table row of a verdict."""
    advice, came = verdict.advice, verdict.obtained
    wish = f"in {seconds(advice.amount)}" if advice.wish == "time" else f"to {per_cent(advice.amount)}"
    low, high = came.ends()
    return [
        verdict.scene,
        wish,
        str(advice.chosen),
        str(advice.samples),
        f"{100 * advice.least_error:.2f} to {100 * advice.most_error:.2f} %",
        f"{100 * came.error:.2f} ({100 * low:.2f} to {100 * high:.2f}) %",
        seconds(verdict.promised_seconds),
        seconds(came.seconds),
        "-" if verdict.full is None else f"{100 * verdict.full.error:.2f} %",
        verdict.words,
    ]


def main() -> int:
    """Run the check; the exit code is 1 when an advice does not hold."""
    parser = arguments("Does the advice of rptcam tradeoff hold?")
    parser.add_argument("names", nargs="*", metavar="NAME", help="scenes, by the beginning of their name (default all)")
    parser.add_argument("--budget", type=float, default=40.0, help="time of a measurement [s] (default 40)")
    parser.add_argument("--reference", type=float, default=20.0, help="time of the references [s] (default 20)")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table to a file, too")
    options = parser.parse_args()
    device = choose_device(options.device)
    session = open_session(device.id)
    facts = machine(device)
    verdicts, said = [], {}
    for case in _chosen(options):
        report = measured(case, session, 1.0 if options.quick else options.budget)
        said[case.name] = [*recommendation(report), *caveats(report)]
        verdicts += (found := check(case, report, session, 1.0 if options.quick else options.reference))
        for verdict in found:
            print(" | ".join(row(verdict)), file=sys.stderr)
    print_machine(facts | {"load_average_after": machine(device)["load_average"]})
    text = table("Advice and results", COLUMNS, [row(verdict) for verdict in verdicts])
    print(text)
    if options.markdown is not None:
        options.markdown.write_text(text + "\n", encoding="utf-8")
    told = [asdict(verdict) | {"verdict": verdict.words} for verdict in verdicts]
    write_json(options.json, facts, {"verdicts": told, "said": said})
    return int(any(verdict.faults for verdict in verdicts) and not options.quick)


def _chosen(options: argparse.Namespace) -> list[Case]:
    named = [case for case in CASES if not options.names or any(case.name.startswith(n) for n in options.names)]
    if not options.quick:
        return named
    return [replace(case, size=(case.size[0] // 4, case.size[1] // 4), seconds=0.2, error=0.2) for case in named]


if __name__ == "__main__":
    raise SystemExit(main())
