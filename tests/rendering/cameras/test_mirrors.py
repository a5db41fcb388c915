"""Lenses with mirrors on the device trace the rays of the reference, and no other lens pays for that.

python -m pytest -m slow tests/rendering/cameras/test_mirrors.py
"""

from functools import cache
from itertools import product

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.optics.files.export import lens_text
from rptcam_cl.optics.library import list_lenses, load_lens
from rptcam_cl.optics.ray_trace import COATED
from rptcam_cl.rendering.cameras.lens_records import lens_records
from rptcam_cl.rendering.traceable_lens import trace_on_device
from tests.device.probes import open_session
from tests.support.cases import one_in
from tests.support.mutants import Mutant, assert_found, each_mutant

RAYS = 4000
# float32 through six surfaces: positions lie up to 100 mm from the axis and a mirror doubles errors of direction.
POINT_MM = {"single": 1e-4, "double": 1e-12}
DIRECTION = {"single": 1e-6, "double": 1e-13}

SYSTEMS = {
    "cassegrain": [
        {"thickness": 60, "diameter": 70, "inner_diameter": 26},
        {"radius": -200, "thickness": -60, "mirror": True, "diameter": 60, "inner_diameter": 20, "conic": -1.05},
        {"radius": -110, "thickness": 70, "mirror": True, "diameter": 26, "conic": -4},
        {"diameter": 30},
    ],
    "mangin mirrors": [
        {"thickness": 80, "diameter": 80, "inner_diameter": 20},
        {"radius": -160, "thickness": 8, "glass": "N-BK7", "diameter": 80},
        {"radius": -230, "thickness": -8, "mirror": True, "stop": True, "diameter": 76, "inner_diameter": 16,
         "tilt_degrees": [0.4, -0.3], "decentre": [0.2, -0.1, 0.05], "coating": {"reflectance": 0.2}},
        {"radius": -160, "thickness": -80, "diameter": 80},
        {"radius": -90, "thickness": 70, "mirror": True, "diameter": 24, "aspheric": {4: 1.0e-7}},
        {"radius": 60, "thickness": 4, "glass": "N-BK7", "diameter": 24},
        {"radius": 50, "diameter": 24},
    ],
    "beside the axis": [
        {"thickness": 80, "diameter": 90, "stop": True, "clear": {"centre": [0, 20], "diameter": 40}},
        {"radius": -200, "thickness": -60, "mirror": True, "diameter": 110, "conic": -1,
         "clear": {"centre": [2, 20], "rectangle": [60, 36], "diameter": 50, "inner_diameter": 6}},
        {"diameter": 60},
    ],
    "folded": [
        {"radius": 120, "thickness": 6, "glass": "N-BK7", "diameter": 40, "decentre": [0, -26, 26],
         "tilt_degrees": [-90, 0, 0]},
        {"radius": -400, "thickness": 20, "diameter": 36, "stop": True, "decentre": [0, -20, 20],
         "tilt_degrees": [-90, 0, 0]},
        {"thickness": -30, "mirror": True, "diameter": 60, "tilt_degrees": [-45, 0, 0]},
        {"radius": -90, "diameter": 40},
    ],
    "one mirror": [{"radius": -200, "conic": -1, "mirror": True, "diameter": 60, "inner_diameter": 12}],
}  # fmt: skip

SCENE = """\
film: {resolution: [40, 40], width_mm: 16}
camera:
  {kind: realistic, lens: %s.yaml, eye: [0, 0, 0], target: [0, 0, -5000], up: [0, 1, 0], focus: {distance_m: 5000}}
render: {max_depth: 1}
materials:
  red: {kind: emissive, radiance: [4, 0, 0]}
  green: {kind: emissive, radiance: [0, 4, 0]}
  blue: {kind: emissive, radiance: [0, 0, 4]}
objects:
  - {shape: sphere, center: [0, 0, -5000], radius: 60, material: red}
  - {shape: sphere, center: [90, 0, -5000], radius: 25, material: green}
  - {shape: sphere, center: [0, 90, -5000], radius: 25, material: blue}
"""


@cache
def system(name):
    fold = {"fold": {"decentre": [0, -26, 26], "tilt_degrees": [-90, 0, 0]}} if name == "folded" else {}
    return rptcam_cl.load_lens({"name": name, "surfaces": SYSTEMS[name], **fold})


def beam(lens, start):
    """Rays over the whole first surface and beyond it, so that some fail for every reason that there is."""
    rng = np.random.default_rng(7)
    if start == "scene":
        origins = np.column_stack([rng.uniform(-45, 45, (RAYS, 2)), np.full(RAYS, -200.0)])
        return origins, np.column_stack([rng.normal(0, 0.01, (RAYS, 2)), np.ones(RAYS)])
    reach = lens.surfaces[-1].semi_diameter * 1.1
    aims = np.column_stack([rng.uniform(-reach, reach, (RAYS, 2)), np.full(RAYS, lens.length)])
    origins = np.column_stack([rng.uniform(-5, 5, (RAYS, 2)), np.full(RAYS, lens.film_z(90.0))])
    return origins, aims - origins


