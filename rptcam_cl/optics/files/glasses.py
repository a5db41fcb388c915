"""Glass and coatings in lens files: what a name means, catalogues with the package and in files, and the two keys."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import glass_catalogues_dir
from rptcam_cl.core.records import MOST_LAYERS
from rptcam_cl.core.strict_yaml import MAX_BYTES, Document, Fields, KeyPath, problem, read_yaml, rises, value_at
from rptcam_cl.optics import glass as media
from rptcam_cl.optics.files import keys
from rptcam_cl.optics.glass import Absorption, Coating, Medium, Thermal
from rptcam_cl.optics.ray_trace import meets_air
from rptcam_cl.optics.surface import Surface

# Glass from catalogue files: Zemax .agf, and single materials of refractiveindex.info (.yml).

Formula = Callable[[list[float], tuple[float, float], str], Medium]

SCHOTT, SELLMEIER_1, EXTENDED, SELLMEIER_5, EXTENDED_2, EXTENDED_3 = 1, 2, 10, 11, 12, 13
LARGEST_FILE = 16_000_000  # bytes; all catalogues of Zemax in one file have 2 MB

POWERS: dict[int, tuple[int, ...]] = {
    SCHOTT: (0, 2, -2, -4, -6, -8),
    EXTENDED: (0, 2, -2, -4, -6, -8, -10, -12),
    EXTENDED_2: (0, 2, -2, -4, -6, -8, 4, 6),
    EXTENDED_3: (0, 2, 4, -2, -4, -6, -8, -10, -12),
}


def glasses_of_agf(content: bytes, path: Path | str) -> dict[str, Medium]:
    """Return the glasses of a catalogue by name. Those with a formula that is not known are left out.

    Known: Schott (1), Sellmeier 1 (2), Sellmeier 3 and 5 (6, 11), extended 1 to 3 (10, 12, 13). Lines IT (wavelength in
    um, internal transmittance, thickness in mm) say what a glass absorbs.

    Parameters
    ----------
    content : bytes
        Of the file.
    path : Path or str
        What errors call it.
    """
    glasses: dict[str, Medium] = {}
    name, formula = "", 0
    terms: list[float] = []
    inside: list[tuple[float, float, float]] = []
    thermal = Thermal()
    limits: tuple[float, float] | None = None
    for line, raw in enumerate(_text(content).splitlines(), start=1):
        words = raw.split()
        if not words:
            continue
        try:
            if words[0] == "NM":
                _add(glasses, name, formula, terms, limits, inside, thermal)
                name, formula, terms, limits, inside = words[1], int(float(words[2])), [], None, []
                thermal = Thermal()
            elif words[0] == "CD":
                terms = [float(word) for word in words[1:]]
            elif words[0] == "LD":
                limits = (1e3 * float(words[1]), 1e3 * float(words[2]))
            elif words[0] == "ED" and float(words[1]) != 0:
                thermal = replace(thermal, expansion_per_k=1e-6 * float(words[1]))
            elif words[0] == "TD" and len(words) > 6:
                values, reference = (
                    [float(word) for word in words[1:7]],
                    float(words[7] if words[7:] else media.STANDARD_C),
                )
                thermal = replace(thermal, dispersion=tuple(values) if any(values) else None, reference_c=reference)
            elif words[0] == "IT" and len(words) > 3:
                inside.append((1e3 * float(words[1]), float(words[2]), float(words[3])))
        except (IndexError, ValueError, OverflowError):
            raise InputError(f"{path}:{line}: cannot read this {words[0]} line of a glass catalogue") from None
    _add(glasses, name, formula, terms, limits, inside, thermal)
    if not glasses:
        raise InputError(f"{path}: no glass with a known formula; is this a Zemax glass catalogue?")
    return glasses


def _add(
    glasses: dict[str, Medium],
    name: str,
    formula: int,
    terms: list[float],
    limits: tuple[float, float] | None,
    inside: list[tuple[float, float, float]],
    thermal: Thermal,
) -> None:
    """Add a glass; `inside` has wavelength [nm], internal transmittance and thickness [mm] in rows."""
    if not name or not terms:
        return
    absorption, heat = _absorption(inside), None if thermal == Thermal() else thermal
    if formula in POWERS:
        powers = POWERS[formula]
        series = tuple((float(p), a) for p, a in zip(powers, terms, strict=False) if a)
        glasses[name] = media.PowerSeries(series, True, limits, name, absorption=absorption, thermal=heat)
    elif formula in (SELLMEIER_1, 6, SELLMEIER_5):
        pairs = [(b, c) for b, c in zip(terms[::2], terms[1::2], strict=False) if b]
        b, c = tuple(b for b, _ in pairs), tuple(c for _, c in pairs)
        glasses[name] = media.Sellmeier(b, c, 0.0, limits, name, absorption=absorption, thermal=heat)


def _absorption(inside: list[tuple[float, float, float]]) -> Absorption | None:
    """Return the absorption of rows of wavelength, transmittance and thickness, None with fewer than two valid ones."""
    rows = sorted({row[0]: row for row in inside if row[2] > 0 and 0 <= row[1] <= 1}.values())
    return Absorption.from_transmittance(*zip(*rows, strict=True)) if len(rows) > 1 else None


def read_refractive_index(path: Path | str, content: bytes | None = None) -> Medium:
    """Return the medium of a refractiveindex.info file: formulas 1, 2, 3 and 5, or tabulated n; k when there is one.

    Parameters
    ----------
    path : Path or str
        The file.
    content : bytes, optional
        What it holds, where that is known.
    """
    document = read_yaml(Path(path) if content is None else content, str(path))
    data = document.data
    blocks = data.get("DATA") if isinstance(data, dict) else None
    if not isinstance(blocks, list) or not blocks:
        raise InputError(f"{path}: no DATA list; is this a file of refractiveindex.info?")
    name = Path(path).stem
    absorption = _extinction(path, blocks)
    for block in blocks:
        kind = _kind(block)
        try:
            if kind in _FORMULAS:
                terms = [float(word) for word in str(block["coefficients"]).split()]
                low, high = (1e3 * float(word) for word in str(block["wavelength_range"]).split())
                return replace(_FORMULAS[kind](terms, (low, high), name), absorption=absorption)
            if kind in ("tabulated n", "tabulated nk"):
                rows = _rows(block, 2)
                wavelengths = tuple((1e3 * rows[:, 0]).tolist())
                return media.TabulatedIndex(wavelengths, tuple(rows[:, 1].tolist()), name, absorption=absorption)
        except (KeyError, ValueError, IndexError):
            raise InputError(f"{path}: cannot read the block of type {kind!r}") from None
    kinds = ", ".join(repr(str(block.get("type"))) for block in blocks if isinstance(block, dict))
    raise InputError(f"{path}: no dispersion formula that is known (has {kinds}; known: {', '.join(_FORMULAS)})")


def _kind(block: Any) -> str:
    return str(block.get("type", "")).strip() if isinstance(block, dict) else ""


def _rows(block: Any, columns: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the first columns of a table."""
    return np.array([[float(w) for w in line.split()[:columns]] for line in block["data"].splitlines() if line.strip()])


