"""Checks that a mesh file is refused."""

import re
import tracemalloc
from pathlib import Path

import pytest

from rptcam_cl.core.errors import InputError

from .conftest import Read

# (id, name of the file, content, what the message must match after the file's name)
Row = tuple[str, str, str | bytes, str]


def check_refused(read: Read, folder: Path, name: str, content: str | bytes, message: str) -> None:
    """Check that a file is refused in one line, without room being made for what it only claims."""
    tracemalloc.start()
    with pytest.raises(InputError) as caught:
        read(name, content)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert re.match(f"{re.escape(str(folder / name))}({message})", str(caught.value)), str(caught.value)
    assert "\n" not in str(caught.value)
    assert peak < 50e6
