"""The sensor after the render: light on the film becomes electrons, numbers, and a picture again. Pure functions."""

from rptcam_cl.sensor.demosaic import demosaiced
from rptcam_cl.sensor.exposure import Frame, exposed
from rptcam_cl.sensor.gain import system_gain, white_electrons_at_iso
from rptcam_cl.sensor.linear import camera_from_xyz, linear_picture
from rptcam_cl.sensor.model import Sensor
from rptcam_cl.sensor.mosaic import CHANNELS, check_size, mosaic
from rptcam_cl.sensor.response import RESPONSES, electrons_per_joule, response_curves

__all__ = [
    "CHANNELS",
    "RESPONSES",
    "Frame",
    "Sensor",
    "camera_from_xyz",
    "check_size",
    "demosaiced",
    "electrons_per_joule",
    "exposed",
    "linear_picture",
    "mosaic",
    "response_curves",
    "system_gain",
    "white_electrons_at_iso",
]
