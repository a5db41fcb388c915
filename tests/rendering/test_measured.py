"""Measured materials: tables of MERL against formulas and their cells in float64, tensor files of RGL likewise."""

import struct

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.measured import directions, read_measured, tensor_brdf
from tests.device.scattering import direction, scatter
from tests.device.test_bsdf_sampling import COUNT, LEVEL, agreement, numbers
from tests.rendering.layers.scenes import one_sample
from tests.rendering.pictures import flat_mean, looking, scene_of, seed_of
from tests.support.statistics import Z

MERL = (90, 90, 180)
SCALE = np.array([1.0, 1.15, 1.66]) / 1500
ALPHA = 0.3


def glossy(wi, wo):
    """Facets of GGX over an even base, whose three channels differ."""
    half = wi + wo
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    density = ALPHA**2 / (np.pi * (half[..., 2] ** 2 * (ALPHA**2 - 1) + 1) ** 2)
    steep = (1 - np.sum(wi * half, axis=-1)) ** 5
    facets = (0.04 + 0.96 * steep) * density / 4
    base = np.array([0.5, 0.3, 0.1]) / np.pi
    return base + facets[..., None] * np.array([1.0, 0.8, 0.6])


def lambert(wi, wo):
    return np.broadcast_to(np.array([0.9, 0.5, 0.2]) / np.pi, (*wi.shape[:-1], 3))


def blinn(wi, wo):
    """Blinn's lobe of the half vector, which is symmetric: cos^20 over an even base."""
    half = wi + wo
    cosine = half[..., 2] / np.linalg.norm(half, axis=-1)
    return (0.2 + cosine**20)[..., None] * np.array([0.3, 0.2, 0.1])


def merl(values):
    return struct.pack("<3i", *MERL) + np.moveaxis(values / SCALE, -1, 0).astype("<f8").tobytes()


def tensors(**fields):
    """A tensor file, as RGL writes it."""
    size = 18 + sum(13 + len(name) + 8 * value.ndim for name, value in fields.items())
    head, body = b"tensor_file\0\x01\0" + struct.pack("<I", len(fields)), b""
    for name, value in fields.items():
        kind = {"float32": 10, "uint8": 1}[value.dtype.name]
        head += struct.pack("<H", len(name)) + name.encode() + struct.pack("<HBQ", value.ndim, kind, size + len(body))
        head += struct.pack(f"<{value.ndim}Q", *value.shape)
        body += value.tobytes()
    return head + body


def tensor_fields(brdf):
    """Fields of a tensor file of a formula, whose density over the square is even."""
    theta, steps = np.linspace(0, 1.5, 24), (np.arange(48)) / 47
    u, v, t = np.meshgrid(steps, steps, theta, indexing="ij")
    wi = np.stack([np.sin(t), 0 * t, np.cos(t)], axis=-1)
    tilt, turn = u**2 * np.pi / 2, (2 * v - 1) * np.pi
    half = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=-1)
    wo = 2 * np.sum(wi * half, axis=-1, keepdims=True) * half - wi
    light = np.moveaxis(brdf(wi, wo) * np.maximum(wo[..., 2:], 0.05), (0, 1, 2, 3), (3, 2, 0, 1))[None]
    even = np.ones((1, len(theta), 2, 2), np.float32)
    return {
        "phi_i": np.zeros(1, np.float32), "theta_i": theta.astype(np.float32), "vndf": even,
        "ndf": even[0, 0], "sigma": even[0, 0], "rgb": light.astype(np.float32), "jacobian": np.zeros(1, np.uint8),
    }  # fmt: skip