@pytest.mark.parametrize(
    ("name", "start", "precision"), one_in(5, product(SYSTEMS, ["scene", "film"], ("single", "double")))
)
def test_rays_are_those_of_the_reference(session, name, start, precision):
    lens = system(name)
    rays = beam(lens, start)
    expected = lens.trace(*rays, start=start, transmission=COATED)
    found = trace_on_device(lens, session, *rays, 587.5618, start, precision, COATED)
    assert 0.05 < expected.passed.mean() < 0.95
    np.testing.assert_array_equal(found.status, expected.status)
    np.testing.assert_array_equal(found.surface, expected.surface)
    np.testing.assert_allclose(found.origins, expected.origins, atol=POINT_MM[precision])
    np.testing.assert_allclose(found.directions, expected.directions, atol=DIRECTION[precision])
    np.testing.assert_allclose(found.transmittance, expected.transmittance, atol=5e-7)


@pytest.mark.parametrize("start", ["scene", "film"])
def test_rays_of_several_wavelengths_are_those_of_the_reference(session, start):
    lens = system("mangin mirrors")
    rays, wavelengths = beam(lens, start), np.linspace(420, 680, RAYS)
    expected = lens.trace(*rays, wavelengths, start=start)
    found = lens.trace(*rays, wavelengths, start, session)
    good = expected.passed & found.passed
    assert np.count_nonzero(found.status != expected.status) < 4  # a rim that float32 sees on the other side
    np.testing.assert_allclose(found.origins[good], expected.origins[good], atol=POINT_MM["single"])
    np.testing.assert_allclose(found.directions[good], expected.directions[good], atol=DIRECTION["single"])


def test_only_lenses_with_mirrors_or_rings_have_code_for_them():
    for name in list_lenses():
        lens = load_lens(name)
        facts = lens_records(lens, 587.5618, "film", 1.0).facts
        assert (facts["LENS_MIRROR"], facts["LENS_RING"]) == (lens.has_mirrors, lens.is_obstructed)


def reference(session):
    test_rays_are_those_of_the_reference(session, "mangin mirrors", "film", "single")


MUTANTS = [
    Mutant("no hole", "within = within & (p.x * p.x + p.y * p.y >= surface->inner_semi_diameter2);", "", reference),
    Mutant("half a reflection", "bent = along(v, hit.n, -2.0f * hit.cosine);",
           "bent = along(v, hit.n, -1.9f * hit.cosine);", reference),
    Mutant("z as before the mirror", "path->p.z = -path->p.z;", "", reference),
    Mutant("a failed ray left behind", "path->stopped_p.z = -path->stopped_p.z;", "", reference),
    Mutant("a mirror that takes nothing",
           "path->share *= over_wavelength(s->gain, s->gain_table, stop, path->wavelength);",
           "", reference),
]  # fmt: skip


@pytest.mark.slow
@each_mutant(MUTANTS)
def test_fault_in_a_kernel_is_found(mutant):
    assert_found(mutant, open_session())


@pytest.mark.slow
def test_a_folded_lens_takes_the_picture_of_the_straight_one(tmp_path):
    """A plane mirror at 45 degrees turns film and axis together, so that pictures are the same, within the noise."""
    folded = lens_text(system("folded"))
    straight = lens_text(rptcam_cl.load_lens({"name": "straight", "surfaces": [
        {"radius": 120, "thickness": 6, "glass": "N-BK7", "diameter": 40},
        {"radius": -400, "thickness": 50, "diameter": 36, "stop": True},
        {"diameter": 40},
    ]}))  # fmt: skip
    pictures = []
    for name, text in (("folded", folded), ("straight", straight)):
        (tmp_path / f"{name}.yaml").write_text(text)
        (tmp_path / "scene.yaml").write_text(SCENE % name)
        pictures.append(rptcam_cl.render(tmp_path / "scene.yaml", spp=16, seed=3).pixels)
    red, green, blue = (pictures[0][..., k] for k in range(3))
    rows, columns = np.indices(red.shape)
    middle = [[np.average(at, weights=layer) for at in (rows, columns)] for layer in (red, green, blue)]
    assert middle[1][1] > middle[0][1] + 5 and abs(middle[1][0] - middle[0][0]) < 1  # green to the right
    assert middle[2][0] < middle[0][0] - 5 and abs(middle[2][1] - middle[0][1]) < 1  # blue above
    # The sampler of the pupil knows no symmetry of posed surfaces, so that the noise differs.
    np.testing.assert_allclose(pictures[0].mean(), pictures[1].mean(), rtol=0.02)
    other = [[np.average(at, weights=pictures[1][..., k]) for at in (rows, columns)] for k in range(3)]
    np.testing.assert_allclose(middle, other, atol=0.1)
