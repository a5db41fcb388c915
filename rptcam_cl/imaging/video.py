"""Videos of developed pictures, by PyAV (the extra ``video``)."""

from __future__ import annotations

import os
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.atomic import check_writable, replacing
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.imaging.development import quantised
from rptcam_cl.imaging.image import Image

# By suffix: container, codec, its pixels, and its options. ProRes 422 HQ of 10 bits; FFV1 without loss.
FORMATS: dict[str, tuple[str, str, str, dict[str, str]]] = {
    ".mov": ("mov", "prores_ks", "yuv422p10le", {"profile": "3"}),
    ".mkv": ("matroska", "ffv1", "gbrp16le", {"level": "3"}),
    ".mp4": ("mp4", "libx264", "yuv420p", {"crf": "16", "preset": "slow"}),
    ".webm": ("webm", "libsvtav1", "yuv420p10le", {"crf": "24"}),
}
_EXACT = {"fflags": "+bitexact"}  # else Matroska draws numbers at random for each file
_CLOCK = 1_000_000  # denominators of frame rates, at most

# Numbers of ITU-T H.273. Players take what is not said for either of two matrices, by the height of the picture.
_REC_709, _SRGB_CURVE, _NO_CURVE, _RGB = 1, 13, 8, 0
_LIMITED, _FULL = 1, 2  # ranges, as FFmpeg numbers them


def check_video(path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise an error, before anything is rendered, when a video could not be written.

    Raises
    ------
    InputError
        The suffix is unknown, or PyAV or its codec is not there.
    StateError
        The file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: is no video (got {suffix or 'no suffix'}; allowed {' '.join(FORMATS)})")
    try:
        import av
    except ImportError:
        raise InputError(f'{path}: videos need PyAV (pip install "rptcam_cl[video]")') from None
    if FORMATS[suffix][1] not in av.codecs_available:
        raise InputError(f"{path}: this PyAV has no codec {FORMATS[suffix][1]} (allowed: another suffix)")
    check_writable(path, inputs)


def write_video(path: str | os.PathLike[str], images: Iterable[Image], frames_per_second: float) -> int:
    """Write the developed pictures as a video, whole or not at all; return how many.

    A column or a row is left out where the codec needs an even number of them.

    Raises
    ------
    InputError
        As `check_video`, or a picture is of another size than the first.
    StateError
        The file cannot be written.
    """
    check_video(path)
    import av

    container, codec, kind, options = FORMATS[Path(path).suffix.lower()]
    count = 0
    with replacing(path) as temporary:
        try:
            with av.open(str(temporary), "w", format=container, options=_EXACT) as file:
                stream: Any = None
                for image in images:
                    codes = quantised(image.developed(), 16).astype(np.uint16)
                    codes = np.ascontiguousarray(codes[: len(codes) // 2 * 2, : codes.shape[1] // 2 * 2])
                    if codes.size == 0:
                        got = f"got {image.width} x {image.height}; allowed: at least 2 x 2"
                        raise InputError(f"{path}: pictures of a video need more pixels ({got})")
                    if stream is None:
                        rate = Fraction(frames_per_second).limit_denominator(_CLOCK)
                        stream = file.add_stream(codec, rate=rate, options=options)
                        stream.width, stream.height, stream.pix_fmt = codes.shape[1], codes.shape[0], kind
                        curve = _NO_CURVE if image.development.tone == "linear" else _SRGB_CURVE
                        _say_colours(stream.codec_context, curve, is_rgb=kind.startswith("gbr"))
                    if codes.shape[:2] != (stream.height, stream.width):
                        raise InputError(f"{path}: pictures of a video have one size")
                    file.mux(stream.encode(_frame(codes, kind)))
                    count += 1
                if stream is None:
                    raise InputError(f"{path}: a video needs at least one picture")
                file.mux(stream.encode())
        except av.FFmpegError as problem:
            raise StateError(f"{path}: cannot be written: {problem}") from problem
    return count


def _say_colours(codec: Any, curve: int, *, is_rgb: bool) -> None:
    """Write into a video how its numbers are to be understood."""
    codec.color_primaries, codec.color_trc = _REC_709, curve
    codec.colorspace, codec.color_range = (_RGB, _FULL) if is_rgb else (_REC_709, _LIMITED)


def _frame(codes: NDArray[np.uint16], kind: str) -> Any:
    """Return codes (height, width, 3) as a frame of the codec's pixels, by the matrix that `_say_colours` names.

    By one thread: where FFmpeg's filters share a picture among several, one in some hundred has a few other bits.
    """
    import av

    frame = av.VideoFrame.from_ndarray(codes, format="rgb48le")
    if kind.startswith("gbr"):
        return frame.reformat(format=kind, threads=1)
    return frame.reformat(format=kind, dst_colorspace=_REC_709, dst_color_range=_LIMITED, threads=1)
