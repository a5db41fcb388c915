"""Numerical self-knowledge: what a picture has lost, and whether a device computes what it should."""

from rptcam_cl.numerics.knowledge import anomalies, self_knowledge, summary
from rptcam_cl.numerics.lens_margin import LensMargin, lens_margin

__all__ = ["LensMargin", "anomalies", "lens_margin", "self_knowledge", "summary"]
