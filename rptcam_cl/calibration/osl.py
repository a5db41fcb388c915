"""A camera for Cycles: an OSL shader for its custom camera, which traces every ray through the surfaces of the lens.

The shader takes points of the film to points of a disk on the plane of the exit pupil (of the last vertex, where the
pupil is no help) and on through the lens, as `optics.trace` does: spheres and conics by their roots, refraction by
Snell's law, one wavelength. It is float32, as Cycles is. The disk holds all light that comes through anywhere on the
film, as traced in float64 here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.calibration.view import View
from rptcam_cl.cameras import LensSetting
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens, Surface, passing
from rptcam_cl.scene import CircularAperture, RealisticCamera

Array = NDArray[np.float64]

FIELDS = 5  # places across and down the picture from which the pupil is seen
STEPS = 48  # points across the last surface that rays from each are aimed at

FAR_MM = 1e4  # from where on a pupil ahead of the film is as good as infinitely far
AXIS_RAYS = (1024, 64)  # outwards and round the disk, by which the light in the middle of the film is found

PROGRAM = """\
// {about}
// A custom camera for Cycles (Open Shading Language). The camera of the scene stands in the middle of the film.
// Millimetres inside; x right, y up, z ahead of the film's middle.

#define COUNT {count}

shader camera(
    float metres_per_unit = 1.0,
    output point position = 0.0,
    output vector direction = vector(0.0, 0.0, 1.0),
    output color throughput = 0.0)
{{
  // Surfaces from film to scene: vertex, curvature, 1 + conic constant, squared clear radius, index before / after
  float vertex[COUNT] = {{{vertex}}};
  float curvature[COUNT] = {{{curvature}}};
  float shape[COUNT] = {{{shape}}};
  float clear[COUNT] = {{{clear}}};
  float ratio[COUNT] = {{{ratio}}};

  point share = camera_shader_raster_position();
  vector chance = camera_shader_random_sample();
  point p = point({corner}) + share[0] * vector({across}) + share[1] * vector({up});
  float radius = {radius} * sqrt(chance[0]);
  float azimuth = {turn} * chance[1];
  vector away = point(radius * cos(azimuth), radius * sin(azimuth), {disk}) - p;
  float square = dot(away, away);
  vector d = away / sqrt(square);
  // The disk's share of the light, such that the middle of the film has 1.
  float weight = {scale} * abs(d[2] * dot(d, vector({normal}))) / square;

  for (int k = 0; k < COUNT; k++) {{
    // Scene is towards +z here, so that a surface's curvature is that of the prescription with its sign turned.
    float to_plane = (vertex[k] - p[2]) / d[2];
    float x = p[0] + to_plane * d[0];
    float y = p[1] + to_plane * d[1];
    float c = curvature[k];
    float f = c * (x * x + y * y);
    float g = d[2] - c * (d[0] * x + d[1] * y);
    float a = c * (d[0] * d[0] + d[1] * d[1] + shape[k] * d[2] * d[2]);
    float discriminant = g * g - a * f;
    if (discriminant < 0.0)
      return;
    float root = sqrt(discriminant);
    float step = f / (g + root);
    float z = step * d[2];
    x += step * d[0];
    y += step * d[1];
    vector facing = vector(-c * x, -c * y, 1.0 - c * shape[k] * z);
    if (facing[2] <= 0.0 || x * x + y * y > clear[k])
      return;
    float size = length(facing);
    facing /= size;
    float cosine = root / size;
    float bent = 1.0 - ratio[k] * ratio[k] * (1.0 - cosine * cosine);
    if (bent < 0.0)
      return;
    d = normalize(ratio[k] * d + (sqrt(bent) - ratio[k] * cosine) * facing);
    if (d[2] <= 0.0)
      return;
    p = point(x, y, vertex[k] + z);
  }}
  position = p * 0.001 / metres_per_unit;
  direction = d;
  throughput = weight;
}}
"""


@dataclass(frozen=True)
class _Disk:
    """Where rays are aimed: z in the frame of the lens, and a radius [mm]."""

    z: float
    radius: float


def osl_text(view: View) -> str:
    """Return the shader of a scene's camera.

    Raises
    ------
    InputError
        For a camera without surfaces, or a lens that is not all of round spheres and conics about one axis.
    """
    setting = view.setting
    if setting is None or not isinstance(view.scene.camera, RealisticCamera):
        raise InputError("--osl: needs a camera of kind realistic, whose lens is traced (others fit into --usd)")
    _check(setting.lens)
    if not isinstance(view.scene.camera.aperture, CircularAperture):
        raise InputError(f"--osl: {setting.lens.name}: camera.aperture is not round (allowed: circle)")
    lens, wavelength = setting.lens, setting.camera.wavelength_nm
    film_z = lens.film_z(setting.film_distance_mm)
    width, height = view.size
    corners = view.film_points(np.array([[0.0, height], [width, height], [0.0, 0.0]]))
    corners[:, 2] += film_z
    corner, across, up = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    normal = np.cross(across, up)
    normal /= np.linalg.norm(normal)
    disk = _disk(view, setting)
    middle = corner + (across + up) / 2
    indices = lens.indices(wavelength)
    rows = range(len(lens.surfaces) - 1, -1, -1)
    surfaces = [lens.surfaces[k] for k in rows]
    return PROGRAM.format(
        about=f"{view.name}, film {setting.film_distance_mm:.6g} mm behind it, {wavelength:g} nm",
        count=len(surfaces),
        vertex=_listed(film_z - float(lens.vertices[k]) for k in rows),
        curvature=_listed(-surface.curvature for surface in surfaces),
        shape=_listed(1.0 + surface.conic for surface in surfaces),
        clear=_listed(min(surface.semi_diameter, 1e6) ** 2 for surface in surfaces),
        ratio=_listed(float(indices[k + 1] / indices[k]) for k in rows),
        corner=_turned(corner, film_z),
        across=_turned(across),
        up=_turned(up),
        normal=_turned(normal),
        radius=repr(disk.radius),
        turn=repr(2 * math.pi),
        disk=repr(float(film_z - disk.z)),
        scale=repr(1.0 / _on_axis(lens, middle, normal, disk, wavelength)),
    )


def _check(lens: Lens) -> None:
    """Refuse what the shader cannot trace."""
    for k, surface in enumerate(lens.surfaces):
        if fault := _fault(surface):
            raise InputError(
                f"--osl: {lens.name}: surface {k} {fault}"
                " (allowed: spheres, conics and planes about one axis, with round openings)"
            )


def _fault(surface: Surface) -> str:
    if surface.is_mirror:
        return "is a mirror"
    if surface.aspheric or not surface.is_rotational:
        return "is no sphere or conic about the axis"
    return "has an opening that is not round" if surface.stop_shape or surface.inner_semi_diameter else ""


def _disk(view: View, setting: LensSetting) -> _Disk:
    """Return a disk on the plane of the exit pupil that all light to the picture passes, by rays in float64."""
    lens = setting.lens
    film_z, last = lens.film_z(setting.film_distance_mm), lens.length
    pupil_z = last + lens.first_order(setting.camera.wavelength_nm).exit_pupil.distance_mm
    plane = pupil_z if setting.film_distance_mm / 2 < film_z - pupil_z < FAR_MM else last
    film = view.film_points(view.grid(FIELDS, FIELDS))
    film[:, 2] += film_z
    rear = lens.surfaces[-1].semi_diameter
    line = np.linspace(-rear, rear, STEPS)
    x, y = (values.ravel() for values in np.meshgrid(line, line))
    origins = np.repeat(film, x.size, axis=0)
    targets = np.tile(np.column_stack([x, y, np.full(x.size, last)]), (len(film), 1))
    through = passing(lens, origins, targets - origins, setting.camera.wavelength_nm)
    if not through.any():
        raise InputError(f"--osl: {lens.name}: no light comes through to the film")
    step = float(line[1] - line[0]) * math.sqrt(2)
    origins, targets = origins[through], targets[through]
    on_plane = origins + (targets - origins) * ((plane - origins[:, 2:]) / (last - origins[:, 2:]))
    margin = step * float(np.max(np.abs((plane - origins[:, 2]) / (last - origins[:, 2]))))
    return _Disk(float(plane), float(np.max(np.hypot(*on_plane[:, :2].T)) + margin))


def _on_axis(lens: Lens, middle: Array, normal: Array, disk: _Disk, wavelength_nm: float) -> float:
    """Return the mean over the disk of what the middle of the film gets, before it is scaled to 1 [1/mm^2]."""
    shares, turns = ((np.arange(count) + 0.5) / count for count in AXIS_RAYS)
    radius, azimuth = (part.ravel() for part in np.meshgrid(disk.radius * np.sqrt(shares), 2 * math.pi * turns))
    targets = np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(radius.size, disk.z)])
    away = targets - middle
    square = np.sum(away * away, axis=1)
    lit = passing(lens, np.tile(middle, (len(away), 1)), away, wavelength_nm)
    directions = away / np.sqrt(square)[:, None]
    weights = np.where(lit, np.abs(directions[:, 2] * (directions @ normal)) / square, 0.0)
    if not weights.any():
        raise InputError(f"--osl: {lens.name}: no light comes to the middle of the picture")
    return float(np.mean(weights))


def _turned(vector: Array, film_z: float = 0.0) -> str:
    """Return a vector of the frame of the lens, whose z runs to the film, with z towards the scene."""
    x, y, z = np.asarray(vector, np.float64).tolist()
    return f"{x!r}, {y!r}, {float(film_z) - z!r}"


def _listed(values: Iterable[float]) -> str:
    return ", ".join(repr(float(value)) for value in values)
