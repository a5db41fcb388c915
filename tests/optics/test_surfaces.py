"""Surfaces that are not centred spheres: conics, aspheres, cylinders, biconics, toroids, tilts and partial surfaces."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import SurfaceKind
from rptcam_cl.optics.files import native
from rptcam_cl.optics.files.export import codev_text, pbrt_text, zemax_text
from rptcam_cl.optics.glass import AIR, ConstantIndex
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status
from rptcam_cl.optics.shapes import FORMS, Biconic, Form, Toroid
from rptcam_cl.optics.surface import Surface, SurfacePose

RNG = np.random.default_rng(17)


def beam(count=400, spread=4.0, slope=0.3, away=30.0, sense=1.0):
    points = np.stack(
        [RNG.uniform(-spread, spread, count), RNG.uniform(-spread, spread, count), np.full(count, -sense * away)]
    )
    directions = np.stack([RNG.uniform(-slope, slope, count), RNG.uniform(-slope, slope, count), np.full(count, sense)])
    points[:2] += directions[:2] / directions[2] * points[2]
    return points, directions / np.linalg.norm(directions, axis=0)


SHAPES = {
    "ellipsoid": Surface(1 / 20, conic=-0.4),
    "hyperboloid": Surface(-1 / 15, conic=-2.3),
    "oblate": Surface(1 / 25, conic=1.5),
    "cylinder x": Surface(1 / 12, cylinder="x"),
    "conic cylinder y": Surface(-1 / 12, cylinder="y", conic=-1.2),
    "even asphere": Surface(1 / 20, conic=-0.5, aspheric=((4, 2e-4), (6, -1e-6))),
    "with r^2": Surface(1 / 30, aspheric=((2, 0.01), (4, 1e-5))),
    "odd asphere": Surface(1 / 20, aspheric=((3, 1e-3), (5, -1e-5))),
    "acylinder": Surface(1 / 20, cylinder="y", aspheric=((4, 1e-4),)),
    "biconic": Surface(1 / 20, conic=-0.7, form=Biconic(1 / 33, 0.4)),
    "toroid": Surface(1 / 20, conic=-0.7, form=Toroid(-1 / 33)),
    "flat toroid": Surface(1 / 20, form=Toroid(0.0)),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_hits_lie_on_the_surface_and_on_the_ray(name, sense):
    surface = SHAPES[name]
    points, directions = beam(sense=sense)
    hits = surface.meet(points, directions)
    assert hits.met.all()
    z, zx, zy = surface.sag_and_slopes(hits.points[0], hits.points[1])
    np.testing.assert_allclose(hits.points[2], z, atol=2e-14)
    np.testing.assert_allclose(points + hits.distances * directions, hits.points, atol=2e-13)
    normal = np.stack([-zx, -zy, np.ones_like(zx)]) / np.sqrt(1 + zx**2 + zy**2)
    np.testing.assert_allclose(hits.normals, normal, atol=1e-13)
    np.testing.assert_allclose(hits.cosines, np.sum(normal * directions, axis=0), atol=1e-13)


@pytest.mark.parametrize("name", SHAPES)
def test_slopes_are_the_derivatives_of_the_sag(name):
    surface, step = SHAPES[name], 1e-5
    x, y = RNG.uniform(-4, 4, (2, 200))
    _, zx, zy = surface.sag_and_slopes(x, y)
    ahead, behind = surface.sag(x + step, y), surface.sag(x - step, y)
    np.testing.assert_allclose(zx, (ahead - behind) / (2 * step), atol=1e-8)
    ahead, behind = surface.sag(x, y + step), surface.sag(x, y - step)
    np.testing.assert_allclose(zy, (ahead - behind) / (2 * step), atol=1e-8)


@pytest.mark.parametrize("name", SHAPES)
def test_paraxial_curvature_is_that_of_the_sag(name):
    surface, h = SHAPES[name], 1e-3
    if name == "odd asphere":
        h = 1e-5
    zero, height = np.zeros(1), np.full(1, h)
    for section, z in (("x", surface.sag(height, zero)), ("y", surface.sag(zero, height))):
        assert surface.paraxial_curvature(section) == pytest.approx(2 * z[0] / h**2, abs=3e-5)


def test_a_sphere_written_in_other_ways_is_the_same():
    points, directions = beam()
    sphere = Surface(1 / 20).meet(points, directions)
    for other in (
        Surface(1 / 20, aspheric=((4, 1e-300),)),
        Surface(1 / 20, form=Biconic(1 / 20)),
        Surface(1 / 20, form=Toroid(1 / 20)),
    ):
        hits = other.meet(points, directions)
        np.testing.assert_allclose(hits.points, sphere.points, atol=1e-13)
        np.testing.assert_allclose(hits.normals, sphere.normals, atol=1e-13)


def test_conics_focus_without_aberration():
    # A plano-hyperbolic lens with k = -n^2 and an ellipsoid with k = -1 / n^2 bring parallel light to a point.
    n, r = 1.5, 20.0
    heights = np.linspace(0.5, 8.0, 9)
    rays = np.column_stack([np.zeros(9), heights, np.full(9, -10.0)])
    ahead = np.tile([0.0, 0.0, 1.0], (9, 1))
    hyperbola = Lens("h", (Surface(0.0, 6.0, ConstantIndex(n), 10), Surface(-1 / r, 0.0, AIR, 10, conic=-(n**2))))
    ellipse = Lens("e", (Surface(1 / r, 0.0, ConstantIndex(n), 10, conic=-1 / n**2),))
    for lens, focus in ((hyperbola, 6 + r / (n - 1)), (ellipse, n * r / (n - 1))):
        out = lens.trace(rays, ahead, start="scene")
        crossing = out.origins[:, 2] - out.origins[:, 1] / out.directions[:, 1] * out.directions[:, 2]
        np.testing.assert_allclose(crossing, focus, atol=1e-11)
        wrong = replace(lens, surfaces=(*lens.surfaces[:-1], replace(lens.surfaces[-1], conic=0.0)))
        out = wrong.trace(rays, ahead, start="scene")
        crossing = out.origins[:, 2] - out.origins[:, 1] / out.directions[:, 1] * out.directions[:, 2]
        assert np.ptp(crossing) > 0.5


def test_marginal_ray_of_the_telephone_lens():
    # Ray of height 1 as printed by ray-optics for US patent 7,535,658: points to five decimals.
    lens = load_lens("phone-5.6mm")
    open_lens = replace(lens, surfaces=tuple(replace(s, semi_diameter=5.0) for s in lens.surfaces))
    ray = open_lens.trace([[0, 1.0, 0]], [[0, 0, 1.0]], 587.5618, start="scene")
    assert ray.passed[0]
    film = ray.origins[0, 1] + ray.directions[0, 1] / ray.directions[0, 2] * 0.64
    assert (ray.origins[0, 1], film) == pytest.approx((0.09476, -0.02573), abs=3e-5)
    assert ray.directions[0] == pytest.approx([0, -0.185004, 0.982738], abs=3e-6)


def test_an_asphere_that_folds_back_is_not_decided_wrongly():
    wild = Surface(1 / 10, aspheric=((4, 0.5), (6, -0.3)), semi_diameter=4)
    points, directions = beam(count=4000, slope=2.0)
    hits = wild.meet(points, directions)
    decided = hits.met
    assert hits.undecided is not None
    z = wild.sag(hits.points[0][decided], hits.points[1][decided])
    np.testing.assert_allclose(hits.points[2][decided], z, atol=1e-12)
    lens = Lens("wild", (replace(wild, glass=ConstantIndex(1.5)),))
    out = lens.trace(points.T, directions.T, start="scene")
    assert np.all(np.isfinite(out.origins)) and np.all(np.isfinite(out.directions))
    assert set(np.unique(out.status)) <= {int(status) for status in Status}


def test_a_decentred_lens_is_the_lens_seen_from_elsewhere():
    rows = [
        {"radius": 50, "thickness": 5, "glass": {"index": 1.5}, "diameter": 20},
        {"radius": -50, "diameter": 20},
    ]
    plain = load_lens({"name": "x", "surfaces": rows})
    off = load_lens({"name": "x", "surfaces": rows, "groups": [{"surfaces": [0, 1], "decentre": [1.5, -2.0]}]})
    start, direction = np.array([[1.0, 2.0, -30.0]]), [[0.02, -0.03, 1.0]]
    shift = np.array([1.5, -2.0, 0.0])
    expected = plain.trace(start, direction, start="scene")
    got = off.trace(start + shift, direction, start="scene")
    np.testing.assert_allclose(got.origins, expected.origins + shift, atol=1e-13)
    np.testing.assert_allclose(got.directions, expected.directions, atol=1e-15)


def test_a_tilted_group_turns_about_its_first_vertex():
    rows = [
        {"radius": 50, "thickness": 5, "glass": {"index": 1.5}, "diameter": 20},
        {"radius": -50, "diameter": 20},
    ]
    plain = load_lens({"name": "x", "surfaces": rows})
    turned = load_lens({"name": "x", "surfaces": rows, "groups": [{"surfaces": [0, 1], "tilt_degrees": [7, -4, 11]}]})
    turn = SurfacePose.of((0, 0, 0), (7, -4, 11)).matrix()
    start, direction = np.array([[1.0, 2.0, -30.0]]), np.array([[0.02, -0.03, 1.0]])
    expected = plain.trace(start, direction, start="scene")
    got = turned.trace(start @ turn.T, direction @ turn.T, start="scene")
    np.testing.assert_allclose(got.origins, expected.origins @ turn.T, atol=1e-13)
    np.testing.assert_allclose(got.directions, expected.directions @ turn.T, atol=1e-15)


def test_clear_regions_clip():
    def lens(clear):
        return load_lens(
            {"name": "x", "surfaces": [{"thickness": 1, "diameter": 20, "clear": clear}, {"diameter": 20}]}
        )

    points = np.array([[0.0, 0, -1], [3, 0, -1], [0, 3, -1], [-3, 0, -1]])
    ahead = np.tile([0.0, 0, 1], (4, 1))

    def passed(clear):
        return lens(clear).trace(points, ahead, start="scene").passed.tolist()

    assert passed({"rectangle": [8, 4]}) == [True, True, False, True]
    assert passed({"half_plane_degrees": 0}) == [True, True, True, False]
    assert passed({"half_plane_degrees": 90, "edge": 1}) == [False, False, True, False]


def test_a_split_dioptre_bends_one_half_and_leaves_the_other():
    half = {"half_plane_degrees": 90}
    rows = [
        {"radius": 100, "thickness": 2, "glass": {"index": 1.5}, "diameter": 30, "clear": half, "outside": "pass"},
        {"thickness": 3, "diameter": 30, "clear": half, "outside": "pass"},
        {"stop": True, "diameter": 25},
    ]
    lens = load_lens({"name": "split", "surfaces": rows})
    whole = load_lens(
        {"name": "whole", "surfaces": [{k: v for k, v in r.items() if k not in ("clear", "outside")} for r in rows]}
    )
    starts = np.array([[0, 5.0, -1], [0, -5.0, -1], [2, 8, -1], [2, -8, -1]])
    ahead = np.tile([0.0, 0, 1], (4, 1))
    out = lens.trace(starts, ahead, start="scene")
    assert out.passed.all()
    bent = whole.trace(starts, ahead, start="scene")
    np.testing.assert_array_equal(out.directions[[0, 2]], bent.directions[[0, 2]])
    np.testing.assert_array_equal(out.directions[[1, 3]], ahead[[1, 3]])
    back = lens.trace(out.origins + out.directions * 20, -out.directions)
    assert back.passed.all()
    np.testing.assert_allclose(back.directions, -ahead, atol=1e-15)


def test_a_half_lens_ends_in_the_medium_in_which_it_began():
    half = {"clear": {"half_plane_degrees": 90}, "outside": "pass"}
    rows = [
        {"radius": 100, "thickness": 2, "glass": {"index": 1.5}, "diameter": 30, **half},
        {"thickness": 3, "glass": {"index": 1.6}, "diameter": 30, **half},
        {"diameter": 25},
    ]
    with pytest.raises(InputError, match=r"surfaces\[1\]\.glass: must be the medium before the half lens"):
        load_lens({"name": "cemented half", "surfaces": rows})


def test_light_beside_a_half_lens_travels_in_the_medium_outside():
    half = {"clear": {"half_plane_degrees": 90}, "outside": "pass"}
    rows = [
        {"thickness": 2, "glass": {"index": 1.5}, "diameter": 30, **half},
        {"thickness": 3, "diameter": 30, **half},
        {"diameter": 25},
    ]
    lens = load_lens({"name": "half plate", "surfaces": rows})
    through, beside = lens.trace([[0, 5, -1], [0, -5, -1]], [0, 0, 1], start="scene").optical_path
    assert (through, beside) == (pytest.approx(1 + 2 * 1.5 + 3), pytest.approx(6.0))
    stopped = lens.trace([[0, -5, -1]], [[0, -2, 1]], start="scene")
    assert (stopped.status[0], stopped.surface[0]) == (Status.clipped, 2)


def test_a_port_with_water_in_front():
    port = load_lens(
        {
            "name": "port",
            "object_medium": "water",
            "surfaces": [{"thickness": 5, "glass": "N-BK7", "diameter": 90}, {"diameter": 90}],
        }
    )
    angle = np.radians(30)
    out = port.trace([[0, 0, -10]], [[0, np.sin(angle), np.cos(angle)]], 587.5618, start="scene")
    water = float(port.object_medium.index(587.5618))
    assert out.directions[0, 1] == pytest.approx(water * np.sin(angle), rel=1e-12)
    assert water == pytest.approx(1.3334, abs=1e-4)
    assert port.first_order().focal_length_mm == float("inf")


BAD = [
    ({"conic": 30}, r"surfaces\[0\]\.diameter: the diameter 20 mm is more than the shape \(radius, conic\) reaches"),
    ({"aspheric": {0: 1.0}}, r"surfaces\[0\]\.aspheric\[0\]: a power of r is a whole number from 1 to 40"),
    ({"aspheric": {"four": 1.0}}, r"surfaces\[0\]\.aspheric\.four: a power of r"),
    ({"aspheric": [1e-5]}, r"surfaces\[0\]\.aspheric: expected a mapping of powers"),
    ({"aspheric": {4: "x"}}, r"surfaces\[0\]\.aspheric\[4\]: expected a number"),
    ({"cylinder": "z"}, r"surfaces\[0\]\.cylinder: allowed: x"),
    ({"cylinder": "x", "radius_x": 20}, r"surfaces\[0\]\.cylinder: a cylinder has one radius"),
    ({"form": "toroid"}, r"surfaces\[0\]\.form: needs radius_x"),
    ({"form": "cone", "radius_x": 4}, r"surfaces\[0\]\.form: allowed: biconic, toroid"),
    ({"radius_x": 0}, r"surfaces\[0\]\.radius_x: must not be 0"),
    ({"outside": "pass"}, r"surfaces\[0\]\.outside: needs a clear region"),
    ({"clear": {"rectangle": [1]}}, r"surfaces\[0\]\.clear\.rectangle: expected \[width, height\]"),
    ({"clear": {"circle": 1}}, r"surfaces\[0\]\.clear\.circle: unknown key"),
    ({"tilt_degrees": [1]}, r"surfaces\[0\]\.tilt_degrees: expected turns about"),
    ({"decentre": 1}, r"surfaces\[0\]\.decentre: expected a list of numbers"),
]


@pytest.mark.parametrize(("keys", "message"), BAD, ids=[message[:50] for _, message in BAD])
def test_a_bad_shape_is_refused(keys, message):
    row = {"radius": 30, "thickness": 6, "glass": {"index": 1.5}, "diameter": 20, **keys}
    with pytest.raises(InputError, match=message):
        load_lens({"name": "x", "surfaces": [row, {"diameter": 20}]})


def test_an_asphere_whose_sag_turns_back_is_doubted():
    row = {"radius": 30, "thickness": 40, "glass": {"index": 1.5}, "diameter": 20, "aspheric": {4: -2e-3, 6: 3e-5}}
    lens = load_lens({"name": "x", "surfaces": [row, {"diameter": 20}]})
    assert lens.warnings == ("surface 0: its sag turns back inside the rim; check the aspheric coefficients",)


def test_units_scale_aspheric_coefficients():
    row = {
        "radius": 20,
        "thickness": 4,
        "glass": {"index": 1.5},
        "diameter": 10,
        "conic": -0.3,
        "aspheric": {3: 1e-4, 4: 1e-5},
    }
    small = load_lens({"name": "x", "surfaces": [row, {"diameter": 10}]})
    row = {
        "radius": 2,
        "thickness": 0.4,
        "glass": {"index": 1.5},
        "diameter": 1,
        "conic": -0.3,
        "aspheric": {3: 1e-2, 4: 1e-2},
    }
    centimetres = load_lens({"name": "x", "unit": "cm", "surfaces": [row, {"diameter": 1}]})
    x, y = np.zeros(5), np.linspace(0, 5, 5)
    np.testing.assert_allclose(small.surfaces[0].sag(x, y), centimetres.surfaces[0].sag(x, y), rtol=1e-14)


def test_irradiance_grows_with_the_index_behind_the_lens():
    from rptcam_cl.optics.irradiance import on_axis_irradiance

    rows = [{"stop": True, "thickness": 0, "diameter": 4}, {"radius": 8, "diameter": 10, "glass": {"index": 1.336}}]
    eye = load_lens({"name": "eye", "surfaces": rows})
    film = eye.first_order().back_focal_distance_mm
    sine = 2 / np.hypot(2, film)
    assert on_axis_irradiance(eye, film) == pytest.approx(np.pi * (1.336 * sine) ** 2, rel=0.02)


@dataclass(frozen=True)
class Bump(Form):
    """A kind that no other program knows."""

    kind = SurfaceKind.BICONIC
    description = "a bump"
    keys: ClassVar = {}

    @classmethod
    def read(cls, fields: Any, scale: float) -> None:
        return None

    def written(self) -> dict[str, Any]:
        return {}


def test_every_kind_has_its_own_number() -> None:
    assert len({form.kind for form in FORMS}) == len(FORMS)
    assert all(form.kind > SurfaceKind.ASPHERE for form in FORMS)


def test_a_surface_of_two_kinds_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "FORMS", (Biconic, Biconic))
    row = {"radius": 50.0, "radius_x": 40.0, "diameter": 10.0}
    with pytest.raises(InputError, match=r"surfaces\[0\]: is of two curvatures and of two curvatures: leave"):
        load_lens({"surfaces": [row]})


@pytest.mark.parametrize("write", [zemax_text, codev_text, pbrt_text])
def test_a_kind_that_a_format_does_not_know_is_refused_by_it(write: Any) -> None:
    lens = load_lens("plano-convex-100mm")
    bumpy = replace(lens, surfaces=(replace(lens.surfaces[0], form=Bump()), *lens.surfaces[1:]))
    with pytest.raises(InputError, match="a bump"):
        write(bumpy)
