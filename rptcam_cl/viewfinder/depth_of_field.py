"""Depth of field, hyperfocal distance, breathing and the engraved focus scale, by first-order optics.

Seen from the entrance pupil of diameter D, a point at the distance u' blurs a plane in focus at u to D |u - u'| / u',
which the film shows P / u times as large, P being how far the image moves per unit of the tangent. A blur of c counts
as sharp, so that the field reaches from u D P / (D P + c u) to u D P / (D P - c u). Nothing is assumed of the lens but
that it has pupils: their magnification and a moving group count.
"""

from __future__ import annotations

import math
from typing import Any

from rptcam_cl.cameras import camera_model, lens_setting, thick_lens_of
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing import circle_of_confusion, focus_drive
from rptcam_cl.scene import Focus, LensCamera, Scene, ThinLensCamera, at_opening, change_scene
from rptcam_cl.viewfinder.remembered import by_optics

INFINITY_M = 1e6  # what the focus dial calls infinity
MARKS_M = (0.1, 0.12, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0)
DEPTH_STOPS = (2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0)  # engraved about the focus mark
FEWEST, MOST = 3, 12  # marks of a focus scale


@dataclass(frozen=True)
class Perspective:
    """The pupil and the image of a focused lens, to first order [mm].

    Attributes
    ----------
    focus_mm : float
        Plane in focus to the point that distances are counted from: the film of a real lens, the thin lens itself.
    pupil_mm : float
        Entrance pupil ahead of that point.
    diameter_mm : float
        Of the entrance pupil.
    per_tangent_mm : float
        How far the image moves on the film per unit of the tangent from the entrance pupil.
    focal_length_mm : float
    """

    focus_mm: float
    pupil_mm: float
    diameter_mm: float
    per_tangent_mm: float
    focal_length_mm: float

    def field(self, circle_mm: float, opening: float = 1.0) -> tuple[float, float]:
        """Return the near and the far end of what is sharp [mm], the latter perhaps infinite.

        Parameters
        ----------
        circle_mm
            Largest blur on the film that counts as sharp.
        opening
            Share of the pupil's diameter.
        """
        u, reach = self.focus_mm - self.pupil_mm, opening * self.diameter_mm * self.per_tangent_mm
        near = u * reach / (reach + circle_mm * u)
        far = u * reach / (reach - circle_mm * u) if reach > circle_mm * u else math.inf
        return near + self.pupil_mm, far + self.pupil_mm


@by_optics
def perspective(scene: Scene) -> Perspective | None:
    """Return the first-order picture of a scene's camera; None where no plane is in focus or there is no focus.

    Parameters
    ----------
    scene
        In focus.
    """
    camera = at_opening(scene).camera
    if isinstance(camera, ThinLensCamera):
        found = camera_model(scene).metadata
        diameter = found["focal_length_mm"] / found["f_number"]
        focal = found["focal_length_mm"]
        image = 1 / (1 / focal - 1 / (camera.plane_m * 1e3))
        return Perspective(camera.plane_m * 1e3, 0.0, diameter, image, focal) if diameter else None
    if not isinstance(camera, LensCamera):
        return None
    setting = lens_setting(scene)
    first = setting.lens.first_order(camera.wavelength_nm)
    try:
        thick = thick_lens_of(setting.lens, setting.film_distance_mm, camera.wavelength_nm)
    except InputError:  # no cardinal points: nothing to say to first order
        return None
    pupil = first.entrance_pupil
    if setting.focus_distance_mm is None or not math.isfinite(pupil.distance_mm):
        return None
    ahead = setting.lens.film_z(setting.film_distance_mm) - pupil.distance_mm
    if not setting.focus_distance_mm > ahead:
        return None
    return Perspective(
        setting.focus_distance_mm, ahead, pupil.diameter_mm, 1 / abs(thick.slope[0]), first.focal_length_mm
    )


@dataclass(frozen=True)
class DepthOfField:
    """What is sharp.

    Attributes
    ----------
    distance_m, near_m : float
        Plane in focus and the near end, from the film (thin lens: from the lens); infinite focus counts as 1000 km.
    far_m, hyperfocal_m : float or None
        The far end, None at infinity; the nearest focus for which it is infinite.
    circle_mm : float
        Blur that counts as sharp: the film's diagonal / 1500, as on depth-of-field scales.
    magnification : float
        Image over object size in the plane in focus.
    breathing : float or None
        By how much the image of a field is larger than with the focus at infinity, as a share.
    """

    distance_m: float
    near_m: float
    far_m: float | None
    hyperfocal_m: float
    circle_mm: float
    magnification: float
    breathing: float | None