def _extinction(path: Path | str, blocks: list[Any]) -> Absorption | None:
    """Return the absorption 4 pi k / L of a tabulated extinction coefficient k, None without one."""
    for block in blocks:
        kind = _kind(block)
        if kind in ("tabulated k", "tabulated nk"):
            try:
                rows = _rows(block, 2 if kind == "tabulated k" else 3)
                return Absorption.from_extinction(rows[:, 0], rows[:, -1])
            except (KeyError, ValueError, IndexError):
                raise InputError(f"{path}: cannot read the block of type {kind!r}") from None
    return None


def _sellmeier(squares: bool) -> Formula:
    """The formula whose resonances are given as squares of wavelengths, or as wavelengths."""

    def build(terms: list[float], limits: tuple[float, float], name: str) -> Medium:
        if len(terms) % 2 == 0:
            raise ValueError("a constant and pairs of strength and resonance are expected")
        resonances = tuple(c if squares else c * c for c in terms[2::2])
        return media.Sellmeier(tuple(terms[1::2]), resonances, terms[0], limits, name)

    return build


def _polynomial(squared: bool) -> Formula:
    def build(terms: list[float], limits: tuple[float, float], name: str) -> Medium:
        pairs = zip(terms[2::2], terms[1::2], strict=True)
        return media.PowerSeries(((0.0, terms[0]), *((power, a) for power, a in pairs)), squared, limits, name)

    return build


