"""Lenses in float64: prescriptions, glass, first-order data, exact rays, focus and pupils. Needs no OpenCL.

Lengths are millimetres and wavelengths nanometres. The frame of a lens has its origin at the first vertex and +z
towards the film; surfaces are listed scene side first.
"""

from rptcam_cl.optics.first_order import FirstOrder, Planes, Pupil
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import list_lenses, load_lens
from rptcam_cl.optics.surface import Surface
from rptcam_cl.optics.trace import Rays, Status

__all__ = [
    "FirstOrder",
    "Lens",
    "Planes",
    "Pupil",
    "Rays",
    "Status",
    "Surface",
    "list_lenses",
    "load_lens",
]
