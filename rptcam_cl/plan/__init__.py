"""From a scene to what a device needs: records, and the facts that say which code the scene requires."""

from rptcam_cl.plan.plan import Plan, make_plan

__all__ = ["Plan", "make_plan"]
