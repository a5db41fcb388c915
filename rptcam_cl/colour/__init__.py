"""Spectra: lights, metals and reflectances from 380 to 780 nm, and what the eye makes of them."""

from rptcam_cl.colour.constants import LUMINANCE, colour_luminance
from rptcam_cl.colour.illuminants import (
    COOLEST_DAYLIGHT,
    HOTTEST_DAYLIGHT,
    ILLUMINANTS,
    blackbody,
    daylight,
    illuminant,
    planck_radiance,
)
from rptcam_cl.colour.metals import METALS, metal_optics
from rptcam_cl.colour.observer import (
    cie_1931,
    daylight_65,
    luminance,
    srgb_from_reflectance,
    srgb_from_spectrum,
    srgb_from_xyz,
    within_srgb,
    xyz_from_spectrum,
)
from rptcam_cl.colour.response import electrons_per_joule, response_curves
from rptcam_cl.colour.spaces import (
    BRADFORD,
    RGB_FROM_XYZ,
    SRGB_PRIMARIES,
    SRGB_WHITE,
    XYZ_FROM_RGB,
    Matrix,
    adaptation,
    pixel_luminance,
    xyz_of,
)
from rptcam_cl.colour.spectrum import WAVELENGTHS_NM, Spectrum, lines_on_grid, on_grid, reflectance_from_srgb, rgb_basis
from rptcam_cl.core.constants import LINE_C_NM, LINE_D_NM, LINE_F_NM, LUMENS_PER_WATT

__all__ = [
    "BRADFORD",
    "COOLEST_DAYLIGHT",
    "HOTTEST_DAYLIGHT",
    "ILLUMINANTS",
    "LINE_C_NM",
    "LINE_D_NM",
    "LINE_F_NM",
    "LUMENS_PER_WATT",
    "LUMINANCE",
    "METALS",
    "RGB_FROM_XYZ",
    "SRGB_PRIMARIES",
    "SRGB_WHITE",
    "WAVELENGTHS_NM",
    "XYZ_FROM_RGB",
    "Matrix",
    "Spectrum",
    "adaptation",
    "blackbody",
    "cie_1931",
    "colour_luminance",
    "daylight",
    "daylight_65",
    "electrons_per_joule",
    "illuminant",
    "lines_on_grid",
    "luminance",
    "metal_optics",
    "on_grid",
    "pixel_luminance",
    "planck_radiance",
    "reflectance_from_srgb",
    "response_curves",
    "rgb_basis",
    "srgb_from_reflectance",
    "srgb_from_spectrum",
    "srgb_from_xyz",
    "within_srgb",
    "xyz_from_spectrum",
    "xyz_of",
]
