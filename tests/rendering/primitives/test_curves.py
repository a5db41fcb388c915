"""Curves: rays meet them where float64 says, hair gives back all light, and what cannot be read is refused in words."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.shapes import bezier_pieces
from rptcam_cl.studies.selfcheck import TracedScene
from tests.rendering.primitives.trees import with_tree
from tests.support.cases import slow

WHITE_HAIR = {"kind": "hair", "reflectance": 1, "roughness": 0.2, "roughness_across": 0.4}


def strands(rng, count, points=5, width=0.05):
    """Strands in a box of half side 1: rows of x, y, z and width."""
    starts, steps = rng.uniform(-0.8, 0.8, (count, 1, 3)), rng.normal(scale=0.2, size=(count, points, 3))
    widths = rng.uniform(0.2, 1, (count, points, 1)) * width
    return np.concatenate([starts + np.cumsum(steps, axis=1), widths], axis=2)


def nearest(o, d, controls, widths):
    """Distance along a ray to curves (n, 4, 3), inf without a hit: where the distance to a curve is least and below its
    half width; and the least room, in half widths, by which that was so or not so."""
    middle = controls.mean(axis=1)
    reach = np.linalg.norm(controls - middle[:, None], axis=2).max(axis=1) + widths.max(axis=1)
    near = np.linalg.norm(np.cross(middle - o, d), axis=1) < reach  # a curve lies within its control points
    if not near.any():
        return np.inf, 1.0
    controls, widths = controls[near], widths[near]
    u = np.linspace(0, 1, 801)
    basis = np.stack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3])
    points = np.einsum("ku,nkx->nux", basis, controls) - o
    depth = points @ d
    off = np.linalg.norm(points - depth[..., None] * d, axis=2)
    half = (widths[:, :1] + u * (widths[:, 1:] - widths[:, :1])) / 2
    padded = np.pad(off, ((0, 0), (1, 1)), constant_values=np.inf)
    least = (off <= padded[:, :-2]) & (off <= padded[:, 2:])
    room = np.where(least & (depth > 0), 1 - off / half, -np.inf)
    return np.where(room >= 0, depth, np.inf).min(), np.abs(np.where(np.isfinite(room), room, 1)).min()


@pytest.mark.parametrize("tree", [True, slow(False)])
def test_rays_meet_curves_where_float64_does(session, monkeypatch, tree):
    rng = np.random.default_rng(4)
    with_tree(monkeypatch, tree)
    rows = strands(rng, 40)
    item = {"shape": "curves", "points": rows.reshape(-1, 4), "counts": [5] * 40, "basis": "bspline",
            "material": {"kind": "matte", "reflectance": 0.5}}  # fmt: skip
    scene = TracedScene(session, [item])
    assert scene.has_tree is tree
    o = 1.5 * rng.normal(size=(400, 3))
    d = rows[rng.integers(40, size=400), 2, :3] + rng.normal(scale=0.03, size=o.shape) - o
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    found = scene.trace_shapes(o.astype(np.float32), d.astype(np.float32))
    pieces = bezier_pieces(rows, "bspline").reshape(-1, 4, 4)
    sure, unlike, off = 0, 0, []
    for k in range(len(o)):
        expected, room = nearest(o[k], d[k], pieces[:, :, :3], pieces[:, [0, 3], 3])
        if room < 0.01:  # a grazing ray
            continue
        sure += 1
        unlike += (found.primitive[k] >= 0) != np.isfinite(expected)
        if np.isfinite(expected) and found.primitive[k] >= 0:
            off.append(abs(found.t[k] - expected))
    assert sure > 300
    assert unlike <= 2  # rays that look along a curve
    assert len(off) > 80
    assert np.quantile(off, 0.95) < 2e-4  # rays almost along a curve: so far apart float64 tries places
    assert max(off) < 0.01


@pytest.mark.parametrize("basis", ["linear", "bezier", "bspline", "catmull_rom"])
def test_pieces_follow_one_another(basis):
    rows = strands(np.random.default_rng(2), 3, points=7)
    pieces = bezier_pieces(rows, basis)
    np.testing.assert_allclose(pieces[:, 1:, 0], pieces[:, :-1, 3], atol=1e-12)
    if basis != "bspline":
        np.testing.assert_allclose(pieces[:, 0, 0], rows[:, 0])
        np.testing.assert_allclose(pieces[:, -1, 3], rows[:, -1])


def tuft(material, **keys):
    """A tuft of hair before a white sky."""
    rows = strands(np.random.default_rng(7), 60, width=0.06)
    item = {"shape": "curves", "points": rows.reshape(-1, 4).tolist(), "counts": [5] * 60, "material": material}
    camera = {"kind": "pinhole", "eye": [0, 0, 4], "target": [0, 0, 0], "fov_degrees": 30}
    sky = {"kind": "constant", "radiance": 1}
    return {"camera": camera, "film": {"resolution": [48, 32]}, "objects": [item | keys], "environment": sky}


def test_white_hair_vanishes_in_a_white_world():
    film = np.asarray(rptcam_cl.render(tuft(WHITE_HAIR) | {"render": {"max_depth": 500, "roulette_depth": 0}}, spp=16))
    np.testing.assert_allclose(film, 1, atol=2e-5)
    dark = np.asarray(rptcam_cl.render(tuft({"kind": "hair", "eumelanin": 8}), spp=16))
    assert 0.01 < dark.min() < 0.3


def test_hair_from_a_file_is_that_written_out(tmp_path):
    written = tuft(WHITE_HAIR | {"reflectance": [0.6, 0.4, 0.2]})
    item = written["objects"][0]
    np.savez(tmp_path / "hair.npz", points=item["points"], counts=item["counts"])
    named = {key: item[key] for key in ("shape", "material")} | {"file": "hair.npz"}
    scene = rptcam_cl.load_scene(written | {"objects": [named]}, base_dir=tmp_path)
    one, other = (np.asarray(rptcam_cl.render(each, spp=2)) for each in (scene, written))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({"counts": [5]}, r"objects\[0\]\.counts: does not add up to the 300 points"),
        ({"basis": "bezier"}, r"objects\[0\]\.counts\[0\]: makes no strand of basis bezier"),
        ({"points": [[0, 0, 0, 1], [0, 0, 1, -1]], "counts": []}, r"objects\[0\]\.points\[1\]\[3\]: is negative"),
        ({"material": {"kind": "dielectric"}}, r"objects\[0\]\.material: is nothing that curves can be made of"),
        ({"file": "a.npz"}, r"objects\[0\]\.file: does not go with points"),
    ],
)
def test_faults_of_curves_are_named(keys, text):
    with pytest.raises(InputError, match=text):
        rptcam_cl.load_scene(tuft(**({"material": WHITE_HAIR} | keys)))


def test_hair_is_for_curves_alone():
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": WHITE_HAIR}
    with pytest.raises(InputError, match=r"objects\[0\]\.material: .*curves"):
        rptcam_cl.load_scene(tuft(WHITE_HAIR) | {"objects": [ball]})
