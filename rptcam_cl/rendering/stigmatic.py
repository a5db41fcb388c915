"""A lens without aberrations in place of a lens: what a film is made of whose kernels of diffraction hold them.

Rays of a film point leave the lens towards the one point of the scene that is sharp there, its conjugate, from where
and with what weight the lens lets them out. So they bring the blur of what is out of focus, and no aberration. Waves of
the conjugates bring that, and diffraction with it. docs/diffraction.md has the errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.rendering.cameras.chief_rays import CameraRays
from rptcam_cl.rendering.cameras.film_pupil import FilmPupil, FilmPupils
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.model import CameraModel, LampReach, Reached
from rptcam_cl.rendering.cameras.setting import film_frame
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.point_spread import PointWave, point_wave
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]

KNOWN_NM = (440.0, 670.0)  # whose paths are traced beside the camera's; others lie between
FIT = 19, 9  # directions each way that rays are traced of, and powers of polynomials between them
ACROSS = 129  # nodes of the table of conjugates each way: within 0.01 pixels of 2000, for 5 % of distortion
FARTHEST_M = 1e5  # of a point of the scene, beyond which focus is as at infinity
# Root mean square of a wavefront [waves], in the plane of focus. Below the first, waves bring it. Above the second rays
# do, as well as waves would and with the sign that tells curvature of the field from what is out of focus otherwise.
BY_WAVES, BY_RAYS = 0.45, 0.7
# Beside the image circle a sliver of the pupil may show a point of the scene far from where its chief ray leads, which
# would crowd even light between two nodes, or too few rays say how its wavefront goes on.
MOST_MOVED = 0.004  # of the way to the next node, up to which waves may move the image
WIDEST_SPOT = 20.0  # wavelengths over twice the aperture: rays of no wavefront that waves bring are farther apart
ENDS = 0.4  # of it, that counts at the ends of the spectrum, where a lens refracts each wavelength in its own way


@dataclass(frozen=True)
class Conjugates:
    """The points of the scene that are sharp on the film, each on the chief ray of a place.

    Attributes
    ----------
    chief : CameraRays
    columns, rows : (a,) and (b,) arrays
        Places of nodes [pixels].
    vergence : float
        One over the distance ahead of the film of the plane of focus [1/m]; 0 at infinity.
    shares : (b, a) array
        How much of the aberrations of the nodes the rays leave out, for waves to bring.
    waves : list of mappings
        Light of the conjugate of each node by rows, by wavelength [nm]; none where no light comes from.
    nm : float
        The camera's wavelength.
    film_z : float
        Of the film in the frame of the lens [mm].
    """

    chief: CameraRays
    columns: Array
    rows: Array
    vergence: float
    shares: Array
    waves: list[dict[float, PointWave]]
    nm: float
    film_z: float

    def at(self, places: Array) -> Array:
        """Return the conjugates (n, 4) of places (n, 2) [pixels], homogeneous, in the frame of the camera [m].

        As seen from where the chief ray leaves the lens, each is as long as the share that waves bring.
        """
        origins, directions = self.chief.smooth(places)
        v, far = self.vergence, directions / -directions[:, 2:]
        ahead = 1.0 + v * origins[:, 2:]
        points = np.hstack([v * origins + far * ahead, np.full((len(places), 1), v)])
        return np.asarray(points * (self.share(places)[:, None] / (np.linalg.norm(far, axis=1)[:, None] * ahead)))

    def share(self, places: Array) -> Array:
        """Return how much of the aberrations of places rays leave out (n,), linear between nodes."""
        along = np.array([np.interp(places[:, 0], self.columns, row) for row in self.shares])
        at, every = np.interp(places[:, 1], self.rows, np.arange(len(self.rows))), np.arange(len(places))
        low = at.astype(int)
        high = np.minimum(low + 1, len(self.rows) - 1)
        return np.asarray(along[low, every] + (at - low) * (along[high, every] - along[low, every]))

    def source(self, place: Array) -> Array:
        """Return the conjugate of a place (2,) in the frame of the lens [mm], within `FARTHEST_M`."""
        return _source(self.chief, place, self.vergence, self.film_z)

    def by_wavelength(self, *, splits: bool) -> list[Callable[[float], PointWave] | None]:
        """Return, for each node, what gives the light of its conjugate at a wavelength [nm].

        Parameters
        ----------
        splits
            Whether the lens refracts each wavelength in its own way; otherwise all go as the camera's.
        """
        known = self.waves if splits else [{nm: each[nm] for nm in each if nm == self.nm} for each in self.waves]
        shares = (
            np.sqrt(self.shares * (2 - self.shares)).ravel().tolist()
        )  # with the rest by rays the same second moment
        return [_between(each, share) if each else None for each, share in zip(known, shares, strict=True)]

    def table(self) -> NDArray[np.float32]:
        """The conjugates of `ACROSS` x `ACROSS` places from edge to edge, as `kernels/lens/stigmatic.h` reads them."""
        steps = np.linspace(-1.0, 1.0, ACROSS)
        upright = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        return self.at(self.chief.on_picture(upright)).astype(np.float32)


def _source(chief: CameraRays, place: Array, vergence: float, film_z: float) -> Array:
    (origin,), (direction,) = chief.smooth(place[None])
    ahead = vergence * origin - direction * ((1.0 + vergence * origin[2]) / direction[2])
    return source_of(np.append(ahead, vergence), film_z)


def source_of(point: Array, film_z: float) -> Array:
    """Return a point of the scene, homogeneous and in the frame of the camera [m], in that of the lens [mm]."""
    length = float(np.linalg.norm(point[:3]))
    there = point[:3] * min(FARTHEST_M / length, 1.0 / point[3] if point[3] > 0 else np.inf)
    return np.asarray(1e3 * there + [0.0, 0.0, film_z])


def _between(known: Mapping[float, PointWave], share: float) -> Callable[[float], PointWave]:
    """Make a function of the wavelength: a share of paths and places, as polynomials in its inverse square."""
    x, waves = np.array(list(known)) ** -2.0, list(known.values())

    def at(nm: float) -> PointWave:
        factors = [share * np.prod([(nm**-2.0 - b) / (a - b) for b in x if b != a]) for a in x]
        path = np.tensordot(factors, [wave.path_mm for wave in waves], 1)
        return replace(waves[0], path_mm=path, places=np.tensordot(factors, [wave.places for wave in waves], 1))

    return at


def conjugates_of(
    scene: Scene, pupils: FilmPupils, nodes: tuple[Array, Array], points: Array, seen: Sequence[FilmPupil | None]
) -> Conjugates | None:
    """Find the conjugates of a film; None where the lens of its camera has no aberrations, or these are not known.

    Parameters
    ----------
    nodes
        Columns and rows of places that waves are known at [pixels].
    points : (n, 2) array
        The nodes on the film [mm], by rows.
    seen
        The opening that each sees; None where no light comes from.
    """
    setting = camera_of(scene).setting
    if setting is None or film_frame(scene.camera).is_moved or scene.shutter.keys:
        return None
    chief, film_z = camera_of(scene).chief_rays(), setting.lens.film_z(setting.film_distance_mm)
    vergence = 0.0 if not setting.focus_distance_mm else max(1e3 / setting.focus_distance_mm, 0.0)
    nm = setting.camera.wavelength_nm

    shares: Array = np.zeros(len(points))
    apart = np.linalg.norm(points - points[:, None], axis=-1)
    next_mm = float(apart[apart > 0].min(initial=np.inf))
    waves: list[dict[float, PointWave]] = [{} for _ in points]
    for number, place in enumerate(np.stack(np.meshgrid(*nodes), axis=-1).reshape(-1, 2)):
        checkpoint()
        pupil = seen[number]
        if pupil is None:
            continue
        source = _source(chief, place, vergence, film_z)
        try:
            waves[number][nm] = point_wave(pupils, pupil, points[number], source, nm, FIT)
        except InputError:
            return None
        for other in KNOWN_NM if scene.spectrum.lens_colour != "off" else ():
            with suppress(InputError):  # the glass is not known there, or the rays are not: others say what it is
                waves[number][other] = point_wave(pupils, pupil, points[number], source, other, FIT)
        wave = waves[number][nm]
        if wave.spot_mm > WIDEST_SPOT * nm * 1e-6 / (2 * pupil.index * pupil.aperture):
            waves[number] = {}
            continue
        off = max(wave.rms(other) * (1.0 if other == nm else ENDS) for other, wave in waves[number].items())
        moved = float(np.linalg.norm(wave.middle_mm)) / next_mm
        shares[number] = np.clip((BY_RAYS - off) / (BY_RAYS - BY_WAVES), 0.0, 1.0) * np.clip(
            2 - moved / MOST_MOVED, 0, 1
        )
    if not shares.any():
        return None
    by_rows = shares.reshape(len(nodes[1]), len(nodes[0]))
    return Conjugates(chief, *nodes, vergence, by_rows, waves, nm, film_z)


def stigmatic(plan: Plan, conjugates: Conjugates | None) -> Plan:
    """Return the plan with rays that go towards the conjugates of their film points; the same where there are none."""
    camera = plan.camera
    if conjugates is None or camera.setting is None or camera.reach is None or plan.steps:
        return plan
    table, record = conjugates.table(), camera.record.copy()
    record["conjugates"] = len(camera.tables)
    new = replace(
        camera,
        record=record,
        facts=camera.facts | {"STIGMATIC": ACROSS},
        tables=np.concatenate([camera.tables, table.ravel()]),
        reach=_reach(camera, camera.reach, conjugates, table),
    )
    return replace(plan, camera=new)


def _reach(camera: CameraModel, reach: LampReach, conjugates: Conjugates, table: NDArray[np.float32]) -> LampReach:
    """Return how a camera sees points of the scene by the rays to conjugates, to first order in the aberrations."""
    scale = np.array(reach.film_scale)
    mm = float(np.abs(scale).max()) * 1e-4  # over which slopes are taken

    def there(film: Array, entry: Array, z: Array) -> Array:
        """Where the rays of film points (n, 2) [mm] meet planes at z (n,) (n, 2) [m]."""
        point = conjugates.at(conjugates.chief.on_picture(film / scale))
        away = point[:, :3] - point[:, 3:] * entry
        return np.asarray(entry[:, :2] + away[:, :2] * ((z - entry[:, 2]) / away[:, 2])[:, None])

    def rays(points: Array, across: int, nm: float | None, near: Array) -> Reached:
        seen = reach.rays(points, across, nm, near)
        film, shape = seen.film.copy(), seen.film.shape[:2]
        lit = seen.passed
        if not lit.any():
            return seen
        own = np.broadcast_to(points[:, None], (*shape, 3))[lit]
        entry = np.column_stack([seen.entry[lit], np.full(int(lit.sum()), reach.entry_z_m)])
        here = there(film[lit], entry, own[:, 2])
        (a, c), (b, d) = ((there(film[lit] + move, entry, own[:, 2]) - here).T / mm for move in np.eye(2) * mm)
        x, y = (own[:, :2] - here).T
        share = conjugates.share(conjugates.chief.on_picture(film[lit] / scale))
        off = np.stack([d * x - b * y, a * y - c * x], axis=1) * (share / (a * d - b * c))[:, None]
        film[lit] += np.where(np.isfinite(off), off, 0.0)  # far beside the film no conjugates are known
        return replace(seen, film=film)

    return replace(reach, rays=rays, made_of=(*reach.made_of, "stigmatic", table))