def cell_values(table, wi, wo):
    """A table at directions, linear between the middles of cells, in float64."""
    half = (wi + wo) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
    turn, tilt = np.arctan2(half[:, 1], half[:, 0]), np.arccos(np.minimum(half[:, 2], 1))
    x = wi[:, 0] * np.cos(turn) + wi[:, 1] * np.sin(turn)
    y = wi[:, 1] * np.cos(turn) - wi[:, 0] * np.sin(turn)
    x, z = x * np.cos(tilt) - wi[:, 2] * np.sin(tilt), wi[:, 2] * np.cos(tilt) + x * np.sin(tilt)
    places = np.stack(
        [np.sqrt(2 * tilt / np.pi), 2 * np.arccos(np.clip(z, -1, 1)) / np.pi, np.arctan2(y, x) / np.pi % 1]
    )
    sizes = np.array(table.shape[:3])[:, None]
    at = places * sizes - 0.5
    at[:2] = np.clip(at[:2], 0, sizes[:2] - 1)
    low = np.floor(at).astype(int)
    total = 0.0
    for corner in np.ndindex(2, 2, 2):
        index = low + np.array(corner)[:, None]
        weight = np.prod(np.abs(1 - np.array(corner)[:, None] - (at - low)), axis=0)
        index = [np.minimum(index[0], sizes[0] - 1), np.minimum(index[1], sizes[1] - 1), index[2] % sizes[2]]
        total = total + weight[:, None] * table[*index]
    return total


@pytest.fixture
def rough(tmp_path, monkeypatch):
    """A table of MERL that differs from cell to cell, as a material, and its values."""
    monkeypatch.chdir(tmp_path)
    wi, wo = directions(MERL)
    wild = np.random.default_rng(seed_of("measured")).uniform(0.8, 1.2, (*MERL, 3))
    values = glossy(wi, wo) * wild
    (tmp_path / "rough.binary").write_bytes(merl(values))
    return {"kind": "measured", "file": "rough.binary"}, values


def pairs(name, count=4096):
    """Pairs of directions over the upper half sphere."""
    rng = np.random.default_rng(seed_of(name))
    return direction(rng.uniform(0.05, 1, count), rng.random(count)), direction(
        rng.uniform(0.05, 1, count), rng.random(count)
    )


@pytest.mark.parametrize(("formula", "most"), [(lambert, 1e-6), (blinn, 4e-3)])
def test_a_table_of_a_formula_reflects_as_the_formula(session, tmp_path, monkeypatch, formula, most):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.binary").write_bytes(merl(formula(*directions(MERL))))
    wi, wo = pairs("formula")
    got = scatter(session, {"kind": "measured", "file": "own.binary"}, wi, wo)
    expected = formula(wi, wo) * wo[:, 2:]
    assert np.abs(got.value - expected).max() < most * expected.max()  # of Blinn's: between the middles of cells


def test_values_are_those_of_the_cells_either_way_and_samples_follow_their_density(session, rough):
    material, values = rough
    wi, wo = pairs("cells")
    there = scatter(session, material, wi, wo).value / wo[:, 2:]
    back = scatter(session, material, wo, wi).value / wi[:, 2:]
    np.testing.assert_allclose(there, cell_values(values, wi, wo), rtol=2e-3)
    np.testing.assert_allclose(there, back, rtol=2e-3)
    for cosine in (1.0, 0.6, 0.15):
        view = direction(cosine, 0.05)
        got = scatter(session, material, view, numbers=numbers("measured"))
        p, more = agreement(session, got, material, view)
        assert p > LEVEL and abs(more) < Z * 0.5 * np.sqrt(COUNT), (cosine, p, more)
        spread = got.sampled_pdf > 0
        again = scatter(session, material, view, got.direction[spread][:4096])
        expected = again.value / again.pdf[:, None]
        np.testing.assert_allclose(got.weight[spread][:4096], expected, rtol=3e-3, atol=1e-6)


