"""Shapes: exact where ours has them, meshes where they are parts, a report where they are neither."""

import gzip
import io
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import PIL.Image
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.conversion import MeshData, limit_of_loop
from rptcam_cl.scene.placement import turn_about

Convert = Callable[..., Any]
HEAD = 'Scale -1 1 1 LookAt 0 0 9  0 0 0  0 1 0 Camera "perspective" WorldBegin LightSource "infinite"\n'
CHECKER = 'Texture "c" "spectrum" "checkerboard" Material "diffuse" "texture reflectance" "c"\n'


def mesh_of(done: Any, index: int = 0) -> Any:
    (part,) = done.scene.load_mesh(done.scene.objects[index]).contents.parts
    return part.mesh


def area(mesh: Any) -> float:
    a, b, c = (mesh.positions[mesh.faces[:, k]].astype(float) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_sphere_keeps_centre_and_radius(convert: Convert) -> None:
    (item,) = convert('Translate 1 2 3 Scale 2 2 -2 Rotate 10 1 2 3 Shape "sphere" "float radius" .75', HEAD).objects
    assert item["center"] == [1, 2, 3]
    assert item["radius"] == pytest.approx(1.5)


def test_stretched_sphere_keeps_its_transform(convert: Convert) -> None:
    (item,) = convert('Scale 1 2 3 Shape "sphere"', HEAD).scene.objects
    assert item.radius == 1
    np.testing.assert_array_equal(np.diag(item.world_from_object), [1, 2, 3, 1])


BRUSHED = 'Material "conductor" "float uroughness" .5 "float vroughness" .1 '
BENT = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 .5\n0 1 0\n3 0 1 2\n3 2 3 0\n"
)


def test_brushed_shapes_have_u_where_pbrt_has_it(convert: Convert) -> None:
    """Along a disk's u lies its rim; a sphere turned over keeps its turn, and a rectangle the edge along u."""
    done = convert(BRUSHED + 'Shape "disk" "float radius" 2', HEAD)
    mesh = mesh_of(done)
    x, y, u = mesh.positions[:, 0], mesh.positions[:, 1], mesh.uvs[:, 0]
    np.testing.assert_allclose(np.hypot(x, y) * np.cos(2 * math.pi * u), x, atol=1e-6)
    np.testing.assert_allclose(np.hypot(x, y) * np.sin(2 * math.pi * u), y, atol=1e-6)
    (ball,) = convert(BRUSHED + 'Rotate 90 1 0 0 Shape "sphere"', HEAD).scene.objects
    np.testing.assert_allclose(ball.world_from_object[:3, 2], [0, -1, 0], atol=1e-9)
    corners = '"point3 P" [0 0 0  1 0 0  1 2 0  0 2 0] "integer indices" [0 1 2 0 2 3] "point2 uv" [0 1  0 0  1 0  1 1]'
    (item,) = convert(BRUSHED + f'Shape "trianglemesh" {corners}', HEAD).objects
    assert item["edge_u"] == [0, 2, 0]


@pytest.mark.parametrize("material", [CHECKER, BRUSHED])
@pytest.mark.parametrize("kind", ["trianglemesh", "plymesh"])
def test_meshes_without_texture_coordinates_have_those_of_each_triangle(
    convert: Convert, material: str, kind: str
) -> None:
    points = '"point3 P" [0 0 0  1 0 0  1 1 .5  0 1 0] "integer indices" [0 1 2  2 3 0]'
    args = points if kind == "trianglemesh" else '"string filename" "a.ply"'
    mesh = mesh_of(convert(material + f'Shape "{kind}" {args}', HEAD, **{"a.ply": BENT}))
    np.testing.assert_array_equal(mesh.uvs[mesh.faces], [[[0, 0], [1, 0], [1, 1]]] * 2)
    np.testing.assert_array_equal(mesh.positions[mesh.faces[1]], [[1, 1, 0.5], [0, 1, 0], [0, 0, 0]])


