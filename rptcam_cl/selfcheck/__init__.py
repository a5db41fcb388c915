"""Numerical self-knowledge: what a picture has lost, and whether a device computes what it should."""

from rptcam_cl.rendering import LensMargin, anomalies, lens_margin, self_knowledge, summary
from rptcam_cl.selfcheck.check import Check
from rptcam_cl.selfcheck.machine import as_lines, environment
from rptcam_cl.selfcheck.suite import outcomes

__all__ = [
    "Check",
    "LensMargin",
    "anomalies",
    "as_lines",
    "environment",
    "lens_margin",
    "outcomes",
    "self_knowledge",
    "summary",
]
