"""Cheaper camera models in float64, and the depths, stops and pupils that their errors are measured over."""

from __future__ import annotations

import math
from itertools import product
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.film_probe import FINE, FilmProbe, narrowing_probes, pupil_boxes
from rptcam_cl.optics.lens import Lens, ThickLens, thick_lens_of
from rptcam_cl.optics.surface import StopMask, StopShape, cut_polygon
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.lens_records import FAR_MM, disperses, stop_shape, usable_nm
from rptcam_cl.rendering.cameras.ray_map import RayMap, allowed_px, fitted_map
from rptcam_cl.rendering.cameras.setting import LensSetting, lens_camera, lens_setting, lens_to_focus, on_film
from rptcam_cl.scene.assets.mesh import MeshPlacement
from rptcam_cl.scene.camera import keys_as
from rptcam_cl.scene.changes import at_opening, change_scene, with_camera
from rptcam_cl.scene.materials import Emissive, Material, Matte, Mix, Translucent
from rptcam_cl.scene.meshes import LoadedMesh
from rptcam_cl.scene.scene import Scene, Solid
from rptcam_cl.scene.shapes import Box, Object, Plane, Rectangle

# Round stops in place of shaped ones: of the same area, and how far from their place they bring light.

Array = NDArray[np.float64]

CELLS = 64  # along the side of the square round a stop
_FINE_CELLS = 288  # along the side of a larger square
REACH = 1.125  # half that side
BLURRED = 0.1
ROWS = 256  # points whose distances are found at a time


def round_stop(shape: StopShape | StopMask | None) -> tuple[float, float]:
    """Find the round stop that lets as much light through as one of another shape; None is round already.

    Returns
    -------
    radius : float
        In units of that of the shape.
    apart : float
        How far a point of either lies from the other, at most (the distance of Hausdorff), in the same units.
    """
    if shape is None:
        return 1.0, 0.0
    side = (np.arange(CELLS) + 0.5) * 2 / CELLS - 1
    x, y = (values.ravel() for values in np.meshgrid(side, side))
    distance = np.hypot(x, y)
    inside = np.asarray(shape.holds(x, y)) & (distance <= 1)
    if not inside.any():  # slits between the cells
        return 0.0, 1.0
    radius = float(np.sqrt(inside.sum() / np.pi) * 2 / CELLS)
    points = np.stack([x, y], axis=1)
    beyond = float(np.max(distance[inside] - radius, initial=0.0))
    left_out = points[(distance <= radius) & ~inside]
    return radius, max(beyond, _farthest(left_out, points[inside])) + 1 / CELLS


def coverage(shape: StopShape | StopMask, points: Array) -> Array:
    """Return which share of the surroundings of points (..., 2) lies in a shape: of a square of side `BLURRED`.

    Integrals over the shape by points that far apart then are as smooth as those over the circle.
    """
    side = (np.arange(_FINE_CELLS) + 0.5) * 2 * REACH / _FINE_CELLS - REACH
    x, y = np.meshgrid(side, side)
    share: Array = np.asarray(shape.holds(x, y) & (np.hypot(x, y) <= 1), dtype=np.float64)
    width = round(BLURRED * _FINE_CELLS / (2 * REACH))
    for axis in (0, 1):
        sums = np.insert(np.cumsum(share, axis=axis), 0, 0.0, axis=axis)
        ends, starts = np.arange(width, _FINE_CELLS + 1), np.arange(_FINE_CELLS + 1 - width)
        share = (np.take(sums, ends, axis) - np.take(sums, starts, axis)) / width
    first = -REACH + BLURRED / 2  # middle of the first square
    places = np.clip(np.rint((points - first) * _FINE_CELLS / (2 * REACH)), 0, len(share) - 1).astype(np.intp)
    return np.asarray(share[places[..., 1], places[..., 0]])


def _farthest(points: Array, others: Array) -> float:
    """Return how far any of the points is from the nearest of the others; 0 without points."""
    largest = 0.0
    for low in range(0, len(points), ROWS):
        apart = points[low : low + ROWS, None] - others
        largest = max(largest, float(np.sqrt(np.sum(apart**2, axis=-1).min(axis=1)).max()))
    return largest


# Cheaper cameras in place of a traced lens: polynomials, or what agrees with it to first order.


