"""Base of every part of the scene model: frozen, closed to unknown keys, aware of keys that exclude each other."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, get_args

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from rptcam_cl.scene.values import listed, near_name, refuse


class Alternatives(NamedTuple):
    """Keys of one mapping of which at most one may be set.

    Attributes
    ----------
    keys : tuple of str
        The keys that exclude each other.
    required : bool
        Whether one of them must be there.
    """

    keys: tuple[str, ...]
    required: bool


class AlsoAccepts:
    """Adds to a field's JSON schema a form that its validator turns into the declared one."""

    def __init__(self, form: dict[str, Any]) -> None:
        self.form = form

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema of either form."""
        return {"anyOf": [self.form, handler(schema)]}


class AlsoAcceptsItem:
    """Adds to the JSON schema of a list that a single item may stand for a list of one."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema of either form."""
        described = handler(schema)
        return {"anyOf": [described["items"], described]}


class SceneModel(BaseModel):
    """A part of a scene. Its fields are the keys of the YAML mapping; instances do not change."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True, hide_input_in_errors=True)

    alternatives: ClassVar[tuple[Alternatives, ...]] = ()

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, data: Any) -> Any:
        if isinstance(data, SceneModel):
            return data
        names = list(cls.model_fields)
        if not isinstance(data, dict):
            raise refuse("must be a mapping", allowed=f"a mapping with the keys {listed(names)}")
        for key in data:
            if key not in cls.model_fields:
                hint = _owners(cls, key) or near_name(key, names)
                raise refuse(f"unknown key{hint}", got=key, allowed=listed(names), path=(key,))
        for group in cls.alternatives:
            _check_alternatives(group, data)
        return data

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema with the rule on excluding keys added."""
        described = handler(schema)
        target = handler.resolve_ref_schema(described)
        rules = [_alternatives_schema(group) for group in cls.alternatives]
        if rules:
            target["allOf"] = rules
        return described


def _check_alternatives(group: Alternatives, data: dict[str, Any]) -> None:
    present = [key for key in group.keys if data.get(key) is not None]
    choice = " | ".join(group.keys)
    if len(present) > 1:
        raise refuse(
            f"cannot be given together with {present[0]}",
            allowed=f"{'exactly' if group.required else 'at most'} one of {choice}",
            path=(present[-1],),
        )
    if group.required and not present:
        raise refuse(f"needs one of {choice}", allowed=f"exactly one of {choice}")


def _alternatives_schema(group: Alternatives) -> dict[str, Any]:
    """Return the JSON schema rule: one of the keys, or none where that is allowed."""
    one_each: list[dict[str, Any]] = [{"required": [key]} for key in group.keys]
    if not group.required:
        one_each.append({"not": {"anyOf": [{"required": [key]} for key in group.keys]}})
    return {"oneOf": one_each}


def _owners(model: type[SceneModel], key: str) -> str:
    """Return ``; kind a has it`` where a key that one kind of a part does not know belongs to others, or nothing."""
    root = [base for base in model.__mro__ if issubclass(base, SceneModel) and base is not SceneModel][-1]
    kin = [root]
    for each in kin:
        kin += [heir for heir in each.__subclasses__() if heir not in kin]
    kinds = [
        get_args(each.model_fields["kind"].annotation)[0] for each in kin if {key, "kind"} <= set(each.model_fields)
    ]
    if not kinds:
        return ""
    return f"; kind {kinds[0]} has it" if len(kinds) == 1 else f"; kinds {', '.join(kinds)} have it"
