"""A process that is forked from one that has used OpenCL says so; its drivers would have it wait for ever."""

import os
import sys

import pytest

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.devices import list_devices
from tests.device.probes import open_session


@pytest.mark.skipif(sys.platform == "win32", reason="processes are not forked there")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Python's own, of threads
def test_a_forked_process_says_that_its_drivers_did_not_come_with_it():
    session = open_session()
    child = os.fork()
    if child == 0:
        said = 0
        for use in (open_session, list_devices, session.finish):
            try:
                use()
            except DeviceError as error:
                said += "was forked from one that had used OpenCL" in str(error)
        os._exit(said)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3
    session.finish()
