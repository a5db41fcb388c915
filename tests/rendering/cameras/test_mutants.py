"""The lens tests themselves: every deliberate fault in a copy of the kernels, or in what feeds them, fails one of them.

python -m pytest -m slow tests/rendering/cameras/test_mutants.py
"""

from collections.abc import Callable
from dataclasses import replace

import pytest

from rptcam_cl.device.session import Session
from rptcam_cl.rendering.cameras import lens_records as records_of_lenses
from rptcam_cl.rendering.cameras import ray_map, realistic
from rptcam_cl.rendering.cameras.lens_records import LensRecords, lens_records
from rptcam_cl.rendering.cameras.pupil import pupil_sampling
from tests.device.probes import open_session
from tests.device.test_camera_rays import test_round_aperture_is_filled_evenly as aperture
from tests.rendering.cameras import test_exact_optics as exact
from tests.rendering.cameras import test_extremes as extremes
from tests.rendering.cameras import test_invariants as invariants
from tests.rendering.cameras import test_pupil_containment as pupils
from tests.rendering.cameras import test_truth_rays as truth_rays
from tests.support.mutants import Mutant, assert_alive, assert_found, assert_killed, each_mutant

pytestmark = pytest.mark.slow
Test = Callable[[Session], object]


def etendue(session):
    invariants.test_etendue_is_the_same_from_both_sides(session, "dgauss-50mm")


def wide_etendue(session):
    invariants.test_etendue_is_the_same_from_both_sides(session, "wide-22mm")


def rays_of(name, label="d"):
    return lambda session: truth_rays.test_rays_are_those_of_the_truth_table(session, name, label)


def reversal(session):
    invariants.test_rays_sent_back_return_to_their_film_point(session, "dgauss-50mm")


def pass_rate(session):
    pupils.test_the_device_draws_the_pupil_that_its_table_holds(session, "dgauss-50mm")


def snell(session):
    exact.test_snells_law_holds_on_the_ray_that_comes_out(session, "film")


weierstrass = exact.test_the_aplanatic_point_of_a_sphere_is_imaged_sharply_at_every_angle
BALL = exact.test_ball_lens_has_its_spherical_aberration


RIM = "p.x * p.x + p.y * p.y <= surface->semi_diameter2"
NORMAL = "hit.n = f3(-c * hit.p.x, -c * hit.p.y, 1.0f - c * hit.p.z);"
BENDS = "F3 bent = along(scale(d, eta), hit.n, after - eta * hit.cosine);"
TAN = "F3 bent = normalized(along(scale(d, eta), hit.n, hit.cosine - eta * hit.cosine));"
MUTANTS = [
    Mutant(
        "1 cos^3 for cos^4",
        "F weight = own->gain * ray.at.inverse_density * cos2_over_length2 * cos2_over_length2;",
        "F weight = own->gain * ray.at.inverse_density * cos2_over_length2 / sqrt(ray.length2);",
        etendue,  # behind a wide angle of long back focus light falls so steeply that it hardly shows
    ),
    Mutant("2 no root in the pupil", "F rho = sqrt(v);\n#endif\n    Aim a;", "F rho = v;\n#endif\n    Aim a;", etendue),
    Mutant("2 no root in the aperture", "F r = sqrt(v);\n    *x = r * c;", "F r = v;\n    *x = r * c;",
           aperture),
    Mutant("3 diameter for radius", RIM, RIM.replace("<= ", "<= 4 * "), etendue, rays_of("dgauss50")),
    Mutant("4 index off by 1e-3", "F eta = (F)(s->eta);", "F eta = (F)(s->eta + 1e-3f);",
           weierstrass, rays_of("dgauss50"), BALL),
    Mutant("6 normal not flipped", NORMAL, "hit.n = f3(c * hit.p.x, c * hit.p.y, 1.0f - c * hit.p.z);",
           snell, rays_of("dgauss50")),
    Mutant("6 normal of another sign", NORMAL, "hit.n = f3(c * hit.p.x, c * hit.p.y, c * hit.p.z - 1.0f);",
           snell, rays_of("dgauss50")),
    Mutant("19 pupil drawn 2 % too small", "F rho = sqrt(v);\n#endif\n    Aim a;", "F rho = 0.98f * sqrt(v);\n#endif\n    Aim a;",
           pass_rate),
    Mutant("19 weight of a pupil 2 % too small", "lit ? PI_F * o.a", "lit ? 0.96f * PI_F * o.a", etendue),
    Mutant("law of tangents", BENDS, TAN, snell, BALL, weierstrass),
    Mutant("the other root", "F t = f / (g + hit.cosine);", "F t = f / (g - hit.cosine);", snell, BALL),
    Mutant("half the sag", "hit.p = along(q, d, t);",
           "hit.p = f3(q.x + t * d.x, q.y + t * d.y, 0.5f * (q.z + t * d.z));", BALL, snell),
    Mutant("no refusal of total reflection", "*bends = cosine2_after > CRITICAL;",
           "*bends = cosine2_after > -9.0f;",
           lambda s: extremes.test_total_reflection_from_both_sides(s, "film", 1.5, 1.0, "single")),
    Mutant("no refusal of a miss", "hit.met = (discriminant >= 0.0f) & (hit.n.z > 0.0f);", "hit.met = TRUE;",
           lambda s: extremes.test_intersections(s, "start_distance", "single"),
           lambda s: extremes.test_hemispheres_up_to_their_rim(s, "single")),
]  # fmt: skip


