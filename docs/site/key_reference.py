"""Every key of a scene file, written from the models that check it: meaning with its unit, values, default."""

import json
import re
from collections.abc import Iterator
from typing import Any

from docs.site.contents import ROOT
from rptcam_cl.scene.load import scene_json_schema
from rptcam_cl.scene.scene import Scene

PICTURES = ROOT / "docs" / "images" / "keys"  # made by examples/show_keys.py
COLUMNS = 4

INTRODUCTION = """# All keys of a scene

Which keys are there, what do they take, and what do they mean? This page is written from the models that check
scene files, so it is complete and current. [The scene file](../scene.md) has the same by chapters, with examples and
the rules between keys.

Units stand in brackets. A key whose default is *required* must be there; `none` stands for an absent value.
"""


def key_page() -> str:
    """The whole page: the scene first, then every part by its name."""
    schema = scene_json_schema()
    parts = {"Scene": {**schema, "description": Scene.__doc__}, **dict(sorted(schema["$defs"].items()))}
    for part in parts.values():
        for value in part["properties"].values():
            if "$ref" in value and "description" not in value:
                value["description"] = schema["$defs"][value["$ref"].rpartition("/")[2]]["description"]
    return INTRODUCTION + overview(parts) + "".join(section(name, part) for name, part in parts.items())


def overview(parts: dict[str, Any]) -> str:
    """All pictures of the page side by side, each with a link to its keys."""
    cells = [f"{picture(name)}<br>{link(name)}" for name in parts if picture(name)]
    cells += [" "] * (-len(cells) % COLUMNS)
    rows = [cells[start : start + COLUMNS] for start in range(0, len(cells), COLUMNS)]
    rows.insert(1, ["---"] * COLUMNS)
    return "\n" + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def picture(name: str) -> str:
    """What a model does, as a picture; nothing where there is none."""
    return f"![{spaced(name)}](../images/keys/{name}.jpg)" if (PICTURES / f"{name}.jpg").is_file() else ""


def link(name: str) -> str:
    """A link to the keys of a model."""
    return f"[{spaced(name)}](#{spaced(name).lower().replace(' ', '-')})"


def section(name: str, part: dict[str, Any]) -> str:
    """Heading, description and table of one part of the scene."""
    rows = (row(key, value, key in part.get("required", ())) for key, value in part["properties"].items())
    head = "| key | meaning | values | default |\n|---|---|---|---|\n"
    shown = f"{picture(name)}\n\n" if picture(name) else ""
    return f"\n## {spaced(name)}\n\n{one_line(part.get('description', ''))}\n\n{shown}{head}{''.join(rows)}"


def row(key: str, value: dict[str, Any], required: bool) -> str:
    """One key as a line of a table."""
    default = "*required*" if required else f"`{plain(value.get('default'))}`"
    meaning = one_line(value.get("description", ""))
    return f"| `{key}` | {meaning} | {'<br>'.join(dict.fromkeys(values(value))) or 'any'} | {default} |\n"


def plain(default: Any) -> str:
    """A default as a scene file has it; keys of a mapping that are absent are left out."""
    if default is None:
        return "none"
    return default if isinstance(default, str) else json.dumps(without_absent(default), ensure_ascii=False)


def without_absent(default: Any) -> Any:
    """A default without the keys that are none."""
    if not isinstance(default, dict):
        return default
    return {key: without_absent(value) for key, value in default.items() if value is not None}


def values(schema: dict[str, Any]) -> Iterator[str]:
    """What a key takes, one text for each kind of value; null is left out, as the default says it."""
    for choice in (*schema.get("anyOf", ()), *schema.get("oneOf", ())):
        yield from values(choice)
    if "$ref" in schema:
        yield link(schema["$ref"].rpartition("/")[2])
    elif "const" in schema:
        yield f"`{schema['const']}`"
    elif "enum" in schema:
        yield ", ".join(f"`{choice}`" for choice in schema["enum"])
    elif schema.get("type") in ("number", "integer"):
        yield number(schema)
    elif schema.get("type") == "array":
        yield sequence(schema)
    elif schema.get("type") == "object":
        inner = schema.get("additionalProperties")
        yield "mapping by name of " + " or ".join(values(inner)) if isinstance(inner, dict) else "mapping"
    elif schema.get("type") in ("string", "boolean"):
        yield {"string": "text", "boolean": "`true`, `false`"}[schema["type"]]


def number(schema: dict[str, Any]) -> str:
    """A number with its range."""
    kind = "whole number" if schema["type"] == "integer" else "number"
    low, above = schema.get("minimum"), schema.get("exclusiveMinimum")
    high, below = schema.get("maximum"), schema.get("exclusiveMaximum")
    bounds = [
        *([f"from {low:g}"] if low is not None else [f"above {above:g}"] if above is not None else []),
        *([f"to {high:g}"] if high is not None else [f"below {below:g}"] if below is not None else []),
    ]
    return " ".join([kind, *bounds])


def sequence(schema: dict[str, Any]) -> str:
    """A list: how many of what."""
    items = schema.get("prefixItems") or [schema.get("items", {})]
    inner = " or ".join(dict.fromkeys(text for item in items for text in values(item))) or "anything"
    least, most = schema.get("minItems"), schema.get("maxItems")
    count = f"{least} " if least == most and least is not None else ""
    return f"list of {count}{inner}"


def spaced(name: str) -> str:
    """The name of a model in words: ``ThinLensCamera`` is *Thin lens camera*."""
    words = re.findall(r"[A-Z][a-z0-9]*", name)
    return " ".join([words[0], *(word.lower() for word in words[1:])])


def one_line(text: str) -> str:
    """Prose for a cell of a table."""
    return re.sub(r"\s+", " ", text).strip().replace("``", "`").replace("|", "\\|")
