"""Modulation transfer: that of the spots times that of diffraction at the aperture that each field has.

The geometrical transfer knows no diffraction and exceeds its limit where a lens is sharp. The transfer of a lens is
that of its perfect pupil times a factor of its aberrations (Wetherell, The Calculation of Image Quality, 1980), for
which the geometrical one stands here: right where aberrations are none or many waves, and never above the limit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.lenstools.charts import add_key, new_chart, series, styled
from rptcam_cl.lenstools.colours import FAINT, INK
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.lenstools.spots import FilmSpot, Moves, by_field, fewer
from rptcam_cl.optics import diffraction_mtf

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

CURVE = 101
COLUMNS = ("tangential", "sagittal", "tangential_limit", "sagittal_limit")
STAYS = 0.005  # modulation by which twice as many rays across may change it


def geometric_mtf(points: Array, frequencies_per_mm: ArrayLike) -> tuple[Array, Array]:
    """Return the modulation (tangential, sagittal) of light spread over points (n, 2) of the film [mm].

    Tangential lines lie along x, so that they blur in y; sagittal ones along y. Each is the length of the mean of
    exp(-2 pi i f y) over the rays, the Fourier transform of the spot.
    """
    waves = -2j * np.pi * np.asarray(frequencies_per_mm, dtype=np.float64)[:, None]
    off = points - points.mean(axis=0)
    tangential, sagittal = (np.abs(np.mean(np.exp(waves * off[:, axis]), axis=1)) for axis in (1, 0))
    return tangential, sagittal


def limits(group: Sequence[FilmSpot], frequencies_per_mm: ArrayLike) -> tuple[Array, Array]:
    """Return the modulation (tangential, sagittal) that diffraction leaves the spots of one field.

    The mean over the wavelengths by their rays. A pupil that is not round counts as the ellipse of its second moments.
    """
    rays = np.array([len(spot.points) for spot in group], dtype=np.float64)
    curves = [
        np.average([diffraction_mtf(frequencies_per_mm, spot.cone[axis], spot.wavelength_nm) for spot in group],
                   axis=0, weights=rays)
        for axis in (1, 0)
    ]  # fmt: skip
    return curves[0], curves[1]


def field_mtf(group: Sequence[FilmSpot], frequencies_per_mm: ArrayLike) -> list[Array] | None:
    """Return tangential and sagittal modulation and the limit of each, of one field; None when no light passes."""
    points = np.concatenate([spot.points for spot in group])
    if not len(points):
        return None
    most = limits(group, frequencies_per_mm)
    drawn = geometric_mtf(points, frequencies_per_mm)
    return [*(shape * limit for shape, limit in zip(drawn, most, strict=True)), *most]


def mtf_moves(frequencies_per_mm: Sequence[float]) -> Moves:
    """Return what says how far the modulation of a field moves with more rays, in units of what it may.

    Rays that lie farther apart on the film than half a period of the finest lines show nothing of these.
    """

    def moves(few: Sequence[FilmSpot], many: Sequence[FilmSpot]) -> float:
        for spot in few:
            if len(spot.points) and np.ptp(spot.points, axis=0).max() * max(frequencies_per_mm) > math.sqrt(
                len(spot.points)
            ):
                return math.inf
        one, other = (field_mtf(group, frequencies_per_mm) for group in (few, many))
        if one is None or other is None:
            return 0.0 if one is other else math.inf
        return float(max(np.abs(a - b).max() for a, b in zip(one[:2], other[:2], strict=True))) / STAYS

    return moves


def mtf_table(spots: Sequence[FilmSpot], frequencies_per_mm: Sequence[float]) -> list[dict[str, Any]]:
    """Return a row for each field and frequency, the wavelengths of a field together; None where no light passes.

    ``error`` is what half as many rays across change of either modulation.
    """
    groups = by_field(spots)
    fields = {degrees: field_mtf(group, frequencies_per_mm) for degrees, group in groups.items()}
    rows = table_of(fields, frequencies_per_mm)
    before = table_of(
        {degrees: field_mtf(less, frequencies_per_mm) if (less := fewer(group)) else None
         for degrees, group in groups.items()},
        frequencies_per_mm,
    )  # fmt: skip
    for row, other in zip(rows, before, strict=True):
        known = row["tangential"] is not None and other["tangential"] is not None
        row["error"] = max(abs(row[name] - other[name]) for name in COLUMNS[:2]) if known else None
    return rows


def table_of(
    fields: Mapping[float, Sequence[Array] | None], frequencies_per_mm: Sequence[float]
) -> list[dict[str, Any]]:
    """Return a row for each field and frequency, of curves as `field_mtf` has them."""
    rows = []
    for degrees, curves in fields.items():
        for k, frequency in enumerate(frequencies_per_mm):
            values = [None] * len(COLUMNS) if curves is None else [float(curve[k]) for curve in curves]
            modulation = dict(zip(COLUMNS, values, strict=True))
            rows.append({"field_degrees": degrees, "frequency_per_mm": frequency, **modulation})
    return rows


def mtf_chart(setting: Setting, spots: Sequence[FilmSpot], highest_per_mm: float) -> Figure:
    """Return the curves of every field up to a frequency."""
    frequencies = np.linspace(0.0, highest_per_mm, CURVE)
    curves = {degrees: field_mtf(group, frequencies) for degrees, group in by_field(spots).items()}
    return curves_chart(f"{setting.lens.name}: MTF, geometrical times diffraction", frequencies, curves)


@styled()
def curves_chart(title: str, frequencies: Array, fields: Mapping[float, Sequence[Array] | None]) -> Figure:
    """Return a chart of curves as `field_mtf` has them: tangential full, sagittal dashed, the first limit dotted."""
    from matplotlib.lines import Line2D

    labels = ("frequency on the film [cycles/mm]", "modulation [%]")
    figure, axes = new_chart(title, labels, (0.0, float(frequencies[-1])), (0.0, 102.0))
    keys: list[Artist] = []
    for number, (degrees, curves) in enumerate(fields.items()):
        if curves is None:
            continue
        tangential, sagittal, limit, _ = (100 * curve for curve in curves)
        if number == 0:
            axes.plot(frequencies, limit, ":", color=FAINT)
        keys += axes.plot(frequencies, tangential, color=series(number), label=f"{degrees:g}°")
        axes.plot(frequencies, sagittal, "--", color=series(number))
    keys.append(Line2D([], [], color=INK, label="tangential"))
    keys.append(Line2D([], [], color=INK, linestyle="--", label="sagittal"))
    keys.append(Line2D([], [], color=FAINT, linestyle=":", label="diffraction limit"))
    add_key(figure, keys)
    return figure
