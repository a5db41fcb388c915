"""``rptcam render``: a scene file becomes pictures."""

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl._version import __version__
from rptcam_cl.cli import cluster, frames, parts, plan, summary, truth
from rptcam_cl.cli import parser as values
from rptcam_cl.cli.interrupt import INTERRUPTED, stop_on_interrupt
from rptcam_cl.cli.output import print_warnings
from rptcam_cl.cli.parser import Commands
from rptcam_cl.cli.previews import previewing
from rptcam_cl.cli.progress import progress_on_stderr
from rptcam_cl.cli.saving import save
from rptcam_cl.cli.watch import render_again
from rptcam_cl.core.errors import InputError, NumericError, StateError

if TYPE_CHECKING:
    from rptcam_cl.imaging import Image
    from rptcam_cl.scene import Scene


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "render",
        help="render a scene file to pictures",
        description="Render a scene file. Ctrl-C ends the render and keeps the picture so far.",
    )
    add_arguments(parser)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene and all options of a render."""
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    _add_outputs(parser)
    _add_sampling(parser)
    _add_picture(parser)
    values.add_devices(parser)
    values.add_overrides(parser)
    values.add_missing(parser)
    parts.add_options(parser)
    plan.add_option(parser)
    truth.add_option(parser)
    frames.add_option(parser)
    cluster.add_options(parser)
    parser.add_argument("--stats", type=Path, metavar="FILE.json", help="write statistics of the render")
    parser.add_argument(
        "--strict", action="store_true",
        help="fail, with exit code 5, when numbers cannot be trusted or autofocus failed; the picture is still written",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.add_argument(
        "--preview", type=values.duration, metavar="TIME",
        help="write the picture so far to the outputs now and then, as every 10s",
    )  # fmt: skip
    parser.add_argument(
        "--watch", action="store_true",
        help="render again whenever the scene file or a file that it names changes, until Ctrl-C",
    )  # fmt: skip
    parser.set_defaults(run=_run, parser=parser)


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o", "--output", action="append", required=True, type=Path, metavar="OUT", dest="outputs",
        help="picture to write, format by suffix: .png, .jpg and .tif developed, .exr, .npy and .npz linear; may be"
        " repeated",
    )  # fmt: skip
    parser.add_argument(
        "--raw", action="append", default=[], type=Path, metavar="OUT", dest="raws",
        help="also write a raw file of the scene's sensor, format by suffix: .dng, .tif or .npy; may be repeated",
    )  # fmt: skip


def _add_sampling(parser: argparse.ArgumentParser) -> None:
    """Add how long to render, and with which random numbers."""
    parser.add_argument("--spp", type=values.spp, metavar="N", help="samples per pixel, in place of the scene's")
    parser.add_argument(
        "--time", type=values.duration, metavar="TIME", help="stop after this rendering time, as 60s or 5min"
    )
    parser.add_argument(
        "--noise", type=values.share, metavar="X",
        help="sample each tile of 8 x 8 pixels until its relative standard error is X, as 0.02 or 2%%",
    )  # fmt: skip
    parser.add_argument(
        "--resume", action="store_true",
        help="continue from OUT.rpck, which an interrupted render leaves, and keep it, so that samples can be added",
    )  # fmt: skip
    values.add_allow_mixed(parser)
    parser.add_argument("--seed", type=values.seed, metavar="N", help="seed of the random numbers")


def _add_picture(parser: argparse.ArgumentParser) -> None:
    """Add which part of the film is rendered, and what is recorded of it."""
    parser.add_argument("--size", type=values.size, metavar="WxH", help="resolution in pixels")
    parser.add_argument(
        "--crop", type=values.crop, metavar="x0,x1,y0,y1",
        help="render only this window, in fractions of the picture from the left and the top",
    )  # fmt: skip
    parser.add_argument(
        "--layers", type=values.layers, metavar="NAME,...",
        help="record these auxiliary layers in .exr and .npz outputs, as depth,normal; all for every one",
    )  # fmt: skip
    parser.add_argument(
        "--denoise", action="store_true", help="remove the remaining noise (biased); needs rptcam_cl[denoise]"
    )


def _inputs(path: Path, scene: "Scene") -> list[Path]:
    """The files that a render reads: the scene file and the lens file, when the lens is one."""
    lens = scene.lens_source()
    return [path, lens] if isinstance(lens, Path) else [path]


def _check_outputs(arguments: argparse.Namespace, scene: "Scene") -> None:
    """Refuse, before anything is compiled, what could not be written at the end."""
    from rptcam_cl.core.atomic import check_writable
    from rptcam_cl.imaging import check_output, check_raw_output, holds_layers

    taken = _inputs(arguments.scene, scene)
    if parts.requested(arguments):
        parts.check_output(arguments, taken)
        return
    for output in arguments.outputs:
        check_output(output, taken)
    if arguments.raws and scene.sensor is None:
        raise InputError("--raw: the scene has no sensor (allowed: with a section sensor, or --set sensor={})")
    for raw in arguments.raws:
        check_raw_output(raw, taken)
    if arguments.stats is not None:
        if arguments.stats.suffix.lower() != ".json":
            raise InputError(f"{arguments.stats}: statistics are JSON (allowed: a name that ends in .json)")
        check_writable(arguments.stats, taken)
    check_writable(_checkpoint(arguments), taken)
    truth.check(arguments, scene)
    if arguments.layers and not any(map(holds_layers, arguments.outputs)):
        raise InputError("--layers: no output can hold them (allowed: -o with a name that ends in .exr or .npz)")
    written = [*arguments.outputs, *arguments.raws]
    if len({output.resolve() for output in written}) < len(written):
        raise InputError("-o, --raw: the same file twice" if arguments.raws else "-o: the same file twice")


def _checkpoint(arguments: argparse.Namespace) -> Path:
    """Where the state of the render is kept: beside the first output."""
    from rptcam_cl.rendering import SUFFIX

    first: Path = arguments.outputs[0]
    return first.with_suffix(SUFFIX)


def _layers(arguments: argparse.Namespace) -> list[str] | None:
    """The layers to record: those requested, none where no output could hold the scene's, else the scene's."""
    from rptcam_cl.imaging import holds_layers

    if arguments.layers is not None:
        return list(arguments.layers)
    if parts.requested(arguments):
        return None
    return None if any(map(holds_layers, arguments.outputs)) else []


def _devices(arguments: argparse.Namespace) -> str | list[str] | None:
    """The devices as `rptcam_cl.render` takes them."""
    given: list[str] | None = arguments.devices
    return given[0] if given is not None and len(given) == 1 else given


def _options(arguments: argparse.Namespace, scene: "Scene") -> dict[str, Any]:
    """The keyword arguments of `rptcam_cl.render`."""
    return {
        "spp": arguments.spp,
        "seconds": arguments.time,
        "seed": arguments.seed,
        "size": arguments.size,
        "crop": arguments.crop,
        "layers": truth.with_layers(arguments, _layers(arguments), scene),
        "denoise": arguments.denoise,
        "noise": arguments.noise,
        "checkpoint": None if arguments.watch else _checkpoint(arguments),
        "resume": arguments.resume,
        "allow_mixed": arguments.allow_mixed,
        "device": _devices(arguments),
        "split": arguments.split,
        "numerics": arguments.stats is not None,
        "strict": arguments.strict,
        "part": arguments.part,
        "samples": arguments.samples,
        "neighbours": getattr(arguments, "neighbours", None),  # of a frame of a sequence
    }


def _render(
    arguments: argparse.Namespace, scene: "Scene", should_stop: Callable[[], bool] | None
) -> tuple["Image", NumericError | None, bool]:
    """Return the picture, why a strict render fails all the same, and whether it was to be ended, though too late.

    Ctrl-C ends it unless something else does.
    """
    from rptcam_cl.api import render
    from rptcam_cl.imaging import Image

    with contextlib.ExitStack() as stack:
        should_stop = should_stop or stack.enter_context(stop_on_interrupt()).is_set
        show = None if arguments.quiet else stack.enter_context(progress_on_stderr(arguments.time))
        if arguments.preview is not None:
            show = previewing(arguments.preview, arguments.outputs, show)
        try:
            image = render(scene, **_options(arguments, scene), on_progress=show, should_stop=should_stop)
        except NumericError as failure:
            assert isinstance(failure.image, Image)
            return failure.image, failure, should_stop()
    return image, None, should_stop()


def _run(arguments: argparse.Namespace) -> int:
    if not arguments.watch:
        return _picture(arguments)
    if arguments.plan:
        raise InputError("--plan: renders nothing that could be watched (allowed: without --watch)")
    if arguments.resume:
        raise InputError("--watch: every picture begins anew (allowed: without --resume)")
    with stop_on_interrupt() as stop:
        render_again(arguments.scene, stop, lambda should_stop: _picture(arguments, should_stop))
    return 0


def _picture(arguments: argparse.Namespace, should_stop: Callable[[], bool] | None = None) -> int:
    """Load the scene, render it, write the outputs and return the exit code; interrupted, a watched one writes none."""
    ended_well = _open_early(arguments)
    from rptcam_cl.api import load_scene

    scene = load_scene(arguments.scene, arguments.overrides, missing=arguments.missing)
    if arguments.frames is not None:
        frames.check_options(arguments)
    elif arguments.video is not None:
        raise InputError("--video: is of a sequence (allowed: with --frames)")
    elif many := [path for path in (*arguments.outputs, *arguments.raws) if "##" in path.name]:
        raise InputError(f"{many[0]}: #### stands for the number of a frame (allowed: with --frames, as --frames 1-24)")
    spread = cluster.requested(arguments)
    _check_outputs(arguments, scene)
    print_warnings(scene.warnings)
    if spread and arguments.frames is None:
        return _on_cluster(arguments, scene)
    if arguments.plan:
        from rptcam_cl.api import RenderSettings

        return plan.print_plan(scene, RenderSettings(**_options(arguments, scene)))
    if arguments.frames is not None:
        return frames.render_frames(arguments, scene, _applied, _wanted, lambda todo: _frames(arguments, todo, spread))
    code = _one(arguments, scene, should_stop)
    if code == 0:
        ended_well()
    return code


def _open_early(arguments: argparse.Namespace) -> Callable[[], None]:
    """Open the device of a single picture, where it is one; return what is to be called when that was rendered."""
    from rptcam_cl.device import means_one, open_early

    device = _devices(arguments)
    elsewhere = arguments.plan or arguments.frames is not None or cluster.requested(arguments)
    if elsewhere or isinstance(device, list) or not means_one(device, arguments.split):
        return lambda: None
    return open_early(device, str(arguments.scene.absolute()), arguments.overrides, arguments.layers)


def _on_cluster(arguments: argparse.Namespace, scene: "Scene") -> int:
    """Render a picture on a cluster, write it, and return the exit code."""
    folder = cluster.folder_of(arguments)
    if folder.is_dir() and not arguments.resume and not arguments.quiet:
        print(f"note: {folder} holds parts of an earlier render; --resume would go on from it", file=sys.stderr)
    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(stop_on_interrupt())
        show = None if arguments.quiet else stack.enter_context(progress_on_stderr())
        try:
            image = cluster.render(arguments, scene, _layers(arguments), show, stop.is_set)
        except InterruptedError as ended:
            print(f"interrupted: {ended}; --resume goes on from them", file=sys.stderr)
            return INTERRUPTED
    save(image, arguments)
    cluster.remove(folder)
    if not arguments.quiet:
        print(cluster.account(image), file=sys.stderr)
        names = ", ".join(map(str, [*arguments.outputs, *arguments.raws]))
        print(f"wrote {names}: {image.width} x {image.height}, {image.stats['spp']} spp", file=sys.stderr)
    return 0


def _applied(arguments: argparse.Namespace, scene: "Scene") -> "Scene":
    """The scene with all options applied."""
    from rptcam_cl.api import RenderSettings

    return RenderSettings(**_options(arguments, scene)).applied_to(scene)


def _wanted(arguments: argparse.Namespace, scene: "Scene") -> dict[str, Any]:
    """What the files of a finished frame say: all that changes it, and its samples where they are known."""
    applied = _applied(arguments, scene)
    found: dict[str, Any] = {"version": __version__, "picture_hash": applied.picture_hash(), "interrupted": None}
    if arguments.time is None and applied.render.noise is None:
        found["spp"] = applied.render.most_spp
    return found | frames.layers_said(arguments, applied)


def _frames(arguments: argparse.Namespace, todo: Iterable[frames.Frame], spread: bool) -> int:
    """Render frames, here or on a cluster, and return the exit code."""
    if spread:
        return cluster.render_frames(arguments, todo, _layers(arguments), save)
    return frames.one_by_one(todo, _frame)


def _frame(frame: frames.Frame) -> int:
    """Render one frame of a sequence; its state goes with its end."""
    arguments = frame.arguments
    checkpoint = _checkpoint(arguments)
    arguments.resume = arguments.resume and checkpoint.exists()
    code = _one(arguments, frame.scene, None, frame.metadata)
    if code == 0 and arguments.resume:
        checkpoint.unlink(missing_ok=True)
    return code


def _one(
    arguments: argparse.Namespace,
    scene: "Scene",
    should_stop: Callable[[], bool] | None,
    metadata: dict[str, Any] | None = None,
) -> int:
    """Render a picture, write it with further metadata, and return the exit code."""
    checkpoint = _checkpoint(arguments)
    if checkpoint.exists() and not arguments.resume and not arguments.watch and not arguments.quiet:
        print(f"note: {checkpoint} holds an earlier render; --resume would go on from it", file=sys.stderr)
    image, failure, interrupted = _render(arguments, scene, should_stop)
    if metadata is not None:
        arguments.same.add(f"frame {metadata['frame']}", image.metadata["made_by"])
        image.metadata.update(metadata)
    if arguments.watch and image.stats["interrupted"]:
        return INTERRUPTED
    if not parts.requested(arguments):
        save(truth.without_layers(arguments, image, _layers(arguments), scene), arguments)
        truth.save(arguments, image)
    elif image.stats.get("checkpoint") is None:
        raise StateError(f"{checkpoint}: could not be written")
    print_warnings(summary.blocked_warning(image))
    print_warnings(f"autofocus: {line}" for line in image.metadata.get("autofocus", {}).get("warnings", ()))
    if not arguments.quiet:
        if "diffraction" in image.metadata:
            print(f"diffraction: {image.metadata['diffraction']['says']}", file=sys.stderr)
        if "ghosts" in image.metadata:
            print(f"ghosts: {image.metadata['ghosts']['says']}", file=sys.stderr)
        if lamps := image.metadata.get("lamps_aimed_at"):
            print(f"bokeh: camera rays aim at {lamps} lamp{'s' * (lamps > 1)} out of focus", file=sys.stderr)
        for line in image.metadata.get("accuracy", {}).get("says", ()):
            print(f"accuracy: {line}", file=sys.stderr)
        if shared := summary.shared(image.stats):
            print(shared, file=sys.stderr)
        print(summary.summary(image, [*arguments.outputs, *arguments.raws]), file=sys.stderr)
    if image.stats.get("interrupted"):
        more = "; --resume goes on from it" if image.stats.get("checkpoint") else ""
        what = "the part" if parts.requested(arguments) else "the picture"
        print(f"interrupted: {what} holds what was rendered so far{more}", file=sys.stderr)
    if failure is not None:
        raise failure
    return INTERRUPTED if interrupted or image.stats.get("interrupted") else 0
