"""Materials of the scene as records, and which parts of them there are."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import WAVELENGTHS_NM, srgb_from_reflectance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import MATERIAL, MATERIAL_TEXTURES, SHARE_SIDES, BumpLengths, MaterialKind, fill
from rptcam_cl.core.remember import Disk, content_name, remember
from rptcam_cl.rendering.plan import textures as plan_textures
from rptcam_cl.rendering.plan.textures import KnownSpectra, TextureTable
from rptcam_cl.scene import materials as models
from rptcam_cl.scene.media import AbsorbingMaterial
from rptcam_cl.scene.quantities import LARGEST_RADIANCE, Colour, SpectralColour
from rptcam_cl.scene.textures import Blend, ImageTexture, Mixture, Texture

# The largest share of light that any surface of a scene gives back: what bounds the light of long paths.


LargestAlbedo = float | str
"""The largest albedo of a scene, at any wavelength and angle, or why nothing below 1 is known for sure."""


def largest_albedo(materials: Iterable[models.Material]) -> LargestAlbedo:
    """Return the largest albedo of some materials; that of none is 0."""
    largest = 0.0
    for material in {id(material): material for material in materials}.values():
        albedo = _albedo(material)
        if isinstance(albedo, str):
            return albedo
        largest = max(largest, albedo)
    return largest


def _albedo(material: models.Material) -> LargestAlbedo:
    match material:
        case models.Emissive():
            return 0.0
        case models.Mix():
            return largest_albedo(material.materials)
        case models.Translucent():
            parts = [_of_colour(colour) for colour in (material.reflectance, material.transmittance)]
            return next((part for part in parts if isinstance(part, str)), None) or sum(map(float, parts))
        case models.Matte(sigma_degrees=0) | models.Mirror():
            return _of_colour(material.reflectance)
        case models.Conductor() if material.reflectance is not None:
            return _of_colour(material.reflectance)
    # Fresnel's equations reflect everything at grazing angles, and glass passes on what it does not reflect.
    return f"{material.kind} may reflect or pass on all light"


def _of_colour(colour: Colour | Texture) -> LargestAlbedo:
    if isinstance(colour, ImageTexture):
        return "a picture gives the reflectance"
    if isinstance(colour, Mixture):
        albedos = [_of_colour(part) for part in (colour.first, colour.second)]
        return next((each for each in albedos if isinstance(each, str)), None) or max(map(float, albedos))
    parts: tuple[Colour, ...] = colour.colours if isinstance(colour, Blend) else (colour,)
    return max(map(_largest, parts))


def _largest(colour: Colour) -> float:
    """Return the largest channel, and of a spectrum the largest sample; what upsampling makes of channels is less."""
    largest = max(colour)
    return max(largest, float(colour.samples.max())) if isinstance(colour, SpectralColour) else largest


# How much light the sheen of cloth sends back, by quadrature in float64 (Estevez and Kulla 2017).

Array = NDArray[np.float64]
_SHEEN_GRID = 128  # points along each side of the square of directions
_ROOTS = (np.arange(32) + 0.5) / 32  # of the cosines where the albedo is fitted
_EVEN = np.sqrt((np.arange(64) + 0.5) / 64)  # cosines of even light
_SHALLOW = np.geomspace(1e-4, 0.2, 25)  # cosines among which the albedo is largest
_DEGREE = 4  # of kernels/material/sheen.h
# Their fit of Smith's Lambda at alpha 0 and 1: a, b, c, d, e of a / (1 + b x^c) + d x + e.
_FIT = np.array([[25.3245, 3.32435, 0.16801, -1.27393, -4.85967], [21.5473, 3.82987, 0.19823, -1.97760, -4.32054]])


def sheen_lambda(cosine: Array, alpha: float) -> Array:
    """Return Smith's Lambda by the fit of Estevez and Kulla."""
    a, b, c, d, e = (1 - alpha) ** 2 * _FIT[0] + (1 - (1 - alpha) ** 2) * _FIT[1]
    x = np.where(cosine < 0.5, cosine, 1 - cosine)
    fit, half = (a / (1 + b * y**c) + d * y + e for y in (x, 0.5))
    return np.asarray(np.exp(np.where(cosine < 0.5, fit, 2 * half - fit)))


def sheen_density(sine: Array, alpha: float) -> Array:
    """Return the density of the fibres' normals by the sine of their angle to the surface's."""
    return np.asarray((2 + 1 / alpha) * sine ** (1 / alpha) / (2 * np.pi))


def sheen_albedo(cosine: float, alpha: float) -> float:
    """Return the share of light from a direction that a white sheen sends back."""
    node, weight = np.polynomial.legendre.leggauss(_SHEEN_GRID)
    root = (node[:, None] + 1) / 2
    z = root**2  # the lobe is narrow where the way out grazes
    turn = (np.arange(_SHEEN_GRID) + 0.5) / _SHEEN_GRID * np.pi
    h = np.stack(
        np.broadcast_arrays(
            np.sqrt(1 - cosine**2) + np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), cosine + z
        ),
        axis=-1,
    )
    sine = np.sqrt(np.clip(1 - h[..., 2] ** 2 / np.sum(h**2, axis=-1), 0, None))
    shadowed = 4 * cosine * (1 + sheen_lambda(np.array(cosine), alpha) + sheen_lambda(z, alpha))
    value = sheen_density(sine, alpha) / shadowed
    return float(2 * np.pi * (value.mean(axis=1) @ (weight * root[:, 0])))


@lru_cache(maxsize=256)
def sheen_lobe(alpha: float) -> tuple[float, dict[str, Any]]:
    """Fit what the kernels take of a sheen.

    Returns
    -------
    scale : float
        Factor on the formula with which no direction gets back more than arrives: 1 from a roughness of 0.25 on.
    members : dict
        Of a material's record: the density of normals in the surface, with the factor, the logarithm of Smith's Lambda
        at the cosine 0.5, and the coefficients of the logarithm of the share that a white sheen sends back, a quartic
        in the root of the cosine, from above.
    """
    share = np.array([sheen_albedo(float(cosine), alpha) for cosine in _ROOTS**2])
    scale = 1 / max(1.0, *share, *(sheen_albedo(float(cosine), alpha) for cosine in _SHALLOW))
    share *= scale
    weight = np.sqrt(np.maximum(share, 1e-4)) * _ROOTS
    powers = _ROOTS[:, None] ** np.arange(_DEGREE + 1)
    wanted = np.log(np.maximum(share, 1e-8))
    fit = np.linalg.lstsq(powers * weight[:, None], wanted * weight, rcond=None)[0]
    counts = share > 0.02  # lifted until nothing that counts is too low
    fit[0] += max(float(np.max((wanted - powers @ fit)[counts])), 0.0)
    peak = scale * float(sheen_density(np.array(1.0), alpha))
    half = float(np.log(sheen_lambda(np.array(0.5), alpha)))
    cover = {"sheen_cover": tuple(map(float, fit[:4])), "sheen_last": float(fit[4])}
    return scale, {"sheen_alpha": alpha, "sheen_peak": peak, "sheen_half": half, **cover}


