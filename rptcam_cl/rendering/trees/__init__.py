"""Bounding volume hierarchies: built on the device, flat arrays for the kernels, kept on disk."""

from rptcam_cl.rendering.trees.build import build_bvh
from rptcam_cl.rendering.trees.cache import load_or_build
from rptcam_cl.rendering.trees.wide_tree import Bvh

__all__ = ["Bvh", "build_bvh", "load_or_build"]
