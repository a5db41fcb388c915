"""Cases of tests: a few that guard a feature in the fast suite, and all others in the slow one."""

from collections.abc import Container, Iterable
from typing import Any

import pytest
from _pytest.mark import ParameterSet


def slow(*values: Any) -> ParameterSet:
    """Return a case of the slow suite."""
    return pytest.param(*values, marks=pytest.mark.slow)


def one_in(count: int, every: Iterable[Any]) -> list[Any]:
    """Return every case: one of so many for the fast suite as it is, and the others for the slow one."""
    cases = [case if isinstance(case, tuple) else (case,) for case in every]
    return [slow(*case) if number % count else pytest.param(*case) for number, case in enumerate(cases)]


def fast(chosen: Container[Any], every: Iterable[Any]) -> list[Any]:
    """Return every case: those that are chosen for the fast suite as they are, and the others for the slow one."""
    return [case if case in chosen else slow(*case if isinstance(case, tuple) else (case,)) for case in every]
