"""Diffraction of a rendered film: whether it shows, and the film with it.

The rays have brought the geometrical image. The film receives its convolution with what the opening, as that part of
the film sees it, makes of a point: of a lens by its wavefront, whose aberrations the rays leave out
(`stigmatic`), of other cameras by a perfect one. Small lamps are imaged by waves alone.
docs/diffraction.md says why, and how far that is from the full wave image.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
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
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.setting import film_frame
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.lamp_images import (
    FilmLamp,
    brightness,
    film_lamp,
    film_lamps,
    has_lamps,
    pictures,
    pixel_mm,
    with_all_light,
    without_lamps,
)
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.point_waves import NEAR_CELLS, Conjugates, conjugates_in, conjugates_of, kernel_of_waves
from rptcam_cl.scene import lens_settings
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]

#
# The film with what its openings make of it.

_RAYS_PX = 0.25  # wavelength times f-number, below which pixels show what rays do
_FINEST_PX = 0.03  # wavelength times f-number, below which no ring of a lamp shows
# Errors that `auto` leaves out, and from where the printed line has the light that is lost.
LOST_CONTRAST = 0.25  # of lines of two pixels in the film's middle, at 550 nm
SEEN_STAR = 0.03  # light of lamps some pixels away, over the mean of the pixels that are none
_STAR_FROM, _STAR_TO = 3, 16  # pixels from a lamp that it is looked for
_DARK = 1e-4  # of the film's mean, below which it is black
_WORTH_A_LINE = 1e-3  # of the light, from which a line says that it falls beside the film
LAMP = 16.0  # times the mean of the film, from which a pixel counts as a lamp
_ACROSS_A_DISK = 0.87  # of its diameter: sides of a square of the same spread
_PER_OCTAVE = 4.0  # widths of an edge
_WIDE_PX = 2.0  # length of a lamp's straight edges, from which its far light is as wide as they are
NODES, MORE_NODES = (5, 3), (9, 7)  # along the longer and the shorter side of the film: openings, and wavefronts
_BETWEEN, _MOST_PARTS = 0.01, 4  # modulation that the mean of two kernels may be off, and finer nodes for it, each way
GOOD = 0.9  # Strehl ratio at all nodes from which the few are enough
_ALL_CELLS = 144  # across an opening whose kernels reach 64 wavelengths over twice its aperture
_NODE_PX = 16  # least distance between nodes
_MOST_OPENINGS = 12  # of lamps, beside those that are one turned and drawn out
_ALIKE = 0.005  # of its radius (rms), within which two openings are one
_VEIL_REACH, _NEAR_VEIL = 24, 17  # pixels over which light of no lamp is known by pixels, where kernels reach less
_VEIL_STEPS, _COARSEST = 6, 8  # into which the reach of a kernel is divided for light of no lamp, and pixels of a step
_SLIVER = 0.05  # of the widest opening, below which a node says nothing of the brighter places about it


def lamps_of(planes: Array) -> Array:
    """Return planes (3, height, width) of the pixels alone that outshine the mean of their film."""
    brightness = planes.max(axis=0)
    return np.asarray(planes * (brightness > LAMP * brightness.mean()))


@dataclass(frozen=True)
class Aberrated:
    """What waves make of a point, where rays leave out the aberrations of the lens.

    Attributes
    ----------
    nodes : tuple of arrays
        Columns and rows of the kernels on the whole film [pixels].
    near : (k, 3, n, n) array
        The kernels, by rows of nodes, without far light.
    shares : (height, width) array
        Of the light of each pixel of the picture that is theirs.
    """

    nodes: tuple[Array, Array]
    near: NDArray[np.float32]
    shares: NDArray[np.float32]


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
    aberrated : Aberrated or None
        The same of waves with the aberrations of the lens, for pixels whose rays leave these out.
    index : float
        Of the medium in front of the film.
    edges : (n, 4) array or None
        Of the opening that the film's middle sees, with its dirt, as `FarLight` has them; None where they are unknown.
    lamps : tuple of FilmLamp
        That the picture shows, or the light of.
    outlines : tuple of (n, 4) arrays
        Edges of other openings that lamps have, with their dirt.
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
    lamps: tuple[FilmLamp, ...] = ()
    outlines: tuple[Array, ...] = ()
    film_decides: bool = False
    middle_unit_px: float = 0.0
    aberrated: Aberrated | None = None

    @property
    def reach(self) -> int:
        """Of the kernels [pixels]."""
        return int(self.near[0].shape[-1] // 2)

    @cached_property
    def kernels(self) -> tuple[tuple[Array, Array], list[Array]]:
        """Columns and rows of the nodes on the whole film, and the kernel of each, with the light that is not far."""
        return self.nodes, self._not_far(self.near)

    def _not_far(self, kernels: Sequence[NDArray[np.float32]] | NDArray[np.float32]) -> list[Array]:
        own = [part.astype(np.float64) for part in kernels]
        return own if self.edges is None else [part * (1 - self._shares)[:, None, None] for part in own]

    def _blur(self, planes: Array, bright: Array, offset: tuple[int, int], wide: int, veil: Array | None) -> Array:
        """Return planes with their light by kernels, and so many pixels round them."""
        own = self.aberrated
        if own is None:
            return point_spread.blur_with_border(planes, bright, offset, *self.kernels, wide, veil)
        aberrated, shares = self._not_far(own.near), own.shares.astype(np.float64)
        blurred = point_spread.blur_with_border(planes, bright, offset, *self.kernels, wide, veil, 1.0 - shares)
        return blurred + point_spread.blur_with_border(planes, bright, offset, own.nodes, aberrated, wide, veil, shares)

    @cached_property
    def _far_light(self) -> point_spread.FarLight:
        assert self.edges is not None
        return point_spread.FarLight(self.edges, self.index, self.pixel_mm, self.reach)

    @cached_property
    def far(self) -> Array:
        """The kernel of far light over twice the picture."""
        return self._far_light.kernel(*self.window)[:, :, ::-1]

    @cached_property
    def _few_directions(self) -> point_spread.FarLight:
        """Far light of what is no lamp."""
        return replace(self._far_light, directions=point_spread.FEW_ANGLES)

    @cached_property
    def _shares(self) -> Array:
        """Share of red, green and blue that is far light (3,)."""
        return self._few_directions.shares

    @cached_property
    def _veil(self) -> tuple[Array | None, Array, Array, int]:
        """Far light of what is no lamp: its kernel near by, if any; beyond, that of squares, its share, their side."""
        reach = _VEIL_REACH if self.reach <= _NEAR_VEIL else self.reach
        step = int(np.clip(reach // _VEIL_STEPS, 1, _COARSEST))
        size = step * self.pixel_mm[0], step * self.pixel_mm[1]
        beyond = replace(self._few_directions, pixel_mm=size, reach=(reach + 1) / step - 1)
        kernel = beyond.kernel(*(-(-side // step) for side in self.window))[:, :, ::-1]
        if reach == self.reach:
            return None, kernel, beyond.shares, step
        near, away = self._few_directions.kernel(reach + 1, reach + 1)[:, :, ::-1], np.arange(-reach, reach + 1)
        near = near * point_spread.fade(np.hypot(away[:, None], away), reach)
        near *= ((self._shares - beyond.shares) / near.sum(axis=(1, 2)))[:, None, None]
        return near, kernel, beyond.shares, step

    @property
    def beside(self) -> Array:
        """Light of lamps in pixels beside the picture (n, 5), as `FilmLamp` has it."""
        return np.concatenate([np.zeros((0, 5)), *(lamp.beside for lamp in self.lamps)])

    @cached_property
    def _openings(self) -> dict[tuple[int, bytes], point_spread.FarLight]:
        """Far light of openings of lamps, as these shine, that is known."""
        return {}

    @cached_property
    def _lamps_reach(self) -> float:
        """From where on openings are to know the light of lamps, as they see it [pixels]."""
        shrunk = [float(np.linalg.svd(lamp.own, compute_uv=False).min()) for lamp in self.lamps]
        return min([1.0, *shrunk]) * min([self.reach, *(lamp.image.reach for lamp in self.lamps if lamp.image)])

    def _opening(self, lamp: FilmLamp) -> point_spread.FarLight:
        key = lamp.opening, b"" if lamp.lines is None else lamp.lines.tobytes()
        if key not in self._openings:
            edges = (self._far_light.edges, *self.outlines)[lamp.opening]
            self._openings[key] = replace(self._far_light, edges=edges, reach=self._lamps_reach, lines=lamp.lines)
        return self._openings[key]

    @cached_property
    def _tables(self) -> dict[tuple[float, ...], point_spread.Table]:
        """Tables of far light that are known, by opening and what they are for."""
        return {}

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
        imaged = [k for k, lamp in enumerate(self.lamps) if lamp.image is not None]
        bright, by_waves = lamps_of(planes), np.zeros((len(self.lamps), 3))
        images = [lamp.image for lamp in self.lamps if lamp.image is not None]
        by_waves[imaged] = brightness(planes, offset, images)
        beside = [own for own, light in zip(self.lamps, by_waves, strict=True) if len(own.beside) and not light.any()]
        if by_waves.any():
            planes, by_waves[imaged] = without_lamps(planes, offset, images, by_waves[imaged])
            bright = np.where(bright > 0, planes, 0.0)
        total, strewn = float(planes.sum() + by_waves.sum()), np.where(bright > 0, lamps_of(planes), 0.0)
        stars, lost = self._stars(by_waves, (planes, bright, strewn), layout)
        near_veil, kernel, shares, step = (None, None, np.zeros(3), 1) if self.edges is None else self._veil
        wide = self.reach if near_veil is None else near_veil.shape[-1] // 2
        whole = self._blur(planes, bright, offset, wide, near_veil)
        spread = whole[:, wide : wide + planes.shape[1], wide : wide + planes.shape[2]]
        lost += float(whole.sum() - spread.sum())
        if kernel is not None:
            far, beside_it = point_spread.veil(planes - bright, kernel, shares, step)
            spread += far
            lost += beside_it + (0.0 if near_veil is None else point_spread.beside(planes - bright, near_veil))
        if kernel is not None and strewn.any():
            far = point_spread.strew(strewn, self.far)
            spread += far
            lost += float(self._shares @ strewn.sum(axis=(1, 2)) - far.sum())
        spread += stars
        if by_waves.any():
            near = images if self.edges is not None else [with_all_light(image) for image in images]
            spread += pictures(planes.shape, offset, near, by_waves[imaged])
            spread = np.maximum(spread, 0.0) if pixels.min(initial=0.0) >= 0 else spread
        if beside:
            spread += self._from_beside(beside, layout)
        film = np.ascontiguousarray(np.moveaxis(spread, 0, -1), dtype=np.float32)
        return film, lost / total if total > 0 else 0.0

    def _stars(self, by_waves: Array, films: tuple[Array, Array, Array], layout: FilmLayout) -> tuple[Array, float]:
        """Return the far light of lamps as planes like those of films, and how much of it falls beside.

        Light is that of their images (n, 3) by waves, else what `_bright_pixels` takes from the films.
        """
        stars, lost = np.zeros_like(films[0]), 0.0
        lamps = self.lamps if self.edges is not None else ()
        for lamp, light in zip(lamps, by_waves, strict=bool(lamps)):
            if lamp.image is not None and light.any():
                share, place = 1 - lamp.image.waves.sum(axis=(1, 2)), lamp.place
                away = lamp.radius, lamp.image.reach
            else:
                light, place, share = self._bright_pixels(lamp, films, layout)
                away = 0.0, self.reach
            if light.any():
                star = self._star(lamp, place, lamp.size, *away, layout)
                lost += float(light @ np.maximum(share - star.sum(axis=(1, 2)), 0.0))
                for plane, target, own_light in zip(star, stars, light.tolist(), strict=True):
                    plane *= own_light
                    target += plane
        return stars, lost

    def _bright_pixels(
        self, lamp: FilmLamp, films: Sequence[Array], layout: FilmLayout
    ) -> tuple[Array, tuple[float, float], Array]:
        """Take the light of a lamp without a picture by waves from the pixels that it is in; with its middle.

        And the share of it that is far light, by which it is not near them.

        Parameters
        ----------
        films
            The film, its bright pixels, and those that the opening of the middle strews.
        """
        (x, y), size, radius = lamp.place, lamp.size, lamp.radius
        spans = []
        for middle, first, side in ((y, layout.y, layout.height), (x, layout.x, layout.width)):
            ends = np.clip(np.rint(middle - first + (size / 2 + radius + 2) * np.array([-1, 1])).astype(int), 0, side)
            spans.append(slice(*ends))
        planes, bright, strewn = (film[:, spans[0], spans[1]] for film in films)
        light, plane = strewn.sum(axis=(1, 2)), strewn.sum(axis=0)
        if light.any():
            x, y = (np.average(np.arange(span.start, span.stop) + first + 0.5, weights=plane.sum(axis=axis))
                    for axis, span, first in ((0, spans[1], layout.x), (1, spans[0], layout.y)))  # fmt: skip
        far = self._opening(lamp)
        nearer = (far.reach + 1) / (self.reach + 1) / np.sqrt(abs(np.linalg.det(lamp.own)))
        share = far.shares * nearer
        more = ((self._shares - share) / (1 - self._shares))[:, None, None] * strewn
        for film in (planes, bright):
            film += more
        strewn[:] = 0.0
        return light, (float(x), float(y)), share

    def _from_beside(self, lamps: Sequence[FilmLamp], layout: FilmLayout) -> Array:
        """Return the light (3, height, width) of lamps that reaches a picture from beside it."""
        reach, (nodes, kernels), beside = self.reach, self.kernels, np.concatenate([lamp.beside for lamp in lamps])
        total: Array = np.zeros((3, layout.height, layout.width))
        places = np.floor(beside[:, :2]).astype(int) - (layout.x, layout.y) + reach
        around: Array = np.zeros((3, layout.height + 2 * reach, layout.width + 2 * reach))
        near = (places >= 0).all(axis=1) & (places < around.shape[:0:-1]).all(axis=1)
        if near.any():
            for plane, light in zip(around, beside[near, 2:5].T, strict=True):
                np.add.at(plane, tuple(places[near].T[::-1]), light)
            spread = point_spread.blur(around, around, (layout.x - reach, layout.y - reach), nodes, kernels)
            total += spread[:, reach : reach + layout.height, reach : reach + layout.width]
        for lamp in lamps if self.edges is not None else ():
            own = lamp.beside
            light, shares = own[:, 2:].sum(axis=0), own[:, 2:].sum(axis=1) / own[:, 2:].sum()
            place = shares @ own[:, :2]
            size = np.sqrt(8 * shares @ np.sum((own[:, :2] - place) ** 2, axis=1))
            total += light[:, None, None] * self._star(lamp, (place[0], place[1]), size, lamp.radius, reach, layout)
        return total

    def _star(
        self, lamp: FilmLamp, place: tuple[float, float], size: float, radius: float, reach: int, layout: FilmLayout
    ) -> Array:
        """Return the far light (3, height, width) of a lamp of light 1, of each edge as wide as it is out of focus.

        Parameters
        ----------
        place, size
            Middle and width of its image [pixels].
        radius
            Of the rays of a point of it, out of focus [pixels].
        reach
            From where on it counts [pixels].
        """
        (x, y), opening = place, self._opening(lamp)
        wide = opening.straightest * 2 * radius
        edge = max(_ACROSS_A_DISK * size, wide if wide > _WIDE_PX else 0.0, 1.0)
        edge = 2.0 ** (np.rint(_PER_OCTAVE * np.log2(edge)) / _PER_OCTAVE)  # so that lamps share tables
        out = float(np.sqrt(max(radius**2 - edge**2 / 4, 0.0))) if wide > _WIDE_PX else 0.0
        columns = np.arange(layout.x + 0.5, layout.x + layout.width)
        rows = np.arange(layout.y + 0.5, layout.y + layout.height)
        every = max(int(edge / 16), 1)
        some_columns, some_rows = (_sparse_nodes(axis, every) for axis in (columns, rows))
        away = np.hypot(np.abs(columns[[0, -1]] - x).max(), np.abs(rows[[0, -1]] - y).max())
        farthest = max(np.hypot(*self.resolution), away) * max(1.0, np.linalg.norm(lamp.own, 2))
        farthest = float(2.0 ** np.ceil(np.log2(farthest)))
        key = id(opening), farthest, edge, out
        if key not in self._tables:
            self._tables[key] = opening.table(farthest, edge, out)
        light = opening.at(self._tables[key], x - some_columns, some_rows - y, lamp.own, out)  # x runs to the left
        if every > 1:
            light = point_spread.between(light, (some_rows, some_columns), (rows, columns))
        sides = np.zeros(3), np.abs(rows - y), np.abs(columns - x)
        near = np.ix_(*(np.flatnonzero(side < reach + 2) for side in sides))
        away = np.hypot(columns - x, rows[:, None] - y)[near[1][0], near[2][0]]
        light[near] *= 1 - point_spread.fade(away, reach)
        return np.asarray(light)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that `spread_of` reads."""
        arrays: dict[str, NDArray[Any]] = {
            "diffraction_pixel_mm": np.array(self.pixel_mm),
            "diffraction_near": np.stack(self.near),
            "diffraction_columns": self.nodes[0],
            "diffraction_rows": self.nodes[1],
            "diffraction_index": np.array([self.index, float(self.film_decides), self.middle_unit_px]),
            "diffraction_edges": np.zeros((0, 4)) if self.edges is None else self.edges,
            **{f"diffraction_opening_{number}": edges for number, edges in enumerate(self.outlines)},
        }
        if self.aberrated is not None:
            own: list[NDArray[Any]] = [*self.aberrated.nodes, self.aberrated.near, self.aberrated.shares]
            arrays |= {f"diffraction_aberrated_{k}": each for k, each in enumerate(own)}
        for number, lamp in enumerate(self.lamps):
            arrays |= {f"diffraction_lamp_{number}_{k}": array for k, array in enumerate(lamp.arrays())}
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
    outlines = tuple(_numbered(arrays, "diffraction_opening_"))
    if not all(table.ndim == 2 and table.shape[1] == 4 and np.isfinite(table).all() for table in (edges, *outlines)):
        raise ValueError("diffraction")
    aberrated = None
    if waves := list(_numbered(arrays, "diffraction_aberrated_")):
        columns, rows, kernels, shares = waves
        if kernels.shape != (columns.size * rows.size, 3, side, side) or shares.shape != window[::-1]:
            raise ValueError("diffraction")
        aberrated = Aberrated((columns, rows), kernels, shares)
    lamps = list[FilmLamp]()
    while own := list(_numbered(arrays, f"diffraction_lamp_{len(lamps)}_")):
        lamps.append(film_lamp(own))
    return FilmSpread(
        resolution, window, (width, height), nodes, tuple(near), index, edges if len(edges) else None, tuple(lamps),
        outlines, film_decides=decides > 0, middle_unit_px=unit, aberrated=aberrated,
    )  # fmt: skip