def sheen_mean(members: dict[str, Any]) -> float:
    """Return the share of even light that a white sheen sends back, by what `sheen_lobe` fits."""
    powers = np.sqrt(_EVEN)[:, None] ** np.arange(_DEGREE + 1)
    return float(np.mean(np.exp(powers @ [*members["sheen_cover"], members["sheen_last"]])))


# What the dielectric cover of a plastic lets in and out, by quadrature in float64.

_COVER_GRID = 96  # points along each side of the square of facet normals
_COSINES = np.concatenate([[0.02, 0.05], np.linspace(0.1, 1.0, 25)])


def fresnel(cosine: Array, index: float | Array) -> Array:
    """The unpolarised reflectance of a smooth dielectric, given the index behind its surface over that in front."""
    sine2 = (1.0 - cosine**2) / index**2
    beyond = np.sqrt(np.maximum(1.0 - sine2, 0.0))
    s, p = (cosine - index * beyond) / (cosine + index * beyond), (index * cosine - beyond) / (index * cosine + beyond)
    return np.asarray(np.where(sine2 >= 1.0, 1.0, 0.5 * (s * s + p * p)))


def rough_albedo(cosine: float, alpha: tuple[float, float], reflectance: Callable[[Array], Array]) -> float:
    """Return the share of light from a direction that GGX facets reflect once, by their reflectance at a cosine.

    Over visible normals (Heitz 2014) on a midpoint grid of their spherical cap (Dupuy and Benyoub 2023); with two
    alphas, for their geometric mean.
    """
    a = float(np.sqrt(alpha[0] * alpha[1]))
    u, v = np.meshgrid(*[(np.arange(_COVER_GRID) + 0.5) / _COVER_GRID] * 2)
    wi = np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    w = wi * (a, a, 1)
    w /= np.linalg.norm(w)
    z = (1 - v) * (1 + w[2]) - w[2]
    r = np.sqrt(np.clip(1 - z**2, 0, None))
    h = np.stack([r * np.cos(2 * np.pi * u) + w[0], r * np.sin(2 * np.pi * u), z + w[2]], axis=-1) * (a, a, 1)
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    c = h @ wi
    up = 2 * c * h[..., 2] - cosine
    z = np.where(up > 0, up, 1.0)
    stretch_i, stretch_o = (np.sqrt(x**2 + a**2 * (1 - x**2)) for x in (cosine, z))
    passed = z * (cosine + stretch_i) / (z * stretch_i + cosine * stretch_o)
    return float(np.where(up > 0, passed * reflectance(c), 0.0).mean())


@lru_cache(maxsize=256)
def rough_cover(alpha: tuple[float, float], index: float) -> tuple[float, ...]:
    """Return the coefficients of the share that a rough cover of glass reflects."""
    return fitted_cover(alpha, partial(fresnel, index=index))


def fitted_cover(alpha: tuple[float, float], reflectance: Callable[[Array], Array]) -> tuple[float, ...]:
    """Return the coefficients of the share that a rough cover reflects: a quartic in 1 - cosine, from above."""
    share = np.array([rough_albedo(cosine, alpha, reflectance) for cosine in _COSINES])
    powers = (1 - _COSINES)[:, None] ** np.arange(_DEGREE + 1)
    weight = np.sqrt(_COSINES)
    fit = np.linalg.lstsq(powers * weight[:, None], share * weight, rcond=None)[0]
    for power, part in ((0, _COSINES > 0.5), (_DEGREE, _COSINES <= 0.5)):  # lifted until nothing is too low
        fit[power] += max(float(np.max((share - powers @ fit)[part] / powers[part, power])), 0.0)
    return tuple(map(float, fit))


def cover_mean(cover: tuple[float, ...]) -> float:
    """Return the share of even light that a cover reflects: the integral of 2 mu E(mu)."""
    return float(sum(2 * c / ((i + 1) * (i + 2)) for i, c in enumerate(cover)))


# What facets scatter, as tables (kernels/material/facet_shares.h).

_SHARE_NODES = 64, 24  # of the quadrature over visible normals, round their cap and along it
_FINE_NODES = 128, 32  # of tables for one pair of alphas
_LEAST_STRETCH = 1e-3


def _quadrature(around: int, along: int) -> tuple[Array, Array, Array]:
    """Return nodes of a spherical cap, two numbers each as `_cap` takes them, and their weights."""
    node, weight = np.polynomial.legendre.leggauss(along)
    u, v = np.meshgrid((np.arange(around) + 0.5) / around, (node + 1) / 2, indexing="ij")
    return u, v, np.broadcast_to(weight / 2 / around, u.shape).ravel()


def _cap(w: Array, u: Array, v: Array) -> Array:
    """Return vectors along the normals that are visible along w where alpha is 1 (Dupuy and Benyoub 2023): (3, m)."""
    z = (1 - v) * (1 + w[2]) - w[2]
    r = np.sqrt(np.clip(1 - z**2, 0, None))
    return np.stack([r * np.cos(2 * np.pi * u) + w[0], r * np.sin(2 * np.pi * u) + w[1], z + w[2]]).reshape(3, -1)


def _met(w: Any, cap: Any, stretch: Any) -> tuple[Any, Any, Any]:
    """Return facets that light meets along ``w``: normals (n, 3, m), its direction (n, 3, 1), cosines between them.

    Normals ``cap`` (3, m) and direction are as for alpha 1; ``stretch`` (n, 3, 1) is what takes directions there.
    """
    h, wi = cap * stretch, w[:, None] / stretch
    h /= np.sqrt((h * h).sum(axis=1, keepdims=True))
    wi /= np.sqrt((wi * wi).sum(axis=1, keepdims=True))
    return h, wi, np.clip((h * wi).sum(axis=1), 0, 1)


def _mirrored(h: Any, wi: Any, c: Any, stretch: Any) -> tuple[Any, Any]:
    """Return where facets mirror light to (n, 3, m), and the share of it that no other facet is in the way of."""
    own, ways = _smith_lambda(wi, stretch), 2 * c[:, None] * h - wi
    return ways, np.where(ways[:, 2] > 0, (1 + own) / (1 + own + _smith_lambda(ways, stretch)), 0)


