"""``rptcam camera``, the camera of a scene or of a lens alone for programs that measure in its pictures; ``focus``, its
autofocus; ``tradeoff``, what each approximation costs and gains."""

import argparse
import contextlib
import math
import os
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import SEVERAL, CommandOption, add_options, crop, duration, frame_range, share, size
from rptcam_cl.cli import output
from rptcam_cl.cli.lens_options import check_picture, distances, numbers, wavelengths, write, write_picture
from rptcam_cl.core.errors import InputError, StateError, near_name
from rptcam_cl.core.files import check_writable, known_suffix, listed, replacing

if TYPE_CHECKING:
    from rptcam_cl.exchange.camera_models import Calibration, CameraView
    from rptcam_cl.scene.scene import Scene
    from rptcam_cl.studies.focus.probe import FocusReport
    from rptcam_cl.studies.tradeoff import TradeoffReport


# The options of ``rptcam camera`` that write maps of the lens: a value for each pixel, a kernel for each field.

MAPS = ("stmap_distort", "stmap_undistort", "vignetting", "coc", "psf_grid")
SUFFIXES = dict.fromkeys(MAPS, (".exr",)) | {"psf_grid": (".npz",), "usd": (".usda", ".usd")}  # .usdc is binary


def flag(name: str) -> str:
    """The option that has a name in the arguments."""
    return f"--{name.replace('_', '-')}"


def _add_maps(parser: argparse.ArgumentParser) -> None:
    """Add the maps and what they need."""
    maps = parser.add_argument_group("maps of the lens")
    for name, text in (
        ("--stmap-distort", "ST map that bends a straight picture as the lens does"),
        ("--stmap-undistort", "ST map that makes a picture of the lens straight, with overscan"),
        ("--vignetting", "light of each pixel over that on the axis"),
        ("--coc", "circle of confusion of each pixel [px], at --distances-m"),
    ):
        maps.add_argument(name, type=Path, metavar="F.exr", help=text)
    maps.add_argument("--psf-grid", type=Path, metavar="F.npz", help="images of points over the picture, as kernels")
    maps.add_argument("--psf-cells", type=size, metavar="WxH", default=(5, 3), help="of them (default: 5x3)")
    maps.add_argument(
        "--distances-m",
        type=distances,
        metavar="D,D,…",
        help="of points, in metres or inf (default: the plane of focus)",
    )
    maps.add_argument("--wavelengths", type=wavelengths, metavar="W,W,…", help="in nanometres (default: the camera's)")


def _maps_to_write(
    arguments: argparse.Namespace, seen: "CameraView"
) -> Iterator[tuple[Path, Callable[[Path], object]]]:
    """Yield files and what writes them, each map having been made."""
    from rptcam_cl.exchange.camera_maps import (
        coc_exr,
        coc_map,
        point_images,
        psf_npz,
        st_exr,
        st_maps,
        vignetting_exr,
        vignetting_map,
    )

    if arguments.stmap_distort is not None or arguments.stmap_undistort is not None:
        maps = st_maps(seen)
        if arguments.stmap_distort is not None:
            yield arguments.stmap_distort, lambda path: st_exr(seen, maps, "distort", path)
        if arguments.stmap_undistort is not None:
            yield arguments.stmap_undistort, lambda path: st_exr(seen, maps, "undistort", path)
    if arguments.vignetting is not None:
        light = vignetting_map(seen)
        yield arguments.vignetting, lambda path: vignetting_exr(seen, light, path)
    away = arguments.distances_m or [seen.distance_m]
    if arguments.coc is not None:
        blur = coc_map(seen, away)
        yield arguments.coc, lambda path: coc_exr(seen, blur, away, path)
    if arguments.psf_grid is not None:
        data = psf_npz(point_images(seen, arguments.psf_cells, arguments.wavelengths or (), away))
        yield arguments.psf_grid, lambda path: path.write_bytes(data)


