"""How lenses come to be: single lenses and achromats from closed forms, and the problems that optimisations solve."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rptcam_cl.core import LINE_C_NM, LINE_D_NM, LINE_F_NM, __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders, References
from rptcam_cl.core.strict_yaml import Document, Fields, problem, read_yaml
from rptcam_cl.optics.files.export import lens_text
from rptcam_cl.optics.files.glasses import MAKERS, makers_of
from rptcam_cl.optics.files.native import document_of
from rptcam_cl.optics.glass import AIR
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens, names_a_file
from rptcam_cl.optics.ray_derivatives import follows_derivatives
from rptcam_cl.optics.spots import default_fields, setting

#
# Lenses from a few numbers: a single lens of a focal length, and an achromatic doublet (Kumar et al. 2024, eqs. 3-12).
#
# Radii are signed here, positive when the centre lies on the film side; the paper writes magnitudes for biconvex and
# biconcave lenses. Its eq. 12 lacks a minus sign: an achromat needs P1 / V1 + P2 / V2 = 0.

_CONSTRAINTS = ("r1", "r1=r2", "flat r3", "r2=r3")


@dataclass(frozen=True)
class GlassChoice:
    """Index and Abbe number of a glass, and the text that names it in a lens file."""

    index: float
    abbe: float
    entry: Any = None

    def in_file(self) -> Any:
        """Return the `glass` entry of a lens file."""
        return self.entry if self.entry is not None else {"nd": self.index, "vd": self.abbe}


def image_distances(focal_length: float, object_to_film: float) -> tuple[float, float]:
    """Return the two image distances of a thin lens between an object and a film that distance apart (eqs. 4 and 5).

    The first is the shorter: the lens stands near the film, as in a camera.

    Raises
    ------
    InputError
        When the film is nearer than four focal lengths to the object.
    """
    square = object_to_film * object_to_film - 4.0 * focal_length * object_to_film
    if focal_length <= 0:
        raise InputError(f"a lens of focal length {focal_length:g} forms no real image")
    if square < 0:
        raise InputError(
            f"an object {object_to_film:g} from the film is too near; "
            f"the least distance is four focal lengths, {4 * focal_length:g}"
        )
    far = (object_to_film + math.sqrt(square)) / 2.0
    return focal_length * object_to_film / far, far


def singlet(focal_length_mm: float, glass: GlassChoice, diameter_mm: float, bending: float = 0.0) -> dict[str, Any]:
    """Return the lens file of a single lens as a mapping.

    Parameters
    ----------
    focal_length_mm : float
        Negative for a diverging lens.
    glass : GlassChoice
    diameter_mm : float
    bending : float
        Shape (R2 + R1) / (R2 - R1): 0 equal radii, 1 plane on the film side, -1 plane on the scene side.
    """
    _check_size(focal_length_mm, diameter_mm)
    share1, share2 = (bending + 1.0) / 2.0, (bending - 1.0) / 2.0
    thickness, power = 0.0, 1.0 / focal_length_mm
    for _ in range(100):
        # Curvatures c1 = c share1 and c2 = c share2 with the thick lensmaker's equation solved for c.
        a = (glass.index - 1.0) * thickness * share1 * share2 / glass.index
        wanted = power / (glass.index - 1.0)
        c = 2.0 * wanted / (1.0 + math.sqrt(max(1.0 + 4.0 * a * wanted, 0.0)))
        new = _thickness(c * share1, c * share2, diameter_mm)
        if abs(new - thickness) <= 1e-14 * diameter_mm:
            break
        thickness = new
    return {
        "name": f"Single lens of {focal_length_mm:g} mm",
        "source": "Lensmaker's equation",
        "published": {"focal_length_mm": focal_length_mm},
        "surfaces": [
            _row(c * share1, diameter_mm, thickness, glass.in_file(), stop=True),
            _row(c * share2, diameter_mm),
        ],
    }


def doublet_radii(
    focal_length: float, crown: GlassChoice, flint: GlassChoice, constraint: str = "r1=r2", r1: float = 0.0
) -> tuple[float, float, float]:
    """Return the signed radii of a cemented thin achromat (eqs. 6 to 12); an infinite radius is a plane.

    Parameters
    ----------
    focal_length : float
    crown, flint : GlassChoice
        Scene side first; their Abbe numbers must differ.
    constraint : str
        The third condition: "r1" (given), "r1=r2" (biconvex first lens), "flat r3", "r2=r3" (biconcave second lens).
    r1 : float
        First radius when the constraint is "r1".
    """
    if constraint not in _CONSTRAINTS:
        raise InputError(f"unknown constraint {constraint!r}; allowed: {', '.join(_CONSTRAINTS)}")
    if crown.abbe == flint.abbe:
        raise InputError(f"an achromat needs two Abbe numbers that differ (got {crown.abbe:g} twice)")
    p1 = crown.abbe / ((crown.abbe - flint.abbe) * focal_length)
    p2 = flint.abbe / ((flint.abbe - crown.abbe) * focal_length)
    bend1, bend2 = p1 / (crown.index - 1.0), p2 / (flint.index - 1.0)
    if constraint == "r1":
        if not r1:
            raise InputError("the first radius must be given and not 0")
        c1 = 1.0 / r1
    else:
        c1 = {"r1=r2": bend1 / 2.0, "flat r3": bend1 + bend2, "r2=r3": bend1 + bend2 / 2.0}[constraint]
    c2 = c1 - bend1
    c3 = 0.0 if constraint == "flat r3" else c2 - bend2
    return _radius(c1), _radius(c2), _radius(c3)


def doublet(
    focal_length_mm: float,
    crown: GlassChoice,
    flint: GlassChoice,
    diameter_mm: float,
    constraint: str = "r1=r2",
    r1: float = 0.0,
) -> dict[str, Any]:
    """Return the lens file of a cemented achromat as a mapping: thin-lens radii with real thicknesses."""
    _check_size(focal_length_mm, diameter_mm)
    c1, c2, c3 = (1.0 / radius for radius in doublet_radii(focal_length_mm, crown, flint, constraint, r1))
    return {
        "name": f"Achromatic doublet of {focal_length_mm:g} mm",
        "source": "Thin achromat, Kumar et al. 2024, eqs. 6-12 with the sign of eq. 12 corrected",
        "published": {"focal_length_mm": focal_length_mm},
        "surfaces": [
            _row(c1, diameter_mm, _thickness(c1, c2, diameter_mm), crown.in_file(), stop=True),
            _row(c2, diameter_mm, _thickness(c2, c3, diameter_mm), flint.in_file()),
            _row(c3, diameter_mm),
        ],
    }


def _check_size(focal_length_mm: float, diameter_mm: float) -> None:
    if not math.isfinite(focal_length_mm) or focal_length_mm == 0:
        raise InputError(f"the focal length must be finite and not 0 (got {focal_length_mm:g})")
    if not diameter_mm > 0:
        raise InputError(f"the diameter must be above 0 (got {diameter_mm:g})")


def _radius(curvature: float) -> float:
    return 1.0 / curvature if curvature else math.inf


def _thickness(front: float, rear: float, diameter: float) -> float:
    """Return the thickness that leaves an edge, or for a diverging lens a centre, of a twentieth of the diameter."""
    height = diameter / 2.0
    sags = []
    for curvature in (front, rear):
        inside = 1.0 - (curvature * height) ** 2
        if inside < 0:
            raise InputError(f"a radius of {1 / curvature:.4g} mm is too short for a diameter of {diameter:g} mm")
        sags.append(curvature * height * height / (1.0 + math.sqrt(inside)))
    return max(sags[0] - sags[1], 0.0) + diameter / 20.0


def _row(
    curvature: float, diameter: float, thickness: float | None = None, glass: Any = None, stop: bool = False
) -> dict[str, Any]:
    row: dict[str, Any] = {"diameter": diameter}
    if curvature:
        row["radius"] = 1.0 / curvature
    if thickness is not None:
        row["thickness"] = thickness
    if glass is not None:
        row["glass"] = glass
    if stop:
        row["stop"] = True
    return row


# What makes a lens better: variables, solves, bounds and merit of a problem, read strictly from YAML or a mapping.

Kind = Literal["curvature", "thickness", "conic", "aspheric", "film"]
UNITS = {
    "spot": "µm", "wavefront": "waves", "mtf": "", "distortion": "%", "axial_colour": "mm", "lateral_colour": "µm",
    "focal_length": "mm", "f_number": "", "telecentricity": "°", "as_built": "µm", "picture": "%",
}  # fmt: skip
_TARGETS = {"mtf": "per_mm", "focal_length": "target_mm", "f_number": "target"}
_BOUNDS = ("glass_centre_mm", "glass_edge_mm", "air_centre_mm", "air_edge_mm", "length_mm", "back_focal_mm")
_TOP = (
    "lens", "f_number", "focal_length_mm", "object_distance_mm", "fields_degrees", "field_weights", "wavelengths_nm",
    "wavelength_weights",
    "variables", "pickups", "solves", "film", "bounds", "merit", "search", "evaluations", "rings", "arms",
    "vignetting", "tolerances", "scene", "zones",
)  # fmt: skip
_SHARED = ("curvature", "thickness", "conic")
BOARD = "board"  # the scene that is built in
NO_DETAIL = 1e3  # blur [%] of a zone in which nothing is seen even sharp: less would draw a search there
_MOST_EVALUATIONS = 100_000
THIN = 0.02  # of the focal length: how thin glass may become where nothing is said


@dataclass(frozen=True)
class Variable:
    """One number of a lens that may change; `power` is that of an aspheric coefficient."""

    kind: Kind
    surface: int
    power: int = 0

    @property
    def label(self) -> str:
        """How messages call it."""
        return f"{self.kind} {self.surface}" + (f" r^{self.power}" if self.power else "")


@dataclass(frozen=True)
class Follower:
    """A number that follows another one: factor times it and offset."""

    kind: Kind
    surface: int
    leader: int
    factor: float
    offset: float


@dataclass(frozen=True)
class Solve:
    """A number that follows from a condition: a curvature that holds the focal length, or a gap its edge thickness."""

    kind: Kind
    surface: int
    value: float


@dataclass(frozen=True)
class Term:
    """A part of the merit with its weight, and its target or spatial frequency."""

    name: str
    weight: float
    target: float = 0.0


@dataclass(frozen=True)
class GlassChange:
    """Glass behind a surface that may be replaced: of which makers, and how many neighbours are tried."""

    surface: int
    makers: tuple[str, ...]
    tries: int


@dataclass(frozen=True)
class Hunt:
    """A global search: hops from minimum to minimum, or differential evolution, of some size and with a seed."""

    kind: str = "none"
    count: int = 0
    step: float = 0.1
    seed: int = 0


@dataclass(frozen=True)
class Problem:
    """What is to be made better, by what, within which limits.

    Attributes
    ----------
    lens : Lens
        The start.
    label : str
        The file, or what stands for it.
    object_distance_mm : float
        From the object plane to the first vertex; infinite for far objects.
    holds_focal_length : bool
        Whether the focal length is held where it should be, beside the merit.
    film : str or float
        ``best``, ``paraxial``, or a distance behind the last vertex [mm].
    bounds : mapping of str to (least, most)
    scene : str
        What `picture` is of: a scene file, or ``board``.
    zones : tuple of (left, right, top, bottom)
        Of the picture, in fractions from its left and top; none for squares at the fields, to the right of the middle.
    digest : str
        Of all that the result follows from.
    """

    lens: Lens
    label: str
    f_number: float
    focal_length_mm: float
    object_distance_mm: float
    holds_focal_length: bool
    fields_degrees: tuple[float, ...]
    field_weights: tuple[float, ...]
    wavelengths_nm: tuple[float, ...]
    wavelength_weights: tuple[float, ...]
    variables: tuple[Variable, ...]
    followers: tuple[Follower, ...]
    solves: tuple[Solve, ...]
    film: str | float
    bounds: Mapping[str, tuple[float, float]]
    terms: tuple[Term, ...]
    glasses: tuple[GlassChange, ...]
    hunt: Hunt
    evaluations: int
    rings: int
    arms: int
    vignetting: bool
    tolerances: str
    scene: str
    zones: tuple[tuple[float, ...], ...]
    digest: str

    @property
    def reference(self) -> int:
        """Which of the wavelengths first-order data are of: the one nearest to the d line."""
        return int(np.argmin(np.abs(np.array(self.wavelengths_nm) - LINE_D_NM)))


def read_problem(source: str | Path | Mapping[str, Any]) -> Problem:
    """Return the problem of a YAML file, or of a mapping with the same keys.

    Raises
    ------
    InputError
        With the place and key of whatever cannot be.
    """
    if isinstance(source, Mapping):
        document = document_of({"name": "problem", **source})
        document = replace(document, data={k: v for k, v in document.data.items() if k != "name"})
        folder = Path()
    else:
        folder = Path(source).parent
        document = replace(read_yaml(Path(source)), files=References(Folders(folder, owner="problem")))
    if not isinstance(document.data, dict):
        raise problem(document, (), "expected a mapping with lens, variables and merit", document.data)
    return _Reader(document, folder).problem()


class _Reader:
    """Takes the keys of a problem one by one."""

    def __init__(self, document: Document, folder: Path) -> None:
        self.document, self.top, self.folder = document, Fields(document, (), _TOP), folder
        self.lens = self._lens()
        self.last = len(self.lens.surfaces) - 1

    def problem(self) -> Problem:
        top, lens = self.top, self.lens
        first = lens.first_order()
        solves = tuple(sorted(self._solves(), key=lambda solve: solve.kind == "curvature"))
        self._check_solves(solves)
        terms = tuple(self._terms(first.focal_length_mm))
        held = not any(term.name in ("focal_length", "f_number") for term in terms)
        held = held and not any(solve.kind == "curvature" for solve in solves)
        length = [solve.value for solve in solves if solve.kind == "curvature"]
        length += [term.target for term in terms if term.name == "focal_length"]
        wavelengths = self._list("wavelengths_nm", (LINE_F_NM, LINE_D_NM, LINE_C_NM), 200, 3000)
        f_number = top.positive("f_number", first.f_number)
        fields = self._list("fields_degrees", None, 0, 89) or self._fields()
        variables, glasses = self._variables()
        film = self._film()
        variables += [Variable("film", self.last)] if film == "best" else []
        if not variables and not glasses:
            raise top.fail("variables", "nothing may change")
        variables.sort(key=lambda v: (v.surface, v.kind, v.power))
        followers = tuple(self._followers())
        self._check_twice([*variables, *followers, *solves])
        tolerances = top.text("tolerances")
        if any(term.name == "as_built" for term in terms) and not tolerances:
            raise top.fail(None, "merit.as_built needs tolerances: a grade or a file of them")
        text = json.dumps(self.document.data, sort_keys=True, default=str) + lens_text(lens) + __version__
        return Problem(
            lens, self.document.name, f_number, top.number("focal_length_mm", (length or [first.focal_length_mm])[0]),
            top.positive("object_distance_mm", math.inf), held, fields, self._weights("field_weights", len(fields)),
            wavelengths, self._weights("wavelength_weights", len(wavelengths)), tuple(variables), followers,
            solves, film, self._bounds(), terms, glasses, self._hunt(),
            self._count("evaluations", 400, _MOST_EVALUATIONS), self._count("rings", 4, 40), self._count("arms", 4, 90),
            top.flag("vignetting") if "vignetting" in top else True,
            tolerances, self._scene(), self._zones(), hashlib.sha256(text.encode()).hexdigest(),
        )  # fmt: skip

    def _lens(self) -> Lens:
        given = self.top.get("lens")
        if isinstance(given, dict):
            lens = load_lens(given)
        else:
            name = self.top.text("lens")
            if not name:
                raise self.top.fail(None, "lens is missing: a name of the library, or a lens file")
            lens = load_lens(self.folder / name if names_a_file(name) else name)
        for k, surface in enumerate(lens.surfaces):
            if not follows_derivatives(surface):
                raise self.top.fail("lens", f"surface {k} is no sphere, conic or asphere about the axis that refracts")
        if lens.stop_index is None:
            raise self.top.fail("lens", "has no stop; mark one with stop: true")
        if lens.configurations or lens.floating or lens.fold is not None:
            raise self.top.fail("lens", "zooms, floats or is folded; write one state of it: rptcam lens convert")
        if not math.isfinite(lens.first_order().focal_length_mm):
            raise self.top.fail("lens", "has no focal length")
        return lens

    def _scene(self) -> str:
        name = self.top.text("scene", BOARD)
        return name if name == BOARD else str(self.folder / name)

    def _zones(self) -> tuple[tuple[float, ...], ...]:
        rows = self.top.get("zones") or []
        for row in rows if isinstance(rows, list) else [rows]:
            fits = isinstance(row, list) and len(row) == 4 and all(isinstance(side, int | float) for side in row)
            if not (fits and 0 <= row[0] < row[1] <= 1 and 0 <= row[2] < row[3] <= 1):
                raise self.top.fail("zones", "expected [[left, right, top, bottom], …] from 0 to 1")
        return tuple(tuple(float(side) for side in row) for row in rows)

    def _fields(self) -> tuple[float, ...]:
        try:
            return tuple(float(f) for f in default_fields(setting(self.lens)))
        except InputError as trouble:
            raise self.top.fail(None, f"fields_degrees is missing, and the lens has none ({trouble})") from None

    def _list(self, key: str, default: tuple[float, ...] | None, low: float, high: float) -> tuple[float, ...]:
        if key not in self.top:
            return default or ()
        values = self.top.numbers(key)
        if not all(low <= value <= high for value in values) or len(set(values)) < len(values):
            raise self.top.fail(key, f"expected different numbers from {low:g} to {high:g}")
        return values

    def _weights(self, key: str, count: int) -> tuple[float, ...]:
        values = self.top.numbers(key) if key in self.top else (1.0,) * count
        if len(values) != count or min(values) < 0 or not sum(values) > 0:
            raise self.top.fail(key, f"expected {count} numbers from 0 up, not all 0")
        return values

    def _count(self, key: str, default: int, most: int) -> int:
        value = self.top.number(key, default)
        if value % 1 or not 1 <= value <= most:
            raise self.top.fail(key, f"expected a whole number from 1 to {most}")
        return int(value)

    def _surface(self, fields: Fields, key: str, last: int) -> int:
        value = fields.number(key)
        if value % 1 or not 0 <= value <= last:
            raise fields.fail(key, f"expected a surface from 0 to {last}")
        return int(value)

    def _variables(self) -> tuple[list[Variable], tuple[GlassChange, ...]]:
        if "variables" not in self.top:
            raise self.top.fail(None, "variables is missing, such as {curvatures: all, thicknesses: [1, 3]}")
        inner = self.top.inner("variables", ("curvatures", "thicknesses", "conics", "aspheric", "glasses"))
        result: list[Variable] = []
        plural: tuple[tuple[str, Kind, int], ...] = (
            ("curvatures", "curvature", self.last), ("thicknesses", "thickness", self.last - 1),
            ("conics", "conic", self.last),
        )  # fmt: skip
        for key, kind, last in plural:
            if inner.get(key) == "all":
                chosen = [k for k in range(last + 1) if self._matters(kind, k)]
            else:
                chosen = [int(k) for k in inner.numbers(key)] if inner.get(key) else []
                if any(not 0 <= k <= last for k in chosen):
                    raise inner.fail(key, f"expected all, or surfaces from 0 to {last}")
            result += [Variable(kind, k) for k in chosen]
        for k, path in (
            inner.paths_by_number("aspheric", 0, self.last, "no such surface") if "aspheric" in inner else []
        ):
            powers = self.document.data["variables"]["aspheric"][path[-1]]
            if not isinstance(powers, list) or not all(isinstance(p, int) and 2 <= p <= 30 for p in powers):
                raise problem(self.document, path, "expected powers of r from 2 to 30, such as [4, 6]", powers)
            result += [Variable("aspheric", k, p) for p in powers]
        return result, tuple(self._glasses(inner))

    def _matters(self, kind: Kind, k: int) -> bool:
        """Whether a number of surface k is one that `all` means: no curvature of a stop in air, no gap of 0."""
        if kind == "thickness":
            return self.lens.surfaces[k].thickness != 0
        return self.lens.media[k] != self.lens.media[k + 1] and (
            kind == "curvature" or self.lens.surfaces[k].conic != 0
        )

    def _glasses(self, inner: Fields) -> Iterator[GlassChange]:
        if "glasses" not in inner:
            return
        for k, path in inner.paths_by_number("glasses", 0, self.last - 1, "no such surface"):
            row = Fields(self.document, path, ("makers", "tries"))
            if self.lens.surfaces[k].glass == AIR:
                raise problem(self.document, path, "air is behind this surface")
            given = row.get("makers") or ["schott"]
            makers: list[str] = []
            for maker in given if isinstance(given, list) else [given]:
                found = makers_of(str(maker))
                if not found:
                    raise row.fail("makers", f"allowed: {', '.join(MAKERS)}")
                makers += found
            tries = row.number("tries", 4)
            if tries % 1 or not 1 <= tries <= 50:
                raise row.fail("tries", "expected a whole number from 1 to 50")
            yield GlassChange(k, tuple(makers), int(tries))

    def _followers(self) -> Iterator[Follower]:
        example = "[{curvature: 5, follows: 0, factor: -1}]"
        for row in self.top.rows("pickups", (*_SHARED, "follows", "factor", "offset"), example):
            kind = self._one_of(row, _SHARED)
            last = self.last - (kind == "thickness")
            k, leader = self._surface(row, kind, last), self._surface(row, "follows", last)
            if k == leader:
                raise row.fail("follows", "a number cannot follow itself")
            yield Follower(kind, k, leader, row.number("factor", 1.0), row.number("offset", 0.0))  # type: ignore[arg-type]

    def _solves(self) -> Iterator[Solve]:
        example = "[{curvature: 5, focal_length_mm: 50}]"
        for row in self.top.rows("solves", ("curvature", "thickness", "focal_length_mm", "edge_mm"), example):
            kind = self._one_of(row, ("curvature", "thickness"))
            key = "focal_length_mm" if kind == "curvature" else "edge_mm"
            if key not in row:
                raise row.fail(None, f"a {kind} is solved for {key}")
            k = self._surface(row, kind, self.last - (kind == "thickness"))
            if kind == "curvature" and self.lens.media[k] == self.lens.media[k + 1]:
                raise row.fail(kind, "light does not bend there")
            yield Solve(kind, k, row.number(key))  # type: ignore[arg-type]

    def _check_solves(self, solves: Sequence[Solve]) -> None:
        bends = [solve.surface for solve in solves if solve.kind == "curvature"]
        if len(bends) > 1:
            raise self.top.fail("solves", "one curvature alone is solved for the focal length")
        for solve in solves:
            if solve.kind == "thickness" and any(k in (solve.surface, solve.surface + 1) for k in bends):
                raise self.top.fail(
                    "solves", f"the edge behind surface {solve.surface} ends at a curvature that is solved"
                )

    def _one_of(self, row: Fields, names: Sequence[str]) -> str:
        given = [name for name in names if name in row]
        if len(given) != 1:
            raise row.fail(None, f"needs exactly one of {', '.join(names)}")
        return given[0]

    def _film(self) -> str | float:
        given = self.top.get("film")
        if isinstance(given, dict):
            return self.top.inner("film", ("distance_mm",)).positive("distance_mm")
        if given not in (None, "best", "paraxial"):
            raise self.top.fail("film", "allowed: best, paraxial, or {distance_mm: 40}")
        return given or "best"

    def _bounds(self) -> dict[str, tuple[float, float]]:
        if "bounds" not in self.top:
            return {}
        inner = self.top.inner("bounds", _BOUNDS)
        result = {}
        for key in inner.value:
            values = inner.numbers(key) if isinstance(inner.get(key), list) else (inner.number(key), math.inf)
            if len(values) != 2 or not values[0] < values[1]:
                raise inner.fail(key, "expected the least value, or [least, most]")
            result[key] = (values[0], values[1])
        return result

    def _terms(self, length: float) -> Iterator[Term]:
        inner = self.top.inner("merit", UNITS) if "merit" in self.top else None
        if inner is None:
            yield Term("spot", 1.0)
            return
        if not inner.value:
            raise self.top.fail("merit", f"needs one of {', '.join(UNITS)}")
        for name in inner.value:
            if not isinstance(inner.get(name), dict):
                if name in _TARGETS and name != "focal_length":
                    raise inner.fail(name, f"needs {{weight: 1, {_TARGETS[name]}: …}}")
                yield Term(name, inner.positive(name), self.top.number("focal_length_mm", length))
                continue
            key = _TARGETS.get(name)
            row = inner.inner(name, ("weight", key) if key else ("weight",))
            default = self.top.number("focal_length_mm", length) if name == "focal_length" else None
            yield Term(name, row.positive("weight", 1.0), row.positive(key, default) if key else 0.0)

    def _hunt(self) -> Hunt:
        if "search" not in self.top:
            return Hunt()
        row = self.top.inner("search", ("kind", "count", "step", "seed"))
        kind = row.text("kind", "hops")
        if kind not in ("hops", "evolution"):
            raise row.fail("kind", "allowed: hops (basin hopping), evolution (differential evolution)")
        count, seed = row.number("count", 10), row.number("seed", 1)
        if count % 1 or not 1 <= count <= 10_000:
            raise row.fail("count", "expected a whole number from 1 to 10000")
        if seed % 1 or seed < 0:
            raise row.fail("seed", "expected a whole number from 0 up")
        return Hunt(kind, int(count), row.positive("step", 0.1), int(seed))

    def _check_twice(self, every: Sequence[Variable | Follower | Solve]) -> None:
        seen: set[tuple[str, int, int]] = set()
        for one in every:
            place = (one.kind, one.surface, getattr(one, "power", 0))
            if place in seen:
                raise self.top.fail(None, f"{one.kind} {one.surface} is variable, follows or is solved for twice")
            seen.add(place)
