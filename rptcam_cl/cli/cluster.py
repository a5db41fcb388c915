"""``rptcam sweep`` and ``dataset``, many pictures, and the options of renders on a cluster."""

import argparse
import functools
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rptcam_cl.cli.frames import Frame
from rptcam_cl.cli.output import ENDS_LATER, INTERRUPTED, print_table, print_warnings, stop_on_interrupt
from rptcam_cl.cli.parser import Commands, add_allow_mixed, add_device, add_overrides, expanded, point, seed, size, spp
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.api.sweeping import Pictures
    from rptcam_cl.batch.cluster import TLS
    from rptcam_cl.imaging.image import Image
    from rptcam_cl.rendering.progressive import Progress
    from rptcam_cl.scene.scene import Scene


# Renders on a cluster: the options of ``rptcam render`` for one, and what goes with them.

# Options that need the whole film while it is rendered, or a device of this process.
ALONE = {"part": "--part", "samples": "--samples", "time": "--time", "noise": "--noise", "denoise": "--denoise"}
ALONE |= {"watch": "--watch", "preview": "--preview", "plan": "--plan", "split": "--split"}
ALONE |= {"stats": "--stats", "strict": "--strict"}
FOLDER = ".parts"  # in place of the suffix of the first output


def add_cluster_options(parser: argparse.ArgumentParser) -> None:
    """Add where the workers are."""
    parser.add_argument(
        "--cluster", metavar="ADDRESS",
        help="render on the workers of this scheduler of dask.distributed, as tls://host:8786",
    )  # fmt: skip
    parser.add_argument("--workers", type=int, metavar="N", help="render in N processes of this machine, likewise")
    parser.add_argument(
        "--tls", metavar="CA,CERT,KEY",
        help="certificate files (PEM) for an address tls://…: authority, certificate, key; none: take tcp:// on a"
        " machine where all users are trusted",
    )  # fmt: skip


def cluster_requested(arguments: argparse.Namespace) -> bool:
    """Whether a cluster renders; refuses options that go with none.

    Raises
    ------
    InputError
    """
    if arguments.cluster is None and arguments.workers is None:
        if arguments.tls is not None:
            raise InputError("--tls: is for a cluster (allowed: with --cluster tls://…)")
        return False
    option = "--workers" if arguments.cluster is None else "--cluster"
    for name, words in ALONE.items():
        if getattr(arguments, name):
            raise InputError(f"{words}: does not go with {option} (allowed: one of the two)")
    if arguments.devices is not None and len(arguments.devices) > 1:
        raise InputError(f"--device: each worker renders on one device (allowed: one name with {option})")
    return True


def parts_folder_of(arguments: argparse.Namespace) -> Path:
    """Where parts are kept until the picture is whole: beside the first output."""
    first: Path = arguments.outputs[0]
    return first.with_suffix(FOLDER)


def render_by_cluster(
    arguments: argparse.Namespace,
    scene: "Scene",
    layers: list[str] | None,
    show: "Callable[[Progress], None] | None",
    should_stop: Callable[[], bool],
) -> "Image":
    """Return the picture that a cluster renders.

    Raises
    ------
    InterruptedError
        As `rptcam_cl.render_on_cluster` does.
    """
    from rptcam_cl.batch.cluster_run import render_on_cluster

    return render_on_cluster(
        scene, arguments.cluster, workers=arguments.workers, tls=_tls(arguments), device=_device(arguments),
        folder=parts_folder_of(arguments), resume=arguments.resume, spp=arguments.spp, seed=arguments.seed,
        size=arguments.size, crop=arguments.crop, layers=layers, on_progress=show, should_stop=should_stop,
        allow_mixed=arguments.allow_mixed,
    )  # fmt: skip


