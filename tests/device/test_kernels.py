"""Every kernel compiles alone, with every fact on and with the least, at every width, without a warning."""

import warnings
from functools import cache
from itertools import product
from pathlib import Path

import pyopencl as cl
import pytest

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.files import kernels_dir
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device.devices import try_device
from rptcam_cl.device.programs import BUILD_OPTIONS, assemble, options_of
from rptcam_cl.rendering.layers import LayerPlanes
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.tree_build import FACTS, FILES
from rptcam_cl.scene.film import LAYER_NAMES
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import room_lit_by_detours
from tests.rendering.test_world import PLANE, still_life
from tests.support.cases import slow

CAMERAS = sorted(
    path.stem
    for path in (kernels_dir() / "camera").glob("*.h")
    if path.stem not in ("film_point", "filter", "trajectory", "draw", "aimed", "into_world", "packets", "stopped")
)
# How calls pass wide vectors is moot, as every helper is static. Compilers that are not clang ignore the pragma.
NO_ABI = '#ifdef __clang__\n#pragma clang diagnostic ignored "-Wpsabi"\n#endif\n'
BANNED = ("fast-relaxed-math", "unsafe-math", "finite-math", "mad-enable", "no-signed-zeros", "denorms-are-zero")
RARE = [
    {"shape": "sphere", "center": [0, 0, 9], "radius": 1, "transform": [{"scale": [1, 2, 1]}], "material": "grid"},
    PLANE | {"material": {"kind": "matte", "reflectance": 0.5}},
    {"shape": "disk", "center": [0, 0, 5], "normal": [0, 0, 1], "radius": 1e-5,
     "material": {"kind": "emissive", "radiance": 1}},
    {"shape": "sphere", "center": [0, 0, -1e7], "radius": 1e7, "material": "grid"},
    {"shape": "curves", "points": [[0, 0, 0, 0.1], [0, 0, 1, 0.1]], "material": {"kind": "hair", "eumelanin": 1}},
]  # fmt: skip
SOLIDS = ("box", "cylinder", "cone", "sphere")  # of a sphere an ellipsoid
PATTERNS = {
    "gradient": {"kind": "gradient", "start": 0.1, "end": 0.9},
    "noise": {"kind": "noise", "low": 0.1, "high": 0.9},
    "perlin": {"kind": "perlin", "mapping": {"kind": "space"}},
    "marble": {"kind": "marble"},
    "dots": {"kind": "dots", "inside": 0.9, "outside": 0.1},
    "mixture": {"kind": "mixture", "first": 0.1, "second": {"kind": "dots", "inside": 0.9, "outside": 0.1}},
    "image": {"kind": "image", "file": str(Path(__file__).parents[2] / "docs" / "images" / "boards.png")},
}
LIGHTS = [
    {"kind": "spot", "position": [0, 0, 3], "direction": [0, 0, -1], "intensity": 1, "outer_degrees": 30},
    {"kind": "ies", "position": [0, 0, 3], "file": str(Path(__file__).parents[1] / "data" / "luminaire.ies")},
    {"kind": "sun", "direction": [0, 0, -1], "irradiance": 1},
]
GRID = {"kind": "grid", "background": 0.9, "line": 0.1, "line_width": 0.25, "scale": [2, 2]}

IMAGE = PATTERNS["image"]
EVERY_MATERIAL = {
    "metal": {"kind": "conductor", "metal": "gold", "alpha": [0.1, 0.3], "anisotropy_rotation_degrees": 30},
    "frosted": {"kind": "dielectric", "alpha": 0.2, "absorption_per_m": 1, "opacity": 0.5, "transmittance": IMAGE},
    "leaf": {"kind": "translucent", "transmittance": IMAGE},
    "clay": {"kind": "matte", "reflectance": 0.5, "sigma_degrees": 20},
    "spun": {"kind": "principled", "anisotropy_map": {"file": IMAGE["file"]}, "anisotropy_rotation_degrees": 30},
    "prism": {"kind": "dielectric", "glass": "N-BK7"},
    "pane": {"kind": "thin_glass"},
    "plastic": {"kind": "plastic", "reflectance": 0.5},
    "rough plastic": {"kind": "plastic", "reflectance": 0.5, "roughness": 0.3},
    "principled": {
        "kind": "principled", "roughness": IMAGE, "metallic": IMAGE, "transmission": IMAGE, "clearcoat": IMAGE,
        "clearcoat_roughness": IMAGE, "emission": 1, "two_sided": True, "sheen": IMAGE, "specular": IMAGE,
        "clearcoat_normal_map": {"file": IMAGE["file"]},
        "specular_color": IMAGE, "normal_map": {"file": IMAGE["file"]},
    },
    "mix": {"kind": "mix", "materials": ["metal", "plastic"]},
    "bumpy": {"kind": "matte", "reflectance": 0.5, "bump": {"texture": PATTERNS["perlin"], "lengths": "u"}},
}  # fmt: skip