def _refracted(h: Any, wi: Any, c: Any, stretch: Any, eta: float) -> tuple[Any, Any]:
    """Return where facets bend light to (n, 3, m), and the share of it that no other facet is in the way of."""
    inside = np.sqrt(np.clip(1 - (1 - c * c) / eta**2, 0, None))
    ways = (c / eta - inside)[:, None] * h - wi / eta
    return ways, np.where(ways[:, 2] < 0, 1 / (1 + _smith_lambda(ways, stretch)), 0)


def _smith_lambda(w: Any, stretch: Any) -> Any:
    sideways2 = ((w * stretch)[:, :2] ** 2).sum(axis=1)
    return (np.sqrt(1 + sideways2 / np.maximum(w[:, 2] ** 2, 1e-30)) - 1) / 2


def _table_directions(turns: int) -> Array:
    """Return the directions of a table where slopes are stretched to alpha 1: (cosines, ``turns``, 3).

    Their cosines z stand evenly in the angle whose cosine is 1 - 2 z, their azimuths likewise, in parts of a quarter.
    """
    cosine, part = ((1 - np.cos(np.linspace(0, np.pi, count))) / 2 for count in (SHARE_SIDES["COSINES"], turns))
    z, azimuth = np.maximum(cosine, 1e-4)[:, None], np.pi / 2 * part
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z + 0 * azimuth], axis=-1)


def _once_table(alphas: Array, reflectance: Callable[[Array], Array], nodes: tuple[int, int]) -> NDArray[np.float32]:
    """Return shares of light that facets reflect once, for pairs of alphas (n, 2): shape (2, n, cosines, turns).

    Of facets that reflect everything, and of those of a reflectance by the cosine; ``nodes`` are of the quadrature.
    """
    u, v, weights = _quadrature(*nodes)
    weights = weights.astype(np.float32)
    stretch = np.c_[np.maximum(alphas, _LEAST_STRETCH), np.ones(len(alphas))].astype(np.float32)[:, :, None]
    directions = _table_directions(SHARE_SIDES["TURNS"]).reshape(-1, 3)
    shares = np.empty((2, len(alphas), len(directions)), np.float32)
    for place, w in enumerate(directions):
        h, wi, c = _met(w.astype(np.float32), _cap(w, u, v).astype(np.float32), stretch)
        _, back = _mirrored(h, wi, c, stretch)
        shares[..., place] = np.stack([back, back * reflectance(c)]) @ weights
    return shares.reshape(*shares.shape[:2], -1, SHARE_SIDES["TURNS"])


def _brushed_shares(
    alphas: Array, reflectance: Callable[[Array], Array], nodes: tuple[int, int]
) -> tuple[Array, Array]:
    """Return the tables of brushed facets for pairs of alphas (n, 2), and means over even light (2, n).

    The first is the share of light that meets further facets, where they reflect everything. The second is the mean
    reflectance of what meets none, less that at the cosine of the light: what it is near 0 for is smooth near an alpha
    of 0.
    """
    turns = SHARE_SIDES["TURNS"]
    tables = _once_table(alphas, reflectance, nodes).astype(np.float64)
    z = np.sqrt((np.arange(64) + 0.5) / 64)[:, None]  # even light
    azimuth = (np.arange(16) + 0.5) * (np.pi / 32)
    means = np.empty((2, len(alphas)))
    for number, pair in enumerate(np.maximum(alphas, _LEAST_STRETCH)):
        w = _table_directions(turns) / [*pair, 1]
        tables[1, number] /= tables[0, number]
        tables[1, number] -= reflectance(w[..., 2] / np.sqrt((w * w).sum(axis=-1)))
        tables[0, number] = 1 - tables[0, number]
        x, y = (alpha * np.sqrt(1 - z**2) * way(azimuth) for alpha, way in zip(pair, (np.cos, np.sin), strict=True))
        parts = z / np.sqrt(x * x + y * y + z * z), np.arctan2(y, x) / (np.pi / 2)
        rows, columns = (np.arccos(1 - 2 * p) / np.pi * (n - 1) for p, n in zip(parts, tables.shape[2:], strict=True))
        again = _between(tables[0, number], rows, columns)
        risen = (1 - again) * (_between(tables[1, number], rows, columns) + reflectance(z))
        means[:, number] = again.mean(), risen.mean()
    return tables, means


_DISK = Disk(
    "facets", ("core", "rendering/plan"), pack=lambda own: ({"table": own}, {}), unpack=lambda held, _: held["table"]
)


@remember(most=1, disk=_DISK)
def _brushed_table() -> NDArray[np.float32]:
    """Return the tables of facets whose alphas textures give, with Schlick's rise, and their means."""
    count = SHARE_SIDES["ALPHAS"]
    alphas = np.stack(np.meshgrid(*[np.arange(count) / (count - 1)] * 2, indexing="ij"), axis=-1)
    upper, lower = np.triu_indices(count), np.tril_indices(count, -1)
    tables: Any = np.empty((2, count, count, SHARE_SIDES["COSINES"], SHARE_SIDES["TURNS"]))
    means: Any = np.empty((2, count, count))
    tables[:, *upper], means[:, *upper] = _brushed_shares(alphas[upper], _schlick, _SHARE_NODES)
    tables[:, *lower] = tables[:, *lower[::-1]][..., ::-1]  # turned by a quarter
    means[:, *lower] = means[:, *lower[::-1]]
    return _joined(tables, means)


@lru_cache(maxsize=64)
def _own_table(alpha: tuple[float, float], index: float) -> NDArray[np.float32]:
    """Return the tables of facets of one pair of alphas: with Schlick's rise, or Fresnel's of an index other than 0."""
    reflectance = partial(fresnel, index=index) if index else _schlick
    return _joined(*_brushed_shares(np.array([alpha]), reflectance, _FINE_NODES))


def _joined(tables: Array, means: Array) -> NDArray[np.float32]:
    pairs = zip(tables, means, strict=True)
    return np.concatenate([part.ravel() for pair in pairs for part in pair]).astype(np.float32)


def _between(plane: Any, rows: Array, columns: Array) -> Array:
    """Interpolate between the entries of a plane."""
    i, j = (np.minimum(x.astype(int), size - 2) for x, size in zip((rows, columns), plane.shape, strict=True))
    down, across = rows - i, columns - j
    upper = plane[i, j] * (1 - across) + plane[i, j + 1] * across
    lower = plane[i + 1, j] * (1 - across) + plane[i + 1, j + 1] * across
    return np.asarray(upper * (1 - down) + lower * down)


