"""Renders tiny scenes so that every kernel of the passes and of the builds of trees runs; for a simulator of a device.

    oclgrind … python -m tests.device.every_kernel NAME

Prints the names of the kernels that ran. `RENDERS` says what each name renders.
"""

import json
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np

import rptcam_cl
from rptcam_cl.api import compiling
from rptcam_cl.device import devices, programs, session
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.rendering import culling, film, ghosts, photon_map, tracer, tree_build, virtual_lights
from rptcam_cl.rendering import passes as ways
from rptcam_cl.rendering.traceable_lens import CopiesTracer
from rptcam_cl.scene.film import SINGLE_LAYERS
from tests.device.test_kernels import EVERY_MATERIAL, IMAGE
from tests.rendering.pictures import room_lit_by_detours
from tests.rendering.test_bokeh import CASES
from tests.rendering.test_determinism import LENS
from tests.rendering.test_world import PLANE, still_life
from tests.rendering.trees.meshes import soup

SIZE = (8, 4)
SKY = {"kind": "sky", "sun_elevation_degrees": 60, "sun_azimuth_degrees": 0}
FEW_SURFACES = "biconvex-stop"  # two: a lens of ten has 45 pairs that make ghosts
TREES = {"gather", "histogram", "partition", "subtree", "leaves", "search", "reinsert"}
WAVE = {"generate", "intersect", "sort", "shade", "shadow", "film"}


def small_waves() -> None:
    """Have sessions take waves of 256 paths: the state of a million takes a simulator gigabytes."""
    film.WAVE_SLOTS = dict.fromkeys(film.WAVE_SLOTS, 256)


def shown(scene: dict[str, Any], *, caustics: str = "off", **options: Any) -> None:
    """Render a sample or two of every pixel; photons take a simulator half an hour."""
    scene = scene | {"render": {"max_depth": 3, "roulette_depth": 2, "caustics": caustics}}
    picture = np.asarray(rptcam_cl.render(scene, size=SIZE, spp=2, wave_size=256, **options))
    assert np.isfinite(picture).all()
    assert picture.max() > 0


def passes() -> None:
    """Every shape, lamp and texture through a pinhole."""
    shown(still_life())


def stream() -> None:
    """The same in one kernel, which processors prefer; lamps behind glass, too."""
    tracer.ORGANISATION = dict.fromkeys(tracer.ORGANISATION, "stream")
    shown(still_life())
    behind_glass()


def lens() -> None:
    """A lens traced in float32, with losses and wavelengths, and one in float64."""
    camera = LENS | {"transmission": {"coating": "mgf2"}}
    shown(still_life() | {"camera": camera, "spectrum": "dispersive"})
    shown(still_life() | {"camera": LENS | {"precision": "double"}})
    shown(still_life() | {"camera": LENS | {"rays": "fitted"}})
    rays = rptcam_cl.load_lens("dgauss-50mm").trace([[0, 0, 70]], [[0, 0, -1]], start="film", device=open_session())
    assert rays.passed.all()
    merit = {"fields_degrees": [0, 5], "rings": 2, "arms": 4}
    tolerances = {"copies": 10, "merit": merit, "tolerances": [{"radius_percent": 0.1}, {"decentre_mm": 0.02}]}
    rptcam_cl.tolerance(rptcam_cl.load_lens(FEW_SURFACES), tolerances, trace=CopiesTracer(open_session()).film_points)


def meshes() -> None:
    """Instances of a mesh of which trees are built from large nodes and small ones; layers of what is seen."""
    tree_build.SMALL = dict.fromkeys(tree_build.SMALL, 16)
    mesh = {
        "vertices": soup(40, 0.5).reshape(-1, 3).tolist(),
        "faces": [[3 * k, 3 * k + 1, 3 * k + 2] for k in range(40)],
    }
    shape = {"shape": "mesh", "mesh": "soup", "material": {"kind": "matte", "reflectance": 0.5}}
    scene = still_life()
    objects = [*scene["objects"][:2], shape, shape | {"transform": [{"translate": [0, 0, 0.2]}]}]
    scene |= {"meshes": {"soup": mesh}, "objects": objects, "render": {"max_depth": 3, "caustics": "off"}}
    shown(scene, layers=list(SINGLE_LAYERS))
    small_waves()
    with rptcam_cl.RenderSession(scene, size=SIZE) as viewed:  # its triangles move about the eye
        viewed.change({"camera.eye": [0.3, -5.5, 1.4]})
        assert viewed.take().pixels.max() > 0


