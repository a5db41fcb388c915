"""Which glass a name means: of the bundled table, a maker's catalogue, by an alias, or as the heir of an old one."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.makers import MAKERS, MakersGlass, glasses_of, law_of, plain_glass_name
from rptcam_cl.optics.glass import Law
from rptcam_cl.optics.glass_table import GLASSES

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
        """Return what a reader should know of how `name` was taken, nothing where there was no choice."""
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
    found: list[str] = []
    for word in catalogues:
        makers = makers_of(word)
        if not makers:
            known = ", ".join(maker.upper() for maker in MAKERS)
            raise InputError(f"no glass catalogue {word!r} comes with the package (allowed: {known})")
        found += makers
    return tuple(found)


def named_glass(name: str, makers: Sequence[str] = (), successors: bool = False) -> Named | None:
    """Return which glass a name means, None when no catalogue has it.

    Parameters
    ----------
    name : str
        Such as ``N-BK7``, ``nbk7_schott`` or ``F2_HIKARI``; hyphens, blanks, quotes and case do not count.
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
            return Named(_written(plain, maker), maker, is_chosen=True)
    if successors and (found := _successor(plain, makers or ("schott",))):
        return found
    for maker in MAKERS:
        if plain in glasses_of(maker):
            return Named(_written(plain, maker), maker)
    if plain in _ALIASES and (found := named_glass(_ALIASES[plain])):
        return Named(found.written, found.maker, False)
    return _successor(plain, tuple(_PREFIXES)) if successors else None


def other_name(name: str) -> tuple[Any, str] | None:
    """Return the `glass` entry and its words for a name that no catalogue has: that of a substance with the author of
    its measurement behind it, as in refractiveindex.info (``CAF2_DAIMON-20``), or of a glass of SCHOTT's of old."""
    base, _, last = name.strip(" '\"").replace(" ", "_").partition("_")
    found = named_glass(f"{base}-{last}") or named_glass(base) if last else None
    if found is not None and found.maker in ("", "plastic"):
        return found.written, found.written
    code = _RETIRED.get(plain_glass_name(base)) if makers_of(last or "schott") == ("schott",) else None
    if code is None:
        return None
    nd, vd = 1 + int(code[:3]) / 1000, int(code[3:]) / 10
    return {"nd": nd, "vd": vd}, f"{nd:g} / {vd:g}, the code {code} of SCHOTT's old catalogues"


def glass_named(name: str) -> Law | None:
    """Return the law of a glass by the name that `Named.written` has, or by any other that `named_glass` knows."""
    found = named_glass(name)
    if found is None:
        return None
    if found.written in GLASSES:
        return GLASSES[found.written]
    return law_of(_entry(found), found.written)


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


def near_glasses(nd: float, vd: float, makers: Sequence[str] = (), count: int = 3) -> list[MakersGlass]:
    """Return the glasses nearest to an index and an Abbe number, 0.001 in the one counting as 0.5 in the other."""

    def distance(glass: MakersGlass) -> float:
        assert glass.nd is not None and glass.vd is not None
        return math.hypot((glass.nd - nd) / 1e-3, (glass.vd - vd) / 0.5)

    known = [glass for maker in makers or MAKERS for glass in glasses_of(maker).values() if glass.nd and glass.vd]
    return sorted(known, key=distance)[:count]


def near_glass_words(nd: float, vd: float) -> str:
    """Return the nearest glass in words: ``N-BK7 (SCHOTT) 1.5168 / 64.17``."""
    glass = near_glasses(nd, vd, count=1)[0]
    return f"{glass.name} ({glass.maker.upper()}) {glass.nd:g} / {glass.vd:.4g}"


def _entry(found: Named) -> MakersGlass:
    base, _, last = found.written.rpartition("_")
    plain = plain_glass_name(base if base and makers_of(last) else found.written)
    return glasses_of(found.maker)[plain]


def _written(plain: str, maker: str) -> str:
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
                    return Named(_written(rest, maker), maker, False)
    return None