_GLASS = Disk(
    "facets",
    ("core", "rendering/plan"),
    pack=lambda own: ({"table": own[0]}, {"once": own[1]}),
    unpack=lambda held, facts: (held["table"], tuple(facts["once"])),
)


@remember(most=64, disk=_GLASS)
def _glass_table(
    alpha: tuple[float, float], levels: int, eta: float, *, schlick: bool
) -> tuple[NDArray[np.float32], tuple[float, float]]:
    """Return a table of the light that rough glass scatters again, and the shares of even light scattered once.

    The table has for alphas up to these the share of light from a direction outside that meets further facets
    (levels, entries), the same inside, and (4, levels) their means over even light outside and inside, and the shares
    of such light that leave on the side where they arrive, outside and inside. In the thinner medium that is what is
    reflected of what is scattered once; the other follows, as light goes through glass the same either way.

    Parameters
    ----------
    alpha
        GGX's alpha along and across.
    levels
        How many.
    eta
        Index of refraction.
    schlick
        Whether facets reflect after Schlick, by the angle outside, or after Fresnel.
    """
    turns, steps = _share_turns(alpha), np.linspace(1.0 if levels == 1 else 0.0, 1.0, levels)
    again = np.empty((2, levels, SHARE_SIDES["COSINES"] * turns))
    ends = np.empty((4, levels))
    z, around = (grid.ravel() for grid in np.meshgrid(_EVEN, np.arange(16) * np.pi / 8))
    even = np.stack([np.sqrt(1 - z * z) * np.cos(around), np.sqrt(1 - z * z) * np.sin(around), z])
    for number, step in enumerate(steps):
        stretch = np.array([*np.maximum(step * np.array(alpha), _LEAST_STRETCH), 1.0])
        sides = [_scattered_once(stretch, index, turns, schlick=schlick) for index in (eta, 1 / eta)]
        again[:, number] = [np.maximum(1 - back - through, 0) for back, through in sides]
        seen = _onto(even, np.full(len(z), 1 / len(z)), stretch, turns)
        means = np.maximum(again[:, number] @ seen, _LEAST_AGAIN)
        thin, dense = (0, 1) if eta >= 1 else (1, 0)
        back, through = (float(part @ seen) for part in sides[thin])
        passed = means[thin] / means[dense] / max(eta, 1 / eta) ** 2  # of what leaves the denser side, over the other
        out = min(through / (back + through), 1 / passed)
        ends[:2, number] = means
        ends[2 + thin, number], ends[2 + dense, number] = 1 - out, 1 - out * passed
    once = tuple(float((back + through) @ seen) for back, through in sides)
    return np.concatenate([again.ravel(), ends.ravel()]).astype(np.float32), (once[0], once[1])


_LEAST_AGAIN = 1e-7


def _scattered_once(stretch: Array, eta: float, turns: int, *, schlick: bool) -> tuple[Array, Array]:
    """Return the shares of light from the directions of a table that facets of glass reflect and refract once.

    ``eta`` is the index beyond the surface over that before it.
    """
    u, v, weights = _quadrature(*_SHARE_NODES)
    f0, each = ((eta - 1) / (eta + 1)) ** 2, stretch[None, :, None]
    reflected, refracted = [], []
    for w in _table_directions(turns).reshape(-1, 3):
        h, wi, c = _met(w, _cap(w, u, v), each)
        (_, back), (_, down) = _mirrored(h, wi, c, each), _refracted(h, wi, c, each, eta)
        share = fresnel(c, eta)
        if schlick:
            inside = np.sqrt(np.clip(1 - (1 - c * c) / eta**2, 0, None))
            share = np.where(share >= 1, 1, f0 + (1 - f0) * _schlick(inside if eta < 1 else c))
        reflected.append((share * back)[0] @ weights)
        refracted.append(((1 - share) * down)[0] @ weights)
    return np.array(reflected), np.array(refracted)


def _onto(ways: Array, light: Array, stretch: Array, turns: int) -> Array:
    """Share light along ways (3, m) out among the entries of a table, as one reads between them."""
    x, y, z = np.abs(ways) * stretch[:, None]
    rows = np.arccos(1 - 2 * z / np.sqrt(x * x + y * y + z * z)) / np.pi * (SHARE_SIDES["COSINES"] - 1)
    columns = np.arccos(1 - 2 * np.arctan2(y, x) / (np.pi / 2)) / np.pi * (turns - 1)
    i, j = (
        np.clip(place.astype(int), 0, max(size - 2, 0))
        for place, size in zip((rows, columns), (SHARE_SIDES["COSINES"], turns), strict=True)
    )
    down, across = rows - i, columns - j
    found = np.zeros(SHARE_SIDES["COSINES"] * turns)
    for below in (0, 1):
        for beside in (0, 1) if turns > 1 else (0,):
            share = (down if below else 1 - down) * (across if beside else 1 - across)
            found += np.bincount((i + below) * turns + j + beside, light * share, len(found))
    return found


def _share_turns(alpha: tuple[float, float]) -> int:
    return 1 if alpha[0] == alpha[1] else SHARE_SIDES["TURNS"]


def _is_brushed(records: NDArray[np.void]) -> bool:
    """Return whether facets of any material have two alphas."""
    return bool(np.any(records["alpha"] != records["alpha_across"]) or np.any(records["anisotropy_texture"] >= 0))


_BRUSHED = MaterialKind.CONDUCTOR, MaterialKind.METAL, MaterialKind.PRINCIPLED, MaterialKind.ROUGH_PLASTIC


def facet_shares(records: NDArray[np.void]) -> NDArray[np.float32]:
    """Return the tables of materials, where their records say, behind a 0."""
    parts = [np.zeros(1, np.float32)]
    if np.any(records["brushed_alphas"] > 1):
        parts.append(_brushed_table())
    for record in records:
        alpha, index = (float(record["alpha"]), float(record["alpha_across"])), float(record["parameter"])
        if record["brushed_alphas"] == 1:
            parts.append(_own_table(alpha, index if record["kind"] == MaterialKind.ROUGH_PLASTIC else 0.0))
        if record["share_levels"] > 0:
            clear = bool(record["kind"] == MaterialKind.PRINCIPLED)
            parts.append(_glass_table(alpha, int(record["share_levels"]), index, schlick=clear)[0])
    return np.concatenate(parts)