GLOW = {"kind": "emissive", "radiance": GRID}
LOSSES = ("LENS_FRESNEL", "LENS_LAYERS", "LENS_STACKS", "LENS_DARK_LAYERS", "LENS_ABSORPTION", "LENS_TINTED")
SURFACES = ("LENS_POSE", "LENS_MIRROR", "LENS_REGION", "LENS_GENERAL", "LENS_CONIC", "LENS_OUTLINE", "LENS_MASK")
GLASS = {"LENS_SPLITS": 1}
PHOTONS = {"CAUSTICS": 1}
PANES = {"PANES_BY_SAMPLES": 1}
VIRTUAL = {"VIRTUAL_LIGHTS": 1}
GHOSTS = {"GHOST_PATCHES": 1, "GHOST_PENCILS": 1}
MEDIA = {"HAS_MEDIA": 1, "HAS_BOUNDARY": 1, "HAS_LAYERED_FOG": 1, "HAS_DENSITY": 1, "HAS_DROPLETS": 1, "HAS_ENTRIES": 1}
GROUPS = {"LIGHT_GROUPS": 3}
BEHIND = {"LAMPS_BEHIND_GLASS": 1, "LIGHT_PASSES": 0}
ALONE = {"LAMPS_BY_SAMPLES": 1, "LIGHT_PASSES": 0}
TABLES = {"HAS_MEASURED": 1, "HAS_THIN_FILM": 1}  # which materials read along the way
READ = {"RAYS_FILE": "integrator/read_rays.h"}  # by the stream, or made there
KEPT = {"RAYS_FILE": "integrator/kept_rays.h", "CAMERA_HAS_LENS": 1, "SAMPLER_LATTICE": 1}
MADE = {"RAYS_FILE": "integrator/made_rays.h", "CAMERA_FILE": "camera/thin_lens.h", "APERTURE_PARTS": 9, "FILTER": 1024}
TREES = {"BVH_WIDTH": 16, "LEAF_WIDTH": 16, "BVH_STACK": 64, "HAS_PRIMITIVE_TREE": 1, "PRIMITIVE_STACK": 16}


def sheet(side):
    """A square of ``side`` by ``side`` pairs of triangles."""
    step = [i / side for i in range(side + 1)]
    corner = [i * (side + 1) + j for i in range(side) for j in range(side)]
    faces = [f for k in corner for f in ([k, k + side + 1, k + side + 2], [k, k + side + 2, k + 1])]
    return {"vertices": [[x, y, 0] for x in step for y in step], "faces": faces}


def facts_of(mapping):
    return make_plan(load_scene(mapping, allow_folders=[Path(__file__).parents[2]])).facts


@cache
def all_facts():
    """Facts of a scene that has one of everything."""
    scene = still_life() | {"meshes": {"sheet": sheet(100)}}
    meshes = [{"shape": "mesh", "mesh": "sheet", "material": GLOW}] * 2  # too large to be copied: instances
    patterns = PATTERNS | {"grid": GRID}
    materials = {name: {"kind": "matte", "reflectance": pattern} for name, pattern in patterns.items()} | EVERY_MATERIAL
    shown = [PLANE | {"material": name} for name in (*PATTERNS, *EVERY_MATERIAL)]
    solids = [item | {"material": GLOW} for item in [*scene["objects"], *RARE] if item["shape"] in SOLIDS]
    scene |= {"objects": scene["objects"] + RARE + solids + shown + meshes, "materials": materials}
    scene |= {"lights": scene["lights"] + LIGHTS, "environment": PATTERNS["image"], "render": {"clamp": 9.0}}
    scene |= {"spectrum": "spectral"}
    leaning = [{"time_s": 0}, {"time_s": 1e-3}, {"time_s": 1, "up": [0.1, 0, 1]}]
    turning = [{"time_s": 0}, {"time_s": 1e-3, "rotate": {"axis": [0, 0, 1], "degrees": 90}}, {"time_s": 1}]
    first, *rest = scene["objects"]
    scene |= {
        "objects": [first | {"motion": turning, "visible": {"shadow": False}}, *rest],
        "film": {"transparent": True},
    }
    return facts_of(scene | {"camera": scene["camera"] | {"motion": leaning}})


