"""One session for all device tests."""

import pytest

from rptcam_cl.device.session import Session
from tests.device.probes import open_session


@pytest.fixture(scope="session")
def session() -> Session:
    return open_session()
