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
    shown = axes.imshow(length, cmap="viridis", extent=(0, columns, rows, 0), vmin=0.0, aspect="equal")
    axes.set(xlabel="column [px]", ylabel="row [px]")
    axes.grid(visible=False)
    down, across = length.shape
    x, y = np.meshgrid((np.arange(across) + 0.5) * columns / across, (np.arange(down) + 0.5) * rows / down)
    part = np.s_[EVERY // 2 :: EVERY, EVERY // 2 :: EVERY]
    if calibration.max_px > 0:
        errors = calibration.errors[part] / calibration.max_px
        axes.quiver(
            x[part], y[part], errors[..., 0], -errors[..., 1], color="white", scale=18, width=0.003, pivot="middle"
        )
    figure.colorbar(shown, ax=axes, label="error [px]", shrink=0.85)
    return figure
