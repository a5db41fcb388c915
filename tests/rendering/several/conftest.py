"""A machine with several devices."""

from collections.abc import Iterator

import pytest

from rptcam_cl.device import devices
from rptcam_cl.device import session as sessions
from rptcam_cl.device.devices import DeviceInfo
from rptcam_cl.device.session import Session
from tests.rendering.several.devices import Fragile, processor_and_cores


@pytest.fixture(scope="session")
def infos() -> list[DeviceInfo]:
    """The processor as 0:0, and one core each as 0:1 and 0:2."""
    return processor_and_cores()


@pytest.fixture(scope="session")
def whole(infos: list[DeviceInfo]) -> Session:
    return Session(infos[0])


@pytest.fixture(scope="session")
def _cores(infos: list[DeviceInfo]) -> list[Fragile]:
    return [Fragile(info) for info in infos[1:]]


@pytest.fixture
def first(_cores: list[Fragile]) -> Iterator[Fragile]:
    """One core, which a test may let fail."""
    yield _cores[0]
    _cores[0].healthy_launches = None


@pytest.fixture
def second(_cores: list[Fragile]) -> Iterator[Fragile]:
    """The other core, likewise."""
    yield _cores[1]
    _cores[1].healthy_launches = None


@pytest.fixture
def three(
    infos: list[DeviceInfo], whole: Session, first: Fragile, second: Fragile, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A machine with these three devices, for whoever names them."""
    opened = {session.info.id: session for session in (whole, first, second)}
    monkeypatch.setattr(devices, "list_devices", lambda: infos)
    monkeypatch.setattr(sessions, "_session", opened.__getitem__)
    monkeypatch.delenv("RPTCAM_DEVICE", raising=False)
