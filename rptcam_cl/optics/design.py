"""Lenses from a few wishes: a single lens of a focal length, and an achromatic doublet (Kumar et al. 2024, eqs. 3-12).

Radii are signed here, positive when the centre lies on the film side; the paper writes magnitudes for biconvex and
biconcave lenses. Its eq. 12 lacks a minus sign: an achromat needs P1 / V1 + P2 / V2 = 0.
"""

from __future__ import annotations

import math
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

CONSTRAINTS = ("r1", "r1=r2", "flat r3", "r2=r3")


@dataclass(frozen=True)
class GlassChoice:
    """Index and Abbe number of a glass, and the text that names it in a lens file."""

    index: float
    abbe: float
    entry: Any = None

    def in_file(self) -> Any:
        """Return the `glass` entry of a lens file."""
        return self.entry if self.entry is not None else {"nd": self.index, "vd": self.abbe}


def lensmaker_focal_length(r1: float, r2: float, thickness: float, index: float) -> float:
    """Return the focal length of a single lens in air from its signed radii (eq. 3)."""
    c1, c2 = 1.0 / r1, 1.0 / r2
    power = (index - 1.0) * (c1 - c2 + (index - 1.0) * thickness * c1 * c2 / index)
    return 1.0 / power if power else math.inf


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
    if constraint not in CONSTRAINTS:
        raise InputError(f"unknown constraint {constraint!r}; allowed: {', '.join(CONSTRAINTS)}")
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