@pytest.mark.slow
def test_each_of_mixed_lanes_has_its_own_material(tmp_path, monkeypatch):
    # strips narrower than a wave's lanes, beside pictures in which all strips are of one material
    monkeypatch.chdir(tmp_path)
    (tmp_path / "blinn.binary").write_bytes(merl(blinn(*directions(MERL))))
    (tmp_path / "glossy.bsdf").write_bytes(tensors(**tensor_fields(glossy)))
    film = {"thickness_nm": 350, "index": 1.4}
    materials = [
        {"kind": "measured", "file": "blinn.binary"},
        {"kind": "principled", "base_color": 0.6, "roughness": 0.7, "thin_film": film},
        {"kind": "matte", "reflectance": [0.2, 0.6, 0.4]},
        {"kind": "measured", "file": "glossy.bsdf"},
        {"kind": "principled", "base_color": [0.9, 0.5, 0.2], "metallic": 1.0, "roughness": 0.6,
         "thin_film": {"thickness_nm": 600, "index": 2}},
        {"kind": "principled", "base_color": 0.3, "roughness": 0.5, "clearcoat": 1.0},
        {"kind": "conductor", "reflectance": 0.8, "alpha": 0.4},
    ]  # fmt: skip
    specks = [{"shape": "sphere", "center": [100, k, 0], "radius": 1e-3, "material": each}
              for k, each in enumerate(materials)]  # fmt: skip

    def picture(order):
        strips = [
            {"shape": "rectangle", "corner": [-1 + k / 32, -1, 0], "edge_u": [1 / 32, 0, 0], "edge_v": [0, 2, 0],
             "material": materials[order(k)]} for k in range(64)
        ]  # fmt: skip
        sun = {"kind": "directional", "direction": [0.3, 0.2, -0.9], "irradiance": [1.0] * 3}
        camera = looking([0.5, -1.5, 2], [0, 0, 0], fov=35)
        scene = scene_of([*strips, *specks], camera, depth=2, lights=[sun], resolution=(64, 64))
        image = one_sample(scene, ["object_id"], seed=seed_of("lanes"))
        return np.asarray(image), image["object_id"]

    mixed, strip = picture(lambda k: k % len(materials))
    for index in range(len(materials)):
        alone, _ = picture(lambda _: index)  # noqa: B023, called at once
        own = (strip >= 0) & (strip < 64) & (strip % len(materials) == index)
        assert own.sum() > 100 and alone[own].min() > 0
        np.testing.assert_array_equal(mixed[own], alone[own])


@pytest.mark.slow
def test_light_of_a_sun_is_that_of_the_table(rough):
    material, values = rough
    towards = np.array([0.6, 0.3, 0.9]) / np.linalg.norm([0.6, 0.3, 0.9])
    sun = {"kind": "directional", "direction": (-towards).tolist(), "irradiance": [1.0] * 3}
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": material}
    scene = scene_of([ball], looking([0, -4, 2], [0, 0, 0], fov=30), depth=2, lights=[sun], resolution=(96, 96))
    image = one_sample(scene, ["position", "geometric_normal", "object_id"], seed=seed_of("sun"))
    seen = image["object_id"] == 0
    n = image["geometric_normal"][seen].astype(np.float64)
    eye = np.array([0, -4, 2]) - image["position"][seen]
    eye /= np.linalg.norm(eye, axis=1, keepdims=True)
    # a frame about each normal: the table has no direction of its own
    x = np.cross(n, [0.3, 0.5, 0.8])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    frame = np.stack([x, np.cross(n, x), n], axis=1)
    wi, wo = frame @ towards, np.einsum("nij,nj->ni", frame, eye)
    clear = (wi[:, 2] > 0.05) & (wo[:, 2] > 0.05)
    expected = cell_values(values, wo[clear], wi[clear]) * wi[clear][:, 2:]
    assert clear.sum() > 1000
    np.testing.assert_allclose(np.asarray(image)[seen][clear], expected, rtol=2e-3, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("cosine", [1.0, 0.3])
def test_even_light_gives_the_albedo_of_the_table(rough, cosine):
    material, values = rough
    sheet = {"shape": "rectangle", "corner": [-50, -50, 0], "edge_u": [100, 0, 0], "edge_v": [0, 100, 0]}
    eye = np.array([0, -np.sqrt(1 - cosine**2), cosine])
    camera = looking((9 * eye).tolist(), [0, 0, 0], fov=0.01, up=(0, 1, 0))
    sky = {"kind": "constant", "radiance": 1.0}
    scene = scene_of([sheet | {"material": material}], camera, depth=2, environment=sky)
    mean, error = flat_mean(scene, f"albedo {cosine}", spp=64)
    z, turn = np.meshgrid((np.arange(600) + 0.5) / 600, (np.arange(600) + 0.5) / 600 * 2 * np.pi)
    wo = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=-1).reshape(-1, 3)
    expected = 2 * np.pi * np.mean(cell_values(values, np.broadcast_to(eye, wo.shape), wo) * wo[:, 2:], axis=0)
    np.testing.assert_allclose(mean, expected, atol=4 * error.max() + 2e-3 * expected.max())


