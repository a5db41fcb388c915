"""Autofocus: finding the focus state of a camera by looking through it, with the renderer that takes the picture.

The package can be called: ``rptcam_cl.autofocus(scene)`` is `interface.autofocus`.
"""

import sys
from types import ModuleType
from typing import Any

from rptcam_cl.focusing.controller import (
    METHODS,
    autofocus,
    find_focus,
    focus_settings,
    focused_scene,
    follow_focus,
    in_focus,
    zone_at,
)
from rptcam_cl.focusing.looks import wanted
from rptcam_cl.focusing.probe import FocusProbe, Policy, Zone, ZoneImage
from rptcam_cl.focusing.renderer import ProbeRenderer
from rptcam_cl.focusing.report import FocusReport, NoContrast, OutOfReach, ProbeRecord, focus_plot


class _Package(ModuleType):
    """A package that is a function too, as both have the same name."""

    def __call__(self, *arguments: Any, **options: Any) -> FocusReport:
        return autofocus(*arguments, **options)


sys.modules[__name__].__class__ = _Package

__all__ = [
    "METHODS",
    "FocusProbe",
    "FocusReport",
    "NoContrast",
    "OutOfReach",
    "Policy",
    "ProbeRecord",
    "ProbeRenderer",
    "Zone",
    "ZoneImage",
    "autofocus",
    "find_focus",
    "focus_plot",
    "focus_settings",
    "focused_scene",
    "follow_focus",
    "in_focus",
    "wanted",
    "zone_at",
]
