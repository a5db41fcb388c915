"""Diffraction of a rendered film: whether it shows, and the film with it.

The rays have brought the geometrical image, defocus and aberrations included. The film receives its convolution with
what the opening, as that part of the film sees it, makes of a point by a perfect wavefront: docs/diffraction.md says
why, and how far that is from the full wave image.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import FilmPupil, FilmPupils, dirt_edges, edges_of, film_frame, film_pupils
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.diffraction_kernel import kernel, reach_px, unit_px
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.patch_blur import blurred
from rptcam_cl.rendering.starburst import FarLight, lamps_of, strewn
from rptcam_cl.scene import Scene

Array = NDArray[np.float64]

AIRY = 1.2196698912665045  # radius of the first dark ring, in wavelength times f-number
SHOWS_PX = 0.5  # Airy radius from which `auto` takes it: as much as `camera.accuracy: auto` lets light stray
NODES = (5, 3)  # along the longer and the shorter side of the film
NODE_PX = 16  # least distance between nodes


@dataclass(frozen=True)
class FilmSpread:
    """What the openings that the film sees make of its light.

    Attributes
    ----------
    resolution : tuple of int
        Columns and rows of the whole film.
    pixel_mm : tuple of float
        Width and height of a pixel.
    pupils : tuple of FilmPupil
        The opening that each node sees, by rows of nodes.
    edges : (n, 4) array or None
        Of the opening that the film's middle sees, with its dirt, as `FarLight` has them; None where they are unknown.
    """

    resolution: tuple[int, int]
    pixel_mm: tuple[float, float]
    pupils: tuple[FilmPupil, ...]
    edges: Array | None = None

    @cached_property
    def reach(self) -> int:
        """Of the kernels [pixels]."""
        return reach_px(max(unit_px(pupil, self.pixel_mm) for pupil in self.pupils), max(self.resolution))

    @cached_property
    def kernels(self) -> tuple[tuple[Array, Array], list[Array]]:
        """Columns and rows of the nodes on the whole film, and the kernel of each."""
        found = [kernel(pupil, self.pixel_mm, self.reach)[:, :, ::-1] for pupil in self.pupils]  # x runs to the left
        return _nodes(self.resolution), found

    @cached_property
    def far(self) -> tuple[Array, Array]:
        """Share of the far light of red, green and blue, and its kernel over twice the whole film."""
        assert self.edges is not None
        light = FarLight(self.edges, self.pupils[len(self.pupils) // 2].index, self.pixel_mm, self.reach)
        return light.shares, light.kernel(*self.resolution)[:, :, ::-1]

    def over(self, pixels: NDArray[np.float32], layout: FilmLayout) -> NDArray[np.float32]:
        """Return a film (height, width, 3) of linear RGB with its light spread."""
        planes = np.moveaxis(pixels.astype(np.float64), -1, 0)
        lamps = lamps_of(planes)
        if self.edges is None or not lamps.any():
            spread = blurred(planes, (layout.x, layout.y), *self.kernels)
        else:
            shares, light = self.far
            spread = blurred(planes - lamps * shares[:, None, None], (layout.x, layout.y), *self.kernels)
            spread += strewn(lamps, light)
        return np.ascontiguousarray(np.moveaxis(spread, 0, -1), dtype=np.float32)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what `spread_of` makes the same of; shares of coverage are sixteenths, which float32 holds."""
        return {
            "diffraction_pixel_mm": np.array(self.pixel_mm),
            "diffraction_coverage": np.array([pupil.coverage for pupil in self.pupils], np.float32),
            "diffraction_cosines": np.array([[pupil.cosines_x, pupil.cosines_y] for pupil in self.pupils]),
            "diffraction_index": np.array([pupil.index for pupil in self.pupils]),
            "diffraction_edges": np.zeros((0, 4)) if self.edges is None else self.edges,
        }


def spread_of(arrays: Mapping[str, NDArray[Any]], resolution: tuple[int, int]) -> FilmSpread | None:
    """Return what `FilmSpread.arrays` is of; None where there are none.

    Raises
    ------
    ValueError, KeyError
        They do not fit together.
    """
    if "diffraction_index" not in arrays:
        return None
    nodes = [len(axis) for axis in _nodes(resolution)]
    width, height = arrays["diffraction_pixel_mm"].tolist()
    coverage, cosines = arrays["diffraction_coverage"], arrays["diffraction_cosines"]
    count, cells = nodes[0] * nodes[1], cosines.shape[-1]
    if not min(width, height) > 0 or coverage.shape != (count, cells, cells) or cosines.shape != (count, 2, cells):
        raise ValueError("diffraction")
    pupils = tuple(
        FilmPupil(cover.astype(np.float64), x, y, float(index))
        for cover, (x, y), index in zip(coverage, cosines, arrays["diffraction_index"], strict=True)
    )
    edges = arrays["diffraction_edges"]
    if edges.ndim != 2 or edges.shape[1] != 4 or not np.isfinite(edges).all():
        raise ValueError("diffraction")
    return FilmSpread(resolution, (width, height), pupils, edges if len(edges) else None)


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
    pupils: FilmPupils | None

    @cached_property
    def spread(self) -> FilmSpread:
        """What the openings do, of nodes on the whole film.

        A node that no light reaches takes the opening of the film's middle, as it has nothing to spread.
        """
        film = self.scene.film
        columns, rows = _nodes(film.resolution)
        seen = tuple(self._seen(_film_point(self.scene, column, row)) for row in rows for column in columns)
        near = FilmSpread(film.resolution, _pixel_mm(self.scene), seen)
        return near if near.reach >= max(film.resolution) else replace(near, edges=self._edges)

    @cached_property
    def _edges(self) -> Array | None:
        """Edges of the opening that the middle of the film sees, and of the dirt in it."""
        assert self.pupils is not None
        outline, dirt = self.pupils.outline(np.zeros(2)), self.scene.camera.stop.dirt
        if outline is None:
            return None
        own = edges_of(outline)
        return own if dirt is None else np.concatenate([own, dirt_edges(dirt, outline, self.pupils.radius_mm)])

    def _seen(self, point: Array) -> FilmPupil:
        assert self.pupils is not None
        try:
            return self.pupils(point)
        except InputError:
            return self.pupils(np.zeros(2))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a saved render needs so that `merge` can apply it without the scene; none where it is off."""
        return self.spread.arrays() if self.is_on else {}

    @property
    def metadata(self) -> dict[str, Any]:
        """What the picture's metadata should say."""
        radius = self.airy_radius_px
        if radius is None:
            says = "off: no opening forms an image in the middle of the film"
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
    if not film_frame(scene.camera).is_flat:  # `on` is refused there
        return Diffraction(scene, False, None, None)
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
    return found.spread.over(pixels, FilmLayout.of(found.scene.film))


def _nodes(resolution: tuple[int, int]) -> tuple[Array, Array]:
    """Return columns and rows of the nodes on a film [pixels]."""
    order = NODES if resolution[0] >= resolution[1] else NODES[::-1]
    columns, rows = (_along(side, most) for side, most in zip(resolution, order, strict=True))
    return columns, rows


def _along(pixels: int, most: int) -> Array:
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
    film = sense * np.array([((column + 0.5) / columns - 0.5) * width, (0.5 - (row + 0.5) / rows) * height])
    return film_frame(scene.camera).points(film)[:2]
