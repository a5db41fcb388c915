"""Half pupils: the line that parts the pupil into two halves of equal light, as a zone of the picture sees it."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.model import CameraModel
from rptcam_cl.cameras.pupil_rays import PupilRays
from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]
Split = Literal["x", "y"]


@dataclass(frozen=True)
class PupilLine:
    """A line across the pupil, in the coordinates in which the camera's kernel chooses a point of it.

    Attributes
    ----------
    normal : (x, y)
        Unit vector across the line.
    offset : float
        Points q and film points f [mm] with ``normal . (q + share * f) > offset`` lie beyond it.
    share : float
        How far the line moves against the film point, so that it stays in the middle of the pupil.
    """

    normal: tuple[float, float]
    offset: float
    share: float

    def beyond(self, rays: PupilRays) -> Array:
        """Return which share (m, n) of the cell of the pupil that each ray stands for lies beyond the line."""
        normal = np.array(self.normal)
        place = (rays.pupil + self.share * rays.film[:, None]) @ normal - self.offset
        width = rays.cell @ np.abs(normal)
        return np.asarray(np.clip(0.5 + place / width[:, None], 0.0, 1.0))


def pupil_line(rays: PupilRays, split: Split) -> PupilLine:
    """Return the line through the middle of the light that a zone receives.

    Parameters
    ----------
    rays
        Of the middle of the zone, first, and of places round it.
    split
        ``x``: a left and a right half; ``y``: a lower and an upper one.
    """
    axis = ("x", "y").index(split)
    normal = (1.0, 0.0) if split == "x" else (0.0, 1.0)
    middle = np.sum(rays.weights[..., None] * rays.pupil, axis=1)[:, axis]
    away = rays.film[1:, axis] - rays.film[0, axis]
    share = -float(away @ (middle[1:] - middle[0]) / (away @ away)) if away.any() else 0.0
    return PupilLine(normal, float(middle[0] + share * rays.film[0, axis]), share)


def halved(model: CameraModel, line: PupilLine, *, beyond: bool) -> CameraModel:
    """Return a camera that lets only the light of one half of its pupil count."""
    record = model.record.copy()
    record["half_pupil"] = (*line.normal, line.offset, line.share, beyond)
    return replace(model, record=record, facts=model.facts | {"HALF_PUPIL": 1})
