"""Whether a driver renders right pictures: one small known scene, rendered the way that a picture will be.

A compiler may make garbage of a kernel that it builds and runs without an error: PoCL 7.1 did so of rays that go
through a lens side by side. So the first picture on a driver waits until it has rendered a scene whose film is known: a
lens in front of a mesh that a lamp lights, and of a lamp. Where the usual way is wrong, others are tried. What passes
is kept for this driver, device and version, and costs the next run nothing. Of quick programs, which the compiler takes
otherwise, there is a trial of their own.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.kept import keep_bytes, kept_bytes, name_of
from rptcam_cl.device import Session, driver_name, refuse
from rptcam_cl.plan import make_plan
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.passes import PACKETS
from rptcam_cl.scene import load_scene

SCALE = 256
SAMPLES = 2 * PACKETS  # two steps of a work item that keeps rays
# The left half shows the mesh, the upper right the lamp, the lower right nothing.
SCENE: dict[str, Any] = {
    "film": {"resolution": [16, 16]},
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 0.5}, "eye": [0, 0, 0],
        "target": [0, 0, -1], "up": [0, 1, 0],
    },
    "render": {"spp": SAMPLES, "max_depth": 3, "roulette_depth": 8},
    "objects": [
        {
            "shape": "mesh", "vertices": [[-2, -2, -2], [0, -2, -2], [0, 2, -2], [-2, 2, -2]],
            "faces": [[0, 1, 2], [0, 2, 3]], "material": {"kind": "matte", "reflectance": 0.5},
        },
        {
            "shape": "rectangle", "corner": [0.05, 0.05, -2], "edge_u": [2, 0, 0], "edge_v": [0, 2, 0],
            "material": {"kind": "emissive", "radiance": 1},
        },
    ],
    "lights": [{"kind": "point", "position": [-0.3, 0, -1], "intensity": 3}],
}  # fmt: skip
KNOWN = bytes.fromhex(
    "0d11161a1a211b152f6c69624a4b372e0f181f1c26222a2b3c747f656a5a4136191b242831353731309d81877a6958421f1f333b3c374639519ba69f8e7a6658"
    "252e3a444b51524f40c9b8a79d897361282a393e56595d5c47dacdbc91977e6826363a535b6456334fe9dacbb498855f283248465e685b492158374d2e4b3120"
    "30334859626a714a00000000000000002d3944535f63684700000000000000002a35373e52595f4e00000000000000001c2f39443c4c52360d00000000000000"
    "1d292f363f4245450b000000000000001822242c29353931080000000000000013191b2426272b2406000000000000000a10121b1c1a20150000000000000000"
)  # the film, row by row: SCALE times the radiance
PASSED = 1971  # of 2048 rays, through the lens
CLOSE = 2  # by which rounding may change a pixel, in the same unit
ELSEWHERE = 0.03  # share of pixels that paths rounding sends elsewhere may change

_passed: dict[tuple[Any, ...], Way] = {}
_trying = threading.Lock()


@dataclass(frozen=True)
class Way:
    """How a device renders: "stream" or "passes", and packets of rays that go through a lens together."""

    organisation: str
    packets: int

    def __str__(self) -> str:
        together = "" if self.packets == 1 else f" with {self.packets} packets of rays together"
        return f"{self.organisation}{together}"


def way_of(session: Session, organisation: str, wavefront: Callable[..., Any]) -> Way:
    """Return the way in which a device renders right pictures: the usual one, else one that goes round its fault.

    Parameters
    ----------
    organisation
        The usual one.
    wavefront
        `rptcam_cl.rendering.tracer.Wavefront`.

    Raises
    ------
    DeviceError
        When the device renders wrong pictures in every way.
    """
    many = (Way(organisation, PACKETS),) if session.lanes > 1 else ()
    ways = tuple(dict.fromkeys((*many, Way(organisation, 1), Way("passes", 1))))
    facts = session.lanes, session.is_quick, ways
    with _trying:
        key = session.info.id, *facts
        if key not in _passed:
            _passed[key] = _kept_or_found(session, ways, name_of(driver_name(session.info.handle), facts), wavefront)
        return _passed[key]


def _kept_or_found(session: Session, ways: tuple[Way, ...], name: str, wavefront: Callable[..., Any]) -> Way:
    kept = kept_bytes("devices", name)
    if kept is not None and kept.isdigit() and int(kept) < len(ways):
        found = int(kept)
    else:
        found = _found(session, ways, wavefront)
        keep_bytes("devices", name, b"%d" % found)
    if found > 0:
        device = f"device {session.info.id} {session.info.name}"
        warnings.warn(
            f"{device}: its driver renders wrong pictures as {ways[0]}, so it renders as {ways[found]}, slower",
            stacklevel=1,
        )
    return ways[found]


def _found(session: Session, ways: tuple[Way, ...], wavefront: Callable[..., Any]) -> int:
    """Return the place of the first way that passes."""
    faults = []
    for place, way in enumerate(ways):
        fault = fault_of(session, way, wavefront)
        if fault is None:
            return place
        faults.append(f"as {way}, {fault}")
    raise DeviceError(refuse(session.info, f"its driver renders wrong pictures: {'; '.join(faults)}"))


def fault_of(session: Session, way: Way, wavefront: Callable[..., Any]) -> str | None:
    """Return what of the known picture is wrong as a device renders it in a way; None where it is right."""
    scene = load_scene(SCENE)
    made = wavefront(
        session.alone(), make_plan(scene), FilmLayout.of(scene.film), scene.render, organisation=way.organisation,
        packets=way.packets, scouts=False,
    )  # fmt: skip
    for wave in made.waves(0, SAMPLES):
        made.enqueue(*wave)
    made.finish()
    film = made.picture(SAMPLES).astype(np.float64).mean(axis=2).ravel()
    known = np.frombuffer(KNOWN, np.uint8) / SCALE
    wrong = int((~(np.abs(film - known) <= CLOSE / SCALE)).sum())
    if wrong > ELSEWHERE * known.size:
        return f"{wrong} of {known.size} pixels (mean {film.mean():.3g} for {known.mean():.3g})"
    passed = made.outcomes()["passed"]
    return None if abs(passed - PASSED) <= ELSEWHERE * PASSED else f"{passed} rays through the lens for {PASSED}"
