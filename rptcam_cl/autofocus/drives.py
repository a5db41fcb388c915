"""Which drive a scene's camera has."""

from __future__ import annotations

from rptcam_cl.autofocus.drive import Drive
from rptcam_cl.autofocus.group_drive import GroupDrive
from rptcam_cl.autofocus.lens_drive import WholeLens
from rptcam_cl.autofocus.thin_drive import ThinDrive
from rptcam_cl.cameras.lens_setting import lens_to_focus
from rptcam_cl.errors import InputError
from rptcam_cl.scene import LensCamera, ThinLensCamera
from rptcam_cl.scene.scene import Scene


def focus_drive(scene: Scene) -> Drive:
    """Return what moves when the camera of a scene focuses.

    Raises
    ------
    InputError
        For a camera that has no focus.
    """
    if isinstance(scene.camera, ThinLensCamera):
        return ThinDrive(scene)
    if isinstance(scene.camera, LensCamera):
        lens = lens_to_focus(scene, scene.camera)
        return WholeLens(scene, lens) if lens.focusing is None else GroupDrive(scene, lens)
    raise InputError(
        f"camera.kind: {scene.camera.kind}: everything it sees is sharp, so there is no focus to find"
        " (allowed: thin_lens, thick_lens, realistic)"
    )
