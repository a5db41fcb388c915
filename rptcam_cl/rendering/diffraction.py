"""Diffraction of a rendered film: whether it shows, and the film with it.

The rays have brought the geometrical image. The film receives its convolution with what the opening, as that part of
the film sees it, makes of a point: of a lens by its wavefront, whose aberrations the rays leave out
(`stigmatic`), of other cameras by a perfect one. Small lamps are imaged by waves alone.
docs/diffraction.md says why, and how far that is from the full wave image.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.device.session import Session
from rptcam_cl.optics.waves import AIRY
from rptcam_cl.rendering import point_spread
from rptcam_cl.rendering.cameras.film_pupil import FilmPupil, FilmPupils, film_points
from rptcam_cl.rendering.cameras.ideal import dirt_edges, edges_of
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.setting import film_frame
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.lamps import UNLIKE, LampImage, Window, has_lamps, lamp_images, pixel_mm
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.point_waves import Conjugates, conjugates_of, kernel_of_waves
from rptcam_cl.scene.scene import Scene

#
# A picture blurred by a kernel that varies over it.
#
# Nodes lie on a grid over the whole film. A pixel's kernel is that of the four about it, weighted linearly, and the
# weights sum to 1. Lamps spread their light by the kernel of their own place, so that it stays as much. All else
# gathers its light by the kernel of the pixel that receives it, so that even light stays even where kernels widen fast,
# as at the end of an image circle. What leaves the picture is lost. What lies beside it is not known; it is taken to be
# as bright as the border, lamps apart.

Array = NDArray[np.float64]


def blur(
    planes: Array, lamps: Array, offset: tuple[int, int], nodes: tuple[Array, Array], kernels: Sequence[Array]
) -> Array:
    """Return planes (3, height, width) with their light spread.

    Parameters
    ----------
    planes
        In float64, with any dynamic range.
    lamps
        What of them does not go on beside the picture.
    offset
        Column and row of the first pixel on the whole film.
    nodes
        Columns and rows of the nodes on the whole film, rising.
    kernels
        One (3, k, k) for each node, by rows; k is odd, and may differ.
    """
    reach = max(part.shape[-1] // 2 for part in kernels)
    out = _blur(planes, lamps, offset, nodes, kernels, reach)
    return out[:, reach : reach + planes.shape[1], reach : reach + planes.shape[2]]


def _blur(
    planes: Array,
    lamps: Array,
    offset: tuple[int, int],
    nodes: tuple[Array, Array],
    kernels: Sequence[Array],
    reach: int,
) -> Array:
    """Return the same with so many pixels round it, for the light that lamps send there."""
    height, width = planes.shape[1:]
    even = np.pad(planes - lamps, ((0, 0), (reach, reach), (reach, reach)), mode="edge")
    out = np.zeros((3, height + 2 * reach, width + 2 * reach))
    weights = [_hats(axis, start + np.arange(length)) for axis, start, length in
               zip(nodes, offset, (width, height), strict=True)]  # fmt: skip
    for (row, column), kernel in zip(_places(nodes), kernels, strict=True):
        columns, rows = np.flatnonzero(weights[0][column]), np.flatnonzero(weights[1][row])
        if not len(columns) or not len(rows):
            continue
        left, right, top, bottom = columns[0], columns[-1] + 1, rows[0], rows[-1] + 1
        share, own = weights[1][row, top:bottom, None] * weights[0][column, left:right], kernel.shape[-1] // 2
        on_film = slice(reach + top, reach + bottom), slice(reach + left, reach + right)
        about = slice(reach - own + top, reach + own + bottom), slice(reach - own + left, reach + own + right)
        for plane, bright, part, target in zip(even, lamps[:, top:bottom, left:right], kernel, out, strict=True):
            checkpoint()
            target[on_film] += share * _convolve(plane[about], part, within=True)
            if bright.any():
                target[about] += _convolve(bright * share, part)
    return out


def _places(nodes: tuple[Array, Array]) -> Iterator[tuple[int, int]]:
    for row in range(len(nodes[1])):
        for column in range(len(nodes[0])):
            yield row, column


def _hats(nodes: Array, places: Array) -> Array:
    """Return the weight of each node at each place, (nodes, places); they sum to 1."""
    if len(nodes) == 1:
        return np.ones((1, len(places)))
    return np.array([np.interp(places, nodes, unit) for unit in np.eye(len(nodes))])


def _convolve(plane: Array, kernel: Array, *, within: bool = False) -> Array:
    """Return the full convolution, or the part within it that knows all about itself.

    Of what is nowhere negative, nothing is negative.
    """
    height, width = plane.shape if within else (a + b - 1 for a, b in zip(plane.shape, kernel.shape, strict=True))
    shape = point_spread.quick(height), point_spread.quick(width)
    spread = np.fft.irfft2(np.fft.rfft2(plane, shape) * np.fft.rfft2(kernel, shape), shape)[:height, :width]
    spread = spread[kernel.shape[0] - 1 :, kernel.shape[1] - 1 :] if within else spread  # what comes round lies before
    return np.maximum(spread, 0.0) if plane.min() >= 0 and kernel.min() >= 0 else spread


#
# The film with what its openings make of it.

_FINEST_PX = 0.03  # wavelength times f-number, below which no ring of a lamp shows
# Errors that `auto` leaves out, and from where the printed line has the light that is lost.
LOST_CONTRAST = 0.25  # of lines of two pixels in the film's middle, at 550 nm
SEEN_STAR = 0.03  # light of lamps some pixels away, over the mean of the pixels that are none
_STAR_FROM, _STAR_TO = 3, 16  # pixels from a lamp that it is looked for
_DARK = 1e-4  # of the film's mean, below which it is black
WORTH_A_LINE = 1e-3  # of the light, from which a line says that it falls beside the film
LAMP = 16.0  # times the mean of the film, from which a pixel counts as a lamp
_WIDE_PX = 2.0  # length of a lamp's straight edges, from which its far light is as wide as they are
NODES, MORE_NODES = (5, 3), (9, 7)  # along the longer and the shorter side of the film: openings, and wavefronts
_BETWEEN, _MOST_PARTS = 0.01, 4  # modulation that the mean of two kernels may be off, and finer nodes for it, each way
GOOD = 0.9  # Strehl ratio at all nodes from which the few are enough
ALL_CELLS, NEAR_CELLS = 144, 72  # across an opening whose kernels reach 64 wavelengths over twice its aperture, and 20
_NODE_PX = 16  # least distance between nodes
_SLIVER = 0.05  # of the widest opening, below which a node says nothing of the brighter places about it


def lamps_of(planes: Array) -> Array:
    """Return planes (3, height, width) of the pixels alone that outshine the mean of their film."""
    brightness = planes.max(axis=0)
    return np.asarray(planes * (brightness > LAMP * brightness.mean()))


@dataclass(frozen=True)
class FilmSpread:
    """What the openings that the film sees make of its light.

    Attributes
    ----------
    resolution : tuple of int
        Columns and rows of the whole film.
    window : tuple of int
        Columns and rows of the part of it that is a picture.
    pixel_mm : tuple of float
        Width and height of a pixel.
    nodes : tuple of arrays
        Columns and rows on the whole film of what the picture sees [pixels].
    near : tuple of (3, n, n) arrays
        What each node makes of a point, by rows of nodes, without far light: in red, green and blue, each of sum 1.
    index : float
        Of the medium in front of the film.
    edges : (n, 4) array or None
        Of the opening that the film's middle sees, with its dirt, as `FarLight` has them; None where they are unknown.
    lamps : tuple of LampImage
        Those whose pictures by waves take the place of those by rays.
    beside : (n, 8) array
        Light of lamps beside the picture, as `lamp_images` has it.
    directions : int
        Of far light.
    film_decides : bool
        Whether it is only for films whose lamps show stars.
    middle_unit_px : float
        Wavelength times f-number in the film's middle, at 550 nm [pixels].
    """

    resolution: tuple[int, int]
    window: tuple[int, int]
    pixel_mm: tuple[float, float]
    nodes: tuple[Array, Array]
    near: tuple[NDArray[np.float32], ...]
    index: float
    edges: Array | None = None
    lamps: tuple[LampImage, ...] = ()
    beside: Array = field(default_factory=lambda: np.zeros((0, 8)))
    directions: int = point_spread.ANGLES
    film_decides: bool = False
    middle_unit_px: float = 0.0

    @property
    def reach(self) -> int:
        """Of the kernels [pixels]."""
        return int(self.near[0].shape[-1] // 2)

    @cached_property
    def kernels(self) -> tuple[tuple[Array, Array], list[Array]]:
        """Columns and rows of the nodes on the whole film, and the kernel of each, with the light that is not far."""
        own = [part.astype(np.float64) for part in self.near]
        if self.edges is not None:
            own = [part * (1 - self.far[0])[:, None, None] for part in own]
        return self.nodes, own

    @cached_property
    def _far_light(self) -> point_spread.FarLight:
        assert self.edges is not None
        return point_spread.FarLight(self.edges, self.index, self.pixel_mm, self.reach, self.directions)

    @cached_property
    def _of_plain_films(self) -> FilmSpread:
        """The same for films without lamps, which show no spikes."""
        return replace(self, directions=point_spread.FEW_ANGLES)

    @cached_property
    def far(self) -> tuple[Array, Array]:
        """Share of the far light of red, green and blue, and its kernel over twice the picture."""
        return self._far_light.shares, self._far_light.kernel(*self.window)[:, :, ::-1]

    def over(self, pixels: NDArray[np.float32], layout: FilmLayout) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Return a film (height, width, 3) of linear RGB with its light spread, and what metadata say of it.

        The very same film where that shows neither in its lines nor about its lamps.
        """
        said: dict[str, Any] = {}
        if self.film_decides:
            star = star_light(pixels, self.middle_unit_px, self.beside, layout)
            said = {"on": star >= SEEN_STAR, "star_over_mean": star}
            if star < SEEN_STAR:
                return pixels, said
        film, lost = self._spread(pixels, layout)
        return film, said | {"share_beside": lost}

    def _spread(self, pixels: NDArray[np.float32], layout: FilmLayout) -> tuple[NDArray[np.float32], float]:
        """Return the film with its light spread, and the share of it that falls beside, but for lamps cut in two."""
        planes, offset = np.moveaxis(pixels.astype(np.float64), -1, 0), (layout.x, layout.y)
        bright, by_lamps = lamps_of(planes), brightness(planes, offset, self.lamps)
        is_dark = np.append(by_lamps, np.zeros((1, 3)), axis=0).sum(axis=1) == 0  # the last stands for no picture
        beside = self.beside[is_dark[self.beside[:, 7].astype(int)]]
        has_stars = bright.any() or by_lamps.any() or len(beside) > 0
        if self.edges is not None and self.directions > point_spread.FEW_ANGLES and not has_stars:
            return self._of_plain_films._spread(pixels, layout)
        if by_lamps.any():
            planes, by_lamps = without_lamps(planes, offset, self.lamps, by_lamps)
            bright = np.where(bright > 0, planes, 0.0)
        on_film, reach = (slice(self.reach, self.reach + side) for side in planes.shape[1:]), self.reach
        whole = _blur(planes, bright, offset, *self.kernels, reach)
        spread = whole[(slice(None), *on_film)]
        total, lost = float(planes.sum() + by_lamps.sum()), float(whole.sum() - spread.sum())
        if self.edges is not None:
            shares, light = self.far
            sent = planes + self._at_lamps(planes.shape, offset, by_lamps)
            around = shares[:, None, None] - point_spread.received(light, planes.shape[1:])
            lost += float((sent * around).sum())
            spread += point_spread.strew(sent, light)
            spread += around * (planes - bright).mean(axis=(1, 2))[:, None, None]  # as bright beside the film as on it
        if by_lamps.any():
            spread += by_waves(planes.shape, offset, self._near_lamps, by_lamps)
            for number, edge in self._wide.items():
                lamp = self.lamps[number]
                star = self._star(lamp.place, edge, lamp.radius, lamp.reach, layout)
                lost += float(by_lamps[number] @ np.maximum(self.far[0] - star.sum(axis=(1, 2)), 0.0))
                spread += by_lamps[number][:, None, None] * star
            spread = np.maximum(spread, 0.0) if pixels.min(initial=0.0) >= 0 else spread
        beside = np.concatenate([beside, self._images_beside(by_lamps, layout)])
        if len(beside):
            spread += self._from_beside(beside, layout)
        film = np.ascontiguousarray(np.moveaxis(spread, 0, -1), dtype=np.float32)
        return film, lost / total if total > 0 else 0.0

    @cached_property
    def _near_lamps(self) -> list[LampImage]:
        """The pictures of lamps, of what their far light lacks beside them."""
        if self.edges is None:
            return [replace(lamp, waves=lamp.waves / lamp.waves.sum(axis=(1, 2))[:, None, None]) for lamp in self.lamps]
        near = []
        for number, lamp in enumerate(self.lamps):
            if number in self._wide:
                near.append(lamp)
                continue
            inner: Array = np.zeros(lamp.waves.shape)
            rows, columns = np.arange(lamp.waves.shape[1]), np.arange(lamp.waves.shape[2])
            x, y = columns + lamp.column + 0.5 - lamp.place[0], rows + lamp.row + 0.5 - lamp.place[1]
            light = self.far[1]
            middle = light.shape[1] // 2, light.shape[2] // 2
            for column, row, share in about(lamp.place):
                i, j = rows + lamp.row - row + middle[0], columns + lamp.column - column + middle[1]
                good = np.ix_((i >= 0) & (i < light.shape[1]), (j >= 0) & (j < light.shape[2]))
                inner[:, good[0], good[1]] += share * light[:, i[good[0]], j[good[1]]]
            inner *= point_spread.fade(np.hypot(x[None, :], y[:, None]), lamp.reach)
            near.append(replace(lamp, waves=(lamp.waves - inner).astype(np.float32)))
        return near

    @cached_property
    def _wide(self) -> dict[int, float]:
        """Of lamps whose straight edges show out of focus, the length of the longest [pixels]."""
        if self.edges is None:
            return {}
        edges = {k: self._far_light.straightest * 2 * lamp.radius for k, lamp in enumerate(self.lamps)}
        return {k: edge for k, edge in edges.items() if edge > _WIDE_PX}

    def _images_beside(self, by_lamps: Array, layout: FilmLayout) -> Array:
        """Return, as `beside` is, the far light that lamps with pictures send from pixels beside the picture."""
        rows = [np.zeros((0, 8))]
        for number, (lamp, light) in enumerate(zip(self.lamps, by_lamps, strict=True)):
            if light.any() and number not in self._wide:
                own = [[i + 0.5, j + 0.5, *(k * light), -number - 1.0, 0.0, number] for i, j, k in about(lamp.place)]
                rows.append(np.array([row for row in own if not layout.holds(np.array([row[:2]]))[0]]).reshape(-1, 8))
        return np.concatenate(rows)

    def _from_beside(self, beside: Array, layout: FilmLayout) -> Array:
        """Return the light (3, height, width) that reaches a picture from beside it."""
        reach, (nodes, kernels) = self.reach, self.kernels
        total: Array = np.zeros((3, layout.height, layout.width))
        places = np.floor(beside[:, :2]).astype(int) - (layout.x, layout.y) + reach
        around: Array = np.zeros((3, layout.height + 2 * reach, layout.width + 2 * reach))
        near = (beside[:, 5] >= 0) & (places >= 0).all(axis=1) & (places < around.shape[:0:-1]).all(axis=1)
        if near.any():
            for plane, light in zip(around, beside[near, 2:5].T, strict=True):
                np.add.at(plane, tuple(places[near].T[::-1]), light)
            spread = blur(around, around, (layout.x - reach, layout.y - reach), nodes, kernels)
            total += spread[:, reach : reach + layout.height, reach : reach + layout.width]
        for number in np.unique(beside[:, 5]) if self.edges is not None else ():
            own = beside[beside[:, 5] == number]
            light, radius = own[:, 2:5].sum(axis=0), float(own[0, 6])
            shares = own[:, 2:5].sum(axis=1) / light.sum()
            place, edge = shares @ own[:, :2], self._far_light.straightest * 2 * radius
            size = np.sqrt(12 * shares @ np.sum((own[:, :2] - place) ** 2, axis=1) / 2)
            wide, at = edge if edge > _WIDE_PX else 0.0, (float(place[0]), float(place[1]))
            star = self._star(at, max(wide, float(size), 1.0), radius if wide else 0.0, reach, layout)
            total += light[:, None, None] * star
        return total

    def _star(self, place: tuple[float, float], edge: float, radius: float, reach: int, layout: FilmLayout) -> Array:
        """Return the far light (3, height, width) of a lamp of light 1, of each edge as wide as that is.

        Parameters
        ----------
        edge
            Length of a straight edge of the opening in the lamp's picture, or width of this [pixels].
        radius
            Of the picture of a lamp out of focus [pixels].
        reach
            From where on it counts [pixels].
        """
        columns = np.arange(layout.x + 0.5, layout.x + layout.width)
        rows = np.arange(layout.y + 0.5, layout.y + layout.height)
        some_columns, some_rows = (_sparse_nodes(axis, int(edge / 16)) for axis in (columns, rows))
        out, (x, y) = float(np.sqrt(max(radius**2 - edge**2 / 4, 0.0))), place
        farthest = np.hypot(np.abs(columns[[0, -1]] - x).max(), np.abs(rows[[0, -1]] - y).max())
        table = self._far_light.table(max(float(np.hypot(*self.resolution)), float(farthest)), edge, out)
        few = self._far_light.at(table, x - some_columns, some_rows - y)  # x runs to the left
        light = np.asarray(_hats(some_rows, rows).T @ few @ _hats(some_columns, columns))
        away = np.hypot(columns - x, rows[:, None] - y)
        return np.asarray(light * (1 - point_spread.fade(away, reach)))

    def _at_lamps(self, shape: tuple[int, ...], offset: tuple[int, int], light: Array) -> Array:
        """Return planes with the light of lamps (n, 3) in the pixels about the middle of each."""
        planes = np.zeros(shape)
        for number, (lamp, own) in enumerate(zip(self.lamps, light, strict=True)):
            for column, row, share in () if number in self._wide else about(lamp.place):
                column, row = column - offset[0], row - offset[1]
                if 0 <= column < shape[2] and 0 <= row < shape[1]:
                    planes[:, row, column] += share * own
        return planes

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that `spread_of` reads."""
        arrays: dict[str, NDArray[Any]] = {
            "diffraction_pixel_mm": np.array(self.pixel_mm),
            "diffraction_near": np.stack(self.near),
            "diffraction_columns": self.nodes[0],
            "diffraction_rows": self.nodes[1],
            "diffraction_index": np.array([self.index, float(self.film_decides), self.middle_unit_px]),
            "diffraction_edges": np.zeros((0, 4)) if self.edges is None else self.edges,
            "diffraction_beside": self.beside,
        }
        for number, lamp in enumerate(self.lamps):
            arrays[f"diffraction_lamp_{number}"] = np.stack([lamp.waves, lamp.rays])
            place = [lamp.column, lamp.row, *lamp.place, lamp.radius, *lamp.light]
            arrays[f"diffraction_place_{number}"] = np.array(place)
        return arrays


def spread_of(
    arrays: Mapping[str, NDArray[Any]], resolution: tuple[int, int], window: tuple[int, int]
) -> FilmSpread | None:
    """Read the arrays of `FilmSpread.arrays`, by columns and rows of the film and of the picture; None without them.

    Raises
    ------
    ValueError, KeyError
        They do not fit together.
    """
    if "diffraction_index" not in arrays:
        return None
    nodes = arrays["diffraction_columns"], arrays["diffraction_rows"]
    width, height = arrays["diffraction_pixel_mm"].tolist()
    near, (index, decides, unit) = arrays["diffraction_near"], arrays["diffraction_index"].tolist()
    count, side = nodes[0].size * nodes[1].size, near.shape[-1]
    rising = all(axis.ndim == 1 and axis.size and (np.diff(axis) > 0).all() for axis in nodes)
    if not (rising and min(width, height) > 0 and near.shape == (count, 3, side, side) and side % 2):
        raise ValueError("diffraction")
    edges = arrays["diffraction_edges"]
    beside = arrays["diffraction_beside"]
    for table, width_of_row in ((edges, 4), (beside, 8)):
        if table.ndim != 2 or table.shape[1] != width_of_row or not np.isfinite(table).all():
            raise ValueError("diffraction")
    lamps, number = [], 0
    while f"diffraction_lamp_{number}" in arrays:
        (waves, rays), place = arrays[f"diffraction_lamp_{number}"], arrays[f"diffraction_place_{number}"].tolist()
        own = (place[2], place[3]), place[4], tuple(place[5:8])
        lamps.append(LampImage(int(place[0]), int(place[1]), waves, rays, *own))
        number += 1
    edges_or_none = edges if len(edges) else None
    return FilmSpread(
        resolution, window, (width, height), nodes, tuple(near), index, edges_or_none, tuple(lamps), beside,
        film_decides=decides > 0, middle_unit_px=unit,
    )  # fmt: skip


@dataclass(frozen=True)
class FilmOpenings:
    """What nodes of a film see of the lens, found once for a scene.

    Attributes
    ----------
    scene : Scene
        In focus.
    pupils : FilmPupils
        Gives the opening that a point of the film sees.
    order : tuple of int
        Nodes along the longer and the shorter side of the film, at most.
    """

    scene: Scene
    pupils: FilmPupils
    order: tuple[int, int] = NODES

    @cached_property
    def enough(self) -> FilmOpenings:
        """The same with more nodes, where aberrations change from one to the next by what shows."""
        known = [] if self.conjugates is None else [wave for each in self.conjugates.waves for wave in each.values()]
        if all(wave.strehl(point_spread.MIDDLE_NM) > GOOD for wave in known):
            return self
        return FilmOpenings(self.scene, self.pupils, MORE_NODES)

    @cached_property
    def parts(self) -> int:
        """Into how many the way between two nodes is divided, so that kernels change little over each."""
        off = 0.0 if self.conjugates is None else self.conjugates.between(pixel_mm(self.scene))
        return int(np.clip(np.ceil(np.sqrt(off / _BETWEEN)), 1, _MOST_PARTS))

    @cached_property
    def nodes(self) -> tuple[Array, Array]:
        """Columns and rows of the nodes as places [pixels]."""
        columns, rows = _nodes(self.scene.film.resolution, self.order)
        return columns + 0.5, rows + 0.5

    @cached_property
    def points(self) -> Array:
        """The nodes on the film (n, 2) [mm], by rows."""
        return film_points(self.scene, np.stack(np.meshgrid(*self.nodes), axis=-1).reshape(-1, 2))[:, :2]

    @cached_property
    def seen(self) -> list[FilmPupil | None]:
        """The opening that each node sees; None where no light comes from, or a sliver of it as at an image circle."""
        openings = [self._opening_at(point) for point in self.points]
        least = _SLIVER * max((each.aperture**2 for each in openings if each is not None), default=0.0)
        return [each if each is not None and each.aperture**2 > least else None for each in openings]

    def _opening_at(self, point: Array) -> FilmPupil | None:
        checkpoint()
        try:
            return self.pupils(point, ALL_CELLS if self.edges is None else NEAR_CELLS)
        except InputError:
            return None

    @cached_property
    def conjugates(self) -> Conjugates | None:
        """The points of the scene that rays are to go towards; None for the rays of the lens."""
        return conjugates_of(self.scene, self.pupils, self.nodes, self.points, self.seen)

    @cached_property
    def edges(self) -> Array | None:
        """Edges of the opening that the middle of the film sees, and of the dirt in it."""
        outline, dirt = self.pupils.outline(np.zeros(2)), self.scene.camera.stop.dirt
        if outline is None:
            return None
        own = edges_of(outline)
        return own if dirt is None else np.concatenate([own, dirt_edges(dirt, outline, self.pupils.radius_mm)])


@dataclass(frozen=True)
class Diffraction:
    """What diffraction does to the film of a scene.

    Attributes
    ----------
    scene : Scene
        In focus, with the camera as requested, whatever cheaper one renders it.
    is_on : bool
        By choice, or by what it does to lines.
    airy_radius_px : float or None
        In the middle of the film at 550 nm; None for a camera without an opening.
    lost_contrast : float or None
        Of lines of two pixels there, across the one or the other.
    openings : FilmOpenings or None
        Those that the film sees.
    plan : Plan or None
        That of the render, whose lamps have pictures of their own and whose rays may go towards conjugates; without it
        there are no such lamps, and rays have the aberrations of the lens.
    session : Session or None
        That finds what hides lamps beside the picture; without it these send nothing into it.
    """

    scene: Scene
    is_on: bool
    airy_radius_px: float | None
    openings: FilmOpenings | None
    plan: Plan | None = None
    session: Session | None = None
    lost_contrast: float | None = None

    @property
    def film_decides(self) -> bool:
        """Whether the lamps of a film do."""
        return not self.is_on and self.openings is not None and "lights" not in self.scene.render.layers

    @property
    def conjugates(self) -> Conjugates | None:
        """The points of the scene that rays are to go towards; None for the rays of the lens."""
        return self.openings.enough.conjugates if self.is_on and self.openings is not None else None

    @cached_property
    def spread(self) -> FilmSpread:
        """What the openings do, of nodes on the whole film.

        A node that no light reaches takes the opening of the film's middle, as it has nothing to spread.
        """
        assert self.openings is not None
        is_stigmatic = self.plan is not None and "STIGMATIC" in self.plan.camera.facts
        openings = self.openings.enough if is_stigmatic else self.openings
        film, pixel = self.scene.film, pixel_mm(self.scene)
        middle = openings.pupils(np.zeros(2))
        pupils = [middle if pupil is None else pupil for pupil in openings.seen]
        conjugates, splits, wide = None, False, 0.0
        if self.plan is not None and is_stigmatic:
            conjugates, splits = openings.conjugates, bool(self.plan.facts.get("LENS_SPLITS"))
            assert conjugates is not None
            across = len(openings.nodes[0])
            waves = [conjugates.wave(k // across, k % across, splits=splits) for k in range(len(pupils))]
            wide = max(wave(point_spread.MIDDLE_NM).radius_mm for wave in waves if wave is not None)
        unit = max(point_spread.unit_px(pupil, pixel) for pupil in pupils)
        largest, edges = max(film.resolution), openings.edges
        wider = int(np.ceil(wide / min(map(abs, pixel))))
        reach = point_spread.reach_px(unit, largest, point_spread.NEAR, wider)
        if edges is None or not reach < largest:
            edges, reach = None, point_spread.reach_px(unit, largest, point_spread.REACH, wider)
        layout, size = FilmLayout.of(film), (abs(pixel[0]), abs(pixel[1]))
        window = layout.width, layout.height
        parts, across = 1 if conjugates is None else openings.parts, len(openings.nodes[0])
        places = [_finer_nodes(axis, parts, start - reach, start + side + reach) for axis, start, side in
                  zip(_nodes(film.resolution, openings.order), (layout.x, layout.y), window, strict=True)]  # fmt: skip
        nodes = places[0][1], places[1][1]

        @cache
        def kernel(row: float, column: float) -> Array:
            wave = None if conjugates is None else conjugates.wave(row, column, splits=splits)
            if wave is not None:
                return kernel_of_waves(wave, pixel, reach)
            if conjugates is None or (row.is_integer() and column.is_integer()):
                return point_spread.near_kernel(pupils[int(row) * across + int(column)], pixel, reach)
            near = conjugates.about(row, column)
            return np.asarray(sum(weight * kernel(float(k // across), float(k % across)) for weight, k in near))

        small = tuple(kernel(row, column).astype(np.float32) for row in places[1][0] for column in places[0][0])
        spread = FilmSpread(
            film.resolution, window, size, nodes, small, middle.index, edges,
            film_decides=self.film_decides, middle_unit_px=(self.airy_radius_px or 0.0) / AIRY,
        )  # fmt: skip
        if self.plan is None:
            return spread
        known = list(zip(openings.points, pupils, strict=True))
        units = 0.0 if unit < _FINEST_PX else point_spread.REACH if edges is None else point_spread.NEAR
        lamps, beside = lamp_images(self.scene, self.plan, openings.pupils, known, units, conjugates, self.session)
        return replace(spread, lamps=tuple(lamps), beside=beside)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of a saved render by which `merge` applies it without the scene; none where it is off."""
        return self.spread.arrays() if self.is_on or self.film_decides else {}

    @property
    def metadata(self) -> dict[str, Any]:
        """What the picture's metadata should say, before there is a film."""
        radius = self.airy_radius_px
        known = {"on": self.is_on, "airy_radius_px": radius, "lost_contrast": self.lost_contrast}
        return known | {"film_decides": self.film_decides, "says": _says(known)}

    def over(self, pixels: NDArray[np.float32]) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Return a film (height, width, 3) of linear RGB with its diffraction, and what its metadata say beside."""
        layout = FilmLayout.of(self.scene.film)
        if self.film_decides and (self.plan is None or not has_lamps(self.plan)):  # none that may be beside the film
            star = star_light(pixels, (self.airy_radius_px or 0.0) / AIRY, np.zeros((0, 8)), layout)
            if star < SEEN_STAR:
                return pixels, {"on": False, "star_over_mean": star}
        return self.spread.over(pixels, layout) if self.is_on or self.film_decides else (pixels, {})


def _says(known: Mapping[str, Any]) -> str:
    """Return the sentence of metadata."""
    radius, lost, star = (known.get(key) for key in ("airy_radius_px", "lost_contrast", "star_over_mean"))
    if radius is None or lost is None:
        return "off: no opening forms an image in the middle of the film"
    state, limit = ("on", "") if known["on"] else ("off", f" and shows from {LOST_CONTRAST:.0%}")
    says = f"{state}: the Airy radius is {radius:.2g} px, which takes {lost:.0%} of the finest lines{limit}"
    if star is not None:
        says += f"; {_STAR_FROM} pixels from a lamp its light is {star:.2g} of the mean, and shows from {SEEN_STAR:g}"
    beside = known.get("share_beside", 0.0)
    return says if beside < WORTH_A_LINE else f"{says}; {beside:.2g} of the light falls beside the film"


def describe_film(metadata: Mapping[str, Any], said: Mapping[str, Any]) -> dict[str, Any]:
    """Return metadata of a picture with what its film said of its diffraction."""
    if "diffraction" not in metadata:
        return dict(metadata)
    known = {key: value for key, value in {**metadata["diffraction"], **said}.items() if key != "film_decides"}
    return {**metadata, "diffraction": known | {"says": _says(known)}}


def star_light(pixels: NDArray[np.float32], unit_px: float, beside: Array, layout: FilmLayout) -> float:
    """Return the most light of lamps in a pixel three away from them or farther, over the mean of those that are none.

    As a round opening spreads it: by the cube of the distance. Of lamps beside the film, in its next pixel.

    Parameters
    ----------
    unit_px
        Wavelength times f-number [pixels].
    beside
        As `FilmSpread` has it.
    """
    planes = np.moveaxis(pixels.astype(np.float64), -1, 0)
    bright, plane = lamps_of(planes).sum(axis=0), planes.sum(axis=0)
    dark = bright == 0
    low, high = np.array([layout.x, layout.y]), np.array([layout.x + layout.width, layout.y + layout.height])
    off = np.maximum(np.maximum(low - beside[:, :2], beside[:, :2] - high), 0.0)
    light = float(beside[:, 2:5].sum(axis=1) @ np.maximum(np.hypot(*off.T), _STAR_FROM) ** -3.0) if len(beside) else 0.0
    if not dark.all():  # some always are
        away = np.arange(-_STAR_TO, _STAR_TO + 1)
        distance = np.hypot(away[:, None], away)
        spread = _convolve(bright, np.where(distance < _STAR_FROM, 0.0, np.maximum(distance, 1.0) ** -3))
        light += float(spread[_STAR_TO:-_STAR_TO, _STAR_TO:-_STAR_TO][dark].max())
    mean = max(float(plane[dark].mean()), _DARK * float(plane.mean() + light))
    return light * unit_px / np.pi**3 / mean if light > 0 else 0.0


def _sparse_nodes(axis: Array, every: int) -> Array:
    """Return places of an axis at most so many steps apart, its ends among them."""
    return np.linspace(axis[0], axis[-1], -(-(len(axis) - 1) // max(every, 1)) + 1) if len(axis) > 1 else axis


def diffraction_of(scene: Scene) -> Diffraction | None:
    """Find the diffraction of the film of a scene in focus; None where it is off.

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
        pupils, pixel = camera_of(scene).film_pupils(), pixel_mm(scene)
        middle = pupils(np.zeros(2))
        radius, lost = AIRY * point_spread.unit_px(middle, pixel), 1 - point_spread.finest_contrast(middle, pixel)
    except InputError:
        if choice == "on":
            raise
        return Diffraction(scene, False, None, None)
    is_on = choice == "on" or lost >= LOST_CONTRAST
    return Diffraction(scene, is_on, radius, FilmOpenings(scene, pupils), lost_contrast=lost)


