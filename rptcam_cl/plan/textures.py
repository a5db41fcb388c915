"""Textures of the scene as records."""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kinds import TextureKind, Wrap
from rptcam_cl.core.records import TEXTURE
from rptcam_cl.plan.pictures import Colours, PictureTable
from rptcam_cl.scene import ImageTexture, Noise, Scene, Texture

Colour = tuple[float, float, float]
BLACK: Colour = (0.0, 0.0, 0.0)
UNLIMITED = float(np.finfo(np.float32).max)
_WRAPS = {"repeat": Wrap.REPEAT, "clamp": Wrap.CLAMP, "mirror": Wrap.MIRROR}


@dataclass(frozen=True)
class Textures:
    """What the kernels read of textures.

    Attributes
    ----------
    records : array of Texture
    texels : array of uint32
        Texels of all pictures, see ``kernels/material/image.h``.
    facts : dict
        Which kinds of texture there are.
    """

    records: NDArray[np.void]
    texels: NDArray[np.uint32]
    facts: dict[str, int]


class TextureTable:
    """Collects the textures of a scene as records."""

    def __init__(self, scene: Scene) -> None:
        self.pictures = PictureTable(scene)
        self._records: list[np.void] = []
        self._index: dict[tuple[int, float], int] = {}
        self._means: list[NDArray[np.float64]] = []
        self._origin: TextureTable | None = None

    def copied(self) -> TextureTable:
        """Return this table to be added to; its records are not to be changed."""
        other = copy.copy(self)
        other._origin, other.pictures = self, self.pictures.copied()
        other._records, other._index, other._means = self._records.copy(), self._index.copy(), self._means.copy()
        return other

    @property
    def unchanged_from(self) -> TextureTable | None:
        """The table that it is a copy of, where nothing was added since."""
        origin = self._origin
        return origin if origin is not None and len(self._records) == len(origin._records) else None

    def slot(self, value: Texture | Colour, *, limit: float) -> tuple[Colour, int]:
        """Return what a material's record holds of a colour: the colour and -1, or black and the index of a texture.

        Parameters
        ----------
        value
            A colour or a texture of the scene.
        limit
            Largest value that an image may give: 1 for reflectances, `UNLIMITED` for radiances.
        """
        if isinstance(value, tuple):
            return value, -1
        key = (id(value), limit)
        if key not in self._index:
            self._index[key] = len(self._records)
            self._records.append(self._record(value, limit))
        return BLACK, self._index[key]

    def mean(self, index: int) -> NDArray[np.float64]:
        """Return the mean colour over one repeat of the texture of an index."""
        return self._means[index]

    def add_sphere(self, colours: Colours, gain: float = 1.0) -> int:
        """Return the index of a picture of the whole sphere: it repeats in longitude and ends at the poles."""
        record: np.void = TEXTURE.zeros(1)[0]
        self._fill_image(record, colours, gain)
        record["wrap_u"], record["wrap_v"], record["limit"] = Wrap.REPEAT, Wrap.CLAMP, UNLIMITED
        self._records.append(record)
        return len(self._records) - 1

    def pack(self) -> Textures:
        """Return the records and texels of the textures so far."""
        records = TEXTURE.zeros(len(self._records))
        for index, record in enumerate(self._records):
            records[index] = record
        kinds = {int(self._records[index]["kind"]) for index in self._index.values()}  # what materials show
        facts = {f"HAS_{kind.name}": int(kind in kinds) for kind in TextureKind} | {"HAS_TEXTURE": int(bool(kinds))}
        return Textures(records, self.pictures.words(), facts)

    def _record(self, texture: Texture, limit: float) -> np.void:
        record: np.void = TEXTURE.zeros(1)[0]
        record["row_u"], record["row_v"] = _mapping(texture)
        if isinstance(texture, ImageTexture):
            self._fill_picture(record, texture, limit)
            return record
        record["kind"], record["parameter"] = TextureKind[texture.kind.upper()], texture.parameter
        if isinstance(texture, Noise):
            record["contrast"], record["octaves"], record["seed"] = texture.contrast, texture.octaves, texture.seed
        record["a"][:3], record["b"][:3] = texture.colours
        first, second = map(np.array, texture.colours)
        self._means.append((1 - texture.share) * first + texture.share * second)
        return record

    def _fill_picture(self, record: np.void, texture: ImageTexture, limit: float) -> None:
        colours = self.pictures.colours(texture, texture.channel, texture.color_space)
        self._fill_image(record, colours, texture.gain)
        record["wrap_u"] = record["wrap_v"] = _WRAPS[texture.wrap]
        record["nearest"], record["limit"] = texture.filter == "nearest", limit

    def _fill_image(self, record: np.void, colours: Colours, gain: float | tuple[float, float, float]) -> None:
        record["kind"], record["format"], record["first"] = (
            TextureKind.IMAGE,
            colours.form,
            self.pictures.place(colours),
        )
        record["height"], record["width"] = colours.size
        record["a"][:3] = np.multiply(gain, colours.scale)
        self._means.append(np.multiply(gain, colours.mean))


def _mapping(texture: Texture) -> NDArray[np.float64]:
    """Return the two rows that take (u, v, 1) to the pattern: scaled, turned, shifted."""
    quarters, rest = divmod(texture.rotation_degrees, 90)
    angle = np.deg2rad(rest)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn = turn @ np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), int(quarters) % 4)  # exact for right angles
    rows = np.zeros((2, 4))
    rows[:, :2] = turn * texture.scale
    rows[:, 2] = texture.offset
    return rows
