"""The keys `glass` and `coating` of a lens file: a name, or a mapping that holds one law."""

from __future__ import annotations

import difflib
from dataclasses import replace
from pathlib import Path

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.records import MOST_LAYERS
from rptcam_cl.core.strict_yaml import MAX_BYTES, Document, Fields, KeyPath, problem, rises, value_at
from rptcam_cl.optics import glass
from rptcam_cl.optics.coating import (
    BARE,
    MAGNESIUM_FLUORIDE,
    MULTILAYER,
    Bare,
    Coating,
    Layer,
    LayerStack,
    MeasuredReflectance,
    QuarterWave,
    constant_reflectance,
)
from rptcam_cl.optics.files import keys
from rptcam_cl.optics.files.glass_catalogues import (
    LARGEST_FILE,
    find_glass,
    glasses_of_agf,
    near_names,
    read_refractive_index,
)
from rptcam_cl.optics.ray_trace import meets_air
from rptcam_cl.optics.surface import Surface

# The `coating` key of a lens file: a word, a quarter-wave layer, several layers, or a measured reflectance.

WORDS: dict[str, Coating] = dict(zip(keys.COATING_WORDS, (BARE, MAGNESIUM_FLUORIDE, MULTILAYER), strict=True))
COATING_FORMS = f"{', '.join(keys.COATING_WORDS)}, {{quarter_wave: …}}, {{layers: …}} or {{reflectance: …}}"


def apply_coatings(
    document: Document, surfaces: tuple[Surface, ...], object_medium: glass.Medium
) -> tuple[Surface, ...]:
    """Return the surfaces with their coatings: their own, or between glass and air that of the lens."""
    common = _read_coating(document, ("coating",)) if "coating" in document.data else None
    result, before = [], object_medium
    for k, surface in enumerate(surfaces):
        coating = common if meets_air(before, surface.glass) else None
        if "coating" in document.data["surfaces"][k]:
            path: KeyPath = ("surfaces", k, "coating")
            coating = _read_coating(document, path)
            fault = _misfit(coating, before, surface)
            if fault:
                raise problem(document, path, fault)
        elif fault := _misfit(coating, before, surface):
            raise problem(document, ("coating",), f"does not suit surface {k}: {fault}")
        result.append(replace(surface, coating=coating) if coating else surface)
        before = surface.glass
    return tuple(result)


def _misfit(coating: Coating | None, before: glass.Medium, surface: Surface) -> str:
    """Return why a coating cannot lie on a surface behind a medium, nothing when it can."""
    after = surface.glass
    if coating is None or isinstance(coating, Bare):
        return ""
    if surface.is_mirror:
        return "" if isinstance(coating, MeasuredReflectance) else "a mirror takes its reflectance alone"
    if before == after:
        return f"has {after.name or 'the same medium'} on both sides, so there is nothing to coat"
    least = min(float(medium.index(LINE_D_NM)) for medium in (before, after))
    layers = coating.layers if isinstance(coating, LayerStack) else ()
    layers = (Layer(coating.index, 0.0),) if isinstance(coating, QuarterWave) else layers
    thinnest = min((layer.index for layer in layers if not layer.extinction), default=least)
    if thinnest < least:
        return f"a layer of index {thinnest:g} is less dense than both media (from {least:.4g}); cement has none"
    return ""


def _read_coating(document: Document, path: KeyPath) -> Coating:
    """Return the coating at a key path of a lens file."""
    value = value_at(document, path)
    if isinstance(value, str):
        if value not in WORDS:
            raise problem(document, path, f"unknown coating; allowed: {COATING_FORMS}", value)
        return WORDS[value]
    if not isinstance(value, dict):
        raise problem(document, path, f"allowed: {COATING_FORMS}", value)
    fields = Fields(document, path, keys.COATING)
    if len(value) != 1:
        raise fields.fail(None, f"needs exactly one of {', '.join(keys.COATING)}")
    if "layers" in fields:
        return _layers(fields)
    if "quarter_wave" in fields:
        inner = fields.inner("quarter_wave", keys.QUARTER_WAVE)
        return QuarterWave(_index(inner), inner.positive("wavelength_nm"))
    return _read_measured(fields)


def _index(fields: Fields) -> float:
    index = fields.number("index")
    if not 1 <= index <= 5:
        raise fields.fail("index", "the index of a layer lies between 1 and 5")
    return index


def _layer(fields: Fields) -> Layer:
    extinction = fields.number("extinction") if "extinction" in fields else 0.0
    if not 0 <= extinction <= 20:
        raise fields.fail("extinction", "lies between 0 and 20")
    index = fields.positive("index") if extinction > 0 else _index(fields)
    if index > 5:
        raise fields.fail("index", "the index of a layer that absorbs lies above 0, up to 5")
    return Layer(index, fields.positive("thickness_nm"), extinction)