def denoised() -> None:
    """A picture of a session without its noise, guided by layers that its lens shows."""
    small_waves()
    scene = still_life() | {"camera": LENS, "render": {"max_depth": 3, "caustics": "off"}}
    with rptcam_cl.RenderSession(scene, size=SIZE) as viewed:
        frame = viewed.take(2)
        while (clean := viewed.denoised(frame)) is None:  # while kernels are compiled in the background
            time.sleep(0.05)
        assert np.isfinite(clean).all()


def tree_of_shapes() -> None:
    """A tree over shapes that the device builds, however few."""
    culling.BREAK_EVEN = tree_build.FEW = 0
    shown(still_life())


def everything() -> None:
    """Every material in spectra, under a moving camera."""
    scene = still_life()
    planes = [PLANE | {"material": name} for name in EVERY_MATERIAL]
    moving = [{"time_s": 0}, {"time_s": 1e-3, "eye": [0.6, -5, 2]}]
    shown(
        scene
        | {"materials": EVERY_MATERIAL, "objects": [*scene["objects"], *planes], "spectrum": "spectral"}
        | {"camera": scene["camera"] | {"motion": moving}},
        caustics="auto",
    )


def media() -> None:
    """Fog around all, smoke in a box without a surface, and a ball of wax."""
    scene = still_life()
    smoke = {"kind": "boundary", "interior": {"scattering_per_m": 1.0, "absorption_per_m": 0.5, "asymmetry": 0.5}}
    box = {"shape": "box", "min": [-1, -1, 0], "max": [1, 1, 1], "material": smoke}
    colour = {"kind": "checker", "even": [0.9, 0.8, 0.6], "odd": [0.5, 0.2, 0.1]}
    wax = {"kind": "dielectric", "index": 1.45, "interior": {"color": colour, "free_path_mm": 100}}
    ball = {"shape": "sphere", "center": [-2, -1, 0.5], "radius": 0.5, "material": wax}
    shown(scene | {"medium": {"visibility_m": 50, "emission_per_m": 0.01}, "objects": [*scene["objects"], box, ball]})


def layered_fog() -> None:
    """Fog that thins out upwards, from within and from above."""
    for base in (0.5, -2.0):
        shown(still_life() | {"medium": {"visibility_m": 50, "layer": {"scale_height_m": 0.5, "base": base}}})


def smoke() -> None:
    """Smoke and fire whose density lies on a grid, in fog of droplets; layers of what is seen through them."""
    grid = np.random.default_rng(1).uniform(0, 3, (9, 3, 12)).astype(np.float32)
    density = {"file": grid, "min": [-1, -1, 0], "max": [1, 1, 1]}
    fire = {"kind": "boundary", "interior": {"scattering_per_m": 1, "emission_per_m": 0.1, "density": density}}
    scene = still_life()
    box = {"shape": "box", "min": [-1, -1, 0], "max": [1, 1, 1], "material": fire}
    fog = {"visibility_m": 50, "droplets_um": 15}
    shown(scene | {"medium": fog, "objects": [*scene["objects"], box]}, layers=["depth", "transmittance"])


def hair() -> None:
    """Strands of hair and flat blades, in a tree over shapes; a lamp that only light samples find."""
    culling.BREAK_EVEN = 0
    scene = still_life()
    strand = [[0, 0, 0.1, 0.1], [0.1, 0, 0.5, 0.08], [0, 0.1, 0.9, 0.06], [0.1, 0, 1.3, 0.02]]
    kinds = {"tube": {"kind": "hair", "eumelanin": 0.5}, "flat": {"kind": "translucent", "reflectance": 0.4}}
    curves = [
        {"shape": "curves", "form": form, "points": strand, "material": kinds[form]}
        | {"transform": [{"translate": [x, -1, 0]}]}
        for x, form in zip((-1.0, 0.5), kinds, strict=True)
    ]
    disk = scene["objects"][7] | {"visible": {"reflection": False}}
    shown(scene | {"objects": [scene["objects"][0], disk, *curves]})