def test_a_flat_patch_of_bent_texture_coordinates_is_cut_into_cells(convert: Convert) -> None:
    """Two triangles would bend them in one corner; between all four, u = 1/4 in the middle."""
    flat = 'Shape "bilinearmesh" "point3 P" [-1 -1 0  1 -1 0  -1 1 0  1 1 0] "point2 uv" [0 0  0 0  0 1  1 1]'
    mesh = mesh_of(convert(CHECKER + flat, HEAD))
    (middle,) = np.flatnonzero(np.linalg.norm(mesh.positions, axis=1) < 1e-9)
    assert mesh.uvs[middle] == pytest.approx([0.25, 0.5])


@pytest.mark.slow
def test_texture_of_a_sphere_runs_as_in_pbrt(convert: Convert) -> None:
    """v of pbrt is 1 at the north pole, which the top row of a picture shows; u runs from +x over +y."""
    texels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
    picture = io.BytesIO()
    PIL.Image.fromarray(np.kron(texels, np.ones((16, 16, 1), np.uint8))).save(picture, "PNG")
    text = (
        'LightSource "infinite" Texture "t" "spectrum" "imagemap" "string filename" "t.png"'
        ' Material "diffuse" "texture reflectance" "t" Rotate -90 1 0 0 Rotate 90 0 0 1 Shape "sphere" "float radius" 2'
    )
    left_handed = 'Translate 0 0 5 Camera "perspective" Film "rgb" "integer xresolution" 32 "integer yresolution" 32\n'
    done = convert(text, left_handed + 'PixelFilter "box" WorldBegin\n', t_dot_png=picture.getvalue())
    seen = rptcam_cl.render(done.scene, spp=1, layers=["albedo"])["albedo"]
    # the sphere's +x points at the camera, its +y to the left, its pole upwards
    corners = [[seen[row, column] for column in (14, 17)] for row in (14, 17)]
    np.testing.assert_allclose(corners, texels / 255, atol=1e-3)


def test_cylinder_cone_and_disk_are_ours(convert: Convert) -> None:
    text = (
        'Shape "cylinder" "float radius" .5 "float zmin" -2 "float zmax" 3\n'
        'Shape "cone" "float radius" .5 "float height" 2\nShape "disk" "float height" 4 "float radius" 2'
    )
    done = convert(text, HEAD)
    cylinder, cone, disk = done.scene.objects
    assert (cylinder.base, cylinder.top, cylinder.radius, cylinder.capped) == ((0, 0, -2), (0, 0, 3), 0.5, False)
    assert (cone.base, cone.apex, cone.radius, cone.capped) == ((0, 0, 0), (0, 0, 2), 0.5, False)
    assert (disk.center, disk.normal, disk.radius) == ((0, 0, 4), (0, 0, 1), 2)
    assert done.report == []


PARTS = {
    'Shape "sphere" "float zmin" 0': 2 * math.pi,
    'Shape "sphere" "float phimax" 90': math.pi,
    'Shape "sphere" "float radius" 2 "float zmin" -1 "float zmax" 1.5 "float phimax" 180': math.pi * 2 * 2.5,
    'Shape "disk" "float innerradius" .5': math.pi * 0.75,
    'Shape "disk" "float phimax" 45': math.pi / 8,
    'Shape "cylinder" "float phimax" 180': math.pi * 2,
    'Shape "cone" "float phimax" 90': math.pi * math.sqrt(2) / 4,
    'Shape "paraboloid" "float phimax" 360': math.pi / 6 * (5**1.5 - 1),
    'Shape "hyperboloid" "point3 p1" [1 0 0] "point3 p2" [1 0 2]': 4 * math.pi,
}


def test_straight_profiles_need_no_more_triangles_than_their_circle(convert: Convert) -> None:
    done = convert('Shape "cylinder" "float phimax" 180', HEAD)
    assert done.says("a mesh of 128 triangles")  # two for each of 64 sides of half a circle


