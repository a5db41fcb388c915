"""Devices, lenses and pictures, each by one call."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl import optics
from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.api.stages import prepare, report, run
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Split, Wanted, choose_device, list_devices, problem_of
from rptcam_cl.imaging import Image
from rptcam_cl.rendering import Progress
from rptcam_cl.scene import Scene, load_scene

if TYPE_CHECKING:
    from rptcam_cl.lenstools import TraceableLens


SceneSource = Scene | str | Path | Mapping[str, Any]


def devices() -> list[dict[str, Any]]:
    """Return every OpenCL device as a mapping of id, name, platform, type, compute_units, memory_bytes, fp64,
    problem and default.

    ``problem`` is why it cannot be used, None where it can; ``default`` marks the one that ``auto`` chooses.
    """
    found = list_devices()
    problems = {device.id: problem_of(device) for device in found}
    chosen = None if all(problems.values()) else choose_device("auto").id
    names = ("id", "name", "platform", "type", "compute_units", "memory_bytes", "fp64")
    return [
        {name: getattr(device, name) for name in names}
        | {"problem": problems[device.id], "default": device.id == chosen}
        for device in found
    ]


def load_lens(source: str | Path | Mapping[str, Any]) -> TraceableLens:
    """Return the lens of a name in the library, a file, or a mapping of the same form; it can be traced on devices."""
    from rptcam_cl.lenstools import traceable

    return traceable(optics.load_lens(source))


def render(
    scene: SceneSource,
    *,
    spp: int | None = None,
    seconds: float | None = None,
    seed: int | None = None,
    size: tuple[int, int] | None = None,
    crop: tuple[float, float, float, float] | None = None,
    layers: Sequence[str] | None = None,
    denoise: bool = False,
    noise: float | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    allow_mixed: bool = False,
    device: Wanted = None,
    split: Split | None = None,
    wave_size: int | None = None,
    numerics: bool = False,
    strict: bool = False,
    part: str | None = None,
    samples: tuple[int, int] | None = None,
    neighbours: tuple[SceneSource | None, SceneSource | None] | None = None,
    on_progress: Callable[[Progress], Any] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Image:
    """Return the picture that the camera of a scene takes.

    Parameters
    ----------
    scene
        A scene, or anything that `load_scene` takes.
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
        Something in the scene or the arguments is wrong.
    DeviceError
        No device fits, or a kernel failed.
    StateError
        The checkpoint is damaged, of another render, or cannot be written.
    NumericError
        With ``strict``; its ``image`` is the picture.
    """
    settings = RenderSettings(
        spp=spp,
        seconds=seconds,
        seed=seed,
        size=size,
        crop=crop,
        layers=layers,
        denoise=denoise,
        noise=noise,
        checkpoint=checkpoint,
        resume=resume,
        allow_mixed=allow_mixed,
        device=device,
        split=split,
        wave_size=wave_size,
        numerics=numerics,
        strict=strict,
        part=part,
        samples=samples,
        neighbours=_frames_beside(neighbours),
        on_progress=on_progress,
        should_stop=should_stop,
    )
    prepared = prepare(scene, settings)
    return report(prepared, run(prepared))


def _frames_beside(
    neighbours: tuple[SceneSource | None, SceneSource | None] | None,
) -> tuple[Scene | None, Scene | None] | None:
    """Return the scenes of the frames before and after."""
    if neighbours is None:
        return None
    if not isinstance(neighbours, tuple | list) or len(neighbours) != 2:
        got = f"{len(neighbours)} of them" if isinstance(neighbours, tuple | list) else type(neighbours).__name__
        raise InputError(f"neighbours: must be the frames before and after (got {got}; allowed: two, None for none)")
    before, after = (frame if frame is None or isinstance(frame, Scene) else load_scene(frame) for frame in neighbours)
    return before, after
