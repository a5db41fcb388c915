"""Records, kinds and constants that host and device share, declared once: numpy types and OpenCL text follow."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass

#
# A record that host and device share: one declaration, the numpy dtype and the OpenCL typedef come from it.
#
# Members are ``float``, ``int``, ``uint``, ``float4``, ``uint2``, ``real`` (float or double, with arrays of it), and
# records of ``float`` and ``int``. Members of 16 bytes stand on multiples of 16, and a record that stands in arrays
# is a multiple of 16 bytes long, so that no compiler pads it. A device test checks this.

_MEMBER = re.compile(r"(\w+)(?:\[(\d+)\])?")
_NUMPY_TYPE: dict[str, tuple[str, tuple[int, ...]]] = {
    "float": ("<f4", ()),
    "int": ("<i4", ()),
    "uint": ("<u4", ()),
    "float4": ("<f4", (4,)),
    "uint2": ("<u4", (2,)),
}


@dataclass(frozen=True)
class Record:
    """A struct of the device: name and ``(type, member)`` pairs in order; of a union the members lie upon each other.

    A type is one of OpenCL C or a record that stands before. ``facts`` are pairs of a fact that kernels are compiled
    for and the member that it follows from: it is 1 where some record has an index there, which is not negative.
    """

    name: str
    members: tuple[tuple[str | Record, str], ...]
    is_union: bool = False
    facts: tuple[tuple[str, str], ...] = ()

    @cache  # noqa: B019 -- records are declared once
    def dtype_of(self, real: str) -> np.dtype[np.void]:
        """Return the numpy structured type with the same layout; ``real`` is the numpy type of ``real`` members."""
        names, formats = [], []
        for kind, member in self.members:
            name, length = _split(member)
            names.append(name)
            if isinstance(kind, Record):
                formats.append(np.dtype((kind.dtype_of(real), length)))
            else:
                scalar, shape = (real, ()) if kind == "real" else _NUMPY_TYPE[kind]
                formats.append(np.dtype((scalar, shape + length)))
        if self.is_union:
            return np.dtype({"names": names, "formats": formats, "offsets": [0] * len(names)})
        return np.dtype({"names": names, "formats": formats})

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The numpy structured type with the same layout, ``real`` being float32."""
        return self.dtype_of("<f4")

    @property
    def typedef(self) -> str:
        """The OpenCL C declaration."""
        types = [kind.name if isinstance(kind, Record) else kind for kind, _ in self.members]
        body = " ".join(f"{kind} {member};" for kind, (_, member) in zip(types, self.members, strict=True))
        return f"typedef {'union' if self.is_union else 'struct'} {{ {body} }} {self.name};"

    def zeros(self, count: int, real: str = "<f4") -> NDArray[np.void]:
        """An array of ``count`` (at least one, as OpenCL has no empty buffers) zeroed records."""
        return np.zeros(max(count, 1), self.dtype_of(real))

    def one(self, **values: Any) -> NDArray[np.void]:
        """An array of a single record with these values, as `fill` writes them."""
        records = self.zeros(1)
        fill(records, **values)
        return records

    def facts_of(self, records: NDArray[np.void]) -> dict[str, int]:
        """Return the facts that follow from the members of some records."""
        return {fact: int(np.any(records[member] >= 0)) for fact, member in self.facts}


def declare(
    name: str, *members: tuple[str | Record, str], is_union: bool = False, facts: tuple[tuple[str, str], ...] = ()
) -> Record:
    """Return a record of types and members, as in C: members of one type that belong together may share it."""
    return Record(name, tuple((kind, each) for kind, names in members for each in names.split()), is_union, facts)


def fill(records: NDArray[np.void] | np.void, **values: Any) -> None:
    """Write members of a record, or of all of an array, by their names; short vectors fill the first numbers."""
    for name, value in values.items():
        if records.dtype[name].shape and np.ndim(value):
            records[name][..., : np.shape(value)[-1]] = value
        else:
            records[name] = value


def _split(member: str) -> tuple[str, tuple[int, ...]]:
    match = _MEMBER.fullmatch(member)
    assert match is not None
    return match[1], (int(match[2]),) if match[2] else ()


# The records of cameras and their lenses; see `rptcam_cl.core.records`.

DISPERSION_TERMS = 12
DISPERSION_NM = (380.0, 780.0)  # wavelengths that the polynomials in x = scale / wavelength - shift, -1 to 1, are for
DISPERSION_SCALE = 2.0 / (1.0 / DISPERSION_NM[0] - 1.0 / DISPERSION_NM[1])
DISPERSION_SHIFT = (DISPERSION_NM[1] + DISPERSION_NM[0]) / (DISPERSION_NM[1] - DISPERSION_NM[0])

