"""What is measured of a render: its exposure, time, float32 in its lens, and its report; what zones lose to a lens."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LUMENS_PER_WATT, __version__
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import Maker, made_by
from rptcam_cl.device.session import Session
from rptcam_cl.optics.design import BOARD, NO_DETAIL, Problem
from rptcam_cl.optics.film_probe import UNMOVED, FilmFrame, FilmProbe
from rptcam_cl.optics.lens import Lens, thick_lens_of
from rptcam_cl.optics.ray_trace import Rays
from rptcam_cl.rendering.cameras import kinds, lens_records
from rptcam_cl.rendering.cameras import setting as lens_settings
from rptcam_cl.rendering.cameras.model import camera_geometry, camera_irradiance, exposed, values_per_irradiance
from rptcam_cl.rendering.cameras.setting import half_film_mm
from rptcam_cl.rendering.film import BLOCK, TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.passes import traces_in_float64
from rptcam_cl.rendering.plan.materials import LargestAlbedo
from rptcam_cl.rendering.plan.plan import Plan, make_plan, serve
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.rendering.progressive import FilmRun, Rendering, render_plan
from rptcam_cl.rendering.several import WHOLE, AnyWavefront, FilmPart, SharedWavefront, is_shared
from rptcam_cl.rendering.tracer import MemoryNeeds, Wavefront, WavefrontPool
from rptcam_cl.scene.camera import LensCamera
from rptcam_cl.scene.changes import at_rest, change_scene, set_keys
from rptcam_cl.scene.exposure import LEAST_CD_M2, LEAST_ISO, MOST_CD_M2, MOST_ISO, MOST_STOPS, Exposure
from rptcam_cl.scene.film import Film, FilmFilter, LensColour
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.quantities import LONGEST_S, SHORTEST_S
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.shapes import Board

# What a device's arithmetic costs in a lens: the same rays by the float64 reference and by the code that renders.

RAYS = 512
SEED = 20

Array = NDArray[np.float64]


_LensMargin = dict[str, Any]
"""The largest differences between float32, or float64, on a device and float64 on the host.

``rays``, ``passed``: that were sent from the film, and that pass in float64. ``other_fate``: that pass in one and not
in the other. ``position_mm``, ``direction``: of the rays that pass both, where they leave the lens [mm] and their unit
direction; None when none does. ``pixels``: the same in the plane in focus, in pixels at the scale of the picture's
centre; None also for a lens that has no focal length.
"""


def lens_margin(scene: Scene, session: Session) -> _LensMargin | None:
    """Measure what its precision costs in the lens of a scene's camera; None for cameras that trace no lens."""
    camera = scene.camera.traced_camera
    if camera is None or camera.rays == "fitted":
        return None
    # Few renders measure this, and the room takes long to import.
    from rptcam_cl.rendering.traceable_lens import trace_on_device

    setting = lens_settings.lens_setting(scene)
    lens, wavelength_nm = lens_records.shaped(scene, setting).lens, camera.wavelength_nm
    frame = lens_settings.film_frame(camera)
    origins, directions = film_rays(lens, setting.film_distance_mm, half_film_mm(scene), wavelength_nm, frame=frame)
    exact = lens.trace(origins, directions, wavelength_nm)
    traced = trace_on_device(lens, session, origins, directions, wavelength_nm, "film", camera.precision)
    return _compare(exact, traced, _pixels_per_radian(scene, setting), setting.focus_distance_mm)


def film_rays(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelength_nm: float,
    count: int = RAYS,
    frame: FilmFrame = UNMOVED,
) -> tuple[Array, Array]:
    """Return origins on the film and directions (n, 3) [mm], half to all of the last surface, half to the exit pupil.

    A lens whose exit pupil is infinitely far gets all of them over its last surface.
    """
    rng = np.random.default_rng(SEED)
    points = frame.points(rng.uniform(-1, 1, (count, 2)) * half_film_mm)
    film, depth = points[:, :2], points[:, 2]
    boxes = FilmProbe(lens, film_distance_mm, wavelength_nm, frame).windows(film)
    aims = boxes[:, ::2] + rng.random(film.shape) * (boxes[:, 1::2] - boxes[:, ::2])
    aims = np.column_stack([aims, np.full(count, lens.length)])
    pupil = lens.first_order(wavelength_nm).exit_pupil
    if np.isfinite(pupil.distance_mm) and np.isfinite(pupil.diameter_mm) and pupil.distance_mm < film_distance_mm:
        half = count // 2
        radius, turn = pupil.diameter_mm / 2 * np.sqrt(rng.random(half)), 2 * np.pi * rng.random(half)
        there = np.full(half, lens.film_z(pupil.distance_mm))
        aims[:half] = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), there])
    origins = np.column_stack([film, lens.film_z(film_distance_mm) + lens.sense * depth])
    return origins, aims - origins


