"""Textures of the scene as records, and the texels of their pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.pictures import Picture, read_picture
from rptcam_cl.plan.texels import colour_texels, linear_mean, packed
from rptcam_cl.records import TEXTURE, TextureKind, Wrap
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.texture import Checker, Gradient, Grid, ImageTexture, Noise, Texture

Colour = tuple[float, float, float]
_NOISE_SPREAD = 1.0  # standard deviation 0.24 about 0.5 at contrast 1
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
    """Collects the textures of a scene; each is one record, and a picture that several read is read once."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._records: list[np.void] = []
        self._index: dict[tuple[int, float], int] = {}
        self._means: dict[int, NDArray[np.float64]] = {}
        self._pictures: dict[str, Picture] = {}
        self._blocks: dict[tuple[str, str, int], tuple[int, float]] = {}
        self._texels: list[NDArray[np.uint32]] = []
        self._words = 0

    def slot(self, value: Texture | Colour, *, limit: float) -> tuple[Colour, int]:
        """Return what a material's record holds of a colour: the colour and -1, or black and the index of a texture.

        Parameters
        ----------
        value
            A colour or a texture of the scene.
        limit
            Largest value that an image may give: 1 for reflectances.
        """
        if isinstance(value, tuple):
            return value, -1
        key = (id(value), limit)
        if key not in self._index:
            self._index[key] = len(self._records)
            self._records.append(self._record(value, limit))
        return (0.0, 0.0, 0.0), self._index[key]

    def mean(self, index: int) -> NDArray[np.float64]:
        """Return the mean colour over one repeat of the texture of an index."""
        if index not in self._means:
            record = self._records[index]
            share = {TextureKind.GRID: 1 - (1 - float(record["parameter"])) ** 2}.get(TextureKind(record["kind"]), 0.5)
            self._means[index] = (1 - share) * record["a"][:3].astype(np.float64) + share * record["b"][:3]
        return self._means[index]

    def pack(self) -> Textures:
        """Return the records and texels of the textures so far."""
        records = TEXTURE.zeros(len(self._records))
        for index, record in enumerate(self._records):
            records[index] = record
        kinds = {int(record["kind"]) for record in self._records}
        facts = {f"HAS_{kind.name}": int(kind in kinds) for kind in TextureKind} | {"HAS_TEXTURE": int(bool(kinds))}
        return Textures(records, np.concatenate([*self._texels, np.zeros(4, np.uint32)]), facts)

    def _record(self, texture: Texture, limit: float) -> np.void:
        record: np.void = TEXTURE.zeros(1)[0]
        record["row_u"], record["row_v"] = _mapping(texture)
        match texture:
            case Checker():
                colours, record["kind"] = (texture.even, texture.odd), TextureKind.CHECKER
            case Grid():
                colours, record["kind"] = (texture.background, texture.line), TextureKind.GRID
                record["parameter"] = texture.line_width
            case Gradient():
                colours, record["kind"] = (texture.start, texture.end), TextureKind.GRADIENT
            case Noise():
                colours, record["kind"] = (texture.low, texture.high), TextureKind.NOISE
                record["parameter"], record["contrast"] = texture.gain, _NOISE_SPREAD * texture.contrast
                record["octaves"], record["seed"] = texture.octaves, texture.seed
            case ImageTexture():
                colours, record["kind"] = self._image(record, texture), TextureKind.IMAGE
                record["limit"] = limit
        record["a"][:3], record["b"][:3] = colours
        return record

    def _image(self, record: np.void, texture: ImageTexture) -> tuple[Colour, Colour]:
        """Fill in where the texels of an image are and how they are read; return its gain as a colour, and black."""
        picture, name = self._picture(texture)
        if texture.channel == "a" and not picture.has_alpha:
            raise InputError(f"{texture.place}has no alpha channel (allowed: channel rgb, r, g or b)")
        encoded = texture.color_space == "srgb" or (
            texture.color_space == "auto" and picture.encoded and texture.channel == "rgb"
        )
        colours, form = colour_texels(picture, texture.channel, encoded=encoded)
        key = (name, texture.channel, int(form))
        if key not in self._blocks:
            words, scale = packed(colours, form)
            self._blocks[key] = self._words, scale
            self._texels.append(words)
            self._words += len(words)
        first, scale = self._blocks[key]
        if first + (picture.width + 1) * picture.height * 2 >= 1 << 32:
            raise InputError(f"{texture.place}is one picture too many: all together have more than 16 GiB of texels")
        record["first"], record["width"], record["height"] = first, picture.width, picture.height
        record["format"], record["wrap"] = form, _WRAPS[texture.wrap]
        record["nearest"] = texture.filter == "nearest"
        self._means[len(self._records)] = texture.gain * linear_mean(colours, form)
        gain = texture.gain * scale
        return (gain, gain, gain), (0.0, 0.0, 0.0)

    def _picture(self, texture: ImageTexture) -> tuple[Picture, str]:
        name = self._scene.digest_of(texture)
        if name not in self._pictures:
            try:
                self._pictures[name] = read_picture(self._scene.content_of(texture))
            except InputError as problem:
                raise InputError(f"{texture.place}{problem}") from None
        return self._pictures[name], name


def _mapping(texture: Texture) -> NDArray[np.float64]:
    """Return the two rows that take (u, v, 1) to the pattern: scaled, turned, shifted."""
    angle = np.deg2rad(texture.rotation_degrees)
    sine, cosine = (
        float(f(angle)) if texture.rotation_degrees % 90 else round(float(f(angle))) for f in (np.sin, np.cos)
    )
    turn = np.array([[cosine, -sine], [sine, cosine]])
    rows = np.zeros((2, 4))
    rows[:, :2] = turn * texture.scale
    rows[:, 2] = texture.offset
    return rows
