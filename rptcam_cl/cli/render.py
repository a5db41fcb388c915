"""``rptcam render`` and ``demo``: a scene file becomes pictures; ``merge``, ``develop``: parts and films do, too."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import RENDER_OPTIONS, RenderOptions, add_options, check_together, number
from rptcam_cl.cli import frames, output
from rptcam_cl.core import files
from rptcam_cl.core.errors import InputError, NumericError, RptcamError, StateError

if TYPE_CHECKING:
    from rptcam_cl.imaging.image import Image
    from rptcam_cl.rendering import account, progressive
    from rptcam_cl.scene.scene import Scene


# ``rptcam render --preview``: the picture so far is written to the outputs while the render goes on.


def _preview_writer(interval: float, outputs: Sequence[Path], show: output.Show | None) -> output.Show:
    """A function that takes reports of a render and writes the picture so far, each file whole or not at all.

    That one cannot be written ends no render.

    Parameters
    ----------
    interval
        Time between two pictures [s].
    outputs
        Where the finished picture goes too.
    show
        Gets every report as well.
    """
    last = time.monotonic()

    def write(progress: progressive.Progress) -> None:
        nonlocal last
        if show is not None:
            show(progress)
        if progress.image is None or time.monotonic() - last < interval:
            return
        image = progress.image()
        for path in outputs:
            try:
                image.save(path)
            except RptcamError as error:
                print(f"warning: the picture so far: {error}", file=sys.stderr)
        last = time.monotonic()

    return write


# What is checked before anything is compiled: that files can be written at the end, that options go together.


def _check_part_output(arguments: argparse.Namespace, inputs: Sequence[Path]) -> None:
    """Check that a part has one file, and no option that needs the whole film.

    Raises
    ------
    InputError, StateError
    """
    from rptcam_cl.rendering.checkpoint import SUFFIX

    check_together(arguments, "part", "--part" if arguments.part is not None else "--samples")
    if arguments.samples is not None and arguments.spp is not None:
        raise InputError("--spp: --samples says where the samples end (allowed: one of the two)")
    outputs: list[Path] = arguments.outputs
    if len(outputs) != 1 or outputs[0].suffix != SUFFIX:
        got = output.names_of(outputs)
        raise InputError(f"-o: a part is one file (got {got}; allowed: a name that ends in {SUFFIX})")
    files.check_writable(outputs[0], inputs)


def _check_truth(arguments: argparse.Namespace, scene: Scene) -> None:
    """Check, before anything is compiled, that the files of truth can be written at the end.

    Raises
    ------
    InputError, StateError
    """
    folder: Path | None = arguments.truth
    if folder is None:
        return
    from rptcam_cl.imaging.writers import MOST_INSTANCES

    check_together(arguments, "truth", "--truth")
    if len(scene.objects) >= MOST_INSTANCES:
        raise InputError(f"--truth: masks of 16 bits hold {MOST_INSTANCES} objects (got {len(scene.objects)})")
    there = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    if not there.is_dir():
        raise StateError(f"--truth: {there} is no folder (allowed: a folder, which is made if it is missing)")
    if not os.access(there, os.W_OK | os.X_OK):
        raise StateError(f"--truth: {there} cannot be written to")


def _check_outputs(arguments: argparse.Namespace, scene: Scene) -> None:
    """Check that all files can be written."""
    from rptcam_cl.imaging import formats, writers

    lens = scene.lens_source()
    inputs = [arguments.scene, *([lens] if isinstance(lens, Path) else [])]
    if output.is_part(arguments):
        _check_part_output(arguments, inputs)
        return
    for path in arguments.outputs:
        writers.check_output(path, inputs)
    if arguments.raws and scene.sensor is None:
        raise InputError("--raw: the scene has no sensor (allowed: with a section sensor, or --set sensor={})")
    for raw in arguments.raws:
        formats.check_raw_output(raw, inputs)
    if arguments.stats is not None:
        if arguments.stats.suffix.lower() != ".json":
            raise InputError(f"{arguments.stats}: statistics are JSON (allowed: a name that ends in .json)")
        files.check_writable(arguments.stats, inputs)
    files.check_writable(output.checkpoint_of(arguments), inputs)
    _check_truth(arguments, scene)
    if arguments.layers and not any(map(writers.holds_layers, arguments.outputs)):
        allowed = f"-o with a name that ends in {files.listed(files.LAYER_SUFFIXES)}"
        raise InputError(f"--layers: no output can hold them (allowed: {allowed})")
    output.check_different(output.files_to_write(arguments), "-o, --raw" if arguments.raws else "-o")


# The command.


def add_render(parser: argparse.ArgumentParser) -> None:
    """Add the scene and all options of a render."""
    parser.add_argument(
        "scene", type=Path, metavar="SCENE", help="scene file (YAML), or one of pbrt, a stage of USD or a model"
    )
    for option in RENDER_OPTIONS:
        option.add_to(parser)


def run_render(arguments: argparse.Namespace) -> int:
    """Render a scene file; one of pbrt, a stage of USD or a model as convert or new would make it. Ctrl-C ends the
    render and keeps the picture so far.
    """
    if not arguments.watch:
        if arguments.scene.suffix.lower() not in output.SCENE_SUFFIXES:
            from rptcam_cl.cli.first_steps import scene_file

            arguments.scene = scene_file(arguments.scene, arguments.missing)
            arguments.missing = "grey"  # what is missing, scene_file has refused or said
        return _picture(arguments)
    check_together(arguments, "watch", "--watch")
    with output.stop_on_interrupt() as stop:
        frames.render_again(arguments.scene, stop, lambda should_stop: _picture(arguments, should_stop))
    return 0


def _picture(arguments: argparse.Namespace, should_stop: Callable[[], bool] | None = None) -> int:
    """Load the scene, render it, write the outputs and return the exit code; interrupted, a watched one writes none."""
    note_success = _open_early(arguments)
    from rptcam_cl.scene.load import load_scene

    scene = load_scene(arguments.scene, arguments.overrides, missing=arguments.missing)
    if arguments.frames is not None:
        frames.check_frame_options(arguments)
    elif arguments.video is not None:
        raise InputError("--video: is of a sequence (allowed: with --frames)")
    elif many := [path for path in output.files_to_write(arguments) if "##" in path.name]:
        raise InputError(f"{many[0]}: #### stands for the number of a frame (allowed: with --frames, as --frames 1-24)")
    by_cluster = output.is_for_cluster(arguments)
    _check_outputs(arguments, scene)
    output.print_warnings(scene.warnings)
    if arguments.frames is not None:
        return _sequence(arguments, scene, by_cluster)
    if by_cluster:
        return frames.render_by_cluster(arguments, scene)
    if arguments.plan:
        return _print_plan(arguments, scene)
    code = _render_one(arguments, scene, should_stop)
    if code == 0:
        note_success()
    return code


def _open_early(arguments: argparse.Namespace) -> Callable[[], None]:
    """Open the device of a single picture, where it is one; return what is to be called when that was rendered."""
    from rptcam_cl.device.session import means_one, open_early

    device = output.device_of(arguments)
    elsewhere = arguments.plan or arguments.frames is not None or output.is_for_cluster(arguments)
    if elsewhere or isinstance(device, list) or not means_one(device, arguments.split):
        return lambda: None
    return open_early(device, str(arguments.scene.absolute()), arguments.overrides, arguments.layers)


def _print_plan(arguments: argparse.Namespace, scene: Scene) -> int:
    """Print what a render will take, and return the exit code."""
    from rptcam_cl.api.job import RenderJob

    begun = time.perf_counter()
    job = RenderJob.prepare(scene, RenderOptions(**output.render_keywords(arguments, scene)))
    preparing = time.perf_counter() - begun
    needs = job.forecast()
    if needs is None:
        raise InputError("--plan: --time says how long it takes (allowed: without --time)")
    print("\n".join(_forecast_lines(needs, preparing)))
    return 0


def _forecast_lines(forecast: account.Forecast, preparing: float) -> list[str]:
    """What a render takes, as ``--plan`` prints it."""
    from rptcam_cl.rendering.tracer import amount

    memory = [f"{amount(needs.total)} on device {device}" for device, needs in forecast.devices.items()]
    limit = "at most " if forecast.at_most else ""
    speed = forecast.samples / max(forecast.seconds, 1e-9) / 1e6
    return [
        f"samples: {limit}{forecast.samples:,}, {limit}{forecast.launches:,} kernel launches",
        f"memory:  {', '.join(memory)}; {amount(forecast.saved_bytes)} for its state on disk",
        f"time:    {limit}{output.as_duration(forecast.seconds)} of rendering at {speed:.3g} Msamples/s (measured for"
        f" {forecast.measured_seconds:.1f} s), after {output.as_duration(preparing)} of preparing",
    ]


def _sequence(arguments: argparse.Namespace, scene: Scene, by_cluster: bool) -> int:
    """Render the frames that are not there yet, here or on a cluster, and return the first exit code that is not 0."""
    missing = frames.missing_frames(arguments, scene)
    if by_cluster:
        code = frames.render_frames_by_cluster(arguments, missing)
    else:
        code = next(filter(None, map(_frame, missing)), 0)
    if code == 0 and arguments.video is not None:
        frames.write_video_of(arguments, scene)
    return code


def _frame(frame: frames.Frame) -> int:
    """Render one frame of a sequence; its state goes with its end."""
    arguments, scene, metadata = frame
    checkpoint = output.checkpoint_of(arguments)
    arguments.resume = arguments.resume and checkpoint.exists()
    code = _render_one(arguments, scene, None, metadata)
    if code == 0 and arguments.resume:
        checkpoint.unlink(missing_ok=True)
    return code


def _render(
    arguments: argparse.Namespace, scene: Scene, should_stop: Callable[[], bool] | None
) -> tuple[Image, NumericError | None, bool]:
    """The picture, why a strict render fails all the same, and whether it was to be ended, though too late.

    Ctrl-C ends it unless something else does.
    """
    from rptcam_cl.api.job import render
    from rptcam_cl.imaging.image import Image

    with contextlib.ExitStack() as stack:
        should_stop = should_stop or stack.enter_context(output.stop_on_interrupt()).is_set
        show = None if arguments.quiet else stack.enter_context(output.progress_on_stderr(arguments.seconds))
        if arguments.preview is not None:
            show = _preview_writer(arguments.preview, arguments.outputs, show)
        try:
            image = render(scene, **output.render_keywords(arguments, scene), on_progress=show, should_stop=should_stop)
        except NumericError as failure:
            assert isinstance(failure.image, Image)
            return failure.image, failure, should_stop()
    return image, None, should_stop()


def _render_one(
    arguments: argparse.Namespace,
    scene: Scene,
    should_stop: Callable[[], bool] | None,
    metadata: dict[str, Any] | None = None,
) -> int:
    """Render a picture, write it with further metadata, and return the exit code."""
    checkpoint = output.checkpoint_of(arguments)
    if checkpoint.exists() and not arguments.resume and not arguments.watch and not arguments.quiet:
        print(f"note: {checkpoint} holds an earlier render; --resume would go on from it", file=sys.stderr)
    image, failure, interrupted = _render(arguments, scene, should_stop)
    if metadata is not None:
        arguments.same.add(f"frame {metadata['frame']}", image.metadata["made_by"])
        image.metadata.update(metadata)
    if arguments.watch and image.stats["interrupted"]:
        return output.INTERRUPTED
    if not output.is_part(arguments):
        _save(arguments, image, scene)
    elif image.stats.get("checkpoint") is None:
        raise StateError(f"{checkpoint}: could not be written")
    output.print_warnings(output.dark_warnings(image, whole=not output.is_part(arguments)))
    output.print_warnings(f"autofocus: {line}" for line in image.metadata.get("autofocus", {}).get("warnings", ()))
    if not arguments.quiet:
        for line in _account_lines(image):
            print(line, file=sys.stderr)
        print(output.summary(image, output.files_to_write(arguments)), file=sys.stderr)
    if image.stats.get("interrupted"):
        more = "; --resume goes on from it" if image.stats.get("checkpoint") else ""
        what = "the part" if output.is_part(arguments) else "the picture"
        print(f"interrupted: {what} holds what was rendered so far{more}", file=sys.stderr)
    if failure is not None:
        raise failure
    return output.INTERRUPTED if interrupted or image.stats.get("interrupted") else 0


def _save(arguments: argparse.Namespace, image: Image, scene: Scene) -> None:
    """Write the outputs, with their layers alone, and the files of truth, of the first output's picture."""
    files_of_image = arguments.outputs, arguments.raws, arguments.stats
    if arguments.truth is None:
        output.save(image, *files_of_image)
        return
    layers = output.layers_of_outputs(arguments)
    kept = scene.render.layers if layers is None else layers
    output.save(replace(image, layers={name: image.layers[name] for name in kept}), *files_of_image)
    written = image.save_truth(arguments.truth, arguments.outputs[0].name)
    if not arguments.quiet:
        print(f"wrote {output.names_of(written)}", file=sys.stderr)


