"""Looking at lenses: drawings, spots, transfer functions, vignetting, distortion and conversions. Needs no OpenCL.

A drawing writes its own SVG; all charts, also those of other rooms, are drawn by matplotlib in one style.
"""

from rptcam_cl.lenstools.breathing import breathing_chart, breathing_csv, breathing_table
from rptcam_cl.lenstools.bundles import View
from rptcam_cl.lenstools.charts import (
    DRAWN,
    add_key,
    chart_svg,
    check_suffix,
    encoded,
    new_chart,
    new_figure,
    series,
    styled,
)
from rptcam_cl.lenstools.codev_file import codev_text
from rptcam_cl.lenstools.colours import FAINT, INK, wavelength_colour
from rptcam_cl.lenstools.cross_section import blades, glass, lines, obstruction
from rptcam_cl.lenstools.device_tracing import (
    LensTracer,
    Precision,
    TraceableLens,
    device_tracer,
    trace_on_device,
    traceable,
)
from rptcam_cl.lenstools.distortion import PROJECTIONS, distortion_chart, distortion_table, followed_projection
from rptcam_cl.lenstools.drawing import draw_lens, svg
from rptcam_cl.lenstools.fields import default_fields
from rptcam_cl.lenstools.foreign import left_out
from rptcam_cl.lenstools.ghosts import draw_ghost, ghost_summary, ghost_table, way_text
from rptcam_cl.lenstools.lens_state import Setting, setting
from rptcam_cl.lenstools.mtf import field_mtf, mtf_chart, mtf_moves, mtf_table
from rptcam_cl.lenstools.pbrt_table import loses_dispersion, pbrt_text
from rptcam_cl.lenstools.picture import Drawing, svg_text
from rptcam_cl.lenstools.prescription import lens_text
from rptcam_cl.lenstools.psf import image_moves, npy_bytes, point_image, psf_chart
from rptcam_cl.lenstools.ray_paths import Tracer, reference
from rptcam_cl.lenstools.spots import FilmSpot, at_best_focus, film_spots, spot_chart, spot_table
from rptcam_cl.lenstools.tolerance_chart import tolerance_chart
from rptcam_cl.lenstools.transmittance import Row, transmittance_chart, transmittance_table
from rptcam_cl.lenstools.vignetting import film_radii, vignetting_chart, vignetting_table
from rptcam_cl.lenstools.wave_images import wave_mtf_chart, wave_mtf_table, wave_point_image, wave_transfer
from rptcam_cl.lenstools.wavefronts import FieldWave, field_waves, wavefront_chart, wavefront_table
from rptcam_cl.lenstools.zemax_file import zemax_text

__all__ = [
    "DRAWN",
    "FAINT",
    "INK",
    "PROJECTIONS",
    "Drawing",
    "FieldWave",
    "FilmSpot",
    "LensTracer",
    "Precision",
    "Row",
    "Setting",
    "TraceableLens",
    "Tracer",
    "View",
    "add_key",
    "at_best_focus",
    "blades",
    "breathing_chart",
    "breathing_csv",
    "breathing_table",
    "chart_svg",
    "check_suffix",
    "codev_text",
    "default_fields",
    "device_tracer",
    "distortion_chart",
    "distortion_table",
    "draw_ghost",
    "draw_lens",
    "encoded",
    "field_mtf",
    "field_waves",
    "film_radii",
    "film_spots",
    "followed_projection",
    "ghost_summary",
    "ghost_table",
    "glass",
    "image_moves",
    "left_out",
    "lens_text",
    "lines",
    "loses_dispersion",
    "mtf_chart",
    "mtf_moves",
    "mtf_table",
    "new_chart",
    "new_figure",
    "npy_bytes",
    "obstruction",
    "pbrt_text",
    "point_image",
    "psf_chart",
    "reference",
    "series",
    "setting",
    "spot_chart",
    "spot_table",
    "styled",
    "svg",
    "svg_text",
    "tolerance_chart",
    "trace_on_device",
    "traceable",
    "transmittance_chart",
    "transmittance_table",
    "vignetting_chart",
    "vignetting_table",
    "wave_mtf_chart",
    "wave_mtf_table",
    "wave_point_image",
    "wave_transfer",
    "wavefront_chart",
    "wavefront_table",
    "wavelength_colour",
    "way_text",
    "zemax_text",
]
