"""Many pictures one after the other: what they share stays on the device."""

from __future__ import annotations

from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.api.stages import prepare, report, run
from rptcam_cl.api.wavefronts import Kept
from rptcam_cl.device import Session
from rptcam_cl.imaging import Image
from rptcam_cl.plan import Plan
from rptcam_cl.scene import Scene


class SeriesRenderer:
    """Renders scenes on one device, each as `render` does.

    Parameters
    ----------
    device
        The device.

    Attributes
    ----------
    plan : Plan or None
        That of the last picture.
    """

    def __init__(self, device: Session) -> None:
        self.device = device
        self.plan: Plan | None = None
        self._settings, self._kept = RenderSettings(device=device), Kept(device)

    def render(self, scene: Scene) -> Image:
        """Return the picture that the camera of a scene takes."""
        prepared = prepare(scene, self._settings, self._kept)
        self.plan = prepared.plan
        return report(prepared, run(prepared))
