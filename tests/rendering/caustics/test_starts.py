"""Photons start evenly over glass and mirrors: what stands for their points adds up to the areas in float64."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from rptcam_cl.core.records import CAUSTIC_SURFACE, Kind, curves
from tests.device.probes import open_session, run

COUNT = 1 << 14
# The canonical shapes as maps of the unit square, and their areas.
SHAPES = {
    Kind.DISK: (lambda a, r: (r * np.cos(a), r * np.sin(a), 0 * r), np.pi),
    Kind.RECTANGLE: (lambda a, v: (a / (2 * np.pi), v, 0 * v), 1.0),
    Kind.ELLIPSOID: (lambda a, v: (*(np.sin(np.pi * v) * (np.cos(a), np.sin(a))), np.cos(np.pi * v)), 4 * np.pi),
    Kind.CYLINDER: (lambda a, z: (np.cos(a), np.sin(a), z), 2 * np.pi),
    Kind.CONE: (lambda a, r: (r * np.cos(a), r * np.sin(a), 1 - r), np.sqrt(2) * np.pi),
}  # fmt: skip


def patches(shape, placement):
    """Middles and areas of small pieces of a placed shape."""
    a, v = np.meshgrid(np.linspace(0, 2 * np.pi, 257), np.linspace(0, 1, 257))
    corners = np.moveaxis(np.array(np.broadcast_arrays(*shape(a, v))), 0, -1) @ placement[:, :3].T + placement[:, 3]
    p, q, r, s = corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:]
    return (p + q + r + s) / 4, np.linalg.norm(np.cross(s - p, q - r), axis=-1) / 2


@pytest.fixture(scope="module")
def starts():
    """Placements of a surface of each shape and a triangle, and where photons start on them."""
    records, placements = CAUSTIC_SURFACE.zeros(len(SHAPES) + 1), []
    for k, (kind, (_, area)) in enumerate(SHAPES.items()):
        turned = Rotation.from_euler("xyz", (0.4 + k, 0.9, 2 * k)).as_matrix() * (1.0, 1.6, 0.5)
        placements.append(np.column_stack([turned, (k, -1.0, 2.0)]))
        records["kind"][k], records["area"][k], records["triangle"][k] = kind, area, -1
        records["row_x"][k], records["row_y"][k], records["row_z"][k] = placements[k]
    records["kind"][-1], records["area"][-1] = Kind.MESH, 0.7
    records["primitive"] = np.arange(len(records))
    curve, _ = curves(np.array([[3.0, 2.0, 4.0, 3.0, 1.5, 2.5]]))
    session = open_session()
    out = session.allocate(4 * 7 * COUNT)
    run(
        session, "probe_photon_start", {"VW": session.lanes}, COUNT // session.lanes, count=np.uint32(COUNT), out=out,
        surfaces=session.upload(records), curve=session.upload(curve.ravel()), surface_count=np.int32(len(records)),
        **{"in": session.upload(qmc.Sobol(3, seed=3).random(COUNT).T.astype(np.float32, order="C"))},
    )  # fmt: skip
    return placements, session.read(out, np.float32, 7 * COUNT).reshape(7, COUNT).astype(np.float64)


@pytest.mark.parametrize("kind", SHAPES, ids=[kind.name for kind in SHAPES])
def test_starts_stand_for_the_area_of_their_surface(starts, kind) -> None:
    placements, (primitive, *point, area, _, _) = starts
    k = list(SHAPES).index(kind)
    here = primitive == k
    middles, pieces = patches(SHAPES[kind][0], placements[k])
    found, area = np.column_stack(point)[here], area[here]
    assert area.sum() / COUNT == pytest.approx(pieces.sum(), rel=0.01)  # so many points in three dimensions
    middle = np.average(middles.reshape(-1, 3), axis=0, weights=pieces.ravel())
    np.testing.assert_allclose(np.average(found, axis=0, weights=area), middle, atol=0.02)
    spread = np.cov(middles.reshape(-1, 3).T, aweights=pieces.ravel(), ddof=0)
    np.testing.assert_allclose(np.cov(found.T, aweights=area, ddof=0), spread, atol=0.02)
    x, y, z = np.linalg.solve(placements[k][:, :3], (found - placements[k][:, 3]).T)
    flat = kind in (Kind.DISK, Kind.RECTANGLE)
    on_it = {Kind.ELLIPSOID: x**2 + y**2 + z**2 - 1, Kind.CYLINDER: x**2 + y**2 - 1, Kind.CONE: np.hypot(x, y) + z - 1}
    np.testing.assert_allclose(z if flat else on_it[kind], 0, atol=3e-6)  # float32, at coordinates of 5


def test_starts_are_even_over_a_triangle(starts) -> None:
    _, (primitive, _, _, _, area, b1, b2) = starts
    here = primitive == len(SHAPES)
    b1, b2 = b1[here], b2[here]
    assert min(b1.min(), b2.min(), (1 - b1 - b2).min()) >= -1e-6
    assert area[here].sum() / COUNT == pytest.approx(0.7, rel=0.01)
    # means over a triangle of barycentric coordinates and of their products
    np.testing.assert_allclose(
        [b1.mean(), b2.mean(), (b1 * b2).mean(), (b1**2).mean()], [1 / 3, 1 / 3, 1 / 12, 1 / 6], atol=0.005
    )