def _numbered(arrays: Mapping[str, NDArray[Any]], name: str) -> Iterator[NDArray[Any]]:
    """Yield the arrays of a name with 0, 1 and so on."""
    for number in itertools.count():
        if f"{name}{number}" not in arrays:
            return
        yield arrays[f"{name}{number}"]


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
        known = [] if self.conjugates is None else [wave for wave in self.conjugates.waves if wave is not None]
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

    def about(self, layout: FilmLayout, parts: int, reach: int) -> list[tuple[list[float], Array]]:
        """Return columns and rows of nodes, so many times as close, that a picture has light of."""
        return [
            _finer_nodes(axis, parts, start - reach, start + side + reach)
            for axis, start, side in zip(_nodes(self.scene.film.resolution, self.order), (layout.x, layout.y),
                                         (layout.width, layout.height), strict=True)
        ]  # fmt: skip

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
            return self.pupils(point, _ALL_CELLS if self.edges is None else NEAR_CELLS)
        except InputError:
            return None

    @cached_property
    def conjugates(self) -> Conjugates | None:
        """The points of the scene that rays are to go towards; None for the rays of the lens."""
        pixel = pixel_mm(self.scene)
        if point_spread.unit_px(self.pupils(np.zeros(2), NEAR_CELLS), pixel) < _RAYS_PX:
            return None
        return conjugates_of(self.scene, self.pupils, self.nodes, self.points, self.seen, pixel)

    @cached_property
    def outline(self) -> Array | None:
        """Corners (n, 2) of the opening that the middle of the film sees; None where they are not known."""
        return self.pupils.outline(np.zeros(2))

    @cached_property
    def edges(self) -> Array | None:
        """Edges of that opening, and of the dirt in it."""
        return None if self.outline is None else self._with_dirt(self.outline)

    def _with_dirt(self, outline: Array) -> Array:
        own, dirt = edges_of(outline), self.scene.camera.stop.dirt
        return own if dirt is None else np.concatenate([own, dirt_edges(dirt, outline, self.pupils.radius_mm)])

    def with_openings(self, lamps: Sequence[FilmLamp]) -> tuple[list[Array], list[FilmLamp]]:
        """Return edges of openings beside that of the middle, and lamps with that which each has, and by which map."""
        assert self.outline is not None
        known, found = [self.outline], list[FilmLamp]()
        places = np.array([lamp.place for lamp in lamps]).reshape(-1, 2)
        for lamp, point in zip(lamps, film_points(self.scene, places)[:, :2], strict=True):
            checkpoint()
            rough = self.pupils.rough_outline(point)
            if rough is None:
                found.append(lamp)
                continue
            maps = [point_spread.map_of_outlines(each, rough) for each in known]
            number = int(np.argmin([off for _, off in maps]))
            own, off = maps[number]
            if off > _ALIKE and len(known) <= _MOST_OPENINGS:
                number, own = len(known), np.eye(2)
                known.append(self.pupils.finer_outline(point, rough))
            found.append(replace(lamp, opening=number, own=own))
        return [self._with_dirt(outline) for outline in known[1:]], found


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
        conjugates = None if self.plan is None else conjugates_in(self.plan, self.conjugates)
        openings = self.openings if conjugates is None else self.openings.enough
        film, pixel = self.scene.film, pixel_mm(self.scene)
        middle = openings.pupils(np.zeros(2))
        pupils = [middle if pupil is None else pupil for pupil in openings.seen]
        unit, wide = max(point_spread.unit_px(pupil, pixel) for pupil in pupils), 0.0
        if conjugates is not None:
            wide = max(wave.radius_mm for wave in conjugates.waves if wave is not None)
        largest, edges = max(film.resolution), openings.edges
        wider = int(np.ceil(wide / min(map(abs, pixel))))
        reach = point_spread.reach_px(unit, largest, point_spread.NEAR, wider)
        if edges is None or not reach < largest:
            edges, reach = None, point_spread.reach_px(unit, largest, point_spread.REACH, wider)
        layout, size = FilmLayout.of(film), (abs(pixel[0]), abs(pixel[1]))
        (some_columns, columns), (some_rows, rows) = openings.about(layout, 1, reach)
        numbers = [int(row) * len(openings.nodes[0]) + int(column) for row in some_rows for column in some_columns]
        near = [point_spread.near_kernel(pupils[number], pixel, reach).astype(np.float32) for number in numbers]
        spread = FilmSpread(
            film.resolution, (layout.width, layout.height), size, (columns, rows), tuple(near), middle.index, edges,
            film_decides=self.film_decides, middle_unit_px=(self.airy_radius_px or 0.0) / AIRY,
            aberrated=None if conjugates is None else self._aberrated(openings, conjugates, middle, reach),
        )  # fmt: skip
        if self.plan is None:
            return spread
        known = list(zip(openings.points, pupils, strict=True))
        units = 0.0 if unit < _FINEST_PX else point_spread.REACH if edges is None else point_spread.NEAR
        lamps = film_lamps(self.scene, self.plan, openings.pupils, known, units, conjugates, self.session)
        outlines, lamps = ([], lamps) if edges is None else openings.with_openings(lamps)
        return replace(spread, lamps=tuple(lamps), outlines=tuple(outlines))

    def _aberrated(self, openings: FilmOpenings, conjugates: Conjugates, middle: FilmPupil, reach: int) -> Aberrated:
        """Find the kernels of waves, of so many pixels each way, where the picture has light that is theirs."""
        assert self.plan is not None
        pixel, layout, splits = pixel_mm(self.scene), FilmLayout.of(self.scene.film), self.plan.facts.get("LENS_SPLITS")
        columns, rows = layout.x + np.arange(float(layout.width)), layout.y + np.arange(float(layout.height))
        kept = 1.0 - conjugates.share_of_pixels(columns + 0.5, rows + 0.5)
        shares = (1.0 - kept**2).astype(np.float32)  # of kernels: with the rest by rays the same second moment
        (_, at_x), (_, at_y) = openings.about(layout, openings.parts, reach)
        lit = [point_spread.hats(axis, pixels) > 0 for axis, pixels in ((at_y, rows), (at_x, columns))]
        used = ((lit[0].astype(np.float64) @ (shares > 0)) @ lit[1].T > 0).ravel()
        places = np.stack(np.meshgrid(at_x, at_y), axis=-1).reshape(-1, 2) + 0.5
        points, near = film_points(self.scene, places)[:, :2], np.zeros((len(places), 3, 2 * reach + 1, 2 * reach + 1))
        for number in np.flatnonzero(used).tolist():
            checkpoint()
            place, point = places[number], points[number]
            try:
                pupil = openings.pupils(point, conjugates.cells(place))
                wave = conjugates.waves_at(place, point, pupil, splits=bool(splits))
            except InputError:
                pupil, wave = middle, None
            near[number] = point_spread.near_kernel(pupil, pixel, reach) if wave is None else kernel_of_waves(
                wave, pixel, reach)  # fmt: skip
        return Aberrated((at_x, at_y), near.astype(np.float32), shares)

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
            star = star_light(pixels, (self.airy_radius_px or 0.0) / AIRY, np.zeros((0, 5)), layout)
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
    return says if beside < _WORTH_A_LINE else f"{says}; {beside:.2g} of the light falls beside the film"


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
        As `FilmLamp` has it.
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
        spread = point_spread.convolve(bright, np.where(distance < _STAR_FROM, 0.0, np.maximum(distance, 1.0) ** -3))
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
# Dust and scratches in the plane of the stop, as holes in its outline.
#
# Specks are numbered from the middle outwards, so that a wider stop shows those of a smaller one and more.

