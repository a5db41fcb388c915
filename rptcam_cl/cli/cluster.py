"""``rptcam sweep`` and ``dataset``, many pictures, and the options of renders on a cluster."""

import argparse
import contextlib
import functools
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import OF_A_CLUSTER, add_options, digits, number, number_range
from rptcam_cl.cli.frames import Frame
from rptcam_cl.cli.output import (
    ENDS_LATER,
    INTERRUPTED,
    print_table,
    print_warnings,
    progress_on_stderr,
    save,
    stop_on_interrupt,
)
from rptcam_cl.cli.parser import (
    add_device,
    check_cluster_arguments,
    cluster_keywords,
    files_to_write,
    layers_of_outputs,
    names_of,
    point,
)
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.imaging.image import Image
    from rptcam_cl.scene.scene import Scene


# Renders on a cluster.

FOLDER = ".parts"  # in place of the suffix of the first output


def render_by_cluster(arguments: argparse.Namespace, scene: "Scene") -> int:
    """Render a picture on a cluster, write it, and return the exit code."""
    from rptcam_cl.batch.cluster import PartsFolder
    from rptcam_cl.batch.cluster_run import render_on_cluster

    folder = arguments.outputs[0].with_suffix(FOLDER)
    if folder.is_dir() and not arguments.resume and not arguments.quiet:
        print(f"note: {folder} holds parts of an earlier render; --resume would go on from it", file=sys.stderr)
    with contextlib.ExitStack() as stack:
        stop = stack.enter_context(stop_on_interrupt())
        show = None if arguments.quiet else stack.enter_context(progress_on_stderr())
        try:
            image = render_on_cluster(
                scene, **cluster_keywords(arguments), **_scene_keywords(arguments), folder=folder,
                resume=arguments.resume, on_progress=show, should_stop=stop.is_set,
            )  # fmt: skip
        except InterruptedError as ended:
            print(f"interrupted: {ended}; --resume goes on from them", file=sys.stderr)
            return INTERRUPTED
    save(image, arguments)
    PartsFolder(folder).clear()
    if not arguments.quiet:
        print(cluster_account(image), file=sys.stderr)
        names = names_of(files_to_write(arguments))
        print(f"wrote {names}: {image.width} x {image.height}, {image.stats['spp']} spp", file=sys.stderr)
    return 0


def render_frames_by_cluster(arguments: argparse.Namespace, missing: "Iterable[Frame]") -> int:
    """Render frames on a cluster, each by one worker; save them as they come, and return the exit code."""
    from rptcam_cl.batch.cluster_run import render_scenes_on_cluster

    todo = {metadata["frame"]: (own, scene, metadata) for own, scene, metadata in missing}
    if any(own.neighbours is not None for own, _, _ in todo.values()):
        raise InputError("--cluster: flow leads from frame to frame, which workers do not have (allowed: other layers)")
    with stop_on_interrupt() as stop:
        images = render_scenes_on_cluster(
            {number: scene for number, (_, scene, _) in todo.items()}, **cluster_keywords(arguments),
            settings=_scene_keywords(arguments), should_stop=stop.is_set,
        )  # fmt: skip
        try:
            for number, image in images:
                own, _, metadata = todo[number]
                own.same.add(f"frame {number}", image.metadata["made_by"])
                image.metadata.update(metadata)
                save(image, own)
                if not arguments.quiet:
                    print(f"wrote {names_of(files_to_write(own))}: {cluster_account(image)}", file=sys.stderr)
        except InterruptedError as ended:
            print(f"interrupted: {ended}; --resume goes on with the rest", file=sys.stderr)
            return INTERRUPTED
    return 0


def _scene_keywords(arguments: argparse.Namespace) -> dict[str, Any]:
    """The keyword arguments that replace keys of the scene."""
    return {name: getattr(arguments, name) for name in OF_A_CLUSTER} | {"layers": layers_of_outputs(arguments)}


def cluster_account(image: "Image") -> str:
    """Which workers have rendered how much, as people read it."""
    cluster = image.stats["cluster"]
    rows = cluster["workers"].values()
    devices = sorted({row["device"] for row in rows})
    line = f"cluster: {cluster['parts']} parts by {len(rows)} worker{'s' * (len(rows) != 1)} on {', '.join(devices)}"
    return line + ("; bits of different devices may differ in the last place" if len(devices) > 1 else "")


# ``rptcam sweep``: a grid of pictures over values of any keys, with a contact sheet and a table.


