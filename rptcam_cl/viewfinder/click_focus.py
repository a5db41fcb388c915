"""Focus at a click, and autofocus by zones: what `rptcam focus` finds, as changes of the scene and a curve to draw."""

from __future__ import annotations

import contextlib
import math
import pickle
from collections.abc import Callable, Sequence
from dataclasses import astuple
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Session
from rptcam_cl.focusing import FocusReport, autofocus, focus_drive
from rptcam_cl.scene import METHODS, Scene, near_name

MOST_ZONES = 64


@dataclass(frozen=True)
class Focused:
    """A focus that was found.

    Attributes
    ----------
    report : FocusReport
        Everything about the search.
    changes : dict
        Key paths of the scene and their values that set it.
    """

    report: FocusReport
    changes: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Return what a page shows, as plain values; the curve has its probes in the order in which they were made."""
        found = self.report
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


@dataclass(frozen=True)
class FocusOrder:
    """A search that another process makes first, so that this one finds its kernels compiled.

    Attributes
    ----------
    device : str
        Its id.
    place : dict
        ``point`` or ``zones``, as `autofocus` takes them.
    """

    device: str
    scene: Scene
    method: str | None
    place: dict[str, Any]

    def carry_out(self) -> None:
        """Search; what is found does not count."""
        with contextlib.suppress(InputError):
            autofocus(self.scene, self.method, device=self.device, **self.place)

    def pickled(self) -> bytes:
        """Return what `rptcam_cl.rendering.Compiler` takes."""
        return pickle.dumps(self)


def focus_at(
    scene: Scene,
    device: Session,
    x: float,
    y: float,
    method: str | None = None,
    on_probe: Callable[[Any], Any] | None = None,
) -> Focused:
    """Return the focus on a point of the picture, the answer of ``rptcam focus SCENE --point x,y``.

    Parameters
    ----------
    scene
        As requested: its exposure does not matter.
    x, y
        In fractions of the picture from its left and top.
    method
        In place of the scene's, or of contrast.
    on_probe
        Called with every probe.

    Raises
    ------
    NoContrast, OutOfReach
        Nothing there tells focus from blur; it is nearer than the camera can focus, or farther.
    InputError
        The camera has no focus, or an argument is wrong.
    """
    report = autofocus(scene, _method(method), point=(x, y), device=device, on_probe=on_probe)
    return Focused(report, _changes(scene, report))


def focus_zones(
    scene: Scene,
    device: Session,
    method: str | None = None,
    zones: Sequence[Sequence[float]] | None = None,
    on_probe: Callable[[Any], Any] | None = None,
) -> Focused:
    """Return the focus that autofocus finds in zones, or in those of the scene; errors as of `focus_at`.

    Parameters
    ----------
    zones
        Rectangles [x0, x1, y0, y1] in fractions of the picture from its left and top.
    """
    if zones is not None and len(zones) > MOST_ZONES:
        raise InputError(f"zones: too many (got {len(zones)}; allowed: up to {MOST_ZONES})")
    places = None if zones is None else [tuple(zone) for zone in zones]
    report = autofocus(scene, _method(method), zones=places, device=device, on_probe=on_probe)
    return Focused(report, _changes(scene, report))


def _method(name: str | None) -> str | None:
    if name is not None and name not in METHODS:
        raise InputError(
            f"method: is none{near_name(str(name), METHODS)} (got {name!r}; allowed: {', '.join(METHODS)})"
        )
    return name


def _changes(scene: Scene, report: FocusReport) -> dict[str, Any]:
    """Return the key paths that set the state which was found."""
    keys = focus_drive(scene).camera_keys(report.state)
    return {f"camera.{name}": value for name, value in keys.items() if value is not None}