def fit_polynomials(scene: Scene, *, colours: bool) -> RayMap:
    """Return the polynomials of the lens of a scene.

    Parameters
    ----------
    colours
        Whether the lens refracts each wavelength separately.

    Raises
    ------
    InputError
        When there are none that are good enough.
    """
    camera, setting = scene.camera.traced_camera, lens_setting(scene)
    range_nm = usable_nm(setting.lens) if colours and disperses(setting.lens) else None
    return fitted_map(
        setting.lens, setting, scene.film, range_nm, allowed_px(None if camera is None else camera.accuracy)
    )


Tier = Literal["pinhole", "thin_lens", "thick_lens", "fitted", "realistic"]
TIERS: tuple[Tier, ...] = ("pinhole", "thin_lens", "thick_lens", "fitted", "realistic")  # by rising cost


WITH_SHAPES: frozenset[Tier] = frozenset({"thin_lens", "fitted", "realistic"})  # show stops that are not round
# Bring light of every wavelength to its own place, less what the lens takes of each.
WITH_COLOURS: frozenset[Tier] = frozenset({"fitted", "realistic"})


@dataclass(frozen=True)
class FirstOrderCamera:
    """What a lens in use is to first order.

    Attributes
    ----------
    setting : LensSetting
    thick : ThickLens
    pupil_mm : float
        Distance of the entrance pupil ahead of the film along the axis.
    radius_mm : float
        Radius of the entrance pupil.
    film_mm_per_tangent : float
        How far an image point moves over the film per unit of the tangent of its direction from the entrance pupil.
    plane_mm : float or None
        Distance of the plane in focus ahead of the entrance pupil; None where no object is sharp.
    """

    setting: LensSetting
    thick: ThickLens
    pupil_mm: float
    radius_mm: float
    film_mm_per_tangent: float
    plane_mm: float | None


def first_order_camera(scene: Scene) -> FirstOrderCamera:
    """Describe the lens of a scene's camera to first order.

    Raises
    ------
    InputError
        For a lens that has no cardinal points, or whose entrance pupil is infinitely far away.
    """
    setting = lens_setting(scene)
    wavelength_nm = setting.camera.wavelength_nm
    thick = thick_lens_of(setting.lens, setting.film_distance_mm, wavelength_nm)
    pupil = setting.lens.first_order(wavelength_nm).entrance_pupil
    if not (np.isfinite(pupil.distance_mm) and np.isfinite(pupil.diameter_mm)):
        raise InputError(f"{setting.lens.name}: its entrance pupil is infinitely far away")
    ahead_mm = setting.lens.film_z(setting.film_distance_mm) - pupil.distance_mm
    focus_mm = setting.focus_distance_mm
    plane_mm = None if focus_mm is None else focus_mm - ahead_mm
    return FirstOrderCamera(setting, thick, ahead_mm, pupil.diameter_mm / 2, 1 / abs(thick.slope[0]), plane_mm)


def equivalent(scene: Scene, tier: Tier) -> Scene:
    """Return a scene with the camera of a tier in place of the traced lens.

    Polynomials change nothing but how rays come through the lens. The thick lens keeps every setting, but a stop that
    is not round becomes one of the same area. Pinhole and thin lens stand in the entrance pupil, whose centre is the
    centre of the perspective, and see as much as the film does; the thin lens is as large as the entrance pupil and
    focused on the same plane.

    Raises
    ------
    InputError
        When the lens has no such equivalent; the message says why.
    """
    if tier == "realistic":
        return scene
    scene = on_film(scene)
    camera = scene.camera.traced_camera
    assert camera is not None
    if tier == "fitted":
        fit_polynomials(scene, colours=scene.spectrum.lens_colour == "on")
        return change_scene(scene, camera={"rays": "fitted"})
    if camera.motion:
        raise InputError("camera.motion: a moving camera keeps its traced lens")
    if tier == "thick_lens":
        return with_camera(scene, _thick_lens(scene))
    if tier == "pinhole" and camera.ghosts == "on":
        raise InputError("camera.ghosts: add the light that comes through an opening, and a pinhole has none")
    if camera.movements.turns:
        raise InputError("camera.movements: a film that is turned keeps its lens, whose pupils are apart")
    first = first_order_camera(scene)
    back = camera.world_from_camera()[:3, 2]
    eye = np.array(camera.eye) - back * first.pupil_mm * 1e-3 / scene.metres_per_unit
    half_film_mm = scene.film.size_m()[0] / 2 * 1e3
    keys: dict[str, Any] = {
        "kind": tier,
        "eye": eye.tolist(),
        "target": (eye - back).tolist(),
        "fov_degrees": float(np.rad2deg(2 * np.arctan(half_film_mm / first.film_mm_per_tangent))),
        "fov_axis": "horizontal",
    }
    if tier == "thin_lens":
        if first.plane_mm is None or first.plane_mm <= 0:
            raise InputError(f"{first.setting.lens.name}: no plane of the scene is in focus")
        keys |= {"aperture_radius_m": first.radius_mm * 1e-3, "focus_distance_m": min(first.plane_mm * 1e-3, 1e12)}
    return with_camera(scene, keys_as(camera, keys, without=("view", "lens", "focus", "opening"))[0])