@cache
def least_facts():
    """Facts of an empty scene."""
    return facts_of(still_life() | {"objects": [], "lights": [], "environment": None})


def layer_facts(names):
    """Facts of the layers of those names; only the pass that records them reads any."""
    return LayerPlanes(names).facts


def without_warnings(session, files, facts):
    source = assemble(files, facts, device_declarations(), library_arch=try_device(session.info.handle).library_arch)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        options = [option for option in options_of(session.info.handle, source) if option != "-w"]
        # the compiler warns of what it reads, and only then optimises, which takes four fifths of its time
        options += ["-Werror", "-cl-opt-disable"]
        cl.Program(session.context, NO_ABI + source).build(options, [session.info.handle])


def test_warning_is_an_error(session, tmp_path):
    (tmp_path / "odd.cl").write_text("__kernel void odd(__global int *a) { __global float *b = a; b[0] = 1.0f; }\n")
    with pytest.raises(cl.RuntimeError, match="BUILD_PROGRAM_FAILURE"):
        without_warnings(session, [str(tmp_path / "odd.cl")], {"VW": 1})


def test_scene_with_everything_turns_every_fact_on():
    # one emitter is not many, few primitives are not either, the world is of one kind, photons do not move, virtual
    # lights know little of what there is, and media have no solids with holes
    off = {name for name, value in all_facts().items() if not value}
    assert off == {
        "ONE_EMITTER",
        "LENS_SPLITS",
        "FEW_PRIMITIVES",
        "LAMPS_BEHIND_GLASS",
        "LAMPS_BY_SAMPLES",
        *PHOTONS,
        *PANES,
        *VIRTUAL,
        *MEDIA,
        *GROUPS,
        *TABLES,
    }


# What widths differ in is the same few macros in every pass: the fast tests have each pass at one of them.
ONE_LANE_TOO = [slow(1), 8]
SCENE_PASSES = (
    "film intersect sort shade shadow light_paths photons",
    "ghosts guides layers",
    "occluded",
    "sharp",
    "stream",
)
OWN_TESTS = {"aim_rays", "denoise", "generate", "trace_copies", "trace_lens", "trace_rays", "travel"}


def test_every_pass_is_compiled():
    files = {path.stem for path in (kernels_dir() / "pass").glob("*.cl")}
    assert files == OWN_TESTS | {name for names in SCENE_PASSES for name in names.split()}


def compiled(*groups):
    """Files in one program, which reads what they share once, for the fast tests; each alone for the slow ones."""
    alone = [[f"pass/{name}.cl"] for names in groups if len(names.split()) > 1 for name in names.split()]
    together = [[f"pass/{name}.cl" for name in names.split()] for names in groups]
    return pytest.mark.parametrize("files", [*together, *map(slow, alone)], ids=" ".join)


@pytest.mark.slow
@pytest.mark.parametrize("short", [slow(0), 1])
@compiled("intersect shade")
def test_meshes_compile_for_trees_of_four(session, files, short):
    of_four = {"BVH_WIDTH": 4, "LEAF_WIDTH": 4, "BVH_STACK": 32, "SHORT_STACK": short}
    without_warnings(session, files, all_facts() | of_four | {"VW": 1})


@pytest.mark.parametrize("lanes", ONE_LANE_TOO)
@compiled(*SCENE_PASSES)
def test_passes_with_everything_compile_without_a_warning(session, files, lanes):
    facts = all_facts() | TREES | layer_facts(LAYER_NAMES) | GLASS | MADE | PHOTONS | GHOSTS | {"VW": lanes}
    without_warnings(session, files, facts)