def _nodes(resolution: tuple[int, int], order: tuple[int, int]) -> tuple[Array, Array]:
    """Return columns and rows of the nodes on a film [pixels], so many along its longer and its shorter side."""
    order = order if resolution[0] >= resolution[1] else order[::-1]
    columns, rows = (_pixels_along(side, most) for side, most in zip(resolution, order, strict=True))
    return columns, rows


def _pixels_along(pixels: int, most: int) -> Array:
    """Return places of nodes along a side of the film, from its first pixel to its last [pixels]."""
    count = min(most, 1 + pixels // _NODE_PX)
    return np.array([(pixels - 1) / 2]) if count < 2 else np.linspace(0.0, pixels - 1.0, count)


def _finer_nodes(axis: Array, parts: int, low: int, high: int) -> tuple[list[float], Array]:
    """Return those of nodes so many times as close that have a weight between two places, in nodes and as places."""
    at = np.arange((len(axis) - 1) * parts + 1) / parts
    finer = np.interp(at, np.arange(len(axis)), axis)
    first, last = np.searchsorted(finer, low, "right") - 1, np.searchsorted(finer, high)
    own = slice(max(int(first), 0), int(last) + 1)
    return at[own].tolist(), finer[own]


#
# How bright each lamp is on a film.

PARTS = 3  # of its picture each way
_KNOWN, _SEEN = 0.1, 0.4  # of a lamp on the picture: below the first its light is computed, above the second fitted


def about(place: tuple[float, float]) -> Iterator[tuple[int, int, float]]:
    """Yield the four pixels about a place, column and row, and the share that each has of it."""
    column, row = (int(np.floor(part - 0.5)) for part in place)
    x, y = place[0] - 0.5 - column, place[1] - 0.5 - row
    for i, by_column in ((column, 1 - x), (column + 1, x)):
        for j, by_row in ((row, 1 - y), (row + 1, y)):
            yield i, j, by_column * by_row


def brightness(planes: Array, offset: tuple[int, int], lamps: Sequence[LampImage]) -> Array:
    """Return the light of lamps (n, 3) on planes (3, height, width) of a film; 0 of those that it shows otherwise.

    By least squares of the rays' pictures, about the mean of each picture's square, so that even light about a lamp
    does not count. A lamp that something hides in part is not like its rays.
    """
    places = [lamp.on_film(planes.shape[1:], offset) for lamp in lamps]
    good = [k for k, (film, _) in enumerate(places) if all(side.stop > side.start for side in film)]
    while good:
        light = _fit_light(planes, [(lamps[k], *places[k]) for k in good])
        known: Array = np.array([lamps[k].light for k in good])
        share = [_share_seen(lamps[k], places[k][1]) for k in good]
        light = known + np.array(share)[:, None] * (light - known)
        left = planes - _together(planes.shape, [(lamps[k], *places[k]) for k in good], light)
        fine = [part == 0 or _is_like(left, *places[k], lamps[k], own)
                for k, own, part in zip(good, light, share, strict=True)]  # fmt: skip
        if all(fine):
            found = np.zeros((len(lamps), 3))
            found[good] = light
            return found
        good = [k for k, is_fine in zip(good, fine, strict=True) if is_fine]
    return np.zeros((len(lamps), 3))


def _share_seen(lamp: LampImage, part: Window) -> float:
    """Return how much the film says of the light of a lamp, where some falls beside: 1 where it shows enough of it."""
    if not any(lamp.light):
        return 1.0
    on_film = float(lamp.rays[:, part[0], part[1]].sum() / lamp.rays.sum())
    return float(np.clip((on_film - _KNOWN) / (_SEEN - _KNOWN), 0.0, 1.0))


Placed = tuple[LampImage, Window, Window]


def _fit_light(planes: Array, placed: Sequence[Placed]) -> Array:
    light = np.zeros((len(placed), 3))
    for channel in range(3):
        own = [lamp.rays[channel][part].astype(np.float64) for lamp, _, part in placed]
        tests = [rays - rays.mean() for rays in own]
        matrix, right = np.zeros((len(placed), len(placed))), np.zeros(len(placed))
        for k, (_, film, _) in enumerate(placed):
            right[k] = float(np.sum(tests[k] * planes[channel][film]))
            for m, (_, other, _) in enumerate(placed):
                low = [max(a.start, b.start) for a, b in zip(film, other, strict=True)]
                high = [min(a.stop, b.stop) for a, b in zip(film, other, strict=True)]
                if all(a < b for a, b in zip(low, high, strict=True)):
                    first = tuple(slice(a - c.start, b - c.start) for a, b, c in zip(low, high, film, strict=True))
                    second = tuple(slice(a - c.start, b - c.start) for a, b, c in zip(low, high, other, strict=True))
                    matrix[k, m] = float(np.sum(tests[k][first] * own[m][second]))
        light[:, channel] = np.linalg.lstsq(matrix, right, rcond=1e-9)[0]
    return np.maximum(light, 0.0)


def _is_like(left: Array, film: Window, part: Window, lamp: LampImage, light: Array) -> bool:
    """Return whether what is left of a film without a lamp is even, in parts of the lamp's picture."""
    whole = float(light.sum())
    if not whole > 0:
        return False
    rest, rays = left[:, film[0], film[1]].sum(axis=0), lamp.rays[:, part[0], part[1]].sum(axis=0)
    dark = rays <= 1e-3 * rays.max()
    rest = rest - (rest[dark].mean() if dark.any() else 0.0)
    lit = np.argwhere(~dark)
    low, high = lit.min(axis=0), lit.max(axis=0) + 1
    rows, columns = (np.linspace(low[k], high[k], PARTS + 1).astype(int) for k in (0, 1))
    off = sum(
        abs(float(rest[a:b, c:d].sum())) for a, b in itertools.pairwise(rows) for c, d in itertools.pairwise(columns)
    )
    return off < UNLIKE * whole * float(rays.sum()) / 3


def _together(shape: tuple[int, ...], placed: Sequence[Placed], light: Array) -> Array:
    """Return the film of lamps by their rays."""
    planes = np.zeros(shape)
    for (lamp, film, part), own in zip(placed, light, strict=True):
        planes[:, film[0], film[1]] += own[:, None, None] * lamp.rays[:, part[0], part[1]]
    return planes


def without_lamps(
    planes: Array, offset: tuple[int, int], lamps: Sequence[LampImage], light: Array
) -> tuple[Array, Array]:
    """Return planes (3, height, width) of a film without lamps of some light (n, 3), and the light that is taken.

    What is left where their rays are is noise of the lamp and what stands about it; it is kept between none and the
    brightest pixel beside the lamp. What goes beyond is the lamp's, so that all light is kept.
    """
    light = light.copy()
    shining = np.flatnonzero(light.any(axis=1)).tolist()
    placed = [(lamps[k], *lamps[k].on_film(planes.shape[1:], offset)) for k in shining]
    left = planes - _together(planes.shape, placed, light[shining])
    shown = {k: _share_seen(lamp, part) for k, (lamp, _, part) in zip(shining, placed, strict=True)}
    lit = np.zeros(planes.shape[1:], np.bool_)
    for lamp, film, part in placed:
        lit[film] |= _lit(lamp, part)
    for k, (lamp, film, part) in zip(shining, placed, strict=True):
        inside, dark = _lit(lamp, part), ~lit[film]
        for channel, plane in enumerate(left):
            window = plane[film]
            kept = np.clip(window[inside], 0.0, window[dark].max() if dark.any() else np.inf)
            if shown[k] > 0:
                light[k, channel] += shown[k] * (window[inside] - kept).sum() / lamp.rays[channel][part][inside].sum()
            window[inside] = kept
    return left, np.maximum(light, 0.0)


def _lit(lamp: LampImage, part: Window) -> NDArray[np.bool_]:
    return np.asarray(lamp.rays[:, part[0], part[1]].sum(axis=0) > 1e-6 * lamp.rays.max())


def by_waves(shape: tuple[int, ...], offset: tuple[int, int], lamps: Sequence[LampImage], light: Array) -> Array:
    """Return planes of the same by waves, without their far light."""
    planes = np.zeros(shape)
    for lamp, own in zip(lamps, light, strict=True):
        film, part = lamp.on_film(shape[1:], offset)
        planes[:, film[0], film[1]] += own[:, None, None] * lamp.waves[:, part[0], part[1]]
    return planes