_FORMULAS: dict[str, Formula] = {
    "formula 1": _sellmeier(False),
    "formula 2": _sellmeier(True),
    "formula 3": _polynomial(True),
    "formula 5": _polynomial(False),
}


def _text(raw: bytes) -> str:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16", "replace")
    return raw.decode("utf-8-sig", "replace")


#
# Glasses of the makers' catalogues that come with the package; none is read before it is requested.
#
# The data and their source: ``optics/catalogues/README.md``.

MAKERS = (
    "schott", "ohara", "hoya", "hikari", "cdgm", "sumita", "lzos", "plastic", "corning", "crystran", "ami", "lightpath",
    "vitron",
)  # fmt: skip
_HEAD = re.compile(r'^\{"name":"([^"]+)"(?:,"nd":([0-9.]+),"vd":(-?[0-9.]+))?', re.MULTILINE)


@dataclass(frozen=True)
class MakersGlass:
    """A glass of a maker's catalogue.

    Attributes
    ----------
    maker : str
        One of `MAKERS`.
    name : str
        As the maker writes it.
    nd, vd : float or None
        Index and Abbe number at the d line, None where they are not known.
    """

    maker: str
    name: str
    nd: float | None
    vd: float | None


def plain_glass_name(name: str) -> str:
    """Return a glass name without hyphens, blanks, quotes and case: ``NBK7`` and ``N-BK7`` agree."""
    return re.sub(r"[-\s'\"]", "", name).upper()


@lru_cache(maxsize=len(MAKERS))
def glasses_of(maker: str) -> dict[str, MakersGlass]:
    """Return the glasses of a maker by their plain names."""
    rows = (_HEAD.match(line) for line in _makers_text(maker).splitlines())
    return {
        plain_glass_name(row[1]): MakersGlass(maker, row[1], *(float(v) if v else None for v in (row[2], row[3])))
        for row in rows
        if row
    }


@lru_cache(maxsize=256)
def law_of(glass: MakersGlass, label: str) -> Medium:
    """Return the dispersion law of a glass, called `label`, with what it absorbs."""
    row = _row(glass)
    table, thermal = row.get("k"), _thermal(row)  # extinction coefficients
    absorption = Absorption.from_extinction(*np.array(table).T) if table and len(table) > 1 else None
    if "formula" in row:
        low, high = row["range_um"]
        law = _FORMULAS[f"formula {row['formula']}"](row["coefficients"], (1e3 * low, 1e3 * high), label)
        return replace(law, absorption=absorption, thermal=thermal)
    wavelengths, values = zip(*row["n"], strict=True)
    return media.TabulatedIndex(
        tuple(1e3 * w for w in wavelengths), values, label, absorption=absorption, thermal=thermal
    )


def bundled_thermal(medium: Medium) -> Thermal | None:
    """Return the thermal data of SCHOTT for a glass of the bundled table; None for others."""
    glass = (
        glasses_of("schott").get(plain_glass_name(medium.name)) if media.GLASSES.get(medium.name) == medium else None
    )
    return _thermal(_row(glass)) if glass is not None else None


def _row(glass: MakersGlass) -> dict[str, Any]:
    text = _makers_text(glass.maker)
    start = text.index(f'{{"name":"{glass.name}"')
    row: dict[str, Any] = json.loads(text[start : text.index("\n", start)])
    return row


def _thermal(row: dict[str, Any]) -> Thermal | None:
    """Return the thermal data of a row, None without any."""
    if "thermal" not in row and "expansion" not in row:
        return None
    dispersion = tuple(row["thermal"]) if "thermal" in row else None
    return Thermal(dispersion, row.get("expansion"), row.get("temperature_c", media.STANDARD_C))


@lru_cache(maxsize=len(MAKERS))
def _makers_text(maker: str) -> str:
    path = glass_catalogues_dir() / f"{maker}.jsonl"
    try:
        return path.read_text("utf-8")
    except OSError as problem:
        raise StateError(f"{path}: the installation is incomplete ({problem.strerror}); reinstall it") from problem


