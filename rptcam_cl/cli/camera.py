"""``rptcam camera``: the camera of a scene, or of a lens alone, for programs that measure in its pictures."""

import argparse
import math
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.camera_maps import add_maps, check_maps, written_maps
from rptcam_cl.cli.lens_options import write
from rptcam_cl.cli.output import as_json, print_table, print_warnings
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.calibration import Calibration, View

MODELS = ("auto", "pinhole", "brown_conrady", "rational", "thin_prism", "kannala_brandt")
GOOD_PX = 0.05  # residual at which the search for a model ends, where no other is given
TEXTS = ("opencv", "ros", "openlensio", "usd", "osl")


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
    text = "the camera for computer vision: intrinsics, distortion and pose, fitted to the chief rays of the lens"
    parser = commands.add_parser("camera", help=text, description=text[0].upper() + text[1:] + ".")
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

    _check_outputs(arguments)
    scene = subject(arguments.source, arguments.overrides, size=arguments.size, film_mm=arguments.film)
    seen = view(scene, arguments.distance_m, arguments.object)
    if seen.setting is not None:
        print_warnings(seen.setting.lens.warnings)
    chosen = _chosen(arguments, seen)
    _report(arguments, seen, chosen)
    _write(arguments, seen, chosen)
    return 0


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse, before anything is traced, files that could not be written."""
    from rptcam_cl.core.atomic import check_writable

    for name in TEXTS:
        if (path := getattr(arguments, name)) is not None:
            check_writable(path, [arguments.source])
    if arguments.plot is not None:
        from rptcam_cl.lenstools import check_suffix

        check_suffix(arguments.plot)
        check_writable(arguments.plot, [arguments.source])
    check_maps(arguments)
    if (folder := arguments.colmap) is not None:
        check_writable(folder / "cameras.txt" if folder.is_dir() else folder)


def _chosen(arguments: argparse.Namespace, seen: "View") -> "Calibration":
    """The requested model, or the simplest that fits and that all files to be written can hold."""
    from rptcam_cl.calibration import COEFFICIENTS, HELD, calibrate, calibrate_best, check_held

    forms = [name for name in (*TEXTS, "colmap") if getattr(arguments, name) is not None]
    allowed = arguments.max_residual_px
    if arguments.model == "auto":
        held = [model for model in COEFFICIENTS if all(model in HELD[name] for name in forms)]
        found = calibrate_best(seen, held, allowed or GOOD_PX)
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


def _write(arguments: argparse.Namespace, seen: "View", chosen: "Calibration") -> None:
    from rptcam_cl.calibration import WRITTEN, colmap_texts, residual_chart
    from rptcam_cl.lenstools import encoded

    texts: list[tuple[Path, Callable[[], bytes]]] = [
        (path, lambda name=name: WRITTEN[name](seen, chosen).encode())  # type: ignore[misc]
        for name in TEXTS
        if (path := getattr(arguments, name)) is not None
    ]
    made: list[tuple[Path, bytes]] = [(path, text()) for path, text in texts]  # all, before the first is written
    if arguments.plot is not None:
        made.append((arguments.plot, encoded(residual_chart(seen, chosen), arguments.plot)))
    maps = list(written_maps(arguments, seen))
    for path, data in made:
        write(data, path)
    for path, writer in maps:
        _write_by(writer, path)
    if arguments.colmap is not None:
        _write_folder(arguments.colmap, colmap_texts(seen, chosen, _picture_name(arguments.source)))


def _write_by(writer: Callable[[Path], object], output: Path) -> None:
    """Write a file by what writes to a path, whole or not at all, and say so."""
    from rptcam_cl.core.atomic import replacing

    with replacing(output) as temporary:
        writer(temporary)
    print(f"wrote {output}", file=sys.stderr)


def _picture_name(source: str) -> str:
    return f"{Path(source).stem.replace(' ', '_')}.png"


def _write_folder(folder: Path, texts: dict[str, str]) -> None:
    """Write text files into a folder, all or none where it is new."""
    from rptcam_cl.core.atomic import check_writable, replacing

    folder.mkdir(exist_ok=True)
    for name in texts:
        check_writable(folder / name)
    with ExitStack() as files:
        for name, text in texts.items():
            files.enter_context(replacing(folder / name)).write_text(text, "utf-8")
    print(f"wrote {folder}", file=sys.stderr)
