"""The pictures of a scene's textures: each file read once, each way of storing it packed once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.kinds import TexelFormat
from rptcam_cl.pictures import Picture, read_picture
from rptcam_cl.plan.texels import Texels, colour_texels, packed
from rptcam_cl.scene.file_reference import FileReference
from rptcam_cl.scene.scene import Scene

_MOST_WORDS = 1 << 32  # what a uint can index: 16 GiB


@dataclass(frozen=True, eq=False)
class Colours:
    """Red, green and blue of a picture as they are stored on the device.

    Attributes
    ----------
    texels : (height, width, 3) array
        The top row first; encoded bytes, bytes or linear floats as ``form`` says.
    form : TexelFormat
    name : str
        Tells it from all others.
    """

    texels: Texels
    form: TexelFormat
    name: str


class PictureTable:
    """Pictures by the content of their files, and the words of those that the device needs."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._pictures: dict[str, Picture] = {}
        self._places: dict[str, tuple[int, float]] = {}
        self._words: list[NDArray[np.uint32]] = []
        self._count = 0

    def colours(self, reference: FileReference, channel: str, space: Literal["auto", "srgb", "linear"]) -> Colours:
        """Return the colours of the picture that a part of the scene names, or one of its channels as a grey.

        Raises
        ------
        InputError
            When the picture cannot be used, with the place in the scene.
        """
        name = self._scene.digest_of(reference)
        if name not in self._pictures:
            try:
                self._pictures[name] = read_picture(self._scene.content_of(reference))
            except InputError as problem:
                raise InputError(f"{reference.place}{problem}") from None
        picture = self._pictures[name]
        if channel == "a" and not picture.has_alpha:
            raise InputError(f"{reference.place}has no alpha channel (allowed: channel rgb, r, g or b)")
        encoded = space == "srgb" or (space == "auto" and picture.encoded and channel == "rgb")
        texels, form = colour_texels(picture, channel, encoded=encoded)
        return Colours(texels, form, f"{name} {channel} {encoded}")

    def place(self, colours: Colours) -> tuple[int, float]:
        """Return the word where a picture's texels start and what a stored 1 stands for; pack it when it is new.

        Raises
        ------
        InputError
            When the pictures are too many to count their words.
        """
        if colours.name not in self._places:
            words, scale = packed(colours.texels, colours.form)
            self._places[colours.name] = self._count, scale
            self._words.append(words)
            self._count += len(words)
            if self._count >= _MOST_WORDS:
                raise InputError("the pictures of the scene are too large together (allowed: 16 GiB)")
        return self._places[colours.name]

    def words(self) -> NDArray[np.uint32]:
        """Return the words of all pictures that have a place, and some more: kernels load four at a time."""
        return np.concatenate([*self._words, np.zeros(4, np.uint32)])
