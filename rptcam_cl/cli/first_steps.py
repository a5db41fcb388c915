"""First steps: ``rptcam examples`` and ``rptcam view``; ``rptcam settle``, ``convert`` and ``new``, which make scene
files; ``devices``, ``doctor``, ``resident`` and ``schema``."""

import argparse
import contextlib
import importlib.util
import io
import os
import shlex
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import add_options, size
from rptcam_cl.cli.output import SCENE_SUFFIXES, add_device, add_scene, as_bytes, as_json, loaded_scene, port, positive
from rptcam_cl.core import files, resident
from rptcam_cl.core.errors import DeviceError, InputError, NumericError

if TYPE_CHECKING:
    from rptcam_cl.exchange.conversion import Conversion
    from rptcam_cl.scene.load import Missing
    from rptcam_cl.studies.selfcheck import Check

# ``rptcam examples``: lists the scenes that come with the package, and copies one to be rendered and changed.

LARGEST = 1 << 26  # bytes of one file
_GPU_REPORT = "rptcam_gpu_report.json"
_NOT_SCENE = "a scene file is YAML"


def add_examples(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("scene", nargs="?", choices=tuple(files.SCENES), metavar="NAME", help="a scene of the list")
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
    width = max(map(len, files.SCENES))
    for name, path in files.example_scenes().items():
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
    contents = {folder / path.name: files.read_whole(path, LARGEST) for path in files.example_files(name)}
    for target, content in contents.items():
        if target.exists() and not (target.is_file() and files.read_whole(target, 2 * LARGEST) == content):
            raise InputError(f"{target}: is there already and differs; choose another folder with -o, or move it away")
    files.make_folder(folder)
    for target, content in reversed(contents.items()):  # the scene file last
        with files.replacing(target) as temporary:
            temporary.write_bytes(content)
    return next(iter(contents))


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
    from rptcam_cl.scene.load import load_scene

    if means_one(arguments.device):
        open_early(arguments.device)
    from rptcam_cl.viewfinder.engine import Viewfinder
    from rptcam_cl.viewfinder.server import is_loopback, serve

    if not (is_loopback(arguments.host) or arguments.others):
        raise InputError(
            f"--host {arguments.host}: lets other machines in, over a connection that is not encrypted (allowed: with"
            f" {_CONSENT}, or 127.0.0.1)"
        )
    path = scene_file(arguments.scene)  # where it is made for this run, what is missing is refused or said
    made = None if path is arguments.scene else load_scene(path, arguments.overrides, missing="grey")
    finder = Viewfinder(made or path, () if made else arguments.overrides, device=arguments.device, size=arguments.size)
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


# ``rptcam settle``: focus, camera model and exposure of a scene are found once, for all renders that follow.


def add_settle(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_scene(parser)
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.yaml", help="scene file to write")
    add_device(parser)
    add_options(parser, "overrides", "quiet")


def run_settle(arguments: argparse.Namespace) -> int:
    """Write a scene whose auto focus, accuracy and exposure are found, so that parts and frames agree."""
    from rptcam_cl.api.job import settle

    files.known_suffix(arguments.output, SCENE_SUFFIXES, _NOT_SCENE)
    files.check_writable(arguments.output, [arguments.scene])
    scene = loaded_scene(arguments)
    notes = settle(scene, arguments.output, device=arguments.device).found
    if not arguments.quiet:
        print(f"wrote {arguments.output}: {', '.join(notes) or 'nothing was left to be found'}", file=sys.stderr)
    return 0


# ``rptcam convert``: a scene file of another renderer becomes one of ours.

SOURCES = (".pbrt", ".pbrt.gz", ".usd", ".usda", ".usdc", ".usdz", ".mtlx")


def add_convert(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    source_help = "scene file of pbrt-v2, v3 or v4, stage of USD, materials of MaterialX, or a model"
    parser.add_argument("source", type=Path, metavar="SCENE", help=source_help)
    parser.add_argument("target", type=Path, metavar="SCENE.yaml", help="scene file to write")
    parser.add_argument(
        "--root", type=Path, metavar="DIR", help="further folder inside which files of the scene may lie, as .."
    )
    parser.add_argument(
        "--time-s",
        type=float,
        metavar="S",
        help="moment of a stage of USD, from its first time code, or of a glTF file [s]",
    )
    parser.add_argument("--json", action="store_true", help="print the report as JSON, with the objects of each line")
    parser.add_argument("--quiet", action="store_true", help="print only errors")
    add_options(parser, "missing")


def _check_names(source: Path, target: Path) -> None:

    if not source.name.lower().endswith((*SOURCES, *MESHES)):
        raise InputError(
            f"{source}: only scenes of pbrt, stages of USD and models can be converted"
            f" (got {source.suffix or 'no suffix'}; allowed: {', '.join((*SOURCES, *MESHES))})"
        )
    files.known_suffix(target, SCENE_SUFFIXES, _NOT_SCENE)
    files.check_writable(target, [source])


MESHES = (".ply", ".obj", ".stl", ".gltf", ".glb")


def run_convert(arguments: argparse.Namespace) -> int:
    """Make a scene file from one of pbrt-v2, v3 or v4, from a stage of USD, or round a model as `rptcam new` does. What
    is ignored or approximated is listed; meshes and pictures go to folders beside the scene file.
    """
    _check_names(arguments.source, arguments.target)
    if arguments.source.suffix.lower() in MESHES:
        return _convert_model(arguments)
    done = _convert(arguments.source, arguments.target, arguments.missing, arguments.root, arguments.time_s)
    warnings = done.write(arguments.target)
    if arguments.json:
        objects = len(done.scene.get("objects", ()))
        print(as_json({"objects": objects, "report": done.report.described(), "warnings": warnings}))
    elif not arguments.quiet:
        for message in (*done.report, *(f"warning: {text}" for text in warnings)):
            print(message, file=sys.stderr)
        count = len(done.scene.get("objects", ()))
        print(f"wrote {arguments.target}: {count} object{'' if count == 1 else 's'}", file=sys.stderr)
    return 0


def _convert_model(arguments: argparse.Namespace) -> int:
    """Write a scene round a model; what its file has and ours has not is the report."""
    if arguments.root is not None:
        raise InputError("--root: is for scenes of pbrt (allowed: without it for a model)")
    said = _write_new(arguments.target, {"model": arguments.source, "time_s": arguments.time_s})
    if arguments.json:
        warnings = [text.removeprefix("warning: ") for text in said if text.startswith("warning: ")]
        notes = [{"effect": "note", "message": text, "lines": [], "objects": 1} for text in said
                 if not text.startswith("warning: ")]  # fmt: skip
        print(as_json({"objects": 1, "report": notes, "warnings": warnings}))
    elif not arguments.quiet:
        print(*said, f"wrote {arguments.target}", sep="\n", file=sys.stderr)
    return 0


def _convert(
    source: Path, target: Path, missing: "Missing", root: Path | None = None, time_s: float | None = None
) -> "Conversion":
    if source.name.lower().endswith(SOURCES[:2]):
        from rptcam_cl.exchange.pbrt.convert import convert_scene

        if time_s is not None:
            raise InputError("--time-s: is a moment of a stage of USD (allowed: without it for pbrt)")
        return convert_scene(source, target, missing=missing, root=root)
    from rptcam_cl.exchange.usd import convert_stage

    if root is not None:
        raise InputError("--root: is for scenes of pbrt (allowed: without it for USD, which finds its files itself)")
    return convert_stage(source, target, time_s=time_s)


_FOLDERS: list[tempfile.TemporaryDirectory[str]] = []  # of scenes that were made for this run; they go with it


def scene_file(path: Path, missing: "Missing" = "error") -> Path:
    """Return a scene file: the path itself, or what a scene of another program or a model becomes for this run."""
    foreign, model = path.name.lower().endswith(SOURCES), path.suffix.lower() in MESHES
    if not (foreign or model):
        return path
    _FOLDERS.append(tempfile.TemporaryDirectory(prefix="rptcam-scene-"))
    target = Path(_FOLDERS[-1].name) / f"{path.name.split('.')[0] or 'scene'}.yaml"
    if foreign:
        done = _convert(path, target, missing)
        messages = [*done.report, *done.write(target)]
        again = f"rptcam convert {shlex.quote(str(path))} scene.yaml"
    else:
        messages = _write_new(target, {"model": path})
        again = f"rptcam new scene.yaml --model {shlex.quote(str(path))}"
    note = f"{path} is shown as a scene that is made for this run; to keep it: {again}"
    print("\n".join([*messages, note]), file=sys.stderr)
    return target


# ``rptcam new``: writes a starting scene round a model.


def add_new(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("scene", type=Path, metavar="SCENE.yaml", help="scene file to write")
    parser.add_argument("--model", type=Path, metavar="FILE", help="mesh to show: .glb, .gltf, .obj, .ply or .stl")
    parser.add_argument("--hdri", type=Path, metavar="FILE", help="picture of light from all around: .hdr or .exr")
    parser.add_argument(
        "--lens", metavar="NAME", help="lens of the library (rptcam lens list) or a lens file (default: dgauss-50mm)"
    )
    parser.add_argument("--size", type=size, default=(960, 640), metavar="WxH", help="resolution (default: 960x640)")
    parser.add_argument(
        "--up", choices=("x", "y", "z"), help="axis of the model that points upwards (default: z for .stl, else y)"
    )
    parser.add_argument(
        "--metres-per-unit", type=positive, default=1.0, metavar="M",
        help="length of a unit of the model [m]: 0.001 where it counts millimetres (default: 1)",
    )  # fmt: skip
    parser.add_argument("--reframe", action="store_true", help="frame the model, even if its file has a camera")
    parser.add_argument(
        "--time-s", type=float, metavar="T", help="moment of a glTF file's animations [s] (default: the pose at rest)"
    )


def run_new(arguments: argparse.Namespace) -> int:
    """Write a scene that is framed, lit, focused and exposed, to be changed from there. Files that lie elsewhere are
    copied beside it, because a scene reads its own folder only. Without a model it shows three balls, without a
    picture of light a studio. Cameras and lamps of a glTF file count.
    """
    target: Path = arguments.scene
    words = ["rptcam", "new", f"{target.stem}.yaml", "--model", str(target)]
    is_model = target.is_file() and arguments.model is None
    hint = f"; for a scene of that model: {shlex.join(words)}" if is_model else ""
    files.known_suffix(target, SCENE_SUFFIXES, _NOT_SCENE, hint)
    if target.exists():
        raise InputError(f"{target}: is there already; choose another name, or remove it first")
    files.check_writable(target)
    names = ("model", "hdri", "lens", "size", "up", "metres_per_unit", "reframe", "time_s")
    for message in _write_new(target, {name: getattr(arguments, name) for name in names}):
        print(message, file=sys.stderr)
    named, picture = shlex.quote(str(target)), shlex.quote(f"{target.stem}.png")
    print(f"wrote {target}; next: rptcam render {named} -o {picture}, or rptcam view {named}", file=sys.stderr)
    return 0


def _write_new(target: Path, settings: dict[str, Any]) -> list[str]:
    """Write a starting scene with the files that it needs, and return what there is to say of it."""
    from rptcam_cl.exchange.starting import starting_scene
    from rptcam_cl.scene.load import load_scene, scene_text

    start = starting_scene(target.parent, **settings)
    copied = start.copies.write()
    scene = load_scene(start.scene, base_dir=target.parent, missing="grey")
    with files.replacing(target) as temporary:
        temporary.write_text(scene_text(start.scene, (HEAD,)), "utf-8")
    warnings = [f"warning: {text}" for text in scene.warnings if text not in (*start.report, *scene.stand_ins)]
    return [*start.report, *(f"copied {path.name}" for path in copied), *warnings]


HEAD = "A starting scene by rptcam new: change what you like; docs/scene.md has every key."


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
    from rptcam_cl.device.devices import devices

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
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help=f"the file of --gpu (default: {_GPU_REPORT})")
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
    from rptcam_cl.studies.selfcheck_suite import END_S, CardReport, environment

    if arguments.numerics or arguments.json:
        raise InputError("rptcam doctor: --gpu checks numerics too and writes JSON to its file; give it alone")
    path = arguments.output or Path(_GPU_REPORT)
    files.check_writable(path)
    info = choose_device(arguments.device)
    known, report = environment(info.id), CardReport(Session(info, profiling=True))

    def write() -> None:
        written = known | {"failed": report.failed, "report": report.found}
        with files.replacing(path) as temporary:
            temporary.write_text(as_json(written) + "\n", encoding="utf-8")
        print(f"wrote {path}; please send it to the authors", flush=True)

    def give_up() -> None:  # in a thread of its own, while the driver does not return
        print(f"{report.failed[-1]}: FAIL did not end before {END_S:g} s; what follows is left out", flush=True)
        write()
        os._exit(NumericError.exit_code)

    watch = threading.Timer(END_S, give_up)
    watch.daemon = True
    watch.start()
    print(f"{info.id} {info.type}  {info.name}", flush=True)
    with contextlib.ExitStack() as ended:
        ended.callback(watch.cancel)
        ended.enter_context(files.fresh_cache())  # so that trees are built here
        for line in report.run():
            print(line, flush=True)
    write()
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


# ``rptcam resident``: the processes that stay after commands.


def add_resident(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--stop", action="store_true", help="end them; commands that they have begun go on")


def run_resident(arguments: argparse.Namespace) -> int:
    """Say which processes stay after commands, so that the next ones start sooner, and what memory they hold. They do
    while the environment variable RPTCAM_RESIDENT holds a number of minutes, on Linux.
    """
    if sys.platform != "linux":
        raise InputError("rptcam resident: is for Linux alone; here every command runs by itself")
    there = list(resident.residents())
    for process in there:
        pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
        if arguments.stop:
            os.kill(process, signal.SIGTERM)
        ends = "ended" if arguments.stop else "stays"
        print(f"process {process} {ends}: {pages * os.sysconf('SC_PAGE_SIZE') >> 20} MiB")
    if not there:
        minutes = resident.minutes_to_stay()
        print(f"none stays; {resident.VARIABLE} {f'is {minutes:g} minutes' if minutes else 'is not set: none will'}")
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
