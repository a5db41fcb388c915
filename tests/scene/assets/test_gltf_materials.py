"""Materials of glTF files."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import Folders
from rptcam_cl.scene.assets.mesh import MeshContents
from rptcam_cl.scene.assets.pictures import has_alpha, read_picture
from rptcam_cl.scene.file_materials import FileMaterial
from rptcam_cl.scene.file_materials import material_of as scene_material
from rptcam_cl.scene.materials import Mix, Principled, Translucent
from rptcam_cl.scene.textures import ImageTexture

from .conftest import Read
from .gltf_writer import GltfWriter, triangle

PIXEL = b"\x89PNG\r\n\x1a\n" + bytes(17) + b"\2" + bytes(7)  # the head of a picture without alpha


def textured(material: dict[str, Any], **parts: Any) -> GltfWriter:
    """Return a triangle with two sets of texture coordinates and a picture inside the file."""
    writer = triangle(material=0)
    attributes = writer.json["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_0"] = writer.array([[0, 0], [1, 0], [0, 1]])
    attributes["TEXCOORD_1"] = writer.array([[0.5, 0.5], [1, 0], [0, 1]])
    writer.json["images"] = [{"bufferView": writer.view(PIXEL), "mimeType": "image/png", "name": "dots"}]
    writer.json |= {"textures": [{"source": 0}], "materials": [material], **parts}
    return writer


def contents_of(read: Read, material: dict[str, Any], **parts: Any) -> MeshContents:
    return read("a.glb", textured(material, **parts).glb())


def material_of(read: Read, material: dict[str, Any], **parts: Any) -> FileMaterial:
    found = contents_of(read, material, **parts).parts[0].material
    assert found is not None
    return found


def test_defaults_are_those_of_the_format(read: Read) -> None:
    assert material_of(read, {}) == FileMaterial(base_color=(1, 1, 1), metallic=1, roughness=1)


def test_primitive_without_a_material_has_the_default_one(read: Read) -> None:
    found = read("a.glb", triangle().glb()).parts[0].material
    assert found == FileMaterial(base_color=(1, 1, 1), metallic=1, roughness=1)


def test_numbers_carry_over(read: Read) -> None:
    found = material_of(read, {
        "name": "paint",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 0.25,
        },
        "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": True, "emissiveFactor": [0, 0.5, 1],
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": 8}, "KHR_materials_ior": {"ior": 1.33},
            "KHR_materials_specular": {"specularFactor": 0.6, "specularColorFactor": [2, 0.5, 0]},
            "KHR_materials_transmission": {"transmissionFactor": 0.9},
            "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [1, 0.5, 0]},
            "KHR_materials_clearcoat": {"clearcoatFactor": 0.7, "clearcoatRoughnessFactor": 0.1},
            "KHR_materials_sheen": {"sheenColorFactor": [0.9, 0.5, 0.1], "sheenRoughnessFactor": 0.3},
        },
    })  # fmt: skip
    assert found == FileMaterial(
        name="paint", base_color=(0.1, 0.2, 0.3), metallic=0.5, roughness=0.25, specular=0.6, opacity=0.4,
        specular_color=(2, 0.5, 0),
        opacity_cutoff=0.3, emission=(0, 4, 8), both_sides=True, index=1.33, transmission=0.9, solid=True,
        attenuation=((1, 0.5, 0), 2), clearcoat=0.7, clearcoat_roughness=0.1, clearcoat_flat=True,
        sheen=(0.9, 0.5, 0.1), sheen_roughness=0.3,
    )  # fmt: skip


EXTENSIONS = (
    "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_specular", "KHR_materials_transmission",
    "KHR_materials_volume", "KHR_materials_clearcoat", "KHR_materials_sheen",
)  # fmt: skip


@pytest.mark.parametrize("name", EXTENSIONS)
def test_every_extension_has_its_defaults(read: Read, name: str) -> None:
    """Strength 1, index 1.5, specular 1, no transmission, no volume of infinite attenuation distance, coat, sheen."""
    flat = {"clearcoat_flat": True} if "clearcoat" in name else {}
    assert material_of(read, {"extensions": {name: {}}}) == replace(material_of(read, {}), **flat)


def test_anisotropy_carries_over(read: Read) -> None:
    stretch = {"anisotropyStrength": 0.6, "anisotropyRotation": 7.0, "anisotropyTexture": {"index": 0}}
    found = material_of(read, {"extensions": {"KHR_materials_anisotropy": stretch}})
    assert found.anisotropy_rotation_degrees == pytest.approx(math.degrees(7.0) - 360)
    assert found.anisotropy == 0.6
    assert found.anisotropy_texture is not None and found.anisotropy_texture.name == "dots"
    assert not found.without_textures().has_textures


def test_solids_take_the_picture_of_transmission_and_need_none_of_thickness(read: Read) -> None:
    found = contents_of(read, {
        "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}},
        "extensions": {
            "KHR_materials_volume": {"thicknessFactor": 1, "thicknessTexture": {"index": 0}},
            "KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": {"index": 0}},
        },
    })  # fmt: skip
    assert not found.notes
    material = found.parts[0].material
    assert material is not None and material.solid and material.transmission_texture is not None


def test_index_of_nothing_is_that_of_a_mirror(read: Read) -> None:
    assert material_of(read, {"extensions": {"KHR_materials_ior": {"ior": 0}}}).index == math.inf


def test_pictures_of_coat_sheen_and_panes_carry_over(read: Read) -> None:
    seen = {"index": 0}
    found = material_of(read, {
        "pbrMetallicRoughness": {"metallicFactor": 0},
        "extensions": {
            "KHR_materials_clearcoat": {
                "clearcoatFactor": 0.5, "clearcoatTexture": seen, "clearcoatRoughnessTexture": seen,
                "clearcoatNormalTexture": {"index": 0, "scale": 0.5},
            },
            "KHR_materials_sheen": {"sheenColorFactor": [1, 1, 1], "sheenColorTexture": seen},
            "KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": seen},
            "KHR_materials_specular": {"specularTexture": seen, "specularColorTexture": seen},
        },
    })  # fmt: skip
    pictures = (
        found.clearcoat_texture, found.clearcoat_roughness_texture, found.sheen_texture, found.transmission_texture,
        found.specular_texture, found.specular_color_texture,
    )  # fmt: skip
    assert all(picture is not None and picture.name == "dots" for picture in pictures)
    assert found.clearcoat_normals is not None and found.clearcoat_normals_strength == 0.5
    assert found.has_textures
    assert not found.without_textures().has_textures


@pytest.mark.parametrize("lossless", [False, True])
def test_webp_of_the_extension_is_taken_and_its_alpha_known(read: Read, lossless: bool) -> None:
    import io

    import PIL.Image

    stream = io.BytesIO()
    PIL.Image.new("RGBA", (2, 2), (200, 100, 0, 128)).save(stream, "WEBP", lossless=lossless)
    writer = textured({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    writer.json["images"].append({"bufferView": writer.view(stream.getvalue()), "mimeType": "image/webp"})
    writer.json["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 1}}, "source": 0}]
    found = read("a.glb", writer.glb()).parts[0].material
    assert found is not None
    assert found.base_texture is not None
    assert isinstance(found.base_texture.source, bytes)
    assert has_alpha(found.base_texture.source)
    texel = read_picture(found.base_texture.source).texels[0, 0]
    assert np.abs(texel.astype(int) - [200, 100, 0, 128]).max() <= (0 if lossless else 12)


def test_a_volume_without_a_distance_absorbs_nothing(read: Read) -> None:
    volume = {"thicknessFactor": 1, "attenuationColor": [1, 0.5, 0]}
    found = material_of(read, {"extensions": {"KHR_materials_volume": volume}})
    assert (found.solid, found.attenuation) == (True, None)


def test_scattering_of_a_volume_leaves_its_extinction(read: Read) -> None:
    """Of a colour c, s and the albedo (1 - s^2) / (1 - g s^2) are those of the extension."""
    deep, g = np.array([0.1, 0.5, 0.9]), 0.6
    scatter = {"multiscatterColorFactor": deep.tolist(), "scatterAnisotropy": g}
    volume = {"thicknessFactor": 1, "attenuationDistance": 0.02, "attenuationColor": [0.5, 0.2, 0.9]}
    names = {"volume": volume, "volume_scatter": scatter, "transmission": {"transmissionFactor": 1}}
    extensions = {f"KHR_materials_{name}": keys for name, keys in names.items()}
    inside = scene_material(material_of(read, {"extensions": extensions}), Folders()).interior
    s = 4.09712 + 4.20863 * deep - np.sqrt(9.59217 + 41.6808 * deep + 17.7126 * deep**2)
    extinction = -np.log([0.5, 0.2, 0.9]) / 0.02
    albedo = (1 - s**2) / (1 - g * s**2)
    np.testing.assert_allclose(inside.scattering, extinction * albedo)
    np.testing.assert_allclose(inside.absorption, extinction * (1 - albedo))
    assert inside.asymmetry == g
    sheet = contents_of(read, {"extensions": {"KHR_materials_volume_scatter": scatter}})
    assert any("KHR_materials_volume_scatter is left out without thickness" in note for note in sheet.notes)
    painted = extensions | {"KHR_materials_volume_scatter": scatter | {"multiscatterColorTexture": {"index": 0}}}
    found = contents_of(read, {"extensions": painted})
    assert any("scatterAnisotropy is left out beside a texture" in note for note in found.notes)
    assert found.parts[0].material.scattering_texture is not None


def test_alpha_counts_only_where_the_mode_says_so(read: Read) -> None:
    surface = {"baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": {"index": 0}}
    opaque = material_of(read, {"pbrMetallicRoughness": surface})
    blend = material_of(read, {"pbrMetallicRoughness": surface, "alphaMode": "BLEND"})
    assert (opaque.opacity, opaque.opacity_texture, opaque.opacity_cutoff) == (1, None, None)
    assert (blend.opacity, blend.opacity_texture, blend.opacity_cutoff) == (0.5, blend.base_texture, None)


def test_pictures_inside_the_file(read: Read) -> None:
    reference = {"index": 0}
    sampler = {"wrapS": 33071, "wrapT": 33071, "magFilter": 9728}
    found = material_of(read, {
        "pbrMetallicRoughness": {"baseColorTexture": reference, "metallicRoughnessTexture": reference},
        "normalTexture": {"index": 0, "scale": 0.5}, "emissiveTexture": reference, "emissiveFactor": [1, 1, 1],
    }, samplers=[sampler], textures=[{"source": 0, "sampler": 0}])  # fmt: skip
    texture = found.base_texture
    assert texture is not None
    assert (texture.source, texture.name, texture.wrap, texture.nearest) == (PIXEL, "dots", "clamp", True)
    assert found.metallic_texture == found.roughness_texture == found.normals == found.emission_texture == texture
    assert found.normals_strength == 0.5


def test_transform_of_a_texture_turns_as_its_description_says(read: Read) -> None:
    # "utilizes only the lower left quadrant of the source image, rotated clockwise": glTF's own example.
    transform = {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]}
    reference = {"index": 0, "extensions": {"KHR_texture_transform": transform}}
    texture = material_of(read, {"pbrMetallicRoughness": {"baseColorTexture": reference}}).base_texture
    assert texture is not None
    angle = math.radians(texture.rotation_degrees)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])  # of the surface, v upwards
    seen = corners * texture.scale @ turn.T + texture.offset
    # The lower left quadrant of the picture, its lower left corner seen at the surface's upper left.
    assert np.allclose(seen, [[0.5, 0], [0.5, 0.5], [0, 0.5], [0, 0]], atol=1e-12)


def test_first_texture_says_which_coordinates_count(read: Read) -> None:
    surface = {"baseColorTexture": {"index": 0, "texCoord": 1}}
    contents = contents_of(read, {"pbrMetallicRoughness": surface, "normalTexture": {"index": 0}})
    uvs = contents.parts[0].mesh.uvs
    assert uvs is not None and uvs[0].tolist() == [0.5, 0.5]
    (note,) = contents.notes
    assert note.endswith("materials[0]: normalTexture is shown by the texture coordinates of the first texture")


def test_surface_without_texture_coordinates_has_no_pictures(read: Read) -> None:
    writer = textured({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0, 0, 1]}})
    attributes = writer.json["meshes"][0]["primitives"][0]["attributes"]
    del attributes["TEXCOORD_0"]
    found = read("a.glb", writer.glb()).parts[0].material
    assert found is not None and found.base_texture is None and found.base_color == (1, 0, 0)


@pytest.mark.parametrize(
    ("material", "parts", "note"),
    [
        ({"extensions": {"KHR_materials_dispersion": {}}}, {}, "materials[0]: KHR_materials_dispersion is left out"),
        (
            {"extensions": {"KHR_materials_diffuse_transmission": {}}},
            {},
            "KHR_materials_diffuse_transmission: is that of a thin sheet, and the gloss shows by the share",
        ),
        (
            {"emissiveFactor": [1, 0, 0], "extensions": {"KHR_materials_diffuse_transmission": {}}},
            {},
            "KHR_materials_diffuse_transmission is left out beside transmission or emission",
        ),
        (
            {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"specularGlossinessTexture": {"index": 0}}}},
            {},
            "Glossiness: the painted specular colour does not darken the diffuse one",
        ),
        (
            {"extensions": {"KHR_materials_sheen": {"sheenRoughnessTexture": {"index": 0}}}},
            {},
            "KHR_materials_sheen.sheenRoughnessTexture is left out",
        ),
        (
            {
                "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}},
                "extensions": {
                    "KHR_materials_transmission": {"transmissionFactor": 1, "transmissionTexture": {"index": 0}},
                },
            },
            {},
            "KHR_materials_transmission.transmissionTexture is left out",
        ),
        ({}, {"extensionsUsed": ["KHR_materials_variants"]}, "variants of materials are left out; the default"),
        (
            {"normalTexture": {"index": 0}},
            {"textures": [{}]},
            "textures[0] has no PNG, JPEG or WebP picture and is left out",
        ),
        (
            {"normalTexture": {"index": 0}},
            {"images": [{"uri": "a.ktx2", "mimeType": "image/ktx2"}]},
            "images[0] is image/ktx2 and is left out",
        ),
        (
            {"normalTexture": {"index": 0}},
            {"samplers": [{"wrapS": 33071}], "textures": [{"source": 0, "sampler": 0}]},
            "samplers[0].wrapT is not as wrapS",
        ),
    ],
)
def test_what_is_left_out_is_noted(read: Read, material: dict[str, Any], parts: dict[str, Any], note: str) -> None:
    notes = contents_of(read, material, **parts).notes
    assert any(note in text for text in notes), notes


def rgba(*levels: int) -> bytes:
    """Return the PNG file of a row of texels of these alphas."""
    import io

    import PIL.Image

    image = PIL.Image.new("RGBA", (len(levels), 1))
    for column, level in enumerate(levels):
        image.putpixel((column, 0), (255, 128, 0, level))
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


def test_specular_colour_and_glossiness_are_an_index_a_colour_and_roughness(read: Read) -> None:
    """Head on the surface reflects specularFactor; what its largest channel leaves of the diffuse colour is diffuse."""
    specular = [0.2, 0.1, 0.05]
    gloss = {"diffuseFactor": [0.5, 0.25, 1, 0.3], "specularFactor": specular, "glossinessFactor": 0.7}
    found = material_of(read, {
        "pbrMetallicRoughness": {"metallicFactor": 1, "baseColorFactor": [0, 0, 0, 1]},
        "extensions": {"KHR_materials_pbrSpecularGlossiness": gloss},
    })  # fmt: skip
    shown = scene_material(found, Folders())
    assert isinstance(shown, Principled)
    at_normal = ((shown.index - 1) / (shown.index + 1)) ** 2
    assert isinstance(shown.specular_color, tuple)
    assert [at_normal * value for value in shown.specular_color] == pytest.approx(specular)
    assert shown.base_color == pytest.approx((0.4, 0.2, 0.8))
    assert (shown.metallic, shown.roughness, shown.opacity) == (0, pytest.approx(0.3), 1)
    blended = {"alphaMode": "BLEND", "extensions": {"KHR_materials_pbrSpecularGlossiness": gloss}}
    assert material_of(read, blended).opacity == 0.3


def test_painted_glossiness_is_what_roughness_leaves_of_1(read: Read) -> None:
    writer = textured({"extensions": {"KHR_materials_pbrSpecularGlossiness": {
        "specularFactor": [0.5, 1, 0.25], "glossinessFactor": 0.8, "specularGlossinessTexture": {"index": 0},
    }}})  # fmt: skip
    writer.json["images"] = [{"bufferView": writer.view(rgba(0, 51, 255)), "mimeType": "image/png"}]
    found = read("a.glb", writer.glb()).parts[0].material
    assert found is not None
    shown = scene_material(found, Folders())
    assert isinstance(shown, Principled)
    assert isinstance(shown.roughness, ImageTexture) and isinstance(shown.specular_color, ImageTexture)
    roughness = read_picture(shown.roughness.source(Folders())).texels[0, :, 0] / 255
    assert roughness == pytest.approx([1, 1 - 0.8 * 0.2, 0.2], abs=0.5 / 255)
    assert shown.roughness.channel == "r"
    at_normal = ((shown.index - 1) / (shown.index + 1)) ** 2
    assert at_normal * np.array(shown.specular_color.gain) == pytest.approx(0.996 * np.array([0.5, 1, 0.25]), rel=0.005)


def test_diffuse_transmission_is_a_translucent_share(read: Read) -> None:
    leaf = {"diffuseTransmissionFactor": 0.25, "diffuseTransmissionColorFactor": [0.2, 0.9, 0.1]}
    given = {
        "pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [0.4, 0.6, 0.2, 1]},
        "extensions": {"KHR_materials_diffuse_transmission": leaf},
    }
    shown = scene_material(material_of(read, given), Folders())
    assert isinstance(shown, Mix)
    solid, sheet = shown.materials
    assert isinstance(solid, Principled) and isinstance(sheet, Translucent)
    assert (shown.factor, solid.base_color) == (0.25, (0.4, 0.6, 0.2))
    assert (sheet.reflectance, sheet.transmittance) == ((0, 0, 0), (0.2, 0.9, 0.1))
    leaf["diffuseTransmissionFactor"] = 1
    assert isinstance(scene_material(material_of(read, given), Folders()), Translucent)
    given["pbrMetallicRoughness"]["metallicFactor"] = 0.5
    half = scene_material(material_of(read, given), Folders())
    assert isinstance(half, Mix) and half.factor == 0.5
    leaf["diffuseTransmissionTexture"] = {"index": 0}
    writer = textured(given)
    writer.json["images"] = [{"bufferView": writer.view(rgba(10, 20)), "mimeType": "image/png"}]
    found = read("a.glb", writer.glb()).parts[0].material
    assert found is not None
    painted = scene_material(found, Folders())
    assert isinstance(painted, Mix) and isinstance(painted.factor, ImageTexture)
    assert (painted.factor.channel, painted.factor.gain) == ("a", (0.5, 0.5, 0.5))


def test_unlit_is_matte(read: Read) -> None:
    found = material_of(read, {"extensions": {"KHR_materials_unlit": {}}})
    assert found == replace(material_of(read, {}), matte=True)


@pytest.mark.parametrize("key", ["wrapS", "wrapT"])
def test_unknown_wrap_is_refused(read: Read, key: str) -> None:
    parts = {"samplers": [{key: 7}], "textures": [{"source": 0, "sampler": 0}]}
    with pytest.raises(InputError, match=rf"samplers\[0\]\.{key}: is not known \(got 7; allowed: 10497, 33071, 33"):
        contents_of(read, {"normalTexture": {"index": 0}}, **parts)


@pytest.mark.parametrize(
    ("content", "alpha"),
    [
        (PIXEL, False),
        (PIXEL[:25] + b"\6" + PIXEL[26:], True),
        (PIXEL[:25] + b"\3....tRNS....IDAT", True),
        (PIXEL[:25] + b"\3....IDAT....tRNS", False),
        (b"\xff\xd8\xff\xe0" + bytes(40), False),
        (b"", False),
    ],
)
def test_alpha_is_told_by_the_head_of_a_picture(content: bytes, alpha: bool, tmp_path: Path) -> None:
    assert has_alpha(content) is alpha
    (tmp_path / "a.png").write_bytes(content)
    assert has_alpha(tmp_path / "a.png") is alpha


@pytest.mark.parametrize("both", [True, False])
def test_light_of_a_double_sided_surface_leaves_both_sides(read: Read, both: bool) -> None:
    keys = {"emissiveFactor": [1, 0, 0], "doubleSided": both}
    made = scene_material(material_of(read, keys), Folders(Path()))
    assert isinstance(made, Principled)
    assert (made.emission, made.two_sided) == ((1, 0, 0), both)
