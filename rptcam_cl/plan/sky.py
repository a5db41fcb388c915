"""The clear sky of Preetham, Shirley and Smits, «A practical analytic model for daylight», SIGGRAPH 1999, and its sun.

Luminance and chromaticity of the sky follow Perez's five-parameter formula with the paper's coefficients.
The sun is a black body of 5772 K (IAU 2015) behind the paper's atmosphere: Rayleigh and aerosol scattering and ozone;
the weak absorption by water vapour and mixed gases is left out. Both are absolute; 683 lm are 1 W.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LUMENS_PER_WATT, WAVELENGTHS_NM, Spectrum, blackbody, srgb_from_spectrum, srgb_from_xyz
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.scene import SkyEnvironment

Array = NDArray[np.float64]
SUN_KELVIN = 5772.0
SUN_RADIUS_DEGREES = 0.2666  # seen from the mean distance of the Earth
ROWS, COLUMNS = 256, 512

# Rows A to E of the distribution, each the factor of turbidity and the constant; for luminance Y and chromaticity x, y.
_PEREZ = {
    "Y": ((0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)),
    "x": ((-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)),
    "y": ((-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)),
}
# Chromaticity of the zenith: rows for turbidity squared, turbidity, 1; columns for the sun's angle from it cubed to 1.
_ZENITH = {
    "x": ((0.00166, -0.00375, 0.00209, 0.0), (-0.02903, 0.06377, -0.03202, 0.00394),
          (0.11693, -0.21196, 0.06052, 0.25886)),
    "y": ((0.00275, -0.00610, 0.00317, 0.0), (-0.04214, 0.08970, -0.04153, 0.00516),
          (0.15346, -0.26756, 0.06670, 0.26688)),
}  # fmt: skip
# Absorption of ozone [1/cm] every 10 nm from 450 nm (Chappuis band), as the paper tabulates it.
_OZONE = (
    0.003, 0.006, 0.009, 0.014, 0.021, 0.030, 0.040, 0.048, 0.063, 0.075, 0.085, 0.103, 0.120, 0.120, 0.115, 0.125,
    0.120, 0.105, 0.090, 0.079, 0.067, 0.057, 0.048, 0.036, 0.028, 0.023, 0.018, 0.014, 0.011, 0.010, 0.009, 0.007,
    0.004,
)  # fmt: skip
_OZONE_CM = 0.35


@dataclass(frozen=True, eq=False)
class Sky:
    """A baked sky.

    Attributes
    ----------
    radiance : (ROWS, COLUMNS, 3) array
        [W/(m² sr)] of a picture of the whole sphere, the top row first; below the horizon the ground.
    sun_irradiance : (3,) array
        Of the sun on a surface that faces it [W/m²].
    """

    radiance: NDArray[np.float32]
    sun_irradiance: Array


def bake_sky(sky: SkyEnvironment) -> Sky:
    """Return a sky whose sun stands over the middle column of the picture."""
    zenith_angle = np.deg2rad(90 - sky.sun_elevation_degrees)
    polar = (np.arange(ROWS // 2) + 0.5) * np.pi / ROWS
    longitude = ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5) * 2 * np.pi
    cosine = np.cos(polar)[:, None]
    towards = cosine * np.cos(zenith_angle) + np.sin(polar)[:, None] * np.sin(zenith_angle) * np.cos(longitude)
    above = sky_radiance(cosine, np.clip(towards, -1, 1), zenith_angle, sky.turbidity)
    sun = sun_irradiance(zenith_angle, sky.turbidity)
    weights = np.cos(polar) * np.sin(polar) * (np.pi / ROWS) * (2 * np.pi / COLUMNS)
    arriving = np.einsum("ijk,i->k", above, weights) + (sun * np.cos(zenith_angle) if sky.sun else 0.0)
    ground = np.broadcast_to(np.array(sky.ground_albedo) * arriving / np.pi, above.shape)
    radiance = sky.gain * np.concatenate([above, ground])
    return Sky(radiance.astype(np.float32), sky.gain * sun)


def sky_radiance(cosine: Array, towards: Array, zenith_angle: float, turbidity: float) -> Array:
    """Return the radiance of the sky [W/(m² sr)], linear sRGB.

    Parameters
    ----------
    cosine
        Of the angle from the zenith, above 0.
    towards
        Cosine of the angle from the sun.
    zenith_angle
        Of the sun from the zenith [rad].
    turbidity
        Of the air.
    """
    chi = (4 / 9 - turbidity / 120) * (np.pi - 2 * zenith_angle)
    zenith = {"Y": 1000 * ((4.0453 * turbidity - 4.9710) * np.tan(chi) - 0.2155 * turbidity + 2.4192)}  # cd/m²
    powers = np.array([zenith_angle**3, zenith_angle**2, zenith_angle, 1.0])
    for name, matrix in _ZENITH.items():
        zenith[name] = float(np.array([turbidity**2, turbidity, 1.0]) @ np.array(matrix) @ powers)
    values = {}
    for name, rows in _PEREZ.items():
        a, b, c, d, e = (slope * turbidity + constant for slope, constant in rows)
        gamma = np.arccos(towards)
        value = (1 + a * np.exp(b / cosine)) * (1 + c * np.exp(d * gamma) + e * towards**2)
        at_zenith = (1 + a * np.exp(b)) * (1 + c * np.exp(d * zenith_angle) + e * np.cos(zenith_angle) ** 2)
        values[name] = zenith[name] * value / at_zenith
    luminance, x, y = np.maximum(values["Y"], 0.0), values["x"], values["y"]
    xyz = np.stack([luminance * x / y, luminance, luminance * (1 - x - y) / y], axis=-1)
    return np.asarray(np.maximum(xyz @ srgb_from_xyz().T, 0.0) / LUMENS_PER_WATT)


def sun_irradiance(zenith_angle: float, turbidity: float) -> Array:
    """Return the irradiance of the sun's direct light on a surface that faces it [W/m²], linear sRGB."""
    return np.maximum(srgb_from_spectrum(sun_spectrum(zenith_angle, turbidity)), 0.0)


def sun_spectrum(zenith_angle: float, turbidity: float) -> Spectrum:
    """Return the same per wavelength [W/(m² nm)], (401,)."""
    spectrum = np.pi * np.sin(np.deg2rad(SUN_RADIUS_DEGREES)) ** 2 * blackbody(SUN_KELVIN)
    microns, degrees = WAVELENGTHS_NM * 1e-3, np.rad2deg(zenith_angle)
    mass = 1 / (np.cos(zenith_angle) + 0.15 * (93.885 - degrees) ** -1.253)
    depth = 0.008735 * microns**-4.08 + (0.04608 * turbidity - 0.04586) * microns**-1.3
    depth += np.interp(WAVELENGTHS_NM, 450 + 10 * np.arange(len(_OZONE)), _OZONE, left=0.0, right=0.0) * _OZONE_CM
    return np.asarray(spectrum * np.exp(-mass * depth))
