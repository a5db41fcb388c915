"""Lenses of the library that stand for all of them; what takes long is tried on the others by slow tests."""

from collections.abc import Iterable

import pytest
from _pytest.mark import ParameterSet

from rptcam_cl.optics.library import list_lenses

# Singlets, one of them diverging; aspheres; cylinders; mirrors; an open, a wide, a long and a tiny one; a zoom.
CHOSEN = {
    "achromat-100mm", "anamorphic-100mm", "asphere-1.4mm", "ball", "biconcave", "dgauss-50mm", "double-gauss-50mm-f1.1",
    "fisheye-10mm", "human-eye", "mirror-500mm", "phone-5.6mm", "telephoto-250mm", "zoom-70-200mm",
}  # fmt: skip


def each_lens(names: Iterable[str] | None = None) -> list[ParameterSet]:
    """Return parameters of tests: the names of lenses, all of the library if none are given, most of them slow."""
    every = list_lenses() if names is None else names
    return [pytest.param(name, marks=() if name in CHOSEN else pytest.mark.slow) for name in every]
