"""Kinds of surface with numbers of their own, beside the profile: what a lens file, a trace and a device need of one.

To add one, write a class like `Biconic` and enter it in `FORMS`; CONTRIBUTING walks through it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.optics.files.fields import Fields
from rptcam_cl.optics.files.key import Key
from rptcam_cl.optics.shapes.iterated import Iterated
from rptcam_cl.optics.shapes.shape import Profile

Array = NDArray[np.float64]


class Form(Iterated):
    """A kind of surface that has numbers of its own; its subclasses are frozen dataclasses of them.

    Attributes
    ----------
    description : str
        What completes the sentence "it is ...", for formats that cannot say it.
    keys : mapping
        Its keys in a lens file.
    needs : mapping
        Keys that another one of its keys needs beside it.
    facts : tuple of str
        Facts of the program, beyond LENS_GENERAL, that its code on a device is compiled under.
    """

    description: ClassVar[str]
    keys: ClassVar[Mapping[str, Key]]
    needs: ClassVar[Mapping[str, list[str]]] = {}
    facts: ClassVar[tuple[str, ...]] = ()

    @classmethod
    @abstractmethod
    def read(cls, fields: Fields, scale: float) -> Form | None:
        """Return what the keys of a surface say, None where they say nothing of this kind; lengths times `scale`.

        Raises
        ------
        FieldError
            For a value that cannot be used.
        """

    @abstractmethod
    def written(self) -> dict[str, Any]:
        """Return the keys of a lens file and their values [mm], which `read` takes back."""

    @abstractmethod
    def sag_and_slopes(self, profile: Profile, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """Return z, dz/dx and dz/dy above points of the vertex plane; NaN where the surface does not reach."""


def short_radius(curvature: float) -> float:
    """Return the radius with the fewest digits whose inverse is exactly the curvature, else the nearest radius."""
    exact = 1.0 / curvature
    for digits in range(3, 18):
        radius = float(f"{exact:.{digits}g}")
        if 1.0 / radius == curvature:
            return radius
    return exact
