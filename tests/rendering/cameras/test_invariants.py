"""What no lens can change: rays sent back come home, phase space keeps its volume, light counts alike both ways."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.optics.glass import AIR
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status
from tests.device.probes import camera_rays
from tests.rendering.cameras.beams import (
    ASSIGNMENT,
    PRECISIONS,
    back_distance,
    doubtful,
    film_beam,
    generator,
    on_device,
)
from tests.support.lenses import each_lens
from tests.support.statistics import assert_equivalent


def bundle(name, count):
    lens = load_lens(name)
    back, half = ASSIGNMENT.get(name, (back_distance(lens), None))
    return lens, back, *film_beam(lens, count, half, back)


@pytest.mark.parametrize("name", each_lens())
def test_rays_sent_back_return_to_their_film_point(session, name):
    for precision in PRECISIONS:
        assert_rays_return(session, *bundle(name, 2000), precision)


def assert_rays_return(session, lens, back, origins, directions, precision):
    out = on_device(session, lens, origins, directions, precision)
    there = out.origins[out.passed], -out.directions[out.passed]
    again = on_device(session, lens, *there, precision, "scene")
    # Grazed rims and nothing else may lose a ray on the way back.
    assert again.passed.mean() >= (0.998 if precision == "single" else 1.0)
    z = lens.length + back
    at, heading = again.origins[again.passed], again.directions[again.passed]
    film = at + (z - at[:, 2:]) / heading[:, 2:] * heading
    error = np.abs(film - origins[out.passed][again.passed]).max(axis=1)
    # 3e-7 of direction leave the lens, and its focal length is their lever; the steepest rays cross the film aslant
    lever = max(lens.length, back, abs(lens.first_order().focal_length_mm)) / np.abs(heading[:, 2]) ** 2
    assert (error <= (3e-6 if precision == "single" else 1e-13) * np.maximum(lever, 1.0)).all()


def phase_space_jacobian(lens, origins, directions, back, step=1e-4):
    """Derivative (n, 4, 4) of (x, y, p, q) in front of the lens after those on the film, by central differences."""
    film_index, scene_index = (float(lens.indices()[k]) for k in (-1, 0))
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    state = np.column_stack([origins[:, :2], film_index * unit[:, :2]])

    def through(changed):
        cosines = changed[:, 2:] / film_index
        along = np.column_stack([cosines, -np.sqrt(1 - np.sum(cosines**2, axis=1))])
        rays = lens.trace(np.column_stack([changed[:, :2], origins[:, 2]]), along)
        at = rays.origins - rays.origins[:, 2:] / rays.directions[:, 2:] * rays.directions
        return np.column_stack([at[:, :2], scene_index * rays.directions[:, :2]]), rays.passed

    columns, passed = [], np.ones(len(origins), dtype=bool)
    for k in range(4):
        change = np.zeros(4)
        change[k] = step * (back if k < 2 else 1.0) * 0.1
        ahead, here = through(state + change)
        behind, there = through(state - change)
        columns.append((ahead - behind) / (2 * change[k]))
        passed &= here & there
    return np.stack(columns, axis=2)[passed]


OMEGA = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])


def symplectic_error(lens, back, origins, directions):
    jacobian = phase_space_jacobian(lens, origins, directions, back)
    assert len(jacobian) > 20
    # Rows and columns in units of the film distance, so that one number stands for all.
    scale = np.diag([1 / back, 1 / back, 1, 1])
    scaled = scale @ jacobian @ np.linalg.inv(scale)
    unit = np.swapaxes(scaled, 1, 2) @ OMEGA @ scaled - OMEGA
    return np.median(np.abs(unit).max(axis=(1, 2))), np.abs(np.linalg.det(jacobian) - 1)


@pytest.mark.parametrize("name", each_lens())
def test_lenses_are_symplectic(name):
    lens, back, origins, directions = bundle(name, 1000)
    error, determinant = symplectic_error(lens, back, origins, directions)
    # central differences: 1e-10 of curvature over steps of 1e-5, and 1e-14 of rounding over them
    assert error <= 1e-5
    assert np.median(determinant) <= 1e-6


def test_the_printed_refraction_of_the_paper_is_not(monkeypatch):
    def printed(directions, normals, cosines, ratio):
        perpendicular = normals * cosines
        bent = perpendicular + (directions - perpendicular) * ratio
        return bent / np.linalg.norm(bent, axis=0), np.ones(bent.shape[1], dtype=bool)

    module = __import__("sys").modules["rptcam_cl.optics.ray_trace"]
    monkeypatch.setattr(module, "refract", printed)
    lens, back, origins, directions = bundle("dgauss-50mm", 400)
    error, _ = symplectic_error(lens, back, origins, directions)
    assert error > 1e-3


FILM_MM = (8.0, 6.0)
ETENDUE = {
    "dgauss-50mm": (36.77, 1.15, 7.5, 500_000),
    "wide-22mm": (14.54, 0.7, 14.5, 1_000_000),
}  # film [mm], disk over first rim, cone [deg], rays


def film_side_etendue(session, name, back):
    """Integral of the renderer's weight over the film [mm2 sr] and its error."""
    scene = {
        "film": {"resolution": [64, 48], "size_mm": FILM_MM},
        "camera": {"kind": "realistic", "lens": name, "focus": {"film_distance_mm": back}}
        | {"eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]},
        "objects": [],
        "exposure": "irradiance",
        "environment": {"kind": "constant", "radiance": 1},
    }
    weight = camera_rays(session, scene, 32).weight
    area = FILM_MM[0] * FILM_MM[1]
    return weight.mean() * area, weight.std() / np.sqrt(len(weight)) * area


def scene_side_etendue(session, name, back, widened, degrees, count):
    """The same from rays of a Lambertian disk before the lens: the share that lands on the film."""
    lens, rng = load_lens(name), generator("etendue", name)
    disk, sine = lens.surfaces[0].semi_diameter * widened, np.sin(np.radians(degrees))
    turn, radius = 2 * np.pi * rng.random(count), disk * np.sqrt(rng.random(count))
    around, slope = 2 * np.pi * rng.random(count), sine * np.sqrt(rng.random(count))
    origins = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(count)])
    across = np.column_stack([slope * np.cos(around), slope * np.sin(around)])
    rays = on_device(session, lens, origins, np.column_stack([across, np.sqrt(1 - slope**2)]), "single", "scene")
    step = (lens.length + back - rays.origins[:, 2]) / rays.directions[:, 2]
    film = (rays.origins + step[:, None] * rays.directions)[:, :2]
    landed = (rays.status == Status.ok) & np.all(np.abs(film) * 2 < FILM_MM, axis=1)
    assert slope[landed].max() < 0.97 * sine and radius[landed].max() < 0.99 * disk  # nothing is left out
    share, whole = landed.mean(), np.pi * disk**2 * np.pi * sine**2
    return share * whole, np.sqrt(share * (1 - share) / count) * whole


