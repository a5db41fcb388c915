"""How far the pictures of cheaper camera models lie from that of the traced lens, found by rays in float64."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.accuracy.bundles import Bundle, first_order_bundle, traced_bundle
from rptcam_cl.accuracy.tiers import FirstOrderCamera, Tier
from rptcam_cl.optics.irradiance import film_irradiance
from rptcam_cl.scene.film import Film

Array = NDArray[np.float64]

FIELDS = (0.0, 0.25, 0.5, 0.7, 0.85, 1.0)  # film points along its half diagonal
NUDGE = 1e-3  # of the half diagonal, between film points that tell the scale of the picture


@dataclass(frozen=True)
class TierError:
    """What a tier does wrong at each of `FIELDS`.

    Attributes
    ----------
    tier : str
    pixels : tuple of float
        How far light of an object falls from its place: the larger of the shift of the middle of a bundle and of the
        change of its radius (root mean square), at the worst of the depths [pixels]. Infinite where the lens sees
        nothing.
    illumination : tuple of float
        Relative error of the irradiance, both being 1 on the axis.
    """

    tier: Tier
    pixels: tuple[float, ...]
    illumination: tuple[float, ...]

    @property
    def worst_px(self) -> float:
        """The largest error of place [pixels]."""
        return max(self.pixels)

    @property
    def worst_illumination(self) -> float:
        """The largest error of brightness."""
        return max(self.illumination)


def tier_errors(
    first: FirstOrderCamera, film: Film, depths_mm: Sequence[float], tiers: Sequence[Tier]
) -> list[TierError]:
    """Return the errors of tiers against the traced lens.

    Parameters
    ----------
    first
        The lens in use.
    film
        Its size and resolution.
    depths_mm
        Distances of what the picture shows ahead of the film, along the axis [mm].
    tiers
        Which ones; the traced lens itself errs by nothing.
    """
    half = np.array(film.size_m()) / 2 * 1e3
    lens, film_mm = first.setting.lens, first.setting.film_distance_mm
    radii = float(np.hypot(*half)) * np.array(FIELDS)
    azimuth = float(np.rad2deg(np.arctan2(half[1], half[0])))
    light = film_irradiance(lens, film_mm, radii, first.setting.camera.wavelength_nm, azimuth)
    truth = [_FieldTruth.of(first, field * half, half, film) for field in FIELDS]
    found = []
    for tier in tiers:
        if tier == "realistic":
            found.append(TierError(tier, (0.0,) * len(FIELDS), (0.0,) * len(FIELDS)))
            continue
        on_axis = first_order_bundle(first, tier, np.zeros(2)).light
        bundles = [first_order_bundle(first, tier, field.point) for field in truth]
        pixels = tuple(_apart_px(field, bundle, depths_mm) for field, bundle in zip(truth, bundles, strict=True))
        shares = [bundle.light / on_axis for bundle in bundles]
        dimming = (light / light[0] if light[0] > 0 else 0 * light).tolist()
        illumination = tuple(
            abs(own / true - 1) if true > 0 else np.inf for own, true in zip(shares, dimming, strict=True)
        )
        found.append(TierError(tier, pixels, illumination))
    return found


@dataclass(frozen=True)
class _FieldTruth:
    """What the traced lens does at a film point: its bundle, one close by, and how many pixels lie between them."""

    point: Array
    bundle: Bundle | None
    beside: Bundle | None
    apart_px: float

    @classmethod
    def of(cls, first: FirstOrderCamera, point: Array, half: Array, film: Film) -> _FieldTruth:
        lens, film_mm = first.setting.lens, first.setting.film_distance_mm
        wavelength_nm = first.setting.camera.wavelength_nm
        near = point - NUDGE * half if point.any() else NUDGE * half
        here, beside = (traced_bundle(lens, film_mm, at, wavelength_nm) for at in (point, near))
        pixels_per_mm = film.resolution[0] / (2 * half[0])
        return cls(point, here, beside, float(np.hypot(*(near - point))) * pixels_per_mm)


def _apart_px(field: _FieldTruth, other: Bundle, depths_mm: Sequence[float]) -> float:
    """Return by how much another bundle falls beside that of the lens, at the worst of the depths [pixels]."""
    if field.bundle is None or field.beside is None:
        return np.inf
    worst = 0.0
    for depth in depths_mm:
        middle, radius = field.bundle.spot(depth)
        step = float(np.hypot(*(field.beside.spot(depth)[0] - middle)))
        place, other_radius = other.spot(depth)
        apart = max(float(np.hypot(*(place - middle))), abs(other_radius - radius))
        worst = max(worst, apart * field.apart_px / step if step > 0 else np.inf)
    return float(worst)