def _pixels_per_radian(scene: Scene, setting: lens_settings.LensSetting) -> float | None:
    """Return the scale of the picture at its centre, None for a lens that has none."""
    try:
        thick = thick_lens_of(setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm)
    except InputError:
        return None
    return scene.film.resolution[0] / (scene.film.size_m()[0] * 1e3) / abs(float(thick.slope[0]))


def _compare(exact: Rays, traced: Rays, pixels_per_radian: float | None, focus_mm: float | None) -> _LensMargin:
    both = exact.passed & traced.passed
    margin = {
        "rays": len(both),
        "passed": int(exact.passed.sum()),
        "other_fate": int((exact.passed != traced.passed).sum()),
    }
    if not both.any():
        return margin | dict.fromkeys(("position_mm", "direction", "pixels"))
    apart = np.linalg.norm((traced.origins - exact.origins)[both], axis=1)
    turned = np.linalg.norm((traced.directions - exact.directions)[both], axis=1)
    angles = turned + (0.0 if focus_mm is None else apart / abs(focus_mm))
    pixels = None if pixels_per_radian is None else float(angles.max()) * pixels_per_radian
    return margin | {"position_mm": float(apart.max()), "direction": float(turned.max()), "pixels": pixels}


# What a render reports: statistics, metadata for the files of the picture, and its errors.

_OTHER_FATES = 0.01  # share of the rays that float32 may send elsewhere; near a rim a few do
LARGEST_ERROR_PX = 0.1  # that float32 may make in a lens


def _self_knowledge(
    plan: Plan, wavefront: AnyWavefront, rendering: Rendering, margin: _LensMargin | None
) -> dict[str, Any]:
    """Return the numerical part of a picture's statistics; see docs/numerics.md.

    Parameters
    ----------
    margin
        Of the lens as it is traced, where it was measured.
    """
    return {
        "samples_dropped": wavefront.not_finite(),
        "rays_not_converged": wavefront.outcomes()["no_convergence"] if plan.camera.has_lens else 0,
        "truncation": truncation(plan.albedo, wavefront.settings.max_depth),
        "noise": rendering.achieved,
        _key_of_margin(plan): margin,
    }


def _key_of_margin(plan: Plan) -> str:
    return f"{'float64' if traces_in_float64(plan.camera) else 'float32'}_lens"


def truncation(albedo: LargestAlbedo, max_depth: int) -> dict[str, Any]:
    """How much light paths longer than ``max_depth`` edges could bring at most.

    Every scattering leaves at most the largest albedo rho of what arrives, so that light scattered D times and more is
    at most rho^D / (1 - rho) of the brightest lamp's radiance.
    """
    if isinstance(albedo, str):
        return {"max_depth": max_depth, "largest_albedo": None, "bound": None, "no_bound_because": albedo}
    known: dict[str, Any] = {"max_depth": max_depth, "largest_albedo": albedo}
    if albedo >= 1.0:
        return known | {"bound": None, "no_bound_because": "a surface reflects all light"}
    return known | {"bound": albedo**max_depth / (1.0 - albedo)}


def summary(knowledge: dict[str, Any]) -> dict[str, Any]:
    """Sum up for the picture's metadata what follows from scene and samples alone, not from waves."""
    name, margin = _margin(knowledge)
    return {
        "samples_dropped": knowledge["samples_dropped"],
        "rays_not_converged": knowledge["rays_not_converged"],
        "truncation_bound": knowledge["truncation"]["bound"],
        **({} if margin is None else {f"{name}_lens_px": margin["pixels"], f"{name}_other_fate": margin["other_fate"]}),
    }


def _margin(knowledge: dict[str, Any]) -> tuple[str, dict[str, Any] | None]:
    """Return in what the lens is traced, and what that costs where it was measured."""
    name = "float64" if "float64_lens" in knowledge else "float32"
    return name, knowledge[f"{name}_lens"]


def anomalies(knowledge: dict[str, Any]) -> list[str]:
    """List the faults that a strict render must not have met, each in a few words; none where all is well."""
    faults = []
    if dropped := knowledge["samples_dropped"]:
        faults.append(f"{dropped} samples were not finite and were dropped")
    if lost := knowledge["rays_not_converged"]:
        faults.append(f"{lost} rays found no point on a surface of the lens")
    name, margin = _margin(knowledge)
    if margin is not None:
        if margin["other_fate"] > _OTHER_FATES * margin["rays"]:
            faults.append(
                f"{name} sends {margin['other_fate']} of {margin['rays']} rays through the lens elsewhere than the"
                f" float64 reference (allowed: {_OTHER_FATES:.0%})"
            )
        if (margin["pixels"] or 0.0) > LARGEST_ERROR_PX:
            faults.append(f"{name} errs by {margin['pixels']:.2g} px in the lens (allowed: {LARGEST_ERROR_PX:g} px)")
    return faults


