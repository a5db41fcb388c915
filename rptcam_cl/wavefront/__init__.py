"""Rendering: waves of paths through the kernels, and the film that they add to."""

from rptcam_cl.wavefront.progressive import Progress, Rendering, SavedState, render_plan
from rptcam_cl.wavefront.several import AnyWavefront, SharedWavefront
from rptcam_cl.wavefront.tracer import Wavefront

__all__ = ["AnyWavefront", "Progress", "Rendering", "SavedState", "SharedWavefront", "Wavefront", "render_plan"]