@each_mutant(MUTANTS)
def test_fault_in_a_kernel_is_found(mutant):
    assert_found(mutant, open_session())


def stop_wider(lens, *given, **options) -> LensRecords:
    """The stop of the device 1 % wider than that of the lens."""
    stop = lens.stop_index
    surfaces = tuple(
        replace(s, semi_diameter=s.semi_diameter * (1.01 if k == stop else 1)) for k, s in enumerate(lens.surfaces)
    )
    return lens_records(replace(lens, surfaces=surfaces), *given, **options)


def gaps_off_by_a_row(lens, wavelength_nm, start, first_gap_mm, **options) -> LensRecords:
    """Every thickness one row too late."""
    records = lens_records(lens, wavelength_nm, start, first_gap_mm, **options)
    gaps = records.surfaces["gap"].copy()
    records.surfaces["gap"][2:] = gaps[1:-1]
    return records


def indices_off_by_a_row(lens, wavelength_nm, start, first_gap_mm, **options) -> LensRecords:
    """Every ratio of indices one row too late."""
    records = lens_records(lens, wavelength_nm, start, first_gap_mm, **options)
    etas = records.surfaces["eta"].copy()
    records.surfaces["eta"][1:] = etas[:-1]
    return records


def stopped_down_rim_mask(session):
    """Rays through the double Gauss at f/8: 1 % of the stop's radius is 2 % of the light."""
    invariants.test_stopped_down_lens_passes_the_rays_of_the_reference(session)


RECORD_MUTANTS = [
    pytest.param(stop_wider, (stopped_down_rim_mask,), id="5 stop 1 % wider"),
    pytest.param(gaps_off_by_a_row, (rays_of("dgauss50"), rays_of("wide22"), reversal), id="7 thickness off by a row"),
    pytest.param(
        indices_off_by_a_row, (rays_of("dgauss50"), rays_of("cooke50", "F"), reversal), id="index off by a row"
    ),
]


@pytest.mark.parametrize(("fault", "killers"), RECORD_MUTANTS)
def test_fault_in_the_records_of_a_lens_is_found(monkeypatch, fault, killers):
    for module in (records_of_lenses, ray_map):
        monkeypatch.setattr(module, "lens_records", fault)
    assert_killed(killers, open_session())


def test_pupil_table_2_percent_too_small_is_found(monkeypatch):
    def shrunk(*given, **options):
        sampling = pupil_sampling(*given, **options)
        nodes = int(sampling.parameters.across * sampling.parameters.down)
        table = sampling.table.copy()
        table[4 * (nodes + 1) :] *= 0.98  # the radii stand behind the frames
        return replace(sampling, table=table)

    monkeypatch.setattr(realistic, "pupil_sampling", shrunk)
    monkeypatch.setattr(pupils, "pupil_sampling", shrunk)
    contained = [
        lambda _, name=name: pupils.test_no_ray_that_passes_lies_outside_its_pupil(name, "tight")
        for name in ("dgauss-50mm", "wide-22mm", "telephoto-250mm")
    ]
    assert_killed((etendue, wide_etendue, *contained), open_session())


def test_the_killers_let_the_true_kernels_live():
    session = open_session()
    assert_alive(MUTANTS, session)
    for killer in (stopped_down_rim_mask, reversal, rays_of("wide22"), rays_of("cooke50", "F")):
        killer(session)
