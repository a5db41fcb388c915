"""Virtual lights: what is learned of a scene before its first sample, and those of a pass.

Light paths leave a virtual light at each surface that scatters evenly (Keller 1997), and the vertices of camera paths
connect to one of them each. Which of them matter, paths from the eye tell. `kernels/light/virtual_lights.h` says how
connections share their light with the path's own directions, so that the picture stays what it is, with less noise
(Kollig and Keller 2004). `rptcam_cl/rendering/plan/virtual_lights.py` says which scenes have them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import records as layout
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import LIGHT_PASS, VIRTUAL_GRID
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.photon_map import pass_of
from rptcam_cl.rendering.plan.virtual_lights import VirtualLights

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

MOST = 1 << 13  # virtual lights of a pass
SIDE = 8  # cells along the longest side of the scene
_FACINGS = 6
_SEED = 0x517CC1B727220A95  # parts the random numbers of light paths from those of camera paths
# Passes of what is learned: from lamps, from the eye, and again from lamps by what was learned.
_LEARNING, _LOOKING, _LEARNED_ONCE = 2**32 - 1, 2**32 - 2, 2**32 - 3
_LEARNING_PATHS, _ROUGH_PATHS = 1 << 15, 1 << 11
_LEARNING_SEED = 0  # whatever the seed of a render
_LEAST_PATHS, _MOST_PATHS = 1024, 1 << 16  # of a pass
_PATHS_PER_SAMPLE = 1 / 64  # and pixel of the whole film
_MOST_FOUND = 1 << 19  # places that the paths of a pass may meet
LIGHT_PATH_BYTES = 32 * (_MOST_FOUND + MOST)  # as found, and as picked
# Of starts, the share that follows what was learned, the rest goes by area; of importance, what cells count for that no
# path from the eye has met; of the bound, the share that is alike wherever the camera looks; the bound, in densities.
_LEARNED, _LEAST_IMPORTANCE, _ALIKE, _BOUND = 0.8, 0.05, 0.4, 2.0
_MOST_EDGES = 127
_FLOATS, _LIGHT, _NORMAL, _MARK = 8, slice(3, 6), 6, 7  # of a virtual light
_WAY_SHIFT = 24


class VirtualLightBuffers:
    """What the kernels read of virtual lights, as arguments by name; `current` says of which pass they are.

    `learned` is what is known of the scene, by the edges and number of light paths.
    """

    def __init__(self, session: Session) -> None:
        self.found = session.allocate(4 * _FLOATS * max(_MOST_FOUND, _MOST_EDGES * session.lanes))
        self.lights = session.allocate(4 * _FLOATS * MOST)
        self.density = session.allocate(4 * _FACINGS * SIDE**3)
        self.grid = session.upload(VIRTUAL_GRID.zeros(1))
        self.current: tuple[Any, ...] | None = None
        self.learned: dict[tuple[int, int], _Learned] = {}
        self.arguments = {
            "virtual_lights": self.lights, "virtual_density": self.density, "virtual_grid": self.grid,
        }  # fmt: skip


@dataclass(frozen=True)
class _Learned:
    """What is known of a scene.

    Attributes
    ----------
    curve : float32 array
        Picks among the surfaces where paths start.
    low, per_cell
        Corner of the grid [m], and 1 / width of its cells [1/m].
    importance : (cells,) array
        What a light of a cell and facing brings to the camera.
    density : (cells,) float32 array
        Bound of connections [1/m²].
    effective : float
        As how many paths of equal worth a path from there counts.
    """

    curve: Floats
    low: Floats
    per_cell: np.float32
    importance: Array
    density: Floats
    effective: float


class VirtualLightPool:
    """Traces the light paths of a pass when a sample needs them.

    Parameters
    ----------
    session
        The device.
    lights
        Where light paths start.
    facts
        Of the scene and its trees.
    scene : dict
        Arguments for ``SCENE_PARAMETERS``.
    buffers
        Where the virtual lights go.
    max_depth
        Longest path [edges].
    pixels
        Of the whole film, of which a crop or some tiles may be rendered.
    is_rough
        Whether fewer paths learn, for glances.
    """

    def __init__(
        self,
        session: Session,
        lights: VirtualLights,
        facts: Mapping[str, int],
        scene: dict[str, Any],
        buffers: VirtualLightBuffers,
        max_depth: int,
        pixels: int,
        *,
        is_rough: bool,
    ) -> None:
        self._session, self._lights, self._buffers, self._pixels = session, lights, buffers, pixels
        self._edges = min(max(max_depth - 2, 1), _MOST_EDGES)
        self._most_paths = max(1 << (_MOST_FOUND // self._edges).bit_length() - 1, session.lanes)
        paths, self._more = (_ROUGH_PATHS, 0.5) if is_rough else (_LEARNING_PATHS, 0.75)
        self._learning_paths = min(paths, self._most_paths)
        program = session.program(["pass/light_paths.cl"], {**facts, "VW": session.lanes}, layout.device_declarations())
        self._curve = session.upload(self._curve_of(lights.areas))
        self._launch = session.bind(
            program, "light_paths", **scene, surfaces=session.upload(lights.surfaces), surface_curve=self._curve,
            found=buffers.found, **{"pass": bytes(LIGHT_PASS.dtype.itemsize)},
        )  # fmt: skip

    def use(self, sample: int, seed: int) -> None:
        """Have the virtual lights in place that a sample sees."""
        seen = pass_of(sample)
        learning = self._edges, self._learning_paths
        key = (*learning, self._pixels, seed, seen.number)
        if self._buffers.current == key:
            return
        self._buffers.current = key
        if learning not in self._buffers.learned:
            self._buffers.learned[learning] = self._learn()
        learned = self._buffers.learned[learning]
        wanted = max(seen.samples * self._pixels * _PATHS_PER_SAMPLE, _LEAST_PATHS) / learned.effective**self._more
        count = min(1 << int(wanted).bit_length() - 1, _MOST_PATHS, self._most_paths)
        self._session.write(self._curve, learned.curve)
        lights = picked(self._trace(seen.number, count, seed), learned, layout.seed_words(seed ^ seen.number)[1])
        grid = VIRTUAL_GRID.one(low=(*learned.low, learned.per_cell), side=SIDE, count=max(len(lights), 1))
        self._session.write(self._buffers.grid, grid)
        self._session.write(self._buffers.density, learned.density)
        self._session.write(self._buffers.lights, lights if len(lights) else np.zeros((1, _FLOATS), np.float32))

    def _curve_of(self, shares: Array) -> Floats:
        return layout.curves(shares[None])[0].ravel()

    def _trace(self, number: int, count: int, seed: int, *, from_eye: bool = False) -> Floats:
        """Return the places of the paths of a pass, (8, edges, paths); those without a mark are none."""
        record = LIGHT_PASS.one(
            seed=layout.seed_words(seed ^ _SEED), number=number, paths=count,
            max_edges=self._edges, surfaces=len(self._lights.areas), from_eye=from_eye, per_path=1 / count,
            by_chance=self._lights.by_chance,
        )  # fmt: skip
        self._launch.set(**{"pass": record.tobytes()})
        self._launch.enqueue(count // self._session.lanes, self._session.group)
        found = self._session.read(self._buffers.found, np.float32, count * _FLOATS * self._edges)
        found = found.reshape(_FLOATS, self._edges, count)
        found[_MARK].view(np.int32)[~self._are_inside(found)] = -1
        return found

    def _grid(self, starts: Floats) -> tuple[Floats, np.float32]:
        """Return the lowest corner of the grid and one over the width of its cells: about what paths start on."""
        box = self._lights.box
        low, high = (starts[:3].min(axis=1), starts[:3].max(axis=1)) if box is None else box.astype(np.float32)
        return low, np.float32(SIDE * 0.999 / max(float((high - low).max()), 1e-9))

    def _are_inside(self, found: Floats) -> NDArray[np.bool_]:
        """Return which places lie in the grid as the kernels see it, where planes go on beyond it."""
        if self._lights.box is None:
            return np.ones(found.shape[1:], np.bool_)
        low, per_cell = self._grid(found)
        with np.errstate(over="ignore", invalid="ignore"):  # where a ray met nothing, or a plane far away
            places = (np.moveaxis(found[:3], 0, -1) - low) * per_cell
        return np.asarray(((places >= 0) & (places < SIDE)).all(axis=-1))

    def _learn(self) -> _Learned:
        """Learn from paths by area and from the eye where light paths should start and which virtual lights matter."""
        areas, count = self._lights.areas, self._learning_paths
        self._session.write(self._curve, self._curve_of(areas))
        paths = self._trace(_LEARNING, count, _LEARNING_SEED)
        seen = self._trace(_LOOKING, count, _LEARNING_SEED, from_eye=True)
        starts, found, met = paths[:, 0], _lights(paths), _lights(seen, first_edge=1)
        grid, starts = self._grid(starts), starts[:, self._are_inside(starts)]
        cells = _FACINGS * SIDE**3
        # Either side of a surface has its area; few starts of a cell do not tell how little it is.
        one_side = np.bincount(cells_of(starts, *grid), minlength=cells).reshape(-1, 2, SIDE**3)
        area = np.maximum(np.maximum(one_side, one_side[:, ::-1]), 8).ravel() * (areas.sum() / count)
        cell, power = cells_of(found, *grid), _luminance(found)
        importance = np.bincount(cells_of(met, *grid), _luminance(met), cells) / area
        usual = float((importance[cell] * power).sum() / max(power.sum(), 1e-300))
        importance += _LEAST_IMPORTANCE * usual if usual > 0 else 1.0
        worth = power * importance[cell]
        light = np.bincount(cell, worth, cells)
        counts = importance > importance.min()
        alike = counts / max((counts * area).sum(), 1e-300)
        density = _BOUND * ((1 - _ALIKE) * light / max(light.sum(), 1e-300) / area + _ALIKE * alike)
        start_of = found[_MARK].view(np.int32) & (1 << _WAY_SHIFT) - 1
        gain = np.bincount(start_of, worth, len(areas))
        by_area = areas / areas.sum()
        shares = _LEARNED * gain / gain.sum() + (1 - _LEARNED) * by_area if gain.sum() > 0 else by_area
        curve = self._curve_of(shares)
        self._session.write(self._curve, curve)
        again = self._trace(_LEARNED_ONCE, min(_LEAST_PATHS, count), _LEARNING_SEED)
        brings, lit = np.zeros(again.shape[1:]), _lights(again)
        brings[again[_MARK].view(np.int32) >= 0] = _luminance(lit) * importance[cells_of(lit, *grid)]
        of_path = brings.sum(axis=0)
        effective = float(of_path.sum() ** 2 / max((of_path**2).sum(), 1e-300) / len(of_path))
        return _Learned(curve, *grid, importance, density.astype(np.float32), max(effective, 1 / len(of_path)))


def _lights(found: Floats, first_edge: int = 0) -> Floats:
    """Return those of the places of paths (8, edges, paths) that are virtual lights, (8, n)."""
    at = np.flatnonzero(found[_MARK, first_edge:].view(np.int32) >= 0) + first_edge * found.shape[2]
    return np.asarray(found.reshape(_FLOATS, -1).take(at, axis=1))


def _luminance(found: Floats) -> Array:
    return np.asarray(luminance(found[_LIGHT].T))


def cells_of(found: Floats, low: Floats, per_cell: np.float32) -> NDArray[np.int32]:
    """Return the cells of places by where they are and what they face, as `kernels/light/virtual_lights.h` has them."""
    x, y, z = (((places - least) * per_cell).astype(np.int32) for places, least in zip(found[:3], low, strict=True))
    x, y, z = (np.minimum(np.maximum(place, 0), SIDE - 1) for place in (x, y, z))
    nx, ny, nz = _unfolded(found[_NORMAL].view(np.int32))
    ax, ay, az = np.abs(nx), np.abs(ny), np.abs(nz)
    upright, deep = az > np.maximum(ax, ay), ay > ax
    facing = np.where(upright, 4, np.where(deep, 2, 0)) + (np.where(upright, nz, np.where(deep, ny, nx)) < 0)
    return np.asarray(((facing * SIDE + z) * SIDE + y) * SIDE + x)


def from_octahedral(packed: NDArray[np.int32]) -> Floats:
    """Return the unit vectors (n, 3) that `kernels/common/octahedral.h` packs."""
    vectors = np.stack(_unfolded(packed), axis=1)
    return np.asarray(vectors / np.sqrt((vectors * vectors).sum(axis=1, keepdims=True)))


def _unfolded(packed: NDArray[np.int32]) -> tuple[Floats, Floats, Floats]:
    """Return the components of the same, whose absolute values add up to 1."""
    halves = (packed & 0xFFFF, packed >> 16 & 0xFFFF)
    x, y = ((half.astype(np.float32) - np.float32(32767.5)) / np.float32(32767) for half in halves)
    ax, ay = np.abs(x), np.abs(y)
    z = 1 - ax - ay
    below = z < 0
    return np.where(below, np.copysign(1 - ay, x), x), np.where(below, np.copysign(1 - ax, y), y), z


def picked(found: Floats, learned: _Learned, word: int) -> Floats:
    """Return virtual lights that are alike in worth, sorted by place: picking one of them evenly is right on average.

    Resampled with even steps from a random start (systematic resampling), each by its power times the importance of its
    cell.
    """
    found = _lights(found)
    worth = _luminance(found) * learned.importance[cells_of(found, learned.low, learned.per_cell)]
    found, worth = found[:, worth > 0], worth[worth > 0]
    if not len(worth):
        return found.T
    order = np.argsort(_along_curve(found), kind="stable")
    sums = np.cumsum(worth[order])
    count = min(1 << (len(worth) - 1).bit_length(), MOST)
    steps = (np.arange(count) + (word + 0.5) / 2**32) * (sums[-1] / count)
    picks = order[np.minimum(np.searchsorted(sums, steps), len(worth) - 1)]
    lights: Floats = np.ascontiguousarray(found[:, picks].T)
    lights[:, _LIGHT] *= (sums[-1] / worth[picks]).astype(np.float32)[:, None]
    return lights


def _along_curve(found: Floats) -> NDArray[np.uint16]:
    """Return where places lie along a Morton curve, neighbours mostly near to each other."""
    low, extent = found[:3].min(axis=1, keepdims=True), float(np.ptp(found[:3], axis=1).max())
    x, y, z = _SPREAD[((found[:3] - low) * np.float32(31.99 / max(extent, 1e-9))).astype(np.int32)]
    return np.asarray(x | y << 1 | z << 2, np.uint16)


_SPREAD = np.array([sum((i >> bit & 1) << 3 * bit for bit in range(5)) for i in range(32)], np.uint16)