@pytest.mark.parametrize("lanes", ONE_LANE_TOO)
@compiled("travel sort shade shadow", "stream", "layers", "sharp")
def test_passes_with_media_and_everything_compile_without_a_warning(session, files, lanes):
    facts = all_facts() | TREES | layer_facts(LAYER_NAMES) | MADE | MEDIA | GROUPS | TABLES | {"VW": lanes}
    without_warnings(session, files, facts)


@pytest.mark.slow
@pytest.mark.parametrize("lanes", ONE_LANE_TOO)
@compiled("shade shadow", "stream")
def test_passes_that_follow_glass_to_lamps_compile_without_a_warning(session, files, lanes):
    for more in (GROUPS, PHOTONS | PANES):
        without_warnings(session, files, all_facts() | TREES | MADE | more | BEHIND | {"VW": lanes})


@pytest.mark.parametrize(
    ("bounded", "layered", "gridded"),
    [(0, 0, 0), *(slow(*each) for each in product((0, 1), repeat=3) if any(each))],
)
@compiled("travel shadow", "stream")
def test_passes_with_media_alone_compile_without_a_warning(session, files, bounded, layered, gridded):
    facts = {"HAS_BOUNDARY": bounded, "HAS_LAYERED_FOG": layered, "HAS_DENSITY": gridded, "HAS_DROPLETS": 0, "VW": 8}
    facts |= {"HAS_ENTRIES": 0}  # whose colours are textures
    without_warnings(session, files, least_facts() | READ | MEDIA | facts)


@pytest.mark.parametrize("layered", [1, slow(0)])
@compiled("travel shadow", "stream")
def test_passes_with_beams_compile_without_a_warning(session, files, layered):
    spots = {"HAS_EMITTERS": 1, "EMITTER_SIZELESS": 1, "EMITTER_SPOTS": 1}
    facts = spots | {"HAS_MEDIA": 1, "HAS_LAYERED_FOG": layered, "VW": 8}
    without_warnings(session, files, least_facts() | READ | facts)


@compiled("intersect shadow")
def test_walks_side_by_side_compile_without_a_warning(session, files):
    facts = all_facts() | TREES | {"VW": 16}
    without_warnings(session, files, facts)
    without_warnings(session, files, facts | {"HAS_INSTANCES": 0, "HAS_OPACITY": 0})


@pytest.mark.slow
@compiled("shade film", "stream")
def test_passes_compile_for_red_green_and_blue_of_one_wavelength(session, files):
    rgb = {"SPECTRUM": 1, "SPECTRAL_COLOURS": 0, "HAS_SPECTRA": 0, "LENS_SPLITS": 0, "VW": 8}
    without_warnings(session, files, all_facts() | TREES | GLASS | READ | rgb | ALONE)


@pytest.mark.parametrize("lanes", [1, slow(8)])
@compiled(*(names.removesuffix(" photons") for names in SCENE_PASSES))
def test_passes_with_the_least_compile_without_a_warning(session, files, lanes):
    without_warnings(session, files, least_facts() | layer_facts(["coverage"]) | READ | {"VW": lanes})


@pytest.mark.parametrize("lanes", ONE_LANE_TOO)
@pytest.mark.parametrize("pane", [False, True])
@compiled("photons shade shadow", "stream")
def test_least_that_has_photons_compiles_without_a_warning(session, files, lanes, pane):
    shine = {"shape": "sphere", "center": [0, 0, 1], "radius": 0.5}
    scene = still_life() | {"lights": LIGHTS[:1], "environment": None, "materials": {"glass": {"kind": "dielectric"}}}
    scene |= {"objects": [PLANE | {"material": RARE[1]["material"]}, shine | {"material": "glass"}]}
    if pane:
        square = {"shape": "rectangle", "corner": [0, 0, 2], "edge_u": [1, 0, 0], "edge_v": [0, 1, 0]}
        scene["objects"] += [square | {"material": {"kind": "thin_glass"}}]
        scene |= {"lights": [{"kind": "sun", "direction": [0, 0, -1], "irradiance": 1}]}
    facts = facts_of(scene | {"render": {"caustics": "on"}})
    assert (facts["CAUSTICS"], facts["PANES_BY_SAMPLES"]) == (1, pane)
    without_warnings(session, files, facts | layer_facts(["coverage"]) | READ | {"VW": lanes})


