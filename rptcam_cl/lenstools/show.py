"""A lens as an SVG drawing in one call, for notebooks and scripts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rptcam_cl.lenstools.bundles import View
from rptcam_cl.lenstools.drawing import draw_lens
from rptcam_cl.lenstools.lens_state import setting
from rptcam_cl.lenstools.ray_paths import Tracer, reference
from rptcam_cl.lenstools.svg_file import svg_text

if TYPE_CHECKING:
    from rptcam_cl.optics import Lens


def svg(
    lens: Lens,
    *,
    f_number: float | None = None,
    focus_distance_m: float | None = None,
    tracer: Tracer = reference,
    **view: Any,
) -> str:
    """Return the cross-section of a lens as SVG text.

    Parameters
    ----------
    lens : Lens
    f_number, focus_distance_m : float, optional
        As in `setting`.
    tracer : Tracer
        What traces the rays; the float64 reference by default.
    **view
        What is drawn, as in `View`: ``section``, ``fields``, ``rays``, ``wavelengths_nm``, ``blocked``.
    """
    return svg_text(draw_lens(setting(lens, f_number, focus_distance_m), View(**view), tracer))
