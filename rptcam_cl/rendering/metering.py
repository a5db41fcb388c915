"""Exposure ``auto``: a small render through the same camera is metered, and the settings follow from it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.model import camera_irradiance, values_per_irradiance
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.plan import make_plan, serve
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import at_rest, set_keys
from rptcam_cl.scene.exposure import LEAST_CD_M2, LEAST_ISO, MOST_CD_M2, MOST_ISO, MOST_STOPS, Exposure
from rptcam_cl.scene.film import Film, FilmFilter, RenderSettings
from rptcam_cl.scene.quantities import LONGEST_S, SHORTEST_S
from rptcam_cl.scene.scene import Scene

LONGEST_SIDE = 96  # pixels
SAMPLES = 1 << 15  # of each metered frame
SEED = 0  # whatever the picture's, so that pictures with other noise have the same exposure
_CENTRE_SHARE = 0.75  # of the weight, in a disk half as wide as the frame's shorter side: 12 mm of 24 x 36 mm
SPOT_AREA = 0.02  # of the frame
PARTS = 8  # of a pixel's side, that lie within a disk or without
STAYS = 0.02  # share of a reading that its standard error may be: 0.03 stops
FRAMES, MOST_FRAMES = 4, 64  # that are rendered: at first, and at most


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
    on_axis = camera_irradiance(camera_model(_relative(scene), coarse=True), exposure)
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
        for seed in range(SEED + len(readings), SEED + max(2 * len(readings), FRAMES)):
            render = small.render.model_copy(update={"seed": seed})
            wavefront = Wavefront(session, plan, FilmLayout.of(small.film), render, scouts=False)
            rendering = render_plan(wavefront, spp=render.spp, seconds=None, has_lens=plan.camera.has_lens)
            readings = np.append(readings, reading_cd_m2(rendering.pixels, scene.exposure, small.film))
        reading, error = float(readings.mean()), float(readings.std(ddof=1)) / math.sqrt(len(readings))
        if error <= STAYS * reading or len(readings) >= MOST_FRAMES:
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
        (np.arange(PARTS * count) + 0.5) / (PARTS * count) * side for count, side in ((columns, width), (rows, height))
    )
    if exposure.metering == "average":
        return np.full((rows, columns), 1.0 / (rows * columns))
    spot = exposure.metering == "spot"
    at = exposure.spot_at if spot else (0.5, 0.5)
    radius = math.sqrt(SPOT_AREA * width * height / math.pi) if spot else min(width, height) / 4
    square = (x[None, :] - at[0] * width) ** 2 + (y[:, None] - at[1] * height) ** 2
    inside = (square <= max(radius**2, float(square.min()))).reshape(rows, PARTS, columns, PARTS).mean(axis=(1, 3))
    outside = 1.0 - inside
    share = _CENTRE_SHARE if outside.any() and not spot else 1.0
    return np.asarray(share * inside / inside.sum() + (1.0 - share) * outside / (outside.sum() or 1.0))


def _relative(scene: Scene, *, small: bool = False) -> Scene:
    """Return the scene whose film values are radiances, of the size to be metered or as it is."""
    update: dict[str, Any] = {"exposure": Exposure()}
    if small:
        columns, rows = scene.film.resolution
        factor = min(1.0, LONGEST_SIDE / max(columns, rows))
        down = max(round(rows * factor), 1)
        across = 2 * down if scene.camera.sees_all_around else max(round(columns * factor), 1)
        film = {"resolution": (across, down), "size_mm": tuple(side * 1e3 for side in scene.film.size_m())}
        kept = {name: getattr(scene.render, name) for name in ("max_depth", "roulette_depth", "sampler")}
        clamped = scene.render.clamp is not None and scene.render.caustics == "auto"
        kept["caustics"] = "off" if clamped else scene.render.caustics
        update["film"] = Film.model_validate(film | {"filter": FilmFilter()})
        update["render"] = RenderSettings(spp=max(SAMPLES // (across * down), 1), seed=SEED, **kept)
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
