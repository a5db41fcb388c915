"""What every test may ask for."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def checkout() -> Path:
    """Root folder of the checkout that the tests lie in."""
    return Path(__file__).resolve().parents[1]