@pytest.mark.parametrize("text", PARTS)
def test_parts_are_meshes_of_the_same_area(convert: Convert, text: str) -> None:
    done = convert(text, HEAD)
    assert area(mesh_of(done)) == pytest.approx(PARTS[text], rel=2e-3)  # 128 sides of a circle
    assert done.says("in.pbrt:2: approximated: Shape", "a mesh of")


def test_hyperboloid_is_what_its_segment_sweeps(convert: Convert) -> None:
    mesh = mesh_of(convert('Shape "hyperboloid" "point3 p1" [1 0 -1] "point3 p2" [0 1 1] "float phimax" 270', HEAD))
    x, y, z = (mesh.positions + mesh.origin).T
    v = (z + 1) / 2
    np.testing.assert_allclose(x * x + y * y, (1 - v) ** 2 + v**2, atol=1e-5)
    # p turns from p1 + v (p2 - p1) by up to 270 degrees, from +x over +y
    turn = np.arctan2(y, x) - np.arctan2(v, 1 - v)
    assert np.isclose((turn + 1e-3) % (2 * np.pi), np.pi, atol=0.1).any()
    assert ((turn + 1e-3) % (2 * np.pi) < 1.5 * np.pi + 2e-3).all()
    gradient = np.stack([x, y, -z / 2], axis=1)  # of x^2 + y^2 - (1 + z^2) / 2
    cosines = (mesh.normals * gradient).sum(axis=1) / np.linalg.norm(gradient, axis=1)
    np.testing.assert_allclose(np.abs(cosines), 1, atol=1e-5)


def test_paraboloid_lies_on_its_formula_and_begins_at_its_least_height(convert: Convert) -> None:
    mesh = mesh_of(convert('Shape "paraboloid" "float radius" 2 "float zmin" .5 "float zmax" 4.5', HEAD))
    x, y, z = (mesh.positions + mesh.origin).T
    np.testing.assert_allclose(z, 4.5 * (x * x + y * y) / 4, atol=1e-5)
    assert (z.min(), z.max()) == pytest.approx((0.5, 4.5))
    np.testing.assert_allclose(mesh.uvs[:, 1], (z - 0.5) / 4, atol=1e-6)  # v of pbrt's ``Paraboloid::Intersect``


@pytest.mark.parametrize("text", ['Shape "sphere" "float zmin" -.9', 'Shape "cylinder" "float phimax" 359'])
def test_parts_face_outwards(convert: Convert, text: str) -> None:
    mesh = mesh_of(convert('AreaLightSource "diffuse" ' + text, HEAD))
    a, b, c = (mesh.positions[mesh.faces[:, k]].astype(float) for k in range(3))
    middle = (a + b + c) / 3 + mesh.origin
    middle[:, 2] *= text.startswith('Shape "sphere"')
    assert ((np.cross(b - a, c - a) * middle).sum(axis=1) > 0).all()
    assert ((mesh.normals[mesh.faces[:, 0]] * middle).sum(axis=1) > 0).all()


