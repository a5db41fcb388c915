"""Records shared by host and device, declared once: the numpy dtypes and the OpenCL typedefs come from here.

Members are ``float``, ``int``, ``uint``, ``float4`` and ``uint2`` only; 16-byte members stand on multiples of 16, and a
record that stands in arrays is a multiple of 16 bytes long, so that no compiler pads it. A device test checks this.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

_NUMPY_TYPE: dict[str, tuple[str, tuple[int, ...]]] = {
    "float": ("<f4", ()),
    "int": ("<i4", ()),
    "uint": ("<u4", ()),
    "float4": ("<f4", (4,)),
    "uint2": ("<u4", (2,)),
}


@dataclass(frozen=True)
class Record:
    """A struct of the device: name and ``(type, member)`` pairs in order."""

    name: str
    members: tuple[tuple[str, str], ...]

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The numpy structured type with the same layout."""
        return np.dtype([(member, *_NUMPY_TYPE[kind]) for kind, member in self.members])

    @property
    def typedef(self) -> str:
        """The OpenCL C declaration."""
        body = " ".join(f"{kind} {member};" for kind, member in self.members)
        return f"typedef struct {{ {body} }} {self.name};"

    def zeros(self, count: int) -> NDArray[np.void]:
        """An array of ``count`` (at least one, as OpenCL has no empty buffers) zeroed records."""
        return np.zeros(max(count, 1), self.dtype)


PRIMITIVE = Record(
    "Primitive",
    (
        ("float4", "row_x"),  # rows of object_from_world; of a sphere: centre and radius, x axis and handedness, z axis
        ("float4", "row_y"),
        ("float4", "row_z"),
        ("int", "material"),
        ("int", "emitter"),  # index of the sampled emitter, or -1
        ("int", "reserved_0"),
        ("int", "reserved_1"),
    ),
)

MATERIAL = Record(
    "Material",
    (
        ("float4", "color"),  # reflectance, or radiance of an emissive material
        ("float4", "other"),  # second colour of a texture
        ("float4", "mapping"),  # scale u, v and offset u, v of a texture
        ("int", "kind"),
        ("int", "texture"),
        ("float", "parameter"),  # GGX alpha; index of refraction; 1 if an emissive material shines on both sides
        ("float", "line_width"),
    ),
)

EMITTER = Record(
    "Emitter",
    (
        ("float4", "a"),  # corner, centre or position; w: area, or radius of a sphere
        ("float4", "u"),  # edge, or axis of a disk
        ("float4", "v"),
        ("float4", "normal"),  # or the direction towards a directional light
        ("float4", "radiance"),  # radiance, intensity or irradiance
        ("int", "kind"),
        ("int", "primitive"),
        ("int", "two_sided"),
        ("float", "pick"),  # probability of being picked
        ("float", "alias_keep"),
        ("int", "alias_other"),
        ("int", "reserved_0"),
        ("int", "reserved_1"),
    ),
)

ENVIRONMENT = Record("Environment", (("float4", "bottom"), ("float4", "top"), ("float4", "up")))

SURFACE = Record(
    "Surface",
    (
        ("float", "curvature"),  # 1/mm, positive when the centre lies ahead in the direction of travel
        ("float", "gap"),  # mm from the previous vertex along the direction of travel
        ("float", "semi_diameter2"),  # mm^2
        ("float", "eta"),  # index before over index after, in the direction of travel
    ),
)

CAMERA = Record(
    "Camera",
    (
        ("float4", "right"),
        ("float4", "up"),
        ("float4", "back"),
        ("float4", "resolution"),  # width, height [pixels]; sign / width, sign / height
        ("float4", "a"),  # of the camera model, see kernels/camera
        ("float4", "b"),
        ("int", "count"),
        ("int", "reserved_0"),
        ("int", "reserved_1"),
        ("int", "reserved_2"),
    ),
)

WAVE = Record(
    "Wave",
    (
        ("uint2", "seed"),
        ("uint", "first_pixel"),  # in tile order
        ("uint", "pixels"),  # of the wave, a multiple of 16
        ("uint", "first_sample"),
        ("uint", "samples"),  # per pixel in this wave
        ("uint", "tiles_across"),
        ("int", "width"),  # of the cropped film
        ("int", "height"),
        ("int", "full_width"),
        ("int", "crop_x"),
        ("int", "crop_y"),
    ),
)

LIMITS = Record(
    "Limits",
    (
        ("uint", "max_edges"),  # of a path, the camera's included
        ("uint", "roulette_edge"),  # from which on Russian roulette may end a path; 0: never
        ("int", "emitters"),
    ),
)

RECORDS = (PRIMITIVE, MATERIAL, EMITTER, ENVIRONMENT, SURFACE, CAMERA, WAVE, LIMITS)


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


class MaterialKind(IntEnum):
    """Kinds of material."""

    MATTE = 0
    MIRROR = 1
    CONDUCTOR = 2
    DIELECTRIC = 3
    EMISSIVE = 4


class TextureKind(IntEnum):
    """Kinds of texture."""

    CONSTANT = 0
    CHECKER = 1
    GRID = 2


class EmitterKind(IntEnum):
    """Kinds of emitter that light sampling can choose."""

    RECTANGLE = 0
    DISK = 1
    SPHERE = 2
    POINT = 3
    DIRECTIONAL = 4


class EnvironmentKind(IntEnum):
    """What surrounds the scene."""

    NONE = 0
    CONSTANT = 1
    GRADIENT = 2


class RayStatus(IntEnum):
    """What became of a ray in a lens; the values agree with `rptcam_cl.optics.Status`."""

    OK = 0
    MISSED = 1
    CLIPPED = 2
    TOTAL_INTERNAL_REFLECTION = 3


CAMERA_RAY_FLOATS = 8  # origin, weight, direction and one to fill up: what the stream reads per slot
PATH_FIELDS = ("OX", "OY", "OZ", "DX", "DY", "DZ", "BX", "BY", "BZ", "LX", "LY", "LZ", "SELF", "HIT", "T")
SHADOW_FIELDS = ("SX", "SY", "SZ", "WX", "WY", "WZ", "CX", "CY", "CZ")
LIGHT_FIELDS = ("PDF", "REACH", "FROM", "TARGET", *SHADOW_FIELDS)


def floats_per_slot(*, stream: bool, emitters: bool) -> int:
    """Return how many 4-byte numbers a slot holds.

    Camera rays for the stream; otherwise whole paths, with shadow rays where the scene has emitters to sample.
    """
    if stream:
        return CAMERA_RAY_FLOATS
    return len(PATH_FIELDS + LIGHT_FIELDS if emitters else PATH_FIELDS)


def _constants(prefix: str, kinds: type[IntEnum]) -> list[str]:
    return [f"#define {prefix}_{kind.name} {kind.value}" for kind in kinds]


def device_declarations() -> str:
    """OpenCL C text with every record, kind and path field, for the head of a program."""
    lines = [record.typedef for record in RECORDS]
    lines += _constants("KIND", Kind) + _constants("MATERIAL", MaterialKind) + _constants("TEXTURE", TextureKind)
    lines += (
        _constants("EMITTER", EmitterKind) + _constants("ENVIRONMENT", EnvironmentKind) + _constants("RAY", RayStatus)
    )
    lines.append(f"#define RAY_STATUS_COUNT {len(RayStatus)}")
    lines += [f"#define PATH_{name} {index}" for index, name in enumerate(PATH_FIELDS + LIGHT_FIELDS)]
    return "\n".join(lines) + "\n"
