"""Looking at lenses: drawings, spots, transfer functions, vignetting, distortion and conversions. Needs no OpenCL.

Pictures are made by a writer of our own, as SVG, or as PNG by Pillow.
"""

from rptcam_cl.lensview.bundles import View
from rptcam_cl.lensview.drawing import draw_lens
from rptcam_cl.lensview.setting import Setting, setting
from rptcam_cl.lensview.show import svg

__all__ = ["Setting", "View", "draw_lens", "setting", "svg"]
