"""Glass of the scene's solids: the names and laws of lens files."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import PlainSerializer, PlainValidator, ValidationInfo, WithJsonSchema

from rptcam_cl.errors import InputError, StateError
from rptcam_cl.optics.files.fields import FieldError
from rptcam_cl.optics.files.glasses import read_glass
from rptcam_cl.optics.files.keys import GLASS
from rptcam_cl.optics.files.schema import glass_json_schema
from rptcam_cl.optics.glass import WAVELENGTH_D, Law, held_index, known_range
from rptcam_cl.references import Folders, References
from rptcam_cl.scene.refusal import refuse
from rptcam_cl.spectra import WAVELENGTHS_NM
from rptcam_cl.strict_yaml import Document

SMALLEST_INDEX, LARGEST_INDEX = 0.2, 5.0

KEYS = {name: key for name, key in GLASS.items() if name != "transmittance"}


def _read(value: Any, info: ValidationInfo) -> Law:
    """Return the law of a glass that is a name or a mapping."""
    if isinstance(value, Law):
        return value
    if not isinstance(value, (str, dict)):
        raise refuse("must be a glass", allowed="a name such as N-BK7, or a mapping such as {nd: 1.5168, vd: 64.17}")
    if isinstance(value, dict) and "transmittance" in value:
        raise refuse("is not read here", allowed="absorption_per_m or attenuation of the material",
                     path=("transmittance",))  # fmt: skip
    folders = info.context["folders"] if info.context else Folders()
    document = Document({"glass": value}, "glass", {}, {}, References(folders))
    try:
        medium = read_glass(document, ("glass",))
    except FieldError as problem:
        raise refuse(problem.text, path=problem.path[1:]) from None
    except (InputError, StateError) as problem:
        raise refuse(str(problem)) from None
    assert isinstance(medium, Law)
    _check(medium)
    return medium


def _check(medium: Law) -> None:
    limits = known_range(medium)
    if limits is not None and not limits[0] <= WAVELENGTH_D <= limits[1]:
        raise refuse(f"is known from {limits[0]:g} to {limits[1]:g} nm only", allowed="a glass known at 587.56 nm")
    try:
        with np.errstate(divide="ignore"):  # at a resonance
            index = held_index(medium, WAVELENGTHS_NM)
    except InputError as problem:
        raise refuse(str(problem)) from None
    if not np.all((index >= SMALLEST_INDEX) & (index <= LARGEST_INDEX)):
        span = f"{SMALLEST_INDEX:g} to {LARGEST_INDEX:g} at every wavelength from 380 to 780 nm"
        raise refuse(f"has a refractive index from {index.min():.4g} to {index.max():.4g}", allowed=span)


def nearest_to_one(medium: Law) -> float:
    """Return the refractive index from 380 to 780 nm that is nearest to 1."""
    index = held_index(medium, WAVELENGTHS_NM)
    return float(index[np.abs(index - 1).argmin()])


Glass = Annotated[
    Law,
    PlainValidator(_read),
    PlainSerializer(repr, when_used="json"),
    WithJsonSchema(glass_json_schema(KEYS)),
]
