"""Three ways to carry the colour of light: where nothing disperses and nothing but RGB is known, they agree."""

import numpy as np
import pytest
from scipy import stats

import rptcam_cl
from rptcam_cl.core.colour import WAVELENGTHS_NM
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device.session import Session
from rptcam_cl.optics.irradiance import on_axis_irradiance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering import tracer
from rptcam_cl.rendering.plan.plan import WAVELENGTH_CELLS, least_noise, make_plan, primary_spectra, wavelength_table
from rptcam_cl.scene.load import load_scene
from tests.device.probes import open_session
from tests.rendering.pictures import WHITE, batches, bits, looking, pixels, scene_of, seed_of
from tests.rendering.spectrum.scenes import SINGLET_BACK_MM, paper_camera, room, singlet, white_wall
from tests.support.cases import fast, slow
from tests.support.statistics import Z, assert_equivalent, assert_same_tiles, chi_squared

SMALL = {"resolution": (48, 32)}
GLASS_BALL = {"kind": "dielectric", "glass": "SF11"}
FORCED = {mode: {"mode": mode, "lens": "on"} for mode in ("dispersive", "spectral")}


@pytest.mark.slow  # the next test shows that the programs are the same
def test_dispersive_without_dispersion_is_rgb_to_the_bit():
    plans = [make_plan(load_scene({**room(**SMALL), "spectrum": mode})) for mode in ("rgb", "dispersive")]
    assert plans[0].facts == plans[1].facts
    assert plans[0].facts["SPECTRUM"] == 0
    pictures = [rptcam_cl.render({**room(**SMALL), "spectrum": mode}, spp=8) for mode in ("rgb", "dispersive")]
    assert bits(pictures[0]) == bits(pictures[1])


class EnoughError(Exception):
    """All programs of a render have been asked for."""


def test_programs_of_dispersive_without_dispersion_are_those_of_rgb(monkeypatch):
    built = []

    def program(self, files, facts, declarations=""):
        built.append((files, dict(facts), declarations))

    def bind(self, *_, **__):
        raise EnoughError

    monkeypatch.setattr(Session, "program", program)
    monkeypatch.setattr(Session, "bind", bind)
    sources = []
    for mode in ("rgb", "dispersive", "spectral"):
        built.clear()
        with pytest.raises(EnoughError):
            rptcam_cl.render({**room(**SMALL), "spectrum": mode}, spp=1)
        sources.append(list(built))
    assert sources[0] == sources[1] != sources[2]
    assert [files for files, _, _ in sources[0]] == [["pass/stream.cl"]]  # which makes the rays of a pinhole itself
    assert all(declarations == device_declarations() for _, _, declarations in sources[0])


def one_reflection():
    """Colours and mirrors under a white sky: every path reflects once."""
    checker = {"kind": "checker", "even": [0.9, 0.2, 0.1], "odd": [0.1, 0.3, 0.8], "scale": [2, 2]}
    floor = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}
    balls = (
        {"kind": "matte", "reflectance": [0, 1, 0]},
        {"kind": "mirror", "reflectance": [0.8, 0.9, 0.1]},
        {"kind": "conductor", "reflectance": [1, 0.6, 0.2], "alpha": 0.2},
        {"kind": "dielectric", "index": 1.5},
    )
    objects = [{**floor, "material": {"kind": "matte", "reflectance": checker}}]
    objects += [
        {"shape": "sphere", "center": [1.1 * place - 1.6, 0, 0.5], "radius": 0.5, "material": material}
        for place, material in enumerate(balls)
    ]
    lights = [{"kind": "directional", "direction": [0.3, 0.5, -1], "irradiance": 2.0}]
    camera = looking([0, -4, 2], [0, 0, 0.3], fov=50)
    return scene_of(objects, camera, lights=lights, environment=WHITE, depth=2, resolution=(48, 32))


