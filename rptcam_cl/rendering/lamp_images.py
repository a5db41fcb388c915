"""Lamps in a picture as waves image them: rings and spikes of light out of focus, and how bright a film shows each."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import WAVELENGTHS_NM, cie_1931, rgb_basis
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import EmitterKind, Hidden
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import point_waves
from rptcam_cl.rendering.cameras.chief_rays import CameraRays, seen_places
from rptcam_cl.rendering.cameras.film_pupil import FilmPupil, FilmPupils, film_points
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.lamp_aim import Polynomial
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.lamps import Patches, lattice, patches_of, visible
from rptcam_cl.rendering.plan.plan import WAVELENGTH_CELLS, Plan
from rptcam_cl.rendering.point_spread import FINE, MIDDLE_NM, WAVES_NM, fade, shares_of_white, spread
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.changes import at_opening
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]
Window = tuple[slice, slice]

# What a lamp's film shows by rays is measured in the film itself, so that whatever hides or dims a lamp counts; the
# picture by waves of as much light takes its place. The light of lamps beside the picture is computed.

MOST_LAMPS = 64
_LAMP_POINTS = 16  # of each patch of a lamp whose places are traced
_POINTS_A_PIXEL = 16  # of a lamp's sharp image, which lies between those
_ALONE_PX = 0.5  # of its sharp image, up to which it is a point
_WIDEST_PX = 64.0  # sharp image of a lamp that is treated as one
_FRINGES = 2.0  # of the width of a ring, from which on a lamp's sharp image washes its rings out
_LARGEST_PX = 256  # half width of a picture of a lamp
BEYOND = 1.8  # radii of the rays that it reaches, and as far as the kernel of a sharp point
MOST_ACROSS = 768  # points across a picture by waves: of finer ones, pixels show what rays do
_RAYS_FINER = 4  # points across a pixel for the picture by rays
_FEW_WAVES_PX = 0.25  # wavelength times f-number, below which a third of the wavelengths say what a pixel shows
_FEW_LINES, _LEAST_LINE = 30.0, 1e-3  # nanometres that a light of lines fills, and share from which one counts
_SHOWS = 0.01  # of its light by which waves must differ from rays
UNLIKE = 0.3  # of the light of a lamp by which its film may differ from its rays, in parts of its picture
_BESIDE = 2.5  # half films from the middle, up to which lamps count; from four fifths of it they fade
_PUPIL_POINTS = 8  # that look for what hides them
_POINTS_BESIDE, _MOST_BESIDE, _RAYS_BESIDE = 2, 4096, 64  # a pixel, of a lamp, and of a point of it out of focus


@dataclass(frozen=True)
class LampImage:
    """The picture of a lamp of light 1, about pixels of the whole film.

    Attributes
    ----------
    column, row : int
        Of its first pixel.
    waves, rays : (3, height, width) arrays
        Of red, green and blue; by waves, near the lamp and without its far light.
    light : tuple of float
        Red, green and blue that it brings by computation, where some may fall beside the picture; else 0.
    """

    column: int
    row: int
    waves: NDArray[np.float32]
    rays: NDArray[np.float32]
    light: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def reach(self) -> int:
        """From its middle to where it ends [pixels]."""
        return int(self.waves.shape[2] // 2)

    def meets(self, layout: FilmLayout) -> bool:
        """Return whether some of it lies on a picture."""
        on_film = self.on_film((layout.height, layout.width), (layout.x, layout.y))[0]
        return all(side.stop > side.start for side in on_film)

    def on_film(self, shape: tuple[int, ...], offset: tuple[int, int]) -> tuple[Window, Window]:
        """Return which rows and columns of a film the picture covers, and which of its own these are."""
        film, own = [], []
        firsts = self.row - offset[1], self.column - offset[0]
        for first, size, length in zip(firsts, self.rays.shape[1:], shape, strict=True):
            low, high = max(first, 0), min(first + size, length)
            film.append(slice(low, max(high, low)))
            own.append(slice(low - first, max(high, low) - first))
        return (film[0], film[1]), (own[0], own[1])


@dataclass(frozen=True, eq=False)
class FilmLamp:
    """A lamp whose light a picture has.

    Attributes
    ----------
    place : (x, y)
        Of its middle [pixels].
    size : float
        Width of its sharp image [pixels].
    radius : float
        Of its farthest ray [pixels].
    beside : (n, 5) array
        Its light in pixels beside the picture: their middle [pixels]; red, green and blue.
    lines : (n, 4) array or None
        As `lines_of` has them.
    image : LampImage or None
        That by waves, where they change it.
    opening : int
        Number of its opening, 0 for that of the film's middle.
    own : (2, 2) array
        The linear map of that onto its own.
    """

    place: tuple[float, float]
    size: float
    radius: float
    beside: Array
    lines: Array | None = None
    image: LampImage | None = None
    opening: int = 0
    own: Array = field(default_factory=lambda: np.eye(2))

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """Numbers of it, its light beside the picture, its lines, and its image with this one's numbers."""
        numbers = np.array([*self.place, self.size, self.radius, self.opening, *self.own.ravel()])
        image, known = self.image, (numbers, self.beside, np.zeros((0, 4)) if self.lines is None else self.lines)
        if image is None:
            return known
        return *known, np.stack([image.waves, image.rays]), np.array([image.column, image.row, *image.light])