# What the statistics repeat of the metadata, for programs that measure in pictures.
GEOMETRY = (
    "world_from_camera", "world_from_camera_at_close", "shutter", "intrinsics", "entrance_pupil", "resolution",
    "window", "film_size_mm", "near_m",
)  # fmt: skip


def _boards_of(scene: Scene) -> dict[str, Any]:
    """Describe the boards of a scene when the shutter opens, for its metadata; nothing without any."""
    boards = [
        item.described(index, scene.shutter.open_s, scene.metres_per_unit)
        for index, item in enumerate(scene.objects)
        if isinstance(item, Board)
    ]
    return {"boards": boards} if boards else {}


# Layers whose identifiers are read by the names of objects, and of materials.
_NAMING_OBJECTS = {"object_id", "crypto_object", "sharp_object_id", "sharp_class_id", "occlusion"}
_SPREAD_OF_SAMPLES = ("spp_min", "spp_mean")  # samples of the pixels that have fewest, and of all; `spp` is the most
_NAMING_MATERIALS = {"material_id", "crypto_material", "sharp_material_id"}


def window(scene: Scene) -> list[int]:
    """Return the part of the film that is rendered: x, y, width and height [pixels]."""
    layout = FilmLayout.of(scene.film)
    return [layout.x, layout.y, layout.width, layout.height]


def statistics(
    plan: Plan, wavefront: AnyWavefront, rendering: Rendering, times: dict[str, float], margin: _LensMargin | None
) -> dict[str, Any]:
    """Gather the statistics for programs that measure: samples, times, rays, noise and what the picture has lost.

    Parameters
    ----------
    times
        Of the stages of the render [s].
    margin
        What float32 costs in the lens, where it was measured.
    """
    devices = devices_of(wavefront, rendering)
    several = wavefront.wavefronts if isinstance(wavefront, SharedWavefront) else [wavefront]
    stats: dict[str, Any] = {
        "samples": int(rendering.samples.sum(dtype=np.uint64)),
        "spp": rendering.spp,
        "seconds": times,
        "msamples_per_second": rendering.new_samples / max(rendering.seconds, 1e-9) / 1e6,
        "device": ", ".join(dict.fromkeys(device["name"] for device in devices)),
        "devices": devices,
        "made_by": made_by(each.session.info.driver for each in several),
        "wave_size": wavefront.capacity,
        "not_finite": wavefront.not_finite(),
        "interrupted": rendering.interrupted,
    }
    if plan.camera.has_lens:
        stats["lens"] = wavefront.outcomes()
    if wavefront.settings.clamp is not None:
        stats["clamp"] = {"limit": wavefront.settings.clamp, "removed_share": wavefront.removed_share()}
    if plan.caustics.choice is not None:
        first = wavefront.wavefronts[0] if isinstance(wavefront, SharedWavefront) else wavefront
        stats["caustics"] = {"choice": plan.caustics.choice, "radius_m": first.photon_radius}
    if plan.virtual_lights.choice is not None:
        stats["virtual_lights"] = {"choice": plan.virtual_lights.choice}
    if rendering.noise is not None:
        stats["noise"] = rendering.noise | {
            "spp_min": int(rendering.samples.min()),
            "spp_mean": float(rendering.samples.mean()),
        }
    if rendering.resumed_from:
        stats["resumed_from"] = rendering.resumed_from
    stats["numerics"] = _self_knowledge(plan, wavefront, rendering, margin)
    return stats


def devices_of(wavefront: AnyWavefront, rendering: Rendering) -> list[dict[str, Any]]:
    """Describe what each device has done in this render: id, name, share, samples, seconds and speed."""
    if isinstance(wavefront, SharedWavefront):
        return wavefront.devices()
    info, samples = wavefront.session.info, rendering.new_samples
    speed = samples / max(rendering.seconds, 1e-9) / 1e6
    done = {"samples": samples, "seconds": rendering.seconds, "msamples_per_second": speed}
    return [{"id": info.id, "name": info.name, "share": 1.0, **done}]


