"""What surrounds the scene, as a record; of a picture also how light sampling picks its bright parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LUMENS_PER_WATT, colour
from rptcam_cl.core.colour import Spectrum, luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import ENVIRONMENT, EnvironmentKind, TexelFormat, curves, fill
from rptcam_cl.rendering.plan.textures import PICTURES, Colours, KnownSpectra, TextureTable, linear_codes, unpack_texels
from rptcam_cl.scene.lights import ConstantEnvironment, GradientEnvironment, ImageEnvironment, SkyEnvironment
from rptcam_cl.scene.quantities import Colour
from rptcam_cl.scene.scene import Scene

#
# The clear sky of Preetham, Shirley and Smits, «A practical analytic model for daylight», SIGGRAPH 1999, and its sun.
#
# Luminance and chromaticity of the sky follow Perez's five-parameter formula with the paper's coefficients. The sun
# is a black body of 5772 K (IAU 2015) behind the paper's atmosphere: Rayleigh and aerosol scattering and ozone; the
# weak absorption by water vapour and mixed gases is left out. Both are absolute; 683 lm are 1 W.

Array = NDArray[np.float64]
_SUN_KELVIN = 5772.0
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


def bake_sky(sky: SkyEnvironment) -> tuple[NDArray[np.float32], Array]:
    """Bake a sky whose sun stands over the middle column of the picture.

    Returns
    -------
    radiance : (ROWS, COLUMNS, 3) array
        [W/(m² sr)] of a picture of the whole sphere, the top row first; below the horizon the ground.
    sun_irradiance : (3,) array
        Of the sun on a surface that faces it [W/m²].
    """
    zenith_angle = np.deg2rad(90 - sky.sun_elevation_degrees)
    polar = (np.arange(ROWS // 2) + 0.5) * np.pi / ROWS
    longitude = ((np.arange(COLUMNS) + 0.5) / COLUMNS - 0.5) * 2 * np.pi
    cosine = np.cos(polar)[:, None]
    towards = cosine * np.cos(zenith_angle) + np.sin(polar)[:, None] * np.sin(zenith_angle) * np.cos(longitude)
    above = _sky_radiance(cosine, np.clip(towards, -1, 1), zenith_angle, sky.turbidity)
    sun = sun_irradiance(zenith_angle, sky.turbidity)
    weights = np.cos(polar) * np.sin(polar) * (np.pi / ROWS) * (2 * np.pi / COLUMNS)
    arriving = np.einsum("ijk,i->k", above, weights) + (sun * np.cos(zenith_angle) if sky.sun else 0.0)
    ground = np.broadcast_to(np.array(sky.ground_albedo) * arriving / np.pi, above.shape)
    radiance = sky.gain * np.concatenate([above, ground])
    return radiance.astype(np.float32), sky.gain * sun


def _sky_radiance(cosine: Array, towards: Array, zenith_angle: float, turbidity: float) -> Array:
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
    return np.asarray(np.maximum(xyz @ colour.srgb_from_xyz().T, 0.0) / LUMENS_PER_WATT)


def sun_irradiance(zenith_angle: float, turbidity: float) -> Array:
    """Return the irradiance of the sun's direct light on a surface that faces it [W/m²], linear sRGB."""
    return np.maximum(colour.srgb_from_spectrum(_sun_spectrum(zenith_angle, turbidity)), 0.0)


def _sun_spectrum(zenith_angle: float, turbidity: float) -> Spectrum:
    """Return the same per wavelength [W/(m² nm)], (401,)."""
    spectrum = np.pi * np.sin(np.deg2rad(SUN_RADIUS_DEGREES)) ** 2 * colour.blackbody(_SUN_KELVIN)
    microns, degrees = colour.WAVELENGTHS_NM * 1e-3, np.rad2deg(zenith_angle)
    mass = 1 / (np.cos(zenith_angle) + 0.15 * (93.885 - degrees) ** -1.253)
    depth = 0.008735 * microns**-4.08 + (0.04608 * turbidity - 0.04586) * microns**-1.3
    depth += (
        np.interp(colour.WAVELENGTHS_NM, 450 + 10 * np.arange(len(_OZONE)), _OZONE, left=0.0, right=0.0) * _OZONE_CM
    )
    return np.asarray(spectrum * np.exp(-mass * depth))