def _place_tables(records: NDArray[np.void]) -> None:
    """Write where the tables of facets start among all."""
    of_pair = 2 * (SHARE_SIDES["COSINES"] * SHARE_SIDES["TURNS"] + 1)
    start = 1 + (of_pair * SHARE_SIDES["ALPHAS"] ** 2 if np.any(records["brushed_alphas"] > 1) else 0)
    for record in records:
        record["brushed_table"] = 1 if record["brushed_alphas"] > 1 else start
        start += of_pair if record["brushed_alphas"] == 1 else 0
        record["share_table"] = start
        start += int(record["share_levels"] * (2 * record["share_turns"] * SHARE_SIDES["COSINES"] + 4))


def _fill_brushed(record: np.void) -> None:
    """Write how large the tables of brushed facets are, of a material that has some."""
    varies = record["roughness_texture"] >= 0 or record["anisotropy_texture"] >= 0
    if record["kind"] not in _BRUSHED or not _is_brushed(np.asarray(record)[None]):
        return
    if record["kind"] != MaterialKind.ROUGH_PLASTIC or not varies:
        record["brushed_alphas"] = SHARE_SIDES["ALPHAS"] if varies else 1


def _fill_glass(record: np.void) -> None:
    """Write how large the table of rough glass is, and what its facets scatter once."""
    kind = int(record["kind"])
    clear = kind == MaterialKind.PRINCIPLED and (record["transmission"] > 0 or record["transmission_texture"] >= 0)
    if kind != MaterialKind.ROUGH_DIELECTRIC and not clear:
        return
    pair, varies = (float(record["alpha"]), float(record["alpha_across"])), record["roughness_texture"] >= 0
    record["share_levels"] = SHARE_SIDES["ALPHAS"] if varies else 1
    record["share_turns"] = _share_turns(pair)
    if not varies:
        _, shares = _glass_table(pair, 1, float(record["parameter"]), schlick=clear)
        record["once"][:2] = shares


def _scatters_again(records: NDArray[np.void]) -> bool:
    """Return whether facets or fibres lose light that they scatter more than once, unless it is added."""
    kinds = (MaterialKind.CONDUCTOR, MaterialKind.METAL, MaterialKind.ROUGH_DIELECTRIC)
    principled = records["kind"] == MaterialKind.PRINCIPLED
    losing = ("metallic", "transmission", "coat", "sheen")
    given = [records[name].reshape(len(records), -1).any(axis=1) | (records[f"{name}_texture"] >= 0) for name in losing]
    return bool(np.any(np.isin(records["kind"], kinds)) or np.any(principled & np.any(given, axis=0)))


@lru_cache(maxsize=256)
def smooth_mean(index: float) -> float:
    """Return the share of even light that a smooth cover reflects from outside."""
    cosines = (np.arange(4096) + 0.5) / 4096
    return float(np.mean(2 * cosines * fresnel(cosines, index)))


def internal_reflectance(outside: float, index: float) -> float:
    """Return the share of diffuse light from inside that a cover reflects, given the share from outside.

    As much light passes an interface either way: (1 - inside) index^2 = 1 - outside.
    """
    return 1 - (1 - outside) / index**2


# What of a material reflects like a mirror, or nearly: how much of the light, and how far it spreads it.

_SMOOTH_ALPHA = 0.05  # GGX's alpha of what counts as polished
SPREADING_ALPHA = 0.002  # from which what it spreads counts
_COAT_REFLECTANCE = 0.04
_PAINTED = ("roughness", "metallic", "coat", "anisotropy", "specular", "specular_color")  # what a texture may replace
_COVERS = (MaterialKind.DIELECTRIC, MaterialKind.ROUGH_DIELECTRIC, MaterialKind.PLASTIC, MaterialKind.ROUGH_PLASTIC)


@dataclass(frozen=True)
class Lobe:
    """A share of a surface that reflects like a mirror, or spreads light little.

    Attributes
    ----------
    record : np.void
        Of the material.
    share : float
        Of the surface.
    alpha : float
        GGX's, 0 where nothing is spread.
    coat : bool
        Whether it is the clear coat of a material that has one.
    """

    record: np.void
    share: float
    alpha: float
    coat: bool = False

    def reflectance(self, cosine: Array, behind: NDArray[np.bool_]) -> Array:
        """Return the share of light that is reflected (n, 3), of rays that make an angle with the normal."""
        record, kind = self.record, MaterialKind(int(self.record["kind"]))
        colour, index = record["color"][:3].astype(np.float64), float(record["parameter"])
        if self.coat:
            share = float(record["coat"]) * _coat(cosine)[:, None] * np.ones(3)
        elif kind is MaterialKind.METAL:
            n, k = (record[name][:3].astype(np.float64) for name in ("metal_n", "metal_k"))
            share = colour * _of_metal(cosine[:, None], n, k)
        elif kind is MaterialKind.THIN_GLASS:
            share = colour * _of_pane(cosine, index, record["absorption"][:3].astype(np.float64))
        elif kind is MaterialKind.PRINCIPLED:
            share = _of_principled(record, cosine)
        elif kind in _COVERS:
            tint = colour if kind in (MaterialKind.DIELECTRIC, MaterialKind.ROUGH_DIELECTRIC) else np.ones(3)
            share = fresnel(cosine, np.where(behind, 1.0 / index, index))[:, None] * tint
        else:
            share = np.tile(colour, (len(cosine), 1))
        return np.asarray(self.share * share)