EVEN_TERMS = 12
ODD_TERMS = 12
LOSS_TABLE_NM, LOSS_TABLE_LENGTH = 380, 401  # one number per nm
MOST_LAYERS = 12  # of a stack on a surface

SURFACE = declare(
    "Surface",
    # All in the frame of travel: millimetres, z along the direction of travel.
    ("real", "curvature"),  # positive when the centre lies ahead
    ("real", "gap"),  # from the previous vertex
    ("real", "semi_diameter2"),
    ("real", "eta"),  # index before over index after
    ("real", "conic"),
    ("real", "weight_x weight_y"),  # 1, or 0 where a cylinder is straight
    ("real", "half_width half_height edge edge_x edge_y"),  # region
    ("real", "centre_x centre_y"),  # of the rectangle and the circles of the region
    ("real", "radius2 inner_radius2"),
    ("real", "stop_radius"),  # half the side of a mask
    ("real", "refracts"),  # 0 where the media before and after are the same, -1 where a mirror turns z round
    ("real", f"even[{EVEN_TERMS}]"),  # coefficients of r^2, r^4, ...
    ("real", f"odd[{ODD_TERMS}]"),  # coefficients of r, r^3, ...
    ("real", "offset[4]"),  # pose
    ("real", "rotation[12]"),  # rows of a 3x3 matrix
    ("real", f"dispersion[{DISPERSION_TERMS}]"),  # eta over the inverse wavelength, constant first
    ("real", "layer"),  # index of a quarter-wave layer, 0 without one; these are for kernels/lens/coating.h
    ("real", "layer_turns"),  # turns of its phase at a right angle; with tables times the wavelength [nm]
    ("real", f"stack[{2 * MOST_LAYERS}]"),  # of layers from behind: index, turns of the phase as above, halved
    ("real", f"extinction[{MOST_LAYERS}]"),  # of the same layers
    ("real", "index"),  # before the surface
    ("real", "gain"),  # of the transmittance over that of the bare surface
    ("real", "attenuation"),  # before the surface [1/mm], 0 before the first one
    ("real", "inner_semi_diameter2"),
    ("real", "own[4]"),  # what a kind with numbers of its own writes in its `fill`
    ("int", "kind even_terms odd_terms posed region inverted"),
    ("int", "stop_count"),  # edges of the outline, or cells along a side of the mask, that shape the stop
    ("int", "stop_shape"),
    ("int", "index_table"),  # where tables over the wavelength stand behind the shape of the stop, -1 without one
    ("int", "gain_table attenuation_table"),
    ("int", "stacked"),  # layers of the stack
)

PINHOLE_CAMERA = declare(
    "PinholeCamera",
    ("float", "half_width half_height"),  # tangents of half the field; of a parallel view half widths [m]
    ("float", "near_distance"),  # [m]
)

THIN_LENS_CAMERA = declare(
    "ThinLensCamera",
    ("float", "half_width half_height"),  # tangents of half the field of view
    ("float", "focus_distance"),  # of the plane of focus [m]
    ("float", "aperture_radius"),  # [m]
)

THICK_LENS_CAMERA = declare(
    "ThickLensCamera",
    ("float", "film_half_width film_half_height"),  # [mm]
    ("float", "weight"),  # of a ray along the axis
    ("float", "metres_per_mm"),
    ("float", "first_vertex_z"),  # in the camera's frame [m]
    ("float", "film_slope_per_film"),  # slope at the film per mm of the film point
    ("float", "film_slope_per_pupil"),  # and per radius of the pupil
    ("float", "height_per_film"),  # height in the plane of the first vertex [mm], likewise
    ("float", "height_per_pupil"),
    ("float", "slope_per_film"),  # slope in the scene, likewise
    ("float", "slope_per_pupil"),
)

PUPIL_CIRCLE = declare(
    "PupilCircle",
    ("float", "shift"),  # of its centre per mm of the film point
    ("float", "radius"),  # [mm]
)

PUPIL_GRID = declare(
    "PupilGrid",  # cells of boxes, or outlines along a film radius, whole numbers of them
    ("float", "per_mm_across per_mm_down across down"),
)

PUPIL_LINES = declare(
    "PupilLines",  # outlines along lines from the axis outwards, whole numbers of them
    ("float", "per_quarter"),  # lines in a quarter of a turn
    ("float", "nodes"),  # of a line
    ("float", "lines"),
)

PUPIL = declare(
    "Pupil",  # see kernels/lens/pupil.h
    (PUPIL_CIRCLE, "circle"),
    (PUPIL_GRID, "grid"),
    (PUPIL_LINES, "lines"),
    is_union=True,
)

