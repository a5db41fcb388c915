"""Spectra: lights, metals and reflectances from 380 to 780 nm, and what the eye makes of them."""

from rptcam_cl.spectra.grid import WAVELENGTHS_NM, Spectrum, lines_on_grid, on_grid
from rptcam_cl.spectra.illuminants import (
    COOLEST_DAYLIGHT,
    HOTTEST_DAYLIGHT,
    ILLUMINANTS,
    blackbody,
    daylight,
    illuminant,
    planck_radiance,
)
from rptcam_cl.spectra.metals import METALS, metal_optics
from rptcam_cl.spectra.observer import (
    cie_1931,
    daylight_65,
    luminance,
    srgb_from_reflectance,
    srgb_from_spectrum,
    srgb_from_xyz,
    within_srgb,
    xyz_from_spectrum,
)
from rptcam_cl.spectra.upsampling import reflectance_from_srgb, rgb_basis

__all__ = [
    "COOLEST_DAYLIGHT",
    "HOTTEST_DAYLIGHT",
    "ILLUMINANTS",
    "METALS",
    "WAVELENGTHS_NM",
    "Spectrum",
    "blackbody",
    "cie_1931",
    "daylight",
    "daylight_65",
    "illuminant",
    "lines_on_grid",
    "luminance",
    "metal_optics",
    "on_grid",
    "planck_radiance",
    "reflectance_from_srgb",
    "rgb_basis",
    "srgb_from_reflectance",
    "srgb_from_spectrum",
    "srgb_from_xyz",
    "within_srgb",
    "xyz_from_spectrum",
]
