"""Bounding volume hierarchies: built on the device, flat arrays for the kernels, kept on disk."""

from rptcam_cl.acceleration.build import build_bvh
from rptcam_cl.acceleration.bvh import Bvh
from rptcam_cl.acceleration.cache import load_or_build

__all__ = ["Bvh", "build_bvh", "load_or_build"]