_SPECK_CORNERS = 9
_RAGGED = 0.3  # how far corners of a speck lie beside its circle, in its radius
MOST = 1000  # specks, and scratches; of more the largest count
ALONG = 65  # places along a scratch that are looked at
ROOM = 0.999  # share of the outline's radius that dirt lies within


def edges_of(polygon: Array) -> Array:
    """Return the edges (n, 4), from x, y to x, y, of a polygon (n, 2)."""
    return np.concatenate([polygon, np.roll(polygon, -1, axis=0)], axis=1)


def dirt_edges(dirt: lens_settings.Dirt, outline: Array, radius_mm: float) -> Array:
    """Return the edges (n, 4) of dirt within an outline, clockwise, as holes have them.

    Parameters
    ----------
    dirt : Dirt
    outline : (n, 2) array
        Anticlockwise about its middle, from which every corner is seen; of any unit.
    radius_mm : float
        What its farthest corner is from the middle, in the plane of the stop.
    """
    middle = _middle(outline)
    about = outline - middle
    reach = np.hypot(*about.T)
    scale = float(reach.max()) / radius_mm
    order = np.argsort(np.arctan2(about[:, 1], about[:, 0]))
    rim = (np.arctan2(about[order, 1], about[order, 0]), reach[order] / scale * ROOM)
    specks = [polygon for polygon in _specks(dirt, radius_mm) if _inside(polygon, rim).all()]
    scratches = [
        polygon for line in _scratches(dirt, radius_mm) if (polygon := _clip_line(line, dirt, rim)) is not None
    ]
    edges = [edges_of(middle + scale * polygon[::-1]) for polygon in (*specks, *scratches)]
    return np.concatenate([np.zeros((0, 4)), *edges])


