"""The schema and the reference say what the models say."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from rptcam_cl import scene as model
from rptcam_cl.scene import load_scene, scene_json_schema
from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.file_reference import FileReference
from rptcam_cl.scene.pose import Pose
from rptcam_cl.scene.texture import Blend

# Sections of docs/scene.md: the model that each describes, and the sections that describe the keys that it shares.
SECTIONS: dict[str, tuple[type[SceneModel], *tuple[str, ...]]] = {
    "Scene": (model.Scene,),
    "Tabulated spectrum": (model.TabulatedSpectrum,),
    "Light spectrum": (model.LightSpectrum, "Tabulated spectrum"),
    "Film": (model.Film,),
    "Filter": (model.FilmFilter,),
    "Stop": (model.lens_settings.Stop,),
    "Dirt": (model.lens_settings.Dirt,),
    "Pinhole camera": (model.PinholeCamera, "Pose"),
    "Environment camera": (model.EnvironmentCamera, "Pose"),
    "Thin-lens camera": (model.ThinLensCamera, "Pose"),
    "Thick-lens camera": (model.ThickLensCamera, "Pose", "Lens cameras"),
    "Realistic camera": (model.RealisticCamera, "Pose", "Lens cameras"),
    "Accuracy": (model.Accuracy,),
    "Circular aperture": (model.CircularAperture,),
    "Polygon aperture": (model.PolygonAperture,),
    "Star aperture": (model.StarAperture,),
    "Heart aperture": (model.HeartAperture,),
    "Outline aperture": (model.OutlineAperture,),
    "Image aperture": (model.ImageAperture,),
    "Movements": (model.Movements,),
    "Focus": (model.Focus,),
    "Autofocus": (model.AutoFocus,),
    "Zones file": (model.ZonesFile,),
    "Autofocus of a thin lens": (model.FoundFocus,),
    "Transmission": (model.Transmission,),
    "Layers of a coating": (model.CoatingLayers,),
    "Layer of a coating": (model.lens_settings.CoatingLayer,),
    "Real lens": (model.RealLens,),
    "Copy of a lens": (model.AsBuilt,),
    "Exposure": (model.Exposure,),
    "Shutter": (model.Shutter,),
    "spectrum": (model.SpectrumSettings,),
    "Sensor": (model.Sensor,),
    "Camera keyframe": (model.CameraKeyframe, "Every keyframe"),
    "Object keyframe": (model.ObjectKeyframe, "Every keyframe"),
    "Sequence": (model.FrameSequence,),
    "Continuous focus": (model.ContinuousFocus,),
    "Value keyframe": (model.ValueKeyframe, "Every keyframe"),
    "Render": (model.RenderSettings,),
    "Picture": (model.PictureSettings,),
    "White balance": (model.WhiteBalance,),
    "Tone curve": (model.ToneCurve,),
    "Normal map": (model.NormalMap, "Every texture"),
    "Anisotropy map": (model.AnisotropyMap, "Every texture"),
    "Attenuation": (model.dielectric.Attenuation,),
    "Matte": (model.Matte, "Holes", "Normals"),
    "Mirror": (model.Mirror, "Holes"),
    "Conductor": (model.Conductor, "Holes", "Normals", "Roughness"),
    "Optical constants": (model.OpticalConstants,),
    "Metal table": (model.MetalTable,),
    "Dielectric": (model.Dielectric, "Holes", "Normals", "Roughness", "Absorption"),
    "Thin glass": (model.ThinGlass, "Holes"),
    "Plastic": (model.Plastic, "Holes", "Normals", "Roughness"),
    "Principled": (model.Principled, "Holes", "Normals", "Absorption"),
    "Mix": (model.Mix, "Holes"),
    "Emissive": (model.Emissive,),
    "Checker": (model.Checker, "Every texture"),
    "Grid": (model.Grid, "Every texture"),
    "Gradient": (model.Gradient, "Every texture"),
    "Noise": (model.Noise, "Every texture"),
    "Image": (model.ImageTexture, "Every texture"),
    "Sphere": (model.Sphere, "Every object"),
    "Disk": (model.Disk, "Every object"),
    "Rectangle": (model.Rectangle, "Every object"),
    "Box": (model.Box, "Every object"),
    "Cylinder": (model.Cylinder, "Every object"),
    "Cone": (model.Cone, "Every object"),
    "Plane": (model.Plane, "Every object"),
    "Mesh": (model.MeshObject, "Every object", "Named mesh"),
    "Named mesh": (model.NamedMesh,),
    "Board": (model.Board,),
    "Transform step": (model.TransformStep,),
    "Rotation": (model.Rotation,),
    "Point light": (model.PointLight,),
    "Spot light": (model.SpotLight,),
    "IES light": (model.ProfileLight,),
    "Directional light": (model.DirectionalLight,),
    "Sun": (model.SunLight,),
    "Constant environment": (model.ConstantEnvironment,),
    "Gradient environment": (model.GradientEnvironment,),
    "Image environment": (model.ImageEnvironment,),
    "Sky environment": (model.SkyEnvironment,),
}
BASES = {
    SceneModel,
    Pose,
    model.motion.Keyframe,
    FileReference,
    model.LensCamera,
    model.Tolerance,  # these have files of their own: docs/tolerances.md
    model.Tolerances,
    model.Merit,
    model.PlacedObject,
    model.SceneObject,
    model.mesh.MeshSource,
    model.texture.Pattern,
    model.CoveringMaterial,
    model.BumpyMaterial,
    model.material_parts.RoughMaterial,
    model.AbsorbingMaterial,
    Blend,
}

# Defaults that the reference describes in words.
IN_WORDS = {
    "movements",
    "film",
    "exposure",
    "shutter",
    "spectrum",
    "time_s",
    "render",
    "picture",
    "filter",
    "radius_px",
    "tone",
}
IN_WORDS |= {"stop", "transmission"}
FROM_CAMERA = {
    ("Gradient environment", "up"),
    ("Image environment", "up"),
    ("Sky environment", "up"),
    ("IES light", "direction"),
}


@pytest.fixture(scope="module")
def reference() -> str:
    return (Path(__file__).parents[2] / "docs" / "scene.md").read_text("utf-8")


@pytest.fixture(scope="module")
def tables(reference: str) -> dict[str, dict[str, list[str]]]:
    """Rows of the reference by section and key: meaning, range and default."""
    found: dict[str, dict[str, list[str]]] = {}
    for title, body in re.findall(r"^#+ (.+)\n((?:(?!#).*\n|#!.*\n)*)", reference, re.MULTILINE):
        rows = [
            [cell.strip() for cell in line.strip("|").split("|")] for line in body.splitlines() if line[:3] == "| `"
        ]
        found[title] = {row[0].strip("`"): row[1:] for row in rows}
    return found


def subclasses(base: type[SceneModel]) -> set[type[SceneModel]]:
    ours = (
        child for child in base.__subclasses__() if child.__module__.startswith("rptcam_cl.")
    )  # tests have some too
    return {base}.union(*map(subclasses, ours))


def test_every_model_has_a_section() -> None:
    assert {described for described, *_ in SECTIONS.values()} == subclasses(SceneModel) - BASES


def test_reference_lists_every_key_with_default_and_bounds(tables: dict[str, dict[str, list[str]]]) -> None:
    for section, (described, *shared) in SECTIONS.items():
        rows = {key: row for name in (*shared, section) for key, row in tables[name].items()}
        assert rows.keys() == described.model_fields.keys(), section
        schema = described.model_json_schema()
        for key, field in described.model_fields.items():
            _, span, default = rows[key]
            if field.is_required():
                assert default == "required", (section, key)
            elif key not in IN_WORDS and (section, key) not in FROM_CAMERA:
                assert default.split(":")[0].strip("`{") == written(field.default).strip("`{"), (section, key)
            assert all(bound in span for bound in bounds(schema["properties"][key])), (section, key, span)


def written(default: Any) -> str:
    """Return a default as the reference writes it."""
    if default is None:
        return "none"
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, tuple):
        return str(list(default))
    return "shape" if isinstance(default, SceneModel) else str(default)


def bounds(schema: dict[str, Any]) -> set[str]:
    """Return the bounds and choices of a key as the reference writes them; those of points are said once."""
    found = {f"`{choice}`" for choice in schema.get("enum", [])}
    if "const" in schema and "default" in schema:
        found.add(f"`{schema['const']}`")
    for name in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"):
        if name in schema:
            bound = schema[name]
            found.add(str(bound) if isinstance(bound, int) else f"{bound:g}")
    if len(schema.get("prefixItems", [])) != 3:
        for part in [*schema.get("anyOf", []), *schema.get("prefixItems", [])]:
            found |= bounds(part)
    return found


def test_examples_of_the_reference_are_scenes(reference: str) -> None:
    examples = [text for text in re.findall(r"```yaml\n(.*?)```", reference, re.DOTALL) if "camera" in text]
    assert examples
    for text in examples:
        load_scene(yaml.safe_load(text))


def test_published_schema_is_current(checkout: Path) -> None:
    published = json.loads((checkout / "docs" / "scene.schema.json").read_text("utf-8"))
    assert published == scene_json_schema(), "run: rptcam schema > docs/scene.schema.json"


def test_every_key_of_the_schema_is_described() -> None:
    for name, part in scene_json_schema()["$defs"].items():
        for key, schema in part["properties"].items():
            assert schema.get("description") or "$ref" in schema, f"{name}.{key}"
