"""OpenCL devices, programs and buffers: the only package that imports pyopencl, and it knows no scene and no lens."""

from rptcam_cl.device.choose import DeviceInfo, choose_device, list_devices
from rptcam_cl.device.program import Program
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.device.several import Split, Wanted, means_all, open_sessions

__all__ = [
    "DeviceInfo", "Program", "Session", "Split", "Wanted", "choose_device", "list_devices", "means_all",
    "open_session", "open_sessions",
]  # fmt: skip
