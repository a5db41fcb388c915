"""The measurements of a lens as its methods: the numbers that `rptcam lens` prints, for programs and notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rptcam_cl.core.constants import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.charts import Drawing, Measured, svg_text
from rptcam_cl.optics.image_quality import Setting, setting
from rptcam_cl.optics.lens import Lens

FDC = (LINE_F_NM, LINE_D_NM, LINE_C_NM)  # [nm]
FREQUENCIES = tuple(float(f) for f in range(0, 101, 10))  # cycles per millimetre
FINE = (0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0)  # shares of the widest field
FEW = (0.0, 0.7, 1.0)
THROUGH = 41  # places of the film


class LensDrawing:
    """A lens in cross-section, which draws itself in a notebook."""

    def __init__(self, drawing: Drawing) -> None:
        self.drawing = drawing

    @property
    def svg(self) -> str:
        """The drawing as SVG text."""
        return svg_text(self.drawing)

    def _repr_svg_(self) -> str:
        return self.svg


class Measurable(Lens):
    """A lens that measures itself.

    All methods take `f_number` to stop down to and `focus_distance_m` from the object to the film; by default the lens
    is wide open and focused at infinity. Fields are angles from the axis [degrees], chosen from the lens by default.
    Wavelengths are nanometres. They raise `InputError` where nothing of any beam comes through, and for empty lists.
    """

    def _state(self, f_number: float | None, focus_distance_m: float | None) -> Setting:
        found = setting(self, f_number, focus_distance_m)
        _ = found.film
        return found

    def mtf(
        self,
        frequencies_per_mm: Sequence[float] = FREQUENCIES,
        fields: Sequence[float] | None = None,
        wavelengths_nm: Sequence[float] = FDC,
        *,
        f_number: float | None = None,
        focus_distance_m: float | None = None,
        diffraction: bool = False,
        rays: int | None = None,
    ) -> Measured:
        """Return tangential and sagittal modulation of each field; with `diffraction` by wave optics."""
        from rptcam_cl.optics.image_quality import (
            field_waves,
            film_spots,
            mtf_chart,
            mtf_moves,
            mtf_table,
            wave_mtf_chart,
            wave_mtf_table,
        )

        _check_given(frequencies_per_mm=frequencies_per_mm, fields=fields, wavelengths_nm=wavelengths_nm)
        if not min(frequencies_per_mm) >= 0 or not max(frequencies_per_mm) > 0:
            raise InputError("frequencies_per_mm: must not be negative, and one must be above 0")
        state, highest = self._state(f_number, focus_distance_m), max(frequencies_per_mm)
        if diffraction:
            waves = field_waves(state, fields, wavelengths_nm, rays)
            rows = wave_mtf_table(waves, frequencies_per_mm)
            return Measured.of_rows(
                f"{self.name}: MTF", rows, lambda: wave_mtf_chart(state, waves, highest), **_about(state)
            )
        found = film_spots(state, fields, wavelengths_nm, rays, mtf_moves(frequencies_per_mm))
        rows = mtf_table(found, frequencies_per_mm)
        return Measured.of_rows(f"{self.name}: MTF", rows, lambda: mtf_chart(state, found, highest), **_about(state))

    def spot(
        self,
        fields: Sequence[float] | None = None,
        wavelengths_nm: Sequence[float] = FDC,
        *,
        f_number: float | None = None,
        focus_distance_m: float | None = None,
        rays: int | None = None,
    ) -> Measured:
        """Return the size of the spot of each field and wavelength; `about["points"]` has where the rays land [mm]."""
        from rptcam_cl.optics.image_quality import film_spots, spot_chart, spot_table

        _check_given(fields=fields, wavelengths_nm=wavelengths_nm)
        state = self._state(f_number, focus_distance_m)
        found = film_spots(state, fields, wavelengths_nm, rays)
        points = {(one.field_degrees, one.wavelength_nm): one.points for one in found}
        return Measured.of_rows(
            f"{self.name}: spots", spot_table(found), lambda: spot_chart(state, found),
            points=points, **_about(state),
        )  # fmt: skip

    def psf(
        self,
        field_degrees: float = 0.0,
        wavelengths_nm: Sequence[float] = (LINE_D_NM,),
        *,
        f_number: float | None = None,
        focus_distance_m: float | None = None,
        pixels: int = 64,
        width_um: float | None = None,
        diffraction: bool = False,
        rays: int | None = None,
    ) -> Measured:
        """Return facts of the image of a point; `about["shares"]` is that image (n, n), the light of each square."""
        from rptcam_cl.optics.image_quality import (
            field_waves,
            film_spots,
            image_moves,
            point_image,
            psf_chart,
            wave_point_image,
        )

        _check_given(wavelengths_nm=wavelengths_nm)
        state = self._state(f_number, focus_distance_m)
        if diffraction:
            waves = field_waves(state, [field_degrees], wavelengths_nm, rays)
            image = wave_point_image(waves, pixels, width_um)
        else:
            found = film_spots(state, [field_degrees], wavelengths_nm, rays, image_moves)
            image = point_image(found, pixels, width_um)
        facts: dict[str, Any] = {"field_degrees": field_degrees, "width_um": image.width_um, **image.facts}
        return Measured.of_rows(
            f"{self.name}: image of a point at {field_degrees:g}°", [facts],
            lambda: psf_chart(state, image, field_degrees), shares=image.shares, **_about(state),
        )  # fmt: skip

    def distortion(
        self,
        fields: Sequence[float] | None = None,
        wavelengths_nm: Sequence[float] = FDC,
        *,
        f_number: float | None = None,
        focus_distance_m: float | None = None,
        projection: str | None = None,
    ) -> Measured:
        """Return film heights against an ideal projection, and lateral colour."""
        from rptcam_cl.optics.field_measures import distortion_chart, distortion_table, fields_of, followed_projection

        _check_given(fields=fields, wavelengths_nm=wavelengths_nm)
        state = self._state(f_number, focus_distance_m)
        fields = fields_of(state, fields, FINE)
        name = projection or followed_projection(state, fields)
        rows = distortion_table(state, fields, wavelengths_nm, name)
        return Measured.of_rows(
            f"{self.name}: distortion", rows, lambda: distortion_chart(state, rows, name),
            projection=name, **_about(state),
        )  # fmt: skip

    def vignetting(
        self,
        film_radius_mm: float | None = None,
        steps: int = 16,
        *,
        f_number: float | None = None,
        focus_distance_m: float | None = None,
    ) -> Measured:
        """Return how the film darkens from the axis to a radius, that of the image circle by default."""
        from rptcam_cl.optics.field_measures import film_radii, vignetting_chart, vignetting_table

        state = self._state(f_number, focus_distance_m)
        rows = vignetting_table(state, film_radii(state, steps, film_radius_mm))
        return Measured.of_rows(
            f"{self.name}: vignetting", rows, lambda: vignetting_chart(state, rows), **_about(state)
        )

    def ray_fan(
        self,
        fields: Sequence[float] | None = None,
        wavelengths_nm: Sequence[float] = FDC,
        *,
        f_number: float | None = None,
        focus_distance_m: float | None = None,
        rays: int = 41,
    ) -> Measured:
        """Return where the rays of the tangential (1) and sagittal (0) fan land beside the chief ray [um]."""
        from rptcam_cl.optics.field_measures import curves_over, fan_rows, fields_of

        _check_given(fields=fields, wavelengths_nm=wavelengths_nm)
        state = self._state(f_number, focus_distance_m)
        rows = fan_rows(state, fields_of(state, fields, FEW), wavelengths_nm, rays)
        shown = [row for row in rows if row["tangential"] and row["wavelength_nm"] == wavelengths_nm[0]]
        title = f"{self.name}: tangential ray fans, {wavelengths_nm[0]:g} nm"
        return Measured.of_rows(
            f"{self.name}: ray fans", rows,
            lambda: curves_over(
                title, shown, ("pupil", "place in the beam, from edge to edge"), [("off_um", "degrees")],
                "from the chief ray on the film [µm]", "field_degrees",
            ),
            **_about(state),
        )  # fmt: skip

    def field_curvature(
        self,
        fields: Sequence[float] | None = None,
        wavelengths_nm: Sequence[float] = (LINE_D_NM,),
        *,
        f_number: float | None = None,
        focus_distance_m: float | None = None,
    ) -> Measured:
        """Return where thin tangential and sagittal pencils are sharp, from the film away from the lens [mm]."""
        from rptcam_cl.optics.field_measures import curvature_rows, curves_over, fields_of

        _check_given(fields=fields, wavelengths_nm=wavelengths_nm)
        state = self._state(f_number, focus_distance_m)
        rows = curvature_rows(state, fields_of(state, fields, FINE), wavelengths_nm)
        return Measured.of_rows(
            f"{self.name}: field curvature", rows,
            lambda: curves_over(
                f"{self.name}: field curvature", rows, ("field_degrees", "angle from the axis [degrees]"),
                [("tangential_mm", "nm tangential"), ("sagittal_mm", "nm sagittal")], "behind the film [mm]",
                "wavelength_nm",
            ),
            **_about(state),
        )  # fmt: skip

    def through_focus(
        self,
        range_mm: float | None = None,
        fields: Sequence[float] | None = None,
        wavelengths_nm: Sequence[float] = FDC,
        *,
        f_number: float | None = None,
        focus_distance_m: float | None = None,
        steps: int = THROUGH,
        rays: int | None = None,
    ) -> Measured:
        """Return the rms spot of each field over shifts of the film up to a range either way.

        By default the range is ten times the f-number in hundredths of a millimetre.
        """
        from rptcam_cl.optics.field_measures import curves_over, fields_of, focus_rows

        _check_given(fields=fields, wavelengths_nm=wavelengths_nm)
        if range_mm is not None and not 0 < range_mm < np.inf:
            raise InputError(f"range_mm: must be above 0 mm (got {range_mm:g})")
        state = self._state(f_number, focus_distance_m)
        reach = range_mm or 0.1 * abs(state.lens.first_order().f_number)
        shifts = np.linspace(-reach, reach, steps)
        rows = focus_rows(state, fields_of(state, fields, FEW), wavelengths_nm, shifts, rays)
        return Measured.of_rows(
            f"{self.name}: spots through focus", rows,
            lambda: curves_over(
                f"{self.name}: spots through focus", rows, ("shift_mm", "film away from the lens [mm]"),
                [("rms_um", "degrees")], "rms spot [µm]", "field_degrees",
            ),
            **_about(state),
        )  # fmt: skip

    def draw(self, *, f_number: float | None = None, focus_distance_m: float | None = None, **view: Any) -> LensDrawing:
        """Return the lens in cross-section; the rest as in `View`: section, fields, rays, wavelengths_nm, blocked."""
        from rptcam_cl.optics.drawing import View, draw_lens

        return LensDrawing(draw_lens(setting(self, f_number, focus_distance_m), View(**view)))


def _check_given(**lists: Sequence[float] | None) -> None:
    """Refuse what is given and empty."""
    for name, values in lists.items():
        if values is not None and len(values) == 0:
            raise InputError(f"{name}: is empty (allowed: one value or more)")


def _about(state: Setting) -> dict[str, Any]:
    return {"film_distance_mm": state.film, "object_distance_mm": state.object_distance_mm}
