"""Several devices where there is one processor: parts of it, by cores, which OpenCL calls sub-devices."""

from dataclasses import replace
from typing import Any

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.devices import DeviceInfo, choose_device, try_device
from rptcam_cl.device.session import Launch, Session


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

    def bind(self, program: Any, kernel: str, /, **arguments: Any) -> Launch:
        launch = super().bind(program, kernel, **arguments)
        whole = launch.enqueue

        def enqueue(*where: int) -> Any:
            if self.healthy_launches is not None:
                self.healthy_launches -= 1
            self.check()
            return whole(*where)

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


def processor_and_cores() -> list[DeviceInfo]:
    """The processor as 0:0, and one core each as 0:1 and 0:2."""
    import pyopencl as cl

    whole = choose_device("cpu")
    assert try_device(whole.handle).problem is None
    parts = whole.handle.create_sub_devices([cl.device_partition_property.BY_COUNTS, 1, 1])
    alone = [replace(whole, id=f"0:{k}", handle=part, compute_units=1) for k, part in enumerate(parts, start=1)]
    return [replace(whole, id="0:0"), *alone]