REALISTIC_CAMERA = declare(
    "RealisticCamera",
    ("float", "film_half_width film_half_height"),  # [mm]
    ("float", "film_distance"),  # from the film to the last vertex [mm]
    ("float", "gain"),  # of every ray's weight
    ("float", "metres_per_mm"),
    ("float", "first_vertex_z"),  # in the camera's frame [m]
    ("int", "surfaces"),
    ("int", "first_polynomial"),  # where they stand behind the pupil's table
    (PUPIL, "pupil"),
)

OWN_CAMERA = declare(
    "OwnCamera",  # what a camera of each kind has of its own; an environment camera has nothing
    (PINHOLE_CAMERA, "pinhole"),
    (THIN_LENS_CAMERA, "thin_lens"),
    (THICK_LENS_CAMERA, "thick_lens"),
    (REALISTIC_CAMERA, "realistic"),
    is_union=True,
)

HALF_PUPIL = declare(
    "HalfPupil",  # see kernels/lens/half_pupil.h
    ("float", "normal_x normal_y"),  # of the line that parts the pupil
    ("float", "offset"),  # of the line along its normal
    ("float", "share"),  # of the film point by which the line moves
    ("int", "beyond"),  # whether the half beyond the line is meant
)

CAMERA = declare(
    "Camera",
    ("float4", "right up back"),
    # Of a film that is moved (cameras/setting.py), x to the right, y up, z away from the lens: [mm], or in
    # film distances of a camera without a lens of surfaces.
    ("float4", "film_centre"),  # w: 1 / film distance [1/m]
    ("float4", "film_across"),  # half the film
    ("float4", "film_up"),
    ("float4", "film_normal"),  # unit
    # Of a lens whose axis is folded: rows of scene_from_lens, w: the origin of the lens [mm]
    ("float4", "fold_x fold_y fold_z"),
    ("float", "width"),  # [pixels]
    ("float", "height"),
    ("float", "per_width per_height"),  # 1 / width, negative where the picture is shown as it lies on the film
    ("float", "exposure"),  # factor of every ray's weight
    ("float", "wavelength"),  # of all rays, where they have one [nm]
    (HALF_PUPIL, "half_pupil"),
    (OWN_CAMERA, "own"),
    ("int", "lamp_table"),  # see kernels/lens/lamp_aim.h: where it stands among the tables
    ("int", "lamp_across lamp_down"),  # blocks of pixels
    ("int", "lamp_shift"),  # log2 of their side
    ("int", "conjugates"),  # see kernels/lens/stigmatic.h: where they stand among the tables
)


# Kinds shared by host and device: the OpenCL constants are derived from the enumerations here.


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
    CURVE = 8
    MESH = 9


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
    TRANSLUCENT = 12
    BOUNDARY = 13  # of a medium: light passes as if nothing were there
    HAIR = 14
    MEASURED = 15


class TextureKind(IntEnum):
    """Kinds of texture."""

    CHECKER = 0
    GRID = 1
    GRADIENT = 2
    NOISE = 3
    IMAGE = 4
    PERLIN = 5
    MARBLE = 6
    DOTS = 7
    PLAIN = 8  # one colour, as a part of a mixture
    MIXTURE = 9


class Mapped(IntEnum):
    """What the coordinates of a texture follow from."""

    UV = 0
    SPACE = 1
    SPHERICAL = 2
    CYLINDRICAL = 3
    ROUND = 4


class PerlinForm(IntEnum):
    """Sums of octaves of Perlin's noise."""

    SUM = 0
    TURBULENCE = 1
    WIND = 2


class BumpLengths(IntEnum):
    """What a step of 1 in u and v is on a surface with bumps."""

    SURFACE = 0
    UNIT = 1
    U = 2


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
    BOX = 16  # from this number on they are solids, see kernels/light/solids.h
    ELLIPSOID = 17
    CYLINDER = 18
    CONE = 19


SOLID_EMITTERS = frozenset({EmitterKind.BOX, EmitterKind.ELLIPSOID, EmitterKind.CYLINDER, EmitterKind.CONE})
FLAT_EMITTERS = frozenset({EmitterKind.RECTANGLE, EmitterKind.DISK, EmitterKind.TRIANGLE})
FAR_EMITTERS = frozenset({EmitterKind.DIRECTIONAL, EmitterKind.SUN, EmitterKind.ENVIRONMENT})
SIZELESS_EMITTERS = frozenset(EmitterKind) - SOLID_EMITTERS - FLAT_EMITTERS - FAR_EMITTERS - {EmitterKind.SPHERE}
EMITTER_FACTS = {
    "EMITTER_FLATS": FLAT_EMITTERS,
    "EMITTER_SIZELESS": SIZELESS_EMITTERS,
    "EMITTER_SOLIDS": SOLID_EMITTERS,
    "EMITTER_BOXES": frozenset({EmitterKind.BOX}),
    "EMITTER_DIRECTIONS": frozenset({EmitterKind.DIRECTIONAL}),
    "ENVIRONMENT_SAMPLED": frozenset({EmitterKind.ENVIRONMENT}),
    **{
        f"EMITTER_{kind.name}S": frozenset({kind})
        for kind in EmitterKind
        if kind.name not in ("RECTANGLE", "BOX", "DIRECTIONAL", "ENVIRONMENT")
    },
}
"""Facts that kernels are compiled for, and the kinds of emitter of which one must be there."""


