"""Materials of mesh files as materials of the scene."""

import io
import math
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders
from rptcam_cl.rendering.plan.primitives import mesh_parts
from rptcam_cl.scene.file_materials import FileMaterial, FileTexture, material_of
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.materials import Material, Principled, alpha_pair
from rptcam_cl.scene.meshes import MeshObject
from rptcam_cl.scene.textures import ImageTexture

from .conftest import GREY, MeshScene


def png(mode: str = "RGB") -> bytes:
    file = io.BytesIO()
    Image.new(mode, (2, 2)).save(file, "PNG")
    return file.getvalue()


DOTS = FileTexture(png(), "dots")
SEEN = FileTexture(png("RGBA"), "seen")


def shown(**given: Any) -> Material:
    return material_of(FileMaterial(name="m", **given), Folders())


def keys_of(material: Material) -> dict[str, Any]:
    """The keys that a material was given, pictures by their names."""
    given = {name: getattr(material, name) for name in material.model_fields_set}
    return {name: value.file if isinstance(value, ImageTexture) else value for name, value in given.items()}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"matte": True, "base_color": (0.1, 0.2, 0.3)}, {"kind": "matte", "reflectance": (0.1, 0.2, 0.3)}),
        (
            {"matte": True, "base_texture": DOTS, "normals": DOTS},
            {"kind": "matte", "reflectance": "dots", "normal_map": "dots"},
        ),
        (
            {"matte": True, "base_color": (0, 0, 0), "emission": (1, 2, 3), "both_sides": True},
            {"kind": "emissive", "radiance": (1, 2, 3), "two_sided": True},
        ),
        (
            {"metallic": 1.0, "roughness": 0.3, "base_color": (1.0, 0.8, 0.2)},
            {"kind": "principled", "metallic": 1.0, "roughness": 0.3, "base_color": (1.0, 0.8, 0.2)},
        ),
        (
            {
                "metallic_texture": DOTS,
                "metallic": 1.0,
                "roughness_texture": DOTS,
                "emission_texture": DOTS,
                "emission": (1, 1, 1),
            },
            {"kind": "principled", "metallic": "dots", "roughness": "dots", "emission": "dots"},
        ),
        ({"metallic_texture": DOTS}, {"kind": "principled", "metallic": 0.0}),
        ({"matte": True, "emission": (1, 1, 1)}, {"kind": "principled", "specular": 0.0, "emission": (1, 1, 1)}),
        (
            {"transmission": 1.0, "solid": True, "base_color": (1, 1, 1), "roughness": 0, "index": 1.4},
            {"kind": "dielectric", "index": 1.4},
        ),
        (
            {"transmission": 1.0, "solid": True, "roughness": 0.2, "attenuation": ((1, 0.5, 0), 0.1), "clearcoat": 0.5},
            {"kind": "principled", "transmission": 1.0, "roughness": 0.2, "clearcoat": 0.5},
        ),
        (
            {"sheen": (0.9, 2, 0.1), "sheen_roughness": 0.3},
            {"kind": "principled", "sheen": (0.9, 1, 0.1), "sheen_roughness": 0.3},
        ),
        (
            {"transmission": 1.0, "base_color": (1, 0.5, 1)},
            {"kind": "thin_glass", "transmittance": (1, 0.5, 1), "index": 1.5},
        ),
        ({"transmission": 0.25}, {"kind": "mix", "factor": 0.25}),
        ({"transmission": 1.0, "transmission_texture": DOTS}, {"kind": "mix", "factor": "dots"}),
        (
            {"transmission": 1.0, "transmission_texture": DOTS, "solid": True, "base_color": (1, 1, 1), "roughness": 0},
            {"kind": "principled", "transmission": "dots"},
        ),
        ({"transmission": 0.5, "opacity": 0.25}, {"kind": "mix", "factor": 0.5, "opacity": 0.25}),
        (
            {
                "clearcoat": 0.5,
                "clearcoat_texture": DOTS,
                "clearcoat_roughness": 0.2,
                "clearcoat_roughness_texture": SEEN,
                "sheen": (1, 1, 1),
                "sheen_texture": DOTS,
            },
            {"kind": "principled", "clearcoat": "dots", "clearcoat_roughness": "seen", "sheen": "dots"},
        ),
        (
            {"specular": 0.5, "specular_texture": SEEN, "specular_color_texture": DOTS},
            {"specular": "seen", "specular_color": "dots", "index": 1.5},
        ),
        ({"clearcoat": 1.0, "clearcoat_flat": True, "normals": DOTS}, {"clearcoat_flat": True, "normal_map": "dots"}),
        ({"clearcoat": 1.0, "clearcoat_flat": True}, {"clearcoat_flat": False}),
        ({"clearcoat": 1.0, "normals": DOTS}, {"clearcoat_flat": False}),
        (
            {"clearcoat": 1.0, "clearcoat_flat": True, "normals": DOTS, "clearcoat_normals": SEEN},
            {"clearcoat_normal_map": "seen", "normal_map": "dots"},
        ),
        ({"specular": 0.5, "specular_texture": DOTS}, {"specular": 0.5}),  # a picture without alpha
        ({"specular_color": (1, 0.2, 0.5)}, {"specular_color": (1, 0.2, 0.5), "index": 1.5}),
        ({"specular_color": (2, 1, 0), "transmission": 1.0, "solid": True}, {"specular_color": (1, 1, 0)}),
        ({"clearcoat_texture": DOTS, "sheen_texture": DOTS}, {"clearcoat": 0.0, "sheen": (0, 0, 0)}),
        ({"opacity": 0.5}, {"kind": "principled", "opacity": 0.5}),
        (
            {"opacity_texture": SEEN, "base_texture": SEEN, "opacity_cutoff": 0.3},
            {"base_color": "seen", "opacity": "seen", "opacity_mode": "mask", "opacity_cutoff": 0.3},
        ),
        ({"opacity_texture": DOTS, "base_texture": DOTS, "opacity": 0.5}, {"base_color": "dots", "opacity": 0.5}),
        ({"opacity_texture": DOTS}, {"opacity": "dots"}),
        # Beyond what a scene takes: brought inside.
        ({"emission": (1e40, 1e-40, 0)}, {"emission": (1e30, 0.0, 0.0)}),
        ({"index": 0.5, "base_color": (2, 1, 1)}, {"index": 1.0, "base_color": (1, 1, 1)}),
        ({"index": 1.0, "transmission": 1.0, "solid": True}, {"index": 1.01}),
    ],
)
def test_material_of_a_file_becomes_one_of_the_scene(given: dict[str, Any], expected: dict[str, Any]) -> None:
    found = keys_of(shown(**given))
    assert {key: found[key] for key in expected} == expected


