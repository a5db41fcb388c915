"""Autofocus: finding the focus state of a camera by looking through it, with the renderer that takes the picture.

The package can be called: ``rptcam_cl.autofocus(scene)`` is `interface.autofocus`.
"""

import sys
from types import ModuleType
from typing import Any

from rptcam_cl.autofocus.controller import (
    METHODS,
    find_focus,
    focus_settings,
    focused_scene,
    follow_focus,
    in_focus,
    zone_at,
)
from rptcam_cl.autofocus.interface import autofocus
from rptcam_cl.autofocus.policy import Policy
from rptcam_cl.autofocus.probe import FocusProbe, Zone, ZoneImage
from rptcam_cl.autofocus.renderer import ProbeRenderer
from rptcam_cl.autofocus.report import FocusReport, NoContrast, OutOfReach, ProbeRecord
from rptcam_cl.autofocus.task import wanted

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
    "focus_settings",
    "focused_scene",
    "follow_focus",
    "in_focus",
    "wanted",
    "zone_at",
]


class _Package(ModuleType):
    """A package that is a function too, as both have the same name."""

    def __call__(self, *arguments: Any, **options: Any) -> FocusReport:
        return autofocus(*arguments, **options)


sys.modules[__name__].__class__ = _Package