class PatchMap(IntEnum):
    """How the unit square lies on an emitter whose ghosts are traced."""

    SQUARE = 0
    DISK = 1
    TRIANGLE = 2


class Hidden(IntEnum):
    """Rays that something is hidden from; they add up."""

    FROM_CAMERA = 1
    FROM_SHADOW = 2
    FROM_REFLECTION = 4
    FROM_ALL_BUT_WAYS = 8  # of paths: boundaries of media


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
    """What became of a ray in a lens; values up to DARK are those of `rptcam_cl.optics.ray_trace.Status`."""

    OK = 0
    MISSED = 1
    CLIPPED = 2
    TOTAL_INTERNAL_REFLECTION = 3
    NO_CONVERGENCE = 4
    DARK = 5  # it comes from a place of the film that sees no light, and was never aimed


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
    "MAPPED": Mapped,
    "PERLIN": PerlinForm,
    "BUMP": BumpLengths,
    "EMITTER": EmitterKind,
    "HIDDEN": Hidden,
    "ENVIRONMENT": EnvironmentKind,
    "SPECTRUM": SpectrumKind,
    "PATCH": PatchMap,
    "RAY": RayStatus,
}


def kind_constants() -> list[str]:
    """Return a line of OpenCL C per member of every enumeration that kernels name."""
    return [f"#define {prefix}_{kind.name} {kind.value}" for prefix, kinds in _PREFIXES.items() for kind in kinds]


PRIMITIVE = declare(
    "Primitive",
    # rows of object_from_world; of a sphere: centre and radius, x axis and handedness, z axis; of curves see
    # kernels/geometry/cubic_curve.h, and for `emitter` too
    ("float4", "row_x row_y row_z"),
    ("int", "material"),
    ("int", "emitter"),  # index of the sampled emitter (of a mesh: of its first triangle's), or -1
    # of a mesh; what flat primitives and curves hold there has names in rendering/plan/geometry.py and in kernels
    ("int", "instance first_triangle"),
)

ALIGNED = declare(
    "Aligned",  # a flat primitive or box whose edges lie along the axes, kernels/geometry/aligned.h
    ("float4", "place"),  # middle of a box; of a flat one its place along its axis
    ("float4", "reach"),  # half the size of a box; scale and shift to u or v along the next axis and the one after
    ("int", "axis"),  # of the normal
    ("int", "reserved_0 reserved_1 reserved_2"),
)

INSTANCE = declare(
    "Instance",
    ("float4", "row_x row_y row_z"),  # rows of mesh_from_world
    ("float4", "world_x world_y world_z"),  # rows of world_from_mesh
    ("int", "root"),  # of its tree
    ("int", "first_primitive primitives reserved_0"),
)

SEGMENT = declare(
    "Segment",  # of the way of an object that moves, see kernels/geometry/movement.h
    ("float4", "pivot"),  # of its turns, at rest [m]; w: when the segment begins [s]
    ("float4", "shift"),  # at the beginning [m]; w: 1 / duration [1/s]
    ("float4", "travel"),  # during the segment [m]; w: turns
    ("float4", "axis"),
    ("float4", "turn"),  # at the beginning: quaternion x, y, z, w
)

SHARE_SIDES = {"ALPHAS": 16, "COSINES": 32, "TURNS": 12}  # of the tables of kernels/material/facet_shares.h