def film_lamp(arrays: Sequence[NDArray[Any]]) -> FilmLamp:
    """Read the arrays of `FilmLamp.arrays`; raises ValueError where they are others."""
    numbers, beside, lines, *image = arrays
    widths = [array.shape[1:] if array.ndim > 1 else array.shape for array in arrays]
    whole = widths[:3] == [(9,), (5,), (4,)] and len(image) in (0, 2)
    if not whole or not all(np.isfinite(array).all() for array in arrays):
        raise ValueError("diffraction")
    x, y, size, radius, opening, *own = numbers.tolist()
    shown = None
    if image:
        (waves, rays), (column, row, *light) = image[0], image[1].tolist()
        shown = LampImage(int(column), int(row), waves, rays, tuple(light))
    known = beside, lines if len(lines) else None, shown, int(opening), np.reshape(own, (2, 2))
    return FilmLamp((x, y), size, radius, *known)


@dataclass(frozen=True)
class _LampFilm:
    """The film on which lamps are imaged.

    Attributes
    ----------
    scene : Scene
        When its shutter opens.
    turn : (4, 4) array
        From directions of the scene about the eye to the camera's, to multiply from the right.
    pupils : FilmPupils
    seen : sequence of (point, FilmPupil)
        Points of the film [mm], and the openings that they see.
    splits : bool
        Whether rays of the film have a wavelength each, that the lens refracts by.
    units : float
        Wavelengths over twice the numerical aperture that the kernel of a sharp point reaches; with 0 no ring of a lamp
        shows, and none has a picture.
    conjugates : Conjugates or None
        That rays go towards; None for those of the lens.
    chief : CameraRays
        That lead to all lamps.
    value : float
        Of a pixel of the film's middle that sees radiance 1.
    """

    scene: Scene
    turn: Array
    pupils: FilmPupils
    seen: Sequence[tuple[Array, FilmPupil]]
    splits: bool
    units: float
    conjugates: point_waves.Conjugates | None
    chief: CameraRays
    value: float

    @cached_property
    def layout(self) -> FilmLayout:
        """Of the picture."""
        return FilmLayout.of(self.scene.film)

    @cached_property
    def nm(self) -> float:
        """The wavelength of rays that have none of their own."""
        lens = self.scene.camera.lens_camera
        return MIDDLE_NM if lens is None else lens.wavelength_nm

    @cached_property
    def film_z(self) -> float:
        """Of the film in the frame of the lens [mm]."""
        setting = camera_of(self.scene).setting
        return 0.0 if setting is None else setting.lens.film_z(setting.film_distance_mm)

    @cached_property
    def middle_brightness(self) -> float:
        """Of the film's middle, as `FilmPupils.brightness` has it."""
        return self.pupils.brightness(np.zeros(2))

    @cached_property
    def pixel_mm(self) -> tuple[float, float]:
        """Width and height of a pixel; negative where columns or rows run against x or y."""
        return pixel_mm(self.scene)

    @cached_property
    def pixel(self) -> float:
        """Side of a pixel [mm]."""
        return float(np.sqrt(abs(self.pixel_mm[0] * self.pixel_mm[1])))


