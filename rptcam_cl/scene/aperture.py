"""The shape of a lens opening."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.file_reference import FileName, FileReference
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER, list_of

Turn = Annotated[float, Field(ge=-360, le=360), NUMBER]
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6), NUMBER]
PAIR = "a pair [x, y]"


class CircularAperture(SceneModel):
    """A round aperture."""

    shape: Literal["circle"] = "circle"
    """Outline of the aperture."""


class PolygonAperture(SceneModel):
    """An aperture made of blades: corners on the circle of the aperture radius, edges straight or bulging."""

    shape: Literal["polygon"]
    """Outline of the aperture."""

    blades: Annotated[int, Field(ge=3, le=64), WHOLE_NUMBER]
    """Number of corners."""

    curvature: Annotated[float, Field(ge=0, le=1), NUMBER] = 0.0
    """How far each edge bulges: 0 straight, 1 the circle."""

    rotation_degrees: Turn = 0.0
    """Turn of the first corner from the camera's +x towards +y [degrees]."""


class StarAperture(SceneModel):
    """A star with its tips on the circle of the aperture radius."""

    shape: Literal["star"]
    """Outline of the aperture."""

    points: Annotated[int, Field(ge=3, le=64), WHOLE_NUMBER] = 5
    """Number of tips."""

    inner_radius: Annotated[float, Field(gt=0, lt=1), NUMBER] = 0.4
    """Radius of the inner corners as a share of the aperture radius."""

    rotation_degrees: Turn = 90.0
    """Turn of the first tip from the camera's +x towards +y [degrees]; 90 points it up."""


class HeartAperture(SceneModel):
    """A heart within the circle of the aperture radius."""

    shape: Literal["heart"]
    """Outline of the aperture."""

    rotation_degrees: Turn = 0.0
    """Turn from upright, from the camera's +x towards +y [degrees]."""


class OutlineAperture(SceneModel):
    """Any polygon that does not cross itself, moved and scaled to touch the circle of the aperture radius."""

    shape: Literal["outline"]
    """Outline of the aperture."""

    points: Annotated[
        tuple[Annotated[tuple[Coordinate, Coordinate], BeforeValidator(list_of(2, PAIR))], ...],
        Field(min_length=3, max_length=256),
    ]
    """Corners in order, as pairs [x, y] of any unit."""

    rotation_degrees: Turn = 0.0
    """Turn from the camera's +x towards +y [degrees]."""


class ImageAperture(FileReference):
    """A square picture: open where it is brighter than half; its inscribed circle is the aperture's."""

    shape: Literal["image"]
    """Outline of the aperture."""

    file: FileName
    """Picture file in the scene's folder (PNG, JPEG or TIFF, at most 512 x 512 pixels)."""


Aperture = Annotated[
    CircularAperture | PolygonAperture | StarAperture | HeartAperture | OutlineAperture | ImageAperture,
    Field(discriminator="shape"),
]
