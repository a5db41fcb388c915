"""Autofocus: finding the focus state of a camera by looking through it, with the renderer that takes the picture."""

from rptcam_cl.autofocus.probe import FocusProbe, Zone, ZoneImage
from rptcam_cl.autofocus.renderer import ProbeRenderer
from rptcam_cl.autofocus.report import FocusReport, NoContrast, ProbeRecord

__all__ = ["FocusProbe", "FocusReport", "NoContrast", "ProbeRecord", "ProbeRenderer", "Zone", "ZoneImage"]
