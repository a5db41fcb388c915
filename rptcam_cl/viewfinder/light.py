"""The light at the film: what a lens brings of a scene's radiance, and what of that becomes a film value.

The exposure model is that of `cameras`: a film value is radiance times the irradiance of the film's centre per
radiance, times what time and ISO make of it (ISO 12232), times compensation and filter.
"""

from __future__ import annotations

from rptcam_cl.cameras import camera_model, lens_setting, on_axis_irradiance, stop_shape, values_per_irradiance
from rptcam_cl.optics import on_axis_irradiance as lens_irradiance
from rptcam_cl.scene import Exposure, RealisticCamera, Scene
from rptcam_cl.viewfinder.remembered import by_optics


@by_optics
def irradiance_per_radiance(scene: Scene) -> float | None:
    """Return the irradiance of the film's centre for radiance 1 everywhere; None where there is no film to speak of.

    Parameters
    ----------
    scene
        In focus.
    """
    camera = scene.camera
    if not isinstance(camera, RealisticCamera):
        plain = scene.model_copy(update={"exposure": Exposure()})
        return on_axis_irradiance(camera_model(plain), scene.exposure)
    setting, shape = lens_setting(scene), stop_shape(scene, camera.aperture)
    lens = setting.lens if shape is None else setting.lens.with_stop_shape(shape)
    return float(lens_irradiance(lens, setting.film_distance_mm, camera.wavelength_nm, setting.transmission))


def value_per_radiance(resolved: Scene) -> float:
    """Return the film's value for radiance 1 [W/(m² sr)] in the middle of the picture.

    Parameters
    ----------
    resolved
        With its exposure resolved.
    """
    exposure = resolved.exposure
    if exposure.mode not in ("irradiance", "physical"):
        return exposure.factor
    light = irradiance_per_radiance(resolved)
    assert light is not None, "a scene with such an exposure has a film"
    scale = values_per_irradiance(resolved.shutter.time_s, exposure.iso) if exposure.mode == "physical" else 1.0
    return light * scale * exposure.factor
