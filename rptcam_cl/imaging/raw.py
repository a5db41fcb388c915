"""Raw files: the numbers of a sensor as DNG, as TIFF of 16 bits, or as a NumPy array."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rptcam_cl.core.atomic import check_writable, replacing
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.dng import LINEAR_RAW, Tag, dng_tags, photometric_of
from rptcam_cl.imaging.raw_frame import RawFrame, linear_picture
from rptcam_cl.imaging.sensor import SensorModel


@dataclass(frozen=True, eq=False)
class RawImage:
    """What the sensor put out. ``numpy.asarray(raw)`` is `numbers`."""

    frame: RawFrame
    metadata: dict[str, Any] = field(default_factory=dict)
    """Those of the picture."""

    @property
    def numbers(self) -> NDArray[np.uint16]:
        """Raw numbers, (height, width), or (height, width, 3) of a sensor without a mosaic."""
        return self.frame.numbers

    @property
    def sensor(self) -> SensorModel:
        """The sensor, its gain and levels."""
        return self.frame.sensor

    def linear(self) -> NDArray[np.float32]:
        """Return the linear picture (height, width, 3) that the numbers give, in the scale of the film."""
        return linear_picture(self.frame)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save by suffix: ``.dng`` with all that a raw converter needs, ``.tif`` of 16 bits, ``.npy``.

        The file is written whole or not at all.

        Raises
        ------
        InputError
            The suffix is not one of these.
        StateError
            The file cannot be written.
        """
        writer = _WRITERS[_suffix(path)]
        check_writable(path)
        with replacing(path) as temporary:
            writer(temporary, self)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False and dtype is not None and np.dtype(dtype) != self.numbers.dtype:
            raise ValueError(f"raw numbers are uint16; {np.dtype(dtype)} needs a copy")
        return np.array(self.numbers, dtype=dtype) if copy else np.asarray(self.numbers, dtype=dtype)

    def __repr__(self) -> str:
        height, width = self.numbers.shape[:2]
        return f"<RawImage {width} x {height}, {self.sensor.pattern}, {self.sensor.bit_depth} bits>"


def check_raw_output(path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise an error, before anything is rendered, when a raw file could not be saved at ``path``.

    Parameters
    ----------
    path
        Where the file is to go.
    inputs
        Files that it must not overwrite.
    """
    _suffix(path)
    check_writable(path, inputs)


def _suffix(path: str | os.PathLike[str]) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in _WRITERS:
        allowed = " ".join(_WRITERS)
        raise InputError(f"{path}: the suffix sets the raw format (got {suffix or 'none'}; allowed {allowed})")
    return suffix


def _write_npy(path: Path, raw: RawImage) -> None:
    with path.open("xb") as stream:
        np.save(stream, raw.numbers, allow_pickle=False)


def _write_tiff(path: Path, raw: RawImage) -> None:
    _write_tags(path, raw, "rgb" if raw.numbers.ndim == 3 else "minisblack", [])


def _write_dng(path: Path, raw: RawImage) -> None:
    import tifffile

    photometric = photometric_of(raw.frame)
    one_plane = photometric == LINEAR_RAW and raw.numbers.ndim == 2
    _write_tags(path, raw, "minisblack" if one_plane else photometric, dng_tags(raw.frame, raw.metadata))
    if one_plane:  # which tifffile takes for a mistake, though DNG allows it
        with tifffile.TiffFile(path, mode="r+") as file:
            file.pages.first.tags["PhotometricInterpretation"].overwrite(LINEAR_RAW)


def _write_tags(path: Path, raw: RawImage, photometric: str | int, tags: list[Tag]) -> None:
    import tifffile

    with tifffile.TiffWriter(path, byteorder="<") as writer:
        writer.write(
            raw.numbers,
            photometric=photometric,
            planarconfig="contig" if raw.numbers.ndim == 3 else None,
            description=json.dumps(raw.metadata, default=str).encode(),
            software=str(raw.metadata.get("software", "rptcam_cl")),
            metadata=None,
            extratags=tags,
        )


_WRITERS: dict[str, Callable[[Path, RawImage], None]] = {
    ".dng": _write_dng,
    ".tif": _write_tiff,
    ".tiff": _write_tiff,
    ".npy": _write_npy,
}
