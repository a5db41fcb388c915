"""Kinds shared by host and device: the OpenCL constants are derived from the enumerations here."""

from __future__ import annotations

from enum import IntEnum


class Kind(IntEnum):
    """Kinds of primitive, in the order in which they are sorted."""

    SPHERE = 0
    ELLIPSOID = 1
    RECTANGLE = 2
    DISK = 3
    PLANE = 4
    BOX = 5
    CYLINDER = 6
    CONE = 7
    MESH = 8


class MaterialKind(IntEnum):
    """Kinds of material."""

    MATTE = 0
    MIRROR = 1
    CONDUCTOR = 2
    DIELECTRIC = 3
    EMISSIVE = 4
    METAL = 5  # a conductor by its optical constants
    ROUGH_DIELECTRIC = 6
    PLASTIC = 7  # with a smooth cover
    ROUGH_PLASTIC = 8
    THIN_GLASS = 9
    PRINCIPLED = 10
    MIX = 11


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
    BOX = 10  # this one and those below are solids, see kernels/light/solids.h
    ELLIPSOID = 11
    CYLINDER = 12
    CONE = 13


class EnvironmentKind(IntEnum):
    """What surrounds the scene."""

    NONE = 0
    CONSTANT = 1
    GRADIENT = 2
    IMAGE = 3


class SpectrumKind(IntEnum):
    """What the three numbers of a path's light are."""

    RGB = 0  # red, green, blue
    DISPERSIVE = 1  # the same, of light of one wavelength
    SPECTRAL = 2  # at three wavelengths


class RayStatus(IntEnum):
    """What became of a ray in a lens; the values agree with `rptcam_cl.optics.Status`."""

    OK = 0
    MISSED = 1
    CLIPPED = 2
    TOTAL_INTERNAL_REFLECTION = 3
    NO_CONVERGENCE = 4


class SurfaceKind(IntEnum):
    """Kinds of lens surface, by what must be solved to meet them."""

    SPHERE = 0
    CONIC_KIND = 1
    ASPHERE = 2
    BICONIC = 3
    TOROID = 4


class PupilKind(IntEnum):
    """How a lens camera chooses where its rays aim."""

    CIRCLE = 0
    BOXES = 1
    OUTLINES = 2


class RegionKind(IntEnum):
    """What the clear region of a lens surface does."""

    NONE = 0
    BLOCKS = 1
    OPENS = 2  # first surface of a half lens: rays outside pass beside it
    GOES_ON = 3  # a further surface of it


class StopKind(IntEnum):
    """The shape of a stop within its circle."""

    ROUND = 0
    OUTLINE = 1  # a polygon
    MASK = 2  # the open cells of a square


_PREFIXES: dict[str, type[IntEnum]] = {
    "LENS": SurfaceKind,
    "REGION": RegionKind,
    "PUPIL": PupilKind,
    "STOP": StopKind,
    "KIND": Kind,
    "MATERIAL": MaterialKind,
    "TEXTURE": TextureKind,
    "TEXEL": TexelFormat,
    "WRAP": Wrap,
    "EMITTER": EmitterKind,
    "ENVIRONMENT": EnvironmentKind,
    "SPECTRUM": SpectrumKind,
    "RAY": RayStatus,
}


def kind_constants() -> list[str]:
    """Return a line of OpenCL C per member of every enumeration that kernels name."""
    return [f"#define {prefix}_{kind.name} {kind.value}" for prefix, kinds in _PREFIXES.items() for kind in kinds]
