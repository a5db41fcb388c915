"""Records shared by host and device, declared once: the numpy dtypes and the OpenCL typedefs come from here."""

from __future__ import annotations

from functools import cache

from rptcam_cl.core.camera_records import CAMERA as CAMERA
from rptcam_cl.core.camera_records import DISPERSION_NM as DISPERSION_NM
from rptcam_cl.core.camera_records import DISPERSION_SCALE as DISPERSION_SCALE
from rptcam_cl.core.camera_records import DISPERSION_SHIFT as DISPERSION_SHIFT
from rptcam_cl.core.camera_records import DISPERSION_TERMS as DISPERSION_TERMS
from rptcam_cl.core.camera_records import EVEN_TERMS as EVEN_TERMS
from rptcam_cl.core.camera_records import HALF_PUPIL as HALF_PUPIL
from rptcam_cl.core.camera_records import LOSS_TABLE_LENGTH as LOSS_TABLE_LENGTH
from rptcam_cl.core.camera_records import LOSS_TABLE_NM as LOSS_TABLE_NM
from rptcam_cl.core.camera_records import ODD_TERMS as ODD_TERMS
from rptcam_cl.core.camera_records import OWN_CAMERA as OWN_CAMERA
from rptcam_cl.core.camera_records import PINHOLE_CAMERA as PINHOLE_CAMERA
from rptcam_cl.core.camera_records import PUPIL as PUPIL
from rptcam_cl.core.camera_records import PUPIL_CIRCLE as PUPIL_CIRCLE
from rptcam_cl.core.camera_records import PUPIL_GRID as PUPIL_GRID
from rptcam_cl.core.camera_records import PUPIL_LINES as PUPIL_LINES
from rptcam_cl.core.camera_records import REALISTIC_CAMERA as REALISTIC_CAMERA
from rptcam_cl.core.camera_records import SURFACE as SURFACE
from rptcam_cl.core.camera_records import THICK_LENS_CAMERA as THICK_LENS_CAMERA
from rptcam_cl.core.camera_records import THIN_LENS_CAMERA as THIN_LENS_CAMERA
from rptcam_cl.core.kinds import EmitterKind as EmitterKind
from rptcam_cl.core.kinds import EnvironmentKind as EnvironmentKind
from rptcam_cl.core.kinds import Kind as Kind
from rptcam_cl.core.kinds import MaterialKind as MaterialKind
from rptcam_cl.core.kinds import PupilKind as PupilKind
from rptcam_cl.core.kinds import RayStatus as RayStatus
from rptcam_cl.core.kinds import RegionKind as RegionKind
from rptcam_cl.core.kinds import StopKind as StopKind
from rptcam_cl.core.kinds import SurfaceKind as SurfaceKind
from rptcam_cl.core.kinds import TexelFormat as TexelFormat
from rptcam_cl.core.kinds import TextureKind as TextureKind
from rptcam_cl.core.kinds import Wrap as Wrap
from rptcam_cl.core.kinds import kind_constants
from rptcam_cl.core.record import Record as Record

PRIMITIVE = Record(
    "Primitive",
    (
        ("float4", "row_x"),  # rows of object_from_world; of a sphere: centre and radius, x axis and handedness, z axis
        ("float4", "row_y"),
        ("float4", "row_z"),
        ("int", "material"),
        ("int", "emitter"),  # index of the sampled emitter (of a mesh: of its first triangle's), or -1
        ("int", "instance"),  # of a mesh; of rectangles and disks how many share its plane, plan/primitives.py
        ("int", "first_triangle"),
    ),
)

INSTANCE = Record(
    "Instance",
    (
        ("float4", "row_x"),  # rows of mesh_from_world
        ("float4", "row_y"),
        ("float4", "row_z"),
        ("float4", "world_x"),  # rows of world_from_mesh
        ("float4", "world_y"),
        ("float4", "world_z"),
        ("int", "root"),  # of its tree
        ("int", "first_primitive"),
        ("int", "primitives"),
        ("int", "reserved_0"),
    ),
)

