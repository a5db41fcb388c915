"""The measurements of a lens, each declared once: what it is asked, how it is printed, and the function that does it.

The commands ``rptcam lens NAME`` and the methods of a lens are made from these declarations. Nothing here imports NumPy
before something is measured.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from rptcam_cl.core import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.optics.charts import Drawing, Measured
    from rptcam_cl.optics.spots import Setting

FDC = (LINE_F_NM, LINE_D_NM, LINE_C_NM)  # [nm]
STEEPEST = 130.0  # degrees; fisheyes see up to 110
MIDDLE_NM = 550.0
HIGHEST = 20  # order of Zernike terms, beyond which rounding shows

# What an option is, by which a command reads its text, and the type of its keyword.
KINDS = {
    "angles": "Sequence[float]",
    "steep angles": "Sequence[float]",
    "angle": "float",
    "wavelengths": "Sequence[float]",
    "numbers": "Sequence[float]",
    "distances": "Sequence[float]",
    "count": "int",
    "length": "float",
    "share": "float",
    "choice": "str",
    "flag": "bool",
}


@dataclass(frozen=True)
class Option:
    """One thing that may be asked of a measurement.

    Attributes
    ----------
    keyword : str
        Of the method.
    kind : str
        One of `KINDS`.
    default : object
        Of the method, and of the command where it has no `printed`.
    help : str
        Of the command.
    flag, metavar : str
        Of the command.
    printed : object
        Default of the command where it prints less than the method returns.
    choices : tuple of str
        Of a choice.
    fault : callable, optional
        Returns what is wrong with a value, nothing where it may be.
    """

    keyword: str
    kind: str
    default: Any
    help: str
    flag: str
    metavar: str = "N"
    printed: Any = None
    choices: tuple[str, ...] = ()
    fault: Callable[[Any], str] | None = None

    def check(self, value: Any, name: str) -> None:
        """Raise an error that calls the option by a name where its value cannot be used."""
        if value is None:
            return
        if KINDS[self.kind].startswith("Sequence") and len(value) == 0:
            raise InputError(f"{name}: is empty (allowed: one value or more)")
        if self.fault is not None and (text := self.fault(value)):
            raise InputError(f"{name}: {text}")


@dataclass(frozen=True)
class Measurement:
    """What can be measured of a lens.

    Attributes
    ----------
    command, method : str
        Names of the command and of the method.
    module : str
        Of the function, which is called like the method: it takes a `Setting` and the options, by keyword, and returns
        a `Measured`.
    help, doc : str
        Of the command, and of the method.
    options : tuple of Option
        In the order of the help.
    columns : mapping
        Heads of the printed table by the keys of its rows; a result has as many of them as it knows.
    key : str
        Of the rows in the JSON answer.
    positional : tuple of str
        Keywords that the method also takes by their place.
    facts : tuple of str
        What else of the result the JSON answer has.
    is_single : bool
        Whether it has one row, printed downwards.
    has_best_focus, has_wavelength, has_coating, has_chart : bool
        Whether the command can move the film to the least spot, choose one wavelength, coat the lens, and plot.
    has_section : bool
        Whether its fields, or rays, lie along y and may lie along x.
    array : str
        Which fact of the result the command writes as ``.npy``.
    """

    command: str
    method: str
    module: str
    help: str
    doc: str
    options: tuple[Option, ...]
    columns: Mapping[str, str]
    key: str
    positional: tuple[str, ...] = ()
    facts: tuple[str, ...] = ()
    is_single: bool = False
    has_best_focus: bool = False
    has_wavelength: bool = False
    has_coating: bool = False
    has_chart: bool = True
    has_section: bool = True
    array: str = ""

    def measure(self, setting: Setting, options: Mapping[str, Any], section: str = "y") -> Measured:
        """Measure a lens in use, with its fields along y or x."""
        from rptcam_cl.optics.aberrations import in_section

        setting = in_section(setting, section)
        function = getattr(importlib.import_module(f"rptcam_cl.optics.{self.module}"), self.method)
        measured: Measured = function(setting, **options)
        return measured

    def signature(self) -> inspect.Signature:
        """The signature of the method."""
        by_keyword = {option.keyword: option for option in self.options}
        keywords = [name for name in by_keyword if name not in self.positional]
        kinds = inspect.Parameter
        parameters = [kinds("self", kinds.POSITIONAL_OR_KEYWORD)]
        for name in (*self.positional, "f_number", "focus_distance_m", *keywords):
            option = by_keyword.get(name)
            default, kind = (None, "float") if option is None else (option.default, KINDS[option.kind])
            parameters.append(
                kinds(
                    name,
                    kinds.POSITIONAL_OR_KEYWORD if name in self.positional else kinds.KEYWORD_ONLY,
                    default=default,
                    annotation=f"{kind} | None" if default is None else kind,
                )
            )
        if self.has_section:
            parameters.append(kinds("section", kinds.KEYWORD_ONLY, default="y", annotation="str"))
        return inspect.Signature(parameters, return_annotation="Measured")


def _fault_of_frequencies(values: Any) -> str:
    right = min(values) >= 0 and max(values) > 0
    return "" if right else "must not be negative, and one must be above 0"


def _fault_of_field(value: float) -> str:
    right = abs(value) <= STEEPEST
    return "" if right else f"got {value:g}; allowed from -{STEEPEST:g} to {STEEPEST:g} degrees"


def _fault_of_order(value: int) -> str:
    return "" if 1 <= value <= HIGHEST else f"got {value}; allowed from 1 to {HIGHEST}"


def _fault_of_distances(values: Any) -> str:
    return "" if min(values) > 0 else f"must be above 0 (got {min(values):g})"


def _fault_of_range(value: float) -> str:
    return "" if 0 < value < float("inf") else f"must be above 0 mm (got {value:g})"


def _field() -> Option:
    text = "angle from the axis in degrees (default: the widest)"
    return Option("field_degrees", "angle", None, text, "--field", "A", fault=_fault_of_field)


def _fields(kind: str = "angles") -> Option:
    text = "angles from the axis in degrees (default: chosen from the lens)"
    return Option("fields", kind, None, text, "--fields", "A,B,…")


def _wavelengths(default: tuple[float, ...]) -> Option:
    shown = ",".join(f"{value:g}" for value in default)
    text = f"in nanometres (default: {shown})"
    return Option("wavelengths_nm", "wavelengths", default, text, "--wavelengths", "W,W,…")


_FIELD_COLUMN = {"field_degrees": "field [°]"}
_WAVELENGTH_COLUMN = {"wavelength_nm": "wavelength [nm]"}
_RAYS = Option("rays", "count", None, "rays across the beam each way (default: as many as the figures need)", "--rays")
_DIFFRACTION = Option(
    "diffraction", "flag", False, "by wave optics, from the path differences of the traced rays (default: by rays)",
    "--diffraction",
)  # fmt: skip

SPOT = Measurement(
    "spot", "spot", "spots",
    "spots on the film: centroid and rms size for fields and wavelengths",
    'Return the size of the spot of each field and wavelength; `about["points"]` has where the rays land [mm].',
    (_wavelengths(FDC), _RAYS, _fields("steep angles")),
    _FIELD_COLUMN | _WAVELENGTH_COLUMN | {
        "rays": "rays", "centroid_x_mm": "x [mm]", "centroid_y_mm": "y [mm]", "rms_um": "rms [µm]", "rms_x_um": "in x",
        "rms_y_um": "in y", "largest_um": "largest", "rms_error_um": "rms ±", "largest_error_um": "largest ±",
    },
    "spots", ("fields", "wavelengths_nm"), has_best_focus=True,
)  # fmt: skip
MTF = Measurement(
    "mtf", "mtf", "spots",
    "modulation transfer from the spots, times what diffraction leaves of it",
    "Return tangential and sagittal modulation of each field; with `diffraction` by wave optics.",
    (
        _wavelengths(FDC), _RAYS, _fields("steep angles"),
        Option(
            "frequencies_per_mm", "numbers", tuple(float(f) for f in range(0, 101, 10)),
            "in cycles per mm on the film; the plot ends at the last (default: 10,20,30,40,50)", "--frequencies",
            "F,F,…", [10.0, 20.0, 30.0, 40.0, 50.0], fault=_fault_of_frequencies,
        ),
        _DIFFRACTION,
    ),
    _FIELD_COLUMN | {
        "frequency_per_mm": "cycles/mm", "tangential": "tangential", "sagittal": "sagittal",
        "tangential_limit": "limit tang.", "sagittal_limit": "limit sag.", "error": "±",
    },
    "mtf", ("frequencies_per_mm", "fields", "wavelengths_nm"), has_best_focus=True,
)  # fmt: skip
PSF = Measurement(
    "psf", "psf", "spots",
    "image of one point by geometrical or wave optics",
    'Return facts of the image of a point; `about["shares"]` is that image (n, n), the light of each square.',
    (
        _wavelengths((LINE_D_NM,)), _RAYS,
        Option("field_degrees", "angle", 0.0, "angle from the axis in degrees (default: 0)", "--field", "A",
               fault=_fault_of_field),
        Option("pixels", "count", 64, "along each side (default: %(default)s)", "--pixels"),
        Option("width_um", "length", None, "side of the image (default: chosen from the spot)", "--width-um", "W"),
        _DIFFRACTION,
    ),
    {}, "psf", ("field_degrees", "wavelengths_nm"), is_single=True, has_best_focus=True, array="shares",
)  # fmt: skip
_WAVEFRONT = Measurement(
    "wavefront", "wavefront", "spots",
    "wavefront at the exit pupil: path differences in wavelengths, and Strehl ratios",
    "Return the rms and the range of the wavefront of each field and wavelength, and its Strehl ratios.",
    (_wavelengths((LINE_D_NM,)), _RAYS, _fields()),
    _FIELD_COLUMN | _WAVELENGTH_COLUMN | {
        "rms_waves": "rms [waves]", "rms_waves_without_tilt": "less tilt", "rms_error_waves": "rms ±",
        "peak_to_valley_waves": "range",
        "strehl": "Strehl", "strehl_at_peak": "at the peak", "range_error_waves": "range ±", "strehl_error": "Strehl ±",
        "chief_y_mm": "y [mm]",
    },
    "wavefronts", ("fields", "wavelengths_nm"), has_best_focus=True,
)  # fmt: skip
SEIDEL = Measurement(
    "seidel", "seidel", "aberrations",
    "Seidel sums of each surface and of the lens: the aberrations of third order, and of colour",
    "Return the Seidel sums of each surface, and of the lens in the last row.",
    (
        _field(),
        _wavelengths((LINE_F_NM, LINE_C_NM)),
        Option("unit", "choice", "sums", "millimetres, waves at the edge of the pupil, or micrometres on the film "
               "(default: %(default)s)", "--unit", choices=("sums", "waves", "transverse")),
    ),
    {
        "surface": "surface", "spherical": "spherical", "coma": "coma", "astigmatism": "astigmatism",
        "petzval": "Petzval", "tangential": "3 ast. + Petzval", "distortion": "distortion",
        "axial_colour": "axial colour", "lateral_colour": "lateral colour",
    },
    "seidel", ("field_degrees", "wavelengths_nm"), facts=("field_degrees", "unit", "lagrange_invariant_mm"),
)  # fmt: skip
PARAXIAL = Measurement(
    "paraxial", "paraxial", "aberrations",
    "marginal and chief ray to first order: heights and slopes on each surface, and the y-ybar diagram",
    "Return heights and slopes of the marginal and the chief ray before each surface, and on the film in the last row.",
    (_field(),),
    {
        "surface": "surface", "marginal_mm": "y [mm]", "marginal_slope": "u", "chief_mm": "ybar [mm]",
        "chief_slope": "ubar",
    },
    "paraxial", ("field_degrees",), facts=("field_degrees",),
)  # fmt: skip
_ZERNIKE = Measurement(
    "zernike", "zernike", "aberrations",
    "Zernike coefficients of the wavefront over the field, by their fringe numbers and by Noll's",
    "Return the Zernike coefficients of the wavefront of each field and wavelength.",
    (
        _wavelengths((LINE_D_NM,)), _RAYS, _fields(),
        Option("order", "count", 8, "highest power of the radius (default: %(default)s)", "--order", printed=6,
               fault=_fault_of_order),
    ),
    _FIELD_COLUMN | _WAVELENGTH_COLUMN | {
        "n": "n", "m": "m", "fringe": "fringe", "fringe_waves": "[waves]", "error_waves": "±",
        "noll": "Noll", "noll_waves": "rms [waves]",
        "rest_waves": "rest [waves]",
    },
    "zernike", ("fields", "wavelengths_nm"), has_best_focus=True,
)  # fmt: skip
VIGNETTING = Measurement(
    "vignette", "vignetting", "field_measures",
    "how the film darkens towards its edge, by the pupil and by cos^4",
    "Return how the film darkens from the axis to a radius, that of the image circle by default.",
    (
        Option("film_radius_mm", "length", None, "how far (default: image circle)", "--film-radius-mm", "R"),
        Option("steps", "count", 16, "radii (default: %(default)s)", "--steps"),
    ),
    {
        "film_radius_mm": "radius [mm]", "irradiance": "irradiance", "relative": "relative", "relative_error": "±",
        "stops": "stops",
        "angle_degrees": "angle [°]", "cos4": "cos^4", "pass_area_mm2": "pass area [mm²]", "pass_share": "share",
    },
    "vignetting", ("film_radius_mm", "steps"), has_wavelength=True,
)  # fmt: skip
_DISTORTION = Measurement(
    "distortion", "distortion", "field_measures",
    "where chief rays meet the film against an ideal projection, and lateral colour",
    "Return film heights against an ideal projection, and lateral colour.",
    (
        _fields("steep angles"), _wavelengths(FDC),
        Option(
            "projection", "choice", None,
            "ideal height: f tan(angle), f angle, 2 f tan(angle/2), 2 f sin(angle/2) or f sin(angle) "
            "(default: tan, and for wide lenses that bend lines what they follow best)", "--projection",
            choices=("tan", "theta", "stereographic", "equisolid", "orthographic"),
        ),
    ),
    _FIELD_COLUMN | _WAVELENGTH_COLUMN | {
        "height_mm": "height [mm]", "ideal_mm": "ideal [mm]", "distortion_mm": "off [mm]",
        "distortion_percent": "off [%]", "lateral_colour_um": "colour [µm]",
    },
    "distortion", ("fields", "wavelengths_nm"), ("projection",),
)  # fmt: skip
RAY_FAN = Measurement(
    "ray-fan", "ray_fan", "aberrations",
    "ray fans: where tangential and sagittal rays land beside the chief ray",
    "Return where the rays of the tangential (1) and sagittal (0) fan land beside the chief ray [um].",
    (
        _wavelengths(FDC), _fields(),
        Option("rays", "count", 41, "of a fan (default: %(default)s)", "--rays", printed=11),
    ),
    _FIELD_COLUMN | _WAVELENGTH_COLUMN | {"tangential": "tangential", "pupil": "pupil", "off_um": "off [µm]",
                                          "ahead_waves": "ahead [waves]"},
    "ray_fans", ("fields", "wavelengths_nm"), has_best_focus=True,
)  # fmt: skip
_FIELD_CURVATURE = Measurement(
    "field-curvature", "field_curvature", "aberrations",
    "where thin tangential and sagittal pencils are sharp, and astigmatism",
    "Return where thin tangential and sagittal pencils are sharp, from the film away from the lens [mm].",
    (_wavelengths((LINE_D_NM,)), _fields()),
    _FIELD_COLUMN | _WAVELENGTH_COLUMN | {
        "tangential_mm": "tangential [mm]", "sagittal_mm": "sagittal [mm]", "astigmatism_mm": "astigmatism [mm]",
    },
    "field_curvature", ("fields", "wavelengths_nm"), has_best_focus=True,
)  # fmt: skip
_FOCAL_SHIFT = Measurement(
    "focal-shift", "focal_shift", "aberrations",
    "where light of each wavelength meets the axis, paraxial and by zones of the pupil",
    "Return where light of each wavelength and zone meets the axis, from the film away from the lens [mm].",
    (_wavelengths((400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0)),),
    _WAVELENGTH_COLUMN | {"zone": "zone", "shift_mm": "shift [mm]"},
    "focal_shift", ("wavelengths_nm",), has_best_focus=True,
)  # fmt: skip
_THROUGH_FOCUS = Measurement(
    "through-focus", "through_focus", "aberrations",
    "rms spot of each field over shifts of the film",
    "Return the rms spot of each field over shifts of the film up to a range either way.\n\n"
    "By default the range is ten times the f-number in hundredths of a millimetre.",
    (
        _wavelengths(FDC), _RAYS, _fields(),
        Option("range_mm", "length", None, "largest shift either way (default: a tenth of the f-number)", "--range-mm",
               "R", fault=_fault_of_range),
        Option("steps", "count", 41, "places of the film (default: %(default)s)", "--steps", printed=11),
    ),
    _FIELD_COLUMN | {
        "shift_mm": "shift [mm]", "rms_um": "rms [µm]", "rms_x_um": "in x", "rms_y_um": "in y", "rms_error_um": "±",
    },
    "through_focus", ("range_mm", "fields", "wavelengths_nm"), has_best_focus=True,
)  # fmt: skip
_DEPTH_OF_FIELD = Measurement(
    "dof", "depth_of_field", "field_measures",
    "depth of field and hyperfocal distance by traced rays and by the thin-lens formula, and the scale of the lens",
    "Return the depth of field on the axis, by traced rays and by the thin-lens formula, from the object to the film.",
    (
        Option("distances_m", "distances", None, "distances of focus in metres or inf (default: chosen from the lens)",
               "--distances-m", "D,D,…", fault=_fault_of_distances),
        Option("f_numbers", "numbers", None, "f-numbers (default: as it is, and every second full stop)", "--f-numbers",
               "N,N,…", fault=_fault_of_distances),
        Option("circle_mm", "length", 0.0288, "circle of confusion in millimetres (default: %(default)s, of 36x24 mm)",
               "--circle-mm", "C", fault=_fault_of_range),
    ),
    {
        "f_number": "f/", "focus_m": "focus [m]", "blur_mm": "blur there [mm]", "near_m": "near [m]",
        "far_m": "far [m]", "near_thin_m": "near, thin", "far_thin_m": "far, thin",
        "hyperfocal_m": "hyperfocal [m]", "hyperfocal_thin_m": "thin",
    },
    "depth_of_field", ("distances_m", "f_numbers"), has_wavelength=True, has_section=False,
)  # fmt: skip
TRANSMITTANCE = Measurement(
    "transmittance", "transmittance", "field_measures",
    "light that glass and surfaces let through on the axis, and T-numbers",
    "Return the light that glass, bare and coated surfaces let through on the axis, and T-numbers.",
    (_wavelengths((400.0, 450.0, 500.0, 550.0, LINE_D_NM, 600.0, 650.0, 700.0)),),
    _WAVELENGTH_COLUMN | {
        "glass": "glass", "bare": "bare", "coated": "coated", "t_number_bare": "T bare", "t_number_coated": "T coated",
    },
    "transmittance", ("wavelengths_nm",), has_coating=True, has_section=False,
)  # fmt: skip
GLARE = Measurement(
    "glare", "glare", "field_measures",
    "veiling glare index: a black spot in the middle of the film under a hemisphere of even light (ISO 9358)",
    "Return the veiling glare index (ISO 9358) and its parts: light on a black spot under a hemisphere of even light.",
    (
        Option("film_reflectance", "share", 0.0, "share of the light that the film scatters (default: 0)",
               "--film-reflectance", "R"),
        Option("barrel_reflectance", "share", 0.0, "share that rims behind the stop scatter (default: 0)",
               "--barrel-reflectance", "R"),
        _wavelengths((MIDDLE_NM,)),
    ),
    _WAVELENGTH_COLUMN | {"surfaces": "surfaces", "film": "film", "barrel": "barrel", "index": "glare index",
                          "index_error": "±"},
    "glare", ("wavelengths_nm",), has_coating=True, has_chart=False, has_section=False,
)  # fmt: skip

MEASUREMENTS = (
    SPOT, MTF, PSF, _WAVEFRONT, PARAXIAL, SEIDEL, _ZERNIKE, RAY_FAN, _FIELD_CURVATURE, _FOCAL_SHIFT,
    _THROUGH_FOCUS, _DEPTH_OF_FIELD, VIGNETTING, _DISTORTION, TRANSMITTANCE, GLARE,
)  # fmt: skip


def _method(measurement: Measurement) -> Callable[..., Measured]:
    """The method of a lens that measures it."""
    signature = measurement.signature()

    def method(self: Any, *values: Any, **options: Any) -> Measured:
        from rptcam_cl.optics.spots import setting

        bound = signature.bind(self, *values, **options)
        bound.apply_defaults()
        given = dict(bound.arguments)
        for option in measurement.options:
            option.check(given[option.keyword], option.keyword)
        use = setting(given.pop("self"), given.pop("f_number"), given.pop("focus_distance_m"))
        return measurement.measure(use, given, given.pop("section", "y"))

    method.__name__ = method.__qualname__ = measurement.method
    method.__doc__ = measurement.doc
    method.__signature__ = signature  # type: ignore[attr-defined]
    return method


class Measurable:
    """A lens that measures itself.

    All methods take `f_number` to stop down to and `focus_distance_m` from the object to the film; by default the lens
    is wide open and focused at infinity. Fields are angles from the axis [degrees], chosen from the lens by default.
    Wavelengths are nanometres. With `section="x"` fields lie along x, which in results stands for y. They raise
    `InputError` where nothing of any beam comes through, and for empty lists.
    """

    spot = _method(SPOT)
    mtf = _method(MTF)
    psf = _method(PSF)
    wavefront = _method(_WAVEFRONT)
    paraxial = _method(PARAXIAL)
    seidel = _method(SEIDEL)
    zernike = _method(_ZERNIKE)
    ray_fan = _method(RAY_FAN)
    field_curvature = _method(_FIELD_CURVATURE)
    focal_shift = _method(_FOCAL_SHIFT)
    through_focus = _method(_THROUGH_FOCUS)
    depth_of_field = _method(_DEPTH_OF_FIELD)
    vignetting = _method(VIGNETTING)
    distortion = _method(_DISTORTION)
    transmittance = _method(TRANSMITTANCE)
    glare = _method(GLARE)

    def draw(self, *, f_number: float | None = None, focus_distance_m: float | None = None, **view: Any) -> Drawing:
        """Return the lens in cross-section; the rest as in `View`: section, fields, rays, wavelengths_nm, blocked."""
        from rptcam_cl.optics.drawing import View, draw_lens
        from rptcam_cl.optics.spots import setting

        return draw_lens(setting(self, f_number, focus_distance_m), View(**view))  # type: ignore[arg-type]
