"""Errors of a frame begin with its number."""

from collections.abc import Iterator
from contextlib import contextmanager

from rptcam_cl.core.errors import RptcamError


@contextmanager
def numbered(index: int) -> Iterator[None]:
    """Within the block errors that are reported in one line begin with ``frame 517:``."""
    try:
        yield
    except RptcamError as problem:
        problem.args = (f"frame {index}: {problem}",)
        raise
