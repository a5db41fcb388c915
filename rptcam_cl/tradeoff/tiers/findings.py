"""What was measured of a scene's lens, the camera model chosen from it, and both in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.scene import Accuracy, LensColour
from rptcam_cl.tradeoff.tiers.errors import EFFECTS, TierError
from rptcam_cl.tradeoff.tiers.tiers import Tier


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
        Whether the lens refracts each wavelength separately.
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


NAMES = dict(zip(EFFECTS, ("distortion", "blur", "outline of blurs", "round stop", "colour"), strict=True))


def described(found: Findings, allowed: Accuracy) -> dict[str, Any]:
    """Return what the picture's metadata should say of a decision; null stands for what the lens does not see."""
    numbers = {
        "depths_m": found.depths_m,
        "blur_px": found.blur_px,
        "stop_shape_px": found.shape_px,
        "lens_colour_px": found.colour_px,
        "lens_tint": found.tint or None,
    }
    return {
        "camera_model": found.tier,
        "lens_colour": found.colours,
        "says": list(_sentences(found, allowed)),
        "max_error_px": allowed.max_error_px,
        "max_illumination_error": allowed.max_illumination_error,
        **{key: _plain(value) for key, value in numbers.items() if value is not None},
        "errors": [_as_data(error) for error in found.errors],
        **({"reason": found.reason} if found.reason else {}),
    }


def _as_data(error: TierError) -> dict[str, Any]:
    return {
        "camera_model": error.tier,
        "pixels": _plain(error.pixels),
        "effects_px": {name: _plain(values) for name, values in error.effects.items()},
        "illumination": _plain(error.illumination),
    }


def _plain(value: float | Sequence[float | None] | None) -> Any:
    """Return numbers to four digits, as JSON can hold them."""
    if value is None or value == math.inf:
        return None
    return float(f"{value:.4g}") if isinstance(value, (int, float)) else [_plain(each) for each in value]


def _sentences(found: Findings, allowed: Accuracy) -> Iterator[str]:
    """Yield what was chosen, then what was found of the lens, then why no cheaper model was taken."""
    bounds = f"allowed are {pixels(allowed.max_error_px)} and {per_cent(allowed.max_illumination_error)}"
    chosen = next((error for error in found.errors if error.tier == found.tier), None)
    errs = "every ray is traced" if chosen is None else _effects(chosen)
    yield f"{found.tier}: {errs} ({bounds})"
    yield from _lens(found, allowed)
    if found.reason:
        yield f"no cheaper camera model: {found.reason}"
    for error in found.errors:
        if error.tier == found.tier or found.blur_px == math.inf:
            break
        yield f"not {error.tier}: {_effects(error, allowed)}"


def _lens(found: Findings, allowed: Accuracy) -> Iterator[str]:
    """Yield what is visible of the lens at this size of pixels."""
    if found.blur_px == math.inf:
        yield "part of the film sees nothing through the lens"
    elif found.blur_px is not None:
        shows = "the aperture shows" if found.blur_px > allowed.max_error_px else "the aperture does not show"
        yield f"blur up to {pixels(2 * found.blur_px)} across: {shows}"
    if found.shape_px is not None and found.shape_px < math.inf:
        shows = "its shape shows" if found.shape_px > allowed.max_error_px else "its shape does not show"
        yield f"a round stop of the same area would be {pixels(found.shape_px)} off: {shows}"
    if found.colour_px is not None:
        tint = f", tint {per_cent(found.tint)}" if found.tint else ""
        yield f"colour {pixels(found.colour_px)}{tint}: {_carried(found)}"


def _carried(found: Findings) -> str:
    return "the lens refracts each wavelength separately" if found.colours == "on" else "one wavelength stands for all"


def _effects(error: TierError, beyond: Accuracy | None = None) -> str:
    """Return the effects of a tier with their numbers: all that are any, or those beyond what is allowed."""
    least = 0.0 if beyond is None else beyond.max_error_px
    said = [f"{NAMES[name]} {pixels(worst)}" for name in EFFECTS if (worst := max(error.effects[name])) > least]
    light = max(error.illumination)
    for name, value in (("light", light), ("tint", error.tint)):
        if value > (0.0 if beyond is None else beyond.max_illumination_error):
            said.append(f"{name} {per_cent(value)}")
    return ", ".join(said)


def pixels(value: float) -> str:
    """Return a number of pixels for readers."""
    return f"{value:.2g} px" if value < 10 else f"{value:.0f} px"


def per_cent(share: float) -> str:
    """Return a share for readers."""
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.0f} %"