def test_channels_and_factors_of_pictures() -> None:
    material = shown(
        base_texture=SEEN, base_color=(1, 0.5, 0.25), metallic_texture=SEEN, metallic=0.5, roughness_texture=SEEN,
        roughness=0.75, opacity_texture=SEEN, opacity=0.9, normals=SEEN, normals_strength=2.0,
    )  # fmt: skip
    channels = {name: getattr(material, name).channel for name in ("base_color", "metallic", "roughness", "opacity")}
    assert channels == {"base_color": "rgb", "metallic": "b", "roughness": "g", "opacity": "a"}
    gains = {name: getattr(material, name).gain for name in channels}
    assert gains == {
        "base_color": (1, 0.5, 0.25),
        "metallic": (0.5,) * 3,
        "roughness": (0.75,) * 3,
        "opacity": (0.9,) * 3,
    }
    assert shown(opacity_texture=DOTS).opacity.channel == "r"  # type: ignore[union-attr]
    normals = material.normal_map  # type: ignore[union-attr]
    assert normals is not None and (normals.strength, normals.color_space) == (2.0, "linear")


@pytest.mark.parametrize(
    ("index", "color", "expected"),
    [
        (1.5, (1, 0.25, 2), (0.04, 0.01, 0.08)),
        (math.inf, (0.9, 0.5, 0.1), (0.9, 0.5, 0.1)),
        (2.0, (20, 0.9, 0), (1, 0.1, 0)),
    ],
)
def test_bright_colours_of_reflections_go_into_the_index(index: float, color: Any, expected: Any) -> None:
    found = shown(index=index, specular_color=color)
    assert isinstance(found, Principled) and isinstance(found.specular_color, tuple)
    normal = ((found.index - 1) / (found.index + 1)) ** 2
    assert [normal * channel for channel in found.specular_color] == pytest.approx(expected, abs=0.005)