# The files of ``rptcam camera``: all are checked before anything is traced, and all are made before one is written.

File = tuple[Path, Callable[[Path], object]]  # and what writes it

TEXTS = ("opencv", "ros", "openlensio", "usd", "osl")
COLMAP = ("cameras.txt", "images.txt", "points3D.txt")


def _check_camera_files(arguments: argparse.Namespace) -> None:
    """Check, before anything is traced, that all files can be written.

    Raises
    ------
    InputError, StateError
    """
    for name, suffixes in SUFFIXES.items():
        path: Path | None = getattr(arguments, name)
        if path is not None and path.suffix.lower() not in suffixes:
            got = path.suffix or "none"
            raise InputError(f"{flag(name)}: {path}: such a file is {' or '.join(suffixes)} (got {got})")
    if arguments.plot is not None:
        from rptcam_cl.optics.charts import check_suffix

        check_suffix(arguments.plot)
    _check_apart(arguments)
    folder: Path | None = arguments.colmap
    if folder is not None and not folder.is_dir():
        if os.path.lexists(folder):
            raise StateError(f"--colmap: {folder} is no folder (allowed: a folder, which is made if it is missing)")
        check_writable(folder)
    for _, path in _outputs(arguments):
        if path.parent != folder or folder.is_dir():
            check_writable(path, [arguments.source])


def _outputs(arguments: argparse.Namespace) -> Iterator[tuple[str, Path]]:
    """Yield options and the files that they name."""
    for name in (*TEXTS, "plot", *MAPS):
        if (path := getattr(arguments, name)) is not None:
            yield flag(name), path
    if arguments.colmap is not None:
        for name in COLMAP:
            yield "--colmap", arguments.colmap / name


def _check_apart(arguments: argparse.Namespace) -> None:
    """Raise `InputError` for outputs that would overwrite one another."""
    files = list(_outputs(arguments))
    if arguments.colmap is not None:
        files.append(("--colmap", arguments.colmap))
    known: dict[str, str] = {}
    for option, path in files:
        first = known.setdefault(os.path.realpath(path), option)
        if first != option:
            raise InputError(f"{option}: {path} is the output of {first} too (allowed: a name of its own)")


def write_files(arguments: argparse.Namespace, seen: "CameraView", chosen: "Calibration") -> None:
    """Write what is requested, all or nothing."""
    files, folder = list(_files(arguments, seen, chosen)), arguments.colmap
    is_new = folder is not None and not folder.is_dir()
    if is_new:
        folder.mkdir()
    try:
        _write(files)
    except BaseException:
        if is_new:
            with suppress(OSError):
                folder.rmdir()
        raise
    for path, _ in files:
        if path.parent != folder or path.name not in COLMAP:
            print(f"wrote {path}", file=sys.stderr)
    if folder is not None:
        print(f"wrote {folder}", file=sys.stderr)


def _files(arguments: argparse.Namespace, seen: "CameraView", chosen: "Calibration") -> Iterator["File"]:
    from rptcam_cl.exchange import camera_files, camera_maps
    from rptcam_cl.optics.charts import encode

    for name in TEXTS:
        if (path := getattr(arguments, name)) is not None:
            yield path, partial(_put, camera_files.WRITTEN[name](seen, chosen).encode())
    if arguments.plot is not None:
        yield arguments.plot, partial(_put, encode(camera_maps.residual_chart(seen, chosen), arguments.plot))
    yield from _maps_to_write(arguments, seen)
    if arguments.colmap is not None:
        picture = f"{Path(arguments.source).stem.replace(' ', '_')}.png"
        for name, text in camera_files.colmap_texts(seen, chosen, picture).items():
            yield arguments.colmap / name, partial(_put, text.encode())


def _put(data: bytes, path: Path) -> None:
    path.write_bytes(data)


