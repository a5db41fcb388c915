"""Pictures: the linear film as an array, its tone-mapped form, and the files both are kept in."""

from rptcam_cl.imaging.denoise import GUIDES, check_denoiser
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.raw import RawImage, check_raw_output
from rptcam_cl.imaging.tone import srgb_from_linear, tone_mapped
from rptcam_cl.imaging.writers import LAYER_SUFFIXES, SUFFIXES, check_output, holds_layers

__all__ = [
    "GUIDES",
    "LAYER_SUFFIXES",
    "SUFFIXES",
    "Image",
    "RawImage",
    "check_denoiser",
    "check_output",
    "check_raw_output",
    "holds_layers",
    "srgb_from_linear",
    "tone_mapped",
]
