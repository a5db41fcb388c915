"""The JSON schema of scene files, for editors."""

from __future__ import annotations

import json
from typing import Any

from rptcam_cl.scene.scene import Scene


def scene_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file (draft 2020-12)."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | Scene.model_json_schema()


def scene_json_schema_text() -> str:
    """Return the JSON schema as the text of `docs/scene.schema.json`."""
    return json.dumps(scene_json_schema(), indent=1, ensure_ascii=False) + "\n"