def _write(files: list["File"]) -> None:
    """Write all files beside their places, and then give them their names."""
    with ExitStack() as whole:
        for path, writer in files:
            writer(whole.enter_context(replacing(path)))


MODELS = ("auto", "pinhole", "brown_conrady", "rational", "thin_prism", "kannala_brandt")
_POOR_PX = 0.1  # residual from which on there is a warning, where no other is given


def film(text: str) -> tuple[float, float]:
    """Width and height of ``WxH`` [mm]."""
    try:
        width, height = (float(part) for part in text.lower().replace("×", "x").split("x"))
    except ValueError:
        width = height = -1.0
    if not (0 < width < 1e6 and 0 < height < 1e6):
        raise argparse.ArgumentTypeError(f"got {text}; allowed WxH in millimetres, as 36x24")
    return width, height


def place(text: str) -> list[float]:
    """Point ``x,y,z`` of a scene [scene units]."""
    values = numbers(text)
    if len(values) != 3:
        raise argparse.ArgumentTypeError(f"got {text}; allowed x,y,z in scene units, as 0.1,1.6,-2")
    return values


def distance(text: str) -> float:
    """Distance of an object, which may be far away: ``inf`` [m]."""
    return math.inf if text.lower() == "inf" else output.positive(text)


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("source", metavar="SCENE|LENS", help="scene file, or a lens by name or file")
    add_options(parser, "overrides")
    parser.add_argument("--size", type=size, metavar="WxH", help="resolution (default: the scene's, 768x512)")
    parser.add_argument("--film", type=film, metavar="WxH", help="film in millimetres (default: the scene's, 36x24)")
    parser.add_argument(
        "--distance-m", type=distance, metavar="D",
        help="from the entrance pupil to the object, in metres or inf (default: where the lens is focused)",
    )  # fmt: skip
    parser.add_argument(
        "--object", choices=("plane", "sphere"),
        help="the object: a plane across the axis, or a sphere, as boards make that face the camera"
        " (default: plane, beyond 75 degrees sphere)",
    )  # fmt: skip
    parser.add_argument(
        "--model", choices=MODELS, default="auto", help="camera model (default: auto, the simplest that fits)"
    )
    parser.add_argument(
        "--kannala-brandt", action="store_const", const="kannala_brandt", dest="model",
        help="the model by angles, for fisheyes: --model kannala_brandt",
    )  # fmt: skip
    parser.add_argument(
        "--max-residual-px", type=output.positive, metavar="R", help="refuse a model that errs by more anywhere"
    )
    parser.add_argument("--json", action="store_true", help="print everything as JSON, all models with their residuals")
    parser.add_argument("--opencv", type=Path, metavar="F.yaml", help="write a file for OpenCV")
    parser.add_argument("--ros", type=Path, metavar="F.yaml", help="write camera_info for ROS")
    parser.add_argument("--colmap", type=Path, metavar="DIR", help="write a model for COLMAP into a folder")
    parser.add_argument("--openlensio", type=Path, metavar="F.json", help="write a sample of OpenTrackIO")
    parser.add_argument(
        "--usd", type=Path, metavar="F.usda", help="write a camera for USD, the lens as its custom data"
    )
    parser.add_argument("--osl", type=Path, metavar="F.osl", help="write a shader for Cycles, which traces the lens")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="plot the residual, .svg, .png or .pdf")
    _add_maps(parser)


