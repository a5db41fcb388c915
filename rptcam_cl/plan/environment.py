"""What surrounds the scene, as a record; of a picture also how light sampling picks its bright parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LUMINANCE
from rptcam_cl.core.curves import curves
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kinds import EnvironmentKind, TexelFormat
from rptcam_cl.core.records import ENVIRONMENT
from rptcam_cl.plan.optical_constants import KnownSpectra
from rptcam_cl.plan.pictures import Colours, remembered
from rptcam_cl.plan.sky import bake_sky
from rptcam_cl.plan.texels import linear_codes, unpacked
from rptcam_cl.plan.textures import TextureTable
from rptcam_cl.scene import ConstantEnvironment, GradientEnvironment, ImageEnvironment, Scene, SkyEnvironment

Array = NDArray[np.float64]
MOST_CELLS = (1024, 2048)  # rows and columns that light sampling tells apart: 24 MB of tables
LEAST_CONTRAST = 1e-6  # share of a picture's light above its mean: less is rounding


@dataclass(frozen=True, eq=False)
class DistantSun:
    """The sun of a sky.

    Attributes
    ----------
    towards : (3,) array
        Unit direction to its middle.
    irradiance : (3,) array
        On a surface that faces it [W/m²].
    """

    towards: Array
    irradiance: Array


@dataclass(frozen=True)
class Surroundings:
    """The environment for the kernels.

    Attributes
    ----------
    kind : EnvironmentKind
    record : array of one Environment
    distribution : array of float32
        Tables of `sampling_tables`; one zero where there are none.
    flux : float
        Integral over all directions of the radiance that light sampling takes on [W/m², luminance]; else 0.
    sun : DistantSun or None
                Shines in addition.
    """

    kind: EnvironmentKind
    record: NDArray[np.void]
    distribution: NDArray[np.float32]
    flux: float
    sun: DistantSun | None = None


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
        shares = cell_shares(brightness_of(colours))
        above = compensated(shares)
        tables = sampling_tables(above)
        tables.flags.writeable = False
        return cls((shares.shape[0], shares.shape[1]), tables, float(shares.sum()), float(above.sum()))

    @property
    def nbytes(self) -> int:
        return self.tables.nbytes


def pack_environment(scene: Scene, textures: TextureTable, spectra: KnownSpectra) -> Surroundings:
    """Return the environment of a scene; add its picture to the textures."""
    record = ENVIRONMENT.zeros(1)
    nothing = np.zeros(1, np.float32)
    match scene.environment:
        case GradientEnvironment() as gradient:
            record["bottom"][0, :3], record["top"][0, :3] = gradient.bottom, gradient.top
            record["bottom"][0, 3] = spectra.number(gradient.bottom, light=True)
            record["top"][0, 3] = spectra.number(gradient.top, light=True)
            record["up"][0, :3] = np.asarray(gradient.up) / np.linalg.norm(gradient.up)
            return Surroundings(EnvironmentKind.GRADIENT, record, nothing, 0.0)
        case ConstantEnvironment() as constant:
            record["bottom"][0, :3] = constant.radiance
            record["bottom"][0, 3] = spectra.number(constant.radiance, light=True)
            return Surroundings(EnvironmentKind.CONSTANT, record, nothing, 0.0)
        case ImageEnvironment() as image:
            colours = textures.pictures.colours(image, "rgb", image.color_space)
            record["texture"] = textures.add_sphere(colours, image.gain)
            return _of_picture(record, colours, axes(image.up, image.rotation_degrees), image.gain)
        case SkyEnvironment() as sky:
            return _of_sky(record, sky, textures)
    return Surroundings(EnvironmentKind.NONE, record, nothing, 0.0)


def _of_picture(record: NDArray[np.void], colours: Colours, directions: Array, gain: float) -> Surroundings:
    """Return the surroundings of a picture, given where its right, up and forward point."""
    record["right"][0, :3], record["up"][0, :3], record["forward"][0, :3] = directions
    brightness = remembered(f"brightness {colours.name}", lambda: _Brightness.of(colours))
    if brightness.total <= 0 or gain <= 0:
        return Surroundings(EnvironmentKind.NONE, record, np.zeros(1, np.float32), 0.0)
    record["rows"], record["columns"] = brightness.cells
    return Surroundings(EnvironmentKind.IMAGE, record, brightness.tables, gain * brightness.sampled)


def _of_sky(record: NDArray[np.void], sky: SkyEnvironment, textures: TextureTable) -> Surroundings:
    baked = bake_sky(sky)
    colours = Colours.of(baked.radiance, TexelFormat.HALF, f"sky {sky.model_dump_json()}")
    record["texture"] = textures.add_sphere(colours)
    directions = axes(sky.up, sky.sun_azimuth_degrees)
    surroundings = _of_picture(record, colours, directions, 1.0)
    elevation = np.deg2rad(sky.sun_elevation_degrees)
    towards = np.cos(elevation) * directions[2] + np.sin(elevation) * directions[1]
    return replace(surroundings, sun=DistantSun(towards, baked.sun_irradiance)) if sky.sun else surroundings


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
    return _gathered(_gathered(smooth * bands[:, None], rows, 0), columns, 1)


def compensated(shares: Array) -> Array:
    """Return what each cell has above the mean brightness of the sphere; nothing where all is even.

    Directions chosen by the BSDF find the rest, and MIS leaves it to them: light samples are for the bright parts of a
    picture (Karlík et al., «MIS compensation», ACM TOG 38(6) 2019).
    """
    rows, columns = shares.shape
    bands = -np.diff(np.cos(np.linspace(0, np.pi, rows + 1))) * (2 * np.pi / columns)
    total = shares.sum()
    above = np.maximum(shares - (total / (4 * np.pi) * bands)[:, None], 0.0)
    return above if above.sum() > LEAST_CONTRAST * total else np.zeros_like(shares)


def _gathered(values: Array, count: int, axis: int) -> Array:
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


def sampling_tables(shares: Array) -> NDArray[np.float32]:
    """Return what ``kernels/light/environment.h`` reads.

    One after the other: the curve of the rows, those of the cells of each row, and the density of each cell per solid
    angle, times the sine of the angle from the poles.
    """
    rows, columns = shares.shape
    over_rows, row_chance = curves(shares.sum(axis=1)[None])
    over_columns, column_chance = curves(shares)
    density = row_chance[0, :, None] * column_chance * (rows * columns / (2 * np.pi**2))
    return np.concatenate([over_rows.ravel(), over_columns.ravel(), density.ravel()]).astype(np.float32)


def brightness_of(colours: Colours) -> Array:
    """Return the luminance of every texel of a picture, shape (height, width)."""
    weights = LUMINANCE.astype(np.float32)
    texels = unpacked(colours.words, colours.size, colours.form)
    if colours.form is TexelFormat.HALF:
        return np.asarray(colours.scale * (texels.astype(np.float32) @ weights), dtype=np.float64)
    codes = linear_codes(colours.form)
    return np.asarray(sum(codes[texels[..., index]] * weights[index] for index in range(3)), dtype=np.float64)
