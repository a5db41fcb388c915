"""Lenses whose rays can be traced on a device: where the float64 optics and the kernels that render meet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.cameras.lens_records import LensRecords, lens_records
from rptcam_cl.device import Session, open_session
from rptcam_cl.errors import DeviceError, InputError
from rptcam_cl.optics import Lens, Rays
from rptcam_cl.optics.glass import WAVELENGTH_D
from rptcam_cl.records import device_declarations

Precision = Literal["single", "double"]

GROUP = 16  # work items per group
FAR = 10.0  # lens sizes from which a ray is first moved to the vertex plane in float64
DOUBLE_LANES = 8


class TraceableLens(Lens):
    """A `Lens` that can also be traced on an OpenCL device, by the code that renders."""

    def trace(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        wavelength_nm: ArrayLike = WAVELENGTH_D,
        start: str = "film",
        device: str | Session | None = None,
        precision: Precision = "single",
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

        Returns
        -------
        Rays
            Point on the last surface and direction behind it, status and surface of failure; traced on a device, its
            ``optical_path`` is empty.
        """
        if device is None:
            return super().trace(origins, directions, wavelength_nm, start)
        session = device if isinstance(device, Session) else open_session(device)
        return trace_on_device(self, session, origins, directions, wavelength_nm, start, precision)

    def svg(self, *, device: str | Session | None = None, **options: Any) -> str:
        """Return the lens in cross-section with its rays, as SVG text.

        Parameters
        ----------
        device
            What traces the rays, as in `trace`.
        **options
            As in `rptcam_cl.lensview.svg`: ``f_number``, ``focus_distance_m``, ``section``, ``fields``, ``rays``,
            ``wavelengths_nm``, ``blocked``.
        """
        from rptcam_cl.lensview import svg

        if device is not None:
            options["tracer"] = device_tracer(device if isinstance(device, Session) else open_session(device))
        return svg(self, **options)

    def _repr_svg_(self) -> str:
        return self.svg()


def traceable(lens: Lens) -> TraceableLens:
    """Return a lens with the same prescription that can be traced on a device."""
    return TraceableLens(**{field.name: getattr(lens, field.name) for field in fields(lens)})


def device_tracer(
    session: Session, precision: Precision = "single"
) -> Callable[[Lens, NDArray[np.float64], NDArray[np.float64], float], Rays]:
    """Return a function that traces rays from the scene on a device, given lens, origins, directions and wavelength."""

    def trace(lens: Lens, origins: NDArray[np.float64], directions: NDArray[np.float64], wavelength_nm: float) -> Rays:
        return trace_on_device(lens, session, origins, directions, wavelength_nm, "scene", precision)

    return trace


def trace_on_device(
    lens: Lens,
    session: Session,
    origins: ArrayLike,
    directions: ArrayLike,
    wavelength_nm: ArrayLike,
    start: str,
    precision: Precision,
) -> Rays:
    """Return rays traced by the device; see `TraceableLens.trace`."""
    if start not in ("film", "scene"):
        raise InputError(f'start must be "film" or "scene" (got {start!r})')
    if precision not in ("single", "double"):
        raise InputError(f'precision must be "single" or "double" (got {precision!r})')
    if precision == "double" and not session.info.fp64:
        raise DeviceError(f'device {session.info.id} {session.info.name} has no float64; use precision="single"')
    points, vectors = np.broadcast_arrays(np.atleast_2d(np.asarray(origins, float)), np.atleast_2d(directions))
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"rays need origins and directions of shape (n, 3) (got {points.shape})")
    count = len(points)
    rays = Rays(np.empty((count, 3)), np.empty((count, 3)), np.empty(count, np.int32), np.empty(count, np.int32),
                np.empty(0))  # fmt: skip
    wavelengths = np.broadcast_to(np.asarray(wavelength_nm, float), (count,))
    for wavelength in np.unique(wavelengths):
        rows = np.flatnonzero(wavelengths == wavelength)
        _trace_rows(lens, session, points[rows], vectors[rows], float(wavelength), start, precision, rays, rows)
    return rays


def _trace_rows(
    lens: Lens,
    session: Session,
    points: NDArray[np.float64],
    vectors: NDArray[np.float64],
    wavelength_nm: float,
    start: str,
    precision: Precision,
    rays: Rays,
    rows: NDArray[np.intp],
) -> None:
    """Trace rays of one wavelength and write them to ``rows`` of ``rays``."""
    backwards = start == "film"
    sense = np.array([1.0, 1.0, -1.0 if backwards else 1.0])
    first, last = (lens.length, 0.0) if backwards else (0.0, lens.length)
    p = (points - (0.0, 0.0, first)) * sense
    d = vectors / np.linalg.norm(vectors, axis=1, keepdims=True) * sense
    size = lens.length + max(min(surface.semi_diameter, 1e6) for surface in lens.surfaces)
    with np.errstate(all="ignore"):
        far = (np.abs(p[:, 2]) > FAR * size) & (d[:, 2] > 0)
        p[far] -= d[far] * (p[far, 2] / d[far, 2])[:, None]
    traced = lens_records(lens, wavelength_nm, "film" if backwards else "scene", 0.0, double=precision == "double")
    out = _run(session, traced, p, d, precision)
    rays.origins[rows] = out[:3].T * sense + (0.0, 0.0, last)
    rays.directions[rows] = out[3:6].T * sense
    rays.status[rows] = out[6].astype(np.int32)
    failed = out[7].astype(np.int32)
    rays.surface[rows] = np.where(failed >= 0, len(lens.surfaces) - 1 - failed, -1) if backwards else failed


def _run(
    session: Session,
    traced: LensRecords,
    points: NDArray[np.float64],
    directions: NDArray[np.float64],
    precision: Precision,
) -> NDArray[np.float64]:
    """Return the eight rows that the kernel writes, for the rays given."""
    double = precision == "double"
    lanes = DOUBLE_LANES if double else session.lanes
    real = np.float64 if double else np.float32
    count = len(points)
    padded = -(-count // (lanes * GROUP)) * lanes * GROUP
    rays = np.zeros((8, padded), real)
    rays[5] = 1.0
    rays[:3, :count], rays[3:6, :count] = points.T, directions.T
    facts = traced.facts | {"VW": lanes, "DOUBLE": int(double), "LENS_KEEP_FAILED": 1}
    program = session.program(["pass/trace_rays.cl"], facts, device_declarations())
    memory = session.allocate(rays.nbytes)
    session.write(memory, rays)
    records, stop = session.upload(traced.surfaces), session.upload(traced.stop)
    count_of = np.int32(len(traced.surfaces))
    launch = session.bind(program, "trace_rays", records, count_of, stop, memory, np.uint32(padded))
    launch.enqueue(padded // lanes, GROUP)
    return session.read(memory, real, rays.size).reshape(8, padded)[:, :count].astype(np.float64)