MATERIAL = declare(
    "Material",
    # w of a colour, here and elsewhere: its number among the spectra of the scene, from 1; 0 where it has none
    ("float4", "color"),  # reflectance, base colour, or radiance of an emissive material
    # shares of even light: x outside, y inside: that rough glass scatters once; z: that a white sheen sends back
    ("float4", "once"),
    ("float4", "metal_n metal_k"),  # refractive index n + i k of a metal
    ("float4", "cover"),  # of rough plastic: share of light that its cover reflects, as a quartic in 1 - cos
    ("float4", "absorption"),  # [1/m] behind the surface; of thin glass the optical depth
    ("float4", "specular_color"),  # of the dielectric's reflectance at normal incidence
    ("float4", "sheen"),  # colour of light that the fibres of a cloth send back
    # logarithm of the share of light that a white sheen sends back: a quartic in root cos
    ("float4", "sheen_cover"),
    ("float4", "glow"),  # radiance emitted by a surface that also scatters
    (
        "float4",
        "passed",
    ),  # of glass the factor on what it refracts, of a leaf the share that it passes
    ("float4", "inside"),  # colour of the medium that light enters, where a texture gives it
    ("float4", "hair"),  # variance along a fibre, scale round it, sine of the tilt, depth of its colour
    ("int", "kind"),
    ("int", "textured"),  # whether texture coordinates are wanted
    ("float", "parameter"),  # index of refraction; of matte the variance of slopes; 1 where a lamp's back shines
    ("float", "alpha"),  # GGX alpha along u; with a roughness texture what it is multiplied by
    ("float", "alpha_across"),
    ("float", "internal"),  # of plastic: share of diffuse light that the cover sends back down
    ("float", "cover_last metallic specular transmission coat"),
    ("float", "coat_alpha"),  # with a texture what it is multiplied by
    ("float", "sheen_last"),  # of `sheen_cover`
    ("float", "sheen_alpha"),
    ("float", "sheen_peak"),  # density of normals in the surface
    ("float", "sheen_half"),  # logarithm of Lambda at 60 degrees
    ("float", "opacity"),
    ("float", "cutoff"),  # of an opacity mask; 0 where rays pass with a probability
    ("float", "factor"),  # of a mix: share of the second material; of a measured one of facets in sampling
    # of a mix: the two materials; of a measured one the word where its table starts, of a film 1 more
    ("int", "first second"),
    ("int", "texture"),  # indices of the textures that replace values, or -1: of the colour
    ("int", "glow_texture roughness_texture metallic_texture coat_texture coat_roughness_texture"),
    ("int", "sheen_texture opacity_texture factor_texture normal_texture anisotropy_texture"),
    ("float", "normal_strength anisotropy_strength"),
    ("int", "dispersion_terms"),  # of the polynomial of the index over the inverse wavelength; 0: `parameter`
    ("float", "dispersion_low"),  # ends of what the polynomial is for; beyond them the index stays as it is there
    ("float", "dispersion_high"),
    ("float", f"dispersion[{DISPERSION_TERMS}]"),
    ("float", "anisotropy_turn"),  # of the direction of `alpha`, from u towards v [turns]
    ("int", "specular_texture specular_color_texture coat_normal_texture"),
    ("float", "coat_normal_strength"),
    ("int", "coat_flat"),  # whether the coat has the normals of the shape, and not those of `normal_texture`
    ("int", "transmission_texture passed_texture inside_texture bump_texture"),
    ("float", "bump_height"),  # of a texture of 1 [m]; of bumps over u and v in scene units [scene units]
    ("int", "bump_lengths"),
    ("int", "interior"),  # number of the medium in a solid that light enters, in a scene with media; else -1
    ("int", "share_table"),  # of rough glass: where its table starts, kernels/material/facet_shares.h
    ("int", "share_levels"),  # of the alphas of a texture, 1 without one; 0 without a table
    ("int", "share_turns"),
    ("int", "brushed_table"),  # of brushed facets: where their tables start,
    ("int", "brushed_alphas"),  # and for how many alphas each way: 1 of its own, 0 without a table
    ("int", "glow_behind"),  # whether `glow` leaves the back, too
    facts=(
        ("HAS_ROUGHNESS_TEXTURE", "roughness_texture"),
        ("HAS_METALLIC_TEXTURE", "metallic_texture"),
        ("HAS_COAT_TEXTURE", "coat_texture"),
        ("HAS_COAT_ROUGHNESS_TEXTURE", "coat_roughness_texture"),
        ("HAS_SHEEN_TEXTURE", "sheen_texture"),
        ("HAS_SPECULAR_TEXTURE", "specular_texture"),
        ("HAS_SPECULAR_COLOR_TEXTURE", "specular_color_texture"),
        ("HAS_TRANSMISSION_TEXTURE", "transmission_texture"),
        ("HAS_PASSED_TEXTURE", "passed_texture"),
        ("HAS_ENTRIES", "inside_texture"),
        ("HAS_NORMAL_MAP", "normal_texture"),
        ("HAS_ANISOTROPY_MAP", "anisotropy_texture"),
        ("HAS_BUMP", "bump_texture"),
    ),
)
MATERIAL_TEXTURES = tuple(name for _, name in MATERIAL.members if name.endswith("texture"))
"""Members of a material that hold the index of a texture, or -1."""