@dataclass(frozen=True)
class _Lamp:
    """A lamp that the camera may see.

    Attributes
    ----------
    patches : Patches
        About the eye [m].
    w : float
        1 where they are places, 0 of directions.
    light : (3,) array
        That it sends to the pupil [W/sr]; irradiance across it where it is at infinity [W/m2].
    target : (2,) array
        Primitive, and triangle of it.
    lines : (n, 4) array or None
        As `lines_of` has them.
    """

    patches: Patches
    w: float
    light: Array
    target: Array
    lines: Array | None = None


def film_lamps(
    scene: Scene,
    plan: Plan,
    pupils: FilmPupils,
    seen: Sequence[tuple[Array, FilmPupil]],
    units: float,
    conjugates: point_waves.Conjugates | None,
    session: Session | None = None,
) -> list[FilmLamp]:
    """Return the lamps whose light a picture has, but for their openings.

    Parameters
    ----------
    seen, units, conjugates
        As in `_LampFilm`.
    session
        That finds what hides lamps beside the picture; without it their light is not known to fall there.
    """
    scene, turn = at_opening(scene), np.eye(4)
    turn[:3, :3] = scene.camera.world_from_camera()[:3, :3]
    pupil = turn[:3, :3] @ [0.0, 0.0, plan.camera.view.pupil_z_m]
    lamps = list(_lamps(plan, pupil))
    if not lamps:
        return []
    every = [_points(lamp, _LAMP_POINTS) @ turn for lamp in lamps]
    spots = pupil + plan.camera.view.pupil_radius_m * _disk(_PUPIL_POINTS) @ turn[:3, :3].T
    chief, layout = camera_of(scene).chief_rays(), FilmLayout.of(scene.film)
    chief, sharp, shown = _find_lamps(chief, layout, lamps, every, spots, plan, session)
    splits = bool(plan.facts.get("LENS_SPLITS"))
    film = _LampFilm(scene, turn, pupils, seen, splits, units, conjugates, chief, plan.camera.value)
    known = itertools.starmap(partial(_film_lamp, film), zip(lamps, every, sharp, shown.tolist(), strict=True))
    return [lamp for lamp in known if lamp is not None]


def _film_lamp(film: _LampFilm, lamp: _Lamp, own: Array, places: Array, shown: float) -> FilmLamp | None:
    """Return a lamp by its points, their places on the film, and the share that nothing hides; None where it has none.

    Points as homogeneous coordinates (n, 4) in the frame of the camera.
    """
    checkpoint()
    middle, size, on_film = places.mean(axis=0), float(np.ptp(places, axis=0).max()), film.scene.film.resolution
    is_on = bool(((middle > -0.5) & (middle < np.array(on_film) + 0.5)).all())
    if not (size <= _WIDEST_PX and (shown > 0 or (is_on and film.units > 0))):
        return None
    point, source = film_points(film.scene, middle[None])[0, :2], point_waves.source_of(own.mean(axis=0), film.film_z)
    among, light = partial(_among, lamp, own, places, film.turn), np.zeros(3)
    if (value := shown * _counts(middle, np.array(on_film)) * film.value) > 0:
        light = value * _light(film, lamp, own.mean(axis=0), middle, point)
    opening, image = _opening(film, point, source), None
    if film.units > 0 and opening is not None and (is_on or shown > 1 - UNLIKE) and _is_waves(film, places, opening):
        with suppress(InputError):
            opening = point_waves.finer_opening(film.pupils, opening, point, source)
            image = _image(film, among(_POINTS_A_PIXEL), point, source, opening, light, lamp.lines)
    if image is not None and not (is_on or image.meets(film.layout)):
        image = None
    beside = np.zeros((0, 5))
    if light.any():  # of an image far light comes from its middle
        beside = _beside(film.layout, among, _rays(film, opening) if image is None else np.zeros((1, 2)), light)
    radius = opening.radius_mm / film.pixel if opening else 0.0
    return FilmLamp((float(middle[0]), float(middle[1])), size, radius, beside, lamp.lines, image)


def _counts(place: Array, on_film: NDArray[np.int_]) -> float:
    """Return how far a lamp beside the picture counts, by its place [pixels]: less and less towards `_BESIDE`."""
    return float(np.clip(5 - 5 * np.abs(2 * place / on_film - 1).max() / _BESIDE, 0.0, 1.0))


