"""A check of a device: what was measured, and what it may be at most."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """One line of the report.

    Attributes
    ----------
    name : str
        What was checked.
    measured, allowed : float
        The check is passed when the first is at most the second; what is not a number fails.
    unit : str
        Of both.
    note : str
        Anything else worth saying; for a check that could not be made, why.
    skipped : bool
        Whether it asks for what the device does not offer; it then neither passes nor fails.
    """

    name: str
    measured: float
    allowed: float
    unit: str
    note: str = ""
    skipped: bool = False

    @property
    def passed(self) -> bool:
        """Whether the device computes what it should."""
        return bool(self.measured <= self.allowed)

    @property
    def failed(self) -> bool:
        """Whether the check was made, and the device computes something else."""
        return not self.passed and not self.skipped


def needs_float64(name: str, unit: str) -> Check:
    """Return a check that was not made because the device has no float64."""
    return Check(name, math.nan, math.nan, unit, "the device has no float64", skipped=True)
