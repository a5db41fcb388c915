"""Several devices where there is one processor: parts of it, by cores, which OpenCL calls sub-devices."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from rptcam_cl.device import DeviceInfo, Session, choose_device, several
from rptcam_cl.device import choose as choosing
from rptcam_cl.device import session as sessions
from rptcam_cl.device.session import Launch
from rptcam_cl.device.trial import try_device
from rptcam_cl.errors import DeviceError


class Fragile(Session):
    """A device that fails at a launch, and at everything after it.

    Attributes
    ----------
    healthy_launches : int or None
        How many more launches it survives; None: all.
    """

    def __init__(self, info: DeviceInfo) -> None:
        super().__init__(info)
        self.healthy_launches: int | None = None

    def bind(self, program: Any, name: str, *arguments: Any) -> Launch:
        launch = super().bind(program, name, *arguments)
        whole = launch.enqueue

        def enqueue(items: int, group: int) -> Any:
            if self.healthy_launches is not None:
                self.healthy_launches -= 1
            self.check()
            return whole(items, group)

        launch.enqueue = enqueue  # type: ignore[method-assign]
        return launch

    def finish(self) -> None:
        self.check()
        super().finish()

    def read(self, buffer: Any, dtype: Any, count: int) -> Any:
        self.check()
        return super().read(buffer, dtype, count)

    def check(self) -> None:
        if self.healthy_launches is not None and self.healthy_launches < 0:
            raise DeviceError(f"device {self.info.id} {self.info.name} stopped: made to fail")


@pytest.fixture(scope="session")
def infos() -> list[DeviceInfo]:
    """The processor as 0:0, and one core each as 0:1 and 0:2."""
    import pyopencl as cl

    whole = choose_device("cpu")
    assert try_device(whole.handle).problem is None
    parts = whole.handle.create_sub_devices([cl.device_partition_property.BY_COUNTS, 1, 1])
    alone = [replace(whole, id=f"0:{k}", handle=part, compute_units=1) for k, part in enumerate(parts, start=1)]
    return [replace(whole, id="0:0"), *alone]


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
    for module in (choosing, several):
        monkeypatch.setattr(module, "list_devices", lambda: infos)
    monkeypatch.setattr(sessions, "_session", opened.__getitem__)
    monkeypatch.delenv("RPTCAM_DEVICE", raising=False)
