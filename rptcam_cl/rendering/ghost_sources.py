"""Light on the front of a lens whose ghosts are wanted: lamps and suns of a scene, and their images in mirrors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import WAVELENGTHS_NM, luminance
from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.records import EmitterKind, Hidden, SpectrumKind
from rptcam_cl.device.session import Session
from rptcam_cl.optics.lens import Lens
from rptcam_cl.rendering import lamps as lamp_light
from rptcam_cl.rendering.cameras.lens_records import ghosts_have_colours, usable_nm
from rptcam_cl.rendering.cameras.setting import LensSetting
from rptcam_cl.rendering.highlights import Front, Pencils, highlights, lamps_among
from rptcam_cl.rendering.lamps import Patches, Points
from rptcam_cl.rendering.plan.environment import bright_parts
from rptcam_cl.rendering.plan.plan import Plan, observer
from rptcam_cl.rendering.plan.textures import Textures
from rptcam_cl.rendering.point_spread import shares_of_white
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.changes import at_opening
from rptcam_cl.scene.scene import Scene

# What lights the front of a lens: points of lamps and suns, in the lens's frame, as far as nothing hides them.

Array = NDArray[np.float64]

_FRONT_POINTS = 8  # that look for what hides them
MOST = 512  # points that light is traced from
STEEPEST = 85.0  # degrees from the axis
_SMALL = 3e-3  # radius of a lamp over its distance, up to which all of it shines through the same parts of the front
FAINT = 1e-3  # of all light, below which the faintest sources beside highlights are left out
_PENCIL = 2.0  # in place of 0 and 1, of a source whose light has the curvature of its own


@dataclass(frozen=True)
class Sources:
    """Points that light a lens.

    Attributes
    ----------
    places : (n, 4) or (n, 12) array
        Direction in which light of a source at infinity travels, or where a lamp is [mm], in the frame of the lens;
        the last number is 1 of a lamp, 2 of a mirrored highlight. Where there are such, also how its direction changes
        along x and y of the first vertex's plane [1/mm].
    irradiance : (n, 3) array
        Across the light before the front of the lens [W/m2].
    left_out : tuple of str
        Kinds of lamps whose ghosts are not known.
    dropped_share : float
        Of all that light, what fainter sources than the brightest have.
    known : (n, 3) array
        Number of the spectrum of a lamp, 0 of one that has none; how many times it is the irradiance; and the number
        of the lamp, where light is not even of each part of it.
    patches : Patches
        Of the emitter around each point, in the frame of the lens, from which rays come.
    mirrored : int
        How many are mirrored highlights.
    """

    places: Array
    irradiance: Array
    left_out: tuple[str, ...]
    dropped_share: float
    known: Array
    patches: Patches
    mirrored: int = 0

    @property
    def tilt(self) -> float:
        """Largest tangent of the angle between the light and the axis."""
        sideways = np.hypot(self.places[:, 0], self.places[:, 1])
        return float(np.max(sideways / np.abs(self.places[:, 2]), initial=0.0))


@dataclass(frozen=True, eq=False)
class _Parts(Rows):
    """Parts of emitters.

    Attributes
    ----------
    at, light, target : (n, 4), (n, 3) and (n, 2) arrays
        As `points_of` gives them, in the world about the eye.
    known : (n, 3) array
        As that of `Sources`.
    patches : Patches
        In the world about the eye.
    """

    at: Array
    light: Array
    target: Array
    known: Array
    patches: Patches

    @property
    def lamps(self) -> NDArray[np.bool_]:
        """Which are places, not directions."""
        return np.asarray(self.at[:, 3] > 0)


def sources_of(
    scene: Scene,
    plan: Plan,
    buffers: SceneBuffers,
    session: Session,
    lens: Lens,
    film_z: float,
    *,
    mirrors: bool = True,
) -> Sources:
    """Return the sources of a scene that light the front of a lens from less than 85 degrees and are not hidden.

    Parameters
    ----------
    scene : Scene
    plan : Plan
        Its plan, whose emitters count.
    buffers : SceneBuffers
    session : Session
    lens : Lens
    film_z : float
        Of the film in the frame of the lens [mm].
    mirrors : bool
        Whether highlights are looked for.
    """
    turn = at_opening(scene).camera.world_from_camera()[:3, :3]
    front = _front(lens, film_z, turn)
    parts, far, left_out = _parts_of_emitters(scene, plan, front)
    parts, dropped = _brightest(parts, turn, film_z)
    seen = lamp_light.visible(session, plan, buffers, parts.patches, parts.lamps, parts.target, front.spots)
    parts, places = _unhidden(parts, _places_in_lens(parts, turn, film_z), seen)
    own = _in_lens(parts.patches, parts.lamps, turn, film_z)
    direct = Sources(places, parts.light, left_out, dropped, parts.known, own)
    if not mirrors:
        return direct
    records = plan.emitters.shining
    lamps = lamps_among(records[records["hidden"] & Hidden.FROM_REFLECTION == 0], far, front.vertex)
    pencils = highlights(plan, session, buffers, lamps, front)
    return direct if pencils is None else _with_pencils(direct, pencils, turn)


def _parts_of_emitters(scene: Scene, plan: Plan, front: Front) -> tuple[_Parts, list[Points], tuple[str, ...]]:
    """Return the parts of all emitters, those of the surroundings among them, and kinds whose ghosts are unknown."""
    nothing = np.zeros((0, 4))
    parts = [_Parts(nothing, nothing[:, :3], nothing[:, :2], nothing[:, :3], lamp_light.points_alone(nothing))]
    far, left_out, records = list[Points](), set[str](), plan.emitters.shining
    for record in records:
        lamp, shown = lamp_light.patches_of(record, front.vertex), float(not record["hidden"] & Hidden.FROM_CAMERA)

        def add(points: Points, patches: Patches, parted: bool, *, shown: float = shown, own: np.void = record) -> None:
            at, light, target = points
            parts.append(_Parts(at, shown * light, target, _known(own, light, parted), patches))

        if int(record["kind"]) == EmitterKind.ENVIRONMENT:
            towards, irradiance, sides = bright_parts(scene)
            far = [
                lamp_light.points_at(towards[k : k + 1], 0.0, irradiance[k : k + 1], record)
                for k in range(len(towards))
            ]
            for points, middle, own in zip(far, towards, sides, strict=True):
                add(points, lamp_light.square_patch(middle, *own), True)
            left_out.add("dim parts of the surroundings" if far else "surroundings")
        elif lamp is None:
            left_out.add(EmitterKind(int(record["kind"])).name.lower())
        else:
            triangles = int((records["primitive"] == record["primitive"]).sum())
            painted = _painted(record, lamp[1], plan.textures, front.vertex, _PARTS // triangles)
            add(*(painted or _as_one(*lamp, front.vertex)), painted is not None)
    whole = _Parts.joined(parts)
    whole.known[:, 2] = np.cumsum(whole.known[:, 2])
    return whole, far, tuple(sorted(left_out))


def _places_in_lens(parts: _Parts, turn: Array, film_z: float) -> Array:
    """Return where parts are [mm], or how their light travels, in the frame of the lens (n, 4)."""
    places, lamps = np.column_stack([parts.at[:, :3] @ turn, parts.at[:, 3]]), parts.lamps[:, None]
    places[:, :3] = np.where(lamps, (places[:, :3] - [0.0, 0.0, -film_z * 1e-3]) * 1e3, -places[:, :3])
    return places


def _brightest(parts: _Parts, turn: Array, film_z: float) -> tuple[_Parts, float]:
    """Return the brightest parts before the lens, and what share of the light there others have."""
    ways = np.where(parts.lamps[:, None], -1.0, 1.0) * _places_in_lens(parts, turn, film_z)[:, :3]
    seen = _ahead(ways) & (luminance(parts.light) > 0)
    bright = luminance(parts.light[seen])
    order = np.flatnonzero(seen)[np.argsort(-bright, kind="stable")[:MOST]]
    dropped = 1.0 - float(luminance(parts.light[order]).sum() / bright.sum()) if len(order) else 0.0
    return parts[order], dropped


def _unhidden(parts: _Parts, places: Array, seen: Array) -> tuple[_Parts, Array]:
    """Return parts of which a share is seen, with its light, and their places; a sun of which all is seen is one."""
    parts.known[:, 1] *= seen
    bright = seen > 0
    for sun in np.unique(parts.known[~parts.lamps, 2]):
        rows = np.flatnonzero(parts.known[:, 2] == sun)
        if len(rows) == lamp_light.POINTS and seen[rows].min() == 1:  # all of it lights as one
            first = rows[0]
            places[first], parts.light[first] = places[rows].mean(axis=0), parts.light[rows].sum(axis=0)
            parts.known[first, 1], parts.patches.cell[first] = parts.known[rows, 1].sum(), [0.0, 0.0, 1.0, 1.0]
            bright[rows[1:]] = False
    return replace(parts, light=parts.light * seen[:, None])[bright], places[bright]


def _as_one(
    points: tuple[Array, Array, Array], patches: Patches, vertex: Array
) -> tuple[tuple[Array, Array, Array], Patches]:
    """Return points and patches of an emitter; of a lamp that shows small from the front one, of all of it."""
    at, light, target = points
    if len(at) == 1 or not at[0, 3] or not _shows_small(patches, vertex):
        return points, patches
    whole = replace(patches[:1], cell=np.array([[0.0, 0.0, 1.0, 1.0]]), normal=patches.normal.mean(axis=0)[None])
    return (at.mean(axis=0)[None], light.sum(axis=0)[None], target[:1]), whole


def _shows_small(patches: Patches, vertex: Array) -> bool:
    """Return whether all of a lamp shines through the same parts of the front."""
    size = max(float(np.linalg.norm(side, axis=1).max()) for side in (patches.first, patches.second))
    half = np.full(len(patches), 0.5)
    return bool(size <= _SMALL * np.linalg.norm(patches.at(half, half) - vertex, axis=1).min())


def _known(record: np.void, irradiance: Array, parted: bool) -> Array:
    """Return the number of an emitter's spectrum, how many times it its points give, and which begin a lamp (n, 3)."""
    brightest = int(np.argmax(record["radiance"][:3]))
    times = irradiance[:, brightest] / max(float(record["radiance"][brightest]), 1e-300)
    begins = np.full(len(irradiance), float(parted))
    begins[0] = 1.0
    return np.column_stack([np.full(len(irradiance), float(record["radiance"][3])), times, begins])


