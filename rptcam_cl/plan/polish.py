"""What of a material reflects like a mirror, or nearly: how much of the light, and how far it spreads it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import MaterialKind

Array = NDArray[np.float64]

SMOOTH_ALPHA = 0.05  # GGX's alpha of what counts as polished
SPREADING_ALPHA = 0.002  # from which what it spreads counts
COAT_REFLECTANCE = 0.04
PAINTED = ("roughness", "metallic", "coat", "anisotropy", "specular", "specular_color")  # what a texture may replace
COVERS = (MaterialKind.DIELECTRIC, MaterialKind.ROUGH_DIELECTRIC, MaterialKind.PLASTIC, MaterialKind.ROUGH_PLASTIC)


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
            found = float(record["coat"]) * _coat(cosine)[:, None] * np.ones(3)
        elif kind is MaterialKind.METAL:
            n, k = (record[name][:3].astype(np.float64) for name in ("metal_n", "metal_k"))
            found = colour * _of_metal(cosine[:, None], n, k)
        elif kind is MaterialKind.THIN_GLASS:
            found = colour * _of_pane(cosine, index, record["absorption"][:3].astype(np.float64))
        elif kind is MaterialKind.PRINCIPLED:
            found = _of_principled(record, cosine)
        elif kind in COVERS:
            found = _fresnel(cosine, np.where(behind, 1.0 / index, index))[:, None] * np.ones(3)
        else:
            found = np.tile(colour, (len(cosine), 1))
        return np.asarray(self.share * found)


def lobes_of(materials: NDArray[np.void], index: int, share: float = 1.0) -> Iterator[Lobe]:
    """Yield the shares of a material that reflect like a mirror, or nearly.

    There are none of what textures make rough, uneven or full of holes, as far as no single number says how much.
    """
    record = materials[index]
    kind = MaterialKind(int(record["kind"]))
    if record["opacity_texture"] >= 0 or record["normal_texture"] >= 0:
        return
    share *= float(record["opacity"] if record["cutoff"] == 0 else record["opacity"] >= record["cutoff"])
    if kind is MaterialKind.MIX:
        if record["factor_texture"] < 0:
            yield from lobes_of(materials, int(record["first"]), share * (1.0 - float(record["factor"])))
            yield from lobes_of(materials, int(record["second"]), share * float(record["factor"]))
        return
    alpha = float(np.sqrt(record["alpha"] * record["alpha_across"]))
    if kind in (MaterialKind.MIRROR, MaterialKind.THIN_GLASS, MaterialKind.DIELECTRIC, MaterialKind.PLASTIC):
        alpha = 0.0
    elif kind in (MaterialKind.MATTE, MaterialKind.EMISSIVE):
        return
    coloured = kind in (MaterialKind.CONDUCTOR, MaterialKind.METAL, MaterialKind.PRINCIPLED) and record["texture"] >= 0
    painted = coloured or max(record[f"{name}_texture"] for name in PAINTED) >= 0
    if share > 0 and alpha <= SMOOTH_ALPHA and not painted:
        yield Lobe(record, share, alpha)
    even = max(record[f"coat_{name}texture"] for name in ("", "roughness_", "normal_")) < 0
    coated = kind is MaterialKind.PRINCIPLED and record["coat"] > 0 and record["coat_alpha"] <= SMOOTH_ALPHA
    if share > 0 and coated and even:
        yield Lobe(record, share, float(record["coat_alpha"]), coat=True)


def _fresnel(cosine: Array, eta: Array) -> Array:
    """Return the reflectance of a dielectric; `eta` is the index behind the surface over that in front."""
    sine2 = (1.0 - cosine**2) / eta**2
    beyond = np.sqrt(np.maximum(1.0 - sine2, 0.0))
    s = (cosine - eta * beyond) / (cosine + eta * beyond)
    p = (eta * cosine - beyond) / (eta * cosine + beyond)
    return np.asarray(np.where(sine2 >= 1.0, 1.0, 0.5 * (s * s + p * p)))


def _of_metal(cosine: Array, n: Array, k: Array) -> Array:
    """Return the reflectance of a metal of index n + i k."""
    root = np.sqrt((n + 1j * k) ** 2 - (1.0 - cosine**2))
    s = (cosine - root) / (cosine + root)
    p = ((n + 1j * k) ** 2 * cosine - root) / ((n + 1j * k) ** 2 * cosine + root)
    return np.asarray(0.5 * (np.abs(s) ** 2 + np.abs(p) ** 2))


def _of_pane(cosine: Array, index: float, depth: Array) -> Array:
    """Return what both faces of a pane reflect together."""
    r = _fresnel(cosine, np.full_like(cosine, index))[:, None]
    inside = np.sqrt(np.maximum(1.0 - (1.0 - cosine**2) / index**2, 1e-12))[:, None]
    t2 = np.exp(-2.0 * depth / inside)
    return np.asarray(r + (1.0 - r) ** 2 * r * t2 / np.maximum(1.0 - r * r * t2, 1e-30))


def _schlick(cosine: Array) -> Array:
    return np.asarray(np.maximum(1.0 - cosine, 0.0) ** 5)


def _coat(cosine: Array) -> Array:
    return COAT_REFLECTANCE + (1.0 - COAT_REFLECTANCE) * _schlick(cosine)


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
