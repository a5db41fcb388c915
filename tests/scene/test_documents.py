"""The schema and the reference say what the models say."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.load import load_scene, scene_json_schema
from rptcam_cl.scene.scene import Scene

# Sections of docs/scene.md that are not called as their model is, and those of keys that models share.
SECTIONS = {
    "FilmFilter": "Filter", "AutoFocus": "Autofocus", "FocusMask": "Mask of focus",
    "FoundFocus": "Autofocus of a thin lens", "CoatingLayers": "Layers of a coating",
    "CoatingLayer": "Layer of a coating", "AsBuilt": "Copy of a lens", "SpectrumSettings": "spectrum",
    "FrameSequence": "Sequence", "RenderSettings": "Render", "PictureSettings": "Picture",
    "ColourView": "OpenColorIO view", "ImageTexture": "Image", "MeshObject": "Mesh", "ProfileLight": "IES light",
    "SunLight": "Sun", "ThinLensCamera": "Thin-lens camera", "ThickLensCamera": "Thick-lens camera",
}  # fmt: skip
SHARED = {
    "Pose": "Pose", "LensCamera": "Lens cameras", "Keyframe": "Every keyframe", "Pattern": "Every texture",
    "CoveringMaterial": "Holes", "BumpyMaterial": "Normals", "RoughMaterial": "Roughness",
    "AbsorbingMaterial": "Absorption", "PlacedObject": "Every object", "MeshSource": "Named mesh",
}  # fmt: skip
BASES = {"SceneModel", "GroupedLight", "Surrounding", "CameraKind", "FileReference", "SceneObject", "Blend"}
ELSEWHERE = {"Tolerance", "Tolerances", "Merit"}  # docs/tolerances.md

# Defaults that the reference describes in words.
IN_WORDS = {
    "movements", "film", "exposure", "shutter", "spectrum", "time_s", "render", "picture", "filter", "radius_px",
    "tone", "stop", "transmission", "visible",
}  # fmt: skip
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
    """Return a model with those of the package that are made of it; tests have some too."""
    ours = (child for child in base.__subclasses__() if child.__module__.startswith("rptcam_cl."))
    return {base}.union(*map(subclasses, ours))


def section_of(model: type[SceneModel]) -> str:
    """Return the section that describes a model: its name in words, unless it is called otherwise."""
    return SECTIONS.get(model.__name__, re.sub(r"(?<!^)(?=[A-Z])", " ", model.__name__).capitalize())


def described() -> list[type[SceneModel]]:
    """Return the models that have a section of their own."""
    return [each for each in subclasses(SceneModel) if each.__name__ not in BASES | ELSEWHERE | SHARED.keys()]


def test_every_model_has_a_section(tables: dict[str, dict[str, list[str]]]) -> None:
    assert {section_of(model) for model in described()} <= tables.keys()


def test_reference_lists_every_key_with_default_and_bounds(tables: dict[str, dict[str, list[str]]]) -> None:
    whole = Scene.model_json_schema()
    for model in described():
        section = section_of(model)
        shared = [SHARED.get(each.__name__) or section_of(each) for each in reversed(model.__mro__[1:])
                  if issubclass(each, SceneModel) and each.__name__ not in BASES]  # fmt: skip
        shared = shared if section != "Board" else []  # which has objects' keys but their material
        rows = {key: row for name in (*shared, section) for key, row in tables[name].items()}
        assert rows.keys() == model.model_fields.keys(), section
        schema = whole["$defs"].get(model.__name__, whole)
        for key, field in model.model_fields.items():
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
