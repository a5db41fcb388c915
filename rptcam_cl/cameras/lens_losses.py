"""Light that surfaces and glass take: from the settings of the scene to the numbers of the device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import LOSS_TABLE_LENGTH, LOSS_TABLE_NM
from rptcam_cl.optics import (
    BARE,
    WORDS,
    Coating,
    Interface,
    Layer,
    LayerStack,
    Lens,
    LensTransmission,
    Medium,
    QuarterWave,
    attenuation,
    constant_reflectance,
    has_coatings,
    known_nm,
    layered,
    with_coating,
)
from rptcam_cl.scene import CoatingLayers, LensCamera


def transmission_of(camera: LensCamera) -> LensTransmission:
    """Return the losses that count."""
    requested = camera.transmission
    return LensTransmission(
        fresnel=requested.fresnel,
        coatings=requested.fresnel and requested.coatings is not False,
        absorption=requested.absorption,
    )


def as_coated(lens: Lens, camera: LensCamera) -> Lens:
    """Return the lens with the coating that the camera puts on it, if any.

    Raises
    ------
    InputError
        When coatings must count and the lens does not say how it is coated, or when losses that count are not known at
        the camera's wavelength.
    """
    lens = _coated(lens, camera)
    low, high = known_nm(lens, transmission_of(camera))
    if not low <= camera.wavelength_nm <= high:
        raise InputError(
            f"camera.transmission: what {lens.name} absorbs or reflects is known from {low:g} to {high:g} nm"
            f" (camera.wavelength_nm is {camera.wavelength_nm:g})"
        )
    return lens


def _coated(lens: Lens, camera: LensCamera) -> Lens:
    coating = camera.transmission.coating
    if coating is not None:
        return with_coating(lens, _named(coating))
    if camera.transmission.coatings and not has_coatings(lens):
        raise InputError(
            f"camera.transmission: {lens.name} does not say how it is coated"
            " (allowed: ideal, bare, or a coating for it such as {coating: mgf2})"
        )
    return lens


def _named(coating: str | float | CoatingLayers) -> Coating:
    if isinstance(coating, CoatingLayers):
        return layered(tuple(Layer(layer.index, layer.thickness_nm, layer.extinction) for layer in coating.layers))
    return WORDS[coating] if isinstance(coating, str) else constant_reflectance(coating)


Array = NDArray[np.float64]
Values = Callable[[Array], Array]  # of wavelengths [nm]

TABLE_NM = LOSS_TABLE_NM + np.arange(float(LOSS_TABLE_LENGTH))  # catalogues measure at whole nanometres
FACTS = ("LENS_FRESNEL", "LENS_LAYERS", "LENS_STACKS", "LENS_DARK_LAYERS", "LENS_ABSORPTION", "LENS_TINTED")
NO_LOSSES = dict.fromkeys(FACTS, 0)


@dataclass
class LossTables:
    """Tables over the wavelength, each of which is there once.

    Attributes
    ----------
    start : int
        Where the first one will stand.
    range_nm : (low, high)
        Wavelengths that the lens is known for [nm]; beyond them the last value stays.
    """

    start: int
    range_nm: tuple[float, float]
    rows: list[Array] = field(default_factory=list)

    def place(self, values: Values) -> int:
        """Return where the table of a function of wavelengths [nm] stands, -1 when it is the same everywhere."""
        row = np.asarray(values(np.clip(TABLE_NM, *self.range_nm)))
        if np.ptp(row) == 0:
            return -1
        known = [k for k, other in enumerate(self.rows) if np.array_equal(row, other)]
        if not known:
            self.rows.append(row)
        return self.start + (known[0] if known else len(self.rows) - 1) * LOSS_TABLE_LENGTH


@dataclass(frozen=True)
class LossFiller:
    """Fills records of surfaces.

    Attributes
    ----------
    transmission : LensTransmission
    wavelength_nm : float
        Of all rays; where there are tables, of those values that do not depend on it.
    tables : LossTables or None
        None when all rays have one wavelength.
    """

    transmission: LensTransmission
    wavelength_nm: float
    tables: LossTables | None

    def fill(self, records: NDArray[np.void], lens: Lens, backwards: bool) -> dict[str, int]:
        """Fill what each surface, and the glass before it, let through, in order of travel; return the facts."""
        if not self.transmission:
            return NO_LOSSES
        count = len(lens.surfaces)
        for name in ("index", "gain", "attenuation"):
            records[f"{name}_table"] = -1
        for number, record in enumerate(records):
            k = count - 1 - number if backwards else number
            before, after = (lens.media[k + 1], lens.media[k]) if backwards else (lens.media[k], lens.media[k + 1])
            if lens.surfaces[k].is_mirror:
                self._put(record, "gain", partial(self.transmission.mirror_share, lens.surfaces[k]))
            elif self.transmission.fresnel:
                self._fill_surface(record, before, after, self.transmission.coating_of(lens.surfaces[k]))
            if self.transmission.absorption and number > 0 and before.absorption is not None:
                self._put(record, "attenuation", partial(attenuation, before))
        stacks = bool(np.any(records["stacked"] > 0))
        layers = stacks or bool(np.any(records["layer"] > 0))
        return {
            "LENS_FRESNEL": int(self.transmission.fresnel),
            "LENS_LAYERS": int(layers),
            "LENS_STACKS": int(stacks),
            "LENS_DARK_LAYERS": int(bool(np.any(records["extinction"] > 0))),
            "LENS_ABSORPTION": int(bool(np.any((records["attenuation"] > 0) | (records["attenuation_table"] >= 0)))),
            "LENS_TINTED": int(self.tables is not None and (layers or bool(self.tables.rows))),
        }

    def _fill_surface(self, record: np.void, before: Medium, after: Medium, coating: Coating) -> None:
        record["gain"] = 1.0
        if isinstance(coating, QuarterWave):
            record["layer"] = coating.index
            record["layer_turns"] = 0.5 * coating.wavelength_nm / (self.wavelength_nm if self.tables is None else 1.0)
            self._put(record, "index", before.index)
        elif isinstance(coating, LayerStack):
            layers = coating.from_behind(before.index(LINE_D_NM), after.index(LINE_D_NM))
            per = self.wavelength_nm if self.tables is None else 1.0
            record["stack"][: 2 * len(layers)] = [x for f in layers for x in (f.index, f.index * f.thickness_nm / per)]
            record["extinction"][: len(layers)] = [layer.extinction for layer in layers]
            record["stacked"] = len(layers)
            self._put(record, "index", before.index)
        elif coating != BARE:

            def gain(nm: Array) -> Array:
                head_on = Interface(before.index(nm), after.index(nm))
                return coating.transmittance(head_on, nm) / BARE.transmittance(head_on, nm)

            self._put(record, "gain", gain)

    def _put(self, record: np.void, name: str, values: Values) -> None:
        """Fill a value and the place of its table."""
        record[name] = values(np.asarray(self.wavelength_nm))
        record[f"{name}_table"] = -1 if self.tables is None else self.tables.place(values)