def _account_lines(image: Image) -> list[str]:
    """What a render has done beside its samples, a line each."""
    metadata = image.metadata
    lines = [f"{name}: {metadata[name]['says']}" for name in ("diffraction", "ghosts") if name in metadata]
    if lamps := metadata.get("lamps_aimed_at"):
        lines.append(f"bokeh: camera rays aim at {lamps} lamp{'s' * (lamps > 1)} out of focus")
    lines += [f"accuracy: {line}" for line in metadata.get("accuracy", {}).get("says", ())]
    shared = output.shared_text(image.stats)
    return lines if shared is None else [*lines, shared]


# ``rptcam demo``: a first picture, from scenes that come with the package.


def add_demo(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "scene", nargs="?", choices=tuple(files.SCENES), default=next(iter(files.SCENES)), metavar="SCENE",
        help="another of its scenes (rptcam examples lists them)",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", metavar="OUT", help="picture to write (default: SCENE.png in the current folder)"
    )
    parser.add_argument("--spp", metavar="N", help="samples per pixel, in place of the scene's")
    parser.add_argument("--size", metavar="WxH", help="resolution in pixels")
    output.add_device(parser)


def run_demo(arguments: argparse.Namespace) -> int:
    """Render the first picture, from a scene that comes with the package; it needs no other file."""
    scene = files.example_scenes()[arguments.scene]
    picture = Path(arguments.output or f"{arguments.scene}.png")
    words = [str(scene), f"--output={picture}"]
    words += [f"--{name}={value}" for name in ("spp", "size", "device") if (value := getattr(arguments, name))]
    parser = output.Parser(prog=arguments.parser.prog)
    add_render(parser)
    code = run_render(parser.parse_args(words))
    if code == 0:
        print(f"the scene is {scene}; for a copy to change: rptcam examples {arguments.scene} -o .", file=sys.stderr)
    return code


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
    from rptcam_cl.api.job import merge
    from rptcam_cl.imaging.writers import check_output
    from rptcam_cl.rendering.checkpoint import SUFFIX

    outputs: list[Path] = arguments.outputs
    states = [path for path in outputs if path.suffix == SUFFIX]
    pictures = [path for path in outputs if path.suffix != SUFFIX]
    if len(states) > 1:
        raise InputError(f"-o: two files {SUFFIX} (allowed: one)")
    output.check_different(outputs, "-o")
    for path in states:
        files.check_writable(path, arguments.parts)
    for path in pictures:
        check_output(path, arguments.parts)
    image = merge(arguments.parts, checkpoint=states[0] if states else None, allow_mixed=arguments.allow_mixed)
    if pictures:
        output.save(image, pictures)
    if not arguments.quiet:
        names, count = output.names_of(outputs), len(arguments.parts)
        made = f"{image.width} x {image.height}, {image.stats['spp']} spp, of {count} part{'s' * (count > 1)}"
        print(f"wrote {names}: {made}", file=sys.stderr)
        if "parts" in image.metadata:
            print(f"devices: {image.metadata['device']}; they may differ in the last bit", file=sys.stderr)
    return 0


