"""What a hand on the picture does: moves of the camera by drags and keys, focus by clicks."""

from __future__ import annotations

import contextlib
import math
import pickle
from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session
from rptcam_cl.scene.base import near_name
from rptcam_cl.scene.camera import pose_matrix
from rptcam_cl.scene.lens_settings import METHODS
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.controller import autofocus
from rptcam_cl.studies.focus.drives import focus_drive
from rptcam_cl.studies.focus.probe import FocusReport, NoContrast

# Camera moves: what a drag or a key does to eye, target and up.

Vector = NDArray[np.float64]
ORBIT = math.pi  # radians that a drag across the whole picture turns the camera about its target
ROLL = math.radians(10)  # a step of roll
DOLLY = 0.05  # share of the distance in focus that a step towards it takes away
WALK = 0.02  # share of the distance in focus that a step is long
_WIDE = 1.0  # width at distance 1 where no field angle says: of cameras that see all around
_NEAREST_POLE = math.radians(1.0)  # between the view and up


@dataclass(frozen=True)
class Viewpoint:
    """Where a camera is and how it sees, in scene units.

    Attributes
    ----------
    eye, target, up : (3,) array
    distance : float
        From the eye to the plane in focus along the axis.
    field : float
        Width of that plane that the picture shows.
    aspect : float
        Height of the picture over its width.
    """

    eye: Vector
    target: Vector
    up: Vector
    distance: float
    field: float
    aspect: float

    def changes(self, before: Viewpoint) -> dict[str, list[float]]:
        """Return the keys of the scene that bring a camera here from where it was."""
        pairs = {
            "eye": (before.eye, self.eye), "target": (before.target, self.target), "up": (before.up, self.up),
        }  # fmt: skip
        return {f"camera.{name}": new.tolist() for name, (old, new) in pairs.items() if not np.array_equal(old, new)}


def viewpoint_of(scene: Scene) -> Viewpoint:
    """Return where the camera of a scene is when the shutter opens, which is in focus."""
    camera = scene.camera
    eye, target, up = camera.pose_at(scene.shutter.open_s)
    distance = distance_in_focus(scene)
    if distance is None or not math.isfinite(distance):
        distance = float(np.linalg.norm(target - eye))
    width, height = scene.film.size_m()
    return Viewpoint(eye, target, up, distance, field_at_one(scene) * distance, height / width)


def field_at_one(scene: Scene) -> float:
    """Return the width of what the picture shows at distance 1, first-order, of a scene in focus."""
    camera = scene.camera
    width, height = scene.film.size_m()
    if camera.field_of_view is not None:
        degrees, axis = camera.field_of_view
        across = 2 * math.tan(math.radians(degrees) / 2)
        sides = {"horizontal": width, "vertical": height, "diagonal": math.hypot(width, height)}
        return across * width / sides[axis]
    focal_length_mm = None if (lens := camera.lens_camera or camera.ideal_lens) is None else lens.focal_length_mm
    if focal_length_mm is None and camera.lens_camera is not None:
        focal_length_mm = scene.load_lens().first_order().focal_length_mm
    return _WIDE if focal_length_mm is None else width / abs(focal_length_mm * 1e-3)


def distance_in_focus(scene: Scene) -> float | None:
    """Return how far in front of the eye the plane in focus lies [scene units]; None where that is not known."""
    return scene.camera.distance_in_focus(scene.metres_per_unit)


def moved(stand: Viewpoint, kind: str, dx: float, dy: float, dz: float) -> Viewpoint:
    """Return where a camera is after a move; see docs/viewfinder.md for what dx, dy and dz are in each kind."""
    return _MOVES[kind](stand, dx, dy, dz)


def _axes(stand: Viewpoint) -> tuple[Vector, Vector, Vector]:
    """Return right, up and forward of the camera."""
    matrix = pose_matrix(np.array([stand.eye, stand.target, stand.up]))
    return matrix[:3, 0], matrix[:3, 1], -matrix[:3, 2]


def _turned(vector: Vector, axis: Vector, angle: float) -> Vector:
    """Return a vector turned about a unit axis (Rodrigues)."""
    sine, cosine = math.sin(angle), math.cos(angle)
    along = axis * float(axis @ vector)
    return np.asarray(cosine * vector + sine * np.cross(axis, vector) + (1 - cosine) * along)


def _turned_view(stand: Viewpoint, view: Vector, yaw: float, pitch: float) -> Vector:
    """Return a view turned about up by ``yaw`` and raised by ``pitch``, kept away from the poles."""
    upright = stand.up / np.linalg.norm(stand.up)
    level = math.asin(max(-1.0, min(1.0, float(view @ upright) / float(np.linalg.norm(view)))))
    limit = math.pi / 2 - _NEAREST_POLE
    if abs(level) < limit:
        pitch = max(-limit, min(limit, level + pitch)) - level
    elif pitch * level > 0:  # a camera that looks along up already comes back, and goes no further
        pitch = 0.0
    right = np.cross(view, upright)
    right /= np.linalg.norm(right)
    return _turned(_turned(view, right, pitch), upright, yaw)