MOST_CELLS = (1024, 2048)  # rows and columns that light sampling tells apart: 24 MB of tables
LARGEST_SECOND_MOMENT = 1.08  # of light samples by cells that are joined, over that by cells of a texel
_MOST_UNSAMPLED = 1e-3  # of their squares, in cells that light samples leave to the BSDF
LEAST_CONTRAST = 1e-6  # share of a picture's light above its mean: less is rounding


@dataclass(frozen=True)
class Surroundings:
    """The environment for the kernels.

    Attributes
    ----------
    kind : EnvironmentKind
    record : array of one Environment
    distribution : array of float32
        Tables of `_sampling_tables`, also of a picture without light; one zero where there is none.
    flux : float
        Integral over all directions of the radiance that light sampling takes on [W/m², luminance]; else 0.
    sun : two (3,) arrays, or None
        Unit direction to the middle of a sun that shines in addition, and its irradiance on a surface that faces it
        [W/m²].
    """

    kind: EnvironmentKind
    record: NDArray[np.void]
    distribution: NDArray[np.float32]
    flux: float
    sun: tuple[Array, Array] | None = None


@dataclass(frozen=True, eq=False)
class _Brightness:
    """What light sampling knows of a picture: rows and columns of cells, tables; the integral over the sphere of the
    picture's brightness, and of what light sampling takes on of it."""

    cells: tuple[int, int]
    tables: NDArray[np.float32]
    total: float
    sampled: float

    @classmethod
    def of(cls, colours: Colours) -> _Brightness:
        shares = joined_cells(cell_shares(_brightness_of(colours)))
        above = compensate(shares)
        tables = _sampling_tables(above)
        tables.flags.writeable = False
        return cls((shares.shape[0], shares.shape[1]), tables, float(shares.sum()), float(above.sum()))

    @property
    def nbytes(self) -> int:
        return self.tables.nbytes


def pack_environment(scene: Scene, textures: TextureTable, spectra: KnownSpectra) -> Surroundings:
    """Return the environment of a scene; add its picture to the textures."""
    record = ENVIRONMENT.zeros(1)
    nothing = np.zeros(1, np.float32)

    def light(radiance: Colour) -> tuple[float, ...]:
        return (*radiance, spectra.number(radiance, light=True))

    match scene.environment:
        case GradientEnvironment() as gradient:
            up = np.asarray(gradient.up) / np.linalg.norm(gradient.up)
            fill(record, bottom=light(gradient.bottom), top=light(gradient.top), up=up)
            return Surroundings(EnvironmentKind.GRADIENT, record, nothing, 0.0)
        case ConstantEnvironment() as constant:
            fill(record, bottom=light(constant.radiance))
            return Surroundings(EnvironmentKind.CONSTANT, record, nothing, 0.0)
        case ImageEnvironment() as image:
            colours = textures.colours(image, "rgb", image.color_space)
            record["texture"] = textures.add_sphere(colours, image.gain)
            return _of_picture(record, colours, axes(image.up, image.rotation_degrees), image.gain)
        case SkyEnvironment() as sky:
            return _of_sky(record, sky, textures)
    return Surroundings(EnvironmentKind.NONE, record, nothing, 0.0)


def _of_picture(record: NDArray[np.void], colours: Colours, directions: Array, gain: float) -> Surroundings:
    """Return the surroundings of a picture, given where its right, up and forward point."""
    right, up, forward = directions
    fill(record, right=right, up=up, forward=forward)
    brightness = PICTURES.find_or_make(f"brightness {colours.name}", lambda: _Brightness.of(colours))
    record["rows"], record["columns"] = brightness.cells
    if brightness.total <= 0 or gain <= 0:  # the tables are for kernels of one that shines, see `serve`
        return Surroundings(EnvironmentKind.NONE, record, brightness.tables, 0.0)
    return Surroundings(EnvironmentKind.IMAGE, record, brightness.tables, gain * brightness.sampled)


def _of_sky(record: NDArray[np.void], sky: SkyEnvironment, textures: TextureTable) -> Surroundings:
    radiance, sun_light = bake_sky(sky)
    colours = Colours.of(radiance, TexelFormat.HALF, f"sky {sky.model_dump_json()}")
    record["texture"] = textures.add_sphere(colours)
    directions = axes(sky.up, sky.sun_azimuth_degrees)
    surroundings = _of_picture(record, colours, directions, 1.0)
    elevation = np.deg2rad(sky.sun_elevation_degrees)
    towards = np.cos(elevation) * directions[2] + np.sin(elevation) * directions[1]
    return replace(surroundings, sun=(towards, sun_light)) if sky.sun else surroundings


