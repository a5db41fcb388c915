"""``rptcam render``: a scene file becomes pictures."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl._version import __version__
from rptcam_cl.cli import output as summary
from rptcam_cl.cli.cluster import (
    add_cluster_options,
    cluster_account,
    cluster_requested,
    parts_folder_of,
    remove_parts,
    render_by_cluster,
    render_frames_by_cluster,
)
from rptcam_cl.cli.frames import (
    Frame,
    add_frames_option,
    check_frame_options,
    layers_said,
    one_by_one,
    render_again,
    render_frames,
)
from rptcam_cl.cli.output import (
    INTERRUPTED,
    as_duration,
    as_json,
    print_warnings,
    progress_on_stderr,
    stop_on_interrupt,
)
from rptcam_cl.cli.parser import (
    Commands,
    add_allow_mixed,
    add_devices,
    add_missing,
    add_overrides,
    crop,
    duration,
    layers,
    part,
    sample_range,
    seed,
    share,
    size,
    spp,
)
from rptcam_cl.core.errors import InputError, NumericError, RptcamError, StateError

if TYPE_CHECKING:
    from rptcam_cl.api.job import RenderOptions
    from rptcam_cl.imaging.image import Image
    from rptcam_cl.rendering.account import Forecast
    from rptcam_cl.rendering.progressive import Progress
    from rptcam_cl.scene.scene import Scene


# The files of a picture: every one that can be written, and a place for the film where none can.


def save(image: Image, arguments: argparse.Namespace) -> None:
    """Write every output that can be written, then report the first that could not, and where the film is instead."""
    from rptcam_cl.core.files import replacing
    from rptcam_cl.imaging.image import FILM_SUFFIXES

    failures: list[Exception] = []

    def attempt(write: Callable[[], object]) -> bool:
        try:
            write()
        except Exception as error:  # whatever a library raises: the picture is not lost with it
            failures.append(error)
            return False
        return True

    def write_stats() -> None:
        with replacing(arguments.stats) as temporary:
            temporary.write_text(as_json(image.stats) + "\n", encoding="utf-8", errors="backslashreplace")

    # A list, and not a generator: all are attempted.
    films = [attempt(partial(image.save, path)) and path.suffix.lower() in FILM_SUFFIXES for path in arguments.outputs]
    for raw in arguments.raws:
        attempt(partial(_save_raw, image, raw))
    if arguments.stats is not None:
        attempt(write_stats)
    if not failures:
        return
    where = "" if any(films) else rescued(image)
    if isinstance(failures[0], RptcamError):
        raise type(failures[0])(f"{failures[0]}{where}")
    if where:
        print(f"note: the picture could not be written{where}", file=sys.stderr)
    raise failures[0]


def _save_raw(image: Image, path: Path) -> None:
    image.raw().save(path)


def rescued(image: Image) -> str:
    """Write the film of a picture that cannot go where it was to go to the first place that takes it; say where."""
    for folder in dict.fromkeys((tempfile.gettempdir(), os.path.expanduser("~"), os.getcwd())):  # noqa: PTH109, PTH111
        for suffix in (".exr", ".npz"):
            try:
                descriptor, name = tempfile.mkstemp(prefix="rptcam-", suffix=suffix, dir=folder)
                os.close(descriptor)
            except OSError:
                continue
            try:
                image.save(Path(name))
            except Exception:  # as above
                Path(name).unlink(missing_ok=True)
            else:
                return f" (the film is kept in {name}, for rptcam develop)"
    return " (and no place was found where the film could be kept)"


# ``rptcam render --preview``: the picture so far is written to the outputs while the render goes on.

Show = Callable[["Progress"], None]


def previewing(
    interval: float, outputs: Sequence[Path], show: Show | None, clock: Callable[[], float] = time.monotonic
) -> Show:
    """Return what takes reports of a render and writes the picture so far, each file whole or not at all.

    That one cannot be written ends no render.

    Parameters
    ----------
    interval
        Time between two pictures [s].
    outputs
        Where the finished picture goes too.
    show
        Gets every report as well.
    clock
        Returns the time [s].
    """
    last = clock()

    def write(progress: Progress) -> None:
        nonlocal last
        if show is not None:
            show(progress)
        if progress.image is None or clock() - last < interval:
            return
        image = progress.image()
        for output in outputs:
            try:
                image.save(output)
            except RptcamError as error:
                print(f"warning: the picture so far: {error}", file=sys.stderr)
        last = clock()

    return write


# Renders in parts: the options of ``rptcam render`` for one, and what goes with them.

# Options that need the whole film or its picture.
WHOLE_FILM = {"raws": "--raw", "stats": "--stats", "denoise": "--denoise", "noise": "--noise", "time": "--time"}
WHOLE_FILM |= {"watch": "--watch", "preview": "--preview"}


def add_part_options(parser: argparse.ArgumentParser) -> None:
    """Add which part of the film is rendered, for `rptcam merge`."""
    parser.add_argument(
        "--part", type=part, metavar="K/N",
        help="render part K of N parts of the tiles, to be merged; -o names a file that ends in .rpck",
    )  # fmt: skip
    parser.add_argument(
        "--samples", type=sample_range, metavar="FIRST:END",
        help="render these samples of each pixel alone, as 64:128, likewise",
    )  # fmt: skip


def parts_requested(arguments: argparse.Namespace) -> bool:
    """Whether a part is rendered in place of the whole."""
    return arguments.part is not None or arguments.samples is not None


def check_part_output(arguments: argparse.Namespace, inputs: Sequence[Path]) -> None:
    """Refuse what no part can be written to, and options that need the whole film.

    Raises
    ------
    InputError, StateError
    """
    from rptcam_cl.core.files import check_writable
    from rptcam_cl.rendering.checkpoint import SUFFIX

    option = "--part" if arguments.part is not None else "--samples"
    for name, words in WHOLE_FILM.items():
        if getattr(arguments, name):
            raise InputError(
                f"{words}: needs the whole film (allowed: without {option}; rptcam merge makes the picture)"
            )
    if arguments.samples is not None and arguments.spp is not None:
        raise InputError("--spp: --samples says where the samples end (allowed: one of the two)")
    outputs: list[Path] = arguments.outputs
    if len(outputs) != 1 or outputs[0].suffix != SUFFIX:
        got = ", ".join(map(str, outputs))
        raise InputError(f"-o: a part is one file (got {got}; allowed: a name that ends in {SUFFIX})")
    check_writable(outputs[0], inputs)


# ``rptcam render --plan``: memory, kernel launches and time of a render, without rendering it.


def add_plan_option(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    parser.add_argument(
        "--plan", action="store_true",
        help="print the memory, the kernel launches and the time that the render will take, and render nothing",
    )  # fmt: skip


def print_plan(scene: Scene, settings: RenderOptions) -> int:
    """Print what a render will take, and return the exit code."""
    from rptcam_cl.api.job import RenderJob

    begun = time.perf_counter()
    job = RenderJob.prepare(scene, settings)
    preparing = time.perf_counter() - begun
    found = job.forecast()
    if found is None:
        raise InputError("--plan: --time says how long it takes (allowed: without --time)")
    for line in forecast_lines(found, preparing):
        print(line)
    return 0


def forecast_lines(found: Forecast, preparing: float) -> list[str]:
    """The lines of a plan."""
    from rptcam_cl.rendering.scene_buffers import amount

    memory = [f"{amount(needs.total)} on device {device}" for device, needs in found.devices.items()]
    limit = "at most " if found.at_most else ""
    speed = found.samples / max(found.seconds, 1e-9) / 1e6
    return [
        f"samples: {limit}{found.samples:,}, {limit}{found.launches:,} kernel launches",
        f"memory:  {', '.join(memory)}; {amount(found.saved_bytes)} for its state on disk",
        f"time:    {limit}{as_duration(found.seconds)} of rendering at {speed:.3g} Msamples/s (measured for"
        f" {found.measured_seconds:.1f} s), after {as_duration(preparing)} of preparing",
    ]


# ``rptcam render --truth``: the files of ground truth beside the picture.

RAYS = ("ray_origin", "ray_direction")
# Options with which there is no whole picture at hand, or more than one.
OTHERS = {
    "part": "--part",
    "samples": "--samples",
    "frames": "--frames",
    "cluster": "--cluster",
    "workers": "--workers",
}


def add_truth_option(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    parser.add_argument(
        "--truth", type=Path, metavar="DIR",
        help="also write COCO annotations, masks of instances and classes, and the rays of all pixels into this folder",
    )  # fmt: skip


def check_truth(arguments: argparse.Namespace, scene: Scene) -> None:
    """Refuse, before anything is compiled, what could not be written at the end.

    Raises
    ------
    InputError, StateError
    """
    folder: Path | None = arguments.truth
    if folder is None:
        return
    from rptcam_cl.imaging.truth_files import MOST_INSTANCES

    for name, words in OTHERS.items():
        if getattr(arguments, name, None):
            raise InputError(f"--truth: is of a whole picture (allowed: without {words})")
    if len(scene.objects) >= MOST_INSTANCES:
        raise InputError(f"--truth: masks of 16 bits hold {MOST_INSTANCES} objects (got {len(scene.objects)})")
    there = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    if not there.is_dir():
        raise StateError(f"--truth: {there} is no folder (allowed: a folder, which is made if it is missing)")
    if not os.access(there, os.W_OK | os.X_OK):
        raise StateError(f"--truth: {there} cannot be written to")


def with_layers(arguments: argparse.Namespace, layers: Sequence[str] | None, scene: Scene) -> list[str] | None:
    """Return the layers to record: those of the outputs (None: the scene's), and what the files of truth need."""
    if arguments.truth is None:
        return None if layers is None else list(layers)
    from rptcam_cl.imaging.truth_files import LABELS

    return list(dict.fromkeys((*(scene.render.layers if layers is None else layers), *LABELS, *RAYS)))


def without_layers(arguments: argparse.Namespace, image: Image, layers: Sequence[str] | None, scene: Scene) -> Image:
    """Return the picture with the layers of the outputs alone."""
    if arguments.truth is None:
        return image
    kept = scene.render.layers if layers is None else layers
    return replace(image, layers={name: image.layers[name] for name in kept})


def save_truth(arguments: argparse.Namespace, image: Image) -> None:
    """Write the files of truth, of the first output's picture."""
    if arguments.truth is None:
        return
    files = image.save_truth(arguments.truth, arguments.outputs[0].name)
    if not arguments.quiet:
        print(f"wrote {', '.join(map(str, files))}", file=sys.stderr)


def add_render(commands: Commands) -> None:
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
    add_devices(parser)
    add_overrides(parser)
    add_missing(parser)
    add_part_options(parser)
    add_plan_option(parser)
    add_truth_option(parser)
    add_frames_option(parser)
    add_cluster_options(parser)
    parser.add_argument("--stats", type=Path, metavar="FILE.json", help="write statistics of the render")
    parser.add_argument(
        "--strict", action="store_true",
        help="fail, with exit code 5, when numbers cannot be trusted or autofocus failed; the picture is still written",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.add_argument(
        "--preview", type=duration, metavar="TIME",
        help="write the picture so far to the outputs now and then, as every 10s",
    )  # fmt: skip
    parser.add_argument(
        "--watch", action="store_true",
        help="render again whenever the scene file or a file that it names changes, until Ctrl-C",
    )  # fmt: skip
    parser.set_defaults(run=_run_render, parser=parser)


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
    parser.add_argument("--spp", type=spp, metavar="N", help="samples per pixel, in place of the scene's")
    parser.add_argument("--time", type=duration, metavar="TIME", help="stop after this rendering time, as 60s or 5min")
    parser.add_argument(
        "--noise", type=share, metavar="X",
        help="sample each tile of 8 x 8 pixels until its relative standard error is X, as 0.02 or 2%%",
    )  # fmt: skip
    parser.add_argument(
        "--resume", action="store_true",
        help="continue from OUT.rpck, which an interrupted render leaves, and keep it, so that samples can be added",
    )  # fmt: skip
    add_allow_mixed(parser)
    parser.add_argument("--seed", type=seed, metavar="N", help="seed of the random numbers")


def _add_picture(parser: argparse.ArgumentParser) -> None:
    """Add which part of the film is rendered, and what is recorded of it."""
    parser.add_argument("--size", type=size, metavar="WxH", help="resolution in pixels")
    parser.add_argument(
        "--crop", type=crop, metavar="x0,x1,y0,y1",
        help="render only this window, in fractions of the picture from the left and the top",
    )  # fmt: skip
    parser.add_argument(
        "--layers", type=layers, metavar="NAME,...",
        help="record these auxiliary layers in .exr and .npz outputs, as depth,normal; all for every one",
    )  # fmt: skip
    parser.add_argument(
        "--denoise", action="store_true", help="remove the remaining noise (biased); needs rptcam_cl[denoise]"
    )


def _inputs(path: Path, scene: Scene) -> list[Path]:
    """The files that a render reads: the scene file and the lens file, when the lens is one."""
    lens = scene.lens_source()
    return [path, lens] if isinstance(lens, Path) else [path]


def _check_outputs(arguments: argparse.Namespace, scene: Scene) -> None:
    """Refuse, before anything is compiled, what could not be written at the end."""
    from rptcam_cl.core.files import check_writable
    from rptcam_cl.imaging.formats import check_raw_output
    from rptcam_cl.imaging.writers import check_output, holds_layers

    taken = _inputs(arguments.scene, scene)
    if parts_requested(arguments):
        check_part_output(arguments, taken)
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
    check_truth(arguments, scene)
    if arguments.layers and not any(map(holds_layers, arguments.outputs)):
        raise InputError("--layers: no output can hold them (allowed: -o with a name that ends in .exr or .npz)")
    written = [*arguments.outputs, *arguments.raws]
    if len({output.resolve() for output in written}) < len(written):
        raise InputError("-o, --raw: the same file twice" if arguments.raws else "-o: the same file twice")


def _checkpoint(arguments: argparse.Namespace) -> Path:
    """Where the state of the render is kept: beside the first output."""
    from rptcam_cl.rendering.checkpoint import SUFFIX

    first: Path = arguments.outputs[0]
    return first.with_suffix(SUFFIX)


def _layers(arguments: argparse.Namespace) -> list[str] | None:
    """The layers to record: those requested, none where no output could hold the scene's, else the scene's."""
    from rptcam_cl.imaging.writers import holds_layers

    if arguments.layers is not None:
        return list(arguments.layers)
    if parts_requested(arguments):
        return None
    return None if any(map(holds_layers, arguments.outputs)) else []


def _devices(arguments: argparse.Namespace) -> str | list[str] | None:
    """The devices as `rptcam_cl.render` takes them."""
    given: list[str] | None = arguments.devices
    return given[0] if given is not None and len(given) == 1 else given


def _options(arguments: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """The keyword arguments of `rptcam_cl.render`."""
    return {
        "spp": arguments.spp,
        "seconds": arguments.time,
        "seed": arguments.seed,
        "size": arguments.size,
        "crop": arguments.crop,
        "layers": with_layers(arguments, _layers(arguments), scene),
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
    arguments: argparse.Namespace, scene: Scene, should_stop: Callable[[], bool] | None
) -> tuple[Image, NumericError | None, bool]:
    """Return the picture, why a strict render fails all the same, and whether it was to be ended, though too late.

    Ctrl-C ends it unless something else does.
    """
    from rptcam_cl.api.interface import render
    from rptcam_cl.imaging.image import Image

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


def _run_render(arguments: argparse.Namespace) -> int:
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
    from rptcam_cl.scene.load import load_scene

    scene = load_scene(arguments.scene, arguments.overrides, missing=arguments.missing)
    if arguments.frames is not None:
        check_frame_options(arguments)
    elif arguments.video is not None:
        raise InputError("--video: is of a sequence (allowed: with --frames)")
    elif many := [path for path in (*arguments.outputs, *arguments.raws) if "##" in path.name]:
        raise InputError(f"{many[0]}: #### stands for the number of a frame (allowed: with --frames, as --frames 1-24)")
    spread = cluster_requested(arguments)
    _check_outputs(arguments, scene)
    print_warnings(scene.warnings)
    if spread and arguments.frames is None:
        return _on_cluster(arguments, scene)
    if arguments.plan:
        from rptcam_cl.api.job import RenderOptions

        return print_plan(scene, RenderOptions(**_options(arguments, scene)))
    if arguments.frames is not None:
        return render_frames(arguments, scene, _applied, _wanted, lambda todo: _frames(arguments, todo, spread))
    code = _one(arguments, scene, should_stop)
    if code == 0:
        ended_well()
    return code


def _open_early(arguments: argparse.Namespace) -> Callable[[], None]:
    """Open the device of a single picture, where it is one; return what is to be called when that was rendered."""
    from rptcam_cl.device.session import means_one, open_early

    device = _devices(arguments)
    elsewhere = arguments.plan or arguments.frames is not None or cluster_requested(arguments)
    if elsewhere or isinstance(device, list) or not means_one(device, arguments.split):
        return lambda: None
    return open_early(device, str(arguments.scene.absolute()), arguments.overrides, arguments.layers)


def _on_cluster(arguments: argparse.Namespace, scene: Scene) -> int:
    """Render a picture on a cluster, write it, and return the exit code."""
    folder = parts_folder_of(arguments)
    if folder.is_dir() and not arguments.resume and not arguments.quiet:
        print(f"note: {folder} holds parts of an earlier render; --resume would go on from it", file=sys.stderr)
    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(stop_on_interrupt())
        show = None if arguments.quiet else stack.enter_context(progress_on_stderr())
        try:
            image = render_by_cluster(arguments, scene, _layers(arguments), show, stop.is_set)
        except InterruptedError as ended:
            print(f"interrupted: {ended}; --resume goes on from them", file=sys.stderr)
            return INTERRUPTED
    save(image, arguments)
    remove_parts(folder)
    if not arguments.quiet:
        print(cluster_account(image), file=sys.stderr)
        names = ", ".join(map(str, [*arguments.outputs, *arguments.raws]))
        print(f"wrote {names}: {image.width} x {image.height}, {image.stats['spp']} spp", file=sys.stderr)
    return 0


def _applied(arguments: argparse.Namespace, scene: Scene) -> Scene:
    """The scene with all options applied."""
    from rptcam_cl.api.job import RenderOptions

    return RenderOptions(**_options(arguments, scene)).applied_to(scene)


def _wanted(arguments: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """What the files of a finished frame say: all that changes it, and its samples where they are known."""
    applied = _applied(arguments, scene)
    found: dict[str, Any] = {"version": __version__, "picture_hash": applied.picture_hash(), "interrupted": None}
    if arguments.time is None and applied.render.noise is None:
        found["spp"] = applied.render.most_spp
    return found | layers_said(arguments, applied)


def _frames(arguments: argparse.Namespace, todo: Iterable[Frame], spread: bool) -> int:
    """Render frames, here or on a cluster, and return the exit code."""
    if spread:
        return render_frames_by_cluster(arguments, todo, _layers(arguments), save)
    return one_by_one(todo, _frame)


def _frame(frame: Frame) -> int:
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
    scene: Scene,
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
    if not parts_requested(arguments):
        save(without_layers(arguments, image, _layers(arguments), scene), arguments)
        save_truth(arguments, image)
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
        if shared := summary.shared_text(image.stats):
            print(shared, file=sys.stderr)
        print(summary.summary(image, [*arguments.outputs, *arguments.raws]), file=sys.stderr)
    if image.stats.get("interrupted"):
        more = "; --resume goes on from it" if image.stats.get("checkpoint") else ""
        what = "the part" if parts_requested(arguments) else "the picture"
        print(f"interrupted: {what} holds what was rendered so far{more}", file=sys.stderr)
    if failure is not None:
        raise failure
    return INTERRUPTED if interrupted or image.stats.get("interrupted") else 0