MEDIUM = declare(
    "Medium",
    ("float4", "absorption"),  # [1/m]
    ("float4", "scattering"),  # [1/m]
    ("float4", "emission"),  # radiance per metre
    ("float4", "layer"),  # up, and the height of the base above the eye; both over the scale height [1/m, 1]
    ("float4", "droplets"),  # of fog: g and alpha of Draine's phase function, and its share
    ("float4", "row_x row_y row_z"),  # of a grid of densities: from about the eye [m] to voxels
    ("float", "asymmetry"),  # mean cosine of scattering; with droplets of the rest of it
    ("float", "glow_rate"),  # of a grid: places where it shines per column, at least
    ("int", "by_entry"),  # whether the path's entry says what of the extinction is scattering
    ("int", "voxels"),  # of a grid: where its densities start, x first; else -1
    ("int", "blocks"),  # and the least, greatest and mean density of blocks of them
    ("int", "size_x size_y size_z blocks_x blocks_y blocks_z"),
    ("int", "in_shade"),  # whether glass keeps all light samples out, so that none are made
)
DENSITY_BLOCK = 8  # voxels along a side of a block of a grid of densities

TEXTURE = declare(
    "Texture",
    ("float4", "a"),  # first colour; of an image its gain
    ("float4", "b"),  # second colour
    ("float4", "row_u"),  # coordinates on the pattern: x u + y v + z
    ("float4", "row_v"),
    ("float4", "row_x row_y row_z"),  # of a mapping: from the world to the frame of the texture
    ("int", "kind"),
    ("float", "parameter"),  # width of a grid's line; amplitude of an octave of noise relative to the last
    ("float", "contrast"),  # of noise
    ("int", "octaves seed"),
    ("float", "limit"),  # largest value of an image, a mixture, or marble that goes on
    ("uint", "first"),  # word of the texels where an image starts; of a mixture its first part
    ("int", "width height format nearest wrap_u wrap_v mapping"),
    ("int", "form"),  # of Perlin's noise; of marble the last of its cubic pieces
    ("float", "variation"),  # of marble
)

EMITTER = declare(
    "Emitter",
    # corner, centre or position; w: area, radius of a sphere, squared sine of a sun's radius, size of a solid
    ("float4", "a"),
    ("float4", "u"),  # edge, or axis of a disk, profile or solid; w: cone of a spot, see kernels/light/point.h
    ("float4", "v"),
    # or the direction towards a light at infinity, or of the axis of a spot or profile; third axis of a solid
    ("float4", "normal"),
    ("float4", "radiance"),  # radiance, intensity or irradiance
    # texture coordinates at the corner; z: handedness of a sphere, whose u and v are axes x and z; of a solid this
    # and the next two are the rows of object_from_world
    ("float4", "uv"),
    ("float4", "uv_x uv_y"),  # and how they change along u and v
    ("int", "kind primitive two_sided"),
    # probability of being picked; of an emitter at infinity in a scene with a light tree: its irradiance, in the
    # units of the tree's estimates
    ("float", "pick"),
    ("int", "triangle"),  # of the primitive, or -1
    ("int", "texture"),  # index of the texture of the radiance or of a profile's intensities, or -1
    ("int", "leaf"),  # of the light tree
    ("int", "hidden"),  # sum of `Hidden`
)

ENVIRONMENT = declare(
    "Environment",
    ("float4", "bottom"),  # radiance from below or from everywhere
    ("float4", "top up"),
    ("float4", "right"),  # of a picture's middle
    ("float4", "forward"),
    ("int", "texture"),  # index of the picture
    ("int", "rows"),  # cells that light sampling tells apart
    ("int", "columns"),
    ("int", "emitter"),  # that stands for a picture
    ("int", "first_sun"),  # suns are emitters first_sun to first_sun + suns - 1
    ("int", "suns"),
    ("int", "lamps"),  # emitters of the light tree; those at infinity follow
    ("int", "light_levels"),  # of the light tree, above its leaves
)

WAVE = declare(
    "Wave",
    ("uint2", "seed"),
    ("uint", "first_pixel"),  # in the list of tiles
    ("uint", "pixels"),  # of the wave, a multiple of 16
    ("uint", "first_sample"),
    ("uint", "samples"),  # per pixel in this wave
    ("uint", "tiles_across"),
    ("int", "width"),  # of the cropped film
    ("int", "height full_width crop_x crop_y"),
    ("int", "tiles_skipped"),  # of the film, behind each in a row and behind each row
    ("int", "reserved_0"),
)

LIMITS = declare(
    "Limits",
    ("uint", "max_depth"),  # longest path [edges], the camera's included
    ("uint", "roulette_depth"),  # from which on Russian roulette may end a path; 0: never
    ("uint", "cell_shift"),  # binary logarithm of the pixels across a cell of the film
    ("int", "cells_across cells_down"),
)

VIEW = declare(
    "View",  # what the auxiliary layers need to know of the camera
    ("float", "blur_focus"),  # [1/m]
    ("float", "blur_scale"),  # of the denominator
    ("float", "blur_shift"),
    ("float", "blur_origin_z"),  # of distances [m]
    ("float", "pupil_z"),  # of the entrance pupil in the camera's frame [m]
    ("float", "per_pupil_radius"),  # 1 / its radius [1/m]; 0 for a point
    ("int", "columns"),  # of the table of the blur
    ("int", "rows"),
    ("int", "by_depth"),  # whether the blur's distances are depths
    ("int", "from_eye"),  # whether rays start ahead of the eye, that distances count from
    ("int", "reserved_0 reserved_1"),
)

