"""Many pictures: ``rptcam render --frames``, a sequence; ``--watch``, again whenever a file changes; renders on a
cluster; ``rptcam sweep`` and ``dataset``."""

import argparse
import contextlib
import copy
import functools
import json
import math
import re
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import OF_A_CLUSTER, RenderOptions, add_options, check_together, digits, number, number_range
from rptcam_cl.cli import output
from rptcam_cl.core import __version__
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.files import LAYER_SUFFIXES, file_state, listed, name_errors, named_files
from rptcam_cl.core.remember import OneMaker, made_by

if TYPE_CHECKING:
    from rptcam_cl.imaging.image import Image
    from rptcam_cl.scene.exposure import FrameSequence
    from rptcam_cl.scene.scene import Scene


# ``rptcam render --frames``: a sequence of pictures, each the one that its frame gives alone.

PLACE = re.compile(r"#+")


def sequence_of(scene: "Scene") -> "FrameSequence":
    """The sequence of a scene; by default one in which nothing but the time changes."""
    from rptcam_cl.scene.exposure import FrameSequence

    return scene.sequence or FrameSequence()


def _scene_of_frame(scene: "Scene", frame: int) -> "Scene":
    """The scene of a frame that stands alone."""
    from rptcam_cl.scene.changes import set_keys

    return set_keys(scene, sequence_of(scene).changes(scene.shutter.open_s, frame))


def _frame_scenes(arguments: argparse.Namespace, scene: "Scene") -> list[tuple[int, "Scene"]]:
    """The scene of each frame, checked before any is rendered."""
    from rptcam_cl.scene.changes import at_rest

    scenes = []
    for frame in arguments.frames:
        with name_errors(f"frame {frame}"):
            still = _scene_of_frame(scene, frame)
            at_rest(still)  # keys of the shutter as well
            scenes.append((frame, still))
    return scenes


def _track_frames(
    arguments: argparse.Namespace, scene: "Scene"
) -> Callable[[int], tuple["Scene", dict[str, Any]]] | None:
    """A function of a frame with focus and exposure that follow from those before; None where each stands alone."""
    from rptcam_cl.studies.focus.servo import FrameTracker, needs_tracking

    if not needs_tracking(scene):
        return None
    from rptcam_cl.device.session import open_sessions

    settings = RenderOptions(seed=arguments.seed, size=arguments.size, crop=arguments.crop)
    return FrameTracker(settings.apply_to(scene), lambda: open_sessions(output.device_of(arguments))[0][0]).frame


def _neighbours_of(
    arguments: argparse.Namespace, scene: "Scene", frame: int, frame_of: Callable[[int], "Scene"]
) -> "tuple[Scene | None, Scene] | None":
    """The scenes of the frames before and after, where layers lead there; there is none before frame 1."""
    layers = scene.render.layers if arguments.layers is None else arguments.layers
    if not {"flow_forward", "flow_backward"} & set(layers):
        return None
    return frame_of(frame - 1) if frame > 1 else None, frame_of(frame + 1)


def check_frame_options(arguments: argparse.Namespace) -> None:
    """Raise `InputError` for options of a single picture, and outputs that would overwrite one another."""
    check_together(arguments, "frames", "--frames")
    for path in output.files_to_write(arguments):
        if not PLACE.search(path.name):
            raise InputError(f"{path}: every frame would overwrite it (allowed: a name with ####, as out.####.exr)")

    if arguments.video is not None:
        from rptcam_cl.imaging.image import check_video

        check_video(arguments.video, [arguments.scene])
        if _film(arguments) is None:
            raise InputError(
                f"--video: is made of the films (allowed: with -o of a name that ends in {listed(LAYER_SUFFIXES)})"
            )


def _film(arguments: argparse.Namespace) -> Path | None:
    """The output that holds the film."""
    from rptcam_cl.imaging.writers import holds_layers

    return next(filter(holds_layers, arguments.outputs), None)