def _orbit(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    view = _turned_view(stand, stand.target - stand.eye, -ORBIT * dx, -ORBIT * dy * stand.aspect)
    return replace(stand, eye=stand.target - view)


def _tilt(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    across = 2 * math.atan(0.5 * stand.field / stand.distance)
    view = _turned_view(stand, stand.target - stand.eye, across * dx, across * stand.aspect * dy)
    return replace(stand, target=stand.eye + view)


def _roll(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    _, up, forward = _axes(stand)
    return replace(stand, up=_turned(up, forward, ROLL * dx))


def _shifted(stand: Viewpoint, step: Vector) -> Viewpoint:
    return replace(stand, eye=stand.eye + step, target=stand.target + step)


def _pan(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    right, up, _ = _axes(stand)
    return _shifted(stand, stand.field * (-dx * right + dy * stand.aspect * up))


def _walk(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    right, _, forward = _axes(stand)
    upright = stand.up / np.linalg.norm(stand.up)
    return _shifted(stand, WALK * stand.distance * (dx * right + dy * forward + dz * upright))


def _dolly(stand: Viewpoint, dx: float, dy: float, dz: float) -> Viewpoint:
    _, _, forward = _axes(stand)
    reach = stand.distance * (1 - (1 - DOLLY) ** dy)
    eye = stand.eye + reach * forward
    left = float((stand.target - eye) @ forward)
    # the target stays where it is, unless the camera would pass it
    target = stand.target if left > 1e-3 * stand.distance else stand.target + reach * forward
    return replace(stand, eye=eye, target=target)


_MOVES = {"orbit": _orbit, "tilt": _tilt, "roll": _roll, "pan": _pan, "walk": _walk, "dolly": _dolly}


# Focus at a click, and autofocus by zones: what `rptcam focus` finds, as changes of the scene and a curve to draw.

MOST_ZONES = 64


def describe_focus(found: FocusReport) -> dict[str, Any]:
    """Describe a focus as plain values for a page; the curve has its probes in the order in which they were made."""
    return {
        "distance_m": _plain(found.focus_distance_m),
        "film_distance_mm": found.film_distance_mm,
        "method": found.method,
        "confidence": found.confidence,
        "failure": found.failure,
        "warnings": found.warnings,
        "zone": list(astuple(found.zone)),
        "zones": [list(astuple(zone)) for zone in found.zones],
        "samples": found.samples,
        "seconds": found.seconds,
        "curve": [
            {
                "position": probe.film_distance_mm,
                "score": _plain(probe.value),
                "error": _plain(probe.error),
                "quantity": probe.quantity,
            }
            for probe in found.probes
        ],
    }


def _plain(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def focus_order(device: str, scene: Scene, method: str | None, place: dict[str, Any]) -> bytes:
    """Pickle a search for `CompileServer.compile`: another process makes it first, so that this one has its kernels.

    Parameters
    ----------
    device
        Its id.
    place
        ``point`` or ``zones``, as `autofocus` takes them.
    """
    return pickle.dumps((_search_for_kernels, (device, scene, method, place)))


def _search_for_kernels(device: str, scene: Scene, method: str | None, place: dict[str, Any]) -> None:
    """Search; what is found does not count."""
    with contextlib.suppress(InputError):
        autofocus(scene, method, device=device, **place)


def focus_at(
    scene: Scene,
    device: Session,
    x: float,
    y: float,
    method: str | None = None,
    on_probe: Callable[[Any], Any] | None = None,
    on_state: Callable[[float], Any] | None = None,
) -> FocusReport:
    """Find the focus on a point of the picture, the answer of ``rptcam focus SCENE --point x,y``.

    Where nothing there tells focus from blur, it is by the distance of what is there, and says so.

    Parameters
    ----------
    scene
        As requested: its exposure does not matter.
    x, y
        In fractions of the picture from its left and top.
    method
        In place of the scene's, or of contrast; its answer stands.
    on_probe, on_state
        Called with every probe, and with every state that the focus is taken to be in by now.

    Raises
    ------
    NoContrast, OutOfReach
        Nothing is there; it is nearer than the camera can focus, or farther.
    InputError
        The camera has no focus, or an argument is wrong.
    """
    search = partial(autofocus, scene, point=(x, y), device=device, on_probe=on_probe, on_state=on_state)
    if method is not None:
        return search(_method(method))
    try:
        found = search(None)
        if found.failure is None:
            return found
        fault = found.failure
    except NoContrast as problem:
        fault = str(problem)
    by_distance = search("depth")
    return replace(by_distance, remarks=(*by_distance.remarks, f"by distance alone, as by contrast {fault}"))


def focus_zones(
    scene: Scene,
    device: Session,
    method: str | None = None,
    zones: Sequence[Sequence[float]] | None = None,
    on_probe: Callable[[Any], Any] | None = None,
    on_state: Callable[[float], Any] | None = None,
) -> FocusReport:
    """Find the focus in zones, or in those of the scene; errors as of `focus_at`.

    Parameters
    ----------
    zones
        Rectangles [x0, x1, y0, y1] in fractions of the picture from its left and top.
    """
    check_search(method, zones)
    places = None if zones is None else [tuple(zone) for zone in zones]
    return autofocus(scene, _method(method), zones=places, device=device, on_probe=on_probe, on_state=on_state)


def check_search(method: str | None, zones: Sequence[Sequence[float]] | None) -> None:
    """Raise `InputError` for a method that there is not, or too many zones."""
    _method(method)
    if zones is not None and len(zones) > MOST_ZONES:
        raise InputError(f"zones: too many (got {len(zones)}; allowed: up to {MOST_ZONES})")


def _method(name: str | None) -> str | None:
    if name is not None and name not in METHODS:
        raise InputError(
            f"method: is none{near_name(str(name), METHODS)} (got {name!r}; allowed: {', '.join(METHODS)})"
        )
    return name


def focus_changes(scene: Scene, report: FocusReport) -> dict[str, Any]:
    """Return the key paths of the scene, with their values, that set the state which was found."""
    return state_changes(scene, report.state)


def state_changes(scene: Scene, state: float) -> dict[str, Any]:
    """Return the key paths of the scene, with their values, that set a focus state."""
    keys = focus_drive(scene).camera_keys(state)
    return {f"camera.{name}": value for name, value in keys.items() if value is not None}
