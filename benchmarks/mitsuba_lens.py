"""A camera with a lens of spheres and planes for Mitsuba 3, as a sensor in Dr.Jit, whose rays are traced from the film.

`prescription` says all that it needs, as plain data; `register` adds the sensor ``spheres_lens`` to Mitsuba. A camera
ray aims at the circle, in the plane of the exit pupil, round what the lens lets pass from its distance to the axis.
"""

from __future__ import annotations

import json
from typing import Any

DISTANCES = 32  # from the axis that circles are found for
RAYS_ACROSS = 181  # of the grid that finds a circle


def prescription(scene: Any) -> dict[str, Any]:
    """Return the lens of a scene's camera, its film and the circles to aim at [mm], scene side first."""
    import numpy as np

    from rptcam_cl.rendering.traceable_lens import load_lens

    camera, lens = scene.camera, load_lens(scene.camera.lens)
    distance = camera.focus.film_distance_mm
    film_z = sum(surface.thickness for surface in lens.surfaces) + distance
    pupil = lens.first_order(camera.wavelength_nm).exit_pupil
    pupil_z = film_z - distance + pupil.distance_mm
    half = 0.8 * pupil.diameter_mm
    step = 2 * half / (RAYS_ACROSS - 1)
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-half, half, RAYS_ACROSS)] * 2))
    most = 0.5 * float(np.hypot(*scene.film.size_mm)) * 1.001
    circles, on_axis = [], 0.0
    for radius in np.linspace(0.0, most, DISTANCES):
        ways = np.stack([x - radius, y, np.full_like(x, pupil_z - film_z)], axis=1)
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        passed = lens.trace(np.tile([radius, 0.0, film_z], (len(ways), 1)), ways, camera.wavelength_nm).passed
        on_axis = on_axis or float((ways[passed, 2] ** 4).sum()) * step**2
        centres = np.linspace(x[passed].min(), x[passed].max(), 61)
        reach = [np.hypot(x[passed] - centre, y[passed]).max() for centre in centres]
        circles.append((float(centres[np.argmin(reach)]), float(np.min(reach) + 0.7 * step)))
    indices = [float(surface.glass.index(camera.wavelength_nm)) for surface in lens.surfaces]
    return {
        "surfaces": [
            (s.curvature, s.thickness, index, s.semi_diameter) for s, index in zip(lens.surfaces, indices, strict=True)
        ],
        "film_mm": scene.film.size_mm,
        "film_distance": distance,
        "pupil_height": -pupil.distance_mm,  # above the last vertex, towards the scene
        "most": most,
        "circles": circles,
        "gain": float(np.pi) / on_axis,  # a uniform world gives 1 on the axis
    }


def _through(mi: Any, surfaces: list[list[float]], p: Any, d: Any, active: Any) -> tuple[Any, Any, Any]:
    """Return point, direction and whether it passes of a ray from the film; +z leads to the scene."""
    import drjit as dr

    z, passed = 0.0, mi.Mask(active)
    for i in reversed(range(len(surfaces))):
        c, _, behind, semi = surfaces[i]
        before, thickness = (surfaces[i - 1][2], surfaces[i - 1][1]) if i else (1.0, 0.0)
        p = p + d * ((z - p.z) / d.z)
        height = c * (p.x * p.x + p.y * p.y)
        slope = d.z + c * (p.x * d.x + p.y * d.y)
        square = slope * slope - c * height
        passed &= square >= 0
        cosine = dr.sqrt(dr.maximum(square, 0))
        p = p - d * (height / (slope + cosine))
        passed &= p.x * p.x + p.y * p.y <= semi * semi
        if behind != before:
            ratio = behind / before
            square = 1 - ratio * ratio * (1 - cosine * cosine)
            passed &= square > 0
            normal = mi.Vector3f(c * p.x, c * p.y, 1 + c * (p.z - z))
            d = d * ratio + normal * (dr.sqrt(dr.maximum(square, 0)) - ratio * cosine)
        z += thickness
    return p, d, passed


def register(mi: Any) -> None:
    """Add the sensor to Mitsuba, whose variant is chosen."""
    import drjit as dr

    class SpheresLens(mi.Sensor):  # type: ignore[misc]
        """Its property ``prescription`` is what `prescription` returned."""

        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.m_needs_sample_3 = True
            self.lens = json.loads(properties["prescription"])
            self.centres, self.radii = (mi.Float(list(column)) for column in zip(*self.lens["circles"], strict=True))

        def _aim(self, x: Any, y: Any, sample: Any) -> tuple[Any, Any]:
            """Return a point of the circle that belongs to a film point, and the circle's radius."""
            r = dr.sqrt(x * x + y * y)
            cell = r * ((DISTANCES - 1) / self.lens["most"])
            low = dr.minimum(mi.UInt32(cell), DISTANCES - 2)
            centre, radius = (
                dr.lerp(dr.gather(mi.Float, of, low), dr.gather(mi.Float, of, low + 1), cell - mi.Float(low))
                for of in (self.centres, self.radii)
            )
            disk = mi.warp.square_to_uniform_disk_concentric(sample) * radius
            a, b = disk.x + centre, disk.y
            along, across = dr.select(r > 0, x / r, 1.0), dr.select(r > 0, y / r, 0.0)
            return mi.Point3f(a * along - b * across, a * across + b * along, self.lens["pupil_height"]), radius

        def sample_ray(
            self, time: Any, _wave: Any, position: Any, aperture: Any, active: Any = True
        ) -> tuple[Any, Any]:
            """Return a ray into the world, where the middle of the film is the sensor's origin, and its weight."""
            width, height = self.lens["film_mm"]
            x, y, distance = (position.x - 0.5) * width, (position.y - 0.5) * height, self.lens["film_distance"]
            film = mi.Point3f(x, y, -distance)
            aim, radius = self._aim(x, y, aperture)
            d = dr.normalize(mi.Vector3f(aim - film))
            weight = self.lens["gain"] * (d.z * d.z * radius) ** 2
            p, out, passed = _through(mi, self.lens["surfaces"], film, d, active)
            world = self.world_transform()
            ray = mi.Ray3f(world @ mi.Point3f((p - mi.Vector3f(0, 0, -distance)) * 1e-3), dr.normalize(world @ out))
            ray.time = time
            return ray, mi.Color3f(dr.select(passed, weight, 0.0))

        def sample_ray_differential(
            self, time: Any, wave: Any, position: Any, aperture: Any, active: Any = True
        ) -> tuple[Any, Any]:
            """Return the same without differentials."""
            ray, weight = self.sample_ray(time, wave, position, aperture, active)
            return mi.RayDifferential3f(ray), weight

    mi.register_sensor("spheres_lens", SpheresLens)
