"""The realistic camera: every ray is traced through every surface of a lens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import remember
from rptcam_cl.optics.irradiance import axial_irradiance, disk_irradiance, on_axis_irradiance
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import IDEAL, LensTransmission, axial_transmittance, is_tinted
from rptcam_cl.rendering.cameras.ideal import shaped, thick_lens_intrinsics, thick_lens_of
from rptcam_cl.rendering.cameras.lens_records import colour_error_px, disperses, usable_nm
from rptcam_cl.rendering.cameras.model import (
    CameraModel,
    CameraView,
    camera_record,
    entrance_pupil_view,
    lens_reach,
    traced_blur,
)
from rptcam_cl.rendering.cameras.pupil import PupilSampling, by_content, has_shape, on_disk, pupil_sampling
from rptcam_cl.rendering.cameras.ray_map import allowed_px, fitted_rays, traced_rays
from rptcam_cl.rendering.cameras.setting import (
    CameraMetadata,
    LensSetting,
    check_film,
    entrance_pupil,
    film_frame,
    half_film_mm,
    movements_metadata,
    place_film,
    place_fold,
)
from rptcam_cl.rendering.cameras.shared_pupil import Window, paraxial_irradiance, pupil_in_windows, shared_sampling
from rptcam_cl.scene.film import LensColour
from rptcam_cl.scene.scene import Scene

SHOWS_PX = 0.5  # colour error that a picture shows, of all but a tenth of the light [pixels]
SHOWS_TINT = 0.01  # share of the light by which colours differ that it shows
TINTS_NM = (450.0, 545.0, 610.0)  # about what blue, green and red see
AXIAL_SAMPLES = 9  # wavelengths at which the irradiance on the axis is found
LOSS_SAMPLES = 101  # and those at which losses are
REMEMBERED = 256  # numbers of lens states that are kept: irradiance, at some wavelengths, and errors


def realistic_model(
    scene: Scene,
    setting: LensSetting,
    windows: Sequence[Window] = (),
    *,
    lens_colour: LensColour = "off",
    coarse: bool = False,
) -> CameraModel:
    """Return the camera of a scene with its lens set in some other way than the scene says.

    Parameters
    ----------
    windows
        Parts of the film that will be rendered, where not the whole is: then only the pupils seen from there are found,
        in a tenth of the time, and `exposure: relative` goes by first-order optics.
    """
    camera = scene.camera.traced_camera
    assert camera is not None
    check_film(setting.lens, setting.film_distance_mm, scene)
    lens, film_distance_mm = shaped(scene, setting).lens, setting.film_distance_mm
    losses = setting.transmission
    dispersive, colour = _colour(scene, setting, lens_colour)
    low, high = usable_nm(lens, losses if dispersive else IDEAL)
    sampled_nm = (camera.wavelength_nm, low, high) if dispersive else (camera.wavelength_nm,)
    shares = camera.pupil == "shared" and not (windows or coarse)
    shared = shared_sampling(scene, setting, sampled_nm) if shares else None
    on_axis_of = _on_axis if shared is None else partial(_on_axis, soon=disk_irradiance)
    irradiance = paraxial_irradiance if windows else partial(_on_axis, soon=_axial) if coarse else on_axis_of
    clear, on_axis = _irradiance(lens, film_distance_mm, camera.wavelength_nm, losses, irradiance)
    balanced = (IDEAL, clear) if shows_losses(scene) else (losses, on_axis)
    pupil = shared or _pupil(scene, setting, lens, sampled_nm, windows, coarse)
    if camera.rays == "fitted":
        range_nm = (low, high) if dispersive else None
        through = fitted_rays(lens, setting, scene.film, range_nm, allowed_px(camera.accuracy))
    else:
        through = traced_rays(lens, setting, camera.precision, dispersive)
    record = _record(scene, setting, lens, pupil, len(through.surfaces))
    entrance = None if windows else entrance_pupil(scene, setting, drifts=not coarse)
    metadata: CameraMetadata = {
        "camera": "realistic",
        **through.metadata,
        **setting.metadata,
        "on_axis_irradiance": on_axis,
    }
    if losses:
        metadata["transmittance"] = on_axis / clear
    metadata = {**metadata, **pupil.metadata, **movements_metadata(camera), **colour}
    with suppress(InputError):  # where no thick lens stands for it
        thick = thick_lens_of(setting.lens, setting.film_distance_mm, camera.wavelength_nm)
        metadata["intrinsics"] = thick_lens_intrinsics(scene, thick, "traced lens")
    if entrance is not None:
        metadata["entrance_pupil"] = entrance.described()
    return CameraModel(
        through.kernel,
        record,
        facts=through.facts | pupil.facts | place_film(record, scene) | place_fold(record, lens),
        tables=np.concatenate([pupil.table, through.table]),
        surfaces=through.surfaces,
        stop=through.stop,
        has_lens=True,
        metadata=metadata,
        view=_view(scene, setting),
        on_axis_irradiance=on_axis,
        passed=on_axis / clear,
        axial_weight=on_axis,
        usable_nm=(low, high),
        reach=lens_reach(lens, film_distance_mm, camera.wavelength_nm, half_film_mm(scene)),
        axial_colour=_axial_colour(on_axis_of, lens, film_distance_mm, *balanced, (low, high)) if dispersive else None,
        setting=setting,
        pupil=None if coarse else entrance,
    )


def _irradiance(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: float,
    losses: LensTransmission,
    irradiance: Callable[..., float],
) -> tuple[float, float]:
    """Return the irradiance in the centre of the film under unit radiance, without losses in the lens and with them."""
    clear = irradiance(lens, film_distance_mm, wavelength_nm)
    on_axis = irradiance(lens, film_distance_mm, wavelength_nm, losses) if losses else clear
    if not on_axis > 0:
        raise InputError(
            f"camera.lens: {lens.name}: no ray from the centre of the film passes the lens"
            f" (film distance {film_distance_mm:g} mm)"
        )
    return clear, on_axis


def _pupil(
    scene: Scene,
    setting: LensSetting,
    lens: Lens,
    sampled_nm: tuple[float, ...],
    windows: Sequence[Window],
    coarse: bool,
) -> PupilSampling:
    """Return how rays aim at the pupil that all wavelengths see, from the whole film or from windows of it."""
    camera, half, film_distance_mm = scene.camera.traced_camera, half_film_mm(scene), setting.film_distance_mm
    assert camera is not None
    frame = film_frame(camera)
    if windows:
        return pupil_in_windows(lens, film_distance_mm, frame.bounds(half), camera.wavelength_nm, windows, frame)
    tier = "auto" if camera.pupil == "shared" else camera.pupil
    return pupil_sampling(lens, film_distance_mm, half, sampled_nm, tier, frame, coarse=coarse)


_axial = remember(most=REMEMBERED, by=by_content)(axial_irradiance)
_with_losses = remember(most=REMEMBERED, by=by_content)(on_axis_irradiance)
_without_losses = remember(most=REMEMBERED, by=by_content, disk=on_disk())(on_axis_irradiance)
_colour_error = remember(most=REMEMBERED, by=by_content)(colour_error_px)


def _on_axis(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: float,
    losses: LensTransmission = IDEAL,
    soon: Callable[[Lens, float, float], float | None] | None = None,
) -> float:
    """Return the irradiance on the axis; that of a round stop is remembered.

    Parameters
    ----------
    soon
        Gives it sooner where there are no losses, or None: `disk_irradiance` where nothing lies apart from the pupil,
        as the table shows that states share, and `_axial` for a glance, within 2e-5.
    """
    if soon and not losses and (irradiance := soon(lens, film_distance_mm, wavelength_nm)) is not None:
        return irradiance
    if has_shape(lens):
        return on_axis_irradiance(lens, film_distance_mm, wavelength_nm, losses)
    if losses:
        return _with_losses(lens, film_distance_mm, wavelength_nm, losses)
    return _without_losses(lens, film_distance_mm, wavelength_nm)


def _record(scene: Scene, setting: LensSetting, lens: Lens, pupil: PupilSampling, surfaces: int) -> NDArray[np.void]:
    half_width, half_height = half_film_mm(scene)
    record = camera_record(
        scene.camera, scene.film, "realistic",
        film_half_width=half_width, film_half_height=half_height,
        film_distance=setting.film_distance_mm, gain=setting.gain,
        metres_per_mm=1e-3, first_vertex_z=-lens.film_z(setting.film_distance_mm) * 1e-3,
        surfaces=surfaces, first_polynomial=len(pupil.table),
    )  # fmt: skip
    aim = record["own"]["realistic"]["pupil"][pupil.member]
    for name, value in pupil.parameters._asdict().items():
        aim[name] = value
    record["wavelength"] = setting.camera.wavelength_nm
    return record


def _colour(scene: Scene, setting: LensSetting, wanted: LensColour) -> tuple[bool, CameraMetadata]:
    """Return whether the lens refracts each wavelength separately, and what metadata say of that."""
    if wanted == "off" or not (disperses(setting.lens) or is_tinted(setting.lens, setting.transmission)):
        return False, {}
    error_px, sampling_px = _colour_error(
        setting.lens, setting.film_distance_mm, setting.focus_distance_mm, scene.film, setting.camera.wavelength_nm,
        film_frame(scene.camera), SHOWS_PX,
    )  # fmt: skip
    tint = lens_tint(scene, setting)
    shows = error_px > SHOWS_PX or tint > SHOWS_TINT
    metadata: CameraMetadata = {
        "lens_colour_px": round(error_px, 4),
        "lens_colour_sampling_px": round(sampling_px, 4),
    }
    if tint:
        metadata["lens_tint"] = round(tint, 4)
    return wanted == "on" or shows, metadata


def shows_losses(scene: Scene) -> bool:
    """Return whether the exposure shows what a lens takes from the light; the others make up for it."""
    return scene.exposure.mode in ("irradiance", "physical")


def lens_tint(scene: Scene, setting: LensSetting) -> float:
    """Return how much more of one colour than of another the lens takes, where a picture shows it."""
    low, high = usable_nm(setting.lens, setting.transmission)
    passed = axial_transmittance(setting.lens, np.clip(TINTS_NM, low, high), setting.transmission)
    return float(np.ptp(passed) / passed.max()) if shows_losses(scene) else 0.0


def _axial_colour(
    irradiance: Callable[..., float],
    lens: Lens,
    film_distance_mm: float,
    losses: LensTransmission,
    on_axis: float,
    range_nm: tuple[float, float],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return wavelengths and the irradiance of each on the axis, over that of the camera's wavelength.

    Losses vary faster with the wavelength than pupils do, but almost as they do on the axis itself.
    """
    few, wavelengths = np.linspace(*range_nm, AXIAL_SAMPLES), np.linspace(*range_nm, LOSS_SAMPLES)
    seen = np.array([irradiance(lens, film_distance_mm, nm, losses) for nm in few.tolist()]) / on_axis
    if not losses:
        return few, seen
    slow = np.interp(wavelengths, few, seen / axial_transmittance(lens, few, losses))
    return wavelengths, slow * axial_transmittance(lens, wavelengths, losses)


def _view(scene: Scene, setting: LensSetting) -> CameraView:
    """The view of a lens for layers; a stop that is not round counts as its circle."""
    lens, wavelength_nm = setting.lens, setting.camera.wavelength_nm
    size_mm = [side * 1e3 for side in scene.film.size_m()]
    columns, rows = scene.film.resolution
    return entrance_pupil_view(
        lens.first_order(wavelength_nm),
        -lens.film_z(setting.film_distance_mm) * 1e-3,
        lambda: traced_blur(
            lens,
            setting.film_distance_mm,
            setting.focus_distance_mm,
            half_film_mm(scene),
            (columns / size_mm[0], rows / size_mm[1]),
            wavelength_nm,
            film_frame(scene.camera),
        ),
    )
