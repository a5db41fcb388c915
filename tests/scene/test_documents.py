"""The schema and the reference say what the models say."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from rptcam_cl.scene.base import FileReference, SceneModel
from rptcam_cl.scene.camera import (
    CameraKind,
    EnvironmentCamera,
    LensCamera,
    Movements,
    OrthographicCamera,
    PinholeCamera,
    Pose,
    RealisticCamera,
    SensorGrating,
    ThickLensCamera,
    ThinLensCamera,
)
from rptcam_cl.scene.exposure import ContinuousFocus, Exposure, FrameSequence, Shutter, ValueKeyframe
from rptcam_cl.scene.film import (
    ColourView,
    Film,
    FilmFilter,
    PictureSettings,
    RenderSettings,
    Sensor,
    SpectrumSettings,
    ToneCurve,
    WhiteBalance,
)
from rptcam_cl.scene.lens_settings import (
    Accuracy,
    AsBuilt,
    AutoFocus,
    CircularAperture,
    CoatingLayer,
    CoatingLayers,
    Dirt,
    Focus,
    FocusMask,
    FoundFocus,
    HeartAperture,
    ImageAperture,
    Merit,
    OutlineAperture,
    PolygonAperture,
    RealLens,
    StarAperture,
    Stop,
    Tolerance,
    Tolerances,
    Transmission,
    ZonesFile,
)
from rptcam_cl.scene.lights import (
    ConstantEnvironment,
    DirectionalLight,
    GradientEnvironment,
    GroupedLight,
    ImageEnvironment,
    PointLight,
    ProfileLight,
    SkyEnvironment,
    SpotLight,
    SunLight,
    Surrounding,
)
from rptcam_cl.scene.load import load_scene, scene_json_schema
from rptcam_cl.scene.materials import (
    Boundary,
    BumpyMaterial,
    Conductor,
    CoveringMaterial,
    Dielectric,
    Emissive,
    Hair,
    Matte,
    Measured,
    MetalTable,
    Mirror,
    Mix,
    OpticalConstants,
    Plastic,
    Principled,
    RoughMaterial,
    ThinFilm,
    ThinGlass,
    Translucent,
)
from rptcam_cl.scene.media import (
    AbsorbingMaterial,
    Attenuation,
    DensityGrid,
    FogLayer,
    ScatteringMedium,
    SurroundingMedium,
)
from rptcam_cl.scene.meshes import Displacement, MeshObject, MeshSource, NamedMesh
from rptcam_cl.scene.placement import (
    CameraKeyframe,
    CameraVisibility,
    Instances,
    Keyframe,
    ObjectKeyframe,
    PlacedObject,
    Rotation,
    SceneObject,
    TransformStep,
    Visibility,
)
from rptcam_cl.scene.quantities import LightSpectrum, TabulatedSpectrum
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.shapes import Board, Box, Cone, Curves, Cylinder, Disk, Plane, Rectangle, Sphere
from rptcam_cl.scene.textures import (
    AnisotropyMap,
    Blend,
    Bump,
    Checker,
    Dots,
    Gradient,
    Grid,
    ImageTexture,
    Mapping,
    Marble,
    Mixture,
    Noise,
    NormalMap,
    Pattern,
    Perlin,
)

# Sections of docs/scene.md: the model that each describes, and the sections that describe the keys that it shares.
SECTIONS: dict[str, tuple[type[SceneModel], *tuple[str, ...]]] = {
    "Scene": (Scene,),
    "Tabulated spectrum": (TabulatedSpectrum,),
    "Light spectrum": (LightSpectrum, "Tabulated spectrum"),
    "Film": (Film,),
    "Filter": (FilmFilter,),
    "Stop": (Stop,),
    "Dirt": (Dirt,),
    "Pinhole camera": (PinholeCamera, "Pose"),
    "Orthographic camera": (OrthographicCamera, "Pose"),
    "Environment camera": (EnvironmentCamera, "Pose"),
    "Thin-lens camera": (ThinLensCamera, "Pose"),
    "Thick-lens camera": (ThickLensCamera, "Pose", "Lens cameras"),
    "Realistic camera": (RealisticCamera, "Pose", "Lens cameras"),
    "Sensor grating": (SensorGrating,),
    "Accuracy": (Accuracy,),
    "Circular aperture": (CircularAperture,),
    "Polygon aperture": (PolygonAperture,),
    "Star aperture": (StarAperture,),
    "Heart aperture": (HeartAperture,),
    "Outline aperture": (OutlineAperture,),
    "Image aperture": (ImageAperture,),
    "Movements": (Movements,),
    "Focus": (Focus,),
    "Autofocus": (AutoFocus,),
    "Zones file": (ZonesFile,),
    "Mask of focus": (FocusMask,),
    "Autofocus of a thin lens": (FoundFocus,),
    "Transmission": (Transmission,),
    "Layers of a coating": (CoatingLayers,),
    "Layer of a coating": (CoatingLayer,),
    "Real lens": (RealLens,),
    "Copy of a lens": (AsBuilt,),
    "Exposure": (Exposure,),
    "Shutter": (Shutter,),
    "spectrum": (SpectrumSettings,),
    "Sensor": (Sensor,),
    "Camera keyframe": (CameraKeyframe, "Every keyframe"),
    "Object keyframe": (ObjectKeyframe, "Every keyframe"),
    "Sequence": (FrameSequence,),
    "Continuous focus": (ContinuousFocus,),
    "Value keyframe": (ValueKeyframe, "Every keyframe"),
    "Render": (RenderSettings,),
    "Picture": (PictureSettings,),
    "White balance": (WhiteBalance,),
    "Tone curve": (ToneCurve,),
    "OpenColorIO view": (ColourView,),
    "Normal map": (NormalMap, "Every texture"),
    "Bump": (Bump,),
    "Mapping": (Mapping,),
    "Thin film": (ThinFilm,),
    "Anisotropy map": (AnisotropyMap, "Every texture"),
    "Attenuation": (Attenuation,),
    "Matte": (Matte, "Holes", "Normals"),
    "Translucent": (Translucent, "Holes", "Normals"),
    "Measured": (Measured, "Holes", "Normals"),
    "Mirror": (Mirror, "Holes"),
    "Conductor": (Conductor, "Holes", "Normals", "Roughness"),
    "Optical constants": (OpticalConstants,),
    "Metal table": (MetalTable,),
    "Dielectric": (Dielectric, "Holes", "Normals", "Roughness", "Absorption"),
    "Thin glass": (ThinGlass, "Holes"),
    "Plastic": (Plastic, "Holes", "Normals", "Roughness"),
    "Principled": (Principled, "Holes", "Normals", "Absorption"),
    "Mix": (Mix, "Holes"),
    "Emissive": (Emissive,),
    "Boundary": (Boundary,),
    "Hair": (Hair,),
    "Scattering medium": (ScatteringMedium,),
    "Surrounding medium": (SurroundingMedium, "Scattering medium"),
    "Fog layer": (FogLayer,),
    "Density grid": (DensityGrid,),
    "Checker": (Checker, "Every texture"),
    "Grid": (Grid, "Every texture"),
    "Gradient": (Gradient, "Every texture"),
    "Noise": (Noise, "Every texture"),
    "Perlin": (Perlin, "Every texture"),
    "Marble": (Marble, "Every texture"),
    "Dots": (Dots, "Every texture"),
    "Mixture": (Mixture,),
    "Displacement": (Displacement,),
    "Image": (ImageTexture, "Every texture"),
    "Instances": (Instances,),
    "Visibility": (Visibility, "Camera visibility"),
    "Camera visibility": (CameraVisibility,),
    "Sphere": (Sphere, "Every object"),
    "Disk": (Disk, "Every object"),
    "Rectangle": (Rectangle, "Every object"),
    "Box": (Box, "Every object"),
    "Cylinder": (Cylinder, "Every object"),
    "Cone": (Cone, "Every object"),
    "Plane": (Plane, "Every object"),
    "Curves": (Curves, "Every object"),
    "Mesh": (MeshObject, "Every object", "Named mesh"),
    "Named mesh": (NamedMesh,),
    "Board": (Board,),
    "Transform step": (TransformStep,),
    "Rotation": (Rotation,),
    "Point light": (PointLight,),
    "Spot light": (SpotLight,),
    "IES light": (ProfileLight,),
    "Directional light": (DirectionalLight,),
    "Sun": (SunLight,),
    "Constant environment": (ConstantEnvironment,),
    "Gradient environment": (GradientEnvironment,),
    "Image environment": (ImageEnvironment,),
    "Sky environment": (SkyEnvironment,),
}
BASES = {
    SceneModel,
    GroupedLight,
    Surrounding,
    CameraKind,
    Pose,
    Keyframe,
    FileReference,
    LensCamera,
    Tolerance,  # these have files of their own: docs/tolerances.md
    Tolerances,
    Merit,
    PlacedObject,
    SceneObject,
    MeshSource,
    Pattern,
    CoveringMaterial,
    BumpyMaterial,
    RoughMaterial,
    AbsorbingMaterial,
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
IN_WORDS |= {"stop", "transmission", "visible"}
FROM_CAMERA = {
    ("Fog layer", "up"),
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
    whole = Scene.model_json_schema()
    for section, (described, *shared) in SECTIONS.items():
        rows = {key: row for name in (*shared, section) for key, row in tables[name].items()}
        assert rows.keys() == described.model_fields.keys(), section
        schema = whole["$defs"].get(described.__name__, whole)
        for key, field in described.model_fields.items():
            _, span, default = rows[key]
            if field.is_required():
                assert default == "required", (section, key)
            elif key not in IN_WORDS and (section, key) not in FROM_CAMERA:
                assert default.split(": ")[0].strip("`{") == written(field.default).strip("`{"), (section, key)
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
