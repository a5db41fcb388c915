"""Which of several zones decides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum

from rptcam_cl.autofocus.probe import Zone


class Policy(StrEnum):
    """Which zone the focus is set to, of those in which there is something to focus on."""

    CLOSEST = "closest"
    FARTHEST = "farthest"
    CENTRE = "centre"
    WEIGHTED = "weighted"

    @property
    def by_place(self) -> bool:
        """Whether it depends on where the zones have their focus."""
        return self in (Policy.CLOSEST, Policy.FARTHEST, Policy.WEIGHTED)


def chosen(policy: Policy, zones: Sequence[Zone], places: Mapping[int, float]) -> int:
    """Return the zone that decides.

    Parameters
    ----------
    zones
        All of them.
    places
        Where some of them have their focus, rising towards nearer objects.
    """
    match policy:
        case Policy.CLOSEST:
            return max(places, key=lambda zone: places[zone])
        case Policy.FARTHEST:
            return min(places, key=lambda zone: places[zone])
        case Policy.CENTRE:
            return min(places, key=lambda zone: _off_centre(zones[zone]))
        case Policy.WEIGHTED:
            return _weighted_median(zones, places)


def _off_centre(zone: Zone) -> float:
    x, y = zone.centre
    return (x - 0.5) ** 2 + (y - 0.5) ** 2


def _weighted_median(zones: Sequence[Zone], places: Mapping[int, float]) -> int:
    """Return the zone below and above whose focus lie equal weights: area, less towards the corners of the picture."""
    weight = {k: (zones[k].right - zones[k].left) * (zones[k].bottom - zones[k].top) / (1 + 8 * _off_centre(zones[k]))
              for k in places}  # fmt: skip
    half, passed = sum(weight.values()) / 2, 0.0
    ranked = sorted(places, key=lambda zone: places[zone])
    for zone in ranked:
        passed += weight[zone]
        if passed >= half:
            return zone
    return ranked[-1]