def _find_lamps(
    chief: CameraRays,
    layout: FilmLayout,
    lamps: Sequence[_Lamp],
    every: Sequence[Array],
    spots: Array,
    plan: Plan,
    session: Session | None,
) -> tuple[CameraRays, list[Array], Array]:
    """Find where the picture shows the points of each lamp [pixels], and how much of those beside it nothing hides.

    With the chief rays that lead to all of them. Without a session the share is 0, as it is of lamps on the picture;
    ``spots`` are places of the pupil, about the eye [m].
    """
    sharp, shown = _places(chief, every), np.zeros(len(lamps))
    off = [k for k, places in enumerate(sharp) if not layout.holds(places).all()]
    if not off or session is None:
        return chief, sharp, shown
    chief = chief.wider(_BESIDE)
    for k, places in zip(off, _places(chief, [every[k] for k in off]), strict=True):
        sharp[k] = places
    off = [k for k in off if np.isfinite(sharp[k]).all()]
    shown[off] = _unhidden_shares(session, plan, [lamps[k] for k in off], spots)
    return chief, sharp, shown


def pixel_mm(scene: Scene) -> tuple[float, float]:
    """Return width and height of a pixel; negative where columns or rows run against x or y of the lens."""
    (width, height), (columns, rows) = scene.film.size_m(), scene.film.resolution
    sense = -1e3 if scene.camera.flip else 1e3
    return sense * width / columns, -sense * height / rows


def _points(lamp: _Lamp, count: int) -> Array:
    """Return so many points of each patch (n, 4), homogeneous: with 1 of places, with 0 of directions."""
    (s, t), patches = lattice(count), lamp.patches
    patch = np.repeat(np.arange(len(patches.cell)), count)
    points = patches[patch].at(np.tile(s, len(patches.cell)), np.tile(t, len(patches.cell)))
    return np.column_stack([points, np.full(len(points), lamp.w)])


def _places(chief: CameraRays, every: Sequence[Array]) -> list[Array]:
    """Return where the picture shows the points of each lamp [pixels]."""
    if not every:
        return []
    counts = [len(own) for own in every]
    middles = seen_places(chief, np.array([own.mean(axis=0) for own in every]))
    places = seen_places(chief, np.concatenate(every), np.repeat(middles, counts, axis=0))
    return np.split(places, np.cumsum(counts)[:-1])


def _directions(points: Array) -> Array:
    """Return x and y of points (n, 4) of the camera over their depth."""
    return np.asarray(points[:, :2] / points[:, 2:3])


def _among(lamp: _Lamp, own: Array, places: Array, turn: Array, per_pixel: float, most: float = math.inf) -> Array:
    """Return places of as many points of a lamp as its sharp image wants, between those of known points."""
    patches = len(lamp.patches.cell)
    more = math.ceil(min(per_pixel * float(np.prod(np.ptp(places, axis=0))), most) / patches)
    if more <= _LAMP_POINTS:
        return places
    return Polynomial(_directions(own), places, 2).at(_directions(_points(lamp, more) @ turn))


def has_lamps(plan: Plan) -> bool:
    """Return whether a plan has lamps that the camera may see."""
    return any(True for _ in _lamps(plan, np.zeros(3)))


def _lamps(plan: Plan, pupil: Array) -> Iterator[_Lamp]:
    """Yield the lamps that the camera may see, the brightest first; by what they send to a place about the eye [m]."""
    records = plan.emitters.shining
    bright = np.argsort([-float(max(record["radiance"][:3])) for record in records], kind="stable")
    left = MOST_LAMPS
    for record in (records[k] for k in bright):
        kind = EmitterKind(int(record["kind"]))
        if record["hidden"] & Hidden.FROM_CAMERA or kind in (
            EmitterKind.POINT, EmitterKind.SPOT, EmitterKind.ENVIRONMENT, EmitterKind.DIRECTIONAL, EmitterKind.TRIANGLE,
        ):  # fmt: skip
            continue
        known = patches_of(record, pupil)
        if known is None or left == 0:
            continue
        left -= 1
        (at, light, target), patches = known
        if light.any():
            w = float(at[0, 3])
            square = np.sum((at[:, :3] - pupil) ** 2, axis=1)[:, None] if w else 1.0
            yield _Lamp(patches, w, (light * square).sum(axis=0), target[0], lines_of(plan, int(record["radiance"][3])))