def test_anisotropy_has_both_alphas_of_the_format() -> None:
    for roughness, strength in ((0.6, 0.5), (0.4, 0.3), (0.9, 1)):
        found = shown(roughness=roughness, anisotropy=strength, anisotropy_rotation_degrees=20)
        assert isinstance(found, Principled) and found.anisotropy_rotation_degrees == 20
        assert isinstance(found.roughness, float) and found.anisotropy_map is None
        across = roughness**2
        along = across + (1 - across) * strength**2
        assert alpha_pair(found.roughness, found.anisotropy) == pytest.approx((along, across), rel=1e-6)


@pytest.mark.parametrize(
    ("given", "file", "color"),
    [
        ({"anisotropy_texture": SEEN}, "seen", None),
        ({"anisotropy_texture": SEEN, "roughness_texture": DOTS}, "seen", None),
        ({"roughness_texture": DOTS}, "brushed along u", (255, 128, 255)),  # which roughness counts changes
    ],
)
def test_anisotropy_of_a_picture_keeps_the_roughness(given: dict[str, Any], file: str, color: Any) -> None:
    found = shown(roughness=0.7, anisotropy=0.4, **given)
    assert isinstance(found, Principled) and found.anisotropy_map is not None
    assert (found.anisotropy_map.file, found.anisotropy_map.strength) == (file, 0.4)
    assert found.anisotropy_map.color_space == "linear"
    roughness = found.roughness
    assert (roughness.gain[0] if isinstance(roughness, ImageTexture) else roughness) == 0.7
    if color is not None:
        content = found.anisotropy_map.source(Folders())
        assert isinstance(content, bytes) and Image.open(io.BytesIO(content)).getpixel((0, 0)) == color


OBJ = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl w\nf 1/1 2/1 3/1\n"
MTL = "newmtl w\nKd 0.5 0.5 0.5\nKs 0 0 0\nmap_Kd wood.png\n"


@pytest.fixture
def wood(tmp_path: Path) -> Path:
    """A folder with an OBJ file, its library and a picture."""
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "a.mtl").write_text(MTL)
    (tmp_path / "wood.png").write_bytes(png())
    return tmp_path


def item_of(scene: Any) -> MeshObject:
    item = scene.objects[0]
    assert isinstance(item, MeshObject)
    return item


def test_picture_beside_the_file_is_found(wood: Path, mesh_scene: MeshScene) -> None:
    scene = mesh_scene({"file": "a.obj"}, {"file": "a.obj"})
    (part,) = mesh_parts(scene, item_of(scene))
    texture = part.material.reflectance  # type: ignore[union-attr]
    assert isinstance(texture, ImageTexture)
    assert scene.content_of(texture) == (wood / "wood.png").resolve()
    # Two objects of the same file show the same instance, so that it is packed once.
    (shown,) = scene.load_mesh(scene.objects[1]).shown_materials()
    assert shown is part.material


def test_scene_hash_counts_the_pictures_of_a_mesh_file(wood: Path, mesh_scene: MeshScene) -> None:
    first = mesh_scene({"file": "a.obj"}).content_hash()
    assert mesh_scene({"file": "a.obj"}).content_hash() == first
    (wood / "wood.png").write_bytes(png("L"))
    second = mesh_scene({"file": "a.obj"}).content_hash()
    (wood / "a.mtl").write_text(MTL.replace("0.5", "0.6"))
    assert len({first, second, mesh_scene({"file": "a.obj"}).content_hash()}) == 3