def run_camera(arguments: argparse.Namespace) -> int:
    """The camera for computer vision: intrinsics, distortion and pose, fitted to the chief rays of the lens."""
    from rptcam_cl.exchange.camera_models import subject, view
    from rptcam_cl.scene.changes import camera_changes

    _check_camera_files(arguments)
    scene = subject(arguments.source, arguments.overrides, size=arguments.size, film_mm=arguments.film)
    seen = view(scene, arguments.distance_m, arguments.object)
    if camera_changes(scene):
        print(
            "note: the camera changes while the shutter is open; this is its state when it opens, at"
            f" {scene.shutter.open_s:g} s (--set shutter.open_s=T takes another moment)",
            file=sys.stderr,
        )
    if getattr(scene.camera, "accuracy", None) is not None:
        print(
            "note: this is the lens, in whose place camera.accuracy may let renders have a simpler camera (rptcam"
            " settle writes the scene with theirs)",
            file=sys.stderr,
        )
    if seen.setting is not None:
        output.print_warnings(seen.setting.lens.warnings)
    chosen = _choose_model(arguments, seen)
    _report(arguments, seen, chosen)
    write_files(arguments, seen, chosen)
    return 0


def _choose_model(arguments: argparse.Namespace, seen: "CameraView") -> "Calibration":
    """The requested model, or the simplest that fits and that all files to be written can hold."""
    from rptcam_cl.exchange.camera_files import HELD, check_held
    from rptcam_cl.exchange.camera_models import COEFFICIENTS, GOOD_PX, calibrate, calibrate_best

    forms = [name for name in (*TEXTS, "colmap") if getattr(arguments, name) is not None]
    allowed = arguments.max_residual_px
    if arguments.model == "auto":
        held = [model for model in COEFFICIENTS if all(model in HELD[name] for name in forms)]
        calibration = calibrate_best(seen, held, allowed or GOOD_PX)
        if allowed is None and calibration.max_px > _POOR_PX:
            of = "" if len(held) == len(COEFFICIENTS) else " of what these files can say"
            said = f"{calibration.model} fits best{of} and errs by {calibration.max_px:.3g} px"
            output.print_warnings([f"{said}; maps of the lens itself have no residual: --stmap-undistort"])
    else:
        for name in forms:
            check_held(name, arguments.model)
        calibration = calibrate(seen, arguments.model)
    if allowed is not None and calibration.max_px > allowed:
        best = calibrate_best(seen, list(COEFFICIENTS), 0.0)
        hint = (
            f"{best.model} errs by {best.max_px:.3g} px" if best.model != calibration.model else "it is the best of all"
        )
        raise InputError(
            f"--max-residual-px: {calibration.model} errs by {calibration.max_px:.3g} px for {seen.name}"
            f" (allowed: {allowed:g}; {hint}; maps of the lens itself have no residual: --stmap-undistort)"
        )
    return calibration


def _report(arguments: argparse.Namespace, seen: "CameraView", chosen: "Calibration") -> None:
    from rptcam_cl.exchange import camera_files, camera_models

    if not arguments.json:
        rows = [[name, value] for name, value in chosen.named.items()]
        rows += [["largest error [px]", chosen.max_px], ["rms error [px]", chosen.rms_px]]
        rows += [["lit share of the picture", chosen.lit_share], ["pupil ahead of eye [mm]", seen.pupil_ahead_mm]]
        width, height = seen.size
        title = f"{seen.name}, {width} x {height} px, {camera_files.object_text(seen)}; the first pixel's centre is 0.5"
        output.print_table((chosen.model, "value"), rows, title)
        return
    calibrations, refused = [], {}
    for model in camera_models.COEFFICIENTS:
        try:
            calibrations.append(camera_models.calibrate(seen, model))
        except InputError as problem:
            refused[model] = str(problem)
    print(output.as_json(camera_files.document(seen, calibrations, refused) | {"chosen": chosen.model}))


# ``rptcam focus``: autofocus of a scene's camera.


def _word_of(names_of: str) -> Callable[[str], str]:
    """The parser of a word of a list of `scene.lens_settings`, ``METHODS`` or ``POLICIES``."""

    def parse(text: str) -> str:
        from rptcam_cl.scene import lens_settings

        names: tuple[str, ...] = getattr(lens_settings, names_of)
        if text not in names:
            raise argparse.ArgumentTypeError(f"got {text}{near_name(text, names)}; allowed {', '.join(names)}")
        return text

    return parse


