"""Kinds of surface with numbers of their own, beside the profile: what a lens file, a trace and a device need of one.

To add one, write a class like `Biconic` and enter it in `FORMS`; CONTRIBUTING walks through it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from rptcam_cl.optics.files.fields import Fields
from rptcam_cl.optics.files.key import Key
from rptcam_cl.optics.shapes.iterated import Iterated


class Form(Iterated):
    """A kind of surface that has numbers of its own; its subclasses are frozen dataclasses of them.

    `sag_and_slopes` here is that of the profile, to which a subclass adds or which it replaces.

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


def short_radius(curvature: float) -> float:
    """Return the radius with the fewest digits whose inverse is exactly the curvature, else the nearest radius."""
    exact = 1.0 / curvature
    for digits in range(3, 18):
        radius = float(f"{exact:.{digits}g}")
        if 1.0 / radius == curvature:
            return radius
    return exact
