"""A tolerance run as plain data: for JSON, and for tables."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from rptcam_cl.core.errors import InputError
from rptcam_cl.tolerances.run import ToleranceRun
from rptcam_cl.tolerances.statistics import Interval

PERCENTILES = (10.0, 25.0, 50.0, 75.0, 90.0, 95.0, 98.0)
CURVE = 41  # points of a yield curve


def percentile_rows(run: ToleranceRun) -> list[dict[str, Any]]:
    """Return a row for each of `PERCENTILES`: the merit that this percent of copies reach, and which copy does."""
    rows = []
    for percent in PERCENTILES:
        number = run.copy_at(percent)
        found = run.percentile(percent)
        rows.append(
            {
                "percent": percent,
                "copy": number,
                "spot_um": float(run.scores.spot_um[number]),
                "mtf": float(run.scores.modulation[number]),
                "low": found.low,
                "high": found.high,
                "shift_mm": float(run.scores.shifts_mm[number]),
            }
        )
    return rows


def yield_curve(run: ToleranceRun, points: int = CURVE) -> list[tuple[float, Interval]]:
    """Return limits of the merit and which share of all copies is as good: from the best to the worst in whose fields
    light arrives.
    """
    merit = run.scores.by(run.rank_by)
    merit = merit[np.isfinite(merit)]
    if not len(merit):
        raise InputError(f"{run.lens.name}: every copy loses the light of some field; the tolerances are too wide")
    return [(float(limit), run.yield_at(float(limit))) for limit in np.linspace(merit.min(), merit.max(), points)]


def report(run: ToleranceRun) -> dict[str, Any]:
    """Return everything about a run but the numbers of each copy."""
    merit = run.tolerances.merit
    return {
        "lens": run.lens.name,
        "tolerances": run.tolerances.name,
        "source": run.tolerances.source,
        "rank_by": run.rank_by,
        "copies": run.copies.count,
        "refocus": run.tolerances.refocus,
        "fields_degrees": list(run.fields_degrees),
        "wavelengths_nm": list(merit.wavelengths_nm),
        "mtf_per_mm": merit.mtf_per_mm,
        "film_distance_mm": run.film_distance_mm,
        "design": {"spot_um": float(run.design.spot_um[0]), "mtf": float(run.design.modulation[0])},
        "sampling_error": {"spot_share": run.spot_error, "mtf": run.mtf_error},
        "percentiles": percentile_rows(run),
        "yield": [{"limit": limit, **found._asdict()} for limit, found in yield_curve(run)],
        "sensitivities": [asdict(one) for one in run.sensitivities],
    }
