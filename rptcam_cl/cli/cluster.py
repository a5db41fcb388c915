"""Renders on a cluster: the options of ``rptcam render`` for one, and what goes with them."""

import argparse
import functools
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rptcam_cl.cli.frames import Frame
from rptcam_cl.cli.interrupt import INTERRUPTED, stop_on_interrupt
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.api import Image, Progress
    from rptcam_cl.api.sweeping import Pictures
    from rptcam_cl.cluster import TLS
    from rptcam_cl.scene import Scene

# Options that need the whole film while it is rendered, or a device of this process.
ALONE = {"part": "--part", "samples": "--samples", "time": "--time", "noise": "--noise", "denoise": "--denoise"}
ALONE |= {"watch": "--watch", "preview": "--preview", "plan": "--plan", "split": "--split"}
ALONE |= {"stats": "--stats", "strict": "--strict"}
FOLDER = ".parts"  # in place of the suffix of the first output


def add_options(parser: argparse.ArgumentParser) -> None:
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


def requested(arguments: argparse.Namespace) -> bool:
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


def folder_of(arguments: argparse.Namespace) -> Path:
    """Where parts are kept until the picture is whole: beside the first output."""
    first: Path = arguments.outputs[0]
    return first.with_suffix(FOLDER)


def render(
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
    from rptcam_cl.cluster import render_on_cluster

    return render_on_cluster(
        scene, arguments.cluster, workers=arguments.workers, tls=_tls(arguments), device=_device(arguments),
        folder=folder_of(arguments), resume=arguments.resume, spp=arguments.spp, seed=arguments.seed,
        size=arguments.size, crop=arguments.crop, layers=layers, on_progress=show, should_stop=should_stop,
        allow_mixed=arguments.allow_mixed,
    )  # fmt: skip


def render_frames(
    arguments: argparse.Namespace,
    missing: Iterable[Frame],
    layers: list[str] | None,
    save: "Callable[[Image, argparse.Namespace], None]",
) -> int:
    """Render frames on a cluster, each by one worker; save them as they come, and return the exit code."""
    from rptcam_cl.cluster import render_scenes_on_cluster

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
                    print(f"wrote {names}: {account(image)}", file=sys.stderr)
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
    from rptcam_cl.cluster import render_scenes_on_cluster

    return functools.partial(
        render_scenes_on_cluster, cluster=arguments.cluster, workers=arguments.workers, tls=_tls(arguments),
        device=arguments.device, should_stop=should_stop, allow_mixed=arguments.allow_mixed,
    )  # fmt: skip


def _tls(arguments: argparse.Namespace) -> "TLS | Literal[False] | None":
    """The certificates, where some are given; False where none are wanted."""
    from rptcam_cl.cluster import TLS

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


def remove(folder: Path) -> None:
    """Remove the parts of a picture that is written."""
    from rptcam_cl.cluster import PartsFolder

    PartsFolder(folder).clear()


def account(image: "Image") -> str:
    """Which workers have rendered how much, as people read it."""
    cluster = image.stats["cluster"]
    rows = cluster["workers"].values()
    devices = sorted({row["device"] for row in rows})
    line = f"cluster: {cluster['parts']} parts by {len(rows)} worker{'s' * (len(rows) != 1)} on {', '.join(devices)}"
    return line + ("; bits of different devices may differ in the last place" if len(devices) > 1 else "")