def without_lens(scene: Scene) -> Scene:
    """Return a scene with a pinhole in place of its thin lens, that sees as much."""
    camera, keys = scene.camera, dict[str, Any](kind="pinhole")
    if camera.field_of_view is None:
        focal_mm, focused = camera_of(scene).focal_length_mm(), at_opening(scene).camera.ideal_lens
        assert focal_mm is not None and focused is not None
        image_mm = 1 / (1 / focal_mm - 1 / (focused.plane_m * 1e3))
        keys["fov_degrees"] = math.degrees(2 * math.atan(scene.film.size_m()[0] * 1e3 / 2 / image_mm))
    return with_camera(scene, keys_as(camera, keys)[0])


def _thick_lens(scene: Scene) -> dict[str, Any]:
    """Return the keys of the thick lens in place of a traced one."""
    camera = lens_camera(scene)
    keys, _ = keys_as(camera, {"kind": "thick_lens"})
    shape = stop_shape(scene, camera.outline)
    if shape is not None:
        stop = lens_to_focus(scene, camera).stop
        if stop is None:
            raise InputError("camera.aperture: the lens has no stop to shape")
        keys.pop("f_number", None)
        keys["stop_diameter_mm"] = 2 * stop.semi_diameter * round_stop(shape)[0]
    return keys


#
# Bundles of rays from film points through camera models in float64, in the frame of the traced camera.
#
# That frame has the centre of the film as its origin, x and y of the film as they lie there (inverted), and z along
# the axis towards the scene. Millimetres. A stop that is not round counts as its circle; see `stops` for its shape.

_SPOKES = 64  # directions round a pupil
RINGS = 6  # points along each, at the nodes of Gauss and Legendre
OUTLINE = np.arange(32) * 2 * np.pi / 32  # directions in which the reach of a spot is measured


@dataclass(frozen=True)
class RayBundle:
    """The light that reaches a film point.

    Attributes
    ----------
    origins, directions : (n, 3) arrays
        Where rays leave the camera, and directions with z = 1; not a number for rays that do not.
    weights : (n,) array
        What each brings to the irradiance of the film point in a world of radiance 1, up to a factor of the camera;
        0 for those on the outline.
    """

    origins: Array
    directions: Array
    weights: Array

    @property
    def light(self) -> float:
        """Irradiance in a world of radiance 1, up to a factor of the camera."""
        return float(self.weights.sum())

    def only(self, which: NDArray[np.bool_]) -> RayBundle:
        """Return some of the rays."""
        return RayBundle(self.origins[which], self.directions[which], self.weights[which])

    def places(self, plane_mm: float) -> Array:
        """Return where the rays meet a plane across the axis, (n, 2)."""
        return np.asarray(self.origins[:, :2] + (plane_mm - self.origins[:, 2:]) * self.directions[:, :2])

    def spot(self, plane_mm: float, along: Array) -> tuple[Array, Array, Array]:
        """Where the light of the film point meets a plane across the axis.

        Parameters
        ----------
        along : (2,) array
            Direction of the field, of length 1.

        Returns
        -------
        middle : (2,) array
            The centroid of the spot [mm].
        spread : (3,) array
            Standard deviation along the field, across it, and their root sum of squares [mm].
        outline : array
            How far it reaches from its middle, in the directions of `OUTLINE` [mm].
        """
        places = self.places(plane_mm)
        share = self.weights / self.light
        middle = share @ places
        away = places - middle
        across = np.array([-along[1], along[0]])
        spread = np.sqrt([share @ (away @ axis) ** 2 for axis in (along, across)])
        reach = away @ np.stack([np.cos(OUTLINE), np.sin(OUTLINE)])
        return middle, np.append(spread, np.hypot(*spread)), reach.max(axis=0)