def lines_of(plan: Plan, number: int) -> Array | None:
    """Return wavelengths [nm] of a light by the number of its spectrum, and their shares in red, green and blue (n, 4).

    None where it shines in more than a few: spikes of such light show no fringes.
    """
    if number == 0 or not plan.facts["HAS_SPECTRA"]:
        return None
    cells = WAVELENGTH_CELLS
    edges = plan.spectrum.table[: 4 * (cells + 1)].reshape(-1, 4)[:, 0].astype(np.float64)
    amounts = plan.spectrum.table[4 * (cells + 1) + 4 * cells :].reshape(-1, cells)[number - 1] * np.diff(edges)
    middles = (edges[1:] + edges[:-1]) / 2
    seen = amounts * np.interp(middles, WAVELENGTHS_NM, cie_1931().sum(axis=1))
    own = np.unique(np.rint(middles), return_inverse=True)[1]
    share = np.bincount(own, seen)
    lit = share > _LEAST_LINE * share.sum()
    if not lit.any() or share[lit].sum() ** 2 > _FEW_LINES * (share[lit] ** 2).sum():
        return None
    middle = np.bincount(own, seen * middles)[lit] / share[lit]
    rgb = share[lit, None] * np.stack([np.interp(middle, WAVELENGTHS_NM, plane) for plane in rgb_basis().T], axis=1)
    rgb[:, rgb.sum(axis=0) <= _LEAST_LINE * rgb.sum()] = share[lit, None]  # a channel without light
    return np.column_stack([middle, rgb / rgb.sum(axis=0)])


#
# Lamps beside the picture, or in part: how much light they bring, and where.


def _disk(count: int) -> Array:
    """Return points (n, 3) spread evenly over the unit disk across the axis."""
    u, v = lattice(count)
    return np.stack([np.sqrt(u) * np.cos(2 * np.pi * v), np.sqrt(u) * np.sin(2 * np.pi * v), np.zeros(count)], axis=1)


def _unhidden_shares(session: Session, plan: Plan, lamps: Sequence[_Lamp], spots: Array) -> Array:
    """Return the share of each lamp that nothing hides from places of the pupil, about the eye [m]."""
    if not lamps:
        return np.zeros(0)
    counts = [len(lamp.patches.cell) for lamp in lamps]
    owner = np.repeat(np.arange(len(lamps)), counts)
    are_places, targets = np.array([lamp.w > 0 for lamp in lamps])[owner], np.array([lamp.target for lamp in lamps])
    patches = Patches.joined([lamp.patches for lamp in lamps])
    each = visible(session, plan, SceneBuffers(session, plan), patches, are_places, targets[owner], spots)
    return np.asarray(np.bincount(owner, each) / counts)


def _light(film: _LampFilm, lamp: _Lamp, at: Array, place: Array, point: Array) -> Array:
    """Return the light of a lamp (3,) on the film, in pixels that see radiance 1 in the film's middle.

    By the size of a pixel in the scene, along chief rays, and by how much of the opening the place sees.
    """
    origins, ways = film.chief.smooth(place + 0.5 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]))
    reach = np.linalg.norm(at[:3] - origins.mean(axis=0)) if lamp.w else 1.0
    sides = lamp.w * origins + reach * ways
    across = abs(np.cross(sides[0] - sides[1], sides[2] - sides[3]) @ ways.mean(axis=0))
    try:
        return np.asarray(lamp.light / across * (film.pupils.brightness(point) / film.middle_brightness))
    except InputError:  # the opening is shut there
        return np.zeros(3)


def _rays(film: _LampFilm, opening: point_waves.PointOpening | None) -> Array:
    """Return where some rays of a point of a lamp fall (n, 2), from its sharp place [pixels]."""
    if opening is None or opening.radius_mm < 0.5 * film.pixel:
        return np.zeros((1, 2))
    places = opening.rays(*opening.axes)[2][opening.inside] / film.pixel_mm
    return np.asarray(places[np.linspace(0, len(places) - 1, min(_RAYS_BESIDE, len(places))).astype(int)])


