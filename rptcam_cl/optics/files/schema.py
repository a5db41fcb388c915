"""The JSON schema of lens files, for editors, from the declarations that the readers check by."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from rptcam_cl.optics.files.key import Key, mapping
from rptcam_cl.optics.files.keys import COATING, COATING_WORDS, GLASS, LAWS, LENS, SURFACE
from rptcam_cl.optics.shapes import FORMS


def lens_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a lens file in our own form (draft 2020-12)."""
    of_forms = {key: beside for form in FORMS for key, beside in form.needs.items()}
    needs = {"outside": ["clear"], **of_forms, "shape": ["stop"]}
    surface = mapping(SURFACE, ("diameter",), dependentRequired=needs)
    surface["not"] = {"required": ["cylinder", "radius_x"]}
    coating = mapping(COATING, minProperties=1, maxProperties=1)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Lens",
        "description": "A lens: its surfaces from the scene to the film.",
        **mapping(LENS, ("surfaces",)),
        "$defs": {"Glass": glass_json_schema(GLASS), "Surface": surface,
                  "Coating": {"oneOf": [{"enum": list(COATING_WORDS)}, coating]}},
    }  # fmt: skip


def glass_json_schema(keys: Mapping[str, Key]) -> dict[str, Any]:
    """Return the JSON schema of a glass that is a name or a mapping with these keys."""
    one_law = [{"required": [law]} for law in LAWS]
    written = mapping(keys, oneOf=one_law, dependentRequired={"nd": ["vd"], "vd": ["nd"], "catalogue": ["name"]})
    return {"oneOf": [{"type": "string"}, written]}


def lens_json_schema_text() -> str:
    """Return the JSON schema as the text of `docs/lens.schema.json`."""
    return json.dumps(lens_json_schema(), indent=1, ensure_ascii=False) + "\n"