def polar(spokes: int, rings: int) -> tuple[Array, Array]:
    """Return directions (spokes, 2) and, along each, (rings, 2) shares of the radius and their weights.

    The integral of f over a disk of radius 1 is the mean over the directions of the sum of weight * f.
    """
    turn = (np.arange(spokes) + 0.5) * 2 * np.pi / spokes
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    radii = (nodes + 1) / 2
    return np.stack([np.cos(turn), np.sin(turn)], axis=1), np.stack([radii, np.pi * weights * radii], axis=1)


def _disk() -> tuple[Array, Array]:
    """Return points (n, 2) of the unit disk and their shares of its area; its edge weighs nothing."""
    turns, radial = polar(_SPOKES, RINGS)
    inside = (turns[:, None] * radial[:, 0, None]).reshape(-1, 2)
    area = np.tile(radial[:, 1] / _SPOKES, _SPOKES)
    return np.concatenate([inside, turns]), np.concatenate([area, np.zeros(_SPOKES)])


def tier_bundle(first: FirstOrderCamera, tier: Tier, point: Array) -> RayBundle:
    """Return the rays of thick lens, thin lens or pinhole for a film point (2,)."""
    disk, area = _disk()
    if tier == "thick_lens":
        thick, lens_mm = first.thick, first.setting.lens.film_z(first.setting.film_distance_mm)
        height = thick.height[0] * point + thick.height[1] * disk
        slope = thick.slope[0] * point + thick.slope[1] * disk
        film_slope = thick.film_slope[0] * point + thick.film_slope[1] * disk
        weights = area / (1 + np.sum(film_slope**2, axis=1)) ** 2
        origins = np.column_stack([height, np.full(len(disk), lens_mm)])
        return RayBundle(origins, np.column_stack([slope, np.ones(len(disk))]), weights)
    if tier == "pinhole":
        disk, area = np.zeros((1, 2)), np.ones(1)
    chief = np.sign(first.thick.slope[0]) * point / first.film_mm_per_tangent
    start = first.radius_mm * disk
    plane = first.plane_mm if first.plane_mm is not None else np.inf
    slope = chief - start / plane
    origins = np.column_stack([start, np.full(len(disk), first.pupil_mm)])
    return RayBundle(origins, np.column_stack([slope, np.ones(len(disk))]), area)


# Pupils of a lens as film points see them, to their very edge, and points that are spread over them.

FARTHEST = 1.5  # from the middle of a pupil's box, in its half sides: the corners lie within
_SCAN = 12  # points along a direction
BISECTIONS = 14


@dataclass(frozen=True)
class Pupils:
    """Outlines on the plane of the last vertex.

    Attributes
    ----------
    film : (m, 2) array
        The film points that see them [mm].
    centres, axes : (m, 2) arrays
        Middles and half sides of their boxes [mm].
    radii : (m, SPOKES) array
        How far they reach in the directions of `bundles.polar`, in units of the half sides; 0 where nothing passes.
    """

    film: Array
    centres: Array
    axes: Array
    radii: Array

    @classmethod
    def of(cls, lens: Lens, film_distance_mm: float, film: Array, wavelength_nm: float) -> Pupils:
        """Return the pupils that film points (m, 2) see."""
        probes = narrowing_probes(lens, film_distance_mm, wavelength_nm)
        boxes, lit = pupil_boxes(probes, film, FINE)
        centres, axes = (boxes[:, 1::2] + boxes[:, ::2]) / 2, (boxes[:, 1::2] - boxes[:, ::2]) / 2
        radii = np.zeros((len(film), _SPOKES))
        radii[lit] = _edges(probes[-1], film[lit], centres[lit], axes[lit])
        return cls(film, centres, axes, radii)

    def nodes(self, rings: int) -> tuple[Array, Array]:
        """Return points (m, n, 2) of the pupils and the area that each stands for; those of the edge stand for none."""
        turns, radial = polar(_SPOKES, rings)
        frame = self.axes[:, None] * turns * self.radii[..., None]
        inside = self.centres[:, None, None] + frame[:, :, None] * radial[:, 0, None]
        area = np.prod(self.axes, axis=1)[:, None, None] * self.radii[..., None] ** 2 * radial[:, 1] / _SPOKES
        count = len(self.film)
        points = np.concatenate([inside.reshape(count, -1, 2), self.centres[:, None] + frame], axis=1)
        return points, np.concatenate([area.reshape(count, -1), np.zeros((count, _SPOKES))], axis=1)


