"""OpenCL devices, programs and buffers: the only package that imports pyopencl, and it knows no scene and no lens."""

from rptcam_cl.device.choose import DeviceInfo, choose_device, list_devices
from rptcam_cl.device.program import Program
from rptcam_cl.device.session import Session, open_session

__all__ = ["DeviceInfo", "Program", "Session", "choose_device", "list_devices", "open_session"]