def test_reversed_lamps_shine_inwards(convert: Convert) -> None:
    done = convert('ReverseOrientation AreaLightSource "diffuse" Shape "sphere" Shape "disk"', HEAD)
    mesh = mesh_of(done)
    centre = mesh.positions[mesh.faces].mean(axis=1) + mesh.origin
    a, b, c = (mesh.positions[mesh.faces[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * centre).sum(axis=1) < 0).all()
    assert done.objects[1]["normal"] == [0, 0, -1]
    both = convert('ReverseOrientation AreaLightSource "diffuse" "bool twosided" true Shape "sphere"', HEAD)
    assert both.objects[0]["shape"] == "sphere"


QUAD = '"point3 P" [0 0 0  2 0 0  2 3 0  0 3 0] "integer indices" [0 1 2 0 2 3]'
QUAD_UV = '"point2 uv" [0 0 1 0 1 1 0 1]'


def test_two_triangles_of_a_parallelogram_are_a_rectangle(convert: Convert) -> None:
    (item,) = convert(f'Shape "trianglemesh" {QUAD}', HEAD).objects
    assert (item["corner"], item["edge_u"], item["edge_v"]) == ([0, 0, 0], [2, 0, 0], [0, 3, 0])


@pytest.mark.parametrize(
    ("shape", "kind"),
    [
        (f"{QUAD} {QUAD_UV}", "rectangle"),
        (QUAD, "mesh"),  # a texture without coordinates
        (f'{QUAD} "point2 uv" [0 0 2 0 2 2 0 2]', "mesh"),
        (QUAD.replace("2 3 0", "2 3.1 0") + QUAD_UV, "mesh"),
        (QUAD.replace("0 2 3]", "0 3 2]") + QUAD_UV, "mesh"),  # one face turned over
        (f'{QUAD} {QUAD_UV} "normal N" [0 0 1 0 0 1 0 0 2 0 0 1]', "rectangle"),
        (f'{QUAD} {QUAD_UV} "normal N" [0 0 1 0 0 1 0 .1 1 0 0 1]', "mesh"),  # a bent one
        (QUAD.replace("2 3 0  0 3 0", "2 1e-9 0  0 1e-9 0") + QUAD_UV, "mesh"),  # a line
    ],
)
def test_textured_rectangles_need_the_corners_of_a_texture(convert: Convert, shape: str, kind: str) -> None:
    (item,) = convert(CHECKER + f'Shape "trianglemesh" {shape}', HEAD).objects
    assert item["shape"] == kind


@pytest.mark.parametrize("start", range(4))
def test_rectangles_begin_where_the_texture_does(convert: Convert, start: int) -> None:
    uv = np.roll([[0, 0], [1, 0], [1, 1], [0, 1]], start, axis=0).reshape(-1)
    text = CHECKER + f'Shape "trianglemesh" {QUAD} "point2 uv" [{" ".join(map(str, uv))}]'
    (item,) = convert(text, HEAD).objects
    assert item["shape"] == "rectangle"
    assert item["corner"] == [[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]][start]


def test_a_textured_rectangle_may_be_seen_in_the_mirror(convert: Convert) -> None:
    mirrored = HEAD.replace("Scale -1 1 1 ", "")
    (item,) = convert(CHECKER + f'Shape "trianglemesh" {QUAD} {QUAD_UV}', mirrored).objects
    assert (item["corner"], item["edge_u"], item["edge_v"]) == ([0, 0, 0], [-2, 0, 0], [0, 3, 0])


def test_bilinear_patch_that_is_flat_is_a_rectangle(convert: Convert) -> None:
    text = 'Shape "bilinearmesh" "point3 P" [0 0 0  2 0 0  0 3 0  2 3 0]'
    (item,) = convert(CHECKER + text, HEAD).objects
    assert (item["corner"], item["edge_u"], item["edge_v"]) == ([0, 0, 0], [2, 0, 0], [0, 3, 0])


def test_bilinear_patch_that_is_not_flat_is_cut_into_cells(convert: Convert) -> None:
    done = convert('Shape "bilinearmesh" "point3 P" [0 0 0  1 0 0  0 1 0  1 1 1]', HEAD)
    mesh = mesh_of(done)
    assert len(mesh.faces) == 128
    x, y, z = (mesh.positions + mesh.origin).T
    np.testing.assert_allclose(z, x * y, atol=1e-6)
    assert done.says("8 x 8 cells")


TETRAHEDRON = MeshData(
    np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]]),
    np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]),
)


def subdivided(levels: int) -> str:
    points = " ".join(f"{x:g}" for x in TETRAHEDRON.vertices.ravel())
    indices = " ".join(map(str, TETRAHEDRON.faces.ravel()))
    return f'Shape "loopsubdiv" "integer levels" {levels} "integer indices" [{indices}] "point3 P" [{points}]'