CAUSTIC_SURFACE = declare(
    "CausticSurface",  # where photons start, kernels/caustics/surface.h
    ("float4", "row_x row_y row_z"),  # rows of world_from_object; of a triangle nothing
    ("int", "kind primitive"),
    ("int", "triangle"),  # of a mesh, else -1
    ("float", "area"),  # of the piece of the canonical shape; of a triangle in the world [m²]
    ("float4", "piece"),  # of the square of canonical coordinates u and v: where it begins, and its sides
)

PHOTON_GRID = declare(
    "PhotonGrid",  # how photons lie in memory, kernels/caustics/gather.h
    ("float4", "low"),  # bounds of the photons, a radius wider [m]; w: 1 / width of a cell [1/m]
    ("float4", "high"),  # w: radius [m]
    ("uint", "step"),  # between the numbers of cells that follow one another along y, and its square along z
    ("uint", "mask_cell mask_byte"),  # periods of these, less one: of cells, of bytes that say which hold photons
    ("uint", "mask_sample"),  # period of the samples that see photons of their own, less one
)

PHOTON_PASS = declare(
    "PhotonPass",
    ("uint2", "seed"),
    ("uint", "number"),
    ("uint", "max_edges"),  # of a photon
    ("int", "surfaces"),
    ("float", "per_photon"),  # 1 / photons
    ("int", "learns"),  # whether photons say on which surface they started, in place of where they ended
    ("uint", "unused_digits"),  # of 32: leading ones that are zero in every number of a photon
)

LIGHT_PASS = declare(
    "LightPass",  # paths that leave virtual lights, kernels/pass/light_paths.cl
    ("uint2", "seed"),
    ("uint", "number"),
    ("uint", "paths"),
    ("uint", "max_edges"),  # of a path
    ("int", "surfaces"),
    ("int", "from_eye"),
    ("float", "per_path"),  # 1 / paths
    ("float", "by_chance"),  # chance of a start to look for light in a random direction, else by a light sample
    ("uint", "reserved_0"),
)

VIRTUAL_GRID = declare(
    "VirtualGrid",  # of the density of virtual lights, kernels/light/virtual_lights.h
    ("float4", "low"),  # corner [m]; w: 1 / width of a cell [1/m]
    ("int", "side"),  # cells along an axis
    ("int", "count"),  # virtual lights
    ("int", "reserved_0 reserved_1"),
)

RECORDS = (
    PRIMITIVE, ALIGNED, INSTANCE, SEGMENT, MATERIAL, MEDIUM, TEXTURE, EMITTER, ENVIRONMENT, SURFACE, PINHOLE_CAMERA,
    THIN_LENS_CAMERA, THICK_LENS_CAMERA, PUPIL_CIRCLE, PUPIL_GRID, PUPIL_LINES, PUPIL, REALISTIC_CAMERA, OWN_CAMERA,
    HALF_PUPIL, CAMERA, WAVE, LIMITS, VIEW, CAUSTIC_SURFACE, PHOTON_GRID, PHOTON_PASS, LIGHT_PASS,
    VIRTUAL_GRID,
)  # fmt: skip


CAMERA_RAY_FLOATS = 8  # origin, weight, direction and time: what the stream reads per slot
# The fields of a path in their order, each row with the facts of scenes whose paths need it, and all rows before it.
_FIELDS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("OX OY OZ DX DY DZ BX BY BZ LX LY LZ WEIGHT ORIGIN HIT T QUEUE", ()),
    ("PDF REACH FROM TARGET SX SY SZ WX WY WZ CX CY CZ", ("HAS_EMITTERS",)),
    ("TRIANGLE HIT_TRIANGLE B1 B2 FROM_TRIANGLE TARGET_TRIANGLE", ("HAS_MESH", "HAS_CURVE")),
    ("TIME", ("MOVES",)),
    ("WAVELENGTH_SAMPLE", ("SPECTRUM",)),
    ("NX NY NZ", ("LIGHT_TREE",)),
    ("MIRROREDX MIRROREDY MIRROREDZ LOBE_WIDTH LOBE_SHARE", ("LIGHT_LOBES",)),
    ("SINCE_RECEIVER", ("CAUSTICS",)),
    ("MEDIUM FROM_MEDIUM", ("HAS_MEDIA",)),
    ("ENTRYX ENTRYY ENTRYZ", ("HAS_ENTRIES",)),
    ("MIS", ("LIGHT_PASSES",)),
    ("LASTX LASTY LASTZ LAST_WX LAST_WY LAST_WZ LAST_PDF SHAREX SHAREY SHAREZ CHANCE", ("LAMPS_BEHIND_GLASS",)),
    ("LIT_BY", ("LIGHT_GROUPS",)),  # behind it the light of each group, three numbers
)
STATE_FIELDS = tuple(name for names, _ in _FIELDS for name in names.split())


