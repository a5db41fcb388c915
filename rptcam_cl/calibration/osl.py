"""A camera for Cycles: an OSL shader for its custom camera, which traces every ray through the surfaces of the lens.

The shader takes points of the film to points of a disk on the plane of the exit pupil (of the last vertex, where the
pupil is no help) and on through the lens, as `optics.trace` does: spheres and conics by their roots, aspheres by
Newton's iteration from there, refraction by Snell's law, one wavelength. It is float32, as Cycles is. The disk holds
all light that comes through anywhere on the film, as traced in float64 here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.calibration.view import View
from rptcam_cl.cameras import LensSetting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import Lens, Surface, passing
from rptcam_cl.scene import CircularAperture, RealisticCamera

Array = NDArray[np.float64]

FIELDS = 5  # places across and down the picture from which the pupil is seen
STEPS = 48  # points across the last surface, and across the pupil, that rays from each are aimed at
NARROWED = 3  # times that the pupil is narrowed down

FAR_MM = 1e4  # from where on a pupil ahead of the film is as good as infinitely far
ROUNDS = 12  # of Newton's iteration, which needs three to five
SMALL = 4e-7  # last step of it, over the size of the place: a few roundings in float32
AXIS_RAYS = (1024, 64)  # outwards and round the disk, by which the light in the middle of the film is found

PROGRAM = """\
// {about}
// A custom camera for Cycles (Open Shading Language). The camera of the scene stands in the middle of the film.
// Millimetres inside; x right, y up, z ahead of the film's middle.

#define COUNT {count}
// Coefficients of the polynomials of aspheres, of r^0, r^1, ...; 0 without any
#define TERMS {terms}
#define COEFFICIENTS {size}

#if TERMS
// A polynomial's value and its derivative by s = r^2
void polynomial(float a[COEFFICIENTS], int k, float s, output float value, output float slope)
{{
  float r = sqrt(s);
  value = 0.0;
  float by_r = 0.0;
  for (int i = TERMS - 1; i >= 0; i--) {{
    by_r = by_r * r + value;
    value = value * r + a[k * TERMS + i];
  }}
  slope = r > 0.0 ? by_r / (2.0 * r) : a[k * TERMS + 2];
}}
#endif

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
  // 1, or 0 for the axis along which a cylinder is straight
  float across_x[COUNT] = {{{across_x}}};
  float across_y[COUNT] = {{{across_y}}};
#if TERMS
  int aspheric[COUNT] = {{{aspheric}}};
  float a[COEFFICIENTS] = {{{coefficients}}};
#endif

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
    float wx = across_x[k];
    float wy = across_y[k];
    float bump = 0.0;
    float slope = 0.0;
#if TERMS
    if (aspheric[k])
      polynomial(a, k, wx * x * x + wy * y * y, bump, slope);
#endif
    // The conic, moved by the polynomial
    float f = c * (wx * x * x + wy * y * y + shape[k] * bump * bump) + 2.0 * bump;
    float g = d[2] - c * (wx * d[0] * x + wy * d[1] * y - shape[k] * d[2] * bump);
    float square_term = c * (wx * d[0] * d[0] + wy * d[1] * d[1] + shape[k] * d[2] * d[2]);
    float discriminant = g * g - square_term * f;
    float root = sqrt(max(discriminant, 0.0));
    float step = f / (g + root);
#if TERMS
    if (aspheric[k]) {{
      if (discriminant < 0.0)
        step = 0.0;
      discriminant = -1.0;
      for (int i = 0; i < {rounds}; i++) {{
        float u = x + step * d[0];
        float v = y + step * d[1];
        float s = wx * u * u + wy * v * v;
        if (s > 9.0 * clear[k])
          return;
        float along_s = 2.0 * (wx * u * d[0] + wy * v * d[1]);
        polynomial(a, k, s, bump, slope);
        float w = step * d[2] - bump;
        float along_w = d[2] - slope * along_s;
        float side = w - 0.5 * c * (s + shape[k] * w * w);
        float change = side / (along_w - 0.5 * c * (along_s + 2.0 * shape[k] * w * along_w));
        step -= change;
        if (abs(change) <= {small} * (abs(x) + abs(y) + abs(step))) {{
          discriminant = 1.0;
          break;
        }}
      }}
    }}