# ``rptcam develop``: a film that was saved becomes pictures, without rendering it anew.


def add_develop(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "film", type=Path, metavar="FILM", help=f"film that render wrote: {files.listed(files.FILM_SUFFIXES)}"
    )
    parser.add_argument(
        "-o", "--output", action="append", required=True, type=Path, metavar="OUT", dest="outputs",
        help=f"picture to write, format by suffix: {files.listed(files.DEVELOPED_SUFFIXES)}; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--raw", action="append", default=[], type=Path, metavar="OUT", dest="raws",
        help=f"raw file of the sensor that the film was rendered for: {files.listed(files.RAW_SUFFIXES)}; may be"
        " repeated",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], metavar="key=value", dest="overrides",
        help="replace a setting that the film was rendered with, as picture.tone=agx, picture.lut=look.cube or"
        " picture.ocio=ocio://default, or make a group of lamps brighter or darker, as lights.key=0.5 (of a film with"
        " the layer lights); may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--desqueeze", type=output.positive, metavar="FACTOR",
        help="make the picture of an anamorphic lens as much wider, as 1.36",
    )  # fmt: skip
    parser.add_argument(
        "--peaking", type=number(float, 0.0, 1.0, "a number from 0 to 1"), metavar="LEVEL",
        help="colour what is sharp at the scale of a pixel, the more the higher the level (the viewfinder's is 0.5)",
    )  # fmt: skip
    parser.add_argument(
        "--large", action="store_true",
        help="develop films of more than 67 million pixels, too, which take minutes however small their files are",
    )  # fmt: skip
    add_options(parser, "quiet")


