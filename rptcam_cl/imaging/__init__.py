"""Pictures: the linear film as an array, what is developed from it, and the files both are kept in."""

from rptcam_cl.imaging.cryptomatte import NAMES as CRYPTOMATTE_NAMES
from rptcam_cl.imaging.cryptomatte import ranked
from rptcam_cl.imaging.denoise import GUIDES, check_denoiser
from rptcam_cl.imaging.desqueeze import desqueezed
from rptcam_cl.imaging.development import Development, developed_values, quantised
from rptcam_cl.imaging.film_files import FILM_SUFFIXES, LARGE, read_film
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.marks import MARKED
from rptcam_cl.imaging.picture_settings import develop, with_picture_settings
from rptcam_cl.imaging.raw import RawImage, check_raw_output
from rptcam_cl.imaging.scene_sensor import check_sensor, sensor_of
from rptcam_cl.imaging.slanted_edge import mtf50_at
from rptcam_cl.imaging.tone import srgb_from_linear
from rptcam_cl.imaging.truth_files import LABELS, MOST_INSTANCES, TRUTH_FILES, categories_of, with_classes
from rptcam_cl.imaging.video import check_video, write_video
from rptcam_cl.imaging.white_balance import Gains, Grey, GreyWorld, KnownLight
from rptcam_cl.imaging.writers import DEVELOPED_SUFFIXES, LAYER_SUFFIXES, SUFFIXES, check_output, holds_layers

__all__ = [
    "CRYPTOMATTE_NAMES",
    "DEVELOPED_SUFFIXES",
    "FILM_SUFFIXES",
    "GUIDES",
    "LABELS",
    "LARGE",
    "LAYER_SUFFIXES",
    "MARKED",
    "MOST_INSTANCES",
    "SUFFIXES",
    "TRUTH_FILES",
    "Development",
    "Gains",
    "Grey",
    "GreyWorld",
    "Image",
    "KnownLight",
    "RawImage",
    "categories_of",
    "check_denoiser",
    "check_output",
    "check_raw_output",
    "check_sensor",
    "check_video",
    "desqueezed",
    "develop",
    "developed_values",
    "holds_layers",
    "mtf50_at",
    "quantised",
    "ranked",
    "read_film",
    "sensor_of",
    "srgb_from_linear",
    "with_classes",
    "with_picture_settings",
    "write_video",
]
