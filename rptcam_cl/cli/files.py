"""From files to files: ``rptcam merge``, ``rptcam settle``, ``rptcam develop``, ``rptcam convert``, ``rptcam new``."""

import argparse
import shlex
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import add_options, size
from rptcam_cl.cli.output import add_device, as_json, check_different, names_of, positive, print_warnings, save
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import (
    DEVELOPED_SUFFIXES,
    FILM_SUFFIXES,
    RAW_SUFFIXES,
    check_writable,
    known_suffix,
    listed,
    replacing,
)

if TYPE_CHECKING:
    from rptcam_cl.exchange.conversion import Conversion
    from rptcam_cl.scene.load import Missing

SCENES, NOT_SCENE = (".yaml", ".yml"), "a scene file is YAML"


# ``rptcam merge``: parts of a render become its picture.


def add_merge(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("parts", type=Path, nargs="+", metavar="PART", help="files of the parts: .rpck")
    parser.add_argument(
        "-o", "--output", action="append", required=True, type=Path, metavar="OUT", dest="outputs",
        help="picture to write, as of render; or the whole as .rpck, for render --resume; may be repeated",
    )  # fmt: skip
    add_options(parser, "allow_mixed", "quiet")


def run_merge(arguments: argparse.Namespace) -> int:
    """Put together the parts that `rptcam render --part` and --samples made, anywhere."""
    from rptcam_cl.api.interface import merge
    from rptcam_cl.imaging.writers import check_output
    from rptcam_cl.rendering.checkpoint import SUFFIX

    outputs: list[Path] = arguments.outputs
    states = [output for output in outputs if output.suffix == SUFFIX]
    pictures = [output for output in outputs if output.suffix != SUFFIX]
    if len(states) > 1:
        raise InputError(f"-o: two files {SUFFIX} (allowed: one)")
    check_different(outputs, "-o")
    for output in states:
        check_writable(output, arguments.parts)
    for output in pictures:
        check_output(output, arguments.parts)
    image = merge(arguments.parts, checkpoint=states[0] if states else None, allow_mixed=arguments.allow_mixed)
    if pictures:
        save(image, argparse.Namespace(outputs=pictures, raws=[], stats=None))
    if not arguments.quiet:
        names, count = names_of(outputs), len(arguments.parts)
        made = f"{image.width} x {image.height}, {image.stats['spp']} spp, of {count} part{'s' * (count > 1)}"
        print(f"wrote {names}: {made}", file=sys.stderr)
        if "parts" in image.metadata:
            print(f"devices: {image.metadata['device']}; they may differ in the last bit", file=sys.stderr)
    return 0


# ``rptcam develop``: a film that was saved becomes pictures, without rendering it anew.


def add_develop(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("film", type=Path, metavar="FILM", help=f"film that render wrote: {listed(FILM_SUFFIXES)}")
    parser.add_argument(
        "-o", "--output", action="append", required=True, type=Path, metavar="OUT", dest="outputs",
        help=f"picture to write, format by suffix: {listed(DEVELOPED_SUFFIXES)}; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--raw", action="append", default=[], type=Path, metavar="OUT", dest="raws",
        help=f"raw file of the sensor that the film was rendered for: {listed(RAW_SUFFIXES)}; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], metavar="key=value", dest="overrides",
        help="replace a setting that the film was rendered with, as picture.tone=agx, picture.lut=look.cube or"
        " picture.ocio=ocio://default, or make a group of lamps brighter or darker, as lights.key=0.5 (of a film with"
        " the layer lights); may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--desqueeze", type=positive, metavar="FACTOR",
        help="make the picture of an anamorphic lens as much wider, as 1.36",
    )  # fmt: skip
    parser.add_argument(
        "--large", action="store_true",
        help="develop films of more than 67 million pixels, too, which take minutes however small their files are",
    )  # fmt: skip
    add_options(parser, "quiet")


def run_develop(arguments: argparse.Namespace) -> int:
    """Make pictures of a linear film that was saved, with other settings of the section picture."""
    from rptcam_cl.imaging.formats import check_raw_output
    from rptcam_cl.imaging.image import LARGE, desqueezed, develop, folders_of_film, read_film
    from rptcam_cl.imaging.writers import check_output

    for output in arguments.outputs:
        known_suffix(output, DEVELOPED_SUFFIXES, "is no developed picture")
        check_output(output, [arguments.film])
    for raw in arguments.raws:
        check_raw_output(raw, [arguments.film])
    written = [*arguments.outputs, *arguments.raws]
    check_different(written, "-o, --raw")
    film = read_film(arguments.film, most_pixels=None if arguments.large else LARGE)
    image = develop(film, arguments.overrides, folders=folders_of_film(arguments.film))
    if arguments.desqueeze is not None:
        if arguments.raws:
            raise InputError("--raw: is what the sensor counts, as it is squeezed (allowed: without --desqueeze)")
        image = desqueezed(image, arguments.desqueeze)
    raws = [(image.raw(), path) for path in arguments.raws]
    for output in arguments.outputs:
        image.save(output)
    for numbers, path in raws:
        numbers.save(path)
    if not arguments.quiet:
        print(f"wrote {names_of(written)}: {image.width} x {image.height}", file=sys.stderr)
    return 0


# ``rptcam settle``: focus, camera model and exposure of a scene are found once, for all renders that follow.


def add_settle(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.yaml", help="scene file to write")
    add_device(parser)
    add_options(parser, "overrides", "quiet")


def run_settle(arguments: argparse.Namespace) -> int:
    """Write a scene whose auto focus, accuracy and exposure are found, so that parts and frames agree."""
    from rptcam_cl.api.interface import settle
    from rptcam_cl.scene.load import load_scene

    known_suffix(arguments.output, SCENES, NOT_SCENE)
    check_writable(arguments.output, [arguments.scene])
    scene = load_scene(arguments.scene, arguments.overrides)
    print_warnings(scene.warnings)
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
    known_suffix(target, SCENES, NOT_SCENE)
    check_writable(target, [source])


MESHES = (".ply", ".obj", ".stl", ".gltf", ".glb")


def run_convert(arguments: argparse.Namespace) -> int:
    """Make a scene file from one of pbrt-v2, v3 or v4, from a stage of USD, or round a model as `rptcam new` does. What
    is ignored or approximated is listed; meshes and pictures go to folders beside the scene file.
    """
    _check_names(arguments.source, arguments.target)
    if arguments.source.suffix.lower() in MESHES:
        return _convert_model(arguments)
    done = _converted(arguments.source, arguments.target, arguments.missing, arguments.root, arguments.time_s)
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
    said = write_new(arguments.target, {"model": arguments.source, "time_s": arguments.time_s})
    if arguments.json:
        warnings = [text.removeprefix("warning: ") for text in said if text.startswith("warning: ")]
        notes = [{"effect": "note", "message": text, "lines": [], "objects": 1} for text in said
                 if not text.startswith("warning: ")]  # fmt: skip
        print(as_json({"objects": 1, "report": notes, "warnings": warnings}))
    elif not arguments.quiet:
        print(*said, f"wrote {arguments.target}", sep="\n", file=sys.stderr)
    return 0


def _converted(
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
        done = _converted(path, target, missing)
        messages = [*done.report, *done.write(target)]
        again = f"rptcam convert {shlex.quote(str(path))} scene.yaml"
    else:
        messages = write_new(target, {"model": path})
        again = f"rptcam new scene.yaml --model {shlex.quote(str(path))}"
    for message in messages:
        print(message, file=sys.stderr)
    print(f"{path} is shown as a scene that is made for this run; to keep it: {again}", file=sys.stderr)
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
    hint = ""
    if target.is_file() and arguments.model is None:
        words = ["rptcam", "new", f"{target.stem}.yaml", "--model", str(target)]
        hint = f"; for a scene of that model: {shlex.join(words)}"
    known_suffix(target, SCENES, NOT_SCENE, hint)
    if target.exists():
        raise InputError(f"{target}: is there already; choose another name, or remove it first")
    check_writable(target)
    names = ("model", "hdri", "lens", "size", "up", "metres_per_unit", "reframe", "time_s")
    for message in write_new(target, {name: getattr(arguments, name) for name in names}):
        print(message, file=sys.stderr)
    named, picture = shlex.quote(str(target)), shlex.quote(f"{target.stem}.png")
    print(f"wrote {target}; next: rptcam render {named} -o {picture}, or rptcam view {named}", file=sys.stderr)
    return 0


def write_new(target: Path, settings: dict[str, Any]) -> list[str]:
    """Write a starting scene with the files that it needs, and return what there is to say of it."""
    from rptcam_cl.exchange.starting import starting_scene
    from rptcam_cl.scene.load import load_scene, scene_text

    start = starting_scene(target.parent, **settings)
    copied = start.copies.write()
    scene = load_scene(start.scene, base_dir=target.parent, missing="grey")
    with replacing(target) as temporary:
        temporary.write_text(scene_text(start.scene, (HEAD,)), "utf-8")
    warnings = [f"warning: {text}" for text in scene.warnings if text not in start.report]
    return [*start.report, *(f"copied {path.name}" for path in copied), *warnings]


HEAD = "A starting scene by rptcam new: change what you like; docs/scene.md has every key."