def test_subdivision_surfaces_are_subdivided(convert: Convert) -> None:
    done = convert(subdivided(4), HEAD)
    (part,) = done.scene.load_mesh(done.scene.objects[0]).contents.parts
    assert len(part.mesh.faces) == 4 * 4**4
    # the limit of a vertex of valence 3 is (1 - 3 g) p + g (sum of the others), g = 1 / (3 + 2): the others sum to -p
    np.testing.assert_allclose(limit_of_loop(TETRAHEDRON, 4).vertices[:4], 0.2 * TETRAHEDRON.vertices, rtol=1e-12)
    assert (np.einsum("ni,ni->n", part.mesh.normals, part.mesh.positions) > 0).all()
    assert not done.report


@pytest.mark.slow  # a million faces
def test_subdivision_ends_at_nine_levels(convert: Convert) -> None:
    assert convert(subdivided(30), HEAD).says("subdivided 9 times, not 30")


def lattice(size: int) -> MeshData:
    """A sheet of the lattice of equal triangles, its heights the square of x."""
    j, i = np.meshgrid(range(size), range(size), indexing="ij")
    x = i + j / 2.0
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    faces = [[corner, corner + 1, corner + size], [corner + 1, corner + size + 1, corner + size]]
    vertices = np.stack([x, j * np.sqrt(3) / 2, x**2], axis=-1).reshape(-1, 3)
    return MeshData(vertices, np.concatenate([np.stack(part, axis=1) for part in faces]))


def test_a_subdivision_surface_of_a_parabola_is_one() -> None:
    # the box spline of the lattice gives polynomials of the third degree back, but for constants of their second parts
    surface = limit_of_loop(lattice(13), 3).vertices
    middle = np.abs(surface[:, :2] - [9, 3 * np.sqrt(3)]).max(axis=1) < 1
    assert middle.sum() > 100
    excess = surface[middle, 2] - surface[middle, 0] ** 2
    # a vertex: 1/12 of the squared distances of its six neighbours, along x
    np.testing.assert_allclose(excess, 3 / 12, atol=1e-12)


@pytest.mark.parametrize("mesh", [TETRAHEDRON, lattice(4)], ids=["closed", "with a border"])
def test_further_steps_leave_the_limit_of_a_vertex(mesh: MeshData) -> None:
    first, last = limit_of_loop(mesh, 0).vertices, limit_of_loop(mesh, 3).vertices
    np.testing.assert_allclose(last[: len(first)], first, atol=1e-12)


@pytest.mark.parametrize("count", [200, 201])
def test_meshes_of_two_hundred_faces_stand_in_the_scene(convert: Convert, count: int) -> None:
    points = " ".join(f"{k} {k % 2} 0" for k in range(count + 2))
    indices = " ".join(f"{k} {k + 1} {k + 2}" for k in range(count))
    done = convert(f'Shape "trianglemesh" "point3 P" [{points}] "integer indices" [{indices}]', HEAD)
    assert ("file" in done.objects[0]) == (count == 201)
    assert len(mesh_of(done).faces) == count


def test_large_meshes_go_to_a_file_beside_the_scene(convert: Convert) -> None:
    rng = np.random.default_rng(3)
    points, faces = rng.random((120, 3)), rng.integers(0, 120, (300, 3))
    faces = faces[(np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)]
    flat = [" ".join(map(str, values.reshape(-1).tolist())) for values in (points, faces, points[:, :2])]
    text = 'Shape "trianglemesh" "point3 P" [{}] "integer indices" [{}] "point2 uv" [{}]'.format(*flat)
    done = convert("Translate 1 2 3 " + text, HEAD)
    assert done.objects[0]["file"] == "out_meshes/trianglemesh-2.ply"
    mesh = mesh_of(done)
    got = np.sort((mesh.positions + mesh.origin)[mesh.faces].reshape(-1, 9).round(3), axis=0)
    np.testing.assert_allclose(
        got, np.sort(np.add(points, [1, 2, 3])[faces].reshape(-1, 9).round(3), axis=0), atol=2e-3
    )
    np.testing.assert_allclose(mesh.uvs, (mesh.positions + mesh.origin - [1, 2, 3])[:, :2], atol=1e-5)