SEGMENT = Record(
    "Segment",  # of the way of an object that moves, see kernels/geometry/movement.h
    (
        ("float4", "pivot"),  # of its turns, at rest [m]; w: when the segment begins [s]
        ("float4", "shift"),  # at the beginning [m]; w: 1 / duration [1/s]
        ("float4", "travel"),  # during the segment [m]; w: turns
        ("float4", "axis"),
        ("float4", "turn"),  # at the beginning: quaternion x, y, z, w
    ),
)

MATERIAL = Record(
    "Material",
    (
        # w of a colour, here and elsewhere: its number among the spectra of the scene, from 1; 0 where it has none
        ("float4", "color"),  # reflectance, base colour, or radiance of an emissive material
        ("float4", "metal_n"),  # refractive index n + i k of a metal
        ("float4", "metal_k"),
        ("float4", "cover"),  # of rough plastic: share of light that its cover reflects, as a quartic in 1 - cos
        ("float4", "absorption"),  # [1/m] behind the surface; of thin glass the optical depth
        ("float4", "specular_color"),  # of the dielectric's reflectance at normal incidence
        ("float4", "sheen"),  # colour of light that the fibres of a cloth send back
        (
            "float4",
            "sheen_cover",
        ),  # logarithm of the share of light that a white sheen sends back: a quartic in root cos
        ("float4", "glow"),  # radiance emitted by a surface that also scatters
        ("int", "kind"),
        ("int", "textured"),  # whether texture coordinates are wanted
        ("float", "parameter"),  # index of refraction; 1 if an emissive material shines on both sides
        ("float", "alpha"),  # GGX alpha along u; with a roughness texture what it is multiplied by
        ("float", "alpha_across"),
        ("float", "internal"),  # of plastic: share of diffuse light that the cover sends back down
        ("float", "cover_last"),
        ("float", "metallic"),
        ("float", "specular"),
        ("float", "transmission"),
        ("float", "coat"),
        ("float", "coat_alpha"),  # with a texture what it is multiplied by
        ("float", "sheen_last"),  # of `sheen_cover`
        ("float", "sheen_alpha"),
        ("float", "sheen_peak"),  # density of normals in the surface
        ("float", "sheen_half"),  # logarithm of Lambda at 60 degrees
        ("float", "opacity"),
        ("float", "cutoff"),  # of an opacity mask; 0 where rays pass with a probability
        ("float", "factor"),  # of a mix: share of the second material
        ("int", "first"),  # of a mix: the two materials
        ("int", "second"),
        ("int", "texture"),  # indices of the textures that replace values, or -1: of the colour
        ("int", "glow_texture"),
        ("int", "roughness_texture"),
        ("int", "metallic_texture"),
        ("int", "coat_texture"),
        ("int", "coat_roughness_texture"),
        ("int", "sheen_texture"),
        ("int", "opacity_texture"),
        ("int", "factor_texture"),
        ("int", "normal_texture"),
        ("int", "anisotropy_texture"),
        ("float", "normal_strength"),
        ("float", "anisotropy_strength"),
        ("int", "dispersion_terms"),  # of the polynomial of the index over the inverse wavelength; 0: `parameter`
        ("float", "dispersion_low"),  # ends of what the polynomial is for; beyond them the index stays as it is there
        ("float", "dispersion_high"),
        ("float", f"dispersion[{DISPERSION_TERMS}]"),
        ("float", "anisotropy_turn"),  # of the direction of `alpha`, from u towards v [turns]
        ("int", "specular_texture"),
        ("int", "specular_color_texture"),
        ("int", "coat_normal_texture"),
        ("float", "coat_normal_strength"),
        ("int", "coat_flat"),  # whether the coat has the normals of the shape, and not those of `normal_texture`
        ("int", "transmission_texture"),
    ),
)