def test_a_tensor_file_is_sampled_to_its_formula():
    table = read_measured(tensors(**tensor_fields(glossy)))
    first, second = directions(table.values.shape[:3])
    clear = np.minimum(first[..., 2], second[..., 2]) > 0.3
    off = table.values[clear] / glossy(first, second)[clear] - 1
    assert np.sqrt(np.mean(off**2)) < 0.01
    # along the normal, by quadrature
    z, turn = (np.arange(2000) + 0.5) / 2000, np.zeros(2000)
    up = np.broadcast_to([0.0, 0.0, 1.0], (2000, 3))
    albedo = 2 * np.pi * np.mean(glossy(up, direction(z, turn)) * z[:, None], axis=0)
    np.testing.assert_allclose(table.albedo, albedo, rtol=0.02)
    assert 0.2 < table.alpha < 0.45


def changed(**changes):
    return lambda fields: {name: value for name, value in (fields | changes).items() if value is not None}


NOT_A_NUMBER = np.full((2, 2), np.nan, np.float32)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (changed(phi_i=np.linspace(0, 3, 4, dtype=np.float32)), "direction of its own"),
        (changed(sigma=None), "lacks sigma"),
        (changed(rgb=None), "lacks spectra, wavelengths"),
        (changed(ndf=NOT_A_NUMBER), "not finite"),
        (changed(ndf=NOT_A_NUMBER[0]), r"ndf has the shape \(2,\)"),
        (changed(theta_i=np.zeros(24, np.float32)), "theta_i does not ascend"),
        (changed(theta_i=np.arange(23, dtype=np.float32)), "shape"),
    ],
)
def test_a_tensor_file_that_is_none_says_why(change, says):
    with pytest.raises(InputError, match=says):
        read_measured(tensors(**change(tensor_fields(lambert))))


def test_a_broken_file_says_what_it_is():
    whole = tensors(**tensor_fields(lambert))
    for size in (14, 16, 18, 60, 200, len(whole) - 1):
        with pytest.raises(InputError, match=r"no whole tensor file|no tensor file"):
            read_measured(whole[:size])
    good = merl(np.ones((*MERL, 3)))
    for content in (b"", b"P6 3 3", good[:-8], good + b"\0", struct.pack("<3i", 90, 90, 90) + good[12:]):
        with pytest.raises(InputError, match=r"no measured reflection \(allowed: MERL"):
            read_measured(content)
    for number in (np.nan, np.inf, 1e30):
        with pytest.raises(InputError, match=r"not finite|no reflection"):
            read_measured(good[:12] + struct.pack("<d", number) + good[20:])


# of Mitsuba 3.9's `measured` for the file of the next test, as spectra of three wavelengths, times the cosine
MITSUBA = [
    [0.16447286307811737, 0.2452443391084671, 0.16366563737392426],
    [0.3110998868942261, 0.28001099824905396, 0.23137027025222778],
    [0.24352829158306122, 0.19313418865203857, 0.23574714362621307],
]


def test_a_tensor_file_is_read_as_mitsuba_reads_it():
    rng = np.random.default_rng(3)
    even = (0.5 + np.tile(rng.random((1, 6)), (2, 1))).astype(np.float32)
    fields = {
        "phi_i": np.zeros(1, np.float32), "theta_i": np.linspace(0, 1.5, 3, dtype=np.float32), "ndf": even,
        "sigma": even[:, ::-1].copy(), "vndf": (0.3 + rng.random((1, 3, 5, 5))).astype(np.float32),
        "rgb": (0.2 + rng.random((1, 3, 3, 5, 5))).astype(np.float32), "jacobian": np.ones(1, np.uint8),
    }  # fmt: skip
    wi = np.array([[0.3, 0.1, 0.9], [-0.5, 0.6, 0.4], [0.1, -0.9, 0.2]])
    wo = np.array([[-0.2, 0.4, 0.8], [0.7, 0.1, 0.6], [-0.3, -0.2, 0.5]])
    wi, wo = (each / np.linalg.norm(each, axis=1, keepdims=True) for each in (wi, wo))
    np.testing.assert_allclose(tensor_brdf(fields, wi, wo) * wo[:, 2:], MITSUBA, rtol=2e-5)
