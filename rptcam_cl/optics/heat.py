"""A lens at another temperature: its glass has another index, and glass and barrel are longer."""

from __future__ import annotations

from dataclasses import replace

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.makers import bundled_thermal
from rptcam_cl.optics.glass import AIR, Heated, Law, Medium, Melt
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.prescription import Configuration, FocusState
from rptcam_cl.optics.shapes import Biconic, Toroid
from rptcam_cl.optics.surface import Surface
from rptcam_cl.optics.thermal import STANDARD_C, STANDARD_HPA, Thermal

# Linear expansion near room temperature [1/K] as handbooks have it (ASM Metals Handbook, vols. 1 and 2) for the usual
# alloys: 6061, C36000, 304, 416, Ti-6Al-4V, Invar 36; polycarbonate as its makers print it (ISO 11359-2).
BARRELS = {
    "aluminium": 23.6e-6, "brass": 20.5e-6, "stainless_steel": 17.3e-6, "steel_416": 9.9e-6, "titanium": 8.6e-6,
    "invar": 1.3e-6, "polycarbonate": 65e-6,
}  # fmt: skip


@dataclass(frozen=True)
class Heat:
    """What a lens is exposed to.

    Attributes
    ----------
    celsius : float
        Temperature of lens, barrel and air.
    pressure_hpa : float
        Of the air.
    barrel_per_k : float
        Linear expansion of what holds the elements and the film [1/K].
    """

    celsius: float = STANDARD_C
    pressure_hpa: float = STANDARD_HPA
    barrel_per_k: float = BARRELS["aluminium"]

    @property
    def barrel_scale(self) -> float:
        """By how much spaces in the barrel are longer than at 20 degrees."""
        return 1.0 + self.barrel_per_k * (self.celsius - STANDARD_C)

    def lens(self, lens: Lens) -> Lens:
        """Return a lens, made and measured at 20 degrees, under this heat; itself where nothing differs.

        Glass keeps its shape and grows, air spaces grow as the barrel does; a cemented surface as the glass behind it.

        Raises
        ------
        InputError
            When a catalogue does not say how a glass changes, or for mirrors, whose body is not known.
        """
        if self.celsius == STANDARD_C and self.pressure_hpa == STANDARD_HPA:
            return lens
        if lens.has_mirrors:
            raise InputError(f"{lens.name}: has mirrors, of which no file says how they expand")
        media = [self._medium(lens, f"surfaces[{k}]", lens.surfaces[k].glass) for k in range(len(lens.surfaces))]
        growth = [self._growth(lens, k) for k in range(len(lens.surfaces))]
        bodies = [growth[k] if s.glass != AIR or k == 0 else growth[k - 1] for k, s in enumerate(lens.surfaces)]
        surfaces = [
            replace(_grown(surface, body), thickness=surface.thickness * gap, glass=medium)
            for surface, body, gap, medium in zip(lens.surfaces, bodies, growth, media, strict=True)
        ]

        def gaps(given: tuple[tuple[int, float], ...]) -> tuple[tuple[int, float], ...]:
            return tuple((k, gap * growth[k]) for k, gap in given)

        def position(given: Configuration) -> Configuration:
            stop = given.stop_diameter_mm
            if stop is not None and lens.stop_index is not None:
                stop *= bodies[lens.stop_index]
            return Configuration(given.name, gaps(given.gaps), stop, tuple(map(focus, given.floating)))

        def focus(given: FocusState) -> FocusState:
            shift = given.film_shift_mm
            return FocusState(given.distance_mm, gaps(given.gaps), None if shift is None else shift * self.barrel_scale)

        group = lens.focusing
        if group is not None:
            least, most = group.travel_mm
            group = replace(group, travel_mm=(least * self.barrel_scale, most * self.barrel_scale))
        return replace(
            lens,
            surfaces=tuple(surfaces),
            focusing=group,
            object_medium=self._medium(lens, "object_medium", lens.object_medium),
            configurations=tuple(position(given) for given in lens.configurations),
            floating=tuple(map(focus, lens.floating)),
        )

    def film(self, film_distance_mm: float) -> float:
        """Return where a film stands, behind the last vertex, that the barrel held at a distance at 20 degrees [mm]."""
        return film_distance_mm * self.barrel_scale

    def _medium(self, lens: Lens, where: str, glass: Medium) -> Medium:
        """Return a medium of a lens, hot."""
        if glass == AIR:
            return glass
        thermal = thermal_of(glass)
        if thermal is None or thermal.dispersion is None:
            key = "thermal: {d: [D0, D1, D2], e: [E0, E1], …}"
            raise _unknown(lens, where, glass, "its index changes with temperature", key)
        assert isinstance(glass, Law)
        return Heated.of(glass, thermal, self.celsius, self.pressure_hpa)

    def _growth(self, lens: Lens, k: int) -> float:
        """Return by how much the space behind a surface is longer."""
        glass = lens.surfaces[k].glass
        if glass == AIR:
            return self.barrel_scale
        thermal = thermal_of(glass)
        if thermal is None or thermal.expansion_per_k is None:
            raise _unknown(lens, f"surfaces[{k}]", glass, "it expands", "expansion_per_k")
        return 1.0 + thermal.expansion_per_k * (self.celsius - STANDARD_C)


def thermal_of(glass: Medium) -> Thermal | None:
    """Return what is known of a glass under heat, by itself or by its name."""
    if isinstance(glass, Melt):
        return thermal_of(glass.glass)
    own = glass.thermal if isinstance(glass, Law) else None
    return own if own is not None else bundled_thermal(glass)


def _unknown(lens: Lens, where: str, glass: Medium, what: str, key: str) -> InputError:
    name = glass.name or "(unnamed)"
    return InputError(
        f"{lens.name}: {where}: nothing says how glass {name} takes heat: how {what}"
        f" (give {key} beside its law, or the name of a glass of SCHOTT, OHARA, HOYA, HIKARI, CDGM or SUMITA)"
    )


def _grown(surface: Surface, scale: float) -> Surface:
    """Return a surface that is larger by a factor, and of the same shape."""
    form, pose, region = surface.form, surface.pose, surface.region
    if isinstance(form, Biconic | Toroid):
        form = replace(form, curvature_x=form.curvature_x / scale)
    if pose is not None:
        x, y, z = pose.offset
        pose = replace(pose, offset=(x * scale, y * scale, z * scale))
    if region is not None:
        width, height = region.half_width * scale, region.half_height * scale
        region = replace(region, half_width=width, half_height=height, edge=region.edge * scale)
    return replace(
        surface,
        curvature=surface.curvature / scale,
        semi_diameter=surface.semi_diameter * scale,
        inner_semi_diameter=surface.inner_semi_diameter * scale,
        aspheric=tuple((power, a * scale ** (1 - power)) for power, a in surface.aspheric),
        form=form,
        pose=pose,
        region=region,
    )
