"""A check of a device: what was measured, and what it may be at most."""

from __future__ import annotations

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
    """

    name: str
    measured: float
    allowed: float
    unit: str
    note: str = ""

    @property
    def passed(self) -> bool:
        """Whether the device computes what it should."""
        return self.measured <= self.allowed