def write_video_of(arguments: argparse.Namespace, scene: "Scene") -> None:
    """Write the developed films of all frames as a video."""
    from rptcam_cl.imaging.image import develop, write_video

    film = _film(arguments)
    assert film is not None
    images = (develop(_name_of_frame(film, frame), folders=scene.folders) for frame in arguments.frames)
    count = write_video(arguments.video, images, sequence_of(scene).frames_per_second)
    if not arguments.quiet:
        print(f"wrote {arguments.video}: {count} frames", file=sys.stderr)


def _arguments_of_frame(arguments: argparse.Namespace, frame: int) -> argparse.Namespace:
    """The arguments of one frame: its names of files."""
    own = copy.copy(arguments)
    own.outputs = [_name_of_frame(path, frame) for path in arguments.outputs]
    own.raws = [_name_of_frame(path, frame) for path in arguments.raws]
    return own


def _name_of_frame(path: Path, frame: int) -> Path:
    return path.with_name(PLACE.sub(lambda match: f"{frame:0{len(match[0])}d}", path.name))


def _metadata_of(scene: "Scene", frame: int) -> dict[str, Any]:
    """Metadata of a frame."""
    sequence = sequence_of(scene)
    return {
        "frame": frame, "timecode": sequence.timecode(frame), "frames_per_second": sequence.frames_per_second,
    }  # fmt: skip


def _layer_metadata(arguments: argparse.Namespace, scene: "Scene") -> dict[str, Any]:
    """Metadata of the layers of a frame: their names, samples, and to which scenes flow leads.

    Nothing where there are none.

    Parameters
    ----------
    scene
        That of the frame, with all options applied.
    """
    if not scene.render.layers:
        return {}
    metadata: dict[str, Any] = {"layers": list(scene.render.layers), "layers_spp": scene.render.layers_spp}
    if arguments.neighbours is not None:
        metadata["flow_to"] = [None if other is None else other.picture_hash() for other in arguments.neighbours]
    return metadata


def is_finished(arguments: argparse.Namespace, wanted: Mapping[str, Any]) -> bool:
    """Whether all files of a frame are there and say what is wanted; None: what they must not say."""
    if not all(path.is_file() for path in output.files_to_write(arguments)):
        return False
    known = [metadata for path in arguments.outputs if (metadata := _metadata(path)) is not None]
    return bool(known) and all(
        ("denoised" in metadata) == arguments.denoise and all(_has_value(metadata, *each) for each in wanted.items())
        for metadata in known
    )


def _has_value(metadata: Mapping[str, Any], name: str, value: Any) -> bool:
    """Whether metadata say this of a name, also where the format keeps texts alone."""
    known = metadata.get(name)
    return bool((known if isinstance(value, str) else _value(known)) == value)


def _value(known: Any) -> Any:
    """The value of metadata, also where the format keeps texts alone."""
    if isinstance(known, str):
        with contextlib.suppress(ValueError):
            return json.loads(known)
    return known


def _metadata(path: Path) -> dict[str, Any] | None:
    """The metadata of a picture; None for formats that keep none for us to read, nothing of a damaged file."""
    from rptcam_cl.imaging.image import read_film
    from rptcam_cl.imaging.writers import holds_layers

    try:
        if holds_layers(path):
            return read_film(path).metadata
        if path.suffix.lower() == ".png":
            from PIL import Image

            with Image.open(path) as picture:
                picture.load()
                return dict(getattr(picture, "text", {}))
    except (RptcamError, OSError, ValueError):
        return {}
    return None


Frame = tuple[argparse.Namespace, "Scene", dict[str, Any]]
"""A frame to render: the arguments with its names of files, its scene, and metadata for its files, with its number."""


def _expected_metadata(arguments: argparse.Namespace, applied: "Scene") -> dict[str, Any]:
    """Metadata of a finished frame: all that changes it, and its samples where they are known."""
    expected: dict[str, Any] = {"version": __version__, "picture_hash": applied.picture_hash(), "interrupted": None}
    if arguments.seconds is None and applied.render.noise is None:
        expected["spp"] = applied.render.most_spp
    return expected | _layer_metadata(arguments, applied)


