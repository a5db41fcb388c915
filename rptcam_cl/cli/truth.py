"""``rptcam render --truth``: the files of ground truth beside the picture."""

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.core.errors import InputError, StateError

if TYPE_CHECKING:
    from rptcam_cl.imaging import Image
    from rptcam_cl.scene import Scene

RAYS = ("ray_origin", "ray_direction")
# Options with which there is no whole picture at hand, or more than one.
OTHERS = {
    "part": "--part",
    "samples": "--samples",
    "frames": "--frames",
    "cluster": "--cluster",
    "workers": "--workers",
}


def add_option(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    parser.add_argument(
        "--truth", type=Path, metavar="DIR",
        help="also write COCO annotations, masks of instances and classes, and the rays of all pixels into this folder",
    )  # fmt: skip


def check(arguments: argparse.Namespace, scene: "Scene") -> None:
    """Refuse, before anything is compiled, what could not be written at the end.

    Raises
    ------
    InputError, StateError
    """
    folder: Path | None = arguments.truth
    if folder is None:
        return
    from rptcam_cl.imaging import MOST_INSTANCES

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


def with_layers(arguments: argparse.Namespace, layers: Sequence[str] | None, scene: "Scene") -> list[str] | None:
    """Return the layers to record: those of the outputs (None: the scene's), and what the files of truth need."""
    if arguments.truth is None:
        return None if layers is None else list(layers)
    from rptcam_cl.imaging import LABELS

    return list(dict.fromkeys((*(scene.render.layers if layers is None else layers), *LABELS, *RAYS)))


def without_layers(
    arguments: argparse.Namespace, image: "Image", layers: Sequence[str] | None, scene: "Scene"
) -> "Image":
    """Return the picture with the layers of the outputs alone."""
    if arguments.truth is None:
        return image
    kept = scene.render.layers if layers is None else layers
    return replace(image, layers={name: image.layers[name] for name in kept})


def save(arguments: argparse.Namespace, image: "Image") -> None:
    """Write the files of truth, of the first output's picture."""
    if arguments.truth is None:
        return
    files = image.save_truth(arguments.truth, arguments.outputs[0].name)
    if not arguments.quiet:
        print(f"wrote {', '.join(map(str, files))}", file=sys.stderr)
