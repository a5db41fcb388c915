"""Plots of how a camera model errs over the picture, and of maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rptcam_cl.calibration.fit import Calibration
from rptcam_cl.calibration.view import View
from rptcam_cl.lenstools import new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 8.0  # of the plot [inches]
EVERY = 3  # cells between arrows


@styled()
def residual_chart(view: View, calibration: Calibration) -> Figure:
    """Return the errors of a camera model over the picture: their size as a map, and arrows along them."""
    columns, rows = view.size
    figure = new_figure(
        f"{view.name}: {calibration.model} against chief rays, rms {calibration.rms_px:.2g} px,"
        f" at most {calibration.max_px:.2g} px",
        (WIDTH, 1.0 + (WIDTH - 1.4) * rows / columns),
    )
    axes = figure.add_subplot()
    length = np.linalg.norm(calibration.errors, axis=-1)
    down, across = length.shape
    x, y = np.meshgrid(np.linspace(0, columns, across), np.linspace(0, rows, down))
    left, top = x[0, 1] / 2, y[1, 0] / 2  # half of what a place at the edge stands for lies beside the picture
    around = (-left, columns + left, rows + top, -top)
    shown = axes.imshow(length, cmap="viridis", extent=around, vmin=0.0, aspect="equal")
    axes.set(xlabel="column [px]", ylabel="row [px]", xlim=(0, columns), ylim=(rows, 0))
    axes.grid(visible=False)
    part = np.s_[EVERY // 2 :: EVERY, EVERY // 2 :: EVERY]
    if calibration.max_px > 0:
        errors = calibration.errors[part] / calibration.max_px
        axes.quiver(
            x[part], y[part], errors[..., 0], -errors[..., 1], color="white", scale=18, width=0.003, pivot="middle"
        )
    figure.colorbar(shown, ax=axes, label="error [px]", shrink=0.85)
    return figure
