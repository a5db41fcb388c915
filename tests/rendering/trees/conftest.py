"""One session for all tests of trees."""

import pytest

from rptcam_cl.device.session import Session, open_session


@pytest.fixture(scope="session")
def session() -> Session:
    return open_session()