def describe(
    scene: Scene, plan: Plan, spp: int, stats: Mapping[str, Any], found_before: Mapping[str, Any]
) -> dict[str, Any]:
    """Describe a picture in its metadata: the scene, its camera, and the render that has such statistics.

    ``found_before`` is what was found before the render: focus, camera model and exposure.
    """
    layers, content_hash, placed = scene.render.layers, scene.content_hash(), lens_settings.on_film(scene)
    metadata = {
        "software": f"rptcam_cl {__version__}",
        "version": __version__,
        "made_by": stats["made_by"],
        "scene_hash": content_hash,
        "picture_hash": scene.picture_hash(content_hash),
        "seed": scene.render.seed,
        "spp": spp,
        **{key: stats["noise"][key] for key in _SPREAD_OF_SAMPLES if "noise" in stats},
        "device": stats["device"],
        **({"work": stats["work"]} if is_shared(stats["work"]) else {}),
        "exposure": scene.exposure.mode,
        **{key: value for key, value in plan.camera.metadata.items() if value is not None},
        **plan.spectrum.metadata,
        **({} if plan.caustics.choice is None else {"caustics": plan.caustics.choice}),
        **({} if plan.virtual_lights.choice is None else {"virtual_lights": plan.virtual_lights.choice}),
        **camera_geometry(placed),
        "window": window(scene),
        **({"transparent": True} if scene.film.transparent else {}),
        **({"missing": list(scene.stand_ins)} if scene.stand_ins else {}),
        **({"object_names": plan.owners.objects} if _NAMING_OBJECTS & set(layers) else {}),
        **({"material_names": plan.owners.materials} if _NAMING_MATERIALS & set(layers) else {}),
        **_boards_of(scene),
        **found_before,
        "numerics": summary(stats["numerics"]),
    }
    if "entrance_pupil" in metadata:
        metadata["entrance_pupil"] = lens_settings.pupil_in_world(placed, metadata["entrance_pupil"])
    if "clamp" in stats:
        metadata["clamp"] = clamp_text(**stats["clamp"])
    return metadata


def of_makers(makers: Sequence[Maker]) -> dict[str, Any]:
    """Name in metadata the programs that made a picture: the first, and all where others have worked on it."""
    return {"made_by": makers[0]} | ({"mixed": list(makers)} if len(makers) > 1 else {})


def clamp_text(limit: float, removed_share: float) -> str:
    """Describe in metadata a limit of the samples."""
    return f"biased: samples above {limit:g} scaled down, {removed_share:.2%} of the light removed"


def describe_before(scene: Scene, plan: Plan, found_before: Mapping[str, Any]) -> dict[str, Any]:
    """The metadata of a picture that has no samples yet; `checkpoint.picture_of` fills in what follows from them."""
    knowledge = {
        "samples_dropped": 0,
        "rays_not_converged": 0,
        "truncation": truncation(plan.albedo, scene.render.max_depth),
        _key_of_margin(plan): None,
    }
    stats: dict[str, Any] = {"device": "", "made_by": None, "work": [], "numerics": knowledge}
    if scene.render.clamp is not None:
        stats["clamp"] = {"limit": scene.render.clamp, "removed_share": 0.0}
    return describe(scene, plan, 0, stats, found_before)


# What a render will take, before it is rendered: memory, kernel launches, and the time, by a measured piece of it.

MEASURED_SECONDS = 2.0


@dataclass(frozen=True)
class Forecast:
    """What a render will take.

    Attributes
    ----------
    samples : int
        Of the picture's pixels.
    devices : dict
        What each device will hold, by its identifier.
    saved_bytes : int
        Of the file that its state is kept in.
    launches : int
        Of kernels.
    seconds : float
        Of rendering, without preparing it [s].
    measured_seconds : float
        How long the piece took that this follows from [s].
    at_most : bool
        Whether a noise target may end it earlier.
    """

    samples: int
    devices: dict[str, MemoryNeeds]
    saved_bytes: int
    launches: int
    seconds: float
    measured_seconds: float
    at_most: bool