def test_material_of_the_object_overrides_those_of_the_file(wood: Path, mesh_scene: MeshScene) -> None:
    (wood / "wood.png").unlink()
    scene = mesh_scene({"file": "a.obj", "material": GREY})
    assert mesh_parts(scene, item_of(scene))[0].material is item_of(scene).material


def test_textured_material_of_an_object_is_hashed(wood: Path, mesh_scene: MeshScene) -> None:
    painted = {"kind": "matte", "reflectance": {"kind": "image", "file": "wood.png"}}
    first = mesh_scene({"file": "a.obj", "material": painted}).content_hash()
    (wood / "wood.png").write_bytes(png("L"))
    assert mesh_scene({"file": "a.obj", "material": painted}).content_hash() != first


@pytest.mark.parametrize(
    ("mtl", "message"),
    [
        (MTL.replace("wood", "oak"), "objects[0].file: material 'w': oak.png: no such file"),
        (MTL.replace("wood", "../oak"), "objects[0].file: material 'w': ../oak.png: lies outside the scene's folder"),
        (MTL.replace("wood.png", "/etc/passwd"), "/etc/passwd: lies outside the scene's folder"),
        (MTL.replace("0.5 0.5 0.5", "a lot"), "a.mtl:2: is not a value (got 'kd a lot'"),
        ("Kd 1 1 1\n", "a.mtl:1: is not in a material"),
    ],
)
def test_unusable_material_is_refused(wood: Path, mesh_scene: MeshScene, mtl: str, message: str) -> None:
    (wood / "a.mtl").write_text(mtl)
    with pytest.raises(InputError) as caught:
        mesh_scene({"file": "a.obj"})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_left_out_is_a_warning(wood: Path, mesh_scene: MeshScene) -> None:
    (wood / "a.obj").write_text(OBJ + "f 1/1 1/1 2/1\n")
    warnings = mesh_scene(
        {"file": "a.obj"}, {"file": "a.obj"}, environment={"kind": "constant", "radiance": 1}
    ).warnings
    assert warnings == (f"{wood / 'a.obj'}: triangles dropped: 1 without area",)


def test_scene_in_another_folder_may_be_allowed(wood: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    elsewhere = tmp_path_factory.mktemp("scene")
    data = {"camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40},
            "objects": [{"shape": "mesh", "file": str(wood / "a.obj")}]}  # fmt: skip
    with pytest.raises(InputError, match="lies outside the scene's folder"):
        load_scene(data, base_dir=elsewhere)
    assert load_scene(data, base_dir=elsewhere, allow_folders=[wood]).objects


def picture_of(colour: tuple[int, int, int]) -> FileTexture:
    stream = io.BytesIO()
    Image.new("RGB", (4, 2), colour).save(stream, "PNG")
    return FileTexture(stream.getvalue(), "bumps", scale=(2.0, 4.0))


def test_bumps_of_mtl_are_heights_in_texels() -> None:
    material = material_of(
        FileMaterial("rough", matte=True, bumps=picture_of((90, 90, 90)), bumps_height=0.4), Folders()
    )
    assert material.normal_map is None  # type: ignore[union-attr]
    bump = material.bump  # type: ignore[union-attr]
    assert (bump.lengths, bump.texture.color_space) == ("unit", "linear")
    assert bump.height == pytest.approx(0.4 / 8)  # 4 x 2 texels along u, 2 x 4 along v


def test_bumps_of_mtl_that_are_normals_are_a_normal_map() -> None:
    material = material_of(
        FileMaterial("lean", matte=True, bumps=picture_of((140, 120, 240)), bumps_height=0.5), Folders()
    )
    assert material.bump is None  # type: ignore[union-attr]
    assert material.normal_map.strength == 0.5  # type: ignore[union-attr]


def test_bumps_of_mtl_without_their_picture_are_left_out_with_a_warning() -> None:
    given = FileMaterial("rough", matte=True, bumps=FileTexture(Path("none.png"), "none.png"))
    with pytest.warns(UserWarning, match=r"'rough': none.png: .*the surface stays smooth"):
        material = material_of(given, Folders())
    assert material.bump is material.normal_map is None  # type: ignore[union-attr]