# Which glass a name means: of the bundled table, a maker's catalogue, by an alias, or as the heir of an old one.

_BUNDLED = {plain_glass_name(name): name for name in media.GLASSES}
_NO_MAKER = {"fused silica", "CaF2", "water"}  # of the bundled names; the others are SCHOTT's

# Other names of the same substance, as the catalogues of optical programs have them.
_FUSED_SILICA = "SILICA F_SILICA FSILICA FUSEDSILICA FUSED_SILICA SIO2 QUARTZ SUPRASIL C79-80 HPFS7980 CORNING7980 UVFS"
_ALIASES = {plain_glass_name(name): "fused silica" for name in _FUSED_SILICA.split()} | {
    "ACRYLIC": "PMMA-Sultanova", "PMMA": "PMMA-Sultanova", "POLYCARB": "PC-Sultanova", "PC": "PC-Sultanova",
    "POLYCARBONATE": "PC-Sultanova", "POLYSTYR": "PS-Sultanova", "PS": "PS-Sultanova", "STYRENE": "PS-Sultanova",
    "POLYSTYRENE": "PS-Sultanova", "E48": "E48R", "ZEONEX": "E48R", "ZEONEXE48R": "E48R", "COP": "E48R",
    "NAS21": "NAS-21", "NAS": "NAS-21", "CR39": "CR-39", "B270": "B270", "CAFL": "CaF2", "CALCIUMFLUORIDE": "CaF2",
    "H2O": "water", "BOROFLOAT": "BOROFLOAT33", "D263": "D263TECO", "GERMANIUM": "Ge", "DIAMOND": "diamond",
}  # fmt: skip
# Glasses that SCHOTT no longer makes and that have no successor, by the six-digit codes of its old catalogues.
_RETIRED = {"SK1": "610567", "SK3": "609589", "SK6": "614564", "SK7": "607595", "SK8": "611559", "SK9": "614552",
            "SK13": "592584", "SK19": "613574", "SK20": "560612"}  # fmt: skip
_PREFIXES = {"schott": ("N", "P"), "ohara": ("S", "L"), "hikari": ("J", "E"), "cdgm": ("H", "D"), "sumita": ("K",),
             "hoya": ("E", "M")}  # fmt: skip
_GROUPS = {
    "MISC": ("plastic", "corning", "crystran"), "INFRARED": ("ami", "vitron", "lightpath", "crystran"),
    "BIREFRINGENT": ("crystran",), "ZEON": ("plastic",), "NIKON": ("hikari",), "RAD": ("schott",), "IRG": ("schott",),
}  # fmt: skip


@dataclass(frozen=True)
class Named:
    """What a name turned out to mean.

    Attributes
    ----------
    written : str
        Its name in a file of ours.
    maker : str
        One of `MAKERS`; empty for a substance that nobody in particular makes.
    is_exact : bool
        Whether the name is the maker's own; else it is an alias or that of a predecessor.
    is_chosen : bool
        Whether its maker was requested.
    """

    written: str
    maker: str
    is_exact: bool = True
    is_chosen: bool = False

    def remark(self, name: str) -> str:
        """Return a remark on how `name` was taken, empty where there was no choice."""
        if not self.is_exact:
            return f"glass {name} is taken as {self.written}{f' ({self.maker.upper()})' if self.maker else ''}"
        plain = plain_glass_name(name)
        others = [m.upper() for m in MAKERS if m != self.maker and plain in glasses_of(m)] if self.maker else []
        if self.is_chosen or not others:
            return ""
        verb = "has one" if len(others) == 1 else "have one each"
        return (
            f"glass {name} is taken from {self.maker.upper()}; {' and '.join(others)} {verb} of that name too "
            "(--catalogue decides)"
        )


def makers_of(catalogue: str) -> tuple[str, ...]:
    """Return the makers whom a catalogue's name means, such as ``SCHOTT`` or ``SUMITA_AUG2011``; none if unknown."""
    word = catalogue.strip().upper()
    for start, makers in [*((maker.upper(), (maker,)) for maker in MAKERS), *_GROUPS.items()]:
        if word.startswith(start):
            return makers
    return ()