def missing_frames(arguments: argparse.Namespace, scene: "Scene") -> "Iterator[Frame]":
    """Yield the frames that are not there yet; all are checked before the first."""
    track, same = _track_frames(arguments, scene), OneMaker(arguments.allow_mixed)
    # Frames that follow one another are not found again
    at = lru_cache(maxsize=3)(track or (lambda number: (_scene_of_frame(scene, number), {})))
    for frame, alone in _frame_scenes(arguments, scene):
        own = _arguments_of_frame(arguments, frame)
        own.same = same
        still, described = (alone, {}) if track is None else at(frame)
        own.neighbours = _neighbours_of(arguments, scene, frame, lambda other: at(other)[0])
        applied = output.apply_options(own, still)
        if not (arguments.resume and is_finished(own, _expected_metadata(own, applied))):
            metadata = _metadata_of(scene, frame) | described | _layer_metadata(own, applied)
            if same.makers:  # whether what is kept is of this code, before any work; the driver is known after it
                same.add("this program", made_by([same.makers[0]["driver"]]))
            yield own, still, metadata
            continue
        for path in own.outputs:
            if (known := _metadata(path)) is not None:
                same.add(str(path), _value(known.get("made_by")))
        if not arguments.quiet:
            print(f"kept {output.names_of(own.outputs)}", file=sys.stderr)


# ``rptcam render --watch``: a picture is rendered again whenever a file that it comes from has changed.

INTERVAL_S = 0.2  # between two times that files are compared


class Files:
    """Files as they were, to be compared with what they are.

    Parameters
    ----------
    first
        A file that counts from the beginning.
    more
        Grows as others are named; each counts from the first comparison on.
    """

    def __init__(self, first: Path, more: Iterable[Path]) -> None:
        self._more = more
        self._known = {first: file_state(first)}
        self._compared = time.monotonic()
        self._changed = False

    def changed(self) -> bool:
        """Whether one has changed, by comparing them a few times a second at most."""
        if not self._changed and time.monotonic() - self._compared >= INTERVAL_S:
            self._compared = time.monotonic()
            for path in tuple(self._more):
                self._known.setdefault(path, file_state(path))
            self._changed = any(file_state(path) != state for path, state in self._known.items())
        return self._changed

    def wait_for_rest(self) -> None:
        """Wait until they stay the same: whoever writes them has come to the end."""
        last = None
        while last != (last := {path: file_state(path) for path in self._known}):
            time.sleep(INTERVAL_S)


def render_again(scene: Path, stop: threading.Event, picture: Callable[[Callable[[], bool]], object]) -> None:
    """Make a picture, and again whenever files change, until ``stop`` is set; errors are printed, and waited out.

    Parameters
    ----------
    scene
        The scene file.
    picture
        Makes the picture; it asks the function that it is given whether to give up.
    """
    while not stop.is_set():
        with named_files() as named:
            files = Files(scene, named)
            try:
                picture(lambda files=files: stop.is_set() or files.changed())  # type: ignore[misc]
            except RptcamError as error:
                if not stop.is_set():  # else a compiler, whose files Ctrl-C takes away
                    print(f"error: {error}", file=sys.stderr)
            while not (stop.is_set() or files.changed()):
                stop.wait(INTERVAL_S)
        if not stop.is_set():
            files.wait_for_rest()


# Renders on a cluster.

FOLDER = ".parts"  # in place of the suffix of the first output


def render_by_cluster(arguments: argparse.Namespace, scene: "Scene") -> int:
    """Render a picture on a cluster, write it, and return the exit code."""
    from rptcam_cl.batch.cluster_run import PartsFolder, render_on_cluster

    folder = arguments.outputs[0].with_suffix(FOLDER)
    if folder.is_dir() and not arguments.resume and not arguments.quiet:
        print(f"note: {folder} holds parts of an earlier render; --resume would go on from it", file=sys.stderr)
    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(output.stop_on_interrupt())
        show = None if arguments.quiet else stack.enter_context(output.progress_on_stderr())
        try:
            image = render_on_cluster(
                scene, **output.cluster_keywords(arguments), **_scene_keywords(arguments), folder=folder,
                resume=arguments.resume, on_progress=show, should_stop=stop.is_set,
            )  # fmt: skip
        except InterruptedError as ended:
            print(f"interrupted: {ended}; --resume goes on from them", file=sys.stderr)
            return output.INTERRUPTED
    output.save(image, arguments.outputs, arguments.raws)
    PartsFolder(folder).clear()
    if not arguments.quiet:
        print(_cluster_account(image), file=sys.stderr)
        names = output.names_of(output.files_to_write(arguments))
        print(f"wrote {names}: {image.width} x {image.height}, {image.stats['spp']} spp", file=sys.stderr)
    return 0


