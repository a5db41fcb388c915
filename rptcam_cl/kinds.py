"""Kinds of texture, emitter and environment, numbered as the records and the kernels have them."""

from __future__ import annotations

from enum import IntEnum


class TextureKind(IntEnum):
    """Kinds of texture."""

    CHECKER = 0
    GRID = 1
    GRADIENT = 2
    NOISE = 3
    IMAGE = 4


class TexelFormat(IntEnum):
    """How the texels of an image are stored."""

    SRGB = 0  # one word: red, green, blue of 8 bits from the low byte on
    LINEAR = 1  # the same, not encoded
    HALF = 2  # two words: red and green, blue as halves


class Wrap(IntEnum):
    """What continues an image beyond its edges."""

    REPEAT = 0
    CLAMP = 1
    MIRROR = 2


class EmitterKind(IntEnum):
    """Kinds of emitter that light sampling can choose."""

    RECTANGLE = 0
    DISK = 1
    SPHERE = 2
    POINT = 3
    DIRECTIONAL = 4
    TRIANGLE = 5
    SPOT = 6
    PROFILE = 7  # a point whose intensity in each direction is a picture
    SUN = 8
    ENVIRONMENT = 9


class EnvironmentKind(IntEnum):
    """What surrounds the scene."""

    NONE = 0
    CONSTANT = 1
    GRADIENT = 2
    IMAGE = 3