def chosen_makers(catalogues: Iterable[str]) -> tuple[str, ...]:
    """Return the makers of catalogues that a user has named, or say which there are."""
    chosen: list[str] = []
    for word in catalogues:
        makers = makers_of(word)
        if not makers:
            known = ", ".join(maker.upper() for maker in MAKERS)
            raise InputError(f"no glass catalogue {word!r} comes with the package (allowed: {known})")
        chosen += makers
    return tuple(chosen)


def named_glass(name: str, makers: Sequence[str] = (), successors: bool = False) -> Named | None:
    """Return which glass a name means, None when no catalogue has it.

    Parameters
    ----------
    name : str
        Such as ``N-BK7``, ``nbk7_schott`` or ``OHARA_S-LAH60``; hyphens, blanks, quotes and case do not count.
    makers : sequence of str
        Whose catalogues come first, in their order.
    successors : bool
        Whether ``SK16`` may mean N-SK16, and ``LAL8`` S-LAL8.
    """
    base, _, last = name.strip(" '\"").rpartition("_")
    if base and makers_of(last):
        name, makers = base, makers_of(last)
    plain = plain_glass_name(name)
    if not plain:
        return None
    if plain in _BUNDLED and (not makers or makers[0] == "schott" or _BUNDLED[plain] in _NO_MAKER):
        written = _BUNDLED[plain]
        return Named(written, "" if written in _NO_MAKER else "schott", is_chosen=bool(makers))
    for maker in makers:
        if plain in glasses_of(maker):
            return Named(_written_name(plain, maker), maker, is_chosen=True)
    if successors and (successor := _successor(plain, makers or ("schott",))):
        return successor
    for maker in MAKERS:
        if plain in glasses_of(maker):
            return Named(_written_name(plain, maker), maker)
    if plain in _ALIASES and (successor := named_glass(_ALIASES[plain])):
        return Named(successor.written, successor.maker, False)
    front, _, rest = name.strip(" '\"").replace(":", "_").replace(" ", "_").partition("_")
    if rest and makers_of(front):
        return named_glass(rest, makers_of(front), successors)
    return _successor(plain, tuple(_PREFIXES)) if successors else None


def other_name(name: str) -> tuple[Any, str] | None:
    """Return the `glass` entry and its words for a name that no catalogue has: that of a substance with the author of
    its measurement behind it, as in refractiveindex.info (``CAF2_DAIMON-20``), or of a glass of SCHOTT's of old."""
    base, _, last = name.strip(" '\"").replace(" ", "_").partition("_")
    substance = named_glass(f"{base}-{last}") or named_glass(base) if last else None
    if substance is not None and substance.maker in ("", "plastic"):
        return substance.written, substance.written
    code = _RETIRED.get(plain_glass_name(base)) if makers_of(last or "schott") == ("schott",) else None
    if code is None:
        return None
    nd, vd = round(1 + int(code[:3]) / 1000, 3), int(code[3:]) / 10
    nearest = f"{near_glass_words(nd, vd, ('schott',))} is their nearest now"
    return {"nd": nd, "vd": vd}, f"{nd:g} / {vd:g}, the code {code} of SCHOTT's old catalogues; {nearest}"


def find_glass(name: str) -> Medium | None:
    """Return the law of a glass by the name that `Named.written` has, or by any other that `named_glass` knows."""
    named = named_glass(name)
    if named is None:
        return None
    if named.written in media.GLASSES:
        return media.GLASSES[named.written]
    return law_of(_entry(named), named.written)


def near_names(name: str) -> list[str]:
    """Return the glasses whose names are most like a name, with their makers."""
    known = {
        plain: f"{glass.name} ({maker.upper()})"
        for maker in reversed(MAKERS)
        for plain, glass in glasses_of(maker).items()
    }
    known |= {plain: f"{written} (SCHOTT)" for plain, written in _BUNDLED.items() if written not in _NO_MAKER}
    known |= {plain_glass_name(written): written for written in _NO_MAKER}
    return [known[plain] for plain in difflib.get_close_matches(plain_glass_name(name), known, n=3, cutoff=0.5)]


