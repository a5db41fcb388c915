"""Files of measured reflection: MERL's tables, and tensor files of RGL, as tables by the half vector."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import WAVELENGTHS_NM, srgb_from_reflectance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

Array = NDArray[np.float64]

_LARGEST_FILE = 1 << 30
_LARGEST_VALUE = 1e9  # of a BRDF [1/sr]: facets of the least alpha that we draw by have 2e4
_MERL = (90, 90, 180)  # half angles, difference angles, turns in half a circle
_MERL_SCALE = np.array([1.0, 1.15, 1.66]) / 1500
_OF_TENSORS = (90, 45, 36)  # cells that tensor files are sampled to
_SMALLEST_ALPHA = 0.004  # of the facets that directions are drawn by
_TENSOR_KINDS = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<u8", 8: "<i8", 9: "<f2", 10: "<f4",
                 11: "<f8"}  # fmt: skip
_NOT_FINITE = "holds numbers that are not finite"


@dataclass(frozen=True, eq=False)
class MeasuredTable:
    """BRDF of a material that has no direction of its own.

    Attributes
    ----------
    values : (half angles, difference angles, turns, 3) array of float32
        Linear sRGB [1/sr], in the middles of cells: even in the root of the half angle up to a right angle, in the
        difference angle, and in half a circle of turns of the difference vector.
    albedo : (3,) array
        Share of light along the normal that is reflected.
    alpha, gloss : float
        GGX's alpha of facets that reflect about as glossily, and the share of directions that are to be drawn by them.
    """

    values: NDArray[np.float32]
    albedo: Array
    alpha: float
    gloss: float

    @property
    def words(self) -> NDArray[np.uint32]:
        """The numbers of cells and the values, as the kernels read them."""
        head = np.array(self.values.shape[:3], np.uint32)
        return np.concatenate([head, self.values.ravel().view(np.uint32)])

    @property
    def nbytes(self) -> int:
        """Bytes of the values."""
        return self.values.nbytes


def read_measured(source: Path | bytes) -> MeasuredTable:
    """Return the table of a file.

    Raises
    ------
    InputError
        When it is neither a table of MERL nor a tensor file of a material without a direction of its own.
    """
    try:
        raw = source if isinstance(source, bytes) else source.read_bytes()
    except OSError as problem:
        raise InputError(f"cannot be read ({problem.strerror})") from None
    if len(raw) > _LARGEST_FILE:
        raise InputError(f"is too large (allowed: {_LARGEST_FILE} bytes)")
    values = _of_tensors(_tensors(raw)) if raw.startswith(b"tensor_file\0") else _of_merl(raw)
    if not np.max(values) < _LARGEST_VALUE:
        raise InputError(f"holds numbers that are no reflection (allowed: below {_LARGEST_VALUE:g} / sr)")
    return MeasuredTable(np.ascontiguousarray(values, np.float32), *_figures(values))


def _of_merl(raw: bytes) -> Array:
    """Return the values of a MERL file; cells below the horizon, which it has as -1, are as the last above it."""
    sizes = struct.unpack("<3i", raw[:12]) if len(raw) >= 12 else ()
    if sizes != _MERL or len(raw) != 12 + 24 * math.prod(_MERL):
        raise InputError("is no measured reflection (allowed: MERL's .binary of 90 x 90 x 180 cells, RGL's .bsdf)")
    values = np.moveaxis(np.frombuffer(raw, "<f8", offset=12).reshape(3, *_MERL), 0, -1) * _MERL_SCALE
    if not np.isfinite(values).all():
        raise InputError(_NOT_FINITE)
    return np.maximum(_continue_values(values, np.min(values, axis=-1) >= 0), 0)


def _continue_values(values: Array, known: NDArray[Any]) -> Array:
    """Return values of which those that are not known are as the last at a smaller difference angle that is."""
    place = np.maximum.accumulate(np.where(known, np.arange(known.shape[1])[:, None], 0), axis=1)
    return np.asarray(np.take_along_axis(values, place[..., None], axis=1))


def _tensors(raw: bytes) -> dict[str, NDArray[Any]]:
    """Return the fields of a tensor file, whose shapes fit together."""
    fields: dict[str, NDArray[Any]] = {}
    try:
        (count,) = struct.unpack_from("<I", raw, 14)
        place = 18
        for _ in range(count):
            (length,) = struct.unpack_from("<H", raw, place)
            name = raw[place + 2 : place + 2 + length].decode("ascii")
            axes, kind, offset = struct.unpack_from("<HBQ", raw, place + 2 + length)
            place += 13 + length
            shape = struct.unpack_from(f"<{axes}Q", raw, place)
            place += 8 * axes
            fields[name] = np.frombuffer(raw, _TENSOR_KINDS[kind], math.prod(shape), offset).reshape(shape)
    except (struct.error, KeyError, ValueError, OverflowError) as problem:
        raise InputError(f"is no whole tensor file ({problem})") from None
    _check_tensors(fields)
    return fields


def _check_tensors(fields: dict[str, NDArray[Any]]) -> None:
    """Refuse fields that are no material."""
    colours = "rgb" if "rgb" in fields else "spectra"
    axes = {"phi_i": "p", "theta_i": "t", "ndf": "yx", "sigma": "yx", "vndf": "ptyx", colours: "ptcyx"}
    if colours == "spectra":
        axes["wavelengths"] = "c"
    if missing := [name for name in axes if name not in fields]:
        raise InputError(f"is no tensor file of a material: lacks {', '.join(missing)}")
    if fields["phi_i"].size > 2:
        raise InputError("is of a material with a direction of its own (allowed: measurements of a single azimuth)")
    sizes = {name: dict(zip(letters, fields[name].shape, strict=False)) for name, letters in axes.items()}
    count = {"p": sizes["phi_i"].get("p"), "t": sizes["theta_i"].get("t"),
             "c": 3 if colours == "rgb" else sizes["wavelengths"].get("c")}  # fmt: skip
    for name, letters in axes.items():
        fits = all(size == count.get(axis, size) and size >= (2 if axis in "xy" else 1)
                   for axis, size in sizes[name].items())  # fmt: skip
        if fields[name].ndim != len(letters) or not fits:
            raise InputError(f"is no tensor file of a material: {name} has the shape {fields[name].shape}")
        if not np.isfinite(fields[name]).all():
            raise InputError(_NOT_FINITE)
    for name in ("theta_i", *(("wavelengths",) if colours == "spectra" else ())):
        if np.any(np.diff(fields[name].astype(np.float64)) <= 0):
            raise InputError(f"is no tensor file of a material: {name} does not ascend")


class _Square:
    """Values over the unit square, for each azimuth and elevation of the light, bilinear between grid points."""

    def __init__(self, values: NDArray[Any], phi: Array, theta: Array) -> None:
        self.values = values.astype(np.float64)
        self.phi, self.theta = phi, theta

    def parameters(self, phi: Array, theta: Array) -> list[tuple[Any, Any, Array]]:
        """Return index of azimuth, index of elevation and weight of the slices about a direction of the light."""
        pairs = []
        for axis, at in ((self.phi, phi), (self.theta, theta)):
            low = np.clip(np.searchsorted(axis, at, "right") - 1, 0, max(len(axis) - 2, 0))
            high = np.minimum(low + 1, len(axis) - 1)
            span = axis[high] - axis[low]
            share = np.clip((at - axis[low]) / np.where(span > 0, span, 1), 0, 1)
            pairs.append(((low, 1 - share), (high, share)))
        return [(i, j, a * b) for i, a in pairs[0] for j, b in pairs[1]]

    def at(self, u: Array, v: Array, phi: Array, theta: Array) -> Array:
        """Return the values at places; u runs along the last axis of the square."""
        rows, columns = self.values.shape[2:4]
        x, y = np.clip(u, 0, 1) * (columns - 1), np.clip(v, 0, 1) * (rows - 1)
        i, j = (np.clip(np.floor(each).astype(int), 0, most - 2) for each, most in ((x, columns), (y, rows)))
        a, b = x - i, y - j
        total: Any = 0.0
        for p, t, weight in self.parameters(phi, theta):
            for row, column, share in ((j, i, (1 - b) * (1 - a)), (j, i + 1, (1 - b) * a), (j + 1, i, b * (1 - a)),
                                       (j + 1, i + 1, b * a)):  # fmt: skip
                cell = self.values[p, t, row, column]
                total = total + (weight * share).reshape(-1, *[1] * (cell.ndim - 1)) * cell
        return np.asarray(total)


class _Warp(_Square):
    """A density over the square, whose cumulated parts take places to the places of even random numbers."""

    def __init__(self, values: NDArray[Any], phi: Array, theta: Array) -> None:
        super().__init__(values, phi, theta)
        rows, columns = self.values.shape[2:]
        across = (self.values[..., 1:] + self.values[..., :-1]) / (2 * (columns - 1))
        self._along = np.concatenate([np.zeros_like(self.values[..., :1]), np.cumsum(across, axis=-1)], axis=-1)
        ends = self._along[..., -1]
        down = (ends[..., 1:] + ends[..., :-1]) / (2 * (rows - 1))
        whole = np.sum(down, axis=-1)[..., None]
        whole = np.where(whole > 0, whole, 1)
        self.values, self._along = self.values / whole[..., None], self._along / whole[..., None]
        self._down = np.concatenate([np.zeros_like(down[..., :1]), np.cumsum(down, axis=-1)], axis=-1) / whole

    def invert(self, u: Array, v: Array, phi: Array, theta: Array) -> tuple[Array, Array]:
        """Return the even numbers that the density takes to places: first v by its marginal, then u on its line."""
        rows, columns = self.values.shape[2:]
        x, y = np.clip(u, 0, 1) * (columns - 1), np.clip(v, 0, 1) * (rows - 1)
        i, j = (np.clip(np.floor(each).astype(int), 0, most - 2) for each, most in ((x, columns), (y, rows)))
        a, b = x - i, y - j
        part, line, marginal = (np.zeros_like(u) for _ in range(3))
        for p, t, weight in self.parameters(phi, theta):
            for row, share in ((j, 1 - b), (j + 1, b)):
                left, right = self.values[p, t, row, i], self.values[p, t, row, i + 1]
                own = self._along[p, t, row, i] + (a * left + a * a * (right - left) / 2) / (columns - 1)
                part += weight * share * own
                line += weight * share * self._along[p, t, row, -1]
            low, high = self._along[p, t, j, -1], self._along[p, t, j + 1, -1]
            marginal += weight * (self._down[p, t, j] + (b * low + b * b * (high - low) / 2) / (rows - 1))
        return np.clip(part / np.where(line > 0, line, 1), 0, 1), np.clip(marginal, 0, 1)


def tensor_brdf(fields: dict[str, NDArray[Any]], wi: Array, wo: Array) -> Array:
    """Return the BRDF (n, 3; linear sRGB) of a tensor file (Dupuy and Jakob 2018) for directions above the surface."""
    phi, theta = (fields[name].astype(np.float64) for name in ("phi_i", "theta_i"))
    spectra = _colours(fields)
    half = wi + wo
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    around = np.arctan2(wi[:, 1], wi[:, 0])
    elevation = np.arccos(np.clip(wi[:, 2], -1, 1))
    turn = (np.arctan2(half[:, 1], half[:, 0]) - around + math.pi) / (2 * math.pi)
    turn -= np.floor(turn)
    place = np.sqrt(np.arccos(np.clip(half[:, 2], -1, 1)) * 2 / math.pi)
    at = np.zeros_like(elevation), elevation
    warp = _Warp(fields["vndf"], phi, theta)
    u, v = warp.invert(place, turn, *at)
    brdf = _Square(spectra, phi, theta).at(u, v, *at)
    if int(np.ravel(fields.get("jacobian", np.ones(1)))[0]):
        density = _Square(fields["ndf"][None, None], np.zeros(1), np.zeros(1)).at(place, turn, *at)
        light = np.sqrt(elevation * 2 / math.pi)
        sigma = _Square(fields["sigma"][None, None], np.zeros(1), np.zeros(1)).at(light, np.full_like(light, 0.5), *at)
        brdf = brdf * (density / np.maximum(4 * sigma, 1e-300))[:, None]
    return np.asarray(np.maximum(brdf, 0) / np.maximum(wo[:, 2:], 1e-6))


def _colours(fields: dict[str, NDArray[Any]]) -> Array:
    """Return the table of colours with linear sRGB last."""
    if "rgb" in fields:
        return np.asarray(np.moveaxis(fields["rgb"].astype(np.float64), 2, -1))
    waves = fields["wavelengths"].astype(np.float64)
    hats = (np.interp(WAVELENGTHS_NM, waves, row) for row in np.eye(len(waves)))
    weights = np.array([srgb_from_reflectance(hat) for hat in hats])
    return np.asarray(np.einsum("ptwyx,wc->ptyxc", fields["spectra"].astype(np.float64), weights))


def directions(sizes: tuple[int, int, int]) -> tuple[Array, Array]:
    """Return the two directions (…, 3) of the middles of all cells."""
    a, b, c = ((np.arange(size) + 0.5) / size for size in sizes)
    half, difference, turn = np.meshgrid(a**2 * math.pi / 2, b * math.pi / 2, c * math.pi, indexing="ij")
    x, y, z = np.sin(difference) * np.cos(turn), np.sin(difference) * np.sin(turn), np.cos(difference)
    cosine, sine = np.cos(half), np.sin(half)
    first, second = (
        np.stack([sign * x * cosine + z * sine, sign * y, z * cosine - sign * x * sine], axis=-1) for sign in (1, -1)
    )
    return first, second


def _of_tensors(fields: dict[str, NDArray[Any]]) -> Array:
    """Return the values of a tensor file: the mean of both ways of light; below the horizon as in MERL files."""
    wi, wo = (each.reshape(-1, 3) for each in directions(_OF_TENSORS))
    above = (wi[:, 2] > 1e-3) & (wo[:, 2] > 1e-3)
    values = np.zeros((len(wi), 3))
    ways = [tensor_brdf(fields, one[above], other[above]) for one, other in ((wi, wo), (wo, wi))]
    values[above] = 0.5 * (ways[0] + ways[1])
    return _continue_values(values.reshape(*_OF_TENSORS, 3), above.reshape(_OF_TENSORS))


def _figures(values: Array) -> tuple[Array, float, float]:
    """Return albedo along the normal, and alpha and share of the facets that directions are drawn by."""
    halves = len(values)
    edges = (np.arange(halves + 1) / halves) ** 2 * math.pi / 2
    half = ((np.arange(halves) + 0.5) / halves) ** 2 * math.pi / 2
    # along the normal the difference angle is the half angle, both lie in one plane, and light leaves at twice it
    difference = np.minimum((half / (math.pi / 2) * values.shape[1]).astype(int), values.shape[1] - 1)
    brdf = values[np.arange(halves), difference, 0]
    leaving = np.minimum(2 * half, math.pi / 2)
    steps = np.diff(np.minimum(2 * edges, math.pi / 2))
    albedo = 2 * math.pi * np.sum(brdf * (np.cos(leaving) * np.sin(leaving) * steps)[:, None], axis=0)
    peak = values[:, 0].mean(axis=(1, 2))
    floor = float(np.min(peak[half < math.pi / 4]))
    excess = np.maximum(peak - floor, 0)
    below = np.flatnonzero(excess < 0.5 * excess[0]) if excess[0] > 0 else np.zeros(0, int)
    # GGX's density is half of its peak where the tangent is 0.644 alpha
    alpha = math.tan(min(float(half[below[0]]) if len(below) else math.pi / 4, 1.0)) / 0.644
    even = math.pi * floor
    gloss = float(np.clip(1 - even / max(float(albedo.mean()), 1e-9), 0.1, 0.9)) if excess[0] > 0.1 * floor else 0.1
    return np.clip(albedo, 0, 1), float(np.clip(alpha, _SMALLEST_ALPHA, 1.0)), gloss