def lobes_of(materials: NDArray[np.void], index: int, share: float = 1.0) -> Iterator[Lobe]:
    """Yield the shares of a material that reflect like a mirror, or nearly.

    There are none of what textures make rough, uneven or full of holes, as far as no single number says how much.
    """
    record = materials[index]
    if record["kind"] < 0 or max(record[f"{name}_texture"] for name in ("opacity", "normal", "bump")) >= 0:
        return  # below 0 is the one record of a world without materials
    kind = MaterialKind(int(record["kind"]))
    share *= float(record["opacity"] if record["cutoff"] == 0 else record["opacity"] >= record["cutoff"])
    if kind is MaterialKind.MIX:
        if record["factor_texture"] < 0:
            yield from lobes_of(materials, int(record["first"]), share * (1.0 - float(record["factor"])))
            yield from lobes_of(materials, int(record["second"]), share * float(record["factor"]))
        return
    alpha = float(np.sqrt(record["alpha"] * record["alpha_across"]))
    if kind in (MaterialKind.MIRROR, MaterialKind.THIN_GLASS, MaterialKind.DIELECTRIC, MaterialKind.PLASTIC):
        alpha = 0.0
    elif kind in (MaterialKind.MATTE, MaterialKind.TRANSLUCENT, MaterialKind.EMISSIVE, MaterialKind.BOUNDARY,
                  MaterialKind.HAIR, MaterialKind.MEASURED):  # fmt: skip
        return
    coloured = record["texture"] >= 0 and kind in (
        MaterialKind.CONDUCTOR, MaterialKind.METAL, MaterialKind.PRINCIPLED, *_COVERS[:2]
    )  # fmt: skip
    painted = coloured or max(record[f"{name}_texture"] for name in _PAINTED) >= 0
    if share > 0 and alpha <= _SMOOTH_ALPHA and not painted:
        yield Lobe(record, share, alpha)
    even = max(record[f"coat_{name}texture"] for name in ("", "roughness_", "normal_")) < 0
    coated = kind is MaterialKind.PRINCIPLED and record["coat"] > 0 and record["coat_alpha"] <= _SMOOTH_ALPHA
    if share > 0 and coated and even:
        yield Lobe(record, share, float(record["coat_alpha"]), coat=True)


def _of_metal(cosine: Array, n: Array, k: Array) -> Array:
    """Return the reflectance of a metal of index n + i k."""
    root = np.sqrt((n + 1j * k) ** 2 - (1.0 - cosine**2))
    s = (cosine - root) / (cosine + root)
    p = ((n + 1j * k) ** 2 * cosine - root) / ((n + 1j * k) ** 2 * cosine + root)
    return np.asarray(0.5 * (np.abs(s) ** 2 + np.abs(p) ** 2))


def _of_pane(cosine: Array, index: float, depth: Array) -> Array:
    """The reflectance of both faces of a pane together."""
    r = fresnel(cosine, index)[:, None]
    inside = np.sqrt(np.maximum(1.0 - (1.0 - cosine**2) / index**2, 1e-12))[:, None]
    t2 = np.exp(-2.0 * depth / inside)
    return np.asarray(r + (1.0 - r) ** 2 * r * t2 / np.maximum(1.0 - r * r * t2, 1e-30))


def _schlick(cosine: Array) -> Array:
    return np.asarray(np.maximum(1.0 - cosine, 0.0) ** 5)


def _coat(cosine: Array) -> Array:
    return _COAT_REFLECTANCE + (1.0 - _COAT_REFLECTANCE) * _schlick(cosine)


def _of_principled(record: np.void, cosine: Array) -> Array:
    """Return the reflectance of a dielectric and a metal beside each other, under the coat, where there is one."""
    steep, index = _schlick(cosine)[:, None], float(record["parameter"])
    specular, metallic = float(record["specular"]), float(record["metallic"])
    normal = record["specular_color"][:3] * specular * ((index - 1.0) / (index + 1.0)) ** 2
    dielectric = normal + (specular - normal) * steep
    colour = record["color"][:3].astype(np.float64)
    metal = colour + (1.0 - colour) * steep
    under = (1.0 - float(record["coat"]) * _coat(cosine)[:, None]) ** 2
    return np.asarray(under * (dielectric + metallic * (metal - dielectric)))


_Faceted = models.Conductor | models.Dielectric | models.Plastic | models.Principled


@dataclass(frozen=True)
class Materials:
    """What the kernels read of materials.

    Attributes
    ----------
    records : array of Material
    index : dict
        Record of each material, by its ``id``.
    facts : dict
        Which kinds of material and which of their features there are.
    """

    records: NDArray[np.void]
    index: dict[int, int]
    facts: dict[str, int]


def _kind(material: models.Material) -> MaterialKind:
    match material:
        case models.Conductor() if material.metal is not None:
            return MaterialKind.METAL
        case models.Dielectric() | models.Plastic() if material.alphas is not None:
            return MaterialKind[f"ROUGH_{material.kind.upper()}"]
    return MaterialKind[material.kind.upper()]


