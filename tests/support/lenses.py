"""Lenses of the library that stand for all of them; what takes long is tried on the others by slow tests."""

from collections.abc import Iterable

import pytest
from _pytest.mark import ParameterSet

from rptcam_cl.optics.library import list_lenses

# An achromat; cylinders; a diverging singlet; an open and a wide one; a gradient index; mirrors; aspheres; a zoom.
CHOSEN = {
    "achromat-100mm", "anamorphic-100mm", "biconcave", "dgauss-50mm", "fisheye-10mm", "human-eye", "mirror-500mm",
    "phone-5.6mm", "zoom-70-200mm",
}  # fmt: skip


def each_lens(names: Iterable[str] | None = None) -> list[ParameterSet]:
    """Return parameters of tests: the names of lenses, all of the library if none are given, most of them slow."""
    every = list_lenses() if names is None else names
    return [pytest.param(name, marks=() if name in CHOSEN else pytest.mark.slow) for name in every]
