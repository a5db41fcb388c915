"""Which glass a name means: the bundled table, makers' catalogues with the package, and catalogue files."""

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

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import glass_catalogues_dir
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.optics.glass import (
    GLASSES,
    STANDARD_C,
    Absorption,
    Medium,
    PowerSeries,
    Sellmeier,
    TabulatedIndex,
    Thermal,
)

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
                values, reference = [float(word) for word in words[1:7]], float(words[7] if words[7:] else STANDARD_C)
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
        glasses[name] = PowerSeries(series, True, limits, name, absorption=absorption, thermal=heat)
    elif formula in (SELLMEIER_1, 6, SELLMEIER_5):
        pairs = [(b, c) for b, c in zip(terms[::2], terms[1::2], strict=False) if b]
        b, c = tuple(b for b, _ in pairs), tuple(c for _, c in pairs)
        glasses[name] = Sellmeier(b, c, 0.0, limits, name, absorption=absorption, thermal=heat)


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
                return TabulatedIndex(wavelengths, tuple(rows[:, 1].tolist()), name, absorption=absorption)
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
        return Sellmeier(tuple(terms[1::2]), resonances, terms[0], limits, name)

    return build


def _polynomial(squared: bool) -> Formula:
    def build(terms: list[float], limits: tuple[float, float], name: str) -> Medium:
        pairs = zip(terms[2::2], terms[1::2], strict=True)
        return PowerSeries(((0.0, terms[0]), *((power, a) for power, a in pairs)), squared, limits, name)

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
    absorption, thermal = _makers_absorption(row), _thermal(row)
    if "formula" in row:
        low, high = row["range_um"]
        law = _FORMULAS[f"formula {row['formula']}"](row["coefficients"], (1e3 * low, 1e3 * high), label)
        return replace(law, absorption=absorption, thermal=thermal)
    wavelengths, values = zip(*row["n"], strict=True)
    return TabulatedIndex(tuple(1e3 * w for w in wavelengths), values, label, absorption=absorption, thermal=thermal)


def bundled_thermal(medium: Medium) -> Thermal | None:
    """Return the thermal data of SCHOTT for a glass of the bundled table; None for others."""
    glass = glasses_of("schott").get(plain_glass_name(medium.name)) if GLASSES.get(medium.name) == medium else None
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
    return Thermal(dispersion, row.get("expansion"), row.get("temperature_c", STANDARD_C))


def _makers_absorption(row: dict[str, Any]) -> Absorption | None:
    """Return the absorption of a table of extinction coefficients, None without one."""
    table = row.get("k")
    return Absorption.from_extinction(*np.array(table).T) if table and len(table) > 1 else None


@lru_cache(maxsize=len(MAKERS))
def _makers_text(maker: str) -> str:
    path = glass_catalogues_dir() / f"{maker}.jsonl"
    try:
        return path.read_text("utf-8")
    except OSError as problem:
        raise StateError(f"{path}: the installation is incomplete ({problem.strerror}); reinstall it") from problem


# Which glass a name means: of the bundled table, a maker's catalogue, by an alias, or as the heir of an old one.

_BUNDLED = {plain_glass_name(name): name for name in GLASSES}
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
    if named.written in GLASSES:
        return GLASSES[named.written]
    return law_of(_entry(named), named.written)


def near_names(name: str, count: int = 3) -> list[str]:
    """Return the glasses whose names are most like a name, with their makers."""
    known = {
        plain: f"{glass.name} ({maker.upper()})"
        for maker in reversed(MAKERS)
        for plain, glass in glasses_of(maker).items()
    }
    known |= {plain: f"{written} (SCHOTT)" for plain, written in _BUNDLED.items() if written not in _NO_MAKER}
    known |= {plain_glass_name(written): written for written in _NO_MAKER}
    return [known[plain] for plain in difflib.get_close_matches(plain_glass_name(name), known, n=count, cutoff=0.5)]


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
