"""The movements of a view camera: how its film stands behind the lens.

The lens stays where the pose has it, on the line from the eye to the target; the eye is the point of the axis where the
film stands without movements. The film is first turned about its centre, then moved. Rise and shift are named by what
the picture gains: as a lens turns the picture over, the film itself goes down and to the left. Tilt and swing turn the
film about the right and the up of the camera, by the right-hand rule. The lower half of the picture lies on the upper
half of the film, so that a film whose top leans back focuses nearer at the bottom of the picture.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.quantities import NUMBER

Turn = Annotated[float, Field(ge=-80, le=80), NUMBER]
Move = Annotated[float, Field(ge=-1e6, le=1e6), NUMBER]
Triple = tuple[float, float, float]


class Movements(SceneModel):
    """How the film stands behind the lens: rise and shift move it, tilt and swing turn it about its centre."""

    rise_mm: Move = 0.0
    """How far the film goes down, so that the picture shows more of what is above [mm]."""

    shift_mm: Move = 0.0
    """How far the film goes to the left, so that the picture shows more of what is on the right [mm]."""

    tilt_degrees: Turn = 0.0
    """Turn about the horizontal; positive: the top of the film leans back, what is low in the picture is sharp near."""

    swing_degrees: Turn = 0.0
    """Turn about the vertical, after the tilt; positive: the left of the film leans back, what is right in the picture
    is sharp near."""

    @property
    def turns(self) -> bool:
        """Whether the film is turned out of the plane across the axis."""
        return self.tilt_degrees != 0.0 or self.swing_degrees != 0.0

    def sides(self) -> tuple[Triple, Triple]:
        """Return unit vectors along the film to the right and up: x to the right, y up, z away from the lens."""
        tilt, swing = math.radians(self.tilt_degrees), math.radians(self.swing_degrees)
        across = (math.cos(swing), 0.0, -math.sin(swing))
        up = (math.sin(swing) * math.sin(tilt), math.cos(tilt), math.cos(swing) * math.sin(tilt))
        return across, up


NO_MOVEMENTS = Movements()
