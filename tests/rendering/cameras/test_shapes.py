"""Surfaces other than centred spheres, tilted, partial, with shaped stops: device against the float64 reference."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.optics.glass import AIR, ConstantIndex
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status
from rptcam_cl.optics.surface import Region, StopShape, Surface, SurfacePose
from rptcam_cl.rendering import traceable_lens
from rptcam_cl.rendering.traceable_lens import trace_on_device
from tests.optics.test_surfaces import SHAPES
from tests.rendering.cameras.beams import PRECISIONS, doubtful, film_beam, generator, on_device
from tests.support.cases import slow

GLASS = ConstantIndex(1.5)
END = Surface(semi_diameter=6.0)


def beam(lens, start, count=2000):
    rng = generator("shapes", lens.name, start)
    sense, z = (1.0, -10.0) if start == "scene" else (-1.0, lens.length + 10)
    directions = np.column_stack([rng.uniform(-0.3, 0.3, (count, 2)), np.full(count, sense)])
    return np.column_stack([rng.uniform(-6, 6, (count, 2)), np.full(count, z)]), directions


def assert_traced_alike(session, lens, start, precision):
    origins, directions = beam(lens, start)
    wanted = lens.trace(origins, directions, start=start)
    got = on_device(session, lens, origins, directions, precision, start)
    assert np.isfinite(got.origins).all() and np.isfinite(got.directions).all()
    same = (got.status == wanted.status) & (got.surface == wanted.surface)
    if not same.all():
        assert doubtful(lens, origins, directions, start)[~same].all()
    both = got.passed & wanted.passed
    assert both.sum() > 100
    position, direction = (1e-5, 1e-6) if precision == "single" else (1e-13, 1e-14)
    assert np.abs(got.origins - wanted.origins)[both].max() <= position
    assert np.abs(got.directions - wanted.directions)[both].max() <= direction


@pytest.mark.parametrize("precision", ["single", slow("double")])
@pytest.mark.parametrize("start", ["film", "scene"])
@pytest.mark.parametrize("name", SHAPES)
def test_every_shape(session, name, start, precision):
    shape = replace(SHAPES[name], thickness=4.0, glass=GLASS, semi_diameter=6.0)
    assert_traced_alike(session, Lens(name, (shape, END)), start, precision)


@pytest.mark.parametrize("name", ["ball", "ellipsoid"])
def test_what_passes_beside_a_ball_misses_it_for_certain(session, name):
    asphere = replace(SHAPES["even asphere"], thickness=2.0, glass=GLASS, semi_diameter=6.0)
    ball = Surface(1 / 2.5, 4.0, semi_diameter=6.0, conic=-0.4 if name == "ellipsoid" else 0.0)
    lens = Lens("asphere and ball", (asphere, ball, END))
    assert_traced_alike(session, lens, "scene", "single")
    rays = on_device(session, lens, *beam(lens, "scene"), "single", "scene")
    assert (rays.status == Status.missed).sum() > 100
    assert (rays.status != Status.no_convergence).all()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("start", ["film", "scene"])
def test_tilted_and_decentred_surfaces(session, start, precision):
    tilted = replace(
        SHAPES["toroid"],
        thickness=4.0,
        glass=GLASS,
        semi_diameter=6.0,
        pose=SurfacePose.of((0.5, -0.3, 0.1), (3.0, -5.0, 10.0)),
    )
    assert_traced_alike(
        session, Lens("tilted", (tilted, replace(END, pose=SurfacePose.of((0, 0.2, 0), (0, 2.0, 0))))), start, precision
    )


REGIONS = {
    "rectangle": Region(4, 2),
    "half plane": Region(normal_degrees=30.0, edge=0.5),
    "all but a rectangle": Region(4, 2, inverted=True),
    "half a lens": Region(normal_degrees=30.0, edge=0.5, blocks=False),
    "a lens with a hole": Region(4, 2, blocks=False, inverted=True),
}


def partial(name):
    region = REGIONS[name]
    front = Surface(1 / 20, 4.0, GLASS, 6.0, region=region)
    return Lens(name, (front, Surface(-1 / 30, 2.0, semi_diameter=6.0, region=region), END))


def two_half_lenses():
    half = Region(normal_degrees=90.0, edge=0.0, blocks=False)
    rows = [(1 / 40, GLASS), (0.0, AIR), (1 / 30, GLASS), (-1 / 60, AIR)]
    halves = tuple(Surface(c, 3.0, glass, 6.0, region=half) for c, glass in rows)
    return Lens("two halves", (*halves, Surface(1 / 50, 3.0, GLASS, 8.0), replace(END, semi_diameter=8.0)))


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("start", ["film", "scene"])
@pytest.mark.parametrize("name", REGIONS)
def test_partial_surfaces(session, name, start, precision):
    assert_traced_alike(session, partial(name), start, precision)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("start", ["film", "scene"])
def test_two_half_lenses(session, start, precision):
    assert_traced_alike(session, two_half_lenses(), start, precision)


def test_shaped_stops(session):
    hexagon = StopShape(tuple((math.cos(k * math.pi / 3), math.sin(k * math.pi / 3)) for k in range(6)))
    stop = Surface(0.0, 2.0, semi_diameter=5.0, is_stop=True, stop_shape=hexagon)
    lens = Lens("hexagon", (Surface(1 / 20, 4.0, GLASS, 6.0), stop, END), stop_index=1)
    assert_traced_alike(session, lens, "film", "single")


def test_more_rays_than_a_block_of_several_wavelengths(session, monkeypatch):
    lens = load_lens("achromat-100mm")
    monkeypatch.setattr(traceable_lens, "BLOCK", 2048)
    origins, directions = film_beam(lens, 3000)
    wavelengths = np.resize([486.1, 587.6, 656.3], len(origins))
    wanted = lens.trace(origins, directions, wavelengths)
    got = trace_on_device(lens, session, origins, directions, wavelengths, "film", "single")
    same = (got.status == wanted.status) & (got.surface == wanted.surface)
    assert (~same).mean() < 1e-4
    both = got.passed & wanted.passed
    assert both.mean() > 0.5
    assert np.abs(got.origins - wanted.origins)[both].max() < 6e-5


def test_no_rays_are_no_rays(session):
    none = np.empty((0, 3))
    assert len(trace_on_device(load_lens("dgauss-50mm"), session, none, none, 550.0, "film", "single").status) == 0
