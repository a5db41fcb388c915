"""What each approximation of a picture costs and gains, measured: camera models, spectrum, depth, samplers."""

from rptcam_cl.tradeoff.interface import measure_tradeoff
from rptcam_cl.tradeoff.report import Advice, TradeoffReport

__all__ = ["Advice", "TradeoffReport", "measure_tradeoff"]