@pytest.mark.slow
def test_colours_that_reflect_white_light_once_are_the_same_in_spectra():
    scene = one_reflection()
    found = {mode: batches({**scene, "spectrum": mode}, f"once {mode}", 8, spp=64) for mode in ("rgb", "spectral")}
    assert_same_tiles(found["rgb"], found["spectral"])
    tinted = batches({**scene, "environment": {**WHITE, "radiance": [1.0, 0.98, 1.0]}}, "once tinted", 8, spp=64)
    with pytest.raises(AssertionError):
        assert_same_tiles(found["rgb"], tinted)


@pytest.mark.slow
def test_grey_scenes_are_the_same_in_spectra_however_often_light_is_reflected():
    scene = room(**SMALL)
    grey = {"kind": "matte", "reflectance": 0.6}
    for place, thing in enumerate(scene["objects"]):
        lamp = thing["material"]["kind"] == "emissive"
        thing["material"] = (
            {"kind": "emissive", "radiance": 6.0} if lamp else [grey, GREYS[place // 2 % len(GREYS)]][place % 2]
        )
    scene |= {"lights": [], "environment": {**WHITE, "radiance": 0.2}}
    found = {mode: batches({**scene, "spectrum": mode}, f"grey {mode}", 8, spp=64) for mode in ("rgb", "spectral")}
    assert_same_tiles(found["rgb"], found["spectral"])


GREYS = (
    {"kind": "plastic", "reflectance": 0.5, "roughness": 0.4},
    {"kind": "conductor", "reflectance": 0.9, "roughness": 0.4},
    {"kind": "dielectric", "index": 1.5, "roughness": 0.3},
    {"kind": "principled", "base_color": 0.5, "roughness": 0.5, "sheen": 0.4},
    {"kind": "principled", "base_color": 0.5, "sheen": {"kind": "gradient", "start": 0.4, "end": 0.4}},
)


@pytest.mark.slow
def test_colours_come_back_from_their_spectra_in_pictures():
    cube = [[r, g, b] for r in (0.0, 0.5, 1.0) for g in (0.0, 0.5, 1.0) for b in (0.0, 0.5, 1.0)]
    patches = [
        {"shape": "rectangle", "corner": [place % 9 * 8, place // 9 * 8, 0], "edge_u": [8, 0, 0], "edge_v": [0, 8, 0],
         "material": {"kind": "matte", "reflectance": colour}}
        for place, colour in enumerate(cube)
    ]  # fmt: skip
    camera = {"kind": "pinhole", "eye": [36, 12, 1000], "target": [36, 12, 0], "up": [0, 1, 0]}
    camera["fov_degrees"] = 2 * np.degrees(np.arctan(0.036))
    scene = scene_of(patches, camera, environment=WHITE, depth=2, resolution=(72, 24), spectrum="spectral")
    film = pixels(scene, seed=seed_of("patches"), spp=1024)[::-1].reshape(3, 8, 9, 8, 3).transpose(0, 2, 1, 3, 4)
    each = film.reshape(27, 64, 3)
    mean, error = each.mean(axis=1), each.std(axis=1, ddof=1) / 8
    assert_equivalent(mean, error, np.array(cube), 0.001)


@pytest.mark.slow
@pytest.mark.parametrize("mode", FORCED)
def test_lens_of_hardly_any_dispersion_gives_the_picture_of_rgb(mode):
    def picture(spectrum, v, name):
        ball = {"shape": "sphere", "center": [0.15, 0, -18], "radius": 0.8, "material": {"kind": "emissive"}}
        ball["material"]["radiance"] = 1.0 if mode == "spectral" else [1.0, 0.5, 2.0]
        camera = paper_camera(singlet(v, 0.1), SINGLET_BACK_MM[15])
        film = {"size_mm": [0.45, 0.3]}
        scene = scene_of([ball], camera, depth=1, film=film, metres_per_unit=1e-3, spectrum=spectrum, **SMALL)
        return batches(scene, name, 6, spp=64)

    rgb = picture("rgb", 1e9, f"rgb {mode}")
    assert_same_tiles(rgb, picture(FORCED[mode], 1e9, f"huge v {mode}"))
    with pytest.raises(AssertionError):
        assert_same_tiles(rgb, picture(FORCED[mode], 10, f"v 10 {mode}"))


@pytest.mark.parametrize(
    ("sampler", "v"),
    [("lattice", 3), *(slow("lattice", v) for v in (200, 10)), *(slow("independent", v) for v in (200, 10, 3))],
)
@pytest.mark.parametrize("mode", fast(["dispersive"], FORCED))
def test_white_wall_stays_white(mode, v, sampler):
    scene = white_wall(singlet(v), SINGLET_BACK_MM[15], spectrum=FORCED[mode], **SMALL)
    scene["film"]["size_mm"] = [0.006, 0.004]  # on the axis
    scene["render"]["sampler"] = sampler
    film = pixels(scene, seed=seed_of(f"white {mode} {v} {sampler}"), spp=2048).reshape(-1, 3)
    error = film.std(axis=0, ddof=1) / np.sqrt(len(film))
    if sampler == "lattice":
        assert_equivalent(film.mean(axis=0), error, 1.0, 0.002)
    else:
        assert (np.abs(film.mean(axis=0) - 1) < Z * error).all()
        assert error.max() < 2e-3


def test_exposure_divides_out_the_colour_that_a_lens_has_on_its_axis():
    prescription = singlet(3, 0.1)
    prescription["surfaces"][0]["thickness"] = 2.0  # so that the stop in front is seen through much glass
    lens, film_distance_mm = load_lens(prescription), 2.0
    nodes = np.linspace(380, 780, 41)
    shares = [
        on_axis_irradiance(lens, film_distance_mm, nm) / on_axis_irradiance(lens, film_distance_mm, 587.5618)
        for nm in nodes
    ]
    tint = np.interp(WAVELENGTHS_NM, nodes, shares) @ primary_spectra()
    assert np.ptp(tint) > 0.05
    found = {}
    for exposure in ("irradiance", "relative"):
        scene = white_wall(prescription, film_distance_mm, spectrum=FORCED["dispersive"], exposure=exposure, **SMALL)
        scene["film"]["size_mm"] = [0.006, 0.004]
        film = pixels(scene, seed=seed_of(exposure), spp=1024).reshape(-1, 3)
        found[exposure] = film.mean(axis=0), film.std(axis=0, ddof=1) / np.sqrt(len(film))
    assert_equivalent(*found["relative"], 1.0, 0.003)
    mean, error = (values / on_axis_irradiance(lens, film_distance_mm, 587.5618) for values in found["irradiance"])
    assert_equivalent(mean, error, tint, 0.004)


@pytest.mark.parametrize(
    ("mode", "glass"),
    [
        pytest.param("dispersive", GLASS_BALL, id="dispersive SF11", marks=pytest.mark.slow),
        pytest.param("spectral", GLASS_BALL, id="spectral SF11"),
        *(pytest.param(mode, glass, id=f"{mode} {name}", marks=pytest.mark.slow)
          for mode in FORCED for name, glass in {"matte": None, "rough": {**GLASS_BALL, "roughness": 0.4}}.items()),
    ],
)  # fmt: skip
@pytest.mark.parametrize("seen_by", ["pinhole", slow("lens")])
def test_white_furnace_is_white(mode, glass, seen_by):
    ball = {"shape": "sphere", "center": [0, 0, -15], "radius": 1, "material": glass or {"kind": "matte"}}
    ball["material"].setdefault("reflectance", 1.0) if glass is None else None
    camera = {"kind": "pinhole", "eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 9}
    if seen_by == "lens":
        camera = paper_camera(singlet(3), SINGLET_BACK_MM[15])
    film, rough = {"size_mm": [0.04, 0.03]}, glass and "roughness" in glass  # on the axis
    scene = scene_of([ball], camera, environment=WHITE, depth=100, metres_per_unit=1e-3, film=film,
                     resolution=(16, 12), spectrum=FORCED[mode], exposure="relative")  # fmt: skip
    seed = seed_of(f"furnace {mode} {glass} {seen_by}")
    seen = pixels(scene, seed=seed, spp=16384 if rough else 4096).reshape(-1, 3)
    if rough:  # one scattering of a rough surface loses light, of each colour the same share
        seen = seen / seen.mean(axis=1, keepdims=True)
    error = seen.std(axis=0, ddof=1) / np.sqrt(len(seen))
    assert_equivalent(seen.mean(axis=0), error, 1.0, 0.005)


@pytest.mark.slow
def test_organisations_and_widths_agree(monkeypatch):
    glass = {**room(GLASS_BALL, **SMALL), "spectrum": "spectral"}
    lens = white_wall(singlet(3), SINGLET_BACK_MM[15], spectrum=FORCED["spectral"], **SMALL)
    dispersive = {**room(GLASS_BALL, **SMALL), "spectrum": "dispersive"}
    for scene in (glass, lens, dispersive):
        shown = {}
        for lanes in (1, 8, 16):
            monkeypatch.setattr(Session, "lanes", lanes)
            session = open_session()
            for organisation in ("passes", "stream"):
                monkeypatch.setattr(tracer, "ORGANISATION", {"cpu": organisation, "gpu": organisation})
                shown[lanes, organisation] = pixels(scene, spp=8, seed=5, device=session)
        for other in shown.values():
            assert np.isclose(other, shown[8, "stream"], rtol=1e-5, atol=1e-6).mean() > 0.98


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["dispersive", slow("spectral")])
def test_resumed_picture_has_the_bits_of_the_whole(mode, tmp_path):
    scene = {**room(GLASS_BALL, **SMALL), "spectrum": mode}
    whole = rptcam_cl.render(scene, spp=19, seed=4)
    state = tmp_path / "a.rpck"
    for spp in (5, 19):
        part = rptcam_cl.render(scene, spp=spp, seed=4, checkpoint=state, resume=True)
    assert bits(part) == bits(whole)


def test_weights_of_all_wavelengths_average_to_one():
    spectra = primary_spectra()
    np.testing.assert_allclose(spectra.sum(axis=0), 1)
    assert (spectra >= 0).all()
    for low, high in ((380, 780), (420.5, 699.2)):
        table = wavelength_table(spectra, least_noise(spectra), low, high)
        assert table.shape == (WAVELENGTH_CELLS + 1, 4)
        np.testing.assert_allclose(table[:-1, 1:].mean(axis=0), 1, rtol=1e-6)
        assert (np.diff(table[:, 0]) > 0).all()
        assert table[0, 0] == low
        assert table[-1, 0] == np.float32(high)
    seen = make_plan(load_scene({**room(GLASS_BALL, **SMALL), "spectrum": "dispersive"})).spectrum.table
    np.testing.assert_allclose(seen.reshape(-1, 4)[:-1, 1:].mean(axis=0), 1, rtol=3e-6)


def test_wavelengths_are_drawn_by_their_density():
    spectra = primary_spectra()
    density = least_noise(spectra)
    table = wavelength_table(spectra, density, 380, 780)
    samples = np.random.default_rng(1).random(200_000)
    starts = table[:, 0].astype(float)
    place = samples * WAVELENGTH_CELLS
    cell = place.astype(int)
    drawn = starts[cell] + (place - cell) * np.diff(starts)[cell]
    edges = np.linspace(420, 680, 66)  # beyond, cells are wider than these
    integral = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2)])
    expected = np.diff(np.interp(edges, WAVELENGTHS_NM, integral / integral[-1]))
    counted, _ = np.histogram(drawn, edges)
    assert chi_squared(counted, expected * len(drawn)) > 1e-4
    even = np.full(65, len(drawn) / 65)
    assert chi_squared(counted, even) < 1e-4
    assert stats.kstest(samples, "uniform").pvalue > 1e-4