def render_frames_by_cluster(arguments: argparse.Namespace, missing: "Iterable[Frame]") -> int:
    """Render frames on a cluster, each by one worker; save them as they come, and return the exit code."""
    from rptcam_cl.batch.cluster_run import render_scenes_on_cluster

    todo = {metadata["frame"]: (own, scene, metadata) for own, scene, metadata in missing}
    if any(own.neighbours is not None for own, _, _ in todo.values()):
        raise InputError("--cluster: flow leads from frame to frame, which workers do not have (allowed: other layers)")
    with output.stop_on_interrupt() as stop:
        images = render_scenes_on_cluster(
            {number: scene for number, (_, scene, _) in todo.items()}, **output.cluster_keywords(arguments),
            settings=_scene_keywords(arguments), should_stop=stop.is_set,
        )  # fmt: skip
        try:
            for number, image in images:
                own, _, metadata = todo[number]
                own.same.add(f"frame {number}", image.metadata["made_by"])
                image.metadata.update(metadata)
                output.save(image, own.outputs, own.raws)
                if not arguments.quiet:
                    print(
                        f"wrote {output.names_of(output.files_to_write(own))}: {_cluster_account(image)}",
                        file=sys.stderr,
                    )
        except InterruptedError as ended:
            print(f"interrupted: {ended}; --resume goes on with the rest", file=sys.stderr)
            return output.INTERRUPTED
    return 0


def _scene_keywords(arguments: argparse.Namespace) -> dict[str, Any]:
    """The keyword arguments that replace keys of the scene."""
    return {name: getattr(arguments, name) for name in OF_A_CLUSTER} | {"layers": output.layers_of_outputs(arguments)}


def _cluster_account(image: "Image") -> str:
    """Which workers have rendered how much, as people read it."""
    cluster = image.stats["cluster"]
    rows = cluster["workers"].values()
    devices = sorted({row["device"] for row in rows})
    line = f"cluster: {cluster['parts']} parts by {len(rows)} worker{'s' * (len(rows) != 1)} on {', '.join(devices)}"
    return line + ("; bits of different devices may differ in the last place" if len(devices) > 1 else "")


# ``rptcam sweep``: a grid of pictures over values of any keys, with a contact sheet and a table.


