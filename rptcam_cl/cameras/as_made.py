"""The lens of a camera as it really is: the copy of its design that its scene names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens
from rptcam_cl.scene import LensCamera, Scene

if TYPE_CHECKING:
    from rptcam_cl.tolerances import ChosenCopy


@dataclass(frozen=True)
class RealState:
    """How the lens of a camera differs from its design.

    A camera is focused by the scale of its design: the film is where the design would be sharp, moved by what was
    adjusted when the copy was made.

    Attributes
    ----------
    copy : ChosenCopy or None
    """

    copy: ChosenCopy | None = None

    def __bool__(self) -> bool:
        return self.copy is not None

    def lens(self, state: Lens) -> Lens:
        """Return what a state of the design really is."""
        return state if self.copy is None else self.copy.lens(state)

    def film(self, film_distance_mm: float) -> float:
        """Return where the film really stands, behind the last vertex, that the design has at a distance [mm]."""
        return film_distance_mm if self.copy is None else film_distance_mm + self.copy.shift_mm

    @property
    def metadata(self) -> dict[str, Any]:
        """What the picture's metadata should say; nothing of a design."""
        if self.copy is None:
            return {}
        copy = self.copy
        merit = {"spot_um": copy.spot_um, "mtf": copy.mtf, "refocus_mm": copy.shift_mm}
        return {"as_built": {"percentile": copy.percent, "copy": copy.number, **merit}}


DESIGN = RealState()


def real_state(scene: Scene) -> RealState:
    """Return how the lens of a scene's camera differs from its design.

    Raises
    ------
    InputError
        When the tolerances are wrong or do not suit the lens.
    """
    camera = scene.camera
    assert isinstance(camera, LensCamera)
    if camera.as_built is None:
        return DESIGN
    from rptcam_cl.tolerances import chosen_copy, specification

    source = scene.tolerances_source()
    assert source is not None
    try:
        return RealState(chosen_copy(scene.load_lens(), specification(source), camera.as_built.percent))
    except InputError as problem:
        place = "camera.lens.as_built: " if isinstance(source, str) else ""
        raise InputError(f"{place}{problem}") from None
