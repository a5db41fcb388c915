"""What every test may ask for."""

import compileall
import contextlib
import gc
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest
from _pytest.assertion import rewrite
from hypothesis import settings

# For NumPy, which is imported after this: beside other processes, the threads of its linear algebra burn ten times the
# work in waiting for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Compiling takes half of the time of a short command, so that what is compiled of Python is kept whatever the
# environment says.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# The same examples on every run: a machine's fast tests pass or fail by the code alone.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

# Thousands of tests are objects that stay: to look through them again and again takes a third of their collection.
gc.disable()


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile a share of the modules, in each worker another: in a new checkout, all of them would compile all."""
    config = session.config
    if (worker := getattr(config, "workerinput", None)) is None:
        return
    root, first = Path(__file__).resolve().parents[1], int(worker["workerid"].removeprefix("gw"))
    modules = sorted(path for folder in ("tests", "rptcam_cl") for path in (root / folder).rglob("*.py"))
    for path in modules[first :: worker["workercount"]]:
        if not path.name.startswith("test_"):
            compileall.compile_file(path, quiet=2)
            continue
        with contextlib.suppress(AttributeError, TypeError):  # private names of pytest, which another may not have
            kept = rewrite.get_cache_dir(path) / f"{path.stem}{rewrite.PYC_TAIL}"
            if rewrite._read_pyc(path, kept) is None and rewrite.try_makedirs(kept.parent):
                source, code = rewrite._rewrite_test(path, config)
                rewrite._write_pyc(config.stash[rewrite.assertstate_key], code, source, kept)


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def checkout() -> Path:
    """Root folder of the checkout that the tests lie in."""
    return Path(__file__).resolve().parents[1]


# What kernels of a module's fast tests may know of, whether a scene has it or not, so that scenes which differ in it
# take one program: they do for both to the bit (`serve` of `rendering/plan/plan.py`). It takes a third to a half longer
# to compile, so that it pays where there are many such scenes. Not among them is what has code of its own where it is
# not.
_SHAPES = ("SPHERE", "ELLIPSOID", "RECTANGLE", "PLANE", "DISK", "BOX", "CYLINDER", "CONE", "AFFINE")
_MATERIALS = ("MATTE", "MIRROR", "DIELECTRIC", "TEXTURE", "CHECKER", "GRID", "GRADIENT")
_LAMPS = ("SIZELESS", "POINTS", "DIRECTIONS", "FLATS", "DISKS", "SPHERES")
PLAIN_KINDS = [f"HAS_{each}" for each in (*_SHAPES, *_MATERIALS)] + [f"EMITTER_{each}" for each in _LAMPS]


def known_of(files: list[str], facts: Mapping[str, int | str], more: Iterable[str]) -> Mapping[str, int | str]:
    """Return the facts of kernels that know of ``more``, of emitters if there are any; not those of probes."""
    if "HAS_MATTE" not in facts or Path(files[0]).is_absolute():
        return facts
    return {**facts, **{each: 1 for each in more if facts["HAS_EMITTERS"] or not each.startswith("EMITTER")}}


@pytest.fixture(scope="session", autouse=True)
def kernels_that_compile_soonest() -> Iterator[list[tuple[type, str, Any]]]:
    """All sessions have the kernels that compile soonest, as first pictures of a process do; their bits are the same.

    Compiling takes most of the time of the tests, so that no process apart compiles full ones meanwhile. Full kernels
    are compared in `rendering/test_quick_kernels.py`. What stood in the place of what is changed is returned.
    """
    from rptcam_cl.device.devices import CompileServer
    from rptcam_cl.device.session import Session

    opened = Session.__init__

    def open_quick(self: Session, *words: Any, **options: Any) -> None:
        opened(self, *words, **options)
        self.is_quick = self.generates_late

    with pytest.MonkeyPatch.context() as patch:
        before = [(Session, "__init__", opened), (CompileServer, "compile", CompileServer.compile)]
        patch.setattr(Session, "__init__", open_quick)
        patch.setattr(CompileServer, "compile", lambda self, order: not self.is_closed)
        yield before


@pytest.fixture(scope="module", autouse=True)
def kernels_that_know_of_more(request: pytest.FixtureRequest) -> Iterator[tuple[type, str, Any]]:
    """Kernels of the fast tests of a module know of what it names as ``KERNELS_KNOW_OF``; slow ones have their own.

    They are compared with those that know of no more than a scene has in `rendering/test_serving.py`. What stood in the
    place of what is changed is returned.
    """
    from rptcam_cl.device.session import Session

    take, more = Session.program, getattr(request.module, "KERNELS_KNOW_OF", ())

    def program(self: Session, files: list[str], facts: Mapping[str, int | str], declarations: str) -> Any:
        return take(self, files, known_of(files, facts, more), declarations)

    with pytest.MonkeyPatch.context() as patch:
        if more and request.config.getoption("markexpr") == "not slow":
            patch.setattr(Session, "program", program)
        yield Session, "program", take


@pytest.fixture
def own_kernels(kernels_that_know_of_more: tuple[type, str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels know of what their scene has, and of no more, as without the tests."""
    monkeypatch.setattr(*kernels_that_know_of_more)


@pytest.fixture
def full_kernels(
    kernels_that_compile_soonest: list[tuple[type, str, Any]], own_kernels: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sessions, opened anew, choose their kernels, and processes apart compile them, as without the tests."""
    from rptcam_cl.device import session

    for place in kernels_that_compile_soonest:
        monkeypatch.setattr(*place)
    monkeypatch.setattr(session, "_session", lru_cache(session._session.__wrapped__))  # those opened before are quick


@pytest.fixture(scope="session")
def session():
    """The session of all tests that need one, so that a program is built once."""
    from tests.device.probes import open_session

    return open_session()