def render_frames_by_cluster(
    arguments: argparse.Namespace,
    missing: Iterable[Frame],
    layers: list[str] | None,
    save: "Callable[[Image, argparse.Namespace], None]",
) -> int:
    """Render frames on a cluster, each by one worker; save them as they come, and return the exit code."""
    from rptcam_cl.batch.cluster_run import render_scenes_on_cluster

    todo = {frame.number: frame for frame in missing}
    if any(frame.arguments.neighbours is not None for frame in todo.values()):
        raise InputError("--cluster: flow leads from frame to frame, which workers do not have (allowed: other layers)")
    words = {name: getattr(arguments, name) for name in ("spp", "seed", "size", "crop")} | {"layers": layers}
    with stop_on_interrupt() as stop:
        images = render_scenes_on_cluster(
            {number: frame.scene for number, frame in todo.items()}, arguments.cluster, workers=arguments.workers,
            tls=_tls(arguments), device=_device(arguments), settings=words, should_stop=stop.is_set,
            allow_mixed=arguments.allow_mixed,
        )  # fmt: skip
        try:
            for number, image in images:
                frame = todo[number]
                frame.arguments.same.add(f"frame {number}", image.metadata["made_by"])
                image.metadata.update(frame.metadata)
                save(image, frame.arguments)
                if not arguments.quiet:
                    names = ", ".join(map(str, [*frame.arguments.outputs, *frame.arguments.raws]))
                    print(f"wrote {names}: {cluster_account(image)}", file=sys.stderr)
        except InterruptedError as ended:
            print(f"interrupted: {ended}; --resume goes on with the rest", file=sys.stderr)
            return INTERRUPTED
    return 0


def pictures_of(arguments: argparse.Namespace, should_stop: Callable[[], bool]) -> "Pictures | None":
    """What renders the pictures of a sweep on a cluster; None without one.

    Raises
    ------
    InputError
        For options that go with none.
    """
    if arguments.cluster is None and arguments.workers is None:
        if arguments.tls is not None:
            raise InputError("--tls: is for a cluster (allowed: with --cluster tls://…)")
        return None
    from rptcam_cl.batch.cluster_run import render_scenes_on_cluster

    return functools.partial(
        render_scenes_on_cluster, cluster=arguments.cluster, workers=arguments.workers, tls=_tls(arguments),
        device=arguments.device, should_stop=should_stop, allow_mixed=arguments.allow_mixed,
    )  # fmt: skip


def _tls(arguments: argparse.Namespace) -> "TLS | Literal[False] | None":
    """The certificates, where some are given; False where none are wanted."""
    from rptcam_cl.batch.cluster import TLS

    if arguments.tls is None:
        return None
    if arguments.tls == "none":
        return False
    names = re.split(r"\s*,\s*", arguments.tls.strip())
    if len(names) != 3:
        raise InputError(f"--tls: three files (got {arguments.tls}; allowed: as ca.pem,cert.pem,key.pem)")
    return TLS(*names)


def _device(arguments: argparse.Namespace) -> str | None:
    """The device of each worker."""
    return None if arguments.devices is None else str(arguments.devices[0])


def remove_parts(folder: Path) -> None:
    """Remove the parts of a picture that is written."""
    from rptcam_cl.batch.cluster import PartsFolder

    PartsFolder(folder).clear()


def cluster_account(image: "Image") -> str:
    """Which workers have rendered how much, as people read it."""
    cluster = image.stats["cluster"]
    rows = cluster["workers"].values()
    devices = sorted({row["device"] for row in rows})
    line = f"cluster: {cluster['parts']} parts by {len(rows)} worker{'s' * (len(rows) != 1)} on {', '.join(devices)}"
    return line + ("; bits of different devices may differ in the last place" if len(devices) > 1 else "")


# ``rptcam sweep``: a grid of pictures over values of any keys, with a contact sheet and a table.