def _middle(polygon: Array) -> Array:
    """Return the centroid of the area of a polygon."""
    following = np.roll(polygon, -1, axis=0)
    cross = polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]
    return np.asarray(cross @ (polygon + following) / (3 * cross.sum()))


def _inside(points: Array, rim: tuple[Array, Array]) -> NDArray[np.bool_]:
    angles = np.arctan2(points[:, 1], points[:, 0])
    return np.asarray(np.hypot(*points.T) < np.interp(angles, *rim, period=2 * np.pi))


def _spread(density: float, radius_mm: float, seed: int, numbers: int) -> tuple[Array, Array]:
    """Return places (n, 2) about the middle [mm], and random numbers (n, numbers) beside each."""
    count = int(np.ceil(density * np.pi * radius_mm**2))
    drawn = np.random.default_rng(seed).random((count, 2 + numbers))
    distance = np.sqrt((np.arange(count) + drawn[:, 0]) / (np.pi * max(density, 1e-300)))
    angle = 2 * np.pi * drawn[:, 1]
    return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1), drawn[:, 2:]


def _sizes(drawn: Array) -> Array:
    """Return factors of median 1 that are nearly log-normal, of three random numbers each."""
    return np.asarray(np.exp(drawn[:, :3].sum(axis=1) - 1.5))