def depth_of_field(scene: Scene) -> DepthOfField | None:
    """Return what a scene's camera shows sharply; None where it has no focus.

    Parameters
    ----------
    scene
        In focus.
    """
    here = perspective(scene)
    if here is None:
        return None
    circle = circle_of_confusion(scene)
    near, far = here.field(circle)
    distant = at_infinity(scene)
    horizon = distant or here
    hyperfocal = horizon.diameter_mm * horizon.per_tangent_mm / circle + horizon.pupil_mm
    return DepthOfField(
        distance_m=here.focus_mm * 1e-3,
        near_m=near * 1e-3,
        far_m=far * 1e-3 if math.isfinite(far) else None,
        hyperfocal_m=hyperfocal * 1e-3,
        circle_mm=circle,
        magnification=here.per_tangent_mm / (here.focus_mm - here.pupil_mm),
        breathing=None if distant is None else here.per_tangent_mm / distant.per_tangent_mm - 1.0,
    )


def at_infinity(scene: Scene) -> Perspective | None:
    """Return the first-order picture with the focus at infinity; None where the lens does not go there."""
    try:
        return perspective(change_scene(scene, camera=focus_keys(scene, INFINITY_M)))
    except InputError:
        return None


def focus_keys(scene: Scene, distance_m: float) -> dict[str, Any]:
    """Return the keys of a scene's camera that focus it at a distance, for `change_scene`."""
    camera = scene.camera
    if isinstance(camera, ThinLensCamera):
        return {"focus_distance_m": distance_m, "focus": None}
    assert isinstance(camera, LensCamera)
    focus = camera.focus
    kept = {} if focus.method == "thick" else {"method": focus.method, "field": focus.field}
    return {"focus": {"distance_m": distance_m} | {key: value for key, value in kept.items() if value is not None}}


def nearest_focus_m(scene: Scene) -> float | None:
    """Return the shortest focus distance that the camera reaches [m]; None where it has no focus.

    A lens that moves as a whole reaches natural size.
    """
    camera = scene.camera
    if not isinstance(camera, (LensCamera, ThinLensCamera)):
        return None
    update: dict[str, Any] = {"focus_distance_m": INFINITY_M, "focus": None}
    if isinstance(camera, LensCamera):  # wherever it stands, which may be beyond the reach, and however wide it is open
        update = {"focus": Focus(distance_m=INFINITY_M), "f_number": None, "stop_diameter_mm": None}
    return _nearest(scene.model_copy(update={"camera": camera.model_copy(update=update)}))


@by_optics
def _nearest(scene: Scene) -> float | None:
    try:
        drive = focus_drive(scene)
        near = max(drive.limits, key=lambda state: drive.nearer * drive.coordinate(state))
        return drive.first_order_distance(near)
    except InputError:
        return None


def focus_scale(scene: Scene) -> dict[str, Any] | None:
    """Return the engraving of the focus ring: marks, the depth of field at full stops, and where the focus stands.

    Positions go from 0 at the nearest focus to 1 at infinity, evenly in 1 / distance, as a lens moves. None where there
    is no focus.
    """
    here, nearest = perspective(scene), nearest_focus_m(scene)
    if here is None or nearest is None:
        return None
    circle = circle_of_confusion(scene)

    def position(metres: float | None) -> float:
        return 1.0 if metres is None or math.isinf(metres) else min(max(1.0 - nearest / metres, 0.0), 1.0)

    marks = [metres for metres in MARKS_M if metres > nearest * 1.02]
    marks = marks[:: max(1, math.ceil(len(marks) / MOST))] if len(marks) > FEWEST else marks
    depth = []
    f_number = here.focal_length_mm / here.diameter_mm
    for stop in DEPTH_STOPS:
        near, far = (end * 1e-3 for end in here.field(circle, f_number / stop))
        depth.append({"f_number": stop, "near": position(near), "far": position(far)})
    near, far = (end * 1e-3 for end in here.field(circle))
    return {
        "near_m": near,
        "far_m": far if math.isfinite(far) else None,
        "position": position(here.focus_mm * 1e-3),
        "marks": [
            {"m": nearest, "text": f"{nearest:.2g}", "position": 0.0},
            *({"m": metres, "text": f"{metres:g}", "position": position(metres)} for metres in marks),
            {"m": INFINITY_M, "text": "∞", "position": 1.0},
        ],
        "depth": depth,
    }
