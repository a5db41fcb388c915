"""Mitsuba 3, for tests that render with both."""

import os
import sys
from collections.abc import Iterator

import pytest

from benchmarks.worker import Worker, WorkerError

VARIABLE = "RPTCAM_MITSUBA_PYTHON"


@pytest.fixture(scope="session")
def mitsuba() -> Iterator[Worker]:
    """The worker that renders with Mitsuba; where one is named it has to start."""
    named = os.environ.get(VARIABLE)
    try:
        worker = Worker(named or sys.executable, "benchmarks.mitsuba_worker")
    except WorkerError as error:
        if named:
            raise
        pytest.skip(f"no Mitsuba to compare with ({error}); {VARIABLE} names a Python that has it")
    yield worker
    worker.close()
