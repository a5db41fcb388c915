"""Pictures: the linear film as an array, its tone-mapped form, and the files both are kept in."""

from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.tone import srgb_from_linear, tone_mapped
from rptcam_cl.imaging.writers import SUFFIXES, check_output

__all__ = ["SUFFIXES", "Image", "check_output", "srgb_from_linear", "tone_mapped"]