def _beside(layout: FilmLayout, among: Callable[[float, float], Array], rays: Array, light: Array) -> Array:
    """Return middle and light of what lies in each pixel beside the picture (n, 5), of places of a lamp with rays."""
    every = (among(_POINTS_BESIDE, _MOST_BESIDE * 8 // len(rays))[:, None] + rays).reshape(-1, 2)
    out = every[~layout.holds(every)]
    _, own, counts = np.unique(np.floor(out), axis=0, return_inverse=True, return_counts=True)
    middles = [np.bincount(own.ravel(), axis, len(counts)) / np.maximum(counts, 1) for axis in out.T]
    return np.column_stack([*middles, counts[:, None] / len(every) * light])


#
# Their pictures.


def _opening(film: _LampFilm, point: Array, source: Array) -> point_waves.PointOpening | None:
    """Return the opening for a lamp, roughly; None where it is not known."""
    near = min(film.seen, key=lambda known: float(np.linalg.norm(known[0] - point)))
    try:
        return point_waves.rough_opening(film.pupils, near, point, source, film.nm)
    except InputError:
        return None


def _sizes(film: _LampFilm, places: Array, opening: point_waves.PointOpening) -> tuple[float, float, int]:
    """Return wavelength over twice the aperture, radius of the rays, and reach of the picture of a lamp [pixels]."""
    unit, radius = 550e-6 / opening.index / (2 * opening.aperture) / film.pixel, opening.radius_mm / film.pixel
    wide = max(BEYOND * radius + film.units * unit, 2.0) + np.ptp(places, axis=0).max() / 2
    return unit, radius, min(int(np.ceil(wide)), _LARGEST_PX)


def _is_waves(film: _LampFilm, places: Array, opening: point_waves.PointOpening) -> bool:
    """Return whether the rings of a lamp show on its film, and their picture is not too large."""
    unit, radius, reach = _sizes(film, places, opening)
    widest = _FRINGES * max(np.sqrt(2 * unit * radius), 2 * unit)  # Fresnel's, or Airy's
    return bool(np.ptp(places, axis=0).min() <= widest and (2 * reach + 1) * _finer(unit, 550.0) <= MOST_ACROSS)


def _image(
    film: _LampFilm,
    places: Array,
    point: Array,
    source: Array,
    opening: point_waves.PointOpening,
    light: Array,
    lines: Array | None,
) -> LampImage | None:
    """Return the picture of a lamp by the places of its points; None where waves do not change it, or are not known."""
    middle, size, (unit, radius, reach) = places.mean(axis=0), np.ptp(places, axis=0), _sizes(film, places, opening)
    if not _is_waves(film, places, opening):
        return None
    try:
        wave = opening.wave(min(reach / unit, 160.0))
        waves_nm = WAVES_NM if unit > _FEW_WAVES_PX else WAVES_NM[1::3]
        shares = shares_of_white(waves_nm)
        if lines is not None:
            waves_nm, shares = tuple(lines[:, 0].tolist()), lines[:, 1:]
        split, rays_nm = [wave], waves_nm if film.splits else (film.nm,)
        if film.splits:
            split = [point_waves.point_wave(film.pupils, wave.pupil, point, source, nm) for nm in waves_nm]
        by_rays = [_as_rendered(film, own, point, middle, nm) for own, nm in zip(split, rays_nm, strict=True)]
    except InputError:
        return None
    first = np.floor(middle).astype(int) - reach
    waves, rays = (np.zeros((3, 2 * reach + 1, 2 * reach + 1)) for _ in range(2))
    alone = size.max() < _ALONE_PX  # of others the picture is about the middle of a pixel, and moved to their points
    offsets = np.arange(2 * reach + 1) + 0.5 - ((middle - first) if alone else np.full(2, reach + 0.5))[:, None]
    shares = shares[:, :, None, None]
    for nm, share, own in zip(waves_nm, shares, itertools.cycle(split), strict=False):
        checkpoint()
        waves += share * _wave_pixels(own, nm, film.pixel_mm, offsets, unit)
    for share, own in zip(shares if film.splits else np.ones((1, 3, 1, 1)), by_rays, strict=True):
        rays += share * _ray_pixels(own, film.pixel_mm, offsets)
    if not alone:
        waves = spread(waves, _sharp(places - first, 2 * reach + 1, 1.0))
        rays = spread(rays, _sharp(places - first, 2 * reach + 1, float(radius > _ALONE_PX)))
    waves *= fade(np.hypot(*np.meshgrid(*(np.arange(2 * reach + 1) + 0.5 - (middle - first)[:, None]))), reach)
    if not np.abs(waves - rays).sum() > _SHOWS * rays.sum():
        return None
    column, row = (int(place) for place in first)
    return LampImage(column, row, waves.astype(np.float32), rays.astype(np.float32), tuple(light.tolist()))


def _as_rendered(
    film: _LampFilm, wave: point_waves.PointWave, point: Array, place: Array, nm: float
) -> point_waves.PointWave:
    """Return the light of a lamp as rays of the film bring it: those to conjugates leave out what these are off."""
    share = 0.0 if film.conjugates is None else float(film.conjugates.share(place[None])[0])
    if film.conjugates is None or share == 0:
        return wave
    own = point_waves.point_wave(film.pupils, wave.pupil, point, film.conjugates.source(place), nm)
    return replace(wave, places=wave.places - share * own.places)


def _sharp(places: Array, size: int, width: float) -> Array:
    """Return the shares of points in a square of pixels: in the four about each, or in its own, of width 1 and 0."""
    square = np.zeros((size, size))
    x, y = (places - 0.5).T
    i, j = np.floor(x + (1 - width) / 2).astype(int), np.floor(y + (1 - width) / 2).astype(int)
    for column, by_column in ((i, 1 - width * (x - i)), (i + 1, width * (x - i))):
        for row, by_row in ((j, 1 - width * (y - j)), (j + 1, width * (y - j))):
            good = (column >= 0) & (column < size) & (row >= 0) & (row < size)
            np.add.at(square, (row[good], column[good]), (by_column * by_row)[good] / len(places))
    return square


def _finer(unit: float, nm: float) -> int:
    """Return into how many points a pixel is divided, by the wavelength over twice the aperture at 550 nm [pixels]."""
    return max(int(np.ceil(FINE / unit * 550.0 / nm)), 1)


def _wave_pixels(
    wave: point_waves.PointWave, nm: float, pixel_mm: tuple[float, float], offsets: Array, unit: float
) -> Array:
    """Return the light of each pixel, of 1 altogether."""
    finer = _finer(unit, nm)
    light = point_waves.wave_picture(wave, nm, *_finer_places(offsets, finer, pixel_mm))
    return _by_pixels(light * abs(pixel_mm[0] * pixel_mm[1]) / finer**2, finer)


def _ray_pixels(wave: point_waves.PointWave, pixel_mm: tuple[float, float], offsets: Array) -> Array:
    return _by_pixels(point_waves.ray_picture(wave, *_finer_places(offsets, _RAYS_FINER, pixel_mm)), _RAYS_FINER)


def _finer_places(offsets: Array, finer: int, pixel_mm: tuple[float, float]) -> tuple[Array, Array]:
    """Return x and y of so many points each way of each pixel [mm]."""
    within = (np.arange(finer) + 0.5) / finer - 0.5
    x, y = ((part[:, None] + within).ravel() * side for part, side in zip(offsets, pixel_mm, strict=True))
    return x, y


def _by_pixels(light: Array, finer: int) -> Array:
    size = len(light) // finer
    return np.asarray(light.reshape(size, finer, size, finer).sum(axis=(1, 3)))


#
# How bright each lamp is on a film.

PARTS = 3  # of its picture each way
_KNOWN, _SEEN = 0.1, 0.4  # of a lamp on the picture: below the first its light is computed, above the second fitted


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


def with_all_light(lamp: LampImage) -> LampImage:
    """Return the picture of a lamp with all of its light, none of which is far."""
    return replace(lamp, waves=lamp.waves / lamp.waves.sum(axis=(1, 2))[:, None, None])


def pictures(shape: tuple[int, ...], offset: tuple[int, int], lamps: Sequence[LampImage], light: Array) -> Array:
    """Return planes of the same by waves, without their far light."""
    planes = np.zeros(shape)
    for lamp, own in zip(lamps, light, strict=True):
        film, part = lamp.on_film(shape[1:], offset)
        planes[:, film[0], film[1]] += own[:, None, None] * lamp.waves[:, part[0], part[1]]
    return planes