def axes(up: tuple[float, float, float], rotation_degrees: float) -> Array:
    """Return the directions right, up and forward of a picture of the sphere, as rows.

    The turn that takes +y to ``up`` the short way takes +x to right and -z to forward: with +y up the picture is what
    an environment camera sees that looks along -z. Then all turns about ``up``, counter-clockwise seen from above.
    """
    y = np.asarray(up, dtype=np.float64)
    y = y / np.linalg.norm(y)
    if y[1] < -1 + 1e-12:
        turn = np.diag([1.0, -1.0, -1.0])
    else:
        cross = np.array([[0.0, y[0], 0.0], [-y[0], 0.0, -y[2]], [0.0, y[2], 0.0]])
        turn = np.eye(3) + cross + cross @ cross / (1 + y[1])
    angle = np.deg2rad(rotation_degrees)
    right, forward = turn[:, 0], -turn[:, 2]
    turned_right = np.cos(angle) * right + np.sin(angle) * forward
    turned_forward = np.cos(angle) * forward - np.sin(angle) * right
    return np.stack([turned_right, y, turned_forward])


def cell_shares(brightness: Array) -> Array:
    """Return the integral of brightness over the solid angle of each cell that sampling tells apart.

    Parameters
    ----------
    brightness
        Of the texels of a picture of the sphere, shape (height, width), the top row first.

    Returns
    -------
    array
        Rows from the bottom. Between the centres of texels the picture is bilinear, so that a texel gives an eighth of
        its brightness to each neighbour's cell, along rows and along columns.
    """
    height, width = brightness.shape
    sides = np.roll(brightness, 1, axis=1) + np.roll(brightness, -1, axis=1)
    across = 0.75 * brightness + 0.125 * sides
    above, below = np.vstack([across[:1], across[:-1]]), np.vstack([across[1:], across[-1:]])
    smooth = (0.75 * across + 0.125 * (above + below))[::-1]
    bands = -np.diff(np.cos(np.linspace(0, np.pi, height + 1))) * (2 * np.pi / width)
    rows, columns = min(height, MOST_CELLS[0]), min(width, MOST_CELLS[1])
    return _gather(_gather(smooth * bands[:, None], rows, 0), columns, 1)


def compensate(shares: Array) -> Array:
    """The light of each cell above the mean brightness of the sphere; nothing where all is even.

    Directions chosen by the BSDF find the rest, and MIS leaves it to them: light samples are for the bright parts of a
    picture (Karlík et al., «MIS compensation», ACM TOG 38(6) 2019).
    """
    rows, columns = shares.shape
    bands = -np.diff(np.cos(np.linspace(0, np.pi, rows + 1))) * (2 * np.pi / columns)
    total = shares.sum()
    above = np.maximum(shares - (total / (4 * np.pi) * bands)[:, None], 0.0)
    return above if above.sum() > LEAST_CONTRAST * total else np.zeros_like(shares)


def joined_cells(shares: Array) -> Array:
    """Return the shares of squares of cells, the largest by which light samples are nearly as good.

    Small tables stay in the processor's caches: a picture of light takes 0.92 of the time so, 0.7 beside other work.
    """
    fine = compensate(shares)
    both, size = np.stack([fine**2, shares]), 1
    while fine.any() and both.shape[1] % 2 == both.shape[2] % 2 == 0:
        rows = both[:, ::2] + both[:, 1::2]
        both, size = rows[:, :, ::2] + rows[:, :, 1::2], 2 * size
        squares, coarse = both[0], compensate(both[1])
        lit = coarse > 0
        second_moment = size**2 * (squares[lit] / coarse[lit]).sum() * coarse.sum() / fine.sum() ** 2
        if second_moment > LARGEST_SECOND_MOMENT or squares[~lit].sum() > _MOST_UNSAMPLED * squares.sum():
            break
        shares = both[1]
    return shares


def _gather(values: Array, count: int, axis: int) -> Array:
    """Return the sums of values over ``count`` equal parts of an axis; a value that straddles parts is split."""
    length = values.shape[axis]
    if count == length:
        return values
    sums = np.concatenate([np.zeros_like(np.take(values, [0], axis)), np.cumsum(values, axis=axis)], axis=axis)
    edges = np.linspace(0, length, count + 1)
    before = np.minimum(edges.astype(np.int64), length - 1)
    part = np.expand_dims(edges - before, 1 - axis)
    low, high = np.take(sums, before, axis), np.take(sums, before + 1, axis)
    return np.diff(low + part * (high - low), axis=axis)