def many_lamps() -> None:
    """A tree of lamps over surfaces whose facets have lobes, and tables of what they scatter once."""
    scene = still_life()
    lights = [
        {"kind": "point", "position": [x, y, 0.3], "intensity": 1} for x in (-3, -1, 1, 3) for y in (-3, -1, 1, 3)
    ]
    kinds = (
        {"kind": "conductor", "metal": "gold", "alpha": [0.1, 0.3]},
        {"kind": "plastic", "reflectance": 0.5, "roughness": 0.3},
        {"kind": "dielectric", "alpha": [0.1, 0.3]},
        {"kind": "principled", "roughness": IMAGE, "transmission": 1},
    )
    balls = [
        {"shape": "sphere", "center": [x, -2, 0.4], "radius": 0.4, "material": kind}
        for x, kind in zip((-1.5, -0.5, 0.5, 1.5), kinds, strict=True)
    ]
    lights += scene["lights"]
    shown(scene | {"objects": [scene["objects"][0], *scene["objects"][7:], *balls], "lights": lights})


def ring() -> None:
    """A lens of mirrors, whose pupil is a ring, before little else than lamps that light reaches the film from."""
    scene = still_life()
    camera = LENS | {"lens": "mirror-500mm", "focus": {"distance_m": 6.0}}
    shown(scene | {"camera": camera, "objects": [scene["objects"][k] for k in (0, 7)]})


def conjugates() -> None:
    """A lens whose aberrations waves bring, so that its rays go to conjugates; those of a lamp out of focus, too."""
    bokeh = CASES["far"]
    camera = bokeh["camera"] | {"f_number": 4, "diffraction": "on"}
    ahead = camera["focus"]["distance_m"]
    ball = {"shape": "sphere", "center": [0, 0, -ahead - 0.002], "radius": 0.002,
            "material": {"kind": "matte", "reflectance": 0.5}}  # fmt: skip
    film = {"resolution": [240, 160], "width_mm": 1.2, "crop": [0.45, 0.5, 0.45, 0.5]}  # of pixels that waves show on
    scene = bokeh | {"camera": camera, "film": film, "objects": [*bokeh["objects"], ball]}
    picture = rptcam_cl.render(scene, spp=1, wave_size=256)
    assert picture.metadata["lamps_aimed_at"] > 0


def mixtures() -> None:
    """Mixtures of textures, in reflectance and roughness, and the light of each group of lamps apart."""
    scene = still_life()
    checker = {"kind": "checker", "even": 0.7, "odd": 0.2}
    inner = {"kind": "mixture", "first": {"kind": "marble"}, "second": IMAGE, "amount": [0.2, 0.5, 0.9]}
    floor = scene["objects"][0] | {
        "material": {"kind": "plastic", "reflectance": {"kind": "mixture", "first": inner, "second": checker}}
    }
    lights = [lamp | {"group": f"lamp{k}"} for k, lamp in enumerate(scene["lights"])]
    shown(scene | {"objects": [floor, *scene["objects"][1:]], "lights": lights}, layers=["lights"])


def behind_glass() -> None:
    """A lamp in a clear globe, and a sun and a sky through a pane: light samples go on through their glass."""
    scene = still_life()
    glass, lamp = {"kind": "dielectric", "index": 1.5}, {"kind": "emissive", "radiance": 30}
    globe = [
        {"shape": "sphere", "center": [-1, -1, 0.6], "radius": radius, "material": kind}
        for radius, kind in ((0.5, glass), (0.45, glass), (0.1, lamp))
    ]
    pane = {"shape": "box", "min": [-3, -3, 2], "max": [3, 3, 2.1], "material": glass}
    lit = {"objects": [scene["objects"][0], *globe, pane], "lights": [], "environment": SKY}
    shown(scene | lit)


def detours() -> None:
    """Virtual lights, to which paths of a room connect that is lit by detours, with glass, photons and holes."""
    kinds = [
        {"kind": "dielectric", "absorption_per_m": 1.0}, {"kind": "dielectric", "roughness": 0.6},
        {"kind": "principled", "base_color": 0.5, "roughness": 0.5, "transmission": 0.5, "opacity": 0.5},
    ]  # fmt: skip
    balls = [
        {"shape": "sphere", "center": [0.5 * place - 0.5, 0.4, 0], "radius": 0.2, "material": material}
        for place, material in enumerate(kinds)
    ]
    scene = room_lit_by_detours(resolution=(8, 8), depth=4, objects=balls)
    scene["render"]["caustics"] = "on"
    picture = rptcam_cl.render(scene, spp=2, wave_size=256)
    assert picture.metadata["virtual_lights"].startswith("on")
    assert picture.metadata["caustics"].startswith("on")


