"""What polynomials in place of a lens err by, as the camera finds it when it fits them."""

from __future__ import annotations

from rptcam_cl.cameras.dispersion import disperses, usable_nm
from rptcam_cl.cameras.lens_rays import allowed_px, fitted_map
from rptcam_cl.cameras.lens_setting import lens_setting
from rptcam_cl.cameras.ray_map import RayMap
from rptcam_cl.scene import Scene
from rptcam_cl.scene.camera import RealisticCamera


def fitted_to(scene: Scene, *, colours: bool) -> RayMap:
    """Return the polynomials of the lens of a scene.

    Parameters
    ----------
    colours
        Whether the lens bends each wavelength by itself.

    Raises
    ------
    InputError
        When there are none that are good enough.
    """
    camera, setting = scene.camera, lens_setting(scene)
    assert isinstance(camera, RealisticCamera)
    range_nm = usable_nm(setting.lens) if colours and disperses(setting.lens) else None
    return fitted_map(setting.lens, setting, scene.film, range_nm, allowed_px(camera))
