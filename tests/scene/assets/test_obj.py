"""OBJ files and their materials."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders
from rptcam_cl.scene.assets import obj as obj_blocks
from rptcam_cl.scene.assets.pictures import read_picture
from rptcam_cl.scene.base import one_pixel
from rptcam_cl.scene.file_materials import FileMaterial, FileTexture, material_of

from .conftest import Read

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def corners(read: Read, text: str) -> list:
    (part,) = read("a.obj", text).parts
    return part.mesh.positions[part.mesh.faces].tolist()


def test_quad_becomes_two_triangles(read: Read) -> None:
    assert corners(read, SQUARE + "f 1 2 3 4\n") == [
        [[0, 0, 0], [1, 0, 0], [1, 1, 0]],
        [[0, 0, 0], [1, 1, 0], [0, 1, 0]],
    ]


@pytest.mark.parametrize("face", ["f -4 -3 -2 -1", "f 1 2 \\\n3 4", "f\t1\t2 3 4 # with a comment"][:2])
def test_other_ways_to_write_the_same_face(read: Read, face: str) -> None:
    assert corners(read, SQUARE + face + "\n") == corners(read, SQUARE + "f 1 2 3 4\n")


def test_negative_indices_count_from_where_they_stand(read: Read) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n"
    assert corners(read, text)[1] == [[5, 0, 0], [6, 0, 0], [5, 1, 0]]


def test_faces_may_name_later_vertices(read: Read) -> None:
    assert len(corners(read, "f 1 2 3 4\n" + SQUARE)) == 2


def test_seam_tells_vertices_apart_and_v_runs_upwards(read: Read) -> None:
    uvs = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 0.25 0\n"
    mesh = read("a.obj", f"{SQUARE}{uvs}f 1/1 2/2 3/3\nf 1/5 3/3 4/4\n").parts[0].mesh
    assert mesh.uvs is not None
    assert len(mesh.positions) == 5
    assert mesh.uvs[mesh.faces].tolist() == [[[0, 0], [1, 0], [1, 1]], [[0.5, 0.25], [1, 1], [0, 1]]]


def test_all_forms_of_corners_may_be_mixed(read: Read) -> None:
    rows = "vt 0.5 0.5\nvn 0 0 3\n"
    mesh = read("a.obj", f"{SQUARE}{rows}f 1/1/1 2/1/1 3/1/1\nf 1//1 3//1 4//1\nf 1/1 4/1 2/1\nf 2 4 3\n").parts[0].mesh
    assert mesh.uvs is not None and mesh.normals is not None
    assert np.array_equal(np.unique(mesh.uvs), [0, 0.5])
    # Corners without a normal get the smooth one, which in the plane is the plane's.
    assert np.allclose(np.abs(mesh.normals), [0, 0, 1])


def test_vertices_with_weights_and_colours(read: Read) -> None:
    text = "v 0 0 0 1\nv 1 0 0 0.1 0.2 0.3\nv 0 1 0\nf 1 2 3\n"
    assert corners(read, text) == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]


def test_more_vertices_than_texture_coordinates(read: Read) -> None:
    mesh = read("a.obj", f"{SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\nf 3/3 2/2 1/1\n").parts[0].mesh
    assert mesh.uvs is not None and mesh.uvs.tolist() == [[0, 0], [1, 0], [1, 1]]


def test_lines_in_any_order_and_dress(read: Read) -> None:
    text = (
        "# a comment \\\nand what follows it\nvn 0 0 1\n  v 0 0 0 # first\n\tvn 0 1 0\nv\t1   0 0\r\n"
        "vn 1 0 0\nv 0 \\\n1 0\n\n   \nl 1 2\nf 1//1 2//2 \\\n  3//3  \n\n"
    )
    mesh = read("a.obj", text).parts[0].mesh
    assert mesh.normals is not None
    assert mesh.positions[mesh.faces].tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]
    assert mesh.normals[mesh.faces].tolist() == [[[0, 0, 1], [0, 1, 0], [1, 0, 0]]]


@pytest.mark.parametrize("size", [1, 7, 20, 50, 100, 1000])
def test_size_of_blocks_does_not_matter(read: Read, monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    text = f"{SQUARE}vt 0 0\nf 1/1 2/1 \\\n 3/1\nusemtl b\nv 0 0 1\nv 1 0 1\nv 0 \\\r\n 1 1\n"
    text += "f -3 -2 -1\nusemtl c\nf -1 1 2"
    whole = [part.mesh.content_hash for part in read("a.obj", text).parts]
    monkeypatch.setattr(obj_blocks, "BLOCK_BYTES", size)
    assert [part.mesh.content_hash for part in read("a.obj", text).parts] == whole
    assert len(whole) == 3
    with pytest.raises(InputError, match=r"a\.obj:16: names a vertex that is not there \(got -8; allowed: 1 to 7"):
        read("a.obj", text + "\nf -8 1 2\n")


def test_each_material_is_a_part(read: Read, tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl red one\nKd 0.7 0.1 0.1\nKs 0 0 0\nnewmtl lamp\nKd 0 0 0\nKe 5 4 3\n")
    text = f"mtllib a.mtl\no first\n{SQUARE}f 1 2 3\nusemtl red one\nf 1 3 4\ng more\nusemtl lamp\nf 1 4 2\n"
    text += "usemtl red one\nf 2 4 3\n"
    parts = {part.name: part for part in read("a.obj", text).parts}
    assert {name: len(part.mesh.faces) for name, part in parts.items()} == {None: 1, "red one": 2, "lamp": 1}
    materials = {name: part.material for name, part in parts.items()}
    assert materials["red one"] is not None and materials["lamp"] is not None and materials[None] is not None
    assert materials["red one"].base_color == (0.7, 0.1, 0.1) and materials["red one"].matte
    assert materials["lamp"].emission == (5, 4, 3)
    assert materials[None].base_color == (0.8, 0.8, 0.8)
    # A part holds the vertices that it shows, no others.
    assert len(parts["lamp"].mesh.positions) == 3


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_mark_of_an_encoding_hides_no_first_line(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "m.mtl").write_bytes("newmtl red\nKd 1 0 0\n".encode(encoding))
    path = tmp_path / "marked.obj"
    path.write_bytes("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n".encode(encoding))
    (material,) = obj_blocks.read_obj(path, lambda name: tmp_path / name).materials
    assert material.base_color == (1, 0, 0)


def test_grey_stands_for_a_missing_library(read: Read) -> None:
    # What finds files refuses this one; the mesh is there all the same, in grey.
    contents = read("a.obj", f"mtllib missing.mtl\n{SQUARE}f 1 2 3\nusemtl wood\nf 1 3 4\n")
    assert [part.material for part in contents.parts] == [FileMaterial(matte=True)] * 2
    assert "a.obj:1: mtllib missing.mtl is left out: no such file; grey stands for" in contents.notes[0]


def test_material_that_no_library_has_is_grey(read: Read, tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\n")
    contents = read("a.obj", f"mtllib a.mtl\nusemtl a\n{SQUARE}f 1 2 3\nusemtl w\nf 1 3 2\nf 2 3 1\n")
    assert [part.material for part in contents.parts[1:]] == [FileMaterial(matte=True)]
    assert contents.notes == (f"{tmp_path / 'a.obj'}: usemtl w: names no material; grey stands for it",)


@pytest.mark.parametrize("word", ["disp", "map_disp"])
def test_displacement_of_a_material_is_shown_as_bumps(read: Read, tmp_path: Path, word: str) -> None:
    (tmp_path / "a.mtl").write_text(f"newmtl w\n{word} -bm 2 a.png\n")
    with pytest.warns(UserWarning, match=f"a.mtl: {word} of w is shown as bumps"):
        material = read("a.obj", f"mtllib a.mtl\nusemtl w\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n").parts[0].material
    assert (material.bumps.name, material.bumps_height) == ("a.png", 2.0)


@pytest.mark.parametrize(
    "line", ["map_Ks a.png", "Pc 0.5", "refl -type sphere a.png", "map_Kd -mm 0.2 0.5 a.png", "map_d -imfchan g a.png"]
)
def test_what_counts_for_nothing_is_named(read: Read, tmp_path: Path, line: str) -> None:
    (tmp_path / "a.mtl").write_text(f"newmtl w\n{line}\n")
    key, _, rest = line.partition(" ")
    what = f"{rest.split()[0]} of {key.lower()}" if key in ("map_Kd", "map_d") else key.lower()
    with pytest.warns(UserWarning, match=rf"a\.mtl: {what} is left out"):
        read("a.obj", f"mtllib a.mtl\nusemtl w\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n")


def test_keys_that_do_nothing_are_no_matter(read: Read, tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    text = "newmtl w\nKa 1 1 1\nPc 0\nPs 0\naniso 0\nmap_Kd -mm 0 1 -imfchan l a.png\n"
    (tmp_path / "a.mtl").write_text(text)
    read("a.obj", f"mtllib a.mtl\nusemtl w\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n")
    assert not recwarn.list


def test_picture_of_another_machines_path_is_found_beside_the_file(read: Read, tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl w\nmap_Kd C:\\work\\wood.png\nmap_d /models/gone.png\n")
    (tmp_path / "wood.png").write_bytes(b"")
    with pytest.warns(UserWarning, match="no such file; wood.png beside it is taken"):
        material = read("a.obj", f"mtllib a.mtl\nusemtl w\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n").parts[0].material
    assert material.base_texture.source == tmp_path / "wood.png"
    assert material.opacity_texture.source == Path("/models/gone.png")


def test_material_carries_over(read: Read, tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text(
        "# made by hand\nnewmtl w\nillum 2\nKd 0.5\nKs 0.04 0.04 0.04\nNs 98\nNi 1.4\nTr 0.25\n"
        "map_Kd -s 2 3 1 -o 0.5 -clamp on wood grain.png\nnorm -bm 0.5 wood grain.png\nPm 0.5\n"
    )
    material = read("a.obj", f"mtllib a.mtl\nusemtl w\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n").parts[0].material
    assert material is not None and material.base_texture is not None and material.normals is not None
    texture = material.base_texture
    assert texture.source == tmp_path / "wood grain.png"
    assert (texture.scale, texture.offset, texture.wrap) == ((2, 3), (0.5, 0), "clamp")
    assert (material.base_color, material.index) == ((0.5, 0.5, 0.5), 1.4)
    assert (material.opacity, material.metallic) == (0.75, 0.5)
    assert material.roughness**4 == pytest.approx(2 / 100)  # alpha² = 2 / (Ns + 2)


def test_factor_of_a_map_without_a_value_is_1(read: Read, tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl w\nmap_Pr r.png\nmap_Pm m.png\nmap_Ke e.png\n")
    material = read("a.obj", f"mtllib a.mtl\nusemtl w\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n").parts[0].material
    assert material is not None
    assert (material.roughness, material.metallic, material.emission, material.matte) == (1, 1, (1, 1, 1), False)


def shown(path: Path, text: str, **pictures: tuple[int, int, int]) -> Any:
    """The material of a scene with one of MTL, whose pictures are of one colour each."""
    for name, colour in pictures.items():
        (path / f"{name}.png").write_bytes(one_pixel(*colour))
    (path / "a.mtl").write_text(f"newmtl w\n{text}\n")
    (path / "a.obj").write_text(f"mtllib a.mtl\nusemtl w\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n")
    (material,) = obj_blocks.read_obj(path / "a.obj", lambda name: path / name).materials
    return material_of(material, Folders(path))


def number(texture: Any, path: Path) -> float:
    """What a material takes of a picture of one colour, which it reads the channel of that it says."""
    texels = read_picture(texture.source(Folders(path))).texels
    return float(texels[0, 0, "rgba".index(texture.channel)]) / 255


@pytest.mark.parametrize(("key", "of_scene"), [("map_d", "opacity"), ("map_Pr", "roughness"), ("map_Pm", "metallic")])
def test_number_by_a_coloured_picture_is_its_luminance(tmp_path: Path, key: str, of_scene: str) -> None:
    for colour in ((200, 100, 50), (70, 70, 70)):
        texture = getattr(shown(tmp_path, f"Pr 1\n{key} a.png", a=colour), of_scene)
        luminance = np.array(colour) @ (0.2126, 0.7152, 0.0722) / 255
        assert number(texture, tmp_path) == pytest.approx(luminance, abs=0.5 / 255)  # stored in bytes


def test_picture_that_says_roughness_and_metal_has_them_in_green_and_blue(tmp_path: Path) -> None:
    material = shown(tmp_path, "map_Pr a.png\nmap_Pm a.png", a=(0, 100, 50))
    found = (number(material.roughness, tmp_path), number(material.metallic, tmp_path))
    assert found == pytest.approx((100 / 255, 50 / 255))


def test_colours_that_are_named_as_opacity_too_make_no_holes(tmp_path: Path) -> None:
    assert shown(tmp_path, "map_Kd a.png\nmap_d a.png", a=(200, 100, 50)).opacity == 1


@pytest.mark.parametrize("model", [4, 6, 7, 9])
def test_illumination_model_of_glass_is_glass(read: Read, tmp_path: Path, model: int) -> None:
    (tmp_path / "a.mtl").write_text(f"newmtl g\nillum {model}\nKd 0 0 0\nKs 1 1 1\nNi 1.33\nd 0.1\n")
    material = read("a.obj", f"mtllib a.mtl\nusemtl g\n{SQUARE}f 1 2 3\n").parts[0].material
    assert material is not None
    assert (material.transmission, material.solid, material.index, material.opacity) == (1.0, True, 1.33, 1.0)


@pytest.mark.parametrize(
    ("lines", "keys"),
    [
        # a mirror by model 3 or 5, where nothing is diffuse and something is reflected
        ("illum 3\nKd 0 0 0\nKs 0.9 0.8 0.7\n", {"metallic": 1.0, "base_color": (0.9, 0.8, 0.7)}),
        ("illum 5\nKd 0 0 0\nKs 0 0 0.7\n", {"metallic": 1.0, "base_color": (0, 0, 0.7)}),
        ("illum 2\nKd 0 0 0\nKs 0.9 0.8 0.7\n", {"metallic": 0.0, "base_color": (0, 0, 0)}),
        ("illum 3\nKd 0 0 0.1\nKs 0.9 0.8 0.7\n", {"metallic": 0.0, "base_color": (0, 0, 0.1)}),
        ("illum 3\nKd 0 0 0\nKs 0 0 0\n", {"metallic": 0.0, "base_color": (0, 0, 0), "matte": True}),
        # a gloss by model 2 on, and by any number of the physical extension
        ("illum 1\nKs 1 1 1\n", {"matte": True}),
        ("illum 2\nKs 1 1 1\n", {"matte": False}),
        ("illum 8\nKs 1 1 1\n", {"matte": False, "transmission": 0.0, "solid": False}),
        ("Ks 1 1 1\n", {"matte": False}),
        ("Pr 0.25\n", {"matte": False, "roughness": 0.25}),
        # shares are cut at 0 and 1, a light is not; one number is a grey, a fourth one is not looked at
        ("Kd 2 -1 0.5\nKe 9\nPm 7\nd -halo 3\n", {
            "base_color": (1, 0, 0.5), "emission": (9, 9, 9), "metallic": 1.0, "opacity": 1.0}),
        ("Kd 0.1 0.2 0.3 0.4\nTr 3\nNs -5\n", {"base_color": (0.1, 0.2, 0.3), "opacity": 0.0, "roughness": 1.0}),
        ("d 0.25\nTr 0.5\n", {"opacity": 0.25}),  # d counts where both stand
        ("illum 6\nTf 0.5 1 1\nmap_Kd a.png\n", {
            "base_color": (0.5, 1, 1), "base_texture": None, "transmission": 1.0, "solid": True, "matte": False}),
        ("map_Kd\n", {"base_texture": None}),
        ("map_norm n.png\n", {"normals": ("n.png", (1, 1), (0, 0), "repeat")}),
        ("bump -bm 0.25 -s 2 2 b.png\n", {"bumps": ("b.png", (2, 2), (0, 0), "repeat"), "bumps_height": 0.25}),
        ("map_Bump b.png\n", {"bumps": ("b.png", (1, 1), (0, 0), "repeat"), "bumps_height": 1.0}),
        ("map_Kd -clamp off -s 2 a b.png\n", {"base_texture": ("a b.png", (2, 1), (0, 0), "repeat")}),
        ("map_Kd -mm 0 1 -o 0.5 0.25 0 -clamp on a.png\n", {"base_texture": ("a.png", (1, 1), (0.5, 0.25), "clamp")}),
    ],
)  # fmt: skip
def test_lines_of_a_material_mean_what_the_format_says(read: Read, tmp_path: Path, lines: str, keys: dict) -> None:
    (tmp_path / "a.mtl").write_text("newmtl w\n" + lines)
    material = read("a.obj", f"mtllib a.mtl\nusemtl w\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n").parts[0].material
    found = {key: getattr(material, key) for key in keys}
    for key, value in found.items():
        if isinstance(value, FileTexture):
            assert value.source == tmp_path / value.name
            found[key] = (value.name, value.scale, value.offset, value.wrap)
    assert found == keys


@pytest.mark.parametrize("rows", ["vt 0.25\nvt 0.5\n", "vt 0.25\nvt 0.5 7\n", "vt 0.25 \nvt 0.5 # 3\n"])
def test_texture_coordinates_of_one_number_have_a_second_of_0(read: Read, rows: str) -> None:
    mesh = read("a.obj", f"{SQUARE}{rows}f 1/1 2/2 3/1\n").parts[0].mesh
    assert mesh.uvs is not None
    assert mesh.uvs[mesh.faces].tolist() == [[[0.25, 0], [0.5, 0], [0.25, 0]]]


@pytest.mark.parametrize(("middle", "origin"), [(-4.0, 0.0), (4.0, 0.0), (4.125, 4.0), (-4.125, -4.0)])
def test_mesh_of_size_1_has_its_own_origin_where_it_is_farther_from_zero_than_four(
    read: Read, middle: float, origin: float
) -> None:
    rows = [[middle - 0.5, 0, 0], [middle + 0.5, 0, 0], [middle, 0.5, 0]]
    lines = "".join(f"v {x} {y} {z}\n" for x, y, z in rows)
    mesh = read("a.obj", lines + "f 1 2 3\n").parts[0].mesh
    assert mesh.origin.tolist() == [origin, 0, 0]
    assert (mesh.positions + mesh.origin).tolist() == rows


def test_colours_of_vertices_are_those_behind_their_places(read: Read, tmp_path: Path) -> None:
    path = tmp_path / "scan.obj"
    path.write_text("v 0 0 0 1 0 0\nv 1 0 0 0.5 0.5 2\nv 0 1 0 0 0 0\nf 1 3 2\n")
    (surface,) = obj_blocks.read_obj(path, lambda name: name).surfaces
    np.testing.assert_allclose(surface.colours, [[1, 0, 0], [0.2140411, 0.2140411, 1], [0, 0, 0]], atol=1e-6)
    assert surface.positions.shape == (3, 3)
    path.write_text("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nf 1 3 2\n")  # a weight and colours of some vertices are none
    assert obj_blocks.read_obj(path, lambda name: name).surfaces[0].colours is None