def _layers(fields: Fields) -> Coating:
    rows = fields.rows("layers", keys.LAYER, "[{index: 1.38, thickness_nm: 99.6}]")
    if not 1 <= len(rows) <= MOST_LAYERS:
        raise fields.fail("layers", f"has 1 to {MOST_LAYERS} layers, not {len(rows)}")
    return read_layers(tuple(map(_layer, rows)))


def read_layers(layers: tuple[Layer, ...]) -> Coating:
    """Return the coating of some layers; a clear single one is a quarter wave of some wavelength."""
    if len(layers) == 1 and not layers[0].extinction:
        return QuarterWave(layers[0].index, 4 * layers[0].index * layers[0].thickness_nm)
    return LayerStack(layers)


def _read_measured(fields: Fields) -> Coating:
    value = fields.get("reflectance")
    if isinstance(value, str):
        return _read_reflectance(fields, value)
    if isinstance(value, dict):
        inner = fields.inner("reflectance", keys.REFLECTANCE)
        return MeasuredReflectance(*_read_spectrum(inner, "reflectance"))
    share = fields.number("reflectance")
    if not 0 <= share < 1:
        raise fields.fail("reflectance", "lies between 0 and 1, not in percent")
    return constant_reflectance(share)


def _read_spectrum(fields: Fields, what: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return `wavelengths_nm`, which rise, and `values` from 0 to 1, as many."""
    wavelengths, values = fields.numbers("wavelengths_nm"), fields.numbers("values")
    fault = _spectrum_fault(wavelengths, values, what)
    if fault:
        raise fields.fail(*fault)
    return wavelengths, values


def _spectrum_fault(wavelengths: tuple[float, ...], values: tuple[float, ...], what: str) -> tuple[str, str] | None:
    """Return the key at fault and what is wrong, None when a spectrum is as it should be."""
    if len(wavelengths) < 2:
        return "wavelengths_nm", "needs at least two wavelengths"
    if not rises(wavelengths):
        return "wavelengths_nm", "must rise, above 0"
    if len(values) != len(wavelengths):
        return "values", f"needs as many numbers as wavelengths_nm ({len(values)} and {len(wavelengths)})"
    if not all(0 <= value <= 1 for value in values):
        return "values", f"a {what} lies between 0 and 1, not in percent"
    return None


def _read_reflectance(fields: Fields, name: str) -> MeasuredReflectance:
    """Return the coating of a CSV file: wavelength [nm] and reflectance (0 to 1) in each line, perhaps under a head."""
    try:
        path, content = fields.document.files.read(name, MAX_BYTES)
        text = content.decode("utf-8-sig")
    except (InputError, StateError) as trouble:
        raise fields.fail("reflectance", str(trouble)) from None
    except UnicodeDecodeError:
        raise fields.fail("reflectance", "is not text in UTF-8") from None
    rows: list[tuple[float, float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        try:
            pair = tuple(float(word) for word in words)
        except ValueError:
            if rows:
                raise InputError(f"{path}:{number}: expected a wavelength and a reflectance (got {line!r})") from None
            continue
        if pair and len(pair) != 2:
            raise InputError(f"{path}:{number}: expected a wavelength and a reflectance (got {line!r})")
        rows += [(pair[0], pair[1])] if pair else []
    wavelengths, values = tuple(row[0] for row in rows), tuple(row[1] for row in rows)
    fault = _spectrum_fault(wavelengths, values, "reflectance")
    if fault:
        raise InputError(f"{path}: {fault[0]}: {fault[1]}")
    return MeasuredReflectance(wavelengths, values)


# The `glass` key of a lens file: a name, or a mapping that holds one dispersion law.


def read_glass(document: Document, path: KeyPath) -> glass.Medium:
    """Return the medium at a key path of a lens file."""
    value = value_at(document, path)
    if isinstance(value, str):
        return _find_glass(document, path, value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        raise problem(document, path, "expected a name or a mapping such as {index: 1.5}", value)
    fields = Fields(document, path, keys.GLASS)
    given = [law for law in keys.LAWS if law in fields]
    if len(given) != 1:
        raise fields.fail(None, f"needs exactly one of {', '.join(keys.LAWS)} (has {', '.join(given) or 'none'})")
    medium = _LAWS[given[0]](fields)
    if "thermal" in fields or "expansion_per_k" in fields:
        medium = replace(medium, thermal=_read_thermal(fields, medium.thermal or glass.Thermal()))
    if "transmittance" not in fields:
        return medium
    inner = fields.inner("transmittance", keys.TRANSMITTANCE)
    spectrum, thickness_mm = _read_spectrum(inner, "transmittance"), inner.positive("thickness_mm")
    return replace(medium, absorption=glass.Absorption.from_transmittance(*spectrum, thickness_mm))


def _read_thermal(fields: Fields, known: glass.Thermal) -> glass.Thermal:
    expansion = fields.number("expansion_per_k") if "expansion_per_k" in fields else known.expansion_per_k
    if "thermal" not in fields:
        return replace(known, expansion_per_k=expansion)
    inner = fields.inner("thermal", keys.THERMAL)
    d, e = inner.numbers("d"), inner.numbers("e")
    for key, values, count in (("d", d, 3), ("e", e, 2)):
        if len(values) != count:
            raise inner.fail(key, f"expected {count} numbers")
    return glass.Thermal(
        (*d, *e, inner.positive("resonance_um")), expansion, inner.number("reference_c", glass.STANDARD_C)
    )


def _find_glass(document: Document, path: KeyPath, name: str) -> glass.Medium:
    if name.lower() in ("air", "vacuum"):
        return glass.AIR
    medium = find_glass(name)
    if medium is not None:
        return medium
    near = near_names(name)
    hint = f"did you mean {', '.join(near)}?" if near else "give its {nd: …, vd: …} or {index: …}"
    raise problem(document, path, f"unknown glass; {hint}", name)


def _check_index(fields: Fields, key: str, value: float) -> float:
    if not keys.LOWEST_INDEX <= value <= keys.HIGHEST_INDEX:
        raise fields.fail(key, f"a refractive index lies between {keys.LOWEST_INDEX:g} and {keys.HIGHEST_INDEX:g}")
    return value


def _constant(fields: Fields) -> glass.Medium:
    value = _check_index(fields, "index", fields.number("index"))
    return glass.ConstantIndex(value, fields.text("name", f"n = {value:g}"))


def _abbe(fields: Fields) -> glass.Medium:
    nd = _check_index(fields, "nd", fields.number("nd"))
    vd = fields.positive("vd")
    return glass.AbbeCauchy(nd, vd, fields.text("name", f"{nd:g} / {vd:g}"))


def _linear(fields: Fields) -> glass.Medium:
    inner = fields.inner("linear_abbe", keys.LINEAR_ABBE)
    n = _check_index(inner, "n", inner.number("n"))
    v = inner.positive("v")
    return glass.AbbeLinear(n, v, fields.text("name", f"{n:g} / {v:g} linear"))


def _sellmeier(fields: Fields) -> glass.Medium:
    inner = fields.inner("sellmeier", keys.SELLMEIER)
    b, c = inner.numbers("b"), inner.numbers("c")
    if len(b) != len(c):
        raise inner.fail("c", f"b and c need as many numbers as each other ({len(b)} and {len(c)})")
    return glass.Sellmeier(b, c, inner.number("c0", 0.0), _range(fields), fields.text("name", "Sellmeier glass"))


def _cauchy(fields: Fields) -> glass.Medium:
    terms = tuple((-2.0 * i, a) for i, a in enumerate(fields.numbers("cauchy")))
    return glass.PowerSeries(terms, False, _range(fields), fields.text("name", "Cauchy glass"))


def _schott(fields: Fields) -> glass.Medium:
    values = fields.numbers("schott")
    if len(values) != 6:
        raise fields.fail(
            "schott", "expected six coefficients a0 to a5 of n^2 = a0 + a1 L^2 + a2 / L^2 + ... + a5 / L^8"
        )
    powers = (0.0, 2.0, -2.0, -4.0, -6.0, -8.0)
    return glass.PowerSeries(
        tuple(zip(powers, values, strict=True)), True, _range(fields), fields.text("name", "Schott glass")
    )


def _table(fields: Fields) -> glass.Medium:
    inner = fields.inner("table", keys.INDEX_TABLE)
    wavelengths, values = inner.numbers("wavelengths_nm"), inner.numbers("values")
    if len(wavelengths) != len(values):
        raise inner.fail("values", f"needs one index for each wavelength ({len(values)} for {len(wavelengths)})")
    if not rises(wavelengths):
        raise inner.fail("wavelengths_nm", "must be above 0 and rise")
    for value in values:
        _check_index(inner, "values", value)
    return glass.TabulatedIndex(wavelengths, values, fields.text("name", "tabulated glass"))


def _range(fields: Fields) -> tuple[float, float] | None:
    if "range_nm" not in fields:
        return None
    limits = fields.numbers("range_nm")
    if len(limits) != 2 or not rises(limits):
        raise fields.fail("range_nm", "expected [shortest, longest] wavelength in nm")
    return limits[0], limits[1]


def _catalogue(fields: Fields) -> glass.Medium:
    path, content = _content(fields, "catalogue", LARGEST_FILE)
    glasses, name = glasses_of_agf(content, path), fields.text("name")
    for known, medium in glasses.items():
        if known.lower() == name.lower():
            return medium
    near = difflib.get_close_matches(name.upper(), glasses, n=3, cutoff=0.4)
    raise fields.fail("name", f"no such glass in {path.name}; did you mean {', '.join(near) or next(iter(glasses))}?")


def _refractive_index(fields: Fields) -> glass.Medium:
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
