"""Bounding volume hierarchies: built on the device, flat arrays for the kernels, kept on disk."""

from rptcam_cl.acceleration.build import build_bvh
from rptcam_cl.acceleration.bvh import Bvh

__all__ = ["Bvh", "build_bvh"]
