"""Autofocus: finding the focus state of a camera by probing zones of its picture, with the renderer that takes it."""

from rptcam_cl.focusing.continuous import Following, after
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
from rptcam_cl.focusing.drives import focus_drive
from rptcam_cl.focusing.probe import Drive, Policy, Zone, ZoneImage, circle_of_confusion
from rptcam_cl.focusing.renderer import ProbeRenderer
from rptcam_cl.focusing.report import FocusReport, NoContrast, OutOfReach, ProbeRecord, focus_plot

__all__ = [
    "METHODS",
    "Drive",
    "FocusReport",
    "Following",
    "NoContrast",
    "OutOfReach",
    "Policy",
    "ProbeRecord",
    "ProbeRenderer",
    "Zone",
    "ZoneImage",
    "after",
    "autofocus",
    "circle_of_confusion",
    "find_focus",
    "focus_drive",
    "focus_plot",
    "focus_settings",
    "focused_scene",
    "follow_focus",
    "in_focus",
    "zone_at",
]
