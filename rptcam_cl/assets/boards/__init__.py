"""Flat boards that programs find in pictures: patterns of dark and light, and the points that they are known by."""

from rptcam_cl.assets.boards.markers import DICTIONARIES, marker_bits
from rptcam_cl.assets.boards.pattern import Pattern, Shape
from rptcam_cl.assets.boards.patterns import aruco, charuco, checker, circles, siemens, slanted_edge

__all__ = [
    "DICTIONARIES",
    "Pattern",
    "Shape",
    "aruco",
    "charuco",
    "checker",
    "circles",
    "marker_bits",
    "siemens",
    "slanted_edge",
]