# fmt: off
_PLACES = (
    CommandOption(
        "zones", "--zone", "rectangle to focus on, in fractions of the picture from the left and the top; may be"
        " repeated", crop, "x0,x1,y0,y1", more=SEVERAL,
    ),
    CommandOption("zones_file", "--zones", "file with a line xleft xright ytop ybottom each", Path, "FILE"),
    CommandOption("mask", "--mask", "picture that is bright where to focus", Path, "FILE"),
    CommandOption("point", "--point", "point to focus on, in the same fractions", output.point, "x,y"),
    CommandOption("object", "--object", "object to focus on, wherever it is seen", str, "NAME"),
    CommandOption(
        "at", "--at", "point of the scene to focus on; with --object in that object's own coordinates, as an eye of a"
        " face", place, "x,y,z",
    ),
)
FOCUS_OPTIONS = (
    CommandOption(
        "method", "--method", "contrast, laplacian, variance, depth, phase or hybrid (default: the scene's, or"
        " contrast)", _word_of("METHODS"), "NAME",
    ),
    *_PLACES,
    CommandOption(
        "policy", "--policy", "which of several zones decides: closest (default), farthest, centre or weighted",
        _word_of("POLICIES"), "NAME",
    ),
    CommandOption(
        "criterion", "--criterion", "what depth and phase call sharpest: spot (default), pixel, or mtf@30 with line"
        " pairs per mm of the film", str, "NAME",
    ),
    CommandOption(
        "sensor", "--sensor", "probe with the noise and the white of the scene's sensor, in the exposure of the"
        " picture", more={"action": "store_const", "const": True},
    ),
)
# fmt: on


