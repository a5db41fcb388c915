"""A way of light between the surfaces of a lens as device records, in the order in which light meets them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.aperture import stop_shape
from rptcam_cl.cameras.dispersion import disperses
from rptcam_cl.cameras.records import lens_records
from rptcam_cl.cameras.setting import LensSetting, lens_setting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens, LensTransmission, is_tinted, steps
from rptcam_cl.scene import RealisticCamera, Scene, at_opening

FACTS = {"LENS_MIRROR": 1, "LENS_POLARISED": 1, "LENS_DISPERSION": 0}


def ghost_setting(scene: Scene) -> LensSetting:
    """Return the lens of a scene's camera with its stop in shape, whose surfaces reflect.

    Raises
    ------
    InputError
        When the camera has no surfaces, or they are ideal and reflect nothing.
    """
    scene = at_opening(scene)
    camera = scene.camera
    if not isinstance(camera, RealisticCamera):
        raise InputError("camera.ghosts: the camera has no surfaces that reflect (allowed: off, or kind realistic)")
    if not camera.transmission.fresnel:
        raise InputError(
            "camera.ghosts: ideal surfaces reflect nothing (allowed: off, or a camera.transmission such as bare,"
            " coated or {coating: mgf2})"
        )
    setting, shape = lens_setting(scene), stop_shape(scene, camera.aperture)
    return setting if shape is None else replace(setting, lens=setting.lens.with_stop_shape(shape))


def ghosts_have_colours(setting: LensSetting) -> bool:
    """Return whether surfaces reflect or bend one colour otherwise than another."""
    return disperses(setting.lens) or is_tinted(setting.lens, setting.transmission)


@dataclass(frozen=True)
class WayRecords:
    """The records of a lens for one wavelength, from which those of any way are picked."""

    lens: Lens
    onward: NDArray[np.void]
    back: NDArray[np.void]
    stop: NDArray[np.floating]
    facts: dict[str, int]

    @staticmethod
    def of(lens: Lens, wavelength_nm: float, transmission: LensTransmission) -> WayRecords:
        """Return the records of a lens at a wavelength [nm]."""
        onward = lens_records(lens, wavelength_nm, "scene", 0.0, transmission=transmission)
        back = lens_records(lens, wavelength_nm, "film", 0.0, transmission=transmission)
        facts = {name: max(value, back.facts[name]) for name, value in onward.facts.items()}
        return WayRecords(lens, onward.surfaces, back.surfaces[::-1], onward.stop, facts | FACTS)

    def way(self, turns: tuple[int, ...]) -> NDArray[np.void]:
        """Return the records that light meets, reflected at the surfaces of `turns` in order."""
        way = list(steps(turns, len(self.lens.surfaces)))
        met, forward = np.array([step.surface for step in way]), np.array([step.forward for step in way])
        records = np.concatenate([self.onward, self.back])[np.where(forward, met, met + len(self.onward))]
        vertices, senses = np.array(self.lens.vertices), np.array(self.lens.senses)
        records["gap"] = np.where(forward, senses[met], -senses[met + 1]) * np.diff(
            vertices[met], prepend=vertices[met[0]]
        )
        records["refracts"][[step.reflects for step in way]] = -1.0
        return records