def _save_marked(image: Image, path: Path, level: float) -> None:
    """Save a picture in which what is sharp at the scale of its pixels is coloured."""
    from PIL import Image as Pillow

    from rptcam_cl.viewfinder import instruments, messages

    codes = messages.codes_of(image)
    codes[instruments.peaking(image.seen, level)] = instruments.PEAKING_COLOUR[:3]
    with files.replacing(path) as temporary:
        Pillow.fromarray(codes).save(temporary, "PNG" if path.suffix.lower() == ".png" else "JPEG")


def run_develop(arguments: argparse.Namespace) -> int:
    """Make pictures of a linear film that was saved, with other settings of the section picture."""
    from rptcam_cl.imaging import formats, writers
    from rptcam_cl.imaging.image import LARGE, desqueezed, develop, folders_of_film, read_film

    for path in arguments.outputs:
        if arguments.peaking is None:
            files.known_suffix(path, files.DEVELOPED_SUFFIXES, "is no developed picture")
        else:
            files.known_suffix(path, (".png", ".jpg"), "takes no marks of what is sharp")
        writers.check_output(path, [arguments.film])
    for raw in arguments.raws:
        formats.check_raw_output(raw, [arguments.film])
    written = [*arguments.outputs, *arguments.raws]
    output.check_different(written, "-o, --raw")
    film = read_film(arguments.film, most_pixels=None if arguments.large else LARGE)
    image = develop(film, arguments.overrides, folders=folders_of_film(arguments.film))
    if arguments.desqueeze is not None:
        if arguments.raws:
            raise InputError("--raw: is what the sensor counts, as it is squeezed (allowed: without --desqueeze)")
        image = desqueezed(image, arguments.desqueeze)
    raws = [(image.raw(), path) for path in arguments.raws]
    for path in arguments.outputs:
        if arguments.peaking is None:
            image.save(path)
        else:
            _save_marked(image, path, arguments.peaking)
    for numbers, path in raws:
        numbers.save(path)
    if not arguments.quiet:
        print(f"wrote {output.names_of(written)}: {image.width} x {image.height}", file=sys.stderr)
    return 0
