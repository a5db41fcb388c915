"""The pictures of a scene's textures: each file read once, each way of storing it packed once and remembered."""

from __future__ import annotations

import copy
import warnings
from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.pictures import Picture, read_picture
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.kinds import TexelFormat
from rptcam_cl.plan.texels import Texels, colour_texels, linear_mean, packed
from rptcam_cl.scene import FileReference, Scene

MOST_BYTES = 512 << 20  # of all that is kept; what alone is larger is not


class _Sized(Protocol):
    @property
    def nbytes(self) -> int: ...


Made = TypeVar("Made", bound=_Sized)
_kept: OrderedDict[str, Any] = OrderedDict()  # what was used last comes last
_lock = Lock()


def remembered(key: str, make: Callable[[], Made]) -> Made:
    """Return what was made under a key before, or what ``make`` returns.

    Parameters
    ----------
    key
        Contains everything that the result depends on, files by their content: a changed file changes the key.
    make
        Called where nothing is kept. The result is shared, so nobody may change it.
    """
    with _lock:
        if key in _kept:
            _kept.move_to_end(key)
            found: Made = _kept[key]
            return found
    made = make()
    with _lock:
        if made.nbytes <= MOST_BYTES:
            _kept[key] = made
        while sum(other.nbytes for other in _kept.values()) > MOST_BYTES:
            _kept.popitem(last=False)
    return made


def forget() -> None:
    """Make everything anew from now on."""
    with _lock:
        _kept.clear()


_MOST_WORDS = 1 << 32  # what a uint can index: 16 GiB


@dataclass(frozen=True, eq=False)
class Colours:
    """Red, green and blue of a picture as they are stored on the device.

    Attributes
    ----------
    words : array of uint32
        Texels as `rptcam_cl.plan.texels.packed` returns them.
    scale : float
        What a stored 1 stands for.
    size : (height, width)
    mean : (3,) array
        Mean linear colour.
    form : TexelFormat
    name : str
        Identifies it among all others.
    """

    words: NDArray[np.uint32]
    scale: float
    size: tuple[int, int]
    mean: NDArray[np.float64]
    form: TexelFormat
    name: str

    @classmethod
    def of(cls, texels: Texels, form: TexelFormat, name: str) -> Colours:
        """Return the colours of texels (height, width, 3), the top row first: bytes, or linear floats to be halves."""
        words, scale = packed(texels, form)
        words.flags.writeable = False
        return cls(words, scale, (texels.shape[0], texels.shape[1]), linear_mean(texels, form), form, name)

    @property
    def nbytes(self) -> int:
        """Size in memory."""
        return self.words.nbytes


@dataclass(frozen=True)
class _Traits:
    """What decides how a picture is stored."""

    has_alpha: bool
    encoded: bool
    nbytes: int = 64  # or so


class PictureTable:
    """Pictures by the content of their files, and the words of those that the device needs."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._pictures: dict[str, Picture] = {}
        self._places: dict[str, int] = {}
        self._words: list[NDArray[np.uint32]] = []
        self._count = 0

    def copied(self) -> PictureTable:
        """Return this table to be added to."""
        other = copy.copy(self)
        other._pictures, other._places, other._words = self._pictures.copy(), self._places.copy(), self._words.copy()
        return other

    def colours(self, reference: FileReference, channel: str, space: Literal["auto", "srgb", "linear"]) -> Colours:
        """Return the colours of the picture that a part of the scene names, or one of its channels as a grey.

        Raises
        ------
        InputError
            When the picture cannot be used, with the place in the scene.
        """
        content = self._scene.digest_of(reference)
        traits = remembered(f"traits {content}", lambda: self._traits(reference, content))
        if channel == "a" and not traits.has_alpha:
            raise InputError(f"{reference.place}has no alpha channel (allowed: channel rgb, r, g or b)")
        encoded = space == "srgb" or (space == "auto" and traits.encoded and channel == "rgb")
        name = f"{content} {channel} {encoded}"

        def stored() -> Colours:
            texels, form = colour_texels(self._picture(reference, content), channel, encoded=encoded)
            return Colours.of(texels, form, name)

        return remembered(f"colours {name}", stored)

    def _traits(self, reference: FileReference, content: str) -> _Traits:
        picture = self._picture(reference, content)
        return _Traits(picture.has_alpha, picture.encoded)

    def _picture(self, reference: FileReference, content: str) -> Picture:
        if content not in self._pictures:
            try:
                self._pictures[content] = found = read_picture(self._scene.content_of(reference))
            except InputError as problem:
                raise InputError(f"{reference.place}{problem}") from None
            if found.negative.count:
                warnings.warn(
                    f"{reference.place}{found.negative.count} of {found.width * found.height} texels are negative and"
                    f" count as black (least value {found.negative.least:.4g})",
                    UserWarning,
                    stacklevel=2,
                )
        return self._pictures[content]

    def place(self, colours: Colours) -> int:
        """Return the word where a picture's texels start.

        Raises
        ------
        InputError
            When the pictures are too many to count their words.
        """
        if colours.name not in self._places:
            self._places[colours.name] = self._count
            self._words.append(colours.words)
            self._count += len(colours.words)
            if self._count >= _MOST_WORDS:
                raise InputError("the pictures of the scene are too large together (allowed: 16 GiB)")
        return self._places[colours.name]

    def words(self) -> NDArray[np.uint32]:
        """Return the words of all pictures that have a place, and some more: kernels load four at a time."""
        return np.concatenate([*self._words, np.zeros(4, np.uint32)])
