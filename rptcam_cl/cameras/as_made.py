"""The lens of a camera as it really is: the copy of its design that its scene names, at its temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Heat, Lens
from rptcam_cl.scene import LensCamera, Scene

if TYPE_CHECKING:
    from rptcam_cl.tolerances import ChosenCopy


@dataclass(frozen=True)
class RealState:
    """How the lens of a camera differs from its design.

    A camera is focused by the scale of its design: the film is where the design would be sharp, moved by what was
    adjusted when the copy was made, and then by the barrel, which grows with heat.

    Attributes
    ----------
    copy : ChosenCopy or None
    heat : Heat or None
    """

    copy: ChosenCopy | None = None
    heat: Heat | None = None

    def lens(self, state: Lens) -> Lens:
        """Return what a state of the design really is."""
        made = state if self.copy is None else self.copy.lens(state)
        return made if self.heat is None else self.heat.lens(made)

    def film(self, film_distance_mm: float) -> float:
        """Return where the film really stands, behind the last vertex, that the design has at a distance [mm]."""
        cold = film_distance_mm if self.copy is None else film_distance_mm + self.copy.shift_mm
        return cold if self.heat is None else self.heat.film(cold)

    @property
    def metadata(self) -> dict[str, Any]:
        """What the picture's metadata should say; nothing of a design."""
        said: dict[str, Any] = {}
        if self.copy is not None:
            copy = self.copy
            merit = {"spot_um": copy.spot_um, "mtf": copy.mtf, "refocus_mm": copy.shift_mm}
            said["as_built"] = {"percentile": copy.percent, "copy": copy.number, **merit}
        if self.heat is not None:
            said["temperature_c"], said["pressure_hpa"] = self.heat.celsius, self.heat.pressure_hpa
        return said


DESIGN = RealState()


def real_state(scene: Scene) -> RealState:
    """Return how the lens of a scene's camera differs from its design.

    Raises
    ------
    InputError
        When the tolerances are wrong or do not suit the lens, or nothing says how one of its glasses takes heat.
    """
    camera = scene.camera
    assert isinstance(camera, LensCamera)
    heat = camera.heat
    if heat is not None:
        try:
            heat.lens(scene.load_lens())
        except InputError as problem:
            raise InputError(f"camera.lens.temperature_c: {problem}") from None
    if camera.as_built is None:
        return DESIGN if heat is None else RealState(heat=heat)
    from rptcam_cl.tolerances import chosen_copy, specification

    source = scene.tolerances_source()
    assert source is not None
    try:
        return RealState(chosen_copy(scene.load_lens(), specification(source), camera.as_built.percent), heat)
    except InputError as problem:
        place = "camera.lens.as_built: " if isinstance(source, str) else ""
        raise InputError(f"{place}{problem}") from None