TEXTURE = Record(
    "Texture",
    (
        ("float4", "a"),  # first colour; of an image its gain
        ("float4", "b"),  # second colour
        ("float4", "row_u"),  # coordinates on the pattern: x u + y v + z
        ("float4", "row_v"),
        ("int", "kind"),
        ("float", "parameter"),  # width of a grid's line; amplitude of an octave of noise relative to the last
        ("float", "contrast"),  # of noise
        ("int", "octaves"),
        ("int", "seed"),
        ("float", "limit"),  # largest value of an image
        ("uint", "first"),  # word of the texels where an image starts
        ("int", "width"),
        ("int", "height"),
        ("int", "format"),
        ("int", "nearest"),
        ("int", "wrap_u"),
        ("int", "wrap_v"),
        ("int", "reserved_0"),
        ("int", "reserved_1"),
        ("int", "reserved_2"),
    ),
)

EMITTER = Record(
    "Emitter",
    (
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
        ("float4", "uv_x"),  # and how they change along u and v
        ("float4", "uv_y"),
        ("int", "kind"),
        ("int", "primitive"),
        ("int", "two_sided"),
        # probability of being picked; of an emitter at infinity in a scene with a light tree: its irradiance, in the
        # units of the tree's estimates
        ("float", "pick"),
        ("int", "triangle"),  # of the primitive, or -1
        ("int", "texture"),  # index of the texture of the radiance or of a profile's intensities, or -1
        ("int", "leaf"),  # of the light tree
        ("int", "reserved_0"),
    ),
)

ENVIRONMENT = Record(
    "Environment",
    (
        ("float4", "bottom"),  # radiance from below or from everywhere
        ("float4", "top"),
        ("float4", "up"),
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
    ),
)

WAVE = Record(
    "Wave",
    (
        ("uint2", "seed"),
        ("uint", "first_pixel"),  # in the list of tiles
        ("uint", "pixels"),  # of the wave, a multiple of 16
        ("uint", "first_sample"),
        ("uint", "samples"),  # per pixel in this wave
        ("uint", "tiles_across"),
        ("int", "width"),  # of the cropped film
        ("int", "height"),
        ("int", "full_width"),
        ("int", "crop_x"),
        ("int", "crop_y"),
        ("int", "tiles_skipped"),  # of the film, behind each in a row and behind each row
        ("int", "reserved_0"),
    ),
)

LIMITS = Record(
    "Limits",
    (
        ("uint", "max_depth"),  # longest path [edges], the camera's included
        ("uint", "roulette_depth"),  # from which on Russian roulette may end a path; 0: never
        ("uint", "cell_shift"),  # binary logarithm of the pixels across a cell of the film
        ("int", "cells_across"),
        ("int", "cells_down"),
    ),
)

VIEW = Record(
    "View",  # what the auxiliary layers need to know of the camera
    (
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
        ("int", "reserved_0"),
        ("int", "reserved_1"),
    ),
)

CAUSTIC_SURFACE = Record(
    "CausticSurface",  # where photons start, kernels/caustics/surface.h
    (
        ("float4", "row_x"),  # rows of world_from_object; of a triangle nothing
        ("float4", "row_y"),
        ("float4", "row_z"),
        ("int", "kind"),
        ("int", "primitive"),
        ("int", "triangle"),  # of a mesh, else -1
        ("float", "area"),  # of the canonical shape; of a triangle in the world [m²]
    ),
)

PHOTON_GRID = Record(
    "PhotonGrid",  # how photons lie in memory, kernels/caustics/gather.h
    (
        ("float4", "low"),  # bounds of the photons, a radius wider [m]; w: 1 / width of a cell [1/m]
        ("float4", "high"),  # w: radius [m]
        ("int", "mask_x"),  # periods of the cells, less one
        ("int", "mask_y"),
        ("int", "mask_z"),
        ("int", "reserved_0"),
    ),
)

PHOTON_PASS = Record(
    "PhotonPass",
    (
        ("uint2", "seed"),
        ("uint", "number"),
        ("uint", "max_edges"),  # of a photon
        ("int", "surfaces"),
        ("float", "per_photon"),  # 1 / photons
    ),
)