def forecast(
    wavefront: AnyWavefront, first: int, end: int, part: FilmPart = WHOLE, measure_s: float = MEASURED_SECONDS
) -> Forecast:
    """Foretell what the samples of each pixel from ``first`` to before ``end`` take; the film is of no use afterwards.

    Tiles all over the picture are rendered for a while, after a first wave that is not counted.

    Parameters
    ----------
    wavefront
        Compiled, its film is overwritten.
    part
        Which tiles; its samples do not matter here.
    measure_s
        How long to measure [s].
    """
    layout = wavefront.layout
    held = wavefront.wavefronts if isinstance(wavefront, SharedWavefront) else [wavefront]
    saved = sum(array.nbytes for array in part.pack(FilmRun(wavefront).state()[1], layout.tiles).values())
    tiles = part.tiles(layout.tiles)
    at_once = max(wavefront.capacity // wavefront.samples_per_wave, BLOCK) // TILE_PIXELS
    step = -(-len(tiles) // at_once)
    wavefront.choose_tiles(tiles[::step])
    some = len(tiles[::step])
    done = _render(wavefront, 0)
    begun, start, before = time.perf_counter(), done, sum(each.launches for each in held)
    while (seconds := time.perf_counter() - begun) < measure_s or done == start:
        done = _render(wavefront, done)
    share = (end - first) * len(tiles) / ((done - start) * some)
    return Forecast(
        samples=int(layout.pixels_of_tile[tiles].sum()) * (end - first),
        devices={each.session.info.id: each.needs for each in held},
        saved_bytes=saved,
        launches=int(np.ceil((sum(each.launches for each in held) - before) * share)),
        seconds=seconds * share,
        measured_seconds=seconds,
        at_most=wavefront.settings.noise is not None,
    )


def _render(wavefront: AnyWavefront, first: int) -> int:
    """Render some samples of the chosen tiles, and return the number of the next one."""
    count = wavefront.samples_per_wave
    for wave in wavefront.waves(first, count):
        wavefront.enqueue(*wave)
    wavefront.finish()
    return first + count


# Exposure `auto`: a small render through the same camera is metered, and the settings follow from it.

_METERED_SIDE = 96  # pixels
_METERED_SAMPLES = 1 << 15  # of each metered frame
METER_SEED = 0  # whatever the picture's, so that pictures with other noise have the same exposure
_CENTRE_SHARE = 0.75  # of the weight, in a disk half as wide as the frame's shorter side: 12 mm of 24 x 36 mm
SPOT_AREA = 0.02  # of the frame
_PARTS_A_SIDE = 8  # of a pixel's side, that lie within a disk or without
_METER_ERROR = 0.02  # share of a reading that its standard error may be: 0.03 stops
_METERED_FRAMES, _MOST_METERED = 4, 64  # that are rendered: at first, and at most


def resolve_exposure(
    scene: Scene, session: Session, known_cd_m2: float | None = None, held: dict[str, int] | None = None
) -> tuple[Scene, float | None, dict[str, Any]]:
    """Resolve the exposure of a scene, by metering on a device where its mode is `auto`.

    Parameters
    ----------
    known_cd_m2
        Reading of an earlier part of this render, in place of metering.
    held
        Facts of kernels that meter where they do; see `PlanParts`.

    Returns
    -------
    scene : Scene
        With mode ``auto`` replaced by the settings that it stands for.
    metered_cd_m2 : float or None
        The luminance that they follow from; None where nothing was to be metered.
    metadata : dict
        What the picture's metadata should say about the metering.

    Raises
    ------
    InputError
        When the metered part of the frame is black, or neither time nor sensitivity can make up for the light.
    """
    exposure = scene.exposure
    if exposure.mode != "auto":
        return scene, None, {}
    metadata: dict[str, Any] = {}
    if (reading := exposure.lock_cd_m2 or known_cd_m2) is None:
        reading, metadata["metered_error_cd_m2"] = metered_cd_m2(scene, session, held)
    metadata |= {"metered_cd_m2": reading, "metering": "locked" if exposure.lock_cd_m2 else exposure.metering}
    on_axis = camera_irradiance(kinds.camera_model(_relative(scene), coarse=True), exposure)
    keys = (
        _compensation(exposure, reading) if on_axis is None else _settings(scene, reading / LUMENS_PER_WATT * on_axis)
    )
    # Set as keys, which hold where keys of the shutter make the scene anew.
    return set_keys(scene, keys), reading, metadata


def metered_cd_m2(scene: Scene, session: Session, held: dict[str, int] | None = None) -> tuple[float, float]:
    """Return the mean luminance [cd/m²] of the metered part of the frame, as the lens would show it on the axis.

    With its standard error, for which more and more frames are rendered.

    Raises
    ------
    InputError
        When it is black.
    """
    small = _relative(scene, small=True)
    plan, readings, parts = None, np.empty(0), PlanParts()
    if held is not None:
        parts.held = held
        plan = serve(make_plan(at_rest(small), parts=parts), held)
    plan = plan or make_plan(at_rest(small))
    while True:
        for seed in range(METER_SEED + len(readings), METER_SEED + max(2 * len(readings), _METERED_FRAMES)):
            render = small.render.model_copy(update={"seed": seed})
            wavefront = Wavefront(session, plan, FilmLayout.of(small.film), render, scouts=False)
            rendering = render_plan(wavefront, spp=render.spp, seconds=None, has_lens=plan.camera.has_lens)
            readings = np.append(readings, reading_cd_m2(rendering.pixels, scene.exposure, small.film))
        reading, error = float(readings.mean()), float(readings.std(ddof=1)) / math.sqrt(len(readings))
        if error <= _METER_ERROR * reading or len(readings) >= _MOST_METERED:
            break
    if not LEAST_CD_M2 <= reading <= MOST_CD_M2:
        raise InputError(
            f"exposure: auto metering ({scene.exposure.metering}) finds no light to go by (got {reading:.3g} cd/m²;"
            " allowed: a scene with light in the metered part of the frame, or mode relative or physical)"
        )
    return reading, error


def reading_cd_m2(radiances: NDArray[np.floating], exposure: Exposure, film: Film) -> float:
    """The reading of the meter for a film (height, width, 3) of radiances [W/(m² sr)], in cd/m²."""
    values = luminance(radiances)
    return float(np.sum(values * weights(exposure, film))) * LUMENS_PER_WATT


def weights(exposure: Exposure, film: Film) -> NDArray[np.float64]:
    """How much each pixel (height, width) counts, 1 in all."""
    columns, rows = film.resolution
    width, height = film.size_m()
    x, y = (
        (np.arange(_PARTS_A_SIDE * count) + 0.5) / (_PARTS_A_SIDE * count) * side
        for count, side in ((columns, width), (rows, height))
    )
    if exposure.metering == "average":
        return np.full((rows, columns), 1.0 / (rows * columns))
    spot = exposure.metering == "spot"
    at = exposure.spot_at if spot else (0.5, 0.5)
    radius = math.sqrt(SPOT_AREA * width * height / math.pi) if spot else min(width, height) / 4
    square = (x[None, :] - at[0] * width) ** 2 + (y[:, None] - at[1] * height) ** 2
    inside = (
        (square <= max(radius**2, float(square.min())))
        .reshape(rows, _PARTS_A_SIDE, columns, _PARTS_A_SIDE)
        .mean(axis=(1, 3))
    )
    outside = 1.0 - inside
    share = _CENTRE_SHARE if outside.any() and not spot else 1.0
    return np.asarray(share * inside / inside.sum() + (1.0 - share) * outside / (outside.sum() or 1.0))


def _relative(scene: Scene, *, small: bool = False) -> Scene:
    """Return the scene whose film values are radiances, of the size to be metered or as it is."""
    update: dict[str, Any] = {"exposure": Exposure()}
    if small:
        columns, rows = scene.film.resolution
        factor = min(1.0, _METERED_SIDE / max(columns, rows))
        down = max(round(rows * factor), 1)
        across = 2 * down if scene.camera.sees_all_around else max(round(columns * factor), 1)
        whole = scene.film.whole_in((across, down)) | {"filter": FilmFilter(), "transparent": False}
        clamped = scene.render.clamp is not None and scene.render.caustics == "auto"
        samples = {"spp": max(_METERED_SAMPLES // (across * down), 1), "seed": METER_SEED, "noise": None, "layers": ()}
        light = {"clamp": None, "caustics": "off" if clamped else scene.render.caustics}
        update["film"] = scene.film.model_copy(update=whole)
        update["render"] = scene.render.model_copy(update=samples | light)
    return scene.model_copy(update=update)


def _compensation(exposure: Exposure, reading_cd_m2: float) -> dict[str, Any]:
    """Return the keys that bring a mean luminance to the target where values are radiances.

    Raises
    ------
    InputError
        When it would be beyond what a scene may have.
    """
    stops = math.log2(exposure.target * LUMENS_PER_WATT / reading_cd_m2) + exposure.ev
    _check_range("exposure compensation in stops", stops, -MOST_STOPS, MOST_STOPS)
    return {"exposure": {"mode": "relative", "ev": stops}}


def _settings(scene: Scene, irradiance: float) -> dict[str, Any]:
    """Return the keys that bring a mean irradiance of the film to the target: by the time, or by the ISO.

    Raises
    ------
    InputError
        When they would be beyond what a scene may have.
    """
    exposure, time_s = scene.exposure, scene.shutter.time_s
    wanted = exposure.target * 2.0 ** (exposure.ev + exposure.neutral_density_stops) / irradiance
    if exposure.priority == "shutter":
        iso = wanted / values_per_irradiance(time_s, 1.0)
        what, value, least, most = "ISO", iso, LEAST_ISO, MOST_ISO
    else:
        iso = exposure.iso
        time_s = wanted / values_per_irradiance(1.0, iso)
        what, value, least, most = "exposure time in s", time_s, SHORTEST_S, LONGEST_S
    _check_range(what, value, least, most)
    settings = {"mode": "physical", "iso": iso, "neutral_density_stops": exposure.neutral_density_stops}
    settings |= {} if exposure.f_number is None else {"f_number": exposure.f_number}
    return {"exposure": settings, "shutter.time_s": time_s}


def _check_range(what: str, value: float, least: float, most: float) -> None:
    if not least <= value <= most:
        raise InputError(
            f"exposure: auto metering needs an {what} out of range (got {value:.3g}; allowed: {least:g} to {most:g})"
        )


# What zones of a picture show through a lens.

BOARD_PIXELS, BOARD_SQUARE = 1800, 10  # across the film of the built-in board; of one of its squares
ZONE = 1 / 40  # of the film's width: side of a zone where none is given
_CLOSED = 0.02  # of the stop's diameter: blur is that much smaller in the picture that others are compared with
PICTURES = 4  # independent pictures of each zone
ZONE_SAMPLES = 256  # per pixel: with 64 a search makes the noise of one zone its own, 9.6 for 11.9 %
FAR_LENGTHS = 1e4  # focal lengths, in which the image moves by a ten-thousandth of one
TURN = math.atan(1 / 7)  # of the board: edges along rows of pixels blur by where between them they lie, 10 or 20 %
_LEAST_SIDE = 8  # of a zone [pixels]
LEAST_DETAIL = 0.2  # of the squares of one picture, noise among them: the noise of a zone without detail is no detail


def board(problem: Problem, lengths: float = 100.0, turn: float = 0.0) -> Scene:
    """Return the scene ``board`` of a problem: squares that fill the film, so many focal lengths away, turned [rad]."""
    length = problem.focal_length_mm
    half = length * math.tan(math.radians(max(problem.fields_degrees) or 5.0))
    away, height = lengths * length / 1000, 2 * half * 2 / 3
    if math.isfinite(problem.object_distance_mm):
        raise InputError(f"{BOARD} stands far away; of a near object give a scene with the lens focused on it")
    beyond, cos, sin = 1.1 + 1.5 * math.sin(turn), math.cos(turn), math.sin(turn)
    across, up = (away / length * side * beyond for side in (2 * half, height))
    u, v = np.array([across * cos, across * sin, 0.0]), np.array([-up * sin, up * cos, 0.0])
    squares = beyond * BOARD_PIXELS / BOARD_SQUARE
    checks = {"kind": "checker", "even": 0.04, "odd": 0.85, "scale": [squares, squares * 2 / 3]}
    return load_scene({
        "film": {"resolution": [BOARD_PIXELS, BOARD_PIXELS * 2 // 3], "width_mm": 2 * half},
        "camera": {"kind": "realistic", "eye": [0, 0, away], "target": [0, 0, 0], "lens": "cooke-triplet-50mm",
                   "focus": {"distance_m": away, "method": "spot"}},
        "render": {"spp": 128},
        "objects": [{"shape": "rectangle", "corner": (-(u + v) / 2).tolist(), "edge_u": u.tolist(),
                     "edge_v": v.tolist(), "material": {"kind": "matte", "reflectance": checks}}],
        "environment": {"kind": "constant", "radiance": 1},
    })  # fmt: skip


class ZoneBlur(NamedTuple):
    """What zones lose to a lens.

    Attributes
    ----------
    value : float
        Rms over the zones [%].
    residuals : (2 zones,) array
        Whose squares add up to that of the value; then what each zone lacks [%] of the light through the first lens,
        so that a search takes none for sharper that is darker.
    error : float
        Standard error of the value.
    zones : list of (value, error)
    """

    value: float
    residuals: Array
    error: float
    zones: list[tuple[float, float]]


def blur_of_zones(
    problem: Problem, session: Session, samples: int = ZONE_SAMPLES, seed: int = 0
) -> Callable[[Lens, float], ZoneBlur]:
    """Return the function that renders the zones of a problem through a lens with its film somewhere [mm].

    They are rendered too at the camera's wavelength with the stop all but closed: sharp, but drawn as the lens draws
    them. The blur of a zone is the rms of the difference of both, relative to the rms of that one [%]; infinite of a
    lens that forms no picture. Light that varies slowly, and by how much the whole zone is shifted, count for nothing;
    noise adds nothing on the average. Lenses that are alike have it alike. Diffraction is left out.

    Raises
    ------
    InputError
        For a scene without a realistic camera, and fields beyond its film.
    """
    given = board(problem, FAR_LENGTHS, TURN) if problem.scene == BOARD else load_scene(problem.scene)
    if given.camera.traced_camera is None:
        raise InputError(f"{problem.scene}: camera.kind: must be realistic, so that a lens takes the picture")
    scene = change_scene(given, render={"layers": (), "noise": None}).model_copy(update={"exposure": Exposure()})
    pictures = _ZonePictures(session, scene, problem.zones or tuple(_zones_at_fields(problem, scene)), samples, seed)
    first: list[Array] = []  # light in the zones through the first lens

    def blur(lens: Lens, film_mm: float) -> ZoneBlur:
        nothing = ZoneBlur(math.inf, np.full(2 * len(pictures.layouts), math.inf), 0.0, [])
        if not film_mm > 0:
            return nothing
        closed = lens.with_stop_diameter(2 * _CLOSED * lens.surfaces[lens.stop_index or 0].semi_diameter)
        try:
            (shown, light), (sharp, _) = pictures.take(lens, film_mm, "on"), pictures.take(closed, film_mm, "off")
        except (InputError, ArithmeticError):  # no light, or no lens at all
            return nothing
        if not first:
            first.append(light)
        lacking = 100 * np.clip(1 - light / np.where(first[0] > 0, first[0], 1.0), 0.0, None) / math.sqrt(len(light))
        found = [_blur(*each) for each in zip(shown, sharp, strict=True)]
        shares, errors = np.array(found).T / math.sqrt(len(found))
        value = float(np.linalg.norm(shares))
        residuals = np.concatenate([shares, lacking])
        return ZoneBlur(value, residuals, float(np.linalg.norm(shares * errors)) / (value or 1.0), found)

    return blur


class _ZonePictures:
    """Renders zones of a scene's film, `PICTURES` of each with other samples, through any lens."""

    def __init__(
        self, session: Session, scene: Scene, zones: Sequence[Sequence[float]], samples: int, seed: int
    ) -> None:
        (width, height), self._camera = scene.film.resolution, lens_settings.lens_camera(scene)
        corners = np.round(np.reshape(zones, (-1, 2, 2)).swapaxes(1, 2) * (width, height)).astype(int)
        corners[:, 1] = np.maximum(corners[:, 1] - corners[:, 0], _LEAST_SIDE)
        self.layouts = [FilmLayout(width, height, *each.ravel().tolist()) for each in corners]
        self._windows = [_window(scene, self._camera, zone) for zone in zones]
        self._scene, self._count, self._seed = scene, -(-samples // PICTURES), seed
        self._pool, self._parts = WavefrontPool(session), PlanParts()

    def take(self, lens: Lens, film_mm: float, colour: LensColour) -> tuple[list[Array], Array]:
        """Return of each zone what differs from light that varies slowly, (`PICTURES`, height, width), over its mean
        light; and the mean light of each."""
        use = lens_settings.LensSetting(lens, film_mm, None, self._camera)
        model = kinds.camera_of(self._scene, use).model(colour, windows=self._windows)
        plan = make_plan(self._scene, exposed(model, self._scene), parts=self._parts)
        buffers, shown, means = self._pool.upload(plan), [], []
        for number, layout in enumerate(self.layouts):
            wavefront = self._pool.wavefront(plan, buffers, layout, self._scene.render, f"{colour} {number}")
            light = []
            for part in range(PICTURES):
                wavefront.clear()
                wavefront.seed = self._seed * PICTURES + part
                for wave in wavefront.waves(0, self._count):
                    wavefront.enqueue(*wave)
                wavefront.finish()
                light.append(luminance(wavefront.picture(self._count).astype(np.float64)))
            means.append(float(np.mean(light)))
            flat = np.stack(light).reshape(PICTURES, -1) / (means[-1] or 1.0)
            x, y = np.meshgrid(np.linspace(-1, 1, layout.width), np.linspace(-1, 1, layout.height))
            terms, _ = np.linalg.qr(np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).reshape(-1, 6))
            shown.append((flat - flat @ terms @ terms.T).reshape(PICTURES, layout.height, layout.width))
        return shown, np.array(means)


def _window(scene: Scene, camera: LensCamera, zone: Sequence[float]) -> tuple[float, float, float, float]:
    """Return the part of the film that a zone needs [mm]: itself and what the filter reaches."""
    beyond = (1 + scene.film.filter.radius) / np.array(scene.film.resolution)
    (left, top), (right, bottom) = np.reshape(zone, (2, 2)).T + np.outer((-1, 1), beyond)
    x, y, _ = np.array([lens_settings.film_point(scene, camera, *at) for at in product((left, right), (top, bottom))]).T
    return float(x.min()), float(x.max()), float(y.min()), float(y.max())


def _zones_at_fields(problem: Problem, scene: Scene) -> Iterator[tuple[float, ...]]:
    """Yield a square zone at each field, right of the middle of the picture and as a whole within it."""
    width, height = (side * 1e3 for side in scene.film.size_m())
    for degrees in problem.fields_degrees:
        at = 0.5 + problem.focal_length_mm * math.tan(math.radians(degrees)) / width
        if at > 1 + 1e-9:
            raise InputError(
                f"{problem.scene}: the film does not reach to {degrees:g} degrees (give zones, or a wider film)"
            )
        at = min(at, 1 - ZONE / 2)
        high = ZONE / 2 * width / height
        yield at - ZONE / 2, at + ZONE / 2, 0.5 - high, 0.5 + high


def _blur(shown: Array, sharp: Array) -> tuple[float, float]:
    """Return the rms difference of two pictures (parts, height, width), over that of the sharp one [%], and its error.

    Products of different parts take the place of squares, which the noise would add to; the error is by jackknife.
    """
    slopes = np.stack([slope.ravel() for slope in np.gradient(sharp.mean(axis=0))], axis=1)
    off, whole = (shown - sharp).reshape(PICTURES, -1), sharp.reshape(PICTURES, -1)
    off = off - slopes @ np.linalg.lstsq(slopes, off.mean(axis=0))[0]

    def ratio(kept: NDArray[np.intp]) -> float:
        squares = [one[kept].sum(axis=0) ** 2 - (one[kept] ** 2).sum(axis=0) for one in (off, whole)]
        lost, all_ = (float(each.sum()) / (len(kept) - 1) for each in squares)
        seen = all_ > LEAST_DETAIL * float((whole[kept] ** 2).sum())
        return 100 * math.sqrt(max(lost, 0.0) / all_) if seen else NO_DETAIL

    every = np.arange(PICTURES)
    without = np.array([ratio(np.delete(every, part)) for part in every])
    return ratio(every), float(np.sqrt((PICTURES - 1) * np.mean((without - without.mean()) ** 2)))
