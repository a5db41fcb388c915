"""Lenses as they are made: tolerances, copies within them, and what the copies are worth. Needs no OpenCL."""

from rptcam_cl.tolerances.chosen import ChosenCopy, chosen_copy
from rptcam_cl.tolerances.report import percentile_rows, report, yield_curve
from rptcam_cl.tolerances.run import Sensitivity, ToleranceRun, tolerance
from rptcam_cl.tolerances.specification import Specification, specification
from rptcam_cl.tolerances.statistics import Interval

__all__ = [
    "ChosenCopy",
    "Interval",
    "Sensitivity",
    "Specification",
    "ToleranceRun",
    "chosen_copy",
    "percentile_rows",
    "report",
    "specification",
    "tolerance",
    "yield_curve",
]