def _edges(probe: FilmProbe, film: Array, centres: Array, axes: Array) -> Array:
    """Return how far from the middles of their boxes pupils reach: the farthest point that passes, by bisection."""
    turns, _ = polar(_SPOKES, 1)
    frame = axes[:, None] * turns

    def passing(rho: Array) -> NDArray[np.bool_]:
        return probe.passes(film[:, None], centres[:, None] + frame * rho[..., None])

    step = FARTHEST / _SCAN
    tries = np.arange(_SCAN, 0, -1) * step
    hits = probe.passes(film[:, None, None], centres[:, None, None] + frame[:, :, None] * tries[:, None])
    low = np.where(hits.any(axis=2), tries[np.argmax(hits, axis=2)], 0.0)
    high = low + step
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        inside = passing(middle)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low


# How far away what a picture can show is: bounds from the boxes of objects in view, without rendering.

_MOST_CUT = 200  # triangles that are cut to the view; of more, which then are small, all corners count


@dataclass(frozen=True)
class VisibleWorld:
    """What a camera may see: a pyramid about its axis, cut off where it starts.

    Attributes
    ----------
    start_mm : float
        Distance ahead of the camera's eye where it starts.
    half_film_mm : (2,) array
        Half its width and height there.
    slopes : (2,) array
        What they grow by per distance.
    """

    start_mm: float
    half_film_mm: Array
    slopes: Array

    def sides(self) -> tuple[Array, Array]:
        """Return normals (5, 3) and offsets (5,): points p of the camera's frame with n p + c >= 0 lie within."""
        normals, offsets = [(0.0, 0.0, 1.0)], [-self.start_mm]
        for axis in (0, 1):
            for sign in (1.0, -1.0):
                normals.append((sign * (axis == 0), sign * (axis == 1), float(self.slopes[axis])))
                offsets.append(float(self.half_film_mm[axis] - self.slopes[axis] * self.start_mm))
        return np.array(normals), np.array(offsets)

    def corners(self) -> tuple[Array, Array]:
        """Return where its edges and its axis start (5, 3), and their directions."""
        signs = np.array([(0, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)], dtype=np.float64)
        starts = np.column_stack([signs * self.half_film_mm, np.full(5, self.start_mm)])
        return starts, np.column_stack([signs * self.slopes, np.ones(5)])


def _clip_polygon(polygon: Array, view: VisibleWorld) -> Array:
    """Return the part of a polygon (n, 3) that lies in the view."""
    for normal, offset in zip(*view.sides(), strict=True):
        if len(polygon):
            polygon = cut_polygon(polygon, polygon @ normal + offset)
    return polygon


def _triangle_depths(triangles: Array, view: VisibleWorld) -> list[float]:
    """Return the ends of the distances at which a view shows triangles (n, 3, 3); nothing where it does not."""
    normals, offsets = view.sides()
    inside = triangles @ normals.T + offsets >= 0
    whole = np.all(inside, axis=(1, 2))
    cut = triangles[np.all(np.any(inside, axis=1), axis=1) & ~whole]  # the others lie wholly beyond one side
    pieces = [_clip_polygon(triangle, view) for triangle in cut] if len(cut) <= _MOST_CUT else [cut.reshape(-1, 3)]
    seen = np.concatenate([triangles[whole].reshape(-1, 3), *pieces])
    return [float(seen[:, 2].min()), float(seen[:, 2].max())] if len(seen) else []


_MOMENTS = 9  # at which objects that move are looked at
FEW = 32  # places of an object that are all cut
FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))  # of a box's corners


def depth_range_mm(scene: Scene, view: VisibleWorld) -> tuple[float, float]:
    """Return the least and largest distance ahead of the camera's eye, along its axis, of what it may see [mm].

    Of objects, the parts of their boxes within the view count. Where nothing bounds the view, as under a sky, the far
    end is `FAR_MM`; so it is where something in view reflects or refracts, whose images lie farther back than itself.
    """
    all_depths = [FAR_MM] if scene.environment is not None else []
    from_world = np.linalg.inv(scene.camera.world_from_camera() * _columns(scene))
    from_world[2] *= -1.0  # z ahead
    for item, solid in zip(scene.objects, scene.solids(), strict=True):
        places = from_world @ _places_over_time(scene, item)
        if isinstance(item, Plane):
            seen = [depth for placed in places for depth in _plane_depths(item, placed, view)]
        else:
            assert not isinstance(solid, Plane)
            few = len(places) <= FEW
            seen = [d for placed in places for d in _depths(solid, placed, view)] if few else _ends(solid, places, view)
        all_depths += seen
        if seen and any(map(_shows_images, solid.shown_materials())):
            all_depths.append(FAR_MM)
    depths = np.clip(all_depths or [FAR_MM], view.start_mm, FAR_MM)
    return float(depths.min()), float(depths.max())