def _sampling_tables(shares: Array) -> NDArray[np.float32]:
    """The tables that ``kernels/light/environment.h`` reads.

    One after the other: the curve of the rows, those of the cells of each row, and the density of each cell per solid
    angle, times the sine of the angle from the poles.
    """
    rows, columns = shares.shape
    over_rows, row_chance = curves(shares.sum(axis=1)[None])
    over_columns, column_chance = curves(shares)
    density = row_chance[0, :, None] * column_chance * (rows * columns / (2 * np.pi**2))
    return np.concatenate([over_rows.ravel(), over_columns.ravel(), density.ravel()]).astype(np.float32)


def _brightness_of(colours: Colours) -> Array:
    """Return the luminance of every texel of a picture, shape (height, width)."""
    weights = colour.LUMINANCE.astype(np.float32)
    texels = unpack_texels(colours.words, colours.size, colours.form)
    if colours.form is TexelFormat.HALF:
        return np.asarray(colours.scale * (texels.astype(np.float32) @ weights), dtype=np.float64)
    codes = linear_codes(colours.form)
    return np.asarray(sum(codes[texels[..., index]] * weights[index] for index in range(3)), dtype=np.float64)


# Bright parts of a picture around the scene, as distant points of light: a sun, lamps, windows.

_CONTRAST = 50.0  # times the mean of the sphere, from which a texel is bright
_ACROSS_DEGREES = 1.0  # of the cells within which bright texels make one point


_NO_PARTS = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2, 3))


def bright_parts(scene: Scene) -> tuple[Array, Array, Array]:
    """Return the bright parts of a scene's picture; none where the surroundings are no picture, or an even one.

    Returns
    -------
    towards, irradiance : (n, 3) arrays
        Unit directions towards them, and light across that [W/m2].
    sides : (n, 2, 3) array
        Of a square of directions about each, of its solid angle.
    """
    image = scene.environment
    if not isinstance(image, ImageEnvironment):
        return _NO_PARTS
    colours = TextureTable(scene).colours(image, "rgb", image.color_space)
    light = _linear(colours)
    height, width = light.shape[:2]
    elevation = np.pi * (0.5 - (np.arange(height) + 0.5) / height)
    solid = np.cos(elevation)[:, None] * np.ones(width)
    brightness = luminance(light)
    bright = brightness > _CONTRAST * np.average(brightness, weights=solid)
    rows, columns = np.nonzero(bright)
    if not len(rows):
        return _NO_PARTS
    angle = 2 * np.pi * ((columns + 0.5) / width - 0.5)
    up = elevation[rows]
    local = np.stack([np.cos(up) * np.sin(angle), np.sin(up), np.cos(up) * np.cos(angle)], axis=1)
    towards = local @ axes(image.up, image.rotation_degrees)
    solid_angle = np.cos(up) * 2 * np.pi / width * np.pi / height
    flux = image.gain * light[rows, columns] * solid_angle[:, None]
    cell = max(round(height * _ACROSS_DEGREES / 180), 1)
    _, place = np.unique((rows // cell) * width + columns // cell, return_inverse=True)
    irradiance = np.stack([np.bincount(place, part) for part in flux.T], axis=1)
    middle = np.stack([np.bincount(place, part * luminance(flux)) for part in towards.T], axis=1)
    towards = np.asarray(middle / np.linalg.norm(middle, axis=1)[:, None], np.float64)
    across = np.cross(axes(image.up, image.rotation_degrees)[1], towards)
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
    size = np.sqrt(np.bincount(place, solid_angle))[:, None, None]
    sides = size * np.stack([across, np.cross(towards, across)], axis=1)
    return towards, np.asarray(irradiance, np.float64), sides


def _linear(colours: Colours) -> Array:
    """Return the linear light (height, width, 3) of a picture, the top row first."""
    texels = unpack_texels(colours.words, colours.size, colours.form)
    if colours.form is TexelFormat.HALF:
        return np.asarray(colours.scale * texels.astype(np.float64))
    return np.asarray(linear_codes(colours.form)[texels], dtype=np.float64)