@pytest.mark.parametrize("lanes", ONE_LANE_TOO)
@compiled("light_paths shade", "stream")
def test_room_that_has_virtual_lights_compiles_without_a_warning(session, files, lanes):
    facts = facts_of(room_lit_by_detours())
    assert facts["VIRTUAL_LIGHTS"] == 1
    without_warnings(session, files, facts | READ | {"VW": lanes})


@pytest.mark.parametrize("lanes", ONE_LANE_TOO)
@compiled("light_paths")
def test_room_with_glass_of_every_kind_that_has_virtual_lights_compiles_without_a_warning(session, files, lanes):
    pane = {"shape": "box", "min": [-1, 1.9, 0], "max": [1, 1.95, 1], "material": {"kind": "dielectric"}}
    materials = [
        {"kind": "dielectric", "absorption_per_m": 1.0}, {"kind": "dielectric", "roughness": 0.5, "anisotropy": 0.5},
        {"kind": "principled", "base_color": 0.5, "roughness": 0.5, "transmission": 0.5, "opacity": 0.5},
        {"kind": "conductor", "reflectance": 0.9, "alpha": [0.7, 0.1]},
    ]  # fmt: skip
    balls = [{"shape": "sphere", "center": [0, 1, 0], "radius": 0.1, "material": each} for each in materials]
    scene = room_lit_by_detours(objects=[pane, *balls])
    scene["render"] |= {"caustics": "on", "virtual_lights": "on"}
    facts = facts_of(scene)
    wanted = ("VIRTUAL_LIGHTS", "CAUSTICS", "LAMPS_BEHIND_GLASS", "HAS_ABSORPTION", "HAS_OPACITY", "HAS_TRANSMISSION")
    assert all(facts[name] for name in wanted)
    without_warnings(session, files, facts | READ | {"VW": lanes})


@pytest.mark.parametrize("camera", ["pinhole", "environment", "thick_lens"])
def test_stream_makes_the_rays_of_a_camera_without_surfaces(session, camera):
    without_warnings(session, ["pass/stream.cl"], least_facts() | MADE | {"CAMERA_FILE": f"camera/{camera}.h", "VW": 8})


@pytest.mark.parametrize("scene", [slow(least_facts), all_facts])
@pytest.mark.parametrize(
    ("camera", "lanes", "packets"), [("realistic", 16, 2), slow("realistic", 1, 1), slow("fitted", 8, 1)]
)
def test_stream_takes_the_rays_of_its_pixels_through_a_lens_first(session, scene, camera, lanes, packets):
    facts = {"CAMERA_FILE": f"camera/{camera}.h", "CAMERA_PACKETS": packets, "VW": lanes}
    facts |= {"MAP_ORDER": 4, "MAP_RIM_ORDER": 2, "MAP_RIMS": 1, "MAP_COLOURS": 0}
    if scene is all_facts:
        more = ("LAMP_AIM", "LAMP_COLOURS", "HALF_PUPIL", "PUPIL_RING")
        facts |= TREES | GLASS | dict.fromkeys((*LOSSES, *SURFACES, *more), 1)
        facts |= {"LENS_DISPERSION": 9, "WAVELENGTH_CELLS": 528, "FILTER": 1024}
    without_warnings(session, ["pass/stream.cl"], scene() | KEPT | facts)


@pytest.mark.parametrize("lanes", [*ONE_LANE_TOO, slow(16)])
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("stream", [0, 1])
def test_camera_compiles_alone_without_a_warning(session, camera, lanes, stream):
    lens = int(camera == "realistic")
    # with the least of everything the stream is what most tests render with
    for rest, shape in ((0, "APERTURE_ROWS"), (1, "APERTURE_PARTS"))[int(stream or lanes > 8) :]:
        facts = {
            "CAMERA_FILE": f"camera/{camera}.h",
            "CAMERA_HAS_LENS": lens,
            "CAMERA_PACKETS": 1 + lens * rest,
            "STREAM": stream,
            "VW": lanes,
        }
        facts |= {"HAS_EMITTERS": rest, shape: 9, "SAMPLER_LATTICE": rest, "FILTER": 1024 * rest}
        facts |= {"SPECTRUM": rest, "WAVELENGTH_CELLS": 528, "LENS_SPLITS": rest, "LENS_DISPERSION": 9 * rest}
        facts |= {"MOVES": rest, "CAMERA_SEGMENTS": rest * (1 + stream), **dict.fromkeys(LOSSES, rest)}
        facts |= {"MAP_ORDER": 1 + 3 * rest, "MAP_RIM_ORDER": 2 + rest, "MAP_RIMS": 1 + rest, "MAP_COLOURS": rest}
        without_warnings(session, ["pass/generate.cl"], facts)