class _Filler:
    """Writes a material into its record."""

    def __init__(self, textures: TextureTable, spectra: KnownSpectra) -> None:
        self._textures, self._spectra = textures, spectra

    def _colour(self, record: np.void, name: str, texture: str, value: Colour | Texture, limit: float) -> None:
        """Write a colour with the number of its spectrum, or the texture that gives it."""
        record[name][:3], record[texture] = self._textures.slot(value, limit=limit)
        record[name][3] = self._spectra.number(value, light=limit > 1.0)

    def _number(self, record: np.void, name: str, value: float | Texture) -> None:
        """Write a number, or the texture that gives it."""
        colour: tuple[float, float, float] | Texture = (value,) * 3 if isinstance(value, (int, float)) else value
        (record[name], _, _), record[f"{name}_texture"] = self._textures.slot(colour, limit=1.0)

    def _roughness(self, record: np.void, name: str, value: float | Texture) -> float:
        """Return the roughness; 1 where a texture is written that gives it."""
        if isinstance(value, (int, float)):
            return value
        _, record[name] = self._textures.slot(value, limit=1.0)
        return 1.0

    def fill(self, record: np.void, material: models.Material) -> None:
        """Write everything but the two materials of a mix into a record of `_white`."""
        record["kind"] = _kind(material)
        reflectance = getattr(material, "reflectance", None)
        if reflectance is not None:
            self._colour(record, "color", "texture", reflectance, 1.0)
        record["parameter"] = getattr(material, "parameter", getattr(material, "index", 0.0))
        match material:
            case models.Emissive():
                self._colour(record, "color", "texture", material.radiance, LARGEST_RADIANCE)
            case models.Principled():
                self._principled(record, material)
            case models.Mix():
                self._number(record, "factor", material.factor)
            case models.Measured():
                table, first = self._textures.measured(material)
                fill(record, color=(*table.albedo, 0.0), alpha=table.alpha, factor=table.gloss, first=first)
        if isinstance(material, (models.Conductor, models.Dielectric, models.Plastic)):
            _facets(record, material, material.alphas or (0.0, 0.0))
        if isinstance(material, models.Dielectric):
            plan_textures.fill_index(record, material)
        if isinstance(material, models.Dielectric | models.Translucent):
            self._colour(record, "passed", "passed_texture", material.transmittance, 1.0)
        if isinstance(material, models.Hair):
            self._colour(record, "color", "texture", material.color, 1.0)
            fill(record, hair=material.lobes)
        if isinstance(material, models.Conductor) and material.metal is not None:
            self._metal(record, material.metal)
        if isinstance(material, models.Plastic):
            _cover(record, material)
        interior = material.interior if isinstance(material, AbsorbingMaterial) else None
        if interior is not None and interior.color is not None and interior.by_entry:
            self._colour(record, "inside", "inside_texture", interior.color, 1.0)
        if isinstance(material, AbsorbingMaterial | models.ThinGlass):
            depth = material.depth if isinstance(material, models.ThinGlass) else material.absorption
            fill(record, absorption=(*depth, self._spectra.number(depth)))
        self._coverage(record, material)
        _fill_glass(record)
        _fill_brushed(record)

    def _metal(self, record: np.void, metal: str | models.OpticalConstants | models.MetalSpectrum) -> None:
        """Write the index n + i k of a metal: of each channel, and of one that was measured the spectra."""
        if isinstance(metal, models.OpticalConstants):
            fill(record, metal_n=metal.n, metal_k=metal.k)
            return
        pairs = zip(plan_textures.metal_constants(metal), plan_textures.metal_spectra(metal), strict=True)
        n, k = ((*channels, self._spectra.add(spectrum)) for channels, spectrum in pairs)
        fill(record, metal_n=n, metal_k=k)

    def _coverage(self, record: np.void, material: models.Material) -> None:
        if isinstance(material, models.CoveringMaterial):
            self._number(record, "opacity", material.opacity)
            record["cutoff"] = material.opacity_cutoff if material.opacity_mode == "mask" else 0.0
        if isinstance(material, models.BumpyMaterial) and material.normal_map is not None:
            _, record["normal_texture"] = self._textures.slot(material.normal_map, limit=1.0)
            record["normal_strength"] = material.normal_map.strength
        if isinstance(material, models.BumpyMaterial) and material.bump is not None:
            _, record["bump_texture"] = self._textures.slot(material.bump.texture, limit=plan_textures.UNLIMITED)
            in_units = material.bump.lengths == "unit" and material.bump.texture.mapping is None
            record["bump_height"] = material.bump.height * (1.0 if in_units else self._textures.metres_per_unit)
            record["bump_lengths"] = BumpLengths[material.bump.lengths.upper()]

    def _principled(self, record: np.void, material: models.Principled) -> None:
        self._colour(record, "color", "texture", material.base_color, 1.0)
        self._colour(record, "glow", "glow_texture", material.emission, LARGEST_RADIANCE)
        record["glow_behind"] = material.two_sided
        self._number(record, "metallic", material.metallic)
        roughness = self._roughness(record, "roughness_texture", material.roughness)
        _facets(record, material, models.alpha_pair(roughness, material.anisotropy))
        if material.anisotropy_map is not None:
            _, record["anisotropy_texture"] = self._textures.slot(material.anisotropy_map, limit=1.0)
            record["anisotropy_strength"] = material.anisotropy_map.strength
            record["anisotropy_turn"] = _turn(material)
        self._number(record, "specular", material.specular)
        self._colour(record, "specular_color", "specular_color_texture", material.specular_color, 1.0)
        self._number(record, "transmission", material.transmission)
        self._number(record, "coat", material.clearcoat)
        coat_roughness = self._roughness(record, "coat_roughness_texture", material.clearcoat_roughness)
        record["coat_flat"] = material.clearcoat_flat
        if material.clearcoat_normal_map is not None:
            _, record["coat_normal_texture"] = self._textures.slot(material.clearcoat_normal_map, limit=1.0)
            record["coat_normal_strength"] = material.clearcoat_normal_map.strength
        record["coat_alpha"] = models.alpha_pair(coat_roughness, 0.0)[0]
        if not isinstance(material.sheen, tuple) or max(material.sheen) > 0:
            self._sheen(record, material)
        if material.thin_film is not None and material.thin_film.share > 0:
            self._film(record, material, material.thin_film)

    def _film(self, record: np.void, material: models.Principled, film: models.ThinFilm) -> None:
        """Write the reflectance by the cosine, and the cover that leaves the diffuse base what the film lets in."""
        dielectric, metal = film_colours(material, film)
        metallic = float(record["metallic"])
        colours = ((1 - metallic) * dielectric + metallic * metal).astype(np.float32)
        record["first"] = 1 + self._textures.add_table(f"film {content_name(colours)}", colours.ravel().view(np.uint32))
        # where a texture gives the roughness, smooth: rough facets reflect no more
        alpha = float(record["alpha"]) if record["roughness_texture"] < 0 else 0.0
        at, most = np.linspace(0, 1, FILM_COSINES), dielectric.max(axis=1)
        cover = fitted_cover((max(alpha, 1e-3),) * 2, lambda cosine: np.interp(cosine, at, most))
        fill(record, cover=cover[:4], cover_last=cover[4])

    def _sheen(self, record: np.void, material: models.Principled) -> None:
        self._colour(record, "sheen", "sheen_texture", material.sheen, 1.0)
        _, members = sheen_lobe(models.alpha_pair(material.sheen_roughness, 0.0)[0])
        fill(record, **members)
        record["once"][2] = sheen_mean(members)


FILM_COSINES = 128


def film_reflectance(cosine: Array, thickness_nm: float, index: float, base: Array) -> Array:
    """Return the reflectance of a film on a base of real index, wavelengths last (Airy; Born and Wolf 7.6)."""
    sine2 = (1 - cosine**2)[..., None]
    first = np.broadcast_to(cosine[..., None], (*cosine.shape, len(WAVELENGTHS_NM)))
    inside, behind = np.sqrt(index**2 - sine2 + 0j), np.sqrt(base**2 - sine2 + 0j)  # n cos of each medium
    phase = np.exp(4j * np.pi * thickness_nm * inside / WAVELENGTHS_NM)
    total = np.zeros(first.shape)
    for a, b, c in ((first, inside, behind), (1 / first, index**2 / inside, base**2 / behind)):  # s and p admittances
        upper, lower = (a - b) / (a + b), (b - c) / (b + c)
        total = total + 0.5 * np.abs((upper + lower * phase) / (1 + upper * lower * phase)) ** 2
    return np.asarray(total)


