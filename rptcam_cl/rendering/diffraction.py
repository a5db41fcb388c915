"""Diffraction of a rendered film: whether it shows, and the film with it.

The rays have brought the geometrical image, defocus and aberrations included. The film receives its convolution with
what the opening, as that part of the film sees it, makes of a point by a perfect wavefront: docs/diffraction.md says
why, and how far that is from the full wave image.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import FilmPupil, film_pupils
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.diffraction_kernel import kernel, reach_px, unit_px
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.patch_blur import blurred
from rptcam_cl.scene import Scene

Array = NDArray[np.float64]

AIRY = 1.2196698912665045  # radius of the first dark ring, in wavelength times f-number
SHOWS_PX = 0.5  # Airy radius from which `auto` takes it: as much as `camera.accuracy: auto` lets light stray
NODES = (5, 3)  # along the longer and the shorter side of the film
NODE_PX = 16  # least distance between nodes


@dataclass(frozen=True)
class Diffraction:
    """What diffraction does to the film of a scene.

    Attributes
    ----------
    scene : Scene
        In focus, with the camera as requested, whatever cheaper one renders it.
    is_on : bool
    airy_radius_px : float or None
        In the middle of the film at 550 nm; None for a camera without an opening.
    pupils : callable or None
        Gives the opening that a point of the film sees.
    """

    scene: Scene
    is_on: bool
    airy_radius_px: float | None
    pupils: Callable[[Array], FilmPupil] | None

    @cached_property
    def kernels(self) -> tuple[tuple[Array, Array], list[Array]]:
        """Columns and rows of the nodes on the whole film, and the kernel of each.

        A node that no light reaches takes the kernel of the film's middle, as it has nothing to spread.
        """
        scene, pixel, sides = self.scene, _pixel_mm(self.scene), self.scene.film.resolution
        order = NODES if sides[0] >= sides[1] else NODES[::-1]
        columns, rows = (_nodes(side, most) for side, most in zip(sides, order, strict=True))
        seen = [self._seen(_film_point(scene, column, row)) for row in rows for column in columns]
        reach = reach_px(max(unit_px(pupil, pixel) for pupil in seen), max(sides))
        return (columns, rows), [kernel(pupil, pixel, reach)[:, :, ::-1] for pupil in seen]  # x runs to the left

    def _seen(self, point: Array) -> FilmPupil:
        assert self.pupils is not None
        try:
            return self.pupils(point)
        except InputError:
            return self.pupils(np.zeros(2))

    @property
    def metadata(self) -> dict[str, Any]:
        """What the picture's metadata should say."""
        radius = self.airy_radius_px
        if radius is None:
            says = "off: no light reaches the middle of the film through an opening"
        elif self.is_on:
            says = f"on: the Airy radius is {radius:.2g} px"
        else:
            says = f"off: the Airy radius is {radius:.2g} px, and shows from {SHOWS_PX:g} px"
        return {"on": self.is_on, "airy_radius_px": radius, "says": says}


def diffraction_of(scene: Scene) -> Diffraction | None:
    """Return what diffraction does to the film of a scene in focus; None where it is off.

    Raises
    ------
    InputError
        When the camera has no opening that diffracts, or no light reaches the film's middle.
    """
    choice = scene.camera.diffraction
    if choice == "off":
        return None
    try:
        pupils = film_pupils(scene)
        radius = AIRY * unit_px(pupils(np.zeros(2)), _pixel_mm(scene))
    except InputError:
        if choice == "on":
            raise
        return Diffraction(scene, False, None, None)
    return Diffraction(scene, choice == "on" or radius >= SHOWS_PX, radius, pupils)


def diffracted(found: Diffraction | None, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a film (height, width, 3) of linear RGB with its diffraction; the very same where that is off."""
    if found is None or not found.is_on:
        return pixels
    layout = FilmLayout.of(found.scene.film)
    nodes, kernels = found.kernels
    planes = np.moveaxis(pixels.astype(np.float64), -1, 0)
    spread = blurred(planes, (layout.x, layout.y), nodes, kernels)
    return np.ascontiguousarray(np.moveaxis(spread, 0, -1), dtype=np.float32)


def _nodes(pixels: int, most: int) -> Array:
    """Return places of nodes along a side of the film, from its first pixel to its last [pixels]."""
    count = min(most, 1 + pixels // NODE_PX)
    return np.array([(pixels - 1) / 2]) if count < 2 else np.linspace(0.0, pixels - 1.0, count)


def _pixel_mm(scene: Scene) -> tuple[float, float]:
    width, height = scene.film.size_m()
    columns, rows = scene.film.resolution
    return 1e3 * width / columns, 1e3 * height / rows


def _film_point(scene: Scene, column: float, row: float) -> Array:
    """Return where on the film the middle of a pixel lies [mm], in the frame of the lens."""
    (columns, rows), (width, height) = scene.film.resolution, scene.film.size_m()
    sense = -1e3 if scene.camera.flip else 1e3
    return sense * np.array([((column + 0.5) / columns - 0.5) * width, (0.5 - (row + 0.5) / rows) * height])