@pytest.mark.parametrize("lanes", [*ONE_LANE_TOO, slow(16)])
def test_lens_tracer_compiles_alone_without_a_warning(session, lanes):
    without_warnings(session, ["pass/trace_rays.cl"], {"VW": lanes})
    without_warnings(session, ["pass/trace_rays.cl"], {"VW": lanes, **dict.fromkeys(LOSSES, 1)})
    for pose in (0, 1):
        without_warnings(session, ["pass/trace_copies.cl"], {"VW": lanes, "LENS_POSE": pose, "LENS_MIRROR": pose})


@pytest.mark.parametrize("lanes", [*ONE_LANE_TOO, slow(16)])
def test_passes_about_a_lens_in_float64_compile_alone_without_a_warning(session, lanes):
    for rest in (0, 1):
        facts = {"CAMERA_FILE": "camera/realistic.h", "CAMERA_HAS_LENS": 1, "CAMERA_PACKETS": 1, "LENS_FLOAT64": 1}
        facts |= {
            "VW": lanes,
            "SPECTRUM": rest,
            "WAVELENGTH_CELLS": 528,
            "LENS_SPLITS": rest,
            "LENS_DISPERSION": 9 * rest,
        }
        facts |= {"SAMPLER_LATTICE": rest, "FILTER": 1024 * rest, "STREAM": rest, **dict.fromkeys(LOSSES, rest)}
        without_warnings(session, ["pass/aim_rays.cl"], facts)
        without_warnings(session, ["pass/generate.cl"], facts)
        without_warnings(session, ["pass/trace_lens.cl"], facts | {"VW": min(lanes, 8), "DOUBLE": 1})


@pytest.mark.parametrize("lanes", [*ONE_LANE_TOO, slow(16)])
def test_steps_of_denoising_compile_alone_without_a_warning(session, lanes):
    for step in ("FIRST", "TINTED", "LAST"):
        facts = dict.fromkeys(("FIRST", "TINTED", "LAST"), 0) | {step: 1, "VW": lanes}
        without_warnings(session, ["pass/denoise.cl"], facts)


@pytest.mark.parametrize("width", [4, 16])
def test_leaf_blocks_are_made_anew_by_kernels_without_a_warning(session, width):
    facts = {"LEAF_WIDTH": width, "VERTEX_FLOATS": 8, "BINS": 16}
    without_warnings(session, ["build/fill_blocks.cl"], facts)
    without_warnings(session, ["build/shift_blocks.cl"], facts)


@pytest.mark.parametrize("files", [FILES, *(slow([file]) for file in FILES)], ids=lambda files: files[0])
def test_kernels_that_build_trees_compile_without_a_warning(session, files):
    without_warnings(session, files, FACTS)


@pytest.mark.parametrize("path", sorted(kernels_dir().rglob("*.cl")), ids=lambda path: path.stem)
def test_file_holds_one_kernel_named_like_it(path: Path):
    text = path.read_text("utf-8")
    assert text.count("__kernel void ") == 1
    assert f"__kernel void {path.stem}(" in text


def test_build_options_keep_ieee_semantics():
    assert not [option for option in BUILD_OPTIONS for banned in BANNED if banned in option]


def test_same_source_is_built_once(session):
    first = session.program(["pass/trace_rays.cl"], {"VW": 1}, device_declarations())
    again = session.program(["pass/trace_rays.cl"], {"VW": 1}, device_declarations())
    other = session.program(["pass/trace_rays.cl"], {"VW": 8}, device_declarations())
    assert first is again
    assert first.identity != other.identity


def test_a_kernel_that_a_program_has_not_is_named(session):
    program = session.program(["probe/probe_unit_float.cl"], {"VW": 1}, device_declarations())
    with pytest.raises(DeviceError, match=r"has no kernel probe_of_nothing in what it built"):
        session.bind(program, "probe_of_nothing")