def add_sweep(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "sweep",
        help="render a scene with every combination of some values",
        description="Render every combination of values, and write films, a contact sheet and a table. What is there"
        " already is kept.",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument(
        "--over", action="append", required=True, metavar="key.path=a,b,...", dest="keys",
        help="values of a key of the scene file, as camera.f_number=2,4,8 or 2,2.8,…,22; may be repeated, the last"
        " varies first",
    )  # fmt: skip
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FOLDER", help="folder to write to")
    parser.add_argument("--spp", type=spp, metavar="N", help="samples per pixel, in place of the scene's")
    parser.add_argument("--size", type=size, metavar="WxH", help="resolution in pixels")
    parser.add_argument("--seed", type=seed, metavar="N", help="seed of the random numbers")
    parser.add_argument(
        "--mtf", type=point, metavar="x,y",
        help="measure MTF50 of the edge at this point, in fractions of the picture from the left and the top",
    )  # fmt: skip
    add_device(parser)
    add_cluster_options(parser)
    add_overrides(parser)
    add_allow_mixed(parser)
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run_sweep, parser=parser)


def _over(texts: list[str]) -> dict[str, list[Any]]:
    """Values by key of ``key.path=a,b,c``, each read as YAML."""
    from rptcam_cl.core.strict_yaml import read_yaml

    found: dict[str, list[Any]] = {}
    for text in texts:
        key, _, listed = text.partition("=")
        if not key or not listed.strip():
            raise InputError(f"--over {text}: is not of the form key.path=a,b,... (for instance camera.f_number=2,4,8)")
        if key in found:
            raise InputError(f"--over {text}: {key} twice (allowed: each key once)")
        values = read_yaml(f"[{listed}]", name=f"--over {text}").data
        found[key] = expanded(key, values, f"--over {text}")
    return found


def _run_sweep(arguments: argparse.Namespace) -> int:
    from rptcam_cl.api.sweeping import sweep
    from rptcam_cl.scene.load import load_scene, set_keys

    over = _over(arguments.keys)
    scene = load_scene(arguments.scene, arguments.overrides)
    print_warnings(scene.warnings)
    rows, said = [], set(scene.warnings)
    with stop_on_interrupt(None if arguments.cluster or arguments.workers else ENDS_LATER) as stop:
        entries = sweep(
            scene, over, arguments.output, spp=arguments.spp, size=arguments.size, seed=arguments.seed,
            mtf_at=arguments.mtf, device=arguments.device, pictures=pictures_of(arguments, stop.is_set),
            allow_mixed=arguments.allow_mixed,
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


# ``rptcam dataset``: many pictures of a scene whose keys are drawn from distributions, with their exact cameras.


def add_dataset(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "dataset",
        help="render many pictures whose keys are drawn from distributions",
        description="Render the frames of a dataset, each with its exact camera. Frames that are there are kept.",
    )
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
    add_overrides(parser)
    add_allow_mixed(parser)
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run_dataset, parser=parser)


def _count(text: str) -> int:
    if not re.fullmatch(r"\d{1,9}", text, re.ASCII) or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed a whole number, 1 or more")
    return int(text)


def indices(text: str) -> range:
    """Frames of ``517``, ``0-99`` or ``0-99:2``."""
    match = re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?(?::(\d{1,9}))?", text, re.ASCII)
    first = int(match[1]) if match else 1
    last = int(match[2] or first) if match else 0
    step = int(match[3] or 1) if match else 1
    if first > last or step < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed FIRST[-LAST[:STEP]], as 517 or 0-99")
    return range(first, last + 1, step)


def _run_dataset(arguments: argparse.Namespace) -> int:
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
                drawn = ", ".join(f"{key}={_shown(value)}" for key, value in frame.values.items())
                print(f"frame {frame.index}: {drawn}", file=sys.stderr)
            if stop.is_set():
                print("interrupted: the same command goes on with the rest", file=sys.stderr)
                return INTERRUPTED
    if not arguments.quiet:
        print(f"wrote {arguments.output}: {rendered} frames rendered, {kept} kept", file=sys.stderr)
    return 0


def _shown(value: object) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_shown, value)) + "]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