def test_meshes_of_a_material_become_one_where_a_scene_file_holds_no_more(convert: Convert) -> None:
    rng = np.random.default_rng(4)
    text, expected = "", {"diffuse": [], "mirror": []}
    for index in range(2400):
        kind = "mirror" if index % 3 else "diffuse"
        points = rng.random((3, 3)).round(4)
        expected[kind].append(points.mean(axis=0))
        text += f'Material "{kind}" Shape "trianglemesh" "point3 P" [{" ".join(map(str, points.reshape(-1)))}]\n'
    alone = 'Material "conductor" Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0]'
    done = convert(f'{text} Shape "sphere" {alone}', HEAD)
    assert [item["material"] for item in done.objects] == ["diffuse", "mirror", "mirror", "conductor"]
    assert not done.says("of conductor")
    assert done.says("in.pbrt:2: note: 800 meshes of diffuse became one")
    for index, kind in enumerate(expected):
        mesh = mesh_of(done, index)
        middles = mesh.positions[mesh.faces].mean(axis=1) + mesh.origin
        np.testing.assert_allclose(np.sort(middles, axis=0), np.sort(expected[kind], axis=0), atol=1e-6)


def test_many_instances_become_a_table_of_places(convert: Convert) -> None:
    text = 'ObjectBegin "o" Translate 0 0 1 Shape "cylinder" Shape "sphere" ObjectEnd\n'
    done = convert(text + 'Rotate 1 1 2 3 ObjectInstance "o"\n' * 1000, HEAD)
    assert len(done.objects) == 2
    assert done.objects[0]["instances"] == done.objects[1]["instances"] == {"file": "out_places/o.npz"}
    cylinder = done.scene.objects[0]
    places = cylinder.places(done.scene.folders, 0.0)
    axis = np.array([1, 2, 3]) / np.sqrt(14)
    for index in (0, 999):
        expected = np.eye(4)
        expected[:3, :3] = turn_about(axis, index + 1.0)
        expected[:3, 3] += expected[:3, 2]
        np.testing.assert_allclose(places[index], expected, atol=1e-9)


def test_places_of_an_object_that_cannot_be_used_are_left_out(convert: Convert) -> None:
    some = 'ObjectInstance "o" Translate 1 0 0\n' * 40
    flat = 'AttributeBegin Scale 1e-9 1 1 ObjectInstance "o" AttributeEnd'
    done = convert(f'ObjectBegin "o" Shape "sphere" ObjectEnd {some} {flat}', HEAD)
    assert len(done.scene.objects[0].places(done.scene.folders, 0.0)) == 40
    assert done.says("ignored", 'ObjectInstance "o"')


@pytest.mark.slow
def test_spheres_by_the_thousand_become_a_table(convert: Convert) -> None:
    text = "".join(f'Translate 1 0 0 Shape "sphere" "float radius" {1 + index % 7}\n' for index in range(4600))
    done = convert(text + 'Material "mirror" Shape "sphere"', HEAD)
    assert len(done.objects) == 2
    places = done.scene.objects[0].places(done.scene.folders, 0.0)
    np.testing.assert_allclose(places[:, 0, 3], np.arange(1.0, 4601))
    np.testing.assert_allclose(places[:, 1, 1], 1 + np.arange(4600) % 7)


PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)


def test_ply_files_inside_the_folder_are_referenced(convert: Convert) -> None:
    done = convert('Translate 0 0 1 Shape "plymesh" "string filename" "sub/a.ply"', HEAD, **{"sub/a.ply": PLY})
    assert done.objects[0]["file"] == "sub/a.ply"
    assert done.scene.objects[0].world_from_object[2, 3] == 1