def add_sweep(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument(
        "--over", action="append", required=True, metavar="key.path=a,b,...", dest="keys",
        help="values of a key of the scene file, as camera.f_number=2,4,8 or 2,2.8,…,22; may be repeated, the last"
        " varies first",
    )  # fmt: skip
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FOLDER", help="folder to write to")
    add_options(parser, "spp", "size", "seed")
    parser.add_argument(
        "--mtf", type=point, metavar="x,y",
        help="measure MTF50 of the edge at this point, in fractions of the picture from the left and the top",
    )  # fmt: skip
    add_device(parser)
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
    from rptcam_cl.api.sweeping import sweep
    from rptcam_cl.scene.load import load_scene, set_keys

    over = _over(arguments.keys)
    scene = load_scene(arguments.scene, arguments.overrides)
    print_warnings(scene.warnings)
    rows, said = [], set(scene.warnings)
    with stop_on_interrupt(None if arguments.cluster or arguments.workers else ENDS_LATER) as stop:
        pictures = None
        if check_cluster_arguments(arguments):
            from rptcam_cl.batch.cluster_run import render_scenes_on_cluster

            pictures = functools.partial(
                render_scenes_on_cluster, should_stop=stop.is_set, **cluster_keywords(arguments)
            )
        entries = sweep(
            scene, over, arguments.output, spp=arguments.spp, size=arguments.size, seed=arguments.seed,
            mtf_at=arguments.mtf, device=arguments.device, pictures=pictures, allow_mixed=arguments.allow_mixed,
        )  # fmt: skip
        try:
            for entry in entries:
                rows.append([*entry.values.values(), *entry.measures.values()])
                doubts = [line for line in set_keys(scene, entry.values).lens_doubts if line not in said]
                print_warnings(doubts)
                said.update(doubts)
                if not arguments.quiet:
                    print(f"{entry.label}: {'kept' if entry.kept else 'rendered'}", file=sys.stderr)
                if stop.is_set():
                    raise InterruptedError
        except InterruptedError:
            print("interrupted: the same command goes on with the rest", file=sys.stderr)
            return INTERRUPTED
    print_table([*over, *entry.measures], rows)
    return 0


# Lists of values with an ellipsis: ``2,2.8,…,22`` goes on as it began, in stops for f-numbers, in equal steps else.

ELLIPSES = ("…", "...")
MOST_VALUES = 10_000
ON_THE_WAY = 1e-6  # of a step, by which the last value may miss it

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
    places = [k for k, value in enumerate(values) if value in ELLIPSES]
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
    if len(before) < 2 or not 1 - ON_THE_WAY <= count <= MOST_VALUES or abs(count - round(count)) > ON_THE_WAY:
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
        "--frames", type=indices, metavar="FIRST[-LAST[:STEP]]",
        help="make these frames alone, which count from 0, as 517 or 0-99",
    )  # fmt: skip
    parser.add_argument(
        "--shard", type=_count, metavar="N", help="write shards of N frames, TAR files as WebDataset reads them"
    )
    add_device(parser)
    add_options(parser, "overrides", "allow_mixed", "quiet")


_count = number(digits, 1, 999_999_999, "a whole number, 1 or more")


def indices(text: str) -> range:
    """Frames of ``517``, ``0-99`` or ``0-99:2``."""
    frames = number_range(text, 9, 0)
    if frames is None:
        raise argparse.ArgumentTypeError(f"got {text}; allowed FIRST[-LAST[:STEP]], as 517 or 0-99")
    return frames


def run_dataset(arguments: argparse.Namespace) -> int:
    """Render the frames of a dataset, each with its exact camera. Frames that are there are kept."""
    from rptcam_cl.batch.dataset import dataset
    from rptcam_cl.batch.specification import read_specification

    wanted = read_specification(arguments.specification, arguments.overrides, frames=arguments.count)
    print_warnings(wanted.scene.warnings)
    frames = dataset(
        wanted, arguments.output, only=arguments.frames, shard=arguments.shard, device=arguments.device,
        allow_mixed=arguments.allow_mixed,
    )  # fmt: skip
    kept = rendered = 0
    with stop_on_interrupt(ENDS_LATER) as stop:
        for frame in frames:
            kept, rendered = kept + frame.kept, rendered + (not frame.kept)
            if not arguments.quiet and not frame.kept:
                drawn = ", ".join(f"{key}={_format_value(value)}" for key, value in frame.values.items())
                print(f"frame {frame.index}: {drawn}", file=sys.stderr)
            if stop.is_set():
                print("interrupted: the same command goes on with the rest", file=sys.stderr)
                return INTERRUPTED
    if not arguments.quiet:
        print(f"wrote {arguments.output}: {rendered} frames rendered, {kept} kept", file=sys.stderr)
    return 0


def _format_value(value: object) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_format_value, value)) + "]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
