"""Reading picture files: PNG, JPEG and the like in 8 bits, OpenEXR and Radiance HDR in floats."""

from rptcam_cl.assets.pictures.picture import LARGEST_PIXELS, Picture
from rptcam_cl.assets.pictures.read import SUFFIXES, has_alpha, read_picture

__all__ = [
    "LARGEST_PIXELS",
    "SUFFIXES",
    "Picture",
    "has_alpha",
    "read_picture",
]
