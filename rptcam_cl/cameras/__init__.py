"""Camera models, one module each: a camera of the scene becomes a record, tables and the kernel that reads them."""

from __future__ import annotations

from collections.abc import Callable

from rptcam_cl.cameras import environment, pinhole, realistic, thick_lens, thin_lens
from rptcam_cl.cameras.exposure import exposed
from rptcam_cl.cameras.geometry import camera_geometry
from rptcam_cl.cameras.model import CameraModel
from rptcam_cl.scene.camera import RealisticCamera
from rptcam_cl.scene.opening import at_opening
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.spectrum_mode import LensColour

_MODELS: dict[str, Callable[[Scene], CameraModel]] = {
    "pinhole": pinhole.build,
    "environment": environment.build,
    "thin_lens": thin_lens.build,
    "thick_lens": thick_lens.build,
}


def camera_model(scene: Scene, lens_colour: LensColour = "off") -> CameraModel:
    """Return what the camera of a scene needs on the device, where it is when the shutter opens.

    Parameters
    ----------
    lens_colour
        Whether the lens bends each wavelength by itself: only where a picture of this size shows it with ``auto``.
    """
    scene = at_opening(scene)
    if isinstance(scene.camera, RealisticCamera):
        return exposed(realistic.build(scene, lens_colour), scene)
    return exposed(_MODELS[scene.camera.kind](scene), scene)


__all__ = ["CameraModel", "camera_geometry", "camera_model"]