@pytest.mark.parametrize("name", ETENDUE)
def test_etendue_is_the_same_from_both_sides(session, name):
    back, *cone = ETENDUE[name]
    ours, our_error = film_side_etendue(session, name, back)
    theirs, their_error = scene_side_etendue(session, name, back, *cone)
    error = np.hypot(our_error, their_error)
    # as an equivalence of 2.5 %: a pupil 2 % too small loses 4 %
    assert_equivalent(ours, error, theirs, 0.025 * theirs)


def test_stopped_down_lens_passes_the_rays_of_the_reference(session):
    # nothing but the stop limits the middle of the picture: its radius on the device is that of the lens to 1e-5
    lens = load_lens("dgauss-50mm")
    lens = lens.with_stop_diameter(lens.stop_diameter_for(8.0))
    origins, directions = film_beam(lens, 4000, 3.0, 36.77)
    wanted, got = lens.trace(origins, directions), on_device(session, lens, origins, directions)
    assert 500 < wanted.passed.sum() < 3500
    differ = got.passed != wanted.passed
    assert not differ.any() or doubtful(lens, origins, directions)[differ].all()


def test_glass_without_glass_keeps_every_ray_where_it_was(session):
    lens, _, origins, directions = bundle("wide-22mm", 1000)
    bare = replace(lens, surfaces=tuple(replace(s, glass=AIR) for s in lens.surfaces))
    out = on_device(session, bare, origins, directions, "double", wavelength_nm=LINE_D_NM)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(out.directions[out.passed], unit[out.passed], atol=1e-15)
