"""What every test may ask for."""

from pathlib import Path

import pytest
from hypothesis import settings

# The same examples on every run: a machine's fast tests pass or fail by the code alone.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def checkout() -> Path:
    """Root folder of the checkout that the tests lie in."""
    return Path(__file__).resolve().parents[1]
