"""First steps: ``rptcam examples``, ``demo`` and ``view``; ``devices``, ``doctor`` and ``schema``."""

import argparse
import contextlib
import importlib.util
import io
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import add_options
from rptcam_cl.cli.output import Parser, add_device, as_bytes, as_json, port
from rptcam_cl.cli.render import add_render, run_render
from rptcam_cl.core.errors import DeviceError, InputError, NumericError
from rptcam_cl.core.files import (
    SCENES,
    check_writable,
    example_files,
    example_scenes,
    fresh_cache,
    make_folder,
    read_whole,
    replacing,
)

if TYPE_CHECKING:
    from rptcam_cl.studies.selfcheck import Check

# ``rptcam examples``: lists the scenes that come with the package, and copies one to be rendered and changed.

LARGEST = 1 << 26  # bytes of one file
GPU_REPORT = "rptcam_gpu_report.json"


def add_examples(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("scene", nargs="?", choices=tuple(SCENES), metavar="NAME", help="a scene of the list")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="folder to copy to, made if need be (default: the current one)"
    )


def run_examples(arguments: argparse.Namespace) -> int:
    """List the scenes that come with the package. With a name and -o, copy that scene and the files it reads to a
    folder, where it can be rendered and changed.
    """
    if arguments.scene is None:
        if arguments.output is not None:
            raise InputError(
                "rptcam examples: -o copies one scene; name it, as rptcam examples first_light -o my_scene"
            )
        _list()
        return 0
    scene = _copy_scene(arguments.scene, arguments.output or Path())
    command = shlex.join(["rptcam", "render", str(scene), "-o", f"{arguments.scene}.png"])
    print(f"wrote {scene}; render it with: {command}", file=sys.stderr)
    return 0


def _list() -> None:
    width = max(map(len, SCENES))
    for name, path in example_scenes().items():
        print(f"{name:{width}}  {_summary(path)}")