def test_new_files_never_take_the_place_of_files_of_the_scene(convert: Convert, tmp_path: Any) -> None:
    (tmp_path / "same.ply.gz").write_bytes(gzip.compress(PLY.encode()))
    names = ["out_files/same.ply", "same.ply.gz"]
    texts = [f'Shape "plymesh" "string filename" "{name}"\n' for name in names]
    done = convert("".join(texts), HEAD, **{"out_files/same.ply": PLY + "\n"})
    assert [item["file"] for item in done.objects] == ["out_files/same.ply", "out_files/same-2.ply"]
    with pytest.raises(InputError, match="where a new file goes"):
        convert("".join(reversed(texts)), HEAD)


def test_packed_ply_files_are_unpacked(convert: Convert) -> None:
    files = {"a.ply.gz": gzip.compress(PLY.encode())}
    done = convert('Shape "plymesh" "string filename" "a.ply.gz"', HEAD, **files)
    assert done.objects[0]["file"] == "out_files/a.ply"


GLASS = 'Material "dielectric"\n'


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(
    ("text", "normal", "front"),
    [("", None, 1), ("ReverseOrientation ", None, -1), ("", 1, 1), ("", -1, -1), ("ReverseOrientation ", -1, 1)],
)
def test_glass_of_ply_files_faces_as_in_pbrt(
    convert: Convert, text: str, normal: int | None, front: int, packed: bool
) -> None:
    content = PLY
    if normal is not None:
        names = "".join(f"property float {name}\n" for name in ("nx", "ny", "nz"))
        content = content.replace("element face", names + "element face")
        for row in ("0 0 0", "1 0 0", "0 1 0"):
            content = content.replace(f"\n{row}\n", f"\n{row} 0 0 {normal}\n")
    name = "a.ply.gz" if packed else "a.ply"
    files = {name: gzip.compress(content.encode()) if packed else content}
    done = convert(f'{text}{GLASS}Translate 0 0 2 Shape "plymesh" "string filename" "{name}"', HEAD, **files)
    mesh = mesh_of(done)
    a, b, c = mesh.positions[mesh.faces[0]]
    assert np.sign(np.cross(b - a, c - a)[2]) == front
    assert done.scene.objects[0].world_from_object[2, 3] == 2
    changed = bool(text) or normal == -1
    assert done.says("written anew with its front where pbrt has it") == changed
    if not packed and not changed:
        assert done.objects[0]["file"] == "a.ply"


def test_power_of_a_lamp_in_a_ply_file_is_that_of_each_triangle(convert: Convert) -> None:
    text = 'AreaLightSource "diffuse" "float power" 60 Scale 2 2 2 Shape "plymesh" "string filename" "a.ply"'
    done = convert(text, HEAD, **{"a.ply": PLY})
    np.testing.assert_allclose(done.material()["radiance"], 60 / (math.pi * 2))


def test_shapes_that_ours_lacks_are_reported(convert: Convert) -> None:
    done = convert(
        'Shape "nurbs" "point3 P" [0 0 0 1 1 1 2 2 2 3 3 3]\nShape "nurbs" "float width" 1\nShape "sphere"', HEAD
    )
    assert [item["shape"] for item in done.objects] == ["sphere"]
    assert done.says('in.pbrt:2: ignored: Shape "nurbs"', "(also on 3)")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "text",
    [
        'Shape "hyperboloid" "point3 p1" [1 0 0] "point3 p2" [1 0 0]',
        'Shape "sphere" "float zmin" .5 "float zmax" .5',
        'Shape "disk" "float innerradius" 2',
        'Shape "cylinder" "float zmin" 1 "float zmax" 1',
        'Shape "paraboloid" "float zmin" 1',
    ],
)
def test_shapes_without_area_are_left_out(convert: Convert, text: str) -> None:
    done = convert(f'{text} Shape "sphere"')
    assert [item["shape"] for item in done.objects] == ["sphere"]
    assert done.says("has no faces of any area")