def _near_glasses(nd: float, vd: float, makers: Sequence[str] = (), count: int = 3) -> list[MakersGlass]:
    """Return the glasses nearest to an index and an Abbe number, 0.001 in the one counting as 0.5 in the other."""

    def distance(glass: MakersGlass) -> float:
        assert glass.nd is not None and glass.vd is not None
        return math.hypot((glass.nd - nd) / 1e-3, (glass.vd - vd) / 0.5)

    known = [glass for maker in makers or MAKERS for glass in glasses_of(maker).values() if glass.nd and glass.vd]
    return sorted(known, key=distance)[:count]


def near_glass_words(nd: float, vd: float, makers: Sequence[str] = ()) -> str:
    """Return the nearest glass in words: ``N-BK7 (SCHOTT) 1.5168 / 64.17``."""
    glass = _near_glasses(nd, vd, makers, count=1)[0]
    return f"{glass.name} ({glass.maker.upper()}) {glass.nd:g} / {glass.vd:.4g}"


def _entry(named: Named) -> MakersGlass:
    base, _, last = named.written.rpartition("_")
    plain = plain_glass_name(base if base and makers_of(last) else named.written)
    return glasses_of(named.maker)[plain]


def _written_name(plain: str, maker: str) -> str:
    """Return the name of a glass in a file of ours: the maker's own, with the maker where another has it too."""
    bundled = _BUNDLED.get(plain)
    if bundled and maker == "schott":
        return bundled
    first = "schott" if bundled else next(other for other in MAKERS if plain in glasses_of(other))
    name = glasses_of(maker)[plain].name
    return name if maker == first else f"{name}_{maker.upper()}"


def _successor(plain: str, makers: Sequence[str]) -> Named | None:
    """Return the glass of one of the makers that took the place of an old one, or that it is a variant of.

    SK16 is N-SK16 now, LAKN22 N-LAK22, LAL8 S-LAL8 and E-LAF7 J-LAF7; L-TIM28_MOLD is L-TIM28 pressed.
    """
    bare = re.fullmatch(r"(\D+?)N(\d+\w*)", plain)
    stems = [plain, *([bare[1] + bare[2]] if bare else [])]
    if variant := re.fullmatch(r"(\w+\d)(_?MOLD|M|HT|HTI|HHT|HTULTRA|ULTRA)", plain):
        stems.append(variant[1])
    for maker in makers:
        prefixes = _PREFIXES.get(maker, ())
        for stem in stems:
            swapped = [stem[len(prefix) :] for prefix in prefixes if stem.startswith(prefix)]
            for rest in [stem, *(prefix + part for part in [stem, *swapped] for prefix in prefixes)]:
                if rest != plain and (rest in glasses_of(maker) or (maker == "schott" and rest in _BUNDLED)):
                    return Named(_written_name(rest, maker), maker, False)
    return None


# The `coating` key of a lens file: a word, a quarter-wave layer, several layers, or a measured reflectance.

WORDS: dict[str, Coating] = dict(
    zip(keys.COATING_WORDS, (media.BARE, media.MAGNESIUM_FLUORIDE, media.MULTILAYER), strict=True)
)
_COATING_FORMS = f"{', '.join(keys.COATING_WORDS)}, {{quarter_wave: …}}, {{layers: …}} or {{reflectance: …}}"


def apply_coatings(document: Document, surfaces: tuple[Surface, ...], object_medium: Medium) -> tuple[Surface, ...]:
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


def _misfit(coating: Coating | None, before: Medium, surface: Surface) -> str:
    """Return why a coating cannot lie on a surface behind a medium, nothing when it can."""
    after = surface.glass
    if coating is None or isinstance(coating, media.Bare):
        return ""
    if surface.is_mirror:
        return "" if isinstance(coating, media.MeasuredReflectance) else "a mirror takes its reflectance alone"
    if before == after:
        return f"has {after.name or 'the same medium'} on both sides, so there is nothing to coat"
    least = min(float(medium.index(LINE_D_NM)) for medium in (before, after))
    layers = coating.layers if isinstance(coating, media.LayerStack) else ()
    layers = (media.Layer(coating.index, 0.0),) if isinstance(coating, media.QuarterWave) else layers
    thinnest = min((layer.index for layer in layers if not layer.extinction), default=least)
    if thinnest < least:
        return f"a layer of index {thinnest:g} is less dense than both media (from {least:.4g}); cement has none"
    return ""