def light_of_lamps() -> None:
    """Photons through glass, and ghosts between the surfaces of a lens."""
    bokeh = CASES["far"]
    camera = bokeh["camera"] | {"lens": FEW_SURFACES, "ghosts": "on", "transmission": {"coating": "bare"}}
    scene = bokeh | {"camera": camera, "objects": bokeh["objects"][:1]}
    picture = rptcam_cl.render(scene, size=(12, 8), spp=1, wave_size=256)
    assert picture.metadata["ghosts"]["ways"] == 1
    caustics = {"max_depth": 3, "roulette_depth": 2, "caustics": "on"}
    rptcam_cl.render(still_life() | {"render": caustics}, size=SIZE, spp=2, wave_size=256)


RENDERS: dict[str, tuple[Callable[[], None], set[str]]] = {
    "passes": (passes, WAVE),
    "stream": (stream, {"stream"}),
    "lens": (lens, WAVE | {"aim_rays", "trace_copies", "trace_lens", "trace_rays"}),
    "meshes": (meshes, WAVE | TREES | {"fill_blocks", "shift_blocks", "layers", "sharp"}),
    "denoised": (denoised, WAVE | {"layers", "guides", "denoise"}),
    "tree of shapes": (tree_of_shapes, WAVE | (TREES - {"histogram", "partition", "search", "reinsert"})),
    "everything": (everything, WAVE | {"photons"}),
    "media": (media, WAVE - {"intersect"} | {"travel"}),
    "layered fog": (layered_fog, WAVE - {"intersect"} | {"travel"}),
    "smoke": (smoke, WAVE - {"intersect"} | {"travel", "layers"}),
    "hair": (hair, WAVE),
    "many lamps": (many_lamps, WAVE),
    "ring": (ring, WAVE),
    "conjugates": (conjugates, WAVE | {"occluded", "sharp"}),
    "mixtures": (mixtures, WAVE),
    "behind glass": (behind_glass, WAVE),
    "detours": (detours, WAVE | {"light_paths", "photons"}),
    "light of lamps": (light_of_lamps, WAVE | {"photons", "ghosts", "occluded"}),
}


class AtOnce(ThreadPoolExecutor):
    """Does what it is given in the thread that gives it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return what has been done."""
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


def heed_oclgrind() -> None:
    """Go round what Oclgrind 21.10 has wrong, and what takes it minutes."""
    # it calls itself a GPU, whose speed a trial measures
    devices.try_device = lambda handle: devices.Trial()  # type: ignore[assignment]
    # and whose driver one of its own tries
    ways._first_right = lambda *_: 0  # type: ignore[assignment]
    # optimised, the mirrored digits of the lattice become an instruction that it does not know
    programs.BUILD_OPTIONS = (*programs.BUILD_OPTIONS, "-cl-opt-disable")
    # it takes memory that a command has filled for uninitialised
    Session.fill_zero = lambda self, buffer, size: self.write(buffer, np.zeros(size, np.uint8))  # type: ignore[method-assign]
    # and new memory in the place of old for initialised, so that none is given back
    allocated, kept = Session._allocate, []

    def keep(self: Session, make: Any, size: int) -> Any:
        kept.append(allocated(self, make, size))
        return kept[-1]

    Session._allocate = keep  # type: ignore[method-assign]

    # 16,384 photons of the first pass and 4096 of each later take it half an hour
    photon_map.PILOT_PHOTONS = photon_map._LEAST_PHOTONS = 512
    virtual_lights._LEARNING_PATHS = virtual_lights._LEAST_PATHS = 256
    virtual_lights._MOST_PATHS = 256

    # and the four million rays of ghosts an hour
    ghosts._LEAST_RAYS, ghosts.PER_PIXEL, ghosts.SCOUTS, ghosts._SECOND_SCOUTS = 1 << 12, 1.0, 64, 128

    # and it crashes where another thread than the first writes to its memory
    compiling.ThreadPoolExecutor = AtOnce  # type: ignore[assignment,misc]


def main() -> None:
    """Render what the argument names."""
    heed_oclgrind()
    ran: set[str] = set()
    enqueue = session.Launch.enqueue

    def noted(self: session.Launch, *where: int) -> Any:
        ran.add(self.name)
        return enqueue(self, *where)

    session.Launch.enqueue = noted  # type: ignore[method-assign]
    RENDERS[sys.argv[1]][0]()
    print(json.dumps({"device": open_session().info.name, "lanes": open_session().lanes, "kernels": sorted(ran)}))


if __name__ == "__main__":
    main()