def add_focus(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    output.add_scene(parser)
    for option in FOCUS_OPTIONS:
        option.add_to(parser)
    add_options(parser, "seed")
    output.add_device(parser)
    add_options(parser, "overrides")
    parser.add_argument(
        "--frames", type=frame_range, metavar="FIRST-LAST[:STEP]",
        help="follow the subject over these frames of the scene's sequence by continuous autofocus, as 1-48",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE",
        help="draw the curve, or subject, prediction, lens and error over the frames, .svg, .png or .pdf",
    )  # fmt: skip


def run_focus(arguments: argparse.Namespace) -> int:
    """Find the focus of a scene's camera by probing through its lens; prints where the film has to be."""
    given = [option.name for option in _PLACES if getattr(arguments, option.name) is not None]
    if len(given) > 1 and given != ["object", "at"]:
        raise InputError(f"rptcam focus: takes one of {listed((option.flag for option in _PLACES), 'and')}")
    check_picture(arguments.plot, str(arguments.scene))
    from rptcam_cl.studies.focus.controller import autofocus
    from rptcam_cl.studies.focus.probe import focus_plot

    scene = output.loaded_scene(arguments)
    if arguments.frames is not None:
        return _follow_frames(arguments, scene)
    report = autofocus(scene, **_focus_keywords(arguments))
    output.print_warnings(report.warnings)
    if arguments.plot is not None:
        write_picture(focus_plot(report, f"{arguments.scene.stem}: autofocus by {report.method}"), arguments.plot)
    if arguments.json:
        print(output.as_json(report.as_dict()))
    else:
        _print_focus(report)
    return 0


def _follow_frames(arguments: argparse.Namespace, scene: "Scene") -> int:
    """Print where continuous autofocus has the focus in each frame, and draw it; returns the exit code."""
    from dataclasses import astuple

    from rptcam_cl.device.session import open_session
    from rptcam_cl.scene.changes import change_scene, set_keys
    from rptcam_cl.studies.focus.controller import FocusOptions, zones_of
    from rptcam_cl.studies.focus.servo import FrameFocus, FrameTracker, doubts_of, servo_plot, summary_of

    given = FocusOptions(**_focus_keywords(arguments))
    if scene.requested_autofocus is None or given.keys:
        settings = given.settings_of(scene)
        data = settings.model_dump(exclude_unset=True, exclude={"zones_from", "mask"})
        if settings.zones_from is not None or settings.mask is not None:
            data["zones"] = [list(astuple(zone)) for zone in zones_of(scene, settings)]
        scene = set_keys(scene, {"camera.focus": {"auto": data}})
    if scene.sequence is None or scene.sequence.continuous_focus is None:
        scene = set_keys(scene, {"sequence": {**scene.made_of.get("sequence", {}), "continuous_focus": {}}})
    if arguments.seed is not None:
        scene = change_scene(scene, render={"seed": arguments.seed})
    assert scene.sequence is not None
    tracker, rate = FrameTracker(scene, lambda: open_session(arguments.device)), scene.sequence.frames_per_second
    frames = [FrameFocus.of(number, (number - 1) / rate, *tracker.frame(number)) for number in arguments.frames]
    output.print_warnings(doubts_of(frames))
    if arguments.plot is not None:
        write_picture(servo_plot(frames, f"{arguments.scene.stem}: continuous autofocus"), arguments.plot)
    if arguments.json:
        print(output.as_json([vars(frame) for frame in frames]))
        return 0
    words = ("frame", "subject [m]", "expected [m]", "focus [m]", "off [depths of focus]", "drive [depths/s]")
    rows = [[row.number, row.subject_m, row.expected_m, row.focus_m, row.off, row.speed] for row in frames]
    output.print_table(words, rows, "continuous autofocus")
    print(summary_of(frames))
    return 0


def _focus_keywords(arguments: argparse.Namespace) -> dict[str, Any]:
    """The keywords of `autofocus` that the command has as options, files read."""
    from rptcam_cl.scene.assets.pictures import bright_pixels
    from rptcam_cl.studies.focus.controller import read_zones

    names = ("seed", "device", *(option.name for option in FOCUS_OPTIONS))
    given = {name: getattr(arguments, name) for name in names}
    if (file := given.pop("zones_file")) is not None:
        given["zones"] = read_zones(file, str(file))
    if given["mask"] is not None:
        given["mask"] = bright_pixels(given["mask"], str(given["mask"]))
    return given


def _print_focus(report: "FocusReport") -> None:
    """Print the probes and the focus that was found."""
    rows = [
        [probe.film_distance_mm, probe.value, probe.error, probe.stop, probe.samples / 1e6, probe.seconds]
        for probe in report.probes
    ]
    columns = ("film distance [mm]", "measure", "error", "stop", "Msamples", "seconds")
    output.print_table(columns, rows, f"autofocus by {report.method}")
    if "started" in report.notes:
        start, step = report.notes["start_m"], report.notes["step_m"]
        print(f"from {start:.6g} m in steps of {step:.6g} m: {report.notes['started']}")
    if "criterion" in report.notes:
        off, shift = report.notes["beyond_spot"], report.notes["shift_when_stopped"]
        print(f"sharpest by {report.notes['criterion']}: {off:+.2f} depths of focus from the least spot")
        print(f"two stops down the focus goes {shift:+.2f} depths of focus nearer")
    distance = "nothing" if report.focus_distance_m is None else f"{report.focus_distance_m:.6g} m"
    film = f"film {report.film_distance_mm:.6g} mm behind the lens"
    doubt = "" if report.failure is None else ", NOT KNOWN TO BE IN FOCUS"
    print(f"{film}, sharp at {distance}, confidence {report.confidence:.2f}{doubt}")


# ``rptcam tradeoff``: what each approximation of a picture costs and gains.

PRINTED = Path("-")  # in place of a file: to standard output


def add_tradeoff(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    output.add_scene(parser)
    parser.add_argument(
        "--budget",
        type=duration,
        metavar="TIME",
        default=60.0,
        help="how long to measure, as 60s or 5min (default 60s)",
    )
    parser.add_argument(
        "--time", type=duration, metavar="TIME", default=60.0, help="rendering time to advise for (default 60s)"
    )
    parser.add_argument(
        "--error", type=share, metavar="X", default=0.02,
        help="relative error (root of relMSE) to advise for, as 0.02 or 2%% (default 0.02)",
    )  # fmt: skip
    parser.add_argument("--size", type=size, metavar="WxH", help="resolution in pixels, in place of the scene's")
    parser.add_argument(
        "--json", nargs="?", const=PRINTED, type=Path, metavar="FILE",
        help="write all numbers, .json; without a name, print them as JSON in place of text",
    )  # fmt: skip
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write advice and tables, .md")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw errors over time, field and picture, .svg, .png or .pdf"
    )
    parser.add_argument("--details", action="store_true", help="print all tables and how they were found, too")
    output.add_device(parser)
    add_options(parser, "overrides")
    parser.add_argument("--quiet", action="store_true", help="print only the result, warnings and errors")


def run_tradeoff(arguments: argparse.Namespace) -> int:
    """Render a scene in many ways by turns, and advise which one to use."""
    _check_tradeoff_files(arguments)
    from rptcam_cl.studies.tradeoff_runs import measure_tradeoff

    scene = output.loaded_scene(arguments)
    with contextlib.nullcontext() if arguments.quiet else output.say_on_stderr(_line) as show:
        report = measure_tradeoff(
            scene,
            budget=arguments.budget,
            seconds=arguments.time,
            error=arguments.error,
            size=arguments.size,
            device=arguments.device,
            on_progress=show,
        )
    _write_tradeoff(report, arguments)  # before any printing, which a reader like head may end
    if arguments.json == PRINTED:
        print(output.as_json(report.as_dict()))
    else:
        overrides = "".join(f" --set {shlex.quote(text)}" for text in arguments.overrides)
        _print_tradeoff(
            report, f"rptcam render {shlex.quote(str(arguments.scene))}{overrides}", details=arguments.details
        )
    return 0


def _check_tradeoff_files(arguments: argparse.Namespace) -> None:
    """Check, before anything is measured, that all files can be written."""
    for path, suffix in ((arguments.json, ".json"), (arguments.markdown, ".md")):
        if path is None or (path == PRINTED and suffix == ".json"):
            continue
        known_suffix(path, (suffix,), "unknown kind of file")
        check_writable(path, [arguments.scene])
    check_picture(arguments.plot, str(arguments.scene))


def _print_tradeoff(report: "TradeoffReport", command: str, *, details: bool) -> None:
    """Print the advice, whose commands may be pasted, and the tables and how they were found if that is wanted."""
    from rptcam_cl.studies.tradeoff import COMMAND, caveats, recommendation, summary, tables

    if not details:
        print("\n".join(summary(report)).replace(COMMAND, command))
        return

    print("\n".join(recommendation(report)).replace(COMMAND, command), end="\n\n")
    for title, columns, rows in tables(report):
        output.print_table(columns, rows, title)
        print()
    print("\n".join(caveats(report)))


def _write_tradeoff(report: "TradeoffReport", arguments: argparse.Namespace) -> None:
    """Write the report, and its tables and plot, where the arguments want them."""
    from rptcam_cl.studies.tradeoff import markdown, tradeoff_plot

    title = f"{arguments.scene.stem}: accuracy and time"
    if arguments.json not in (None, PRINTED):
        write((output.as_json(report.as_dict()) + "\n").encode(), arguments.json)
    if arguments.markdown is not None:
        write(markdown(report, title).encode(), arguments.markdown)
    if arguments.plot is not None:
        write_picture(tradeoff_plot(report, title), arguments.plot)


def _line(words: str, share: float | None) -> str:
    return words if share is None else f"{words} ({share:.0%})"