def _summary(path: Path) -> str:
    """Return the first sentence of the comment at the head of a scene."""
    lines = []
    for line in path.read_text("utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return " ".join(lines).partition(". ")[0].rstrip(".")


def _copy_scene(name: str, folder: Path) -> Path:
    """Copy the files of a scene to a folder and return its scene file there.

    Raises
    ------
    InputError
        When one of them would replace a file of other content; none is written then.
    """
    files = {folder / path.name: read_whole(path, LARGEST) for path in example_files(name)}
    for target, content in files.items():
        if target.exists() and not (target.is_file() and read_whole(target, 2 * LARGEST) == content):
            raise InputError(f"{target}: is there already and differs; choose another folder with -o, or move it away")
    make_folder(folder)
    for target, content in reversed(files.items()):  # the scene file last
        with replacing(target) as temporary:
            temporary.write_bytes(content)
    return next(iter(files))


# ``rptcam demo``: a first picture, from scenes that come with the package.


def add_demo(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "scene", nargs="?", choices=tuple(SCENES), default=next(iter(SCENES)), metavar="SCENE",
        help="another of its scenes (rptcam examples lists them)",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", metavar="OUT", help="picture to write (default: SCENE.png in the current folder)"
    )
    parser.add_argument("--spp", metavar="N", help="samples per pixel, in place of the scene's")
    parser.add_argument("--size", metavar="WxH", help="resolution in pixels")
    add_device(parser)


def run_demo(arguments: argparse.Namespace) -> int:
    """Render the first picture, from a scene that comes with the package; it needs no other file."""
    scene = example_scenes()[arguments.scene]
    picture = Path(arguments.output or f"{arguments.scene}.png")
    words = [str(scene), f"--output={picture}"]
    words += [f"--{name}={value}" for name in ("spp", "size", "device") if (value := getattr(arguments, name))]
    parser = Parser(prog=arguments.parser.prog)
    add_render(parser)
    code = run_render(parser.parse_args(words))
    if code == 0:
        print(f"the scene is {scene}; for a copy to change: rptcam examples {arguments.scene} -o .", file=sys.stderr)
    return code


# ``rptcam view``: a scene in the browser, with the dials of a camera.

_CONSENT = "--let-others-in"


def add_view(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "scene", type=Path, metavar="SCENE", help="scene file (YAML), or one of pbrt, a stage of USD or a model"
    )
    parser.add_argument("--port", type=port, default=0, metavar="N", help="port (default: one that is free)")
    parser.add_argument(
        "--host", default="127.0.0.1", metavar="ADDRESS",
        help=f"address to listen at (default: 127.0.0.1, this machine alone); any other needs {_CONSENT}",
    )  # fmt: skip
    parser.add_argument(
        _CONSENT, action="store_true", dest="others",
        help="let other machines in, over a connection that is not encrypted; they too need the token",
    )  # fmt: skip
    parser.add_argument("--no-browser", action="store_true", help="print the address and open no browser")
    add_options(parser, "size")
    add_device(parser)
    add_options(parser, "overrides")


def run_view(arguments: argparse.Namespace) -> int:
    """Open a scene in the browser and hold its camera: focus, stop, lens, exposure, pose. The scene file is watched.
    Ctrl-C ends it. Needs rptcam_cl[view].
    """
    from rptcam_cl.device.session import means_one, open_early

    if means_one(arguments.device):
        open_early(arguments.device)
    from rptcam_cl.viewfinder.engine import Viewfinder
    from rptcam_cl.viewfinder.server import is_loopback, serve

    if not (is_loopback(arguments.host) or arguments.others):
        raise InputError(
            f"--host {arguments.host}: lets other machines in, over a connection that is not encrypted (allowed: with"
            f" {_CONSENT}, or 127.0.0.1)"
        )
    from rptcam_cl.cli.files import scene_file

    finder = Viewfinder(scene_file(arguments.scene), arguments.overrides, device=arguments.device, size=arguments.size)
    for warning in finder.warnings:
        print(f"warning: {warning}", file=sys.stderr)

    def announce(address: str) -> None:
        print(f"{arguments.scene} is at {address}\nCtrl-C ends it.", flush=True)
        if not is_loopback(arguments.host):
            print(_for_phones(address), flush=True)

    serve(finder, host=arguments.host, port=arguments.port, browse=not arguments.no_browser, announce=announce)
    return 0


def _for_phones(address: str) -> str:
    """Return the address by which a telephone in the same network finds a server, as a QR code where segno is there."""
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way, contextlib.suppress(OSError):
        way.connect(("192.0.2.1", 9))  # RFC 5737: nothing is sent, but the way there has an address of this machine
        address = address.replace("//127.0.0.1:", f"//{way.getsockname()[0]}:")
    if importlib.util.find_spec("segno") is None:
        return f"On a telephone: {address}\n(as a QR code with the package segno: pip install 'rptcam_cl[qr]')"
    import segno

    text = io.StringIO()
    segno.make(address, error="l").terminal(text, border=2, compact=True)
    return f"On a telephone: {address}\n{text.getvalue()}"


# ``rptcam devices``: the OpenCL devices that a render may run on.


def add_devices(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--json", action="store_true", help="print JSON")


def _line(device: dict[str, Any]) -> str:
    mark = "*" if device["default"] else " "
    precision = "fp64" if device["fp64"] else "fp32 only"
    facts = f"{device['compute_units']} compute units, {as_bytes(device['memory_bytes'])}, {precision}"
    barred = f"\n{'':8}cannot be used: {device['problem']}" if device["problem"] else ""
    return f"{mark} {device['id']:<5} {device['type']}  {device['name']} ({device['platform']}; {facts}){barred}"


def run_devices(arguments: argparse.Namespace) -> int:
    """List the OpenCL devices; * marks the default."""
    from rptcam_cl.api.interface import devices

    listed = devices()
    print(as_json(listed) if arguments.json else "\n".join(map(_line, listed)))
    return 0


# ``rptcam doctor``: what renders run on, and whether the devices compute what they should.


def add_doctor(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "--numerics", action="store_true", help="check what the devices compute; exit code 5 on failure"
    )
    parser.add_argument(
        "--gpu",
        action="store_true",
        help="find out in ten minutes at most all that counts of one device, and write a file to send; 5 on failure",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help=f"the file of --gpu (default: {GPU_REPORT})")
    parser.add_argument(
        "--device", metavar="SPEC", help="report on this device alone, as in render (default: every device found)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def _check_line(check: "Check") -> str:
    if check.skipped:
        return f"  skip {check.name:<49} {check.note}"
    verdict = "FAIL" if check.failed else "ok  "
    note = f" ({check.note})" if check.note else ""
    return f"  {verdict} {check.name:<49} {check.measured:>9.3g}  allowed {check.allowed:.3g} {check.unit}{note}"


def _run_checks(device: str, show: bool) -> Iterator[dict[str, Any]]:
    """Yield the checks of a device as plain data, and print each as soon as it is made."""
    from rptcam_cl.device.session import open_session
    from rptcam_cl.studies.selfcheck_suite import run_suite

    session = open_session(device)
    for checks, seconds in run_suite(session):
        for check in checks:
            if show:
                print(_check_line(check), flush=True)
            yield {**vars(check), "passed": check.passed, "failed": check.failed, "seconds_of_part": seconds}


def _numerics(devices: list[dict[str, Any]], show: bool) -> dict[str, list[dict[str, Any]]]:
    """Return the checks of devices, by the device's id."""
    checks: dict[str, list[dict[str, Any]]] = {}
    for device in devices:
        if show:
            print(f"\nnumerics of {device['id']} {device['name']}", flush=True)
        checks[device["id"]] = list(_run_checks(device["id"], show))
        if show:
            made = [check for check in checks[device["id"]] if not check["skipped"]]
            skipped = len(checks[device["id"]]) - len(made)
            rest = f", {skipped} skipped" if skipped else ""
            print(f"  {sum(check['passed'] for check in made)} of {len(made)} checks passed{rest}")
    return checks


def _examine(arguments: argparse.Namespace) -> int:
    """Write the report of one device, and print a line for each step."""
    from rptcam_cl.device.devices import choose_device
    from rptcam_cl.device.session import Session
    from rptcam_cl.studies.selfcheck_suite import CardReport, environment

    if arguments.numerics or arguments.json:
        raise InputError("rptcam doctor: --gpu checks numerics too and writes JSON to its file; give it alone")
    path = arguments.output or Path(GPU_REPORT)
    check_writable(path)
    info = choose_device(arguments.device)
    report = CardReport(Session(info, profiling=True))
    print(f"{info.id} {info.type}  {info.name}", flush=True)
    with fresh_cache():  # so that trees are built here
        for line in report.run():
            print(line, flush=True)
    written = environment(info.id) | {"failed": report.failed, "report": report.found}
    with replacing(path) as temporary:
        temporary.write_text(as_json(written) + "\n", encoding="utf-8")
    print(f"wrote {path}; please send it to the authors", flush=True)
    if report.failed:
        raise NumericError(f"{len(report.failed)} steps failed: {'; '.join(report.failed)}")
    return 0


def run_doctor(arguments: argparse.Namespace) -> int:
    """Report on versions, devices with their drivers, and caches. With --numerics, check what the devices compute at
    the extremes, in half a minute each. With --gpu, find out all that counts of one device. Send the output with a
    bug report.
    """
    if arguments.gpu:
        return _examine(arguments)
    if arguments.output is not None:
        raise InputError("rptcam doctor: -o is the file of --gpu; give both, or neither")
    from rptcam_cl.studies.selfcheck_suite import as_lines, environment

    report = environment(arguments.device)
    if not arguments.json:
        print("\n".join(as_lines(report)), flush=True)
    if arguments.numerics and report["devices"]:
        usable = [device for device in report["devices"] if device["problem"] is None]
        report["numerics"] = _numerics(usable, not arguments.json)
    if arguments.json:
        print(as_json(report))
    sys.stdout.flush()
    if "no_device" in report:
        raise DeviceError(report["no_device"])
    failed = sum(check["failed"] for checks in report.get("numerics", {}).values() for check in checks)
    if failed:
        what = "1 check" if failed == 1 else f"{failed} checks"
        raise NumericError(f"{what} failed; please send the report above to the authors")
    return 0


# ``rptcam schema``: the JSON schema of scene or lens files, for editors that complete and check.


def add_schema(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--lens", action="store_true", help="of lens files instead")


def run_schema(arguments: argparse.Namespace) -> int:
    """Print the JSON schema of scene files, for editors that complete and check."""
    if arguments.lens:
        from rptcam_cl.optics.files.keys import lens_json_schema_text

        print(lens_json_schema_text(), end="")
        return 0
    from rptcam_cl.scene.load import scene_json_schema_text

    print(scene_json_schema_text(), end="")
    return 0
