"""OpenCL devices, programs and buffers: the only package that imports pyopencl, and it knows no scene and no lens."""

from rptcam_cl.device.at_work import end_work
from rptcam_cl.device.choose import choose_device, default_device, fitting_devices
from rptcam_cl.device.devices import DeviceInfo, device_details, list_devices, opencl_version, problem_of, refuse
from rptcam_cl.device.early import open_early
from rptcam_cl.device.pocl_cache import pocl_cache_folder
from rptcam_cl.device.program import Program
from rptcam_cl.device.session import Launch, NotKeptError, Session, open_session
from rptcam_cl.device.several import Split, Wanted, means_all, means_one, open_sessions
from rptcam_cl.device.trial import driver_name

__all__ = [
    "DeviceInfo",
    "Launch",
    "NotKeptError",
    "Program",
    "Session",
    "Split",
    "Wanted",
    "choose_device",
    "default_device",
    "device_details",
    "driver_name",
    "end_work",
    "fitting_devices",
    "list_devices",
    "means_all",
    "means_one",
    "open_early",
    "open_session",
    "open_sessions",
    "opencl_version",
    "pocl_cache_folder",
    "problem_of",
    "refuse",
]
