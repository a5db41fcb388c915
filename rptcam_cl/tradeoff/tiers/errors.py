"""How far the pictures of cheaper camera models lie from that of the traced lens, found by rays in float64."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import RayMap
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.tradeoff.tiers.bundles import RayBundle, tier_bundle
from rptcam_cl.tradeoff.tiers.tiers import TRAITS, Tier, fitted_to
from rptcam_cl.tradeoff.tiers.truth import FIELDS, FieldPoint, Truth

__all__ = ["EFFECTS", "FIELDS", "TierError", "tier_errors"]

Array = NDArray[np.float64]

EFFECTS = ("distortion", "blur", "outline", "shape", "colour")  # what moves light over the film


@dataclass(frozen=True)
class TierError:
    """What a tier does wrong at each of `FIELDS`.

    Attributes
    ----------
    tier : str
    effects : mapping
        By name of `EFFECTS`: how far light falls from its place, at the worst of the depths [pixels]. Infinite where
        the lens sees nothing. The shift of the middle of a bundle; the change of its spread (standard deviation, along
        the field, across it and in all); the largest distance between the outlines, their middles laid on each other; a
        round stop in place of another; light of another wavelength in the place of the camera's.
    illumination : tuple of float
        Relative error of the irradiance, both being 1 on the axis unless the exposure shows the light there too.
    tint : float
        How much more of one colour than of another is missing, as a share.
    """

    tier: Tier
    effects: Mapping[str, tuple[float, ...]]
    illumination: tuple[float, ...]
    tint: float = 0.0

    @cached_property
    def pixels(self) -> tuple[float, ...]:
        """The largest of the effects at each of `FIELDS` [pixels]."""
        return tuple(max(each) for each in zip(*self.effects.values(), strict=True))

    @property
    def worst_px(self) -> float:
        """The largest error of place [pixels]."""
        return max(self.pixels)

    @property
    def worst_illumination(self) -> float:
        """The largest error of brightness."""
        return max(*self.illumination, self.tint)


def tier_errors(truth: Truth, depths_mm: Sequence[float], tiers: Sequence[Tier]) -> list[TierError]:
    """Return the errors of tiers against the traced lens.

    Parameters
    ----------
    truth
        What the traced lens does.
    depths_mm
        Distances of what the picture shows ahead of the film, along the axis [mm].
    tiers
        Which ones; the traced lens itself has no error.
    """
    return [_errors(truth, depths_mm, tier) for tier in tiers]


def _errors(truth: Truth, depths_mm: Sequence[float], tier: Tier) -> TierError:
    none = (0.0,) * len(truth.fields)
    if tier == "realistic":
        return TierError(tier, dict.fromkeys(EFFECTS, none), none)
    if tier == "fitted":
        return fitted_errors(fitted_to(truth.scene, colours=truth.coloured))
    traits = TRAITS[tier]
    bundles = [tier_bundle(truth.first, tier, field * truth.half_mm) for field in FIELDS]
    apart = [_apart(*pair, depths_mm) for pair in zip(truth.fields, bundles, strict=True)]
    distortion, blur, outline = (tuple(column) for column in zip(*apart, strict=True))
    effects = {"distortion": distortion, "blur": blur, "outline": outline, "shape": none, "colour": none}
    if truth.round_stop.apart and not (traits.shapes or tier == "pinhole"):
        effects["shape"] = tuple(truth.round_stop.apart * radius for radius in truth.blur_px(depths_mm))
    if not traits.colours:
        effects["colour"] = truth.colour_px(depths_mm)
    lit = [bundle.light / bundles[0].light for bundle in bundles]
    return TierError(tier, effects, _illumination(truth, lit, truth.axial(tier)), 0.0 if traits.colours else truth.tint)


def fitted_errors(found: RayMap) -> TierError:
    """Return the errors of polynomials in place of a lens: one bound for the whole film."""
    none = (0.0,) * len(FIELDS)
    effects = dict.fromkeys(EFFECTS, none) | {"distortion": (found.error_px,) * len(FIELDS)}
    return TierError("fitted", effects, (found.light_error,) * len(FIELDS))


def _apart(field: FieldPoint | None, other: RayBundle, depths_mm: Sequence[float]) -> tuple[float, float, float]:
    """Return by how much middle, spread and outline of a bundle differ from those of the lens, at most [pixels]."""
    if field is None:
        return np.inf, np.inf, np.inf
    found = []
    for depth in depths_mm:
        true, own = (bundle.spot(depth, field.along) for bundle in (field.bundle, other))
        differences = (own.middle - true.middle, own.spread - true.spread, own.outline - true.outline)
        shift, spread, outline = (np.abs(each) for each in differences)
        per_mm = field.pixels_per_mm(depth)
        found.append([float(np.hypot(*shift)) * per_mm, spread.max() * per_mm, outline.max() * per_mm])
    distortion, blur, outlines = np.max(found, axis=0).tolist()
    return distortion, blur, outlines


def _illumination(truth: Truth, lit: Sequence[float], axial: float) -> tuple[float, ...]:
    """Return the relative errors of brightness of a tier whose film is lit so, 1 on the axis.

    Parameters
    ----------
    axial
        Brightness of the centre of the film over that of the traced lens, as the exposure shows it.
    """
    centre = truth.fields[0]
    if centre is None:
        return (np.inf,) * len(lit)
    found = []
    for field, own in zip(truth.fields, lit, strict=True):
        true = np.zeros(1) if field is None else field.light / centre.light
        found.append(float(np.abs(axial * own / true - 1).max()) if np.all(true > 0) else np.inf)
    return tuple(found)