# Lamps with a picture: parts of them within which the picture is nearly even.

_PARTS, _ACROSS = 64, 256  # of a lamp; points along its unit square that tell its picture
_EVEN = 1e-4  # of the squares of a picture's light about its mean: what parts may leave


def _painted(
    record: np.void, patches: Patches, textures: Textures, vertex: Array, most: int
) -> tuple[Points, Patches] | None:
    """Return points and patches of an emitter with a picture; None of others, and of patterns that are none."""
    texture = int(record["texture"])
    if texture < 0 or record["kind"] not in (*lamp_light.FLAT, EmitterKind.SPHERE):
        return None
    whole = replace(patches[:1], cell=np.array([[0.0, 0.0, 1.0, 1.0]]))
    across = np.clip(int(_ACROSS * np.sqrt(max(most, 1) / _PARTS)), 8, _ACROSS)
    t, s = (np.indices((across, across)).reshape(2, -1) + 0.5) / across
    places, sphere = whole[np.zeros(across**2, int)].at(s, t), record["kind"] == EmitterKind.SPHERE
    a, u, v, uv, uv_x, uv_y = (record[name][:3].astype(float) for name in ("a", "u", "v", "uv", "uv_x", "uv_y"))
    if sphere:  # u and v are its x and z axes, uv[2] its handedness
        to = places - a
        ahead = (vertex - a) / np.linalg.norm(vertex - a)
        to += ahead * np.sqrt(np.maximum(record["a"][3] ** 2 - np.sum(to**2, axis=1), 0))[:, None]
        east, north, up = to @ u, to @ np.cross(v, u) * uv[2], to @ v
        at = np.mod(np.arctan2(north, east) / (2 * np.pi), 1.0), np.arctan2(up, np.hypot(east, north)) / np.pi + 0.5
    else:
        x, y = ((places - a) @ np.linalg.pinv(np.array([u, v]))).T
        at = uv[0] + x * uv_x[0] + y * uv_y[0], uv[1] + x * uv_x[1] + y * uv_y[1]
    picture = textures.image_at(texture, *at)
    if picture is None:
        return None
    side = 1 if most < lamp_light.POINTS or _shows_small(patches, vertex) else math.isqrt(lamp_light.POINTS)
    cells, colours = _even_cells(picture.reshape(across, across, 3), side, max(most, 1))
    parts = replace(whole[np.zeros(len(cells), int)], cell=cells)
    middles, share = parts.at(np.full(len(cells), 0.5), np.full(len(cells), 0.5)), cells[:, 2:].prod(axis=1)
    away = vertex - (a if sphere else middles)
    square = np.sum(away**2, axis=-1)
    facing, normal = np.ones(len(cells)), record["normal"][:3].astype(float)
    if not sphere:
        cosine = away @ normal / np.sqrt(square)
        facing = np.maximum(np.abs(cosine) if record["two_sided"] else cosine, 0.0)
        parts = replace(parts, normal=normal / np.where(cosine == 0, np.inf, cosine)[:, None])
    area = (np.pi * record["a"][3] ** 2 if sphere else float(record["a"][3])) * share
    return lamp_light.points_at(middles, 1.0, colours * (area * facing / square)[:, None], record), parts


