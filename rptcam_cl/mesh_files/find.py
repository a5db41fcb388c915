"""How a reader finds the further files that a mesh file names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

# Returns the checked path of a file given relative to the mesh file.
Find = Callable[[Path], Path]