def floats_per_slot(facts: Mapping[str, int], *, stream: bool) -> int:
    """Return how many 4-byte numbers a slot holds: a camera ray for the stream, else a path."""
    if stream:
        return CAMERA_RAY_FLOATS
    floats = len(STATE_FIELDS) + 3 * facts["LIGHT_GROUPS"]
    for names, facts_of_row in reversed(_FIELDS):
        if not facts_of_row or any(facts[fact] for fact in facts_of_row):
            break
        floats -= len(names.split())
    return floats


# Numbers that decide alike on host and device.

HUGE_POWER = 2e-3  # of the squared radius of a sphere: the eye is a thousandth of the radius from its surface
TINY_ANGLE = 1e-4  # of a lamp whose neighbours a rounded direction may meet in its place, at most
MOTION_ROUNDING = 1.5e-6  # of a point by the way to rest and back, relative to its coordinates: a dozen roundings
MOTION_MARGIN = 4e-6  # by which boxes round what moves are wider on the host, relative to eye and pivot: more than that
HIT_ROUNDING = 4e-6  # of a hit off its surface, relative to the largest coordinate of the ray's origin and of the box
_CONSTANTS = {
    "HUGE_POWER": HUGE_POWER,
    "TINY_ANGLE": TINY_ANGLE,
    "MOTION_ROUNDING": MOTION_ROUNDING,
    "HIT_ROUNDING": HIT_ROUNDING,
}


@cache
def device_declarations() -> str:
    """OpenCL C text with every record, kind, constant and path field, for the head of a program."""
    lines = ["#if DOUBLE", "#pragma OPENCL EXTENSION cl_khr_fp64 : enable", "typedef double real;", "#else"]
    lines += ["typedef float real;", "#endif"]
    lines += [record.typedef for record in RECORDS]
    lines += kind_constants()
    lines += [f"#define RAY_STATUS_COUNT {len(RayStatus)}", f"#define MATERIAL_KINDS {len(MaterialKind)}"]
    lines.append(f"#define DISPERSION_SCALE ((real){DISPERSION_SCALE!r})")
    lines.append(f"#define DISPERSION_SHIFT ((real){DISPERSION_SHIFT!r})")
    lines.append(f"#define DENSITY_BLOCK {DENSITY_BLOCK}")
    lines += [f"#define SHARE_{name} {count}" for name, count in SHARE_SIDES.items()]
    lines += [f"#define LOSS_TABLE_NM {LOSS_TABLE_NM}", f"#define LOSS_TABLE_LENGTH {LOSS_TABLE_LENGTH}"]
    lines += [f"#define {name} {value!r}f" for name, value in _CONSTANTS.items()]
    lines += [f"#define PATH_{name} {index}" for index, name in enumerate((*STATE_FIELDS, "GROUPS"))]
    return "\n".join(lines) + "\n"


# Curves that ``kernels/common/curve.h`` picks cells by: running sums of shares, each with a guide into it.
#
# Their inverse takes evenly spread numbers to evenly spread cells. The alias method does not: with 256 samples of a
# lattice per pixel it was measured to make the light of a sky a hundred times noisier.


def curves(shares: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return the curves of rows of shares, shape (rows, 2 (cells + 1)), and the probability of each cell.

    Probabilities are those of the sums as float32 has them. A row without shares has even ones.
    """
    cells = shares.shape[1]
    given = np.where(shares.sum(axis=1, keepdims=True) > 0, shares, 1.0)
    sums = np.concatenate([np.zeros((len(shares), 1)), np.cumsum(given, axis=1)], axis=1)
    sums_32 = (sums / sums[:, -1:]).astype(np.float32)
    steps = np.arange(cells) / cells
    guides = np.array([np.searchsorted(row, steps, side="right") - 1 for row in sums_32]).clip(0, cells - 1)
    pairs = np.zeros((len(shares), cells + 1, 2), np.float32)
    pairs[..., 0], pairs[:, :-1, 1], pairs[:, -1, 1] = sums_32, guides, cells - 1
    return pairs.reshape(len(shares), -1), np.diff(sums_32.astype(np.float64), axis=1)


def seed_words(seed: int) -> tuple[int, int]:
    """Return two 32-bit words of a 64-bit seed, mixed so that neighbouring seeds are unrelated (splitmix64)."""
    mask = (1 << 64) - 1
    z = (seed + 0x9E3779B97F4A7C15) & mask
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
    z ^= z >> 31
    return z & 0xFFFFFFFF, z >> 32