def test_triangles_without_area_are_left_out(convert: Convert) -> None:
    points = '"point3 P" [0 0 0  1 0 0  0 1 0  2 0 0]'
    done = convert(f'Shape "trianglemesh" {points} "integer indices" [0 1 2 0 1 3 1 1 2]', HEAD)
    assert len(done.objects[0]["faces"]) == 1
    assert done.says("2 triangles without area")
    done = convert(f'Shape "trianglemesh" {points} "integer indices" [0 1 3] Shape "sphere"', HEAD)
    assert [item["shape"] for item in done.objects] == ["sphere"]
    assert done.says("has no faces of any area")


BAD = {
    'Shape "sphere" "float radius" 0': '"radius" must be above 0 (got 0)',
    'Shape "sphere" "float phimax" 0': "phimax must lie between 0 and 360",
    'Shape "trianglemesh"': 'needs vertices, "point3 P"',
    'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0 1 1 1]': 'needs "integer indices"',
    'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 3]': "whole numbers from 0 to 2",
    'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 -1]': "whole numbers from 0 to 2",
    'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1]': "not a multiple of 3",
    'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "float uv" [0 0 1]': '"uv" holds 3 numbers, not a',
    'Shape "plymesh"': 'needs a parameter "string filename"',
    'Shape "plymesh" "string filename" "no.ply"': "no such file",
    GLASS + 'Shape "plymesh" "string filename" "bad.ply"': "in.pbrt:3:17: ",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_shapes_are_told(convert: Convert, text: str) -> None:
    with pytest.raises(InputError, match=r"in\.pbrt:[23]:") as problem:
        convert(text, HEAD, **{"bad.ply": "no mesh"})
    assert BAD[text] in str(problem.value)


def test_what_pbrt_skips_of_shapes_is_reported(convert: Convert) -> None:
    triangle = 'Shape "trianglemesh" "point3 P" [0 0 0 1 0 0 0 1 0] "point2 uv" [0 0]'
    done = convert(f'{triangle} Shape "teapot" ObjectInstance "x" LightSource "sun"', HEAD)
    assert [item["shape"] for item in done.objects] == ["mesh"]
    assert "uvs" not in done.objects[0]
    assert done.says("ignored", "uv, which has 1 entries where P has 3")
    assert done.says('Shape "teapot": there is no such shape')
    assert done.says('ObjectInstance "x": no object has the name')
    assert done.says('LightSource "sun": there is no such light')


def test_curves_of_a_material_become_strands_of_hair(convert: Convert) -> None:
    curve = 'Shape "curve" "point3 P" [0 0 0  0 1 0  1 1 0  1 2 0] "float width0" .2 "float width1" .1 '
    spline = 'Shape "curve" "string basis" "bspline" "point3 P" [0 0 0  1 0 0  2 0 0  3 0 0  4 0 0] "float width" .5'
    hair = f'Material "hair" "float eumelanin" .4 Scale 2 2 2 {curve} {curve} '
    done = convert(f'{hair} Material "diffuse" {spline}', HEAD)
    hair, matte = done.scene.objects
    assert done.material(0) == pytest.approx(
        {"kind": "hair", "eumelanin": 0.4, "pheomelanin": 0, "index": 1.55, "tilt_degrees": 2.0}
        | {"roughness": 0.3, "roughness_across": 0.3}
    )
    assert hair.counts == (4, 4)
    np.testing.assert_allclose(hair.rows[3], [2, 4, 0, 0.2])
    np.testing.assert_allclose(matte.rows[[0, -1]], [[2, 0, 0, 1], [6, 0, 0, 1]], atol=1e-12)
    assert matte.form == "flat"


def test_hair_on_other_shapes_is_matte(convert: Convert) -> None:
    done = convert('Material "hair" "rgb reflectance" [.1 .2 .3] Shape "sphere"')
    assert done.material() == {"kind": "matte", "reflectance": [0.1, 0.2, 0.3]}
    assert done.says("matte in place of hair")
