"""Looking at lenses: drawings, spots, transfer functions, vignetting, distortion and conversions. Needs no OpenCL.

Pictures are made by a writer of our own, as SVG, or as PNG by Pillow.
"""

from rptcam_cl.lenstools.bundles import View
from rptcam_cl.lenstools.chart import Axes, Legend, draw_key, padded
from rptcam_cl.lenstools.codev_file import codev_text
from rptcam_cl.lenstools.device_tracing import Precision, TraceableLens, device_tracer, trace_on_device, traceable
from rptcam_cl.lenstools.distortion import PROJECTIONS, distortion_picture, distortion_table, followed_projection
from rptcam_cl.lenstools.drawing import draw_lens
from rptcam_cl.lenstools.fields import default_fields
from rptcam_cl.lenstools.foreign import left_out
from rptcam_cl.lenstools.lens_state import Setting, setting
from rptcam_cl.lenstools.mtf import mtf_picture, mtf_table
from rptcam_cl.lenstools.output import check_suffix, encoded
from rptcam_cl.lenstools.pbrt_table import loses_dispersion, pbrt_text
from rptcam_cl.lenstools.picture import FAINT, GRID, INK, SERIES, Drawing, Path, Point, Text
from rptcam_cl.lenstools.prescription import lens_text
from rptcam_cl.lenstools.psf import npy_bytes, picture_bytes, point_image
from rptcam_cl.lenstools.ray_paths import Tracer, reference
from rptcam_cl.lenstools.show import svg
from rptcam_cl.lenstools.spots import at_best_focus, film_spots, spot_picture, spot_table
from rptcam_cl.lenstools.svg_file import svg_text
from rptcam_cl.lenstools.transmittance import Row, transmittance_picture, transmittance_table
from rptcam_cl.lenstools.vignetting import film_radii, vignetting_picture, vignetting_table
from rptcam_cl.lenstools.zemax_file import zemax_text

__all__ = [
    "FAINT",
    "GRID",
    "INK",
    "PROJECTIONS",
    "SERIES",
    "Axes",
    "Drawing",
    "Legend",
    "Path",
    "Point",
    "Precision",
    "Row",
    "Setting",
    "Text",
    "TraceableLens",
    "Tracer",
    "View",
    "at_best_focus",
    "check_suffix",
    "codev_text",
    "default_fields",
    "device_tracer",
    "distortion_picture",
    "distortion_table",
    "draw_key",
    "draw_lens",
    "encoded",
    "film_radii",
    "film_spots",
    "followed_projection",
    "left_out",
    "lens_text",
    "loses_dispersion",
    "mtf_picture",
    "mtf_table",
    "npy_bytes",
    "padded",
    "pbrt_text",
    "picture_bytes",
    "point_image",
    "reference",
    "setting",
    "spot_picture",
    "spot_table",
    "svg",
    "svg_text",
    "trace_on_device",
    "traceable",
    "transmittance_picture",
    "transmittance_table",
    "vignetting_picture",
    "vignetting_table",
    "zemax_text",
]