def add_sweep(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    output.add_scene(parser)
    parser.add_argument(
        "--over", action="append", required=True, metavar="key.path=a,b,...", dest="keys",
        help="values of a key of the scene file, as camera.f_number=2,4,8 or 2,2.8,…,22; may be repeated, the last"
        " varies first",
    )  # fmt: skip
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FOLDER", help="folder to write to")
    add_options(parser, "spp", "size", "seed")
    parser.add_argument(
        "--mtf", type=output.point, metavar="x,y",
        help="measure MTF50 of the edge at this point, in fractions of the picture from the left and the top",
    )  # fmt: skip
    output.add_device(parser)
    add_options(parser, "cluster", "workers", "tls", "overrides", "allow_mixed", "quiet")


def _over(texts: list[str]) -> dict[str, list[Any]]:
    """Values by key of ``key.path=a,b,c``, each read as YAML."""
    from rptcam_cl.core.strict_yaml import read_yaml

    values_of: dict[str, list[Any]] = {}
    for text in texts:
        key, _, listed = text.partition("=")
        if not key or not listed.strip():
            raise InputError(f"--over {text}: is not of the form key.path=a,b,... (for instance camera.f_number=2,4,8)")
        if key in values_of:
            raise InputError(f"--over {text}: {key} twice (allowed: each key once)")
        values = read_yaml(f"[{listed}]", name=f"--over {text}").data
        values_of[key] = expand_ellipsis(key, values, f"--over {text}")
    return values_of


def run_sweep(arguments: argparse.Namespace) -> int:
    """Render every combination of values, and write films, a contact sheet and a table. What is there already is
    kept.
    """
    from rptcam_cl.api.combined import sweep
    from rptcam_cl.scene.changes import set_keys

    over = _over(arguments.keys)
    scene = output.loaded_scene(arguments)
    rows, said = [], set(scene.warnings)
    with output.stop_on_interrupt(None if arguments.cluster or arguments.workers else output.ENDS_LATER) as stop:
        pictures = None
        if output.check_cluster_arguments(arguments):
            from rptcam_cl.batch.cluster_run import render_scenes_on_cluster

            pictures = functools.partial(
                render_scenes_on_cluster, should_stop=stop.is_set, **output.cluster_keywords(arguments)
            )
        entries = sweep(
            scene, over, arguments.output, spp=arguments.spp, size=arguments.size, seed=arguments.seed,
            mtf_at=arguments.mtf, device=arguments.device, pictures=pictures, allow_mixed=arguments.allow_mixed,
        )  # fmt: skip
        try:
            for entry in entries:
                rows.append([*entry.values.values(), *entry.measures.values()])
                doubts = [line for line in set_keys(scene, entry.values).lens_doubts if line not in said]
                output.print_warnings(doubts)
                said.update(doubts)
                if not arguments.quiet:
                    print(f"{entry.label}: {'kept' if entry.kept else 'rendered'}", file=sys.stderr)
                if stop.is_set():
                    raise InterruptedError
        except InterruptedError:
            print("interrupted: the same command goes on with the rest", file=sys.stderr)
            return output.INTERRUPTED
    output.print_table([*over, *entry.measures], rows)
    return 0


# ``rptcam stack``: one picture that is sharp throughout, of many that are focused at different distances.


def add_stack(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    output.add_scene(parser)
    for name, text in (("--near-m", "nearest"), ("--far-m", "farthest")):
        parser.add_argument(name, type=output.positive, metavar="D", help=f"{text} distance of focus [m]")
    parser.add_argument(
        "--films", nargs="+", type=Path, metavar="FILM",
        help="films of the scene that are rendered already, in place of --near-m and --far-m; by their own focus",
    )  # fmt: skip
    parser.add_argument("--steps", type=_count, metavar="N", help="pictures to take (default: as many as it needs)")
    parser.add_argument(
        "-o", "--output", action="append", required=True, type=Path, metavar="OUT", dest="outputs",
        help=f"picture to write, as of render; {listed(LAYER_SUFFIXES)} have the depth map as layer; may be repeated",
    )  # fmt: skip
    add_options(parser, "spp", "size", "seed")
    output.add_device(parser)
    add_options(parser, "overrides", "quiet")


def run_stack(arguments: argparse.Namespace) -> int:
    """Render a scene focused at many distances, and make one sharp picture and a depth map of them."""
    from rptcam_cl.api.combined import focus_stack, stack_frames
    from rptcam_cl.imaging.writers import check_output

    ends, films = (arguments.near_m, arguments.far_m), arguments.films
    if (None in ends) if films is None else (ends != (None, None)):
        raise InputError("rptcam stack: takes --near-m and --far-m, or --films in their place")
    for path in arguments.outputs:
        check_output(path, [arguments.scene, *(films or ())])
    scene = output.loaded_scene(arguments)

    def say(number: int, count: int, distance_m: float) -> None:
        if not arguments.quiet:
            print(f"picture {number} of {count}: focused at {distance_m:.4g} m", file=sys.stderr)

    if films is not None:
        image = stack_frames(scene, films)
    else:
        image = focus_stack(
            scene, *ends, steps=arguments.steps, spp=arguments.spp, size=arguments.size, seed=arguments.seed,
            device=arguments.device, on_picture=say,
        )  # fmt: skip
    about = image.metadata["focus_stack"]
    if about["pictures"] < about.get("needed", 0):
        output.print_warnings(
            [f"what lies between the pictures is not sharp; {about['needed']} would leave nothing out"]
        )
    if about["known_share"] < _POOR:
        output.print_warnings([
            f"only {about['known_share']:.0%} of the picture has the texture that tells its depth; the rest is taken"
            " from around it"
        ])  # fmt: skip
    output.save(image, arguments.outputs)
    if not arguments.quiet:
        print(f"wrote {output.names_of(arguments.outputs)}: {image.width} x {image.height}", file=sys.stderr)
    return 0


# ``rptcam halves``: pictures through parts of the opening.

_OF_HALVES = ("left", "right", "phase_pixels", "screen")


def add_halves(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    output.add_scene(parser)
    for name, text in (
        ("--left", "picture through the left half of the stop"),
        ("--right", "picture through the right half"),
        ("--phase-pixels", "picture of a sensor with masked pixels: every 4th of every 8th row sees one half"),
        ("--screen", "focusing screen with a split image and microprisms"),
    ):
        parser.add_argument(name, type=Path, metavar="OUT", help=f"{text}; formats as of render -o")
    parser.add_argument("--split", choices=("x", "y"), default="x", help="y: the lower and the upper half")
    add_options(parser, "spp", "size", "seed")
    output.add_device(parser)
    add_options(parser, "overrides", "quiet")


def run_halves(arguments: argparse.Namespace) -> int:
    """Take the pictures that the two halves of the opening give: a dual-pixel pair, and what is made of such."""
    from rptcam_cl.api.combined import dual_pixels, focusing_screen, with_phase_pixels
    from rptcam_cl.imaging.writers import check_output

    outputs = {name: path for name in _OF_HALVES if (path := getattr(arguments, name)) is not None}
    if not outputs:
        raise InputError("rptcam halves: nothing to write (allowed: --left, --right, --phase-pixels, --screen)")
    output.check_different(list(outputs.values()), "rptcam halves")
    for path in outputs.values():
        check_output(path, [arguments.scene])
    scene = output.loaded_scene(arguments)
    given = {name: getattr(arguments, name) for name in ("spp", "size", "seed", "device")}
    images: dict[str, Any] = {}
    if outputs.keys() - {"screen"}:
        images["left"], images["right"] = dual_pixels(scene, arguments.split, **given)
        images["phase_pixels"] = with_phase_pixels(images["left"], images["right"])
    if "screen" in outputs:
        images["screen"] = focusing_screen(scene, **given)
    for name, path in outputs.items():
        output.save(images[name], [path])
    if not arguments.quiet:
        print(f"wrote {output.names_of(list(outputs.values()))}", file=sys.stderr)
    return 0


_POOR = 0.5  # of the picture that tells its depth, below which there is a warning

# Lists of values with an ellipsis: ``2,2.8,…,22`` goes on as it began, in stops for f-numbers, in equal steps else.

_ELLIPSES = ("…", "...")
MOST_VALUES = 10_000
_ON_THE_WAY = 1e-6  # of a step, by which the last value may miss it

# As engraved on lenses and shown by cameras: full, half and third stops.
F_NUMBERS = (
    (0.5, 0.7, 1, 1.4, 2, 2.8, 4, 5.6, 8, 11, 16, 22, 32, 45, 64, 90, 128),
    (1, 1.2, 1.4, 1.7, 2, 2.4, 2.8, 3.3, 4, 4.8, 5.6, 6.7, 8, 9.5, 11, 13, 16, 19, 22, 27, 32, 38, 45, 54, 64),
    (
        1, 1.1, 1.2, 1.4, 1.6, 1.8, 2, 2.2, 2.5, 2.8, 3.2, 3.5, 4, 4.5, 5, 5.6, 6.3, 7.1, 8, 9, 10, 11, 13, 14, 16, 18,
        20, 22, 25, 29, 32, 36, 40, 45, 51, 57, 64,
    ),
)  # fmt: skip


def expand_ellipsis(key: str, values: list[Any], where: str) -> list[Any]:
    """Put values in place of an ellipsis.

    Raises
    ------
    InputError
        When it does not stand between numbers that make a series.
    """
    places = [k for k, value in enumerate(values) if value in _ELLIPSES]
    if not places:
        return values
    place = places[0]
    before, after = values[:place], values[place + 1 :]
    if not (before and after and all(_is_number(value) for value in [*before, *after])):
        raise InputError(f"{where}: the ellipsis has to stand between numbers (as 2,2.8,…,22)")
    is_stops = key.rpartition(".")[2] == "f_number"
    middle = (_stops if is_stops else _steps)(before[-2:], after[0], where)
    return [*before, *middle, *after]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _stops(before: list[float], last: float, where: str) -> list[float]:
    """Return the f-numbers between the last one before an ellipsis and the one behind it, of a scale with all."""
    for scale in F_NUMBERS:
        if not all(value in scale for value in (*before, last)):
            continue
        first, end = scale.index(before[-1]), scale.index(last)
        step = 1 if first < end else -1
        if len(before) == 1 or scale.index(before[0]) + step == first:
            return list(scale[first + step : end : step])
    raise InputError(
        f"{where}: is no series of full, half or third stops (got {', '.join(map(str, before))}, …, {last};"
        " allowed: as 2,2.8,…,22, 2,2.4,…,8 or 2,2.2,…,4)"
    )


def _steps(before: list[float], last: float, where: str) -> list[float]:
    """Return the numbers between, in steps of the two before the ellipsis."""
    step = before[-1] - before[0]
    count = (last - before[-1]) / step if step else 0.0
    if len(before) < 2 or not 1 - _ON_THE_WAY <= count <= MOST_VALUES or abs(count - round(count)) > _ON_THE_WAY:
        raise InputError(
            f"{where}: is no series of equal steps (got {', '.join(map(str, before))}, …, {last};"
            " allowed: as 1,1.5,…,4)"
        )
    whole = all(isinstance(value, int) for value in (*before, last))
    values = [before[-1] + k * (last - before[-1]) / round(count) for k in range(1, round(count))]
    return [round(value) for value in values] if whole else [float(f"{value:.12g}") for value in values]


# ``rptcam dataset``: many pictures of a scene whose keys are drawn from distributions, with their exact cameras.


def add_dataset(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("specification", type=Path, metavar="SPEC", help="specification (YAML); see docs/datasets.md")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FOLDER", help="folder to write to")
    parser.add_argument("-n", type=_count, metavar="N", dest="count", help="frames, in place of the specification's")
    parser.add_argument(
        "--frames", type=_frames, metavar="FIRST[-LAST[:STEP]]",
        help="make these frames alone, which count from 0, as 517 or 0-99",
    )  # fmt: skip
    parser.add_argument(
        "--shard", type=_count, metavar="N", help="write shards of N frames, TAR files as WebDataset reads them"
    )
    output.add_device(parser)
    add_options(parser, "overrides", "allow_mixed", "quiet")


_count = number(digits, 1, 999_999_999, "a whole number, 1 or more")
_frames = number_range(9, 0, "FIRST[-LAST[:STEP]], as 517 or 0-99")  # of a dataset


def run_dataset(arguments: argparse.Namespace) -> int:
    """Render the frames of a dataset, each with its exact camera. Frames that are there are kept."""
    from rptcam_cl.batch.dataset import dataset, read_specification

    wanted = read_specification(arguments.specification, arguments.overrides, frames=arguments.count)
    output.print_warnings(wanted.scene.warnings)
    frames = dataset(
        wanted, arguments.output, only=arguments.frames, shard=arguments.shard, device=arguments.device,
        allow_mixed=arguments.allow_mixed,
    )  # fmt: skip
    kept = rendered = 0
    with output.stop_on_interrupt(output.ENDS_LATER) as stop:
        for frame in frames:
            kept, rendered = kept + frame.kept, rendered + (not frame.kept)
            if not arguments.quiet and not frame.kept:
                drawn = ", ".join(f"{key}={_format_value(value)}" for key, value in frame.values.items())
                print(f"frame {frame.index}: {drawn}", file=sys.stderr)
            if stop.is_set():
                print("interrupted: the same command goes on with the rest", file=sys.stderr)
                return output.INTERRUPTED
    if not arguments.quiet:
        print(f"wrote {arguments.output}: {rendered} frames rendered, {kept} kept", file=sys.stderr)
    return 0


def _format_value(value: object) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_format_value, value)) + "]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
