"""Lenses whose rays can be traced on a device: where the float64 optics and the kernels that render meet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import DeviceError, InputError
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.optics.as_built import Copies
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens as read_lens
from rptcam_cl.optics.measures import Measurable
from rptcam_cl.optics.ray_trace import IDEAL, LensTransmission, Rays

Precision = Literal["single", "double"]

Array = NDArray[np.float64]

GROUP = 16  # most work items per group
PACKETS = 2  # of lanes that a work item of the kernel traces side by side
BLOCK = 1 << 15  # rays at a time, so that packing and unpacking stay in the processor's cache
ROWS = 8  # of numbers that a ray has, and one more where losses count
FAR = 10.0  # lens sizes from which a ray is first moved to the vertex plane in float64
DOUBLE_LANES = 8


class TraceableLens(Lens, Measurable):
    """A `Lens` that can also be traced on an OpenCL device, by the code that renders."""

    def trace(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        wavelength_nm: ArrayLike = LINE_D_NM,
        start: str = "film",
        device: str | Session | None = None,
        precision: Precision = "single",
        *,
        transmission: LensTransmission | None = None,
    ) -> Rays:
        """Return rays traced through every surface.

        Parameters
        ----------
        origins, directions : (n, 3) arrays
            Points [mm] and directions of any length in the frame of the lens: z = 0 at the first vertex, +z to film.
        wavelength_nm : float or (n,) array
        start : "film" or "scene"
            Side where the rays begin: from the film they travel to -z, from the scene to +z.
        device
            None for the float64 reference on the host; else as ``--device`` on the command line, or a session.
        precision : "single" or "double"
            Arithmetic of the device.
        transmission : LensTransmission, optional
            Losses to count.

        Returns
        -------
        Rays
            Point on the last surface and direction behind it, status and surface of failure; traced on a device, its
            ``optical_path`` is empty.
        """
        if device is None:
            return super().trace(origins, directions, wavelength_nm, start, transmission=transmission)
        session = device if isinstance(device, Session) else open_session(device)
        return trace_on_device(
            self, session, origins, directions, wavelength_nm, start, precision, transmission or IDEAL
        )

    def svg(self, *, device: str | Session | None = None, **options: Any) -> str:
        """Return the lens in cross-section with its rays, as SVG text.

        Parameters
        ----------
        device
            What traces the rays, as in `trace`.
        **options
            As in `lenstools.svg`: ``f_number``, ``focus_distance_m``, ``section``, ``fields``, ``rays``,
            ``wavelengths_nm``, ``blocked``.
        """
        from rptcam_cl.optics.drawing import svg

        if device is not None:
            options["tracer"] = device_tracer(device if isinstance(device, Session) else open_session(device))
        return svg(self, **options)

    def _repr_svg_(self) -> str:
        return self.svg()


def traceable(lens: Lens) -> TraceableLens:
    """Return a lens with the same prescription that can be traced on a device."""
    return TraceableLens(**{field.name: getattr(lens, field.name) for field in fields(lens)})


def load_lens(source: str | Path | Mapping[str, Any]) -> TraceableLens:
    """Return the lens of a name in the library, a file, or a mapping of the same form; it can be traced on devices."""
    return traceable(read_lens(source))


def device_tracer(
    session: Session,
) -> Callable[[Lens, NDArray[np.float64], NDArray[np.float64], float], Rays]:
    """Return a function that traces rays from the scene on a device, given lens, origins, directions and wavelength."""

    def trace(lens: Lens, origins: NDArray[np.float64], directions: NDArray[np.float64], wavelength_nm: float) -> Rays:
        return trace_on_device(lens, session, origins, directions, wavelength_nm, "scene", "single")

    return trace


def trace_on_device(
    lens: Lens,
    session: Session,
    origins: ArrayLike,
    directions: ArrayLike,
    wavelength_nm: ArrayLike,
    start: str,
    precision: Precision,
    transmission: LensTransmission = IDEAL,
) -> Rays:
    """Return rays traced by the device; see `TraceableLens.trace`."""
    if start not in ("film", "scene"):
        raise InputError(f'start must be "film" or "scene" (got {start!r})')
    check_double(session, precision)
    points, vectors = np.broadcast_arrays(np.atleast_2d(np.asarray(origins, float)), np.atleast_2d(directions))
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"rays need origins and directions of shape (n, 3) (got {points.shape})")
    count = len(points)
    rays = Rays(np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.int32), np.empty(count, np.int32),
                np.empty(0), np.empty(count) if transmission else None)  # fmt: skip
    wavelengths = np.asarray(wavelength_nm, float)
    different = np.unique(wavelengths) if count else np.zeros(0)
    if len(different) > 1 and precision == "single" and not transmission and _has_polynomials(lens, different):
        tracer = LensTracer(lens, session, different[0], start, precision, IDEAL, dispersive=True)
        tracer.trace(points, vectors, rays, slice(0, count), np.broadcast_to(wavelengths, (count,)))
        return rays
    for wavelength in different:
        tracer = LensTracer(lens, session, float(wavelength), start, precision, transmission)
        if len(different) == 1:
            tracer.trace(points, vectors, rays, slice(0, count))
        else:
            tracer.trace(points, vectors, rays, np.flatnonzero(np.broadcast_to(wavelengths, (count,)) == wavelength))
    return rays


def check_double(session: Session, precision: Precision) -> None:
    """Refuse an arithmetic that there is not, or that a device lacks."""
    if precision not in ("single", "double"):
        raise InputError(f'precision must be "single" or "double" (got {precision!r})')
    if precision == "double" and not session.info.fp64:
        raise DeviceError(f'device {session.info.id} {session.info.name} has no float64; use precision="single"')


def _has_polynomials(lens: Lens, wavelengths_nm: Array) -> bool:
    """Return whether renderers know a lens by polynomials over wavelengths, and those given are among them."""
    from rptcam_cl.rendering.cameras.lens_records import (
        disperses,
        usable_nm,
    )  # takes long to import, and most lenses stay on the host

    low, high = usable_nm(lens)
    return bool(low <= wavelengths_nm.min() and wavelengths_nm.max() <= high) and disperses(lens)


class LensTracer:
    """A lens on the device, at one wavelength or with one for every ray, which traces rays a block at a time.

    Parameters
    ----------
    lens, session, wavelength_nm
        What is traced, where, and at which wavelength [nm].
    start
        ``film`` or ``scene``: side where rays begin.
    precision, transmission
        As of `trace_on_device`.
    dispersive
        Whether every ray brings a wavelength of its own.
    """

    def __init__(
        self,
        lens: Lens,
        session: Session,
        wavelength_nm: float,
        start: str,
        precision: Precision,
        transmission: LensTransmission,
        *,
        dispersive: bool = False,
    ) -> None:
        from rptcam_cl.rendering.cameras.lens_records import lens_records

        double = precision == "double"
        self.session, self.surfaces_of = session, lens
        self.real = np.float64 if double else np.float32
        self.lanes = DOUBLE_LANES if double and session.lanes > 1 else session.lanes
        self.backwards = start == "film"
        self.last_surface = len(lens.surfaces) - 1
        ends = (-lens.sense, -1.0) if self.backwards else (1.0, lens.sense)
        self.sense, self.sense_behind = ends
        self.first, self.last = (lens.length, 0.0) if self.backwards else (0.0, lens.length)
        self.far = FAR * (
            float(np.ptp(lens.vertices)) + max(min(surface.semi_diameter, 1e6) for surface in lens.surfaces)
        )
        side: Literal["film", "scene"] = "film" if self.backwards else "scene"
        traced = lens_records(
            lens, wavelength_nm, side, 0.0, double=double, dispersive=dispersive, transmission=transmission
        )
        self.folds = lens.fold is not None and not self.backwards
        self.facts = traced.facts | {"VW": self.lanes, "DOUBLE": int(double), "LENS_KEEP_FAILED": 1}
        self.facts |= {"LENS_FOLD": 1} if self.folds else {}
        self._kept: dict[tuple[int, int], tuple[Any, Any]] = {}
        self.lens = {
            "surfaces": session.upload(traced.surfaces),
            "count": np.int32(len(traced.surfaces)),
            "stop": session.upload(traced.stop),
        }

    def trace(
        self,
        points: Array,
        vectors: Array,
        rays: Rays,
        rows: slice | NDArray[np.intp],
        wavelengths_nm: Array | None = None,
        surfaces: int | None = None,
    ) -> None:
        """Trace some rows of points and directions (n, 3) and write them to the same rows of ``rays``.

        Parameters
        ----------
        surfaces
            Number of surfaces, in the order in which rays meet them, behind which they are stopped; all by default.
        """
        if self.folds:
            points, vectors = self._into_lens(points, vectors)
        count = rows.stop if isinstance(rows, slice) else len(rows)
        size = PACKETS * self.lanes * GROUP
        capacity = min(-(-count // size) * size, BLOCK)
        table = np.zeros((ROWS if rays.transmittance is None else ROWS + 1, capacity), self.real)
        table[ROWS:] = 1.0  # what a lens leaves that loses nothing
        memory, launch = self._bound(capacity, table.nbytes)
        launch.set(count=self.lens["count"] if surfaces is None else np.int32(surfaces))
        for low in range(0, count, BLOCK):
            high = min(low + BLOCK, count)
            part = slice(low, high) if isinstance(rows, slice) else rows[low:high]
            self._pack(points[part], vectors[part], table)
            if wavelengths_nm is not None:
                table[6, : high - low], table[6, high - low :] = wavelengths_nm[part], LINE_D_NM
            self.session.write(memory, table)
            launch.enqueue(capacity // (PACKETS * self.lanes), min(self.session.group, GROUP))
            out = self.session.read(memory, self.real, table.size).reshape(table.shape)
            self._unpack(out[:, : high - low], rays, part, self._end(surfaces))
        if self.backwards and surfaces is None and self.surfaces_of.fold is not None:
            done = np.arange(count)[rows] if isinstance(rows, slice) else rows
            done = done[rays.status[done] == 0]
            ends = self.surfaces_of.in_scene_axes(rays.origins[done].T, rays.directions[done].T)
            rays.origins[done], rays.directions[done] = (values.T for values in ends)

    def _into_lens(self, points: Array, vectors: Array) -> tuple[Array, Array]:
        """Return rays of the axes of the scene in the frame of the lens, from the plane of the first vertex."""
        points, vectors = np.asarray(points, np.float64), np.asarray(vectors, np.float64)
        near = points - vectors * (points[:, 2:] / vectors[:, 2:])
        p, d = self.surfaces_of.from_scene_axes(near.T, vectors.T)
        return p.T, d.T

    def _bound(self, capacity: int, size: int) -> tuple[Any, Any]:
        """Return memory for so many rays and the kernel that traces them, kept from one bundle to the next."""
        if (capacity, size) not in self._kept:
            program = self.session.program(["pass/trace_rays.cl"], self.facts, device_declarations())
            memory = self.session.allocate(size)
            launch = self.session.bind(program, "trace_rays", **self.lens, rays=memory, capacity=np.uint32(capacity))
            self._kept[capacity, size] = memory, launch
        return self._kept[capacity, size]

    def paths(self, points: Array, vectors: Array, wavelengths_nm: Array | None = None) -> tuple[Array, Rays]:
        """Return where rays (n, 3) start and meet each surface (surfaces + 1, n, 3), and what becomes of them.

        Surfaces come in the order in which rays meet them. From the one that stops a ray on, it stays where it was
        stopped; a ray that misses a surface stays on the one before.
        """
        count = len(points)
        begin = points if self.backwards else self.surfaces_of.from_scene_axes(points.T, vectors.T)[0].T
        corners = [np.array(begin, np.float64)]
        for surfaces in range(1, int(self.lens["count"]) + 1):
            rays = Rays(np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.int32),
                        np.empty(count, np.int32), np.empty(0))  # fmt: skip
            self.trace(points, vectors, rays, slice(0, count), wavelengths_nm, surfaces)
            corners.append(rays.origins)
        return np.stack(corners), rays

    def _end(self, surfaces: int | None) -> tuple[float, float]:
        """Return z of the last vertex that rays reach [mm], and which way they then travel: 1 to +z, -1 to -z."""
        if surfaces is None:
            return self.last, self.sense_behind
        lens = self.surfaces_of
        k = len(lens.surfaces) - surfaces if self.backwards else surfaces - 1
        sense = -float(lens.senses[k]) if self.backwards else float(lens.senses[k + 1])
        return float(lens.vertices[k]), sense

    def _pack(self, points: Array, vectors: Array, table: NDArray[Any]) -> None:
        """Fill the rows that the kernel reads: points from the first vertex it meets, unit directions, z along them."""
        count = len(points)
        x, y, z = points.T
        dx, dy, dz = vectors.T
        with np.errstate(all="ignore"):
            inverse = 1.0 / np.sqrt(dx * dx + dy * dy + dz * dz)
            z = (z - self.first) * self.sense
            along = dz * (inverse * self.sense)
            table[3, :count], table[4, :count], table[5, :count] = dx * inverse, dy * inverse, along
            table[0, :count], table[1, :count], table[2, :count] = x, y, z
            far = (np.abs(z) > self.far) & (along > 0)
            if far.any():
                step = -z[far] / along[far]
                near = np.flatnonzero(far)
                table[0, near] = x[far] + step * (dx * inverse)[far]
                table[1, near] = y[far] + step * (dy * inverse)[far]
                table[2, near] = z[far] + step * along[far]
        table[:5, count:], table[5, count:] = 0.0, 1.0

    def _unpack(self, out: NDArray[Any], rays: Rays, part: slice | NDArray[np.intp], end: tuple[float, float]) -> None:
        """Write what the kernel wrote to rows of ``rays``."""
        last, sense_behind = end
        rays.origins[part] = out[:3].T
        rays.directions[part] = out[3:6].T
        rays.origins[part, 2] = out[2].astype(np.float64) * sense_behind + last
        if sense_behind < 0:
            rays.directions[part, 2] = -out[5]
        rays.status[part] = out[6]
        if rays.transmittance is not None:
            rays.transmittance[part] = np.where(out[6] == 0, out[ROWS], 0.0)
        failed = out[7].astype(np.int32)
        rays.surface[part] = np.where(failed >= 0, self.last_surface - failed, -1) if self.backwards else failed


class CopiesTracer:
    """Traces rays through copies of a lens on a device, as `rptcam_cl.optics.as_built.film_points` does on the host.

    Parameters
    ----------
    device
        As ``--device`` on the command line, or a session.
    precision : "single" or "double", optional
        Arithmetic of the device; double by default where it has that.
    """

    def __init__(self, device: str | Session, precision: Precision | None = None) -> None:
        session = device if isinstance(device, Session) else open_session(device)
        precision = precision or ("double" if session.info.fp64 else "single")
        check_double(session, precision)
        self.session, self.double = session, precision == "double"
        self.real = np.float64 if self.double else np.float32
        self.lanes = DOUBLE_LANES if self.double and session.lanes > 1 else session.lanes

    def film_points(
        self, copies: Copies, origins: Array, directions: Array, wavelength_nm: float, film_distance_mm: float
    ) -> tuple[Array, Array]:
        """Return where rays from the scene meet the films of all copies, and their slopes there (copies, rays, 2).

        They are not a number for rays that miss a surface or are totally reflected.
        """
        from rptcam_cl.rendering.cameras.lens_records import copy_records

        session, rays, packet = self.session, len(origins), PACKETS * self.lanes
        capacity = -(-rays // packet) * packet
        table = np.zeros((5, capacity), self.real)
        table[4] = 1.0
        at = origins - directions * (origins[:, 2:] / directions[:, 2:])
        table[:2, :rays], table[2:, :rays] = at[:, :2].T, directions.T
        items = capacity // packet * copies.count
        group = min(session.group, GROUP)
        padded = -(-items // group) * group
        more = -(-padded * packet // capacity) - copies.count  # copies that fill the last group
        records = copy_records(copies, wavelength_nm, double=self.double)
        surfaces = np.concatenate([records.surfaces, np.repeat(records.surfaces[:1], more, axis=0)])
        facts = records.facts | {"VW": self.lanes, "DOUBLE": int(self.double)}
        program = session.program(["pass/trace_copies.cl"], facts, device_declarations())
        size = (copies.count + more) * 4 * capacity
        points = session.allocate(size * table.itemsize)
        launch = session.bind(
            program, "trace_copies", surfaces=session.upload(surfaces), count=np.int32(surfaces.shape[1]),
            stop=session.upload(records.stop), rays=session.upload(table), points=points,
            capacity=np.uint32(capacity), film=self.real(film_distance_mm),
        )  # fmt: skip
        launch.enqueue(padded, group)
        out = session.read(points, self.real, size).reshape(-1, 4, capacity)[: copies.count, :, :rays]
        across = np.moveaxis(out.astype(np.float64), 1, -1)
        return across[..., :2], across[..., 2:]
