"""The largest share of light that any surface of a scene gives back: what bounds the light of long paths."""

from __future__ import annotations

from collections.abc import Iterable

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.scene import (
    Blend,
    Colour,
    Conductor,
    Emissive,
    ImageTexture,
    Material,
    Matte,
    Mirror,
    Mix,
    SpectralColour,
    Texture,
)


@dataclass(frozen=True)
class LargestAlbedo:
    """The largest albedo of a scene, at any wavelength and angle.

    Attributes
    ----------
    value : float or None
        None where nothing below 1 is known for sure.
    reason : str
        Why it is not known; empty where it is.
    """

    value: float | None
    reason: str = ""


def largest_albedo(materials: Iterable[Material]) -> LargestAlbedo:
    """Return the largest albedo of some materials; that of none is 0."""
    largest = 0.0
    for material in {id(material): material for material in materials}.values():
        found = _albedo(material)
        if found.value is None:
            return found
        largest = max(largest, found.value)
    return LargestAlbedo(largest)


def _albedo(material: Material) -> LargestAlbedo:
    match material:
        case Emissive():
            return LargestAlbedo(0.0)
        case Mix():
            return largest_albedo(material.materials)
        case Matte() | Mirror():
            return _of_colour(material.reflectance)
        case Conductor() if material.reflectance is not None:
            return _of_colour(material.reflectance)
    # Fresnel's equations reflect everything at grazing angles, and glass passes on what it does not reflect.
    return LargestAlbedo(None, f"{material.kind} may reflect or pass on all light")


def _of_colour(colour: Colour | Texture) -> LargestAlbedo:
    if isinstance(colour, ImageTexture):
        return LargestAlbedo(None, "a picture gives the reflectance")
    parts: tuple[Colour, ...] = colour.colours if isinstance(colour, Blend) else (colour,)
    return LargestAlbedo(max(map(_largest, parts)))


def _largest(colour: Colour) -> float:
    """Return the largest channel, and of a spectrum the largest sample; what upsampling makes of channels is less."""
    largest = max(colour)
    return max(largest, float(colour.samples.max())) if isinstance(colour, SpectralColour) else largest
