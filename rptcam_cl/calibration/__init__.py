"""A camera handed to other programs: its projection as camera models and files, and what its lens does as maps."""

from rptcam_cl.calibration.charts import residual_chart
from rptcam_cl.calibration.falloff import coc_map, vignetting_map
from rptcam_cl.calibration.files import (
    HELD,
    PIXEL_CENTRE,
    WRITTEN,
    check_held,
    colmap_texts,
    document,
    object_text,
    opencv_text,
    openlensio_text,
    ros_text,
)
from rptcam_cl.calibration.fit import Calibration, calibrate, calibrate_best
from rptcam_cl.calibration.map_files import coc_exr, psf_npz, st_exr, vignetting_exr
from rptcam_cl.calibration.models import BY_ANGLE, COEFFICIENTS, project
from rptcam_cl.calibration.osl import osl_text
from rptcam_cl.calibration.point_images import PointImages, point_images
from rptcam_cl.calibration.stmap import StMaps, st_maps
from rptcam_cl.calibration.subject import subject
from rptcam_cl.calibration.usd import usd_text
from rptcam_cl.calibration.view import View, view

__all__ = [
    "BY_ANGLE",
    "COEFFICIENTS",
    "HELD",
    "PIXEL_CENTRE",
    "WRITTEN",
    "Calibration",
    "PointImages",
    "StMaps",
    "View",
    "calibrate",
    "calibrate_best",
    "check_held",
    "coc_exr",
    "coc_map",
    "colmap_texts",
    "document",
    "object_text",
    "opencv_text",
    "openlensio_text",
    "osl_text",
    "point_images",
    "project",
    "psf_npz",
    "residual_chart",
    "ros_text",
    "st_exr",
    "st_maps",
    "subject",
    "usd_text",
    "view",
    "vignetting_exr",
    "vignetting_map",
]
