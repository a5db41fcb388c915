"""Which configurations of ``rptcam tradeoff`` does its advice choose, on which of the example scenes?

    python -m benchmarks.advised [SCENE …] [--budget 25] [--json FILE]

One measurement of a scene gives the advice for every time and error at once. A configuration that gives the same
picture as ``full`` on a scene is not counted there. "May be better" counts scenes where the advice names a
configuration as possibly better, and never chooses it.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import open_session
from rptcam_cl.studies.tradeoff import TradeoffReport, advise_for_error, advise_for_time
from rptcam_cl.studies.tradeoff_errors import REFERENCE
from rptcam_cl.studies.tradeoff_runs import measure_tradeoff

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SECONDS = (1.0, 10.0, 60.0, 600.0, 3600.0)
ERRORS = (0.2, 0.1, 0.05, 0.02, 0.01)
QUICK = ("first_light",)
COMPARED, CHOSEN, PERHAPS = "compared", "chosen", "may be better"


def names() -> list[str]:
    """Return the names of all example scenes, as ``studio/workshop``."""
    return sorted(str(path.relative_to(EXAMPLES).with_suffix("")) for path in EXAMPLES.rglob("*.yaml"))


def advised(report: TradeoffReport) -> dict[str, str]:
    """Return for each configuration that differs from ``full`` what the advice says of it."""
    found = report.measurements
    advice = [
        *(advise_for_time(found, time) for time in SECONDS),
        *(advise_for_error(found, error) for error in ERRORS),
    ]
    chosen, perhaps = ({getattr(each, part) for each in advice} for part in ("chosen", "perhaps"))
    said = {}
    for each in found:
        verdict = CHOSEN if each.name in chosen else PERHAPS if each.name in perhaps else COMPARED
        said |= dict.fromkeys([each.name] if each.name == REFERENCE else [each.name, *each.same_as], verdict)
    return said


def rows(said: dict[str, dict[str, str]]) -> list[list[str]]:
    """Return a row for each configuration: on how many scenes it differs, is chosen, and may be better; and which."""
    configurations = dict.fromkeys(name for each in said.values() for name in each)
    made = []
    for name in configurations:
        on = {scene: verdicts[name] for scene, verdicts in said.items() if name in verdicts}
        chosen = [scene for scene, verdict in on.items() if verdict == CHOSEN]
        which = ", ".join(chosen) if len(chosen) < len(said) else "all"
        made.append([name, str(len(on)), str(len(chosen)), str(list(on.values()).count(PERHAPS)), which])
    return sorted(made, key=lambda row: -int(row[2]))


def main() -> None:
    """Measure every scene, print the table and write the numbers."""
    parser = arguments(__doc__ or "")
    parser.add_argument("names", nargs="*", metavar="SCENE", help="names below examples/ (default: all)")
    parser.add_argument("--budget", type=float, default=25.0, help="time of a measurement [s] (default 25)")
    options = parser.parse_args()
    device = choose_device(options.device)
    session, facts = open_session(device.id), machine(device)
    said = {}
    for name in QUICK if options.quick else options.names or names():
        report = measure_tradeoff(
            EXAMPLES / f"{name}.yaml",
            budget=1.0 if options.quick else options.budget,
            size=(64, 36) if options.quick else None,
            device=session,
        )
        said[name] = advised(report)
    print_machine(facts)
    columns = ("configuration", "differs from full", "advised", "may be better", "advised on")
    print_table("Number of example scenes", columns, rows(said))
    write_json(options.json, facts, said)


if __name__ == "__main__":
    main()
