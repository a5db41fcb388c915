"""One device for all pictures, so that programs are built once."""

import pytest

from tests.device.probes import open_session


@pytest.fixture(scope="session")
def session():
    """The device."""
    return open_session()
