"""How far cheaper camera models are from a traced lens, and which is the cheapest that a picture bears."""

from rptcam_cl.accuracy.decide import Decision, decided
from rptcam_cl.accuracy.errors import TierError, tier_errors
from rptcam_cl.accuracy.tiers import TIERS, Tier, equivalent

__all__ = ["TIERS", "Decision", "Tier", "TierError", "decided", "equivalent", "tier_errors"]