def _specks(dirt: lens_settings.Dirt, radius_mm: float) -> list[Array]:
    """Return the corners of ragged specks about the middle [mm]."""
    at, drawn = _spread(dirt.dust_per_mm2, radius_mm, dirt.seed, 3 + _SPECK_CORNERS)
    radii = 0.5e-3 * dirt.dust_um * _sizes(drawn)
    angles = 2 * np.pi * np.arange(_SPECK_CORNERS) / _SPECK_CORNERS
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    chosen = np.sort(np.argsort(-radii, kind="stable")[:MOST])
    return [at[k] + (radii[k] * (1 + _RAGGED * (2 * drawn[k, 3:] - 1)))[:, None] * ring for k in chosen]


def _scratches(dirt: lens_settings.Dirt, radius_mm: float) -> list[tuple[Array, Array]]:
    """Return both ends of scratches about the middle [mm]."""
    at, drawn = _spread(dirt.scratches_per_mm2, radius_mm, dirt.seed + 1, 4)
    halves = 0.5 * dirt.scratch_mm * _sizes(drawn)
    angles = np.pi * drawn[:, 3]
    away = halves[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return [(at[k] - away[k], at[k] + away[k]) for k in np.sort(np.argsort(-halves, kind="stable")[:MOST])]


def _clip_line(line: tuple[Array, Array], dirt: lens_settings.Dirt, rim: tuple[Array, Array]) -> Array | None:
    """Return the corners of the part of a scratch within the rim; None where it is not longer than wide."""
    first, last = line
    wide = 0.5e-3 * dirt.scratch_um
    across = np.array([first[1] - last[1], last[0] - first[0]])
    across *= wide / np.hypot(*across)
    places = first + np.linspace(0, 1, ALONG)[:, None] * (last - first)
    good = _inside(places - across, rim) & _inside(places + across, rim)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    if not len(ends):
        return None
    longest = int(np.argmax(ends[1::2] - ends[::2]))
    a, b = places[ends[2 * longest]], places[ends[2 * longest + 1] - 1]
    if np.hypot(*(b - a)) <= 2 * wide:
        return None
    return np.stack([a - across, b - across, b + across, a + across])