def _read_coating(document: Document, path: KeyPath) -> Coating:
    """Return the coating at a key path of a lens file."""
    value = value_at(document, path)
    if isinstance(value, str):
        if value not in WORDS:
            raise problem(document, path, f"unknown coating; allowed: {_COATING_FORMS}", value)
        return WORDS[value]
    if not isinstance(value, dict):
        raise problem(document, path, f"allowed: {_COATING_FORMS}", value)
    fields = Fields(document, path, keys.COATING)
    if len(value) != 1:
        raise fields.fail(None, f"needs exactly one of {', '.join(keys.COATING)}")
    if "layers" in fields:
        return _layers(fields)
    if "quarter_wave" in fields:
        inner = fields.inner("quarter_wave", keys.QUARTER_WAVE)
        return media.QuarterWave(_index(inner), inner.positive("wavelength_nm"))
    return _read_measured(fields)


def _index(fields: Fields) -> float:
    index = fields.number("index")
    if not 1 <= index <= 5:
        raise fields.fail("index", "the index of a layer lies between 1 and 5")
    return index


def _layer(fields: Fields) -> media.Layer:
    extinction = fields.number("extinction") if "extinction" in fields else 0.0
    if not 0 <= extinction <= 20:
        raise fields.fail("extinction", "lies between 0 and 20")
    index = fields.positive("index") if extinction > 0 else _index(fields)
    if index > 5:
        raise fields.fail("index", "the index of a layer that absorbs lies above 0, up to 5")
    return media.Layer(index, fields.positive("thickness_nm"), extinction)


def _layers(fields: Fields) -> Coating:
    rows = fields.rows("layers", keys.LAYER, "[{index: 1.38, thickness_nm: 99.6}]")
    if not 1 <= len(rows) <= MOST_LAYERS:
        raise fields.fail("layers", f"has 1 to {MOST_LAYERS} layers, not {len(rows)}")
    return coating_of(tuple(map(_layer, rows)))


def coating_of(given: str | float | tuple[media.Layer, ...]) -> Coating:
    """The coating of a word, a constant reflectance, or layers; a clear single one is a quarter wave."""
    if isinstance(given, str):
        return WORDS[given]
    if isinstance(given, float):
        return media.constant_reflectance(given)
    if len(given) == 1 and not given[0].extinction:
        return media.QuarterWave(given[0].index, 4 * given[0].index * given[0].thickness_nm)
    return media.LayerStack(given)


def _read_measured(fields: Fields) -> Coating:
    value = fields.get("reflectance")
    if isinstance(value, str):
        return _read_reflectance(fields, value)
    if isinstance(value, dict):
        inner = fields.inner("reflectance", keys.REFLECTANCE)
        return media.MeasuredReflectance(*_read_spectrum(inner, "reflectance"))
    share = fields.number("reflectance")
    if not 0 <= share < 1:
        raise fields.fail("reflectance", "lies between 0 and 1, not in percent")
    return media.constant_reflectance(share)


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


def _read_reflectance(fields: Fields, name: str) -> media.MeasuredReflectance:
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
    return media.MeasuredReflectance(wavelengths, values)


# The `glass` key of a lens file: a name, or a mapping that holds one dispersion law.


def read_glass(document: Document, path: KeyPath) -> Medium:
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
        medium = replace(medium, thermal=_read_thermal(fields, medium.thermal or Thermal()))
    if "transmittance" not in fields:
        return medium
    inner = fields.inner("transmittance", keys.TRANSMITTANCE)
    spectrum, thickness_mm = _read_spectrum(inner, "transmittance"), inner.positive("thickness_mm")
    return replace(medium, absorption=Absorption.from_transmittance(*spectrum, thickness_mm))


def _read_thermal(fields: Fields, known: Thermal) -> Thermal:
    expansion = fields.number("expansion_per_k") if "expansion_per_k" in fields else known.expansion_per_k
    if "thermal" not in fields:
        return replace(known, expansion_per_k=expansion)
    inner = fields.inner("thermal", keys.THERMAL)
    d, e = inner.numbers("d"), inner.numbers("e")
    for key, values, count in (("d", d, 3), ("e", e, 2)):
        if len(values) != count:
            raise inner.fail(key, f"expected {count} numbers")
    return Thermal((*d, *e, inner.positive("resonance_um")), expansion, inner.number("reference_c", media.STANDARD_C))


