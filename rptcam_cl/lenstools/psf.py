"""The image of a point by geometrical optics: the share of its light that each small square of the film receives."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.charts import new_figure, styled
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.lenstools.spots import NOTHING, STAYS, FilmSpot, fewer, spot_facts, spots_move

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SIDE = 6.0  # of the plot [inches]
SHARES = (0.5, 0.8, 0.95)
ROOM = 1.1  # half width of the image over the radius that holds nearly all light, when none is given


@dataclass(frozen=True)
class PointImage:
    """The image of a point.

    Attributes
    ----------
    shares : (n, n) array
        Share of the light in each pixel, row 0 at the top (largest y). What falls outside is missing from the sum.
    width_um : float
        Side of the image on the film, about the centroid [micrometres].
    facts : mapping
        Centroid, rms, and radii about the centroid that enclose shares of the light [micrometres], and by how much rms
        and radii change with half as many rays across.
    """

    shares: Array
    width_um: float
    facts: dict[str, float]


def point_image(spots: Sequence[FilmSpot], pixels: int, width_um: float | None = None) -> PointImage:
    """Return the image of one field, its wavelengths together.

    Parameters
    ----------
    spots : sequence of FilmSpot
        Of one field.
    pixels : int
        Along each side.
    width_um : float, optional
        Side of the image; as large as the light needs when absent.
    """
    if pixels < 2:
        raise InputError(f"an image needs at least 2 pixels a side (got {pixels})")
    points = np.concatenate([spot.points for spot in spots])
    facts, less = spot_facts(points), fewer(spots)
    off, radii = _radii(points)
    names = [f"radius_of_{100 * share:.0f}_percent_um" for share in SHARES]
    facts |= dict(zip(names, np.quantile(radii, SHARES).tolist(), strict=True))
    if less and len(before := np.concatenate([spot.points for spot in less])):
        facts["rms_error_um"] = abs(facts["rms_um"] - spot_facts(before)["rms_um"])
        changes = np.quantile(_radii(before)[1], SHARES) - np.quantile(radii, SHARES)
        facts["radius_error_um"] = float(np.abs(changes).max())
    half = (width_um or 2 * ROOM * max(float(np.quantile(radii, 0.99)), 1e-6)) / 2
    counts, _, _ = np.histogram2d(-off[:, 1], off[:, 0], bins=pixels, range=[[-half, half], [-half, half]])
    return PointImage(counts / len(points), 2 * half, facts)


def image_moves(few: Sequence[FilmSpot], many: Sequence[FilmSpot]) -> float:
    """Return how far rms and radii of an image of a point move with more rays, in units of what they may."""
    one, other = (np.concatenate([spot.points for spot in group]) for group in (few, many))
    if not len(one) or not len(other):
        return 0.0 if len(one) == len(other) else np.inf
    one, other = (np.quantile(_radii(points)[1], SHARES) for points in (one, other))
    return max(spots_move(few, many), float(np.max(np.abs(one - other) / (STAYS * other + 1e3 * NOTHING))))


def _radii(points: Array) -> tuple[Array, Array]:
    """Return points (n, 2) from their centroid, and how far they are from it (n,) [micrometres]."""
    off = (points - points.mean(axis=0)) * 1e3
    return off, np.hypot(off[:, 0], off[:, 1])


def npy_bytes(image: PointImage) -> bytes:
    """Return the shares as a NumPy file, float32."""
    out = io.BytesIO()
    np.save(out, image.shares.astype(np.float32))
    return out.getvalue()


@styled()
def psf_chart(setting: Setting, image: PointImage, field_degrees: float) -> Figure:
    """Return the image of a point as it is seen, bright on dark, with the share of light that a pixel receives."""
    figure = new_figure(f"{setting.lens.name}: image of a point at {field_degrees:g}°", (SIDE + 1.4, SIDE))
    axes = figure.add_subplot()
    half = image.width_um / 2
    shown = axes.imshow(100 * image.shares, cmap="inferno", vmin=0.0, extent=(-half, half, -half, half))
    axes.set(xlabel="x from the centroid [µm]", ylabel="y from the centroid [µm]")
    axes.grid(visible=False)
    pixel = image.width_um / len(image.shares)
    figure.colorbar(shown, ax=axes, label=f"light in a square of {pixel:.3g} µm [% of all]")
    return figure