def _shows_images(material: Material) -> bool:
    """Return whether a surface may show more than itself: all but matte ones and lamps."""
    if isinstance(material, Mix):
        return any(map(_shows_images, material.materials))
    return not isinstance(material, Matte | Translucent | Emissive)


def _columns(scene: Scene) -> Array:
    """Factors (4,) that make the lengths of a camera's frame millimetres of the scene's units."""
    per_mm = 1e-3 / scene.metres_per_unit
    return np.array([per_mm, per_mm, per_mm, 1.0])


def _places_over_time(scene: Scene, item: Object) -> Array:
    """Return the places of an object while the shutter is open (n, 4, 4)."""
    open_s = scene.shutter.open_s
    times = [open_s] if item.trajectory is None else np.linspace(open_s, open_s + scene.shutter.time_s, _MOMENTS)
    return np.concatenate([item.places(scene.folders, float(time_s)) for time_s in times])


def _ends(item: Solid, places: Array, view: VisibleWorld) -> list[float]:
    """Return the ends of the distances of many places, of which those are cut that may be the first and the last."""
    corners = np.array(list(product(*zip(*item.bounds(), strict=True))))
    depths = corners @ np.swapaxes(places[:, 2:3, :3], 1, 2) + places[:, None, 2:3, 3]
    nearest, farthest = depths.min(axis=(1, 2)), depths.max(axis=(1, 2))
    low, high = np.inf, -np.inf
    for index in nearest.argsort():
        if nearest[index] >= low:
            break
        low = min([low, *_depths(item, places[index], view)])
    for index in (-farthest).argsort():
        if farthest[index] <= high:
            break
        high = max([high, *_depths(item, places[index], view)])
    return [low, high] if low < np.inf else []


def _depths(item: Solid, placed: Array, view: VisibleWorld) -> list[float]:
    """Return the ends of the distances at which the view cuts an object, nothing where it does not."""
    if isinstance(item, Rectangle):
        corner, u, v = (np.array(edge) for edge in (item.corner, item.edge_u, item.edge_v))
        return _faces([_transform(np.array([corner, corner + u, corner + u + v, corner + v]), placed)], view)
    if isinstance(item, LoadedMesh):
        return [depth for part in item.contents.parts for depth in _part_depths(part, placed, view)]
    box = _transform(np.array(list(product(*zip(*item.bounds(), strict=True)))), placed)
    around = not isinstance(item, Box) and _holds_start(box, view)
    return _box_faces(box, view) + [view.start_mm] * around


def _part_depths(part: MeshPlacement, placed: Array, view: VisibleWorld) -> list[float]:
    """Return the same for a part of a mesh: by its box, or by its triangles where the view starts within."""
    box = _transform(part.corners(), placed)
    if not _holds_start(box, view):
        return _box_faces(box, view)
    vertices = _transform(part.mesh.positions + part.mesh.origin, placed @ part.placement)
    return _triangle_depths(vertices[part.mesh.faces], view)


def _box_faces(box: Array, view: VisibleWorld) -> list[float]:
    return _faces([box[list(face)] for face in FACES], view)


def _faces(faces: list[Array], view: VisibleWorld) -> list[float]:
    return [depth for face in faces for depth in _clip_polygon(face, view)[:, 2].tolist()]


def _holds_start(box: Array, view: VisibleWorld) -> bool:
    """Return whether a box of eight corners holds a corner or the middle of where the view starts."""
    edges = box[[4, 2, 1]] - box[0]
    if not np.all(np.any(edges, axis=1)):
        return False  # flat
    shares = (view.corners()[0] - box[0]) @ np.linalg.inv(edges)
    return bool(np.any(np.all((shares >= 0) & (shares <= 1), axis=1)))


def _transform(points: Array, matrix: Array) -> Array:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _plane_depths(item: Plane, placed: Array, view: VisibleWorld) -> list[float]:
    """Return the distances at which the edges of the view and its axis meet a plane; the far end beyond the horizon."""
    normal = np.linalg.inv(placed[:3, :3]).T @ np.array(item.normal)
    starts, directions = view.corners()
    height = (_transform(np.array([item.point]), placed) - starts) @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = height / (directions @ normal)
    seen = steps > 0
    ends: list[float] = (view.start_mm + steps[seen]).tolist()
    return ends + ([] if seen.all() or not seen.any() else [FAR_MM])
