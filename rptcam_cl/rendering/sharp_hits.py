"""What given rays meet, one each: the ground of all layers that know no blur."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.buffers import SceneBuffers

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

GROUP = 4  # work items
MOST_RAYS = 1 << 20  # of a launch
NO_PRIMITIVE, PATH_ENDED, NO_TRIANGLE = -1, -2, -1  # as kernels have them
MOST_SURFACES = 512  # that a ray is followed through


@dataclass(frozen=True)
class SharpHits:
    """What n rays meet.

    Attributes
    ----------
    points, normals, own_normals : (n, 3) arrays
        Position about the eye when the shutter opens [m]; normal for shading, and of the surface itself, both towards
        where the ray comes from. Nothing where nothing is met.
    primitives, triangles, objects, materials : (n,) arrays
        Identifiers; -1 for none.
    departures : (n, 3) array
        Where the ray goes on from beyond the surface [m].
    """

    points: Array
    normals: Array
    own_normals: Array
    primitives: Indices
    triangles: Indices
    objects: Indices
    materials: Indices
    departures: Array

    @property
    def met(self) -> NDArray[np.bool_]:
        """Which rays meet something."""
        return np.asarray(self.primitives >= 0)


class SharpPass:
    """The pass that follows given rays to the first surface.

    Parameters
    ----------
    session, plan, buffers
        The device and the scene on it.
    """

    def __init__(self, session: Session, plan: Plan, buffers: SceneBuffers) -> None:
        self._session, self._scene = session, buffers.scene
        facts = plan.facts | buffers.tree_facts | {"VW": session.lanes, "SPECTRAL_COLOURS": 0, "HAS_DISPERSION": 0}
        self._program = session.program(["pass/sharp.cl"], facts, device_declarations())
        self._owners = session.upload(plan.owners.of_primitive)

    def hits(self, origins: Array, directions: Array, times: Array, since: SharpHits | None = None) -> SharpHits:
        """Return what rays meet.

        Parameters
        ----------
        origins, directions : (n, 3) arrays
            About the eye when the shutter opens [m]; a ray with nan meets nothing.
        times : (n,) array
            Since then [s].
        since : SharpHits, optional
            Surfaces that the rays depart from; a ray that has met none meets nothing.
        """
        parts = [
            self._part(slice(low, low + MOST_RAYS), origins, directions, times, since)
            for low in range(0, len(origins), MOST_RAYS)
        ]
        return SharpHits(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def all_hits(self, origins: Array, directions: Array, times: Array) -> list[SharpHits]:
        """Return what rays meet first, second and so on, until none meets anything."""
        found = [self.hits(origins, directions, times)]
        while found[-1].met.any() and len(found) < MOST_SURFACES:
            found.append(self.hits(found[-1].departures, directions, times, found[-1]))
        return found

    def _part(
        self, part: slice, origins: Array, directions: Array, times: Array, since: SharpHits | None
    ) -> tuple[Array | Indices, ...]:
        session, count, group = self._session, len(origins[part]), GROUP * self._session.lanes
        capacity = -(-count // group) * group
        rays = np.zeros((7, capacity), np.float32)
        rays[5] = 1.0
        known = np.asarray(np.isfinite(origins[part] + directions[part]).all(axis=1))
        if since is not None:
            known &= since.met[part]
        for row, values in ((0, origins), (3, directions)):
            rays[row : row + 3, :count] = np.where(known, values[part].T, rays[row : row + 3, :count])
        rays[6, :count] = times[part]
        from_surface = np.full((2, capacity), PATH_ENDED, np.int32)
        from_surface[0, :count] = np.where(known, NO_PRIMITIVE if since is None else since.primitives[part], PATH_ENDED)
        from_surface[1, :count] = NO_TRIANGLE if since is None else since.triangles[part]
        points, hits = session.allocate(40 * capacity), session.allocate(16 * capacity)
        launch = session.bind(
            self._program, "sharp", **self._scene, owners=self._owners, rays=session.upload(rays),
            origins=session.upload(from_surface), points=points, hits=hits, capacity=np.uint32(capacity),
        )  # fmt: skip
        launch.enqueue(capacity // session.lanes, GROUP)
        session.finish()
        values = session.read(points, np.float32, 10 * capacity).reshape(10, capacity)[:, :count].astype(np.float64)
        owners = session.read(hits, np.int32, 4 * capacity).reshape(4, capacity)[:, :count].copy()
        return _towards(values, owners, directions[part])


def _towards(values: Array, owners: Indices, directions: Array) -> tuple[Array | Indices, ...]:
    """Return the fields of `SharpHits`, with normals that face where rays come from."""
    point, normal, own = (values[row : row + 3].T for row in (0, 3, 6))
    along = np.sum(own * np.nan_to_num(directions), axis=1)
    turn = np.where(along > 0, -1.0, 1.0)[:, None]
    departure = point + np.copysign(values[9], along)[:, None] * own
    met = (owners[0] >= 0)[:, None]
    turned = (np.where(met, turn * each, 0.0) for each in (normal, own))
    return point, *turned, *owners, departure
