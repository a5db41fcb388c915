"""``rptcam devices``, ``doctor`` and ``schema``: what renders run on, and what files may hold."""

import argparse
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from rptcam_cl.cli.output import as_bytes, as_json
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.errors import DeviceError, NumericError

if TYPE_CHECKING:
    from rptcam_cl.studies.selfcheck import Check


# ``rptcam devices``: the OpenCL devices that a render may run on.


def add_devices(commands: Commands) -> None:
    """Add the command."""
    text = "list the OpenCL devices"
    parser = commands.add_parser("devices", help=text, description=text.capitalize() + "; * marks the default.")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run_devices, parser=parser)


def _line(device: dict[str, Any]) -> str:
    mark = "*" if device["default"] else " "
    precision = "fp64" if device["fp64"] else "fp32 only"
    facts = f"{device['compute_units']} compute units, {as_bytes(device['memory_bytes'])}, {precision}"
    barred = f"\n{'':8}cannot be used: {device['problem']}" if device["problem"] else ""
    return f"{mark} {device['id']:<5} {device['type']}  {device['name']} ({device['platform']}; {facts}){barred}"


def _run_devices(arguments: argparse.Namespace) -> int:
    from rptcam_cl.api.interface import devices

    found = devices()
    print(as_json(found) if arguments.json else "\n".join(map(_line, found)))
    return 0


# ``rptcam doctor``: what renders run on, and whether the devices compute what they should.


def add_doctor(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "doctor",
        help="report on versions, devices and caches; check the devices",
        description="Report on versions, devices with their drivers, and caches. With --numerics, check what the"
        " devices compute at the extremes, in half a minute each. Send the output with a bug report.",
    )
    parser.add_argument(
        "--numerics", action="store_true", help="check what the devices compute; exit code 5 on failure"
    )
    parser.add_argument(
        "--device", metavar="SPEC", help="report on this device alone, as in render (default: every device found)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run_doctor, parser=parser)


def _check_line(check: "Check") -> str:
    if check.skipped:
        return f"  skip {check.name:<49} {check.note}"
    verdict = "FAIL" if check.failed else "ok  "
    note = f" ({check.note})" if check.note else ""
    return f"  {verdict} {check.name:<49} {check.measured:>9.3g}  allowed {check.allowed:.3g} {check.unit}{note}"


def _checked(device: str, show: bool) -> Iterator[dict[str, Any]]:
    """Yield the checks of a device as plain data, and print each as soon as it is made."""
    from rptcam_cl.device.session import open_session
    from rptcam_cl.studies.selfcheck_suite import outcomes

    session = open_session(device)
    for outcome in outcomes(session):
        for check in outcome.checks:
            if show:
                print(_check_line(check), flush=True)
            yield {**vars(check), "passed": check.passed, "failed": check.failed, "seconds_of_part": outcome.seconds}


def _numerics(devices: list[dict[str, Any]], show: bool) -> dict[str, list[dict[str, Any]]]:
    """Return the checks of devices, by the device's id."""
    found: dict[str, list[dict[str, Any]]] = {}
    for device in devices:
        if show:
            print(f"\nnumerics of {device['id']} {device['name']}", flush=True)
        found[device["id"]] = list(_checked(device["id"], show))
        if show:
            made = [check for check in found[device["id"]] if not check["skipped"]]
            skipped = len(found[device["id"]]) - len(made)
            rest = f", {skipped} skipped" if skipped else ""
            print(f"  {sum(check['passed'] for check in made)} of {len(made)} checks passed{rest}")
    return found


def _run_doctor(arguments: argparse.Namespace) -> int:
    from rptcam_cl.studies.selfcheck_suite import as_lines, environment

    found = environment(arguments.device)
    if not arguments.json:
        print("\n".join(as_lines(found)), flush=True)
    if arguments.numerics and found["devices"]:
        usable = [device for device in found["devices"] if device["problem"] is None]
        found["numerics"] = _numerics(usable, not arguments.json)
    if arguments.json:
        print(as_json(found))
    sys.stdout.flush()
    if "no_device" in found:
        raise DeviceError(found["no_device"])
    failed = sum(check["failed"] for checks in found.get("numerics", {}).values() for check in checks)
    if failed:
        what = "1 check" if failed == 1 else f"{failed} checks"
        raise NumericError(f"{what} failed; please send the report above to the authors")
    return 0


# ``rptcam schema``: the JSON schema of scene or lens files, for editors that complete and check.


def add_schema(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "schema",
        help="print the JSON schema of scene or lens files",
        description="Print the JSON schema of scene files, for editors that complete and check.",
    )
    parser.add_argument("--lens", action="store_true", help="of lens files instead")
    parser.set_defaults(run=_run_schema, parser=parser)


def _run_schema(arguments: argparse.Namespace) -> int:
    if arguments.lens:
        from rptcam_cl.optics.files.keys import lens_json_schema_text

        print(lens_json_schema_text(), end="")
        return 0
    from rptcam_cl.scene.load import scene_json_schema_text

    print(scene_json_schema_text(), end="")
    return 0
