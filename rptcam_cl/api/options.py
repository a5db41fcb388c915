"""The options of a render, each once: keyword, words on the command line, parser, and what it does not go with."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rptcam_cl.core import MAX_SEED, MAX_SPP
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, near_name, out_of_range
from rptcam_cl.core.files import DEVELOPED_SUFFIXES, FILM_SUFFIXES, LAYER_SUFFIXES, RAW_SUFFIXES, listed

if TYPE_CHECKING:  # the command line shows its help without them
    from rptcam_cl.device.session import Split, Wanted
    from rptcam_cl.rendering.progressive import Progress
    from rptcam_cl.rendering.several import FilmPart
    from rptcam_cl.scene.load import SceneSource
    from rptcam_cl.scene.scene import Scene

# Words of the command line as values, with their ranges.

Number = TypeVar("Number", int, float)


def number(kind: Callable[[str], Number], lowest: float, highest: float, allowed: str) -> Callable[[str], Number]:
    """The parser of a number in a range."""

    def parse(text: str) -> Number:
        try:
            value = kind(text)
        except ValueError:
            pass
        else:
            if lowest <= value <= highest:
                return value
        raise argparse.ArgumentTypeError(f"got {text}; allowed {allowed}")

    return parse


def digits(text: str) -> int:
    """A whole number of ASCII digits alone."""
    if not (text.isascii() and text.isdigit()):
        raise ValueError(text)
    return int(text)


def _whole(text: str) -> int:
    """A whole number, as ``1000000`` or ``1e6``."""
    try:
        return int(text)
    except ValueError:
        if len(text) < 20 and (number := float(text)).is_integer():
            return int(number)
        raise


spp = number(_whole, 1, MAX_SPP, f"a whole number from 1 to {MAX_SPP}")
seed = number(int, 0, MAX_SEED, "a whole number from 0 to 2^64 - 1")

_AMOUNT = r"([0-9.]+(?:e[+-]?\d+)?)\s*"
_DURATION = rf"(?:{_AMOUNT}h\s*)?(?:{_AMOUNT}(?:min|m)\s*)?(?:{_AMOUNT}s)?|{_AMOUNT}"
_UNITS = {1: 3600.0, 2: 60.0, 3: 1.0, 4: 1.0}  # of its groups


def share(text: str) -> float:
    """Share between 0 and 1 of ``0.02`` or ``2%``."""
    number, per_cent = re.fullmatch(r"(.*?)\s*(%?)", text.strip(), re.DOTALL).groups()  # type: ignore[union-attr]
    try:
        value = float(number) / (100.0 if per_cent else 1.0)
    except ValueError:
        value = -1.0
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed a number between 0 and 1, as 0.02 or 2%")
    return value


def duration(text: str) -> float:
    """Time of ``60``, ``60s``, ``2min``, ``1h`` or ``1m30s`` [s]."""
    match = re.fullmatch(_DURATION, text.strip(), re.IGNORECASE)
    try:
        seconds = sum(unit * float(match[group] or 0) for group, unit in _UNITS.items()) if match else -1.0
    except ValueError:
        seconds = -1.0
    if not 0 < seconds <= 1e9:
        raise argparse.ArgumentTypeError(f"got {text}; allowed a time above 0, as 60s, 2min, 1h or 1m30s")
    return seconds


def sample_range(text: str) -> tuple[int, int]:
    """First sample and the one that it ends before of ``FIRST:END``."""
    match = re.fullmatch(r"(\d{1,10}):(\d{1,10})", text, re.ASCII)
    first, end = (int(match[1]), int(match[2])) if match else (0, 0)
    if not first < end <= MAX_SPP:
        raise argparse.ArgumentTypeError(f"got {text}; allowed FIRST:END, as 0:64 and then 64:128")
    return first, end


def _part_numbers(text: str) -> tuple[int, int] | None:
    """Number and count of a part such as ``3/8``; None if it is none."""
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text, re.ASCII)
    number, count = (int(match[1]), int(match[2])) if match else (0, 0)
    return (number, count) if 1 <= number <= count else None


def part(text: str) -> str:
    """Part ``K/N`` of a film."""
    if _part_numbers(text) is None:
        raise argparse.ArgumentTypeError(f"got {text}; allowed K/N, from 1/8 to 8/8 for eight parts")
    return text


def size(text: str) -> tuple[int, int]:
    """Width and height of ``WxH`` [pixels]."""
    match = re.fullmatch(r"(\d{1,9})[xX×](\d{1,9})", text, re.ASCII)
    width, height = (int(match[1]), int(match[2])) if match else (0, 0)
    if width < 1 or height < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed WxH in pixels, as 640x360")
    return width, height


def crop(text: str) -> tuple[float, float, float, float]:
    """Window ``x0,x1,y0,y1`` of the film in fractions of its width and height, from the left and from the top."""
    try:
        x0, x1, y0, y1 = (float(part) for part in text.split(","))
    except ValueError:
        x0, x1, y0, y1 = 1.0, 0.0, 1.0, 0.0
    if not (0.0 <= x0 < x1 <= 1.0 and 0.0 <= y0 < y1 <= 1.0):
        raise argparse.ArgumentTypeError(f"got {text}; allowed x0,x1,y0,y1 in 0..1 with x0 < x1 and y0 < y1")
    return x0, x1, y0, y1


def layers(text: str) -> tuple[str, ...]:
    """Names of auxiliary layers in ``a,b,c``; ``all`` stands for every one but ``lights``."""
    from rptcam_cl.scene.film import LAYER_NAMES, SINGLE_LAYERS

    names = tuple(name.strip() for name in text.split(","))
    if names == ("all",):
        return SINGLE_LAYERS
    for index, name in enumerate(names):
        if name not in LAYER_NAMES:
            hint = near_name(name, LAYER_NAMES)
            raise argparse.ArgumentTypeError(
                f"got {name or f'a comma too many in {text}'}{hint}; allowed all, {', '.join(LAYER_NAMES)}"
            )
        if name in names[:index]:
            raise argparse.ArgumentTypeError(f"{name} twice; allowed each layer once")
    return names


_SEVERAL_DIGITS = r"(\d{1,%d})(?:-(\d{1,%d}))?(?::(\d{1,%d}))?"


def number_range(digits: int, least: int, allowed: str) -> Callable[[str], range]:
    """The parser of numbers as ``1-240``, ``1-240:2`` or ``7``, of so many digits at most and ``least`` or more."""
    pattern = _SEVERAL_DIGITS.replace("%d", str(digits))

    def parse(text: str) -> range:
        if match := re.fullmatch(pattern, text, re.ASCII):
            first, step = int(match[1]), int(match[3] or 1)
            last = int(match[2] or first)
            if least <= first <= last and step >= 1:
                return range(first, last + 1, step)
        raise argparse.ArgumentTypeError(f"got {text}; allowed {allowed}")

    return parse


frame_range = number_range(7, 1, "FIRST-LAST[:STEP], as 1-240 or 1-240:2")


# The table. What an option does not go with is said by the mode that excludes it.

NOT_WITH = {
    "part": "{flag}: needs the whole film (allowed: without {mode}; rptcam merge makes the picture)",
    "frames": "{flag}: is for a single picture (allowed: without {mode})",
    "cluster": "{flag}: does not go with {mode} (allowed: one of the two)",
    "truth": "{mode}: is of a whole picture (allowed: without {flag})",
    "watch": "{mode}: renders one whole picture, here, anew each time (allowed: without {flag})",
}


@dataclass(frozen=True)
class CommandOption:
    """An option of a command, which may be a keyword of the Python call of the same name as well.

    Attributes
    ----------
    name : str
        The keyword, or where the parsed arguments have it.
    flags : str
        On the command line.
    help : str
    parse : callable or None
        Returns the value of a word; None for a switch.
    metavar : str
        Stands for the word in the help.
    not_with : str
        Modes of `NOT_WITH` that it does not go with.
    key : str
        Key of the scene that it replaces.
    more : mapping
        Further arguments of `argparse`.
    """

    name: str
    flags: str
    help: str
    parse: Callable[[str], Any] | None = None
    metavar: str = ""
    not_with: str = ""
    key: str = ""
    more: Mapping[str, Any] = field(default_factory=dict)

    @property
    def flag(self) -> str:
        """Its name on the command line, as messages say it."""
        return self.flags.split()[0]

    def add_to(self, parser: argparse.ArgumentParser) -> None:
        """Let a command have it."""
        takes: dict[str, Any] = {"action": "store_true"}
        if self.parse is not None:
            takes = {"type": self.parse}
        if self.metavar:
            takes["metavar"] = self.metavar
        parser.add_argument(*self.flags.split(), dest=self.name, help=self.help, **(takes | dict(self.more)))


SEVERAL: dict[str, Any] = {"action": "append"}
LISTED: dict[str, Any] = {"action": "append", "default": []}

# fmt: off
RENDER_OPTIONS = (
    CommandOption(
        "outputs", "-o --output", f"picture to write, format by suffix: {listed(DEVELOPED_SUFFIXES, 'and')} developed,"
        f" {listed(FILM_SUFFIXES, 'and')} linear; may be repeated", Path, "OUT", more=SEVERAL | {"required": True},
    ),
    CommandOption(
        "raws", "--raw", f"also write a raw file of the scene's sensor, format by suffix: {listed(RAW_SUFFIXES)}; may"
        " be repeated", Path, "OUT", not_with="part", more=LISTED,
    ),
    CommandOption("spp", "--spp", "samples per pixel, in place of the scene's", spp, "N", key="render.spp"),
    CommandOption(
        "seconds", "--time", "stop after this rendering time, as 60s or 5min", duration, "TIME",
        not_with="part cluster",
    ),
    CommandOption(
        "noise", "--noise", "sample each tile of 8 x 8 pixels until its relative standard error is X, as 0.02 or 2%%",
        share, "X", not_with="part cluster", key="render.noise",
    ),
    CommandOption(
        "resume", "--resume", "continue from OUT.rpck, which an interrupted render leaves, and keep it, so that samples"
        " can be added", not_with="watch",
    ),
    CommandOption(
        "allow_mixed", "--allow-mixed", "join what other code, another numpy or another driver has made, too, and name"
        " all in the metadata",
    ),
    CommandOption("seed", "--seed", "seed of the random numbers", seed, "N", key="render.seed"),
    CommandOption("size", "--size", "resolution in pixels", size, "WxH", key="film.resolution"),
    CommandOption(
        "crop", "--crop", "render only this window, in fractions of the picture from the left and the top", crop,
        "x0,x1,y0,y1", key="film.crop",
    ),
    CommandOption(
        "layers", "--layers", f"record these auxiliary layers in {listed(LAYER_SUFFIXES, 'and')} outputs, as"
        " depth,normal; all for every one but lights", layers, "NAME,...", key="render.layers",
    ),
    CommandOption(
        "denoise", "--denoise", "remove the remaining noise (biased); needs rptcam_cl[denoise]",
        not_with="part cluster",
    ),
    CommandOption(
        "device", "--device", "an index as 0:0, a part of a name, cpu, gpu, auto or all (default: $RPTCAM_DEVICE,"
        " $PYOPENCL_CTX, auto); may be repeated for several devices that share the render", str, "SPEC", more=SEVERAL,
    ),
    CommandOption(
        "split", "--split", "share of each device, as 0:0=0.7,1:0=0.3 (default: by speed, which is measured)", str,
        "SPEC=SHARE,...", not_with="cluster",
    ),
    CommandOption(
        "overrides", "--set", "replace a value of the scene file, as camera.f_number=4; may be repeated", str,
        "key.path=value", more=LISTED,
    ),
    CommandOption(
        "missing", "--missing", "files that are not there: an error that names them all (default), or grey in place of"
        " pictures, and meshes left out, each with a warning", str,
        more={"choices": ("error", "grey"), "default": "error"},
    ),
    CommandOption(
        "part", "--part", "render part K of N parts of the tiles, to be merged; -o names a file that ends in .rpck",
        part, "K/N", not_with="frames cluster truth watch",
    ),
    CommandOption(
        "samples", "--samples", "render these samples of each pixel alone, as 64:128, likewise", sample_range,
        "FIRST:END", not_with="frames cluster truth watch",
    ),
    CommandOption(
        "plan", "--plan", "print the memory, the kernel launches and the time that the render will take, and render"
        " nothing", not_with="frames cluster watch",
    ),
    CommandOption(
        "truth", "--truth", "also write COCO annotations, masks of instances and classes, and the rays of all pixels"
        " into this folder", Path, "DIR",
    ),
    CommandOption(
        "frames", "--frames", "render these frames of the scene's sequence, as 1-240 or 1-240:2; #### in names of files"
        " is the frame; with --resume, frames that are there are kept", frame_range, "FIRST-LAST[:STEP]",
        not_with="truth watch",
    ),
    CommandOption(
        "video", "--video", "with --frames and a film among the outputs (.exr, .npz): also a video, .mov (ProRes), .mkv"
        " (FFV1), .mp4 (H.264) or .webm (AV1); needs rptcam_cl[video]", Path, "OUT",
    ),
    CommandOption(
        "cluster", "--cluster", "render on the workers of this scheduler of dask.distributed, as tls://host:8786", str,
        "ADDRESS", not_with="truth watch",
    ),
    CommandOption(
        "workers", "--workers", "render in N processes of this machine, likewise",
        number(int, 1, math.inf, "a whole number, 1 or more"), "N", not_with="truth watch",
    ),
    CommandOption(
        "tls", "--tls", "certificate files (PEM) for an address tls://…: authority, certificate, key; none: take tcp://"
        " on a machine where all users are trusted", str, "CA,CERT,KEY",
    ),
    CommandOption(
        "stats", "--stats", "write statistics of the render", Path, "FILE.json", not_with="part frames cluster"
    ),
    CommandOption(
        "strict", "--strict", "fail, with exit code 5, when numbers cannot be trusted or autofocus failed; the picture"
        " is still written", not_with="cluster",
    ),
    CommandOption("quiet", "--quiet", "print only warnings and errors"),
    CommandOption(
        "preview", "--preview", "write the picture so far to the outputs now and then, as every 10s", duration, "TIME",
        not_with="part frames cluster",
    ),
    CommandOption(
        "watch", "--watch", "render again whenever the scene file or a file that it names changes, until Ctrl-C",
        not_with="part frames cluster",
    ),
)
# fmt: on

SCENE_KEYS = {option.name: option.key for option in RENDER_OPTIONS if option.key}
"""Keys of the scene that options replace, by keyword."""

OF_A_CLUSTER = tuple(
    option.name for option in RENDER_OPTIONS if option.key and "cluster" not in option.not_with.split()
)
"""Keywords that replace keys of a scene that a cluster renders."""


def _excluded_by(mode: str) -> list[CommandOption]:
    """The options that do not go with a mode of `NOT_WITH`."""
    return [option for option in RENDER_OPTIONS if mode in option.not_with.split()]


def check_together(arguments: argparse.Namespace, mode: str, flag: str) -> None:
    """Raise `InputError` if an option is given that does not go with a mode, which a flag says."""
    for option in _excluded_by(mode):
        if getattr(arguments, option.name):
            raise InputError(NOT_WITH[mode].format(flag=option.flag, mode=flag))


def add_options(parser: argparse.ArgumentParser, *names: str) -> None:
    """Let a command have some options of a render, in the given order."""
    options = {option.name: option for option in RENDER_OPTIONS}
    for name in names:
        options[name].add_to(parser)


# What a render takes beside its scene.


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """The keyword arguments of `render`; `takes_options` gives functions their signature and help.

    Parameters
    ----------
    spp
        Samples per pixel; by default the scene's, or as many as fit when ``seconds`` is given.
    seconds
        Time to render [s]; the picture ends after whole samples, at least one.
    seed, size, crop
        Replace the scene's seed, resolution [pixels] and crop [fractions x0, x1, y0, y1].
    layers
        Auxiliary layers to record, in place of the scene's: ``["depth", "normal"]``; see docs/layers.md.
    denoise
        Whether to remove the noise that is left, which makes the picture biased; needs the extra ``denoise``.
    noise
        Relative standard error at which a tile of 8 x 8 pixels is done, in place of the scene's; without ``spp``, up to
        16384 samples per pixel. See docs/scene.md.
    checkpoint
        File to keep the state of the render in: every minute, and when ``should_stop`` ends it.
    resume
        Whether to go on from the checkpoint, if it is there, and to leave it at the end, so that a later call can add
        samples. Otherwise a render that comes to its end removes it.
    allow_mixed
        Whether to go on from a checkpoint that other code, another numpy or another driver has saved; the metadata then
        name all under ``mixed``.
    device
        As ``--device`` on the command line, or a session to reuse; see `choose_device`. Several of them, or ``"all"``,
        share the render.
    split
        Share of each device, as ``{"0:0": 0.7, "1:0": 0.3}`` or ``"0:0=0.7,1:0=0.3"``; by default in proportion to
        their speeds, which are measured.
    wave_size
        Paths in flight; changes speed and memory, never the picture.
    numerics
        Whether to measure too what float32 costs in the lens, by the kernel that traces given rays.
    strict
        Whether numbers that cannot be trusted and autofocus that failed are an error; measures as ``numerics`` does.
        See docs/numerics.md.
    part
        ``"3/8"``: render the third of eight parts of the tiles, and keep its checkpoint for `merge`; see docs/parts.md.
    samples
        ``(64, 128)``: render these samples of each pixel alone, those from 64 on and before 128, likewise.
    neighbours
        Scenes of the frames before and after, or what `load_scene` takes, None where there is none, that the layers
        ``flow_backward`` and ``flow_forward`` lead to; without them they lead to the opening and the closing of the
        shutter.
    on_progress
        Called with a `Progress` several times a second.
    should_stop
        Asked after each sample per pixel; True ends the render with what there is.

    Raises
    ------
    InputError
        ``seconds`` is no time, or options exclude each other.
    """

    spp: int | None = None
    seconds: float | None = None
    seed: int | None = None
    size: tuple[int, int] | None = None
    crop: tuple[float, float, float, float] | None = None
    layers: Sequence[str] | None = None
    denoise: bool = False
    noise: float | None = None
    checkpoint: str | os.PathLike[str] | None = None
    resume: bool = False
    allow_mixed: bool = False
    device: Wanted = None
    split: Split | None = None
    wave_size: int | None = None
    numerics: bool = False
    strict: bool = False
    part: str | None = None
    samples: tuple[int, int] | None = None
    neighbours: tuple[SceneSource | None, SceneSource | None] | None = None
    on_progress: Callable[[Progress], Any] | None = None
    should_stop: Callable[[], bool] | None = None

    def __post_init__(self) -> None:
        if self.seconds is not None and not 0 < self.seconds < math.inf:
            raise out_of_range("seconds", self.seconds, "a finite number above 0")
        if self.film_part.facts() is None:
            return
        for option in _excluded_by("part"):
            if getattr(self, option.name, None):
                raise InputError(f"{option.name}: needs the whole film (allowed: without part and samples)")
        if self.samples is not None and self.spp is not None:
            raise InputError("spp: does not go with samples, which say where they end (allowed: one of the two)")

    @property
    def film_part(self) -> FilmPart:
        """The tiles and samples that are rendered.

        Raises
        ------
        InputError
            ``part`` or ``samples`` is none.
        """
        from rptcam_cl.rendering.several import FilmPart

        number, count = (1, 1) if self.part is None else _part_numbers(self.part) or (0, 0)
        if not count:
            raise InputError(f"part: is none (got {self.part}; allowed: as 3/8, from 1/8 to 8/8)")
        first, end = self.samples or (0, None)
        if end is not None and not 0 <= first < end < MAX_SPP:
            raise InputError(f"samples: are out of range (got {first}:{end}; allowed: as 0:64)")
        return FilmPart(number, count, first, end)

    @property
    def keeps_state(self) -> bool:
        """Whether the state of the render is kept at its end: to go on from it, or to be merged."""
        return self.resume or self.part is not None or self.samples is not None

    def apply_to(self, scene: Scene) -> Scene:
        """The scene with the keys that the options replace."""
        from rptcam_cl.scene.changes import change_scene

        changes: dict[str, dict[str, Any]] = {}
        for name, path in SCENE_KEYS.items():
            if (value := getattr(self, name)) is not None:
                section, _, key = path.partition(".")
                changes.setdefault(section, {})[key] = value
        return change_scene(scene, **changes) if changes else scene

    def most_spp(self, scene: Scene) -> int | None:
        """The sample to end before: of ``samples`` or ``spp``, else none for ``seconds``, else the scene's."""
        if self.samples is not None:
            return self.samples[1]
        if self.spp is not None:
            return self.spp
        if self.noise is not None:
            from rptcam_cl.scene.film import ADAPTIVE_SPP

            return ADAPTIVE_SPP
        return None if self.seconds is not None else scene.render.most_spp
