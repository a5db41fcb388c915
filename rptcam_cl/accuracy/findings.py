"""What was measured of a scene's lens, and what was decided by it."""

from __future__ import annotations

from dataclasses import dataclass

from rptcam_cl.accuracy.errors import TierError
from rptcam_cl.accuracy.tiers import Tier
from rptcam_cl.scene.spectrum_mode import LensColour


@dataclass(frozen=True)
class Findings:
    """Numbers over the whole film and all depths that it may show.

    Attributes
    ----------
    errors : tuple of TierError
        Of every tier that there is for the lens, cheapest first.
    reason : str
        Why there is none; empty where there is.
    depths_m : (float, float or None)
        The nearest and the farthest thing ahead of the film [m]; None for infinitely far away.
    blur_px : float
        How far light of a point falls from its middle, at most [pixels].
    shape_px : float or None
        How far from its place a round stop would bring light, at most [pixels]; None for a stop that is round.
    colour_px : float or None
        How far light of other wavelengths falls from its place, at most [pixels]; None where the scene leaves it out,
        or the lens has no colours.
    tint : float
        How much more of one colour than of another the lens takes, where the picture shows it.
    tier : str
        The camera model that was chosen.
    colours : str
        Whether the lens bends each wavelength by itself, as decided.
    """

    errors: tuple[TierError, ...] = ()
    reason: str = ""
    depths_m: tuple[float, float | None] | None = None
    blur_px: float | None = None
    shape_px: float | None = None
    colour_px: float | None = None
    tint: float = 0.0
    tier: Tier = "realistic"
    colours: LensColour = "off"
