"""What each approximation of a picture costs and gains, measured: camera models, spectrum, depth, samplers."""

from rptcam_cl.tradeoff.comparison import Advice
from rptcam_cl.tradeoff.headline import COMMAND
from rptcam_cl.tradeoff.interface import TradeoffReport, measure_tradeoff
from rptcam_cl.tradeoff.plot import tradeoff_plot
from rptcam_cl.tradeoff.table import markdown, summary, tables
from rptcam_cl.tradeoff.text import caveats, recommendation
from rptcam_cl.tradeoff.tiers.decide import choose_camera
from rptcam_cl.tradeoff.tiers.tiers import equivalent

__all__ = [
    "COMMAND",
    "Advice",
    "TradeoffReport",
    "caveats",
    "choose_camera",
    "equivalent",
    "markdown",
    "measure_tradeoff",
    "recommendation",
    "summary",
    "tables",
    "tradeoff_plot",
]