def _find_glass(document: Document, path: KeyPath, name: str) -> Medium:
    if name.lower() in ("air", "vacuum"):
        return media.AIR
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


def _constant(fields: Fields) -> Medium:
    value = _check_index(fields, "index", fields.number("index"))
    return media.ConstantIndex(value, fields.text("name", f"n = {value:g}"))


def _abbe(fields: Fields) -> Medium:
    nd = _check_index(fields, "nd", fields.number("nd"))
    vd = fields.positive("vd")
    return media.AbbeCauchy(nd, vd, fields.text("name", f"{nd:g} / {vd:g}"))


def _linear(fields: Fields) -> Medium:
    inner = fields.inner("linear_abbe", keys.LINEAR_ABBE)
    n = _check_index(inner, "n", inner.number("n"))
    v = inner.positive("v")
    return media.AbbeLinear(n, v, fields.text("name", f"{n:g} / {v:g} linear"))


def _read_sellmeier(fields: Fields) -> Medium:
    inner = fields.inner("sellmeier", keys.SELLMEIER)
    b, c = inner.numbers("b"), inner.numbers("c")
    if len(b) != len(c):
        raise inner.fail("c", f"b and c need as many numbers as each other ({len(b)} and {len(c)})")
    return media.Sellmeier(b, c, inner.number("c0", 0.0), _range(fields), fields.text("name", "Sellmeier glass"))


def _cauchy(fields: Fields) -> Medium:
    terms = tuple((-2.0 * i, a) for i, a in enumerate(fields.numbers("cauchy")))
    return media.PowerSeries(terms, False, _range(fields), fields.text("name", "Cauchy glass"))


def _schott(fields: Fields) -> Medium:
    values = fields.numbers("schott")
    if len(values) != 6:
        raise fields.fail(
            "schott", "expected six coefficients a0 to a5 of n^2 = a0 + a1 L^2 + a2 / L^2 + ... + a5 / L^8"
        )
    powers = (0.0, 2.0, -2.0, -4.0, -6.0, -8.0)
    return media.PowerSeries(
        tuple(zip(powers, values, strict=True)), True, _range(fields), fields.text("name", "Schott glass")
    )


def _table(fields: Fields) -> Medium:
    inner = fields.inner("table", keys.INDEX_TABLE)
    wavelengths, values = inner.numbers("wavelengths_nm"), inner.numbers("values")
    if len(wavelengths) != len(values):
        raise inner.fail("values", f"needs one index for each wavelength ({len(values)} for {len(wavelengths)})")
    if not rises(wavelengths):
        raise inner.fail("wavelengths_nm", "must be above 0 and rise")
    for value in values:
        _check_index(inner, "values", value)
    return media.TabulatedIndex(wavelengths, values, fields.text("name", "tabulated glass"))


def _range(fields: Fields) -> tuple[float, float] | None:
    if "range_nm" not in fields:
        return None
    limits = fields.numbers("range_nm")
    if len(limits) != 2 or not rises(limits):
        raise fields.fail("range_nm", "expected [shortest, longest] wavelength in nm")
    return limits[0], limits[1]


def _catalogue(fields: Fields) -> Medium:
    path, content = _content(fields, "catalogue", LARGEST_FILE)
    glasses, name = glasses_of_agf(content, path), fields.text("name")
    for known, medium in glasses.items():
        if known.lower() == name.lower():
            return medium
    near = difflib.get_close_matches(name.upper(), glasses, n=3, cutoff=0.4)
    raise fields.fail("name", f"no such glass in {path.name}; did you mean {', '.join(near) or next(iter(glasses))}?")


def _refractive_index(fields: Fields) -> Medium:
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
    "sellmeier": _read_sellmeier,
    "cauchy": _cauchy,
    "schott": _schott,
    "table": _table,
    "catalogue": _catalogue,
    "refractiveindex": _refractive_index,
}
