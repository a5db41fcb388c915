"""Reading picture files: PNG, JPEG and the like in 8 bits, OpenEXR and Radiance HDR in floats."""

from rptcam_cl.pictures.picture import LARGEST_PIXELS, Picture
from rptcam_cl.pictures.read import SUFFIXES, read_picture

__all__ = ["LARGEST_PIXELS", "SUFFIXES", "Picture", "read_picture"]
