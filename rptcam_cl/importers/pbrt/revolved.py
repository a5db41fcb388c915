"""Surfaces of revolution as meshes: parts of spheres, disks and cylinders, and the shapes that only pbrt-v3 has."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.mesh import MeshData
from rptcam_cl.importers.pbrt.parameters import Parameters

Array = NDArray[np.float64]

AROUND, ALONG = 128, 64  # quadrilaterals of a full turn and of a curved profile


@dataclass(frozen=True, eq=False)
class Profile:
    """The curve that turns about the z axis.

    Attributes
    ----------
    points, tangents : (n, 3) arrays
        From v = 0 to v = 1.
    full : bool
        Whether a turn of 360 degrees makes the whole shape, which our own one then is.
    area : float
        Of the surface of a full turn.
    """

    points: Array
    tangents: Array
    full: bool
    area: float


def sphere(parameters: Parameters) -> Profile:
    """Return the profile of a sphere between zmin and zmax."""
    radius = positive(parameters, "radius", 1.0)
    low = np.clip(parameters.number("zmin", -radius) / radius, -1, 1)
    high = np.clip(parameters.number("zmax", radius) / radius, -1, 1)
    low, high = min(low, high), max(low, high)
    angle = np.linspace(math.acos(low), math.acos(high), ALONG + 1)
    zero = np.zeros_like(angle)
    points = radius * np.stack([np.sin(angle), zero, np.cos(angle)], axis=1)
    tangents = np.stack([-np.cos(angle), zero, np.sin(angle)], axis=1)
    return Profile(points, tangents, low == -1 and high == 1, 2 * math.pi * radius**2 * (high - low))


def disk(parameters: Parameters) -> Profile:
    """Return the profile of a disk, from the rim to the hole."""
    height, radius = parameters.number("height", 0.0), positive(parameters, "radius", 1.0)
    inner = min(parameters.number("innerradius", 0.0), radius)
    area = math.pi * (radius**2 - inner**2)
    return _segment((radius, 0, height), (inner, 0, height), inner == 0, area)


def cylinder(parameters: Parameters) -> Profile:
    """Return the profile of a cylinder without caps."""
    radius = positive(parameters, "radius", 1.0)
    low, high = parameters.number("zmin", -1.0), parameters.number("zmax", 1.0)
    low, high = min(low, high), max(low, high)
    return _segment((radius, 0, low), (radius, 0, high), True, 2 * math.pi * radius * (high - low))


def cone(parameters: Parameters) -> Profile:
    """Return the profile of a cone without a cap."""
    radius, height = positive(parameters, "radius", 1.0), positive(parameters, "height", 1.0)
    return _segment((radius, 0, 0), (0, 0, height), True, math.pi * radius * math.hypot(radius, height))


def paraboloid(parameters: Parameters) -> Profile:
    """Return the profile z = zmax (r / radius)^2 between zmin and zmax."""
    radius, top = positive(parameters, "radius", 1.0), positive(parameters, "zmax", 1.0)
    bottom = max(parameters.number("zmin", 0.0), 0.0)
    heights = top * np.linspace(math.sqrt(bottom / top), 1, ALONG + 1) ** 2  # denser where it curves most
    radii = radius * np.sqrt(heights / top)
    points = np.stack([radii, np.zeros_like(radii), heights], axis=1)
    tangents = np.stack([np.ones_like(radii), np.zeros_like(radii), 2 * top * radii / radius**2], axis=1)
    return Profile(points, tangents, False, 0.0)


def hyperboloid(parameters: Parameters) -> Profile:
    """Return the segment from p1 to p2."""
    return _segment(parameters.vector("p1", (0, 0, 0)), parameters.vector("p2", (1, 1, 1)), False, 0.0, steps=ALONG)


PROFILES = {
    "sphere": sphere, "disk": disk, "cylinder": cylinder, "cone": cone, "paraboloid": paraboloid,
    "hyperboloid": hyperboloid,
}  # fmt: skip


def positive(parameters: Parameters, name: str, default: float) -> float:
    """Return a number above 0."""
    value = parameters.number(name, default)
    if not value > 0:
        raise parameters.items[name].place.error(f'{parameters.what}: "{name}" must be above 0 (got {value:g})')
    return value


def turned(profile: Profile, degrees: float) -> MeshData:
    """Return the mesh that a profile sweeps from +x over +y; its front is that of pbrt: along du x dv.

    u and v of the mesh run from 0 to 1 along the turn and along the profile. Of a profile without extent there are no
    faces.
    """
    around, along = max(3, round(AROUND * degrees / 360)), len(profile.points)
    angles = np.radians(np.linspace(0, degrees, around + 1))
    cos, sin, zero, one = np.cos(angles), np.sin(angles), np.zeros_like(angles), np.ones_like(angles)
    turns = np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]])
    vertices = np.einsum("ijk,nj->kni", turns, profile.points).reshape(-1, 3)
    normals = np.einsum("ijk,nj->kni", turns, _profile_normals(profile)).reshape(-1, 3)
    u, v = np.meshgrid(np.linspace(0, 1, around + 1), np.linspace(0, 1, along), indexing="ij")
    k, n = np.meshgrid(np.arange(around), np.arange(along - 1), indexing="ij")
    corner = (k * along + n).reshape(-1)
    right, up, far = corner + along, corner + 1, corner + along + 1
    faces = np.concatenate([np.stack([corner, right, far], axis=1), np.stack([corner, far, up], axis=1)])
    mesh = MeshData(vertices, faces, normals, np.stack([u, v], axis=-1).reshape(-1, 2))
    areas = mesh.areas()
    return MeshData(vertices, faces[areas > 1e-12 * areas.max()], normals, mesh.uvs)


def _profile_normals(profile: Profile) -> Array:
    x, y, _ = profile.points.T
    radii = np.hypot(x, y)
    safe = np.where(radii > 0, radii, 1)
    azimuth = np.stack([np.where(radii > 0, -y / safe, 0), np.where(radii > 0, x / safe, 1), np.zeros_like(x)], axis=1)
    normals = np.cross(azimuth, profile.tangents)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(lengths > 0, lengths, 1))


def _segment(start: object, end: object, full: bool, area: float, steps: int = 1) -> Profile:
    first, last = np.asarray(start, np.float64), np.asarray(end, np.float64)
    points = first + np.linspace(0, 1, steps + 1)[:, None] * (last - first)
    return Profile(points, np.broadcast_to(last - first, points.shape), full, area)
