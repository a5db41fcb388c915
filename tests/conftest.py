"""What every test may ask for."""

import gc
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# For NumPy, which is imported after this: beside other processes, the threads of its linear algebra burn ten times the
# work in waiting for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The same examples on every run: a machine's fast tests pass or fail by the code alone.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

# Thousands of tests are objects that stay: to look through them again and again takes a third of their collection.
gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def checkout() -> Path:
    """Root folder of the checkout that the tests lie in."""
    return Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session", autouse=True)
def kernels_that_compile_soonest() -> Iterator[Any]:
    """All sessions have the kernels that compile soonest, as first pictures of a process do; their bits are the same.

    Compiling takes most of the time of the tests. Full kernels are compared in `rendering/test_quick_kernels.py`.
    """
    from rptcam_cl.device.session import Session

    opened = Session.__init__

    def open_quick(self: Session, *words: Any, **options: Any) -> None:
        opened(self, *words, **options)
        self.is_quick = self.generates_late

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Session, "__init__", open_quick)
        yield opened


@pytest.fixture
def full_kernels(kernels_that_compile_soonest: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sessions choose their kernels as without the tests."""
    from rptcam_cl.device.session import Session

    monkeypatch.setattr(Session, "__init__", kernels_that_compile_soonest)


@pytest.fixture(scope="session", autouse=True)
def processes_that_compile_modules_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Processes that tests start keep what they have compiled of Python, also where the environment forbids it.

    Compiling takes half of the time of a short command.
    """
    with pytest.MonkeyPatch.context() as patch:
        if os.environ.get("PYTHONDONTWRITEBYTECODE"):
            patch.delenv("PYTHONDONTWRITEBYTECODE")
            own = tmp_path_factory.getbasetemp()
            place = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own  # the workers have one
            patch.setenv("PYTHONPYCACHEPREFIX", str(place / "bytecode"))
        yield


@pytest.fixture(scope="session")
def session():
    """The session of all tests that need one, so that a program is built once."""
    from tests.device.probes import open_session

    return open_session()