#endif
    if (discriminant < 0.0)
      return;
    float z = step * d[2];
    x += step * d[0];
    y += step * d[1];
#if TERMS
    if (aspheric[k])
      polynomial(a, k, wx * x * x + wy * y * y, bump, slope);
#endif
    float ahead = 1.0 - c * shape[k] * (z - bump);
    float aside = -(c + 2.0 * slope * ahead);
    vector facing = vector(wx * x * aside, wy * y * aside, ahead);
    if (facing[2] <= 0.0 || x * x + y * y > clear[k])
      return;
    float size = length(facing);
    facing /= size;
    float cosine = root / size;
#if TERMS
    if (aspheric[k])
      cosine = dot(facing, d);
    if (cosine <= 0.0)
      return;
#endif
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
        For a camera without surfaces, or a lens with mirrors, toroids, biconics, or surfaces or openings off its axis.
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
    axes = [surface.axes() for surface in surfaces]
    terms = max((max(power, 2) + 1 for surface in surfaces for power, _ in surface.aspheric), default=0)
    return PROGRAM.format(
        about=f"{view.name}, film {setting.film_distance_mm:.6g} mm behind it, {wavelength:g} nm",
        count=len(surfaces),
        vertex=_listed(film_z - float(lens.vertices[k]) for k in rows),
        curvature=_listed(-surface.curvature for surface in surfaces),
        shape=_listed(1.0 + surface.conic for surface in surfaces),
        clear=_listed(min(surface.semi_diameter, 1e6) ** 2 for surface in surfaces),
        ratio=_listed(float(indices[k + 1] / indices[k]) for k in rows),
        across_x=_listed(x for x, _ in axes),
        across_y=_listed(y for _, y in axes),
        terms=terms,
        size=terms * len(surfaces),
        aspheric=", ".join(str(int(bool(surface.aspheric))) for surface in surfaces),
        coefficients=_listed(-dict(surface.aspheric).get(i, 0.0) for surface in surfaces for i in range(terms)),
        rounds=ROUNDS,
        small=SMALL,
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
                " (allowed: spheres, conics, cylinders, aspheres and planes about one axis, with round openings)"
            )


def _fault(surface: Surface) -> str:
    if surface.is_mirror:
        return "is a mirror"
    if surface.form is not None:
        return f"is {surface.form.description}"
    if surface.pose is not None:
        return "stands beside the axis or tilted"
    if surface.region is not None:
        return "has an opening that is not round"
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
    radius = _reach(lens, film, last, rear, setting.camera.wavelength_nm)
    if plane != last:
        spread = float(np.max((film[:, 2] - plane) / (film[:, 2] - last)))
        radius = radius * spread + abs(spread - 1.0) * float(np.hypot(*film[:, :2].T).max())
    for _ in range(NARROWED):
        radius = min(radius, _reach(lens, film, plane, radius, setting.camera.wavelength_nm))
    return _Disk(float(plane), radius)


def _reach(lens: Lens, film: Array, plane: float, half: float, wavelength_nm: float) -> float:
    """Return how far from the axis light to film points crosses a plane, within a square of half side ``half`` [mm]."""
    line = np.linspace(-half, half, STEPS)
    x, y = (values.ravel() for values in np.meshgrid(line, line))
    origins = np.repeat(film, x.size, axis=0)
    targets = np.tile(np.column_stack([x, y, np.full(x.size, plane)]), (len(film), 1))
    through = passing(lens, origins, targets - origins, wavelength_nm)
    if not through.any():
        raise InputError(f"--osl: {lens.name}: no light comes through to the film")
    step = float(line[1] - line[0]) * math.sqrt(2)
    return float(np.max(np.hypot(*targets[through, :2].T)) + step)


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
