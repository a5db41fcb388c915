"""Layers of triangle meshes: interpolated and true normals, texture coordinates, identifiers of instances."""

import numpy as np
import pytest

import rptcam_cl

VERTICES = np.array([[-1.0, -1.0, 0.2], [1.1, -0.9, -0.3], [0.9, 1.0, 0.0], [-0.8, 1.1, 0.4]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
NORMALS = np.array([[-0.3, -0.2, 1.0], [0.4, -0.1, 1.0], [0.2, 0.3, 1.0], [0.0, 0.5, 1.0]])
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)
UVS = np.array([[0.0, 0.0], [2.0, 0.1], [1.7, 3.0], [0.2, 1.4]])
SHEET = {"vertices": VERTICES.tolist(), "faces": FACES.tolist(), "normals": NORMALS.tolist(), "uvs": UVS.tolist()}
BLUE = {"kind": "matte", "reflectance": [0.1, 0.2, 0.7]}
RED = {"kind": "matte", "reflectance": [0.7, 0.2, 0.1]}
CAMERA = {"kind": "pinhole", "eye": [0, 0, 6], "target": [0, 0, 0], "fov_degrees": 45}
LAYERS = ["position", "normal", "geometric_normal", "uv", "object_id", "material_id", "albedo"]
SHIFT = np.array([0.0, 0.3, -4.0])


@pytest.fixture(scope="module")
def image():
    scene = {
        "film": {"resolution": [64, 48]},
        "camera": CAMERA,
        "meshes": {"sheet": SHEET},
        "objects": [
            {"shape": "sphere", "center": [-1.6, 1.4, 0], "radius": 0.4, "material": RED},
            {"shape": "mesh", "mesh": "sheet", "material": BLUE},
            {
                "shape": "mesh",
                "mesh": "sheet",
                "material": RED,
                "transform": [{"scale": 2}, {"translate": SHIFT.tolist()}],
            },
        ],
    }
    return rptcam_cl.render(scene, spp=1, layers=LAYERS)


def interpolated(points, values):
    """Values at points of the sheet from those of its vertices, by areas in float64; and the faces' normals there."""
    found, normals = np.full((len(points), values.shape[1]), np.nan), np.empty((len(points), 3))
    for face in FACES:
        a, b, c = VERTICES[face]
        normal = np.cross(b - a, c - a)
        weights = np.linalg.solve(np.stack([b - a, c - a, normal], axis=1), (points - a).T).T
        flat = np.abs(weights[:, 2] * np.linalg.norm(normal)) < 1e-5
        inside = flat & (weights[:, :2] > -1e-5).all(axis=1) & (weights[:, :2].sum(axis=1) < 1 + 1e-5)
        share = np.column_stack([1 - weights[:, 0] - weights[:, 1], weights[:, :2]])
        found[inside] = (share @ values[face])[inside]
        normals[inside] = normal / np.linalg.norm(normal)
    assert np.isfinite(found).all()
    return found, normals


@pytest.mark.parametrize(("instance", "scale", "shift"), [(1, 1.0, np.zeros(3)), (2, 2.0, SHIFT)])
def test_normals_and_texture_coordinates_are_those_of_the_triangle(image, instance, scale, shift):
    seen = image["object_id"] == instance
    assert seen.sum() > 100
    points = (image["position"][seen] - shift) / scale
    shading, true = interpolated(points, NORMALS)
    np.testing.assert_allclose(image["normal"][seen], shading / np.linalg.norm(shading, axis=1)[:, None], atol=1e-5)
    np.testing.assert_allclose(image["geometric_normal"][seen], true, atol=1e-6)
    np.testing.assert_allclose(image["uv"][seen], interpolated(points, UVS)[0], atol=1e-5)


def test_instances_of_one_mesh_have_their_own_identifiers_and_materials(image):
    pairs = set(zip(image["object_id"].ravel().tolist(), image["material_id"].ravel().tolist(), strict=True))
    assert pairs == {(-1, -1), (0, 0), (1, 1), (2, 2)}
    for instance, material in ((1, BLUE), (2, RED)):
        seen = image["object_id"] == instance
        np.testing.assert_allclose(image["albedo"][seen], np.tile(material["reflectance"], (seen.sum(), 1)), rtol=1e-6)