def film_colours(material: models.Principled, film: models.ThinFilm) -> tuple[Array, Array]:
    """Return the reflectance of a dielectric and of a metal with a thin film (cosines from 0 to 1, 3), linear sRGB.

    Each base has in each channel the index that its colour has head-on, as glTF has it.
    """
    specular = material.specular
    assert isinstance(specular, float)  # by Principled.takes_film
    cosine = np.maximum(np.linspace(0, 1, FILM_COSINES), 1e-6)
    f0 = specular * np.array(material.specular_color) * ((material.index - 1) / (material.index + 1)) ** 2
    # a texture for the colour of a metal stands only where there is none of it
    metal = np.array(material.base_color) if isinstance(material.base_color, tuple) else np.zeros(3)
    parts = []
    for normal, most in ((f0, specular), (metal, 1.0)):
        bare = normal + (most - normal) * (1 - cosine[:, None]) ** 5
        root = np.sqrt(np.clip(normal / max(most, 1e-9), 0, 0.9999))
        coloured = np.empty_like(bare)
        for value in np.unique(root):
            spectra = film_reflectance(cosine, film.thickness_nm, film.index, (1 + value) / (1 - value))
            rgb = np.clip(most * srgb_from_reflectance(spectra), 0, 1)
            coloured[:, root == value] = rgb[:, root == value]
        parts.append((1 - film.share) * bare + film.share * coloured)
    return parts[0], parts[1]


def _facets(record: np.void, material: _Faceted, alphas: tuple[float, float]) -> None:
    record["alpha"], record["alpha_across"] = alphas
    if alphas[0] != alphas[1]:
        record["anisotropy_turn"] = _turn(material)


def _turn(material: _Faceted) -> float:
    return material.anisotropy_rotation_degrees / 360 % 1


def _cover(record: np.void, material: models.Plastic) -> None:
    if material.alphas is None:
        mean = smooth_mean(material.index)
    else:
        cover = rough_cover(material.alphas, material.index)
        record["cover"], record["cover_last"] = cover[:4], cover[4]
        mean = cover_mean(cover)
    record["internal"] = internal_reflectance(mean, material.index)


def _facts(records: NDArray[np.void]) -> dict[str, int]:
    """Which kinds and features the records have."""
    kinds = set(records["kind"].tolist())
    principled = records["kind"] == MaterialKind.PRINCIPLED
    clear = np.isin(records["kind"], (MaterialKind.DIELECTRIC, MaterialKind.ROUGH_DIELECTRIC, MaterialKind.PRINCIPLED))
    based = principled | (records["kind"] == MaterialKind.ROUGH_PLASTIC)
    coated = principled & ((records["coat"] > 0) | (records["coat_texture"] >= 0))
    flat = (records["coat_flat"] != 0) & ((records["normal_texture"] >= 0) | (records["bump_texture"] >= 0))
    clearing = records["transmission_texture"] >= 0
    glass = records[np.isin(records["kind"], (MaterialKind.DIELECTRIC, MaterialKind.ROUGH_DIELECTRIC))]
    white = np.array((1, 1, 1, 0), np.float32)
    stained = np.any((glass["color"] != white) | (glass["passed"] != white)) or np.any(glass["texture"] >= 0)
    tinted = records["specular_color"][principled] != (1, 1, 1, 0)
    brushed = records["anisotropy_texture"] >= 0
    facts = {f"HAS_{kind.name}": int(kind in kinds) for kind in MaterialKind} | MATERIAL.facts_of(records)
    features: dict[str, Any] = {
        "FACET_ENERGY": _scatters_again(records),
        "FACET_SHARES": np.any(records["brushed_alphas"] > 0)
        or (_scatters_again(records) and np.any(records["share_levels"] > 0)),
        "HAS_MEDIA": False,  # unless the plan finds some
        "HAS_LAYERED_FOG": False,
        "HAS_ANISOTROPY": _is_brushed(records),
        "HAS_BRUSHED_BASE": np.any(records["brushed_alphas"][based] > 0),
        "HAS_ANISOTROPY_TURN": np.any(records["anisotropy_turn"][~brushed] != 0),
        "HAS_TRANSMISSION": np.any(records["transmission"][principled] > 0) or np.any(clearing),
        "HAS_CLEARCOAT": np.any(coated),
        "HAS_METALLIC": np.any(records["metallic"][principled] > 0)
        or np.any(records["metallic_texture"][principled] >= 0),
        "HAS_COAT_NORMAL": np.any(coated & ((records["coat_normal_texture"] >= 0) | flat)),
        "HAS_SHEEN": np.any(records["sheen"][principled] > 0) or np.any(records["sheen_texture"] >= 0),
        "HAS_ABSORPTION": np.any(records["absorption"][clear] > 0),
        "HAS_THIN_FILM": np.any(records["first"][principled] > 0),
        "HAS_GLOW": np.any(records["glow"] > 0) or np.any(records["glow_texture"] >= 0),
        "HAS_GLOW_BEHIND": np.any(records["glow_behind"] > 0),
        "HAS_SPECULAR_COLOR": np.any(tinted) or np.any(records["specular_color_texture"] >= 0),
        "HAS_DISPERSION": np.any(records["dispersion_terms"] > 0),
        "HAS_GLASS_TINT": stained or np.any(glass["passed_texture"] >= 0),
        "HAS_OREN_NAYAR": np.any(records["parameter"][records["kind"] == MaterialKind.MATTE] > 0),
        "HAS_OPACITY": np.any(records["opacity"] < 1) or np.any(records["opacity_texture"] >= 0),
    }
    return facts | {name: int(value) for name, value in features.items()}


def _white(count: int) -> NDArray[np.void]:
    """Return records of materials of no kind: white, without textures or holes."""
    records = MATERIAL.zeros(count)
    white = (1.0, 1.0, 1.0)
    fill(
        records,
        color=white,
        once=(1.0, 1.0, 0.0, 0.0),
        passed=white,
        specular_color=white,
        opacity=1.0,
        **dict.fromkeys(MATERIAL_TEXTURES, -1),
    )
    return records


def pack_materials(materials: Collection[models.Material], textures: TextureTable, spectra: KnownSpectra) -> Materials:
    """Return one record per distinct material, those that are mixed included; collect their textures and spectra."""
    parts = [part for material in materials if isinstance(material, models.Mix) for part in material.materials]
    distinct = list({id(material): material for material in (*materials, *parts)}.values())
    index = {id(material): place for place, material in enumerate(distinct)}
    records = _white(len(distinct))
    filler = _Filler(textures, spectra)
    for record, material in zip(records, distinct, strict=False):
        filler.fill(record, material)
        if isinstance(material, models.Mix):
            record["first"], record["second"] = (index[id(part)] for part in material.materials)
    if not distinct:
        records["kind"], records["color"] = -1, 0.0
    _place_tables(records)
    records["textured"] = np.any([records[name] >= 0 for name in MATERIAL_TEXTURES], axis=0)
    records["textured"] |= records["kind"] == MaterialKind.MIX
    return Materials(records, index, _facts(records))
