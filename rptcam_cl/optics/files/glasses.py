"""The `glass` key of a lens file: a name, or a mapping that holds one dispersion law."""

from __future__ import annotations

import difflib
from dataclasses import replace
from pathlib import Path

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.strict_yaml import MAX_BYTES, Document, KeyPath
from rptcam_cl.optics.absorption import Absorption
from rptcam_cl.optics.files.catalogue import LARGEST_FILE, glasses_of_agf, read_refractive_index
from rptcam_cl.optics.files.coatings import read_spectrum
from rptcam_cl.optics.files.fields import Fields, problem, rises, value_at
from rptcam_cl.optics.files.glass_names import glass_named, near_names
from rptcam_cl.optics.files.keys import (
    GLASS,
    HIGHEST_INDEX,
    INDEX_TABLE,
    LAWS,
    LINEAR_ABBE,
    LOWEST_INDEX,
    SELLMEIER,
    THERMAL,
    TRANSMITTANCE,
)
from rptcam_cl.optics.glass import (
    AIR,
    AbbeCauchy,
    AbbeLinear,
    ConstantIndex,
    Law,
    Medium,
    PowerSeries,
    Sellmeier,
    TabulatedIndex,
)
from rptcam_cl.optics.thermal import STANDARD_C, Thermal


def read_glass(document: Document, path: KeyPath) -> Medium:
    """Return the medium at a key path of a lens file."""
    value = value_at(document, path)
    if isinstance(value, str):
        return _named(document, path, value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        raise problem(document, path, "expected a name or a mapping such as {index: 1.5}", value)
    fields = Fields(document, path, GLASS)
    given = [law for law in LAWS if law in fields]
    if len(given) != 1:
        raise fields.fail(None, f"needs exactly one of {', '.join(LAWS)} (has {', '.join(given) or 'none'})")
    medium = _LAWS[given[0]](fields)
    if "thermal" in fields or "expansion_per_k" in fields:
        medium = replace(medium, thermal=_thermal(fields, medium.thermal or Thermal()))
    return replace(medium, absorption=_absorption(fields)) if "transmittance" in fields else medium


def _thermal(fields: Fields, known: Thermal) -> Thermal:
    expansion = fields.number("expansion_per_k") if "expansion_per_k" in fields else known.expansion_per_k
    if "thermal" not in fields:
        return replace(known, expansion_per_k=expansion)
    inner = fields.inner("thermal", THERMAL)
    d, e = inner.numbers("d"), inner.numbers("e")
    for key, values, count in (("d", d, 3), ("e", e, 2)):
        if len(values) != count:
            raise inner.fail(key, f"expected {count} numbers")
    return Thermal((*d, *e, inner.positive("resonance_um")), expansion, inner.number("reference_c", STANDARD_C))


def _absorption(fields: Fields) -> Absorption:
    inner = fields.inner("transmittance", TRANSMITTANCE)
    return Absorption.from_transmittance(*read_spectrum(inner, "transmittance"), inner.positive("thickness_mm"))


def _named(document: Document, path: KeyPath, name: str) -> Medium:
    if name.lower() in ("air", "vacuum"):
        return AIR
    medium = glass_named(name)
    if medium is not None:
        return medium
    near = near_names(name)
    hint = f"did you mean {', '.join(near)}?" if near else "give its {nd: …, vd: …} or {index: …}"
    raise problem(document, path, f"unknown glass; {hint}", name)


def _checked(fields: Fields, key: str, value: float) -> float:
    if not LOWEST_INDEX <= value <= HIGHEST_INDEX:
        raise fields.fail(key, f"a refractive index lies between {LOWEST_INDEX:g} and {HIGHEST_INDEX:g}")
    return value


def _constant(fields: Fields) -> Law:
    value = _checked(fields, "index", fields.number("index"))
    return ConstantIndex(value, fields.text("name", f"n = {value:g}"))


def _abbe(fields: Fields) -> Law:
    nd = _checked(fields, "nd", fields.number("nd"))
    vd = fields.positive("vd")
    return AbbeCauchy(nd, vd, fields.text("name", f"{nd:g} / {vd:g}"))


def _linear(fields: Fields) -> Law:
    inner = fields.inner("linear_abbe", LINEAR_ABBE)
    n = _checked(inner, "n", inner.number("n"))
    v = inner.positive("v")
    return AbbeLinear(n, v, fields.text("name", f"{n:g} / {v:g} linear"))


def _sellmeier(fields: Fields) -> Law:
    inner = fields.inner("sellmeier", SELLMEIER)
    b, c = inner.numbers("b"), inner.numbers("c")
    if len(b) != len(c):
        raise inner.fail("c", f"b and c need as many numbers as each other ({len(b)} and {len(c)})")
    return Sellmeier(b, c, inner.number("c0", 0.0), _range(fields), fields.text("name", "Sellmeier glass"))


def _cauchy(fields: Fields) -> Law:
    terms = tuple((-2.0 * i, a) for i, a in enumerate(fields.numbers("cauchy")))
    return PowerSeries(terms, False, _range(fields), fields.text("name", "Cauchy glass"))


def _schott(fields: Fields) -> Law:
    values = fields.numbers("schott")
    if len(values) != 6:
        raise fields.fail(
            "schott", "expected six coefficients a0 to a5 of n^2 = a0 + a1 L^2 + a2 / L^2 + ... + a5 / L^8"
        )
    powers = (0.0, 2.0, -2.0, -4.0, -6.0, -8.0)
    return PowerSeries(
        tuple(zip(powers, values, strict=True)), True, _range(fields), fields.text("name", "Schott glass")
    )


def _table(fields: Fields) -> Law:
    inner = fields.inner("table", INDEX_TABLE)
    wavelengths, values = inner.numbers("wavelengths_nm"), inner.numbers("values")
    if len(wavelengths) != len(values):
        raise inner.fail("values", f"needs one index for each wavelength ({len(values)} for {len(wavelengths)})")
    if not rises(wavelengths):
        raise inner.fail("wavelengths_nm", "must be above 0 and rise")
    for value in values:
        _checked(inner, "values", value)
    return TabulatedIndex(wavelengths, values, fields.text("name", "tabulated glass"))


def _range(fields: Fields) -> tuple[float, float] | None:
    if "range_nm" not in fields:
        return None
    limits = fields.numbers("range_nm")
    if len(limits) != 2 or not rises(limits):
        raise fields.fail("range_nm", "expected [shortest, longest] wavelength in nm")
    return limits[0], limits[1]


def _catalogue(fields: Fields) -> Law:
    path, content = _content(fields, "catalogue", LARGEST_FILE)
    glasses, name = glasses_of_agf(content, path), fields.text("name")
    for known, medium in glasses.items():
        if known.lower() == name.lower():
            return medium
    near = difflib.get_close_matches(name.upper(), glasses, n=3, cutoff=0.4)
    raise fields.fail("name", f"no such glass in {path.name}; did you mean {', '.join(near) or next(iter(glasses))}?")


def _refractive_index(fields: Fields) -> Law:
    return read_refractive_index(*_content(fields, "refractiveindex", MAX_BYTES))


def _content(fields: Fields, key: str, most: int) -> tuple[Path, bytes]:
    """Return the path and the content of the file that a key names."""
    try:
        return fields.document.files.read(fields.text(key), most)
    except (InputError, StateError) as problem:
        raise fields.fail(key, str(problem)) from None


_LAWS = {
    "index": _constant,
    "nd": _abbe,
    "linear_abbe": _linear,
    "sellmeier": _sellmeier,
    "cauchy": _cauchy,
    "schott": _schott,
    "table": _table,
    "catalogue": _catalogue,
    "refractiveindex": _refractive_index,
}
