"""``rptcam camera``: the camera of a scene, or of a lens alone, for programs that measure in its pictures."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.camera_files import TEXTS, check_outputs, write_files
from rptcam_cl.cli.camera_maps import add_maps
from rptcam_cl.cli.output import as_json, print_table, print_warnings
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.calibration import Calibration, View

MODELS = ("auto", "pinhole", "brown_conrady", "rational", "thin_prism", "kannala_brandt")
GOOD_PX = 0.05  # residual at which the search for a model ends, where no other is given
POOR_PX = 0.1  # residual from which on there is a warning, where no other is given


def film(text: str) -> tuple[float, float]:
    """Width and height of ``WxH`` [mm]."""
    try:
        width, height = (float(part) for part in text.lower().replace("×", "x").split("x"))
    except ValueError:
        width = height = -1.0
    if not (0 < width < 1e6 and 0 < height < 1e6):
        raise argparse.ArgumentTypeError(f"got {text}; allowed WxH in millimetres, as 36x24")
    return width, height


def distance(text: str) -> float:
    """Distance of an object, which may be far away: ``inf`` [m]."""
    return math.inf if text.lower() == "inf" else values.positive(text)


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "camera",
        help="the camera for computer vision: intrinsics, distortion, pose",
        description="The camera for computer vision: intrinsics, distortion and pose, fitted to the chief rays of the"
        " lens.",
    )
    parser.add_argument("source", metavar="SCENE|LENS", help="scene file, or a lens by name or file")
    values.add_overrides(parser)
    parser.add_argument("--size", type=values.size, metavar="WxH", help="resolution (default: the scene's, 768x512)")
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
        "--max-residual-px", type=values.positive, metavar="R", help="refuse a model that errs by more anywhere"
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
    add_maps(parser)
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.calibration import subject, view
    from rptcam_cl.scene import camera_changes

    check_outputs(arguments)
    scene = subject(arguments.source, arguments.overrides, size=arguments.size, film_mm=arguments.film)
    seen = view(scene, arguments.distance_m, arguments.object)
    if camera_changes(scene):
        print(
            "note: the camera changes while the shutter is open; this is its state when it opens, at"
            f" {scene.shutter.open_s:g} s (--set shutter.open_s=T takes another moment)",
            file=sys.stderr,
        )
    if seen.setting is not None:
        print_warnings(seen.setting.lens.warnings)
    chosen = _chosen(arguments, seen)
    _report(arguments, seen, chosen)
    write_files(arguments, seen, chosen)
    return 0


def _chosen(arguments: argparse.Namespace, seen: "View") -> "Calibration":
    """The requested model, or the simplest that fits and that all files to be written can hold."""
    from rptcam_cl.calibration import COEFFICIENTS, HELD, calibrate, calibrate_best, check_held

    forms = [name for name in (*TEXTS, "colmap") if getattr(arguments, name) is not None]
    allowed = arguments.max_residual_px
    if arguments.model == "auto":
        held = [model for model in COEFFICIENTS if all(model in HELD[name] for name in forms)]
        found = calibrate_best(seen, held, allowed or GOOD_PX)
        if allowed is None and found.max_px > POOR_PX:
            of = "" if len(held) == len(COEFFICIENTS) else " of what these files can say"
            said = f"{found.model} fits best{of} and errs by {found.max_px:.3g} px"
            print_warnings([f"{said}; maps of the lens itself have no residual: --stmap-undistort"])
    else:
        for name in forms:
            check_held(name, arguments.model)
        found = calibrate(seen, arguments.model)
    if allowed is not None and found.max_px > allowed:
        best = calibrate_best(seen, list(COEFFICIENTS), 0.0)
        hint = f"{best.model} errs by {best.max_px:.3g} px" if best.model != found.model else "it is the best of all"
        raise InputError(
            f"--max-residual-px: {found.model} errs by {found.max_px:.3g} px for {seen.name}"
            f" (allowed: {allowed:g}; {hint}; maps of the lens itself have no residual: --stmap-undistort)"
        )
    return found


def _report(arguments: argparse.Namespace, seen: "View", chosen: "Calibration") -> None:
    from rptcam_cl.calibration import COEFFICIENTS, calibrate, document, object_text

    if not arguments.json:
        rows = [[name, value] for name, value in chosen.named.items()]
        rows += [["largest error [px]", chosen.max_px], ["rms error [px]", chosen.rms_px]]
        rows += [["lit share of the picture", chosen.lit_share], ["pupil ahead of eye [mm]", seen.pupil_ahead_mm]]
        width, height = seen.size
        title = f"{seen.name}, {width} x {height} px, {object_text(seen)}; the first pixel's centre is 0.5"
        print_table((chosen.model, "value"), rows, title)
        return
    found, refused = [], {}
    for model in COEFFICIENTS:
        try:
            found.append(calibrate(seen, model))
        except InputError as problem:
            refused[model] = str(problem)
    print(as_json(document(seen, found, refused) | {"chosen": chosen.model}))
