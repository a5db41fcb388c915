"""Tolerances of a lens: how far manufacture may be off, and by what copies of the lens are judged."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from rptcam_cl.scene.base import Alternatives, SceneModel, refuse
from rptcam_cl.scene.lens_settings import MAX_TEXT
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER, list_of

MOST_COPIES = 100_000
MOST_FIELDS = 32

Distribution = Literal["uniform", "normal", "end_point"]
Number = Annotated[int, Field(ge=0, le=10_000), WHOLE_NUMBER]
Numbers = Annotated[tuple[Number, ...], Field(min_length=1, max_length=1000)]
Size = Annotated[float, Field(ge=0, le=1e6), NUMBER]
Share = Annotated[float, Field(ge=0, le=50), NUMBER]
Minutes = Annotated[float, Field(ge=0, le=600), NUMBER]
Wavelength = Annotated[float, Field(ge=200, le=20_000), NUMBER]
FieldAngle = Annotated[float, Field(ge=0, le=60), NUMBER]
Text = Annotated[str, Field(max_length=MAX_TEXT)]

OF_SURFACES = ("radius_percent", "radius_mm", "radius_fringes", "spacing_mm")
OF_ELEMENTS = ("thickness_mm", "thickness_percent", "index", "abbe_percent", "wedge_arcmin", "wedge_um")
OF_EITHER = ("decentre_mm", "tilt_arcmin", "tilt_um")


class Tolerance(SceneModel):
    """How far something may be off, either way. Exactly one quantity."""

    alternatives: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives((*OF_SURFACES, *OF_ELEMENTS, *OF_EITHER), required=True),
        Alternatives(("surfaces", "elements", "group"), required=False),
    )

    radius_percent: Share | None = None
    """Radius of curvature, as a share of it [%]."""

    radius_mm: Size | None = None
    """Radius of curvature [mm]."""

    radius_fringes: Size | None = None
    """The same as fringes of power against a test glass over the clear diameter, at 632.8 nm."""

    spacing_mm: Size | None = None
    """Air space behind a surface, on the axis [mm]."""

    thickness_mm: Size | None = None
    """Thickness of an element on the axis [mm]."""

    thickness_percent: Share | None = None
    """The same as a share of it [%]."""

    index: Annotated[float, Field(ge=0, le=0.1), NUMBER] | None = None
    """Refractive index of a glass, at every wavelength."""

    abbe_percent: Share | None = None
    """Abbe number of a glass, as a share of it [%]."""

    wedge_arcmin: Minutes | None = None
    """Angle between the two surfaces of an element: its second surface tilts [minutes of arc]."""

    wedge_um: Size | None = None
    """The same as the difference of edge thickness over the clear diameter [micrometres]."""

    decentre_mm: Size | None = None
    """How far something stands beside the axis, in any direction [mm]."""

    tilt_arcmin: Minutes | None = None
    """How far something is tilted about its first vertex, in any direction [minutes of arc]."""

    tilt_um: Size | None = None
    """The same as run-out over the clear diameter of its first surface [micrometres]."""

    of: Literal["element", "surface"] = "element"
    """What is decentred or tilted: elements, cemented ones together, or each surface alone."""

    surfaces: Numbers | None = None
    """The surfaces meant, counted from 0; all by default."""

    elements: Numbers | None = None
    """The elements meant, counted from 0; all by default. Cemented ones are decentred and tilted as one."""

    group: Annotated[tuple[Number, Number], BeforeValidator(list_of(2, "[first, last]"))] | None = None
    """First and last of the surfaces that are decentred or tilted together."""

    distribution: Distribution | None = None
    """How copies differ within it; as the whole specification says by default."""

    sigmas: Annotated[float, Field(gt=0, le=10), NUMBER] | None = None
    """Of a normal distribution: how many standard deviations the tolerance is."""

    @property
    def quantity(self) -> str:
        """The key of the quantity."""
        return next(key for key in (*OF_SURFACES, *OF_ELEMENTS, *OF_EITHER) if getattr(self, key) is not None)

    @model_validator(mode="after")
    def _check_whose(self) -> Self:
        quantity = self.quantity
        either = quantity in OF_EITHER
        by_surface = quantity in OF_SURFACES or (either and self.of == "surface")
        wrong: dict[str, str] = {
            "surfaces": "" if by_surface else "elements",
            "elements": "" if not by_surface else "surfaces",
            "group": "" if either else "surfaces" if by_surface else "elements",
        }
        for key, right in wrong.items():
            if getattr(self, key) is not None and right:
                raise refuse(f"does not go with {quantity}", allowed=right, path=(key,))
        if "of" in self.model_fields_set and (not either or self.group is not None):
            allowed = "decentre_mm, tilt_arcmin or tilt_um beside it, and no group"
            raise refuse("says what is decentred or tilted", allowed=allowed, path=("of",))
        if self.group is not None and self.group[0] > self.group[1]:
            raise refuse("begins behind its end", got=list(self.group), allowed="[first, last]", path=("group",))
        return self


class Merit(SceneModel):
    """By what copies are judged."""

    rank_by: Literal["spot", "mtf"] = "spot"
    """What makes one copy better than another: a smaller spot, or a higher modulation."""

    fields_degrees: Annotated[tuple[FieldAngle, ...], Field(min_length=1, max_length=MOST_FIELDS)] | None = None
    """Angles from the axis [degrees]; each beside 0 is seen in four directions. By default the axis, 0.7 of the widest
    field and that."""

    wavelengths_nm: Annotated[tuple[Wavelength, ...], Field(min_length=1, max_length=16)] = (486.13, 587.56, 656.27)
    """Wavelengths, which count equally [nm]."""

    mtf_per_mm: Annotated[float, Field(gt=0, le=1e4), NUMBER] = 30.0
    """Frequency on the film at which modulation is taken [cycles/mm]."""

    rings: Annotated[int, Field(ge=2, le=64), WHOLE_NUMBER] | None = None
    """Rings of rays in a beam; by default, in each field as many as leave spots and modulation where they are."""

    arms: Annotated[int, Field(ge=4, le=256), WHOLE_NUMBER] | None = None
    """About how many rays in a ring; twice as many as rings by default."""


class Tolerances(SceneModel):
    """What may be off in a lens."""

    name: Text = ""
    """What the specification is called."""

    source: Text = ""
    """Where its numbers come from."""

    tolerances: Annotated[tuple[Tolerance, ...], Field(max_length=1000)]
    """The tolerances."""

    distribution: Distribution = "uniform"
    """How copies differ within a tolerance: evenly, normally with the tolerance as the limit, or at its ends."""

    sigmas: Annotated[float, Field(gt=0, le=10), NUMBER] = 2.0
    """How many standard deviations a tolerance is, where the distribution is normal."""

    copies: Annotated[int, Field(ge=10, le=MOST_COPIES), WHOLE_NUMBER] = 1000
    """How many lenses are made."""

    seed: Annotated[int, Field(ge=0, le=2**63 - 1), WHOLE_NUMBER] = 0
    """Which lenses they are."""

    refocus: Annotated[bool, Field(strict=True)] = True
    """Whether the film of each copy is moved to the least spots of all fields together."""

    f_number: Annotated[float, Field(ge=1e-2, le=1e6), NUMBER] | None = None
    """F-number at which copies are judged; wide open by default."""

    focus_distance_m: Annotated[float, Field(ge=1e-9, le=1e12), NUMBER] | None = None
    """Distance from the object to the film [m]; infinity by default."""

    zoom: Annotated[str, Field(max_length=200)] | None = None
    """Position of a zoom lens, by its name; the first by default."""

    merit: Merit = Merit()
    """By what copies are judged."""


_OPTIMAX = "Optimax Systems, Manufacturing Tolerance Chart, {}; spacing as its sag, mounts as its diameter and wedge"


def _grade(name: str, column: str, radius: float, thickness: float, sag: float, play: float, wedge: float,
           melt: tuple[float, float] | None) -> Tolerances:  # fmt: skip
    """Return tolerances by one column of the chart: percent, then millimetres, index and percent of the Abbe number.

    An element may lie beside the axis by half of what its diameter may be too small, and its seat may run out as far as
    its edge.
    """
    of_glass = (Tolerance(index=melt[0]), Tolerance(abbe_percent=melt[1])) if melt else ()
    return Tolerances(
        name=name,
        source=_OPTIMAX.format(column),
        tolerances=(
            Tolerance(radius_percent=radius),
            Tolerance(thickness_mm=thickness),
            Tolerance(spacing_mm=sag),
            *of_glass,
            Tolerance(wedge_um=1e3 * wedge),
            Tolerance(decentre_mm=play / 2),
            Tolerance(tilt_um=1e3 * wedge),
        ),
    )


def grade(name: str) -> Tolerances:
    """Return the tolerances of a grade by its name, of `real_lens.GRADES`; the highest knows its glass by melt data."""
    return {
        "commercial": lambda: _grade(name, "commercial", 0.2, 0.15, 0.05, 0.1, 0.05, (0.001, 0.8)),
        "precision": lambda: _grade(name, "precision", 0.1, 0.05, 0.025, 0.025, 0.01, (0.0005, 0.5)),
        "high_precision": lambda: _grade(name, "high precision", 0.05, 0.025, 0.015, 0.015, 0.005, None),
    }[name]()
