"""Metals: rough conductors, by a colour or by the optical constants of what they are made of."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, GetCoreSchemaHandler, Tag, model_validator
from pydantic_core import CoreSchema, core_schema

from rptcam_cl.colour import Spectrum, on_grid
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.references import Folders
from rptcam_cl.scene.base import Alternatives, SceneModel, refuse
from rptcam_cl.scene.file_reference import FileName
from rptcam_cl.scene.material_parts import BumpyMaterial, RoughMaterial
from rptcam_cl.scene.quantities import NUMBER, list_of
from rptcam_cl.scene.spectrum import fault_of, read_rows
from rptcam_cl.scene.spectrum_forms import Numbers
from rptcam_cl.scene.texture import Reflectance

Metal = Literal["aluminium", "chromium", "copper", "gold", "iron", "nickel", "platinum", "silver", "tungsten"]

WRITTEN_OUT, MEASURED = "written out", "a table"  # forms of a metal that is no name; not keys
SMALLEST_CONSTANT, LARGEST_CONSTANT = 1e-3, 100.0

Constant = Annotated[float, Field(ge=SMALLEST_CONSTANT, le=LARGEST_CONSTANT), NUMBER]
_PER_CHANNEL = BeforeValidator(list_of(3, "one number each for red, green and blue"))


class OpticalConstants(SceneModel):
    """The refractive index n + i k of a metal in three channels."""

    n: Annotated[tuple[Constant, Constant, Constant], _PER_CHANNEL]
    """Real part [red, green, blue]."""

    k: Annotated[tuple[Constant, Constant, Constant], _PER_CHANNEL]
    """Imaginary part [red, green, blue]."""


class MetalTable(SceneModel):
    """The refractive index n + i k of a metal as a table, with straight lines between its rows."""

    wavelengths_nm: Numbers | None = None
    """Wavelengths of the rows [nm], rising; beside `n` and `k`."""

    n: Numbers | None = None
    """Real part in each row."""

    k: Numbers | None = None
    """Imaginary part in each row."""

    file: FileName | None = None
    """Table in the scene's folder: a wavelength [nm], n and k a line."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (Alternatives(("wavelengths_nm", "file"), required=True),)


@dataclass(frozen=True, eq=False)
class MetalSpectrum:
    """The refractive index n + i k of a metal at `rptcam_cl.colour.WAVELENGTHS_NM`."""

    n: Spectrum
    k: Spectrum

    def described(self) -> dict[str, list[float]]:
        """Return it as plain data."""
        return {name: [float(f"{x:.9g}") for x in getattr(self, name)] for name in ("n", "k")}


class _MetalForm:
    """Reads a metal from its table."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return what checks the table."""
        return core_schema.with_info_after_validator_function(
            _metal_spectrum,
            handler.generate_schema(MetalTable),
            serialization=core_schema.plain_serializer_function_ser_schema(MetalSpectrum.described, when_used="json"),
        )


def _metal_spectrum(table: MetalTable, info: core_schema.ValidationInfo) -> MetalSpectrum:
    if table.file is not None:
        for name in ("n", "k"):
            if getattr(table, name) is not None:
                raise refuse("cannot be given together with file", allowed="wavelengths_nm, or no file", path=(name,))
        folders = info.context["folders"] if info.context else Folders()
        try:
            wavelengths, (n, k) = read_rows(table.file, folders, ("n", "k"))
        except InputError as problem:
            raise refuse(str(problem), path=("file",)) from None
    else:
        wavelengths, n, k = _written_rows(table)
    for name, column in (("n", n), ("k", k)):
        if np.any((column < SMALLEST_CONSTANT) | (column > LARGEST_CONSTANT)):
            span = f"{SMALLEST_CONSTANT:g} to {LARGEST_CONSTANT:g}"
            path = ("file",) if table.file is not None else (name,)
            raise refuse(f"{name} is out of range", got=column.tolist(), allowed=span, path=path)
    return MetalSpectrum(on_grid(wavelengths, n), on_grid(wavelengths, k))


def _written_rows(table: MetalTable) -> tuple[Spectrum, Spectrum, Spectrum]:
    """Return wavelengths, n and k of a table in the scene itself."""
    wavelengths = np.array(table.wavelengths_nm)
    for name in ("n", "k"):
        column = getattr(table, name)
        if column is None or len(column) != len(wavelengths):
            raise refuse("does not fit wavelengths_nm", allowed=f"{len(wavelengths)} numbers", path=(name,))
    fault = fault_of(wavelengths)
    if fault is not None:
        index, problem = fault
        raise refuse(problem, allowed="rising wavelengths in nm", path=("wavelengths_nm", index))
    return wavelengths, np.array(table.n), np.array(table.k)


def _form(value: Any) -> str:
    if isinstance(value, dict):
        return MEASURED if "wavelengths_nm" in value or "file" in value else WRITTEN_OUT
    if isinstance(value, (MetalSpectrum, MetalTable)):
        return MEASURED
    return WRITTEN_OUT if isinstance(value, OpticalConstants) else "name"


class Conductor(RoughMaterial, BumpyMaterial):
    """A rough metal: GGX microfacets that reflect `reflectance` at every angle, or as the `metal` does."""

    kind: Literal["conductor"]
    """Kind of material."""

    reflectance: Reflectance | None = None
    """Share of light that a microfacet reflects: a colour of channels 0 to 1, or a texture."""

    metal: (
        Annotated[
            Annotated[Metal, Tag("name")]
            | Annotated[OpticalConstants, Tag(WRITTEN_OUT)]
            | Annotated[MetalSpectrum, _MetalForm(), Tag(MEASURED)],
            Discriminator(_form),
        ]
        | None
    ) = None
    """What it is made of: a name, or its optical constants, in three channels or as a table."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives(("reflectance", "metal"), required=True),
        Alternatives(("alpha", "roughness"), required=True),
    )

    @model_validator(mode="after")
    def _check_rough(self) -> Self:
        if self.alphas is None:
            raise refuse(
                "must be more than 0", allowed="above 0 to 1; for a smooth surface take a mirror", path=("roughness",)
            )
        return self
