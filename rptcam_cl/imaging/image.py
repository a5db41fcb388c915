"""A rendered film with its metadata, statistics and layers, and the pictures that are developed from it."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging import truth_files, writers
from rptcam_cl.imaging.denoise import GUIDES, denoised
from rptcam_cl.imaging.development import PLAIN, Development, developed_values
from rptcam_cl.imaging.layers import Layer, check_layers
from rptcam_cl.imaging.raw import RawImage
from rptcam_cl.imaging.raw_frame import exposed
from rptcam_cl.imaging.sensor import SensorModel

SENSOR = "sensor"  # where metadata keep the sensor behind the film


@dataclass(frozen=True, eq=False)
class Image:
    """The linear film of a render. ``numpy.asarray(image)`` is `pixels`; a notebook shows it as a picture.

    ``image["depth"]`` is the layer of that name.

    Raises
    ------
    InputError
        The pixels are not float32 of shape (height, width, 3), or a layer is unknown or of another size.
    """

    pixels: NDArray[np.float32]
    """(height, width, 3), linear RGB, top row first."""
    metadata: dict[str, Any] = field(default_factory=dict)
    """Where the picture comes from (scene hash, seed, spp, lens, device, version, ...); kept in the files."""
    stats: dict[str, Any] = field(default_factory=dict)
    """What the render took and met (samples, seconds, rays that the lens blocked, ...)."""
    development: Development = PLAIN
    """How the film is developed where it is shown or saved as a picture."""
    layers: Mapping[str, Layer] = field(default_factory=dict)
    """Auxiliary layers by name, (height, width) or (height, width, channels)."""

    def __post_init__(self) -> None:
        shape, kind = np.shape(self.pixels), getattr(self.pixels, "dtype", type(self.pixels).__name__)
        if len(shape) != 3 or shape[2] != 3 or 0 in shape:
            raise InputError(f"pixels: wrong shape (got {shape}; allowed (height, width, 3))")
        if kind != np.float32:
            raise InputError(f"pixels: wrong kind of numbers (got {kind}; allowed a numpy array of float32)")
        check_layers(self.layers, self.height, self.width)

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.pixels.shape[1])

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.pixels.shape[0])

    @property
    def luminance(self) -> NDArray[np.float64]:
        """Luminance of the film, (height, width), linear."""
        return np.asarray(luminance(self.pixels))

    @cached_property
    def seen(self) -> NDArray[np.float32]:
        """What pictures show, (height, width, 3), linear: what the scene's sensor makes of the film, or the film."""
        return self.raw().linear() if self.has_sensor else self.pixels

    @property
    def has_sensor(self) -> bool:
        """Whether a sensor is behind the film."""
        return SENSOR in self.metadata

    def raw(self) -> RawImage:
        """Return the numbers that the scene's sensor puts out for this film; the same ones each time.

        Raises
        ------
        InputError
            The scene has no sensor.
        """
        if not self.has_sensor:
            raise InputError("the image has no raw numbers (allowed: with a sensor in the scene, as `sensor: {}`)")
        return self._raw

    @cached_property
    def _raw(self) -> RawImage:
        return RawImage(exposed(self.pixels, SensorModel.from_description(self.metadata[SENSOR])), self.metadata)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save by suffix.

        ``.png``, ``.tif`` and ``.tiff``: developed, of 8 or 16 bits. ``.jpg`` and ``.jpeg``: developed, of 8 bits, with
        losses. ``.exr``: linear, with layers and metadata.
        ``.npy``: the linear array alone. ``.npz``: the linear array as ``rgb``, every layer by its name, and
        ``metadata`` as JSON text.

        The file is written whole or not at all.

        Raises
        ------
        InputError
            The suffix is not one of these.
        StateError
            The file cannot be written.
        """
        pixels = self.seen if writers.is_developed(path) else self.pixels
        writers.write(path, pixels, self.metadata, self.development, self.layers)

    def developed(self) -> NDArray[np.float32]:
        """Return the picture as a screen shows it, (height, width, 3) from 0 to 1; see docs/picture.md."""
        return developed_values(self.seen, self.development, writers.film_part(self.metadata, self.seen))

    def denoised(self) -> Image:
        """Return the image with its noise removed, guided by its layers ``albedo`` and ``normal``; see docs/layers.md.

        Raises
        ------
        InputError
            A layer is missing, or the denoiser is.
        """
        if missing := [name for name in GUIDES if name not in self.layers]:
            raise InputError(f"denoising needs the layers {' and '.join(GUIDES)} (missing: {', '.join(missing)})")
        pixels, how = denoised(self.pixels, self["albedo"], self["normal"])
        stated = {"denoised": how}
        return replace(self, pixels=pixels, metadata=self.metadata | stated, stats=self.stats | stated)

    def coco(self, file_name: str = "picture.png", *, image_id: int | None = None) -> dict[str, Any]:
        """Return COCO annotations by the layers ``sharp_object_id`` and ``sharp_class_id``; see docs/ground-truth.md.

        Parameters
        ----------
        file_name
            Of the picture.
        image_id
            Its number, 0 or more, among pictures whose annotations are to be joined; each has identifiers of its own.

        Raises
        ------
        InputError
            A layer is missing.
        """
        return truth_files.coco(self.layers, self.metadata, file_name, image_id)

    def save_truth(
        self,
        folder: str | os.PathLike[str],
        file_name: str = "picture.png",
        *,
        image_id: int | None = None,
        prefix: str = "",
    ) -> list[Path]:
        """Write COCO annotations, masks and the rays of pixels into a folder, and return the files.

        Parameters
        ----------
        folder
            Made if it is missing.
        file_name, image_id
            As for `coco`.
        prefix
            What the names of the files begin with.

        Raises
        ------
        InputError
            A layer is missing.
        StateError
            A file cannot be written.
        """
        return truth_files.save_truth(
            Path(folder), self.layers, self.metadata, file_name, image_id=image_id, prefix=prefix
        )

    def __getitem__(self, name: str) -> Layer:
        try:
            return self.layers[name]
        except KeyError:
            held = ", ".join(self.layers) or 'none; name them when rendering, as layers=["depth"]'
            raise KeyError(f"no layer {name!r} (layers of this image: {held})") from None

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is False and dtype is not None and np.dtype(dtype) != self.pixels.dtype:
            raise ValueError(f"the film is float32; {np.dtype(dtype)} needs a copy")
        return np.array(self.pixels, dtype=dtype) if copy else np.asarray(self.pixels, dtype=dtype)

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        writers.png_to(stream, self.seen, self.metadata, self.development, writers.PNG_BITS)
        return stream.getvalue()

    def __repr__(self) -> str:
        mean, spp = self.metadata.get("spp_mean"), self.metadata.get("spp")
        spp = f"{mean:.0f}" if isinstance(mean, float) else spp
        return f"<Image {self.width} x {self.height}" + (f", {spp} spp>" if spp is not None else ">")
