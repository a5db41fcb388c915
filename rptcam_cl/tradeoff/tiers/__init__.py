"""How far cheaper camera models are from a traced lens, and which is the cheapest that a picture bears."""

from rptcam_cl.tradeoff.tiers.decide import Decision, choose_camera
from rptcam_cl.tradeoff.tiers.errors import TierError, tier_errors
from rptcam_cl.tradeoff.tiers.tiers import TIERS, Tier, equivalent

__all__ = ["TIERS", "Decision", "Tier", "TierError", "choose_camera", "equivalent", "tier_errors"]