RECORDS = (
    PRIMITIVE, INSTANCE, SEGMENT, MATERIAL, TEXTURE, EMITTER, ENVIRONMENT, SURFACE, PINHOLE_CAMERA, THIN_LENS_CAMERA,
    THICK_LENS_CAMERA, PUPIL_CIRCLE, PUPIL_GRID, PUPIL_LINES, PUPIL, REALISTIC_CAMERA, OWN_CAMERA, HALF_PUPIL, CAMERA,
    WAVE, LIMITS, VIEW, CAUSTIC_SURFACE, PHOTON_GRID, PHOTON_PASS,
)  # fmt: skip


CAMERA_RAY_FLOATS = 8  # origin, weight, direction and time: what the stream reads per slot
PATH_FIELDS = ("OX", "OY", "OZ", "DX", "DY", "DZ", "BX", "BY", "BZ", "LX", "LY", "LZ", "WEIGHT", "ORIGIN", "HIT", "T")
SHADOW_FIELDS = ("SX", "SY", "SZ", "WX", "WY", "WZ", "CX", "CY", "CZ")
LIGHT_FIELDS = ("PDF", "REACH", "FROM", "TARGET", *SHADOW_FIELDS)
MESH_FIELDS = ("TRIANGLE", "HIT_TRIANGLE", "B1", "B2", "FROM_TRIANGLE", "TARGET_TRIANGLE")
TIME_FIELDS = ("TIME",)
COLOUR_FIELDS = ("WAVELENGTH_SAMPLE",)
LIGHT_TREE_FIELDS = ("NX", "NY", "NZ")
CAUSTIC_FIELDS = ("SINCE_RECEIVER",)
STATE_FIELDS = (
    PATH_FIELDS + LIGHT_FIELDS + MESH_FIELDS + TIME_FIELDS + COLOUR_FIELDS + LIGHT_TREE_FIELDS + CAUSTIC_FIELDS
)


def floats_per_slot(
    *,
    stream: bool,
    emitters: bool,
    meshes: bool,
    moves: bool,
    colours: bool,
    light_tree: bool,
    caustics: bool = False,
) -> int:
    """Return how many 4-byte numbers a slot holds.

    Camera rays for the stream; otherwise whole paths, with shadow rays where the scene has emitters to sample, with
    triangles where it has meshes, with the time where something moves, with the wavelength sample where paths have a
    wavelength, with a normal where the scene has a light tree and with their past where photons bring caustics.
    """
    if stream:
        return CAMERA_RAY_FLOATS
    last = {
        CAUSTIC_FIELDS: caustics,
        LIGHT_TREE_FIELDS: light_tree,
        COLOUR_FIELDS: colours,
        TIME_FIELDS: moves,
        MESH_FIELDS: meshes,
        LIGHT_FIELDS: emitters,
    }
    floats = len(STATE_FIELDS)
    for fields, needed in last.items():
        if needed:
            return floats
        floats -= len(fields)
    return floats


@cache
def device_declarations() -> str:
    """OpenCL C text with every record, kind and path field, for the head of a program."""
    lines = ["#if DOUBLE", "#pragma OPENCL EXTENSION cl_khr_fp64 : enable", "typedef double real;", "#else"]
    lines += ["typedef float real;", "#endif"]
    lines += [record.typedef for record in RECORDS]
    lines += kind_constants()
    lines.append(f"#define RAY_STATUS_COUNT {len(RayStatus)}")
    lines.append(f"#define DISPERSION_SCALE ((real){DISPERSION_SCALE!r})")
    lines.append(f"#define DISPERSION_SHIFT ((real){DISPERSION_SHIFT!r})")
    lines += [f"#define LOSS_TABLE_NM {LOSS_TABLE_NM}", f"#define LOSS_TABLE_LENGTH {LOSS_TABLE_LENGTH}"]
    lines += [f"#define PATH_{name} {index}" for index, name in enumerate(STATE_FIELDS)]
    return "\n".join(lines) + "\n"
