"""``rptcam render --frames``, a sequence of pictures, and ``--watch``, again whenever a file changes."""

import argparse
import contextlib
import copy
import json
import re
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import check_together
from rptcam_cl.cli.parser import apply_options, device_of, files_to_write, names_of
from rptcam_cl.core.constants import __version__
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.files import LAYER_SUFFIXES, file_state, listed, named_files
from rptcam_cl.core.remember import OneMaker, made_by

if TYPE_CHECKING:
    from rptcam_cl.scene.exposure import FrameSequence
    from rptcam_cl.scene.scene import Scene


# ``rptcam render --frames``: a sequence of pictures, each the one that its frame gives alone.

PLACE = re.compile(r"#+")


def sequence_of(scene: "Scene") -> "FrameSequence":
    """The sequence of a scene; by default one in which nothing but the time changes."""
    from rptcam_cl.scene.exposure import FrameSequence

    return scene.sequence or FrameSequence()


def scene_of_frame(scene: "Scene", frame: int) -> "Scene":
    """The scene of a frame that stands alone."""
    from rptcam_cl.scene.load import set_keys

    return set_keys(scene, sequence_of(scene).changes(scene.shutter.open_s, frame))


def frame_scenes(arguments: argparse.Namespace, scene: "Scene") -> list[tuple[int, "Scene"]]:
    """The scene of each frame, checked before any is rendered."""
    from rptcam_cl.scene.load import at_rest

    scenes = []
    for frame in arguments.frames:
        try:
            still = scene_of_frame(scene, frame)
            at_rest(still)  # keys of the shutter as well
            scenes.append((frame, still))
        except RptcamError as problem:
            raise type(problem)(f"frame {frame}: {problem}") from None
    return scenes


def track_frames(
    arguments: argparse.Namespace, scene: "Scene"
) -> Callable[[int], tuple["Scene", dict[str, Any]]] | None:
    """A function of a frame with focus and exposure that follow from those before; None where each stands alone."""
    from rptcam_cl.api.job import RenderOptions
    from rptcam_cl.api.sweeping import FrameTracker, needs_tracking

    if not needs_tracking(scene):
        return None
    from rptcam_cl.device.session import open_sessions

    settings = RenderOptions(seed=arguments.seed, size=arguments.size, crop=arguments.crop)
    return FrameTracker(settings.apply_to(scene), lambda: open_sessions(device_of(arguments))[0][0]).frame


def neighbours_of(
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
    for path in files_to_write(arguments):
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
    images = (develop(_name_of_frame(film, frame)) for frame in arguments.frames)
    count = write_video(arguments.video, images, sequence_of(scene).frames_per_second)
    if not arguments.quiet:
        print(f"wrote {arguments.video}: {count} frames", file=sys.stderr)


def arguments_of_frame(arguments: argparse.Namespace, frame: int) -> argparse.Namespace:
    """The arguments of one frame: its names of files."""
    own = copy.copy(arguments)
    own.outputs = [_name_of_frame(path, frame) for path in arguments.outputs]
    own.raws = [_name_of_frame(path, frame) for path in arguments.raws]
    return own


def _name_of_frame(path: Path, frame: int) -> Path:
    return path.with_name(PLACE.sub(lambda match: f"{frame:0{len(match[0])}d}", path.name))


def metadata_of(scene: "Scene", frame: int) -> dict[str, Any]:
    """Metadata of a frame."""
    sequence = sequence_of(scene)
    return {
        "frame": frame, "timecode": sequence.timecode(frame), "frames_per_second": sequence.frames_per_second,
    }  # fmt: skip


def layer_metadata(arguments: argparse.Namespace, scene: "Scene") -> dict[str, Any]:
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
    if not all(path.is_file() for path in files_to_write(arguments)):
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
    return expected | layer_metadata(arguments, applied)


def missing_frames(arguments: argparse.Namespace, scene: "Scene") -> "Iterator[Frame]":
    """Yield the frames that are not there yet; all are checked before the first."""
    track, same = track_frames(arguments, scene), OneMaker(arguments.allow_mixed)
    # Frames that follow one another are not found again
    at = lru_cache(maxsize=3)(track or (lambda number: (scene_of_frame(scene, number), {})))
    for number, alone in frame_scenes(arguments, scene):
        own = arguments_of_frame(arguments, number)
        own.same = same
        still, described = (alone, {}) if track is None else at(number)
        own.neighbours = neighbours_of(arguments, scene, number, lambda other: at(other)[0])
        applied = apply_options(own, still)
        if not (arguments.resume and is_finished(own, _expected_metadata(own, applied))):
            metadata = metadata_of(scene, number) | described | layer_metadata(own, applied)
            if same.makers:  # whether what is kept is of this code, before any work; the driver is known after it
                same.add("this program", made_by([same.makers[0]["driver"]]))
            yield own, still, metadata
            continue
        for path in own.outputs:
            if (known := _metadata(path)) is not None:
                same.add(str(path), _value(known.get("made_by")))
        if not arguments.quiet:
            print(f"kept {names_of(own.outputs)}", file=sys.stderr)


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