def _even_cells(picture: Array, side: int, most: int) -> tuple[Array, Array]:
    """Part a square picture (n, n, 3) of t and s into as even cells (m, 4) as may be; with their colours (m, 3).

    ``side`` is the number of cells along it to begin with.
    """
    size = len(picture)
    sums, squares = np.zeros((2, size + 1, size + 1, 3))
    sums[1:, 1:], squares[1:, 1:] = (each.cumsum(axis=0).cumsum(axis=1) for each in (picture, picture**2))

    def within(table: Array, y0: Any, x0: Any, y1: Any, x1: Any) -> Array:
        return np.asarray(table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0])

    def uneven(y0: Any, x0: Any, y1: Any, x1: Any) -> Array:
        area = np.asarray((y1 - y0) * (x1 - x0))[..., None]
        off = within(squares, y0, x0, y1, x1) - within(sums, y0, x0, y1, x1) ** 2 / area
        return np.asarray(np.maximum(off, 0.0).sum(axis=-1))

    ends = [size * k // side for k in range(side + 1)]
    cells = [(y0, x0, y1, x1) for y0, y1 in itertools.pairwise(ends) for x0, x1 in itertools.pairwise(ends)]
    left = [float(uneven(*cell)) for cell in cells]
    while len(cells) < most and sum(left) > _EVEN * float(squares[-1, -1].sum()):
        worst = int(np.argmax(left))
        y0, x0, y1, x1 = cells[worst]
        y, x = np.arange(y0 + 1, y1), np.arange(x0 + 1, x1)
        by_row = uneven(y0, x0, y, x1) + uneven(y, x0, y1, x1) + 1e-9 * np.abs(2 * y - y0 - y1)
        by_column = uneven(y0, x0, y1, x) + uneven(y0, x, y1, x1) + 1e-9 * np.abs(2 * x - x0 - x1)
        if np.min(by_row, initial=np.inf) < np.min(by_column, initial=np.inf):
            at = int(y[np.argmin(by_row)])
            halves = (y0, x0, at, x1), (at, x0, y1, x1)
        elif len(x):
            at = int(x[np.argmin(by_column)])
            halves = (y0, x0, y1, at), (y0, at, y1, x1)
        else:
            left[worst] = 0.0  # a point
            continue
        cells[worst : worst + 1], left[worst : worst + 1] = halves, [float(uneven(*half)) for half in halves]
    y0, x0, y1, x1 = np.array(cells).T
    colours = within(sums, y0, x0, y1, x1) / ((y1 - y0) * (x1 - x0))[:, None]
    return np.column_stack([x0, y0, x1 - x0, y1 - y0]) / size, colours


def _front(lens: Lens, film_z: float, turn: Array) -> Front:
    """Return the front of a lens in the world about the eye."""
    vertex, radius = np.array([0.0, 0.0, -film_z * 1e-3]), lens.surfaces[0].semi_diameter * 1e-3
    u, v = lamp_light.lattice(_FRONT_POINTS)
    angle, reach = 2 * np.pi * v, radius * np.sqrt(u)
    spots = vertex + np.stack([reach * np.cos(angle), reach * np.sin(angle), np.zeros(_FRONT_POINTS)], axis=1)
    return Front(turn @ vertex, spots @ turn.T, radius)


def _in_lens(patches: Patches, lamps: NDArray[np.bool_], turn: Array, film_z: float) -> Patches:
    """Turn patches to the frame of the lens: places [mm], or ways in which light travels."""
    scale = np.where(lamps, 1e3, -1.0)[:, None]
    shift = np.where(lamps, film_z, 0.0)[:, None] * [0.0, 0.0, 1.0]
    first, second, base = (scale * (each @ turn) for each in (patches.first, patches.second, patches.base))
    return replace(patches, base=base + shift, first=first, second=second, normal=patches.normal @ turn)


def _ahead(ways: Array) -> NDArray[np.bool_]:
    """Return whether light that travels so (n, 3) comes from before the lens."""
    return np.asarray(ways[:, 2] > np.cos(np.radians(STEEPEST)) * np.linalg.norm(ways, axis=1))


def _with_pencils(direct: Sources, pencils: Pencils, turn: Array) -> Sources:
    """Return sources with mirrored highlights; the faintest of all are left out."""
    ways, bends, irradiance = pencils
    ways, bends = ways @ turn, turn.T @ bends @ turn * 1e-3
    ahead = _ahead(ways) & np.all(np.isfinite(bends), axis=(1, 2))
    places, first = np.zeros((len(direct.places) + int(ahead.sum()), 12)), len(direct.places)
    places[:first, :4] = direct.places
    places[first:, :3], places[first:, 3] = ways[ahead], _PENCIL
    places[first:, 4:7], places[first:, 8:11] = bends[ahead, :, 0], bends[ahead, :, 1]
    light = np.concatenate([direct.irradiance, irradiance[ahead]])
    bright = luminance(light)
    order = np.argsort(-bright, kind="stable")
    share = np.cumsum(bright[order]) / max(float(bright.sum()), 1e-300)
    order = np.sort(order[: min(int(np.searchsorted(share, 1.0 - FAINT)) + 1, MOST)])
    mirrored = int((order >= first).sum())
    if not mirrored:
        return direct
    every = float(bright[:first].sum()) / (1.0 - direct.dropped_share) + float(bright[first:].sum())
    dropped = 1.0 - float(bright[order].sum()) / every
    known = np.concatenate([direct.known, np.zeros((int(ahead.sum()), 3))])
    known[first:, 2] = -1.0 - np.arange(int(ahead.sum()))
    patches = Patches.joined([direct.patches, lamp_light.points_alone(places[first:])])
    return Sources(places[order], light[order], direct.left_out, dropped, known[order], patches[order], mirrored)


# Wavelengths at which light of ghosts is traced, and what each source gives the film's colours at them.

WAVES_NM = (425.0, 475.0, 525.0, 575.0, 625.0, 675.0)  # where colours differ


class Band(NamedTuple):
    """A wavelength that stands for those up to half a width away [nm], and the light of sources in them [W/m2]."""

    nm: float
    light: Array
    half_nm: float


def bands(scene: Scene, plan: Plan, setting: LensSetting, sources: Sources, *, tinted: bool = False) -> list[Band]:
    """Return wavelengths for light given as red, green and blue, and for each spectrum of a lamp its own.

    A film of red, green and blue knows no spectra. Beyond what the lens is known for its last wavelength stands in.
    Where neither the lens nor anything else (`tinted`) tells colours apart there is one.
    """
    tinted, numbers = tinted or ghosts_have_colours(setting), sources.known[:, 0].astype(int)
    if plan.spectrum.kind == SpectrumKind.RGB:
        numbers = np.zeros_like(numbers)
    waves = WAVES_NM if tinted else (setting.camera.wavelength_nm,)
    shares = shares_of_white(WAVES_NM) if tinted else np.ones((1, 3))
    limits = usable_nm(setting.lens, setting.transmission) if tinted else (0.0, np.inf)

    def known(nm: float) -> float:
        return float(np.clip(nm, *limits))

    plain, every = numbers == 0, []
    if plain.any() or not len(plain):
        light = np.where(plain[:, None], sources.irradiance, 0.0)
        half = (WAVES_NM[1] - WAVES_NM[0]) / 2
        every = [Band(known(nm), light * share, half) for nm, share in zip(waves, shares, strict=True)]
    matching = observer(scene)[1]
    for number in np.unique(numbers[~plain]):
        times = np.where(numbers == number, sources.known[:, 1], 0.0)[:, None]
        for nm, seen, half in _bands_of_spectrum(plan.colours[0].samples[number - 1][:, None] * matching, waves):
            every.append(Band(known(nm), times * seen, half))
    return every


def _bands_of_spectrum(seen: Array, waves: tuple[float, ...]) -> Iterator[Band]:
    """Yield the middle [nm] of light (401, 3) in each band about some waves, and its sum (3,); none of dark ones."""
    places = np.argmin(np.abs(WAVELENGTHS_NM[:, None] - np.array(waves)), axis=1)
    for place, wave in enumerate(waves):
        own = seen[places == place]
        strength = np.abs(own).sum(axis=1)
        if strength.any():
            middle = float(WAVELENGTHS_NM[places == place] @ strength / strength.sum())
            square = float((WAVELENGTHS_NM[places == place] - middle) ** 2 @ strength / strength.sum())
            yield Band(middle if len(waves) > 1 else wave, own.sum(axis=0), math.sqrt(3.0 * square))
