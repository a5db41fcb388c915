"""The kinds of lens surface, each one class with all that the program knows of it.

Sphere, conic and asphere follow from the profile of a surface; a `Form` has numbers of its own.
"""

from rptcam_cl.optics.shapes.biconic import Biconic
from rptcam_cl.optics.shapes.form import Form, short_radius
from rptcam_cl.optics.shapes.iterated import WORTH_MOVING, Iterated
from rptcam_cl.optics.shapes.profile_kinds import shape_of_profile
from rptcam_cl.optics.shapes.shape import Hits, Profile, Shape
from rptcam_cl.optics.shapes.toroid import Toroid

FORMS: tuple[type[Form], ...] = (Biconic, Toroid)

__all__ = [
    "FORMS",
    "WORTH_MOVING",
    "Biconic",
    "Form",
    "Hits",
    "Iterated",
    "Profile",
    "Shape",
    "Toroid",
    "shape_of_profile",
    "short_radius",
]
